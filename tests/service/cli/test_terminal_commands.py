"""Commands without a run: geometry, simulated campaigns, examples, the catalogue, and the help of each."""

import json
from pathlib import Path

import pytest
from support.command_lines import answered, assert_said, refused, typed
from support.guide_files import EXAMPLES


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_geometry_is_shown_with_its_uncertainty_and_written_as_a_robot():
    assert_said(
        typed(f"geometry {EXAMPLES / 'sweeps.json'} --details --output robot.json"),
        "Use: the checks found no fault",
        "Axes at model angle zero, in R0",
        "axis x y z direction place [µm] turn [µrad]",
        "joint_2 330.004 -15.454 780.000 +0.00000 +1.00000 +0.00002 ± 69 ± 45",
        "points in mm; ±: half of the 95 % interval, of the place across the axis and of the direction, ",
        "Sweeps, each fitted separately",
        "│ joint_6 │ 300.0° │ 10 │ 1.00001 │ 1.06 │ 16.4 13.5 9.47 │ 14.4 15.9 7.75 │",
        "Tracker to R0, placed by the nominal model",
        "│ x │ -0.48995",
        "│ -3745.239 │ ± 53 │ ± 8 │",
        "│ P11 │ 99.9997 (99.9931 … 100.0063) │ -99.9980 (-100.0051 … -99.9910) │",
        "1138.902 (",
        "1138.905 (",
        "axes and sphere are 5.3 µm apart (p-value 0.6)",
        "the last three axes miss each other by 6.4 µm (± 10 µm): the decoupled method applies",
        "│ a │ joint_2 │ 1120.000 │ 1120.020 │ 0.0197 (0.0026 … 0.0367) │",
        "│ alpha │ joint_4 │ -90.0000° │ -89.9977° │ 0.040 (-0.011 … 0.091) │",
        "│ d │ joint_4 │ -1310.000 │ -1310.053 │ -0.053 (-0.108 … 0.002) │",
        "sigma of a coordinate 15.0 µm (stated), χ²/dof 0.95 with 447 degrees of freedom",
        "one robot model fits all sweeps (noise alone would give a worse fit with a probability of 80 %)",
        "the controller's angles fit the readings (noise alone would give a worse fit with a probability "
        "of 40 %)",
        "deviation of the DH tables (all numbers in the JSON): standard 66.0 µm, modified 66.0 µm",
        "wrote robot.json",
    )
    robot = json.loads(Path("robot.json").read_text())
    assert (robot["name"], robot["model"]["format"]) == ("cell 3", "urdf")
    assert (robot["model"]["base"], robot["model"]["flange"]) == ("base_link", "flange")
    assert robot["model"]["urdf"].startswith('<robot name="cell 3">')


def test_a_simulated_campaign_states_its_true_stiffnesses_and_is_not_written_over():
    assert typed("simulate new.json --load pull --configurations 4 --seed 1 --sigma 0 --force 900") == (
        "wrote new.json: 4 configurations, 900 N true stiffnesses, joint 1 to 6: 3.8, 3.1, 2.5, 0.45, 0.25, "
        "0.09 × 10⁶ N·m/rad now: jointstiff identify new.json"
    )
    measured = json.loads(Path("new.json").read_text())["measurement_set"]
    assert measured["name"] == "pull, 4 configurations, motor encoders"
    assert measured["load_point"] == [-0.06, 0.02, 0.18]
    assert [each["label"] for each in measured["observations"]] == ["c01", "c02", "c03", "c04"]
    third = measured["observations"][2]
    assert third["joints"][:3] == pytest.approx([-0.5349, 0.5387, -0.6239])
    assert third["force"] == pytest.approx([-688.51, 284.22, 505.15], rel=1e-4)
    assert third["readings"][0]["unloaded"] == pytest.approx([2.1719, -1.1659, 2.0895], abs=1e-4)
    assert third["readings"][0]["loaded"] == pytest.approx([2.1707, -1.1655, 2.092], abs=1e-4)
    assert refused("simulate new.json") == "new.json exists remedy: choose another name, or use --overwrite"
    said = refused("simulate nowhere/x.json")
    reason = "'nowhere/x.json' cannot be written, as there is no folder 'nowhere'"
    assert said == f"{reason} remedy: make this folder first, or choose another path"


