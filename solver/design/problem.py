"""The choice of readings among candidates, as data, and proof of what a design reaches (method.md §10).

A sweep over all candidates proves it, from their rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.design.candidates import Atoms, Candidates
from jointstiff.solver.design.criteria import Criterion
from jointstiff.solver.errors import RequestError

_NO_INFORMATION: Final = 1e-12
"""Least eigenvalue of the information of everything, with columns of unit norm, that is not rounding."""


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """Choice of readings among candidates."""

    candidates: Candidates  #: N of p parameters
    criterion: Criterion  #: criterion by which designs are compared
    readings: int  #: n, how many are to be taken
    base: FloatArray  #: M0 (p, p), information of earlier readings and of priors; zero for none
    once: bool = False  #: whether a candidate may be read once only, so that no weight exceeds 1/n

    @property
    def parameters(self) -> int:
        """Return p."""
        return self.candidates.parameters

    @property
    def limit(self) -> float:
        """Return the greatest weight of a candidate."""
        return 1.0 / self.readings if self.once else 1.0

    def matrix(self, atoms: Atoms, weights: FloatArray) -> FloatArray:
        """Return M0 + n Σ w_i K_i (p, p)."""
        total: FloatArray = self.base + self.readings * np.tensordot(weights, atoms.information, axes=1)
        return total

    @cached_property
    def unit(self) -> FloatArray:
        """Return the units (p,) that bring the columns to comparable norms.

        Raises:
            RequestError: candidates and priors together do not determine the parameters, or the readings are
                more than the candidates.
        """
        if self.readings < 1 or (self.once and self.readings > len(self.candidates)):
            raise RequestError(
                f"{self.readings} readings are requested of {len(self.candidates)} candidates, each at most "
                "once",
                where="readings",
                remedy="request at least one reading and at most as many as there are candidates, or give "
                "more candidates",
            )
        share = self.readings / len(self.candidates)
        total = self.base + share * self.candidates.total()
        diagonal = np.diagonal(total)
        unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        values = np.linalg.eigvalsh(total * np.outer(unit, unit))
        if values[0] < _NO_INFORMATION * values[-1]:
            missing = np.flatnonzero(diagonal <= 0.0).tolist()
            raise RequestError(
                f"all candidates together determine {int((values > _NO_INFORMATION * values[-1]).sum())} of "
                f"{len(values)} parameters" + (f"; nothing excites parameter {missing}" if missing else ""),
                where="candidates",
                remedy="add loads or postures that excite the others, or leave these parameters out",
            )
        return unit

    @cached_property
    def scaled(self) -> DesignProblem:
        """Return the same choice with columns of comparable norms.

        Raises:
            RequestError: as for `unit`.
        """
        unit = self.unit
        return DesignProblem(
            self.candidates.scaled(unit),
            self.criterion.scaled(unit),
            self.readings,
            self.base * np.outer(unit, unit),
            self.once,
        )


_PARTITIONS: Final = 8
"""Partitions of the postures into cells that are tried; each gives a bound, and the sharpest counts."""
_LOOKED_AT: Final = 4_000
"""Candidates of the best prices whose cells are compared; the others are bounded by the last of them."""
_INSIDE: Final = 1.0 - 1e-9
"""Share of the angle that a cell is wide, so that rounding puts no two distinct postures into one."""


@dataclass(frozen=True, eq=False)
class Distinct:
    """Rule that no two readings are taken in nearly the same posture."""

    postures: FloatArray  #: (N, n) joint angles of the candidates [rad]
    #: two postures are distinct if the angle of a joint differs by at least this [rad]; zero lets a
    #: candidate be read again
    angle: float

    def near(self, posture: FloatArray, index: IndexArray | slice) -> BoolArray:
        """Return which of some candidates are not distinct from a posture (n,)."""
        if self.angle <= 0.0:
            return np.zeros(len(self.postures[index]), dtype=np.bool_)
        near: BoolArray = np.abs(self.postures[index] - posture).max(axis=1) < self.angle
        return near

    def best_mean(self, prices: FloatArray, count: int) -> float:
        """Bound the mean price of any list of distinct readings.

        Two postures in one cell of a grid narrower than the angle are not distinct, so a list has at most one
        reading of each cell: the mean of the greatest prices of as many cells bounds it, whatever the grid.

        Args:
            prices: (N,).
            count: readings in a list.
        """
        if self.angle <= 0.0:
            return float(prices.max())
        top = np.argsort(-prices)[: max(_LOOKED_AT, 10 * count)]
        random = np.random.default_rng(0)
        shifts = self.angle * random.random((_PARTITIONS, self.postures.shape[1]))
        return min(self._mean_of_cells(top, prices[top], count, shift) for shift in shifts)

    def _mean_of_cells(self, top: IndexArray, prices: FloatArray, count: int, shift: FloatArray) -> float:
        """Return the mean of the greatest prices of cells; top are candidates by falling price."""
        cells = np.floor((self.postures[top] + shift) / (_INSIDE * self.angle)).astype(np.int64)
        seen: set[bytes] = set()
        total = 0.0
        for cell, price in zip(cells, prices.tolist(), strict=True):
            if (key := cell.tobytes()) not in seen:
                seen.add(key)
                total += price
                if len(seen) == count:
                    return float(total) / count
        rest = float(prices[-1]) if len(top) < len(self.postures) else 0.0
        return float(total + (count - len(seen)) * rest) / count


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
