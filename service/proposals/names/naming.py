"""Names of the positions of a proposal: target, state and load, by headers, rows, files, else by order."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from jointstiff.schemas.imports import ImportOptions, State
from jointstiff.service.importing.grammar import (
    find_any_unit,
    find_state,
    is_likely_unloaded,
    is_negation,
    is_target,
    split_unit_suffix,
)
from jointstiff.service.importing.loads import find_load, find_state_of_load, remove_load, split_force
from jointstiff.service.importing.phrases import split_words
from jointstiff.service.importing.titles import find_states_of_titles
from jointstiff.service.proposals.names.contrasts import (
    NO_CONTRAST,
    Contrast,
    choose_words,
    find_contrasts,
    split_header,
)
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.service.proposals.tables.row_name import RowName
from jointstiff.solver.meaning.proposal import Proposal, TargetReading

_STATES: Final[tuple[State, ...]] = ("unloaded", "loaded", "unloaded_after")
"""States of a target in the order of its positions, if no name says more."""
_NUMBER: Final = re.compile(r"\d{1,9}")
_AXES: Final = frozenset("xyz")


@dataclass(frozen=True)
class Uncertainty:
    """Columns of expanded uncertainties of positions."""

    columns: tuple[int, ...]  # of x, y and z, or the one of the point
    metres: float  # size of the unit [m]


@dataclass(frozen=True)
class NamedReading:
    """Positions of a proposal with the target and the state that they are imported as."""

    reading: TargetReading
    target: str
    state: State
    mass: float | None = None  # of the load [kg]; None if no name states it
    force: str = ""  # size and unit of the force, if there are several; else empty
    is_by_order: bool = False  # whether the order of the positions gives the state, and no name
    contrast: Contrast = NO_CONTRAST  # words that tell it from the other readings of its target
    uncertainty: Uncertainty | None = None

    @property
    def words(self) -> str:
        """Target, state and load in words."""
        load = self.load if self.state == "loaded" else ""
        return f"{self.target} {self.state.replace('_', ' ')} {load}".strip()

    @property
    def load(self) -> str:
        """Load in words, such as `50 kg` or `490 N`; empty if no name states it."""
        return self.force if self.mass is None else f"{self.mass:g} kg"


def name_readings(
    proposal: Proposal, tables: Sequence[NumberTable], options: ImportOptions
) -> list[NamedReading]:
    """Name targets, states and loads: by headers, rows and files, else by the order of the columns.

    Names are used only if no two readings get the same target, state and load.
    """
    table_of_name = {table.name: table for table in tables}
    states = find_states_of_titles([table.title for table in tables], options.state_words)
    contrasts = find_contrasts(proposal.readings, tables, options.state_words)
    by_number = [f"T{reading.target}" for reading in proposal.readings]
    for states_of_titles in (states, None):
        found = [
            _find_names(reading, table_of_name[reading.points.table], options, states_of_titles)
            for reading in proposal.readings
        ]
        found = _add_loads_of_headers(found, proposal.readings, table_of_name, contrasts)
        found = _add_targets_of_headers(found, proposal.readings, table_of_name)
        found = _omit_force_of_load(found)
        targets = _number_states(_name_targets(proposal.readings, found), proposal.readings, options)
        with_states = _add_states_of_words(found, contrasts)
        named = _add_states(proposal.readings, targets, with_states, contrasts)
        if are_distinct(named):
            numbered = _add_states(proposal.readings, by_number, with_states, contrasts)
            are_numbers_better = _lack_states(named) and are_distinct(numbered)
            return numbered if are_numbers_better else named
    without_names = [RowName()] * len(proposal.readings)
    by_words = _add_states_of_words(without_names, contrasts)
    named = _add_states(proposal.readings, by_number, by_words, contrasts)
    if are_distinct(named):
        return named
    return _add_states(proposal.readings, by_number, without_names, contrasts)


def _add_states_of_words(names: Sequence[RowName], contrasts: Sequence[Contrast]) -> list[RowName]:
    """Return names with the states that only the words of headers, files or rows tell."""
    return [
        name._replace(state=contrast.state) if name.state is None else name
        for name, contrast in zip(names, contrasts, strict=True)
    ]


def are_distinct(readings: Sequence[NamedReading]) -> bool:
    """Return whether no two readings have the same target, state and load."""
    return len({(each.target, each.state, each.load) for each in readings}) == len(readings)


def _lack_states(readings: Sequence[NamedReading]) -> bool:
    """Return whether names part the readings at one place, so that a target has only one of two states.

    The import refuses such a target. A place with one state has no other name.
    """
    states_of_target: dict[str, set[State]] = {}
    states_of_place: dict[int, set[State]] = {}
    for each in readings:
        states_of_target.setdefault(each.target, set()).add(each.state)
        states_of_place.setdefault(each.reading.target, set()).add(each.state)
    both: set[State] = {"unloaded", "loaded"}
    return any(
        both <= states_of_place[each.reading.target] and not both <= states_of_target[each.target]
        for each in readings
    )


def _omit_force_of_load(names: Sequence[RowName]) -> list[RowName]:
    """Return names without the one force that the targets under load have, such as `1320 N T1`.

    Targets without load have no force, or none but 0. With several forces, names stay as they are.
    """
    split = [None if name.target is None else split_force(name.target) for name in names]
    forces = {
        (name.state, 0.0 if each is None else each.newtons) for name, each in zip(names, split, strict=True)
    }
    sizes_under_load = {size for state, size in forces if state == "loaded"}
    others = {size for state, size in forces if state != "loaded"}
    if len(sizes_under_load) != 1 or others != {0.0}:
        return list(names)
    return [
        name if each is None else name._replace(target=each.rest or None)
        for name, each in zip(names, split, strict=True)
    ]


def _find_names(
    reading: TargetReading, table: NumberTable, options: ImportOptions, states: Mapping[str, State] | None
) -> RowName:
    """Return what names tell of a reading: headers first, then its row, then the name of its file.

    `states` has title → state of the files; None if the names of files do not count.
    """
    name = _name_by_header(reading, table)
    groups = reading.points.groups
    if groups.order == "in turn" and len(table.turn) == groups.count > 1:
        row = table.turn[reading.index]
        mass = row.mass if name.mass is None else name.mass
        do_rows_differ = len({own.state for own in table.turn}) > 1  # where all have one header
        state = (row.state if do_rows_differ else None) or name.state or row.state
        target = (row.target if _are_targets_in_rows(table) else None) or name.target or row.target
        name = RowName(None, target, state, mass, row.force)
    if name.state is None and states is not None:
        name = _name_by_file(name, table, states)
    if name.state is None and options.state is not None:
        name = name._replace(state=options.state)
    return name


def _add_loads_of_headers(
    names: Sequence[RowName],
    readings: Sequence[TargetReading],
    table_of_name: Mapping[str, NumberTable],
    contrasts: Sequence[Contrast],
) -> list[RowName]:
    """Return names with the loads that headers of any form state, such as `tracker (4,5 kg) X`.

    A load that all headers state alike tells no positions apart. A load does not hang if another word of its
    header means no load, or negates.
    """
    loads = [_find_load_of_headers(reading, table_of_name[reading.points.table]) for reading in readings]
    if len(set(loads)) == 1:
        return list(names)
    named = []
    for name, mass, contrast in zip(names, loads, contrasts, strict=True):
        may_hang = {name.state, contrast.state} <= {None, "loaded"} and not any(
            map(is_negation, contrast.words)
        )
        if mass is not None and name.mass is None and may_hang:
            name = name._replace(state=find_state_of_load(mass), mass=mass)
        named.append(name)
    return named


def _find_load_of_headers(reading: TargetReading, table: NumberTable) -> float | None:
    """Return the mass [kg] that the headers of x, y and z state alike; None without one."""
    loads = {find_load(table.headers[column]) for column in reading.points.columns}
    return loads.pop() if len(loads) == 1 else None


def _add_targets_of_headers(
    names: Sequence[RowName], readings: Sequence[TargetReading], table_of_name: Mapping[str, NumberTable]
) -> list[RowName]:
    """Return names with the targets that headers of any form name, such as `Kugel 1 ohne Last [mm] X`.

    A name are the words that all headers of a target share, but for those of states, units and axes; each
    target has its own. Only readings without any named target get one.
    """
    words_of_target: dict[int, list[list[str]]] = {}
    for reading in readings:
        table = table_of_name[reading.points.table]
        headers = [split_header(table.headers[column]) for column in reading.points.columns]
        words_of_target.setdefault(reading.target, []).extend(headers)
    name_of_target = {target: _join_shared_words(words) for target, words in words_of_target.items()}
    texts = list(name_of_target.values())
    are_names = len(texts) > 1 and len(set(texts)) == len(texts) and all(map(_has_letters, texts))
    if not are_names or any(name.target is not None for name in names):
        return list(names)
    return [
        name._replace(target=name_of_target[reading.target])
        for name, reading in zip(names, readings, strict=True)
    ]


def _join_shared_words(headers: Sequence[Sequence[str]]) -> str:
    """Return the words that all headers share, without those of states, units and axes."""
    shared = [word for word in headers[0] if all(word in other for other in headers)]
    return " ".join(word for word in shared if _may_name_target(word))


def _may_name_target(word: str) -> bool:
    """Return whether a word of a header is no state, unit or axis."""
    is_axis = word.casefold() in _AXES
    return not is_axis and find_state(word, {}) is None and find_any_unit(word) is None


def _has_letters(text: str) -> bool:
    """Return whether a text has a letter."""
    return any(map(str.isalpha, text))


def _are_targets_in_rows(table: NumberTable) -> bool:
    """Return whether the rows of a posture are of several targets, and all positions have one header."""
    in_headers = {
        each.quantity.target for each in table.meanings if each is not None and each.kind == "position"
    }
    return len({row.target for row in table.turn}) > 1 and len(in_headers) == 1


def _name_by_header(reading: TargetReading, table: NumberTable) -> RowName:
    """Return the target, state and load that the headers of x, y and z name alike."""
    meanings = [table.meanings[column] for column in reading.points.columns]
    named = {each.quantity for each in meanings if each is not None and each.kind == "position"}
    are_alike = all(each is not None for each in meanings) and len(named) == 1
    if not are_alike:
        return RowName()
    _, target, state = named.pop()
    if target is None:
        return RowName(None, None, state)
    target = _omit_objects_with_unit(target)
    mass = find_load(target)
    if mass is None:
        return RowName(None, target, state)
    return RowName(None, remove_load(target) or None, state or find_state_of_load(mass), mass)


def _omit_objects_with_unit(target: str) -> str:
    """Return a target without the objects around it that state a unit: `tracker_mm smr` gives `smr`."""
    *objects, last = target.split(" ")
    return " ".join([*(each for each in objects if split_unit_suffix(each) is None), last])


def _name_by_file(name: RowName, table: NumberTable, states: Mapping[str, State]) -> RowName:
    """Return a name with the state and the load that the name of the file or the sheet states."""
    mass = find_load(table.title)
    state = states.get(table.title)
    if mass is None:
        return name._replace(state=state)
    return name._replace(state=state or find_state_of_load(mass), mass=mass)


def _name_targets(readings: Sequence[TargetReading], found: Sequence[RowName]) -> list[str]:
    """Return the target of each reading: its name, else that of another reading at its place, else a number.

    Several names at one place, none with a state, are words for states that are not known. A name that has
    words next to those of another name with a state, as `payload A1` and `A1`, has a word for a state, too.
    """
    found = _omit_words_of_states(readings, found)
    names_of_number: dict[int, set[str]] = {}
    is_state_known: dict[int, bool] = {}
    for reading, name in zip(readings, found, strict=True):
        names = names_of_number.setdefault(reading.target, set())
        names.update([] if name.target is None else [name.target])
        is_state_known[reading.target] = is_state_known.get(reading.target, False) or name.state is not None
    targets = []
    for reading, name in zip(readings, found, strict=True):
        names = names_of_number[reading.target]
        by_place = next(iter(names)) if len(names) == 1 else f"T{reading.target}"
        are_states = len(names) > 1 and not is_state_known[reading.target]
        targets.append(by_place if are_states or name.target is None else name.target)
    return targets


def _number_states(
    targets: Sequence[str], readings: Sequence[TargetReading], options: ImportOptions
) -> list[str]:
    """Return the targets; all have numbers if the import cannot read one of them in a header, such as `L`.

    A word of such a target is a state, or the header means something else, as those of `F` and `sigma` do.
    """
    words = [word for target in targets for word in target.replace("_", " ").split()]
    are_states = any(find_state(word, options.state_words) is not None for word in words)
    are_clear = not are_states and all(map(is_target, targets))
    return list(targets) if are_clear else [f"T{reading.target}" for reading in readings]


def _omit_words_of_states(readings: Sequence[TargetReading], found: Sequence[RowName]) -> list[RowName]:
    """Return names without a state, with the shorter name of a reading at the same place that has one."""
    with_state: dict[int, list[str]] = {}
    for reading, name in zip(readings, found, strict=True):
        if name.state is not None and name.target is not None:
            with_state.setdefault(reading.target, []).append(name.target)
    shortened = []
    for reading, name in zip(readings, found, strict=True):
        words = set(split_words(name.target or ""))
        parts = [target for target in with_state.get(reading.target, ()) if set(split_words(target)) < words]
        is_open = name.state is None and len(set(parts)) == 1
        shortened.append(name._replace(target=parts[0]) if is_open else name)
    return shortened


def _list_complementary(targets: Sequence[str], found: Sequence[RowName]) -> set[str]:
    """Return the targets with exactly one reading of no named state, where names give exactly one state.

    The reading without a named state then has the other state.
    """
    states_of_target: dict[str, list[State | None]] = {}
    for target, name in zip(targets, found, strict=True):
        states_of_target.setdefault(target, []).append(name.state)
    return {
        target
        for target, states in states_of_target.items()
        if states.count(None) == 1 and len({"unloaded", "loaded"}.intersection(states)) == 1
    }


def list_state_words(named: Sequence[NamedReading]) -> tuple[str, ...]:
    """Return the words that distinguish the first two readings of a target, in their order; none without.

    They are words of the names of files, or of headers (`1` and `2` of `X1` and `X2`), or cells of the rows.
    """
    return choose_words([each.contrast for each in named if each.target == named[0].target])


def find_words_against_order(named: Sequence[NamedReading]) -> tuple[str, ...]:
    """Return the words that may state another state than the order of the positions; none without."""
    for each in named:
        if each.is_by_order and each.contrast.states - {each.state}:
            own = [other for other in named if other.target == each.target]
            return list_state_words(own) or each.contrast.words[:1]
    return ()


def find_unknown_words(named: Sequence[NamedReading]) -> tuple[str, ...]:
    """Return the words that alone may say which of two positions of a target is loaded; none without.

    The word that more likely means without load comes first. Words that differ in numbers in the order of the
    positions, such as `X1` and `X2`, say no more than the order.
    """
    for each in named:
        own = [other for other in named if other.target == each.target]
        words = list_state_words(own)
        are_by_order = all(other.is_by_order for other in own)
        if are_by_order and words and not _are_counted([other.contrast.words for other in own]):
            in_order = sorted(own, key=lambda other: other.state != "unloaded")
            words = list_state_words(in_order)
            return words[::-1] if is_likely_unloaded(words[-1]) else words
    return ()


def _are_counted(words: Sequence[Sequence[str]]) -> bool:
    """Return whether the words of two readings are alike but for numbers, which grow."""
    first, second = (" ".join(each) for each in words)
    forms = {_NUMBER.sub("0", each) for each in (first, second)}
    numbers = [[int(number) for number in _NUMBER.findall(each)] for each in (first, second)]
    has_no_letters = not any(map(str.isalpha, first + second))
    return (len(forms) == 1 or has_no_letters) and numbers[0] <= numbers[1]


def _add_states(
    readings: Sequence[TargetReading],
    targets: Sequence[str],
    found: Sequence[RowName],
    contrasts: Sequence[Contrast],
) -> list[NamedReading]:
    """Return the readings with their states: those that names state, and the others in their order.

    A reading with the word 0, which the others of its target do not have, comes first.
    """
    used: dict[str, list[State]] = {}
    for target, name in zip(targets, found, strict=True):
        used.setdefault(target, []).extend([] if name.state is None else [name.state])
    state_of_reading: dict[int, State] = {}
    complementary = _list_complementary(targets, found)
    order = sorted(
        range(len(readings)),
        key=lambda number: ("0" not in contrasts[number].words, readings[number].state),
    )
    for number in order:
        used_states = used[targets[number]]
        free = [state for state in _STATES if state not in used_states]
        next_state: State = free[0] if free else "loaded"
        named_state = found[number].state
        if named_state is None:
            used_states.append(next_state)
        state_of_reading[number] = named_state or next_state
    return [
        NamedReading(
            reading,
            targets[number],
            state_of_reading[number],
            found[number].mass,
            found[number].force,
            is_by_order=found[number].state is None and targets[number] not in complementary,
            contrast=contrasts[number],
        )
        for number, reading in enumerate(readings)
    ]
