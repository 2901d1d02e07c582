"""Comparisons; steps of jobs of any kind."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

_FILTERS = ("measurement_set_id", "robot_id", "state")


def upgrade() -> None:
    op.create_table(
        "comparisons",
        sa.Column(
            "sequence",
            sa.BigInteger().with_variant(sa.Integer(), "sqlite"),
            sa.Identity(always=True),
            nullable=False,
        ),
        sa.Column("id", sa.String(), nullable=False),
        sa.Column("measurement_set_id", sa.String(), nullable=False),
        sa.Column("robot_id", sa.String(), nullable=False),
        sa.Column("state", sa.String(), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("document", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(
            ["measurement_set_id"], ["measurement_sets.id"], name="fk_comparisons_measurement_set_id"
        ),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name="fk_comparisons_robot_id"),
        sa.PrimaryKeyConstraint("sequence", name="pk_comparisons"),
        sa.UniqueConstraint("id", name="uq_comparisons_id"),
    )
    for column in _FILTERS:
        op.create_index(f"ix_comparisons_{column}_sequence", "comparisons", [column, "sequence"])
    op.create_table(
        "job_steps",
        sa.Column("job_id", sa.String(), nullable=False),
        sa.Column("start", sa.Integer(), nullable=False),
        sa.Column("done", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("job_id", "start", name="pk_job_steps"),
    )
    op.execute("INSERT INTO job_steps (job_id, start, done) SELECT run_id, start, done FROM run_steps")
    op.drop_table("run_steps")


def downgrade() -> None:
    op.create_table(
        "run_steps",
        sa.Column("run_id", sa.String(), nullable=False),
        sa.Column("start", sa.Integer(), nullable=False),
        sa.Column("done", sa.Integer(), nullable=False),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name="fk_run_steps_run_id"),
        sa.PrimaryKeyConstraint("run_id", "start", name="pk_run_steps"),
    )
    op.execute(
        "INSERT INTO run_steps (run_id, start, done) "
        "SELECT job_id, start, done FROM job_steps WHERE job_id IN (SELECT id FROM runs)"
    )
    op.drop_table("job_steps")
    op.drop_table("comparisons")
