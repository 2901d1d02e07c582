"""Records of the store as frozen dataclasses, one for each table; and the tables, made from the fields.

An *entry* has the short columns that a listing shows; a *record* also has the contents, documents as JSON
text.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Annotated, Any, Final, Generic, TypeVar, get_args, get_type_hints

import sqlalchemy as sa
from sqlalchemy.dialects.postgresql import JSONB
from sqlalchemy.exc import DBAPIError
from sqlalchemy.schema import CreateIndex, CreateTable
from sqlalchemy.types import TypeEngine

from jointstiff.service.problems import StoreUnavailableError
from jointstiff.service.store.database import Database
from jointstiff.service.store.documents import CompressedBytes, CompressedText, Content, Document
from jointstiff.service.store.layouts import LAYOUT, SCHEMA, refuse_unusable

DocumentVersion = Annotated[int, "version of a document"]
"""Field for the version of a record's documents: number of the layout in whose form they are stored."""
Numbers = Annotated[dict[str, Any], "numbers"]
"""Field for numbers that other programs read: a JSON object, on PostgreSQL of the type JSONB."""


@dataclass(frozen=True, slots=True)
class RobotRow:
    """A robot without its contents."""

    id: str
    name: str
    created_at: datetime  # aware, UTC, to the microsecond; so are all times of this module
    content_hash: str
    summary: dict[str, Any] = field(default_factory=dict, kw_only=True)
    """Fields of a listing that have no column of their own."""


@dataclass(frozen=True, slots=True)
class RobotEntry(RobotRow):
    """A robot in a listing, with its last campaign as derived from its runs; None before its first run."""

    changes: int | None
    arms_derived: int | None
    campaign: dict[str, Any] | None
    arms: list[Any] | None

    @property
    def is_current(self) -> bool:
        """True if the campaign was derived after the last change of the robot, its runs and its sets."""
        return self.changes == self.arms_derived


@dataclass(frozen=True, slots=True)
class RobotRecord(RobotRow):
    """A robot."""

    schema: DocumentVersion = field(default=SCHEMA, kw_only=True)
    document: Document
    """JSON text of `jointstiff.schemas.robot.StoredRobot`; `name` is that of the column."""
    marks: list[Any] | None = field(default=None, kw_only=True)
    """Marks of the robot's history, in the form of `jointstiff.schemas.robot.Mark`; None for none."""
    reference_set_ids: list[Any] | None = field(default=None, kw_only=True)
    """Ids of the sets with which later campaigns are compared; None: with the first."""


@dataclass(frozen=True, slots=True)
class LastCampaignRecord:
    """The last campaign of a robot, derived from its runs and their sets when the robot is listed."""

    robot_id: str
    changes: int  # number of changes of the robot, its runs and their sets
    derived: int | None  # value of `changes` when the campaign was derived; None before the first time
    campaign: dict[str, Any] | None
    # The following are of layout 0020: a program of layout 0019 writes only `derived` and `campaign`.
    arms_derived: int | None  # value of `changes` when all columns were derived; None before the first time
    arms: list[Any] | None  # arms that were measured, in the form of `jointstiff.schemas.robot.MeasuredArm`
    rank: float | None  # greatest rank of the arms; null without a measured arm


@dataclass(frozen=True, slots=True)
class MeasurementSetEntry:
    """A measurement set in a listing."""

    id: str
    robot_id: str
    name: str
    encoders: str
    observation_count: int
    warning_count: int
    created_at: datetime
    content_hash: str
    measured_at: datetime | None = field(default=None, kw_only=True)
    operator: str | None = field(default=None, kw_only=True)
    instrument: str | None = field(default=None, kw_only=True)
    serial_number: str | None = field(default=None, kw_only=True)
    item_condition: str | None = field(default=None, kw_only=True)
    conditions: str | None = field(default=None, kw_only=True)
    notes: str | None = field(default=None, kw_only=True)


