"""The grammar of headers: what one column means, by its header alone (docs/import.md).

The words are in words.toml.
"""

from __future__ import annotations

import glob
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import Final, Literal, NamedTuple

from jointstiff.schemas.imports import ImportOptions, State
from jointstiff.service.importing.errors import NOWHERE, ImportFileError, quote, show_object
from jointstiff.service.importing.phrases import (
    STATE_OF,
    join_phrases_of_header,
    split_words,
)
from jointstiff.service.importing.words import NO_LETTERS, WORDS, build_alternation, values_by_word
from jointstiff.service.tables.labels import LABEL_HEADERS, fold_word

Kind = Literal[
    "name", "collection", "group", "target", "state", "deleted", "time", "validation", "joint", "force",
    "mass", "moment", "load point", "position", "addition", "along", "uncertainty", "point uncertainty",
    "polar", "ignored", "unknown",
]  # fmt: skip
"""Content of the cells of a column, such as a joint angle, a force or the name of a target."""
Dimension = Literal["length", "angle", "force", "moment"]


# ---- words and units

_WORD_LISTS: Final[Mapping[str, Sequence[str]]] = WORDS["beside"]
_TEXT_KIND_OF: Final[Mapping[str, Kind]] = values_by_word({"name": LABEL_HEADERS, **WORDS["keys"]})
_OPPOSITES: Final[Mapping[str, Sequence[str]]] = WORDS["opposites"]
_VECTOR_OF: Final[Mapping[str, Kind]] = values_by_word(WORDS["vectors"])
_POLAR_OF: Final[Mapping[str, str]] = values_by_word(WORDS["polar"])
_POLAR_PARTS: Final[Sequence[str]] = list(WORDS["polar"])
WORDS_OF_ENCODINGS: Final[Mapping[str, Sequence[str]]] = WORDS["encodings"]
"""Encoding of one language → words of headers in lower case, which show that a text is in this encoding."""
MASSES: Final[Mapping[str, str]] = values_by_word(WORDS["masses"])
"""Columns of a table of masses by their headers."""
STEPS: Final[Mapping[str, str]] = values_by_word(WORDS["steps"])
"""Columns of a table of a weight step by their headers, without those of joint positions."""
MARKS: Final[Mapping[str, bool]] = MappingProxyType(
    {word: mark == "true" for word, mark in values_by_word(WORDS["marks"]).items()}
)
"""Words in the column `deleted`: True if the word marks its row as deleted."""
_MISSING_MARKS: Final = frozenset(("", *WORDS["missing"]["marks"]))
OPPOSITE_STATE: Final[Mapping[State | None, State]] = MappingProxyType(
    {"loaded": "unloaded", "unloaded": "loaded"}
)
STATE_OF_DIGIT: Final[Mapping[str, State]] = MappingProxyType({"0": "unloaded", "1": "loaded"})
"""States where nothing else can be meant; elsewhere a digit is part of a name."""
_LOAD_HEADERS: Final = frozenset(WORDS["answers"]["load"])
_REPEAT_HEADERS: Final = frozenset(WORDS["answers"]["repeat"])
_STATE_OF_ANSWER: Final[Mapping[str, State]] = MappingProxyType(
    {
        **dict.fromkeys(WORDS["answers"]["no"], "unloaded"),
        **dict.fromkeys(WORDS["answers"]["yes"], "loaded"),
    }
)
"""States of the words below a header such as `load`."""
_ADDED: Final = "plus"
"""With x, y or z: a deviation, to be added to that coordinate of the same target and state."""
_ALONG: Final = "along"
"""With x, y or z: a displacement along that axis of R0, read by a dial gauge."""
_RUNS: Final = frozenset(_WORD_LISTS["runs"])
_CERTAIN_STATES: Final = frozenset(_WORD_LISTS["certain"])
_PLANNED: Final = frozenset(_WORD_LISTS["planned"])
_NEGATIONS: Final = frozenset(_WORD_LISTS["negations"])
_AFTER: Final = frozenset(_WORD_LISTS["after"])
_KINDS: Final[Mapping[str, Kind]] = MappingProxyType(
    {**dict.fromkeys(_WORD_LISTS["expanded"], "uncertainty"), _ADDED: "addition", _ALONG: "along"}
)
"""Words in a header of a position that make the column another kind, such as an uncertainty."""
_NOT_TARGETS: Final = frozenset((*_WORD_LISTS["other"], *_WORD_LISTS["expanded"]))

_PRODUCT_SIGN: Final = re.compile(r"(?<=\w)[ ·*-](?=\w)")
_UNIT_OF_SPELLING: Final[Mapping[str, tuple[Dimension, str]]] = MappingProxyType(
    {
        spelling: (dimension, unit)
        for dimension, units in WORDS["units"].items()
        for unit, spellings in units.items()
        for spelling in spellings
    }
)
_UNIT_IN_LOWER_CASE: Final[Mapping[tuple[Dimension, str], str]] = MappingProxyType(
    {
        (dimension, spelling.lower()): unit
        for spelling, (dimension, unit) in _UNIT_OF_SPELLING.items()
        if dimension in ("force", "moment")
    }
)
"""Dimension and spelling of a unit in the names of a database, which have no upper case → unit."""
MICROMETRES: Final = tuple(_WORD_LISTS["micrometres"])
"""Spellings of the unit in which only displacements and uncertainties are taken."""
_DIMENSION_OF_FOREIGN: Final[Mapping[str, Dimension | Literal["none"]]] = MappingProxyType(
    {**values_by_word(WORDS["foreign"]), **dict.fromkeys(MICROMETRES, "length")}
)
UNIT_OF_LOAD: Final[Mapping[str, str]] = MappingProxyType(
    {
        spelling: unit
        for units in (WORDS["units"]["force"], WORDS["loads"]["masses"])
        for unit, spellings in units.items()
        for spelling in spellings
    }
)
"""Spelling of a unit of force or of mass → unit of the force or of the weight."""
WORDS_OF_LOADS: Final[Mapping[str, Sequence[str]]] = WORDS["loads"]["words"]
"""What a word says of a load beside it, such as `aside` → beginnings of words."""


class UnitOfReadings(NamedTuple):
    """Unit of readings whose file has another unit."""

    name: str
    factor: float  # numbers of the file are multiplied by it


CONVERTED_UNITS: Final[Mapping[str, UnitOfReadings]] = MappingProxyType(
    {"in": UnitOfReadings("mm", 25.4), "daN": UnitOfReadings("N", 10.0)}
)
"""Unit of a file that a measurement set cannot have → unit to which numbers are converted, exactly."""


def find_unit_of_readings(unit: str) -> UnitOfReadings:
    """Return the unit of readings whose file has a unit: another one if the file's is converted."""
    return CONVERTED_UNITS.get(unit, UnitOfReadings(unit, 1.0))


def name_unit(unit: str) -> str:
    """Return the name of a unit for a sentence: `inches` for `in`."""
    return "inches" if unit == "in" else unit


def find_known_unit(text: str) -> tuple[Dimension, str] | None:
    """Return dimension and canonical name of a unit that the import accepts; None for other texts."""
    spelling = _find_spelling(text, _UNIT_OF_SPELLING)
    return None if spelling is None else _UNIT_OF_SPELLING[spelling]


