"""Routes for campaign files, actions of an assessment, deflections, and forms with files.

Readings in files are previewed before anything is stored; programs in files are corrected.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Annotated, Any, Final, TypeVar, cast

from anyio.to_thread import run_sync
from fastapi import APIRouter, File, Form, Request, Response, UploadFile
from pydantic import Json, JsonValue, TypeAdapter, ValidationError

from jointstiff.schemas.deflection import DeflectionRequest, DeflectionResult
from jointstiff.schemas.fields import MAX_NAME_LENGTH, Message, Name, content_key
from jointstiff.schemas.finding import AdvisedAction
from jointstiff.schemas.imports import ImportAnswer, ImportRequest
from jointstiff.schemas.measurement import MeasurementSetDocument, MeasurementSetRequest
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.robot import CatalogueModel, RobotChange, RobotDocument
from jointstiff.schemas.run import Campaign, Run, RunRequest
from jointstiff.service.api.answers import (
    InjectedParts,
    describe_post_responses,
    json_response,
    make_missing_error,
)
from jointstiff.service.api.bodies import (
    MAX_FILES,
    BodyRoute,
    Key,
    garbage_collector_paused,
    json_body,
    limiter_of_large_work,
)
from jointstiff.service.api.description import describe_problems
from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.api.jobs import InjectedPost, JobId, JobRoute
from jointstiff.service.imports.formats import SourceFile
from jointstiff.service.jobs import Jobs, Parts
from jointstiff.service.problems import NotFoundError, find_path_in_document
from jointstiff.service.resources.stored import load_job, robot_from_record
from jointstiff.service.runs.deflection import predict_by_run
from jointstiff.service.runs.mending import apply_action_to_campaign, fill_in_payload
from jointstiff.service.security.access import OPERATOR
from jointstiff.service.store.collection import Collection
from jointstiff.service.store.tables import IdempotencyKey, JobRecord
from jointstiff.solver.errors import JointstiffError, RequestError
from jointstiff.solver.mechanics.robot import KnownRobot

AMessage = TypeVar("AMessage", bound=Message)

router = APIRouter(tags=["runs"], route_class=JobRoute)
deflections = APIRouter(tags=["runs"], route_class=BodyRoute)
imports = APIRouter(tags=["measurement sets"], route_class=BodyRoute)

_NAME: Final = TypeAdapter(Name)

_DEFAULTS: Final = ImportRequest()
_IMPORT: Final = EXAMPLES["imports"]["one table"]

BINARY: Final[dict[str, JsonValue]] = {
    "type": "string",
    "contentMediaType": "application/octet-stream",
    "format": "binary",  # as OpenAPI 3.0 has it, by which generated clients know a file
}

_Readings = Annotated[
    list[UploadFile],
    File(
        description="Tables (csv, xlsx, xls, ods, json, mat, npz, hdf5, parquet), each with its file name.",
        min_length=1,
        max_length=MAX_FILES,
        examples=[_IMPORT["files"]],
        json_schema_extra={"items": BINARY},
    ),
]
_ImportOptions = Annotated[
    Json[ImportRequest],
    Form(examples=[json.dumps(_IMPORT["options"])], json_schema_extra={"default": "{}"}),
]


@router.post(
    "/v1/runs/{run_id}/apply",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=Run,
    responses=describe_post_responses(Run),
)
async def apply_action(
    posted: InjectedPost, run_id: JobId, body: Annotated[AdvisedAction, json_body(EXAMPLES["actions"])]
) -> Response:
    """Apply an action of a run's assessment, and identify: the new run is a `variant_of` this one.

    Readings or a robot that the action changes are stored in addition to the old ones, under names that show
    the change. A payload is kept with the robot itself. The same action of the same run gives the same run.
    """

    def create(jobs: Jobs) -> JobRecord:
        """Store the changed inputs and the job of the new run; return the job's record."""
        variant = _make_request_after_action(posted.parts, cast("Run", jobs.current(run_id)), body)
        # The payload is no field of the request: another payload is another run.
        payload = "" if body.payload is None else f" {body.payload!r} kg"
        return jobs.create(variant, _make_key_from_content(variant.model_dump_json() + payload), posted.by)

    return await posted.answer(Run.kind_name(), create)


