"""Identification of compliances without a load, from positions and masses (method.md §14).

    estimate = identify_weight(robot, readings)

Geometry, compliances and weights are fitted together by Gauss-Newton steps, each with a convex program. In a
step, the columns of the geometry are projected out of the linearised readings, the remaining rows are
compressed to as many rows as columns, and the convex program is solved for the compliances c and the products
η = c (π − π⁰), with π the masses and π⁰ their nominal values. Each step updates the geometry and the sag,
until the predictions no longer change.

An interval of c_j contains all values for which some geometry, and some masses within their bounds, reach a
loss of at most the least loss plus a quantile of χ². The program lets each joint have different masses, so
that the interval is an outer bound; it is exact if all masses are exact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import pinocchio as pin
from scipy import special

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError, NotObservableError
from jointstiff.solver.fit.cone import WithMasses
from jointstiff.solver.fit.conic import bound_compliances
from jointstiff.solver.fit.estimate import JointCompliance
from jointstiff.solver.fit.problem import Certificate, LeastSquares, Problem, Solution
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import solve
from jointstiff.solver.fit.stages import student_quantile
from jointstiff.solver.fit.statements import LEAST_STATED_SIGMA, Statements
from jointstiff.solver.fit.triangle import Triangle, compute_triangular_factor
from jointstiff.solver.geometry.poses import (
    PoseReadings,
    Poses,
    PoseState,
    calibrate,
    differentiate_numerically,
)
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Body, Robot
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.mechanics.terms import FORCE_SCALE, list_stated_terms
from jointstiff.solver.outcome.rules import report_no_identified_joint
from jointstiff.solver.own_weight.masses import (
    find_contradicted_mass,
    fit_freed_masses,
    report_contradicted_mass,
    report_unchecked_masses,
    widen_mass_bounds,
)
from jointstiff.solver.own_weight.rows import (
    Burden,
    ReducedProblem,
    StatedLoads,
    WeightReadings,
    WeightRows,
    compute_perpendicular_basis,
    compute_torques,
    differentiate_by_base_compliance,
    linearise_readings,
)
from jointstiff.solver.predict.models import IdentifiedWeight
from jointstiff.solver.text import figure, length_text

_NEGLIGIBLE_TORQUE: Final = 1e-3
"""Weight torque of a joint, relative to the greatest torque of all joints, below which gravity does not load
the joint."""
MOST_STEPS: Final = 15
"""Greatest number of Gauss-Newton steps."""
_BASE_LEVEL: Final = 1e-5
"""p-value of the hypothesis of a rigid base below which the base is found to tilt."""
_CONVERGED: Final = 1e-3
"""Change of the predictions in a step, relative to the residuals, at which the steps end."""
_EXACT: Final = 1e-7
"""Change of the predictions in a step, relative to the readings of the convex program, at which the steps
end: exact readings leave no residuals to compare with."""
LARGEST_SAG: Final = 0.1
"""Greatest sag of a joint [rad] that is allowed: no robot sags more. It limits the compliances."""
RANK: Final = 1e-10
"""Singular value of the geometry's columns, scaled to unit norm, below which it counts as rounding."""
_BEYOND_CHANCE: Final = 1e-3
"""p-value below which residuals contradict the stated sigma, or readings contradict the masses."""
_RIGID: Final = 1e-6
"""Compliance, relative to the upper end of its interval, below which the joint counts as rigid."""
_UNBOUNDED_SHARE: Final = 0.5
"""Upper end of an interval, relative to the greatest allowed compliance, from which on the readings do not
determine the compliance."""
_LEAST_NOISE: Final = 3e-6
"""Least noise [m] that is assumed if no sigma is stated: no instrument reads a position better."""
_RANK_TOLERANCE: Final = 1e-10
"""Singular value, relative to the greatest, below which columns count as linearly dependent."""
_LEAST_SIGMA: Final = 1e-15
"""Least sigma, in the unit of the fit, to divide by: residuals of exact readings are zero."""


