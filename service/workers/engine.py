"""Durable execution of long jobs on DBOS Transact: enqueued by the service, carried out by workers.

A job is a workflow; its steps are shared out to workflows of their own, its parts, so that any number of
workers can take part, and none is kept from other jobs for long. What a step computed is kept before the
next one begins. Steps may be carried out twice: they only compute, what they report of a job is safe to
repeat, and the end of a job is written once.
Who goes on with what a dead worker left is `jointstiff.service.workers.recovery`'s to see to.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from math import ceil
from types import TracebackType
from typing import Any, Final, ParamSpec, TypeVar

from dbos import DBOS, DBOSConfig, SetEnqueueOptions
from sqlalchemy.exc import InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

from jointstiff.service.jobs.life import Jobs
from jointstiff.service.kinds.work import Span
from jointstiff.service.problems.errors import StoreUnavailableError
from jointstiff.service.store.store import Store
from jointstiff.service.workers.queue import (
    APPLICATION,
    APPLICATION_VERSION,
    QUEUES,
    JobQueue,
    as_store_errors,
    engine_url,
    schema_of,
)
from jointstiff.service.workers.serialization import JsonSerializer

_PARTS: Final = 8
"""Of a job at least, as long as it has so many steps: work for as many workers."""
_STEPS: Final = 20
"""Of a part at most, about five seconds: only between two parts does a worker turn to another job."""
_FIRST: Final = 8
"""Parts of each job that go before what is left of longer ones: a small job does not wait for a large one."""
_AT_ONCE: Final = {"job": 16, "part": 1}
"""A worker waits for some jobs, and computes one part: work for one processor."""
_ATTEMPTS: Final = 10_000
"""Times that the engine begins a workflow: it counts every restart, the recovery those without progress."""
_POLL_SECONDS: Final = {"job": 0.4, "part": 0.2}
"""Between two looks into a queue, each a few milliseconds that the computing has less."""
_WAIT_SECONDS: Final = 0.2
"""Between two looks at a part that a job waits for."""
_FIRST_PAUSE: Final = 0.1
_LONGEST_PAUSE: Final = 5.0

P = ParamSpec("P")
R = TypeVar("R")


_DATABASE_ERRORS: Final = (OperationalError, InterfaceError, PoolTimeoutError)


class _Interruption(BaseException):
    """The engine's tables could not be used: no result of a workflow, whatever is done with exceptions.

    It is not recorded, so that the workflow counts as begun; the recovery sees that nobody carries it out.
    """


class Engine:
    """A worker's side: carries out jobs until closed. One a process."""

    def __init__(self, store: Store, jobs: Mapping[str, Jobs], database: str, executor: str) -> None:
        """Prepare to work, as a context manager does.

        Raises:
            StoreError: the engine's tables cannot be made or used.
        """
        self.queue = JobQueue(store, database)  # of the jobs
        # ids of the workflows that this process is carrying out, one for each time
        self.active: list[str] = []
        pending = self.queue.pending()
        # workflows that an earlier process of the same name was carrying out when it ended
        self.inherited = {name: each for name, each in pending.items() if each[1] == executor}
        config: DBOSConfig = {
            "name": APPLICATION,
            "system_database_url": engine_url(database),
            "dbos_system_schema": schema_of(store),
            "application_version": APPLICATION_VERSION,
            "executor_id": executor,
            "serializer": JsonSerializer(),
            "log_level": "CRITICAL",
            "console_log_level": "CRITICAL",
        }
        DBOS(config=config)
        _register(_Steps(jobs), self.active)
        DBOS.listen_queues(list(QUEUES.values()))

    def __enter__(self) -> Engine:
        """Start to work.

        Raises:
            StoreError: the engine's tables cannot be made or used.
        """
        with as_store_errors():
            DBOS.launch()
            for kind, queue in QUEUES.items():
                DBOS.register_queue(
                    queue,
                    worker_concurrency=_AT_ONCE[kind],
                    polling_interval_sec=_POLL_SECONDS[kind],
                    on_conflict="always_update",
                )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        DBOS.destroy(workflow_completion_timeout_sec=0)


