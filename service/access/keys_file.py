"""A file of keys, for containers that get it as a secret: hashes only, so that reading it opens nothing."""

from __future__ import annotations

import fcntl
import json
import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, fields, replace
from datetime import datetime
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import AwareDatetime, Field, ValidationError

from jointstiff.schemas.access import KeyId, Role
from jointstiff.schemas.fields import Message, Name
from jointstiff.service.problems.errors import NotFoundError, ServiceError
from jointstiff.service.store.access import KEY
from jointstiff.service.store.records import AccessKey

MAX_BYTES: Final = 1024 * 1024
_STORED: Final = tuple(field.name for field in fields(AccessKey) if field.name != "last_used_at")


class KeysFileError(ServiceError):
    """A file of keys that cannot be read or written."""

    def __init__(self, path: Path, reason: object) -> None:
        super().__init__(
            f"the file of keys {path} cannot be used: {reason}",
            "write it with `jointstiff keys create NAME --role ROLE --keys-file FILE`",
        )


class _Entry(Message):
    id: KeyId
    name: Name
    role: Role
    key_hash: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    created_at: AwareDatetime
    expires_at: AwareDatetime | None
    revoked_at: AwareDatetime | None


class _Document(Message):
    format: Literal["jointstiff-keys-1"] = "jointstiff-keys-1"
    keys: list[_Entry]


class KeysFile:
    """The keys in a file."""

    def __init__(self, path: Path) -> None:
        """Use a file, which need not be there yet to be written."""
        self._path = path

    def all(self) -> list[AccessKey]:
        """Return all keys, revoked ones too.

        Raises:
            KeysFileError: the file is not there, or not such a file.
        """
        try:
            with self._path.open("rb") as file:
                if os.fstat(file.fileno()).st_mode & stat.S_IWOTH:
                    raise KeysFileError(self._path, "every user can write to it; correct this with chmod o-w")
                content = file.read(MAX_BYTES + 1)
            if len(content) > MAX_BYTES:
                raise KeysFileError(self._path, f"it exceeds {MAX_BYTES // 1024} KiB")
            document = _Document.model_validate_json(content)
        except OSError as error:
            raise KeysFileError(self._path, error.strerror) from error
        except ValidationError as error:
            raise KeysFileError(self._path, "its content is not a file of keys") from error
        if len({entry.id for entry in document.keys}) < len(document.keys):
            raise KeysFileError(self._path, "an id occurs twice")
        return [AccessKey(**entry.model_dump(), last_used_at=None) for entry in document.keys]

    def add(self, key: AccessKey) -> None:
        """Add a key, to a new file if there is none.

        Raises:
            KeysFileError: the file cannot be read or written.
        """
        with self._turn():
            self._write([*(self.all() if self._path.exists() else []), key])

    def revoke(self, key_id: str, now: datetime) -> AccessKey:
        """Revoke a key for good; return it.

        Raises:
            KeysFileError: the file cannot be read or written.
            NotFoundError: there is no such key.
        """
        with self._turn():
            keys = {key.id: key for key in self.all()}
            if key_id not in keys:
                raise NotFoundError(KEY, key_id)
            keys[key_id] = replace(keys[key_id], revoked_at=keys[key_id].revoked_at or now)
            self._write(list(keys.values()))
        return keys[key_id]

    @contextmanager
    def _turn(self) -> Iterator[None]:
        """Hold a lock on the folder: of two who change the file, each finds what the other wrote."""
        try:
            folder = os.open(self._path.parent, os.O_RDONLY)
        except OSError as error:
            raise KeysFileError(self._path, error.strerror) from error
        try:
            fcntl.flock(folder, fcntl.LOCK_EX)
            yield
        finally:
            os.close(folder)

    def _write(self, keys: list[AccessKey]) -> None:
        """Replace the file at once: a service that reads it meanwhile finds the old or the new one."""
        entries = [{name: asdict(key)[name] for name in _STORED} for key in keys]
        text = json.dumps(
            _Document.model_validate({"keys": entries}).model_dump(mode="json"), indent=1, ensure_ascii=False
        )
        _replace(self._path, lambda file: file.write_text(text + "\n", encoding="utf-8"))


def _replace(path: Path, write: Callable[[Path], object]) -> None:
    try:
        mode = path.stat().st_mode & 0o777 if path.exists() else 0o600
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        os.close(descriptor)
        written = Path(name)
        try:
            write(written)
            written.chmod(mode)
            written.replace(path)
        finally:
            written.unlink(missing_ok=True)
    except OSError as error:
        raise KeysFileError(path, error.strerror) from error
