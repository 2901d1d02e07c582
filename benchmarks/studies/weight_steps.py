"""Gearboxes from two encoders: intervals, widths, and mistakes that must not be used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from benchmarks.report import Figure, Part, Section
from jointstiff.solver.gearboxes.outcome import identify_gearboxes
from tests.support.weight_steps import JOINTS, MISTAKES, read, simulate, with_mistake

__all__ = ["run"]

ARMS = 200
COBOTS = 200
SEEDS_OF_MISTAKES = 6


def run(*, quick: bool, part: Part) -> list[Section]:
    """Simulated arms and cobots, planned and random postures, and mistakes of the people who measure."""
    arms, cobots = (6, 6) if quick else (ARMS, COBOTS)
    mistakes = 1 if quick else SEEDS_OF_MISTAKES
    return [
        _cover("planned postures", part.of(arms), widest=2.5),
        _cover("random postures", part.of(arms), widest=4.0, is_planned=False),
        _cover("cobots", part.of(cobots), widest=None, is_cobot=True),
        _mistake(part.of(mistakes)),
    ]


def _cover(name: str, seeds: Sequence[int], *, widest: float | None, **options: bool) -> Section:
    """Count the intervals that contain the truth, and measure their widths."""
    held, widths = [], []
    for seed in seeds:
        simulated = simulate(seed, **options)
        gearboxes = identify_gearboxes(read(simulated.document)).gearboxes
        for joint, gearbox in zip(JOINTS, gearboxes, strict=True):
            lower, upper = gearbox.stiffness_interval or (np.inf, None)
            held.append(lower <= simulated.stiffness[joint] <= (np.inf if upper is None else upper))
            widths.append(np.inf if gearbox.half_width is None else gearbox.half_width)
    share, width = 100.0 * float(np.mean(held)), 100.0 * float(np.median(widths))
    figures = [Figure(f"weight step, {name}: intervals with the truth", share, "at least", 92.5, " %")]
    if widest is not None:
        figures.append(Figure(f"weight step, {name}: no wider than asked", share, "at most", 97.0, " %"))
        figures.append(Figure(f"weight step, {name}: half-width, median", width, "at most", widest, " %"))
    return Section(
        title=f"Weight steps of {len(seeds)} arms, {name}, joints 2 and 3",
        columns=("held", "of", "half-width, median [%]", "95th percentile [%]"),
        rows=(
            (f"{sum(held)}", f"{len(held)}", f"{width:.2f}", f"{100 * float(np.percentile(widths, 95)):.2f}"),
        ),
        figures=tuple(figures),
    )


def _mistake(seeds: Sequence[int]) -> Section:
    """Count the verdicts of steps with a mistake."""
    verdicts = {
        name: Counter(
            identify_gearboxes(read(with_mistake(simulate(seed).document, name, seed))).assessment.verdict
            for seed in seeds
        )
        for name in MISTAKES
    }
    used = sum(counts["use"] for counts in verdicts.values())
    return Section(
        title=f"{len(MISTAKES) * len(seeds)} weight steps with a mistake",
        columns=("mistake", "use", "use with care", "do not use"),
        rows=tuple(
            (name, f"{counts['use']}", f"{counts['use_with_care']}", f"{counts['do_not_use']}")
            for name, counts in verdicts.items()
        ),
        figures=(Figure("weight steps with a mistake that are used", used, "at most", 0),),
    )
