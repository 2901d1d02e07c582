"""Stiffness without a load: the whole way, from positions and masses to compliances with their evidence.

    estimate = identify_weight(robot, readings)

Geometry, compliances and weights are one fit: Gauss-Newton outside, the convex program inside. Columns of
geometry are projected out, what is left is compressed to as many rows as columns, and the convex program is
solved for c and the products η = c (π − π⁰). Each step moves the geometry, and the sag with the new products,
until no prediction moves any more.

An interval of c_j holds all values that some geometry and some masses within their bounds explain as well as
chance allows: ``loss ≤ best + χ²``. As each joint has masses of its own in the program it is an outer bound,
exact where all masses are exact.
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
from jointstiff.solver.estimation.assessment import report_no_identified_joint
from jointstiff.solver.estimation.conic import (
    MassCones,
    MassConeSolution,
    bound_compliances,
    solve_mass_cones,
)
from jointstiff.solver.estimation.estimate import JointCompliance
from jointstiff.solver.estimation.fit import student_quantile
from jointstiff.solver.estimation.solution import Certificate
from jointstiff.solver.estimation.triangle import Triangle, compute_triangular_factor
from jointstiff.solver.geometry.poses import (
    PoseReadings,
    PoseState,
    calibrate,
    differentiate_numerically,
)
from jointstiff.solver.mechanics.block import build_whitened_rows, regressor_blocks
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Body, Robot
from jointstiff.solver.mechanics.springs import JOINTS
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
    WeightReadings,
    WeightRows,
    compute_torques,
    differentiate_by_base_compliance,
    linearise_readings,
    perpendicular_basis,
)
from jointstiff.solver.predict.models import IdentifiedWeight
from jointstiff.solver.text import figure, length_text

_UPRIGHT: Final = 1e-3
"""Weight torque, relative to the greatest of all, that counts as none."""
MOST_STEPS: Final = 15
_BASE_LEVEL: Final = 1e-5
"""Probability of chance below which a base tilts."""
_CONVERGED: Final = 1e-3
"""Movement of the predictions, relative to the residuals, that ends the steps."""
_EXACT: Final = 1e-7
"""The same, relative to all that the convex program is to explain: exact readings leave no residuals."""
LARGEST_SAG: Final = 0.1
"""Sag of a joint [rad] at its greatest compliance: what sags more is no robot."""
RANK: Final = 1e-10
"""Singular value of unit columns of the geometry that is rounding."""
_BEYOND_CHANCE: Final = 1e-3
"""Probability of chance below which residuals or masses count as contradicted."""
_RIGID: Final = 1e-6
"""Compliance, relative to the end of its interval, that is rounding of a rigid joint's."""
_AT_CAP: Final = 0.5
"""Share of the greatest compliance that counts as no bound at all."""
_LEAST_NOISE: Final = 3e-6
"""Residuals [m] below which nothing is left to explain: no instrument reads a place better."""
_NOTHING: Final = 1e-10
"""Singular value, relative to the greatest, that is rounding of columns that depend on each other."""
_LEAST_SIGMA: Final = 1e-15
"""Rounding: no reading is better."""


