"""Tables as data: columns of values with their units, which are rounded when the table is shown."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import floor, isfinite, log10
from types import MappingProxyType
from typing import Any, Literal, get_args

from pydantic.fields import FieldInfo

from jointstiff.schemas.fields import Message
from jointstiff.schemas.joints import JOINT_UNITS, JointKind
from jointstiff.solver.text import figure

NO_NUMBER = "—"
"""Text shown in place of a missing number."""


def format_rounded(value: float | None, uncertainty: float | None = None, bare: str = ".4g") -> str:
    """Format a value to the second digit of its uncertainty; without an uncertainty by the format `bare`."""
    if value is None:
        return NO_NUMBER
    if not uncertainty or not isfinite(uncertainty):
        return figure(value, bare)
    decimals = min(1 - floor(log10(uncertainty)), 9)
    return figure(round(value, decimals), f".{max(decimals, 0)}f")


def format_percent(fraction: float | None) -> str:
    """Format a share between 0 and 1 in percent; a dash for None."""
    return NO_NUMBER if fraction is None else f"{100 * fraction:.1f} %"


Style = Literal["", "title", "good", "care", "bad", "dim", "verdict_use", "verdict_care", "verdict_not"]
Value = str | float | int | None


@dataclass(frozen=True)
class NumberParts:
    """A number of a cell in its parts, from which the page draws the number with its interval and width."""

    value: str = ""  # number, or the half-width of its interval; empty if the cell has the interval alone
    interval: str = ""  # such as `2.97 … 3.18`; empty if another cell has the interval, or none has
    limit: str = ""  # such as `> 3.1`, in place of the number
    unit: str = ""  # unit behind the number; empty if the column states it
    relative: float | None = None  # half of the interval relative to the number; None if unknown


@dataclass(frozen=True)
class Line:
    """A line of text."""

    text: str
    style: Style = ""
    # numbers that the text consists of; empty for words. Two lines are equal if their texts are.
    numbers: tuple[NumberParts, ...] = field(default=(), repr=False, compare=False)


Show = Callable[[Any], str | Line]
"""Function that formats a value of a column."""


@dataclass(frozen=True)
class Column:
    """A column of values, one for each row."""

    name: str
    values: Sequence[Any]  # numbers in SI units, texts, or other values that `show` formats
    show: Show = str
    unit: str = ""  # unit of the numbers as shown
    text: bool = False  # whether the column has text, which is aligned to the left
    widest: int | None = None  # characters in a line of the terminal; longer text is folded

    @property
    def header(self) -> str:
        """Name with its unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def cells(self) -> list[Line]:
        """Return the values as cells of text, as they are shown; a dash for None."""
        return [as_line(NO_NUMBER if value is None else self.show(value)) for value in self.values]


@dataclass(frozen=True)
class Table:
    """A table for people. All columns have the same number of values."""

    columns: Sequence[Column]
    title: str = ""
    caption: str = ""
    upright: bool = False  # whether the table is shown transposed, for many quantities of few places
    plain: bool = False  # whether the terminal leaves out the lines between cells

    @property
    def legend(self) -> str:
        """Title and caption in one line."""
        return "; ".join(text for text in (self.title, self.caption) if text).replace("\n", " ")

    def head(self) -> list[str]:
        """Return the headers as shown; in an upright table these are the cells of the first column."""
        if not self.upright:
            return [column.header for column in self.columns]
        return [self.columns[0].header, *(cell.text for cell in self.columns[0].cells())]

    def rows(self) -> list[list[Line]]:
        """Return the cells as shown, row by row; in an upright table each column is shown as a row."""
        if not self.upright:
            return [list(row) for row in zip(*(column.cells() for column in self.columns), strict=True)]
        return [[Line(column.header), *column.cells()] for column in self.columns[1:]]

    def text_columns(self) -> list[int]:
        """Return the indices of the columns, as shown, with text; in an upright table only 0, the headers."""
        if self.upright:
            return [0]
        return [index for index, column in enumerate(self.columns) if column.text]

    def shown(self) -> dict[str, object]:
        """Return the table as a dictionary for JSON: all cells as texts, places of dim cells, and numbers.

        `numbers` has (row, column, numbers in their parts) for each cell that consists of numbers.
        """
        texts = list[list[str]]()
        dim = list[tuple[int, int]]()
        numbers = list[tuple[int, int, list[dict[str, Any]]]]()
        for row, cells in enumerate(self.rows()):
            texts.append([cell.text for cell in cells])
            for column, cell in enumerate(cells):
                if cell.style == "dim":
                    dim.append((row, column))
                if cell.numbers:
                    numbers.append((row, column, [asdict(number) for number in cell.numbers]))
        return {
            "title": self.title,
            "caption": self.caption,
            "legend": self.legend,
            "head": self.head(),
            "rows": texts,
            "texts": self.text_columns(),
            "dim": dim,
            "numbers": numbers,
        }