@dataclass(frozen=True, eq=False)
class WeightFit:
    """Fitted geometry, compliances and weights after the last Gauss-Newton step."""

    state: PoseState  #: fitted geometry
    gravity: FloatArray  #: (3,) vector of gravity in R0 [m/s²]
    sag: FloatArray  #: (N, n) sag θ of the joints [rad]
    base: FloatArray  #: (3,) compliances C_xx, C_yy, C_xy of the base [rad/(N·m)]; zero for a rigid base
    compliance: FloatArray  #: (n,) compliances [rad/(N·m)]; zero for joints that no reading depends on
    rows: WeightRows  #: linearised readings of the last step
    reduced: ReducedProblem  #: convex problem of the last step
    optimum: Solution  #: solution of the convex problem
    steps: int  #: number of Gauss-Newton steps
    #: (N, T, 3) motion of the targets by the errors of the loads that fit best [m]; 0 for exact loads
    motion_by_loads: FloatArray | float

    @property
    def loss(self) -> float:
        """Loss of the convex problem at its optimum: what the bounds of the masses add."""
        return self.reduced.convex.squares.loss(self.optimum.x)

    def count_degrees_of_freedom(self, load_coordinates: int) -> int:
        """Return the degrees of freedom of the residuals: coordinates read minus unknowns determined.

        Args:
            load_coordinates: number of coordinates of deflections under known loads.

        Raises:
            NotObservableError: fewer coordinates than unknowns.
        """
        remaining = self.reduced.remaining_coordinates + load_coordinates  # after the fit of the geometry
        rank = self.reduced.rank
        if remaining > rank:
            return remaining - rank
        raise NotObservableError(
            f"{remaining} coordinates that remain after the fit of the geometry do not determine "
            f"{rank} compliances and weights",
            where="observations",
            remedy="read more postures, or more targets in each posture",
        )

    def estimate_noise(self, load_coordinates: int, least_square: float) -> float:
        """Return the mean square of the residuals that no compliances and weights explain.

        Args:
            load_coordinates: number of coordinates of deflections under known loads.
            least_square: lower limit of the returned value, in the fit's unit squared.
        """
        return max(
            self.reduced.residual_squares / self.count_degrees_of_freedom(load_coordinates), least_square
        )

    def compute_p_value_of_bounds(self, noise: float, load_coordinates: int) -> float:
        """Return the p-value of the hypothesis that the true masses lie within their bounds (F test).

        The loss that the bounds of the masses add is compared with the noise.

        Args:
            noise: mean square of the residuals.
            load_coordinates: number of coordinates of deflections under known loads.
        """
        rank = self.reduced.rank
        return float(
            special.fdtrc(rank, self.count_degrees_of_freedom(load_coordinates), self.loss / rank / noise)
        )


def fit_own_weight(
    robot: Robot,
    readings: WeightReadings,
    whitened: PoseReadings,
    state: PoseState,
    *,
    free_gravity: bool = False,
    free_base: bool = False,
    loaded: Measurements | None = None,
    stated: StatedLoads | None = None,
    stated_at: FloatArray | None = None,
) -> WeightFit:
    """Fit geometry, compliances and weights by Gauss-Newton steps, each with a convex program.

    Args:
        robot: nominal robot, n joints.
        readings: N observations of positions, with bodies and gravity.
        whitened: these positions with their weights, in units of 1/sigma.
        state: geometry to start from, fitted without sag.
        free_gravity: whether the direction of gravity is also estimated.
        free_base: whether the tilt of the base is also estimated.
        loaded: deflections under known loads, fitted together with the positions, and weighted with the sigma
            of the deflections; None if no deflections were read.
        stated: what is stated of the loads of positions under load; None for exact loads.
        stated_at: (n,) compliances at which columns of statements on the loads of deflections are computed
            [rad/(N·m)]; None for exact loads.

    Returns:
        The fitted geometry, gravity, sag, tilt of the base and compliances, with the last convex problem.

    Raises:
        NotObservableError: no joint's torque varies.
        MeasurementError: the steps do not converge.
        SolverError: a convex program is not certified.
    """
    burden = readings.burden
    gravity, sag = burden.gravity, np.zeros(whitened.angles.shape)
    compliance: FloatArray = np.zeros(robot.n)  # compliances
    base: FloatArray = np.zeros(3)
    weight_norm = np.linalg.norm(whitened.weight)
    for step in range(1, MOST_STEPS + 1):
        with_gravity = replace(readings, burden=replace(burden, gravity=gravity))
        rows = linearise_readings(robot, with_gravity, whitened, state, sag, compliance, stated)
        whole_triangle = triangle = rows.stack.triangle()
        if stated is not None:
            unit_uncertainties = np.ones(rows.stack.widths["statements"])
            whole_triangle = triangle.state("statements", unit_uncertainties, stated.sigma)
            triangle = whole_triangle.project_out(["statements"], RANK)
        nuisance = ["geometry", *(["base"] if free_base else []), *(["gravity"] if free_gravity else [])]
        deflection_rows = np.zeros((0, robot.n + 1))
        if loaded is not None:
            deflection_rows = _compress_deflections(robot, loaded, compliance, stated_at)
        reduced = reduce_problem(rows, triangle, nuisance, burden, deflection_rows)
        optimum = solve(reduced.convex)
        # Change of the nuisance unknowns: geometry, then three of the base, then two of gravity.
        nuisance_change = triangle.fit(nuisance, reduced.expand_solution(rows, optimum.x), RANK)
        nuisance_columns = np.concatenate([triangle.span[name] for name in nuisance])
        unknowns = reduced.expand_solution(rows, optimum.x)
        unknowns[nuisance_columns] += nuisance_change
        geometry_width = rows.stack.widths["geometry"]
        previous_sag, sag = sag, reduced.compute_sag(rows.torques, optimum.x)
        state = state.displace(nuisance_change[:geometry_width])
        if free_base:
            # Deflections are linear in the base's compliances, so the step fits the compliances themselves,
            # not their change: subtract the previous values.
            in_base = slice(geometry_width, geometry_width + 3)
            base, nuisance_change[in_base] = nuisance_change[in_base].copy(), nuisance_change[in_base] - base
        if free_gravity:
            turned_gravity = (
                gravity
                + np.linalg.norm(gravity) * compute_perpendicular_basis(gravity) @ nuisance_change[-2:]
            )
            gravity = turned_gravity * np.linalg.norm(gravity) / np.linalg.norm(turned_gravity)
        compliance[reduced.observed_joints] = reduced.unit * optimum.x[reduced.convex.cone.first]
        nuisance_effect = np.linalg.norm(triangle.matrix[:, nuisance_columns] @ nuisance_change)
        prediction_change = nuisance_effect + weight_norm * np.abs(sag - previous_sag).max()
        squares = reduced.convex.squares
        residual_norm = np.sqrt(squares.loss(optimum.x) + reduced.residual_squares)
        if prediction_change <= _CONVERGED * residual_norm + _EXACT * np.linalg.norm(squares.z):
            motion = 0.0 if stated is None else _move_by_loads(stated, whole_triangle, unknowns)
            return WeightFit(state, gravity, sag, base, compliance, rows, reduced, optimum, step, motion)
    raise MeasurementError(
        f"the fit of geometry and own weight did not converge in {MOST_STEPS} steps",
        where="observations",
        remedy="check masses, centres of mass, gravity's direction, and the unit and sign of the angles",
    )


