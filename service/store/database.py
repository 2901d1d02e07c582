"""An open database, SQLite or PostgreSQL: connections, transactions and the quota of its size."""

from __future__ import annotations

import os
import sqlite3
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal, NoReturn

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.exc import (
    ArgumentError,
    DataError,
    DBAPIError,
    IntegrityError,
    NotSupportedError,
    OperationalError,
    ProgrammingError,
)
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

from jointstiff.service.problems import (
    LockedError,
    MissingDatabaseError,
    QuotaError,
    StoreError,
    StoreUnavailableError,
)

Dialect = Literal["sqlite", "postgresql"]

_URLS = "give sqlite:///path/to/file.db or postgresql://user:password@host/database"
_DIALECTS: dict[str, Dialect] = {
    "sqlite": "sqlite",
    "postgresql": "postgresql",
    "postgres": "postgresql",
    "postgresql+psycopg": "postgresql",
}
BUSY_SECONDS = 20.0
"""Time that a transaction waits for other writers of SQLite [s]."""
LOCKED_SECONDS = 1.0
"""Time that a transaction waits for the lock after an earlier transaction waited in vain [s]."""
_CONNECTIONS = 16
_KEEPALIVE_SETTINGS: Final = MappingProxyType(
    {
        # The server ends the session of a machine that is lost, also in the middle of a message.
        "tcp_keepalives_idle": 5,  # s
        "tcp_keepalives_interval": 2,  # s
        "tcp_keepalives_count": 3,
    }
)
"""Settings with which the PostgreSQL server notices a lost machine; the URL can override them."""
_SERVER_SETTINGS: Final = MappingProxyType(
    {
        "lock_timeout": 3_000,  # ms
        "statement_timeout": 5_000,  # ms
        # Without this timeout a worker that is stopped inside a transaction would keep its locks for ever.
        # A client gives up a statement after 5.5 s, so a living client sends within this time.
        "idle_in_transaction_session_timeout": 8_000,  # ms
        **_KEEPALIVE_SETTINGS,
    }
)
"""Settings of the PostgreSQL server for services and workers; the URL can override them."""
_TRANSACTION_TIMEOUT: Final = "transaction_timeout"
_TRANSACTION_MILLISECONDS: Final = 30_000
"""Time after which PostgreSQL ends a transaction, from version 17 on."""
_FIRST_WITH_TRANSACTION_TIMEOUT: Final = 170_000
"""Oldest version of PostgreSQL, as a number of the driver, that has `transaction_timeout`."""
PROGRAM: Final = "jointstiff"
"""Beginning of the name of each connection to PostgreSQL."""
_MOST_NAME_BYTES: Final = 63  # PostgreSQL cuts longer names of connections
_CONNECTION_PARAMETERS: Final = MappingProxyType(
    {
        "connect_timeout": 3,  # s
        "keepalives_idle": 10,  # s
        "keepalives_interval": 5,  # s
        "keepalives_count": 3,
        "tcp_user_timeout": 10_000,  # ms
    }
)
"""Parameters that decide when a connection to PostgreSQL is lost; the URL can override them."""
_MIGRATION_LOCK_MILLISECONDS: Final = 2_000
_MIGRATION_SETTINGS: Final = MappingProxyType(
    {
        "lock_timeout": _MIGRATION_LOCK_MILLISECONDS,
        # A program that is stopped during a step, or whose machine is lost, has locked the tables.
        "idle_in_transaction_session_timeout": 15_000,  # ms
        **_KEEPALIVE_SETTINGS,
    }
)
"""Settings of the PostgreSQL server while tables are changed; the URL can override them."""
_AWAY_SECONDS: Final = 2.0  # pause before a server that gave no answer is tried again
_CORRECTABLE_STATES: Final = frozenset({"42501", "3F000"})  # SQLSTATE: a privilege, or a schema, is missing
_LOCK_NOT_AVAILABLE: Final = "55P03"  # SQLSTATE
_NO_VALUES: Mapping[str, object] = MappingProxyType({})


