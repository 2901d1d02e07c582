"""Objects of JSON as a table: an array of objects, or an object in each line, with a row for each object."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, TypeGuard

from pydantic_core import from_json

from jointstiff.schemas.imports import FilePreview
from jointstiff.service.importing import limits
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.formats.messages import LEAST_ROWS, NumberedObject, split_messages
from jointstiff.service.importing.grammar import find_known_unit, is_force, is_joint
from jointstiff.service.importing.grid import COORDINATES, Grid, Row, too_large_error
from jointstiff.service.importing.texts.encoding import decode

_MOST_DEPTH: Final = 6
_WRENCH: Final = "wrench"
"""Field of a force and its moment, six numbers."""
_CAMPAIGNS: Final = frozenset(("measurement_set", "observations", "robot_id", "poses"))
"""Fields of documents that need no import."""
_NAMES: Final = ("name", "target", "id", "label")
"""Fields of an object that name it among others."""

_LISTS_OF_NAMES: Final = frozenset(("joint_names", "names", "name"))
"""Fields with the names of the joints in their order."""
_ANGLES: Final = frozenset(("position", "positions", "joints", "joint_positions", "angles", "q"))
"""Fields with the angles of named joints."""


class NumberText(str):
    """Number as a document writes it, with all its digits."""

    __slots__ = ()


def read_json_rows(file: str, content: bytes) -> list[Grid]:
    """Return the objects of a JSON file as tables, one for each kind of messages; none of another document.

    Raises:
        ImportFileError: the text is damaged, or the table is too large.
    """
    text, encoding = decode(file, content)
    objects = _read_lines(text)
    if len(objects) < LEAST_ROWS:
        objects = _read_array(text)
    if len(objects) < LEAST_ROWS:
        return []
    return build_grids_of_objects(file, encoding, objects, "JSON")


def build_error_of_list(file: str, document: object) -> ImportFileError | None:
    """Return the error that a list is not read for its name, which is one of ours; None without such a list.

    The objects of our lists have joints.
    """
    fields = document.items() if isinstance(document, dict) else ()
    lists = ((key, each) for key, each in fields if key in _CAMPAIGNS and _is_array_of_objects(each))
    name = next((key for key, each in lists if not any("joints" in own for own in each)), None)
    if name is None:
        return None
    reason = f"the field {quote(name)} is that of a campaign, but its objects have no `joints`"
    remedy = f"rename the field {quote(name)}, such as to 'postures'"
    return ImportFileError(Place(file), reason, remedy).mark_document()


def build_grids_of_objects(
    file: str, encoding: str, objects: Sequence[NumberedObject], language: str
) -> list[Grid]:
    """Return the objects of a document in a language, such as JSON, as a table for each kind of messages.

    Raises:
        ImportFileError: a table is too large, or a name is too long.
    """
    kinds = split_messages(objects)
    if not kinds:
        return [_build_grid(file, encoding, objects, language)]
    tables = {kind: _build_grid(file, encoding, messages, language) for kind, messages in kinds.items()}
    return [
        replace(table, preview=table.preview.model_copy(update={"sheet": kind}))
        for kind, table in tables.items()
    ]


def _build_grid(file: str, encoding: str, objects: Sequence[NumberedObject], language: str) -> Grid:
    """Return the objects of a document in a language, such as JSON, as a table with a row for each.

    Raises:
        ImportFileError: the table is too large, or a name is too long.
    """
    records = [dict(_flatten(each, "", 0)) for _, each in objects]
    headers = list(dict.fromkeys(header for record in records for header in record))
    is_large = len(headers) > limits.MAX_COLUMNS or len(headers) * len(records) > limits.MAX_CELLS
    if is_large or len(records) > limits.MAX_ROWS:
        raise too_large_error(file, 1)
    for header in headers:
        if len(header) > limits.MAX_CELL_LENGTH:
            reason = f"a name has more than {limits.MAX_CELL_LENGTH} characters: {quote(header)}"
            raise ImportFileError(Place(file), reason, "shorten the name")
    rows = [Row(1, tuple(headers))]
    for (line, _), record in zip(objects, records, strict=True):
        cells = tuple(record.get(header, "")[: limits.MAX_CELL_LENGTH] for header in headers)
        rows.append(Row(line, cells))
    note = f"{len(records)} objects of {language} were read as rows"
    preview = FilePreview(file=file, format="text", encoding=encoding, assumptions=[note])
    return Grid(preview, tuple(rows))


def _read_lines(text: str) -> list[NumberedObject]:
    """Return the object in each line of a text, with its line; none if a line is no object."""
    objects = list[NumberedObject]()
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        try:
            found = json.loads(line)
        except (ValueError, RecursionError):
            return []
        if not isinstance(found, dict):
            return []
        objects.append((number, found))
    return objects


def _read_array(text: str) -> list[NumberedObject]:
    """Return the objects of the array that a document of JSON is or has; none of another document."""
    try:
        document = from_json(text)
    except ValueError:
        return []
    return list(enumerate(find_objects(document), 1))


def find_objects(document: object) -> list[dict[str, Any]]:
    """Return the objects of the array that a document is or has, or that its own names name; else none.

    A force that the document states once is that of all objects without a force of this name, and names of
    joints that it states once name the angles of all objects without names of their own. A document that has
    fields of our own, but no names of joints, needs no import.
    """
    objects = _list_objects(document) if isinstance(document, dict) else document
    return objects if _is_array_of_objects(objects) else []


def _list_objects(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the objects of a document with the forces, the unit and the names that it states once."""
    parts = [document, *(each for each in document.values() if isinstance(each, dict))]
    names = next((found for part in parts if (found := _find_names(part)) is not None), None)
    if names is None and not _CAMPAIGNS.isdisjoint(document):
        return []
    forces = {key: each for key, each in document.items() if is_force(str(key)) and _is_vector(each)}
    others = {key: each for key, each in document.items() if key not in forces}
    objects = _find_array(others) or _turn_columns(others) or _list_named(others)
    has_force_of_each = len(objects) == COORDINATES  # three numbers may be the forces of three objects
    loaded = objects if has_force_of_each else [{**each, **(forces | each)} for each in objects]
    unit = _find_stated_unit(document)
    complete = [{_add_unit(str(key), unit): value for key, value in each.items()} for each in loaded]
    if names is None:
        return complete
    return [_name_angles(each, names) if _find_names(each) is None else each for each in complete]


