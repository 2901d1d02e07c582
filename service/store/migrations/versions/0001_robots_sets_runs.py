"""Robots, measurement sets, runs and idempotency keys."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    _create_listed(
        "robots",
        _text("name"),
        _time("created_at"),
        _text("content_hash"),
        sa.Column("document", sa.Text(), nullable=False),
        filters=("name",),
    )
    _create_listed(
        "measurement_sets",
        _text("robot_id"),
        _text("name"),
        _text("encoders"),
        sa.Column("observation_count", sa.Integer(), nullable=False),
        sa.Column("warning_count", sa.Integer(), nullable=False),
        _time("created_at"),
        _text("content_hash"),
        sa.Column("document", sa.Text(), nullable=False),
        sa.Column("arrays", sa.LargeBinary(), nullable=False),
        _reference("measurement_sets", "robot_id", "robots"),
        filters=("robot_id", "name", "encoders"),
    )
    _create_listed(
        "runs",
        _text("measurement_set_id"),
        _text("robot_id"),
        _text("method"),
        _text("weighting"),
        sa.Column("positive", sa.Boolean(), nullable=False),
        _text("state"),
        _time("created_at"),
        sa.Column("document", sa.Text(), nullable=False),
        _reference("runs", "measurement_set_id", "measurement_sets"),
        _reference("runs", "robot_id", "robots"),
        filters=("measurement_set_id", "robot_id", "method", "weighting", "state"),
    )
    op.create_table(
        "idempotency_keys",
        _text("resource"),
        _text("key_hash"),
        _text("body_hash"),
        _text("resource_id"),
        _time("created_at"),
        sa.PrimaryKeyConstraint("resource", "key_hash", name="pk_idempotency_keys"),
    )


def downgrade() -> None:
    for table in ("idempotency_keys", "runs", "measurement_sets", "robots"):
        op.drop_table(table)


def _create_listed(name: str, *items: Any, filters: tuple[str, ...]) -> None:  # noqa: ANN401
    op.create_table(
        name,
        sa.Column(
            "sequence",
            sa.BigInteger().with_variant(sa.Integer(), "sqlite"),
            sa.Identity(always=True),
            nullable=False,
        ),
        _text("id"),
        *items,
        sa.PrimaryKeyConstraint("sequence", name=f"pk_{name}"),
        sa.UniqueConstraint("id", name=f"uq_{name}_id"),
    )
    for column in filters:
        op.create_index(f"ix_{name}_{column}_sequence", name, [column, "sequence"])


def _text(name: str) -> sa.Column[str]:
    return sa.Column(name, sa.String(), nullable=False)


def _time(name: str) -> sa.Column[Any]:
    return sa.Column(name, sa.DateTime(timezone=True), nullable=False)


def _reference(table: str, column: str, parent: str) -> sa.ForeignKeyConstraint:
    return sa.ForeignKeyConstraint([column], [f"{parent}.id"], name=f"fk_{table}_{column}")
