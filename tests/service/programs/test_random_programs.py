"""Random programs are corrected and left as often as their statements have it: neither bold nor overcautious.

That what is corrected is certain is tested in `test_compensated.py`, against another interpreter.
"""

from collections import Counter
from random import Random

import pytest
from support.random_programs import LANGUAGES

from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.programs.formats import list_moves

REASONS = {
    "unknown routine": "is unknown: it may move",
    "other callers": "may be called from elsewhere",
    "no way": "the program never reaches this line",
    "branch": "by a branch, a loop or a call",
    "part or computed": "computed",
    "no numbers": "is not given by constant numbers",
    "used elsewhere": "where it is not certain what they mean",
    "two frames": "with another base or tool",
    "moved": "moves the target",
    "other record": "is recorded with another",
    "same target": "uses the same target",
    "changes": "changes while the program runs",
}
"""Reasons for which a move is left, by words; the first that fits counts."""
COUNTED = {
    "krl": {
        "corrected": 26,
        "unknown routine": 11,
        "other callers": 39,
        "no way": 48,
        "branch": 23,
        "part or computed": 22,
        "no numbers": 26,
        "used elsewhere": 4,
        "two frames": 2,
        "changes": 57,
    },
    "rapid": {
        "corrected": 110,
        "refused": 1,
        "unknown routine": 116,
        "branch": 14,
        "no numbers": 38,
        "two frames": 22,
        "changes": 194,
    },
    "fanuc": {
        "corrected": 39,
        "refused": 6,
        "unknown routine": 2,
        "branch": 29,
        "part or computed": 1,
        "moved": 51,
        "other record": 58,
        "changes": 75,
        "same target": 4,
    },
    "ur": {
        "corrected": 96,
        "unknown routine": 36,
        "other callers": 67,
        "no way": 101,
        "branch": 199,
        "no numbers": 85,
        "used elsewhere": 9,
        "two frames": 10,
        "changes": 85,
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
