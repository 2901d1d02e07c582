"""The grammar of headers: what one column means, by its header alone (docs/import.md).

The words are in words.toml.
"""

from __future__ import annotations

import re
import tomllib
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from types import MappingProxyType
from typing import Final, Literal, NamedTuple, TypeVar

from jointstiff.schemas.imports import ImportOptions, State
from jointstiff.service.importing.errors import NOWHERE, ImportFileError, shown

Kind = Literal[
    "name", "collection", "group", "target", "state", "deleted", "time", "validation", "joint", "force",
    "mass", "moment", "load point", "position", "addition", "along", "uncertainty", "point uncertainty",
    "ignored", "unknown",
]  # fmt: skip
"""What the cells of a column are."""
Dimension = Literal["length", "angle", "force", "moment"]
_Value = TypeVar("_Value")


def _values_by_word(groups: Mapping[_Value, Iterable[str]]) -> Mapping[str, _Value]:
    return MappingProxyType({word: value for value, group in groups.items() for word in group})


# ---- words and units

_WORDS: Final = tomllib.loads(files(__package__).joinpath("words.toml").read_text("utf-8"))
_BESIDE: Final[Mapping[str, Sequence[str]]] = _WORDS["beside"]
_KEY_OF: Final[Mapping[str, Kind]] = _values_by_word(_WORDS["keys"])
_STATE_OF: Final[Mapping[str, State]] = _values_by_word(_WORDS["states"])
_VECTOR_OF: Final[Mapping[str, Kind]] = _values_by_word(_WORDS["vectors"])
MASSES: Final[Mapping[str, str]] = _values_by_word(_WORDS["masses"])
"""Columns of a table of masses by their headers."""
MARKS: Final[Mapping[str, bool]] = MappingProxyType(
    {word: mark == "true" for word, mark in _values_by_word(_WORDS["marks"]).items()}
)
"""Whether a cell below `deleted` marks its row."""
DIGITS: Final[Mapping[str, State]] = MappingProxyType({"0": "unloaded", "1": "loaded"})
"""States where nothing else can be meant; elsewhere a digit is part of a name."""
_ADDED: Final = "plus"
"""With x, y or z: a deviation, to be added to that coordinate of the same target and state."""
_ALONG: Final = "along"
"""With x, y or z: a displacement along that axis of R0, read by a dial gauge."""
_KINDS: Final[Mapping[str, Kind]] = MappingProxyType(
    {**dict.fromkeys(_BESIDE["expanded"], "uncertainty"), _ADDED: "addition", _ALONG: "along"}
)
"""Words that make something else of a position."""
_NOT_TARGETS: Final = frozenset((*_BESIDE["other"], *_BESIDE["expanded"]))

_PRODUCT: Final = re.compile(r"(?<=\w)[ ·*-](?=\w)")
INCH: Final = 25.4
"""Millimetres, exactly: what is in inches is converted when it is read."""
_SPELT: Final[Mapping[str, tuple[Dimension, str]]] = MappingProxyType(
    {
        spelling: (dimension, unit)
        for dimension, units in _WORDS["units"].items()
        for unit, spellings in units.items()
        for spelling in spellings
    }
)
_FOREIGN: Final[Mapping[str, Dimension | Literal["none"]]] = _values_by_word(_WORDS["foreign"])


def spoken(unit: str) -> str:
    """Return a unit as it reads in a sentence."""
    return "inches" if unit == "in" else unit


def unit_named(text: str) -> tuple[Dimension, str] | None:
    """Return the dimension and canonical name of a unit; None if it is none of ours."""
    return _SPELT.get(_normalise_unit(text))


def any_unit(text: str) -> tuple[Dimension | None, str] | None:
    """Return the dimension and name of a unit, ours or a foreign one; None if it is none."""
    spelt = _normalise_unit(text)
    if spelt in _SPELT:
        return _SPELT[spelt]
    dimension = _FOREIGN.get(spelt)
    return None if dimension is None else (None if dimension == "none" else dimension, spelt)


def _normalise_unit(text: str) -> str:
    """Return a unit without blanks at its ends; of whole words upper and lower case are the same."""
    plain = _PRODUCT.sub(".", text.strip())
    return plain.casefold() if len(plain) > 3 and plain.isalpha() else plain  # mN is no MN, and nm no Nm


# ---- the grammar

POINTS: Final[tuple[Kind, ...]] = ("position", "addition", "along", "uncertainty", "point uncertainty")
_LENGTHS: Final[dict[Kind, Dimension]] = dict.fromkeys(("load point", *POINTS), "length")
DIMENSIONS: Final[Mapping[Kind, Dimension]] = MappingProxyType(
    {"joint": "angle", "force": "force", "mass": "force", "moment": "moment", **_LENGTHS}
)
_MAY_HAVE_UNITS: Final[frozenset[Kind]] = frozenset(("time", "ignored"))
UNKNOWN: Final = "columns"
"""Option that settles an unknown header."""


