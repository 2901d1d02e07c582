"""Access: own names, keys and roles, sessions of browsers, what other sites ask for, and the audit."""

import re
from datetime import UTC, datetime, timedelta

import anyio
import httpx2
import pytest
from fastapi import APIRouter
from starlette.requests import HTTPConnection
from support.in_process import Client
from support.keyed import KEYS, NOW, ROLES, bearer, offered, opened, signed_in

from jointstiff.schemas.finding import Problem
from jointstiff.service import app
from jointstiff.service.api import health
from jointstiff.service.api.examples import EXAMPLES
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
    get_client_address,
    make_operation_id,
)
from jointstiff.service.security.admission import AccessPolicy
from jointstiff.service.security.keys import hash_secret, make_key
from jointstiff.service.server import configure_uvicorn
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign

PUBLIC = {"getLive", "getSession", "createSession", "deleteSession"}
READS_BY_POST = {"computeKinematics"}
ADMINS = {"createKey", "listKeys", "revokeKey", "listAudit"}


@pytest.fixture
def client(store):
    return opened(store)


@pytest.fixture(scope="module")
def shared():
    with Store.open("sqlite://") as store:
        yield opened(store)


def operations(openapi):
    """Method, path, name and security of each operation."""
    for path, methods in openapi["paths"].items():
        for method, operation in methods.items():
            yield method, path, operation["operationId"], operation.get("security")


def test_each_role_may_do_what_is_declared_and_no_more(openapi, client, subtests):
    """What is declared stands in OpenAPI, and is checked here against the rule it should follow."""
    for method, path, name, security in operations(openapi):
        with subtests.test(name):
            needed = None if security is None else security[-1]["key"][0]
            assert needed in {None, "admin"} or security[0] == {}, "a service may demand no key"
            assert needed != "admin" or len(security) == 1
            if name in PUBLIC:
                assert needed is None
            elif name in ADMINS:
                assert needed == "admin"
            else:
                assert needed == ("viewer" if method == "get" or name in READS_BY_POST else "operator")
            address = re.sub(r"\{\w+\}", "0" * 10, path)
            for role in (None, *ROLES):
                status = client.request(method.upper(), address, headers=bearer(role)).status_code
                if needed is None:
                    assert status not in {401, 403}
                elif role is None:
                    assert status == 401
                else:
                    assert (status == 403) == (ROLES.index(role) < ROLES.index(needed)), (role, status)
                    assert status != 401


@pytest.mark.parametrize("path", ["/", "/favicon.svg", "/worker.js", "/docs", "/docs/", "/live"])
def test_the_page_and_life_need_none(path, shared):
    assert shared.get(path).status_code not in {401, 403}


@pytest.mark.parametrize(
    "path", ["/docs/../v1/robots", "/assets/..%2f..%2fv1/robots", "//v1/robots", "/docs/%2e%2e/v1"]
)
def test_no_detour_leads_to_what_needs_one(path, shared):
    assert shared.get(path).status_code in {401, 404, 405}


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


def test_a_wrong_key_is_not_made_good_by_a_session(client):
    cookie = signed_in(client)
    headers = {"Cookie": cookie, "Authorization": "Bearer jst_wrong"}
    assert client.get("/v1/robots", headers=headers).status_code == 401


def test_wrong_keys_slow_down_and_good_ones_do_not(client, store, monkeypatch):
    slept = []

    async def sleep(seconds):
        slept.append(seconds)

    monkeypatch.setattr(access, "sleep", sleep)
    wrong = {"Authorization": f"Bearer {make_key('stranger', 'admin', NOW, None).text}"}
    answers = [client.request("POST", "/v1/runs", headers=wrong) for _ in range(20)]
    assert [answer.status_code for answer in answers] == [401] * 11 + [429] * 9
    assert answers[-1].headers["Retry-After"]
    assert slept == [access.SLOW_SECONDS] * 9
    assert client.get("/v1/robots", headers=bearer("viewer")).status_code == 200
    assert client.request("POST", "/v1/session", json={"link": "x"}).status_code == 429
    token = offered(store)
    assert client.request("POST", "/v1/session", json={"link": token}).status_code == 201


