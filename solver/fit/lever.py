"""Joints near the line of the load: intervals with the load point free (method.md §8).

A compliance times an error of the load is a product of two unknowns. Far from the line of the load, rows of
statements at the fitted compliances are exact enough. Where the lever of a
joint is as short as the load point is uncertain, a joint can be as stiff as the fit says and the lever be as
stated, or the joint be soft and the lever shorter. For such a joint j the interval is the profile

    P_j(v) = min over c', e of ‖A' c' + A_j v + B(ĉ with c_j = v) e − d‖² + σ² ‖e‖²

over the other compliances c' (columns A') within their constraints and the errors e in standard
uncertainties: a convex program for each v. The interval has no upper end where a shorter lever explains any
compliance; a bound of the joint's own does not change that. All methods have the same profile, that of all
readings weighted by covariance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, unit_columns
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.cone import Scalars
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.method import Method, Settings
from jointstiff.solver.fit.prior import Prior
from jointstiff.solver.fit.problem import LeastSquares, Problem
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import solve
from jointstiff.solver.fit.statements import Statements
from jointstiff.solver.fit.triangle import INDEPENDENT, Triangle, compute_triangular_factor, orthonormal_basis
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.mechanics.terms import BY_JOINT

SHORT_LEVER: Final = 10.0
"""Effect of a joint's compliance by the stated load, relative to that by errors of the load of one standard
uncertainty, below which the errors are free in the joint's profile."""
_STEPS: Final = np.geomspace(1.0, 3000.0, 7)
"""Steps from the estimate at which a profile is computed first, in the joint's least standard uncertainty."""
_MOST_STEPS_TO_MINIMUM: Final = 10
_MINIMUM_TOLERANCE: Final = 0.02
"""Accuracy of the compliance at a profile's minimum, in the joint's least standard uncertainty."""
_END_TOLERANCE: Final = 0.01
"""Accuracy of an end, relative to its distance from the profile's minimum."""
_SAMPLE: Final = 4096
"""Number of observations that suffice to tell a short lever."""


