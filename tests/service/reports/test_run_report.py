"""Reports and certificates of runs, and the pictures in them."""

import contextlib
import io
import json
import math
import re
import subprocess
import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pypdf
import pytest
from support.terminal import terminal

import jointstiff
import jointstiff as js
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.report import Laboratory, Party
from jointstiff.schemas.run import Campaign, JointResult, Run
from jointstiff.service import reports as service_reports
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.kinds.map.kind import make_area_map
from jointstiff.service.reports.exports import ExportedModel, write_joints_csv
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.pictures import draw_arm, draw_bars, draw_intervals
from jointstiff.service.reports.plots import draw_figure
from jointstiff.service.reports.rendering import render_html, render_pdf
from jointstiff.service.reports.run import (
    ITEMS,
    RunSubject,
    build_run_report,
    build_uncertainty_section,
    predict_flange_compliance,
)
from jointstiff.service.tables.table import Area, Chart, Sheet
from jointstiff.simulator import default_arm, simulate_campaign

LABORATORY = Laboratory(
    name="Metrology Lab",
    address=["1 Main Street", "Nantes"],
    contact="lab@example.org",
    place="Hall 3, cell 7",
    traceability="Tracker: certificate K-17 of 2026-03-02; load cell: certificate K-18.",
    method="QM-23, revision 4",
    customer=Party(name="Arms Inc.", address=["2 Side Street"], contact="Ms Smith"),
)
METADATA = {
    "measured_at": "2026-11-20T14:30:00+01:00",
    "operator": "J. Doe",
    "instrument": "Tracker 750123",
    "serial_number": "SN-4711",
    "item_condition": "as found, new gear in joint 3",
    "conditions": "21 °C, warmed up for 30 min",
    "notes": "load by a winch",
}
HOSTILE = '#read("/etc/passwd") =1+1 </script><img src=x onerror=alert(1)> $x$ *b* @preview/cetz ‹中文›'


@pytest.fixture(scope="module")
def document():
    campaign = simulate_campaign(default_arm(), load="dead_weight", configurations=12, seed=2)
    return campaign | {
        "measurement_set": campaign["measurement_set"] | METADATA,
        "run": {"complementary_stiffness": "neglected"},
    }


@pytest.fixture(scope="module")
def campaign(document):
    return Campaign.model_validate_json(json.dumps(document))


@pytest.fixture(scope="module")
def run(campaign):
    return jointstiff.identify(campaign, campaign.run)


def subject_of(campaign, run, laboratory=LABORATORY, **changes):
    readings = campaign.measurement_set.model_copy(update=changes)
    model = ExportedModel.from_run(run, prepare_robot(campaign.robot).robot, campaign.robot.name)
    return RunSubject(model, readings, LaboratorySettings(laboratory))


@pytest.fixture(scope="module")
def subject(campaign, run):
    return subject_of(campaign, run)


@lru_cache
def pages_of(content):
    return [" ".join(page.extract_text().split()) for page in pypdf.PdfReader(io.BytesIO(content)).pages]


@pytest.fixture(scope="module")
def signed(subject):
    return render_pdf(build_run_report(subject))


STATED = {
    "7.8.2.1 a": "Report on joint stiffness",
    "7.8.2.1 b": "Metrology Lab 1 Main Street, Nantes lab@example.org",
    "7.8.2.1 c": "Hall 3, cell 7",
    "7.8.2.1 d": "— End of report ",
    "7.8.2.1 e": "Arms Inc., 2 Side Street, Ms Smith",
    "7.8.2.1 f": "partial pose, covariance weights",
    "7.8.2.1 g": "Serial number SN-4711",
    "7.8.2.1 h": "Date of receipt of the item",
    "7.8.2.1 i": "Measured 2026-11-20 13:30 UTC",
    "7.8.2.1 j": "Date of issue",
    "7.8.2.1 k": "Sampling: none.",
    "7.8.2.1 l": "The results relate only to the item",
    "7.8.2.1 m": "10⁶ N·m/rad",
    "7.8.2.1 n": "Deviation: the complementary stiffness is neglected.",
    "7.8.2.1 o": "Name and signature",
    "7.8.2.1 p": "Results from external providers: none",
    "7.8.4.1 a": "k = 2, which corresponds to a coverage probability of approximately 95 %",
    "7.8.4.1 b": "Conditions 21 °C, warmed up for 30 min",
    "7.8.4.1 c": "certificate K-17 of 2026-03-02",
    "7.8.4.1 d": "after compensation by the model, computed",
    "7.8.4.1 e": "No statement of conformity",
    "7.8.4.1 f": "Verdict on the result",
}


