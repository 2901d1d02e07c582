"""Keys: their text, the file in which a container may get them, and the ring of keys that open the service.

The text of a key is `jst_<id>_<256 random bits>_<crc32>`. The check sum shows that a key is mistyped, without
reading any stored key; the check sum is no secret. Only hashes of keys are stored, and nobody can sign in
with a hash.
"""

from __future__ import annotations

import fcntl
import hashlib
import hmac
import json
import logging
import os
import re
import secrets
import stat
import string
import tempfile
import threading
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Final, Literal, NamedTuple

from pydantic import AwareDatetime, Field, ValidationError

from jointstiff.schemas.access import Key, KeyId, Role
from jointstiff.schemas.fields import Message, Name
from jointstiff.service.problems import KeyRefusedError, NotFoundError, ServiceError
from jointstiff.service.store.access import KEY
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import AccessKey

_ALPHABET: Final = string.ascii_letters + string.digits
"""62 characters: a double click selects the whole key."""
_LENGTH: Final = 43
"""Number of random characters in a key: 62^43 > 2^256."""
_KEY_FORM: Final = re.compile(r"(jst_([0-9a-f]{10})_[A-Za-z0-9]{43})_([0-9a-f]{8})", re.ASCII)
_SECRETS: Final = re.compile(r"(jst|jsl)_[A-Za-z0-9_%-]*", re.ASCII)
_REMEDY: Final = (
    "copy the whole key, from jst_ to the last character; the key was shown once, when it was created"
)
MAX_FILE_BYTES: Final = 1024 * 1024
_FIELDS_IN_FILE: Final = tuple(field.name for field in fields(AccessKey) if field.name != "last_used_at")
_OTHER_KEY: Final = "use another key; create one with `jointstiff keys create NAME --role ROLE`"
_NO_KEYS: Final[Mapping[str, AccessKey]] = MappingProxyType({})

_logger = logging.getLogger(__name__)


class NewKey(NamedTuple):
    """A new key."""

    text: str  # secret text of the key, which only its holder keeps
    record: AccessKey  # record of the key for the store, which has only a hash of the text


def make_key(name: str, role: Role, now: datetime, expires_at: datetime | None) -> NewKey:
    """Make a new random key; return its secret text, for its holder, and its record, for the store."""
    key_id = secrets.token_hex(5)
    body = f"jst_{key_id}_{_random_text()}"
    text = f"{body}_{_checksum(body)}"
    record = AccessKey(
        id=key_id,
        name=name,
        role=role,
        key_hash=hash_secret(text),
        created_at=now,
        expires_at=expires_at,
        revoked_at=None,
        last_used_at=None,
    )
    return NewKey(text, record)


def make_secret_token(kind: str) -> str:
    """Return a new secret of a session or of a link: `kind`, an underscore, and 256 random bits as text."""
    return f"{kind}_{_random_text()}"


def parse_key_id(text: str) -> str:
    """Return the id in the text of a key.

    Raises:
        KeyRefusedError: the text has not the form of a key, or its check sum does not fit.
    """
    match = _KEY_FORM.fullmatch(text)
    if match is None:
        raise KeyRefusedError("the text sent is not a key", _REMEDY)
    body, key_id, checksum = match.groups()
    if _checksum(body) != checksum:
        raise KeyRefusedError("the key is mistyped: its check sum does not fit", _REMEDY)
    return key_id


def hash_secret(text: str) -> str:
    """Return the SHA-256 of a secret text (key, session or link) in hexadecimal; only this hash is stored.

    A fast hash is enough: unlike a password that a person chooses, 256 random bits cannot be guessed.
    """
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def hide_secrets(text: str) -> str:
    """Return a text with the secrets of keys and links replaced by `…`, for logs and the audit."""
    return _SECRETS.sub(r"\1_…", text)


def _random_text() -> str:
    """Return 43 random letters and digits: 256 random bits."""
    return "".join(secrets.choice(_ALPHABET) for _ in range(_LENGTH))


def _checksum(body: str) -> str:
    """Return the CRC-32 of a key's text without its check sum, as 8 hexadecimal digits."""
    return f"{zlib.crc32(body.encode()):08x}"


_HASH_OF_NO_KEY: Final = hash_secret(make_secret_token("jst"))
"""Hash with which a key of unknown id is compared, so that refusing the key takes as long as if the id were
known."""


