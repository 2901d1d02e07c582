"""What those without access are told, what keys and sessions show, and what the audit keeps."""

import logging
from datetime import UTC, datetime, timedelta

import pytest
from support.api import post
from support.changes import changed
from support.in_process import Client
from support.keyed import KEYS, bearer, offered, opened, signed_in
from support.outcomes import outcome_of
from support.terminal import terminal

from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.security.admission import AccessPolicy
from jointstiff.service.security.keys import hash_secret, make_key
from jointstiff.service.server import _announce
from jointstiff.service.settings import Settings
from jointstiff.service.store.store import Store

ROBOT = EXAMPLES["robots"]["modified DH"]
SEND = (
    "send the header `Authorization: Bearer KEY`, or sign in on the page; "
    "create keys with `jointstiff keys create`"
)
COPY = "copy the whole key, from jst_ to the last character; the key was shown once, when it was created"
ANOTHER = "use another key; create one with `jointstiff keys create NAME --role ROLE`"
NO_KEY = f"401 no-valid-key | - | the request has no key | {SEND}"
NOT_A_KEY = f"401 no-valid-key | - | the text sent is not a key | {COPY}"
MISTYPED = f"401 no-valid-key | - | the key is mistyped: its check sum does not fit | {COPY}"
FOREIGN = f"401 no-valid-key | - | the key does not belong to this service | {ANOTHER}"
USED_LINK = (
    "401 no-valid-key | - | the link was used before, or is older than ten minutes | "
    "use a new link (`jointstiff keys link` makes one), or enter a key"
)
EITHER = "422 invalid-request | body | give either `key` or `link` | correct the field as the reason says"
NO_ADMINS = (
    "403 role | - | keys and the audit need an admin key, but this service requires no keys | "
    "use `jointstiff keys` at the terminal, or start the service with --require-key"
)


@pytest.fixture
def client(store):
    return opened(store)


@pytest.fixture(scope="module")
def shared():
    with Store.open("sqlite://") as store:
        yield opened(store)


@pytest.mark.parametrize("method", ["GET", "POST", "OPTIONS", "TRACE", "HEAD"])
@pytest.mark.parametrize("path", ["/v1", "/v1/nothing", "/v1/robots", "/openapi.json", "/health", "/live/"])
def test_who_has_no_key_is_told_how_to_send_one(method, path, shared):
    answer = shared.request(method, path)
    assert answer.status_code == 401
    assert method == "HEAD" or outcome_of(answer) == NO_KEY
    assert answer.headers["www-authenticate"] == 'Bearer realm="jointstiff"'


@pytest.mark.parametrize(
    ("header", "wanted"),
    [
        ("Bearer ", NOT_A_KEY),
        ("Bearer nonsense", NOT_A_KEY),
        ("Bearer jst_0000000000_x", NOT_A_KEY),
        (f"Bearer {KEYS['admin'].text[:-1]}", NOT_A_KEY),
        (f"bearer {KEYS['admin'].text[:-8]}00000000", MISTYPED),
        (f"BEARER {make_key('stranger', 'admin', datetime.now(UTC), None).text}", FOREIGN),
        ("Basic YWRtaW46YWRtaW4=", NO_KEY),
        (KEYS["admin"].text, NO_KEY),
    ],
    ids=["empty", "a word", "too short", "cut off", "mistyped", "unknown", "another scheme", "no scheme"],
)
def test_a_key_that_does_not_open_is_refused_with_its_reason_and_not_shown(header, wanted, client, caplog):
    caplog.set_level(logging.DEBUG)
    for method, path in (("GET", "/v1/robots"), ("POST", "/v1/robots")):
        answer = client.request(method, path, headers={"Authorization": header})
        assert outcome_of(answer) == wanted
        assert "jst_" not in answer.text.replace("from jst_ to", "") + caplog.text
    if wanted != NO_KEY:  # a session is anybody's to ask for, but not with a wrong key
        assert outcome_of(client.get("/v1/session", headers={"Authorization": header})) == wanted


