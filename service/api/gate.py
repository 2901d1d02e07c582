"""The gate: recognises who asks by a key or by the cookie of a session, and signs browsers in and out."""

from __future__ import annotations

import asyncio
import ipaddress
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

from anyio import CapacityLimiter, sleep
from anyio.to_thread import run_sync
from starlette.requests import HTTPConnection

from jointstiff.schemas.access import Access
from jointstiff.service.access.key_text import digest, mint_token
from jointstiff.service.access.keyring import Keyring
from jointstiff.service.api.watch import Watch
from jointstiff.service.problems.errors import KeyRefusedError, StoreError, WrongKeysError
from jointstiff.service.store.access import MINUTE
from jointstiff.service.store.records import AccessKey, SessionRecord
from jointstiff.service.store.store import SESSION_LONGEST, Store
from jointstiff.solver.errors import RequestError

SLOW_SECONDS: Final = 1.0
"""Time that each further wrong key of an address takes."""
MOST_SLOW: Final = 64
"""Wrong keys that wait at once; others are answered without waiting."""
FORGIVEN: Final = 10
"""Wrong keys of a network that are answered at once."""
_TOKEN: Final = re.compile(r"jss_[A-Za-z0-9]{43}", re.ASCII)


@dataclass(frozen=True)
class SignedIn:
    """A browser that signed in."""

    key: AccessKey  # with which
    token: str  # token of its cookie
    ends_at: datetime  # when it has to sign in again at the latest


