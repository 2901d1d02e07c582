"""Metrics in the text format of Prometheus; a server of their own answers with them."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from socketserver import ThreadingMixIn
from typing import Any, ClassVar, Final
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

from prometheus_client import CollectorRegistry, Counter, Histogram, make_wsgi_app
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

Gauges = Callable[[], dict[str, float]]

SILENT_SECONDS: Final = 10.0
"""A connection to the metrics that says nothing for so long is closed."""
_SECONDS: Final = (0.005, 0.02, 0.1, 0.5, 2.0, 10.0, 60.0)
_HELP: Final = {
    "database_up": "1 if the last check of the database succeeded.",
    "workers": "Workers with a sign of life within 30 s.",
    "failing_workers": "Workers of this service that end soon after each start.",
    "stored_bytes": "Size of the database.",
    "quota_bytes": "Size that the database may have.",
    "connections": "Open connections.",
    "held_body_bytes": "Bytes of bodies that are received or worked on.",
    "unfinished_jobs": "Jobs that are queued or running.",
}


class _Handler(WSGIRequestHandler):
    """A connection."""

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Log nothing."""


class _Threads(ThreadingMixIn, WSGIServer):
    """A server with a thread for each connection, and few of them."""

    daemon_threads = True
    CONNECTIONS: ClassVar[int] = 16
    request_queue_size = CONNECTIONS

    def __init__(self, *given: Any) -> None:  # noqa: ANN401
        self._room = threading.BoundedSemaphore(self.CONNECTIONS)
        super().__init__(*given)

    def process_request(self, request: Any, client_address: Any) -> None:  # noqa: ANN401
        """Answer in a thread, or close the connection if there are too many."""
        if self._room.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:  # noqa: ANN401
        """Answer, and make room."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._room.release()

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ANN401
        """Report nothing about clients that disconnected."""


def metrics_server(
    host: str, port: int, registry: CollectorRegistry, silence: float = SILENT_SECONDS
) -> WSGIServer:
    """Return a server of metrics that listens, and is still to be run.

    Args:
        host: address to listen on.
        port: TCP port.
        registry: that it shows.
        silence: after which a connection is closed [s].

    Raises:
        OSError: the address cannot be listened on.
    """
    family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
    handler = type("_Patient", (_Handler,), {"timeout": silence})
    server = type("_Server", (_Threads,), {"address_family": family})((host, port), handler)
    server.set_app(make_wsgi_app(registry))
    return server  # type: ignore[no-any-return]


class Metrics:
    """Counts of the requests of one application, and the state of its service."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()  # for the server that shows it
        self.gauges: Gauges = dict  # return the state when it is asked for
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
            route: template of the address, not the address itself, of which there is no end.
            status: of the answer.
            seconds: until all of it was given.
        """
        self._requests.labels(method, route, str(status)).inc()
        self._seconds.labels(method, route).observe(seconds)


class _State(Collector):
    """State of the service, looked up when it is asked for."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics

    def collect(self) -> Iterator[Metric]:
        """Yield a gauge for each figure."""
        for name, value in self._metrics.gauges().items():
            yield GaugeMetricFamily(f"jointstiff_{name}", _HELP[name], value=value)

    def describe(self) -> list[Metric]:
        """Return nothing: the figures are not known yet when this is registered."""
        return []
