"""A file to write with an ending that a command does not write: the answer names those that work."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from jointstiff.service.cli.app import app
from jointstiff.simulator import default_arm, simulate_campaign

EXAMPLES = Path(__file__).parents[3] / "examples"
POINTS = [str(EXAMPLES / "postures.csv"), "--load-point", "0,0,120"]


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    file = tmp_path_factory.mktemp("endings") / "campaign.json"
    file.write_text(json.dumps(simulate_campaign(default_arm(), configurations=12, load="pull", seed=1)))
    return str(file)


@pytest.mark.parametrize(
    ("command", "others", "ending", "said"),
    [
        ("compare", [], ".pdf", "must end in .csv; `jointstiff report` writes reports"),
        ("plan", [], ".docx", "must end in .csv"),
        ("predict", POINTS, ".pdf", "must end in .csv"),
        ("export", [], ".pdf", "must end in .csv, .xlsx or .mjcf; `jointstiff report` writes reports"),
        ("report", [], ".csv", "must end in .pdf or .html"),
        ("identify", [], ".pdf", "`jointstiff export` writes tables, `jointstiff report` writes reports"),
        ("identify", ["--apply", "use_huber"], ".pdf", "must end in .json"),
        ("import", [], ".csv", "must end in .json"),
        ("identify", [], ".json", "x.json` writes the whole result"),
        ("compare", [], ".json", "`--save x.json` writes the whole result"),
    ],
)
def test_the_answer_names_endings_that_work(campaign, tmp_path, command, others, ending, said):
    output = tmp_path / f"x{ending}"
    source = str(EXAMPLES / "readings.csv") if command == "import" else campaign
    result = CliRunner().invoke(app, [command, source, *others, "-o", str(output)])
    assert result.exit_code == 2
    assert said in " ".join(result.stderr.split())
    assert not output.exists()
