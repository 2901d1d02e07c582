"""Names of points, such as `P01_T2_loaded`, split into observation, target, state and load."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from jointstiff.schemas.imports import ImportOptions, State
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.rows import Template
from jointstiff.service.proposals.names.labels import (
    LEAST_LABELS,
    MOST_CODES,
    find_number,
    omit_zeros,
    split_parts,
)
from jointstiff.service.proposals.names.state_words import (
    add_state,
    are_words_of_states,
    list_state_words,
    read_state_word,
)
from jointstiff.service.proposals.names.targets import are_targets
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.service.proposals.tables.row_name import RowName


def split_names(
    table: NumberTable, column: int, options: ImportOptions, known_labels: Collection[str]
) -> list[RowName]:
    """Split the names of points in a column into observation, target, state and load.

    The template `point_name` says how. Without it, the part that is a known label is the observation, and a
    part that is a word for a state or a load in every name is the state. What is left is the target.
    """
    texts = table.list_texts(column)
    if options.point_name:
        return _split_by_template(texts, options.point_name, options.state_words)
    if known_labels and set(map(omit_zeros, texts)) <= set(map(omit_zeros, known_labels)):
        return [RowName(text) for text in texts]
    parts = _add_lacking_states(_split_paths(texts, options.state_words), options.state_words)
    if len({len(each) for each in parts}) != 1 or len(parts[0]) == 1:
        return [RowName(text) for text in texts]
    columns = [list(each) for each in zip(*parts, strict=True)]
    state_part = _find_state_part(columns, options.state_words)
    label_part = _find_label_part(table, columns, known_labels, state_part)
    if label_part is None:
        return [RowName(text) for text in texts]
    states = {}
    if state_part is not None:
        states = list_state_words(columns[state_part], options.state_words)
    of_collection = range(_count_parts_of_collection(texts))
    named = []
    for own in parts:
        others = (state_part, label_part, *of_collection)
        target_words = [word for n, word in enumerate(own) if n not in others]
        name = RowName(own[label_part], "_".join(target_words) or None)
        if state_part is not None:
            name = add_state(name, own[state_part], states)
        named.append(name)
    are_same_target = len({name.target for name in named}) == 1
    return [name._replace(target=None) for name in named] if are_same_target else named


def _split_paths(texts: Sequence[str], words: Mapping[str, State]) -> list[list[str]]:
    """Return the parts of names; groups between `::` that are words for states or loads stay whole.

    So do `unloaded` and `loaded_150kg` of `A::unloaded::P1_T1` and `A::loaded_150kg::P1_T1`.
    """
    paths = [text.split("::") for text in texts]
    if len({len(path) for path in paths}) != 1:
        return [split_parts(text) for text in texts]
    columns = []
    for groups in zip(*paths, strict=True):
        is_whole = len(paths[0]) > 1 and _are_states(groups, words)
        columns.append([[group] if is_whole else split_parts(group) for group in groups])
    return [[part for own in parts for part in own] for parts in zip(*columns, strict=True)]


def _count_parts_of_collection(texts: Sequence[str]) -> int:
    """Return the number of parts of the collection before the first `::` of all names; 0 without one."""
    collections = {text.partition("::")[0] for text in texts if "::" in text}
    has_collection = len(collections) == 1 and all("::" in text for text in texts)
    return len(split_parts(collections.pop())) if has_collection else 0


def _add_lacking_states(parts: list[list[str]], words: Mapping[str, State]) -> list[list[str]]:
    """Return the parts of names; a name without the last part of the others, a load, has a word for none."""
    most = max(map(len, parts))
    states = [read_state_word(each[-1], words) for each in parts if len(each) == most]
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
    found = [number for number, column in enumerate(columns) if _are_states(column, words)]
    return found[0] if len(found) == 1 else None


def _are_states(texts: Sequence[str], words: Mapping[str, State]) -> bool:
    """Return whether texts are several words for states or loads, and not all of them are digits."""
    different = set(texts)
    may_be_states = 1 < len(different) <= MOST_CODES and not all(map(str.isdigit, different))
    return may_be_states and are_words_of_states(different, words)


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
        if are_targets(table, columns[part], list(map(" ".join, others))):
            return part
    if known:
        return max(known, key=lambda part: len(set(columns[part])))
    counts = sorted((len(set(columns[part])), part) for part in parts)
    most, part = counts[-1]
    is_clear = len(counts) == 1 or most > counts[-2][0]
    return part if is_clear and most >= LEAST_LABELS and state_part is not None else None


def _find_known_parts(
    columns: Sequence[Sequence[str]], parts: Sequence[int], labels: Collection[str]
) -> list[int]:
    """Return the parts of names that are known labels: first those spelt alike, then by their numbers."""
    spelt = set(map(omit_zeros, labels))
    as_spelt = [part for part in parts if set(map(omit_zeros, columns[part])) <= spelt]
    return list(dict.fromkeys([*as_spelt, *_find_parts_with_numbers_of(columns, parts, labels)]))
