"""Fits under mistakes that leave numbers plausible: columns exchanged, a wrong joint map, load as target.

Each alternative is one more regressor of the same deflections: ``q = M (E q_c + e) + o`` with E exchanging,
reversing or coupling the controller's angles, e offsetting them, or the load at a target's place. As it has
as many parameters as the fit itself, their residual sums compare directly. Zeros of joints are offset by
quarter turns, as makers' conventions are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, combinations, product
from typing import Final, Literal

import numpy as np
from scipy import optimize, special

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.block import unloaded_block, unloaded_configurations
from jointstiff.solver.terms.joints import JOINTS
from jointstiff.solver.terms.term import whitened_rows

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
"""Least compensation of an alternative; below it as given, whole joint maps are tried."""
_MAPPED_JOINTS: Final = 7
"""Number of joints up to which whole joint maps are tried: their number doubles with each joint."""
_OBSERVATIONS: Final = 60
"""Number of observations that suffice to find a mistake of the whole set."""
_SCREENED: Final = 3
"""Number of coordinates for each joint in the observations that select the alternatives to examine."""
_MOST_TARGETS: Final = 8
_READINGS: Final = 24_576
"""Maximum number of readings computed: with many joints fewer observations are compared."""
_LEAST_FREEDOM: Final = 3
_NULL: Final = 1e-9
"""Norm of a column, relative to the largest, below which no load twists its joint."""
_RIDGE: Final = 1e-12


@dataclass(frozen=True, eq=False)
class Alternative:
    """One mistake that may have been made."""

    kind: AlternativeKind  #: kind of mistake
    joints: tuple[int, ...]  #: indices of the controller's joints concerned
    matrix: FloatArray  #: (n, n) E, the controller's angles meant from those given, dimensionless
    offset: FloatArray  #: (n,) e [rad]
    #: index of the target whose place and the load point are exchanged; None for other kinds
    target: int | None = None


@dataclass(frozen=True, eq=False)
class BetterAlternative:
    """An alternative that explains the readings far better than the set as given."""

    alternative: Alternative  #: the mistake that was undone
    ratio: float  #: residual sum of squares with it over that without
    compensation: float  #: share of the mean deflection explained with it
    compensation_as_given: float  #: the same without it


def better_alternative(robot: Robot, measurements: Measurements) -> BetterAlternative | None:
    """Return the alternative of least residual sum if neither noise nor model errors explain its gain.

    The gain must be significant by an F test in which the alternative counts as n further parameters, all
    compliances of each fit being non-negative.

    Returns:
        The alternative, or None where no alternative fits far better.
    """
    best, plain = _best(robot, measurements, _alternatives(robot.n, measurements.present.shape[1]))
    if plain < LEAST_COMPENSATION and 2 < robot.n <= _MAPPED_JOINTS:
        mapped, _ = _best(robot, measurements, _joint_maps(robot.n))
        best = min((b for b in (best, mapped) if b), key=lambda b: b.ratio, default=None)
    return best


def _best(
    robot: Robot, measurements: Measurements, alternatives: Sequence[Alternative]
) -> tuple[BetterAlternative | None, float]:
    """Compare alternatives: the best that is significant, and the compensation as given."""
    affordable = _READINGS // (measurements.present.shape[1] * (len(alternatives) + 1))
    part = measurements[_chosen(measurements, min(_OBSERVATIONS, affordable))]
    freedom = _coordinates(part) - robot.n
    if freedom < _LEAST_FREEDOM:
        return None, 1.0
    # Noise alone goes below that ratio of residual sums with probability `FALSE_ALARM`.
    quantile = float(special.fdtri(robot.n, freedom, 1.0 - FALSE_ALARM / len(alternatives)))
    ratio = min(LARGEST_RATIO, 1.0 / (1.0 + robot.n * quantile / freedom))
    alternatives, plain = _screened(robot, part, alternatives)
    if not alternatives:
        return None, plain
    rows = _rows(robot, part, alternatives, np.arange(len(part)))
    grams = rows.transpose(0, 2, 1) @ rows
    as_given, plain = _fit(rows[0], grams[0])
    needed, best = as_given * ratio, None
    for k in (1 + np.flatnonzero(_least_sums(grams[1:]) < needed)).tolist():
        left, compensation = _fit(rows[k], grams[k])
        if left < needed and compensation >= LEAST_COMPENSATION:
            best, needed = BetterAlternative(alternatives[k - 1], left / as_given, compensation, plain), left
    # Where every force is reversed, much explains more than nothing; the integrity checks find the sign.
    if best is not None and _fit(rows[0] * np.append(np.ones(robot.n), -1.0), grams[0])[0] < needed:
        return None, plain
    return best, plain


def _screened(
    robot: Robot, part: Measurements, alternatives: Sequence[Alternative]
) -> tuple[list[Alternative], float]:
    """Choose the alternatives that fit some of the observations better than the set as given.

    Returns:
        The alternatives, and the compensation of these observations as given.
    """
    some = _chosen(part, math.ceil(_SCREENED * robot.n * len(part) / _coordinates(part)))
    rows = _rows(robot, part, alternatives, some)
    grams = rows.transpose(0, 2, 1) @ rows
    as_given, plain = _fit(rows[0], grams[0])
    sums = _least_sums(grams[1:])
    return [a for a, left in zip(alternatives, sums, strict=True) if left < as_given], plain


@lru_cache
def _alternatives(n: int, targets: int) -> tuple[Alternative, ...]:
    """Return the mistakes that are compared."""
    mistakes = (_exchanges(n), _joint_maps_of_one(n), _zeros(n), _loads(n, min(targets, _MOST_TARGETS)))
    return tuple(chain.from_iterable(mistakes))


def _exchanges(n: int) -> Iterator[Alternative]:
    unit = np.eye(n)
    for j, k in combinations(range(n), 2):
        order = np.arange(n)
        order[[j, k]] = k, j
        yield Alternative("columns_exchanged", (j, k), unit[order], np.zeros(n))


def _joint_maps_of_one(n: int) -> Iterator[Alternative]:
    unit = np.eye(n)
    for j in range(n):
        yield Alternative("sign_reversed", (j,), unit - 2.0 * np.outer(unit[j], unit[j]), np.zeros(n))
    if n > 2:
        for sign in (1.0, -1.0):
            matrix = unit + sign * np.outer(unit[2], unit[1])
            yield Alternative("joints_coupled", (1, 2), matrix, np.zeros(n))


def _zeros(n: int) -> Iterator[Alternative]:
    unit = np.eye(n)
    for j in range(n):
        for turn in (0.5 * np.pi, -0.5 * np.pi, np.pi):
            yield Alternative("zero_offset", (j,), unit, turn * unit[j])


def _loads(n: int, targets: int) -> Iterator[Alternative]:
    for t in range(targets):
        yield Alternative("load_and_target_exchanged", (), np.eye(n), np.zeros(n), t)


@lru_cache
def _joint_maps(n: int) -> tuple[Alternative, ...]:
    """Return joint maps: the signs of some joints reversed, the third joint coupled to the second or not."""
    unit, maps = np.eye(n), []
    for sign in (0.0, 1.0, -1.0):
        coupling = unit + sign * np.outer(unit[2], unit[1])
        for signs in product((1.0, -1.0), repeat=n):
            reversed_joints = np.flatnonzero(np.array(signs) < 0.0)
            if len(reversed_joints) + abs(sign) > 1:
                concerned = {*reversed_joints.tolist(), *((1, 2) if sign else ())}
                matrix = np.diag(signs) @ coupling
                maps.append(Alternative("joint_map", tuple(sorted(concerned)), matrix, np.zeros(n)))
    return tuple(maps)


def _chosen(measurements: Measurements, most: int) -> IndexArray:
    """Return indices of observations, evenly spread: all if they are no more."""
    count = len(measurements)
    spread = np.arange(max(most, 1)) * (count - 1) // max(most - 1, 1)
    return spread if most < count else np.arange(count)


def _coordinates(part: Measurements) -> int:
    """Count the coordinates that can differ from a model of rigid flanges: at most six an observation."""
    return int(np.minimum(part.coordinates.sum(axis=1), 6).sum())


def _rows(
    robot: Robot, part: Measurements, alternatives: Sequence[Alternative], chosen: IndexArray
) -> FloatArray:
    """Build the whitened rows (K + 1, R, n + 1) [A d] of the set as given, then of each alternative.

    Only of the observations `chosen`, as often as there are alternatives: the first of them are as given.
    """
    count, times = len(chosen), len(alternatives) + 1
    matrices, offsets = _maps(robot.n, tuple(alternatives))
    joints = (part.joints[chosen] @ matrices.transpose(0, 2, 1) + offsets[:, None]).reshape(times * count, -1)
    at = Configurations(robot, robot.joint_map.model_angles(joints))
    stacked = part[np.tile(chosen, times)]
    given = stacked[:count]
    load_point, position = stacked.load_point, stacked.position
    by_load = [(k, a.target) for k, a in enumerate(alternatives, 1) if a.target is not None]
    if by_load:
        load_point, position = load_point.copy(), position.copy()
        places = _on_flange(given, at.flange_rotation[:count], at.flange_translation[:count])
        for k, t in by_load:
            rows = slice(k * count, (k + 1) * count)
            load_point[rows] = places[:, t]
            position[rows, t] = np.where(given.in_flange[:, t, None], given.load_point, given.position[:, t])
    block = unloaded_block(
        robot, at, replace(stacked, joints=joints, load_point=load_point, position=position)
    )
    return whitened_rows(block, [JOINTS], np.zeros(robot.n)).targets.reshape(times, -1, robot.n + 1)


@lru_cache(maxsize=16)
def _maps(n: int, alternatives: tuple[Alternative, ...]) -> tuple[FloatArray, FloatArray]:
    """Stack E (K + 1, n, n) and e (K + 1, n) [rad] of the set as given, then of each alternative."""
    return (
        np.array([np.eye(n), *(alternative.matrix for alternative in alternatives)]),
        np.array([np.zeros(n), *(alternative.offset for alternative in alternatives)]),
    )


def places_on_flange(robot: Robot, part: Measurements) -> FloatArray:
    """Compute places (N, T, 3) of targets in the flange frame [m]: given or the means of those read."""
    if part.in_flange.all():
        return part.position
    at = unloaded_configurations(robot, part)
    return _on_flange(part, at.flange_rotation, at.flange_translation)


def _on_flange(part: Measurements, rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Compute the same with the flange (N, 3, 3), (N, 3) [m] in R0."""
    read = (part.position - translation[:, None]) @ rotation
    seen = np.where(part.in_flange[..., None], part.position, read)
    weight = part.present[..., None] / np.maximum(part.present.sum(axis=0), 1)[:, None]
    return np.where(part.in_flange[..., None], part.position, (weight * seen).sum(axis=0))


