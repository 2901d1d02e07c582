"""Efficiency: spread of the estimates compared with the Cramér-Rao bound and with the reported one.

By name only: it takes a minute or two.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.designs import planned_design
from benchmarks.report import Figure, Section
from benchmarks.studies.coverage import interior_campaigns
from benchmarks.studies.verdicts import METHODS, Verdicts, Way, judge
from jointstiff.simulator import default_arm
from jointstiff.solver.arrays import FloatArray

__all__ = ["Spread", "run", "spreads"]


DESIGNS, DRAWS = 20, 250
_NOTES = (
    "empirical: standard deviation about the mean of each design, pooled over designs in units of the bound",
    "bound: inverse Fisher information of the deflections, from a numerical derivative of the exact "
    "simulator; no code of the solver has a part in it",
    "bias: |mean error| of the design that has the greatest",
    "complete pose by covariance is the same estimate as partial pose",
)


@dataclass(frozen=True)
class Spread:
    """Errors of the estimates of a method, for each of n joints.

    Attributes:
        over_bound: empirical standard deviation over the Cramér-Rao bound.
        reported_over_empirical: standard uncertainty as reported over the empirical standard deviation.
        bias_over_bound: greatest |mean error| of a design over the bound.
    """

    over_bound: tuple[float, ...]
    reported_over_empirical: tuple[float, ...]
    bias_over_bound: tuple[float, ...]

    @classmethod
    def of(cls, verdicts: Verdicts, bounds: FloatArray) -> Spread:
        """Spread of campaigns that follow each other design by design.

        Args:
            verdicts: of D designs, equally many campaigns of each.
            bounds: (D, n) least standard deviations [rad/(N·m)].
        """
        shape = (len(bounds), -1, bounds.shape[1])
        errors = (verdicts.compliance - verdicts.truth).reshape(shape) / bounds[:, None]
        reported = verdicts.standard_uncertainty.reshape(shape) / bounds[:, None]
        variance = errors.var(axis=1, ddof=1).mean(axis=0)
        return cls(
            over_bound=tuple(np.sqrt(variance).tolist()),
            reported_over_empirical=tuple(np.sqrt(np.square(reported).mean(axis=(0, 1)) / variance).tolist()),
            bias_over_bound=tuple(np.abs(errors.mean(axis=1)).max(axis=0).tolist()),
        )


def run(*, quick: bool) -> list[Section]:
    """Partial pose and decoupled on the same campaigns, K_c included, sigma given."""
    designs, draws = (2, 5) if quick else (DESIGNS, DRAWS)
    found = spreads([Way(method) for method in METHODS if method != "complete pose"], designs, draws)
    error = 100.0 / np.sqrt(2.0 * designs * (draws - 1))
    n = len(default_arm().stiffnesses)
    return [
        Section(
            title=f"Efficiency: {designs * draws:,} campaigns of {designs} designs",
            columns=("", *(f"joint {j + 1}" for j in range(n))),
            rows=tuple(row for way, of_way in found.items() for row in _rows(way, of_way)),
            figures=tuple(figure for way, of_way in found.items() for figure in _figures(way, of_way)),
            notes=(*_NOTES, f"standard error of an empirical standard deviation: {error:.1f} %"),
            data={way.method: asdict(of_way) for way, of_way in found.items()},
        )
    ]


def spreads(ways: list[Way], designs: int, draws: int) -> dict[Way, Spread]:
    """Spread of each way to identify, over planned designs with interior truth."""
    verdicts = judge(ways, interior_campaigns(designs, draws))
    plans = [planned_design(default_arm(), seed=seed) for seed in range(designs)]
    bounds = np.array([np.sqrt(np.diag(plan.cramer_rao())) for plan in plans])
    return {way: Spread.of(verdicts[way], bounds) for way in ways}


def _rows(way: Way, found: Spread) -> Iterator[tuple[str, ...]]:
    for what, values in (
        ("empirical / bound", found.over_bound),
        ("reported / empirical", found.reported_over_empirical),
        ("bias / bound", found.bias_over_bound),
    ):
        yield (f"{way.method}: {what}", *(f"{value:.3f}" for value in values))


def _figures(way: Way, found: Spread) -> Iterator[Figure]:
    if way.method == "partial pose":
        greatest = max(found.over_bound)
        yield Figure("partial pose: empirical deviation over Cramér-Rao bound", greatest, "at most", 1.03)
    if way.method == "decoupled":
        off = max(abs(value - 1.0) for value in found.reported_over_empirical)
        yield Figure("decoupled: reported against empirical deviation", 100.0 * off, "at most", 5.0, " %")
