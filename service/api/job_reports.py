"""Reports of comparisons, pairs, plans, maps and programs; tables of pairs and plans."""

from __future__ import annotations

from typing import Annotated, Any, Final, TypeVar, cast

from fastapi import APIRouter, HTTPException, Path, Request, Response

from jointstiff.schemas.job import Job
from jointstiff.schemas.pair import Pair
from jointstiff.schemas.plan import Plan
from jointstiff.service.api.access import VIEWER, AccessRoute
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.api.reports import REPORT_FILES, ReportFormat, report_answer
from jointstiff.service.jobs.parts import Parts
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.pair.csv_table import pair_csv
from jointstiff.service.kinds.plan.tables import plan_csv
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.reports.job import REPORTED_KINDS, job_document

AnyJob = TypeVar("AnyJob", bound=Job)
_TABLE: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The table as CSV (RFC 4180).", "content": {"text/csv": {}}}
}
router = APIRouter(route_class=AccessRoute)


def _add_report(kind: AnyKind) -> None:
    identifier = Annotated[str, Path(alias=f"{kind.name}_id", max_length=64)]

    def report(
        request: Request,
        parts: PartsOf,
        job_id: identifier,
        format: ReportFormat,  # noqa: A002
    ) -> Response:
        job = _succeeded(parts, kind.message, job_id)
        document = kind.answered(parts.jobs[kind.name].document(job.id))
        return report_answer(job_document(job, document, request.app.state.laboratory), format)

    report.__annotations__["job_id"] = identifier
    router.get(
        f"/v1/{kind.collection}/{{{kind.name}_id}}/report.{{format}}",
        name=f"get_{kind.name}_report",
        dependencies=[VIEWER],
        tags=[kind.collection],
        description=f"Get the report of a {kind.name} as PDF or HTML: what was asked for, the tables of the "
        "result, versions and hash of the input. It is for information, and nobody signs it.",
        response_class=Response,
        responses=REPORT_FILES | problems(404, 409, 422),
    )(report)


for _kind in KINDS:
    if _kind.name in REPORTED_KINDS:
        _add_report(_kind)


@router.get(
    "/v1/pairs/{pair_id}/table.csv",
    dependencies=[VIEWER],
    tags=["pairs"],
    response_class=Response,
    responses=_TABLE | problems(404, 409, 422),
)
def get_pair_table(parts: PartsOf, pair_id: Annotated[str, Path(max_length=64)]) -> Response:
    """Get the joints of both sides with their ratio as a table for spreadsheets, units in the headers."""
    result = _succeeded(parts, Pair, pair_id).result
    return _csv("" if result is None else pair_csv(result), f"pair-{pair_id}")


@router.get(
    "/v1/plans/{plan_id}/readings.csv",
    dependencies=[VIEWER],
    tags=["plans"],
    response_class=Response,
    responses=_TABLE | problems(404, 409, 422),
)
def get_plan_table(parts: PartsOf, plan_id: Annotated[str, Path(max_length=64)]) -> Response:
    """Get the readings of a plan in their order as a table for spreadsheets, units in the headers."""
    result = _succeeded(parts, Plan, plan_id).result
    return _csv("" if result is None else plan_csv(result), f"plan-{plan_id}")


def _succeeded(parts: Parts, message: type[AnyJob], job_id: str) -> AnyJob:
    """Return a job with its result.

    Raises:
        HTTPException: it has none.
    """
    job = cast("AnyJob", parts.jobs[message.kind].current(job_id))
    if job.result is None:
        raise HTTPException(409, f"there is no result, because the {job.kind}'s state is {job.state}")
    return job


def _csv(text: str, name: str) -> Response:
    headers = {"Content-Disposition": f'attachment; filename="{name}.csv"'}
    return Response(text, media_type="text/csv", headers=headers)
