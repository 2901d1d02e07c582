"""The estimate: joint compliances with intervals, verdicts, budget (GUM, JCGM 100:2008) and predictions.

Each joint has compliance and stiffness with intervals, or the reason why it has none (method.md §6, §8).
Where the joints alone do not fit, held-out postures speak, too: the model error widens the intervals.

The ends of an interval are the least and the greatest aᵀc, a = e_j for a joint, on the part of the ball
``‖R (c − ĉ)‖² ≤ ρ²`` that the constraints leave, ``ρ² = min ‖R (c − ĉ)‖² + Δ``: a profile of the likelihood,
and a second-order cone program each. Its optimum is also that of a quadratic program: with h such that
``Rᵀ h = ±a``, the point that minimises ``‖R (c − ĉ) + s h‖²`` under the constraints satisfies all conditions
of Karush, Kuhn and Tucker for the cone program but one, that it lies on the sphere, and its distance
‖R (c − ĉ)‖ grows with s. So

1. where the extremal point of the free ball satisfies the constraints, it is the end, in closed form;
2. elsewhere s is found by Newton's method, in closed form on the face that the last point lies on and so
   exact once the face is right; all ends at once, each point certified as the optimum of its program;
3. where aᵀc comes to its least value on the box inside the ball, as a joint to its own bound, that is the
   end.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isfinite
from typing import Final, Literal

import numpy as np
from scipy import linalg

from jointstiff.schemas.joints import JOINT_UNITS, JointKind
from jointstiff.schemas.run import Certificate as StagesCertificate
from jointstiff.schemas.run import ObservabilityIndex
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.method import MethodRows
from jointstiff.solver.fit.observability import (
    Identifiability,
    Observability,
    explain_noise,
    observability_indices,
)
from jointstiff.solver.fit.problem import Bounds, Constraints, IdentificationProblem, Inequalities
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import Certificate, greatest_violations, solve_batch, solve_step
from jointstiff.solver.fit.stages import (
    Fit,
    Likelihood,
    RobustFit,
    Scale,
    SigmaTest,
    sigma_test,
    student_quantile,
)
from jointstiff.solver.fit.statements import FittedStatements
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.text import round_down, stiffness_text

RADIUS_TOLERANCE = 1e-11
"""Largest relative deviation of an interval end's squared distance from ρ² that is rounding."""

MOST_ROUNDS = 100
"""Maximum rounds of the search for an end of an interval."""
_POINT = 1e-9
"""Radius of a ball, relative to the largest, that counts as zero, as for one-sided bounds at 50 %."""
_NO_DIRECTION = 1e-13
"""Relative singular value that counts as zero."""
_AT_BOUND = 1e-9
"""Distance from a joint to its own bound, in units of the ball's radius, that counts as zero."""
_NO_MOVEMENT = 1e-13
"""Movement of joints at active constraints, as a fraction of the movement without constraints: a smaller
movement counts as rounding error."""
_VIOLATION = 1e-9
"""Tolerance of an inequality, in units of the ball's radius."""
_OF_LEVERS = ("force_direction", "load_point")
"""Errors whose effect depends on a joint's lever; the last one has the uncertainty beyond first order."""
_SHORT_LEVER = (
    "the load hangs too near this joint's axis for its uncertain place: hang the load farther away, or read "
    "the hook with the tracker"
)
_NOT_CERTIFIED = "an end of a confidence interval could not be certified"


def compute_interval_ends(
    likelihood: Likelihood,
    constraints: Constraints,
    rows: FloatArray,
    radii: FloatArray,
    estimates: FloatArray,
    *,
    by_profile: bool = True,
) -> FloatArray:
    """Compute confidence intervals of linear functions aᵀc of compliances c: widened profile intervals.

    A profile-likelihood interval uses the constraints on the other joints as information; where joints truly
    are at their bounds, it contains the true value too seldom (86 % instead of 95 % with two rigid joints).
    So the interval is widened to contain the unconstrained interval clipped to the constraints, whose
    coverage is exact, and the estimate, which can lie outside for a method that is not maximum likelihood.

    Args:
        likelihood: likelihood of p compliances.
        constraints: constraints on these p compliances.
        rows: (w, p) functions a, none zero; each determined by the readings.
        radii: (q,) √Δ for each kind of interval: half the width in standard uncertainties, times sigma.
        estimates: (w,) estimates of the functions, in the unit of aᵀc.
        by_profile: whether to include the profile interval; the coverage of the unconstrained interval,
            clipped to the constraints, suffices without the profile interval.

    Returns:
        (q, w, 2) lower and upper ends, in the unit of aᵀc.

    Raises:
        SolverError: if an end could not be certified.
    """
    half_width = radii[:, None] * np.sqrt(((rows @ likelihood.covariance) * rows).sum(axis=1))
    range_on_box = compute_range_on_box(rows, constraints.bounds)
    centre = (rows @ likelihood.centre)[:, None]
    clipped_interval = np.clip(
        centre + np.stack([-half_width, half_width], axis=-1), range_on_box[:, :1], range_on_box[:, 1:]
    )
    profile_interval = (
        compute_profile_ends(likelihood, constraints, rows, radii) if by_profile else clipped_interval
    )
    lower = np.minimum(np.minimum(profile_interval[..., 0], clipped_interval[..., 0]), estimates)
    upper = np.maximum(np.maximum(profile_interval[..., 1], clipped_interval[..., 1]), estimates)
    return np.stack([lower, upper], axis=-1)


