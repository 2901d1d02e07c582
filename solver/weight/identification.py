"""Stiffness without a load: the whole way, from positions and masses to compliances with their evidence.

    estimate = identify_weight(robot, readings)

An interval of c_j holds all values that some geometry and some masses within their bounds explain as well as
chance allows: ``loss ≤ best + χ²``. As each joint has masses of its own in the program it is an outer bound,
exact where all masses are exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import special

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.conic import weighed_ends
from jointstiff.solver.convex.solution import Certificate
from jointstiff.solver.errors import MeasurementError, NotObservableError
from jointstiff.solver.fitting.fit import student_quantile
from jointstiff.solver.geometry.charts import RigidTransform
from jointstiff.solver.geometry.poses import Motion, PoseState, calibrate
from jointstiff.solver.inference.fit_reasons import unidentified
from jointstiff.solver.inference.verdict import JointCompliance
from jointstiff.solver.predict.models import IdentifiedWeight
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.block import regressor_blocks
from jointstiff.solver.terms.joints import JOINTS
from jointstiff.solver.terms.term import whitened_rows
from jointstiff.solver.text import length_text
from jointstiff.solver.weight.bodies import WeightReadings
from jointstiff.solver.weight.fit import WeightFit, fit_weight
from jointstiff.solver.weight.regressor import Frames, torques_of
from jointstiff.solver.weight.sag import identified_weight

_BEYOND_CHANCE: Final = 1e-3
"""Probability of chance below which residuals or masses count as contradicted."""
_AT_CAP: Final = 0.5
"""Share of the greatest compliance that counts as no bound at all."""


@dataclass(frozen=True)
class WeightedJoint:
    """Result for one joint, with what its interval is due to."""

    joint: JointCompliance  #: compliance, interval, status
    #: width of the interval that exact masses would leave, over its width; None without an interval
    share_of_readings: float | None = None

    @property
    def share_of_masses(self) -> float | None:
        """Return the rest of the width, which better masses would take away."""
        return None if self.share_of_readings is None else 1.0 - self.share_of_readings


def reasons_of(fit: WeightFit, rank: int, freedom: int, *, stated: float | None) -> Iterator[Finding]:
    """Yield the reasons against the result: residuals beyond sigma, and masses that the readings contradict.

    Both sums are χ² where the model holds: that of all that no compliance, weight or geometry explains, and
    that by which the bounds of the masses raise it.
    """
    outside, loss = fit.reduced.outside, fit.optimum.loss
    chance = special.fdtrc(rank, freedom, loss / rank / (outside / freedom))
    if stated is not None and special.chdtrc(freedom, outside) < _BEYOND_CHANCE:
        factor = float(np.sqrt(outside / freedom))
        yield Finding(
            code="residuals_exceed_sigma",
            weight="use_with_care",
            message=(
                f"the residuals give sigma = {length_text(factor * stated)}, but {length_text(stated)} was "
                "stated: something bends or moves that neither geometry nor own weight explains"
            ),
            remedy=(
                "look for gears, links that bend, a target or base that moved; the intervals use the larger "
                "sigma"
            ),
        )
    elif stated is not None:
        chance = special.chdtrc(rank, loss)
    if chance < _BEYOND_CHANCE:
        yield Finding(
            code="masses_contradicted",
            weight="do_not_use",
            message=(
                f"no masses and centres of mass within their bounds explain the readings (p = {chance:.1g})"
            ),
            remedy=(
                "check masses, centres of mass, their frames, and what hung on the flange; or widen the "
                "bounds"
            ),
        )


def joints_of(robot: Robot, fit: WeightFit, sigma: float, rise: float) -> tuple[WeightedJoint, ...]:
    """Return the joints with their intervals.

    Args:
        robot: n joints.
        fit: of the robot and its weight.
        sigma: of a residual, in the fit's unit.
        rise: of the loss that chance allows at the level of the intervals.
    """
    problem = fit.reduced
    intervals = weighed_ends(problem.A, problem.b, fit.optimum, rise, problem.cones)
    first = problem.cones.first
    exact = np.sqrt(rise) * np.linalg.norm(np.linalg.pinv(problem.A[:, first]), axis=1)
    joints = []
    for name, torque in zip(robot.joint_names, fit.rows.torques.known.T, strict=True):
        reason = (
            f"its weight torque hardly varies over the postures ({torque.min():.3g} to {torque.max():.3g} "
            f"N·m), so its sag looks like an offset of {name}'s angle: hang a known payload off its axis, or "
            "pull across it with a known force; a vertical axis carries no weight at all"
        )
        joints.append(WeightedJoint(JointCompliance(name, "not_observable", reason=reason)))
    for k, j in enumerate(problem.seen.tolist()):
        name, unit, (low, high) = robot.joint_names[j], problem.unit[k], intervals[k]
        if not np.isfinite(high - low) or high >= _AT_CAP * problem.cones.cap[k]:
            reason = (
                f"own weight and readings do not determine the compliance of {name}: read more postures in "
                "which its weight torque differs, as a plan for own weight lists them, or hang on a payload"
            )
            joints[j] = WeightedJoint(JointCompliance(name, "not_observable", reason=reason))
            continue
        c = float(fit.compliance[j])
        share = min(1.0, 2.0 * float(exact[k]) / (high - low))
        wide = f"the interval reaches from rigid to {high / max(c / unit, 1e-300):.2g} times the estimate"
        joints[j] = WeightedJoint(
            JointCompliance(
                name,
                "at_bound" if c == 0.0 else "identified" if low > 0.0 else "uncertain",
                c,
                float(0.5 * (high - low) * unit * sigma / np.sqrt(rise)),
                (float(low * unit), float(high * unit)),
                reason=None if low > 0.0 else f"{wide}: add postures, better masses or a known payload",
            ),
            share,
        )
    return tuple(joints)


_STEP: Final = 1e-6  # of difference quotients [rad]


@dataclass(frozen=True, eq=False)
class WeightEstimate:
    """Compliances from own weight, with their evidence."""

    joints: tuple[WeightedJoint, ...]  #: one for each joint
    fit: WeightFit  #: geometry, sag, and the last convex problem
    reasons: tuple[Finding, ...]  #: reasons against its use, if any
    sigma: float  #: standard uncertainty of a coordinate [m], as stated or from the residuals
    sigma_of_residuals: bool  #: whether it is from the residuals: none stated, or larger than stated
    chi_square: float  #: of all residuals, under the stated sigma; the degrees of freedom if none is stated
    degrees_of_freedom: int  #: number of readings less all that they determine
    rms_residual: float  #: rms residual of a whitened coordinate [m]
    rms_without_sag: float  #: the same, of the best geometry of an arm that does not bend [m]
    confidence: float  #: level of the intervals
    #: (N, T, 3) displacement of the targets by the sag, from the geometry that does not bend [m]
    displacement: FloatArray
    residual: FloatArray  #: (N, T, 3) position less prediction [m]; zero where absent
    certificate: Certificate  #: certificate of the last convex program
    #: of the bodies as the products with the compliances have it, to predict the sag; None with balancers
    weight: IdentifiedWeight | None
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
            "positions and deflections are combined, but not all of their uncertainties are stated",
            where="noise",
            remedy="state `noise.sigma` of both",
        )
    whitened = poses.whitened

    def differences(compliance: FloatArray) -> FloatArray:
        """Return the rows of deflections by known loads, in units of their sigma."""
        parts = [np.zeros((0, robot.n + 1))]
        for block in [] if loaded is None else regressor_blocks(robot, loaded, compliance):
            rows = whitened_rows(block, [JOINTS], compliance)
            read = (rows.targets, rows.encoders)
            parts += [part.reshape(-1, robot.n + 1) for part in read if part is not None]
        return np.concatenate(parts) / (1.0 if loaded is None else loaded.sigma or 1.0)

    rigid = calibrate(robot.chain, poses, start=base, hold_out=False)
    frames = Frames.of(robot, base)
    fit = fit_weight(
        readings,
        replace(whitened, weight=whitened.weight / (poses.sigma or 1.0)),
        frames,
        PoseState(rigid.axes, rigid.targets, np.zeros(len(poses))),
        free_gravity=free_gravity,
        differences=differences,
    )
    problem, loss = fit.reduced, fit.optimum.loss
    rank = int(np.linalg.matrix_rank(problem.A))
    remaining = problem.freedom
    if loaded is not None:
        encoders = 0 if loaded.encoders is None else int(loaded.encoders.present.sum())
        remaining += int(loaded.coordinates.sum()) + encoders
    freedom = remaining - rank
    if freedom < 1:
        raise NotObservableError(
            f"{remaining} coordinates that remain after the fit of the geometry do not determine "
            f"{rank} "
            "compliances and weights",
            where="observations",
            remedy="read more postures, or more targets in each posture",
        )
    factor = float(np.sqrt(problem.outside / freedom))  # of the residuals, in the stated sigma
    reasons = tuple(reasons_of(fit, rank, freedom, stated=poses.sigma))
    noisy = poses.sigma is None or any(reason.code == "residuals_exceed_sigma" for reason in reasons)
    scale = factor if noisy else 1.0
    radius = student_quantile(0.5 + 0.5 * confidence, freedom if noisy else None)
    joints = joints_of(robot, fit, scale, (scale * radius) ** 2)
    statuses = [joint.joint.status for joint in joints]
    missing = unidentified(statuses, "read more postures, better masses or a known payload")
    uncertainty = np.array([joint.joint.standard_uncertainty or 0.0 for joint in joints])
    unit = poses.sigma or 1.0
    sagging = replace(whitened, angles=whitened.angles + fit.sag)
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
        reasons=(*reasons, *missing),
        sigma=scale * unit,
        sigma_of_residuals=noisy,
        chi_square=float(freedom) if poses.sigma is None else problem.outside,
        degrees_of_freedom=freedom,
        rms_residual=unit * float(np.sqrt((problem.outside + loss) / remaining)),
        rms_without_sag=float(np.sqrt(rigid.rss / rigid.dof)),
        confidence=confidence,
        displacement=bent - Motion(fit.state, whitened).stages[0],
        residual=np.where(poses.present[..., None], whitened.points - bent, 0.0),
        certificate=fit.optimum.certificate,
        weight=identified_weight(readings.burden, fit, scale, uncertainty),
        largest_stiffness_ratio=largest,
    )
