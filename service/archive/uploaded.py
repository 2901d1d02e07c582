"""Restoring of an uploaded archive, which may be hostile, in a process of limited memory and time.

The service starts the process as `python -P -m jointstiff.service.archive.uploaded FILE`. The process writes
a report of JSON in a line after each portion; the last line is the outcome.
"""

from __future__ import annotations

import os
import resource
import sys
import time
from pathlib import Path
from typing import Final

from pydantic import BaseModel, ConfigDict, Field

from jointstiff.service.archive.restoring import Restored, restore_archive
from jointstiff.service.problems import StoreError
from jointstiff.service.workers.supervisor import DATABASE_VARIABLE

DRY_RUN: Final = "--dry-run"
MOST_MEMORY: Final = 1024**3
"""Memory of the process, in addition to its memory at the start [bytes]."""
MOST_SECONDS: Final = 3600
"""Processor time of the process [s]."""
AT_TERMINAL: Final = ("access_keys", "audit")
"""Tables that only `jointstiff restore` restores: an upload adds no key, and no audit."""
_PAUSE_SECONDS: Final = 0.3  # between two reports


class TableReport(BaseModel):
    """Numbers of the lines of a table, and reasons for the first lines that cannot be stored."""

    model_config = ConfigDict(from_attributes=True, frozen=True)

    lines: int
    added: int
    present: int
    refused: int
    omitted: int
    reasons: list[str]


class Report(BaseModel):
    """State of a restore."""

    done: bool = False
    layout: str = ""
    tables: dict[str, TableReport] = Field(default_factory=dict)
    dropped: dict[str, int] = Field(default_factory=dict)  # field without a place → number of documents
    left_out: dict[str, int] = Field(default_factory=dict)  # table restored at the terminal → number of lines
    reason: str | None = None  # why the restore ended early
    remedy: str | None = None


def make_report(restored: Restored, *, done: bool) -> Report:
    """Return the report of an outcome."""
    tables = {name: TableReport.model_validate(outcome) for name, outcome in restored.tables.items()}
    return Report(
        done=done,
        layout=restored.layout,
        tables=tables,
        dropped=dict(restored.dropped),
        left_out=restored.left_out,
    )


def restore_uploaded(path: Path, url: str, *, dry_run: bool) -> Report:
    """Restore an archive, print a report after each portion, and return the last report."""
    last_report_at = 0.0

    def watch(restored: Restored) -> None:
        """Print a report, unless the last one is recent."""
        nonlocal last_report_at
        if time.monotonic() - last_report_at > _PAUSE_SECONDS:
            _print_report(make_report(restored, done=False))
            last_report_at = time.monotonic()

    try:
        restored = restore_archive(
            path, url, dry_run=dry_run, without=AT_TERMINAL, name="the file", watch=watch
        )
    except StoreError as error:
        return Report(reason=error.reason, remedy=error.remedy)
    return make_report(restored, done=True)


def _print_report(report: Report) -> None:
    """Write a report in a line."""
    sys.stdout.write(f"{report.model_dump_json()}\n")
    sys.stdout.flush()


def _limit_process() -> None:
    """Limit the memory and the processor time of this process."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
    most_memory = pages * resource.getpagesize() + MOST_MEMORY
    resource.setrlimit(resource.RLIMIT_DATA, (most_memory, most_memory))
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_SECONDS, MOST_SECONDS))


if __name__ == "__main__":
    _limit_process()
    file, *options = sys.argv[1:]
    _print_report(restore_uploaded(Path(file), os.environ[DATABASE_VARIABLE], dry_run=DRY_RUN in options))
