"""Files of any type as grids of cells: a grid for each sheet, array, block or matrix."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Final

from pydantic_core import from_json

from jointstiff.schemas.imports import Delimiter, ImportOptions
from jointstiff.service.importing import grid
from jointstiff.service.importing.adjacent_tables import split_adjacent
from jointstiff.service.importing.axis_rows import join_axis_rows
from jointstiff.service.importing.cell_units import separate_units
from jointstiff.service.importing.errors import ImportFileError, Place
from jointstiff.service.importing.formats.arrays import build_grids_of_matrices, read_arrays
from jointstiff.service.importing.formats.blocks import read_blocks
from jointstiff.service.importing.formats.certificates import read_certificate
from jointstiff.service.importing.formats.excel import read_workbook
from jointstiff.service.importing.formats.forms import join_forms
from jointstiff.service.importing.formats.json_rows import build_error_of_list, read_json_rows
from jointstiff.service.importing.formats.latex import read_latex
from jointstiff.service.importing.formats.matrices import find_matrices, list_comments
from jointstiff.service.importing.formats.opendocument import read_spreadsheet
from jointstiff.service.importing.formats.val3 import read_joint_data
from jointstiff.service.importing.formats.web_pages import read_web_page
from jointstiff.service.importing.formats.yaml_rows import read_yaml_rows
from jointstiff.service.importing.grammar import Vocabulary
from jointstiff.service.importing.grid import Grid, file_type, read_lists, read_text
from jointstiff.service.importing.sheets import (
    choose_sheets,
    list_tables,
    note_others,
    refuse_unknown_sheets,
    split_sheets,
)
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.importing.texts.encoding import decode, describe_encoding


def read_grids(file: SourceFile, options: ImportOptions, *, every_length: bool = False) -> list[Grid]:
    """Read a workbook, a file of arrays, a certificate or a text file as rows of cells.

    There is a table for each sheet.

    With `every_length`, for a proposal, the arrays of each number of rows in a file of arrays make a table;
    so do matrices in a text, and tables side by side. Units are taken out of cells.

    Raises:
        ImportFileError: the file is empty, of another type, or cannot be read.
    """
    if not file.content.strip():
        raise ImportFileError(Place(file.name), "the file is empty", "export the file again")
    kind = file_type(file.content, file.name)
    if kind is not None and kind in grid.ARRAYS:
        sheets = split_sheets(options.sheet)
        arrays = read_arrays(file.name, file.content, grid.ARRAYS[kind], sheets, every_length=every_length)
        return _mark_sheets(arrays)
    if kind == grid.CERTIFICATE:
        return read_certificate(file.name, file.content)
    if kind == grid.VAL3:
        return _mark_sheets(read_joint_data(file.name, file.content))
    if kind in grid.WITH_SHEETS:
        grids = _read_sheets(file, options, every_length=every_length)
    else:
        grids = list(map(_note_encoding, _read_text_grids(file, kind, options, every_length=every_length)))
    if every_length:
        adjacent = [table for each in grids for table in split_adjacent(each)]
        grids = _mark_sheets(adjacent) if len(adjacent) > len(grids) else grids
    joined = [join_axis_rows(each, Vocabulary(options), with_nominal=every_length) for each in grids]
    return list(map(separate_units, joined)) if every_length else joined


def read_sheets(file: SourceFile, stated: str | None) -> list[Grid]:
    """Return the sheets of a workbook, or the tables of a document; `stated` are their names, None for all.

    Raises:
        ImportFileError: the file cannot be read, has no sheet of a name, or is a document without readings.
    """
    kind = file_type(file.content, file.name) or ""
    sheets = _SHEET_READERS[kind](file.name, file.content, stated)
    if not sheets:
        raise _build_type_error(file, kind)
    return sheets


_SHEET_READERS: Final[Mapping[str, Callable[[str, bytes, str | None], list[Grid]]]] = MappingProxyType(
    {
        grid.WORKBOOK: read_workbook,
        grid.SPREADSHEET: read_spreadsheet,
        grid.WEB_PAGE: read_web_page,
        grid.LATEX: read_latex,
    }
)
"""Type of a file → reader of its sheets."""


def _read_sheets(file: SourceFile, options: ImportOptions, *, every_length: bool) -> list[Grid]:
    """Read the sheets of a file that the options state, or those whose numbers can be read together.

    With `every_length`, for a proposal, forms of one posture each are one table.

    Raises:
        ImportFileError: the file cannot be read, or the choice of the sheets is not clear.
    """
    sheets = read_sheets(file, options.sheet)
    tables = list_tables(sheets) if options.sheet is None else sheets
    forms = join_forms(tables, Vocabulary(options)) if every_length else None
    if forms is not None:
        chosen = [forms]
    elif options.sheet is None:
        chosen = choose_sheets(tables, options.state_words)
    else:
        chosen = tables
    others = [sheet for sheet in sheets if sheet not in tables]
    grids = note_others(_mark_sheets(chosen), others)
    return list(map(_note_encoding, grids))


def _mark_sheets(sheets: Sequence[Grid]) -> list[Grid]:
    """Return sheets or groups of a file, which know whether they are several."""
    names = {sheet.preview.sheet for sheet in sheets}
    return [replace(sheet, is_one_of_several=len(names) > 1) for sheet in sheets]


def _note_encoding(table: Grid) -> Grid:
    """Return a table with the note that its encoding was assumed, unless the bytes show the encoding."""
    notes = [*describe_encoding(table.preview.encoding), *table.preview.assumptions]
    return replace(table, preview=table.preview.model_copy(update={"assumptions": notes}))


def _read_text_grids(
    file: SourceFile, kind: str | None, options: ImportOptions, *, every_length: bool
) -> list[Grid]:
    """Read a text file, whose type may be JSON, as rows of cells; arguments as of `read_grids`.

    Raises:
        ImportFileError: the file is of another type, or cannot be read.
    """
    if file.is_table:
        return [read_text(file.name, file.content, options.delimiter, is_table=True)]
    is_text = kind in (None, grid.JSON)  # a matrix without a name begins as a list of JSON does
    objects = _read_objects(file, kind, options) if is_text else []
    if objects:
        return objects
    matrices = _read_matrices(file) if is_text else []
    if every_length and matrices:
        return matrices
    lists = read_lists(file.name, file.content) if is_text else None
    if lists is not None:
        return [lists]
    if kind is not None:
        raise _build_type_error(file, kind)
    if every_length:
        blocks = read_blocks(file.name, file.content, options.delimiter)
        if blocks:
            return blocks
    return [read_text(file.name, file.content, options.delimiter, are_marks_literal=every_length)]


def _read_objects(file: SourceFile, kind: str | None, options: ImportOptions) -> list[Grid]:
    """Return the objects of a file of JSON or YAML as tables; none of another text.

    Of several kinds of messages the option `sheet` names those to be read.

    Raises:
        ImportFileError: the text is damaged, or the table is too large.
    """
    read = read_json_rows if kind == grid.JSON else read_yaml_rows
    tables = _mark_sheets(read(file.name, file.content))
    if options.sheet is None or len(tables) < 2:
        return tables
    table_of_kind = {str(table.preview.sheet): table for table in tables}
    refuse_unknown_sheets(file.name, options.sheet, table_of_kind, "the file has no messages")
    return [table_of_kind[kind] for kind in split_sheets(options.sheet) if kind is not None]


def _read_matrices(file: SourceFile) -> list[Grid]:
    """Return the matrices of a text file as tables; none of another text.

    Raises:
        ImportFileError: the text computes with a matrix.
    """
    text, encoding = decode(file.name, file.content)
    matrices = find_matrices(file.name, text)
    return build_grids_of_matrices(file.name, encoding, matrices, list_comments(text)) if matrices else []


def _build_type_error(file: SourceFile, kind: str) -> ImportFileError:
    """Return the error that a file of this type is no table."""
    remedy = "export the readings as CSV, text or .xlsx"
    if kind == grid.JSON:
        try:
            document = from_json(file.content.removeprefix(b"\xef\xbb\xbf"))
        except ValueError as error:
            reason = f"Invalid JSON: {error}"
            remedy = "correct the JSON at this place; the file must be UTF-8"
            return ImportFileError(Place(file.name), reason, remedy)
        error_of_list = build_error_of_list(file.name, document)
        if error_of_list is not None:
            return error_of_list
        remedy = "a campaign needs no import: use `jointstiff identify FILE`"
        if isinstance(document, dict) and "model" in document:
            kind = "a robot"
            remedy = "give this file as the robot of readings: `jointstiff import READINGS --robot FILE`"
    return ImportFileError(Place(file.name), f"the file is {kind}, not a table", remedy).mark_document()


def detect_delimiter(file: SourceFile) -> Delimiter | None:
    """Return the delimiter of a text file; None for other files, and if the delimiter is not certain."""
    if file_type(file.content, file.name) is not None:
        return None
    try:
        return read_text(file.name, file.content, None).preview.delimiter
    except ImportFileError:
        return None
