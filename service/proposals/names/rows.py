"""Names of the rows of a table without known columns: observation, target, state and load of each row."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from typing import Final

from jointstiff.schemas.imports import ImportOptions
from jointstiff.service.importing.grid import are_texts
from jointstiff.service.proposals.names.label_columns import find_label_column
from jointstiff.service.proposals.names.labels import split_parts
from jointstiff.service.proposals.names.loads import add_loads
from jointstiff.service.proposals.names.points import split_names
from jointstiff.service.proposals.names.state_words import add_state
from jointstiff.service.proposals.names.states import MOST_DIFFERENT, find_state_column, list_states
from jointstiff.service.proposals.names.targets import add_targets, find_target_column
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.service.proposals.tables.row_name import RowName

_WORD: Final = re.compile(r"[^\W\d_]+")
"""A part of a name without digits, which may be a state: repeats have numbers."""


def name_rows(
    table: NumberTable, options: ImportOptions, known_labels: Collection[str] = ()
) -> list[RowName]:
    """Name the rows of a table: by its columns, then by the parts of its names of points.

    Args:
        table: table with rows of numbers.
        options: words for states, and the template of names of points.
        known_labels: names of the observations in another table, which are parts of the names of points.
    """
    label_column = None if options.by_order else find_label_column(table, options.state_words, known_labels)
    state_column = find_state_column(table, options, label_column)
    target_column = find_target_column(table, (label_column, state_column))
    are_observations = False
    names = [RowName()] * len(table.rows)
    if label_column is not None:
        texts = table.list_texts(label_column)
        are_observations = len(set(texts)) == len(texts) and set(texts) <= set(known_labels)
        names = split_names(table, label_column, options, known_labels)
    states = {}
    if state_column is not None:
        states = list_states(table, state_column, options.state_words)
    named = []
    for row, name in zip(table.rows, names, strict=True):
        if target_column is not None:
            name = name._replace(target=row.cells[target_column])
        if state_column is not None:
            name = add_state(name, row.cells[state_column], states)
        named.append(name)
    named = named if are_observations else add_loads(table, named)
    return _omit_row_numbers(add_targets(table, named))


def _omit_row_numbers(names: list[RowName]) -> list[RowName]:
    """Return the names without labels that number the rows, if other names distinguish rows of a posture."""
    labels = [name.label for name in names]
    are_row_numbers = len(set(labels)) == len(names) and len({name.key for name in names}) > 1
    return [name._replace(label=None) for name in names] if are_row_numbers else names


def find_unknown_states(table: NumberTable, options: ImportOptions) -> tuple[str, ...]:
    """Return the two words of a column that may be states; none unless one column has two words."""
    label_column = None if options.by_order else find_label_column(table, options.state_words)
    if find_state_column(table, options, label_column) is not None:
        return ()
    found = []
    for column in range(len(table.headers)):
        words = tuple(dict.fromkeys(table.list_texts(column)))
        is_free = column != label_column and table.is_unknown(column)
        if is_free and len(words) == MOST_DIFFERENT and are_texts(words):
            found.append(words)
    return found[0] if len(found) == 1 else ()


def find_different_words(table: NumberTable, column: int, rows: Sequence[int]) -> tuple[str, ...]:
    """Return the words by which the cells of rows differ; none for numbers, times and known other columns."""
    texts = list(dict.fromkeys(table.rows[row].cells[column] for row in rows))
    if not table.may_name(column) or len(texts) < 2:
        return ()
    words_of_text = [[part for part in split_parts(text) if _WORD.fullmatch(part)] for text in texts]
    common = set(words_of_text[0]).intersection(*words_of_text)
    return tuple(dict.fromkeys(word for each in words_of_text for word in each if word not in common))
