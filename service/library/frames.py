"""Data frames and other arguments with names as plain arrays: columns and rows are matched by their names.

A header means what it means in a file (docs/import.md). Arguments without names are used in their order.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any, Final, NamedTuple

import numpy as np

from jointstiff.schemas.imports import ImportOptions
from jointstiff.service.conversion.arrays import ArrayReadings, to_number_array
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.grammar import DIMENSIONS, Kind, Meaning, Vocabulary, parse_header
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError

_AXES: Final = "xyz"
_VECTORS: Final[Mapping[str, tuple[Kind, tuple[str, str, str]]]] = {
    "forces": ("force", ("Fx", "Fy", "Fz")),
    "moments": ("moment", ("Mx", "My", "Mz")),
    "load_point": ("load point", ("x", "y", "z")),
    "force": ("force", ("Fx", "Fy", "Fz")),
}
"""Argument → kind of its columns, and names that its columns may have."""
_STATES: Final = {
    "unloaded": "unloaded",
    "loaded": "loaded",
    "unloaded_after": "unloaded_after",
    "deflections": "deflection",
}
"""Argument → state that the headers of its columns may name."""
_IGNORED: Final = frozenset(("ignored", "time"))
"""Kinds of columns that are not used, as in files."""
_SHOWN: Final = 3
"""Number of names of rows that a message shows."""

Keys = tuple[Hashable, ...]
"""Names of the rows."""


class Column(NamedTuple):
    """Column of a table."""

    name: Any  # as the table has the name; None or "" without a name
    cells: Any  # (N,) numbers, or one number


@dataclass(eq=False)
class Rows:
    """Rows of an argument, which are brought into a common order."""

    argument: str  #: name of the argument, for messages
    values: Any  #: array (N, …), or anything that numpy understands
    keys: Keys | None = None  #: names of the rows; None without names
    is_common: bool = False  #: whether the values are one row for all observations

    @property
    def is_in_words(self) -> bool:
        """Return whether a row has a name in words; other names are numbers."""
        return any(isinstance(key, str) for key in self.keys or ())


@dataclass(frozen=True, eq=False)
class Table:
    """Columns with names."""

    argument: str  #: name of the argument, for messages
    columns: tuple[Column, ...]  #: columns with different names
    keys: Keys | None  #: names of the rows; None without names


class NameMatcher:
    """Matching of the arguments of one call by their names."""

    def __init__(self, joints: Sequence[str], units: Mapping[str, str]) -> None:
        """Prepare to match arguments for a robot.

        Args:
            joints: names of the robot's joints.
            units: stated unit of each quantity by name.
        """
        self._joints, self._units = tuple(joints), units
        self._vocabulary = Vocabulary(ImportOptions(), self._joints)
        self._rows: list[Rows] = []

    def read_joints(self, value: Any, argument: str = "joints") -> Rows:  # noqa: ANN401 - arrays, frames
        """Return joint positions (N, n), or one posture (n,), in the order of the robot's joints."""
        value = _name_parts(value)
        table = read_table(value, argument)
        if table is None:
            return self._add(Rows(argument, value, _read_index(value)))
        meanings = self._understand(table, "joint", "joints")
        # Joints are numbered from 1, or all from 0.
        first = min((meaning.axis or 0 for meaning in meanings.values()), default=0)
        offset = 1 if first < 0 else 0
        places = {name: (meaning.axis or 0) + offset for name, meaning in meanings.items()}
        return self._add(self._sort_columns(table, places, self._joints))

    def read_vectors(self, value: Any, argument: str) -> Rows | None:  # noqa: ANN401 - arrays, frames
        """Return vectors (N, 3), or one vector (3,); None for None."""
        if value is None:
            return None
        value = _name_parts(value)
        table = read_table(value, argument)
        if table is None:
            is_common = _list_names(value) is None and np.ndim(value) == 1
            return self._add(Rows(argument, value, _read_index(value), is_common=is_common))
        kind, names = _VECTORS[argument]
        meanings = self._understand(table, kind, argument)
        rows = self._sort_columns(table, {name: each.axis or 0 for name, each in meanings.items()}, names)
        rows.is_common = rows.values.ndim == 1
        return self._add(rows)

    def read_positions(
        self,
        value: Any,  # noqa: ANN401 - arrays, frames
        argument: str,
        *,
        are_lengths: bool = False,
    ) -> Rows | dict[str, Rows] | None:
        """Return positions or deflections: by target if their columns name targets; None for None.

        `are_lengths` states that a reading is one number, a length along a direction.
        """
        if value is None:
            return None
        if isinstance(value, Mapping) and (are_lengths or not all(map(_is_column, value.values()))):
            by_target = dict[str, Rows]()
            for target, each in value.items():
                by_target[str(target)] = self._read_target(
                    each, argument, str(target), are_lengths=are_lengths
                )
            return by_target
        table = read_table(value, argument)
        if table is None:
            return self._add(Rows(argument, value, _read_index(value)))
        if not are_lengths:
            return self._split_by_target(table, argument)
        rows = [self._add(Rows(argument, column.cells, table.keys)) for column in table.columns]
        return dict(zip((str(column.name) for column in table.columns), rows, strict=True))

    def read_targets(self, value: Any, argument: str) -> Any:  # noqa: ANN401 - arrays, frames
        """Return one position of each target: of a frame whose rows have names, by target.

        Rows of other frames are in the order of the targets; mappings and arrays are returned unchanged.
        """
        table = None if isinstance(value, Mapping) else read_table(value, argument, ("name", "target"))
        if table is None:
            return value
        meanings = self._understand(table, "position", argument)
        places = {name: meaning.axis or 0 for name, meaning in meanings.items()}
        rows = self._sort_columns(table, places, list(_AXES))
        are_names = all(isinstance(key, str) for key in rows.keys or ())
        return dict(zip(rows.keys, rows.values, strict=True)) if rows.keys and are_names else rows.values

    def _read_target(
        self,
        value: Any,  # noqa: ANN401 - arrays, frames
        argument: str,
        target: str,
        *,
        are_lengths: bool,
    ) -> Rows:
        """Return the positions (N, 3) of one target, or its lengths (N,)."""
        table = None if are_lengths else read_table(value, f"{argument}['{target}']")
        if table is None:
            return self._add(Rows(argument, value, _read_index(value)))
        of_targets = self._split_by_target(table, argument)
        if isinstance(of_targets, Rows):
            return of_targets
        for name in of_targets.keys() - {target}:
            _refuse_column(table, f"{name} x", f"is of the target '{name}'", "name the columns x, y, z")
        return of_targets[target]

    def _split_by_target(self, table: Table, argument: str) -> Rows | dict[str, Rows]:
        """Return the positions of each target that the columns name; the only rows if they name no target."""
        # Target → name of a column → axis 0, 1 or 2
        axes_by_target = dict[str | None, dict[Any, int]]()
        for name, meaning in self._understand(table, "position", argument).items():
            axes = axes_by_target.setdefault(meaning.quantity.target, {})
            axes[name] = meaning.axis or 0
        found: dict[str, Rows] = {}
        for target, axes in axes_by_target.items():
            prefix = "" if target is None else f"{target} "
            rows = self._add(self._sort_columns(table, axes, [f"{prefix}{axis}" for axis in _AXES]))
            if target is not None:
                found[target] = rows
            elif len(axes_by_target) == 1:
                return rows
            else:
                _refuse_column(table, next(iter(axes)), "names no target", "name columns as in `P10 x`")
        return found

    def _understand(self, table: Table, kind: Kind, argument: str) -> dict[Any, Meaning]:
        """Return the meaning of each column by its name; a column such as a label has none.

        Raises:
            MeasurementError: a column has another meaning or unit.
        """
        remedy = self._word_names(argument)
        meanings: dict[Any, Meaning] = {}
        for column in table.columns:
            try:
                meaning = self._vocabulary.meaning(_join_name(column.name), guessed=False)
            except ImportFileError:
                _refuse_column(table, column.name, "is not understood", remedy)
            if meaning.kind in _IGNORED:
                continue
            fault = _find_fault(meaning, kind, argument)
            if fault is not None:
                _refuse_column(table, column.name, fault, remedy)
            self._check_unit(table, column, meaning)
            meanings[column.name] = meaning
        return meanings

    def _check_unit(self, table: Table, column: Column, meaning: Meaning) -> None:
        """Refuse a column whose header names another unit than the stated one."""
        dimension = meaning.dimension or ""
        if meaning.unit is not None and meaning.unit != self._units.get(dimension):
            stated = self._units.get(dimension, "no unit")
            _refuse_column(
                table,
                column.name,
                f"is in {meaning.unit}, but `units` states {stated} for the {dimension}",
                f"state {meaning.unit} in `units`, or convert the column",
            )

    def _word_names(self, argument: str) -> str:
        """Return the remedy that says which names the columns of an argument may have."""
        if argument == "joints":
            names = f"J1 to J{len(self._joints)}, or {', '.join(self._joints)}"
        elif argument in _STATES:
            names = f"as in `P10 {_STATES[argument].replace('_', ' ')} x`, or x, y, z for one target"
        else:
            names = ", ".join(_VECTORS[argument][1])
        return f"name the columns {names}; an array without names is used in the order of its columns"

    def _sort_columns(self, table: Table, places: Mapping[Any, int], names: Sequence[str]) -> Rows:
        """Return the columns of a table in the order of their quantity.

        Args:
            table: columns with names.
            places: place of each column, from 0, by the column's name.
            names: names of all places.

        Raises:
            MeasurementError: a place has no column, or two columns.
        """
        by_place = _place_columns(table, places, names)
        for place, name in enumerate(names):
            if place not in by_place:
                raise MeasurementError(
                    f"`{table.argument}` has columns with names, but no column of {name}",
                    where=table.argument,
                    remedy="give all columns, or an array without names",
                )
        sorted_columns = [by_place[place] for place in range(len(names))]
        return Rows(table.argument, _stack(table.argument, sorted_columns), table.keys)

    def _add(self, rows: Rows) -> Rows:
        """Add rows to those that are brought into one order; return the rows."""
        self._rows.append(rows)
        return rows

    def align(self, labels: Sequence[str] | None) -> list[str] | None:
        """Bring all rows into the order of the labels, or of the first argument whose rows have names.

        Returns:
            The labels; names of the rows in words if there are no labels; None without both.

        Raises:
            MeasurementError: arguments have rows of different names, or the order is uncertain.
        """
        named = self._list_named_rows()
        if not named:
            return None if labels is None else list(labels)
        wanted = named[0]
        unnamed = next((each for each in self._rows if each not in named and not each.is_common), None)
        keys_in_words = {str(key): key for key in wanted.keys or ()}
        if labels is not None and {*map(str, labels)} == keys_in_words.keys():
            wanted = Rows("labels", None, tuple(keys_in_words[str(label)] for label in labels))
            unnamed = None  # rows without names are in the order of the labels
        for rows in named:
            _align_with(rows, wanted, unnamed)
        if labels is not None:
            return list(labels)
        return [str(key) for key in wanted.keys or ()] if wanted.is_in_words else None

    def _list_named_rows(self) -> list[Rows]:
        """Return the arguments whose rows have names, by which their order is checked.

        Rows that are only numbered have no names next to rows with names in words: they keep their order.

        Raises:
            MeasurementError: the order of numbered rows is uncertain.
        """
        named = [rows for rows in self._rows if rows.keys is not None and not rows.is_common]
        in_words = [rows for rows in named if rows.is_in_words]
        if not in_words:
            return named
        _align_numbered([rows for rows in named if not rows.is_in_words], in_words[0])
        return in_words


