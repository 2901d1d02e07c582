"""The columns of a table together: complete, unambiguous, in one unit each."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from jointstiff.schemas.imports import ImportOptions, ImportUnits
from jointstiff.schemas.robot import MAX_JOINTS
from jointstiff.service.importing import grammar
from jointstiff.service.importing.errors import NOWHERE, Faults, ImportFileError, Place, shown
from jointstiff.service.importing.grammar import DIMENSIONS, Dimension, Kind, Meaning, Quantity, spoken
from jointstiff.service.importing.grid import MAX_COLUMNS, Row, looks_like_a_number

_IGNORED: Final = Meaning(Quantity("ignored"))
_MAY_REPEAT: Final[frozenset[Kind]] = frozenset(("time", "ignored"))
_MANY, _TOGETHER = 3, 4
"""Unknown headers told one by one; of more, headers in one message, which is cut beyond 300 characters."""
_NAMES: Final = ("name", "collection", "group")
"""Columns whose texts may say a state."""
_UNIT_NORM: Final = 0.01
"""How far the squares of a rounded quaternion may add up from 1."""
_NAMED: Final[tuple[Literal["target", "state"], ...]] = ("target", "state")
"""What headers of positions may name."""
_AXIS: Final = re.compile(r"(?<![^\W_])[xyzXYZ](?![^\W_])")
_ENDS: Final = (
    re.compile(r"(?P<target>.*[^\s_-])[\s_-]+(?P<word>[^\s_-]+)"),
    re.compile(r"(?P<word>[^\s_-]+)[\s_-]+(?P<target>[^\s_-].*)"),
)
"""A target's name with a word behind it, or before it."""


@dataclass(frozen=True, slots=True)
class HeaderCell:
    """The header of one column."""

    text: str  # as it stands in the file, of several rows put together
    place: Place  # where it stands
    guessed: bool = False  # whether it was put together or assumed


@dataclass(frozen=True)
class Columns:
    """All columns of a table."""

    meanings: tuple[Meaning, ...]  # one a column, with the unit that holds for it
    texts: Mapping[Kind, int]  # index of the columns that name something, by kind
    # indices of the columns of each quantity, in order of joints or axes
    quantities: Mapping[Quantity, tuple[int, ...]]
    # by dimension, for all that occur; a moment may have none, then it is force times m
    units: Mapping[Dimension, str]
    notes: tuple[str, ...] = ()  # what was assumed, in words
    probe: bool = False  # whether `target` may be the reflector of the instrument, not a name of ours
    faulty: bool = False  # whether they do not make a table

    @property
    def needed(self) -> frozenset[str]:
        """Return what of target and state the names of points or files must give."""
        positions = [quantity for quantity in self.quantities if quantity.kind == "position"]
        bare = [kind for kind in _NAMED if any(getattr(quantity, kind) is None for quantity in positions)]
        return frozenset(bare) - self.texts.keys()


def understand(
    headers: Sequence[HeaderCell],
    rows: Sequence[Row],
    options: ImportOptions,
    axes_unit: str | None,
    faults: Faults,
    *,
    state_in_name: bool = False,
) -> Columns:
    """Understand a header.

    Args:
        headers: one a column.
        rows: of data, as long as the header.
        options: units, meanings, words for states, columns to leave out.
        axes_unit: of x, y and z, as a comment of the file says.
        faults: where to tell what is not understood.
        state_in_name: whether the name of the file has a word for a state.

    Returns:
        The columns; if they do not make a table, with what is not understood as `unknown`.
    """
    before = len(faults.found)
    unclear = Faults(MAX_COLUMNS)
    notes: list[str] = []
    rotation = _rotation(headers, rows, options)
    if rotation:
        first, *_, last = (headers[column].text for column in rotation)
        notes.append(f"{first} to {last} were ignored as the rotation of a probe")
    bare = (column for column, header in enumerate(headers) if not header.text)
    unused = {*rotation, *(column for column in bare if not any(row.cells[column] for row in rows))}
    meanings = _meanings(headers, unused, options, unclear)
    for fault in _gathered(unclear.found, headers):
        faults.add(fault)
    kinds = {meaning.kind for meaning in meanings}
    if "name" not in kinds and kinds & {"collection", "group"}:  # a target of a group is a point
        meanings = [Meaning(Quantity("name")) if one.kind == "target" else one for one in meanings]
    names = [column for column, meaning in enumerate(meanings) if meaning.kind in _NAMES]
    cells = (row.cells[column] for row in rows for column in names)
    by_template = "{state}" in f"{options.point_name} {options.file_name}"
    by_name = state_in_name or any(grammar.names_a_state(cell, options.state_words) for cell in cells)
    if not ("state" in kinds or by_template or by_name):  # nothing else says the state
        meanings = _with_states(meanings, headers, notes, faults)
    resolved = _with_units(meanings, headers, options.units, axes_unit, faults)
    texts: dict[Kind, int] = {}
    for index, meaning in enumerate(meanings):
        if meaning.axis is None and meaning.kind not in ("ignored", "unknown"):
            texts.setdefault(meaning.kind, index)
    quantities: dict[Quantity, tuple[int, ...]] = {}
    if "unknown" not in kinds:
        quantities = _quantities(meanings, headers, faults)
        _check_keys(texts, quantities, headers, options, faults)
    return Columns(
        tuple(resolved),
        texts,
        quantities,
        {DIMENSIONS[one.kind]: one.unit for one in resolved if one.axis is not None and one.unit is not None},
        tuple(notes),
        probe=bool(rotation) or bool(kinds & {"deleted", "uncertainty"}),
        faulty=bool(unclear.found) or len(faults.found) > before,
    )


