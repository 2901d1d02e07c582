"""Documents as JSON compressed by zlib, with a version; numbers of runs as JSON that SQL reads.

Steps of jobs have the time at which they were stored, and the version that computed them.

Programs of layout 0018 read the new form of documents: their reader takes any stream of zlib.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from typing import Any

import sqlalchemy as sa
from alembic import op
from pydantic_core import to_json
from sqlalchemy.dialects.postgresql import JSONB

from jointstiff.service.history.raising import raise_document
from jointstiff.service.store.packing import unpack_text

revision = "0019_expand_readable"
down_revision = "0018_actions_name_targets"

SCHEMA = 19
_NUMBERS = sa.JSON(none_as_null=True).with_variant(JSONB(none_as_null=True), "postgresql")
_UNITS = {"revolute": "N.m/rad", "prismatic": "N/m"}


def _table(name: str, *further_columns: sa.ColumnClause[Any]) -> sa.TableClause:
    """Return a table with documents, with its columns that `rewrite` reads or fills."""
    return sa.table(
        name,
        sa.column("sequence", sa.BigInteger),
        sa.column("schema", sa.Integer),
        sa.column("document", sa.LargeBinary),
        *further_columns,
    )


TABLES = [
    _table("robots"),
    _table("measurement_sets"),
    _table("open_sets"),
    _table(
        "jobs",
        sa.column("trend", sa.LargeBinary),
        sa.column("key_name", sa.String),
        sa.column("numbers", _NUMBERS),
    ),
]


def upgrade() -> None:
    """Expand: add the version of documents, an index of the rows to rewrite, columns for SQL and steps."""
    is_old = sa.text("schema < 19")
    for table in TABLES:
        version = sa.Column("schema", sa.Integer(), nullable=False, server_default=sa.text("18"))
        op.add_column(table.name, version)
    op.add_column("jobs", sa.Column("key_name", sa.String(), nullable=True))
    op.add_column("jobs", sa.Column("numbers", _NUMBERS, nullable=True))
    op.add_column("job_steps", sa.Column("stored_at", sa.DateTime(timezone=True), nullable=True))
    op.add_column("job_steps", sa.Column("version", sa.String(), nullable=True))
    for table in TABLES:
        name = f"ix_{table.name}_old"
        op.create_index(name, table.name, ["sequence"], sqlite_where=is_old, postgresql_where=is_old)
        if op.get_bind().dialect.name == "sqlite":  # plans rest on assumed statistics of each index
            statistics = sa.text("INSERT INTO sqlite_stat1 (tbl, idx, stat) VALUES (:table, :name, '100 1')")
            op.get_bind().execute(statistics, {"table": table.name, "name": name})


def rewrite(row: Mapping[str, Any]) -> dict[str, Any]:
    """Documents: return the new values of columns of a row of one of `TABLES`.

    Raises:
        DamagedError: a document of the row is damaged.
    """
    text = unpack_text(row["document"])
    values: dict[str, Any] = {"document": _compress(text)}
    if "trend" in row:  # a job
        job = json.loads(text)
        job = raise_document(job["kind"], job, 18).document
        values["document"] = _compress(to_json(job).decode())
        has_numbers = job["kind"] == "run" and job["result"] is not None
        values["trend"] = None if row["trend"] is None else _compress(unpack_text(row["trend"]))
        values["key_name"] = job["key_name"]
        values["numbers"] = _extract_numbers(job) if has_numbers else None
    return values


def _compress(text: str) -> bytes:
    """Compress a text as documents of layout 0019 are compressed."""
    content = text.encode()
    if len(content) < 12_000:
        return zlib.compress(content, 6)
    # A long text is mostly numbers of 17 digits, whose short repetitions cost more than they save.
    stream = zlib.compressobj(6, zlib.DEFLATED, zlib.MAX_WBITS, 5, zlib.Z_FILTERED)
    return stream.compress(content) + stream.flush()


def _extract_numbers(run: Mapping[str, Any]) -> dict[str, Any]:
    """Return verdict and stiffnesses of a run."""
    joints = [
        {
            "name": joint["name"],
            "verdict": joint["verdict"],
            "status": joint["status"],
            "stiffness": joint["stiffness"],
            "interval": joint["stiffness_interval"],
            "at_least": joint["stiffness_at_least"],
            "unit": _UNITS[joint["kind"]],
        }
        for joint in run["result"]["joints"]
    ]
    verdict = run["result"]["assessment"]["verdict"]
    return {"verdict": verdict, "confidence": run["request"]["confidence"], "joints": joints}
