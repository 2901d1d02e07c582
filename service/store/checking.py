"""Checks of a database: its file, its tables, and that every document can be read."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext

from jointstiff.service.problems import DamagedError
from jointstiff.service.store.compression import decompress
from jointstiff.service.store.database import Database
from jointstiff.service.store.documents import CompressedBytes, CompressedText, read_text
from jointstiff.service.store.layouts import LAYOUT
from jointstiff.service.store.tables import layouts, metadata, read_layout

_PORTION: Final = 10  # rows that are read at a time; a row may have many megabytes


@dataclass
class Checked:
    """Findings of a check."""

    documents: int = 0  # number of documents that were read
    faults: list[str] = field(default_factory=list)  # sentences
    remarks: list[str] = field(default_factory=list)  # sentences about what is no fault


def check_database(database: Database) -> Checked:
    """Check a database of the layout of this program, or of one that it can upgrade; nothing is changed.

    Only tables of the layout of this program are compared.
    """
    checked = Checked()
    with database.reading() as connection:
        if database.dialect == "sqlite":
            integrity = connection.exec_driver_sql("PRAGMA integrity_check").scalars().all()
            checked.faults += [f"SQLite: {line}" for line in integrity if line != "ok"]
            references = connection.exec_driver_sql("PRAGMA foreign_key_check").all()
            checked.faults += [f"a row of {row[0]} refers to a missing row of {row[2]}" for row in references]
        if read_layout(connection) == LAYOUT:
            checked.faults += list_differences(connection)
            checked.remarks += _list_foreign_indexes(connection)
    for table in metadata.sorted_tables:
        kinds = (CompressedText, CompressedBytes)
        compressed = [column for column in table.c if isinstance(column.type, kinds)]
        if compressed:
            _check_documents(database, table, compressed, checked)
    return checked


def list_differences(connection: sa.Connection, tables: sa.MetaData = metadata) -> list[str]:
    """Return how the tables of a database differ from those of this program, one sentence each.

    Tables and indexes that other programs added are no difference.
    """

    def is_ours(_: object, name: str | None, kind: str, *__: object) -> bool:
        if kind == "index":
            return name in _names_of_indexes(tables)
        return kind != "table" or (name in tables.tables and name != layouts.name)

    options = {
        "include_object": is_ours,
        "compare_type": True,
        # SQLite does not tell that `sequence` is an identity.
        "compare_server_default": connection.dialect.name == "postgresql",
    }
    differences = compare_metadata(MigrationContext.configure(connection, opts=options), tables)
    return [f"the tables differ from those of this version: {difference}" for difference in differences]


def _list_foreign_indexes(connection: sa.Connection) -> list[str]:
    """Return a sentence for each index that others have added to a table of this program."""
    ours, inspector = _names_of_indexes(metadata), sa.inspect(connection)
    return [
        f"{table}: the index {index['name']} is not of Jointstiff, and remains as it is"
        for table in metadata.tables
        for index in inspector.get_indexes(table)
        if index["name"] not in ours and "duplicates_constraint" not in index
    ]


def _names_of_indexes(tables: sa.MetaData) -> set[str]:
    """Return the names of all indexes of some tables."""
    return {str(index.name) for table in tables.sorted_tables for index in table.indexes}


def _check_documents(
    database: Database, table: sa.Table, compressed: list[sa.Column[Any]], checked: Checked
) -> None:
    """Read all documents of a table, and note the faults."""
    for row in _iterate_rows(database, table, compressed):
        for column in compressed:
            content = getattr(row, column.name)
            if content is None:
                continue
            checked.documents += 1
            try:
                if isinstance(column.type, CompressedText):
                    json.loads(read_text(bytes(content)))
                else:
                    decompress(bytes(content))
            except (DamagedError, ValueError):
                checked.faults.append(f"{table.name}: {column.name} of {row.id} is damaged")


def _iterate_rows(database: Database, table: sa.Table, compressed: list[sa.Column[Any]]) -> Iterator[Any]:
    """Yield sequence, id and compressed columns, as they are stored, of all rows of a table."""
    stored = [sa.type_coerce(column, sa.LargeBinary).label(column.name) for column in compressed]
    query = sa.select(table.c.sequence, table.c.id, *stored).order_by(table.c.sequence).limit(_PORTION)
    last = 0
    while rows := database.rows(query.where(table.c.sequence > last)):
        yield from rows
        last = rows[-1].sequence
