"""What each kind of job answers and what stands in its files: comparison, geometry, plan, map, program."""

import csv
import io
import re

import numpy as np
import pytest
from support.api import file_at
from support.documents import campaign
from support.kinds import posted_job
from support.pages import lines_of_page

from jointstiff.service.kinds.registry import KINDS

ALL_SIX = "no fault was found; all 6 joints of its run passed the checks"
BOUND = [
    "own weight is not included, because no masses are given",
    "no bound of the model error at 95 %: 19 postures are needed, but the campaign has only 12",
]


@pytest.fixture(scope="module")
def run(local):
    return local.request("POST", "/v1/campaigns", json=campaign()).json()


@pytest.fixture(scope="module")
def jobs(local, run):
    """A job of each kind that is reported, all of one run."""
    options = {"positive": False}
    other = local.request("POST", "/v1/campaigns", json=campaign() | {"run": options}).json()
    names = ("comparison", "geometry", "plan", "map", "correction")
    made = {name: posted_job(local, name, run, other["id"]) for name in names}
    assert {answer.status_code for answer in made.values()} == {201}
    return {"run": run, "other": other} | {name: answer.json() for name, answer in made.items()}


def rows_of(local, job, name):
    """Return the rows of a table without its head, which is the first of what is returned."""
    head, *rows = csv.reader(local.get(file_at(job, name)).text.splitlines())
    return head, rows


def report_of(local, job):
    return lines_of_page(local.get(file_at(job, "report.html")).text)


def tables_of(local, job):
    return local.get(file_at(job, "tables.json")).json()


def numbers(cells):
    return [float(cell) for cell in cells]


class TestComparison:
    def test_a_table_has_each_fit_beside_the_others(self, local, jobs):
        found = tables_of(local, jobs["comparison"])
        assert found["assessment"]["headline"] == f"Use this comparison: {ALL_SIX}"
        stiffness, whole = found["tables"]
        assert stiffness["title"] == "Stiffness in 10⁶ N·m/rad"
        assert stiffness["caption"] == (
            "PP: partial pose; free: unconstrained; ≥ 0: compliances zero or positive; in brackets: "
            "the interval"
        )
        values = [
            *("3.818 (3.734 … 3.905)", "3.116 (3.047 … 3.189)", "2.482 (2.410 … 2.560)"),
            *("0.444 (0.382 … 0.531)", "0.2458 (0.2338 … 0.2590)", "0.0925 (0.0768 … 0.1129)"),
        ]
        assert stiffness["rows"] == [
            row
            for i, value in enumerate(values, 1)
            for row in ([f"joint_{i}", "free", value], ["", "≥ 0", value])
        ]
        assert whole["head"] == ["fit", "explained", "rms [µm]", "condition"]
        assert whole["rows"] == [
            ["PP free", "98.7 %", "39", "2.88"],
            ["PP ≥ 0", "98.7 %", "39", "2.88"],
        ]

    def test_its_files_have_a_row_for_each_fit(self, local, jobs):
        _, joints = rows_of(local, jobs["comparison"], "table.csv")
        assert [row[3] for row in joints] == ["positive"] * 6 + ["unconstrained"] * 6
        assert {row[-1] for row in joints} == {"use"}
        expected = [0.987077, 3.87711e-5, 2.87995, 444332.9, 381851.9, 531261, 2.25057e-6, 1.87887e-7]
        assert numbers(joints[3][6:9] + joints[3][12:17]) == pytest.approx(expected, rel=1e-4)
        head, rows = rows_of(local, jobs["comparison"], "configurations.csv")
        assert head[4:] == ["configuration", "deflection [m]", "left [m]", "overall verdict"]
        assert [row[4] for row in rows] == [f"c{i:02}" for i in range(1, 13)] * 2
        assert numbers(rows[1][5:7]) == pytest.approx([0.000461212, 4.43434e-5], rel=1e-4)
        answer = local.get(file_at(jobs["comparison"], "ratios.csv"))
        assert (answer.status_code, answer.json()["detail"]) == (
            404,
            "this comparison has no rows for ratios.csv, the ratios of two sides",
        )
        ids = f"{jobs['run']['id']}; {jobs['other']['id']}"
        lines = report_of(local, jobs["comparison"])
        assert lines[lines.index("Run ids") + 1] == ids
        assert "joint_5 | free | 0.2458 (0.2338 … 0.2590) |" in lines
        assert f"– Use this comparison: {ALL_SIX}" in lines


