"""Identify the geometry of a robot from sweeps or unloaded poses: one call from readings to a robot.

Every number has an uncertainty. Suspicions about the readings are reported with figures; nothing is corrected
silently.

The anomalies of a sweep are hypotheses, each with columns of its own in the fit: from position s on, the
tracker sees all targets displaced by one rigid motion (the tracker was bumped); one position is displaced; or
one reading is displaced. Each hypothesis is tested by an F-test: the decrease of the sum of squares when the
fit is repeated (to first order) with the hypothesis, against the remaining sum of squares. The test needs no
sigma, and does not blame neighbours: a bump in the middle also disturbs the readings around it, but a bump
explains them all with six numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy import special

from jointstiff.schemas import geometry as results
from jointstiff.schemas.finding import (
    ROOT_MISTAKES,
    Assessment,
    Finding,
    FindingCode,
    Verdict,
    combine_assessments,
)
from jointstiff.schemas.geometry import LinkComparison, SweepEvidence
from jointstiff.schemas.robot import JointMap as StoredJointMap
from jointstiff.schemas.robot import RobotDocument, UrdfModel
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import InputError, MeasurementError
from jointstiff.solver.geometry.frames import (
    BaseFrame,
    BaseTargets,
    FlangeConvention,
    NearlyParallel,
    build_dh_table,
    compare_links,
    find_base_frame,
    find_wrist_centre,
    identify_model,
    name_joints,
)
from jointstiff.solver.geometry.nominal import ComparedReadings, inspect_nominal, report_misfit
from jointstiff.solver.geometry.poses import (
    VAGUE_UNCERTAINTY,
    Axis,
    CalibratedAxes,
    IdentifiedAxes,
    Poses,
    calibrate,
    refuse_other_joint_count,
)
from jointstiff.solver.geometry.sweeps import (
    SWEEPS_DISAGREE_P_VALUE,
    UNEVEN_GEARS_P_VALUE,
    AngleUse,
    AxisFit,
    SweepSet,
    SweptAxes,
    compute_restriction_p_value,
    identify_axes,
    propagate_resting_angle_errors,
    refine_axes,
)
from jointstiff.solver.mechanics.chain import Convention, KinematicChain
from jointstiff.solver.mechanics.postures import WRIST_JOINTS, skew
from jointstiff.solver.mechanics.robot import JointMap, KnownRobot
from jointstiff.solver.mechanics.urdf import write_urdf
from jointstiff.solver.messages import build_messages, to_rigid
from jointstiff.solver.text import length_text

AnomalyCode = Literal["tracker_bumped", "position_suspect", "reading_suspect"]

FALSE_ALARM = 1e-6
"""Probability that a clean sweep gets any finding (significance level)."""

MOST_ANOMALIES = 5
"""Maximum number of anomalies of one sweep; with more, the whole sweep is wrong."""

SHORT_ARC = np.radians(30.0)
"""Arc [rad] below which an axis gets a warning: its centre is then ten times as uncertain along the
sagitta as over a half turn."""

LEAST_BUMP_RATIO = 3.0
"""Least ratio of a bump's displacement to a typical residual of all sweeps: a smaller displacement may come
from the model or a gear."""

CENTRES_DISAGREE_P_VALUE = 1e-4
"""p-value below which two estimates of the wrist centre count as contradictory."""

RUNAWAY_ANGLE = 1e-2
"""Angle of neighbouring axes [rad] below which their common perpendicular is beyond any robot's size."""

_ANGLE_SCALE_TOLERANCE = 1e-3  # largest relative difference of the arcs of controller and tracker

_LEAST_NEW_SHARE = 1e-8
"""Share of a hypothesis that remains in the residuals (squared), below which it cannot be distinguished from
the fit."""

_CLEAR_UNCERTAINTIES = 3.0
"""Number of standard uncertainties by which a component of a displacement must differ from zero to be
stated."""

_LEAST_POSITIONS_PER_SIDE = 2  # before and after a bump; with fewer, only one position is displaced

_FINDING_WEIGHTS: Final[dict[FindingCode, Verdict]] = {
    "tracker_bumped": "do_not_use",
    "angle_scale_suspect": "do_not_use",
    "residuals_below_sigma": "use",
    "axes_nearly_parallel": "use",
}
"""Weights of findings whose weight is not `use_with_care`."""


