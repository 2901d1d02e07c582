"""The sweep of a controller joint that turns two axes of the model, such as J2 of a FANUC arm.

There ``q2 = θ2`` and ``q3 = −(θ2 + θ3)``: turning θ2 turns axis 2, and axis 3 back by the same angle, so that
the forearm moves without rotating. All targets then run on circles of one and the same radius, the
distance of axes 2 and 3, each about a centre of its own. The circles show the direction of axis 2 and
where it lies *from axis 3*; where axis 3 is, its own sweep shows. In general

    p_kt = E_i(q_ik − b) E_j(q_jk) x_t

with E_i, E_j rotations about the inner and the outer axis, the outer one taken where its own sweep found it,
at inner angle b, and x_t the targets there. No axes need be parallel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import helmert

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.gauss_newton import LinearFit, minimise
from jointstiff.solver.geometry.sweeps.axis import CHART_SIZE, Axis
from jointstiff.solver.geometry.sweeps.circle_point import AngleUse, AxisFit
from jointstiff.solver.geometry.sweeps.circle_point_model import start
from jointstiff.solver.geometry.sweeps.sweep import Sweep
from jointstiff.solver.regression.regressor import whitener


@dataclass(frozen=True, eq=False)
class CoupledFit:
    """The inner axis of a sweep that turns two, given the outer one."""

    sweep: Sweep  #: what was fitted
    outer: AxisFit  #: the fit of the outer axis, from its own sweep
    axis: Axis  #: the inner axis in the tracker's frame, as in this sweep
    #: (T, 3) at the outer angle zero and the inner angle of the outer axis's sweep, tracker's frame [m]
    targets: FloatArray
    #: (K,) angle of the controller's joint from the readings less its own, of mean zero [rad]
    corrections: FloatArray
    #: (4 + 3 T, 3 K T) derivative of chart and targets by the whitened readings, in units of sigma
    influence: FloatArray
    dependence: FloatArray  #: (4, 4) derivative of the inner axis's chart by the outer one's
    #: (4, 4) of the inner axis's chart, by `sigma`, the outer axis's part included
    axis_covariance: FloatArray
    residuals: FloatArray  #: (K, T, 3) reading minus prediction, tracker's frame [m]; zero where absent
    sigma: float  #: standard uncertainty of a coordinate [m]: the stated one, else from the residuals
    sigma_stated: bool  #: whether it was stated
    rss: float  #: sum of squares of the residuals, whitened in units of sigma² [m²]
    dof: int  #: degrees of freedom
    arc: float  #: angle of the controller's joint that the readings cover [rad]
    linear: LinearFit  #: the linearised fit at the minimum, rows in the order of the readings (K, T, 3)

    @property
    def variance_factor(self) -> float:
        """χ²/dof: 1 on average if the stated sigma is right."""
        return self.rss / (self.dof * self.sigma**2)

    @property
    def angle_deviation(self) -> FloatArray:
        """Angle from the readings less that of the controller (K,) [rad], of mean zero."""
        return self.corrections

    @property
    def angle_scale(self) -> float:
        """Slope of the angles from the readings over the controller's; 1 where both agree."""
        shown = self.sweep.angles[:, self.sweep.joint]
        centred = shown - shown.mean()
        return float(1.0 + centred @ self.corrections / (centred @ centred))

    def target_points(self) -> FloatArray:
        """Targets (T, 3) in the tracker's frame, see `targets` [m]."""
        return self.targets

    def target_influence(self) -> FloatArray:
        """Derivative (3 T, 3 K T) of `target_points` by this sweep's whitened readings."""
        return self.influence[CHART_SIZE:]


@dataclass(frozen=True, eq=False)
class _State:
    inner: Axis
    targets: FloatArray  # (T, 3), tracker's frame
    corrections: FloatArray  # (K,) of the controller's joint [rad]


@dataclass(frozen=True, eq=False)
class _Model:
    """The readings, whitened, and the model of the motion."""

    points: FloatArray  # (K, T, 3)
    weight: FloatArray  # (K, T, 3, 3)
    angles: FloatArray  # (K, 2) inner from b on, outer [rad]
    slopes: FloatArray  # (2,) of these by the controller's angle
    outer: Axis
    basis: FloatArray  # (K, F)

    @classmethod
    def of(
        cls, sweep: Sweep, angles: FloatArray, slopes: FloatArray, outer: Axis, *, free_angles: bool
    ) -> _Model:
        weight = np.where(sweep.present[..., None, None], whitener(sweep.covariance), 0.0)
        points = np.where(sweep.present[..., None], sweep.points, 0.0)
        basis = helmert(len(sweep)).T if free_angles else np.zeros((len(sweep), 0))
        return cls(points, weight, angles, slopes, outer, basis)

    def _turns(self, state: _State) -> tuple[FloatArray, FloatArray]:
        angles = self.angles + state.corrections[:, None] * self.slopes
        return state.inner.turns(angles[:, 0]), self.outer.turns(angles[:, 1])

    def _middle(self, state: _State, turn: FloatArray) -> FloatArray:
        """Targets (K, T, 3) after the outer turn [m]."""
        return self.outer.turned(turn, state.targets)

    def predicted(self, state: _State) -> FloatArray:
        first, second = self._turns(state)
        return state.inner.turned(first, self._middle(state, second))

    def residual(self, state: _State) -> FloatArray:
        return np.asarray((self.weight @ (self.points - self.predicted(state))[..., None]).ravel())

    def jacobian(self, state: _State) -> FloatArray:
        first, second = self._turns(state)
        middle = self._middle(state, second)
        count, targets, _ = middle.shape
        J = np.zeros((count, targets, 3, CHART_SIZE + 3 * targets + self.basis.shape[1]))
        J[..., :CHART_SIZE] = state.inner.turned_by_chart(first, middle)
        both = first @ second
        for t in range(targets):
            J[:, t, :, CHART_SIZE + 3 * t : CHART_SIZE + 3 * t + 3] = both
        spin = self.slopes[0] * np.cross(state.inner.direction, self.predicted(state) - state.inner.point)
        swing = self.slopes[1] * np.cross(self.outer.direction, middle - self.outer.point)
        along = spin + np.einsum("kij,ktj->kti", first, swing)
        J[..., CHART_SIZE + 3 * targets :] = along[..., None] * self.basis[:, None, None, :]
        return np.asarray((self.weight @ J).reshape(count * targets * 3, -1))

    def by_outer(self, state: _State) -> FloatArray:
        """Derivative (3 K T, 4) of the whitened prediction by the outer axis's chart."""
        first, second = self._turns(state)
        moved = first[:, None] @ self.outer.turned_by_chart(second, state.targets)
        return np.asarray((self.weight @ moved).reshape(self.points.size, -1))


