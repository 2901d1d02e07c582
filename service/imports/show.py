"""An import as text: a line for each column with its role, what the robot says, and the next question."""

from __future__ import annotations

from collections.abc import Iterator

from jointstiff.schemas.imports import Cell, ImportAnswer, TableView

_MOST_COLUMNS = 64
_MOST_LETTERS = 16
_SHOWN_CELLS = 3


def show(answer: ImportAnswer) -> str:
    """Return the tables, what the robot says, faults, findings, and the first question."""
    lines = [line for table in answer.tables for line in _show_table(table)]
    lines += filter(None, [answer.sentence])
    lines += [f"! {fault}" for fault in answer.faults]
    lines += [f"! {finding.message}; {finding.remedy}" for finding in answer.findings or ()]
    for question in answer.questions[:1]:
        lines.append(f"? {question.text}")
        lines += [f"  {number}: {choice.text}" for number, choice in enumerate(question.choices, 1)]
    if answer.measurement_set is not None:
        lines.append(f"complete: {len(answer.measurement_set.observations)} observations")
    elif answer.geometry is not None:
        lines.append(f"complete: {len(answer.geometry.poses or ())} unloaded poses")
    elif answer.weight_step is not None:
        lines.append(f"complete: a weight step in {len(answer.weight_step.observations)} postures")
    return "\n".join(lines)


def _show_table(table: TableView) -> Iterator[str]:
    """Yield the name of a table, and for each column its letter, role, header and first cells."""
    yield f"{table.name}, {table.row_count} rows"
    lines = [
        [column.id, column.role or "-", column.header, *map(_shorten, column.cells[:_SHOWN_CELLS])]
        for column in table.columns[:_MOST_COLUMNS]
    ]
    widths = [max(map(len, cells)) for cells in zip(*lines, strict=True)]
    for line in lines:
        yield "  " + "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
    if len(table.columns) > _MOST_COLUMNS:
        yield f"  and {len(table.columns) - _MOST_COLUMNS} more columns"


def _shorten(cell: Cell) -> str:
    if cell is None:
        return ""
    return f"{cell:g}" if isinstance(cell, float) else cell[:_MOST_LETTERS]
