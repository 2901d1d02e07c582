"""Each request is counted, and has an identifier that its answer, problem document and log share."""

from __future__ import annotations

import json
import logging
import socket
from types import SimpleNamespace

import httpx2
import pytest
from support.in_process import composed, served
from support.jobs import request, runs_of, stored_set
from support.processes import Service

from jointstiff.service.api.answers import ANSWER_HEADERS
from jointstiff.service.problems import StoreUnavailableError
from jointstiff.service.process import ACCESS_LOGGER, JsonFormatter, LogFormat, set_log_format
from jointstiff.service.server import _state
from jointstiff.service.store.store import Store


@pytest.fixture
def store():
    with Store.open("sqlite://") as opened:
        yield opened


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
        return _state(app, connected)

    with Store.open("sqlite://", 10_000_000) as store:
        app = composed(store)
        assert state(app) == {
            "database_up": False,
            "failing_workers": 0,
            "connections": 2,
            "held_body_bytes": 0,
            "quota_bytes": 10_000_000,
        }
        runs_of(store, lambda *_: None).create(request(stored_set(store)), None)
        with app.state.watch:
            seen = state(app)
            assert (seen["database_up"], seen["workers"], seen["unfinished_jobs"]) == (True, 0, 1)
            assert seen["stored_bytes"] > 10_000
    with Away.open("sqlite://") as store:
        app = composed(store)
        with app.state.watch:
            assert state(app)["database_up"] is False
            assert not {"workers", "unfinished_jobs", "quota_bytes"} & state(app).keys()


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


def test_what_is_no_request_gets_a_problem_document_with_all_headers(store):
    with served(store) as url, socket.create_connection(("127.0.0.1", httpx2.URL(url).port)) as connection:
        connection.sendall(b"nonsense\r\n\r\n")
        answer = b"".join(iter(lambda: connection.recv(4096), b"")).decode()
    head, _, body = answer.partition("\r\n\r\n")
    assert head.startswith("HTTP/1.1 400 Bad Request\r\n")
    assert {f"{name}: {value}" for name, value in ANSWER_HEADERS.items()} <= set(head.split("\r\n"))
    assert json.loads(body)["status"] == 400
