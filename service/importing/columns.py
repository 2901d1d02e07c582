"""The columns of a table together: complete, unambiguous, in one unit each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from jointstiff.schemas.importing import ImportOptions, State
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.robot import MAX_JOINTS
from jointstiff.service.importing.errors import Fault, ImportFileError, Place, shown
from jointstiff.service.importing.header import DIMENSIONS, Kind, Meaning, meaning_of
from jointstiff.service.importing.units import Dimension


@dataclass(frozen=True)
class Quantity:
    """Quantity given by several columns: a vector, or all joint angles.

    Attributes:
        kind: of the quantity.
        target: of a position, if the header names it.
        state: of a position, if the header names it.
    """

    kind: Kind
    target: str | None = None
    state: State | None = None


@dataclass(frozen=True)
class Columns:
    """All columns of a table.

    Attributes:
        meanings: one a column, with the unit that holds for it.
        texts: index of the columns that name something, by kind.
        quantities: indices of the columns of each quantity, in order of joints or axes.
        units: by dimension, for all that occur; a moment may have none, then it is force times m.
    """

    meanings: tuple[Meaning, ...]
    texts: Mapping[Kind, int]
    quantities: Mapping[Quantity, tuple[int, ...]]
    units: Mapping[Dimension, str]

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


def understand(
    headers: Sequence[str], options: ImportOptions, place: Place, unused: frozenset[int] = frozenset()
) -> Columns:
    """Understand a header.

    Args:
        headers: one text a column.
        options: units, words for states, columns to leave out.
        place: where the header stands.
        unused: indices of columns that have no header and no cells.

    Raises:
        ImportFileError: a column is not understood, or the columns do not make a table.
    """
    meanings: list[Meaning] = []
    for column, header in enumerate(headers, start=1):
        at = Place(place.file, place.line, column)
        meaning = Meaning("ignored") if column - 1 in unused else _meaning(header, options, at)
        if meaning.kind != "ignored" and _bare(meaning) in map(_bare, meanings):
            raise ImportFileError(
                at, f"{shown(header)} is a second column for {meaning}", "correct or ignore one of them"
            )
        meanings.append(meaning)
    resolved = _with_units(meanings, options.units, place)
    texts = {meaning.kind: index for index, meaning in enumerate(meanings) if meaning.axis is None}
    texts.pop("ignored", None)
    quantities = _quantities(meanings, place)
    _check_keys(texts, quantities, place)
    units = {
        DIMENSIONS[meaning.kind]: meaning.unit
        for meaning in resolved
        if meaning.axis is not None and meaning.unit is not None
    }
    return Columns(tuple(resolved), texts, quantities, units)


def _bare(meaning: Meaning) -> tuple[object, ...]:
    return meaning.kind, meaning.axis, meaning.target, meaning.state


def _meaning(header: str, options: ImportOptions, place: Place) -> Meaning:
    if header.strip() in {text.strip() for text in options.ignore}:
        return Meaning("ignored")
    try:
        return meaning_of(header, options.state_words)
    except Fault as fault:
        raise fault.at(place) from None


def _with_units(meanings: Sequence[Meaning], given: Units | None, place: Place) -> list[Meaning]:
    """The meanings, each number with its unit; one unit for each dimension."""
    seen: dict[Dimension, str] = {}
    resolved = []
    for column, meaning in enumerate(meanings, start=1):
        if meaning.axis is None:
            resolved.append(meaning)
            continue
        at = Place(place.file, place.line, column)
        dimension = DIMENSIONS[meaning.kind]
        unit = _unit(meaning, given, dimension, at)
        if unit is not None and seen.setdefault(dimension, unit) != unit:
            raise ImportFileError(
                at,
                f"{meaning} is in {unit}, but other columns are in {seen[dimension]}",
                f"use one unit for every {dimension}",
            )
        resolved.append(Meaning(meaning.kind, meaning.axis, meaning.target, meaning.state, unit))
    return resolved


def _unit(meaning: Meaning, given: Units | None, dimension: Dimension, place: Place) -> str | None:
    """The unit of the header, else the caller's. A moment may do without if lengths are in m."""
    known = None if given is None else getattr(given, dimension)
    if meaning.unit is not None:
        if known is not None and known != meaning.unit:
            raise ImportFileError(
                place,
                f"{meaning} is in {meaning.unit} by its header, but in {known} by `units`",
                "correct one of them",
            )
        return meaning.unit
    if known is None and not (dimension == "moment" and given is not None and given.length == "m"):
        raise ImportFileError(
            place,
            f"{meaning} has no unit",
            f"write it in the header, such as `{meaning} [{'mm' if dimension == 'length' else '…'}]`, "
            "or give `units`",
        )
    return known


def _quantities(meanings: Sequence[Meaning], place: Place) -> dict[Quantity, tuple[int, ...]]:
    found: dict[Quantity, dict[int, int]] = {}
    for index, meaning in enumerate(meanings):
        if meaning.axis is not None:
            key = Quantity(meaning.kind, meaning.target, meaning.state)
            found.setdefault(key, {})[meaning.axis] = index
    for quantity, axes in found.items():
        count = max(axes) + 1 if quantity.kind == "joint" else 3
        absent = [axis for axis in range(count) if axis not in axes]
        if absent or count > MAX_JOINTS:
            first = Meaning(quantity.kind, absent[0] if absent else 0, quantity.target, quantity.state)
            raise ImportFileError(
                Place(place.file, place.line, min(axes.values()) + 1),
                f"column {first} is missing" if absent else f"there are more than {MAX_JOINTS} joints",
                "add it, or correct the header of the column that holds it",
            )
    return {quantity: tuple(axes[axis] for axis in sorted(axes)) for quantity, axes in found.items()}


def _check_keys(
    texts: Mapping[Kind, int], quantities: Mapping[Quantity, tuple[int, ...]], place: Place
) -> None:
    if "name" not in texts:
        raise ImportFileError(
            place, "no column names the observations or points", "add a column `label` or `name`"
        )
    if not quantities:
        raise ImportFileError(place, "no column with numbers is recognised", "check the header")
    positions = [quantity for quantity in quantities if quantity.kind == "position"]
    if len({quantity.target is None for quantity in positions}) > 1:
        raise ImportFileError(
            place,
            "some columns of positions name their target, others do not",
            "name the target in all of them",
        )
    if len({quantity.state is None for quantity in positions}) > 1:
        raise ImportFileError(
            place,
            "some columns of positions name their state, others do not",
            "name the state in all of them",
        )
    kinds: tuple[Kind, Kind] = ("target", "state")
    for kind in kinds:
        if kind in texts and any(getattr(quantity, kind) is not None for quantity in positions):
            raise ImportFileError(
                Place(place.file, place.line, texts[kind] + 1),
                f"there is a column `{kind}`, but the headers of positions name it, too",
                "keep one of them",
            )