@dataclass(frozen=True, slots=True)
class MeasurementSetRecord(MeasurementSetEntry):
    """A measurement set with its readings."""

    schema: DocumentVersion = field(default=SCHEMA, kw_only=True)
    document: Document
    """JSON text without the observations; a field that is also a column has the value of the column."""
    arrays: Content  # numbers of the observations (npz), which the store does not read


@dataclass(frozen=True, slots=True)
class OpenSetRecord:
    """Declaration of a measurement set that is measured live. Its readings are entries of a journal."""

    id: str  # also the id of the measurement set after closing
    robot_id: str
    name: str
    created_at: datetime
    schema: DocumentVersion = field(default=SCHEMA, kw_only=True)
    document: Document  # JSON text of the declaration
    resolved: str | None  # JSON text of the transform from the frame of the readings to R0
    warnings: str  # JSON list of findings about the frame


@dataclass(frozen=True, slots=True)
class LiveEntry:
    """An entry in the record of a live campaign: an observation or a decision; each kind and label once."""

    set_id: str
    change: str  # `observation`, `withdrawn`, `kept`, `skipped` or `closed`
    label: str
    noted_at: datetime
    key_name: str | None
    document: str  # JSON text


@dataclass(frozen=True, slots=True)
class BridgeRecord:
    """A bridge from a tracker to the page that shows an open set."""

    id: str  # 128 random bits, known to the page and to the command that joined
    set_id: str
    page_key: str  # id of the key that opened the bridge; empty if the service requires no keys
    command_key: str | None  # id of the key of the command; None before it joined
    code_hash: str | None  # SHA-256 of the code; None after it was used
    created_at: datetime
    stand: str | None  # JSON text of the posture that the page shows
    reading: str | None  # JSON text of the last positions
    heard_at: datetime | None  # time of the last message of the command


@dataclass(frozen=True, slots=True)
class JobRow:
    """A job of any kind without its contents."""

    id: str
    kind: str
    state: str
    created_at: datetime
    robot_id: str | None
    measurement_set_id: str | None
    second_set_id: str | None
    name: str | None
    method: str | None
    weighting: str | None
    elasticity: str | None
    verdict: str | None
    summary: dict[str, Any]
    """Fields of a listing that have no column of their own."""


@dataclass(frozen=True, slots=True)
class JobEntry(JobRow):
    """A job in a listing, with the present names of its robot and its first measurement set."""

    robot_name: str | None
    measurement_set_name: str | None
    serial_number: str | None


@dataclass(frozen=True, slots=True)
class JobRecord(JobRow):
    """A job with its result."""

    key_name: str | None = field(default=None, kw_only=True)  # name of the requester's key
    numbers: Numbers | None = field(default=None, kw_only=True)
    """Numbers of a run that has succeeded, for other programs (`runs/numbers.py`)."""
    schema: DocumentVersion = field(default=SCHEMA, kw_only=True)
    # Numbers for the trend of a robot, from a run that has succeeded; JSON text
    trend: Document | None = field(default=None, kw_only=True)
    document: Document  # JSON text of the kind's message


@dataclass(frozen=True, slots=True)
class TrendEntry:
    """A run that has numbers for a trend."""

    id: str
    created_at: datetime
    measurement_set_id: str


@dataclass(frozen=True, slots=True)
class IdempotencyKey:
    """A client's key: a repeated post with this key returns the first resource instead of a second one."""

    key: str  # text of the header, any text; the store has only its hash
    body_hash: str  # hash of the body of the request with this key


@dataclass(frozen=True, slots=True)
class AccessKey:
    """An access key. The store has only its hash; the key itself is known to its holder alone."""

    id: str
    name: str  # name of the key's holder
    role: str  # `viewer`, `operator` or `admin`
    key_hash: str
    """SHA-256 of the key. A slow hash is not needed: unlike a password, the key has 256 random bits."""
    created_at: datetime
    expires_at: datetime | None
    revoked_at: datetime | None
    last_used_at: datetime | None  # to the minute

    def is_live(self, now: datetime) -> bool:
        """Return whether the key is valid at a time: neither revoked nor expired."""
        return self.revoked_at is None and (self.expires_at is None or now < self.expires_at)


