"""Runs beyond their posts: campaign files, actions, authorised reports; and deflections by a run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime
from typing import Annotated, Any, TypeVar, cast

from anyio.to_thread import run_sync
from fastapi import APIRouter, HTTPException, Request, Response

from jointstiff.schemas.deflection import DeflectionRequest, DeflectionResult
from jointstiff.schemas.fields import Message, content_key
from jointstiff.schemas.finding import Action
from jointstiff.schemas.measurement import MeasurementSetDocument, MeasurementSetRequest
from jointstiff.schemas.report import Authorisation, AuthorisationRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import Campaign, CampaignRun, Run, RunRequest
from jointstiff.service.api.answers import PartsOf, accepted, json_response
from jointstiff.service.api.bodies import BodyRoute, Key, large_bodies
from jointstiff.service.api.examples import EXAMPLES, shown
from jointstiff.service.api.files import authorisations_of, run_subject
from jointstiff.service.api.jobs import AskedBy, JobId, JobRoute, Wait, Work, answer
from jointstiff.service.jobs.life import Parts
from jointstiff.service.kinds.deflection import predict_by_run
from jointstiff.service.kinds.mending import mended
from jointstiff.service.problems.errors import NotFoundError
from jointstiff.service.reports.document import state_of
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.rendering import report_page, report_pdf
from jointstiff.service.reports.run import run_document
from jointstiff.service.resources.robots import described, stored_job
from jointstiff.service.security.access import ADMIN, OPERATOR, asked_of
from jointstiff.service.store.collection import Collection, NumberTakenError
from jointstiff.service.store.records import AuthorisationRecord, IdempotencyKey, JobRecord
from jointstiff.solver.errors import JointstiffError, RequestError

Part = TypeVar("Part", bound=Message)

router = APIRouter(tags=["runs"], route_class=JobRoute)
authorisations = APIRouter(tags=["runs"], route_class=BodyRoute)


@router.post(
    "/v1/runs/{run_id}/apply",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=Run,
    responses=accepted(Run),
)
async def apply_action(
    request: Request,
    parts: PartsOf,
    run_id: JobId,
    body: Annotated[Action, shown(EXAMPLES["actions"])],
    work: Work,
    asked_by: AskedBy,
    query: Wait,
) -> Response:
    """Apply an action of a run's assessment, and identify: the new run is a `variant_of` this one.

    Readings or a robot that the action changes are stored beside the old ones, under names that say so. The
    same action of the same run gives the same run.
    """
    jobs = parts.jobs[Run.kind]

    def create() -> JobRecord:
        variant = _variant(parts, cast("Run", jobs.current(run_id)), body)
        return jobs.create(variant, _key(variant.model_dump_json()), asked_by)

    record = await run_sync(create, limiter=work)
    return await answer(jobs, record, query.wait, request.app.state.followers)


def _variant(parts: Parts, run: Run, action: Action) -> RunRequest:
    """Return the request of the run after an action, what it changes being stored.

    Raises:
        HTTPException: the run has no result.
        RequestError: its assessment does not advise the action, or it cannot be applied.
    """
    if run.result is None:
        raise HTTPException(409, f"there is no assessment: the run's state is {run.state}")
    if all(reason.action != action for reason in run.result.assessment.reasons):
        raise RequestError(
            "the assessment of this run does not advise this",
            where="kind",
            remedy="send the `action` of one of its reasons without changes",
        )
    request = run.request.model_copy(update={"variant_of": run.id})
    if action.kind == "leave_out_readings":
        left_out = dict.fromkeys([*request.leave_out, *action.observations])
        return request.model_copy(update={"leave_out": list(left_out)})
    stored = parts.sets.document(request.measurement_set_id)
    robot = described(parts.store.robots.get(stored.robot_id))
    before = Campaign(
        robot=RobotDocument(
            name=robot.name, model=robot.model, joint_map=robot.joint_map, bodies=robot.bodies
        ),
        measurement_set=_named(MeasurementSetDocument, stored),
        run=_named(CampaignRun, request),
    )
    after = mended(before, action)
    robot_id, set_id = stored.robot_id, stored.id
    if after.robot is not before.robot:
        robot_id = _stored_robot(parts, after.robot)
    if after.robot is not before.robot or after.measurement_set is not before.measurement_set:
        set_id = _stored_set(parts, after.measurement_set, robot_id)
    return request.model_copy(update={**dict(after.run), "measurement_set_id": set_id})


def _named(kind: type[Part], source: Message) -> Part:
    """Return the part of a message that has the fields of another."""
    return kind(**{name: getattr(source, name) for name in kind.model_fields})


def _stored_robot(parts: Parts, document: RobotDocument) -> str:
    """Store a robot unless there is one of this content; return its id."""
    return _once(parts.store.robots, parts.robots.create, document)


def _stored_set(parts: Parts, document: MeasurementSetDocument, robot_id: str) -> str:
    """Store readings of a robot unless there are such; return the id of their set."""
    request = MeasurementSetRequest(**dict(document), robot_id=robot_id)
    return _once(parts.store.sets, parts.sets.create, request)


def _once(
    stored: Collection[Any, Any], create: Callable[[Any, IdempotencyKey], Any], document: Message
) -> str:
    """Store a document unless its content was stored before and is still there; return its id."""
    mark = document.model_dump_json()
    while True:
        record = create(document, _key(mark))
        with suppress(NotFoundError):
            return str(stored.get(record.id).id)
        mark += record.id  # the key belongs to the deleted one


def _key(content: str) -> IdempotencyKey:
    """Return the key of a client that posts this content once."""
    return IdempotencyKey(content_key(content), hashlib.sha256(content.encode()).hexdigest())


@router.post(
    "/v1/campaigns",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=Run,
    responses=accepted(Run),
)
async def create_campaign(
    request: Request,
    parts: PartsOf,
    body: Annotated[Campaign, shown(EXAMPLES["campaigns"])],
    key: Key,
    work: Work,
    asked_by: AskedBy,
    query: Wait,
) -> Response:
    """Identify the joint stiffnesses of a campaign file: robot, readings and options in one document.

    Robot and measurement set are stored unless there are such of the same content. Answers with the run as
    `POST /v1/runs` does. What is refused is named by its place in the file; robot and readings of a run that
    is refused are kept.
    """
    jobs = parts.jobs[Run.kind]

    def create() -> JobRecord:
        with _in_section("robot"):
            robot_id = _stored_robot(parts, body.robot)
        with _in_section("measurement_set"):
            set_id = _stored_set(parts, body.measurement_set, robot_id)
        with _in_section("run"):
            return jobs.create(RunRequest(**dict(body.run), measurement_set_id=set_id), key, asked_by)

    record = await run_sync(create, limiter=work)
    return await answer(jobs, record, query.wait, request.app.state.followers)


@contextmanager
def _in_section(section: str) -> Iterator[None]:
    """Name the section of a campaign in an error's place."""
    try:
        yield
    except JointstiffError as error:
        error.where = ".".join(part for part in (section, error.where) if part)
        raise


