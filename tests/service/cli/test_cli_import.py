"""`jointstiff import`: a preview first, a campaign on demand, places of mistakes."""

import json

import numpy as np
import pytest
from support.importing_samples import CAMPAIGN, JOINTS, POINTS
from support.terminal import terminal
from support.workbooks import table_of

from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.mechanics.configuration import flange_poses


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in (("joints.csv", JOINTS), ("points.txt", POINTS), ("table.csv", CAMPAIGN)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


@pytest.fixture
def robot_file(folder):
    campaign = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=7)
    (folder / "campaign.json").write_text(json.dumps(campaign))
    (folder / "robot.json").write_text(json.dumps(campaign["robot"]))
    (folder / "cell.csv").write_bytes(table_of(campaign))
    return campaign


def run(*arguments):
    return terminal("import", *arguments, width=160)


@pytest.mark.parametrize("robot", ["campaign.json", "robot.json"])
def test_a_campaign_that_can_be_identified(folder, robot_file, robot):
    point = ",".join(repr(1e3 * part) for part in robot_file["measurement_set"]["load_point"])
    sigma = 1e3 * robot_file["measurement_set"]["noise"]["sigma"]
    options = ("--robot", robot, "--encoders", "motor", "--load-point", point, "--sigma", sigma)
    shown = run("cell.csv", *options, "--output", "new.json")
    assert shown.exit_code == 0, shown.output
    assert "jointstiff identify new.json" in shown.stderr
    found, expected = (
        Run.model_validate_json(terminal("identify", name, "--json").stdout)
        for name in ("new.json", "campaign.json")
    )
    assert found.result == expected.result
    table = (folder / "cell.csv").read_text(encoding="utf-8").splitlines()
    held = [f"{line}{table[0][5]}{'validation' if i == 0 else int(i == 1)}" for i, line in enumerate(table)]
    (folder / "held.csv").write_text("\n".join(held), encoding="utf-8")
    written = run("held.csv", *options, "--output", "held.json")
    assert written.exit_code == 0, written.output
    left = terminal("identify", "held.json", "--json").stdout
    assert Run.model_validate_json(left).request.leave_out == [table[1].partition(table[0][5])[0]]
    kept = (folder / "new.json").read_bytes()
    again = run("cell.csv", *options, "--output", "new.json", "--encoders", "secondary")
    assert (again.exit_code, (folder / "new.json").read_bytes()) == (2, kept)
    assert run("cell.csv", *options, "--output", "new.json", "--overwrite").exit_code == 0


def test_lengths_are_in_millimetres_whatever_the_files_unit(folder):
    (folder / "table.csv").write_text(CAMPAIGN.replace("[mm]", "[m]"))
    arguments = ("--encoders", "motor", "--load-point", "0,0,120.5", "--sigma", "0.02", "--accept-unusual")
    shown = run("table.csv", *arguments, "--output", "set.json", "--save-template", "t.json")
    assert shown.exit_code == 0, shown.output
    written = json.loads((folder / "set.json").read_text())
    assert (written["load_point"], written["noise"]["sigma"]) == ([0, 0, 0.1205], 2e-5)
    again = run("table.csv", "--template", "t.json", "--output", "again.json", "--sigma", "0.03")
    assert again.exit_code == 0, again.output
    kept = json.loads((folder / "again.json").read_text())
    assert (kept["load_point"], kept["noise"]["sigma"]) == ([0, 0, 0.1205], pytest.approx(3e-5))


def test_unloaded_positions_and_masses_are_a_campaign_for_own_weight(folder):
    """A table of positions, a table of masses, a robot without any: `identify` needs no option."""
    from jointstiff.simulator.own_weight import unloaded_campaign

    campaign = unloaded_campaign(default_arm(), configurations=30, seed=4)
    bodies = campaign["robot"].pop("bodies")
    (folder / "arm.json").write_text(json.dumps(campaign["robot"]))
    rows = ["body,joint,mass [kg],± [%],centre x [m],centre y [m],centre z [m]"]
    rows += [f"{b['name']},{b['joint']},{b['mass']},10,{','.join(map(str, b['centre']))}" for b in bodies]
    (folder / "masses.csv").write_text("\n".join(rows) + "\n")
    (folder / "grid.csv").write_bytes(table_of(campaign) + b"\n")
    arguments = ("grid.csv", "masses.csv", "--encoders", "motor", "--sigma", "0.03", "--robot", "arm.json")
    shown = run(*arguments, "-o", "own.json")
    assert shown.exit_code == 0, shown.output
    assert f"masses: 6 bodies, {sum(b['mass'] for b in bodies):g} kg together" in shown.stdout
    assert "complete: a measurement set for the robot's own weight" in shown.stdout
    written = json.loads((folder / "own.json").read_text())
    assert written["run"] == {"weight": {}}
    assert [body["joint"] for body in written["robot"]["bodies"]] == [b["joint"] for b in bodies]
    found = terminal("identify", "own.json", "--json")
    assert found.exit_code == 0, found.output
    assert json.loads(found.stdout)["result"]["weight"] is not None


def test_unloaded_poses_are_written_for_a_geometry(folder, robot_file):
    """Positions without load of a simulated arm, each as a target and a deviation."""
    campaign = robot_file
    head = "label," + ",".join(f"J{number} [deg]" for number in range(1, 7))
    lines = [head + "".join(f",P unloaded {axis} [mm]" for axis in "xyz") + ",ex [mm],ey [mm],ez [mm]"]
    rng = np.random.default_rng(3)
    robot = prepare_robot(RobotDocument.model_validate(campaign["robot"])).robot
    for number in range(30):
        q = rng.uniform(-1.5, 1.5, 6)
        flange = flange_poses(robot, q[None])[0]
        place = 1e3 * (flange[:3, :3] @ (0.05, 0.02, 0.2) + flange[:3, 3])
        parts = [np.degrees(robot.joint_map.controller_angles(q)), place - 1.0, np.ones(3)]
        lines.append(f"{number}," + ",".join(f"{value:.9f}" for part in parts for value in part))
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    columns = [f"--column=e{axis} [mm]=P unloaded plus {axis} [mm]" for axis in "xyz"]
    shown = run("poses.csv", *columns, "--robot", "robot.json", "--output", "poses.json")
    assert shown.exit_code == 0, shown.output
    assert "complete: 30 unloaded poses for a geometry" in shown.stdout
    assert "jointstiff geometry poses.json" in shown.stderr
    found = terminal("geometry", "poses.json", "--json")
    assert found.exit_code == 0, found.output
    geometry = json.loads(found.stdout)
    assert geometry["result"]["goodness"]["sigma"] < 1e-8