def test_every_item_has_a_test():
    assert [item for item, _, _ in ITEMS] == list(STATED)


@pytest.mark.parametrize("item", STATED)
def test_the_pdf_states_each_item_of_iso_17025(signed, item):
    text = " ".join(pages_of(signed))
    assert STATED[item] in text
    assert item in text


def sources_of(model):
    """First cells of the rows of the budget."""
    (table,) = build_uncertainty_section(model).tables
    return [row[0].text for row in table.rows()]


def test_a_budget_without_model_error_is_partial(subject):
    """Without a bound of the model error the head and the text say that U is partial."""
    result = subject.model.result
    parts = [part for part in result.budget.components if part.source != "model_error"]
    budget = result.budget.model_copy(update={"components": parts, "missing": ["model_error"]})
    model = replace(subject.model, result=result.model_copy(update={"budget": budget}))
    assert "expanded, partial, k = 2" in sources_of(model)
    assert (
        "The budget is partial: the run has no bound of the model error"
        in build_uncertainty_section(model).paragraphs[0]
    )
    named = budget.model_copy(update={"missing": ["model_error", "lack_of_fit"]})
    model = replace(subject.model, result=result.model_copy(update={"budget": named}))
    assert "the assessment names a lack of fit" in build_uncertainty_section(model).paragraphs[0]
    student = budget.model_copy(update={"coverage_factor": 2.36})
    model = replace(subject.model, result=result.model_copy(update={"budget": student}))
    assert "expanded, partial, k = 2.36" in sources_of(model)


def test_a_run_that_is_not_to_be_used_predicts_nothing(subject, campaign, run):
    reason = Finding(code="lack_of_fit", weight="do_not_use", message="it does not fit", remedy="read again")
    refuted = run.result.assessment.model_copy(update={"verdict": "do_not_use", "reasons": [reason]})
    result = run.result.model_copy(update={"assessment": refuted})
    other = subject_of(campaign, run.model_copy(update={"result": result}))
    assert len(predict_flange_compliance(subject)) == 3
    assert predict_flange_compliance(other) == []


def test_the_room_is_no_condition_of_the_item(signed):
    text = " ".join(pages_of(signed))
    assert "Condition of the item as found, new gear in joint 3" in text
    assert text.count("21 °C, warmed up for 30 min") == 1


def test_run_and_table_are_attached_and_it_is_pdf_a(signed, subject, run):
    reader = pypdf.PdfReader(io.BytesIO(signed))
    assert reader.attachments["joints.csv"] == [write_joints_csv(subject.model)]
    assert Run.model_validate_json(reader.attachments["run.json"][0]) == run
    assert b"<pdfaid:part>3</pdfaid:part><pdfaid:conformance>B</pdfaid:conformance>" in signed
    assert len(signed) <= 1_000_000


def test_a_large_run_is_attached_without_its_residuals(subject, run, monkeypatch):
    monkeypatch.setattr("jointstiff.service.reports.run.MAX_ATTACHED_BYTES", 20_000)
    attached = Run.model_validate_json(subject.run_json())
    assert attached.result.residuals == []
    assert attached.result.joints == run.result.joints


def test_a_report_has_lines_to_sign_and_no_state(subject, signed):
    page = render_html(build_run_report(subject)).decode()
    last = pages_of(signed)[-1]
    for line in ("Date of receipt of the item", "Date of issue", "Place and date", "Name and signature"):
        assert f"<p>{line}</p>" in page
        assert line in last
    assert "draft" not in " ".join(pages_of(signed)).lower()


