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

from jointstiff.schemas.access import Health
from jointstiff.service.problems import StoreError, StoreUnavailableError
from jointstiff.service.process import jointstiff_version
from jointstiff.service.security.access import PUBLIC, VIEWER, AccessRoute
from jointstiff.service.security.keys import Keyring
from jointstiff.service.store.jobs import SILENT
from jointstiff.service.store.store import Store

router = APIRouter(tags=["health"], route_class=AccessRoute)

LOOK_SECONDS: Final = 0.5
"""Pause between two checks of the database [s]."""
STALE_SECONDS: Final = 10.0
"""Age of the last check from which the database counts as not answering [s]."""
PROOF_SECONDS: Final = 2.0
"""Pause between two checks that the database can be written [s]."""
STALE_PROOF_SECONDS: Final = 30.0
"""Age of the last write check from which the database counts as not writable [s]."""
_JOIN_SECONDS: Final = 1.0
"""Time to wait at the end for a check that is running [s]."""
Gauges = Callable[[], dict[str, float]]

_DURATION_BUCKETS: Final = (0.005, 0.02, 0.1, 0.5, 2.0, 10.0, 60.0)
_GAUGE_HELP: Final = {
    "database_up": "1 if the last check of the database succeeded.",
    "workers": "Workers with a sign of life within 30 s.",
    "failing_workers": "Workers of this service that end soon after each start.",
    "stored_bytes": "Size of the database.",
    "quota_bytes": "Size that the database may have.",
    "connections": "Open connections.",
    "unfinished_jobs": "Jobs that are queued or running.",
}

_logger = logging.getLogger(__name__)


@router.get("/health", dependencies=[VIEWER], response_model=Health)
async def get_health(request: Request) -> Health:
    """Return the version of the service, its database and the number of its workers, as last looked at.

    Answers 503 while the database does not answer or cannot be written, as work would be lost.
    """
    # The last check is used, without a thread or a query, so that the answer never waits for other requests.
    watch: Watch = request.app.state.watch
    seen = await watch.writable()
    return Health(
        status="ok",
        version=jointstiff_version(),
        workers=seen.workers,
        failing_workers=request.app.state.failing_workers(),
        database=seen.database,
        stored_bytes=seen.stored_bytes,
        quota_bytes=watch.quota_bytes,
        access=request.app.state.access,
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


class Seen(NamedTuple):
    """Outcome of a check of the database."""

    at: float  # monotonic time of its end [s]
    workers: int = 0  # number of living workers
    database: Literal["sqlite", "postgresql"] = "sqlite"  # which one it is
    stored_bytes: int = 0  # size of the database
    error: StoreError | None = None  # why there is no answer


class Watch:
    """Regular check of the database in threads of its own, so that requests for the health never wait.

    As a context manager, it checks until the block ends; outside the block, each request is a check.
    """

    def __init__(self, store: Store, keyring: Keyring | None = None) -> None:
        """Watch the database of a store.

        Args:
            store: store to check; the caller closes it.
            keyring: keys to read again with each check, so that a revoked key is refused after the next one.
        """
        self._store = store
        self._keyring = keyring
        self.quota_bytes = store.quota.most  # size that the database may have; None for any
        self.seen: Seen | None = None  # outcome of the last check
        self._unwritable: StoreError | None = None
        self._write_checked_at = 0.0
        self._ended = threading.Event()

    def __enter__(self) -> Watch:
        self._ended.clear()
        self.seen = self._check_database()
        self._write_checked_at = time.monotonic()
        self._threads = [
            threading.Thread(target=self._repeat_until_end, args=each, daemon=True)
            for each in ((LOOK_SECONDS, self._renew_state), (PROOF_SECONDS, self._check_writable))
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        for thread in self._threads:  # a running check must not use the store after it is closed
            thread.join(_JOIN_SECONDS)
        self.seen = None

    async def latest(self) -> Seen:
        """Return the outcome of the last check.

        Raises:
            StoreError: the last check failed, or is older than `STALE_SECONDS`.
        """
        seen = self.seen
        if seen is None:
            seen = await run_sync(self._check_database)
        if seen.error is not None:
            raise seen.error.with_traceback(None)
        if time.monotonic() - seen.at > STALE_SECONDS:
            raise StoreUnavailableError("the database is slow to answer", "try again; look at its server")
        return seen

    async def writable(self) -> Seen:
        """Return the outcome of the last check, if the database could also be written.

        Raises:
            StoreError: the last check or the last write check failed, or is too old.
        """
        seen = await self.latest()
        if self.seen is None:
            await run_sync(self._check_writable)
        if self._unwritable is not None:
            raise self._unwritable.with_traceback(None)
        if self.seen is not None and time.monotonic() - self._write_checked_at > STALE_PROOF_SECONDS:
            raise StoreUnavailableError(
                "a write to the database does not finish", "find the program that locks it"
            )
        return seen

    def _repeat_until_end(self, pause: float, act: Callable[[], None]) -> None:
        """Call a function again and again, with a pause [s], until the watch ends."""
        while not self._ended.wait(pause):
            act()

    def _check_writable(self) -> None:
        """Write to the database and keep the error: read-only files and standby servers pass other checks."""
        try:
            self._store.heartbeats.check_writable()
        except StoreError as error:
            self._unwritable = error
        except Exception:
            _logger.exception("unexpected failure of a write to the database")
            self._unwritable = StoreUnavailableError("a write to the database failed", "see the log")
        else:
            self._unwritable = None
        self._write_checked_at = time.monotonic()

    def _renew_state(self) -> None:
        """Check the database, and keep the outcome unless the watch has ended meanwhile."""
        seen = self._check_database()
        if not self._ended.is_set():
            self.seen = seen

    def _check_database(self) -> Seen:
        """Check the database and read the keys; return the outcome, with the error if one occurred."""
        try:
            database = self._store.ping()
            if self._keyring is not None:
                self._keyring.look()
            workers = len(self._store.heartbeats.living(SILENT))
            stored = self._store.quota.used()
        except StoreError as error:
            return Seen(time.monotonic(), error=error)
        except Exception:  # the thread must continue: the next check may succeed
            if self.seen is None or self.seen.error is None:  # logged once, not at each check
                _logger.exception("unexpected failure of a check of the database")
            failed = StoreUnavailableError("the check of the database failed", "try again; see the log")
            return Seen(time.monotonic(), error=failed)
        return Seen(time.monotonic(), workers, database, stored)


class Metrics:
    """Counts of the requests of one application, and the state of its service."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()  # read by the server of the metrics
        self.gauges: Gauges = dict  # function that returns the state, set by the service
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
        turns = CapacityLimiter(1)  # a limiter of its own, so that the metrics never wait for other requests

        async def answer(scope: Scope, receive: Receive, send: Send) -> None:
            if scope["type"] != "http" or scope["server"][1] != port:
                await app(scope, receive, send)
                return
            text = await run_sync(generate_latest, self.registry, limiter=turns)
            await Response(text, headers={"Content-Type": CONTENT_TYPE_LATEST})(scope, receive, send)

        return answer


class _GaugeCollector(Collector):
    """State of the service, looked up when it is requested."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics

    def collect(self) -> Iterator[Metric]:
        """Yield a gauge for each number of the service's state."""
        for name, value in self._metrics.gauges().items():
            yield GaugeMetricFamily(f"jointstiff_{name}", _GAUGE_HELP[name], value=value)

    def describe(self) -> list[Metric]:
        """Return no metrics: the state is not known yet when the collector is registered."""
        return []
