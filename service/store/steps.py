"""The steps from layout to layout, read by Alembic from the files in `migrations/`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import sqlalchemy as sa
from alembic.config import Config
from alembic.script import ScriptDirectory

from jointstiff.service.store.layouts import number_of

FOLDER: Final = Path(__file__).with_name("migrations")
"""Folder of the steps, for Alembic."""


@dataclass(frozen=True)
class Step:
    """A step to a layout, as its file states it."""

    layout: str
    schema: int  # version of documents after the step; 0 if the step changes no documents
    tables: Sequence[sa.TableClause]  # tables whose documents the step changes
    rewrite: Callable[[Mapping[str, Any]], dict[str, Any]]  # old values of a row → new values

    def changes(self, table_name: str) -> bool:
        """Return whether the step changes the documents of a table."""
        return any(table.name == table_name for table in self.tables)


@cache
def list_steps() -> list[Step]:
    """Return all steps, the oldest first."""
    scripts = ScriptDirectory.from_config(make_config()).walk_revisions()
    steps = [
        Step(
            layout=script.revision,
            schema=getattr(script.module, "SCHEMA", 0),
            tables=getattr(script.module, "TABLES", ()),
            rewrite=getattr(script.module, "rewrite", dict),
        )
        for script in scripts
    ]
    return steps[::-1]


def list_due_steps(layout: str) -> list[Step]:
    """Return the steps from a layout to that of this program."""
    return [step for step in list_steps() if number_of(step.layout) > number_of(layout)]


def make_config(connection: sa.Connection | None = None) -> Config:
    """Return a configuration of Alembic without a file; `connection` is for `migrations/env.py`."""
    config = Config(attributes={"connection": connection})
    config.set_main_option("script_location", str(FOLDER).replace("%", "%%"))
    return config
