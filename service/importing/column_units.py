"""Units of columns: of the header, of the file's comments, of the caller; they must agree."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from jointstiff.schemas.importing import ImportOptions, ImportUnits
from jointstiff.service.importing.errors import Faults, ImportFileError, Place
from jointstiff.service.importing.header import DIMENSIONS, Meaning
from jointstiff.service.importing.units import Dimension


@dataclass(frozen=True, slots=True)
class HeaderCell:
    """The header of one column."""

    text: str  # as it stands in the file, of several rows put together
    place: Place  # where it stands
    guessed: bool = False  # whether it was put together or assumed
    unused: bool = False  # whether the column has no header and no cells


def with_units(
    meanings: Sequence[Meaning],
    headers: Sequence[HeaderCell],
    options: ImportOptions,
    axes_unit: str | None,
    faults: Faults,
) -> list[Meaning]:
    """The meanings, each number with its unit; one unit for each dimension."""
    seen: dict[Dimension, str] = {}
    bare: dict[Dimension, list[int]] = {}
    contradicted: set[Dimension] = set()
    resolved = []
    for column, meaning in enumerate(meanings):
        if meaning.axis is None:
            resolved.append(meaning)
            continue
        dimension = DIMENSIONS[meaning.kind]
        unit = None
        told = len(faults.found)
        with faults.collected() if dimension not in contradicted else suppress(ImportFileError):
            of_axes = axes_unit if meaning.kind == "position" else None
            unit = _unit(meaning, options.units, of_axes, headers[column].place)
            if unit is None and not _may_lack(dimension, options.units):
                bare.setdefault(dimension, []).append(column)
            if unit is not None and seen.setdefault(dimension, unit) != unit:
                raise ImportFileError(
                    headers[column].place,
                    f"{meaning} is in {unit}, but other columns are in {seen[dimension]}",
                    f"use one unit for every {dimension}",
                )
        if len(faults.found) > told:
            contradicted.add(dimension)
        resolved.append(replace(meaning, unit=unit))
    for dimension, columns in bare.items():
        meaning, others = meanings[columns[0]], len(columns) - 1
        more = f", nor {'has 1 other' if others == 1 else f'have {others} others'}" if others else ""
        example = {"length": "mm", "angle": "deg", "force": "N", "moment": "N.m"}[dimension]
        fault = ImportFileError(
            headers[columns[0]].place,
            f"{meaning} has no unit{more}",
            f"write it in the header, such as `{meaning} [{example}]`, or give `units`",
            f"units.{dimension}",
        )
        faults.add(fault)
    return resolved


def _may_lack(dimension: Dimension, given: ImportUnits | None) -> bool:
    """Return whether numbers of a dimension need no unit: a moment's is force times m if lengths are in m."""
    return dimension == "moment" and given is not None and given.length == "m"


def _unit(meaning: Meaning, given: ImportUnits | None, of_axes: str | None, place: Place) -> str | None:
    """The unit of the header, else of the file's comment, else the caller's.

    Raises:
        ImportFileError: they contradict.
    """
    known = None if given is None else getattr(given, DIMENSIONS[meaning.kind])
    said = {"its header": meaning.unit, "the file's comment": of_axes, "`units`": known}
    given_by = [(where, unit) for where, unit in said.items() if unit is not None]
    for where, unit in given_by[1:]:
        if unit != given_by[0][1]:
            raise ImportFileError(
                place,
                f"{meaning} is in {given_by[0][1]} by {given_by[0][0]}, but in {unit} by {where}",
                "correct one of them",
            )
    return given_by[0][1] if given_by else None