def test_a_campaign_of_own_weight_states_masses_and_reads_without_a_load():
    line = "simulate weight.json --encoders secondary --configurations 4 --load own_weight"
    assert_said(
        typed(line),
        "wrote weight.json: 4 configurations, own weight",
        "joint 1 to 6: 6.6, 5.7, 6.1, 0.45, 0.25, 0.09 × 10⁶ N·m/rad",
    )
    document = json.loads(Path("weight.json").read_text())
    assert [body["mass"] for body in document["robot"]["bodies"]][:3] == [380.0, 230.0, 260.0]
    assert document["robot"]["bodies"][1] == {
        "name": "link 2",
        "joint": "joint_2",
        "mass": 230.0,
        "mass_uncertainty": 0.1,
        "centre": [0.02, -0.09, 0.52],
    }
    assert (document["measurement_set"]["noise"], document["run"]) == ({"sigma": 2e-5}, {"weight": {}})
    first = document["measurement_set"]["observations"][0]
    assert first["force"] == [0.0, 0.0, 0.0]
    assert first["readings"][0].keys() == {"target", "unloaded"}
    assert first["readings"][0]["unloaded"] == pytest.approx([2.6538, 0.11218, 1.8275], abs=1e-4)


def test_examples_are_written_once_and_kept_afterwards():
    names = "lab.toml pocket.src poses.csv postures.csv readings.csv sweeps.json "
    names += "weight_step.json day1.csv joints.csv points.txt robot.urdf motor.json secondary.json "
    names += "robot.json nominal.json"
    assert typed("examples ex") == " ".join(f"wrote ex/{name}" for name in names.split())
    assert {path.name for path in Path("ex").iterdir()} == set(names.split())
    Path("ex/day1.csv").write_text("mine")
    assert typed("examples ex") == " ".join(f"kept ex/{name}" for name in names.split())
    assert Path("ex/day1.csv").read_text() == "mine"


def test_the_catalogue_lists_arms_with_reach_and_signs():
    assert_said(
        typed("robots", width=140),
        "Nominal arms",
        "│ FANUC R-2000iC/165F │ 2655 │ FANUC: J3 from the horizontal │",
        "│ KUKA KR 6 R900 sixx │ 901.5 │ KUKA: A1, A4 and A6 turn the other way │",
        "│ ABB IRB 120-3/0.6 │ 580 │ — │",
        "│ Yaskawa GP180 │ 2702 │ Yaskawa: U, R, B and T turn the other way │",
        "│ Universal Robots UR10e │ 1300 │ — │",
        'Select an arm by its name, such as --robot "KUKA KR 210 R2700".',
    )


def test_an_arm_is_shown_by_a_part_of_its_name_with_rows_and_sources():
    assert_said(
        typed("robots 'kr 210 r2700'", width=140),
        "KUKA KR 210 R2700 extra (nominal) Denavit-Hartenberg, modified",
        "│ 1 │ 0 │ 0 │ 675 │ 0 │ -185 to 185 │",
        "│ 2 │ 350 │ -90 │ 0 │ 0 │ -140 to -5 │",
        "│ 4 │ 41 │ 90 │ 1200 │ 0 │ -350 to 350 │",
        "R0: on axis 1, at the floor reach: 2696 mm of the wrist centre payload: 210 kg",
        "joint map, row 1: -1 0 0 0 0 0",
        "joint map, row 4: 0 0 0 -1 0 0",
        "source: ros-industrial/kuka_experimental: kuka_kr210_support/urdf/kr210r2700extra_macro.xacro, "
        "commit 01ae9a4 source: KUKA, data sheet: maximum reach",
    )


def test_an_arm_is_written_as_a_robot_in_metres_and_radians():
    typed("robots UR5e --output ur.json")
    robot = json.loads(Path("ur.json").read_text())
    assert robot["name"] == "Universal Robots UR5e (nominal)"
    assert (robot["model"]["format"], robot["model"]["convention"]) == ("dh", "standard")
    rows = robot["model"]["rows"]
    assert [row["a"] for row in rows] == [0.0, -0.425, -0.3922, 0.0, 0.0, 0.0]
    assert [row["d"] for row in rows] == pytest.approx([0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996])
    assert [row["alpha"] for row in rows] == pytest.approx([1.570796, 0.0, 0.0, 1.570796, -1.570796, 0.0])
    assert (rows[0]["lower"], rows[0]["upper"]) == pytest.approx((-6.283185, 6.283185))
    assert refused("robots 'no such arm'") == (
        "ARM: the catalogue has no arm 'no such arm' remedy: `jointstiff robots` and GET /v1/catalogue "
        "list its arms; or describe the arm by a DH table or URDF"
    )