@dataclass(frozen=True, eq=False)
class WeightFit:
    """Optimum of geometry, compliances and weights, as the last Gauss-Newton step left it."""

    state: PoseState  #: geometry
    gravity: FloatArray  #: (3,) in R0 [m/s²]
    sag: FloatArray  #: (N, n) θ [rad]
    base: FloatArray  #: (3,) C_xx, C_yy, C_xy of the base [rad/(N·m)]; zero of a rigid one
    compliance: FloatArray  #: (n,) [rad/(N·m)]; zero where unseen
    rows: WeightRows  #: rows of the last step
    reduced: ReducedProblem  #: the problem of the last step
    optimum: MassConeSolution  #: its solution
    steps: int  #: number of steps of Gauss and Newton

    def count_degrees_of_freedom(self, load_coordinates: int) -> int:
        """Return the degrees of freedom of the residuals: coordinates read less unknowns determined.

        Args:
            load_coordinates: number of coordinates of deflections under known loads.

        Raises:
            NotObservableError: fewer coordinates than unknowns.
        """
        remaining, rank = self.reduced.freedom + load_coordinates, self.reduced.rank  # after the geometry
        if remaining > rank:
            return remaining - rank
        raise NotObservableError(
            f"{remaining} coordinates that remain after the fit of the geometry do not determine "
            f"{rank} compliances and weights",
            where="observations",
            remedy="read more postures, or more targets in each posture",
        )

    def estimate_noise(self, load_coordinates: int, least: float) -> float:
        """Return the mean square of the residuals that no compliances and weights explain.

        Args:
            load_coordinates: number of coordinates of deflections under known loads.
            least: lower limit of the returned value, in the fit's unit.
        """
        return max(self.reduced.outside / self.count_degrees_of_freedom(load_coordinates), least)

    def compute_p_value_of_bounds(self, noise: float, load_coordinates: int) -> float:
        """Return the p-value of the loss that is due to the bounds of the masses (F test).

        Args:
            noise: mean square of the residuals.
            load_coordinates: number of coordinates of deflections under known loads.
        """
        rank = self.reduced.rank
        return float(
            special.fdtrc(
                rank, self.count_degrees_of_freedom(load_coordinates), self.optimum.loss / rank / noise
            )
        )


def fit_weight(
    robot: Robot,
    readings: WeightReadings,
    whitened: PoseReadings,
    state: PoseState,
    *,
    free_gravity: bool = False,
    free_base: bool = False,
    loaded: Measurements | None = None,
) -> WeightFit:
    """Fit geometry, compliances and weights by Gauss-Newton steps, each with a convex program.

    Args:
        robot: nominal robot, n joints.
        readings: N observations of positions, with bodies and gravity.
        whitened: the same positions with their weights, in units of 1/sigma.
        state: geometry to start from, fitted without sag.
        free_gravity: whether the direction of gravity is also estimated.
        free_base: whether the tilt of the base is also estimated.
        loaded: deflections under known loads, fitted together with the positions; their rows are in units of
            the sigma of the deflections. None without such readings.

    Raises:
        NotObservableError: no joint's torque varies.
        MeasurementError: no convergence.
        SolverError: a convex program is not certified.
    """
    burden = readings.burden
    gravity, sag = burden.gravity, np.zeros(whitened.angles.shape)
    c: FloatArray = np.zeros(robot.n)
    base: FloatArray = np.zeros(3)
    weight = np.linalg.norm(whitened.weight)
    for step in range(1, MOST_STEPS + 1):
        with_gravity = replace(readings, burden=replace(burden, gravity=gravity))
        rows = linearise_readings(robot, with_gravity, whitened, state, sag, c)
        triangle, load_triangle = rows.stack.triangle(), Triangle(joints=robot.n)
        nuisance = ["geometry", *(["base"] if free_base else []), *(["gravity"] if free_gravity else [])]
        for block in [] if loaded is None else regressor_blocks(robot, loaded, c):
            read = build_whitened_rows(block, [JOINTS], c)
            for part in (read.targets, read.encoders):
                if part is not None:
                    load_triangle.add(part)
        others = load_triangle.R[: load_triangle.rows] / (1.0 if loaded is None else loaded.sigma or 1.0)
        reduced = reduce_problem(rows, triangle, nuisance, burden, others)
        optimum = solve_mass_cones(reduced.A, reduced.b, reduced.cones)
        move = triangle.fit(nuisance, reduced.expand_solution(rows, optimum.x), RANK)
        after = rows.stack.widths["geometry"]
        before, sag = sag, reduced.compute_sag(rows.torques, optimum.x)
        state = state.displace(move[:after])
        if free_base:  # linear: the step fits all of the tilt, not a change
            base, move[after : after + 3] = move[after : after + 3].copy(), move[after : after + 3] - base
        if free_gravity:
            turned = gravity + np.linalg.norm(gravity) * perpendicular_basis(gravity) @ move[-2:]
            gravity = turned * np.linalg.norm(gravity) / np.linalg.norm(turned)
        c[reduced.seen] = reduced.unit * optimum.x[reduced.cones.first]
        own = np.concatenate([triangle.span[name] for name in nuisance])
        moved = np.linalg.norm(triangle.matrix[:, own] @ move) + weight * np.abs(sag - before).max()
        small = _CONVERGED * np.sqrt(optimum.loss + reduced.outside) + _EXACT * np.linalg.norm(reduced.b)
        if moved <= small:
            return WeightFit(state, gravity, sag, base, c, rows, reduced, optimum, step)
    raise MeasurementError(
        f"the fit of geometry and own weight did not converge in {MOST_STEPS} steps",
        where="observations",
        remedy="check masses, centres of mass, gravity's direction, and the unit and sign of the angles",
    )


