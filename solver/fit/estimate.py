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

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isfinite
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy import linalg

from jointstiff.schemas.joints import IDENTIFIED, JOINT_UNITS, JointKind
from jointstiff.schemas.run import Certificate as StagesCertificate
from jointstiff.schemas.run import ObservabilityIndex
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.cone import Scalars
from jointstiff.solver.fit.constraints import Bounds, Constraints, Inequalities
from jointstiff.solver.fit.method import MethodRows
from jointstiff.solver.fit.observability import (
    Identifiability,
    Observability,
    explain_noise,
    observability_indices,
)
from jointstiff.solver.fit.prior import Prior
from jointstiff.solver.fit.problem import Certificate, LeastSquares, Problem
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import greatest_violations, solve, solve_batch
from jointstiff.solver.fit.stages import (
    Likelihood,
    MethodFit,
    RobustFit,
    Scale,
    SigmaTest,
    sigma_test,
    student_quantile,
)
from jointstiff.solver.fit.statements import FittedStatements
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.text import lower_limit_texts

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
    functions: FloatArray,
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
        functions: (w, p) coefficients a of each function, none zero; each determined by the readings.
        radii: (q,) half-widths of q kinds of interval, in standard uncertainties, times sigma.
        estimates: (w,) estimates of the functions, in the unit of aᵀc.
        by_profile: whether to include the profile interval; the coverage of the unconstrained interval,
            clipped to the constraints, suffices without the profile interval.

    Returns:
        (q, w, 2) lower and upper ends, in the unit of aᵀc.

    Raises:
        SolverError: if an end could not be certified.
    """
    variances = ((functions @ likelihood.covariance) * functions).sum(axis=1)  # (w,) aᵀ C a
    half_widths = radii[:, None] * np.sqrt(variances)  # (q, w)
    centres = functions @ likelihood.centre
    least, greatest = compute_range_on_box(functions, constraints.bounds).T
    lower = np.minimum(np.clip(centres - half_widths, least, greatest), estimates)
    upper = np.maximum(np.clip(centres + half_widths, least, greatest), estimates)
    if by_profile:
        profile_ends = compute_profile_ends(likelihood, constraints, functions, radii)
        lower = np.minimum(lower, profile_ends[..., 0])
        upper = np.maximum(upper, profile_ends[..., 1])
    return np.stack([lower, upper], axis=-1)


def compute_profile_ends(
    likelihood: Likelihood, constraints: Constraints, functions: FloatArray, radii: FloatArray
) -> FloatArray:
    """Compute the ends of the profile-likelihood intervals of linear functions aᵀc of compliances c.

    An end is the least or greatest aᵀc within the constraints and the ball ``‖R (c − ĉ)‖² ≤ min + Δ``, with R
    the rows of the likelihood, ĉ its centre, and min the least value of the left side within the constraints.

    Args:
        likelihood: likelihood of p compliances, with rows R and centre ĉ.
        constraints: constraints on these p compliances.
        functions: (w, p) coefficients a of each function, none zero; each determined by the readings.
        radii: (q,) √Δ for each kind of interval: half the width in standard uncertainties, times sigma.

    Returns:
        (q, w, 2) lower and upper ends, in the unit of aᵀc.

    Raises:
        SolverError: if an end could not be certified.
    """
    centre = likelihood.centre
    offset = _find_offset_of_optimum(likelihood, constraints, float(radii.max()))
    residual_at_optimum = likelihood.rows @ offset  # R (c − ĉ), of squared length min
    ball_radii = np.sqrt(radii**2 + residual_at_optimum @ residual_at_optimum)
    # The ends of a ball without constraints are at ĉ ± radius · C a / √(aᵀ C a), with C the covariance.
    C_a = functions @ likelihood.covariance  # (w, p)
    deviations = np.sqrt((C_a * functions).sum(axis=1))
    directions = C_a / deviations[:, None]
    signed_radii = ball_radii[:, None, None] * np.array([-1.0, 1.0])  # (q, 1, 2) to lower and upper ends
    ends: FloatArray = (functions @ centre)[:, None] + signed_radii * deviations[:, None]
    end_points = centre + signed_radii[..., None] * directions[:, None]  # (q, w, 2, p)
    violates_constraints = ~constraints.are_satisfied_by(end_points)
    # A ball of radius zero contains the constrained optimum only.
    is_point = radii <= _POINT * radii.max()
    optimum = np.clip(centre + offset, constraints.bounds.lower, constraints.bounds.upper)
    ends[is_point] = (functions @ optimum)[:, None]
    violates_constraints[is_point] = False
    if violates_constraints.any():
        # Find the ends of the constrained part of the ball instead.
        ball = _Ball(likelihood, constraints, float(ball_radii.max()))
        kind, function, side = np.nonzero(violates_constraints)
        constrained_ends = ball.compute_ends(functions[function], ball_radii[kind], is_upper=side == 1)
        ends[violates_constraints] = constrained_ends
    return ends


def _find_offset_of_optimum(likelihood: Likelihood, constraints: Constraints, scale: float) -> FloatArray:
    """Return the offset (p,) from the centre ĉ to the c within the constraints with the least ‖R (c − ĉ)‖.

    The rows R and the centre are those of the likelihood; `scale` is a typical ‖R (c − ĉ)‖.
    """
    if constraints.are_satisfied_by(likelihood.centre):
        return np.zeros(len(likelihood.centre))
    ball = _Ball(likelihood, constraints, scale)
    optimum = ball.find_optimum(np.zeros(len(ball.A)))
    return optimum.point * ball.unit


def compute_range_on_box(functions: FloatArray, bounds: Bounds) -> FloatArray:
    """Return the least and greatest values (w, 2) of linear functions aᵀc, with a (w, p), within bounds.

    The greatest value of a sum is the sum of the greatest values of its terms a_j c_j, and so the least.
    """
    with np.errstate(invalid="ignore"):  # zero times an infinite bound is NaN, replaced by zero below
        at_lower, at_upper = functions * bounds.lower, functions * bounds.upper
    is_unused = functions == 0.0
    at_lower[is_unused] = 0.0
    at_upper[is_unused] = 0.0
    least = np.minimum(at_lower, at_upper).sum(axis=1)
    greatest = np.maximum(at_lower, at_upper).sum(axis=1)
    return np.column_stack([least, greatest])


class _BallOptimum(NamedTuple):
    """Point of a `_Ball` that is optimal under the constraints, with its active constraints."""

    point: FloatArray  # (p,) optimum x
    at_bound: BoolArray  # (p,) mask of the variables that are at a bound
    tight_rows: FloatArray  # (t, p) rows of the inequalities that hold with equality


class _EndPoints(NamedTuple):
    """Points of balls at which K linear objectives are least under the constraints."""

    points: FloatArray  # (K, p)
    is_inside_ball: BoolArray  # (K,) whether the objective is least within the bounds there, without the ball


class _Ball:
    """Ball ``‖R (c − ĉ)‖ ≤ radius`` around the centre ĉ of a likelihood, in scaled variables x.

    Attributes:
        unit: (p,) units of the variables: ``c = ĉ + unit · x``.
        A: (m, p) rows with columns of unit length: ``‖R (c − ĉ)‖ = scale ‖A x‖``.
        bounds: bounds of x.
        inequalities: inequalities between the variables x; None without any.
    """

    def __init__(self, likelihood: Likelihood, constraints: Constraints, scale: float) -> None:
        """Write the likelihood's rows R and the constraints in variables x, with ``c = ĉ + unit · x``.

        Args:
            likelihood: likelihood of p compliances, with rows R and centre ĉ.
            constraints: constraints on these p compliances.
            scale: radius of the greatest ball; ``‖R (c − ĉ)‖ = scale ‖A x‖``.
        """
        rows, centre, bounds = likelihood.rows, likelihood.centre, constraints.bounds
        column_lengths = np.linalg.norm(rows, axis=0)
        self._likelihood, self._constraints, self._scale = likelihood, constraints, scale
        self.unit: FloatArray = scale / column_lengths
        self.A: FloatArray = rows / column_lengths
        self.gram: FloatArray = self.A.T @ self.A
        self.bounds = Bounds((bounds.lower - centre) / self.unit, (bounds.upper - centre) / self.unit)
        self.inequalities: Inequalities | None = None
        if constraints.inequalities is not None:
            matrix, least = constraints.inequalities.matrix, constraints.inequalities.least
            scaled_matrix = matrix * self.unit
            row_lengths = np.linalg.norm(scaled_matrix, axis=1)
            least_in_x = least - matrix @ centre
            self.inequalities = Inequalities(scaled_matrix / row_lengths[:, None], least_in_x / row_lengths)

    def compute_ends(self, functions: FloatArray, radii: FloatArray, is_upper: BoolArray) -> FloatArray:
        """Return the least or greatest values (K,) of functions aᵀc within balls and the constraints.

        The search is in scaled variables x, with c = ĉ + unit · x and ĉ the centre of the balls.

        Args:
            functions: (K, p) coefficients a of each function.
            radii: (K,) radii of the balls ``‖R (c − ĉ)‖ ≤ radius``, at most the scale.
            is_upper: (K,) whether the greatest value is computed, not the least.

        Raises:
            SolverError: an end could not be certified.
        """
        signs = np.where(is_upper, -1.0, 1.0)  # a greatest value is the least value of the negative function
        objective = signs[:, None] * functions * self.unit
        objective /= np.linalg.norm(objective, axis=1, keepdims=True)
        ends = self._minimise_in_ball(objective, (radii / self._scale) ** 2)
        values = functions @ self._likelihood.centre + (functions * self.unit * ends.points).sum(axis=1)
        # Where the ball contains the extreme value of the box, that value is exact.
        least, greatest = compute_range_on_box(functions, self._constraints.bounds).T
        on_sphere = np.clip(values, least, greatest)
        on_box = np.where(is_upper, greatest, least)
        return np.asarray(np.where(ends.is_inside_ball, on_box, on_sphere))

    def find_optimum(self, rhs: FloatArray) -> _BallOptimum:
        """Minimise ‖A x − rhs‖² over x (p,) under the constraints, for a right-hand side (m,).

        Raises:
            SolverError: no certified optimum.
        """
        cone = Scalars(self.bounds, self.inequalities)
        solution = solve(Problem(LeastSquares(self.A, rhs), cone), witnessed=False)
        x = solution.x
        tight_rows = np.zeros((0, len(x)))
        if self.inequalities is not None and solution.tight is not None:
            tight_rows = self.inequalities.matrix[solution.tight]
            slack = self.inequalities.matrix @ x - self.inequalities.least
            # With a very large right-hand side the solver takes a true violation for rounding.
            if (slack < -_VIOLATION).any():
                raise SolverError(_NOT_CERTIFIED)
        return _BallOptimum(x, solution.active != 0, tight_rows)

    def _minimise_in_ball(self, objective: FloatArray, squared_radius: FloatArray) -> _EndPoints:
        """Minimise K linear objectives over the part of a ball ‖A x‖² ≤ r² that satisfies the constraints.

        For each objective aᵀx, Newton's method finds the factor s ≥ 0 at which the optimum x(s) of
        ``‖A x + s h‖²`` under the constraints is on the sphere ‖A x‖ = r, with h such that Aᵀh = a. ‖A x(s)‖
        grows with s, so each s that was tried limits the s that is searched. The search ends inside the ball
        if the objective has its least value within the bounds there.

        Args:
            objective: (K, p) coefficients a of the objectives.
            squared_radius: (K,) squared radii r² of the balls.

        Raises:
            SolverError: a point could not be certified, or was not found in `MOST_ROUNDS` rounds.
        """
        solution, *_ = np.linalg.lstsq(self.A.T, objective.T, rcond=_NO_DIRECTION)
        h = np.asarray(solution.T, np.float64)  # (K, m)
        squared_h = np.square(h).sum(axis=1)
        s = np.sqrt(squared_radius / squared_h)
        least_s, greatest_s = np.zeros(len(s)), np.full(len(s), np.inf)
        points, ends_inside_ball = np.zeros(objective.shape), np.zeros(len(s), dtype=np.bool_)
        pending = np.arange(len(s))  # objectives whose end is not found yet
        for _ in range(MOST_ROUNDS):
            x, derivative = self.find_optima(s[pending], objective[pending], h[pending])
            goal, squared_norm = squared_radius[pending], np.square(x @ self.A.T).sum(axis=1)
            is_in_ball = squared_norm <= goal * (1 + RADIUS_TOLERANCE)
            is_end_inside = is_in_ball & self._attains_least_in_box(objective[pending], x)
            is_on_sphere = np.abs(squared_norm - goal) <= RADIUS_TOLERANCE * goal
            is_found = is_end_inside | is_on_sphere
            points[pending[is_found]] = x[is_found]
            ends_inside_ball[pending[is_found]] = is_end_inside[is_found]
            # An s that led to a point inside the ball is too small, one that led outside is too great.
            too_small, too_great = pending[squared_norm < goal], pending[squared_norm > goal]
            least_s[too_small] = s[too_small]
            greatest_s[too_great] = s[too_great]
            slope = (objective[pending] * derivative).sum(axis=1)
            slope = np.where(slope > _NO_MOVEMENT * squared_h[pending], slope, 0.0)
            proposed_s = self._take_newton_step(s[pending], x, derivative, slope, goal)
            s[pending] = _bisect_unless_between(proposed_s, least_s[pending], greatest_s[pending])
            pending = pending[~is_found]
            if not len(pending):
                return _EndPoints(points, ends_inside_ball)
        raise SolverError(_NOT_CERTIFIED)

    def _take_newton_step(
        self, s: FloatArray, x: FloatArray, derivative: FloatArray, slope: FloatArray, goal: FloatArray
    ) -> FloatArray:
        """Return the factors s (K,) at which ‖A x(s)‖² is the goal (K,) if active constraints stay active.

        The optimum x(s) then moves along a line, so that ``‖A x(s)‖² = rest + s² slope``. The result is inf
        or NaN where no s attains the goal.

        Args:
            s: (K,) last factors.
            x: (K, p) optima x(s).
            derivative: (K, p) −dx/ds.
            slope: (K,) slopes.
            goal: (K,) values of ‖A x(s)‖² that are to be attained.
        """
        x_at_zero = x + s[:, None] * derivative
        rest = np.square(x_at_zero @ self.A.T).sum(axis=1)
        with np.errstate(all="ignore"):
            return np.asarray(np.sqrt((goal - rest) / slope))

    def _attains_least_in_box(self, objective: FloatArray, x: FloatArray) -> BoolArray:
        """Return the mask (K,) of points x (K, p) at which an objective (K, p) is least within the bounds."""
        least = compute_range_on_box(objective, self.bounds)[:, 0]
        excess = (objective * x).sum(axis=1) - least
        return np.asarray(excess <= _AT_BOUND * np.maximum(1.0, np.abs(x).max(axis=1)))

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
        optima, derivatives = np.zeros(objective.shape), np.zeros(objective.shape)
        is_solved = np.zeros(len(factor), dtype=np.bool_)
        if self.inequalities is None:  # bounds only: all objectives at once
            gram = np.broadcast_to(self.gram, (len(factor), *self.gram.shape))
            batch = solve_batch(gram, -factor[:, None] * objective, self.bounds)
            is_solved = batch.certified
            optima[is_solved] = batch.compliance[is_solved]
            is_free = batch.active[is_solved] == 0
            derivatives[is_solved] = self._differentiate_free_variables(objective[is_solved], is_free)
        for k in np.flatnonzero(~is_solved):
            optimum = self.find_optimum(-factor[k] * preimage[k])
            optima[k] = optimum.point
            derivatives[k] = self._differentiate_optimum(objective[k], optimum)
        return optima, derivatives

    def _differentiate_free_variables(self, objective: FloatArray, is_free: BoolArray) -> FloatArray:
        """Return the derivatives −dx/ds (K, p) of optima of ``‖A x + s h‖²`` with some variables at bounds.

        The derivative y of the free variables f solves ``(AᵀA)_ff y = (Aᵀh)_f``; the others do not move.

        Args:
            objective: (K, p) objectives Aᵀh.
            is_free: (K, p) mask of the variables that are not at a bound.
        """
        both_free = is_free[:, :, None] & is_free[:, None, :]
        # An identity for the fixed variables keeps all K matrices of one size.
        matrices = np.where(both_free, self.gram, np.eye(len(self.gram)))
        moments = np.where(is_free, objective, 0.0)
        return np.asarray(np.linalg.solve(matrices, moments[..., None])[..., 0])

    def _differentiate_optimum(self, objective: FloatArray, optimum: _BallOptimum) -> FloatArray:
        """Return the derivative −dx/ds (p,) of an optimum of ``‖A x + s h‖²`` with active constraints.

        With a basis Z of the directions in which no active constraint changes, the derivative is Z y, and y
        the shortest solution of ``(A Z)ᵀ(A Z) y = Zᵀ Aᵀh``; A may lack rank.

        Args:
            objective: (p,) objective Aᵀh.
            optimum: optimum with its active constraints.
        """
        identity = np.eye(len(objective))
        active_rows = np.vstack([identity[optimum.at_bound], optimum.tight_rows])
        Z = identity
        if len(active_rows):
            _, singular_values, Vt = np.linalg.svd(active_rows, full_matrices=True)
            rank = int((singular_values > _NO_DIRECTION * singular_values[0]).sum())
            Z = Vt[rank:].T
        if not Z.shape[1]:
            return np.zeros(len(objective))
        inverse = np.linalg.pinv(self.A @ Z, rcond=_NO_DIRECTION)
        return np.asarray(Z @ (inverse @ (inverse.T @ (Z.T @ objective))))


def _bisect_unless_between(proposed: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return proposed values (K,); the middle of an interval (K,) where a value is not inside the interval.

    An interval without an upper end is left upwards, to four times its lower end.
    """
    is_between = (proposed > lower) & (proposed < upper)
    middle = np.where(np.isfinite(upper), 0.5 * (lower + upper), 4.0 * lower)
    return np.where(is_between, proposed, middle)


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
    if interval is None:
        return None
    least_compliance, greatest_compliance = interval
    if least_compliance < 0 or greatest_compliance <= 0:
        return None
    least_stiffness = invert_compliance(greatest_compliance)
    if least_stiffness is None:
        return None
    return least_stiffness, invert_compliance(least_compliance)


