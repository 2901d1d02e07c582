"""Headers of the column that names the rows of a table: one list for all tables."""

from __future__ import annotations

import unicodedata
from typing import Final

LABEL_HEADERS: Final = (
    *("label", "name", "id", "observation", "configuration", "config", "pose", "posture", "point"),
    *("point name", "pointname", "point id", "bezeichnung", "konfiguration", "stellung", "pose nr", "punkt"),
    *("punktname", "punkt nr", "messpunkt", "messung", "nom", "étiquette", "posture n°", "nom du point"),
    "mesure",
)
"""Headers in English, German and French, as `fold_word` returns them."""


def fold_word(text: str) -> str:
    """Return a text for comparisons: lower case, Unicode composed, `_` and runs of blanks as one blank."""
    return " ".join(unicodedata.normalize("NFC", text).casefold().replace("_", " ").split())


def is_label(header: str) -> bool:
    """Return whether a header names the column of texts that name the rows."""
    return fold_word(header) in LABEL_HEADERS
