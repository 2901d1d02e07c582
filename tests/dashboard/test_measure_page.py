"""A live campaign on the page: to its run, with a doubtful reading, away from the service, by two tablets."""

import math
import re

import httpx2
import pytest
from playwright.sync_api import Page, expect
from support.browsing import Visit, file_of
from support.processes import free_port, ready, serving

from jointstiff.simulator import TARGETS


def simulated(visited) -> str:
    """Open a simulated campaign from the start page; return its id."""
    visited.go("#/")
    visited.page.get_by_role("button", name="Try a simulated campaign").click()
    expect(visited.page.get_by_role("heading", name="Next: m01")).to_be_visible()
    return str(visited.page.url.rsplit("/", 1)[1])


def read(page: Page, label: str, kind: str = "Simulate this reading") -> None:
    """Fill in the readings of the next posture, and send them."""
    expect(page.get_by_role("heading", name=f"Next: {label}")).to_be_visible()
    page.get_by_role("button", name=kind).click()
    page.get_by_role("button", name="Send reading").click()


def paste(page: Page, label: str, text: str) -> None:
    """Paste a text into a box."""
    page.get_by_label(label).evaluate(
        """(box, text) => {
          const data = new DataTransfer();
          data.setData("text", text);
          const options = {clipboardData: data, bubbles: true, cancelable: true};
          box.dispatchEvent(new ClipboardEvent("paste", options));
        }""",
        text,
    )


def labels(api: httpx2.Client, campaign: str) -> list[str]:
    """Labels of the readings that the service has."""
    return [each["label"] for each in api.get(f"/v1/measurement-sets/{campaign}/next").json()["readings"]]


def test_a_newcomer_measures_a_simulated_arm_to_its_goal(visit, api):
    """One tap to begin, two a reading; a mistake is named and read again; the stiffnesses are as stated."""
    page = (visited := visit("tablet upright")).page
    campaign = simulated(visited)
    expect(page.get_by_text("Simulated: no arm is measured.")).to_be_visible()
    page.locator("canvas[data-ready=true]").wait_for()
    expect(page.get_by_text("1471 N straight down")).to_be_visible()
    for number in range(1, 5):
        read(page, f"m{number:02d}")
    read(page, "m05", "Simulate a mistake")
    doubt = page.get_by_role("alert", name="m05 is doubtful")
    expect(doubt.get_by_text("P1 and P2 are exchanged")).to_be_visible()
    expect(page.get_by_role("heading", name="Next:")).to_have_count(0)  # the weight still hangs
    page.get_by_role("button", name="Keep").click()
    page.get_by_role("button", name="Withdraw m05 and read it again").click()
    expect(page.get_by_role("heading", name="Next: m06")).to_contain_text("m05 read again")
    expect(doubt).to_have_count(0)
    reached = page.locator(".card .note.good").first
    for number in range(6, 20):
        read(page, f"m{number:02d}")
        expect(
            page.get_by_role("heading", name=f"Next: m{number + 1:02d}").or_(reached).first
        ).to_be_visible()
        if reached.is_visible():
            break
    expect(page.get_by_text("Reached after").first).to_be_visible()
    last = api.get(f"/v1/measurement-sets/{campaign}/next").json()["residuals"]
    page.get_by_text(f"Residuals of {last[0]['observation']}").click()
    drawn = page.get_by_text(re.compile(r"measured minus predicted, drawn [\d\u2009\u202f ]+ times longer"))
    expect(drawn).to_contain_text("mm")
    page.get_by_role("img", name="with the residuals of the targets").wait_for()
    page.get_by_role("button", name="Close and identify").click()
    page.get_by_role("table", name="Joint stiffness").wait_for()
    run = api.get(f"/v1/jobs/{page.url.rsplit('/', 1)[1]}").json()
    assert run["request"]["measurement_set_id"] == campaign
    stored = api.get(f"/v1/measurement-sets/{campaign}").json()
    assert stored["instrument"] == "simulated by the page"
    assert "Withdrawn m05: read again." in stored["notes"]
    truth = [float(k) for k in re.search(r"joint 1 to 6: (.*?) ×", stored["notes"])[1].split(", ")]
    for joint, stiffness in zip(
        run["result"]["joints"][1:], truth[1:], strict=True
    ):  # a weight spares joint 1
        assert abs(joint["stiffness"] / (1e6 * stiffness) - 1.0) <= 0.15