@pytest.mark.parametrize(
    ("role", "method", "path", "needed"),
    [
        ("viewer", "POST", "/v1/robots", "operator"),
        ("viewer", "PATCH", "/v1/jobs/1", "operator"),
        ("viewer", "POST", "/v1/measurement-sets/1/close", "operator"),
        ("viewer", "GET", "/v1/keys", "admin"),
        ("operator", "POST", "/v1/keys", "admin"),
        ("operator", "DELETE", "/v1/keys/0000000000", "admin"),
        ("operator", "GET", "/v1/audit", "admin"),
    ],
)
def test_a_role_below_the_needed_one_is_refused(role, method, path, needed, shared):
    assert outcome_of(shared.request(method, path, json={}, headers=bearer(role))) == (
        f"403 role | - | the key's role is {role}, but the request needs the role {needed} | "
        f"use a key with the role {needed}; create one with `jointstiff keys create`"
    )


@pytest.mark.parametrize("role", [None, "viewer", "operator", "admin"])
def test_a_session_says_whose_key_it_is(role, shared):
    key = KEYS[role] if role else None
    assert shared.get("/v1/session", headers=bearer(role)).json() == {
        "access": "keys",
        "key_id": key and key.record.id,
        "key_name": key and f"{role}'s key",
        "role": role,
        "ends_at": None,
    }


@pytest.mark.parametrize(
    ("body", "wanted"),
    [
        ({}, EITHER),
        ({"key": None}, EITHER),
        ({"key": "x", "link": "y"}, EITHER),
        ({"key": "x"}, NOT_A_KEY),
        ({"key": KEYS["viewer"].text + "0"}, NOT_A_KEY),
        ({"link": "x"}, USED_LINK),
        (
            {"key": "x" * 300},
            "422 invalid-request | key | must have at most 200 items, but has 300 | send fewer items, or "
            "split the items into several resources",
        ),
        (
            {"key": 1},
            "422 invalid-request | key | must be a text | give a text, in quotes",
        ),
    ],
)
def test_a_sign_in_that_fails_sets_no_cookie(body, wanted, client):
    answer = client.request("POST", "/v1/session", json=body)
    assert outcome_of(answer) == wanted
    assert "xxx" not in answer.text
    assert "set-cookie" not in answer.headers


def test_an_open_service_needs_no_sign_in_and_issues_no_keys(store):
    key = KEYS["viewer"].record
    store.keys.add(key)
    client, link = Client(store), offered(store)
    assert outcome_of(client.request("POST", "/v1/session", json={"link": link})) == (
        "422 invalid-request | - | sign-in is not needed: this service requires no key | open the page; "
        "the link stays valid for a service that requires keys"
    )
    for method, path in (
        ("POST", "/v1/keys"),
        ("GET", "/v1/keys"),
        ("DELETE", "/v1/keys/0000000000"),
        ("GET", "/v1/audit"),
    ):
        assert outcome_of(client.request(method, path, json={"name": "x", "role": "admin"})) == NO_ADMINS
    assert client.request("POST", "/v1/robots", json=ROBOT).status_code == 201
    assert store.sessions.redeem(hash_secret(link), datetime.now(UTC)) == key.id
    assert (store.keys.all(), store.audit.page(9).records) == ([key], ())
    health = client.get("/health").json()
    assert health.pop("stored_bytes") > 0
    assert health.pop("version")
    assert health == {
        "status": "ok",
        "workers": 0,
        "failing_workers": 0,
        "database": "sqlite",
        "quota_bytes": None,
        "access": "loopback",
        "stuck": [],
        "queue": {"waiting": 0, "oldest_s": 0},
        "solver": None,
    }


KEY = {"name": "tablet hall 3", "role": "viewer", "expires_at": "2999-01-01T00:00:00Z"}


@pytest.mark.parametrize(
    ("field", "value", "wanted"),
    [
        (
            "name",
            "",
            "name | must have at least 1 character | write a longer text",
        ),
        (
            "role",
            "owner",
            "role | must be 'viewer', 'operator' or 'admin' | use one of these words exactly as written",
        ),
        (
            "expires_at",
            "2001-01-01T00:00:00Z",
            "expires_at | the key would have expired already | give a time in the future",
        ),
        (
            "expires_at",
            "9999-12-31T23:59:59-12:00",
            "expires_at | must be a time before the year 10000 in UTC | correct the field as the reason says",
        ),
        (
            "expires_at",
            "2999-01-01T00:00:00",
            "expires_at | must have a time zone | add the time zone, such as 2026-11-20T14:30:00+01:00",
        ),
    ],
)
def test_a_key_is_made_with_a_name_a_role_and_an_end_to_come(field, value, wanted, client, store):
    answer = client.request("POST", "/v1/keys", json=changed(KEY, field, value), headers=bearer("admin"))
    assert outcome_of(answer) == f"422 invalid-request | {wanted}"
    assert len(store.keys.all()) == len(KEYS)