def find_any_unit(text: str) -> tuple[Dimension | None, str] | None:
    """Return dimension and name of any known unit, accepted or not; None if the text is not a unit.

    The dimension is None for a unit of another quantity than length, angle, force and moment.
    """
    known = find_known_unit(text)
    if known is not None:
        return known
    spelling = _find_spelling(text, _DIMENSION_OF_FOREIGN)
    if spelling is None:
        return None
    dimension = _DIMENSION_OF_FOREIGN[spelling]
    return None if dimension == "none" else dimension, spelling


def _find_spelling(text: str, spellings: Collection[str]) -> str | None:
    """Return the spelling of a unit, products as `N.m`: as it is written, or else a long word in lower case.

    None for other texts. The case of short units matters: mN is not MN, and nm is not Nm. `Grad` are degrees,
    and `grad` are not.
    """
    unit = _PRODUCT_SIGN.sub(".", text.strip())
    if unit not in spellings and len(unit) > 3 and unit.isalpha():
        unit = unit.casefold()
    return unit if unit in spellings else None


# ---- the grammar

POINTS: Final[tuple[Kind, ...]] = ("position", "addition", "along", "uncertainty", "point uncertainty")
_LENGTHS: Final[dict[Kind, Dimension]] = dict.fromkeys(("load point", *POINTS), "length")
DIMENSIONS: Final[Mapping[Kind, Dimension]] = MappingProxyType(
    {"joint": "angle", "force": "force", "mass": "force", "moment": "moment", **_LENGTHS}
)
_MAY_HAVE_UNITS: Final[frozenset[Kind]] = frozenset(("time", "ignored"))
_PARTS_OF_NAMES: Final[tuple[Kind, ...]] = ("collection", "group", "target", "name")
"""Columns whose texts are parts of the name of a point."""
UNKNOWN: Final = "columns"
"""Option that settles an unknown header."""


def collapse_blanks(text: str) -> str:
    """Return a text with runs of blanks as one blank, and without blanks at its ends."""
    return " ".join(text.split())


_JOINT: Final = re.compile(
    rf"(?:(?:{build_alternation(_WORD_LISTS['coordinates'])})[\s_-]+)?"
    rf"(?:{build_alternation(_WORD_LISTS['joints'])})[\s_-]?(?:([0-9]{{1,2}})|\[([0-9]{{1,2}})\])"
    rf"(?:[\s_-]+(?:{build_alternation(_WORD_LISTS['angles'])}))?",
    re.IGNORECASE,
)
"""A joint such as `J1`, `q[0]`, `actual_q_0` or `joint 1 angle`; one of two groups has its number."""
_VECTOR: Final = re.compile(
    rf"({build_alternation(_VECTOR_OF)})[\s_-]*([xyz])(?:[\s_-]+(?:R0|base|basis))?", re.IGNORECASE
)
"""A part of a vector such as `Fx`, in axes of R0 if the header names a frame."""
_FORCES: Final = [word for word, kind in _VECTOR_OF.items() if kind == "force"]
WORDS_OF_FORCE: Final = build_alternation(word for word in _FORCES if len(word) > 1 or not word.isascii())
"""Regular expression of the words for a force, without single letters."""
_NAMED_FORCE: Final = re.compile(
    rf"(?:{WORDS_OF_FORCE})(?:[\s_.-]*f[\s_-]*|\.)([xyz])(?:[\s_-]+(?:R0|base|basis))?", re.IGNORECASE
)
"""A part of a force after its word, such as `Kraft Fx`, or of a key such as `force.x`."""
_AXIS_OF_FORCE: Final = re.compile(rf"([xyz])[\s_-]+({WORDS_OF_FORCE})", re.IGNORECASE)
_WITH_FORCE: Final = build_alternation(_WORD_LISTS["forces"])
_BEFORE_FORCE: Final = rf"(?:(?:{_WITH_FORCE})[\s_.-]+){{0,2}}"
_BEHIND_FORCE: Final = rf"(?:[\s_.-]+(?:{_WITH_FORCE})){{0,2}}"
_LOAD: Final = (
    rf"{_BEFORE_FORCE}(?:{build_alternation((*_FORCES, *WORDS['answers']['load']))}){_BEHIND_FORCE}"
)
_QUALIFIED_FORCE: Final = rf"{_BEFORE_FORCE}(?:{build_alternation(_FORCES)}){_BEHIND_FORCE}"
_AXIS_OF_QUALIFIED_FORCE: Final = re.compile(
    rf"{_QUALIFIED_FORCE}[\s_.-]*([xyz]){_BEHIND_FORCE}(?:[\s_-]+(?:R0|base|basis))?", re.IGNORECASE
)
"""A part of a force with words that say no more, such as `F_ext x`, `Fx_ext` or `applied force x`."""
_FORMS_OF_FORCE: Final = (_NAMED_FORCE, _AXIS_OF_FORCE, _AXIS_OF_QUALIFIED_FORCE)
_AXIS_OF_LOAD: Final = re.compile(rf"{_LOAD}[\s_.-]*([xyz])(?:[\s_-]+(?:R0|base|basis))?", re.IGNORECASE)
"""A part of a load such as `load x` or `applied force in x`, which is a force only in a unit of force."""
_SIZE_OF_LOAD: Final = re.compile(
    rf"{_LOAD}|(?:{build_alternation(_WORD_LISTS['load cells'])})(?:[\s_-]*(?:force|\d{{1,2}}))?",
    re.IGNORECASE,
)
_DOWN_IN_HEADER: Final = re.compile(
    rf"[\s_]?[(\[（［]?(?<![A-Za-zÀ-ɏͰ-ӿ])(?:{build_alternation(WORDS['loads']['words']['down'])})"
    r"(?![A-Za-zÀ-ɏͰ-ӿ])[)\]）］]?",
    re.IGNORECASE,
)
"""Words for down in a header, also in brackets."""
_CAMEL_CASE: Final = re.compile(r"(?<=[^\W\d_A-Z])(?=[A-Z])")
"""Place between two words such as `LoadCell`."""
_NUMBERED_FORCE: Final = re.compile(rf"({_QUALIFIED_FORCE})[\s_-]?(?:([0-9])|\[([0-9])\])", re.IGNORECASE)
"""A force such as `F_1` or `Kraft[0]`, which is a part of a vector only if there are three of them."""
_NUMBERED_WRENCH: Final = re.compile(r"wrench[\s_-]?(?:([0-9])|\[([0-9])\])", re.IGNORECASE)
"""A part of a wrench such as `wrench 1`: of the force, then of the moment, if there are six of them."""
_FORCE_IN_HEADER: Final = re.compile(
    rf"(?<![^\W\d_])(?:(?:{WORDS_OF_FORCE})(?![^\W\d_])|f[\s_.-]?[xyz]\b)", re.IGNORECASE
)
"""A word for a force, or `Fx`, among other words of a header."""
_WEIGHT_OF_MASS: Final = values_by_word(WORDS["loads"]["masses"])
_UNIT_OF_MASS: Final = re.compile(
    rf"(?:(?<!\d)[\s_]|[/(\[（])({build_alternation(_WEIGHT_OF_MASS)})[)\]）]?$",
    re.IGNORECASE,
)
"""End of a header of masses, such as `weight_kg` or `Load (lb)`, but not of a load such as `6 kg`."""


