"""Ranges of the controller's angles that formats state by the arm's configuration; words rewritten."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from jointstiff.service.programs.notation import Edit
from jointstiff.service.programs.program import NUMBERS, Program
from jointstiff.solver.arrays import FloatArray, IndexArray

_NEAR: Final = 1e-4
"""Angle beside a boundary [rad] where a program, which is rounded, may say either."""
_ROUNDING: Final = 1e-8
"""Angle beside a boundary [rad] that is nothing: no word is changed for it."""
_MOST: Final = 1e9
"""Magnitude that no word has."""


@dataclass(frozen=True, slots=True)
class _Word:
    """A word on one joint: a number, or a bit of one, that means a range of angles."""

    joint: int  # index of the joint
    kind: Literal["sign", "quadrant", "turn"]
    bit: int | None = None  # bit of the number that is 1 below zero; None where the number is the word

    def ranges(self, numbers: FloatArray) -> FloatArray:
        """Return least and greatest angles (m, 2) [rad] that numbers (m,) mean; ∓inf for NaN."""
        if self.bit is not None:
            whole = np.nan_to_num(numbers).astype(np.int64)
            low, high = (
                np.where(whole >> self.bit & 1, -np.inf, 0.0),
                np.where(whole >> self.bit & 1, 0.0, np.inf),
            )
        elif self.kind == "quadrant":
            low, high = np.pi / 2 * numbers, np.pi / 2 * (numbers + 1)
        else:
            low, high = 2 * np.pi * numbers - np.pi, 2 * np.pi * numbers + np.pi
        unknown = np.isnan(numbers)
        return np.stack([np.where(unknown, -np.inf, low), np.where(unknown, np.inf, high)], axis=1)

    def rewritten(self, number: int, angle: float) -> int:
        """Return a number whose word means an angle [rad]."""
        if self.bit is not None:
            return number & ~(1 << self.bit) | int(angle < 0.0) << self.bit
        return int(
            np.floor(2 * angle / np.pi) if self.kind == "quadrant" else np.ceil(angle / (2 * np.pi) - 0.5)
        )


# Bit 2 of KUKA's S is 1 where A5 is below zero (beyond half a turn, which no wrist reaches, the reverse).
_WORDS: Final = {
    "T": tuple(_Word(joint, "sign", joint) for joint in range(6)),
    "S": (_Word(4, "sign", 2),),
    "cfx": (_Word(4, "sign", 0),),
    **{f"cf{joint + 1}": (_Word(joint, "quadrant"),) for joint in (0, 3, 5)},
    **{f"turn{joint + 1}": (_Word(joint, "turn"),) for joint in (0, 3, 5)},
}
_FREE_RAPID: Final = re.compile(r"\bConfJ\s*+\\\s*+Off\b", re.IGNORECASE)


class StatedConfigurations:
    """Read what the targets of a program say of the arm's configuration."""

    def __init__(self, program: Program) -> None:
        self._program = program
        # whether the controller takes a joint move to the configuration that is stated
        self.decides = program.format != "rapid" or not any(
            _FREE_RAPID.search(source.text) for source in program.sources
        )

    def ranges(self, indices: Sequence[int] | IndexArray) -> FloatArray:
        """Return least and greatest controller's angles (m, 6, 2) [rad]; ∓inf where nothing is stated."""
        rows = np.asarray(indices, dtype=np.intp)
        ranges = np.tile([-np.inf, np.inf], (len(rows), 6, 1))
        for word, column, members in self._words(rows):
            low, high = word.ranges(self._numbers(rows[members], column)).T
            stated = ranges[members, word.joint]
            ranges[members, word.joint] = np.stack(
                [np.maximum(stated[:, 0], low), np.minimum(stated[:, 1], high)], 1
            )
        return ranges

    def edits(self, indices: IndexArray, wanted: FloatArray, commanded: FloatArray) -> list[tuple[int, Edit]]:
        """Return the words to be rewritten, where an angle that agreed with its word no longer does.

        Args:
            indices: m targets.
            wanted: (m, 6) controller's angles [rad] of the targets before.
            commanded: (m, 6) after the correction.
        """
        changed: dict[tuple[int, int], int] = {}  # numbers by target and column
        for word, column, members in self._words(indices):
            numbers = self._numbers(indices[members], column)
            low, high = word.ranges(numbers).T
            before, after = wanted[members, word.joint], commanded[members, word.joint]
            agreed = (low - _NEAR <= before) & (before <= high + _NEAR)
            left = (after < low - _ROUNDING) | (after > high + _ROUNDING)
            for i in np.flatnonzero(agreed & left & np.isfinite(numbers)):
                place = int(indices[members[i]]), column
                changed[place] = word.rewritten(changed.get(place, int(numbers[i])), float(after[i]))
        return [(index, self._edit(index, column, number)) for (index, column), number in changed.items()]

    def _edit(self, index: int, column: int, number: int) -> Edit:
        targets = self._program.targets
        start, end = targets.spans[index, column].tolist()
        binary = self._program.sources[targets.source[index]].text[start] == "'"  # KUKA's 'B010'
        return start, end, f"'B{number:0{end - start - 3}b}'" if binary else str(number)

    def _words(self, indices: IndexArray) -> Iterator[tuple[_Word, int, IndexArray]]:
        """Yield words, the columns of their numbers, and the places (k,) of the targets that have them."""
        targets = self._program.targets
        words = [tuple(name for name, _ in literal.words) for literal in targets.literals]
        different = list(dict.fromkeys(words))
        of_literal = np.array([different.index(names) for names in words], dtype=np.intp)
        of_target = of_literal[targets.literal[indices]]
        for which, names in enumerate(different):
            members = np.flatnonzero(of_target == which)
            for column, name in enumerate(names, NUMBERS):
                for word in _WORDS[name]:
                    yield word, column, members

    def _numbers(self, indices: IndexArray, column: int) -> FloatArray:
        """Return the numbers (m,) of words; NaN for one that is no usual whole number."""
        numbers = self._program.targets.values[indices, column]
        return np.where((numbers == np.round(numbers)) & (np.abs(numbers) < _MOST), numbers, np.nan)
