"""Access to the service: requesters, the roles that routes need, and the audit of requests.

A requester is identified by a key, or by the session of a browser, before the body of the request is read.
Each route declares the role that it needs, and checks the role of the requester's key. A request that no
route answers needs a key, too, unless it is for a file of the page.
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
from jointstiff.service.security.keys import Keyring, hash_secret, hide_secrets, make_secret_token
from jointstiff.service.store.access import MINUTE
from jointstiff.service.store.store import SESSION_LONGEST, Store
from jointstiff.service.store.tables import AccessKey, AuditEntry, SessionRecord
from jointstiff.solver.errors import RequestError

ROLES: Final[tuple[Role, ...]] = ("viewer", "operator", "admin")
"""Roles in order of increasing rights: each role includes the rights of the roles before it."""
ANONYMOUS_ENTRIES: Final = 60
"""Greatest number of entries of the audit per minute for requests without a valid key.

The limit keeps such requests from filling the disk.
"""
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
"""Greatest number of answers that are delayed at the same time; further answers are not delayed."""
FORGIVEN: Final = 10
"""Number of requests with a wrong key from one network before answers to them are delayed."""
_TOKEN: Final = re.compile(r"jss_[A-Za-z0-9]{43}", re.ASCII)

_logger = logging.getLogger(__name__)


class UndeclaredRoleError(TypeError):
    """A route does not declare the role that it needs; the application does not start."""


_BEARER: Final = HTTPBearer(
    scheme_name="key",
    description="Access key (`jointstiff keys create`), if the service requires keys. Browsers sign in with "
    "the key (`POST /v1/session`) and then send a cookie in its place.",
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
"""Dependency of a route for keys and the audit; if the service requires no keys, nobody may use the route."""
PUBLIC: Final = Depends(_allow_anyone)
"""Dependency of a route that needs no key."""
_DECLARATIONS: Final = (VIEWER, OPERATOR, ADMIN, PUBLIC)


@dataclass
class Requester:
    """The sender of a request: key and address."""

    key: AccessKey | None  # valid key of the request; None if it has no key
    is_open: bool  # whether the service answers requests without a key
    address: str  # network address of the client
    operation: str | None = None  # name of the API operation that answers the request

    def require_role(self, role: Role | None) -> None:
        """Refuse the request if its key does not include the rights of `role`; None admits everyone.

        Raises:
            KeyRefusedError: the request has no key.
            RoleError: the key's role has fewer rights; or `role` is admin, and the service requires no keys.
        """
        if role is None or (self.is_open and role != "admin"):
            return
        if self.is_open:
            # A service without keys cannot tell whether the requester is an administrator.
            raise RoleError(
                "keys and the audit need an admin key, but this service requires no keys",
                "use `jointstiff keys` at the terminal, or start the service with --require-key",
            )
        if self.key is None:
            raise KeyRefusedError("the request has no key", _REMEDY)
        if ROLES.index(cast("Role", self.key.role)) < ROLES.index(role):
            raise RoleError(
                f"the key's role is {self.key.role}, but the request needs the role {role}",
                f"use a key with the role {role}; create one with `jointstiff keys create`",
            )


def get_requester(connection: HTTPConnection) -> Requester:
    """Return the requester of a connection, whom `Guard` identified when the request arrived."""
    requester: Requester = connection.scope[REQUESTER]
    return requester


async def _key_of_requester(connection: HTTPConnection) -> AccessKey | None:
    """Return the key of a request; None if the request has no key."""
    return get_requester(connection).key


RequesterKeyDependency = Depends(_key_of_requester)
"""Dependency of a route: the key of the request, or None."""


class AccessRoute(APIRoute):
    """Route that refuses requests whose key lacks the declared role."""

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it before its body is read.

        Raises:
            KeyRefusedError: the request has no key, and the route needs one.
            RoleError: the key lacks the role that the route needs.
        """
        if scope["method"] in (self.methods or ()):  # requests with another method are refused anyway
            role = get_role(self)
            # Routes that anyone may use also answer requests whose requester was not identified.
            requester: Requester = (
                scope[REQUESTER] if role else scope.get(REQUESTER, Requester(None, True, ""))
            )
            requester.operation = make_operation_id(self)
            requester.require_role(role)
        await super().handle(scope, receive, send)