@dataclass(frozen=True, eq=False)
class FreeLoad:
    """Readings with the errors of the load as free unknowns, for profiles of joints near the load's line."""

    joints: IndexArray  #: (p,) joints that the readings show, ascending
    A: FloatArray  #: (m, p) columns of their compliances
    B: FloatArray  #: (m, K) columns of what is stated, at the fitted compliances, in standard uncertainties
    levers: FloatArray  #: (m, p, K) columns of the errors of the load at unit compliance of each joint
    d: FloatArray  #: (m,) readings
    compliance: FloatArray  #: (p,) fitted compliances [rad/(N·m)]
    sigma: float  #: standard uncertainty of a coordinate of a reading, the unit of the rows [m]
    constraints: Constraints  #: constraints on the p compliances

    @classmethod
    def of(
        cls, rows: Rows, settings: Settings, statements: Statements, joints: IndexArray
    ) -> FreeLoad | None:
        """Compress the rows of a campaign; None if no joint is near the line of the load.

        Near this line a joint's lever is short compared with the uncertainty of the load point. None, too, if
        the errors of the load are not stated. A sample of a large campaign is searched for short levers
        first, because all rows are needed only for a joint that has one.

        Args:
            rows: N observations, in balance with the fitted compliances.
            settings: constraints and prior; method and weighting do not matter.
            statements: systematic errors of load and places with their standard uncertainties.
            joints: (p,) joints that the readings show, ascending.
        """
        states_errors_of_load = any(term.name in BY_JOINT for term in statements.terms)
        if not states_errors_of_load:
            return None
        is_large = len(rows) > _SAMPLE
        sample = rows.select_evenly(_SAMPLE) if is_large else rows
        free_load = cls._compress(sample, settings, statements, joints)
        if not free_load.has_short_lever.any():
            return None
        if is_large:
            free_load = cls._compress(rows, settings, statements, joints)
        return free_load

    @classmethod
    def _compress(
        cls, rows: Rows, settings: Settings, statements: Statements, joints: IndexArray
    ) -> FreeLoad:
        """Build the least-squares problem ``A c + B e ≈ d``, compressed by QR; the arguments are as of `of`.

        c are the compliances of the p joints, e the K errors in units of their standard uncertainties. The
        columns B depend on the compliances: B changes by ``levers[:, j]`` for a unit of compliance of joint
        j.
        """
        triangle = _compress_rows_with_levers(rows, settings, statements)
        columns_of = triangle.span  # indices of the columns of each term, by its name
        columns_of_joints = columns_of[JOINTS.name][joints]
        columns_of_errors = np.concatenate([columns_of[term.name] for term in statements.terms])
        levers_of_all_joints = _collect_levers(triangle, statements, rows.robot.n)
        free_load = cls(
            joints=joints,
            A=triangle.R[:, columns_of_joints],
            B=triangle.R[:, columns_of_errors],
            levers=levers_of_all_joints[:, joints],
            d=triangle.rhs,
            compliance=statements.compliance[joints],
            sigma=statements.sigma,
            constraints=settings.constraints.select(joints),
        )
        return free_load if settings.prior is None else free_load._append_prior(settings.prior)

    def _append_prior(self, prior: Prior) -> FreeLoad:
        """Return the problem with a row for each prior of a compliance, in which the errors have no part."""
        matrix, values = prior.in_units_of(self.sigma).rows(self.joints)
        no_errors = np.zeros((len(matrix), self.B.shape[1]))
        no_levers = np.zeros((len(matrix), *self.levers.shape[1:]))
        return replace(
            self,
            A=np.vstack([self.A, matrix]),
            B=np.vstack([self.B, no_errors]),
            levers=np.concatenate([self.levers, no_levers]),
            d=np.concatenate([self.d, values]),
        )

    @cached_property
    def ratios(self) -> FloatArray:
        """Ratios (p,) of each joint's lever to its uncertainty, by the effects on the readings.

        This is the effect of the stated load on a joint, divided by the effect of errors of the load of one
        standard uncertainty. Infinite where these errors have no effect.
        """
        by_load = np.linalg.norm(self.A, axis=0)
        by_errors = np.sqrt(np.square(self.levers).sum(axis=(0, 2)))  # over rows and errors
        infinite: FloatArray = np.full(len(by_load), np.inf)
        return np.asarray(np.divide(by_load, by_errors, out=infinite, where=by_errors > 0.0))

    @property
    def has_short_lever(self) -> BoolArray:
        """Mask (p,) of joints whose lever is at most `SHORT_LEVER` times as long as it is uncertain."""
        return np.asarray(self.ratios < SHORT_LEVER, dtype=np.bool_)

    def profile(self, j: int) -> Profile:
        """Return the least sum of squares as a function of the compliance of joint j of the p joints."""
        return Profile(self, j)


def _compress_rows_with_levers(rows: Rows, settings: Settings, statements: Statements) -> Triangle:
    """Compress all readings by QR: columns of joints, of stated errors, and of the load's errors by joint.

    An error of the load acts through every joint. Its term in `BY_JOINT` has a column for each joint, at
    compliance 1 of this joint and 0 of the others.

    Raises:
        ValueError: there are no observations.
    """
    by_joint = [BY_JOINT[term.name] for term in statements.terms if term.name in BY_JOINT]
    with_levers = Statements(
        (*statements.terms, *by_joint), statements.common, statements.compliance, statements.sigma
    )
    all_readings = replace(settings, method="partial_pose", weighting="covariance")
    method = Method(rows.robot, all_readings, None)
    triangle: Triangle | None = None
    for block_rows in with_levers.generate(rows, [JOINTS]):
        triangle = triangle or Triangle(**block_rows.widths)
        only_stage = next(method.map_rows(block_rows))
        triangle.add(only_stage.fitted)
    if triangle is None:
        raise ValueError("no observations")
    return triangle