class Database:
    """One open database. Safe to use from several threads; each block has its own connection.

    Reader and writer share a pool of connections. The *reader* carries out each statement on its own
    (autocommit), which saves two round trips. The *writer* begins a transaction; on SQLite with the write
    lock, as a lock that is requested later can fail without waiting if the read data are outdated.
    """

    def __init__(self, dialect: Dialect, reader: sa.Engine, writer: sa.Engine) -> None:
        self.dialect = dialect
        self._reader = reader
        self._writer = writer
        # SQLite admits one writer at a time, and other writers must poll. Threads wait for this semaphore
        # instead, which halves the waiting time and avoids very long waits.
        self._writer_slots = threading.BoundedSemaphore(1 if dialect == "sqlite" else _CONNECTIONS)
        self._last_wait_failed = False  # True after a writer waited in vain: the next writer waits less long
        self._is_read_only = False
        self._away_until = 0.0  # monotonic time before which a silent server is not tried again
        sa.event.listen(reader, "checkin", self._close_if_unusable)

    @classmethod
    def open(cls, url: str) -> Database:
        """Connect to the database at `url`.

        Args:
            url: `sqlite:///path`, `sqlite://` (in memory, gone when closed) or `postgresql://…`.

        Raises:
            StoreError: The URL is not that of a supported database.
            StoreUnavailableError: The database does not answer.
        """
        parsed = _parse_url(url)
        if _DIALECTS[parsed.drivername] == "sqlite":
            if not _is_in_memory(parsed):
                make_private(str(parsed.database))
            database = cls("sqlite", *_sqlite_engines(parsed))
            prepare = _switch_to_wal
        else:
            database = cls("postgresql", *_postgresql_engines(parsed))
            prepare = _check_encoding
        try:
            with database.reading() as connection:
                prepare(connection)
        except BaseException:
            database.close()
            raise
        return database

    def close(self) -> None:
        """Close all connections; a connection that a thread still uses is closed afterwards."""
        dispose(self._reader)

    def _close_if_unusable(self, _: object, record: sa.pool.ConnectionPoolEntry) -> None:
        """Close a connection that returns to the pool if the database was found read-only.

        If an SQLite file was read-only when a connection was opened, new connections of this process are
        read-only, too, until all connections are closed.
        """
        if self._is_read_only:
            record.invalidate()

    @contextmanager
    def reading(self) -> Iterator[sa.Connection]:
        """Yield a connection on which each statement is a transaction of its own."""
        with self._translate_errors(), self._reader.connect() as connection:
            yield connection

    @contextmanager
    def writing(self, at_most: float = BUSY_SECONDS) -> Iterator[sa.Connection]:
        """Yield a connection in a transaction: committed after the block, rolled back if the block raises.

        Args:
            at_most: longest time to wait for locks of other transactions [s].

        Raises:
            StoreUnavailableError: the database does not answer, or other writers keep it locked.
        """
        with (
            self._translate_errors(),
            self._writer_slot(at_most) as remaining_wait,
            self._writer.connect().execution_options(busy_seconds=remaining_wait) as connection,
        ):
            try:
                transaction = connection.begin()
            except OperationalError as error:
                was_locked = _sqlite_code(error) == sqlite3.SQLITE_BUSY
                self._last_wait_failed = was_locked and (self._last_wait_failed or at_most >= BUSY_SECONDS)
                raise
            self._last_wait_failed = self._is_read_only = False
            with transaction:
                if self.dialect == "postgresql" and at_most < BUSY_SECONDS:
                    connection.exec_driver_sql(f"SET LOCAL lock_timeout = {1000.0 * at_most:.0f}")
                yield connection

    @contextmanager
    def writing_once(self, at_most: float = BUSY_SECONDS) -> Iterator[sa.Connection]:
        """Yield a connection for one statement that changes rows.

        On PostgreSQL the statement is a transaction by itself, so that no lock is kept while the server waits
        for this program. On SQLite, where no other machine takes part, this is `writing`.

        Args:
            at_most: longest time to wait for locks of other transactions [s].

        Raises:
            StoreUnavailableError: the database does not answer, or other writers keep it locked.
        """
        if self.dialect == "sqlite" or at_most < BUSY_SECONDS:  # the limit needs a statement of its own
            with self.writing(at_most) as connection:
                yield connection
            return
        with self._translate_errors(), self._writer_slot(at_most), self._reader.connect() as connection:
            yield connection

    @contextmanager
    def _writer_slot(self, at_most: float) -> Iterator[float]:
        """Wait until this thread may write; yield the time that is left to wait for the database [s]."""
        longest_wait = min(at_most, LOCKED_SECONDS if self._last_wait_failed else BUSY_SECONDS)
        deadline = time.monotonic() + longest_wait
        if not self._writer_slots.acquire(timeout=longest_wait):
            self._last_wait_failed |= at_most >= BUSY_SECONDS
            raise PoolTimeoutError(f"the database has been locked by other writers for {longest_wait:.0f} s")
        try:
            yield max(0.0, deadline - time.monotonic())
        finally:
            self._writer_slots.release()

    def rows(self, query: sa.Executable, values: Mapping[str, object] = _NO_VALUES) -> Sequence[Any]:
        """Return the rows that a query finds."""
        with self.reading() as connection:
            return connection.execute(query, values).all()

    def change(self, *statements: sa.Executable) -> int:
        """Carry out statements in one transaction; return the number of rows that the last changed."""
        block = self.writing_once if len(statements) == 1 else self.writing
        with block() as connection:
            return [connection.execute(statement).rowcount for statement in statements][-1]

    def change_returning(self, statement: sa.Executable, at_most: float = BUSY_SECONDS) -> Sequence[Any]:
        """Carry out a statement with RETURNING, a transaction by itself; return its rows.

        `at_most` is the longest time to wait for locks of other transactions [s].
        """
        with self.writing_once(at_most) as connection:
            return connection.execute(statement).all()

    def now(self, connection: sa.Connection) -> datetime:
        """Return the time of the clock that all programs which use this database share."""
        if self.dialect == "sqlite":  # all programs that use the file run on this machine
            return datetime.now(UTC)
        now: datetime = connection.execute(sa.select(sa.func.now())).scalar_one()
        return now

    def make_now(self) -> sa.ColumnElement[datetime]:
        """Return the expression of the time of the shared clock, for a statement that runs at once."""
        if self.dialect == "sqlite":
            return sa.literal(datetime.now(UTC))
        return sa.func.now()

    @contextmanager
    def _translate_errors(self) -> Iterator[None]:
        """Turn errors of the driver into `StoreUnavailableError`, of locks into `LockedError`.

        Broken constraints and wrong statements of this program are raised unchanged.
        """
        if time.monotonic() < self._away_until:  # set only for a PostgreSQL server
            raise StoreUnavailableError(
                "the postgresql database does not answer", "check that the server runs, and check its address"
            )
        try:
            yield
        except (IntegrityError, DataError, NotSupportedError):
            raise  # the caller handles broken constraints; the other two are mistakes of this program
        except (DBAPIError, PoolTimeoutError) as error:
            cause = error.orig if isinstance(error, DBAPIError) else error
            if _is_wrong_statement(error):
                raise  # no outage: the same statement would fail for ever
            if type(cause).__name__ in {"ConnectionTimeout", "SilentServerError"}:
                self._away_until = time.monotonic() + _AWAY_SECONDS
            self._is_read_only |= _sqlite_code(error) == sqlite3.SQLITE_READONLY
            lines = str(cause).strip().splitlines() or [type(cause).__name__]
            unavailable = LockedError if _is_lock_refusal(error) else StoreUnavailableError
            raise unavailable(
                f"the {self.dialect} database failed ({lines[0][:200]})",
                "check that the file is writable and its disk is not full"
                if self.dialect == "sqlite"
                else "check that the server runs, and check its address, user and privileges",
                # Clients get this text, as the text of a PostgreSQL server names machines.
                None if self.dialect == "sqlite" else "the postgresql database does not answer",
            ) from error