def match_arrays(
    joint_names: Sequence[str],
    units: Mapping[str, str],
    *,
    targets: Any,  # noqa: ANN401 - names, or places by name
    labels: Sequence[str] | None,
    **arguments: Any,  # noqa: ANN401 - arrays, frames
) -> ArrayReadings:
    """Return the readings of arguments whose columns and rows may have names.

    Args:
        joint_names: names of the robot's joints.
        units: stated unit of each quantity by name.
        targets: names of the targets, or their places by name.
        labels: labels of the observations; None without labels.
        arguments: the other fields of `ArrayReadings` by name.

    Raises:
        MeasurementError: names do not match.
    """
    matcher = NameMatcher(joint_names, units)
    are_lengths = arguments["directions"] is not None
    rows: dict[str, Rows | dict[str, Rows] | None] = {"joints": matcher.read_joints(arguments["joints"])}
    for argument in ("forces", "moments", "load_point"):
        rows[argument] = matcher.read_vectors(arguments[argument], argument)
    for argument in _STATES:
        rows[argument] = matcher.read_positions(arguments[argument], argument, are_lengths=are_lengths)
    names = matcher.align(labels)
    values = {argument: _get_values(each) for argument, each in rows.items()}
    return ArrayReadings(**values, directions=arguments["directions"], targets=targets, labels=names)