class _Steps:
    """Steps of a job, each kept by the engine. A finished job computes nothing more."""

    def __init__(self, jobs: Mapping[str, Jobs]) -> None:
        @DBOS.step(name="plan")
        @_patient
        def plan(kind: str, job_id: str) -> list[list[Span]]:
            if not jobs[kind].goes_on(job_id):  # cancelled, or deleted since
                return []
            jobs[kind].start(job_id)
            steps = jobs[kind].work(job_id).steps()
            count = min(len(steps), max(_PARTS, ceil(len(steps) / _STEPS)))
            return [list(steps[part::count]) for part in range(count)]

        @DBOS.step(name="compute")
        @_patient
        def compute(kind: str, job_id: str, span: Span) -> str:
            if not jobs[kind].goes_on(job_id):
                return ""
            work = jobs[kind].work(job_id)
            computed: str = work.encode(work.compute(span))
            jobs[kind].log.report(job_id, *span)
            return computed

        @DBOS.step(name="conclude")
        @_patient
        def conclude(kind: str, job_id: str, computed: list[str]) -> None:
            if jobs[kind].goes_on(job_id):
                jobs[kind].conclude(job_id, computed)

        @DBOS.step(name="fail")
        @_patient
        def fail(kind: str, job_id: str, failure: Exception) -> None:
            jobs[kind].fail(job_id, failure)

        self.plan, self.compute, self.conclude, self.fail = plan, compute, conclude, fail


def _until_ended(compute: Callable[[Span], str], spans: Sequence[Span]) -> list[str]:
    """Return what the steps of a part compute; none is carried out after one that found the job ended.

    Of a job that is cancelled at its first step, thousands would keep the worker from other jobs.
    """
    computed = []
    for span in spans:
        computed.append(compute(span))
        if not computed[-1]:
            break
    return computed


def _patient(step: Callable[P, R]) -> Callable[P, R]:
    """Wait for a database that does not answer, as the engine does: an outage is no result of a step.

    A process without memory ends, as the system would end it: others go on, and count its death.
    """

    @wraps(step)
    def carry_out(*args: P.args, **kwargs: P.kwargs) -> R:
        pause = _FIRST_PAUSE
        while True:
            try:
                return step(*args, **kwargs)
            except MemoryError:  # no result of a step: where there is more memory, it is carried out
                os.kill(os.getpid(), signal.SIGKILL)
            except StoreUnavailableError:
                time.sleep(pause)
                pause = min(2 * pause, _LONGEST_PAUSE)

    return carry_out


def _noting(active: list[str]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator that notes which workflows are carried out, and lets no fault of the database end one."""

    def noted(workflow: Callable[P, R]) -> Callable[P, R]:
        @wraps(workflow)
        def carry_out(*args: P.args, **kwargs: P.kwargs) -> R:
            identifier = str(DBOS.workflow_id)
            active.append(identifier)
            try:
                return workflow(*args, **kwargs)
            except _DATABASE_ERRORS as error:
                raise _Interruption from error
            finally:
                active.remove(identifier)

        return carry_out

    return noted


def _register(steps: _Steps, active: list[str]) -> None:
    """Make workflows of the steps."""
    noted = _noting(active)

    @DBOS.workflow(name="part", max_recovery_attempts=_ATTEMPTS)
    @noted
    def carry_out_part(kind: str, job_id: str, spans: list[Span]) -> list[str]:
        return _until_ended(lambda span: steps.compute(kind, job_id, span), spans)

    @DBOS.workflow(name="job", max_recovery_attempts=_ATTEMPTS)
    @noted
    def carry_out_job(kind: str, job_id: str) -> None:
        try:
            parts = steps.plan(kind, job_id)
            handles: list[Any] = []
            for number, spans in enumerate(parts):
                with SetEnqueueOptions(priority=1 + min(number, _FIRST)):  # the least goes first
                    handles.append(DBOS.enqueue_workflow(QUEUES["part"], carry_out_part, kind, job_id, spans))
            computed = [handle.get_result(polling_interval_sec=_WAIT_SECONDS) for handle in handles]
            if list(map(len, computed)) != list(map(len, parts)):
                return  # the job was ended
            count = len(parts)
            in_order = [computed[i % count][i // count] for i in range(sum(map(len, parts)))]
            steps.conclude(kind, job_id, in_order)
        except _DATABASE_ERRORS:
            raise
        except Exception as failure:  # noqa: BLE001 - the boundary of a job
            steps.fail(kind, job_id, failure)