def _move_by_loads(stated: StatedLoads, triangle: Triangle, unknowns: FloatArray) -> FloatArray:
    """Return the motion (N, T, 3) of the targets by the errors of the loads that fit best [m].

    Args:
        stated: what is stated of the loads.
        triangle: compressed rows of the positions and of the statements, whose columns come last.
        unknowns: (P,) all other unknowns.
    """
    count = len(triangle.span["statements"])
    errors = triangle.fit(["statements"], np.concatenate([unknowns, np.zeros(count)]), RANK)
    return np.asarray(stated.columns @ errors)


def _compress_deflections(
    robot: Robot, loaded: Measurements, compliance: FloatArray, stated_at: FloatArray | None
) -> FloatArray:
    """Compress the rows (n + 1, n + 1) of deflections under known loads, in units of their sigma.

    What is stated of loads and places is fitted together with the compliances.

    Args:
        robot: n joints.
        loaded: deflections under known loads.
        compliance: (n,) compliances at which the loads are in balance [rad/(N·m)].
        stated_at: (n,) compliances at which the columns of statements are computed; None for exact loads.
    """
    common, sigma = loaded.common_uncertainty, loaded.sigma or 1.0
    statements = Statements.none(robot.n)
    if stated_at is not None:
        terms = list_stated_terms(loaded)
        if any(FORCE_SCALE.prior(common)):  # next to the weight of the robot, the size of a force shows
            terms = (*terms, FORCE_SCALE)
        stated_sigma = max(sigma, LEAST_STATED_SIGMA)
        statements = Statements(terms, common, np.maximum(stated_at, 0.0), stated_sigma)
    blocks = list(statements.generate(Rows(robot, loaded, compliance), [JOINTS]))
    count = blocks[0].targets.shape[-1] - 1 - robot.n
    triangle = Triangle(joints=robot.n, statements=count)
    for of_block in blocks:
        triangle.add(of_block.flat)
    if count:
        triangle = triangle.given("statements", np.ones(count), statements.sigma)
    return triangle.R / sigma


