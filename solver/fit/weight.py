"""Fit of compliances, masses and geometry by own weight (method.md §14).

Geometry, compliances and weights are fitted together by Gauss-Newton steps, each with a convex program. In a
step, the columns of the geometry are projected out of the linearised readings, the remaining rows are
compressed to as many rows as columns, and the convex program is solved for the compliances c and the products
η = c (π − π⁰), with π the masses and π⁰ their nominal values. Each step updates the geometry and the sag,
until the predictions no longer change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import special

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError, NotObservableError
from jointstiff.solver.fit.cone import WithMasses
from jointstiff.solver.fit.masses import (
    find_contradicted_mass,
    fit_freed_masses,
    report_contradicted_mass,
    report_unchecked_masses,
    widen_mass_bounds,
)
from jointstiff.solver.fit.problem import LeastSquares, Problem, Solution
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import solve
from jointstiff.solver.fit.statements import LEAST_STATED_SIGMA, Statements
from jointstiff.solver.fit.triangle import Triangle, compute_triangular_factor
from jointstiff.solver.fit.weight_rows import (
    Burden,
    ReducedProblem,
    StatedLoads,
    WeightReadings,
    WeightRows,
    compute_perpendicular_basis,
    linearise_readings,
)
from jointstiff.solver.geometry.poses import PoseReadings, Poses, PoseState
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Body, Robot
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.mechanics.terms import FORCE_SCALE, list_stated_terms

NEGLIGIBLE_TORQUE: Final = 1e-3
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
BEYOND_CHANCE: Final = 1e-3
"""p-value below which residuals contradict the stated sigma, or readings contradict the masses."""
LEAST_NOISE: Final = 3e-6
"""Least noise [m] that is assumed if no sigma is stated: no instrument reads a position better."""
_RANK_TOLERANCE: Final = 1e-10
"""Singular value, relative to the greatest, below which columns count as linearly dependent."""


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
    torque_scale = np.maximum(torque_scale, NEGLIGIBLE_TORQUE * torque_scale.max())[observed]
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
    if not tilt_is_better or tilting.compute_p_value_of_bounds(noise, load_coordinates) <= BEYOND_CHANCE:
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
            > BEYOND_CHANCE
        ):
            findings.append(report_contradicted_mass(wrong_body, wrong_mass))
            return second, widened, findings
    elif (remark := report_unchecked_masses(bodies, freed)) is not None:
        findings.append(remark)
    return fit, bodies, findings


def count_load_coordinates(loaded: Measurements, poses: Poses) -> int:
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
class WeightFitter:
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

    def with_uncertain_loads(self, load_coordinates: int, least_square: float) -> WeightFitter:
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