def _collect_levers(triangle: Triangle, statements: Statements, n: int) -> FloatArray:
    """Return the levers (m, n, K): effects of K errors at compliance 1 of one joint and 0 of the others.

    Only errors of the load act through the joints, so the levers of other errors are zero.

    Args:
        triangle: m compressed rows, with a column for each error and joint (`_compress_rows_with_levers`).
        statements: terms of the K errors; a term has one or several errors.
        n: number of the robot's joints.
    """
    widths = [len(triangle.span[term.name]) for term in statements.terms]  # number of errors of each term
    levers = np.zeros((len(triangle.R), n, sum(widths)))
    start = 0
    for term, width in zip(statements.terms, widths, strict=True):
        errors_of_term = slice(start, start + width)
        if term.name in BY_JOINT:
            term_by_joint = BY_JOINT[term.name]
            columns = triangle.R[:, triangle.span[term_by_joint.name]]  # (m, n · width), joint by joint
            levers[:, :, errors_of_term] = columns.reshape(-1, n, width)
        start += width
    return levers


class _ProfiledColumns(NamedTuple):
    """Columns of the problem ``v a + C c' + (B + (v − ĉ) lever) e ≈ d`` of one joint.

    v is the compliance of the joint, and ĉ its fitted value. The other unknowns are the compliances c' of the
    other joints and the K errors e, in units of their standard uncertainties.
    """

    a: FloatArray  # (m, 1) column of the joint
    C: FloatArray  # (m, p − 1) columns of the other joints; (m, 0) after they are projected out
    B: FloatArray  # (m, K) columns of the errors if the joint has its fitted compliance ĉ
    lever: FloatArray  # (m, K) change of B by a unit compliance of the joint
    d: FloatArray  # (m, 1) readings

    def project_others_out(self) -> _ProfiledColumns:
        """Return the columns without their part in the span of the other joints' columns.

        A fit to the result equals a fit in which the other compliances are free.
        """
        scaled_others, _ = unit_columns(self.C)
        Q = orthonormal_basis(scaled_others, INDEPENDENT)
        return _ProfiledColumns(
            a=self.a - Q @ (Q.T @ self.a),
            C=self.C[:, :0],
            B=self.B - Q @ (Q.T @ self.B),
            lever=self.lever - Q @ (Q.T @ self.lever),
            d=self.d - Q @ (Q.T @ self.d),
        )


class _ProfileRows(NamedTuple):
    """Least-squares rows ``E e + C c' ≈ r`` of the unknowns e and c', for each of V compliances of one joint.

    For each compliance there are m rows of the readings, then K rows that state that the errors are zero.
    """

    E: FloatArray  # (V, m + K, K) columns of the errors e
    C: FloatArray  # (V, m + K, p − 1) columns of the other compliances c'; without any if these are free
    r: FloatArray  # (V, m + K, 1) right-hand side

    @classmethod
    def build(
        cls, compliance: FloatArray, fitted: float, columns: _ProfiledColumns, sigma: float
    ) -> _ProfileRows:
        """Build the rows of the readings, and a row ``σ e_k = 0`` of each error.

        The rows of the readings are ``(B + (v − ĉ) lever) e + C c' ≈ d − v a``. The factor σ gives the
        statement on an error, e_k = 0 ± 1, the weight of a reading with standard uncertainty σ.

        Args:
            compliance: (V,) compliances v of the joint [rad/(N·m)].
            fitted: fitted compliance ĉ of the joint [rad/(N·m)].
            columns: a, C, B, lever and d.
            sigma: standard uncertainty σ of a reading [m].
        """
        m, error_count = columns.B.shape
        row_count = m + error_count
        v = compliance[:, None, None]
        E = np.zeros((len(compliance), row_count, error_count))
        C = np.zeros((len(compliance), row_count, columns.C.shape[1]))
        r = np.zeros((len(compliance), row_count, 1))
        E[:, :m] = columns.B + (v - fitted) * columns.lever
        E[:, m:] = sigma * np.eye(error_count)
        C[:, :m] = columns.C
        r[:, :m] = columns.d - v * columns.a
        return cls(E, C, r)

    def compute_factors(self) -> FloatArray:
        """Return the QR factors of the V matrices [E C r], (V, K + p, K + p)."""
        return compute_triangular_factor(np.concatenate([self.E, self.C, self.r], axis=-1))

    def minimise(self) -> FloatArray:
        """Return the least sums of squares (V,) over all e and c'."""
        # The last entry of a QR factor of [E C r] is the length of the residual of the fit to r.
        length_of_residual = self.compute_factors()[:, -1, -1]
        return np.square(length_of_residual)

    def eliminate_errors(self) -> FloatArray:
        """Return rows [R z] (V, p, p) of the problems ``R c' ≈ z`` that remain for the best errors e.

        In the QR factor of [E C r] the first K rows determine the errors for any c'; below them are the rows
        of c' alone.
        """
        error_count = self.E.shape[-1]
        return self.compute_factors()[:, error_count:, error_count:]