def test_who_signs_in_again_leaves_no_session_behind(client):
    before = signed_in(client)
    after = signed_in(client, "admin", Cookie=before)
    assert client.get("/v1/robots", headers={"Cookie": before}).status_code == 401
    assert client.get("/v1/robots", headers={"Cookie": after}).status_code == 200


@pytest.mark.parametrize("origin", ["http://localhost:8000", "https://localhost:8000"])
def test_a_browser_signs_in_is_known_and_signs_out(origin, client, store):
    made = client.request(
        "POST", "/v1/session", json={"key": KEYS["viewer"].text}, headers={"Origin": origin}
    )
    cookie, _, flags = made.headers["Set-Cookie"].partition("; ")
    secure = "; Secure" if origin.startswith("https") else ""
    assert flags == f"HttpOnly; Max-Age=604800; Path=/; SameSite=strict{secure}"
    name, token = cookie.split("=")
    assert name == "jointstiff_8000"
    assert store.sessions.find(token, NOW) is None  # only its hash is there
    assert store.sessions.find(hash_secret(token), NOW)
    who = client.get("/v1/session", headers={"Cookie": cookie}).json()
    assert who["key_name"] == "viewer's key"
    week = datetime.fromisoformat(who["ends_at"]) - datetime.now(UTC)
    assert timedelta(days=6.99) < week < timedelta(days=7.01)
    out = client.request("DELETE", "/v1/session", headers={"Cookie": cookie})
    assert out.status_code == 204
    ended = re.sub("expires=[^;]*; ", "", out.headers["Set-Cookie"])
    assert ended == 'jointstiff_8000=""; HttpOnly; Max-Age=0; Path=/; SameSite=strict'
    assert client.get("/v1/robots", headers={"Cookie": cookie}).status_code == 401
    assert client.get("/v1/session", headers={"Cookie": cookie}).json()["key_id"] is None


def test_a_second_tap_on_a_link_is_no_wrong_key(client, store):
    token = offered(store)
    taps = [client.request("POST", "/v1/session", json={"link": token}) for _ in range(20)]
    assert [answer.status_code for answer in taps] == [201] + [401] * 19
    strangers = [client.request("POST", "/v1/session", json={"link": "x"}) for _ in range(12)]
    assert [answer.status_code for answer in strangers] == [401] * 11 + [429]


def test_a_link_signs_one_browser_in_once_and_in_time(client, store):
    key_id = KEYS["viewer"].record.id
    token, late, orphan = offered(store), offered(store, lasts=timedelta(0)), offered(store, "0" * 10)
    first, again, *others = (
        client.request("POST", "/v1/session", json={"link": one}) for one in (token, token, late, orphan)
    )
    assert first.status_code == 201
    assert first.json()["key_id"] == key_id
    for refused in (again, *others):
        assert refused.status_code == 401
        assert "ten minutes" in refused.json()["detail"]


@pytest.mark.parametrize("ends", ["session", "key"])
def test_an_answer_that_goes_on_ends_with_the_session_or_the_key(ends, client, store):
    guard, key = client._app.state.gate, KEYS["viewer"].record
    cookie = signed_in(client)
    scope = {"type": "http", "headers": [(b"cookie", cookie.encode()), (b"host", b"localhost:8000")]}

    def still_opens(*headers):
        headed = scope | {"headers": [*scope["headers"], *headers]}
        return anyio.run(guard.may_continue, HTTPConnection(headed), key)

    assert still_opens()
    if ends == "session":
        client.request("DELETE", "/v1/session", headers={"Cookie": cookie})
    else:
        store.keys.revoke(key.id, NOW)
        guard.keyring.read_keys()
    assert not still_opens()
    assert still_opens((b"authorization", b"Bearer")) == (ends == "session"), "a key needs no session"


