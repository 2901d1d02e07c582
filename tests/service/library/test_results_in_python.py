"""What results say of themselves in Python, the files that they are saved to, and what is refused."""

import csv
import re
from pathlib import Path

import matplotlib.image
import numpy as np
import openpyxl
import pytest
from support.command_lines import assert_said
from support.guide_files import EXAMPLES
from support.rows import rows_of

import jointstiff as js
from jointstiff.service.kinds.gearbox.kind import GEARBOX
from jointstiff.service.kinds.rooms import ROOMS
from jointstiff.service.kinds.run.kind import ASSUMPTIONS
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.mechanics.measurements import ASSUMED_FORCE_SCALE, ASSUMED_LOAD_POINT

USE_OF = "no fault was found; all 6 joints of its run passed the checks"
FORCE = (0, 0, -500.0)


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(default_arm(), load="pull", configurations=12, seed=3)


@pytest.fixture(scope="module")
def run(document):
    return js.identify(document)


@pytest.fixture(scope="module")
def results(run, document):
    area = [[1400, -200, 600], [1800, 200, 600]]
    postures = [[0, 0, 0, 0, 30, 0], [10, 0, 0, 0, 30, 0]]
    return {
        "run": run,
        "gearbox": js.gearbox(GEARBOX.examples["weighed load"]),
        "comparison": js.compare(run),
        "geometry": js.geometry(EXAMPLES / "sweeps.json"),
        "plan": js.plan(run, readings=4, candidates=200),
        "map": js.map(run, area=area, grid=(3, 3, 1), place=(0, 0, 250), force=FORCE),
        "program": js.correct(run, EXAMPLES / "pocket.src", accuracy_option="off", force=FORCE),
        "prediction": run.predict(postures, FORCE, at=(0, 0, 120)),
    }


@pytest.mark.parametrize(
    ("name", "headline"),
    [
        ("run", "Use: all 6 joints passed the checks"),
        ("comparison", "Use this comparison with care: 2 reasons of its run"),
        ("geometry", "Use: the checks found no fault"),
        ("plan", f"Use this plan: {USE_OF}"),
        ("map", f"Use this map: {USE_OF}"),
        ("program", f"Use this program: {USE_OF}"),
        ("prediction", f"Use this prediction: {USE_OF}"),
    ],
)
def test_a_result_shows_its_verdict_first(results, name, headline):
    result = results[name]
    shown = "" if name == "prediction" else f" {result.id[:8]}, succeeded"
    kind = "CorrectionJob" if name == "program" else name.capitalize()
    assert repr(result) == f"<{kind}{shown}: {headline}>"
    assert result.summary().startswith(headline)
    assert str(result).startswith(headline)


@pytest.mark.parametrize(
    ("name", "sentences"),
    [
        (
            "run",
            [
                "│ joint_1 │ 3.768 │ 3.677 … 3.864 │ well determined │",
                "│ joint_6 │ 0.0837 │ 0.0698 … 0.0982 │ determined │",
            ],
        ),
        (
            "map",
            [
                "all 9 places reached deflection: median 574.9 µm, 90 % of the places 500.9 to 666.1 µm, "
                "greatest 666.1 µm",
                "│ place [mm] │ 1800 -200 600 │ 1400 0 600 │",
                "│ deflection [µm] │ 666.1 (651.2 … 681.0) │ 499.2 (486.9 … 511.5) │",
            ],
        ),
        (
            "program",
            [
                "4 of 4 targets are corrected",
                "1.049 (1.022 … 1.075) 1.056 (1.030 … 1.083) 1.056 (1.030 … 1.083)",
                "│ displacement of targets │ 1.0495 │ 1.0569 │ 1.0570 │",
                "│ 3 │ │ 7 │ 1.056 (1.030 … 1.083) │ 0.000 (0.000 … 0.028) │ unknown │",
                "│ 1 │ │ 5 │ 1.041 (1.015 … 1.068) │ 0.000 (0.000 … 0.028) │ unknown │",
            ],
        ),
        (
            "prediction",
            [
                "1 0.1083 (0.1013 … 0.1153)",
                "2 0.1067 (0.0998 … 0.1136) 0.0188 (0.0176 … 0.0200) -1.147 (-1.176 … -1.119)",
                "2 435.9 (425.4 … 446.9)",
                "in brackets: 95 % interval, model error unknown; stiffness along the force",
            ],
        ),
    ],
)
def test_a_printed_result_has_its_numbers(results, name, sentences):
    assert_said(" ".join(str(results[name]).split()), *sentences)


KINDS = ("run", "comparison", "geometry", "plan", "map", "program", "gearbox")
"""Every kind of work."""


def test_the_kinds_of_these_tests_are_all_kinds():
    assert {kind.replace("program", "correction") for kind in KINDS} == {*ROOMS}