class Profile:
    """Least sum of squares for each compliance v of one joint, with the errors e of the load free.

    The sum is ``‖A' c' + A_j v + B(v) e − d‖² + σ² ‖e‖²``, minimised over the other compliances c' and e.

    Attributes:
        programs: number of convex programs that were solved.
        unit: standard uncertainty of the joint's compliance if all else was known [rad/(N·m)].
    """

    def __init__(self, load: FreeLoad, j: int) -> None:
        """Prepare the profile of the joint with index j among the p joints that the readings show."""
        self._load, self._j = load, j
        self._fitted = float(load.compliance[j])
        self._others = np.delete(np.arange(len(load.joints)), j)  # the other joints, among the p
        self._constraints = _remove_upper_bound(load.constraints, j)
        self.programs = 0
        # A unit of v moves the readings by a + lever · e, with the column a of the joint. For errors e of one
        # standard uncertainty, the mean square of this motion is ‖a‖² + ‖lever‖².
        effect_of_compliance = np.linalg.norm(load.A[:, j])
        effect_through_errors = np.linalg.norm(load.levers[:, j])
        self.unit = load.sigma / float(np.hypot(effect_of_compliance, effect_through_errors))

    @property
    def _columns(self) -> _ProfiledColumns:
        """Columns of this joint, of the other joints, of the errors, and of the readings."""
        load, j = self._load, self._j
        return _ProfiledColumns(
            a=load.A[:, j : j + 1],
            C=load.A[:, self._others],
            B=load.B,
            lever=load.levers[:, j],
            d=load.d[:, None],
        )

    @cached_property
    def _columns_without_others(self) -> _ProfiledColumns:
        """The columns with those of the other joints projected out, which leaves the other joints free."""
        return self._columns.project_others_out()

    def _build_rows(self, compliance: FloatArray, columns: _ProfiledColumns) -> _ProfileRows:
        """Build the least-squares rows of the unknowns for each of V compliances (V,) of the joint."""
        return _ProfileRows.build(compliance, self._fitted, columns, self._load.sigma)

    def minimise_without_constraints(self, compliance: FloatArray) -> FloatArray:
        """Minimise the sum of squares over all other unknowns for each of V compliances of the joint.

        Args:
            compliance: (V,) compliances v of the joint [rad/(N·m)].

        Returns:
            The least sums (V,), without constraints on the compliances.
        """
        return self._build_rows(compliance, self._columns_without_others).minimise()

    def minimise_within_constraints(self, compliance: FloatArray) -> FloatArray:
        """Minimise the sum of squares over all other unknowns for each of V compliances of the joint.

        Args:
            compliance: (V,) compliances v of the joint [rad/(N·m)].

        Returns:
            The least sums (V,), within the constraints on the compliances; infinite where no compliances of
            the other joints satisfy the constraints.
        """
        # Only the compliances have constraints, so that the errors can be eliminated first.
        rows_of_others = self._build_rows(compliance, self._columns).eliminate_errors()
        least_sums = []
        for v, rows in zip(compliance.tolist(), rows_of_others, strict=True):
            least_sums.append(self._minimise_over_other_joints(v, rows))
        return np.array(least_sums)

    def _minimise_over_other_joints(self, v: float, rows: FloatArray) -> float:
        """Return the least sum of squares over the other compliances c' within the constraints.

        The result is infinite if the order of the joints excludes the compliance v of this joint.

        Args:
            v: compliance of this joint [rad/(N·m)].
            rows: (p, p) rows [R z] of the problem ``R c' ≈ z``.
        """
        self.programs += 1
        try:
            constraints = self._constraints.fix_joints(np.array([self._j]), np.array([v]), self._others)
        except RequestError:
            return np.inf
        R, z = rows[:, :-1], rows[:, -1]
        problem = Problem(LeastSquares(R, z), Scalars.of(constraints))
        other_compliances = solve(problem, witnessed=False).x
        return float(np.square(R @ other_compliances - z).sum())

    def find_ends(self, radii: FloatArray) -> ProfileEnds:
        """Return intervals of the joint's compliance, in which the least sum of squares is near its minimum.

        The joint's own upper bound is ignored. The intervals within the constraints equal those without where
        the best fit satisfies the constraints: the sums of squares within the constraints are nowhere less,
        so that their interval is contained in the other.

        Args:
            radii: (q,) roots of the allowed rises of the sum: half-widths in standard uncertainties, times
                sigma [m].
        """
        free = _Curve.around(self._fitted, self.unit, -np.inf, self.minimise_without_constraints)
        free_ends = free.find_intervals(radii)
        best_fit = self._fit_without_constraints(free.bottom)
        if self._constraints.are_satisfied_by(best_fit):
            return ProfileEnds(free_ends, free_ends)
        lower_bound = float(self._constraints.bounds.lower[self._j])
        constrained = _Curve.around(self._fitted, self.unit, lower_bound, self.minimise_within_constraints)
        return ProfileEnds(free_ends, constrained.find_intervals(radii))

    def _fit_without_constraints(self, v: float) -> FloatArray:
        """Fit the other compliances and the errors, without constraints, for a compliance v of the joint.

        Returns:
            The compliances (p,) of all joints that the readings show, v among them [rad/(N·m)].
        """
        rows = self._build_rows(np.array([v]), self._columns)
        E, C, r = rows.E[0], rows.C[0], rows.r[0, :, 0]
        columns, lengths = unit_columns(np.hstack([E, C]))  # unit columns make `INDEPENDENT` meaningful
        scaled_unknowns, *_ = np.linalg.lstsq(columns, r, rcond=INDEPENDENT)
        unknowns = scaled_unknowns / lengths
        error_count = E.shape[1]
        compliances = np.empty(len(self._load.joints))
        compliances[self._j] = v
        compliances[self._others] = unknowns[error_count:]
        return compliances


