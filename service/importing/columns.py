"""The columns of a table together: complete, unambiguous, in one unit each."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from jointstiff.schemas.importing import ImportOptions, ImportUnits
from jointstiff.schemas.robot import MAX_JOINTS
from jointstiff.service.importing import words
from jointstiff.service.importing.errors import Fault, Faults, ImportFileError, Place, shown
from jointstiff.service.importing.grid import Row
from jointstiff.service.importing.header import (
    DIMENSIONS,
    POINTS,
    UNKNOWN,
    Meaning,
    Quantity,
    checked_unit,
    collapsed,
    folded,
    meaning_of,
    names_a_state,
    split_unit,
)  # fmt: skip
from jointstiff.service.importing.limits import MAX_COLUMNS
from jointstiff.service.importing.numbers import looks_like_a_number
from jointstiff.service.importing.words import SPOKEN, Dimension, Kind, any_unit, unit_named

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
        return frozenset(
            kind
            for kind in _NAMED
            if kind not in self.texts and any(getattr(quantity, kind) is None for quantity in positions)
        )


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
    bare = (column for column, header in enumerate(headers) if not header.text)
    unused = {*rotation, *(column for column in bare if not any(row.cells[column] for row in rows))}
    meanings = _meanings(headers, unused, options, unclear)
    for fault in _gathered(unclear.found, headers):
        faults.add(fault)
    kinds = {meaning.kind for meaning in meanings}
    if rotation:
        first, *_, last = (headers[column].text for column in rotation)
        notes.append(f"{first} to {last} were ignored as the rotation of a probe")
    if "name" not in kinds and kinds & {"collection", "group"}:  # a target of a group is a point
        meanings = [Meaning("name") if meaning.kind == "target" else meaning for meaning in meanings]
    names = [column for column, meaning in enumerate(meanings) if meaning.kind in _NAMES]
    cells = (row.cells[column] for row in rows for column in names)
    by_template = "{state}" in f"{options.point_name} {options.file_name}"
    by_name = state_in_name or any(names_a_state(cell, options.state_words) for cell in cells)
    if not ("state" in kinds or by_template or by_name):  # nothing else says the state
        meanings = _with_states(meanings, headers, notes, faults)
    resolved = _with_units(meanings, headers, options, axes_unit, faults)
    texts: dict[Kind, int] = {}
    for index, meaning in enumerate(meanings):
        if meaning.axis is None and meaning.kind not in ("ignored", "unknown"):
            texts.setdefault(meaning.kind, index)
    quantities: dict[Quantity, tuple[int, ...]] = {}
    if "unknown" not in kinds:
        quantities = _quantities(meanings, headers, faults)
        _check_keys(texts, quantities, headers, options, faults)
    units = {
        DIMENSIONS[meaning.kind]: meaning.unit
        for meaning in resolved
        if meaning.axis is not None and meaning.unit is not None
    }
    return Columns(
        tuple(resolved),
        texts,
        quantities,
        units,
        tuple(notes),
        probe=bool(rotation) or bool(kinds & {"deleted", "uncertainty"}),
        faulty=bool(unclear.found) or len(faults.found) > before,
    )


def _meanings(
    headers: Sequence[HeaderCell], unused: Collection[int], options: ImportOptions, unclear: Faults
) -> list[Meaning]:
    """Return what each column means, no two the same; what is not understood is `unknown`."""
    meanings: list[Meaning] = []
    for column, header in enumerate(headers):
        meaning = Meaning("unknown")
        with unclear.collected():
            meaning = Meaning("ignored") if column in unused else _meaning(header, options)
            if meaning.kind not in _MAY_REPEAT and meaning.part in [other.part for other in meanings]:
                raise ImportFileError(
                    header.place,
                    f"{shown(header.text)} is a second column for {meaning}",
                    "correct or ignore one of them",
                )
        meanings.append(meaning)
    return meanings


def _rotation(headers: Sequence[HeaderCell], rows: Sequence[Row], options: ImportOptions) -> tuple[int, ...]:
    """Return the columns of a quaternion, Q0 to Q3 or Q1 to Q4: no angles of joints.

    Their squares add up to 1 in each row, or they are empty or 0. Angles have a unit, or the caller states
    what they are; Q0 is no joint, and where Q1 to Q4 are 0 in all rows, they may be joints.
    """
    headers_given = {collapsed(text) for text in options.columns}
    named = {
        folded(header.text): column
        for column, header in enumerate(headers)
        if collapsed(header.text) not in headers_given and split_unit(header.text)[1] is None
    }
    first = 0 if "q0" in named else 1
    columns_of_rotation = tuple(
        named[word] for word in (f"q{first + part}" for part in range(4)) if word in named
    )
    if len(columns_of_rotation) < 4 or f"q{first + 4}" in named:
        return ()
    cells = [[row.cells[column].replace(",", ".") for column in columns_of_rotation] for row in rows]
    sums = [sum(float(cell) ** 2 for cell in row if looks_like_a_number(cell)) for row in cells]
    units = [abs(total - 1.0) < _UNIT_NORM for total in sums]
    alike = all(unit or total == 0.0 for unit, total in zip(units, sums, strict=True))
    return columns_of_rotation if alike and (any(units) or first == 0) else ()


def _gathered(found: list[ImportFileError], headers: Sequence[HeaderCell]) -> list[ImportFileError]:
    """Return faults with one for several headers that are unknown, so that others are not hidden by them."""
    unknown = [fault for fault in found if fault.option == UNKNOWN]
    if len(unknown) <= _MANY:
        return found
    together = []
    for start in range(0, len(unknown), _TOGETHER):
        first, *others = unknown[start : start + _TOGETHER]
        names = ", ".join(shown(headers[(fault.place.column or 1) - 1].text) for fault in (first, *others))
        together.append(
            ImportFileError(first.place, f"unknown column headers {names}", first.remedy, UNKNOWN)
        )
    return [*together, *(fault for fault in found if fault.option != UNKNOWN)]


def _meaning(header: HeaderCell, options: ImportOptions) -> Meaning:
    """The meaning of a header, or the one that the caller states, with the unit of the file if it has one."""
    text = collapsed(header.text)
    if text in map(collapsed, options.ignore):
        return Meaning("ignored")
    stated = {collapsed(key): value for key, value in options.columns.items()}.get(text)
    try:
        meaning = meaning_of(header.text if stated is None else stated, options.state_words)
        if stated is None:
            return replace(meaning, guessed=meaning.guessed or header.guessed)
        return meaning if meaning.axis is None else _in_unit_of(text, stated, meaning)
    except Fault as fault:
        raise fault.at(header.place) from None


def _in_unit_of(header: str, stated: str, meaning: Meaning) -> Meaning:
    """Return a meaning that the caller states, in the unit of the header if it has one.

    What stands in square brackets is a unit. Any other tail is one only if it is one of this dimension: the t
    of a position `x_t` is no tonne, and the m of `x_m` no metre if the caller states a unit.
    """
    bracketed, dimension = split_unit(header)[1], DIMENSIONS[meaning.kind]
    tail = bracketed if bracketed is not None else header.replace("_", " ").split(" ")[-1]
    known = any_unit(tail)
    certain = bracketed is not None and (known is not None or header.endswith("]"))
    measured = header.endswith("_m") and meaning.unit is not None
    if not certain and (measured or known is None or known[0] != dimension):
        return meaning
    ours = unit_named(tail)
    if ours is None:
        checked_unit(header, tail, meaning.kind)  # which refuses it
    elif ours[0] != dimension or meaning.unit not in (None, ours[1]):
        raise Fault(
            f"{shown(header)} is in {spoken(ours[1])}, but {shown(stated)} by `columns`",
            "correct one of them; a unit is never converted silently",
        )
    return replace(meaning, unit=ours and ours[1], guessed=bracketed is None)


def _with_states(
    meanings: list[Meaning], headers: Sequence[HeaderCell], notes: list[str], faults: Faults
) -> list[Meaning]:
    """Take two words that all targets have for states if they are 0 and 1, as in `P10 0 x`, else ask."""
    points = [(column, meaning) for column, meaning in enumerate(meanings) if meaning.kind in POINTS]
    if any(meaning.target is None or meaning.state for _, meaning in points):
        return meanings
    for end in _ENDS:
        parts = {name: end.fullmatch(name) for name in {meaning.target or "" for _, meaning in points}}
        split = {name: (part["target"], part["word"]) for name, part in parts.items() if part}
        targets, named = {target for target, _ in split.values()}, {word for _, word in split.values()}
        if len(named) != 2 or len(split) != len(parts) or len(split) != 2 * len(targets):
            continue
        if named == words.DIGITS.keys():
            notes.append("0 and 1 in headers were read as `unloaded` and `loaded`")
            changed = list(meanings)
            for column, meaning in points:
                target, word = split[meaning.target or ""]
                changed[column] = replace(meaning, target=target, state=words.DIGITS[word], guessed=True)
            return changed
        if not all(word.isdigit() for word in named):
            first, second = sorted(named, key=lambda word: next(c for c, m in points if word in str(m)))
            faults.report(
                headers[points[0][0]].place,
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
    quantities: dict[Quantity, dict[int, int]] = {}
    for index, meaning in enumerate(meanings):
        if meaning.axis is not None:
            quantities.setdefault(meaning.quantity, {})[meaning.axis] = index
    for quantity, axes in quantities.items():
        count = {"joint": max(axes) + 1, "point uncertainty": 1, "along": 1}.get(quantity.kind, 3)
        absent = [axis for axis in range(count) if axis not in axes]
        _check_spelling(quantity, [headers[column] for column in axes.values()], faults)
        if absent or count > MAX_JOINTS:
            first = Meaning(quantity.kind, absent[0] if absent else 0, quantity.target, quantity.state)
            faults.report(
                headers[min(axes.values())].place,
                f"column {first} is missing" if absent else f"there are more than {MAX_JOINTS} joints",
                "add it, or correct the header of the column that holds it",
            )
    return {quantity: tuple(axes[axis] for axis in sorted(axes)) for quantity, axes in quantities.items()}


def _check_spelling(quantity: Quantity, headers: Sequence[HeaderCell], faults: Faults) -> None:
    """Refuse x, y and z of one quantity in capital and small letters: one may be of another quantity."""
    letters = [axis[0] for header in headers if (axis := _AXIS.search(header.text))]
    if quantity.kind in POINTS and len({letter.isupper() for letter in letters}) > 1:
        reason = f"{' and '.join(map(shown, (header.text for header in headers)))} are not spelt alike"
        faults.report(
            headers[0].place, reason, "write x, y and z alike, or give their meaning in `columns`", UNKNOWN
        )


def _check_keys(
    texts: Mapping[Kind, int],
    quantities: Mapping[Quantity, tuple[int, ...]],
    headers: Sequence[HeaderCell],
    options: ImportOptions,
    faults: Faults,
) -> None:
    """Check that rows have names and numbers, and positions their targets and states in one way."""
    place = replace(headers[0].place, column=None)
    if "name" not in texts and not options.by_order:
        reason = "no column names the observations or points"
        remedy = (
            "add a column with the header label or name; only if all files have the same rows in the same "
            "order, `by_order`"
        )
        faults.report(place, reason, remedy, "by_order")
    if not quantities:
        faults.report(place, "no column with numbers is recognised", "check the header")
    points = [quantity for quantity in quantities if quantity.kind in POINTS]
    for quantity in points:
        if quantity.kind != "along" and replace(quantity, kind="position") not in quantities:
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
    options: ImportOptions,
    axes_unit: str | None,
    faults: Faults,
) -> list[Meaning]:
    """The meanings, each number with its unit; one unit for each dimension."""
    seen: dict[Dimension, str] = {}
    bare: dict[Dimension, list[int]] = {}
    resolved = list(meanings)
    for dimension in dict.fromkeys(DIMENSIONS[m.kind] for m in meanings if m.kind in DIMENSIONS):
        of_dimension = Faults(1)  # the others say the same
        for column in [index for index, m in enumerate(meanings) if DIMENSIONS.get(m.kind) == dimension]:
            meaning, place = meanings[column], headers[column].place
            with of_dimension.collected():
                unit = _unit(meaning, options.units, axes_unit if meaning.kind == "position" else None, place)
                resolved[column] = replace(meaning, unit=unit)
                if unit is None:
                    bare.setdefault(dimension, []).append(column)
                elif unit != seen.setdefault(dimension, unit):
                    others = spoken(seen[dimension])
                    reason = f"{meaning} is in {spoken(unit)}, but other columns are in {others}"
                    of_dimension.report(place, reason, f"use one unit for every {dimension}")
        for fault in of_dimension.found:
            faults.add(fault)
    if options.units is not None and options.units.length == "m":
        bare.pop("moment", None)  # force times m
    for columns in bare.values():
        _report_bare([(meanings[column], headers[column]) for column in columns], faults)
    return resolved


def _report_bare(bare: Sequence[tuple[Meaning, HeaderCell]], faults: Faults) -> None:
    """Report columns of one dimension that have no unit."""
    (meaning, header), count = bare[0], len(bare) - 1
    more = f", nor {'has 1 other' if count == 1 else f'have {count} others'}" if count else ""
    dimension = DIMENSIONS[meaning.kind]
    example = {"length": "mm", "angle": "deg", "force": "N", "moment": "N.m"}[dimension]
    remedy = f"write it in the header, such as `{header.text or meaning} [{example}]`, or give `units`"
    what = str(meaning)
    if meaning.target is not None:  # which may be another word
        what = f"{shown(header.text)}, read as {meaning},"
        remedy += f"; if it means something else, give `columns`, such as {header.text}=x"
    faults.report(header.place, f"{what} has no unit{more}", remedy, f"units.{dimension}")


def _unit(meaning: Meaning, given: ImportUnits | None, of_axes: str | None, place: Place) -> str | None:
    """The unit of the header, else of the file's comment, else the caller's."""
    known = None if given is None else getattr(given, DIMENSIONS[meaning.kind])
    sources = {"its header": meaning.unit, "the file's comment": of_axes, "`units`": known}
    given_by = [(where, unit) for where, unit in sources.items() if unit is not None]
    for where, unit in given_by[1:]:
        if unit != given_by[0][1]:
            first = f"{spoken(given_by[0][1])} by {given_by[0][0]}"
            raise ImportFileError(
                place, f"{meaning} is in {first}, but in {spoken(unit)} by {where}", "correct one of them"
            )
    return given_by[0][1] if given_by else None


def spoken(unit: str) -> str:
    """Return a unit as it reads in a sentence."""
    return SPOKEN.get(unit, unit)
