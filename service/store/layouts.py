"""Layouts: the versions of the tables and of the documents in them, and which of them this program can use.

The name of a layout is a revision of Alembic: a number, the kind of the step that leads to it, and words.
An *expand* step only adds what older programs do not need, so the program of layout n can also use the layout
n + 1 if an expand step leads to it. A *contract* step removes what no program needs any more.
"""

from __future__ import annotations

import re
from typing import Final

from jointstiff.service.history.steps import NEWEST, OLDEST
from jointstiff.service.problems import StoreError

LAYOUT: Final = "0024_expand_programs"
"""Layout of this program: of new databases, and the newest file in `migrations/versions/`."""
BASELINE: Final = "0018_actions_name_targets"
"""Oldest layout that can be upgraded."""
SCHEMA: Final = NEWEST
"""Version of new documents: number of the layout that last changed the form or the shape of documents."""

_NAME: Final = re.compile(r"(\d{4})_(expand|contract)_\w+", re.ASCII)
_NUMBERED: Final = re.compile(r"\d{4}_", re.ASCII)
_SAVE_COMMANDS: Final = {
    "sqlite": "sqlite3 FILE '.backup SAVED'",
    "postgresql": "pg_dump --format=custom --file=SAVED DATABASE",
}
"""Commands that save a database, by its dialect."""


def number_of(layout: str) -> int:
    """Return the number of a layout."""
    return int(layout[:4])


def kind_of(layout: str) -> str:
    """Return the kind of the step that leads to a layout: `expand` or `contract`; empty for other names."""
    found = _NAME.fullmatch(layout)
    return "" if found is None else found[2]


def can_use(layout: str) -> bool:
    """Return whether this program can use a layout: its own, or the next if an expand step leads to it."""
    is_next = kind_of(layout) == "expand" and number_of(layout) == number_of(LAYOUT) + 1
    return layout == LAYOUT or is_next


def can_upgrade(layout: str) -> bool:
    """Return whether this program can upgrade a database of a layout."""
    is_later = bool(kind_of(layout)) and number_of(BASELINE) < number_of(layout) < number_of(LAYOUT)
    return layout == BASELINE or is_later


def can_archive(layout: str) -> bool:
    """Return whether this program can read a layout for an archive."""
    number = int(layout[:4]) if _NUMBERED.match(layout) else 0
    return OLDEST <= number <= number_of(LAYOUT)


def refuse_unusable(layout: str, dialect: str) -> None:
    """Refuse a database of a layout that this program cannot use; `dialect` is that of the database.

    Raises:
        StoreError: this program cannot use the layout.
    """
    if can_use(layout):
        return
    reason = f"the database has tables of another version of Jointstiff: layout {layout}, not {LAYOUT}"
    save_command = _SAVE_COMMANDS[dialect]
    if can_upgrade(layout):
        raise StoreError(
            reason,
            f"save the database with `{save_command}`, and upgrade the database with `jointstiff database "
            "upgrade --database URL`",
        )
    is_newer = bool(kind_of(layout)) and number_of(layout) > number_of(LAYOUT)
    if is_newer:
        raise StoreError(
            reason,
            "install the newer version of Jointstiff that upgraded the database, or restore the copy that "
            "was made before the upgrade",
        )
    raise StoreError(
        reason,
        f"save the database with `{save_command}` and open it with the version that wrote it, or give a new "
        "database and post the campaigns again",
    )