def reduce_problem(
    rows: WeightRows, triangle: Triangle, nuisance: Sequence[str], burden: Burden, deflection_rows: FloatArray
) -> ReducedProblem:
    """Reduce linearised readings to a small convex problem whose unknowns are compliances and weights.

    The columns of the geometry are projected out, and a QR decomposition compresses the remaining rows.

    Args:
        rows: linearised readings of positions.
        triangle: triangular factor of the linearised readings.
        nuisance: names of the terms that are projected out, such as the geometry.
        burden: bodies and springs.
        deflection_rows: (k, n + 1) rows of deflections under known loads, in units of their sigma: columns of
            the compliances, then the reading.

    Raises:
        NotObservableError: no joint's torque varies.
    """
    torque, varies = rows.torques.known, rows.varies
    # A joint whose torque is constant over the postures sags like a changed geometry, which is projected out.
    observed = np.flatnonzero(varies | deflection_rows[:, :-1].any(axis=0))
    if not len(observed):
        raise NotObservableError(
            "the torque of the weight about each joint is the same in all postures",
            where="observations",
            remedy="read postures in which the arm is stretched out and folded, wrist up and down",
        )
    projected = triangle.project_out(nuisance, RANK)
    products = projected.span["products"].reshape(rows.torques.of_unknowns.shape[1:])
    # For each joint: the columns of its compliance, and of the products of its compliance with masses, in the
    # rows of positions and in the rows of deflections.
    position_parts, deflection_parts, blocks, units_of_joints, unknowns_of_joints = [], [], [], [], []
    for joint in observed.tolist():
        joint_column = projected.R[:, projected.span["joints"][joint]] * varies[joint]
        unit = 1.0 / float(np.hypot(np.linalg.norm(joint_column), np.linalg.norm(deflection_rows[:, joint])))
        block, block_unknowns = burden.build_block(
            varies[joint] & rows.torques.of_unknowns[:, joint].any(axis=0)
        )
        position_parts.append(
            unit * np.column_stack([joint_column, projected.R[:, products[joint, block_unknowns]]])
        )
        deflection_parts.append(
            np.pad(unit * deflection_rows[:, joint, None], ((0, 0), (0, len(block_unknowns))))
        )
        blocks.append(block)
        units_of_joints.append(unit)
        unknowns_of_joints.append(block_unknowns)
    unit_of_joints = np.array(units_of_joints)
    from_positions = np.column_stack([*position_parts, projected.rhs])
    from_deflections = np.column_stack([*deflection_parts, deflection_rows[:, -1]])
    R = compute_triangular_factor(np.vstack([from_positions, from_deflections]))
    column_count = R.shape[1] - 1
    A, b = R[:column_count, :column_count], R[:column_count, column_count]
    left_vectors, singular_values, _ = np.linalg.svd(A)
    null_vectors = left_vectors[:, singular_values <= _RANK_TOLERANCE * singular_values[0]]
    unexplained = null_vectors @ (null_vectors.T @ b)  # part of b outside the range of A
    torque_scale = np.where(varies, np.abs(torque).max(axis=0), rows.crosswise_torque)
    # A joint without weight torque may be pulled by a known load, so its scale must not be zero.
    torque_scale = np.maximum(torque_scale, _NEGLIGIBLE_TORQUE * torque_scale.max())[observed]
    cone = WithMasses(tuple(blocks), LARGEST_SAG / torque_scale / unit_of_joints)
    return ReducedProblem(
        convex=Problem(LeastSquares(A, b - unexplained), cone),
        residual_squares=float(unexplained @ unexplained)
        + (float(R[column_count, column_count] ** 2) if len(R) > column_count else 0.0),
        rank=column_count - null_vectors.shape[1],
        unit=unit_of_joints,
        observed_joints=observed,
        unknowns=tuple(unknowns_of_joints),
        remaining_coordinates=triangle.rows - triangle.rank(nuisance, RANK),
    )


def extract_identified_weight(
    burden: Burden, fit: WeightFit, sigma: float, uncertainty: FloatArray
) -> IdentifiedWeight | None:
    """Return the identified weights with their covariance, to predict the sag; None with balancing springs.

    Positions determine the products of compliance and weight far better than compliance or weight alone. Near
    the optimum the parameters x follow ``A x = b + ε``. The prior standard uncertainty of each parameter is
    the half-width of its bound; with D the diagonal matrix of these, ``cov x = (AᵀA/σ² + D⁻²)⁻¹``. The
    covariance is widened for joints whose standard uncertainty is greater.

    Args:
        burden: bodies that the joints carry in all observations.
        fit: fit of the robot and its weight.
        sigma: standard uncertainty of a residual, in the fit's unit.
        uncertainty: (n,) standard uncertainties of the compliances; zero where unknown.
    """
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