_NOMINAL_MISTAKES: Final = ROOT_MISTAKES | {"joint_sign_suspect"}
"""Codes of mistakes by which the readings do not fit the nominal model; other findings follow from them."""


def _make_finding(code: FindingCode, where: str, message: str, remedy: str) -> Finding:
    """Return a finding whose weight depends on its code.

    The weight is `use_with_care`, unless `_FINDING_WEIGHTS` has another weight for the code.
    """
    weight = _FINDING_WEIGHTS.get(code, "use_with_care")
    return Finding(code=code, weight=weight, where=where, message=message, remedy=remedy)


def report_sweeps(identified: SweptAxes, joint_fit: SweptAxes) -> Iterator[Finding]:
    """Yield findings about each sweep: anomalies, a short arc, implausible noise or angles.

    Args:
        identified: axes from a separate fit of each sweep.
        joint_fit: the fit of all sweeps together, whose residuals show how well the model describes the
            robot.
    """
    typical_variance = float(np.median([fit.linear.rss / fit.dof for fit in identified.fits]))
    # Standard uncertainty from the median of the residuals, which a few sweeps that do not fit hardly change
    residuals = joint_fit.residual.reshape(-1, 3)[joint_fit.sweeps.present.ravel()]
    robust_sigma = (
        np.median(np.abs(residuals)) / special.ndtri(0.75) * np.sqrt(residuals.size / joint_fit.dof)
    )
    for fit in identified.fits:
        least_bump = LEAST_BUMP_RATIO * float(robust_sigma)
        yield from report_sweep(
            fit, identified.names, typical_variance=typical_variance, least_bump=least_bump
        )


def report_sweep(
    fit: AxisFit, names: tuple[str, ...], *, typical_variance: float = 0.0, least_bump: float = 0.0
) -> Iterator[Finding]:
    """Yield findings about one sweep; a clean sweep yields nothing.

    Args:
        fit: the fit of this sweep alone.
        names: names of the targets.
        typical_variance: variance of a residual in the other sweeps [m²]; smaller residuals are no anomaly.
        least_bump: displacement [m] below which a bump is not reported.
    """
    where = fit.sweep.where
    for anomaly, displacement, probability in _find_anomalies(fit, typical_variance):
        if anomaly.code == "tracker_bumped" and displacement < least_bump:
            continue
        target = "" if anomaly.target is None else f", target {names[anomaly.target]}"
        anomaly_where = f"{where}, position {anomaly.position + 1}{target}"
        effect, remedy = _ANOMALY_TEXTS[anomaly.code]
        message = effect.format(f"about {length_text(displacement)} (p = {probability:.1g})")
        yield _make_finding(anomaly.code, anomaly_where, message, remedy)
    if fit.arc < SHORT_ARC:
        spread = float(np.sqrt(np.linalg.eigvalsh(fit.axis_covariance[:2, :2]).max()))
        arc = float(np.degrees(fit.arc))
        message = f"an arc of {arc:.3g}° determines the axis only within {length_text(spread)}"
        yield _make_finding("short_arc", where, message, "sweep at least 90°")
    chi_square = fit.linear.rss / fit.sigma**2
    rms = length_text(float(np.sqrt(fit.linear.rss / fit.dof)))
    message = f"the residuals give sigma = {rms}, but {length_text(fit.sigma)} was stated: the uncertainties"
    if special.chdtrc(fit.dof, chi_square) < FALSE_ALARM:
        message += " are too small"
        remedy = "correct or omit sigma; poor repeatability of the robot has the same effect"
        yield _make_finding("residuals_exceed_sigma", where, message, remedy)
    elif special.chdtr(fit.dof, chi_square) < FALSE_ALARM:
        message += " are too large"
        remedy = "check the unit of sigma"
        yield _make_finding("residuals_below_sigma", where, message, remedy)
    if abs(fit.angle_scale - 1.0) > _ANGLE_SCALE_TOLERANCE:
        yield _make_finding(
            "angle_scale_suspect",
            where,
            f"the joint turned {fit.angle_scale:.4f} times as far as the controller's angles and the "
            f"joint map give; {1.0 - _ANGLE_SCALE_TOLERANCE:g} to {1.0 + _ANGLE_SCALE_TOLERANCE:g} rad/rad "
            "is plausible",
            "check the joint map, the unit of the angles, and the order of the rows; state another gear "
            "ratio in the joint map",
        )


