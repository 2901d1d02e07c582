"""All tables of the first release."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0001_tables"  # layouts from before the first release had other names
down_revision = None
branch_labels = None
depends_on = None

_DELETED = sa.text("deleted_at IS NOT NULL")


def upgrade() -> None:
    _create_listed(
        "robots",
        *_texts("id", "name"),
        _time("created_at"),
        *_texts("content_hash", "document"),
        _archived(),
        filters=["name", "content_hash"],
    )
    _create_listed(
        "measurement_sets",
        *_texts("id", "robot_id", "name", "encoders"),
        sa.Column("observation_count", sa.Integer(), nullable=False),
        sa.Column("warning_count", sa.Integer(), nullable=False),
        _time("created_at"),
        *_texts("content_hash", "document"),
        sa.Column("arrays", sa.LargeBinary(), nullable=False),
        _archived(),
        _time("measured_at", nullable=True),
        *_texts("operator", "instrument", "serial_number", "conditions", "notes", nullable=True),
        _reference("measurement_sets", "robot_id", "robots"),
        filters=[
            *("robot_id", "name", "encoders", "content_hash"),
            *("serial_number", "operator", "instrument", "measured_at"),
        ],
    )
    sets = ("measurement_set_id", "first_set_id", "second_set_id")
    options = ("method", "weighting", "elasticity")
    _create_listed(
        "jobs",
        *_texts("id", "kind", "state"),
        _time("created_at"),
        sa.Column("summary", sa.JSON(), nullable=False),
        *_texts("robot_id", *sets, "name", *options, nullable=True),
        *_texts("document"),
        sa.Column("deaths", sa.Integer(), server_default="0", nullable=False),
        *(_reference("jobs", name, "measurement_sets") for name in sets),
        _reference("jobs", "robot_id", "robots"),
        filters=["kind", ("kind", "state"), ("kind", "robot_id"), ("kind", "name"), *sets, *options],
    )
    op.create_table(
        "idempotency_keys",
        *_texts("resource", "key_hash", "body_hash", "resource_id"),
        _time("created_at"),
        sa.PrimaryKeyConstraint("resource", "key_hash", name="pk_idempotency_keys"),
    )
    op.create_table(
        "job_steps",
        *_texts("job_id"),
        sa.Column("start", sa.Integer(), nullable=False),
        sa.Column("done", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("job_id", "start", name="pk_job_steps"),
    )
    op.create_table(
        "heartbeats",
        *_texts("executor"),
        _time("beat_at"),
        sa.PrimaryKeyConstraint("executor", name="pk_heartbeats"),
    )
    op.create_table(
        "access_keys",
        *_texts("id", "name", "role", "key_hash"),
        _time("created_at"),
        *(_time(name, nullable=True) for name in ("expires_at", "revoked_at", "last_used_at")),
        sa.PrimaryKeyConstraint("id", name="pk_access_keys"),
    )
    op.create_table(
        "access_sessions",
        *_texts("token_hash", "key_id"),
        _time("created_at"),
        _time("used_at"),
        sa.PrimaryKeyConstraint("token_hash", name="pk_access_sessions"),
    )
    op.create_table(
        "access_links",
        *_texts("token_hash", "key_id"),
        _time("ends_at"),
        sa.PrimaryKeyConstraint("token_hash", name="pk_access_links"),
    )
    _create_numbered(
        "audit",
        _time("at"),
        *_texts("key_id", "key_name", nullable=True),
        *_texts("address", "method"),
        *_texts("operation", nullable=True),
        *_texts("path"),
        sa.Column("status", sa.Integer(), nullable=False),
        filters=["key_id"],
    )
    _create_numbered(
        "trend_notes",
        *_texts("robot_id", "kind"),
        _time("noted_at"),
        *_texts("key_id", "key_name", nullable=True),
        *_texts("document"),
        filters=["robot_id"],
    )
    _create_numbered(
        "authorisations",
        *_texts("run_id"),
        *_texts("supersedes", nullable=True),
        _time("authorised_at"),
        *_texts("key_id", "key_name", "content_hash"),
        *_texts("note", nullable=True),
        filters=["run_id", "supersedes"],
    )


def downgrade() -> None:
    for table in (
        *("authorisations", "trend_notes", "audit", "access_links", "access_sessions", "access_keys"),
        *("heartbeats", "job_steps", "idempotency_keys", "jobs", "measurement_sets", "robots"),
    ):
        op.drop_table(table)


def _create_listed(name: str, *items: Any, filters: list[str | tuple[str, ...]]) -> None:  # noqa: ANN401
    _create_numbered(
        name,
        *items,
        _time("deleted_at", nullable=True),
        sa.UniqueConstraint("id", name=f"uq_{name}_id"),
        filters=filters,
    )
    op.create_index(
        f"ix_{name}_deleted_at", name, ["deleted_at"], sqlite_where=_DELETED, postgresql_where=_DELETED
    )


def _create_numbered(name: str, *items: Any, filters: list[Any]) -> None:  # noqa: ANN401
    number = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
    op.create_table(
        name,
        sa.Column("sequence", number, sa.Identity(always=True), nullable=False),
        *items,
        sa.PrimaryKeyConstraint("sequence", name=f"pk_{name}"),
    )
    for each in filters:
        columns = [each] if isinstance(each, str) else list(each)
        op.create_index(f"ix_{name}_{'_'.join(columns)}_sequence", name, [*columns, "sequence"])


def _texts(*names: str, nullable: bool = False) -> list[sa.Column[str]]:
    return [sa.Column(name, sa.String(), nullable=nullable) for name in names]


def _time(name: str, *, nullable: bool = False) -> sa.Column[Any]:
    return sa.Column(name, sa.DateTime(timezone=True), nullable=nullable)


def _archived() -> sa.Column[bool]:
    return sa.Column("archived", sa.Boolean(), server_default=sa.false(), nullable=False)


def _reference(table: str, column: str, parent: str) -> sa.ForeignKeyConstraint:
    return sa.ForeignKeyConstraint([column], [f"{parent}.id"], name=f"fk_{table}_{column}")
