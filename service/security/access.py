"""Access: the requester, by a key or by the session of a browser; the role that each route needs; the audit.

Each route declares the role that it needs. The requester is found before the body is read; then the route
checks the role of the requester's key. A request that no route answers needs a key, too, unless it is for a
file of the page.
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
from jointstiff.service.security.keys import Keyring, digest, hide_secrets, mint_token
from jointstiff.service.store.access import MINUTE
from jointstiff.service.store.store import SESSION_LONGEST, Store
from jointstiff.service.store.tables import AccessKey, AuditEntry, SessionRecord
from jointstiff.solver.errors import RequestError

ROLES: Final[tuple[Role, ...]] = ("viewer", "operator", "admin")
"""Roles in order of increasing rights: each role includes the rights of the roles before it."""
ANONYMOUS_ENTRIES: Final = 60
"""Most entries of the audit per minute for requests without a valid key, which must not fill the disk."""
_LONGEST_PATH: Final = 200
_LONGEST_ADDRESS: Final = 64
_LONGEST_METHOD: Final = 16
REQUESTER: Final = "jointstiff.requester"
"""Key of the requester in the scope of a request; set by the process that forwards the request."""
_REMEDY: Final = (
    "send the header `Authorization: Bearer KEY`, or sign in on the page; create keys with `jointstiff keys "
    "create`"
)
SLOW_SECONDS: Final = 1.0
"""Delay of the answer to a wrong key after `FORGIVEN` wrong keys of a network [s]."""
MOST_SLOW: Final = 64
"""Most answers that are delayed at the same time; further answers are not delayed."""
FORGIVEN: Final = 10
"""Number of wrong keys of a network that are answered without delay."""
_TOKEN: Final = re.compile(r"jss_[A-Za-z0-9]{43}", re.ASCII)

_logger = logging.getLogger(__name__)


class UndeclaredRoleError(TypeError):
    """A route does not declare the role that it needs; the application does not start."""


_BEARER: Final = HTTPBearer(
    scheme_name="key",
    description="A key (`jointstiff keys create`), where the service requires one. Browsers sign in with it "
    "(`POST /v1/session`) and send a cookie in its place.",
    auto_error=False,
)


def _require_role(role: Role) -> params.Security:
    """Return the dependency that declares that a route needs a role."""
    return params.Security(_BEARER, scopes=[role])


async def _allow_anyone() -> None:
    """Check nothing: this dependency only declares that a route needs no key."""


VIEWER: Final = _require_role("viewer")
"""Dependency of a route that reads."""
OPERATOR: Final = _require_role("operator")
"""Dependency of a route that stores, computes or deletes."""
ADMIN: Final = _require_role("admin")
"""Dependency of a route for keys and the audit; where no key is demanded, nobody may use it."""
PUBLIC: Final = Depends(_allow_anyone)
"""Dependency of a route that needs no key."""
_DECLARATIONS: Final = (VIEWER, OPERATOR, ADMIN, PUBLIC)


@dataclass
class Requester:
    """The sender of a request: key and address."""

    key: AccessKey | None  # valid key of the request; None without one
    is_open: bool  # whether no key is demanded
    address: str  # network address of the client
    operation: str | None = None  # name of the API operation that answers it

    def require(self, role: Role | None) -> None:
        """Refuse the request if its key does not include the rights of `role`; None admits everyone.

        Raises:
            KeyRefusedError: the request has no key.
            RoleError: the key's role has fewer rights; or `role` is admin, and the service requires no keys.
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
    """Return the requester of a connection, who was identified when the request arrived."""
    requester: Requester = connection.scope[REQUESTER]
    return requester


async def _key_of_requester(connection: HTTPConnection) -> AccessKey | None:
    """Return the key of a request; None without a key."""
    return requester_of(connection).key


KeyOf = Depends(_key_of_requester)
"""Dependency of a route: the key of the request, or None."""


