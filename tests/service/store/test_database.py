"""Databases that are opened, refused, and saved by their own tools."""

import hashlib
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from uuid import uuid4

import psycopg
import pytest
from sqlalchemy import event, text
from sqlalchemy.dialects import sqlite as sqlite_dialect
from sqlalchemy.exc import DBAPIError
from sqlalchemy.schema import CreateIndex, CreateTable
from support.claims import Claims
from support.jobs import run_request, runs_of, stored_set

from jointstiff.service.kinds.run.work import RunWork
from jointstiff.service.kinds.work import pack_arrays
from jointstiff.service.problems import StoreError, StoreUnavailableError
from jointstiff.service.store import database as database_module
from jointstiff.service.store import packing
from jointstiff.service.store.database import Database
from jointstiff.service.store.layouts import LAYOUT
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import RobotRecord, indexes_of, metadata
from jointstiff.service.workers.worker import Recovery

TIME = datetime(2026, 11, 20, tzinfo=UTC)


def test_a_new_file_is_its_owners_alone(tmp_path: Path) -> None:
    with Store.open(f"sqlite:///{tmp_path / 'jointstiff.db'}"):
        modes = {path.name: path.stat().st_mode & 0o777 for path in tmp_path.iterdir()}
    assert set(modes.values()) == {0o600}
    assert "jointstiff.db-wal" in modes


@pytest.mark.parametrize(
    ("layout", "remedy"),
    [
        ("0001", "the version that wrote it"),
        ("0006_authorisations", "the version that wrote it"),
        ("9999", "the version that wrote it"),  # of another program
        ("9999_contract_documents", "install the newer version"),
        (f"{int(LAYOUT[:4]) + 1:04}_contract_trend", "install the newer version"),
        (f"{int(LAYOUT[:4]) + 2:04}_expand_two_ahead", "install the newer version"),
    ],
)
def test_a_database_of_another_layout_is_refused_and_left_alone(
    database_url: str, layout: str, remedy: str
) -> None:
    """Newer ones, and those from before the first release."""
    Store.open(database_url).close()
    database = Database.open(database_url)
    with database.writing() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = :v"), {"v": layout})
    for upgrade in (None, print):
        with pytest.raises(StoreError, match=layout) as caught:
            Store.open(database_url, upgrade=upgrade)
        assert remedy in caught.value.remedy
    saves = "sqlite3 FILE '.backup SAVED'" if database.dialect == "sqlite" else "pg_dump --format=custom"
    assert "newer" in remedy or saves in caught.value.remedy
    with database.reading() as connection:
        assert connection.execute(text("SELECT version_num FROM alembic_version")).scalar() == layout
    database.close()


def test_the_next_layout_can_be_used_if_an_expand_step_leads_to_it(database_url: str) -> None:
    """Two versions of the service work on one database: the newer has upgraded it, the older goes on."""
    Store.open(database_url).close()
    following = f"{int(LAYOUT[:4]) + 1:04}_expand_more"
    record = RobotRecord("r1", "n", TIME, "h", "{}")
    with closing(Database.open(database_url)) as database:
        database.change(text("UPDATE alembic_version SET version_num = :v").bindparams(v=following))
        database.change(text("ALTER TABLE robots ADD COLUMN weather VARCHAR"))
    with Store.open(database_url, upgrade=print) as store:
        store.robots.add(record)
        assert store.robots.get("r1") == record


def test_other_tables_are_another_layout() -> None:
    """A change of the tables needs a file in `store/migrations/versions/`, a `LAYOUT`, and its hash here.

    So does another dictionary of the packed documents.
    """
    dialect = sqlite_dialect.dialect()
    made = [
        str(each.compile(dialect=dialect))
        for table in metadata.sorted_tables
        for each in (CreateTable(table), *map(CreateIndex, indexes_of(table)))
    ]
    digest = hashlib.sha256("".join([*made, packing._read_dictionary().decode()]).encode()).hexdigest()[:16]
    assert (LAYOUT, digest) == ("0024_expand_programs", "5c9db60af2fba353")


def test_tables_that_cannot_be_made_leave_nothing(database_url: str) -> None:
    database = Database.open(database_url)
    with database.writing() as connection:
        connection.execute(text("CREATE TABLE idempotency_keys (of_another_program INTEGER)"))
    with pytest.raises(StoreUnavailableError, match="idempotency_keys"):
        Store.open(database_url)
    with database.writing() as connection:
        connection.execute(text("DROP TABLE idempotency_keys"))
    database.close()
    Store.open(database_url).close()


