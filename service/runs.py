"""Runs as resources: every run ends, and a failure is a stored result."""

from __future__ import annotations

import hashlib
import logging
from datetime import UTC, datetime
from uuid import uuid4

from schemas.problem import Problem
from schemas.run import Provenance, Run, RunRequest, RunResult
from service.identify import PreparedSet, run_identification
from service.measurement_sets import MeasurementSets
from service.problems import http_problem, problem_of
from service.records import IdempotencyKey, RunRecord
from service.store import Store
from service.store_errors import NotFoundError
from service.versions import versions
from solver.exceptions import JointstiffError, RequestError

__all__ = ["Runs"]

_logger = logging.getLogger(__name__)


class Runs:
    """The runs of a store."""

    def __init__(self, store: Store, sets: MeasurementSets) -> None:
        self._store = store
        self._sets = sets

    def create(self, request: RunRequest, key: IdempotencyKey | None) -> RunRecord:
        """Carry out a run and store how it ended.

        Raises:
            RequestError: what is asked for does not exist, or the readings cannot support it.
                Nothing is stored then.
            IdempotencyConflictError: the key came before with another body.
        """
        if key is not None and (before := self._store.find(RunRecord, key)) is not None:
            return before
        created_at = datetime.now(UTC)
        prepared = self._prepared(request.measurement_set_id)
        result, error = _outcome(prepared, request)
        run = Run(
            id=uuid4().hex,
            state="succeeded" if error is None else "failed",
            request=request,
            result=result,
            error=error,
            provenance=Provenance(
                versions=dict(versions()),
                input_hash=_input_hash(prepared, request),
                created_at=created_at,
                started_at=created_at,
                ended_at=datetime.now(UTC),
            ),
        )
        return self._store.add(_record(run, prepared.robot_id), key)

    def _prepared(self, set_id: str) -> PreparedSet:
        try:
            return self._sets.prepared(set_id)
        except NotFoundError as error:
            raise RequestError(error.reason, remedy=error.remedy, where="measurement_set_id") from error


def _outcome(prepared: PreparedSet, request: RunRequest) -> tuple[RunResult | None, Problem | None]:
    """The one boundary of a run: whatever happens beyond a refused request becomes its result."""
    try:
        return run_identification(prepared, request), None
    except RequestError:
        raise
    except JointstiffError as error:
        return None, problem_of(error)
    except Exception:
        _logger.exception("a run failed unexpectedly")
        return None, http_problem(500, "the run failed unexpectedly", "report it with the data")


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
