"""`jointstiff import`: the campaign that it writes, what it shows, and when it writes nothing."""

import json
import re
from functools import partial

import numpy as np
import pytest
from support.importing_samples import CAMPAIGN
from support.terminal import terminal
from support.workbooks import table_of

from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.own_weight import unloaded_campaign
from jointstiff.solver.mechanics.postures import flange_poses

ARM = default_arm()
DOCUMENT = simulate_campaign(ARM, load="dead_weight", configurations=6, seed=7)
SET = DOCUMENT["measurement_set"]
POINT = ",".join(repr(1e3 * part) for part in SET["load_point"])
STATED = ["--encoders", "motor", "--load-point", POINT, "--sigma", 1e3 * SET["noise"]["sigma"]]
run = partial(terminal, width=160)


def words(text):
    """Return a text of the terminal without line ends."""
    return " ".join(text.split())


def identified(path):
    return json.loads(run("identify", path, "--json").stdout)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Work in a folder with a campaign, its robot, and its readings as a table."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "campaign.json").write_text(json.dumps(DOCUMENT))
    (tmp_path / "robot.json").write_text(json.dumps(DOCUMENT["robot"]))
    (tmp_path / "robot.urdf").write_text(DOCUMENT["robot"]["model"]["urdf"])
    (tmp_path / "cell.csv").write_bytes(table_of(DOCUMENT))
    return tmp_path


@pytest.mark.parametrize("robot", ["campaign.json", "robot.json", "robot.urdf --payload 240"])
def test_a_table_of_a_campaign_gives_the_result_of_the_campaign(folder, robot):
    shown = run("import", "cell.csv", "--robot", *robot.split(), *STATED, "--output", "new.json")
    assert (shown.exit_code, shown.stderr) == (
        0, "wrote new.json, a campaign; now: jointstiff identify new.json\n"
    )  # fmt: skip
    lines = shown.stdout.splitlines()
    assert lines[0] == "cell.csv: utf-8, semicolon between cells, decimal point, 6 rows"
    assert [cell.strip() for cell in lines[5].split("│")[1:6]] == [
        "2", "J1 [rad]", "joint 1", "rad", "0.393; -1.5543"
    ]  # fmt: skip
    load = r"  force on the robot: \d+ N( to \d+ N)?; load point in the flange frame: \(.+, .+, .+\) mm"
    assert re.fullmatch(load, lines[-4])
    assert lines[-3:] == [
        "  6 observations (c01, c02, c03, c04, c05, …), 6 joints, 18 complete readings; "
        "targets: P10, P11, P12; states: unloaded, loaded",
        "  complete: a measurement set",
        "  integrity: nothing suspicious",
    ]
    assert identified("new.json")["result"] == identified("campaign.json")["result"]


@pytest.mark.parametrize(
    ("options", "reason"),
    [([], "needs the robot: add --robot"), (["--robot", "robot.urdf"], "greater than or equal to 0.1")],
)
def test_a_payload_is_of_a_robot_and_plausible(folder, options, reason):
    refused = run("import", "cell.csv", *options, *STATED, "--payload", "0.01", "--output", "new.json")
    assert refused.exit_code == 2
    assert reason in words(refused.stderr)


def test_a_file_is_overwritten_only_if_that_is_said(folder):
    (folder / "new.json").write_text("kept")
    command = "import", "cell.csv", "--robot", "robot.json", *STATED, "--output", "new.json"
    refused = run(*command)
    assert (refused.exit_code, words(refused.stderr)) == (
        2, "new.json exists remedy: choose another name, or use --overwrite"
    )  # fmt: skip
    assert (folder / "new.json").read_text() == "kept"
    assert run(*command, "--overwrite").exit_code == 0
    assert json.loads((folder / "new.json").read_text())["measurement_set"]["encoders"] == "motor"


def test_observations_that_are_held_out_are_left_out_of_the_run(folder):
    lines = (folder / "cell.csv").read_text().splitlines()
    marks = ["validation", 1, 0, 0, 0, 0, 0]
    table = "\n".join(f"{line};{mark}" for line, mark in zip(lines, marks, strict=True))
    (folder / "held.csv").write_text(f"{table}\n")
    shown = run("import", "held.csv", "--robot", "robot.json", *STATED, "--output", "held.json")
    assert "  assumed: observations held out from the fit, to check the fit: c01\n" in shown.stdout
    assert identified("held.json")["request"]["leave_out"] == ["c01"]


