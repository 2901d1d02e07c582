"""Gross mistakes in the data whose correction explains the readings far better (method.md §7).

A *gross mistake* leaves numbers plausible: columns exchanged, a wrong joint map, the load as target. Each
such alternative is one more regressor of the same deflections: ``q = M (E q_c + e) + o`` with E exchanging,
reversing or coupling the controller's angles, e offsetting them by quarter turns, as makers' conventions are,
or the load at a target's place. As it has as many parameters as the fit itself, their residual sums compare
directly.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, product
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy import special

from jointstiff.schemas.joints import JointKind
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.triangle import (
    compute_triangular_factor,
    solve_nonnegative,
)
from jointstiff.solver.mechanics.block import (
    targets_in_flange,
    unloaded_block,
)
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import JOINTS

AlternativeKind = Literal[
    "columns_exchanged",
    "sign_reversed",
    "zero_offset",
    "joints_coupled",
    "joint_map",
    "load_and_target_exchanged",
]

FALSE_ALARM: Final = 1e-4
"""Probability that noise alone makes any alternative of a set fit better."""
LARGEST_RATIO: Final = 0.7
"""Largest ratio of the residual sums, alternative to fit: model errors favour a wrong alternative by less."""
LEAST_COMPENSATION: Final = 0.7
"""Least compensation of an acceptable alternative; if that of the data as given is less, joint maps are
tried."""
_MAPPED_JOINTS: Final = 7
"""Number of joints up to which whole joint maps are tried: each further joint doubles the number of maps."""
_MOST_COMPARED_OBSERVATIONS: Final = 60
"""Number of observations that suffice to find a mistake that all observations share."""
_PRESELECTION_COORDINATES: Final = 3
"""Number of coordinates, for each joint, in the observations that preselect alternatives."""
_MOST_TARGETS: Final = 8
_READINGS: Final = 24_576
"""Maximum number of readings over all alternatives: with many joints fewer observations are compared."""
_LEAST_FREEDOM: Final = 3


@dataclass(frozen=True, eq=False)
class Alternative:
    """Possible mistake in the data, with the change that undoes the mistake."""

    kind: AlternativeKind  #: kind of mistake
    joints: tuple[int, ...]  #: indices of the affected joints of the controller
    matrix: FloatArray  #: (n, n) E, dimensionless: correct controller angles are E q_c + e
    offset: FloatArray  #: (n,) e [rad]
    #: index of the target whose place and the load point are exchanged; None for other kinds
    target: int | None = None


@dataclass(frozen=True, eq=False)
class BetterAlternative:
    """An alternative that explains the readings far better than the set as given."""

    alternative: Alternative  #: the mistake that was undone
    #: residual sum of squares with the mistake undone, over the residual sum of the data as given
    ratio: float
    compensation: float  #: share of the mean deflection that the joints explain with the mistake undone
    compensation_as_given: float  #: share of the mean deflection that the joints explain as given


def find_better_alternative(robot: Robot, measurements: Measurements) -> BetterAlternative | None:
    """Find the mistake in the data whose correction explains the readings far better; None if none does.

    The gain must be larger than noise and model errors explain: significant by an F test in which the
    correction counts as n further parameters. All fits have compliances ≥ 0.
    """
    single_mistakes = _list_alternatives(robot.joint_kinds, targets=measurements.present.shape[1])
    best, compensation_as_given = _find_best_alternative(robot, measurements, single_mistakes)
    can_try_joint_maps = 2 < robot.n <= _MAPPED_JOINTS
    if compensation_as_given >= LEAST_COMPENSATION or not can_try_joint_maps:
        return best
    # The data as given explain little, so that several signs may be wrong at once.
    joint_maps = _list_joint_maps(robot.joint_kinds)
    best_joint_map, _ = _find_best_alternative(robot, measurements, joint_maps)
    found = [alternative for alternative in (best, best_joint_map) if alternative is not None]
    return min(found, key=lambda alternative: alternative.ratio, default=None)


def _find_best_alternative(
    robot: Robot, measurements: Measurements, alternatives: Sequence[Alternative]
) -> tuple[BetterAlternative | None, float]:
    """Return the best significant alternative, or None, and the compensation of the data as given.

    The compensation is the share of the mean deflection that the joints explain.
    """
    compared = _choose_observations(measurements, len(alternatives))
    coordinates = _count_rigid_coordinates(compared)
    degrees_of_freedom = coordinates - robot.n
    if degrees_of_freedom < _LEAST_FREEDOM:
        return None, 1.0
    largest_ratio = _compute_largest_ratio(robot.n, degrees_of_freedom, len(alternatives))
    # A few of these observations exclude most alternatives; only the others are compared on all of them.
    few = math.ceil(_PRESELECTION_COORDINATES * robot.n * len(compared) / coordinates)
    rows = _build_alternative_rows(robot, compared.select_evenly(few), alternatives)
    squares_as_given, compensation_as_given = _fit_nonnegative_compliances(rows.as_given)
    can_be_better = _bound_residual_sums(rows.undone) < squares_as_given
    alternatives = [alternatives[k] for k in np.flatnonzero(can_be_better).tolist()]
    if not alternatives:
        return None, compensation_as_given
    rows = _build_alternative_rows(robot, compared, alternatives)
    return _select_best_fit(rows, alternatives, largest_ratio)


def _choose_observations(measurements: Measurements, alternative_count: int) -> Measurements:
    """Return the observations by which alternatives are compared, evenly spread over the set.

    Some observations suffice, as a mistake is in all of them; with many alternatives, only a few of them can
    be compared in reasonable time.
    """
    target_count = measurements.present.shape[1]
    affordable = _READINGS // (target_count * (alternative_count + 1))
    count = max(1, min(_MOST_COMPARED_OBSERVATIONS, affordable))
    return measurements.select_evenly(count)


def _count_rigid_coordinates(measurements: Measurements) -> int:
    """Return the number of coordinates that were read; a rigid flange moves by six at most in a posture."""
    return int(np.minimum(measurements.coordinates.sum(axis=1), 6).sum())


def _compute_largest_ratio(joint_count: int, freedom: int, alternative_count: int) -> float:
    """Return the ratio of residual sums, alternative to data as given, below which an alternative is better.

    Noise alone makes the ratio of any of the alternatives fall below it with probability `FALSE_ALARM` at
    most: an F test with `joint_count` and `freedom` degrees of freedom. `LARGEST_RATIO` allows for errors of
    the model.
    """
    level = FALSE_ALARM / alternative_count  # Bonferroni: any of the alternatives may be accepted by chance
    critical_f = float(special.fdtri(joint_count, freedom, 1.0 - level))
    return min(LARGEST_RATIO, 1.0 / (1.0 + joint_count * critical_f / freedom))


def _select_best_fit(
    rows: _AlternativeRows, alternatives: Sequence[Alternative], largest_ratio: float
) -> tuple[BetterAlternative | None, float]:
    """Return the significant alternative with the least residual sum, or None, and the compensation as given.

    Args:
        rows: rows of the data as given, and with each of K mistakes undone.
        alternatives: the K possible mistakes.
        largest_ratio: ratio of the residual sums, alternative to data as given, below which a mistake is
            significant.
    """
    squares_as_given, compensation_as_given = _fit_nonnegative_compliances(rows.as_given)
    least_squares, best = squares_as_given * largest_ratio, None
    least_possible_squares = _bound_residual_sums(rows.undone)
    for k in np.flatnonzero(least_possible_squares < least_squares).tolist():
        squares, compensation = _fit_nonnegative_compliances(rows.undone[k])
        if squares < least_squares and compensation >= LEAST_COMPENSATION:
            ratio = squares / squares_as_given
            best = BetterAlternative(alternatives[k], ratio, compensation, compensation_as_given)
            least_squares = squares
    if best is None or _opposite_forces_fit(rows.as_given, least_squares):
        return None, compensation_as_given
    return best, compensation_as_given


def _opposite_forces_fit(rows_as_given: FloatArray, squares: float) -> bool:
    """Return whether the residual sum is below `squares` once every deflection of the rows is negated.

    If every force has the wrong sign, nearly any alternative fits better than the data as given. Then the
    integrity checks report the sign, and no alternative is returned.
    """
    negated = rows_as_given.copy()
    negated[:, -1] *= -1.0
    squares_of_negated, _ = _fit_nonnegative_compliances(negated)
    return squares_of_negated < squares


@lru_cache
def _list_alternatives(kinds: tuple[JointKind, ...], targets: int) -> tuple[Alternative, ...]:
    """Return the possible mistakes, one change each; only joints of one kind are exchanged or coupled."""
    return (
        *_list_column_exchanges(kinds),
        *_list_reversed_signs(len(kinds)),
        *_list_couplings(kinds),
        *_list_zero_offsets(kinds),
        *_list_load_exchanges(len(kinds), targets),
    )


def _list_column_exchanges(kinds: Sequence[JointKind]) -> Iterator[Alternative]:
    """Yield the exchange of the columns of each pair of joints of one kind."""
    n = len(kinds)
    for j, k in combinations(range(n), 2):
        if kinds[j] == kinds[k]:
            exchanged = np.eye(n)
            exchanged[[j, k]] = exchanged[[k, j]]
            yield Alternative("columns_exchanged", (j, k), exchanged, np.zeros(n))


def _list_reversed_signs(n: int) -> Iterator[Alternative]:
    """Yield the opposite sign of each of n joints."""
    for j in range(n):
        reversed_joint = np.eye(n)
        reversed_joint[j, j] = -1.0
        yield Alternative("sign_reversed", (j,), reversed_joint, np.zeros(n))


def _list_couplings(kinds: Sequence[JointKind]) -> Iterator[Alternative]:
    """Yield the addition and the subtraction of joint 2 to and from joint 3.

    Some controllers state joint 3 relative to the ground, not to link 2.
    """
    n = len(kinds)
    joint_2_can_move_joint_3 = n > 2 and kinds[1] == kinds[2]
    if joint_2_can_move_joint_3:
        for sign in (1.0, -1.0):
            coupled = np.eye(n)
            coupled[2, 1] = sign
            yield Alternative("joints_coupled", (1, 2), coupled, np.zeros(n))


def _list_zero_offsets(kinds: Sequence[JointKind]) -> Iterator[Alternative]:
    """Yield the zero of each revolute joint offset by 90°, −90° and 180°, as makers' conventions are."""
    identity = np.eye(len(kinds))
    for j, kind in enumerate(kinds):
        if kind == "revolute":
            for turn in (0.5 * np.pi, -0.5 * np.pi, np.pi):
                yield Alternative("zero_offset", (j,), identity, turn * identity[j])


