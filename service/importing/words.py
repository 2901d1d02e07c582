"""Words of headers and names in English, German and French, and units: tables, no grammar.

Words are compared in lower case, with single blanks for blanks and underscores. A word that means two things
is left out. Letters of units keep their case: mN is no MN, and nm no N·m.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Literal

from jointstiff.schemas.importing import State

Words = tuple[str, ...]
Kind = Literal[
    "name", "collection", "group", "target", "state", "deleted", "temperature", "time", "validation", "joint",
    "force", "moment", "load point", "position", "addition", "along", "uncertainty", "point uncertainty",
    "ignored", "unknown",
]  # fmt: skip
"""What the cells of a column are."""

KEYS: Final[Mapping[Kind, Words]] = MappingProxyType(
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

STATES: Final[Mapping[State, Words]] = MappingProxyType(
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

JOINTS: Final = ("j", "a", "q", "joint", "axis", "theta", "θ", "achse", "gelenk", "axe", "articulation")
"""Before the number of a joint."""

VECTORS: Final[Mapping[Kind, Words]] = MappingProxyType(
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

EXPANDED: Final = ("u(95)", "u95", "u(95%)", "u95%")
"""Expanded uncertainty at 95 %: beside x, y or z of that coordinate, else of the point."""

ADDED: Final = "plus"
"""Beside x, y or z: a deviation, to be added to that coordinate of the same target and state."""

ALONG: Final = "along"
"""Beside x, y or z: a displacement along that axis of R0, read by a dial gauge."""

KINDS: Final[Mapping[str, Kind]] = MappingProxyType(
    {**dict.fromkeys(EXPANDED, "uncertainty"), ADDED: "addition", ALONG: "along"}
)
"""Words that make something else of a position."""

COORDINATES: Final = ("position", "coordinate", "koordinate", "coordonnée", "pos")
"""Say no more than x, y or z beside them."""

NOT_TARGETS: Final = frozenset(
    (
        "sigma", "std", "stdev", "stddev", "sd", "variance", "var", "covariance", "cov", "uncertainty", "unc",
        "err", "stderr", "rmse", "residue", "noise", "quality", "range", "spread", "median", "avg",
        "standardabweichung", "stdabw", "varianz", "fehler", "mittel", "mittelwert", "rauschen",
        "résidu", "erreur", "médiane", "bruit", "nominal", "nom", "theoretical", "dev", "deviation",
        "tol", "tolerance", "error", "rms", "normal", "offset", "residual", "max", "min", "mean", "average",
        "goal", "command", "commanded", "setpoint", "desired", "nominell", "soll", "sollwert", "abweichung",
        "unsicherheit", "streuung", "toleranz", "consigne", "écart", "incertitude", "tolérance", "moyenne",
        "dif", "diff", "difference", "differenz", "différence", "rotation", "u(k=2)", *EXPANDED,
    )
)  # fmt: skip
"""Words beside x, y and z that tell of something other than a target's position."""

Dimension = Literal["length", "angle", "force", "moment"]

UNITS: Final[Mapping[Dimension, Mapping[str, tuple[str, ...]]]] = MappingProxyType(
    {
        "length": {
            "m": ("m", "meter", "meters", "metre", "metres", "metern", "mètre", "mètres"),
            "mm": (
                "mm",
                "MM",
                "millimeter",
                "millimeters",
                "millimetre",
                "millimetres",
                "millimetern",
                "millimètre",
                "millimètres",
            ),
            "in": ("in", "inch", "inches", "zoll", "pouce", "pouces"),
        },
        "angle": {
            "rad": ("rad", "RAD"),
            "deg": ("deg", "DEG", "°", "degree", "degrees", "degré", "degrés"),
        },
        "force": {"N": ("N",), "kN": ("kN",), "kgf": ("kgf", "kp")},
        "moment": {
            "N.m": ("N.m", "Nm", "N·m", "N*m", "N m", "N-m"),
            "N.mm": ("N.mm", "Nmm", "N·mm", "N*mm", "N mm", "N-mm"),
            "kN.m": ("kN.m", "kNm", "kN·m", "kN*m", "kN m", "kN-m"),
            "kgf.m": ("kgf.m", "kgfm", "kgf·m", "kgf*m", "kgf m", "kpm", "kp·m"),
        },
    }
)
"""Canonical name and spellings, by dimension."""

SPOKEN: Final = MappingProxyType({"in": "inches"})
"""Units in messages where the canonical name is a word of its own."""

INCH: Final = 25.4
"""Millimetres, exactly: what is in inches is converted when it is read."""

_NAMED: Final = MappingProxyType(
    {
        spelling: (dimension, unit)
        for dimension, units in UNITS.items()
        for unit, spellings in units.items()
        for spelling in spellings
    }
)


FOREIGN: Final[Mapping[str, Dimension | None]] = MappingProxyType(
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


def unit_named(text: str) -> tuple[Dimension, str] | None:
    """Return the dimension and canonical name of a unit; None if it is none of ours."""
    return _NAMED.get(_spelt(text))


def any_unit(text: str) -> tuple[Dimension | None, str] | None:
    """Return the dimension and name of a unit, ours or a foreign one; None if it is none."""
    spelt = _spelt(text)
    return _NAMED.get(spelt) or ((FOREIGN[spelt], spelt) if spelt in FOREIGN else None)


def _spelt(text: str) -> str:
    """Return a unit without blanks at its ends; of whole words upper and lower case are the same."""
    plain = text.strip()
    return plain.casefold() if len(plain) > 3 and plain.isalpha() else plain  # mN is no MN, and nm no Nm
