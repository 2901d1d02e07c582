"""The store's SQL, built once a kind: to build a statement takes longer than to run it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any

from sqlalchemy import Integer, Select, bindparam, insert, select

from jointstiff.service.store.records import RobotRecord
from jointstiff.service.store.tables import TABLES, idempotency_keys

__all__ = ["INSERT_KEY", "PING", "STATEMENTS", "Statements"]

INSERT_KEY = insert(idempotency_keys)
PING = select(TABLES[RobotRecord].c.id).limit(1)
"""Reads a table of ours: a bare `SELECT 1` would not touch the file of an SQLite database."""


class Statements:
    """What is asked of the table of one kind. Columns come in the order of the kind's fields.

    Attributes:
        insert: Adds a row.
        by_id: Columns of the row whose id is `:id`, unless it is deleted.
        by_key: `body_hash`, then the columns of the row that `:resource`, `:key_hash` created, deleted
            or not.
        exists: The id of the row whose id is `:id`, deleted or not.
    """

    def __init__(self, kind: type) -> None:
        self._table = table = TABLES[kind]
        self._columns = [table.c[field.name] for field in fields(kind)]
        keys = idempotency_keys.c
        self._shown = [table.c.deleted_at.is_(None)] if "deleted_at" in table.c else []
        self.insert = insert(table)
        self.by_id: Select[Any] = select(*self._columns).where(table.c.id == bindparam("id"), *self._shown)
        self.by_key: Select[Any] = (
            select(keys.body_hash, *self._columns)
            .join_from(idempotency_keys, table, keys.resource_id == table.c.id)
            .where(keys.resource == bindparam("resource"), keys.key_hash == bindparam("key_hash"))
        )
        self.exists = select(table.c.id).where(table.c.id == bindparam("id"))

    def page(self, filters: Iterable[str]) -> Select[Any]:
        """`sequence`, then the columns, newest first: `:limit` rows before sequence `:before`.

        Args:
            filters: Columns that must have the value of the parameter of that name.
        """
        table = self._table
        return (
            select(table.c.sequence, *self._columns)
            .where(table.c.sequence < bindparam("before"), *self._shown)
            .where(*(table.c[column] == bindparam(column) for column in filters))
            .order_by(table.c.sequence.desc())
            .limit(bindparam("limit", type_=Integer))
        )


STATEMENTS: Mapping[type, Statements] = MappingProxyType({kind: Statements(kind) for kind in TABLES})
