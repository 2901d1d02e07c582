"""Huber's loss on the targets' residuals, and the weights of the readings at its optimum (method.md §5).

    minimise  Σ_i ρ(‖W_i (d_i − A_i c)‖) + ½ ‖rows of encoders and prior‖²  under the constraints,
    ρ(t) = t²/2 up to the threshold, linear beyond,

over the targets i, each with its three coordinates (Huber, *Robust estimation of a location parameter*,
1964; on norms, so that no frame is preferred). At the optimum reading i has the weight
``w_i = min(1, threshold/‖r_i‖)``, and weighted least squares with these weights has the same optimum. So
the weights are handed on as covariances Σ_i/w_i: partial pose, and complete pose by covariance on three
targets, then *are* the Huber estimate, and every other method and weighting is as robust as they make it.

Clarabel solves the problem as `convex.programs` states it; rounds of weighted least squares, damped between
Newton's step and reweighting, polish its point, and the outcome is certified from the data: with the weights
that its own residuals give, it satisfies the optimality conditions of weighted least squares. All rows of all
targets are kept meanwhile: 24 (n + 1) bytes a reading.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.solution import (
    Certificate,
    Constraints,
    IdentificationProblem,
    Proposer,
    certify,
    solve_step,
)
from jointstiff.solver.errors import SolverError, UnsupportedMethodError
from jointstiff.solver.fitting.method import Prior
from jointstiff.solver.fitting.observability import Spectrum
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.terms.block import RegressorBlock, whitened_rows
from jointstiff.solver.terms.springs import JOINTS
from jointstiff.solver.triangle import Triangle, triangle_of

DEFAULT_THRESHOLD = 2.8
"""Default threshold in units of sigma: 95 % of good readings of three coordinates stay below (χ of three
degrees: 2.796)."""
SUSPICIOUS_NORM = float(np.sqrt(2.0 * special.gammaincinv(1.5, 0.999)))
"""Limit of a suspicious reading, 4.03 sigma: one good reading of three coordinates in a thousand exceeds
it."""

MEDIAN_NORM = float(np.sqrt(2.0 * special.gammaincinv(1.5, 0.5)))
"""1.538: median of the norm of three standard normal coordinates."""
_LEAST_SCALE = 1e-6
"""Smallest scale relative to the rms deflection: no tracker measures better, and exact readings have no
scale."""
_SCALE_TOLERANCE = 1e-6
_SCALE_ROUNDS = 100
MOST_ROUNDS = 200
"""Maximum rounds of reweighting."""
_LEAST_DAMPING = 1e-8
MOST_STATED = 500
"""Number of targets up to which Huber's problem is solved as stated: 12 ms for 100, about 40 ms for these."""
_NO_DESCENT = 1e-12
"""Relative increase of the objective that counts as rounding."""


