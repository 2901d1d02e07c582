"""Databases of layouts that no program upgrades: dumps, filled by the programs of these layouts.

Dumps of 0009, 0014 and 0017 were filled by the commits 97157976, a69b6862 and 1d18fa53 with one of each kind
of job, runs of every model, live campaigns, keys, an entry of the audit, and deleted records. That of 0018 is
the kept database of `support.kept`.
"""

from __future__ import annotations

import gzip
import sqlite3
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Final

from support import kept

FOLDER: Final = Path(__file__).parents[1] / "service" / "archive" / "kept"
NUMBERS: Final = ("0009", "0014", "0017", "0018")


def make_database(number: str, path: Path) -> str:
    """Make the SQLite file of a layout; return its URL."""
    if number == "0018":
        kept.restore(number, f"sqlite:///{path}")
    else:
        dump = gzip.decompress((FOLDER / f"{number}.sqlite.sql.gz").read_bytes()).decode()
        with closing(sqlite3.connect(path)) as connection:
            connection.executescript(dump)
            connection.execute("PRAGMA journal_mode=WAL")  # as its program left it
    return f"sqlite:///{path}"


def list_numbers(document: Any) -> Iterator[float]:
    """Yield all numbers of a document."""
    if isinstance(document, dict):
        document = list(document.values())
    if isinstance(document, list):
        for value in document:
            yield from list_numbers(value)
    elif isinstance(document, int | float) and not isinstance(document, bool):
        yield document


def count_numbers(document: Any) -> Counter[float]:
    """Return how often a document has each number."""
    return Counter(list_numbers(document))
