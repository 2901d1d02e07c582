"""Words that tell the states of a target apart: in headers, names of files, and cells of rows."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.imports import State
from jointstiff.service.importing.grammar import (
    find_any_unit,
    find_state,
    is_negation,
    read_states,
    split_unit,
)
from jointstiff.service.importing.phrases import join_state_phrases
from jointstiff.service.proposals.names.labels import find_ending
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.service.tables.labels import fold_word
from jointstiff.solver.meaning.proposal import TargetReading

_SEPARATORS: Final = re.compile(r"[\W_]+")
_CAPITAL: Final = re.compile(r"(?<=[^\W\d_A-Z])(?=[A-Z])|(?<=\d)(?=[A-Z])")
"""Where a capital begins a word, as in `pLoaded` and `T1xL`."""
_AXIS_BEHIND_NUMBER: Final = re.compile(r"(?<=\d)(?=[xyz](?![^\W_]))", re.IGNORECASE)
_AXIS: Final = re.compile(r"^[xyz]|[xyz]$", re.IGNORECASE)
_NUMBER_BEHIND: Final = re.compile(r"(?<=[^\W\d_]{3})\d+$")
_LONGEST: Final = 64


class Contrast(NamedTuple):
    """Words of a reading that another reading of its target does not have."""

    words: tuple[str, ...]
    states: frozenset[State]  # that these words mean

    @property
    def state(self) -> State | None:
        """The only state that the words mean; None if they mean none, or several."""
        return next(iter(self.states)) if len(self.states) == 1 else None


NO_CONTRAST: Final = Contrast((), frozenset())


class _Sources(NamedTuple):
    """Words of a reading by their source."""

    headers: list[str]
    title: list[str]  # of the file and the sheet
    cells: list[str]


def find_contrasts(
    readings: Sequence[TargetReading], tables: Sequence[NumberTable], words: Mapping[str, State]
) -> list[Contrast]:
    """Return what words tell each reading from the others of its target; `words` are the caller's words."""
    table_of_name = {table.name: table for table in tables}
    sources = [_list_words(reading, table_of_name[reading.points.table], words) for reading in readings]
    found = [NO_CONTRAST] * len(readings)
    for target in {reading.target for reading in readings}:
        numbers = [number for number, reading in enumerate(readings) if reading.target == target]
        own = _list_own_words([sources[number] for number in numbers])
        for number, contrast in zip(numbers, _read_contrasts(own, words), strict=True):
            found[number] = contrast
    return found


def _list_own_words(sources: Sequence[_Sources]) -> list[list[str]]:
    """Return the words of each reading that not all readings of its target have from the same source."""
    own = [list[str]() for _ in sources]
    for words_of_source in zip(*sources, strict=True):
        common = set(words_of_source[0]).intersection(*words_of_source)
        for each, words in zip(own, words_of_source, strict=True):
            each.extend(word for word in dict.fromkeys(words) if word not in common)
    return own


def _read_contrasts(own: Sequence[Sequence[str]], words: Mapping[str, State]) -> Iterator[Contrast]:
    """Yield the states of the words of each reading of a target.

    The caller's words take precedence. Words with a negation, such as `not` and `loaded`, mean no state.
    """
    stated = {fold_word(word): state for word, state in words.items()}
    state_of_word = read_states([word for each in own for word in each], words)
    for each in own:
        by_caller = {stated[fold_word(word)] for word in each if fold_word(word) in stated}
        others = {word: state_of_word[word] for word in each if word in state_of_word}
        is_negated = any(is_negation(word) for word in each) and any(not is_negation(word) for word in others)
        states = by_caller or (set() if is_negated else set(others.values()))
        yield Contrast(tuple(each), frozenset(states - {"deflection"}))


def _list_words(reading: TargetReading, table: NumberTable, words: Mapping[str, State]) -> _Sources:
    """Return the words of a reading: of its three headers, of its file, and of the cells of its rows."""
    headers = [table.headers[column] for column in reading.points.columns]
    return _Sources(
        _list_common_words(headers, words), split_header(table.title), _list_cells(reading, table)
    )


def _list_common_words(headers: Sequence[str], words: Mapping[str, State]) -> list[str]:
    """Return the words that all headers have, without the letters of axes, or numbers of coordinates."""
    split = [split_header(header) for header in headers]
    whole = set(split[0]).intersection(*split)
    split = [[word if word in whole else _strip_axis(word, words) for word in each] for each in split]
    common = [word for word in split[0] if word and all(word in other for other in split)]
    rest = [[_NUMBER_BEHIND.sub("", word) for word in each if word not in common] for each in split]
    return common + [word for word in rest[0] if word and all(word in other for other in rest)]


def _strip_axis(word: str, words: Mapping[str, State]) -> str:
    """Return a word without the letter of its axis: `1` of `X1`; a word for a state keeps its letters."""
    return word if find_state(word, words) is not None else _AXIS.sub("", word, count=1)


def split_header(header: str) -> list[str]:
    """Return the words of a header without its unit; a state takes the place of its phrase as one word.

    Words end at blanks, at signs such as `.`, `/`, `:` and brackets, and where a capital follows a small
    letter, as in `T1.Loaded.X`, `T1[loaded].x` and `T1xL`.
    """
    name, unit = split_unit(header[:_LONGEST])
    if unit is not None and find_any_unit(unit) is None:
        name = header[:_LONGEST]
    spaced = _AXIS_BEHIND_NUMBER.sub(" ", _CAPITAL.sub(" ", name))
    words = _SEPARATORS.split(join_state_phrases(_SEPARATORS.sub(" ", spaced)))
    return [word for word in words if word]


def _list_cells(reading: TargetReading, table: NumberTable) -> list[str]:
    """Return the cells of the rows of a reading that are alike in all postures, of several rows each.

    Of labels such as `1u` and `2u` it is the ending. Numbers along an axis, such as those of a force, are no
    words.
    """
    groups = reading.points.groups
    if groups.count < 2:
        return []
    numbers = np.arange(len(table.rows), dtype=np.float64)[:, None]
    rows = groups.split(numbers)[:, reading.index, 0].astype(np.intp)
    cells = list[str]()
    for column in range(len(table.headers)):
        texts = {table.rows[row].cells[column] for row in rows}
        meaning = table.meanings[column]
        may_be_word = column not in table.ignored and (meaning is None or meaning.axis is None)
        words = texts if len(texts) == 1 else set(map(find_ending, texts))
        if may_be_word and len(words) == 1:
            cells += [word for word in words if word]
    return cells


def choose_words(contrasts: Collection[Contrast]) -> tuple[str, ...]:
    """Return a word of each of two readings, or the one word of both, that a person can state.

    None if the readings are not two, or have no words.
    """
    if len(contrasts) != 2:
        return ()
    return tuple(_choose_word(each.words) for each in contrasts if each.words)


def _choose_word(words: Sequence[str]) -> str:
    """Return the first word of a reading that has letters; the first word without one."""
    return next((word for word in words if not word.isdigit()), words[0])
