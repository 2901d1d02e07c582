"""Decision between the interpretations of a table: which one fits, and by which margin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.meaning.search import NEAR_MODEL, Interpretation
from jointstiff.solver.meaning.table import PointColumns

USUAL_RESIDUAL: Final = 2e-3
"""Median distance [m] up to which arms usually fit their nominal models."""
LARGEST_RESIDUAL: Final = 5e-3
"""Largest median distance [m] of positions from their places by a nominal model."""
LARGEST_PART: Final = 0.03
"""Largest median distance relative to the movement of the targets."""
LEAST_SHARE: Final = 0.7
"""Least fraction of the positions that fit."""
LARGEST_SCALE_ERROR: Final = 6e-3
"""Relative difference of all lengths up to which an arm may differ from its model."""
LARGEST_LENGTH_ERROR: Final = 2.5e-3
"""Difference of the targets' movements [m] up to which errors of the links explain a factor on all lengths:
four times what errors of 0.7 mm and 0.5 mrad of each link give, whatever the size of the arm."""
LEAST_FREEDOM: Final = 9
"""Least number of degrees of freedom of a fit that decides."""
_LEAST_BY_ROUNDING: Final = 0.9
"""Least fraction of computed positions that are as near to the model as rounded joints allow."""
_ROUNDINGS: Final = 3.0
"""Ratio of distances up to which rounding of the written numbers explains the other distance."""
_LEAST_PART: Final = 1.0 / 6.0
"""Least part of the joints' rounding by which positions differ: most postures reach less far."""
_EXACT: Final = 5e-6
"""Median distance [m] below which positions were computed, whatever the rounding: no reading is as good."""
_CLEARLY_WORSE: Final = 4.0
"""Ratio of the distances of a position by two interpretations from which the position is a vote."""
_LEAST_VOTES: Final = 3
_VOTES_AGAINST: Final = 5
_TWIN: Final = 0.02
"""Relative difference of residuals up to which a mirrored interpretation fits as well."""
_FAR_OFF: Final = 0.05
"""Median distance relative to the movement from which an interpretation is no alternative."""
_SAME_EFFECT: Final = 1e-4
MIRRORED_SIGNS: Final = np.array([-1.0, 1.0, 1.0, -1.0, 1.0, -1.0])
"""Signs of joints with which an arm of six joints in a plane is its mirror image."""


@dataclass(frozen=True, eq=False)
class Decision:
    """Interpretation that fits with a margin, or the reason why none does."""

    best: Interpretation | None  #: None without a margin
    next: Interpretation | None  #: the best interpretation that contradicts the best
    equals: tuple[Interpretation, ...]  #: interpretations with the same effect as the best one
    reason: str  #: why there is no interpretation; empty with one
    #: fitting interpretations with the same joints, whose x, y and z belong to two states of a target
    shifted: tuple[Interpretation, ...] = ()


def decide(interpretations: Sequence[Interpretation]) -> Decision:
    """Choose the interpretation that fits and that no other interpretation contradicts.

    Without such an interpretation, the decision has the reason, and the one that comes nearest as `next`.
    Positions that a controller computed from the joints are excluded first, then left-handed frames, unless
    only such a frame fits.

    Args:
        interpretations: by residual, the smallest first.
    """
    fitting = [each for each in interpretations if fits(each)]
    measured = _leave_out_computed_positions(fitting)
    if not measured:
        return _explain_missing_fit(interpretations, fitting)
    plain = _leave_out_mixtures(measured)
    is_left_handed = _fit_only_left_handed(plain)
    of_this_hand = [each for each in plain if each.fit.frame.is_mirrored == is_left_handed]
    compared = interpretations
    if not is_left_handed:
        compared = [each for each in interpretations if not each.fit.frame.is_mirrored]
    best = _choose_simplest(of_this_hand)
    equals = tuple(each for each in compared if each is not best and _have_same_effect(each, best))
    shifted = tuple(each for each in measured if _is_shifted(each, (best, *equals)))
    others = [each for each in compared if each not in equals and each not in shifted]
    rival, votes = _find_rival(best, others, fitting, equals)
    reason = _find_obstacle(best, votes)
    if reason:
        return Decision(None, rival or best, equals, reason)
    shifted = tuple(each for each in shifted if each in of_this_hand)
    return Decision(best, rival, equals, "", shifted)


def _leave_out_mixtures(measured: Sequence[Interpretation]) -> list[Interpretation]:
    """Return the interpretations without those that share a column with another one of nearer columns.

    If a table has two states of a target, x and z of one and y of the other are near a position, too, in a
    frame of the other hand.
    """
    return [
        each
        for each in measured
        if not any(_are_nearer_columns(other.points, each.points) for other in measured)
    ]