class KeysFileError(ServiceError):
    """A file of keys that cannot be read or written."""

    def __init__(self, path: Path, reason: object) -> None:
        super().__init__(
            f"the file of keys {path} cannot be used: {reason}",
            "write the file with `jointstiff keys create NAME --role ROLE --keys-file FILE`",
        )


class _Entry(Message):
    """A key in a file of keys."""

    id: KeyId
    name: Name
    role: Role
    key_hash: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    created_at: AwareDatetime
    expires_at: AwareDatetime | None
    revoked_at: AwareDatetime | None


class _Document(Message):
    """Content of a file of keys."""

    format: Literal["jointstiff-keys-1"] = "jointstiff-keys-1"
    keys: list[_Entry]


class KeysFile:
    """A file of keys, which commands write and the service reads."""

    def __init__(self, path: Path) -> None:
        """Use the file at a path; it may be missing until a key is added."""
        self._path = path

    def all(self) -> list[AccessKey]:
        """Return all keys of the file, revoked keys included.

        Raises:
            KeysFileError: the file is missing, too large, writable for everyone, or not a file of keys.
        """
        try:
            with self._path.open("rb") as file:
                if os.fstat(file.fileno()).st_mode & stat.S_IWOTH:
                    raise KeysFileError(
                        self._path, "every user can write to the file; correct this with chmod o-w"
                    )
                content = file.read(MAX_FILE_BYTES + 1)
            if len(content) > MAX_FILE_BYTES:
                raise KeysFileError(self._path, f"the file exceeds {MAX_FILE_BYTES // 1024} KiB")
            document = _Document.model_validate_json(content)
        except OSError as error:
            raise KeysFileError(self._path, error.strerror) from error
        except ValidationError as error:
            raise KeysFileError(self._path, "the content is not a file of keys") from error
        if len({entry.id for entry in document.keys}) < len(document.keys):
            raise KeysFileError(self._path, "two keys have the same id")
        return [AccessKey(**entry.model_dump(), last_used_at=None) for entry in document.keys]

    def add(self, key: AccessKey) -> None:
        """Add a key to the file, which is created if it is missing.

        Raises:
            KeysFileError: the file cannot be read or written.
        """
        with self._file_lock():
            self._replace_keys([*(self.all() if self._path.exists() else []), key])

    def revoke(self, key_id: str, now: datetime) -> AccessKey:
        """Revoke a key for good; return the revoked key.

        Raises:
            KeysFileError: the file cannot be read or written.
            NotFoundError: there is no such key.
        """
        with self._file_lock():
            keys = {key.id: key for key in self.all()}
            if key_id not in keys:
                raise NotFoundError(KEY, key_id)
            # A key that was revoked before keeps the time of its first revocation.
            keys[key_id] = replace(keys[key_id], revoked_at=keys[key_id].revoked_at or now)
            self._replace_keys(list(keys.values()))
        return keys[key_id]

    @contextmanager
    def _file_lock(self) -> Iterator[None]:
        """Hold a lock on the file's folder, so that processes do not overwrite each other's changes."""
        try:
            folder = os.open(self._path.parent, os.O_RDONLY)
        except OSError as error:
            raise KeysFileError(self._path, error.strerror) from error
        try:
            fcntl.flock(folder, fcntl.LOCK_EX)
            yield
        finally:
            os.close(folder)

    def _replace_keys(self, keys: list[AccessKey]) -> None:
        """Write keys to the file in place of its content, in one step.

        Another process reads either the old or the new content, never a part.
        """
        entries = [{name: asdict(key)[name] for name in _FIELDS_IN_FILE} for key in keys]
        text = json.dumps(
            _Document.model_validate({"keys": entries}).model_dump(mode="json"), indent=1, ensure_ascii=False
        )
        path = self._path
        try:
            mode = path.stat().st_mode & 0o777 if path.exists() else 0o600
            descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
            os.close(descriptor)
            new_file = Path(name)
            try:
                new_file.write_text(text + "\n", encoding="utf-8")
                new_file.chmod(mode)
                new_file.replace(path)
            finally:
                new_file.unlink(missing_ok=True)
        except OSError as error:
            raise KeysFileError(path, error.strerror) from error