class JointPrior(NamedTuple):
    """Prior of a joint, and the joint's compliance by the readings alone."""

    mean: float  #: of the prior [rad/(N·m)]
    standard_uncertainty: float  #: of the prior [rad/(N·m)]
    by_readings: float  #: compliance of the fit without priors [rad/(N·m)]


CARRIES: Final = 0.05
"""Fraction of the deflection from which on a joint matters: it must be known, and gets advice."""


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
    #: the joint's prior and the readings; None without a prior, or where only the prior separates the joint
    prior: JointPrior | None = None
    reason: str | None = None  #: why there is no number, or which limit applies to the number
    limit: str = ""  #: text of the lower limit of the stiffness, with which the reason begins; may be empty
    own_compliance: float | None = None  #: with bending links, of the joint without its link [rad/(N·m)]

    @property
    def reason_without_limit(self) -> str | None:
        """Reason without the words on the lower limit of the stiffness."""
        return None if self.reason is None else self.reason.removeprefix(self.limit)

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
        """Changes (n, K) of the n compliances by one standard uncertainty of each of K errors [rad/(N·m)].

        The K errors are those that the fit does not estimate; K may be zero.
        """
        return self.responses_to_others(self.in_fit)

    def responses_to_others(self, sources: Collection[str]) -> FloatArray:
        """Return the changes (n, K) by one standard uncertainty of each of the K errors of all other sources.

        The unit is rad/(N·m); K may be zero.
        """
        of_others = [columns for source, columns in self.by_source.items() if source not in sources]
        no_columns = self.responses[:, :0]  # `hstack` needs at least one array
        return np.hstack([no_columns, *of_others])

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
        no_columns = self.responses[:, :0]
        return self.by_source.get(source, no_columns)


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

    def with_residuals_of(self, tested: Scale) -> Estimate:
        """Return the estimate with the χ² and the degrees of freedom of another fit to the same readings.

        Args:
            tested: residuals of a fit without errors that are only assumed: they test the stated sigma.
        """
        return replace(self, chi_square=tested.chi_square, degrees_of_freedom=tested.degrees_of_freedom)

    def square_second_order(self) -> FloatArray:
        """Return the covariance (n, n) of the compliances by errors of the load beyond first order.

        The unit is (rad/(N·m))². The covariance is zero without such errors.
        """
        n = len(self.joints)
        return np.zeros((n, n)) if self.second_order is None else np.diag(np.square(self.second_order))

    @property
    def regressor(self) -> FloatArray:
        """Regressor (m, n) of all readings, compressed and weighted by covariance, whatever the method."""
        return self.compressed.all_readings.matrix

    @property
    def greatest_shares(self) -> FloatArray:
        """Fraction (n,) of the deflection that each joint may carry; NaN for a joint without an interval.

        ``‖R_j‖ c_j / ‖z‖``, with R the rows, z the readings, and c_j the upper end of the interval: a joint
        that seems rigid may still carry what its interval allows.
        """
        intervals = [joint.compliance_interval or (np.nan, np.nan) for joint in self.joints]
        upper = np.array(intervals)[:, 1]
        size_of_readings = max(float(np.linalg.norm(self.compressed.all_readings.rhs)), np.finfo(float).tiny)
        return np.asarray(np.linalg.norm(self.regressor, axis=0) * upper / size_of_readings)

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
        groups = [group for stage in self.identifiability for group in stage.combinations]
        return [[self.joints[j].name for j in group.joints] for group in groups]

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
        return sigma_test(
            self.chi_square,
            self.degrees_of_freedom,
            from_stated_errors=self.compressed.determined_statement_count,
        )


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
        """Return the joint's confidence intervals (2, 2): those of this profile, widened to contain others.

        The profile's intervals are not widened where they replace the others. None without an upper end.

        Args:
            first_order: (2, 2) ends of the two-sided interval, then of the one-sided bounds, with
                the load's errors to first order [rad/(N·m)].
        """
        if self.intervals is None or self.replaces_first_order:
            return self.intervals
        lower = np.minimum(self.intervals[:, 0], first_order[:, 0])
        upper = np.maximum(self.intervals[:, 1], first_order[:, 1])
        return np.column_stack([lower, upper])


