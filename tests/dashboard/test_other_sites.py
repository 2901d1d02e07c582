"""Pages of other sites, in a real browser: they read, post and delete nothing."""

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit

import httpx2
import pytest
from support.api import posted

from jointstiff.service.api.bodies import EXAMPLES
from jointstiff.simulator import default_arm, simulate_campaign

TRY = """async ([service, run, robot]) => {
  const seen = [];
  const sent = async (path, options) => {
    try {
      const answer = await fetch(service + path, options);
      seen.push(answer.ok ? await answer.text() : "");
    } catch { seen.push(""); }
  };
  await sent("/v1/robots", {});
  await sent("/v1/robots", { method: "POST", mode: "no-cors", body: robot });
  await sent("/v1/robots", { method: "POST", body: robot, headers: { "Content-Type": "application/json" } });
  await sent("/v1/jobs/" + run, { method: "DELETE" });
  await sent("/v1/jobs/" + run, { method: "PATCH", mode: "no-cors" });
  await sent("/v1/runs/" + run, {});
  return seen.join("");
}"""
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
    before = [api.get(f"/v1/runs/{run}").json(), api.get("/v1/robots").json()]
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
    assert [api.get(f"/v1/runs/{run}").json(), api.get("/v1/robots").json()] == before
