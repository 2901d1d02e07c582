"""Databases of earlier layouts: upgraded whole or not at all, and read as before."""

import dataclasses
import json
import re
import shlex
import shutil
import sqlite3
import stat
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Any

import psycopg
import pytest
import sqlalchemy as sa
from alembic import command as alembic_commands
from sqlalchemy.exc import OperationalError
from support import kept
from support.api import post
from support.claims import Claims
from support.jobs import RUN
from support.packed import pack_text
from support.processes import Service, until

from jointstiff.schemas.options import Resampling
from jointstiff.service.archive.checking import check_database, list_differences
from jointstiff.service.jobs import Parts
from jointstiff.service.problems import StoreError, StoreUnavailableError
from jointstiff.service.runs.numbers import extract_numbers
from jointstiff.service.store import rewriting, steps, upgrading
from jointstiff.service.store.database import Database, make_migrating_engine
from jointstiff.service.store.layouts import BASELINE, LAYOUT, kind_of, number_of
from jointstiff.service.store.steps import list_steps
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import jobs, metadata, read_layout, robots
from jointstiff.service.workers.worker import Recovery

Restore = Callable[..., str]
FOREVER = 600.0  # s: rewriting ends before
STEPS = number_of(LAYOUT) - number_of(BASELINE)  # from the oldest layout to today's


@pytest.fixture(params=["sqlite", "postgresql"])
def empty(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[], str]:
    """Call it for the URL of an empty database; all of one kind."""
    if request.param == "postgresql":
        return request.getfixturevalue("new_postgresql_database")
    numbers = count()
    return lambda: f"sqlite:///{tmp_path / f'jointstiff_{next(numbers)}.db'}"


@pytest.fixture
def restored(empty: Callable[[], str]) -> Restore:
    """Call it for the URL of a kept database, of layout 0018 by default."""

    def restore(number: str = "0018") -> str:
        url = empty()
        kept.restore(number, url)
        return url

    return restore


@pytest.fixture
def old_file(tmp_path: Path) -> Path:
    """An SQLite file of layout 0018."""
    path = tmp_path / "jointstiff.db"
    kept.restore("0018", f"sqlite:///{path}")
    return path


def layout_of(url: str) -> str | None:
    with closing(Database.open(url)) as database, database.reading() as connection:
        return read_layout(connection)


def upgraded(url: str) -> Store:
    """Open a store, upgrade it, and rewrite all documents."""
    store = Store.open(url, upgrade=lambda _: None)
    store.old_documents.rewrite(FOREVER)
    return store


def rows_of(store: Store, query: str) -> list[Any]:
    return [tuple(row) for row in store._database.rows(sa.text(query))]


class TestKept:
    @pytest.mark.parametrize("number", kept.kept_numbers())
    def test_every_kept_database_answers_as_before(self, restored: Restore, number: str) -> None:
        """Before and after its documents are rewritten."""
        url = restored(number)
        before = json.loads(kept.read_kept(number, "answers.json"))
        with Store.open(url, upgrade=lambda _: None) as store:
            for rewritten in (False, True):
                if rewritten:
                    store.old_documents.rewrite(FOREVER)
                with kept.client_of(store) as client:
                    now = kept.ask_again(client, before, number)
                assert list(kept.list_changes(before, now)) == []

    @pytest.mark.parametrize("number", kept.kept_numbers())
    def test_a_rewritten_job_states_the_version_of_its_document(self, restored: Restore, number: str) -> None:
        with Store.open(restored(number), upgrade=lambda _: None) as store:
            before = dict(
                rows_of(store, "SELECT id, schema FROM jobs WHERE schema < 24 AND state = 'succeeded'")
            )
            store.old_documents.rewrite(FOREVER)
            jobs_of_all_kinds = Parts(store)
            for identifier, version in before.items():
                job = json.loads(jobs_of_all_kinds.job(identifier, hidden=True))
                assert job["provenance"]["versions"]["document"] == str(version)
            assert len(before) > 10

    @pytest.mark.parametrize("number", kept.kept_numbers())
    def test_the_same_request_is_posted_again(self, restored: Restore, number: str) -> None:
        with upgraded(restored(number)) as store, kept.client_of(store) as client:
            runs = client.get("/v1/jobs?kind=run&state=succeeded&limit=100").json()["items"]
            first = client.get(f"/v1/jobs/{runs[-1]['id']}").json()
            body = {"measurement_set_id": first["request"]["measurement_set_id"]} | kept.POSTED_AGAIN
            assert post(client, "/v1/runs?wait=60", body)["state"] == "succeeded"
            again = post(client, "/v1/runs?wait=60", body, **{"Idempotency-Key": "kept"})
            assert again["id"] == first["id"], "idempotency keys outlast an upgrade"
            assert [key.name for key in store.keys.all() if key.revoked_at is None] == ["tablet hall 3"]

    def test_each_earlier_layout_is_kept(self) -> None:
        """Before a new layout: `python -m support.kept FOLDER POSTGRESQL_URL`, with the program as it is."""
        assert kept.kept_numbers() == [f"{number:04}" for number in range(18, number_of(LAYOUT))]
        for path in kept.FOLDER.iterdir():
            assert path.stat().st_size <= 150_000, path


