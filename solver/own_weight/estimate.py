"""Estimate by own weight: a fit of compliances, masses and geometry, with its intervals (method.md §14).

    estimate = identify_weight(readings)

An interval of c_j contains all values for which some geometry, and some masses within their bounds, reach a
loss of at most the least loss plus a quantile of χ². The program lets each joint have different masses, so
that the interval is an outer bound; it is exact if all masses are exact.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import special

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.conic import bound_compliances
from jointstiff.solver.fit.estimate import JointCompliance
from jointstiff.solver.fit.fit import fit
from jointstiff.solver.fit.problem import Certificate
from jointstiff.solver.fit.stages import student_quantile
from jointstiff.solver.fit.triangle import compute_triangular_factor
from jointstiff.solver.fit.weight import BEYOND_CHANCE, NEGLIGIBLE_TORQUE, Weighed, WeightFit
from jointstiff.solver.fit.weight_rows import (
    WeightReadings,
    compute_torques,
    differentiate_by_base_compliance,
)
from jointstiff.solver.geometry.poses import PoseReadings, differentiate_numerically
from jointstiff.solver.models import OWN_WEIGHT
from jointstiff.solver.outcome.rules import report_no_identified_joint
from jointstiff.solver.predict.models import IdentifiedWeight
from jointstiff.solver.text import figure, length_text

_RIGID: Final = 1e-6
"""Compliance, relative to the upper end of its interval, below which the joint counts as rigid."""
_UNBOUNDED_SHARE: Final = 0.5
"""Upper end of an interval, relative to the greatest allowed compliance, from which on the readings do not
determine the compliance."""
_LEAST_SIGMA: Final = 1e-15
"""Least sigma, in the unit of the fit, to divide by: residuals of exact readings are zero."""


def extract_identified_weight(
    fit: WeightFit, sigma: float, uncertainty: FloatArray
) -> IdentifiedWeight | None:
    """Return the identified weights with their covariance, to predict the sag; None with balancing springs.

    Positions determine the products of compliance and weight far better than compliance or weight alone. Near
    the optimum the parameters x follow ``A x = b + ε``. The prior standard uncertainty of each parameter is
    the half-width of its bound; with D the diagonal matrix of these, ``cov x = (AᵀA/σ² + D⁻²)⁻¹``. The
    covariance is widened for joints whose standard uncertainty is greater.

    Args:
        fit: fit of the robot and its weight; the joints carry the bodies in all observations.
        sigma: standard uncertainty of a residual, in the fit's unit.
        uncertainty: (n,) standard uncertainties of the compliances; zero where unknown.
    """
    burden = fit.readings.burden
    if burden.balancers:
        return None
    problem, parameters, joint_count = fit.reduced, fit.optimum.x, len(fit.compliance)
    # A compliance is bounded by its cap. A product is bounded by the compliance, because each unknown is in
    # units of its bound; a compliance near zero is replaced by a thousandth of the greatest parameter.
    half_widths = np.full(len(parameters), 1e-3 * float(np.abs(parameters).max()))
    for (_, _, span, _), cap in zip(problem.blocks, problem.convex.cone.cap.tolist(), strict=True):
        half_widths[span] = np.maximum(half_widths[span.start], parameters[span.start])
        half_widths[span.start] = cap
    stacked = np.vstack([problem.convex.squares.R / max(sigma, _LEAST_SIGMA), np.diag(1.0 / half_widths)])
    covariance_root_of_parameters = np.linalg.inv(compute_triangular_factor(stacked))  # cov x = root rootᵀ
    # Mass and first moments (4) of the bodies that each joint carries: nominal, and the deviation from
    # nominal of each unknown at its bound.
    unknown_inertias, _ = burden.unknown
    nominal, inertia_at_bound = np.zeros((joint_count, 4)), np.zeros((joint_count, 4, len(unknown_inertias)))
    for body in burden.bodies:
        nominal[body.joint] += 0.5 * (body.most + body.least) * np.array([1.0, *body.centre])
    for unknown, (body_index, inertia) in enumerate(unknown_inertias):
        inertia_at_bound[burden.bodies[body_index].joint, :, unknown] = inertia
    inertias, product_roots = (
        np.tile(nominal, (joint_count, 1, 1)),
        np.zeros((joint_count, 4 * joint_count, len(parameters))),
    )
    compliance_roots = np.zeros((joint_count, len(parameters)))
    for joint, unit, span, unknown_indices in problem.blocks:
        # Matrix from the parameters of joint j to compliance times inertia of all bodies.
        products = unit * np.column_stack(
            [nominal.ravel(), inertia_at_bound.reshape(4 * joint_count, -1)[:, unknown_indices]]
        )
        compliance_uncertainty = unit * float(np.linalg.norm(covariance_root_of_parameters[span.start]))
        covariance_root_of_parameters[span] *= max(1.0, uncertainty[joint] / compliance_uncertainty)
        product_roots[joint], compliance_roots[joint] = (
            products @ covariance_root_of_parameters[span],
            unit * covariance_root_of_parameters[span.start],
        )
        if parameters[span.start] > 0.0:
            inertias[joint] = (products @ parameters[span] / (unit * parameters[span.start])).reshape(
                joint_count, 4
            )
    mass: FloatArray = inertias[..., 0]
    centre = inertias[..., 1:] / np.where(mass > 0.0, mass, 1.0)[..., None]
    covariance_root = np.vstack([compliance_roots, product_roots.reshape(4 * joint_count * joint_count, -1)])
    return IdentifiedWeight(mass, centre, fit.gravity, root=covariance_root)


def find_reasons_against(fit: WeightFit) -> Iterator[Finding]:
    """Yield findings that reduce the trust in a result: too large residuals, and contradicted masses.

    If the model is right, two sums of squares follow χ²: that of the residuals that no solution explains, and
    the loss that the bounds of the masses add.

    """
    stated_sigma = fit.readings.poses.sigma
    degrees_of_freedom, rank = fit.count_degrees_of_freedom(), fit.reduced.rank
    residual_squares, loss = fit.reduced.residual_squares, fit.loss
    mean_square = residual_squares / degrees_of_freedom
    p_value = special.fdtrc(rank, degrees_of_freedom, loss / rank / mean_square)
    if stated_sigma is not None and special.chdtrc(degrees_of_freedom, residual_squares) < BEYOND_CHANCE:
        factor = float(np.sqrt(mean_square))
        yield Finding(
            code="residuals_exceed_sigma",
            weight="use_with_care",
            message=f"the residuals give sigma = {length_text(factor * stated_sigma)}, but "
            f"{length_text(stated_sigma)} was stated: something bends or moves that neither geometry nor own "
            "weight explains",
            remedy="look for play in gears, links that bend, or a target or base that moved; the intervals "
            "use the larger sigma",
        )
    elif stated_sigma is not None:
        p_value = special.chdtrc(rank, loss)
    if p_value < BEYOND_CHANCE:
        yield Finding(
            code="masses_contradicted",
            weight="do_not_use",
            message="no masses and centres of mass within their bounds explain the readings "
            f"(p = {p_value:.1g})",
            remedy="check masses, centres of mass, their frames, and what hung on the flange; or widen the "
            "bounds",
        )


def _make_results_without_weight(fit: WeightFit) -> list[JointCompliance]:
    """Return for each joint the result of a joint whose compliance its weight torque does not show."""
    robot, weight_torques = fit.readings.robot, fit.rows.torques.known
    negligible = NEGLIGIBLE_TORQUE * np.abs(weight_torques).max()
    joints = []
    for name, kind, torque in zip(robot.joint_names, robot.joint_kinds, weight_torques.T, strict=True):
        reason = (
            "the torque of the weight about this joint hardly varies over the postures "
            f"({torque.min():.3g} to {torque.max():.3g} N·m): hang a known payload away from the joint's "
            "axis, or apply a known force that twists the joint"
        )
        if np.abs(torque).max() <= negligible:
            reason = (
                "gravity does not load the joint in any of the postures: apply a known force that "
                "twists the joint"
            )
        joints.append(JointCompliance(name, kind, "not_observable", reason=reason))
    return joints


def compute_joint_results(
    fit: WeightFit, sigma: float, rise: float
) -> tuple[tuple[JointCompliance, ...], FloatArray]:
    """Compute the compliance of each joint with its interval, or the reason why the compliance is unknown.

    Args:
        fit: fit of the robot and its weight.
        sigma: standard uncertainty of a residual, in the fit's unit.
        rise: increase of the loss above its minimum at the ends of the intervals.

    Returns:
        The results of the joints; and (n,) the width that each interval would have if the masses were exact,
        divided by the width of the interval, NaN without an interval.
    """
    robot, problem = fit.readings.robot, fit.reduced
    intervals = bound_compliances(problem.convex, fit.optimum.x, rise)
    # (m,) half-widths that the intervals would have if the masses were exact
    exact_half_widths = np.sqrt(rise) * np.linalg.norm(
        np.linalg.pinv(problem.convex.squares.R[:, problem.convex.cone.first]), axis=1
    )
    width_ratios = np.full(robot.n, np.nan)
    joints = _make_results_without_weight(fit)  # those of observed joints are replaced below
    for position, joint in enumerate(problem.observed_joints.tolist()):
        name, unit, (lower, upper) = robot.joint_names[joint], problem.unit[position], intervals[position]
        kind = robot.joint_kinds[joint]
        is_bounded = (
            upper < _UNBOUNDED_SHARE * problem.convex.cone.cap[position]
        )  # False for NaN: no end was found
        if not is_bounded:
            reason = (
                f"own weight and readings do not determine the compliance of {name}: read more postures in "
                "which its weight torque differs (a plan for own weight lists such postures), or attach a "
                "payload"
            )
            joints[joint] = JointCompliance(name, kind, "not_observable", reason=reason)
            continue
        compliance = float(fit.compliance[joint]) if fit.compliance[joint] > _RIGID * upper * unit else 0.0
        width_ratios[joint] = min(1.0, 2.0 * float(exact_half_widths[position]) / (upper - lower))
        explanation = "the estimate and the lower end of the interval are those of a rigid joint"
        if compliance > 0.0:
            explanation = (
                "the interval reaches from rigid to "
                f"{figure(upper * unit / compliance, '.2g')} times the estimate"
            )
        joints[joint] = JointCompliance(
            name,
            kind,
            "at_bound" if compliance == 0.0 else "identified" if lower > 0.0 else "uncertain",
            compliance,
            float(0.5 * (upper - lower) * unit * sigma / np.sqrt(rise)),
            (float(lower * unit), float(upper * unit)),
            reason=None if lower > 0.0 else f"{explanation}: add postures, better masses or a known payload",
        )
    return tuple(joints), width_ratios


@dataclass(frozen=True, eq=False)
class WeightEstimate:
    """Compliances from own weight, with findings, residuals, uncertainties and certificate."""

    joints: tuple[JointCompliance, ...]  #: compliance of each joint with its interval
    #: (n,) width that a joint's interval would have if the masses were exact, divided by the interval's
    #: width; NaN without an interval
    shares: FloatArray
    fit: WeightFit  #: geometry, sag, and the last convex problem
    reasons: tuple[Finding, ...]  #: findings that reduce the trust in the result
    remarks: tuple[Finding, ...]  #: findings that do not reduce the trust: what the readings do not check
    sigma: float  #: standard uncertainty of a coordinate [m], as stated or from the residuals
    #: True if sigma comes from the residuals: no sigma is stated, or the residuals are larger than stated
    sigma_of_residuals: bool
    chi_square: float  #: χ² of all residuals for the stated sigma; the degrees of freedom if none is stated
    degrees_of_freedom: int  #: number of coordinates read minus number of unknowns that they determine
    rms_residual: float  #: rms residual of a whitened coordinate [m]
    rms_without_sag: float  #: rms residual of a whitened coordinate for the best rigid arm [m]
    confidence: float  #: confidence level of the intervals
    #: (N, T, 3) displacement of the targets by the sag, relative to the fitted geometry without sag [m]
    displacement: FloatArray
    residual: FloatArray  #: (N, T, 3) measured minus predicted position [m]; zero where nothing was read
    certificate: Certificate  #: certificate of the last convex program
    #: weights of the bodies as identified, to predict the sag; None with balancers
    weight: IdentifiedWeight | None
    #: largest |∂τ_i/∂θ_j| c_i: relative effect of the sag on the torques, which the fit takes into account
    largest_stiffness_ratio: float


@dataclass(frozen=True)
class _FitNoise:
    """Noise of a residual, in the unit of the fit."""

    sigma: float  #: rms of the residuals, or 1 if the stated sigma is used
    is_of_residuals: bool  #: whether sigma comes from the residuals
    degrees_of_freedom: int  #: degrees of freedom of the residuals

    @classmethod
    def choose(cls, fit: WeightFit, *, from_residuals: bool) -> _FitNoise:
        """Use the rms residual of the fit as sigma, or the stated sigma."""
        sigma, degrees_of_freedom = 1.0, fit.count_degrees_of_freedom()
        if from_residuals:
            sigma = float(np.sqrt(fit.reduced.residual_squares / degrees_of_freedom))
        return cls(sigma, from_residuals, degrees_of_freedom)

    def compute_half_width(self, confidence: float) -> float:
        """Return the half-width of an interval whose standard uncertainty is 1."""
        degrees_of_freedom = self.degrees_of_freedom if self.is_of_residuals else None
        return self.sigma * student_quantile(0.5 + 0.5 * confidence, degrees_of_freedom)


def _predict_points(fit: WeightFit, sagging: PoseReadings) -> FloatArray:
    """Return the predicted positions (N, T, 3) of the targets under the weight and the loads [m].

    Args:
        fit: geometry, compliances of the base, and motion by the loads.
        sagging: readings whose angles include the sag of the joints.
    """
    by_joints = fit.state.motion(sagging).points
    by_base = differentiate_by_base_compliance(fit.rows.torques, by_joints) @ fit.base
    return np.asarray(by_joints + by_base + fit.motion_by_loads)


def _find_largest_stiffness_ratio(fit: WeightFit, sagging: PoseReadings) -> float:
    """Return the largest |∂τ_i/∂θ_j| c_i: relative effect of the sag θ on the torques τ.

    Args:
        fit: geometry and compliances c of n joints.
        sagging: readings whose angles include the sag of the joints.
    """

    def compute_sag_at(turn: FloatArray) -> FloatArray:
        """Return the sag (N, n) [rad], torque times compliance, after a turn (n,) [rad] of the joints."""
        motion = fit.state.motion(replace(sagging, angles=sagging.angles + turn))
        return fit.compliance * compute_torques(fit.readings, motion).known

    return float(np.abs(differentiate_numerically(compute_sag_at, len(fit.compliance))).max())


def _list_reasons(fit: WeightFit) -> tuple[Finding, ...]:
    """List the findings that reduce the trust in the result."""
    from_fit = [finding for finding in fit.findings if not finding.is_remark]
    return (*from_fit, *find_reasons_against(fit))


def _choose_noise(fit: WeightFit, reasons: Sequence[Finding]) -> _FitNoise:
    """Choose the sigma of the residuals if none is stated, or if the residuals exceed the stated sigma."""
    exceeds_stated = any(reason.code == "residuals_exceed_sigma" for reason in reasons)
    from_residuals = not fit.scale.given or exceeds_stated
    return _FitNoise.choose(fit, from_residuals=from_residuals)


def describe(fit: WeightFit, confidence: float) -> WeightEstimate:
    """Compute intervals, predictions and findings of a fit at a confidence level."""
    readings, problem, scale = fit.readings, fit.reduced, fit.scale
    reasons = _list_reasons(fit)
    noise = _choose_noise(fit, reasons)
    rise = noise.compute_half_width(confidence) ** 2
    joints, width_ratios = compute_joint_results(fit, noise.sigma, rise)
    missing = report_no_identified_joint(
        [joint.status for joint in joints],
        "read more postures, state better masses, or use a known payload",
    )
    uncertainty = np.array([joint.standard_uncertainty or 0.0 for joint in joints])
    whitened = readings.whitened
    sagging = replace(whitened, angles=whitened.angles + fit.sag)
    predicted = _predict_points(fit, sagging)
    mean_square = (problem.residual_squares + fit.loss) / (noise.degrees_of_freedom + problem.rank)
    return WeightEstimate(
        joints=joints,
        shares=width_ratios,
        fit=fit,
        reasons=(*reasons, *missing),
        remarks=tuple(each for each in fit.findings if each.is_remark),
        sigma=noise.sigma * readings.unit,
        sigma_of_residuals=noise.is_of_residuals,
        chi_square=scale.chi_square,
        degrees_of_freedom=noise.degrees_of_freedom,
        rms_residual=readings.unit * float(np.sqrt(mean_square)),
        rms_without_sag=fit.rms_without_sag,
        confidence=confidence,
        displacement=predicted - fit.state.motion(whitened).points,
        residual=np.where(readings.poses.present[..., None], whitened.points - predicted, 0.0),
        certificate=fit.optimum.certificate,
        weight=extract_identified_weight(fit, noise.sigma, uncertainty),
        largest_stiffness_ratio=_find_largest_stiffness_ratio(fit, sagging),
    )


def identify_weight(
    readings: WeightReadings,
    *,
    confidence: float = 0.95,
    free_gravity: bool = False,
    free_base: bool = False,
) -> WeightEstimate:
    """Identify joint compliances from the sag of an arm under its own weight.

    Args:
        readings: N observations of positions, with the robot, its bodies and gravity.
        confidence: confidence level of the intervals.
        free_gravity: True to estimate the direction of gravity; False to use the stated direction.
        free_base: True to estimate the tilt of the base in any case; False only if the readings prove a tilt.

    Returns:
        The compliances with intervals, the fit, and the findings.

    Raises:
        MeasurementError: the fit does not converge, or positions and deflections are combined but not all of
            their sigmas are stated.
        NotObservableError: fewer coordinates than unknowns, or no weight torque varies.
        SolverError: a convex program is not certified.
    """
    options = Weighed(free_gravity=free_gravity, free_base=free_base)
    return describe(fit(readings, OWN_WEIGHT, options), confidence)
