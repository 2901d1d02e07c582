"""A table as data: columns of values with their units, rounded when the table is rendered."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import floor, isfinite, log10
from types import MappingProxyType
from typing import Any, Literal, get_args

from pydantic.fields import FieldInfo

from jointstiff.schemas.fields import Message
from jointstiff.schemas.joints import JOINT_UNITS, JointKind
from jointstiff.solver.text import figure

NO_NUMBER = "—"
"""Shown where there is no number."""


def rounded(value: float | None, uncertainty: float | None = None, bare: str = ".4g") -> str:
    """Format a value to two digits of its uncertainty, both in one unit; by `bare` without one."""
    if value is None:
        return NO_NUMBER
    if not uncertainty or not isfinite(uncertainty):
        return figure(value, bare)
    decimals = min(1 - floor(log10(uncertainty)), 9)
    return figure(round(value, decimals), f".{max(decimals, 0)}f")


def concise(value: float, uncertainty: float | None, bare: str = ".4g") -> str:
    """Format a value with its standard uncertainty in units of the last digits (GUM, 7.2.2)."""
    text = rounded(value, uncertainty, bare)
    if not uncertainty or not isfinite(uncertainty):
        return text
    digits = rounded(uncertainty, uncertainty)
    return f"{text}({digits.lstrip('0.') or 0 if float(digits) < 1 else digits})"


def percent(share: float | None) -> str:
    """Format a share."""
    return NO_NUMBER if share is None else f"{100 * share:.1f} %"


Style = Literal["", "title", "good", "care", "bad", "dim", "verdict_use", "verdict_care", "verdict_not"]
Value = str | float | int | None


@dataclass(frozen=True)
class Line:
    """A line of text."""

    text: str
    style: Style = ""


Show = Callable[[Any], str | Line]
"""Rounds a value, and writes it as text."""


@dataclass(frozen=True)
class Column:
    """A column of values, one for each row."""

    name: str
    values: Sequence[Any]  # numbers in SI units, texts, or what `show` takes
    show: Show = str
    unit: str = ""  # as shown
    text: bool = False  # whether it has text, which is aligned to the left
    widest: int | None = None  # characters in a line of the terminal; longer text is folded

    @property
    def header(self) -> str:
        """Name with its unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def cells(self) -> list[Line]:
        """Return the values as they are shown."""
        return [as_line(NO_NUMBER if value is None else self.show(value)) for value in self.values]


@dataclass(frozen=True)
class Table:
    """A table for people. All columns have the same number of values."""

    columns: Sequence[Column]
    title: str = ""
    caption: str = ""
    upright: bool = False  # whether each row is shown as a column, as where one place has many quantities
    plain: bool = False  # whether the terminal leaves out the lines between cells

    @property
    def legend(self) -> str:
        """Title and caption in one line."""
        return "; ".join(text for text in (self.title, self.caption) if text).replace("\n", " ")

    def head(self) -> list[str]:
        """Return the headers as shown."""
        if not self.upright:
            return [column.header for column in self.columns]
        return [self.columns[0].header, *(cell.text for cell in self.columns[0].cells())]

    def rows(self) -> list[list[Line]]:
        """Return the cells as shown, row by row."""
        if not self.upright:
            return [list(row) for row in zip(*(column.cells() for column in self.columns), strict=True)]
        return [[Line(column.header), *column.cells()] for column in self.columns[1:]]

    def text_columns(self) -> list[int]:
        """Return the indices of the shown columns with text; in an upright table, that of its headers."""
        if self.upright:
            return [0]
        return [place for place, column in enumerate(self.columns) if column.text]

    def shown(self) -> dict[str, object]:
        """Return the table as JSON of texts."""
        rows = [[cell.text for cell in row] for row in self.rows()]
        texts = {"title": self.title, "caption": self.caption, "legend": self.legend}
        return {**texts, "head": self.head(), "rows": rows, "texts": self.text_columns()}


@dataclass(frozen=True)
class Chart:
    """Numbers by name for a picture: bars of several series side by side. The terminal leaves it out."""

    title: str
    names: Sequence[str]  # names of the places along the axis
    series: Mapping[str, Sequence[float | None]]  # one number for each place, in SI units; None for none
    factor: float  # factor from SI to the unit
    unit: str  # as shown
    axis: str = "configurations"  # what the places are
    # by the name of a series: an interval for each place, None for none, an end of None for no limit
    intervals: Mapping[str, Sequence[tuple[float | None, float | None] | None]] = field(default_factory=dict)
    logarithmic: bool = False  # whether numbers of different orders of magnitude stand side by side


@dataclass(frozen=True)
class Area:
    """Numbers over a plane, for a picture."""

    title: str
    x: Sequence[float]  # in SI units
    y: Sequence[float]
    values: Sequence[float]  # in SI units; NaN where there is no number
    names: tuple[str, str, str]  # of x, y and the values, with the units that are shown
    factor: float  # factor of the values from SI to the unit


Part = Table | Line | Chart
"""A part of what people read of a job: the terminal prints the parts in order, a report sorts them."""


