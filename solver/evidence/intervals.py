"""Intervals of the compliances: profiles of the likelihood under constraints (method.md §6).

The ends of an interval are the least and the greatest aᵀc, a = e_j for a joint, on the part of the ball
``‖R (c − ĉ)‖² ≤ ρ²`` that the constraints leave, ``ρ² = min ‖R (c − ĉ)‖² + Δ``: a second-order cone
program each. Its optimum is also that of a quadratic program: with h such that ``Rᵀ h = ±a``, the point
that minimises ``‖R (c − ĉ) + s h‖²`` under the constraints satisfies all conditions of Karush, Kuhn and
Tucker for the cone program but one, that it lies on the sphere, and its distance ‖R (c − ĉ)‖ grows with s.
So

1. where the extremal point of the free ball satisfies the constraints, it is the end, in closed form;
2. elsewhere s is found by Newton's method, in closed form on the face that the last point lies on and so
   exact once the face is right; all ends at once, each point certified as the optimum of its program;
3. where aᵀc comes to its least value on the box inside the ball, as a joint to its own bound, that is the
   end.
"""

from __future__ import annotations

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.solution import (
    Bounds,
    Constraints,
    IdentificationProblem,
    Inequalities,
    solve_batch,
    solve_step,
)
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fitting.fit import Likelihood

RADIUS_TOLERANCE = 1e-11
"""Largest relative deviation of an end's squared distance from ρ² that counts as rounding."""

MOST_ROUNDS = 100
"""Maximum rounds of the search for an end of an interval."""
_POINT = 1e-9
"""Relative radius of a ball that counts as a point, as of one-sided bounds at 50 %."""
_NO_DIRECTION = 1e-13
_AT_BOUND = 1e-9
"""Distance from its own bound, in units of the ball's radius, at which a joint counts as at it."""
_STANDS_STILL = 1e-13
"""Movement of a joint on a face, relative to that without constraints, that counts as rounding."""
_VIOLATION = 1e-9
"""Tolerance of an inequality, in units of the ball's radius."""
_NOT_CERTIFIED = "an end of a confidence interval could not be certified"


def interval_ends(
    likelihood: Likelihood, constraints: Constraints, wanted: IndexArray, radii: FloatArray, value: FloatArray
) -> FloatArray:
    """Return the ends of the intervals of some compliances: profiles, widened to cover what they should.

    A profile-likelihood interval takes the constraints on the other joints for information, and where they
    truly are at their bounds it covers too little: 86 % instead of 95 % were seen beside two rigid joints.
    So it is widened to contain what the constraints leave of the unconstrained interval, whose coverage is
    exact wherever the truth lies; that is where the profile ends anyway if no constraint matters. It is
    widened, too, to contain the estimate: that of a method that is not maximum likelihood, such as the
    decoupled one, may lie outside its own interval under constraints.

    Args:
        likelihood: of p compliances.
        constraints: on the same p.
        wanted: (w,) which of the p; each determined by the readings.
        radii: (q,) √Δ in units of ‖R c‖, one for each kind of interval.
        value: (w,) the estimate [rad/(N·m)].

    Returns:
        (q, w, 2) lower and upper ends [rad/(N·m)].

    Raises:
        SolverError: if an end could not be certified.
    """
    ends = profile_ends(likelihood, constraints, np.eye(len(likelihood.centre))[wanted], radii)
    bounds = constraints.bounds.select(wanted)
    held = np.clip(likelihood.interval(wanted, radii), bounds.lower[:, None], bounds.upper[:, None])
    lower = np.minimum(np.minimum(ends[..., 0], held[..., 0]), value)
    upper = np.maximum(np.maximum(ends[..., 1], held[..., 1]), value)
    return np.stack([lower, upper], axis=-1)


