"""The choice of readings among candidates, stated as data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design.candidates import Atoms, Candidates, ScaledCandidates
from jointstiff.solver.design.criteria import Criterion
from jointstiff.solver.errors import RequestError

_NO_INFORMATION: Final = 1e-12
"""Least eigenvalue of the information of everything, with columns of unit norm, that is not rounding."""


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """Choice of readings among candidates."""

    candidates: Candidates  #: N of p parameters
    criterion: Criterion  #: by which designs are compared
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
                f"{self.readings} readings of {len(self.candidates)} candidates, each at most once",
                where="readings",
                remedy="ask for at least one reading, and for fewer readings or more candidates",
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
            ScaledCandidates(self.candidates, unit),
            self.criterion.scaled(unit),
            self.readings,
            self.base * np.outer(unit, unit),
            self.once,
        )
