"""The page from end to end: from a robot and a file to a result, compared, followed, repeated."""

import re

import pytest
from playwright.sync_api import expect
from support.api import post
from support.browsing import ROOT, campaign, file_of
from support.processes import until

from jointstiff.simulator import default_arm
from jointstiff.simulator.urdf import urdf_text


@pytest.mark.parametrize("size", [pytest.param("tablet", marks=pytest.mark.slow), "phone"])
def test_from_a_robot_to_a_trend(visit, api, size):
    """Add a robot, drop readings, identify, look at all parts, compare methods and sets, see the trend."""
    visited = visit(size)
    page = visited.page
    name = f"arm of the {size}"

    def every_set():
        return api.get("/v1/measurement-sets?limit=100").json()["items"]

    visited.go("#/robots/new")
    page.get_by_label("Name", exact=True).fill(name)
    page.get_by_role("radio", name="URDF").check(force=True)
    page.get_by_label("URDF document").fill(urdf_text(default_arm()))
    expect(page.get_by_label("Flange link")).to_have_value("flange")
    page.locator("canvas[data-ready=true]").wait_for()
    page.get_by_role("button", name="Save robot").click()
    expect(page.get_by_role("heading", level=1)).to_have_text(name)

    for encoders, seed in (("motor", 21), ("secondary", 22)):
        document = campaign(load="dead_weight", encoders=encoders, seed=seed)["measurement_set"]
        document["name"] = f"{size} {encoders}"
        visited.go("#/")
        page.locator("input[type=file]").set_input_files(file_of("campaign.json", document))
        page.get_by_label("Robot", exact=True).select_option(label=name)
        expect(page.get_by_role("button", name="Identify")).to_be_enabled()
        assert document["name"] not in {each["name"] for each in every_set()}  # stored by the last tap
        page.get_by_role("button", name="Identify").click()
        expect(page.get_by_role("heading", level=1)).to_have_text(document["name"])
        expect(page.get_by_role("table", name="Joint stiffness")).to_be_visible()

    rows = page.get_by_role("table", name="Joint stiffness").locator(".joint")
    expect(rows.filter(has_text="joint_1").get_by_text("not observable", exact=True)).to_be_visible()
    expect(rows.filter(has_text="joint_2").get_by_text("well determined")).to_be_visible()
    expect(page.get_by_text("Next for joint_1:")).to_be_visible()
    page.get_by_role("button", name="Show unconstrained beside").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("2 runs side by side")
    for constraint in ("constrained", "unconstrained"):
        expect(page.get_by_role("columnheader", name=f", {constraint}")).to_be_visible()
    page.go_back()
    page.get_by_role("link", name="Deflection").click()
    expect(page.get_by_role("img", name="Deflection before and after")).to_be_visible()
    page.get_by_role("link", name="3D view").click()
    page.get_by_role("button", name="Next").click()
    expect(page.get_by_text("2 of 12")).to_be_visible()
    page.get_by_role("link", name="Stiffness").click()
    page.locator("summary", has_text="Evidence").click()
    expect(page.locator(".evidence").get_by_text("5 of 6")).to_be_visible()
    page.get_by_role("link", name="Predict").click()
    page.get_by_label("Posture", exact=True).select_option(label="c03")
    page.get_by_label("Force on the robot").fill("0, 0, -500")
    page.get_by_role("button", name="Predict").click()
    page.locator("canvas[data-ready=true]").wait_for()
    expect(page.get_by_text("Along z, readings only (95 %")).to_be_visible()

    visited.go("#/compare/methods")
    page.get_by_label("Measurement set", exact=True).select_option(label=f"{size} motor ({name})")
    page.get_by_role("button", name="Compare").click()
    joints = page.get_by_role("table", name="Stiffness in 10⁶ N·m/rad")
    expect(joints.get_by_role("row")).to_have_count(7)  # six joints and the head, as no constraint is active
    fits = page.get_by_role("table", name="Fits as a whole", exact=True)
    expect(fits.get_by_role("row")).to_have_count(5)  # four methods

    visited.go("#/compare/pairs")
    page.get_by_label("First side", exact=True).select_option(label=f"{size} motor ({name})")
    page.get_by_label("Second side", exact=True).select_option(label=f"{size} secondary ({name})")
    page.get_by_role("button", name="Compare").click()
    expect(
        page.get_by_role("img", name=f"Stiffness of {size} secondary over that of {size} motor")
    ).to_be_visible()

    visited.go("#/fleet")
    page.get_by_role("link", name=name).click()
    chart = page.get_by_role("group", name="Stiffness of joint_2 over its campaigns")
    expect(chart).to_be_visible()
    assert chart.get_by_role("link").count() == 1  # campaigns by other encoders are left out, and named
    expect(page.get_by_text("1 campaign left out")).to_be_visible()


