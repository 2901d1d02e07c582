"""Fixtures that several packages' tests share: databases, real ones."""

import gc
import hashlib
import os
import shutil
import subprocess
import tempfile
import uuid
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import httpcore2
import httpx2
import psycopg
import pytest
from support import examples as examples  # registers the profile of --hypothesis-profile=full
from support import lanes, wheel
from support.processes import Service, alone

gc.set_threshold(50_000)  # of new objects: Python's own 700 take a tenth of the tests' time
# Before NumPy is imported: threads of linear algebra in each of several workers wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Certificates, which each client loads for 25 ms and services of ours do not show.
httpcore2.default_ssl_context = cache(httpcore2.default_ssl_context)

REQUIRE_POSTGRESQL = "JOINTSTIFF_REQUIRE_POSTGRESQL"
POSTGRESQL_PROGRAMS = "JOINTSTIFF_POSTGRESQL_PROGRAMS"
"""Folder of the programs of another PostgreSQL server than the newest installed one."""


def pytest_configure(config: pytest.Config) -> None:
    """Let tests be marked by what they use, and processes be refused where there is no mark."""
    config.pluginmanager.register(lanes)


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """The folder of this run that all workers of xdist share."""
    place = tmp_path_factory.getbasetemp()
    return place if worker_id == "master" else place.parent


@pytest.fixture(scope="session")
def postgresql_url(shared_folder: Path, worker_id: str) -> Iterator[str]:
    """A PostgreSQL server of our own, reached through a socket in a folder of its own.

    All workers of xdist share it: the first makes it, and it ends with the last that uses it.
    """
    binaries = _postgresql_binaries()
    name = hashlib.sha256(bytes(shared_folder)).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / f"jointstiff-pg-{name}"

    def run(program: str, *arguments: str) -> None:
        command = [str(binaries / program), "-D", str(folder / "data"), *arguments]
        if os.geteuid() == 0:  # the server refuses to run as root
            command = ["setpriv", "--reuid=postgres", "--regid=postgres", "--init-groups", *command]
        log = folder / "log"
        with log.open("a") as output:  # a file: the server would hold a pipe open
            done = subprocess.run(command, cwd=folder, stdout=output, stderr=output, check=False, timeout=60)
        assert done.returncode == 0, log.read_text()

    users = shared_folder / "postgresql-users"
    with alone(users):
        if not folder.exists():
            folder.mkdir()
            if os.geteuid() == 0:
                shutil.chown(folder, "postgres", "postgres")
            run("initdb", "-U", "postgres", "-A", "trust", "-E", "UTF8", "--locale=C", "--no-sync")
            options = f"-k {folder} -c listen_addresses='' -c lock_timeout=80s -c max_connections=300"
            run("pg_ctl", "start", "-w", "-o", options)
        users.write_text(users.read_text() + f"{worker_id}\n")
    try:
        yield f"postgresql://postgres@/postgres?host={folder}"
    finally:
        with alone(users):
            left = users.read_text().splitlines()
            left.remove(worker_id)
            users.write_text("".join(f"{user}\n" for user in left))
            if not left:
                run("pg_ctl", "stop", "-w", "-m", "immediate")
                shutil.rmtree(folder)


@pytest.fixture(scope="session")
def new_postgresql_database(postgresql_url: str) -> Callable[..., str]:
    """Call it for the URL of a fresh, empty database on that server."""

    def create(options: str = "") -> str:
        name = f"test_{uuid.uuid4().hex}"
        with psycopg.connect(postgresql_url, autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name} {options}")
        return postgresql_url.replace("/postgres?", f"/{name}?")

    return create


ON_BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)]
"""By day what stands above the store runs on SQLite: its contract and `test_every_kind` ask PostgreSQL."""


@pytest.fixture(params=["sqlite", "postgresql"])
def database_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A fresh, empty database, one of each kind: for the store's contract."""
    return _fresh_database(request, tmp_path)


