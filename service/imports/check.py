"""One check of any mapping, proposed, edited or of a template: does the robot explain the readings?

Positions must be where the robot carries their targets, and targets must yield to the force.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import Final

import numpy as np

from jointstiff.schemas.imports import FarPosition, Mapping, State
from jointstiff.service.imports.gather import Key, Readings
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.kinematics import FlangeModel
from jointstiff.solver.mechanics.robot import Robot

_LARGEST_RESIDUAL: Final = 2e-2
"""Median distance [m] of positions from where a nominal robot puts their targets: arms with wrong zeros."""
_FAR: Final = 1e-2
"""Distance [m] from which a position may not belong to its joints."""
_FAR_OF_MEDIAN: Final = 5.0
"""The same distance as a multiple of the median distance."""
_LEAST_ALONG: Final = 0.7
"""Fraction of the deflections along their force below which states or force are wrong."""
_AGAINST: Final = 0.3
"""Negative work, as a part of the usual work, from which a deflection goes against its force."""
_YIELDS: Final = (1e-9, 1e-4)
"""Deflections per force [m/N] that arms have; usual ones are 1e-7 to 1e-5."""
_SHOWN: Final = 3
_WITHOUT_LOAD: Final[tuple[State, ...]] = ("unloaded", "unloaded_after")


@dataclass(frozen=True)
class Check:
    """Judgement of robot and force about readings."""

    sentence: str = ""
    faults: list[str] = field(default_factory=list)  #: why the readings cannot be right
    far: list[FarPosition] = field(default_factory=list)  #: positions that are far from their places


@dataclass(frozen=True)
class _Deflection:
    """Deflection of a target under the force of its observation."""

    name: str
    work: float  #: [N m]
    compliance: float  #: deflection per force [m/N]


def check(readings: Readings, mapping: Mapping, robot: Robot | None) -> Check:
    """Compare readings with each other, with the robot and with the force; None skips the robot."""
    faults = list(_find_gaps(readings))
    sentences = []
    far: list[FarPosition] = []
    if robot is not None and readings.positions:
        distances = _measure_distances(readings, mapping, robot)
        residual = float(np.median(list(distances.values())))
        limit = max(_FAR, _FAR_OF_MEDIAN * residual)
        far = [_describe_far(key, distance) for key, distance in distances.items() if distance > limit]
        near = len(distances) - len(far)
        sentences.append(f"{near} of {len(distances)} positions fit the robot to {1e3 * residual:.2g} mm")
        if residual > _LARGEST_RESIDUAL:
            faults.append(
                f"the robot is {1e3 * residual:.3g} mm away from the positions: look at the joints, their "
                "unit and the frame"
            )
        elif far:
            places = ", ".join(f"{each.posture} {each.target}" for each in far[:_SHOWN])
            faults.append(
                f"{len(far)} of {len(distances)} positions do not belong to their joints ({places}): look at "
                "these rows"
            )
    deflections = list(_list_deflections(readings, mapping))
    if deflections:
        along = [each for each in deflections if each.work > 0.0]
        sentences.append(f"{len(along)} of {len(deflections)} deflections are along their force")
        faults += _find_wrong_deflections(deflections)
    read = {(key.posture, key.target) for key in readings.list_keys()}
    targets = dict.fromkeys(target for _, target in read)
    missing = [
        f"{posture} {target}"
        for posture, target in product(readings.joints, targets)
        if (posture, target) not in read
    ]
    if missing:
        sentences.append(f"{len(missing)} targets were not read ({', '.join(missing[:_SHOWN])})")
    return Check("; ".join(sentences), faults, far)


def _describe_far(key: Key, distance: float) -> FarPosition:
    return FarPosition(posture=key.posture, target=key.target, state=key.state, distance=1e3 * distance)


def _measure_distances(readings: Readings, mapping: Mapping, robot: Robot) -> dict[Key, float]:
    """Return the distance [m] of each position from where the robot carries its target."""
    postures = list(readings.joints)
    row_of = {posture: row for row, posture in enumerate(postures)}
    controller = np.array([readings.joints[posture] for posture in postures])
    rotation, place = FlangeModel.of(robot).place_flange(robot.joint_map.model_angles(controller))
    distances: dict[Key, float] = {}
    for target in readings.targets:
        keys = [key for key in readings.positions if key.target == target]
        rows = [row_of[key.posture] for key in keys]
        positions = to_base(np.array([readings.positions[key] for key in keys]), mapping)
        in_flange = np.einsum("nji,nj->ni", rotation[rows], positions - place[rows])
        gaps = np.linalg.norm(in_flange - np.median(in_flange, axis=0), axis=1)
        distances |= dict(zip(keys, gaps.tolist(), strict=True))
    return distances


def to_base(positions: FloatArray, mapping: Mapping) -> FloatArray:
    """Return positions (N, 3) [m] in R0."""
    if mapping.frame is None:
        return positions
    rotation, origin = np.array(mapping.frame.rotation), 1e-3 * np.array(mapping.frame.origin)
    return np.asarray(positions @ rotation.T + origin)


def _find_gaps(readings: Readings) -> Iterator[str]:
    """Yield which readings are missing, or have no state."""
    keys = list(readings.positions)
    if not keys and not readings.displacements and not readings.gauges:
        yield "no column has positions: name the columns of x, y and z"
    is_loaded = any(key.state == "loaded" for key in keys)
    if any(key.state is None for key in keys) and is_loaded:
        yield "some positions have no state: say which are under load"
    alone = [key for key in keys if key.state == "loaded" and not _is_read_unloaded(readings, key)]
    if alone:
        yield (
            f"{len(alone)} positions were read under a load, and never without a load "
            f"({_list_names(alone)}): read each posture in both states"
        )
    states_of: dict[tuple[str, str], int] = {}
    for key in keys:
        states_of[key.posture, key.target] = states_of.get((key.posture, key.target), 0) + 1
    most = max(states_of.values(), default=0)
    few = [key for key in keys if states_of[key.posture, key.target] < most and key.load is None]
    if few and not alone:
        yield f"some targets are missing in a state ({_list_names(few)}): clear or complete their readings"


def _is_read_unloaded(readings: Readings, key: Key) -> bool:
    return any(
        readings.find_position(key.posture, key.target, state, None) is not None for state in _WITHOUT_LOAD
    )


def _list_names(keys: list[Key]) -> str:
    return ", ".join(f"{key.posture} {key.target}" for key in keys[:_SHOWN])


def _list_deflections(readings: Readings, mapping: Mapping) -> Iterator[_Deflection]:
    """Yield the deflection of each target under each load whose force is known."""
    moved: dict[Key, FloatArray] = dict(readings.displacements)
    for key, loaded in readings.positions.items():
        unloaded = readings.find_position(key.posture, key.target, "unloaded", None)
        if key.state == "loaded" and unloaded is not None:
            moved[key] = loaded - unloaded
    turn = np.eye(3) if mapping.frame is None else np.array(mapping.frame.rotation)
    for key, deflection in moved.items():
        force = readings.find_force(key.posture, key.load, mapping.force)
        if force is not None and force.any():
            work = float(force @ (turn @ deflection))
            compliance = float(np.linalg.norm(deflection) / np.linalg.norm(force))
            yield _Deflection(f"{key.posture} {key.target}", work, compliance)


def _find_wrong_deflections(deflections: list[_Deflection]) -> Iterator[str]:
    """Yield what contradicts the force: its unit, its direction, or the states of some observations."""
    works = np.array([each.work for each in deflections])
    usual = float(np.median(np.abs(works)))
    against = [each.name for each in deflections if each.work < -_AGAINST * usual]
    compliance = float(np.median([each.compliance for each in deflections]))
    share = float(np.mean(works > 0.0))
    if share < 1.0 - _LEAST_ALONG:
        yield "the targets move against the force: the states are exchanged, or the force is reversed"
    elif against:
        names = ", ".join(against[:_SHOWN])
        yield (
            f"{len(against)} of {len(deflections)} deflections go against their force ({names}): their "
            "states are exchanged, or their forces are wrong"
        )
    elif share < _LEAST_ALONG:
        yield "the targets do not yield to the force: look at the states and the direction of the force"
    if not _YIELDS[0] < compliance < _YIELDS[1]:
        yield f"targets yield {1e3 * compliance:.1g} mm per newton: look at the unit of the force"