def compute_profile_ends(
    likelihood: Likelihood, constraints: Constraints, rows: FloatArray, radii: FloatArray
) -> FloatArray:
    """Compute the ends of the profile-likelihood intervals of linear functions aᵀc of compliances c.

    An end is the least or greatest aᵀc within the constraints and ``‖R (c − ĉ)‖² ≤ min + Δ``, with R the rows
    of the likelihood, ĉ its centre, and min the least value of the left side within the constraints.

    Args:
        likelihood: likelihood of p compliances, with rows R and centre ĉ.
        constraints: constraints on these p compliances.
        rows: (w, p) functions a, none zero; each determined by the readings.
        radii: (q,) √Δ for each kind of interval: half the width in standard uncertainties, times sigma.

    Returns:
        (q, w, 2) lower and upper ends, in the unit of aᵀc.

    Raises:
        SolverError: if an end could not be certified.
    """
    shift = np.zeros(len(likelihood.centre))  # from ĉ to the constrained optimum, argmin ‖R (c − ĉ)‖²
    if not constraints.are_satisfied_by(likelihood.centre):
        ball = _Ball(likelihood, constraints, float(radii.max()))
        shift = ball.find_optimum(np.zeros(len(ball.A)))[0] * ball.unit
    distance = likelihood.rows @ shift
    radius = np.sqrt(radii**2 + distance @ distance)
    signed_radius = radius[:, None, None] * np.array([-1.0, 1.0])  # (q, 1, 2) towards lower and upper ends
    covariance = rows @ likelihood.covariance  # (w, p)
    deviation = np.sqrt((covariance * rows).sum(axis=1))
    ends: FloatArray = (rows @ likelihood.centre)[:, None] + signed_radius * deviation[:, None]
    end_offsets = signed_radius[..., None] * (covariance / deviation[:, None])[:, None]  # (q, w, 2, p)
    # Ends of the unconstrained ball that violate a constraint are replaced by ends on the constrained part.
    violates_constraint = ~constraints.are_satisfied_by(likelihood.centre + end_offsets)
    is_point = radii <= _POINT * radii.max()  # such a ball contains only the constrained optimum
    constrained_optimum = np.clip(
        likelihood.centre + shift, constraints.bounds.lower, constraints.bounds.upper
    )
    ends[is_point], violates_constraint[is_point] = (rows @ constrained_optimum)[:, None], False
    if violates_constraint.any():
        radius_index, function_index, side = np.nonzero(violates_constraint)
        ball = _Ball(likelihood, constraints, float(radius.max()))
        functions = rows[function_index]
        objective = np.where(side == 1, -1.0, 1.0)[:, None] * functions * ball.unit
        objective /= np.linalg.norm(objective, axis=1, keepdims=True)
        scaled_points, at_bound = ball.find_ends(objective, (radius[radius_index] / radius.max()) ** 2)
        range_on_box = compute_range_on_box(functions, constraints.bounds)
        values = functions @ likelihood.centre + (functions * ball.unit * scaled_points).sum(axis=1)
        values = np.clip(values, range_on_box[:, 0], range_on_box[:, 1])
        ends[violates_constraint] = np.where(at_bound, range_on_box[np.arange(len(functions)), side], values)
    return ends


def compute_range_on_box(rows: FloatArray, bounds: Bounds) -> FloatArray:
    """Return the least and greatest values (w, 2) of linear functions (rows (w, p)) within bounds."""
    with np.errstate(invalid="ignore"):
        values_at_bounds = np.stack([rows * bounds.lower, rows * bounds.upper])
    values_at_bounds = np.where(rows == 0.0, 0.0, values_at_bounds)  # zero times an infinite bound is NaN
    return np.stack(
        [values_at_bounds.min(axis=0).sum(axis=1), values_at_bounds.max(axis=0).sum(axis=1)], axis=-1
    )