def test_the_first_screen_of_a_run_is_verdict_table_and_one_line(run):
    verdict, *table, assumed = run.summary().splitlines()
    assert verdict == "Use: all 6 joints passed the checks"
    assert {line[0] for line in table if line.strip()} <= set("┏┃┡│└ s"), "the table alone"
    assert assumed == "  assumed: load point ± 10 mm, force ± 1 %; run.details()"
    assert_said(
        " ".join(run.details().split()),
        "explains 98.2 % of the mean deflection, residual 47.4 µm rms (3-D), sigma of a reading 20 µm "
        "(given)",
        "The model has elastic joints alone: no test shows that other parts bend (F test of links added to "
        "the joints: p = 0.5).",
        "The load point is assumed to be known to ±10 mm.",
        "Each posture was read only once without load",
        "observability O1",
    )


def test_what_is_assumed_is_what_the_solver_assumes():
    assert {
        "assumed_load_point": f"load point ± {1e3 * ASSUMED_LOAD_POINT:g} mm",
        "assumed_force_scale": f"force ± {100 * ASSUMED_FORCE_SCALE:g} %",
    } == ASSUMPTIONS


@pytest.mark.parametrize("name", [*KINDS, "prediction"])
def test_every_kind_has_the_common_names(results, name, tmp_path):
    result = results[name]
    assert result.summary() == str(result) == repr(result.summary())
    assert any(character.isdigit() for character in result.summary())
    assert result.to_latex().startswith(r"\begin{t")
    assert len(result.to_frame()) >= 1
    with pytest.raises(ValueError, match="omit `dpi`"):
        result.save(tmp_path / "plot.svg", dpi=300)
    assert result.plot(dpi=72).get_dpi() == 72
    sizes = []
    for dpi in (60, 120):
        result.save(tmp_path / "plot.png", dpi=dpi)
        sizes.append(matplotlib.image.imread(tmp_path / "plot.png").shape[:2])
    assert sizes[1] == pytest.approx([2 * size for size in sizes[0]], abs=2)


@pytest.mark.parametrize("name", KINDS)
def test_every_job_has_details_and_its_options(results, name):
    result = results[name]
    assert result.details().split("\n")[0] == result.summary().split("\n")[0]
    options = result.get_params()
    assert options
    assert options.items() <= dict(result.request).items()


def test_a_run_has_the_names_of_statsmodels(run, document):
    assert run.params == pytest.approx(1.0 / run.stiffness)
    assert run.bse == pytest.approx(np.sqrt(np.diag(run.cov_params())))
    assert run.conf_int().mean(axis=1) == pytest.approx(run.params, rel=0.05)
    assert 1.0 / run.conf_int()[:, ::-1] == pytest.approx(run.conf_int("stiffness"))
    readings = [each for one in document["measurement_set"]["observations"] for each in one["readings"]]
    assert run.nobs == len(run.resid) == len(readings)
    measured = np.array([[each["loaded"], each["unloaded"]] for each in readings])
    deflection = measured[:, 0] - measured[:, 1]
    factor = np.linalg.norm(run.resid + run.fittedvalues) / np.linalg.norm(deflection)
    assert run.resid + run.fittedvalues == pytest.approx(factor * deflection, abs=1e-9)
    assert run.rsquared == pytest.approx(1.0 - np.sum(run.resid**2) / np.sum((factor * deflection) ** 2))
    again = js.identify(document, js.RunOptions(**run.get_params()))
    assert again.params.tolist() == run.params.tolist()


TABLES = {
    "run": ["joints", "residuals"],
    "comparison": ["table", "ratios", "configurations"],
    "geometry": ["axes"],
    "plan": ["readings"],
    "map": ["map"],
    "program": ["rows"],
    "prediction": ["cases"],
}


