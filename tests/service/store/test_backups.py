"""Backups on both databases: whole under write load, checked on the way back, never over what is in use."""

import dataclasses
import itertools
import json
import sqlite3
import subprocess
import threading
from contextlib import closing
from datetime import UTC, datetime

import pytest
from support.jobs import request, runs_of, stored_set
from support.processes import until

from jointstiff.service.kinds.work import pack
from jointstiff.service.problems import StoreError
from jointstiff.service.server import _shown
from jointstiff.service.store import backups
from jointstiff.service.store.backups import Manifest, back_up, content_of, restore
from jointstiff.service.store.database import Database
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import LAYOUT, RobotRecord
from jointstiff.service.workers.doctor import examine
from jointstiff.service.workers.worker import Recovery, carry_out_next

ROBOT = RobotRecord("r", "robot", datetime(2026, 11, 20, tzinfo=UTC), "hash", '{"a": "µ"}')


@pytest.fixture(params=["sqlite", "postgresql"])
def new_database(request, tmp_path):
    """Makes a fresh database and returns its URL."""
    if request.param == "postgresql":
        return request.getfixturevalue("new_postgresql_database")
    numbers = itertools.count(1)
    return lambda: f"sqlite:///{tmp_path / f'{next(numbers)}.db'}"


def robots_of(url):
    with Store.open(url) as store:
        return {record.id for record in _all(store)}


def _all(store):
    cursor = None
    while True:
        page = store.robots.page(limit=100, cursor=cursor)
        yield from page.records
        cursor = page.next
        if cursor is None:
            return


@pytest.mark.process
def test_a_backup_under_write_load_comes_back_with_every_hash_and_result(new_database, tmp_path):
    source, target = new_database(), new_database()
    stop, stored = threading.Event(), []

    def write(store):
        for number in itertools.count():
            if stop.is_set():
                return
            stored.append(store.robots.add(dataclasses.replace(ROBOT, id=f"r{number}")).id)

    with Store.open(source) as store:
        runs = runs_of(store)
        runs.create(request(stored_set(store)), None)
        robots_of_runs = {record.id for record in _all(store)}
        writer = threading.Thread(target=write, args=(store,))
        writer.start()
        try:
            until(lambda: len(stored) > 20)
            before = set(stored)
            manifest = back_up(source, tmp_path / "backup")
        finally:
            stop.set()
            writer.join()
        run = next(iter(runs.records.page(limit=1).records))
        document = runs.document(run.id)
    assert manifest.tables["jobs"].rows == 1
    assert sorted(path.name for path in (tmp_path / "backup").iterdir())[-1] == "manifest.json"

    assert restore(target, tmp_path / "backup") == manifest
    found = robots_of(target)
    assert before <= found <= {*stored, *robots_of_runs}
    assert len(found) == manifest.tables["robots"].rows
    with Store.open(target) as store:
        assert runs_of(store).document(run.id) == document


@pytest.mark.process
def test_an_unfinished_run_of_a_backup_goes_on_where_it_stood(new_database, tmp_path):
    """With what a worker had begun, which is not there any more: its numbers are those of one go."""
    source, target = new_database(), new_database()
    with Store.open(source) as store:
        runs = runs_of(store, store.steps.announce)
        run = runs.create(request(stored_set(store)), None)
        spans, work = [(0, 100), (100, 200), (200, 300)], runs.work(run.id)
        runs.start(run.id)
        store.steps.share_out(run.id, spans)
        store.heartbeats.beat("gone")
        store.steps.keep(run.id, 0, pack(work.compute(spans[0])))
        assert store.steps.take("gone").start == 100
        back_up(source, tmp_path / "backup")
        expected = runs_of(store).create(request(run.measurement_set_id), None)
        expected = runs_of(store).current(expected.id).result
    restore(target, tmp_path / "backup")
    assert examine(target).faults == []
    with Store.open(target) as store:
        store.heartbeats.forget("gone")  # as after half a minute
        runs = runs_of(store, store.steps.announce)
        assert (runs.current(run.id).state, runs.current(run.id).progress.done) == ("running", 100)
        Recovery(store, lambda _: runs, "another").look()
        while carry_out_next(store, lambda _: runs, "another"):
            pass
        assert (runs.current(run.id).state, runs.current(run.id).result) == ("succeeded", expected)


@pytest.mark.process
def test_what_holds_something_is_replaced_only_when_asked(new_database, tmp_path):
    url = new_database()
    with Store.open(url) as store:
        store.robots.add(ROBOT)
    back_up(url, tmp_path / "backup")
    with Store.open(url) as store:
        store.robots.add(dataclasses.replace(ROBOT, id="later"))
    with pytest.raises(StoreError, match=r"exists|is not empty"):
        restore(url, tmp_path / "backup")
    assert robots_of(url) == {"r", "later"}
    restore(url, tmp_path / "backup", overwrite=True)
    assert robots_of(url) == {"r"}


@pytest.mark.process
def test_what_is_in_use_is_not_replaced(new_database, tmp_path):
    url = new_database()
    with Store.open(url) as store:
        store.robots.add(ROBOT)
        back_up(url, tmp_path / "backup")
        with pytest.raises(StoreError, match="in use") as caught:
            restore(url, tmp_path / "backup", overwrite=True)
        assert caught.value.remedy == "stop the service and its workers first"
        assert store.robots.get("r") == ROBOT


