"""Lists of numbers in brackets, such as `{10.5, -20.3, 1.5}`, and the name of each number."""

from __future__ import annotations

import re
from typing import Final

COORDINATES: Final = 3
LEAST_NUMBERS: Final = 3
"""Numbers of a list, at least."""
NUMBER: Final = re.compile(r"[-+\u2212]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?")
_NUMBERS_AND_BLANKS: Final = re.compile(r"\d\s+[-+.\d\u2212]")


def split_numbers(content: str) -> tuple[str, ...] | None:
    """Return the numbers of a list, which semicolons, commas or blanks separate; None of other lists."""
    if ";" in content:
        texts = content.split(";")
    elif "," in content and not _NUMBERS_AND_BLANKS.search(content):
        texts = content.split(",")
    else:
        texts = content.split()
    numbers = tuple(text.strip() for text in texts)
    are_numbers = len(numbers) >= LEAST_NUMBERS and all(NUMBER.fullmatch(text) for text in numbers)
    return numbers if are_numbers else None


def name_number(header: str, index: int, count: int) -> str:
    """Return the name of a number: the words before its list, and its axis or place; empty without words."""
    if not header:
        return ""
    return f"{header} {'xyz'[index]}" if count == COORDINATES else f"{header} {index + 1}"
