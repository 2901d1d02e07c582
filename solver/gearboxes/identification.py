"""Stiffness of gearboxes by one convex program over all joints with two encoders (method.md §18)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.cone import Scalars
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.estimate import compute_interval_ends
from jointstiff.solver.fit.problem import LeastSquares, Problem
from jointstiff.solver.fit.solution import solve
from jointstiff.solver.fit.stages import Likelihood, student_quantile
from jointstiff.solver.gearboxes.step import PLACE, JointStep, WeightStep

LEAST_FREEDOM: Final = 1
"""Least number of postures of a joint beyond its unknowns."""
_UPPER: Final = 0.975
"""Probability below the upper end of an interval of 95 %."""
_ROUNDS: Final = 4
"""Rounds of the products of compliance and load: each changes the answer by its square."""
_LEAST_NOISE: Final = 1e-9
"""Least standard deviation of a step [rad]: computed readings have residuals of rounding alone."""


@dataclass(frozen=True, eq=False)
class GearboxFit:
    """Outcome for one joint with two encoders."""

    steps: JointStep
    compliance: float  #: within the constraint c ≥ 0 [rad/(N·m)]
    free_compliance: float  #: without the constraint [rad/(N·m)]
    uncertainty: float  #: standard uncertainty of the free compliance [rad/(N·m)]
    interval: tuple[float, float]  #: 95 % interval of the compliance [rad/(N·m)]
    offset: float  #: change of the twist that no torque explains [rad]
    noise: float  #: standard deviation of a step [rad]
    residuals: FloatArray  #: (S,) step less prediction [rad]
    deleted: FloatArray  #: (S,) residuals over their standard deviations without the step itself


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of all joints for one state: steps, and the statement on the load, in standard deviations.

    The unknowns are those of each joint, one joint after the other, then the error of the mass and the three
    errors of the load's place, each in its standard uncertainty. Joints share these errors, whose effect is
    the product of compliance and load: it is linearised at the compliances of the state.
    """

    steps: Sequence[JointStep]
    noise: FloatArray  # (joints,) standard deviation of a step [rad]
    compliance: FloatArray  # (joints,) where the products are linearised [rad/(N·m)]
    uncertainties: FloatArray  # (4,) of the mass, relative, and of the three coordinates [m]

    @cached_property
    def first(self) -> list[int]:
        """Columns of the joints' compliances, then the first column of the shared errors."""
        return list(accumulate((steps.columns.shape[1] for steps in self.steps), initial=0))

    @cached_property
    def matrix(self) -> FloatArray:
        """(rows, unknowns) matrix of the steps, then of the statement on the load."""
        shared = self.first[-1]
        blocks = []
        for columns, steps, noise, compliance in zip(
            pairwise(self.first), self.steps, self.noise, self.compliance, strict=True
        ):
            block = np.zeros((len(steps.step), shared + 1 + PLACE))
            block[:, slice(*columns)] = steps.columns / noise
            block[:, shared:] = compliance * steps.torques.T * self.uncertainties / noise
            blocks.append(block)
        statement = np.eye(1 + PLACE, shared + 1 + PLACE, shared)
        return np.vstack([*blocks, statement])

    @cached_property
    def rhs(self) -> FloatArray:
        """(rows,) steps in standard deviations; zero for the statement on the load."""
        steps = [steps.step / noise for steps, noise in zip(self.steps, self.noise, strict=True)]
        return np.concatenate([*steps, np.zeros(1 + PLACE)])

    @property
    def bounds(self) -> Bounds:
        """Bounds of the unknowns: compliances are positive or zero."""
        lower = np.full(self.matrix.shape[1], -np.inf)
        lower[self.first[:-1]] = 0.0
        return Bounds(lower, np.full(len(lower), np.inf))

    def solve(self) -> FloatArray:
        """Return the unknowns of least squares within the bounds, by Clarabel and certified."""
        return solve(Problem(LeastSquares(self.matrix, self.rhs), Scalars(self.bounds))).x

    def residuals(self, unknowns: FloatArray) -> list[FloatArray]:
        """Return the residuals (S,) [rad] of each joint's steps."""
        whitened = self.rhs - self.matrix @ unknowns
        ends = np.cumsum([len(steps.step) for steps in self.steps])
        of_joints = np.split(whitened[: ends[-1]], ends[:-1])
        return [noise * rest for noise, rest in zip(self.noise, of_joints, strict=True)]

    def intervals(self, compliance: FloatArray) -> tuple[Likelihood, FloatArray]:
        """Return the likelihood of the unknowns, and the 95 % intervals (joints, 2) of the compliances."""
        centre = np.asarray(np.linalg.lstsq(self.matrix, self.rhs, rcond=None)[0], dtype=np.float64)
        likelihood = Likelihood(np.arange(len(centre)), centre, _invert_gram(self.matrix))
        functions = np.eye(len(centre))[self.first[:-1]]
        freedom = np.array([steps.degrees_of_freedom for steps in self.steps])
        intervals = np.empty((len(freedom), 2))
        for own in np.unique(freedom).tolist():  # each joint has degrees of freedom of its own
            of = freedom == own
            radius = np.array([student_quantile(_UPPER, own)])
            intervals[of] = compute_interval_ends(
                likelihood, Constraints(self.bounds), functions[of], radius, compliance[of]
            )[0]
        return likelihood, intervals