def _rotation(headers: Sequence[HeaderCell], rows: Sequence[Row], options: ImportOptions) -> tuple[int, ...]:
    """Return the columns of a quaternion, Q0 to Q3 or Q1 to Q4: no angles of joints.

    Their squares add up to 1 in each row, or they are empty or 0. Angles have a unit, or the caller states
    what they are; Q0 is no joint, and where Q1 to Q4 are 0 in all rows, they may be joints.
    """
    stated = set(map(grammar.collapsed, options.columns))
    named = {
        grammar.folded(header.text): column
        for column, header in enumerate(headers)
        if grammar.collapsed(header.text) not in stated and grammar.split_unit(header.text)[1] is None
    }
    first = 0 if "q0" in named else 1
    columns = tuple(named[word] for part in range(4) if (word := f"q{first + part}") in named)
    if len(columns) < 4 or f"q{first + 4}" in named:
        return ()
    cells = [[row.cells[column].replace(",", ".") for column in columns] for row in rows]
    sums = [sum(float(cell) ** 2 for cell in row if looks_like_a_number(cell)) for row in cells]
    units = [abs(total - 1.0) < _UNIT_NORM for total in sums]
    alike = all(unit or total == 0.0 for unit, total in zip(units, sums, strict=True))
    return columns if alike and (any(units) or first == 0) else ()


def _meanings(
    headers: Sequence[HeaderCell], unused: Collection[int], options: ImportOptions, unclear: Faults
) -> list[Meaning]:
    """Return what each column means, no two the same; what is not understood is `unknown`."""
    meanings: list[Meaning] = []
    for column, header in enumerate(headers):
        meaning = Meaning(Quantity("unknown"))
        with unclear.collected(header.place):
            meaning = _IGNORED if column in unused else _meaning(header, options)
            parts = [(other.quantity, other.axis) for other in meanings]
            if meaning.kind not in _MAY_REPEAT and (meaning.quantity, meaning.axis) in parts:
                reason = f"{shown(header.text)} is a second column for {meaning}"
                raise ImportFileError(header.place, reason, "correct or ignore one of them")
        meanings.append(meaning)
    return meanings


def _meaning(header: HeaderCell, options: ImportOptions) -> Meaning:
    """The meaning of a header, or the one that the caller states, with the unit of the file if it has one."""
    text = grammar.collapsed(header.text)
    if text in map(grammar.collapsed, options.ignore):
        return _IGNORED
    stated = {grammar.collapsed(key): value for key, value in options.columns.items()}.get(text)
    meaning = grammar.meaning_of(header.text if stated is None else stated, options.state_words)
    if stated is None:
        return replace(meaning, guessed=meaning.guessed or header.guessed)
    return meaning if meaning.axis is None else _in_unit_of(text, stated, meaning)


def _in_unit_of(header: str, stated: str, meaning: Meaning) -> Meaning:
    """Return a meaning that the caller states, in the unit of the header if it has one.

    What stands in square brackets is a unit. Any other tail is one only if it is one of this dimension: the t
    of a position `x_t` is no tonne, and the m of `x_m` no metre if the caller states a unit.
    """
    bracketed, dimension = grammar.split_unit(header)[1], DIMENSIONS[meaning.kind]
    tail = bracketed if bracketed is not None else header.replace("_", " ").split(" ")[-1]
    known = grammar.any_unit(tail)
    certain = bracketed is not None and (known is not None or header.endswith("]"))
    measured = header.endswith("_m") and meaning.unit is not None
    if not certain and (measured or known is None or known[0] != dimension):
        return meaning
    ours = grammar.unit_named(tail)
    if ours is None:
        grammar.checked_unit(header, tail, meaning.kind)  # which refuses it
    elif ours[0] != dimension or meaning.unit not in (None, ours[1]):
        reason = f"{shown(header)} is in {spoken(ours[1])}, but {shown(stated)} by `columns`"
        raise ImportFileError(NOWHERE, reason, "correct one of them; a unit is never converted silently")
    return replace(meaning, unit=ours and ours[1], guessed=bracketed is None)


