"""Services and databases that benchmarks start, kill and start again."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Final
from uuid import uuid4

import httpx2
import psycopg

from benchmarks.campaigns import small_campaign
from jointstiff import identify
from jointstiff.schemas.run import Campaign
from jointstiff.simulator.campaign import Document

__all__ = [
    "PostgresqlServer",
    "Service",
    "ServiceError",
    "begin_run",
    "caddy",
    "cpu",
    "databases",
    "descriptors",
    "ended",
    "followed",
    "free_port",
    "locked",
    "numbers",
    "post_campaign",
    "post_document",
    "postgresql",
    "running",
    "size_of",
    "start_worker",
    "undisturbed",
    "worker",
]

_START_SECONDS: Final = 180.0
_CADDYFILE: Final = Path(__file__).parents[1] / "docker" / "Caddyfile"


class ServiceError(Exception):
    """The service, or its database, did not do what it should."""


class Service:
    """A service process on a port of its own, which it keeps when it is started again."""

    def __init__(
        self,
        database: str,
        workers: int,
        port: int | None = None,
        options: Sequence[str] = (),
        limits: Mapping[int, int] | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Start it, and wait until it answers.

        Args:
            database: its URL.
            workers: of long runs.
            port: to listen on; a free one if none is given.
            options: further ones of the command.
            limits: of the process (`resource.RLIMIT_…`).
            environment: variables beside those of this process.
        """
        self.port = port or free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        command = [sys.executable, "-m", "jointstiff", "serve", "--port", str(self.port)]
        command += ["--database", database, "--workers", str(workers), *options]
        with tempfile.TemporaryFile() as log:
            self.process = subprocess.Popen(
                command, stdout=subprocess.DEVNULL, stderr=log, env=os.environ | dict(environment or {})
            )
            for limit, value in (limits or {}).items():
                resource.prlimit(self.process.pid, limit, (value, value))
            self._wait(lambda: _tail(log.fileno()))

    def __enter__(self) -> Service:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.process.terminate()
        self.process.wait(30)

    def workers(self) -> list[int]:
        """Process ids of its workers."""
        tasks = Path(f"/proc/{self.process.pid}/task").glob("*/children")
        children = [int(pid) for task in tasks for pid in task.read_text().split()]
        return [pid for pid in children if b"service.workers" in _command(pid)]

    def kill_worker(self) -> None:
        """Kill one worker with SIGKILL, as soon as there is one."""
        while not (workers := [pid for pid in self.workers() if running(pid)]):
            time.sleep(0.01)
        os.kill(workers[0], signal.SIGKILL)

    def kill(self, *, workers: bool = False) -> list[int]:
        """Kill the service with SIGKILL.

        Args:
            workers: kill them with it.

        Returns:
            The workers it had.
        """
        pids = self.workers()
        for pid in (self.process.pid, *(pids if workers else ())):
            os.kill(pid, signal.SIGKILL)
        self.process.wait()
        return pids

    def _wait(self, log: Callable[[], str]) -> None:
        deadline = time.monotonic() + _START_SECONDS
        while time.monotonic() < deadline and self.process.poll() is None:
            try:
                httpx2.get(f"{self.url}/health", timeout=5.0)
            except httpx2.TransportError:
                time.sleep(0.02)
            else:
                return
        self.process.kill()
        raise ServiceError(f"the service did not start: {log()}")


def start_worker(
    database: str, name: str, environment: Mapping[str, str] | None = None
) -> subprocess.Popen[bytes]:
    """Start a worker; `environment` are variables beside those of this process."""
    command = [sys.executable, "-m", "jointstiff", "worker", "--database", database, "--name", name]
    return subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | dict(environment or {}),
    )


@contextmanager
def worker(database: str, name: str) -> Iterator[subprocess.Popen[bytes]]:
    """A worker, until the block ends."""
    process = start_worker(database, name)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(60)


def post_campaign(client: httpx2.Client, configurations: int) -> str:
    """Post robot and readings; the id of the set."""
    return post_document(client, small_campaign(configurations=configurations).document)


