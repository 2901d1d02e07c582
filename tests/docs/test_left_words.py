"""No word of what has left is in the API, in the help of commands, on the page, or in the documentation."""

import json
import re
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from jointstiff.service.cli.app import app

ROOT = Path(__file__).parents[2]
LEFT = (
    "fleet",
    "AsyncClient",
    "connections-per-address",
    "rehearsal.json",
    "report.xml",
    "palette",
    "kNm/deg",
    "urad/Nm",
    "unevaluatedProperties",
    "turn and place",
    "/v1/processes",
    "js.process",
    "client.process",
    "jointstiff process",
    "/v1/programs",
    "js.compensate",
    "client.compensate",
    "jointstiff compensate",
    "compensated program",
    "ProgramOptions",
    "ProgramRequest",
    "ProcessOptions",
    "ProcessRequest",
    "js.import_files",
    "--save-template",
    "--state-word",
    "accept_proposal",
    "accept_unusual",
)


def files_of(*patterns):
    """Return the texts of files, but not of those that are made from the description of the API."""
    paths = [path for each in patterns for path in sorted(ROOT.glob(each)) if path.suffixes != [".d", ".ts"]]
    return "\n".join(path.read_text(encoding="utf-8") for path in paths)


@pytest.fixture(scope="module")
def texts(openapi):
    # Stored jobs of a kind that has left are listed and answered for ever: the kind is a value.
    schemas = openapi["components"]["schemas"]
    messages = {name: each for name, each in schemas.items() if not name.startswith("Retired")}
    described = json.dumps([openapi["paths"], messages])
    commands = typer.main.get_command(app).commands
    runner = CliRunner()
    return {
        "API": re.sub(r'"#/components/schemas/Retired\w+"|"fleet"', "", described),
        "help": "\n".join(runner.invoke(app, [name, "--help"]).output for name in commands),
        "page": files_of("dashboard/src/**/*.ts", "dashboard/src/**/*.tsx", "dashboard/src/*.css"),
        "docs": files_of("docs/*.md", "README.md", "SECURITY.md", "docker/README.md"),
    }


@pytest.mark.parametrize("place", ["API", "help", "page", "docs"])
@pytest.mark.parametrize("word", LEFT)
def test_no_word_of_what_has_left_is_found(word, place, texts):
    assert len(texts[place]) > 20_000
    found = re.search(rf"(?i).{{0,60}}{re.escape(word)}.{{0,60}}", texts[place])
    assert found is None