def test_readings_wait_while_the_service_is_away(visit, api):
    page = (visited := visit("phone")).page
    campaign = simulated(visited)
    read(page, "m01")
    expect(page.get_by_role("heading", name="Next: m02")).to_be_visible()
    page.get_by_role("button", name="Simulate this reading").click()
    page.context.set_offline(True)
    page.get_by_role("button", name="Send reading").click()
    expect(page.get_by_text("The service cannot be reached. 1 reading waits in this browser")).to_be_visible()
    page.get_by_text("Another posture or load").click()
    joints = page.get_by_label("Joints as the controller shows them")
    angles = [float(angle) for angle in joints.input_value().split()]
    joints.fill(" ".join(str(angle) for angle in [angles[0] + 20.0, *angles[1:]]))
    page.get_by_role("button", name="Use this posture").click()
    expect(page.get_by_role("heading", name="Next: m03")).to_contain_text("Posture of your own")
    for target in ("P1", "P2", "P3"):  # no kinematics without the service: typed by hand
        page.get_by_label(f"{target}, Unloaded x").fill("1000 0 1000")
    assert labels(api, campaign) == ["m01"]
    page.context.set_offline(False)
    expect(page.get_by_text("The service cannot be reached.")).to_have_count(0)
    expect(page.get_by_text("2 read", exact=False).first).to_be_visible()
    assert labels(api, campaign) == ["m01", "m02"]
    kept = page.evaluate("Object.keys(localStorage)")
    assert [key for key in kept if key.startswith("jointstiff.reading.")] == []


def test_a_phone_shows_a_reading_on_one_screen(visit, api):
    """Posture, boxes, *Send* and the joints, above the bar of sections; no scrolling between readings."""
    page = (visited := visit("phone")).page
    simulated(visited)
    bar = page.get_by_role("navigation", name="Main").bounding_box()["y"]
    for number in range(1, 5):
        read(page, f"m{number:02d}")
        expect(page.get_by_role("heading", name=f"Next: m{number + 1:02d}")).to_be_visible()
        assert page.evaluate("scrollY") == 0
    for part in (
        ".live-posture .angles",
        ".live-readings",
        ".live-posture .go",
        ".live-posture .live-joints",
    ):
        box = page.locator(part).bounding_box()
        assert box["y"] >= 0, part
        assert box["y"] + box["height"] <= bar, part
    assert page.get_by_label("P1, Unloaded x").get_attribute("inputmode") == "decimal"
    page.get_by_label("P1, Unloaded x").fill("12.5")
    page.get_by_role("button", name="Change sign").click()
    expect(page.get_by_label("P1, Unloaded x")).to_have_value("-12.5")


CUT_NUMBERS = """
() => [...document.querySelectorAll(".vector input")]
  .filter((box) => box.value.length < 9 || box.scrollWidth > box.clientWidth + 1)
  .map((box) => box.ariaLabel + " " + box.value)
"""
"""Boxes whose number is cut, or that have none."""


def test_no_number_of_a_reading_is_cut_in_its_box(visit):
    """Of four digits and as many decimals, as a tracker sends them, from a phone to a wide screen."""
    page = (visited := visit("phone")).page
    simulated(visited)
    for box in page.locator(".vector input").all():
        box.fill("-1726.4830")
    for width in (360, 390, 820, 960, 1280, 1440, 1920):
        page.set_viewport_size({"width": width, "height": 844})
        assert (width, page.evaluate(CUT_NUMBERS)) == (width, [])


