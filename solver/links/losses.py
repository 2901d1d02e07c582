"""Losses of a model of elastic links on some observations, and their optima (method.md §7).

squared    ‖z − R x‖² / ‖z‖² + λ tr              rows compressed to a triangle
absolute   Σ ‖r_i‖ / Σ ‖d_i‖ + λ tr              one second-order cone a target
huber      Σ ρ(r_i) / Σ ‖d_i‖ + λ tr             ρ = ‖r‖²/(2h) up to h, ‖r‖ − h/2 beyond
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.conic import (
    ConeSolution,
    NormSum,
    RobustProgram,
    certify_cone,
    certify_robust,
    solve_cone,
    solve_robust,
)
from jointstiff.solver.convex.problem import Bounds, IdentificationProblem
from jointstiff.solver.convex.solution import solve_step
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fitting.robust import MEDIAN_NORM
from jointstiff.solver.links.model import (
    MOST_TARGETS,
    ElasticModel,
    ElasticRows,
    Formulation,
    Loss,
    formulate,
)
from jointstiff.solver.readings.measurements import Measurements

_LEAST_SCALE: Final = 1e-6
"""Least robust scale relative to the mean deflection: exact readings have none."""
_LEAST_WEIGHT: Final = 1e-9
"""Least weight of the penalty beside squares."""


def compared_losses(measurements: Measurements, losses: tuple[Loss, ...]) -> tuple[Loss, ...]:
    """Return those of some losses that a set supports: squares alone where it has many targets.

    Raises:
        UnsupportedMethodError: it does not support the only one.
    """
    targets = int(measurements.present.sum())
    if targets <= MOST_TARGETS:
        return losses
    if "squared" in losses:
        return ("squared",)
    raise UnsupportedMethodError(
        f"{targets} targets were read, and loss {losses[0]} of elastic links supports at most {MOST_TARGETS}",
        where="loss",
        remedy="use loss squared, or leave observations out",
    )


class TargetFits:
    """A model on the targets of some observations: one program for all robust losses and penalties."""

    def __init__(self, formulation: Formulation, rows: ElasticRows) -> None:
        """Take what was formulated."""
        self.rows, d = rows, rows.of_targets[..., -1]
        self.total = float(np.linalg.norm(d, axis=1).sum())  #: sum of the lengths of the readings [m]
        A = rows.of_targets[..., formulation.columns] * (formulation.unit / self.total)
        self._norms = NormSum(A, d / self.total, formulation.cone)
        self._absolute: dict[tuple[float, float, float | None], ConeSolution] = {}

    def program(self, weight: float, threshold: float) -> RobustProgram:
        """Return the program for a weight λ and a threshold h [m]."""
        return RobustProgram(self._norms, weight, threshold / self.total)

    def absolute(self, weight: float, gap: float, accepted: float | None = None) -> ConeSolution:
        """Return the fit of absolute residuals, which Huber's scale takes as well; see `LossProblem.fit`."""
        key = weight, gap, accepted
        if key not in self._absolute:
            self._absolute[key] = solve_robust(self.program(weight, 0.0), gap=gap, accepted=accepted)
        return self._absolute[key]

    def lengths(self, x: FloatArray) -> FloatArray:
        """(K,) lengths of the residuals [m] of parameters (p,)."""
        lengths: FloatArray = np.linalg.norm(self._norms.residuals(x), axis=1) * self.total
        return lengths


@dataclass(frozen=True, eq=False)
class LossFit:
    """The optimum for a loss and a weight."""

    solution: ConeSolution  #: parameters (p,) of the formulation with their evidence
    threshold: float  #: h [m] of Huber's loss; 0 of absolute residuals, inf of squares


