"""Access: the requester, by a key or by the session of a browser; the role that each route needs; the audit.

Each route declares a role. The requester is found before anything of the body is read; the route that was
found decides whether the role is enough. What no route answers needs a key as well, but for the files of the
page.
"""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import re
import time
from collections.abc import Awaitable, Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final, cast

from anyio import CapacityLimiter, sleep
from anyio.to_thread import run_sync
from fastapi import Depends, params
from fastapi.routing import APIRoute, iter_route_contexts
from fastapi.security import HTTPBearer
from fastapi.staticfiles import StaticFiles
from starlette.requests import HTTPConnection
from starlette.routing import BaseRoute, Mount
from starlette.types import Message, Receive, Scope, Send

from jointstiff.schemas.access import Access, Role
from jointstiff.service.problems import KeyRefusedError, RoleError, StoreError, WrongKeysError
from jointstiff.service.security.keys import Keyring, digest, mint_token, without_keys
from jointstiff.service.store.access import MINUTE
from jointstiff.service.store.store import SESSION_LONGEST, Store
from jointstiff.service.store.tables import AccessKey, AuditEntry, SessionRecord
from jointstiff.solver.errors import RequestError

ROLES: Final[tuple[Role, ...]] = ("viewer", "operator", "admin")
"""Each may do what those before it may."""
ANONYMOUS_ENTRIES: Final = 60
"""Entries of the audit a minute about requests without a valid key: such requests cannot fill the disk."""
_LONGEST_PATH: Final = 200
_LONGEST_ADDRESS: Final = 64
_LONGEST_METHOD: Final = 16
REQUESTER: Final = "jointstiff.requester"
"""The requester, in the scope of a request; set by the process that forwards the request."""
_REMEDY: Final = (
    "send the header `Authorization: Bearer KEY`, or sign in on the page; create keys with `jointstiff keys "
    "create`"
)
SLOW_SECONDS: Final = 1.0
"""Time that each further wrong key of an address takes."""
MOST_SLOW: Final = 64
"""Wrong keys that wait at once; others are answered without waiting."""
FORGIVEN: Final = 10
"""Wrong keys of a network that are answered at once."""
_TOKEN: Final = re.compile(r"jss_[A-Za-z0-9]{43}", re.ASCII)

_logger = logging.getLogger(__name__)


class UndeclaredRoleError(TypeError):
    """A route does not say who may use it; the application is not composed."""


_BEARER: Final = HTTPBearer(
    scheme_name="key",
    description="A key (`jointstiff keys create`), where the service requires one. Browsers sign in with it "
    "(`POST /v1/session`) and send a cookie in its place.",
    auto_error=False,
)


def _require_role(role: Role) -> params.Security:
    return params.Security(_BEARER, scopes=[role])


async def _public() -> None:
    """Do nothing."""


VIEWER: Final = _require_role("viewer")
"""Dependency of a route that reads."""
OPERATOR: Final = _require_role("operator")
"""Dependency of a route that stores, computes or deletes."""
ADMIN: Final = _require_role("admin")
"""Dependency of a route for keys and the audit; where no key is demanded, nobody may use it."""
PUBLIC: Final = Depends(_public)
"""Dependency of a route that needs no key."""
_DECLARATIONS: Final = (VIEWER, OPERATOR, ADMIN, PUBLIC)


@dataclass
class Requester:
    """The requester of a request: its key and address."""

    key: AccessKey | None  # key that came with it; None if none did
    is_open: bool  # whether no key is demanded
    address: str  # where it came from
    operation: str | None = None  # operation that was found for it

    def require(self, role: Role | None) -> None:
        """Do nothing if a role, or that of anyone, is enough.

        Raises:
            KeyRefusedError: no key came.
            RoleError: the key's role is not enough; or an admin's is needed, and no key is demanded.
        """
        if role is None or (self.is_open and role != "admin"):
            return
        if self.is_open:
            raise RoleError(
                "keys and the audit need an admin key, but this service requires no keys",
                "use `jointstiff keys` at the terminal, or start the service with --require-key",
            )
        if self.key is None:
            raise KeyRefusedError("the request has no key", _REMEDY)
        if ROLES.index(cast("Role", self.key.role)) < ROLES.index(role):
            raise RoleError(
                f"the key's role is {self.key.role}, but this needs {role}",
                f"use a key with the role {role}; create one with `jointstiff keys create`",
            )


