"""Plans made in other ways, for comparison: at random, or by the best next reading each time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design.problem import DesignProblem, Distinct

_RANDOM_PLANS: Final = 20


@dataclass(frozen=True, eq=False)
class OtherPlan:
    """A plan of as many readings made in another way."""

    efficiency: float  #: φ relative to the plan's
    uncertainty: FloatArray  #: (s,) standard uncertainty of each joint's relative compliance


def random_plans(problem: DesignProblem, M: FloatArray, s: int, seed: int) -> OtherPlan:
    """Return the mean of random plans of the same candidates."""
    random = np.random.default_rng([seed, 2])
    n, values, variances = problem.readings, [], []
    for _ in range(_RANDOM_PLANS):
        index = random.integers(0, len(problem.candidates), n)
        other = problem.base + problem.candidates.under(index, drawn_directions(random, n)).information.sum(
            axis=0
        )
        values.append(problem.criterion.information(other))
        variances.append(np.square(uncertainty_of(other, s)))
    efficiency = float(np.mean(values)) / problem.criterion.information(M)
    return OtherPlan(efficiency, np.sqrt(np.mean(variances, axis=0)))


def one_at_a_time(problem: DesignProblem, distinct: Distinct, M: FloatArray, s: int) -> OtherPlan:
    """Return the plan in which each reading is the best next one by its price."""
    other = problem.base.copy()
    share = 1e-6 * (M - problem.base)
    free = np.ones(len(problem.candidates), dtype=np.bool_)
    for _ in range(problem.readings):
        G = problem.criterion.support(other + share)
        best = np.array([int(np.argmax(np.where(free, problem.candidates.prices(G), -np.inf)))])
        other = other + problem.candidates.atoms(best, G).information[0]
        free &= ~distinct.near(distinct.postures[best[0]], slice(None))
    efficiency = problem.criterion.information(other) / problem.criterion.information(M)
    return OtherPlan(efficiency, uncertainty_of(other, s))


def uncertainty_of(M: FloatArray, s: int) -> FloatArray:
    """Return the standard uncertainties of the first parameters (s,); inf where M does not determine them."""
    unit = 1.0 / np.sqrt(np.where(np.diagonal(M) > 0.0, np.diagonal(M), 1.0))
    values, vectors = np.linalg.eigh(M * np.outer(unit, unit))
    null = values <= 1e-12 * max(values[-1], 1e-300)
    free = np.square(vectors[:s, null]).sum(axis=1) > 1e-9
    variance = np.square(vectors[:s, ~null]) @ (1.0 / values[~null])
    return np.where(free, np.inf, unit[:s] * np.sqrt(variance))


def drawn_directions(random: np.random.Generator, count: int) -> FloatArray:
    """Draw unit vectors (count, 3)."""
    draws = random.standard_normal((count, 3))
    unit: FloatArray = draws / np.linalg.norm(draws, axis=1, keepdims=True)
    return unit
