"""Health whatever fails below, what every answer says, and what is counted and logged of a request."""

import json
import logging
import resource
import shutil
import socket
import sqlite3
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from inspect import iscoroutinefunction
from types import SimpleNamespace

import anyio
import httpx2
import psycopg
import pytest
from sqlalchemy import event, text
from support.in_process import Client, composed, served
from support.jobs import run_request, runs_of, stored_set
from support.processes import Service, until

from jointstiff.schemas.access import Health
from jointstiff.service import solver_check
from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.api.health import Watch
from jointstiff.service.app import CONCURRENT_REQUESTS, create_app
from jointstiff.service.problems import StoreUnavailableError, problem_from_error
from jointstiff.service.process import ACCESS_LOGGER, JsonFormatter, LogFormat, set_log_format
from jointstiff.service.server import _gauge_values
from jointstiff.service.solver_check import SolverWatch, describe_check
from jointstiff.service.store.store import Store
from jointstiff.service.workers.engine import Queue

ROBOT = EXAMPLES["robots"]["modified DH"]


def test_health_is_answered_while_all_threads_wait_for_the_database(tmp_path):
    """Twelve posts wait for a locked SQLite file, which is more than there are threads."""
    path = tmp_path / "jointstiff.db"
    posts = CONCURRENT_REQUESTS + 4
    with (
        Store.open(f"sqlite:///{path}") as store,
        served(store) as url,
        closing(sqlite3.connect(path, isolation_level=None)) as other,
        ThreadPoolExecutor(posts) as pool,
        httpx2.Client(base_url=url, timeout=60.0) as client,
    ):
        other.execute("BEGIN IMMEDIATE")
        began = threading.Barrier(posts + 1)

        def post() -> httpx2.Response:
            began.wait()
            return httpx2.post(f"{url}/v1/robots", json=ROBOT, timeout=60.0)

        waiting = [pool.submit(post) for _ in range(posts)]
        began.wait()
        for address in ("/health", "/live") * 20:
            assert client.get(address).is_success
        assert not any(one.done() for one in waiting)
        other.execute("ROLLBACK")
        assert {one.result().status_code for one in waiting} == {201}


def test_a_database_that_does_not_answer_is_said(tmp_path):
    """Without its table the database cannot answer; the process still does."""
    path = tmp_path / "jointstiff.db"
    with Store.open(f"sqlite:///{path}") as store, closing(sqlite3.connect(path)) as other:
        client = Client(store)
        assert Health.model_validate_json(client.get("/health").content).database == "sqlite"
        other.execute("ALTER TABLE robots RENAME TO away")
        answer = client.get("/health")
        assert answer.status_code == 503
        assert int(answer.headers["retry-after"]) > 0
        assert answer.headers["content-type"] == "application/problem+json"
        assert client.get("/live").status_code == 204


@pytest.mark.process
@pytest.mark.skipif(shutil.which("setpriv") is None, reason="needs setpriv, as root writes what it may not")
def test_a_file_that_can_only_be_read_is_not_ready_until_it_can_be_written(tmp_path):
    """Reads are answered meanwhile, and posts come back without a restart."""
    path = tmp_path / "jointstiff.db"
    Service(f"sqlite:///{path}", "--workers", "0").stop()
    path.chmod(0o444)
    bounded = ("setpriv", "--bounding-set=-dac_override")
    service = Service(f"sqlite:///{path}", "--workers", "0", prefix=bounded)
    try:
        until(lambda: httpx2.get(f"{service.url}/health").status_code == 503)
        assert httpx2.get(f"{service.url}/v1/robots").status_code == 200
        refused = httpx2.post(f"{service.url}/v1/robots", json=ROBOT)
        assert refused.status_code == 503
        assert "writable" in refused.json()["remedy"]

        def is_ready():
            for each in tmp_path.iterdir():  # its journal has the mode of the file, and may come late
                with suppress(FileNotFoundError):
                    each.chmod(0o644)
            return httpx2.get(f"{service.url}/health").status_code == 200

        until(is_ready)
        assert httpx2.post(f"{service.url}/v1/robots", json=ROBOT).status_code == 201
    finally:
        service.stop()


@pytest.mark.parametrize(
    ("distance", "error", "why"),
    [
        (0.03, "", "Clarabel's answer to a known program is off by 0.03, more than 2e-05: "),
        (None, "ImportError", "Clarabel did not solve a known program (ImportError): "),
    ],
)
def test_a_solver_that_fails_a_known_program_degrades_the_health(distance, error, why):
    """The service still answers: runs prove their numbers whatever the solver says."""
    with Store.open("sqlite://") as store:
        client = Client(store)
        client._app.state.solver = SolverWatch(lambda: describe_check(distance, 2e-5, error))
        assert client.get("/health").json()["solver"] is None
        client._app.state.solver.start().join()
        answer = client.get("/health")
        health = Health.model_validate_json(answer.content)
        assert (answer.status_code, health.status) == (200, "degraded")
        assert health.solver is not None
        assert not health.solver.agrees
        assert health.solver.why == (
            f"{why}results are still proved, or refused; install `clarabel` again, and restart the service"
        )


