"""Health: the state that a thread of its own renews, what answers with it, and metrics for Prometheus."""

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
"""Pause between two looks at the database."""
STALE_SECONDS: Final = 10.0
"""A look that takes longer counts as a database that does not answer."""
PROOF_SECONDS: Final = 2.0
"""Pause between two proofs that the database can be written."""
STALE_PROOF_SECONDS: Final = 30.0
"""A proof that takes longer counts as a database that cannot be written."""
_GOODBYE_SECONDS: Final = 1.0
"""For a look or proof under way at the end."""
Gauges = Callable[[], dict[str, float]]

_SECONDS: Final = (0.005, 0.02, 0.1, 0.5, 2.0, 10.0, 60.0)
_HELP: Final = {
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
    # No thread and no database while the service runs: it is answered however much others ask for.
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
    """Outcome of a look."""

    at: float  # monotonic time of its end [s]
    workers: int = 0  # number of living workers
    database: Literal["sqlite", "postgresql"] = "sqlite"  # which one it is
    stored_bytes: int = 0  # size of the database
    error: StoreError | None = None  # why there is no answer


class Watch:
    """Look at the database in a thread of its own, so that a request for the health never waits for work.

    Used as a context manager, it looks until the block ends; before and after that each question is a look.
    """

    def __init__(self, store: Store, keyring: Keyring | None = None) -> None:
        """Watch the database of a store.

        Args:
            store: which stays the caller's to close.
            keyring: to keep up to date, so that a key that was revoked is refused after the next look.
        """
        self._store = store
        self._keyring = keyring
        self.quota_bytes = store.quota.most  # size that the database may have; None for any
        self.seen: Seen | None = None  # outcome of the last look
        self._unwritable: StoreError | None = None
        self._proved = 0.0
        self._ended = threading.Event()

    def __enter__(self) -> Watch:
        self._ended.clear()
        self.seen = self._look_at_database()
        self._proved = time.monotonic()
        self._threads = [
            threading.Thread(target=self._repeat_forever, args=each, daemon=True)
            for each in ((LOOK_SECONDS, self._renew_state), (PROOF_SECONDS, self._prove_writable))
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        for thread in self._threads:  # one in the middle of a look would use a store that is closed
            thread.join(_GOODBYE_SECONDS)
        self.seen = None

    async def latest(self) -> Seen:
        """Return the outcome of the last look.

        Raises:
            StoreError: the database did not answer the last look, or has not for `STALE_SECONDS`.
        """
        seen = self.seen
        if seen is None:
            seen = await run_sync(self._look_at_database)
        if seen.error is not None:
            raise seen.error.with_traceback(None)
        if time.monotonic() - seen.at > STALE_SECONDS:
            raise StoreUnavailableError("the database is slow to answer", "try again; look at its server")
        return seen

    async def writable(self) -> Seen:
        """Return the outcome of the last look, if the database could be written of late.

        Raises:
            StoreError: the database did not answer the last look, or could not be written.
        """
        seen = await self.latest()
        if self.seen is None:
            await run_sync(self._prove_writable)
        if self._unwritable is not None:
            raise self._unwritable.with_traceback(None)
        if self.seen is not None and time.monotonic() - self._proved > STALE_PROOF_SECONDS:
            raise StoreUnavailableError(
                "a write to the database does not finish", "find the program that locks it"
            )
        return seen

    def _repeat_forever(self, pause: float, act: Callable[[], None]) -> None:
        while not self._ended.wait(pause):
            act()

    def _prove_writable(self) -> None:
        """Write: a file that can be read only, or a standby server, answers every look."""
        try:
            self._store.heartbeats.check_writable()
        except StoreError as error:
            self._unwritable = error
        except Exception:
            _logger.exception("unexpected failure of a write to the database")
            self._unwritable = StoreUnavailableError("a write to the database failed", "see the log")
        else:
            self._unwritable = None
        self._proved = time.monotonic()

    def _renew_state(self) -> None:
        seen = self._look_at_database()
        if not self._ended.is_set():
            self.seen = seen

    def _look_at_database(self) -> Seen:
        try:
            database = self._store.ping()
            if self._keyring is not None:
                self._keyring.look()
            workers = len(self._store.heartbeats.living(SILENT))
            stored = self._store.quota.used()
        except StoreError as error:
            return Seen(time.monotonic(), error=error)
        except Exception:  # the thread has to go on; it may work again at the next look
            if self.seen is None or self.seen.error is None:  # not at each look again
                _logger.exception("unexpected failure of a check of the database")
            failed = StoreUnavailableError("the check of the database failed", "try again; see the log")
            return Seen(time.monotonic(), error=failed)
        return Seen(time.monotonic(), workers, database, stored)


class Metrics:
    """Counts of the requests of one application, and the state of its service."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()  # for the server that shows it
        self.gauges: Gauges = dict  # return the state when it is requested
        labels = ["method", "route"]
        self._requests = Counter(
            "jointstiff_requests", "Requests answered.", [*labels, "status"], registry=self.registry
        )
        self._seconds = Histogram(
            "jointstiff_request_seconds",
            "Time until the whole answer was given.",
            labels,
            registry=self.registry,
            buckets=_SECONDS,
        )
        self.registry.register(_State(self))

    def count(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count a request.

        Args:
            method: of those that HTTP has.
            route: template of the address, not the address itself: there is no end of addresses.
            status: of the answer.
            seconds: until all of it was given.
        """
        self._requests.labels(method, route, str(status)).inc()
        self._seconds.labels(method, route).observe(seconds)

    def together_with(self, app: ASGIApp, port: int) -> ASGIApp:
        """Return an application that shows the metrics on one port, and is another on all others."""
        turns = CapacityLimiter(1)  # of its own: they are shown whatever others ask for

        async def answer(scope: Scope, receive: Receive, send: Send) -> None:
            if scope["type"] != "http" or scope["server"][1] != port:
                await app(scope, receive, send)
                return
            text = await run_sync(generate_latest, self.registry, limiter=turns)
            await Response(text, headers={"Content-Type": CONTENT_TYPE_LATEST})(scope, receive, send)

        return answer


class _State(Collector):
    """State of the service, looked up when it is requested."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics

    def collect(self) -> Iterator[Metric]:
        """Yield a gauge for each figure."""
        for name, value in self._metrics.gauges().items():
            yield GaugeMetricFamily(f"jointstiff_{name}", _HELP[name], value=value)

    def describe(self) -> list[Metric]:
        """Return nothing: the figures are not known yet when this is registered."""
        return []
