"""Faults below the store: a coded answer, nothing half-stored, and all goes on once they are over."""

import resource
from contextlib import contextmanager
from inspect import iscoroutinefunction

import psycopg
import pytest
from sqlalchemy import event
from support.in_process import Client

from jointstiff.service.api.bodies import EXAMPLES
from jointstiff.service.app import create_app
from jointstiff.service.store.store import Store
from jointstiff.service.workers.doctor import examine

ROBOT = EXAMPLES["robots"]["modified DH"]


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
    assert examine(url).faults == []


def test_a_refusal_waits_for_no_thread():
    """A plain function would run in the pool of threads, and the refused body would stay until it did."""
    with Store.open("sqlite://") as store:
        handlers = create_app(store).exception_handlers
    assert all(iscoroutinefunction(handler) for handler in handlers.values()), handlers
