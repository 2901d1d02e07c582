"""Ways in which the rows of tables may belong to postures, by the pattern of words alone; the robot judges.

A structure states no meaning: `label` is a column whose words tell the postures apart, `keys` are columns
with few words that tell the rows of a posture apart. No word is looked up in any list.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, product
from math import prod
from typing import Final

import numpy as np

from jointstiff.service.imports.tables import Column, Table, cut, group_forms, split_words, stack
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.meaning.budget import Budget

_MARKS: Final = ("_", "::", "-", " ", ".", "/", ":", "_-:/ .#")
"""Marks between the parts of a name; the last entry cuts at any of them."""
_MOST_ROWS_OF_POSTURE: Final = 16
_LEAST_POSTURES: Final = 3
_LEAST_FILLED: Final = 0.7
"""Least fraction of the cells postures × keys that have a row."""
_LEAST_COMMON: Final = 0.6
"""Least fraction of the labels of two tables that are in both."""
_MOST_NAMES: Final = 9
_MOST_KEYS: Final = 3
_MOST_OF_TABLE: Final = 5
_MOST_BY_AXIS: Final = 2
_LARGEST_NAME: Final = 100_000
"""Largest whole number that may be a name."""
_MOST_STRUCTURES: Final = 10
_MOST_COMBINATIONS: Final = 2_000
Words = tuple[str, ...]


@dataclass(frozen=True)
class Structure:
    """Grouping of the rows of a table in postures."""

    table: Table
    label: str | None = None  #: column; None: the order of the rows
    keys: tuple[str, ...] = ()  #: columns whose words tell the rows of a posture apart
    axis: str | None = None  #: the key whose three words are x, y and z, with a row for each coordinate

    @property
    def is_only_numbered(self) -> bool:
        """Return whether the label is a column of numbers that tells nothing but the rows.

        A first column 1, 2, 3 … is a label.
        """
        if self.label is None or self.keys:
            return False
        label, count = self.table.column(self.label), self.table.row_count
        counts = label is self.table.columns[0] and label.words == [str(row + 1) for row in range(count)]
        return label.is_numeric and len(set(label.words)) == count and not counts

    @property
    def splits(self) -> dict[str, str]:
        """Columns whose parts are used, with their marks."""
        names = [name for name in (self.label, *self.keys) if name and "." in name]
        marks = dict(_find_marks(self.table))
        return {name.split(".")[0]: marks[name.split(".")[0]] for name in names}

    def pivot(self) -> Pivot:
        """Return the numbers of each posture side by side; of repeated rows the first counts."""
        used = {self.label, *self.keys}
        numeric = [
            each for each in self.table.columns if each.is_numeric and each.is_own and each.id not in used
        ]
        words = _list_words([self.table.column(key) for key in self.keys], self.table.row_count)
        if self.label:
            names = self.table.column(self.label).words
        else:
            combo_numbers = {combo: number for number, combo in enumerate(dict.fromkeys(words))}
            repeats = _number_repeats(np.array([combo_numbers[combo] for combo in words]))
            names = [str(1 + repeat) for repeat in repeats]
        labels, combos = list(dict.fromkeys(names)), list(dict.fromkeys(words))
        posture_of = {label: i for i, label in enumerate(labels)}
        combo_of = {combo: i for i, combo in enumerate(combos)}
        numbers = np.full((len(labels), len(combos), len(numeric)), np.nan)
        rows = self.table.numbers([column.id for column in numeric])
        for name, combo, row in zip(names, words, rows, strict=True):
            cells = numbers[posture_of[name], combo_of[combo]]
            cells[:] = np.where(np.isnan(cells), row, cells)
        return Pivot(self, labels, combos, [column.id for column in numeric], numbers)


@dataclass(frozen=True, eq=False)
class Pivot:
    """Numbers of N postures, for each combination of words of the keys."""

    structure: Structure
    labels: list[str]
    combos: list[Words]
    columns: list[str]
    numbers: FloatArray  #: (N, combinations, columns); NaN without a row


def _list_words(columns: Sequence[Column], row_count: int) -> list[Words]:
    """Return the words of each row in some columns."""
    return list(zip(*(column.words for column in columns), strict=True)) or [()] * row_count


def stack_forms(tables: Sequence[Table]) -> list[Table]:
    """Return tables of one form stacked, each with the parts of its words as further columns."""
    stacked = []
    for group in group_forms(tables):
        table = stack(group)
        parts: list[Column] = []
        for name, marks in _find_marks(table):
            parts += split_words(table.column(name), marks)
        stacked.append(table.with_columns(parts))
    return stacked


def _find_marks(table: Table) -> Iterator[tuple[str, str]]:
    """Yield the columns of words that split at one mark into equally many parts, with the mark."""
    for column in table.columns:
        if column.is_numeric or "." in column.id:
            continue
        for mark in _MARKS:
            counts = {len(cut(word, mark)) for word in column.words if word}
            if len(counts) == 1 and min(counts) > 1:
                yield column.id, mark
                break


def list_structures(tables: Sequence[Table], budget: Budget) -> list[tuple[Structure, ...]]:
    """Return ways to read the tables, the likeliest first: common labels, complete grids, few keys.

    Raises:
        BudgetExceeded: there are too many ways.
    """
    choices = [_list_of_table(table, budget) for table in tables]
    if len(tables) == 1:
        choices = [[each for each in choices[0] if not each.is_only_numbered]]
    while prod(map(len, choices)) > _MOST_COMBINATIONS and max(map(len, choices)) > 1:
        most = max(map(len, choices)) - 1
        choices = [choice[:most] for choice in choices]
    ranked = []
    for combination in product(*choices):
        labelled = [each for each in combination if each.label is not None]
        is_joined = len(labelled) == len(tables)
        if is_joined and not all(_are_common(labelled[0], other) for other in labelled[1:]):
            continue
        is_mixed = bool(labelled) and not is_joined
        places = sum(choice.index(each) for choice, each in zip(choices, combination, strict=True))
        ranked.append(((is_mixed, len(tables) > 1 and not is_joined, places), combination))
    ranked.sort(key=lambda pair: pair[0])
    return [combination for _, combination in ranked[:_MOST_STRUCTURES]]


def _are_common(first: Structure, second: Structure) -> bool:
    """Return whether most labels of two tables are the same."""
    words, others = (set(each.table.column(each.label or "").words) for each in (first, second))
    return len(words & others) >= _LEAST_COMMON * max(len(words), len(others))


def _list_of_table(table: Table, budget: Budget) -> list[Structure]:
    """Return the ways to read one table: complete grids of labels and keys, those with most words first."""
    names = [column for column in table.columns if _may_name(column)][:_MOST_NAMES]
    codes = {column.id: _number(np.array(column.words)) for column in names}
    labels = [name for name, own in codes.items() if own.max(initial=0) + 1 >= _LEAST_POSTURES]
    keys = [name for name, own in codes.items() if 2 <= own.max(initial=0) + 1 <= _MOST_ROWS_OF_POSTURE]
    found: dict[bytes, tuple[tuple[float, ...], Structure]] = {}
    for count in range(_MOST_KEYS + 1):
        for label, chosen in product([*labels, None], combinations(keys, count)):
            if label in chosen:
                continue
            budget.spend()
            grid = _Grid.of(label, chosen, codes, table.row_count)
            if grid.is_complete:
                found.setdefault(grid.partition, (grid.rank, Structure(table, label, chosen)))
    best = [structure for _, structure in sorted(found.values(), key=lambda pair: pair[0])]
    by_axis = [
        replace(each, axis=key) for each in best for key in each.keys if codes[key].max() + 1 == len("xyz")
    ]
    return [*best[:_MOST_OF_TABLE], *by_axis[:_MOST_BY_AXIS], Structure(table)]


def _may_name(column: Column) -> bool:
    """Return whether the cells of a column can be names: words, or whole numbers."""
    if any(cell is None for cell in column.cells):
        return False
    if not column.is_numeric:
        return True
    numbers = column.numbers
    are_whole = bool(np.isfinite(numbers).all() and (numbers == np.round(numbers)).all())
    return are_whole and not np.ptp(numbers) > _LARGEST_NAME


@dataclass(frozen=True, eq=False)
class _Grid:
    """Rows of a table in a grid of labels and combinations of words."""

    has_label: bool
    postures: IndexArray  #: (rows,) number of the posture of each row, in the order of appearance
    combos: IndexArray  #: (rows,) number of its combination of words

    @classmethod
    def of(
        cls, label: str | None, keys: Sequence[str], codes: Mapping[str, IndexArray], row_count: int
    ) -> _Grid:
        """Return the grid of a table's rows; `codes` are the numbers of the words of each column."""
        combos = np.zeros(row_count, dtype=np.intp)
        for key in keys:
            combos = combos * (1 + codes[key].max(initial=0)) + codes[key]
        combos = _number(combos)
        return cls(label is not None, codes[label] if label else _number_repeats(combos), combos)

    @property
    def partition(self) -> bytes:
        """Key that is equal for grids with the same rows in the same cells."""
        return self.postures.tobytes() + self.combos.tobytes()

    @cached_property
    def filled(self) -> int:
        """Number of cells with a row."""
        return len(np.unique(self.postures * (1 + self.combos.max(initial=0)) + self.combos))

    @cached_property
    def fill(self) -> float:
        """Fraction of the cells that have a row."""
        postures, combos = 1 + self.postures.max(initial=0), 1 + self.combos.max(initial=0)
        return float(self.filled / (postures * combos))

    @property
    def is_complete(self) -> bool:
        """Return whether nearly each posture has each combination, equally often."""
        postures, combos = 1 + self.postures.max(initial=0), 1 + self.combos.max(initial=0)
        is_small = combos <= _MOST_ROWS_OF_POSTURE and postures >= _LEAST_POSTURES
        is_named = self.has_label or (combos > 1 and self.fill == 1.0)
        is_even = len(self.postures) % max(self.filled, 1) == 0
        return bool(is_small and is_named and is_even and self.fill >= _LEAST_FILLED)

    @property
    def rank(self) -> tuple[float, ...]:
        """Order: no repeats, complete, many combinations, with a label."""
        repeats = len(self.postures) // self.filled
        return repeats, -round(self.fill, 1), -int(self.combos.max(initial=0)), not self.has_label


def _number(words: np.ndarray) -> IndexArray:
    """Return the number of each word (N,) in the order of appearance."""
    _, first, numbers = np.unique(words, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[numbers], dtype=np.intp)


def _number_repeats(numbers: IndexArray) -> IndexArray:
    """Return for each row (N,) how often its number occurred above, from 0."""
    order = np.argsort(numbers, kind="stable")
    is_first = np.diff(numbers[order], prepend=-1) != 0
    start = np.maximum.accumulate(np.where(is_first, np.arange(len(order)), 0))
    repeats = np.empty(len(order), dtype=np.intp)
    repeats[order] = np.arange(len(order)) - start
    return repeats