def _get_values(rows: Rows | dict[str, Rows] | None) -> Any:  # noqa: ANN401 - arrays, also by target
    """Return the values of rows, by target if the rows are by target; None for None."""
    if isinstance(rows, dict):
        return {target: each.values for target, each in rows.items()}
    return None if rows is None else rows.values


def _align_numbered(numbered: Sequence[Rows], in_words: Rows) -> None:
    """Check that rows with numbers are in one order, next to rows with names in words.

    Raises:
        MeasurementError: the numbers are in no plain order, or differ.
    """
    for rows in numbered:
        keys = list(rows.keys or ())
        if not _is_ascending(keys):
            shown = ", ".join(map(str, keys[:_SHOWN]))
            raise MeasurementError(
                f"the rows of `{rows.argument}` are numbered, but not in order ({shown}, …), and the rows "
                f"of `{in_words.argument}` have names in words",
                where=rows.argument,
                remedy=f"give both the same index, or sort the rows of `{rows.argument}` by their numbers",
            )
        _align_with(rows, numbered[0], None)


def _is_ascending(keys: list[Hashable]) -> bool:
    """Return whether names of rows are in ascending order; names that have no order are not."""
    try:
        return keys == sorted(keys)  # type: ignore[type-var]
    except TypeError:
        return False