def test_the_text_of_a_key_is_shown_once_and_revoked_it_opens_nothing(client):
    made = post(client, "/v1/keys", KEY, **bearer("admin"))
    key, text = made["id"], made.pop("key")
    assert text.startswith("jst_")
    created = datetime.fromisoformat(made.pop("created_at"))
    assert datetime.now(UTC) - created < timedelta(minutes=5)
    assert made == KEY | {"id": key, "source": "database", "revoked_at": None, "last_used_at": None}
    headers = {"Authorization": f"Bearer {text}"}
    cookie = client.request("POST", "/v1/session", json={"key": text}).headers["set-cookie"].split(";")[0]
    assert client.get("/v1/robots", headers=headers).status_code == 200
    revoked = client.request("DELETE", f"/v1/keys/{key}", headers=bearer("admin")).json()
    assert (revoked["revoked_at"] is not None, revoked["key"]) == (True, None)
    assert outcome_of(client.get("/v1/robots", headers=headers)) == (
        f"401 no-valid-key | - | the key was revoked | {ANOTHER}"
    )
    assert outcome_of(client.get("/v1/robots", headers={"Cookie": cookie})).startswith("401 no-valid-key")
    listed = client.get("/v1/keys", headers=bearer("admin")).json()
    assert {each["key"] for each in listed} == {None}
    assert {each["name"]: (each["revoked_at"], each["expires_at"]) for each in listed} == {
        **{f"{role}'s key": (None, None) for role in KEYS},
        "tablet hall 3": (revoked["revoked_at"], "2999-01-01T00:00:00Z"),
    }
    assert "key_hash" not in str(listed)
    secret = text.split("_")[2]
    audit = client.get("/v1/audit?limit=100", headers=bearer("admin")).text
    assert secret not in str(listed) + audit


def test_what_is_no_id_of_a_key_revokes_nothing(client, store):
    answer = client.request("DELETE", "/v1/keys/nobody", headers=bearer("admin"))
    assert outcome_of(answer) == (
        "422 invalid-request | path.key_id | must match the pattern '^[0-9a-f]{10}$' | "
        "correct the parameter as the reason says"
    )
    missing = client.request("DELETE", "/v1/keys/0000000000", headers=bearer("admin"))
    assert missing.status_code == 404
    assert [key.revoked_at for key in store.keys.all()] == [None] * 3


def test_the_audit_keeps_the_beginning_of_an_address_without_keys_and_signs_that_steer_terminals(store):
    client = opened(store, address="10.0.0.2")
    for path, status in (
        ("/v1/%1b" + "a" * 300, 404),
        (f"/v1/jobs/{KEYS['admin'].text}", 405),
        ("/v1/robots", 405),
    ):
        assert client.request("PUT", path, headers=bearer("operator")).status_code == status
    signed_in(client)
    listed = client.get("/v1/audit?limit=4", headers=bearer("admin")).json()["items"]
    assert [
        (each["key_name"], each["operation"], each["path"], each["status"]) for each in reversed(listed)
    ] == [
        ("operator's key", None, "/v1/\ufffd" + "a" * 195, 404),
        ("operator's key", None, "/v1/jobs/jst_…", 405),
        ("operator's key", None, "/v1/robots", 405),
        ("viewer's key", "createSession", "/v1/session", 201),
    ]
    assert {each["address"] for each in listed} == {"10.0.0.2"}


def test_the_audit_as_a_table_names_its_columns(client):
    made = post(client, "/v1/keys", {"name": "=1+1", "role": "operator"}, **bearer("admin"))
    for _ in range(3):
        client.request("POST", "/v1/runs", headers={"Authorization": f"Bearer {made['key']}"})
    table = client.get(f"/v1/audit?format=csv&key_id={made['id']}", headers=bearer("admin"))
    assert table.headers["content-disposition"] == 'attachment; filename="audit.csv"'
    head, row, *rest = table.text.splitlines()
    assert head == "at,key_id,key_name,address,method,operation,path,status"
    assert row.split(",")[1:] == [made["id"], "'=1+1", "127.0.0.1", "POST", "createRun", "/v1/runs", "415"]
    assert len(rest) == 2
    whole = client.get("/v1/audit?format=csv", headers=bearer("admin")).text.splitlines()
    assert len(whole) == 1 + 1 + 3


