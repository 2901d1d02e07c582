"""No command writes over a file that the command reads, also not with --overwrite."""

import json
import re
from pathlib import Path

import pytest
import typer
from support.command_lines import refused, typed
from support.programs import options, path, tool_poses

from jointstiff.service.cli.app import _LATE_COMMANDS, _build_late_command
from jointstiff.service.cli.demo import rehearse
from jointstiff.service.cli.models import export, report, robots
from jointstiff.service.cli.options import WRITTEN
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.files import example_files
from jointstiff.simulator.programs import program_text

NAMES_A_WRITTEN_FILE = re.compile(
    "(Write|File|CSV file).*( to write|whole result|for the .* program|mapping)"
)
REMEDY = "choose another name or another folder for the file to write"
CORRECTED = "correct pull.json path.src --options options.json"
IMPORTED = "import readings.csv --robot arm.json --encoders motor"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    Path("pull.json").write_text(json.dumps(document))
    Path("arm.json").write_text(json.dumps(document["robot"]))
    Path("path.src").write_text(program_text("krl", tool_poses(path(4)), 4))
    Path("options.json").write_text(json.dumps(options("krl")))
    Path("linked.src").symlink_to("path.src")
    for name, text in example_files():
        if name in {"readings.csv", "poses.csv", "sweeps.json"}:
            Path(name).write_text(text)
    return tmp_path


@pytest.mark.parametrize(
    ("line", "kept"),
    [
        (f"{CORRECTED} -o path.src", "path.src"),
        (f"{CORRECTED} -o linked.src", "path.src"),
        (f"{CORRECTED} -o .", "path.src"),
        (f"{CORRECTED} -o out.src --save options.json", "options.json"),
        (f"{CORRECTED} -o ../{{folder}}/path.src", "path.src"),
        ("correct pull.json poses.csv --force 0,0,-500 -o poses.csv", "poses.csv"),
        ("predict pull.json poses.csv --load-point 0,0,120 -o poses.csv", "poses.csv"),
        ("identify pull.json --save pull.json", "pull.json"),
        ("identify pull.json --apply omit_noise -o pull.json", "pull.json"),
        ("geometry sweeps.json --robot arm.json -o arm.json", "arm.json"),
        ("plan pull.json --campaign pull.json", "pull.json"),
        ("rehearse pull.json --save pull.json", "pull.json"),
        (f"{IMPORTED} --load-point 0,0,120 -o arm.json", "arm.json"),
        ("measure pull.json --goal '30 %' --source simulated:1 --yes --save pull.json", "pull.json"),
    ],
)
@pytest.mark.parametrize("overwrite", ["", " --overwrite"])
def test_an_input_is_never_replaced(line, kept, overwrite, folder):
    before = Path(kept).read_bytes()
    answer = refused(line.format(folder=folder.name) + overwrite)
    assert answer.endswith(f"is an input of this command; its content would be lost remedy: {REMEDY}")
    assert Path(kept).read_bytes() == before


def test_another_name_or_folder_keeps_the_input():
    before = Path("path.src").read_bytes()
    Path("corrected").mkdir()
    for output in ("new.src", "corrected"):
        assert "targets are corrected" in typed(f"{CORRECTED} -o {output}")
        assert "targets are corrected" in typed(f"{CORRECTED} -o {output} --overwrite")
    assert Path("corrected/path.src").read_bytes() == Path("new.src").read_bytes() != before
    assert Path("path.src").read_bytes() == before


def test_every_option_that_names_a_file_to_write_is_known():
    app = typer.Typer()
    for function in (export, report, robots, rehearse):
        app.command()(function)
    commands = [*typer.main.get_command(app).commands.values(), *map(_build_late_command, _LATE_COMMANDS)]
    options = [parameter for command in commands for parameter in command.params]
    written = {
        option.name
        for option in options
        if re.match(
            r"(Write|File|CSV file).*( to write|whole result|for the .* program|mapping)", option.help or ""
        )
    }
    assert written - {"template"} == WRITTEN
