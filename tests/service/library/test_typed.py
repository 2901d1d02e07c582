"""Type checkers know the options of each verb: the stub is that of the messages, and mistakes are found."""

import subprocess
import sys

import pytest
from support.typed_verbs import FILE, formatted

WRONG = """
import jointstiff as js

js.identify("c.json", {wrong_1})
with js.Client("http://localhost:8000") as client:
    client.plan("c.json", {wrong_2})


async def main(client: js.AsyncClient) -> None:
    await client.map("c.json", {wrong_3})
"""
MISTAKES = {"wrong_1": 'metod="complete_pose"', "wrong_2": 'readings="six"', "wrong_3": "grid=3"}
RIGHT = {"wrong_1": 'method="complete_pose"', "wrong_2": "readings=6", "wrong_3": "grid=(3, 3, 1)"}


@pytest.mark.process
def test_the_stub_is_made_of_the_messages():
    """After a change of a message: `python tests/support/typed_verbs.py --write`."""
    assert FILE.read_text(encoding="utf-8") == formatted()


@pytest.mark.process
def test_a_type_checker_finds_a_wrong_name_and_a_wrong_value(tmp_path):
    files = {name: tmp_path / f"{name}.py" for name in ("wrong", "right")}
    for name, arguments in (("wrong", MISTAKES), ("right", RIGHT)):
        files[name].write_text(WRONG.format(**arguments))
    command = [sys.executable, "-m", "mypy", *map(str, files.values())]  # shares what scripts/check has found
    done = subprocess.run(command, capture_output=True, text=True, cwd=FILE.parents[2], check=False)
    errors = [line for line in done.stdout.splitlines() if ": error:" in line]
    found = {name: [line for line in errors if file.name in line] for name, file in files.items()}
    assert found["right"] == []
    assert len(found["wrong"]) == len(MISTAKES), found["wrong"]