def _are_nearer_columns(first: PointColumns, second: PointColumns) -> bool:
    """Return whether two triples share a column, and those of the first are nearer to each other."""
    return first.overlaps(second) and first.step < second.step


def _fit_only_left_handed(measured: Sequence[Interpretation]) -> bool:
    """Return whether the positions fit in a left-handed frame, and in no right-handed one.

    Exchanged axes make a frame left-handed. An arm whose axes are in a plane at zero fits as well in a
    right-handed frame, with the joints of its mirror image; the postures decide for other arms.

    Args:
        measured: interpretations that fit, the smallest residual first.
    """
    left_handed = next((each for each in measured if each.fit.frame.is_mirrored), None)
    right_handed = next((each for each in measured if not each.fit.frame.is_mirrored), None)
    if left_handed is None or right_handed is None:
        return right_handed is None
    return count_votes(left_handed, right_handed).margin >= _LEAST_VOTES


def _explain_missing_fit(
    interpretations: Sequence[Interpretation], fitting: Sequence[Interpretation]
) -> Decision:
    """Return the decision that no interpretation fits, with the reason and the one that comes nearest.

    Args:
        interpretations: all of them, the smallest residual first.
        fitting: those that fit; their positions were computed, not measured.
    """
    if not interpretations:
        return Decision(None, None, (), "no columns fit the robot")
    if not fitting:
        nearest = interpretations[0]
        if nearest.fit.typical < LARGEST_RESIDUAL and _moves_too_little(nearest):
            return Decision(None, nearest, (), f"the targets move by {nearest.movement * 1e3:.0f} mm only")
        distance = f"{nearest.fit.typical * 1e3:.3g} mm"
        if nearest.fit.typical < LARGEST_RESIDUAL:
            share = measure_share(nearest)
            reason = f"only {share:.0%} of the positions fit the robot (their median distance is {distance})"
            return Decision(None, nearest, (), reason)
        return Decision(None, nearest, (), f"no columns fit the robot (best {distance})")
    reason = "the positions were computed from the joints, so that they are no readings"
    return Decision(None, fitting[0], (), reason)


def _leave_out_computed_positions(fitting: Sequence[Interpretation]) -> list[Interpretation]:
    """Return the interpretations whose positions were measured.

    Positions that a controller computed for one robot are no measured positions of another robot either, nor
    are y and z of them with x of the next positions.
    """
    computed = [each.points for each in fitting if is_computed(each)]
    return [each for each in fitting if not any(each.points.overlaps(columns) for columns in computed)]


def _are_same_positions(first: PointColumns, second: PointColumns) -> bool:
    """Return whether two triples x, y and z are the same columns of the same table, in any groups of rows."""
    return first.table == second.table and first.columns == second.columns


def fits(interpretation: Interpretation) -> bool:
    """Return whether most positions are near the places where the robot would put the targets."""
    typical = interpretation.fit.typical  # median distance [m]
    is_near = typical < LARGEST_RESIDUAL and not _moves_too_little(interpretation)
    return is_near and measure_share(interpretation) >= LEAST_SHARE


def _moves_too_little(interpretation: Interpretation) -> bool:
    """Return whether the targets move so little that any place near their mean seems to fit."""
    return interpretation.fit.typical > LARGEST_PART * interpretation.movement


def measure_share(interpretation: Interpretation) -> float:
    """Return the fraction of the positions that are near the places where the robot would put the targets."""
    distances = interpretation.fit.distances
    return float(np.mean(find_near(distances)[np.isfinite(distances)]))


def find_near(distances: FloatArray) -> BoolArray:
    """Return which positions (N, K) are near the places where the robot would put the targets.

    Each target counts by itself: a load moves all positions under load, from places that fit exactly. Near is
    five times the target's median distance, but no less than arms usually differ from their models, and no
    more than 10 mm.

    Args:
        distances: (N, K) of the positions from their places by the robot [m]; NaN where no position is.
    """
    limits = np.clip(5.0 * np.nanmedian(distances, axis=0), USUAL_RESIDUAL, 2.0 * LARGEST_RESIDUAL)
    return np.asarray(distances < limits)


def is_computed(interpretation: Interpretation) -> bool:
    """Return whether a controller seems to have computed the positions from the joints."""
    return explains_by_rounding(interpretation, interpretation.fit.typical)


def explains_by_rounding(interpretation: Interpretation, typical: float) -> bool:
    """Return whether rounding explains the distances of positions from their places by the nominal model.

    Positions by exact joints differ by the rounding of the positions, whatever their frame. Positions by
    rounded joints differ by about the joints' rounding, and are in R0: a tracker has a frame of its own. What
    differs otherwise, or farther than half a step of each joint allows, is a reading, even of an arm that
    differs from its model by noise alone.

    Args:
        interpretation: joints of the positions, and the frame of the positions.
        typical: median distance of the positions [m].
    """
    are_exact = typical < _ROUNDINGS * interpretation.point_rounding + _EXACT
    if are_exact:
        return True
    are_within = interpretation.share_by_rounding >= _LEAST_BY_ROUNDING
    is_possible = are_within and interpretation.fit.frame.is_base and typical < NEAR_MODEL
    rounding = interpretation.joint_rounding
    return is_possible and _LEAST_PART * rounding < typical < _ROUNDINGS * rounding