def test_lengths_at_the_terminal_are_in_millimetres_whatever_the_unit_of_the_file(folder):
    (folder / "table.csv").write_text(CAMPAIGN.replace("[mm]", "[m]"))
    stated = ["--encoders", "motor", "--load-point", "0,0,120.5", "--sigma", "0.02", "--accept-unusual"]
    first = run("import", "table.csv", *stated, "--output", "set.json", "--save-template", "t.json")
    assert first.stderr.endswith("wrote set.json, a measurement set; now: add a robot with --robot\n")
    assert run(
        "import", "table.csv", "--template", "t.json", "--output", "again.json", "--sigma", "0.03"
    ).exit_code == 0  # fmt: skip
    for name, sigma in (("set.json", 2e-5), ("again.json", 3e-5)):
        written = json.loads((folder / name).read_text())
        assert written["load_point"] == pytest.approx([0.0, 0.0, 0.1205])
        assert written["noise"]["sigma"] == pytest.approx(sigma)


def test_unloaded_positions_and_masses_are_a_campaign_of_own_weight(folder):
    own = unloaded_campaign(ARM, configurations=30, seed=4)
    bodies = own["robot"].pop("bodies")
    rows = [
        f"{one['name']},{one['joint']},{one['mass']},10,{','.join(map(str, one['centre']))}" for one in bodies
    ]
    header = "body,joint,mass [kg],± [%],centre x [m],centre y [m],centre z [m]"
    (folder / "arm.json").write_text(json.dumps(own["robot"]))
    (folder / "masses.csv").write_text("\n".join([header, *rows, ""]))
    (folder / "grid.csv").write_bytes(table_of(own) + b"\n")
    stated = ["--encoders", "motor", "--sigma", "0.03", "--robot", "arm.json"]
    shown = run("import", "grid.csv", "masses.csv", *stated, "-o", "own.json")
    for line in (
        "masses.csv: utf-8, comma between cells, decimal point, 6 rows",
        "  assumed: read as masses",
        "  masses: 6 bodies, 1068 kg together",
        "  complete: a measurement set for the robot's own weight",
        "  integrity: nothing suspicious",
    ):
        assert line in shown.stdout.splitlines()
    written = json.loads((folder / "own.json").read_text())
    assert written["run"] == {"weight": {}}
    assert [one["joint"] for one in written["robot"]["bodies"]] == [one["joint"] for one in bodies]
    weight = identified("own.json")["result"]["weight"]
    first, second = weight["joints"][:2]
    assert (first["readings"], first["masses"], first["largest_sag"]) == (None, None, None)
    assert second["torque"] == pytest.approx([2071.3, 6271.2], rel=1e-4)
    assert second["largest_sag"] == pytest.approx(0.0021892, rel=1e-3)
    assert [second["readings"], second["masses"]] == pytest.approx([0.54263, 0.45737], rel=1e-3)
    assert 1e6 * weight["rms_without_sag"] == pytest.approx(199.98, rel=1e-3)
    assert 1e6 * weight["rms_residual"] == pytest.approx(28.253, rel=1e-3)
    assert weight["gravity"] == pytest.approx([0.0, 0.0, -9.80665])


def test_positions_of_targets_and_their_deviations_are_poses_of_a_geometry(folder):
    robot = prepare_robot(RobotDocument.model_validate(DOCUMENT["robot"])).robot
    lines = ["label,J1 [deg],J2 [deg],J3 [deg],J4 [deg],J5 [deg],J6 [deg]"]
    lines[0] += "".join(f",P unloaded {axis} [mm]" for axis in "xyz") + ",ex [mm],ey [mm],ez [mm]"
    random = np.random.default_rng(3)
    for number in range(30):
        q = random.uniform(-1.5, 1.5, 6)
        flange = flange_poses(robot, q[None])[0]
        place = 1e3 * (flange[:3, :3] @ (0.05, 0.02, 0.2) + flange[:3, 3])
        parts = [np.degrees(robot.joint_map.controller_angles(q)), place - 1.0, np.ones(3)]
        lines.append(f"{number}," + ",".join(f"{value:.9f}" for part in parts for value in part))
    (folder / "poses.csv").write_text("\n".join([*lines, ""]))
    columns = [f"--column=e{axis} [mm]=P unloaded plus {axis} [mm]" for axis in "xyz"]
    shown = run("import", "poses.csv", *columns, "--robot", "robot.json", "--output", "poses.json")
    assert shown.stderr == "wrote poses.json, unloaded poses; now: jointstiff geometry poses.json\n"
    for line in (
        "  complete: 30 unloaded poses for a geometry",
        "  missing: the force of each observation in axes of R0: columns `Fx [N]`, `Fy [N]`, `Fz [N]`, "
        "or one `--force` (N, daN, kN, kgf, lbf)",
        "  missing: the load point (`--load-point`), in the flange frame, or the target at the hook "
        "(`--load-point-target`)",
        "  missing: the encoders that close the position loop (`--encoders`): motor or secondary",
    ):
        assert line in shown.stdout.splitlines()
    assert json.loads(run("geometry", "poses.json", "--json").stdout)["result"]["sigma"] < 1e-8


