"""Words for states and loads: what a word says of the row that has it."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Final

from jointstiff.schemas.imports import State
from jointstiff.service.importing.grammar import (
    OPPOSITE_STATE,
    STATE_OF_DIGIT,
    find_state,
    find_state_in_name,
    read_states,
)
from jointstiff.service.importing.loads import find_load, find_state_of_load
from jointstiff.service.proposals.names.labels import omit_repeat_numbers
from jointstiff.service.proposals.tables.row_name import RowName
from jointstiff.service.tables.labels import fold_word

_FORCE_WITH_UNIT: Final = re.compile(r"(\d{1,6}(?:[.,]\d{1,3})?)\s?((?:k|da)?N|kgf|kp|lbf)")


def list_state_words(texts: Sequence[str], words: Mapping[str, State]) -> dict[str, RowName]:
    """Return word → state and mass, of the words of a column of states; without words that are not known.

    If one of two words is known to mean loaded or unloaded, the other word means the other state. Numbers
    behind words for states count repeats, unless the caller states a word with its number.
    """
    different = list(dict.fromkeys(texts))
    word_of_text = omit_repeat_numbers(different)
    are_stated = not {fold_word(word) for word in words}.isdisjoint(map(fold_word, different))
    if len(set(word_of_text.values())) < len(different) and not are_stated:
        read_of_word = list_state_words(list(word_of_text.values()), words)
        if read_of_word.keys() == set(word_of_text.values()):
            return {text: read_of_word[word] for text, word in word_of_text.items()}
    known = {word: read for word in different if (read := read_state_word(word, words)) is not None}
    for word, state in read_states(different, words).items():
        known[word] = known.get(word, RowName())._replace(state=state)
    if len(different) == 2 and len(known) == 1:
        ((first, read),) = known.items()
        other = next(word for word in different if word != first)
        if read.state in OPPOSITE_STATE:
            known[other] = RowName(state=OPPOSITE_STATE[read.state])
    return known


def are_words_of_states(different: Collection[str], words: Mapping[str, State]) -> bool:
    """Return whether all words are states or loads; forces only are where another word means no load."""
    read = [read_state_word(word, words) for word in different]
    known = [each for each in read if each is not None]
    has_forces = any(each.force for each in known)
    return len(known) == len(read) and (not has_forces or any(each.state == "unloaded" for each in known))


def read_state_word(word: str, words: Mapping[str, State]) -> RowName | None:
    """Return the state, and the mass or force if the word states one; None for another word."""
    state = find_state(word, words)
    if state is not None:
        return RowName(state=state)
    mass = find_load(word)
    if mass is not None:
        state = find_state_in_name(word, words)  # `unloaded_200kg` names the load that does not hang
        is_without = state in ("unloaded", "unloaded_after")
        return RowName(state=state) if is_without else RowName(state=find_state_of_load(mass), mass=mass)
    force = _FORCE_WITH_UNIT.fullmatch(word)
    if force is not None:
        size = float(force[1].replace(",", "."))
        return RowName(state=find_state_of_load(size), force=f"{size:g} {force[2]}" if size else "")
    state = find_state(word, STATE_OF_DIGIT) or find_state_in_name(word, words)
    return None if state is None else RowName(state=state)


def add_state(name: RowName, word: str, states: Mapping[str, RowName]) -> RowName:
    """Return the name of a row with the state and the load that a word means; unchanged for other words."""
    read = states.get(word)
    return name if read is None else name._replace(state=read.state, mass=read.mass, force=read.force)