CUT = """
() => [...document.querySelectorAll(".live-joints > li")].flatMap((row) => {
  const box = row.getBoundingClientRect();
  const words = document.createRange();
  const rects = [...row.querySelectorAll("b, .value")].flatMap((part) => {
    words.selectNodeContents(part);
    const clips = part.scrollWidth > part.clientWidth + 1 && getComputedStyle(part).overflowX !== "visible";
    return clips ? [new DOMRect(box.right, 0, 99, 0)] : [...words.getClientRects()];
  });
  rects.push(row.querySelector("svg").getBoundingClientRect());
  const inside = (rect) => rect.width > 0 && rect.left >= box.left - 1 && rect.right <= box.right + 1;
  return rects.every(inside) && box.right <= innerWidth ? [] : [row.textContent];
})
"""
"""Rows of joints whose words or bar leave their row, or are cut."""
LENGTHEN = """
() => {
  const put = (part, text) => { if (part) part.textContent = text; };
  for (const row of document.querySelectorAll(".live-joints > li")) {
    put(row.querySelector("bdi"), "joint_of_the_shoulder_at_the_column");
    put(row.querySelector("small"), "\u00b1 1\u202f800\u00a0%");
    put(row.querySelector(".reason"), "the load never twists this joint, and no posture of this robot would");
    row.querySelector("svg").setAttribute("class", "estimate-bar beyond");
  }
}
"""


@pytest.mark.parametrize("width", [360, 390])
def test_a_phone_shows_each_joint_with_its_interval(visit, width):
    """Name, bar and value with ± fit, before and after a doubtful reading, and with long words."""
    page = (visited := visit("phone")).page
    page.set_viewport_size({"width": width, "height": 844})
    simulated(visited)

    def look(joints: int) -> None:
        values = page.locator(".live-joints .value")
        expect(values).to_have_count(6)
        expect(values.filter(has_text="±")).to_have_count(joints)
        for _ in ("as they are", "with long words"):
            assert page.evaluate(CUT) == []
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            page.evaluate(LENGTHEN)

    for number in range(1, 6):
        read(page, f"m{number:02d}")
    expect(page.get_by_role("heading", name="Next: m06")).to_be_visible()
    look(5)  # a weight never twists the first
    page.reload()  # without the long words
    read(page, "m06", "Simulate a mistake")
    expect(page.get_by_role("alert", name="m06 is doubtful")).to_be_visible()
    look(5)


def test_no_reading_is_lost_when_the_service_is_started_again(browser, bundle, tmp_path):
    """The page is loaded again meanwhile, and what waits is sent from another view."""
    database, port = f"sqlite:///{tmp_path / 'jointstiff.db'}", free_port()
    context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True)
    page = context.new_page()
    with serving(database, 1, port) as service:
        campaign = simulated(Visit(page, ready(service).url))
        read(page, "m01")
        expect(page.get_by_role("heading", name="Next: m02")).to_be_visible()
        page.wait_for_function(
            "async () => (await (await caches.open('jointstiff-page')).keys()).length > 20"
        )
    page.get_by_role("button", name="Simulate this reading").click()
    page.get_by_role("button", name="Send reading").click()
    waits = page.get_by_text("The service cannot be reached. 1 reading waits in this browser")
    expect(waits).to_be_visible()
    page.reload()
    expect(page.get_by_role("heading", name="Simulated campaign")).to_be_visible()
    expect(waits).to_be_visible()
    page.get_by_role("link", name="Runs").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Runs")
    with serving(database, 1, port) as service:
        with httpx2.Client(base_url=ready(service).url, timeout=180.0) as api:
            for _ in range(600):
                if len(labels(api, campaign)) == 2:
                    break
                page.wait_for_timeout(100)
            assert labels(api, campaign) == ["m01", "m02"]
        page.go_back()
        expect(page.get_by_role("heading", name="Next: m03")).to_be_visible()
    context.close()


