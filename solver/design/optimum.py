"""Optimal weights of candidate readings, by fully corrective column generation (method.md §10).

    maximise φ(M0 + n Σ w_i K_i)  subject to  Σ w_i = 1,  0 ≤ w_i ≤ limit

A few candidates are held and their weights are optimal. One sweep prices all candidates; the best ones join,
those of weight zero leave. The same sweep bounds what any weights can reach, and ends the search.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.design.candidates import Atoms
from jointstiff.solver.design.criteria import EOptimality, GOptimality, SmoothCriterion
from jointstiff.solver.design.newton import optimal_weights, worst_place_weights
from jointstiff.solver.design.problem import Bound, DesignProblem, bound_of
from jointstiff.solver.errors import SolverError

GAP: Final = 1e-9
"""At which the search ends where the criterion is smooth and loads are given."""
LOOSE_GAP: Final = 1e-5
"""The same for E and G, which an interior point solves, and for forces whose direction is free."""

_START: Final = 12
"""Readings chosen greedily to begin with."""
_SAMPLE: Final = 2_000
"""Candidates among which these are sought."""
_AT_ONCE: Final = 50_000
"""Candidates above twice which the search begins among some of them."""
_COARSE_GAP: Final = 1e-6
"""Gap at which that search ends."""
_ADDED: Final = 20
"""Candidates that join in a round."""
_ROUNDS: Final = 200
_PROGRESS: Final = 0.9
"""Ratio of gaps of two rounds that is progress."""
_STALLED: Final = 4
"""Rounds without progress after which rounding is taken to keep the gap open."""
_STALLED_GAP: Final = 1e-3
"""Gap that is then accepted; the bound says what it is."""
_CONES: Final = 12
"""Parameters up to which the program of the worst place, a cone for each place, is solved as one."""
_NO_WEIGHT: Final = 1e-13
_SINGULAR: Final = 1e-11
"""Ratio of eigenvalues below which information is taken to determine fewer parameters."""
_PROMISING: Final = 0.999
"""Share of the least price among those held at which a candidate may join."""


@dataclass(frozen=True, eq=False)
class Design:
    """Weights of candidates, with a bound on what any others could reach."""

    atoms: Atoms  #: (k,) candidates with a weight, and their loads
    weights: FloatArray  #: (k,) shares of the readings; they sum to 1
    matrix: FloatArray  #: (p, p) information M of all readings
    bound: Bound  #: from one sweep over all candidates


def optimise(problem: DesignProblem, tolerance: float | None = None) -> Design:
    """Find optimal weights.

    Args:
        problem: the choice.
        tolerance: gap at which the search ends; `GAP` or `LOOSE_GAP` if None.

    Raises:
        RequestError: the candidates do not determine the parameters.
        SolverError: the gap does not close.
    """
    if tolerance is None:
        smooth = isinstance(problem.criterion, SmoothCriterion) and not problem.candidates.free
        tolerance = GAP if smooth else LOOSE_GAP
    return _in_own_units(problem, *_generated(problem.scaled, tolerance))


def _generated(problem: DesignProblem, tolerance: float) -> tuple[Atoms, FloatArray, Bound]:
    """Generate columns until the gap closes; of many candidates first among some, which saves sweeps."""
    held, weights = _start(problem, tolerance)
    best: tuple[Atoms, FloatArray, Bound] | None = None
    efficiency, stalled = 0.0, 0
    for _ in range(_ROUNDS):
        weights, dual = _solve_held(problem, held, weights)
        bound = bound_of(problem, problem.matrix(held, weights), dual)
        kept = weights > _NO_WEIGHT
        held, weights = held[np.flatnonzero(kept)], weights[kept]
        stalled += 1
        if best is None or bound.efficiency > efficiency:
            stalled = 0 if 1.0 - bound.efficiency < _PROGRESS * (1.0 - efficiency) else stalled
            best, efficiency = (held, weights, bound), bound.efficiency
        accepted = tolerance if stalled < _STALLED else _STALLED_GAP
        if 1.0 - efficiency <= accepted:
            return best
        new = problem.candidates.atoms(_entering(problem, bound.prices, held.index), bound.support)
        held, weights = held.joined(new), np.concatenate([weights, np.zeros(len(new))])
    raise SolverError(f"the design did not converge: its gap is {1.0 - efficiency:.1e}")


def _start(problem: DesignProblem, tolerance: float) -> tuple[Atoms, FloatArray]:
    """Return candidates with weights to begin with."""
    step = len(problem.candidates) // _AT_ONCE
    if step > 1:
        coarse = replace(problem, candidates=problem.candidates[::step])
        if _determined(coarse.base + coarse.candidates.total()):
            held, weights, _ = _generated(coarse, max(tolerance, _COARSE_GAP))
            return Atoms(step * held.index, held.force, held.information), weights
    # Add candidates until all parameters are determined, as those that were sampled may lack a rare one
    held = _greedy(problem)
    for _ in range(problem.parameters):
        M = problem.matrix(held, np.full(len(held), 1.0 / len(held)))
        if _determined(M):
            break
        unseen = np.linalg.eigh(M)[1][:, 0]
        G = np.outer(unseen, unseen)
        best = np.array([int(np.argmax(problem.candidates.prices(G)))])
        held = held.joined(problem.candidates.atoms(best, G))
    return held, np.full(len(held), 1.0 / len(held))


def _determined(M: FloatArray) -> bool:
    values = np.linalg.eigvalsh(M)
    return bool(values[0] > _SINGULAR * values[-1])


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
    from jointstiff.solver.convex import programs  # takes a second to import

    if isinstance(criterion, EOptimality):
        return programs.worst_direction(problem.base, K, criterion.metric, problem.limit)
    if isinstance(criterion, GOptimality):
        if len(problem.base) > _CONES:
            return worst_place_weights(criterion, problem.base, K, weights, problem.limit)
        return programs.worst_place(problem.base, K, criterion.places, problem.limit)
    raise NotImplementedError(type(criterion))


def _greedy(problem: DesignProblem) -> Atoms:
    """Choose readings one after the other by their price, among evenly spread candidates."""
    count = max(_START, problem.parameters, problem.readings if problem.once else 0)
    step = max(1, len(problem.candidates) // _SAMPLE)
    sample = problem.candidates[::step]
    M = problem.base + 0.01 * problem.readings / len(sample) * sample.total()
    M = M + 1e-6 * np.trace(M) / len(M) * np.eye(len(M))
    atoms: list[Atoms] = []
    share = problem.readings / count
    free = np.ones(len(sample), dtype=np.bool_)
    for _ in range(min(count, len(sample))):
        G = problem.criterion.support(M)
        best = np.array([int(np.argmax(np.where(free, sample.prices(G), -np.inf)))])
        free[best] = False
        atom = sample.atoms(best, G)
        M = M + share * atom.information[0]
        atoms.append(Atoms(step * atom.index, atom.force, atom.information))
    return Atoms.of(atoms)


def _entering(problem: DesignProblem, prices: FloatArray, held: IndexArray) -> IndexArray:
    """Return the candidates of the best prices that are not held; with free forces also those that are."""
    promising = np.flatnonzero(prices >= _PROMISING * prices[held].min())
    if not problem.candidates.free:
        promising = promising[~np.isin(promising, held)]
    best: IndexArray = promising[np.argsort(-prices[promising])[:_ADDED]]
    return best