def _list_load_exchanges(n: int, targets: int) -> Iterator[Alternative]:
    """Yield the exchange of the load point and each target, of the first `_MOST_TARGETS` targets."""
    for target in range(min(targets, _MOST_TARGETS)):
        yield Alternative("load_and_target_exchanged", (), np.eye(n), np.zeros(n), target)


@lru_cache
def _list_joint_maps(kinds: tuple[JointKind, ...]) -> tuple[Alternative, ...]:
    """Return the joint maps to compare that differ from the stated map by more than one mistake.

    Any signs may be reversed, and the third joint may be coupled to the second. Maps with one mistake are
    alternatives of another kind.
    """
    maps = list[Alternative]()
    couplings = (0.0, 1.0, -1.0) if kinds[1] == kinds[2] else (0.0,)
    for coupling in couplings:
        for signs in product((1.0, -1.0), repeat=len(kinds)):
            mistake_count = signs.count(-1.0) + abs(coupling)
            if mistake_count > 1:
                maps.append(_build_joint_map(signs, coupling))
    return tuple(maps)


def _build_joint_map(signs: Sequence[float], coupling: float) -> Alternative:
    """Return the joint map with the given signs (n), in which joint 3 has `coupling` times joint 2 added."""
    n = len(signs)
    affected_joints = {j for j, sign in enumerate(signs) if sign < 0.0}
    if coupling:
        affected_joints |= {1, 2}
    coupling_matrix = np.eye(n)
    coupling_matrix[2, 1] = coupling
    matrix = np.diag(signs) @ coupling_matrix
    return Alternative("joint_map", tuple(sorted(affected_joints)), matrix, np.zeros(n))


