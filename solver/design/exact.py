"""Exact designs: a list of n readings near the optimal weights, with the bound that the weights proved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.design.candidates import Atoms, Candidates
from jointstiff.solver.design.optimum import Design
from jointstiff.solver.design.problem import DesignProblem, Distinct, list_efficiency
from jointstiff.solver.errors import RequestError

_POOL: Final = 4_000
"""Candidates of the best prices among which readings are exchanged."""
_TRIED: Final = 8
"""Best-priced candidates whose exchange is evaluated exactly."""
_EXCHANGES: Final = 600
"""Exchanges tried in one search: 30 passes over a list of 20. A long list is near its optimum at once."""
_RESTARTED: Final = 160
"""Readings of all restarts, at each of which a third of the list is drawn anew: short lists need most."""
_MOST_RESTARTS: Final = 16
_LONG: Final = 60
"""Readings of a list for which that gains nothing."""
_MANY: Final = 30
"""Parameters above which restarts cost more than a plan gains: elastic links as a nuisance."""
_IMPROVES: Final = 1.0 + 1e-10


@dataclass(frozen=True, eq=False)
class ExactDesign:
    """A list of readings."""

    atoms: Atoms  #: (n,) candidates with their loads, in the order in which they were found
    matrix: FloatArray  #: (p, p) information of earlier readings, priors and the list
    #: share that it has, at least, of the greatest φ of all lists of n readings which obey the same rules,
    #: proved by sweeps over all candidates
    efficiency: float


def exact_design(problem: DesignProblem, design: Design, distinct: Distinct, *, seed: int = 0) -> ExactDesign:
    """Find a list of n readings, from optimal weights.

    Readings are taken one by one, the weights standing in for those to come; then each is exchanged for
    others as long as φ grows.

    Args:
        problem: the choice.
        design: optimal weights of it.
        distinct: which postures go together; with `problem.once` a candidate never comes twice.
        seed: of the restarts.

    Raises:
        RequestError: there are not as many distinct postures.
    """
    search = _Search(problem, design, distinct)
    best = search.improved(search.rounded([]))
    random = np.random.default_rng(seed)
    restarts = min(_MOST_RESTARTS, _RESTARTED // problem.readings)
    if problem.readings >= _LONG or problem.parameters > _MANY:
        restarts = 0
    for _ in range(restarts):
        kept = random.permutation(problem.readings)[: -(-2 * problem.readings // 3)]
        trial = search.improved(search.rounded([best[i] for i in kept]))
        best = max(best, trial, key=lambda atoms: search.value(search.matrix(atoms)))
    atoms, M = Atoms.of(best), search.matrix(best)
    return ExactDesign(atoms, M, list_efficiency(problem, distinct, M, design.matrix, design.bound))


class _Search:
    """Exchange of readings in one problem."""

    def __init__(self, problem: DesignProblem, design: Design, distinct: Distinct) -> None:
        scaled = problem.scaled
        self._squares = np.outer(problem.unit, problem.unit)
        self._criterion, self._base = scaled.criterion, scaled.base
        self._readings, self._once = problem.readings, problem.once
        self._expected = (design.matrix - problem.base) * self._squares / problem.readings
        self._all, self._distinct = scaled.candidates, distinct
        prices = design.bound.prices
        self._pool: IndexArray = np.sort(np.argsort(-prices)[: max(_POOL, 4 * problem.readings)])
        self._candidates: Candidates = self._all[self._pool]

    def value(self, M: FloatArray) -> float:
        """Return φ of an information matrix in the problem's own units."""
        return self._criterion.information(M * self._squares)

    def matrix(self, atoms: list[Atoms]) -> FloatArray:
        """Return M0 + Σ K_i (p, p) in the problem's own units."""
        total: FloatArray = (self._base + sum(self._scaled(each) for each in atoms)) / self._squares
        return total

    def rounded(self, kept: list[Atoms]) -> list[Atoms]:
        """Complete a list, the reading of the best price after the other."""
        atoms = list(kept)
        M = self._base + sum((self._scaled(each) for each in atoms), np.zeros(self._base.shape))
        taken = self._conflicts(atoms)
        while len(atoms) < self._readings:
            G = self._criterion.support(M + (self._readings - len(atoms)) * self._expected)
            new = self._cheapest(G, taken, atoms)
            atoms.append(new)
            M = M + self._scaled(new)
            taken = taken + self._conflicts([new])
        return atoms

    def improved(self, atoms: list[Atoms]) -> list[Atoms]:
        """Exchange one reading at a time while φ grows."""
        found = list(atoms)
        near = [self._conflicts([each]) for each in found]
        taken = np.sum(near, axis=0)
        M = self._base + sum(self._scaled(each) for each in found)
        for _ in range(max(2, _EXCHANGES // self._readings)):
            before = value = self._criterion.information(M)
            for i in range(len(found)):
                rest = M - self._scaled(found[i])
                new = self._better(rest, taken - near[i], value, M)
                if new is None:
                    continue
                M = rest + self._scaled(new)
                taken, found[i] = taken - near[i], new
                near[i] = self._conflicts([new])
                taken, value = taken + near[i], self._criterion.information(M)
            if value <= _IMPROVES * before:
                break
        return found

    def _better(self, rest: FloatArray, taken: IndexArray, value: float, M: FloatArray) -> Atoms | None:
        """Return a candidate that adds more to the others than the one left out; None if none does."""
        at = rest if self._criterion.information(rest) > 1e-6 * value else M
        G = self._criterion.support(at)
        prices = np.where(taken > 0, -np.inf, self._candidates.prices(G))
        tried = np.argsort(-prices)[:_TRIED]
        tried = tried[np.isfinite(prices[tried])]
        if not len(tried):
            return None
        atoms = self._candidates.atoms(tried, G)
        values = [self._criterion.information(rest + K) for K in atoms.information]
        best = int(np.argmax(values))
        if values[best] <= _IMPROVES * value:
            return None
        return self._own(Atoms(self._pool[atoms.index], atoms.force, atoms.information)[np.array([best])])

    def _cheapest(self, G: FloatArray, taken: IndexArray, found: list[Atoms]) -> Atoms:
        """Return the candidate of the best price that is distinct from all found."""
        prices = np.where(taken > 0, -np.inf, self._candidates.prices(G))
        best = self._pool[int(np.argmax(prices))]
        if not np.isfinite(prices.max()):
            free = np.ones(len(self._all), dtype=np.bool_)
            for each in found:
                free &= ~self._excluded(each, slice(None))
            if not free.any():
                raise RequestError(
                    f"only {len(found)} candidates are in postures {np.degrees(self._distinct.angle):.3g}° "
                    f"apart, but {self._readings} readings are requested",
                    where="distinct_angle",
                    remedy="ask for fewer readings, a smaller angle, or more candidates",
                )
            best = int(np.argmax(np.where(free, self._all.prices(G), -np.inf)))
        return self._own(self._all.atoms(np.array([best]), G))

    def _conflicts(self, atoms: list[Atoms]) -> IndexArray:
        """Return how many of some readings each candidate of the pool does not go with."""
        count = np.zeros(len(self._pool), dtype=np.intp)
        for each in atoms:
            count += self._excluded(each, self._pool)
        return count

    def _excluded(self, atom: Atoms, index: IndexArray | slice) -> BoolArray:
        own = int(atom.index[0])
        excluded = self._distinct.near(self._distinct.postures[own], index)
        if self._once:
            excluded = excluded | (np.arange(len(self._all))[index] == own)
        return excluded

    def _scaled(self, atom: Atoms) -> FloatArray:
        information: FloatArray = atom.information[0] * self._squares
        return information

    def _own(self, atom: Atoms) -> Atoms:
        """Return an atom in the problem's own units."""
        return Atoms(atom.index, atom.force, atom.information / self._squares)