def make_insert(dialect: str, table: sa.Table) -> Any:  # noqa: ANN401 - of either dialect
    """Return a statement that inserts into a table, and can state what a row with the same key leads to."""
    return sqlite.insert(table) if dialect == "sqlite" else postgresql.insert(table)


def insert_unless_present(connection: sa.Connection, table: sa.Table) -> Any:  # noqa: ANN401 - of either dialect
    """Return a statement that inserts a row, and does nothing if a row with the same key exists."""
    return make_insert(connection.dialect.name, table).on_conflict_do_nothing()


def name_connections(url: str, name: str) -> str:
    """Return the URL of a database with a name for connections, `jointstiff:NAME`; SQLite has no names.

    The name of each connection is in the view `pg_stat_activity` of PostgreSQL.
    """
    parsed = _parse_url(url)
    if _DIALECTS[parsed.drivername] == "sqlite":
        return url
    named = parsed.update_query_dict({"application_name": connection_name(name)})
    return named.render_as_string(hide_password=False)


def connection_name(name: str) -> str:
    """Return the name of the connections of a program, as PostgreSQL shows it."""
    printable = "".join(each if " " <= each <= "~" else "?" for each in f"{PROGRAM}:{name}")
    return printable[:_MOST_NAME_BYTES]


def make_engine(url: str, connections: int) -> sa.Engine:
    """Create an engine of SQLAlchemy for a library that has tables of its own in the same database.

    Args:
        url: URL of the database.
        connections: greatest number of connections.
    """
    parsed = _parse_url(url)
    if _DIALECTS[parsed.drivername] == "postgresql":
        return _postgresql_engine(parsed, connections)
    engine = sa.create_engine(parsed, hide_parameters=True, pool_size=connections, max_overflow=0)
    sa.event.listen(engine, "connect", _configure_transactions)
    return engine