class LossProblem:
    """A model on some observations, ready to be fitted with its loss for any weight of the penalty."""

    def __init__(
        self,
        model: ElasticModel,
        formulation: Formulation,
        robust: TargetFits | None,
        sigma: float | None,
    ) -> None:
        """Take what was formulated.

        Args:
            model: what bends, and the loss.
            formulation: of it.
            robust: of the same observations; None for the squared loss.
            sigma: of one coordinate of one reading, if it is stated [m].
        """
        self.model, self.formulation = model, formulation
        self._robust, self._sigma = robust, sigma

    @property
    def size(self) -> float:
        """Return the unit of certificates' gaps [m]: of fitted readings all together, or of mean residuals.

        A gap of squares is ‖R (x − x̂)‖ / ‖z‖. One of the others is the excess of the objective, and times
        this size the excess of the mean norm of a residual.
        """
        if self.model.loss == "squared":
            return self.formulation.size
        return self._fits.total / self._fits.rows.targets

    def fit(self, weight: float, *, gap: float, accepted: float | None = None) -> LossFit:
        """Fit.

        Args:
            weight: λ > 0.
            gap: of a certificate, in units of `size`, that ends the search.
            accepted: greatest that is accepted; the same if None.

        Raises:
            SolverError: no answer has such a certificate.
        """
        if self.model.loss == "squared":
            program = self.formulation.program(weight)
            return LossFit(solve_cone(program, gap=gap, accepted=accepted), float("inf"))
        if self.model.loss == "absolute":
            return LossFit(self._fits.absolute(weight, gap, accepted), 0.0)
        threshold = self.threshold(weight, gap)
        robust = self._fits.program(weight, threshold)
        return LossFit(solve_robust(robust, gap=gap, accepted=accepted), threshold)

    def gap_at(self, compliances: FloatArray, weight: float, fitted: LossFit) -> float:
        """Return the gap of compliances (P,) near a fit, in units of `size`."""
        x = compliances[self.formulation.columns] / self.formulation.unit
        if self.model.loss == "squared":
            return certify_cone(self.formulation.program(weight), x).gap
        program = self._fits.program(weight, fitted.threshold)
        return certify_robust(program, x, fitted.solution.certificate.multipliers).gap

    def joints_only(self) -> FloatArray:
        """(p,) parameters of a model without penalised elements under squares, exactly."""
        fit = self.formulation.fit
        problem = IdentificationProblem(fit.R, fit.z, Bounds.positive(fit.R.shape[1]))
        return solve_step(problem).compliance

    def threshold(self, weight: float, gap: float) -> float:
        """Return h [m] of Huber's loss, in units of sigma, or of the robust scale.

        The robust scale is that of the residuals of absolute loss under the same penalty.

        Raises:
            SolverError: as `fit` does.
        """
        if self._sigma is not None:
            return self.model.threshold * self._sigma
        lengths = self._fits.lengths(self._fits.absolute(weight, gap).x)
        return self.model.threshold * self.scale_of(lengths)

    def scale_of(self, norms: FloatArray) -> float:
        """Return the robust scale [m] of residuals with these norms (K,)."""
        least = _LEAST_SCALE * self._fits.total / max(1, len(norms))
        return max(float(np.median(norms)) / MEDIAN_NORM, least)

    def companion(
        self, rows: ElasticRows, compliances: FloatArray, weight: float, threshold: float
    ) -> tuple[ElasticRows, Formulation, float]:
        """Return the weighted squares that share the optimum, and the weight of their penalty.

        A target beyond the threshold h counts h/‖r‖: the stationarity of Huber's loss is that of these
        squares. For absolute residuals h is the threshold times their robust scale, and the optimum
        is shared about.

        Args:
            rows: of the observations.
            compliances: (P,) of the fit.
            weight: λ of the fit.
            threshold: h of the fit [m].
        """
        if self.model.loss == "squared":
            return rows, self.formulation, weight
        norms = rows.lengths(compliances)
        if threshold == 0.0:
            threshold = self.model.threshold * max(self.scale_of(norms), self._sigma or 0.0)
        weighted = rows.weighted(threshold / np.maximum(norms, threshold))
        seen = np.isin(np.arange(self.model.columns.n), self.formulation.columns)
        formulation = formulate(weighted, self.model, seen)
        return weighted, formulation, 2.0 * self._fits.total * threshold * weight / formulation.size**2

    def weight_of_squares(self, compliances: FloatArray, weight: float) -> float:
        """Return the weight of the penalty beside plain squares that pulls as much as at a fit.

        A residual counts by its direction under the absolute loss, and by its length under squares.

        Args:
            compliances: (P,) of the fit.
            weight: λ of the fit.
        """
        if self.model.loss == "squared":
            return weight
        length = float(self._fits.rows.lengths(compliances).mean())
        return max(2.0 * self._fits.total * length * weight / self.formulation.size**2, _LEAST_WEIGHT)

    @property
    def _fits(self) -> TargetFits:
        if self._robust is None:
            raise ValueError("a robust loss needs the rows of all targets")
        return self._robust
