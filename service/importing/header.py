"""The grammar of headers: what one column means, by its header alone (docs/import.md)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

from jointstiff.schemas.importing import State
from jointstiff.service.importing.errors import Fault, shown
from jointstiff.service.importing.units import UNITS, Dimension, unit_named

Kind = Literal[
    "name", "collection", "group", "target", "state", "joint", "force", "moment", "load point", "position",
    "ignored",
]  # fmt: skip

DIMENSIONS: Final[Mapping[Kind, Dimension]] = MappingProxyType(
    {"joint": "angle", "force": "force", "moment": "moment", "load point": "length", "position": "length"}
)

_KEYS: Final[Mapping[str, Kind]] = MappingProxyType(
    {
        **dict.fromkeys(("label", "name", "id", "observation", "configuration", "config", "pose"), "name"),
        **dict.fromkeys(("point", "point name", "pointname", "point id"), "name"),
        **dict.fromkeys(("collection", "collection name"), "collection"),
        **dict.fromkeys(("group", "group name", "point group"), "group"),
        **dict.fromkeys(("target", "reflector", "smr"), "target"),
        **dict.fromkeys(("state", "load state"), "state"),
        **dict.fromkeys(("comment", "comments", "remark", "remarks", "note", "notes"), "ignored"),
        **dict.fromkeys(("date", "time", "timestamp", "operator", "instrument", "rms"), "ignored"),
        **dict.fromkeys(("i", "j", "k", "ignore"), "ignored"),
    }
)
_STATES: Final[Mapping[str, State]] = MappingProxyType(
    {
        **dict.fromkeys(("unloaded", "unload", "noload", "ul", "u"), "unloaded"),
        **dict.fromkeys(("loaded", "load", "ld", "l"), "loaded"),
        **dict.fromkeys(("deflection", "defl", "displacement", "delta", "d"), "deflection"),
    }
)
_NOT_TARGETS: Final = frozenset(
    ["sigma", "std", "stdev", "uncertainty", "u95", "nominal", "nom", "theoretical", "dev", "deviation",
     "tol", "tolerance", "error", "rms", "normal", "offset", "residual", "max", "min", "mean", "average"]
)  # fmt: skip
"""Words beside x, y and z that tell of something other than a target's position."""

_JOINT: Final = re.compile(r"(?:j|q|joint|axis|theta|θ)[ _-]?([0-9]{1,2})", re.IGNORECASE)
_VECTOR: Final = re.compile(r"(f|force|m|moment|torque|lp|load[ _-]?point|pw)[ _-]?([xyz])", re.IGNORECASE)
_UNIT: Final = re.compile(r"(.*?)\s*_?(?:\[([^][]*)\]|\(([^()]*)\)|/\s*([^/]+))")
_TOKEN: Final = re.compile(r"[^\s_]+")
_BRACKET: Final = re.compile(r"[][(){}]")
_COORDINATE: Final = re.compile(r"([dδΔ]?)([xyz])", re.IGNORECASE)
_VECTOR_KINDS: Final[Mapping[str, Kind]] = MappingProxyType(
    {"f": "force", "force": "force", "m": "moment", "moment": "moment", "torque": "moment"}
)


@dataclass(frozen=True)
class Meaning:
    """Meaning of a column.

    Attributes:
        kind: of its cells.
        axis: number of the joint, or of the axis x, y, z, from 0; None for texts.
        target: of a position, if the header names it.
        state: of a position, if the header names it.
        unit: canonical, if the header names it.
    """

    kind: Kind
    axis: int | None = None
    target: str | None = None
    state: State | None = None
    unit: str | None = None

    def __str__(self) -> str:
        if self.kind == "joint":
            return f"joint {(self.axis or 0) + 1}"
        if self.axis is None:
            return self.kind
        words = [self.target, self.state] if self.kind == "position" else []
        kind = "position" if words == [None, None] else None if words else self.kind
        return " ".join(word for word in (*words, kind, "xyz"[self.axis]) if word)


