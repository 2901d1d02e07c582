"""Pairs."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

_FILTERS = ("first_set_id", "second_set_id", "robot_id", "state")


def upgrade() -> None:
    op.create_table(
        "pairs",
        sa.Column(
            "sequence",
            sa.BigInteger().with_variant(sa.Integer(), "sqlite"),
            sa.Identity(always=True),
            nullable=False,
        ),
        sa.Column("id", sa.String(), nullable=False),
        sa.Column("first_set_id", sa.String(), nullable=False),
        sa.Column("second_set_id", sa.String(), nullable=False),
        sa.Column("robot_id", sa.String(), nullable=False),
        sa.Column("state", sa.String(), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("document", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(["first_set_id"], ["measurement_sets.id"], name="fk_pairs_first_set_id"),
        sa.ForeignKeyConstraint(["second_set_id"], ["measurement_sets.id"], name="fk_pairs_second_set_id"),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name="fk_pairs_robot_id"),
        sa.PrimaryKeyConstraint("sequence", name="pk_pairs"),
        sa.UniqueConstraint("id", name="uq_pairs_id"),
    )
    for column in _FILTERS:
        op.create_index(f"ix_pairs_{column}_sequence", "pairs", [column, "sequence"])


def downgrade() -> None:
    op.drop_table("pairs")
