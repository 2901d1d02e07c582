"""Makes the tables of a database, with Alembic and without an alembic.ini.

Nothing was released, so there is one layout: to change the tables, or what stored documents hold, change
`service.store.tables` and the name of the revision in `versions/`.
"""

from __future__ import annotations

import threading
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, text

from jointstiff.service.problems.errors import StoreError
from jointstiff.service.store.content import revision_of
from jointstiff.service.store.database import Database

_ADVISORY_LOCK = 0x4A6F696E74  # any number that no other program takes: "Joint"

_alembic_lock = threading.Lock()
"""Alembic keeps its environment in module globals: one migration at a time in a process."""


def configuration() -> Config:
    """Return what an alembic.ini would say."""
    config = Config()
    folder = str(Path(__file__).parent)
    config.set_main_option("script_location", folder.replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    return config


def migrate(database: Database) -> None:
    """Make the tables of an empty database; safe when several processes do so at once.

    Raises:
        StoreError: The database has a layout that this software does not know.
        StoreUnavailableError: It cannot be changed.
    """
    with _alembic_lock:
        with database.reading() as connection:
            if has_tables(connection):
                return
        with database.writing() as connection:
            if database.dialect == "postgresql":  # SQLite holds its write lock already
                connection.execute(text("SELECT pg_advisory_xact_lock(:n)"), {"n": _ADVISORY_LOCK})
            if not has_tables(connection):
                config = configuration()
                config.attributes["connection"] = connection
                command.upgrade(config, "head")


def has_tables(connection: Connection) -> bool:
    """Return True for a database with the tables of this version, False for one without tables of ours.

    Raises:
        StoreError: It has those of another version.
    """
    revision = revision_of(connection)
    if revision is not None:
        refuse_other_layout(revision)
    return revision is not None


def refuse_other_layout(found: str) -> None:
    """Refuse tables of another version, by the name of their layout.

    Raises:
        StoreError: This version does not know it.
    """
    ours = ScriptDirectory.from_config(configuration()).get_current_head()
    if found != ours:
        raise StoreError(
            f"the database has tables of another version of Jointstiff: layout {found}, not {ours}",
            "export it to files (jointstiff export-database URL -o FOLDER) and post these to a new database "
            "(jointstiff post FOLDER), or give another database",
        )
