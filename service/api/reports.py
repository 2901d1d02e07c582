"""Model files and reports of runs, and who authorised them."""

from __future__ import annotations

from dataclasses import asdict
from datetime import UTC, datetime
from typing import Annotated, Any, Final, Literal, cast

from fastapi import APIRouter, HTTPException, Query, Request, Response

from jointstiff.schemas.assessment import AcceptingOptions
from jointstiff.schemas.report import Authorisation, AuthorisationList, AuthorisationRequest
from jointstiff.schemas.robot import Robot
from jointstiff.schemas.run.run import Run
from jointstiff.service.api.access import ADMIN, VIEWER, asked_of
from jointstiff.service.api.bodies import BodyRoute
from jointstiff.service.api.jobs import JobId
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.exporting.formats import FORMATS, ModelFormat, export_model
from jointstiff.service.exporting.model import ExportedModel
from jointstiff.service.jobs.parts import Parts
from jointstiff.service.problems.errors import NotFoundError
from jointstiff.service.reports.document import Document
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.page import POLICY, report_page
from jointstiff.service.reports.pdf import report_pdf
from jointstiff.service.reports.run import RunSubject, run_document
from jointstiff.service.reports.state import state_of
from jointstiff.service.resources.stored_jobs import stored_job
from jointstiff.service.store.records import AuthorisationRecord
from jointstiff.solver.errors import RequestError

_MODELS: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "The model.",
        "content": {found.media_type: {} for found in FORMATS.values()},
    }
}

router = APIRouter(prefix="/v1/runs", tags=["runs"], route_class=BodyRoute)


@router.get(
    "/{run_id}/model.{format}",
    dependencies=[VIEWER],
    response_class=Response,
    responses=_MODELS | problems(404, 409, 422),
)
def get_run_model(
    parts: PartsOf,
    run_id: JobId,
    format: ModelFormat,  # noqa: A002
    query: Annotated[AcceptingOptions, Query()],
) -> Response:
    """Get the identified model as a file: tables (csv, xlsx), URDF, SDFormat, or MJCF of MuJoCo.

    Tables have the intervals, with units in every header. MJCF and SDFormat have a spring for each joint
    with a stiffness; URDF has none, so the numbers stand in comments. A joint that is rigid, not observable
    or not identified has no spring, and the file says why. A run not to be used is refused unless
    `accept_verdict` says so.
    """
    content = export_model(exported_model(parts, run_id), format, query.accept_verdict)
    return Response(
        content,
        media_type=FORMATS[format].media_type,
        headers={"Content-Disposition": f'attachment; filename="model-{run_id}.{format}"'},
    )


def exported_model(parts: Parts, run_id: str) -> ExportedModel:
    """Return the model of a stored run.

    Raises:
        HTTPException: the run has no result.
    """
    run = cast("Run", parts.jobs[Run.kind].current(run_id))
    if run.result is None:
        raise HTTPException(409, f"there is no result, because the run's state is {run.state}")
    prepared = parts.sets.prepared(run.request.measurement_set_id)
    stored = Robot.model_validate_json(parts.store.robots.get(prepared.robot_id).document)
    return ExportedModel(run, run.result, prepared.robot, stored.name, stored.geometry_id)


ReportFormat = Literal["pdf", "html"]
REPORT_FILES: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The report.", "content": {"application/pdf": {}, "text/html": {}}}
}


@router.get(
    "/{run_id}/report.{format}",
    dependencies=[VIEWER],
    response_class=Response,
    responses=REPORT_FILES | problems(404, 409, 422),
)
def get_run_report(request: Request, parts: PartsOf, run_id: JobId, format: ReportFormat) -> Response:  # noqa: A002
    """Get the report of a run: results, uncertainty, method, conditions, traceability, by ISO/IEC 17025.

    PDF/A-3b with the run and a table within, or HTML. It is a draft until it is authorised. The same run,
    metadata, settings and authorisations give the same bytes.
    """
    subject = _subject(parts, run_id, request.app.state.laboratory)
    newer = _authorisations(parts.store.authorisations.of(supersedes=run_id))
    own = _authorisations(parts.store.authorisations.of(run_id=run_id))
    state = state_of(own, newer[-1] if newer else None, subject.content_hash())
    return report_answer(run_document(subject, state), format)


@router.post(
    "/{run_id}/authorisations",
    dependencies=[ADMIN],
    status_code=201,
    response_model=Authorisation,
    responses=problems(400, 404, 409, 413, 415, 422, 507),
)
def authorise_run(
    request: Request, parts: PartsOf, run_id: JobId, body: AuthorisationRequest
) -> Authorisation:
    """Authorise the report of a run, under the name of the key. It is never changed and never removed.

    The report is a draft again if the set's metadata, the robot's name or the laboratory's settings change.
    The same authorisation of the same report by the same key is one.
    """
    settings: LaboratorySettings = request.app.state.laboratory
    subject = _subject(parts, run_id, settings)
    if settings.laboratory is None:
        raise HTTPException(
            409, "no laboratory issues the report: start the service with --laboratory lab.toml"
        )
    _refuse_unknown(parts, run_id, body.supersedes)
    key = asked_of(request).key
    if key is None:
        raise HTTPException(403, "a report is authorised under a named key, and none came")
    record = AuthorisationRecord(
        run_id=run_id,
        supersedes=body.supersedes,
        authorised_at=datetime.now(UTC),
        key_id=key.id,
        key_name=key.name,
        content_hash=subject.content_hash(),
        note=body.note,
    )
    return _authorisations([parts.store.authorisations.add(record)])[0]


@router.get(
    "/{run_id}/authorisations",
    dependencies=[VIEWER],
    response_model=AuthorisationList,
    responses=problems(404, 422),
)
def list_run_authorisations(parts: PartsOf, run_id: JobId) -> AuthorisationList:
    """List the authorisations of a run's report, in the order in which they came."""
    stored_job(parts.store, Run, run_id)
    return AuthorisationList(items=_authorisations(parts.store.authorisations.of(run_id=run_id)))


def report_answer(document: Document, name: ReportFormat) -> Response:
    """Return a report as a file of a format."""
    headers = {"Content-Disposition": f'inline; filename="report-{document.number}.{name}"'}
    if name == "pdf":
        return Response(report_pdf(document), media_type="application/pdf", headers=headers)
    headers["Content-Security-Policy"] = POLICY
    return Response(report_page(document), media_type="text/html", headers=headers)


def _subject(parts: Parts, run_id: str, settings: LaboratorySettings) -> RunSubject:
    model = exported_model(parts, run_id)
    return RunSubject(model, parts.sets.document(model.run.request.measurement_set_id), settings)


def _refuse_unknown(parts: Parts, run_id: str, superseded: str | None) -> None:
    if superseded is None:
        return
    if superseded == run_id:
        raise RequestError(
            "a report does not supersede itself", where="supersedes", remedy="omit it: a later one counts"
        )
    try:
        stored_job(parts.store, Run, superseded)
    except NotFoundError as error:
        raise RequestError(error.reason, where="supersedes", remedy=error.remedy) from error
    if any(record.supersedes == run_id for record in parts.store.authorisations.of(run_id=superseded)):
        raise RequestError(
            f"the report of run '{superseded}' supersedes this one",
            where="supersedes",
            remedy="omit it: of two reports that supersede each other none would count",
        )


def _authorisations(records: list[AuthorisationRecord]) -> list[Authorisation]:
    return [Authorisation(**asdict(record)) for record in records]
