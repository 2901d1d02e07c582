"""The documentation in a real browser, as the service serves it: search works, the policy is kept."""

import pytest
from playwright.sync_api import expect
from support.browsing import ROOT

SITE = ROOT / "service" / "static-docs"

pytestmark = pytest.mark.skipif(not SITE.is_dir(), reason="the documentation is not built: scripts/docs")


def test_the_policy_of_the_documentation_is_strict(api):
    answer = api.get("/docs")
    assert answer.headers["location"] == "docs/"
    for path in ("/docs/", "/docs/api.html", "/docs/searchindex.js", "/docs/llms.txt"):
        headers = api.get(path).headers
        assert "default-src 'none'; script-src 'self'; style-src 'self'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
    assert 'href="./../">Back to the page' in api.get("/docs/index.html").text
    assert 'href="../../">Back to the page' in api.get("/docs/reference/http.html").text
    for path in ("/docs/nothing.html", "/docs/reference", "/docs/_static"):
        assert api.get(path).status_code == 404


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_search_finds_a_page_offline(visit, theme):
    visited = visit("desktop", theme)
    visited.page.goto(f"{visited.url}/docs/")
    visited.page.get_by_role("textbox", name="Search").fill("complementary stiffness")
    visited.page.keyboard.press("Enter")
    expect(visited.page.locator("#search-results li").first).to_be_visible()
    visited.page.get_by_role("link", name="The method", exact=True).first.click()
    expect(visited.page.locator("h1")).to_contain_text("The method")


def test_pages_are_shown_without_a_fault(visit):
    visited = visit("phone")
    for page in ("index", "reference/http", "reference/messages", "glossary", "genindex"):
        visited.page.goto(f"{visited.url}/docs/{page}.html")
        visited.page.locator("h1").wait_for()
        loaded = visited.page.evaluate("document.fonts.ready.then(() => document.readyState)")
        assert loaded == "complete"
