"""Checks of a database: its file, its tables, and that each row can be read and restored from an archive."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from pydantic_core import from_json

from jointstiff.service.archive.restoring import explain_refusal
from jointstiff.service.archive.rows import BUILDERS
from jointstiff.service.archive.writing import find_version, make_line, name_row
from jointstiff.service.problems import DamagedError
from jointstiff.service.store.compression import decompress
from jointstiff.service.store.database import open_existing
from jointstiff.service.store.documents import CompressedBytes, CompressedText, read_text
from jointstiff.service.store.layouts import LAYOUT
from jointstiff.service.store.snapshot import Snapshot, read_snapshot
from jointstiff.service.store.tables import layouts, metadata, read_layout


@dataclass
class Checked:
    """Findings of a check."""

    documents: int = 0  # number of documents that were read
    faults: list[str] = field(default_factory=list)  # sentences
    remarks: list[str] = field(default_factory=list)  # sentences about what is no fault


def check_database(url: str) -> Checked:
    """Check a database of the layout of this program, or of one that it can upgrade; nothing is changed.

    Only tables of the layout of this program are compared.

    Raises:
        StoreError: the database does not exist, or has no tables of ours.
    """
    checked = Checked()
    with closing(open_existing(url)) as database, database.reading() as connection:
        if database.dialect == "sqlite":
            integrity = connection.exec_driver_sql("PRAGMA integrity_check").scalars().all()
            checked.faults += [f"SQLite: {line}" for line in integrity if line != "ok"]
            references = connection.exec_driver_sql("PRAGMA foreign_key_check").all()
            checked.faults += [f"a row of {row[0]} refers to a missing row of {row[2]}" for row in references]
        if read_layout(connection) == LAYOUT:
            checked.faults += list_differences(connection)
            checked.remarks += _list_foreign_indexes(connection)
    with read_snapshot(url, tuple(metadata.tables)) as snapshot:
        for table in snapshot.tables:
            _check_rows(snapshot, table, checked)
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


def _check_rows(snapshot: Snapshot, table: str, checked: Checked) -> None:
    """Read all documents of a table, let the restorer make each row anew, and note the faults."""
    compressed = [
        column
        for column in metadata.tables[table].c
        if isinstance(column.type, CompressedText | CompressedBytes)
    ]
    build = BUILDERS.get(table)
    version = find_version(snapshot.layout)
    for row in snapshot.rows(table):
        damaged = [column.name for column in compressed if _is_damaged(column, row)]
        checked.documents += sum(row.get(column.name) is not None for column in compressed)
        checked.faults += [f"{table}: {column} of {name_row(row)} is damaged" for column in damaged]
        if damaged or build is None:
            continue
        try:
            build(from_json(make_line(table, row, version)))
        except (DamagedError, ValueError) as error:
            reason = explain_refusal(error)
            checked.faults.append(f"{table}: {name_row(row)} cannot be restored from an archive: {reason}")


def _is_damaged(column: sa.Column[Any], row: Mapping[str, Any]) -> bool:
    """Return whether a compressed column of a row cannot be read; a column without content is not damaged."""
    content = row.get(column.name)
    if content is None:
        return False
    try:
        if isinstance(column.type, CompressedText):
            json.loads(read_text(bytes(content)))
        else:
            decompress(bytes(content))
    except (DamagedError, ValueError):
        return True
    return False