@dataclass(frozen=True, slots=True)
class SessionRecord:
    """Session of a browser that signed in with a key. Only the browser's cookie has the token itself."""

    token_hash: str
    key_id: str
    created_at: datetime
    used_at: datetime  # to the minute


@dataclass(frozen=True, slots=True)
class AuditEntry:
    """An attempt to change something, and its outcome."""

    at: datetime
    key_id: str | None
    key_name: str | None
    address: str  # network address of the requester; `terminal` for commands at the database itself
    method: str
    operation: str | None  # name of the operation; None if the address has no operation of this method
    path: str
    status: int


OPEN_STATES: Final = ("queued", "running")
"""States of a job that has not ended; all others are final."""


Record = TypeVar("Record", RobotRecord, MeasurementSetRecord, OpenSetRecord, JobRecord)
Entry = TypeVar("Entry", RobotEntry, MeasurementSetEntry, OpenSetRecord, JobEntry)


Row = TypeVar("Row")


@dataclass(frozen=True, slots=True)
class RecordPage(Generic[Row]):
    """One page of a listing."""

    records: tuple[Row, ...]
    next: str | None  # cursor of the following page; None on the last page
    # number of records on all pages, or `MOST_COUNTED` + 1 if there are more; None if they were not counted
    total: int | None


_ADVISORY_LOCK: Final = 0x4A6F696E74  # "Joint" in ASCII: any number that no other program uses
LOCK_SECONDS: Final = 60.0
"""Time to wait for another process that creates or upgrades the tables [s]."""

metadata = sa.MetaData(
    naming_convention={
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_N_name)s",
        "pk": "pk_%(table_name)s",
    }
)


class UtcDateTime(sa.TypeDecorator[datetime]):
    """Column type for times with a time zone, stored as UTC: SQLite has no time zones."""

    impl = sa.DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, _: sa.Dialect) -> datetime | None:
        """Convert a time with a time zone to UTC; raise ValueError for a time without time zone."""
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError("a stored time must have a time zone")
        return value.astimezone(UTC)

    def process_result_value(self, value: datetime | None, _: sa.Dialect) -> datetime | None:
        """Return a stored time in UTC."""
        if value is None:
            return None
        return value.astimezone(UTC) if value.tzinfo else value.replace(tzinfo=UTC)


_TYPES: Final[Mapping[Any, type[TypeEngine[Any]] | TypeEngine[Any]]] = MappingProxyType(
    {
        str: sa.String,
        str | None: sa.String,
        int: sa.Integer,
        bool: sa.Boolean,
        datetime: UtcDateTime,
        datetime | None: UtcDateTime,
        int | None: sa.Integer,
        dict[str, Any]: sa.JSON,
        dict[str, Any] | None: sa.JSON(none_as_null=True),
        list[Any] | None: sa.JSON(none_as_null=True),
        float | None: sa.Float,
        DocumentVersion: sa.Integer,
        Numbers | None: sa.JSON(none_as_null=True).with_variant(JSONB(none_as_null=True), "postgresql"),
        Document: CompressedText,
        Document | None: CompressedText,
        Content: CompressedBytes,
    }
)
_DEFAULTS: Final[Mapping[Any, Any]] = MappingProxyType(
    {
        bool: sa.false(),
        DocumentVersion: sa.text("18"),  # programs of layout 0018 do not know the column
    }
)
"""Type of a field → value of its column in rows that do not state the value."""