def _least_sums(grams: FloatArray) -> FloatArray:
    """Compute the residual sums (K,) of fits without bounds from Gram matrices (K, n + 1, n + 1) of [A d]."""
    gram, moment, squares = grams[:, :-1, :-1], grams[:, :-1, -1], grams[:, -1, -1]
    norms = np.sqrt(np.diagonal(gram, axis1=1, axis2=2))
    seen = norms > _NULL * norms.max(axis=1, keepdims=True, initial=0.0)
    unit = np.where(seen, 1.0 / np.where(seen, norms, 1.0), 0.0)
    scaled = gram * unit[:, :, None] * unit[:, None, :] + (_RIDGE + ~seen)[..., None] * np.eye(gram.shape[1])
    b = moment * unit
    sums: FloatArray = squares - (b * np.linalg.solve(scaled, b[..., None])[..., 0]).sum(axis=1)
    return sums


def _fit(rows: FloatArray, gram: FloatArray) -> tuple[float, float]:
    """Fit non-negative compliances to rows (R, n + 1) [A d]: residual sum of squares, and compensation."""
    A, d = rows[:, :-1], rows[:, -1]
    norms = np.sqrt(np.diagonal(gram)[:-1])
    unit = np.where(norms > _NULL * norms.max(initial=0.0), 1.0 / np.where(norms > 0.0, norms, 1.0), 0.0)
    residual = d - A @ (unit * optimize.nnls(A * unit, d)[0])
    left = np.linalg.norm(residual.reshape(-1, 3), axis=1).sum()
    moved = np.linalg.norm(d.reshape(-1, 3), axis=1).sum()
    return float(residual @ residual), float(1.0 - left / moved) if moved > 0.0 else 0.0
