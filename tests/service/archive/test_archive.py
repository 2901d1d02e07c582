"""Archives: every record of every layout, with every number, from either database to either."""

import copy
import json
import sqlite3
import subprocess
import sys
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from pydantic_core import from_json
from support import kept
from support.kept import count_numbers
from support.terminal import terminal

from jointstiff.service.archive import form, reading, restoring
from jointstiff.service.archive.arrays import describe_arrays, pack_arrays
from jointstiff.service.archive.checking import check_database
from jointstiff.service.archive.form import LEFT_OUT, RESTORED, file_of
from jointstiff.service.archive.reading import ArchiveError
from jointstiff.service.archive.restoring import Restored, restore_archive
from jointstiff.service.archive.writing import write_archive
from jointstiff.service.history.paths import remove
from jointstiff.service.history.steps import STEPS
from jointstiff.service.problems import StoreError
from jointstiff.service.store.layouts import LAYOUT
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import metadata
from jointstiff.service.workers.engine import Queue

Lines = dict[str, list[dict[str, Any]]]


def lines_of(path: Path) -> Lines:
    """Table → lines of an archive."""
    with zipfile.ZipFile(path) as file:
        return {
            name.removesuffix(".jsonl"): [from_json(line) for line in file.read(name).splitlines()]
            for name in file.namelist()
            if name != form.MANIFEST
        }


def manifest_of(path: Path) -> dict[str, Any]:
    with zipfile.ZipFile(path) as file:
        manifest: dict[str, Any] = json.loads(file.read(form.MANIFEST))
    return manifest


def archived(url: str, path: Path) -> Path:
    """Archive a database with everything."""
    assert write_archive(url, path, "hashes").damaged == []
    return path