def make_migrating_engine(url: str) -> sa.Engine:
    """Create an engine for changes of the tables, whose statements may take long.

    On SQLite, a transaction begins with the write lock, and changes of tables belong to the transaction.
    References are not checked, as a table that is made anew is removed meanwhile. On PostgreSQL, a statement
    waits at most `_MIGRATION_LOCK_MILLISECONDS` for a lock, as statements of others wait behind it. The
    server ends a transaction whose program has been stopped for 15 s.
    """
    parsed = _parse_url(url)
    if _DIALECTS[parsed.drivername] == "postgresql":
        return _postgresql_engine(parsed, 1, _MIGRATION_SETTINGS, answer_in_time=False)
    engine, writer = _sqlite_engines(parsed)
    sa.event.listen(engine, "connect", _ignore_references)
    return writer.execution_options(busy_seconds=BUSY_SECONDS)


def dispose(engine: sa.Engine) -> None:
    """Close all connections of an engine for good; one that a thread still uses is closed afterwards."""

    def refuse(*_: object) -> NoReturn:
        raise RuntimeError("the database is closed")

    sa.event.listen(engine, "checkin", lambda _, record: record.invalidate())
    sa.event.listen(engine, "do_connect", refuse, insert=True)
    engine.dispose()


def open_existing(url: str) -> Database:
    """Connect to a database that exists; none is created.

    Raises:
        StoreError: the database does not exist, or cannot be used.
    """
    refuse_missing(url)
    return Database.open(url)


