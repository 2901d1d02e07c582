"""Arms of a robot with their tested joints and the order on a wall; marks and reference campaigns of a robot.

The index of outdated campaigns has another condition: a program of layout 0019 then reads the small table
without this index. Such a program writes no arms, so what it derived is derived anew.
"""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0020_expand_arms"
down_revision = "0019_expand_readable"

_COLUMNS: dict[str, dict[str, sa.types.TypeEngine[Any]]] = {
    "last_campaigns": {
        "arms_derived": sa.Integer(),
        "arms": sa.JSON(none_as_null=True),
        "rank": sa.Float(),
    },
    "robots": {
        "marks": sa.JSON(none_as_null=True),
        "reference_set_ids": sa.JSON(none_as_null=True),
    },
}
_INDEX = "ix_last_campaigns_due"


def upgrade() -> None:
    """Expand: add the columns, and make the index of outdated campaigns anew."""
    for table, columns in _COLUMNS.items():
        for name, kind in columns.items():
            op.add_column(table, sa.Column(name, kind, nullable=True))
    is_due = sa.text("arms_derived IS NULL OR arms_derived < changes")
    op.drop_index(_INDEX, "last_campaigns")
    op.create_index(_INDEX, "last_campaigns", ["robot_id"], sqlite_where=is_due, postgresql_where=is_due)
    if op.get_bind().dialect.name == "sqlite":  # plans rest on assumed statistics of each index
        statistics = sa.text("INSERT INTO sqlite_stat1 (tbl, idx, stat) VALUES (:table, :name, '100 1')")
        op.get_bind().execute(statistics, {"table": "last_campaigns", "name": _INDEX})
