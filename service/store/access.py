"""Access keys, counts of wrong keys, sessions of browsers, and links that begin one session each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from datetime import datetime, timedelta
from typing import Any, Final

import sqlalchemy as sa

from jointstiff.service.problems import NotFoundError, Resource
from jointstiff.service.store.database import Database, insert_unless_present
from jointstiff.service.store.tables import (
    AccessKey,
    SessionRecord,
    access_keys,
    access_links,
    access_sessions,
    select_fields_of,
    wrong_keys,
)

KEY: Final = Resource("key", "keys")
MINUTE: Final = timedelta(minutes=1)
"""Resolution of stored times of use: most requests need no write to the database."""
MOST_SESSIONS: Final = 100
"""Greatest number of sessions of one key; a further session ends the session with the oldest use."""

FORGET: Final = timedelta(seconds=6)
"""Time in which the count of wrong keys of a network falls by one."""
MOST_WRONG: Final = 20
"""Greatest count of wrong keys of a network; further wrong keys are not written to the database."""
MOST_NETWORKS: Final = 1_024
"""Greatest number of networks with a count; the networks counted longest ago are removed first."""

_KEYS: Final = select_fields_of(access_keys, AccessKey)
_SESSIONS: Final = select_fields_of(access_sessions, SessionRecord)


class AccessKeys:
    """The keys in a database. Safe to use from several threads."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, key: AccessKey) -> None:
        """Store a key."""
        self._database.change(sa.insert(access_keys).values(asdict(key)))

    def all(self) -> list[AccessKey]:
        """Return all access keys, revoked keys included, oldest first."""
        query = _KEYS.order_by(access_keys.c.created_at, access_keys.c.id)
        return [AccessKey(*row) for row in self._database.rows(query)]

    def revoke(self, key_id: str, now: datetime) -> AccessKey:
        """Revoke a key for good, end its sessions, and return the key; a repeated call changes nothing.

        Raises:
            NotFoundError: there is no such key.
        """
        is_key = access_keys.c.id == key_id
        revocation = (
            sa.update(access_keys).where(is_key, access_keys.c.revoked_at.is_(None)).values(revoked_at=now)
        )
        self._database.change(revocation, *_make_session_deletions([key_id]))
        for row in self._database.rows(_KEYS.where(is_key)):
            return AccessKey(*row)
        raise NotFoundError(KEY, key_id)

    def mark_used(self, key_id: str, now: datetime) -> None:
        """Store the time of the last use of a key, unless a later use is stored."""
        last = access_keys.c.last_used_at
        update = sa.update(access_keys).where(access_keys.c.id == key_id, sa.or_(last.is_(None), last < now))
        self._database.change(update.values(last_used_at=now))