def requester_of(connection: HTTPConnection) -> Requester:
    """Return the requester."""
    requester: Requester = connection.scope[REQUESTER]
    return requester


async def _key(connection: HTTPConnection) -> AccessKey | None:
    return requester_of(connection).key


KeyOf = Depends(_key)
"""Dependency: the key with which a job is requested."""


class AccessRoute(APIRoute):
    """Route that answers those whose role is enough."""

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse before the body is read.

        Raises:
            KeyRefusedError: no key came, and one is needed.
            RoleError: the key's role is not enough.
        """
        if scope["method"] in (self.methods or ()):  # else it will not be this route that answers
            role = role_of(self)
            requester: Requester = (
                scope[REQUESTER] if role else scope.get(REQUESTER, Requester(None, True, ""))
            )
            requester.operation = operation_id(self)
            requester.require(role)
        await super().handle(scope, receive, send)


def role_of(route: APIRoute) -> Role | None:
    """Return the role that a route needs; None if anyone may use it.

    Raises:
        UndeclaredRoleError: it does not declare one, or more than one.
    """
    declared = [each for each in route.dependencies if any(each is one for one in _DECLARATIONS)]
    if len(declared) != 1:
        raise UndeclaredRoleError(
            f"{route.name} ({route.path}) must declare one role: "
            "dependencies=[VIEWER], [OPERATOR], [ADMIN] or [PUBLIC] of service/security/access.py"
        )
    (one,) = declared
    return cast("Role", one.scopes[0]) if isinstance(one, params.Security) and one.scopes else None


def operation_id(route: APIRoute) -> str:
    """Return the name of an operation for generated clients, such as `createRun`."""
    first, *others = route.name.split("_")
    return first + "".join(word.capitalize() for word in others)


def public_paths(routes: Iterable[BaseRoute]) -> tuple[frozenset[str], tuple[str, ...]]:
    """Return the addresses that need no key, and the beginnings of such addresses.

    Raises:
        UndeclaredRoleError: a route does not say who may use it, or is of a class that would not ask.
    """
    paths, mounts = set(), []
    for context in iter_route_contexts(list(routes)):
        route = context.original_route
        if isinstance(route, AccessRoute):
            if role_of(route) is None:
                paths.add(route.path)
        elif isinstance(route, Mount) and isinstance(route.app, StaticFiles):
            mounts.append(f"{route.path}/")
        else:
            raise UndeclaredRoleError(f"{context.path} must be an AccessRoute, which asks for a role")
    return frozenset(paths), tuple(mounts)


@dataclass(frozen=True)
class SignedIn:
    """A browser that signed in."""

    key: AccessKey  # with which
    token: str  # token of its cookie
    ends_at: datetime  # when it has to sign in again at the latest


class Gate:
    """Recognises those who ask. It belongs to one event loop."""

    def __init__(
        self, store: Store, keyring: Keyring, look: Callable[[], Awaitable[object]], access: Access
    ) -> None:
        """Guard a service.

        Args:
            store: which has its sessions and its keys.
            keyring: the keys that open it.
            look: raises a `StoreError` if the database, and so the keyring, was not looked at of late.
            access: whom it answers.
        """
        self.access = access
        self.keyring = keyring
        self._store = store
        self._look = look
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
                await self._look()
        return not self.keyring.has_keys()

    async def caller(self, connection: HTTPConnection, address: str) -> AccessKey | None:
        """Return the key of those who ask; None if they send none, or their session has ended.

        Raises:
            KeyRefusedError: a key came that does not open the service.
            StoreError: the database does not answer.
        """
        scheme, _, text = connection.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            await self._look()
            key: AccessKey | None = await self._check_key(text.strip(), address)
        else:
            key, _ = await self.session(connection)
        if key is not None and not self.keyring.is_filed(key.id):
            self._note_use(key.id, key.last_used_at, self._store.keys.used)
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
        await self._look()
        hashed = digest(token)
        session = await run_sync(self._store.sessions.find, hashed, datetime.now(UTC), limiter=self._turns)
        key = None if session is None else self.keyring.find(session.key_id)
        if session is None or key is None:
            return None, None
        self._note_use(hashed, session.used_at, self._store.sessions.used)
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
        await self._look()
        key_record = (
            await self._check_key(key, address) if key is not None else await self._redeem_link(link, address)
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

    async def _check_key(self, text: str, address: str) -> AccessKey:
        try:
            return self.keyring.check(text)
        except KeyRefusedError:
            if not await self._is_too_much(address):
                raise
        await self._wait()
        raise WrongKeysError

    async def _redeem_link(self, link: str | None, address: str) -> AccessKey:
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
            "use a new link (`jointstiff keys link` makes one), or enter a key",
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

    def _note_use(self, name: str, before: datetime | None, used: Callable[[str, datetime], object]) -> None:
        """Write in the background that a key or session is used, once a minute."""
        now = datetime.now(UTC)
        last = self._noted.get(name, before)
        if last is not None and now - last < MINUTE:
            return
        self._noted = {one: at for one, at in self._noted.items() if now - at < MINUTE} | {name: now}
        task = asyncio.get_running_loop().create_task(self._write_use(used, name, now))
        self._notes.add(task)
        task.add_done_callback(self._notes.discard)

    async def _write_use(self, used: Callable[[str, datetime], Any], name: str, now: datetime) -> None:
        try:
            await run_sync(used, name, now, limiter=self._turns)
        except (StoreError, asyncio.CancelledError):
            self._noted.pop(name, None)  # a later use is noted instead


def cookie_name(connection: HTTPConnection) -> str:
    """Return the name of the cookie: browsers keep one jar for all ports of a machine."""
    port = connection.headers.get("host", "").rpartition(":")[2]
    return f"jointstiff_{port}" if port.isascii() and port.isdecimal() else "jointstiff"


def network_of(address: str) -> str:
    """Return an IPv4 address, or the network of an IPv6 address, as one machine has 2^64 of them."""
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return address[:64]
    return address if parsed.version == 4 else str(ipaddress.ip_network((parsed, 64), strict=False))


class Audit:
    """Writes the audit: an entry is stored before the client hears of the outcome."""

    def __init__(self, store: Store) -> None:
        """Write to a store."""
        self._store = store
        self._turns = CapacityLimiter(4)
        self._minute = 0
        self._anonymous = 0

    async def follow(
        self, requester: Requester, scope: Scope, send: Send, answer: Callable[[Send], Awaitable[None]]
    ) -> None:
        """Let a request be answered, and write what became of it."""
        written = False

        async def sent(message: Message) -> None:
            nonlocal written
            if message["type"] == "http.response.start" and not written:
                written = True
                await self._write(requester, scope, message["status"])
            await send(message)

        try:
            await answer(sent)
        finally:
            if not written:  # it failed, which others answer, or the client left
                await self._write(requester, scope, 500)

    async def _write(self, requester: Requester, scope: Scope, status: int) -> None:
        if requester.key is None and self._is_too_much():
            return
        entry = AuditEntry(
            at=datetime.now(UTC),
            key_id=None if requester.key is None else requester.key.id,
            key_name=None if requester.key is None else requester.key.name,
            address=requester.address[:_LONGEST_ADDRESS],
            method=scope["method"][:_LONGEST_METHOD],
            operation=requester.operation,
            path=_shown(scope["path"]),
            status=status,
        )
        try:
            await run_sync(self._store.audit.add, entry, limiter=self._turns)
        except StoreError as error:  # what was done is done; the requester gets the ordinary answer
            _logger.error("the audit lacks %s: %s", entry, error.reason)  # noqa: TRY400

    def _is_too_much(self) -> bool:
        minute = int(time.monotonic() // 60)
        if minute != self._minute:
            self._minute, self._anonymous = minute, 0
        self._anonymous += 1
        if self._anonymous == ANONYMOUS_ENTRIES + 1:
            _logger.warning("more requests without a valid key than the audit records in a minute")
        return self._anonymous > ANONYMOUS_ENTRIES


def address_of(scope: Scope) -> str:
    """Return where a request came from; a proxy on this machine may pass on any text as an address."""
    try:
        return str(ipaddress.ip_address((scope.get("client") or ("",))[0]))
    except ValueError:
        return "unknown"


def _shown(path: str) -> str:
    text = without_keys(path[: 2 * _LONGEST_PATH])[:_LONGEST_PATH]
    return "".join(character if character.isprintable() else "�" for character in text)
