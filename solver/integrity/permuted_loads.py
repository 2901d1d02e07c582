"""Loads that belong to other rows: sorted by size, exchanged, or in any other order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.integrity.values import View
from jointstiff.solver.mechanics.block import get_whole_block
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import PAST_DO_NOT_USE

_LEAST_ROWS: Final = 8
"""Least number of observations whose order is searched: few fit well in some order by chance."""
_MOST_ROWS: Final = 100
"""Greatest number of observations whose order is searched: each load is tried in each row."""
_LEAST_COORDINATES: Final = 3
"""Least number of coordinates of an observation: one length fits in some order by chance."""
_MOST_COORDINATES: Final = 60
"""Greatest number of coordinates of an observation: each load is tried in each row, which takes memory."""
_WORTH_A_SEARCH: Final = 0.3
"""Unexplained share of the deflections above which an order is searched: joints of real robots leave less."""
_EXPLAINED: Final = 0.25
"""Greatest unexplained share in the order that is found: orders of unrelated loads leave over 0.4."""
_BETTER: Final = 0.35
"""Greatest ratio of the unexplained share in the order that is found to that as posted."""
_ROUNDS: Final = 20
"""Greatest number of rounds in which compliances and order are found in turns."""
_SAME: Final = 1e-6
"""Greatest difference of equal loads, relative to the largest load."""
_SHOWN: Final = 3
"""Number of observations that the finding names."""


@dataclass(frozen=True, eq=False)
class _LoadsInRows:
    """Deflections of N observations, and what each load does in the posture of each row."""

    A: FloatArray  #: (N, N, m, n) regressors by row and load [m / (rad/(N·m))]
    d: FloatArray  #: (N, m) deflections [m]; zero where not read

    @classmethod
    def of(cls, robot: Robot, measurements: Measurements) -> _LoadsInRows:
        """Compute the regressors from those of the components of forces and moments, which add up."""
        count = len(measurements)
        components = []
        for force, moment in zip(np.eye(6, 3), np.eye(6, 3, -3), strict=True):
            of_unit = replace(
                measurements, force=np.tile(force, (count, 1)), moment=np.tile(moment, (count, 1))
            )
            components.append(get_whole_block(robot, of_unit).A.reshape(count, -1, robot.n))
        loads = np.hstack([measurements.force, measurements.moment])
        A = np.einsum("jk,kimn->ijmn", loads, np.array(components), optimize=True)
        return cls(A, measurements.deflection.reshape(count, -1))

    def fit(self, order: IndexArray) -> FloatArray:
        """Return the compliances (n,) that explain the deflections best with the load `order[i]` in row i."""
        A = self.A[np.arange(len(order)), order].reshape(-1, self.A.shape[-1])
        sizes = np.linalg.norm(A, axis=0)
        sizes[sizes == 0.0] = 1.0
        return np.asarray(np.linalg.lstsq(A / sizes, self.d.ravel(), rcond=None)[0] / sizes)

    def assign(self, compliance: FloatArray) -> IndexArray:
        """Return the order (N,) of the loads that leaves the least sum of squares with given compliances."""
        cost = ((self.d[:, None] - self.A @ compliance) ** 2).sum(axis=2)
        return np.asarray(linear_sum_assignment(cost)[1])

    def measure_unexplained(self, order: IndexArray, compliance: FloatArray) -> float:
        """Return the share of the deflections, by their root mean squares, that remains unexplained."""
        predicted = self.A[np.arange(len(order)), order] @ compliance
        return float(np.linalg.norm(self.d - predicted) / np.linalg.norm(self.d))

    def measure_unexplained_by_exchanged_states(self) -> float:
        """Return the share that remains if some rows have exchanged states, which reverses deflections."""
        as_posted = np.arange(len(self.d))
        predicted = self.A[as_posted, as_posted]
        signs = np.ones(len(self.d))
        for _ in range(_ROUNDS):
            exchanged = replace(self, d=signs[:, None] * self.d)
            work = np.einsum("im,im->i", self.d, predicted @ exchanged.fit(as_posted))
            refined = np.where(work < 0.0, -1.0, 1.0)
            if np.array_equal(refined, signs):
                break
            signs = refined
        exchanged = replace(self, d=signs[:, None] * self.d)
        return exchanged.measure_unexplained(as_posted, exchanged.fit(as_posted))

    def guess_compliances(self) -> list[FloatArray]:
        """Return compliances (n,) to begin with: those as posted, and joints that bend alike."""
        as_posted = np.arange(len(self.d))
        guesses = [self.fit(as_posted)]
        sizes = np.sqrt((self.A**2).mean(axis=(0, 1, 2)))
        seen = sizes > 0.0
        for exponent in (0.0, 1.0, 2.0):  # from equal joints to weak joints with short levers
            guess = np.zeros(len(sizes))
            guess[seen] = sizes[seen] ** -exponent
            own = np.linalg.norm(self.A[as_posted, as_posted] @ guess, axis=1)
            guesses.append(guess * np.median(np.linalg.norm(self.d, axis=1)) / max(np.median(own), 1e-30))
        return guesses


@dataclass(frozen=True, eq=False)
class FoundOrder:
    """The order of the loads of N observations in which joints explain the deflections best."""

    order: IndexArray  #: (N,) row of the load that fits each row
    is_other: BoolArray  #: (N,) whether the fitting load differs from that of the row
    before: float  #: unexplained share of the deflections as posted
    after: float  #: unexplained share with the loads in this order


def find_order_of_loads(view: View, measurements: Measurements) -> FoundOrder | None:
    """Search the order of loads that explains the deflections; None unless it explains far more than posted.

    Args:
        view: measurement set.
        measurements: its observations that are checked, with loads.
    """
    count = len(measurements)
    has_few_coordinates = np.median(measurements.coordinates.sum(axis=1)) < _LEAST_COORDINATES
    has_many_coordinates = measurements.deflection[0].size > _MOST_COORDINATES
    if not _LEAST_ROWS <= count <= _MOST_ROWS or has_few_coordinates or has_many_coordinates:
        return None
    loads = np.hstack([measurements.force, measurements.moment])
    is_one_load = bool((np.abs(loads - loads[0]) <= _SAME * np.abs(loads).max()).all())
    if is_one_load or not measurements.deflection.any():
        return None
    trials, as_posted = _LoadsInRows.of(view.robot, measurements), np.arange(count)
    before = trials.measure_unexplained(as_posted, trials.fit(as_posted))
    if before < _WORTH_A_SEARCH:
        return None
    orders = [_refine_order(trials, guess) for guess in trials.guess_compliances()]
    shares = [trials.measure_unexplained(order, trials.fit(order)) for order in orders]
    best = int(np.argmin(shares))
    after, order = shares[best], orders[best]
    is_other = np.abs(loads[order] - loads).max(axis=1) > _SAME * np.abs(loads).max()
    if after > min(_EXPLAINED, _BETTER * before) or not is_other.any():
        return None
    if trials.measure_unexplained_by_exchanged_states() < after:
        return None  # another check names the rows with exchanged states
    return FoundOrder(order, is_other, before, after)


def report_order_of_loads(view: View, measurements: Measurements, found: FoundOrder) -> Finding:
    """Return the finding that the loads belong to other rows, with some rows and the loads that fit them."""
    sorted_by = _find_sorted_quantity(measurements.force)
    cause = "the forces belong to other rows"
    if sorted_by:
        cause = f"the forces are sorted by {sorted_by}, but the readings are not"
    labels, count = measurements.labels, len(measurements)
    shown = np.flatnonzero(found.is_other)[:_SHOWN]
    named = [f"'{labels[i]}' fits the force of '{labels[found.order[i]]}'" for i in shown]
    return view.build_finding(
        "observations_out_of_order",
        f"{cause}: joint compliances leave {100.0 * found.before:.3g} % of the deflections unexplained, and "
        f"with the forces of {int(found.is_other.sum())} of {count} observations in another order "
        f"{100.0 * found.after:.3g} %: {', '.join(named)}",
        f"match the forces with the observations again, row by row; {PAST_DO_NOT_USE}",
        "do_not_use",
    )


def _refine_order(trials: _LoadsInRows, compliance: FloatArray) -> IndexArray:
    """Return the order (N,) of the loads in which the deflections are explained best, from a first guess."""
    order = trials.assign(compliance)
    for _ in range(_ROUNDS):
        refined = trials.assign(trials.fit(order))
        if np.array_equal(refined, order):
            break
        order = refined
    return order


def _find_sorted_quantity(force: FloatArray) -> str:
    """Return the quantity by which forces (N, 3) are sorted: their size or an axis; empty if by none."""
    quantities = {"size": np.linalg.norm(force, axis=1)}
    quantities |= {f"their component along {axis}": force[:, k] for k, axis in enumerate("xyz")}
    for name, values in quantities.items():
        steps = np.diff(values)
        has_several = len(np.unique(values)) > len(values) // 2
        if has_several and ((steps >= 0.0).all() or (steps <= 0.0).all()):
            return name
    return ""
