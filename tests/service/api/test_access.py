"""Access, where more than an answer is asked: roles undeclared, wrong keys, sessions that end, failures.

Who is answered what stands in `tests/recorded/transcripts/access.txt`.
"""

from datetime import UTC, datetime, timedelta

import anyio
import pytest
from fastapi import APIRouter
from starlette.requests import HTTPConnection
from support.in_process import Client

from jointstiff.service import app
from jointstiff.service.api import health
from jointstiff.service.api.bodies import EXAMPLES
from jointstiff.service.app import create_app
from jointstiff.service.problems import StoreUnavailableError
from jointstiff.service.process import LogFormat
from jointstiff.service.security import access
from jointstiff.service.security.access import (
    ANONYMOUS_ENTRIES,
    OPERATOR,
    VIEWER,
    AccessRoute,
    UndeclaredRoleError,
    address_of,
    operation_id,
)
from jointstiff.service.security.admission import Posture
from jointstiff.service.security.keys import digest, mint, mint_token
from jointstiff.service.server import _configuration

NOW = datetime.now(UTC)
KEYS = {role: mint(f"{role}'s key", role, NOW, None) for role in ("viewer", "operator", "admin")}


def bearer(role):
    return {} if role is None else {"Authorization": f"Bearer {KEYS[role].text}"}


@pytest.fixture
def client(store):
    for minted in KEYS.values():
        store.keys.add(minted.record)
    return Client(store, Posture.of("127.0.0.1", (), access_control=True, require_key=True))


def test_an_operation_without_a_role_is_not_composed(monkeypatch, store):
    class Undeclared(APIRouter):
        """Routes of somebody who forgot."""

    monkeypatch.setattr(app, "all_routes", app.all_routes.__wrapped__)  # made anew, not kept
    for wrong in (
        AccessRoute("/v1/new", lambda: None),
        AccessRoute("/v1/new", lambda: None, dependencies=[VIEWER, OPERATOR]),
        APIRouter().route_class("/v1/new", lambda: None, dependencies=[VIEWER]),  # would not ask
    ):
        router = Undeclared()
        router.routes.append(wrong)
        monkeypatch.setattr(health, "router", router)
        with pytest.raises(UndeclaredRoleError, match="/v1/new"):
            create_app(store)


def test_wrong_keys_slow_down_and_good_ones_do_not(client, store, monkeypatch):
    slept = []

    async def sleep(seconds):
        slept.append(seconds)

    monkeypatch.setattr(access, "sleep", sleep)
    wrong = {"Authorization": f"Bearer {mint('stranger', 'admin', NOW, None).text}"}
    answers = [client.request("POST", "/v1/runs", headers=wrong) for _ in range(20)]
    assert [answer.status_code for answer in answers] == [401] * 11 + [429] * 9
    assert answers[-1].headers["Retry-After"]
    assert slept == [access.SLOW_SECONDS] * 9
    assert client.get("/v1/robots", headers=bearer("viewer")).status_code == 200
    assert client.request("POST", "/v1/session", json={"link": "x"}).status_code == 429
    token, now = mint_token("jsl"), datetime.now(UTC)
    store.sessions.offer(digest(token), KEYS["viewer"].record.id, now, now + timedelta(minutes=10))
    taps = [client.request("POST", "/v1/session", json={"link": token}) for _ in range(20)]
    assert [answer.status_code for answer in taps] == [201] + [401] * 19  # a second tap is no wrong key


@pytest.mark.parametrize("ends", ["session", "key"])
def test_an_answer_that_goes_on_ends_with_the_session_or_the_key(ends, client, store):
    guard, key = client._app.state.gate, KEYS["viewer"].record
    signed = client.request("POST", "/v1/session", json={"key": KEYS["viewer"].text})
    cookie = signed.headers["Set-Cookie"].partition(";")[0]
    scope = {"type": "http", "headers": [(b"cookie", cookie.encode()), (b"host", b"localhost:8000")]}

    def still_opens(*headers):
        headed = scope | {"headers": [*scope["headers"], *headers]}
        return anyio.run(guard.still_opens, HTTPConnection(headed), key)

    assert still_opens()
    if ends == "session":
        client.request("DELETE", "/v1/session", headers={"Cookie": cookie})
    else:
        store.keys.revoke(key.id, NOW)
        guard.keyring.look()
    assert not still_opens()
    assert still_opens((b"authorization", b"Bearer")) == (ends == "session"), "a key needs no session"


def test_an_address_that_a_proxy_invents_is_unknown():
    assert address_of({"client": ("10.0.0.7", 80)}) == "10.0.0.7"
    assert [address_of({"client": client}) for client in (("=HYPERLINK(1)", 0), None)] == ["unknown"] * 2
    assert address_of({}) == "unknown"


def test_those_without_a_key_cannot_fill_the_audit(client, store, caplog):
    for _ in range(ANONYMOUS_ENTRIES + 20):
        client.request("POST", "/v1/robots")
    entries = store.audit.page(1000).records
    assert ANONYMOUS_ENTRIES <= len(entries) <= 2 * ANONYMOUS_ENTRIES  # a minute may have begun meanwhile
    client.request("POST", "/v1/robots", headers=bearer("viewer"))
    assert store.audit.page(1).records[0].key_name == "viewer's key"


def test_an_unexpected_failure_stands_in_the_audit(client, store, monkeypatch):
    def fail(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr("jointstiff.service.resources.stored.Robots.create", fail)
    with pytest.raises(ZeroDivisionError):
        client.request(
            "POST", "/v1/robots", json=EXAMPLES["robots"]["modified DH"], headers=bearer("operator")
        )
    assert store.audit.page(1).records[0].status == 500


def test_a_database_that_is_away_lets_nobody_in(client, store, monkeypatch):
    def away():
        raise StoreUnavailableError("gone", "wait")

    monkeypatch.setattr(store.keys, "all", away)
    assert client.get("/v1/kinematics", headers=bearer("viewer")).status_code == 503
    assert client.request("POST", "/v1/session", json={"key": KEYS["viewer"].text}).status_code == 503


def test_operations_are_called_as_openapi_calls_them(openapi):
    names = {each["operationId"] for path in openapi["paths"].values() for each in path.values()}
    assert {operation_id(route) for route in health.router.routes} - {"getIndex"} <= names


@pytest.mark.parametrize(
    ("trusted", "seen"), [(None, "127.0.0.1"), ("192.0.2.1", "127.0.0.1"), ("127.0.0.1", "198.51.100.9")]
)
def test_only_a_configured_proxy_says_where_a_request_comes_from(trusted, seen, monkeypatch):
    monkeypatch.delenv("FORWARDED_ALLOW_IPS", raising=False)
    if trusted:
        monkeypatch.setenv("FORWARDED_ALLOW_IPS", trusted)
    addresses = []

    async def app(scope, _receive, _send):
        addresses.append(scope["client"][0])

    config = _configuration(app, LogFormat.JSON)
    config.load()
    headers = [(b"x-forwarded-for", b"198.51.100.9")]
    scope = {"type": "http", "client": ("127.0.0.1", 80), "scheme": "http", "headers": headers}
    anyio.run(config.loaded_app, scope, None, None)
    assert addresses == [seen]