def test_a_connection_given_back_after_the_end_is_closed(database_url: str) -> None:
    """By a thread that was in the middle of something when the database was closed."""
    database = Database.open(database_url)
    with database.reading() as late:
        database.close()
        held = late.connection.driver_connection
        assert held is not None
        assert late.execute(text("SELECT 1")).scalar() == 1
    if database.dialect == "postgresql":
        assert held.closed
    else:
        with pytest.raises(sqlite3.ProgrammingError, match="closed"):
            held.execute("SELECT 1")


def open_together(urls: list[str]) -> None:
    barrier = threading.Barrier(len(urls))

    def work(url: str) -> str:
        barrier.wait(30)
        with Store.open(url) as store:
            return store.ping()

    with ThreadPoolExecutor(len(urls)) as pool:
        assert len(list(pool.map(work, urls))) == len(urls)


def test_threads_open_a_fresh_database_together(database_url: str) -> None:
    open_together([database_url] * 8)


def test_threads_open_many_fresh_databases_together(tmp_path: Path) -> None:
    open_together([f"sqlite:///{tmp_path}/{number}.db" for number in range(8)])


@pytest.mark.process
def test_processes_open_a_fresh_database_together(database_url: str) -> None:
    program = (
        "import sys, time; from jointstiff.service.store.store import Store; print('ready', flush=True);"
        "sys.stdin.readline(); Store.open(sys.argv[1]).close(); print('opened')"
    )
    processes = [
        subprocess.Popen(
            [sys.executable, "-W", "error", "-c", program, database_url],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(3)
    ]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    for process in processes:
        output, errors = process.communicate(timeout=60)
        assert (output, errors) == ("opened\n", "")


def test_errors_do_not_show_the_password(tmp_path: Path) -> None:
    for url in (
        "postgresql://user:secret@127.0.0.1:1/database",
        f"postgresql://user:secret@/database?host={tmp_path}",
        f"postgresql://user:secret@/database?host={tmp_path}&nonsense=1",
    ):
        with pytest.raises(StoreError) as caught:
            Store.open(url)
        assert "secret" not in str(caught.value)


class TestSqlite:
    def test_is_durable_and_checks_references(self, tmp_path: Path) -> None:
        database = Database.open(f"sqlite:///{tmp_path / 'jointstiff.db'}")
        for block in (database.reading, database.writing):
            with block() as connection:
                settings = {
                    name: connection.exec_driver_sql(f"PRAGMA {name}").scalar()
                    for name in ("journal_mode", "synchronous", "foreign_keys", "busy_timeout")
                }
            assert settings == {
                "journal_mode": "wal",
                "synchronous": 2,
                "foreign_keys": 1,
                "busy_timeout": 20_000,
            }
        database.close()

    def test_opening_waits_for_a_writer(self, tmp_path: Path) -> None:
        path = tmp_path / "jointstiff.db"
        other = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        other.execute("BEGIN IMMEDIATE")  # before the file has a write-ahead log
        release = threading.Timer(0.2, other.close)
        release.start()
        Store.open(f"sqlite:///{path}").close()
        release.join()

    def test_a_writer_that_never_ends(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(database_module, "BUSY_SECONDS", 0.2)
        path = tmp_path / "jointstiff.db"
        with Store.open(f"sqlite:///{path}") as store:
            other = sqlite3.connect(path, isolation_level=None)
            other.execute("BEGIN IMMEDIATE")
            record = RobotRecord("r1", "n", TIME, "h", "{}")
            with pytest.raises(StoreUnavailableError, match="locked"):
                store.robots.add(record)
            with ThreadPoolExecutor(4) as pool:
                futures = [pool.submit(store.robots.add, record) for _ in range(4)]
            assert all(isinstance(f.exception(), StoreUnavailableError) for f in futures)
            assert store.robots.page(limit=1).records == (), "readers do not wait"
            other.close()
            assert store.robots.add(record) == record

    def test_those_who_wait_for_one_lock_wait_once(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Forty writers, four at a time: all are refused long before ten times the time of one."""
        monkeypatch.setattr(database_module, "BUSY_SECONDS", 2.0)
        monkeypatch.setattr(database_module, "LOCKED_SECONDS", 0.05)
        path = tmp_path / "jointstiff.db"
        with Store.open(f"sqlite:///{path}") as store:
            other = sqlite3.connect(path, isolation_level=None)
            other.execute("BEGIN IMMEDIATE")
            record, began = RobotRecord("r1", "n", TIME, "h", "{}"), time.monotonic()
            with ThreadPoolExecutor(4) as pool:
                futures = [pool.submit(store.robots.add, record) for _ in range(40)]
            assert all(isinstance(f.exception(), StoreUnavailableError) for f in futures)
            assert 1.8 < time.monotonic() - began < 10.0
            other.close()
            assert store.robots.add(record) == record


class TestPostgresql:
    def test_another_encoding_is_refused(self, new_postgresql_database: Callable[..., str]) -> None:
        url = new_postgresql_database("ENCODING 'LATIN1' TEMPLATE template0")
        with pytest.raises(StoreError, match="LATIN1"):
            Store.open(url)

    def test_a_lost_connection_is_replaced(self, new_postgresql_database: Callable[..., str]) -> None:
        url = new_postgresql_database()
        with Store.open(url) as store, psycopg.connect(url, autocommit=True) as other:
            others = "FROM pg_stat_activity WHERE datname = current_database()"
            query = f"SELECT pg_terminate_backend(pid) {others} AND pid != pg_backend_pid()"
            assert len(other.execute(query).fetchall()) >= 1
            assert store.ping() == "postgresql"

    def test_times_do_not_depend_on_the_servers_zone(
        self, new_postgresql_database: Callable[..., str]
    ) -> None:
        url = new_postgresql_database()
        with psycopg.connect(url, autocommit=True) as other:
            other.execute(f"ALTER DATABASE {other.info.dbname} SET timezone = 'Pacific/Chatham'")
        record = RobotRecord("r1", "n", TIME, "h", "{}")
        with Store.open(url) as store:
            store.robots.add(record)
            assert store.robots.get("r1").created_at.isoformat().endswith("+00:00")

    def test_the_server_ends_what_takes_too_long(self, postgresql_url: str) -> None:
        """Unless the URL says otherwise."""
        names = ("lock_timeout", "statement_timeout", "idle_in_transaction_session_timeout")
        for option, found in (
            ("", ["3s", "5s", "8s"]),
            ("&options=-c%20lock_timeout%3D7s", ["7s", "5s", "8s"]),
        ):
            with (
                closing(Database.open(postgresql_url + option)) as database,
                database.reading() as connection,
            ):
                assert [connection.exec_driver_sql(f"SHOW {name}").scalar_one() for name in names] == found
                link = connection.connection.driver_connection.info.get_parameters()
            assert {name: link[name] for name in link if "keepalives" in name or "timeout" in name} == {
                "connect_timeout": "3",
                "keepalives_idle": "10",
                "keepalives_interval": "5",
                "keepalives_count": "3",
                "tcp_user_timeout": "10000",
            }

    def test_a_new_server_ends_long_transactions_and_an_old_one_is_not_asked_to(
        self, postgresql_url: str
    ) -> None:
        """Versions before 17 do not know the setting, and would refuse the connection."""
        with closing(Database.open(postgresql_url)) as database, database.reading() as connection:
            version = connection.connection.driver_connection.info.server_version
            known = connection.exec_driver_sql(
                "SELECT setting FROM pg_settings WHERE name = 'transaction_timeout'"
            ).scalars()
            assert list(known) == (["30000"] if version >= 170_000 else [])

    def test_a_server_that_gives_no_answer_is_given_up_and_left_alone_for_a_while(
        self, postgresql_url: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Frozen as a whole, it keeps no limit of its own: all threads of the service waited for it."""
        monkeypatch.setattr("jointstiff.service.store.postgresql.ANSWER_SECONDS", 0.3)
        url = f"{postgresql_url}&options=-c%20statement_timeout%3D0"
        with closing(Database.open(url)) as database:
            with pytest.raises(StoreUnavailableError, match=r"no answer within 0\.3 s"):
                database.rows(text("SELECT pg_sleep(60)"))
            asked = []
            event.listen(database._reader, "checkout", lambda *_: asked.append(1))
            with pytest.raises(StoreUnavailableError, match="does not answer"):
                database.rows(text("SELECT 1"))
            assert asked == []
            database._away_until = 0.0
            assert database.rows(text("SELECT 1")) == [(1,)]

    def test_who_waits_for_a_lock_in_vain_is_told(self, postgresql_url: str) -> None:
        name = f"locked_{uuid4().hex}"
        with psycopg.connect(postgresql_url) as other, closing(Database.open(postgresql_url)) as database:
            other.execute(f"CREATE TABLE {name} (n int)")
            other.commit()
            other.execute(f"LOCK TABLE {name}")
            with (
                pytest.raises(StoreUnavailableError, match="lock timeout"),
                database.writing(0.1) as connection,
            ):
                connection.exec_driver_sql(f"TABLE {name}")

    def test_a_session_that_is_idle_inside_a_transaction_is_ended(self, postgresql_url: str) -> None:
        url = f"{postgresql_url}&options=-c%20idle_in_transaction_session_timeout%3D100"
        with closing(Database.open(url)) as database:

            def pause_inside() -> None:
                with database.writing() as connection:
                    for _ in range(2):
                        connection.execute(text("SELECT 1"))
                        time.sleep(1.0)

            with pytest.raises(StoreUnavailableError):
                pause_inside()
            assert database.rows(text("SELECT 1")) == [(1,)]


@pytest.mark.parametrize("statement", ["SELECT * FROM no_such_table", "SELEC 1", "SELECT no_such_column"])
def test_a_mistake_of_ours_is_no_outage(database_url: str, statement: str) -> None:
    """Workers would repeat it for ever, and requests be told to come back."""
    with closing(Database.open(database_url)) as database:
        with pytest.raises(DBAPIError):
            database.rows(text(statement))
        assert database.rows(text("SELECT 1")) == [(1,)]


def test_an_unfinished_run_of_a_saved_file_goes_on_where_it_stood(tmp_path, monkeypatch):
    """With what a worker had begun, which is not there any more: its numbers are those of one go."""
    source, saved = tmp_path / "source.db", tmp_path / "saved.db"
    spans = [(0, 100), (100, 200), (200, 300)]
    monkeypatch.setattr(RunWork, "steps", lambda _work: spans)
    with Store.open(f"sqlite:///{source}") as store, closing(Claims(store, f"sqlite:///{source}")) as claims:
        runs = runs_of(store, claims.enqueue)
        run = runs.create(run_request(stored_set(store)), None)
        assert claims.claim("gone").number == 0
        runs.mark_running(run.id)
        store.steps.store_result(run.id, spans[0], pack_arrays(runs.work(run.id).compute(spans[0])))
        with closing(sqlite3.connect(source)) as own, closing(sqlite3.connect(saved)) as other:
            own.backup(other)  # as `sqlite3 FILE '.backup SAVED'` does
        expected = runs_of(store).create(run_request(run.measurement_set_id), None)
        expected = runs_of(store).current(expected.id).result
    with Store.open(f"sqlite:///{saved}") as store, closing(Claims(store, f"sqlite:///{saved}")) as claims:
        runs = runs_of(store, claims.enqueue)
        assert (runs.current(run.id).state, runs.current(run.id).progress.done) == ("running", 100)
        Recovery(store, lambda _: runs, claims, "another").check_and_recover()
        claims.work_all(lambda _: runs, "another")
        assert (runs.current(run.id).state, runs.current(run.id).result) == ("succeeded", expected)


REFUSED = {
    "": "is invalid",
    "jointstiff.db": "is invalid",
    "mysql://user:secret@host/database": "mysql is not a supported database",
    "postgresql+asyncpg://user@host/database": "not a supported database",
    "postgresql://user:secret@host:port/database": "is invalid",
    "sqlite://host/path": "must have only a path",
    "sqlite://user:secret@host/path": "must have only a path",
    "sqlite:///path?mode=ro": "must have only a path",
}


@pytest.mark.parametrize("url", REFUSED)
def test_an_address_that_is_no_database_is_refused_without_its_password(url):
    with pytest.raises(StoreError, match=REFUSED[url]) as caught:
        Store.open(url)
    assert "secret" not in str(caught.value)
    assert "sqlite:///path/to/file.db" in caught.value.remedy
