"""Restoring of archives into a database: ids are kept, and rows that are there already are left as they are.

Rows are stored in portions, one transaction each. A restore that ends early is continued by running it again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from functools import cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import sqlalchemy as sa
from pydantic import ValidationError

from jointstiff.service.archive.form import RESTORED, file_of
from jointstiff.service.archive.reading import Archive, read_archive
from jointstiff.service.archive.rows import BUILDERS
from jointstiff.service.problems import DamagedError, MissingDatabaseError
from jointstiff.service.store.collection import (
    SEARCHED,
    job_name_columns,
    make_robot_name_columns,
    make_set_name_columns,
    mark_campaigns_outdated,
)
from jointstiff.service.store.database import Database, insert_unless_present, open_existing
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import (
    OPEN_STATES,
    audit,
    has_tables,
    jobs,
    last_campaigns,
    measurement_sets,
    metadata,
    robots,
)

if TYPE_CHECKING:
    from jointstiff.service.workers.engine import Queue

MOST_ROWS: Final = 200  # of a portion
_MOST_CHARACTERS: Final = 4_000_000  # of the documents of a portion; a larger document is a portion by itself
_LINES_AT_ONCE: Final = 50  # lines that are looked up together; a line may have many megabytes
_MOST_NAMED: Final = 20  # rows that are named in the outcome of a table


@dataclass
class TableOutcome:
    """Numbers of the lines of a table that were stored, were there, or cannot be stored."""

    lines: int = 0  # of the archive
    added: int = 0  # rows that were stored; with `dry_run`, that would be stored
    present: int = 0  # rows that were in the database already
    refused: int = 0  # lines that cannot be stored
    omitted: int = 0  # lines that are not meant to be stored: keys without hashes
    reasons: list[str] = field(default_factory=list)  # sentences about the first refused lines

    def refuse(self, name: str, reason: str) -> None:
        """Count a line that cannot be stored."""
        self.refused += 1
        if len(self.reasons) < _MOST_NAMED:
            self.reasons.append(f"{name}: {reason}")


@dataclass
class Restored:
    """Outcome of a restore."""

    layout: str  # of the archive
    tables: dict[str, TableOutcome] = field(default_factory=dict)
    dropped: Counter[str] = field(default_factory=Counter)  # field without a place → number of documents

    @property
    def refused(self) -> int:
        """Number of lines that cannot be stored."""
        return sum(outcome.refused for outcome in self.tables.values())


def restore_archive(
    path: Path,
    url: str,
    *,
    dry_run: bool = False,
    notify: Callable[[str], object] = lambda _: None,
) -> Restored:
    """Store the rows of an archive that a database lacks.

    Args:
        path: the archive.
        url: URL of the database; tables are created if it has none.
        dry_run: True to change nothing, and to return what would be stored.
        notify: function that is called with a sentence for each table.

    Returns:
        The numbers of rows that were stored, were there already, or cannot be stored.

    Raises:
        ArchiveError: the file is no archive, or is damaged. Nothing is stored then.
        StoreError: the database cannot be used.
        OSError: the file cannot be read.
    """
    with read_archive(path) as archive, ExitStack() as opened:
        target = DryTarget(_find_tables(url, opened)) if dry_run else _open_target(url, opened)
        restored = Restored(archive.manifest.layout)
        for table in RESTORED:
            restored.tables[table] = TableOutcome(_count_lines(archive, table))
        for table in restored.tables:
            _restore_table(archive, table, target, restored)
            notify(_describe(table, restored.tables[table], dry_run=dry_run))
        return restored


def _count_lines(archive: Archive, table: str) -> int:
    """Return the number of lines of a table in an archive; 0 if the archive does not have the table."""
    entry = archive.manifest.files.get(file_of(table))
    return 0 if entry is None else entry.lines


def _describe(table: str, outcome: TableOutcome, *, dry_run: bool) -> str:
    """Return a sentence about the lines of a table."""
    verb = "to be added" if dry_run else "added"
    sentence = f"{table}: {outcome.added} {verb}, {outcome.present} there already, {outcome.refused} refused"
    if outcome.omitted:
        sentence += f", {outcome.omitted} without hashes: create new keys with `jointstiff keys create`"
    return sentence


def _open_target(url: str, opened: ExitStack) -> Target:
    """Open a database to store rows; create its tables if it has none."""
    store = opened.enter_context(Store.open(url))

    def open_queue() -> Queue:
        # Imported here, as few archives have jobs that have not ended
        from jointstiff.service.workers.engine import Queue

        return opened.enter_context(closing(Queue(store, url)))

    return Target(opened.enter_context(closing(open_existing(url))), open_queue)


def _find_tables(url: str, opened: ExitStack) -> Database | None:
    """Open a database without changing it; None if it does not exist, or has no tables yet."""
    try:
        database = opened.enter_context(closing(open_existing(url)))
    except MissingDatabaseError:
        return None
    with database.reading() as connection:
        return database if has_tables(connection) else None


def _restore_table(archive: Archive, table: str, target: Target, restored: Restored) -> None:
    """Store the lines of the file of a table, portion by portion."""
    outcome = restored.tables[table]
    lines = _skip_present(enumerate(archive.lines(table), 1), table, target, outcome)
    for portion in _make_portions(_build_rows(lines, table, outcome, restored.dropped), table):
        target.store(table, portion, outcome)


def _skip_present(
    lines: Iterator[tuple[int, dict[str, Any]]], table: str, target: Target, outcome: TableOutcome
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the lines whose ids the database lacks, each with its number.

    The others are not checked, so a restore that is continued soon comes to where the one before ended.
    """
    if _IDENTITIES[table] != ("id",):
        yield from lines
        return
    while batch := list(islice(lines, _LINES_AT_ONCE)):
        ids = {values["id"] for _, values in batch if isinstance(values.get("id"), str)}
        present = target.find_present(table, ids)
        for number, values in batch:
            if isinstance(values.get("id"), str) and values["id"] in present:
                outcome.present += 1
            else:
                yield number, values


