"""Forms in workbooks: a sheet, or a block of rows, for each posture, with joints and a table of targets."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from jointstiff.service.importing import limits
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grammar import (
    POINTS,
    Vocabulary,
    find_state_in_name,
    find_unit_of_force,
    is_force,
    lacks_number,
    split_unit,
)
from jointstiff.service.importing.grid import CellKind, Grid, Row, count_numbers, looks_like_a_number

_LEAST_FORMS: Final = 3
"""Postures, at least, each with a form."""
_JOINTS: Final = range(3, 8)
"""Numbers of joints that a form names."""
_LEAST_COORDINATES: Final = 3
_TEXT: Final[CellKind] = "text"
_NUMBER: Final = re.compile(r"\d+(?:[.,]\d+)?")


class _Value(NamedTuple):
    """Number of a form."""

    header: str  # words of its row and of the rows above it
    line: int  # of its row
    cell: str
    kind: CellKind


class _Form(NamedTuple):
    """Rows of one posture."""

    label: str
    line: int  # of its first row
    values: list[_Value]

    @property
    def headers(self) -> tuple[str, ...]:
        """Words of the numbers, in their order."""
        return tuple(value.header for value in self.values)


def join_forms(sheets: Sequence[Grid], words: Vocabulary) -> Grid | None:
    """Return one table of forms with a row for each posture; None of other sheets.

    The forms are the sheets of a workbook, or blocks of one sheet that begin with titles such as `Pose 1`.

    Raises:
        ImportFileError: a form has other numbers than the others.
    """
    is_single = len(sheets) == 1
    forms = _read_blocks(sheets[0], words) if is_single else [_read_sheet(sheet, words) for sheet in sheets]
    counts = Counter(form.headers for form in forms)
    headers, count = counts.most_common(1)[0] if counts else ((), 0)
    if count < _LEAST_FORMS or 2 * count <= len(forms):
        return None
    usual = next(form for form in forms if form.headers == headers)
    if not _is_of_one_posture(usual, words):
        return None
    file = sheets[0].file
    forms = [_complete(form, headers, words, file) for form in forms]
    notes = [note for sheet in sheets for note in sheet.preview.assumptions]
    notes = [f"{len(forms)} forms were read as postures", *dict.fromkeys(notes)]
    name = sheets[0].preview.sheet if len(sheets) == 1 else None
    preview = sheets[0].preview.model_copy(update={"sheet": name, "assumptions": notes})
    rows = [_write_row(form.line, form.label, form.values) for form in forms]
    texts = (_TEXT,) * (1 + len(headers))
    header = Row(rows[0].line, ("label", *headers), texts)
    return Grid(preview, (header, *rows))


def _write_row(line: int, label: str, values: Sequence[_Value]) -> Row:
    """Return the row of a posture."""
    cells = (label, *(value.cell for value in values))
    return Row(line, cells, (_TEXT, *(value.kind for value in values)))


def _is_of_one_posture(form: _Form, words: Vocabulary) -> bool:
    """Return whether the words of a form name coordinates and joints, each number once.

    Joints may have names that are not known, such as those of another language: the robot finds them. They
    are not in rows of coordinates, as the times of readings are.
    """
    headers = form.headers
    if len(set(headers)) < len(headers) or len(headers) >= limits.MAX_COLUMNS:
        return False
    words.add_names_of_table(headers)
    meanings = [words.find(header) for header in headers]
    joints = [each.axis for each in meanings if each is not None and each.kind == "joint"]
    if not joints:
        named = list(zip(form.values, meanings, strict=True))
        coordinates = [value for value, each in named if each is not None and each.kind == "position"]
        lines = {value.line for value in coordinates}
        unknown_count = sum(each is None and value.line not in lines for value, each in named)
        return len(coordinates) >= _LEAST_COORDINATES and unknown_count >= _JOINTS.start
    other_count = len(headers) - len(joints)
    is_each_once = sorted(axis or 0 for axis in joints) == list(range(len(joints)))
    return len(joints) in _JOINTS and is_each_once and other_count >= _LEAST_COORDINATES


def _complete(form: _Form, headers: Sequence[str], words: Vocabulary, file: str) -> _Form:
    """Return a form with an empty cell for each number that the form lacks, such as those of a hidden target.

    Raises:
        ImportFileError: the form lacks a joint, or has other numbers than those of the headers.
    """
    if form.headers == tuple(headers):
        return form
    value_of_header = {value.header: value for value in form.values}
    lacking = [header for header in headers if header not in value_of_header]
    more = [header for header in form.headers if header not in headers]
    present = tuple(header for header in headers if header in value_of_header)
    meanings = [words.find(header) for header in lacking]
    are_coordinates = all(meaning is not None and meaning.kind in POINTS for meaning in meanings)
    if not more and are_coordinates and form.headers == present:
        empty = (_Value(header, form.line, "", _TEXT) for header in headers)
        return form._replace(values=[value_of_header.get(value.header, value) for value in empty])
    reason = f"the form {quote(form.label)} has the numbers of other forms in another order"
    if lacking or more:
        verb = "lacks" if lacking else "has, unlike other forms,"
        reason = f"the form {quote(form.label)} {verb} {quote((lacking or more)[0])}"
    raise ImportFileError(Place(file, form.line), reason, "complete the form, or remove it")


def _read_sheet(sheet: Grid, words: Vocabulary) -> _Form:
    """Return the form in a sheet, whose name is the name of the posture."""
    return _Form(sheet.preview.sheet or "", sheet.rows[0].line, list(_list_values(sheet.rows, words)))


def _read_blocks(sheet: Grid, words: Vocabulary) -> list[_Form]:
    """Return the form of each block that begins with a title such as `Pose 1`; none without such titles."""
    titles = [_find_title(row) for row in sheet.rows]
    kinds = Counter(_NUMBER.sub("0", title) for title in titles if title)
    kind, count = kinds.most_common(1)[0] if kinds else ("", 0)
    if count < _LEAST_FORMS:
        return []
    starts = [k for k, title in enumerate(titles) if title and _NUMBER.sub("0", title) == kind]
    has_data_above = any(count_numbers(row) >= _LEAST_COORDINATES for row in sheet.rows[: starts[0]])
    if has_data_above:
        return []
    ends = [*starts[1:], len(titles)]
    return [
        _Form(titles[start], sheet.rows[start].line, list(_list_values(sheet.rows[start + 1 : end], words)))
        for start, end in zip(starts, ends, strict=True)
    ]


def _find_title(row: Row) -> str:
    """Return the text of a row that is a title with one number, such as `Pose 1`; empty for other rows."""
    filled = [cell for cell in row.cells if cell]
    text = " ".join(filled)
    is_title = len(filled) <= 2 and not looks_like_a_number(filled[0])
    return text if is_title and len(_NUMBER.findall(text)) == 1 else ""


def _list_values(rows: Sequence[Row], words: Vocabulary) -> Iterator[_Value]:
    """Yield the numbers of a form with the words of their rows, and of the row of texts above them.

    The texts above hold for each row below them that begins with a text, and for one other row.
    """
    above: tuple[str, ...] = ()
    is_below_texts = False
    for row in rows:
        columns = [k for k, cell in enumerate(row.cells) if looks_like_a_number(cell)]
        is_missing = any(cell and lacks_number(cell) for cell in row.cells[1:])
        if not columns and is_missing:
            continue
        if not columns:
            above = _join_groups(above, row.cells) if is_below_texts else row.cells
            is_below_texts = True
            continue
        is_below_texts = False
        if columns[0] > 0 and not any(row.cells[: columns[0]]):
            above = _spread_unit(above, words)
        yield from _name_numbers(row, columns, above)
        if columns[0] == 0 or not any(row.cells[: columns[0]]):
            above = ()


def _spread_unit(headers: Sequence[str], words: Vocabulary) -> tuple[str, ...]:
    """Return headers of the parts of a force with the unit in the first cell, such as `Force [kN]`.

    Other headers, and those with a unit, do not change. No number is below the first cell.
    """
    first, *parts = headers or ("",)
    unit = find_unit_of_force(first) if is_force(first) else None
    meanings = [words.find(part) for part in parts if part]
    are_forces = all(each is not None and each.kind == "force" and each.unit is None for each in meanings)
    if unit is None or not are_forces:
        return tuple(headers)
    return (first, *(f"{part} [{unit}]" if part else "" for part in parts))


def _name_numbers(row: Row, columns: Sequence[int], above: Sequence[str]) -> Iterator[_Value]:
    """Yield the numbers in some columns of a row, named by the texts before them and above them."""
    own_words = " ".join(cell for cell in row.cells[: columns[0]] if cell)
    texts = (_TEXT,) * len(row.cells)
    kinds = row.kinds or texts
    are_named_above = all(column < len(above) and above[column] for column in columns)
    for number, column in enumerate(columns):
        before = row.cells[column - 1] if column else ""
        if len(columns) == 1 and own_words:
            unit = split_unit(above[column])[1] if are_named_above else None
            has_unit = unit is None or split_unit(before)[1] is not None
            header = before if has_unit else f"{before} [{unit}]"
        elif are_named_above:
            header = f"{own_words} {above[column]}".strip()
        elif len(columns) == _LEAST_COORDINATES and own_words:
            header = f"{own_words} {'xyz'[number]}"
        else:
            header = f"{own_words} {number + 1}".strip()
        yield _Value(header, row.line, row.cells[column], kinds[column])


def _join_groups(above: Sequence[str], cells: Sequence[str]) -> tuple[str, ...]:
    """Return the texts of a row with the groups above them: `ohne Last` above `X`, `Y` gives `ohne Last X`.

    A row with one text is a title or a remark, and no row of groups; nor is a field.
    """
    if sum(map(bool, above)) < 2 or _is_field(above, cells):
        return tuple(cells)
    joined, group = [], ""
    for column, cell in enumerate(cells):
        own = above[column] if column < len(above) else ""
        group = own or (group if cell else "")
        joined.append(f"{group} {cell}".strip())
    return tuple(joined)


def _is_field(above: Sequence[str], cells: Sequence[str]) -> bool:
    """Return whether a row is a field such as `Load`, `12 kg`, and no group above the cells of the next row.

    Below a group, the first cell is empty, or the text of the group tells a state.
    """
    filled = [column for column, cell in enumerate(above) if cell]
    return filled == [0, 1] and bool(cells[0]) and find_state_in_name(above[1], {}) is None
