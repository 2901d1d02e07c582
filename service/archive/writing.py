"""Writing of archives, of databases of every layout from 0018 on; the database is not changed."""

from __future__ import annotations

import hashlib
import os
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal

from pydantic_core import from_json

from jointstiff.service.archive import form
from jointstiff.service.archive.arrays import describe_arrays
from jointstiff.service.archive.form import FileEntry, Manifest, file_of, to_line
from jointstiff.service.history.steps import OLDEST
from jointstiff.service.problems import DamagedError, StoreError
from jointstiff.service.process import jointstiff_version
from jointstiff.service.store.compression import decompress
from jointstiff.service.store.documents import read_text
from jointstiff.service.store.layouts import LAYOUT, SCHEMA, can_archive, number_of
from jointstiff.service.store.snapshot import Snapshot, read_snapshot

Keys = Literal["none", "names", "hashes"]
"""What an archive has of access keys: nothing; names, roles and times; also the hashes, which open."""

_LEVEL: Final = 3  # of compression: level 6 takes twice the time for a twentieth of the size
_DOCUMENTS: Final = frozenset({"document", "resolved", "warnings", "campaign", "stated", "events"})
"""Columns of texts that are JSON."""


@dataclass
class Archived:
    """Outcome of an archive."""

    manifest: Manifest
    damaged: list[str] = field(default_factory=list)  # rows that could not be read, a sentence each


def write_archive(
    url: str, path: Path, keys: Keys = "names", notify: Callable[[str], object] = lambda _: None
) -> Archived:
    """Write all records of a database to a zip file.

    Args:
        url: URL of the database, of any layout from 0018 on.
        path: file to write; it must not exist.
        keys: what the archive has of access keys.
        notify: function that is called with a sentence for each file.

    Returns:
        The manifest, and what could not be read.

    Raises:
        StoreError: the file exists, or the database has no layout that can be archived.
        OSError: the file cannot be written.
    """
    if path.exists():
        raise StoreError(f"{path} exists already", "give the name of a new file")
    part = path.with_name(f"{path.name}.part")
    try:
        with read_snapshot(url, form.RESTORED) as snapshot:
            _refuse_unknown_layout(snapshot.layout)
            descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            with os.fdopen(descriptor, "wb") as target:
                archived = _write_zip(target, snapshot, keys, notify)
                target.flush()
                os.fsync(target.fileno())
        part.rename(path)
    except BaseException:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise
    return archived


def _refuse_unknown_layout(layout: str) -> None:
    """Refuse a database whose layout is older than the oldest, or newer than that of this program."""
    if not can_archive(layout):
        raise StoreError(
            f"the database has layout {layout}, but this version archives only layouts {OLDEST:04} to "
            f"{LAYOUT}",
            "archive the database with the version of Jointstiff that wrote it, or a newer one",
        )


def _write_zip(target: BinaryIO, snapshot: Snapshot, keys: Keys, notify: Callable[[str], object]) -> Archived:
    """Write the zip file; return its manifest and what could not be read."""
    damaged = list[str]()
    files = dict[str, FileEntry]()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED, compresslevel=_LEVEL) as file:
        for table in snapshot.tables:
            if keys == "none" and table == "access_keys":
                continue
            entry = _write_table(file, snapshot, table, keys, damaged)
            files[file_of(table)] = entry
            notify(f"{table}: {entry.lines}")
        manifest = Manifest(
            format=form.FORMAT,
            format_version=form.FORMAT_VERSION,
            layout=snapshot.layout,
            program=jointstiff_version(),
            files=files,
        )
        file.writestr(_name_entry(form.MANIFEST), manifest.model_dump_json(indent=1))
    return Archived(manifest, damaged)


def _write_table(
    file: zipfile.ZipFile, snapshot: Snapshot, table: str, keys: Keys, damaged: list[str]
) -> FileEntry:
    """Write the rows of a table as a file of lines; sentences about unreadable rows go into `damaged`."""
    digest, lines, size = hashlib.sha256(), 0, 0
    with file.open(_name_entry(file_of(table)), "w", force_zip64=True) as target:
        for line in _make_lines(snapshot, table, keys, damaged):
            target.write(line)
            digest.update(line)
            lines += 1
            size += len(line)
    return FileEntry(lines=lines, bytes=size, sha256=digest.hexdigest())


def _name_entry(name: str) -> zipfile.ZipInfo:
    """Return an entry of a zip file without the time of writing: equal rows give equal files."""
    entry = zipfile.ZipInfo(name)
    entry.compress_type = zipfile.ZIP_DEFLATED
    entry.external_attr = 0o600 << 16
    return entry


def _make_lines(snapshot: Snapshot, table: str, keys: Keys, damaged: list[str]) -> Iterator[bytes]:
    """Yield a line for each row of a table."""
    version = find_version(snapshot.layout)
    secret = "key_hash" if table == "access_keys" and keys == "names" else None
    for row in snapshot.rows(table):
        try:
            yield make_line(table, row, version, secret)
        except (DamagedError, ValueError) as error:
            damaged.append(f"{table}: {name_row(row)} cannot be read ({error})")


def find_version(layout: str) -> int:
    """Return the version of the documents of a layout; a later layout may have changed none of them."""
    return min(number_of(layout), SCHEMA)


def name_row(row: Mapping[str, Any]) -> str:
    """Return the id of a row for people; of an entry of a live campaign, the id of the campaign."""
    return str(row.get("id", row.get("set_id", "a row")))


def make_line(table: str, row: Mapping[str, Any], version: int, secret: str | None = None) -> bytes:
    """Return the line of a row: its columns that are not null, with documents as JSON.

    Args:
        table: name of the table.
        row: column → value.
        version: version of the documents, if the row does not state it.
        secret: name of a column that is left out.

    Raises:
        DamagedError: compressed content is damaged.
        ValueError: a document is no JSON, or the readings are damaged.
    """
    values: dict[str, Any] = {"schema": version}  # rows of layouts before 0019 do not state it
    for name, value in sorted(row.items(), key=_place_of_column):
        is_archived = value is not None and name not in form.DERIVED and name != secret
        if is_archived:
            values[name] = _convert_value(name, value)
    if table == "jobs":
        _queue_again(values)
    return to_line(values)


def _place_of_column(item: tuple[str, Any]) -> tuple[bool, bool, str]:
    """Return the place of a column in a line: the id first, documents last, the others by their names.

    Databases that were upgraded have their columns in another order than new ones.
    """
    name, _ = item
    return name in ("document", "arrays"), name != "id", name


def _convert_value(name: str, value: Any) -> Any:  # noqa: ANN401 - any type of the drivers
    """Return the value of a column as JSON has it."""
    if isinstance(value, datetime):
        aware = value.astimezone(UTC) if value.tzinfo else value.replace(tzinfo=UTC)
        return aware.isoformat()
    if isinstance(value, bytes | memoryview):
        content = bytes(value)
        if name == "arrays":
            return describe_arrays(content if content.startswith(b"PK") else decompress(content))
        return from_json(read_text(content))
    if isinstance(value, str) and name in _DOCUMENTS and value:
        return from_json(value)
    return value


def _queue_again(job: dict[str, Any]) -> None:
    """Let a running job be a queued one: its steps are not archived, and workers begin it anew."""
    if job["state"] != "running":
        return
    document = job["document"]
    job["state"] = document["state"] = "queued"
    document["provenance"]["started_at"] = None
    if document.get("progress") is not None:
        document["progress"]["done"] = 0
