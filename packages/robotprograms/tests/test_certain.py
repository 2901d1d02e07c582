"""What is corrected is certain: random programs and their corrected texts, run by another interpreter."""

from random import Random

import numpy as np
import pytest
from program_support.random_programs import LANGUAGES
from program_support.written_programs import rewritten

from robotprograms.errors import ProgramError
from robotprograms.formats import read_program

SHIFT = 4.0
"""Correction of the first coordinate [m]: no program of these has such a number."""


def compared(kind: str, seed: int) -> int:
    """Count the moves of a random program that are corrected; each of its runs has to agree."""
    language = LANGUAGES[kind]
    random = language.make(Random(seed))  # noqa: S311
    try:
        program = read_program([(language.name, random.text.encode())], leave_others=True)
    except ProgramError:
        return 0
    targets, moves = program.targets, program.moves
    unit = 1.0 if kind == "ur" else 1e3
    shift = SHIFT * unit * (np.arange(7) == 0)
    again = rewritten(program, np.arange(len(targets)), targets.values[:, :7] + shift)[0][0].decode()
    visits = np.split(moves.visits, moves.ends[:-1])
    corrected = {int(line): own.tolist() for line, own in zip(moves.line, visits, strict=True)}
    frames = [each.name if each.pose is None else unit * each.pose[0, 3] for each in targets.frames]
    places = [
        [x, frames[base], frames[tool]]
        for x, base, tool in zip(targets.values[:, 0], targets.base, targets.tool, strict=True)
    ]
    for run in range(4):
        runs = (random.runs(text, 10 * seed + run) for text in (random.text, again))
        for before, after in zip(*runs, strict=True):
            assert before.line == after.line
            if before.line not in corrected:
                words = f"{before} is left, but moves elsewhere\n{random.text}"
                ends = [] if before.targets == after.targets else zip(*before[1:], after.targets, strict=True)
                for old, base, tool, new in ends:
                    if new != old:  # a copy of a point, in the frames of the point, shifts with it
                        assert any([old, base, tool] == pytest.approx(place) for place in places), words
                        assert new == pytest.approx(old + shift[0]), words
                continue
            own = corrected[before.line]
            stated = (
                [targets.values[i, 0] for i in own],
                *([frames[k[i]] for i in own] for k in (targets.base, targets.tool)),
            )
            for what, real in zip(stated, (before.targets, before.bases, before.tools), strict=True):
                assert what == pytest.approx(real), f"{before}: {stated}\n{random.text}"
            assert after.targets == pytest.approx([x + shift[0] for x in stated[0]]), random.text
    return len(corrected)


@pytest.mark.parametrize("kind", LANGUAGES)
def test_what_is_corrected_is_certain(kind):
    assert sum(compared(kind, seed) for seed in range(40)) > 10


@pytest.mark.slow
@pytest.mark.parametrize("kind", LANGUAGES)
def test_what_is_corrected_is_certain_in_ten_thousand(kind):
    assert sum(compared(kind, seed) for seed in range(40, 2_600)) > 500
