"""Documents of version 24: runs state one solution, and corrections may be those of robot programs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import sqlalchemy as sa
from alembic import op
from pydantic_core import to_json

from jointstiff.service.history.raising import raise_document
from jointstiff.service.store.compression import compress_text
from jointstiff.service.store.documents import read_text

revision = "0024_expand_solution"
down_revision = "0023_expand_hands"

SCHEMA = 24


def _table(name: str, *further_columns: sa.ColumnClause[Any]) -> sa.TableClause:
    """Return a table with documents, with its columns that `rewrite` reads or fills."""
    return sa.table(
        name,
        sa.column("sequence", sa.BigInteger),
        sa.column("schema", sa.Integer),
        sa.column("document", sa.LargeBinary),
        *further_columns,
    )


TABLES = [
    _table("robots"),
    _table("measurement_sets"),
    _table("open_sets"),
    _table("jobs", sa.column("kind", sa.String)),
]


def upgrade() -> None:
    """Expand: make the indexes of the rows to rewrite anew."""
    is_old = sa.text("schema < 24")
    for table in TABLES:
        name = f"ix_{table.name}_old"
        op.drop_index(name, table.name)
        op.create_index(name, table.name, ["sequence"], sqlite_where=is_old, postgresql_where=is_old)
        if op.get_bind().dialect.name == "sqlite":  # plans rest on assumed statistics of each index
            statistics = sa.text("INSERT INTO sqlite_stat1 (tbl, idx, stat) VALUES (:table, :name, '100 1')")
            op.get_bind().execute(statistics, {"table": table.name, "name": name})


def rewrite(row: Mapping[str, Any]) -> dict[str, Any]:
    """Documents: return the new document of a row of one of `TABLES`.

    Raises:
        DamagedError: the document is damaged.
    """
    is_job = "kind" in row
    if not is_job:  # robots and campaigns have the same form in both versions
        return {"document": row["document"]}
    job = json.loads(read_text(row["document"]))
    raised = raise_document(row["kind"], job, 23).document
    return {"document": compress_text(to_json(raised).decode())}
