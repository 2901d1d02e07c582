"""Keys, the sessions of browsers that signed in with one, and the audit."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0002_access"
down_revision = "0001_jobs"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "access_keys",
        *(_text(name) for name in ("id", "name", "role", "key_hash")),
        _time("created_at"),
        *(_time(name, nullable=True) for name in ("expires_at", "revoked_at", "last_used_at")),
        sa.PrimaryKeyConstraint("id", name="pk_access_keys"),
    )
    op.create_table(
        "access_sessions",
        *(_text(name) for name in ("token_hash", "key_id")),
        *(_time(name) for name in ("created_at", "used_at")),
        sa.PrimaryKeyConstraint("token_hash", name="pk_access_sessions"),
    )
    op.create_table(
        "access_links",
        *(_text(name) for name in ("token_hash", "key_id")),
        _time("ends_at"),
        sa.PrimaryKeyConstraint("token_hash", name="pk_access_links"),
    )
    op.create_table(
        "audit",
        sa.Column(
            "sequence",
            sa.BigInteger().with_variant(sa.Integer(), "sqlite"),
            sa.Identity(always=True),
            nullable=False,
        ),
        _time("at"),
        *(_text(name, nullable=True) for name in ("key_id", "key_name")),
        *(_text(name) for name in ("address", "method")),
        _text("operation", nullable=True),
        _text("path"),
        sa.Column("status", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("sequence", name="pk_audit"),
    )
    op.create_index("ix_audit_key_id_sequence", "audit", ["key_id", "sequence"])


def downgrade() -> None:
    for table in ("audit", "access_links", "access_sessions", "access_keys"):
        op.drop_table(table)


def _text(name: str, *, nullable: bool = False) -> sa.Column[str]:
    return sa.Column(name, sa.String(), nullable=nullable)


def _time(name: str, *, nullable: bool = False) -> sa.Column[Any]:
    return sa.Column(name, sa.DateTime(timezone=True), nullable=nullable)