def refuse_missing(url: str, remedy: str = _URLS) -> None:
    """Refuse an SQLite file that does not exist; `remedy` is the remedy of the error.

    Raises:
        MissingDatabaseError: the file does not exist.
        StoreError: the database is in memory.
    """
    parsed = _parse_url(url)
    if _DIALECTS[parsed.drivername] == "sqlite" and not sqlite_path_of(parsed).exists():
        raise MissingDatabaseError(f"the database {parsed.database} does not exist", remedy)


def _is_in_memory(url: sa.URL) -> bool:
    """Return whether the URL of an SQLite database is that of a database in memory."""
    return url.database in {None, "", ":memory:"}


def refuse_in_memory(url: str) -> None:
    """Refuse an SQLite database in memory, which workers, being other processes, cannot share.

    Raises:
        StoreError: the URL is that of a database in memory.
    """
    parsed = _parse_url(url)
    if _DIALECTS[parsed.drivername] == "sqlite" and _is_in_memory(parsed):
        raise StoreError(
            "an in-memory database cannot be shared with workers",
            "use a file: --database sqlite:///jointstiff.db",
        )


def sqlite_path_of(url: sa.URL) -> Path:
    """Return the path of the file of an SQLite database.

    Raises:
        StoreError: the database is in memory.
    """
    if _is_in_memory(url):
        raise StoreError("a database in memory has no file", _URLS)
    return Path(str(url.database))


def _parse_url(url: str) -> sa.URL:
    """Parse the URL of a database; raise `StoreError` if it is invalid or not supported."""
    try:
        parsed = sa.make_url(url)
    except (ArgumentError, ValueError) as error:
        raise StoreError("the database URL is invalid", _URLS) from error
    if parsed.drivername not in _DIALECTS:
        raise StoreError(f"{parsed.drivername} is not a supported database", _URLS)
    if parsed.drivername == "sqlite" and parsed != sa.URL.create("sqlite", database=parsed.database):
        raise StoreError("an SQLite URL must have only a path", _URLS)
    return parsed


def make_private(path: str | Path) -> None:
    """Create the file of a new SQLite database, readable by its owner alone.

    SQLite gives the files that it puts next to this file the same mode.
    """
    with suppress(OSError):  # the file exists, or SQLite will say why it cannot be created
        os.close(os.open(path, os.O_CREAT | os.O_EXCL, 0o600))


def _sqlite_engines(url: sa.URL) -> tuple[sa.Engine, sa.Engine]:
    """Return the engines of reader and writer for SQLite; they share a pool of connections."""
    is_in_memory = _is_in_memory(url)
    reader = sa.create_engine(
        url,
        hide_parameters=True,  # so that an error in the log shows no content of a database
        isolation_level="AUTOCOMMIT",  # the driver begins no transaction: `_begin_immediate` does
        connect_args={"timeout": BUSY_SECONDS, "check_same_thread": False},
        poolclass=sa.QueuePool,
        # A database in memory exists only in its one connection, which all threads share.
        pool_size=1 if is_in_memory else _CONNECTIONS,
        max_overflow=0,
    )
    sa.event.listen(reader, "connect", _configure_sqlite)
    writer = reader.execution_options()
    sa.event.listen(writer, "begin", _begin_immediate)
    return reader, writer


def _configure_sqlite(connection: sqlite3.Connection, _record: object) -> None:
    """Configure a new connection to write durably and to check foreign keys."""
    connection.execute("PRAGMA synchronous=FULL").close()
    connection.execute("PRAGMA foreign_keys=ON").close()


def _ignore_references(connection: sqlite3.Connection, _record: object) -> None:
    """Configure a new connection not to check foreign keys."""
    connection.execute("PRAGMA foreign_keys=OFF").close()


def _configure_transactions(connection: sqlite3.Connection, _record: object) -> None:
    """Configure a new connection whose driver takes the write lock when a transaction begins."""
    _configure_sqlite(connection, _record)
    connection.isolation_level = "IMMEDIATE"
    connection.execute(f"PRAGMA busy_timeout={1000.0 * BUSY_SECONDS:.0f}").close()


