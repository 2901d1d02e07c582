"""Tables of readings on the page: dropped, understood, mended, identified."""

from __future__ import annotations

from playwright.sync_api import expect
from support.browsing import ROOT, post

from jointstiff.simulator import default_arm
from jointstiff.simulator.document import robot_document

READINGS = (ROOT / "examples" / "readings.csv").read_text(encoding="utf-8")


def table(name: str, text: str) -> dict[str, object]:
    return {"name": name, "mimeType": "text/csv", "buffer": text.encode()}


def with_load_point(text: str) -> str:
    """The table with columns of the load point."""
    head, *rows = text.splitlines()
    names = ";".join(f"load point {axis} [mm]" for axis in "xyz")
    return "\n".join([f"{head};{names}", *(f"{row};-60;20;180" for row in rows)])


def test_from_a_table_to_its_result_in_five_taps(visit, api, stored):
    """On an upright tablet: five taps, nothing stored before the last; the next file is read alike."""
    post(api, "/v1/robots", {**robot_document(default_arm()), "name": "arm of the table"})
    taps = 0
    visited = visit("tablet upright")
    page = visited.page

    def tap(locator):
        nonlocal taps
        taps += 1
        locator.tap()

    def sets() -> int:
        return len(api.get("/v1/measurement-sets?limit=100").json()["items"])

    before = sets()
    visited.go("#/")
    with page.expect_file_chooser() as chooser:
        tap(page.get_by_text("Choose file"))
    taps += 1  # choosing it
    chooser.value.set_files(table("day 1.csv", with_load_point(READINGS)))
    tap(page.get_by_role("radio", name="motor encoders"))
    tap(page.get_by_role("radio", name="arm of the table"))
    expect(page.get_by_text("passed all integrity checks")).to_be_visible()
    assert sets() == before
    tap(page.get_by_role("button", name="Identify"))
    expect(page.get_by_role("table", name="Joint stiffness")).to_be_visible()
    assert taps <= 5
    assert sets() == before + 1

    visited.go("#/")
    head, *rows = with_load_point(READINGS).splitlines()
    rows[8] = rows[8].replace(";", ";1.2.3;", 1).rpartition(";")[0]
    page.locator("input[type=file]").set_input_files(table("day 2.csv", "\n".join([head, *rows])))
    faulty = page.get_by_role("cell").filter(has_text="1.2.3")
    expect(faulty.get_by_role("alert")).to_be_visible()
    expect(page.get_by_role("button", name="Identify")).to_be_disabled()
    page.locator("input[type=file]").set_input_files(table("day 3.csv", with_load_point(READINGS)))
    page.get_by_role("button", name="Read it the same way").tap()
    expect(page.get_by_role("radio", name="motor encoders")).to_be_checked()
