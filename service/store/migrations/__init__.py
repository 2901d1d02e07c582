"""Brings a database to the version of this software, with Alembic and without an alembic.ini.

To change the tables, change `service.store.tables` and add a revision to `versions/`; a test fails until
the two agree. `alembic.command.revision(configuration(), "what it does")` writes an empty one.
"""

from __future__ import annotations

import os
import threading
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, text

from jointstiff.service.problems.errors import StoreError
from jointstiff.service.store.content import revision_of
from jointstiff.service.store.database import Database, make_private

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
    """Bring `database` to the newest revision; safe when several processes do so at once.

    An SQLite file of an earlier one is kept beside it as `NAME.REVISION.bak`.

    Raises:
        StoreError: The database has a layout that this software does not know.
        StoreUnavailableError: It cannot be changed.
    """
    with _alembic_lock:
        scripts = ScriptDirectory.from_config(configuration())
        with database.reading() as connection:
            if _is_current(connection, scripts):
                return
            _keep_copy(connection)
        with database.writing() as connection:
            if database.dialect == "postgresql":  # SQLite holds its write lock already
                connection.execute(text("SELECT pg_advisory_xact_lock(:n)"), {"n": _ADVISORY_LOCK})
            if not _is_current(connection, scripts):
                config = configuration()
                config.attributes["connection"] = connection
                command.upgrade(config, "head")


def _keep_copy(connection: Connection) -> None:
    """Copy a file that is about to change."""
    revision, path = revision_of(connection), connection.engine.url.database
    if connection.dialect.name != "sqlite" or revision is None or path in {None, "", ":memory:"}:
        return
    copy = Path(f"{path}.{revision}.bak")
    partial = copy.with_name(f"{copy.name}.{os.getpid()}")
    if copy.exists():
        return
    try:
        make_private(partial)
        connection.execute(text("VACUUM INTO :copy"), {"copy": str(partial)})
        partial.replace(copy)
    finally:
        partial.unlink(missing_ok=True)


def _is_current(connection: Connection, scripts: ScriptDirectory) -> bool:
    found = set(MigrationContext.configure(connection).get_current_heads())
    known = {script.revision for script in scripts.walk_revisions()}
    if not found <= known:
        raise StoreError(
            f"the database has the schema version {', '.join(sorted(found))}, which this version "
            "of Jointstiff does not know",
            "it was written by a newer version, by one from before the first release, or by another program: "
            "install the version that wrote it, or take another database",
        )
    return found == set(scripts.get_heads())
