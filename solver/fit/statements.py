"""Statements: what is stated or assumed of the load and of places, as rows of the fit (method.md §8).

A load point that is stated to 1 mm, or assumed to 10 mm, joins the fit as three unknowns that all
observations share, each with one more row: the unknown is zero, within its standard uncertainty. So the
readings correct a statement as far as they know better, and χ², intervals and budgets account for both.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.prior import Prior
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.block import BlockRows, Term
from jointstiff.solver.mechanics.measurements import CommonUncertainty

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
        """Return the priors of errors and compliances as q rows [A B d] of a least-squares problem.

        An error v, in units of its standard uncertainty, has the row ``σ v = 0``. A joint with a prior
        c₀ ± s₀ of its compliance has the row ``σ c / s₀ = σ c₀ / s₀``. The factor σ gives these rows the
        weight of a reading with standard uncertainty σ.

        Args:
            compliances: number P of columns A of compliances, those of the n joints first.
            errors: number K of columns B of errors.

        Returns:
            (q, P + K + 1) rows: K of the errors, then those of the joints with a prior.
        """
        width = compliances + errors + 1
        error_rows = np.zeros((errors, width))
        error_rows[:, compliances:-1] = self.sigma * np.eye(errors)
        if self.prior is None:
            return error_rows
        joints = np.arange(len(self.prior.mean))
        prior_matrix, prior_values = self.prior.in_units_of(self.sigma).rows(joints)
        prior_rows = np.zeros((len(prior_matrix), width))
        prior_rows[:, joints] = prior_matrix
        prior_rows[:, -1] = prior_values
        return np.vstack([error_rows, prior_rows])

    def generate(
        self, rows: Rows, before: Sequence[Term] = (), *, whitened: bool = True
    ) -> Iterator[BlockRows]:
        """Yield the rows [A B d] of readings d, some thousand observations at a time.

        B are the columns of these terms, whose unknowns are in units of their standard uncertainties.

        Args:
            rows: N observations.
            before: terms of the columns A, whose unknowns keep their own units.
            whitened: whether the rows are scaled, so that the noise of each row has variance sigma².
        """
        if not self.terms:  # all unknowns keep their own units
            yield from rows.generate(before, self.compliance, whitened=whitened)
            return
        terms = [*before, *self.terms]
        for block_rows in rows.generate(terms, self.compliance, whitened=whitened):
            units = self._list_units(block_rows.widths)
            yield block_rows.scale(units)

    @cached_property
    def _uncertainties(self) -> dict[str, tuple[float, ...]]:
        """Standard uncertainties of the unknowns of each term, by the term's name."""
        return {term.name: term.prior(self.common) for term in self.terms}

    def _list_units(self, widths: Mapping[str, int]) -> FloatArray:
        """Return the unit of each unknown: its standard uncertainty if its term is among these, else 1.

        `widths` has the number of unknowns of each term by the term's name, K together. The result (K + 1,)
        ends with 1 for the column of readings.
        """
        units = list[FloatArray]()
        for name, width in widths.items():
            uncertainty_of_term = self._uncertainties.get(name, (1.0,))
            units.append(np.resize(uncertainty_of_term, width))  # repeated over the term's unknowns
        return np.concatenate([*units, np.ones(1)])


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
        """Return rows [A d − B v] for rows [A B d]: the motion B v by the fitted errors v is subtracted."""
        encoders = of_block.encoders
        if encoders is not None:
            encoders = self._subtract_motion(encoders)
        widths = {name: width for name, width in of_block.widths.items() if name not in self._names}
        return BlockRows(of_block.block, self._subtract_motion(of_block.targets), encoders, widths)

    def compute_motion(self, of_block: BlockRows) -> tuple[FloatArray, FloatArray | None]:
        """Compute by how much the fitted errors move the targets and the encoders of some observations.

        Args:
            of_block: rows of B observations, with the columns of the errors last before the readings.

        Returns:
            (B, T, 3) motion of the T targets, and (B, n) of the encoders or None, in the unit of the rows.
        """
        motion_of_targets = self._move(of_block.targets)
        if of_block.encoders is None:
            return motion_of_targets, None
        return motion_of_targets, self._move(of_block.encoders)

    @property
    def _names(self) -> frozenset[str]:
        return frozenset(term.name for term in self.statements.terms)

    def _move(self, rows: FloatArray) -> FloatArray:
        """Return the motion B v by the fitted errors v, for rows [A B d] with the readings d last."""
        columns_of_errors = rows[..., -1 - len(self.unknowns) : -1]
        return np.asarray(columns_of_errors @ self.unknowns)

    def _subtract_motion(self, rows: FloatArray) -> FloatArray:
        """Return rows [A d − B v] for rows [A B d] and the fitted errors v."""
        before_errors = rows[..., : -1 - len(self.unknowns)]
        remaining_readings = rows[..., -1] - self._move(rows)
        return np.concatenate([before_errors, remaining_readings[..., None]], axis=-1)