class TestGeometry:
    def test_the_example_has_a_frame_targets_and_dh_tables_but_no_wrist(self, jobs):
        result = jobs["geometry"]["result"]
        transform = result["transform_tracker_to_base"]["translation"]
        assert transform == pytest.approx([-2.0336, 1.8853, -0.10006], rel=1e-4)
        assert result["targets"][0]["position"] == pytest.approx([-0.80003, 0.0, 0.099997], abs=1e-5)
        assert result["no_wrist"] == "a robot with 2 axes has no three-axis wrist"
        tables = [(each["convention"], len(each["rows"])) for each in result["dh"]]
        assert tables == [("standard", 2), ("modified", 2)]
        rows = result["dh"][0]["rows"]
        assert [rows[0]["a"], rows[0]["alpha"], rows[1]["theta"]] == pytest.approx(
            [0.30002, -np.pi / 2, np.pi], abs=1e-4
        )

    def test_its_tables_are_in_millimetres_and_its_file_in_metres(self, local, jobs):
        found = tables_of(local, jobs["geometry"])
        axes, sweeps, frame, targets = found["tables"]
        assert axes["title"] == "Axes at model angle zero, in R0"
        assert axes["head"] == ["axis", "x", "y", "z", "direction", "place [µm]", "turn [µrad]"]
        assert axes["rows"][1][:2] + axes["rows"][1][5:] == ["joint_2", "300.017", "± 37", "± 56"]
        assert sweeps["rows"][0] == ["joint_1", "120.0°", "4", "0.99995", "1.53", "8.76", "0.138"]
        assert [row[2] for row in frame["rows"]] == ["-2033.600", "1885.283", "-100.062"]
        assert frame["rows"][2][3:] == ["± 19", "± 56"]
        assert targets["rows"] == [
            ["P10", "-800.030 (-800.061 … -799.999)", "-0.005 (-0.032 … 0.021)", "99.997 (99.945 … 100.049)"]
        ]
        assert found["lines"][:3] == [
            "sigma of a coordinate 10.0 µm (stated), χ²/dof 1.13 with 5 degrees of freedom",
            "one robot model fits all sweeps (noise alone would give a worse fit with a probability of 80 %)",
            "the controller's angles fit the readings (noise alone would give a worse fit with a "
            "probability of 30 %)",
        ]
        head, rows = rows_of(local, jobs["geometry"], "axes.csv")
        assert head[1] == "point x [m]"
        assert head[-3:] == ["position uncertainty [m]", "direction uncertainty [rad]", "overall verdict"]
        assert numbers(rows[1][1:3]) == pytest.approx([0.300017, 0.099997], rel=1e-4)
        assert numbers(rows[1][7:9]) == pytest.approx([1.89356e-5, 2.8394e-5], rel=1e-3)


class TestPlan:
    def test_readings_uncertainties_and_certificate(self, local, jobs):
        result = jobs["plan"]["result"]
        assert result["assessment"]["headline"] == f"Use this plan: {ALL_SIX}"
        efficiencies = {"relative_a": 0.9378, "d": 0.98915}
        assert result["efficiencies"] == pytest.approx(efficiencies, rel=1e-3)
        assert [result["random_efficiency"], result["one_at_a_time_efficiency"]] == pytest.approx(
            [0.71435, 0.98228], rel=1e-3
        )
        assert (result["considered"], result["feasible"]) == (5000, 4999)
        assert result["struck_out"] == {"self_collision": 1}
        assert result["targets"]["P11"] == pytest.approx([-0.12801, 0.083992, 0.085002], abs=1e-5)
        found = tables_of(local, jobs["plan"])
        uncertainties, readings = found["tables"]
        assert uncertainties["rows"] == [
            ["joint_1", "± 0.84 %", "± 0.97 %"],
            ["joint_2", "± 1 %", "± 1.1 %"],
            ["joint_3", "± 1.7 %", "± 1.9 %"],
            ["joint_4", "± 5.5 %", "± 16 %"],
            ["joint_5", "± 2.1 %", "± 2.2 %"],
            ["joint_6", "± 11 %", "± 17 %"],
        ]
        assert [row[:7] for row in readings["rows"]] == [
            ["p1", "-153.0", "64.0", "-47.0", "30.0", "-91.0", "-11.0"],
            ["p2", "-157.0", "-6.0", "-89.0", "142.0", "81.0", "161.0"],
        ]
        assert found["lines"] == [
            "certified: the list gives at least 98.9 % of the information of the best possible list "
            "(criterion: volume of the uncertainty ellipsoid)",
            "4999 of 5000 readings were feasible; not feasible: self collision 1",
            "the list has only the new readings, but the predicted uncertainties also use the readings "
            "of the campaign so far: identify old and new readings together",
        ]

    def test_the_list_to_fill_in_and_the_page(self, local, jobs):
        head, rows = rows_of(local, jobs["plan"], "readings.csv")
        assert head[:2] == ["label", "joint_1 [deg]"]
        assert [row[0] for row in rows] == ["p1", "p2"]
        assert numbers(rows[0][7:13]) == [-725.1, 1153.0, 628.3, -60.0, 20.0, 180.0]
        assert all(cell == "" for cell in rows[0][14:32])
        lines = report_of(local, jobs["plan"])
        for line in [
            "joint_4 | ± 5.5 % | ± 16 % |",
            "Readings, in order; Readings v1, v2, … validate the model, and are not fitted. Targets: P10, "
            "P11, P12. Load point in the flange frame: -60, 20, 180 mm",
            "p1 | -153.0 | 64.0 | -47.0 | 30.0 | -91.0 | -11.0 | 1500 | x -0.48 y +0.77 z +0.42 | [ ] | "
            "[ ] |",
            "1500 N",
        ]:
            assert line in lines
        asked = {"Candidates": "5000", "Distinct angle": "10°", "Criterion": "d", "Validation": "0.2"}
        assert {name: lines[lines.index(name) + 1] for name in asked} == asked


