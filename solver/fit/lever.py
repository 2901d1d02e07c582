"""Joints near the line of the load: intervals with the load point free (method.md §8).

A compliance times an error of the load is a product of two unknowns. Far from the line of the load, rows of
statements at the fitted compliances are exact enough. Where the lever of a
joint is as short as the load point is uncertain, a joint can be as stiff as the fit says and the lever be as
stated, or the joint be soft and the lever shorter. For such a joint j the interval is the profile

    P_j(v) = min over c', e of ‖A' c' + A_j v + B(ĉ with c_j = v) e − d‖² + σ² ‖e‖²

over the other compliances c' (columns A') within their constraints and the errors e in standard uncertainties:
a convex program for each v. The interval has no upper end where a shorter lever explains any compliance; a bound of
the joint's own does not change that. All methods have the same profile, that of all readings weighted by
covariance.
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
        """Compress the rows of a campaign; None if no joint has a short lever.

        Args:
            rows: N observations, in balance with the fitted compliances.
            settings: constraints and prior; method and weighting do not matter.
            statements: what is stated of load and places, at the fitted compliances.
            joints: (p,) joints that the readings show, ascending.
        """
        if not any(term.name in BY_JOINT for term in statements.terms):
            return None
        sample = rows.select_evenly(_SAMPLE) if len(rows) > _SAMPLE else rows
        free = cls._compress(sample, settings, statements, joints)
        if not free.weak.any():
            return None
        return free if sample is rows else cls._compress(rows, settings, statements, joints)

    @classmethod
    def _compress(
        cls, rows: Rows, settings: Settings, statements: Statements, joints: IndexArray
    ) -> FreeLoad:
        n, of_load = rows.robot.n, [term for term in statements.terms if term.name in BY_JOINT]
        split = Statements(
            (*statements.terms, *(BY_JOINT[term.name] for term in of_load)),
            statements.common,
            statements.compliance,
            statements.sigma,
        )
        all_readings = replace(settings, method="partial_pose", weighting="covariance")
        method, prior = Method(rows.robot, all_readings, None), settings.prior
        triangle: Triangle | None = None
        for of_block in split.generate(rows, [JOINTS]):
            triangle = triangle or Triangle(**of_block.widths)
            triangle.add(next(method.map_rows(of_block)).fitted)
        if triangle is None:
            raise ValueError("no observations")
        R, span = triangle.R, triangle.span
        stated = np.concatenate([span[term.name] for term in statements.terms])
        levers = np.zeros((len(R), n, len(stated)))
        for term in of_load:
            of_term = np.searchsorted(stated, span[term.name])
            levers[:, :, of_term] = R[:, span[BY_JOINT[term.name].name]].reshape(len(R), n, -1)
        A, B, d = R[:, joints], R[:, stated], R[:, -1]
        if prior is not None:
            matrix, values = prior.in_units_of(statements.sigma).rows(joints)
            A, d = np.vstack([A, matrix]), np.concatenate([d, values])
            B = np.vstack([B, np.zeros((len(matrix), B.shape[1]))])
            levers = np.concatenate([levers, np.zeros((len(matrix), *levers.shape[1:]))])
        return cls(
            joints=joints,
            A=A,
            B=B,
            levers=levers[:, joints],
            d=d,
            compliance=statements.compliance[joints],
            sigma=statements.sigma,
            constraints=settings.constraints.select(joints),
        )

    @cached_property
    def ratios(self) -> FloatArray:
        """Effect (p,) of each joint's compliance by the stated load over that by errors of the load."""
        by_errors = np.sqrt(np.square(self.levers).sum(axis=(0, 2)))
        by_load = np.linalg.norm(self.A, axis=0)
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
        """Project the columns that do not depend on the joint's compliance out of all others."""
        self._load, self._j = load, j
        self._others = np.delete(np.arange(len(load.joints)), j)
        self.programs = 0
        effect = np.hypot(np.linalg.norm(load.A[:, j]), np.linalg.norm(load.levers[:, j]))
        self.unit = load.sigma / float(effect)  # least standard uncertainty of the joint [rad/(N·m)]
        # Whether the readings leave an upper end does not depend on the joint's own upper bound.
        bounds = load.constraints.bounds
        upper = np.where(np.arange(len(load.joints)) == j, np.inf, bounds.upper)
        self._constraints = replace(load.constraints, bounds=Bounds(bounds.lower, upper))

    @cached_property
    def _without_others(self) -> tuple[FloatArray, ...]:
        """Columns of the joint, statements and levers, and the readings; other joints are projected out."""
        load, j = self._load, self._j
        basis = orthonormal_basis(unit_columns(load.A[:, self._others])[0], INDEPENDENT)
        columns = (load.A[:, j : j + 1], load.B, load.levers[:, j], load.d[:, None])
        return tuple(each - basis @ (basis.T @ each) for each in columns)

    def without_constraints(self, compliance: FloatArray) -> FloatArray:
        """Return the least sums of squares (V,) at compliances (V,) of the joint, without constraints."""
        a, B, lever, d = self._without_others
        rows = self._stack(compliance, a, B, lever, d)
        return np.square(compute_triangular_factor(rows)[:, -1, -1])

    def within_constraints(self, compliance: FloatArray) -> FloatArray:
        """Return the least sums of squares (V,) at compliances (V,) of the joint, within the constraints."""
        load, j, errors = self._load, self._j, self._load.B.shape[1]
        rows = self._stack(compliance, load.A[:, j : j + 1], load.B, load.levers[:, j], load.d[:, None])
        others = np.zeros((*rows.shape[:2], len(self._others)))
        others[:, : len(load.A)] = load.A[:, self._others]
        rows = np.concatenate([rows[..., :-1], others, rows[..., -1:]], axis=-1)
        factors = compute_triangular_factor(rows)[:, errors:, errors:]
        return np.array(
            [self._solve(value, factor) for value, factor in zip(compliance, factors, strict=True)]
        )

    def _stack(
        self, compliance: FloatArray, a: FloatArray, B: FloatArray, lever: FloatArray, d: FloatArray
    ) -> FloatArray:
        """Return rows (V, m + K, K + 1) of the errors for each compliance, then one statement for each."""
        load = self._load
        at_value = B + (compliance - load.compliance[self._j])[:, None, None] * lever
        remaining = d - compliance[:, None, None] * a
        errors = B.shape[1]
        rows = np.zeros((len(compliance), len(d) + errors, errors + 1))
        rows[:, : len(d), :-1], rows[:, : len(d), -1:] = at_value, remaining
        rows[:, len(d) :, :-1] = load.sigma * np.eye(errors)
        return rows

    def _solve(self, value: float, factor: FloatArray) -> float:
        """Return the least sum of squares over the other compliances; infinite if none is feasible."""
        self.programs += 1
        try:
            left = self._constraints.fix_joints(np.array([self._j]), np.array([value]), self._others)
        except RequestError:  # the order of the joints excludes this compliance
            return np.inf
        R, z = factor[:, :-1], factor[:, -1]
        solution = solve_step(IdentificationProblem(R, z, left.bounds, left.inequalities))
        return float(np.square(R @ solution.compliance - z).sum())

    def find_ends(self, radii: FloatArray) -> ProfileEnds:
        """Return the intervals of the joint's compliance, without its own upper bound.

        Args:
            radii: (q,) half-widths in standard uncertainties, times sigma.
        """
        estimate = float(self._load.compliance[self._j])
        free = _search(self.without_constraints, estimate, self.unit, radii, -np.inf)
        # Where the optimum without constraints meets the constraints, it is the optimum within them, too, and
        # the sums of squares within constraints are nowhere less: that interval lies within this one.
        if self._constraints.are_satisfied_by(self._find_optimum(free.bottom)):
            return ProfileEnds(free.ends, free.ends)
        least = float(self._constraints.bounds.lower[self._j])
        return ProfileEnds(
            free.ends, _search(self.within_constraints, estimate, self.unit, radii, least).ends
        )

    def _find_optimum(self, value: float) -> FloatArray:
        """Return the compliances (p,) of the fit without constraints for a compliance of the joint."""
        load, j, errors = self._load, self._j, self._load.B.shape[1]
        rows = self._stack(
            np.array([value]), load.A[:, j : j + 1], load.B, load.levers[:, j], load.d[:, None]
        )[0]
        others = np.zeros((len(rows), len(self._others)))
        others[: len(load.A)] = load.A[:, self._others]
        columns, length = unit_columns(np.hstack([rows[:, :-1], others]))
        unknowns = np.linalg.lstsq(columns, rows[:, -1], rcond=INDEPENDENT)[0] / length
        return np.insert(unknowns[errors:], j, value)


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
    """Return the intervals (q, 2) in which a profile exceeds its minimum by at most each squared radius.

    An end is infinite, or the lower bound, if the profile stays below as far as it was computed.

    Args:
        squares: profile: sums of squares (V,) at compliances (V,).
        start: estimate [rad/(N·m)].
        unit: first step from the estimate.
        radii: (q,) square roots of the rises.
        least: lower bound.
    """
    steps = unit * _STEPS
    grid = np.unique(np.clip(np.concatenate([start - steps, [start], start + steps]), least, None))
    values = squares(grid)
    lowest = int(values.argmin())
    bottom, minimum = float(grid[lowest]), float(values[lowest])
    if not np.isfinite(minimum):  # the order of the joints excludes every compliance of the grid
        return _Search(np.tile([least, np.inf], (len(radii), 1)), start)
    found = minimize_scalar(
        lambda v: float(squares(np.array([v]))[0]),
        bounds=(float(grid[max(lowest - 1, 0)]), float(grid[min(lowest + 1, len(grid) - 1)])),
        method="bounded",
        options={"maxiter": _MOST_STEPS_TO_MINIMUM, "xatol": _MINIMUM_TOLERANCE * unit},
    )
    if found.fun < minimum:
        bottom, minimum = float(found.x), float(found.fun)
    rise = np.sqrt(np.maximum(values - minimum, 0.0))
    ends = np.empty((len(radii), 2))
    for row, radius in enumerate(radii.tolist()):

        def above(v: float, radius: float = radius) -> float:
            """Return by how much the root of the rise exceeds the radius."""
            return float(np.sqrt(max(float(squares(np.array([v]))[0]) - minimum, 0.0))) - radius

        inside = np.append(grid[rise <= radius], bottom)
        for side, last, beyond in (
            (0, inside.min(), grid[grid < inside.min()][::-1]),
            (1, inside.max(), grid[grid > inside.max()]),
        ):
            if not len(beyond):
                ends[row, side] = least if side == 0 else np.inf
                continue
            tolerance = _END_TOLERANCE * max(abs(float(beyond[0]) - bottom) / 4.0, unit)
            ends[row, side] = brentq(above, last, float(beyond[0]), xtol=tolerance)
    return _Search(ends, bottom)
