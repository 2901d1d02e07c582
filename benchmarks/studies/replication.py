"""The paper's study on a documented simulated arm: is its ranking of the methods found again, and why (not)?

By name only: it takes a minute or two. `docs/replication.md` tells what came out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import get_args

import numpy as np

from benchmarks.report import Figure, Section
from benchmarks.studies.replicas import SOURCES, STATED, avoided, read
from benchmarks.studies.resampled_ways import (
    DRAWN,
    FREE,
    POSITIVE,
    SEED,
    WAYS,
    Many,
    Way,
    blocks_of,
    condition_of_raw_columns,
    over_arms,
    resampled,
)
from jointstiff.schemas.run import ResamplingResult
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import Encoders

__all__ = ["run"]

REPETITIONS = 1_000
ARMS, REPETITIONS_EACH = 20, 200
"""Of the tables over many arms."""
LENGTHS = (0.05, 0.2, 0.5, 1.0, 2.0, 10.0, 100.0)
"""Characteristic lengths [m]."""
NOISES = (2e-5, 1e-4, 3e-4)
"""Standard uncertainties of a reading [m]: of a tracker, five and fifteen times as much."""
SPREAD_OF = ("noise", "noise + elastic links", "all as stated")
_ENCODERS: tuple[Encoders, ...] = get_args(Encoders)
_NAMES: dict[Encoders, str] = {"motor": "inactive", "secondary": "active"}


def run(*, quick: bool) -> list[Section]:
    """The paper's table; sources of error one by one; spreads; the characteristic length."""
    arms, repetitions = (2, 10) if quick else (ARMS, REPETITIONS_EACH)
    found = {
        (name, encoders): over_arms(encoders, wrong, WAYS, arms, repetitions)
        for name, wrong in SOURCES.items()
        for encoders in _ENCODERS
    }
    return [
        _table_two(50 if quick else REPETITIONS),
        _sources_section(found, arms, repetitions),
        _spread_section({name: found[name, "motor"] for name in SPREAD_OF}),
        _length_section(arms, repetitions),
    ]


def _table_two(repetitions: int) -> Section:
    rows: list[tuple[str, ...]] = []
    for encoders in _ENCODERS:
        measurements = read(encoders, STATED, seed=SEED)
        for way in WAYS:
            blocks = blocks_of(measurements, way)
            for name, bounds in (("none", FREE), ("positive", POSITIVE)):
                found = resampled(blocks, bounds, repetitions)
                rows.append(
                    (f"{way.name}, {_NAMES[encoders]}", name, *_stiffness_cells(found), *_shares(found))
                )
    truth = [default_arm(encoders).stiffnesses[1:] / 1e6 for encoders in _ENCODERS]
    return Section(
        title=f"Table II again: {DRAWN} of 19, {repetitions:,} times, 10⁶ N·m/rad, mean & standard deviation",
        columns=("method, encoders", "constraints", "k2", "k3", "k4", "k5", "k6", "negative", "compensation"),
        rows=tuple(rows),
        notes=(
            f"all sources of error as stated: {STATED}; seed {SEED}",
            *(
                f"springs of the joints, {_NAMES[encoders]}: " + ", ".join(f"{k:g}" for k in stiffness)
                for encoders, stiffness in zip(_ENCODERS, truth, strict=True)
            ),
            f"active encoders avoid {100 * avoided(STATED, seed=SEED):.0f} % of the mean deflection",
        ),
    )


def _stiffness_cells(found: ResamplingResult) -> Iterator[str]:
    stiffness = [(joint.stiffness_mean, joint.stiffness_deviation) for joint in found.joints[1:]]
    for mean, deviation in np.array(stiffness, dtype=np.float64):
        yield f"{mean / 1e6:.3g} & {deviation / 1e6:.2g}"


def _shares(found: ResamplingResult) -> tuple[str, str]:
    return f"{100 * found.share_any_negative:.1f} %", f"{100 * (found.compensation.mean or np.nan):.2f} %"


