"""The demonstration: a real process, its worker, and what is left of them after each signal."""

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

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
    assert "≥ 0 gives the same numbers as free" in " ".join(first.split())
    assert run_in(first) == run_in(second)
    assert "Open the page" not in first, "its address ends with the service"
    assert first.splitlines()[2] == second.splitlines()[2], "robot and set of the first"
    assert not (folder / "mine.db").exists()
    assert (folder / "jointstiff-demo.db").exists()


def test_it_prints_the_lines_of_the_readme(demonstrated):
    _, printed = demonstrated
    blocks = (Path(__file__).parents[3] / "README.md").read_text(encoding="utf-8").split("\n```\n")
    lines = next(block for block in blocks if block.startswith("Use ")).splitlines()
    words = " ".join(printed.replace("┃", "│").split())  # a terminal breaks long lines
    assert [line for line in lines if " ".join(line.split()) not in words] == []


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
