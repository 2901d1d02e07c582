"""The command line as a newcomer uses it: imports, catalogue, programs, keys; what it starts and refuses."""

import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from functools import partial

import numpy as np
import pytest
from support.importing_samples import CAMPAIGN, JOINTS, POINTS
from support.programs import options, path, tool_poses
from support.shared_data import shared
from support.terminal import terminal
from support.workbooks import table_of

from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import Campaign, Run
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.security.keys import Keyring, digest
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.programs import program_text
from jointstiff.solver.mechanics.configuration import flange_poses

run = partial(terminal, width=160)


@pytest.fixture
def campaign(tmp_path):
    path = tmp_path / "campaign.json"
    assert run("simulate", path, "--load", "dead_weight", "--seed", 2).exit_code == 0
    return path


def test_help_names_every_command_and_where_to_start():
    shown = run("--help").output
    for command in ("identify", "compare", "import", "serve", "worker", "simulate", "post", "demo"):
        assert command in shown
        assert run(command, "--help").exit_code == 0
    assert "jointstiff simulate campaign.json" in shown


def test_negative_stiffness_is_shown_as_what_it_is(tmp_path):
    document = shared("fanuc_r2000ic/campaign")
    del document["robot"]["joint_map"]
    path = tmp_path / "fanuc.json"
    path.write_text(json.dumps(document))
    assert "-1.86" in run("identify", path, "--no-positive").stdout
    constrained = run("identify", path).stdout
    assert "rigid" in constrained
    assert "cannot distinguish it from a rigid" in constrained


def test_simulate_does_not_overwrite(campaign):
    before = campaign.read_bytes()
    assert run("simulate", campaign).exit_code == 2
    assert campaign.read_bytes() == before
    assert run("simulate", campaign, "--overwrite", "--load", "dead_weight", "--seed", 2).exit_code == 0
    assert campaign.read_bytes() == before


@pytest.mark.parametrize("url", ["mysql://x/y", "nonsense", "sqlite:////proc/nothing/x.db"])
def test_serve_with_a_database_that_cannot_be(url):
    shown = run("serve", "--database", url, "--port", "0")
    assert shown.exit_code == 2
    assert "remedy" in shown.stderr


