"""The grammar of headers: what one column means, by its header alone (docs/import.md)."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final, TypeVar

from jointstiff.schemas.importing import State
from jointstiff.service.importing import words
from jointstiff.service.importing.errors import Fault, shown
from jointstiff.service.importing.words import UNITS, Dimension, Kind, unit_named

DIMENSIONS: Final[Mapping[Kind, Dimension]] = MappingProxyType(
    {
        "joint": "angle",
        "force": "force",
        "moment": "moment",
        "load point": "length",
        "position": "length",
        "addition": "length",
        "along": "length",
        "uncertainty": "length",
        "point uncertainty": "length",
    }
)
POINTS: Final[frozenset[Kind]] = frozenset(
    ("position", "addition", "along", "uncertainty", "point uncertainty")
)
_MAY_HAVE_UNITS: Final[frozenset[Kind]] = frozenset(("temperature", "time", "ignored"))
UNKNOWN: Final = "columns"
"""Option that settles an unknown header."""

_Value = TypeVar("_Value")


def folded(text: str) -> str:
    """Return a text by which words are compared: lower case, composed, single blanks for `_` and blanks."""
    return " ".join(unicodedata.normalize("NFC", text).casefold().replace("_", " ").split())


def collapsed(text: str) -> str:
    """Return a text with single blanks, and none at its ends."""
    return " ".join(text.split())


def _by_word(groups: Iterable[tuple[_Value, Iterable[str]]]) -> Mapping[str, _Value]:
    return MappingProxyType({word: value for value, group in groups for word in group})


def _either(texts: Iterable[str]) -> str:
    """Return a pattern of texts, the longest first; blanks in them may be any."""
    longest = sorted(texts, key=len, reverse=True)
    return "|".join(re.escape(text).replace("\\ ", r"[\s_-]+") for text in longest)


_KEYS: Final[Mapping[str, Kind]] = _by_word(words.KEYS.items())
_STATES: Final[Mapping[str, State]] = _by_word(words.STATES.items())
_VECTORS: Final[Mapping[str, Kind]] = _by_word(words.VECTORS.items())
_JOINT: Final = re.compile(rf"(?:{_either(words.JOINTS)})[\s_-]?([0-9]{{1,2}})", re.IGNORECASE)
_VECTOR: Final = re.compile(rf"({_either(_VECTORS)})[\s_-]*([xyz])", re.IGNORECASE)
_PHRASE: Final = re.compile(
    rf"(?<![^\s_])(?:{_either(word for word in _STATES if ' ' in word)})(?![^\s_])", re.IGNORECASE
)
_UNIT: Final = re.compile(r"(.*?)\s*_?(?:\[([^][]*)\]|\(([^()]*)\)|/\s*([^/]+))")
_TOKEN: Final = re.compile(r"[^\s_]+")
_PIECE: Final = re.compile(r"[A-Z]?[^\W\dA-Z_]{2,}|[A-Z]{3,}(?![^\W\dA-Z_])")
_BRACKET: Final = re.compile(r"[][(){}]")
_COORDINATE: Final = re.compile(r"([dδΔ]?)([xyz])", re.IGNORECASE)


@dataclass(frozen=True)
class Meaning:
    """Meaning of a column."""

    kind: Kind  # kind of its cells
    # number of the joint, or of the axis x, y, z, from 0; 0 of a point's uncertainty; None for texts
    axis: int | None = None
    target: str | None = None  # target of a position or its uncertainty, if the header names it
    state: State | None = None  # state of a position or its uncertainty, if the header names it
    unit: str | None = None  # canonical, if the header names it; of a temperature as it is written
    guessed: bool = False  # whether it is to be checked: the unit stood without brackets, 0 and 1 as states

    def __str__(self) -> str:
        """Return words that are read as the same meaning."""
        if self.kind == "joint":
            return f"joint {(self.axis or 0) + 1}"
        if self.axis is None:
            return self.kind
        if self.kind not in POINTS:
            return f"{self.kind} {'xyz'[self.axis]}"
        named = [word for word in (self.target, self.state) if word]
        if self.kind == "position":
            return " ".join([*(named or ["position"]), "xyz"[self.axis]])
        if self.kind == "along":
            return self.target or self.kind
        if self.kind == "addition":
            return " ".join([*named, words.ADDED, "xyz"[self.axis]])
        return " ".join([*named, "U95", *("xyz"[self.axis] if self.kind == "uncertainty" else ())])

    @property
    def quantity(self) -> Quantity:
        """Quantity that the column is a part of."""
        return Quantity(self.kind, self.target, self.state)

    @property
    def part(self) -> tuple[Quantity, int | None]:
        """Quantity and axis, which no two columns share."""
        return self.quantity, self.axis


@dataclass(frozen=True)
class Quantity:
    """Quantity given by several columns: a vector, or all joint angles."""

    kind: Kind  # kind of the quantity
    target: str | None = None  # target of a position, if the header names it
    state: State | None = None  # state of a position, if the header names it


def state_named(word: str, extra: Mapping[str, State]) -> State | None:
    """The state a word stands for, or None; upper and lower case are the same.

    Args:
        word: to look up.
        extra: the caller's words, which come before ours.
    """
    text = "" if word != word.strip() else folded(word)
    for key, state in extra.items():
        if folded(key) == text:
            return state
    return _STATES.get(text)


def names_a_state(name: str, extra: Mapping[str, State]) -> bool:
    """Return whether a name has a word for a state."""
    return any(state_named(word, extra) for word in re.split(r"[\W_]+", name))


def is_key(text: str) -> bool:
    """Return whether a text is the header of a column of texts."""
    return folded(text) in _KEYS


def is_joint(text: str) -> bool:
    """Return whether a text is a word for a joint, which needs its number."""
    return folded(split_unit(text)[0]) in words.JOINTS


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
    if round_ is not None and folded(header).rpartition(" ")[2] in words.EXPANDED:
        return header, None
    return base, bracketed if bracketed is not None else round_


def meaning_of(header: str, state_words: Mapping[str, State]) -> Meaning:
    """Understand one header cell.

    Raises:
        Fault: it is not in the grammar.
    """
    base, unit = split_unit(header)
    key = _KEYS.get(folded(base))
    if key is not None:
        if unit is not None and key not in _MAY_HAVE_UNITS:
            raise Fault(f"{shown(header)} has a unit, but is a column of texts", "check the header")
        return Meaning(key, unit=unit if key == "temperature" else None)
    suffixed = None if unit is not None else _split_suffix(base)
    base, unit = suffixed or (base, unit)
    meaning = _quantity(header, base, state_words)
    return replace(meaning, unit=checked_unit(header, unit, meaning.kind), guessed=suffixed is not None)


def _split_suffix(base: str) -> tuple[str, str] | None:
    """`theta1_rad`, `force_x_N` as name and unit, or None."""
    for count in (2, 1):
        parts = list(_TOKEN.finditer(base))
        if len(parts) > count and unit_named(unit := " ".join(part[0] for part in parts[-count:])):
            return base[: parts[-count].start()].rstrip(" _"), unit
    return None


def checked_unit(header: str, text: str | None, kind: Kind) -> str | None:
    """Return the canonical name of a unit; None if there is none.

    Raises:
        Fault: it is none of this kind's quantities.
    """
    if text is None:
        return None
    dimension = DIMENSIONS[kind]
    known = unit_named(text)
    if known is None or known[0] != dimension:
        raise Fault(
            f"{shown(header)}: {shown(text)} is not a known unit of {dimension}",
            f"convert to one of {', '.join(UNITS[dimension])}",
        )
    return known[1]


def _quantity(header: str, base: str, state_words: Mapping[str, State]) -> Meaning:
    if joint := _JOINT.fullmatch(base):
        if joint[1] == "0" * len(joint[1]):
            raise Fault(f"{shown(header)}: joints are numbered from 1", "number them 1, 2, …")
        return Meaning("joint", int(joint[1]) - 1)
    if vector := _VECTOR.fullmatch(base):
        return Meaning(_VECTORS[folded(vector[1].replace("-", " "))], "xyz".index(vector[2].casefold()))
    return _position(header, base, state_words)


def _no_target(word: str) -> bool:
    """Return whether a word tells of something other than a position: `sigma`, `StdDev`, `P10Std`."""
    pieces = [folded(piece) for piece in (word, re.sub(r"\W", "", word), *_PIECE.findall(word))]
    return not words.NOT_TARGETS.isdisjoint(pieces)


def _along(header: str, meaning: Meaning) -> Meaning:
    """`tip along z`: each axis is a reading of its own, whose name says it."""
    if meaning.target is None or meaning.state not in (None, "deflection"):
        raise Fault(
            f"{shown(header)}: a reading along an axis has a target, and is a deflection",
            "write a header such as `tip along z [mm]`",
        )
    target = f"{meaning.target} {words.ALONG} {'xyz'[meaning.axis or 0]}"
    return replace(meaning, axis=0, target=target, state="deflection")


def along_axis(target: str) -> tuple[str, int]:
    """Return target and axis of the name that `_along` gives: those of `tip along z` are `tip` and 2."""
    name, _, axis = target.rpartition(f" {words.ALONG} ")
    return name, "xyz".index(axis)


def _position(header: str, base: str, state_words: Mapping[str, State]) -> Meaning:
    """`P10_x_loaded`, `P10 dx`, `P10 U95 x`, `P10 plus x`: words in any order, the target's in one piece."""
    base = _PHRASE.sub(lambda phrase: _STATES[folded(phrase[0].replace("-", " "))], base)
    rest = []
    axes: list[int] = []
    states: list[State] = []
    kinds: list[Kind] = []
    for token in _TOKEN.finditer(base):
        if coordinate := _COORDINATE.fullmatch(token[0]):
            axes.append("xyz".index(coordinate[2].casefold()))
            states += ["deflection"] if coordinate[1] else []
        elif state := state_named(token[0], state_words):
            states.append(state)
        elif kind := words.KINDS.get(folded(token[0])):
            kinds.append(kind)
        elif folded(token[0]) not in words.COORDINATES:
            rest.append(token)
    target = base[rest[0].start() : rest[-1].end()] if rest else None
    named = _TOKEN.findall(target) if target else []
    meant: Kind = kinds[0] if kinds else "position"
    if meant == "uncertainty" and not axes:
        meant = "point uncertainty"
    unclear = len(kinds) > 1 or len(axes) != (meant != "point uncertainty")
    if (
        unclear
        or len(set(states)) > 1
        or len(named) != len(rest)
        or any(_BRACKET.search(word) for word in named)
        or any(_no_target(word) for word in named)
    ):
        raise Fault(
            f"unknown column header {shown(header)}",
            "use headers such as `label`, `J1 [deg]`, `Fx [N]`, `P10 unloaded x [mm]`, `P10 loaded x "
            "[mm]`, `P10 dx [mm]`, `x [mm]`; give its meaning in `columns`, or skip it with `ignore`",
            UNKNOWN,
        )
    meaning = Meaning(meant, axes[0] if axes else 0, target, states[0] if states else None)
    return _along(header, meaning) if meant == "along" else meaning
