"""Uncertainty budget of the compliances: components, their evaluation and correlation (method.md §8).

Where the joints alone do not fit, held-out postures speak, too: the model error widens the intervals.

*Evaluation of measurement data: Guide to the expression of uncertainty in measurement* (GUM), JCGM 100:2008.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.convex.problem import Bounds
from jointstiff.solver.evidence.estimate import Estimate, one_sided_bounds
from jointstiff.solver.fitting.fit import student_quantile

_LEAST_POSTURES: Final = 2
"""Postures beyond the number of joints that it takes to tell model error from the noise of the readings."""
_NO_UPPER_END = "without single postures its stiffness has no upper limit: something besides the joints bends"


@dataclass(frozen=True, eq=False)
class Spread:
    """Uncertainty of all compliances by one source, or by several."""

    covariance: FloatArray  #: (n, n) [(rad/(N·m))²]

    @property
    def uncertainty(self) -> FloatArray:
        """Return the standard uncertainty (n,) of each compliance [rad/(N·m)]."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))

    @property
    def correlation(self) -> FloatArray:
        """Return the correlation (n, n) between the joints; zero where an uncertainty is zero."""
        size = self.uncertainty
        scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
        correlation: FloatArray = np.clip(self.covariance * np.outer(scale, scale), -1.0, 1.0)
        return correlation


@dataclass(frozen=True, eq=False)
class BudgetComponent:
    """One source of uncertainty."""

    #: `readings`, the name of a term whose uncertainty is stated or assumed, `model_error` or
    #: `complementary_stiffness`
    source: str
    #: "A" from these readings by statistics, "B" by other means, as stated with them
    evaluation: Literal["A", "B"]
    included: bool  #: whether it is part of the standard uncertainty of the joints
    spread: Spread  #: uncertainty of the compliances by this source alone
    degrees_of_freedom: float | None = None  #: of an evaluation of type A; None for infinitely many


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Estimates without single postures."""

    compliance: FloatArray  #: (P, n) without each posture in turn [rad/(N·m)]; NaN where undetermined
    postures: int  #: number of postures that were measured, at least P


@dataclass(frozen=True, eq=False)
class UncertaintyBudget:
    """Components of the uncertainty of a run's compliances."""

    joints: IndexArray  #: (p,) joints that have an estimate
    #: the squares of the included ones add up to that of the standard uncertainty
    components: tuple[BudgetComponent, ...]
    probability: float  #: coverage probability of the expanded uncertainties
    #: normal, or Student's where sigma comes from the residuals or the model error is included
    coverage_factor: float

    @classmethod
    def of(
        cls,
        estimate: Estimate,
        probability: float,
        left_out: LeftOut | None = None,
        *,
        lack_of_fit: bool = False,
    ) -> UncertaintyBudget | None:
        """Return the budget; None where the uncertainty of the readings is unknown.

        Args:
            estimate: of n compliances.
            probability: coverage probability.
            left_out: estimates without single postures; None leaves out the model error.
            lack_of_fit: whether the joints alone do not fit: the model error is then included.
        """
        if estimate.covariance is None:
            return None
        common, given, readings = estimate.common, estimate.sigma_given, estimate.covariance
        if common is not None:
            readings = readings - common.responses @ common.responses.T
        own_freedom = None if given else estimate.degrees_of_freedom
        components = [BudgetComponent("readings", "B" if given else "A", True, Spread(readings), own_freedom)]
        if common is not None:
            components += [
                BudgetComponent(source, "B", True, Spread(own @ own.T))
                for source, own in common.by_source.items()
                if own.any()
            ]
        joints = np.flatnonzero(estimate.estimated)
        if left_out is not None:
            components += _model_error(left_out, readings, joints, included=lack_of_fit)
        size = estimate.complementary_stiffness
        if size is not None and not size.included and size.shift is not None:
            shift = Spread(np.outer(size.shift, size.shift))
            components.append(BudgetComponent("complementary_stiffness", "B", False, shift))
        factor = max(
            student_quantile(0.5 * (1.0 + probability), part.degrees_of_freedom)
            for part in components
            if part.source == "readings" or (part.source == "model_error" and part.included)
        )
        return cls(joints, tuple(components), probability, factor)

    def total(self, *, whole: bool = False) -> Spread:
        """Return all included components together; of the `whole` budget, the others too."""
        parts = [part.spread.covariance for part in self.components if part.included or whole]
        return Spread(np.sum(parts, axis=0))

    def widened(self, estimate: Estimate, bounds: Bounds) -> Estimate:
        """Return the estimate whose intervals hold the compliances ± the expanded uncertainty.

        Args:
            estimate: of n joints, the one that the budget is of.
            bounds: on the compliances; an interval that ends at one does not pass it.
        """
        joints = list(estimate.joints)
        uncertainty = self.total().uncertainty
        for j in self.joints.tolist():
            joint = joints[j]
            interval, sides, value = joint.compliance_interval, joint.one_sided, joint.compliance
            if interval is None or sides is None or value is None:
                continue
            half = self.coverage_factor * float(uncertainty[j])
            least, most = max(float(bounds.lower[j]), value - half), min(float(bounds.upper[j]), value + half)
            interval = min(interval[0], least), max(interval[1], most)
            unsure = joint.status == "identified" and interval[0] <= 0.0
            joints[j] = replace(
                joint,
                status="uncertain" if unsure else joint.status,
                standard_uncertainty=float(uncertainty[j]),
                compliance_interval=interval,
                one_sided=one_sided_bounds(
                    min(sides.compliance_at_least, least), max(sides.compliance_at_most, most)
                ),
                reason="; ".join(filter(None, [joint.reason, _NO_UPPER_END if unsure else None])) or None,
            )
        return replace(estimate, joints=tuple(joints))


def _model_error(
    left_out: LeftOut, readings: FloatArray, joints: IndexArray, *, included: bool
) -> list[BudgetComponent]:
    """Return the dispersion that the noise of the readings does not explain, over the postures.

    The jackknife's covariance holds both. In the readings' own units its eigenvalues are 1 on average where
    there is noise alone, and at most ``(1 + √(p/P))²`` (Marchenko & Pastur, 1967): below that it is noise.
    """
    fits = left_out.compliance[:, joints]
    fits = fits[~np.isnan(fits).any(axis=1)]
    count, p = fits.shape
    if count < p + _LEAST_POSTURES:
        return []
    around = fits - fits.mean(axis=0)
    spread = (left_out.postures - 1.0) / count * around.T @ around
    try:
        factor = np.linalg.cholesky(readings[np.ix_(joints, joints)])
    except np.linalg.LinAlgError:  # readings without any noise: there is nothing to compare with
        return []
    half = np.linalg.solve(factor, spread)
    values, vectors = np.linalg.eigh(np.linalg.solve(factor, half.T))
    chance = (1.0 + np.sqrt(p / count)) ** 2
    root = factor @ (vectors * np.sqrt(np.where(values > chance, values - 1.0, 0.0)))
    covariance = np.zeros_like(readings)
    covariance[np.ix_(joints, joints)] = root @ root.T
    return [BudgetComponent("model_error", "A", included, Spread(covariance), count - 1.0)]
