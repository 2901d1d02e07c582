"""Gross mistakes in the data whose correction explains the readings far better (method.md §7).

A *gross mistake* leaves numbers plausible: columns exchanged, a wrong joint map, the load as target. Each
such alternative is one more regressor of the same deflections: ``q = M (E q_c + e) + o`` with E exchanging,
reversing or coupling the controller's angles, e offsetting them by quarter turns, as makers' conventions are,
or the load at a target's place. As it has as many parameters as the fit itself, their residual sums compare
directly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, product
from typing import Final, Literal

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
    best, given_compensation = _find_best_alternative(
        robot, measurements, _list_alternatives(robot.joint_kinds, measurements.present.shape[1])
    )
    if given_compensation < LEAST_COMPENSATION and 2 < robot.n <= _MAPPED_JOINTS:
        mapped, _ = _find_best_alternative(robot, measurements, _list_joint_maps(robot.joint_kinds))
        found = [each for each in (best, mapped) if each is not None]
        best = min(found, key=lambda each: each.ratio, default=None)
    return best


def _find_best_alternative(
    robot: Robot, measurements: Measurements, alternatives: Sequence[Alternative]
) -> tuple[BetterAlternative | None, float]:
    """Return the best significant alternative, or None, and the compensation of the data as given."""
    affordable = _READINGS // (measurements.present.shape[1] * (len(alternatives) + 1))
    part = measurements.select_evenly(max(1, min(_MOST_COMPARED_OBSERVATIONS, affordable)))
    # A rigid flange moves by six coordinates at most.
    coordinates = int(np.minimum(part.coordinates.sum(axis=1), 6).sum())
    freedom = coordinates - robot.n
    if freedom < _LEAST_FREEDOM:
        return None, 1.0
    # Noise alone makes a ratio of residual sums fall below `ratio` with probability `FALSE_ALARM` at most.
    quantile = float(special.fdtri(robot.n, freedom, 1.0 - FALSE_ALARM / len(alternatives)))
    ratio = min(LARGEST_RATIO, 1.0 / (1.0 + robot.n * quantile / freedom))
    # Some of the observations select the alternatives to examine.
    preselection = part.select_evenly(
        math.ceil(_PRESELECTION_COORDINATES * robot.n * len(part) / coordinates)
    )
    rows = _build_alternative_rows(robot, preselection, alternatives)
    as_given, given_compensation = _fit_nonnegative_compliances(rows[0])
    alternatives = [
        a for a, left in zip(alternatives, _bound_residual_sums(rows[1:]), strict=True) if left < as_given
    ]
    if not alternatives:
        return None, given_compensation
    rows = _build_alternative_rows(robot, part, alternatives)
    as_given, given_compensation = _fit_nonnegative_compliances(rows[0])
    needed, best = as_given * ratio, None
    # rows[0] are the data as given, rows[k] those of alternative k − 1.
    for k in (1 + np.flatnonzero(_bound_residual_sums(rows[1:]) < needed)).tolist():
        squares, compensation = _fit_nonnegative_compliances(rows[k])
        if squares < needed and compensation >= LEAST_COMPENSATION:
            best = BetterAlternative(
                alternatives[k - 1], squares / as_given, compensation, given_compensation
            )
            needed = squares
    # If every force has the wrong sign, nearly any alternative fits better than the data as given; then the
    # integrity checks report the sign, and no alternative is returned.
    if (
        best is not None
        and _fit_nonnegative_compliances(rows[0] * np.append(np.ones(robot.n), -1.0))[0] < needed
    ):
        return None, given_compensation
    return best, given_compensation


@lru_cache
def _list_alternatives(kinds: tuple[JointKind, ...], targets: int) -> tuple[Alternative, ...]:
    """Return the possible mistakes, one change each; only joints of one kind are exchanged or coupled."""
    n, turning = len(kinds), [j for j, kind in enumerate(kinds) if kind == "revolute"]
    identity, no_offset = np.eye(n), np.zeros(n)
    mistakes: list[Alternative] = []
    for j, k in ((j, k) for j, k in combinations(range(n), 2) if kinds[j] == kinds[k]):
        order = np.arange(n)
        order[[j, k]] = k, j
        mistakes.append(Alternative("columns_exchanged", (j, k), identity[order], no_offset))
    for j, row in enumerate(identity):
        reversed_joint = identity - 2.0 * np.outer(row, row)
        mistakes.append(Alternative("sign_reversed", (j,), reversed_joint, no_offset))
    for sign in (1.0, -1.0) if n > 2 and kinds[1] == kinds[2] else ():
        coupled = identity + sign * np.outer(identity[2], identity[1])
        mistakes.append(Alternative("joints_coupled", (1, 2), coupled, no_offset))
    for j, turn in product(turning, (0.5 * np.pi, -0.5 * np.pi, np.pi)):
        mistakes.append(Alternative("zero_offset", (j,), identity, turn * identity[j]))
    exchanges = [
        Alternative("load_and_target_exchanged", (), identity, no_offset, t)
        for t in range(min(targets, _MOST_TARGETS))
    ]
    return (*mistakes, *exchanges)


@lru_cache
def _list_joint_maps(kinds: tuple[JointKind, ...]) -> tuple[Alternative, ...]:
    """Return the joint maps to compare that differ from the stated map by more than one mistake.

    Any signs may be reversed, and the third joint may be coupled to the second.
    """
    n, maps = len(kinds), list[Alternative]()
    identity, couplings = np.eye(n), (0.0, 1.0, -1.0) if kinds[1] == kinds[2] else (0.0,)
    for coupling, signs in product(couplings, product((1.0, -1.0), repeat=n)):
        concerned = {*np.flatnonzero(np.array(signs) < 0.0).tolist()}
        if len(concerned) + abs(coupling) > 1:
            joints = tuple(sorted(concerned | ({1, 2} if coupling else set())))
            matrix = np.diag(signs) @ (identity + coupling * np.outer(identity[2], identity[1]))
            maps.append(Alternative("joint_map", joints, matrix, np.zeros(n)))
    return tuple(maps)


def _build_alternative_rows(
    robot: Robot, given: Measurements, alternatives: Sequence[Alternative]
) -> FloatArray:
    """Return whitened rows (K + 1, R, n + 1) [A d]: of the measurements as given, then of K alternatives."""
    count, copies = len(given), len(alternatives) + 1
    matrices = np.array([np.eye(robot.n), *(each.matrix for each in alternatives)])
    offsets = np.array([np.zeros(robot.n), *(each.offset for each in alternatives)])
    joints = (given.joints @ matrices.transpose(0, 2, 1) + offsets[:, None]).reshape(copies * count, -1)
    postures = Postures(robot, robot.joint_map.model_angles(joints))
    # Encoders see the joint that they are on, whatever the joint map is.
    stacked = replace(given, encoders=None)[np.tile(np.arange(count), copies)]
    load_point, position = stacked.load_point.copy(), stacked.position.copy()
    # Places (N, T, 3) of the targets in the flange frame [m].
    places = np.where(given.in_flange[..., None], given.position, targets_in_flange(robot, given))
    for k, t in enumerate((each.target for each in alternatives), 1):
        if t is not None:  # the alternative exchanges load point and target
            part = slice(k * count, (k + 1) * count)
            load_point[part] = places[:, t]
            position[part, t] = np.where(given.in_flange[:, t, None], given.load_point, given.position[:, t])
    block = unloaded_block(
        robot, postures, replace(stacked, joints=joints, load_point=load_point, position=position)
    )
    stack = Rows(robot, block.measurements, prepared=block).stack([JOINTS], np.zeros(robot.n))
    return stack.rows.reshape(copies, -1, robot.n + 1)


def _bound_residual_sums(rows: FloatArray) -> FloatArray:
    """Return lower limits (K,) of the residual sums of squares of K fits to rows (K, R, n + 1) [A d].

    A fit without bounds on the compliances has no larger residual sum than a fit with bounds.
    """
    return np.square(compute_triangular_factor(rows)[:, -1, -1])


def _fit_nonnegative_compliances(rows: FloatArray) -> tuple[float, float]:
    """Fit compliances ≥ 0 to rows (R, n + 1) [A d].

    Returns the residual sum of squares, and the share of the mean deflection that the fit explains.
    """
    A, d = rows[:, :-1], rows[:, -1]
    residual = d - A @ solve_nonnegative(A, d)[0]
    residual_length = np.linalg.norm(residual.reshape(-1, 3), axis=1).sum()
    deflection_length = np.linalg.norm(d.reshape(-1, 3), axis=1).sum()
    explained = float(1.0 - residual_length / deflection_length) if deflection_length > 0.0 else 0.0
    return float(residual @ residual), explained
