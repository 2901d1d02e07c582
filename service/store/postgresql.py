"""Connections to PostgreSQL that limit the time to wait for the server, and whose lost sessions keep no lock.

A statement is sent as one message, a *simple query*. By the *extended* protocol it is several messages: a
session that is lost between two of them keeps its locks, and no timeout of the server ends the session.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from typing import Any, Final

import psycopg
from psycopg import errors
from psycopg.abc import Params, Query

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


_STATEMENTS_AT_ONCE: Final = 200  # of `executemany`, in one message


class SimpleCursor(psycopg.ClientCursor[Any]):
    """A cursor that sends every statement as a simple query.

    `psycopg.ClientCursor` does so for single statements; its `executemany` uses the extended protocol.
    """

    def executemany(self, query: Query, params_seq: Iterable[Params], *, returning: bool = False) -> None:
        """Carry out a statement with each of the parameters: many statements in one message.

        Outside a transaction, the statements of one message are a transaction. Afterwards `rowcount` is that
        of the first statement of the last message.

        Raises:
            psycopg.NotSupportedError: the rows of the statements are requested.
        """
        if returning:
            raise psycopg.NotSupportedError("statements that are carried out together return no rows")
        remaining = iter(params_seq)
        while portion := [self.mogrify(query, values) for values in islice(remaining, _STATEMENTS_AT_ONCE)]:
            self.execute("; ".join(portion))
