"""Fields of a request for people: each with its value and unit, from the message itself."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from math import pi
from typing import Any, Final, get_args

from pydantic.fields import FieldInfo
from pydantic_core import to_jsonable_python

from jointstiff.schemas.fields import Message
from jointstiff.service.tables.numbers import figure

_SHOWN: Final[Mapping[str, tuple[float, str]]] = {
    "m": (1e3, "mm"),
    "rad": (180.0 / pi, "°"),
    "deg": (1.0, "°"),
    "1": (1.0, ""),
    "N.m": (1.0, "N·m"),
    "N.m/rad": (1e-6, "10⁶ N·m/rad"),
    "N.mm": (1.0, "N·mm"),
    "kN.m": (1.0, "kN·m"),
    "kgf.m": (1.0, "kgf·m"),
}
"""Factor and name of units that people see otherwise."""
_STATED_UNIT: Final = re.compile(r"\bin units\.(\w+)")
"""In the description of a field whose unit the request states."""
_LONGEST: Final = 300
"""Characters of a line; of longer ones the length and the hash are stated."""
_MOST_LINES: Final = 20
NOT_STATED: Final = "not stated"


def requested(request: Message) -> list[tuple[str, str]]:
    """Return label and text of all fields of a request; one line names those without a value.

    Lengths are in mm, angles in degrees, stiffnesses in 10⁶ N·m/rad. Of what is too long to be read, such as
    readings and files, the number of entries and the SHA-256 of their JSON are stated.
    """
    entries = list(_entries(request, getattr(request, "units", None), ""))
    absent = [label for label, text in entries if not text]
    facts = [(label[:1].upper() + label[1:], text) for label, text in entries if text]
    return [*facts, *([("Not stated", ", ".join(absent))] if absent else [])]


def _entries(message: Message, units: object, within: str) -> Iterator[tuple[str, str]]:
    """Yield label and text of each field; the text is empty where there is no value."""
    for name, field in type(message).model_fields.items():
        label, value = f"{within}{name.replace('_', ' ')}", getattr(message, name)
        unit = _unit(field, units)
        if isinstance(value, Message):
            yield from _entries(value, units, f"{label}: ")
        elif isinstance(value, Sequence) and value and isinstance(value[0], Message):
            lines = [_line(each, unit, units) for each in value]
            yield label, "\n".join(lines) if len(lines) <= _MOST_LINES else _summary(value)
        elif value is None or value in ("", [], (), {}):
            yield label, ""
        else:
            yield label, _line(value, unit, units)


def _line(value: object, unit: str, units: object) -> str:
    """Return a value in one line, or a summary of a long one."""
    text = _text(value, unit, units)
    return text if len(text) <= _LONGEST else _summary(value)


def _text(value: object, unit: str, units: object) -> str:
    if isinstance(value, Message):
        parts = (
            (name.replace("_", " "), _line(part, _unit(type(value).model_fields[name], units), units))
            for name, part in ((name, getattr(value, name)) for name in type(value).model_fields)
            if part is not None
        )
        return ", ".join(f"{name} {text}" for name, text in parts)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        factor, name = _SHOWN.get(unit, (1.0, unit))
        return f"{_number(factor * value)}{'' if name in ('', '°') else ' '}{name}"
    if isinstance(value, Mapping):
        return "; ".join(f"{key} {_text(part, unit, units)}" for key, part in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        if value and all(isinstance(part, int | float) and not isinstance(part, bool) for part in value):
            factor, name = _SHOWN.get(unit, (1.0, unit))
            return f"({', '.join(_number(factor * part) for part in value)}) {name}".strip()
        return "; ".join(_text(part, unit, units) for part in value)
    return str(value)


def _number(value: float) -> str:
    return figure(value, ".10g")


def _summary(value: object) -> str:
    """Return length and SHA-256 of what is too long to be read."""
    if isinstance(value, str):
        return f"{len(value):,} characters, SHA-256 {hashlib.sha256(value.encode()).hexdigest()}"
    plain = json.dumps(to_jsonable_python(value), separators=(",", ":"))
    count = len(value) if isinstance(value, Sequence | Mapping) else 1
    return f"{count} entries, SHA-256 {hashlib.sha256(plain.encode()).hexdigest()}"


def _unit(field: FieldInfo, units: object) -> str:
    """Return the unit of a field: of its schema, or that which its request states."""
    if match := _STATED_UNIT.search(field.description or ""):
        return getattr(units, match[1], None) or ""
    return _declared(field.json_schema_extra) or _within(field.annotation)


def _within(annotation: Any) -> str:  # noqa: ANN401 - a type
    """Return the unit that a part of a type declares, such as that of the values of a dictionary."""
    for part in get_args(annotation):
        unit = _declared(part.json_schema_extra) if isinstance(part, FieldInfo) else _within(part)
        if unit:
            return unit
    return ""


def _declared(extra: object) -> str:
    return str(extra.get("unit", "")) if isinstance(extra, Mapping) else ""