@pytest.mark.process
def test_two_processes_give_the_same_bytes(document, run, tmp_path):
    (tmp_path / "campaign.json").write_text(json.dumps(document))
    (tmp_path / "run.json").write_text(run.model_dump_json())
    arguments = ["report", "campaign.json", "--run", "run.json", "-o"]
    command = [sys.executable, "-m", "jointstiff", *arguments, "other.pdf"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, timeout=120)
    with contextlib.chdir(tmp_path):
        assert terminal(*arguments, "this.pdf").exit_code == 0
    assert (tmp_path / "other.pdf").read_bytes() == (tmp_path / "this.pdf").read_bytes()


def test_hostile_text_is_shown_as_text(campaign, run):
    names = {"operator": HOSTILE, "instrument": HOSTILE, "notes": f"{HOSTILE}\n{HOSTILE}"}
    laboratory = LABORATORY.model_copy(update={"name": HOSTILE, "traceability": HOSTILE})
    report = build_run_report(subject_of(campaign, run, laboratory, **names))
    text = " ".join(pages_of(render_pdf(report)))
    assert '#read("/etc/passwd") =1+1 </script><img src=x onerror=alert(1)> $x$ *b* @preview/cetz' in text
    assert "‹‹U+4E2D›‹U+6587››" in text  # the fonts of Typst lack these
    page = render_html(report).decode()
    assert "<script" not in page
    assert "<img" not in page
    assert "&lt;img src=x onerror=alert(1)&gt; $x$ *b* @preview/cetz ‹中文›" in page


def test_the_template_reads_no_file_and_no_package():
    template = Path(service_reports.__file__).with_name("template.typ").read_text()
    assert not re.findall(r"\b(?:import|include|read|eval|plugin|csv|toml|yaml|xml|cbor)\b *\(?\"", template)
    assert set(re.findall(r"image\((\w+)", template)) == {"bytes"}
    assert re.findall(r"json\(.*", template) == ["json(bytes(sys.inputs.document))"]


def test_the_page_loads_nothing_and_has_no_scripts(subject, run):
    page = render_html(build_run_report(subject)).decode()
    assert "<script" not in page
    assert "href" not in page
    assert "src=" not in page
    assert page.count("http") == page.count('xmlns="http://www.w3.org/2000/svg"')
    assert run.provenance.input_hash in page


@pytest.mark.parametrize("by_reading", [True, False])
def test_noise_is_stated_with_each_reading_or_estimated(campaign, run, by_reading):
    said = "stated with each reading." if by_reading else "estimated from the residuals."
    sigma = 2e-5 if by_reading else None
    observations = [
        each.model_copy(
            update={"readings": [one.model_copy(update={"sigma": sigma}) for one in each.readings]}
        )
        for each in campaign.measurement_set.observations
    ]
    subject = subject_of(campaign, run, noise=None, observations=observations)
    assert said in repr(build_run_report(subject))


def joint(name, stiffness, interval):
    ends = None if interval is None else (1.0 / (interval[1] or math.inf), 1.0 / interval[0])
    return JointResult(
        name=name,
        status="identified" if stiffness else "not_observable",
        verdict="use",
        compliance=stiffness and 1.0 / stiffness,
        stiffness=stiffness,
        standard_uncertainty=1e-9 if stiffness else None,
        compliance_interval=ends,
        stiffness_interval=interval,
        reason=None if stiffness else "never twists",
    )


