"""Elastic joints as a model that predicts: compliances, and what is known of their errors."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.constraints import Constraints
from jointstiff.solver.errors import RequestError, SolverError
from jointstiff.solver.fitting.likelihood import Likelihood
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.inference.profile import profile_row_ends, range_on_box
from jointstiff.solver.observability.identifiability import Spectrum
from jointstiff.solver.robot.model import Robot

_UNSEEN: Final = 1e-9
"""Share of a row in what the readings do not determine, below which it is rounding."""
_BLOCK: Final = 500
"""Rows whose ends are found together: each takes some matrices of n × n numbers."""
_LEAST_SIGMA: Final = 1e-15
"""Rounding of a position [m]: no reading is better."""


@dataclass(frozen=True, eq=False)
class JointModel:
    """A robot with elastic joints."""

    robot: Robot  #: n joints
    compliance: FloatArray  #: (n,) [rad/(N·m)]; zero where nothing is known
    #: of the compliances that were seen, before any constraint, in SI units; None where no uncertainty is
    #: known
    likelihood: Likelihood | None
    constraints: Constraints  #: on all n compliances
    #: of a sigma that comes from residuals; None for one that was given
    degrees_of_freedom: float | None = None

    @classmethod
    def of(cls, robot: Robot, estimate: Estimate, constraints: Constraints) -> JointModel:
        """Take over what an identification found."""
        likelihood = estimate.likelihood if estimate.covariance is not None else None
        if likelihood is not None:
            sigma = max(float(estimate.sigma or 0.0), _LEAST_SIGMA)
            rows = None if likelihood.given_rows is None else likelihood.given_rows / sigma
            likelihood = Likelihood(
                likelihood.joints, likelihood.centre, sigma**2 * likelihood.covariance, rows
            )
        freedom = None if estimate.sigma_given else estimate.degrees_of_freedom
        return cls(robot, estimate.compliance, likelihood, constraints, freedom)

    @cached_property
    def covariance(self) -> FloatArray:
        """(n, n) of the unconstrained estimate [(rad/(N·m))²]; zero for joints that were not seen."""
        covariance = np.zeros((self.robot.n, self.robot.n))
        if self.likelihood is not None:
            covariance[np.ix_(self.likelihood.joints, self.likelihood.joints)] = self.likelihood.covariance
        return covariance

    @cached_property
    def root(self) -> FloatArray:
        """(n, n) matrix whose product with its transpose is the covariance."""
        values, vectors = np.linalg.eigh(self.covariance)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))

    @cached_property
    def _unseen_directions(self) -> FloatArray:
        """(u, n) directions of the compliances that the readings do not determine, in scaled compliances."""
        joints = np.arange(self.robot.n) if self.likelihood is None else self.likelihood.joints
        hidden = np.eye(self.robot.n)[np.setdiff1d(np.arange(self.robot.n), joints)]
        if self.likelihood is None or self.likelihood.given_rows is None:
            return hidden
        null = np.zeros((0, self.robot.n))
        spectrum = Spectrum(self.likelihood.given_rows)
        if len(spectrum.null_space):
            null = np.zeros((len(spectrum.null_space), self.robot.n))
            null[:, joints] = spectrum.null_space / spectrum.scale * spectrum.scale.max()
        return np.concatenate([hidden, null])

    def unseen(self, rows: FloatArray) -> BoolArray:
        """(B, n) joints whose unknown compliance has a part in linear functions (B, w, n) of all."""
        if not len(self._unseen_directions):
            return np.zeros((len(rows), self.robot.n), dtype=np.bool_)
        size = np.abs(rows).max(axis=(1, 2), initial=0.0)[:, None, None]
        parts = rows @ self._unseen_directions.T  # (B, w, u)
        counts = (np.abs(parts) > _UNSEEN * size).any(axis=1)  # (B, u)
        joints = (counts[:, :, None] & (np.abs(self._unseen_directions) > _UNSEEN)).any(axis=1)
        return np.asarray(joints)

    def quantile(self, confidence: float) -> float:
        """Return half the width of a two-sided interval in standard uncertainties."""
        if not 0.0 < confidence < 1.0:
            raise RequestError(
                f"the confidence is {confidence}", where="confidence", remedy="give it between 0 and 1"
            )
        probability = 0.5 * (1.0 + confidence)
        if self.degrees_of_freedom is None:
            return float(special.ndtri(probability))
        return float(special.stdtrit(self.degrees_of_freedom, probability))

    def ends(self, rows: FloatArray, confidence: float) -> FloatArray | None:
        """Return the ends of intervals of linear functions aᵀc under the constraints (method.md §9).

        As for joints, the profile's ends are widened to contain what the constraints leave of the
        unconstrained interval, and the estimate.

        Args:
            rows: (K, n) functions a.
            confidence: level.

        Returns:
            (K, 2) in the unit of aᵀc; None where no uncertainty is known.
        """
        ends = self.free_ends(rows, confidence)
        if ends is None or self.likelihood is None:
            return None
        constraints, part = self.constraints.select(self.likelihood.joints), rows[:, self.likelihood.joints]
        some = np.flatnonzero(self._variance(part) > 0.0)
        if not constraints.order:  # with an order the box is no longer the range: the free ends are wider
            for start in range(0, len(some), _BLOCK):
                block = some[start : start + _BLOCK]
                with suppress(SolverError):  # the free ends cover by themselves, wherever the truth lies
                    profile = profile_row_ends(
                        self.likelihood, constraints, part[block], np.array([self.quantile(confidence)])
                    )[0]
                    ends[block, 0] = np.minimum(ends[block, 0], profile[:, 0])
                    ends[block, 1] = np.maximum(ends[block, 1], profile[:, 1])
        return ends

    def free_ends(self, rows: FloatArray, confidence: float) -> FloatArray | None:
        """Return what the bounds leave of the unconstrained intervals of aᵀc, widened to hold the estimate.

        They cover by themselves, without a program to solve for each.

        Args:
            rows: (K, n) functions a.
            confidence: level.

        Returns:
            (K, 2) in the unit of aᵀc; None where no uncertainty is known.
        """
        if self.likelihood is None:
            return None
        joints: IndexArray = self.likelihood.joints
        value = rows @ self.compliance
        ends = np.stack([value, value], axis=-1)
        part, bounds = rows[:, joints], self.constraints.select(joints).bounds
        half = self.quantile(confidence) * np.sqrt(self._variance(part))[:, None] * np.array([-1.0, 1.0])
        some = half[:, 1] > 0.0
        box = range_on_box(part[some], bounds)
        held = np.clip((part[some] @ self.likelihood.centre)[:, None] + half[some], box[:, :1], box[:, 1:])
        ends[some, 0] = np.minimum(held[:, 0], value[some])
        ends[some, 1] = np.maximum(held[:, 1], value[some])
        return ends

    def _variance(self, part: FloatArray) -> FloatArray:
        """(K,) of functions (K, p) of the compliances that were seen, without constraints."""
        if self.likelihood is None:
            return np.zeros(len(part))
        variance: FloatArray = ((part @ self.likelihood.covariance) * part).sum(axis=1)
        return variance
