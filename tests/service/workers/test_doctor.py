"""The doctor finds what was planted, on both databases, and nothing in a healthy one."""

import shutil
import sqlite3
from contextlib import closing

import pytest
from sqlalchemy import text
from support.jobs import request, runs_of, stored_set
from support.terminal import terminal

from jointstiff.service.store.database import Database
from jointstiff.service.store.store import Store
from jointstiff.service.workers.doctor import examine


def filled(url):
    """Store a robot, its readings and a run of them."""
    with Store.open(url) as store:
        runs_of(store).create(request(stored_set(store), resampling=None), None)
    return url


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A database with one of each, which tests copy."""
    path = tmp_path_factory.mktemp("doctor") / "whole.db"
    filled(f"sqlite:///{path}")
    return path


@pytest.fixture
def url(either_database_url, whole):
    kind, _, path = either_database_url.partition(":///")
    if kind != "sqlite":
        return filled(either_database_url)
    shutil.copy(whole, path)
    return either_database_url


def planted(url, *statements):
    """Do what only a fault of software or disk, or a stranger, would do."""
    with closing(Database.open(url)) as database, database.reading() as connection:
        for statement in statements:
            connection.execute(text(statement))


@pytest.mark.parametrize(
    ("statement", "code", "where"),
    [
        ("UPDATE robots SET content_hash = 'another'", "hash", "robot "),
        ("UPDATE robots SET document = replace(document, 'name', 'nam')", "document", "robot "),
        ("UPDATE measurement_sets SET content_hash = 'another'", "hash", "measurement set "),
        ("UPDATE measurement_sets SET document = '{}'", "document", "measurement set "),
        ("UPDATE jobs SET document = substr(document, 1, 500)", "document", "run "),
        ("UPDATE jobs SET document = replace(document, 'provenance', 'origin')", "document", "run "),
        ("UPDATE jobs SET state = 'failed'", "state", "run "),
        ("UPDATE jobs SET state = 'running'", "endless", "run "),
        ("UPDATE jobs SET kind = 'dream'", "kind", "dream "),
        ("INSERT INTO job_steps VALUES ('gone', 0, 5, 1, 1, NULL, 0, NULL)", "orphan", "job_steps gone"),
        (
            "INSERT INTO idempotency_keys VALUES ('robots', 'k', 'b', 'gone', '2026-11-20 00:00:00')",
            "orphan",
            "idempotency_keys gone",
        ),
        ("UPDATE alembic_version SET version_num = '9999'", "schema", "alembic_version"),
    ],
)
def test_planted_faults_are_found(url, statement, code, where):
    planted(url, statement)
    found = examine(url)
    assert [fault.code for fault in found.faults] == [code]
    assert found.faults[0].where.startswith(where)
    assert found.faults[0].remedy


class TestOnSqlite:
    @pytest.fixture
    def url(self, tmp_path, whole):
        return f"sqlite:///{shutil.copy(whole, tmp_path / 'of.db')}"

    def test_orphans_of_references(self, url):
        planted(url, "PRAGMA foreign_keys=OFF", "DELETE FROM robots")
        assert {fault.code for fault in examine(url).faults} == {"orphan"}

    def test_a_damaged_page(self, url, tmp_path):
        with closing(sqlite3.connect(tmp_path / "of.db")) as connection:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        content = bytearray((tmp_path / "of.db").read_bytes())
        place = content.index(b'"joint_map"')  # in the middle of an overflowing row
        page = place // 4096 * 4096
        content[page : page + 4096] = bytes(4096)
        (tmp_path / "of.db").write_bytes(content)
        assert {fault.code for fault in examine(url).faults} == {"file"}

    def test_the_command_says_what_is_wrong_and_ends_with_status_1(self, url):
        run = terminal("doctor", "--database", url)
        assert run.exit_code == 0, run.output
        assert "faults: 0" in run.output
        planted(url, "UPDATE robots SET content_hash = 'another'")
        run = terminal("doctor", "--database", url)
        assert run.exit_code == 1
        assert "the hash differs" in run.output

    def test_backup_and_restore_as_commands(self, url, tmp_path):
        folder = str(tmp_path / "backup")
        run = terminal("backup", "--database", url, folder)
        assert "1 × robots, 1 × measurement sets, 1 × jobs" in run.output
        again = terminal("restore", "--database", url, folder)
        assert again.exit_code == 2
        new = f"sqlite:///{tmp_path / 'new.db'}"
        assert terminal("restore", "--database", new, folder).exit_code == 0
        assert examine(new).faults == []
