"""Large bodies are answered by a child process, as the service itself would, within limits."""

import io
import json
import os
import resource
import signal
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import UTC, datetime
from multiprocessing import Pipe
from threading import Thread

import pytest
from support.in_process import Client
from support.processes import until

from jointstiff.service import limited
from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.limited import LimitedChildren, Template
from jointstiff.service.security.access import Requester
from jointstiff.service.security.admission import AccessPolicy
from jointstiff.service.security.keys import make_key
from jointstiff.service.store.store import Store

JSON = {"Content-Type": "application/json"}
FORM = "multipart/form-data; boundary=b"
LARGE = json.dumps(EXAMPLES["robots"]["modified DH"]).encode().ljust(limited.LIMITED_BYTES + 1)


@pytest.fixture(scope="module")
def database(tmp_path_factory):
    return f"sqlite:///{tmp_path_factory.mktemp('limited') / 'jointstiff.db'}"


@pytest.fixture(scope="module")
def store(database):
    with Store.open(database) as opened:
        yield opened


@pytest.fixture(scope="module")
def template():
    with closing(Template()) as process:
        yield process


@pytest.fixture(scope="module")
def child(database, template):
    with closing(LimitedChildren(template, database)) as started:
        yield started


@pytest.fixture(scope="module")
def client(store, child):
    client = Client(store)
    client._app.state.answer_elsewhere = child.answer
    return client


def test_what_the_child_stores_is_stored(client, child):
    key = {"Idempotency-Key": "once"}
    answer = client.request("POST", "/v1/robots", content=LARGE, headers=JSON | key)
    assert answer.status_code == 201
    assert child._idle
    assert client.get(answer.headers["Location"]).json() == answer.json()
    assert client.request("POST", "/v1/robots", content=LARGE, headers=JSON | key).json() == answer.json()
    assert len(answer.headers.get_list("X-Request-Id")) == 1


def test_its_faults_are_problem_documents_with_the_id_of_the_request(client):
    answer = client.request("POST", "/v1/robots", content=LARGE[:-1] + b"?", headers=JSON)
    assert answer.status_code == 422
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert answer.json()["request_id"] == answer.headers["X-Request-Id"]


def test_large_bodies_are_its_and_archives_programs_and_geometries_of_any_size():
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("a.csv", "a,b\n")
    assert limited.belongs_to_child("/v1/imports", b"--boundary" + content.getvalue(), FORM)
    assert limited.belongs_to_child("/v1/robots", LARGE, "application/json")
    assert not limited.belongs_to_child("/v1/robots", LARGE[:-1], "application/json")
    assert not limited.belongs_to_child(
        "/v1/runs", LARGE, "application/json"
    )  # its answer may wait for workers
    assert limited.belongs_to_child("/v1/corrections", b"--boundary", FORM)
    assert not limited.belongs_to_child("/v1/corrections", b"{}", "application/json")
    assert limited.belongs_to_child("/v1/geometries", b"{}", "application/json")


class InThread(LimitedChildren):
    def _fork_child(self):
        ours, theirs = Pipe()
        self.thread = Thread(target=limited.run_child, args=[os.dup(theirs.fileno())])
        self.thread.start()
        ours.send_bytes(self._settings_message)
        return limited._Child(ours)


def test_it_limits_its_memory_and_time_once_and_goes_on(database, store, monkeypatch):
    limits = []
    monkeypatch.setattr(limited.resource, "setrlimit", lambda kind, bounds: limits.append((kind, bounds[0])))
    client = Client(store)
    with closing(InThread(Template(), database, memory=1 << 40, seconds=50.0)) as child:
        client._app.state.answer_elsewhere = child.answer
        before = time.process_time()
        posted = [client.request("POST", "/v1/robots", content=LARGE, headers=JSON) for _ in range(2)]
    child.thread.join()
    assert [each.status_code for each in posted] == [201, 201]
    kinds, bounds = zip(*limits, strict=True)
    assert kinds == (resource.RLIMIT_DATA, resource.RLIMIT_CPU, resource.RLIMIT_CPU)
    assert (1 << 40) + (1 << 25) < bounds[0] < 1 << 41
    assert all(before + 50.0 <= most <= time.process_time() + 51.0 for most in bounds[1:])


