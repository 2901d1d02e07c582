"""Numbers of a text: read all at once, and others written in their place."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray

_MOST_BLANKS: Final = 32
"""Blanks before a number that a column is kept with."""
_BLOCK: Final = 1 << 20
"""Characters whose numbers are held as texts at a time."""
Places: TypeAlias = npt.NDArray[np.int32]
"""Places in a text: half of the room of an index, as no program is as long."""
Characters: TypeAlias = npt.NDArray[np.uint8]
"""A text in one byte a character."""
Edit: TypeAlias = tuple[int, int, str]
"""First and last + 1 character, and the text in their place."""


@dataclass(frozen=True, slots=True, eq=False)
class Numerals:
    """All N numbers of a text, and the text without them."""

    values: FloatArray  # (N,)
    starts: Places  # (N,) first character of each
    ends: Places  # (N,) last character + 1
    rest: str  # the text with `\0` in place of each number

    @classmethod
    def of(cls, text: str, pattern: str) -> Numerals:
        r"""Find the numbers of a text without `\0`; none of them goes over the end of a line."""
        split = re.compile(f"({pattern})").split
        values, spans, rest, begin = [np.zeros(0)], [np.zeros((0, 2), dtype=np.int32)], [], 0
        while begin < len(text):
            end = text.find("\n", begin + _BLOCK) + 1 or len(text)
            pieces = split(text[begin:end])
            values.append(_values(pieces[1::2]))
            ends = begin + np.cumsum(
                np.fromiter(map(len, pieces), dtype=np.int32, count=len(pieces)), dtype=np.int32
            )
            spans.append(ends[:-1].reshape(-1, 2))
            rest.append("\0".join(pieces[::2]))
            begin = end
        starts, ends = np.concatenate(spans).T.copy()
        return cls(np.concatenate(values), starts, ends, "".join(rest))

    def shapes(self, starts: IndexArray, ends: IndexArray) -> tuple[Iterator[str], IndexArray]:
        """Return parts of the text without their numbers, and the place of the first number of each.

        Args:
            starts: (k,) first characters of the parts.
            ends: (k,) last characters + 1.
        """
        shorter = np.concatenate([[0], np.cumsum(self.ends - self.starts - 1)])
        first, last = np.searchsorted(self.starts, starts), np.searchsorted(self.starts, ends)
        begins, stops, rest = starts - shorter[first], ends - shorter[last], self.rest
        return (rest[begin:stop] for begin, stop in zip(begins.tolist(), stops.tolist(), strict=True)), first


def _values(numbers: Sequence[str]) -> FloatArray:
    try:
        return np.fromiter(map(float, numbers), dtype=np.float64, count=len(numbers))
    except ValueError:  # KUKA's 'B010', and decimal commas of tables
        commas = [each.replace(",", ".") for each in numbers]
        plain = [float(int(each[2:-1], 2)) if each[0] == "'" else float(each) for each in commas]
        return np.array(plain, dtype=np.float64)


_CELL: Final = r"(?:^|[;\t])[ \"]*+{}[ \"]*+(?=[;\t\r\n]|\Z)"
_POINT: Final = re.compile(_CELL.format(r"[+-]?\d*+\.\d++"), re.MULTILINE)
_COMMA: Final = re.compile(
    _CELL.format(r"[+-]?(?:0,\d++|\d{4,15},\d++|\d{1,3},(?:\d\d?|\d{4,15}))"), re.MULTILINE
)
"""A comma with other than three digits behind it, or more than three before it, separates no thousands."""


_SHOWING: Final = 1 << 16
"""Characters of a table that show how it writes numbers."""


def has_decimal_commas(table: str) -> bool:
    """Return whether numbers of a table have commas in place of points, and cannot mean anything else."""
    begin = table[:_SHOWING]
    return _COMMA.search(begin) is not None and _POINT.search(begin) is None


def written(
    signs: Characters, spans: Places, new: FloatArray, old: FloatArray, digits: IndexArray
) -> tuple[list[str], BoolArray]:
    """Return numbers as text, and (m,) which of them differ from the old ones to their digits.

    Args:
        signs: text that the old numbers stand in.
        spans: (m, 2) first and last + 1 character of each.
        new: (m,) numbers.
        old: (m,) numbers as they were read.
        digits: (m,) behind the point, that they get at least.
    """
    digits = np.maximum(digits, _decimals(signs, spans))
    counts = np.unique(digits).tolist()
    if len(counts) == 1:
        numbers = _formatted(new, counts[0])
    else:
        texts = np.empty(len(new), dtype=object)
        for count in counts:
            rows = np.flatnonzero(digits == count)
            texts[rows] = _formatted(new[rows], count)
        numbers = texts.tolist()
    differ = np.ones(len(new), dtype=np.bool_)
    for i in np.flatnonzero(np.minimum(np.abs(new - old), np.abs(new)) < 2.0 * 10.0**-digits).tolist():
        usual = f"{old[i]:.{digits[i]}f}"
        differ[i] = numbers[i] != usual and not float(numbers[i]) == float(usual) == 0.0
        if numbers[i][0] == "-" and float(numbers[i]) == 0.0:
            numbers[i] = numbers[i][1:]
    for i in np.flatnonzero(signs[spans[:, 0]] == ord("+")).tolist():
        numbers[i] = numbers[i] if numbers[i][0] == "-" else f"+{numbers[i]}"
    return numbers, differ


def _formatted(numbers: FloatArray, digits: int) -> list[str]:
    return ("\n".join([f"%.{digits}f"] * len(numbers)) % tuple(numbers.tolist())).split("\n")


def _decimals(signs: Characters, spans: Places) -> IndexArray:
    """Return how many digits stand behind the points of numbers (m,) at spans of a text."""
    starts, ends = spans.T
    powers = np.flatnonzero((signs | 32) == ord("e"))
    points = np.flatnonzero((signs == ord(".")) | (signs == ord(",")))
    for places in (powers, points):
        first = np.append(places, len(signs))[np.searchsorted(places, starts)]
        ends, before = np.minimum(first, ends), ends
    decimals: IndexArray = np.maximum(before - ends - 1, 0)
    return decimals


def padded(signs: Characters, start: int, end: int, number: str) -> Edit:
    """Keep the last column of a number where it is, as far as the blanks before it allow."""
    before = signs[max(start - _MOST_BLANKS, 0) : start].tobytes()
    blanks = len(before) - len(before.rstrip(b" "))
    longer = len(number) - (end - start)
    if longer > 0:
        return start - min(longer, max(blanks - 1, 0)), end, number
    return start, end, " " * -longer + number if blanks else number


def spliced(signs: Characters, spans: Places, texts: Sequence[str]) -> bytes:
    """Return a text with others in place of some of its characters.

    Args:
        signs: the text.
        spans: (m, 2) first and last + 1 character of what is replaced, in order.
        texts: m others.
    """
    starts, ends = spans.T
    lengths = np.fromiter(map(len, texts), dtype=np.intp, count=len(texts))
    gaps = np.append(starts, len(signs)) - np.concatenate([[0], ends])
    is_new, is_old = (
        np.repeat(np.arange(len(gaps) + len(each)) % 2 == 1, np.insert(gaps, np.arange(1, len(gaps)), each))
        for each in (lengths, ends - starts)
    )
    result = np.empty(len(is_new), dtype=np.uint8)
    result[is_new] = np.frombuffer("".join(texts).encode("latin-1"), dtype=np.uint8)
    result[~is_new] = signs[~is_old]
    return result.tobytes()
