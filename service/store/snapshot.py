"""Snapshots: the rows of a database of any layout, as they were at one moment; nothing is changed."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import sqlalchemy as sa
from sqlalchemy.exc import DBAPIError

from jointstiff.service.problems import StoreError, StoreUnavailableError
from jointstiff.service.store.database import make_migrating_engine, sqlite_path_of
from jointstiff.service.store.tables import read_layout

_ROWS_AT_A_TIME: Final = 20  # rows that the driver keeps in memory; a row may have many megabytes


class Snapshot:
    """Tables of ours in a database, read by reflection in one transaction."""

    def __init__(self, connection: sa.Connection, layout: str, tables: Mapping[str, sa.Table]) -> None:
        self.layout = layout  # name of the layout of the database
        self.tables = tables  # name → table, of those that the database has
        self._connection = connection

    def rows(self, table: str) -> Iterator[Mapping[Any, Any]]:
        """Yield the rows of a table in the order of their creation, or of their primary key."""
        reflected = self.tables[table]
        query = sa.select(*(column for column in reflected.c if column.name != "sequence"))
        query = query.order_by(*map(self._in_order_of_characters, reflected.primary_key.columns))
        result = self._connection.execution_options(yield_per=_ROWS_AT_A_TIME).execute(query)
        for row in result:
            yield row._mapping

    def _in_order_of_characters(self, column: sa.Column[Any]) -> sa.ColumnElement[Any]:
        """Return a column to sort by, in the same order on both databases."""
        is_text = isinstance(column.type, sa.String) and self._connection.dialect.name == "postgresql"
        return column.collate("C") if is_text else column


@contextmanager
def read_snapshot(url: str, names: tuple[str, ...]) -> Iterator[Snapshot]:
    """Yield a snapshot of some tables of a database.

    Args:
        url: URL of the database.
        names: names of the tables; those that the database does not have are left out.

    Raises:
        StoreError: the database does not exist, or has no tables of ours.
        StoreUnavailableError: the database does not answer.
    """
    engine = _make_reading_engine(url)
    try:
        with engine.connect() as connection, connection.begin():
            layout = read_layout(connection)
            if layout is None:
                raise StoreError("the database has no tables of Jointstiff", "check the URL of the database")
            present = set(sa.inspect(connection).get_table_names())
            metadata = sa.MetaData()
            metadata.reflect(connection, only=[name for name in names if name in present])
            tables = {name: metadata.tables[name] for name in names if name in present}
            yield Snapshot(connection, layout, tables)
    except DBAPIError as error:
        reason = str(error.orig).strip().splitlines()[0][:200]
        raise StoreUnavailableError(
            f"the database cannot be read ({reason})", "check the URL, and that the database answers"
        ) from error
    finally:
        engine.dispose()


def _make_reading_engine(url: str) -> sa.Engine:
    """Create an engine whose transactions read one state of the database, and cannot write."""
    engine = make_migrating_engine(url)
    if engine.dialect.name == "postgresql":
        return engine.execution_options(isolation_level="REPEATABLE READ", postgresql_readonly=True)
    path = sqlite_path_of(engine.url).absolute()
    engine.dispose()
    if not path.exists():
        raise StoreError(f"the database {path} does not exist", "give the URL of a database that exists")
    reader = sa.create_engine(
        "sqlite://", creator=partial(_open_read_only, path), poolclass=sa.NullPool, hide_parameters=True
    )
    sa.event.listen(reader, "begin", _begin)
    return reader


def _open_read_only(path: Path) -> sqlite3.Connection:
    """Open an SQLite file that cannot be written through this connection."""
    # The driver begins no transaction: `_begin` does.
    return sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True, isolation_level=None)


def _begin(connection: sa.Connection) -> None:
    """Begin a transaction of SQLite, which reads the state of its first statement."""
    connection.exec_driver_sql("BEGIN")
