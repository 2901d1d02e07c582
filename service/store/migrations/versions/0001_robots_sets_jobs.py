"""Robots, measurement sets, jobs of all kinds, and what goes with them."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0001_jobs"  # "0001" to "0008" were layouts from before the first release
down_revision = None
branch_labels = None
depends_on = None

_DELETED = sa.text("deleted_at IS NOT NULL")


def upgrade() -> None:
    _create_listed(
        "robots",
        _text("name"),
        _time("created_at"),
        _text("content_hash"),
        _text("document"),
        filters=[["name"]],
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
        _text("document"),
        sa.Column("arrays", sa.LargeBinary(), nullable=False),
        _reference("measurement_sets", "robot_id", "robots"),
        filters=[["robot_id"], ["name"], ["encoders"]],
    )
    _create_jobs()
    op.create_table(
        "idempotency_keys",
        _text("resource"),
        _text("key_hash"),
        _text("body_hash"),
        _text("resource_id"),
        _time("created_at"),
        sa.PrimaryKeyConstraint("resource", "key_hash", name="pk_idempotency_keys"),
    )
    op.create_table(
        "job_steps",
        _text("job_id"),
        sa.Column("start", sa.Integer(), nullable=False),
        sa.Column("done", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("job_id", "start", name="pk_job_steps"),
    )
    op.create_table(
        "heartbeats",
        _text("executor"),
        _time("beat_at"),
        sa.PrimaryKeyConstraint("executor", name="pk_heartbeats"),
    )


def downgrade() -> None:
    for table in ("heartbeats", "job_steps", "idempotency_keys", "jobs", "measurement_sets", "robots"):
        op.drop_table(table)


def _create_jobs() -> None:
    sets = ("measurement_set_id", "first_set_id", "second_set_id")
    options = ("method", "weighting", "elasticity")
    _create_listed(
        "jobs",
        _text("kind"),
        _text("state"),
        _time("created_at"),
        sa.Column("summary", sa.JSON(), nullable=False),
        *(sa.Column(name, sa.String(), nullable=True) for name in ("robot_id", *sets, "name", *options)),
        _text("document"),
        sa.Column("deaths", sa.Integer(), server_default="0", nullable=False),
        sa.Column("deleted_at", sa.DateTime(timezone=True), nullable=True),
        *(_reference("jobs", name, "measurement_sets") for name in sets),
        _reference("jobs", "robot_id", "robots"),
        filters=[
            ["kind"],
            ["kind", "state"],
            ["kind", "robot_id"],
            ["kind", "name"],
            *([name] for name in (*sets, *options)),
        ],
    )
    op.create_index(
        "ix_jobs_deleted_at", "jobs", ["deleted_at"], sqlite_where=_DELETED, postgresql_where=_DELETED
    )


def _create_listed(name: str, *items: Any, filters: list[list[str]]) -> None:  # noqa: ANN401
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
    for columns in filters:
        op.create_index(f"ix_{name}_{'_'.join(columns)}_sequence", name, [*columns, "sequence"])


def _text(name: str) -> sa.Column[str]:
    return sa.Column(name, sa.String(), nullable=False)


def _time(name: str) -> sa.Column[Any]:
    return sa.Column(name, sa.DateTime(timezone=True), nullable=False)


def _reference(table: str, column: str, parent: str) -> sa.ForeignKeyConstraint:
    return sa.ForeignKeyConstraint([column], [f"{parent}.id"], name=f"fk_{table}_{column}")
