"""Ranges of the controller's angles that formats state by the arm's configuration; words rewritten."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, pi
from typing import Final

import numpy as np

from jointstiff.service.programs.program import Edit, Program
from jointstiff.solver.arrays import FloatArray

_HALF: Final = pi / 2
_INF: Final = float("inf")
_NEAR: Final = 1e-4
"""Angle beside a boundary [rad] where a program, which is rounded, may say either."""
_ROUNDING: Final = 1e-8
"""Angle beside a boundary [rad] that is nothing: no word is changed for it."""


@dataclass(frozen=True, slots=True)
class _Word:
    """A word on one joint: where it stands, and the range of angles that each value of it means."""

    joint: int  # index of the joint
    kind: str  # `sign` (1 below zero), `quadrant` or `turn`
    value: int  # as written

    def range(self) -> tuple[float, float]:
        """Return least and greatest angle [rad]."""
        if self.kind == "sign":
            return (-_INF, 0.0) if self.value else (0.0, _INF)
        if self.kind == "quadrant":
            return _HALF * self.value, _HALF * (self.value + 1)
        return 2 * pi * self.value - pi, 2 * pi * self.value + pi

    def of(self, angle: float) -> int:
        """Return the value that an angle [rad] has."""
        if self.kind == "sign":
            return int(angle < 0.0)
        return floor(angle / _HALF) if self.kind == "quadrant" else ceil((angle - pi) / (2 * pi))

    def holds(self, angle: float, beside: float) -> bool:
        """Tell whether an angle [rad] is in the range, or as near beside it."""
        low, high = self.range()
        return low - beside <= angle <= high + beside


_JOINTS: Final = {"cf1": 0, "cf4": 3, "cf6": 5, "turn1": 0, "turn4": 3, "turn6": 5}
"""Joint of a quadrant (RAPID) or a turn number (FANUC)."""
_FREE_RAPID: Final = re.compile(r"\bConfJ\s*\\\s*Off\b", re.IGNORECASE)


class StatedConfigurations:
    """Read what the targets of a program say of the arm's configuration.

    Attributes:
        decides: whether the controller takes a joint move to the configuration that is stated.
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self.decides = program.format != "rapid" or not any(
            _FREE_RAPID.search(source.text) for source in program.sources
        )

    def ranges(self, indices: Sequence[int]) -> FloatArray:
        """Return least and greatest controller's angles (m, 6, 2) [rad]; ∓inf where nothing is stated."""
        ranges = np.tile([-_INF, _INF], (len(indices), 6, 1))
        for row, i in zip(ranges, indices, strict=True):
            for word, _ in self._words(i):
                low, high = word.range()
                row[word.joint] = max(low, row[word.joint, 0]), min(high, row[word.joint, 1])
        return ranges

    def letters(self, index: int) -> str:
        """Return what is stated in letters, which no angle tells: FANUC's N/F, U/D and T/B."""
        return self._program.targets[index].letters

    def edits(self, index: int, wanted: FloatArray, commanded: FloatArray) -> list[Edit]:
        """Return the words to be rewritten, where an angle that agreed with its word no longer does.

        Args:
            index: of the target.
            wanted: (6,) controller's angles [rad] of the target before.
            commanded: (6,) after the correction.
        """
        words = self._words(index)
        changed = {
            word: word.of(commanded[word.joint])
            for word, _ in words
            if word.holds(wanted[word.joint], _NEAR) and not word.holds(commanded[word.joint], _ROUNDING)
        }
        if not changed:
            return []
        return _rewritten([(changed.get(word, word.value), word, place) for word, place in words])

    def _words(self, index: int) -> list[tuple[_Word, _Place]]:
        target = self._program.targets[index]
        text = self._program.sources[target.source].text
        return [
            word for name, start, end in target.words for word in _words(name, text[start:end], (start, end))
        ]


@dataclass(frozen=True, slots=True)
class _Place:
    """Place of a word: its number's characters, and its bit where several words share the number."""

    span: tuple[int, int]  # first and last + 1 character
    bit: int | None = None  # of the number; None where the number is the word
    whole: int = 0  # the number as it is
    style: str = "d"  # `b` for KUKA's binary numbers


def _rewritten(words: Sequence[tuple[int, _Word, _Place]]) -> list[Edit]:
    numbers: dict[tuple[int, int], tuple[int, _Place]] = {}
    for value, _, place in words:
        before = numbers.get(place.span, (place.whole, place))[0]
        after = value if place.bit is None else before & ~(1 << place.bit) | value << place.bit
        numbers[place.span] = after, place
    edits = []
    for (start, end), (value, place) in numbers.items():
        if value != place.whole:
            width = end - start - 3
            edits.append((start, end, f"'B{value:0{width}b}'" if place.style == "b" else str(value)))
    return edits


def _words(name: str, text: str, span: tuple[int, int]) -> list[tuple[_Word, _Place]]:
    """Return what a number says of the arm's configuration; nothing where it is no usual whole number."""
    if text.startswith("'"):
        number, style = int(text[2:-1], 2), "b"
    elif re.fullmatch(r"[+-]?\d{1,9}(?:\.0*)?", text):
        number, style = int(float(text)), "d"
    else:
        return []
    if name == "T":
        return [(_Word(j, "sign", number >> j & 1), _Place(span, j, number, style)) for j in range(6)]
    if name == "S":
        # Bit 2 is 1 where A5 is below zero (beyond half a turn, which no wrist reaches, the reverse).
        return [(_Word(4, "sign", number >> 2 & 1), _Place(span, 2, number, style))]
    if name == "cfx":
        return [(_Word(4, "sign", number & 1), _Place(span, 0, number))]
    kind = "quadrant" if name.startswith("cf") else "turn"
    return [(_Word(_JOINTS[name], kind, number), _Place(span, None, number))]