def reduce_problem(
    rows: WeightRows, triangle: Triangle, nuisance: Sequence[str], burden: Burden, others: FloatArray
) -> ReducedProblem:
    """Reduce linearised readings to a small convex problem whose unknowns are compliances and weights.

    Columns of the geometry are projected out, and a QR decomposition compresses the remaining rows.

    Args:
        rows: linearised readings of positions.
        triangle: triangular factor of these rows.
        nuisance: names of the terms that are projected out, such as the geometry.
        burden: bodies and springs.
        others: (k, n + 1) rows of deflections under loads: columns of the compliances, then the reading.

    Raises:
        NotObservableError: no joint's torque varies.
    """
    torque, varies = rows.torques.known, rows.varies
    seen = np.flatnonzero(varies | others[:, :-1].any(axis=0))
    if not len(seen):
        raise NotObservableError(
            "no joint's weight torque varies over the postures",
            where="observations",
            remedy="read postures in which the arm is stretched out and folded, wrist up and down",
        )
    left = triangle.project_out(nuisance, RANK)
    products = left.span["products"].reshape(rows.torques.unit.shape[1:])
    parts, below, blocks, units, unknowns = [], [], [], [], []
    for j in seen.tolist():
        own = left.R[:, left.span["joints"][j]] * varies[j]
        unit = 1.0 / float(np.hypot(np.linalg.norm(own), np.linalg.norm(others[:, j])))
        block, which = burden.build_block(varies[j] & rows.torques.unit[:, j].any(axis=0))
        parts.append(unit * np.column_stack([own, left.R[:, products[j, which]]]))
        below.append(np.pad(unit * others[:, j, None], ((0, 0), (0, len(which)))))
        blocks.append(block)
        units.append(unit)
        unknowns.append(which)
    unit_of = np.array(units)
    by_weight = np.column_stack([*parts, left.rhs])
    R = compute_triangular_factor(np.vstack([by_weight, np.column_stack([*below, others[:, -1]])]))
    p = R.shape[1] - 1
    A, b = R[:p, :p], R[:p, p]
    rotation, singular, _ = np.linalg.svd(A)
    nothing = rotation[:, singular <= _NOTHING * singular[0]]  # rounding, which no x explains
    beyond = nothing @ (nothing.T @ b)  # part of b outside the range of A
    scale = np.where(varies, np.abs(torque).max(axis=0), rows.across)
    # A joint without weight torque may be pulled by a known load, so its scale must not be zero.
    scale = np.maximum(scale, _UPRIGHT * scale.max())[seen]
    return ReducedProblem(
        A=A,
        b=b - beyond,
        outside=float(beyond @ beyond) + (float(R[p, p] ** 2) if len(R) > p else 0.0),
        rank=p - nothing.shape[1],
        cones=MassCones(tuple(blocks), LARGEST_SAG / scale / unit_of),
        unit=unit_of,
        seen=seen,
        unknowns=tuple(unknowns),
        freedom=triangle.rows - triangle.rank(nuisance, RANK),
    )


