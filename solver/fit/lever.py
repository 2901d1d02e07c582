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

        Near this line a joint's lever is short compared with the uncertainty of the load point.

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
        sample = rows.select_evenly(_SAMPLE) if is_large else rows  # enough to tell short levers
        free_load = cls._compress(sample, settings, statements, joints)
        if not free_load.weak.any():
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
        terms_of_load = [term for term in statements.terms if term.name in BY_JOINT]
        # `BY_JOINT` has the same errors of the load, with a column for each joint at compliance 1.
        terms = (*statements.terms, *(BY_JOINT[term.name] for term in terms_of_load))
        with_levers = Statements(terms, statements.common, statements.compliance, statements.sigma)
        all_readings = replace(settings, method="partial_pose", weighting="covariance")
        method = Method(rows.robot, all_readings, None)
        triangle: Triangle | None = None
        for block_rows in with_levers.generate(rows, [JOINTS]):
            triangle = triangle or Triangle(**block_rows.widths)
            only_stage = next(method.map_rows(block_rows))
            triangle.add(only_stage.fitted)
        if triangle is None:
            raise ValueError("no observations")

        R, columns_of = triangle.R, triangle.span  # QR factor of all rows; columns of each term in it
        columns_of_errors = np.concatenate([columns_of[term.name] for term in statements.terms])
        A, B, d = R[:, joints], R[:, columns_of_errors], R[:, -1]
        levers = np.zeros((len(R), rows.robot.n, len(columns_of_errors)))  # (rows, joints, errors)
        for term in terms_of_load:
            errors = np.searchsorted(columns_of_errors, columns_of[term.name])  # indices among the K errors
            by_joint = R[:, columns_of[BY_JOINT[term.name].name]]
            levers[:, :, errors] = by_joint.reshape(len(R), rows.robot.n, -1)
        levers = levers[:, joints]
        if settings.prior is not None:
            matrix, values = settings.prior.in_units_of(statements.sigma).rows(joints)
            A = np.vstack([A, matrix])
            d = np.concatenate([d, values])
            # Priors of compliances do not depend on the errors.
            B = np.vstack([B, np.zeros((len(matrix), B.shape[1]))])
            levers = np.concatenate([levers, np.zeros((len(matrix), *levers.shape[1:]))])
        return cls(
            joints=joints,
            A=A,
            B=B,
            levers=levers,
            d=d,
            compliance=statements.compliance[joints],
            sigma=statements.sigma,
            constraints=settings.constraints.select(joints),
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
    def weak(self) -> BoolArray:
        """Mask (p,) of joints whose lever is short."""
        return np.asarray(self.ratios < SHORT_LEVER, dtype=np.bool_)

    def profile(self, j: int) -> Profile:
        """Return the profile of the joint with index j among the p joints."""
        return Profile(self, j)


class Profile:
    """Least sum of squares for each compliance of one joint, with the errors of the load free.

    Attributes:
        programs: number of convex programs that were solved.
    """

    def __init__(self, load: FreeLoad, j: int) -> None:
        """Start the profile of the joint with index j among the p joints that the readings show."""
        self._load, self._j = load, j
        self._others = np.delete(np.arange(len(load.joints)), j)
        self.programs = 0
        effect_of_unit_compliance = np.hypot(np.linalg.norm(load.A[:, j]), np.linalg.norm(load.levers[:, j]))
        # Least standard uncertainty of the joint [rad/(N·m)], if all else was known.
        self.unit = load.sigma / float(effect_of_unit_compliance)
        # Whether the readings leave an upper end does not depend on the joint's own upper bound.
        bounds = load.constraints.bounds
        upper = bounds.upper.copy()
        upper[j] = np.inf
        self._constraints = replace(load.constraints, bounds=Bounds(bounds.lower, upper))

    @cached_property
    def _without_others(self) -> tuple[FloatArray, ...]:
        """Project the columns of the other joints out of the least-squares problem ``v a + B e ≈ d``.

        A fit to the result equals a fit in which the other compliances are free.

        Returns:
            The joint's column a (m, 1), the columns B of the errors (m, K), the change of B by a unit
            compliance of the joint (m, K), and the readings d (m, 1).
        """
        load, j = self._load, self._j
        columns_of_others, _ = unit_columns(load.A[:, self._others])
        basis = orthonormal_basis(columns_of_others, INDEPENDENT)
        columns = (load.A[:, j : j + 1], load.B, load.levers[:, j], load.d[:, None])
        return tuple(each - basis @ (basis.T @ each) for each in columns)

    def without_constraints(self, compliance: FloatArray) -> FloatArray:
        """Minimise the sum of squares over all other unknowns for each of V compliances of the joint.

        Returns the least sums (V,) without constraints on the compliances.
        """
        a, B, lever, d = self._without_others
        rows = self._stack(compliance, a, B, lever, d)
        # The last entry of the QR factor of rows [A d] is the length of the residual of ``A x ≈ d``.
        factors = compute_triangular_factor(rows)
        return np.square(factors[:, -1, -1])

    def within_constraints(self, compliance: FloatArray) -> FloatArray:
        """Minimise the sum of squares over all other unknowns for each of V compliances of the joint.

        Returns the least sums (V,) within the constraints on the compliances; infinite where no compliances
        of the other joints satisfy the constraints.
        """
        rows = self._stack_with_others(compliance)
        # The errors have no constraints, and their columns come first. So the QR factor has a first part for
        # the errors, and below it a part for the other compliances alone.
        error_count = self._load.B.shape[1]
        factors = compute_triangular_factor(rows)[:, error_count:, error_count:]
        least = [self._solve(value, factor) for value, factor in zip(compliance, factors, strict=True)]
        return np.array(least)

    def _stack(
        self, compliance: FloatArray, a: FloatArray, B: FloatArray, lever: FloatArray, d: FloatArray
    ) -> FloatArray:
        """Build the least-squares rows of the errors e for each of V compliances v of the joint.

        First ``(B + (v − ĉ) lever) e = d − v a`` for the readings, with ĉ the fitted compliance, then the
        statements ``σ e = 0``.

        Args:
            compliance: (V,) compliances v.
            a: (m, 1) column of the joint.
            B: (m, K) columns of the errors at the fitted compliances.
            lever: (m, K) change of B by a unit compliance of the joint.
            d: (m, 1) readings.

        Returns:
            Rows (V, m + K, K + 1), the right-hand side last.
        """
        load = self._load
        m, error_count = B.shape
        v = compliance[:, None, None]
        rows = np.zeros((len(compliance), m + error_count, error_count + 1))
        rows[:, :m, :-1] = B + (v - load.compliance[self._j]) * lever
        rows[:, :m, -1:] = d - v * a
        rows[:, m:, :-1] = load.sigma * np.eye(error_count)
        return rows

    def _stack_with_others(self, compliance: FloatArray) -> FloatArray:
        """Build the least-squares rows of the errors and the other joints, for V compliances of the joint.

        Returns:
            Rows (V, m + K, K + p): K columns of errors, p − 1 columns of other compliances, the right-hand
            side.
        """
        load, j = self._load, self._j
        rows = self._stack(compliance, load.A[:, j : j + 1], load.B, load.levers[:, j], load.d[:, None])
        columns_of_others = np.zeros((*rows.shape[:2], len(self._others)))
        columns_of_others[:, : len(load.A)] = load.A[:, self._others]
        return np.concatenate([rows[..., :-1], columns_of_others, rows[..., -1:]], axis=-1)

    def _solve(self, value: float, factor: FloatArray) -> float:
        """Minimise the sum of squares over the other compliances; return infinity if none is feasible.

        Args:
            value: compliance of the joint [rad/(N·m)].
            factor: (p, p) triangular factor of the rows of the other compliances, the right-hand side last.
        """
        self.programs += 1
        try:
            left = self._constraints.fix_joints(np.array([self._j]), np.array([value]), self._others)
        except RequestError:  # the order of the joints excludes this compliance
            return np.inf
        R, z = factor[:, :-1], factor[:, -1]
        solution = solve_step(IdentificationProblem(R, z, left.bounds, left.inequalities))
        return float(np.square(R @ solution.compliance - z).sum())

    def find_ends(self, radii: FloatArray) -> ProfileEnds:
        """Return intervals of the joint's compliance, in which the least sum of squares is near its minimum.

        The joint's own upper bound is ignored.

        Args:
            radii: (q,) half-widths in standard uncertainties, times sigma.
        """
        estimate = float(self._load.compliance[self._j])
        free = _search(self.without_constraints, estimate, self.unit, radii, -np.inf)
        # If the optimum without constraints satisfies the constraints, it is the optimum within them, too.
        # The sums of squares within constraints are nowhere less: that interval is contained in this one.
        optimum = self._find_optimum(free.bottom)
        if self._constraints.are_satisfied_by(optimum):
            return ProfileEnds(free.ends, free.ends)
        least = float(self._constraints.bounds.lower[self._j])
        constrained = _search(self.within_constraints, estimate, self.unit, radii, least)
        return ProfileEnds(free.ends, constrained.ends)

    def _find_optimum(self, value: float) -> FloatArray:
        """Return the compliances (p,) of the fit without constraints for a compliance of the joint."""
        rows = self._stack_with_others(np.array([value]))[0]
        columns, lengths = unit_columns(rows[:, :-1])
        scaled_unknowns, *_ = np.linalg.lstsq(columns, rows[:, -1], rcond=INDEPENDENT)
        unknowns = scaled_unknowns / lengths
        error_count = self._load.B.shape[1]
        return np.insert(unknowns[error_count:], self._j, value)


class ProfileEnds(NamedTuple):
    """Intervals of a joint's compliance by its profile; an end may be infinite."""

    without_constraints: FloatArray  # (q, 2) [rad/(N·m)]
    within_constraints: FloatArray  # (q, 2) [rad/(N·m)]


class _Search(NamedTuple):
    """Intervals of a profile, and the compliance at its minimum."""

    ends: FloatArray  # (q, 2)
    bottom: float


def _search(
    squares: Callable[[FloatArray], FloatArray],
    start: float,
    unit: float,
    radii: FloatArray,
    least: float,
) -> _Search:
    """Find the intervals (q, 2) in which a profile exceeds its minimum by at most each squared radius.

    The profile is computed on a grid around the estimate; then the minimum and the ends are found between
    points of the grid. An end is infinite, or the lower bound, if the profile is below as far as it was
    computed.

    Args:
        squares: profile: sums of squares (V,) at compliances (V,).
        start: estimate [rad/(N·m)].
        unit: first step from the estimate.
        radii: (q,) square roots of the rises.
        least: lower bound.
    """

    def profile(v: float) -> float:
        """Return the sum of squares at a compliance."""
        return float(squares(np.array([v]))[0])

    steps = unit * _STEPS
    grid = np.concatenate([start - steps, [start], start + steps])
    grid = np.unique(np.clip(grid, least, None))  # ascending
    values = squares(grid)
    lowest = int(values.argmin())
    bottom, minimum = float(grid[lowest]), float(values[lowest])
    if not np.isfinite(minimum):  # the order of the joints excludes every compliance of the grid
        return _Search(np.tile([least, np.inf], (len(radii), 1)), start)
    before, after = grid[max(lowest - 1, 0)], grid[min(lowest + 1, len(grid) - 1)]
    found = minimize_scalar(
        profile,
        bounds=(float(before), float(after)),
        method="bounded",
        options={"maxiter": _MOST_STEPS_TO_MINIMUM, "xatol": _MINIMUM_TOLERANCE * unit},
    )
    if found.fun < minimum:
        bottom, minimum = float(found.x), float(found.fun)

    root_of_rise = np.sqrt(np.maximum(values - minimum, 0.0))
    ends = np.empty((len(radii), 2))
    for row, radius in enumerate(radii.tolist()):

        def excess(v: float, radius: float = radius) -> float:
            """Return by how much the root of the rise exceeds the radius."""
            return float(np.sqrt(max(profile(v) - minimum, 0.0))) - radius

        def find_end(inside: float, beyond: float, excess: Callable[[float], float] = excess) -> float:
            """Return the compliance between two neighbours of the grid at which the rise is the radius."""
            tolerance = _END_TOLERANCE * max(abs(beyond - bottom) / 4.0, unit)
            return float(brentq(excess, inside, beyond, xtol=tolerance))

        inside = np.append(grid[root_of_rise <= radius], bottom)
        first, last = float(inside.min()), float(inside.max())
        below, above = grid[grid < first], grid[grid > last]
        ends[row, 0] = find_end(first, float(below[-1])) if len(below) else least
        ends[row, 1] = find_end(last, float(above[0])) if len(above) else np.inf
    return _Search(ends, bottom)
