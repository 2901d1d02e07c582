"""Rows to records: what each row says of one observation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePath

from jointstiff.schemas.importing import DecimalMark, ImportOptions, State
from jointstiff.service.importing.errors import Fault, ImportFileError, Place, shown
from jointstiff.service.importing.grid import Grid, Row
from jointstiff.service.importing.header import Kind, state_named
from jointstiff.service.importing.layout import Layout
from jointstiff.service.importing.naming import Naming, Template, check_name, default_file, default_point
from jointstiff.service.importing.numbers import MarkedCell, decide_mark, read_number

Vector = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Point:
    """Three numbers of one target in one state.

    Attributes:
        target: its name.
        state: of the robot, or `deflection` for the difference.
        vector: x, y, z in the file's unit of length; None if the cells are empty.
        place: where it stands.
    """

    target: str
    state: State
    vector: Vector | None
    place: Place


@dataclass(frozen=True, slots=True)
class Record:
    """Content of one row.

    Attributes:
        label: of the observation.
        place: where it stands.
        values: joint angles, force, moment, load point, in the file's units.
        points: readings.
        whole: whether the row claims to be the only one of its observation in this file.
    """

    label: str
    place: Place
    values: Mapping[Kind, Vector]
    points: tuple[Point, ...]
    whole: bool


def read_mark(grid: Grid, layout: Layout, options: ImportOptions) -> tuple[DecimalMark, str | None]:
    """The decimal mark of a file, and what was assumed for it; that of a sheet is always a point.

    Raises:
        ImportFileError: the file does not decide it.
    """
    if grid.format == "xlsx":
        return "point", None
    columns = [column for columns in layout.columns.quantities.values() for column in columns]
    cells = (
        MarkedCell(row.cells[column], row.line, column + 1)
        for row in layout.rows
        for column in columns
        if "." in row.cells[column] or "," in row.cells[column]
    )
    return decide_mark(grid.file, cells, options.decimal_mark)


def read_records(grid: Grid, layout: Layout, mark: DecimalMark, options: ImportOptions) -> Iterator[Record]:
    """Read all rows.

    Raises:
        ImportFileError: a cell is not what its column says, or a name is not clear.
    """
    names = _Names(grid, layout, options)
    columns = layout.columns
    whole = not columns.needed and "target" not in columns.texts and "state" not in columns.texts
    targets: set[str] = set()
    for row in layout.rows:
        naming = names.of(row)
        values: dict[Kind, Vector] = {}
        points = []
        for quantity, indices in columns.quantities.items():
            vector = _vector(grid, row, indices, mark)
            place = grid.place(row, indices[0])
            if quantity.kind == "position":
                target, state = quantity.target or naming.target, quantity.state or naming.state
                if target is None or state is None:  # excluded by _Names
                    raise ImportFileError(
                        place, "the position has no target or no state", "give `point_name`"
                    )
                if target not in targets:
                    _check_target(target, place)
                    targets.add(target)
                points.append(Point(target, state, vector, place))
            elif vector is None:
                raise ImportFileError(place, f"this row has no {quantity.kind}", "fill in the cells")
            else:
                values[quantity.kind] = vector
        yield Record(naming.label or "", grid.place(row), values, tuple(points), whole)


def _vector(grid: Grid, row: Row, indices: tuple[int, ...], mark: DecimalMark) -> Vector | None:
    """The numbers of some columns; None if all of these cells are empty."""
    if not any(row.cells[index] for index in indices):
        return None
    numbers = []
    for index in indices:
        kind = "number" if row.kinds is None or not row.cells[index] else row.kinds[index]
        if kind != "number":
            raise ImportFileError(
                grid.place(row, index),
                f"a number is needed, but the cell has type {kind}: {shown(row.cells[index])}",
                "enter a number, and format the cell as a number; replace a formula without a stored value "
                "by its value",
            )
        try:
            numbers.append(read_number(row.cells[index], mark))
        except Fault as fault:
            raise fault.at(grid.place(row, index)) from None
    return tuple(numbers)


def _check_target(target: str, place: Place) -> None:
    try:
        check_name(target)
    except Fault as fault:
        raise fault.at(place) from None


class _Names:
    """Label, target and state of each row: from columns, from the point's name, from the file's name."""

    def __init__(self, grid: Grid, layout: Layout, options: ImportOptions) -> None:
        self._grid = grid
        self._texts = layout.columns.texts
        self._needed = layout.columns.needed
        self._wanted = ("label", *sorted(self._needed))
        kinds: tuple[Kind, ...] = ("collection", "group", "name")
        self._kinds = [kind for kind in kinds if kind in self._texts]
        self._words = options.state_words
        self._stem = PurePath(grid.file).stem
        self._defaults: dict[frozenset[str], Naming] = {}
        self._point: Template | None = None
        self._file = Naming()
        try:
            if options.point_name and self._needed:
                self._point = Template(options.point_name)
            if options.file_name and self._needed:
                self._file = Template(options.file_name).parse(self._stem, self._words)
        except Fault as fault:
            raise fault.at(Place(grid.file)) from None

    def of(self, row: Row) -> Naming:
        """Return what is said of a row.

        Raises:
            ImportFileError: something is missing or contradicts.
        """
        name, columns = self._joined(row), self._in_columns(row)
        try:
            if self._point is not None:
                naming = self._point.parse(name, self._words)
            else:
                naming = default_point(name, self._needed, self._words)
            naming = _merged(_merged(columns, naming), self._file)
            lacking = frozenset(kind for kind in self._wanted if getattr(naming, kind) is None)
            if lacking:
                naming = _merged(naming, self._default(lacking))
            check_name(naming.label or "")
        except Fault as fault:
            raise fault.at(self._grid.place(row, self._texts["name"])) from None
        return naming

    def _default(self, lacking: frozenset[str]) -> Naming:
        if lacking not in self._defaults:
            try:
                self._defaults[lacking] = default_file(self._stem, lacking, self._words)
            except Fault as fault:
                raise fault.at(Place(self._grid.file)) from None
        return self._defaults[lacking]

    def _joined(self, row: Row) -> str:
        """The name of a point, with its collection and group before it if there are such columns."""
        parts = [self._text(row, kind) for kind in self._kinds]
        if len(parts) > 1 and any("::" in part for part in parts):
            place = self._grid.place(row, self._texts["name"])
            raise ImportFileError(place, f"the name {shown('::'.join(parts))} contains ::", "rename it")
        return "::".join(parts)

    def _in_columns(self, row: Row) -> Naming:
        target = self._text(row, "target") if "target" in self._texts else None
        if "state" not in self._texts:
            return Naming(None, target)
        word = self._text(row, "state")
        state = state_named(word, self._words)
        if state is None:
            raise ImportFileError(
                self._grid.place(row, self._texts["state"]),
                f"{shown(word)} is not a known state",
                "use `unloaded`, `loaded` or `deflection`, or give `state_words`",
            )
        return Naming(None, target, state)

    def _text(self, row: Row, kind: Kind) -> str:
        index = self._texts[kind]
        place = self._grid.place
        if row.kinds is not None and row.kinds[index] not in ("text", "number"):
            raise ImportFileError(place(row, index), f"{row.kinds[index]} as {kind}", "enter it as text")
        if not row.cells[index]:
            raise ImportFileError(place(row, index), f"the {kind} is empty", "fill it in, in every row")
        return row.cells[index]


def _merged(first: Naming, second: Naming) -> Naming:
    for kind in ("label", "target", "state"):
        one, other = getattr(first, kind), getattr(second, kind)
        if one is not None and other is not None and one != other:
            raise Fault(
                f"the {kind} is {shown(one)} by one name and {shown(other)} by another",
                "correct the name of the point or of the file, or the templates",
            )
    return Naming(first.label or second.label, first.target or second.target, first.state or second.state)
