"""The size that a database may have; what is stored already, and the end of every job, is not refused."""

from __future__ import annotations

import threading
import time
from typing import Final

from sqlalchemy import text

from jointstiff.service.problems.errors import QuotaError
from jointstiff.service.store.database import Database

_FRESH_SECONDS: Final = 1.0
"""Validity of a size: a quota may be exceeded by what is posted in this time."""
_SIZES: Final = {
    # Pages that are free will be used again; the file itself does not shrink.
    "sqlite": "SELECT (page_count - freelist_count) * page_size "
    "FROM pragma_page_count, pragma_freelist_count, pragma_page_size",
    "postgresql": "SELECT pg_database_size(current_database())",
}


class Quota:
    """Size of a database beside the one it may have. Safe to use from several threads."""

    def __init__(self, database: Database, most: int | None = None) -> None:
        """Watch over a database.

        Args:
            database: which may be used by others, too.
            most: bytes that it may have; None for any number.
        """
        self.most = most  # bytes that it may have; None for any number
        self._database = database
        self._lock = threading.Lock()
        self._used, self._at = 0, -_FRESH_SECONDS

    def used(self) -> int:
        """Return the size of the database [bytes], as it was at most a second ago.

        Raises:
            StoreUnavailableError: there is no answer.
        """
        with self._lock:
            if time.monotonic() - self._at >= _FRESH_SECONDS:
                with self._database.reading() as connection:
                    self._used = int(connection.execute(text(_SIZES[self._database.dialect])).scalar_one())
                self._at = time.monotonic()
            return self._used

    def refuse_full(self) -> None:
        """Do nothing, unless the database has the size that it may have.

        Raises:
            QuotaError: it has.
            StoreUnavailableError: there is no answer.
        """
        if self.most is not None and (used := self.used()) >= self.most:
            raise QuotaError(used, self.most)