def _sources_section(found: dict[tuple[str, Encoders], Many], arms: int, repetitions: int) -> Section:
    rows = [
        (f"{name}, {_NAMES[encoders]}", *_many_cells(many), *_ranking_cells(many))
        for (name, encoders), many in found.items()
    ]
    return Section(
        title=f"Sources of error one by one: {arms} arms, {repetitions} draws of {DRAWN} of 19 each",
        columns=("source, encoders", *(way.name for way in WAYS), "CP < PP", "PP ≤ DPP"),
        rows=tuple(rows),
        figures=(
            Figure(
                "replication, unconstrained: greatest share of draws with a negative stiffness",
                max(100 * float(many.negative.max()) for many in found.values()),
                "at least",
                0.1,
                " %",
            ),
            Figure(
                "replication, positive: greatest share of draws with a negative stiffness",
                max(many.negative_if_positive for many in found.values()),
                "at most",
                0,
            ),
        ),
        notes=(
            "cells, unconstrained: mean compensation on all 19 (share of draws with a negative stiffness)",
            "CP < PP, PP ≤ DPP: arms on which it holds of the compensation; CP with the L of least condition",
            f"as stated: {STATED}",
        ),
        data={
            f"{name}, {encoders}": {
                "compensation": many.compensation.tolist(),
                "negative": many.negative.tolist(),
            }
            for (name, encoders), many in found.items()
        },
    )


def _many_cells(many: Many) -> Iterator[str]:
    for share, negative in zip(many.compensation.mean(axis=0), many.negative.mean(axis=0), strict=True):
        yield f"{100 * share:.2f} ({100 * negative:.1f}) %"


def _ranking_cells(many: Many) -> tuple[str, str]:
    """Count the arms on which each half of the paper's ranking is found."""
    of = {way.name: share for way, share in zip(WAYS, many.compensation.T, strict=True)}
    halves = (of["CP, best L"] < of["PP"], of["PP"] <= of["DPP"])
    below, not_above = (f"{int(half.sum())} of {len(half)}" for half in halves)
    return below, not_above


def _spread_section(found: dict[str, Many]) -> Section:
    """Print the dispersion of the draws: the paper's standard deviations."""
    rows = [
        (
            f"{name}: {way.name}",
            *(f"{100 * share:.2f}" for share in np.median(many.deviation[:, number, 1:], axis=0)),
        )
        for name, many in found.items()
        for number, way in enumerate(WAYS)
    ]
    return Section(
        title="Standard deviation of a compliance over the draws, % of its mean: medians over the arms",
        columns=("source: method", "c2", "c3", "c4", "c5", "c6"),
        rows=tuple(rows),
        notes=("encoders inactive, unconstrained",),
    )


def _length_section(arms: int, repetitions: int) -> Section:
    ways = [Way(f"{length:g} m", "complete_pose", "characteristic_length", length) for length in LENGTHS]
    ways += [WAYS[0], *WAYS[2:]]
    rows: list[tuple[str, ...]] = []
    columns = [over_arms("motor", replace(STATED, sigma=noise), ways, arms, repetitions) for noise in NOISES]
    clean = read("motor", STATED, seed=SEED)
    for number, way in enumerate(ways):
        cells = [list(_many_cells(many))[number] for many in columns]
        condition = f"{condition_of_raw_columns(clean, way.length):.0f}" if way.length else ""
        rows.append((way.name if way.length is None else f"CP, L = {way.name}", condition, *cells))
    return Section(
        title=f"Complete pose with a characteristic length, encoders inactive: means over {arms} arms",
        columns=("method", "condition, raw", *(f"{1e6 * noise:g} µm" for noise in NOISES)),
        rows=tuple(rows),
        notes=(
            "all other sources as stated; cells as above",
            "condition, raw: of the regressor, columns as they come: it falls with L without end. Best "
            "L: of least condition, that of columns of unit norm",
        ),
    )
