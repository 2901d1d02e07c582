"""Tables in a terminal of 80 columns: no number and no word is cut, whatever has to be folded."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from jointstiff.service.cli.app import app

EXAMPLES = Path(__file__).parents[3] / "examples"
WIDTH = 80
COMMANDS = (
    "identify campaign.json --details",
    "compare campaign.json",
    pytest.param("plan campaign.json", marks=pytest.mark.slow),
    "predict campaign.json EXAMPLES/postures.csv --load-point 0,0,120",
    "compensate campaign.json EXAMPLES/pocket.src -o out.src --accuracy-option off --force 0,0,-500",
    "import EXAMPLES/readings.csv",
    "robots 'KUKA KR 210 R2700'",
    pytest.param("geometry EXAMPLES/sweeps.json", marks=pytest.mark.slow),
    pytest.param("compare campaign.json secondary.json", marks=pytest.mark.slow),
    "map campaign.json --options plate.json",
)
"""Commands of README and the guides that print tables."""


PLATE = {
    "area": [[1.2, -0.2, 0.6], [1.6, 0.2, 0.9]],
    "grid": [2, 2, 2],
    "place": [0, 0, 0.25],
    "directions": [[0, 0, -1]],
    "force": [0, 300, -500],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaigns")
    (folder / "plate.json").write_text(json.dumps(PLATE))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for command in ("campaign.json", "secondary.json --encoders secondary --seed 2"):
            assert CliRunner().invoke(app, f"simulate {command}").exit_code == 0
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_prints_no_column_of_letters(command, folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", str(WIDTH))
    done = CliRunner().invoke(app, command.replace("EXAMPLES", str(EXAMPLES)))
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    assert max(map(len, lines)) <= WIDTH
    assert [line for line in lines if len(line.strip()) == 1] == []
