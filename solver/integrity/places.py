"""Do targets keep their places on the flange? The score of mistakes of units, angles, rows and names.

Targets are fixed to the flange, and a load moves them by millimetres: in all observations and in both states,
each has one place in the flange frame, within millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.integrity.values import median
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot

LARGEST_MODEL_ERROR: Final = 0.02
"""Greatest plausible distance of a target from its place [m]: more means a wrong frame, joint map, unit or
angle."""
EXPLAINED: Final = 0.8
"""Fraction of the rows that a mistake of the whole set must explain; others may have their own mistakes."""
_ANCHORS: Final = 24
"""Number of rows whose targets are tried as the usual places."""


@dataclass(frozen=True, eq=False)
class Places:
    """Places of T targets on the flange, and how far they are from them in M rows, in either state."""

    flange: FloatArray  # (T, 3) [m]
    distances: FloatArray  # (M,) greatest distance of a target in either state [m]; 0 if none was read
    unexplained: float  # distance within which targets are in most rows [m]

    @classmethod
    def of(
        cls, robot: Robot, given: Measurements, *, lost: int = 0, postures: Postures | None = None
    ) -> Places:
        """Find the places on which most readings agree; `lost` rows have no reading that belongs to them."""
        seen, moves = see_from_flange(
            postures or Postures(robot, robot.joint_map.model_angles(given.joints)), given
        )
        return cls.agreeing(seen, moves=moves, lost=lost)

    @classmethod
    def agreeing(
        cls, seen: FloatArray, *, other: FloatArray | None = None, moves: bool = True, lost: int = 0
    ) -> Places:
        """Find the places of targets seen from the flange (M, 2, T, 3), or seen so after a change of rows."""
        flange = find_consensus_places(seen if other is None else np.concatenate([seen, other]))
        distances = greatest_distances(seen, flange)
        if other is not None:
            distances = np.minimum(distances, greatest_distances(other, flange))
        was_read = np.isfinite(seen).any(axis=(1, 2, 3))
        of_rows = np.sort(np.append(distances[was_read], np.full(lost, np.inf)))
        needed = int(np.ceil(EXPLAINED * len(of_rows))) - 1
        return cls(flange, distances, float(of_rows[needed]) if moves and len(of_rows) else np.inf)

    @property
    def near(self) -> BoolArray:
        """Mask (M,) of the rows whose targets are at their places."""
        return np.asarray(self.distances <= LARGEST_MODEL_ERROR)

    @property
    def typical(self) -> float:
        """Median distance [m]."""
        return median(self.distances)


def see_from_flange(postures: Postures, given: Measurements) -> tuple[FloatArray, bool]:
    """Return targets in both states in the flange frame (M, 2, T, 3) [m], and whether they move in R0.

    Targets that hardly move keep their places with an arm that hardly moves: they explain nothing. A target
    that was read only once has no usual place.
    """
    unloaded = given.present & ~given.in_flange
    unloaded = unloaded & (unloaded.sum(axis=0) > 1)
    loaded = unloaded if given.unloaded_only is None else unloaded & ~given.unloaded_only
    loaded = np.zeros_like(loaded) if given.direction is not None else loaded
    read = np.stack([unloaded, loaded], axis=1)
    positions = np.stack([given.position, given.position + given.deflection], axis=1)
    count, states, targets, _ = positions.shape
    seen = postures.to_flange(positions.reshape(count, states * targets, 3)).reshape(positions.shape)
    moves = bool(unloaded.any() and given.position[unloaded].std(axis=0).max() > LARGEST_MODEL_ERROR)
    return np.where(read[..., None], seen, np.nan), moves


def change_positions(
    given: Measurements,
    unloaded: FloatArray | None = None,
    loaded: FloatArray | None = None,
    rows: IndexArray | None = None,
    joints: FloatArray | None = None,
) -> Measurements:
    """Return measurements with other positions (N, T, 3) in R0 [m] or joints, for some rows (M,)."""
    first = given.position if unloaded is None else unloaded
    second = given.position + given.deflection if loaded is None else loaded
    kept = given if rows is None else given[rows]
    if first is not given.position or loaded is not None:
        read = kept.present[..., None]
        kept = replace(
            kept, position=np.where(read, first, 0.0), deflection=np.where(read, second - first, 0.0)
        )
    return kept if joints is None else replace(kept, joints=joints)


def greatest_distances(seen: FloatArray, places: FloatArray) -> FloatArray:
    """Return for each row (M,) the greatest distance [m] of a target (M, ..., T, 3) from its place (T, 3)."""
    distances = np.nan_to_num(np.linalg.norm(seen - places, axis=-1))
    return np.asarray(distances.max(axis=tuple(range(1, distances.ndim))))


def find_consensus_places(seen: FloatArray) -> FloatArray:
    """Return the place (T, 3) of each target on which most readings (M, ..., T, 3) agree [m].

    The readings of some rows, the anchors, are tried as places. The median of the readings near the best
    anchor is returned, as a median of all would lie between two places if half of the rows are wrong.
    """
    seen = seen.reshape(-1, *seen.shape[-2:])
    anchors = seen[np.unique(np.linspace(0, len(seen) - 1, _ANCHORS).round().astype(int))]
    near = ((seen - anchors[:, None]) ** 2).sum(axis=-1) <= (2.0 * LARGEST_MODEL_ERROR) ** 2  # (A, M, T)
    best = near.sum(axis=1).argmax(axis=0)  # (T,) anchors
    return compute_median_places(np.where(near[best, :, np.arange(len(best))].T[..., None], seen, np.nan))


def compute_median_places(seen: FloatArray) -> FloatArray:
    """Return the median place (T, 3) of each target over its readings (M, T, 3); NaN without one."""
    # Sorting puts NaN last, so the middle of the first `count` values is the median of those measured.
    ordered = np.sort(seen, axis=0)
    count = np.maximum((~np.isnan(seen)).sum(axis=0), 1)
    two_middle_values = np.take_along_axis(ordered, np.stack([(count - 1) // 2, count // 2]), axis=0)
    return np.asarray(0.5 * two_middle_values.sum(axis=0))
