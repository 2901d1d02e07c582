"""Goals of a campaign: how well joints or deflections are to be known."""

from __future__ import annotations

import re
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from jointstiff.schemas.fields import Dimensionless, Message, Metres, Newtons, Vector3

_Share = Annotated[float, Field(strict=True, ge=0.001, le=1.0)]
_Length = Annotated[float, Field(strict=True, ge=1e-9, le=1.0)]


class JointsGoal(Message):
    """Every joint that a load can twist is known to a share of its stiffness."""

    kind: Literal["joints"]
    relative: Dimensionless[_Share] = Field(
        description="Greatest half-width of a 95 % interval over the compliance: 0.15 for ± 15 %."
    )


class DeflectionGoal(Message):
    """The deflection in a box is known to some micrometres."""

    kind: Literal["deflection"]
    uncertainty: Metres[_Length] = Field(
        description="Greatest expanded uncertainty (95 %) of a coordinate of the deflection, root mean "
        "square over places of the work area and forces along the axes of R0."
    )
    force: Newtons[Vector3 | None] = Field(
        default=None,
        description="Force there, axes of R0; default: that of the load, down if it is a weight, else along "
        "each axis.",
    )


class DecisionGoal(Message):
    """A decision: does the deflection in a box stay below a limit?"""

    kind: Literal["decision"]
    limit: Metres[_Length] = Field(
        description="Greatest length of the deflection at any place of the work area, by a force along an "
        "axis of R0. The decision is made once the "
        "95 % interval of the greatest deflection does not contain the limit."
    )
    force: Newtons[Vector3 | None] = Field(
        default=None,
        description="Force there, axes of R0; default: that of the load, down if it is a weight, else along "
        "each axis.",
    )


Goal = Annotated[JointsGoal | DeflectionGoal | DecisionGoal, Field(discriminator="kind")]

_WORDS: Final = re.compile(
    r"(?P<below>below|<)?\s*±?\s*(?P<number>[0-9]*\.?[0-9]+(?:e-?[0-9]+)?)\s*(?P<unit>%|um|µm|μm|mm|m)",
    re.IGNORECASE,
)
_METRES: Final = {"um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "m": 1.0}


def goal_in_words(text: str) -> dict[str, Any]:
    """Return the goal of `15 %` (every joint), `6 um` (the deflection in a box), or `below 0.5 mm`.

    Raises:
        ValueError: the text is no goal.
    """
    match = _WORDS.fullmatch(text.strip())
    relative = match is not None and match["unit"] == "%"
    if match is None or float(match["number"]) <= 0.0 or (relative and match["below"]):
        raise ValueError(
            f'\'{text}\' is no goal: write "15 %" for every joint, "6 um" for the deflection in the work '
            'area, or "below 0.5 mm" for a decision about it'
        )
    number = float(match["number"])
    if relative:
        return {"kind": "joints", "relative": 0.01 * number}
    size = number * _METRES[match["unit"].lower()]
    if match["below"]:
        return {"kind": "decision", "limit": size}
    return {"kind": "deflection", "uncertainty": size}