@pytest.fixture(scope="session")
def today(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An archive of a database of today's layout with one of everything."""
    folder = tmp_path_factory.mktemp("today")
    url = f"sqlite:///{folder / 'store.db'}"
    kept.restore("0018", url)
    with Store.open(url, upgrade=lambda _: None) as store:
        store.old_documents.rewrite(600.0)
    first = archived(url, folder / "first.zip")
    # Its documents have all fields of today after one restore.
    again = f"sqlite:///{folder / 'again.db'}"
    restore_archive(first, again)
    return archived(again, folder / "today.zip")


@pytest.fixture(params=["sqlite", "postgresql"])
def empty(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[], str]:
    """Call it for the URL of an empty database; all of one kind."""
    if request.param == "postgresql":
        return request.getfixturevalue("new_postgresql_database")
    return lambda: f"sqlite:///{tmp_path / 'empty.db'}"


def added(restored: Restored) -> dict[str, int]:
    return {table: outcome.added for table, outcome in restored.tables.items() if outcome.added}


def reasons(restored: Restored) -> list[str]:
    return [reason for outcome in restored.tables.values() for reason in outcome.reasons]


def without(document, dropped):
    """Return a document without the fields that a restoring named as dropped."""
    kept_fields = copy.deepcopy(document)
    for path in dropped:
        remove(kept_fields, path)
    return kept_fields


class TestLayouts:
    @pytest.mark.parametrize("number", kept.kept_numbers())
    def test_every_record_of_an_old_layout_comes_over_with_its_numbers(
        self, number: str, empty: Callable[[], str], tmp_path: Path
    ) -> None:
        source = tmp_path / "old.db"
        old = kept.make_database(number, source)
        before = source.read_bytes()
        path, url = archived(old, tmp_path / "old.zip"), empty()
        assert source.read_bytes() == before
        lines = lines_of(path)
        restored = restore_archive(path, url)
        assert reasons(restored) == []
        assert added(restored) == {table: len(lines[table]) for table in RESTORED if lines.get(table)}
        now = lines_of(archived(url, tmp_path / "now.zip"))
        dropped = {path.partition(": ")[2] for path in restored.dropped}
        assert dropped <= {path for step in STEPS for path in step.dropped}
        for table in ("measurement_sets", "live_entries", "access_keys", "idempotency_keys", "audit"):
            compare_rows(table, lines[table], now[table])
        for table in ("robots", "open_sets", "jobs"):
            # What today's code fills in has no numbers but defaults.
            kept_fields = [without(line["document"], dropped) for line in lines[table]]
            numbers = [count_numbers(kept_fields), count_numbers([line["document"] for line in now[table]])]
            assert not dropped or numbers[0] - numbers[1] != numbers[0]
            assert numbers[0] - numbers[1] == Counter(), table
        with Store.open(url) as store, kept.client_of(store) as client:
            shown = [line["id"] for line in lines["jobs"] if "deleted_at" not in line]
            assert {client.get(f"/v1/jobs/{job}").status_code for job in shown} == {200}
            robots = client.get("/v1/robots?limit=100").json()["items"]
            assert len(robots) == sum("deleted_at" not in line for line in lines["robots"])
            assert any(robot["last_campaign"] for robot in robots)
            assert check_database(url).faults == []


def compare_rows(table: str, before: list[dict[str, Any]], now: list[dict[str, Any]]) -> None:
    """Rows without documents, or whose document has no numbers that change place, are equal."""
    omitted = {"schema", "document", "archived"}
    rows = [
        [{name: value for name, value in row.items() if name not in omitted} for row in part]
        for part in (before, now)
    ]
    assert rows[0] == rows[1], table


def test_a_restore_that_is_continued_checks_only_what_is_not_there(
    today: Path, empty: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    url = empty()
    first = restore_archive(today, url)
    with_ids = ("robots", "measurement_sets", "open_sets", "jobs", "access_keys")

    def refuse(_: object) -> None:
        raise ValueError("is checked again")

    monkeypatch.setattr(restoring, "BUILDERS", {**restoring.BUILDERS, **dict.fromkeys(with_ids, refuse)})
    again = restore_archive(today, url)
    assert reasons(again) == []
    assert {table: again.tables[table].present for table in with_ids} == {
        table: first.tables[table].added for table in with_ids
    }


class TestEqual:
    def test_an_archive_of_a_restored_archive_has_the_same_manifest(
        self, today: Path, new_postgresql_database: Callable[[], str], tmp_path: Path
    ) -> None:
        """SQLite → PostgreSQL → SQLite."""
        first = manifest_of(today)
        assert first["layout"] == LAYOUT
        assert sum(entry["lines"] for entry in first["files"].values()) > 40
        path = today
        for name, url in (("2", new_postgresql_database()), ("3", f"sqlite:///{tmp_path / '3.db'}")):
            restored = restore_archive(path, url)
            assert reasons(restored) == []
            path = archived(url, tmp_path / f"{name}.zip")
            assert manifest_of(path) == first

    def test_both_databases_of_equal_rows_have_the_same_manifest(
        self, new_postgresql_database: Callable[[], str], tmp_path: Path
    ) -> None:
        """Of layout 0018, whose dumps have the same rows, and after its upgrade in place."""
        urls = (new_postgresql_database(), f"sqlite:///{tmp_path / 'old.db'}")
        for name, url in zip("ab", urls, strict=True):
            kept.restore("0018", url)
            archived(url, tmp_path / f"{name}.zip")
            with Store.open(url, upgrade=lambda _: None) as store:
                store.old_documents.rewrite(600.0)
            archived(url, tmp_path / f"{name}2.zip")
        assert manifest_of(tmp_path / "a.zip") == manifest_of(tmp_path / "b.zip")
        assert manifest_of(tmp_path / "a2.zip") == manifest_of(tmp_path / "b2.zip")

    def test_restored_answers_are_equal(self, empty: Callable[[], str], tmp_path: Path) -> None:
        old = f"sqlite:///{tmp_path / 'old.db'}"
        kept.restore("0018", old)
        url = empty()
        restore_archive(archived(old, tmp_path / "old.zip"), url)
        before = json.loads(kept.read_kept("0018", "answers.json"))
        with Store.open(url) as store, kept.client_of(store) as client:
            now = kept.ask_again(client, before, "0018")
            changes = [
                change
                for change in kept.list_changes(before, now)
                # A running job is queued again, without its progress.
                if "'missing'" not in change
            ]
        assert changes == []

    def test_what_is_there_is_left_as_it_is(self, today: Path, empty: Callable[[], str]) -> None:
        url = empty()
        first = restore_archive(today, url)
        with Store.open(url) as store:
            robot = store.robots.page(limit=1).records[0]
            store.robots.change(robot.id, lambda _: {"name": "renamed since"})
        again = restore_archive(today, url)
        assert added(again) == {}
        assert {name: outcome.present for name, outcome in again.tables.items()} == {
            name: outcome.added for name, outcome in first.tables.items()
        }
        with Store.open(url) as store:
            assert store.robots.get(robot.id).name == "renamed since"

    def test_open_jobs_begin_anew(self, today: Path, empty: Callable[[], str]) -> None:
        states = [line["state"] for line in lines_of(today)["jobs"]]
        assert "queued" in states
        assert "running" not in states
        url = empty()
        restore_archive(today, url)
        with Store.open(url) as store, closing(Queue(store, url)) as queue:
            waiting = store.open_jobs(["run"])
            assert len(waiting) == 1
            assert queue.find_unknown_jobs(waiting) == set(), "else a worker lets the job fail"

    def test_equal_entries_of_the_audit_are_all_restored(
        self, empty: Callable[[], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        source = f"sqlite:///{tmp_path / 'source.db'}"
        Store.open(source).close()
        row = "'2026-11-27 12:00:00.000001', NULL, NULL, '127.0.0.1', 'POST', 'createRun', '/v1/runs', 201"
        with closing(sqlite3.connect(tmp_path / "source.db")) as connection, connection:
            columns = "at, key_id, key_name, address, method, operation, path, status"
            for _ in range(5):
                connection.execute(f"INSERT INTO audit ({columns}) VALUES ({row})")  # noqa: S608 - ours
        path, url = archived(source, tmp_path / "a.zip"), empty()
        monkeypatch.setattr(restoring, "MOST_ROWS", 2)
        assert restore_archive(path, url).tables["audit"].added == 5
        assert restore_archive(path, url).tables["audit"].present == 5


class TestCut:
    @pytest.mark.parametrize("portions", [0, 1, 2, 5, 9, 14])
    def test_a_restore_that_ends_early_is_continued(
        self,
        portions: int,
        today: Path,
        empty: Callable[[], str],
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        url, store_portion, left = empty(), restoring.Target.store, [portions]

        def end_early(target: Any, *arguments: Any) -> None:
            if left[0] == 0:
                raise KeyboardInterrupt
            left[0] -= 1
            store_portion(target, *arguments)

        monkeypatch.setattr(restoring, "MOST_ROWS", 4)
        with monkeypatch.context() as cut:
            cut.setattr(restoring.Target, "store", end_early)
            with pytest.raises(KeyboardInterrupt):
                restore_archive(today, url)
        restored = restore_archive(today, url)
        assert sum(outcome.present for outcome in restored.tables.values()) <= 4 * portions
        assert manifest_of(archived(url, tmp_path / "again.zip")) == manifest_of(today)

    def test_an_archive_that_cannot_be_written_leaves_no_file(self, tmp_path: Path) -> None:
        with pytest.raises(StoreError, match="does not exist"):
            write_archive(f"sqlite:///{tmp_path / 'none.db'}", tmp_path / "a.zip")
        assert list(tmp_path.iterdir()) == []
        (tmp_path / "a.zip").write_text("mine")
        with pytest.raises(StoreError, match="exists already"):
            write_archive(f"sqlite:///{tmp_path / 'none.db'}", tmp_path / "a.zip")


KILLED = """
import os, random, signal, sys, time
from pathlib import Path
from jointstiff.service.archive import restoring

path, url, kills, seed = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
restoring.MOST_ROWS, draw, killed = 1, random.Random(seed), 0
for _ in range(kills):
    child = os.fork()
    if not child:
        restoring.restore_archive(path, url)
        os._exit(0)
    time.sleep(draw.uniform(0.0, 0.6))
    os.kill(child, signal.SIGKILL)
    killed += os.waitpid(child, 0)[1] == signal.SIGKILL
print(killed)
"""


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.parametrize("seed", range(3))
def test_a_restore_that_is_killed_at_any_moment_is_continued(
    seed: int, today: Path, empty: Callable[[], str], tmp_path: Path
) -> None:
    """`python -m benchmarks archive` does so with 10,000 runs."""
    url = empty()
    Store.open(url).close()
    command = [sys.executable, "-W", "error", "-c", KILLED, str(today), url, "12", str(seed)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert int(done.stdout) > 3
    restore_archive(today, url)
    assert manifest_of(archived(url, tmp_path / "again.zip")) == manifest_of(today)


class TestDryRun:
    def test_a_dry_run_says_what_a_restore_does_and_changes_nothing(
        self, today: Path, tmp_path: Path
    ) -> None:
        path = tmp_path / "new.db"
        url = f"sqlite:///{path}"
        planned = restore_archive(today, url, dry_run=True)
        assert not path.exists()
        assert restore_archive(today, url) == planned
        before = manifest_of(archived(url, tmp_path / "before.zip"))
        assert added(restore_archive(today, url, dry_run=True)) == {}
        assert manifest_of(archived(url, tmp_path / "after.zip")) == before


class TestKeys:
    def test_hashes_of_keys_are_archived_on_request_only(self, today: Path, tmp_path: Path) -> None:
        url = f"sqlite:///{tmp_path / 'a.db'}"
        restore_archive(today, url)
        with Store.open(url) as store:
            hashes = [key.key_hash for key in store.keys.all()]
        assert len(hashes) == 2
        for keys, number in (("names", 2), ("none", 0)):
            path = tmp_path / f"{keys}.zip"
            write_archive(url, path, keys)
            with zipfile.ZipFile(path) as file:
                content = b"".join(map(file.read, file.namelist()))
            assert not any(each.encode() in content for each in hashes)
            assert len(lines_of(path).get("access_keys", [])) == number
            restored = restore_archive(path, f"sqlite:///{tmp_path / f'{keys}.db'}")
            assert restored.tables["access_keys"].added == 0
            assert (restored.tables["access_keys"].omitted, restored.refused) == (number, 0)

    def test_every_table_is_archived_or_named_as_left_out(self) -> None:
        """A new table belongs to one of both lists."""
        assert sorted(metadata.tables) == sorted([*RESTORED, *LEFT_OUT])


@pytest.fixture
def changed(today: Path, tmp_path: Path) -> Callable[..., Path]:
    """Call it for a copy of an archive with other contents of files; None removes a file."""

    def change(manifest: Any = None, **files: bytes | None) -> Path:
        path = tmp_path / "changed.zip"
        with zipfile.ZipFile(today) as source, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as target:
            contents: dict[str, Any] = {name: source.read(name) for name in source.namelist()}
            contents |= {file_of(name): content for name, content in files.items()}
            described = json.loads(contents[form.MANIFEST])
            contents[form.MANIFEST] = json.dumps(described | (manifest or {})).encode()
            for name, content in contents.items():
                if content is not None:
                    target.writestr(name, content)
        return path

    return change


def described(content: bytes, lines: int | None = None) -> dict[str, Any]:
    """The entry of a manifest for a file."""
    from hashlib import sha256

    count = content.count(b"\n") if lines is None else lines
    return {"lines": count, "bytes": len(content), "sha256": sha256(content).hexdigest()}


class TestHostile:
    def refused(self, path: Path, tmp_path: Path) -> str:
        url = f"sqlite:///{tmp_path / 'untouched.db'}"
        with pytest.raises(ArchiveError) as caught:
            restore_archive(path, url)
        assert not (tmp_path / "untouched.db").exists()
        return caught.value.reason

    def test_damaged_files_are_refused_before_anything_is_stored(
        self, today: Path, changed: Callable[..., Path], tmp_path: Path
    ) -> None:
        content = today.read_bytes()
        cut = tmp_path / "cut.zip"
        for part in (b"", b"PK", content[:-1], content[: len(content) // 2], content + b"more"):
            cut.write_bytes(part)
            assert "no archive" in self.refused(cut, tmp_path)
        middle = len(content) // 2
        cut.write_bytes(content[:middle] + b"\0" * 64 + content[middle + 64 :])
        self.refused(cut, tmp_path)
        with zipfile.ZipFile(today) as file:
            robots = file.read("robots.jsonl")
        assert "is not the file" in self.refused(changed(robots=robots.replace(b"arm", b"ARM")), tmp_path)
        assert "larger than" in self.refused(changed(robots=robots * 2), tmp_path)
        assert "is missing" in self.refused(changed(robots=None), tmp_path)
        assert "does not name" in self.refused(changed(unknown=b""), tmp_path)

    def test_an_archive_of_a_later_version_is_refused_in_words(
        self, changed: Callable[..., Path], tmp_path: Path
    ) -> None:
        for manifest in ({"layout": "0099_expand_far"}, {"format_version": 2}):
            assert "restores at most" in self.refused(changed(manifest), tmp_path)
        for manifest in ({"format": "other"}, {"files": 3}, {"more": 1}, {"layout": "x"}):
            assert "not that of an archive" in self.refused(changed(manifest), tmp_path)

    def test_sizes_are_limited(
        self, today: Path, changed: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        files = manifest_of(today)["files"]
        zeros = b"0" * 3_000_000
        bomb = changed({"files": files | {"audit.jsonl": described(zeros)}}, audit=zeros)
        assert "expands to more than" in self.refused(bomb, tmp_path)
        many = {f"f{number}.jsonl": described(b"") for number in range(50)}
        path = changed({"files": files | many}, **{f"f{number}": b"" for number in range(50)})
        assert "files" in self.refused(path, tmp_path)
        monkeypatch.setattr(form, "MOST_LINES", 10)
        assert "more than any database" in self.refused(today, tmp_path)
        monkeypatch.undo()
        monkeypatch.setattr(form, "MOST_DIRECTORY_BYTES", 100)
        assert "too many files" in self.refused(today, tmp_path)

    def test_a_long_line_is_refused(
        self, today: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(reading.form, "MOST_LINE_BYTES", 1_000)
        with pytest.raises(ArchiveError, match="longer than"):
            restore_archive(today, f"sqlite:///{tmp_path / 'new.db'}")

    def test_lines_that_cannot_be_used_are_named_and_the_rest_is_restored(
        self, today: Path, changed: Callable[..., Path], tmp_path: Path
    ) -> None:
        lines = lines_of(today)
        hostile = [
            {},
            {"schema": 19, "id": "x"},
            {"schema": 99},
            {"schema": 19, "id": "a/b", "kind": "run", "document": {}},
            lines["jobs"][0] | {"kind": "unknown"},
            lines["jobs"][0] | {"id": "another"},
            lines["jobs"][0] | {"document": lines["jobs"][0]["document"] | {"more": 1}},
            lines["jobs"][0] | {"schema": 9, "document": {"result": {"sweeps": 3, "joints": [1]}}},
        ]
        content = b"".join(map(form.to_line, [*hostile, *lines["jobs"]]))
        files = manifest_of(today)["files"]
        path = changed({"files": files | {"jobs.jsonl": described(content)}}, jobs=content)
        restored = restore_archive(path, f"sqlite:///{tmp_path / 'new.db'}")
        assert restored.tables["jobs"].refused == len(hostile)
        assert restored.tables["jobs"].added == len(lines["jobs"])

    def test_a_record_whose_robot_is_missing_is_refused(
        self, today: Path, changed: Callable[..., Path], tmp_path: Path
    ) -> None:
        files = manifest_of(today)["files"]
        path = changed({"files": files | {"robots.jsonl": described(b"")}}, robots=b"")
        restored = restore_archive(path, f"sqlite:///{tmp_path / 'new.db'}")
        assert restored.tables["measurement_sets"].added == 0
        assert "robot_id" in restored.tables["measurement_sets"].reasons[0]

    @pytest.mark.parametrize(
        "described",
        [
            [],
            {"joints": 3},
            {"joints": {"type": "O", "shape": [1], "values": [1]}},
            {"joints": {"type": "<f8", "shape": [2], "values": [1.0]}},
            {"joints": {"type": "<f8", "shape": [-1], "values": []}},
            {"joints": {"type": "<f8", "shape": [1], "values": ["x"]}},
            {"joints": {"type": "<U999", "shape": [100_000], "values": [""] * 100_000}},
            {f"a{number}": {"type": "<f8", "shape": [0], "values": []} for number in range(99)},
        ],
    )
    def test_arrays_that_are_none_are_refused(self, described: Any) -> None:
        with pytest.raises(ValueError, match=r"array|object|float"):
            pack_arrays(described)

    def test_arrays_come_back_with_their_types(self, today: Path) -> None:
        for line in lines_of(today)["measurement_sets"]:
            again = describe_arrays(pack_arrays(line["arrays"]))
            assert from_json(form.to_line(again)) == line["arrays"]


def iterate_json(path: Path) -> Iterator[dict[str, Any]]:
    with zipfile.ZipFile(path) as archive, archive.open("jobs.jsonl") as lines:
        yield from map(json.loads, lines)


class TestCommands:
    def test_archive_and_restore_print_what_they_do(self, today: Path, tmp_path: Path) -> None:
        url, path = f"sqlite:///{tmp_path / 'new.db'}", tmp_path / "new.zip"
        done = terminal("restore", str(today), "--database", url, "--dry-run")
        assert done.exit_code == 0
        assert "to be added, 0 there already, 0 refused" in done.output
        assert terminal("restore", str(today), "--database", url).exit_code == 0
        done = terminal("archive", str(path), "--database", url, "--with-key-hashes")
        assert done.exit_code == 0
        assert f"wrote {path}: layout {LAYOUT}" in done.output
        assert manifest_of(path) == manifest_of(today)
        assert path.stat().st_mode & 0o777 == 0o600
        assert len(list(iterate_json(path))) > 10

    def test_exit_status_1_names_what_was_not_restored(self, today: Path, tmp_path: Path) -> None:
        url, path = f"sqlite:///{tmp_path / 'new.db'}", tmp_path / "new.zip"
        restore_archive(today, url)
        with Store.open(url) as store:
            store._database.change(sa.text("UPDATE robots SET document = x'00' WHERE sequence = 1"))
        done = terminal("archive", str(path), "--database", url)
        assert done.exit_code == 1
        assert "cannot be read" in done.output
        done = terminal("restore", str(path), "--database", f"sqlite:///{tmp_path / 'other.db'}")
        assert done.exit_code == 1
        assert "refers to" in done.output


def test_an_archive_that_does_not_exist_is_not_restored(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused = terminal("restore", "nothing.zip", "--database", "sqlite:///new.db")
    assert refused.exit_code == 2
    assert "there is no file nothing.zip" in refused.stderr
    assert list(tmp_path.iterdir()) == []
