"""Place of the queue's tables on PostgreSQL: a schema of their own, apart from the tables of the store.

Programs of layout 0018 had them in the schema of the store; `move_tables` moves them. The names of the tables
are those that DBOS has made in the new schema.
"""

from __future__ import annotations

from typing import Final

import sqlalchemy as sa

from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import lock_tables

_FIRST: Final = "workflow_status"  # the table to which others refer
_VERSION: Final = "dbos_migrations"  # the table of the version of the tables, which is not copied
_TABLES: Final = sa.text("SELECT table_name FROM information_schema.tables WHERE table_schema = :schema")
_COLUMNS: Final = sa.text(
    "SELECT column_name FROM information_schema.columns "
    "WHERE table_schema = :schema AND table_name = :table AND is_generated = 'NEVER'"
)
_FUNCTIONS: Final = sa.text(
    "SELECT old.oid::regprocedure::text FROM pg_proc old WHERE old.pronamespace = to_regnamespace(:source) "
    "AND EXISTS (SELECT FROM pg_proc new WHERE new.pronamespace = to_regnamespace(:target) "
    "AND new.proname = old.proname)"
)


def move_tables(store: Store, source: str, target: str) -> None:
    """Move the rows of the queue to its own schema; do nothing if they are there already.

    Args:
        store: store on PostgreSQL.
        source: schema of the store's tables, where the queue's tables were.
        target: schema where DBOS has made its tables.
    """
    with store.transaction() as connection:
        if _VERSION not in _list_names(connection, _TABLES, schema=source):
            return
        lock_tables(connection)
        old_tables = _list_names(connection, _TABLES, schema=source)
        if _VERSION not in old_tables:  # another process has moved the rows meanwhile
            return
        tables = sorted(old_tables & _list_names(connection, _TABLES, schema=target), key=_sorting_place)
        for table in tables:
            if table != _VERSION:
                _copy_rows(connection, table, source, target)
        quote = connection.dialect.identifier_preparer.quote
        for table in reversed(tables):
            connection.exec_driver_sql(f"DROP TABLE {quote(source)}.{quote(table)} CASCADE")
        for function in _list_names(connection, _FUNCTIONS, source=source, target=target):
            connection.exec_driver_sql(f"DROP FUNCTION {function}")


def _sorting_place(table: str) -> tuple[bool, str]:
    """Return the key that sorts tables: the one to which others refer first."""
    return table != _FIRST, table


def _list_names(connection: sa.Connection, query: sa.TextClause, **values: str) -> set[str]:
    """Return the names that a query finds."""
    return {str(name) for name in connection.execute(query, values).scalars()}


def _copy_rows(connection: sa.Connection, table: str, source: str, target: str) -> None:
    """Copy the rows of a table, in the columns that both schemas have."""
    columns = _list_names(connection, _COLUMNS, schema=source, table=table)
    columns &= _list_names(connection, _COLUMNS, schema=target, table=table)
    quote = connection.dialect.identifier_preparer.quote
    names = ", ".join(quote(column) for column in sorted(columns))
    connection.exec_driver_sql(
        f"INSERT INTO {quote(target)}.{quote(table)} ({names}) "  # noqa: S608 - names of the database itself
        f"SELECT {names} FROM {quote(source)}.{quote(table)} ON CONFLICT DO NOTHING"
    )