def test_three_taps_from_a_file_to_its_result(visit):
    page = visit("tablet", view="#/").page
    with page.expect_file_chooser() as chooser:
        page.get_by_text("Choose file").tap()  # one; choosing it is the second
    chooser.value.set_files(file_of("campaign.json", campaign(load="pull", seed=31)))
    page.get_by_role("button", name="Identify").tap()  # three
    expect(page.get_by_role("table", name="Joint stiffness")).to_be_visible()
    expect(page.get_by_text("6 of 6 joints have a stiffness")).to_be_visible()


def test_the_options_in_a_file_are_taken_and_shown(visit, api):
    page = visit("phone", view="#/").page
    expect(page.get_by_label("Robot", exact=True)).to_have_count(0)  # nothing is asked before a file
    document = campaign(load="pull", seed=32)
    document["run"] = {"positive": False, "stiffness_order": [["joint_2", "joint_4"]], "confidence": 0.9}
    page.locator("input[type=file]").set_input_files(file_of("campaign.json", document))
    expect(page.locator("summary", has_text="Advanced")).to_contain_text(
        "positive: false, stiffness order, confidence: 0.9"
    )
    page.get_by_role("button", name="Identify").click()
    page.wait_for_url("**/#/runs/*")
    request = api.get(f"/v1/runs/{page.url.rsplit('/', 1)[1]}").json()["request"]
    assert {name: request[name] for name in document["run"]} == document["run"]


def test_by_keyboard_only(visit, stored):
    """From the list of sets to a result in 3D, without a pointer."""
    page = visit("tablet", view=f"#/?set={stored.set}").page
    expect(page.get_by_text("passed all integrity checks")).to_be_visible()

    def tab_to(locator):
        for _ in range(80):
            if locator.evaluate("e => e === document.activeElement"):
                return
            page.keyboard.press("Tab")
        pytest.fail(f"{locator} cannot be reached")

    tab_to(page.locator("summary", has_text="Advanced"))
    page.keyboard.press("Enter")
    tab_to(page.get_by_label("Method", exact=True))
    page.keyboard.press("d")  # decoupled
    tab_to(page.get_by_role("button", name="Identify"))
    page.keyboard.press("Enter")
    expect(page.get_by_text("Decoupled partial pose, constrained")).to_be_visible()
    tab_to(page.get_by_role("link", name="3D view"))
    page.keyboard.press("Enter")
    canvas = page.locator("canvas[data-ready=true]")
    canvas.wait_for()
    tab_to(canvas)
    before = canvas.screenshot()
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(200)
    assert canvas.screenshot() != before
    tab_to(page.get_by_role("slider", name="Configuration"))
    page.keyboard.press("ArrowRight")
    expect(page.get_by_text("2 of 12")).to_be_visible()


def test_contributions_add_up_to_what_the_service_predicts(visit, api, stored):
    """The numbers on the page against the predicted deflections of the same run."""
    page = visit("desktop", view=f"#/runs/{stored.run}").page
    cells = page.locator(".joint .part .soft", has_text="mm")
    cells.first.wait_for()
    mean = sum(float(cell.split()[0].replace("\u2212", "-")) for cell in cells.all_inner_texts())
    residuals = api.get(f"/v1/runs/{stored.run}").json()["result"]["residuals"]
    lengths = [sum(v * v for v in residual["predicted"]) ** 0.5 * 1e3 for residual in residuals]
    assert mean == pytest.approx(sum(lengths) / len(lengths), rel=2e-3)