def post_document(client: httpx2.Client, document: Document) -> str:
    """Post robot and readings of a campaign; the id of the set."""
    robot = client.post("/v1/robots", json=document["robot"]).raise_for_status().json()
    readings = document["measurement_set"] | {"robot_id": robot["id"]}
    stored = client.post("/v1/measurement-sets", json=readings).raise_for_status().json()
    return str(stored["id"])


def begin_run(client: httpx2.Client, configurations: int, resampling: dict[str, int]) -> str:
    """Post a campaign and a long run of it; the address of the run."""
    body = {"measurement_set_id": post_campaign(client, configurations), "resampling": resampling}
    return str(client.post("/v1/runs?wait=0", json=body).raise_for_status().headers["location"])


def followed(client: httpx2.Client, address: str, seconds: float) -> Iterator[dict[str, Any]]:
    """Yield a run again and again, the last time when it has ended or so many seconds have passed."""
    deadline = time.monotonic() + seconds
    while True:
        found: dict[str, Any] = client.get(address).raise_for_status().json()
        yield found
        if found["state"] not in {"queued", "running"} or time.monotonic() > deadline:
            return
        time.sleep(0.1)


def ended(client: httpx2.Client, address: str, seconds: float) -> dict[str, Any]:
    """Return a run when it has ended, or as it is after so many seconds."""
    *_, found = followed(client, address, seconds)
    return found


def undisturbed(configurations: int, resampling: dict[str, int]) -> dict[str, Any]:
    """Return the numbers of the same run in this process, without workers."""
    document = small_campaign(configurations=configurations).document | {"run": {"resampling": resampling}}
    campaign = Campaign.model_validate_json(json.dumps(document))
    return numbers(json.loads(identify(campaign, campaign.run).model_dump_json()))


def numbers(run: dict[str, Any]) -> dict[str, Any]:
    """Return the parts that two runs of the same input share: all but ids and times."""
    request = {name: value for name, value in run["request"].items() if name != "measurement_set_id"}
    hashed = run["provenance"]["input_hash"]
    return {"request": request, "input_hash": hashed} | {
        name: run[name] for name in ("state", "progress", "result", "error")
    }