@dataclass(frozen=True)
class Chart:
    """Numbers for a bar chart of several series. The terminal does not show charts."""

    title: str
    names: Sequence[str]  # names of the places along the axis
    series: Mapping[str, Sequence[float | None]]  # one number for each place, in SI units; None for none
    factor: float  # factor from SI units to `unit`
    unit: str  # unit as shown
    axis: str = "configurations"  # plural noun for the places along the axis
    # name of a series → interval at each place; None for no interval, an end of None for no limit
    intervals: Mapping[str, Sequence[tuple[float | None, float | None] | None]] = field(default_factory=dict)
    logarithmic: bool = False  # whether the axis is logarithmic, for numbers of different magnitudes
    quantity: str = ""  # quantity of the numbers, such as "stiffness"


@dataclass(frozen=True)
class Area:
    """Numbers over a plane, for a picture."""

    title: str
    x: Sequence[float]  # in SI units
    y: Sequence[float]
    values: Sequence[float]  # in SI units; NaN where there is no number
    names: tuple[str, str, str]  # names of x, y and the values, with the units that are shown
    factor: float  # factor of the values from SI units to the unit that is shown


Part = Table | Line | Chart
"""A part of the output about a job: the terminal prints the parts in order, a report sorts them."""


@dataclass(frozen=True)
class Sheet:
    """Columns of raw values for files: their headers carry the unit, such as `force x [N]`."""

    columns: Mapping[str, Any]  # columns by header: sequences of values, or arrays (rows,)
    texts: frozenset[str] = field(default_factory=frozenset)  # headers of text columns, separate in npz
    digits: str = ""  # format of numbers in CSV, such as `.10g`; if empty, numbers have full precision

    @classmethod
    def with_joint_kinds(cls, sheet: Sheet, kinds: Sequence[JointKind | None]) -> Sheet:
        """Return a sheet that suits prismatic joints, if any: two units in headers, a column `kind`.

        Args:
            sheet: sheet with a row for each joint.
            kinds: kind of the joint of each row; None for a fixed joint.
        """
        if "prismatic" not in kinds:
            return sheet
        columns: dict[str, Any] = {}
        for header, values in sheet.columns.items():
            columns[_add_prismatic_unit(header)] = values
            if header == "joint":
                columns["kind"] = list(kinds)
        return replace(sheet, columns=columns, texts=sheet.texts | {"kind"})

    @classmethod
    def from_rows(cls, rows: Iterable[Mapping[str, Value]]) -> Sheet:
        """Build a sheet from rows that all map the same headers to values."""
        row_list = list(rows)
        headers = row_list[0] if row_list else ()
        return cls({header: [row[header] for row in row_list] for header in headers})

    @classmethod
    def from_messages(
        cls,
        rows: Sequence[Message],
        columns: Mapping[str, str],
        units: Mapping[str, tuple[float, str]] = MappingProxyType({}),
    ) -> Sheet:
        """Build a sheet from messages of one class, with the units of their fields in the headers.

        Args:
            rows: the messages.
            columns: maps each header to the path of a field. A header such as `force {x y z}` makes a column
                for each component.
            units: maps the unit of a field to (factor, unit to show); the shown value is factor · value.
        """
        if not rows:
            return cls({})
        sheet: dict[str, list[Value]] = {}
        for header, path in columns.items():
            unit = _unit_at(type(rows[0]), path)
            factor, shown_unit = units.get(unit, (1.0, unit))
            header_with_unit = f"{header} [{shown_unit}]" if shown_unit else header
            values = [_value_at(row, path) for row in rows]
            for full_header, indices in _expand_header(header_with_unit):
                components = [_component_at(value, indices) for value in values]
                sheet[full_header] = [_scale(component, factor) for component in components]
        return cls(sheet)