class Sessions:
    """The sessions of browsers, and the links that begin them. Safe to use from several threads."""

    def __init__(self, database: Database, idle: timedelta, longest: timedelta) -> None:
        """Keep sessions in a database.

        Args:
            database: database that stores the sessions.
            idle: time after which an unused session ends.
            longest: time after which every session ends.
        """
        self._database = database
        self._idle = idle
        self._longest = longest

    def begin(self, session: SessionRecord) -> None:
        """Store a new session of a key; remove ended sessions, and the key's oldest sessions.

        A key keeps at most `MOST_SESSIONS` sessions, those that were used last.
        """
        columns = access_sessions.c
        kept_sessions = (
            sa.select(columns.token_hash)
            .where(columns.key_id == session.key_id)
            .order_by(columns.used_at.desc(), columns.token_hash)
            .limit(MOST_SESSIONS - 1)
        )
        self._database.change(
            sa.delete(access_sessions).where(~self._alive_condition(session.created_at)),
            sa.delete(access_sessions).where(
                columns.key_id == session.key_id, columns.token_hash.not_in(kept_sessions)
            ),
            sa.insert(access_sessions).values(asdict(session)),
        )

    def find(self, token_hash: str, now: datetime) -> SessionRecord | None:
        """Return the session of a token; None if there is no such session, or it has ended."""
        query = _SESSIONS.where(access_sessions.c.token_hash == token_hash, self._alive_condition(now))
        return next((SessionRecord(*row) for row in self._database.rows(query)), None)

    def mark_used(self, token_hash: str, now: datetime) -> None:
        """Store the time of the last use of a session, unless a later use is stored."""
        columns = access_sessions.c
        update = sa.update(access_sessions).where(columns.token_hash == token_hash, columns.used_at < now)
        self._database.change(update.values(used_at=now))

    def end(self, token_hash: str) -> None:
        """End the session of a token; a repeated call changes nothing."""
        self._database.change(sa.delete(access_sessions).where(access_sessions.c.token_hash == token_hash))

    def end_sessions_of_keys(self, key_ids: Sequence[str]) -> None:
        """End all sessions of some keys, and remove the links that can begin sessions of these keys."""
        self._database.change(*_make_session_deletions(key_ids))

    def offer(self, token_hash: str, key_id: str, now: datetime, ends_at: datetime) -> None:
        """Store a link that can begin one session of a key until `ends_at`; remove links that have ended.

        Only the hash of the link's token is stored.
        """
        link_row = {"token_hash": token_hash, "key_id": key_id, "ends_at": ends_at}
        removal_of_ended = sa.delete(access_links).where(access_links.c.ends_at <= now)
        self._database.change(removal_of_ended, sa.insert(access_links).values(link_row))

    def redeem(self, token_hash: str, now: datetime) -> str | None:
        """Remove a link, which can be used once, and return the id of its key; None for an invalid link.

        A link is invalid if it is unknown, was used before, or has ended.

        Of two simultaneous calls only the first returns the id.
        """
        links = access_links.c
        if not self._database.rows(sa.select(links.key_id).where(links.token_hash == token_hash)):
            return None  # an invalid link costs only a read, so that no writer has to wait
        removal = sa.delete(access_links).where(links.token_hash == token_hash)
        with self._database.writing() as connection:
            row = connection.execute(removal.returning(links.key_id, links.ends_at)).one_or_none()
        return str(row.key_id) if row is not None and now < row.ends_at else None

    def _alive_condition(self, now: datetime) -> sa.ColumnElement[bool]:
        """Return the SQL condition that a session has not ended at the time `now`."""
        columns = access_sessions.c
        return sa.and_(columns.used_at > now - self._idle, columns.created_at > now - self._longest)


def _make_session_deletions(key_ids: Sequence[str]) -> list[sa.Delete]:
    """Return the statements that delete all sessions of some keys, and their links."""
    return [sa.delete(table).where(table.c.key_id.in_(key_ids)) for table in (access_sessions, access_links)]


class WrongKeys:
    """Count of the wrong keys of each network, for all services of a database."""

    def __init__(self, database: Database, clock: Callable[[sa.Connection], datetime] | None = None) -> None:
        """Count in a database; `clock` returns the time on a connection, by default that of the database."""
        self._database = database
        self._now = clock or database.now

    def count(self, network: str) -> float:
        """Add one to the count of wrong keys of a network; return the count before.

        A count falls by one in every period `FORGET`.
        """
        count_query = sa.select(wrong_keys).where(wrong_keys.c.network == network)
        # Beyond the greatest count a wrong key costs only a read.
        with self._database.reading() as connection:
            count_before = self._read_present_count(connection, count_query)
        if count_before > MOST_WRONG - 1:
            return count_before
        with self._database.writing() as connection:
            now = self._now(connection)
            new_row = insert_unless_present(connection, wrong_keys).values(
                network=network, number=0.0, counted_at=now
            )
            if connection.execute(new_row).rowcount == 1:
                newest_networks = sa.select(wrong_keys.c.network).order_by(wrong_keys.c.counted_at.desc())
                is_kept = wrong_keys.c.network.in_(newest_networks.limit(MOST_NETWORKS))
                connection.execute(sa.delete(wrong_keys).where(~is_kept))
            count_before = self._read_present_count(connection, count_query.with_for_update())
            update = sa.update(wrong_keys).where(wrong_keys.c.network == network)
            connection.execute(update.values(number=count_before + 1.0, counted_at=now))
        return count_before

    def present(self, network: str) -> float:
        """Return the present count of wrong keys of a network, without counting."""
        with self._database.reading() as connection:
            return self._read_present_count(
                connection, sa.select(wrong_keys).where(wrong_keys.c.network == network)
            )

    def _read_present_count(self, connection: sa.Connection, query: sa.Select[Any]) -> float:
        """Return the count that a query finds, decreased by one for each period `FORGET` since it was stored.

        The count is 0 without a row.
        """
        row = connection.execute(query).one_or_none()
        if row is None:
            return 0.0
        decrease: float = max(0.0, (self._now(connection) - row.counted_at) / FORGET)
        return max(0.0, float(row.number) - decrease)