def test_who_asks_is_found_out_before(store, child):
    store.keys.add((minted := make_key("viewer", "viewer", datetime.now(UTC), None)).record)
    guarded = Client(store, AccessPolicy.from_address("127.0.0.1", (), access_control=True, require_key=True))
    guarded._app.state.answer_elsewhere = child.answer
    assert guarded.request("POST", "/v1/robots", content=LARGE, headers=JSON).status_code == 401
    bearer = {"Authorization": f"Bearer {minted.text}"}
    assert guarded.request("POST", "/v1/robots", content=LARGE, headers=JSON | bearer).status_code == 403


def test_one_that_ended_is_started_again(client, child):
    assert client.request("POST", "/v1/robots", content=LARGE, headers=JSON).status_code == 201
    (ended,) = child._idle
    os.kill(ended._process, signal.SIGKILL)
    until(ended.has_ended)
    assert client.request("POST", "/v1/robots", content=LARGE, headers=JSON).status_code == 201
    assert child._idle[0]._process != ended._process


@pytest.mark.process
def test_one_that_is_slow_to_start_goes_on_starting(store, database, template, monkeypatch):
    """As long as its start takes, however many bodies come meanwhile."""
    monkeypatch.setattr(limited, "START_SECONDS", 0.0)
    client, answers = Client(store), []
    with closing(LimitedChildren(template, database)) as slow:
        client._app.state.answer_elsewhere = slow.answer

        def is_answered():
            answers.append(client.request("POST", "/v1/robots", content=LARGE, headers=JSON))
            children.update(slow._idle)
            return answers[-1].status_code == 201

        children = set()
        until(is_answered)
    assert answers[0].status_code == 503
    assert "still starting" in answers[0].json()["detail"]
    assert int(answers[0].headers["Retry-After"]) > 0
    assert len(children) == 1


@pytest.mark.process
def test_a_body_that_hangs_costs_its_sender_alone(store, database, template):
    """Another sender has the other child meanwhile, and the child that hung is replaced."""
    with closing(LimitedChildren(template, database, seconds=4.0)) as children:
        children.prepare()
        assert all(child.is_ready(60.0) for child in children._idle)
        clients = [Client(store) for _ in range(2)]
        for client in clients:
            client._app.state.answer_elsewhere = children.answer

        def post(client):
            return client.request("POST", "/v1/robots", content=LARGE, headers=JSON).status_code

        hanging = children._idle[-1]
        os.kill(hanging._process, signal.SIGSTOP)
        with ThreadPoolExecutor(1) as pool:
            hung = pool.submit(post, clients[0])
            until(lambda: hanging not in children._idle)
            assert post(clients[1]) == 201
            assert not hung.done()
            assert hung.result() == 413
        assert hanging not in children._idle
        assert len(children._idle) == limited.CHILDREN
        assert post(clients[0]) == 201


def test_a_sender_has_one_child_at_a_time():
    """A key is a sender, else an address; programs of this machine without a key may be several senders."""
    children = LimitedChildren(Template(), "sqlite://")
    keys = [make_key(name, "operator", datetime.now(UTC), None).record for name in "ab"]
    turns = [
        children._get_turn(Requester(key, is_open=False, address=address))
        for key in (*keys, None)
        for address in ("192.0.2.1", "192.0.2.2")
    ]
    assert turns[0] is turns[1]
    assert turns[2] is turns[3]
    assert len(set(turns)) == 4
    local = Requester(None, is_open=True, address="127.0.0.1")
    assert children._get_turn(local) is not children._get_turn(local)


@pytest.mark.parametrize("bounds", [{"seconds": 0.0}, {"memory": 4 << 20}], ids=["time", "memory"])
def test_its_time_and_memory_are_limited(bounds, database, template, client, child):
    """300,000 lists take 20 MB, and more time than none."""
    body = b'{"name": [' + b"[]," * 300_000 + b"[]]}"
    with closing(LimitedChildren(template, database, **bounds)) as small:
        client._app.state.answer_elsewhere = small.answer
        answer = client.request("POST", "/v1/robots", content=body, headers=JSON)
    client._app.state.answer_elsewhere = child.answer
    assert answer.status_code == 413
    assert "the body takes more than" in answer.json()["detail"]