def _choose_simplest(measured: Sequence[Interpretation]) -> Interpretation:
    """Return the interpretation with the smallest residual, or one with the same effect that is simpler.

    Rows that are grouped by posture are simpler than single rows, and the maker's own way of counting the
    joints is simpler than that of another maker.

    Args:
        measured: interpretations that fit, the smallest residual first.
    """
    best = measured[0]
    differently_grouped = [each for each in measured if _have_same_columns(each, best)]
    # The one with the most rows for each posture; the first of several.
    best = max(differently_grouped, key=lambda each: each.joints.groups.count)
    for each in measured:
        has_same_effect = each is best or _have_same_effect(each, best)
        if has_same_effect and each.joints.counting.is_own:
            return each
    return best


def _read_same_joints(first: Interpretation, second: Interpretation) -> bool:
    """Return whether two interpretations have the same columns of joints, unit and counting."""
    joints, other_joints = first.joints, second.joints
    return (
        joints.table == other_joints.table
        and joints.columns == other_joints.columns
        and joints.unit == other_joints.unit
        and joints.counting.name == other_joints.counting.name
    )


def _have_same_columns(first: Interpretation, second: Interpretation) -> bool:
    """Return whether two interpretations differ at most in how rows are grouped by posture."""
    return _are_same_positions(first.points, second.points) and _read_same_joints(first, second)


def _have_same_effect(first: Interpretation, second: Interpretation) -> bool:
    """Return whether two interpretations of the same columns have the same residual but for rounding.

    For example two ways to count joints that the frame of the positions makes equal.
    """
    joints, other_joints = first.joints, second.joints
    are_same_columns = (
        joints.table == other_joints.table
        and joints.columns == other_joints.columns
        and joints.unit == other_joints.unit
        and joints.groups == other_joints.groups
        and first.points == second.points
    )
    difference = abs(first.fit.residual - second.fit.residual)
    return are_same_columns and difference < 1e-6 + _SAME_EFFECT * second.fit.residual


def _find_rival(
    best: Interpretation,
    compared: Sequence[Interpretation],
    fitting: Sequence[Interpretation],
    equals: Sequence[Interpretation],
) -> tuple[Interpretation | None, Votes]:
    """Return the interpretation that contradicts the best one most, with the votes of the postures.

    An interpretation does not contradict the best one if both can be true, if it fits far worse, or if its
    positions were computed. If nothing contradicts the best one, the votes are a great number for it.

    Args:
        best: the best interpretation.
        compared: interpretations to compare with the best one.
        fitting: interpretations that fit.
        equals: interpretations with the same effect as the best one.
    """
    tied = (best, *equals)
    rival: Interpretation | None = None
    least_votes = Votes(10**6, 0)
    for other in compared:
        is_far_off = other.fit.typical > _FAR_OFF * other.movement
        if other in tied or is_computed(other) or is_far_off:
            continue
        is_fitting = other in fitting
        if any(_can_both_be_true(each, other, is_fitting=is_fitting) for each in tied):
            continue
        votes = count_votes(best, other)
        if votes.margin < least_votes.margin:
            rival, least_votes = other, votes
    return rival, least_votes


def _can_both_be_true(best: Interpretation, other: Interpretation, *, is_fitting: bool) -> bool:
    """Return whether the columns can mean both, because the positions are of other targets or states.

    `is_fitting` tells whether the other interpretation fits: then it may group the same rows differently.
    """
    if not _read_same_joints(best, other):
        return False
    is_regrouped = is_fitting and _have_same_columns(best, other)
    return is_regrouped or not best.points.overlaps(other.points)


def _is_shifted(other: Interpretation, tied: Sequence[Interpretation]) -> bool:
    """Return whether an interpretation may take x, y and z from two states of a target, one column too late.

    The loaded position is so near to the unloaded one that y and z of the first, and x of the second, are a
    position in a frame with exchanged axes. Such an interpretation has the right joints, or those of the
    mirrored arm, in any groups of rows, but other columns for the positions.

    Args:
        other: interpretation to check.
        tied: the best interpretation, then those with the same effect.
    """
    best = tied[0]
    if _are_same_positions(other.points, best.points):
        return False
    return any(_read_same_joints(other, right) or _read_mirrored_joints(other, right) for right in tied)


