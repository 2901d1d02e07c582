"""Files as plain tables: text and JSON by Python, everything else by a library in a process with limits."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path, PurePath
from typing import Any, Final

from jointstiff.schemas.imports import Cell
from jointstiff.service.conversion.child import ask_child
from jointstiff.service.imports.tables import MAX_BYTES, MAX_FILES, Table, TableError, build_table
from jointstiff.service.imports.texts import decode, parse_cell, read_grid, read_text
from jointstiff.service.problems import EXTRAS

TEMPLATE: Final = "https://github.com/jointstiff/jointstiff/blob/main/docs/import.md#a-table-of-your-own"
EXPORT: Final = f"export the readings as a table (csv, xlsx, ods, json, mat, npz, hdf5): {TEMPLATE}"
_LEAST_ROWS: Final = 3
_MAX_DEPTH: Final = 16
_BY_LIBRARY: Final = frozenset(
    (".xlsx", ".xlsm", ".xls", ".xlsb", ".ods", ".mat", ".npz", ".npy", ".h5", ".hdf5", ".parquet")
)
_JSON: Final = frozenset((".json", ".jsonl", ".ndjson"))


@dataclass(frozen=True)
class SourceFile:
    """A file as it was sent."""

    name: str
    content: bytes


def read_sources(files: Iterable[str | PathLike[str]]) -> list[SourceFile]:
    """Read files into memory, at most so much that too large ones are refused.

    Raises:
        OSError: a file cannot be read.
    """
    sources = []
    for path in map(Path, files):
        with path.open("rb") as file:
            sources.append(SourceFile(path.name, file.read(MAX_BYTES + 1)))
    return sources


def read_files(files: Sequence[SourceFile], encoding: str | None = None) -> list[Table]:
    """Read files as tables, in the order of the files.

    Args:
        files: files of readings.
        encoding: encoding of texts that have no byte order mark; None for UTF-8.

    Raises:
        TableError: a file is too large, is damaged, or has no table.
    """
    names = [file.name for file in files]
    if not 0 < len(files) <= MAX_FILES:
        raise TableError(f"{len(files)} files were sent", remedy=f"send 1 to {MAX_FILES} files")
    if sum(len(file.content) for file in files) > MAX_BYTES:
        reason = f"the files have more than {MAX_BYTES >> 20} MiB together"
        raise TableError(reason, where=names[0], remedy="split the readings into several imports")
    if len(set(names)) < len(names) or len({file.content for file in files}) < len(files):
        raise TableError("a file was sent twice", where=names[0], remedy="send each file once")
    tables = []
    for file in files:
        own = [table for table in read_file(file, encoding) if table.columns]
        if not own:
            raise TableError("the file has no table of numbers", where=file.name, remedy=EXPORT)
        tables += own
    return tables


def read_file(file: SourceFile, encoding: str | None = None) -> Iterable[Table]:
    """Read the tables of one file by the ending of its name.

    Raises:
        TableError: the file is damaged, or has no table.
        MissingExtraError: the library for the file is not installed.
    """
    ending = PurePath(file.name).suffix.lower()
    if ending in _BY_LIBRARY:
        return _read_by_library(file, ending)
    text = decode(file.name, file.content, encoding)
    if ending in _JSON:
        return _read_json(file.name, text)
    return read_text(file.name, text)


def _read_by_library(file: SourceFile, ending: str) -> list[Table]:
    """Read a file by its library, in a process of its own: the library trusts the file.

    Raises:
        TableError: the file is damaged, or too large when it is unpacked.
    """
    answer = ask_child("jointstiff.service.imports.libraries", ending, content=file.content)
    if answer.document is None:
        reason = "the file is damaged" if answer.error else "the file is too large when it is unpacked"
        raise TableError(reason, where=file.name, remedy=EXPORT)
    if "missing" in answer.document:
        library = answer.document["missing"]
        remedy = f'pip install "jointstiff[{EXTRAS[library]}]"'
        raise TableError(f"{library} is not installed", where=file.name, remedy=remedy)
    tables: list[Table] = []
    for part in answer.document["tables"]:
        name = f"{file.name}#{part['name']}" if part["name"] else file.name
        if "lines" in part:
            tables += read_grid(name, part["lines"])
        else:
            rows = [[read_cell(cell) for cell in row] for row in part["rows"]]
            tables.append(build_table(name, part["headers"], rows))
    return tables


def _read_json(name: str, text: str) -> Iterator[Table]:
    """Yield the tables of JSON: an array of objects, an object with one, an object a line, arrays by name.

    Raises:
        TableError: the text is no JSON.
    """
    try:
        document = json.loads(text)
    except ValueError:
        try:
            document = [json.loads(line) for line in text.splitlines() if line.strip()]
        except ValueError as error:
            raise TableError(f"the file is no JSON: {error}", where=name, remedy=EXPORT) from None
    except RecursionError:
        raise TableError("the file is nested too deeply", where=name, remedy=EXPORT) from None
    yield from _read_document(name, document)


def _read_document(name: str, document: object, depth: int = 0) -> Iterator[Table]:
    """Yield a table for each array of records, or of numbers of one length, in a document.

    Raises:
        TableError: the document is nested too deeply.
    """
    if depth > _MAX_DEPTH:
        raise TableError("the file is nested too deeply", where=name, remedy=EXPORT)
    if isinstance(document, list):
        yield from _read_records(name, [each for each in document if isinstance(each, dict)])
        if document and all(isinstance(each, list) for each in document):
            yield build_table(name, (), [[read_cell(cell) for cell in row] for row in document])
    elif isinstance(document, dict):
        arrays = {key: value for key, value in document.items() if _is_array(value)}
        others = {key: value for key, value in document.items() if key not in arrays}
        yield from _join_arrays(name, arrays)
        records = [{"name": key, **value} for key, value in others.items() if isinstance(value, dict)]
        if len(records) >= _LEAST_ROWS and len(records) == len(others):
            yield from _read_records(name, records)
            return
        for key, value in others.items():
            yield from _read_document(f"{name}#{key}", value, depth + 1)


def _is_array(value: object) -> bool:
    return isinstance(value, list) and len(value) >= _LEAST_ROWS and not isinstance(value[0], dict)


def _join_arrays(name: str, arrays: Mapping[str, list[Any]]) -> Iterator[Table]:
    """Yield a table of the arrays of each length, side by side; further axes become columns."""
    columns_of_length: dict[int, dict[str, list[Any]]] = defaultdict(dict)
    for key, array in arrays.items():
        columns_of_length[len(array)][key] = array
    for length, columns in columns_of_length.items():
        rows = [{key: column[i] for key, column in columns.items()} for i in range(length)]
        yield from _read_records(f"{name}#{length}" if len(columns_of_length) > 1 else name, rows)


def _read_records(name: str, records: Iterable[Mapping[str, Any]]) -> Iterator[Table]:
    """Yield a table of the records of each set of keys; nested keys are joined: `tcp.x`, `joints.0`.

    A list of objects in a record makes a row for each, as long as all records have just one such list.
    """
    rows_of_keys: dict[tuple[str, ...], list[list[Cell]]] = defaultdict(list)
    for record in records:
        for row in _explode(record):
            flat = dict(_flatten(row))
            rows_of_keys[tuple(flat)].append(list(flat.values()))
    for number, (keys, rows) in enumerate(rows_of_keys.items(), 1):
        yield build_table(f"{name}#{number}" if len(rows_of_keys) > 1 else name, keys, rows)


def _explode(record: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Yield a record for each object in its only list of objects, with the other keys."""
    lists = [
        key
        for key, value in record.items()
        if isinstance(value, list) and value and isinstance(value[0], dict)
    ]
    if len(lists) != 1:
        yield record
        return
    others = {key: value for key, value in record.items() if key != lists[0]}
    for each in record[lists[0]]:
        yield {**others, **each} if isinstance(each, dict) else others


def _flatten(value: object, path: str = "", depth: int = 0) -> Iterator[tuple[str, Cell]]:
    """Yield the path and the cell of each leaf."""
    if isinstance(value, Mapping) and depth < _MAX_DEPTH:
        for key, each in value.items():
            yield from _flatten(each, f"{path}.{key}" if path else str(key), depth + 1)
    elif isinstance(value, list) and depth < _MAX_DEPTH:
        for index, each in enumerate(value):
            yield from _flatten(each, f"{path}.{index}", depth + 1)
    else:
        yield path, read_cell(value)


def read_cell(value: object) -> Cell:
    """Return a value of JSON as a number, a word or nothing."""
    if value is None:
        return None
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        number = float(value)
        return number if abs(number) < float("inf") else None
    return parse_cell(str(value))


def table_from_columns(name: str, columns: Mapping[str, Sequence[object]]) -> Table:
    """Return a table of columns by name, such as those of a data frame."""
    headers = list(columns)
    rows = zip(*columns.values(), strict=True)
    return build_table(name, headers, [[read_cell(cell) for cell in row] for row in rows])
