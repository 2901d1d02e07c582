"""All axes and targets at once, from readings in many configurations, by maximum likelihood.

    p_kt = E_1(q_k1) E_2(q_k2) … E_n(q_kn) x_t

with E_i the rotation about axis i as it lies at model angle zero, and x_t the target there, both in the
tracker's frame. With four numbers for each axis and three for each target the model is complete and has no
number too many: offsets of joint angles, base and flange frame are conventions that are laid on it
afterwards. Angles are the controller's, but for corrections that a caller may free.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.gauss_newton import LinearFit, minimise
from jointstiff.solver.geometry.sweeps.axis import CHART_SIZE, Axis
from jointstiff.solver.geometry.sweeps.sweep import refuse_other_sigma, refuse_other_unit
from jointstiff.solver.robot.model import JointMap


@dataclass(frozen=True, eq=False)
class PoseReadings:
    """Readings in N configurations, whitened."""

    angles: FloatArray  #: (N, n) angles of the model [rad]
    points: FloatArray  #: (N, T, 3) tracker's frame [m]; zero where absent
    weight: FloatArray  #: (N, T, 3, 3) whiteners in units of 1/sigma; zero where absent
    slopes: FloatArray  #: (N, n) slopes of the model angles by the correction of a configuration
    #: (N, F) combinations of the corrections that are estimated; None: each configuration's own, eliminated
    #: from its own readings
    basis: FloatArray | None


@dataclass(frozen=True, eq=False)
class PoseState:
    """Unknowns of the fit of the poses."""

    axes: tuple[Axis, ...]  #: n at angle zero, tracker's frame
    targets: FloatArray  #: (T, 3) at angle zero, tracker's frame [m]
    corrections: FloatArray  #: (N,) corrections of the angles [rad]

    def displaced(self, step: FloatArray) -> PoseState:
        """Return the state after a step of charts, of the first axes, and then of all targets."""
        moves = step[: len(step) - self.targets.size].reshape(-1, CHART_SIZE)
        axes = tuple(axis.displaced(move) for axis, move in zip(self.axes, moves, strict=False))
        targets = self.targets + step[CHART_SIZE * len(moves) :].reshape(-1, 3)
        return replace(self, axes=axes + self.axes[len(moves) :], targets=targets)


def fit_poses(
    readings: PoseReadings,
    first: PoseState,
    *,
    where: str,
    fitted: int | None = None,
    enough: float = 0.0,
) -> tuple[PoseState, LinearFit]:
    """Fit axes, targets and free corrections.

    Unknowns are in this order: charts (4 n), targets (3 T), then the corrections' (F). Where the readings
    leave a combination of the unknowns undetermined, it stays as it was at the start.

    Args:
        readings: in at least two configurations.
        first: where to start from.
        where: for messages.
        fitted: number of axes, base first, that are fitted; all if None. The others stay as they are.
        enough: residual [rms, whitened] below which a fit that goes on slowly has converged.

    Raises:
        MeasurementError: no convergence.
    """
    fitted = len(first.axes) if fitted is None else fitted
    charts = CHART_SIZE * fitted
    still = slice(charts, CHART_SIZE * len(first.axes))
    kept = charts + first.targets.size
    basis = readings.basis

    def stepped(state: PoseState, step: FloatArray) -> PoseState:
        correction = step[kept:] if basis is None else basis @ step[kept:]
        return replace(state.displaced(step[:kept]), corrections=state.corrections + correction)

    def residual(state: PoseState) -> FloatArray:
        gaps = readings.points - Motion(state, readings).stages[0]
        return np.asarray((readings.weight @ gaps[..., None]).ravel())

    def jacobian(state: PoseState) -> FloatArray:
        motion = Motion(state, readings)
        J = np.delete(motion.jacobian(), still, axis=-1)
        if basis is not None and basis.size:
            J = np.concatenate([J, motion.spin(readings)[..., None] * basis[:, None, None]], axis=-1)
        return np.asarray((readings.weight @ J).reshape(readings.points.size, -1))

    def by_correction(state: PoseState) -> FloatArray:
        spin = Motion(state, readings).spin(readings)
        return np.asarray((readings.weight @ spin[..., None]).reshape(len(spin), -1))

    size = float(np.linalg.norm(readings.weight @ readings.points[..., None]))
    by_own = by_correction if basis is None else None
    return minimise(first, residual, jacobian, stepped, where=where, by_own=by_own, size=size, enough=enough)


class Motion:
    """Targets after the last i joints, and the rotations of the first i joints, for all configurations.

    Attributes:
        state: at which they are taken.
        turns: n of (N, 3, 3), each joint's own rotation.
        before: n + 1 of (N, 3, 3), product of the rotations of the joints before i.
        stages: n + 1 of (N, T, 3): targets turned by joints i and beyond [m]; stage 0 is the prediction.
    """

    def __init__(self, state: PoseState, readings: PoseReadings) -> None:
        angles = readings.angles + state.corrections[:, None] * readings.slopes
        self.state = state
        self.turns = [axis.turns(angles[:, i]) for i, axis in enumerate(state.axes)]
        self.before = [np.broadcast_to(np.eye(3), (len(angles), 3, 3))]
        for turn in self.turns:
            self.before.append(self.before[-1] @ turn)
        stage = np.broadcast_to(state.targets, readings.points.shape)
        self.stages = [stage]
        for axis, turn in zip(reversed(state.axes), reversed(self.turns), strict=True):
            stage = axis.turned(turn, stage)
            self.stages.insert(0, stage)

    def jacobian(self) -> FloatArray:
        """Derivative (N, T, 3, 4 n + 3 T) of the prediction by charts and targets."""
        count, targets, _ = self.stages[0].shape
        charts = CHART_SIZE * len(self.state.axes)
        J = np.zeros((count, targets, 3, charts + 3 * targets))
        for i, axis in enumerate(self.state.axes):
            by_chart = axis.turned_by_chart(self.turns[i], self.stages[i + 1])
            J[..., CHART_SIZE * i : CHART_SIZE * (i + 1)] = self.before[i][:, None] @ by_chart
        for t in range(targets):
            J[:, t, :, charts + 3 * t : charts + 3 * t + 3] = self.before[-1]
        return J

    def swings(self) -> FloatArray:
        """Derivative (N, T, 3, n) of the prediction by the joint angles of each configuration [m/rad]."""
        swings = np.empty((*self.stages[0].shape, len(self.state.axes)))
        for i, axis in enumerate(self.state.axes):
            swing = np.cross(axis.direction, self.stages[i] - axis.point)
            swings[..., i] = swing @ np.swapaxes(self.before[i], -1, -2)
        return swings

    def spin(self, readings: PoseReadings) -> FloatArray:
        """Derivative (N, T, 3) of the prediction by each configuration's correction [m/rad]."""
        return np.asarray(np.einsum("ktin,kn->kti", self.swings(), readings.slopes))


