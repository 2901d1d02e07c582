"""Connections to PostgreSQL that do not wait for ever for a server."""

from __future__ import annotations

from typing import Any, Final

import psycopg
from psycopg import errors

ANSWER_SECONDS: Final = 5.5
"""Time for an answer [s]: a little more than the server has for a statement, as it may be frozen itself."""


class SilentServerError(psycopg.OperationalError):
    """The server did not answer in time."""


class PatientConnection(psycopg.Connection[Any]):
    """A connection that is closed once the server has not answered for `ANSWER_SECONDS`."""

    def wait(self, gen: Any, interval: float = 0.1, timeout: float | None = None) -> Any:  # noqa: ANN401 - as psycopg has it
        """Wait for an answer.

        Raises:
            SilentServerError: there was none in time.
        """
        try:
            return super().wait(gen, interval, ANSWER_SECONDS if timeout is None else timeout)
        except errors._WaitTimeout as error:  # psycopg raises it from `wait`, and has no public name for it
            self.close()
            raise SilentServerError(f"no answer within {ANSWER_SECONDS:g} s") from error
