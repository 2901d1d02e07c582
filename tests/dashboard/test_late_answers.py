"""Forms whose answers come one by one, as over a slow network: no late answer moves what is shown."""

from dataclasses import asdict

import pytest
from playwright.sync_api import Page, Route
from support.browsing import SHIFTS, Visit
from support.processes import until

BY_DAY = ("#/measure?plan={plan}", "#/plans?set={set}&run={run}")
BY_NIGHT = (
    "#/measure?robot={robot}",
    "#/plans?robot={robot}",
    "#/runs/{run}/predict",
    "#/runs/{run}/map",
    "#/runs/{run}/correct",
)
FORMS = [*BY_DAY, *(pytest.param(form, marks=pytest.mark.slow) for form in BY_NIGHT)]
WIDTH, HEIGHT = 650, 1000  # px: names of robots wrap
DRAWN = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
QUIET_MS = 150
"""A settled page that has asked for nothing for this time asks for nothing more [ms]."""


class SlowNetwork:
    """Answers of the service, which are held until a test lets one of them go."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._held: list[Route] = []
        page.route("**/*", self._hold)

    def _hold(self, route: Route) -> None:
        if route.request.resource_type == "fetch":
            self._held.append(route)
        else:
            route.continue_()

    def answer_one_by_one(self, place: int) -> None:
        """Let the held answer at a place go, and the page draw it, until the page waits for none."""
        until(self._holds_one)
        while self._holds_one() or not self._is_settled():
            if self._held:
                route = self._held.pop(place)
                route.fulfill(response=route.fetch())
            self._page.evaluate(DRAWN)

    def _holds_one(self) -> bool:
        if not self._held:
            self._page.wait_for_timeout(QUIET_MS)
        return bool(self._held)

    def _is_settled(self) -> bool:
        return self._page.locator("h1").count() > 0 and self._page.locator(".busy").count() == 0


@pytest.mark.parametrize("place", [0, -1], ids=["oldest first", "newest first"])
@pytest.mark.parametrize("form", FORMS)
def test_no_late_answer_moves_a_form(visit, stored, form, place):
    visited: Visit = visit("tablet upright")
    page = visited.page
    page.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    page.add_init_script(SHIFTS)
    page.goto(f"{visited.url}/favicon.svg")
    network = SlowNetwork(page)
    page.goto(f"{visited.url}/{form.format(**asdict(stored))}", wait_until="commit")
    network.answer_one_by_one(place)
    assert page.locator("main .field, main fieldset").count() > 0
    assert page.evaluate("window.moved") == ""
