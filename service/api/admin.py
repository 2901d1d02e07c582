"""Signing in; and for admins: keys, whose secrets are shown once, and the audit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Annotated, Any, Final, cast

from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, HTTPException, Path, Query, Request, Response
from fastapi.responses import StreamingResponse

from jointstiff.schemas import access
from jointstiff.schemas.fields import Page
from jointstiff.service.api.answers import InjectedParts
from jointstiff.service.api.bodies import BodyRoute
from jointstiff.service.security.access import ADMIN, PUBLIC, Gate, get_requester, make_cookie_name
from jointstiff.service.security.keys import describe_key, make_key
from jointstiff.service.store.store import SESSION_LONGEST, Store
from jointstiff.service.store.tables import AccessKey
from jointstiff.service.tables.files import csv_rows, escape_formula
from jointstiff.solver.errors import RequestError

KeyId = Annotated[str, Path(pattern=r"^[0-9a-f]{10}$")]


def _get_access_gate(request: Request) -> Gate:
    """Return the gate of the application, which checks keys and sessions."""
    return cast("Gate", request.app.state.gate)


InjectedGate = Annotated[Gate, Depends(_get_access_gate)]
_ENTRIES_PER_PAGE: Final = 1_000
_AUDIT_RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "A page; or the table (RFC 4180, times in UTC).", "content": {"text/csv": {}}}
}

sessions = APIRouter(prefix="/v1/session", tags=["access"], route_class=BodyRoute, dependencies=[PUBLIC])
router = APIRouter(prefix="/v1", tags=["access"], route_class=BodyRoute, dependencies=[ADMIN])


@sessions.get("", response_model=access.Session)
async def get_session(gate: InjectedGate, request: Request) -> access.Session:
    """Get whom the service answers, and the caller's key and role. Needs no key."""
    key = get_requester(request).key
    # The session has an end only if the requester's key is that of the browser's session.
    session_key, ends_at = (None, None) if gate.is_open else await gate.find_session(request)
    is_of_session = key is not None and session_key is not None and key.id == session_key.id
    return _describe_session(gate, key, ends_at if is_of_session else None)


@sessions.post("", status_code=201, response_model=access.Session)
async def create_session(
    gate: InjectedGate, request: Request, response: Response, body: access.SessionRequest
) -> access.Session:
    """Sign a browser in with a key or a one-time link: the answer sets a cookie that scripts cannot read.

    The session ends after 8 h without use, after 7 days, when its key is revoked, or by DELETE.
    """
    requester = get_requester(request)
    key, link = (None if secret is None else secret.get_secret_value() for secret in (body.key, body.link))
    session = await gate.sign_in(key, link, requester.address)
    requester.key = session.key
    await gate.sign_out(request)  # ends the browser's old session, as the new cookie replaces the old one
    response.set_cookie(
        make_cookie_name(request),
        session.token,
        max_age=int(SESSION_LONGEST.total_seconds()),
        secure=_is_https(request),
        httponly=True,
        samesite="strict",
    )
    return _describe_session(gate, session.key, session.ends_at)


@sessions.delete("", status_code=204, response_class=Response)
async def delete_session(gate: InjectedGate, request: Request) -> Response:
    """Sign the browser out: its session ends for good. Signing out again changes nothing."""
    await gate.sign_out(request)
    response = Response(status_code=204)
    response.delete_cookie(
        make_cookie_name(request), secure=_is_https(request), httponly=True, samesite="strict"
    )
    return response


def _describe_session(gate: Gate, key: AccessKey | None, ends_at: datetime | None) -> access.Session:
    """Return the description of a session: access control, the key (None without one), and the end."""
    if key is None:
        return access.Session(access=gate.access, key_id=None, key_name=None, role=None, ends_at=None)
    role = cast("access.Role", key.role)
    return access.Session(access=gate.access, key_id=key.id, key_name=key.name, role=role, ends_at=ends_at)


def _is_https(request: Request) -> bool:
    """Return whether the browser uses HTTPS, to this service or to a proxy in front of it.

    The header `Origin` shows whether the browser uses HTTPS to a proxy.
    """
    return request.url.scheme == "https" or request.headers.get("origin", "").startswith("https://")


@router.post("/keys", status_code=201, response_model=access.Key)
async def create_key(gate: InjectedGate, parts: InjectedParts, body: access.KeyRequest) -> access.Key:
    """Create a key. Only this answer contains its text; a repeated post creates another key."""
    now = datetime.now(UTC)
    if body.expires_at is not None and body.expires_at <= now:
        raise RequestError(
            "the key would have expired already", remedy="give a time in the future", where="expires_at"
        )
    text, record = make_key(body.name, body.role, now, body.expires_at)
    await run_sync(parts.store.keys.add, record)
    # The key is valid in this process at once, and in other processes when they next read the keys.
    await run_sync(gate.keyring.read_keys)
    return describe_key(record).model_copy(update={"key": text})


@router.get("/keys", response_model=list[access.Key])
async def list_keys(gate: InjectedGate) -> list[access.Key]:
    """List all keys, including revoked keys and keys of the file, in the order of creation."""
    return gate.keyring.list_keys()


@router.delete("/keys/{key_id}", response_model=access.Key)
async def revoke_key(gate: InjectedGate, parts: InjectedParts, key_id: KeyId) -> access.Key:
    """Revoke a key, and end its sessions. It stays in the list; revoking it again changes nothing."""
    if gate.keyring.is_in_file(key_id):
        raise HTTPException(409, "the key is in the file of keys: revoke the key in this file")
    revoked = await run_sync(parts.store.keys.revoke, key_id, datetime.now(UTC))
    # This process refuses the key at once, and other processes when they next read the keys.
    await run_sync(gate.keyring.read_keys)
    return describe_key(revoked)


@router.get("/audit", response_model=Page[access.AuditItem], responses=_AUDIT_RESPONSES)
def list_audit(
    parts: InjectedParts, query: Annotated[access.AuditQuery, Query()]
) -> Page[access.AuditItem] | Response:
    """List all requests to change something, refused or not, newest first; or get all as a table."""
    if query.format == "csv":
        headers = {"Content-Disposition": 'attachment; filename="audit.csv"'}
        return StreamingResponse(
            _iterate_audit_csv(parts.store, query.key_id), media_type="text/csv", headers=headers
        )
    page = parts.store.audit.page(query.limit, query.cursor, counted=True, key_id=query.key_id)
    items = [access.AuditItem(**asdict(entry)) for entry in page.records]
    return Page(items=items, next=page.next, total=page.total)


def _iterate_audit_csv(store: Store, key_id: str | None) -> Iterator[str]:
    """Yield the audit as parts of a CSV table: the header, then one part for each page of entries.

    If `key_id` is given, the table has only the requests that were made with this key.
    """
    yield csv_rows([list(access.AuditItem.model_fields)])
    page = store.audit.page(_ENTRIES_PER_PAGE, key_id=key_id)
    while True:
        rows = [{**asdict(entry), "at": entry.at.isoformat()} for entry in page.records]
        yield csv_rows([escape_formula(value) for value in row.values()] for row in rows)
        if page.next is None:
            return
        page = store.audit.page(_ENTRIES_PER_PAGE, page.next, key_id=key_id)