class TestMap:
    def test_the_worst_and_the_stiffest_place(self, local, jobs):
        result = jobs["map"]["result"]
        assert (result["counts"]["reached"], sum(result["counts"].values())) == (4, 4)
        assert jobs["correction"]["result"]["remarks"] == BOUND
        worst, stiffest = result["worst"], result["stiffest"]
        assert (worst["position"], stiffest["position"]) == ([1.8, -0.2, 0.6], [1.4, 0.2, 0.6])
        lines = report_of(local, jobs["map"])
        for line in [
            "place [mm] | 1800 -200 600 | 1400 200 600 |",
            "controller's angles [°] | -6.3 20.7 16.1 0.0 53.2 -173.7 | 8.1 2.7 38.0 0.0 49.3 171.9 |",
            "deflection [µm] | 795.0 (776.1 … 813.9) | 506.9 (494.0 … 519.8) |",
            "model error | unknown | unknown |",
            "compliance along [µm/N] | 1.25 | 0.742 |",
            "compliance across [µm/N] | 1.72 | 1.83 |",
            "– all 4 places reached",
            "– deflection: median 669.4 µm, 90 % of the places 523.7 to 783.7 µm, greatest 795 µm",
            f"– {BOUND[1]}",
            "(1400, -200, 600) mm; (1800, 200, 600) mm",
            "(0, 300, -500) N",
        ]:
            assert line in lines

    def test_its_table_is_in_three_formats(self, local, jobs):
        head, rows = rows_of(local, jobs["map"], "map.csv")
        assert head[:7] == ["status", "x [m]", "y [m]", "z [m]", "direction", "turn", "joint_1 [rad]"]
        assert [row[0] for row in rows] == ["reached"] * 4
        place = [1.4, -0.2, 0.6, 0.0, 0.0, -0.141897, 0.0464075, 0.663974]
        assert numbers(rows[0][1:9]) == pytest.approx(place, rel=1e-4)
        moved = [-0.000333039, 0.000297733, -0.000428525, 0.000619027, 0.000603277, 0.000634777]
        assert numbers(rows[0][12:18]) == pytest.approx(moved, rel=1e-3)
        with np.load(io.BytesIO(local.get(file_at(jobs["map"], "map.npz")).content)) as arrays:
            shapes = {name: array.shape for name, array in arrays.items()}
            assert shapes == {"headers": (22,), "overall verdict": (4,), "status": (4,), "table": (4, 22)}
            of_csv = [[float(cell or "nan") for cell in row[1:-1]] for row in rows]
            assert np.allclose(arrays["table"], of_csv, equal_nan=True)
        columns = local.get(file_at(jobs["map"], "map.json")).json()["columns"]
        assert columns[1] == {"name": "x", "unit": "m", "values": [1.4, 1.4, 1.8, 1.8]}
        assert len(columns) == len(head)


