"""Load point of a set that a reading of a target at the hook shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointstiff.schemas.measurement import (
    MeasurementSetHeader,
    Noise,
)
from jointstiff.service.conversion.readings import NamedObservationError, ReadingArrays
from jointstiff.service.conversion.robots import joint_factors
from jointstiff.service.conversion.units import LENGTH
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.mechanics.hook import HookReading, HookShot, locate_hook
from jointstiff.solver.mechanics.measurements import (
    ASSUMED_LOAD_POINT,
    LEAST_OF_GROUND,
)
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import length_text

LARGEST_HOOK_SCATTER = 3.0 * LEAST_OF_GROUND["tracker"]
"""Largest distance [m] between two readings of the hook, and of a target from its mean place on the flange:
three standard uncertainties."""
LARGEST_HOOK_SHIFT = 0.02
"""Largest distance [m] by which the kinematics place targets wrong where the hook is read: a greater one is a
wrong reading, or wrong joint angles."""


@dataclass(frozen=True, eq=False)
class LocatedLoadPoint:
    """Load point from readings of a target at the hook, with the set that remains without these readings."""

    target: str  # name of the target at the hook
    place: FloatArray  # (3,) load point that the readings show, flange frame [m]
    lever: float  # distance of the hook from the targets that give its place, or from R0 [m]
    error: float  # greatest of the errors [m] that the readings show: scatter of the hook, misfit of targets
    least: float  # least standard uncertainty of each coordinate [m], by what the place rests on
    stated: FloatArray | None  # (3,) load point that was stated, flange frame [m]; None if not stated
    stated_uncertainty: float  # standard uncertainty of each coordinate of `stated` [m]
    header: MeasurementSetHeader  # header of the set, with this load point
    other_readings: ReadingArrays  # readings of the other targets
    rows: IndexArray  # (K,) indices of the observations in the set with such readings

    def to_hook_reading(self, sigma: float, repeatability: float) -> HookReading:
        """Return the reading with its uncertainty: what its errors add up to, and at least `least`.

        Args:
            sigma: standard uncertainty of a coordinate of a reading [m].
            repeatability: standard deviation of a joint's angle from posture to posture [rad].
        """
        by_reading = float(np.hypot(sigma, repeatability * self.lever))
        uncertainty = max(float(np.hypot(by_reading, self.error)), self.least)
        return HookReading(self.target, self.place, uncertainty, self.stated, self.stated_uncertainty)


@dataclass(frozen=True, eq=False)
class _HookPositions:
    """Positions in R0 [m] that N observations read without load: of the hook, and of the T other targets."""

    hook: FloatArray  # (N, 3) position of the target at the hook
    is_shot: BoolArray  # (N,) whether the target at the hook was read
    targets: FloatArray  # (N, T, 3) positions of the other targets
    was_read: BoolArray  # (N, T) whether these were read

    @classmethod
    def from_readings(cls, name: str, readings: ReadingArrays, length: float) -> _HookPositions:
        """Select the positions that were read without load.

        Args:
            name: name of the target at the hook.
            readings: readings of the set in R0.
            length: the set's unit of length in m.

        Raises:
            MeasurementError: the target at the hook was not read without load.
        """
        is_hook = readings.targets == name
        was_placed = readings.present & ~readings.as_deflection
        _refuse_unread_hook(name, readings, was_placed & is_hook)
        return cls(
            hook=length * readings.unloaded[:, int(np.argmax(is_hook))],
            is_shot=(was_placed & is_hook).any(axis=1),
            targets=length * readings.unloaded[:, ~is_hook],
            was_read=was_placed[:, ~is_hook],
        )

    def compute_lever(self) -> float:
        """Return the distance [m] of the hook from the mean of the other targets, in the first shot.

        Without other targets it is the distance from the origin of R0.
        """
        first = int(np.argmax(self.is_shot))
        others = self.targets[first, self.was_read[first]]
        origin = others.mean(axis=0) if len(others) else np.zeros(3)
        return float(np.linalg.norm(self.hook[first] - origin))


def locate_load_point(
    header: MeasurementSetHeader, name: str, readings: ReadingArrays, robot: Robot
) -> LocatedLoadPoint:
    """Locate the load point by the readings of a target at the hook.

    Args:
        header: header of a set in R0.
        name: name of the target at the hook.
        readings: readings of the set in R0.
        robot: robot that was measured.

    Raises:
        MeasurementError: the target was not read without load, its readings disagree, the other targets of
            its posture are not where they are in the other postures, no other reading remains, or
            observations state different load points.
    """
    length = LENGTH[header.units.length]
    stated = _find_single_load_point(header, readings)
    positions = _HookPositions.from_readings(name, readings, length)
    joints = joint_factors(robot, header.units) * readings.joints
    postures = Postures(robot, robot.joint_map.model_angles(joints))
    is_shot = positions.is_shot
    shots = locate_hook(postures, positions.targets, positions.was_read, positions.hook, is_shot)
    _refuse_moved_targets(name, readings, is_shot, shots)
    places = np.array([shot.place for shot in shots])
    _refuse_disagreeing_shots(name, readings, is_shot, places)
    rows = _find_kept_observations(name, readings, is_shot)
    place = places.mean(axis=0)
    x, y, z = (place / length).tolist()
    return LocatedLoadPoint(
        target=name,
        place=place,
        lever=positions.compute_lever(),
        error=_find_greatest_error(places, shots),
        least=_find_least_uncertainty(shots),
        stated=None if stated is None else length * stated,
        stated_uncertainty=_find_stated_uncertainty(header.noise, length),
        header=header.model_copy(update={"load_point": (x, y, z)}),
        other_readings=_omit_hook(name, readings, rows),
        rows=rows,
    )


def _find_greatest_error(places: FloatArray, shots: Sequence[HookShot]) -> float:
    """Return the greatest error [m] of S readings of the hook: half their scatter, or a misfit of targets.

    Args:
        places: (S, 3) places of the hook by each reading, flange frame [m].
        shots: the readings; `misfit` is the distance of another target from its mean place on the flange [m].
    """
    half_scatter = float(_find_distances(places).max()) / 2.0
    return max(half_scatter, max(shot.misfit for shot in shots))


def _find_least_uncertainty(shots: Sequence[HookShot]) -> float:
    """Return the least uncertainty [m] of the hook's place: of a tracker, if each reading rests on targets.

    A reading without other targets rests on the kinematics of the robot, known as well as from a drawing.
    """
    rest_on_targets = all(shot.targets for shot in shots)
    return LEAST_OF_GROUND["tracker" if rest_on_targets else "drawing"]


def _find_kept_observations(name: str, readings: ReadingArrays, is_shot: BoolArray) -> IndexArray:
    """Return the indices (K,) of the observations that remain without the readings of the hook.

    An observation that has only positions without load belongs to the reading of the hook, and is omitted: it
    is no observation under load.

    Args:
        name: name of the target at the hook.
        readings: readings of N observations.
        is_shot: (N,) mask of the observations with a reading of this target.

    Raises:
        MeasurementError: no observation remains.
    """
    encoders_were_read = np.zeros(len(readings.labels), dtype=np.bool_)
    if readings.encoders is not None:
        encoders_were_read |= readings.encoders.present.any(axis=1)
    of_others = readings.present & (readings.targets != name)
    is_loaded = (of_others & ~readings.unloaded_only).any(axis=1) | encoders_were_read
    is_kept = of_others.any(axis=1) | encoders_were_read
    if is_loaded.any():
        is_kept &= is_loaded | ~is_shot
    if not is_kept.any():
        raise MeasurementError(
            f"target '{name}' gives only the load point, but no other target has a reading",
            where="load_point_target",
            remedy="omit `load_point_target` and give `load_point`, or add the readings of the other targets",
        )
    return np.flatnonzero(is_kept)


def _omit_hook(name: str, readings: ReadingArrays, rows: IndexArray) -> ReadingArrays:
    """Return the readings of the other targets in the observations `rows`, without stated load points.

    The set's load point, which the target `name` at the hook shows, then holds for all observations.
    """
    others = readings.select(rows, np.flatnonzero(readings.targets != name))
    return replace(others, load_point_given=np.zeros_like(others.load_point_given))


def _find_stated_uncertainty(noise: Noise | None, length: float) -> float:
    """Return the uncertainty of a coordinate of the load point [m] as stated, else by its ground."""
    if noise is not None and noise.load_point is not None:
        return length * noise.load_point
    ground = None if noise is None or noise.grounds is None else noise.grounds.load_point
    return ASSUMED_LOAD_POINT if ground is None else LEAST_OF_GROUND[ground]


def _find_single_load_point(header: MeasurementSetHeader, readings: ReadingArrays) -> FloatArray | None:
    """Return the load point (3,) that the set and all observations state; None if nothing states it.

    Raises:
        MeasurementError: observations state different load points, although a reading shows one.
    """
    points: list[FloatArray] = [readings.load_point[i] for i in np.flatnonzero(readings.load_point_given)]
    is_default_used = not readings.load_point_given.all()
    if header.load_point is not None and is_default_used:
        points.insert(0, np.array(header.load_point, dtype=np.float64))
    if not points:
        return None
    if any(not np.array_equal(point, points[0]) for point in points):
        raise MeasurementError(
            "the observations state different load points, but the reading of target "
            f"'{header.load_point_target}' shows a single load point",
            where="load_point_target",
            remedy="omit `load_point_target`, or omit `load_point` in every observation",
        )
    first: FloatArray = points[0]
    return first


def _refuse_unread_hook(name: str, readings: ReadingArrays, was_placed: BoolArray) -> None:
    """Refuse a set whose target at the hook has no position without load.

    Args:
        name: name of the target at the hook.
        readings: readings of N observations of T targets.
        was_placed: (N, T) mask of the positions of this target without load.
    """
    if was_placed.any():
        return
    is_read = name in readings.targets
    reason = f"no observation has a reading of target '{name}'"
    if is_read:
        reason = f"target '{name}' was read only as a deflection, which shows no position"
    raise MeasurementError(
        f"{reason}, so the load point is unknown",
        where="load_point_target",
        remedy=f"read target '{name}' on the hook once without load (`unloaded`), in any observation; or "
        "omit `load_point_target`, and give `load_point`",
    )


def _find_distances(places: FloatArray) -> FloatArray:
    """Return the distances (S, S) [m] between places (S, 3)."""
    between = places[:, None] - places
    return np.asarray(np.linalg.norm(between, axis=2))


def _refuse_moved_targets(
    name: str, readings: ReadingArrays, is_shot: BoolArray, shots: Sequence[HookShot]
) -> None:
    """Refuse a reading of the hook whose posture has the other targets in other places on the flange.

    The hook's place rests on these targets: a wrong reading of one of them moves the load point.

    Args:
        name: name of the target at the hook.
        readings: readings of N observations.
        is_shot: (N,) mask of the S observations with a reading of this target.
        shots: S readings of this target.
    """
    for row, shot in zip(np.flatnonzero(is_shot).tolist(), shots, strict=True):
        is_plausible = shot.misfit <= LARGEST_HOOK_SCATTER and shot.shift <= LARGEST_HOOK_SHIFT
        if is_plausible:
            continue
        distance, plausible = shot.misfit, LARGEST_HOOK_SCATTER
        if shot.misfit <= LARGEST_HOOK_SCATTER:
            distance, plausible = shot.shift, LARGEST_HOOK_SHIFT
        raise NamedObservationError(
            f"observation '{readings.labels[row]}' reads target '{name}' on the hook, but in this "
            f"observation another target is {length_text(distance)} from its place on the flange in the "
            f"other observations ({length_text(plausible)} is plausible), so the load point is wrong",
            where=f"observations[{row}].readings",
            remedy="correct or omit the wrong reading, or check the joint angles of this observation",
        )


def _refuse_disagreeing_shots(
    name: str, readings: ReadingArrays, is_shot: BoolArray, places: FloatArray
) -> None:
    """Refuse readings of a target at the hook that show different load points.

    Args:
        name: name of the target at the hook.
        readings: readings of N observations.
        is_shot: (N,) mask of the S observations with a reading of this target.
        places: (S, 3) load points that these readings show, flange frame [m].
    """
    distances = _find_distances(places)
    if distances.max() <= LARGEST_HOOK_SCATTER:
        return
    farthest = int(np.argmax(np.median(distances, axis=1)))
    row = int(np.flatnonzero(is_shot)[farthest])
    raise NamedObservationError(
        f"the {len(places)} readings of target '{name}' show different load points: the load point by "
        f"observation '{readings.labels[row]}' is {length_text(float(distances[farthest].max()))} from the "
        f"load point by another observation ({length_text(LARGEST_HOOK_SCATTER)} is plausible)",
        where=f"observations[{row}].readings",
        remedy="omit the wrong reading, or check the joint angles of its observation; the hook must not move "
        "on the flange",
    )