def _make_columns(
    record_class: type, references: Mapping[str, str], key: str | None = None
) -> list[sa.Column[Any]]:
    """Return a column for each field of a dataclass.

    Args:
        record_class: the dataclass.
        references: name of a column → column of another table to which it refers.
        key: name of the field that is the primary key; None if no field is.
    """
    hints = get_type_hints(record_class, include_extras=True)
    return [
        sa.Column(
            field.name,
            _TYPES[hints[field.name]],
            *([sa.ForeignKey(references[field.name])] if field.name in references else []),
            primary_key=field.name == key,
            nullable=type(None) in get_args(hints[field.name]),
            server_default=_DEFAULTS.get(hints[field.name]),
            unique=True if field.name == "id" and key is None else None,
        )
        for field in fields(record_class)
    ]


def _make_numbered_table(
    name: str,
    record_class: type,
    *further_columns: sa.Column[Any],
    references: Mapping[str, str] = MappingProxyType({}),
    indexes: Iterable[sa.Index],
) -> sa.Table:
    """Return a table of records with the primary key `sequence`, a growing number.

    Documents are the last columns: SQLite has to read a document to reach the columns after it. Before the
    documents are numbers, which are also long.

    Args:
        name: name of the table.
        record_class: dataclass whose fields are columns.
        further_columns: columns that are not fields of the dataclass.
        references: name of a column → column of another table to which it refers.
        indexes: indexes of the table.
    """
    columns = [*_make_columns(record_class, references), *further_columns]
    return sa.Table(
        name,
        metadata,
        sa.Column(
            "sequence",
            sa.BigInteger().with_variant(sa.Integer, "sqlite"),
            sa.Identity(always=True),
            primary_key=True,
        ),
        *sorted(columns, key=_rank_by_length),
        *indexes,
    )


def _rank_by_length(column: sa.Column[Any]) -> int:
    """Return the rank of a column in its table: columns with long values come last.

    A database reads the columns before them without the pages of the long values.
    """
    is_document = isinstance(column.type, CompressedText | CompressedBytes)
    if is_document:
        return 2
    has_numbers_of_a_list = column.name == "numbers"
    return 1 if has_numbers_of_a_list else 0


def _make_index(name: str, *columns: str, where: str | None = None) -> sa.Index:
    """Return an index of some columns, then `sequence`; with a condition, only of the rows that meet it.

    `where` is the condition in SQL, or None.
    """
    condition = None if where is None else sa.text(where)
    ordered = columns if "sequence" in columns else (*columns, "sequence")
    return sa.Index(f"ix_{name}", *ordered, sqlite_where=condition, postgresql_where=condition)


def _make_listing_indexes(name: str, *columns: str, covering: Iterable[str] = ()) -> list[sa.Index]:
    """Return two indexes, in order of time and of name, from which a page is found without reading rows.

    Args:
        name: first part of the names of both indexes.
        columns: columns that filter every listing.
        covering: further columns that can filter a listing.
    """
    # If the index lacked a column of a condition, SQLite would read the row for this column.
    covered = [*covering, "deleted_at"]
    return [
        _make_index(f"{name}_listed", *columns, "sequence", *covered, "words", where=VISIBLE),
        _make_index(f"{name}_words", *columns, "words", "sequence", *covered, where=VISIBLE),
    ]


def _make_deletion_index(name: str) -> sa.Index:
    """Return the index of deleted rows, in order of the time of deletion."""
    return _make_index(f"{name}_deleted_at", "deleted_at", where="deleted_at IS NOT NULL")


def _make_old_index(name: str) -> sa.Index:
    """Return the index of the rows whose documents have an old form, which is empty after an upgrade."""
    return _make_index(f"{name}_old", "sequence", where=OLD)


def _add_listing_columns(*columns: sa.Column[Any]) -> list[sa.Column[Any]]:
    """Return the given columns, and the columns of every listed table: `words` and `deleted_at`."""
    return [
        *columns,
        sa.Column("words", NAMES, nullable=False),  # names with case folded, for searches and for sorting
        sa.Column("deleted_at", UtcDateTime, nullable=True),  # hidden from then on, removed later
    ]


