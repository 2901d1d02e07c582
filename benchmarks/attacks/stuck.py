"""Jobs that do not move: how soon health, job and metrics say why; and no alarm for jobs that move.

Six kinds, with services and workers as processes: a lock, a silent worker, no worker, a full disk, a queue
behind long runs, a part that is handed back. By name only: 20 minutes, or the kinds alone with `--part 1/2`.
The full disk is a small one in memory, which takes root.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import Final

import httpx2
import psycopg
from prometheus_client.parser import text_string_to_metric_families

from benchmarks.attacks.faults import full, small_disk
from benchmarks.report import Figure, Part, Section
from benchmarks.services import Service, begin_run, ended, free_port, post_campaign, postgresql, worker

__all__ = ["run"]

REQUIRED_SECONDS: Final = 40.0
_LONGEST_SECONDS: Final = 120.0
_AT_ONCE: Final = 2
"""Kinds at the same time: six of them would not start in time on a busy machine of two processors."""
_RUNS: Final = 200
"""Ordinary runs during which there must be no alarm."""
_END_SECONDS: Final = 1_200.0
_LONG: Final = {"size": 1_000, "repetitions": 100_000}
"""Hundreds of steps."""
_ONE_PART: Final = {"size": 1_000, "repetitions": 36_000}
"""Less than twelve steps."""
_SHORT: Final = {"size": 100, "repetitions": 8_000}
_CONFIGURATIONS: Final = 1_000
_BEHIND: Final = 40
"""Long runs before the one that waits in the queue."""


@dataclass(frozen=True)
class _Signs:
    """Signs by which a kind of stuck is known."""

    words: str  # part of the reason, in health and in the job
    metric: str
    least: float  # value of the metric at least, or exactly 0 if this is 0
    in_health: Callable[[httpx2.Response, str], bool]


def _is_listed(answer: httpx2.Response, words: str) -> bool:
    return any(words in job["why"] for job in answer.json().get("stuck", []))


def _waits_in_queue(answer: httpx2.Response, _: str) -> bool:
    return answer.is_success and answer.json()["queue"]["oldest_s"] > 0


def _is_refused(answer: httpx2.Response, _: str) -> bool:
    return answer.status_code == 503


_KINDS: Final[Mapping[str, _Signs]] = {
    "lock": _Signs("a lock of another program", "stuck_jobs", 1, _is_listed),
    "silent worker": _Signs("has shown no sign of life", "stuck_jobs", 1, _is_listed),
    "no worker": _Signs("no worker is running", "stuck_jobs", 1, _is_listed),
    "full disk": _Signs("cannot be written", "database_writable", 0, _is_refused),
    "queue behind long runs": _Signs("parts of other jobs come first", "waiting_parts", 1, _waits_in_queue),
    "part handed back": _Signs("was handed back", "stuck_jobs", 1, _is_listed),
}


def run(*, quick: bool, part: Part) -> list[Section]:
    """Cause each kind, in a database of its own; then look for false alarms."""
    studies: list[Callable[[], Section]] = [
        _kinds,
        lambda: _alarms(4 if quick else _RUNS),
    ]
    return [studies[number]() for number in part.of(len(studies))]


def _kinds() -> Section:
    with postgresql() as server, ThreadPoolExecutor(_AT_ONCE) as pool:
        tasks = {
            "lock": pool.submit(_locked, server(), "lock"),
            "silent worker": pool.submit(_silent, server()),
            "no worker": pool.submit(_alone, server()),
            "full disk": pool.submit(_full),
            "queue behind long runs": pool.submit(_queued, server()),
            "part handed back": pool.submit(_locked, server(), "part handed back"),
        }
        found = {name: task.result() for name, task in tasks.items()}
    signs = ("health", "job", "metric")
    rows = tuple((name, *(f"{each[sign]:.0f} s" for sign in signs)) for name, each in found.items())
    in_time = sum(max(each.values()) <= REQUIRED_SECONDS for each in found.values())
    return Section(
        title="time until health, job and metric say why a job does not move",
        columns=("kind", *signs),
        rows=rows,
        figures=(
            Figure(f"kinds of stuck that are said within {REQUIRED_SECONDS:.0f} s", in_time, "at least", 6),
        ),
        notes=("from the fault; of a part that is handed back, from that moment",),
    )


@dataclass(frozen=True)
class _Service:
    """A service, with the port of its metrics."""

    client: httpx2.Client
    metrics: str

    def value_of(self, name: str) -> float:
        """Return the value of a metric."""
        text = httpx2.get(self.metrics, timeout=20).text
        for family in text_string_to_metric_families(text):
            for sample in family.samples:
                if sample.name == f"jointstiff_{name}":
                    return sample.value
        raise KeyError(name)

    def times_until_said(self, kind: str, address: str, began: float) -> dict[str, float]:
        """Return the times until health, job and metric tell a kind of stuck [s]."""
        found = dict.fromkeys(("health", "job", "metric"), float("inf"))
        while time.monotonic() - began < _LONGEST_SECONDS and max(found.values()) == float("inf"):
            now = time.monotonic() - began
            with suppress(httpx2.TimeoutException):
                for sign in self._read_signs(_KINDS[kind], address):
                    found[sign] = min(found[sign], now)
            time.sleep(0.5)
        return found

    def _read_signs(self, signs: _Signs, address: str) -> Iterator[str]:
        """Yield which of health, job and metric tell a kind of stuck now."""
        if signs.in_health(self.client.get("/health"), signs.words):
            yield "health"
        answer = self.client.get(address)
        progress = answer.json().get("progress") or {}
        if answer.is_success and signs.words in (progress.get("waits") or ""):
            yield "job"
        value = self.value_of(signs.metric)
        if value >= signs.least if signs.least else value == 0:
            yield "metric"

    def progress(self, address: str) -> int:
        """Return the number of finished units of a job."""
        return int(self.client.get(address).json()["progress"]["done"])


@contextmanager
def _serving(database: str, workers: int = 0) -> Iterator[_Service]:
    port = free_port()
    options = ["--metrics-port", str(port)]
    with (
        Service(database, workers, options=options) as service,
        httpx2.Client(base_url=service.url, timeout=60) as client,
    ):
        yield _Service(client, f"http://127.0.0.1:{port}/metrics")


def _begun(service: _Service, resampling: dict[str, int] = _LONG) -> str:
    """Post a long run; return its address once it has progress."""
    address = begin_run(service.client, _CONFIGURATIONS, resampling)
    while service.progress(address) == 0:
        time.sleep(0.1)
    return address


def _locked(database: str, kind: str) -> dict[str, float]:
    """Lock the row of a run from another program; if its part is to be handed back, wait until it is."""
    is_handed_back = kind == "part handed back"
    with ExitStack() as stack:
        service = stack.enter_context(_serving(database))
        stack.enter_context(worker(database, "one"))
        address = _begun(service, _ONE_PART if is_handed_back else _LONG)
        with psycopg.connect(database) as other, psycopg.connect(database, autocommit=True) as looking:
            other.execute("SELECT 1 FROM jobs WHERE id = %s FOR UPDATE", [address.rpartition("/")[2]])
            while is_handed_back and looking.execute(_HANDED_BACK).fetchone() is None:
                time.sleep(0.2)
            return service.times_until_said(kind, address, time.monotonic())


_HANDED_BACK: Final = "SELECT 1 FROM jointstiff_queue.workflow_status WHERE status = 'DELAYED'"


def _silent(database: str) -> dict[str, float]:
    """Stop the only worker."""
    with _serving(database) as service, worker(database, "one") as process:
        address = _begun(service)
        os.kill(process.pid, signal.SIGSTOP)
        try:
            return service.times_until_said("silent worker", address, time.monotonic())
        finally:
            os.kill(process.pid, signal.SIGCONT)


def _alone(database: str) -> dict[str, float]:
    """Post a run to a service without workers."""
    with _serving(database) as service:
        address = begin_run(service.client, _CONFIGURATIONS, _SHORT)
        return service.times_until_said("no worker", address, time.monotonic())


def _full() -> dict[str, float]:
    """Fill the disk of an SQLite file."""
    with small_disk() as folder, _serving(f"sqlite:///{folder / 'full.db'}", 1) as service:
        address = _begun(service)
        with full(folder):
            return service.times_until_said("full disk", address, time.monotonic())


def _queued(database: str) -> dict[str, float]:
    """Post long runs before a run, to one worker."""
    with _serving(database) as service, worker(database, "one"):
        client = service.client
        body = {"measurement_set_id": post_campaign(client, _CONFIGURATIONS), "resampling": _LONG}
        for _ in range(_BEHIND):
            client.post("/v1/runs?wait=0", json=body).raise_for_status()
        address = str(client.post("/v1/runs?wait=0", json=body).raise_for_status().headers["location"])
        return service.times_until_said("queue behind long runs", address, time.monotonic())


# False alarms


def _alarms(runs: int) -> Section:
    """Look at the health during many runs; none of them is stuck."""
    with postgresql() as server:
        of_runs = _alarms_of(server(), lambda client: _post_runs(client, runs))
    rows = ((f"{runs} runs", str(of_runs.looks), str(of_runs.alarms)),)
    return Section(
        title="looks at the health while two workers compute",
        columns=("work", "looks", "with a stuck job"),
        rows=rows,
        figures=(Figure.none("false alarms", of_runs.alarms),),
    )


@dataclass
class _Looks:
    """Looks at the health of a service."""

    looks: int = 0
    alarms: int = 0


def _alarms_of(database: str, work: Callable[[httpx2.Client], None]) -> _Looks:
    """Return how often the health names a stuck job during some work."""
    seen, is_over = _Looks(), threading.Event()
    with ExitStack() as stack:
        service = stack.enter_context(_serving(database))
        for name in ("one", "two"):
            stack.enter_context(worker(database, name))

        def look() -> None:
            while not is_over.wait(1.0):
                with suppress(httpx2.TransportError):
                    seen.looks += 1
                    seen.alarms += bool(service.client.get("/health").json().get("stuck"))

        thread = threading.Thread(target=look)
        thread.start()
        work(service.client)
        is_over.set()
        thread.join()
    return seen


def _post_runs(client: httpx2.Client, runs: int) -> None:
    body = {"measurement_set_id": post_campaign(client, 200), "resampling": _SHORT}
    addresses = list[str]()
    for _ in range(runs):
        answer = client.post("/v1/runs?wait=0", json=body).raise_for_status()
        addresses.append(str(answer.headers["location"]))
    for address in addresses:
        ended(client, address, _END_SECONDS)
