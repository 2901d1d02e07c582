"""Rewriting of documents that earlier layouts stored: in portions, while services and workers go on.

A row has an old form if its `schema` is less than `SCHEMA`. Each portion is one transaction, so rewriting may
end at any moment, and continue later in this process or in another. A row that another program changes
meanwhile is not overwritten.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

import sqlalchemy as sa
from pydantic_core import from_json, to_json

from jointstiff.service.history.raising import note_version
from jointstiff.service.problems import DamagedError
from jointstiff.service.store.compression import compress_text
from jointstiff.service.store.database import Database
from jointstiff.service.store.documents import read_text
from jointstiff.service.store.tables import OLD, OPEN, jobs, measurement_sets, open_sets, robots

if TYPE_CHECKING:
    from jointstiff.service.store.steps import Step

MOST_ROWS: Final = 200
"""Greatest number of rows that one transaction rewrites."""
_MOST_BYTES: Final = 4 * 1024 * 1024  # of one portion, compressed; a larger document is a portion by itself
_TABLES: Final = (robots, measurement_sets, open_sets, jobs)
_IS_OLD: Final = sa.text(OLD)
_NAMES: Final = {"robots": "robot", "measurement_sets": "measurement set", "open_sets": "live campaign"}


class OldDocuments:
    """The documents of a store in a form of earlier layouts. Safe to use in several processes at once."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def count(self) -> int:
        """Return the number of rows with an old form, without jobs that have not ended."""
        counts = [
            sa.select(sa.func.count()).select_from(table).where(_IS_OLD, _is_final(table)).scalar_subquery()
            for table in _TABLES
        ]
        return sum(self._database.rows(sa.select(*counts))[0])

    def list_left(self) -> list[str]:
        """Return the rows with an old form after all others were rewritten, with the reason, in words.

        Deleted rows are left out: they are removed in their time, whether they can be read or not.
        """
        left = list[str]()
        for table in _TABLES:
            kind = jobs.c.kind if table is jobs else sa.literal(_NAMES[table.name])
            is_open = sa.literal_column(OPEN) if table is jobs else sa.false()
            query = sa.select(kind.label("kind"), table.c.id, is_open.label("is_open"))
            query = query.where(_IS_OLD, table.c.deleted_at.is_(None)).order_by(table.c.sequence)
            for row in self._database.rows(query):
                state = "has not ended" if row.is_open else "is damaged"
                left.append(f"{row.kind} {row.id} {state}")
        return left

    def rewrite(self, seconds: float) -> int:
        """Rewrite old documents until none is left or the time is over; return the number of rows.

        At least one portion is rewritten, however short the time is: 0 means that no row is left to rewrite.
        Damaged documents remain as they are. So do jobs that have not ended: an older program may end such a
        job, and would store the document in its own form.
        """
        if self.count() == 0:
            return 0
        # Imported here, as few processes need Alembic
        from jointstiff.service.store.steps import list_steps

        deadline = time.monotonic() + seconds
        rewritten = 0
        steps = [step for step in list_steps() if step.tables]
        for table in _merge_tables(steps):
            own_steps = [step for step in steps if step.changes(table.name)]
            after = 0
            while portion := self._read_portion(table, after):
                rewritten += self._store_portion(table, own_steps, portion)
                after = portion[-1].sequence
                if rewritten and time.monotonic() > deadline:
                    return rewritten
        return rewritten

    def _read_portion(self, table: sa.TableClause, after: int) -> Sequence[Any]:
        """Return the next rows of a table with an old form, in the order of `sequence`.

        `after` is the sequence of the last row of the portion before.
        """
        columns = table.c
        sizes = (
            sa.select(columns.sequence, sa.func.length(columns.document).label("size"))
            .where(_IS_OLD, columns.sequence > after, _is_final(table))
            .order_by(columns.sequence)
            .limit(MOST_ROWS)
        )
        sequences, total = list[int](), 0
        for row in self._database.rows(sizes):
            total += row.size
            if sequences and total > _MOST_BYTES:
                break
            sequences.append(row.sequence)
        whole = sa.select(*columns).where(columns.sequence.in_(sequences)).order_by(columns.sequence)
        return self._database.rows(whole) if sequences else ()

    def _store_portion(self, table: sa.TableClause, steps: Sequence[Step], rows: Sequence[Any]) -> int:
        """Store the new forms of the documents of some rows; return the number of these rows."""
        changes = list[dict[str, Any]]()
        for row in rows:
            with suppress(DamagedError, LookupError, TypeError, ValueError):  # a damaged document remains
                values = dict(row._mapping)
                if table.name == jobs.name:  # before the steps, which know no earlier version than their own
                    job = from_json(read_text(values["document"]))
                    note_version(job, row.schema)
                    values["document"] = compress_text(to_json(job).decode())
                values = _rewrite_row(values, steps)
                names = {f"new_{name}": value for name, value in values.items() if name != "sequence"}
                changes.append({"own": row.sequence, "before": row.document, **names})
        if not changes:
            return 0
        columns = table.c
        new_form = {
            column.name: sa.bindparam(f"new_{column.name}", type_=column.type)
            for column in columns
            if column.name != "sequence"
        }
        update = (
            sa.update(table)
            .where(columns.sequence == sa.bindparam("own"), columns.document == sa.bindparam("before"))
            .where(_IS_OLD)
            .values(**new_form)
        )
        with self._database.writing() as connection:
            connection.execute(update, changes)
        return len(changes)


def _merge_tables(steps: Sequence[Step]) -> list[sa.TableClause]:
    """Return the tables whose documents steps change, each with all columns that a step reads or fills."""
    columns: dict[str, dict[str, sa.ColumnClause[Any]]] = {}
    for step in steps:
        for table in step.tables:
            own_columns = {column.name: sa.column(column.name, column.type) for column in table.c}
            columns.setdefault(table.name, {}).update(own_columns)
    return [sa.table(name, *own_columns.values()) for name, own_columns in columns.items()]


def _rewrite_row(row: Mapping[str, Any], steps: Sequence[Step]) -> dict[str, Any]:
    """Return the values of a row after all steps that are later than its document.

    Raises:
        DamagedError: a document of the row is damaged.
    """
    values = dict(row)
    for step in steps:
        if step.schema > row["schema"]:
            values |= step.rewrite(values)
            values["schema"] = step.schema
    return values


def _is_final(table: sa.TableClause) -> sa.ColumnElement[bool] | sa.TextClause:
    """Return the condition of rows whose documents change no more: of all but jobs that have not ended."""
    return sa.text(f"NOT ({OPEN})") if table.name == jobs.name else sa.true()
