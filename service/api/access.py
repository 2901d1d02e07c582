"""Access by role: each route declares a role, and a request needs a key of that role.

The guard finds out who asks, before anything of the body is read; the route that was found decides whether
the role is enough. What no route answers needs a key as well, but for the files of the page.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from ipaddress import ip_address
from typing import Final, cast

from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from fastapi import Depends, params
from fastapi.routing import APIRoute, iter_route_contexts
from fastapi.security import HTTPBearer
from fastapi.staticfiles import StaticFiles
from starlette.requests import HTTPConnection
from starlette.routing import BaseRoute, Mount
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from jointstiff.schemas.access import Role
from jointstiff.schemas.job import Requester
from jointstiff.service.access.key_text import without_keys
from jointstiff.service.api.errors import answer_error, answer_problem
from jointstiff.service.api.gate import Gate
from jointstiff.service.api.posture import SAFE, is_loopback
from jointstiff.service.problems.errors import KeyRefusedError, RoleError, StoreError
from jointstiff.service.problems.table import http_problem
from jointstiff.service.store.records import AccessKey, AuditEntry
from jointstiff.service.store.store import Store

ROLES: Final[tuple[Role, ...]] = ("viewer", "operator", "admin")
"""Each may do what those before it may."""
ANONYMOUS_ENTRIES: Final = 60
"""Entries of the audit a minute about requests without a valid key: such requests cannot fill the disk."""
_LONGEST_PATH: Final = 200
_LONGEST_ADDRESS: Final = 64
_LONGEST_METHOD: Final = 16
ASKED: Final = "jointstiff.asked"
"""Who asks, in the scope of a request; a process that forwards it has found out."""
_REMEDY: Final = (
    "send the header `Authorization: Bearer KEY`, or sign in on the page; create keys with `jointstiff keys "
    "create`"
)

_LIFE: Final = "/live"
"""Address that probes of containers ask, whether there is a key or not."""
_NO_KEY: Final = (
    "no key opens this service yet, so it answers its own machine only",
    "create one with `jointstiff keys create NAME --role ROLE` where the service runs (`docker exec` in a "
    "container); or publish its port on its machine alone (`--publish 127.0.0.1:8000:8000`) and start it "
    "with `serve --host 0.0.0.0 --no-access-control --allowed-host localhost`",
)

_logger = logging.getLogger(__name__)


class UndeclaredRoleError(TypeError):
    """A route does not say who may use it; the application is not composed."""


_BEARER: Final = HTTPBearer(
    scheme_name="key",
    description="A key (`jointstiff keys create`), where the service requires one. Browsers sign in with it "
    "(`POST /v1/session`) and send a cookie in its place.",
    auto_error=False,
)


def _needs(role: Role) -> params.Security:
    return params.Security(_BEARER, scopes=[role])


async def _anyone() -> None:
    """Do nothing."""


VIEWER: Final = _needs("viewer")
"""Dependency of a route that reads."""
OPERATOR: Final = _needs("operator")
"""Dependency of a route that stores, computes or deletes."""
ADMIN: Final = _needs("admin")
"""Dependency of a route for keys and the audit; where no key is demanded, nobody may use it."""
PUBLIC: Final = Depends(_anyone)
"""Dependency of a route that needs no key."""
_DECLARATIONS: Final = (VIEWER, OPERATOR, ADMIN, PUBLIC)


@dataclass
class Asked:
    """A request, and who asks."""

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
                "keys, webhooks and the audit need an admin key, but this service requires no keys",
                "use `jointstiff keys` at the terminal, or start the service with --require-key",
            )
        if self.key is None:
            raise KeyRefusedError("the request has no key", _REMEDY)
        if ROLES.index(cast("Role", self.key.role)) < ROLES.index(role):
            raise RoleError(
                f"the key's role is {self.key.role}, but this needs {role}",
                f"use a key with the role {role}; create one with `jointstiff keys create`",
            )


def asked_of(connection: HTTPConnection) -> Asked:
    """Return who asks."""
    asked: Asked = connection.scope[ASKED]
    return asked


async def _requester(connection: HTTPConnection) -> Requester | None:
    key = asked_of(connection).key
    return None if key is None else Requester(key_id=key.id, key_name=key.name)


RequesterOf = Depends(_requester)
"""Dependency: the key that a job is asked for with."""


class AccessRoute(APIRoute):
    """Route that answers those whose role is enough."""

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse before the body is read."""
        if scope["method"] in (self.methods or ()):  # else it will not be this route that answers
            role = role_of(self)
            asked: Asked = scope[ASKED] if role else scope.get(ASKED, Asked(None, True, ""))
            asked.operation = operation_id(self)
            try:
                asked.require(role)
            except StoreError as error:
                await answer_error(error)(scope, receive, send)
                return
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
            "dependencies=[VIEWER], [OPERATOR], [ADMIN] or [PUBLIC] of service/api/access.py"
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