def _build_rows(
    lines: Iterator[tuple[int, dict[str, Any]]], table: str, outcome: TableOutcome, dropped: Counter[str]
) -> Iterator[dict[str, Any]]:
    """Yield the rows of a table, without the copies of names; lines that cannot be used are refused."""
    build = BUILDERS[table]
    for number, values in lines:
        try:
            built = build(values)
        except (ValueError, DamagedError) as error:
            name = str(values.get("id", f"line {number}"))[:64]
            outcome.refuse(name, explain_refusal(error))
            continue
        if built is None:
            outcome.omitted += 1
            continue
        dropped.update(set(built.dropped))
        yield built.values


def explain_refusal(error: Exception) -> str:
    """Return why a line cannot be used."""
    if isinstance(error, ValidationError):
        first = error.errors(include_url=False, include_input=False)[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return str(error)


def _make_portions(rows: Iterator[dict[str, Any]], table: str) -> Iterator[list[dict[str, Any]]]:
    """Yield the rows in portions; entries of the audit with equal times are in one portion."""
    portion, characters = list[dict[str, Any]](), 0
    for row in rows:
        characters += len(row.get("document", "")) + len(row.get("arrays", b""))
        is_full = len(portion) >= MOST_ROWS or characters > _MOST_CHARACTERS
        is_same_moment = table == audit.name and bool(portion) and portion[-1]["at"] == row["at"]
        if portion and is_full and not is_same_moment:
            yield portion
            portion, characters = [], 0
        portion.append(row)
    if portion:
        yield portion


class Target:
    """A database into which rows are restored."""

    def __init__(self, database: Database, open_queue: Callable[[], Queue]) -> None:
        self._database = database
        self._open_queue = cache(open_queue)  # opens the queue of workers once

    def find_present(self, table: str, ids: set[str]) -> set[str]:
        """Return those of some ids that a table of the database has."""
        column = metadata.tables[table].c.id
        return {row.id for row in self._database.rows(sa.select(column).where(column.in_(ids)))}

    def store(self, table: str, rows: Sequence[dict[str, Any]], outcome: TableOutcome) -> None:
        """Store the rows of a portion that the database lacks, in one transaction.

        Jobs that have not ended are put into the queue of workers, which begin them anew.
        """
        open_ids = {row["id"] for row in rows if row.get("state") in OPEN_STATES}
        queue = self._open_queue() if open_ids else None  # first, as it may create tables
        with self._database.writing() as connection:
            lacking = list(_find_lacking(connection, table, rows, outcome))
            complete = list(_add_name_columns(connection, table, lacking, outcome))
            if complete:
                connection.execute(sa.insert(metadata.tables[table]), complete)
                for row in complete:
                    if queue is not None and row["id"] in open_ids:
                        queue.enqueue(connection, row["id"])
                _mark_campaigns(connection, table, complete)
            outcome.added += len(complete)


class DryTarget(Target):
    """A database that remains as it is; None for one without tables."""

    def __init__(self, database: Database | None) -> None:
        self._existing = database

    def find_present(self, table: str, ids: set[str]) -> set[str]:
        """Return those of some ids that a table of the database has."""
        column = metadata.tables[table].c.id
        query = sa.select(column).where(column.in_(ids))
        return set() if self._existing is None else {row.id for row in self._existing.rows(query)}

    def store(self, table: str, rows: Sequence[dict[str, Any]], outcome: TableOutcome) -> None:
        """Count the rows that the database lacks."""
        if self._existing is None:
            outcome.added += len(rows)
            return
        with self._existing.reading() as connection:
            outcome.added += len(list(_find_lacking(connection, table, rows, outcome)))


def _find_lacking(
    connection: sa.Connection, table: str, rows: Sequence[dict[str, Any]], outcome: TableOutcome
) -> Iterator[dict[str, Any]]:
    """Yield the rows that a database lacks, and count the others as present."""
    columns = _IDENTITIES[table]
    present = _count_present(connection, metadata.tables[table], columns, rows)
    for row in rows:
        identity = tuple(row[name] for name in columns)
        if present[identity] > 0:
            if table == audit.name:  # equal entries may be several
                present[identity] -= 1
            outcome.present += 1
        else:
            present[identity] += table != audit.name  # a second line with the same id is not stored
            yield row


_IDENTITIES: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(("robots", "measurement_sets", "open_sets", "jobs", "access_keys"), ("id",)),
    "live_entries": ("set_id", "change", "label"),
    "idempotency_keys": ("resource", "key_hash"),
    "audit": ("at", "key_id", "key_name", "address", "method", "operation", "path", "status"),
}
"""Table → columns that tell its rows apart; entries of the audit have no id."""


