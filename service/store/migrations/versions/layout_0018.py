"""The oldest layout that can be upgraded."""

revision = "0018_actions_name_targets"
down_revision = None


def upgrade() -> None:
    """Do nothing: `make_tables` makes the tables of a new database."""