def test_a_long_run_shows_its_progress_and_is_cancelled(visit, api, stored):
    document = campaign(configurations=2_000, load="dead_weight", seed=23)["measurement_set"]
    large = post(api, "/v1/measurement-sets", {**document, "robot_id": stored.robot})["id"]
    page = visit("phone", view=f"#/?set={large}").page
    page.get_by_text("Advanced").click()
    page.get_by_label("Repeat on random draws").check()
    page.get_by_label("Draws", exact=True).fill("100000")
    page.route("**/events", lambda route: route.abort())
    page.get_by_role("button", name="Identify").click()
    expect(page.locator("progress")).to_be_visible()
    expect(page.get_by_text("No connection to the service")).to_be_visible()
    page.unroute("**/events")  # the browser tries again by itself
    expect(page.get_by_text("No connection to the service")).to_be_hidden(timeout=15_000)
    expect(page.get_by_text(re.compile(r"About \d+ (s|min) left\."))).to_be_visible(timeout=15_000)
    page.get_by_role("button", name="Cancel run").click()
    expect(
        page.get_by_text(re.compile(r"This run was cancelled.*It reached \d+ of 100000 resamples\."))
    ).to_be_visible()


def test_a_run_is_repeated_with_the_same_numbers(visit, api, stored):
    page = visit("phone", view=f"#/runs/{stored.run}").page
    page.locator("summary", has_text="More").click()
    page.get_by_role("button", name="Repeat").click()
    page.wait_for_url(lambda url: "#/runs/" in url and stored.run not in url)
    again = page.url.rsplit("/", 1)[1]
    first, second = (api.get(f"/v1/runs/{run}").json() for run in (stored.run, again))
    assert first["result"] == second["result"]
    assert first["provenance"]["input_hash"] == second["provenance"]["input_hash"]


def test_refusals_say_what_to_do(visit, stored):
    visited = visit("tablet", view="#/")
    page = visited.page
    document = campaign(load="dead_weight", seed=41)
    page.locator("input[type=file]").set_input_files(file_of("broken.json", '{"a": 1, }'))
    expect(page.get_by_text("broken.json: Invalid JSON: trailing comma at line 1 column 10")).to_be_visible()
    document["measurement_set"]["observations"][3]["joints"] = [0.1, 0.2]
    page.locator("input[type=file]").set_input_files(file_of("campaign.json", document))
    page.get_by_role("button", name="Identify").click()  # stored by this tap, or refused
    expect(page.get_by_role("alert")).to_contain_text("observations[3].joints")
    expect(page.get_by_role("alert")).to_contain_text("What to do")
    expect(page.get_by_role("heading", level=1)).to_have_text("From readings to joint stiffness")
    visited.go("#/runs/nothing-of-this-name")
    expect(page.get_by_role("alert")).to_contain_text("What to do")


def test_findings_are_shown_before_and_after(visit):
    """Forces the wrong way round are stored with a finding: the first tap shows it, the next identifies."""
    page = visit("tablet", view="#/").page
    document = campaign(load="dead_weight", seed=42)
    for observation in document["measurement_set"]["observations"]:
        observation["force"] = [0, 0, -observation["force"][2]]  # the wrong way round
    page.locator("input[type=file]").set_input_files(file_of("campaign.json", document))
    page.get_by_role("button", name="Identify").click()
    expect(page.locator(".note.warn").first).to_contain_text("What to do")
    expect(page.get_by_text("Read the findings")).to_be_visible()
    page.get_by_role("button", name="Identify").click()
    verdict = page.get_by_role("region", name="Assessment")
    expect(verdict).to_contain_text("Do not use")
    order = page.locator("main h2, main h3").all_inner_texts()
    assert "Do not use" in order[0]


def test_runs_are_searched_by_link(visit, api, stored):
    page = visit("tablet", view="#/runs?q=secondary").page
    expect(page.get_by_label("Search")).to_have_value("secondary")
    shown = page.locator("ul.rows li")
    expect(shown.first).to_be_visible()
    assert all("secondary" in text for text in shown.all_inner_texts())
    page.get_by_label("Search").fill("nothing is called like this")
    expect(page.get_by_role("button", name="Clear search")).to_be_visible()


def test_a_run_is_deleted_and_brought_back(visit, api, stored):
    run = post(api, "/v1/runs", {"measurement_set_id": stored.set, "method": "complete_pose"})["id"]
    page = visit("phone", view="#/runs").page
    link = page.locator(f"a[href='#/runs/{run}']")
    link.locator("..").get_by_role("button", name="Delete").click()
    expect(link).to_have_count(0)
    page.get_by_role("button", name="Undo").click()
    expect(page.get_by_text("Restored", exact=True)).to_be_visible()
    expect(link).to_be_visible()
    assert api.get(f"/v1/runs/{run}").json()["state"] == "succeeded"
    link.locator("..").get_by_role("button", name="Delete").click()
    expect(page.get_by_role("button", name="Undo")).to_be_visible()
    assert api.get(f"/v1/runs/{run}").status_code == 404


