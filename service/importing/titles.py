"""Titles: names of files and sheets, whose words may say in which state all their positions were read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from jointstiff.schemas.imports import State
from jointstiff.service.importing.grammar import find_state, find_state_in_name
from jointstiff.service.importing.phrases import split_words


def find_states_of_titles(titles: Sequence[str], words: Mapping[str, State]) -> dict[str, State]:
    """Return title → state, of the names of files and sheets that state one.

    A word that means something else in other names, such as `before` or `last`, counts if another title
    differs from this one by a word for another state only.

    Args:
        titles: names of files without extension, with the sheet's if there are several.
        words: the caller's words for states.
    """
    certain = {title: state for title in titles if (state := find_state_in_name(title, words)) is not None}
    split = {title: _split_title(title, words) for title in titles}
    found = dict(certain)
    for title, own in split.items():
        others = [other for name, other in split.items() if name != title and other.rest == own.rest]
        has_other_state = any(other.state not in (None, own.state) for other in others)
        if own.state is not None and has_other_state:
            found.setdefault(title, own.state)
    return found


class _Title(NamedTuple):
    """Words of the name of a file or sheet."""

    state: State | None  # that exactly one word means
    rest: tuple[str, ...]  # other words, in lower case


def _split_title(title: str, words: Mapping[str, State]) -> _Title:
    """Return the only state that words of a title mean, and its other words."""
    states, rest = list[State](), list[str]()
    for word in split_words(title):
        state = find_state(word, words)
        states += [] if state is None else [state]
        rest += [word.casefold()] if state is None else []
    return _Title(states[0] if len(states) == 1 else None, tuple(rest))
