"""The commands `jointstiff database upgrade`, `status` and `check`."""

import sqlite3
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest
from support import kept
from support.terminal import terminal

run = partial(terminal, width=160)
LAYOUTS = (
    "0018_actions_name_targets",
    "0019_expand_readable",
    "0020_expand_arms",
    "0021_expand_loads",
    "0022_expand_grounds",
    "0023_expand_hands",
    "0024_expand_programs",
)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder without a database."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_database_is_upgraded_by_hand(folder: Path) -> None:
    kept.restore("0018", "sqlite:///jointstiff.db")
    status = run("database", "status")
    later = ", ".join(LAYOUTS[1:])
    due = f"`jointstiff database upgrade` would lead to: {later}"
    earlier = f"layout {LAYOUTS[0]} of an earlier version; {due}"
    assert status.stdout == f"{earlier}\n"
    before = (folder / "jointstiff.db").read_bytes()
    assert run("database", "check").stdout.splitlines() == [
        f"{earlier}; the tables are compared after an upgrade",
        "48 documents read, 0 faults",
    ]
    assert (folder / "jointstiff.db").read_bytes() == before
    lines = run("database", "upgrade").stdout.splitlines()
    assert lines == [
        f"upgraded the database from layout {LAYOUTS[0]} to {LAYOUTS[1]}; a copy of the database before the "
        "upgrade is jointstiff.db.before-0019",
        f"upgraded the database from layout {LAYOUTS[1]} to {LAYOUTS[2]}",
        f"upgraded the database from layout {LAYOUTS[2]} to {LAYOUTS[3]}",
        f"upgraded the database from layout {LAYOUTS[3]} to {LAYOUTS[4]}",
        f"upgraded the database from layout {LAYOUTS[4]} to {LAYOUTS[5]}",
        f"upgraded the database from layout {LAYOUTS[5]} to {LAYOUTS[6]}",
        "documents of an earlier form: 0 left",
        f"layout {LAYOUTS[-1]}; documents of an earlier form: 0",
    ]
    assert run("database", "upgrade").stdout == f"{lines[-1]}\n"
    assert run("database", "status").stdout == f"{lines[-1]}\n"
    assert (folder / "jointstiff.db.before-0019").exists()


def test_no_copy_is_made_if_none_is_wanted(folder: Path) -> None:
    kept.restore("0018", "sqlite:///jointstiff.db")
    assert "a copy" not in run("database", "upgrade", "--no-copy").stdout
    assert list(folder.glob("*before*")) == []


def test_a_check_names_each_fault() -> None:
    kept.restore("0018", "sqlite:///jointstiff.db")
    run("database", "upgrade")
    sound = run("database", "check")
    assert (sound.exit_code, sound.stdout) == (0, "48 documents read, 0 faults\n")
    with closing(sqlite3.connect("jointstiff.db", isolation_level=None)) as connection:
        connection.execute("UPDATE jobs SET document = x'00', robot_id = 'nobody' WHERE sequence = 1")
        connection.execute("DROP INDEX ix_jobs_name")
        ((identifier,),) = connection.execute("SELECT id FROM jobs WHERE sequence = 1")
    found = run("database", "check")
    assert found.exit_code == 1
    assert "a row of jobs refers to a missing row of robots" in found.stdout
    assert "ix_jobs_name" in found.stdout
    assert f"jobs: document of {identifier} is damaged" in found.stdout


def test_a_damaged_document_of_an_earlier_layout_is_named() -> None:
    kept.restore("0018", "sqlite:///jointstiff.db")
    with closing(sqlite3.connect("jointstiff.db", isolation_level=None)) as connection:
        connection.execute("UPDATE jobs SET document = x'00' WHERE sequence = 1")
        ((identifier,),) = connection.execute("SELECT id FROM jobs WHERE sequence = 1")
    found = run("database", "check")
    assert found.exit_code == 1
    assert f"jobs: document of {identifier} is damaged" in found.stdout


def test_an_index_of_others_is_named_and_is_no_fault() -> None:
    kept.restore("0018", "sqlite:///jointstiff.db")
    run("database", "upgrade")
    with closing(sqlite3.connect("jointstiff.db", isolation_level=None)) as connection:
        connection.execute("CREATE INDEX grafana_by_day ON jobs (created_at, verdict)")
    found = run("database", "check")
    assert (found.exit_code, found.stdout.splitlines()) == (
        0,
        [
            "jobs: the index grafana_by_day is not of Jointstiff, and remains as it is",
            "48 documents read, 0 faults",
        ],
    )


def test_an_index_of_ours_that_others_changed_is_a_fault() -> None:
    kept.restore("0018", "sqlite:///jointstiff.db")
    run("database", "upgrade")
    with closing(sqlite3.connect("jointstiff.db", isolation_level=None)) as connection:
        connection.execute("DROP INDEX ix_jobs_name")
        connection.execute("CREATE INDEX ix_jobs_name ON jobs (verdict)")
    found = run("database", "check")
    assert found.exit_code == 1
    assert "ix_jobs_name" in found.stdout


def test_a_check_makes_no_tables(folder: Path) -> None:
    (folder / "jointstiff.db").touch()
    assert run("database", "check").stdout == "the database has no tables yet: there is nothing to check\n"
    with closing(sqlite3.connect("jointstiff.db")) as connection:
        assert connection.execute("SELECT name FROM sqlite_schema").fetchall() == []


@pytest.mark.parametrize("command", ["upgrade", "status", "check"])
def test_a_database_that_does_not_exist_is_not_made(folder: Path, command: str) -> None:
    refused = run("database", command)
    assert refused.exit_code == 2
    assert "the database jointstiff.db does not exist" in refused.stderr
    assert list(folder.iterdir()) == []