def _read_mirrored_joints(first: Interpretation, second: Interpretation) -> bool:
    """Return whether two interpretations differ in the signs of J1, J4 and J6, which mirror an arm."""
    if first.robot.n != len(MIRRORED_SIGNS):
        return False
    joints, other_joints = first.joints, second.joints
    are_same_columns = joints.columns == other_joints.columns and joints.unit == other_joints.unit
    mirrored_matrix = other_joints.counting.matrix * MIRRORED_SIGNS
    return are_same_columns and bool(np.allclose(joints.counting.matrix, mirrored_matrix))


class Votes(NamedTuple):
    """Number of postures that clearly speak for one of two interpretations."""

    supporting: int  #: for the first one
    opposing: int  #: for the second one

    @property
    def margin(self) -> int:
        """Votes for the first one, less `_VOTES_AGAINST` for each vote for the second one."""
        return self.supporting - _VOTES_AGAINST * self.opposing


def count_votes(first: Interpretation, second: Interpretation) -> Votes:
    """Count the postures that clearly speak for the first, and for the second (method.md §17).

    A posture speaks for an interpretation whose positions are near, if those of the other are
    `_CLEARLY_WORSE` times as far from where the robot would put the targets. If the two have different
    postures, the residuals decide: a clearly smaller one counts as many votes for the first.

    Distances by the second are those of targets that move as much as by the first: a smaller unit of length
    makes all distances smaller, and no position nearer.
    """
    to_same_movement = first.movement / second.movement
    have_same_postures = len(first.fit.distances) == len(second.fit.distances)
    if not have_same_postures:
        residual_by_second = to_same_movement * second.fit.residual
        first_is_clearly_better = residual_by_second > _CLEARLY_WORSE * max(first.fit.residual, 5e-5)
        return Votes(supporting=99 if first_is_clearly_better else 0, opposing=0)
    distance_by_first = _find_largest_distances(first)
    distance_by_second = to_same_movement * _find_largest_distances(second)
    is_known = (distance_by_first >= 0.0) & (distance_by_second >= 0.0)
    near = max(LARGEST_RESIDUAL, 3.0 * first.fit.typical)
    least_by_first = np.maximum(distance_by_first, first.fit.typical)
    least_by_second = np.maximum(distance_by_second, to_same_movement * second.fit.typical)
    for_first = (distance_by_first < near) & (distance_by_second > _CLEARLY_WORSE * least_by_first)
    for_second = (distance_by_second < near) & (distance_by_first > _CLEARLY_WORSE * least_by_second)
    return Votes(int((for_first & is_known).sum()), int((for_second & is_known).sum()))


def _find_largest_distances(interpretation: Interpretation) -> FloatArray:
    """Return the largest distance (N,) [m] of a position of each posture; −1 without positions."""
    return np.asarray(np.nan_to_num(interpretation.fit.distances, nan=-1.0).max(axis=1))


def _find_obstacle(best: Interpretation, votes: Votes) -> str:
    """Return why the best interpretation is not certain enough; empty if it is."""
    fit = best.fit
    if fit.degrees_of_freedom < LEAST_FREEDOM:
        return f"too few positions: {fit.degrees_of_freedom} degrees of freedom, {LEAST_FREEDOM} are needed"
    if abs(fit.free_scale - 1.0) > compute_plausible_scale_error(best.movement):
        return f"the lengths of the robot differ by the factor {fit.free_scale:.4f}"
    if votes.margin < _LEAST_VOTES:
        return "two readings of the columns fit"
    return ""


def compute_plausible_scale_error(movement: float) -> float:
    """Return the relative difference of all lengths that errors of an arm's links explain.

    Args:
        movement: largest standard deviation of a target's coordinate [m].
    """
    return max(LARGEST_SCALE_ERROR, LARGEST_LENGTH_ERROR / movement)


def find_doubt(best: Interpretation, interpretations: Sequence[Interpretation]) -> str:
    """Return the question that only a person can decide; empty without one.

    Positions in a left-handed frame have exchanged axes, or one axis with the wrong sign: a person looks. The
    best interpretation may count joints as another maker does. The readings then often fit as well with the
    robot's own counting, if two of the axes x, y and z are exchanged, so that the frame is mirrored.
    """
    if best.fit.frame.is_mirrored:
        return "two of x, y and z seem to be exchanged, or the sign of one of them is wrong"
    if best.joints.counting.is_own:
        return ""
    for other in interpretations:
        has_own_counting_in_mirrored_frame = other.fit.frame.is_mirrored and other.joints.counting.is_own
        has_same_columns = other.joints.columns == best.joints.columns
        residual_difference = abs(other.fit.residual - best.fit.residual)
        fits_as_well = residual_difference < _TWIN * best.fit.residual
        if has_own_counting_in_mirrored_frame and has_same_columns and fits_as_well:
            return f"two of x, y and z may be exchanged instead of joints {best.joints.counting.name}"
    return ""
