"""Every view of a stock that somebody made who does not know the page, as eyes and fingers find it."""

import httpx2
import pytest
from playwright.sync_api import expect
from support import strange_stock
from support.processes import Service
from support.seeing import AXE, MEDIA, Eyes

pytestmark = [pytest.mark.timeout(900, func_only=True), pytest.mark.slow]


@pytest.fixture(scope="module")
def stock(bundle, tmp_path_factory):
    """Where the stock is, and the ids in it by name."""
    url = f"sqlite:///{tmp_path_factory.mktemp('strange') / 'jointstiff.db'}"
    filling = Service(url, "--workers", "1")
    try:
        with httpx2.Client(base_url=filling.url, timeout=None) as client:
            made = strange_stock.fill(client)
    finally:
        filling.stop()
    return url, made


@pytest.fixture(scope="module")
def site(stock):
    """A service of our own with that stock; without a worker, runs stay as they are."""
    running = Service(stock[0], "--workers", "0")
    yield running
    running.stop()


STRANGE = (
    *(
        "#/",
        "#/runs",
        "#/runs?group=set",
        "#/robots",
        "#/robots?q=Robot",
        "#/sets",
        "#/wall",
        "#/gearboxes",
    ),
    *(
        "#/runs/{cobot_run}",
        "#/runs/{cobot_run}/deflection",
        "#/runs/{cobot_run}/predict",
        "#/runs/{cobot_run}/map",
    ),
    *("#/runs/{arm_run}", "#/runs/{arm_run}?joint=shoulder_pan_joint", "#/runs/{arm_run}/robot"),
    *("#/runs/{unusable}", "#/runs/{one}", "#/runs/{one}/deflection", "#/runs/{one}/predict"),
    *("#/runs/{many}", "#/runs/{many}/deflection", "#/runs/{many}/predict"),
    *("#/runs/{scara}", "#/runs/{scara}/deflection", "#/runs/{scara}/map", "#/runs/{scara}/report"),
    *("#/runs/{cancelled}", "#/runs/{running}", "#/runs/{queued}", "#/robots/{cobot}", "#/robots/{arm}"),
    *("#/robots/{bare}", "#/sets/{cobot_set}", "#/sets/{unidentified}", "#/?set={unidentified}"),
    *("#/compare/trend/{cobot}", "#/compare/trend/{bare}", "#/compare/methods/{pair}"),
    *("#/compare/runs?ids={arm_run},{unusable},{many}", "#/maps/{map}", "#/gearboxes/{gearbox}"),
    *("#/plans?robot={cobot}", "#/measure?robot={cobot}", "#/runs/{arm_run}/correct"),
)
"""Views of that stock."""


@pytest.mark.parametrize("width", [390, 1280])
def test_a_stock_of_strangers_can_be_read_too(visit, stock, node_modules, width):
    made = stock[1]
    axe = AXE.read_text(encoding="utf-8") if width == 390 else None
    eyes = Eyes(visit("phone" if axe else "desktop"), width, tuple(MEDIA), axe)
    for view in STRANGE:
        eyes.look(view, view.format(**made), None)
    assert not eyes.faults, "\n".join(f"{fault} at {', '.join(at)}" for fault, at in eyes.faults.items())


def test_a_phone_shows_long_names_of_joints_whole(visit, stock):
    """In the table, parted after their marks; each joint has a name on the arm, too."""
    made = stock[1]
    page = visit("phone", view=f"#/runs/{made['arm_run']}").page
    names = page.locator(".opens .name")
    expect(names).to_have_count(6)
    cut = "(name) => name.scrollHeight > name.clientHeight + 1 || name.scrollWidth > name.clientWidth + 1"
    assert [name.inner_text() for name in names.all() if name.evaluate(cut)] == []
    assert names.first.evaluate("(name) => name.getClientRects()[0].height") < 3 * 17  # shoulder_, pan_joint
    page.locator(".run-arm canvas[data-ready=true]").wait_for()
    on_arm = page.locator(".run-arm .scene-labels span:not(.x, .y, .z)").filter(visible=True)
    expect(on_arm).to_have_count(6)
