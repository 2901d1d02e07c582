"""Health of the service, which threads of its own check; its routes; and metrics for Prometheus."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from typing import Final, Literal, NamedTuple

from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from fastapi import APIRouter, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, Counter, Histogram, generate_latest
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.types import ASGIApp, Receive, Scope, Send

from jointstiff.schemas.access import Health, PartsWaiting, SolverHealth, StuckJob
from jointstiff.service.problems import StoreError, StoreUnavailableError
from jointstiff.service.process import jointstiff_version
from jointstiff.service.security.access import PUBLIC, VIEWER, AccessRoute
from jointstiff.service.security.keys import Keyring
from jointstiff.service.store.jobs import SILENT
from jointstiff.service.store.store import Store
from jointstiff.service.store.waiting import Waiting

router = APIRouter(tags=["health"], route_class=AccessRoute)

CHECK_SECONDS: Final = 0.5
"""Pause between two checks of the database [s]."""
STALE_SECONDS: Final = 10.0
"""Greatest age of the last check [s]; if it is older, the database counts as not answering."""
WRITE_CHECK_SECONDS: Final = 2.0
"""Pause between two checks that the database can be written [s]."""
STALE_WRITE_CHECK_SECONDS: Final = 30.0
"""Greatest age of the last write check [s]; if it is older, the database counts as not writable."""
WAITS_SECONDS: Final = 5.0
"""Pause between two checks of jobs that do not move [s]."""
_JOIN_SECONDS: Final = 1.0
"""Greatest time to wait for a running check when the watch ends [s]."""
Gauges = Callable[[], dict[str, float]]

_DURATION_BUCKETS: Final = (0.005, 0.02, 0.1, 0.5, 2.0, 10.0, 60.0)
_GAUGE_HELP: Final = {
    "database_up": "1 if the last check of the database succeeded.",
    "database_writable": "1 if the last write to the database succeeded.",
    "workers": "Workers with a sign of life within 30 s.",
    "failing_workers": "Workers of this service that end soon after each start.",
    "stored_bytes": "Size of the database.",
    "quota_bytes": "Size that the database may have.",
    "connections": "Open connections.",
    "unfinished_jobs": "Jobs that are queued or running.",
    "stuck_jobs": "Jobs that do not move, as /health states.",
    "waiting_parts": "Parts of jobs that wait for a worker.",
    "oldest_part_seconds": "Time for which the oldest of these parts has waited.",
}

_logger = logging.getLogger(__name__)


@router.get("/health", dependencies=[VIEWER], response_model=Health)
async def get_health(request: Request) -> Health:
    """Return version, database and number of workers of the service, as of the last check.

    Answers 503 while the database does not answer or cannot be written.
    """
    # The last check is used, without a thread or a query, so that the answer never waits for other requests.
    watch: Watch = request.app.state.watch
    last_check = await watch.require_writable()
    solver: SolverHealth | None = request.app.state.solver.found
    solver_disagrees = solver is not None and not solver.agrees
    return Health(
        status="degraded" if solver_disagrees else "ok",
        version=jointstiff_version(),
        workers=last_check.workers,
        failing_workers=request.app.state.failing_workers(),
        database=last_check.database,
        stored_bytes=last_check.stored_bytes,
        quota_bytes=watch.quota_bytes,
        access=request.app.state.access,
        stuck=[
            StuckJob(job=job.job_id, still_s=round(job.seconds), why=job.why) for job in watch.waiting.stuck
        ],
        queue=PartsWaiting(waiting=watch.waiting.parts, oldest_s=round(watch.waiting.oldest_seconds)),
        solver=solver,
    )


@router.get("/live", dependencies=[PUBLIC], status_code=204, response_class=Response)
async def get_live() -> Response:
    """Return nothing: the process answers, whatever its database does."""
    return Response(status_code=204)


@router.get("/v1", dependencies=[VIEWER], include_in_schema=False)
def get_index() -> dict[str, str]:
    """Return where the API is described, and the jobs are listed; the page for people is at /."""
    return {
        "name": "Jointstiff",
        "version": jointstiff_version(),
        "description": "/openapi.json",
        "health": "/health",
        "jobs": "/v1/jobs",
    }


class DatabaseCheck(NamedTuple):
    """Outcome of a check of the database."""

    at: float  # monotonic time at the end of the check [s]
    workers: int = 0  # number of living workers
    database: Literal["sqlite", "postgresql"] = "sqlite"  # kind of the database
    stored_bytes: int = 0  # size of the database
    error: StoreError | None = None  # error of the check; None if the check succeeded


class Watch:
    """Regular checks of the database in three threads, so that requests for the health never wait.

    A watch is a context manager: the threads run until the block ends. Outside the block, each request makes
    a check of its own.
    """

    def __init__(self, store: Store, keyring: Keyring | None = None) -> None:
        """Watch the database of a store.

        Args:
            store: store to check; the caller closes it.
            keyring: keys that are read again with each check, so that a revoked key is refused after the next
                check; None to read no keys.
        """
        self._store = store
        self._keyring = keyring
        self.quota_bytes = store.quota.most  # size that the database may have [bytes]; None for no limit
        self.last_check: DatabaseCheck | None = None  # outcome of the last check
        self.waiting = Waiting()  # jobs that do not move, and the queue, as of the last check
        self._unwritable: StoreError | None = None
        self._write_checked_at = 0.0
        self._is_ended = threading.Event()

    def __enter__(self) -> Watch:
        self._is_ended.clear()
        self.last_check = self._check_database()
        self._write_checked_at = time.monotonic()
        self._threads = [
            threading.Thread(target=self._repeat_until_end, args=pause_and_check, daemon=True)
            for pause_and_check in (
                (CHECK_SECONDS, self._repeat_check),
                (WRITE_CHECK_SECONDS, self._check_writable),
                (WAITS_SECONDS, self._check_waits),
            )
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_ended.set()
        for thread in self._threads:  # a running check must not use the store after it is closed
            thread.join(_JOIN_SECONDS)
        self.last_check = None

    @property
    def is_writable(self) -> bool:
        """True if the last write to the database succeeded, a short while ago."""
        age = time.monotonic() - self._write_checked_at
        return self._unwritable is None and age <= STALE_WRITE_CHECK_SECONDS

    def find_reason(self, job_id: str) -> str | None:
        """Return why a job has not moved for a while; None if it moves, as of the last check."""
        return next((job.describe() for job in self.waiting.still if job.job_id == job_id), None)

    async def require_recent_check(self) -> DatabaseCheck:
        """Return the outcome of the last check.

        Raises:
            StoreError: the last check failed, or is older than `STALE_SECONDS`.
        """
        last_check = self.last_check
        if last_check is None:
            last_check = await run_sync(self._check_database)
        if last_check.error is not None:
            raise last_check.error.with_traceback(None)
        if time.monotonic() - last_check.at > STALE_SECONDS:
            raise StoreUnavailableError(
                "the database does not answer in time", "try again; check the server of the database"
            )
        return last_check

    async def require_writable(self) -> DatabaseCheck:
        """Return the outcome of the last check, if the database could also be written.

        Raises:
            StoreError: the last check or the last write check failed, or is too old.
        """
        last_check = await self.require_recent_check()
        if self.last_check is None:
            await run_sync(self._check_writable)
        if self._unwritable is not None:
            raise self._unwritable.with_traceback(None)
        if (
            self.last_check is not None
            and time.monotonic() - self._write_checked_at > STALE_WRITE_CHECK_SECONDS
        ):
            raise StoreUnavailableError(
                "a write to the database does not finish", "end the program that locks the database"
            )
        return last_check

    def _repeat_until_end(self, pause: float, act: Callable[[], None]) -> None:
        """Call a function again and again, after a pause [s] each time, until the watch ends."""
        while not self._is_ended.wait(pause):
            act()

    def _check_writable(self) -> None:
        """Write to the database, and store the error if it fails: read-only files pass the other checks."""
        try:
            self._store.heartbeats.check_writable()
        except StoreError as error:
            self._unwritable = error
        except Exception:
            _logger.exception("unexpected failure of a write to the database")
            self._unwritable = StoreUnavailableError(
                "a write to the database failed", "see the log of the service"
            )
        else:
            self._unwritable = None
        self._write_checked_at = time.monotonic()

    def _check_waits(self) -> None:
        """Read which jobs do not move, and what waits in the queue; a failure leaves the last state."""
        unwritable = None if self.is_writable else "the database cannot be written; see /health"
        try:
            self.waiting = self._store.waits.read(unwritable)
        except StoreError:
            pass  # `last_check` has the error
        except Exception:
            _logger.exception("unexpected failure of a check of what waits")

    def _repeat_check(self) -> None:
        """Check the database and store the outcome in `last_check`, unless the watch has ended meanwhile."""
        last_check = self._check_database()
        if not self._is_ended.is_set():
            self.last_check = last_check

    def gauges(self) -> dict[str, float]:
        """Return name → value of the metrics of the last checks of writes, jobs and queue."""
        return {
            "database_writable": self.is_writable,
            "stuck_jobs": len(self.waiting.stuck),
            "waiting_parts": self.waiting.parts,
            "oldest_part_seconds": self.waiting.oldest_seconds,
        }

    def _check_database(self) -> DatabaseCheck:
        """Check the database and read the keys; return the outcome, with the error if one occurred."""
        try:
            database = self._store.ping()
            if self._keyring is not None:
                self._keyring.read_keys()
            workers = len(self._store.heartbeats.living(SILENT))
            stored = self._store.quota.used()
        except StoreError as error:
            return DatabaseCheck(time.monotonic(), error=error)
        except Exception:  # the thread must continue: the next check may succeed
            if self.last_check is None or self.last_check.error is None:  # logged once, not at each check
                _logger.exception("unexpected failure of a check of the database")
            failed = StoreUnavailableError(
                "the check of the database failed", "try again; see the log of the service"
            )
            return DatabaseCheck(time.monotonic(), error=failed)
        return DatabaseCheck(time.monotonic(), workers, database, stored)


class Metrics:
    """Metrics for Prometheus: counts and durations of requests, and numbers of the service's state."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()  # read by the server of the metrics
        self.gauges: Gauges = dict  # function that returns the state as numbers by name; the service sets it
        labels = ["method", "route"]
        self._requests = Counter(
            "jointstiff_requests", "Requests answered.", [*labels, "status"], registry=self.registry
        )
        self._seconds = Histogram(
            "jointstiff_request_seconds",
            "Time until the whole answer was given.",
            labels,
            registry=self.registry,
            buckets=_DURATION_BUCKETS,
        )
        self.registry.register(_GaugeCollector(self))

    def count(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count a request.

        Args:
            method: method of HTTP, or `other`.
            route: template of the address; single addresses would be countless.
            status: status of the answer.
            seconds: time until the whole answer was sent.
        """
        self._requests.labels(method, route, str(status)).inc()
        self._seconds.labels(method, route).observe(seconds)

    def serve_on_port(self, app: ASGIApp, port: int) -> ASGIApp:
        """Return an application that serves the metrics on one port, and `app` on all other ports."""
        # A limiter of its own, so that the metrics never wait for other requests.
        limiter = CapacityLimiter(1)

        async def answer_or_forward(scope: Scope, receive: Receive, send: Send) -> None:
            """Answer a request for metrics on their port; hand any other request to `app`."""
            if scope["type"] != "http" or scope["server"][1] != port:
                await app(scope, receive, send)
                return
            text = await run_sync(generate_latest, self.registry, limiter=limiter)
            await Response(text, headers={"Content-Type": CONTENT_TYPE_LATEST})(scope, receive, send)

        return answer_or_forward


class _GaugeCollector(Collector):
    """Collector of Prometheus that reads the state of the service at each request for metrics."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics

    def collect(self) -> Iterator[Metric]:
        """Yield a gauge for each number of the service's state."""
        for name, value in self._metrics.gauges().items():
            yield GaugeMetricFamily(f"jointstiff_{name}", _GAUGE_HELP[name], value=value)

    def describe(self) -> list[Metric]:
        """Return no metrics: the state is not known yet when the collector is registered."""
        return []
