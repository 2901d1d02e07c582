"""Optimal weights of candidate readings, by fully corrective column generation (method.md §10).

    maximise φ(M0 + n Σ w_i K_i)  subject to  Σ w_i = 1,  0 ≤ w_i ≤ limit

A few candidates are held and their weights are optimal. One sweep prices all candidates; the best ones join,
those of weight zero leave. The same sweep bounds what any weights can reach, and ends the search.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.convex import best_for_worst_direction, best_for_worst_place
from jointstiff.solver.design.candidates import Atoms
from jointstiff.solver.design.certificate import Bound, bound_of
from jointstiff.solver.design.criteria import EOptimality, GOptimality, SmoothCriterion
from jointstiff.solver.design.newton import optimal_weights
from jointstiff.solver.design.problem import DesignProblem
from jointstiff.solver.errors import SolverError

GAP: Final = 1e-9
"""At which the search ends where the criterion is smooth and loads are given."""
LOOSE_GAP: Final = 1e-5
"""The same for E and G, which an interior point solves, and for forces whose direction is free."""

_START: Final = 12
"""Readings chosen greedily to begin with."""
_SAMPLE: Final = 2_000
"""Candidates among which these are sought."""
_ADDED: Final = 10
"""Candidates that join in a round."""
_ROUNDS: Final = 200
_NO_WEIGHT: Final = 1e-13


@dataclass(frozen=True, eq=False)
class Design:
    """Weights of candidates, with a bound on what any others could reach.

    Attributes:
        atoms: (k,) candidates with a weight, and their loads.
        weights: (k,) shares of the readings; they sum to 1.
        matrix: (p, p) information M of all readings.
        bound: from one sweep over all candidates.
    """

    atoms: Atoms
    weights: FloatArray
    matrix: FloatArray
    bound: Bound


def optimise(problem: DesignProblem, tolerance: float | None = None) -> Design:
    """Find optimal weights.

    Args:
        problem: the choice.
        tolerance: gap at which the search ends; `GAP` or `LOOSE_GAP` if None.

    Returns:
        The design with its certificate.

    Raises:
        RequestError: the candidates do not determine the parameters.
        SolverError: the gap does not close.
    """
    scaled = problem.scaled
    if tolerance is None:
        smooth = isinstance(problem.criterion, SmoothCriterion) and not problem.candidates.free
        tolerance = GAP if smooth else LOOSE_GAP
    held = _greedy(scaled)
    weights = np.full(len(held), 1.0 / len(held))
    efficiency = 0.0
    for _ in range(_ROUNDS):
        weights, dual = _solve_held(scaled, held, weights)
        M = scaled.matrix(held, weights)
        bound = bound_of(scaled, M, dual)
        efficiency = bound.efficiency
        kept = weights > _NO_WEIGHT
        held, weights = held[np.flatnonzero(kept)], weights[kept]
        if 1.0 - efficiency <= tolerance:
            return _in_own_units(problem, held, weights, bound)
        new = scaled.candidates.atoms(_entering(problem, bound.prices, held.index), bound.support)
        held, weights = held.joined(new), np.concatenate([weights, np.zeros(len(new))])
    raise SolverError(
        f"the gap of the design is {1.0 - efficiency:.1e} and does not close",
        remedy="report this with the request",
    )


def _in_own_units(problem: DesignProblem, held: Atoms, weights: FloatArray, bound: Bound) -> Design:
    """Return a design of the scaled problem in the units of the problem itself."""
    squares = np.outer(problem.unit, problem.unit)
    atoms = Atoms(held.index, held.force, held.information / squares)
    M = problem.matrix(atoms, weights)
    # Units change the information of D-optimality by a factor.
    factor = problem.criterion.information(M) / problem.scaled.criterion.information(M * squares)
    own = Bound(bound.efficiency, factor * bound.support * squares, factor * bound.prices)
    return Design(atoms, weights, M, own)


def _solve_held(
    problem: DesignProblem, held: Atoms, weights: FloatArray
) -> tuple[FloatArray, FloatArray | None]:
    """Return optimal weights of the candidates held, and the dual variable where the criterion has one."""
    criterion, K = problem.criterion, problem.readings * held.information
    if isinstance(criterion, SmoothCriterion):
        return optimal_weights(criterion, problem.base, K, weights, problem.limit), None
    if isinstance(criterion, EOptimality):
        return best_for_worst_direction(problem.base, K, criterion.metric, problem.limit)
    if isinstance(criterion, GOptimality):
        return best_for_worst_place(problem.base, K, criterion.places, problem.limit)
    raise NotImplementedError(type(criterion))


def _greedy(problem: DesignProblem) -> Atoms:
    """Choose readings one after the other by their price, among evenly spread candidates."""
    count = max(_START, problem.parameters, problem.readings if problem.once else 0)
    step = max(1, len(problem.candidates) // max(_SAMPLE, 4 * count))
    sample = problem.candidates[::step]
    M = problem.base + 0.01 * problem.readings / len(sample) * sample.total()
    M = M + 1e-6 * np.trace(M) / len(M) * np.eye(len(M))
    found: list[Atoms] = []
    share = problem.readings / count
    free = np.ones(len(sample), dtype=np.bool_)
    for _ in range(min(count, len(sample))):
        G = problem.criterion.support(M)
        best = np.array([int(np.argmax(np.where(free, sample.prices(G), -np.inf)))])
        free[best] = False
        atom = sample.atoms(best, G)
        M = M + share * atom.information[0]
        found.append(Atoms(step * atom.index, atom.force, atom.information))
    return Atoms.of(found)


def _entering(problem: DesignProblem, prices: FloatArray, held: IndexArray) -> IndexArray:
    """Return the candidates of the best prices that are not held; with free forces also those that are."""
    count = _ADDED
    if not problem.candidates.free:
        prices = prices.copy()
        prices[held] = -np.inf
        count = min(_ADDED, len(prices) - len(held))
    if count >= len(prices):
        return np.arange(len(prices))
    best: IndexArray = np.argpartition(prices, -count)[-count:] if count else np.array([], dtype=np.intp)
    return best
