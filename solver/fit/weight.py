"""Fit of compliances, masses and geometry by own weight (method.md §14).

Geometry, compliances and weights are fitted together by Gauss-Newton steps, each with a convex program. In a
step, the columns of the geometry are projected out of the linearised readings, the remaining rows are
compressed to as many rows as columns, and the convex program is solved for the compliances c and the products
η = c (π − π⁰), with π the masses and π⁰ their nominal values. Each step updates the geometry and the sag,
until the predictions no longer change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import pinocchio as pin
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
from jointstiff.solver.fit.problem import Certificate, LeastSquares, Problem, Solution
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import solve
from jointstiff.solver.fit.stages import Scale
from jointstiff.solver.fit.statements import LEAST_STATED_SIGMA, Statements
from jointstiff.solver.fit.triangle import Triangle, compute_triangular_factor
from jointstiff.solver.fit.weight_rows import (
    Burden,
    ReducedProblem,
    WeightReadings,
    WeightRows,
    compute_perpendicular_basis,
    linearise_readings,
    list_errors_of_deflections,
)
from jointstiff.solver.geometry.poses import PoseState, calibrate
from jointstiff.solver.mechanics.robot import Body
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.models import OWN_WEIGHT, WeightModel

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
_LEAST_NOISE: Final = 3e-6
"""Least noise [m] that is assumed if no sigma is stated: no instrument reads a position better."""
_RANK_TOLERANCE: Final = 1e-10
"""Singular value, relative to the greatest, below which columns count as linearly dependent."""


@dataclass(frozen=True)
class Weighed:
    """Options of a fit by own weight."""

    free_gravity: bool = False  #: whether the direction of gravity is estimated; else it is as stated
    #: whether the tilt of the base is estimated in any case; else only if the readings prove a tilt
    free_base: bool = False


@dataclass(frozen=True, eq=False)
class WeightFit:
    """Fitted geometry, compliances and weights after the last Gauss-Newton step."""

    readings: WeightReadings  #: N observations, with the bounds of masses that the fit used
    rms_without_sag: float  #: rms residual of a whitened coordinate for the best rigid arm [m]
    statements: Statements  #: stated errors of the loads that were fitted together with the compliances
    base_is_free: bool  #: whether the tilt of the base was estimated
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
    findings: tuple[Finding, ...] = ()  #: findings and remarks on masses and on the base

    @property
    def model(self) -> WeightModel:
        """Model of the parts that bend: the joints, under the robot's own weight."""
        return OWN_WEIGHT

    @property
    def loss(self) -> float:
        """Loss of the convex problem at its optimum: what the bounds of the masses add."""
        return self.reduced.convex.squares.loss(self.optimum.x)

    @property
    def certificates(self) -> tuple[Certificate, ...]:
        """Certificate of the convex program of the last step."""
        return (self.optimum.certificate,)

    @property
    def scale(self) -> Scale:
        """Sigma, as stated or from the residuals, and the chi-square of the residuals.

        Raises:
            NotObservableError: fewer coordinates than unknowns.
        """
        squares, degrees_of_freedom = self.reduced.residual_squares, self.count_degrees_of_freedom()
        sigma = self.readings.poses.sigma
        if sigma is not None:
            return Scale(sigma, given=True, chi_square=squares, degrees_of_freedom=degrees_of_freedom)
        sigma = float(np.sqrt(squares / degrees_of_freedom))
        chi_square = float(degrees_of_freedom)
        return Scale(sigma, given=False, chi_square=chi_square, degrees_of_freedom=degrees_of_freedom)

    def count_degrees_of_freedom(self) -> int:
        """Return the degrees of freedom of the residuals: coordinates read minus unknowns determined.

        Raises:
            NotObservableError: fewer coordinates than unknowns.
        """
        # Coordinates of positions that remain after the fit of the geometry, and those of deflections.
        remaining = self.reduced.remaining_coordinates + self.readings.load_coordinates
        rank = self.reduced.rank
        if remaining > rank:
            return remaining - rank
        raise NotObservableError(
            f"{remaining} coordinates that remain after the fit of the geometry do not determine "
            f"{rank} compliances and weights",
            where="observations",
            remedy="read more postures, or more targets in each posture",
        )

    def estimate_noise_variance(self) -> float:
        """Return the mean square of the residuals that no compliances and weights explain.

        Residuals are in units of the stated sigma, so that the variance is at least 1. If no sigma is stated,
        they are in metres, and the variance is at least that of the best instrument.

        Raises:
            NotObservableError: fewer coordinates than unknowns.
        """
        sigma_is_unit = self.readings.poses.sigma is not None
        least_variance = 1.0 if sigma_is_unit else _LEAST_NOISE**2
        mean_square = self.reduced.residual_squares / self.count_degrees_of_freedom()
        return max(mean_square, least_variance)

    def compute_p_value_of_bounds(self) -> float:
        """Return the p-value of the hypothesis that the true masses lie within their bounds (F test).

        The loss that the bounds of the masses add is compared with the noise.

        Raises:
            NotObservableError: fewer coordinates than unknowns.
        """
        rank = self.reduced.rank
        f_ratio = self.loss / rank / self.estimate_noise_variance()
        return float(special.fdtrc(rank, self.count_degrees_of_freedom(), f_ratio))

    def add_finding(self, finding: Finding) -> WeightFit:
        """Return the fit with a further finding."""
        return replace(self, findings=(*self.findings, finding))