def test_a_check_that_the_system_does_not_start_is_a_failed_check(monkeypatch):
    def refuse(_module):
        raise BlockingIOError

    monkeypatch.setattr(solver_check, "ask_child", refuse)
    found = solver_check.ask_solver()
    assert (found.agrees, found.distance) == (False, None)
    assert "did not solve a known program (BlockingIOError)" in found.why


@pytest.mark.process
def test_a_service_checks_its_solver_when_it_starts(tmp_path):
    service = Service(f"sqlite:///{tmp_path / 'jointstiff.db'}", "--workers", "0")
    try:
        until(lambda: httpx2.get(f"{service.url}/health").json()["solver"] is not None)
        health = Health.model_validate_json(httpx2.get(f"{service.url}/health").content)
        assert health.status == "ok"
        assert health.solver is not None
        assert health.solver.agrees
        assert health.solver.distance is not None
        assert health.solver.distance < 1e-7
    finally:
        service.stop()


class Stumbling(Store):
    """A store whose database fails as no database error says, for a while."""

    stumbles = True

    def ping(self):
        if self.stumbles:
            raise RuntimeError("another kind of failure")
        return super().ping()


def test_the_look_at_the_database_outlives_any_failure(caplog):
    with Stumbling.open("sqlite://") as store, Watch(store) as watch:
        with pytest.raises(StoreUnavailableError, match="check of the database failed"):
            anyio.run(watch.require_recent_check)
        assert "unexpected failure of a check" in caplog.text
        store.stumbles = False
        deadline = time.monotonic() + 60
        while True:
            try:
                seen = anyio.run(watch.require_recent_check)
                break
            except StoreUnavailableError:
                assert time.monotonic() < deadline
                time.sleep(0.05)
        assert seen.database == "sqlite"


def test_a_problem_names_no_host_of_the_database():
    with pytest.raises(StoreUnavailableError) as refused:
        Store.open("postgresql://plant@127.0.0.1:1/secret?connect_timeout=2")
    assert "127.0.0.1" in refused.value.reason  # whoever starts the service sees it
    problem = problem_from_error(refused.value)
    assert problem.status == 503
    assert not {"127.0.0.1", "plant", "secret"} & set(problem.model_dump_json().replace('"', " ").split())
    assert "127.0.0.1" not in problem.model_dump_json()


def test_an_unexpected_error_names_its_request(store, monkeypatch):
    def fail(**_options):
        raise KeyError("odd")

    monkeypatch.setattr(store.robots, "page", fail)
    with served(store) as url:
        answer = httpx2.get(f"{url}/v1/robots")
    assert answer.status_code == 500
    assert answer.json()["request_id"] == answer.headers["x-request-id"]


