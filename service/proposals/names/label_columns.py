"""The column of a table that names the observations of the rows, or their points."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial

from jointstiff.schemas.imports import State
from jointstiff.service.importing.grammar import is_cycle_header, is_posture_header
from jointstiff.service.importing.grid import are_texts
from jointstiff.service.proposals.names.labels import (
    COUNTED,
    LEAST_LABELS,
    MOST_CODES,
    omit_state,
    omit_zeros,
)
from jointstiff.service.proposals.names.targets import are_targets
from jointstiff.service.proposals.tables.numbers import NumberTable


def find_label_column(
    table: NumberTable, words: Mapping[str, State], known_labels: Collection[str] = ()
) -> int | None:
    """Return the column of names of observations or points; None without one.

    A column with more of the known labels, and no other text but words for states, comes before a column of
    names of points, as does one that counts the postures of points that are targets. Without a header that
    says so, the first column has names if its cells are texts, or if they are whole numbers below a header
    that is not known. A column with one text, such as a collection, may be before it.
    """
    named = table.find_column("name")
    of_known = _find_column_of_labels(table, known_labels, words)
    if of_known is not None and (named is None or _has_more_texts(table, of_known, named)):
        return of_known
    of_targets = None if named is None else _find_column_of_postures(table, named)
    if of_targets is not None:
        return of_targets
    if named is not None and len(set(table.list_texts(named))) >= LEAST_LABELS:
        return named
    first = 0
    while first + 1 < len(table.headers) and _has_one_text(table, first):
        first += 1
    if table.meanings[first] is not None or first in table.ignored:
        return _find_posture_column(table)
    texts = table.list_texts(first)
    are_counted = bool(table.headers[first]) and all(COUNTED.fullmatch(text) for text in texts)
    is_label = (are_texts(texts) or are_counted) and len(set(texts)) >= LEAST_LABELS
    cycles = _find_cycle_column(table, len(set(texts))) if are_texts(texts) else None
    if cycles is not None:
        return cycles
    posture_column = _find_posture_column(table)
    return first if is_label and posture_column is None else posture_column


def _find_column_of_postures(table: NumberTable, points: int) -> int | None:
    """Return the only column of counts that are the postures of targets named in another column; else None.

    Each posture has most of the targets.
    """
    names = table.list_texts(points)
    if points in table.stated or not 1 < len(set(names)) <= MOST_CODES:
        return None
    found = []
    for column in range(len(table.headers)):
        texts = table.list_texts(column)
        are_counted = table.is_unknown(column) and all(map(COUNTED.fullmatch, texts))
        if are_counted and are_targets(table, texts, names):
            found.append(column)
    return found[0] if len(found) == 1 else None


def _find_posture_column(table: NumberTable) -> int | None:
    """Return the first column whose header is a word for the number of a posture; None without one."""
    for column, header in enumerate(table.headers):
        has_labels = len(set(table.list_texts(column))) >= LEAST_LABELS
        if table.is_unknown(column) and is_posture_header(header) and has_labels:
            return column
    return None


def _find_column_of_labels(
    table: NumberTable, labels: Collection[str], words: Mapping[str, State]
) -> int | None:
    """Return the first column whose cells are most of the known labels, and no other text; else None.

    Without such a column, all cells may have a word for a state next to a label, such as `unloaded p01`.
    """
    known = set(map(omit_zeros, labels))
    if not known:
        return None
    free = [column for column in range(len(table.headers)) if table.may_name(column)]
    for without_state in (omit_zeros, partial(omit_state, words=words)):
        for column in free:
            own = set(map(without_state, table.list_texts(column)))
            if own <= known and 2 * len(own) > len(known):
                return column
    return None


def _has_more_texts(table: NumberTable, column: int, other: int) -> bool:
    """Return whether a column has more different texts than another one."""
    return len(set(table.list_texts(column))) > len(set(table.list_texts(other)))


def _has_one_text(table: NumberTable, column: int) -> bool:
    """Return whether all cells of a column are one text, and its header is not known otherwise."""
    meaning, texts = table.meanings[column], table.list_texts(column)
    is_free = meaning is None or meaning.kind in ("collection", "ignored")
    return is_free and len(set(texts)) == 1 and are_texts(texts)


def _find_cycle_column(table: NumberTable, target_count: int) -> int | None:
    """Return the column that counts the postures of targets in the first column; None without one.

    A column of fewer numbers than there are names counts repeats.
    """
    for column, header in enumerate(table.headers):
        texts = table.list_texts(column)
        are_counted = all(COUNTED.fullmatch(text) for text in texts)
        has_most = len(set(texts)) > max(target_count, LEAST_LABELS - 1)
        if table.is_unknown(column) and is_cycle_header(header) and are_counted and has_most:
            return column
    return None