def _make_request_after_action(parts: Parts, run: Run, action: AdvisedAction) -> RunRequest:
    """Apply an action to the inputs of a run; store changed inputs, and return the request of the new run.

    An action changes the robot itself (`state_payload`), the options of the run (`leave_out_readings`,
    `fit_causes`), or a copy of robot and readings (all others).

    Raises:
        HTTPException: the run has no result (409).
        RequestError: the run's assessment does not recommend the action, or the action cannot be applied.
    """
    _refuse_unadvised(run, action)
    request = run.request.model_copy(update={"variant_of": run.id})
    if action.kind == "state_payload":
        robot_id = parts.sets.document(request.measurement_set_id).robot_id
        parts.robots.change(robot_id, RobotChange(payload=fill_in_payload(action, action.payload).payload))
        return request
    if action.kind in {"leave_out_readings", "fit_causes"}:
        left_out = dict.fromkeys([*request.leave_out, *action.observations])
        causes = [*request.causes, *action.causes]
        return request.model_copy(update={"leave_out": list(left_out), "causes": causes})
    return _store_changed_inputs(parts, request, action)


def _refuse_unadvised(run: Run, action: AdvisedAction) -> None:
    """Refuse an action that no reason of a run's assessment states, apart from a payload that is filled in.

    Raises:
        HTTPException: the run has no result (409).
        RequestError: the run's assessment does not recommend the action.
    """
    if run.result is None:
        raise make_missing_error(run, "assessment")
    advised_action = action
    if action.kind == "state_payload":
        advised_action = action.model_copy(update={"payload": None})
    assessment = run.result.assessment
    if all(each.action != advised_action for each in (*assessment.reasons, *assessment.questions)):
        raise RequestError(
            "the assessment of this run does not recommend this action",
            where="kind",
            remedy="send the `action` of one of the reasons of this assessment; only `payload` is filled in",
        )


def _store_changed_inputs(parts: Parts, request: RunRequest, action: AdvisedAction) -> RunRequest:
    """Apply an action to copies of the robot and the readings of a request; store what changed.

    Return the request for the stored copies, with the options after the action.

    Raises:
        RequestError: the action cannot be applied.
    """
    stored_set = parts.sets.document(request.measurement_set_id)
    robot = robot_from_record(parts.store.robots.get(stored_set.robot_id))
    before = Campaign(
        robot=_copy_fields(RobotDocument, robot),
        measurement_set=_copy_fields(MeasurementSetDocument, stored_set),
        run=_copy_fields(RunOptions, request),
    )
    after = apply_action_to_campaign(before, action)
    has_new_robot = after.robot is not before.robot
    robot_id, set_id = stored_set.robot_id, stored_set.id
    if action.kind == "choose_robot":
        robot_id = action.robot_id or _store_robot_once(parts, _make_catalogue_robot(action.robot or ""))
    elif has_new_robot:
        robot_id = _store_robot_once(parts, after.robot)
    if has_new_robot or after.measurement_set is not before.measurement_set:
        set_id = _store_set_once(parts, after.measurement_set, robot_id)
    return request.model_copy(update={**dict(after.run), "measurement_set_id": set_id})


def _copy_fields(message_class: type[AMessage], source: Message) -> AMessage:
    """Return a message of a class, with fields copied from `source`, a message that has more fields."""
    return message_class(**{name: getattr(source, name) for name in message_class.model_fields})


def _make_catalogue_robot(arm: str) -> RobotDocument:
    """Return the document of a robot that is the arm of this name in the catalogue."""
    return RobotDocument(name=arm, model=CatalogueModel(format="catalogue", arm=arm))


def _store_robot_once(parts: Parts, document: RobotDocument) -> str:
    """Store a robot unless its content is stored already; return the id of the stored robot."""
    return _store_once(parts.store.robots, parts.robots.create, document)


def _store_set_once(parts: Parts, document: MeasurementSetDocument, robot_id: str) -> str:
    """Store a measurement set of a robot unless its content is stored already; return the id of the set."""
    request = MeasurementSetRequest(**dict(document), robot_id=robot_id)
    return _store_once(parts.store.sets, parts.sets.create, request)


def _store_once(
    collection: Collection[Any, Any], create: Callable[[Any, IdempotencyKey], Any], document: Message
) -> str:
    """Store a document unless its content is stored already and not deleted; return the id of the record.

    The idempotency key is made of the content. If it leads to a deleted record, the next key is made of the
    content and the id of this record, and so on.
    """
    key_text = document.model_dump_json()
    while True:
        record = create(document, _make_key_from_content(key_text))
        with suppress(NotFoundError):
            return str(collection.get(record.id).id)
        key_text += record.id  # the present key belongs to a deleted record: try another key


def _make_key_from_content(content: str) -> IdempotencyKey:
    """Return the idempotency key of a content, with the hash of the content.

    The Python client makes the same key, so that content posted by the client, too, is stored only once.
    """
    return IdempotencyKey(content_key(content), hashlib.sha256(content.encode()).hexdigest())


