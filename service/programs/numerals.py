"""Numbers of a text: read all at once, and others written in their place."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray

_MOST_BLANKS: Final = 32
"""Blanks before a number that a column is kept with."""
_BLOCK: Final = 1 << 20
"""Characters whose numbers are held as texts at a time."""
Edit: TypeAlias = tuple[int, int, str]
"""First and last + 1 character, and the text in their place."""


@dataclass(frozen=True, slots=True, eq=False)
class Numerals:
    """All N numbers of a text, and the text without them."""

    values: FloatArray  # (N,)
    starts: IndexArray  # (N,) first character of each
    ends: IndexArray  # (N,) last character + 1
    rest: str  # the text with `\0` in place of each number

    @classmethod
    def of(cls, text: str, pattern: str) -> Numerals:
        r"""Find the numbers of a text without `\0`; none of them goes over the end of a line."""
        split = re.compile(f"({pattern})").split
        values, spans, rest, begin = [np.zeros(0)], [np.zeros((0, 2), dtype=np.intp)], [], 0
        while begin < len(text):
            end = text.find("\n", begin + _BLOCK) + 1 or len(text)
            pieces = split(text[begin:end])
            values.append(np.array([_value(piece) for piece in pieces[1::2]]))
            ends = begin + np.cumsum(np.fromiter(map(len, pieces), dtype=np.intp, count=len(pieces)))
            spans.append(ends[:-1].reshape(-1, 2))
            rest.append("\0".join(pieces[::2]))
            begin = end
        starts, ends = np.concatenate(spans).T.copy()
        return cls(np.concatenate(values), starts, ends, "".join(rest))

    def shapes(self, starts: IndexArray, ends: IndexArray) -> tuple[list[str], IndexArray]:
        """Return parts of the text without their numbers, and the place of the first number of each.

        Args:
            starts: (k,) first characters of the parts.
            ends: (k,) last characters + 1.
        """
        shorter = np.concatenate([[0], np.cumsum(self.ends - self.starts - 1)])
        first, last = np.searchsorted(self.starts, starts), np.searchsorted(self.starts, ends)
        begins, stops = (starts - shorter[first]).tolist(), (ends - shorter[last]).tolist()
        rest = self.rest
        return [rest[begin:stop] for begin, stop in zip(begins, stops, strict=True)], first


def _value(piece: str) -> float:
    return float(int(piece[2:-1], 2)) if piece[0] == "'" else float(piece)


def written(text: str, spans: IndexArray, new: FloatArray, old: FloatArray, digits: IndexArray) -> list[str]:
    """Return numbers as text: the text before, where the new number is the old one to its digits.

    Args:
        text: that the old numbers stand in.
        spans: (m, 2) first and last + 1 character of each.
        new: (m,) numbers.
        old: (m,) numbers as they were read.
        digits: (m,) behind the point, that they get at least.
    """
    before = [text[start:end] for start, end in spans.tolist()]
    digits = np.maximum(digits, _decimals(before))
    texts = np.empty(len(new), dtype=object)
    for count in np.unique(digits):
        rows = np.flatnonzero(digits == count)
        texts[rows] = ("\n".join([f"%.{count}f"] * len(rows)) % tuple(new[rows].tolist())).split("\n")
    least = 2.0 * 10.0**-digits
    for i in np.flatnonzero(np.minimum(np.abs(new - old), np.abs(new)) < least).tolist():
        usual = f"{old[i]:.{digits[i]}f}"
        if texts[i] == usual or float(texts[i]) == float(usual) == 0.0:
            texts[i] = before[i]
        elif texts[i][0] == "-" and float(texts[i]) == 0.0:
            texts[i] = texts[i][1:]
    listed: list[str] = texts.tolist()
    for i, number in enumerate(before):
        if number[0] == "+" and listed[i][0] not in "+-":
            listed[i] = f"+{listed[i]}"
    return listed


def _decimals(numbers: Sequence[str]) -> IndexArray:
    """Return how many digits stand behind the points of numbers (m,)."""
    tails = [number.partition(".")[2] for number in numbers]
    counts = [len(tail) if tail.isdigit() or not tail else len(re.split("[eE]", tail)[0]) for tail in tails]
    return np.array(counts, dtype=np.intp)


def padded(text: str, start: int, end: int, number: str) -> Edit:
    """Keep the last column of a number where it is, as far as the blanks before it allow."""
    before = text[max(start - _MOST_BLANKS, 0) : start]
    blanks = len(before) - len(before.rstrip(" "))
    longer = len(number) - (end - start)
    if longer > 0:
        return start - min(longer, max(blanks - 1, 0)), end, number
    return start, end, " " * -longer + number if blanks else number


def edited(text: str, changes: Sequence[Edit], spans: IndexArray) -> tuple[str, IndexArray]:
    """Carry out edits, and return the text with the spans (..., 2) of numbers where they stand then."""
    edits = sorted(changes)
    if not edits:
        return text, spans
    starts, ends = (np.array([edit[i] for edit in edits], dtype=np.intp) for i in (0, 1))
    numbers = [number for _, _, number in edits]
    between = zip([0, *ends.tolist()], [*starts.tolist(), len(text)], strict=True)
    pieces = [""] * (2 * len(edits) + 1)
    pieces[::2] = [text[begin:end] for begin, end in between]
    pieces[1::2] = numbers
    shift = np.concatenate([[0], np.cumsum([len(number) for number in numbers] + starts - ends)])
    before = np.searchsorted(ends, spans[..., 1], side="right")
    last = np.maximum(before - 1, 0)
    bare = np.array([len(number.lstrip(" ")) for number in numbers], dtype=np.intp)
    is_edited = (before > 0) & (ends[last] == spans[..., 1])
    length = np.where(is_edited, bare[last], spans[..., 1] - spans[..., 0])
    stops = spans[..., 1] + shift[before]
    return "".join(pieces), np.stack([stops - length, stops], axis=-1)
