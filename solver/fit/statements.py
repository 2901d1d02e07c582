"""Statements: what is stated or assumed of the load and of places, as rows of the fit (method.md §8).

A load point that is stated to 1 mm, or assumed to 10 mm, joins the fit as three unknowns that all
observations share, each with one more row: the unknown is zero, within its standard uncertainty. So the
readings correct a statement as far as they know better, and χ², intervals and budgets account for both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.prior import Prior
from jointstiff.solver.mechanics.block import (
    Motion,
    RegressorBlock,
    Rows,
    Term,
    build_rows,
    build_whitened_rows,
    fitted_errors,
)
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements
from jointstiff.solver.mechanics.springs import JOINTS
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

    def scale(self, rows: Rows) -> Rows:
        """Return rows with the columns of stated terms in units of the standard uncertainties."""
        uncertainties_of_term = {term.name: term.prior(self.common) for term in self.terms}
        # Columns of other terms, and the readings in the last column, keep their unit.
        units = [
            np.resize(uncertainties_of_term.get(name, (1.0,)), width) for name, width in rows.widths.items()
        ]
        unit = np.concatenate([*units, np.ones(1)])
        encoders = None if rows.encoders is None else rows.encoders * unit
        return rows._replace(targets=rows.targets * unit, encoders=encoders)


@dataclass(frozen=True, eq=False)
class FittedStatements:
    """Statements together with the values that a fit found for their unknowns."""

    statements: Statements  #: statements with K unknowns
    unknowns: FloatArray  #: (K,) fitted values, in standard uncertainties of the unknowns

    def compute_motion(self, block: RegressorBlock) -> Motion:
        """Compute how fitted errors move the targets (B, T, 3) [m] and encoders (B, n) [rad] of a block."""
        terms, compliance = self.statements.terms, self.statements.compliance
        rows = self.statements.scale(build_rows(block, terms, compliance))
        encoders = None if rows.encoders is None else rows.encoders[..., :-1] @ self.unknowns
        return Motion(rows.targets[..., :-1] @ self.unknowns, encoders)

    def build_corrected_rows(self, block: RegressorBlock, compliance: FloatArray) -> Rows:
        """Return the whitened rows of the joints, with the fitted errors subtracted from the readings.

        Args:
            block: B observations.
            compliance: (n,) compliances at which the joints' columns are computed [rad/(N·m)].
        """
        joints = build_whitened_rows(block, [JOINTS], compliance)
        rows = build_whitened_rows(block, self.statements.terms, self.statements.compliance)
        rows = self.statements.scale(rows)
        joints.targets[..., -1] -= rows.targets[..., :-1] @ self.unknowns
        if joints.encoders is not None and rows.encoders is not None:
            joints.encoders[..., -1] -= rows.encoders[..., :-1] @ self.unknowns
        return joints


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
