"""Alembic runs this for each command; `service.store.migrations.migrate` hands it the connection."""

from __future__ import annotations

from alembic import context

from jointstiff.service.store.tables import metadata

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=metadata,
    render_as_batch=True,  # SQLite alters a table by copying it
)
with context.begin_transaction():
    context.run_migrations()
