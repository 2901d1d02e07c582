"""Keys: made, listed and revoked by admins. A key is shown once, in the answer that makes it."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

from anyio.to_thread import run_sync
from fastapi import APIRouter, HTTPException, Path, Request

from jointstiff.schemas.access import Key, KeyList, KeyRequest, NewKey
from jointstiff.service.access.key_text import mint
from jointstiff.service.access.keyring import described
from jointstiff.service.api.access import ADMIN
from jointstiff.service.api.bodies import BodyRoute
from jointstiff.service.api.gate import Gate
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.solver.errors import RequestError

KeyId = Annotated[str, Path(pattern=r"^[0-9a-f]{10}$")]

router = APIRouter(prefix="/v1/keys", tags=["access"], route_class=BodyRoute, dependencies=[ADMIN])


@router.post("", status_code=201, response_model=NewKey, responses=problems(400, 413, 415, 422))
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


@router.get("", response_model=KeyList, responses=problems())
async def list_keys(request: Request) -> KeyList:
    """List all keys, those of the file and revoked ones, too, in the order in which they came."""
    gate: Gate = request.app.state.gate
    return KeyList(items=gate.keyring.listing())


@router.delete("/{key_id}", response_model=Key, responses=problems(404, 409, 422))
async def revoke_key(request: Request, parts: PartsOf, key_id: KeyId) -> Key:
    """Revoke a key for good, and end its sessions. It stays in the list; to do so again changes nothing."""
    gate: Gate = request.app.state.gate
    if gate.keyring.is_filed(key_id):
        raise HTTPException(409, "the key stands in the file of keys; revoke it there")
    revoked = await run_sync(parts.store.keys.revoke, key_id, datetime.now(UTC))
    await _look(request)
    return described(revoked)


async def _look(request: Request) -> None:
    """Let the change count here at once; other processes see it at their next look."""
    gate: Gate = request.app.state.gate
    await run_sync(gate.keyring.look)
