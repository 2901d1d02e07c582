"""Columns that the caller states, compared with the headers of files and with a proposal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.errors import NOWHERE, ImportFileError, quote
from jointstiff.service.importing.grammar import Meaning, collapse_blanks, fits_header
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.meaning.proposal import Proposal


def refuse_unknown_headers(tables: Sequence[NumberTable], request: ImportRequest) -> None:
    """Refuse a statement about a header that no file has.

    Raises:
        ImportFileError: `columns` or `ignore` names such a header, or `header` has another number of columns.
    """
    widths = {len(table.headers) for table in tables}
    if request.header is not None and len(request.header) not in widths:
        found = " or ".join(map(str, sorted(widths)))
        reason = f"`header` names {len(request.header)} columns, but the rows have {found} cells"
        are_blanks_between = any(table.grid.preview.delimiter == "whitespace" for table in tables)
        remedy = "name each column in `header`" + (
            ", without blanks in a name, such as `Fx[N]`: blanks separate the cells of the file"
            if are_blanks_between
            else ""
        )
        raise ImportFileError(NOWHERE, reason, remedy, "header")
    headers = {collapse_blanks(header) for table in tables for header in table.headers}
    for header in request.columns:
        if collapse_blanks(header) not in headers:
            raise _build_header_error("columns", header)
    for pattern in request.ignore:
        if not any(fits_header(pattern, header) for header in headers):
            raise _build_header_error("ignore", pattern)


def _build_header_error(option: str, header: str) -> ImportFileError:
    """Return the error that an option names a header that no file has."""
    reason = f"`{option}` names the header {quote(header)}, but no file has this header"
    return ImportFileError(NOWHERE, reason, f"write the header in `{option}` exactly as in the file", option)


def find_contradiction(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable]
) -> str:
    """Return which column a proposal reads otherwise than the caller states; empty if it reads none so."""
    for table in tables:
        uses = describe_uses(proposal, named, table)
        for column in sorted(table.stated):
            meaning = table.meanings[column]
            stated = "" if meaning is None else _describe_meaning(meaning, uses.get(column))
            if stated and uses.get(column) != stated:
                header = quote(table.headers[column])
                used = uses.get(column, "not read")
                return f"`columns` states that {header} is {stated}, but by the robot it is {used}"
    return ""


def describe_uses(proposal: Proposal, named: Sequence[NamedReading], table: NumberTable) -> Mapping[int, str]:
    """Return column → its meaning by a proposal, of the columns of a table that it reads."""
    uses: dict[int, str] = {}
    if table.name == proposal.joints.table:
        for number, column in enumerate(proposal.joints.columns, 1):
            uses[column] = f"J{number} [{proposal.joints.unit}]"
    own = [each for each in named if each.reading.points.table == table.name]
    for each in own:
        columns = each.reading.points.columns
        words = {other.words for other in own if other.reading.points.columns == columns}
        targets = {other.target for other in own if other.reading.points.columns == columns}
        state = each.state.replace("_", " ")
        common = f"{each.target} {state}" if len(words) == 1 else " and ".join(sorted(targets))
        for axis, column in zip("xyz", columns, strict=True):
            uses[column] = f"{common} {axis} [{proposal.unit}]"
        for column in each.uncertainty.columns if each.uncertainty else ():
            uses[column] = "U95"
    return uses


def _describe_meaning(meaning: Meaning, use: str | None) -> str:
    """Return a stated joint or position in the words of `describe_uses`; empty for other meanings.

    What is not stated, such as the unit or the state, is as in the use of the column.
    """
    if meaning.axis is None or meaning.kind not in ("joint", "position"):
        return ""
    used_words, _, used_unit = (use or "").rpartition(" ")
    unit = f"[{meaning.unit}]" if meaning.unit else used_unit
    if meaning.kind == "joint":
        return f"J{meaning.axis + 1} {unit}".strip()
    used_target, _, _ = used_words.rpartition(" ")
    target, state = meaning.quantity.target, meaning.quantity.state
    words = [target, state and state.replace("_", " ")]
    if target is None or state is None:
        words = [used_target]
    return " ".join([*(word for word in words if word), "xyz"[meaning.axis], unit])