_BASE_UNCHECKED: Final = Finding(
    code="base_unchecked",
    weight="use_with_care",
    message="the readings do not determine how the base below the first joint tilts: the base is assumed "
    "to be rigid, so a tilt of the base counts as compliance of the joints",
    remedy="read more postures; or state `rigid_base` if nothing below the first joint yields",
)


def try_further_fit(
    fit_with_bodies: Callable[..., WeightFit],
    bodies: tuple[Body, ...],
    load_coordinates: int,
    *,
    free_base: bool,
) -> WeightFit | None:
    """Fit again with other bounds of the masses or a tilting base; return None if the fit fails.

    A fit with more unknowns than coordinates counts as failed.

    Args:
        fit_with_bodies: function that returns the fit for some bodies, with the keyword `free_base`.
        bodies: bodies with bounds of their masses.
        load_coordinates: number of coordinates of deflections under known loads.
        free_base: whether the tilt of the base is estimated.
    """
    try:
        fit = fit_with_bodies(bodies, free_base=free_base)
        fit.count_degrees_of_freedom(load_coordinates)
    except (MeasurementError, NotObservableError):
        return None
    return fit


def compute_tilt_p_value(
    rigid: WeightFit, tilting: WeightFit, burden: Burden, load_coordinates: int, least_square: float
) -> float:
    """Return the p-value of the hypothesis that the base does not tilt (F test).

    The p-value is 1 if a wrong mass explains the readings at least as well as a tilting base does, or if even
    with a tilting base the readings contradict the bounds of the masses.

    Args:
        rigid: fit without tilt.
        tilting: fit with the tilt of the base.
        burden: bodies and springs.
        load_coordinates: number of coordinates of deflections under known loads.
        least_square: lower limit of the mean square of the residuals, in the fit's unit squared.
    """
    noise = tilting.estimate_noise(load_coordinates, least_square)
    gain = (
        rigid.loss + rigid.reduced.residual_squares - tilting.loss - tilting.reduced.residual_squares
    ) / noise
    wrong_mass = find_contradicted_mass(
        fit_freed_masses(rigid.reduced, burden, rigid.estimate_noise(load_coordinates, least_square))
    )
    tilt_is_better = gain > (0.0 if wrong_mass is None else wrong_mass.gain)
    if not tilt_is_better or tilting.compute_p_value_of_bounds(noise, load_coordinates) <= _BEYOND_CHANCE:
        return 1.0
    return float(special.fdtrc(3, tilting.count_degrees_of_freedom(load_coordinates), gain / 3.0))


def fit_with_proved_corrections(
    fit_with_bodies: Callable[..., WeightFit],
    burden: Burden,
    load_coordinates: int,
    least_square: float,
    *,
    free_base: bool,
) -> tuple[WeightFit, tuple[Body, ...], list[Finding]]:
    """Fit geometry, compliances and weights; repeat the fit with a tilting base or wider bounds of a mass.

    A tilting base, or wider bounds of a mass, are used only if the readings prove the need. If a further fit
    fails, the previous fit is returned.

    Args:
        fit_with_bodies: function that returns the fit for some bodies, with the keyword `free_base`.
        burden: bodies and springs as stated.
        load_coordinates: number of coordinates of deflections under known loads.
        least_square: lower limit of the mean square of the residuals, in the fit's unit squared.
        free_base: whether the tilt of the base is estimated even if the readings do not prove a tilt.

    Returns:
        The fit, the bodies with the bounds used in it, and the findings.

    Raises:
        NotObservableError: even with a rigid base, there are fewer coordinates than unknowns.
        MeasurementError: the fit with a rigid base does not converge.
    """
    findings, bodies = list[Finding](), burden.bodies
    rigid = fit_with_bodies(bodies)
    tilting = try_further_fit(fit_with_bodies, bodies, load_coordinates, free_base=True)
    p_value = (
        1.0
        if tilting is None
        else compute_tilt_p_value(rigid, tilting, burden, load_coordinates, least_square)
    )
    base_tilts = p_value < _BASE_LEVEL
    if tilting is None and free_base:
        findings.append(_BASE_UNCHECKED)
    free_base = tilting is not None and (free_base or base_tilts)
    fit = tilting if tilting is not None and free_base else rigid
    if base_tilts:
        tilts = " and ".join(f"{1e9 * each:.2g}" for each in fit.base[:2])
        findings.append(
            Finding(
                code="base_bends",
                weight="use_with_care",
                message=f"the base below the first joint tilts under the weight (F test, p = {p_value:.1g}), "
                f"by {tilts} nrad/(N·m) about x and y; the joints' stiffnesses do not include this tilt",
                remedy="tighten and stiffen the base; a target on the base plate shows directly how the "
                "base tilts",
            )
        )
    freed = fit_freed_masses(fit.reduced, burden, fit.estimate_noise(load_coordinates, least_square))
    wrong_mass = find_contradicted_mass(freed)
    if wrong_mass is not None:
        wrong_body, widened = bodies[wrong_mass.body], widen_mass_bounds(bodies, wrong_mass)
        second = try_further_fit(fit_with_bodies, widened, load_coordinates, free_base=free_base)
        if second is None:
            findings.append(report_contradicted_mass(wrong_body, wrong_mass, covered=False))
        # The wider bounds are used only if the readings no longer contradict them; otherwise this mass alone
        # is not the cause.
        elif (
            second.compute_p_value_of_bounds(
                second.estimate_noise(load_coordinates, least_square), load_coordinates
            )
            > _BEYOND_CHANCE
        ):
            findings.append(report_contradicted_mass(wrong_body, wrong_mass))
            return second, widened, findings
    elif (remark := report_unchecked_masses(bodies, freed)) is not None:
        findings.append(remark)
    return fit, bodies, findings