class AccessRoute(APIRoute):
    """Route that refuses requests whose key lacks the declared role."""

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it before its body is read.

        Raises:
            KeyRefusedError: the request has no key, and the route needs one.
            RoleError: the key lacks the role that the route needs.
        """
        if scope["method"] in (self.methods or ()):  # for other methods this route does not answer
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
        UndeclaredRoleError: the route declares no role, or several.
    """
    # Dependencies are compared by identity: these four objects are the only declarations of a role.
    declared = [each for each in route.dependencies if any(each is known for known in _DECLARATIONS)]
    if len(declared) != 1:
        raise UndeclaredRoleError(
            f"{route.name} ({route.path}) must declare one role: "
            "dependencies=[VIEWER], [OPERATOR], [ADMIN] or [PUBLIC] of service/security/access.py"
        )
    (declaration,) = declared
    if isinstance(declaration, params.Security) and declaration.scopes:
        return cast("Role", declaration.scopes[0])
    return None


def operation_id(route: APIRoute) -> str:
    """Return the operation's name in camel case for generated clients: `createRun` for `create_run`."""
    first, *others = route.name.split("_")
    return first + "".join(word.capitalize() for word in others)


def public_paths(routes: Iterable[BaseRoute]) -> tuple[frozenset[str], tuple[str, ...]]:
    """Return the paths of routes that need no key, and the prefixes of paths of public files.

    Raises:
        UndeclaredRoleError: a route declares no role, or is not an `AccessRoute`, which checks the role.
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
            raise UndeclaredRoleError(f"{context.path} must be an AccessRoute, which checks the role")
    return frozenset(paths), tuple(mounts)


@dataclass(frozen=True)
class SignedIn:
    """A browser that signed in."""

    key: AccessKey  # key that it signed in with
    token: str  # token of its cookie
    ends_at: datetime  # latest time at which it has to sign in again


class Gate:
    """Check of the keys of requests, and sessions of browsers. A gate belongs to one event loop."""

    def __init__(
        self, store: Store, keyring: Keyring, look: Callable[[], Awaitable[object]], access: Access
    ) -> None:
        """Guard a service.

        Args:
            store: store of the service's keys and sessions.
            keyring: keys that open the service.
            look: waits until the keys have been read recently; raises a `StoreError` if reading failed.
            access: kind of callers that the service answers.
        """
        self.access = access
        self.keyring = keyring
        self._store = store
        self._look = look
        self._delayed_answers = 0  # answers to wrong keys that are being delayed now
        self._used_links: dict[str, datetime] = {}  # a second use within a minute counts as no wrong key
        self._database_slots = CapacityLimiter(4)  # database calls at the same time
        self._counting_slot = CapacityLimiter(1)  # separate, so that wrong keys delay no session
        self._last_noted: dict[str, datetime] = {}  # last use that was written, by key id or session
        self._note_tasks: set[asyncio.Task[None]] = set()  # tasks that write uses now

    @property
    def is_open(self) -> bool:
        """Return whether the service answers requests without a key."""
        return self.access != "keys"

    async def awaits_key(self) -> bool:
        """Return whether the service has no valid key, so that an operator has to create the first key."""
        if not self.keyring.has_keys():
            with suppress(StoreError):  # then the keys that were read last are used
                await self._look()
        return not self.keyring.has_keys()

    async def find_key(self, connection: HTTPConnection, address: str) -> AccessKey | None:
        """Return the key of a request, from its bearer token or its session; None if it has neither.

        Raises:
            KeyRefusedError: the bearer token is not a valid key of the service.
            StoreError: the database does not answer.
        """
        scheme, _, text = connection.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            await self._look()
            key: AccessKey | None = await self._check_key(text.strip(), address)
        else:
            key, _ = await self.session(connection)
        if key is not None and not self.keyring.is_filed(key.id):
            self._note_use(key.id, key.last_used_at, self._store.keys.mark_used)
        return key

    async def still_opens(self, connection: HTTPConnection, key: AccessKey | None) -> bool:
        """Return whether a long answer to `key` may continue: key still valid, session not ended.

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
        return (
            await run_sync(self._store.sessions.find, digest(token), now, limiter=self._database_slots)
            is not None
        )

    async def session(self, connection: HTTPConnection) -> tuple[AccessKey | None, datetime | None]:
        """Return the key of a browser's session and the session's end; (None, None) without a session."""
        token = connection.cookies.get(cookie_name(connection), "")
        if not _TOKEN.fullmatch(token):
            return None, None
        await self._look()
        hashed = digest(token)
        session = await run_sync(
            self._store.sessions.find, hashed, datetime.now(UTC), limiter=self._database_slots
        )
        key = None if session is None else self.keyring.find(session.key_id)
        if session is None or key is None:
            return None, None
        self._note_use(hashed, session.used_at, self._store.sessions.mark_used)
        return key, session.created_at + SESSION_LONGEST

    async def sign_in(self, key: str | None, link: str | None, address: str) -> SignedIn:
        """Begin the session of a browser, with a key or with a one-time link.

        Raises:
            RequestError: the service requires no keys.
            KeyRefusedError: the key or the link does not open the service.
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
        await run_sync(self._store.sessions.begin, record, limiter=self._database_slots)
        return SignedIn(key_record, token, now + SESSION_LONGEST)

    async def sign_out(self, connection: HTTPConnection) -> None:
        """End the session of a browser, if it has one."""
        token = connection.cookies.get(cookie_name(connection), "")
        if _TOKEN.fullmatch(token):
            await run_sync(self._store.sessions.end, digest(token), limiter=self._database_slots)

    async def _check_key(self, text: str, address: str) -> AccessKey:
        """Return the key with a secret text.

        A wrong key is counted; after many wrong keys of a network the refusal is delayed.

        Raises:
            KeyRefusedError: the text is not a valid key of the service.
            WrongKeysError: the network of the address has sent too many wrong keys.
        """
        try:
            return self.keyring.check(text)
        except KeyRefusedError:
            if not await self._count_wrong_key(address):
                raise
        await self._delay_answer()
        raise WrongKeysError

    async def _redeem_link(self, link: str | None, address: str) -> AccessKey:
        """Return the key of a one-time link, which becomes invalid; count a wrong link like a wrong key.

        Raises:
            KeyRefusedError: the link was used before, is too old, or its key is not valid any more.
            WrongKeysError: the network of the address has sent too many wrong keys or links.
        """
        hashed, now = digest(link or ""), datetime.now(UTC)
        key_id = await run_sync(self._store.sessions.redeem, hashed, now, limiter=self._database_slots)
        record = None if key_id is None else self.keyring.find(key_id)
        if record is not None:
            self._used_links = {one: at for one, at in self._used_links.items() if now - at < MINUTE}
            self._used_links[hashed] = now
            return record
        if hashed not in self._used_links and await self._count_wrong_key(address):
            await self._delay_answer()
            raise WrongKeysError
        raise KeyRefusedError(
            "the link was used before, or is older than ten minutes",
            "use a new link (`jointstiff keys link` makes one), or enter a key",
        )

    async def _count_wrong_key(self, address: str) -> bool:
        """Count a wrong key of the address's network in the store; return whether there are too many."""
        count = self._store.wrong_keys.count
        return await run_sync(count, network_of(address), limiter=self._counting_slot) > FORGIVEN

    async def _delay_answer(self) -> None:
        """Wait `SLOW_SECONDS` before an answer, unless `MOST_SLOW` answers are being delayed already."""
        if self._delayed_answers >= MOST_SLOW:
            return
        self._delayed_answers += 1
        try:
            await sleep(SLOW_SECONDS)
        finally:
            self._delayed_answers -= 1

    def _note_use(
        self, name: str, last_used_at: datetime | None, write: Callable[[str, datetime], object]
    ) -> None:
        """Store in the background that a key or session is in use, at most once a minute.

        Args:
            name: id of the key, or hash of the session's token.
            last_used_at: time of the last use in the store.
            write: function that stores the time of a use.
        """
        now = datetime.now(UTC)
        last = self._last_noted.get(name, last_used_at)
        if last is not None and now - last < MINUTE:
            return
        self._last_noted = {one: at for one, at in self._last_noted.items() if now - at < MINUTE} | {
            name: now
        }
        task = asyncio.get_running_loop().create_task(self._store_last_use(write, name, now))
        self._note_tasks.add(task)
        task.add_done_callback(self._note_tasks.discard)

    async def _store_last_use(self, write: Callable[[str, datetime], Any], name: str, now: datetime) -> None:
        """Store that a key or session was used; if that fails, forget it, so that a later use is stored."""
        try:
            await run_sync(write, name, now, limiter=self._database_slots)
        except (StoreError, asyncio.CancelledError):
            self._last_noted.pop(name, None)