def _begin_immediate(connection: sa.Connection) -> None:
    """Begin a transaction with the write lock; wait for the lock at most the connection's `busy_seconds`."""
    longest_wait = connection.get_execution_options()["busy_seconds"]
    is_shorter = longest_wait < 0.9 * BUSY_SECONDS
    if is_shorter:
        connection.exec_driver_sql(f"PRAGMA busy_timeout={1000.0 * longest_wait:.0f}")
    try:
        connection.exec_driver_sql("BEGIN IMMEDIATE")
    finally:
        if is_shorter:  # later users of this pooled connection have the usual time again
            connection.exec_driver_sql(f"PRAGMA busy_timeout={1000.0 * BUSY_SECONDS:.0f}")


def _switch_to_wal(connection: sa.Connection) -> None:
    """Set SQLite's write-ahead log, with which readers and the writer do not block each other.

    The mode is kept in the file. SQLite does not wait for a lock when the mode is set, so setting is repeated
    while another process opens the same new file.

    Raises:
        StoreUnavailableError: the file system does not support a write-ahead log.
    """
    deadline = time.monotonic() + BUSY_SECONDS
    while True:
        try:
            mode = connection.exec_driver_sql("PRAGMA journal_mode=WAL").scalar_one()
            break
        except OperationalError as error:
            if _sqlite_code(error) != sqlite3.SQLITE_BUSY or time.monotonic() > deadline:
                raise
            time.sleep(0.01)
    if mode not in {"wal", "memory"}:
        raise StoreUnavailableError(
            f"the file system of the SQLite database does not support a write-ahead log (mode {mode})",
            "put the file on a local disk, or use PostgreSQL",
        )


def _is_wrong_statement(error: Exception) -> bool:
    """Return whether an error comes from a wrong statement of this program, not from the database's state."""
    if isinstance(error, ProgrammingError):
        # An error without a state comes from a wrong URL.
        return getattr(error.orig, "sqlstate", None) not in {None, *_CORRECTABLE_STATES}
    return _sqlite_code(error) == sqlite3.SQLITE_ERROR


def _is_lock_refusal(error: DBAPIError | PoolTimeoutError) -> bool:
    """Return whether an operation failed because another transaction keeps a lock."""
    if isinstance(error, PoolTimeoutError):
        return True
    is_refused = getattr(error.orig, "sqlstate", None) == _LOCK_NOT_AVAILABLE
    return is_refused or _sqlite_code(error) == sqlite3.SQLITE_BUSY


def _sqlite_code(error: Exception) -> int:
    """Return the primary result code of SQLite for an error; 0 for any other error."""
    code = getattr(getattr(error, "orig", None), "sqlite_errorcode", 0)
    return code & 0xFF if isinstance(code, int) else 0


def _postgresql_engines(url: sa.URL) -> tuple[sa.Engine, sa.Engine]:
    """Return the engines of reader and writer for PostgreSQL; they share a pool of connections."""
    writer = _postgresql_engine(url, _CONNECTIONS)
    return writer.execution_options(isolation_level="AUTOCOMMIT"), writer


def _postgresql_engine(
    url: sa.URL,
    connections: int,
    settings: Mapping[str, int] = _SERVER_SETTINGS,
    *,
    answer_in_time: bool = True,
) -> sa.Engine:
    """Return an engine for PostgreSQL.

    Args:
        url: URL of the database.
        connections: size of the pool of connections.
        settings: setting of the server → value in the unit of the setting; the URL can override them.
        answer_in_time: True to close a connection whose server does not answer in time.
    """
    # Imported here, because a service with SQLite does not need the driver of PostgreSQL
    from jointstiff.service.store.postgresql import SimpleCursor

    options = " ".join(f"-c {name}={value}" for name, value in settings.items())
    own_parameters = _CONNECTION_PARAMETERS | {"application_name": PROGRAM}
    connect_args: dict[str, Any] = {
        name: value for name, value in own_parameters.items() if name not in url.query
    }
    connect_args |= {
        "client_encoding": "utf8",
        "options": f"{options} {_join_server_options(url)}",
        "cursor_factory": SimpleCursor,
    }
    engine = sa.create_engine(
        url.set(drivername="postgresql+psycopg"),
        connect_args=connect_args,
        hide_parameters=True,
        pool_size=connections,
        max_overflow=0,
        pool_pre_ping=True,  # a server that was restarted costs a reconnection, not an error
    )
    if answer_in_time:
        sa.event.listen(engine, "do_connect", _connect_with_deadlines)
        if _TRANSACTION_TIMEOUT not in _join_server_options(url):
            sa.event.listen(engine, "connect", _limit_transactions)
    return engine