def state_named(word: str, extra: Mapping[str, State]) -> State | None:
    """The state a word stands for, or None; upper and lower case are the same.

    Args:
        word: to look up.
        extra: the caller's words, which come before ours.
    """
    folded = word.casefold()
    for key, state in extra.items():
        if key.casefold() == folded:
            return state
    return _STATES.get(folded)


def is_key(text: str) -> bool:
    """Return whether a text is the header of a column of texts."""
    return text.strip().casefold() in _KEYS


def meaning_of(header: str, state_words: Mapping[str, State]) -> Meaning:
    """Understand one header cell.

    Raises:
        Fault: it is not in the grammar.
    """
    base, unit = _split_unit(header)
    key = _KEYS.get(" ".join(base.casefold().replace("_", " ").split()))
    if key == "ignored":
        return Meaning(key)
    if key is not None:
        if unit is not None:
            raise Fault(f"{shown(header)} has a unit, but is a column of texts", "check the header")
        return Meaning(key)
    found = _quantity(header, base, state_words)
    return Meaning(found.kind, found.axis, found.target, found.state, _checked_unit(header, unit, found.kind))


def _split_unit(header: str) -> tuple[str, str | None]:
    """`x [mm]`, `x (mm)` or `x/mm` as name and unit; what follows a slash must be one of ours."""
    match = _UNIT.fullmatch(header.strip())
    if match is None:
        return header.strip(), None
    base, bracketed, round_, slashed = match.groups()
    if slashed is not None:
        slashed = slashed.strip("() ")
        return (base, slashed) if unit_named(slashed) else (header.strip(), None)
    return base, bracketed if bracketed is not None else round_


def _checked_unit(header: str, text: str | None, kind: Kind) -> str | None:
    if text is None:
        return None
    dimension = DIMENSIONS[kind]
    found = unit_named(text)
    if found is None or found[0] != dimension:
        raise Fault(
            f"{shown(header)}: {shown(text)} is not a known unit of {dimension}",
            f"convert to one of {', '.join(UNITS[dimension])}",
        )
    return found[1]


def _quantity(header: str, base: str, state_words: Mapping[str, State]) -> Meaning:
    if joint := _JOINT.fullmatch(base):
        if joint[1] == "0" * len(joint[1]):
            raise Fault(f"{shown(header)}: joints are numbered from 1", "number them 1, 2, …")
        return Meaning("joint", int(joint[1]) - 1)
    if vector := _VECTOR.fullmatch(base):
        kind = _VECTOR_KINDS.get(vector[1].casefold(), "load point")
        return Meaning(kind, "xyz".index(vector[2].casefold()))
    return _position(header, base, state_words)


def _position(header: str, base: str, state_words: Mapping[str, State]) -> Meaning:
    """`P10 unloaded x`, `P10_x_loaded`, `P10 dx`, `x`: words in any order, the target's in one piece."""
    rest = []
    axes, states = [], []
    for token in _TOKEN.finditer(base):
        if coordinate := _COORDINATE.fullmatch(token[0]):
            axes.append("xyz".index(coordinate[2].casefold()))
            states += ["deflection"] if coordinate[1] else []
        elif state := state_named(token[0], state_words):
            states.append(state)
        else:
            rest.append(token)
    target = base[rest[0].start() : rest[-1].end()] if rest else None
    words = _TOKEN.findall(target) if target else []
    unclear = len(axes) != 1 or len(set(states)) > 1 or len(words) != len(rest)
    if unclear or any(word.casefold() in _NOT_TARGETS or _BRACKET.search(word) for word in words):
        raise Fault(
            f"unknown column header {shown(header)}",
            "use headers such as `label`, `J1 [deg]`, `Fx [N]`, `P10 unloaded x [mm]`, `P10 loaded x "
            "[mm]`, `P10 dx [mm]`, `x [mm]`, or skip the column with `ignore`",
        )
    return Meaning("position", axes[0], target, states[0] if states else None)  # type: ignore[arg-type]