def extract_weight(
    burden: Burden, fit: WeightFit, sigma: float, uncertainty: FloatArray
) -> IdentifiedWeight | None:
    """Return the identified weights with their covariance, to predict the sag; None with balancing springs.

    Positions determine products of compliance and weight far better than either factor. About the optimum
    ``A x = b + ε``. Each parameter has its bound's half-width as prior standard uncertainty; with D of all of
    these, ``cov x = (AᵀA/σ² + D⁻²)⁻¹``. It is widened for joints whose own interval is wider.

    Args:
        burden: bodies that the joints carry in all observations.
        fit: fit of the robot and its weight.
        sigma: standard uncertainty of a residual, in the fit's unit.
        uncertainty: (n,) standard uncertainties of the compliances; zero where unknown.
    """
    if burden.balancers:
        return None
    problem, x, n = fit.reduced, fit.optimum.x, len(fit.compliance)
    # A compliance is bounded by its cap, and a product by the compliance, as units are those of the bounds.
    reach = np.full(len(x), 1e-3 * float(np.abs(x).max()))
    for (_, _, place, _), cap in zip(problem.blocks, problem.cones.cap.tolist(), strict=True):
        reach[place] = np.maximum(reach[place.start], x[place.start])
        reach[place.start] = cap
    stacked = np.vstack([problem.A / max(sigma, _LEAST_SIGMA), np.diag(1.0 / reach)])
    root = np.linalg.inv(compute_triangular_factor(stacked))
    nominal, inertia_of = np.zeros((n, 4)), np.zeros((n, 4, len(burden.unknown[0])))
    for body in burden.bodies:
        nominal[body.joint] += 0.5 * (body.most + body.least) * np.array([1.0, *body.centre])
    for k, (number, inertia) in enumerate(burden.unknown[0]):
        inertia_of[burden.bodies[number].joint, :, k] = inertia
    inertias, roots = np.tile(nominal, (n, 1, 1)), np.zeros((n, 4 * n, len(x)))
    compliances = np.zeros((n, len(x)))
    for j, unit, place, own in problem.blocks:
        products = unit * np.column_stack([nominal.ravel(), inertia_of.reshape(4 * n, -1)[:, own]])
        compliance = unit * float(np.linalg.norm(root[place.start]))
        root[place] *= max(1.0, uncertainty[j] / compliance)
        roots[j], compliances[j] = products @ root[place], unit * root[place.start]
        if x[place.start] > 0.0:
            inertias[j] = (products @ x[place] / (unit * x[place.start])).reshape(n, 4)
    mass: FloatArray = inertias[..., 0]
    centre = inertias[..., 1:] / np.where(mass > 0.0, mass, 1.0)[..., None]
    covariance_root = np.vstack([compliances, roots.reshape(4 * n * n, -1)])
    return IdentifiedWeight(mass, centre, fit.gravity, root=covariance_root)


_BASE_UNCHECKED: Final = Finding(
    code="base_unchecked",
    weight="use_with_care",
    message="the readings do not determine how the base below the first joint tilts: the base is taken as "
    "rigid, so any tilt of it counts as compliance of the joints",
    remedy="read more postures; or state `rigid_base` if nothing below the first joint gives way",
)


