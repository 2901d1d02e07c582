"""Alternatives: gross mistakes in angles, joint map or load that leave the numbers plausible (method.md §7).

A *gross mistake* leaves numbers plausible: columns exchanged, a wrong joint map, the load as target. Each
such alternative is one more regressor of the same deflections: ``q = M (E q_c + e) + o`` with E exchanging,
reversing or coupling the controller's angles, e offsetting them, or the load at a target's place. As it has
as many parameters as the fit itself, their residual sums compare directly. Zeros of joints are offset by
quarter turns, as makers' conventions are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, product
from typing import Final, Literal

import numpy as np
from scipy import optimize, special

from jointstiff.schemas.joints import JointKind
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.block import unloaded_block, whitened_rows
from jointstiff.solver.terms.springs import JOINTS

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
_COMPARED: Final = 60
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
    best, plain = _best(robot, measurements, _alternatives(robot.joint_kinds, measurements.present.shape[1]))
    if plain < LEAST_COMPENSATION and 2 < robot.n <= _MAPPED_JOINTS:
        mapped, _ = _best(robot, measurements, _joint_maps(robot.joint_kinds))
        best = min((b for b in (best, mapped) if b), key=lambda b: b.ratio, default=None)
    return best


def _best(
    robot: Robot, measurements: Measurements, alternatives: Sequence[Alternative]
) -> tuple[BetterAlternative | None, float]:
    """Compare alternatives: the best that is significant, and the compensation as given."""
    affordable = _READINGS // (measurements.present.shape[1] * (len(alternatives) + 1))
    part = measurements.evenly(max(1, min(_COMPARED, affordable)))
    # A rigid flange moves by six coordinates at most.
    coordinates = int(np.minimum(part.coordinates.sum(axis=1), 6).sum())
    freedom = coordinates - robot.n
    if freedom < _LEAST_FREEDOM:
        return None, 1.0
    # Noise alone goes below that ratio of residual sums with probability `FALSE_ALARM`.
    quantile = float(special.fdtri(robot.n, freedom, 1.0 - FALSE_ALARM / len(alternatives)))
    ratio = min(LARGEST_RATIO, 1.0 / (1.0 + robot.n * quantile / freedom))
    # Some of the observations select the alternatives to examine.
    some = part.evenly(math.ceil(_SCREENED * robot.n * len(part) / coordinates))
    rows, grams = _rows(robot, some, alternatives)
    as_given, plain = _fit(rows[0], grams[0])
    sums = _least_sums(grams[1:])
    alternatives = [a for a, left in zip(alternatives, sums, strict=True) if left < as_given]
    if not alternatives:
        return None, plain
    rows, grams = _rows(robot, part, alternatives)
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


@lru_cache
def _alternatives(kinds: tuple[JointKind, ...], targets: int) -> tuple[Alternative, ...]:
    """Return the mistakes that are compared: lengths are neither exchanged nor coupled with angles."""
    n, turning = len(kinds), [j for j, kind in enumerate(kinds) if kind == "revolute"]
    unit, none = np.eye(n), np.zeros(n)
    mistakes: list[Alternative] = []
    for j, k in ((j, k) for j, k in combinations(range(n), 2) if kinds[j] == kinds[k]):
        order = np.arange(n)
        order[[j, k]] = k, j
        mistakes.append(Alternative("columns_exchanged", (j, k), unit[order], none))
    for j, row in enumerate(unit):
        reversed_joint = unit - 2.0 * np.outer(row, row)
        mistakes.append(Alternative("sign_reversed", (j,), reversed_joint, none))
    for sign in (1.0, -1.0) if n > 2 and kinds[1] == kinds[2] else ():
        coupled = unit + sign * np.outer(unit[2], unit[1])
        mistakes.append(Alternative("joints_coupled", (1, 2), coupled, none))
    for j, turn in product(turning, (0.5 * np.pi, -0.5 * np.pi, np.pi)):
        mistakes.append(Alternative("zero_offset", (j,), unit, turn * unit[j]))
    exchanges = [
        Alternative("load_and_target_exchanged", (), unit, none, t)
        for t in range(min(targets, _MOST_TARGETS))
    ]
    return (*mistakes, *exchanges)


@lru_cache
def _joint_maps(kinds: tuple[JointKind, ...]) -> tuple[Alternative, ...]:
    """Return joint maps: the signs of some joints reversed, the third joint coupled to the second or not."""
    n, maps = len(kinds), list[Alternative]()
    unit, couplings = np.eye(n), (0.0, 1.0, -1.0) if kinds[1] == kinds[2] else (0.0,)
    for coupling, signs in product(couplings, product((1.0, -1.0), repeat=n)):
        concerned = {*np.flatnonzero(np.array(signs) < 0.0).tolist()}
        if len(concerned) + abs(coupling) > 1:
            joints = tuple(sorted(concerned | ({1, 2} if coupling else set())))
            matrix = np.diag(signs) @ (unit + coupling * np.outer(unit[2], unit[1]))
            maps.append(Alternative("joint_map", joints, matrix, np.zeros(n)))
    return tuple(maps)


def _rows(
    robot: Robot, given: Measurements, alternatives: Sequence[Alternative]
) -> tuple[FloatArray, FloatArray]:
    """Build the whitened rows (K + 1, R, n + 1) [A d] of the set as given, then of each alternative.

    Their Gram matrices (K + 1, n + 1, n + 1) follow.
    """
    count, times = len(given), len(alternatives) + 1
    matrices = np.array([np.eye(robot.n), *(each.matrix for each in alternatives)])
    offsets = np.array([np.zeros(robot.n), *(each.offset for each in alternatives)])
    joints = (given.joints @ matrices.transpose(0, 2, 1) + offsets[:, None]).reshape(times * count, -1)
    at = Configurations(robot, robot.joint_map.model_angles(joints))
    stacked = given[np.tile(np.arange(count), times)]
    load_point, position = stacked.load_point.copy(), stacked.position.copy()
    places = places_on_flange(given, at.flange_rotation[:count], at.flange_translation[:count])
    for k, t in enumerate((each.target for each in alternatives), 1):
        if t is not None:
            part = slice(k * count, (k + 1) * count)
            load_point[part] = places[:, t]
            position[part, t] = np.where(given.in_flange[:, t, None], given.load_point, given.position[:, t])
    block = unloaded_block(
        robot, at, replace(stacked, joints=joints, load_point=load_point, position=position)
    )
    rows = whitened_rows(block, [JOINTS], np.zeros(robot.n)).targets.reshape(times, -1, robot.n + 1)
    return rows, rows.transpose(0, 2, 1) @ rows


def places_on_flange(part: Measurements, rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Compute places (N, T, 3) of targets on a flange (N, 3, 3), (N, 3) [m]: given, or means of the read."""
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
