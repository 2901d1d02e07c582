"""The grammar of headers: what one column means, by its header alone (docs/import.md).

Words are English, German and French, compared in lower case, with single blanks for blanks and underscores. A
word that means two things is left out. Letters of units keep their case: mN is no MN, and nm no N·m.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final, Literal, NamedTuple, TypeVar

from jointstiff.schemas.imports import State
from jointstiff.service.importing.errors import NOWHERE, ImportFileError, shown

# ---- words

_Words = tuple[str, ...]
Kind = Literal[
    "name", "collection", "group", "target", "state", "deleted", "temperature", "time", "validation", "joint",
    "force", "moment", "load point", "position", "addition", "along", "uncertainty", "point uncertainty",
    "ignored", "unknown",
]  # fmt: skip
"""What the cells of a column are."""

_KEYS: Final[Mapping[Kind, _Words]] = MappingProxyType(
    {
        "name": (
            "label", "name", "id", "observation", "configuration", "config", "pose", "posture",
            "point", "point name", "pointname", "point id",
            "bezeichnung", "konfiguration", "stellung", "pose nr", "punkt",
            "punktname", "punkt nr", "messung",
            "nom", "étiquette", "posture n°", "nom du point", "mesure",
        ),
        "collection": ("collection", "collection name", "sammlung"),
        "group": ("group", "group name", "point group", "gruppe", "punktgruppe", "groupe"),
        "target": ("target", "reflector", "smr", "reflektor", "zielmarke", "cible", "réflecteur"),
        "state": ("state", "load state", "zustand", "lastzustand", "état", "état de charge"),
        "deleted": ("deleted", "delete", "gelöscht", "supprimé"),
        "temperature": ("temperature", "air temperature", "temperatur", "température"),
        "time": (
            "time", "timestamp", "time stamp", "date", "date time", "measured at",
            "datum", "uhrzeit", "zeit", "zeitstempel", "heure", "horodatage",
        ),
        "validation": ("validation",),
        "ignored": (
            "comment", "comments", "remark", "remarks", "note", "notes",
            "operator", "instrument", "rms", "i", "j", "k", "ignore", "ignored",
            "tilt", "image rms", "pressure", "humidity", "otg applied", "luftdruck", "luftfeuchte",
            "kommentar", "bemerkung", "bediener", "messgerät", "commentaire", "remarque", "opérateur",
            "pression", "humidité",
            "anchor", "overall verdict",
        ),
    }
)  # fmt: skip
"""Whole headers of columns that hold no quantity of a campaign."""

_STATES: Final[Mapping[State, _Words]] = MappingProxyType(
    {
        "unloaded": (
            "unloaded", "unload", "noload", "no load", "without load", "ul", "u",
            "unbelastet", "unbel", "ohne last", "entlastet",
            "à vide", "a vide", "déchargé", "decharge", "sans charge",
            "before", "off", "without", "vorher", "vor", "ohne", "aus", "avant", "sans",
        ),
        "loaded": (
            "loaded", "load", "with load", "under load", "ld", "l",
            "belastet", "bel", "last", "mit last", "unter last",
            "chargé", "charge", "chargée", "en charge", "sous charge", "avec charge",
            "after", "on", "with", "nachher", "nach", "mit", "ein", "après", "apres", "avec",
        ),
        "deflection": (
            "deflection", "defl", "displacement", "delta", "d",
            "durchbiegung", "verformung", "auslenkung", "verschiebung",
            "déflexion", "deflexion", "flèche", "déplacement", "deplacement",
        ),
    }
)  # fmt: skip
"""States of a target; a phrase of two words counts as one."""

DIGITS: Final[Mapping[str, State]] = MappingProxyType({"0": "unloaded", "1": "loaded"})
"""States where nothing else can be meant; elsewhere a digit is part of a name."""

MARKS: Final = MappingProxyType(
    {
        **dict.fromkeys(("", "0", "false", "no", "nein", "non", "-", "falsch", "faux"), False),
        **dict.fromkeys(("1", "true", "yes", "ja", "oui", "x", "delete", "deleted", "wahr", "vrai"), True),
    }
)
"""Whether a cell below `deleted` marks its row."""

_JOINTS: Final = ("j", "a", "q", "joint", "axis", "theta", "θ", "achse", "gelenk", "axe", "articulation")
"""Before the number of a joint."""

_VECTORS: Final[Mapping[Kind, _Words]] = MappingProxyType(
    {
        "force": ("f", "force", "kraft", "effort"),
        "moment": ("m", "moment", "torque", "drehmoment", "couple"),
        "load point": (
            "lp", "load point", "pw", "lastpunkt", "kraftangriffspunkt", "lastangriffspunkt",
            "point d'application", "point de charge",
        ),
    }
)  # fmt: skip
"""Before x, y or z."""

_EXPANDED: Final = ("u(95)", "u95", "u(95%)", "u95%")
"""Expanded uncertainty at 95 %: beside x, y or z of that coordinate, else of the point."""

_ADDED: Final = "plus"
"""Beside x, y or z: a deviation, to be added to that coordinate of the same target and state."""

_ALONG: Final = "along"
"""Beside x, y or z: a displacement along that axis of R0, read by a dial gauge."""

_KINDS: Final[Mapping[str, Kind]] = MappingProxyType(
    {**dict.fromkeys(_EXPANDED, "uncertainty"), _ADDED: "addition", _ALONG: "along"}
)
"""Words that make something else of a position."""

_COORDINATES: Final = ("position", "coordinate", "koordinate", "coordonnée", "pos")
"""Say no more than x, y or z beside them."""

_NOT_TARGETS: Final = frozenset(
    (
        "sigma", "std", "stdev", "stddev", "sd", "variance", "var", "covariance", "cov", "uncertainty", "unc",
        "err", "stderr", "rmse", "residue", "noise", "quality", "range", "spread", "median", "avg",
        "standardabweichung", "stdabw", "varianz", "fehler", "mittel", "mittelwert", "rauschen",
        "résidu", "erreur", "médiane", "bruit", "nominal", "nom", "theoretical", "dev", "deviation",
        "tol", "tolerance", "error", "rms", "normal", "offset", "residual", "max", "min", "mean", "average",
        "goal", "command", "commanded", "setpoint", "desired", "nominell", "soll", "sollwert", "abweichung",
        "unsicherheit", "streuung", "toleranz", "consigne", "écart", "incertitude", "tolérance", "moyenne",
        "dif", "diff", "difference", "differenz", "différence", "rotation", "u(k=2)", *_EXPANDED,
    )
)  # fmt: skip
"""Words beside x, y and z that tell of something other than a target's position."""

