"""Measurement sets that are measured live, over HTTP: observations one by one, what is next, and the end."""

from __future__ import annotations

import io
from collections.abc import AsyncIterator
from typing import Annotated, Final

import anyio
from anyio.to_thread import run_sync
from fastapi import APIRouter, Path, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.sse import KEEPALIVE_COMMENT, EventSourceResponse, format_sse_event

from jointstiff.schemas.live import LiveState
from jointstiff.schemas.measurement import Observation
from jointstiff.service.api import answers
from jointstiff.service.api.bodies import BodyRoute, json_body
from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.api.jobs import RequesterKey
from jointstiff.service.live.stored import OpenSets
from jointstiff.service.security.access import OPERATOR, VIEWER, Gate, get_requester

Id = Annotated[str, Path(max_length=64, description="Id of the set.")]
POLL_SECONDS: Final = 0.5
"""Pause between two polls of a live campaign that a client follows [s]."""
POLLS_PER_CHECK: Final = 10
"""Number of polls after which the service checks again whether the key of the client is valid."""
QUIET_SECONDS: Final = 15.0
"""Silence after which a comment is sent, as FastAPI does in the events of jobs [s].

Without comments, a proxy would end a silent answer, and the next event would be lost.
"""

router = APIRouter(prefix="/v1/measurement-sets/{set_id}", tags=["measurement sets"], route_class=BodyRoute)


@router.post("/observations", dependencies=[OPERATOR], status_code=201, response_model=LiveState)
async def add_observation(
    request: Request,
    parts: answers.InjectedParts,
    set_id: Id,
    body: Annotated[Observation, json_body(EXAMPLES["observations"])],
    by: RequesterKey,
) -> Response:
    """Add an observation to an open set, and get the set's new state.

    `readings` compares it with its prediction from the others. The same observation again changes nothing;
    a different observation with a label in use is refused (409).
    """
    state = await run_sync(parts.live.observe, set_id, body, by, limiter=request.app.state.work)
    return answers.json_response(state.model_dump_json(), 201)


@router.get(
    "/next",
    dependencies=[VIEWER],
    response_model=LiveState,
    responses=answers.NOT_MODIFIED,
)
async def get_next(
    request: Request,
    parts: answers.InjectedParts,
    set_id: Id,
    follow: Annotated[
        bool, Query(description="True to receive a stream of events, with one event `state` for each change.")
    ] = False,
) -> Response:
    """Get the results of an open set so far, the next reading and its reason, and how many are still needed.

    With `follow` the answer is a stream of events, the last one when the set is closed.
    """
    state = await run_sync(parts.live.state, set_id, limiter=request.app.state.work)
    if not follow:
        return answers.answer_with_etag(request, state.model_dump_json())
    return EventSourceResponse(_stream_states(request, parts.live, set_id, state))


@router.get("/code.svg", dependencies=[VIEWER], include_in_schema=False)  # a part of the page
def draw_qr_code(
    parts: answers.InjectedParts,
    set_id: Id,
    page: Annotated[
        str, Query(max_length=400, pattern=r"^https?://[^\s#]+$", description="Address of the page.")
    ],
) -> Response:
    """Draw a QR code with the address of the page on which readings of a live campaign are entered.

    A tablet at the robot scans the code from the screen.
    """
    import segno

    parts.live.revision(set_id)  # raises an error if there is no such live campaign
    drawing = io.BytesIO()
    segno.make(f"{page}#/measure/{set_id}", micro=False).save(
        drawing, kind="svg", scale=4, dark="#000", light="#fff"
    )
    return Response(drawing.getvalue(), media_type="image/svg+xml")


@router.post("/close", dependencies=[OPERATOR], response_model=LiveState)
async def close_measurement_set(
    request: Request, parts: answers.InjectedParts, set_id: Id, by: RequesterKey
) -> Response:
    """Close an open set: it becomes an ordinary measurement set of the same id, and gets a run.

    Its notes state the declared goal, how the campaign ended, the held-out reading and withdrawn readings.
    Closing a closed set changes nothing.
    """
    state = await run_sync(parts.live.close, set_id, by, limiter=request.app.state.work)
    return answers.json_response(state.model_dump_json())


async def _stream_states(
    request: Request, sets: OpenSets, set_id: str, latest: LiveState
) -> AsyncIterator[bytes]:
    """Yield an event with the state of a live campaign at first and after each change.

    The stream ends when the campaign or the service is closed, or when the requester's key is no longer
    valid. `latest` is the present state.
    """
    gate: Gate = request.app.state.gate
    sent_revision = -1  # revision of the state that was sent last
    poll_count, silent_seconds = 0, 0.0  # polls so far; time since the last event or comment [s]
    while not request.app.state.is_closing():
        if latest.revision != sent_revision:
            sent_revision, silent_seconds = latest.revision, 0.0
            yield format_sse_event(event="state", data_str=latest.model_dump_json())
        if latest.state == "closed":
            return
        await anyio.sleep(POLL_SECONDS)
        poll_count, silent_seconds = poll_count + 1, silent_seconds + POLL_SECONDS
        if silent_seconds >= QUIET_SECONDS:
            silent_seconds = 0.0
            yield KEEPALIVE_COMMENT
        if poll_count % POLLS_PER_CHECK == 0 and not await gate.may_continue(
            request, get_requester(request).key
        ):
            return
        if await run_in_threadpool(sets.revision, set_id) != sent_revision:
            latest = await run_sync(sets.state, set_id, limiter=request.app.state.work)