@pytest.mark.parametrize(
    "joints",
    [
        [joint("a", 2e5, (1.5e5, 3e5)), joint("b", 4e6, (3e6, 7e6))],
        [joint("a", 2e5, (1.5e3, None)), joint("b", None, None), joint("c", 4e7, (3e7, 9e8))],
        [joint("a", 1e6, (1e6, 1e6)), joint("b", -1e6, None)],
    ],
)
def test_stiffnesses_stand_on_a_logarithmic_axis_that_holds_them_all(joints):
    assert draw_intervals([joint("a", None, None)], 0.95) is None
    drawing = draw_intervals(joints, 0.95).svg
    decades = {float(text) * 1e6: at for text, at in texts_of(drawing) if re.fullmatch(r"[\d.e+-]+", text)}
    (first, (at_first, _)), (last, (at_last, below)) = min(decades.items()), max(decades.items())
    known = [each for each in joints if (each.stiffness or 0.0) > 0.0]
    ends = [end for each in known for end in (each.stiffness, *each.stiffness_interval) if end]
    assert min(decades) <= min(ends) <= max(ends) <= max(decades)
    lines = numbers_of(drawing, "line", ("x1", "y1", "x2", "y2", "stroke-width"))
    ticks = lines[lines[:, 4] == 0.8].tolist()
    dots = numbers_of(drawing, "circle", ("cx", "cy"))
    for each, bar, (dot, row) in zip(known, lines[lines[:, 4] == 2.2], dots, strict=True):
        low, high = each.stiffness_interval  # without a limit to the end of the axis
        share = np.log(np.array([low, high or last, each.stiffness]) / first) / np.log(last / first)
        at = at_first + share * (at_last - at_first)
        assert [*bar[:4:2], dot] == pytest.approx(at, abs=0.1)
        assert at_first <= at[0] <= at[2] <= at[1] <= at_last
        for end in bar[:3:2] if high else bar[:1]:
            x, above, other, under, _ = ticks.pop(0)
            assert (x, other, (above + under) / 2) == pytest.approx((end, end, row), abs=0.02)
    names = [dict(texts_of(drawing))[each.name][1] for each in joints]
    rows = [y for text, (x, y) in texts_of(drawing) if text.startswith("no number") and x >= at_first]
    assert sorted([*rows, *dots[:, 1] + 0.35 * 8.0]) == pytest.approx(names, abs=1.0)
    assert (ticks, min(np.diff([*names, below])) >= 10.0) == ([], True)


def test_places_without_a_number_are_crosses_in_a_map():
    mpl.use("Agg")
    values = [1e-3, math.nan, 3e-3, math.nan, 5e-3]
    area = Area("deflection", range(5), [2.0] * 5, values, ("x", "y", "mm"), 1e3)
    axis = draw_figure((), (area,)).axes[0]
    dots, crosses = axis.collections
    assert dots.get_offsets()[:, 0].tolist() == [0.0, 2.0, 4.0]
    assert dots.get_array().tolist() == pytest.approx([1.0, 3.0, 5.0])
    assert crosses.get_offsets()[:, 0].tolist() == [1.0, 3.0]


def numbers_of(drawing, tag, names):
    """Some numbers of all elements of a tag, (k, names)."""
    tags = re.findall(rf"<{tag} [^>]*>", drawing)
    return np.array([[float(re.search(rf'[ ]{name}="([-\d.]+)"', tag)[1]) for name in names] for tag in tags])


def texts_of(drawing):
    """Texts with their places; all that is drawn stands within the picture."""
    sides = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', drawing).groups()
    for names, side in zip(("x|x1|x2|cx", "y|y1|y2|cy"), map(float, sides), strict=True):
        places = [float(each) for each in re.findall(rf' (?:{names})="(-?[\d.]+)"', drawing)]
        assert 0.0 <= min(places) <= max(places) <= side
    found = re.findall(r'<text x="([\d.]+)" y="([\d.]+)"[^>]*>([^<]*)</text>', drawing)
    return [(text, (float(x), float(y))) for x, y, text in found]


def test_an_arm_is_seen_as_it_stands():
    """Two links of 2 m that turn about z: axes at right angles (Gauss); joints in a place share a label."""
    rows = [{"a": a, "alpha": 0.0, "d": 0.0, "theta": 0.0} for a in (0.0, 2.0, 2.0)]
    robot = prepare_robot(js.robot(rows, convention="standard", units="m, rad, N")).robot
    drawing = draw_arm(robot, [0.0, 0.0, np.pi / 2]).svg
    axes = numbers_of(drawing, "line", ("x1", "y1", "x2", "y2"))
    x, y, z = (axes[:, 2:] - axes[:, :2]) @ [1.0, -1.0j]  # upwards
    assert abs(x**2 + y**2 + z**2) == pytest.approx(0.0, abs=1.0)
    assert x.imag < z.real == 0.0 < min(z.imag, x.real, y.real, y.imag)  # z upwards, seen from a corner
    points = re.search(r'polyline points="([^"]*)"', drawing)[1].split()
    places = np.array([[float(each) for each in point.split(",")] for point in points]) @ [1.0, -1.0j]
    base = axes[0, :2] @ [1.0, -1.0j]
    reached = [0.0, 0.0, 0.0, 4.0 * x, 4.0 * (x + y)]  # arrows are a quarter of the reach long
    assert (places - base).tolist() == pytest.approx(reached, abs=0.1)
    assert [text for text, _ in texts_of(drawing)] == ["x", "y", "z", "1, 2", "3"]


