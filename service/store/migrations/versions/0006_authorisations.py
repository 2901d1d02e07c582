"""Authorisations of reports."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0006_authorisations"
down_revision = "0005_trend_notes"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "authorisations",
        sa.Column(
            "sequence",
            sa.BigInteger().with_variant(sa.Integer(), "sqlite"),
            sa.Identity(always=True),
            nullable=False,
        ),
        _text("run_id"),
        _text("supersedes", nullable=True),
        sa.Column("authorised_at", sa.DateTime(timezone=True), nullable=False),
        *(_text(name) for name in ("key_id", "key_name", "content_hash")),
        _text("note", nullable=True),
        sa.PrimaryKeyConstraint("sequence", name="pk_authorisations"),
    )
    for name in ("run_id", "supersedes"):
        op.create_index(f"ix_authorisations_{name}_sequence", "authorisations", [name, "sequence"])


def downgrade() -> None:
    op.drop_table("authorisations")


def _text(name: str, *, nullable: bool = False) -> sa.Column[Any]:
    return sa.Column(name, sa.String(), nullable=nullable)
