"""Stiffness without a load: the whole way, from positions and masses to compliances with their evidence.

    estimate = identify_weight(robot, readings)

An interval of c_j holds all values that some geometry and some masses within their bounds explain as well as
chance allows: ``loss ≤ best + χ²``. As each joint has masses of its own in the program it is an outer bound,
exact where all masses are exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import stats

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.certificate import Certificate
from jointstiff.solver.errors import MeasurementError, NotObservableError
from jointstiff.solver.geometry.frames.rigid_transform import RigidTransform
from jointstiff.solver.geometry.model.kinematic_calibration import calibrate, pose_readings
from jointstiff.solver.geometry.sweeps.pose_fit import Motion, PoseState
from jointstiff.solver.inference.reason import Reason
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.regression.regressor import regressor_blocks
from jointstiff.solver.regression.stage_rows import encoder_readings, target_readings
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.weight.bodies import WeightReadings
from jointstiff.solver.weight.evidence import WeightedJoint, joints_of, reasons_of
from jointstiff.solver.weight.fit import Differences, WeightFit, fit_weight
from jointstiff.solver.weight.regressor import Frames, torques_of

_STEP: Final = 1e-6  # of difference quotients [rad]


@dataclass(frozen=True, eq=False)
class WeightEstimate:
    """Compliances from own weight, with their evidence."""

    joints: tuple[WeightedJoint, ...]  #: one for each joint
    fit: WeightFit  #: geometry, sag, and the last convex problem
    reasons: tuple[Reason, ...]  #: against using it as it stands; none where all is well
    sigma: float  #: standard uncertainty of a coordinate [m], as stated or from the residuals
    chi_square: float  #: of all residuals, under the stated sigma; the degrees of freedom if none is stated
    degrees_of_freedom: int  #: number of readings less all that they determine
    rms_residual: float  #: of a whitened coordinate [m]
    rms_without_sag: float  #: the same, of the best geometry of an arm that does not bend [m]
    confidence: float  #: level of the intervals
    #: (N, T, 3) of the targets by the sag, from the geometry that does not bend [m]
    displacement: FloatArray
    residual: FloatArray  #: (N, T, 3) position less prediction [m]; zero where absent
    certificate: Certificate  #: of the last convex program
    #: largest |∂τ_i/∂θ_j| c_i: effect of the sag on the torques, which the balance includes
    largest_stiffness_ratio: float


def identify_weight(
    robot: Robot,
    readings: WeightReadings,
    *,
    confidence: float = 0.95,
    free_gravity: bool = False,
    base: RigidTransform | None = None,
    loaded: Measurements | None = None,
) -> WeightEstimate:
    """Identify compliances from the sag of an arm under its own weight.

    Args:
        robot: nominal, n joints; its axes and the targets are estimated.
        readings: N observations.
        confidence: level of the intervals.
        free_gravity: whether gravity's direction is estimated; else it is as stated.
        base: from R0 to the frame of the positions; the same if None.
        loaded: deflections by known loads (loaded − unloaded), which join in.

    Raises:
        MeasurementError: no convergence, or positions and deflections join without their sigmas.
        NotObservableError: fewer coordinates than unknowns, or no weight torque varies.
        SolverError: a convex program is not certified.
    """
    poses, base = readings.poses, base or RigidTransform.identity()
    if loaded is not None and (poses.sigma is None or loaded.sigma is None):
        raise MeasurementError(
            "positions and deflections join, but not all of their uncertainties are stated",
            where="noise",
            remedy="state `noise.sigma` of both",
        )
    angles = poses.joint_map.model_angles(poses.angles)
    whitened = pose_readings(angles, poses)
    rigid = calibrate(robot.chain, poses, start=base)
    frames = Frames.of(robot, base)
    fit = fit_weight(
        readings,
        replace(whitened, weight=whitened.weight / (poses.sigma or 1.0)),
        frames,
        PoseState(rigid.axes, rigid.targets, np.zeros(len(angles))),
        free_gravity=free_gravity,
        differences=None if loaded is None else _differences(robot, loaded),
    )
    problem, loss = fit.reduced, fit.optimum.loss
    rank = int(np.linalg.matrix_rank(problem.A))
    freedom = problem.freedom - rank
    if freedom < 1:
        raise NotObservableError(
            f"{problem.freedom} coordinates beyond those that the geometry takes do not determine {rank} "
            "compliances and weights",
            where="observations",
            remedy="read more postures, or more targets in each posture",
        )
    factor = float(np.sqrt(problem.outside / freedom))  # of the residuals, in the stated sigma
    reasons = tuple(reasons_of(fit, rank, freedom, stated=poses.sigma))
    noisy = poses.sigma is None or any(reason.code == "residuals_exceed_sigma" for reason in reasons)
    scale = factor if noisy else 1.0
    radius = stats.t.ppf(0.5 + 0.5 * confidence, freedom) if noisy else stats.norm.ppf(0.5 + 0.5 * confidence)
    joints = joints_of(robot, fit, scale, (scale * radius) ** 2)
    unit = poses.sigma or 1.0
    sagging = replace(whitened, angles=angles + fit.sag)
    bent = Motion(fit.state, sagging).stages[0]
    # Largest |∂τ_i/∂θ_j| c_i in the postures that sag, by central differences
    largest = 0.0
    for step in _STEP * np.eye(len(fit.compliance)):
        ahead, behind = (
            torques_of(
                readings, frames, Motion(fit.state, replace(sagging, angles=sagging.angles + part))
            ).known
            for part in (step, -step)
        )
        largest = max(largest, float((np.abs(ahead - behind) * fit.compliance).max()) / (2.0 * _STEP))
    return WeightEstimate(
        joints=joints,
        fit=fit,
        reasons=reasons,
        sigma=scale * unit,
        chi_square=float(freedom) if poses.sigma is None else problem.outside,
        degrees_of_freedom=freedom,
        rms_residual=unit * float(np.sqrt((problem.outside + loss) / problem.freedom)),
        rms_without_sag=float(np.sqrt(rigid.rss / rigid.dof)),
        confidence=confidence,
        displacement=bent - Motion(fit.state, whitened).stages[0],
        residual=np.where(poses.present[..., None], whitened.points - bent, 0.0),
        certificate=fit.optimum.certificate,
        largest_stiffness_ratio=largest,
    )


def _differences(robot: Robot, loaded: Measurements) -> Differences:
    """Return the rows of deflections by known loads, in units of their sigma."""

    def rows(compliance: FloatArray) -> FloatArray:
        parts = []
        for block in regressor_blocks(robot, loaded, compliance):
            read = (target_readings(block), encoder_readings(block, np.arange(robot.n)))
            parts += [part.whitened().reshape(-1, robot.n + 1) for part in read if part is not None]
        return np.concatenate(parts) / (loaded.sigma or 1.0)

    return rows