_UNIT: Final = re.compile(r"(.*?)\s*_?(?:\[((?!\d+\])[^][]*)\]|\(([^()]*)\)|[/,]\s*([^][/,]+))")
_NUMBER_BEHIND_WORD: Final = re.compile(r"(?<=[^\W\d_]{5})(?=\d)")
_WIDE_SIGNS: Final = str.maketrans("（）［］【】／，", "()[][]/,")
"""Signs of East Asian texts → those of ASCII."""
_TOKEN: Final = re.compile(r"[^\s_]+")
_WORD_PIECE: Final = re.compile(r"[A-Z]?[^\W\dA-Z_]{2,}|[A-Z]{3,}(?![^\W\dA-Z_])")
_BRACKET: Final = re.compile(r"[][(){}]")
_COORDINATE: Final = re.compile(r"([dδΔ]?)([xyz])", re.IGNORECASE)
_AXIS_AND_WORD: Final = re.compile(r"([xyz])(\w+)|(\w+)([xyz])", re.IGNORECASE)
_WORDS_FOR_KG: Final = frozenset(("kg", "кг", "公斤", "千克", "킬로그램", "キログラム"))
_MASS_IN_KG: Final = re.compile(r"(.*)[ _]kg", re.IGNORECASE)
_SIGN: Final = re.compile(r"[-–—:|·,;]+")
"""A sign between words, such as that of `No load - T1`."""
_TRANSLATIONS: Final = frozenset(("tx", "ty", "tz"))
"""Coordinates if they are in a unit of length; else they may be moments."""


class Quantity(NamedTuple):
    """Quantity given by several columns: a vector, or all joint angles."""

    kind: Kind  # kind of the quantity
    target: str | None = None  # target of a position or its uncertainty, if the header names it
    state: State | None = None  # state of a position or its uncertainty, if the header names it

    def with_kind(self, kind: Kind) -> Quantity:
        """Return this quantity, of the same target and state, with another kind."""
        return self._replace(kind=kind)


@dataclass(frozen=True)
class Meaning:
    """Meaning of a column."""

    quantity: Quantity  # quantity that the column is a part of
    # number of the joint, or of the axis x, y, z, from 0; 0 of a point's uncertainty; None for texts
    axis: int | None = None
    unit: str | None = None  # canonical name of the unit; None if the header has no unit
    # whether the user should check it: the unit had no brackets, or 0 and 1 were read as states
    guessed: bool = False

    @property
    def kind(self) -> Kind:
        """Kind of the column's cells."""
        return self.quantity.kind

    @property
    def dimension(self) -> Dimension | None:
        """Dimension of the column's numbers, length for a joint in a unit of length; None for texts."""
        is_prismatic = self.kind == "joint" and self.unit in WORDS["units"]["length"]
        return "length" if is_prismatic else DIMENSIONS.get(self.kind)

    def __str__(self) -> str:
        """Return a header that is understood as this meaning, such as `P10 loaded x`."""
        kind, target, state = self.quantity
        if self.axis is None:
            return kind
        if kind == "joint":
            return f"joint {self.axis + 1}"
        axis = "xyz"[self.axis]
        if kind == "mass":
            return kind
        if kind not in POINTS:
            return f"{kind} {axis}"
        named = [word for word in (target, state) if word]
        if kind == "position":
            return " ".join([*(named or ["position"]), axis])
        if kind == "along":
            return target or kind
        if kind == "addition":
            return " ".join([*named, _ADDED, axis])
        return " ".join([*named, "U95", *(axis if kind == "uncertainty" else ())])


def find_state(word: str, extra: Mapping[str, State]) -> State | None:
    """Return the state that a word means, in upper or lower case; None for other words.

    Args:
        word: word of a name or a header.
        extra: the caller's words for states, which take precedence over the built-in ones.
    """
    text = "" if word != word.strip() else fold_word(word)
    for key, state in extra.items():
        if fold_word(key) == text:
            return state
    return STATE_OF.get(text) or STATE_OF.get(text.rstrip("."))


def read_states(words: Iterable[str], extra: Mapping[str, State]) -> dict[str, State]:
    """Return word → state of words that tell the readings of a point apart; without words of no state.

    `after` means loaded only where no other word does: next to `before` and `loaded`, the load is off again.
    Of words such as `bez` and `z`, only both together are states.

    Args:
        words: words of headers, names or cells.
        extra: the caller's words for states, which take precedence.
    """
    given = list(words)
    known = {word: state for word in given if (state := find_state(word, extra)) is not None}
    states = find_opposites(given) | known
    stated = {fold_word(word) for word in extra}
    loaded = {fold_word(word) for word, state in states.items() if state == "loaded"}
    after = (loaded & _AFTER) - stated
    if not loaded - after or "unloaded" not in states.values():
        return states
    return {word: "unloaded_after" if fold_word(word) in after else state for word, state in states.items()}


def find_opposites(words: Collection[str]) -> dict[str, State]:
    """Return word → state of words for `without` and `with` in one language, if both are among some words."""
    states = dict[str, State]()
    for word in words:
        partners = _OPPOSITES.get(fold_word(word), ())
        others = [other for other in words if fold_word(other) in partners]
        if others:
            states |= {word: "unloaded", **dict.fromkeys(others, "loaded")}
    return states


def is_likely_unloaded(word: str) -> bool:
    """Return whether a word that may be a state more likely means without load: `ref`, `zero` or `false`."""
    is_no = _STATE_OF_ANSWER.get(fold_word(word)) == "unloaded"
    return is_no or fold_word(word) in _WORD_LISTS["likely unloaded"]


def is_negation(word: str) -> bool:
    """Return whether a word negates others, such as `not`."""
    return fold_word(word) in _NEGATIONS


def is_load_header(header: str) -> bool:
    """Return whether a header says that the cells of its column tell whether a load hangs."""
    return fold_word(split_unit(header)[0]) in _LOAD_HEADERS


def names_load_or_state(header: str) -> bool:
    """Return whether a header has a word for a load or a state, such as `load_id`."""
    words = {fold_word(word) for word in NO_LETTERS.split(header) if word}
    return not words.isdisjoint((*_LOAD_HEADERS, *_WORD_LISTS["hung"], *WORDS["keys"]["state"]))


def is_force(name: str) -> bool:
    """Return whether a name without an axis is that of a force, such as `F`, `force_N` or `Kraft [kN]`."""
    base, unit = _split_any_unit(name)
    return _VECTOR_OF.get(fold_word(base)) == "force" and (unit is None or _is_unit_of("force", unit))