def test_who_changes_what_stands_in_the_audit(client, store):
    robot = EXAMPLES["robots"]["modified DH"]
    assert client.request("POST", "/v1/robots", json=robot, headers=bearer("operator")).status_code == 201
    assert client.request("POST", "/v1/robots", json=robot, headers=bearer("viewer")).status_code == 403
    assert client.request("POST", "/v1/robots", json=robot).status_code == 401
    assert (
        client.request(
            "PATCH", f"/v1/jobs/{KEYS['admin'].text}", json={"deleted": True}, headers=bearer("operator")
        ).status_code
        == 422
    )
    client.request("PUT", "/v1/robots", headers=bearer("operator"))
    signed_in(client)
    client.get("/v1/robots", headers=bearer("viewer"))
    listed = client.get("/v1/audit", headers=bearer("admin")).json()["items"]
    assert [
        (one["key_name"], one["method"], one["operation"], one["status"]) for one in reversed(listed)
    ] == [
        ("operator's key", "POST", "createRobot", 201),
        ("viewer's key", "POST", "createRobot", 403),
        (None, "POST", None, 401),
        ("operator's key", "PATCH", "changeJob", 422),
        ("operator's key", "PUT", None, 405),
        ("viewer's key", "POST", "createSession", 201),
    ]
    assert listed[2]["path"] == "/v1/jobs/jst_…"
    assert {one["address"] for one in listed} == {"127.0.0.1"}
    mine = client.get(f"/v1/audit?key_id={KEYS['viewer'].record.id}&limit=1", headers=bearer("admin")).json()
    assert mine["items"][0]["operation"] == "createSession"
    assert mine["next"]


def test_an_address_that_a_proxy_invents_is_unknown():
    assert get_client_address({"client": ("10.0.0.7", 80)}) == "10.0.0.7"
    assert [get_client_address({"client": client}) for client in (("=HYPERLINK(1)", 0), None)] == [
        "unknown"
    ] * 2
    assert get_client_address({}) == "unknown"


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


def test_jobs_name_the_key_that_asked_for_them(client, store):
    campaign = simulate_campaign(default_arm(), configurations=6)
    headers = bearer("operator")
    run = client.request("POST", "/v1/campaigns", json=campaign, headers=headers).json()
    expected = {"key_id": KEYS["operator"].record.id, "key_name": "operator's key"}
    assert run == client.get(f"/v1/jobs/{run['id']}", headers=headers).json()
    assert {name: run[name] for name in expected} == expected


def test_uses_are_noted(client, store):
    cookie = signed_in(client, "operator")
    used: dict[str, object] = {}
    for _ in range(1_000):  # written in the background; where the database is busy, a later use is noted
        client.get("/v1/robots", headers=bearer("viewer"))
        client.get("/v1/robots", headers={"Cookie": cookie})
        used = {key.name: key.last_used_at for key in store.keys.all()}
        if used["viewer's key"] and used["operator's key"]:
            break
    assert used["viewer's key"]
    assert used["operator's key"]
    assert used["admin's key"] is None


def test_operations_are_called_as_openapi_calls_them(openapi):
    names = {name for *_, name, _ in operations(openapi)}
    assert {make_operation_id(route) for route in health.router.routes} - {"getIndex"} <= names


ROBOT = EXAMPLES["robots"]["modified DH"]


@pytest.fixture(scope="module")
def named():
    """A client of an empty service; who changes something needs one of its own."""
    with Store.open("sqlite://") as store:
        yield Client(store, AccessPolicy.from_address("127.0.0.1", ("cell3",), access_control=True))


def assert_refused(answer: httpx2.Response, status: int, reason: str, remedy: str) -> None:
    problem = Problem.model_validate_json(answer.content)
    assert answer.status_code == problem.status == status
    assert problem.detail == reason
    assert problem.remedy.startswith(remedy)


