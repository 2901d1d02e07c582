"""Upgrades of a database from layout to layout, by the files in `migrations/` and Alembic.

Each step is one transaction: a process that is killed leaves the layout before. One process at a time changes
the tables. Before the first step, an SQLite file is copied to `FILE.before-NNNN` (number of the new layout).
The name of the copy ends in `.part` until the step is committed: the copy of a killed step is replaced.
"""

from __future__ import annotations

import os
import shlex
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import sqlalchemy as sa
from alembic import command
from sqlalchemy.exc import DBAPIError

from jointstiff.service.problems import StoreError, StoreUnavailableError
from jointstiff.service.store.copies import files_of, make_part_path, name_copy, remove_part, sync_folder
from jointstiff.service.store.database import (
    Database,
    make_migrating_engine,
    open_existing,
    sqlite_path_of,
)
from jointstiff.service.store.layouts import can_upgrade, kind_of
from jointstiff.service.store.rewriting import OldDocuments
from jointstiff.service.store.steps import Step, list_due_steps, make_config
from jointstiff.service.store.tables import LOCK_SECONDS, lock_tables, read_layout

_LOCK_PAUSE: Final = 0.5  # before a step whose lock was not available is tried again [s]
_LOCKED_STATES: Final = frozenset({"55P03", "40P01"})  # SQLSTATE: a lock is not available, or a deadlock
SPARE_BYTES: Final = 16 * 1024 * 1024
"""Bytes that must remain free on the disk after a copy."""
_MOST_NAMED: Final = 10  # documents that a refusal names
_REWRITE_SECONDS: Final = 2.0  # between two reports of progress


def upgrade_by_expansion(url: str, notify: Callable[[str], object]) -> None:
    """Carry out the steps that a database lacks, if all of them are expand steps.

    Args:
        url: URL of the database.
        notify: function that is called with a sentence for each step.

    Raises:
        StoreError: a contract step is due, or the disk has no room for the copy. Nothing has been changed.
        StoreUnavailableError: the database does not answer, or another program locks its tables.
    """
    layout = _read_layout_of(url)
    due = [step.layout for step in list_due_steps(layout)]
    if contractions := [name for name in due if kind_of(name) == "contract"]:
        raise StoreError(
            f"the database has layout {layout}, but the step to {contractions[0]} removes data that older "
            "programs need",
            "stop all services and workers, save the database, and run `jointstiff database upgrade "
            "--database URL`",
        )
    upgrade_tables(url, notify)


def upgrade_tables(url: str, notify: Callable[[str], object], *, copied: bool = True) -> None:
    """Carry out all steps that a database lacks; nothing happens if there are none.

    Args:
        url: URL of the database.
        notify: function that is called with a sentence for each step.
        copied: whether an SQLite file is copied before the first step.

    Raises:
        StoreError: the disk has no room for the copy, or a contract step is due and documents of an earlier
            form remain. The last step has changed nothing.
        StoreUnavailableError: the database does not answer, or another program locks its tables.
    """
    with closing(open_existing(url)) as database, _migrating_engine(url) as engine:
        while can_upgrade(layout := _read_layout_of(url)):
            step = list_due_steps(layout)[0]
            if kind_of(step.layout) == "contract":
                _rewrite_all_documents(database)
            copy_of = sqlite_path_of(engine.url) if copied and engine.dialect.name == "sqlite" else None
            outcome = _carry_out_patiently(engine, layout, step, copy_of)
            if outcome is None:  # another process has carried out the step
                continue
            copied = copied and outcome.copy is None
            words = f"; a copy of the database before the upgrade is {outcome.copy}" if outcome.copy else ""
            notify(f"upgraded the database from layout {layout} to {step.layout}{words}")


@dataclass(frozen=True)
class _Outcome:
    """Outcome of a step that was carried out."""

    copy: Path | None  # copy of the SQLite file before the step, if one was made


def _carry_out_patiently(engine: sa.Engine, layout: str, step: Step, copy_of: Path | None) -> _Outcome | None:
    """Carry out a step as `_carry_out` does; try again if other programs lock the tables.

    Raises:
        StoreUnavailableError: other programs have locked the tables for `LOCK_SECONDS`, or the step failed.
    """
    deadline = time.monotonic() + LOCK_SECONDS
    while True:
        try:
            return _carry_out(engine, layout, step, copy_of)
        except DBAPIError as error:
            if not _is_locked(error):
                reason = str(error.orig).strip().splitlines()[0][:200]
                raise StoreUnavailableError(
                    f"the database cannot be upgraded to layout {step.layout} ({reason})",
                    "nothing was changed; check that the disk is not full, and that the user of the database "
                    "owns its tables, and start again",
                ) from error
            if time.monotonic() > deadline:
                raise StoreUnavailableError(
                    f"other programs have locked the tables for {LOCK_SECONDS:.0f} s",
                    "nothing was changed; end long statements and dumps of other programs, and start again",
                ) from error
            time.sleep(_LOCK_PAUSE)


