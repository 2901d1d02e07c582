"""Files of arrays as tables: .mat, .npz, HDF5 and Parquet; their libraries run in a process of its own."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from jointstiff.schemas.imports import FilePreview, TableFormat
from jointstiff.service.importing import grammar, grid, limits
from jointstiff.service.importing.child import ask_child
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.formats.matrices import Matrix
from jointstiff.service.importing.grid import ArrayFormat, CellKind, Grid, Remark, Row

_WORDS: Final = MappingProxyType(
    {
        "mat": "a MATLAB file",
        "npz": "an archive of NumPy",
        "hdf5": "an HDF5 file",
        "parquet": "a Parquet file",
    }
)
LIBRARIES: Final = MappingProxyType({"hdf5": "h5py", "parquet": "pyarrow"})
"""Library of a format that the extra `tables` installs."""
_AXES: Final = "xyz"
_UNITS: Final = frozenset(("deg", "rad", "mm", "m", "N", "daN", "kN", "Nm"))
"""Endings of names of arrays that state a unit."""
_NO_UNITS: Final = frozenset(("", "-", "1", "none"))
"""Texts of an attribute `units` that state no unit."""
_REMEDY: Final = "save vectors and matrices of numbers with one row per observation, or write a CSV file"
_TOO_LARGE: Final = (
    f"the arrays of the file are larger than {limits.MAX_UNPACKED_BYTES >> 20} MiB, "
    f"{limits.MAX_ROWS:,} rows, {limits.MAX_COLUMNS} columns or {limits.MAX_CELLS:,} cells"
)
_TOO_LONG: Final = (
    f"the file is damaged, or reading the file takes over {limits.MAX_MEMORY >> 20} MiB or "
    f"{limits.MAX_SECONDS} s"
)

_Answer = dict[str, Any]


def read_arrays(
    file: str,
    content: bytes,
    kind: ArrayFormat,
    names: Sequence[str | None],
    *,
    every_length: bool = False,
) -> list[Grid]:
    """Return the arrays of a file as tables: each vector or matrix as columns.

    The header of a column is the name of its array; columns of a matrix get the number of the column, or
    x, y, z if the matrix has three columns. An attribute `units` of HDF5, or a name that ends with a unit,
    such as `q_deg`, states the unit.

    Args:
        file: name of the file, for messages.
        content: bytes of the file.
        kind: format of the file.
        names: names of the tables, which are groups or arrays of records of an HDF5 file; None for the only
            one.
        every_length: whether arrays of each number of rows make a table, named by its arrays; otherwise only
            the arrays with the number of rows that most columns have.

    Raises:
        ImportFileError: the library is missing; the file is damaged or too large, has no arrays with the same
            number of rows, or several tables and no choice.
    """
    library = LIBRARIES.get(kind)
    if library and find_spec(library) is None:
        reason = f"{_WORDS[kind]} needs the extra `tables`, which is not installed"
        remedy = 'pip install "jointstiff[tables]", or write the readings as CSV'
        raise ImportFileError(Place(file), reason, remedy)
    wanted = [name for name in names if name is not None] if kind == "hdf5" else []
    answer = _ask_library(file, content, kind, wanted, every_length=every_length)
    tables = {name: _repeat_forces(arrays) for name, arrays in answer["arrays"].items()}
    scalars = [
        Remark(0, f"{each['name']}: {each['scalar']}")
        for arrays in tables.values()
        for each in arrays
        if each.get("scalar") is not None
    ]
    if every_length:
        tables = {name: each for arrays in tables.values() for name, each in _split_by_length(arrays)}
    grids = [_build_grid(file, kind, name, arrays) for name, arrays in tables.items()]
    return [replace(each, comments=tuple(scalars)) for each in grids]


def build_grids_of_matrices(
    file: str, encoding: str, matrices: Sequence[Matrix], comments: Sequence[Remark]
) -> list[Grid]:
    """Return the matrices of a text as tables with its comments, one for each number of rows."""
    import numpy as np

    from jointstiff.service.importing.formats.columns import NamedArray, tabulate

    named = [NamedArray(each.name, np.array(each.rows)) for each in matrices]
    try:
        arrays = tabulate(named, every_length=True)
    except MemoryError:
        raise _refuse_size(file) from None
    tables = _split_by_length(_repeat_forces(arrays))
    grids = [_build_grid(file, "text", name, table) for name, table in tables]
    in_encoding = {"encoding": encoding}
    return [
        replace(each, preview=each.preview.model_copy(update=in_encoding), comments=tuple(comments))
        for each in grids
    ]


def _repeat_forces(arrays: Sequence[Any]) -> list[Any]:
    """Return arrays in which a force that a vector of three numbers states once is that of all rows.

    Other vectors of three numbers are no columns, unless they have as many rows as most other arrays; nor is
    a force, if another array may be the force of each row.
    """
    counts = Counter(len(cells) for each in arrays if not _is_vector(each) for cells in each["columns"] or ())
    count = max(counts, key=lambda rows: (counts[rows], rows), default=0)
    if count in (0, len(_AXES)):
        return list(arrays)
    of_rows = [each["name"] for each in arrays if each["columns"] and not _is_vector(each)]
    has_forces = any(map(_may_be_force, of_rows))
    repeated = []
    for each in arrays:
        changes: dict[str, Any] = {}
        if _is_vector(each):
            is_force = grammar.is_force(each["name"]) and not has_forces
            cells = [[cell] * count for cell in each["columns"][0]]
            changes = {"columns": cells, "is_repeated": True} if is_force else {"columns": None}
        repeated.append({**each, **changes})
    return repeated


def _may_be_force(name: str) -> bool:
    """Return whether a name, or a word of the name, is that of a force."""
    words = name.replace("_", " ")
    return grammar.looks_like_a_force(words) or any(map(grammar.is_force, words.split()))


def _is_vector(array: Any) -> bool:  # noqa: ANN401 - an array as the other process writes it
    """Return whether an array is a vector of three numbers."""
    columns: list[list[str | None]] = array["columns"] or []
    return len(columns) == 1 and len(columns[0]) == len(_AXES) and array["kind"] == "number"


def _refuse_size(file: str) -> ImportFileError:
    """Return the error of a file whose arrays are too large for a table."""
    return ImportFileError(Place(file), _TOO_LARGE, "save fewer arrays, or split the file")


def _split_by_length(arrays: Sequence[Any]) -> list[tuple[str, list[Any]]]:
    """Return tables of arrays with one number of rows, each with the names of its arrays."""
    of_length: dict[int, list[Any]] = {}
    for array in arrays:
        if array["columns"] is not None:
            of_length.setdefault(len(array["columns"][0]), []).append(array)
    return [(", ".join(each["name"] for each in table), table) for table in of_length.values()]


def _ask_library(
    file: str, content: bytes, kind: ArrayFormat, wanted: list[str], *, every_length: bool
) -> _Answer:
    """Return the answer of the process that reads a file by its library.

    Raises:
        ImportFileError: the process refuses the file, or has exceeded its limits.
    """
    place, words = Place(file), _WORDS[kind]
    arguments = kind, json.dumps({"tables": wanted or None, "every_length": every_length})
    child = ask_child("jointstiff.service.importing.formats.libraries", *arguments, content=content)
    if child.error:
        reason = f"the file is {words} that is damaged ({quote(child.error)})"
        raise ImportFileError(place, reason, "save the file again")
    answer = child.document
    if answer is None:
        reason = f"reading {words} ended without a result: {_TOO_LONG}"
        raise ImportFileError(place, reason, "save the file again with fewer arrays, or write a CSV file")
    if "large" in answer:
        raise _refuse_size(file)
    if "reason" in answer:
        raise ImportFileError(place, answer["reason"], answer["remedy"])
    if "tables" in answer:
        _refuse_choice(place, answer["tables"], answer["missing"])
    return answer


def _refuse_choice(place: Place, tables: list[str], missing: list[str]) -> None:
    """Raise the error that a file has no table, or several, or none of the stated name.

    Raises:
        ImportFileError: always.
    """
    if not tables:
        raise ImportFileError(place, "the file has no arrays of numbers with rows", _REMEDY)
    if missing:
        reason = f"the file has no group or array {quote(missing[0])}"
        remedy = f"give one of {quote(', '.join(tables))} as `sheet`"
    else:
        reason = f"several groups or arrays have data: {quote(', '.join(tables))}"
        remedy = "give `sheet`; separate several names by semicolons"
    raise ImportFileError(place, reason, remedy, "sheet", tuple(tables))


def _build_grid(file: str, kind: TableFormat, table: str, arrays: Sequence[Any]) -> Grid:
    """Return arrays with the same number of rows as a table with a header.

    Raises:
        ImportFileError: there are no such arrays, or too many; or two states of a unit contradict.
    """
    skipped = [array["name"] for array in arrays if array["columns"] is None]
    columns = _arrange_columns(file, [array for array in arrays if array["columns"] is not None])
    count = len(columns[0].cells) if columns else 0
    if count < 1:
        raise ImportFileError(Place(file), "the file has no arrays of numbers with rows", _REMEDY)
    is_too_wide = len(columns) > limits.MAX_COLUMNS or len(columns) * count > limits.MAX_CELLS
    if is_too_wide or count > limits.MAX_ROWS:
        raise grid.too_large_error(file, 1)
    text: CellKind = "text"
    header = Row(1, tuple(column.header for column in columns), (text,) * len(columns))
    kinds = tuple(column.kind for column in columns)
    rows = []
    for line, cells in enumerate(zip(*(column.cells for column in columns), strict=True), 2):
        texts = tuple(grid.write_ascii_minus(cell or "") for cell in cells)
        if any(texts):
            rows.append(Row(line, texts, kinds))
    if not rows:
        raise grid.no_rows_error(file)
    notes = [f"variables that are no tables were skipped: {quote(', '.join(skipped))}"] if skipped else []
    notes += [
        f"{quote(array['name'])} as the force of all rows" for array in arrays if array.get("is_repeated")
    ]
    preview = FilePreview(file=file, format=kind, sheet=table or None, assumptions=notes)
    return Grid(preview, (header, *rows))


class _Column(NamedTuple):
    """Column of a table."""

    header: str
    kind: CellKind
    cells: list[str | None]  # None for an empty cell


def _arrange_columns(file: str, arrays: Sequence[Any]) -> list[_Column]:
    """Return the columns of arrays with their headers.

    Raises:
        ImportFileError: two arrays give the same column, or two states of a unit contradict.
    """
    columns: dict[str, _Column] = {}
    for array in arrays:
        named = _name_columns(Place(file), array["name"], array["unit"], array["columns"])
        repeated = set(named) & set(columns)
        if repeated:
            reason = f"two arrays give the same column {quote(next(iter(repeated)))}"
            raise ImportFileError(Place(file), reason, "rename one of the two arrays")
        columns |= {header: _Column(header, array["kind"], cells) for header, cells in named.items()}
    return list(columns.values())


def _name_columns(
    place: Place, name: str, stated_unit: str | None, columns: list[list[str | None]]
) -> dict[str, list[str | None]]:
    """Return the columns of an array by header.

    A single column has the name as header. Three columns have the name with x, y, z; other columns, and all
    columns of joint angles, have the name with numbers from 1.

    Raises:
        ImportFileError: the name and an attribute state different units.
    """
    base, _, ending = name.rpartition("_")
    stem, unit = (base, ending) if base and ending in _UNITS else grammar.split_unit(name)
    stated_unit = None if (stated_unit or "").lower() in _NO_UNITS else stated_unit
    if unit and stated_unit and grammar.find_any_unit(unit) != grammar.find_any_unit(stated_unit):
        reason = f"the array {quote(name)} has the unit {quote(stated_unit)} in its attribute"
        raise ImportFileError(place, reason, "correct the name or the attribute")
    unit = stated_unit or unit
    in_brackets = f" [{unit}]" if unit else ""
    is_joint = grammar.is_joint(stem)
    if len(columns) == 1 and not is_joint:
        return {f"{stem}{in_brackets}" if stated_unit else name: columns[0]}
    is_vector = len(columns) == len(_AXES) and not is_joint
    numbers = _AXES if is_vector else [str(i) for i in range(1, len(columns) + 1)]
    gap = " " if is_vector else ""
    return {f"{stem}{gap}{number}{in_brackets}": each for number, each in zip(numbers, columns, strict=True)}
