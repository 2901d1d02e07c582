"""What bends in a run, so that listings can say so; runs from before are asked for it in their documents."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

_IN_DOCUMENT = {
    "sqlite": "json_extract(document, '$.request.elasticity')",
    "postgresql": "document::json #>> '{request,elasticity}'",
}


def upgrade() -> None:
    op.add_column("runs", sa.Column("elasticity", sa.String(), nullable=False, server_default="joints"))
    said = _IN_DOCUMENT[op.get_bind().dialect.name]
    op.execute(f"UPDATE runs SET elasticity = coalesce({said}, 'joints')")  # noqa: S608 - a constant
    op.create_index("ix_runs_elasticity_sequence", "runs", ["elasticity", "sequence"])


def downgrade() -> None:
    op.drop_index("ix_runs_elasticity_sequence", "runs")
    op.drop_column("runs", "elasticity")