class Keyring:
    """Keys that open the service, read from the database and from a file by the last call of `read_keys`."""

    def __init__(self, store: Store, file: Path | None = None) -> None:
        """Create a ring without keys; `read_keys` reads the keys.

        Args:
            store: store whose keys open the service.
            file: path of a file whose keys open the service, too; None without a file.
        """
        self._store = store
        self._file = None if file is None else KeysFile(file)
        self._keys_in_store = _NO_KEYS  # id → key
        self._keys_in_file = _NO_KEYS  # id → key
        # Ids of keys that were removed from the file, and whose sessions have not been ended yet
        self._removed_ids: set[str] = set()
        self._is_file_broken = False  # True if the file could not be read the last time
        self._reading = threading.Lock()

    def read_keys(self) -> None:
        """Read the keys again, and end the sessions of keys that were removed from the file.

        A file that is missing or cannot be read is treated as a file without keys.

        Raises:
            StoreError: the database does not answer.
        """
        with self._reading:  # a call that began earlier must not overwrite the keys of a later call
            if self._file is not None:
                earlier_ids = self._valid_ids_in_file()
                self._keys_in_file = self._read_file(self._file)
                self._removed_ids |= earlier_ids - self._valid_ids_in_file()
                # Sessions are ended, because they would become valid again if the old file were restored.
                if self._removed_ids:
                    self._store.sessions.end_sessions_of_keys(sorted(self._removed_ids))
                    self._removed_ids.clear()
            self._keys_in_store = {key.id: key for key in self._store.keys.all()}

    def _valid_ids_in_file(self) -> set[str]:
        """Return the ids of the keys in the file that are valid now."""
        now = datetime.now(UTC)
        return {key.id for key in self._keys_in_file.values() if key.is_live(now)}

    def _read_file(self, file: KeysFile) -> Mapping[str, AccessKey]:
        """Return id → key of the file; if the file cannot be read, log this once and return no keys."""
        try:
            keys = {key.id: key for key in file.all()}
            self._is_file_broken = False
        except KeysFileError as error:
            keys = {}  # removing the file revokes its keys
            if not self._is_file_broken:
                _logger.error("%s", error.reason)  # noqa: TRY400 - the reason is all there is
            self._is_file_broken = True
        return keys

    def open_file(self) -> None:
        """Read the file of keys when the service starts; do nothing without a file.

        Unlike `read_keys`, this call fails if the file cannot be read.

        Raises:
            KeysFileError: the file is missing, or is not a file of keys.
        """
        if self._file is not None:
            self._keys_in_file = {key.id: key for key in self._file.all()}

    def has_keys(self) -> bool:
        """Return whether any key opens the service now."""
        now = datetime.now(UTC)
        return any(key.is_live(now) for key in (*self._keys_in_store.values(), *self._keys_in_file.values()))

    def find(self, key_id: str) -> AccessKey | None:
        """Return the key with an id if it is valid now; None if it is unknown, revoked or expired."""
        key = self._key_by_id(key_id)
        return key if key is not None and key.is_live(datetime.now(UTC)) else None

    def check(self, text: str) -> AccessKey:
        """Return the valid key with a secret text.

        Raises:
            KeyRefusedError: the key is mistyped, unknown, revoked or expired.
        """
        key = self._key_by_id(parse_key_id(text))
        stored_hash = _HASH_OF_NO_KEY if key is None else key.key_hash
        is_right = hmac.compare_digest(hash_secret(text), stored_hash)  # takes the same time for any text
        if key is None or not is_right:
            raise KeyRefusedError("the key does not belong to this service", _OTHER_KEY)
        if key.revoked_at is not None:
            raise KeyRefusedError("the key was revoked", _OTHER_KEY)
        if not key.is_live(datetime.now(UTC)):
            raise KeyRefusedError("the key has expired", _OTHER_KEY)
        return key

    def list_keys(self) -> list[Key]:
        """Return the API messages about all keys, revoked keys included, without secrets."""
        keys_in_file = [describe_key(key, is_in_file=True) for key in self._keys_in_file.values()]
        return [*(describe_key(key) for key in self._keys_in_store.values()), *keys_in_file]

    def is_in_file(self, key_id: str) -> bool:
        """Return whether the key with an id is in the file, not in the database."""
        return key_id in self._keys_in_file

    def _key_by_id(self, key_id: str) -> AccessKey | None:
        """Return the key with an id, from the file or else from the database; None if the id is unknown."""
        return self._keys_in_file.get(key_id) or self._keys_in_store.get(key_id)


def describe_key(key: AccessKey, *, is_in_file: bool = False) -> Key:
    """Return the API message about a key, without its secret.

    `is_in_file` is True for a key in the file of keys, False for a key in the database.
    """
    fields = {name: getattr(key, name) for name in Key.model_fields.keys() - {"source", "key"}}
    return Key(**fields, source="file" if is_in_file else "database")