def _command(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return b""


def running(pid: int) -> bool:
    """Return True if a process runs; a zombie does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def descriptors(pid: int) -> int:
    """Return the number of files and connections that a process has open."""
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


@contextmanager
def caddy(service: Service) -> Iterator[tuple[int, int]]:
    """Start Caddy on the loopback address in front of a service, with the file of docker/.

    Yields:
        Its port and its process id.

    Raises:
        ServiceError: Caddy is not there, or does not start.
    """
    program, port = shutil.which("caddy"), free_port()
    if program is None:
        raise ServiceError("no Caddy here: scripts/caddy installs it")
    with tempfile.TemporaryDirectory(prefix="jointstiff-caddy-") as folder:
        stated = {
            "JOINTSTIFF_SITE": f"http://localhost:{port}",
            "JOINTSTIFF_SERVICES": f"127.0.0.1:{service.port}",
            "JOINTSTIFF_TLS": "bind 127.0.0.1",  # a line of the site, as `tls internal` is
            "HOME": folder,
        }
        command = [program, "run", "--config", str(_CADDYFILE), "--adapter", "caddyfile"]
        process = subprocess.Popen(command, env=os.environ | stated, stderr=subprocess.DEVNULL)
        try:
            deadline = time.monotonic() + _START_SECONDS
            while process.poll() is None:
                with suppress(httpx2.TransportError):
                    if httpx2.get(f"http://localhost:{port}/live").is_success:
                        break
                if time.monotonic() > deadline:
                    raise ServiceError("Caddy does not answer")
                time.sleep(0.02)
            yield port, process.pid
        finally:
            process.terminate()
            process.wait(20)


def cpu(pid: int) -> float:
    """Return the processor time of a process and of those that it started [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    started = [
        child for each in Path(f"/proc/{pid}/task").glob("*/children") for child in each.read_text().split()
    ]
    own = sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
    return own + sum(cpu(int(child)) for child in started if running(int(child)))


def size_of(pid: int | str = "self", kind: str = "VmRSS") -> float:
    """Return the size of a process, resident or by another name of the kernel (`VmHWM`: its peak) [MB]."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return int(status.partition(f"{kind}:")[2].split()[0]) / 1024.0


@contextmanager
def databases() -> Iterator[dict[str, Callable[[], str]]]:
    """Yield a function for each kind of database that makes one and returns its URL."""
    with tempfile.TemporaryDirectory(prefix="jointstiff-benchmark-") as place, postgresql() as server:
        yield {"SQLite": lambda: f"sqlite:///{Path(place) / uuid4().hex}.db", "PostgreSQL": server}


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock of a SQLite database by which others may not write."""
    with closing(sqlite3.connect(path, timeout=30, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        yield


class PostgresqlServer:
    """A PostgreSQL server of our own, which is called for the URL of a fresh database."""

    def __init__(self, programs: Path, folder: Path) -> None:
        """Take a server whose data are in a folder."""
        self._programs, self._folder = programs, folder

    def __call__(self) -> str:
        """Make a database; return its URL."""
        return _new_database(self._folder)

    @property
    def pid(self) -> int:
        """Process that started all others of the server."""
        return int((self._folder / "data" / "postmaster.pid").read_text().split()[0])

    def start(self) -> None:
        """Start it, and wait until it answers."""
        options = f"-k {self._folder} -c listen_addresses=''"
        _control(self._programs.with_name("pg_ctl"), self._folder, "start", "-w", "-o", options)

    def stop(self) -> None:
        """Stop it at once, as a power failure would."""
        _control(self._programs.with_name("pg_ctl"), self._folder, "stop", "-w", "-m", "immediate")

    def version(self) -> str:
        """Return the version of the server."""
        with psycopg.connect(f"postgresql://postgres@/postgres?host={self._folder}") as connection:
            return connection.info.parameter_status("server_version") or ""

    def say(self, statement: str) -> None:
        """Carry out a statement."""
        address = f"postgresql://postgres@/postgres?host={self._folder}"
        with psycopg.connect(address, autocommit=True) as connection:
            connection.execute(statement.encode())


@contextmanager
def postgresql() -> Iterator[PostgresqlServer]:
    """A PostgreSQL server of our own; JOINTSTIFF_POSTGRESQL_PROGRAMS is the folder of other programs."""
    installed = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: int(path.parts[-3]))
    found = installed[-1] if installed else shutil.which("initdb")
    if stated := os.environ.get("JOINTSTIFF_POSTGRESQL_PROGRAMS"):
        found = Path(stated) / "initdb"
    if not found:
        raise ServiceError("no PostgreSQL server here: apt-get install postgresql")
    folder = Path(tempfile.mkdtemp(prefix="jointstiff-benchmark-pg-"))
    try:
        if os.geteuid() == 0:  # the server refuses to run as root
            shutil.chown(folder, "postgres", "postgres")
        _control(Path(found), folder, "-U", "postgres", "-A", "trust", "-E", "UTF8", "--locale=C")
        server = PostgresqlServer(Path(found), folder)
        server.start()
        try:
            yield server
        finally:
            server.stop()
    finally:
        shutil.rmtree(folder)


def _control(program: Path, folder: Path, *arguments: str) -> None:
    command = [str(program), "-D", str(folder / "data"), *arguments]
    if os.geteuid() == 0:
        command = ["setpriv", "--reuid=postgres", "--regid=postgres", "--init-groups", *command]
    with (folder / "log").open("a") as log:  # a file: the server would hold a pipe open
        subprocess.run(command, cwd=folder, stdout=log, stderr=log, check=True, timeout=60)


def _new_database(folder: Path) -> str:
    name = f"benchmark_{time.monotonic_ns()}"
    with psycopg.connect(f"postgresql://postgres@/postgres?host={folder}", autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}".encode())
    return f"postgresql://postgres@/{name}?host={folder}"


def free_port() -> int:
    """Return a port that no program listens on."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


def _tail(descriptor: int) -> str:
    os.lseek(descriptor, 0, os.SEEK_SET)
    return os.read(descriptor, 10_000).decode(errors="replace")
