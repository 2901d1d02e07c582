"""Sessions of browsers: after sign-in with a key, a cookie replaces the key."""

from __future__ import annotations

from typing import cast

from fastapi import APIRouter, Request, Response

from jointstiff.schemas.access import Role, Session, SessionRequest
from jointstiff.service.api.access import PUBLIC, asked_of
from jointstiff.service.api.bodies import BodyRoute
from jointstiff.service.api.gate import Gate, cookie_name
from jointstiff.service.api.parts import problems
from jointstiff.service.store.store import SESSION_LONGEST

router = APIRouter(prefix="/v1/session", tags=["access"], route_class=BodyRoute, dependencies=[PUBLIC])


@router.get("", response_model=Session, responses=problems())
async def get_session(request: Request) -> Session:
    """Return who is answered, and whom the service takes the caller for. Needs no key."""
    gate: Gate = request.app.state.gate
    key = asked_of(request).key
    browser, ends_at = (None, None) if gate.is_open else await gate.session(request)
    return Session(
        access=gate.access,
        key_id=None if key is None else key.id,
        key_name=None if key is None else key.name,
        role=None if key is None else cast("Role", key.role),
        ends_at=ends_at if key is not None and browser is not None and key.id == browser.id else None,
    )


@router.post("", status_code=201, response_model=Session, responses=problems(400, 413, 415, 422))
async def create_session(request: Request, response: Response, body: SessionRequest) -> Session:
    """Sign a browser in with a key or a one-time link: the answer sets a cookie that scripts cannot read.

    The session ends after 8 h without use, after 7 days, when its key is revoked, or by DELETE.
    """
    gate: Gate = request.app.state.gate
    asked = asked_of(request)
    key, link = (None if one is None else one.get_secret_value() for one in (body.key, body.link))
    signed = await gate.sign_in(key, link, asked.address)
    asked.key = signed.key
    await gate.sign_out(request)  # of the session that the new cookie replaces
    response.set_cookie(
        cookie_name(request),
        signed.token,
        max_age=int(SESSION_LONGEST.total_seconds()),
        secure=_is_https(request),
        httponly=True,
        samesite="strict",
    )
    return Session(
        access=gate.access,
        key_id=signed.key.id,
        key_name=signed.key.name,
        role=cast("Role", signed.key.role),
        ends_at=signed.ends_at,
    )


@router.delete("", status_code=204, response_class=Response, responses=problems())
async def delete_session(request: Request) -> Response:
    """Sign the browser out: its session ends for good. One that is not signed in stays as it is."""
    gate: Gate = request.app.state.gate
    await gate.sign_out(request)
    response = Response(status_code=204)
    response.delete_cookie(cookie_name(request), secure=_is_https(request), httponly=True, samesite="strict")
    return response


def _is_https(request: Request) -> bool:
    """Return whether the browser came by HTTPS, maybe to a proxy: it says so in `Origin` itself."""
    return request.url.scheme == "https" or request.headers.get("origin", "").startswith("https://")