@dataclass(frozen=True, eq=False)
class Poses:
    """Unloaded readings in N configurations, T targets. Arrays are checked and made read-only.

    Raises:
        MeasurementError: shapes disagree, a number is not finite, sigma is not positive, or the unit of
            length is wrong.
    """

    angles: FloatArray  #: (N, n) as the controller shows them [rad]
    points: FloatArray  #: (N, T, 3) tracker's frame [m]; anything where absent
    present: BoolArray  #: (N, T) True for targets that were read
    targets: tuple[str, ...]  #: names of the T targets
    joint_map: JointMap  #: from controller to model angles
    sigma: float | None = None  #: standard uncertainty of one coordinate [m]; None if unknown
    #: (3, 3) or (N, T, 3, 3) of the readings in units of sigma²
    covariance: FloatArray = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        count = len(self.angles)
        shape = (count, len(self.targets))
        if (
            self.angles.shape != (count, self.joint_map.n)
            or self.present.shape != shape
            or self.points.shape != (*shape, 3)
            or self.covariance.shape not in {(3, 3), (*shape, 3, 3)}
        ):
            raise MeasurementError(
                f"the angles have shape {self.angles.shape} and the readings {self.points.shape}, for "
                f"{self.joint_map.n} joints and {len(self.targets)} targets",
                where="poses",
                remedy="give all joint angles and a reading of each target for each pose",
            )
        if not (np.isfinite(self.angles).all() and np.isfinite(self.points[self.present]).all()):
            raise MeasurementError(
                "an angle or a coordinate is not finite", where="poses", remedy="omit or repeat the reading"
            )
        refuse_other_sigma(self.sigma)
        refuse_other_unit(self._span)
        for array in (self.angles, self.points, self.present, self.covariance):
            array.setflags(write=False)

    def __getitem__(self, rows: BoolArray) -> Poses:
        """Return some of the configurations (N,)."""
        covariance = self.covariance if self.covariance.ndim == 2 else self.covariance[rows]
        angles, points, present = self.angles[rows], self.points[rows], self.present[rows]
        return replace(self, angles=angles, points=points, present=present, covariance=covariance)

    @property
    def _span(self) -> float:
        """Diagonal of the box around all readings [m]."""
        read = self.points[self.present]
        return float(np.linalg.norm(np.ptp(read, axis=0))) if len(read) else 0.0