class _AlternativeRows(NamedTuple):
    """Least-squares rows [A d] of the data as given, and with each of K mistakes undone.

    Each row holds the regressor A of n compliances, and a coordinate d of a deflection, in units of sigma.
    """

    as_given: FloatArray  # (R, n + 1)
    undone: FloatArray  # (K, R, n + 1)


def _build_alternative_rows(
    robot: Robot, given: Measurements, alternatives: Sequence[Alternative]
) -> _AlternativeRows:
    """Return the least-squares rows of the data as given, and of K alternatives.

    The N observations are repeated for each alternative, so that all are computed at once.
    """
    copies = len(alternatives) + 1
    joints = _correct_joints(given, robot.n, alternatives)
    # Encoders see the joint that they are on, whatever the joint map is.
    repeated = replace(given, encoders=None)[np.tile(np.arange(len(given)), copies)]
    # Loads share an unloaded reading within each copy only.
    numbers = given.number_unloaded_readings() + len(given) * np.arange(float(copies))[:, None]
    repeated = replace(repeated, unloaded_reading=numbers.ravel())
    corrected = replace(_exchange_places(robot, given, repeated, alternatives), joints=joints)
    postures = Postures(robot, robot.joint_map.model_angles(joints))
    block = unloaded_block(robot, postures, corrected)
    stack = Rows(robot, block.measurements, prepared=block).stack([JOINTS], np.zeros(robot.n))
    as_given, *undone = stack.rows.reshape(copies, -1, robot.n + 1)
    return _AlternativeRows(as_given, np.array(undone))


