"""Sheets of a workbook that an import reads: those with numbers, if their names tell them apart."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from jointstiff.schemas.imports import State
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grammar import find_state, join_states
from jointstiff.service.importing.grid import LEAST_NUMBERS, Grid, count_numbers
from jointstiff.service.importing.loads import find_load, find_state_of_load, remove_load
from jointstiff.service.importing.phrases import split_words


def split_sheets(sheets: str | None) -> list[str | None]:
    """Return the names of sheets that an option states, with semicolons between; [None] without it."""
    return [name.strip() for name in sheets.split(";")] if sheets else [None]


def refuse_unknown_sheets(file: str, stated: str | None, known: Collection[str], lack: str) -> None:
    """Refuse names of sheets that a file does not have.

    Args:
        file: name of the file, for messages.
        stated: names, with semicolons between; None for all sheets.
        known: names of the sheets that the file has.
        lack: words for a missing sheet, such as `the workbook has no sheet`.

    Raises:
        ImportFileError: the file has no sheet of a name.
    """
    for name in split_sheets(stated):
        if name is not None and name not in known:
            reason = f"{lack} {quote(name)}"
            remedy = f"give one of {quote(', '.join(known))} as `sheet`"
            raise ImportFileError(Place(file), reason, remedy, "sheet", tuple(known))


def list_tables(sheets: Sequence[Grid]) -> list[Grid]:
    """Return the sheets of a workbook that have rows of data; all sheets if none has."""
    return [sheet for sheet in sheets if _has_data(sheet)] or list(sheets)


def choose_sheets(tables: Sequence[Grid], words: Mapping[str, State]) -> list[Grid]:
    """Return the only sheet with rows of data, or several whose names tell states.

    `words` are the caller's words for states.

    Raises:
        ImportFileError: several sheets have data, and their names tell no states.
    """
    names = [_name(table) for table in tables]
    if len(tables) > 1 and not _are_states(names, words):
        raise build_sheet_error(tables[0].file, names)
    return list(tables)


def note_others(chosen: Sequence[Grid], others: Sequence[Grid]) -> list[Grid]:
    """Return the sheets that are read, the first with a note on the sheets that are not read."""
    if not others:
        return list(chosen)
    listed = ", ".join(quote(_name(sheet)) for sheet in others)
    is_document = others[0].preview.format == "text"
    kind, lack = ("table", "rows of numbers") if is_document else ("sheet", "table")
    note = f"the {kind} {listed} has no {lack}, and was not read"
    if len(others) > 1:
        note = f"the {kind}s {listed} have no {lack}, and were not read"
    first, *further = chosen
    assumptions = [note, *first.preview.assumptions]
    noted = replace(first, preview=first.preview.model_copy(update={"assumptions": assumptions}))
    return [noted, *further]


def build_sheet_error(file: str, names: Sequence[str]) -> ImportFileError:
    """Return the error that several sheets of a workbook have data."""
    reason = f"several sheets have data: {quote(', '.join(names))}"
    remedy = "give `sheet`; separate several names by semicolons"
    return ImportFileError(Place(file), reason, remedy, "sheet", tuple(names))


def _name(sheet: Grid) -> str:
    """Return the name of a sheet."""
    return sheet.preview.sheet or ""


def _has_data(sheet: Grid) -> bool:
    """Return whether a sheet has a row of data: an information has single numbers."""
    return any(count_numbers(row) >= LEAST_NUMBERS for row in sheet.rows)


class _NamedState(NamedTuple):
    """State that the name of a sheet tells."""

    state: State
    mass: float | None  # of the load [kg]
    rest: tuple[str, ...]  # other words of the name, such as a target


def _are_states(names: Sequence[str], words: Mapping[str, State]) -> bool:
    """Return whether each name tells another state or target, and some tell a load and others none."""
    found = [_read_state(name, words) for name in names]
    states = {each.state for each in found if each is not None}
    return None not in found and len(set(found)) == len(found) and {"unloaded", "loaded"} <= states


def _read_state(name: str, words: Mapping[str, State]) -> _NamedState | None:
    """Return the only state that a name tells; None for a name with no state, or with several."""
    mass = find_load(name)
    own_words = split_words(remove_load(name))
    rest = tuple(word.casefold() for word in own_words if find_state(word, words) is None)
    state = join_states(own_words, words)
    has_words = len(rest) < len(own_words)
    if mass is not None:
        of_load = find_state_of_load(mass)
        state = of_load if state == of_load or not has_words else None
    return None if state is None else _NamedState(state, mass, rest)