def test_serve_on_a_port_in_use(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        shown = run("serve", "--port", port, "--database", f"sqlite:///{tmp_path / 'x.db'}")
    assert shown.exit_code == 2
    assert f"cannot listen on 127.0.0.1:{port}" in shown.stderr


def test_post_follows_a_long_run(campaign, service):
    document = json.loads(campaign.read_text())
    document["run"] = {"resampling": {"size": 10, "repetitions": 100_000}}
    campaign.write_text(json.dumps(document))
    shown = run("post", campaign, "--server", service.url)
    assert shown.exit_code == 0, shown.stderr
    assert f"{service.url}/v1/runs/" in shown.stdout
    assert "Joint stiffness" in shown.stdout
    assert "100000 fits" in shown.stdout


@pytest.mark.process
def test_the_database_is_one_file_after_the_service_ends(tmp_path):
    path = tmp_path / "x.db"
    process = subprocess.Popen(
        [sys.executable, "-m", "jointstiff", "serve", "--port", "0", "--database", f"sqlite:///{path}"],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    assert str(path) in process.stdout.readline() + process.stdout.readline()
    process.terminate()
    assert process.wait(timeout=20) in {0, -signal.SIGTERM}
    process.stdout.close()
    assert [found.name for found in tmp_path.iterdir()] == ["x.db"]


@pytest.fixture
def tables(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in (("joints.csv", JOINTS), ("points.txt", POINTS), ("table.csv", CAMPAIGN)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


@pytest.fixture
def robot_file(tables):
    campaign = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=7)
    (tables / "campaign.json").write_text(json.dumps(campaign))
    (tables / "robot.json").write_text(json.dumps(campaign["robot"]))
    (tables / "cell.csv").write_bytes(table_of(campaign))
    return campaign


@pytest.mark.parametrize("robot", ["campaign.json", "robot.json"])
def test_a_campaign_that_can_be_identified(tables, robot_file, robot):
    point = ",".join(repr(1e3 * part) for part in robot_file["measurement_set"]["load_point"])
    sigma = 1e3 * robot_file["measurement_set"]["noise"]["sigma"]
    options = ("--robot", robot, "--encoders", "motor", "--load-point", point, "--sigma", sigma)
    shown = run("import", "cell.csv", *options, "--output", "new.json")
    assert shown.exit_code == 0, shown.output
    assert "jointstiff identify new.json" in shown.stderr
    found, expected = (
        Run.model_validate_json(terminal("identify", name, "--json").stdout)
        for name in ("new.json", "campaign.json")
    )
    assert found.result == expected.result
    table = (tables / "cell.csv").read_text(encoding="utf-8").splitlines()
    held = [f"{line}{table[0][5]}{'validation' if i == 0 else int(i == 1)}" for i, line in enumerate(table)]
    (tables / "held.csv").write_text("\n".join(held), encoding="utf-8")
    written = run("import", "held.csv", *options, "--output", "held.json")
    assert written.exit_code == 0, written.output
    left = terminal("identify", "held.json", "--json").stdout
    assert Run.model_validate_json(left).request.leave_out == [table[1].partition(table[0][5])[0]]
    kept = (tables / "new.json").read_bytes()
    again = run("import", "cell.csv", *options, "--output", "new.json", "--encoders", "secondary")
    assert (again.exit_code, (tables / "new.json").read_bytes()) == (2, kept)
    assert run("import", "cell.csv", *options, "--output", "new.json", "--overwrite").exit_code == 0


def test_lengths_are_in_millimetres_whatever_the_files_unit(tables):
    (tables / "table.csv").write_text(CAMPAIGN.replace("[mm]", "[m]"))
    arguments = ("--encoders", "motor", "--load-point", "0,0,120.5", "--sigma", "0.02", "--accept-unusual")
    shown = run("import", "table.csv", *arguments, "--output", "set.json", "--save-template", "t.json")
    assert shown.exit_code == 0, shown.output
    written = json.loads((tables / "set.json").read_text())
    assert (written["load_point"], written["noise"]["sigma"]) == ([0, 0, 0.1205], 2e-5)
    again = run("import", "table.csv", "--template", "t.json", "--output", "again.json", "--sigma", "0.03")
    assert again.exit_code == 0, again.output
    kept = json.loads((tables / "again.json").read_text())
    assert (kept["load_point"], kept["noise"]["sigma"]) == ([0, 0, 0.1205], pytest.approx(3e-5))


def test_unloaded_positions_and_masses_are_a_campaign_for_own_weight(tables):
    """A table of positions, a table of masses, a robot without any: `identify` needs no option."""
    from jointstiff.simulator.own_weight import unloaded_campaign

    campaign = unloaded_campaign(default_arm(), configurations=30, seed=4)
    bodies = campaign["robot"].pop("bodies")
    (tables / "arm.json").write_text(json.dumps(campaign["robot"]))
    rows = ["body,joint,mass [kg],± [%],centre x [m],centre y [m],centre z [m]"]
    rows += [f"{b['name']},{b['joint']},{b['mass']},10,{','.join(map(str, b['centre']))}" for b in bodies]
    (tables / "masses.csv").write_text("\n".join(rows) + "\n")
    (tables / "grid.csv").write_bytes(table_of(campaign) + b"\n")
    arguments = ("grid.csv", "masses.csv", "--encoders", "motor", "--sigma", "0.03", "--robot", "arm.json")
    shown = run("import", *arguments, "-o", "own.json")
    assert shown.exit_code == 0, shown.output
    assert f"masses: 6 bodies, {sum(b['mass'] for b in bodies):g} kg together" in shown.stdout
    assert "complete: a measurement set for the robot's own weight" in shown.stdout
    written = json.loads((tables / "own.json").read_text())
    assert written["run"] == {"weight": {}}
    assert [body["joint"] for body in written["robot"]["bodies"]] == [b["joint"] for b in bodies]
    found = terminal("identify", "own.json", "--json")
    assert found.exit_code == 0, found.output
    assert json.loads(found.stdout)["result"]["weight"] is not None


def test_unloaded_poses_are_written_for_a_geometry(tables, robot_file):
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
    (tables / "poses.csv").write_text("\n".join(lines) + "\n")
    columns = [f"--column=e{axis} [mm]=P unloaded plus {axis} [mm]" for axis in "xyz"]
    shown = run("import", "poses.csv", *columns, "--robot", "robot.json", "--output", "poses.json")
    assert shown.exit_code == 0, shown.output
    assert "complete: 30 unloaded poses for a geometry" in shown.stdout
    assert "jointstiff geometry poses.json" in shown.stderr
    found = terminal("geometry", "poses.json", "--json")
    assert found.exit_code == 0, found.output
    geometry = json.loads(found.stdout)
    assert geometry["result"]["goodness"]["sigma"] < 1e-8


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("arm", "said"),
    [("KUKA", "several arms"), ("KR 500", "no arm 'KR 500'"), ("robot.json", "no file 'robot.json'")],
)
def test_an_unclear_arm_is_refused_with_its_remedy(folder, arm, said):
    (folder / "table.csv").write_text("J1 [deg]\n0\n")
    for command in (("import", "table.csv", "--robot", arm), ("plan", arm)):
        refused = run(*command)
        assert refused.exit_code == 2
        assert said in refused.stderr
        assert "remedy" in refused.stderr


def test_a_table_and_the_name_of_an_arm_make_a_campaign(folder):
    campaign = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=7)
    (folder / "cell.csv").write_bytes(table_of(campaign))
    point = ",".join(repr(1e3 * part) for part in campaign["measurement_set"]["load_point"])
    options = ("--robot", "KUKA KR 210 R2700", "--encoders", "motor", "--load-point", point)
    about = ("--about", "serial_number=F-211034", "--about", "notes=load = 150 kg")
    when = ("--about", "measured_at=2026-11-20T14:30:00+01:00")
    new = (*about, *when, "--output", "new.json")
    assert run("import", "cell.csv", *options, *new).exit_code == 1, "another arm's readings: errors"
    assert not (folder / "new.json").exists()
    shown = run("import", "cell.csv", *options, *new, "--despite-errors")
    assert shown.exit_code == 0, shown.output
    written = Campaign.model_validate_json((folder / "new.json").read_text())
    assert written.robot.name == "KUKA KR 210 R2700 extra (nominal)"
    assert written.robot.joint_map is not None
    assert written.measurement_set.serial_number == "F-211034"
    assert written.measurement_set.notes == "load = 150 kg"
    assert written.measurement_set.measured_at == datetime(2026, 11, 20, 13, 30, tzinfo=UTC)
    for faulty, said in (
        ("serial=F", "serial"),
        ("measured_at=2026-11-20", "measured_at"),
        ("notes", "notes"),
    ):
        refused = run("import", "cell.csv", *options, "--about", faulty)
        assert refused.exit_code == 2
        assert f"--about.{said}" in refused.stderr


@pytest.fixture
def cell(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    (tmp_path / "campaign.json").write_text(json.dumps(campaign))
    (tmp_path / "path.src").write_text(program_text("krl", tool_poses(path(6)), 4), newline="")
    (tmp_path / "options.json").write_text(json.dumps(options("krl", axes="tool")))
    return tmp_path


def compensate(*arguments):
    command = ["compensate", "campaign.json", "path.src", "-o", "out.src", "--accuracy-option", "off"]
    return terminal(*command, *arguments)


def test_the_commands_options_keep_their_units_beside_a_file_in_others(cell):
    units = {"length": "mm", "angle": "rad", "force": "kN"}
    (cell / "units.json").write_text(json.dumps(options("krl", axes="tool") | {"units": units}))
    stated = ["--force", "0,0,-500", "--load-point", "0,0,150.5", "--start", "10,0,90,0,0,0"]
    request = json.loads(compensate("--options", "units.json", *stated, "--json").stdout)["request"]
    assert request["load"]["force"] == pytest.approx([0.0, 0.0, -0.5])
    assert request["load_point"] == pytest.approx([0.0, 0.0, 150.5])
    assert request["start"] == pytest.approx([math.radians(10), 0, math.radians(90), 0, 0, 0])
    with_rail = compensate("--options", "units.json", *stated[:-1], "10,0,90,0,0,0,1.5", "--overwrite")
    assert with_rail.exit_code == 2
    assert "linear axes" in with_rail.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--options", "options.json", "--load-point", "0,0,6000"], "6 m from the flange"),
        (["--options", "campaign.json"], "the file is a campaign"),
        (["--options", "options.json", "--accuracy-option", "compensates_load"], "twice"),
    ],
)
def test_refusals_write_nothing(cell, arguments, words):
    done = compensate(*arguments)
    assert done.exit_code == 2
    assert words in done.output
    assert not (cell / "out.src").exists()


