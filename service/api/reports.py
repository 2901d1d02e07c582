"""Reports to sign."""

from __future__ import annotations

from typing import Any, Final, Literal

from fastapi import APIRouter, Request, Response

from jointstiff.service.api.access import VIEWER, AccessRoute
from jointstiff.service.api.exports import exported_model
from jointstiff.service.api.jobs import JobId
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.jobs import Parts
from jointstiff.service.reports import (
    POLICY,
    Document,
    LaboratorySettings,
    RunSubject,
    draft,
    report_page,
    report_pdf,
    run_document,
)

ReportFormat = Literal["pdf", "html"]
_FILES: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The report.", "content": {"application/pdf": {}, "text/html": {}}}
}

router = APIRouter(prefix="/v1/runs", tags=["runs"], route_class=AccessRoute)


@router.get(
    "/{run_id}/report.{format}",
    dependencies=[VIEWER],
    response_class=Response,
    responses=_FILES | problems(404, 409, 422),
)
def get_run_report(request: Request, parts: PartsOf, run_id: JobId, format: ReportFormat) -> Response:  # noqa: A002
    """Get the report of a run: results, uncertainty, method, conditions, traceability, by ISO/IEC 17025.

    PDF/A-3b with the run and a table within, or HTML. It is a draft until it is authorised. The same run,
    metadata, settings and authorisations give the same bytes.
    """
    subject = _subject(parts, run_id, request.app.state.laboratory)
    return answered(run_document(subject, draft()), format)


def answered(document: Document, name: ReportFormat) -> Response:
    """Return a report as a file of a format."""
    headers = {"Content-Disposition": f'inline; filename="report-{document.number}.{name}"'}
    if name == "pdf":
        return Response(report_pdf(document), media_type="application/pdf", headers=headers)
    headers["Content-Security-Policy"] = POLICY
    return Response(report_page(document), media_type="text/html", headers=headers)


def _subject(parts: Parts, run_id: str, settings: LaboratorySettings) -> RunSubject:
    model = exported_model(parts, run_id)
    return RunSubject(model, parts.sets.document(model.run.request.measurement_set_id), settings)
