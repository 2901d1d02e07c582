"""Runs: identifications of a measurement set."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Response

from schemas.base import Page
from schemas.run import Method, Run, RunRequest, RunState, RunSummary, Weighting
from service.api.bodies import MAX_RUN_BYTES, Body, describe_body, read_body
from service.api.examples import RUNS
from service.api.parts import LOCATION, Cursor, Limit, PartsOf, created, filters, json_response, problems
from service.records import RunEntry, RunRecord

__all__ = ["router"]

router = APIRouter(prefix="/v1/runs", tags=["runs"])


@router.post(
    "",
    status_code=201,
    response_model=Run,
    responses=LOCATION | problems(400, 413, 415, 422),
    openapi_extra=describe_body(RunRequest, RUNS),
)
def post_run(parts: PartsOf, body: Annotated[Body, Depends(read_body(MAX_RUN_BYTES))]) -> Response:
    """Identify the joint stiffnesses, and store the result with its provenance.

    A method that the readings cannot support is refused, and nothing is stored. Any other failure is
    a stored run in state `failed` that says why.
    """
    record = parts.runs.create(body.parse(RunRequest), body.key)
    return created("runs", record.id, record.document)


@router.get("", response_model=Page[RunSummary], responses=problems(422))
def list_runs(
    parts: PartsOf,
    limit: Limit = 50,
    cursor: Cursor = None,
    measurement_set_id: Annotated[str | None, Query(max_length=64)] = None,
    robot_id: Annotated[str | None, Query(max_length=64)] = None,
    method: Annotated[Method | None, Query()] = None,
    weighting: Annotated[Weighting | None, Query()] = None,
    state: Annotated[RunState | None, Query()] = None,
) -> Page[RunSummary]:
    """List runs without their results, newest first."""
    chosen = filters(
        measurement_set_id=measurement_set_id,
        robot_id=robot_id,
        method=method,
        weighting=weighting,
        state=state,
    )
    page = parts.store.page(RunEntry, limit=limit, cursor=cursor, filters=chosen)
    items = [RunSummary.model_validate(entry, from_attributes=True) for entry in page.records]
    return Page(items=items, next=page.next)


@router.get("/{run_id}", response_model=Run, responses=problems(404, 422))
def get_run(parts: PartsOf, run_id: Annotated[str, Path(max_length=64)]) -> Response:
    """One run with its request, result and provenance. It never changes."""
    return json_response(parts.store.get(RunRecord, run_id).document)