def find_unit_of_size(header: str) -> str | None:
    """Return the unit of force of a load without an axis, such as `Kraft [kN]` or `LoadCell_N`; else None.

    Words for down, as in `Zugkraft (nach unten) [kN]`, say no more than a weight, whose direction is checked.
    """
    base, unit = split_unit(_DOWN_IN_HEADER.sub(" ", header))
    base, unit_of_name = split_unit_suffix(base) or (base, unit)
    base = _CAMEL_CASE.sub(" ", base)
    unit = unit or unit_of_name
    known = None if unit is None or unit_of_name != unit else find_known_unit(unit)
    is_force = known is not None and known[0] == "force" and _SIZE_OF_LOAD.fullmatch(base) is not None
    return known[1] if known is not None and is_force else None


def find_unit_of_force(header: str) -> str | None:
    """Return the unit of force of a header with any words, such as `Cell 3 [N]`; None without such a unit."""
    known = find_known_unit(split_unit(header)[1] or "")
    return known[1] if known is not None and known[0] == "force" else find_unit_of_size(header)


def find_force_at_end(header: str) -> str | None:
    """Return the unit of force that a header ends with, as in `pull newton` or `F [N]`; None without one."""
    base, unit = split_unit(header)
    _, ending = split_unit_suffix(base) or (base, None)
    known = find_known_unit(unit or ending or "")
    return known[1] if known is not None and known[0] == "force" else None


def looks_like_a_force(header: str) -> bool:
    """Return whether a header has a word for a force or a wrench, or a unit of force."""
    base, unit = split_unit(header)
    words = {fold_word(word) for word in NO_LETTERS.split(base)}
    has_unit = _is_unit_of("force", unit) or find_unit_of_size(header) is not None
    return has_unit or bool(_FORCE_IN_HEADER.search(base)) or "wrench" in words


def find_unknown_unit(header: str) -> tuple[Dimension, str] | None:
    """Return the dimension of a force, a moment or a load point, and its unit if the unit is not known.

    None for other headers, without a unit, and for the weight of a mass.
    """
    base, unit = split_unit(header)
    if unit is None or unit in UNIT_OF_LOAD:
        return None
    dimension: Dimension | None = "force" if looks_like_a_force(base) else None
    with suppress(ImportFileError):
        meaning = parse_header(base, {})
        dimension = meaning.dimension if meaning.kind in ("force", "moment", "load point") else dimension
    return None if dimension is None or _is_unit_of(dimension, unit) else (dimension, unit)


def list_units(dimension: Dimension) -> list[str]:
    """Return the units of a dimension that the import accepts."""
    return list(WORDS["units"][dimension])


def is_hung(header: str) -> bool:
    """Return whether a header has a word for a load that hangs, such as `payload`, with any unit or none."""
    base = fold_word(split_unit(header)[0])
    return base in _WORD_LISTS["hung"] or base in _WORD_LISTS["hung in kg"]


def is_mass(name: str) -> bool:
    """Return whether all words of a name are those of a load that hangs, and one is such without a unit."""
    words = {fold_word(word) for word in NO_LETTERS.split(name) if word}
    return not words.isdisjoint(_WORD_LISTS["hung"]) and words.issubset(
        (*_WORD_LISTS["hung"], *_WORD_LISTS["hung in kg"])
    )


def find_unit_of_weight(header: str) -> str | None:
    """Return the unit of weight by the unit of mass that ends a header, such as `lbf` of lb; else None."""
    found = _UNIT_OF_MASS.search(header)
    return None if found is None else _WEIGHT_OF_MASS[found[1].lower()]


def is_no_load_header(header: str) -> bool:
    """Return whether a header says that the cells of its column tell whether no load hangs."""
    return fold_word(split_unit(header)[0]) in WORDS["answers"]["no load"]


def find_answer(word: str) -> State | None:
    """Return the state that a word means below a header such as `load`: `no` or `yes`; None for others."""
    return _STATE_OF_ANSWER.get(fold_word(word.strip()))


def is_cycle_header(header: str) -> bool:
    """Return whether a header says that its column may count the postures, such as `cycle`."""
    return fold_word(header) in _WORD_LISTS["cycles"]


def is_posture_header(header: str) -> bool:
    """Return whether a header says that its column has the numbers of the postures, such as `pose_id`."""
    return fold_word(header) in _WORD_LISTS["posture numbers"]


def is_repeat_header(header: str) -> bool:
    """Return whether a header says that its column counts the repeated readings of a point."""
    return fold_word(header) in _REPEAT_HEADERS


def is_run(word: str) -> bool:
    """Return whether a word of a title means a run with all readings, or a repeat."""
    return fold_word(word) in _RUNS or is_repeat_header(word)


def contains_state_word(name: str, extra: Mapping[str, State]) -> bool:
    """Return whether a name contains a word for a state; `extra` are the caller's words."""
    return any(find_state(word, extra) for word in split_words(name))


def find_state_in_name(name: str, extra: Mapping[str, State]) -> State | None:
    """Return the only state that the words of a long name mean; None if they mean none, or several.

    The caller's words, `extra`, take precedence. Of the others, words that mean something else in other names
    are not enough, such as `on`, `last` or `before`, and with a negation no word is. A number may follow a
    word without a blank, as in `Loaded150`.
    """
    words = split_words(_NUMBER_BEHIND_WORD.sub(" ", name))
    found = _list_stated_states(words, extra)
    if found or not any(fold_word(word) in _CERTAIN_STATES for word in words):
        return next(iter(found)) if len(found) == 1 else None
    is_negated = any(fold_word(word) in _NEGATIONS for word in words)
    return None if is_negated else join_states(words, {})


def find_stated_state(name: str, stated: Mapping[str, State]) -> State | None:
    """Return the only state that the caller's words give a name, or the words of a name; else None."""
    found = _list_stated_states([name], stated) or _list_stated_states(split_words(name), stated)
    return next(iter(found)) if len(found) == 1 else None


def _list_stated_states(words: Iterable[str], stated: Mapping[str, State]) -> set[State]:
    """Return the states that the caller's words give some words."""
    state_of = {fold_word(word): state for word, state in stated.items()}
    return {state_of[fold_word(word)] for word in words if fold_word(word) in state_of}


def join_states(words: Iterable[str], extra: Mapping[str, State]) -> State | None:
    """Return the only state that words of a name mean together; None if they mean none, or several.

    Next to a word for unloaded, a word for `after` means after unloading; next to one for loaded, nothing.
    `extra` are the caller's words for states.
    """
    state_of_word = {word: state for word in words if (state := find_state(word, extra)) is not None}
    stated = {fold_word(word) for word in extra}
    after = {word for word in state_of_word if fold_word(word) in _AFTER - stated}
    states = {state for word, state in state_of_word.items() if word not in after}
    if after and states == {"unloaded"}:
        return "unloaded_after"
    states = states or set(state_of_word.values())
    return states.pop() if len(states) == 1 else None


def is_key(text: str) -> bool:
    """Return whether a text is the header of a column of texts, such as `label` or `target`."""
    return fold_word(text) in _TEXT_KIND_OF


_STATISTICS: Final = frozenset(
    word.replace("-", " ") for word in (*_WORD_LISTS["statistics"], *_WORD_LISTS["extremes"])
)
"""Words at the beginning of rows of statistics, without full stops and hyphens."""
_EXTREMES: Final = frozenset(_WORD_LISTS["extremes"])


