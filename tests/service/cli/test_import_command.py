"""`jointstiff import`: what the command shows and asks, and the campaign that it writes."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from support.command_lines import assert_said, refused, typed
from support.importing_samples import CAMPAIGN
from support.measured_arms import measure, write_bare
from support.terminal import terminal
from support.workbooks import table_of

from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.cli import imports
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.mechanics.postures import flange_poses

DOCUMENT = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=7)
SET = DOCUMENT["measurement_set"]
POINT = ",".join(repr(1e3 * part) for part in SET["load_point"])
STATED = f"--encoders motor --load-point {POINT} --sigma {1e3 * SET['noise']['sigma']}"
ARM = "Yaskawa GP25"
run = partial(terminal, width=160)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Work in a folder with a campaign, its robot, its readings as a table, and readings without headers."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "campaign.json").write_text(json.dumps(DOCUMENT))
    (tmp_path / "robot.json").write_text(json.dumps(DOCUMENT["robot"]))
    (tmp_path / "robot.urdf").write_text(DOCUMENT["robot"]["model"]["urdf"])
    (tmp_path / "cell.csv").write_bytes(table_of(DOCUMENT))
    (tmp_path / "table.csv").write_text(CAMPAIGN)
    known = next(each for each in catalogue_robots() if each.name == ARM)
    joints, points = measure(known)
    write_bare(tmp_path / "j.txt", joints)
    write_bare(tmp_path / "u.txt", points[:, 0])
    write_bare(tmp_path / "l.txt", points[:, 0] - [0.03, 0.05, 0.6])
    return tmp_path


def identified(path):
    return json.loads(run("identify", path, "--json").stdout)


@pytest.mark.parametrize("robot", ["campaign.json", "robot.json", "robot.urdf --payload 240"])
def test_a_table_of_a_campaign_gives_the_result_of_the_campaign(folder, robot):
    shown = typed(f"import cell.csv --robot {robot} {STATED} --output new.json")
    assert_said(
        shown,
        "cell.csv, 6 rows",
        "B joints [rad] J1 [rad]",
        "deflections are along their force",
        "complete: 6 observations",
        "wrote new.json, a campaign; now: jointstiff identify new.json",
    )
    new, old = (identified(name)["result"] for name in ("new.json", "campaign.json"))
    assert [joint["compliance"] for joint in new["joints"]] == pytest.approx(
        [joint["compliance"] for joint in old["joints"]], rel=1e-9
    )


def test_without_a_robot_a_measurement_set_is_written_in_the_units_of_the_file(folder):
    shown = typed("import table.csv --encoders motor --load-point 0,0,120 --about operator=A -o set.json")
    assert_said(shown, "complete: 3 observations", "wrote set.json, a measurement set; now: add --robot")
    written = json.loads((folder / "set.json").read_text())
    assert (written["units"]["length"], written["operator"]) == ("mm", "A")
    assert written["observations"][1]["joints"] == [-15.0, -35.125, 42.75]
    assert written["observations"][1]["readings"] == [
        {
            "target": "P10",
            "unloaded": [1102.5518, 402.9017, 318.4406],
            "loaded": [1102.4127, 402.8613, 316.8891],
        }
    ]


def test_what_is_missing_is_one_question_and_the_option_that_answers_it(folder):
    shown = typed("import table.csv -o set.json", status=2)
    assert_said(
        shown,
        "? where on the flange does the load act (x, y, z in the flange frame [mm])?",
        "nothing was written: answer the question by --load-point, or correct the mapping",
    )
    assert not (folder / "set.json").exists()


def test_a_person_answers_one_question_after_the_other(folder, monkeypatch):
    monkeypatch.setattr(imports, "is_terminal_input", lambda: True)
    shown = typed("import table.csv -o set.json", input="0,0,120\n\n")
    assert_said(shown, "which encoders close the position loop", "x,y,z", "wrote set.json")
    assert json.loads((folder / "set.json").read_text())["encoders"] == "motor"


def test_a_script_takes_the_proposal_by_an_option_and_the_mapping_reads_the_next_files(folder):
    stated = f"--robot '{ARM}' --encoders motor --load-point 0,0,120 --force 9.18kg"
    shown = typed(f"import j.txt u.txt l.txt {stated} --yes -o c.json --save-mapping m.json")
    assert_said(shown, "u.txt, 16 rows", "A T1 unloaded [mm]", "wrote m.json", "wrote c.json, a campaign")
    mapping = json.loads((folder / "m.json").read_text())
    assert [part["table"] for part in mapping["tables"]] == [["j.txt"], ["u.txt"], ["l.txt"]]
    again = f"import j.txt u.txt l.txt --robot '{ARM}' --mapping m.json -o again.json"
    assert_said(typed(again), "wrote again.json, a campaign")
    first, second = (json.loads((folder / name).read_text()) for name in ("c.json", "again.json"))
    assert first["measurement_set"] == second["measurement_set"]
    force = first["measurement_set"]["observations"][0]["force"]
    assert force == pytest.approx([0.0, 0.0, -9.18 * 9.80665])


def test_a_file_is_replaced_only_by_an_option(folder):
    (folder / "new.json").write_text("kept")
    command = f"import cell.csv --robot robot.json {STATED} --output new.json"
    assert refused(command) == "new.json exists remedy: choose another name, or use --overwrite"
    assert (folder / "new.json").read_text() == "kept"
    typed(f"{command} --overwrite")
    assert json.loads((folder / "new.json").read_text())["measurement_set"]["encoders"] == "motor"


def test_unloaded_positions_are_poses_of_a_geometry(folder):
    robot = prepare_robot(RobotDocument.model_validate(DOCUMENT["robot"])).robot
    headers = [*(f"J{n} [deg]" for n in range(1, 7)), *(f"P unloaded {axis} [mm]" for axis in "xyz")]
    lines = [",".join(["label", *headers])]
    random = np.random.default_rng(3)
    for number in range(30):
        q = random.uniform(-1.5, 1.5, 6)
        flange = flange_poses(robot, q[None])[0]
        place = 1e3 * (flange[:3, :3] @ (0.05, 0.02, 0.2) + flange[:3, 3])
        numbers = [*np.degrees(robot.joint_map.controller_angles(q)), *place]
        lines.append(f"{number}," + ",".join(f"{value:.9f}" for value in numbers))
    (folder / "poses.csv").write_text("\n".join([*lines, ""]))
    shown = typed("import poses.csv --robot robot.json --output poses.json")
    assert_said(shown, "complete: 30 unloaded poses", "now: jointstiff geometry poses.json")
    assert json.loads(run("geometry", "poses.json", "--json").stdout)["result"]["sigma"] < 1e-8


def test_readings_with_errors_are_written_only_despite_errors(folder):
    rows = [line.split(";") for line in (folder / "cell.csv").read_text().splitlines()]
    column = rows[0].index("J6 [rad]")
    for row in rows[1:]:
        row[column] = repr(-float(row[column]))
    (folder / "wrong.csv").write_text("\n".join(";".join(row) for row in rows))
    command = f"import wrong.csv --robot robot.json {STATED} --output new.json"
    shown = typed(command, status=1)
    assert_said(shown, "! ", "nothing was written: correct the errors, or state --despite-errors")
    assert not (folder / "new.json").exists()
    typed(f"{command} --despite-errors")
    assert json.loads((folder / "new.json").read_text())["measurement_set"]["observations"]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("--payload 1", "needs the robot: add --robot"),
        ("--robot robot.urdf --payload 0.01", "greater than or equal to 0.1"),
        ("--load-point 1,2", "'1,2' must be three numbers in mm, such as 0,0,120.5"),
        ("--flange-target P10", "'P10' must be TARGET=X,Y,Z"),
        ("--force heavy", "'heavy' must be three numbers in N"),
        ("--mapping table.csv", "table.csv is a text, not a JSON document"),
        ("--encoders motor --load-point 0,0,1 -o set.json --about colour=red", "unknown field"),
        ("--encoding klingon-1", "the file is not encoded in klingon-1"),
    ],
)
def test_a_wrong_option_is_refused_with_its_reason(line, said):
    assert said in refused(f"import table.csv {line}")
    assert not Path("set.json").exists()