def _find_stated_unit(document: Mapping[str, Any]) -> str:
    """Return the unit of forces that the object `units` of a document states; empty without one."""
    units = document.get("units")
    unit = str(units.get("force", "")) if isinstance(units, dict) else ""
    known = find_known_unit(unit)
    return known[1] if known is not None and known[0] == "force" else ""


def _add_unit(key: str, unit: str) -> str:
    """Return the name of a force or a wrench with a unit if it has none; other names unchanged."""
    is_load = is_force(key) or key.casefold() == _WRENCH
    return f"{key}_{unit}" if unit and is_load and not _split_unit(key)[1] else key


def _is_vector(value: object) -> bool:
    """Return whether a value is a list of three numbers."""
    return isinstance(value, list) and len(value) == COORDINATES and all(map(_is_number, value))


def _find_array(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the only array of objects of a document, or of the only object in it; else none."""
    for _ in range(_MOST_DEPTH):
        arrays = [each for each in document.values() if _is_array_of_objects(each)]
        inner = [each for each in document.values() if isinstance(each, dict)]
        if len(arrays) == 1:
            return list(arrays[0])
        if arrays or len(inner) != 1:
            break
        document = inner[0]
    return []


def _list_named(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the objects of a document, or of the only object in it, with their names as labels.

    The objects have the same fields, as postures have; of other documents nothing is returned.
    """
    objects = {str(key): each for key, each in document.items() if isinstance(each, dict)}
    if len(objects) == 1:
        inner = next(iter(objects.values()))
        objects = {str(key): each for key, each in inner.items() if isinstance(each, dict)}
    fields = {tuple(sorted(map(str, each))) for each in objects.values()}
    if len(objects) < LEAST_ROWS or len(fields) != 1:
        return []
    return [{"label": name, **each} for name, each in objects.items()]


def _turn_columns(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return an object for each element of the arrays of a document, which have one length; else none."""
    arrays = {key: each for key, each in document.items() if isinstance(each, list)}
    lengths = {len(each) for each in arrays.values()}
    if len(arrays) < 2 or len(lengths) != 1:
        return []
    return [dict(zip(arrays, elements, strict=True)) for elements in zip(*arrays.values(), strict=True)]


def _is_array_of_objects(value: object) -> TypeGuard[list[dict[str, Any]]]:
    """Return whether a value is an array of objects."""
    return isinstance(value, list) and bool(value) and all(isinstance(each, dict) for each in value)


def _flatten(value: object, name: str, depth: int) -> Iterator[tuple[str, str]]:
    """Yield header and text of each number and text in a value; names of nested fields are joined.

    Three numbers of one field are x, y and z; more numbers are counted from 1, as joints are.
    """
    if depth > _MOST_DEPTH or value is None:
        return
    if isinstance(value, Mapping):
        for key, each in _name_by_list(value).items():
            yield from _flatten(each, _join(name, str(key)), depth + 1)
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for key, each in zip(_name_elements(value, name), value, strict=True):
            yield from _flatten(each, key, depth + 1)
    else:
        yield name, _write(value)


def _name_by_list(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return an object in which a list of names, as ROS writes it, names the numbers of other lists.

    Angles have the names of the joints; the field of other numbers, such as velocities, has them in it.
    """
    names = _find_names(value)
    if names is None:
        return dict(value)
    named = _name_angles({field: each for field, each in value.items() if each is not names}, names)
    return {
        field: dict(zip(names, each, strict=True)) if _has_number_for_each(names, each) else each
        for field, each in named.items()
    }


def _find_names(value: Mapping[str, Any]) -> list[str] | None:
    """Return the list of names of joints that an object has; None without one."""
    lists = [each for key, each in value.items() if str(key).casefold() in _LISTS_OF_NAMES]
    return next(filter(_is_list_of_names, lists), None)


def _name_angles(value: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """Return an object with a field for each angle, which has the name of its joint."""
    named: dict[str, Any] = {}
    for field, each in value.items():
        if str(field).casefold() in _ANGLES and _has_number_for_each(names, each):
            named |= dict(zip(names, each, strict=True))
        else:
            named[field] = each
    return named


def _has_number_for_each(names: Sequence[str], value: object) -> bool:
    """Return whether a value is a list of a number for each name."""
    return isinstance(value, list) and len(value) == len(names) and all(map(_is_number, value))


def _is_list_of_names(value: object) -> bool:
    """Return whether a value is a list of different texts."""
    if not isinstance(value, list) or len(value) <= COORDINATES:
        return False
    are_texts = all(isinstance(each, str) and not _is_number(each) for each in value)
    return are_texts and len(set(value)) == len(value)


def _is_number(value: object) -> bool:
    """Return whether a value is a number, or the text of one."""
    return isinstance(value, int | float | NumberText)


def _join(name: str, key: str) -> str:
    """Return the name of a field in a field; names of mere containers, such as `targets`, are left out."""
    is_container = name.casefold() in ("targets", "joints", "data", "points", "positions", "readings")
    return key if is_container or not name else f"{name} {key}"


def _name_elements(values: Sequence[Any], name: str) -> list[str]:
    """Return the header of each element of an array: x, y, z of three numbers, a name, else a number."""
    base, unit = _split_unit(name)
    ending = f" [{unit}]" if unit else ""
    if _is_array_of_objects(values):
        found = [next((str(each[key]) for key in _NAMES if key in each), "") for each in values]
        if all(found) and len(set(found)) == len(found):
            return found
    are_numbers = all(map(_is_number, values))
    if are_numbers and len(values) == COORDINATES and not is_joint(base):
        return [f"{base} {axis}{ending}" for axis in "xyz"]
    if base.casefold() == _WRENCH and are_numbers and len(values) == 2 * COORDINATES:
        # The unit is that of the force, not that of the moment.
        return [f"{base} {n}{ending if n <= COORDINATES else ''}" for n in range(1, len(values) + 1)]
    word = base if is_joint(base) or not base.casefold().startswith("joint") else "joint"
    return [f"{word} {number}{ending}" for number in range(1, len(values) + 1)]


def _split_unit(name: str) -> tuple[str, str]:
    """Split a name such as `joints_deg` into name and unit; the unit is empty without one."""
    base, _, unit = name.replace(" ", "_").rpartition("_")
    if base and find_known_unit(unit) is not None:
        return name[: len(base)], unit
    return name, ""


def _write(value: object) -> str:
    """Return the text of a number, of a truth value, or of a text."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value)
    return " ".join(str(value).split())