def folded(text: str) -> str:
    """Return a text by which words are compared: lower case, composed, single blanks for `_` and blanks."""
    return " ".join(unicodedata.normalize("NFC", text).casefold().replace("_", " ").split())


def collapsed(text: str) -> str:
    """Return a text with single blanks, and none at its ends."""
    return " ".join(text.split())


def _alternation(texts: Iterable[str]) -> str:
    """Return a pattern of texts, the longest first; blanks in them may be any."""
    longest = sorted(texts, key=len, reverse=True)
    return "|".join(re.escape(text).replace("\\ ", r"[\s_-]+") for text in longest)


_JOINT: Final = re.compile(rf"(?:{_alternation(_BESIDE['joints'])})[\s_-]?([0-9]{{1,2}})", re.IGNORECASE)
_VECTOR: Final = re.compile(rf"({_alternation(_VECTOR_OF)})[\s_-]*([xyz])", re.IGNORECASE)
_PHRASE: Final = re.compile(
    rf"(?<![^\s_])(?:{_alternation(word for word in _STATE_OF if ' ' in word)})(?![^\s_])", re.IGNORECASE
)
_UNIT: Final = re.compile(r"(.*?)\s*_?(?:\[([^][]*)\]|\(([^()]*)\)|/\s*([^/]+))")
_TOKEN: Final = re.compile(r"[^\s_]+")
_PIECE: Final = re.compile(r"[A-Z]?[^\W\dA-Z_]{2,}|[A-Z]{3,}(?![^\W\dA-Z_])")
_BRACKET: Final = re.compile(r"[][(){}]")
_COORDINATE: Final = re.compile(r"([dδΔ]?)([xyz])", re.IGNORECASE)
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

    quantity: Quantity  # that the column is a part of
    # number of the joint, or of the axis x, y, z, from 0; 0 of a point's uncertainty; None for texts
    axis: int | None = None
    unit: str | None = None  # canonical, if the header names it
    guessed: bool = False  # whether it is to be checked: the unit stood without brackets, 0 and 1 as states

    @property
    def kind(self) -> Kind:
        """Kind of the column's cells."""
        return self.quantity.kind

    @property
    def dimension(self) -> Dimension | None:
        """Dimension of its numbers: a joint in a unit of length is prismatic; None of texts."""
        slides = self.kind == "joint" and self.unit in _WORDS["units"]["length"]
        return "length" if slides else DIMENSIONS.get(self.kind)

    def __str__(self) -> str:
        """Return words that are read as the same meaning."""
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


def state_named(word: str, extra: Mapping[str, State]) -> State | None:
    """The state that a word means, or None; upper and lower case are the same.

    Args:
        word: to look up.
        extra: the caller's words, which come before ours.
    """
    text = "" if word != word.strip() else folded(word)
    for key, state in extra.items():
        if folded(key) == text:
            return state
    return _STATE_OF.get(text)


def names_a_state(name: str, extra: Mapping[str, State]) -> bool:
    """Return whether a name has a word for a state."""
    return any(state_named(word, extra) for word in re.split(r"[\W_]+", name))


def is_key(text: str) -> bool:
    """Return whether a text is the header of a column of texts."""
    return folded(text) in _KEY_OF


def is_joint(text: str) -> bool:
    """Return whether a text is a word for a joint, which needs its number."""
    return folded(split_unit(text)[0]) in _BESIDE["joints"]


def joint_number(text: str) -> int | None:
    """Return the number of a joint by `2`, `J2` or `axis 2`; None for another name."""
    match = _JOINT.fullmatch(text)
    number = match[1] if match else text
    return int(number) if number.isascii() and number.isdecimal() and len(number) < 3 else None


def split_unit(header: str) -> tuple[str, str | None]:
    """`x [mm]`, `x (mm)` or `x/mm` as name and unit; what follows a slash must be one of ours."""
    header = collapsed(header)  # runs of blanks would cost the pattern their square
    match = _UNIT.fullmatch(header)
    if match is None:
        return header, None
    base, bracketed, round_, slashed = match.groups()
    if slashed is not None:
        slashed = slashed.strip("() ")
        return (base, slashed) if unit_named(slashed) else (header, None)
    if round_ is not None and folded(header).rpartition(" ")[2] in _BESIDE["expanded"]:
        return header, None
    return base, bracketed if bracketed is not None else round_


