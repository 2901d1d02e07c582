"""Metadata of measurement sets, and robots and sets that are archived."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004_metadata"
down_revision = "0003_deletion"
branch_labels = None
depends_on = None

_TEXTS = ("operator", "instrument", "serial_number", "conditions", "notes")
_FILTERS = ("content_hash", "serial_number", "operator", "instrument", "measured_at")


def upgrade() -> None:
    for table in ("robots", "measurement_sets"):
        op.add_column(table, sa.Column("archived", sa.Boolean(), server_default=sa.false(), nullable=False))
    op.add_column("measurement_sets", sa.Column("measured_at", sa.DateTime(timezone=True), nullable=True))
    for name in _TEXTS:
        op.add_column("measurement_sets", sa.Column(name, sa.String(), nullable=True))
    for name in _FILTERS:
        op.create_index(f"ix_measurement_sets_{name}_sequence", "measurement_sets", [name, "sequence"])
    op.create_index("ix_robots_content_hash_sequence", "robots", ["content_hash", "sequence"])


def downgrade() -> None:
    op.drop_index("ix_robots_content_hash_sequence", "robots")
    for name in _FILTERS:
        op.drop_index(f"ix_measurement_sets_{name}_sequence", "measurement_sets")
    for name in ("measured_at", *_TEXTS):
        op.drop_column("measurement_sets", name)
    for table in ("measurement_sets", "robots"):
        op.drop_column(table, "archived")
