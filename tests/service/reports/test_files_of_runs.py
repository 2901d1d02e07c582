"""What stands in the files of a run: other units, gauges, secondary encoders, an arm with parallel axes."""

import csv
import io

import openpyxl
import pytest
from support.api import file_at
from support.cases import campaign as recorded
from support.documents import campaign
from support.pages import lines_of_page

SMALL = {"length": "mm", "angle": "deg", "force": "kN", "moment": "N.mm"}
CAMPAIGNS = {
    "units": lambda: campaign(configurations=6, units=SMALL),
    **{name: lambda name=name: recorded(name) for name in ("gauges", "encoders", "scara")},
}
PARTIAL = "k = 2, partial"
ONLY_TOGETHER = (
    "only a combination of joint_3, joint_4 is observable, c(joint_3) + c(joint_4): add postures in which "
    "their axes differ"
)


@pytest.fixture(scope="module")
def runs(local):
    body = {name: make() | {"run": {"elasticity": "joints"}} for name, make in CAMPAIGNS.items()}
    return {name: local.request("POST", "/v1/campaigns", json=each).json() for name, each in body.items()}


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        (
            "units",
            [
                "joint_1 | 3.813 | 0.049 | 0.099 | 3.719 … 3.912 | use |",
                "joint_6 | 0.074 | 0.017 | 0.034 | 0.051 … 0.134 | use |",
                "98.9 %",
                "37.1 µm",
                "20 µm (given)",
                "X | 0.000508 | -0.000195 | -0.000994 | 0.000027 |",
                "Z | -0.000994 | -0.000049 | 0.002518 | 0.000063 |",
                "readings | B | 0.65 | 0.75 | 1.2 | 14 | 1.7 | 11 |",
                "assumed load point | B | 0.50 | 0.56 | 1.2 | 5.0 | 2.6 | 20 |",
                "combined, sources in the intervals | | 1.3 | 1.4 | 1.9 | 15 | 3.3 | 23 |",
            ],
        ),
        (
            "gauges",
            [
                "joint_1 | 1.393 | 0.018 | 0.036 | 1.359 … 1.430 | use |",
                "joint_6 | 0.1015 | 0.0070 | 0.014 | 0.0895 … 0.1173 | use |",
                "3.64 µm",
                "3 µm (given)",
                "X | 0.000885 | 0.000239 | -0.000444 | 0.000033 |",
                "readings | B | 0.11 | 0.22 | 0.38 | 1.3 | 0.24 | 0.59 |",
                "assumed load point | B | 0.83 | 1.00 | 2.9 | 5.3 | 4.2 | 6.8 |",
                "expanded, all sources, k = 2 | | 2.6 | 2.9 | 6.3 | 11 | 8.7 | 14 |",
                "turn 0.5, constant force 0.8, shift 1, load point 1, load zero 1, play 1, shift since "
                "c017 1, "
                "turn since c007 1, load scale since c008 1",
            ],
        ),
        (
            "encoders",
            [
                "joint_1 | 1.393 | 0.016 | 0.033 | 1.362 … 1.426 | use |",
                "joint_4 | 0.403 | 0.025 | 0.051 | 0.359 … 0.460 | use |",
                "96.6 %",
                "49.5 µm",
                "X | 0.00089 | 0.00024 | -0.00045 | 0.00042 |",
                "readings | B | 0.084 | 0.19 | 0.29 | 4.9 | 0.92 | 2.4 |",
                "combined, all sources | | 1.2 | 1.1 | 1.3 | 6.3 | 4.4 | 8.5 |",
            ],
        ),
        (
            "scara",
            [
                "joint_1 | 1.67 | 0.12 | 0.25 | 1.46 … 1.95 | use |",
                "joint_2 | 1.23 | 0.21 | 0.42 | 0.92 … 1.84 | use |",
                "joint_3 | — | — | — | — | not observable |",
                f"– joint_4: no number: {ONLY_TOGETHER}.",
                "59.4 %",
                "X | 0.000306 | 0.000264 | 0.000000 | 0.000032 |",
                "Z | 0 | 0 | 0 | 0 |",
                "readings | B | 7.0 | 17 |",
                "expanded, all sources, k = 2 | | 15 | 34 |",
                "0.1079 mm",
                "0.0438 mm",
                "400 N",
                "(20, -10, 150) mm",
                "– no target moved by more than 78.8 µm; the noise of a deflection is 28.3 µm (use; increase "
                "the load; check that the loaded readings were taken with the load applied, and check the "
                "stated noise)",
            ],
        ),
    ],
)
def test_the_report_states_numbers_compliance_and_budget(local, runs, name, lines):
    said = lines_of_page(local.get(file_at(runs[name], "report.html")).text)
    for line in lines:
        assert line in said
    has_partial = any("k = 2, partial | 95 % interval" in line for line in said)
    assert has_partial == (name in {"units", "gauges"})
    assert said[said.index("Verdict on the result") + 1] == "use"
    assert said[-1] == f"— End of report {runs[name]['id']} —"


