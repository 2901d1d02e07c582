"""Archive and restore on the page: what a restore would add is shown before it adds anything."""

import httpx2
from playwright.sync_api import expect
from support.browsing import file_of


def test_an_archive_that_was_downloaded_adds_nothing_to_its_own_service(
    visit, stored, api: httpx2.Client, tmp_path
):
    page = visit("phone", view="#/archive").page
    with page.expect_download() as downloading:
        page.get_by_role("link", name="Download the archive").click()
    path = tmp_path / "saved.zip"
    downloading.value.save_as(path)
    page.locator("input[type=file]").set_input_files(path)
    expect(page.get_by_text("The service has all records of this archive already.")).to_be_visible()
    robots = api.get("/v1/robots").json()["total"]
    row = page.get_by_role("row", name="Robots")
    expect(row.get_by_role("cell")).to_have_text(["0", str(robots), "0", str(robots)])


def test_a_file_that_is_no_archive_is_refused_with_a_remedy(visit, stored):
    page = visit("desktop", view="#/archive").page
    page.locator("input[type=file]").set_input_files(file_of("saved.zip", "no archive"))
    note = page.get_by_role("alert")
    expect(note).to_contain_text("is no archive")
    expect(note).to_contain_text("jointstiff archive")
    expect(page.get_by_role("button", name="Restore")).to_have_count(0)