def fit_weight(readings: WeightReadings, options: Weighed) -> WeightFit:
    """Fit geometry, compliances and weights; repeat the fit with a tilting base or wider bounds of a mass.

    A tilting base, or wider bounds of a mass, are used only if the readings prove the need. If a further fit
    fails, the previous fit is returned.

    Args:
        readings: N observations of positions, with bodies and gravity.
        options: whether the direction of gravity and the tilt of the base are estimated.

    Raises:
        MeasurementError: the fit with a rigid base does not converge, or positions and deflections are
            combined but not all of their sigmas are stated.
        NotObservableError: even with a rigid base, there are fewer coordinates than unknowns, or no joint's
            torque varies.
        SolverError: a convex program is not certified.
    """
    _refuse_unstated_sigma(readings)
    fitter = _WeightFitter.start(readings, free_gravity=options.free_gravity)
    if readings.stated is not None or readings.loaded is not None:
        fitter = fitter.with_uncertain_loads()
    fit = _fit_base(fitter, free_base=options.free_base)
    return _correct_wrong_mass(fitter, fit)


def _refuse_unstated_sigma(readings: WeightReadings) -> None:
    """Refuse positions and deflections together whose sigmas are not all stated.

    Raises:
        MeasurementError: a sigma is not stated, so that positions and deflections cannot be combined.
    """
    if readings.loaded is None:
        return
    if readings.poses.sigma is None or readings.loaded.sigma is None:
        raise MeasurementError(
            "positions and deflections are combined, but not all of their uncertainties are stated",
            where="noise",
            remedy="state `noise.sigma` for the positions and for the deflections",
        )


