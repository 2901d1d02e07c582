"""The command `compensate`: files in, files out, and refusals that say what to do."""

import json
import math

import pytest
from support.programs import options, path, tool_poses
from support.terminal import terminal

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
        (["--options", "options.json", "--load-point", "0,0,6000"], "6 m from the flange"),
        (["--options", "campaign.json"], "the file is a campaign"),
        (["--options", "options.json", "--accuracy-option", "compensates_load"], "twice"),
    ],
)
def test_refusals_write_nothing(folder, arguments, words):
    done = compensate(*arguments)
    assert done.exit_code == 2
    assert words in done.output
    assert not (folder / "out.src").exists()


def test_a_refusal_by_verdict_names_the_flag_of_the_terminal_alone(folder):
    campaign = json.loads((folder / "campaign.json").read_text())
    for observation in campaign["measurement_set"]["observations"]:
        observation["joints"] = [math.radians(angle) for angle in observation["joints"]]
    (folder / "campaign.json").write_text(json.dumps(campaign))
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
def test_a_command_of_two_files_says_which_is_broken(folder, content, said):
    (folder / "other.json").write_text(content)
    done = terminal("compare", "campaign.json", "other.json")
    assert done.exit_code == 2
    assert said in done.output
