"""Archives of a running service: its database as a stream, and restores of uploads by another process."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Final

from fastapi import HTTPException

from jointstiff.service.archive.uploaded import DRY_RUN, MOST_MEMORY, MOST_SECONDS, Report
from jointstiff.service.archive.writing import Archived, write_stream
from jointstiff.service.problems import StoreError
from jointstiff.service.process import build_own_command
from jointstiff.service.workers.supervisor import DATABASE_VARIABLE
from jointstiff.solver.errors import RequestError

_PIECE: Final = 64 * 1024  # bytes that are read at a time
_AT_TERMINAL: Final = "use `jointstiff archive` and `jointstiff restore` where the service runs"


class ServedArchives:
    """Archives of the database of a service; one at a time is written or restored."""

    def __init__(self, url: str, refuse_full: Callable[[], None]) -> None:
        """Serve a database.

        Args:
            url: URL of the database.
            refuse_full: function that raises an error if the database has reached its quota.
        """
        self._url, self._refuse_full = url, refuse_full
        self._turn = Lock()

    def stream(self) -> Iterator[bytes]:
        """Yield an archive without keys, while it is written.

        Raises:
            StoreError: the database cannot be archived, or has damaged records: the archive is incomplete.
        """
        with self._take_turn(), ThreadPoolExecutor(1) as writer:
            reading_end, writing_end = os.pipe()
            with os.fdopen(reading_end, "rb") as source:  # closed first, which ends the writer
                writing = writer.submit(self._write, writing_end)
                while piece := source.read1(_PIECE):
                    yield piece
            archived = writing.result()
        if archived.damaged:
            raise StoreError(
                f"the archive is incomplete: {'; '.join(archived.damaged[:3])}",
                "use `jointstiff archive` where the service runs, which leaves out damaged records",
            )

    def restore(self, path: Path, *, dry_run: bool) -> Iterator[bytes]:
        """Yield reports about the restore of a file, in lines of JSON.

        Raises:
            RequestError: the file is no archive, is damaged, or exceeds a limit. Nothing is stored then.
            QuotaError: the database has reached its quota.
        """
        if not dry_run:
            self._refuse_full()
        options = [DRY_RUN] if dry_run else []
        command = build_own_command("jointstiff.service.archive.uploaded", str(path), *options)
        environment = os.environ | {DATABASE_VARIABLE: self._url}
        with (
            self._take_turn(),
            subprocess.Popen(  # noqa: S603 - no part of the command comes from outside
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, env=environment
            ) as process,
        ):
            try:
                yield from _check_reports(process.stdout or iter(()))
            finally:
                process.kill()

    def _write(self, descriptor: int) -> Archived:
        """Write an archive to a pipe, and close it."""
        with os.fdopen(descriptor, "wb") as target:
            return write_stream(self._url, target, "none")

    @contextmanager
    def _take_turn(self) -> Iterator[None]:
        """Let one archive be written or restored in the block.

        Raises:
            HTTPException: another archive is being written or restored (503).
        """
        if not self._turn.acquire(blocking=False):
            raise HTTPException(
                503, "another archive is being written or restored; send the request again later"
            )
        try:
            yield
        finally:
            self._turn.release()


def _check_reports(lines: Iterator[bytes]) -> Iterator[bytes]:
    """Yield the reports of a process; add one if the process ended without an outcome.

    Raises:
        RequestError: the first report refuses the file.
    """
    report, is_first = Report(), True
    for line in lines:
        report = Report.model_validate_json(line)
        if is_first and report.reason is not None:
            raise RequestError(report.reason, remedy=report.remedy or _AT_TERMINAL, where="body")
        is_first = False
        yield line
    if report.done or report.reason is not None:
        return
    megabytes = MOST_MEMORY // 1024**2
    reason = f"the restore ended early: it may need more than {megabytes} MiB or {MOST_SECONDS} s"
    if is_first:
        raise RequestError(reason, remedy=_AT_TERMINAL, where="body")
    last_report = report.model_copy(update={"reason": reason, "remedy": _AT_TERMINAL})
    yield f"{last_report.model_dump_json()}\n".encode()
