"""Runs as resources: every run ends, and a failure is a stored result."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import lru_cache
from uuid import uuid4

from sqlalchemy import Connection

from schemas.problem import Problem
from schemas.run import Progress, Provenance, Run, RunRequest, RunResult, RunState
from service.conversion import to_settings
from service.identify import run_identification
from service.measurement_sets import MeasurementSets
from service.prepared import PreparedSet
from service.problems import http_problem, problem_of
from service.records import IdempotencyKey, RunRecord
from service.resample import ResamplingWork
from service.run_log import OPEN_STATES
from service.store import Store
from service.store_errors import NotFoundError
from service.versions import versions
from solver.exceptions import JointstiffError, RequestError
from solver.identification import refuse_unsupported
from solver.resampling import Resamples

__all__ = ["Announce", "Runs"]

_logger = logging.getLogger(__name__)


Announce = Callable[[Connection, str], object]
"""Announces a run to those who carry it out, in the transaction that stores it."""


class Runs:
    """The runs of a store. Quick ones are carried out at once; resampling may be left to workers."""

    def __init__(
        self,
        store: Store,
        sets: MeasurementSets,
        announce: Announce | None = None,
        tell: Callable[[int], object] | None = None,
    ) -> None:
        """Serve the runs of a store.

        Args:
            store: where they are kept.
            sets: what they are of.
            announce: announces long runs to workers; without it every run is carried out at once.
            tell: told how many draws of a run are done while it is carried out here.
        """
        self._store = store
        self._sets = sets
        self._announce = announce
        self._tell = tell
        self.work = lru_cache(maxsize=4)(self._work)

    def create(self, request: RunRequest, key: IdempotencyKey | None) -> RunRecord:
        """Store a run: carried out, or announced if it resamples and there are workers.

        Raises:
            RequestError: what is asked for does not exist, or the readings cannot support it.
                Nothing is stored then.
            IdempotencyConflictError: the key came before with another body.
        """
        if key is not None and (before := self._store.find(RunRecord, key)) is not None:
            return before
        prepared = self._prepared(request.measurement_set_id)
        run = _queued(prepared, request)
        if request.resampling is None or self._announce is None:
            run = _carried_out(prepared, run, self._tell)
            return self._store.add(_record(run, prepared.robot_id), key)
        refuse_unsupported(prepared.robot, prepared.measurements, to_settings(request, prepared.robot))
        ResamplingWork(prepared, request, request.resampling)  # refuses what cannot be drawn
        announce = self._announce
        return self._store.add(
            _record(run, prepared.robot_id), key, lambda connection: announce(connection, run.id)
        )

    def current(self, run_id: str) -> Run:
        """A run as it is now, with its progress while it goes on.

        Raises:
            NotFoundError: there is no such run.
        """
        record = self._store.get(RunRecord, run_id)
        run = Run.model_validate_json(record.document)
        if record.state not in OPEN_STATES or run.progress is None:
            return run
        done = run.progress.model_copy(update={"done": self._store.run_log.done(run_id)})
        return run.model_copy(update={"state": record.state, "progress": done})

    def document(self, run_id: str) -> str:
        """The same as JSON: that of a run that has ended, as it was stored.

        Raises:
            NotFoundError: there is no such run.
        """
        record = self._store.get(RunRecord, run_id)
        if record.state in OPEN_STATES:
            return self.current(run_id).model_dump_json()
        return record.document

    def cancel(self, run_id: str) -> Run:
        """End a run where it stands; a run that has ended stays as it is.

        Raises:
            NotFoundError: there is no such run.
        """
        run = self.current(run_id)
        if run.state in OPEN_STATES:
            self._end(run, "cancelled")
        return self.current(run_id)

    def start(self, run_id: str) -> None:
        """A run is being carried out from now on."""
        run = self.current(run_id)
        started = run.provenance.model_copy(update={"started_at": datetime.now(UTC)})
        run = run.model_copy(update={"state": "running", "provenance": started})
        self._store.run_log.start(run_id, run.model_dump_json())

    def _work(self, run_id: str) -> ResamplingWork:
        """What a stored run has to resample, for those who carry it out."""
        request = self.current(run_id).request
        if request.resampling is None:
            raise RequestError("it does not resample", where="resampling", remedy="report this")
        return ResamplingWork(self._prepared(request.measurement_set_id), request, request.resampling)

    def conclude(self, run_id: str, parts: Sequence[Resamples]) -> None:
        """Put a run together from all its draws, in order, and end it."""
        run = self.current(run_id)
        prepared = self._prepared(run.request.measurement_set_id)
        result, error = _outcome(prepared, run.request, parts)
        computed_by = run.provenance.model_copy(update={"versions": dict(versions())})
        changes = {"result": result, "error": error, "provenance": computed_by}
        self._end(run.model_copy(update=changes), "succeeded" if error is None else "failed")

    def fail(self, run_id: str, failure: Exception) -> None:
        """End a run whose steps failed."""
        if isinstance(failure, JointstiffError):
            error = problem_of(failure)
        else:
            _logger.error("a run failed unexpectedly", exc_info=failure)
            error = _unexpected()
        self._end(self.current(run_id).model_copy(update={"error": error}), "failed")

    def _end(self, run: Run, state: RunState) -> None:
        ended = run.provenance.model_copy(update={"ended_at": datetime.now(UTC)})
        run = run.model_copy(update={"state": state, "provenance": ended})
        self._store.run_log.end(run.id, state, run.model_dump_json())

    def _prepared(self, set_id: str) -> PreparedSet:
        try:
            return self._sets.prepared(set_id)
        except NotFoundError as error:
            raise RequestError(error.reason, remedy=error.remedy, where="measurement_set_id") from error


def _queued(prepared: PreparedSet, request: RunRequest) -> Run:
    now = datetime.now(UTC)
    progress = None
    if request.resampling is not None:
        progress = Progress(
            done=0, total=request.resampling.repetitions, unit="resamples", activity="resampling"
        )
    return Run(
        id=uuid4().hex,
        state="queued",
        progress=progress,
        request=request,
        result=None,
        error=None,
        provenance=Provenance(
            versions=dict(versions()),
            input_hash=_input_hash(prepared, request),
            created_at=now,
            started_at=None,
            ended_at=None,
        ),
    )


def _carried_out(prepared: PreparedSet, run: Run, tell: Callable[[int], object] | None) -> Run:
    """The run, carried out here and now."""
    result, error = _outcome(prepared, run.request, None, tell)
    progress = run.progress.model_copy(update={"done": run.progress.total}) if run.progress else None
    return run.model_copy(
        update={
            "state": "succeeded" if error is None else "failed",
            "progress": progress,
            "result": result,
            "error": error,
            "provenance": run.provenance.model_copy(
                update={"started_at": run.provenance.created_at, "ended_at": datetime.now(UTC)}
            ),
        }
    )


def _outcome(
    prepared: PreparedSet,
    request: RunRequest,
    parts: Sequence[Resamples] | None,
    tell: Callable[[int], object] | None = None,
) -> tuple[RunResult | None, Problem | None]:
    """The one boundary of a run: whatever happens beyond a refused request becomes its result."""
    try:
        return run_identification(prepared, request, parts, tell), None
    except RequestError:
        raise
    except JointstiffError as error:
        return None, problem_of(error)
    except Exception:
        _logger.exception("a run failed unexpectedly")
        return None, _unexpected()


def _unexpected() -> Problem:
    return http_problem(500, "the run failed unexpectedly", "report it with the data")


def _input_hash(prepared: PreparedSet, request: RunRequest) -> str:
    """SHA-256 of robot, readings and request; equal inputs have equal hashes in any store."""
    options = request.model_dump_json(exclude={"measurement_set_id"})
    return hashlib.sha256(f"{prepared.content} {options}".encode()).hexdigest()


def _record(run: Run, robot_id: str) -> RunRecord:
    return RunRecord(
        id=run.id,
        measurement_set_id=run.request.measurement_set_id,
        robot_id=robot_id,
        method=run.request.method,
        weighting=run.request.weighting,
        positive=run.request.positive,
        state=run.state,
        created_at=run.provenance.created_at,
        document=run.model_dump_json(),
    )