Dimension = Literal["length", "angle", "force", "moment"]

UNITS: Final[Mapping[Dimension, Mapping[str, tuple[str, ...]]]] = MappingProxyType(
    {
        "length": {
            "m": ("m", "meter", "meters", "metre", "metres", "metern", "mètre", "mètres"),
            "mm": (
                "mm", "MM", "millimeter", "millimeters", "millimetre", "millimetres", "millimetern",
                "millimètre", "millimètres",
            ),
            "in": ("in", "inch", "inches", "zoll", "pouce", "pouces"),
        },
        "angle": {
            "rad": ("rad", "RAD"),
            "deg": ("deg", "DEG", "°", "degree", "degrees", "degré", "degrés"),
        },
        "force": {"N": ("N",), "kN": ("kN",), "kgf": ("kgf", "kp")},
        "moment": {
            "N.m": ("N.m", "Nm"),
            "N.mm": ("N.mm", "Nmm"),
            "kN.m": ("kN.m", "kNm"),
            "kgf.m": ("kgf.m", "kgfm", "kpm", "kp.m"),
        },
    }
)  # fmt: skip
"""Canonical name and spellings, by dimension; for the full stop of a product any sign of one, or a blank."""
_PRODUCT: Final = re.compile(r"(?<=\w)[ ·*-](?=\w)")

INCH: Final = 25.4
"""Millimetres, exactly: what is in inches is converted when it is read."""

_SPELT: Final = MappingProxyType(
    {
        spelling: (dimension, unit)
        for dimension, units in UNITS.items()
        for unit, spellings in units.items()
        for spelling in spellings
    }
)
_FOREIGN: Final[Mapping[str, Dimension | None]] = MappingProxyType(
    {
        **dict.fromkeys(("kg", "g", "t", "lbf", "lb", "lbs", "daN", "MN", "mN", "kip"), "force"),
        **dict.fromkeys(
            ("ft", "feet", "foot", "yd", "cm", "dm", "km", "µm", "μm", "um", "nm", "mil", "thou",
             "zentimeter", "centimeter", "centimetre", "centimètre"),
            "length",
        ),
        **dict.fromkeys(
            ("grad", "gon", "mrad", "arcsec", "arcmin", "rev", "turns", "inc", "counts", "ticks"), "angle"
        ),
        **dict.fromkeys(("lbf.ft", "ft.lbf", "N.cm", "Ncm", "mNm"), "moment"),
        **dict.fromkeys(("V", "mV", "%")),
    }
)  # fmt: skip
"""Units that we do not take, by their dimension: no column can be said to be in another."""


