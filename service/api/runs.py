"""Runs: identifications of a measurement set."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Response

from schemas.base import Page
from schemas.query import RunQuery
from schemas.run import Run, RunRequest, RunSummary
from service.api.bodies import MAX_RUN_BYTES, Body, describe_body, read_body
from service.api.examples import RUNS
from service.api.parts import LOCATION, PartsOf, created, json_response, problems
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
def list_runs(parts: PartsOf, query: Annotated[RunQuery, Query()]) -> Page[RunSummary]:
    """List runs without their results, newest first."""
    page = parts.store.page(RunEntry, limit=query.limit, cursor=query.cursor, filters=query.filters())
    items = [RunSummary.model_validate(entry, from_attributes=True) for entry in page.records]
    return Page(items=items, next=page.next)


@router.get("/{run_id}", response_model=Run, responses=problems(404, 422))
def get_run(parts: PartsOf, run_id: Annotated[str, Path(max_length=64)]) -> Response:
    """One run with its request, result and provenance. It never changes."""
    return json_response(parts.store.get(RunRecord, run_id).document)