def test_the_catalogue_as_json_has_frames_maps_and_sources():
    catalogue = answered("robots")
    assert len(catalogue["arms"]) == 21
    arm = catalogue["arms"][1]
    assert (arm["name"], arm["maker"]) == ("FANUC R-2000iC/210F", "FANUC")
    assert arm["base"] == "on axis 1, at the height of axis 2, 670 mm above the floor"
    assert (arm["reach"], arm["reach_of"], arm["joint_map_preset"]) == (2.655, "wrist_centre", "fanuc")
    assert arm["sources"][0] == (
        "ros-industrial/fanuc: fanuc_r2000ic_support/urdf/r2000ic210f_macro.xacro, commit 0d7b4d0"
    )
    maps = {each["id"]: each for each in catalogue["joint_maps"]}
    assert list(maps) == ["fanuc", "kuka", "yaskawa", "horizontal_third"]
    assert maps["fanuc"]["note"] == (
        "The controller shows J3 from the horizontal: when J2 moves alone, the forearm keeps its direction. "
        "J3 to J6 turn against the table."
    )
    assert maps["fanuc"]["joint_map"]["matrix"][2] == [0.0, -1.0, -1.0, 0.0, 0.0, 0.0]
    assert [maps["kuka"]["joint_map"]["matrix"][j][j] for j in range(6)] == [-1, 1, 1, -1, 1, -1]