def lacks_number(text: str) -> bool:
    """Return whether a cell is empty, or has a mark such as `n/a` in place of a number."""
    return text.casefold() in _MISSING_MARKS


def is_statistic(text: str) -> bool:
    """Return whether a text, the first of a row, says that the row has statistics of the other rows."""
    return _name_statistic(text) in _STATISTICS


def is_extreme(text: str) -> bool:
    """Return whether a text says that its row has the least or the greatest numbers of the other rows."""
    return _name_statistic(text) in _EXTREMES


def _name_statistic(text: str) -> str:
    """Return a text without the signs that may surround the name of a statistic, and without brackets."""
    return " ".join(re.sub(r"\([^()]*\)|[.:*-]", " ", fold_word(text)).split())


def _name_joint_of_maker(name: str) -> str:
    """Return the name of a joint without words that say no more: `S-axis` gives `s`, `wrist1` `wrist 1`."""
    spaced = re.sub(r"(?<=[^\W\d])(?=\d)", " ", fold_word(name).replace("-", " "))
    others = {*_WORD_LISTS["joints"], *_WORD_LISTS["angles"]}
    words = spaced.split()
    kept = [word for word in words if word not in others]
    return " ".join(kept or words)


def _group_paths(names: Iterable[str]) -> dict[tuple[str, ...], dict[str, str]]:
    """Return form → joint → folded path of names with slashes or dots; `*` is the joint's place in a form."""
    found: dict[tuple[str, ...], dict[str, str]] = {}
    for name in names:
        parts = [part for part in _PATH_SEPARATOR.split(name) if part]
        if not 1 < len(parts) <= _MOST_PARTS:
            continue
        for place, part in enumerate(parts):
            form = (*parts[:place], "*", *parts[place + 1 :])
            found.setdefault(form, {})[_name_joint_in_path(part)] = fold_word(name)
    return found


def _name_joint_in_path(part: str) -> str:
    """Return the name of a joint, a part of a path: `joint 1` of a number with a word for a joint."""
    number = None if part.isdecimal() else joint_number(part)
    return _name_joint_of_maker(part) if number is None else f"joint {number}"


def _has_word(form: Iterable[str], words: Collection[str]) -> bool:
    """Return whether a part of a path has one of some words."""
    return any(word in words for part in form for word in fold_word(part).split())


def is_planned(header: str, states: Mapping[str, State] = MappingProxyType({})) -> bool:
    """Return whether a header names a coordinate that was not measured, such as `X nominal` or `Zsoll`.

    A word that the caller states to be one of `states` is a reading.
    """
    name = fold_word(split_unit(header)[0])
    words = [word.strip(".") for word in name.split()]
    joined = [word[1:] for word in words if word[:1] in "xyz"]
    has_axis = any(_COORDINATE.fullmatch(word) for word in words) or any(joined)
    planned = _PLANNED - set(map(fold_word, states))
    return has_axis and not planned.isdisjoint([*words, *joined])


def find_planned_axis(header: str) -> tuple[str, str] | None:
    """Return word and axis of a coordinate that was not measured, such as `nominal` and `x`; else None."""
    name = split_unit(header)[0]
    axes = [word.casefold() for word in name.split() if word.casefold() in ("x", "y", "z")]
    words = [word for word in name.split() if fold_word(word).strip(".") in _PLANNED]
    return (words[0], axes[0]) if len(words) == len(axes) == 1 else None


def is_joint(text: str) -> bool:
    """Return whether a text is a word for a joint without the joint's number."""
    return fold_word(split_unit(text)[0]) in _WORD_LISTS["joints"]


def joint_number(text: str) -> int | None:
    """Return the joint's number in a text such as `2`, `J2` or `axis 2`; None for other texts."""
    match = _JOINT.fullmatch(text)
    number = match[1] or match[2] if match else text
    return int(number) if number.isascii() and number.isdecimal() and len(number) < 3 else None


def split_unit(header: str) -> tuple[str, str | None]:
    """Split a header such as `x [mm]`, `x (mm)`, `x/mm` or `x, mm` into name and unit; None without a unit.

    A text after a slash or a comma is a unit only if the import accepts that unit.
    """
    # The pattern needs quadratic time for runs of blanks.
    header = collapse_blanks(header).translate(_WIDE_SIGNS)
    match = _UNIT.fullmatch(header)
    if match is None:
        return header, None
    base, in_square_brackets, in_round_brackets, after_sign = match.groups()
    if after_sign is not None:
        after_sign = after_sign.strip("() ")
        is_unit = after_sign in _WORDS_FOR_KG or find_known_unit(after_sign) is not None
        return (base, after_sign) if is_unit else (header, None)
    if in_round_brackets is not None and fold_word(header).rpartition(" ")[2] in _WORD_LISTS["expanded"]:
        return header, None
    return base, in_square_brackets if in_square_brackets is not None else in_round_brackets


def parse_polar(header: str) -> Meaning | None:
    """Return the meaning of a header of a polar reading, such as `Hz [gon]`; None for other headers.

    The axis is 0 for the horizontal angle, 1 for the vertical angle, 2 for the distance. The unit is None
    without a unit of an angle, or of a length for the distance.
    """
    name, text = split_unit(header)
    part = _POLAR_OF.get(fold_word(name))
    if part is None:
        return None
    unit = find_any_unit(text or "")
    dimension = "length" if part == "distance" else "angle"
    known = unit[1] if unit is not None and unit[0] == dimension else None
    return Meaning(Quantity("polar"), _POLAR_PARTS.index(part), known)


def parse_header(header: str, state_words: Mapping[str, State]) -> Meaning:
    """Return the meaning of the column below one header; `state_words` are the caller's words for states.

    Raises:
        ImportFileError: the header is not understood, or its unit does not fit.
    """
    base, unit = split_unit(header)
    key = _TEXT_KIND_OF.get(fold_word(base)) or _find_kind_of_path(base)
    if key is not None:
        if unit is not None and key not in _MAY_HAVE_UNITS:
            reason = f"the header {quote(header)} has a unit, but its column has texts"
            raise ImportFileError(NOWHERE, reason, "correct the header, or remove its unit")
        return Meaning(Quantity(key))
    if unit is None and (mass := _MASS_IN_KG.fullmatch(base)) and fold_word(mass[1]) in _WORD_LISTS["hung"]:
        base, unit = mass[1], "kg"
    if unit in _WORDS_FOR_KG:
        unit = "kg"
    is_load_in_kg = unit == "kg" and fold_word(base) in _WORD_LISTS["hung in kg"]
    if is_load_in_kg or fold_word(base) in _WORD_LISTS["hung"]:
        if unit not in ("kg", "kgf"):
            reason = f"{quote(header)}: the unit of a hung mass must be kg"
            raise ImportFileError(NOWHERE, reason, "write `mass [kg]`, or give forces")
        return Meaning(Quantity("mass"), 0, "kgf")
    if unit == "kg" and _VECTOR_OF.get(fold_word(base)) == "force":
        reason = f"unknown column header {quote(header)}: kg is the unit of a mass, not of a force"
        example = show_object({header: "mass [kg]"})
        remedy = f"if it is a hung mass, write `mass [kg]`, or give `columns`: {example}"
        raise ImportFileError(NOWHERE, reason, remedy, UNKNOWN)
    split_suffix = None if unit is not None else _split_unit_of_name(base)
    base, unit = split_suffix or (base, unit)
    base = _name_by_unit(base, unit)
    meaning = _parse_quantity(header, base, state_words)
    unit = check_unit(header, unit, meaning.kind)
    return replace(meaning, unit=unit, guessed=meaning.guessed or split_suffix is not None)