def fit_coupled(
    sweep: Sweep,
    model_angles: FloatArray,
    slopes: FloatArray,
    outer: AxisFit,
    *,
    sigma: float | None = None,
    angles: AngleUse = "free",
) -> CoupledFit:
    """Fit the inner axis of a sweep that turns two.

    Args:
        sweep: the readings.
        model_angles: (K, 2) of the inner joint, less its angle in the outer axis's sweep, and of the outer
            joint [rad].
        slopes: (2,) of the model angles by that of the controller's joint.
        outer: the outer axis, from a sweep of its own; joints before it stand there as here, and the
            inner one at the angle that was subtracted.
        sigma: standard uncertainty of a coordinate [m]; from the residuals if None.
        angles: see `circle_point.fit_axis`.

    Raises:
        MeasurementError: the readings do not determine the axis, or the fit does not converge.
    """
    model = _Model.of(sweep, model_angles, slopes, outer.axis, free_angles=angles == "free")
    kept = CHART_SIZE + 3 * sweep.targets

    def stepped(state: _State, step: FloatArray) -> _State:
        moved = state.targets + step[CHART_SIZE:kept].reshape(-1, 3)
        inner = state.inner.displaced(step[:CHART_SIZE])
        return _State(inner, moved, state.corrections + model.basis @ step[kept:])

    state, linear = minimise(_start(sweep, model), model.residual, model.jacobian, stepped, where=sweep.where)
    return _evidence(sweep, outer, model, state, linear, sigma)


def _evidence(
    sweep: Sweep, outer: AxisFit, model: _Model, state: _State, linear: LinearFit, sigma: float | None
) -> CoupledFit:
    dof = 3 * int(sweep.present.sum()) - linear.rank
    if dof < 1 or not linear.determines(slice(0, CHART_SIZE)):
        raise MeasurementError(
            "the readings do not determine the inner one of the two axes that turn",
            where=sweep.where,
            remedy="sweep a wider arc with more positions; two axes that coincide cannot be distinguished",
        )
    rss = float(linear.residual @ linear.residual)
    used = float(np.sqrt(rss / dof)) if sigma is None else sigma
    influence = linear.pseudo_inverse[: CHART_SIZE + 3 * sweep.targets]
    dependence = -influence[:CHART_SIZE] @ model.by_outer(state)
    own = used**2 * linear.covariance[:CHART_SIZE, :CHART_SIZE]
    return CoupledFit(
        sweep=sweep,
        outer=outer,
        axis=state.inner,
        targets=state.targets,
        corrections=state.corrections,
        influence=influence,
        dependence=dependence,
        axis_covariance=own + dependence @ outer.axis_covariance @ dependence.T,
        residuals=np.where(sweep.present[..., None], model.points - model.predicted(state), 0.0),
        sigma=used,
        sigma_stated=sigma is not None,
        rss=rss,
        dof=dof,
        arc=float(np.ptp(sweep.angles[:, sweep.joint] + state.corrections)),
        linear=linear,
    )


def _start(sweep: Sweep, model: _Model) -> _State:
    """Circles about the inner axis; if the outer one turns back as far, about one displaced."""
    inner_angles = model.angles[:, 0]
    inner = start(sweep, inner_angles).axis
    if abs(model.slopes.sum()) < 0.5 * abs(model.slopes[0]):
        columns = np.column_stack([np.ones(len(sweep)), np.cos(inner_angles), np.sin(inner_angles)])
        t = int(np.argmax(sweep.present.sum(axis=0)))
        rows = sweep.present[:, t]
        _, radius, _ = np.linalg.lstsq(columns[rows], sweep.points[rows, t], rcond=None)[0]
        inner = Axis.through(model.outer.point - radius, inner.direction)
    middle = inner.turned(inner.turns(-inner_angles), model.points)
    back = model.outer.turned(model.outer.turns(-model.angles[:, 1]), middle)
    shown = sweep.present[..., None]
    targets = np.where(shown, back, 0.0).sum(axis=0) / np.maximum(shown.sum(axis=0), 1)
    return _State(inner, targets, np.zeros(len(sweep)))