def spoken(unit: str) -> str:
    """Return a unit as it reads in a sentence."""
    return "inches" if unit == "in" else unit


def unit_named(text: str) -> tuple[Dimension, str] | None:
    """Return the dimension and canonical name of a unit; None if it is none of ours."""
    return _SPELT.get(_spelt(text))


def any_unit(text: str) -> tuple[Dimension | None, str] | None:
    """Return the dimension and name of a unit, ours or a foreign one; None if it is none."""
    spelt = _spelt(text)
    return _SPELT.get(spelt) or ((_FOREIGN[spelt], spelt) if spelt in _FOREIGN else None)


def _spelt(text: str) -> str:
    """Return a unit without blanks at its ends; of whole words upper and lower case are the same."""
    plain = _PRODUCT.sub(".", text.strip())
    return plain.casefold() if len(plain) > 3 and plain.isalpha() else plain  # mN is no MN, and nm no Nm


# ---- the grammar

POINTS: Final[tuple[Kind, ...]] = ("position", "addition", "along", "uncertainty", "point uncertainty")
_LENGTHS: Final[dict[Kind, Dimension]] = dict.fromkeys(("load point", *POINTS), "length")
DIMENSIONS: Final[Mapping[Kind, Dimension]] = MappingProxyType(
    {"joint": "angle", "force": "force", "moment": "moment", **_LENGTHS}
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


def _by_word(groups: Mapping[_Value, Iterable[str]]) -> Mapping[str, _Value]:
    return MappingProxyType({word: value for value, group in groups.items() for word in group})


def _either(texts: Iterable[str]) -> str:
    """Return a pattern of texts, the longest first; blanks in them may be any."""
    longest = sorted(texts, key=len, reverse=True)
    return "|".join(re.escape(text).replace("\\ ", r"[\s_-]+") for text in longest)


_KEY_OF: Final = _by_word(_KEYS)
_STATE_OF: Final = _by_word(_STATES)
_VECTOR_OF: Final = _by_word(_VECTORS)
_JOINT: Final = re.compile(rf"(?:{_either(_JOINTS)})[\s_-]?([0-9]{{1,2}})", re.IGNORECASE)
_VECTOR: Final = re.compile(rf"({_either(_VECTOR_OF)})[\s_-]*([xyz])", re.IGNORECASE)
_PHRASE: Final = re.compile(
    rf"(?<![^\s_])(?:{_either(word for word in _STATE_OF if ' ' in word)})(?![^\s_])", re.IGNORECASE
)
_UNIT: Final = re.compile(r"(.*?)\s*_?(?:\[([^][]*)\]|\(([^()]*)\)|/\s*([^/]+))")
_TOKEN: Final = re.compile(r"[^\s_]+")
_PIECE: Final = re.compile(r"[A-Z]?[^\W\dA-Z_]{2,}|[A-Z]{3,}(?![^\W\dA-Z_])")
_BRACKET: Final = re.compile(r"[][(){}]")
_COORDINATE: Final = re.compile(r"([dδΔ]?)([xyz])", re.IGNORECASE)


class Quantity(NamedTuple):
    """Quantity given by several columns: a vector, or all joint angles."""

    kind: Kind  # kind of the quantity
    target: str | None = None  # target of a position or its uncertainty, if the header names it
    state: State | None = None  # state of a position or its uncertainty, if the header names it

    def of(self, kind: Kind) -> Quantity:
        """Return what another kind of column says of the same target and state."""
        return self._replace(kind=kind)


@dataclass(frozen=True)
class Meaning:
    """Meaning of a column."""

    quantity: Quantity  # that the column is a part of
    # number of the joint, or of the axis x, y, z, from 0; 0 of a point's uncertainty; None for texts
    axis: int | None = None
    unit: str | None = None  # canonical, if the header names it; of a temperature as it is written
    guessed: bool = False  # whether it is to be checked: the unit stood without brackets, 0 and 1 as states

    @property
    def kind(self) -> Kind:
        """Kind of the column's cells."""
        return self.quantity.kind

    def __str__(self) -> str:
        """Return words that are read as the same meaning."""
        kind, target, state = self.quantity
        if self.axis is None:
            return kind
        if kind == "joint":
            return f"joint {self.axis + 1}"
        axis = "xyz"[self.axis]
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
    """The state a word stands for, or None; upper and lower case are the same.

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
    return folded(split_unit(text)[0]) in _JOINTS


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
    if round_ is not None and folded(header).rpartition(" ")[2] in _EXPANDED:
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
        return Meaning(Quantity(key), unit=unit if key == "temperature" else None)
    suffixed = None if unit is not None else _split_suffix(base)
    base, unit = suffixed or (base, unit)
    if joint := _JOINT.fullmatch(base):
        if not joint[1].strip("0"):
            reason = f"{shown(header)}: joints are numbered from 1"
            raise ImportFileError(NOWHERE, reason, "number them 1, 2, …")
        meaning = Meaning(Quantity("joint"), int(joint[1]) - 1)
    elif vector := _VECTOR.fullmatch(base):
        kind = _VECTOR_OF[folded(vector[1].replace("-", " "))]
        meaning = Meaning(Quantity(kind), "xyz".index(vector[2].casefold()))
    else:
        meaning = _position(header, base, state_words)
    return replace(meaning, unit=checked_unit(header, unit, meaning.kind), guessed=suffixed is not None)


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
    if known is None or known[0] != dimension:
        reason = f"{shown(header)}: {shown(text)} is not a known unit of {dimension}"
        raise ImportFileError(NOWHERE, reason, f"convert to one of {', '.join(UNITS[dimension])}")
    return known[1]


def _position(header: str, base: str, state_words: Mapping[str, State]) -> Meaning:
    """`P10_x_loaded`, `P10 dx`, `P10 U95 x`, `P10 plus x`: words in any order, the target's in one piece."""
    base = _PHRASE.sub(lambda phrase: _STATE_OF[folded(phrase[0].replace("-", " "))], base)
    rest = []
    axes: list[int] = []
    states: set[State] = set()
    kinds: list[Kind] = []
    for token in _TOKEN.finditer(base):
        if coordinate := _COORDINATE.fullmatch(token[0]):
            axes.append("xyz".index(coordinate[2].casefold()))
            states.update(["deflection"] if coordinate[1] else [])
        elif state := state_named(token[0], state_words):
            states.add(state)
        elif kind := _KINDS.get(folded(token[0])):
            kinds.append(kind)
        elif folded(token[0]) not in _COORDINATES:
            rest.append(token)
    target = base[rest[0].start() : rest[-1].end()] if rest else None
    named = _TOKEN.findall(target or "")
    (meant, *more) = kinds or ["position"]
    if meant == "uncertainty" and not axes:
        meant = "point uncertainty"
    unclear = more or len(axes) != (meant != "point uncertainty") or len(states) > 1
    if unclear or len(named) != len(rest) or any(map(_no_target, named)):
        raise ImportFileError(
            NOWHERE,
            f"unknown column header {shown(header)}",
            "use headers such as `label`, `J1 [deg]`, `Fx [N]`, `P10 unloaded x [mm]`, `P10 loaded x "
            "[mm]`, `P10 dx [mm]`, `x [mm]`; give its meaning in `columns`, or skip it with `ignore`",
            UNKNOWN,
        )
    meaning = Meaning(Quantity(meant, target, next(iter(states), None)), sum(axes))
    return _along(header, meaning) if meant == "along" else meaning


def _along(header: str, meaning: Meaning) -> Meaning:
    """`tip along z`: each axis is a reading of its own, whose name says it."""
    _, target, state = meaning.quantity
    if target is None or state not in (None, "deflection"):
        reason = f"{shown(header)}: a reading along an axis has a target, and is a deflection"
        raise ImportFileError(NOWHERE, reason, "write a header such as `tip along z [mm]`")
    name = f"{target} {_ALONG} {'xyz'[meaning.axis or 0]}"
    return Meaning(Quantity("along", name, "deflection"), 0)


def _no_target(word: str) -> bool:
    """Return whether a word tells of something other than a position: `sigma`, `StdDev`, `P10Std`, `[`."""
    pieces = [folded(piece) for piece in (word, re.sub(r"\W", "", word), *_PIECE.findall(word))]
    return bool(_BRACKET.search(word)) or not _NOT_TARGETS.isdisjoint(pieces)


def along_axis(target: str) -> tuple[str, int]:
    """Return target and axis of a reading along an axis: those of `tip along z` are `tip` and 2."""
    name, _, axis = target.rpartition(f" {_ALONG} ")
    return name, "xyz".index(axis)
