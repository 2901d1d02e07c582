"""The page's views of imports, maps, plans, robots, trends and verdicts in a browser."""

import json
import re
from dataclasses import replace
from pathlib import Path

import httpx2
import numpy as np
import pytest
from playwright.sync_api import Locator, expect
from support.api import file_at, post, posted
from support.browsing import ROOT, Visit, campaign, file_of
from support.programs import START, path, tool_poses

from jointstiff.service.programs.formats import read_program
from jointstiff.simulator import LOAD_POINT, TARGETS, default_arm, simulate_campaign
from jointstiff.simulator.document import robot_document
from jointstiff.simulator.programs import program_text

READINGS = (ROOT / "examples" / "readings.csv").read_text(encoding="utf-8")


def with_load_point(text: str) -> str:
    """The table with columns of the load point."""
    head, *rows = text.splitlines()
    names = ";".join(f"load point {axis} [mm]" for axis in "xyz")
    return "\n".join([f"{head};{names}", *(f"{row};-60;20;180" for row in rows)])


class Taps:
    """Taps on an upright tablet from a view to the result of a file, counted."""

    def __init__(self, visited: Visit, view: str, file: dict[str, object]) -> None:
        self.page, self.count = visited.page, 1
        visited.go(view)
        with self.page.expect_file_chooser() as chooser:
            self(self.page.get_by_text("Choose file"))  # one; choosing it is another
        chooser.value.set_files(file)
        self(self.page.get_by_role("radio", name="motor encoders"))

    def __call__(self, locator: Locator) -> None:
        self.count += 1
        locator.tap()

    def identify(self) -> None:
        """Identify what passed the checks, and wait for the stiffnesses."""
        expect(self.page.get_by_text("passed all integrity checks")).to_be_visible()
        self(self.page.get_by_role("button", name="Identify"))
        expect(self.page.get_by_role("table", name="Joint stiffness")).to_be_visible()


def test_from_a_table_to_its_result_in_five_taps(visit, api, stored):
    """Nothing is stored before the last tap; the next file is read alike."""
    post(api, "/v1/robots", {**robot_document(default_arm()), "name": "arm of the table"})
    visited = visit("tablet upright")
    page = visited.page

    def sets() -> int:
        return len(api.get("/v1/measurement-sets?limit=100").json()["items"])

    before = sets()
    tap = Taps(visited, "#/", file_of("day 1.csv", with_load_point(READINGS)))
    tap(page.get_by_role("radio", name="arm of the table", exact=True))
    assert sets() == before
    tap.identify()
    assert tap.count <= 5
    assert sets() == before + 1

    visited.go("#/")
    head, *rows = with_load_point(READINGS).splitlines()
    rows[8] = rows[8].replace(";", ";1.2.3;", 1).rpartition(";")[0]
    page.locator("input[type=file]").set_input_files(file_of("day 2.csv", "\n".join([head, *rows])))
    faulty = page.get_by_role("cell").filter(has_text="1.2.3")
    expect(faulty.get_by_role("alert")).to_be_visible()
    expect(page.get_by_role("button", name="Identify")).to_be_disabled()
    page.locator("input[type=file]").set_input_files(file_of("day 3.csv", with_load_point(READINGS)))
    page.get_by_role("button", name="Read it the same way").tap()
    expect(page.get_by_role("radio", name="motor encoders")).to_be_checked()


def test_six_taps_among_several_robots(visit, api, stored):
    """Of several robots that fit the page chooses none: that is one tap more than with a single one."""
    robot = robot_document(default_arm())
    older, newer = (
        post(api, "/v1/robots", {**robot, "name": f"{age} of two arms"}) for age in ("older", "newer")
    )
    text = READINGS.replace("unloaded", "before").replace("loaded", "after")
    visited = visit("tablet upright")
    page = visited.page
    tap = Taps(visited, "#/", file_of("day 6.csv", text))
    tap(page.get_by_label("Load point, x, y, z"))
    page.keyboard.type("-60, 20, 180")
    expect(page.get_by_role("radio", name="newer of two arms")).not_to_be_checked()
    expect(page.get_by_role("button", name="Identify")).to_be_disabled()
    page.get_by_role("radio", name="older of two arms").tap()
    tap(page.get_by_role("radio", name="newer of two arms"))
    tap.identify()
    assert tap.count <= 6
    page.get_by_role("link", name="Report", exact=True).tap()
    report = page.get_by_role("link", name="Report as PDF")
    expect(report).to_be_visible()
    run = api.get("/v1/runs?limit=1").json()["items"][0]
    assert run["robot_id"] == newer["id"] != older["id"]
    assert report.get_attribute("href").endswith(file_at(run, "report.pdf"))


