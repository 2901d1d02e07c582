"""A wrong length of the robot's model, such as a typing error in a DH table.

A joint is mounted on the joint before it at a fixed place. If this place is wrong by s along an axis d, every
target seems to move on the flange by ``s R_Fᵀ R_j d`` with the rotations of flange and joint. The error s
follows from the positions by linear least squares (method.md §17).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.integrity.mistakes import (
    EXPLAINED,
    LARGEST_MODEL_ERROR,
    compute_median_places,
    find_consensus_places,
    greatest_distances,
    sample_rows,
    search_zero,
)
from jointstiff.solver.integrity.values import View, median, transform_to_flange
from jointstiff.solver.meaning.decision import USUAL_RESIDUAL
from jointstiff.solver.text import PAST_DO_NOT_USE, length_text

_LEAST_ROWS: Final = 6
"""Least number of rows that can show a wrong length: there are many lengths."""
_LEAST_SPREAD: Final = 0.1
"""Least root mean square of the direction's change on the flange that shows an error along it."""
_CLEARLY: Final = 0.1
"""Fraction of the rows that a corrected length must explain in addition to those that fit as posted."""
_ROUNDS: Final = 4
"""Rounds of the fit; after each, rows that are far from their places are left out."""
_MICROMETRES: Final = 6
"""Decimals to which median distances [m] are rounded before two lengths are compared."""
_LEAST_LENGTH: Final = 1e-4
"""Least length [m] of the model that is no zero."""
_PARALLEL: Final = 1e-9
"""Difference of a cosine from 1 up to which two axes are parallel."""


@dataclass(frozen=True, eq=False)
class _Length:
    """Length of the model from one joint to the next, with the length that fits the positions."""

    before: str  #: name of the joint in whose frame the length is
    after: str  #: name of the joint that follows
    axis: str  #: axis of the length, in words
    given: float  #: length of the model [m]
    fitting: float  #: length with which the targets keep their places [m]
    distances: FloatArray  #: (M,) greatest distance of a target from its place in each row [m]

    @property
    def explained(self) -> int:
        """Return the number of rows whose targets are at their places."""
        return int((self.distances <= LARGEST_MODEL_ERROR).sum())

    @property
    def rank(self) -> tuple[int, float, bool]:
        """Number of explained rows, minus the median distance [m], and whether the model has this length.

        Parallel axes have the same lengths along them: a length that is not zero is rather mistyped.
        """
        is_in_model = abs(self.given) > _LEAST_LENGTH
        return self.explained, -round(median(self.distances), _MICROMETRES), is_in_model


def find_wrong_length(view: View, rows: IndexArray) -> Finding | None:
    """Return the finding that one length of the model is wrong; None unless one length explains the rows.

    The zero of a joint that explains the rows better excludes a wrong length.

    The first joint's place and the flange's are not searched: with another first place, the positions are in
    another frame, and with another flange, the targets are at other places.

    Args:
        view: measurement set whose targets do not keep their places on the flange.
        rows: (M,) indices of the rows with positions.
    """
    if len(rows) < _LEAST_ROWS or view.robot.n < 2:
        return None
    sample = sample_rows(rows)
    seen = transform_to_flange(view.postures, view.measurements.position, view.measured)[sample]
    posted = greatest_distances(seen, find_consensus_places(seen))
    agreeing = int((posted <= LARGEST_MODEL_ERROR).sum())
    best = max(_fit_lengths(view, sample, seen), key=lambda length: length.rank, default=None)
    if best is None:
        return None
    explains_most = best.explained >= max(EXPLAINED * len(sample), agreeing + _CLEARLY * len(sample))
    is_plausible = median(best.distances) <= USUAL_RESIDUAL
    if not (explains_most and is_plausible):
        return None
    with_other_zero, _, _ = search_zero(view, rows)
    if with_other_zero < median(best.distances):
        return None
    kept = best.distances[best.distances <= LARGEST_MODEL_ERROR]
    place = f"from {best.before} to {best.after}, along {best.axis}"
    return view.build_finding(
        "lengths_differ",
        f"a length of the robot's model seems to be wrong: {place}, the model has {_figure(best.given)}; "
        f"with {_figure(best.fitting)}, the targets keep their positions on the flange (up to "
        f"{length_text(LARGEST_MODEL_ERROR)} is plausible) in {best.explained} of {len(sample)} "
        f"observations, within {length_text(float(kept.max()))}; as given, in only {agreeing}",
        f"compare this length of the robot's description (`a` or `d` of a DH table, `origin` of "
        f"{best.after} in a URDF) with the drawing, and correct it; {PAST_DO_NOT_USE}",
        "do_not_use",
    )


def _fit_lengths(view: View, sample: IndexArray, seen: FloatArray) -> Iterator[_Length]:
    """Yield each length from one joint to the next that the postures show, as it fits the positions.

    Args:
        view: measurement set.
        sample: (M,) indices of its rows.
        seen: (M, T, 3) targets in the flange frame by the model [m]; NaN where not measured.
    """
    robot = view.robot
    joint_rotation, _ = view.postures.joint_frames
    to_flange = view.postures.flange_rotation[sample].transpose(0, 2, 1)
    for joint in range(1, robot.n):
        placement = robot.model.jointPlacements[joint + 1]
        before, after = robot.joint_names[joint - 1], robot.joint_names[joint]
        own_axis = placement.rotation @ robot.axes[joint]
        directions = [(f"the axis of {after}", own_axis)]
        for name, axis in zip("xyz", np.eye(3), strict=True):
            if abs(axis @ own_axis) < 1.0 - _PARALLEL:
                directions.append((f"{name} of the frame of {before}", axis))
        for words, direction in directions:
            motion = (to_flange @ joint_rotation[sample, joint - 1]) @ direction
            if np.sqrt(motion.var(axis=0).sum()) < _LEAST_SPREAD:
                continue
            error, distances = _fit_error(seen, motion)
            given = float(placement.translation @ direction)
            yield _Length(before, after, words, given, given + error, distances)


def _fit_error(seen: FloatArray, motion: FloatArray) -> tuple[float, FloatArray]:
    """Fit the error of a length, and return it with the distances of the targets after the correction.

    Args:
        seen: (M, T, 3) targets in the flange frame by the model [m]; NaN where not measured.
        motion: (M, 3) motion of the targets in the flange frame by an error of 1 m of the length.

    Returns:
        What must be added to the length [m], and (M,) the greatest distance of a target in each row [m].
    """
    kept = np.ones(len(seen), dtype=np.bool_)
    error, distances = 0.0, np.zeros(len(seen))
    for _ in range(_ROUNDS):
        used, column = seen[kept], np.where(np.isnan(seen[kept]), np.nan, motion[kept, None])
        count = np.maximum((~np.isnan(used)).sum(axis=0), 1)
        used = used - np.nansum(used, axis=0) / count
        column = column - np.nansum(column, axis=0) / count
        error = float(np.nansum(used * column) / max(np.nansum(column * column), 1e-12))
        corrected = seen - error * motion[:, None]
        distances = greatest_distances(corrected, compute_median_places(corrected[kept]))
        kept = distances <= max(np.quantile(distances, EXPLAINED), LARGEST_MODEL_ERROR)
    return error, distances


def _figure(length: float) -> str:
    """Format a length of a robot's description [m] in millimetres, as drawings state it."""
    return f"{round(1e3 * length, 1):g} mm"