class TargetRows:
    """Whitened rows of all targets, one by one: 24 (n + 1) bytes a reading."""

    def __init__(self, parameters: int) -> None:
        """Start without observations."""
        self._rows: list[FloatArray] = []
        self._present: list[BoolArray] = []
        self.squared = Triangle(joints=parameters)
        """Rows of squared loss: those of the encoders."""

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations."""
        rows = whitened_rows(block, [JOINTS], np.zeros(block.robot.n))
        self._rows.append(rows.targets[block.measurements.present])
        self._present.append(block.measurements.present)
        if rows.encoders is not None:
            self.squared.add(rows.encoders)

    @property
    def rows(self) -> FloatArray:
        """(K, 3, n + 1) [A d] of the K readings, in units of sigma."""
        return np.concatenate(self._rows)

    @property
    def present(self) -> BoolArray:
        """(N, T) which targets were read: where the K readings belong."""
        return np.concatenate(self._present)

    def chi_square(self, compliance: FloatArray, *, sigma: float, threshold: float) -> float:
        """Chi-square of an estimate, each target's residual cut at the threshold so that none decides it.

        ``Σ min(‖r‖/σ, k)² / b``, with ``3 b = E[min(t, k)²]`` and t the norm of three standard normal
        coordinates, so that its expectation for good readings is that of the plain chi-square.

        Args:
            compliance: (n,) [rad/(N·m)].
            sigma: [m].
            threshold: k, in units of sigma.
        """
        norm = np.linalg.norm(self.rows[..., -1] - self.rows[..., :-1] @ compliance, axis=1) / sigma
        half = 0.5 * threshold**2
        share = special.gammainc(2.5, half) + threshold**2 / 3.0 * special.gammaincc(1.5, half)
        squared = (self.squared.matrix @ compliance - self.squared.rhs) / sigma
        return float(np.sum(np.minimum(norm, threshold) ** 2) / share + squared @ squared)


@dataclass(frozen=True, eq=False)
class RobustFit:
    """Result of a fit of N observations of T targets with the Huber loss."""

    threshold: float  #: norm beyond which a reading counts less, in units of sigma
    sigma: float  #: standard uncertainty of one coordinate of one reading [m]: as stated, or the robust scale
    weight: FloatArray  #: (N, T) weight of the readings; 1 where a target was not read
    #: (N, T) of the whitened residuals in units of sigma; 0 where a target was not read. They are those of
    #: the Huber estimate, whatever the method.
    residual_norm: FloatArray
    certificate: Certificate  #: certificate of the optimum of the Huber problem

    @property
    def suspicious(self) -> IndexArray:
        """(K, 2) observation and target of the readings that are hardly good ones, worst first.

        Those of less than full weight whose residual exceeds `SUSPICIOUS_NORM`.
        """
        beyond = np.argwhere((self.weight < 1.0) & (self.residual_norm > SUSPICIOUS_NORM))
        order = np.argsort(-self.residual_norm[beyond[:, 0], beyond[:, 1]], kind="stable")
        return beyond[order]

    @property
    def inflation(self) -> float:
        """Variance of a Huber estimate over that of least squares with its weights taken as known.

        Huber's asymptotic ``a / b²`` beside ``1 / mean(w)`` (*Robust Statistics*, 1981, §7.6), a the mean of
        ``(w ‖r‖)²`` a coordinate and b that of the derivative: 1 for a reading below the threshold; beyond it
        w across the residual's direction and 0 along it. Readings below the threshold count as their sigma
        says, not as they came out. It is 1.0 for good readings and 1.26 where a tenth are 20 sigma off;
        never taken below 1.
        """
        half = 0.5 * self.threshold**2
        below = float(special.gammainc(2.5, half) / special.gammainc(1.5, half))  # E[χ²₃ | χ²₃ ≤ t²] / 3
        w = self.weight[self.residual_norm > 0]
        if not len(w):
            return 1.0
        a = float(np.mean(np.where(w < 1.0, self.threshold**2 / 3.0, below)))
        b = float(np.mean(np.where(w < 1.0, 2.0 * w / 3.0, 1.0)))
        return max(1.0, a * float(np.mean(w)) / b**2)

    def weigh(self, measurements: Measurements) -> Measurements:
        """The same readings with the covariances Σ/w that their weights stand for."""
        covariance = measurements.covariance / self.weight[..., None, None]
        return replace(measurements, covariance=covariance, weight=self.weight)


@dataclass(frozen=True, eq=False)
class _HuberProblem:
    """Lengths are in units of the threshold: ρ turns linear at 1."""

    A: FloatArray  # (K, 3, p)
    d: FloatArray  # (K, 3)
    squared: FloatArray  # (q, p + 1)
    constraints: Constraints

    def residual(self, c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(K, 3) residuals and (K,) their norms."""
        residual = self.d - self.A @ c
        return residual, np.linalg.norm(residual, axis=1)

    def objective(self, c: FloatArray) -> float:
        norm = self.residual(c)[1]
        squared = self.squared[:, :-1] @ c - self.squared[:, -1]
        return float(np.where(norm <= 1.0, 0.5 * norm**2, norm - 0.5).sum() + 0.5 * (squared @ squared))

    def posed(self, R: FloatArray, z: FloatArray) -> IdentificationProblem:
        """Least squares under the constraints."""
        return IdentificationProblem(R, z, self.constraints.bounds, self.constraints.inequalities)

    def step(self, c: FloatArray, damping: float) -> tuple[FloatArray, Certificate]:
        """Minimum under the bounds of a quadratic model of the objective at c.

        A reading beyond the threshold adds the curvature ``w (I − (1 − damping) u uᵀ)``, u the direction of
        its residual: Newton's for damping 0; for 1 that of reweighting, which never goes up.
        """
        residual, norm = self.residual(c)
        weight = _weight(norm)
        u = residual / np.maximum(norm, 1.0)[:, None]
        along = np.where(norm > 1.0, 1.0 - np.sqrt(damping), 0.0)
        curved = self.A - along[:, None, None] * u[..., None] * (u[:, None] @ self.A)
        weighted = (np.sqrt(weight)[:, None, None] * curved).reshape(-1, len(c))
        R = triangle_of(np.vstack([weighted, self.squared[:, :-1]]))
        gradient = -np.einsum("kij,ki->j", self.A, weight[:, None] * residual)
        gradient += self.squared[:, :-1].T @ (self.squared[:, :-1] @ c - self.squared[:, -1])
        spectrum = Spectrum(R)
        target = R @ c - spectrum.inverse.T @ gradient
        solution = solve_step(self.posed(spectrum.determined, target))
        return solution.compliance, solution.certificate

    def certificate(self, c: FloatArray, solved_by: Proposer) -> Certificate:
        """Certify weighted least squares with the weights of the residuals at c: the Huber problem."""
        root = np.sqrt(_weight(self.residual(c)[1]))[:, None]
        R = self.compressed(root)
        return certify(self.posed(R[:, :-1], R[:, -1]), c, solved_by)

    def compressed(self, root: FloatArray) -> FloatArray:
        """Return the triangle of all rows, those of the targets times root weights (K, 1)."""
        targets = np.concatenate([root[..., None] * self.A, (root * self.d)[..., None]], axis=2)
        return triangle_of(np.vstack([targets.reshape(-1, targets.shape[2]), self.squared]))

    def least_squares(self) -> IdentificationProblem:
        """Return the same problem with the squared loss."""
        R = self.compressed(np.ones((len(self.d), 1)))
        return self.posed(Spectrum(R[:, :-1]).determined, R[:, -1])