HELP = {
    "identify": [
        "Usage: jointstiff identify [OPTIONS] {FILE} Identify the joint stiffnesses of a campaign. "
        "docs/glossary.md explains the terms.",
        "FILE <file> Campaign file: robot, measurement set and run options in one JSON document. [required]",
        "--positive / --no-positive True to constrain every compliance to be zero or positive.",
        "Default: 2.8, which 5 % of good readings exceed. Dimensionless.",
        "--cause NAME[:FIRST] Systematic errors to fit together with the joints, as a reason of the "
        "verdict recommends. The readings do not change, and the intervals include the uncertainty of "
        "the errors. Repeatable.",
        "--prior JOINT=STIFFNESS:UNCERTAINTY",
        "--resample SIZE[:REPETITIONS[:SEED]]",
        "--leave-out NAME,NAME,... Labels of observations to omit; the checks are then repeated for the "
        "remaining observations.",
        "--apply ACTION Apply an action that a reason of the verdict recommends, such as exchange_columns "
        "or convert_units. The corrected campaign is written to a new file and identified.",
        "-o, --output FILE File to write the corrected campaign to; default: a new file next to the old one.",
        "Unit of stiffness in the tables: 10⁶ N·m/rad or N·m/arcmin. [default: MNm/rad]",
    ],
    "compare": [
        "Compare methods on a campaign, or two campaigns of one robot.",
        "[SECOND] <file> File of a second campaign to compare with the first. The second campaign has "
        "secondary encoders, follows a change, or is of a robot of the same model.",
        "--ordered / --no-ordered True to fit both measurement sets also together, with no joint softer "
        "in the second set.",
        "--same-load / --no-same-load True if the load acted at the same point of the flange in both "
        "measurement sets. Both sets then share one error of the load point.",
        "--same-cell / --no-same-cell True if one load cell, or one set of weights, gave the forces of "
        "both measurement sets. Both sets then share one error of scale.",
        "--confidence NUMBER Confidence level of the intervals of the ratios; default: the confidence "
        "level of the first run.",
        "--csv Print CSV for spreadsheets.",
    ],
    "predict": [
        "Predict deflections in given postures under given loads.",
        "POSTURES <file> CSV of postures and loads, with units in the headers: J1 [deg], …, Fx [N], … "
        "[required]",
        "--run FILE File of the campaign's run, as `identify --json` prints the run; default: identify the "
        "campaign now.",
        "--load-point X,Y,Z[mm] Point where the force acts, in the flange frame, in mm.",
        "--place X,Y,Z[mm] Point whose deflection is predicted, in the flange frame, in mm; default: the "
        "load point.",
    ],
    "map": [
        "Map deflection and compliance over a work area.",
        "--absolute / --no-absolute True to include the sag by own weight, which requires a run with "
        "`weight`. Deflections are then relative to a rigid arm.",
        "--despite-verdict `do_not_use` confirms the use of a run with the verdict *do not use*.",
        "--load-point X,Y,Z[mm] Point where the force acts, in the flange frame; default: the position of "
        "the tool.",
        "--turns <int> Number of rotation angles of the tool about its axis, spread evenly over 360°.",
        "--moment X,Y,Z[N.m] Moment of the process on the robot, about the load point.",
        "--axes <base|flange> Frame in which force, moment and `direction` are given.",
    ],
    "import": [
        "Import tables of readings as a campaign. Documented headers are understood. For any other table, "
        "the robot proposes the meaning of its columns. What numbers cannot say is one question at a time.",
        "--mapping FILE Mapping of an earlier import: the meaning of each column.",
        "--encoders <motor|secondary> Encoders that close the position loop: motor, or secondary behind the "
        "gearboxes.",
        "--force X,Y,Z Force on the robot in R0 [N], such as 0,0,-981, or a hung mass: 100kg.",
        "--encoding <str> Encoding of texts that are not in UTF-8.",
        "--save-mapping FILE Write the mapping, for further files.",
        "--yes Take the proposal: the first answer to each question.",
        "--despite-errors Write the readings even if the checks find errors.",
    ],
    "measure": [
        "Measure live: what to read next, what the readings say so far, and when it is enough. "
        "docs/live.md explains goals and sources.",
        '--goal GOAL Goal of the measurement. "15 %": uncertainty of every stiffness that the load tests. '
        '"6 um": uncertainty of the deflection in the work area. "below 0.5 mm": decide whether the '
        "deflection stays below 0.5 mm. Required without --bridge.",
        "--source SOURCE Source of the readings: simulated:SEED, lines:/dev/ttyUSB0, "
        "lines:tcp://host:port, lines:udp://:port, or robodk. Required unless --bridge is given.",
        "--bridge SOURCE Source of positions for a page of the service. Needs --server and --code; omit "
        "campaign, --goal and --source. --code CODE Code that the page shows under *Tracker*.",
        "--most <int range> Greatest number of readings, after which the measurement ends. [default: 200; "
        "1<=x<=200]",
        "--yes Ask no questions: take all readings at once, one after the other.",
        "--timeout <float range> Time without data, in seconds, after which a source is considered "
        "stopped. [default: 30.0; x>=0.1]",
        "--load KIND:NEWTONS Load to apply, such as dead_weight:1500, dead_weight:150kg or "
        "any_direction:1500. Default: the strongest force of the campaign, as a weight if all forces "
        "pull down.",
        "--sigma NUMBER[mm] Standard uncertainty of one coordinate of one reading; default: the "
        "campaign's value, or 20 µm.",
        "--seed <int> Random seed of the postures; the same seed gives the same plan.",
    ],
    "correct": [
        "Correct poses or a robot program for the deflection under load.",
        "POSES <list[Path]> CSV or Parquet of poses, with units in the headers: x [mm], …, rx [deg], …; if "
        "known J1 [deg], …; Fx [N], … Or a robot program. KUKA: the .src and .dat files. ABB: the modules of "
        "the task. FANUC: the .LS file and the .LS files that it calls. [required]",
        "--accuracy-option <off|same_as_measured|compensates_load> Accuracy option of the controller. "
        "`off`: switched off. `same_as_measured`: switched on, as in the campaign. `compensates_load`: "
        "refused, because the load would be compensated twice. Required for a "
        "program; default for poses: `off`.",
        "--max-displacement NUMBER[mm] Greatest displacement of a correction, in units.length; default: 5 "
        "mm.",
        "--max-rotation NUMBER[deg] Greatest rotation of a correction, in units.angle; default: 10 mrad.",
        "--trust-routines / --no-trust-routines True if no unknown routine moves the robot or changes "
        "frames or points. Arguments passed by reference are an exception.",
        "--mark / --no-mark True to write run, verdict and date as a comment (always written for the "
        "verdict do_not_use). A program with such a comment is not corrected again.",
        "--explain Only print the target, base and tool of each move of a program, and the reason why a move "
        "is not corrected.",
    ],
    "geometry": [
        "Identify the geometry of a robot from sweeps or poses.",
        "--fit <one_by_one|together> Way to fit the sweeps. A fit one by one uses only the angle of the "
        "moving joint; a fit of all together uses the controller's angles of all joints.",
        "--base <nominal|axes> Definition of the robot's base frame R0. `nominal`: as in the nominal "
        "model. `axes`: z along axis 1, x towards axis 2 along the common perpendicular at model angle "
        "zero. Default: `nominal`, or `axes` without a model.",
        "-o, --output ROBOT.json File to write the identified robot to.",
    ],
    "serve": [
        "Start the service.",
        "--host <str> Address to listen on. [default: 127.0.0.1]",
        "--port <int range> Port on which the service listens; 0 chooses any free port. [default: 8000; "
        "0<=x<=65535]",
        "[env var: JOINTSTIFF_DATABASE; default: sqlite:///jointstiff.db]",
        "--no-access-control Require no keys; use this option only behind an authenticating proxy. Needs "
        "--allowed-host.",
        "--metrics-host <str> Address on which the metrics port listens; everyone who reaches this address "
        "can read the metrics. [default: 127.0.0.1]",
        "--require-key Require a key (`jointstiff keys create`) even for requests from this machine.",
        "--keys-file FILE File of access keys, such as a secret of a container; the file contains only "
        "hashes of the keys.",
    ],
}


@pytest.mark.parametrize("command", HELP)
def test_help_says_what_a_command_does_and_takes(command):
    assert_said(typed(f"{command} --help", width=100), *HELP[command])
