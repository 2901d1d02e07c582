"""Who is answered: own names only, and no change that another site's page asks for."""

from datetime import UTC, datetime

import anyio
import httpx2
import pytest
from support.in_process import Client
from support.terminal import terminal

from jointstiff.schemas.finding import Problem
from jointstiff.service.api.bodies import EXAMPLES
from jointstiff.service.process import LogFormat
from jointstiff.service.security.admission import Posture
from jointstiff.service.security.keys import mint
from jointstiff.service.server import _configuration
from jointstiff.service.store.store import Store

ROBOT = EXAMPLES["robots"]["modified DH"]


@pytest.fixture(scope="module")
def client():
    """A client of an empty service; who changes something needs one of its own."""
    with Store.open("sqlite://") as store:
        yield Client(store, Posture.of("127.0.0.1", ("cell3",), access_control=True))


def assert_refused(answer: httpx2.Response, status: int) -> None:
    assert answer.status_code == status
    problem = Problem.model_validate_json(answer.content)
    assert problem.status == status
    assert problem.remedy


@pytest.mark.parametrize(
    "host", ["localhost", "LOCALHOST:8000", "127.0.0.1:1", "[::1]:8000", "cell3:80", "localhost."]
)
def test_own_names_are_answered(client, host):
    assert client.get("/health", headers={"Host": host}).json()["access"] == "loopback"


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
    ("method", "path"), [("GET", "/v1/robots"), ("GET", "/"), ("POST", "/v1/robots"), ("OPTIONS", "/v1")]
)
def test_foreign_names_are_not(client, host, method, path):
    assert_refused(client.request(method, path, headers={"Host": host}), 421)


def test_two_names_are_none(client):
    headers = httpx2.Headers([("Host", "localhost"), ("Host", "evil.example")])
    assert_refused(client.get("/health", headers=headers), 421)


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
@pytest.mark.parametrize(("method", "path"), [("POST", "/v1/robots"), ("DELETE", "/v1/jobs/1")])
def test_changes_that_other_sites_ask_for_are_refused(client, headers, method, path):
    assert_refused(client.request(method, path, headers=headers), 403)
    assert client.get("/v1/robots").json()["items"] == []


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
        client = Client(store, Posture.of("127.0.0.1", (), access_control=True))
        assert client.request("POST", "/v1/robots", json=ROBOT, headers=headers).status_code == 201


def test_without_access_control_any_name_is_answered_only_if_that_is_said():
    with pytest.raises(ValueError, match="the service has no name"):
        Posture.of("192.0.2.1", (), access_control=False)
    with Store.open("sqlite://") as store:
        everything = Client(store, Posture.of("192.0.2.1", ("*",), access_control=False), "cell3.example")
        assert everything.get("/health").json()["access"] == "none"
        named = Client(
            store, Posture.of("192.0.2.1", ("Cell3.example",), access_control=False), "cell3.example"
        )
        assert named.get("/health").status_code == 200
        assert_refused(named.get("/health", headers={"Host": "evil.example"}), 421)


def test_on_a_loopback_address_no_sign_stands_for_any_name():
    with Store.open("sqlite://") as store:
        client = Client(store, Posture.of("127.0.0.1", ("*",), access_control=True), "evil.example")
        assert_refused(client.get("/health"), 421)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--host", "::"], "keys create"),
        (["--require-key"], "keys create"),
        (["--keys-file", "missing.json"], "keys create"),
        (["--host", "192.0.2.1", "--no-access-control"], "--allowed-host"),
        (["--host", "::", "--no-access-control", "--require-key"], "both"),
    ],
)
def test_the_service_does_not_start_where_nothing_controls_who_is_answered(options, reason, tmp_path):
    database = f"sqlite:///{tmp_path / 'jointstiff.db'}"
    ended = terminal("serve", "--port", "0", "--database", database, *options)
    assert ended.exit_code == 2
    assert reason in ended.output
    assert "remedy" in ended.output


def test_a_service_that_awaits_its_key_answers_its_own_machine_only():
    """As the image does: Docker hands on what comes to a published port from an address of its own."""
    with Store.open("sqlite://") as store:
        posture = Posture.of("0.0.0.0", (), access_control=True)  # noqa: S104 - the address of containers
        beyond = Client(store, posture, address="172.17.0.1")
        for method, path in (("GET", "/"), ("GET", "/v1/robots"), ("POST", "/v1/robots")):
            answer = beyond.request(method, path, json=None if method == "GET" else ROBOT)
            assert_refused(answer, 403)
            assert "keys create" in answer.json()["remedy"]
        assert beyond.get("/live").status_code == 204
        assert Client(store, posture).get("/v1/robots").status_code == 401
        store.keys.add((minted := mint("viewer", "viewer", datetime.now(UTC), None)).record)
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

    config = _configuration(app, LogFormat.JSON)
    config.load()
    headers = [(b"x-forwarded-for", b"198.51.100.9")]
    scope = {"type": "http", "client": ("127.0.0.1", 80), "scheme": "http", "headers": headers}
    anyio.run(config.loaded_app, scope, None, None)
    assert addresses == [seen]
