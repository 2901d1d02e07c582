"""Contents of a database as numbers that a copy must have, too: rows of each table and their hash."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Final

from pydantic import BaseModel, ConfigDict
from sqlalchemy import Connection, inspect

from jointstiff.service.store.tables import heartbeats, metadata

_VERSIONS: Final = "alembic_version"
_AT_ONCE: Final = 50
"""Rows in memory at a time; the largest have some megabytes."""


class TableContent(BaseModel):
    """Content of one table."""

    model_config = ConfigDict(frozen=True)

    rows: int  # their number
    sha256: str  # SHA-256 of all their values, in the order of the primary key


def content_of(connection: Connection) -> dict[str, TableContent]:
    """Return the content of the store's tables that are there, by name; signs of life do not count.

    Values are hashed as the driver gives them, so the two kinds of database do not compare.

    Args:
        connection: in a transaction, if others write.
    """
    inspector = inspect(connection)
    names = set(inspector.get_table_names()) & {*metadata.tables, _VERSIONS} - {heartbeats.name}
    keys = {name: inspector.get_pk_constraint(name)["constrained_columns"] for name in sorted(names)}
    return {name: _table_content(connection, name, columns) for name, columns in keys.items()}


def revision_of(connection: Connection) -> str | None:
    """Return the schema version of a database; None if it has no tables of ours."""
    if _VERSIONS not in inspect(connection).get_table_names():
        return None
    revision = connection.exec_driver_sql("SELECT version_num FROM alembic_version").scalar()
    return None if revision is None else str(revision)


def _table_content(connection: Connection, name: str, keys: Iterable[str]) -> TableContent:
    order = ", ".join(f'"{key}"' for key in keys)
    query = f'SELECT * FROM "{name}" ORDER BY {order}'  # noqa: S608 - names of our own tables and columns
    hashed, rows = hashlib.sha256(), 0
    stream = connection.execution_options(stream_results=True, yield_per=_AT_ONCE)
    for row in stream.exec_driver_sql(query):
        rows += 1
        for value in row:
            data = value if isinstance(value, bytes) else repr(value).encode()
            hashed.update(len(data).to_bytes(8, "big"))
            hashed.update(data)
    return TableContent(rows=rows, sha256=hashed.hexdigest())
