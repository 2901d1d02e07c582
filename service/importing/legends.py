"""Legends: what files themselves state of words, such as `a = sans charge`, `b = avec charge`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Final, NamedTuple

from jointstiff.schemas.imports import State
from jointstiff.service.importing.errors import quote
from jointstiff.service.importing.grammar import find_any_unit
from jointstiff.service.importing.grid import looks_like_a_number
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.importing.statements import Statement, read_statements
from jointstiff.service.importing.titles import find_states_of_titles
from jointstiff.service.tables.labels import fold_word

_MOST_TEXTS: Final = 100_000
"""Texts of a file that are searched."""
_MOST_CHARACTERS: Final = 200
"""Characters of a line of a legend, at most: a longer line is no legend."""
_LONGEST_WORD: Final = 16
_MOST_CELLS: Final = 3
"""Cells of words with one meaning: those of the three axes; more are a row of a table."""
_SHORTEST_ABBREVIATION: Final = 3
"""Letters of a word, at least, that abbreviates a word of a legend."""
_MEASURED, _DATA = "measured", "data"
"""Programs that compare points with a reference call measured points data."""
_MOST_MEANINGS: Final = 200
"""Meanings of words of all files, at most: more are rows of a table."""
_ENTRY: Final = re.compile(rf"(?<![^\W_])[\"'(]?(\w{{1,{_LONGEST_WORD}}})[\"')]? ?[=:] ?")
"""A word, and the sign before its meaning."""
_AXIS: Final = re.compile(r"^[xyz]|[xyz]$")
_BETWEEN: Final = re.compile(r"[\s,;/&+-]+")
"""What is between the words that have one meaning, such as those of `Xa, Ya, Za`."""
_ENDS: Final = " \t,;.:=|()\"'"
"""Signs around a meaning."""


class _Entry(NamedTuple):
    """Word and its meaning, as a file states them."""

    word: str  # folded
    meaning: str
    source: str  # file and place, in words


class Legend(NamedTuple):
    """States of two words by a legend of the files."""

    states: Mapping[str, State]
    note: str  # where the files state the meanings


def find_legend(files: Sequence[SourceFile], words: Sequence[str]) -> Legend | None:
    """Return the states of words by the meanings that files state; None unless one is loaded, one unloaded.

    One word needs another word of the legend, with the other state. A word with two meanings has no state.
    A word may abbreviate one word of the legend, such as `Ref` the word `reference`.
    """
    if len(words) not in (1, 2):
        return None
    entries = _list_entries(files)
    meanings = _gather_meanings(entries)
    others = words[1:] or [word for word in meanings if word != fold_word(words[0])]
    pairs = [(words[0], other) for other in others]
    legends = [legend for pair in pairs if (legend := _read_pair(pair, meanings)) is not None]
    return legends[0] if len(legends) == 1 else None


def _read_pair(pair: tuple[str, str], meanings: Mapping[str, _Entry]) -> Legend | None:
    """Return the legend of two words with meanings; None unless one is loaded, and one unloaded."""
    entries = [entry for word in pair if (entry := _find_entry(word, meanings)) is not None]
    if len(entries) < 2:
        return None
    state_of_text = find_states_of_titles([entry.meaning for entry in entries], {})
    states = {word: state_of_text.get(entry.meaning) for word, entry in zip(pair, entries, strict=True)}
    known = {word: state for word, state in states.items() if state is not None}
    if sorted(known.values()) != ["loaded", "unloaded"]:
        return None
    listed = " and ".join(f"{quote(word)} is {state}" for word, state in known.items())
    sources = dict.fromkeys(entry.source for entry in entries)
    return Legend(known, f"{listed} according to {' and '.join(sources)}")


def _find_entry(word: str, meanings: Mapping[str, _Entry]) -> _Entry | None:
    """Return the entry of a word, or of the only word that it abbreviates; None without one."""
    folded = fold_word(word)
    if folded in meanings:
        return meanings[folded]
    written_out = [entry for entry in meanings.values() if _abbreviates(folded, entry.word)]
    return written_out[0] if len(written_out) == 1 else None


def _abbreviates(short: str, word: str) -> bool:
    """Return whether a short word begins a word of a legend, or means the same as it; both are folded."""
    if len(short) < _SHORTEST_ABBREVIATION or not word.isalpha():
        return False
    return word.startswith(short) or (word == _DATA and _MEASURED.startswith(short))


def _gather_meanings(entries: Iterable[_Entry]) -> dict[str, _Entry]:
    """Return word → its entry, of the words with one meaning only."""
    meanings = dict[str, _Entry]()
    several = set[str]()
    for entry in entries:
        first = meanings.setdefault(entry.word, entry)
        if fold_word(first.meaning) != fold_word(entry.meaning):
            several.add(entry.word)
    return {word: entry for word, entry in meanings.items() if word not in several}


def _list_entries(files: Sequence[SourceFile]) -> list[_Entry]:
    """Return the words with meanings of all files; none if there are many, as in a table."""
    entries = list[_Entry]()
    for file in files:
        for statement in islice(read_statements(file), _MOST_TEXTS):
            if statement.place and len(statement.text) <= _MOST_CHARACTERS:
                entries += _read_entries(file.name, statement)
            if len(entries) > _MOST_MEANINGS:
                return []
    return entries


def _read_entries(file: str, statement: Statement) -> Iterator[_Entry]:
    """Yield the words that a text explains: words before an equals sign, or cells before a cell with words.

    `Xa Ya Za` explains `a`, too: the letters of axes tell the columns of a position.
    """
    source = f"{statement.place} of {quote(file)}"
    cells = [cell.strip() for cell in statement.text.split("\t")]
    of_texts = [pair for cell in cells for pair in _split_text(cell)]
    pairs = of_texts if of_texts or len(cells) == 1 else _split_cells(cells)
    for words, meaning in pairs:
        for word in dict.fromkeys(_strip_axes(words)):
            yield _Entry(word, meaning, source)


def _split_cells(cells: Sequence[str]) -> Iterator[tuple[list[str], str]]:
    """Yield words and meaning of a row of cells, the last perhaps a unit; nothing of a row of numbers."""
    has_unit = len(cells) > 2 and find_any_unit(cells[-1]) is not None
    *first, meaning = cells[:-1] if has_unit else cells
    words = [word for cell in first for word in _BETWEEN.split(cell.strip(_ENDS)) if word]
    is_short = len(first) <= _MOST_CELLS and all(len(word) <= _LONGEST_WORD for word in words)
    if is_short and not any(map(looks_like_a_number, (meaning, *first[1:]))):
        yield words, meaning.strip(_ENDS)


def _split_text(text: str) -> Iterator[tuple[list[str], str]]:
    """Yield the words and meanings of a text such as `a = without load, b = with load`."""
    found = list(_ENTRY.finditer(text))
    ends = [*(match.start() for match in found[1:]), len(text)]
    for match, end in zip(found, ends, strict=False):
        meaning = text[match.end() : end].strip(_ENDS)
        if meaning and not looks_like_a_number(meaning):
            yield [match[1]], meaning


def _strip_axes(words: Sequence[str]) -> Iterator[str]:
    """Yield words in lower case, and the rest that words of all axes share: `a` of `Xa`, `Ya` and `Za`."""
    folded = [fold_word(word) for word in words]
    yield from folded
    rests = {_AXIS.sub("", word, count=1) for word in folded}
    if len(rests) == 1 and (rest := rests.pop()):
        yield rest