@dataclass(frozen=True, eq=False)
class _WeightFitter:
    """Fit of the same readings for bodies whose mass bounds may differ from the stated bounds."""

    readings: WeightReadings  #: N observations of positions, with bodies as stated
    rigid_arm: PoseState  #: geometry of the best arm without sag
    rms_without_sag: float  #: rms residual of a whitened coordinate for this arm [m]
    statements: Statements  #: stated errors of the loads; none for exact loads
    #: (N, T, 3, K) motion of the targets by one standard uncertainty of each error of the loads under which
    #: positions were read [m]; None for exact loads
    motion_per_uncertainty: FloatArray | None
    free_gravity: bool  #: whether the direction of gravity is estimated

    @classmethod
    def start(cls, readings: WeightReadings, *, free_gravity: bool) -> _WeightFitter:
        """Fit the best arm without sag, from which the fits start; loads count as exact."""
        rigid = calibrate(readings.robot.chain, readings.poses, start=pin.SE3.Identity(), hold_out=False)
        rigid_arm = PoseState(rigid.axes, rigid.targets, np.zeros(len(readings.poses)))
        rms_without_sag = float(np.sqrt(rigid.rss / rigid.dof))
        exact = Statements.none(readings.robot.n)
        return cls(readings, rigid_arm, rms_without_sag, exact, None, free_gravity)

    def with_uncertain_loads(self) -> _WeightFitter:
        """Return the fitter that accounts for what is stated of the loads.

        A fit with exact loads gives the compliances at which the columns of statements are computed, and
        sigma if none is stated.
        """
        readings, exact = self.readings, self.fit(self.readings.burden.bodies)
        sigma = readings.poses.sigma
        if sigma is None:
            sigma = float(np.sqrt(exact.estimate_noise_variance()))
        compliance = np.maximum(exact.compliance, 0.0)
        errors = readings.list_stated_errors()
        statements = Statements(errors, readings.common_uncertainty, compliance, sigma)
        motion = None
        if readings.stated is not None:
            motion = readings.stated.move_positions(compliance)
        return replace(self, statements=statements, motion_per_uncertainty=motion)

    def try_fit(self, bodies: tuple[Body, ...], *, free_base: bool) -> WeightFit | None:
        """Fit with other bounds of the masses or a tilting base; return None if the fit fails.

        A fit with more unknowns than coordinates counts as failed.
        """
        try:
            fit = self.fit(bodies, free_base=free_base)
            fit.count_degrees_of_freedom()
        except (MeasurementError, NotObservableError):
            return None
        return fit

    def fit(self, bodies: tuple[Body, ...], *, free_base: bool = False) -> WeightFit:
        """Fit geometry, compliances and weights by Gauss-Newton steps, each with a convex program.

        Args:
            bodies: bodies with bounds of their masses.
            free_base: whether the tilt of the base is estimated.

        Raises:
            NotObservableError: no joint's torque varies.
            MeasurementError: the steps do not converge.
            SolverError: a convex program is not certified.
        """
        burden = replace(self.readings.burden, bodies=bodies)
        readings = replace(self.readings, burden=burden)
        whitened, state = readings.whitened, self.rigid_arm
        gravity, sag = burden.gravity, np.zeros(whitened.angles.shape)
        compliance: FloatArray = np.zeros(readings.robot.n)
        base: FloatArray = np.zeros(3)
        weight_norm = np.linalg.norm(whitened.weight)
        nuisance = ["geometry"]
        if free_base:
            nuisance.append("base")
        if self.free_gravity:
            nuisance.append("gravity")
        for step in range(1, MOST_STEPS + 1):
            with_gravity = replace(readings, burden=replace(burden, gravity=gravity))
            rows = linearise_readings(with_gravity, state, sag, compliance, self.motion_per_uncertainty)
            with_statements = self._compress_with_stated_errors(rows)
            triangle = with_statements
            if self.motion_per_uncertainty is not None:
                triangle = with_statements.project_out(["statements"], RANK)
            deflection_rows = _compress_deflections(readings, compliance, self.statements)
            reduced = reduce_problem(rows, triangle, nuisance, burden, deflection_rows)
            optimum = solve(reduced.convex)
            unknowns = reduced.expand_solution(rows, optimum.x)
            # Change of the nuisance unknowns: geometry, then three of the base, then two of gravity.
            nuisance_change = triangle.fit(nuisance, unknowns, RANK)
            nuisance_columns = np.concatenate([triangle.span[name] for name in nuisance])
            unknowns[nuisance_columns] += nuisance_change
            geometry_width = rows.stack.widths["geometry"]
            previous_sag, sag = sag, reduced.compute_sag(rows.torques, optimum.x)
            state = state.displace(nuisance_change[:geometry_width])
            if free_base:
                # Deflections are linear in the base's compliances, so the step fits the compliances
                # themselves, not their change: subtract the previous values.
                in_base = slice(geometry_width, geometry_width + 3)
                previous_base, base = base, nuisance_change[in_base].copy()
                nuisance_change[in_base] = base - previous_base
            if self.free_gravity:
                gravity = _turn_gravity(gravity, nuisance_change[-2:])
            compliance[reduced.observed_joints] = reduced.unit * optimum.x[reduced.convex.cone.first]
            nuisance_effect = np.linalg.norm(triangle.matrix[:, nuisance_columns] @ nuisance_change)
            prediction_change = nuisance_effect + weight_norm * np.abs(sag - previous_sag).max()
            squares = reduced.convex.squares
            residual_norm = np.sqrt(squares.loss(optimum.x) + reduced.residual_squares)
            if prediction_change <= _CONVERGED * residual_norm + _EXACT * np.linalg.norm(squares.z):
                return WeightFit(
                    readings=readings,
                    rms_without_sag=self.rms_without_sag,
                    statements=self.statements,
                    base_is_free=free_base,
                    state=state,
                    gravity=gravity,
                    sag=sag,
                    base=base,
                    compliance=compliance,
                    rows=rows,
                    reduced=reduced,
                    optimum=optimum,
                    steps=step,
                    motion_by_loads=self._move_by_loads(with_statements, unknowns),
                )
        raise MeasurementError(
            f"the fit of geometry and own weight did not converge in {MOST_STEPS} steps",
            where="observations",
            remedy="check masses, centres of mass, gravity's direction, and the unit and sign of the angles",
        )

    def _compress_with_stated_errors(self, rows: WeightRows) -> Triangle:
        """Compress linearised readings, with a further row for each stated error of the loads: it is zero.

        A column of `statements` is the motion by one standard uncertainty of an error, so that each of these
        unknowns is 0 ± 1. For exact loads there are no such columns and no further rows.
        """
        triangle = rows.stack.triangle()
        if self.motion_per_uncertainty is None:
            return triangle
        one_uncertainty_each = np.ones(rows.stack.widths["statements"])
        sigma_of_reading = self.statements.sigma / self.readings.unit  # in the unit of the rows
        return triangle.state_as_zero("statements", one_uncertainty_each, sigma_of_reading)

    def _move_by_loads(self, triangle: Triangle, unknowns: FloatArray) -> FloatArray | float:
        """Return the motion (N, T, 3) of the targets by the errors of the loads that fit best [m].

        The motion is 0 for exact loads.

        Args:
            triangle: compressed rows of the positions and of the statements, whose columns come last.
            unknowns: (P,) all other unknowns.
        """
        if self.motion_per_uncertainty is None:
            return 0.0
        count = len(triangle.span["statements"])
        other_unknowns = np.concatenate([unknowns, np.zeros(count)])
        errors = triangle.fit(["statements"], other_unknowns, RANK)  # in standard uncertainties
        return np.asarray(self.motion_per_uncertainty @ errors)