def test_the_next_two_postures_are_there_without_a_network(browser, bundle, tmp_path):
    """Without a plan: they are fetched ahead, drawn and measured, also after the page is loaded again."""
    database, port = f"sqlite:///{tmp_path / 'jointstiff.db'}", free_port()
    context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True)
    page = context.new_page()
    with serving(database, 1, port) as service:
        campaign = simulated(Visit(page, ready(service).url))
        read(page, "m01")
        expect(page.get_by_role("heading", name="Next: m02")).to_be_visible()
        page.wait_for_function(
            "async () => (await (await caches.open('jointstiff-page')).keys()).length > 20"
        )
        page.wait_for_load_state("networkidle")
    read(page, "m02")
    expect(page.get_by_text("The service cannot be reached. 1 reading waits in this browser")).to_be_visible()
    page.reload()
    read(page, "m03")
    page.reload()
    read(page, "m04")
    expect(
        page.get_by_text("The service sends the next posture when the connection is back.")
    ).to_be_visible()
    with serving(database, 1, port) as service:
        with httpx2.Client(base_url=ready(service).url, timeout=180.0) as api:
            for _ in range(600):
                if len(labels(api, campaign)) == 4:
                    break
                page.wait_for_timeout(100)
            assert labels(api, campaign) == ["m01", "m02", "m03", "m04"]
        expect(page.get_by_role("heading", name="Next: m05")).to_be_visible()
    context.close()


def test_two_tablets_do_not_collide(visit, api):
    """One reads while the other is away: the label is taken, is said, and another one offered."""
    first, second = visit("tablet"), visit("tablet upright")
    campaign = simulated(first)
    second.go(f"#/measure/{campaign}")
    expect(second.page.get_by_role("heading", name="Next: m01")).to_be_visible()
    second.page.get_by_role("button", name="Simulate a mistake").click()
    second.page.context.set_offline(True)
    second.page.get_by_role("button", name="Send reading").click()
    expect(second.page.get_by_text("1 reading waits")).to_be_visible()
    read(first.page, "m01")
    expect(first.page.get_by_role("heading", name="Next: m02")).to_be_visible()
    second.page.context.set_offline(False)
    expect(second.page.get_by_text("m01 was already sent by another device")).to_be_visible()
    second.page.get_by_role("button", name="Discard mine").click()
    expect(second.page.get_by_role("heading", name="Next: m02")).to_be_visible()
    read(second.page, "m02")
    expect(first.page.get_by_role("heading", name="Next: m03")).to_be_visible()  # told by the service
    assert labels(api, campaign) == ["m01", "m02"]


def test_a_plan_is_measured_live_and_its_file_joins(visit, api, stored):
    """The plan's equipment is taken, a block of numbers is pasted, and a posture is skipped."""
    plan = api.get(f"/v1/jobs/{stored.plan}").json()
    page = (visited := visit("tablet")).page
    visited.go(f"#/plans/{stored.plan}")
    page.get_by_role("link", name="Measure live").click()
    page.get_by_role("button", name="Begin").click()  # the goal that is set needs no further field
    heading = page.get_by_role("heading", name="Next: m01")
    expect(heading).to_be_visible()
    campaign = page.url.rsplit("/", 1)[1]
    opened = api.get(f"/v1/measurement-sets/{campaign}").json()
    assert opened["open"]["plan_id"] == stored.plan
    assert opened["open"]["goal"] == {"kind": "joints", "relative": 0.15}
    assert opened["flange_targets"] == plan["result"]["targets"]
    before = page.locator(".angles.big").inner_text()
    page.get_by_role("button", name="Skip this posture").click()
    expect(page.locator(".angles.big")).not_to_have_text(before, use_inner_text=True)
    expect(heading).to_be_visible()
    block = "\n".join(f"{name} 1000 {i} 0 1000 {i} -1" for i, name in enumerate(plan["result"]["targets"]))
    paste(page, f"{next(iter(plan['result']['targets']))}, Unloaded x", block)
    shown = [page.locator(".live-readings input").nth(i) for i in range(3, 6)]
    for box, value in zip(shown, ("1000", "0", "-1"), strict=True):
        expect(box).to_have_value(value)
    expect(page.get_by_role("button", name="Send reading")).to_be_enabled()
    page.get_by_text("On a tablet").click()
    expect(page.get_by_role("img", name=re.compile("QR code"))).to_be_visible()


