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

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.method import Method, Settings
from jointstiff.solver.fit.prior import Prior
from jointstiff.solver.fit.problem import Bounds, Constraints, IdentificationProblem
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import solve_step
from jointstiff.solver.fit.statements import Statements
from jointstiff.solver.fit.triangle import (
    INDEPENDENT,
    Triangle,
    compute_triangular_factor,
    orthonormal_basis,
    unit_columns,
)
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

        c are the compliances of the p joints, e the K errors. The columns B depend on the compliances: B
        changes by ``levers[:, j]`` for each unit of compliance of joint j.
        """
        triangle = _compress_rows_with_levers(rows, settings, statements)
        R, columns_of = triangle.R, triangle.span  # QR factor of all rows; columns of each term in it
        n = rows.robot.n
        columns_of_errors = np.concatenate([columns_of[term.name] for term in statements.terms])
        levers = np.zeros((len(R), n, len(columns_of_errors)))  # (rows, joints, errors)
        for term in statements.terms:
            if term.name in BY_JOINT:  # only errors of the load have levers
                index_of_error = np.searchsorted(columns_of_errors, columns_of[term.name])
                columns_by_joint = R[:, columns_of[BY_JOINT[term.name].name]]
                levers[:, :, index_of_error] = columns_by_joint.reshape(len(R), n, -1)
        free_load = cls(
            joints=joints,
            A=R[:, joints],
            B=R[:, columns_of_errors],
            levers=levers[:, joints],
            d=R[:, -1],
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


class _ProfiledColumns(NamedTuple):
    """Columns of the least-squares problem ``v a + (B + (v − ĉ) lever) e ≈ d`` of one joint.

    The unknowns are the compliance v of the joint, whose fitted value is ĉ, and the K errors e.
    """

    a: FloatArray  # (m, 1) column of the joint
    B: FloatArray  # (m, K) columns of the errors at the fitted compliances
    lever: FloatArray  # (m, K) change of B by a unit compliance of the joint
    d: FloatArray  # (m, 1) readings


class Profile:
    """Least sum of squares for each compliance v of one joint, with the errors e of the load free.

    The sum is ``‖A' c' + A_j v + B(v) e − d‖² + σ² ‖e‖²``, minimised over the other compliances c' and e.

    Attributes:
        programs: number of convex programs that were solved.
        unit: standard uncertainty of the joint's compliance if all else was known [rad/(N·m)].
    """

    def __init__(self, load: FreeLoad, j: int) -> None:
        """Prepare the profile of the joint with index j among the p joints that the readings show.

        Whether the readings leave an upper end to the compliance is what the profile tells, so the joint's
        own upper bound does not constrain it.
        """
        self._load, self._j = load, j
        self._others = np.delete(np.arange(len(load.joints)), j)
        self.programs = 0
        # A unit of compliance moves the readings, and the effects of the errors of the load on the readings.
        effect_on_readings = np.linalg.norm(load.A[:, j])
        effect_on_errors = np.linalg.norm(load.levers[:, j])
        self.unit = load.sigma / float(np.hypot(effect_on_readings, effect_on_errors))
        bounds = load.constraints.bounds
        upper = bounds.upper.copy()
        upper[j] = np.inf
        self._constraints = replace(load.constraints, bounds=Bounds(bounds.lower, upper))

    @property
    def _columns(self) -> _ProfiledColumns:
        """Columns of this joint, of the errors, and of the readings."""
        load, j = self._load, self._j
        return _ProfiledColumns(load.A[:, j : j + 1], load.B, load.levers[:, j], load.d[:, None])

    @cached_property
    def _columns_without_others(self) -> _ProfiledColumns:
        """The columns with those of the other joints projected out.

        A fit to the result equals a fit in which the other compliances are free.
        """
        columns_of_others, _ = unit_columns(self._load.A[:, self._others])
        basis = orthonormal_basis(columns_of_others, INDEPENDENT)
        projected = [columns - basis @ (basis.T @ columns) for columns in self._columns]
        return _ProfiledColumns(*projected)

    def minimise_without_constraints(self, compliance: FloatArray) -> FloatArray:
        """Minimise the sum of squares over all other unknowns for each of V compliances of the joint.

        Returns the least sums (V,) without constraints on the compliances.
        """
        rows = self._build_rows_of_errors(compliance, self._columns_without_others)
        # The last entry of the QR factor of rows [A d] is the length of the residual of ``A x ≈ d``.
        factors = compute_triangular_factor(rows)
        return np.square(factors[:, -1, -1])

    def minimise_within_constraints(self, compliance: FloatArray) -> FloatArray:
        """Minimise the sum of squares over all other unknowns for each of V compliances of the joint.

        Returns the least sums (V,) within the constraints on the compliances; infinite where no compliances
        of the other joints satisfy the constraints.
        """
        rows = self._build_rows_of_all_unknowns(compliance)
        # The errors have no constraints, and their columns come first. So the QR factor has a first part for
        # the errors, and below it a part for the other compliances alone.
        error_count = self._load.B.shape[1]
        factors = compute_triangular_factor(rows)[:, error_count:, error_count:]
        least_sums = []
        for value, factor in zip(compliance, factors, strict=True):
            least_sums.append(self._minimise_over_other_joints(value, factor))
        return np.array(least_sums)

    def _build_rows_of_errors(self, compliance: FloatArray, columns: _ProfiledColumns) -> FloatArray:
        """Build the least-squares rows of the errors e for each of V compliances v of the joint.

        First m rows ``(B + (v − ĉ) lever) e = d − v a`` of the readings, with ĉ the fitted compliance, then K
        rows ``σ e = 0``, which state that the errors are near zero.

        Args:
            compliance: (V,) compliances v.
            columns: a, B, lever and d.

        Returns:
            Rows (V, m + K, K + 1), the right-hand side last.
        """
        a, B, lever, d = columns
        m, error_count = B.shape
        v = compliance[:, None, None]
        rows = np.zeros((len(compliance), m + error_count, error_count + 1))
        rows[:, :m, :-1] = B + (v - self._load.compliance[self._j]) * lever
        rows[:, :m, -1:] = d - v * a
        rows[:, m:, :-1] = self._load.sigma * np.eye(error_count)
        return rows

    def _build_rows_of_all_unknowns(self, compliance: FloatArray) -> FloatArray:
        """Build the least-squares rows of the errors and the other joints, for V compliances of the joint.

        Returns:
            Rows (V, m + K, K + p): K columns of errors, p − 1 columns of other compliances, the right-hand
            side.
        """
        rows = self._build_rows_of_errors(compliance, self._columns)
        reading_count = len(self._load.A)
        columns_of_others = np.zeros((*rows.shape[:2], len(self._others)))
        columns_of_others[:, :reading_count] = self._load.A[:, self._others]
        return np.concatenate([rows[..., :-1], columns_of_others, rows[..., -1:]], axis=-1)

    def _minimise_over_other_joints(self, value: float, factor: FloatArray) -> float:
        """Return the least sum of squares over the other compliances within the constraints.

        The result is infinite if the order of the joints excludes the compliance of this joint.

        Args:
            value: compliance of this joint [rad/(N·m)].
            factor: (p, p) triangular factor of the rows of the other compliances, the right-hand side last.
        """
        self.programs += 1
        try:
            remaining = self._constraints.fix_joints(np.array([self._j]), np.array([value]), self._others)
        except RequestError:
            return np.inf
        R, z = factor[:, :-1], factor[:, -1]
        solution = solve_step(IdentificationProblem(R, z, remaining.bounds, remaining.inequalities))
        return float(np.square(R @ solution.compliance - z).sum())

    def find_ends(self, radii: FloatArray) -> ProfileEnds:
        """Return intervals of the joint's compliance, in which the least sum of squares is near its minimum.

        The joint's own upper bound is ignored. The intervals within the constraints equal those without where
        the best fit satisfies the constraints: the sums of squares within the constraints are nowhere less,
        so that their interval is contained in the other.

        Args:
            radii: (q,) half-widths in standard uncertainties, times sigma.
        """
        estimate = float(self._load.compliance[self._j])
        free = _Curve.around(estimate, self.unit, -np.inf, self.minimise_without_constraints)
        free_ends = free.find_intervals(radii)
        best_fit = self._fit_without_constraints(free.bottom)
        if self._constraints.are_satisfied_by(best_fit):
            return ProfileEnds(free_ends, free_ends)
        least = float(self._constraints.bounds.lower[self._j])
        constrained = _Curve.around(estimate, self.unit, least, self.minimise_within_constraints)
        return ProfileEnds(free_ends, constrained.find_intervals(radii))

    def _fit_without_constraints(self, value: float) -> FloatArray:
        """Return the compliances (p,) of the fit without constraints for a compliance of the joint."""
        rows = self._build_rows_of_all_unknowns(np.array([value]))[0]
        columns, lengths = unit_columns(rows[:, :-1])
        scaled_unknowns, *_ = np.linalg.lstsq(columns, rows[:, -1], rcond=INDEPENDENT)
        unknowns = scaled_unknowns / lengths  # first the errors, then the other compliances
        error_count = self._load.B.shape[1]
        return np.insert(unknowns[error_count:], self._j, value)


class ProfileEnds(NamedTuple):
    """Intervals of a joint's compliance by its profile; an end may be infinite."""

    without_constraints: FloatArray  # (q, 2) [rad/(N·m)]
    within_constraints: FloatArray  # (q, 2) [rad/(N·m)]


