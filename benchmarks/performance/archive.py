"""Archives: processor time and memory at 10,000 runs and 50,000 sets; restores that are killed.

By name only: half an hour, or one study of one database with `--part` of 1/4 to 4/4.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import IO, Final

from benchmarks.campaigns import small_campaign
from benchmarks.report import Figure, Part, Section
from benchmarks.services import databases
from jointstiff.schemas.run import Campaign, RunRequest
from jointstiff.service.api.runs import _store_robot_once, _store_set_once
from jointstiff.service.archive.form import MANIFEST, FileEntry, Manifest, to_line
from jointstiff.service.archive.reading import read_archive
from jointstiff.service.archive.writing import write_archive
from jointstiff.service.jobs import Parts
from jointstiff.service.store.store import Store
from tests.support.copied_rows import make_id

__all__ = ["run"]

_LAUNCHER: Final = """
import json, os, sys
pid = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ)
_, status, used = os.wait4(pid, 0)
print("USED", json.dumps([status, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]))
"""
"""A small process between: a child inherits the peak of a large parent (Linux books it at exec)."""

_KILLED: Final = """
import json, os, random, signal, sys, time
from pathlib import Path
from jointstiff.service.archive.restoring import restore_archive

path, url, kills, longest = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), float(sys.argv[4])
killed, draw = 0, random.Random(url)
while True:
    began = time.monotonic()
    child = os.fork()
    if not child:
        restored = restore_archive(path, url)
        os._exit(int(restored.refused > 0))
    moment = began + (draw.uniform(0.0, longest) if killed < kills else 1e9)
    ended, status = os.waitpid(child, os.WNOHANG)
    while not ended and time.monotonic() < moment:
        time.sleep(0.005)
        ended, status = os.waitpid(child, os.WNOHANG)
    if ended:
        break
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    killed += 1
print(json.dumps([killed, time.monotonic() - began]))
sys.exit(os.waitstatus_to_exitcode(status))
"""
"""Restores that are killed, each in a process that need not import anything."""


@dataclass(frozen=True)
class _Size:
    """Numbers of records."""

    robots: int
    sets: int
    runs: int
    killed_runs: int  # runs of the archive whose restore is killed
    kills: int


def run(*, quick: bool, part: Part) -> list[Section]:
    """Measure both databases, or those studies of them that belong to a part."""
    size = _Size(20, 100, 50, 50, 5) if quick else _Size(1_000, 50_000, 10_000, 10_000, 50)
    with tempfile.TemporaryDirectory(prefix="jointstiff-archive-") as temporary, databases() as kinds:
        folder = Path(temporary)
        studies: list[Callable[[], Section]] = []
        for name, new in kinds.items():
            studies.append(partial(_measure, name, new, folder, size))
            studies.append(partial(_kill, name, new, folder, size))
        return [studies[number]() for number in part.of(len(studies))]


def _measure(name: str, new: Callable[[], str], folder: Path, size: _Size) -> Section:
    """Restore an archive into a new database, and archive the database."""
    large = _make_archive(folder, f"{name}-large.zip", size.robots, size.sets, size.runs)
    again, url = folder / f"{name}.zip", new()
    restored = _cost("restore", str(large), "--database", url)
    archived = _cost("archive", str(again), "--database", url, "--with-key-hashes")
    is_equal = _manifest_of(again) == _manifest_of(large)
    megabytes = again.stat().st_size / 1e6
    rows = (
        ("restore", f"{restored[0]:.0f} s", f"{restored[1]:.0f} MB"),
        ("archive", f"{archived[0]:.0f} s", f"{archived[1]:.0f} MB"),
    )
    figures = (
        Figure(f"{name}: archive, processor time", archived[0], "at most", 120, " s"),
        Figure(f"{name}: archive, peak memory", archived[1], "at most", 300, " MB"),
        Figure(f"{name}: restore, processor time", restored[0], "at most", 240, " s"),
        Figure(f"{name}: restore, peak memory", restored[1], "at most", 300, " MB"),
        Figure.none(f"{name}: manifests that differ", int(not is_equal)),
    )
    title = f"{name}: archive of {size.runs:,} runs and {size.sets:,} sets, {megabytes:.0f} MB"
    notes = ("processor time of the command alone, without the server of PostgreSQL",)
    return Section(title, ("command", "processor", "peak memory"), rows, figures, notes)


def _kill(name: str, new: Callable[[], str], folder: Path, size: _Size) -> Section:
    """Kill restores at random moments; each is continued by the next, until a restore ends."""
    small = _make_archive(folder, f"{name}-small.zip", size.robots, size.robots, size.killed_runs)
    whole = _restore_killed(small, new(), 0, 1e9).seconds
    kills, databases_of_killed, different = 0, 0, 0
    while kills < size.kills:
        url = new()
        kills += _restore_killed(small, url, size.kills - kills, 0.1 * whole).kills
        databases_of_killed += 1
        different += _differs(url, small, folder / f"{name}-{databases_of_killed}.zip")
    figures = (Figure.none(f"{name}: databases that differ after {kills} kills", different),)
    rows = ((str(kills), str(databases_of_killed), str(different)),)
    title = f"{name}: restores of {size.killed_runs:,} runs, killed at random moments"
    return Section(title, ("kills", "databases", "that differ"), rows, figures)


@dataclass(frozen=True)
class _Killed:
    """A restore that was killed, and continued until it ended."""

    kills: int
    seconds: float  # of the last process


def _restore_killed(path: Path, url: str, kills: int, longest: float) -> _Killed:
    """Restore an archive by one process after the other; kill each within a time [s], but the last."""
    command = [sys.executable, "-c", _KILLED, str(path), url, str(kills), str(longest)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    killed, seconds = json.loads(done.stdout)
    return _Killed(killed, seconds)


def _differs(url: str, original: Path, path: Path) -> bool:
    """Return whether a restored database has another archive than the original."""
    write_archive(url, path, "hashes")
    return _manifest_of(path) != _manifest_of(original)


def _cost(*arguments: str) -> tuple[float, float]:
    """Return processor time [s] and peak memory [MB] of a command."""
    command = [sys.executable, "-c", _LAUNCHER, sys.executable, "-m", "jointstiff", *arguments]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    status, seconds, megabytes = json.loads(done.stdout.rpartition("USED ")[2])
    if status != 0:
        raise RuntimeError(f"{arguments} ended with status {status}")
    return seconds, megabytes


def _manifest_of(path: Path) -> Manifest:
    with read_archive(path) as archive:
        return archive.manifest


@dataclass(frozen=True)
class _Copies:
    """Lines of a robot, its set and its run, and how many copies of each an archive has."""

    lines: dict[str, bytes]  # table → line
    robot_id: str
    set_id: str
    run_id: str
    robots: int
    sets: int
    runs: int

    def of(self, table: str) -> Iterator[bytes]:
        """Yield the lines of the copies of a table, with ids of their own."""
        counts = {"robots": self.robots, "measurement_sets": self.sets, "jobs": self.runs}
        for number in range(counts.get(table, 0)):
            of_set = number if table == "measurement_sets" else number % self.sets
            of_robot = number if table == "robots" else of_set % self.robots
            line = self.lines[table].replace(self.run_id.encode(), make_id(3, number).encode())
            line = line.replace(self.set_id.encode(), make_id(2, of_set).encode())
            yield line.replace(self.robot_id.encode(), make_id(1, of_robot).encode())


def _make_archive(folder: Path, name: str, robots: int, sets: int, runs: int) -> Path:
    """Write an archive of copies of a robot, its set and its run."""
    source, url = folder / f"{name}.source.zip", f"sqlite:///{folder / name}.db"
    with Store.open(url) as store:
        parts = Parts(store)
        campaign = Campaign.model_validate_json(json.dumps(small_campaign(seed=1).document))
        robot_id = _store_robot_once(parts, campaign.robot)
        set_id = _store_set_once(parts, campaign.measurement_set, robot_id)
        run_id = parts.jobs["run"].create(RunRequest(measurement_set_id=set_id), None).id
    write_archive(url, source, "hashes")
    with read_archive(source) as archive:
        manifest = archive.manifest
        tables = ("robots", "measurement_sets", "jobs")
        lines = {table: to_line(next(iter(archive.lines(table)))) for table in tables}
    copies = _Copies(lines, robot_id, set_id, run_id, robots, sets, runs)
    files = dict(manifest.files)
    with zipfile.ZipFile(folder / name, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as target:
        for file_name in files:
            with target.open(file_name, "w", force_zip64=True) as file:
                files[file_name] = _write_lines(file, copies.of(file_name.removesuffix(".jsonl")))
        target.writestr(MANIFEST, manifest.model_copy(update={"files": files}).model_dump_json())
    return folder / name


def _write_lines(file: IO[bytes], lines: Iterator[bytes]) -> FileEntry:
    """Write lines to a file of an archive; return its entry of the manifest."""
    digest, count, size = sha256(), 0, 0
    for line in lines:
        file.write(line)
        digest.update(line)
        count += 1
        size += len(line)
    return FileEntry(lines=count, bytes=size, sha256=digest.hexdigest())