class _Ball:
    """Likelihood around its centre in equilibrated variables x, as ``‖A x‖²``, with the constraints."""

    def __init__(self, likelihood: Likelihood, constraints: Constraints, scale: float) -> None:
        """Scale likelihood and constraints: ``c = ĉ + unit · x`` and ``‖R (c − ĉ)‖ = scale ‖A x‖``."""
        rows, centre = likelihood.rows, likelihood.centre
        norms = np.linalg.norm(rows, axis=0)
        self.unit: FloatArray = scale / norms
        self.A: FloatArray = rows / norms
        self.gram: FloatArray = self.A.T @ self.A
        bounds = constraints.bounds
        self.bounds = Bounds((bounds.lower - centre) / self.unit, (bounds.upper - centre) / self.unit)
        self.inequalities: Inequalities | None = None
        order = constraints.inequalities
        if order is not None:
            scaled = order.matrix * self.unit
            size = np.linalg.norm(scaled, axis=1)
            self.inequalities = Inequalities(
                scaled / size[:, None], (order.least - order.matrix @ centre) / size
            )

    def find_optimum(self, rhs: FloatArray) -> tuple[FloatArray, BoolArray, FloatArray]:
        """Minimise ‖A x − rhs‖² over x (p,) under the constraints.

        Returns:
            The optimum x (p,), a mask (p,) of the variables that are at a bound, and the rows (t, p) of the
            inequalities that hold with equality.

        Raises:
            SolverError: no certified optimum.
        """
        solution = solve_step(IdentificationProblem(self.A, rhs, self.bounds, self.inequalities))
        tight = np.zeros((0, self.A.shape[1]))
        if self.inequalities is not None and solution.tight is not None:
            tight = self.inequalities.matrix[solution.tight]
            slack = self.inequalities.matrix @ solution.compliance - self.inequalities.least
            # With a very large right-hand side the solver takes a true violation for rounding.
            if (slack < -_VIOLATION).any():
                raise SolverError(_NOT_CERTIFIED)
        return solution.compliance, solution.active != 0, tight

    def find_ends(self, objective: FloatArray, squared_radius: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Minimise K linear objectives over the part of a ball ‖A x‖² ≤ r² that satisfies the constraints.

        For each objective, Newton's method finds the factor s at which the optimum of ``‖A x + s h‖²`` under
        the constraints reaches the sphere, with the preimage h such that Aᵀh is the objective.

        Args:
            objective: (K, p) coefficients of the objectives.
            squared_radius: (K,) squared radii r² of the balls.

        Returns:
            The points (K, p), and a mask (K,) of objectives that reach their least value within the bounds
            inside the ball, so that the sphere is not reached.

        Raises:
            SolverError: a point could not be certified, or was not found in `MOST_ROUNDS` rounds.
        """
        objective_count = len(objective)
        # The matrix H of the docstring
        preimage = np.asarray(np.linalg.lstsq(self.A.T, objective.T, rcond=_NO_DIRECTION)[0].T, np.float64)
        free_slope = np.square(preimage).sum(axis=1)
        factor = np.sqrt(squared_radius / free_slope)
        lower_factor = np.zeros(objective_count)
        upper_factor = np.full(objective_count, np.inf)
        points, at_bound = np.zeros(objective.shape), np.zeros(objective_count, dtype=np.bool_)
        least_in_box = compute_range_on_box(objective, self.bounds)[:, 0]
        pending = np.arange(objective_count)
        for _ in range(MOST_ROUNDS):
            optima, derivative = self.find_optima(factor[pending], objective[pending], preimage[pending])
            squared_norm = np.square(optima @ self.A.T).sum(axis=1)
            norm_slope = (objective[pending] * derivative).sum(axis=1)
            norm_slope = np.where(norm_slope > _NO_MOVEMENT * free_slope[pending], norm_slope, 0.0)
            above_least = (objective[pending] * optima).sum(axis=1) - least_in_box[pending]
            is_least_in_box = above_least <= _AT_BOUND * np.maximum(1.0, np.abs(optima).max(axis=1))
            goal_norm = squared_radius[pending]
            is_inside = is_least_in_box & (squared_norm <= goal_norm * (1 + RADIUS_TOLERANCE))
            is_settled = is_inside | (np.abs(squared_norm - goal_norm) <= RADIUS_TOLERANCE * goal_norm)
            points[pending[is_settled]], at_bound[pending[is_settled]] = (
                optima[is_settled],
                is_inside[is_settled],
            )
            least_factor = lower_factor[pending] = np.where(
                squared_norm < goal_norm, factor[pending], lower_factor[pending]
            )
            most_factor = upper_factor[pending] = np.where(
                squared_norm > goal_norm, factor[pending], upper_factor[pending]
            )
            # Newton's step while the active constraints stay active: ‖A x(s)‖² = on_face + s² slope. Where
            # the step leaves the interval between `least` and `most`, bisection takes over.
            on_face = np.square((optima + factor[pending, None] * derivative) @ self.A.T).sum(axis=1)
            with np.errstate(all="ignore"):
                newton = np.sqrt((goal_norm - on_face) / norm_slope)
            bisection = np.where(
                np.isfinite(most_factor), 0.5 * (least_factor + most_factor), 4.0 * least_factor
            )
            factor[pending] = np.where((newton > least_factor) & (newton < most_factor), newton, bisection)
            pending = pending[~is_settled]
            if not len(pending):
                return points, at_bound
        raise SolverError(_NOT_CERTIFIED)

    def find_optima(
        self, factor: FloatArray, objective: FloatArray, preimage: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Minimise ``‖A x + s h‖²`` over x under the constraints, for K objectives Aᵀh.

        Args:
            factor: (K,) factors s of h.
            objective: (K, p) objectives Aᵀh.
            preimage: (K, m) vectors h.

        Returns:
            The optima x (K, p), and the derivatives −dx/ds (K, p) while the active constraints stay active.
        """
        optima, derivative = np.zeros(objective.shape), np.zeros(objective.shape)
        is_pending = np.ones(len(factor), dtype=np.bool_)  # objectives that are still to be solved one by one
        if self.inequalities is None:
            gram = np.broadcast_to(self.gram, (len(factor), *self.gram.shape))
            batch = solve_batch(gram, -factor[:, None] * objective, self.bounds)
            is_pending = ~batch.certified
            is_settled, is_free = batch.certified, batch.active[batch.certified] == 0
            optima[is_settled] = batch.compliance[is_settled]
            # −dx/ds solves the Gram matrix of the free variables for the objective; fixed variables rest.
            matrices = np.where(is_free[:, :, None] & is_free[:, None, :], self.gram, np.eye(len(self.gram)))
            slopes = np.where(is_free, objective[is_settled], 0.0)[..., None]
            derivative[is_settled] = np.linalg.solve(matrices, slopes)[..., 0]
        for k in np.flatnonzero(is_pending):
            optima[k], at_bound, tight = self.find_optimum(-factor[k] * preimage[k])
            rows = np.vstack([np.eye(len(at_bound))[at_bound], tight])
            free_directions = np.eye(len(at_bound))  # directions in which no active constraint changes
            if len(rows):
                _, singular, Vt = np.linalg.svd(rows, full_matrices=True)
                free_directions = Vt[int((singular > _NO_DIRECTION * singular[0]).sum()) :].T
            if free_directions.shape[1]:
                inverse = np.linalg.pinv(self.A @ free_directions, rcond=_NO_DIRECTION)  # A may lack rank
                derivative[k] = free_directions @ (inverse @ (inverse.T @ (free_directions.T @ objective[k])))
        return optima, derivative


def invert_compliance(compliance: float | None) -> float | None:
    """Return the stiffness 1 / c of a compliance c; None if c is zero or None, or if 1 / c overflows."""
    if not compliance:
        return None
    stiffness = 1.0 / float(compliance)
    return stiffness if isfinite(stiffness) else None


def stiffness_interval(interval: tuple[float, float] | None) -> tuple[float, float | None] | None:
    """Return the interval of the stiffness, (1/c_hi, 1/c_lo), for an interval (c_lo, c_hi) of the compliance.

    The upper end is None where the compliance may be zero. The result is None without an interval, and where
    the compliance may be negative, so that the stiffness has no lower limit.
    """
    if interval is None or interval[0] < 0 or interval[1] <= 0:
        return None
    least = invert_compliance(interval[1])
    return None if least is None else (least, invert_compliance(interval[0]))


@dataclass(frozen=True)
class JointCompliance:
    """Result for one joint; numbers are None if the joint is not observable."""

    name: str
    kind: JointKind  #: revolute or prismatic: decides the units
    #: "uncertain" where the interval contains zero, so that the stiffness has no upper limit
    status: Literal["identified", "uncertain", "at_bound", "not_observable"]
    compliance: float | None = None  #: [rad/(N·m)]
    standard_uncertainty: float | None = None  #: of the compliance, without constraints [rad/(N·m)]
    #: profile-likelihood interval under the constraints [rad/(N·m)]
    compliance_interval: tuple[float, float] | None = None
    #: bounds of the compliance from below and above, each at the full confidence [rad/(N·m)]
    one_sided: tuple[float, float] | None = None
    #: information of the joint's prior over the readings' information; inf where only the prior separates the
    #: joint from other joints, None without a prior
    prior_to_data: float | None = None
    reason: str | None = None  #: why there is no number, or which limit applies to the number
    limit: str = ""  #: text of the lower limit of the stiffness, with which the reason begins; may be empty

    @property
    def stiffness(self) -> float | None:
        """Stiffness [N·m/rad]; None for a rigid joint and where the stiffness overflows."""
        return invert_compliance(self.compliance)

    @property
    def stiffness_interval(self) -> tuple[float, float | None] | None:
        """Interval of the stiffness [N·m/rad], open above (None) where the joint may be rigid."""
        return stiffness_interval(self.compliance_interval)

    @property
    def stiffness_at_least(self) -> float | None:
        """One-sided lower bound of the stiffness [N·m/rad]; None where the compliance may be negative."""
        bounds = stiffness_interval(self.one_sided)
        return None if bounds is None else bounds[0]


@dataclass(frozen=True, eq=False)
class CommonErrors:
    """Effect of errors that all observations share on the estimate, to first order (method.md §8)."""

    #: change (n, k) of the estimate by one standard uncertainty of each error of a source [rad/(N·m)]; at
    #: least one source
    by_source: Mapping[str, FloatArray]
    in_fit: frozenset[str] = frozenset()  #: sources that the fit accounts for, as statements

    @property
    def responses_to_unfitted_errors(self) -> FloatArray:
        """Change (n, K) of the compliances if an error has the size of its standard uncertainty [rad/(N·m)].

        There is a column for each of the K errors that the fit does not estimate.
        """
        not_fitted = [columns for source, columns in self.by_source.items() if source not in self.in_fit]
        # The empty first part gives an (n, 0) result if every source was fitted.
        return np.hstack([self.responses[:, :0], *not_fitted])

    @property
    def responses(self) -> FloatArray:
        """Changes S (n, K) of the estimate by one standard uncertainty of each of K errors, of all sources.

        S Sᵀ is the covariance of the n compliances due to these errors [(rad/(N·m))²].
        """
        return np.hstack(list(self.by_source.values()))

    def responses_to(self, source: str) -> FloatArray:
        """Return the changes (n, k) of the compliances by one standard uncertainty of each error of a source.

        The unit is rad/(N·m); k = 0 for a source without errors.
        """
        return self.by_source.get(source, self.responses[:, :0])


@dataclass(frozen=True)
class ComplementaryStiffness:
    """Effect of the complementary stiffness K_c on a fit."""

    included: bool  #: whether K_c is part of the model
    iterations: int  #: fits until the deflected configurations no longer changed; 0 if K_c is neglected
    largest_ratio: float  #: greatest ``|K_c,ij| c_i`` over the set, over the joints with an estimate
    #: greatest change of a compliance by including K_c, in units of the compliance's standard uncertainty;
    #: None where that is unknown
    largest_shift: float | None
    #: (n,) change of the compliances by including K_c [rad/(N·m)]; None where unknown
    shift: FloatArray | None = None
    obstacle: str | None = None  #: why K_c is neglected although it was requested; None otherwise


@dataclass(frozen=True, eq=False)
class Estimate:
    """Joint compliances with their evidence."""

    joints: tuple[JointCompliance, ...]  #: result for each joint
    #: (n,) the optimum that predictions use [rad/(N·m)]. Entries of joints that are not observable are no
    #: estimates; `joints` withholds them.
    compliance: FloatArray
    #: (n,) compliances that bent the robot in the last fit [rad/(N·m)], nearly `compliance`; given these,
    #: deflections are linear in `compliance`. None without K_c
    balanced: FloatArray | None
    #: (n, n) covariance of the unconstrained estimate [(rad/(N·m))²]; None where sigma is unknown
    covariance: FloatArray | None
    #: standard uncertainty of one coordinate of one reading [m]; None where it was not given and there are
    #: no degrees of freedom to estimate it from
    sigma: float | None
    sigma_given: bool  #: whether sigma was stated with the readings
    chi_square: float  #: chi square of the targets' residuals, under sigma
    degrees_of_freedom: float  #: expectation of chi_square where model and sigma are right
    identifiability: tuple[Identifiability, ...]  #: identifiability of each stage of the method
    certificates: tuple[Certificate, ...]  #: certificates of each stage of the method
    compressed: MethodRows  #: all readings, compressed, in units of sigma
    observability: Observability  #: observability of the joints in the same readings
    characteristic_length: float | None = None  #: [m], where the weighting used one
    complementary_stiffness: ComplementaryStiffness | None = None  #: effect of K_c
    robust: RobustFit | None = None  #: weights of the readings by the Huber loss; None for the squared loss
    #: likelihood of the compliances that the readings see, before any constraint, in units of sigma
    likelihood: Likelihood | None = None
    #: effect of errors that all observations share, part of `covariance`; None without them
    common: CommonErrors | None = None
    #: (n,) standard uncertainties by errors of the load beyond first order, part of `covariance`, for joints
    #: near the line of the load [rad/(N·m)]; None without such joints
    second_order: FloatArray | None = None
    #: why stated errors were propagated after the fit, although they could have been fitted; None otherwise
    statements_dropped: str | None = None

    @property
    def statements(self) -> FittedStatements:
        """Statements that were fitted with the joints, with the values that fit best."""
        return self.compressed.fit_statements(self.compliance)

    def square_second_order(self, is_counted: bool = True) -> FloatArray:
        """Return the covariance (n, n) by errors of the load beyond first order; zero if not counted."""
        n = len(self.joints)
        if self.second_order is None or not is_counted:
            return np.zeros((n, n))
        return np.diag(np.square(self.second_order))

    @property
    def regressor(self) -> FloatArray:
        """Regressor (m, n) of all readings, compressed and weighted by covariance, whatever the method."""
        return self.compressed.all_readings.matrix

    @property
    def estimated(self) -> BoolArray:
        """Table (n,): whether each joint has an estimate."""
        return np.array([joint.compliance is not None for joint in self.joints])

    @property
    def parameters(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def rank(self) -> int:
        """Number of compliances, or combinations of them, that the readings determine in all stages."""
        return sum(stage.rank for stage in self.identifiability)

    @property
    def condition_number(self) -> float:
        """Greatest condition number among the stages of the fit; inf if a stage does not have full rank."""
        return max(stage.condition_number for stage in self.identifiability)

    @property
    def combinations(self) -> list[list[str]]:
        """Groups of joints, by name, whose compliances the readings determine only in combination."""
        joint_groups = [group.joints for stage in self.identifiability for group in stage.combinations]
        return [[self.joints[j].name for j in joints] for joints in joint_groups]

    @property
    def weakest(self) -> list[str]:
        """Sentences on joints that are hard to distinguish: at most one for each stage of the method."""
        names = tuple(joint.name for joint in self.joints)
        return [stage.weakest.in_words(names) for stage in self.identifiability if stage.weakest]

    @property
    def observability_indices(self) -> dict[ObservabilityIndex, float] | None:
        """Observability indices (O1, O2, …) of the regressor's columns of the joints that readings show.

        None if the columns do not have full rank.
        """
        return observability_indices(self.regressor, self.observability)

    @property
    def certificate(self) -> StagesCertificate:
        """Certificate of all stages: the greatest violations over the stages."""
        return greatest_violations(self.certificates)

    @property
    def sigma_source(self) -> Literal["given", "residuals"]:
        """Origin of sigma: stated with the readings, or estimated from the residuals."""
        return "given" if self.sigma_given else "residuals"

    @cached_property
    def sigma_test(self) -> SigmaTest | None:
        """Chi-square test of a stated sigma; None if sigma was not stated, or without degrees of freedom."""
        if not self.sigma_given:
            return None
        from_statements = self.compressed.determined_statement_count
        return sigma_test(self.chi_square, self.degrees_of_freedom, from_statements)


_NO_UNCERTAINTY = (
    "the uncertainty of the stiffness is unknown: sigma is not stated, and there are too few readings to "
    "estimate sigma; state `noise`, or add observations"
)


@dataclass(frozen=True, eq=False)
class LeverProfile:
    """Profile of a joint near the line of the load, with the errors of the load free."""

    #: (2, 2) two-sided interval, then one-sided bounds, of the compliance [rad/(N·m)]; None without an upper
    #: end
    intervals: FloatArray | None = None
    #: half the width of the two-sided profile without constraints over its quantile, and at least that to
    #: first order [rad/(N·m)]; infinite without an upper end
    standard_uncertainty: float = np.inf
    #: whether the fit has the errors of the load as unknowns; the interval of any other fit, which uses the
    #: readings in another way, contains that to first order, too
    replaces_first_order: bool = False

    def join(self, first_order: FloatArray) -> FloatArray | None:
        """Return the intervals (2, 2) of the joint, whose intervals to first order are (2, 2)."""
        if self.intervals is None or self.replaces_first_order:
            return self.intervals
        lower = np.minimum(self.intervals[:, 0], first_order[:, 0])
        upper = np.maximum(self.intervals[:, 1], first_order[:, 1])
        return np.column_stack([lower, upper])


@dataclass(frozen=True, eq=False)
class Evidence:
    """Data on which the verdicts on the joints are based."""

    names: tuple[str, ...]  #: names of the n joints
    fit: Fit  #: outcome of the method
    observability: Observability  #: observability in these readings
    scale: Scale  #: sigma and the residuals under sigma
    constraints: Constraints  #: on the compliances
    confidence: float  #: level of the intervals
    #: (n,) information of each joint's prior over that of the readings; NaN for a joint without a prior, inf
    #: where only the prior separates the joint from other joints
    prior_to_data: FloatArray
    #: profiles of joints near the line of the load
    profiles: Mapping[int, LeverProfile] = field(default_factory=dict)

    def derive_joint_results(self) -> tuple[JointCompliance, ...]:
        """Return the result for each joint: compliance, interval, status and reason.

        Raises:
            SolverError: if the end of an interval could not be certified.
        """
        reasons = [self.explain_missing_stiffness(j) for j in range(len(self.names))]
        determined_joints = np.array([j for j, reason in enumerate(reasons) if reason is None], dtype=np.intp)
        intervals_of_joints: list[FloatArray | None] = [None] * len(determined_joints)
        sigma, likelihood = self.scale.sigma, self.fit.likelihood
        if sigma is not None and len(determined_joints):
            radii = sigma * self.scale.list_quantiles(self.confidence)
            constraints = self.constraints.select(likelihood.joints)
            functions = np.eye(len(likelihood.joints))[np.searchsorted(likelihood.joints, determined_joints)]
            estimates = self.fit.compliance[determined_joints]
            ends = compute_interval_ends(likelihood, constraints, functions, radii, estimates)
            intervals_of_joints = [*ends.transpose(1, 0, 2)]
            for index, j in enumerate(determined_joints.tolist()):
                if j in self.profiles:
                    intervals_of_joints[index] = self.profiles[j].join(ends[:, index])
        joints = [
            JointCompliance(name, kind, "not_observable", reason=reason)
            for name, kind, reason in zip(self.names, self.observability.kinds, reasons, strict=True)
        ]
        for j, intervals in zip(determined_joints.tolist(), intervals_of_joints, strict=True):
            joints[j] = self.derive_joint_result(j, intervals)
        return tuple(joints)

    def derive_joint_result(self, j: int, intervals: FloatArray | None) -> JointCompliance:
        """Return the result for a joint j whose compliance the readings determine.

        Args:
            j: index of the joint.
            intervals: (2, 2) two-sided interval, then one-sided bounds, of the compliance [rad/(N·m)]; None
                where sigma is unknown.
        """
        name = self.names[j]
        value = float(self.fit.compliance[j])
        prior_to_data = float(self.prior_to_data[j])
        kind = self.observability.kinds[j]
        units = JOINT_UNITS[kind]
        uncertainty = self.uncertainty(j)
        status: Literal["identified", "uncertain", "at_bound"] = "identified"
        reason = self.describe_active_constraint(j, intervals)
        if reason is not None:
            status = "at_bound"
        elif intervals is None:
            reason = _NO_UNCERTAINTY
        elif uncertainty is not None and intervals[0, 0] <= 0.0 <= intervals[0, 1]:
            status = "uncertain"
            consequence = (
                "exceeds the compliance itself"
                if uncertainty >= abs(value)
                else "leaves the stiffness without an upper limit"
            )
            reason = (
                f"{self.describe_lower_limit(j, intervals)}the standard uncertainty of the joint's "
                f"compliance, {1e6 * uncertainty:.2g} {units.micro_compliance}, {consequence}: add "
                f"loads with more {units.load} {name}"
            )
        reasons = [] if reason is None else [reason]
        if np.isinf(prior_to_data):
            reasons.append(
                f"the readings show {name} only in combination with other joints: only the prior separates "
                f"{name} from these joints"
            )
        two_sided, one_sided = (None, None) if intervals is None else intervals.tolist()
        return JointCompliance(
            name,
            kind,
            status,
            value,
            uncertainty,
            None if two_sided is None else (two_sided[0], two_sided[1]),
            None if one_sided is None else (one_sided[0], one_sided[1]),
            None if np.isnan(prior_to_data) else prior_to_data,
            "; ".join(reasons) or None,
            self.describe_lower_limit(j, intervals),
        )

    def uncertainty(self, j: int) -> float | None:
        """Return the standard uncertainty of joint j's compliance, without constraints [rad/(N·m)].

        None if sigma is unknown; infinite where a load point that is elsewhere explains any compliance.
        """
        if j in self.profiles:
            return self.profiles[j].standard_uncertainty
        return self.compute_first_order_uncertainty(j)

    def compute_first_order_uncertainty(self, j: int) -> float | None:
        """Return joint j's standard uncertainty with errors of the load to first order [rad/(N·m)].

        None if sigma is unknown.
        """
        sigma = self.scale.sigma
        return None if sigma is None else sigma * float(np.sqrt(self.fit.covariance[j, j]))

    def describe_active_constraint(self, j: int, intervals: FloatArray | None) -> str | None:
        """Return a sentence on the active constraint of joint j; None if no constraint is active.

        Exactly equal compliances are tied by the order, as noise never makes compliances equal. An order
        through a joint that the readings do not see ties the joints before and after that joint.
        """
        compliance, active = self.fit.compliance, int(self.fit.active[j])
        if active and compliance[j] == 0.0:
            limit = self.describe_lower_limit(j, intervals) or "the estimated compliance is zero: "
            return f"{limit}these readings cannot distinguish the joint from a rigid joint"
        if self.fit.tied[j] or active:
            visible = np.flatnonzero(~self.observability.null)
            pairs = [
                visible[[first, second]].tolist() for first, second in self.constraints.select(visible).order
            ]
            tied_joints = [
                first + second - j
                for first, second in pairs
                if j in (first, second) and compliance[first] == compliance[second]
            ]
            if tied_joints:
                partners = ", ".join(self.names[second] for second in tied_joints)
                return f"`stiffness_order` makes the stiffness of this joint equal to that of {partners}"
        if active:
            return (
                f"the joint is at the {'maximum' if active < 0 else 'minimum'} stiffness of "
                "`stiffness_bounds`"
            )
        return None

    def describe_lower_limit(self, j: int, intervals: FloatArray | None) -> str:
        """Return the text of the lower limit of joint j's stiffness; empty if the stiffness has no limit.

        `intervals` (2, 2) has the two-sided interval, then the one-sided bounds, of its compliance
        [rad/(N·m)]; None if sigma is unknown.
        """
        if intervals is None or intervals[1, 1] <= 0.0:
            return ""
        stiffness = stiffness_text(round_down(1.0 / float(intervals[1, 1])), self.observability.kinds[j])
        return f"stiffer than {stiffness} at {100 * self.confidence:g} %: "

    def explain_missing_stiffness(self, j: int) -> str | None:
        """Return the reason why joint j has no stiffness; None if joint j has a stiffness."""
        observability = self.observability
        if observability.null[j]:
            if np.isnan(self.prior_to_data[j]):
                return observability.reasons[j]
            return (
                f"{observability.reasons[j]}; the prior is not returned as a result, because the readings "
                "do not determine the joint"
            )
        for group in self.fit.undetermined:
            if j in group.joints:
                return group.reason(self.names)
        uncertainty = self.compute_first_order_uncertainty(j)
        most = float(observability.reference_compliance[j])
        if uncertainty is not None and uncertainty > most:
            return explain_noise(j, self.names, observability, uncertainty)
        if j in self.profiles and self.profiles[j].standard_uncertainty > most:
            return _SHORT_LEVER
        return None

    def compute_extra_uncertainties(self) -> FloatArray:
        """Return by how much profiles enlarge the standard uncertainties (n,), as a further error would.

        A profile without an upper end does not count, as its joint has no number.
        """
        extra = np.zeros(len(self.names))
        for j, profile in self.profiles.items():
            if profile.intervals is not None:
                first_order = self.compute_first_order_uncertainty(j) or 0.0
                extra[j] = np.sqrt(profile.standard_uncertainty**2 - first_order**2)
        return extra

    def list_open_joints(self) -> IndexArray:
        """Return the joints whose compliance has no upper end, ascending."""
        return np.array(
            [j for j in sorted(self.profiles) if self.profiles[j].intervals is None], dtype=np.intp
        )


_LEAST_POSTURES: Final = 2
"""Number of postures, beyond the number of joints, needed to separate model error from noise."""
_NO_UPPER_END = (
    "the stiffness of this joint has no upper limit if single postures are left out: something besides the "
    "joints bends"
)


@dataclass(frozen=True, eq=False)
class Spread:
    """Uncertainty of all n compliances; leading dimensions of the covariance stack several uncertainties."""

    covariance: FloatArray  #: (..., n, n) [(rad/(N·m))²]

    @property
    def uncertainty(self) -> FloatArray:
        """Return the standard uncertainty (..., n) of each compliance [rad/(N·m)]."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=-2, axis2=-1), 0.0))

    @property
    def correlation(self) -> FloatArray:
        """Return the correlation (..., n, n) between the joints; zero where an uncertainty is zero."""
        uncertainty = self.uncertainty
        inverse_uncertainty = np.divide(
            1.0, uncertainty, out=np.zeros_like(uncertainty), where=uncertainty > 0.0
        )
        scales = inverse_uncertainty[..., None] * inverse_uncertainty[..., None, :]
        return np.asarray(np.clip(self.covariance * scales, -1.0, 1.0))


@dataclass(frozen=True, eq=False)
class BudgetComponent(Spread):
    """Part of the uncertainty of all compliances that one source causes."""

    #: `readings`, the name of a term whose uncertainty is stated or assumed, `model_error` or
    #: `complementary_stiffness`
    source: str
    #: GUM type: "A" by statistics from these readings, "B" by other means, such as a stated uncertainty
    evaluation: Literal["A", "B"]
    included: bool  #: whether it is part of the standard uncertainty of the joints
    degrees_of_freedom: float | None = None  #: of a type A evaluation; None for infinite
    #: (n, 3) changes of the compliances by one standard uncertainty of the load point along each axis of the
    #: flange [rad/(N·m)]; None for another source
    responses: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class PostureJackknife:
    """Estimates that each leave out one posture (jackknife)."""

    compliance: FloatArray  #: (P, n) without each posture in turn [rad/(N·m)]; NaN where undetermined
    postures: int  #: number of postures that were measured, P or more


@dataclass(frozen=True, eq=False)
class UncertaintyBudget:
    """Components of the uncertainty of a run's compliances."""

    joints: IndexArray  #: (p,) joints that have an estimate
    #: covariances of the included components add up to the covariance of the estimate
    components: tuple[BudgetComponent, ...]
    probability: float  #: coverage probability of the expanded uncertainties
    #: normal, or Student's where sigma comes from the residuals or the model error is included
    coverage_factor: float

    @classmethod
    def from_estimate(
        cls,
        estimate: Estimate,
        probability: float,
        jackknife: PostureJackknife | None = None,
        *,
        lack_of_fit: bool = False,
    ) -> UncertaintyBudget | None:
        """Return the uncertainty budget of an estimate; None if the uncertainty of the readings is unknown.

        Args:
            estimate: estimate of n compliances.
            probability: coverage probability.
            jackknife: estimates without single postures, from which the model error is estimated; None to
                leave the model error out.
            lack_of_fit: whether a model of joints alone does not fit: the standard uncertainty then includes
                the model error.
        """
        if estimate.covariance is None:
            return None
        common_errors = estimate.common
        sigma_given = estimate.sigma_given
        readings_covariance = estimate.covariance
        if common_errors is not None:
            readings_covariance = readings_covariance - common_errors.responses @ common_errors.responses.T
            readings_covariance = readings_covariance - estimate.square_second_order()
        degrees_of_freedom = None if sigma_given else estimate.degrees_of_freedom
        components = [
            BudgetComponent(
                readings_covariance, "readings", "B" if sigma_given else "A", True, degrees_of_freedom
            )
        ]
        if common_errors is not None:
            of_levers = [each for each in common_errors.by_source if each.endswith(_OF_LEVERS)]
            components += [
                BudgetComponent(
                    responses @ responses.T + estimate.square_second_order(source in of_levers[-1:]),
                    source,
                    "A" if source == "fitted_causes" else "B",
                    True,
                    responses=responses if source.endswith("load_point") else None,
                )
                for source, responses in common_errors.by_source.items()
                if responses.any()
            ]
        estimated_joints = np.flatnonzero(estimate.estimated)
        if jackknife is not None:
            components += _estimate_model_error(
                jackknife, readings_covariance, estimated_joints, included=lack_of_fit
            )
        neglected = estimate.complementary_stiffness
        if neglected is not None and not neglected.included and neglected.shift is not None:
            shift = np.outer(neglected.shift, neglected.shift)
            components.append(BudgetComponent(shift, "complementary_stiffness", "B", False))
        coverage_factor = max(
            student_quantile(0.5 * (1.0 + probability), component.degrees_of_freedom)
            for component in components
            if component.source == "readings" or (component.source == "model_error" and component.included)
        )
        return cls(estimated_joints, tuple(components), probability, coverage_factor)

    def total(self, *, all_components: bool = False) -> Spread:
        """Return the sum of the components that the standard uncertainty includes.

        `all_components` adds the components that the standard uncertainty leaves out, too.
        """
        covariances = [each.covariance for each in self.components if each.included or all_components]
        return Spread(np.sum(covariances, axis=0))

    @property
    def spread(self) -> Spread:
        """Stack of uncertainties: the components, the sum of the included components, and the sum of all."""
        rows = [*self.components, self.total(), self.total(all_components=True)]
        return Spread(np.stack([row.covariance for row in rows]))

    def widen_intervals(self, estimate: Estimate, bounds: Bounds) -> Estimate:
        """Return the estimate with intervals widened to contain compliance ± expanded uncertainty.

        Args:
            estimate: of n joints, from which the budget was made.
            bounds: on the compliances; widening does not pass a bound.
        """
        joints = list(estimate.joints)
        uncertainty = self.total().uncertainty
        for j in self.joints.tolist():
            joint = joints[j]
            interval = joint.compliance_interval
            one_sided = joint.one_sided
            value = joint.compliance
            if interval is None or one_sided is None or value is None:
                continue
            half = self.coverage_factor * float(uncertainty[j])
            least = max(float(bounds.lower[j]), value - half)
            most = min(float(bounds.upper[j]), value + half)
            interval = min(interval[0], least), max(interval[1], most)
            is_uncertain = joint.status == "identified" and interval[0] <= 0.0
            joints[j] = replace(
                joint,
                status="uncertain" if is_uncertain else joint.status,
                standard_uncertainty=float(uncertainty[j]),
                compliance_interval=interval,
                one_sided=(min(one_sided[0], least), max(one_sided[1], most)),
                reason="; ".join(filter(None, [joint.reason, _NO_UPPER_END if is_uncertain else None]))
                or None,
            )
        return replace(estimate, joints=tuple(joints))


def _estimate_model_error(
    jackknife: PostureJackknife, readings_covariance: FloatArray, joints: IndexArray, *, included: bool
) -> list[BudgetComponent]:
    """Return the component of the model error as a list of one entry; an empty list for too few postures.

    The covariance of the jackknife contains noise and model error. In units of the noise, the eigenvalues for
    noise alone are 1 on average and at most ``(1 + √(p/P))²``, with p joints and P postures (Marchenko &
    Pastur, 1967). Only larger eigenvalues count as model error, less the 1 that noise explains.
    """
    compliances = jackknife.compliance[:, joints]
    compliances = compliances[np.isfinite(compliances).all(axis=1)]
    fit_count, joint_count = compliances.shape
    if fit_count < joint_count + _LEAST_POSTURES:
        return []
    deviations = compliances - compliances.mean(axis=0)
    jackknife_covariance = (jackknife.postures - 1.0) / fit_count * deviations.T @ deviations
    noise_covariance = readings_covariance[np.ix_(joints, joints)]
    if not (np.isfinite(jackknife_covariance).all() and np.isfinite(noise_covariance).all()):
        return []
    try:
        values, vectors = linalg.eigh(jackknife_covariance, noise_covariance)
    except np.linalg.LinAlgError:  # readings without noise: a ratio to the noise does not exist
        return []
    noise_limit = (1.0 + np.sqrt(joint_count / fit_count)) ** 2
    covariance_root = noise_covariance @ vectors * np.sqrt(np.where(values > noise_limit, values - 1.0, 0.0))
    covariance = np.zeros_like(readings_covariance)
    covariance[np.ix_(joints, joints)] = covariance_root @ covariance_root.T
    return [BudgetComponent(covariance, "model_error", "A", included, fit_count - 1.0)]


@dataclass(frozen=True, eq=False)
class Contributions:
    """Parts of n joints in the predicted deflection, each projected on that deflection.

    Joint j alone moves a target by ``A_X,j c_j``; its part is ``A_X,j c_j · δp̂ / ‖δp̂‖``, and the parts of all
    joints add up to ‖δp̂‖. A joint without an estimate counts as rigid.
    """

    by_observation: FloatArray  #: (n, N) mean over the targets of each observation [m]
    mean: FloatArray  #: (n,) mean over all readings [m]
    #: (n,) share of the mean length of the predicted deflections, dimensionless; zero if nothing moves
    share: FloatArray


@dataclass(frozen=True, eq=False)
class Prediction:
    """Deflections of N observations of T targets, axes of R0 [m]."""

    predicted: FloatArray  #: (N, T, 3) predicted by the joint compliances
    residual: FloatArray  #: (N, T, 3) measured minus predicted; zero where a target was not read
    compensation: float | None  #: ``1 − mean‖residual‖ / mean‖δp‖``; None where nothing moved
    rms_residual: float  #: root mean square of ‖residual‖ [m]
    contributions: Contributions | None = None  #: of the joints; None where links or the base bend, too
    #: what bends in addition to the joints; None for nothing
    bending: Literal["links", "base", "links_or_base"] | None = None
    #: for `links_or_base`: what bends in the model of the predictions
    predicted_by: Literal["links", "base"] = "base"
    joined: bool = True  #: for `links_or_base`: whether the intervals contain the values of both models
    #: (N, n) deflections ``δθ = diag(τ) c`` of the joints behind their gearboxes [rad]; None where links or
    #: the base bend, too
    encoders: FloatArray | None = None

    @classmethod
    def from_predicted(
        cls, measurements: Measurements, predicted: FloatArray, contributions: Contributions | None = None
    ) -> Prediction:
        """Return the prediction of deflections (N, T, 3) [m] with residuals and compensation."""
        residual = np.where(measurements.present[..., None], measurements.deflection - predicted, 0.0)
        residual_length = np.linalg.norm(residual[measurements.present], axis=-1)
        mean_deflection = np.linalg.norm(measurements.deflection[measurements.present], axis=-1).mean()
        return cls(
            predicted=predicted,
            residual=residual,
            compensation=float(1.0 - residual_length.mean() / mean_deflection)
            if mean_deflection > 0
            else None,
            rms_residual=float(np.sqrt(np.mean(residual_length**2))),
            contributions=contributions,
        )


def predict(
    rows: Rows,
    compliance: FloatArray,
    *,
    is_estimated: BoolArray | None = None,
    statements: FittedStatements | None = None,
) -> Prediction:
    """Predict the deflections of the targets, ``δp_X = A_X c`` (method.md §2).

    Args:
        rows: N observations. Where the loads are in balance with compliances, the predicted deflections equal
            the exact balance to third order; else this bending is neglected.
        compliance: (n,) compliances c [rad/(N·m)].
        is_estimated: (n,) mask of joints with an estimate; all if None. Other joints have zero contributions.
        statements: errors of the load and of places that were fitted with the joints; their motion is part
            of the predicted deflections. None for loads and places as stated.

    Returns:
        Predicted deflections and residuals, with the contribution of each joint.

    Raises:
        SolverError: the load has no balance with joints of the given compliances.
    """
    contributing = compliance if is_estimated is None else np.where(is_estimated, compliance, 0.0)
    measurements, errors = rows.measurements, statements or FittedStatements.none(rows.robot.n)
    predicted, projected, encoder_deflections = [], [], []
    for of_errors in errors.statements.generate(rows, whitened=False):
        block = of_errors.block
        motion, turn = errors.predict(of_errors)
        predicted.append(block.A @ compliance + motion)
        encoder_deflections.append(block.torque * compliance + (0.0 if turn is None else turn))
        by_joint = block.A * contributing
        deflection = by_joint.sum(axis=-1)
        length = np.linalg.norm(deflection, axis=-1)
        direction = deflection / np.where(length > 0.0, length, 1.0)[..., None]
        projected.append(np.einsum("btij,bti->btj", by_joint, direction))
    # Contributions (N, T, n) of the joints; zero for targets that were not read.
    by_reading, present = np.concatenate(projected), measurements.present
    mean_by_joint = by_reading.sum(axis=(0, 1)) / present.sum()
    total = float(mean_by_joint.sum())
    contributions = Contributions(
        by_observation=(by_reading.sum(axis=1) / present.sum(axis=1)[:, None]).T,
        mean=mean_by_joint,
        share=mean_by_joint / total if total > 0.0 else np.zeros_like(mean_by_joint),
    )
    prediction = Prediction.from_predicted(measurements, np.concatenate(predicted), contributions)
    return replace(prediction, encoders=np.concatenate(encoder_deflections))