VISIBLE: Final = "deleted_at IS NULL"
"""Condition of the rows that listings show; a query must have the same text to use an index with it."""
OPEN: Final = f"state IN ({', '.join(map(repr, OPEN_STATES))})"
"""Condition of jobs that have not ended, as the text of their index."""
OLD: Final = f"schema < {SCHEMA}"
"""Condition of the rows whose documents have an old form, as the text of their index."""
NAMES: Final = sa.String().with_variant(sa.String(collation="C"), "postgresql")
"""Text in the order of its characters, on both databases."""

robots = _make_numbered_table(
    "robots",
    RobotRecord,
    *_add_listing_columns(),
    indexes=[
        *_make_listing_indexes("robots"),
        _make_deletion_index("robots"),
        _make_old_index("robots"),
        _make_index("robots_name", "name", where=VISIBLE),
        _make_index("robots_content_hash", "content_hash", where=VISIBLE),
    ],
)

DUE: Final = "arms_derived IS NULL OR arms_derived < changes"
"""SQL condition that selects outdated summaries of last campaigns; equal to the text in their index."""

last_campaigns = sa.Table("last_campaigns", metadata, *_make_columns(LastCampaignRecord, {}, key="robot_id"))
sa.Index(
    "ix_last_campaigns_due",
    last_campaigns.c.robot_id,
    sqlite_where=sa.text(DUE),
    postgresql_where=sa.text(DUE),
)

measurement_sets = _make_numbered_table(
    "measurement_sets",
    MeasurementSetRecord,
    *_add_listing_columns(sa.Column("robot_name", sa.String)),
    references={"robot_id": "robots.id"},
    indexes=[
        *_make_listing_indexes("measurement_sets", covering=["encoders"]),
        _make_deletion_index("measurement_sets"),
        _make_old_index("measurement_sets"),
        _make_index("measurement_sets_robot_id", "robot_id"),
        *(
            _make_index(f"measurement_sets_{column}", column, where=VISIBLE)
            for column in ("name", "content_hash", "serial_number", "operator", "instrument", "measured_at")
        ),
    ],
)

open_sets = _make_numbered_table(
    "open_sets",
    OpenSetRecord,
    *_add_listing_columns(sa.Column("robot_name", sa.String)),
    references={"robot_id": "robots.id"},
    indexes=[
        *_make_listing_indexes("open_sets"),
        _make_deletion_index("open_sets"),
        _make_old_index("open_sets"),
        _make_index("open_sets_robot_id", "robot_id"),
    ],
)

_JOB_FILTER_COLUMNS: Final = ("state", "verdict", "method", "weighting", "elasticity")
"""Columns with few different values that filter listings of jobs."""

jobs = _make_numbered_table(
    "jobs",
    JobRecord,
    *_add_listing_columns(
        *(sa.Column(name, sa.String) for name in ("robot_name", "measurement_set_name", "serial_number"))
    ),
    references={
        "measurement_set_id": "measurement_sets.id",
        "second_set_id": "measurement_sets.id",
        "robot_id": "robots.id",
    },
    indexes=[
        *_make_listing_indexes("jobs", covering=["kind", *_JOB_FILTER_COLUMNS]),
        # Indexes for each kind, so that listing a kind with few jobs is faster than listing all jobs.
        *_make_listing_indexes("jobs_kind", "kind", covering=_JOB_FILTER_COLUMNS),
        _make_deletion_index("jobs"),
        _make_old_index("jobs"),
        _make_index("jobs_open", "kind", where=OPEN),
        _make_index("jobs_robot_id", "robot_id", "kind"),
        _make_index("jobs_measurement_set_id", "measurement_set_id"),
        _make_index("jobs_second_set_id", "second_set_id"),
        _make_index("jobs_name", "kind", "name", where=VISIBLE),
    ],
)

