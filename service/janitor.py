"""Sees to it that every run ends: idle work is given to others, runs that cannot go on are failed."""

from __future__ import annotations

from datetime import timedelta
from typing import Final

from service.engine import ENDED_BADLY, Engine
from service.runs import Runs
from service.store import Store

__all__ = ["BEAT_SECONDS", "SILENT_SECONDS", "Janitor", "WorkerLostError"]

BEAT_SECONDS: Final = 5.0
"""Between two signs of life of a worker."""
SILENT_SECONDS: Final = 30.0
"""A worker not heard of for so long is taken for dead."""


class WorkerLostError(Exception):
    """The engine gave a run up."""


class Janitor:
    """Of one worker. It looks at every beat; what it does is safe to repeat, and others do the same."""

    def __init__(self, store: Store, runs: Runs, engine: Engine, executor: str) -> None:
        self._store = store
        self._runs = runs
        self._engine = engine
        self._executor = executor
        self._idle: set[str] = set()
        self._lost: set[str] = set()

    def look(self) -> None:
        """Show a sign of life, and mend what is found.

        Raises:
            StoreUnavailableError: the database does not answer; look again later.
        """
        living = self._store.run_log.beat(self._executor, timedelta(seconds=SILENT_SECONDS))
        pending = self._engine.pending()
        mine = {name for name, (_, executor) in pending.items() if executor == self._executor}
        # Taken by this process and not carried out: its thread ended without a word, say on a full disk.
        idle = mine - self._engine.active
        self._resume(idle & self._idle, pending)
        self._idle = idle
        if living and living[0] == self._executor:  # one of the living is enough
            abandoned = {name for name, (_, executor) in pending.items() if executor not in living}
            self._resume(abandoned, pending)
            self._fail_lost()

    def hand_over(self) -> None:
        """Leave what this worker has begun to the others, as it is about to end."""
        pending = self._engine.pending()
        self._resume({name for name, (_, executor) in pending.items() if executor == self._executor}, pending)
        self._store.run_log.forget(self._executor)

    def _resume(self, names: set[str], pending: dict[str, tuple[str, str]]) -> None:
        self._engine.resume((name, pending[name][0]) for name in names)

    def _fail_lost(self) -> None:
        """End open runs whose workflow has ended without ending them, or is not there, two looks in a row."""
        open_runs = self._store.run_log.open_runs()
        outcomes = self._engine.outcomes(open_runs) if open_runs else {}
        lost = {run for run in open_runs if outcomes.get(run, "ERROR") in (*ENDED_BADLY, "SUCCESS")}
        for run_id in lost & self._lost:
            how = outcomes.get(run_id, "unknown to the engine")
            self._runs.fail(run_id, WorkerLostError(f"the engine gave run {run_id} up: {how}"))
        self._lost = lost