def _limit_transactions(connection: Any, _record: object) -> None:  # noqa: ANN401 - of psycopg
    """Configure a new connection to end long transactions, if the server knows the setting."""
    if connection.info.server_version >= _FIRST_WITH_TRANSACTION_TIMEOUT:
        connection.execute(f"SET {_TRANSACTION_TIMEOUT} = {_TRANSACTION_MILLISECONDS}")
        connection.commit()


def _join_server_options(url: sa.URL) -> str:
    """Return the `options` of a URL, which may have several, as one text."""
    options = url.query.get("options", ())
    return options if isinstance(options, str) else " ".join(options)


def _connect_with_deadlines(_dialect: object, _record: object, arguments: Any, parameters: Any) -> object:  # noqa: ANN401 - as SQLAlchemy has them
    """Connect to PostgreSQL with a limit of the time for answers; SQLAlchemy calls this function."""
    # Imported here, because a service with SQLite does not need the driver of PostgreSQL
    from jointstiff.service.store.postgresql import PatientConnection

    return PatientConnection.connect(*arguments, **parameters)


def _check_encoding(connection: sa.Connection) -> None:
    """Raise `StoreError` if a PostgreSQL database is not encoded in UTF-8."""
    encoding = connection.exec_driver_sql("SHOW server_encoding").scalar_one()
    if encoding != "UTF8":
        raise StoreError(
            f"the PostgreSQL database has the encoding {encoding}",
            "create a database with ENCODING 'UTF8'",
        )


_FRESH_SECONDS: Final = 1.0  # time for which a size is used again; posts in this time may exceed the quota
_SIZES: Final = {
    # Pages that are free will be used again; the file itself does not shrink.
    "sqlite": "SELECT (page_count - freelist_count) * page_size "
    "FROM pragma_page_count, pragma_freelist_count, pragma_page_size",
    "postgresql": "SELECT pg_database_size(current_database())",
}


class Quota:
    """Size of a database and its greatest allowed size, the quota. Safe to use from several threads."""

    def __init__(self, database: Database, most: int | None = None) -> None:
        """Watch the size of a database.

        Args:
            database: the database; other programs may use it, too.
            most: greatest allowed size [bytes]; None for no limit.
        """
        self.most = most
        self._database = database
        self._lock = threading.Lock()
        self._used, self._read_at = 0, -_FRESH_SECONDS  # size [bytes], and monotonic time of reading it

    def used(self) -> int:
        """Return the size of the database [bytes]; the value may be a second old.

        Raises:
            StoreUnavailableError: the database does not answer.
        """
        with self._lock:
            if time.monotonic() - self._read_at >= _FRESH_SECONDS:
                with self._database.reading() as connection:
                    self._used = int(connection.execute(sa.text(_SIZES[self._database.dialect])).scalar_one())
                self._read_at = time.monotonic()
            return self._used

    def refuse_full(self) -> None:
        """Raise an error if the database has reached its quota.

        Raises:
            QuotaError: the database has reached its quota.
            StoreUnavailableError: the database does not answer.
        """
        if self.most is not None and (used := self.used()) >= self.most:
            raise QuotaError(used, self.most)