@pytest.mark.process
def test_metrics_are_shown_on_a_port_of_their_own_alone(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    url = f"sqlite:///{tmp_path / 'jointstiff.db'}"
    service = Service(url, "--workers", "0", "--metrics-port", str(port))
    try:
        assert httpx2.get(f"{service.url}/live").status_code == 204
        metrics = httpx2.get(f"http://127.0.0.1:{port}/metrics")
        assert "jointstiff_request_seconds_count" in metrics.text
        assert metrics.headers["content-type"].startswith("text/plain; version=")
        assert "jointstiff_" in httpx2.get(f"http://127.0.0.1:{port}/v1/robots").text  # nothing else is there
        assert httpx2.get(f"{service.url}/metrics").status_code == 404
    finally:
        service.stop()


class Away(Store):
    """A store whose database does not answer."""

    def ping(self):
        raise StoreUnavailableError("away", "wait")


def test_the_gauges_are_of_the_last_look_and_of_what_waits():
    """What no look has seen is not said; of a database that is away only that it is."""
    connected = SimpleNamespace(server_state=SimpleNamespace(connections={1, 2}))

    def state(app):
        return _gauge_values(app, connected)

    with Store.open("sqlite://", 10_000_000) as store:
        app = composed(store)
        assert state(app) == {
            "database_up": False,
            "failing_workers": 0,
            "connections": 2,
            "quota_bytes": 10_000_000,
        }
        runs_of(store, lambda *_: None).create(run_request(stored_set(store)), None)
        with app.state.watch:
            seen = state(app)
            assert (seen["database_up"], seen["workers"], seen["unfinished_jobs"]) == (True, 0, 1)
            assert seen["stored_bytes"] > 10_000
    with Away.open("sqlite://") as store:
        app = composed(store)
        with app.state.watch:
            assert state(app)["database_up"] is False
            assert not {"workers", "unfinished_jobs", "quota_bytes"} & state(app).keys()


def test_a_job_that_does_not_move_is_told_by_health_metrics_and_the_job(tmp_path):
    """Without a worker, as of the last look; the answer is 200, as posts work."""
    url = f"sqlite:///{tmp_path / 'jointstiff.db'}"
    connected = SimpleNamespace(server_state=SimpleNamespace(connections=set()))
    with Store.open(url) as store, closing(Queue(store, url)) as queue:
        run = runs_of(store, queue.enqueue).create(run_request(stored_set(store)), None)
        store._database.change(text("UPDATE jobs SET created_at = '2026-01-01 00:00:00.000000'"))
        client = Client(store)
        app, watch = client._app, client._app.state.watch
        with watch:
            watch._check_waits()
            health = Health.model_validate_json(client.get("/health").content)
            (stuck,) = health.stuck
            assert (stuck.job, health.queue.waiting) == (run.id, 1)
            assert "no worker is running" in stuck.why
            values = _gauge_values(app, connected)
            assert (values["stuck_jobs"], values["waiting_parts"], values["database_writable"]) == (
                1,
                1,
                True,
            )
            waits = client.get(f"/v1/jobs/{run.id}").json()["progress"]["waits"]
            assert waits == f"run {run.id} has not moved for {stuck.still_s:.0f} s: {stuck.why}"


def test_logs_as_json_have_exceptions_and_warnings(monkeypatch, capsys):
    root = logging.getLogger()
    monkeypatch.setattr(root, "handlers", [])
    monkeypatch.setenv("JOINTSTIFF_LOG_FORMAT", "text")
    access = logging.getLogger(ACCESS_LOGGER)
    level = access.level
    try:
        set_log_format(LogFormat.JSON)
        try:
            {}["odd"]
        except KeyError:
            logging.getLogger("any").exception("it failed")
    finally:
        logging.captureWarnings(capture=False)
        access.setLevel(level)
    line = json.loads(capsys.readouterr().err)
    assert (line["message"], line["level"]) == ("it failed", "error")
    assert "KeyError: 'odd'" in line["exception"]


def test_logs_as_json_show_characters_that_steer_terminals_and_texts():
    steering = "\x7f\x85\x9b31m\u061c\u200e\u200f\u2028\u2029\u202a\u202e\u2066\u2069"
    record = logging.LogRecord("any", logging.INFO, "", 0, f"Müller {steering}", None, None)
    line = JsonFormatter().format(record)
    assert json.loads(line)["message"] == f"Müller {steering}"
    assert "Müller" in line
    assert line.isprintable()


@contextmanager
def no_growth(_store, _url):
    """No file of this process may be written beyond its first page, as on a full disk."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@contextmanager
def read_only(store, url):
    """The database takes no changes, as a disk that was mounted anew after an error."""
    if url.startswith("postgresql"):
        statement = "SET default_transaction_read_only = {}"
    else:
        statement = "PRAGMA query_only = {}"
    switched = "on"

    def switch(connection, *_):
        connection.cursor().execute(statement.format(switched))
        if url.startswith("postgresql"):
            connection.commit()

    event.listen(store._database._reader.pool, "checkout", switch)
    try:
        yield
    finally:
        switched = "off"


@contextmanager
def robots_locked(store, url):
    """Another session holds the table, for longer than anybody waits."""
    with psycopg.connect(url) as other:
        other.execute("LOCK TABLE robots IN ACCESS EXCLUSIVE MODE")
        event.listen(store._database._reader.pool, "checkout", wait_briefly)
        yield


def wait_briefly(connection, *_):
    connection.cursor().execute("SET lock_timeout = '100ms'")
    connection.commit()


@pytest.mark.parametrize(
    ("kind", "fault"),
    [("sqlite", no_growth), ("sqlite", read_only), ("postgresql", read_only), ("postgresql", robots_locked)],
)
def test_a_fault_has_a_code_and_loses_nothing(kind, fault, tmp_path, request):
    url = f"sqlite:///{tmp_path / 'jointstiff.db'}"
    if kind == "postgresql":
        url = request.getfixturevalue("new_postgresql_database")()
    key = {"Idempotency-Key": "one"}
    with Store.open(url) as store:
        client = Client(store)
        before = client.request("POST", "/v1/robots", json=ROBOT).json()["id"]
        with fault(store, url):
            refused = client.request("POST", "/v1/robots", json=ROBOT, headers=key)
            assert client.get("/live").status_code == 204
        assert refused.status_code == 503
        assert refused.json()["type"] == "urn:jointstiff:problem:store-unavailable"
        assert refused.headers["retry-after"] == "5"
        accepted = client.request("POST", "/v1/robots", json=ROBOT, headers=key)
        assert accepted.status_code == 201
        listed = [item["id"] for item in client.get("/v1/robots").json()["items"]]
        assert listed == [accepted.json()["id"], before]


def test_a_refusal_waits_for_no_thread():
    """A plain function would run in the pool of threads, and the refused body would stay until it did."""
    with Store.open("sqlite://") as store:
        handlers = create_app(store).exception_handlers
    assert all(iscoroutinefunction(handler) for handler in handlers.values()), handlers
