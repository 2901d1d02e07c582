"""What each command imports: it pays for what it uses. Counted in processes of their own."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from jointstiff.service.cli.app import app

pytestmark = pytest.mark.process

NUMERICS = {"numpy", "scipy", "pinocchio", "cvxpy", "clarabel"}
DATABASE = {"sqlalchemy", "psycopg"}
WEB = {"fastapi", "starlette", "uvicorn"}
OTHERS = {"httpx2", "rich"}
COMMANDS = ("geometry", "identify", "compare", "serve", "worker", "post", "demo", "simulate", "import")
PROGRAM = """
import json, sys
from jointstiff.service.cli.entry import main
sys.argv = ["jointstiff", *sys.argv[1:]]
try:
    main()
finally:
    print(json.dumps(sorted(sys.modules)), file=sys.stderr)
"""
HELP_OF_ALL = """
import contextlib, json, sys
from jointstiff.service.cli.entry import main
for command in sys.argv[1:]:
    sys.argv = ["jointstiff", command, "--help"]
    with contextlib.suppress(SystemExit):
        main()
print(json.dumps(sorted(sys.modules)), file=sys.stderr)
"""


def imported_by(program: str, *arguments: str) -> set[str]:
    """Names of the modules that a process has imported at its end."""
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return set(json.loads(done.stderr.splitlines()[-1]))


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    path = tmp_path_factory.mktemp("start") / "campaign.json"
    assert not imported_by(PROGRAM, "simulate", str(path)) & (DATABASE | WEB | {"scipy", "cvxpy"})
    return str(path)


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_the_command_itself_needs_little(option):
    assert not imported_by(PROGRAM, option) & (NUMERICS | DATABASE | WEB | OTHERS | {"pydantic"})


def test_help_of_all_commands_together_needs_little():
    # Typer itself imports pydantic where it is installed, to read a command's arguments.
    assert not imported_by(HELP_OF_ALL, *COMMANDS) & (NUMERICS | DATABASE | WEB | OTHERS)


@pytest.mark.parametrize("command", ["identify", "compare"])
def test_identification_needs_no_web_and_no_database(command, campaign):
    found = imported_by(PROGRAM, command, campaign)
    assert "clarabel" in found
    assert not found & (DATABASE | WEB | {"httpx2", "jointstiff.schemas.geometry"})


def test_an_import_computes_nothing(tmp_path):
    table = tmp_path / "readings.csv"
    table.write_text("point,x [mm],y [mm],z [mm]\nP1_A_unloaded,1,2,3\n")
    found = imported_by(PROGRAM, "import", str(table), "--point-name", "{label}_{target}_{state}")
    assert "jointstiff.service.importing.reading" in found
    assert not found & (NUMERICS | DATABASE | WEB | {"httpx2"})


def test_a_worker_serves_nothing():
    program = """
import json, sys
import jointstiff.service.workers.worker
print(json.dumps(sorted(sys.modules)), file=sys.stderr)
"""
    assert not imported_by(program) & WEB


@pytest.mark.process
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the device of a full disk")
@pytest.mark.parametrize("arguments", [["--help"], ["robots"]])
def test_output_that_finds_no_room_is_said(arguments):
    program = [sys.executable, "-c", "from jointstiff.service.cli.entry import main; main()", *arguments]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(program, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "cannot write: No space left on device\n  remedy: make room\n"


@pytest.mark.parametrize(
    ("line", "completed"),
    [
        ("ide", "identify"),
        ("identify --meth", "--method"),
        ("identify --method dec", "decoupled_partial_pose"),
    ],
)
def test_the_shell_completes_commands_options_and_values(line, completed):
    words = f"jointstiff {line}"
    environment = {"_JOINTSTIFF_COMPLETE": "complete_bash", "COMP_WORDS": words}
    environment["COMP_CWORD"] = str(len(words.split()) - 1)
    result = CliRunner().invoke(app, [], env=environment, prog_name="jointstiff")
    assert result.stdout.split() == [completed]
