"""Previews of files whose columns a proposal explains, as the files are written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from jointstiff.schemas.imports import MAX_PREVIEW_ROWS, ColumnMeaning, FilePreview, State
from jointstiff.service.proposals.columns.left import find_named_kind
from jointstiff.service.proposals.columns.stated import describe_uses
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.tables.kinds import KEPT_KINDS
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.meaning.proposal import Proposal

_NAMES: Final = frozenset(("name", "target", "state", "time"))
"""Kinds of columns that name rows."""


def preview_tables(
    proposal: Proposal,
    named: Sequence[NamedReading],
    tables: Sequence[NumberTable],
    state_words: Mapping[str, State],
) -> list[FilePreview]:
    """Return a preview of each table, with the meaning of each column by a proposal.

    `state_words` are the caller's words for states.
    """
    return [_preview(proposal, named, table, state_words) for table in tables]


def _preview(
    proposal: Proposal, named: Sequence[NamedReading], table: NumberTable, state_words: Mapping[str, State]
) -> FilePreview:
    """Return the preview of a table; `state_words` are the caller's words for states."""
    uses = describe_uses(proposal, named, table)
    columns, of_file = [], [column for column in range(len(table.headers)) if column not in table.copies]
    for column in of_file:
        header = table.headers[column]
        words, _, unit = uses.get(column, _describe_other(table, column, state_words)).partition(" [")
        meaning = ColumnMeaning(
            column=column + 1, header=header, meaning=words, unit=unit.rstrip("]") or None
        )
        columns.append(meaning)
    first_rows = table.rows[:MAX_PREVIEW_ROWS]
    shown = [table.grid.show_cells(row) for row in first_rows]
    understood = {
        "decimal_mark": table.mark if table.grid.preview.format == "text" else None,
        "columns": columns,
        "row_count": len(table.rows),
        "first_rows": [[cells[column] for column in of_file] for cells in shown],
        "first_lines": [row.line for row in first_rows],
    }
    return table.grid.preview.model_copy(update=understood)


def _describe_other(table: NumberTable, column: int, state_words: Mapping[str, State]) -> str:
    """Return the meaning of a column that is no joint and no position: what it names, or `ignored`."""
    meaning = table.meanings[column]
    if column == table.label_column:
        return "name"
    if meaning is None or meaning.kind not in KEPT_KINDS | _NAMES:
        return find_named_kind(table, column, state_words) or "ignored"
    return f"{meaning} [{meaning.unit}]" if meaning.unit else str(meaning)
