"""Statements: what is stated or assumed of the load and of places, as rows of the fit (method.md §8).

A load point that is stated to 1 mm, or assumed to 10 mm, joins the fit as three unknowns that all
observations share, each with one more row: the unknown is zero, within its standard uncertainty. So the
readings correct a statement as far as they know better, and χ², intervals and budgets account for both.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.prior import Prior
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.block import BlockRows, Term, fitted_errors
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements
from jointstiff.solver.mechanics.terms import FORCE_SCALE, TERMS

LEAST_STATED_SIGMA: Final = 1e-8
"""Least sigma [m] by which statements are weighted: exact readings would make their rows vanish."""


@dataclass(frozen=True, eq=False)
class Statements:
    """Terms whose unknowns are stated as zero, each with a standard uncertainty, and stated compliances."""

    terms: tuple[Term, ...]  #: terms whose unknowns are stated as zero
    common: CommonUncertainty  #: standard uncertainties of the unknowns
    compliance: FloatArray  #: (n,) compliances at which the columns are computed [rad/(N·m)]
    sigma: float  #: standard uncertainty of a coordinate of a reading, the unit of the rows [m]
    prior: Prior | None = None  #: stated compliances of joints; None without any

    @classmethod
    def none(cls, joints: int) -> Statements:
        """Return no statements, for a robot with so many joints."""
        return cls((), CommonUncertainty(), np.zeros(joints), 1.0)

    def build_rows(self, compliances: int, errors: int) -> FloatArray:
        """Return what is stated as rows (q, compliances + errors + 1) like those of readings.

        Args:
            compliances: number of columns of compliances, those of the n joints first.
            errors: number of columns of stated errors, in units of their standard uncertainties.
        """
        rows = np.zeros((errors, compliances + errors + 1))
        rows[:, compliances:-1] = self.sigma * np.eye(errors)
        if self.prior is None:
            return rows
        joints = np.arange(len(self.prior.mean))
        matrix, stated = self.prior.in_units_of(self.sigma).rows(joints)
        of_prior = np.zeros((len(matrix), compliances + errors + 1))
        of_prior[:, joints], of_prior[:, -1] = matrix, stated
        return np.vstack([rows, of_prior])

    def generate(
        self, rows: Rows, before: Sequence[Term] = (), *, whitened: bool = True
    ) -> Iterator[BlockRows]:
        """Yield rows of readings with columns of these terms, in units of the standard uncertainties.

        Args:
            rows: N observations.
            before: terms whose columns come first, in their own units.
            whitened: whether the noise of each row has variance sigma².
        """
        for of_block in rows.generate([*before, *self.terms], self.compliance, whitened=whitened):
            yield of_block.scale(self._list_units(of_block.widths))

    def _list_units(self, widths: Mapping[str, int]) -> FloatArray:
        """Return the units (K + 1,) of columns: standard uncertainties of these terms, else 1."""
        uncertainties = {term.name: term.prior(self.common) for term in self.terms}
        units = [np.resize(uncertainties.get(name, (1.0,)), width) for name, width in widths.items()]
        return np.concatenate([*units, np.ones(1)])  # the last column has the readings


@dataclass(frozen=True, eq=False)
class FittedStatements:
    """Statements together with the values that a fit found for their unknowns."""

    statements: Statements  #: statements with K unknowns
    unknowns: FloatArray  #: (K,) fitted values, in standard uncertainties of the unknowns

    @classmethod
    def none(cls, joints: int) -> FittedStatements:
        """Return no statements, for a robot with so many joints."""
        return cls(Statements.none(joints), np.zeros(0))

    def subtract(self, of_block: BlockRows) -> BlockRows:
        """Return rows of a block without the columns of the statements, whose motion the readings lose."""
        return BlockRows(
            of_block.block,
            self._subtract_motion(of_block.targets),
            None if of_block.encoders is None else self._subtract_motion(of_block.encoders),
            {name: width for name, width in of_block.widths.items() if name not in self._names},
        )

    def predict(self, of_block: BlockRows) -> tuple[FloatArray, FloatArray | None]:
        """Return by how much the fitted errors move the targets and the encoders of a block.

        Returns:
            (B, T, 3) motion of the targets, and (B, n) of the encoders or None, in the unit of the rows.
        """
        encoders = of_block.encoders
        return self._move(of_block.targets), None if encoders is None else self._move(encoders)

    @property
    def _names(self) -> frozenset[str]:
        return frozenset(term.name for term in self.statements.terms)

    def _move(self, rows: FloatArray) -> FloatArray:
        """Return the motion by the fitted errors, whose columns come last before the readings."""
        return np.asarray(rows[..., -1 - len(self.unknowns) : -1] @ self.unknowns)

    def _subtract_motion(self, rows: FloatArray) -> FloatArray:
        """Return rows in which the motion by the fitted errors is subtracted from the readings."""
        remaining = rows[..., -1:] - self._move(rows)[..., None]
        return np.concatenate([rows[..., : -1 - len(self.unknowns)], remaining], axis=-1)


def list_stated_terms(measurements: Measurements) -> tuple[Term, ...]:
    """Return the systematic errors (terms) to fit with the compliances: those of stated standard uncertainty.

    Left out are a common scale of all loads, which readings cannot distinguish from the compliances, and
    errors that an earlier fit has already estimated.
    """
    fitted_names = {term.name for term in fitted_errors(measurements).terms}
    common_uncertainty = measurements.common_uncertainty
    return tuple(
        term
        for term in TERMS.values()
        if any(term.prior(common_uncertainty)) and term.name not in fitted_names and term is not FORCE_SCALE
    )