def _gathered(found: list[ImportFileError], headers: Sequence[HeaderCell]) -> list[ImportFileError]:
    """Return faults with one for several headers that are unknown, so that others are not hidden by them."""
    unknown = [fault for fault in found if fault.option == grammar.UNKNOWN]
    if len(unknown) <= _MANY:
        return found
    together = []
    for start in range(0, len(unknown), _TOGETHER):
        group = unknown[start : start + _TOGETHER]
        names = ", ".join(shown(headers[(fault.place.column or 1) - 1].text) for fault in group)
        reason = f"unknown column headers {names}"
        together.append(ImportFileError(group[0].place, reason, group[0].remedy, grammar.UNKNOWN))
    return [*together, *(fault for fault in found if fault.option != grammar.UNKNOWN)]


def _with_states(
    meanings: list[Meaning], headers: Sequence[HeaderCell], notes: list[str], faults: Faults
) -> list[Meaning]:
    """Take two words that all targets have for states if they are 0 and 1, as in `P10 0 x`, else ask."""
    points = {column: one.quantity for column, one in enumerate(meanings) if one.kind in grammar.POINTS}
    if any(quantity.target is None or quantity.state for quantity in points.values()):
        return meanings
    for end in _ENDS:
        parts = {name: end.fullmatch(name) for name in {one.target or "" for one in points.values()}}
        split = {name: (part["target"], part["word"]) for name, part in parts.items() if part}
        targets, named = {target for target, _ in split.values()}, {word for _, word in split.values()}
        if len(named) != 2 or len(split) != len(parts) or len(split) != 2 * len(targets):
            continue
        if named == grammar.DIGITS.keys():
            notes.append("0 and 1 in headers were read as `unloaded` and `loaded`")
            changed = list(meanings)
            for column, (kind, name, _) in points.items():
                target, word = split[name or ""]
                quantity = Quantity(kind, target, grammar.DIGITS[word])
                changed[column] = replace(meanings[column], quantity=quantity, guessed=True)
            return changed
        if not all(word.isdigit() for word in named):
            order = [str(meanings[column]) for column in points]
            first, second = sorted(named, key=lambda word: next(i for i, m in enumerate(order) if word in m))
            faults.report(
                headers[min(points)].place,
                f"{shown(first)} and {shown(second)} in the headers of positions may be states, but are "
                "not known",
                f'name the state of each in `state_words`, such as {{"{first}": "unloaded", '
                f'"{second}": "loaded"}}',
                "state_words",
                (first, second),
            )
            return meanings
    return meanings


def _quantities(
    meanings: Sequence[Meaning], headers: Sequence[HeaderCell], faults: Faults
) -> dict[Quantity, tuple[int, ...]]:
    """Return the columns of each quantity, which has all of its joints or axes, spelt alike."""
    quantities: dict[Quantity, dict[int, int]] = {}
    for index, meaning in enumerate(meanings):
        if meaning.axis is not None:
            quantities.setdefault(meaning.quantity, {})[meaning.axis] = index
    for quantity, axes in quantities.items():
        count = {"joint": max(axes) + 1, "point uncertainty": 1, "along": 1}.get(quantity.kind, 3)
        absent = [axis for axis in range(count) if axis not in axes]
        texts = [headers[column].text for column in axes.values()]
        letters = {axis[0].isupper() for text in texts if (axis := _AXIS.search(text))}
        if quantity.kind in grammar.POINTS and len(letters) > 1:  # one of them may be of another quantity
            reason = f"{' and '.join(map(shown, texts))} are not spelt alike"
            remedy = "write x, y and z alike, or give their meaning in `columns`"
            faults.report(headers[next(iter(axes.values()))].place, reason, remedy, grammar.UNKNOWN)
        if absent or count > MAX_JOINTS:
            first = Meaning(quantity, absent[0] if absent else 0)
            faults.report(
                headers[min(axes.values())].place,
                f"column {first} is missing" if absent else f"there are more than {MAX_JOINTS} joints",
                "add it, or correct the header of the column that holds it",
            )
    return {quantity: tuple(axes[axis] for axis in sorted(axes)) for quantity, axes in quantities.items()}