@authorisations.post(
    "/v1/runs/{run_id}/authorisations", dependencies=[ADMIN], status_code=201, response_model=Authorisation
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
    subject = run_subject(parts, run_id, settings)
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
        document = run_document(subject, state_of([*authorisations_of(own), issued], None))
        pdf = report_pdf(document)
        record = AuthorisationRecord(
            **issued.model_dump(exclude={"customer", "received_on", "pdf_sha256"}),
            stated=json.dumps(subject.stated()),
            pdf_sha256=hashlib.sha256(pdf).hexdigest(),
            pdf=pdf,
            page=report_page(document),
        )
        with suppress(NumberTakenError):  # by another admin, meanwhile: the next one is stated then
            return authorisations_of([parts.store.authorisations.add(record)])[0]


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


@authorisations.post("/v1/deflections", dependencies=[OPERATOR], response_model=DeflectionResult)
async def compute_deflections(
    request: Request, parts: PartsOf, body: Annotated[DeflectionRequest, shown(EXAMPLES["deflections"])]
) -> Response:
    """Predict deflection, rotation and Cartesian compliance by the model of a run. Nothing is stored.

    Each case has a posture, a load and a place. Intervals are of two kinds: `readings_only` includes the
    errors of the readings and the stated errors of the force; `with_model_error` also includes the model
    error, calibrated on held-out postures. A run never changes, so the same request has the same answer.
    """
    # Many cases take seconds: predictions wait for their turn, and leave the other requests theirs.
    return json_response(await run_sync(_predicted, parts, body, limiter=large_bodies(request)))


def _predicted(parts: Parts, body: DeflectionRequest) -> str:
    try:
        run = stored_job(parts.store, Run, body.run_id)
        robot = parts.sets.prepared(run.request.measurement_set_id).robot
    except NotFoundError as error:
        raise RequestError(error.reason, remedy=error.remedy, where="run_id") from error
    return predict_by_run(robot, run, body).model_dump_json()
