"""Commands that are refused before anything is written; simulated campaigns; words that a shell completes."""

import json
from functools import partial

import numpy as np
import pytest
from support.programs import options, path, tool_poses
from support.terminal import terminal
from typer.testing import CliRunner

from jointstiff.service.cli.app import app
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.programs import program_text

KRL = options("krl", axes="tool")
LOAD = ["--force", "0,0,-500", "--load-point", "0,0,150.5"]
run = partial(terminal, width=160)


def words(text):
    """Return a text of the terminal without line ends."""
    return " ".join(text.split())


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Work in a folder with a campaign, a program and its options."""
    monkeypatch.chdir(tmp_path)
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    radians = KRL | {"units": {"length": "mm", "angle": "rad", "force": "kN"}}
    files = {"pull": document, "options": KRL, "radians": radians}
    for name, content in files.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    (tmp_path / "path.src").write_text(program_text("krl", tool_poses(path(6)), 4))
    return tmp_path


def correct(name, *others, off=True):
    option = ["--accuracy-option", "off"] if off and "--accuracy-option" not in others else []
    return run("correct", "pull.json", "path.src", "-o", "out.src", *option, "--options", name, *others)


def test_lengths_and_angles_at_the_terminal_become_those_of_the_file(folder):
    shown = correct("radians.json", *LOAD, "--start", "10,0,90,0,0,0", "--json")
    request = json.loads(shown.stdout)["request"]
    assert request["force"] == pytest.approx([0.0, 0.0, -0.5])
    assert request["load_point"] == pytest.approx([0.0, 0.0, 150.5])
    assert request["start"] == pytest.approx(np.radians([10.0, 0.0, 90.0, 0.0, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ["radians.json", *LOAD, "--start", "10,0,90,0,0,0,1.5"],
            "Error: Invalid value for --start: the unit of angles in the file of options is rad, so values "
            "of linear "
            "axes in deg cannot be converted; remedy: state `start` in the file "
            "of options, in the units of this file",
        ),
        (
            ["options.json", "--load-point", "0,0,6000"],
            "load_point: the point is 6 m from the flange, where no tool reaches; up to 5 m is plausible "
            "remedy: check the unit of the point; for a longer tool, put the flange of the robot's model "
            "on the tool",
        ),
        (["pull.json"], "the file is a campaign remedy: use `jointstiff identify FILE`"),
        (
            ["options.json", "--accuracy-option", "compensates_load"],
            "accuracy_option: the controller already compensates the deflection under load, so a "
            "second compensation would be wrong "
            "remedy: switch the controller's accuracy option off, repeat the measurement, and set "
            "`--accuracy-option` to `off`",
        ),
    ],
)
def test_a_program_that_cannot_be_corrected_is_not_written(folder, arguments, said):
    refused = correct(*arguments)
    assert refused.exit_code == 2
    assert words(refused.stderr).endswith(said)
    assert not (folder / "out.src").exists()


def test_a_run_names_the_commands_that_take_its_numbers_despite_the_verdict(folder):
    turned = json.loads((folder / "pull.json").read_text())
    for one in turned["measurement_set"]["observations"]:
        one["joints"] = np.radians(one["joints"]).tolist()
    (folder / "pull.json").write_text(json.dumps(turned))
    shown = words(terminal("identify", "pull.json").stdout)
    past = (
        "if the numbers are right, state `--despite-verdict` in each map, program, plan or export of the run"
    )
    assert past in shown
    assert "accept_verdict" not in shown


def test_a_result_that_must_not_be_used_corrects_no_program(folder):
    turned = json.loads((folder / "pull.json").read_text())
    for one in turned["measurement_set"]["observations"]:
        one["joints"] = np.radians(one["joints"]).tolist()
    # Without this ground, joint 6 has no number to correct with.
    turned["measurement_set"]["noise"]["grounds"] = {"load_point": "tracker"}
    (folder / "pull.json").write_text(json.dumps(turned))
    refused = correct("options.json")
    assert refused.exit_code == 2
    assert words(refused.stderr) == (
        "The result must not be used all readings: the angles seem to be in rad, not in deg as declared: "
        "with the data as given, the targets keep their positions on the flange (up to 20 mm is plausible) "
        "in only 1 of 12 observations; with all angles taken as radians, in 12 of 12, within 5.12 mm; set "
        "`units.angle` to rad; "
        "if the numbers are right, state `--despite-verdict` in each map, program, plan or export of the run "
        "remedy: follow the remedies of the reasons and identify again; "
        "to continue anyway, give `--despite-verdict`"
    )
    assert not (folder / "out.src").exists()
    assert correct("options.json", "--despite-verdict").exit_code == 0
    assert (folder / "out.src").exists()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            '{"robot": 1,}',
            "other.json: Invalid JSON: trailing comma at line 1 column 13 remedy: correct the JSON at this "
            "place; to read tables and point lists use `jointstiff import FILE`",
        ),
        (
            "x;y",
            "other.json is a text, not a JSON document "
            "remedy: to read tables and point lists use `jointstiff import FILE`; to correct a robot program "
            "use `jointstiff correct CAMPAIGN other.json`",
        ),
        (
            '{"robot": {}, "measurement_set": 1}',
            "other.json does not match the schema robot.name: required field is missing; add this field "
            "robot.model: required field is missing; add this field measurement_set: must be an object; "
            "give its fields by name, in braces",
        ),
    ],
)
def test_of_two_files_the_one_that_is_broken_is_named(folder, content, said):
    (folder / "other.json").write_text(content)
    refused = run("compare", "pull.json", "other.json")
    assert (refused.exit_code, words(refused.stderr)) == (2, said)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "a campaign or robot, --goal and --source are needed"),
        (["campaign.json", "--goal", "15 %"], "a campaign or robot, --goal and --source are needed"),
        (["--bridge", "simulated:1", "--server", "http://127.0.0.1:9"], "--bridge needs --server and --code"),
        (
            ["campaign.json", "--bridge", "simulated:1"],
            "--bridge cannot be combined with a campaign, --goal or --source",
        ),
    ],
)
def test_measure_says_what_it_lacks(arguments, said):
    shown = CliRunner().invoke(app, ["measure", *arguments])
    assert shown.exit_code == 2
    assert said in words(shown.stderr)


def test_a_simulated_campaign_depends_on_its_seed_alone_and_replaces_no_file(folder):
    kept = (folder / "pull.json").read_bytes()
    refused = run("simulate", "pull.json")
    assert (refused.exit_code, words(refused.stderr)) == (
        2, "pull.json exists remedy: choose another name, or use --overwrite"
    )  # fmt: skip
    assert (folder / "pull.json").read_bytes() == kept
    written = []
    for seed in (2, 2, 3):
        assert (
            run("simulate", "s.json", "--overwrite", "--load", "dead_weight", "--seed", seed).exit_code == 0
        )
        written.append((folder / "s.json").read_bytes())
    assert written[0] == written[1] != written[2]


def test_the_help_lists_the_commands_in_the_order_of_work():
    shown = terminal("--help").stdout
    lines = shown[shown.index("Commands:") :].splitlines()[1:]
    assert [line.split()[0] for line in lines] == [
        "simulate", "examples", "rehearse", "identify", "compare", "geometry", "gearbox", "plan", "map",
        "correct", "measure", "import", "predict", "robots", "export", "report",
        "serve", "worker", "status", "post", "demo", "archive", "restore", "keys", "database",
    ]  # fmt: skip
    assert "  identify  Identify the joint stiffnesses of a campaign." in lines
    assert "  keys      Create, list and revoke the keys that open a service." in lines
    assert (
        "Start with `jointstiff simulate campaign.json`, then `jointstiff identify campaign.json`."
        in words(shown)
    )


@pytest.mark.parametrize(
    ("line", "completed"),
    [
        ("ide", "identify"),
        ("identify --meth", "--method"),
        ("identify --method dec", "decoupled_partial_pose"),
    ],
)
def test_a_shell_completes_commands_options_and_values(line, completed):
    typed = f"jointstiff {line}"
    count = str(len(typed.split()) - 1)
    environment = {"_JOINTSTIFF_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": count}
    assert CliRunner().invoke(app, [], env=environment, prog_name="jointstiff").stdout.split() == [completed]
