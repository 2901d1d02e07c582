"""19 configurations of three targets, in process: a usual campaign."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

import numpy as np

from benchmarks.campaigns import LARGE_NOISE, SIGMA, Campaign, default_settings, small_campaign
from benchmarks.performance.peers import (
    bounded_least_squares,
    cvxpy_clarabel,
    proxqp,
    scipy_nnls,
    stacked_rows,
)
from benchmarks.report import Figure, Section, times_table
from benchmarks.timing import Times, interleaved
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.rows import Rows
from tests.reference.exact_nnls import exact_nnls

__all__ = ["run"]


OURS = "identify: angles → estimate"
NAIVE = "rows → fresh cvxpy + Clarabel"
_NOTES = (
    "relative error: of the compliances, against exact rational arithmetic on the same rows",
    "ours includes kinematics, rows, identifiability, uncertainties and certificate; the others begin at "
    "ready-made rows",
)


def run(*, quick: bool) -> list[Section]:
    """Compare identify with its peers where no bound is active, and where one or more are."""
    cases: tuple[tuple[str, float, float, Callable[[Campaign], bool]], ...] = (
        ("no active bound", 2.5, SIGMA, lambda campaign: not _at_bound(campaign).any()),
        ("bounds active where least squares violates them", 1.7, LARGE_NOISE, _projection_suffices),
        ("bounds active elsewhere, too", 1.6, LARGE_NOISE, _projection_misleads),
    )
    rounds = 3 if quick else 200
    return [_section(name, faster, _first(sigma, fits), rounds) for name, faster, sigma, fits in cases]


def _section(case: str, faster: float, campaign: Campaign, rounds: int) -> Section:
    A, d = stacked_rows(campaign.robot, campaign.measurements)
    times = _times(campaign, A, d, rounds)
    estimate: Estimate = times.results[OURS]
    errors = _errors(times, estimate, A, d)
    shown = {who: "no answer" if error is None else f"{error:.1e}" for who, error in errors.items()}
    columns, rows = times_table(times, OURS, [("relative error", shown)])
    what = f"19 configurations, {case}: fresh cvxpy on the stacked rows, time / ours"
    solved_by = estimate.certificates[0].solved_by
    at_zero = int((estimate.compliance == 0.0).sum())
    return Section(
        title=f"19 configurations × 3 targets, {case}",
        columns=columns,
        rows=rows,
        figures=(Figure(what, times.ratio(NAIVE, OURS), "at least", faster, "×"),),
        notes=(f"{at_zero} of 6 compliances at zero; our support by {solved_by}", *_NOTES),
        data={"seconds": times.seconds, "relative_error": errors},
    )


def _times(campaign: Campaign, A: FloatArray, d: FloatArray, rounds: int) -> Times:
    """Ours and cvxpy in turns; the others after that, so that a slow one does not empty ours' caches."""
    robot, measurements, settings = campaign.robot, campaign.measurements, default_settings(campaign.robot)
    pair = interleaved(
        {
            OURS: lambda: identify(Rows(robot, measurements), settings),
            NAIVE: lambda: cvxpy_clarabel(A, d),
        },
        rounds=rounds,
        warm_up=3,
    )
    others = interleaved(
        {
            "rows → scipy nnls": lambda: scipy_nnls(A, d),
            "rows → scipy lsq_linear, bvls": lambda: bounded_least_squares(A, d),
            "rows → qpsolvers, ProxQP": lambda: proxqp(A, d),
        },
        rounds=rounds,
        warm_up=3,
    )
    return Times(pair.seconds | others.seconds, pair.results | others.results)


def _errors(times: Times, estimate: Estimate, A: FloatArray, d: FloatArray) -> dict[str, float | None]:
    """Greatest error of a compliance relative to it, or to the smallest one where it is zero."""
    exact = np.array([float(value) for value in exact_nnls(A, d)])
    size = np.where(exact > 0, exact, exact[exact > 0].min())
    answers = {**times.results, OURS: estimate.compliance}
    errors = {who: float((np.abs(answer - exact) / size).max()) for who, answer in answers.items()}
    return {who: error if np.isfinite(error) else None for who, error in errors.items()}


def _first(sigma: float, fits: Callable[[Campaign], bool]) -> Campaign:
    """The campaign of the least seed that fits."""
    return next(c for c in (small_campaign(sigma=sigma, seed=seed) for seed in count()) if fits(c))


def _at_bound(campaign: Campaign) -> BoolArray:
    return np.asarray(scipy_nnls(*stacked_rows(campaign.robot, campaign.measurements)) == 0.0)


def _negative(campaign: Campaign) -> BoolArray:
    A, d = stacked_rows(campaign.robot, campaign.measurements)
    return np.asarray(np.linalg.lstsq(A, d, rcond=None)[0] < 0.0)


def _projection_suffices(campaign: Campaign) -> bool:
    active = _at_bound(campaign)
    return bool(active.any()) and np.array_equal(active, _negative(campaign))


def _projection_misleads(campaign: Campaign) -> bool:
    return not np.array_equal(_at_bound(campaign), _negative(campaign))
