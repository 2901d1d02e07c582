"""All tables of the first release, as `service.store.tables` declares them until it is released."""

from __future__ import annotations

from alembic import op

from jointstiff.service.store.tables import metadata

revision = "0001_webhooks"  # layouts from before the first release had other names
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    metadata.create_all(op.get_bind(), checkfirst=False)


def downgrade() -> None:
    metadata.drop_all(op.get_bind())