class AccessGuard:
    """Middleware that finds out who asks, refuses who has no key, and writes the audit."""

    def __init__(self, app: ASGIApp, gate: Gate, store: Store, routes: Iterable[BaseRoute]) -> None:
        """Wrap an application.

        Raises:
            UndeclaredRoleError: a route has none.
        """
        self._app = app
        self._gate = gate
        self._audit = _Auditor(store)
        self._paths, self._mounts = public_paths(routes)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on with who asks, or refuse it."""
        if scope["type"] != "http" or ASKED in scope:
            await self._app(scope, receive, send)
            return
        asked = scope[ASKED] = Asked(None, self._gate.is_open, _address(scope))
        if asked.is_open:
            await self._app(scope, receive, send)
        elif scope["path"] != _LIFE and not is_loopback(asked.address) and await self._gate.awaits_key():
            await answer_problem(http_problem(403, *_NO_KEY))(scope, receive, send)
        elif scope["path"].startswith(self._mounts):
            await self._app(scope, receive, send)
        elif scope["method"] in SAFE:
            await self._pass(asked, scope, receive, send)
        else:
            await self._audit.follow(asked, scope, send, lambda sent: self._pass(asked, scope, receive, sent))

    async def _pass(self, asked: Asked, scope: Scope, receive: Receive, send: Send) -> None:
        is_public = scope["path"] in self._paths
        try:
            if not is_public or scope["path"].startswith("/v1/"):
                asked.key = await self._gate.caller(HTTPConnection(scope), asked.address)
            if not is_public:
                asked.require("viewer")
        except StoreError as error:
            await answer_error(error)(scope, receive, send)
        else:
            await self._app(scope, receive, send)


class _Auditor:
    """Writes the audit: an entry is stored before the client hears of the outcome."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._turns = CapacityLimiter(4)
        self._minute = -1
        self._anonymous = 0

    async def follow(
        self, asked: Asked, scope: Scope, send: Send, answer: Callable[[Send], Awaitable[None]]
    ) -> None:
        """Let a request be answered, and write what became of it."""
        written = False

        async def sent(message: Message) -> None:
            nonlocal written
            if message["type"] == "http.response.start" and not written:
                written = True
                await self._write(asked, scope, message["status"])
            await send(message)

        try:
            await answer(sent)
        finally:
            if not written:  # it failed, which others answer, or the client left
                await self._write(asked, scope, 500)

    async def _write(self, asked: Asked, scope: Scope, status: int) -> None:
        if asked.key is None and self._is_too_much():
            return
        entry = AuditEntry(
            at=datetime.now(UTC),
            key_id=None if asked.key is None else asked.key.id,
            key_name=None if asked.key is None else asked.key.name,
            address=asked.address[:_LONGEST_ADDRESS],
            method=scope["method"][:_LONGEST_METHOD],
            operation=asked.operation,
            path=_shown(scope["path"]),
            status=status,
        )
        try:
            await run_sync(self._store.audit.add, entry, limiter=self._turns)
        except StoreError as error:  # what was done is done; who asked is not told otherwise
            _logger.error("the audit lacks %s: %s", entry, error.reason)  # noqa: TRY400

    def _is_too_much(self) -> bool:
        minute = int(time.monotonic() // 60)
        if minute != self._minute:
            self._minute, self._anonymous = minute, 0
        self._anonymous += 1
        if self._anonymous == ANONYMOUS_ENTRIES + 1:
            _logger.warning("more requests without a valid key than the audit records in a minute")
        return self._anonymous > ANONYMOUS_ENTRIES


def _address(scope: Scope) -> str:
    """Return where a request came from; a proxy on this machine may pass on any text as an address."""
    try:
        return str(ip_address((scope.get("client") or ("",))[0]))
    except ValueError:
        return "unknown"


def _shown(path: str) -> str:
    text = without_keys(path[: 2 * _LONGEST_PATH])[:_LONGEST_PATH]
    return "".join(character if character.isprintable() else "�" for character in text)
