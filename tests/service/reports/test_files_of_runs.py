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
    "the axes of these joints differ"
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
                "joint_1 | 3.817 | 3.724 … 3.916 | use |",
                "joint_6 | 0.0736 | 0.0560 … 0.0995 | use |",
                "98.9 %",
                "37 µm",
                "20 µm (given)",
                "X | 0.0005078 (0.0004950 … 0.0005206) | -0.0001943 (-0.0002009 … -0.0001877) | "
                "-0.000994 (-0.001017 … -0.000970) | unknown |",
                "Z | -0.000994 (-0.001018 … -0.000970) | -0.0000485 (-0.0000498 … -0.0000471) | "
                "0.002515 (0.002456 … 0.002574) | unknown |",
                "readings | B | 0.76 | 0.84 | 1.3 | 16 | 2.0 | 14 |",
                "assumed load point | B | 0.28 | 0.33 | 0.65 | 3.3 | 2.3 | 5.5 |",
                "combined, only sources that the intervals include | | 1.3 | 1.3 | 1.8 | 16 | 3.2 | 15 |",
            ],
        ),
        (
            "gauges",
            [
                "joint_1 | 1.394 | 1.366 … 1.422 | use |",
                "joint_6 | 0.1021 | 0.0995 … 0.1048 | use |",
                "3.61 µm",
                "3 µm (given)",
                "X | 0.0008842 (0.0008665 … 0.0009019) | 0.0002380 (0.0002328 … 0.0002433) | "
                "-0.0004435 (-0.0004525 … -0.0004346) | unknown |",
                "readings | B | 0.15 | 0.25 | 0.50 | 1.6 | 0.93 | 0.90 |",
                "assumed load point | B | 0.020 | 0.020 | 0.063 | 0.19 | 0.21 | 0.11 |",
                "expanded, partial, k = 2 | | 2.0 | 2.1 | 2.2 | 3.8 | 2.8 | 2.7 |",
                "turn 0.5, tool 0.7, constant force 0.8, shift 1, curved springs 1, play 1, load point 1, "
                "load zero 1, hook weight 1, growth 1, growth over time 1, shift since c017 1, "
                "turn since c007 1, load scale since c008 1, stiffness since c005 1",
            ],
        ),
        (
            "encoders",
            [
                "joint_1 | 1.394 | 1.366 … 1.422 | use |",
                "joint_4 | 0.405 | 0.368 … 0.450 | use |",
                "96.6 %",
                "49.4 µm",
                "X | 0.00089 (0.00046 … 0.00132) | 0.00024 (-0.00019 … 0.00067) | "
                "-0.00045 (-0.00088 … -0.00002) | included |",
                "readings | B | 0.17 | 0.23 | 0.34 | 5.1 | 1.3 | 2.6 |",
                "combined, all sources | | 1.0 | 1.0 | 1.1 | 5.2 | 1.7 | 2.8 |",
            ],
        ),
        (
            "scara",
            [
                "joint_1 | 1.64 | 1.43 … 1.93 | use |",
                "joint_2 | 1.26 | 0.93 … 1.94 | use |",
                "joint_3 | — | — | not observable |",
                f"– joint_4: no number: {ONLY_TOGETHER}.",
                "59.6 %",
                "X | 0.000309 (0.000283 … 0.000334) | 0.000266 (0.000244 … 0.000288) | "
                "0.00000000 (0.00000000 … 0.00000000) | unknown |",
                "Z | 0 (0 … 0) | 0 (0 … 0) | 0 (0 … 0) | unknown |",
                "readings | B | 7.3 | 18 |",
                "expanded, all sources, k = 2 | | 15 | 36 |",
                "0.1079 mm",
                "0.04364 mm",
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
    has_partial = any(line.startswith("expanded, partial, k = 2 |") for line in said)
    assert has_partial == (name in {"units", "gauges"})
    assert said[said.index("Verdict on the result") + 1] == "use"
    assert said[-1] == f"— End of report {runs[name]['id']} —"


@pytest.mark.parametrize(
    ("name", "verdicts", "explains"),
    [
        (
            "units",
            ["well determined"] * 3 + ["roughly known", "determined", "roughly known"],
            "explains 98.9 % of the mean deflection, residual 37 µm rms (3-D), sigma of a reading 20 µm "
            "(given)",
        ),
        (
            "gauges",
            ["well determined"] * 6,
            "explains 99.5 % of the mean deflection, residual 3.61 µm rms (3-D), sigma of a reading 3 µm "
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
        [3.81754e6, 3.72361e6, 3.91597e6, 2.61949e-7, 3.36536e-9, 2.55365e-7, 2.68557e-7],
        [3.12166e6, 3.04142e6, 3.20670e6, 3.20342e-7, 4.323e-9, 3.11847e-7, 3.28794e-7],
    ]
    for row, expected in zip(joints, numbers, strict=False):
        assert list(map(float, row[3:10])) == pytest.approx(expected, rel=1e-4)
    head, *residuals = rows_of(local.get(file_at(runs["units"], "residuals.csv")))
    assert head[2] == "deflection x [m]"
    assert len(residuals) == 6 * 3
    first = [-4.69e-5, 0.0028761, -9.79e-5, 3.95593e-6, 3.58938e-5, 2.79890e-5]
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
    assert list(map(float, rows[0][2:8])) == pytest.approx([-0.000916986, 0, 0, 2.11131e-6, 0, 0], rel=1e-3)
    assert list(map(float, rows[1][2:8])) == pytest.approx([0, -0.00133291, 0, 0, -8.31178e-7, 0], rel=1e-3)


def test_the_workbook_says_of_joints_without_a_number_why_and_lists_warnings(local, runs):
    book = openpyxl.load_workbook(io.BytesIO(local.get(file_at(runs["scara"], "model.xlsx")).content))
    assert book.sheetnames == ["joints", "kinematics", "provenance", "warnings"]
    rows = {
        sheet.title: [[cell.value for cell in row if cell.value is not None] for row in sheet.rows]
        for sheet in book
    }
    assert rows["joints"][3][:4] == ["joint_3", "not_observable", "do_not_use", ONLY_TOGETHER]
    numbers = [1.6438e6, 1.43294e6, 1.9274e6, 1.4631e6, 6.08352e-7, 4.56711e-8]
    assert rows["joints"][1][3:9] == pytest.approx(numbers, rel=1e-4)
    assert rows["kinematics"][2][:6] == ["joint_2", "revolute", "link_2", 0.45, 0, 0]
    assert rows["kinematics"][-1][:6] == ["jf", "fixed", "flange", pytest.approx(0.05), 0, -0.1]
    assert ["Verdict on the result: use."] in rows["provenance"]
    assert rows["provenance"][-3][0] == "compensation [1]"
    assert rows["provenance"][-3][1] == pytest.approx(0.59554, rel=1e-4)
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
        "<!-- joint_4: 0.411 · 10⁶ N·m/rad (95 % interval 0.313 … 0.593); verdict: use -->",
        '<joint name="joint_1" type="hinge" axis="0.0 0.0 1.0" range="-3.14159',
        '<body name="link_2" pos="0.33 0.0 0.78"',
    ]:
        assert line in text
    counts = [local.get(file_at(runs[name], "model.mjcf")).text.count("<position ") for name in CAMPAIGNS]
    assert counts == [6, 6, 6, 2]