class Gate:
    """Recognises those who ask. It belongs to one event loop."""

    def __init__(self, store: Store, keyring: Keyring, watch: Watch, access: Access) -> None:
        """Guard a service."""
        self.access = access
        self.keyring = keyring
        self._store = store
        self._watch = watch
        self._slow = 0
        self._used_links: dict[str, datetime] = {}  # a second tap on one is no wrong key
        self._turns = CapacityLimiter(4)
        self._counting = CapacityLimiter(1)  # of wrong keys, which delay no session
        self._noted: dict[str, datetime] = {}
        self._notes: set[asyncio.Task[None]] = set()

    @property
    def is_open(self) -> bool:
        """Return whether no key is demanded."""
        return self.access != "keys"

    async def awaits_key(self) -> bool:
        """Return whether no key opens the service yet."""
        if not self.keyring.has_keys():
            with suppress(StoreError):  # what was seen before counts
                await self._watch.latest()
        return not self.keyring.has_keys()

    async def caller(self, connection: HTTPConnection, address: str) -> AccessKey | None:
        """Return the key of those who ask; None if they send none, or their session has ended.

        Raises:
            KeyRefusedError: a key came that does not open the service.
            StoreError: the database does not answer.
        """
        scheme, _, text = connection.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            await self._watch.latest()
            key: AccessKey | None = await self._checked(text.strip(), address)
        else:
            key, _ = await self.session(connection)
        if key is not None and not self.keyring.is_filed(key.id):
            self._note(key.id, key.last_used_at, self._store.keys.used)
        return key

    async def still_opens(self, connection: HTTPConnection, key: AccessKey | None) -> bool:
        """Return whether an answer that goes on may do so: the key is valid, and the session has not ended.

        Raises:
            StoreError: the database does not answer.
        """
        if self.is_open:
            return True
        if key is None or self.keyring.find(key.id) is None:
            return False
        token = connection.cookies.get(cookie_name(connection), "")
        if "authorization" in connection.headers or not _TOKEN.fullmatch(token):
            return True
        now = datetime.now(UTC)
        return await run_sync(self._store.sessions.find, digest(token), now, limiter=self._turns) is not None

    async def session(self, connection: HTTPConnection) -> tuple[AccessKey | None, datetime | None]:
        """Return the key of a browser's session, and when it ends; nothing if there is none."""
        token = connection.cookies.get(cookie_name(connection), "")
        if not _TOKEN.fullmatch(token):
            return None, None
        await self._watch.latest()
        hashed = digest(token)
        session = await run_sync(self._store.sessions.find, hashed, datetime.now(UTC), limiter=self._turns)
        key = None if session is None else self.keyring.find(session.key_id)
        if session is None or key is None:
            return None, None
        self._note(hashed, session.used_at, self._store.sessions.used)
        return key, session.created_at + SESSION_LONGEST

    async def sign_in(self, key: str | None, link: str | None, address: str) -> SignedIn:
        """Begin the session of a browser, with a key or with a one-time link.

        Raises:
            RequestError: no key is demanded.
            KeyRefusedError: it does not open the service.
            StoreError: the database does not answer.
        """
        if self.is_open:
            raise RequestError(
                "signing in is not needed: this service requires no key",
                remedy="open the page; the link stays valid for a service that requires keys",
            )
        await self._watch.latest()
        key_record = (
            await self._checked(key, address) if key is not None else await self._redeemed(link, address)
        )
        token, now = mint_token("jss"), datetime.now(UTC)
        record = SessionRecord(digest(token), key_record.id, now, now)
        await run_sync(self._store.sessions.begin, record, limiter=self._turns)
        return SignedIn(key_record, token, now + SESSION_LONGEST)

    async def sign_out(self, connection: HTTPConnection) -> None:
        """End the session of a browser, if it has one."""
        token = connection.cookies.get(cookie_name(connection), "")
        if _TOKEN.fullmatch(token):
            await run_sync(self._store.sessions.end, digest(token), limiter=self._turns)

    async def _checked(self, text: str, address: str) -> AccessKey:
        try:
            return self.keyring.check(text)
        except KeyRefusedError:
            if not await self._is_too_much(address):
                raise
        await self._wait()
        raise WrongKeysError

    async def _redeemed(self, link: str | None, address: str) -> AccessKey:
        hashed, now = digest(link or ""), datetime.now(UTC)
        key_id = await run_sync(self._store.sessions.redeem, hashed, now, limiter=self._turns)
        record = None if key_id is None else self.keyring.find(key_id)
        if record is not None:
            self._used_links = {one: at for one, at in self._used_links.items() if now - at < MINUTE}
            self._used_links[hashed] = now
            return record
        if hashed not in self._used_links and await self._is_too_much(address):
            await self._wait()
            raise WrongKeysError
        raise KeyRefusedError(
            "the link was used before, or is older than ten minutes",
            "ask for another one (`jointstiff keys link`), or enter a key",
        )

    async def _is_too_much(self, address: str) -> bool:
        """Count a wrong key, for all services of the database."""
        count = self._store.wrong_keys.count
        return await run_sync(count, network_of(address), limiter=self._counting) > FORGIVEN

    async def _wait(self) -> None:
        if self._slow >= MOST_SLOW:
            return
        self._slow += 1
        try:
            await sleep(SLOW_SECONDS)
        finally:
            self._slow -= 1

    def _note(self, name: str, before: datetime | None, used: Callable[[str, datetime], object]) -> None:
        """Write in the background that a key or session is used, once a minute."""
        now = datetime.now(UTC)
        last = self._noted.get(name, before)
        if last is not None and now - last < MINUTE:
            return
        self._noted = {one: at for one, at in self._noted.items() if now - at < MINUTE} | {name: now}
        task = asyncio.get_running_loop().create_task(self._written(used, name, now))
        self._notes.add(task)
        task.add_done_callback(self._notes.discard)

    async def _written(self, used: Callable[[str, datetime], Any], name: str, now: datetime) -> None:
        try:
            await run_sync(used, name, now, limiter=self._turns)
        except (StoreError, asyncio.CancelledError):
            self._noted.pop(name, None)  # a later use is noted instead


def cookie_name(connection: HTTPConnection) -> str:
    """Return the name of the cookie: browsers keep one jar for all ports of a machine."""
    port = connection.headers.get("host", "").rpartition(":")[2]
    return f"jointstiff_{port}" if port.isascii() and port.isdecimal() else "jointstiff"


def network_of(address: str) -> str:
    """Return an IPv4 address, or the network of an IPv6 address, of which one machine has 2^64."""
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return address[:64]
    return address if parsed.version == 4 else str(ipaddress.ip_network((parsed, 64), strict=False))
