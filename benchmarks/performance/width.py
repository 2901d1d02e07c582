"""Many campaigns by `identify_many`: two processes beside one, and beside this process."""

from __future__ import annotations

import multiprocessing
import os
import resource
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from statistics import median

import jointstiff
from benchmarks.campaigns import small_campaign
from benchmarks.report import Figure, Section, seconds_text
from jointstiff.schemas.run import Campaign

__all__ = ["run"]

HERE, ONE, TWO = "this process", "one process", "two processes"
_WIDTH = {HERE: 0, ONE: 1, TWO: 2}
_BLOCK = 100
"""Campaigns of a turn; the candidates take turns, so that what else the machine does touches all of them."""


@dataclass
class _Candidate:
    """An executor, and what its campaigns took."""

    executor: Executor | None
    seconds: list[float] = field(default_factory=list)  # of each turn
    results: list[str] = field(default_factory=list)  # of the last turn
    here: float = 0.0  # processor time of this process [s]
    elsewhere: float = 0.0  # processor time of the others, with their start [s]

    def turn(self, campaigns: list[Campaign]) -> None:
        """Identify a block of campaigns."""
        processor, start = time.process_time(), time.perf_counter()
        runs = list(jointstiff.identify_many(campaigns, executor=self.executor))
        self.seconds.append(time.perf_counter() - start)
        self.here += time.process_time() - processor
        self.results = [run.model_dump_json(include={"result"}) for run in runs]


def run(*, quick: bool) -> list[Section]:
    """Identify 1,000 campaigns of 20 configurations in each way, 100 at a time."""
    turns, block = (1, 4) if quick else (10, _BLOCK)
    blocks = [[_campaign(turn * block + i) for i in range(block)] for turn in range(turns)]
    candidates: dict[str, _Candidate] = {}
    for name, width in _WIDTH.items():
        candidates[name] = _Candidate(_pool(width) if width else None)
        list(jointstiff.identify_many(blocks[0][:2] * 2, executor=candidates[name].executor))  # imports
    for campaigns in blocks:
        for candidate in candidates.values():
            candidate.turn(campaigns)
    for candidate in candidates.values():
        with _counted(candidate):
            if candidate.executor is not None:
                candidate.executor.shutdown()
    return [_section(candidates, turns * block)]


def _section(candidates: dict[str, _Candidate], count: int) -> Section:
    rows = tuple(
        (
            name,
            seconds_text(sum(candidate.seconds)),
            f"{_ratio(candidates[ONE], candidate):.2f}",
            seconds_text((candidate.here + candidate.elsewhere) / count),
            seconds_text(candidate.here / count),
        )
        for name, candidate in candidates.items()
    )
    differing = sum(
        one != other
        for candidate in candidates.values()
        for one, other in zip(candidate.results, candidates[HERE].results, strict=True)
    )
    ratio = _ratio(candidates[ONE], candidates[TWO])
    return Section(
        title=f"{count:,} campaigns of 20 configurations × 3 targets by identify_many",
        columns=("candidate", "time", "times as fast as one", "processor time each", "of it here"),
        rows=rows,
        figures=(
            Figure("identify_many on two processes: times as fast as on one", ratio, "at least", 1.7, "×"),
            Figure.none("results of the last campaigns whose bits differ between the ways", differing),
        ),
        notes=(
            f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} at the end; ratios are medians",
            "processor time of the processes includes their start, about 2 s each",
        ),
        data={name: candidate.seconds for name, candidate in candidates.items()},
    )


def _campaign(seed: int) -> Campaign:
    return Campaign.model_validate(small_campaign(seed=seed, configurations=20).document)


def _pool(width: int) -> Executor:
    return ProcessPoolExecutor(width, mp_context=multiprocessing.get_context("spawn"))


def _ratio(reference: _Candidate, candidate: _Candidate) -> float:
    pairs = zip(reference.seconds, candidate.seconds, strict=True)
    return median(one / other for one, other in pairs)


@contextmanager
def _counted(candidate: _Candidate) -> Iterator[None]:
    """Add the processor time of the processes that end meanwhile."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    yield
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    candidate.elsewhere += after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
