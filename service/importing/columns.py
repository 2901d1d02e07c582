"""The columns of a table together: complete, unambiguous, in one unit each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from jointstiff.schemas.importing import ImportOptions, State
from jointstiff.schemas.robot import MAX_JOINTS
from jointstiff.service.importing.column_units import HeaderCell, with_units
from jointstiff.service.importing.errors import Fault, Faults, ImportFileError, Place, shown
from jointstiff.service.importing.header import DIMENSIONS, UNKNOWN, Kind, Meaning, meaning_of, split_unit
from jointstiff.service.importing.limits import MAX_COLUMNS
from jointstiff.service.importing.units import FOREIGN, UNITS, Dimension, unit_named

_MANY: Final = 3
"""Unknown headers that are told one by one."""
_TOGETHER: Final = 4
"""Unknown headers in one message, which is cut beyond 300 characters."""


@dataclass(frozen=True)
class Quantity:
    """Quantity given by several columns: a vector, or all joint angles."""

    kind: Kind  # of the quantity
    target: str | None = None  # of a position, if the header names it
    state: State | None = None  # of a position, if the header names it


@dataclass(frozen=True)
class Columns:
    """All columns of a table."""

    meanings: tuple[Meaning, ...]  # one a column, with the unit that holds for it
    texts: Mapping[Kind, int]  # index of the columns that name something, by kind
    # indices of the columns of each quantity, in order of joints or axes
    quantities: Mapping[Quantity, tuple[int, ...]]
    # by dimension, for all that occur; a moment may have none, then it is force times m
    units: Mapping[Dimension, str]
    faulty: bool = False  # whether they do not make a table

    @property
    def needed(self) -> frozenset[str]:
        """Return what of target and state the names of points or files must give."""
        positions = [quantity for quantity in self.quantities if quantity.kind == "position"]
        needed = set()
        if any(quantity.target is None for quantity in positions) and "target" not in self.texts:
            needed.add("target")
        if any(quantity.state is None for quantity in positions) and "state" not in self.texts:
            needed.add("state")
        return frozenset(needed)


def collapsed(text: str) -> str:
    """Return a text with single blanks, and none at its ends."""
    return " ".join(text.split())


def understand(
    headers: Sequence[HeaderCell], options: ImportOptions, axes_unit: str | None, faults: Faults
) -> Columns:
    """Understand a header.

    Args:
        headers: one a column.
        options: units, meanings, words for states, columns to leave out.
        axes_unit: of x, y and z, as a comment of the file says.
        faults: where to tell what is not understood.

    Returns:
        The columns; if they do not make a table, with what is not understood as `unknown`.
    """
    before = len(faults.found)
    meanings: list[Meaning] = []
    unclear = Faults(MAX_COLUMNS)
    for header in headers:
        meaning = Meaning("unknown")
        with unclear.collected():
            meaning = Meaning("ignored") if header.unused else _meaning(header, options)
            if meaning.kind != "ignored" and _bare(meaning) in map(_bare, meanings):
                raise ImportFileError(
                    header.place,
                    f"{shown(header.text)} is a second column for {meaning}",
                    "correct or ignore one of them",
                )
        meanings.append(meaning)
    for fault in _gathered(unclear.found, headers):
        faults.add(fault)
    meanings = _points(meanings)
    resolved = with_units(meanings, headers, options, axes_unit, faults)
    texts = {meaning.kind: index for index, meaning in enumerate(meanings) if meaning.axis is None}
    for kind in ("ignored", "unknown"):
        texts.pop(kind, None)
    quantities: dict[Quantity, tuple[int, ...]] = {}
    if all(meaning.kind != "unknown" for meaning in meanings):
        quantities = _quantities(meanings, headers, faults)
        _check_keys(texts, quantities, headers, options, faults)
    units = {
        DIMENSIONS[meaning.kind]: meaning.unit
        for meaning in resolved
        if meaning.axis is not None and meaning.unit is not None
    }
    return Columns(
        tuple(resolved), texts, quantities, units, faulty=bool(unclear.found) or len(faults.found) > before
    )


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


def _bare(meaning: Meaning) -> tuple[object, ...]:
    return meaning.kind, meaning.axis, meaning.target, meaning.state


def _points(meanings: list[Meaning]) -> list[Meaning]:
    """Return the meanings; a target of a group, in a table without names, is what others call a point."""
    kinds = {meaning.kind for meaning in meanings}
    if "name" in kinds or not kinds & {"collection", "group"}:
        return meanings
    return [Meaning("name") if meaning.kind == "target" else meaning for meaning in meanings]


def _meaning(header: HeaderCell, options: ImportOptions) -> Meaning:
    text = collapsed(header.text)
    if text in map(collapsed, options.ignore):
        return Meaning("ignored")
    stated = {collapsed(key): value for key, value in options.columns.items()}.get(text)
    try:
        if stated is None:
            found = meaning_of(header.text, options.state_words)
            return replace(found, guessed=found.guessed or header.guessed)
        return _stated(text, stated, options)
    except Fault as fault:
        raise fault.at(header.place) from None


def _stated(header: str, stated: str, options: ImportOptions) -> Meaning:
    """The meaning that the caller states, with the unit of the file if it has one.

    Raises:
        Fault: they contradict.
    """
    found = meaning_of(stated, options.state_words)
    if found.axis is None:
        return found
    text = split_unit(header)[1] or header.replace("_", " ").split(" ")[-1]
    named, dimension = unit_named(text), DIMENSIONS[found.kind]
    if named is None:
        if text in FOREIGN:
            raise Fault(
                f"{shown(header)}: {shown(text)} is not a known unit of {dimension}",
                f"convert to one of {', '.join(UNITS[dimension])}",
            )
        return found
    if named[0] != dimension or (found.unit is not None and found.unit != named[1]):
        raise Fault(
            f"{shown(header)} is in {named[1]}, but {shown(stated)} by `columns`",
            "correct one of them; a unit is never converted silently",
        )
    return replace(found, unit=named[1])


def _quantities(
    meanings: Sequence[Meaning], headers: Sequence[HeaderCell], faults: Faults
) -> dict[Quantity, tuple[int, ...]]:
    found: dict[Quantity, dict[int, int]] = {}
    for index, meaning in enumerate(meanings):
        if meaning.axis is not None:
            key = Quantity(meaning.kind, meaning.target, meaning.state)
            found.setdefault(key, {})[meaning.axis] = index
    for quantity, axes in found.items():
        count = {"joint": max(axes) + 1, "uncertainty": 1}.get(quantity.kind, 3)
        absent = [axis for axis in range(count) if axis not in axes]
        if absent or count > MAX_JOINTS:
            first = Meaning(quantity.kind, absent[0] if absent else 0, quantity.target, quantity.state)
            fault = ImportFileError(
                headers[min(axes.values())].place,
                f"column {first} is missing" if absent else f"there are more than {MAX_JOINTS} joints",
                "add it, or correct the header of the column that holds it",
            )
            faults.add(fault)
    return {quantity: tuple(axes[axis] for axis in sorted(axes)) for quantity, axes in found.items()}


def _check_keys(
    texts: Mapping[Kind, int],
    quantities: Mapping[Quantity, tuple[int, ...]],
    headers: Sequence[HeaderCell],
    options: ImportOptions,
    faults: Faults,
) -> None:
    place = replace(headers[0].place, column=None)

    def add(reason: str, remedy: str, at: Place = place, option: str | None = None) -> None:
        faults.add(ImportFileError(at, reason, remedy, option))

    if "name" not in texts and not options.by_order:
        add(
            "no column names the observations or points",
            "add a column `label` or `name`; only if the rows of all files are in the same order, `by_order`",
            option="by_order",
        )
    if not quantities:
        add("no column with numbers is recognised", "check the header")
    points = [quantity for quantity in quantities if quantity.kind in ("position", "uncertainty")]
    kinds: tuple[Literal["target", "state"], ...] = ("target", "state")
    for kind in kinds:
        if len({getattr(quantity, kind) is None for quantity in points}) > 1:
            add(
                f"some columns of positions name their {kind}, others do not",
                f"name the {kind} in all of them",
            )
        if kind in texts and any(getattr(quantity, kind) is not None for quantity in points):
            add(
                f"there is a column `{kind}`, but the headers of positions name it, too",
                "keep one of them",
                headers[texts[kind]].place,
            )
    _check_uncertainties(points, quantities, headers, faults)


def _check_uncertainties(
    points: Sequence[Quantity],
    quantities: Mapping[Quantity, tuple[int, ...]],
    headers: Sequence[HeaderCell],
    faults: Faults,
) -> None:
    """Check that every uncertainty belongs to a position."""
    positions = [replace(quantity, kind="uncertainty") for quantity in points if quantity.kind == "position"]
    for quantity in points:
        if quantity.kind == "uncertainty" and quantity not in positions:
            column = headers[quantities[quantity][0]]
            reason = f"{shown(column.text)} belongs to no position"
            faults.add(ImportFileError(column.place, reason, "correct its header, or use `ignore`"))
