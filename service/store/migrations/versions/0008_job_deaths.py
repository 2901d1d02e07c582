"""How many workers died over a job."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "job_deaths",
        sa.Column("job_id", sa.String(), nullable=False),
        sa.Column("deaths", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("job_id", name="pk_job_deaths"),
    )


def downgrade() -> None:
    op.drop_table("job_deaths")