def test_five_taps_with_words_for_states_and_a_load_point(visit, api, stored):
    """Columns before and after, the load point typed: five taps, the robot chosen as after *Add a robot*."""
    robot = {**robot_document(default_arm()), "name": "arm of the five taps"}
    added = [post(api, "/v1/robots", {**robot, "joint_map": None}), post(api, "/v1/robots", robot)]
    text = READINGS.replace("unloaded", "before").replace("loaded", "after")
    visited = visit("tablet upright")
    tap = Taps(visited, f"#/?robot={added[0]['id']}", file_of("day 4.csv", text))
    tap(visited.page.get_by_label("Load point, x, y, z"))
    visited.page.keyboard.type("-60, 20, 180")
    tap.identify()
    assert tap.count <= 5


def test_words_that_may_be_states_are_one_question(visit, stored):
    text = READINGS.replace("unloaded", "pre").replace("loaded", "post")
    page = visit("tablet upright", view="#/").page
    page.locator("input[type=file]").set_input_files(file_of("day 5.csv", text))
    expect(page.get_by_text("may be states, but are not known")).to_have_count(1)
    expect(page.get_by_text("1 fault must be corrected first")).to_be_visible()
    page.get_by_role("group", name="Word for columns without load").get_by_role("radio", name="pre").tap()
    expect(page.get_by_text("may be states, but are not known")).to_have_count(0)
    expect(page.get_by_role("columnheader").filter(has_text="post").first).to_be_visible()


def test_a_number_that_is_not_finite_names_its_field(visit, stored):
    page = visit("tablet", view="#/").page
    content = '{"measurement_set": {"observations": [], "noise": {"sigma": NaN}}}'
    page.locator("input[type=file]").set_input_files(file_of("campaign.json", content))
    expect(page.get_by_text("NaN in measurement_set.noise.sigma")).to_be_visible()
    expect(page.get_by_text("Choose another file")).to_be_visible()


def test_from_a_run_to_the_numbers_of_a_place(visit, stored, api):
    page = visit("tablet", view=f"#/runs/{stored.run}/map").page
    expect(page.get_by_label("Process force on the robot [N]")).not_to_have_value("")
    page.get_by_label("Places along x, y, z").fill("5, 15, 2")
    page.get_by_role("button", name="Make the map").click()
    expect(page).to_have_url(re.compile("#/maps/"))
    made = page.url.rsplit("/", 1)[1]
    counts = api.get(f"/v1/maps/{made}").json()["result"]["counts"]
    expect(page.get_by_text(f"{counts['reached']} of 150 places have a number")).to_be_visible()
    assert counts["reached"] > 0


def test_a_map_is_downloaded_and_a_place_tapped_and_compared_with_another_run(visit, stored, api):
    page = visit("tablet", view=f"#/maps/{stored.map}").page
    for extension in ("csv", "npz"):
        with page.expect_download() as download:
            page.get_by_role("link", name=extension, exact=False).click()
        assert download.value.suggested_filename == f"map-{stored.map}.{extension}"
    worst = api.get(f"/v1/maps/{stored.map}").json()["result"]["worst"]
    slices = page.get_by_role("img", name="Slice at z")
    expect(slices).to_have_count(1)
    shown = page.locator(".slices dd").first
    expect(shown).to_have_text(re.compile(f"^{worst['deflection'] * 1e6:.4g}"[:4]))
    before = shown.text_content()
    box = slices.bounding_box()
    slices.tap(position={"x": 60, "y": box["height"] / 2})
    expect(shown).not_to_have_text(before)
    slices.press("ArrowRight")
    page.locator("canvas[data-ready=true]").wait_for()
    chosen = page.get_by_label("Beside it").locator("option").nth(1).get_attribute("value")
    page.get_by_label("Beside it").select_option(chosen)
    expect(slices).to_have_count(2)
    page.get_by_role("radio", name="Compliance along the force").check(force=True)
    expect(page.locator(".ramp-legend")).to_contain_text("µm/N")


