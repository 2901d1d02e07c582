"""Sample programs with a line left out, a letter less, or a digit that is none, by spoiled.txt."""

import re
from functools import cache
from pathlib import Path

import pytest

from robotprograms.errors import ProgramError
from robotprograms.formats import list_moves

SAMPLES = Path(__file__).parent / "samples"
BESIDE = {"cell.src": ["cell.dat"]}
CASES = [
    pytest.param(name, changes.split(", "), outcome, id=f"{name} {changes[:40]}")
    for name, *lines in (
        part.splitlines()
        for part in (SAMPLES.parent / "spoiled.txt").read_text(encoding="utf-8").split("\n=== ")[1:]
    )
    for changes, _, outcome in (line.partition(" -> ") for line in lines if line)
]


@cache
def lines_of(name):
    return (SAMPLES / name).read_bytes().decode("latin-1").splitlines(keepends=True)


def spoiled(name, change):
    """Return a program with one line changed, and the number of the line that it no longer has."""
    number, _, what = change.partition(" ")
    lines, at = lines_of(name), int(number) - 1
    new = {
        "as it is": lines[at : at + 1],
        "without": [],
        "letter": [re.sub(r"\w(\W*)$", r"\1", lines[at])],
        "number": [re.sub(r"\d", "x", lines[at], count=1)],
    }[what]
    return "".join([*lines[:at], *new, *lines[at + 1 :]]), None if new else at + 1


@cache
def read(name, change):
    """Return how many moves are corrected, and those that are not by their lines in the sample."""
    text, gone = spoiled(name, change)
    beside = [(each, (SAMPLES / each).read_bytes()) for each in BESIDE.get(name, ())]
    rows = list_moves([(name, text.encode("latin-1")), *beside])
    shift = gone or 10**9
    left = {(row.line + (row.line >= shift), row.reason) for row in rows if not row.corrected}
    return sum(row.corrected for row in rows), len(rows), left


def said_of(name, change):
    """Return how many moves are corrected, and what is said of others than in the sample."""
    try:
        corrected, count, left = read(name, change)
    except ProgramError as refused:
        return f"refused: {refused}"
    reasons = {}
    for line, reason in sorted(left - read(name, "1 as it is")[2]):
        reasons.setdefault(reason, []).append(str(line))
    return "; ".join(
        [f"{corrected} of {count}", *(f"{','.join(at)}: {each}" for each, at in reasons.items())]
    )


@pytest.mark.parametrize(("name", "changes", "outcome"), CASES)
def test_a_program_with_a_line_changed_is_corrected_as_far_as_it_is_certain(name, changes, outcome):
    assert {said_of(name, change) for change in changes} == {outcome}


@pytest.mark.parametrize("name", ["cell.src", "CELL.LS", "cell.mod", "cell.script", "cell.csv"])
def test_a_letter_less_or_a_digit_that_is_none_lets_no_more_be_corrected(name):
    most, count, _ = read(name, "1 as it is")
    stated = [change for case in CASES if case.values[0] == name for change in case.values[1]]
    assert len(set(stated)) == len(stated)
    for change in stated:
        if change.endswith(("letter", "number")) and not said_of(name, change).startswith("refused"):
            corrected, moves, _ = read(name, change)
            assert corrected <= most
            assert moves <= count
    for number, line in enumerate(lines_of(name), start=1):
        assert not line.strip() or f"{number} without" in stated
