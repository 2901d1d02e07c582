"""The command `compensate`: files in, files out, and refusals that say what to do."""

import json
import math
import os

import pytest
from support.programs import options, path, tool_poses
from support.terminal import terminal

from jointstiff.service.programs.formats import read_program
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.programs import program_text


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    (tmp_path / "campaign.json").write_text(json.dumps(campaign))
    (tmp_path / "path.src").write_text(program_text("krl", tool_poses(path(6)), 4), newline="")
    (tmp_path / "options.json").write_text(json.dumps(options("krl", axes="tool")))
    return tmp_path


def compensate(*arguments):
    command = ["compensate", "campaign.json", "path.src", "-o", "out.src", "--accuracy-option", "off"]
    return terminal(*command, *arguments)


def test_a_program_and_its_report(folder):
    done = compensate("--options", "options.json", "--report", "points.csv")
    assert done.exit_code == 0, done.output
    assert "6 of 6 targets corrected" in done.output
    assert done.output.count("[mm]") == 4
    assert len((folder / "points.csv").read_text().splitlines()) == 7
    content = (folder / "out.src").read_bytes()
    assert len(read_program([("out.src", content)]).targets) == 6
    assert content.count(b"\r\n") == (folder / "path.src").read_bytes().count(b"\r\n")
    again = compensate("--options", "options.json")
    assert again.exit_code == 2
    assert "exists" in again.output
    point = ["--load-point", "0,0,150.5"]
    other = compensate("--options", "options.json", "--axes", "robot", *point, "--overwrite", "--json")
    request = json.loads(other.stdout)["request"]
    assert request["axes"] == "robot"
    assert request["units"]["length"] == "mm"  # those of the file, and the terminal's are mm, too
    assert request["load_point"] == pytest.approx([0.0, 0.0, 150.5])
    assert (folder / "out.src").read_bytes() != content


def test_the_commands_options_keep_their_units_beside_a_file_in_others(folder):
    units = {"length": "mm", "angle": "rad", "force": "kN"}
    (folder / "units.json").write_text(json.dumps(options("krl", axes="tool") | {"units": units}))
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
        ([], "state the load"),
        (["--force", "0,0,-500"], "TOOL_DATA[1]"),
        (["--options", "options.json", "--load-point", "0,0,6000"], "6 m from the flange"),
        (["--options", "campaign.json"], "the file is a campaign"),
        (["--options", "path.src"], "Invalid JSON"),
        (["--options", os.devnull], "is empty"),
        (["--options", "options.json", "--accuracy-option", "compensates_load"], "twice"),
        (["--options", "options.json", "--tool", "a,b"], "must be numbers"),
    ],
)
def test_refusals_write_nothing(folder, arguments, words):
    done = compensate(*arguments)
    assert done.exit_code == 2
    assert words in done.output
    assert not (folder / "out.src").exists()


def test_moves_are_explained_and_left_where_asked(folder):
    program = folder / "path.src"
    head, _, tail = program.read_text().rpartition("END")
    program.write_text(f"{head}LIN_REL {{X 5}}\nEND{tail}", newline="")
    explain = ["compensate", "campaign.json", "path.src", "--explain"]
    shown = terminal(*explain)
    assert shown.exit_code == 0, shown.output
    assert "6 of 7 moves can be corrected, 1 left" in shown.output
    rows = json.loads(terminal(*explain, "--json").stdout)
    assert [row["corrected"] for row in rows] == [True] * 6 + [False]
    assert (rows[0]["base"], rows[0]["tool"]) == ("BASE_DATA[1]", "TOOL_DATA[1]")
    assert "relative move" in rows[-1]["reason"]
    assert "relative move" in compensate("--options", "options.json").output
    done = compensate("--options", "options.json", "--leave-others")
    assert done.exit_code == 0, done.output
    assert "6 of 7 moves corrected, 1 left" in (folder / "out.src").read_text()
    assert "Use this program with care: 1 reason of its own" in done.output
