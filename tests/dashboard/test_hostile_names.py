"""Names and file names that would like to be more than text."""

import re
from pathlib import Path

from playwright.sync_api import expect
from support.api import post, posted
from support.browsing import campaign, file_of

from jointstiff.service.api.examples import EXAMPLES

NAMES = Path(__file__).with_name("hostile_names.txt").read_text(encoding="utf-8").splitlines()
PLANTED = "script:not([src]), iframe, object, embed, base, style, #page img, #page b[style], #page meta"


SHOWN = (
    *("#/", "#/runs", "#/robots", "#/sets", "#/sets/{set}", "#/robots/{robot}", "#/runs/{run}"),
    *("#/runs/{run}/deflection", "#/runs/{run}/robot", "#/runs/{run}/predict", "#/runs/{run}/report"),
    *("#/compare/methods/{comparison}", "#/compare/trend/{robot}", "#/compare/pairs"),
)


def test_forty_hostile_names_are_shown_as_text(visit, api):
    assert len(NAMES) == len(set(NAMES)) == 40
    document = campaign(configurations=40, load="dead_weight")
    observations = document["measurement_set"]["observations"]
    for name, observation in zip(NAMES, observations, strict=True):
        observation["label"] = name
        for reading, target in zip(observation["readings"], NAMES[:3], strict=True):
            reading["target"] = target
    for name in NAMES:
        post(api, "/v1/robots", EXAMPLES["robots"]["modified DH"] | {"name": name})
    robot = post(api, "/v1/robots", {**document["robot"], "name": NAMES[0]})
    for name in NAMES:
        small = {**document["measurement_set"], "name": name, "observations": observations[:2]}
        post(api, "/v1/measurement-sets", {**small, "robot_id": robot["id"]})
    whole = {**document["measurement_set"], "name": NAMES[1], "robot_id": robot["id"]}
    set_id = post(api, "/v1/measurement-sets", whole)["id"]
    run, other = (
        post(api, "/v1/runs", {"measurement_set_id": set_id, "positive": each})["id"]
        for each in (True, False)
    )
    comparison = post(api, "/v1/comparisons", {"run_ids": [run, other]})["id"]

    visited = visit("tablet")
    page = visited.page
    about = {"set": set_id, "robot": robot["id"], "run": run, "comparison": comparison}
    for view in SHOWN:
        visited.go(view.format(**about))
        visited.settle()
        assert page.evaluate("window.hacked") is None, view
        assert page.locator(PLANTED).count() == 0, view
    visited.go("#/robots")
    for name in NAMES:
        expect(page.get_by_text(name, exact=True).first).to_be_attached()


def test_hostile_file_names_and_contents_are_shown_as_text(visit, stored):
    page = visit("tablet", view="#/").page
    file = page.locator("input[type=file]")
    for name in NAMES:
        file_name = re.sub(r"[/\0]", "_", name)[:60] + ".json"
        file.set_input_files(file_of(file_name, "<script>"))
        refusal = page.get_by_role("alert").filter(has_text="The file is no JSON")
        expect(refusal.locator("code").filter(has_text=re.compile(r"\.json$"))).to_have_text(
            file_name.replace('"', "%22")  # as browsers send it
        )
        document = dict.fromkeys(("name", "units", "encoders"), name)
        document["observations"] = [{"readings": [{"target": name}]}]
        file.set_input_files(file_of(file_name, document))
        expect(page.locator("h3.file")).to_have_text(name)
        assert page.locator(PLANTED).count() == 0
    assert page.evaluate("window.hacked") is None


def test_downloads_guard_against_formulas(visit, api, tmp_path):
    document = campaign(configurations=6, load="dead_weight")
    labels = ["=1+1", "+1", "-1", "@x", '"quoted", twice', "<svg onload=window.hacked=1>"]
    for label, observation in zip(labels, document["measurement_set"]["observations"], strict=True):
        observation["label"] = label
    run = posted(api, document)["id"]
    page = visit("tablet", view=f"#/runs/{run}/deflection").page
    page.locator("figure", has_text="Residuals").last.get_by_text("Table, CSV, SVG").click()
    with page.expect_download() as table:
        page.get_by_role("button", name="Download CSV of “Residuals”").click()
    table.value.save_as(tmp_path / "table.csv")
    text = (tmp_path / "table.csv").read_text(encoding="utf-8-sig")
    assert text.count("\n") == 1 + 6 * 3
    for start in ("=", "+", "@"):
        assert not re.search(rf"(^|,)\"?{re.escape(start)}", text, re.MULTILINE)
    with page.expect_download() as drawing:
        page.get_by_role("button", name="Download SVG of “Residuals”").click()
    drawing.value.save_as(tmp_path / "drawing.svg")
    svg = (tmp_path / "drawing.svg").read_text(encoding="utf-8")
    assert svg.startswith("<?xml")
    assert "<svg onload" not in svg
    assert "&lt;svg onload" in svg
    assert "var(--" not in svg
