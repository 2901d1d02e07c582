"""The form of an archive: its files, its manifest, and the limits of an archive that others may have made."""

from __future__ import annotations

from typing import Any, Final

from pydantic import BaseModel, ConfigDict, Field
from pydantic_core import to_json

FORMAT: Final = "jointstiff-archive"
FORMAT_VERSION: Final = 1
MANIFEST: Final = "manifest.json"

RESTORED: Final = (
    "robots",
    "measurement_sets",
    "open_sets",
    "live_entries",
    "jobs",
    "access_keys",
    "idempotency_keys",
    "audit",
)
"""Tables of an archive, in this order: a row comes after the rows to which it refers."""
LEFT_OUT: Final = frozenset(
    {
        *("alembic_version", "heartbeats", "job_steps", "wrong_keys", "bridges"),  # of the moment
        *("access_sessions", "access_links"),  # secrets
        "last_campaigns",  # derived from the rest
    }
)
"""Tables that an archive leaves out, as it does the tables of the queue: open jobs are queued anew."""
DERIVED: Final = frozenset(
    {"sequence", "words", "robot_name", "measurement_set_name", "summary", "trend", "numbers"}
)
"""Columns that an archive leaves out, because they are derived from documents and other rows."""

MOST_FILES: Final = 40
MOST_DIRECTORY_BYTES: Final = 64 * 1024
"""Greatest size of the directory of the zip file, and of the manifest [bytes]."""
MOST_LINES: Final = 20_000_000
"""Greatest number of lines of all files."""
MOST_LINE_BYTES: Final = 64 * 1024 * 1024
"""Greatest length of a line [bytes]; no request is half as large."""
MOST_BYTES: Final = 1024**4
"""Greatest size of all files, decompressed [bytes]."""
MOST_RATIO: Final = 200
"""Greatest ratio of the size of a file to its compressed size; a database of ours reaches about 20."""
SMALL_BYTES: Final = 1024 * 1024
"""Size of a file up to which its ratio is not limited [bytes]."""


class _Closed(BaseModel):
    """Base of the parts of a manifest."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class FileEntry(_Closed):
    """A file of an archive, as its manifest describes it."""

    lines: int = Field(ge=0)
    bytes: int = Field(ge=0)
    sha256: str = Field(pattern="^[0-9a-f]{64}$")


class Manifest(_Closed):
    """Description of an archive. Databases with equal rows have equal manifests, whatever their dialect."""

    format: str
    format_version: int
    layout: str = Field(max_length=32)
    program: str = Field(max_length=64)  # version of Jointstiff that wrote the archive
    files: dict[str, FileEntry]


def file_of(table: str) -> str:
    """Return the name of the file of a table."""
    return f"{table}.jsonl"


def to_line(values: dict[str, Any]) -> bytes:
    """Return a line of JSON; numbers are written as in stored documents, NaN and infinity as null."""
    return to_json(values, inf_nan_mode="null") + b"\n"