def _carry_out(engine: sa.Engine, layout: str, step: Step, copy_of: Path | None) -> _Outcome | None:
    """Carry out a step in one transaction; return None if another process has changed the layout meanwhile.

    Args:
        engine: engine of `make_migrating_engine`.
        layout: present layout of the database.
        step: step to carry out.
        copy_of: SQLite file to copy first; None to copy nothing.
    """
    part = None
    with engine.begin() as connection:  # on SQLite with the write lock: the copy has all that was committed
        if connection.dialect.name != "sqlite":
            lock_tables(connection)
        if read_layout(connection) != layout:
            return None
        try:
            if copy_of is not None:
                part = _copy_file(connection, copy_of, step.layout)
            _change_tables(connection, step)
        except BaseException:
            if part is not None:
                remove_part(part)
            raise
    return _Outcome(None if part is None else name_copy(part))


def _change_tables(connection: sa.Connection, step: Step) -> None:
    """Carry out the changes of a step in the transaction of a connection.

    Raises:
        StoreError: rows would refer to rows that do not exist.
    """
    command.upgrade(make_config(connection), step.layout)
    is_sqlite = connection.dialect.name == "sqlite"
    if is_sqlite and connection.exec_driver_sql("PRAGMA foreign_key_check").first() is not None:
        raise StoreError(
            f"the step to layout {step.layout} would leave rows without the rows to which they refer",
            "nothing was changed; report this error, with the output of `jointstiff database check`",
        )


def _copy_file(connection: sa.Connection, path: Path, layout: str) -> Path:
    """Copy an SQLite file before it is upgraded to a layout; return the path of the copy.

    The name of the copy ends in `.part`. An earlier file of this name is replaced.

    Args:
        connection: connection to the file, with the write lock.
        path: path of the file.
        layout: layout after the upgrade.

    Raises:
        StoreError: the copy cannot be written.
    """
    part = make_part_path(path, layout)
    pages, page_size = (
        connection.exec_driver_sql(f"PRAGMA {name}").scalar_one() for name in ("page_count", "page_size")
    )
    try:
        _write_copy(path, part, pages * page_size)
    except BaseException as error:
        remove_part(part)
        if isinstance(error, sqlite3.Error | OSError):
            raise _refuse_copy(path, str(error)) from error
        raise
    return part


def _write_copy(path: Path, part: Path, size: int) -> None:
    """Write the copy of an SQLite file whose database has a size [bytes].

    Raises:
        OSError: the copy cannot be written, or has another size.
        sqlite3.Error: the copy cannot be written.
    """
    for left in files_of(part):  # of a process that was killed
        left.unlink(missing_ok=True)
    free, needed = shutil.disk_usage(path.parent).free, size + SPARE_BYTES
    if free < needed:
        raise OSError(f"the disk has {free / 1e6:.0f} MB free, but {needed / 1e6:.0f} MB are needed")
    os.close(os.open(part, os.O_CREAT | os.O_EXCL, 0o600))
    # Absolute, as SQLAlchemy opens files: SQLite takes a relative path `file:NAME` for a URI
    with (
        closing(sqlite3.connect(path.absolute())) as source,
        closing(sqlite3.connect(part.absolute())) as target,
    ):
        source.backup(target)
    if (copied := part.stat().st_size) != size:
        raise OSError(f"the copy has {copied} bytes, but the database has {size} bytes")
    sync_folder(path.parent)


def _refuse_copy(path: Path, reason: str) -> StoreError:
    """Return the error that an SQLite file cannot be copied before an upgrade."""
    return StoreError(
        f"the copy of {path} before the upgrade cannot be written: {reason}",
        "nothing was changed; free space on the disk, or save the database elsewhere and run `jointstiff "
        f"database upgrade --no-copy --database {shlex.quote(f'sqlite:///{path}')}`",
    )


def _rewrite_all_documents(database: Database) -> None:
    """Rewrite all documents of earlier forms before a contract step.

    Raises:
        StoreError: some documents cannot be rewritten.
    """
    old_documents = OldDocuments(database)
    while old_documents.rewrite(_REWRITE_SECONDS):
        pass
    left = old_documents.list_left()
    if left:
        further = f"; and {len(left) - _MOST_NAMED} more" if len(left) > _MOST_NAMED else ""
        raise StoreError(
            f"documents of an earlier form cannot be rewritten ({len(left)}): "
            f"{'; '.join(left[:_MOST_NAMED])}{further}",
            "start a service of the version before, let the jobs end there that have not ended, delete there "
            "what is damaged (on the page, or by `DELETE /v1/jobs/ID`), stop the service, and upgrade again",
        )


def _is_locked(error: DBAPIError) -> bool:
    """Return whether a statement failed because another program has a lock."""
    code = getattr(error.orig, "sqlite_errorcode", 0) & 0xFF
    return code == sqlite3.SQLITE_BUSY or getattr(error.orig, "sqlstate", None) in _LOCKED_STATES


def _read_layout_of(url: str) -> str:
    """Return the layout of an existing database; empty if it has no tables of ours."""
    with closing(open_existing(url)) as database, database.reading() as connection:
        return read_layout(connection) or ""


@contextmanager
def _migrating_engine(url: str) -> Iterator[sa.Engine]:
    """Yield an engine for changes of the tables."""
    engine = make_migrating_engine(url)
    try:
        yield engine
    finally:
        engine.dispose()