def _check_keys(
    texts: Mapping[Kind, int],
    quantities: Mapping[Quantity, tuple[int, ...]],
    headers: Sequence[HeaderCell],
    options: ImportOptions,
    faults: Faults,
) -> None:
    """Check that rows have names and numbers, and positions their targets and states in one way."""
    place = headers[0].place._replace(column=None)
    if "name" not in texts and not options.by_order:
        faults.report(
            place,
            "no column names the observations or points",
            "add a column with the header label or name; only if all files have the same rows in the same "
            "order, `by_order`",
            "by_order",
        )
    if not quantities:
        faults.report(place, "no column with numbers is recognised", "check the header")
    points = [quantity for quantity in quantities if quantity.kind in grammar.POINTS]
    for quantity in points:
        if quantity.kind != "along" and quantity.of("position") not in quantities:
            first = headers[quantities[quantity][0]]
            reason = f"{shown(first.text)} belongs to no position"
            faults.report(first.place, reason, "correct its header, or use `ignore`")
    for kind in _NAMED:
        named = {getattr(quantity, kind) is not None for quantity in points}
        if len(named) > 1:
            reason = f"some columns of positions name their {kind}, others do not"
            faults.report(place, reason, f"name the {kind} in all of them")
        if kind in texts and True in named:
            reason = f"there is a column `{kind}`, but the headers of positions name it, too"
            faults.report(headers[texts[kind]].place, reason, "keep one of them")


def _with_units(
    meanings: Sequence[Meaning],
    headers: Sequence[HeaderCell],
    units: ImportUnits | None,
    axes_unit: str | None,
    faults: Faults,
) -> list[Meaning]:
    """The meanings, each number with its unit; one unit for each dimension."""
    resolved = list(meanings)
    bare: dict[Dimension, list[int]] = {}
    for dimension in dict.fromkeys(DIMENSIONS[one.kind] for one in meanings if one.kind in DIMENSIONS):
        of_dimension = Faults(1)  # the others say the same
        first = ""
        for column in [index for index, one in enumerate(meanings) if DIMENSIONS.get(one.kind) == dimension]:
            meaning, place = meanings[column], headers[column].place
            with of_dimension.collected():
                unit = _unit(meaning, units, axes_unit if meaning.kind == "position" else None, place)
                resolved[column] = replace(meaning, unit=unit)
                first = first or unit or ""
                if unit is None:
                    bare.setdefault(dimension, []).append(column)
                elif unit != first:
                    reason = f"{meaning} is in {spoken(unit)}, but other columns are in {spoken(first)}"
                    of_dimension.report(place, reason, f"use one unit for every {dimension}")
        for fault in of_dimension.found:
            faults.add(fault)
    if units is not None and units.length == "m":
        bare.pop("moment", None)  # force times m
    for dimension, columns in bare.items():
        _report_bare(dimension, meanings[columns[0]], headers[columns[0]], len(columns) - 1, faults)
    return resolved


def _unit(meaning: Meaning, given: ImportUnits | None, of_axes: str | None, place: Place) -> str | None:
    """The unit of the header, else of the file's comment, else the caller's."""
    known = None if given is None else getattr(given, DIMENSIONS[meaning.kind])
    sources = {"its header": meaning.unit, "the file's comment": of_axes, "`units`": known}
    given_by = [(where, unit) for where, unit in sources.items() if unit is not None]
    for where, unit in given_by[1:]:
        if unit != given_by[0][1]:
            first = f"{spoken(given_by[0][1])} by {given_by[0][0]}"
            reason = f"{meaning} is in {first}, but in {spoken(unit)} by {where}"
            raise ImportFileError(place, reason, "correct one of them")
    return given_by[0][1] if given_by else None


def _report_bare(
    dimension: Dimension, meaning: Meaning, header: HeaderCell, others: int, faults: Faults
) -> None:
    """Report that a column has no unit, nor others of its dimension."""
    more = f", nor {'has 1 other' if others == 1 else f'have {others} others'}" if others else ""
    example = {"length": "mm", "angle": "deg", "force": "N", "moment": "N.m"}[dimension]
    remedy = f"write it in the header, such as `{header.text or meaning} [{example}]`, or give `units`"
    what = str(meaning)
    if meaning.quantity.target is not None:  # which may be another word
        what = f"{shown(header.text)}, read as {meaning},"
        remedy += f"; if it means something else, give `columns`, such as {header.text}=x"
    faults.report(header.place, f"{what} has no unit{more}", remedy, f"units.{dimension}")
