"""A folder into which other programs drop finished files: each is taken once, and none is lost.

A file is finished when two looks find the same size and time of change. It stays where it is until the
service has answered: then it is moved to `done`, or to `rejected` with the problem beside it. A key made from
its content makes repeated posts harmless, whoever repeats them: this watcher after a crash, or another one.
Links are not followed: who may write into the folder must not read or write what only the watcher may.
"""

from __future__ import annotations

import errno
import hashlib
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, NamedTuple, Protocol

from jointstiff.schemas.problem import Problem
from jointstiff.service.conversion.parsing import MAX_SET_BYTES
from jointstiff.service.library.errors import AwayError, CampaignError, RefusedError

TABLES: Final = frozenset({".csv", ".txt", ".tsv", ".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"})
_OF_THE_FILE: Final = frozenset({409, 413, 415, 422})
"""Statuses by which a service refuses the file itself; all others may pass: no key, no room, no answer."""
_LONGEST_PAUSE: Final = 60.0
_LONGEST_NAME: Final = 255  # bytes
_READ: Final = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK
"""No link that took a file's name leads elsewhere, and no pipe that did holds the watcher."""


class FinishedFile(NamedTuple):
    """A file that is not written any more."""

    name: str
    content: bytes

    @property
    def digest(self) -> str:
        """SHA-256 of the content."""
        return hashlib.sha256(self.content).hexdigest()


class Delivers(Protocol):
    """Something that takes finished files."""

    @property
    def suffixes(self) -> frozenset[str]:
        """Endings of the names that it takes, in small letters."""

    def post(self, file: FinishedFile) -> str:
        """Take a file; return what became of it, for people. Taking one again changes nothing.

        Raises:
            RefusedError: it cannot be taken, or not now.
            CampaignError: its content cannot be understood.
        """


@dataclass(frozen=True)
class Event:
    """One thing that happened in a look."""

    #: `waiting`: nothing can be posted now; `left`: no file that is taken
    kind: Literal["taken", "rejected", "waiting", "left"]
    file: str  #: its name; empty where it is about all of them
    message: str


class _Seen(NamedTuple):
    size: int
    changed: int
    since: float
    """Time of the first look that found it so."""
    looks: int


