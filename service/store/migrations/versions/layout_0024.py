"""Documents of version 24: corrections may be those of robot programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0024_expand_programs"
down_revision = "0023_expand_hands"

SCHEMA = 24


TABLES = [
    sa.table(
        name,
        sa.column("sequence", sa.BigInteger),
        sa.column("schema", sa.Integer),
        sa.column("document", sa.LargeBinary),
    )
    for name in ("robots", "measurement_sets", "open_sets", "jobs")
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
    """Documents: return the document of a row of one of `TABLES`; the new code may be absent."""
    return {"document": row["document"]}