def _correct_joints(given: Measurements, n: int, alternatives: Sequence[Alternative]) -> FloatArray:
    """Return the controller's joints ((K + 1) N, n): as given, then ``E q_c + e`` of each alternative."""
    as_given = given.joints @ np.eye(n).T + np.zeros(n)
    undone = [given.joints @ alternative.matrix.T + alternative.offset for alternative in alternatives]
    return np.concatenate([as_given, *undone])


def _exchange_places(
    robot: Robot, given: Measurements, repeated: Measurements, alternatives: Sequence[Alternative]
) -> Measurements:
    """Return the repeated observations, in which some alternatives exchange the load point and a target.

    Args:
        robot: n joints.
        given: N observations.
        repeated: these observations as given, then once for each alternative.
        alternatives: the K alternatives; most of them exchange no places.
    """
    load_point, position = repeated.load_point.copy(), repeated.position.copy()
    # Places (N, T, 3) of the targets in the flange frame [m].
    places = np.where(given.in_flange[..., None], given.position, targets_in_flange(robot, given))
    for k, alternative in enumerate(alternatives, 1):
        t = alternative.target
        if t is not None:
            copy = slice(k * len(given), (k + 1) * len(given))
            load_point[copy] = places[:, t]
            position[copy, t] = np.where(given.in_flange[:, t, None], given.load_point, given.position[:, t])
    return replace(repeated, load_point=load_point, position=position)


def _bound_residual_sums(rows: FloatArray) -> FloatArray:
    """Return lower limits (K,) of the residual sums of squares of K fits to rows (K, R, n + 1) [A d].

    A fit without bounds on the compliances has no larger residual sum than a fit with bounds. The last
    diagonal entry of the triangular factor of [A d] is the residual length of the fit without bounds.
    """
    residual_length = compute_triangular_factor(rows)[:, -1, -1]
    return np.square(residual_length)


def _fit_nonnegative_compliances(rows: FloatArray) -> tuple[float, float]:
    """Fit compliances ≥ 0 to rows (R, n + 1) [A d]; each three rows are a deflection's coordinates.

    Returns the residual sum of squares, and the share of the mean deflection that the fit explains.
    """
    A, d = rows[:, :-1], rows[:, -1]
    compliance, _ = solve_nonnegative(A, d)
    residual = d - A @ compliance
    residual_lengths = np.linalg.norm(residual.reshape(-1, 3), axis=1)
    deflection_lengths = np.linalg.norm(d.reshape(-1, 3), axis=1)
    total_deflection = deflection_lengths.sum()
    explained = 1.0 - residual_lengths.sum() / total_deflection if total_deflection > 0.0 else 0.0
    return float(residual @ residual), float(explained)