def dropped(page, content):
    """Drop a program, and state what the controller does."""
    page.locator("input[type=file]").set_input_files(file_of("pocket.src", content))
    expect(page.get_by_text("pocket.src").first).to_be_visible()
    make = page.get_by_role("button", name="Compensate")
    expect(make).to_be_disabled()  # until the controller's option is stated
    page.get_by_label("Accuracy option of the controller").select_option("off")
    return make


def fill_in_frames(page):
    """State tool, base and the joints near the first target."""
    page.get_by_label("Tool, if the program only names it").fill("10, -20, 215.5, 0, 0, 0")
    page.get_by_label("Base, if the program only names it").fill("0 0 0 0 0 0")
    degrees = " ".join(f"{angle * 57.29577951:.3f}" for angle in START)
    page.get_by_label("Controller's joints near the first target").fill(degrees)


def test_from_a_run_to_the_corrected_file(visit, stored, api):
    visited = visit("tablet", view=f"#/runs/{stored.run}/program")
    page = visited.page
    content = program_text("krl", tool_poses(path(6)), 4)
    make = dropped(page, content)
    make.click()
    expect(page.get_by_role("alert")).to_contain_text("TOOL_DATA[1]")
    fill_in_frames(page)
    make.click()
    expect(page).to_have_url(re.compile("#/programs/"))
    expect(page.get_by_text("6 of 6")).to_be_visible()
    page.locator("canvas[data-ready=true]").wait_for()
    page.get_by_role("radio", name="After").check(force=True)
    page.get_by_label("Point of the path").fill("3")
    expect(page.get_by_text("Point 4, line 10")).to_be_visible()
    expect(page.get_by_role("table", name="Worst points").locator("tbody tr")).to_have_count(6)
    with page.expect_download() as download:
        page.get_by_role("link", name="Download pocket.src").click()
    assert download.value.suggested_filename == "pocket-corrected.src"
    corrected = download.value.path().read_bytes()
    lines = corrected.splitlines(keepends=True)
    unmarked = b"".join(line for line in lines if b"Jointstiff run " not in line)
    assert unmarked not in (content.encode(), corrected)
    assert len(read_program([("pocket.src", unmarked)]).targets) == 6
    made = page.url.rsplit("/", 1)[1]
    assert api.get(file_at(made, "program")).content == corrected
    visited.go(f"#/runs/{stored.run}/program")
    listed = page.locator("section", has_text="Compensated programs of this robot")
    expect(listed.get_by_role("link", name="pocket.src").first).to_have_attribute("href", re.compile(made))


def test_moves_that_are_not_certain_are_left_after_a_confirmation(visit, stored):
    page = visit("tablet", view=f"#/runs/{stored.run}/program").page
    head, _, tail = program_text("krl", tool_poses(path(6)), 4).rpartition("END")
    make = dropped(page, f"{head}LIN_REL {{X 5}}\nEND{tail}")
    fill_in_frames(page)
    leave = page.get_by_label("Leave the moves that are not certain as they are")
    expect(leave).to_have_count(0)
    make.click()
    expect(page.get_by_role("alert")).to_contain_text("relative move")
    leave.check()
    make.click()
    expect(page).to_have_url(re.compile("#/programs/"))
    expect(page.get_by_text("1 of 7")).to_be_visible()


def test_from_a_robot_to_postures(visit, api, stored):
    """Fill in the form, plan, and look at a posture; *Measure* takes the plan along."""
    page = visit("tablet", view=f"#/robots/{stored.robot}").page
    page.get_by_role("link", name="Plan a campaign").click()
    in_mm = "\n".join(f"{name} {' '.join(f'{1e3 * x:g}' for x in place)}" for name, place in TARGETS.items())
    page.get_by_label("Targets:").fill("P1 one two")
    expect(page.get_by_text("is not understood")).to_be_visible()
    page.get_by_label("Targets:").fill(in_mm)
    page.get_by_label("Load", exact=True).select_option(label="Force in any direction")
    page.get_by_label("Force [N]").fill("1500")
    page.get_by_label("Load point").fill(" ".join(f"{1e3 * x:g}" for x in LOAD_POINT))
    page.get_by_label("Number of readings").fill("10")
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("Certified: at least")).to_be_visible()
    plan = api.get(f"/v1/plans/{page.url.rsplit('/', 1)[1]}").json()
    labels = [each["label"] for each in plan["result"]["readings"]]

    expect(page.get_by_role("heading", name=f"Posture {labels[0]}")).to_be_visible()
    page.locator("canvas[data-ready=true]").wait_for()
    page.get_by_role("button", name=f"Show {labels[4]}").click()
    expect(page.get_by_role("heading", name=f"Posture {labels[4]}")).to_be_visible()
    page.get_by_role("link", name="Measure live", exact=True).click()
    expect(page.get_by_text("Robot, targets, loads and surroundings are those of the plan.")).to_be_visible()


