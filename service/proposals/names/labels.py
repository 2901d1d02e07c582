"""Names in the rows of a table as texts: their parts, numbers and spelling."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping
from typing import Final

from jointstiff.schemas.imports import State
from jointstiff.service.importing.grammar import find_state

SEPARATORS: Final = re.compile(r"::|[\s_\-.:/|]+")
"""What may be between the parts of a name."""
LEAST_LABELS: Final = 3
"""Fewest different names of observations; fewer are names of something else, such as a robot."""
MOST_CODES: Final = 16
"""Most different names of targets or states in a column."""
COUNTED: Final = re.compile(r"\d{1,5}")
"""A name that is a number."""
_ENDING: Final = re.compile(
    r"[^\W\d_]{0,16}[\s_.-]?\d{1,5}(?:[\s_.-][^\W\d_]{0,16}\d{1,5}){0,2}[\s_.-]?([^\W\d_]{1,16})"
)
"""A number, or several, with a word behind, such as `1u`, `P01-before` and `M01-1-u`."""
_BEFORE_NUMBER: Final = " \t_-.#"
"""Signs between a word and its number."""
_LEADING_ZEROS: Final = re.compile(r"(?<![\d.,])0+(?=\d)")


def split_parts(name: str) -> list[str]:
    """Return the parts of a name, such as `P01`, `T2` and `loaded` of `P01_T2-loaded`."""
    return [part for part in SEPARATORS.split(name) if part]


def omit_state(text: str, words: Mapping[str, State]) -> str:
    """Return the other part of a name of two parts, one a word for a state, in the spelling of `omit_zeros`.

    Other names give an empty text.
    """
    parts = split_parts(text)
    others = [part for part in parts if find_state(part, words) is None]
    return omit_zeros(others[0]) if len(parts) == 2 and len(others) == 1 else ""


def omit_zeros(label: str) -> str:
    """Return a label whose numbers have no leading zeros, in lower case: `P01` gives `p1`."""
    return _LEADING_ZEROS.sub("", label.casefold())


def omit_repeat_numbers(texts: Collection[str]) -> dict[str, str]:
    """Return text → word, of texts such as `s/c 1`, whose numbers count the repeats of several words.

    All words have the same numbers behind; else each text is its own word.
    """
    numbers_of_word: dict[str, set[str]] = {}
    word_of_text = {}
    for text in texts:
        start = text.rstrip("0123456789")
        word_of_text[text] = word = start.rstrip(_BEFORE_NUMBER)
        numbers_of_word.setdefault(word, set()).add(text[len(start) :])
    numbers = next(iter(numbers_of_word.values()), set())
    are_words = all(len(word) > 1 and not word[-1].isdigit() for word in numbers_of_word)
    are_counted = "" not in numbers and all(own == numbers for own in numbers_of_word.values())
    are_repeats = len(numbers_of_word) > 1 and are_words and are_counted
    return word_of_text if are_repeats else {text: text for text in texts}


def find_ending(label: str) -> str:
    """Return the word behind the number of a label: `u` of `1u`; empty for other labels."""
    found = _ENDING.fullmatch(label)
    return "" if found is None else found[1]


def find_number(label: str) -> str:
    """Return the only number of a label, without leading zeros; the label without one, or with several."""
    numbers = re.findall(r"\d+", label)
    return str(int(numbers[0])) if len(numbers) == 1 else label


def list_words_behind(names: Collection[str], labels: Collection[str]) -> list[str]:
    """Return the last words of names that are a label and such a word, of most labels: `B` of `P3_B`."""
    spelt = {spelling for label in labels for spelling in (omit_zeros(label), find_number(label))}
    counts = Counter[str]()
    for name in names:
        *parts, last = split_parts(name) or [name]
        own = " ".join(parts)
        counts[last] += omit_zeros(own) in spelt or find_number(own) in spelt
    return [word for word, count in counts.items() if 2 * count > len(labels)]