@dataclass(frozen=True)
class Sheet:
    """Columns of raw values for files: their headers carry the unit, such as `force x [N]`."""

    columns: Mapping[str, Any]  # columns by header: sequences of values, or arrays (rows,)
    texts: frozenset[str] = field(default_factory=frozenset)  # headers of the columns that npz holds apart
    digits: str = ""  # format of numbers in CSV, such as `.10g`; as many as read back the same without

    @classmethod
    def of_joints(cls, sheet: Sheet, kinds: Sequence[JointKind | None]) -> Sheet:
        """Return a sheet with a row for each joint; if one is prismatic, its headers say both units."""
        if "prismatic" not in kinds:
            return sheet
        columns: dict[str, Any] = {}
        for header, values in sheet.columns.items():
            columns[_by_kind(header)] = values
            if header == "joint":
                columns["kind"] = list(kinds)
        return replace(sheet, columns=columns, texts=sheet.texts | {"kind"})

    @classmethod
    def of_rows(cls, rows: Iterable[Mapping[str, Value]]) -> Sheet:
        """Build a sheet of rows that have the same headers."""
        listed = list(rows)
        return cls({header: [row[header] for row in listed] for header in (listed[0] if listed else ())})

    @classmethod
    def of_fields(
        cls,
        rows: Sequence[Message],
        columns: Mapping[str, str],
        units: Mapping[str, tuple[float, str]] = MappingProxyType({}),
    ) -> Sheet:
        """Build a sheet of messages of one kind. Headers carry the units of the fields.

        Args:
            rows: the messages.
            columns: path of each field by its header; one such as `force {x y z}` has a column a component.
            units: factor and name of units that are shown otherwise.
        """
        sheet: dict[str, list[Value]] = {}
        for header, path in columns.items() if rows else ():
            values, unit = [_value_at(row, path) for row in rows], _unit_at(type(rows[0]), path)
            factor, shown = units.get(unit, (1.0, unit))
            for name, place in _components(f"{header} [{shown}]" if shown else header):
                parts = [_component(value, place) for value in values]
                sheet[name] = [factor * part if isinstance(part, float) else part for part in parts]
        return cls(sheet)


def _by_kind(header: str) -> str:
    """Return a header with the unit that a prismatic joint's number has, too."""
    turning, sliding = JOINT_UNITS["revolute"], JOINT_UNITS["prismatic"]
    for name in ("position", "effort", "stiffness", "compliance"):
        unit = f"[{getattr(turning, name)}]"
        if header.endswith(unit):
            return f"{header.removesuffix(unit)}{unit[:-1]}, prismatic {getattr(sliding, name)}]"
    return header


def _components(header: str) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield a header such as `force {x y z} [N]` for each component, and the place of the component."""
    before, brace, rest = header.partition("{")
    if not brace:
        yield header, ()
        return
    words, _, after = rest.partition("}")
    for k, word in enumerate(words.split()):
        for name, place in _components(after):
            yield f"{before}{word}{name}", (k, *place)


def _value_at(row: Message | None, path: str) -> Any:  # noqa: ANN401 - of any field
    name, _, rest = path.partition(".")
    value = None if row is None else getattr(row, name)
    return _value_at(value, rest) if rest else value


def _component(value: Any, place: Sequence[int]) -> Value:  # noqa: ANN401 - of any field
    for k in place:
        value = None if value is None else value[k]
    return "; ".join(value) or None if isinstance(value, list) else value


def _unit_at(kind: type[Message], path: str) -> str:
    name, _, rest = path.partition(".")
    field = kind.model_fields[name]
    return _unit_at(next(_messages_in(field.annotation)), rest) if rest else field_unit(field)


def field_unit(field: FieldInfo, key: str = "unit") -> str:
    """Return the unit that the schema of a field states under a key; none for one without a unit."""
    return _declared(field.json_schema_extra, key) or _unit_within(field.annotation, key)


def _messages_in(annotation: Any) -> Iterator[type[Message]]:  # noqa: ANN401 - a type
    if isinstance(annotation, type) and issubclass(annotation, Message):
        yield annotation
    for part in get_args(annotation):
        yield from _messages_in(part)


def _unit_within(annotation: Any, key: str) -> str:  # noqa: ANN401 - a type
    """Return the unit that a part of a type declares, such as that of the values of a dictionary."""
    for part in get_args(annotation):
        is_field = isinstance(part, FieldInfo)
        unit = _declared(part.json_schema_extra, key) if is_field else _unit_within(part, key)
        if unit:
            return unit
    return ""


def _declared(extra: object, key: str) -> str:
    return str(extra.get(key, "")) if isinstance(extra, Mapping) else ""


def text_table(
    head: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "", texts: Sequence[int] = (0,)
) -> Table:
    """Build a table of text that is rounded already."""
    columns = [
        Column(name, [row[place] for row in rows], text=place in texts) for place, name in enumerate(head)
    ]
    return Table(columns, caption=caption)


def as_line(shown: str | Line) -> Line:
    """Return text as a line without a style."""
    return shown if isinstance(shown, Line) else Line(shown)


def number(form: str, scale: float = 1.0) -> Show:
    """Show numbers in a unit by a format: `number(".3f", 1e3)` for metres in mm."""
    return lambda value: figure(scale * value, form)


def numbers(form: str, scale: float = 1.0, between: str = "  ") -> Show:
    """Show the components of a vector in a unit."""
    return lambda values: between.join(figure(scale * value, form) for value in values)


def ends(form: str, scale: float = 1.0, between: str = " to ") -> Show:
    """Show an interval in a unit."""
    return lambda pair: between.join("no limit" if end is None else figure(scale * end, form) for end in pair)