def fit_gearboxes(step: WeightStep, joints: Sequence[JointStep]) -> list[GearboxFit]:
    """Fit the gearboxes of joints whose torque varies and whose postures leave degrees of freedom.

    ``minimise Σ_j ‖(T_j x_j + c_j B_j e − d_j)/s_j‖² + ‖e/u‖²  subject to  c ≥ 0``, with the steps d_j of
    joint j, its unknowns x_j = (c_j, offset, lost motion), the error e of the load and its standard
    uncertainty u. Noise s_j is that of the residuals with the load as stated, at least that of the encoders:
    errors of the load that are free would take noise in. The product c_j B_j e is brought up to date a few
    times.

    Raises:
        SolverError: an optimum or an end of an interval could not be certified.
    """
    if not joints:
        return []
    load = step.load
    uncertainties = np.array([load.mass_uncertainty / load.mass, *[load.point_uncertainty] * PLACE])
    alone = [np.linalg.lstsq(each.columns, each.step, rcond=None)[0] for each in joints]
    noise = np.array(
        [
            _estimate_noise(each, each.step - each.columns @ unknowns)
            for each, unknowns in zip(joints, alone, strict=True)
        ]
    )
    compliance = np.array([max(unknowns[0], 0.0) for unknowns in alone])
    for _ in range(_ROUNDS):
        rows = _Rows(joints, noise, compliance, uncertainties)
        unknowns = rows.solve()
        compliance = np.maximum(unknowns[rows.first[:-1]], 0.0)
    residuals = rows.residuals(unknowns)
    rows = _Rows(joints, noise, compliance, uncertainties)
    likelihood, intervals = rows.intervals(compliance)
    return [
        GearboxFit(
            each,
            float(compliance[i]),
            float(likelihood.centre[rows.first[i]]),
            float(np.sqrt(likelihood.covariance[rows.first[i], rows.first[i]])),
            (float(intervals[i, 0]), float(intervals[i, 1])),
            float(unknowns[rows.first[i] + 1]),
            float(noise[i]),
            residuals[i],
            _delete_each(each, residuals[i]),
        )
        for i, each in enumerate(joints)
    ]


def _estimate_noise(steps: JointStep, residuals: FloatArray) -> float:
    """Return the standard deviation [rad] of a step: that of the residuals, at least the encoders' own."""
    of_residuals = np.sqrt(residuals @ residuals / steps.degrees_of_freedom)
    return float(max(of_residuals, np.sqrt(np.mean(steps.least_noise**2)), _LEAST_NOISE))


def _delete_each(steps: JointStep, residuals: FloatArray) -> FloatArray:
    """Return the residuals over their standard deviations, each estimated without its own step.

    Student's distribution with one degree of freedom less holds for them (Cook & Weisberg 1982, §2.2.1);
    zero where no degree of freedom is left.
    """
    freedom = steps.degrees_of_freedom - 1
    if freedom < 1:
        return np.zeros_like(residuals)
    q, _ = np.linalg.qr(steps.columns)
    left = np.maximum(1.0 - np.square(q).sum(axis=1), np.finfo(float).eps)
    others = np.maximum(residuals @ residuals - residuals**2 / left, 0.0) / freedom
    return np.asarray(residuals / np.sqrt(left * np.maximum(others, _LEAST_NOISE**2)))


def _invert_gram(matrix: FloatArray) -> FloatArray:
    """Return the inverse of ``AᵀA`` for a matrix A of independent columns, whose scales may differ."""
    unit = 1.0 / np.linalg.norm(matrix, axis=0)
    root = np.linalg.pinv(matrix * unit) * unit[:, None]
    return np.asarray(root @ root.T)