@pytest.mark.parametrize("name", TABLES)
def test_a_result_is_saved_by_the_ending_of_its_file(results, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = results[name]
    for ending in ("json", "csv", "xlsx"):
        result.save(f"{name}.{ending}")
    sheets = openpyxl.load_workbook(f"{name}.xlsx")
    assert sheets.sheetnames == TABLES[name]
    assert {sheet.freeze_panes for sheet in sheets} == {"B2"}
    lines = list(csv.reader(Path(f"{name}.csv").read_text().splitlines()))
    head, *rows = sheets.worksheets[0].iter_rows(values_only=True)
    assert list(head) == lines[0]
    assert head[-1] == "overall verdict"
    verdict = "use_with_care" if name == "comparison" else "use"  # joints of one side are poorly known
    assert [row[-1] for row in rows] == [verdict] * (len(lines) - 1)
    assert len(result.to_frame()) == len(rows)
    with pytest.raises(
        ValueError, match=f"the result has no table 'nothing': its tables are {', '.join(TABLES[name])}"
    ):
        result.to_frame("nothing")


@pytest.mark.parametrize("name", [name for name in TABLES if name != "program"])
def test_another_ending_is_refused_but_of_a_program_which_has_its_own(results, name):
    said = re.escape(f"'{name}.docx' must end in .json, .csv, .xlsx, .svg")
    with pytest.raises(ValueError, match=said):
        results[name].save(f"{name}.docx")


@pytest.mark.parametrize(("place", "cells"), rows_of(__file__, "saved.txt"))
def test_a_saved_row_has_numbers_in_the_units_of_their_headers(results, place, cells, tmp_path):
    name, first = place.split()
    results[name].save(tmp_path / "x.csv")
    head, *rows = csv.reader((tmp_path / "x.csv").read_text().splitlines())
    row = dict(zip(head, next(each for each in rows if each[0] == first), strict=True))
    numbers = dict(cell.split(" = ") for cell in cells.split("; "))
    expected = {header: float(number) for header, number in numbers.items()}
    assert {header: float(row[header]) for header in numbers} == pytest.approx(expected, rel=1e-4)


def test_residuals_and_configurations_are_tables_of_their_own(results):
    residuals = results["run"].to_frame("residuals")
    assert len(residuals) == 36
    first = residuals.iloc[0]
    assert [first[f"deflection {axis} [m]"] for axis in "xyz"] == pytest.approx(
        [0.000163, -0.0013511, -0.003557]
    )
    assert first["residual x [m]"] == pytest.approx(5.2305e-5, rel=1e-3)
    left = results["comparison"].to_frame("configurations")
    assert len(left) == 8 * 12
    first = left.iloc[0]
    assert (first["deflection [m]"], first["left [m]"]) == pytest.approx((0.0038258, 4.9291e-5), rel=1e-3)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda _, __: js.identify({}), "2 faults; first: robot: required field is missing"),
        (
            lambda _, document: js.identify(document, method="magic"),
            "1 fault; first: method: must be 'complete_pose', 'partial_pose' or 'decoupled_partial_pose'; "
            "remedy: use one of these words exactly as written",
        ),
        (
            lambda _, document: js.identify(document, colour=1),
            "1 fault; first: colour: unknown field; remedy: remove this field, or check its spelling",
        ),
        (
            lambda run, _: js.map(run),
            "4 faults; first: area: required field is missing; remedy: add this field",
        ),
        (
            lambda _, __: js.plan("no arm", readings=3),
            "robot: there is no file 'no arm', and the catalogue has no arm 'no arm'; remedy: ",
        ),
        (
            lambda run, _: run.predict([[0.0] * 6], FORCE, at=(0, 0, 120e3)),
            "prediction.load_point: the point is 120 m from the flange, where no tool reaches; up to "
            "5 m is plausible; remedy: check the unit of the point; for a longer tool, ",
        ),
        (
            lambda run, _: run.predict([[0] * 5], FORCE, at=(0, 0, 100)),
            "prediction.cases[0].joints: there are 5 joint angles, but the robot has 6 joints; remedy: "
            "give the 6 controller angles of joint_1, joint_2, joint_3, joint_4, joint_5, joint_6",
        ),
        (
            lambda run, _: run.apply("dance"),
            "apply: the assessment does not recommend 'dance'; remedy: no reason offers an action: follow "
            "the remedies",
        ),
    ],
)
def test_what_does_not_fit_is_a_campaign_error_with_a_remedy(run, document, call, said):
    with pytest.raises(js.CampaignError) as refused:
        call(run, document)
    assert str(refused.value).startswith(said)


def test_each_column_of_numbers_names_its_unit(results):
    for kind, result in results.items():
        tables = {name: make().columns for name, make in result._sheets().items()}
        bare = [
            (kind, name, head)
            for name, columns in tables.items()
            for head, values in columns.items()
            if any(isinstance(each, float) and each % 1 for each in values) and not head.endswith("]")
        ]
        assert not bare


def test_what_is_not_there_is_the_error_of_python(run):
    with pytest.raises(KeyError, match="the robot has no joint 'joint_9': its joints are joint_1, joint_2"):
        run.joints["joint_9"]
    with pytest.raises(FileNotFoundError, match=r"nowhere\.json"):
        js.identify("nowhere.json")
    with pytest.raises(ValueError, match=r"a run has these tables: .*csv"):
        run.table("docx")


def test_a_posture_in_radians_is_predicted_as_such(run):
    prediction = run.predict([[0.1] * 6], FORCE, at=(0, 0, 0.1), units="m, rad, N")
    words = " ".join(str(prediction).split())
    assert "1 0.0640 (0.0582 … 0.0698) -0.0154 (-0.0169 … -0.0139) -1.221 (-1.251 … -1.191)" in words
    assert "1 409.6 (399.9 … 419.9)" in words


def test_a_job_equals_itself_alone_and_its_copy(run, document, results):
    others = (js.identify(document), results["plan"], dict(run), 5)
    assert run == run.model_copy()
    assert [run == other for other in others] == [False] * 4