def get_role(route: APIRoute) -> Role | None:
    """Return the role that a route needs; None if the route is declared `PUBLIC`.

    Raises:
        UndeclaredRoleError: the route has none, or several, of the declarations `VIEWER` to `PUBLIC`.
    """
    # Dependencies are compared by identity: these four objects are the only declarations of a role.
    declarations = [each for each in route.dependencies if any(each is known for known in _DECLARATIONS)]
    if len(declarations) != 1:
        raise UndeclaredRoleError(
            f"{route.name} ({route.path}) must declare one role: "
            "dependencies=[VIEWER], [OPERATOR], [ADMIN] or [PUBLIC] of service/security/access.py"
        )
    (declaration,) = declarations
    if isinstance(declaration, params.Security) and declaration.scopes:
        return cast("Role", declaration.scopes[0])
    return None


def make_operation_id(route: APIRoute) -> str:
    """Return the operation's name in camel case for generated clients: `createRun` for `create_run`."""
    first_word, *other_words = route.name.split("_")
    return first_word + "".join(word.capitalize() for word in other_words)


def find_public_paths(routes: Iterable[BaseRoute]) -> tuple[frozenset[str], tuple[str, ...]]:
    """Return (paths of routes that need no key, prefixes of the paths of public files).

    Raises:
        UndeclaredRoleError: a route declares neither a role nor that it is public, or is not an
            `AccessRoute`, which checks the role.
    """
    paths, prefixes = set(), []
    for context in iter_route_contexts(list(routes)):
        route = context.original_route
        if isinstance(route, AccessRoute):
            # None means that the route is declared public; without a declaration `get_role` raises an error.
            if get_role(route) is None:
                paths.add(route.path)
        elif isinstance(route, Mount) and isinstance(route.app, StaticFiles):
            prefixes.append(f"{route.path}/")
        else:
            raise UndeclaredRoleError(f"{context.path} must be an AccessRoute, which checks the role")
    return frozenset(paths), tuple(prefixes)


@dataclass(frozen=True)
class SignedIn:
    """A new session of a browser that signed in."""

    key: AccessKey  # key with which the browser signed in
    token: str  # secret token of the session's cookie
    ends_at: datetime  # time at which the session ends at the latest


