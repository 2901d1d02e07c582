"""Report of an import for people: each column, each assumption, and missing items."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from jointstiff.schemas.imports import FilePreview, ImportAnswer, ImportPreview
from jointstiff.service.tables.report import VERDICTS

_VALUES_SHOWN = 2
_LONGEST = 24
_LINES_SHOWN = 8


def import_report(answer: ImportAnswer) -> RenderableType:
    """Each file with its columns, then all of them together, then what is missing."""
    parts: list[RenderableType] = []
    for file in answer.preview.files:
        table = Table()
        table.add_column("", justify="right")
        for heading in ("header", "read as", "unit", "first values"):
            table.add_column(heading)
        for column in file.columns:
            values = [row[column.column - 1] for row in file.first_rows if column.column <= len(row)]
            shown = [_short(value) for value in values[:_VALUES_SHOWN]]
            table.add_row(
                str(column.column),
                Text(_short(column.header)),
                Text(_short(column.meaning) + (" ?" if column.guessed else "")),
                column.unit or "",
                Text("; ".join(shown)),
            )
        parts += [
            Text(f"{file.file}: {_dialect(file)}", style="bold"),
            table,
            *_lines(file.assumptions, "assumed: "),
        ]
    parts += [_summary(answer.preview), *_lines(answer.preview.assumptions, "assumed: ")]
    if answer.poses is not None:
        count = len(answer.poses.poses)
        parts.append(Text(f"  complete: {count} unloaded poses for a geometry", style="green"))
    if answer.missing:
        parts += [*_lines(answer.missing, "missing: ", "yellow")]
    elif not has_errors(answer):
        parts.append(Text("  complete: a measurement set", style="green"))
    parts += _findings(answer)
    return Group(*parts)


def has_errors(answer: ImportAnswer) -> bool:
    """Return whether the inspection of the readings finds errors."""
    return any(finding.weight == "do_not_use" for finding in answer.findings or ())


def _findings(answer: ImportAnswer) -> Iterator[Text]:
    """Lay out the integrity findings, if a robot is known."""
    if answer.findings is None:
        return
    if not answer.findings:
        yield Text("  integrity: nothing suspicious", style="green")
    for finding in answer.findings:
        remedy = f"; {finding.remedy}" if finding.remedy else ""
        style = "red" if finding.weight == "do_not_use" else "yellow"
        place = f"{finding.observation}: " if finding.observation else ""
        yield Text(f"  {VERDICTS[finding.weight]}: {place}{finding.message}{remedy}", style=style)


def _dialect(file: FilePreview) -> str:
    """Describe the file's format."""
    rows = f"{file.row_count} row{'s' if file.row_count != 1 else ''}"
    if file.format == "xlsx":
        return f"Excel, sheet {file.sheet!r}, {rows}"
    return f"{file.encoding}, {file.delimiter} between cells, decimal {file.decimal_mark}, {rows}"


def _summary(preview: ImportPreview) -> Text:
    joints = "no joint angles" if preview.joint_count is None else f"{preview.joint_count} joints"
    targets = ", ".join(preview.targets) or "none"
    states = ", ".join(preview.states) or "none"
    more = ", …" if preview.observation_count > len(preview.first_labels) else ""
    return Text(
        f"  {preview.observation_count} observations ({', '.join(preview.first_labels)}{more}), {joints}, "
        f"{preview.reading_count} complete readings; targets: {targets}; states: {states}"
    )


def _lines(texts: list[str], lead: str, style: str = "dim") -> Iterator[Text]:
    for text in texts[:_LINES_SHOWN]:
        yield Text(f"  {lead}{text}", style=style)
    if len(texts) > _LINES_SHOWN:
        yield Text(f"  {lead}{len(texts) - _LINES_SHOWN} more (--json shows all)", style=style)


def _short(text: str) -> str:
    printable = "".join(character if character.isprintable() else "�" for character in text)
    return printable if len(printable) <= _LONGEST else printable[: _LONGEST - 1] + "…"
