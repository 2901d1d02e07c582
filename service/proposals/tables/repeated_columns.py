"""Repeated readings in columns of their own, such as `Reading 1` and `Reading 2` below a state."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.imports import State
from jointstiff.service.importing.grammar import Meaning, Quantity
from jointstiff.service.importing.loads import find_load, remove_load
from jointstiff.service.proposals.tables.lengths import MOST_REPEAT, find_size, guess_unit
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.table import METRES

_NUMBER: Final = re.compile(r"(?<!\d)\d{1,2}(?!\d)")
_LARGEST_PART: Final = 0.25
"""Distance of repeats from their mean, as a part of the deflection, at most: steps of a load are farther."""

Triple = tuple[int, int, int]
"""Columns of x, y and z."""


class _Repeated(NamedTuple):
    """Target, state and load that headers of repeated readings have in common."""

    words: str  # name of the target without the number of the repeat
    state: State
    mass: float | None  # of the load [kg]; None if no header states it


def average_repeats(tables: Sequence[NumberTable]) -> tuple[list[NumberTable], list[str]]:
    """Return tables with the mean of repeated readings that have columns of their own, and notes.

    Headers name the states of repeats, which differ by a number only. Repeats are nearer to each other than
    two targets, or two loads, can be.
    """
    averaged, notes = list[NumberTable](), list[str]()
    for table in tables:
        triples_of = _group_repeats(table)
        if triples_of and _are_near(table, triples_of):
            averaged.append(_average(table, triples_of))
            listed = " and ".join(
                f"{len(triples)} repeats of {' '.join(filter(None, (key.words, key.state)))}"
                for key, triples in triples_of.items()
            )
            notes.append(f"{table.name}: the mean of {listed} is read")
        else:
            averaged.append(table)
    return averaged, notes


def _group_repeats(table: NumberTable) -> Mapping[_Repeated, Sequence[Triple]]:
    """Return the columns of repeats, by what their headers have in common; empty if a position is no repeat.

    Each target has repeats in two states.
    """
    triples_of: dict[_Repeated, list[Triple]] = {}
    numbers_of: dict[_Repeated, list[str]] = {}
    for triple in table.table.points:
        meaning = table.meanings[triple[0]]
        if meaning is None or meaning.quantity.state is None:
            return {}
        _, target, state = meaning.quantity
        name = remove_load(target or "")
        number = _NUMBER.search(name)
        if number is None or state not in ("unloaded", "loaded"):
            return {}
        words = " ".join(f"{name[: number.start()]} {name[number.end() :]}".split())
        key = _Repeated(words, state, find_load(target or ""))
        triples_of.setdefault(key, []).append(triple)
        numbers_of.setdefault(key, []).append(number[0])
    are_repeated = all(len(triples) > 1 for triples in triples_of.values())
    are_numbered = all(len(set(numbers)) == len(numbers) for numbers in numbers_of.values())
    states_of_words: dict[str, list[State]] = {}
    for key in triples_of:
        states_of_words.setdefault(key.words, []).append(key.state)
    have_states = all(sorted(states) == ["loaded", "unloaded"] for states in states_of_words.values())
    return triples_of if are_repeated and are_numbered and have_states else {}


def _are_near(table: NumberTable, triples_of: Mapping[_Repeated, Sequence[Triple]]) -> bool:
    """Return whether repeats are as near their means as noise lets them be, also next to the deflections."""
    metres = _find_metres(table, next(iter(triples_of.values()))[0])
    means = {key: metres * _compute_mean(table, triples) for key, triples in triples_of.items()}
    distances = np.array(
        [
            np.abs(metres * table.table.numbers[:, list(triple)] - means[key])
            for key, triples in triples_of.items()
            for triple in triples
        ]
    )
    if not np.isfinite(distances).any() or np.nanmax(distances) > MOST_REPEAT:
        return False
    shifts = [
        mean - means[other]
        for key, mean in means.items()
        for other in means
        if key.state == "loaded" and other.state == "unloaded" and other.words == key.words
    ]
    deflection = float(np.nanmedian(np.linalg.norm(shifts, axis=-1)))
    return float(np.nanmedian(np.linalg.norm(distances, axis=-1))) <= _LARGEST_PART * deflection


def _find_metres(table: NumberTable, triple: Triple) -> float:
    """Return the size [m] of the unit of positions: that of their header, else by their numbers."""
    meaning = table.meanings[triple[0]]
    stated = None if meaning is None else meaning.unit
    guessed = METRES[guess_unit(find_size(table, triple))]
    return next((size for unit, size in METRES.items() if unit == stated), guessed)


def _compute_mean(table: NumberTable, triples: Sequence[Triple]) -> FloatArray:
    """Return the means (N, 3) of repeated positions; NaN where no repeat has a number."""
    readings = [table.table.numbers[:, list(triple)] for triple in triples]
    return np.asarray(np.ma.masked_invalid(readings).mean(axis=0).filled(np.nan))


def _average(table: NumberTable, triples_of: Mapping[_Repeated, Sequence[Triple]]) -> NumberTable:
    """Return a table with the means in the columns of the first repeats, without the other repeats."""
    meanings, means, left = list(table.meanings), dict[int, FloatArray](), set[int]()
    words = {key.words for key in triples_of}
    for key, triples in triples_of.items():
        mean = _compute_mean(table, triples)
        load = "" if key.mass is None else f"{key.mass:g} kg"
        target = " ".join(filter(None, (key.words if len(words) > 1 else "", load))) or None
        for axis, column in enumerate(triples[0]):
            meaning = meanings[column]
            unit = None if meaning is None else meaning.unit
            meanings[column] = Meaning(Quantity("position", target, key.state), axis, unit)
            means[column] = mean[:, axis]
        for triple in triples[1:]:
            left.update(triple)
    for column in left:
        meanings[column] = None
    averaged = table.replace_numbers(means)
    points = tuple(triples[0] for triples in triples_of.values())
    numbers = replace(averaged.table, points=points, others=averaged.table.others | left)
    return replace(averaged, meanings=tuple(meanings), table=numbers, ignored=table.ignored | left)