def try_further_fit(
    fit_with_bodies: Callable[..., WeightFit],
    bodies: tuple[Body, ...],
    load_coordinates: int,
    *,
    free_base: bool,
) -> WeightFit | None:
    """Fit once more with other bodies; return None where the readings do not suffice or the fit fails.

    Args:
        fit_with_bodies: function from bodies to the fit, with keyword `free_base`.
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
    rigid: WeightFit, tilting: WeightFit, burden: Burden, load_coordinates: int, least: float
) -> float:
    """Return the p-value of the hypothesis that the base does not tilt (F test).

    It is 1 if a wrong mass explains the readings at least as well as a tilting base does.

    Args:
        rigid: fit without tilt.
        tilting: fit with the tilt of the base.
        burden: bodies and springs.
        load_coordinates: number of coordinates of deflections under known loads.
        least: least mean square of the residuals, in the fit's unit.
    """
    noise = tilting.estimate_noise(load_coordinates, least)
    gain = (
        rigid.optimum.loss + rigid.reduced.outside - tilting.optimum.loss - tilting.reduced.outside
    ) / noise
    wrong_mass = find_contradicted_mass(
        fit_freed_masses(rigid.reduced, burden, rigid.estimate_noise(load_coordinates, least))
    )
    tilt_is_better = gain > (0.0 if wrong_mass is None else wrong_mass.gain)
    if not tilt_is_better or tilting.compute_p_value_of_bounds(noise, load_coordinates) <= _BEYOND_CHANCE:
        return 1.0
    return float(special.fdtrc(3, tilting.count_degrees_of_freedom(load_coordinates), gain / 3.0))


def fit_with_proved_corrections(
    fit_with_bodies: Callable[..., WeightFit],
    burden: Burden,
    load_coordinates: int,
    least: float,
    *,
    free_base: bool,
) -> tuple[WeightFit, tuple[Body, ...], list[Finding]]:
    """Fit, and fit again with a tilting base or wider bounds of a mass if the readings prove the need.

    Where the readings do not suffice for a further fit, the previous fit is kept.

    Args:
        fit_with_bodies: function from bodies to the fit, with keyword `free_base`.
        burden: bodies and springs as stated.
        load_coordinates: number of coordinates of deflections under known loads.
        least: least mean square of the residuals, in the fit's unit.
        free_base: whether the base's tilt is estimated even if nothing proves it.

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
        1.0 if tilting is None else compute_tilt_p_value(rigid, tilting, burden, load_coordinates, least)
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
                remedy="tighten and stiffen the base; a target on the base plate shows directly how it tilts",
            )
        )
    freed = fit_freed_masses(fit.reduced, burden, fit.estimate_noise(load_coordinates, least))
    wrong = find_contradicted_mass(freed)
    if wrong is not None:
        wider = widen_mass_bounds(bodies, wrong)
        second = try_further_fit(fit_with_bodies, wider, load_coordinates, free_base=free_base)
        if second is None:
            findings.append(report_contradicted_mass(bodies[wrong.body], wrong, covered=False))
        elif (
            second.compute_p_value_of_bounds(second.estimate_noise(load_coordinates, least), load_coordinates)
            > _BEYOND_CHANCE
        ):
            findings.append(report_contradicted_mass(bodies[wrong.body], wrong))
            return second, wider, findings
    elif (remark := report_unchecked_masses(bodies, freed)) is not None:
        findings.append(remark)
    return fit, bodies, findings


def find_reasons_against(
    fit: WeightFit, rank: int, freedom: int, *, stated: float | None
) -> Iterator[Finding]:
    """Yield findings that reduce the trust in a result: too large residuals, and contradicted masses.

    If the model is right, two sums of squares follow χ²: `outside`, of the residuals that no solution
    explains, and `loss`, which the bounds of the masses add.

    Args:
        fit: fit of the robot and its weight.
        rank: number of compliances and weights that the readings determine.
        freedom: degrees of freedom of the residuals.
        stated: stated standard uncertainty of a coordinate [m]; None if it is estimated.
    """
    outside, loss = fit.reduced.outside, fit.optimum.loss
    p_value = special.fdtrc(rank, freedom, loss / rank / (outside / freedom))
    if stated is not None and special.chdtrc(freedom, outside) < _BEYOND_CHANCE:
        factor = float(np.sqrt(outside / freedom))
        yield Finding(
            code="residuals_exceed_sigma",
            weight="use_with_care",
            message=f"the residuals give sigma = {length_text(factor * stated)}, but {length_text(stated)} "
            "was stated: something bends or moves that neither geometry nor own weight explains",
            remedy="look for play in gears, links that bend, or a target or base that moved; the intervals "
            "use the larger sigma",
        )
    elif stated is not None:
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


