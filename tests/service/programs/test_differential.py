"""Random programs, run by a controller with code of its own, beside what was corrected: 0 differ."""

from random import Random

import numpy as np
import pytest
from support.random_programs import LANGUAGES, runs
from support.written_programs import rewritten

from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.programs.formats import read_program

SHIFT = 4000.0
"""Correction of the first coordinate [mm]: no program of these has such a number."""


def compared(kind: str, seed: int) -> int:
    """Count the moves of a random program that are corrected; each of its runs has to agree."""
    language = LANGUAGES[kind]
    text = language.make(Random(seed))  # noqa: S311
    try:
        program = read_program([(language.name, text.encode())], leave_others=True)
    except ProgramError:
        return 0
    targets, moves = program.targets, program.moves
    values = targets.values[:, :7].copy()
    shift = SHIFT * 1e-3 if kind == "ur" else SHIFT
    values[:, 0] += shift
    again = rewritten(program, np.arange(len(targets)), values)[0][0].decode()
    begins = [0, *moves.ends.tolist()]
    corrected = {
        int(line): moves.visits[a:b].tolist()
        for line, a, b in zip(moves.line, begins, begins[1:], strict=False)
    }

    def frame(index):
        known = targets.frames[index]
        if known.pose is None:
            return known.name
        return round(float(known.pose[0, 3]) * (1 if kind == "ur" else 1e3), 6)

    for run in range(4):
        before, after = runs(language, text, 10 * seed + run), runs(language, again, 10 * seed + run)
        assert [each[0] for each in before] == [each[0] for each in after]
        for (line, old, base, tool), (_, new, *_) in zip(before, after, strict=True):
            if line not in corrected:
                assert old == new, f"line {line} is left, but moves elsewhere\n{text}"
                continue
            own = corrected[line]
            assert new == pytest.approx([x + shift for x in old]), (
                f"line {line} is corrected otherwise\n{text}"
            )
            assert old == pytest.approx(targets.values[own, 0].tolist()), (
                f"line {line} has another target\n{text}"
            )
            for stated, real in ((targets.base[own], base), (targets.tool[own], tool)):
                names = [frame(i) for i in stated.tolist()]
                real = [*real[:-1]] if isinstance(real, tuple) and real[-1] is None else [real] * len(own)
                assert names == pytest.approx(real) if isinstance(names[0], float) else names == real, (
                    f"line {line}: {names}, {real}\n{text}"
                )
    return len(corrected)


@pytest.mark.parametrize("kind", LANGUAGES)
def test_what_is_corrected_is_certain(kind):
    assert sum(compared(kind, seed) for seed in range(40)) > 10


@pytest.mark.slow
@pytest.mark.parametrize("kind", LANGUAGES)
def test_what_is_corrected_is_certain_in_ten_thousand(kind):
    assert sum(compared(kind, seed) for seed in range(40, 2_600)) > 500