class WatchedFolder:
    """A folder and what was seen of it. Its state is in the folder alone: any number may watch it."""

    def __init__(
        self,
        folder: Path,
        deliver: Delivers,
        *,
        clock: Callable[[], float],
        settle: float = 60.0,
    ) -> None:
        """Watch a folder.

        Args:
            folder: that other programs write into.
            deliver: takes the files.
            clock: seconds, from any beginning.
            settle: seconds for which a file that is not understood must have been unchanged before it is
                rejected: until then it may be half of one.
        """
        self._folder, self._deliver, self._clock, self._settle = folder, deliver, clock, settle
        self._seen: dict[str, _Seen] = {}
        self._told: set[str] = set()
        self._pause = 0.0
        self._resume = 0.0

    def look(self) -> Iterator[Event]:
        """Look once; take the files that are finished, in the order of their names."""
        now = self._clock()
        try:
            files = dict(self._files(now))
        except OSError as error:  # of a share that is away
            yield from self._once("", "waiting", f"the folder cannot be read: {error.strerror or error}")
            return
        self._seen = files
        if now < self._resume:
            return
        for name in sorted(files):
            if files[name].looks < 2:
                continue
            try:
                yield from self._take(name, files[name], now)
            except AwayError as error:
                self._pause = min(_LONGEST_PAUSE, 2.0 * self._pause or 1.0)
                self._resume = now + self._pause
                yield from self._once("", "waiting", f"{error.problem.detail}; files stay until it answers")
                return
            except OSError as error:  # still held by the writer, or a slow share
                yield from self._once(
                    name, "waiting", f"cannot be read or moved now: {error.strerror or error}"
                )

    @property
    def is_idle(self) -> bool:
        """Return whether no file waits that is taken."""
        return not any(Path(name).suffix.lower() in self._deliver.suffixes for name in self._seen)

    def _files(self, now: float) -> Iterator[tuple[str, _Seen]]:
        with os.scandir(self._folder) as entries:
            for entry in entries:
                if entry.name.startswith((".", "~")) or not entry.is_file(follow_symlinks=False):
                    continue
                try:
                    status = entry.stat(follow_symlinks=False)
                except FileNotFoundError:  # renamed, or taken by another watcher
                    continue
                before = self._seen.get(entry.name)
                same = before is not None and before[:2] == (status.st_size, status.st_mtime_ns)
                since, looks = (before.since, before.looks + 1) if before is not None and same else (now, 1)
                yield entry.name, _Seen(status.st_size, status.st_mtime_ns, since, looks)

    def _take(self, name: str, seen: _Seen, now: float) -> Iterator[Event]:
        if Path(name).suffix.lower() not in self._deliver.suffixes:
            taken = ", ".join(sorted(self._deliver.suffixes))
            yield from self._once(name, "left", f"only {taken} are read; the file stays")
            return
        settled = now - seen.since >= self._settle
        file = self._read(name, seen)
        if file is None or not (file.content or settled):
            return
        try:
            message = self._deliver.post(file)
        except (RefusedError, CampaignError) as error:
            if isinstance(error, AwayError) or error.problem.status not in _OF_THE_FILE:
                raise AwayError(error.problem) from error
            may_be_half = isinstance(error, CampaignError) and not settled
            if not may_be_half and self._filed(file, "rejected", error.problem):
                yield Event("rejected", name, str(error))
            return
        self._pause = 0.0
        self._told = {told for told in self._told if told[0] != "\n"}
        if self._filed(file, "done"):
            yield Event("taken", name, message)

    def _read(self, name: str, seen: _Seen) -> FinishedFile | None:
        """Return a file as it is; None if it is gone, or was written since it was seen."""
        try:
            with os.fdopen(os.open(self._folder / name, _READ), "rb") as opened:
                file = FinishedFile(name, opened.read(MAX_SET_BYTES + 1))
        except FileNotFoundError:
            return None
        return file if len(file.content) == min(seen.size, MAX_SET_BYTES + 1) else None

    def _filed(self, file: FinishedFile, place: str, problem: Problem | None = None) -> bool:
        """Move a file to where it is kept; return whether it was this watcher that did."""
        path, kept = self._folder / file.name, self._folder / place
        kept.mkdir(exist_ok=True)
        if kept.is_symlink():
            raise NotADirectoryError(errno.ENOTDIR, "done and rejected must be folders, not links")
        target = kept / path.name
        if target.exists() and _digest(target) != file.digest:
            target = _fitting(kept, path.name, f"-{file.digest[:12]}{path.suffix}")
        if problem is not None:  # first: whoever finds the file finds the reason
            beside = target.with_name(f"{target.name}.problem.json")
            if len(os.fsencode(beside.name)) > _LONGEST_NAME:
                beside = _fitting(kept, target.name, f"-{file.digest[:12]}.problem.json")
            beside.unlink(missing_ok=True)  # a link would lead to a file of the watcher's owner
            with beside.open("x", encoding="utf-8") as opened:
                opened.write(problem.model_dump_json(indent=1) + "\n")
        try:
            path.replace(target)
        except FileNotFoundError:  # another watcher was faster
            return False
        if len(file.content) <= MAX_SET_BYTES and _digest(target) != file.digest:
            free, number = path, 1
            while free.exists():
                free, number = path.with_name(f"{path.stem}-{number}{path.suffix}"), number + 1
            target.rename(free)  # another file had taken its name since it was read
            return False
        self._seen.pop(path.name, None)
        return True

    def _once(self, name: str, kind: Literal["waiting", "left"], message: str) -> Iterator[Event]:
        if f"{name}\n{message}" not in self._told:
            self._told.add(f"{name}\n{message}")
            yield Event(kind, name, message)


def _fitting(folder: Path, name: str, end: str) -> Path:
    """Return a path for a name with another end, cut so that file systems take it."""
    room = _LONGEST_NAME - len(os.fsencode(end))
    return folder / (os.fsencode(Path(name).stem)[:room].decode(errors="ignore") + end)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
