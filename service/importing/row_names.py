"""Names of the rows of a table without known columns: observation, target, state and load of each row."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from itertools import combinations
from typing import Final

import numpy as np

from jointstiff.schemas.imports import ImportOptions, State
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.grammar import (
    OPPOSITE_STATE,
    STATE_OF_DIGIT,
    find_answer,
    find_state,
    find_state_in_name,
    find_stated_state,
    find_unit_of_size,
    is_cycle_header,
    is_in_kg,
    is_load_header,
    is_no_load_header,
    is_posture_header,
    is_repeat_header,
    read_states,
)
from jointstiff.service.importing.grid import looks_like_a_number
from jointstiff.service.importing.lengths import find_units_of_coordinates
from jointstiff.service.importing.load_columns import find_states_of_loads, list_states_of_columns
from jointstiff.service.importing.loads import find_load, find_state_of_load
from jointstiff.service.importing.numbers import NumberTable
from jointstiff.service.importing.row_key import RowName
from jointstiff.service.importing.rows import Template
from jointstiff.service.tables.labels import fold_word

_SEPARATORS: Final = re.compile(r"::|[\s_\-.:/|]+")
"""What may be between the parts of a name."""
_LEAST_LABELS: Final = 3
"""Fewest different names of observations; fewer are names of something else, such as a robot."""
_MOST_CODES: Final = 16
"""Most different names of targets or states in a column."""
_LEADING_ZEROS: Final = re.compile(r"(?<![\d.,])0+(?=\d)")
_COUNTED: Final = re.compile(r"\d{1,5}")
_FORCE: Final = re.compile(r"[-+]?(\d{1,6}(?:[.,]\d{1,3})?)\s?(?:(?:k|da)?N|kgf|kp|lbf|kg|lbs?)?")
"""A force or a mass, with or without its unit."""
_FORCE_WITH_UNIT: Final = re.compile(r"(\d{1,6}(?:[.,]\d{1,3})?)\s?((?:k|da)?N|kgf|kp|lbf)")
_WORD: Final = re.compile(r"[^\W\d_]+")
"""A part of a name without digits, which may be a state: repeats have numbers."""
_NAMING_KINDS: Final = frozenset(("name", "collection", "group", "target", "state"))
LEAST_BETWEEN_TARGETS: Final = 2e-3
"""Least distance [m] of two targets along an axis of coordinates; repeats of a reading are nearer."""
_LARGEST_DEFLECTION: Final = 0.02
"""Distance [m] along an axis beyond which two positions of a posture are no states of one target."""
_MOST_CHANGE: Final = 1e-3
"""Most change [m] of the distance of two targets from posture to posture; the flange is rigid."""
_MOST_DIFFERENT: Final = 2
"""States of a column of words that nobody knows."""


def name_rows(
    table: NumberTable, options: ImportOptions, known_labels: Collection[str] = ()
) -> list[RowName]:
    """Name the rows of a table: by its columns, then by the parts of its names of points.

    Args:
        table: table with rows of numbers.
        options: words for states, and the template of names of points.
        known_labels: names of the observations in another table, which are parts of the names of points.
    """
    label_column = None if options.by_order else _find_label_column(table, options.state_words, known_labels)
    state_column = _find_state_column(table, options, label_column)
    target_column = _find_target_column(table, (label_column, state_column))
    are_observations = False
    names = [RowName()] * len(table.rows)
    if label_column is not None:
        texts = _list_texts(table, label_column)
        are_observations = len(set(texts)) == len(texts) and set(texts) <= set(known_labels)
        names = _split_names(table, label_column, options, known_labels)
    states = {}
    if state_column is not None:
        states = _list_states(table, state_column, options.state_words)
    named = []
    for row, name in zip(table.rows, names, strict=True):
        if target_column is not None:
            name = name._replace(target=row.cells[target_column])
        if state_column is not None:
            name = _add_state(name, row.cells[state_column], states)
        named.append(name)
    named = named if are_observations else _add_loads(table, named)
    return _omit_row_numbers(_add_targets(table, named))


def _add_loads(table: NumberTable, names: Sequence[RowName]) -> list[RowName]:
    """Return the names with the loads of columns, which tell the rows of an observation apart."""
    masses = _list_masses(table)
    forces = _list_forces(table, names) or _list_loads(table)
    named = []
    for number, name in enumerate(names):
        if masses is not None and name.mass is None:
            name = name._replace(mass=masses[number], state=find_state_of_load(masses[number]))
        if forces is not None and name.state is None:
            name = name._replace(state=forces[number].state, force=forces[number].force)
        named.append(name)
    return named


def _add_targets(table: NumberTable, names: list[RowName]) -> list[RowName]:
    """Return names with the targets in the one column that distinguishes rows of a posture in one state.

    The column has few texts or numbers, which most postures have; the points that numbers name keep their
    distances. Rows that lie together are repeats of a reading, and keep their names, as do those of several
    such columns. Rows with positions in two states are in no state.
    """
    rows_of_name: dict[RowName, list[int]] = {}
    for row, name in enumerate(names):
        rows_of_name.setdefault(name, []).append(row)
    groups = list(rows_of_name.values())
    have_labels = all(name.label is not None and name.target is None for name in names)
    have_states = all(name.state is not None for name in names) or _has_columns_of_states(table)
    least = LEAST_BETWEEN_TARGETS if have_states else _LARGEST_DEFLECTION
    if not have_labels or has_repeats(table) or not are_far_apart(table, groups, least):
        return names
    labels = [name.label or "" for name in names]
    columns = [
        column
        for column in range(len(table.headers))
        if _distinguishes(table, column, groups)
        and (_has_words(table, column) or _are_targets(table, labels, _list_texts(table, column)))
    ]
    if len(columns) != 1:
        return names
    texts = _list_texts(table, columns[0])
    return [name._replace(target=text) for name, text in zip(names, texts, strict=True)]


def _has_columns_of_states(table: NumberTable) -> bool:
    """Return whether headers name positions without load, and positions under load."""
    positions = (each.quantity for each in table.meanings if each is not None and each.kind == "position")
    return {"unloaded", "loaded"} <= {position.state for position in positions}


def are_far_apart(table: NumberTable, groups: Sequence[Sequence[int]], least: float) -> bool:
    """Return whether rows with the same names are positions of several targets: each is far from the others.

    A table without coordinates has no positions. A few groups may lack rows, or readings of their rows.

    Args:
        table: numbers of a file.
        groups: indices of the rows with the same names.
        least: least distance [m] of two targets along an axis of coordinates.
    """
    sizes_of_units = find_units_of_coordinates(table)
    if not sizes_of_units or max(map(len, groups)) > _MOST_CODES:
        return False
    numbers = table.table.numbers
    is_known = np.isfinite(numbers[:, list(sizes_of_units)])
    known = set(np.flatnonzero(is_known.any(axis=1)).tolist())
    read = [[row for row in group if row in known] for group in groups]
    several = [group for group in read if len(group) > 1]
    if 2 * len(several) <= len(groups):
        return False
    for group in several:
        positions = np.array([size * numbers[group, column] for column, size in sizes_of_units.items()])
        distances = [
            float(np.fmax.reduce(np.abs(positions[:, first] - positions[:, second]), initial=0.0))
            for first, second in combinations(range(len(group)), 2)
        ]
        if min(distances) < least:
            return False
    return True


def _distinguishes(table: NumberTable, column: int, groups: Sequence[Sequence[int]]) -> bool:
    """Return whether a column has the same few names in most groups of rows, and no name twice in a group."""
    texts = _list_texts(table, column)
    words = set(texts)
    are_names = _has_words(table, column) or all(map(_COUNTED.fullmatch, words))
    if not _may_name(table, column) or not 1 < len(words) <= _MOST_CODES or not are_names:
        return False
    own = [[texts[row] for row in group] for group in groups]
    complete_count = sum(len(each) == len(words) for each in own)
    return 2 * complete_count > len(groups) and all(len(set(each)) == len(each) for each in own)


def _may_name(table: NumberTable, column: int) -> bool:
    """Return whether a column has no known meaning, or one of names, and is not ignored."""
    meaning = table.meanings[column]
    return column not in table.ignored and (meaning is None or meaning.kind in _NAMING_KINDS)


def _has_words(table: NumberTable, column: int) -> bool:
    """Return whether all cells of a column are texts other than numbers."""
    return _are_texts(_list_texts(table, column))


def _are_targets(table: NumberTable, postures: Sequence[str], points: Sequence[str]) -> bool:
    """Return whether points are targets on one flange: most keep their distances, and move with the postures.

    Points that repeats or loads tell apart do not move so far. A point of a posture is the mean of its rows.

    Args:
        table: numbers of a file.
        postures: name of the posture of each row.
        points: name of the point of each row.
    """
    sizes_of_units = find_units_of_coordinates(table)
    labels, targets = list(dict.fromkeys(postures)), list(dict.fromkeys(points))
    if not sizes_of_units or len(labels) < _LEAST_LABELS or not 1 < len(targets) <= _MOST_CODES:
        return False
    number_of_label = {label: number for number, label in enumerate(labels)}
    number_of_target = {target: number for number, target in enumerate(targets)}
    place = (
        [number_of_label[label] for label in postures],
        [number_of_target[target] for target in points],
    )
    coordinates = table.table.numbers[:, list(sizes_of_units)] * list(sizes_of_units.values())
    sums = np.zeros((len(labels), len(targets), len(sizes_of_units)))
    counts = np.zeros((len(labels), len(targets), 1))
    np.add.at(sums, place, coordinates)
    np.add.at(counts, place, 1.0)
    positions = np.divide(sums, counts, out=np.full_like(sums, np.nan), where=counts > 0.0)
    first, second = np.triu_indices(len(targets), 1)
    distances = np.linalg.norm(positions[:, first] - positions[:, second], axis=2)
    moved = np.linalg.norm(np.diff(positions, axis=0), axis=2)
    if 2 * np.isfinite(distances).sum() <= distances.size or not np.isfinite(moved).any():
        return False
    distances = distances[:, np.isfinite(distances).any(axis=0)]
    changes = np.abs(distances - np.nanmedian(distances, axis=0))
    return bool(np.nanmedian(changes) <= _MOST_CHANGE and np.nanmedian(moved) > _LARGEST_DEFLECTION)


def _omit_row_numbers(names: list[RowName]) -> list[RowName]:
    """Return the names without labels that number the rows, if other names distinguish rows of a posture."""
    labels = [name.label for name in names]
    are_row_numbers = len(set(labels)) == len(names) and len({name.key for name in names}) > 1
    return [name._replace(label=None) for name in names] if are_row_numbers else names


def _list_texts(table: NumberTable, column: int) -> list[str]:
    """Return the cells of a column."""
    return [row.cells[column] for row in table.rows]


def _are_texts(texts: Sequence[str]) -> bool:
    """Return whether no cell is empty, or a number."""
    return all(text and not looks_like_a_number(text) for text in texts)


def _find_label_column(
    table: NumberTable, words: Mapping[str, State], known_labels: Collection[str] = ()
) -> int | None:
    """Return the column of names of observations or points; None without one.

    A column with more of the known labels, and no other text but words for states, comes before a column of
    names of points, as does one that counts the postures of points that are targets. Without a header that
    says so, the first column has names if its cells are texts, or if they are whole numbers below a header
    that is not known. A column with one text, such as a collection, may be before it.
    """
    named = table.find_column("name")
    of_known = _find_column_of_labels(table, known_labels, words)
    if of_known is not None and (named is None or _has_more_texts(table, of_known, named)):
        return of_known
    of_targets = None if named is None else _find_column_of_postures(table, named)
    if of_targets is not None:
        return of_targets
    if named is not None and len(set(_list_texts(table, named))) >= _LEAST_LABELS:
        return named
    first = 0
    while first + 1 < len(table.headers) and _has_one_text(table, first):
        first += 1
    if table.meanings[first] is not None or first in table.ignored:
        return _find_posture_column(table)
    texts = _list_texts(table, first)
    are_counted = bool(table.headers[first]) and all(_COUNTED.fullmatch(text) for text in texts)
    is_label = (_are_texts(texts) or are_counted) and len(set(texts)) >= _LEAST_LABELS
    cycles = _find_cycle_column(table, len(set(texts))) if _are_texts(texts) else None
    if cycles is not None:
        return cycles
    posture_column = _find_posture_column(table)
    return first if is_label and posture_column is None else posture_column


def _find_column_of_postures(table: NumberTable, points: int) -> int | None:
    """Return the only column of counts that are the postures of targets named in another column; else None.

    Each posture has most of the targets.
    """
    names = _list_texts(table, points)
    if points in table.stated or not 1 < len(set(names)) <= _MOST_CODES:
        return None
    found = []
    for column in range(len(table.headers)):
        texts = _list_texts(table, column)
        is_free = table.meanings[column] is None and column not in table.ignored
        if is_free and all(map(_COUNTED.fullmatch, texts)) and _are_targets(table, texts, names):
            found.append(column)
    return found[0] if len(found) == 1 else None


def _find_posture_column(table: NumberTable) -> int | None:
    """Return the first column whose header is a word for the number of a posture; None without one."""
    for column, header in enumerate(table.headers):
        is_free = table.meanings[column] is None and column not in table.ignored
        if is_free and is_posture_header(header) and len(set(_list_texts(table, column))) >= _LEAST_LABELS:
            return column
    return None


def _find_column_of_labels(
    table: NumberTable, labels: Collection[str], words: Mapping[str, State]
) -> int | None:
    """Return the first column whose cells are most of the known labels, and no other text; else None.

    Without such a column, all cells may have a word for a state next to a label, such as `unloaded p01`.
    """
    known = set(map(omit_zeros, labels))
    if not known:
        return None
    free = [
        column
        for column, meaning in enumerate(table.meanings)
        if column not in table.ignored and (meaning is None or meaning.kind in _NAMING_KINDS)
    ]
    for without_state in (omit_zeros, partial(_omit_state, words=words)):
        for column in free:
            own = set(map(without_state, _list_texts(table, column)))
            if own <= known and 2 * len(own) > len(known):
                return column
    return None


def _omit_state(text: str, words: Mapping[str, State]) -> str:
    """Return the other part of a name of two parts, one a word for a state, in the spelling of `omit_zeros`.

    Other names give an empty text.
    """
    parts = [part for part in _SEPARATORS.split(text) if part]
    others = [part for part in parts if find_state(part, words) is None]
    return omit_zeros(others[0]) if len(parts) == 2 and len(others) == 1 else ""


def _has_more_texts(table: NumberTable, column: int, other: int) -> bool:
    """Return whether a column has more different texts than another one."""
    return len(set(_list_texts(table, column))) > len(set(_list_texts(table, other)))


def _has_one_text(table: NumberTable, column: int) -> bool:
    """Return whether all cells of a column are one text, and its header is not known otherwise."""
    meaning, texts = table.meanings[column], _list_texts(table, column)
    is_free = meaning is None or meaning.kind in ("collection", "ignored")
    return is_free and len(set(texts)) == 1 and _are_texts(texts)


def _find_cycle_column(table: NumberTable, target_count: int) -> int | None:
    """Return the column that counts the postures of targets in the first column; None without one.

    A column of fewer numbers than there are names counts repeats.
    """
    for column, header in enumerate(table.headers):
        texts = _list_texts(table, column)
        are_counted = all(_COUNTED.fullmatch(text) for text in texts)
        is_free = table.meanings[column] is None and column not in table.ignored
        has_most = len(set(texts)) > max(target_count, _LEAST_LABELS - 1)
        if is_free and is_cycle_header(header) and are_counted and has_most:
            return column
    return None


def _find_state_column(table: NumberTable, options: ImportOptions, label_column: int | None) -> int | None:
    """Return the column whose cells are words for states or loads, at least two; None without one."""
    named = table.find_column("state")
    if named is not None:
        return named
    free = [c for c in range(len(table.headers)) if c != label_column and c not in table.ignored]
    for column in free:
        if _has_stated_words(table, column, options.state_words):
            return column
    for column in free:
        if _find_answers(table, column, options.state_words):
            return column
    return _find_column_of_words(table, options, free)


def _has_stated_words(table: NumberTable, column: int, words: Mapping[str, State]) -> bool:
    """Return whether a column has two words or more that are, or contain, the caller's words for states.

    Of two words of a column of names, the caller may state one: the other one means the other state.
    """
    texts = set(_list_texts(table, column))
    stated = [text for text in texts if find_stated_state(text, words) is not None]
    may_state_one = len(texts) == _MOST_DIFFERENT and _may_name(table, column)
    return len(texts) > 1 and (len(stated) == len(texts) or (may_state_one and bool(stated)))


def _find_column_of_words(table: NumberTable, options: ImportOptions, columns: Sequence[int]) -> int | None:
    """Return the first of some columns without a known header whose cells are words for states or loads.

    A column of groups is such a column if its groups have different states or loads.
    """
    for column in columns:
        meaning = table.meanings[column]
        if meaning is not None and meaning.kind == "group" and _has_groups_in_states(table, column, options):
            return column
        if meaning is not None:
            continue
        texts = _list_texts(table, column)
        words = set(texts)
        if not 1 < len(words) <= _MOST_CODES or not _are_texts(list(words)):
            continue
        are_opposites = read_states(words, options.state_words).keys() == words
        are_states = are_opposites or _are_states(words, options.state_words)
        # Next to a load such as `100 kg`, another word means no load.
        has_load = len(words) == 2 and any(find_load(word) for word in words)
        if are_states or (has_load and len(_list_state_words(texts, options.state_words)) == 2):
            return column
    return None


def _has_groups_in_states(table: NumberTable, column: int, options: ImportOptions) -> bool:
    """Return whether the groups of a column are words for states or loads, and no two are alike."""
    groups = set(_list_texts(table, column))
    read = {_read_state_word(group, options.state_words) for group in groups}
    return 1 < len(read) == len(groups) <= _MOST_CODES and _are_states(groups, options.state_words)


def _list_states(table: NumberTable, column: int, words: Mapping[str, State]) -> dict[str, RowName]:
    """Return word → state and mass, of the words of a column of states; without words that are not known."""
    answers = _find_answers(table, column, words)
    if is_no_load_header(table.headers[column]) and answers:
        return answers
    return _list_state_words(_list_texts(table, column), words) or answers


def _find_answers(table: NumberTable, column: int, words: Mapping[str, State]) -> dict[str, RowName]:
    """Return word → state of a column below a header such as `load`: no and yes, or no force and a force.

    Below a header such as `unloaded`, no and yes mean the other state, unless the caller states the words. A
    column of other words, or of more than two, has no answers, as one of several forces.
    """
    meaning = table.meanings[column]
    is_free = meaning is None or meaning.kind == "state"
    is_about_no_load = is_no_load_header(table.headers[column])
    if not is_free or not (is_about_no_load or is_load_header(table.headers[column])):
        return {}
    different = list(dict.fromkeys(_list_texts(table, column)))
    if len(different) != _MOST_DIFFERENT:
        return {}
    if is_about_no_load:
        stated = {fold_word(word): state for word, state in words.items()}
        opposites = {word: OPPOSITE_STATE.get(find_answer(word)) for word in different}
        states = {word: stated.get(fold_word(word), opposites[word]) for word in different}
    else:
        states = {word: _read_answer(word, words) for word in different}
    if set(states.values()) != {"unloaded", "loaded"}:
        return {}
    return {word: RowName(state=state) for word, state in states.items()}


def _read_answer(word: str, words: Mapping[str, State]) -> State | None:
    """Return the state that a cell below a header such as `load` means; None for other cells.

    A mass in kg is read with its number elsewhere.
    """
    state = find_state(word, words) or find_answer(word)
    if state is not None or find_load(word) is not None:
        return state
    force = _FORCE.fullmatch(word)
    if force is None:
        return None
    return "loaded" if float(force[1].replace(",", ".")) > 0.0 else "unloaded"


def find_unknown_states(table: NumberTable, options: ImportOptions) -> tuple[str, ...]:
    """Return the two words of a column that may be states; none unless one column has two words."""
    label_column = None if options.by_order else _find_label_column(table, options.state_words)
    if _find_state_column(table, options, label_column) is not None:
        return ()
    found = []
    for column, meaning in enumerate(table.meanings):
        words = tuple(dict.fromkeys(_list_texts(table, column)))
        is_free = meaning is None and column != label_column and column not in table.ignored
        if is_free and len(words) == _MOST_DIFFERENT and _are_texts(words):
            found.append(words)
    return found[0] if len(found) == 1 else ()


def find_different_words(table: NumberTable, column: int, rows: Sequence[int]) -> tuple[str, ...]:
    """Return the words by which the cells of rows differ; none for numbers, times and known other columns."""
    meaning = table.meanings[column]
    is_free = meaning is None or meaning.kind in _NAMING_KINDS
    texts = list(dict.fromkeys(table.rows[row].cells[column] for row in rows))
    if not is_free or column in table.ignored or len(texts) < 2:
        return ()
    words_of_text = [[part for part in _SEPARATORS.split(text) if _WORD.fullmatch(part)] for text in texts]
    common = set(words_of_text[0]).intersection(*words_of_text)
    return tuple(dict.fromkeys(word for each in words_of_text for word in each if word not in common))


def has_repeats(table: NumberTable) -> bool:
    """Return whether a header says that a column counts the repeated readings of a point."""
    return any(map(is_repeat_header, table.headers))


def _list_state_words(texts: Sequence[str], words: Mapping[str, State]) -> dict[str, RowName]:
    """Return word → state and mass, of the words of a column of states; without words that are not known.

    If one of two words is known to mean loaded or unloaded, the other word means the other state.
    """
    different = list(dict.fromkeys(texts))
    known = {word: read for word in different if (read := _read_state_word(word, words)) is not None}
    for word, state in read_states(different, words).items():
        known[word] = known.get(word, RowName())._replace(state=state)
    if len(different) == 2 and len(known) == 1:
        ((first, read),) = known.items()
        other = next(word for word in different if word != first)
        if read.state in OPPOSITE_STATE:
            known[other] = RowName(state=OPPOSITE_STATE[read.state])
    return known


def _find_target_column(table: NumberTable, others: tuple[int | None, int | None]) -> int | None:
    """Return the column of names of targets; None without one, or if there is a single name.

    It is the first one if another column counts the postures, and the column of names of points if another
    one names the postures. `others` are the columns of labels and states.
    """
    column = table.find_column("target")
    label_column, _ = others
    if column is None and label_column and is_cycle_header(table.headers[label_column]):
        column = 0
    if column is None and label_column is not None:
        column = table.find_column("name")
    if column is None or column in others:
        return None
    count = len(set(_list_texts(table, column)))
    return column if 1 < count <= _MOST_CODES else None


def _list_masses(table: NumberTable) -> list[float] | None:
    """Return the mass [kg] that hangs in each row; None without a column, or for one mass."""
    for column, header in enumerate(table.headers):
        meaning = table.meanings[column]
        is_mass = meaning is not None and meaning.kind == "mass"
        if not is_mass and not (meaning is None and is_in_kg(header)):
            continue
        masses = [float(mass) for mass in table.table.numbers[:, column]]
        if all(mass >= 0.0 for mass in masses) and 1 < len(set(masses)) <= _MOST_CODES:
            return masses
    return None


def _list_forces(table: NumberTable, names: Sequence[RowName]) -> list[RowName] | None:
    """Return state and force of each row by its columns of forces, if some rows have none; else None.

    Sizes that occur in one posture are those of one load that was read in each posture, and no further loads.
    `names` have the postures; without a name, each row counts.
    """
    columns = [column for column, meaning in enumerate(table.meanings) if meaning and meaning.kind == "force"]
    size_column = table.find_size_of_force()
    columns += [] if size_column is None else [size_column]
    states = find_states_of_loads(np.linalg.norm(np.nan_to_num(table.table.numbers[:, columns]), axis=1))
    if not columns or states is None:
        return None
    sizes = [
        f"{math.hypot(*table.table.numbers[row, columns]):.4g}" if state == "loaded" else ""
        for row, state in enumerate(states)
    ]
    postures = [row if name.label is None else name.label for row, name in enumerate(names)]
    counts = Counter(size for size, _ in set(zip(sizes, postures, strict=True)) if size)
    has_several = 1 < len(counts) <= _MOST_CODES and min(counts.values()) > 1
    meaning = table.meanings[columns[0]]
    unit = find_unit_of_size(table.headers[columns[0]]) if meaning is None else meaning.unit
    return [
        RowName(state=state, force=f"{size} {unit or ''}".strip() if has_several and size else "")
        for state, size in zip(states, sizes, strict=True)
    ]


def _list_loads(table: NumberTable) -> list[RowName] | None:
    """Return the state of each row by a column of loads such as `payload`; None without one."""
    states = list_states_of_columns(table)
    return None if states is None else [RowName(state=state) for state in states]


def _are_states(different: Collection[str], words: Mapping[str, State]) -> bool:
    """Return whether all words are states or loads; forces only are where another word means no load."""
    read = [_read_state_word(word, words) for word in different]
    known = [each for each in read if each is not None]
    has_forces = any(each.force for each in known)
    return len(known) == len(read) and (not has_forces or any(each.state == "unloaded" for each in known))


def _read_state_word(word: str, words: Mapping[str, State]) -> RowName | None:
    """Return the state, and the mass or force if the word states one; None for another word."""
    state = find_state(word, words)
    if state is not None:
        return RowName(state=state)
    mass = find_load(word)
    if mass is not None:
        state = find_state_in_name(word, words)  # `unloaded_200kg` names the load that does not hang
        is_without = state in ("unloaded", "unloaded_after")
        return RowName(state=state) if is_without else RowName(state=find_state_of_load(mass), mass=mass)
    force = _FORCE_WITH_UNIT.fullmatch(word)
    if force is not None:
        size = float(force[1].replace(",", "."))
        return RowName(state=find_state_of_load(size), force=f"{size:g} {force[2]}" if size else "")
    state = find_state(word, STATE_OF_DIGIT) or find_state_in_name(word, words)
    return None if state is None else RowName(state=state)


def _add_state(name: RowName, word: str, states: Mapping[str, RowName]) -> RowName:
    """Return the name of a row with the state and the load that a word means; unchanged for other words."""
    read = states.get(word)
    return name if read is None else name._replace(state=read.state, mass=read.mass, force=read.force)


# ---- names of points


def _split_names(
    table: NumberTable, column: int, options: ImportOptions, known_labels: Collection[str]
) -> list[RowName]:
    """Split the names of points in a column into observation, target, state and load.

    The template `point_name` says how. Without it, the part that is a known label is the observation, and a
    part that is a word for a state or a load in every name is the state. What is left is the target.
    """
    texts = _list_texts(table, column)
    if options.point_name:
        return _split_by_template(texts, options.point_name, options.state_words)
    if known_labels and set(map(omit_zeros, texts)) <= set(map(omit_zeros, known_labels)):
        return [RowName(text) for text in texts]
    parts = _add_lacking_states(texts, options.state_words)
    if len({len(each) for each in parts}) != 1 or len(parts[0]) == 1:
        return [RowName(text) for text in texts]
    columns = [list(each) for each in zip(*parts, strict=True)]
    state_part = _find_state_part(columns, options.state_words)
    label_part = _find_label_part(table, columns, known_labels, state_part)
    if label_part is None:
        return [RowName(text) for text in texts]
    states = {}
    if state_part is not None:
        states = _list_state_words(columns[state_part], options.state_words)
    named = []
    for own in parts:
        target_words = [word for n, word in enumerate(own) if n not in (state_part, label_part)]
        name = RowName(own[label_part], "_".join(target_words) or None)
        if state_part is not None:
            name = _add_state(name, own[state_part], states)
        named.append(name)
    are_same_target = len({name.target for name in named}) == 1
    return [name._replace(target=None) for name in named] if are_same_target else named


def _add_lacking_states(texts: Sequence[str], words: Mapping[str, State]) -> list[list[str]]:
    """Return the parts of names; a name without the last part of the others, a load, has a word for none."""
    parts = [[part for part in _SEPARATORS.split(text) if part] for text in texts]
    most = max(map(len, parts))
    states = [_read_state_word(each[-1], words) for each in parts if len(each) == most]
    are_loaded = all(state is not None and state.state == "loaded" for state in states)
    if not are_loaded or {len(each) for each in parts} != {most - 1, most}:
        return parts
    return [each if len(each) == most else [*each, "unloaded"] for each in parts]


def _split_by_template(
    texts: Sequence[str], template_text: str, state_words: Mapping[str, State]
) -> list[RowName]:
    """Split names of points by the template that the caller states; a name that does not fit is a label."""
    template = Template("point_name", template_text)
    named = []
    for text in texts:
        try:
            parts = template.parse(text, state_words)
        except ImportFileError:
            return [RowName(each) for each in texts]
        named.append(RowName(parts.label, parts.target, parts.state))
    return named


def omit_zeros(label: str) -> str:
    """Return a label whose numbers have no leading zeros, in lower case: `P01` gives `p1`."""
    return _LEADING_ZEROS.sub("", label.casefold())


def find_number(label: str) -> str:
    """Return the only number of a label, without leading zeros; the label without one, or with several."""
    numbers = re.findall(r"\d+", label)
    return str(int(numbers[0])) if len(numbers) == 1 else label


def list_words_behind(names: Collection[str], labels: Collection[str]) -> list[str]:
    """Return the last words of names that are a label and such a word, of most labels: `B` of `P3_B`."""
    spelt = {spelling for label in labels for spelling in (omit_zeros(label), find_number(label))}
    counts = Counter[str]()
    for name in names:
        *parts, last = [part for part in _SEPARATORS.split(name) if part] or [name]
        own = " ".join(parts)
        counts[last] += omit_zeros(own) in spelt or find_number(own) in spelt
    return [word for word, count in counts.items() if 2 * count > len(labels)]


def _find_parts_with_numbers_of(
    columns: Sequence[Sequence[str]], parts: Sequence[int], labels: Collection[str]
) -> list[int]:
    """Return the parts of names that have the numbers of most labels, and no other: `P[3]` of `3`."""
    numbers = set(map(find_number, labels))
    found = []
    for part in parts:
        own = set(map(find_number, columns[part]))
        if own <= numbers and 2 * len(own) > len(numbers) and len(own) == len(set(columns[part])):
            found.append(part)
    return found


def _find_state_part(columns: Sequence[Sequence[str]], words: Mapping[str, State]) -> int | None:
    """Return the part of names that is a word for a state or a load in every name; None unless it is one."""
    found = []
    for number, column in enumerate(columns):
        different = set(column)
        are_states = _are_states(different, words)
        if 1 < len(different) <= _MOST_CODES and are_states and not all(map(str.isdigit, different)):
            found.append(number)
    return found[0] if len(found) == 1 else None


def _find_label_part(
    table: NumberTable,
    columns: Sequence[Sequence[str]],
    known_labels: Collection[str],
    state_part: int | None,
) -> int | None:
    """Return the part of names that is the observation: a known label, else the only part of many values.

    Of several known parts, it is the one in whose postures the others are targets on one flange, else the one
    of most labels, else the one that is spelt as they are.
    """
    parts = [number for number in range(len(columns)) if number != state_part]
    known = _find_known_parts(columns, parts, known_labels) if known_labels else []
    for part in known if len(known) > 1 else ():
        others = zip(*(columns[other] for other in parts if other != part), strict=True)
        if _are_targets(table, columns[part], list(map(" ".join, others))):
            return part
    if known:
        return max(known, key=lambda part: len(set(columns[part])))
    counts = sorted((len(set(columns[part])), part) for part in parts)
    most, part = counts[-1]
    is_clear = len(counts) == 1 or most > counts[-2][0]
    return part if is_clear and most >= _LEAST_LABELS and state_part is not None else None


def _find_known_parts(
    columns: Sequence[Sequence[str]], parts: Sequence[int], labels: Collection[str]
) -> list[int]:
    """Return the parts of names that are known labels: first those spelt alike, then by their numbers."""
    spelt = set(map(omit_zeros, labels))
    as_spelt = [part for part in parts if set(map(omit_zeros, columns[part])) <= spelt]
    return list(dict.fromkeys([*as_spelt, *_find_parts_with_numbers_of(columns, parts, labels)]))
