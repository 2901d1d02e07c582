"""Campaigns to try, by name: simulated ones, and one of a real robot. They are loaded without a network."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, get_args

from jointstiff.service.library.campaigns import Campaign
from jointstiff.service.resources.documents import parse_document, read_object
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    from jointstiff.simulator import Encoders, Load

Name = Literal["dead_weight", "pull", "secondary_encoders", "fanuc_r2000ic"]

_DATA: Final = Path(__file__).with_name("data")
_ABOUT: Final[dict[Name, str]] = {
    "dead_weight": "Simulated: 19 postures of an arm of six axes, 1500 N downwards, noise 20 µm. No reading "
    "twists joint 1.",
    "pull": "Simulated: 19 postures of the same arm, 1500 N in all directions, noise 20 µm. Every joint is "
    "determined.",
    "secondary_encoders": "Simulated: 19 postures, as `pull`; axes 1 to 3 have secondary encoders.",
    "fanuc_r2000ic": "Measured: 30 postures of a FANUC R-2000iC pulled by a cable; deflections of the tool "
    "centre. The noise of the instrument is not stated. Copyright (c) 2026 longton2001-pixel, MIT licence; "
    "from github.com/longton2001-pixel/breakthrough-surge-suppression-in-high-speed-robotic-drilling, "
    "commit e5c2f79.",
}


def names() -> tuple[Name, ...]:
    """Return the names of the campaigns that `load` accepts."""
    return get_args(Name)


def about(name: Name) -> str:
    """Return in words what a campaign is; of a measured campaign also its source and licence.

    Raises:
        RequestError: no campaign has this name.
    """
    _refuse_unknown(name)
    return _ABOUT[name]


def load(name: Name) -> Campaign:
    """Return a campaign by its name, for `js.identify` and all other functions.

    The stiffnesses of the simulated arm are those of `jointstiff.simulator.default_arm`.

    Raises:
        RequestError: no campaign has this name.
    """
    _refuse_unknown(name)
    if name == "fanuc_r2000ic":
        return parse_document(read_object(_DATA / "fanuc_r2000ic.json"), Campaign)
    from jointstiff.simulator import default_arm, simulate_campaign

    encoders: Encoders = "secondary" if name == "secondary_encoders" else "motor"
    direction: Load = "dead_weight" if name == "dead_weight" else "pull"
    document = simulate_campaign(default_arm(encoders), load=direction, encoders=encoders)
    return parse_document(document, Campaign)


def _refuse_unknown(name: str) -> None:
    """Refuse a name that no campaign has.

    Raises:
        RequestError: lists the names.
    """
    if name not in names():
        raise RequestError(
            f"there is no campaign '{name}'", where="name", remedy=f"use one of {', '.join(names())}"
        )