def meaning_of(header: str, state_words: Mapping[str, State]) -> Meaning:
    """Understand one header cell."""
    base, unit = split_unit(header)
    key = _KEY_OF.get(folded(base))
    if key is not None:
        if unit is not None and key not in _MAY_HAVE_UNITS:
            reason = f"{shown(header)} has a unit, but is a column of texts"
            raise ImportFileError(NOWHERE, reason, "check the header")
        return Meaning(Quantity(key))
    if folded(base) in _BESIDE["hung"]:
        if unit not in ("kg", "kgf"):
            reason = f"{shown(header)}: a hung mass is in kg"
            raise ImportFileError(NOWHERE, reason, "write `mass [kg]`, or give forces")
        return Meaning(Quantity("mass"), 0, "kgf")
    suffixed = None if unit is not None else _split_suffix(base)
    base, unit = suffixed or (base, unit)
    if folded(base) in _TRANSLATIONS and unit is not None and (unit_named(unit) or [""])[0] == "length":
        base = base[1:]
    meaning = _quantity(header, base, state_words)
    unit = checked_unit(header, unit, meaning.kind)
    return replace(meaning, unit=unit, guessed=meaning.guessed or suffixed is not None)


def _quantity(header: str, base: str, state_words: Mapping[str, State]) -> Meaning:
    """Return the quantity that a header without its unit names."""
    if joint := _JOINT.fullmatch(base):
        if not joint[1].strip("0"):
            reason = f"{shown(header)}: joints are numbered from 1"
            raise ImportFileError(NOWHERE, reason, "number them 1, 2, …")
        return Meaning(Quantity("joint"), int(joint[1]) - 1)
    if vector := _VECTOR.fullmatch(base):
        kind = _VECTOR_OF[folded(vector[1].replace("-", " "))]
        return Meaning(Quantity(kind), "xyz".index(vector[2].casefold()))
    return _position(header, base, state_words)


def _split_suffix(base: str) -> tuple[str, str] | None:
    """`theta1_rad`, `force_x_N` as name and unit, or None."""
    for count in (2, 1):
        parts = list(_TOKEN.finditer(base))
        if len(parts) > count and unit_named(unit := " ".join(part[0] for part in parts[-count:])):
            return base[: parts[-count].start()].rstrip(" _"), unit
    return None


def checked_unit(header: str, text: str | None, kind: Kind) -> str | None:
    """Return the canonical name of a unit; None if there is none."""
    if text is None:
        return None
    dimension, known = DIMENSIONS[kind], unit_named(text)
    if kind == "joint" and known is not None and known[0] == "length":
        return known[1]
    if known is None or known[0] != dimension:
        reason = f"{shown(header)}: {shown(text)} is not a known unit of {dimension}"
        remedy = f"convert to one of {', '.join(_WORDS['units'][dimension])}"
        hung = "; a hung mass is `mass [kg]`" if text == "kg" and kind == "force" else ""
        raise ImportFileError(NOWHERE, reason, remedy + hung)
    return known[1]


def _position(header: str, base: str, state_words: Mapping[str, State]) -> Meaning:
    """`P10_x_loaded`, `P10 dx`, `P10 U95 x`, `P10 plus x`: words in any order, the target's in one piece.

    Each axis of `tip along z` or `dial gauge z` is a reading of its own, whose name says it.
    """
    base = _PHRASE.sub(lambda phrase: _STATE_OF[folded(phrase[0].replace("-", " "))], base)
    axes, states, kinds, rest = _sorted_words(base, state_words)
    target = base[rest[0].start() : rest[-1].end()] if rest else None
    named = _TOKEN.findall(target or "")
    gauges = set(_BESIDE["gauges"]).intersection(map(folded, named))
    gauged = bool(gauges) and not kinds and states <= {"deflection"}
    meant: Kind = min(kinds, default="position")
    if gauged:
        meant = "along"
    if meant == "uncertainty" and not axes:
        meant = "point uncertainty"
    unclear = len(kinds) > 1 or len(axes) != (meant != "point uncertainty") or len(states) > 1
    if unclear or len(named) != len(rest) or any(map(_no_target, named)):
        raise ImportFileError(
            NOWHERE,
            f"unknown column header {shown(header)}",
            "use headers such as `label`, `J1 [deg]`, `Fx [N]`, `P10 unloaded x [mm]`, `P10 loaded x "
            "[mm]`, `P10 dx [mm]`, `tip along z [mm]` of a gauge, `x [mm]`; give its meaning in `columns`, "
            "or skip it with `ignore`",
            UNKNOWN,
        )
    state = next(iter(states), None)
    if meant != "along":
        return Meaning(Quantity(meant, target, state), sum(axes))
    if target is None or state not in (None, "deflection"):
        reason = f"{shown(header)}: a reading along an axis has a target, and is a deflection"
        raise ImportFileError(NOWHERE, reason, "write a header such as `tip along z [mm]`")
    return Meaning(Quantity("along", f"{target} {_ALONG} {'xyz'[axes[0]]}", "deflection"), 0, guessed=gauged)


