"""Headers of the column that names the rows of a table: one list for all tables."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
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


def find_label_header(headers: Iterable[str]) -> str | None:
    """Return the header of the column that names the rows: `label`, or the first other one; None without one.

    Of the headers `id` and `point`, `id` names the rows, and `point` is an ordinary column.
    """
    label_headers = [header for header in headers if is_label(header)]
    label_headers.sort(key=lambda header: fold_word(header) != "label")
    return next(iter(label_headers), None)
