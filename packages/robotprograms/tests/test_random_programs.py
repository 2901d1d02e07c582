"""Random programs are corrected and left as often as their statements have it: neither bold nor overcautious.

That what is corrected is certain is tested in `test_corrected.py`, against another interpreter.
"""

from collections import Counter
from random import Random

import pytest
from program_support.random_programs import LANGUAGES

from robotprograms.errors import ProgramError
from robotprograms.formats import list_moves

REASONS = {
    "unknown routine": "is unknown: it may move",
    "other callers": "while other frames are active",
    "no way": "the program never reaches this line",
    "branch": "in a branch, a loop or a call",
    "part or computed": "computed",
    "no numbers": "is not given by constant numbers",
    "used elsewhere": "where their meaning is not certain",
    "two frames": "with another base or tool",
    "moved": "moves the target",
    "other record": "is recorded with another",
    "same target": "uses the same target",
    "near a target": "at an offset from another",
    "several routines": "gets values in several routines",
    "changes": "changes while the program runs",
}
"""Reasons for which a move is left, by words; the first that fits counts."""
COUNTED = {
    "krl": {
        "corrected": 39,
        "refused": 1,
        "unknown routine": 28,
        "other callers": 49,
        "no way": 9,
        "branch": 24,
        "part or computed": 10,
        "no numbers": 17,
        "changes": 55,
    },
    "rapid": {
        "corrected": 150,
        "refused": 1,
        "unknown routine": 69,
        "no way": 6,
        "branch": 10,
        "no numbers": 35,
        "changes": 210,
    },
    "fanuc": {
        "corrected": 36,
        "refused": 6,
        "unknown routine": 2,
        "branch": 29,
        "part or computed": 1,
        "moved": 51,
        "other record": 62,
        "same target": 3,
        "changes": 75,
    },
    "ur": {
        "corrected": 146,
        "unknown routine": 34,
        "other callers": 94,
        "no way": 76,
        "branch": 117,
        "no numbers": 83,
        "near a target": 12,
        "several routines": 31,
        "changes": 75,
    },
}


@pytest.mark.parametrize("kind", LANGUAGES)
def test_moves_of_forty_programs_are_corrected_or_left_for_these_reasons(kind):
    language, found = LANGUAGES[kind], Counter[str]()
    for seed in range(40):
        text = language.make(Random(seed)).text  # noqa: S311
        try:
            moves = list_moves([(language.name, text.encode())])
        except ProgramError:
            found["refused"] += 1
            continue
        for move in moves:
            words = (name for name, reason in REASONS.items() if reason in move.reason)
            found["corrected" if move.corrected else next(words)] += 1
    assert found == COUNTED[kind]