def find_reasons_against(
    fit: WeightFit, rank: int, degrees_of_freedom: int, *, stated_sigma: float | None
) -> Iterator[Finding]:
    """Yield findings that reduce the trust in a result: too large residuals, and contradicted masses.

    If the model is right, two sums of squares follow χ²: that of the residuals that no solution explains, and
    the loss that the bounds of the masses add.

    Args:
        fit: fit of the robot and its weight.
        rank: number of compliances and weights that the readings determine.
        degrees_of_freedom: degrees of freedom of the residuals.
        stated_sigma: stated standard uncertainty of a coordinate [m]; None if sigma comes from the residuals.
    """
    residual_squares, loss = fit.reduced.residual_squares, fit.loss
    mean_square = residual_squares / degrees_of_freedom
    p_value = special.fdtrc(rank, degrees_of_freedom, loss / rank / mean_square)
    if stated_sigma is not None and special.chdtrc(degrees_of_freedom, residual_squares) < _BEYOND_CHANCE:
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
    if p_value < _BEYOND_CHANCE:
        yield Finding(
            code="masses_contradicted",
            weight="do_not_use",
            message="no masses and centres of mass within their bounds explain the readings "
            f"(p = {p_value:.1g})",
            remedy="check masses, centres of mass, their frames, and what hung on the flange; or widen the "
            "bounds",
        )


def _make_results_without_weight(robot: Robot, fit: WeightFit) -> list[JointCompliance]:
    """Return for each joint the result of a joint whose compliance its weight torque does not show."""
    weight_torques = fit.rows.torques.known
    negligible = _NEGLIGIBLE_TORQUE * np.abs(weight_torques).max()
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
    robot: Robot, fit: WeightFit, sigma: float, rise: float
) -> tuple[tuple[JointCompliance, ...], FloatArray]:
    """Compute the compliance of each joint with its interval, or the reason why the compliance is unknown.

    Args:
        robot: n joints.
        fit: fit of the robot and its weight.
        sigma: standard uncertainty of a residual, in the fit's unit.
        rise: increase of the loss above its minimum at the ends of the intervals.

    Returns:
        The results of the joints; and (n,) the width that each interval would have if the masses were exact,
        divided by the width of the interval, NaN without an interval.
    """
    problem = fit.reduced
    intervals = bound_compliances(problem.convex, fit.optimum.x, rise)
    # (m,) half-widths that the intervals would have if the masses were exact
    exact_half_widths = np.sqrt(rise) * np.linalg.norm(
        np.linalg.pinv(problem.convex.squares.R[:, problem.convex.cone.first]), axis=1
    )
    width_ratios = np.full(robot.n, np.nan)
    joints = _make_results_without_weight(robot, fit)  # those of observed joints are replaced below
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


def _count_load_coordinates(loaded: Measurements, poses: Poses) -> int:
    """Return the number of coordinates and encoder readings of deflections under known loads.

    Raises:
        MeasurementError: not all sigmas of positions and deflections are stated, so they cannot be combined.
    """
    if poses.sigma is None or loaded.sigma is None:
        raise MeasurementError(
            "positions and deflections are combined, but not all of their uncertainties are stated",
            where="noise",
            remedy="state `noise.sigma` for the positions and for the deflections",
        )
    encoder_readings = 0 if loaded.encoders is None else int(loaded.encoders.present.sum())
    return int(loaded.coordinates.sum()) + encoder_readings


