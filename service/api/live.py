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
"""Pause between two polls of an open set that is followed [s]."""
POLLS_PER_CHECK: Final = 10
"""Number of polls after which the service checks again whether the client may follow."""
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
    """Add an observation to an open set, and get what all of them say.

    `readings` compares it with what the others let expect. The same observation again changes nothing;
    another one of its label is refused (409).
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
        bool, Query(description="True for a stream of events, one `state` with each change.")
    ] = False,
) -> Response:
    """Get what the readings of an open set say so far, what to read next and why, and how many follow.

    With `follow` the answer is a stream of events, the last one when the set is closed.
    """
    state = await run_sync(parts.live.state, set_id, limiter=request.app.state.work)
    if not follow:
        return answers.answer_with_tag(request, state.model_dump_json())
    return EventSourceResponse(_stream_states(request, parts.live, set_id, state))


@router.get("/code.svg", dependencies=[VIEWER], include_in_schema=False)  # a part of the page
def get_code(
    parts: answers.InjectedParts,
    set_id: Id,
    page: Annotated[
        str, Query(max_length=400, pattern=r"^https?://[^\s#]+$", description="Address of the page.")
    ],
) -> Response:
    """Draw a QR code of the page's address of an open set, for a tablet at the robot."""
    import segno

    parts.live.revision(set_id)  # raises an error for an unknown set
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

    Its notes state the declared goal, how it ended, the held-out reading and what was withdrawn. To close it
    again changes nothing.
    """
    state = await run_sync(parts.live.close, set_id, by, limiter=request.app.state.work)
    return answers.json_response(state.model_dump_json())


async def _stream_states(
    request: Request, sets: OpenSets, set_id: str, latest: LiveState
) -> AsyncIterator[bytes]:
    """Yield an event with the state of an open set at each change.

    The stream ends when the set or the service is closed, or when the requester's key is no longer valid.
    `latest` is the first state.
    """
    gate: Gate = request.app.state.gate
    # The revision that was sent last, the number of polls, and the time since the last event or comment [s].
    sent_revision, poll_count, silent_seconds = -1, 0, 0.0
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
