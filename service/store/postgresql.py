"""Connections to PostgreSQL that limit the time to wait for the server."""

from __future__ import annotations

from typing import Any, Final

import psycopg
from psycopg import errors

ANSWER_SECONDS: Final = 5.5
"""Time to wait for an answer [s]: a little more than the time after which the server ends a statement."""


class SilentServerError(psycopg.OperationalError):
    """The server did not answer in time."""


class PatientConnection(psycopg.Connection[Any]):
    """A connection that is closed once the server has not answered for `ANSWER_SECONDS`."""

    def wait(self, gen: Any, interval: float = 0.1, timeout: float | None = None) -> Any:  # noqa: ANN401 - as psycopg has it
        """Wait for the server's answer, by default for `ANSWER_SECONDS`; close the connection if none comes.

        Raises:
            SilentServerError: the server did not answer in time.
        """
        try:
            return super().wait(gen, interval, ANSWER_SECONDS if timeout is None else timeout)
        except errors._WaitTimeout as error:  # psycopg raises it from `wait`, and has no public name for it
            self.close()
            raise SilentServerError(f"no answer within {ANSWER_SECONDS:g} s") from error
