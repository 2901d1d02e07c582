"""Words of headers and names in English, German and French: tables, no code.

Compared in lower case, with single blanks for blanks and underscores. A word that means two things is left
out.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Literal

from jointstiff.schemas.importing import State

Words = tuple[str, ...]

KEYS: Final[
    Mapping[Literal["name", "collection", "group", "target", "state", "ignored"], Words]
] = MappingProxyType(
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
        "ignored": (
            "comment", "comments", "remark", "remarks", "note", "notes", "date", "time", "timestamp",
            "operator", "instrument", "rms", "i", "j", "k", "ignore", "ignored",
            "kommentar", "bemerkung", "datum", "uhrzeit", "zeit", "zeitstempel", "bediener", "messgerät",
            "commentaire", "remarque", "heure", "horodatage", "opérateur",
        ),
    }
)  # fmt: skip
"""Whole headers of columns of texts, and of columns that are ignored."""

STATES: Final[Mapping[State, Words]] = MappingProxyType(
    {
        "unloaded": (
            "unloaded", "unload", "noload", "no load", "without load", "ul", "u",
            "unbelastet", "unbel", "ohne last", "entlastet",
            "à vide", "a vide", "déchargé", "decharge", "sans charge",
        ),
        "loaded": (
            "loaded", "load", "with load", "under load", "ld", "l",
            "belastet", "bel", "last", "mit last", "unter last",
            "chargé", "charge", "chargée", "en charge", "sous charge", "avec charge",
        ),
        "deflection": (
            "deflection", "defl", "displacement", "delta", "d",
            "durchbiegung", "verformung", "auslenkung", "verschiebung",
            "déflexion", "deflexion", "flèche", "déplacement", "deplacement",
        ),
    }
)  # fmt: skip
"""States of a target; a phrase of two words counts as one."""

JOINTS: Final = ("j", "a", "q", "joint", "axis", "theta", "θ", "achse", "gelenk", "axe", "articulation")
"""Before the number of a joint."""

VECTORS: Final[Mapping[Literal["force", "moment", "load point"], Words]] = MappingProxyType(
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

EXPANDED: Final = ("u(95)", "u95", "u(95%)", "u95%", "u(k=2)")
"""Expanded uncertainty of a point's coordinates, coverage factor 2."""

COORDINATES: Final = ("position", "coordinate", "koordinate", "coordonnée", "pos")
"""Say no more than x, y or z beside them."""

NOT_TARGETS: Final = frozenset(
    (
        "sigma", "std", "stdev", "uncertainty", "nominal", "nom", "theoretical", "dev", "deviation",
        "tol", "tolerance", "error", "rms", "normal", "offset", "residual", "max", "min", "mean", "average",
        "goal", "command", "commanded", "setpoint", "desired", "nominell", "soll", "sollwert", "abweichung",
        "unsicherheit", "streuung", "toleranz", "consigne", "écart", "incertitude", "tolérance", "moyenne",
        *EXPANDED,
    )
)  # fmt: skip
"""Words beside x, y and z that tell of something other than a target's position."""