def cookie_name(connection: HTTPConnection) -> str:
    """Return the session cookie's name, which has the port: browsers send a cookie to all ports of a host."""
    port = connection.headers.get("host", "").rpartition(":")[2]
    return f"jointstiff_{port}" if port.isascii() and port.isdecimal() else "jointstiff"


def network_of(address: str) -> str:
    """Return the network of an address, for which wrong keys are counted: IPv4 as given, of IPv6 the /64.

    One machine may have all 2^64 addresses of a /64 network.
    """
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return address[:64]
    return address if parsed.version == 4 else str(ipaddress.ip_network((parsed, 64), strict=False))


class Audit:
    """Audit of requests: an entry is stored before the client gets the answer."""

    def __init__(self, store: Store) -> None:
        """Write the audit to a store."""
        self._store = store
        self._database_slots = CapacityLimiter(4)
        self._minute = 0
        self._anonymous = 0

    async def follow(
        self, requester: Requester, scope: Scope, send: Send, answer: Callable[[Send], Awaitable[None]]
    ) -> None:
        """Answer a request, and write its outcome to the audit before the client gets the answer."""
        written = False

        async def write_then_send(message: Message) -> None:
            """Write the entry before the first message of the answer; then send the message."""
            nonlocal written
            if message["type"] == "http.response.start" and not written:
                written = True
                await self._write(requester, scope, message["status"])
            await send(message)

        try:
            await answer(write_then_send)
        finally:
            if not written:  # answering failed, or the client disconnected
                await self._write(requester, scope, 500)

    async def _write(self, requester: Requester, scope: Scope, status: int) -> None:
        """Add an entry about a request; leave it out if this minute has too many without a valid key."""
        if requester.key is None and self._exceeds_anonymous_limit():
            return
        entry = AuditEntry(
            at=datetime.now(UTC),
            key_id=None if requester.key is None else requester.key.id,
            key_name=None if requester.key is None else requester.key.name,
            address=requester.address[:_LONGEST_ADDRESS],
            method=scope["method"][:_LONGEST_METHOD],
            operation=requester.operation,
            path=_printable_path(scope["path"]),
            status=status,
        )
        try:
            await run_sync(self._store.audit.add, entry, limiter=self._database_slots)
        except StoreError as error:  # the request has been carried out: the requester gets the usual answer
            _logger.error("the audit lacks %s: %s", entry, error.reason)  # noqa: TRY400

    def _exceeds_anonymous_limit(self) -> bool:
        """Count a request without a valid key; return whether there are too many in this minute."""
        minute = int(time.monotonic() // 60)
        if minute != self._minute:
            self._minute, self._anonymous = minute, 0
        self._anonymous += 1
        if self._anonymous == ANONYMOUS_ENTRIES + 1:
            _logger.warning("more requests without a valid key than the audit records in a minute")
        return self._anonymous > ANONYMOUS_ENTRIES


def address_of(scope: Scope) -> str:
    """Return the client's IP address; `unknown` if its name is no IP address, as behind some proxies."""
    try:
        return str(ipaddress.ip_address((scope.get("client") or ("",))[0]))
    except ValueError:
        return "unknown"


def _printable_path(path: str) -> str:
    """Return a path for the audit: secrets hidden, text shortened, unprintable characters replaced."""
    text = hide_secrets(path[: 2 * _LONGEST_PATH])[:_LONGEST_PATH]
    return "".join(character if character.isprintable() else "�" for character in text)
