"""What is made of a run at the terminal: reports, exports, predictions, maps, plans, programs."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.command_lines import answered, assert_said, refused, typed
from support.kinds import MAP
from support.programs import options, path, tool_poses
from support.terminal import terminal

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.programs import program_text
from jointstiff.simulator.urdf import urdf_text

POSTURES = (
    "label,J1 [deg],J2 [deg],J3 [deg],J4 [deg],J5 [deg],J6 [deg],Fx [N],Fy [N],Fz "
    "[N]\na,0,-20,30,0,45,0,0,0,-800\nb,40,-10,5,7,30,2,100,0,0\n"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    (folder / "pull.json").write_text(json.dumps(campaign))
    (folder / "run.json").write_text(terminal("identify", folder / "pull.json", "--json").stdout)
    (folder / "postures.csv").write_text(POSTURES)
    (folder / "area.json").write_text(json.dumps(MAP))
    (folder / "path.src").write_text(program_text("krl", tool_poses(path(4)), 4))
    (folder / "options.json").write_text(json.dumps(options("krl")))
    return folder


@pytest.fixture(autouse=True)
def inside(folder, monkeypatch):
    monkeypatch.chdir(folder)


def written(text):
    """Rows of a CSV: cells by their headers."""
    return list(csv.DictReader(text.splitlines()))


def numbers(row, *headers):
    return [float(row[header]) for header in headers]


def test_a_report_is_written_of_a_campaign_and_its_run_and_not_over_another_file():
    assert typed("report pull.json --run run.json --output report.html").startswith("report.html: ")
    page = Path("report.html").read_text()
    assert json.loads(Path("run.json").read_text())["id"] in page
    assert "3.734 … 3.905" in page
    said = refused("report pull.json --run run.json -o report.html")
    assert said == "report.html exists remedy: choose another name, or use --overwrite"
    assert Path("report.html").read_text() == page


def test_a_run_without_its_campaign_is_refused_with_the_way_to_keep_it():
    assert refused("report run.json -o again.html") == (
        "run.json is a result without a campaign remedy: give the campaign; "
        "`jointstiff identify FILE --save RUN` writes a run with its campaign"
    )


def test_an_exported_model_says_its_origin_verdict_and_intervals():
    typed("export pull.json -o model.mjcf --run run.json")
    assert_said(
        Path("model.mjcf").read_text(),
        '<mujoco model="simulated 6R">',
        "Joint stiffness of simulated 6R, identified from laser-tracker readings by jointstiff ",
        "Method: partial pose, covariance weights, compliances not negative. Intervals at 95 %.",
        "Verdict on the result: use.",
        "Lengths in m, angles in rad, stiffness in N·m/rad. Angles are those of the model, in the frame of "
        "the link base_link.",
        "Masses and inertias are placeholders that the format requires, and gravity is off: for dynamics "
        "or own weight, enter the values of the robot.",
        "joint_1: 3.818 · 10⁶ N·m/rad (95 % interval 3.734 … 3.905); verdict: use",
        "joint_6: 0.0925 · 10⁶ N·m/rad (95 % interval 0.0768 … 0.1129); verdict: use",
        '<compiler angle="radian" eulerseq="XYZ" autolimits="true" boundmass="1" boundinertia="1" />',
        '<option gravity="0 0 0" />',
        '<body name="link_1" pos="0.0 0.0 0.0"',
        '<joint name="joint_1" type="hinge" axis="0.0 0.0 1.0" range="-3.14159',
        '<body name="link_2" pos="0.33 0.0 0.78"',
        '<body name="flange" pos="0.24 0.0 0.0" euler="3.14159',
    )


def test_an_exported_table_has_numbers_of_each_joint_in_the_units_of_their_headers():
    typed("export pull.json -o model.csv --run run.json")
    *_, sixth = written(Path("model.csv").read_text())
    assert (sixth["joint"], sixth["status"], sixth["verdict"]) == ("joint_6", "identified", "use")
    assert numbers(sixth, *(f"stiffness{each} [N.m/rad]" for each in ("", " low", " high"))) == pytest.approx(
        [92535.7, 76818.7, 112919.2], rel=1e-5
    )
    compliance = [f"compliance{each} [rad/(N.m)]" for each in ("", " standard uncertainty", " low", " high")]
    assert numbers(sixth, *compliance) == pytest.approx(
        [1.080664e-5, 1.169047e-6, 8.855886e-6, 1.301767e-5], rel=1e-5
    )
    assert numbers(sixth, "stiffness at least, one-sided [N.m/rad]") == pytest.approx([79089.7], rel=1e-5)


def test_deflections_are_predicted_with_their_uncertainty():
    assert_said(
        typed(
            "predict pull.json postures.csv --load-point 0,0,120 --run run.json --output p.csv --overwrite"
        ),
        "Use this prediction: no fault was found; all 6 joints of its run passed the checks",
        "Deflections in R0",
        "a -0.2533 (-0.2668 … -0.2399) 0.0000 (0.0000 … 0.0000) -1.194 (-1.225 … -1.163)",
        "b 0.06284 (0.06140 … 0.06428) -0.01854 (-0.01923 … -0.01785) -0.02807 (-0.02893 … -0.02720)",
        "1591 (1556 … 1629)",
        "in brackets: 95 % interval, model error unknown; stiffness along the force",
        "own weight is not included, because no masses are given",
        "no bound of the model error at 95 %: 19 postures are needed, but the campaign has only 12",
    )
    first, second = written(Path("p.csv").read_text())
    shifts = [f"displacement {axis} [mm]" for axis in "xyz"]
    assert numbers(first, *shifts) == pytest.approx([-0.253344, 0.0, -1.194043], abs=1e-5)
    assert numbers(second, *shifts) == pytest.approx([0.0628406, -0.0185388, -0.0280671], abs=1e-6)
    assert numbers(first, "rotation y [mrad]") == pytest.approx([1.444748], abs=1e-5)
    limits = [f"displacement z readings only {side} [mm]" for side in ("low", "high")]
    assert numbers(first, *limits) == pytest.approx([-1.224794, -1.163292], abs=1e-5)


def test_a_prediction_at_a_place_has_compliance_along_the_force_and_in_the_worst_direction():
    first, second = answered("predict pull.json postures.csv --place 0,0,250 --load-point 0,0,120")["cases"]
    assert first["displacement"] == pytest.approx([-0.00040732, 0.0, -0.0013017], abs=1e-7)
    assert first["readings_only"][2] == pytest.approx([-0.0013357, -0.0012677], abs=1e-7)
    assert first["with_model_error"] is None
    along, worst = first["compliance"]["along"], first["compliance"]["worst"]
    assert along["direction"] == [0.0, 0.0, -1.0]
    assert along["lateral_free"] == pytest.approx(5.5976e5, rel=1e-4)
    assert along["lateral_blocked"] == pytest.approx(7.5944e5, rel=1e-4)
    assert along["rotation_blocked"] == pytest.approx(1.3516e6, rel=1e-4)
    assert along["compliance"] == pytest.approx(1.7865e-6, rel=1e-4)
    assert worst["direction"] == pytest.approx([0.45409, 0.0, 0.89096], abs=1e-4)
    assert worst["compliance"] == pytest.approx(2.11059e-6, rel=1e-4)
    budget = second["budget"]
    assert budget["contributions"] == pytest.approx(
        {"readings": 4.2905e-7, "assumed_force_scale": 7.4506e-7, "assumed_load_point": 1.4823e-7}, rel=1e-3
    )
    assert budget["standard_uncertainty"] == pytest.approx(8.7246e-7, rel=1e-3)
    assert budget["expanded_uncertainty"] == pytest.approx(1.7100e-6, rel=1e-3)


def test_a_map_shows_its_worst_and_its_stiffest_place():
    assert_said(
        typed("map pull.json --options area.json --run run.json --details"),
        "Use this map: no fault was found; all 6 joints of its run passed the checks",
        "all 4 places reached",
        "deflection: median 669.4 µm, 90 % of the places 523.7 to 783.7 µm, greatest 795 µm",
        "┃ ┃ worst place ┃ stiffest place ┃",
        "│ place [mm] │ 1800 -200 600 │ 1400 200 600 │",
        "│ controller's angles [°] │ -6.3 20.7 16.1 0.0 53.2 -173.7 │ 8.1 2.7 38.0 0.0 49.3 171.9 │",
        "│ deflection [µm] │ 795.0 (776.1 … 813.9) │ 506.9 (494.0 … 519.8) │",
        "│ model error │ unknown │ unknown │",
        "│ compliance along [µm/N] │ 1.25 │ 0.742 │",
        "│ compliance across [µm/N] │ 1.72 │ 1.83 │",
        "deflection with its 95 % interval",
        "│ Area │ (1400, -200, 600) mm; (1800, 200, 600) mm │",
        "│ Force │ (0, 300, -500) N │",
    )


def test_a_map_along_the_flange_takes_the_best_of_its_turns_and_bounds_its_model_error():
    line = "map pull.json --options area.json --run run.json"
    assert_said(
        typed(f"{line} --turns 3 --direction 1,0,0 --axes flange --confidence 0.9"),
        "deflection: median 388.8 µm, 90 % of the places 303.6 to 488.9 µm, greatest 493.9 µm",
        "│ controller's angles [°] │ 6.3 20.7 16.1 0.0 53.2 53.7 │ -8.1 2.7 38.0 0.0 49.3 68.1 │",
        "│ deflection [µm] │ 494 (470 … 518) │ 301 (277 … 325) │",
        "│ model error │ included │ included │",
        "│ compliance along [µm/N] │ 1.34 │ 0.95 │",
        "deflection with its 90 % interval",
    )


def test_a_map_as_csv_has_a_row_for_each_place():
    rows = written(
        terminal("map", "pull.json", "--options", "area.json", "--run", "run.json", "--csv").stdout
    )
    assert [numbers(row, "x [m]", "y [m]", "z [m]") for row in rows] == [
        [1.4, -0.2, 0.6],
        [1.4, 0.2, 0.6],
        [1.8, -0.2, 0.6],
        [1.8, 0.2, 0.6],
    ]
    assert {row["status"] for row in rows} == {"reached"}
    assert numbers(rows[0], "joint_1 [rad]", "joint_3 [rad]", "joint_5 [rad]") == pytest.approx(
        [-0.141897, 0.663974, 0.860415], abs=1e-5
    )
    assert numbers(rows[0], "dx [m]", "dy [m]", "dz [m]", "deflection [m]") == pytest.approx(
        [-0.000332999, 0.000297804, -0.000428502, 0.000619023], abs=1e-8
    )
    assert numbers(rows[0], "readings only low [m]", "readings only high [m]") == pytest.approx(
        [0.000603333, 0.000634714], abs=1e-8
    )


def test_a_plan_says_what_it_adds_and_is_a_campaign_to_fill_in():
    assert_said(
        typed("plan pull.json --readings 3 --candidates 200 --campaign filled.json --overwrite --details"),
        "Use this plan: no fault was found; all 6 joints of its run passed the checks",
        "│ joint_1 │ ± 0.91 % │ ± 0.97 % │",
        "│ joint_4 │ ± 4.7 % │ ± 16 % │",
        "│ joint_6 │ ± 11 % │ ± 17 % │",
        "from the noise of the readings alone; model error is not included",
        "p1 -150.0 -4.0 48.0 -10.0 95.0 -15.0 1500",
        "v2 -22.0 69.0 37.0 44.0 -73.0 68.0 1500",
        "Readings v1, v2, … validate the model, and are not fitted. Targets: P10, P11, P12. Load point in "
        "the flange frame: -60, 20, 180 mm",
        "certified: the list gives at least 100.0 % of the information of the best possible list "
        "(criterion: relative uncertainty of the joints)",
        "200 of 200 readings were feasible",
        "the list has only the new readings, but the predicted uncertainties also use the readings "
        "of the campaign so far: identify old and new readings together",
        "│ Distinct angle │ 10° │",
        "wrote filled.json",
    )
    stated = json.loads(Path("filled.json").read_text())["measurement_set"]
    assert (stated["name"], stated["encoders"]) == ("planned for simulated 6R", "motor")
    assert stated["load_point"] == pytest.approx([-0.06, 0.02, 0.18])
    assert [each["label"] for each in stated["observations"]] == ["p1", "v2", "p3"]
    assert stated["observations"][0]["force"] == pytest.approx([-621.13, 1343.4, -243.97], rel=1e-4)
    assert stated["observations"][2]["joints"][:3] == pytest.approx([2.5482, -0.68068, -0.05236], abs=1e-4)
    assert stated["observations"][1]["readings"][0] == {"target": "P10", "unloaded": None, "loaded": None}


def test_a_plan_as_csv_marks_the_reading_that_is_held_out():
    rows = written(terminal("plan", "pull.json", "--readings", 3, "--candidates", 200, "--csv").stdout)
    assert [row["label"] for row in rows] == ["p1", "v2", "p3"]
    assert numbers(rows[1], "joint_2 [deg]", "joint_5 [deg]", "Fx [N]", "load point z [mm]") == [
        69.0,
        -73.0,
        1466.7,
        180.0,
    ]
    assert rows[0]["P10 unloaded x [mm]"] == ""


def test_a_program_is_corrected_and_its_points_are_written():
    line = "correct pull.json path.src --options options.json --output out.src --report rows.csv"
    assert_said(
        typed(f"{line} --overwrite"),
        "Use this program: no fault was found; all 6 joints of its run passed the checks",
        "4 of 4 targets are corrected",
        "Distance of the loaded tool from its target, mm",
        "│ without correction │ 2.265 (2.207 … 2.322) │ 2.752 (2.685 … 2.820) │ 2.830 (2.761 … 2.898)",
        "│ predicted, as written │ 0.000 (0.000 … 0.067) │ 0.000 (0.000 … 0.074) │ 0.000 (0.000",
        "│ displacement of targets │ 2.2688 │ 2.7576 │ 2.8353 │",
        "Worst points",
        "│ 1 │ │ 7 │ 2.830 (2.761 … 2.898) │ 0.000 (0.000 … 0.074) │ unknown │",
        "│ 4 │ │ 10 │ 2.314 (2.252 … 2.376) │ 0.000 (0.000 … 0.075) │ unknown │",
        "wrote out.src wrote rows.csv",
    )
    assert_said(
        Path("out.src").read_text(),
        "&ACCESS RVP",
        "DEF path()",
        "$TOOL=TOOL_DATA[1]",
        "LIN {X 1809.8095,Y 268.9042,Z 1492.4807,A -161.49339,B 39.54200,C -170.98524} C_DIS",
        "LIN {X 1366.6301,Y 139.5645,Z 1579.6737,A -168.26166,B 42.54175,C -162.74097} C_DIS",
        "END",
    )
    first, *_ = written(Path("rows.csv").read_text())
    assert numbers(first, "line", "deflection [mm]", "deflection z [mm]") == pytest.approx(
        [7, 2.82953, -2.794023], abs=1e-4
    )
    assert refused(line) == "out.src exists remedy: choose another name, or use --overwrite"


def test_each_file_of_a_program_is_written_under_a_name_of_its_own():
    Path("more.src").write_text("DEF more( )\nWAIT SEC 1\nEND\n")
    line = "correct pull.json path.src more.src --options options.json --output both.src --overwrite"
    assert_said(typed(line), "4 of 4 targets are corrected", "wrote both.src", "both_more.src")
    assert "LIN {X 1809.8095,Y 268.9042" in Path("both.src").read_text()
    assert Path("both_more.src").read_text() == "DEF more( )\nWAIT SEC 1\nEND\n"
    Path("corrected").mkdir(exist_ok=True)
    typed(line.replace("both.src", "corrected"))
    for name, written_before in (("path.src", "both.src"), ("more.src", "both_more.src")):
        assert (Path("corrected") / name).read_text() == Path(written_before).read_text()
    assert refused(line.replace("both.src --overwrite", "corrected")).startswith("corrected/path.src exists")


def test_moves_are_explained_before_they_are_corrected():
    assert_said(
        typed("correct pull.json path.src --explain"),
        "line 7: 1809.57, 269.279, 1489.68, -161.541, 39.3967, -171.051, base BASE_DATA[1], tool "
        "TOOL_DATA[1]: corrected",
        "4 of 4 moves can be corrected, 0 cannot",
    )
    moves = answered("correct pull.json path.src --explain")
    assert [(each["line"], each["corrected"]) for each in moves] == [(line, True) for line in (7, 8, 9, 10)]
    assert moves[0] == {
        "line": 7,
        "target": "1809.57, 269.279, 1489.68, -161.541, 39.3967, -171.051",
        "base": "BASE_DATA[1]",
        "tool": "TOOL_DATA[1]",
        "reason": "",
        "remedy": "",
        "corrected": True,
    }


CUT = {"material": "titanium", "diameter": 0.012, "teeth": 4, "speed": 25, "feed": 0.006}
CUT |= {"depth": 0.002, "width": 0.006}


def test_a_cut_in_a_file_of_options_is_in_si_units_whatever_the_units_of_the_file(folder):
    """A file of options is a message of the API, whose cut is in metres."""
    start = [10, -5, 10, 5, 45, 3]
    posture = default_arm().posture(np.radians([start]))
    x, y, z = 1e3 * posture.point_to_base(np.zeros((1, 3)))[0]
    a, b, c = Rotation.from_matrix(posture.flange_rotation[0]).as_euler("ZYX", degrees=True)
    rows = [f"{x},{y + shift},{z},{a},{b},{c}" for shift in (0, 20, 40)]
    (folder / "line.csv").write_text(
        "x [mm],y [mm],z [mm],a [deg],b [deg],c [deg]\n" + "\n".join(rows) + "\n"
    )
    before = []
    for length in ("mm", "m"):
        stated = {
            "units": {"length": length, "angle": "deg", "force": "N"},
            "accuracy_option": "off",
            "cut": CUT,
            "format": "csv",
        }
        stated |= {
            "tools": [{"values": [0] * 6}],
            "bases": [{"values": [0] * 6}],
            "start": start,
        }
        (folder / "line.json").write_text(json.dumps(stated))
        command = ("correct", folder / "pull.json", folder / "line.csv")
        stated_files = ("--options", folder / "line.json", "-o", folder / "corrected.csv")
        result = terminal(*command, *stated_files, "--json", "--overwrite")
        before.append(json.loads(result.stdout)["result"]["program"]["deflection"]["greatest"])
    assert before[0] == pytest.approx(before[1])
    assert before[0] > 1e-5  # hundreds of newtons


class TestPosesWithoutJoints:
    """A correction without a row with numbers is no success, and its remedy works as it is written."""

    LINE = "correct pull.json poses.csv --force 0,300,-500"

    @pytest.fixture(autouse=True)
    def poses(self, folder):
        robot = default_arm().posture(np.radians([[10.0, -5.0, 10.0, 5.0, 45.0, 3.0]]))
        vector = Rotation.from_matrix(robot.flange_rotation).as_rotvec(degrees=True)[0]
        place = 1e3 * robot.point_to_base(np.zeros((1, 3)))[0]
        cells = ",".join(f"{number:.4f}" for number in [*place, *vector])
        (folder / "poses.csv").write_text(f"x [mm],y [mm],z [mm],rx [deg],ry [deg],rz [deg]\n{cells}\n")

    def test_ambiguous_rows_end_with_status_1_and_name_the_option(self):
        words = typed(self.LINE, status=1, width=400)
        remedy = "give joints (`J1 [deg]` …), or `--start`: the joints near the first pose"
        assert_said(words, "rows: 1 ambiguous", f"none of the 1 rows has a number; {remedy}")
        assert "rows: 1 corrected" in typed(f"{self.LINE} --start 10,-5,10,5,45,3")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "predict postures.csv run.json",
            "postures.csv and run.json are in the wrong order: the right order is FILE POSTURES",
        ),
        (
            "correct postures.csv pull.json --force 0,0,-5",
            "postures.csv and pull.json are in the wrong order: the right order is CAMPAIGN_OR_ROBOT POSES",
        ),
    ],
)
def test_a_table_in_the_place_of_a_campaign_is_named_as_an_exchange(line, said):
    table, document = line.split()[1:3]
    assert refused(line) == f"{said} remedy: write {document} {table}"


def test_an_urdf_that_is_no_xml_is_refused_by_its_line(folder):
    (folder / "bad.urdf").write_text("<robot")
    assert refused("import postures.csv --robot bad.urdf") == (
        "robot.line 1: not well-formed XML: unclosed token remedy: check the document with an XML tool"
    )


class TestUrdf:
    """A URDF begins a plan at the terminal; commands that need readings name the way to them."""

    @pytest.fixture(autouse=True)
    def urdf(self, folder):
        (folder / "arm.urdf").write_text(urdf_text(default_arm()))

    def test_a_plan_begins_with_it(self):
        options = "--load any_direction:800 --target A=0,0,100 --load-point 0,0,120 --readings 6"
        assert_said(typed(f"plan arm.urdf {options} --candidates 50"), "Readings, in order", "p1 ")

    def test_a_command_that_needs_readings_names_plan_and_import(self):
        assert_said(
            refused("identify arm.urdf"),
            "arm.urdf is a URDF, not a campaign remedy:",
            "`jointstiff plan arm.urdf` plans them, and `jointstiff import FILE --robot arm.urdf` reads them",
        )


def test_a_weight_is_stated_beside_its_mass_so_that_a_wrong_unit_is_seen():
    assert_said(
        typed("plan pull.json --readings 3 --candidates 200 --load dead_weight:150"),
        "A weight of 150 N is a mass of 15.3 kg",
    )
