"""Numbers of a text: read all at once, and others written in their place."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray

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
            values.append(_values(pieces[1::2]))
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


def _values(numbers: Sequence[str]) -> FloatArray:
    try:
        return np.fromiter(map(float, numbers), dtype=np.float64, count=len(numbers))
    except ValueError:  # KUKA's 'B010'
        plain = [float(int(each[2:-1], 2)) if each[0] == "'" else float(each) for each in numbers]
        return np.array(plain, dtype=np.float64)


def written(
    text: str, spans: IndexArray, new: FloatArray, old: FloatArray, digits: IndexArray
) -> tuple[list[str], BoolArray]:
    """Return numbers as text, and (m,) which of them differ from the old ones to their digits.

    Args:
        text: that the old numbers stand in.
        spans: (m, 2) first and last + 1 character of each.
        new: (m,) numbers.
        old: (m,) numbers as they were read.
        digits: (m,) behind the point, that they get at least.
    """
    signs = np.frombuffer(text.encode("latin-1"), dtype=np.uint8)
    digits = np.maximum(digits, _decimals(signs, spans))
    texts, differ = np.empty(len(new), dtype=object), np.ones(len(new), dtype=np.bool_)
    for count in np.unique(digits):
        rows = np.flatnonzero(digits == count)
        texts[rows] = ("\n".join([f"%.{count}f"] * len(rows)) % tuple(new[rows].tolist())).split("\n")
    numbers: list[str] = texts.tolist()
    for i in np.flatnonzero(np.minimum(np.abs(new - old), np.abs(new)) < 2.0 * 10.0**-digits).tolist():
        usual = f"{old[i]:.{digits[i]}f}"
        differ[i] = numbers[i] != usual and not float(numbers[i]) == float(usual) == 0.0
        if numbers[i][0] == "-" and float(numbers[i]) == 0.0:
            numbers[i] = numbers[i][1:]
    for i in np.flatnonzero(signs[spans[:, 0]] == ord("+")).tolist():
        numbers[i] = numbers[i] if numbers[i][0] == "-" else f"+{numbers[i]}"
    return numbers, differ


def _decimals(signs: npt.NDArray[np.uint8], spans: IndexArray) -> IndexArray:
    """Return how many digits stand behind the points of numbers (m,) at spans of a text."""
    starts, ends = spans.T
    powers, points = np.flatnonzero((signs | 32) == ord("e")), np.flatnonzero(signs == ord("."))
    for places in (powers, points):
        first = np.append(places, len(signs))[np.searchsorted(places, starts)]
        ends, before = np.minimum(first, ends), ends
    decimals: IndexArray = np.maximum(before - ends - 1, 0)
    return decimals


def padded(text: str, start: int, end: int, number: str) -> Edit:
    """Keep the last column of a number where it is, as far as the blanks before it allow."""
    before = text[max(start - _MOST_BLANKS, 0) : start]
    blanks = len(before) - len(before.rstrip(" "))
    longer = len(number) - (end - start)
    if longer > 0:
        return start - min(longer, max(blanks - 1, 0)), end, number
    return start, end, " " * -longer + number if blanks else number


def edited(
    text: str, places: IndexArray, numbers: Sequence[str], spans: IndexArray
) -> tuple[str, IndexArray]:
    """Put other characters in place of some, and return the text with the spans of its numbers.

    Args:
        text: as it is.
        places: (m, 2) first and last + 1 character of what is replaced.
        numbers: m texts in their place, blanks before numbers.
        spans: (..., 2) of numbers in the text as it is.
    """
    if not len(places):
        return text, spans
    order = np.argsort(places[:, 0], kind="stable")
    starts, ends = places[order].T
    pieces = [""] * (2 * len(order) + 1)
    begins, stops = [0, *ends.tolist()], [*starts.tolist(), len(text)]
    pieces[::2] = [text[begin:stop] for begin, stop in zip(begins, stops, strict=True)]
    pieces[1::2] = [numbers[i] for i in order.tolist()]
    whole, bare = (
        np.fromiter(map(len, each), dtype=np.intp, count=len(order))
        for each in (pieces[1::2], map(str.lstrip, pieces[1::2]))
    )
    shift = np.concatenate([[0], np.cumsum(whole + starts - ends)])
    before = np.searchsorted(ends, spans[..., 1], side="right")
    last = np.maximum(before - 1, 0)
    is_edited = (before > 0) & (ends[last] == spans[..., 1])
    length = np.where(is_edited, bare[last], spans[..., 1] - spans[..., 0])
    after = spans[..., 1] + shift[before]
    return "".join(pieces), np.stack([after - length, after], axis=-1)