def test_a_campaign_goes_on(visit, stored):
    """Plan from a set: what is left empty is the campaign's, and the file to fill in has its readings."""
    page = visit("phone", view=f"#/sets/{stored.set}").page
    page.locator("summary", has_text="More").click()
    page.get_by_role("link", name="Plan next readings").click()
    page.get_by_label("Number of readings").fill("4")
    page.get_by_label("joint_1").uncheck()
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("Certified: at least")).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("button", name="Campaign to fill in").click()
    observations = json.loads(download.value.path().read_text())["observations"]
    assert len(observations) == 12 + 4
    assert observations[0]["readings"][0]["loaded"] is not None
    assert observations[-1]["readings"][0]["loaded"] is None


def test_a_plan_after_a_run_omits_what_the_run_omits(visit, api, stored):
    run = post(api, "/v1/runs", {"measurement_set_id": stored.set, "leave_out": ["c03"]})["id"]
    page = visit("tablet", view=f"#/plans?set={stored.set}&run={run}").page
    expect(page.get_by_text("As in the run so far: without c03.")).to_be_visible()
    page.get_by_label("Number of readings").fill("4")
    page.get_by_label("joint_1").uncheck()
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("Certified: at least")).to_be_visible()
    plan = api.get(f"/v1/plans/{page.url.rsplit('/', 1)[1]}").json()
    assert plan["request"]["leave_out"] == ["c03"]


def test_a_weight_plans_what_it_twists_and_a_refusal_says_what_to_change(visit, stored):
    page = visit("tablet", view="#/plans").page
    expect(page.get_by_role("button", name="Plan", exact=True)).to_be_disabled()
    page.get_by_label("Robot or measurement set").select_option(f"robot:{stored.robot}")
    expect(page.get_by_label("Force [N]")).to_have_value("1500")  # as in the robot's newest campaign
    expect(page.get_by_label("Load point:")).to_have_value("-60, 20, 180")
    expect(page.get_by_label("Targets:")).to_have_value(re.compile(r"^P10,? 14[67]"))  # as read
    page.get_by_label("Load", exact=True).select_option(label="Dead weight")  # others in a newer campaign
    page.get_by_label("Load point:").fill("")
    page.get_by_label("Targets:").fill("P1 100 0 50")
    page.get_by_label("Force [N]").fill("900")
    page.get_by_label("joint_2").uncheck()
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("twists joint_1").first).to_be_visible()
    page.get_by_label("joint_2").check()
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("twists joint_1, joint_6").first).to_be_visible()


