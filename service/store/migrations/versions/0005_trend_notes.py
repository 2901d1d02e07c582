"""Notes in trends: new baselines and acknowledged alarms."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0005_trend_notes"
down_revision = "0004_metadata"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "trend_notes",
        sa.Column(
            "sequence",
            sa.BigInteger().with_variant(sa.Integer(), "sqlite"),
            sa.Identity(always=True),
            nullable=False,
        ),
        *(_text(name) for name in ("robot_id", "kind")),
        sa.Column("noted_at", sa.DateTime(timezone=True), nullable=False),
        *(_text(name, nullable=True) for name in ("key_id", "key_name")),
        _text("document"),
        sa.PrimaryKeyConstraint("sequence", name="pk_trend_notes"),
    )
    op.create_index("ix_trend_notes_robot_id_sequence", "trend_notes", ["robot_id", "sequence"])


def downgrade() -> None:
    op.drop_table("trend_notes")


def _text(name: str, *, nullable: bool = False) -> sa.Column[Any]:
    return sa.Column(name, sa.String(), nullable=nullable)