def is_target(name: str) -> bool:
    """Return whether a header of a position with a name, a state and an axis is understood with this name."""
    try:
        meaning = parse_header(f"{name} unloaded x [mm]", {})
    except ImportFileError:
        return False
    return meaning.quantity == Quantity("position", name, "unloaded")


def _find_kind_of_path(header: str) -> Kind | None:
    """Return the kind of a column of whole names, such as `Collection::Group::Target`; None for others."""
    parts = header.split("::")
    are_parts = len(parts) > 1 and all(
        _TEXT_KIND_OF.get(fold_word(part)) in _PARTS_OF_NAMES for part in parts
    )
    return "name" if are_parts else None


def _name_by_unit(base: str, unit: str | None) -> str:
    """Return a name that its unit makes certain: `x` for `tx` in mm, `force x` for `load x` in N."""
    if fold_word(base) in _TRANSLATIONS and _is_unit_of("length", unit):
        return base[1:]
    load = _AXIS_OF_LOAD.fullmatch(base)
    return f"force {load[1]}" if load is not None and _is_unit_of("force", unit) else base


def _is_unit_of(dimension: Dimension, unit: str | None) -> bool:
    """Return whether a header has a unit of a dimension; False without a unit."""
    known = None if unit is None else find_known_unit(unit)
    return known is not None and known[0] == dimension


def _parse_quantity(header: str, base: str, state_words: Mapping[str, State]) -> Meaning:
    """Return the meaning of a header: a joint, or a coordinate of a vector or a position.

    `header` is the whole text, for messages; `base` is the header without its unit.

    Raises:
        ImportFileError: the header is not understood.
    """
    if joint := _JOINT.fullmatch(base):
        return Meaning(Quantity("joint"), int(joint[1] or joint[2]) - 1)
    if vector := _VECTOR.fullmatch(base):
        kind = _VECTOR_OF[fold_word(vector[1].replace("-", " "))]
        return Meaning(Quantity(kind), "xyz".index(vector[2].casefold()))
    if force := next(filter(None, (form.fullmatch(base) for form in _FORMS_OF_FORCE)), None):
        return Meaning(Quantity("force"), "xyz".index(force[1].casefold()))
    return _parse_position(header, base, state_words)


def split_unit_suffix(base: str) -> tuple[str, str] | None:
    """Split a header such as `theta1_rad` or `force_x_N` into name and unit; None if it ends with no unit."""
    for count in (2, 1):  # the unit may be one word or two, such as `N m`
        parts = list(_TOKEN.finditer(base))
        if len(parts) > count and find_known_unit(unit := " ".join(part[0] for part in parts[-count:])):
            return base[: parts[-count].start()].rstrip(" _"), unit
    return None


def _split_unit_of_name(base: str) -> tuple[str, str] | None:
    """Split a header with a unit behind its name into both, also `fx_kn` and `mx_nm`; None without a unit.

    Names of a database have no upper case, and the vector says which unit is meant.
    """
    if split := split_unit_suffix(base):
        return split
    name, _, ending = base.rpartition("_")
    vector = _VECTOR.fullmatch(name) if base.islower() else None
    if vector is None:
        return None
    dimension = DIMENSIONS[_VECTOR_OF[fold_word(vector[1].replace("-", " "))]]
    unit = _UNIT_IN_LOWER_CASE.get((dimension, ending))
    return None if unit is None else (name, unit)


def _split_any_unit(header: str) -> tuple[str, str | None]:
    """Split a header such as `S [deg]` or `S grader` into name and unit; None without a unit."""
    base, unit = split_unit(header)
    return (base, unit) if unit is not None else (split_unit_suffix(base) or (base, None))


def check_unit(header: str, text: str | None, kind: Kind) -> str | None:
    """Return the canonical name of a header's unit; None if the header has no unit.

    Raises:
        ImportFileError: the unit is not one of the dimension that columns of this kind have.
    """
    if text is None:
        return None
    dimension, known = DIMENSIONS[kind], find_known_unit(text)
    if kind == "joint" and known is not None and known[0] == "length":
        return known[1]
    if known is None or known[0] != dimension:
        reason = f"{quote(header)}: {quote(text)} is not a known unit of {dimension}"
        remedy = f"convert to one of {', '.join(list_units(dimension))}"
        hung = "; write a hung mass as `mass [kg]`" if text == "kg" and kind == "force" else ""
        raise ImportFileError(NOWHERE, reason, remedy + hung)
    return known[1]


def _parse_position(header: str, base: str, state_words: Mapping[str, State]) -> Meaning:
    """Return the meaning of a header such as `P10_x_loaded`, `P10 dx`, `P10 U95 x` or `P10 plus x`.

    The words may have any order, but those of the target's name must be adjacent. A header such as
    `tip along z` or `dial gauge z` is a reading along an axis, and its target is named after the axis, too.

    Raises:
        ImportFileError: the header is not understood.
    """
    words = _classify_words(join_phrases_of_header(base), state_words)
    if "deflection" in words.states:
        words.states.discard("loaded")  # a displacement is one under load
    is_gauge = words.names_gauge
    kind: Kind = "along" if is_gauge else words.kind
    axis_count = 0 if kind == "point uncertainty" else 1
    is_ambiguous = len(words.kinds) > 1 or len(words.states) > 1 or len(words.axes) != axis_count
    if is_ambiguous or not words.name_is_possible:
        raise ImportFileError(
            NOWHERE,
            f"unknown column header {quote(header)}",
            "use headers such as `label`, `J1 [deg]`, `Fx [N]`, `P10 unloaded x [mm]`, `P10 loaded x "
            "[mm]`, `P10 dx [mm]`, `tip along z [mm]` of a gauge, `x [mm]`; give the meaning of this "
            "header in `columns`, or skip its column with `ignore`",
            UNKNOWN,
        )
    target, state = words.target, next(iter(words.states), None)
    if kind != "along":
        axis = words.axes[0] if words.axes else 0
        return Meaning(Quantity(kind, target, state), axis)
    if target is None or state not in (None, "deflection"):
        reason = (
            f"{quote(header)}: a reading along an axis needs the name of a target, and the state "
            "`deflection` or no state"
        )
        raise ImportFileError(NOWHERE, reason, "write a header such as `tip along z [mm]`")
    target_and_axis = f"{target} {_ALONG} {'xyz'[words.axes[0]]}"
    return Meaning(Quantity("along", target_and_axis, "deflection"), 0, guessed=is_gauge)