idempotency_keys = sa.Table(
    "idempotency_keys",
    metadata,
    sa.Column("resource", sa.String, primary_key=True),  # collection of what the key created
    sa.Column("key_hash", sa.String, primary_key=True),  # SHA-256: a key may be any text of any length
    sa.Column("body_hash", sa.String, nullable=False),
    sa.Column("resource_id", sa.String, nullable=False),
    sa.Column("created_at", UtcDateTime, nullable=False),
)

job_steps = sa.Table(
    "job_steps",
    metadata,
    sa.Column("job_id", sa.String, primary_key=True),
    sa.Column("start", sa.Integer, primary_key=True, autoincrement=False),  # first unit of the step
    sa.Column("units", sa.Integer, nullable=False),
    sa.Column("result", sa.LargeBinary, nullable=False),
    sa.Column("stored_at", UtcDateTime, nullable=True),  # null: stored by a program of layout 0018
    sa.Column("version", sa.String, nullable=True),  # of the program that computed the step; null: as above
)

heartbeats = sa.Table(
    "heartbeats",
    metadata,
    sa.Column("executor", sa.String, primary_key=True),
    sa.Column("beat_at", UtcDateTime, nullable=False),
)

wrong_keys = sa.Table(
    "wrong_keys",
    metadata,
    sa.Column("network", sa.String, primary_key=True),
    sa.Column("number", sa.Float, nullable=False),  # count of wrong keys at `counted_at`
    sa.Column("counted_at", UtcDateTime, nullable=False),
)

access_keys = sa.Table("access_keys", metadata, *_make_columns(AccessKey, {}, key="id"))

# A session's key is one of the table above, or of a file of keys.
access_sessions = sa.Table("access_sessions", metadata, *_make_columns(SessionRecord, {}, key="token_hash"))

access_links = sa.Table(
    "access_links",
    metadata,
    sa.Column("token_hash", sa.String, primary_key=True),
    sa.Column("key_id", sa.String, nullable=False),
    sa.Column("ends_at", UtcDateTime, nullable=False),
)

bridges = sa.Table("bridges", metadata, *_make_columns(BridgeRecord, {}, key="id"))

# Journals refer to nothing: they outlive the robots and the runs that they name.
audit = _make_numbered_table("audit", AuditEntry, indexes=[_make_index("audit_key_id", "key_id")])
live_entries = _make_numbered_table(
    "live_entries", LiveEntry, indexes=[_make_index("live_entries_set_id", "set_id")]
)
_unique_columns = [live_entries.c[name] for name in ("set_id", "change", "label")]
sa.Index("ix_live_entries_once", *_unique_columns, unique=True)


def select_fields_of(table: sa.Table, record: type) -> sa.Select[Any]:
    """Return the query of the columns of a table that are fields of a dataclass, in the fields' order."""
    return sa.select(*(table.c[field.name] for field in fields(record)))


# The table has the name that Alembic uses.
layouts = sa.Table("alembic_version", metadata, sa.Column("version_num", sa.String(32), primary_key=True))


def make_tables(database: Database) -> None:
    """Create the tables if the database has none; safe if several processes do so at once.

    Raises:
        StoreError: the database has the tables of another version.
        StoreUnavailableError: the tables cannot be created.
    """
    with database.reading() as connection:
        if has_tables(connection):
            return
    with database.writing() as connection:
        if database.dialect == "postgresql":  # on SQLite the transaction holds the write lock already
            lock_tables(connection)
        if not has_tables(connection):
            try:
                for table in metadata.sorted_tables:
                    connection.execute(CreateTable(table))
                    for index in indexes_of(table):
                        connection.execute(CreateIndex(index))
                if database.dialect == "sqlite":
                    _write_assumed_statistics(connection)
            except DBAPIError as error:
                raise StoreUnavailableError(
                    f"the tables cannot be created ({str(error.orig).strip().splitlines()[0][:200]})",
                    "use a database without tables of other programs, and let its user create tables",
                ) from error
            connection.execute(sa.insert(layouts).values(version_num=LAYOUT))