def compute_joint_results(
    robot: Robot, fit: WeightFit, sigma: float, rise: float
) -> tuple[tuple[JointCompliance, ...], FloatArray]:
    """Compute the compliance of each joint with its interval, or the reason why no compliance is stated.

    Args:
        robot: n joints.
        fit: fit of the robot and its weight.
        sigma: standard uncertainty of a residual, in the fit's unit.
        rise: rise of the loss above its optimum that bounds the intervals.

    Returns:
        The results of the joints; and (n,) the width that each interval would have with exact masses, over
        its width, NaN without an interval.
    """
    problem = fit.reduced
    intervals = bound_compliances(problem.A, problem.b, fit.optimum, rise, problem.cones)
    exact = np.sqrt(rise) * np.linalg.norm(np.linalg.pinv(problem.A[:, problem.cones.first]), axis=1)
    joints, shares = [], np.full(robot.n, np.nan)
    named = zip(robot.joint_names, robot.joint_kinds, fit.rows.torques.known.T, strict=True)
    for name, kind, torque in named:
        reason = (
            f"its weight torque hardly varies over the postures ({torque.min():.3g} to {torque.max():.3g} "
            "N·m): hang a known payload off its axis, or apply a known force that twists it"
        )
        if np.abs(torque).max() <= _UPRIGHT * np.abs(fit.rows.torques.known).max():
            reason = (
                "gravity does not load the joint in any of the postures: apply a known force that twists it"
            )
        joints.append(JointCompliance(name, kind, "not_observable", reason=reason))
    for k, j in enumerate(problem.seen.tolist()):
        name, unit, (low, high) = robot.joint_names[j], problem.unit[k], intervals[k]
        kind = robot.joint_kinds[j]
        if not high < _AT_CAP * problem.cones.cap[k]:  # NaN where the program has no answer
            reason = (
                f"own weight and readings do not determine the compliance of {name}: read more postures in "
                "which its weight torque differs, as a plan for own weight lists them, or attach a payload"
            )
            joints[j] = JointCompliance(name, kind, "not_observable", reason=reason)
            continue
        c = float(fit.compliance[j]) if fit.compliance[j] > _RIGID * high * unit else 0.0
        shares[j] = min(1.0, 2.0 * float(exact[k]) / (high - low))
        explanation = "estimate and lower end of the interval are a rigid joint"
        if c > 0.0:
            explanation = (
                f"the interval reaches from rigid to {figure(high * unit / c, '.2g')} times the estimate"
            )
        joints[j] = JointCompliance(
            name,
            kind,
            "at_bound" if c == 0.0 else "identified" if low > 0.0 else "uncertain",
            c,
            float(0.5 * (high - low) * unit * sigma / np.sqrt(rise)),
            (float(low * unit), float(high * unit)),
            reason=None if low > 0.0 else f"{explanation}: add postures, better masses or a known payload",
        )
    return tuple(joints), shares


@dataclass(frozen=True, eq=False)
class WeightEstimate:
    """Compliances from own weight, with their evidence."""

    joints: tuple[JointCompliance, ...]  #: one for each joint
    #: (n,) width of the interval that exact masses would leave, over its width; NaN without an interval
    shares: FloatArray
    fit: WeightFit  #: geometry, sag, and the last convex problem
    reasons: tuple[Finding, ...]  #: reasons against its use, if any
    remarks: tuple[Finding, ...]  #: what the readings do not check, for information
    sigma: float  #: standard uncertainty of a coordinate [m], as stated or from the residuals
    sigma_of_residuals: bool  #: whether it is from the residuals: none stated, or larger than stated
    chi_square: float  #: χ² of all residuals by the stated sigma; the degrees of freedom if none is stated
    degrees_of_freedom: int  #: number of readings less all that they determine
    rms_residual: float  #: rms residual of a whitened coordinate [m]
    rms_without_sag: float  #: the same, of the best geometry of an arm that does not bend [m]
    confidence: float  #: level of the intervals
    #: (N, T, 3) displacement of the targets by the sag, from the geometry that does not bend [m]
    displacement: FloatArray
    residual: FloatArray  #: (N, T, 3) position less prediction [m]; zero where absent
    certificate: Certificate  #: certificate of the last convex program
    #: weights of the bodies as identified, to predict the sag; None with balancers
    weight: IdentifiedWeight | None
    #: largest |∂τ_i/∂θ_j| c_i: effect of the sag on the torques, which the balance includes
    largest_stiffness_ratio: float