def fit_huber(
    targets: TargetRows,
    null: BoolArray,
    constraints: Constraints,
    *,
    prior: Prior | None,
    sigma: float | None,
    threshold: float,
) -> RobustFit:
    """Solve the Huber problem of all targets.

    Where sigma is unknown a robust scale takes its place: the median norm of the whitened residuals over
    that of χ with three degrees of freedom, times √(rows/(rows − parameters)) because a fit shrinks its
    residuals, brought to convergence together with the fit, then fixed.

    Args:
        targets: the rows.
        null: (n,) joints that the readings do not see.
        constraints: on all n compliances.
        prior: of the n compliances; its loss stays squared.
        sigma: as stated with the readings [m], or None.
        threshold: in units of sigma.

    Returns:
        The weights of the readings, with the certificate of the optimum.

    Raises:
        UnsupportedMethodError: sigma is unknown, and too few readings are left to estimate it.
        SolverError: optimality could not be certified.
    """
    joints = np.flatnonzero(~null)
    rows = targets.rows
    problem = _HuberProblem(
        A=rows[..., joints],
        d=rows[..., -1],
        squared=targets.squared.R[:, [*joints, -1]],
        constraints=constraints.select(joints),
    )
    if sigma is None:
        sigma = _robust_scale(problem, threshold)
    if prior is not None:
        rows, known = prior.rows(sigma).select(joints)
        problem = replace(problem, squared=np.vstack([problem.squared, np.column_stack([rows, known])]))
    problem = _in_units_of(problem, threshold * sigma)
    compliance, certificate = _minimise(problem)
    norm = problem.residual(compliance)[1]
    present = targets.present
    weights, norms = np.ones(present.shape), np.zeros(present.shape)
    weights[present], norms[present] = _weight(norm), threshold * norm
    return RobustFit(threshold, sigma, weights, norms, certificate)


def _weight(norm: FloatArray) -> FloatArray:
    return 1.0 / np.maximum(norm, 1.0)


def _in_units_of(problem: _HuberProblem, length: float) -> _HuberProblem:
    A, d, squared = (part / length for part in (problem.A, problem.d, problem.squared))
    return replace(problem, A=A, d=d, squared=squared)


def _minimise(problem: _HuberProblem) -> tuple[FloatArray, Certificate]:
    """Return the optimum and its certificate: Clarabel's point, polished by Newton's steps.

    Of more than `MOST_STATED` targets the rounds start at least squares, with full damping, which is faster.
    """
    stated = None
    if len(problem.d) <= MOST_STATED:
        from jointstiff.solver.convex import programs  # takes a second to import

        S, t = problem.squared[:, :-1], problem.squared[:, -1]
        stated = programs.huber(problem.A, problem.d, S, t, problem.least_squares())
    compliance = solve_step(problem.least_squares()).compliance if stated is None else stated
    damping = 1.0 if stated is None else _LEAST_DAMPING
    objective = problem.objective(compliance)
    for _ in range(MOST_ROUNDS):
        proposed, solver = problem.step(compliance, damping)
        value = problem.objective(proposed)
        if value > objective * (1.0 + _NO_DESCENT) and damping < 1.0:
            damping = 1.0
            continue
        compliance, objective = proposed, value
        damping = max(0.1 * damping, _LEAST_DAMPING)
        same = stated is not None and np.array_equal(stated == 0.0, compliance == 0.0)
        certificate = problem.certificate(compliance, "clarabel" if same else solver.solved_by)
        if certificate.is_optimal():
            return compliance, certificate
    raise SolverError(
        "the fit with the Huber loss did not converge to an optimum (primal "
        f"{certificate.primal:.1e}, dual {certificate.dual:.1e})",
        where="loss",
        remedy="use loss squared, and report this problem with the data",
    )


def _robust_scale(problem: _HuberProblem, threshold: float) -> float:
    """Scale of the residuals [m], brought to convergence round by round with the fit."""
    compliance = solve_step(problem.least_squares()).compliance
    rows = problem.d.size
    freedom = rows - len(compliance)
    if freedom < 1:
        raise UnsupportedMethodError(
            "the Huber loss needs sigma, which cannot be estimated: there are no more readings than joints",
            where="loss",
            remedy="state `noise`, or add observations",
        )
    unit = np.sqrt(rows / freedom) / MEDIAN_NORM
    least = _LEAST_SCALE * float(np.sqrt(np.mean(problem.d**2)))
    scale = np.inf
    for _ in range(_SCALE_ROUNDS):
        before, scale = scale, max(least, unit * float(np.median(problem.residual(compliance)[1])))
        if abs(scale - before) <= _SCALE_TOLERANCE * scale:
            break
        compliance, _ = _in_units_of(problem, threshold * scale).step(compliance, 1.0)
    return scale