@pytest.fixture(params=ON_BOTH)
def either_database_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A fresh, empty database on SQLite, and each night on PostgreSQL: for what stands above the store."""
    return _fresh_database(request, tmp_path)


def _fresh_database(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Return the URL of a fresh, empty database.

    On PostgreSQL it is a schema of its own, the only one on the search path: a program sees no
    difference, and it is there in a millisecond instead of 150.
    """
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'jointstiff.db'}"
    url: str = request.getfixturevalue("postgresql_url")
    schema = f"test_{uuid.uuid4().hex}"
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(f"CREATE SCHEMA {schema}")
    return f"{url}&options=-csearch_path%3D{schema}"


def _postgresql_binaries() -> Path:
    if stated := os.environ.get(POSTGRESQL_PROGRAMS):
        return Path(stated)
    installed = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: int(path.parts[-3]))
    found = installed[-1] if installed else shutil.which("initdb")
    if found:
        return Path(found).parent
    reason = "no PostgreSQL server here: apt-get install postgresql"
    if os.environ.get(REQUIRE_POSTGRESQL) == "1":
        pytest.fail(f"{reason} ({REQUIRE_POSTGRESQL}=1)")
    pytest.skip(reason)


@pytest.fixture(scope="session")
def openapi() -> dict[str, Any]:
    """The description of the API; no test may change it."""
    from support.in_process import description

    return description()


@pytest.fixture(scope="session")
def services(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Callable[[str], Service]]:
    """Starts the service on a kind of database, once for all tests, whatever order they run in."""
    running: dict[str, Service] = {}

    def start(kind: str) -> Service:
        if kind not in running:
            url = f"sqlite:///{tmp_path_factory.mktemp('service') / 'jointstiff.db'}"
            if kind == "postgresql":
                url = request.getfixturevalue("new_postgresql_database")()
            running[kind] = Service(url)
        return running[kind]

    try:
        yield start
        for service in running.values():
            assert service.process.poll() is None, service.log()
    finally:
        for service in running.values():
            service.stop()


@pytest.fixture(scope="session")
def built_wheel(shared_folder: Path) -> Path:
    """The wheel of jointstiff, and next to it `environment` with all wheels; workers of xdist share both."""
    folder = shared_folder / "wheel"
    with alone(shared_folder / "page.lock"):  # which is built with it
        if not (folder / "environment").is_dir():
            wheel.build(folder)
            wheel.install(folder, folder / "environment")
    return next(folder.glob("jointstiff-*.whl"))


@pytest.fixture(scope="session")
def installed(built_wheel: Path) -> Path:
    """The folder `bin` of an environment that has the package from its wheel."""
    return built_wheel.with_name("environment") / "bin"


class InProcess(NamedTuple):
    """A service in a thread of this process."""

    url: str


@pytest.fixture(scope="session")
def served_in_process(tmp_path_factory: pytest.TempPathFactory) -> Iterator[InProcess]:
    """The service in a thread of this process, on SQLite and without workers: a post waits for its job."""
    from support.in_process import served

    from jointstiff.service.store.store import Store

    database = tmp_path_factory.mktemp("served") / "jointstiff.db"
    with Store.open(f"sqlite:///{database}") as store, served(store) as url:
        yield InProcess(url)


@pytest.fixture(scope="session")
def service(request: pytest.FixtureRequest) -> Service | InProcess:
    """The running service, a thread of this process on SQLite; a module that says so takes PostgreSQL, too.

    There it is a process with workers: `pytestmark = support.api.BOTH_DATABASES`. No test may expect it to
    be empty.
    """
    if getattr(request, "param", "sqlite") == "sqlite":
        return request.getfixturevalue("served_in_process")
    return request.getfixturevalue("services")(request.param)


@pytest.fixture(params=ON_BOTH)
def client_of_workers(
    request: pytest.FixtureRequest, services: Callable[[str], Service]
) -> Iterator[httpx2.Client]:
    """An HTTP client of a service process, which has workers."""
    with httpx2.Client(base_url=services(request.param).url, timeout=60.0) as session:
        yield session


@pytest.fixture
def client(service: Service | InProcess) -> Iterator[httpx2.Client]:
    """An HTTP client of the running service."""
    with httpx2.Client(base_url=service.url, timeout=60.0) as session:
        yield session
