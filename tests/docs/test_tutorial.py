"""The tutorial: its commands, run in their order in an empty folder, print what the page shows."""

import os
import re
import subprocess

import pytest
from support.guide_files import ROOT

BLOCK = re.compile(r"^```(sh|console|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
TEXT = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
LEFT_OUT = "…"


def steps():
    """Yield language, command and shown lines of each step; only a console shows lines."""
    for language, text in BLOCK.findall(TEXT):
        if language != "console":
            yield language, text, []
            continue
        for step in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
            command, *shown = step.splitlines()
            yield language, command, shown


def unseen(shown, printed):
    """Return the first shown line that is not printed in its place; None if all are."""
    at, may_skip = 0, True  # a refusal is written apart from the tables, before or after them
    for line in shown:
        if line == LEFT_OUT:
            may_skip = True
            continue
        places = [place for place in range(at, len(printed)) if printed[place] == line]
        if not places or (places[0] != at and not may_skip):
            return line
        at, may_skip = places[0] + 1, False
    return None


@pytest.mark.timeout(300)
def test_a_reader_gets_from_the_arm_to_a_corrected_program(tmp_path, installed):
    environment = {**os.environ, "PATH": f"{installed}:{os.environ['PATH']}", "COLUMNS": "80"}
    for language, text, shown in steps():
        command = ["python", "-c", text] if language == "python" else ["sh", "-e", "-c", text]
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60, check=False
        )
        output = done.stdout + done.stderr
        printed = [line.rstrip() for line in output.splitlines()]
        assert unseen(shown, printed) is None, f"{text}\n{output}"
        assert shown or done.returncode == 0, f"{text}\n{output}"
    by_commands, by_python = (
        [line for line in (tmp_path / name).read_text().splitlines() if "Jointstiff run" not in line]
        for name in ("corrected.src", "from-python.src")
    )
    assert by_commands == by_python