def test_a_nominal_arm_is_found_named_archived_and_taken_back(visit):
    """Search the catalogue, save, look at table and map, rename, archive; note who measured, and find it."""
    visited = visit("tablet", view="#/robots/new")
    page = visited.page
    page.get_by_label("Search").fill("kr210")
    page.get_by_role("radio", name="KUKA KR 210 R2700 extra").check(force=True)
    expect(page.get_by_text("Nominal values of the maker")).to_be_visible()
    page.locator("canvas[data-ready=true]").wait_for()
    page.get_by_role("button", name="Edit as a table").click()
    expect(page.get_by_label("a of joint 3")).to_have_value("1150")
    expect(page.get_by_label("Preset")).to_have_value("kuka")
    page.get_by_role("radio", name="Catalogue").check(force=True)
    page.get_by_label("Name", exact=True).fill("press line arm")
    page.get_by_role("button", name="Save robot").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("press line arm")
    expect(page.get_by_role("table", name="Table")).to_contain_text("−140")
    expect(page.get_by_role("table", name="Model angles by controller angles")).to_contain_text("−1")

    page.once("dialog", lambda dialog: dialog.accept("press line, arm 2"))
    page.get_by_role("button", name="Rename").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("press line, arm 2")
    page.get_by_role("button", name="Archive").click()
    expect(page.get_by_role("button", name="Restore from the archive")).to_be_visible()
    robot = page.url.rpartition("/")[2]
    visited.go("#/robots")
    expect(page.get_by_text("press line, arm 2")).to_have_count(0)
    page.get_by_text("Archived", exact=True).click()
    page.get_by_role("link", name="press line, arm 2").click()
    page.get_by_role("button", name="Restore from the archive").click()
    expect(page.get_by_role("button", name="Archive", exact=True)).to_be_visible()

    with httpx2.Client(base_url=visited.url, timeout=60.0) as api:
        document = campaign(load="pull", seed=31)
        robot = post(api, "/v1/robots", document["robot"] | {"name": "noted arm"})["id"]
        readings = document["measurement_set"] | {"robot_id": robot, "name": "noted set"}
        stored = post(api, "/v1/measurement-sets", readings)["id"]
        visited.go(f"#/sets/{stored}")
        page.get_by_role("button", name="Add notes").click()
        page.get_by_label("Measured at").fill("2026-11-20T14:30")
        page.get_by_label("Serial number of the robot").fill("F-211034")
        page.get_by_label("Notes").fill("before\nthe repair")
        page.get_by_role("button", name="Save").click()
        expect(page.get_by_text("F-211034")).to_be_visible()
        noted = api.get(f"/v1/measurement-sets/{stored}").json()
    assert (noted["serial_number"], noted["notes"]) == ("F-211034", "before\nthe repair")
    assert noted["measured_at"] is not None
    visited.go("#/sets")
    page.get_by_label("Search").fill("noted 211034")
    expect(page.locator(".rows .item")).to_have_count(1)
    page.get_by_label("Measured from").fill("2026-11-22")
    expect(page.get_by_text("No match")).to_be_visible()


EXAMPLE = Path(__file__).parents[2] / "examples" / "sweeps.json"


def test_from_dropped_sweeps_to_a_robot(visit, api):
    visited = visit("tablet", view="#/")
    page = visited.page
    page.locator("input[type=file]").first.set_input_files(EXAMPLE)
    expect(page).to_have_url(re.compile("#/geometries$"))
    expect(page.get_by_role("table", name="Sweeps").locator("tbody tr")).to_have_count(6)
    page.get_by_role("button", name="Identify the geometry").click()
    expect(page).to_have_url(re.compile("#/geometries/"))
    page.locator("canvas[data-ready=true]").wait_for()
    lengths = page.get_by_role("table", name="Links, nominal and identified")
    expect(lengths.get_by_role("row", name="a joint_2 1120.000")).to_be_visible()
    axes = page.get_by_role("table", name="Axes at model angle zero, in R0")
    expect(axes.locator("tbody tr")).to_have_count(6)
    made = page.url.rsplit("/", 1)[1]
    page.get_by_label("Name of the robot").fill("cell 3, measured")
    page.get_by_role("button", name="Save as a robot").click()
    expect(page).to_have_url(re.compile("#/robots/"))
    robot = api.get(f"/v1/robots/{page.url.rsplit('/', 1)[1]}").json()
    assert (robot["name"], robot["geometry_id"]) == ("cell 3, measured", made)
    visited.go("#/geometries")
    expect(page.get_by_role("link", name=re.compile("cell 3"))).to_be_visible()