def test_a_pasted_block_is_read_away_from_the_network(visit):
    """A line that is not understood is named, and the others are in their boxes."""
    page = (visited := visit("tablet")).page
    simulated(visited)
    page.locator("canvas[data-ready=true]").wait_for()
    first, second = (page.get_by_label(f"{name}, Unloaded x") for name in ("P1", "P2"))
    page.context.set_offline(True)
    second.fill("7")
    paste(page, "P1, Unloaded x", "P1;123,456;1,234;5,678\nP2;1,000;2,000;x")
    expect(first).to_have_value("123.456")
    expect(page.get_by_text("Understood as 123.456, 1.234, 5.678 mm")).to_be_visible()
    expect(page.get_by_text("line 2, “P2;1,000;2,000;x”")).to_be_visible()
    expect(second).to_have_value("7")
    page.get_by_role("button", name="Discard", exact=True).click()
    expect(page.get_by_text("line 2")).to_have_count(0)


def test_a_file_filled_in_part_joins_the_readings_that_are_there(visit, api):
    """Of a JSON file in mm and degrees those that are complete are sent, and those that are here are not."""
    page = (visited := visit("tablet")).page
    campaign = simulated(visited)
    read(page, "m01")
    expect(page.get_by_role("heading", name="Next: m02")).to_be_visible()
    (first,) = api.get(f"/v1/measurement-sets/{campaign}").json()["observations"]

    def in_mm(label: str, complete: bool) -> dict[str, object]:
        readings = [
            {"target": one["target"]}
            | {
                state: [1e3 * part for part in one[state]] if complete else None
                for state in ("unloaded", "loaded")
            }
            for one in first["readings"]
        ]
        angles = [math.degrees(angle) for angle in first["joints"]]
        return {"label": label, "joints": angles, "force": first["force"], "readings": readings}

    document = {
        "name": "filled in part",
        "units": {"length": "mm", "angle": "deg", "force": "N"},
        "encoders": "motor",
        "observations": [in_mm("m01", True), in_mm("c02", True), in_mm("c03", False)],
    }
    page.get_by_text("Readings from a file").first.click()
    page.locator("input[type=file]").set_input_files(file_of("c.json", document))
    expect(page.get_by_text("1 reading taken from the file")).to_be_visible()
    expect(page.get_by_text("2 read,")).to_be_visible()
    stored = api.get(f"/v1/measurement-sets/{campaign}").json()["observations"]
    assert [one["label"] for one in stored] == ["m01", "c02"]
    assert stored[1]["joints"] == pytest.approx(first["joints"], abs=1e-12)
    assert stored[1]["readings"][0]["loaded"] == pytest.approx(first["readings"][0]["loaded"], abs=1e-12)


def test_the_list_of_a_plan_filled_in_part_joins(visit, api, stored):
    """The first row of a plan's CSV is filled in; the others are still blank."""
    page = (visited := visit("tablet")).page
    campaign = simulated(visited)
    table = api.get(f"/v1/jobs/{stored.plan}/files/readings.csv").text.splitlines()
    head = table[0].split(",")
    first = [
        cell or ("1000.0" if "loaded" in name else "")
        for name, cell in zip(head, table[1].split(","), strict=True)
    ]
    for name in TARGETS:  # as far apart as on the flange, and moved by the load
        for state, lift in (("unloaded", 0.0), ("loaded", -0.3)):
            for axis, part in zip("xyz", TARGETS[name], strict=True):
                shown = 1e3 * part + 1000.0 + (lift if axis == "z" else 0.0)
                column = f"{name} {state} {axis} [mm]"
                if column in head:
                    first[head.index(column)] = f"{shown:.3f}"
    page.get_by_text("Readings from a file").first.click()
    content = "\n".join([table[0], ",".join(first), *table[2:]])
    page.locator("input[type=file]").set_input_files(file_of("plan.csv", content))
    expect(page.get_by_text("1 reading taken from the file")).to_be_visible()
    counted = page.get_by_role("heading", name="So far 1 read")
    expect(counted.or_(page.get_by_text(f"{first[0]} was refused")).first).to_be_visible()
    assert labels(api, campaign) in ([], [first[0]])
