"""The state that /health and /ready answer from, which a thread of its own renews."""

from __future__ import annotations

import logging
import threading
import time
from typing import Final, Literal, NamedTuple

from anyio.to_thread import run_sync

from jointstiff.service.access.keyring import Keyring
from jointstiff.service.problems.errors import StoreError, StoreUnavailableError
from jointstiff.service.store.jobs import SILENT
from jointstiff.service.store.store import Store

LOOK_SECONDS: Final = 0.5
"""Pause between two looks at the database."""
STALE_SECONDS: Final = 10.0
"""A look that takes longer counts as a database that does not answer."""
PROOF_SECONDS: Final = 2.0
"""Pause between two proofs that the database can be written."""
STALE_PROOF_SECONDS: Final = 30.0
"""A proof that takes longer counts as a database that cannot be written."""
_GOODBYE_SECONDS: Final = 1.0
"""For a look or proof under way at the end."""

_logger = logging.getLogger(__name__)


class Seen(NamedTuple):
    """Outcome of a look."""

    at: float  # monotonic time of its end [s]
    workers: int = 0  # number of living workers
    database: Literal["sqlite", "postgresql"] = "sqlite"  # which one it is
    stored_bytes: int = 0  # size of the database
    error: StoreError | None = None  # why there is no answer


class Watch:
    """Look at the database in a thread of its own, so that who asks for the health never waits for work.

    Used as a context manager, it looks until the block ends; before and after that each question is a look.
    """

    def __init__(self, store: Store, keyring: Keyring | None = None) -> None:
        """Watch the database of a store.

        Args:
            store: which stays the caller's to close.
            keyring: to keep up to date, so that a key that was revoked is refused after the next look.
        """
        self._store = store
        self._keyring = keyring
        self._seen: Seen | None = None
        self._unwritable: StoreError | None = None
        self._proved = 0.0
        self._ended = threading.Event()

    @property
    def quota_bytes(self) -> int | None:
        """Return the size that the database may have; None for any."""
        return self._store.quota.most

    def __enter__(self) -> Watch:
        self._ended.clear()
        self._seen = self._look()
        self._proved = time.monotonic()
        self._threads = [
            threading.Thread(target=act, daemon=True) for act in (self._renew, self._prove_again)
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        for thread in self._threads:  # one in the middle of a look would use a store that is closed
            thread.join(_GOODBYE_SECONDS)
        self._seen = None

    def seen(self) -> Seen | None:
        """Return the outcome of the last look; None if there was none yet."""
        return self._seen

    async def latest(self) -> Seen:
        """Return the outcome of the last look.

        Raises:
            StoreError: the database did not answer the last look, or has not for `STALE_SECONDS`.
        """
        seen = self._seen
        if seen is None:
            seen = await run_sync(self._look)
        if seen.error is not None:
            raise seen.error.with_traceback(None)
        if time.monotonic() - seen.at > STALE_SECONDS:
            raise StoreUnavailableError("the database is slow to answer", "try again; look at its server")
        return seen

    async def writable(self) -> Seen:
        """Return the outcome of the last look, if the database could be written of late.

        Raises:
            StoreError: the database did not answer the last look, or could not be written.
        """
        seen = await self.latest()
        if self._seen is None:
            await run_sync(self._prove)
        if self._unwritable is not None:
            raise self._unwritable.with_traceback(None)
        if self._seen is not None and time.monotonic() - self._proved > STALE_PROOF_SECONDS:
            raise StoreUnavailableError(
                "a write to the database does not finish", "find the program that locks it"
            )
        return seen

    def _prove_again(self) -> None:
        while not self._ended.wait(PROOF_SECONDS):
            self._prove()

    def _prove(self) -> None:
        """Write: a file that can be read only, or a standby server, answers every look."""
        try:
            self._store.heartbeats.prove()
        except StoreError as error:
            self._unwritable = error
        except Exception:
            _logger.exception("unexpected failure of a write to the database")
            self._unwritable = StoreUnavailableError("a write to the database failed", "see the log")
        else:
            self._unwritable = None
        self._proved = time.monotonic()

    def _renew(self) -> None:
        while not self._ended.wait(LOOK_SECONDS):
            seen = self._look()
            if not self._ended.is_set():
                self._seen = seen

    def _look(self) -> Seen:
        try:
            database = self._store.ping()
            if self._keyring is not None:
                self._keyring.look()
            workers = len(self._store.heartbeats.living(SILENT))
            stored = self._store.quota.used()
        except StoreError as error:
            return Seen(time.monotonic(), error=error)
        except Exception:  # the thread has to go on; it may work again at the next look
            if self._seen is None or self._seen.error is None:  # not at each look again
                _logger.exception("unexpected failure of a check of the database")
            failed = StoreUnavailableError("the check of the database failed", "try again; see the log")
            return Seen(time.monotonic(), error=failed)
        return Seen(time.monotonic(), workers, database, stored)
