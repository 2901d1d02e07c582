"""Decision between the readings of a table: which one fits, and by which margin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.meaning.search import Reading

LARGEST_RESIDUAL: Final = 5e-3
"""Largest median distance [m] of positions from their places by a nominal model."""
_LARGEST_PART: Final = 0.03
"""Largest median distance relative to the movement of the targets."""
_LEAST_SHARE: Final = 0.7
"""Least fraction of the positions that fit."""
_LARGEST_SCALE_ERROR: Final = 6e-3
_LEAST_FREEDOM: Final = 9
_COMPUTED: Final = 1.5e-4
"""Median distance [m] below which a controller has computed the positions: a nominal model is no better."""
_CLEARLY_WORSE: Final = 4.0
"""Ratio of the distances of a position by two readings from which the position is a vote."""
_LEAST_VOTES: Final = 3
_VOTES_AGAINST: Final = 5
_TWIN: Final = 0.02
"""Relative difference of residuals up to which a mirrored reading fits as well."""
_FAR_OFF: Final = 0.05
"""Median distance relative to the movement from which a reading is no alternative."""
_SAME_EFFECT: Final = 1e-4
_MIRROR: Final = np.array([-1.0, 1.0, 1.0, -1.0, 1.0, -1.0])
"""Signs of joints with which an arm of six joints in a plane is its mirror image."""


@dataclass(frozen=True, eq=False)
class Decision:
    """Reading that fits with a margin, or the reason why none does."""

    best: Reading | None  #: None without a margin
    next: Reading | None  #: the best reading that contradicts the best
    equals: tuple[Reading, ...]  #: other words for the best reading
    reason: str  #: why there is no reading; empty with one
    shifted: tuple[Reading, ...] = ()  #: fitting readings of the same joints that use other columns


def decide(readings: Sequence[Reading]) -> Decision:
    """Choose the reading that fits and that no other reading contradicts.

    Args:
        readings: by residual, the smallest first.
    """
    right_handed = [reading for reading in readings if not reading.fit.frame.is_mirrored]
    if not right_handed:
        if readings:
            return Decision(None, readings[0], (), "the positions fit only in a left-handed frame")
        return Decision(None, None, (), "no columns fit the robot")
    fitting = [reading for reading in right_handed if fits(reading)]
    # Columns that one robot computes are no readings of another robot of the same class either.
    computed = {_name_points(reading) for reading in fitting if is_computed(reading)}
    measured = [reading for reading in fitting if _name_points(reading) not in computed]
    if not fitting:
        first = right_handed[0]
        return Decision(None, first, (), f"no columns fit the robot (best {_in_mm(first)})")
    if not measured:
        reason = "the positions were computed from the joints, so that they are no readings"
        return Decision(None, fitting[0], (), reason)
    best = _choose_words(measured)
    equals = tuple(each for each in right_handed if each is not best and _have_same_effect(each, best))
    shifted = tuple(each for each in measured if _is_shifted(each, (best, *equals)))
    others = [each for each in right_handed if each not in equals and each not in shifted]
    rival, votes = _find_rival(best, others, fitting, equals)
    reason = _find_obstacle(best, votes)
    if reason:
        return Decision(None, rival or best, equals, reason)
    return Decision(best, rival, equals, "", shifted)


def fits(reading: Reading) -> bool:
    """Return whether most positions are near their places by the robot."""
    typical = reading.fit.typical
    return typical < LARGEST_RESIDUAL and measure_share(reading) >= _LEAST_SHARE


def measure_share(reading: Reading) -> float:
    """Return the fraction of the positions that are near their places."""
    limit = min(2.0 * LARGEST_RESIDUAL, max(5.0 * reading.fit.typical, 2e-3))
    distances = reading.fit.distances
    return float(np.mean(distances[np.isfinite(distances)] < limit))


def is_computed(reading: Reading) -> bool:
    """Return whether positions are nearer to a nominal model than the positions of any real arm."""
    return reading.fit.typical < _COMPUTED


def _name_points(reading: Reading) -> tuple[str, tuple[int, int, int]]:
    """Return table and columns of the positions of a reading."""
    return reading.points.table, reading.points.columns


def _in_mm(reading: Reading) -> str:
    """Return the median distance of a reading in words."""
    return f"{reading.fit.typical * 1e3:.3g} mm"


def _choose_words(measured: Sequence[Reading]) -> Reading:
    """Return the reading with the smallest residual, in the simplest words.

    Rows that are grouped by posture say more than single rows. The maker's own counting is simplest.
    """
    best = measured[0]
    alike = [each for each in measured if each is best or _have_same_effect(each, best)]
    grouped = [each for each in measured if _have_same_columns(each, best)]
    most = max(grouped, key=lambda each: each.joints.groups.count)
    if most.joints.groups.count > best.joints.groups.count:
        best = most
        alike = [each for each in measured if each is best or _have_same_effect(each, best)]
    own = [each for each in alike if each.joints.counting.is_own]
    return own[0] if own else best


def _have_same_words(first: Reading, second: Reading) -> bool:
    """Return whether two readings have the same robot, columns of joints, unit and counting."""
    return (
        first.known is second.known
        and first.joints.table == second.joints.table
        and first.joints.columns == second.joints.columns
        and first.joints.unit == second.joints.unit
        and first.joints.counting.name == second.joints.counting.name
    )


def _have_same_columns(first: Reading, second: Reading) -> bool:
    """Return whether two readings differ at most in the groups of the rows."""
    same_points = first.points.table == second.points.table and first.points.columns == second.points.columns
    return same_points and _have_same_words(first, second)


def _have_same_effect(first: Reading, second: Reading) -> bool:
    """Return whether two readings of the same columns have the same residual to the last digits."""
    difference = abs(first.fit.residual - second.fit.residual)
    return (
        first.joints.table == second.joints.table
        and first.joints.columns == second.joints.columns
        and first.joints.unit == second.joints.unit
        and first.joints.groups == second.joints.groups
        and first.points == second.points
        and difference < 1e-6 + _SAME_EFFECT * second.fit.residual
    )


def _find_rival(
    best: Reading, right_handed: Sequence[Reading], fitting: Sequence[Reading], equals: Sequence[Reading]
) -> tuple[Reading | None, tuple[int, int]]:
    """Return the reading that contradicts the best one most, with the votes for and against the best."""
    tied = (best, *equals)
    rival: Reading | None = None
    least = (10**6, 0)
    for other in right_handed:
        if other in tied or is_computed(other) or other.fit.typical > _FAR_OFF * other.movement:
            continue
        if any(_agree(each, other, is_fitting=other in fitting) for each in tied):
            continue
        votes = count_votes(best, other)
        if votes[0] - _VOTES_AGAINST * votes[1] < least[0] - _VOTES_AGAINST * least[1]:
            rival, least = other, votes
    return rival, least


def _agree(best: Reading, other: Reading, *, is_fitting: bool) -> bool:
    """Return whether two readings with the same joints can be true together."""
    if not _have_same_words(best, other):
        return False
    is_regrouped = is_fitting and _have_same_columns(best, other)
    return is_regrouped or not best.points.overlaps(other.points)


def _is_shifted(other: Reading, tied: Sequence[Reading]) -> bool:
    """Return whether a reading has the joints of the best one, or of its mirror image, and other positions.

    The loaded position is so near to the unloaded one that y and z of the first, and x of the second, are a
    position in a frame with exchanged axes. Such a reading explains fewer columns.
    """
    best = tied[0]
    if other.points == best.points or other.joints.groups != best.joints.groups:
        return False
    return any(_have_same_words(other, each) or _have_mirrored_words(other, each) for each in tied)


def _have_mirrored_words(first: Reading, second: Reading) -> bool:
    """Return whether two readings of the same joints differ in the signs that mirror an arm: J1, J4, J6."""
    if first.known is not second.known or first.known.robot.n != len(_MIRROR):
        return False
    same_columns = first.joints.columns == second.joints.columns and first.joints.unit == second.joints.unit
    mirrored = second.joints.counting.matrix * _MIRROR
    return same_columns and bool(np.allclose(first.joints.counting.matrix, mirrored))


def count_votes(first: Reading, second: Reading) -> tuple[int, int]:
    """Count the postures that clearly speak for the first, and for the second reading (method.md §17)."""
    if first.fit.distances.shape[0] != second.fit.distances.shape[0]:
        is_clear = second.fit.residual > _CLEARLY_WORSE * max(first.fit.residual, 5e-5)
        return (99, 0) if is_clear else (0, 0)
    by_first = np.nanmax(np.nan_to_num(first.fit.distances, nan=-1.0), axis=1)
    by_second = np.nanmax(np.nan_to_num(second.fit.distances, nan=-1.0), axis=1)
    limit = max(LARGEST_RESIDUAL, 3.0 * first.fit.typical)
    known = (by_first >= 0.0) & (by_second >= 0.0)
    for_first = (by_first < limit) & (by_second > _CLEARLY_WORSE * np.maximum(by_first, first.fit.typical))
    for_second = (by_second < limit) & (by_first > _CLEARLY_WORSE * np.maximum(by_second, second.fit.typical))
    return int((for_first & known).sum()), int((for_second & known).sum())


def _find_obstacle(best: Reading, votes: tuple[int, int]) -> str:
    """Return why the best reading is not certain enough; empty if it is."""
    if best.fit.degrees_of_freedom < _LEAST_FREEDOM:
        freedom = best.fit.degrees_of_freedom
        return f"too few positions: {freedom} degrees of freedom, {_LEAST_FREEDOM} are needed"
    if best.fit.typical > _LARGEST_PART * best.movement:
        return f"the targets move by {best.movement * 1e3:.0f} mm only"
    if abs(best.fit.free_scale - 1.0) > _LARGEST_SCALE_ERROR:
        return f"the lengths of the robot differ by the factor {best.fit.free_scale:.4f}"
    if votes[0] < _LEAST_VOTES + _VOTES_AGAINST * votes[1]:
        return "two readings of the columns fit"
    return ""


def find_doubt(best: Reading, readings: Sequence[Reading]) -> str:
    """Return the question between a counting of another maker and a mirrored frame; empty without one."""
    if best.joints.counting.is_own:
        return ""
    for other in readings:
        is_twin = abs(other.fit.residual - best.fit.residual) < _TWIN * best.fit.residual
        same_joints = other.joints.columns == best.joints.columns
        if other.fit.frame.is_mirrored and other.joints.counting.is_own and same_joints and is_twin:
            return f"two of x, y and z may be exchanged instead of joints {best.joints.counting.name}"
    return ""
