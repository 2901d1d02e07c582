"""What editors and type checkers know of the installed package."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.process, pytest.mark.timeout(600)]

TYPED = Path(__file__).parent / "typed"
CHECKERS = {"pyright": "--pythonpath", "mypy": "--python-executable"}
"""Type checker → its option for the Python that has the package."""


@pytest.fixture(scope="module", params=CHECKERS)
def reported(request, installed: Path, tmp_path_factory):
    """Call it with the name of a file; it returns the numbers of the lines that a type checker reports."""
    folder = tmp_path_factory.mktemp("typed")

    def check(name: str) -> set[int]:
        shutil.copy(TYPED / name, folder)
        checker = Path(sys.executable).with_name(request.param)
        command = [str(checker), CHECKERS[request.param], str(installed / "python"), name]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=400)
        assert re.search(r"^(\d+ errors?,|Found \d+ error|Success: no issues)", done.stdout, re.MULTILINE), (
            done
        )
        return {int(line) for line in re.findall(rf"{name}:(\d+)(?::\d+)?[ :-]+error", done.stdout)}

    return check


def test_each_mistake_is_reported_where_it_is_and_nothing_else(reported):
    lines = (TYPED / "wrong.py").read_text(encoding="utf-8").splitlines()
    mistakes = {number for number, line in enumerate(lines, 1) if line.endswith("# wrong")}
    assert len(mistakes) >= 18
    assert reported("wrong.py") == mistakes


def test_right_uses_are_not_reported(reported):
    assert reported("right.py") == set()