def indexes_of(table: sa.Table) -> list[sa.Index]:
    """Return the indexes of a table, sorted by name.

    The order matters, because SQLite's plans depend on the order in which the indexes are created.
    """
    return sorted(table.indexes, key=lambda index: str(index.name))


_ASSUMED_ROWS: Final = 100_000  # assumed number of rows of each table
_ASSUMED_DISTINCT_VALUES: Final[Mapping[str, int]] = MappingProxyType(
    {
        **dict.fromkeys(("kind", "state", "verdict", "method", "weighting", "elasticity", "encoders"), 4),
        **dict.fromkeys(("operator", "instrument", "key_id"), 30),
        **dict.fromkeys(("robot_id", "name", "serial_number", "second_set_id", "set_id"), 1_000),
        **dict.fromkeys(("measurement_set_id", "content_hash"), 50_000),
    }
)
"""Assumed number of different values of columns; all other columns have another value in each row."""
_ROWS_OF_SMALL_INDEXES: Final = MappingProxyType(
    {
        "ix_jobs_open": 100,
        "ix_last_campaigns_due": 100,
        **{f"ix_{name}_deleted_at": 1_000 for name in ("robots", "measurement_sets", "open_sets", "jobs")},
        **{f"ix_{name}_old": 100 for name in ("robots", "measurement_sets", "open_sets", "jobs")},
    }
)
"""Assumed number of rows of indexes that have few rows."""


def _write_assumed_statistics(connection: sa.Connection) -> None:
    """Write assumed statistics of a store of usual size, from which SQLite chooses the indexes of a query.

    With these statistics, SQLite uses the same plans for all files, whatever they contain.
    """
    connection.exec_driver_sql("ANALYZE")  # creates the table of statistics
    for table in metadata.sorted_tables:
        for index in indexes_of(table):
            rows = _ROWS_OF_SMALL_INDEXES.get(str(index.name), _ASSUMED_ROWS)
            # `stat` has the number of rows, then the mean number of rows that are equal in the first column,
            # in the first two columns, and so on.
            equal_counts, equal_rows = [], float(rows)
            for column in index.columns:
                equal_rows = max(1.0, equal_rows / _ASSUMED_DISTINCT_VALUES.get(column.name, rows))
                equal_counts.append(round(equal_rows))
            statistics = " ".join(map(str, [rows, *equal_counts]))
            connection.exec_driver_sql(
                "INSERT INTO sqlite_stat1 (tbl, idx, stat) VALUES (?, ?, ?)",
                (table.name, index.name, statistics),
            )
    connection.exec_driver_sql("ANALYZE sqlite_schema")  # lets SQLite read the table of statistics


def lock_tables(connection: sa.Connection) -> None:
    """Take the lock for changes of the tables on PostgreSQL; the lock is released when the transaction ends.

    Raises:
        StoreUnavailableError: another process has had the lock for a minute.
    """
    deadline = time.monotonic() + LOCK_SECONDS
    lock = sa.text("SELECT pg_try_advisory_xact_lock(:n)")
    while not connection.execute(lock, {"n": _ADVISORY_LOCK}).scalar_one():
        if time.monotonic() > deadline:
            raise StoreUnavailableError(
                f"another process has been creating or upgrading the tables for {LOCK_SECONDS:.0f} s",
                "end the other process if that process hangs, and start again",
            )
        time.sleep(0.05)


def has_tables(connection: sa.Connection) -> bool:
    """Return whether a database has tables that this version can use.

    Raises:
        StoreError: the database has the tables of another version.
    """
    layout = read_layout(connection)
    if layout is not None:
        refuse_unusable(layout, connection.dialect.name)
    return layout is not None


def read_layout(connection: sa.Connection) -> str | None:
    """Return the name of the layout of a database; None for a database without tables of ours."""
    if layouts.name not in sa.inspect(connection).get_table_names():
        return None
    layout = connection.execute(sa.select(layouts.c.version_num)).scalar()
    return None if layout is None else str(layout)