class TestProgram:
    def test_distances_and_the_worst_points(self, local, jobs):
        result = jobs["correction"]["result"]["program"]
        counts = {"format": "krl", "points": 3, "moves": 3, "moves_left": 0, "corrected": 3, "capped": 0}
        assert {name: result[name] for name in counts} == counts
        assert result["residual"]["greatest"] < 1e-7
        assert jobs["correction"]["result"]["remarks"] == BOUND
        assert [(each["number"], each["line"]) for each in result["worst"]] == [(1, 7), (3, 9), (2, 8)]
        lines = report_of(local, jobs["correction"])
        for line in [
            "without correction | 2.314 (2.252 … 2.376) | 2.778 (2.710 … 2.846) | 2.830 (2.761 … 2.898) | "
            "unknown |",
            "displacement of targets | 2.3178 | 2.7835 | 2.8353 |",
            "1 | | 7 | 2.830 (2.761 … 2.898) | 0.000 (0.000 … 0.074) | unknown |",
            "– 3 of 3 targets are corrected",
            f"– {BOUND[0]}",
            "(300, 400, -1400) N",
            "(10, -5, 10, 5, 45, 3) °",
        ]:
            assert line in lines
        assert any(line.startswith("predicted, as written | 0.000 (0.000 … 0.0") for line in lines)

    def test_the_program_has_other_targets_and_nothing_else_changed(self, local, jobs):
        answer = local.get(file_at(jobs["correction"], "program"))
        lines = answer.text.splitlines()
        assert lines[:6] == [
            *("&ACCESS RVP", "DEF path()", ";FOLD INI", ";ENDFOLD"),
            *("$TOOL=TOOL_DATA[1]", "$BASE=BASE_DATA[1]"),
        ]
        targets = [
            [1809.8108, 268.9044, 1492.4817, -161.49339, 39.54207, -170.98413],
            [1461.19, 634.927, 1280.4, -149.024, 29.38868, -167.817],
            [1366.63, 139.5648, 1579.67, -168.26, 42.54175, -162.741],
        ]
        for line, target in zip(lines[6:9], targets, strict=True):
            found = re.fullmatch(r"LIN \{X (.+),Y (.+),Z (.+),A (.+),B (.+),C (.+)\} C_DIS", line)
            assert numbers(found.groups()) == pytest.approx(target, rel=1e-5)
        assert lines[9:] == ["END"]
        head, rows = rows_of(local, jobs["correction"], "rows.csv")
        assert head[:8] == [
            *("point", "name", "file", "line"),
            *("place x [m]", "place y [m]", "place z [m]", "J1 [deg]"),
        ]
        assert [row[2:4] for row in rows] == [["cell.src", "7"], ["cell.src", "8"], ["cell.src", "9"]]
        moved = [-0.244667, 0.373895, -2.794142, 2.82965, 2.681501, 0.241588, -0.374176, 2.800193, 2.83539]
        assert numbers(rows[0][13:22]) == pytest.approx(moved, rel=1e-3)
        columns = local.get(file_at(jobs["correction"], "rows.json")).json()["columns"]
        assert columns[0] == {"name": "point", "unit": "", "values": [1, 2, 3]}
        assert len(columns) == len(head)


def test_lists_have_what_a_row_shows_of_each_kind(local, jobs):
    listed = {kind.name: local.get("/v1/jobs", params={"kind": kind.name}).json() for kind in KINDS}
    assert [item["id"] for item in listed["run"]["items"]] == [jobs["other"]["id"], jobs["run"]["id"]]
    assert [item["positive"] for item in listed["run"]["items"]] == [False, True]
    first = listed["run"]["items"][1]
    assert {name: first[name] for name in ("joints_identified", "joint_count", "warning_count")} == {
        "joints_identified": 6,
        "joint_count": 6,
        "warning_count": 0,
    }
    assert first["compensation"] == pytest.approx(0.98708, rel=1e-4)
    assert (first["robot_name"], first["measurement_set_name"]) == (
        "simulated 6R",
        "pull, 12 configurations, motor encoders",
    )
    assert {name: answer["total"] for name, answer in listed.items() if answer["total"]} == {
        "run": 2,
        **dict.fromkeys(("comparison", "geometry", "plan", "map", "correction"), 1),
    }
    assert {item["verdict"] for answer in listed.values() for item in answer["items"]} == {"use"}
    of_run = {name: listed[name]["items"][0]["run_id"] for name in ("map", "correction")}
    assert of_run == dict.fromkeys(("map", "correction"), jobs["run"]["id"])
    names = (listed["geometry"]["items"][0]["name"], listed["correction"]["items"][0]["name"])
    assert names == ("pan and tilt", "cell.src")
    outputs = [each["sha256"] for each in jobs["correction"]["result"]["program"]["files"]]
    assert listed["correction"]["items"][0]["outputs"] == outputs
