"""Tables of readings on the page: dropped, understood, mended, identified."""

from playwright.sync_api import Locator, expect
from support.api import file_at, post
from support.browsing import ROOT, Visit, file_of

from jointstiff.simulator import default_arm
from jointstiff.simulator.document import robot_document

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