@pytest.mark.parametrize("size", ["tablet", "desktop"])
def test_a_bar_says_its_values_and_opens_its_posture(visit, stored, size):
    """By finger the values come first, with a link; by mouse a click opens the posture. Both come back."""
    page = visit(size, view=f"#/runs/{stored.run}/deflection").page
    column = page.locator("svg.chart").first.locator(".hit").nth(4)
    tip = page.locator(".tip")
    if size == "tablet":
        column.tap()
        expect(tip).to_contain_text("c05")
        expect(tip).to_contain_text("mm")
        tip.get_by_role("link", name="Show in 3D").tap()
    else:
        column.hover()
        expect(tip).to_contain_text("c05")
        column.click()
    expect(page.get_by_text("5 of 12")).to_be_visible()
    page.get_by_role("link", name="Back to Deflection").click()
    expect(page.locator(".hit.at").first).to_have_attribute("data-tip", re.compile("^c05"))


def test_units_change_all_numbers(visit, stored):
    page = visit("desktop", view=f"#/runs/{stored.run}").page
    row = page.locator(".joint", has_text="joint_2")
    expect(row).to_contain_text(re.compile(r"3\.\d+ ±"))
    page.get_by_label("Display").click()
    page.get_by_label("Stiffness in").select_option("kNmDeg")
    expect(row).to_contain_text(re.compile(r"5\d\.\d+ ±"))
    page.get_by_label("Stiffness in").select_option("compliance")
    expect(row).to_contain_text(re.compile(r"0\.3\d+ ±"))


@pytest.mark.parametrize(
    ("collection", "view"), [("runs", "#/runs?state=deleted"), ("comparisons", "#/compare/methods")]
)
def test_what_was_deleted_is_found_and_restored(visit, api, stored, collection, view):
    body = {"measurement_set_id": stored.other_set}
    if collection == "comparisons":
        body = {"run_ids": api.get(f"/v1/comparisons/{stored.pair}").json()["request"]["run_ids"]}
    made = post(api, f"/v1/{collection}", body)["id"]
    api.delete(f"/v1/jobs/{made}")
    page = visit("phone", view=view).page
    if "state" not in view:
        page.locator("summary", has_text="Filter and order").click()
        page.get_by_label("State").select_option("deleted")
    restore = page.get_by_role("button", name="Restore")
    before = len(api.get(f"/v1/{collection}", params={"deleted": True}).json()["items"])
    expect(restore).to_have_count(before)
    restore.first.click()  # the newest
    expect(restore).to_have_count(before - 1)
    if collection == "comparisons":  # it was the only one
        expect(page.get_by_text("Nothing deleted")).to_be_visible()
    assert api.get(f"/v1/{collection}/{made}").json()["state"] == "succeeded"


def test_an_example_is_tried_where_there_is_nothing_yet(visit):
    visited = visit("phone")
    page = visited.page
    page.route("**/v1/runs?limit=50", lambda route: route.fulfill(json={"items": [], "next": None}))
    visited.go("#/")
    page.get_by_role("button", name="Try an example").tap()
    page.get_by_role("button", name="Identify").tap()
    expect(page.get_by_role("heading", level=1)).to_have_text("example campaign")
    expect(page.locator(".verdict-card")).to_contain_text("stiffness of 5 of 6 joints")
    expect(page.locator(".head .primary")).to_have_text("Correct a program")


def test_what_was_begun_survives_a_reload(visit, stored):
    """Dropped files with what was said of them, and a form that is half filled in."""
    visited = visit("tablet", view="#/")
    page = visited.page
    page.locator("input[type=file]").set_input_files(ROOT / "examples" / "readings.csv")
    secondary = page.get_by_role("radio", name="secondary encoders")
    secondary.check(force=True)
    expect(page.get_by_text("12 rows")).to_be_visible()
    page.reload()
    expect(secondary).to_be_checked()
    expect(page.get_by_text("12 rows")).to_be_visible()
    visited.go(f"#/runs/{stored.run}/map")
    page.get_by_label("Process force on the robot").fill("0, 0, -777")
    until(lambda: page.evaluate("Object.values(sessionStorage).some((kept) => kept.includes('-777'))"))
    page.reload()
    expect(page.get_by_label("Process force on the robot")).to_have_value("0, 0, -777")