def test_from_the_fleet_to_an_acknowledged_alarm(visit, api):
    arm = default_arm()
    soft = replace(arm, stiffnesses=arm.stiffnesses * np.array([1.0, 1.0, 0.85, 1.0, 1.0, 1.0]))
    documents = [
        simulate_campaign(each, load="pull", configurations=10, seed=seed)
        for seed, each in enumerate([arm, arm, arm, soft])
    ]
    robot = post(api, "/v1/robots", documents[0]["robot"] | {"name": "worn robot"})["id"]
    for month, document in enumerate(documents, start=1):
        noted = {"robot_id": robot, "measured_at": f"2026-{month:02d}-10T08:00:00Z", "serial_number": "W-1"}
        stored = post(api, "/v1/measurement-sets", document["measurement_set"] | noted)
        post(api, "/v1/runs", {"measurement_set_id": stored["id"]})

    visited = visit("phone")
    page = visited.page
    last = api.get("/v1/runs").json()["items"][0]["id"]
    alarmed = ["", f"#/robots/{robot}", f"#/runs/{last}", f"#/runs/{last}/report"]
    words = re.compile(r"in alarm:.*joint_3 −1\d.* since 10 Apr 2026")
    for address in alarmed:
        visited.go(address)
        expect(page.locator(".alarms")).to_contain_text(words)
    for address in ("#/robots", "#/runs"):
        visited.go(address)
        expect(page.locator(".item .alarm").first).to_have_text("Alarm")
    visited.go("#/fleet")
    row = page.get_by_role("link", name="worn robot")
    expect(row).to_contain_text("Alarm")
    expect(row.locator(".badge")).to_have_text("Use")
    row.tap()
    alarm = page.get_by_role("region", name="Alarm of joint_3")
    expect(alarm).to_contain_text("softer than in its reference campaigns")
    expect(alarm).to_contain_text("since 2026-04-10")
    alarm.get_by_label("Finding or decision").fill("gearbox ordered")
    alarm.get_by_role("button", name="Acknowledge").tap()
    expect(alarm).to_contain_text("gearbox ordered")

    page.get_by_text("4 campaigns", exact=True).tap()
    expect(page.locator("details .badge")).to_have_text(["Use"] * 4)
    points = page.get_by_role("group", name="Stiffness of joint_3 over its campaigns").get_by_role("link")
    expect(points).to_have_count(4)
    points.last.focus()
    page.keyboard.press("Enter")
    expect(page).to_have_url(re.compile("#/runs/"))
    visited.go("#/fleet")
    expect(page.get_by_role("link", name="worn robot")).to_contain_text("Acknowledged")
    for address in alarmed:
        visited.go(address)
        expect(page.locator("h1")).to_be_visible()
        expect(page.locator(".alarms")).to_have_count(0)


@pytest.fixture(scope="module")
def unusable(api):
    """A run whose columns of two joints are exchanged, on a robot of its own."""
    document = campaign(load="pull", configurations=12, seed=8)
    for observation in document["measurement_set"]["observations"]:
        joints = observation["joints"]
        joints[1], joints[2] = joints[2], joints[1]
    return posted(api, document)["id"]


def test_the_page_asks_before_it_maps(visit, unusable):
    visited = visit("tablet")
    page, said = visited.page, []
    answers = iter([False, True])

    def answer(dialog):
        said.append(dialog.message)
        dialog.accept() if next(answers) else dialog.dismiss()

    page.on("dialog", answer)
    visited.go(f"#/runs/{unusable}/map")
    page.get_by_label("Places along x, y, z").fill("3, 3, 1")
    page.get_by_role("button", name="Make the map").click()
    expect(page.get_by_text("the verdict on run")).to_be_visible()
    page.get_by_role("button", name="Make the map").click()
    expect(page).to_have_url(re.compile("#/maps/"))
    assert len(said) == 2
    assert "joint_2" in said[0]
    assert "Continue anyway?" in said[0]
    expect(page.locator(".head .badge")).to_have_text("Do not use")
    expect(page.get_by_role("region", name="Assessment")).to_contain_text("joint_2")
    expect(page.get_by_text("Computed despite this verdict.")).to_be_visible()
    visited.go(f"#/runs/{unusable}/map")
    listed = page.locator(".list")
    expect(listed.locator(".badge.do_not_use")).to_have_count(1)
    listed.get_by_label("Verdict").select_option("use")
    expect(listed.locator(".item")).to_have_count(0)


def test_carried_verdicts_stand_on_their_pages(visit, stored, api):
    verdict = api.get(f"/v1/runs/{stored.run}").json()["result"]["assessment"]["verdict"]
    visited = visit("tablet")
    program = api.get("/v1/programs").json()["items"][0]["id"]
    judged = api.get(f"/v1/programs/{program}").json()["result"]["assessment"]
    for address in (
        f"#/maps/{stored.map}",
        f"#/plans/{stored.plan}",
        f"#/programs/{program}",
        f"#/compare/methods/{stored.pair}",
        f"#/compare/methods/{stored.comparison}",
    ):
        visited.go(address)
        expect(visited.page.locator(".head .badge")).to_have_count(1)
        if "pairs" not in address and "methods" not in address:
            own = judged["verdict"] if "programs" in address else verdict  # a program has reasons of its own
            expect(visited.page.locator(f".head .badge.{own}")).to_have_count(1)


def test_runs_are_filtered_by_verdict(visit, unusable):
    page = visit("desktop", view="#/runs").page
    page.get_by_label("Verdict").select_option("do_not_use")
    expect(page.locator(".badge.do_not_use").first).to_be_visible()
    expect(page.locator(".badge.use")).to_have_count(0)
    expect(page).to_have_url(re.compile("verdict=do_not_use"))