class TestOnSqlite:
    @pytest.fixture
    def url(self, tmp_path):
        url = f"sqlite:///{tmp_path / 'of.db'}"
        with Store.open(url) as store:
            store.robots.add(ROBOT)
        return url

    def test_a_file_that_is_replaced_is_set_aside_even_if_damaged(self, url, tmp_path):
        back_up(url, tmp_path / "backup")
        (tmp_path / "of.db").write_bytes(b"no database" * 1000)
        restore(url, tmp_path / "backup", overwrite=True)
        assert robots_of(url) == {"r"}
        (aside,) = tmp_path.glob("of.db.replaced-*")
        assert aside.read_bytes().startswith(b"no database")

    def test_a_backup_that_changed_is_refused(self, url, tmp_path):
        back_up(url, tmp_path / "backup")
        with closing(sqlite3.connect(tmp_path / "backup" / "jointstiff.db")) as copy, copy:
            copy.execute("UPDATE robots SET name = 'another'")
        with pytest.raises(StoreError, match="has changed"):
            restore(f"sqlite:///{tmp_path / 'new.db'}", tmp_path / "backup")
        assert not (tmp_path / "new.db").exists()

    def test_rows_that_do_not_arrive_are_noticed(self, url, tmp_path):
        back_up(url, tmp_path / "backup")
        path = tmp_path / "backup" / "manifest.json"
        manifest = json.loads(path.read_text())
        manifest["tables"]["robots"]["rows"] = 2
        path.write_text(json.dumps(manifest))
        with pytest.raises(StoreError, match="restored table robots differs"):
            restore(f"sqlite:///{tmp_path / 'new.db'}", tmp_path / "backup")
        assert sorted(path.name for path in tmp_path.iterdir()) == ["backup", "of.db"]

    @pytest.mark.parametrize(
        ("database", "reason"),
        [
            ("sqlite:///{0}/none.db", "there is no database"),
            ("sqlite://", "in memory"),
            ("sqlite:///{0}/empty.db", "no Jointstiff tables"),
        ],
    )
    def test_nothing_to_copy(self, tmp_path, database, reason):
        (tmp_path / "empty.db").touch()
        with pytest.raises(StoreError, match=reason):
            back_up(database.format(tmp_path), tmp_path / "backup")
        assert not (tmp_path / "backup").exists()
        assert not (tmp_path / "none.db").exists()

    def test_folders_that_are_no_place_or_no_backup(self, url, tmp_path):
        with pytest.raises(StoreError, match="exists"):
            back_up(url, tmp_path)
        with pytest.raises(StoreError, match="no readable manifest"):
            restore(url, tmp_path)
        back_up(url, tmp_path / "backup")
        with pytest.raises(StoreError, match="backup of a sqlite"):
            restore("postgresql://nobody@/nothing", tmp_path / "backup")

    def test_nobody_else_reads_a_backup(self, url, tmp_path):
        back_up(url, tmp_path / "backup")
        assert (tmp_path / "backup").stat().st_mode & 0o077 == 0

    def test_another_layout_is_neither_copied_nor_restored(self, url, tmp_path):
        back_up(url, tmp_path / "backup")
        manifest = tmp_path / "backup" / "manifest.json"
        manifest.write_text(manifest.read_text().replace(LAYOUT, "0000_earlier"))
        with pytest.raises(StoreError, match="0000_earlier"):
            restore(f"sqlite:///{tmp_path / 'other.db'}", tmp_path / "backup")
        with closing(Database.open(url)) as database, database.writing() as connection:
            connection.exec_driver_sql("UPDATE alembic_version SET version_num = '0000_earlier'")
            connection.exec_driver_sql("DROP TABLE jobs")
        before = set(tmp_path.iterdir())
        with pytest.raises(StoreError, match="0000_earlier") as caught:
            back_up(url, tmp_path / "second")
        assert "the version that wrote it" in caught.value.remedy
        assert set(tmp_path.iterdir()) == before

    def test_content_is_of_values_not_of_places(self, url, tmp_path):
        back_up(url, tmp_path / "backup")
        manifest = Manifest.model_validate_json((tmp_path / "backup" / "manifest.json").read_bytes())
        with closing(Database.open(url)) as database, database.reading() as connection:
            assert content_of(connection) == manifest.tables
        with closing(Database.open(url)) as database, database.writing() as connection:
            connection.exec_driver_sql("UPDATE robots SET name = 'r' || name")
            assert content_of(connection)["robots"] != manifest.tables["robots"]


@pytest.mark.parametrize("url", ["postgresql://me:geheim@host/db", "postgresql://me@host/db?password=geheim"])
def test_a_password_stands_on_no_command_line_and_is_not_shown(url, monkeypatch):
    ran = {}

    def run(command, *, env, **_options):
        ran.update(command=command, env=env)
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(backups.subprocess, "run", run)
    monkeypatch.setattr(backups.shutil, "which", lambda program: program)
    backups._run(url, "pg_dump")
    assert "geheim" not in " ".join(ran["command"])
    assert ran["env"]["PGPASSWORD"] == "geheim"
    assert "geheim" not in _shown(url)
