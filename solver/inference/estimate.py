"""The estimate: joint compliances with uncertainty, verdict and evidence (method.md §6)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.convex.certificate import Certificate, StagesCertificate
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.fitting.common import CommonErrors
from jointstiff.solver.fitting.fit import Fit, Likelihood
from jointstiff.solver.fitting.iteration import prior_to_data
from jointstiff.solver.fitting.robust import RobustFit
from jointstiff.solver.fitting.scale import SigmaTest, scale_of, sigma_test
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.inference.verdict import Evidence, JointCompliance, verdicts
from jointstiff.solver.observability.identifiability import (
    Identifiability,
    Observability,
    ObservabilityIndices,
    observability_indices,
)
from jointstiff.solver.regression.complementary_stiffness import ComplementaryStiffness
from jointstiff.solver.regression.compression import Compression

_LEAST_SIGMA: Final = 1e-15
"""Rounding of a position [m], the unit of common errors where the readings are exact."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Joint compliances with their evidence."""

    joints: tuple[JointCompliance, ...]  #: one verdict a joint
    #: (n,) the optimum that predictions use [rad/(N·m)]. Entries of joints that are not observable are no
    #: estimates; `joints` withholds them.
    compliance: FloatArray
    #: (n, n) covariance of the unconstrained estimate [(rad/(N·m))²]; None where sigma is unknown
    covariance: FloatArray | None
    #: standard uncertainty of one coordinate of one reading [m]; None where it was not given and there are
    #: no degrees of freedom to estimate it from
    sigma: float | None
    sigma_given: bool  #: whether sigma was stated with the readings
    chi_square: float  #: chi square of the targets' residuals, under sigma
    degrees_of_freedom: float  #: expectation of chi_square where model and sigma are right
    characteristic_length: float | None  #: [m], where the weighting used one
    identifiability: tuple[Identifiability, ...]  #: identifiability of each stage of the method
    certificates: tuple[Certificate, ...]  #: certificates of each stage of the method
    #: (m, n) of all readings, compressed and weighted by their covariance in units of sigma, whatever the
    #: method made of them
    regressor: FloatArray
    observability: Observability  #: observability of the joints in the same readings
    complementary_stiffness: ComplementaryStiffness | None = None  #: how much it matters
    robust: RobustFit | None = None  #: weights of the readings by the Huber loss; None for the squared loss
    #: likelihood of the compliances that the readings see, before any constraint, in units of sigma
    likelihood: Likelihood | None = None
    #: effect of errors that all observations share, part of `covariance`; None without them
    common: CommonErrors | None = None

    @property
    def estimated(self) -> BoolArray:
        """(n,) joints with an estimate."""
        return np.array([joint.compliance is not None for joint in self.joints])

    @property
    def parameters(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def rank(self) -> int:
        """Number of compliances, or combinations of them, that the readings determine in all stages."""
        return sum(stage.rank for stage in self.identifiability)

    @property
    def condition_number(self) -> float:
        """The greatest of the stages'; inf where a rank is not full."""
        return max(stage.condition_number for stage in self.identifiability)

    @property
    def combinations(self) -> list[list[str]]:
        """Groups of joints, by name, whose compliances show only together."""
        groups = [group.joints for stage in self.identifiability for group in stage.combinations]
        return [[self.joints[j].name for j in joints] for joints in groups]

    @property
    def weakest(self) -> list[str]:
        """Joints that are hard to tell apart, in words, for each stage that has some."""
        names = tuple(joint.name for joint in self.joints)
        return [stage.weakest.in_words(names) for stage in self.identifiability if stage.weakest]

    @property
    def observability_indices(self) -> ObservabilityIndices | None:
        """Indices over the joints that the readings see; None where the rank is not full."""
        return observability_indices(self.regressor, self.observability)

    @property
    def certificate(self) -> StagesCertificate:
        """The greatest violations over the stages."""
        return StagesCertificate.of(self.certificates)

    @property
    def sigma_source(self) -> Literal["given", "residuals"]:
        """Origin of sigma."""
        return "given" if self.sigma_given else "residuals"

    @cached_property
    def sigma_test(self) -> SigmaTest | None:
        """Return the test of a stated sigma; None if not stated, or without residual freedom."""
        return sigma_test(self.chi_square, self.degrees_of_freedom) if self.sigma_given else None


def assemble(
    fit: Fit,
    observability: Observability,
    whitened: Compression,
    *,
    names: tuple[str, ...],
    sigma: float | None,
    settings: Settings,
    characteristic_length: float | None,
    inflation: float = 1.0,
    sigma_given: bool = True,
    common: Callable[[float], CommonErrors] | None = None,
) -> Estimate:
    """Give the fit its scale, its uncertainties and its verdicts.

    Args:
        fit: outcome of the method.
        observability: of the same observations.
        whitened: compressed rows of all targets, whitened in units of sigma.
        names: of the n joints.
        sigma: as stated with the readings [m], or None.
        settings: constraints, prior and confidence.
        characteristic_length: [m], if one was used.
        inflation: of the variance of the estimate, where the loss is not squared.
        sigma_given: false if a sigma is passed that comes from the readings themselves.
        common: return the effect of errors that all observations share, given sigma; None without them.
    """
    scale = scale_of(fit if fit.alone is None else fit.alone, whitened, sigma)
    if fit.alone is not None:
        scale = replace(scale_of(fit, whitened, scale.sigma), given=scale.given)
    scale = replace(scale, given=scale.given and sigma_given)
    fit = fit.inflated(inflation)
    errors = None
    if common is not None and scale.sigma is not None:
        sigma = max(scale.sigma, _LEAST_SIGMA)
        scale, errors = replace(scale, sigma=sigma), common(sigma)
        fit = fit.with_common(errors.responses / sigma)
    covariance = None if scale.sigma is None else np.float64(scale.sigma) ** 2 * fit.covariance
    numbers = [fit.compliance, np.array([scale.chi_square, scale.degrees_of_freedom])]
    numbers += [] if covariance is None else [covariance]
    if not all(np.isfinite(array).all() for array in numbers):
        raise MeasurementError(
            "the numbers overflow: the magnitudes of loads, lengths and sigma are inconsistent",
            where="units",
            remedy="check the units of force, length and sigma",
        )
    ratios = np.full(len(names), np.nan)
    if fit.alone is not None and settings.prior is not None and scale.sigma is not None:
        ratios = prior_to_data(fit.alone, settings.prior, scale.sigma)
    evidence = Evidence(names, fit, observability, scale, settings.constraints, settings.confidence, ratios)
    joints = verdicts(evidence)
    return Estimate(
        joints=joints,
        compliance=fit.compliance,
        covariance=covariance,
        sigma=scale.sigma,
        sigma_given=scale.given,
        chi_square=scale.chi_square,
        degrees_of_freedom=scale.degrees_of_freedom,
        characteristic_length=characteristic_length,
        identifiability=fit.identifiability,
        certificates=fit.certificates,
        regressor=whitened.matrix,
        observability=observability,
        likelihood=fit.likelihood,
        common=errors,
    )
