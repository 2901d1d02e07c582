"""Signing in, and what pages of other sites may not do."""

import json
import threading
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlsplit

import httpx2
import pytest
from playwright.sync_api import expect
from support.api import posted
from support.processes import Service

from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.security.keys import hash_secret, make_key, make_secret_token
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign

NOW = datetime.now(UTC)
KEY = make_key("tablet hall 3", "operator", NOW, None)
ADMIN = make_key("admin Smith", "admin", NOW, None)

FOLLOW = Path(__file__).with_name("follow.js").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def database(tmp_path_factory):
    return f"sqlite:///{tmp_path_factory.mktemp('keys') / 'jointstiff.db'}"


@pytest.fixture(scope="module")
def site(bundle, database):
    with Store.open(database) as store:
        store.keys.add(KEY.record)
        store.keys.add(ADMIN.record)
    running = Service(database, "--require-key")
    try:
        yield running
        assert KEY.text not in running.log()
    finally:
        running.stop()


@pytest.fixture(scope="module")
def run(site):
    headers = {"Authorization": f"Bearer {KEY.text}"}
    with httpx2.Client(base_url=site.url, headers=headers, timeout=60.0) as api:
        return posted(api, simulate_campaign(default_arm(), configurations=6))["id"]


def sign_in(page, key):
    """Enter a key, which is taken."""
    page.get_by_label("Key").fill(key.text)
    page.get_by_role("button", name="Sign in").click()
    expect(page.locator("h1")).not_to_have_text("Sign in")


def test_a_key_is_entered_once_and_the_page_works_until_sign_out(visit, run):
    tablet = visit()
    page = tablet.page
    tablet.go(f"#/runs/{run}")
    expect(page.get_by_role("heading", name="Sign in")).to_be_visible()
    assert page.evaluate(FOLLOW, run) == "refused"

    page.get_by_label("Key").fill(KEY.text[:-1])
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_role("alert")).to_contain_text("is not a key")
    assert page.context.cookies() == []

    sign_in(page, KEY)
    tablet.settle()
    (cookie,) = page.context.cookies()
    assert (cookie["httpOnly"], cookie["sameSite"], cookie["secure"]) == (True, "Strict", False)
    assert timedelta(0) < datetime.fromtimestamp(cookie["expires"], UTC) - NOW < timedelta(days=7, hours=1)
    assert page.evaluate("document.cookie") == ""
    assert KEY.text not in page.evaluate("JSON.stringify(localStorage) + JSON.stringify(sessionStorage)")
    assert page.evaluate(FOLLOW, run) == "end"

    page.reload()
    page.get_by_label("Display").click()
    expect(page.get_by_text("Signed in as tablet hall 3 (operator)")).to_be_visible()
    page.get_by_role("button", name="Sign out").click()
    expect(page.get_by_role("heading", name="Sign in")).to_be_visible()
    assert page.context.cookies() == []
    assert all(KEY.text not in address for address in tablet.requests)


def test_a_session_that_ends_meanwhile_asks_for_the_key(visit, run, database):
    tablet = visit()
    tablet.go("#/runs")
    sign_in(tablet.page, KEY)
    tablet.settle()
    (cookie,) = tablet.page.context.cookies()
    with Store.open(database) as store:
        store.sessions.end(hash_secret(cookie["value"]))
    tablet.page.evaluate("run => { location.hash = `#/runs/${run}` }", run)
    expect(tablet.page.get_by_role("heading", name="Sign in")).to_be_visible()


def test_a_link_signs_in_once_and_leaves_the_address(visit, run, database):
    token = make_secret_token("jsl")
    with Store.open(database) as store:
        now = datetime.now(UTC)
        store.sessions.offer(hash_secret(token), KEY.record.id, now, now + timedelta(minutes=10))
    first, second = visit(), visit("phone")
    first.go(f"#/sign-in/{token}")
    expect(first.page.locator("h1")).not_to_have_text("Sign in")
    assert token not in first.page.url
    assert len(first.page.context.cookies()) == 1
    second.go(f"#/sign-in/{token}")
    expect(second.page.get_by_role("alert")).to_contain_text("used before")
    assert token not in second.page.url
    sign_in(second.page, KEY)
    assert all(
        token not in address for one in (first, second) for address in one.requests if "#" not in address
    )


TRY = Path(__file__).with_name("another_site.js").read_text(encoding="utf-8")
"""What a hostile page tries; it returns what it could read."""


class Page(BaseHTTPRequestHandler):
    """A page of another site."""

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!doctype html><title>another site</title>")

    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def other_site():
    server = ThreadingHTTPServer(("127.0.0.1", 0), Page)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://evil.localhost:{server.server_port}/"  # browsers resolve *.localhost to this machine
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def api(services):
    with httpx2.Client(base_url=services("sqlite").url, timeout=60.0) as session:
        yield session


@pytest.mark.parametrize("origin", ["another site", "no origin", "rebound name"])
def test_nothing_is_read_posted_or_deleted(origin, browser, api, other_site):
    run, page = posted(api, simulate_campaign(default_arm(), configurations=6))["id"], browser.new_page()
    service = str(api.base_url).rstrip("/")
    before = [api.get(f"/v1/jobs/{run}").json(), api.get("/v1/robots").json()]
    if origin == "rebound name":  # a name of the attacker's that points to this machine
        service = f"http://rebound.localhost:{urlsplit(service).port}"
        assert page.goto(f"{service}/").status == 421
    elif origin == "no origin":
        page.goto("data:text/html,<!doctype html>")
    else:
        page.goto(other_site)
    robot = json.dumps(EXAMPLES["robots"]["modified DH"] | {"name": "stolen"})
    assert page.evaluate(TRY, [service, run, robot]) == ""
    page.close()
    assert [api.get(f"/v1/jobs/{run}").json(), api.get("/v1/robots").json()] == before