@dataclass(frozen=True, eq=False)
class Evidence:
    """Data on which the verdicts on the joints are based."""

    names: tuple[str, ...]  #: names of the n joints
    fit: MethodFit  #: outcome of the method
    observability: Observability  #: observability in these readings
    scale: Scale  #: sigma and the residuals under sigma
    constraints: Constraints  #: on the compliances
    confidence: float  #: level of the intervals
    #: (n,) information of each joint's prior over that of the readings; NaN for a joint without a prior, inf
    #: where only the prior separates the joint from other joints
    prior_to_data: FloatArray
    prior: Prior | None = None  #: of the n joints
    #: profiles of joints near the line of the load
    profiles: Mapping[int, LeverProfile] = field(default_factory=dict)

    def derive_joint_results(self) -> tuple[JointCompliance, ...]:
        """Return the result for each joint: compliance, interval, status and reason.

        Raises:
            SolverError: if the end of an interval could not be certified.
        """
        reasons = [self.explain_missing_stiffness(j) for j in range(len(self.names))]
        determined_joints = [j for j, reason in enumerate(reasons) if reason is None]
        intervals = self._compute_intervals(determined_joints)
        limits = self._describe_lower_limits(intervals)
        results = []
        for j, why_missing in enumerate(reasons):
            if why_missing is None:
                results.append(self.derive_joint_result(j, intervals.get(j), limits.get(j, "")))
            else:
                kind = self.observability.kinds[j]
                results.append(JointCompliance(self.names[j], kind, "not_observable", reason=why_missing))
        return tuple(results)

    def _compute_intervals(self, joints: list[int]) -> dict[int, FloatArray | None]:
        """Return for each joint the two-sided interval and the one-sided bounds (2, 2) of its compliance.

        The unit is rad/(N·m). The result is empty where sigma is unknown.

        Args:
            joints: indices of the joints whose compliances the readings determine.

        Raises:
            SolverError: if the end of an interval could not be certified.
        """
        sigma, likelihood = self.scale.sigma, self.fit.likelihood
        if sigma is None or not joints:
            return {}
        # The compliance of a joint is the linear function aᵀc with a 1 at the joint's place.
        functions = np.eye(len(likelihood.joints))[np.searchsorted(likelihood.joints, joints)]
        ends = compute_interval_ends(
            likelihood,
            self.constraints.select(likelihood.joints),
            functions,
            radii=sigma * self.scale.list_quantiles(self.confidence),
            estimates=self.fit.compliance[joints],
        )  # (2, number of joints, 2)
        intervals: dict[int, FloatArray | None] = {}
        for index, j in enumerate(joints):
            intervals[j] = ends[:, index]
            # To first order the interval of a joint near the line of the load is too short.
            if j in self.profiles:
                intervals[j] = self.profiles[j].join(ends[:, index])
        return intervals

    def derive_joint_result(self, j: int, intervals: FloatArray | None, limit: str) -> JointCompliance:
        """Return the result for a joint j whose compliance the readings determine.

        A joint at a constraint is "at_bound", a joint whose compliance may be zero "uncertain". The reason
        names the constraint, why there is no interval, or what leaves the stiffness without an upper limit.

        Args:
            j: index of the joint.
            intervals: (2, 2) two-sided interval, then one-sided bounds, of the compliance [rad/(N·m)]; None
                where sigma is unknown.
            limit: text of the lower limit of the stiffness; empty if there is none.
        """
        prior_to_data = float(self.prior_to_data[j])
        status, reason = self._judge(j, intervals, limit)
        reasons = [] if reason is None else [reason]
        if np.isinf(prior_to_data):
            reasons.append(
                f"the readings show {self.names[j]} only in combination with other joints: only the prior "
                f"separates {self.names[j]} from these joints"
            )
        compliance_interval, one_sided = None, None
        if intervals is not None:
            (lower, upper), (lower_bound, upper_bound) = intervals.tolist()
            compliance_interval, one_sided = (lower, upper), (lower_bound, upper_bound)
        return JointCompliance(
            name=self.names[j],
            kind=self.observability.kinds[j],
            status=status,
            compliance=float(self.fit.compliance[j]),
            standard_uncertainty=self.uncertainty(j),
            compliance_interval=compliance_interval,
            one_sided=one_sided,
            prior_to_data=None if np.isnan(prior_to_data) else prior_to_data,
            prior=self._compare_with_prior(j) if np.isfinite(prior_to_data) else None,
            reason="; ".join(reasons) or None,
            limit=limit,
        )

    def _compare_with_prior(self, j: int) -> JointPrior | None:
        """Return the prior of joint j with the compliance by the readings alone; None without a prior."""
        if self.prior is None or self.fit.without_prior is None:
            return None
        return JointPrior(
            mean=float(self.prior.mean[j]),
            standard_uncertainty=float(self.prior.standard_uncertainty[j]),
            by_readings=float(self.fit.without_prior.compliance[j]),
        )

    def _judge(
        self, j: int, intervals: FloatArray | None, limit: str
    ) -> tuple[Literal["identified", "uncertain", "at_bound"], str | None]:
        """Return the status of joint j, and the reason for it, if there is one.

        Args:
            j: index of the joint.
            intervals: (2, 2) two-sided interval, then one-sided bounds, of the compliance [rad/(N·m)]; None
                where sigma is unknown.
            limit: text of the lower limit of the stiffness; empty if there is none.
        """
        constraint = self.describe_active_constraint(j, limit)
        if constraint is not None:
            return "at_bound", constraint
        if intervals is None:
            return "identified", _NO_UNCERTAINTY
        uncertainty, (lower, upper) = self.uncertainty(j), intervals[0].tolist()
        if uncertainty is not None and lower <= 0.0 <= upper:
            return "uncertain", self._explain_interval_with_zero(j, limit, uncertainty)
        if lower > 0.0 and upper > IDENTIFIED * lower:
            load = JOINT_UNITS[self.observability.kinds[j]].load
            return "uncertain", (
                f"the ends of the interval are a factor of {upper / lower:.2g} apart: add loads with more "
                f"{load} {self.names[j]}"
            )
        return "identified", None

    def _explain_interval_with_zero(self, j: int, limit: str, uncertainty: float) -> str:
        """Return the sentence for a joint j whose compliance may be zero, after the text of its lower limit.

        The standard uncertainty of the compliance is in rad/(N·m).
        """
        units = JOINT_UNITS[self.observability.kinds[j]]
        consequence = "leaves the stiffness without an upper limit"
        if uncertainty >= abs(self.fit.compliance[j]):
            consequence = "exceeds the compliance itself"
        return (
            f"{limit}the standard uncertainty of the joint's "
            f"compliance, {1e6 * uncertainty:.2g} {units.micro_compliance}, {consequence}: add "
            f"loads with more {units.load} {self.names[j]}"
        )

    def uncertainty(self, j: int) -> float | None:
        """Return the standard uncertainty of joint j's compliance, without constraints [rad/(N·m)].

        None if sigma is unknown; infinite for a joint near the line of the load, where an error of the load
        point can explain any compliance.
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

    def describe_active_constraint(self, j: int, limit: str) -> str | None:
        """Return a sentence on the constraint that limits the compliance of joint j; None without one.

        Args:
            j: index of the joint.
            limit: text of the lower limit of the joint's stiffness; empty if there is none.
        """
        at_least_compliance, at_greatest_compliance = self.fit.active[j] == -1, self.fit.active[j] == 1
        is_at_bound = at_least_compliance or at_greatest_compliance
        if is_at_bound and self.fit.compliance[j] == 0.0:
            beginning = limit or "the estimated compliance is zero: "
            return f"{beginning}these readings cannot distinguish the joint from a rigid joint"
        if is_at_bound or self.fit.tied[j]:
            tied_names = ", ".join(self.names[other] for other in self._list_tied_joints(j))
            if tied_names:
                return f"`stiffness_order` makes the stiffness of this joint equal to that of {tied_names}"
        if at_least_compliance:
            return "the joint is at the maximum stiffness of `stiffness_bounds`"
        if at_greatest_compliance:
            return "the joint is at the minimum stiffness of `stiffness_bounds`"
        return None

    def _list_tied_joints(self, j: int) -> list[int]:
        """Return the other joints whose compliance the stiffness order makes equal to that of joint j.

        Compliances are exactly equal only if the order ties them, as noise never makes them equal. A joint
        that the readings do not show is left out: the order then ties the joints before and after it.
        """
        compliance = self.fit.compliance
        shown = np.flatnonzero(~self.observability.null)
        tied = []
        for pair in self.constraints.select(shown).order:
            first, second = shown[list(pair)].tolist()
            if j in (first, second) and compliance[first] == compliance[second]:
                tied.append(second if first == j else first)
        return tied

    def _describe_lower_limits(self, intervals: Mapping[int, FloatArray | None]) -> dict[int, str]:
        """Return the text of the lower limit of the stiffness of each joint that has such a limit.

        Args:
            intervals: (2, 2) two-sided interval, then one-sided bounds, of each joint's compliance
                [rad/(N·m)]; None where a joint has none.
        """
        joints, compliances = list[int](), list[float]()
        for j, intervals_of_joint in intervals.items():
            if intervals_of_joint is None:
                continue
            _two_sided, one_sided_bounds = intervals_of_joint
            greatest_compliance = float(one_sided_bounds[1])
            if greatest_compliance > 0.0:
                joints.append(j)
                compliances.append(greatest_compliance)
        kinds = [self.observability.kinds[j] for j in joints]
        return dict(zip(joints, lower_limit_texts(compliances, kinds, self.confidence), strict=True))

    def explain_missing_stiffness(self, j: int) -> str | None:
        """Return the reason why joint j has no stiffness; None if joint j has a stiffness.

        It has none if the readings do not show it, show it only in combination with other joints, or leave
        its compliance more uncertain than the compliance that would cause all of the measured deflections.
        """
        if self.observability.null[j]:
            return self._explain_no_effect(j)
        for group in self.fit.undetermined:
            if j in group.joints:
                return group.reason(self.names)
        greatest_uncertainty = float(self.observability.reference_compliance[j])
        uncertainty = self.compute_first_order_uncertainty(j)
        if uncertainty is not None and uncertainty > greatest_uncertainty:
            return explain_noise(j, self.names, self.observability, uncertainty)
        if j in self.profiles and self.profiles[j].standard_uncertainty > greatest_uncertainty:
            return _SHORT_LEVER
        return None

    def _explain_no_effect(self, j: int) -> str | None:
        """Return why the readings do not show joint j, and that its prior, if it has one, is no result."""
        reason, has_prior = self.observability.reasons[j], not np.isnan(self.prior_to_data[j])
        if not has_prior:
            return reason
        return (
            f"{reason}; the prior is not returned as a result, because the readings "
            "do not determine the joint"
        )

    def compute_extra_uncertainties(self) -> FloatArray:
        """Return the uncertainties (n,) that the load's errors beyond first order add to joints [rad/(N·m)].

        Added in squares to the uncertainty to first order, such an uncertainty gives that of the joint's
        profile. It is zero for a joint without a profile, or whose profile has no upper end.
        """
        extra = np.zeros(len(self.names))
        for j, profile in self.profiles.items():
            if profile.intervals is not None:
                first_order = self.compute_first_order_uncertainty(j) or 0.0
                extra[j] = np.sqrt(profile.standard_uncertainty**2 - first_order**2)
        return extra

    def list_open_joints(self) -> IndexArray:
        """Return the joints whose compliance interval has no upper end, ascending."""
        open_joints = [j for j, profile in self.profiles.items() if profile.intervals is None]
        return np.array(sorted(open_joints), dtype=np.intp)


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
        inverse = np.zeros_like(uncertainty)
        np.divide(1.0, uncertainty, out=inverse, where=uncertainty > 0.0)
        correlation = self.covariance * (inverse[..., :, None] * inverse[..., None, :])
        return np.asarray(np.clip(correlation, -1.0, 1.0))


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
        joints = np.flatnonzero(estimate.estimated)
        readings = _compute_part_of_readings(estimate, estimate.covariance)
        components = [readings]
        if estimate.common is not None:
            components += _list_parts_of_common_errors(estimate, estimate.common)
        if jackknife is not None:
            components += _estimate_model_error(jackknife, readings.covariance, joints, included=lack_of_fit)
        if estimate.complementary_stiffness is not None:
            components += _list_effect_of_neglected_stiffness(estimate.complementary_stiffness)
        coverage_factor = _find_coverage_factor(components, probability)
        return cls(joints, tuple(components), probability, coverage_factor)

    def total(self, *, all_components: bool = False) -> Spread:
        """Return the sum of the components that the standard uncertainty includes, or of all components."""
        covariances = [each.covariance for each in self.components if each.included or all_components]
        return Spread(np.sum(covariances, axis=0))

    def widen_intervals(self, estimate: Estimate, bounds: Bounds) -> Estimate:
        """Return the estimate with intervals widened to contain compliance ± expanded uncertainty.

        Args:
            estimate: of n joints, from which the budget was made.
            bounds: on the compliances; widening does not pass a bound.
        """
        joints = list(estimate.joints)
        uncertainty = self.total().uncertainty
        for j in self.joints.tolist():
            compliance = joints[j].compliance
            if compliance is not None:
                expanded_uncertainty = self.coverage_factor * float(uncertainty[j])
                least = max(float(bounds.lower[j]), compliance - expanded_uncertainty)
                greatest = min(float(bounds.upper[j]), compliance + expanded_uncertainty)
                joints[j] = _widen_intervals_of_joint(joints[j], float(uncertainty[j]), least, greatest)
        return replace(estimate, joints=tuple(joints))


def _widen_intervals_of_joint(
    joint: JointCompliance, standard_uncertainty: float, least: float, greatest: float
) -> JointCompliance:
    """Return the result of a joint with another standard uncertainty, and intervals that contain two values.

    A joint without intervals stays as it is. A joint whose compliance may be zero by the wider interval is
    not identified any more, but uncertain.

    Args:
        joint: result of the joint.
        standard_uncertainty: of the compliance [rad/(N·m)].
        least: value that the intervals contain [rad/(N·m)].
        greatest: value that the intervals contain [rad/(N·m)].
    """
    if joint.compliance_interval is None or joint.one_sided is None:
        return joint
    lower, upper = _widen(joint.compliance_interval, least, greatest)
    widened = replace(
        joint,
        standard_uncertainty=standard_uncertainty,
        compliance_interval=(lower, upper),
        one_sided=_widen(joint.one_sided, least, greatest),
    )
    if joint.status == "identified" and lower <= 0.0:
        reason = f"{joint.reason}; {_NO_UPPER_END}" if joint.reason else _NO_UPPER_END
        return replace(widened, status="uncertain", reason=reason)
    return widened


def _widen(interval: tuple[float, float], least: float, greatest: float) -> tuple[float, float]:
    """Return the interval, widened to contain two numbers."""
    lower, upper = interval
    return min(lower, least), max(upper, greatest)


def _list_effect_of_neglected_stiffness(effect: ComplementaryStiffness) -> list[BudgetComponent]:
    """Return a component for the bias by neglecting K_c, in a list; an empty list without a known bias.

    The component is shown only: a bias is no part of the standard uncertainty.
    """
    if effect.included or effect.shift is None:
        return []
    squared_shift = np.outer(effect.shift, effect.shift)
    return [BudgetComponent(squared_shift, "complementary_stiffness", "B", included=False)]


def _find_coverage_factor(components: list[BudgetComponent], probability: float) -> float:
    """Return the factor from a standard to an expanded uncertainty of a coverage probability, two-sided.

    The factor is the quantile of the component with the fewest degrees of freedom among those that were
    estimated from residuals or postures: Student's distribution instead of the normal one. The other
    components were stated.
    """
    quantiles = []
    for component in components:
        if component.included and component.source in ("readings", "model_error"):
            quantile = student_quantile(0.5 * (1.0 + probability), component.degrees_of_freedom)
            quantiles.append(quantile)
    return max(quantiles)


def _compute_part_of_readings(estimate: Estimate, covariance: FloatArray) -> BudgetComponent:
    """Return the part of an estimate's covariance (n, n) that is due to the noise of the readings.

    Errors that all observations share, such as those of the load point, are subtracted.
    """
    if estimate.common is not None:
        covariance = covariance - estimate.common.responses @ estimate.common.responses.T
        covariance = covariance - estimate.square_second_order()
    if estimate.sigma_given:
        return BudgetComponent(covariance, "readings", "B", included=True)
    return BudgetComponent(covariance, "readings", "A", True, estimate.degrees_of_freedom)


def _list_parts_of_common_errors(estimate: Estimate, common_errors: CommonErrors) -> list[BudgetComponent]:
    """Return a component of the uncertainty for each source of errors that all observations share.

    A source that changes no compliance has no component. The uncertainty beyond first order belongs to the
    last source whose effect depends on a joint's lever: the load point, or else the direction of the force.
    """
    sources = common_errors.by_source
    lever_sources = [source for source in sources if source.endswith(_OF_LEVERS)]
    last_lever_source = lever_sources[-1] if lever_sources else None
    components = []
    for source, responses in sources.items():
        if not responses.any():
            continue
        covariance = responses @ responses.T
        if source == last_lever_source:
            covariance = covariance + estimate.square_second_order()
        components.append(_build_component_of_common_error(source, covariance, responses))
    return components


def _build_component_of_common_error(
    source: str, covariance: FloatArray, responses: FloatArray
) -> BudgetComponent:
    """Return the component of one source of errors that all observations share.

    Args:
        source: name of the source; "fitted_causes" alone was estimated from readings.
        covariance: (n, n) covariance of the compliances by the source [(rad/(N·m))²].
        responses: (n, k) changes of the compliances by one standard uncertainty of k errors; kept for the
            load point, whose errors have a place.
    """
    return BudgetComponent(
        covariance,
        source,
        evaluation="A" if source == "fitted_causes" else "B",
        included=True,
        responses=responses if source.endswith("load_point") else None,
    )


def _estimate_model_error(
    jackknife: PostureJackknife, readings_covariance: FloatArray, joints: IndexArray, *, included: bool
) -> list[BudgetComponent]:
    """Return the component of the model error as a list of one entry; an empty list for too few postures.

    The covariance of the jackknife contains noise and model error. In units of the noise, the eigenvalues for
    noise alone are 1 on average and at most ``(1 + √(p/P))²``, with p joints and P postures (Marchenko &
    Pastur, 1967). Only larger eigenvalues count as model error, less the 1 that noise explains. The list is
    empty, too, where a covariance is not finite or the readings have no noise to compare with.

    Args:
        jackknife: estimates that each leave out one posture.
        readings_covariance: (n, n) covariance of the compliances by the noise of the readings.
        joints: (p,) joints that have an estimate.
        included: whether the standard uncertainty of the joints includes the model error.
    """
    compliances = jackknife.compliance[:, joints]
    compliances = compliances[np.isfinite(compliances).all(axis=1)]
    P, p = compliances.shape
    if p + _LEAST_POSTURES > P:
        return []
    deviations = compliances - compliances.mean(axis=0)
    # The jackknife multiplies the mean square of the deviations by the number of postures less one.
    jackknife_covariance = (jackknife.postures - 1.0) / P * deviations.T @ deviations
    noise_covariance = readings_covariance[np.ix_(joints, joints)]
    root = _find_root_beyond_noise(jackknife_covariance, noise_covariance, P)
    if root is None:
        return []
    covariance = np.zeros_like(readings_covariance)
    covariance[np.ix_(joints, joints)] = root @ root.T
    return [
        BudgetComponent(
            covariance, source="model_error", evaluation="A", included=included, degrees_of_freedom=P - 1.0
        )
    ]


def _find_root_beyond_noise(
    jackknife_covariance: FloatArray, noise_covariance: FloatArray, P: int
) -> FloatArray | None:
    """Return a root (p, p) of the part of the jackknife's covariance that noise does not explain.

    None where a covariance is not finite, or that of the noise is singular.

    Args:
        jackknife_covariance: (p, p) covariance of the compliances by noise and model error.
        noise_covariance: (p, p) covariance of the compliances by the noise of the readings.
        P: number of postures.
    """
    is_finite = np.isfinite(jackknife_covariance).all() and np.isfinite(noise_covariance).all()
    if not is_finite:
        return None
    try:
        # Eigenvectors V are scaled such that Vᵀ noise_covariance V = I.
        eigenvalues, vectors = linalg.eigh(jackknife_covariance, noise_covariance)
    except np.linalg.LinAlgError:  # the covariance of the noise is singular
        return None
    greatest_of_noise = (1.0 + np.sqrt(len(eigenvalues) / P)) ** 2
    model_eigenvalues = np.where(eigenvalues > greatest_of_noise, eigenvalues - 1.0, 0.0)
    return np.asarray(noise_covariance @ vectors * np.sqrt(model_eigenvalues))


@dataclass(frozen=True, eq=False)
class Contributions:
    """Parts of n joints in the predicted deflection, each projected on that deflection.

    Joint j alone moves a target by ``A_X,j c_j``; its part is ``A_X,j c_j · δp̂ / ‖δp̂‖``, and the parts of
    all joints add up to ‖δp̂‖. A joint without an estimate counts as rigid.
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
        is_read = measurements.present
        residual = np.where(is_read[..., None], measurements.deflection - predicted, 0.0)
        residual_lengths = np.linalg.norm(residual[is_read], axis=-1)
        mean_deflection = np.linalg.norm(measurements.deflection[is_read], axis=-1).mean()
        compensation = None
        if mean_deflection > 0:
            compensation = float(1.0 - residual_lengths.mean() / mean_deflection)
        return cls(
            predicted=predicted,
            residual=residual,
            compensation=compensation,
            rms_residual=float(np.sqrt(np.mean(residual_lengths**2))),
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
        is_estimated: (n,) mask of joints with an estimate; all if None. Other joints are part of the
            prediction, but their contributions are zero.
        statements: errors of the load and of places that were fitted with the joints; their motion is part
            of the predicted deflections. None for loads and places as stated.

    Returns:
        Predicted deflections and residuals, with the contribution of each joint.

    Raises:
        SolverError: the load has no balance with joints of the given compliances.
    """
    contributing = compliance if is_estimated is None else np.where(is_estimated, compliance, 0.0)
    errors = statements or FittedStatements.none(rows.robot.n)
    predicted, encoder_deflections, contributions_of_blocks = [], [], []
    for block_rows in errors.statements.generate(rows, whitened=False):  # B observations each
        A, torque = block_rows.block.A, block_rows.block.torque  # (B, T, 3, n), (B, n)
        motion_by_errors, turn_by_errors = errors.compute_motion(block_rows)
        predicted.append(A @ compliance + motion_by_errors)
        joint_deflection = torque * compliance
        if turn_by_errors is not None:
            joint_deflection = joint_deflection + turn_by_errors
        encoder_deflections.append(joint_deflection)
        motion_by_joint = A * contributing  # (B, T, 3, n)
        contributions_of_blocks.append(_project_on_sum(motion_by_joint))
    measurements = rows.measurements
    contributions = _average_contributions(np.concatenate(contributions_of_blocks), measurements.present)
    prediction = Prediction.from_predicted(measurements, np.concatenate(predicted), contributions)
    return replace(prediction, encoders=np.concatenate(encoder_deflections))


def _project_on_sum(by_joint: FloatArray) -> FloatArray:
    """Project the motion by each joint on the motion by all joints together.

    Args:
        by_joint: (B, T, 3, n) motion of each target by each of n joints.

    Returns:
        (B, T, n) signed lengths of the projections; zero where the joints together move nothing.
    """
    total = by_joint.sum(axis=-1)  # (B, T, 3)
    length = np.linalg.norm(total, axis=-1)
    direction = total / np.where(length > 0.0, length, 1.0)[..., None]
    return np.asarray(np.einsum("btij,bti->btj", by_joint, direction))  # sums over the coordinates i


def _average_contributions(by_reading: FloatArray, present: BoolArray) -> Contributions:
    """Average the contributions (N, T, n) of n joints [m] over the targets, and over all readings.

    Args:
        by_reading: contributions to each reading; zero where a target was not read.
        present: (N, T) mask of the targets that were read.
    """
    mean = by_reading.sum(axis=(0, 1)) / present.sum()
    total = float(mean.sum())
    by_observation = by_reading.sum(axis=1) / present.sum(axis=1)[:, None]
    return Contributions(
        by_observation=by_observation.T,
        mean=mean,
        share=mean / total if total > 0.0 else np.zeros_like(mean),
    )
