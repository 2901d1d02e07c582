"""The column of a table whose words are states of load, and what its words mean."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

from jointstiff.schemas.imports import ImportOptions, State
from jointstiff.service.importing.grammar import (
    OPPOSITE_STATE,
    find_answer,
    find_state,
    find_stated_state,
    is_load_header,
    is_no_load_header,
    read_states,
)
from jointstiff.service.importing.grid import are_texts
from jointstiff.service.importing.loads import find_load
from jointstiff.service.proposals.names.labels import MOST_CODES, omit_repeat_numbers
from jointstiff.service.proposals.names.state_words import (
    are_words_of_states,
    list_state_words,
    read_state_word,
)
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.service.proposals.tables.row_name import RowName
from jointstiff.service.tables.labels import fold_word

MOST_DIFFERENT: Final = 2
"""States of a column of words that nobody knows."""
_FORCE: Final = re.compile(r"[-+]?(\d{1,6}(?:[.,]\d{1,3})?)\s?(?:(?:k|da)?N|kgf|kp|lbf|kg|lbs?)?")
"""A force or a mass, with or without its unit."""


def find_state_column(table: NumberTable, options: ImportOptions, label_column: int | None) -> int | None:
    """Return the column whose cells are words for states or loads, at least two; None without one."""
    named = table.find_column("state")
    if named is not None:
        return named
    free = [c for c in range(len(table.headers)) if c != label_column and c not in table.ignored]
    for column in free:
        if _has_stated_words(table, column, options.state_words):
            return column
    for column in free:
        if _find_answers(table, column, options.state_words):
            return column
    return _find_column_of_words(table, options, free)


def _has_stated_words(table: NumberTable, column: int, words: Mapping[str, State]) -> bool:
    """Return whether a column has two words or more that are, or contain, the caller's words for states.

    Of two words of a column of names, the caller may state one: the other one means the other state.
    """
    word_of_text = omit_repeat_numbers(table.list_texts(column))
    stated = [each for each in word_of_text.items() if any(find_stated_state(word, words) for word in each)]
    different = set(word_of_text.values())
    may_state_one = len(different) == MOST_DIFFERENT and table.may_name(column)
    return len(different) > 1 and (len(stated) == len(word_of_text) or (may_state_one and bool(stated)))


def _find_column_of_words(table: NumberTable, options: ImportOptions, columns: Sequence[int]) -> int | None:
    """Return the first of some columns without a known header whose cells are words for states or loads.

    A column of groups is such a column if its groups have different states or loads.
    """
    for column in columns:
        meaning = table.meanings[column]
        if meaning is not None and meaning.kind == "group" and _has_groups_in_states(table, column, options):
            return column
        if meaning is not None:
            continue
        texts = table.list_texts(column)
        words = set(omit_repeat_numbers(texts).values())
        if not 1 < len(words) <= MOST_CODES or not are_texts(list(words)):
            continue
        are_opposites = read_states(words, options.state_words).keys() == words
        are_states = are_opposites or are_words_of_states(words, options.state_words)
        # Next to a load such as `100 kg`, another word means no load.
        has_load = len(words) == 2 and any(find_load(word) for word in words)
        if are_states or (has_load and len(list_state_words(texts, options.state_words)) == 2):
            return column
    return None


def _has_groups_in_states(table: NumberTable, column: int, options: ImportOptions) -> bool:
    """Return whether the groups of a column are words for states or loads, and no two are alike."""
    groups = set(table.list_texts(column))
    read = {read_state_word(group, options.state_words) for group in groups}
    return 1 < len(read) == len(groups) <= MOST_CODES and are_words_of_states(groups, options.state_words)


def list_states(table: NumberTable, column: int, words: Mapping[str, State]) -> dict[str, RowName]:
    """Return word → state and mass, of the words of a column of states; without words that are not known."""
    answers = _find_answers(table, column, words)
    if is_no_load_header(table.headers[column]) and answers:
        return answers
    return list_state_words(table.list_texts(column), words) or answers


def _find_answers(table: NumberTable, column: int, words: Mapping[str, State]) -> dict[str, RowName]:
    """Return word → state of a column below a header such as `load`: no and yes, or no force and a force.

    Below a header such as `unloaded`, no and yes mean the other state, unless the caller states the words. A
    column of other words, or of more than two, has no answers, as one of several forces.
    """
    meaning = table.meanings[column]
    is_free = meaning is None or meaning.kind == "state"
    is_about_no_load = is_no_load_header(table.headers[column])
    if not is_free or not (is_about_no_load or is_load_header(table.headers[column])):
        return {}
    different = list(dict.fromkeys(table.list_texts(column)))
    if len(different) != MOST_DIFFERENT:
        return {}
    if is_about_no_load:
        stated = {fold_word(word): state for word, state in words.items()}
        opposites = {word: OPPOSITE_STATE.get(find_answer(word)) for word in different}
        states = {word: stated.get(fold_word(word), opposites[word]) for word in different}
    else:
        states = {word: _read_answer(word, words) for word in different}
    if set(states.values()) != {"unloaded", "loaded"}:
        return {}
    return {word: RowName(state=state) for word, state in states.items()}


def _read_answer(word: str, words: Mapping[str, State]) -> State | None:
    """Return the state that a cell below a header such as `load` means; None for other cells.

    A mass in kg is read with its number elsewhere.
    """
    state = find_state(word, words) or find_answer(word)
    if state is not None or find_load(word) is not None:
        return state
    force = _FORCE.fullmatch(word)
    if force is None:
        return None
    return "loaded" if float(force[1].replace(",", ".")) > 0.0 else "unloaded"
