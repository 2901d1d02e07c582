"""The catalogue of nominal arms: published figures in `arms.json`, in millimetres and degrees."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from math import radians
from typing import Any, Final

from jointstiff.schemas.robot import Arm, Catalogue, DhModel, DhRow, JointMap, JointMapPreset, RobotDocument
from jointstiff.solver.errors import RequestError

_SHOWN: Final = 5  # largest number of arms that a message names


@cache
def catalogue() -> Catalogue:
    """Read `arms.json`; return its arms, in m and rad, and its presets of joint maps."""
    text = files("jointstiff.service.conversion").joinpath("arms.json").read_text(encoding="utf-8")
    tables = json.loads(text)
    presets = [_build_preset(each) for each in tables["joint_maps"]]
    maps = {preset.id: preset.joint_map for preset in presets}
    arms = [_build_arm(each, maps) for each in tables["arms"]]
    return Catalogue(arms=arms, joint_maps=presets)


def _build_preset(entry: dict[str, Any]) -> JointMapPreset:
    """Return the preset of a joint map from its entry in `arms.json`."""
    matrix = entry["matrix"]
    joint_map = JointMap(matrix=matrix, offset=[0.0] * len(matrix))
    return JointMapPreset(joint_map=joint_map, **_drop_keys(entry, "matrix"))


def _build_arm(entry: dict[str, Any], maps: Mapping[str, JointMap]) -> Arm:
    """Return an arm, in m and rad, from its entry in `arms.json`; `maps` has the joint maps by their ids."""
    map_id = entry["joint_map"]
    model = DhModel(format="dh", convention=entry["convention"], rows=_build_dh_rows(entry))
    return Arm(
        **_drop_keys(entry, "rows", "speeds", "convention", "joint_map", "reach"),
        model=model,
        joint_map=None if map_id is None else maps[map_id],
        joint_map_preset=map_id,
        reach=entry["reach"] / 1e3,
    )


def find_arm(name: str, where: str) -> Arm:
    """Return the catalogue's arm with a name, or with a part of a name that no other arm has.

    The part has whole words and all digits of the name: "IRB 6700" fits arms of several reaches, but the
    catalogue has one, and a UR5 is no UR5e.

    Args:
        name: name as it was typed, such as `KUKA KR 210 R2700`; case, blanks and signs do not count.
        where: field or option that holds the name, for messages.

    Raises:
        RequestError: no arm of the catalogue, or several, have the name.
    """
    wanted = _normalise_name(name)
    arms = [arm for arm in catalogue().arms if wanted and wanted in _normalise_name(arm.name)]
    exact = [arm for arm in arms if _normalise_name(arm.name) == wanted]
    meant = exact or [arm for arm in arms if _is_whole_part(wanted, arm.name)]
    if len(meant) == 1:
        return meant[0]
    names = {_normalise_name(arm.name): arm.name for arm in catalogue().arms}
    near = get_close_matches(wanted, names, n=_SHOWN, cutoff=0.5)
    similar = [arm.name for arm in arms[:_SHOWN]] or [names[each] for each in near]
    reason = f"the catalogue has no arm '{name}'"
    if arms:
        reason = f"'{name}' is not the whole name of one arm of the catalogue"
    if similar:
        reason += f"; similar names: {', '.join(similar)}"
    raise RequestError(
        reason,
        where=where,
        remedy="`jointstiff robots` and GET /v1/catalogue list its arms; or describe the arm by a DH table "
        "or URDF",
    )


def _is_whole_part(wanted: str, name: str) -> bool:
    """Return whether a part of an arm's name, normalised, has whole words and all digits of the name.

    By digits makers distinguish payloads and reaches, by letters of a word generations.
    """
    before, _, after = _normalise_name(name).partition(wanted)
    ends = {0}
    for word in re.split(r"[\W_]+", name):
        ends.add(max(ends) + len(_normalise_name(word)))
    has_all_digits = not any(character.isdigit() for character in before + after)
    return has_all_digits and {len(before), len(before) + len(wanted)} <= ends


def nominal_robot(arm: Arm) -> RobotDocument:
    """Return the robot document of an arm of the catalogue, with `(nominal)` after the arm's name."""
    return RobotDocument(
        name=f"{arm.name} (nominal)", model=arm.model, joint_map=arm.joint_map, payload=arm.payload
    )


def _normalise_name(name: str) -> str:
    """Return the letters and digits of a name in lower case, for comparisons."""
    return re.sub(r"[\W_]+", "", name.casefold())


def _drop_keys(table: dict[str, Any], *names: str) -> dict[str, Any]:
    """Return a copy of a dictionary without the keys `names`."""
    return {name: value for name, value in table.items() if name not in names}


def _build_dh_rows(arm: dict[str, Any]) -> list[DhRow]:
    """Return the DH rows of an arm of `arms.json`, with the speeds of its joints if they are known."""
    speeds = arm.get("speeds") or [None] * len(arm["rows"])
    return [_build_dh_row([*row, speed]) for row, speed in zip(arm["rows"], speeds, strict=True)]


def _build_dh_row(numbers: list[float | None]) -> DhRow:
    """Return a DH row, in m and rad, from a, alpha, d, theta, limits and speed in mm and degrees."""
    a, alpha, d, theta = (each or 0.0 for each in numbers[:4])
    lower, upper, speed = numbers[4:]
    return DhRow(
        a=a / 1e3,
        alpha=radians(alpha),
        d=d / 1e3,
        theta=radians(theta),
        lower=None if lower is None else radians(lower),
        upper=None if upper is None else radians(upper),
        speed=None if speed is None else radians(speed),
    )
