"""What each command imports, and the demonstration, which starts and ends everything. In processes."""

import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing, suppress
from pathlib import Path

import pytest
from support.importing_samples import CAMPAIGN

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


def test_an_import_without_a_robot_needs_no_web_no_database_and_no_solver(tmp_path):
    table = tmp_path / "readings.csv"
    table.write_text(CAMPAIGN)
    found = imported_by(PROGRAM, "import", str(table), "--encoders", "motor", "--load-point", "0,0,120")
    assert "jointstiff.service.imports.answer" in found
    assert not found & (DATABASE | WEB | {"httpx2", "clarabel", "cvxpy"})


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
    assert done.stderr == "cannot write: No space left on device\n  remedy: free space for the output\n"


COMMAND = [sys.executable, "-m", "jointstiff", "demo", "--port", "0"]
LONGEST_SECONDS = 30


def shown(folder: Path) -> str:
    """Run the demonstration to its end in a folder; return what it prints."""
    environment = os.environ | {"JOINTSTIFF_DATABASE": f"sqlite:///{folder / 'mine.db'}"}
    done = subprocess.run(
        [*COMMAND, "--once"], cwd=folder, env=environment, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def run_in(text: str) -> str:
    """Return the id of the run that the demonstration ends with."""
    return re.search(r"^Run (\w+)$", text, re.MULTILINE)[1]


@pytest.fixture(scope="module")
def demonstrated(tmp_path_factory):
    """A folder in which the demonstration has been shown once, and what it printed."""
    folder = tmp_path_factory.mktemp("demo")
    return folder, shown(folder)


def test_it_shows_the_whole_path_and_adds_nothing_twice(demonstrated):
    folder, first = demonstrated
    second = shown(folder)
    assert "Joint stiffness, partial pose" in first
    assert run_in(first) == run_in(second)
    assert "Open the page" not in first, "its address ends with the service"
    assert first.splitlines()[2] == second.splitlines()[2], "robot and set of the first"
    assert not (folder / "mine.db").exists()
    with closing(sqlite3.connect(folder / "jointstiff-demo.db")) as database:
        counted = database.execute("SELECT count(*) FROM jobs WHERE kind = 'comparison'").fetchone()
    assert counted == (1,)


def test_it_prints_the_sample_of_the_readme(demonstrated):
    _, printed = demonstrated
    (sample,) = printed_samples("README.md")
    assert sample in without_blanks_at_the_end(printed)


def test_the_sample_of_the_guide_is_what_its_command_prints(tmp_path):
    path = str(tmp_path / "campaign.json")
    for arguments in (["simulate", path, "--load", "dead_weight"], ["identify", path]):
        command = [sys.executable, "-m", "jointstiff", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert printed_samples("docs/reading-a-result.md") == [without_blanks_at_the_end(done.stdout)]


def printed_samples(guide: str) -> list[str]:
    """Return the blocks of a guide that begin with a verdict."""
    blocks = (Path(__file__).parents[3] / guide).read_text(encoding="utf-8").split("```\n")
    return [block for block in blocks if block.startswith("Use ")]


def without_blanks_at_the_end(text: str) -> str:
    """Return a text without blanks at the ends of its lines."""
    return "".join(f"{line.rstrip()}\n" for line in text.splitlines())


@pytest.mark.skipif(sys.platform != "linux", reason="children are read from /proc")
@pytest.mark.parametrize(
    "sent",
    [
        signal.SIGINT,
        pytest.param(signal.SIGTERM, marks=pytest.mark.slow),  # as Ctrl-C
        pytest.param(signal.SIGHUP, marks=pytest.mark.slow),
        signal.SIGKILL,
    ],
)
def test_no_process_is_left_after_a_signal(demonstrated, sent):
    folder, _ = demonstrated
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(COMMAND, cwd=folder, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            said = ""
            while "Ctrl-C ends" not in said:
                line = process.stdout.readline()
                assert line, "it ended"
                said += line
            assert re.search(r"Open the page: http://127.0.0.1:\d+/#/runs/\w+$", said, re.MULTILINE)
            children = children_of(process.pid)
            assert children, "no worker"
            process.send_signal(sent)
            status = process.wait(timeout=LONGEST_SECONDS)
        finally:
            process.kill()
    assert status == (-sent if sent in {signal.SIGHUP, signal.SIGKILL} else 0)
    deadline = time.monotonic() + LONGEST_SECONDS
    while any(map(is_alive, children)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not [child for child in children if is_alive(child)]


def children_of(parent: int) -> list[str]:
    """Return the children of all threads of a process; one that ends meanwhile has none."""
    children: list[str] = []
    for task in Path(f"/proc/{parent}/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):
            children += (task / "children").read_text().split()
    return children


def is_alive(identifier: str) -> bool:
    """Return whether a process runs; one that nobody has waited for does not."""
    try:
        state = Path(f"/proc/{identifier}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