def _align_with(rows: Rows, first: Rows, unnamed: Rows | None) -> None:
    """Bring rows into the order of the first rows.

    `unnamed` are rows without names, which then need the common order; None if there are no such rows.

    Raises:
        MeasurementError: the rows have other names, or the order of the unnamed rows is uncertain.
    """
    keys, wanted = rows.keys or (), first.keys or ()
    if keys == wanted:
        return
    _refuse_other_names(rows, first)
    if unnamed is not None:
        raise MeasurementError(
            f"the rows of `{rows.argument}` are in another order than the rows of `{first.argument}`, and "
            f"the rows of `{unnamed.argument}` have no names that show their order",
            where=rows.argument,
            remedy=f"give `{unnamed.argument}` the same index, or sort the rows of `{rows.argument}`",
        )
    place = {key: row for row, key in enumerate(keys)}
    rows.values = to_number_array(rows.values, rows.argument)[[place[key] for key in wanted]]


def _refuse_other_names(rows: Rows, first: Rows) -> None:
    """Refuse rows whose names are not those of the first rows, each once.

    Raises:
        MeasurementError: shows names that only one of both has or, if there are none, all names.
    """
    keys, wanted = list(rows.keys or ()), list(first.keys or ())
    only_here = [key for key in keys if key not in set(wanted)]
    only_there = [key for key in wanted if key not in set(keys)]
    are_distinct = len(set(keys)) == len(keys) == len(wanted)
    if are_distinct and not only_here and not only_there:
        return
    shown = ", ".join(map(str, (only_here or only_there or keys)[:_SHOWN]))
    raise MeasurementError(
        f"the rows of `{rows.argument}` have other names than those of `{first.argument}`: {shown}",
        where=rows.argument,
        remedy="give both the same index, such as `frame.set_index('label')`; rows of "
        "`frame.to_numpy()` have no names, and are used in their order",
    )


def _place_columns(table: Table, places: Mapping[Any, int], names: Sequence[str]) -> dict[int, Column]:
    """Return place → the column at this place; arguments as for `_sort_columns`.

    Raises:
        MeasurementError: a place has two columns, or a column is beyond the last place.
    """
    by_place: dict[int, Column] = {}
    for column in table.columns:
        place = places.get(column.name)
        if place is None:
            continue
        if place >= len(names):
            reason = f"is beyond the last, {names[-1]}"
            _refuse_column(table, column.name, reason, "give the columns of this robot")
        if place in by_place:
            first = by_place[place].name
            _refuse_column(table, column.name, f"means the same as '{first}'", "remove one of the two")
        by_place[place] = column
    return by_place


def _refuse_column(table: Table, name: Any, fault: str, remedy: str) -> None:  # noqa: ANN401
    """Refuse a column.

    Raises:
        MeasurementError: always.
    """
    raise MeasurementError(
        f"the column '{_join_name(name)}' of `{table.argument}` {fault}", where=table.argument, remedy=remedy
    )


