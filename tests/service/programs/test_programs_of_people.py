"""Programs in the forms of people: how many moves to numbers are known as sent, and after one question.

The shares are printed by

    PYTHONPATH=.dev:tests:. .venv/bin/python -m pytest tests/service/programs/test_programs_of_people.py -s
"""

import re
import sys
from pathlib import Path

import pytest

from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.programs.formats import list_moves

FOLDER = Path(__file__).parent / "forms"
LEAST = {"krl": (0.7, 0.9), "rapid": (0.9, 0.95), "urscript": (0.65, 0.8), "fanuc": (0.4, 0.6)}
"""Least share of the moves to numbers that are known as sent, and after the question."""
SEPARATORS = {"krl": ";= ", "rapid": "!= ", "urscript": "#= "}
UNKNOWN_TOOL = re.compile(r"active TCP of line (\d+)")


def programs_of(language):
    for part in (FOLDER / f"{language}.txt").read_text(encoding="utf-8").split("\n=== ")[1:]:
        title, _, rest = part.partition("\n")
        _, *texts = re.split(r"^--- (.*)\n", rest, flags=re.MULTILINE)
        yield title, list(zip(texts[::2], texts[1::2], strict=True))


def truth_of(language, files):
    """Return base and tool of each move to numbers, by its line."""
    text = files[0][1]
    if language != "fanuc":
        mark = SEPARATORS[language]
        lines = (line.partition(mark)[2].split() for line in text.splitlines())
        return {number: tuple(words) for number, words in enumerate(lines, 1) if words}
    stated = re.findall(r"P\[(\d+)[^\]]*\]\{\s*GP1:\s*UF : (\d+), UT : (\d+)", text)
    frames = {number: (f"UF {base}", f"UT {tool}") for number, base, tool in stated}
    moves = re.finditer(r"^ *\d+:[JLC] P\[(\d+)[^\]]*\](.*)", text.split("/POS")[0], re.MULTILINE)
    return {
        text.count("\n", 0, move.start()) + 1: frames[move[1]] for move in moves if "Offset" not in move[2]
    }


def plain(name, text):
    """Return the name of a frame without the line that gave its numbers; of a tool of UR its numbers."""
    if match := UNKNOWN_TOOL.fullmatch(name):
        numbers = re.findall(r"[\d.]+", text.splitlines()[int(match[1]) - 1])
        return ",".join(f"{float(each):g}" for each in numbers[:3])
    return {"robot base": "base"}.get(name, name.partition(" of line")[0])


def known_moves(language, *, trust):
    """Return how many moves to numbers are known, how many there are, and those that are wrong."""
    known, count, wrong = 0, 0, []
    for title, files in programs_of(language):
        truth, text = truth_of(language, files), files[0][1]
        count += len(truth)
        try:
            moves = list_moves([(name, each.encode()) for name, each in files], trust_routines=trust)
        except ProgramError as error:
            raise AssertionError(f"{title}: {error}") from error
        for move in moves:
            if move.corrected:
                known += move.line in truth
                found = (plain(move.base, text), plain(move.tool, text))
                if truth.get(move.line) != found:
                    wrong.append((title, move.line, found, truth.get(move.line)))
    return known, count, wrong


@pytest.mark.parametrize("language", LEAST)
def test_moves_to_numbers_are_known_as_sent_and_more_of_them_after_one_question(language):
    (before, count, wrong), (after, _, more_wrong) = (
        known_moves(language, trust=trust) for trust in (False, True)
    )
    sys.stdout.write(f"{language}: {before} of {count} as sent, {after} after the question\n")
    assert wrong == more_wrong == []
    assert before >= LEAST[language][0] * count
    assert after >= LEAST[language][1] * count