def profile_ends(
    likelihood: Likelihood, constraints: Constraints, rows: FloatArray, radii: FloatArray
) -> FloatArray:
    """Return the ends of the profile-likelihood intervals of linear functions aᵀc.

    Args:
        likelihood: of p compliances.
        constraints: on the same p.
        rows: (w, p) functions a, none zero; each determined by the readings.
        radii: (q,) √Δ in units of ‖R c‖, one for each kind of interval.

    Returns:
        (q, w, 2) lower and upper ends, in the unit of aᵀc.

    Raises:
        SolverError: if an end could not be certified.
    """
    move = np.zeros(len(likelihood.centre))  # to the constrained optimum, argmin ‖R (c − ĉ)‖²
    if not constraints.hold(likelihood.centre):
        ball = _Ball(likelihood, constraints, float(radii.max()))
        move = ball.optimum(np.zeros(len(ball.A)))[0] * ball.unit
    distance = likelihood.rows @ move
    radius = np.sqrt(radii**2 + distance @ distance)
    signed = radius[:, None, None] * np.array([-1.0, 1.0])
    covariance = rows @ likelihood.covariance  # (w, p)
    deviation = np.sqrt((covariance * rows).sum(axis=1))
    ends: FloatArray = (rows @ likelihood.centre)[:, None] + signed * deviation[:, None]
    reach = signed[..., None] * (covariance / deviation[:, None])[:, None]  # (q, w, 2, p)
    bent = ~constraints.hold(likelihood.centre + reach)
    point = radii <= _POINT * radii.max()
    nearest = np.clip(likelihood.centre + move, constraints.bounds.lower, constraints.bounds.upper)
    ends[point], bent[point] = (rows @ nearest)[:, None], False
    if bent.any():
        kind, which, side = np.nonzero(bent)
        ball, a = _Ball(likelihood, constraints, float(radius.max())), rows[which]
        objective = np.where(side == 1, -1.0, 1.0)[:, None] * a * ball.unit
        objective /= np.linalg.norm(objective, axis=1, keepdims=True)
        x, at_bound = ball.march(objective, (radius[kind] / radius.max()) ** 2)
        box = range_on_box(a, constraints.bounds)
        value = a @ likelihood.centre + (a * ball.unit * x).sum(axis=1)
        value = np.clip(value, box[:, 0], box[:, 1])
        ends[bent] = np.where(at_bound, box[np.arange(len(a)), side], value)
    return ends


def range_on_box(rows: FloatArray, bounds: Bounds) -> FloatArray:
    """Return the least and greatest values (w, 2) of linear functions (w, p) within bounds."""
    with np.errstate(invalid="ignore"):
        at = np.stack([rows * bounds.lower, rows * bounds.upper])
    at = np.where(rows == 0.0, 0.0, at)
    return np.stack([at.min(axis=0).sum(axis=1), at.max(axis=0).sum(axis=1)], axis=-1)


