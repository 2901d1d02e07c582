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
                "joint_6 | 0.0736 | 0.0560 … 0.0994 | use with care |",
                "98.9 %",
                "37 µm",
                "20 µm (given)",
                "X | 0.0005078 (0.0004950 … 0.0005205) | -0.0001943 (-0.0002009 … -0.0001877) | "
                "-0.000994 (-0.001017 … -0.000970) | unknown |",
                "Z | -0.000994 (-0.001018 … -0.000970) | -0.0000484 (-0.0000498 … -0.0000471) | "
                "0.002515 (0.002456 … 0.002574) | unknown |",
                "readings | B | 0.75 | 0.84 | 1.3 | 15 | 2.0 | 14 |",
                "assumed load point | B | 0.28 | 0.33 | 0.65 | 3.3 | 2.3 | 5.4 |",
                "combined, only sources that the intervals include | | 1.3 | 1.3 | 1.8 | 16 | 3.2 | 15 |",
            ],
        ),
        (
            "gauges",
            [
                "joint_1 | 1.393 | 1.366 … 1.422 | use |",
                "joint_6 | 0.1021 | 0.0996 … 0.1047 | use |",
                "3.61 µm",
                "3 µm (given)",
                "X | 0.0008841 (0.0008664 … 0.0009017) | 0.0002379 (0.0002328 … 0.0002431) | "
                "-0.0004435 (-0.0004524 … -0.0004346) | unknown |",
                "readings | B | 0.13 | 0.22 | 0.44 | 1.4 | 0.81 | 0.78 |",
                "assumed load point | B | 0.015 | 0.016 | 0.047 | 0.14 | 0.16 | 0.088 |",
                "expanded, partial, k = 2 | | 2.0 | 2.0 | 2.2 | 3.5 | 2.6 | 2.5 |",
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
                "joint_2 | 1.25 | 0.93 … 1.94 | use with care |",
                "joint_3 | — | — | not observable |",
                f"– joint_4: no number: {ONLY_TOGETHER}.",
                "59.6 %",
                "X | 0.000309 (0.000284 … 0.000333) | 0.000266 (0.000244 … 0.000288) | "
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
    verdict = "use with care" if name in {"units", "scara"} else "use"
    assert said[said.index("Verdict on the result") + 1] == verdict
    assert said[-1] == f"— End of report {runs[name]['id']} —"


@pytest.mark.parametrize(
    ("name", "verdicts", "explains", "assessed"),
    [
        (
            "units",
            ["well determined"] * 3 + ["use with care", "determined", "use with care"],
            "explains 98.9 % of the mean deflection, residual 37 µm rms (3-D), sigma of a reading 20 µm "
            "(given)",
            ("use_with_care", 4),
        ),
        (
            "gauges",
            ["well determined"] * 6,
            "explains 99.5 % of the mean deflection, residual 3.61 µm rms (3-D), sigma of a reading 3 µm "
            "(given), repeatability 3.54 µm at the targets (1.1 µrad a joint, estimated)",
            ("use", 6),
        ),
    ],
)
def test_tables_have_the_verdict_of_each_joint(local, runs, name, verdicts, explains, assessed):
    found = local.get(file_at(runs[name], "tables.json")).json()
    (table,) = found["tables"]
    assert [row[-1] for row in table["rows"]] == verdicts
    assert found["lines"] == [explains]
    assert (found["assessment"]["verdict"], found["assessment"]["joints_identified"]) == assessed


def rows_of(answer):
    return list(csv.reader(answer.text.splitlines()))


def test_joints_and_residuals_are_in_si_whatever_was_posted(local, runs):
    _, *joints = rows_of(local.get(file_at(runs["units"], "joints.csv")))
    numbers = [
        [3.81733e6, 3.72381e6, 3.91566e6, 2.61963e-7, 3.35642e-9, 2.55385e-7, 2.68542e-7],
        [3.12196e6, 3.04176e6, 3.20651e6, 3.20311e-7, 4.30930e-9, 3.11865e-7, 3.28757e-7],
    ]
    for row, expected in zip(joints, numbers, strict=False):
        assert list(map(float, row[3:10])) == pytest.approx(expected, rel=1e-4)
    head, *residuals = rows_of(local.get(file_at(runs["units"], "residuals.csv")))
    assert head[2] == "deflection x [m]"
    assert len(residuals) == 6 * 3
    first = [-4.69e-5, 0.0028761, -9.79e-5, 3.95645e-6, 3.58935e-5, 2.79655e-5]
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
    assert list(map(float, rows[0][2:8])) == pytest.approx([-0.000916986, 0, 0, 1.87081e-6, 0, 0], rel=1e-3)
    assert list(map(float, rows[1][2:8])) == pytest.approx([0, -0.00133291, 0, 0, -8.82915e-7, 0], rel=1e-3)


def test_the_workbook_says_of_joints_without_a_number_why_and_lists_warnings(local, runs):
    book = openpyxl.load_workbook(io.BytesIO(local.get(file_at(runs["scara"], "model.xlsx")).content))
    assert book.sheetnames == ["joints", "kinematics", "provenance", "warnings"]
    rows = {
        sheet.title: [[cell.value for cell in row if cell.value is not None] for row in sheet.rows]
        for sheet in book
    }
    assert rows["joints"][3][:4] == ["joint_3", "not_observable", "do_not_use", ONLY_TOGETHER]
    numbers = [1.64421e6, 1.43391e6, 1.92678e6, 1.46402e6, 6.08196e-7, 4.55090e-8]
    assert rows["joints"][1][3:9] == pytest.approx(numbers, rel=1e-4)
    assert rows["kinematics"][2][:6] == ["joint_2", "revolute", "link_2", 0.45, 0, 0]
    assert rows["kinematics"][-1][:6] == ["jf", "fixed", "flange", pytest.approx(0.05), 0, -0.1]
    assert ["Verdict on the result: use with care."] in rows["provenance"]
    assert rows["provenance"][-3][0] == "compensation [1]"
    assert rows["provenance"][-3][1] == pytest.approx(0.59554, rel=1e-4)
    assert rows["provenance"][-1] == [
        "standard uncertainty of a coordinate of a reading [m]",
        pytest.approx(2e-5),
    ]
    assert [row[:3] for row in rows["warnings"][1:]] == [
        ["joint_poorly_known", "use_with_care", "joint_2"],
        *(["deflection_below_noise", "use", f"observations[{i}] 'c{i + 1:03}'"] for i in (2, 12, 13)),
    ]


def test_a_spring_stands_for_each_joint_with_a_number(local, runs):
    text = local.get(file_at(runs["units"], "model.mjcf")).text
    for line in [
        "<!-- Verdict on the result: use with care. -->",
        "<!-- joint_4: 0.411 · 10⁶ N·m/rad (95 % interval 0.313 … 0.591); verdict: use with care -->",
        '<joint name="joint_1" type="hinge" axis="0.0 0.0 1.0" range="-3.14159',
        '<body name="link_2" pos="0.33 0.0 0.78"',
    ]:
        assert line in text
    counts = [local.get(file_at(runs[name], "model.mjcf")).text.count("<position ") for name in CAMPAIGNS]
    assert counts == [6, 6, 6, 2]