def identify_weight(
    robot: Robot,
    readings: WeightReadings,
    *,
    confidence: float = 0.95,
    free_gravity: bool = False,
    free_base: bool = False,
    loaded: Measurements | None = None,
) -> WeightEstimate:
    """Identify joint compliances from the sag of an arm under its own weight.

    Args:
        robot: nominal robot, n joints; its axes and the places of the targets are estimated.
        readings: N observations.
        confidence: level of the intervals.
        free_gravity: whether gravity's direction is estimated; else it is as stated.
        free_base: whether the base's tilt is always estimated; else only where the readings prove it.
        loaded: deflections under known loads (loaded − unloaded), fitted together with the positions.

    Raises:
        MeasurementError: no convergence, or positions and deflections are combined without stated sigmas.
        NotObservableError: fewer coordinates than unknowns, or no weight torque varies.
        SolverError: a convex program is not certified.
    """
    poses = readings.poses
    if loaded is not None and (poses.sigma is None or loaded.sigma is None):
        raise MeasurementError(
            "positions and deflections are combined, but not all of their uncertainties are stated",
            where="noise",
            remedy="state `noise.sigma` of both",
        )
    whitened, unit = poses.whitened, poses.sigma or 1.0
    rigid = calibrate(robot.chain, poses, start=pin.SE3.Identity(), hold_out=False)
    load_coordinates = 0
    if loaded is not None:
        encoders = 0 if loaded.encoders is None else int(loaded.encoders.present.sum())
        load_coordinates = int(loaded.coordinates.sum()) + encoders

    stated = readings

    def fit_with_bodies(bodies: tuple[Body, ...], *, free_base: bool = False) -> WeightFit:
        """Fit the readings with given bodies, whose bounds of the masses may differ from those stated."""
        return fit_weight(
            robot,
            replace(stated, burden=replace(stated.burden, bodies=bodies)),
            replace(whitened, weight=whitened.weight / unit),
            PoseState(rigid.axes, rigid.targets, np.zeros(len(poses))),
            free_gravity=free_gravity,
            free_base=free_base,
            loaded=loaded,
        )

    least = 1.0 if poses.sigma is not None else _LEAST_NOISE**2
    fit, bodies, found = fit_with_proved_corrections(
        fit_with_bodies, readings.burden, load_coordinates, least, free_base=free_base
    )
    readings = replace(readings, burden=replace(readings.burden, bodies=bodies))
    problem, loss = fit.reduced, fit.optimum.loss
    rank, freedom = problem.rank, fit.count_degrees_of_freedom(load_coordinates)
    factor = float(np.sqrt(problem.outside / freedom))  # rms of the residuals in units of the stated sigma
    against = (
        *(each for each in found if each.weight != "use"),
        *find_reasons_against(fit, rank, freedom, stated=poses.sigma),
    )
    noisy = poses.sigma is None or any(reason.code == "residuals_exceed_sigma" for reason in against)
    scale = factor if noisy else 1.0
    radius = student_quantile(0.5 + 0.5 * confidence, freedom if noisy else None)
    joints, shares = compute_joint_results(robot, fit, scale, (scale * radius) ** 2)
    statuses = [joint.status for joint in joints]
    missing = report_no_identified_joint(statuses, "read more postures, better masses or a known payload")
    uncertainty = np.array([joint.standard_uncertainty or 0.0 for joint in joints])
    sagging = replace(whitened, angles=whitened.angles + fit.sag)
    bent = fit.state.motion(sagging).points
    bent = bent + differentiate_by_base_compliance(fit.rows.torques, bent) @ fit.base

    def compute_sag_at(turn: FloatArray) -> FloatArray:
        """Return the torques times compliances (N, n) [rad] after turning all angles by `turn` [rad]."""
        motion = fit.state.motion(replace(sagging, angles=sagging.angles + turn))
        return fit.compliance * compute_torques(robot, readings, motion).known

    return WeightEstimate(
        joints=joints,
        shares=shares,
        fit=fit,
        reasons=(*against, *missing),
        remarks=tuple(each for each in found if each.weight == "use"),
        sigma=scale * unit,
        sigma_of_residuals=noisy,
        chi_square=float(freedom) if poses.sigma is None else problem.outside,
        degrees_of_freedom=freedom,
        rms_residual=unit * float(np.sqrt((problem.outside + loss) / (freedom + rank))),
        rms_without_sag=float(np.sqrt(rigid.rss / rigid.dof)),
        confidence=confidence,
        displacement=bent - fit.state.motion(whitened).points,
        residual=np.where(poses.present[..., None], whitened.points - bent, 0.0),
        certificate=fit.optimum.certificate,
        weight=extract_weight(readings.burden, fit, scale, uncertainty),
        largest_stiffness_ratio=float(np.abs(differentiate_numerically(compute_sag_at, robot.n)).max()),
    )
