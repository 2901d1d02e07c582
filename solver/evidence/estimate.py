"""The estimate: joint compliances with uncertainty, verdict and evidence (method.md §6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.convex.solution import Certificate, StagesCertificate
from jointstiff.solver.evidence.verdict import JointCompliance
from jointstiff.solver.fitting.fit import Likelihood, SigmaTest, sigma_test
from jointstiff.solver.fitting.method import MethodTriangles
from jointstiff.solver.fitting.observability import (
    Identifiability,
    Observability,
    ObservabilityIndices,
    observability_indices,
)
from jointstiff.solver.fitting.robust import RobustFit


@dataclass(frozen=True, eq=False)
class CommonErrors:
    """Effect of errors that all observations share on the estimate, to first order (method.md §8)."""

    #: change (n, k) of the estimate by one standard uncertainty of each error of a source [rad/(N·m)]
    by_source: Mapping[str, FloatArray]
    responses: (
        FloatArray  #: (n, K) all of them; their share of the covariance is the product with the transpose
    )

    def of(self, source: str) -> FloatArray:
        """Return the responses (n, k) of the errors of one source."""
        return self.by_source.get(source, self.responses[:, :0])


@dataclass(frozen=True)
class ComplementaryStiffness:
    """Effect of K_c on a fit. Dimensionless."""

    included: bool  #: whether it is part of the model
    iterations: int  #: fits until the deflected configurations stood still; 0 if neglected
    largest_ratio: float  #: greatest ``|K_c,ij| c_i`` over the set, over the joints with an estimate
    #: greatest change of a compliance between neglecting and including it, in units of its standard
    #: uncertainty; None where that is unknown
    largest_shift: float | None
    #: (n,) change of the compliances by including it [rad/(N·m)]; None where it is not known
    shift: FloatArray | None = None
    obstacle: str | None = None  #: why it is neglected although it was asked for; None where it is not


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
    identifiability: tuple[Identifiability, ...]  #: identifiability of each stage of the method
    certificates: tuple[Certificate, ...]  #: certificates of each stage of the method
    triangles: MethodTriangles  #: all readings, compressed, in units of sigma
    observability: Observability  #: observability of the joints in the same readings
    characteristic_length: float | None = None  #: [m], where the weighting used one
    complementary_stiffness: ComplementaryStiffness | None = None  #: how much it matters
    robust: RobustFit | None = None  #: weights of the readings by the Huber loss; None for the squared loss
    #: likelihood of the compliances that the readings see, before any constraint, in units of sigma
    likelihood: Likelihood | None = None
    #: effect of errors that all observations share, part of `covariance`; None without them
    common: CommonErrors | None = None

    @property
    def regressor(self) -> FloatArray:
        """(m, n) of all readings, compressed and weighted by covariance, whatever the method made of them."""
        return self.triangles.judged.matrix

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