class _Ball:
    """The likelihood about its centre in equilibrated variables x, ``‖A x‖²``, with the constraints."""

    def __init__(self, likelihood: Likelihood, constraints: Constraints, scale: float) -> None:
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

    def optimum(self, rhs: FloatArray) -> tuple[FloatArray, BoolArray, FloatArray]:
        """The point x that minimises ‖A x − rhs‖².

        Returns:
            (p,) x; (p,) the variables at a bound; (t, p) the rows of the inequalities that are tight.
        """
        solution = solve_step(IdentificationProblem(self.A, rhs, self.bounds, self.inequalities))
        tight = np.zeros((0, self.A.shape[1]))
        if self.inequalities is not None and solution.tight is not None:
            tight = self.inequalities.matrix[solution.tight]
            slack = self.inequalities.matrix @ solution.compliance - self.inequalities.least
            if (slack < -_VIOLATION).any():  # s is so large that the solver takes it for rounding
                raise SolverError(_NOT_CERTIFIED)
        return solution.compliance, solution.active != 0, tight

    def march(self, objective: FloatArray, radius2: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Find the points that minimise objectives (K, p) within ‖A x‖² ≤ radius2 (K,) and the constraints.

        Returns:
            (K, p) points, and (K,) whether the objective came to its least value on the box inside the ball.
        """
        count = len(objective)
        pull = np.asarray(np.linalg.lstsq(self.A.T, objective.T, rcond=_NO_DIRECTION)[0].T, np.float64)  # h
        free_slope = np.square(pull).sum(axis=1)
        s = np.sqrt(radius2 / free_slope)
        low, high = np.zeros(count), np.full(count, np.inf)
        points, at_bound = np.zeros(objective.shape), np.zeros(count, dtype=np.bool_)
        own = range_on_box(objective, self.bounds)[:, 0]
        pending = np.arange(count)
        for _ in range(MOST_ROUNDS):
            x, step = self.optima(s[pending], objective[pending], pull[pending])
            reached = np.square(x @ self.A.T).sum(axis=1)
            slope = (objective[pending] * step).sum(axis=1)
            slope = np.where(slope > _STANDS_STILL * free_slope[pending], slope, 0.0)
            beyond_own = (objective[pending] * x).sum(axis=1) - own[pending]
            at_own = beyond_own <= _AT_BOUND * np.maximum(1.0, np.abs(x).max(axis=1))
            goal = radius2[pending]
            inside = at_own & (reached <= goal * (1 + RADIUS_TOLERANCE))
            done = inside | (np.abs(reached - goal) <= RADIUS_TOLERANCE * goal)
            points[pending[done]], at_bound[pending[done]] = x[done], inside[done]
            least = low[pending] = np.where(reached < goal, s[pending], low[pending])
            most = high[pending] = np.where(reached > goal, s[pending], high[pending])
            # Newton's step on the face, ‖A x(s)‖² = on_face + s² slope; the middle where that leads astray
            on_face = np.square((x + s[pending, None] * step) @ self.A.T).sum(axis=1)
            with np.errstate(all="ignore"):
                newton = np.sqrt((goal - on_face) / slope)
            middle = np.where(np.isfinite(most), 0.5 * (least + most), 4.0 * least)
            s[pending] = np.where((newton > least) & (newton < most), newton, middle)
            pending = pending[~done]
            if not len(pending):
                return points, at_bound
        raise SolverError(_NOT_CERTIFIED)

    def optima(self, s: FloatArray, objective: FloatArray, pull: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return optima (K, p) of the quadratic programs, and −dx/ds (K, p) on the face of each."""
        x, step = np.zeros(objective.shape), np.zeros(objective.shape)
        pending = np.ones(len(s), dtype=np.bool_)
        if self.inequalities is None:
            gram = np.broadcast_to(self.gram, (len(s), *self.gram.shape))
            batch = solve_batch(gram, -s[:, None] * objective, self.bounds)
            pending = ~batch.certified
            settled, free = batch.certified, batch.active[batch.certified] == 0
            x[settled] = batch.compliance[settled]
            # C a on the free variables, C being the inverse of their part of the Gram matrix
            matrices = np.where(free[:, :, None] & free[:, None, :], self.gram, np.eye(len(self.gram)))
            slopes = np.where(free, objective[settled], 0.0)[..., None]
            step[settled] = np.linalg.solve(matrices, slopes)[..., 0]
        for k in np.flatnonzero(pending):
            x[k], held, tight = self.optimum(-s[k] * pull[k])
            rows = np.vstack([np.eye(len(held))[held], tight])
            along = np.eye(len(held))  # directions of the face; A may lack rank
            if len(rows):
                _, singular, Vt = np.linalg.svd(rows, full_matrices=True)
                along = Vt[int((singular > _NO_DIRECTION * singular[0]).sum()) :].T
            if along.shape[1]:
                inverse = np.linalg.pinv(self.A @ along, rcond=_NO_DIRECTION)
                step[k] = along @ (inverse @ (inverse.T @ (along.T @ objective[k])))
        return x, step