@pytest.mark.parametrize(
    ("name", "verdicts", "explains"),
    [
        (
            "units",
            ["well determined"] * 3 + ["roughly known", "determined", "roughly known"],
            "explains 98.9 % of the mean deflection, residual 37.1 µm rms (3-D), sigma of a reading 20 µm "
            "(given)",
        ),
        (
            "gauges",
            ["well determined"] * 2 + ["determined"] * 4,
            "explains 99.5 % of the mean deflection, residual 3.64 µm rms (3-D), sigma of a reading 3 µm "
            "(given)",
        ),
    ],
)
def test_tables_have_the_verdict_of_each_joint(local, runs, name, verdicts, explains):
    found = local.get(file_at(runs[name], "tables.json")).json()
    (table,) = found["tables"]
    assert [row[-1] for row in table["rows"]] == verdicts
    assert found["lines"] == [explains]
    assert (found["assessment"]["verdict"], found["assessment"]["joints_identified"]) == ("use", 6)


def rows_of(answer):
    return list(csv.reader(answer.text.splitlines()))


def test_joints_and_residuals_are_in_si_whatever_was_posted(local, runs):
    _, *joints = rows_of(local.get(file_at(runs["units"], "joints.csv")))
    numbers = [
        [3.81321e6, 3.71893e6, 3.91239e6, 2.62246e-7, 3.39208e-9, 2.55598e-7, 2.68895e-7],
        [3.12184e6, 3.04033e6, 3.20784e6, 3.20324e-7, 4.3814e-9, 3.11737e-7, 3.28911e-7],
    ]
    for row, expected in zip(joints, numbers, strict=False):
        assert list(map(float, row[3:10])) == pytest.approx(expected, rel=1e-4)
    head, *residuals = rows_of(local.get(file_at(runs["units"], "residuals.csv")))
    assert head[2] == "deflection x [m]"
    assert len(residuals) == 6 * 3
    first = [-4.69e-5, 0.0028761, -9.79e-5, 4.19689e-6, 3.52371e-5, 2.83069e-5]
    assert list(map(float, residuals[0][2:8])) == pytest.approx(first, rel=1e-3)
    set_id = runs["units"]["request"]["measurement_set_id"]
    stored = local.get(f"/v1/measurement-sets/{set_id}").json()
    assert (stored["units"], stored["noise"]["sigma"]) == (SMALL, 0.02)
    assert stored["load_point"] == [-60.0, 20.0, 180.0]
    observation = stored["observations"][0]
    assert observation["force"] == pytest.approx([0.5865, 1.366, 0.2], rel=1e-3)
    assert observation["joints"][:3] == pytest.approx([2.1257, 39.775, -48.466], rel=1e-4)
    assert observation["readings"][0]["loaded"] == pytest.approx([2652.5, 115.06, 1830.5], rel=1e-4)


def test_a_gauge_has_a_residual_along_its_direction_alone(local, runs):
    _, *rows = rows_of(local.get(file_at(runs["gauges"], "residuals.csv")))
    assert [row[1] for row in rows[:3]] == ["gauge x", "gauge y", "gauge z"]
    assert list(map(float, rows[0][2:8])) == pytest.approx([-0.000916986, 0, 0, 2.63155e-6, 0, 0], rel=1e-3)
    assert list(map(float, rows[1][2:8])) == pytest.approx([0, -0.00133291, 0, 0, -1.22776e-6, 0], rel=1e-3)


def test_the_workbook_says_of_joints_without_a_number_why_and_lists_warnings(local, runs):
    book = openpyxl.load_workbook(io.BytesIO(local.get(file_at(runs["scara"], "model.xlsx")).content))
    assert book.sheetnames == ["joints", "kinematics", "provenance", "warnings"]
    rows = {
        sheet.title: [[cell.value for cell in row if cell.value is not None] for row in sheet.rows]
        for sheet in book
    }
    assert rows["joints"][3][:4] == ["joint_3", "not_observable", "do_not_use", ONLY_TOGETHER]
    numbers = [1.67038e6, 1.45932e6, 1.95281e6, 1.48958e6, 5.98665e-7, 4.41762e-8]
    assert rows["joints"][1][3:9] == pytest.approx(numbers, rel=1e-4)
    assert rows["kinematics"][2][:6] == ["joint_2", "revolute", "link_2", 0.45, 0, 0]
    assert rows["kinematics"][-1][:6] == ["jf", "fixed", "flange", pytest.approx(0.05), 0, -0.1]
    assert ["Verdict on the result: use."] in rows["provenance"]
    assert rows["provenance"][-3][0] == "compensation [1]"
    assert rows["provenance"][-3][1] == pytest.approx(0.59404, rel=1e-4)
    assert rows["provenance"][-1] == [
        "standard uncertainty of a coordinate of a reading [m]",
        pytest.approx(2e-5),
    ]
    assert [row[:3] for row in rows["warnings"][1:]] == [
        ["deflection_below_noise", "use", f"observations[{i}] 'c{i + 1:03}'"] for i in (2, 12, 13)
    ]


def test_a_spring_stands_for_each_joint_with_a_number(local, runs):
    text = local.get(file_at(runs["units"], "model.mjcf")).text
    for line in [
        "<!-- Verdict on the result: use. -->",
        "<!-- joint_4: 0.407 · 10⁶ N·m/rad (95 % interval 0.315 … 0.577); verdict: use -->",
        '<joint name="joint_1" type="hinge" axis="0.0 0.0 1.0" range="-3.14159',
        '<body name="link_2" pos="0.33 0.0 0.78"',
    ]:
        assert line in text
    counts = [local.get(file_at(runs[name], "model.mjcf")).text.count("<position ") for name in CAMPAIGNS]
    assert counts == [6, 6, 6, 2]