@router.post(
    "/v1/campaigns",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=Run,
    responses=describe_post_responses(Run),
)
async def create_campaign(
    posted: InjectedPost, body: Annotated[Campaign, json_body(EXAMPLES["campaigns"])], key: Key
) -> Response:
    """Identify the joint stiffnesses of a campaign file: robot, readings and options in one document.

    Robot and measurement set are stored unless equal ones are stored already. Answers with the run as
    `POST /v1/runs` does. Errors name the place in the file; robot and readings are kept if only the run is
    refused.
    """

    def create(jobs: Jobs) -> JobRecord:
        """Store robot and measurement set, each once, and the job of the run; return the job's record."""
        with _name_section_in_errors("robot"):
            robot_id = _store_robot_once(posted.parts, body.robot)
        with _name_section_in_errors("measurement_set"):
            set_id = _store_set_once(posted.parts, body.measurement_set, robot_id)
        with _name_section_in_errors("run"):
            return jobs.create(RunRequest(**dict(body.run), measurement_set_id=set_id), key, posted.by)

    return await posted.answer(Run.kind_name(), create)


@contextmanager
def _name_section_in_errors(section: str) -> Iterator[None]:
    """Prefix the `where` of errors raised in the block with the name of a section of the campaign file."""
    try:
        yield
    except JointstiffError as error:
        error.where = find_path_in_document(section, error.where)
        raise


@deflections.post("/v1/deflections", dependencies=[OPERATOR], response_model=DeflectionResult)
async def compute_deflections(
    request: Request,
    parts: InjectedParts,
    body: Annotated[DeflectionRequest, json_body(EXAMPLES["deflections"])],
) -> Response:
    """Predict deflection, rotation and Cartesian compliance by the model of a run. Nothing is stored.

    Each case has a posture, a load and a place. Intervals `readings_only` include the errors of the
    readings and the stated errors of the force; `with_model_error` also the model error, calibrated on
    held-out postures.
    """
    # Many cases take seconds: the limiter keeps threads free for other requests.
    return json_response(
        await run_sync(_predict_as_json, parts, body, limiter=limiter_of_large_work(request))
    )


def _predict_as_json(parts: Parts, body: DeflectionRequest) -> str:
    """Predict deflections with the model of a stored run; return the result as JSON text.

    Raises:
        RequestError: the run does not exist, or cannot predict these cases.
    """
    try:
        run = load_job(parts.store, Run, body.run_id)
        robot = parts.sets.prepared(run.request.measurement_set_id).robot
    except NotFoundError as error:
        raise RequestError(error.reason, remedy=error.remedy, where="run_id") from error
    return predict_by_run(robot, run, body).model_dump_json()


@imports.post(
    "/v1/imports", dependencies=[OPERATOR], response_model=ImportAnswer, responses=describe_problems(404)
)
async def create_import(
    request: Request, parts: InjectedParts, files: _Readings, options: _ImportOptions = _DEFAULTS
) -> Response:
    """Read tables of readings by a mapping. Nothing is stored.

    Send the files as fields `files` of a form, and robot and mapping as JSON in a field `options`. Without
    `tables` in the mapping, the robot proposes them. Each choice of a question has the mapping to send next.
    Without questions the answer has the measurement set: add `robot_id` and post the set, unless `faults` say
    why the readings cannot be right.
    """
    answer = await run_sync(_import_as_json, parts, files, options, limiter=limiter_of_large_work(request))
    return json_response(answer)


def _import_as_json(parts: Parts, files: list[UploadFile], options: ImportRequest) -> str:
    """Read uploaded files of readings; return the answer of the import as JSON text."""
    from jointstiff.service.imports.answer import import_files  # imports the numerics

    robot = None if options.robot_id is None else parts.robots.find(options.robot_id, None)
    known = None if robot is None else KnownRobot(robot.model.name, robot, options.robot_id)
    sources = [SourceFile(*read_named_file(file)) for file in files]
    with garbage_collector_paused():
        others = parts.robots.list_confusable_robots()
        return import_files(sources, options, known, others).model_dump_json()


def read_named_file(file: UploadFile) -> tuple[str, bytes]:
    """Return the name (without folders) and the content of an uploaded file.

    Raises:
        RequestError: the file has no name, or a name that cannot be displayed.
    """
    name = (file.filename or "").replace("\\", "/").rpartition("/")[2]
    try:
        return _NAME.validate_python(name), file.file.read()
    except ValidationError:
        raise RequestError(
            "a file has no name, or a name that cannot be displayed",
            remedy=f"send the file with a `filename` of 1 to {MAX_NAME_LENGTH} printable characters",
            where="files",
        ) from None