class TestTables:
    def test_an_upgraded_database_has_the_tables_of_a_new_one(
        self, restored: Restore, empty: Callable[[], str]
    ) -> None:
        """A change of the tables without a file in `store/migrations/versions/` fails here."""
        url, new = restored(), empty()
        Store.open(new).close()
        Store.open(url, upgrade=lambda _: None).close()
        assert shape_of(url) == shape_of(new)
        with closing(Database.open(url)) as database, database.reading() as connection:
            assert list_differences(connection) == []

    def test_a_table_that_changes_without_a_step_is_noticed(self, database_url: str) -> None:
        changed = sa.MetaData()
        for table in metadata.sorted_tables:
            table.to_metadata(changed)
        changed.tables["jobs"].append_column(sa.Column("weather", sa.String))
        Store.open(database_url).close()
        with closing(Database.open(database_url)) as database, database.reading() as connection:
            assert list_differences(connection) == []
            assert "weather" in str(list_differences(connection, changed))

    def test_steps_are_numbered_and_name_their_kind(self) -> None:
        layouts = [step.layout for step in list_steps()]
        assert [number_of(layout) for layout in layouts] == list(range(18, 18 + len(layouts)))
        assert (layouts[0], layouts[-1]) == (BASELINE, LAYOUT)
        assert all(kind_of(layout) for layout in layouts[1:])
        assert max(map(len, layouts)) <= 32, "the column of the layout has 32 characters"


def shape_of(url: str) -> dict[str, Any]:
    """Columns, indexes and, on SQLite, assumed statistics of our tables, in any order."""
    with closing(Database.open(url)) as database, database.reading() as connection:
        inspector = sa.inspect(connection)
        shape: dict[str, Any] = {}
        for table in metadata.tables:
            columns = [each | {"type": str(each["type"])} for each in inspector.get_columns(table)]
            shape[table] = sorted(columns, key=lambda column: column["name"])
        if database.dialect == "sqlite":
            indexes = "SELECT name, sql FROM sqlite_schema WHERE type = 'index' AND name LIKE 'ix_%'"
            statistics = "SELECT idx, stat FROM sqlite_stat1 WHERE idx LIKE 'ix_%'"
        else:
            ours = f"schemaname = current_schema() AND tablename IN {tuple(metadata.tables)}"
            indexes = "SELECT indexname, replace(indexdef, current_schema() || '.', '') FROM pg_indexes"
            indexes += f" WHERE {ours}"
            statistics = "SELECT 1"
        for name, query in (("indexes", indexes), ("statistics", statistics)):
            rows = [tuple(map(str, row)) for row in connection.execute(sa.text(query))]
            # A dump writes the same condition with other casts.
            shape[name] = sorted((*names, re.sub(r"::[a-z ]+(\[\])?|[()]", "", sql)) for *names, sql in rows)
        return shape