@pytest.mark.parametrize(
    ("command", "place"), [(["import", "one.csv", "--robot"], "--robot"), (["plan"], "robot")]
)
@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "KUKA",
            "'KUKA' matches several arms of the catalogue: KUKA KR 210 R2700 extra, KUKA KR 6 R900 sixx "
            "remedy: give the whole name",
        ),
        (
            "KR 500",
            "the catalogue has no arm 'KR 500' remedy: `jointstiff robots` and GET /v1/catalogue list its "
            "arms; or describe the arm by a DH table or URDF",
        ),
    ],
)
def test_an_arm_of_the_catalogue_is_named_by_one_name(folder, command, place, name, said):
    (folder / "one.csv").write_text("J1 [deg]\n0\n")
    refused = run(*command, name)
    assert refused.exit_code == 2
    assert words(refused.stderr) == f"{place}: there is no file '{name}', and {said}"


def test_readings_that_do_not_fit_the_robot_are_written_only_despite_errors(folder):
    notes = ("serial_number=F-211034", "notes=load = 150 kg", "measured_at=2026-11-20T14:30:00+01:00")
    about = [part for note in notes for part in ("--about", note)]
    command = "import", "cell.csv", "--robot", "KUKA KR 210 R2700", *STATED, *about, "--output", "new.json"
    refused = run(*command)
    assert refused.exit_code == 1
    assert refused.stderr == "new.json was not written: correct the errors, or use --despite-errors\n"
    shown = words(refused.stdout)
    assert shown.count("use with care:") == 6
    assert shown.count("do not use:") == 5
    assert (
        "use with care: c01: the model angle of joint_2 is 0.6431 rad, "
        "outside its limits [-2.443, -0.08727] rad; "
        "check `units.angle`, the joint map, and the order of the joints; if the joint moves that far, "
        "correct the limits of the robot"
    ) in shown
    assert (
        "do not use: c02: another robot may have been measured, zeros of joints may be off, or the robot's "
        "description has several mistakes: no single change of units, signs, or order of the angles, of the "
        "frame or of one length of the model was found that explains the set; "
        "target 'P11' is 3.79 m away from its median position on the flange; "
        "up to 20 mm is plausible; check which robot was measured; "
        "check the angles and their order, the joint map and the robot's model; "
        "check that positions are in R0 and in `units.length`; if the numbers are right, state "
        "`--despite-errors` to use the result"
    ) in shown
    assert shown.index("another robot may have been measured") < shown.index("use with care:")
    assert not (folder / "new.json").exists()
    assert run(*command, "--despite-errors").exit_code == 0
    written = json.loads((folder / "new.json").read_text())
    assert written["robot"]["name"] == "KUKA KR 210 R2700 extra (nominal)"
    assert "joint_map" in written["robot"]
    assert [written["measurement_set"][name] for name in ("serial_number", "notes", "measured_at")] == [
        "F-211034", "load = 150 kg", "2026-11-20T13:30:00Z"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("note", "said"),
    [
        ("serial=F", "--about.serial: unknown field remedy: remove this field, or use one of conditions, "),
        (
            "measured_at=2026-11-20",
            "--about.measured_at: must have a time zone "
            "remedy: add the time zone, such as 2026-11-20T14:30:00+01:00",
        ),
        ("notes", "--about.notes: must have at least 1 character remedy: write a longer text"),
    ],
)
def test_a_note_about_a_set_has_a_key_and_a_value(note, said):
    refused = run("import", "cell.csv", "--robot", "robot.json", *STATED, "--about", note)
    assert refused.exit_code == 2
    assert words(refused.stderr).startswith(said)