def test_a_refusal_by_verdict_names_the_flag_of_the_terminal_alone(cell):
    campaign = json.loads((cell / "campaign.json").read_text())
    for observation in campaign["measurement_set"]["observations"]:
        observation["joints"] = [math.radians(angle) for angle in observation["joints"]]
    (cell / "campaign.json").write_text(json.dumps(campaign))
    refused = compensate("--options", "options.json")
    assert refused.exit_code == 2
    assert "to continue anyway, give `--despite-verdict`\n" in " ".join(refused.output.split()) + "\n"
    assert compensate("--options", "options.json", "--despite-verdict").exit_code == 0


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('{"robot": 1,}', "other.json: Invalid JSON: trailing comma at line 1 column 13"),
        ("x;y", "other.json is a text, not a JSON document"),
        ('{"robot": {}, "measurement_set": 1}', "other.json does not match the schema"),
    ],
)
def test_a_command_of_two_files_says_which_is_broken(cell, content, said):
    (cell / "other.json").write_text(content)
    done = terminal("compare", "campaign.json", "other.json")
    assert done.exit_code == 2
    assert said in done.output


@pytest.fixture
def command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return partial(terminal, "keys")


@pytest.mark.parametrize("place", [(), ("--keys-file", "keys.json")], ids=["database", "file"])
def test_a_key_is_made_listed_and_revoked(place, command, tmp_path):
    made = command("create", "tablet hall 3", "--role", "operator", "--expires", "2999-01-01", *place)
    assert made.exit_code == 0, made.output
    key = made.stdout.strip()  # and nothing else, for $(…)
    with Store.open("sqlite:///jointstiff.db") as store:
        keyring = Keyring(store, tmp_path / "keys.json" if place else None)
        keyring.look()
        found = keyring.check(key)
        assert (found.name, found.role) == ("tablet hall 3", "operator")
        assert found.expires_at == datetime(2999, 1, 1, tzinfo=UTC)
        listed = command("list", *place).stdout
        assert found.id in listed
        assert "2999-01-01" in listed
        assert key.split("_")[2] not in listed
        assert command("revoke", found.id, *place).exit_code == 0
        keyring.look()
        assert keyring.find(found.id) is None
        assert "revoked" in command("list", *place).stdout
        entries = store.audit.page(9).records
    noted = [(entry.operation, entry.address, entry.path) for entry in entries]
    path = f"/v1/keys/{found.id}"
    expected = [("revokeKey", "terminal", path), ("createKey", "terminal", path)]
    assert noted == ([] if place else expected)


