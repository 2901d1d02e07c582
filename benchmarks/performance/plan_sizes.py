"""Optimal designs of many candidates: gap, time, memory; and what lists reach."""

from __future__ import annotations

import tracemalloc
from functools import partial

import numpy as np

from benchmarks.performance.candidate_pool import CRITERIA, Pool
from benchmarks.report import Figure, Section, seconds_text
from benchmarks.timing import interleaved
from jointstiff.solver.design.optimum import Design, DesignProblem, optimise
from jointstiff.solver.design.plan import Distinct, exact_design

__all__ = ["run", "run_lists"]

_CANDIDATES, _MANY = 100_000, 1_000_000
_MEGABYTE = 1e6


def run(*, quick: bool) -> list[Section]:
    """Time, gap and memory of 1e5 and of 1e6 candidates."""
    return [_large(Pool.of(2_000 if quick else _CANDIDATES), Pool.of(4_000 if quick else _MANY))]


def run_lists(*, quick: bool) -> list[Section]:
    """Lists of 12 and more out of 1e5, and what is proved of them."""
    return [_lists(Pool.of(2_000 if quick else _CANDIDATES))]


def _weights(problem: DesignProblem) -> Design:
    stated = DesignProblem(problem.candidates, problem.criterion, problem.readings, problem.base)
    return optimise(stated)


def _large(pool: Pool, many: Pool) -> Section:
    rows, figures = [], []
    for name in CRITERIA:
        packing = [
            interleaved({"": partial(each.problem, name)}, rounds=3).median("") for each in (pool, many)
        ]
        problems = [each.problem(name) for each in (pool, many)]
        few, more = (interleaved({"": partial(_weights, problem)}, rounds=7) for problem in problems)
        del problems
        tracemalloc.start()
        found = optimise(many.problem(name))
        peak = tracemalloc.get_traced_memory()[1] / _MEGABYTE
        tracemalloc.stop()
        gaps = [1 - few.results[""].bound.efficiency, 1 - found.bound.efficiency]
        ratio = more.median("") / few.median("")
        times = [
            f"{seconds_text(a)} + {seconds_text(b.median(''))}"
            for a, b in zip(packing, (few, more), strict=True)
        ]
        rows.append(
            (name, times[0], f"{gaps[0]:.1e}", times[1], f"{gaps[1]:.1e}", f"{ratio:.1f}", f"{peak:.0f} MB")
        )
        size, large = f"{len(pool.rows):,}", f"{len(many.rows):,}"
        figures += [
            Figure(f"{name}: gap at {size} candidates", gaps[0], "at most", 1e-6),
            Figure(f"{name}: {large} candidates, time / that of {size}", ratio, "at most", 6, "×"),
            Figure(f"{name}: {large} candidates, memory beyond the rows", peak, "at most", 300, " MB"),
        ]
    return Section(
        title="Many candidates",
        columns=("criterion", f"{len(pool.rows):,}", "gap", f"{len(many.rows):,}", "gap", "ratio", "memory"),
        rows=tuple(rows),
        figures=tuple(figures),
        notes=(
            "times: packing of the rows, linear in their number, + optimising; the ratio is of the latter",
        ),
    )


def _lists(pool: Pool) -> Section:
    rows, figures = [], []
    for name in CRITERIA:
        cells = []
        for angle, required in ((0.0, 0.99), (10.0, 0.98), (15.0, 0.98)):
            worst = 1.0
            for n in (12, 20, 40):
                problem = pool.problem(name, n)
                found = exact_design(problem, optimise(problem), Distinct(pool.joints, np.radians(angle)))
                cells.append(f"{found.efficiency:.4f}")
                worst = min(worst, found.efficiency)
            apart = f"{angle:g}° apart" if angle else "repeats allowed"
            figures.append(
                Figure(
                    f"{name}: lists of 12, 20, 40 {apart}, least efficiency proved",
                    worst,
                    "at least",
                    required,
                )
            )
        rows.append((name, *cells))
    heads = tuple(f"{n}, {a}°" for a in (0, 10, 15) for n in (12, 20, 40))
    return Section(
        title=f"Lists of {len(pool.rows):,} candidates: efficiency proved",
        columns=("criterion", *heads),
        rows=tuple(rows),
        figures=tuple(figures),
    )
