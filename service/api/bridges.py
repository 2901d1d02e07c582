"""Bridges from trackers to the page, over HTTP.

These addresses connect the page with the command `jointstiff measure --bridge`, and are no part of the
described API: programs send readings to an open set themselves.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated, Final

import anyio
from anyio.to_thread import run_sync
from fastapi import APIRouter, Path, Request, Response
from fastapi.sse import KEEPALIVE_COMMENT, EventSourceResponse, format_sse_event

from jointstiff.schemas.bridge import Bridge, BridgeCode, BridgePoints, BridgeStand
from jointstiff.service.api import answers
from jointstiff.service.api.bodies import BodyRoute, json_body
from jointstiff.service.api.jobs import RequesterKey
from jointstiff.service.live.bridges import TrackerBridges
from jointstiff.service.problems import NotFoundError
from jointstiff.service.security.access import OPERATOR, Gate, get_requester
from jointstiff.service.store.tables import AccessKey
from jointstiff.solver.errors import RequestError

Id = Annotated[str, Path(max_length=64)]
POLL_SECONDS: Final = 0.3
"""Pause between two polls of a bridge that a page follows [s]."""
POLLS_PER_CHECK: Final = 10
"""Number of polls after which the service checks again whether the key of the page is valid."""
QUIET_SECONDS: Final = 15.0
"""Silence after which a comment is sent, so that no proxy ends the answer [s]."""

router = APIRouter(prefix="/v1", route_class=BodyRoute, include_in_schema=False)


@router.post("/measurement-sets/{set_id}/bridge", dependencies=[OPERATOR], status_code=201)
def open_bridge(parts: answers.InjectedParts, set_id: Id, by: RequesterKey) -> Bridge:
    """Open a bridge to the page of an open set, and get its code."""
    return parts.bridges.open(set_id, by)


@router.post("/bridges", dependencies=[OPERATOR])
async def join_bridge(
    request: Request,
    parts: answers.InjectedParts,
    body: Annotated[BridgeCode, json_body({})],
    by: RequesterKey,
) -> Bridge:
    """Join a bridge with its code, once; wrong codes are counted as wrong keys are."""
    gate: Gate = request.app.state.gate
    address = get_requester(request).address
    await gate.refuse_guesses(address)
    bridge = await run_sync(parts.bridges.join, body.code, by, limiter=request.app.state.work)
    if bridge is None:
        await gate.count_guess(address)
        raise RequestError(
            "no page shows this code",
            where="code",
            remedy="type the code that the page shows now: each code is valid once, for ten minutes",
        )
    return bridge


@router.put("/bridges/{bridge_id}/stand", dependencies=[OPERATOR], status_code=204)
def show_stand(
    parts: answers.InjectedParts, bridge_id: Id, body: Annotated[BridgeStand, json_body({})], by: RequesterKey
) -> Response:
    """State in which posture and under which load the page wants positions."""
    parts.bridges.show_stand(bridge_id, body, by)
    return Response(status_code=204)


@router.post("/bridges/{bridge_id}/points", dependencies=[OPERATOR])
def send_points(
    parts: answers.InjectedParts,
    bridge_id: Id,
    body: Annotated[BridgePoints, json_body({})],
    by: RequesterKey,
) -> Response:
    """Send the last positions of a tracker, and get the stand that the page shows."""
    return answers.json_response(parts.bridges.send_points(bridge_id, body, by).model_dump_json())


@router.get("/bridges/{bridge_id}", dependencies=[OPERATOR])
def follow_bridge(
    request: Request, parts: answers.InjectedParts, bridge_id: Id, by: RequesterKey
) -> EventSourceResponse:
    """Follow a bridge: a stream of events, one `bridge` with each change."""
    parts.bridges.state(bridge_id, by)  # raises an error if there is no such bridge
    return EventSourceResponse(_stream_states(request, parts.bridges, bridge_id, by))


@router.delete("/bridges/{bridge_id}", dependencies=[OPERATOR], status_code=204)
def close_bridge(parts: answers.InjectedParts, bridge_id: Id, by: RequesterKey) -> Response:
    """Close a bridge, the connection through which a page reads a tracker."""
    parts.bridges.close(bridge_id, by)
    return Response(status_code=204)


async def _stream_states(
    request: Request, bridges: TrackerBridges, bridge_id: str, key: AccessKey | None
) -> AsyncIterator[bytes]:
    """Yield an event with the state of a bridge at first and after each change.

    The stream ends with an event `end` when the bridge has ended, and without one when the service is closed
    or the key of the page is no longer valid.
    """
    gate: Gate = request.app.state.gate
    sent, poll_count, silent_seconds = "", 0, 0.0
    while not request.app.state.is_closing():
        try:
            state = await run_sync(bridges.state, bridge_id, key, limiter=request.app.state.work)
        except NotFoundError:
            yield format_sse_event(event="end", data_str="{}")
            return
        if (text := state.model_dump_json()) != sent:
            sent, silent_seconds = text, 0.0
            yield format_sse_event(event="bridge", data_str=text)
        await anyio.sleep(POLL_SECONDS)
        poll_count, silent_seconds = poll_count + 1, silent_seconds + POLL_SECONDS
        if silent_seconds >= QUIET_SECONDS:
            silent_seconds = 0.0
            yield KEEPALIVE_COMMENT
        if poll_count % POLLS_PER_CHECK == 0 and not await gate.may_continue(request, key):
            return