class TestCopy:
    def test_a_file_is_copied_first_for_its_owner_alone(self, old_file: Path) -> None:
        before = content_of(old_file)
        Store.open(f"sqlite:///{old_file}", upgrade=lambda _: None).close()
        copy = old_file.with_name("jointstiff.db.before-0019")
        assert stat.S_IMODE(copy.stat().st_mode) == 0o600
        assert content_of(copy) == before
        assert not list(old_file.parent.glob("*.part*"))

    def test_an_earlier_copy_is_kept(self, old_file: Path) -> None:
        copy = old_file.with_name("jointstiff.db.before-0019")
        copy.write_text("the only copy of something")
        Store.open(f"sqlite:///{old_file}", upgrade=lambda _: None).close()
        assert copy.read_text() == "the only copy of something"
        assert old_file.with_name("jointstiff.db.before-0019-2").exists()

    def test_what_a_killed_copy_left_does_no_harm(self, old_file: Path) -> None:
        part = old_file.with_name("jointstiff.db.before-0019.part")
        part.write_bytes(old_file.read_bytes()[:5_000])
        before = content_of(old_file)
        Store.open(f"sqlite:///{old_file}", upgrade=lambda _: None).close()
        assert content_of(old_file.with_name("jointstiff.db.before-0019")) == before
        assert not part.exists()

    def test_a_copy_whose_process_was_killed_after_its_step_gets_its_name_at_the_next_start(
        self, old_file: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        url, before = f"sqlite:///{old_file}", content_of(old_file)

        def be_killed(_: Path) -> Path:
            raise KeyboardInterrupt

        with monkeypatch.context() as killing:
            killing.setattr(upgrading, "name_copy", be_killed)
            for _ in range(STEPS):
                with pytest.raises(KeyboardInterrupt):
                    Store.open(url, upgrade=lambda _: None)
        Store.open(url, upgrade=lambda _: None).close()
        copies = sorted(path.name for path in old_file.parent.glob("*before*"))
        assert copies == [f"jointstiff.db.before-{number:04}" for number in range(19, number_of(LAYOUT) + 1)]
        assert content_of(old_file.with_name(copies[0])) == before

    def test_a_copy_that_was_not_written_to_its_end_gets_no_name(self, old_file: Path) -> None:
        url = f"sqlite:///{old_file}"
        upgrading.upgrade_tables(url, lambda _: None, copied=False)
        parts = [old_file.with_name(f"jointstiff.db.before-{number}.part") for number in ("0019", "0020")]
        for part in parts:
            part.write_bytes(b"half" if part is parts[0] else b"")
        Path(f"{parts[0]}-journal").write_bytes(b"journal")
        Store.open(url, upgrade=lambda _: None).close()
        assert not list(old_file.parent.glob("*before*"))

    def test_a_relative_path_that_looks_like_a_uri_is_copied(
        self, old_file: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(old_file.parent)
        old_file.rename("file:old.db")
        before = content_of(Path("file:old.db").absolute())
        Store.open("sqlite:///file:old.db", upgrade=lambda _: None).close()
        assert content_of(Path("file:old.db.before-0019").absolute()) == before

    def test_a_copy_of_another_size_is_refused(self, old_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        elsewhere = old_file.with_name("elsewhere")
        elsewhere.mkdir()
        monkeypatch.setattr(upgrading, "sqlite_path_of", lambda _: elsewhere / old_file.name)
        with pytest.raises(StoreError, match=r"the copy has \d+ bytes, but the database has \d+"):
            Store.open(f"sqlite:///{old_file}", upgrade=lambda _: None)
        assert layout_of(f"sqlite:///{old_file}") == BASELINE
        assert not list(elsewhere.glob("*before*"))

    def test_a_step_that_fails_leaves_no_copy(self, old_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        url = f"sqlite:///{old_file}"

        def fail(*_: object) -> None:
            assert len(list(old_file.parent.glob("*before*"))) == 1
            raise KeyboardInterrupt

        with monkeypatch.context() as failing:
            failing.setattr(alembic_commands, "upgrade", fail)
            for _ in range(3):
                with pytest.raises(KeyboardInterrupt):
                    Store.open(url, upgrade=lambda _: None)
                assert not list(old_file.parent.glob("*before*"))
        Store.open(url, upgrade=lambda _: None).close()
        assert [path.name for path in old_file.parent.glob("*before*")] == ["jointstiff.db.before-0019"]

    def test_a_copy_that_cannot_be_renamed_is_named_as_it_is(
        self, old_file: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The upgrade is done: the start goes on."""
        before, said = content_of(old_file), list[str]()

        def refuse(*_: object) -> None:
            raise PermissionError("no new names")

        monkeypatch.setattr(Path, "rename", refuse)
        Store.open(f"sqlite:///{old_file}", upgrade=said.append).close()
        part = old_file.with_name("jointstiff.db.before-0019.part")
        assert said[0].endswith(str(part))
        assert content_of(part) == before

    def test_a_copy_that_cannot_be_made_is_refused_in_words(self, old_file: Path) -> None:
        old_file.with_name("jointstiff.db.before-0019.part").mkdir()
        with pytest.raises(StoreError, match="before the upgrade cannot be written"):
            Store.open(f"sqlite:///{old_file}", upgrade=lambda _: None)
        assert layout_of(f"sqlite:///{old_file}") == BASELINE

    def test_a_folder_that_cannot_be_synchronised_is_upgraded(
        self, old_file: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def refuse(_: int) -> None:
            raise OSError("not supported")

        monkeypatch.setattr("os.fsync", refuse)
        Store.open(f"sqlite:///{old_file}", upgrade=lambda _: None).close()
        assert old_file.with_name("jointstiff.db.before-0019").exists()

    def test_the_remedy_quotes_the_path(self, old_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(upgrading, "SPARE_BYTES", shutil.disk_usage(old_file.parent).total)
        spaced = old_file.rename(old_file.with_name("hall 3's.db"))
        with pytest.raises(StoreError) as caught:
            Store.open(f"sqlite:///{spaced}", upgrade=lambda _: None)
        command = caught.value.remedy.split("`")[1]
        assert shlex.split(command)[-1] == f"sqlite:///{spaced}"

    def test_without_room_for_the_copy_nothing_is_changed_and_the_remedy_works(
        self, old_file: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(upgrading, "SPARE_BYTES", shutil.disk_usage(old_file.parent).total)
        before = content_of(old_file)
        with pytest.raises(StoreError, match=r"the disk has [\d.]+ MB free") as caught:
            Store.open(f"sqlite:///{old_file}", upgrade=lambda _: None)
        assert content_of(old_file) == before
        assert f"jointstiff database upgrade --no-copy --database sqlite:///{old_file}" in caught.value.remedy
        upgrading.upgrade_tables(f"sqlite:///{old_file}", lambda _: None, copied=False)
        assert layout_of(f"sqlite:///{old_file}") == LAYOUT

    @pytest.mark.process
    def test_a_disk_that_fills_up_during_the_copy_changes_nothing(self, old_file: Path) -> None:
        """A limit of the size of files stands for the disk."""
        before = content_of(old_file)
        program = (
            "import resource, sys; from jointstiff.service.store.store import Store;"
            "resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000));"
            "Store.open(sys.argv[1], upgrade=print)"
        )
        command = [sys.executable, "-c", program, f"sqlite:///{old_file}"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert "cannot be written" in done.stderr
        assert "nothing was changed" in done.stderr
        assert content_of(old_file) == before
        assert [path.name for path in old_file.parent.glob("*before*")] == []


def content_of(path: Path) -> list[str]:
    with closing(sqlite3.connect(path)) as connection:
        return list(connection.iterdump())


class TestStarts:
    def test_without_an_upgrade_a_database_of_an_earlier_layout_is_refused(self, restored: Restore) -> None:
        url = restored()
        with pytest.raises(StoreError, match=BASELINE) as caught:
            Store.open(url)
        assert "jointstiff database upgrade --database URL" in caught.value.remedy
        assert layout_of(url) == BASELINE

    def test_of_many_that_start_together_one_upgrades(self, restored: Restore, tmp_path: Path) -> None:
        url, said, barrier = restored(), list[str](), threading.Barrier(6)

        def start(_: int) -> None:
            barrier.wait(60)
            Store.open(url, upgrade=said.append).close()

        with ThreadPoolExecutor(6) as pool:
            list(pool.map(start, range(6)))
        assert layout_of(url) == LAYOUT
        assert len(said) == STEPS, "each step once"
        assert len(list(tmp_path.glob("*before-0019*"))) == url.startswith("sqlite")

    def test_a_step_waits_for_other_programs_and_gives_up_in_words(
        self, restored: Restore, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        url = restored()
        assert layout_of(url) == BASELINE, "opened once: an SQLite file has its write-ahead log"
        monkeypatch.setattr(upgrading, "LOCK_SECONDS", 0.1)
        monkeypatch.setattr("jointstiff.service.store.database.BUSY_SECONDS", 0.2)
        if url.startswith("sqlite"):
            other: Any = sqlite3.connect(url.removeprefix("sqlite:///"), isolation_level=None)
            other.execute("BEGIN IMMEDIATE")
        else:
            other = psycopg.connect(url)
            other.execute("SELECT count(*) FROM jobs")
        with pytest.raises(StoreUnavailableError, match="other programs have locked the tables"):
            Store.open(url, upgrade=lambda _: None)
        assert layout_of(url) == BASELINE
        other.close()
        Store.open(url, upgrade=lambda _: None).close()
        assert layout_of(url) == LAYOUT

    def test_a_step_that_ends_by_a_deadlock_is_tried_again(
        self, restored: Restore, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        url, carry_out, tries = restored(), alembic_commands.upgrade, list[str]()

        def end_first_by_deadlock(config: Any, layout: str) -> None:
            tries.append(layout)
            if len(tries) == 1:
                raise OperationalError("ALTER TABLE jobs", {}, psycopg.errors.DeadlockDetected("deadlock"))
            carry_out(config, layout)

        monkeypatch.setattr(alembic_commands, "upgrade", end_first_by_deadlock)
        Store.open(url, upgrade=lambda _: None).close()
        assert (layout_of(url), len(tries)) == (LAYOUT, STEPS + 1)

    def test_a_postgresql_server_ends_a_step_of_a_program_that_is_stopped(self, postgresql_url: str) -> None:
        engine = make_migrating_engine(postgresql_url)
        names = ("idle_in_transaction_session_timeout", "tcp_keepalives_idle", "tcp_keepalives_interval")
        setting = sa.text("SELECT reset_val FROM pg_settings WHERE name = :name")
        with closing(engine.connect()) as connection:
            values = [connection.execute(setting, {"name": name}).scalar_one() for name in names]
        engine.dispose()
        assert values == ["15000", "5", "2"]


@pytest.fixture
def contracting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A program of a later version: its last step removes a column."""
    name = f"{number_of(LAYOUT) + 1:04}_contract_trend"
    folder = tmp_path / "migrations"
    shutil.copytree(steps.FOLDER, folder)
    (folder / "versions" / "later.py").write_text(
        f"from alembic import op\nrevision, down_revision = '{name}', '{LAYOUT}'\n"
        "def upgrade():\n"
        "    with op.batch_alter_table('idempotency_keys') as table:\n"
        "        table.drop_column('created_at')\n"
    )
    monkeypatch.setattr(steps, "FOLDER", folder)
    monkeypatch.setattr("jointstiff.service.store.layouts.LAYOUT", name)
    list_steps.cache_clear()
    yield
    list_steps.cache_clear()


@pytest.mark.usefixtures("contracting")
class TestContract:
    def test_a_start_carries_out_no_step_that_removes_something(self, restored: Restore) -> None:
        url = restored()
        with pytest.raises(StoreError, match="removes data that older programs need") as caught:
            Store.open(url, upgrade=lambda _: None)
        assert "jointstiff database upgrade --database URL" in caught.value.remedy
        assert layout_of(url) == BASELINE

    def test_documents_are_rewritten_before_a_step_that_removes_something(self, restored: Restore) -> None:
        url = restored()
        with pytest.raises(StoreError, match=r"cannot be rewritten \(1\): run \w+ has not ended"):
            upgrading.upgrade_tables(url, lambda _: None)
        assert layout_of(url) == LAYOUT
        with closing(Database.open(url)) as database:
            database.change(sa.text("DELETE FROM jobs WHERE state = 'queued'"))
        upgrading.upgrade_tables(url, lambda _: None)
        with closing(Database.open(url)) as database:
            assert "created_at" not in {
                column["name"] for column in sa.inspect(database._reader).get_columns("idempotency_keys")
            }
            assert len(database.rows(sa.text("SELECT * FROM idempotency_keys"))) == 2, "one row is lost"

    def test_a_damaged_document_that_stops_the_step_is_named_and_no_more_once_it_is_deleted(
        self, restored: Restore
    ) -> None:
        url = restored()
        with closing(Database.open(url)) as database:
            database.change(sa.text("DELETE FROM jobs WHERE state = 'queued'"))
            ended = "SELECT id, kind FROM jobs WHERE deleted_at IS NULL ORDER BY sequence LIMIT 1"
            ((damaged, kind),) = database.rows(sa.text(ended))
            damage = sa.text("UPDATE jobs SET document = :document WHERE id = :id")
            database.change(damage.bindparams(document=b"nothing", id=damaged))
        with pytest.raises(StoreError, match=rf"rewritten \(1\): {kind} {damaged} is damaged") as caught:
            upgrading.upgrade_tables(url, lambda _: None)
        assert "DELETE /v1/jobs/ID" in caught.value.remedy
        with closing(Database.open(url)) as database:  # as the version before deletes it
            delete = sa.update(jobs).where(jobs.c.id == damaged).values(deleted_at=datetime.now(UTC))
            database.change(delete)
        upgrading.upgrade_tables(url, lambda _: None)
        assert layout_of(url) != LAYOUT


class TestDocuments:
    def test_portions_lead_to_the_same_as_one_pass(
        self, restored: Restore, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(rewriting, "MOST_ROWS", 2)
        with Store.open(restored(), upgrade=lambda _: None) as store:
            left = store.old_documents.count()
            assert left > 30
            assert (store.old_documents.rewrite(FOREVER), store.old_documents.count()) == (left, 0)

    def test_rewriting_in_no_time_comes_to_an_end(
        self, restored: Restore, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Each call rewrites a portion, also behind damaged documents: 0 means that the rest cannot be."""
        monkeypatch.setattr(rewriting, "MOST_ROWS", 2)
        with Store.open(restored(), upgrade=lambda _: None) as store:
            damage = sa.text("UPDATE jobs SET document = :document WHERE sequence < 5")
            store._database.change(damage.bindparams(document=b"nothing"))
            while store.old_documents.rewrite(-1.0):
                pass
            assert store.old_documents.count() == 4

    def test_an_unfinished_job_has_an_old_form_until_it_ends(self, restored: Restore) -> None:
        with upgraded(restored()) as store:
            ((queued,),) = rows_of(store, "SELECT id FROM jobs WHERE schema < 24")
            runs = Parts(store).jobs["run"]
            assert runs.current(queued).state == "queued"
            name = runs.current(queued).key_name
            assert name is not None
            runs.cancel(queued)
            key_name = sa.select(jobs.c.key_name).where(jobs.c.id == queued)
            assert store._database.rows(key_name) == [(name,)]
            assert rows_of(store, "SELECT id FROM jobs WHERE schema < 24") == []
            assert runs.current(queued).state == "cancelled"

    def test_a_job_that_an_older_program_ends_is_rewritten(self, restored: Restore) -> None:
        """The job of a new program, on the same database: the older one knows no version and no numbers."""
        with upgraded(restored()) as store:
            ((ended,),) = rows_of(store, "SELECT id FROM jobs WHERE key_name IS NOT NULL AND schema = 24")
            before = store.jobs(RUN).get(ended)
            parts = Parts(store, lambda *_: None)
            request = parts.jobs["run"].current(ended).request
            long = request.model_copy(update={"resampling": Resampling(size=4, repetitions=300, seed=4)})
            new = parts.jobs["run"].create(long, None)
            assert new.state == "queued"
            packed = {"document": pack_text(before.document), "trend": pack_text(str(before.trend))}
            end = sa.text(
                "UPDATE jobs SET state = 'succeeded', document = :document, trend = :trend WHERE id = :id"
            )
            store._database.change(end.bindparams(id=new.id, **packed))
            assert store.jobs(RUN).get(new.id).numbers is None
            assert store.old_documents.rewrite(FOREVER) == 1
            after = store.jobs(RUN).get(new.id)
            assert (after.numbers, after.document) == (before.numbers, before.document)

    def test_a_damaged_document_stops_no_other(
        self, restored: Restore, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(rewriting, "MOST_ROWS", 3)
        url = restored()
        with Store.open(url, upgrade=lambda _: None) as store:
            damage = sa.text("UPDATE jobs SET document = :document WHERE sequence < 5")
            for document in (b"nothing", pack_text("no JSON"), pack_text("{}")):
                store._database.change(damage.bindparams(document=document))
                store.old_documents.rewrite(FOREVER)
                assert store.old_documents.count() == 4
            store._database.change(damage.bindparams(document=b"nothing"))
            assert len(check_database(url).faults) == 4

    def test_a_document_that_changes_meanwhile_is_not_overwritten(
        self, restored: Restore, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with Store.open(restored(), upgrade=lambda _: None) as store:
            newer = sa.update(robots).where(robots.c.sequence == 1)
            newer = newer.values(document='{"newer": true}', schema=18)
            step = next(each for each in list_steps() if each.tables)

            def change_and_rewrite(row: Any) -> dict[str, Any]:
                if "trend" not in row and row["sequence"] == 1:
                    store._database.change(newer)
                return step.rewrite(row)

            changing = dataclasses.replace(step, rewrite=change_and_rewrite)
            monkeypatch.setattr(steps, "list_steps", lambda: [changing])
            store.old_documents.rewrite(FOREVER)
            first = sa.select(robots.c.document).order_by(robots.c.sequence).limit(1)
            assert [row.document for row in store._database.rows(first)] == ['{"newer": true}']

    def test_rewritten_numbers_are_those_of_today(self, restored: Restore) -> None:
        """The step has its own code for them, which never changes, as it reads old documents."""
        with upgraded(restored()) as store:
            parts = Parts(store)
            ((unfinished,),) = rows_of(store, "SELECT id FROM jobs WHERE schema < 24")
            parts.jobs["run"].cancel(unfinished)
            rows = store._database.rows(sa.select(jobs.c.id, jobs.c.kind, jobs.c.numbers, jobs.c.key_name))
            for identifier, kind, numbers, key_name in rows:
                job = parts.jobs[kind].kind.message.model_validate_json(
                    store.jobs(parts.jobs[kind].kind.resource).get(identifier, include_deleted=True).document
                )
                assert numbers == (extract_numbers(job) if kind == "run" else None)
                assert key_name == job.key_name
            assert sum(row.numbers is not None for row in rows) > 5
            assert {row.key_name for row in rows} == {None, "tablet hall 3"}

    def test_a_run_states_the_version_that_recorded_it(self, restored: Restore) -> None:
        """Before and after its document is rewritten: to repeat the run computes with today's methods."""
        with Store.open(restored(), upgrade=lambda _: None) as store, kept.client_of(store) as client:
            runs = client.get("/v1/jobs?kind=run&state=succeeded").json()["items"]
            for _ in range(2):
                for run in runs:
                    versions = client.get(f"/v1/jobs/{run['id']}").json()["provenance"]["versions"]
                    assert versions["document"] == "18"
                store.old_documents.rewrite(FOREVER)

    def test_the_leading_worker_rewrites_documents(self, restored: Restore) -> None:
        """And goes on to end what waits: a run without a part in the queue."""
        url = restored()
        with Store.open(url, upgrade=lambda _: None) as store, closing(Claims(store, url)) as claims:
            store.heartbeats.beat("a leader")
            Recovery(store, Parts(store).jobs_of, claims, "not the leader").check_and_recover()
            assert store.old_documents.count() > 30
            Recovery(store, Parts(store).jobs_of, claims, "a faster leader").check_and_recover()
            assert store.old_documents.count() == 0

    def test_old_rows_are_found_by_their_index(self, old_file: Path) -> None:
        with Store.open(f"sqlite:///{old_file}", upgrade=lambda _: None) as store:
            query = "EXPLAIN QUERY PLAN SELECT sequence FROM jobs WHERE schema < 24 AND sequence > 5"
            assert "ix_jobs_old" in str(rows_of(store, f"{query} ORDER BY sequence LIMIT 200"))


KILLED = """
import os, random, signal, sys, time
from contextlib import closing
from jointstiff.service.store import rewriting, upgrading
from jointstiff.service.store.database import Database
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import read_layout

url, kills, seed, longest = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
rewriting.MOST_ROWS, draw, layouts = 1, random.Random(seed), []
for _ in range(kills):
    child = os.fork()
    if not child:
        with Store.open(url, upgrade=lambda _: None) as store:
            store.old_documents.rewrite(600.0)
        os._exit(0)
    time.sleep(draw.uniform(0.0, longest))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    with closing(Database.open(url)) as database, database.reading() as connection:
        layouts.append(read_layout(connection)[:4])
print(*layouts)
"""


@pytest.mark.process
@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 8))])
def test_an_upgrade_that_is_killed_at_any_moment_goes_on(
    restored: Restore, tmp_path: Path, seed: int
) -> None:
    url = restored()
    longest = [0.05, 0.1, 0.2][seed % 3]
    command = [sys.executable, "-W", "error", "-c", KILLED, url, "12", str(seed), str(longest)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    layouts = done.stdout.split()
    assert len(layouts) == 12
    assert layouts == sorted(layouts)
    assert set(layouts) <= {"0018", "0019", "0020", "0021", "0022", "0023", "0024"}
    before = json.loads(kept.read_kept("0018", "answers.json"))
    assert len(list(tmp_path.glob("*before*"))) <= STEPS + 1, "a copy for each step at most, and a journal"
    with upgraded(url) as store:
        copies = {path.suffix for path in tmp_path.glob("*before*")}
        assert (".before-0019" in copies) == url.startswith("sqlite"), (
            "the file before the first step is kept"
        )
        of_steps = {f".before-{number:04}" for number in range(19, number_of(LAYOUT) + 1)}
        assert copies <= of_steps, "one copy for a step after many kills"
        assert check_database(url).faults == []
        with kept.client_of(store) as client:
            now = kept.ask_again(client, before, "0018")
    assert list(kept.list_changes(before, now)) == []


@pytest.mark.process
def test_services_and_workers_upgrade_unless_they_are_not_to(old_file: Path) -> None:
    url = f"sqlite:///{old_file}"
    for command in (["serve", "--port", "0"], ["worker"]):
        words = [sys.executable, "-m", "jointstiff", *command, "--no-upgrade", "--database", url]
        refused = subprocess.run(words, capture_output=True, text=True, check=False)
        assert refused.returncode == 2
        assert "jointstiff database upgrade --database URL" in refused.stderr
    assert layout_of(url) == BASELINE
    service = Service(url)
    try:
        assert f"upgraded the database from layout {BASELINE} to " in service.log()
        assert f" to {LAYOUT}" in service.log()
        with Store.open(url) as store:
            until(lambda: store.old_documents.count() == 0)  # by its worker
    finally:
        service.stop()