@dataclass(frozen=True, eq=False)
class _Curve:
    """Sum of squares P(v) of a profile at compliances v of one joint, and its minimum."""

    squares: Callable[[FloatArray], FloatArray]  #: the function P: sums of squares (V,) at compliances (V,)
    grid: FloatArray  #: (G,) compliances at which P was computed first, ascending [rad/(N·m)]
    values: FloatArray  #: (G,) P on the grid
    unit: float  #: first step of the grid [rad/(N·m)]
    least: float  #: lower bound of the compliance [rad/(N·m)]
    bottom: float  #: compliance at the minimum [rad/(N·m)]
    minimum: float  #: least value of P; infinite if the order of the joints excludes all of the grid

    @classmethod
    def around(
        cls, estimate: float, unit: float, least: float, squares: Callable[[FloatArray], FloatArray]
    ) -> _Curve:
        """Compute the profile on a grid around the estimate, and find the minimum between points of the grid.

        Args:
            estimate: estimate [rad/(N·m)].
            unit: first step from the estimate [rad/(N·m)].
            least: lower bound of the compliance [rad/(N·m)].
            squares: sums of squares (V,) at compliances (V,).
        """
        steps = unit * _STEPS
        points = np.concatenate([estimate - steps, [estimate], estimate + steps])
        grid = np.unique(np.clip(points, least, None))  # ascending
        values = squares(grid)
        lowest = int(values.argmin())
        on_grid = cls(squares, grid, values, unit, least, float(grid[lowest]), float(values[lowest]))
        if not np.isfinite(on_grid.minimum):
            return replace(on_grid, bottom=estimate)
        before, after = grid[max(lowest - 1, 0)], grid[min(lowest + 1, len(grid) - 1)]
        found = minimize_scalar(
            on_grid.compute_at,
            bounds=(float(before), float(after)),
            method="bounded",
            options={"maxiter": _MOST_STEPS_TO_MINIMUM, "xatol": _MINIMUM_TOLERANCE * unit},
        )
        if found.fun < on_grid.minimum:
            return replace(on_grid, bottom=float(found.x), minimum=float(found.fun))
        return on_grid

    def compute_at(self, v: float) -> float:
        """Return P at the compliance v."""
        return float(self.squares(np.array([v]))[0])

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
        """Return the ends of the interval around the minimum in which P rises by at most radius²."""
        roots_of_rises = np.sqrt(np.maximum(self.values - self.minimum, 0.0))
        inside = np.append(self.grid[roots_of_rises <= radius], self.bottom)
        first, last = float(inside.min()), float(inside.max())
        below, above = self.grid[self.grid < first], self.grid[self.grid > last]
        lower, upper = self.least, np.inf
        if len(below):
            lower = self._find_crossing(first, float(below[-1]), radius)
        if len(above):
            upper = self._find_crossing(last, float(above[0]), radius)
        return lower, upper

    def _find_crossing(self, inside: float, beyond: float, radius: float) -> float:
        """Return the compliance, between two neighbours on the grid, at which P has risen by radius²."""

        def compute_excess(v: float) -> float:
            rise = max(self.compute_at(v) - self.minimum, 0.0)
            return float(np.sqrt(rise)) - radius

        tolerance = _END_TOLERANCE * max(abs(beyond - self.bottom) / 4.0, self.unit)
        return float(brentq(compute_excess, inside, beyond, xtol=tolerance))