@pytest.mark.parametrize(
    "arguments",
    [
        ("create", "x"),
        ("create", "x", "--role", "owner"),
        ("create", " ", "--role", "viewer"),
        ("create", "x", "--role", "viewer", "--expires", "2001-01-01"),
        ("create", "x", "--role", "viewer", "--keys-file", "missing/keys.json"),
        ("revoke", "0000000000"),
        ("link", "0000000000"),
        ("list", "--keys-file", "missing.json"),
    ],
)
def test_what_cannot_be_done_is_refused(arguments, command):
    ended = command(*arguments)
    assert ended.exit_code == 2
    assert "jst_" not in ended.stdout


def test_a_link_has_its_secret_after_the_number_sign_and_begins_a_session(command):
    key_id = command("create", "tablet", "--role", "viewer").stdout.split("_")[1]
    shown = command("link", key_id, "--server", "https://cell3.example/")
    assert shown.exit_code == 0, shown.output
    (token,) = re.findall(
        r"^https://cell3\.example/#/sign-in/(jsl_[A-Za-z0-9]{43})$", shown.stdout, re.MULTILINE
    )
    assert "█" in shown.stdout or "\x1b[" in shown.stdout  # the QR code
    now = datetime.now(UTC)
    with Store.open("sqlite:///jointstiff.db") as store:
        assert store.sessions.redeem(digest(token), now + timedelta(minutes=9)) == key_id


@pytest.mark.parametrize("arguments", [["list"], ["revoke", "x"], ["link", "x"]])
def test_a_database_that_is_not_there_is_not_made(arguments, tmp_path):
    database = tmp_path / "none.db"
    done = terminal("keys", *arguments, "--database", f"sqlite:///{database}")
    assert done.exit_code == 2
    assert "there is no database" in done.output
    assert not database.exists()