@dataclass(frozen=True, eq=False)
class _WeightFitter:
    """Fit of the same readings for bodies whose mass bounds may differ from the stated bounds."""

    robot: Robot
    readings: WeightReadings  #: N observations of positions, with bodies as stated
    whitened: PoseReadings  #: these positions, in units of sigma, or of 1 m if no sigma is stated
    start: PoseState  #: geometry of the best arm without sag
    loaded: Measurements | None  #: deflections under known loads
    stated: StatedLoads | None  #: what is stated of the loads; None for exact loads
    #: (n,) compliances at which the columns of statements are computed [rad/(N·m)]; None for exact loads
    stated_at: FloatArray | None
    free_gravity: bool  #: whether the direction of gravity is estimated

    def fit(self, bodies: tuple[Body, ...], *, free_base: bool = False) -> WeightFit:
        """Fit geometry, compliances and weights for these bodies, with or without a tilt of the base."""
        burden = replace(self.readings.burden, bodies=bodies)
        return fit_own_weight(
            self.robot,
            replace(self.readings, burden=burden),
            self.whitened,
            self.start,
            free_gravity=self.free_gravity,
            free_base=free_base,
            loaded=self.loaded,
            stated=None if self.stated_at is None else self.stated,
            stated_at=self.stated_at,
        )

    def with_uncertain_loads(self, load_coordinates: int, least_square: float) -> _WeightFitter:
        """Return the fitter that accounts for what is stated of the loads.

        A fit with exact loads gives the compliances at which the columns of statements are computed, and
        sigma if none is stated.

        Args:
            load_coordinates: number of coordinates of deflections under known loads.
            least_square: lower limit of the mean square of the residuals, in the fit's unit squared.
        """
        exact = self.fit(self.readings.burden.bodies)
        if self.stated is None:
            return replace(self, stated_at=exact.compliance)
        noise = 1.0
        if self.readings.poses.sigma is None:
            noise = exact.estimate_noise(load_coordinates, least_square)
        stated = replace(self.stated, compliance=exact.compliance, sigma=float(np.sqrt(noise)))
        return replace(self, stated=stated, stated_at=exact.compliance)


@dataclass(frozen=True)
class _FitNoise:
    """Noise of a residual, in the unit of the fit."""

    sigma: float  #: rms of the residuals, or 1 if the stated sigma is used
    is_of_residuals: bool  #: whether sigma comes from the residuals
    degrees_of_freedom: int  #: degrees of freedom of the residuals

    @classmethod
    def choose(cls, fit: WeightFit, degrees_of_freedom: int, *, from_residuals: bool) -> _FitNoise:
        """Take the rms residual of the fit as sigma, or the stated sigma."""
        sigma = 1.0
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


def _find_largest_stiffness_ratio(
    robot: Robot, readings: WeightReadings, fit: WeightFit, sagging: PoseReadings
) -> float:
    """Return the largest |∂τ_i/∂θ_j| c_i: relative effect of the sag θ on the torques τ.

    Args:
        robot: n joints.
        readings: N observations, with the bodies that the fit used.
        fit: geometry and compliances c.
        sagging: readings whose angles include the sag of the joints.
    """

    def compute_sag_at(turn: FloatArray) -> FloatArray:
        """Return the sag (N, n) [rad], torque times compliance, after a turn (n,) [rad] of the joints."""
        motion = fit.state.motion(replace(sagging, angles=sagging.angles + turn))
        return fit.compliance * compute_torques(robot, readings, motion).known

    return float(np.abs(differentiate_numerically(compute_sag_at, robot.n)).max())


