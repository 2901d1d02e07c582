"""The keys that open the service, kept in memory: a request looks nothing up in the database."""

from __future__ import annotations

import hmac
import logging
import threading
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Final, cast

from jointstiff.schemas.access import Key, Role
from jointstiff.service.access.key_text import digest, id_in, mint_token
from jointstiff.service.access.keys_file import KeysFile, KeysFileError
from jointstiff.service.problems.errors import KeyRefusedError
from jointstiff.service.store.records import AccessKey
from jointstiff.service.store.store import Store

_NOBODY: Final = digest(mint_token("jst"))
"""Hash that a key of unknown id is compared with: the answer takes as long."""
_REMEDY: Final = "use another key; create one with `jointstiff keys create NAME --role ROLE`"
_NONE: Final[Mapping[str, AccessKey]] = MappingProxyType({})

_logger = logging.getLogger(__name__)


class Keyring:
    """The keys of a store and of a file, as they were last looked at."""

    def __init__(self, store: Store, file: Path | None = None) -> None:
        """Know no key until `look` is called.

        Args:
            store: its keys open the service.
            file: and those of this file, if there is one.
        """
        self._store = store
        self._file = None if file is None else KeysFile(file)
        self._stored = _NONE
        self._filed = _NONE
        self._gone: set[str] = set()
        self._is_broken = False
        self._looking = threading.Lock()

    def look(self) -> None:
        """Look at the keys again. A file that is gone or became unreadable has no keys.

        Raises:
            StoreError: the database does not answer.
        """
        with self._looking:  # a look that began before a change must not end after one that saw it
            if self._file is not None:
                before, self._filed = self._live(), self._in_file(self._file)
                self._gone |= before - self._live()
                if self._gone:  # their sessions and links must not come to life again with the file
                    self._store.sessions.end_of(sorted(self._gone))
                    self._gone.clear()
            self._stored = {key.id: key for key in self._store.keys.all()}

    def _live(self) -> set[str]:
        """Return the ids of the keys in the file that open the service."""
        now = datetime.now(UTC)
        return {key.id for key in self._filed.values() if key.is_live(now)}

    def _in_file(self, file: KeysFile) -> Mapping[str, AccessKey]:
        try:
            filed = {key.id: key for key in file.all()}
            self._is_broken = False
        except KeysFileError as error:
            filed = {}  # who takes the file away takes its keys away
            if not self._is_broken:  # not at each look again
                _logger.error("%s", error.reason)  # noqa: TRY400 - the reason is all there is
            self._is_broken = True
        return filed

    def open_file(self) -> None:
        """Read the file of keys for the first time.

        Raises:
            KeysFileError: there is no such file, or it is none.
        """
        if self._file is not None:
            self._filed = {key.id: key for key in self._file.all()}

    def has_keys(self) -> bool:
        """Return whether any key opens the service now."""
        now = datetime.now(UTC)
        return any(key.is_live(now) for key in (*self._stored.values(), *self._filed.values()))

    def find(self, key_id: str) -> AccessKey | None:
        """Return a key that opens the service now; None if it does not, or no longer."""
        key = self._known(key_id)
        return key if key is not None and key.is_live(datetime.now(UTC)) else None

    def check(self, text: str) -> AccessKey:
        """Return the key of a text.

        Raises:
            KeyRefusedError: it is mistyped, or unknown, or no longer taken.
        """
        key = self._known(id_in(text))
        is_right = hmac.compare_digest(digest(text), _NOBODY if key is None else key.key_hash)
        if key is None or not is_right:
            raise KeyRefusedError("the key is not one of this service", _REMEDY)
        if key.revoked_at is not None:
            raise KeyRefusedError("the key was revoked", _REMEDY)
        if not key.is_live(datetime.now(UTC)):
            raise KeyRefusedError("the key has expired", _REMEDY)
        return key

    def listing(self) -> list[Key]:
        """Return all keys, revoked ones too, without their secrets."""
        filed = [described(key, is_filed=True) for key in self._filed.values()]
        return [*(described(key) for key in self._stored.values()), *filed]

    def is_filed(self, key_id: str) -> bool:
        """Return whether a key stands in the file."""
        return key_id in self._filed

    def _known(self, key_id: str) -> AccessKey | None:
        """Return a key; what the file says of an id counts, as it is the operator's."""
        return self._filed.get(key_id) or self._stored.get(key_id)


def described(key: AccessKey, *, is_filed: bool = False) -> Key:
    """Return a key as it is shown, without its secret."""
    return Key(
        id=key.id,
        name=key.name,
        role=cast("Role", key.role),
        source="file" if is_filed else "database",
        created_at=key.created_at,
        expires_at=key.expires_at,
        revoked_at=key.revoked_at,
        last_used_at=key.last_used_at,
    )