@pytest.mark.parametrize("host", ["cell3.example", "evil.example"])
@pytest.mark.parametrize(
    ("address", "hosts", "access_control", "access", "answered"),
    [
        ("192.0.2.1", ("*",), False, "none", {"cell3.example": 200, "evil.example": 200}),
        ("192.0.2.1", ("*",), True, "keys", {"cell3.example": 401, "evil.example": 401}),
        ("192.0.2.1", ("Cell3.example",), False, "none", {"cell3.example": 200, "evil.example": 421}),
        ("192.0.2.1", ("Cell3.example",), True, "keys", {"cell3.example": 401, "evil.example": 421}),
        ("127.0.0.1", ("*",), False, "loopback", {"cell3.example": 421, "evil.example": 421}),
        ("127.0.0.1", ("*",), True, "loopback", {"cell3.example": 421, "evil.example": 421}),
    ],
)
def test_names_and_keys_decide_who_is_answered(address, hosts, access_control, access, answered, host):
    posture = AccessPolicy.from_address(address, hosts, access_control=access_control)
    assert posture.access == access
    with Store.open("sqlite://") as store:
        store.keys.add(KEYS["viewer"].record)
        assert Client(store, posture, host).get("/health").status_code == answered[host]


@pytest.mark.parametrize(
    ("address", "require_key", "reason"),
    [
        ("192.0.2.1", False, "other machines can reach this address, but no host name is allowed"),
        ("127.0.0.1", True, "cannot both require keys and leave access control to a proxy"),
    ],
)
def test_nothing_is_answered_where_nobody_controls_access(address, require_key, reason):
    with pytest.raises(ValueError, match=reason):
        AccessPolicy.from_address(address, (), access_control=False, require_key=require_key)


UNCONTROLLED = {
    "--host ::": "the service will not start: it requires keys, but no key is valid",
    "--require-key": "the service will not start: it requires keys, but no key is valid",
    "--keys-file missing.json": "the file of keys missing.json cannot be used: No such file or directory",
    "--host 192.0.2.1 --no-access-control": (
        "the service will not listen on 192.0.2.1: other machines can reach this address, but no host name "
        "is allowed"
    ),
    "--host :: --no-access-control --require-key": (
        "the service will not listen on ::: the service cannot both require keys and leave access control to "
        "a proxy"
    ),
}


@pytest.mark.parametrize("options", UNCONTROLLED)
def test_the_service_says_why_it_does_not_start(options, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = ["--port", "0", "--database", "sqlite:///jointstiff.db", *options.split()]
    ended = terminal("serve", *arguments, width=400)
    assert ended.exit_code == 2
    reason, remedy = ended.stderr.strip().splitlines()
    assert reason == UNCONTROLLED[options]
    assert remedy.startswith("  remedy: ")
    assert "keys create" in remedy


HEADERS = {
    "cache-control": "no-store",
    "content-security-policy": "default-src 'none'; frame-ancestors 'none'",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}


@pytest.mark.parametrize("host", ["localhost:8000", "evil.example"])
@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/health"),
        ("GET", "/v1/robots"),
        ("HEAD", "/v1/robots"),
        ("POST", "/v1/runs"),
        ("GET", "/x"),
        ("OPTIONS", "/v1"),
    ],
)
def test_each_answer_is_kept_by_nobody_and_framed_by_nobody(host, method, path, memory):
    headers = Client(memory, host=host).request(method, path).headers
    assert {name: headers.get(name) for name in HEADERS} == HEADERS
    assert headers.keys() - HEADERS.keys() <= {
        "x-request-id",
        "content-length",
        "content-type",
        "vary",
        "content-encoding",
        "allow",
    }


@pytest.mark.parametrize(("host", "is_named"), [("127.0.0.1", False), ("0.0.0.0", True)])  # noqa: S104 - no server
def test_a_service_on_the_network_names_the_proxy_in_one_line(host, is_named, capsys):
    policy = AccessPolicy.from_address(host, (), access_control=True)
    _announce(Settings(host=host), policy, f"http://{host}:8000")
    lines = [line for line in capsys.readouterr().err.splitlines() if "Caddy" in line]
    assert len(lines) == is_named
