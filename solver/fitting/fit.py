"""The outcome of a method before sigma is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

from jointstiff.solver.arrays import BoolArray, FloatArray, Support
from jointstiff.solver.convex.certificate import Certificate
from jointstiff.solver.fitting.likelihood import Likelihood
from jointstiff.solver.observability.combination import Combination
from jointstiff.solver.observability.identifiability import Identifiability


@dataclass(frozen=True, eq=False)
class Fit:
    """The outcome of a method before sigma is known."""

    compliance: FloatArray  #: (n,) optimum [rad/(N·m)]; zero for null columns
    active: Support  #: (n,) -1 or 1 at a lower or upper bound, else 0
    tied: BoolArray  #: (n,) joints whose compliance an order makes equal to another's
    covariance: FloatArray  #: (n, n) of the unconstrained estimate in units of sigma²; zero for null columns
    likelihood: Likelihood  #: of the compliances that the readings see, before any constraint
    parameters: float  #: how many the readings were asked for: the rank, less what a prior answered instead
    #: groups of joints that neither the readings nor a prior tell apart
    undetermined: tuple[Combination, ...]
    identifiability: tuple[Identifiability, ...]  #: of each stage, by the readings alone
    certificates: tuple[Certificate, ...]  #: of each stage
    alone: Fit | None = None  #: where a prior takes part, the fit of the readings alone

    def inflated(self, factor: float) -> Fit:
        """The same estimate, its variance greater by a factor."""
        if factor == 1.0:
            return self
        return replace(self, covariance=factor * self.covariance, likelihood=self.likelihood.inflated(factor))

    def with_common(self, responses: FloatArray) -> Fit:
        """The same estimate with the variance of errors that all observations share.

        Args:
            responses: (n, k) what a standard uncertainty of each moves, in units of sigma.
        """
        return replace(
            self,
            covariance=self.covariance + responses @ responses.T,
            likelihood=self.likelihood.with_common(responses[self.likelihood.joints]),
        )