@dataclass(frozen=True)
class _Words:
    """Words of a header of positions: `P10 U95 x` has the kind `uncertainty`, the axis 0, the name `P10`."""

    base: str  # header without its unit
    axes: list[int]  # axes that words name: x is 0
    states: set[State]  # states that words name
    kinds: set[Kind]  # kinds that words name; none for a position
    others: list[re.Match[str]]  # remaining words, which make the name of the target

    @property
    def target(self) -> str | None:
        """Name of the target: the text from the first to the last remaining word; None without such words."""
        return self.base[self.others[0].start() : self.others[-1].end()] if self.others else None

    @property
    def _name_words(self) -> list[str]:
        """Words of the target's name, with words between these that name something else."""
        return _TOKEN.findall(self.target or "")

    @property
    def name_is_possible(self) -> bool:
        """Return whether the words of the target's name are adjacent, and none is a word such as `sigma`."""
        words = self._name_words
        return len(words) == len(self.others) and not any(map(_is_no_target_word, words))

    @property
    def names_gauge(self) -> bool:
        """Return whether the target is a gauge by its name (`dial gauge`), and no word contradicts that."""
        gauge_words = set(_WORD_LISTS["gauges"]).intersection(map(fold_word, self._name_words))
        return bool(gauge_words) and not self.kinds and self.states <= {"deflection"}

    @property
    def kind(self) -> Kind:
        """Kind of the numbers; an uncertainty without an axis is that of a whole point."""
        kind: Kind = min(self.kinds, default="position")  # a header with two kinds is refused
        return "point uncertainty" if kind == "uncertainty" and not self.axes else kind


def _classify_words(base: str, state_words: Mapping[str, State]) -> _Words:
    """Return the words of a header without its unit by what they name."""
    words = _Words(base, [], set(), set(), [])
    for token in _TOKEN.finditer(base):
        word = fold_word(token[0])
        if coordinate := _COORDINATE.fullmatch(token[0]):
            words.axes.append("xyz".index(coordinate[2].casefold()))
            if coordinate[1]:
                words.states.add("deflection")
        elif state := find_state(token[0], state_words):
            words.states.add(state)
        elif stated := _split_stated_word(token[0], state_words):
            axis, state = stated
            words.axes.append("xyz".index(axis))
            words.states.add(state)
        elif word in _KINDS:
            words.kinds.add(_KINDS[word])
        elif word not in _WORD_LISTS["coordinates"]:
            words.others.append(token)
    _strip_signs(words.others)
    return words


def _strip_signs(tokens: list[re.Match[str]]) -> None:
    """Remove the signs before the first word, and behind the last."""
    while tokens and _SIGN.fullmatch(tokens[-1][0]):
        tokens.pop()
    while tokens and _SIGN.fullmatch(tokens[0][0]):
        tokens.pop(0)


def _split_stated_word(word: str, state_words: Mapping[str, State]) -> tuple[str, State] | None:
    """Return axis and state of a word such as `X1`, if the caller states a state for `1`; else None."""
    found = _AXIS_AND_WORD.fullmatch(word)
    if found is None or not state_words:
        return None
    for axis, text in ((found[1], found[2]), (found[4], found[3])):
        stated = {fold_word(key): state for key, state in state_words.items()}
        state = stated.get(fold_word(text)) if text else None
        if state is not None:
            return axis.casefold(), state
    return None


def _is_no_target_word(word: str) -> bool:
    """Return whether a word cannot be part of a target's name, such as `sigma`, `StdDev`, `P10Std` or `[`."""
    pieces = [fold_word(piece) for piece in (word, re.sub(r"\W", "", word), *_WORD_PIECE.findall(word))]
    return bool(_BRACKET.search(word)) or not _NOT_TARGETS.isdisjoint(pieces)


def split_along_target(target: str) -> tuple[str, int]:
    """Split the target of a reading along an axis into name and axis: `tip along z` into `tip` and 2."""
    name, _, axis = target.rpartition(f" {_ALONG} ")
    return name, "xyz".index(axis)


_PATH_SEPARATOR: Final = re.compile(r"[/.]")
_MOST_PARTS: Final = 8
"""Parts of the path of a joint."""
_NUMBERED_JOINTS: Final = (
    [f"joint {number}" for number in range(1, 8)],
    [f"joint {number}" for number in range(1, 7)],
    [f"joint {number}" for number in range(6)],
)
"""Joints of seven axes, and of six, by their numbers."""
_NO_ANGLES: Final = frozenset(
    ("velocity", "velocities", "vel", "effort", "efforts", "torque", "torques", "current", "currents",
     "acceleration", "accelerations", "acc", "temperature", "error", "errors", "x", "y", "z")
)  # fmt: skip
"""Words of a path whose numbers are no angles."""
_PLANNED_ANGLES: Final = frozenset(("desired", "target", "reference", "command", "commanded", "goal"))
"""Words of a path whose angles were not measured."""


_PARTS_OF_WRENCH: Final[Sequence[tuple[Kind, int]]] = (
    ("force", 0), ("force", 1), ("force", 2), ("moment", 0), ("moment", 1), ("moment", 2),
)  # fmt: skip
"""Kind and axis of each number of a wrench."""


