"""Proof of what a design reaches: a sweep over all candidates, from their rows (method.md §10)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design.distinct import Distinct
from jointstiff.solver.design.problem import DesignProblem

_MIXTURES: Final = (0.5, 0.75, 0.9, 1.0)
"""Shares of a list's information in the matrices at which its bound is sought."""


@dataclass(frozen=True, eq=False)
class Bound:
    """Bound on the information of every design of a problem."""

    efficiency: float  #: φ of the design at hand over the bound: its share of the greatest possible, at least
    support: FloatArray  #: (p, p) G, with ``φ(M′) ≤ ⟨G, M′⟩`` for all M′
    prices: FloatArray  #: (N,) greatest ``⟨G, K_i⟩`` of each candidate


def bound_of(problem: DesignProblem, M: FloatArray, dual: FloatArray | None = None) -> Bound:
    """Bound what any weights of the candidates can reach.

    ``φ(M′) ≤ ⟨G, M0⟩ + n Σ w′_i ⟨G, K_i⟩``: the greatest price in place of the mean, or, where each
    candidate may be read once, the mean of the n greatest. It holds for any M; the better M, the sharper.

    Args:
        problem: the choice.
        M: (p, p) positive definite, information of a design.
        dual: of the criterion, as for `Criterion.support`.
    """
    support = problem.criterion.support(M, dual)
    prices = problem.candidates.prices(support)
    upper = float((support * problem.base).sum()) + problem.readings * _best_mean(problem, prices)
    return Bound(min(1.0, problem.criterion.information(M) / upper), support, prices)


def list_efficiency(
    problem: DesignProblem, distinct: Distinct, M: FloatArray, optimum: FloatArray, bound: Bound
) -> float:
    """Bound the share that a list has of the greatest φ of all lists which obey the same rules.

    Any supporting matrix proves a bound; those of mixtures of the list and the optimal weights are tried.

    Args:
        problem: the choice.
        distinct: which postures go together.
        M: (p, p) information with the list.
        optimum: (p, p) information with the optimal weights.
        bound: of the optimal weights.
    """
    upper = _upper_of_lists(problem, distinct, bound.support, bound.prices)
    for share in _MIXTURES:
        support = problem.criterion.support(share * M + (1.0 - share) * optimum)
        prices = problem.candidates.prices(support)
        upper = min(upper, _upper_of_lists(problem, distinct, support, prices))
    return min(1.0, problem.criterion.information(M) / upper)


def _upper_of_lists(
    problem: DesignProblem, distinct: Distinct, support: FloatArray, prices: FloatArray
) -> float:
    """Return a bound on φ of all lists, by one supporting matrix and its prices."""
    mean = min(_best_mean(problem, prices), distinct.best_mean(prices, problem.readings))
    return float((support * problem.base).sum()) + problem.readings * mean


def _best_mean(problem: DesignProblem, prices: FloatArray) -> float:
    """Return the greatest weighted mean of the prices that the limit on weights allows."""
    if not problem.once:
        return float(prices.max())
    n = problem.readings
    return float(np.partition(prices, len(prices) - n)[-n:].mean())
