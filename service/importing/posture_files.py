"""Files of one posture each, such as `pose01_loaded.txt` with a list of targets, joined to one table."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Final, NamedTuple

from jointstiff.schemas.imports import ImportOptions
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.grammar import contains_state_word, find_state
from jointstiff.service.importing.grid import (
    ARRAYS,
    LEAST_NUMBERS,
    Row,
    count_numbers,
    file_type,
    looks_like_a_number,
    no_rows_error,
)
from jointstiff.service.importing.loads import find_load
from jointstiff.service.importing.phrases import join_state_phrases
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.importing.source_grids import read_grids
from jointstiff.service.tables.labels import fold_word, is_label

_LEAST_POSTURES: Final = 3
_LEAST_MEASURED, _MOST_MEASURED = 0.7, 1.4
"""Postures with files, as fractions of the rows of the other table, which has the joints."""
_MOST_STATES: Final = 16
_NUMBER: Final = re.compile(r"\d+")
_SEPARATORS: Final = re.compile(r"[\s_\-.]+")
_WORD_BEHIND_NUMBER: Final = re.compile(r"(?<=\d)(?=[^\W\d_]{2,})(?!kg(?![^\W\d_]))", re.IGNORECASE)
_WORD_AND_NUMBER: Final = re.compile(r"([^\W\d_]+)(\d+)")


class _Parts(NamedTuple):
    """Posture and state that the name of a file gives."""

    label: str
    others: tuple[str, ...]  # words for states or targets


@dataclass(frozen=True, eq=False)
class _Content:
    """Rows of a file."""

    headers: tuple[str, ...]  # empty texts without a header
    rows: tuple[Row, ...]


def join_posture_files(files: Sequence[SourceFile], options: ImportOptions) -> Sequence[SourceFile]:
    """Return the files; those of one posture each, in one state or in all, are one table in place of them.

    They are joined if they have the same columns, and if another file has about as many rows as there are
    postures.
    """
    group = _find_group(files)
    if any(file_type(file.content) in ARRAYS for file in group):
        return files
    parts = _split_names([file.name for file in group], options)
    labels = {each.label for each in parts}
    if len(labels) < _LEAST_POSTURES or len(set(parts)) < len(parts):
        return files
    others = [file for file in files if file not in group]
    try:
        contents = [_read(file, options) for file in group]
        counts = [count for file in others for count in _count_rows(file, options)]
    except ImportFileError:
        return files
    headers = {content.headers for content in contents}
    widths = {len(row.cells) for content in contents for row in content.rows}
    has_joints = any(_LEAST_MEASURED * count <= len(labels) <= _MOST_MEASURED * count for count in counts)
    if len(headers) != 1 or len(widths) != 1 or not has_joints:
        return files
    joined = _write(group, parts, contents, options)
    return [*others, joined]


def _find_group(files: Sequence[SourceFile]) -> list[SourceFile]:
    """Return the files whose names recur with other numbers."""
    files_of_form: dict[str, list[SourceFile]] = {}
    for file in files:
        if _NUMBER.search(file.name):
            files_of_form.setdefault(_NUMBER.sub("0", file.name), []).append(file)
    recurring = [own for own in files_of_form.values() if len(own) >= _LEAST_POSTURES]
    return [file for own in recurring for file in own]


def _split_names(names: Sequence[str], options: ImportOptions) -> list[_Parts]:
    """Return what the names of files tell; none if their parts do not correspond."""
    words = [_split_name(name, options) for name in names]
    if len({len(own) for own in words}) != 1:
        return []
    columns = [column for column in zip(*words, strict=True) if len(set(column)) > 1]
    counts = [len(set(column)) if all(map(_is_numbered, column)) else 0 for column in columns]
    are_states = [
        1 < len(set(column)) <= _MOST_STATES and not any(map(_is_numbered, column)) for column in columns
    ]
    state_count = max(
        (len(set(column)) for column, is_state in zip(columns, are_states, strict=True) if is_state),
        default=1,
    )
    possible = [count for count in counts if _LEAST_POSTURES <= count * state_count <= len(names)]
    if not possible:
        return []
    label = counts.index(max(possible))
    others = [number for number in range(len(columns)) if number != label and counts[number] < len(names)]
    return [
        _Parts(columns[label][n], tuple(columns[number][n] for number in others)) for n in range(len(names))
    ]


def _is_numbered(part: str) -> bool:
    """Return whether a part of a name has a number, and is no load such as `100kg`."""
    return _NUMBER.search(part) is not None and find_load(part) is None


def _split_name(name: str, options: ImportOptions) -> list[str]:
    """Return the parts of the name of a file; a word behind a number, or a state before it, is a part."""
    stem = join_state_phrases(PurePath(name).stem)
    parts = []
    for part in _SEPARATORS.split(_WORD_BEHIND_NUMBER.sub("_", stem)):
        found = _WORD_AND_NUMBER.fullmatch(part)
        is_state = found is not None and find_state(found[1], options.state_words) is not None
        parts += list(found.groups()) if found is not None and is_state else [part]
    return [part for part in parts if part]


def _read(file: SourceFile, options: ImportOptions) -> _Content:
    """Return the rows of numbers of a file, and the header above these.

    Raises:
        ImportFileError: the file is no table, or has no rows of numbers.
    """
    grid = read_grids(file, options, every_length=True)[0]
    data = [number for number, row in enumerate(grid.rows) if count_numbers(row) >= LEAST_NUMBERS]
    if not data:
        raise no_rows_error(file.name)
    rows = tuple(grid.rows[number] for number in data)
    width = len(rows[0].cells)
    above = grid.rows[data[0] - 1].cells if data[0] > 0 else ()
    return _Content(above if len(above) == width else ("",) * width, rows)


def _count_rows(file: SourceFile, options: ImportOptions) -> Iterator[int]:
    """Yield the number of rows of numbers of each table of a file.

    Raises:
        ImportFileError: the file is no table.
    """
    for grid in read_grids(file, options, every_length=True):
        yield sum(count_numbers(row) >= LEAST_NUMBERS for row in grid.rows)


def _write(
    files: Sequence[SourceFile],
    parts: Sequence[_Parts],
    contents: Sequence[_Content],
    options: ImportOptions,
) -> SourceFile:
    """Write the rows of all files in one table, whose first columns have what the names of files tell."""
    others = list(zip(*(each.others for each in parts), strict=True))
    are_targets = [any(map(_is_numbered, words)) for words in others]
    own_headers = _name_columns(contents, options, has_target=any(are_targets))
    has_target = any(are_targets) or "target" in map(fold_word, own_headers)
    headers = ["label", *("target" if is_target else "" for is_target in are_targets)]
    headers += own_headers if has_target else ["target", *own_headers]
    text = io.StringIO()
    writer = csv.writer(text, delimiter=";", lineterminator="\n")
    writer.writerow(headers)
    order = sorted(range(len(files)), key=lambda n: [int(each) for each in _NUMBER.findall(parts[n].label)])
    for number in order:
        names = parts[number].label, *parts[number].others
        for count, row in enumerate(contents[number].rows, 1):
            by_order = () if has_target else (f"T{count}",)
            writer.writerow((*names, *by_order, *row.cells))
    suffix = PurePath(files[0].name).suffix
    name = _NUMBER.sub("…", parts[0].label, count=1)
    return SourceFile(f"{name}{suffix}", text.getvalue().encode(), is_table=True)


def _name_columns(contents: Sequence[_Content], options: ImportOptions, *, has_target: bool) -> list[str]:
    """Return the headers of the columns of files; the first or another column may have names of targets."""
    headers = list(contents[0].headers)
    names = {tuple(row.cells[0] for row in content.rows) for content in contents}
    first = [name for own in names for name in own]
    are_texts = not any(map(looks_like_a_number, first))
    are_counted = bool(headers[0]) and len(names) == 1 and all(map(str.isdecimal, first))
    is_free = not headers[0] or is_label(headers[0])
    if not has_target and (are_texts or are_counted) and (is_free or are_counted):
        headers[0] = "target"
    elif not has_target and "target" not in map(fold_word, headers):
        columns = [column for column in range(len(headers)) if _has_same_names(contents, column, options)]
        if len(columns) == 1:
            headers[columns[0]] = "target"
    return headers


def _has_same_names(contents: Sequence[_Content], column: int, options: ImportOptions) -> bool:
    """Return whether a column has the same names in every file, several, and no words of states or loads."""
    names_of_file = [frozenset(row.cells[column] for row in content.rows) for content in contents]
    names = names_of_file[0]
    are_names = len(names) > 1 and not any(not name or looks_like_a_number(name) for name in names)
    have_states = any(
        find_load(name) is not None or contains_state_word(name, options.state_words) for name in names
    )
    return are_names and not have_states and len(set(names_of_file)) == 1
