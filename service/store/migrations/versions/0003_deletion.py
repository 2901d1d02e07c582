"""Robots and measurement sets that can be deleted, as jobs can."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003_deletion"
down_revision = "0002_access"
branch_labels = None
depends_on = None

_DELETED = sa.text("deleted_at IS NOT NULL")


def upgrade() -> None:
    for table in ("robots", "measurement_sets"):
        op.add_column(table, sa.Column("deleted_at", sa.DateTime(timezone=True), nullable=True))
        op.create_index(
            f"ix_{table}_deleted_at", table, ["deleted_at"], sqlite_where=_DELETED, postgresql_where=_DELETED
        )


def downgrade() -> None:
    for table in ("measurement_sets", "robots"):
        op.drop_index(f"ix_{table}_deleted_at", table)
        op.drop_column(table, "deleted_at")
