"""Loads that files state once in words, not in columns: a likely answer to the question for the force."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from math import hypot, isclose
from typing import Final, NamedTuple

from jointstiff.service.importing.errors import quote
from jointstiff.service.importing.grammar import (
    UNIT_OF_LOAD,
    WORDS_OF_LOADS,
    is_force,
    is_hung,
    is_mass,
    is_negation,
)
from jointstiff.service.importing.grid import looks_like_a_number
from jointstiff.service.importing.loads import find_newtons
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.importing.statements import Statement, read_statements

_RELATIVE_TOLERANCE: Final = 5e-3
"""Difference of one load in two units, such as 150 kg and 1471.5 N, or rounded."""


def _build_alternation(texts: Iterable[str]) -> str:
    """Return a regular expression that matches any of the texts, the longest first."""
    return "|".join(map(re.escape, sorted(texts, key=len, reverse=True)))


_SIZE: Final = r"(?P<size>\d{1,5}+(?:[.,]\d{1,3}+)?)"
_UNIT: Final = rf"(?P<unit>{_build_alternation(UNIT_OF_LOAD)})"
_START: Final = r"(?<![A-Za-z0-9À-ɏͰ-ӿ.])(?<!\d,)"
"""No letter of a name, such as `J6`, and no other digit."""
_END: Final = r"(?![A-Za-z0-9À-ɏͰ-ӿ/²]| ?[·*.⋅-]? ?m{1,2}(?![A-Za-z]))"
"""No longer word, and no unit of a moment."""
_LOAD: Final = re.compile(
    rf"{_START}{_SIZE}(?: ?(?:±|\+/?-) ?\d{{1,5}}+(?:[.,]\d{{1,3}}+)?)?"
    rf"(?:[ _]?|(?P<cell> ?\"?[\t;,|]\"? ?)|(?P<comment>[ \t;]{{0,20}}[%#!/]{{1,2}} {{0,4}}))"
    rf"[\[(（［]?{_UNIT}{_END}"
)
"""A mass or a force, also with its unit in the next cell or in a comment."""
_LOAD_IN_NAME: Final = re.compile(
    rf"(?<![\d.,]){_SIZE}[ _]?(?P<unit>{_build_alternation(set(UNIT_OF_LOAD) - {'N', 'Н'})})(?![^\W\d_])"
)
"""A mass or a force in the name of a file, such as `load100kg`."""
_VALUE: Final = rf"[\"']? {{0,2}}[:=\t;,|：＝] {{0,2}}\"?{_SIZE}\"? {{0,9}}(?=[\t;,|] ?(?![\d.+−-])|[;,\s]*$)"
"""A number behind its name, which no other number follows."""
_FIELD: Final = re.compile(rf"(?P<mark>[\s_(\[/（［]){_UNIT}[)\]）］]?{_VALUE}")
"""A field whose name has the unit, such as `payload_kg: 8.0`."""
_BARE: Final = re.compile(rf"(?:^|(?<=[\t;|]))[\s\"'#%]{{0,4}}(?P<name>[^\W\d][\w .-]{{0,40}}?){_VALUE}")
"""A field without a unit, such as `payload_mass: 8.0`."""
_NUMBER: Final = r"([+−-]?\d{1,5}+(?:\.\d{1,6}+)?)"
_VECTOR: Final = re.compile(
    rf"[\s\"'#%]{{0,9}}(?P<name>[^\W\d][\w .()-]{{0,60}}?)[\"']? ?[:=] ?"
    rf"\[ ?{_NUMBER}[,;\s]{{1,3}}{_NUMBER}[,;\s]{{1,3}}{_NUMBER} ?\][ \t;,%#/]{{0,20}}{_UNIT}?(?![^\W_])"
)
"""A force in three numbers, such as `load.force: [0, 0, -120] N`."""
_AXIS: Final = re.compile(r"(?<![^\W_])(?P<sign>[+−–-]?)(?P<axis>[XYZxyz])(?![A-Za-z0-9_])")
_DIRECTION: Final = re.compile(
    r"(?: in| along)?(?: direction)? ?(?P<sign>[+−–-]?)(?P<axis>[XYZxyz])(?![A-Za-z0-9_])"
)
"""A direction behind a force, such as ` in -Z`."""
_CELLS: Final = re.compile(r"[\t;|,\"]|[.!?:] ")
"""What ends a cell or a sentence."""
_BEHIND: Final = re.compile(r"[\t;|,(\"]|[.!?:] ")
_NAME_SIGNS: Final = re.compile(r"[\s:=：＝]+")
"""What separates the words of a name, and ends it."""
_ASSIGNMENT: Final = re.compile(r"[=:]\s{0,4}$")
_LIST: Final = re.compile(
    r"(?<![A-Za-z0-9À-ɏͰ-ӿ.,])\d{1,5}+(?:[.,]\d{1,3}+)? ?"
    r"(?:[-–/+&~]|\.\.|…|, |to|and|or|bis|und|oder|et|ou|à|y|e|a|до|и) ?$"
)
"""Another number before a number: a list of loads, or a range."""
_TOLERANCE: Final = re.compile(r"(?:±|\+/?-) ?$")
"""Sign before an uncertainty."""
_THOUSANDS: Final = re.compile(r"(?<![^\W_])\d{1,3}[ '’]\d{3}$|(?<!\d)[1-9]\d{0,2}[.,]\d{3}$")
"""A number at the end of a text that may have a mark of thousands, such as `1 200` and `1.200`."""
_LETTERS: Final = frozenset(("N", "Н"))
"""Units that may be names of other things."""
_MARKS: Final = "#%!/*;'-> "
"""Marks of comments, before words."""
_MOST_CHARACTERS: Final = 400
"""Characters of a line that are searched: a line of words is short."""
_MOST_TEXTS: Final = 100_000
"""Texts of a file that are searched: a load is stated before many readings, or among them."""
_MOST_BEFORE: Final = 60
_MOST_WORDS: Final = 4
"""Words before a number that are quoted."""
_MOST_LOADS: Final = 3
"""Different loads of files that state the load in words; more are a column."""


def _compile_words(name: str, ending: str) -> re.Pattern[str]:
    """Return a pattern of the words that say something of a load; letters of Latin scripts begin a word."""
    words = _build_alternation(WORDS_OF_LOADS[name])
    return re.compile(rf"(?<![A-Za-zÀ-ɏͰ-ӿ])(?:{words}){ending}", re.IGNORECASE)


_ASIDE: Final = _compile_words("aside", "")
_DOWN: Final = _compile_words("down", "(?![A-Za-zÀ-ɏͰ-ӿ])")
_HUNG: Final = _compile_words("hung", "")
_LIMIT: Final = _compile_words("limit", "")
_BODY: Final = _compile_words(
    "body",
    r"(?:'?s)?[\s:=_.(-]{0,3}"
    r"(?:(?:mass|weight|gewicht|peso|poids|масса|вес|质量|質量|重)[^\W\d]{0,3})?[\s:=_(-]{0,3}$",
)
"""A body of its own mass at the end of the words before a number."""


class StatedLoad(NamedTuple):
    """Load that a file states in words."""

    file: str
    place: str  # in words, such as `line 2`; empty for the name of the file
    text: str  # as the file writes the load, with words before it
    newtons: float  # size
    force: str  # `0,0,-150kgf` in axes of R0 if the condition holds; empty if the text is not clear
    condition: str  # of the force, such as `this load hangs`
    is_certain: bool = False  # whether the text has a unit, and says that the load hangs or points down


def find_stated_loads(files: Sequence[SourceFile]) -> list[StatedLoad]:
    """Return the different loads that files state in words; none if there are many, as in a column."""
    loads: list[StatedLoad] = []
    for file in files:
        for statement in islice(read_statements(file), _MOST_TEXTS):
            for load in _read_loads(file.name, statement):
                sizes = (each.newtons for each in loads)
                if not any(isclose(load.newtons, size, rel_tol=_RELATIVE_TOLERANCE) for size in sizes):
                    loads.append(load)
            if len(loads) > _MOST_LOADS:
                return []
    return loads


def describe_stated_loads(loads: Sequence[StatedLoad]) -> str:
    """Return a sentence on the loads that files state in words, with the likely force; empty without one."""
    listed = ", ".join(map(describe_source, loads))
    if len(loads) != 1 or not loads[0].force:
        return listed
    return f"{listed}: if {loads[0].condition}, `force` is {loads[0].force}"


def describe_source(load: StatedLoad) -> str:
    """Return which file states a load, in its own words, and where."""
    return f'{quote(load.file)} says "{load.text}"' + (f" in {load.place}" if load.place else " in its name")


def _read_loads(file: str, statement: Statement) -> Iterator[StatedLoad]:
    """Yield the loads of a text."""
    place, text = statement.place, statement.text[:_MOST_CHARACTERS]
    vector = _VECTOR.match(text) if place else None
    if vector is not None:
        yield from _read_vector(file, place, vector)
        return
    found = list((_LOAD if place else _LOAD_IN_NAME).finditer(text))
    found = found or list(_FIELD.finditer(text)) or list(_BARE.finditer(text) if place else ())
    for match in found:
        if _read_size(match) > 0.0 and _is_load(text, match, is_name=not place):
            yield _read_load(file, place, text, match)


def _read_vector(file: str, place: str, found: re.Match[str]) -> Iterator[StatedLoad]:
    """Yield the load that a vector states, if its name is that of a force."""
    name, unit = found["name"].strip(), found["unit"]
    base, _, ending = name.rpartition("_")
    if unit is None and ending in UNIT_OF_LOAD:
        name, unit = base, ending
    numbers = [number.replace("−", "-") for number in found.groups()[1:4]]
    size = hypot(*map(float, numbers)) * find_newtons(UNIT_OF_LOAD[unit] if unit else "N")
    is_direction = unit is None and set(map(float, numbers)) <= {-1.0, 0.0, 1.0}
    if is_force(name.rpartition(".")[2]) and size > 0.0 and not is_direction:
        force = f"{','.join(numbers)}{UNIT_OF_LOAD[unit]}" if unit else ""
        text = " ".join(found[0].split()).strip(_MARKS)
        x, y, z = map(float, numbers)
        points_down = x == y == 0.0 and z < 0.0
        condition = "this force acts on the robot in axes of R0"
        yield StatedLoad(file, place, text, size, force, condition, bool(force) and points_down)


def _read_size(found: re.Match[str]) -> float:
    """Return the number of a load."""
    return float(found["size"].replace(",", "."))


def _is_load(text: str, found: re.Match[str], *, is_name: bool) -> bool:
    """Return whether a number with a unit, or with the name of a load, is not that of something else.

    Args:
        text: text of the file, or its name.
        found: the number in it.
        is_name: whether the text is the name of the file.
    """
    groups = found.groupdict()
    before = text[max(0, found.start() - _MOST_BEFORE) : found.start()]
    behind = _BEHIND.split(text[found.end() : found.end() + _MOST_BEFORE])[0]
    name = _find_words_before(before)
    is_named = any(is_hung(word) or is_force(word) for word in _NAME_SIGNS.split(name))
    if groups.get("cell") and (looks_like_a_number(name) or not re.search(r"[^\W\d_]", name)):
        return False  # a row of readings
    if groups.get("comment") and not _ASSIGNMENT.search(before):
        return False
    if _TOLERANCE.search(before):
        return False
    is_apart = bool(groups.get("cell")) or groups.get("mark", "_").isspace()
    if is_apart and groups.get("unit") in _LETTERS and not is_named:
        return False  # such as `N = 12`, a count
    if _read_size(found) == 1.0 and groups.get("unit", "N") in _LETTERS:
        return False  # 1 may be a state, and 1 N is no load of an arm
    if "name" in groups:
        return is_mass(found["name"])
    is_limit = bool(_LIMIT.search(name) or _LIMIT.match(behind.strip()))
    return not is_limit and (is_name or not _BODY.search(name))


def _find_words_before(before: str) -> str:
    """Return the words before a number in its cell or sentence, or else those of the cell before."""
    cells = _CELLS.split(before)
    is_cell_before = not cells[-1].strip() and not looks_like_a_number(cells[-2:][0].strip())
    return " ".join(cells[-2:]) if is_cell_before else cells[-1]  # words before a number name it


def _read_load(file: str, place: str, text: str, found: re.Match[str]) -> StatedLoad:
    """Return the load that a text states, with the words before the load in its cell or sentence."""
    groups = found.groupdict()
    before, end = text[: found.start()], found.end()
    direction = _DIRECTION.match(text, end) if "cell" in groups else None
    if direction is not None:
        end = direction.end()
    is_apart = bool(groups.get("cell"))
    shown = f"{found['size']} {found['unit']}" if is_apart else text[found.start() : end]
    words_before = _find_words_before(before[-_MOST_BEFORE:])
    count = _MOST_WORDS + len(shown.split())
    words = " ".join((words_before + shown).split()[-count:]).lstrip(_MARKS)
    unit = UNIT_OF_LOAD[groups.get("unit") or "kg"]
    number = found["size"].replace(",", ".")
    size = float(number) * find_newtons(unit)
    direction = direction or _find_direction(text, found)
    before_unit = text[: found.end("size")][-_MOST_BEFORE:]
    is_clear = not (_THOUSANDS.search(before_unit) or _LIST.search(before[-_MOST_BEFORE:]))
    if direction is not None:
        is_clear = is_clear and bool(direction["sign"])
        condition = "this force acts on the robot in axes of R0"
    else:
        is_clear = is_clear and not _ASIDE.search(text)
        condition = "this load hangs" if groups.get("unit") else "this mass is in kg and hangs"
        condition = "this load pulls down" if _DOWN.search(text) and groups.get("unit") else condition
    parts = ["0", "0", "0"]
    axis, sign = (direction["axis"], direction["sign"]) if direction else ("z", "-")
    parts["xyz".index(axis.casefold())] = ("" if sign == "+" else "-") + number
    force = f"{','.join(parts)}{unit}" if is_clear else ""
    return StatedLoad(file, place, words, size, force, condition, is_clear and _says_down(text, found))


def _says_down(text: str, found: re.Match[str]) -> bool:
    """Return whether a text says with a unit that its load hangs or pulls down, and negates nothing."""
    has_unit = bool(found.groupdict().get("unit"))
    is_negated = any(map(is_negation, _NAME_SIGNS.split(text.casefold())))
    return has_unit and bool(_HUNG.search(text) or _DOWN.search(text)) and not is_negated


def _find_direction(text: str, found: re.Match[str]) -> re.Match[str] | None:
    """Return the only axis with a sign in the text of a load, as in `500 N, -Y`; None without one."""
    near = text[max(0, found.start() - _MOST_BEFORE) : found.end() + _MOST_BEFORE]
    axes = [match for match in _AXIS.finditer(near) if match["sign"]]
    return axes[0] if len({match[0].casefold() for match in axes}) == 1 else None
