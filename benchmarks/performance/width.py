"""Many campaigns by `identify_many`: two processes beside one, and beside this process.

One campaign of some 80 compares elastic models, which takes as long as hundreds of others.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import jointstiff
from benchmarks.campaigns import small_campaign
from benchmarks.report import Figure, Section, seconds_text
from jointstiff.schemas.run import Campaign

__all__ = ["run"]

HERE, ONE, TWO = "this process", "one process", "two processes"
_WIDTH = {HERE: 0, ONE: 1, TWO: 2}
_BLOCK = 1_000
"""Campaigns at once: the last of a call may be one that takes long, while others have nothing to do."""


@dataclass
class _Candidate:
    """An executor, and what its campaigns took."""

    executor: Executor | None
    processes: list[int]  # ids of its processes
    seconds: float = 0.0
    results: list[str] = field(default_factory=list)
    failed: int = 0
    here: float = 0.0  # processor time of this process [s]
    elsewhere: float = 0.0  # processor time of its processes [s]

    def identify(self, campaigns: list[Campaign]) -> None:
        """Identify all campaigns."""
        before, processor, start = self._used(), time.process_time(), time.perf_counter()
        runs = list(jointstiff.identify_many(campaigns, executor=self.executor))
        self.seconds = time.perf_counter() - start
        self.here = time.process_time() - processor
        self.elsewhere = self._used() - before
        self.failed = sum(run.state != "succeeded" for run in runs)
        self.results = [run.model_dump_json(include={"result"}) for run in runs]

    @property
    def processor(self) -> float:
        """Processor time of all [s]."""
        return self.here + self.elsewhere

    def _used(self) -> float:
        """Return the processor time that its processes have used [s]."""
        stats = [Path(f"/proc/{each}/stat").read_text().rpartition(")")[2].split() for each in self.processes]
        return sum(int(stat[11]) + int(stat[12]) for stat in stats) / os.sysconf("SC_CLK_TCK")


def run(*, quick: bool) -> list[Section]:
    """Identify 1,000 campaigns of 20 configurations in each way."""
    block = 4 if quick else _BLOCK
    campaigns = [_campaign(i) for i in range(block)]
    candidates: dict[str, _Candidate] = {}
    for name, width in _WIDTH.items():
        known = {child.pid for child in multiprocessing.active_children()}
        executor = _pool(width) if width else None
        list(jointstiff.identify_many(campaigns[:2] * 8, executor=executor))  # imports
        new = {child.pid for child in multiprocessing.active_children()} - known
        candidates[name] = _Candidate(executor, sorted(pid for pid in new if pid is not None))
    for candidate in candidates.values():
        candidate.identify(campaigns)
    for candidate in candidates.values():
        if candidate.executor is not None:
            candidate.executor.shutdown()
    return [_section(candidates, block)]


def _section(candidates: dict[str, _Candidate], count: int) -> Section:
    rows = tuple(
        (
            name,
            seconds_text(candidate.seconds),
            f"{candidates[ONE].seconds / candidate.seconds:.2f}",
            seconds_text(candidate.processor / count),
            seconds_text(candidate.here / count),
        )
        for name, candidate in candidates.items()
    )
    failed = sum(candidate.failed for candidate in candidates.values())
    differing = sum(
        one != other
        for candidate in candidates.values()
        for one, other in zip(candidate.results, candidates[HERE].results, strict=True)
    )
    ratio = candidates[ONE].seconds / candidates[TWO].seconds
    return Section(
        title=f"{count:,} campaigns of 20 configurations × 3 targets by identify_many",
        columns=("candidate", "time", "times as fast as one", "processor time each", "of it here"),
        rows=rows,
        figures=(
            Figure("identify_many on two processes: times as fast as on one", ratio, "at least", 1.7, "×"),
            Figure(
                "processor time of a campaign on two processes / in this process",
                candidates[TWO].processor / candidates[HERE].processor,
                "at most",
                1.15,
                "×",
            ),
            Figure.none("results of campaigns whose bits differ between the ways", differing),
            Figure.none("campaigns that have failed", failed),
        ),
        notes=(
            f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} at the end",
            "where others use the machine, the processor time tells what the first figure would be",
        ),
        data={name: candidate.seconds for name, candidate in candidates.items()},
    )


def _campaign(seed: int) -> Campaign:
    return Campaign.model_validate(small_campaign(seed=seed, configurations=20).document)


def _pool(width: int) -> Executor:
    return ProcessPoolExecutor(width, mp_context=multiprocessing.get_context("spawn"))
