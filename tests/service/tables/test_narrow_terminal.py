"""Tables in a terminal of 80 columns: no number and no word is cut, whatever has to be folded."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from jointstiff.service.cli.app import app
from jointstiff.service.tables.table import Column, Line, Table, number
from jointstiff.service.tables.terminal import printed

EXAMPLES = Path(__file__).parents[3] / "examples"
WIDTH = 80
COMMANDS = (
    "identify campaign.json --details",
    "compare campaign.json",
    "plan campaign.json",
    "predict campaign.json EXAMPLES/postures.csv --load-point 0,0,120",
    "compensate campaign.json EXAMPLES/pocket.src -o out.src --accuracy-option off --force 0,0,-500",
    "import EXAMPLES/readings.csv",
    "robots 'KUKA KR 210 R2700'",
    "geometry EXAMPLES/sweeps.json",
    "compare campaign.json secondary.json",
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


def lines_of(*parts):
    console = Console(file=io.StringIO(), width=WIDTH)
    console.print(printed(parts))
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_prints_no_column_of_letters(command, folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", str(WIDTH))
    done = CliRunner().invoke(app, command.replace("EXAMPLES", str(EXAMPLES)))
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    assert max(map(len, lines)) <= WIDTH
    assert [line for line in lines if len(line.strip()) == 1] == []


def test_a_prediction_names_its_case_in_one_line(folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", str(WIDTH))
    predict = next(command for command in COMMANDS if command.startswith("predict"))
    done = CliRunner().invoke(app, predict.replace("EXAMPLES", str(EXAMPLES)))
    row = next(line for line in done.output.splitlines() if line.startswith("drill"))
    assert row.count("±") == 3


def test_numbers_stay_whole_and_long_names_are_folded():
    name = "upper left corner of the pocket, second pass"
    values = [f"-{i}23.456 ± 0.789" for i in range(3)]
    columns = [
        Column("place", [name], text=True),
        *(
            Column(f"deflection along {axis}", [value], unit="mm")
            for axis, value in zip("xyz", values, strict=True)
        ),
    ]
    text = "\n".join(lines_of(Table(columns)))
    assert all(value in text for value in values)
    assert all(word in text for word in name.replace(",", "").split())
    assert text.count("[mm]") == 3


def test_columns_that_do_not_fit_beside_each_other_come_in_parts():
    joints = [f"joint_{j + 1}" for j in range(16)]
    columns = [
        Column("reading", ["p01", "p02"], text=True),
        *(Column(name, [-100.0 - j, 17.25], number(".2f"), "°") for j, name in enumerate(joints)),
    ]
    lines = lines_of(Table(columns, title="Readings", caption="in order"))
    text = "\n".join(lines)
    assert all(text.split().count(f"{-100.0 - j:.2f}") == 1 for j in range(len(joints)))
    assert all(text.split().count(name) == 1 for name in joints)
    assert (text.count("p01"), text.count("Readings"), text.count("in order")) == (2, 1, 1)
    assert max(map(len, lines)) <= WIDTH


def test_what_is_wrapped_goes_on_below_its_first_word():
    words = "measure where the force acts on the flange " * 4
    assert {line[:5] for line in lines_of(Line(f"  1. {words}"))[1:]} == {" " * 5}
    assert {line[:2] for line in lines_of(Line(f"  {words}"))} == {"  "}
    assert lines_of(Line("Use"), Line("")) == ["Use", ""]