@pytest.mark.parametrize("greatest", [0.7e-3, 1.0e-3, 3e-3, 8e-3])
def test_bars_have_the_heights_of_their_numbers_on_the_axis(greatest):
    """Two series side by side from left to right, a legend below that tells them apart."""
    series = {
        "measured": [greatest, 0.5 * greatest, 0.2 * greatest],
        "left": [0.1 * greatest, None, -0.3 * greatest],
    }
    drawing = draw_bars(Chart("Bars", ["a", "b", "c"], series, 1e3, "mm")).svg
    texts, axis = texts_of(drawing), numbers_of(drawing, "line", ("x1", "y1"))
    (least, (_, bottom)), *_, (top, (beside, above)) = sorted(
        (float(text), place) for text, place in texts if re.fullmatch(r"[\d.]+", text)
    )
    assert (least, beside < axis[:, 0].min()) == (0.0, True)
    assert top == min(each for each in (1.0, 2.0, 5.0, 10.0) if each > 999.0 * greatest)
    boxes = numbers_of(drawing, "rect", ("x", "y", "width", "height"))
    boxes, legend = boxes[boxes[:, 1] < bottom], boxes[boxes[:, 1] > bottom]
    values = 1e3 * np.abs([value or 0.0 for each in series.values() for value in each])
    np.testing.assert_allclose(boxes[:, 3], values / top * (bottom - above), atol=0.02)
    shown = boxes[boxes[:, 3] > 0.0]
    np.testing.assert_allclose(shown[:, 1] + shown[:, 3], axis[:, 1].max(), atol=0.02)
    assert (np.diff(boxes[:3, 0]) > boxes[0, 2]).all()
    assert boxes[3, 0] == pytest.approx(boxes[0, 0] + boxes[0, 2], abs=0.02)
    assert 0.7 * 434.0 < boxes[:, 2].sum() < 434.0
    assert 40.0 <= boxes[:, 0].min() < (boxes[:, 0] + boxes[:, 2]).max() <= 480.0
    names = [place for text, place in texts if text in series]
    assert 40.0 == legend[0, 0] < names[0][0] < legend[1, 0] < names[1][0] < 400.0
    assert legend[:, 1] + legend[:, 3] == pytest.approx([y for _, y in names], abs=2.0)


def test_bars_of_a_plot_stand_around_their_place_from_left_to_right():
    mpl.use("Agg")
    series = {"one": [1.0, 2.0], "two": [3.0, 4.0], "three": [5.0, 6.0]}
    axis = draw_figure((Chart("t", ["a", "b"], series, 2.0, "mm"),)).axes[0]
    assert [each.get_text() for each in axis.get_xticklabels()] == ["a", "b"]
    middles = [[bar.get_x() + bar.get_width() / 2 for bar in group] for group in axis.containers]
    assert [[bar.get_height() for bar in group] for group in axis.containers] == [[2, 4], [6, 8], [10, 12]]
    assert np.mean(middles, axis=0).tolist() == pytest.approx([0.0, 1.0])
    assert np.diff(middles, axis=0) == pytest.approx(0.27, abs=0.06)  # three within a place


@pytest.mark.parametrize(("sizes", "across"), [((3, 2, 2), "z"), ((3, 1, 2), "y"), ((1, 2, 2), "x")])
def test_the_slice_of_a_map_lies_across_its_thinnest_axis_where_most_bends(sizes, across):
    places = np.stack(np.meshgrid(*map(np.arange, sizes), indexing="ij"), axis=-1).reshape(-1, 3)
    bends = [2e-3, *[1e-3] * (len(places) - 2), None]
    columns = {f"{axis} [m]": places[:, k].tolist() for k, axis in enumerate("xyz")}
    drawn = make_area_map(Sheet(columns | {"deflection [m]": bends}))
    k = "xyz".index(across)
    assert drawn.title == f"Deflection at {across} = 0 mm"
    assert len(drawn.values) == (places[:, k] == 0).sum()
    assert max(drawn.values) == 2e-3
