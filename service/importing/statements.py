"""Texts in which files may state something once: their names, lines, rows of sheets, fields and arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import lru_cache
from typing import Any, Final, NamedTuple

from pydantic_core import from_json

from jointstiff.service.importing.errors import ImportFileError, quote
from jointstiff.service.importing.formats.arrays import read_arrays
from jointstiff.service.importing.formats.elements import list_leaves, read_elements
from jointstiff.service.importing.formats.yaml_rows import is_named_yaml, read_yaml_documents
from jointstiff.service.importing.grammar import UNIT_OF_LOAD, is_force, is_hung
from jointstiff.service.importing.grid import (
    ARRAYS,
    COORDINATES,
    JSON,
    WITH_SHEETS,
    XML,
    ArrayFormat,
    file_type,
)
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.importing.source_grids import read_sheets
from jointstiff.service.importing.texts.encoding import decode

_MOST_DEPTH: Final = 12
_UNIT_KEYS: Final = ("unit", "units")
"""Fields of an object with the unit of its numbers, or with units by their quantities."""

_SIZES: Final = frozenset(("value", "size", "magnitude", "amount"))
"""Names of the number of an object that its own name explains."""


class Statement(NamedTuple):
    """Text of a file, and its place."""

    place: str  # in words, such as `line 2`; empty for the name of the file
    text: str


def read_statements(file: SourceFile) -> Iterator[Statement]:
    """Yield the name of a file, and all texts in it, whatever its kind is."""
    yield Statement("", file.name.rpartition(".")[0])
    with suppress(ImportFileError):
        kind = file_type(file.content, file.name)
        if kind in WITH_SHEETS:
            yield from _read_rows(file)
        elif kind is not None and kind in ARRAYS:
            yield from _read_scalars(file, ARRAYS[kind])
        elif kind == XML:
            yield from _read_leaves(file)
        elif kind in (None, JSON):
            yield from _read_text(file)


def _read_rows(file: SourceFile) -> Iterator[Statement]:
    """Yield the names, rows and comments of all sheets of a file; a tab is between cells."""
    for sheet in read_sheets(file, None):
        yield Statement("the name of a sheet", sheet.preview.sheet or "")
        rows = [(row.line, "\t".join(filter(None, row.cells))) for row in sheet.rows]
        rows += [(comment.line, comment.text) for comment in sheet.comments]
        is_text = sheet.preview.format == "text"  # whose lines people see
        for number, text in rows:
            place = f"row {number} of the sheet {quote(sheet.preview.sheet or '')}"
            yield Statement(f"line {number}" if is_text else place, text)


def _read_scalars(file: SourceFile, kind: ArrayFormat) -> Iterator[Statement]:
    """Yield the single numbers and texts of a file of arrays."""
    for grid in read_arrays(file.name, file.content, kind, [None]):
        for scalar in grid.comments:
            yield Statement("its arrays", scalar.text)


def _read_leaves(file: SourceFile) -> Iterator[Statement]:
    """Yield the single numbers and texts of a document of XML with their names, as `mass kg: 5`."""
    for leaf in list_leaves(read_elements(file.name, file.content)):
        if len(leaf.values) == 1:
            words = " ".join((*leaf.tags, *leaf.names))
            yield Statement(f"line {leaf.line}", f"{words}: {leaf.values[0]}")


def _read_text(file: SourceFile) -> Iterator[Statement]:
    """Yield the fields of a document of JSON or YAML with its comments, or else all lines of a text.

    A line that is an object of JSON has the fields of this object.
    """
    text = decode(file.name, file.content)[0]
    is_document = False
    for document in _read_documents(file.name, text):
        is_document = True
        yield from (Statement("its fields", field) for field in _list_fields(document, "", {}, 0))
    for number, line in enumerate(text.splitlines(), 1):
        place = f"line {number}"
        if is_document:
            yield from [Statement(place, line)] if "#" in line else []
        elif line.startswith("{") and (found := _read_json(line)) is not None:
            yield from (Statement(place, field) for field in _list_fields(found, "", {}, 0))
        else:
            yield Statement(place, line)


def _read_documents(name: str, text: str) -> list[Any]:
    """Return the documents that a text is: one of JSON, or those of YAML; none for other texts."""
    if is_named_yaml(name):
        return read_yaml_documents(text)
    document = _read_json(text) if text.lstrip()[:1] in ("{", "[") else None
    return [] if document is None else [document]


def _read_json(text: str) -> Any:  # noqa: ANN401 - JSON
    """Return a document of JSON; None of another text."""
    try:
        return from_json(text)
    except ValueError:
        return None


def _list_fields(value: object, path: str, units: Mapping[str, str], depth: int) -> Iterator[str]:
    """Yield the numbers, texts and vectors of a document with their names, as `load.mass: 5 kg`.

    Args:
        value: document, or a part of it.
        path: names of the objects around the part and its own, with full stops between.
        units: name of a quantity → its unit, as objects around state it; empty name for the object itself.
        depth: number of objects and lists around.
    """
    if depth > _MOST_DEPTH or value is None:
        return
    if isinstance(value, dict):
        units = {key: unit for key, unit in units.items() if key} | _find_units(value)
        for key, each in value.items():
            yield from _list_fields(each, f"{path}.{key}" if path else str(key), units, depth + 1)
    elif not isinstance(value, list):
        yield f"{path}: {value} {_find_unit(path, units)}".rstrip()
    elif len(value) == COORDINATES and not any(isinstance(each, (dict, list)) for each in value):
        yield f"{path}: [{', '.join(map(str, value))}] {_find_unit(path, units)}".rstrip()
    else:
        for each in value:
            yield from _list_fields(each, path, units, depth + 1)


def _find_units(value: Mapping[str, Any]) -> dict[str, str]:
    """Return quantity → unit of a load, as an object states them; an empty quantity is any of the object."""
    units: dict[str, str] = {}
    for stated in (value.get(key) for key in _UNIT_KEYS):
        by_quantity = stated if isinstance(stated, dict) else {"": stated}
        units |= {
            str(key): unit
            for key, unit in by_quantity.items()
            if isinstance(unit, str) and unit in UNIT_OF_LOAD
        }
    return units


def _find_unit(path: str, units: Mapping[str, str]) -> str:
    """Return the unit of the number with a path; empty without a statement."""
    if not units:
        return ""
    name = path.rpartition(".")[2]
    if name in units:
        return units[name]
    if "force" in units and is_force(name):
        return units["force"]
    return units[""] if "" in units and _may_be_load(name) else ""


@lru_cache(maxsize=1024)
def _may_be_load(name: str) -> bool:
    """Return whether a name may be that of the size of a load."""
    return name.casefold() in _SIZES or is_force(name) or is_hung(name)