@dataclass(frozen=True, eq=False)
class _FittedWeight:
    """Last fit of the readings, from which the estimate with its intervals is computed."""

    robot: Robot
    readings: WeightReadings  #: N observations, with the bounds of masses that the fit used
    fit: WeightFit
    findings: tuple[Finding, ...]  #: findings and remarks on masses and on the base
    rms_without_sag: float  #: rms residual of a whitened coordinate for the best rigid arm [m]
    degrees_of_freedom: int  #: degrees of freedom of the residuals

    def describe(self, confidence: float) -> WeightEstimate:
        """Compute intervals, predictions and findings at a confidence level."""
        poses, fit, problem = self.readings.poses, self.fit, self.fit.reduced
        unit_of_fit = poses.sigma or 1.0  # [m]
        reasons = self._list_reasons()
        noise = self._choose_noise(reasons)
        rise = noise.compute_half_width(confidence) ** 2
        joints, width_ratios = compute_joint_results(self.robot, fit, noise.sigma, rise)
        missing = report_no_identified_joint(
            [joint.status for joint in joints],
            "read more postures, state better masses, or use a known payload",
        )
        uncertainty = np.array([joint.standard_uncertainty or 0.0 for joint in joints])
        whitened = poses.whitened
        sagging = replace(whitened, angles=whitened.angles + fit.sag)
        predicted = _predict_points(fit, sagging)
        squares = problem.residual_squares + fit.loss
        return WeightEstimate(
            joints=joints,
            shares=width_ratios,
            fit=fit,
            reasons=(*reasons, *missing),
            remarks=tuple(each for each in self.findings if each.is_remark),
            sigma=noise.sigma * unit_of_fit,
            sigma_of_residuals=noise.is_of_residuals,
            chi_square=float(self.degrees_of_freedom) if poses.sigma is None else problem.residual_squares,
            degrees_of_freedom=self.degrees_of_freedom,
            rms_residual=unit_of_fit * float(np.sqrt(squares / (self.degrees_of_freedom + problem.rank))),
            rms_without_sag=self.rms_without_sag,
            confidence=confidence,
            displacement=predicted - fit.state.motion(whitened).points,
            residual=np.where(poses.present[..., None], whitened.points - predicted, 0.0),
            certificate=fit.optimum.certificate,
            weight=extract_identified_weight(self.readings.burden, fit, noise.sigma, uncertainty),
            largest_stiffness_ratio=_find_largest_stiffness_ratio(self.robot, self.readings, fit, sagging),
        )

    def _list_reasons(self) -> tuple[Finding, ...]:
        """List the findings that reduce the trust in the result."""
        of_residuals = find_reasons_against(
            self.fit,
            self.fit.reduced.rank,
            self.degrees_of_freedom,
            stated_sigma=self.readings.poses.sigma,
        )
        return (*(each for each in self.findings if not each.is_remark), *of_residuals)

    def _choose_noise(self, reasons: Sequence[Finding]) -> _FitNoise:
        """Take sigma from the residuals if none is stated, or if the residuals exceed the stated sigma."""
        exceeds_stated = any(reason.code == "residuals_exceed_sigma" for reason in reasons)
        from_residuals = self.readings.poses.sigma is None or exceeds_stated
        return _FitNoise.choose(self.fit, self.degrees_of_freedom, from_residuals=from_residuals)


def identify_weight(
    robot: Robot,
    readings: WeightReadings,
    *,
    confidence: float = 0.95,
    free_gravity: bool = False,
    free_base: bool = False,
    loaded: Measurements | None = None,
    stated: StatedLoads | None = None,
) -> WeightEstimate:
    """Identify joint compliances from the sag of an arm under its own weight.

    Args:
        robot: nominal robot with n joints; the axes and the positions of the targets are estimated, too.
        readings: N observations of positions, with bodies and gravity.
        confidence: confidence level of the intervals.
        free_gravity: True to estimate the direction of gravity; False to use the stated direction.
        free_base: True to estimate the tilt of the base in any case; False only if the readings prove a tilt.
        loaded: deflections under known loads (loaded − unloaded), fitted together with the positions.
        stated: what is stated of the loads of positions under load; None for exact loads.

    Returns:
        The compliances with intervals, the fit, and the findings.

    Raises:
        MeasurementError: the fit does not converge, or positions and deflections are combined but not all of
            their sigmas are stated.
        NotObservableError: fewer coordinates than unknowns, or no weight torque varies.
        SolverError: a convex program is not certified.
    """
    poses = readings.poses
    load_coordinates = 0 if loaded is None else _count_load_coordinates(loaded, poses)
    rigid = calibrate(robot.chain, poses, start=pin.SE3.Identity(), hold_out=False)
    whitened, unit_of_fit = poses.whitened, poses.sigma or 1.0
    start = PoseState(rigid.axes, rigid.targets, np.zeros(len(poses)))
    in_unit_of_fit = replace(whitened, weight=whitened.weight / unit_of_fit)
    fitter = _WeightFitter(robot, readings, in_unit_of_fit, start, loaded, stated, None, free_gravity)
    least_square = 1.0 if poses.sigma is not None else _LEAST_NOISE**2
    if stated is not None or loaded is not None:
        fitter = fitter.with_uncertain_loads(load_coordinates, least_square)
    fit, bodies, findings = fit_with_proved_corrections(
        fitter.fit, readings.burden, load_coordinates, least_square, free_base=free_base
    )
    fitted = _FittedWeight(
        robot,
        replace(readings, burden=replace(readings.burden, bodies=bodies)),
        fit,
        tuple(findings),
        rms_without_sag=float(np.sqrt(rigid.rss / rigid.dof)),
        degrees_of_freedom=fit.count_degrees_of_freedom(load_coordinates),
    )
    return fitted.describe(confidence)