def _scale(value: Value, factor: float) -> Value:
    """Return a number times a factor; a value that is not a number with a unit is unchanged."""
    return factor * value if isinstance(value, float) else value


def _add_prismatic_unit(header: str) -> str:
    """Return a header with the unit for prismatic joints added to the unit for revolute joints."""
    revolute, prismatic = JOINT_UNITS["revolute"], JOINT_UNITS["prismatic"]
    for name in ("position", "effort", "stiffness", "compliance"):
        unit = f"[{getattr(revolute, name)}]"
        if header.endswith(unit):
            return f"{header.removesuffix(unit)}{unit[:-1]}, prismatic {getattr(prismatic, name)}]"
    return header


def _expand_header(header: str) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield (header, indices) for each component of a header such as `force {x y z} [N]`.

    `force x [N]` has the indices (0,); a header without braces has no indices.
    """
    before, brace, after_brace = header.partition("{")
    if not brace:
        yield header, ()
        return
    component_names, _, after = after_brace.partition("}")
    for index, component in enumerate(component_names.split()):
        for header_of_rest, indices in _expand_header(after):
            yield f"{before}{component}{header_of_rest}", (index, *indices)


def _value_at(row: Message | None, path: str) -> Any:  # noqa: ANN401 - of any field
    """Return the value of the field at a path, such as `compliance.worst`, of a message; None if absent."""
    name, _, rest = path.partition(".")
    value = None if row is None else getattr(row, name)
    return _value_at(value, rest) if rest else value


def _component_at(value: Any, indices: Sequence[int]) -> Value:  # noqa: ANN401 - of any field
    """Return the component of a nested list at `indices`, one per level; a list of texts is joined."""
    for index in indices:
        value = None if value is None else value[index]
    return "; ".join(value) or None if isinstance(value, list) else value


def _unit_at(kind: type[Message], path: str) -> str:
    """Return the unit of the field at a path, such as `compliance.worst`, of a class of messages."""
    name, _, rest = path.partition(".")
    field = kind.model_fields[name]
    return _unit_at(next(_find_message_classes(field.annotation)), rest) if rest else field_unit(field)


def field_unit(field: FieldInfo, key: str = "unit") -> str:
    """Return the unit that the JSON schema of a field states under `key`; empty if it states no unit."""
    return _unit_in_schema(field.json_schema_extra, key) or _find_unit(field.annotation, key)


def _find_message_classes(annotation: Any) -> Iterator[type[Message]]:  # noqa: ANN401 - a type
    """Yield the classes of messages that a type annotation contains."""
    if isinstance(annotation, type) and issubclass(annotation, Message):
        yield annotation
    for part in get_args(annotation):
        yield from _find_message_classes(part)


def _find_unit(annotation: Any, key: str) -> str:  # noqa: ANN401 - a type
    """Return the unit that a part of a type annotation declares, as for a dictionary's values; else empty."""
    for argument in get_args(annotation):
        is_field = isinstance(argument, FieldInfo)
        unit = _unit_in_schema(argument.json_schema_extra, key) if is_field else _find_unit(argument, key)
        if unit:
            return unit
    return ""


def _unit_in_schema(extra: object, key: str) -> str:
    """Return the unit under `key` in the extra entries of a JSON schema; empty if there is no such entry."""
    return str(extra.get(key, "")) if isinstance(extra, Mapping) else ""


def build_text_table(
    head: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "", left_aligned: Sequence[int] = (0,)
) -> Table:
    """Build a table from headers and rows of ready texts.

    Args:
        head: headers of the columns.
        rows: texts of each row.
        caption: caption of the table.
        left_aligned: indices of the columns that are aligned to the left.
    """
    columns = [
        Column(name, [row[index] for row in rows], text=index in left_aligned)
        for index, name in enumerate(head)
    ]
    return Table(columns, caption=caption)


def as_line(shown: str | Line) -> Line:
    """Return a text as a line without style; return a line unchanged."""
    return shown if isinstance(shown, Line) else Line(shown)


def number_formatter(format_spec: str, scale: float = 1.0) -> Show:
    """Return a function that formats a number times a scale; `.3f` and 1e3 show metres in mm."""
    return lambda value: figure(scale * value, format_spec)


def vector_formatter(format_spec: str, scale: float = 1.0, between: str = "  ") -> Show:
    """Return a function that formats the components of a vector times a scale."""
    return lambda values: between.join(figure(scale * value, format_spec) for value in values)
