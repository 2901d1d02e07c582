"""Targets and moves of a program as objects, and the program with other numbers."""

from typing import NamedTuple

import numpy as np

from robotprograms.notation import Notation
from robotprograms.program import NUMBERS, FrameName, Motion, Program, Rewriting


class Target(NamedTuple):
    """A target: numbers that the program states."""

    name: str
    source: int
    line: int
    notation: Notation
    values: tuple[float, ...]
    spans: tuple[int, ...]
    base: FrameName
    tool: FrameName
    words: tuple[tuple[str, int, int], ...]
    letters: str


class Move(NamedTuple):
    """A move, and the indices of its targets."""

    line: int
    motion: Motion
    targets: tuple[int, ...]


def targets_of(program: Program) -> list[Target]:
    """The targets of a program, one by one."""
    columns, found = program.targets, []
    for i in range(len(columns)):
        literal, spans = columns.literals[columns.literal[i]], columns.spans[i].tolist()
        count = 3 + literal.notation.count
        words = [(name, *span) for (name, _), span in zip(literal.words, spans[NUMBERS:], strict=False)]
        found.append(
            Target(
                columns.names[i],
                int(columns.source[i]),
                int(columns.line[i]),
                literal.notation,
                tuple(columns.values[i, :count].tolist()),
                tuple(end for span in spans[:count] for end in span),
                columns.frames[columns.base[i]],
                columns.frames[columns.tool[i]],
                tuple(words),
                literal.letters,
            )
        )
    return found


def moves_of(program: Program) -> list[Move]:
    """The moves of a program, one by one."""
    moves, motions = program.moves, tuple(Motion)
    visits = np.split(moves.visits, moves.ends[:-1])
    return [
        Move(int(line), motions[motion], tuple(own.tolist()))
        for line, motion, own in zip(moves.line, moves.motion, visits, strict=True)
    ]


def rewritten(program: Program, indices: object, values: np.ndarray) -> tuple[list[bytes], np.ndarray]:
    """The files with other numbers (m, 7) in m targets, and the numbers as they are written."""
    text, rows, found = Rewriting(program), np.asarray(indices, dtype=np.intp), values.copy()
    for block in text.blocks(rows):
        found[block] = text.replace(rows[block], values[block])
    return text.files(), found
