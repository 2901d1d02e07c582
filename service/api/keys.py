"""For admins: keys, each shown once, in the answer that makes it; the audit of who tried to change what."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Annotated, Any, Final

from anyio.to_thread import run_sync
from fastapi import APIRouter, HTTPException, Path, Query, Request
from fastapi.responses import StreamingResponse

from jointstiff.schemas.access import AuditItem, AuditQuery, Key, KeyList, KeyRequest, NewKey
from jointstiff.schemas.fields import Page
from jointstiff.service.access.key_text import mint
from jointstiff.service.access.keyring import described
from jointstiff.service.api.access import ADMIN
from jointstiff.service.api.bodies import BodyRoute
from jointstiff.service.api.gate import Gate
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.store.store import Store
from jointstiff.service.tables.files import csv_rows, guarded
from jointstiff.solver.errors import RequestError

KeyId = Annotated[str, Path(pattern=r"^[0-9a-f]{10}$")]

router = APIRouter(prefix="/v1", tags=["access"], route_class=BodyRoute, dependencies=[ADMIN])


@router.post("/keys", status_code=201, response_model=NewKey, responses=problems(400, 413, 415, 422))
async def create_key(request: Request, parts: PartsOf, body: KeyRequest) -> NewKey:
    """Make a key. Its text is in this answer and nowhere else; a post that is repeated makes another key."""
    now = datetime.now(UTC)
    if body.expires_at is not None and body.expires_at <= now:
        raise RequestError(
            "the key would have expired already", remedy="give a time in the future", where="expires_at"
        )
    text, record = mint(body.name, body.role, now, body.expires_at)
    await run_sync(parts.store.keys.add, record)
    await _look(request)
    return NewKey(**described(record).model_dump(), key=text)


@router.get("/keys", response_model=KeyList, responses=problems())
async def list_keys(request: Request) -> KeyList:
    """List all keys, those of the file and revoked ones, too, in the order in which they came."""
    gate: Gate = request.app.state.gate
    return KeyList(items=gate.keyring.listing())


@router.delete("/keys/{key_id}", response_model=Key, responses=problems(404, 409, 422))
async def revoke_key(request: Request, parts: PartsOf, key_id: KeyId) -> Key:
    """Revoke a key, and end its sessions. It stays in the list; to do so again changes nothing."""
    gate: Gate = request.app.state.gate
    if gate.keyring.is_filed(key_id):
        raise HTTPException(409, "the key is in the file of keys: revoke it there")
    revoked = await run_sync(parts.store.keys.revoke, key_id, datetime.now(UTC))
    await _look(request)
    return described(revoked)


async def _look(request: Request) -> None:
    """Let the change count here at once; other processes see it at their next look."""
    gate: Gate = request.app.state.gate
    await run_sync(gate.keyring.look)


_PAGE: Final = 1_000
_TABLE: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The audit as CSV (RFC 4180).", "content": {"text/csv": {}}}
}


@router.get("/audit", response_model=Page[AuditItem], responses=problems(422))
def list_audit(parts: PartsOf, query: Annotated[AuditQuery, Query()]) -> Page[AuditItem]:
    """List all requests to change something, refused or not, newest first."""
    entries, cursor = parts.store.audit.page(query.limit, query.cursor, key_id=query.key_id)
    return Page(items=[AuditItem(**asdict(entry)) for entry in entries], next=cursor)


@router.get("/audit/table.csv", response_class=StreamingResponse, responses=_TABLE | problems())
def get_audit_table(parts: PartsOf) -> StreamingResponse:
    """Get the whole audit as a table for spreadsheets, newest first, times in UTC."""
    return StreamingResponse(
        _table(parts.store),
        media_type="text/csv",
        headers={"Content-Disposition": 'attachment; filename="audit.csv"'},
    )


def _table(store: Store) -> Iterator[str]:
    yield csv_rows([list(AuditItem.model_fields)])
    cursor = None
    while True:
        entries, cursor = store.audit.page(_PAGE, cursor)
        rows = [{**asdict(entry), "at": entry.at.isoformat()} for entry in entries]
        yield csv_rows([guarded(value) for value in row.values()] for row in rows)
        if cursor is None:
            return
