"""Phrases of each language for a state of load, such as `no load`, in headers and in names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from itertools import product
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.imports import State
from jointstiff.service.importing.words import NO_LETTERS, WORDS, build_alternation, values_by_word
from jointstiff.service.tables.labels import fold_word

_FORMS_OF_PHRASES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "before": "{sign} {load}",
        "behind": "{load} {sign}",
        "joined_before": "{sign}{load}",
        "joined_behind": "{load}{sign}",
    }
)
"""Place of the words that say whether a load hangs → a phrase of such a word and a word for the load."""


def _build_phrases() -> dict[str, State]:
    """Return phrase → state, of each word for a load with each word of its language that it hangs or not."""
    return {
        fold_word(form.format(sign=sign, load=load)): state
        for group in WORDS["phrases"]
        for place, form in _FORMS_OF_PHRASES.items()
        for state, signs in group.get(place, {}).items()
        for sign, load in product(signs, group["load"])
    }


STATE_OF: Final[Mapping[str, State]] = MappingProxyType(
    {**_build_phrases(), **values_by_word(WORDS["states"])}
)
"""Word or phrase → its state."""


def _build_phrase_alternation(phrases: Iterable[str]) -> str:
    """Return a regular expression that matches any of the phrases: each first word, then those behind it."""
    rests_of_word: dict[str, list[str]] = {}
    for phrase in phrases:
        first, _, rest = phrase.partition(" ")
        rests_of_word.setdefault(first, []).append(rest)
    found = (
        rf"{re.escape(first)}[\s_-]+(?:{build_alternation(rests)})" for first, rests in rests_of_word.items()
    )
    return "|".join(found)


_PHRASES: Final = [word for word in STATE_OF if " " in word]
_FIRST_WORDS: Final = frozenset(NO_LETTERS.split(phrase)[0] for phrase in _PHRASES)
"""First words of phrases: a text without them needs no search for hundreds of phrases."""
_PHRASE_IN_HEADER: Final = re.compile(
    rf"(?<![^\s_])(?:{_build_phrase_alternation(_PHRASES)})\.?(?![^\s_])", re.IGNORECASE
)
_PHRASES_IN_NAMES: Final = [phrase for phrase in _PHRASES if not phrase[-1].isdigit()]
_PHRASE_IN_NAME: Final = re.compile(
    rf"(?<![^\W_])(?:{_build_phrase_alternation(_PHRASES_IN_NAMES)})(?![^\W_])", re.IGNORECASE
)
"""A phrase in a name; those with a digit are left out, as the digit may be a target."""


def join_phrases_of_header(header: str) -> str:
    """Return a header in which a state takes the place of its phrase as one word, such as of `no load`."""
    return _join_phrases(_PHRASE_IN_HEADER, header)


def join_state_phrases(name: str) -> str:
    """Return a name in which a state takes the place of its phrase as one word, such as of `no load`."""
    return _join_phrases(_PHRASE_IN_NAME, name)


def _join_phrases(phrase: re.Pattern[str], text: str) -> str:
    """Return a text in which a state takes the place of each phrase as one word."""
    if _FIRST_WORDS.isdisjoint(NO_LETTERS.split(text.casefold())):
        return text
    return phrase.sub(_write_state, text)


def _write_state(phrase: re.Match[str]) -> str:
    """Return the state of a phrase as one word."""
    words = re.split(r"[\s_-]+", fold_word(phrase[0]).rstrip("."))
    return STATE_OF[" ".join(words)].replace("_", "")


def split_words(name: str) -> list[str]:
    """Return the words of a name; a state takes the place of its phrase as one word."""
    return NO_LETTERS.split(join_state_phrases(name))