def _turn_gravity(gravity: FloatArray, angles: FloatArray) -> FloatArray:
    """Return gravity (3,) tilted by small angles (2,) [rad] towards two axes perpendicular to gravity."""
    size = np.linalg.norm(gravity)
    perpendicular_axes = compute_perpendicular_basis(gravity)  # (3, 2)
    tilted = gravity + size * perpendicular_axes @ angles
    return np.asarray(tilted * size / np.linalg.norm(tilted))  # of the size before


def _compress_deflections(
    readings: WeightReadings, compliance: FloatArray, statements: Statements
) -> FloatArray:
    """Compress the rows (k, n + 1) of deflections under known loads, in units of their sigma.

    What is stated of loads and places is fitted together with the compliances.

    Args:
        readings: observations of a robot with n joints, with or without deflections.
        compliance: (n,) compliances at which the loads are in balance [rad/(N·m)].
        statements: stated errors of all loads; none for exact loads.
    """
    robot, loaded = readings.robot, readings.loaded
    if loaded is None:
        return np.zeros((0, robot.n + 1))
    sigma = loaded.sigma or 1.0
    stated_names = {term.name for term in statements.terms}
    terms = tuple(term for term in list_errors_of_deflections(loaded) if term.name in stated_names)
    of_deflections = replace(statements, terms=terms, sigma=max(sigma, LEAST_STATED_SIGMA))
    blocks = list(of_deflections.generate(Rows(robot, loaded, compliance), [JOINTS]))
    error_count = blocks[0].targets.shape[-1] - 1 - robot.n  # besides the joints and the readings
    triangle = Triangle(joints=robot.n, statements=error_count)
    for of_block in blocks:
        triangle.add(of_block.flat)
    if error_count:
        one_uncertainty_each = np.ones(error_count)
        triangle = triangle.project_out_stated("statements", one_uncertainty_each, of_deflections.sigma)
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
    residual_squares = float(unexplained @ unexplained)
    if len(R) > column_count:  # the last row has what no column explains
        residual_squares += float(R[column_count, column_count] ** 2)
    return ReducedProblem(
        convex=Problem(LeastSquares(A, b - unexplained), cone),
        residual_squares=residual_squares,
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


def _fit_base(fitter: _WeightFitter, *, free_base: bool) -> WeightFit:
    """Fit with a rigid base, or with a tilting base if the readings prove the tilt or it is requested.

    Args:
        fitter: fit of the readings.
        free_base: whether the tilt of the base is estimated even if the readings do not prove a tilt.

    Raises:
        NotObservableError: even with a rigid base, there are fewer coordinates than unknowns.
        MeasurementError: the fit with a rigid base does not converge.
    """
    bodies = fitter.readings.burden.bodies
    rigid = fitter.fit(bodies)
    tilting = fitter.try_fit(bodies, free_base=True)
    if tilting is None:
        return rigid.add_finding(_BASE_UNCHECKED) if free_base else rigid
    p_value = compute_tilt_p_value(rigid, tilting)
    if p_value < _BASE_LEVEL:
        return tilting.add_finding(_report_tilt(tilting, p_value))
    return tilting if free_base else rigid


def compute_tilt_p_value(rigid: WeightFit, tilting: WeightFit) -> float:
    """Return the p-value of the hypothesis that the base does not tilt (F test).

    The p-value is 1 if a wrong mass explains the readings at least as well as a tilting base does, or if even
    with a tilting base the readings contradict the bounds of the masses.

    Args:
        rigid: fit without tilt.
        tilting: fit with the tilt of the base.
    """
    noise_variance = tilting.estimate_noise_variance()
    gain = (
        rigid.loss + rigid.reduced.residual_squares - tilting.loss - tilting.reduced.residual_squares
    ) / noise_variance
    freed = fit_freed_masses(rigid.reduced, rigid.readings.burden, rigid.estimate_noise_variance())
    wrong_mass = find_contradicted_mass(freed)
    gain_by_mass = 0.0 if wrong_mass is None else wrong_mass.gain
    tilt_is_better = gain > gain_by_mass
    if not tilt_is_better or tilting.compute_p_value_of_bounds() <= BEYOND_CHANCE:
        return 1.0
    return float(special.fdtrc(3, tilting.count_degrees_of_freedom(), gain / 3.0))


def _report_tilt(tilting: WeightFit, p_value: float) -> Finding:
    """Build the finding about a base that the readings prove to tilt."""
    tilts = " and ".join(f"{1e9 * each:.2g}" for each in tilting.base[:2])
    return Finding(
        code="base_bends",
        weight="use_with_care",
        message=f"the base below the first joint tilts under the weight (F test, p = {p_value:.1g}), "
        f"by {tilts} nrad/(N·m) about x and y; the joints' stiffnesses do not include this tilt",
        remedy="tighten and stiffen the base; a target on the base plate shows directly how the base tilts",
    )


def _correct_wrong_mass(fitter: _WeightFitter, fit: WeightFit) -> WeightFit:
    """Fit again with wider bounds of the mass that the readings contradict, if they contradict one.

    Args:
        fitter: fit of the readings.
        fit: fit with the bounds as stated.
    """
    burden = fit.readings.burden
    freed = fit_freed_masses(fit.reduced, burden, fit.estimate_noise_variance())
    wrong_mass = find_contradicted_mass(freed)
    if wrong_mass is None:
        remark = report_unchecked_masses(burden.bodies, freed)
        return fit if remark is None else fit.add_finding(remark)
    wrong_body = burden.bodies[wrong_mass.body]
    widened = fitter.try_fit(widen_mass_bounds(burden.bodies, wrong_mass), free_base=fit.base_is_free)
    if widened is None:
        return fit.add_finding(report_contradicted_mass(wrong_body, wrong_mass, covered=False))
    masses_agree = widened.compute_p_value_of_bounds() > BEYOND_CHANCE
    if not masses_agree:  # this mass alone is not the cause, so that wider bounds do not help
        return fit
    finding = report_contradicted_mass(wrong_body, wrong_mass)
    return replace(widened, findings=(*fit.findings, finding))