def _sorted_words(
    base: str, state_words: Mapping[str, State]
) -> tuple[list[int], set[State], set[Kind], list[re.Match[str]]]:
    """Return axes, states and kinds that words of a header name, and the words that name none."""
    axes: list[int] = []
    states: set[State] = set()
    kinds: set[Kind] = set()
    rest = []
    for token in _TOKEN.finditer(base):
        word = folded(token[0])
        if coordinate := _COORDINATE.fullmatch(token[0]):
            axes.append("xyz".index(coordinate[2].casefold()))
            states.update(["deflection"] if coordinate[1] else [])
        elif state := state_named(token[0], state_words):
            states.add(state)
        elif word in _KINDS:
            kinds.add(_KINDS[word])
        elif word not in _BESIDE["coordinates"]:
            rest.append(token)
    return axes, states, kinds, rest


def _no_target(word: str) -> bool:
    """Return whether a word tells of something other than a position: `sigma`, `StdDev`, `P10Std`, `[`."""
    pieces = [folded(piece) for piece in (word, re.sub(r"\W", "", word), *_PIECE.findall(word))]
    return bool(_BRACKET.search(word)) or not _NOT_TARGETS.isdisjoint(pieces)


def along_axis(target: str) -> tuple[str, int]:
    """Return target and axis of a reading along an axis: those of `tip along z` are `tip` and 2."""
    name, _, axis = target.rpartition(f" {_ALONG} ")
    return name, "xyz".index(axis)


class Vocabulary:
    """The grammar of headers with the words and the meanings that the caller states."""

    def __init__(self, options: ImportOptions) -> None:
        """Take the caller's words."""
        self.states = options.state_words
        self.ignored = {collapsed(text) for text in options.ignore}
        self.stated = {collapsed(text): meaning for text, meaning in options.columns.items()}

    def meaning(self, header: str, *, guessed: bool) -> Meaning:
        """Return the meaning of a header, or the one that is stated, in the unit of the file if it has one.

        Raises:
            ImportFileError: it is not understood, or the units differ.
        """
        text = collapsed(header)
        if text in self.ignored:
            return Meaning(Quantity("ignored"))
        stated = self.stated.get(text)
        meaning = meaning_of(header if stated is None else stated, self.states)
        if stated is None:
            return replace(meaning, guessed=meaning.guessed or guessed)
        named = meaning.axis is None or meaning.kind == "mass"
        return meaning if named else _in_unit_of(text, stated, meaning)

    def find(self, header: str) -> Meaning | None:
        """Return what a header may mean; None if it is not understood."""
        text = collapsed(header)
        if text in self.ignored or text in self.stated or folded(split_unit(header)[0]) == "q0":
            return Meaning(Quantity("ignored"))
        try:
            return meaning_of(header, self.states)
        except ImportFileError:
            return None

    def count_known(self, headers: Iterable[str]) -> int:
        """Return how many are understood; 0 if two are the same part of a quantity, or only one is."""
        found = [meaning for text in headers if text and (meaning := self.find(text))]
        parts = [(meaning.quantity, meaning.axis) for meaning in found if meaning.axis is not None]
        return 0 if len(set(parts)) < len(parts) or len(found) < 2 else len(found)


def _in_unit_of(header: str, stated: str, meaning: Meaning) -> Meaning:
    """Return a meaning that the caller states, in the unit of the header if it has one.

    Text in square brackets is a unit. Any other tail is one only if it is one of this dimension: the t
    of a position `x_t` is no tonne, and the m of `x_m` no metre if the caller states a unit.
    """
    bracketed = split_unit(header)[1]
    tail = bracketed if bracketed is not None else header.replace("_", " ").split(" ")[-1]
    known = any_unit(tail)
    slides = meaning.kind == "joint" and bracketed is not None and known is not None and known[0] == "length"
    dimension = "length" if slides else meaning.dimension
    certain = bracketed is not None and (known is not None or header.endswith("]"))
    measured = header.endswith("_m") and meaning.unit is not None
    if not certain and (measured or known is None or known[0] != dimension):
        return meaning
    ours = unit_named(tail)
    if ours is None:
        checked_unit(header, tail, meaning.kind)  # which refuses it
    elif ours[0] != dimension or meaning.unit not in (None, ours[1]):
        reason = f"{shown(header)} is in {spoken(ours[1])}, but {shown(stated)} by `columns`"
        raise ImportFileError(
            NOWHERE, reason, "correct the header or `columns`; a unit is never converted silently"
        )
    return replace(meaning, unit=ours and ours[1], guessed=bracketed is None)
