"""Words of headers in the languages of words.toml, and patterns of words."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from importlib.resources import files
from types import MappingProxyType
from typing import Final, TypeVar

_Value = TypeVar("_Value")
WORDS: Final = tomllib.loads(files(__package__).joinpath("words.toml").read_text("utf-8"))
"""Tables of words.toml."""
NO_LETTERS: Final = re.compile(r"[\W_]+")
"""What is between the words of a name."""


def values_by_word(groups: Mapping[_Value, Iterable[str]]) -> Mapping[str, _Value]:
    """Return a mapping from word to value, from the words that mean each value."""
    return MappingProxyType({word: value for value, group in groups.items() for word in group})


def build_alternation(texts: Iterable[str]) -> str:
    """Return a regular expression that matches any of the texts; a blank also matches `_` and `-`."""
    longest = sorted(texts, key=len, reverse=True)
    return "|".join(re.escape(text).replace("\\ ", r"[\s_-]+") for text in longest)