class Vocabulary:
    """Grammar of headers, with words and meanings that the caller states, and names of a robot's joints."""

    def __init__(self, options: ImportOptions, joints: Sequence[str] = ()) -> None:
        """Take the words for states, the ignored headers and the stated meanings from the options.

        `joints` are the names of the robot's joints, which columns may have; empty without a robot.
        """
        self._names = tuple(joints)
        self._joints = {fold_word(name): number for number, name in enumerate(joints)}
        self._loads: dict[str, tuple[Kind, int]] = {}  # header without its unit → kind and axis
        self.states = options.state_words
        self._ignored = options.ignore
        self.stated = {collapse_blanks(text): meaning for text, meaning in options.columns.items()}

    def add_names_of_table(self, headers: Sequence[str]) -> None:
        """Know names that only all headers of a table explain: a maker's joints, and numbered loads."""
        self._add_joints_of_makers(headers)
        self._add_numbered_loads(headers)

    def _add_numbered_loads(self, headers: Iterable[str]) -> None:
        """Know the numbers of a force as its axes, such as F1 F2 F3, if a table has exactly three.

        The six numbers of a wrench are those of the force, then those of the moment.
        """
        names_of_word: dict[str, dict[int, str]] = {}
        for header in headers:
            name, _ = split_unit(header)
            if found := _NUMBERED_FORCE.fullmatch(name):
                number = int(found[2] or found[3])
                names_of_word.setdefault(fold_word(found[1]), {})[number] = fold_word(name)
            elif found := _NUMBERED_WRENCH.fullmatch(name):
                names_of_word.setdefault("wrench", {})[int(found[1] or found[2])] = fold_word(name)
        for word, names in names_of_word.items():
            numbers = sorted(names)
            parts = _PARTS_OF_WRENCH if word == "wrench" else _PARTS_OF_WRENCH[:3]
            if len(numbers) == len(parts) and numbers[0] in (0, 1) and numbers[-1] - numbers[0] < len(parts):
                self._loads.update(zip((names[number] for number in numbers), parts, strict=True))

    def _add_joints_of_makers(self, headers: Iterable[str]) -> None:
        """Know the names of a maker for the joints, such as S L U R B T, if a table has all of them."""
        names = [_split_any_unit(header)[0] for header in headers]
        name_of_joint = {_name_joint_of_maker(name): fold_word(name) for name in names}
        for joints in WORDS["makers"].values():
            if name_of_joint.keys() >= set(joints):
                self._joints.update({name_of_joint[joint]: number for number, joint in enumerate(joints)})
        self._add_joints_in_paths(names)

    def _add_joints_in_paths(self, names: Iterable[str]) -> None:
        """Know paths with the names of all joints, such as `/joint_states/elbow_joint/position`.

        Paths of one form differ in the joint only. Of several forms that of measured angles counts; none if
        this is not clear.
        """
        orders = [*WORDS["makers"].values(), *_NUMBERED_JOINTS]
        orders.append([_name_joint_in_path(name) for name in self._names])
        found = []
        for form, path_of_joint in _group_paths(names).items():
            joints = next((each for each in orders if each and path_of_joint.keys() >= set(each)), None)
            if joints is not None and not _has_word(form, _NO_ANGLES):
                found.append((form, {path_of_joint[joint]: axis for axis, joint in enumerate(joints)}))
        measured = [each for each in found if not _has_word(each[0], _PLANNED_ANGLES)]
        chosen = measured if len(found) > 1 else found
        if len(chosen) == 1:
            self._joints.update(chosen[0][1])

    def meaning(self, header: str, *, guessed: bool) -> Meaning:
        """Return the meaning of a header: as the caller states it, else as the grammar understands it.

        A stated meaning keeps the unit of the header. `guessed` marks a meaning from the grammar as a guess.

        Raises:
            ImportFileError: the header is not understood, or its unit differs from the stated one.
        """
        text = collapse_blanks(header)
        if self.is_ignored(text):
            return Meaning(Quantity("ignored"))
        stated = self.stated.get(text)
        meaning = self._parse(header if stated is None else _add_unit_of_mass(header, stated))
        if stated is None:
            return replace(meaning, guessed=meaning.guessed or guessed)
        return meaning if meaning.axis is None else _apply_header_unit(text, stated, meaning)

    def find(self, header: str) -> Meaning | None:
        """Return the meaning of a header by the grammar; None if the header is unknown.

        A header that the caller ignores or gives a meaning is known, and returned as `ignored`.
        """
        text = collapse_blanks(header)
        if self.is_ignored(text) or text in self.stated or fold_word(split_unit(header)[0]) == "q0":
            return Meaning(Quantity("ignored"))
        try:
            return self._parse(header)
        except ImportFileError:
            return None

    def is_ignored(self, header: str) -> bool:
        """Return whether the caller ignores a header."""
        return any(fits_header(pattern, header) for pattern in self._ignored)

    def is_stated(self, header: str) -> bool:
        """Return whether the caller states the meaning of a header."""
        return collapse_blanks(header) in self.stated

    def _parse(self, header: str) -> Meaning:
        """Return the meaning of a header by the grammar, or of a joint by its name.

        Raises:
            ImportFileError: the header is not understood.
        """
        name, unit = _split_any_unit(header)
        number = self._joints.get(fold_word(name))
        load = self._loads.get(fold_word(name))
        if load is not None and number is None:
            kind, axis = load
            return Meaning(Quantity(kind), axis, check_unit(header, unit, kind), guessed=True)
        if number is None:
            return parse_header(header, self.states)
        with suppress(ImportFileError):
            meaning = parse_header(header, self.states)
            if meaning.kind != "joint":  # such as x of a gantry, which is also a coordinate
                return meaning
        return Meaning(Quantity("joint"), number, check_unit(header, unit, "joint"))

    def count_known(self, headers: Iterable[str]) -> int:
        """Return the number of known headers; 0 if fewer than two are known, as one may be known by chance.

        0 also if two headers name the same axis of the same quantity: then these texts are no headers.
        """
        meanings = [meaning for text in headers if text and (meaning := self.find(text))]
        axes = [(meaning.quantity, meaning.axis) for meaning in meanings if meaning.axis is not None]
        return 0 if len(set(axes)) < len(axes) or len(meanings) < 2 else len(meanings)


def fits_header(pattern: str, header: str) -> bool:
    """Return whether a header is the one that a text names, in which * stands for any characters."""
    parts = collapse_blanks(pattern).split("*")
    return fnmatchcase(collapse_blanks(header), "*".join(map(glob.escape, parts)))


def _add_unit_of_mass(header: str, stated: str) -> str:
    """Return a stated meaning; a hung mass that states no unit has the unit in brackets of its header."""
    unit = split_unit(header)[1]
    is_mass_without_unit = fold_word(stated) in _WORD_LISTS["hung"]
    return f"{stated} [{unit}]" if is_mass_without_unit and unit is not None else stated


def _apply_header_unit(header: str, stated: str, meaning: Meaning) -> Meaning:
    """Return a meaning that the caller states, with the unit of the file's header if the header has a unit.

    A text in square brackets is a unit, as is an end of two letters, such as kN, but for the word `in`. A
    letter is a unit only if its dimension fits: the t of a position `x_t` is not a tonne, and the m of `x_m`
    is not a metre if the caller states a unit. A unit of mass may be that of a hung mass.

    Raises:
        ImportFileError: the header's unit differs from the stated one, or has another dimension.
    """
    in_brackets = split_unit(header)[1]
    *words_before, word_at_end = header.replace("_", " ").split(" ")
    last_word = word_at_end if in_brackets is None else in_brackets
    known = find_any_unit(last_word)
    is_same_mass = meaning.kind == "mass" and UNIT_OF_LOAD.get(last_word) == meaning.unit
    if is_same_mass:
        return meaning
    is_prismatic = (
        meaning.kind == "joint" and in_brackets is not None and known is not None and known[0] == "length"
    )
    dimension = "length" if is_prismatic else meaning.dimension
    is_long = bool(words_before) and len(last_word) > 1 and last_word != "in"
    is_unit_at_end = is_long and find_known_unit(last_word) is not None
    is_unit_in_brackets = in_brackets is not None and (known is not None or header.endswith("]"))
    is_certainly_unit = is_unit_at_end or is_unit_in_brackets
    m_is_no_unit = header.endswith("_m") and meaning.unit is not None
    if not is_certainly_unit and (m_is_no_unit or known is None or known[0] != dimension):
        return meaning
    accepted_unit = find_known_unit(last_word)
    if accepted_unit is None:
        # This raises an error, because the import does not accept the unit.
        check_unit(header, last_word, meaning.kind)
    elif accepted_unit[0] != dimension or meaning.unit not in (None, accepted_unit[1]):
        reason = f"{quote(header)} is in {name_unit(accepted_unit[1])}, but `columns` states {quote(stated)}"
        raise ImportFileError(
            NOWHERE, reason, "correct the header or `columns`; a unit is never converted silently"
        )
    return replace(meaning, unit=accepted_unit and accepted_unit[1], guessed=in_brackets is None)