def _find_fault(meaning: Meaning, kind: Kind, argument: str) -> str | None:
    """Return why a column cannot be one of a kind, such as "force"; None if it can.

    A column may have the bare name of an axis, such as `x [N]`: then only its unit shows another quantity.
    """
    is_bare_axis = meaning.kind == "position" and meaning.quantity[1:] == (None, None)
    if meaning.kind != kind and not (is_bare_axis and kind != "joint"):
        return f"is of another quantity ({meaning.kind})"
    state = meaning.quantity.state
    if state is not None and state != _STATES.get(argument):
        return f"has the state '{state}'"
    if is_bare_axis and meaning.unit is not None and DIMENSIONS.get(kind) != meaning.dimension:
        return f"is in {meaning.unit}, which is no unit of a {kind}"
    return None


def read_table(
    value: Any,  # noqa: ANN401 - anything with columns
    argument: str,
    label_kinds: Sequence[Kind] = ("name",),
) -> Table | None:
    """Return the columns of a frame, a mapping, an array of records or a list of columns.

    None is returned for a value whose columns have no names. A column of one of the `label_kinds` gives the
    names of the rows.

    Raises:
        MeasurementError: two columns have the same name, or some columns have none.
    """
    if _are_rows(value):
        return _join_rows(value, argument)
    names = _list_names(value)
    if names is None or not names:
        return None
    _refuse_repeated_name(names, argument)
    if _have_no_meaning(names, argument):
        return None
    columns = [Column(name, _get_column(value, place, name)) for place, name in enumerate(names)]
    keys = _read_index(columns[0].cells if isinstance(value, Mapping | list | tuple) else value)
    labels = next((column for column in columns if _find_kind(column.name) in label_kinds), None)
    if labels is not None:
        keys = tuple(np.asarray(labels.cells).tolist())
        columns = [column for column in columns if column is not labels]
    return Table(argument, tuple(columns), keys)


def _refuse_repeated_name(names: Sequence[Any], argument: str) -> None:
    """Refuse two columns of the same name; columns without names have their order.

    Raises:
        MeasurementError: states the first such name.
    """
    repeated = [name for name in names if names.count(name) > 1]
    if repeated and repeated[0] not in (None, ""):
        raise MeasurementError(
            f"`{argument}` has two columns '{_join_name(repeated[0])}'",
            where=argument,
            remedy="give each column a name of its own",
        )


def _are_rows(value: Any) -> bool:  # noqa: ANN401 - anything with columns
    """Return whether a value is a list of rows of a frame of pandas: their elements have names, as columns.

    Columns whose rows have names in words are known by their own names.
    """
    if not isinstance(value, list | tuple) or not value:
        return False
    indices = [_read_index(each) for each in value]
    if any(not index or not all(isinstance(key, str | tuple) for key in index) for index in indices):
        return False
    if any(_list_names(each) is not None for each in value):
        return False
    names = [each.name for each in value]
    if not all(isinstance(name, str | tuple) for name in names):
        return True
    are_columns = all(_find_kind(name) != "unknown" for name in names)
    return not are_columns and all(_find_kind(key) != "unknown" for key in indices[0] or ())


def _join_rows(rows: Sequence[Any], argument: str) -> Table:
    """Return the columns of rows of a frame of pandas, which are matched by the names of their elements.

    Raises:
        MeasurementError: a row has other elements than the first one, or two elements of one name.
    """
    wanted = rows[0].index.tolist()
    parts: list[dict[Any, Any]] = []
    for place, row in enumerate(rows):
        _refuse_other_elements(row.index.tolist(), wanted, f"row {place} of the list `{argument}`", argument)
        parts.append(dict(zip(row.index.tolist(), row.to_numpy().tolist(), strict=True)))
    keys = tuple(row.name for row in rows)
    columns = tuple(Column(name, [part[name] for part in parts]) for name in wanted)
    return Table(argument, columns, None if None in keys else keys)


def _refuse_other_elements(names: list[Any], wanted: list[Any], row: str, argument: str) -> None:
    """Refuse a row whose elements have not the names of those of row 0, each once.

    `row` is the row in words.

    Raises:
        MeasurementError: shows the names of both.
    """
    if len(set(names)) == len(names) and set(names) == set(wanted):
        return
    raise MeasurementError(
        f"{row} has the elements {', '.join(map(_join_name, names))}, but row 0 has the elements "
        f"{', '.join(map(_join_name, wanted))}",
        where=argument,
        remedy="give rows of one frame, or the frame itself",
    )


