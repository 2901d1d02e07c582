"""Model files and reports of runs, and who authorised them."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from typing import Annotated, Any, Final, Literal, cast

from fastapi import APIRouter, HTTPException, Path, Query, Request, Response

from jointstiff.schemas.assessment import AcceptingOptions
from jointstiff.schemas.report import Authorisation, AuthorisationList, AuthorisationRequest
from jointstiff.schemas.robot import Robot
from jointstiff.schemas.run import Run
from jointstiff.service.api.access import ADMIN, VIEWER, asked_of
from jointstiff.service.api.bodies import BodyRoute
from jointstiff.service.api.jobs import JobId
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.exporting.formats import FORMATS, ModelFormat, export_model
from jointstiff.service.exporting.model import ExportedModel
from jointstiff.service.jobs.parts import Parts
from jointstiff.service.problems.errors import NotFoundError
from jointstiff.service.reports.document import Document, state_of
from jointstiff.service.reports.document import draft as drafted
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.rendering import POLICY, report_page, report_pdf
from jointstiff.service.reports.run import RunSubject, run_document
from jointstiff.service.resources.stored_jobs import stored_job
from jointstiff.service.store.collection import NumberTakenError
from jointstiff.service.store.records import AuthorisationRecord
from jointstiff.solver.errors import RequestError

_MODELS: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "The model.",
        "content": {found.media_type: {} for found in FORMATS.values()},
    }
}

_ISSUED: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The report.", "content": {"application/pdf": {}}}
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
    with a stiffness; URDF has none and gives the numbers in comments. A joint that is rigid, not observable
    or not identified has no spring; the file states the reason. A run with the verdict `do_not_use` is
    refused without `accept_verdict`.
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
        raise HTTPException(409, f"there is no result: the run's state is {run.state}")
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
def get_run_report(
    request: Request,
    parts: PartsOf,
    run_id: JobId,
    format: ReportFormat,  # noqa: A002
    *,
    draft: Annotated[
        bool, Query(description="True: the report as it would be authorised now, even if one was issued.")
    ] = False,
) -> Response:
    """Get the report of a run: results, uncertainty, method, conditions, traceability, by ISO/IEC 17025.

    It is PDF/A-3b with the run and a table attached, or HTML. It is a draft until it is authorised; then it
    never changes, even if metadata, settings or software do. Each page of a superseded report states that.
    """
    subject = _subject(parts, run_id, request.app.state.laboratory)
    own = parts.store.authorisations.of(run_id=run_id)
    if draft or not own:
        return report_answer(run_document(subject, drafted()), format)
    newer = parts.store.authorisations.of(supersedes=run_id)
    if newer:
        state = state_of(_authorisations(own), _authorisations(newer)[-1])
        return report_answer(run_document(subject.as_stated(json.loads(own[-1].stated)), state), format)
    content = own[-1].pdf if format == "pdf" else own[-1].page
    return _file(content, f"{run_id}-{own[-1].number}", format)


@router.get(
    "/{run_id}/issued/{number}.pdf",
    dependencies=[VIEWER],
    response_class=Response,
    responses=_ISSUED | problems(404, 422),
)
def get_issued_report(parts: PartsOf, run_id: JobId, number: Annotated[int, Path(ge=1)]) -> Response:
    """Get the PDF of an authorised report as it was issued, also of one that was superseded."""
    for record in parts.store.authorisations.of(run_id=run_id):
        if record.number == number:
            return _file(record.pdf, f"{run_id}-{number}", "pdf")
    raise HTTPException(404, f"run '{run_id}' has no authorised report {number}")


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
    """Authorise the report of a run, under the name of the key. It is never changed or deleted.

    Its content is stored with the PDF and its SHA-256: later changes of metadata, settings or software do
    not affect it. Another authorisation of the same run issues a report with the next number, which
    supersedes this one. Repeating an authorisation with the same key changes nothing.
    """
    settings: LaboratorySettings = request.app.state.laboratory
    subject = _subject(parts, run_id, settings)
    if settings.laboratory is None:
        raise HTTPException(
            409, "the service has no laboratory to issue reports: start it with --laboratory lab.toml"
        )
    _refuse_unknown(parts, run_id, body.supersedes)
    key = asked_of(request).key
    if key is None:
        raise HTTPException(403, "only a named key can authorise a report, and the request has no key")
    if body.customer is not None:
        changed = settings.laboratory.model_copy(update={"customer": body.customer})
        subject = replace(subject, settings=replace(settings, laboratory=changed))
    subject = replace(subject, received_on=body.received_on)
    while True:
        own = parts.store.authorisations.of(run_id=run_id)
        issued = Authorisation(
            run_id=run_id,
            supersedes=body.supersedes,
            authorised_at=datetime.now(UTC),
            key_id=key.id,
            key_name=key.name,
            content_hash=subject.content_hash(),
            note=body.note,
            number=len(own) + 1,
            pdf_sha256="",
        )
        document = run_document(subject, state_of([*_authorisations(own), issued], None))
        pdf = report_pdf(document)
        record = AuthorisationRecord(
            **issued.model_dump(exclude={"customer", "received_on", "pdf_sha256"}),
            stated=json.dumps(subject.stated()),
            pdf_sha256=hashlib.sha256(pdf).hexdigest(),
            pdf=pdf,
            page=report_page(document),
        )
        with suppress(NumberTakenError):  # by another admin, meanwhile: the next one is stated then
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
    return _file(report_pdf(document) if name == "pdf" else report_page(document), document.number, name)


def _file(content: bytes, number: str, name: ReportFormat) -> Response:
    headers = {"Content-Disposition": f'inline; filename="report-{number}.{name}"'}
    if name == "html":
        headers["Content-Security-Policy"] = POLICY
    media_type = "application/pdf" if name == "pdf" else "text/html"
    return Response(content, media_type=media_type, headers=headers)


def _subject(parts: Parts, run_id: str, settings: LaboratorySettings) -> RunSubject:
    model = exported_model(parts, run_id)
    readings = parts.sets.document(model.run.request.measurement_set_id)
    alarms = parts.trends.alarms_of(readings.robot_id, readings.serial_number)
    return RunSubject(model, readings, settings, alarms=[alarm.message for alarm in alarms])


def _refuse_unknown(parts: Parts, run_id: str, superseded: str | None) -> None:
    if superseded is None:
        return
    if superseded == run_id:
        raise RequestError(
            "a report cannot supersede itself",
            where="supersedes",
            remedy="omit it: the latest report of a run is valid",
        )
    try:
        stored_job(parts.store, Run, superseded)
    except NotFoundError as error:
        raise RequestError(error.reason, where="supersedes", remedy=error.remedy) from error
    if any(record.supersedes == run_id for record in parts.store.authorisations.of(run_id=superseded)):
        raise RequestError(
            f"the report of run '{superseded}' supersedes this one",
            where="supersedes",
            remedy="omit it: if two reports supersede each other, none is valid",
        )


def _authorisations(records: list[AuthorisationRecord]) -> list[Authorisation]:
    """Return authorisations without the files that were issued."""
    found = []
    for record in records:
        document = json.loads(record.stated)
        fields = {name: getattr(record, name) for name in Authorisation.model_fields if hasattr(record, name)}
        fields |= {"customer": document["laboratory"].get("customer"), "received_on": document["received_on"]}
        found.append(Authorisation.model_validate(fields))
    return found