def _remove_upper_bound(constraints: Constraints, j: int) -> Constraints:
    """Return the constraints without the upper bound of joint j.

    Whether the readings leave an upper end to the compliance is what its profile tells, so the joint's own
    upper bound must not end the profile.
    """
    upper = constraints.bounds.upper.copy()
    upper[j] = np.inf
    return replace(constraints, bounds=Bounds(constraints.bounds.lower, upper))


class ProfileEnds(NamedTuple):
    """Intervals of a joint's compliance by its profile; an end may be infinite."""

    without_constraints: FloatArray  # (q, 2) [rad/(N·m)]
    within_constraints: FloatArray  # (q, 2) [rad/(N·m)]


@dataclass(frozen=True, eq=False)
class _Curve:
    """Sum of squares P(v) of a profile at compliances v of one joint, and its minimum."""

    compute: Callable[[FloatArray], FloatArray]  #: the function P: sums of squares (V,) at compliances (V,)
    grid: FloatArray  #: (G,) compliances at which P was computed first, ascending [rad/(N·m)]
    values: FloatArray  #: (G,) P on the grid
    unit: float  #: first step of the grid [rad/(N·m)]
    least: float  #: lower bound of the compliance [rad/(N·m)]
    bottom: float  #: compliance at the minimum [rad/(N·m)]
    minimum: float  #: least value of P; infinite if the order of the joints excludes all of the grid

    @classmethod
    def around(
        cls, estimate: float, unit: float, least: float, compute: Callable[[FloatArray], FloatArray]
    ) -> _Curve:
        """Compute the profile on a grid around the estimate, and find the minimum between points of the grid.

        Args:
            estimate: fitted compliance [rad/(N·m)].
            unit: first step from the estimate [rad/(N·m)].
            least: lower bound of the compliance [rad/(N·m)].
            compute: the function P: sums of squares (V,) at compliances (V,).
        """
        steps = unit * _STEPS
        points = np.concatenate([estimate - steps, [estimate], estimate + steps])
        grid = np.unique(np.clip(points, least, None))  # ascending
        values = compute(grid)
        lowest = int(values.argmin())
        on_grid = cls(compute, grid, values, unit, least, float(grid[lowest]), float(values[lowest]))
        if not np.isfinite(on_grid.minimum):
            return replace(on_grid, bottom=estimate)
        return on_grid._refine_minimum(lowest)

    def _refine_minimum(self, lowest: int) -> _Curve:
        """Return the curve with the minimum between the neighbours of the grid's lowest point.

        Args:
            lowest: index on the grid of the point with the least value.
        """
        before, after = max(lowest - 1, 0), min(lowest + 1, len(self.grid) - 1)
        found = minimize_scalar(
            self.compute_at,
            bounds=(float(self.grid[before]), float(self.grid[after])),
            method="bounded",
            options={"maxiter": _MOST_STEPS_TO_MINIMUM, "xatol": _MINIMUM_TOLERANCE * self.unit},
        )
        if found.fun < self.minimum:
            return replace(self, bottom=float(found.x), minimum=float(found.fun))
        return self

    def compute_at(self, v: float) -> float:
        """Return P at the compliance v."""
        return float(self.compute(np.array([v]))[0])

    def find_intervals(self, radii: FloatArray) -> FloatArray:
        """Find the intervals (q, 2) in which P exceeds its minimum by at most each squared radius.

        An end is infinite, or the lower bound, if the rise of P stays below as far as P was computed.

        Args:
            radii: (q,) square roots of the rises.
        """
        if not np.isfinite(self.minimum):
            return np.tile([self.least, np.inf], (len(radii), 1))
        return np.array([self._find_interval(radius) for radius in radii.tolist()]).reshape(-1, 2)

    def _find_interval(self, radius: float) -> tuple[float, float]:
        """Return the ends of the interval around the minimum in which P rises by at most radius².

        Each end is between the outermost point of the grid that is inside, and its neighbour on the grid.
        Without such a neighbour the end is the lower bound, or infinite.
        """
        roots_of_rises = np.sqrt(np.maximum(self.values - self.minimum, 0.0))
        inside = np.append(self.grid[roots_of_rises <= radius], self.bottom)
        first_inside, last_inside = float(inside.min()), float(inside.max())
        below, above = self.grid[self.grid < first_inside], self.grid[self.grid > last_inside]
        lower, upper = self.least, np.inf
        if len(below):
            lower = self._find_crossing(first_inside, float(below[-1]), radius)
        if len(above):
            upper = self._find_crossing(last_inside, float(above[0]), radius)
        return lower, upper

    def _find_crossing(self, inside: float, beyond: float, radius: float) -> float:
        """Return the compliance between two others at which P has risen by radius² above its minimum.

        Args:
            inside: compliance with a smaller rise [rad/(N·m)].
            beyond: compliance with a greater rise [rad/(N·m)].
            radius: root of the rise [m].
        """

        def compute_excess(v: float) -> float:
            """Return by how much the root of the rise at v exceeds the radius."""
            rise = max(self.compute_at(v) - self.minimum, 0.0)
            return float(np.sqrt(rise)) - radius

        tolerance = _END_TOLERANCE * max(abs(beyond - self.bottom) / 4.0, self.unit)
        return float(brentq(compute_excess, inside, beyond, xtol=tolerance))