def _list_names(value: Any) -> list[Any] | None:  # noqa: ANN401 - anything with columns
    """Return the names of the columns of a value; None if the value has no columns of its own."""
    if isinstance(value, Mapping):
        return list(value)
    records = getattr(getattr(value, "dtype", None), "names", None)
    if records is not None:
        return list(records)
    if isinstance(value, list | tuple) and value and all(hasattr(each, "to_numpy") for each in value):
        return [getattr(each, "name", None) for each in value]
    for attribute in ("column_names", "columns"):  # of Arrow; of pandas and polars
        names = getattr(value, attribute, None)
        if names is not None:
            return list(names)
    return None


def _have_no_meaning(names: Sequence[Any], argument: str) -> bool:
    """Return whether names are only numbers in their order, as libraries make them.

    Raises:
        MeasurementError: some columns have no name; or the numbers are in another order.
    """
    absent = [name is None or name == "" for name in names]
    if all(absent) or list(names) == [f"column_{place}" for place in range(len(names))]:  # as polars names
        return True
    if any(absent):
        raise MeasurementError(
            f"some columns of `{argument}` have no name",
            where=argument,
            remedy="give all columns names, or give an array, such as `np.column_stack(columns)`",
        )
    numbers = [int(name) for name in names if _is_whole_number(name)]
    if len(numbers) < len(names):
        return False
    if sorted(set(numbers)) != numbers:
        raise MeasurementError(
            f"the columns of `{argument}` are numbered, but not in order: {', '.join(map(str, names))}",
            where=argument,
            remedy="give the columns names; an array without names is used in the order of its columns",
        )
    return True


def _find_kind(name: Any) -> Kind:  # noqa: ANN401 - names of any type
    """Return what a column with this name has as cells."""
    try:
        return parse_header(_join_name(name), {}).kind
    except ImportFileError:
        return "unknown"


def _is_whole_number(name: Any) -> bool:  # noqa: ANN401 - names of any type
    """Return whether a name is a whole number, or the text of one."""
    return isinstance(name, Integral) or (isinstance(name, str) and name.isdecimal())


def _join_name(name: Any) -> str:  # noqa: ANN401 - names of any type
    """Return a name as a header; the levels of a name are joined by blanks."""
    return " ".join(str(part) for part in name if part != "") if isinstance(name, tuple) else str(name)


def _get_column(value: Any, place: int, name: Any) -> Any:  # noqa: ANN401 - anything with columns
    """Return one column of a value, by place in a list, else by name."""
    return value[place] if isinstance(value, list | tuple) else value[name]


def _read_index(value: Any) -> Keys | None:  # noqa: ANN401 - anything with rows
    """Return the names of the rows of a frame or column of pandas; None for anything else."""
    index = getattr(value, "index", None) if hasattr(value, "to_numpy") else None
    return None if index is None else tuple(index.tolist())


def _is_column(value: Any) -> bool:  # noqa: ANN401 - anything that numpy understands
    """Return whether a value is one column of numbers, not an array with several columns."""
    return _list_names(value) is None and np.ndim(value) == 1


def _name_parts(value: Any) -> Any:  # noqa: ANN401 - anything that numpy understands
    """Return a row of a frame of pandas as numbers by column; any other value unchanged."""
    index = _read_index(value)
    is_row = index is not None and _list_names(value) is None and all(isinstance(key, str) for key in index)
    return dict(zip(index or (), value.to_numpy().tolist(), strict=True)) if is_row else value


def _stack(argument: str, columns: Sequence[Column]) -> FloatArray:
    """Return columns (N,) as an array (N, k); numbers as an array (k,).

    Raises:
        MeasurementError: a column has other elements than numbers, or another length.
    """
    arrays = [to_number_array(each.cells, f"{argument}['{_join_name(each.name)}']") for each in columns]
    for column, array in zip(columns, arrays, strict=True):
        if array.shape != arrays[0].shape or array.ndim > 1:
            raise MeasurementError(
                f"the columns '{_join_name(columns[0].name)}' and '{_join_name(column.name)}' of "
                f"`{argument}` have different shapes, {arrays[0].shape} and {array.shape}",
                where=argument,
                remedy="give columns of one length",
            )
    return np.stack(arrays, axis=-1)