_ANOMALY_TEXTS: Final[dict[AnomalyCode, tuple[str, str]]] = {
    "tracker_bumped": (
        "from this position on, all readings are displaced by {}: the tracker or the robot's base was bumped",
        "repeat the sweep, or omit the positions before or after the bump",
    ),
    "position_suspect": (
        "all targets are displaced by {}",
        "the robot may not have come to rest, or the angles belong to another position: omit the position",
    ),
    "reading_suspect": ("this reading is displaced by {}", "omit or repeat the reading"),
}
"""Effects and remedies of anomalies."""


@dataclass(frozen=True, eq=False)
class _Anomaly:
    """Hypothesis that some readings of a sweep are displaced: after a bump, in a position, or one reading."""

    code: AnomalyCode
    position: int  # index of the (first) position
    target: int | None  # index of the target of a single reading; None where all targets are displaced
    readings: BoolArray  # (K, T) displaced readings: from the position on, at the position, or a single one


@dataclass(frozen=True, eq=False)
class _ExplainedReadings:
    """Readings of a sweep (K positions, T targets), and the part that fit and known anomalies explain."""

    points: FloatArray  # (K, T, 3) readings
    weight: FloatArray  # (K, T, 3, 3) whiteners of the readings
    basis: FloatArray  # (K, T, 3, p) orthonormal columns that span the whitened readings explained so far
    residual: FloatArray  # (K, T, 3) whitened residuals, normal to the basis
    dof: int  # degrees of freedom of the residuals

    def compute_whitened_motion(self, anomaly: _Anomaly) -> FloatArray:
        """Return the whitened displacements (M, 3, 3 or 6) of M readings for unit motions of a hypothesis.

        A single reading is translated; several readings are translated, then rotated about their mean, with
        the rotation scaled by their spread so that all columns are lengths.
        """
        W = self.weight[anomaly.readings]
        if anomaly.code == "reading_suspect":
            return W
        arms = self.points[anomaly.readings] - self.points[anomaly.readings].mean(axis=0)
        spread = max(float(np.sqrt(np.mean(arms**2))), 1e-9)
        return np.concatenate([W, -W @ skew(arms) / spread], axis=-1)

    def solve_projected(
        self, columns: FloatArray, readings: BoolArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Solve the normal equations of columns (M, 3, c) at M readings, with the basis projected out.

        Returns:
            Eigenvalues (r,) and eigenvectors (c, r) of the normal matrix, and the residuals (r,) along the
            eigenvectors; combinations of columns that the basis already explains are omitted.
        """
        explained = np.einsum("mip,miq->pq", self.basis[readings], columns)
        normal_matrix = np.einsum("mip,miq->pq", columns, columns)
        values, vectors = np.linalg.eigh(normal_matrix - explained.T @ explained)
        is_new = values > _LEAST_NEW_SHARE * np.trace(normal_matrix)
        along = vectors[:, is_new].T @ np.einsum("mip,mi->p", columns, self.residual[readings])
        return values[is_new], vectors[:, is_new], along

    def compute_f_test(self, anomaly: _Anomaly, least_variance: float) -> tuple[float, float]:
        """Return the log of a hypothesis's p-value in the F-test, and the remaining residual variance [m²].

        The variance is at least `least_variance`. A hypothesis that cannot be tested has p-value 1.
        """
        values, _, along = self.solve_projected(self.compute_whitened_motion(anomaly), anomaly.readings)
        rank, dof = len(values), self.dof - len(values)
        if rank == 0 or dof < 1:
            return 0.0, 0.0
        gain = float(along**2 @ (1.0 / values))  # decrease of the sum of squares
        variance = max(max(float(np.sum(self.residual**2)) - gain, 1e-300) / dof, least_variance)
        # special.fdtrc is used because stats.f takes fifty times as long.
        probability = float(special.fdtrc(rank, dof, gain / rank / variance))
        return (math.log(probability) if probability > 0.0 else -math.inf), variance

    def estimate_displacement(self, anomaly: _Anomaly, variance: float) -> float:
        """Return the size [m] of a displacement by an anomaly; components within noise count as zero."""
        values, vectors, along = self.solve_projected(self.weight[anomaly.readings], anomaly.readings)
        is_clear = along**2 > _CLEAR_UNCERTAINTIES**2 * variance * values
        return float(np.linalg.norm(vectors[:, is_clear] @ (along[is_clear] / values[is_clear])))

    def add_motion(self, anomaly: _Anomaly) -> _ExplainedReadings:
        """Return the readings with the motion of a further anomaly added to the explained part."""
        columns = self.compute_whitened_motion(anomaly)
        values, vectors, _ = self.solve_projected(columns, anomaly.readings)
        motion = np.zeros((*self.points.shape, len(values)))
        motion[anomaly.readings] = columns @ (vectors / np.sqrt(values))
        new_basis = motion - self.basis @ np.einsum("ktip,ktiq->pq", self.basis, motion)
        residual = self.residual - new_basis @ np.einsum("ktip,kti->p", new_basis, self.residual)
        basis = np.concatenate([self.basis, new_basis], axis=-1)
        return _ExplainedReadings(self.points, self.weight, basis, residual, self.dof - len(values))


def _find_anomalies(fit: AxisFit, typical_variance: float) -> Iterator[tuple[_Anomaly, float, float]]:
    """Find anomalies of a sweep one after the other, the most significant first.

    Args:
        fit: fit of the sweep.
        typical_variance: variance of a residual in the other sweeps [m²]; smaller residuals count as noise.

    Yields:
        At most `MOST_ANOMALIES` tuples: the anomaly; the size of its displacement [m], without components
        that another axis or angle would explain as well; and the p-value times the number of hypotheses
        tested (Bonferroni).
    """
    sweep, linear, present = fit.sweep, fit.linear, fit.sweep.present
    shape = sweep.points.shape
    # Rounding leaves a small part of the residual in the range of the fit: remove it.
    residual = linear.residual - linear.range_basis @ (linear.range_basis.T @ linear.residual)
    explained = _ExplainedReadings(
        sweep.points_or_zero,
        sweep.weight,
        linear.range_basis.reshape(*shape, -1),
        residual.reshape(shape),
        fit.dof,
    )
    count, targets = present.shape
    position, target = np.arange(count)[:, None], np.arange(targets)[None, :]
    starts = range(_LEAST_POSITIONS_PER_SIDE, count - _LEAST_POSITIONS_PER_SIDE + 1)
    suspects = [_Anomaly("tracker_bumped", s, None, present & (position >= s)) for s in starts]
    for k in range(count):
        if present[k].sum() > 1:
            suspects.append(_Anomaly("position_suspect", k, None, present & (position == k)))
        suspects.extend(
            _Anomaly("reading_suspect", k, int(t), present & (position == k) & (target == t))
            for t in np.flatnonzero(present[k])
        )
    for _ in range(min(MOST_ANOMALIES, len(suspects))):
        tests = [explained.compute_f_test(anomaly, typical_variance) for anomaly in suspects]
        best = min(range(len(tests)), key=lambda index: tests[index][0])
        log_probability, variance = tests[best][0] + math.log(len(tests)), tests[best][1]
        if log_probability > math.log(FALSE_ALARM):
            break
        anomaly = suspects.pop(best)
        yield anomaly, explained.estimate_displacement(anomaly, variance), math.exp(log_probability)
        explained = explained.add_motion(anomaly)


def report_disagreement(probability: float | None) -> Iterator[Finding]:
    """Report that one robot geometry does not fit all sweeps, if the p-value of the common fit is too small.

    `probability` is the p-value of an F-test of the common fit against separate fits of the sweeps; None
    reports nothing.
    """
    if probability is not None and probability < SWEEPS_DISAGREE_P_VALUE:
        yield _make_finding(
            "sweeps_disagree",
            "sweeps",
            f"no single robot model fits all sweeps (p = {probability:.1g}), because joints at rest "
            "deviated from the controller's angles, or the arm sagged: each axis comes from the fit of "
            "its own sweep",
            "use the result with its larger uncertainties; for smaller uncertainties, rest all joints at "
            "the same angles in all sweeps, approached from the same side",
        )


def report_calibration(calibrated: CalibratedAxes) -> Iterator[Finding]:
    """Report residuals that exceed the stated sigma, and unknowns that the poses do not determine."""
    if calibrated.exceeded_sigma is not None:
        yield _make_finding(
            "residuals_exceed_sigma",
            "poses",
            f"the residuals give sigma = {length_text(calibrated.sigma)}, but "
            f"{length_text(calibrated.exceeded_sigma)} was stated: no geometry explains gear errors and "
            "sag, so they enlarge sigma; the uncertainties include the part that changes from pose to "
            "pose",
            "sweep single joints to see gear errors separately, or correct sigma",
        )
    for names in calibrated.evidence.only_together:
        combination = "a combination of " if len(names) > 1 else ""
        yield _make_finding(
            "parameters_not_identified",
            "poses",
            f"the poses do not determine {combination}{', '.join(names)}: nominal values are kept",
            "add poses in which all joints turn over most of their range",
        )


def report_wrist_disagreement(wrist: results.WristResult) -> Iterator[Finding]:
    """Report pairs of estimates of the wrist centre that differ by more than noise explains."""
    for pair in wrist.distances:
        if pair.probability < CENTRES_DISAGREE_P_VALUE:
            yield _make_finding(
                "wrist_centres_disagree",
                "sweeps",
                f"the wrist centres found by {pair.first} and {pair.second} are {length_text(pair.distance)} "
                f"apart, more than their uncertainties explain (p = {pair.probability:.1g})",
                "check the sweeps of the wrist joints; axes that do not intersect have no common centre",
            )


def report_drift(drift: results.Drift, targets: BaseTargets) -> Iterator[Finding]:
    """Report a motion between tracker and base, and base targets that moved relative to the others."""
    if drift.significant:
        size = float(np.linalg.norm(drift.displacement))
        direction = np.array(drift.displacement) / max(size, 1e-300)
        spread = float(np.sqrt(direction @ drift.displacement_covariance @ direction))
        yield _make_finding(
            "base_drifted",
            targets.where,
            "tracker and robot base moved relative to each other between the two readings of the base "
            f"targets: by {length_text(size)} (u = {length_text(spread)}) at the robot, with a turn of "
            f"{np.linalg.norm(drift.rotation) * 1e6:.0f} µrad",
            "correct later readings with the given transform, or measure again",
        )
    for target in drift.moved_targets:
        # Move the later reading back with the base; what remains is the target's own motion.
        motion, index = drift.transform_after_to_before, targets.names.index(target)
        moved_back = np.array(motion.rotation) @ targets.after[index] + motion.translation
        distance = float(np.linalg.norm(moved_back - targets.before[index]))
        yield _make_finding(
            "base_target_moved",
            f"{targets.where}.{target}",
            f"this base target moved relative to the other base targets by about {length_text(distance)}",
            "omit this target, or attach the target more firmly and repeat",
        )


def report_vague_parameters(
    names: Sequence[str],
    convention: Convention,
    pairs: Iterable[NearlyParallel],
    links: Sequence[LinkComparison],
) -> Iterator[Finding]:
    """Report nearly parallel axes, for which the table has huge numbers, and poorly determined parameters.

    Args:
        names: names of the joints.
        convention: convention of the Denavit-Hartenberg table.
        pairs: neighbouring axes of the table that are nearly parallel.
        links: link parameters with their uncertainties.
    """
    for pair in pairs:
        first = names.index(pair.joint) + 1
        if not pair.made_parallel and pair.angle < RUNAWAY_ANGLE:
            yield _make_finding(
                "axes_nearly_parallel",
                f"dh.{convention}",
                f"the angle between axes {first} and {first + 1} is {1e3 * pair.angle:.3g} mrad: too "
                "large to neglect, and too small to determine a, d and theta separately",
                "use the URDF, which does not need these parameters",
            )
    vague = []
    for link in links:
        spread = link.standard_uncertainty
        if spread is not None and spread > VAGUE_UNCERTAINTY:
            uncertainty = f"{1e3 * spread:.2g} mm" if link.unit == "m" else f"{np.degrees(spread):.2g}°"
            vague.append(f"{link.quantity} of joint {names.index(link.joint) + 1} (u = {uncertainty})")
    if vague:
        yield _make_finding(
            "parameters_not_identified",
            "links",
            f"the readings hardly determine {', '.join(vague)}",
            "read targets farther from the last axes, or turn these joints over more of their range; "
            "results at the same targets, over the same range, are not affected",
        )


SweepFit = Literal["one_by_one", "together"]

LEAST_SIGMA = 1e-12
"""Smallest standard uncertainty of a coordinate [m]; with less, covariances vanish."""


@dataclass(frozen=True)
class Conventions:
    """Conventions for R0 and the flange frame, which no axis determines."""

    base: Literal["nominal", "axes"]  #: see `find_base_frame`
    flange: Literal["nominal", "axes", "targets"]  #: see `FlangeConvention`
    height: float = 0.0  #: for base `axes`: height of the foot of the perpendicular above R0 [m]
    flange_targets: tuple[int, int, int] = (0, 1, 2)  #: for flange `targets`: indices of the three targets


def identify_from_sweeps(
    sweeps: SweepSet,
    conventions: Conventions,
    *,
    nominal: KinematicChain | None = None,
    name: str = "identified",
    fit: SweepFit = "together",
    angles: AngleUse = "free",
    base_targets: BaseTargets | None = None,
    others: Iterable[KnownRobot] = (),
) -> results.GeometryResult:
    """Identify the kinematics of a robot from sweeps of its joints, with uncertainties and findings.

    Args:
        sweeps: a sweep of each joint.
        conventions: how R0 and the flange frame are placed.
        nominal: model of the robot; needed where a convention refers to the nominal model.
        name: name of the identified robot.
        fit: `together` fits all sweeps at once; if the sweeps then disagree, a finding says so and the
            separate fits are used. `one_by_one` fits each sweep separately.
        angles: `free` estimates each position's angle of the turned joint from the readings; `controller`
            uses the controller's angles.
        base_targets: targets on the robot's base, read before and after the sweeps.
        others: robots that may have been measured, tried if the nominal model does not fit.

    Raises:
        InputError: the sweeps do not determine the robot, or contradict the nominal model.
    """
    mistakes: list[Finding] = []
    if nominal is not None and len(nominal.moving) == sweeps.joint_map.n:
        angles_of_sweeps = np.concatenate([sweep.angles for sweep in sweeps.sweeps])
        compared = ComparedReadings.sample(angles_of_sweeps, sweeps.whitened.points, sweeps.present)
        mistakes = list(inspect_nominal(nominal, sweeps.joint_map, compared, others))
    free_fits = identify_axes(sweeps)
    controller_fits = identify_axes(sweeps, angles="controller")
    separate = free_fits if angles == "free" else controller_fits
    controller_p_value = compute_restriction_p_value(free_fits, controller_fits)
    agreement_p_value = None  # remains None if the sweeps are not fitted together
    chosen = together = separate
    if fit == "together" and len(sweeps.sweeps) > 1:
        together = refine_axes(separate, angles=angles)
        agreement_p_value = compute_restriction_p_value(separate, together)
        chosen = separate if agreement_p_value < SWEEPS_DISAGREE_P_VALUE else together
    _refuse_vanishing_sigma(chosen)
    wrist_axes = identified = chosen
    if controller_p_value < UNEVEN_GEARS_P_VALUE:
        # Uneven gears: the uncertainties must include errors of the joint angles at rest.
        displacements, joints = propagate_resting_angle_errors(free_fits)
        identified = _widen_uncertainties(chosen, displacements)
        # The wrist centre is computed in the posture of the wrist's sweeps, in which the arm's joints rested:
        # only errors of the wrist joints' angles affect it.
        is_wrist_joint = np.array(joints, dtype=int) >= sweeps.joint_map.n - WRIST_JOINTS
        wrist_axes = _widen_uncertainties(chosen, displacements[:, is_wrist_joint])
    names = name_joints(nominal, sweeps.joint_map.n)
    evidence = [_describe_sweep(axis_fit, sweeps, names) for axis_fit in separate.fits]
    result = _assemble_result(
        identified,
        conventions,
        nominal,
        name,
        sweeps,
        wrist_axes=wrist_axes,
        findings=(*mistakes, *report_sweeps(separate, together), *report_disagreement(agreement_p_value)),
        base_targets=base_targets,
    )
    return result.model_copy(
        update={
            "sweeps": evidence,
            "fit": "one_by_one" if chosen is separate else "together",
            "controller_probability": controller_p_value,
            "agreement_probability": agreement_p_value,
        }
    )


def _describe_sweep(fit: AxisFit, sweeps: SweepSet, names: Sequence[str]) -> SweepEvidence:
    """Return the evidence from the fit of one sweep as a message; `names` are those of the model's joints."""
    radial, axial = fit.compute_residual_rms()
    deviation = np.sqrt(np.mean(fit.angle_deviation**2)) if fit.angle_deviation.any() else None
    return SweepEvidence(
        joint=fit.sweep.name,
        turned=[names[index] for index in sweeps.find_turning_joints(fit.sweep)],
        positions=len(fit.sweep),
        arc=fit.arc,
        radial_rms=dict(zip(sweeps.targets, radial, strict=True)),
        axial_rms=dict(zip(sweeps.targets, axial, strict=True)),
        angle_scale=fit.angle_scale,
        angle_deviation=deviation,
        variance_factor=fit.variance_factor,
    )


def identify_from_poses(
    poses: Poses,
    conventions: Conventions,
    *,
    nominal: KinematicChain,
    name: str = "identified",
    base_targets: BaseTargets | None = None,
    others: Iterable[KnownRobot] = (),
) -> results.GeometryResult:
    """Identify a robot's kinematics from unloaded poses, starting from a nominal model.

    Args:
        poses: joint angles and readings of targets in each pose.
        conventions: how R0 and the flange frame are placed.
        nominal: model of the robot, from which the fit starts.
        name: name of the identified robot.
        base_targets: targets on the robot's base, read before and after the poses.
        others: robots that may have been measured, tried if the nominal model does not fit.

    Raises:
        InputError: the poses contradict the nominal model, or a pose has too few targets.
        NotObservableError: the readings are fewer than the unknown parameters.
    """
    refuse_other_joint_count(nominal, poses)
    compared = ComparedReadings.sample(poses.angles, poses.points, poses.present)
    mistakes = list(inspect_nominal(nominal, poses.joint_map, compared, others))
    try:
        identified = calibrate(nominal, poses)
    except MeasurementError as error:
        if not mistakes:
            raise
        # The mistake that was found is the reason why the fit fails.
        raise MeasurementError(mistakes[0].message, where=error.where, remedy=mistakes[0].remedy) from error
    _refuse_vanishing_sigma(identified)
    return _assemble_result(
        identified,
        conventions,
        nominal,
        name,
        poses,
        wrist_axes=identified,  # the uncertainties of the axes apply to the wrist centre, too
        findings=(*mistakes, *report_calibration(identified)),
        base_targets=base_targets,
    )


def _assemble_result(
    identified: IdentifiedAxes,
    conventions: Conventions,
    nominal: KinematicChain | None,
    name: str,
    readings: SweepSet | Poses,
    *,
    wrist_axes: IdentifiedAxes,
    findings: Iterable[Finding],
    base_targets: BaseTargets | None,
) -> results.GeometryResult:
    """Compute base frame, model, tables, wrist centre and drift from the axes, and collect the findings.

    The fields that only sweeps have (`sweeps`, `fit`, p-values) are left empty for the caller to fill in.
    `wrist_axes` are the same axes with the uncertainties that apply to the wrist centre.
    """
    flange = FlangeConvention(conventions.flange_targets if conventions.flange == "targets" else None)
    if conventions.flange == "nominal" and nominal is not None:
        flange = FlangeConvention.from_chain(nominal)
    base_model = nominal if conventions.base == "nominal" else None
    base = find_base_frame(identified, base_model, height=conventions.height)
    model = identify_model(identified, base, flange, nominal=nominal, name=name)
    standard, pairs = build_dh_table(model.chain, "standard")
    modified, _ = build_dh_table(model.chain, "modified")
    links = [] if nominal is None else compare_links(identified, base, flange, nominal)
    all_findings = list(findings)
    if not any(finding.code in _NOMINAL_MISTAKES for finding in all_findings):
        all_findings += report_misfit(float(np.sqrt(identified.rss / identified.dof)), links)
    wrist, drift = None, None
    no_wrist = None  # reason why no wrist centre was computed
    if wrist_axes.undetermined.size:
        no_wrist = "the poses do not determine all axes"
    else:
        try:
            wrist = find_wrist_centre(wrist_axes, base, model)
            all_findings += report_wrist_disagreement(wrist)
        except InputError as error:
            no_wrist = error.reason
        except np.linalg.LinAlgError:
            no_wrist = "the uncertainty of the wrist centre is too large"
    if base_targets is not None:
        drift = base_targets.fit_drift(identified.sigma, identified.targets.mean(axis=0))
        all_findings += report_drift(drift, base_targets)
    all_findings += report_vague_parameters(model.chain.joint_names, "standard", pairs, links)
    root_mistakes = [finding for finding in all_findings if finding.code in _NOMINAL_MISTAKES]
    reasons = root_mistakes or [finding for finding in all_findings if not finding.is_remark]
    transform_covariance = identified.compute_covariances(base.jacobian, 6)[0]
    calibrated = identified if isinstance(identified, CalibratedAxes) else None
    is_from_residuals = readings.sigma is None or (calibrated and calibrated.exceeded_sigma is not None)
    return results.GeometryResult(
        joint_kinds={},
        assessment=combine_assessments([Assessment(verdict=each.weight, reasons=[each]) for each in reasons]),
        axes=_place_axes(base, model.chain.joint_names),
        sweeps=[],
        fit=None,
        poses=None if calibrated is None else calibrated.evidence,
        sigma=identified.sigma,
        sigma_source="residuals" if is_from_residuals else "stated",
        degrees_of_freedom=identified.dof,
        variance_factor=identified.variance_factor,
        agreement_probability=None,
        controller_probability=None,
        base=conventions.base,
        transform_tracker_to_base=to_rigid(base.transform_tracker_to_base),
        transform_covariance=transform_covariance if np.isfinite(transform_covariance).all() else None,
        wrist=wrist,
        no_wrist=no_wrist,
        targets=build_messages(
            results.FlangeTarget,
            name=identified.names,
            position=model.targets_in_flange,
            covariance=model.targets_covariance,
        ),
        flange=conventions.flange,
        links=links,
        robot=_describe_robot(name, model.chain, readings.joint_map),
        dh=[standard, modified],
        drift=drift,
        findings=all_findings,
    )


def _place_axes(base: BaseFrame, names: Sequence[str]) -> list[results.IdentifiedAxis]:
    """Return the axes in R0 as messages, with uncertainties computed in the tracker's frame.

    Args:
        base: placement of R0 by n axes.
        names: (n,) names of the joints.
    """
    identified = base.identified
    in_base = [axis.transform(base.place(identified.axes)) for axis in identified.axes]

    def compute_axis_coordinates(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
        """Return the point of each axis nearest to its identified point, and the axis's direction (6 n,)."""
        pairs = zip(axes, identified.axes, strict=True)
        return np.ravel(
            [
                [axis.nearest_point_to(identified_axis.point), axis.direction]
                for axis, identified_axis in pairs
            ]
        )

    covariances = identified.compute_covariances(
        identified.differentiate_quantity(compute_axis_coordinates)
    ).reshape(-1, 2, 3, 3)
    is_determined = np.isfinite(covariances).all(axis=(-2, -1))
    greatest = np.full(is_determined.shape, np.nan)  # greatest standard uncertainty in any direction
    greatest[is_determined] = np.sqrt(np.maximum(np.linalg.eigvalsh(covariances[is_determined])[:, -1], 0.0))
    return build_messages(
        results.IdentifiedAxis,
        name=names,
        point=[axis.point for axis in in_base],
        direction=[axis.direction for axis in in_base],
        position_uncertainty=greatest[:, 0],
        direction_uncertainty=greatest[:, 1],
    )


def _describe_robot(name: str, chain: KinematicChain, joint_map: JointMap) -> RobotDocument:
    """Return the document of a robot: the chain as URDF, and the joint map unless it is the identity."""
    model = UrdfModel(format="urdf", urdf=write_urdf(chain), base=chain.base, flange=chain.flange)
    is_identity = np.array_equal(joint_map.matrix, np.eye(joint_map.n)) and not joint_map.offset.any()
    stored = StoredJointMap(matrix=joint_map.matrix.tolist(), offset=joint_map.offset.tolist())
    return RobotDocument(name=name, model=model, joint_map=None if is_identity else stored)


def _widen_uncertainties(identified: SweptAxes, displacements: FloatArray) -> SweptAxes:
    """Return the axes with the covariance of G independent errors added.

    `displacements` (4 n + 3 T, G) of charts and targets are those due to one standard deviation of each
    error.
    """
    return replace(
        identified,
        covariance=identified.covariance + displacements @ displacements.T,
        influence=np.hstack([identified.influence, displacements / identified.sigma]),
    )


def _refuse_vanishing_sigma(identified: IdentifiedAxes) -> None:
    """Refuse readings with residuals of zero: such readings are simulated, and all covariances would be zero.

    Raises:
        MeasurementError: sigma is at most `LEAST_SIGMA`.
    """
    if not identified.sigma > LEAST_SIGMA:
        raise MeasurementError(
            f"the residuals give sigma = {length_text(identified.sigma)}, less than any tracker reaches",
            where="noise.sigma",
            remedy="state sigma if the readings are simulated without noise",
        )