class Gate:
    """Check of the keys of requests, and sessions of browsers. A gate belongs to one event loop."""

    def __init__(
        self,
        store: Store,
        keyring: Keyring,
        await_recent_keys: Callable[[], Awaitable[object]],
        access: Access,
    ) -> None:
        """Guard a service.

        Args:
            store: store of the service's keys and sessions.
            keyring: keys that open the service.
            await_recent_keys: function that waits until the keys have been read recently, and raises a
                `StoreError` if reading failed.
            access: kind of callers that the service answers.
        """
        self.access = access
        self.keyring = keyring
        self._store = store
        self._await_recent_keys = await_recent_keys
        self._delayed_answers = 0  # number of answers to wrong keys that are being delayed at present
        # Hash of a link → time of its first use: a second use within a minute does not count as a wrong key.
        self._used_links: dict[str, datetime] = {}
        self._database_slots = CapacityLimiter(4)  # limits database calls at the same time
        self._counting_slot = CapacityLimiter(1)  # for counting wrong keys, so that they delay no session
        self._stored_uses: dict[str, datetime] = {}  # id of a key, or hash of a session → last stored use
        self._storing_tasks: set[asyncio.Task[None]] = set()  # tasks that store uses at present

    @property
    def is_open(self) -> bool:
        """Return whether the service answers requests without a key."""
        return self.access != "keys"

    async def awaits_first_key(self) -> bool:
        """Return whether the service has no valid key, so that an operator has to create the first key."""
        if not self.keyring.has_keys():
            # If the database does not answer, the keys that were read last are used.
            with suppress(StoreError):
                await self._await_recent_keys()
        return not self.keyring.has_keys()

    async def find_key(self, connection: HTTPConnection, address: str) -> AccessKey | None:
        """Return the key of a request, from its bearer token or its session; None if it has neither.

        Raises:
            KeyRefusedError: the bearer token is not a valid key of the service.
            StoreError: the database does not answer.
        """
        scheme, _, text = connection.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            await self._await_recent_keys()
            key: AccessKey | None = await self._check_key(text.strip(), address)
        else:
            key, _ = await self.find_session(connection)
        if key is not None and not self.keyring.is_in_file(key.id):
            self._store_use(key.id, key.last_used_at, self._store.keys.mark_used)
        return key

    async def may_continue(self, connection: HTTPConnection, key: AccessKey | None) -> bool:
        """Return whether a long answer may continue: the key is valid, and its session has not ended.

        Raises:
            StoreError: the database does not answer.
        """
        if self.is_open:
            return True
        if key is None or self.keyring.find(key.id) is None:
            return False
        token = connection.cookies.get(make_cookie_name(connection), "")
        if "authorization" in connection.headers or not _TOKEN.fullmatch(token):
            return True  # the request came with the key itself, not with a session
        now = datetime.now(UTC)
        return (
            await run_sync(self._store.sessions.find, hash_secret(token), now, limiter=self._database_slots)
            is not None
        )

    async def find_session(self, connection: HTTPConnection) -> tuple[AccessKey | None, datetime | None]:
        """Return (key of the session of a browser, end of the session); (None, None) without a session."""
        token = connection.cookies.get(make_cookie_name(connection), "")
        if not _TOKEN.fullmatch(token):
            return None, None
        await self._await_recent_keys()
        token_hash = hash_secret(token)
        session = await run_sync(
            self._store.sessions.find, token_hash, datetime.now(UTC), limiter=self._database_slots
        )
        key = None if session is None else self.keyring.find(session.key_id)
        if session is None or key is None:
            return None, None
        self._store_use(token_hash, session.used_at, self._store.sessions.mark_used)
        return key, session.created_at + SESSION_LONGEST

    async def sign_in(self, key: str | None, link: str | None, address: str) -> SignedIn:
        """Begin the session of a browser, with the text of a key or, if `key` is None, with a one-time link.

        Raises:
            RequestError: the service requires no keys.
            KeyRefusedError: the key or the link does not open the service.
            StoreError: the database does not answer.
        """
        if self.is_open:
            raise RequestError(
                "sign-in is not needed: this service requires no key",
                remedy="open the page; the link stays valid for a service that requires keys",
            )
        await self._await_recent_keys()
        key_record = (
            await self._check_key(key, address) if key is not None else await self._redeem_link(link, address)
        )
        token, now = make_secret_token("jss"), datetime.now(UTC)
        record = SessionRecord(hash_secret(token), key_record.id, now, now)
        await run_sync(self._store.sessions.begin, record, limiter=self._database_slots)
        return SignedIn(key_record, token, now + SESSION_LONGEST)

    async def sign_out(self, connection: HTTPConnection) -> None:
        """End the session of a browser, if it has one."""
        token = connection.cookies.get(make_cookie_name(connection), "")
        if _TOKEN.fullmatch(token):
            await run_sync(self._store.sessions.end, hash_secret(token), limiter=self._database_slots)

    async def _check_key(self, text: str, address: str) -> AccessKey:
        """Return the valid key with a secret text.

        A wrong key is counted for the network of `address`; after many wrong keys the refusal is delayed.

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
        """Return the key of a one-time link, and make the link invalid; count a wrong link like a wrong key.

        Raises:
            KeyRefusedError: the link was used before, is too old, or its key is not valid any more.
            WrongKeysError: the network of the address has sent too many wrong keys or links.
        """
        link_hash, now = hash_secret(link or ""), datetime.now(UTC)
        key_id = await run_sync(self._store.sessions.redeem, link_hash, now, limiter=self._database_slots)
        key = None if key_id is None else self.keyring.find(key_id)
        if key is not None:
            self._used_links = {used: time for used, time in self._used_links.items() if now - time < MINUTE}
            self._used_links[link_hash] = now
            return key
        # A browser may send a link twice: a link used within the last minute is refused, but not counted.
        if link_hash not in self._used_links and await self._count_wrong_key(address):
            await self._delay_answer()
            raise WrongKeysError
        raise KeyRefusedError(
            "the link was used before, or is older than ten minutes",
            "use a new link (`jointstiff keys link` makes one), or enter a key",
        )

    async def _count_wrong_key(self, address: str) -> bool:
        """Count a wrong key for the network of an address; return whether the network sent too many."""
        count = self._store.wrong_keys.count
        return await run_sync(count, get_network(address), limiter=self._counting_slot) > FORGIVEN

    async def refuse_guesses(self, address: str) -> None:
        """Refuse to look at a short code if the network of an address has sent too many wrong ones.

        A code is short enough to be guessed. So, unlike a key, even the right code is refused.

        Raises:
            WrongKeysError: the network has sent too many wrong keys or codes.
        """
        present = self._store.wrong_keys.present
        if await run_sync(present, get_network(address), limiter=self._database_slots) > FORGIVEN:
            raise WrongKeysError

    async def count_guess(self, address: str) -> None:
        """Count a wrong code for the network of an address, together with wrong keys."""
        await self._count_wrong_key(address)

    async def _delay_answer(self) -> None:
        """Wait for `SLOW_SECONDS`, unless `MOST_SLOW` answers are being delayed already."""
        if self._delayed_answers >= MOST_SLOW:
            return
        self._delayed_answers += 1
        try:
            await sleep(SLOW_SECONDS)
        finally:
            self._delayed_answers -= 1

    def _store_use(
        self, name: str, last_used_at: datetime | None, write: Callable[[str, datetime], object]
    ) -> None:
        """Store in the background that a key or session is used now, at most once a minute.

        Args:
            name: id of the key, or hash of the session's token.
            last_used_at: time of the last use in the store.
            write: function that stores the time of a use.
        """
        now = datetime.now(UTC)
        last_use = self._stored_uses.get(name, last_used_at)
        if last_use is not None and now - last_use < MINUTE:
            return
        recent_uses = {other: time for other, time in self._stored_uses.items() if now - time < MINUTE}
        self._stored_uses = recent_uses | {name: now}
        task = asyncio.get_running_loop().create_task(self._write_use(write, name, now))
        self._storing_tasks.add(task)  # the event loop keeps no reference to its tasks
        task.add_done_callback(self._storing_tasks.discard)

    async def _write_use(self, write: Callable[[str, datetime], Any], name: str, now: datetime) -> None:
        """Call `write` to store the use of a key or session; after a failure the next use is stored again."""
        try:
            await run_sync(write, name, now, limiter=self._database_slots)
        except (StoreError, asyncio.CancelledError):
            self._stored_uses.pop(name, None)


def make_cookie_name(connection: HTTPConnection) -> str:
    """Return the name of the session's cookie, which contains the port of the service.

    Browsers send a cookie to all ports of a host, so that two services of a host need different names.
    """
    port = connection.headers.get("host", "").rpartition(":")[2]
    return f"jointstiff_{port}" if port.isascii() and port.isdecimal() else "jointstiff"


def get_network(address: str) -> str:
    """Return the network of an IP address, for which wrong keys are counted.

    An IPv4 address is its own network. The network of an IPv6 address is its /64 network, as one machine may
    have all 2^64 addresses of such a network.
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
        self._minute = 0  # minute in which requests without a valid key are counted
        self._anonymous_requests = 0  # number of requests without a valid key in this minute

    async def answer_and_record(
        self, requester: Requester, scope: Scope, send: Send, answer: Callable[[Send], Awaitable[None]]
    ) -> None:
        """Answer a request, and write its outcome to the audit before the client gets the answer.

        `answer` answers the request; its argument is the function with which it sends the answer.
        """
        is_written = False

        async def write_then_send(message: Message) -> None:
            """Write the entry before the first message of the answer; then send the message."""
            nonlocal is_written
            if message["type"] == "http.response.start" and not is_written:
                is_written = True
                await self._add_entry(requester, scope, message["status"])
            await send(message)

        try:
            await answer(write_then_send)
        finally:
            if not is_written:  # answering failed, or the client disconnected
                await self._add_entry(requester, scope, 500)

    async def _add_entry(self, requester: Requester, scope: Scope, status: int) -> None:
        """Add an entry about a request; add none if too many requests of this minute have no valid key."""
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
        """Count a request without a valid key; return whether this minute has too many such requests."""
        minute = int(time.monotonic() // 60)
        if minute != self._minute:
            self._minute, self._anonymous_requests = minute, 0
        self._anonymous_requests += 1
        if self._anonymous_requests == ANONYMOUS_ENTRIES + 1:  # warn once in a minute
            _logger.warning("more requests without a valid key than the audit records in a minute")
        return self._anonymous_requests > ANONYMOUS_ENTRIES


def get_client_address(scope: Scope) -> str:
    """Return the client's IP address; `unknown` if the server knows no IP address, as behind some proxies."""
    try:
        return str(ipaddress.ip_address((scope.get("client") or ("",))[0]))
    except ValueError:
        return "unknown"


def _printable_path(path: str) -> str:
    """Return a path for the audit: secrets hidden, text shortened, unprintable characters replaced."""
    text = hide_secrets(path[: 2 * _LONGEST_PATH])[:_LONGEST_PATH]
    return "".join(character if character.isprintable() else "�" for character in text)
