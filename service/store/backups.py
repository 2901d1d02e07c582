"""Copies of a whole database while others write it, and the way back.

A backup is a folder: the database (an SQLite file, or the archive of pg_dump) and `manifest.json`, which says
what it holds. It has the steps of unfinished jobs as well, so that they go on after a restoration.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sqlite3
import subprocess
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Literal

import sqlalchemy as sa
from pydantic import BaseModel, ConfigDict, ValidationError

from jointstiff.service.problems import StoreError
from jointstiff.service.process import jointstiff_version
from jointstiff.service.store.database import Database, Dialect, make_private, open_existing, path_of
from jointstiff.service.store.tables import (
    has_tables,
    heartbeats,
    layout_of,
    metadata,
    refuse_other_layout,
    wrong_keys,
)

MANIFEST: Final = "manifest.json"
_FILES: Final[dict[Dialect, str]] = {"sqlite": "jointstiff.db", "postgresql": "jointstiff.dump"}
_FOLDER_MODE: Final = 0o700  # readings, and hashes of keys
_AT_ONCE: Final = 50  # rows in memory at a time; the largest have some megabytes


class TableContent(BaseModel):
    """Content of one table."""

    model_config = ConfigDict(frozen=True)

    rows: int  # their number
    sha256: str  # SHA-256 of all their values, in the order of the primary key


class Manifest(BaseModel):
    """Contents of a backup."""

    model_config = ConfigDict(frozen=True)

    format: Literal[1] = 1  # layout of backups
    jointstiff: str = jointstiff_version()  # version that made it
    made_at: datetime  # when the copy began
    database: Dialect  # kind of database that it was made of, and that it can be restored to
    revision: str  # schema version of the tables
    sha256: str  # SHA-256 of the file beside the manifest
    tables: dict[str, TableContent]  # content of each table


def back_up(url: str, folder: Path) -> Manifest:
    """Copy a database as it is at one moment; services and workers may go on meanwhile.

    Raises:
        StoreError: the folder exists or cannot be written, or the database cannot be read.
    """
    if folder.exists():
        raise StoreError(f"{folder} exists", "give the name of a new folder")
    made_at = datetime.now(UTC)
    partial = folder.with_name(f".{folder.name}.{os.getpid()}")
    with _as_store_errors():
        partial.mkdir(mode=_FOLDER_MODE, parents=True)
        try:
            dialect, revision, tables = _copy(url, partial)
            manifest = Manifest(
                made_at=made_at,
                database=dialect,
                revision=revision,
                sha256=_sha256(partial / _FILES[dialect]),
                tables=tables,
            )
            (partial / MANIFEST).write_text(manifest.model_dump_json(indent=1) + "\n", encoding="utf-8")
            for path in (*partial.iterdir(), partial):
                _to_disk(path)
            partial.rename(folder)
            _to_disk(folder.parent)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise
    return manifest


def restore(url: str, folder: Path, *, overwrite: bool = False) -> Manifest:
    """Put a backup in the place of a database that nobody uses, and check that all of it arrived.

    Args:
        url: of the database.
        folder: of the backup.
        overwrite: replace a database that holds something. A file is set aside as `NAME.replaced-TIME`.

    Raises:
        StoreError: there is no whole backup, or a database in its place that holds something or is in use.
    """
    try:
        manifest = Manifest.model_validate_json((folder / MANIFEST).read_bytes())
    except (OSError, ValidationError) as error:
        raise StoreError(f"{folder} has no readable {MANIFEST}", "give the folder of a backup") from error
    refuse_other_layout(manifest.revision)
    source = folder / _FILES[manifest.database]
    with _as_store_errors():
        if _sha256(source) != manifest.sha256:
            raise StoreError(f"{source} has changed since the backup was made", "make another backup")
        parsed = sa.make_url(url)
        if (parsed.get_backend_name() == "sqlite") != (manifest.database == "sqlite"):
            raise StoreError(
                f"this is a backup of a {manifest.database} database", "restore it to a database of that kind"
            )
        if manifest.database == "sqlite":
            _restore_file(parsed, source, manifest, overwrite=overwrite)
        else:
            _restore_archive(url, parsed, source, manifest, overwrite=overwrite)
    return manifest


def copy_file(source: Path, target: Path) -> None:
    """Copy an SQLite database as it is at one moment."""
    with closing(sqlite3.connect(source)) as connection:
        connection.execute("VACUUM INTO ?", [str(target)])


def _copy(url: str, folder: Path) -> tuple[Dialect, str, dict[str, TableContent]]:
    with closing(open_existing(url)) as database:
        dialect = database.dialect
        copy = folder / _FILES[dialect]
        with database.reading() as connection:
            if not has_tables(connection):
                raise StoreError("the database has no Jointstiff tables", "check the URL of the database")
            revision = str(layout_of(connection))
        if dialect == "sqlite":
            copy_file(path_of(sa.make_url(url)), copy)
            with _opened(copy) as connection:
                return dialect, revision, content_of(connection)
        with database.writing() as connection:
            connection.execute(sa.text("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ, READ ONLY"))
            tables = content_of(connection)
            snapshot = str(connection.execute(sa.text("SELECT pg_export_snapshot()")).scalar_one())
            schema = str(connection.execute(sa.text("SELECT current_schema()")).scalar_one())
            schemas = [] if schema == "public" else [f"--schema={schema}"]
            _run(url, "pg_dump", "--format=custom", f"--snapshot={snapshot}", *schemas, f"--file={copy}")
    return dialect, revision, tables


def _restore_file(url: sa.URL, source: Path, manifest: Manifest, *, overwrite: bool) -> None:
    target = path_of(url).absolute()
    if target.exists() and not overwrite:
        raise StoreError(f"{target} exists", "give another file, or use --overwrite, which renames it")
    partial = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        make_private(partial)
        shutil.copyfile(source, partial)
        with _opened(partial) as connection:
            _check_arrived(manifest, connection)
        _to_disk(partial)
        _set_aside(target)
        partial.rename(target)
        _to_disk(target.parent)
    finally:
        partial.unlink(missing_ok=True)


def _set_aside(target: Path) -> None:
    """Rename a database that nobody uses, with what its journal holds."""
    if not target.exists():
        return
    try:
        # Leaving the write-ahead log takes an exclusive lock, which no one gets while others have it open.
        with closing(sqlite3.connect(target, timeout=2.0)) as connection:
            connection.execute("PRAGMA journal_mode=DELETE")
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY:
            raise StoreError(f"{target} is in use", "stop the service and its workers first") from error
    except sqlite3.DatabaseError:
        pass  # damaged: that is why a backup comes in its place
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    for suffix in ("-wal", "-shm", ""):
        path = target.with_name(target.name + suffix)
        if path.exists():
            path.rename(target.with_name(f"{target.name}.replaced-{stamp}{suffix}"))


def _restore_archive(url: str, parsed: sa.URL, source: Path, manifest: Manifest, *, overwrite: bool) -> None:
    with closing(Database.open(url)) as database:
        with database.reading() as connection:
            if layout_of(connection) is not None and not overwrite:
                raise StoreError(
                    f"the database {parsed.database} is not empty",
                    "give an empty database, or use --overwrite",
                )
            others = sa.text(
                "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() "
                "AND backend_type = 'client backend' AND pid <> pg_backend_pid()"
            )
            if connection.execute(others).scalar_one():
                raise StoreError(
                    f"the database {parsed.database} is in use", "stop the service and its workers first"
                )
        replace = ("--clean", "--if-exists") if overwrite else ()
        _run(
            url, "pg_restore", "--no-owner", "--no-privileges", "--single-transaction", *replace, str(source)
        )
        with database.writing() as connection:
            _check_arrived(manifest, connection)


def _check_arrived(manifest: Manifest, connection: sa.Connection) -> None:
    contents = content_of(connection)
    for name, expected in manifest.tables.items():
        if contents.get(name) != expected:
            raise StoreError(f"the restored table {name} differs from the backup", "make another backup")


@contextmanager
def _opened(path: Path) -> Iterator[sa.Connection]:
    engine = sa.create_engine(sa.URL.create("sqlite", database=str(path)))
    try:
        with engine.connect() as connection:
            yield connection
    finally:
        engine.dispose()


def _run(url: str, program: str, *arguments: str) -> None:
    """Run one of PostgreSQL's programs; the password goes by the environment, which only its user sees."""
    parsed = sa.make_url(url).set(drivername="postgresql")
    password = parsed.password or parsed.query.get("password")
    environment = os.environ | ({"PGPASSWORD": str(password)} if password else {})
    shown = parsed._replace(password=None).difference_update_query(["password"])
    database = shown.render_as_string(hide_password=False)
    executable = shutil.which(program)
    if executable is None:
        raise StoreError(f"{program} is not installed", "install PostgreSQL's client programs")
    done = subprocess.run(
        [executable, f"--dbname={database}", *arguments],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if "error" in line] or ["no reason given"]
        raise StoreError(
            f"{program} failed ({lines[0][:200]})",
            "read its message; check that its version fits the server's",
        )


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def _as_store_errors() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StoreError(
            f"{error.filename or 'a file'}: {error.strerror}", "choose a writable folder with free space"
        ) from error
    except sqlite3.Error as error:
        raise StoreError(
            f"the sqlite database failed ({error})", "check it with `jointstiff doctor`"
        ) from error


def content_of(connection: sa.Connection) -> dict[str, TableContent]:
    """Return the content of the store's tables by name, without signs of life and the count of wrong keys.

    Args:
        connection: in a transaction, if others write.
    """
    contents = {}
    stream = connection.execution_options(stream_results=True, yield_per=_AT_ONCE)
    for table in metadata.sorted_tables:
        if table in {heartbeats, wrong_keys}:
            continue
        hashed, rows = hashlib.sha256(), 0
        for row in stream.execute(sa.select(table).order_by(*table.primary_key)):
            rows += 1
            for value in row:
                data = value if isinstance(value, bytes) else repr(value).encode("utf-8", "surrogatepass")
                hashed.update(len(data).to_bytes(8, "big"))
                hashed.update(data)
        contents[table.name] = TableContent(rows=rows, sha256=hashed.hexdigest())
    return contents