def _count_present(
    connection: sa.Connection, table: sa.Table, columns: Sequence[str], rows: Sequence[dict[str, Any]]
) -> Counter[tuple[Any, ...]]:
    """Return how often the database has each row of a portion."""
    first = table.c[columns[0]]
    values = {row[columns[0]] for row in rows}
    query = sa.select(*(table.c[name] for name in columns)).where(first.in_(values))
    return Counter(tuple(row) for row in connection.execute(query))


def _add_name_columns(
    connection: sa.Connection, table: str, rows: Sequence[dict[str, Any]], outcome: TableOutcome
) -> Iterator[dict[str, Any]]:
    """Yield rows with the copies of the names to which they refer; refuse rows that refer to nothing."""
    named_robots = _read_names(connection, robots, {row.get("robot_id") for row in rows})
    set_ids = {row.get(name) for row in rows for name in ("measurement_set_id", "second_set_id")}
    named_sets = _read_names(connection, measurement_sets, set_ids)
    for row in rows:
        missing = _find_missing(row, named_robots, named_sets)
        if missing is not None:
            outcome.refuse(
                str(row["id"]), f"refers to {missing}, which is not in the archive or the database"
            )
            continue
        robot = named_robots.get(row.get("robot_id"))
        measured = named_sets.get(row.get("measurement_set_id"))
        yield row | _make_name_columns(table, row, robot, measured)


def _find_missing(
    row: Mapping[str, Any], named_robots: Mapping[Any, Any], named_sets: Mapping[Any, Any]
) -> str | None:
    """Return the first reference of a row that leads nowhere; None if all references are there."""
    for column, named in (
        ("robot_id", named_robots),
        ("measurement_set_id", named_sets),
        ("second_set_id", named_sets),
    ):
        identifier = row.get(column)
        if identifier is not None and identifier not in named:
            return f"{column} {identifier}"
    return None


def _read_names(connection: sa.Connection, table: sa.Table, ids: set[Any]) -> dict[Any, Any]:
    """Return id → row with the name and the searched columns of some robots or sets."""
    columns = [table.c[name] for name in ("id", "name", *SEARCHED) if name in table.c]
    query = sa.select(*columns).where(table.c.id.in_(ids - {None}))
    return {row.id: row for row in connection.execute(query)}


def _make_name_columns(table: str, row: Mapping[str, Any], robot: Any, measured: Any) -> dict[str, Any]:  # noqa: ANN401 - rows of a query
    """Return the columns of a row that hold copies of names; `robot` and `measured` may be None."""
    robot_name = None if robot is None else robot.name
    if table == robots.name:
        return make_robot_name_columns(row["name"])
    if table in ("measurement_sets", "open_sets"):
        searched = (row.get(name) for name in SEARCHED)
        return make_set_name_columns(row["name"], robot_name, *searched)
    if table == jobs.name:
        names = (None if measured is None else getattr(measured, name) for name in ("name", *SEARCHED))
        return job_name_columns(row["name"], robot_name, *names)
    return {}


def _mark_campaigns(connection: sa.Connection, table: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Mark the last campaigns of the robots of restored runs as outdated: they are derived anew."""
    if table != jobs.name:
        return
    for robot_id in sorted({row["robot_id"] for row in rows if row["trend"] is not None}):
        is_robot = last_campaigns.c.robot_id == robot_id
        if not mark_campaigns_outdated(connection, is_robot):
            connection.execute(
                insert_unless_present(connection, last_campaigns).values(robot_id=robot_id, changes=1)
            )
