"""Services and workers as processes of our own."""

import fcntl
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

LONGEST_SECONDS = 90.0
"""Time that whatever is waited for may take: on a busy machine a second becomes twenty."""


class Service:
    """A service process of our own, on a real socket and a real database."""

    def __init__(
        self, database_url: str, *options: str, prefix: Sequence[str] = (), python: str = sys.executable
    ) -> None:
        command = [*prefix, python, "-m", "jointstiff", "serve", "--port", "0", "--database", database_url]
        command += options
        self._log = tempfile.TemporaryFile("w+")  # noqa: SIM115 - closed by stop
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )
        line = self.process.stdout.readline()
        found = re.search(r"http://[^\s,]+", line)
        assert found, self.log()
        self.url = found[0]

    def log(self) -> str:
        """What it wrote to its standard error."""
        self._log.seek(0)
        return self._log.read()

    def stop(self) -> None:
        """End it as a service manager would."""
        self.process.terminate()
        try:
            self.process.wait(timeout=LONGEST_SECONDS)
        finally:
            self.process.kill()
            self.process.stdout.close()
            self._log.close()


@contextmanager
def serving(database: str, workers: int, port: int) -> Iterator[subprocess.Popen[str]]:
    """A service on a port that it keeps when it is started again, and with it the names of its workers."""
    arguments = ["serve", "--port", str(port), "--database", database, "--workers", str(workers)]
    with started(*arguments) as process:
        process.url = f"http://127.0.0.1:{port}"
        yield process


@contextmanager
def working(database: str, name: str) -> Iterator[subprocess.Popen[str]]:
    with started("worker", "--database", database, "--name", name) as process:
        yield process


@contextmanager
def started(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A process of ours, which may not be ready yet."""
    process = subprocess.Popen(
        [sys.executable, "-m", "jointstiff", *arguments],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(LONGEST_SECONDS)
        finally:
            process.kill()
            process.stdout.close()


def ready(process: subprocess.Popen[str]) -> subprocess.Popen[str]:
    """The process, after its first words."""
    assert process.stdout.readline()
    return process


def workers_of(database: str) -> list[int]:
    """Process ids of the living workers that a service started on this database."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            command = (folder / "cmdline").read_bytes().split(b"\0")
            environment = (folder / "environ").read_bytes().split(b"\0")
        except OSError:  # it has ended meanwhile, or is another user's
            continue
        if (
            b"jointstiff.service.workers" in command
            and f"JOINTSTIFF_DATABASE={database}".encode() in environment
        ):
            found.append(int(folder.name))
    return found


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Lock a file, which is made if need be: other processes wait."""
    with path.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


def until(met: Callable[[], bool], seconds: float = LONGEST_SECONDS) -> None:
    deadline = time.monotonic() + seconds
    while not met():
        assert time.monotonic() < deadline, f"not within {seconds:.0f} s"
        time.sleep(0.03)