FOREIGN = (
    "the request names a host that is not this service",
    "start the service with --allowed-host and this name",
)
OTHER_SITE = ("a page of another site requested a change", "use the service's own page, or a program")
NO_KEY_YET = (
    "this service has no key yet, so the service answers only requests from its own machine",
    "create a key with `jointstiff keys create NAME --role ROLE` where the service runs",
)


@pytest.mark.parametrize(
    "host", ["localhost", "LOCALHOST:8000", "127.0.0.1:1", "[::1]:8000", "cell3:80", "localhost."]
)
def test_own_names_are_answered(named, host):
    assert named.get("/health", headers={"Host": host}).json()["access"] == "loopback"


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "localhost.evil.example",
        "localhost..",
        "127.0.0.1.evil.example:8000",
        "",
        "user@localhost",
        "localhost:8000:1",
        "10.0.0.1",
    ],
)
@pytest.mark.parametrize(
    ("method", "path"),
    [("GET", "/v1/robots"), ("GET", "/"), ("POST", "/v1/robots"), ("OPTIONS", "/v1")],
)
def test_foreign_names_are_not(named, host, method, path):
    assert_refused(named.request(method, path, headers={"Host": host}), 421, *FOREIGN)


def test_two_names_are_none(named):
    headers = httpx2.Headers([("Host", "localhost"), ("Host", "evil.example")])
    assert_refused(named.get("/health", headers=headers), 421, *FOREIGN)


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "http://localhost:9000"},
        {"Origin": "null"},
        {"Origin": ""},
        {"Origin": "http://[evil"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
        {"Origin": "http://localhost:8000", "Sec-Fetch-Site": "cross-site"},
    ],
)
@pytest.mark.parametrize(("method", "path"), [("POST", "/v1/robots"), ("PATCH", "/v1/jobs/1")])
def test_changes_that_other_sites_ask_for_are_refused(named, headers, method, path):
    assert_refused(named.request(method, path, headers=headers), 403, *OTHER_SITE)
    assert named.get("/live", headers=headers).status_code == 204
    assert named.get("/v1/robots").json()["items"] == []


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Origin": "http://localhost:8000", "Sec-Fetch-Site": "same-origin"},
        {"Origin": "https://localhost:8000"},
    ],
)
def test_the_own_page_and_programs_may_change(headers):
    with Store.open("sqlite://") as store:
        named = Client(store, AccessPolicy.from_address("127.0.0.1", (), access_control=True))
        assert named.request("POST", "/v1/robots", json=ROBOT, headers=headers).status_code == 201


def test_a_service_that_awaits_its_key_answers_its_own_machine_only():
    """As the image does: Docker hands on what comes to a published port from an address of its own."""
    with Store.open("sqlite://") as store:
        posture = AccessPolicy.from_address("0.0.0.0", (), access_control=True)  # noqa: S104 - the address of containers
        beyond = Client(store, posture, address="172.17.0.1")
        for method, path in (("GET", "/"), ("GET", "/v1/robots"), ("POST", "/v1/robots")):
            answer = beyond.request(method, path, json=None if method == "GET" else ROBOT)
            assert_refused(answer, 403, *NO_KEY_YET)
        assert beyond.get("/live").status_code == 204
        assert Client(store, posture).get("/v1/robots").status_code == 401
        store.keys.add((minted := make_key("viewer", "viewer", datetime.now(UTC), None)).record)
        headers = {"Authorization": f"Bearer {minted.text}"}
        beyond = Client(store, posture, address="172.17.0.1")
        assert beyond.get("/v1/robots").status_code == 401
        assert beyond.get("/v1/robots", headers=headers).status_code == 200


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

    config = configure_uvicorn(app, LogFormat.JSON)
    config.load()
    headers = [(b"x-forwarded-for", b"198.51.100.9")]
    scope = {"type": "http", "client": ("127.0.0.1", 80), "scheme": "http", "headers": headers}
    anyio.run(config.loaded_app, scope, None, None)
    assert addresses == [seen]
