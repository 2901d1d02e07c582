"""Actions that a run's assessment advises: the mended set beside the old one, and its run."""

from __future__ import annotations

import hashlib
from typing import Annotated, Final, TypeVar, cast

from anyio.to_thread import run_sync
from fastapi import APIRouter, HTTPException, Response

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.fields import Message
from jointstiff.schemas.finding import Action
from jointstiff.schemas.measurement import MeasurementSetDocument, MeasurementSetRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import CampaignRun, Run, RunRequest
from jointstiff.service.api.access import OPERATOR
from jointstiff.service.api.bodies import BodyRoute
from jointstiff.service.api.examples import shown
from jointstiff.service.api.jobs import AskedBy, FollowersOf, JobId, Wait, Work, answer
from jointstiff.service.api.parts import LOCATION, PartsOf, accepted, problems
from jointstiff.service.jobs.parts import Parts
from jointstiff.service.kinds.mending import mended
from jointstiff.service.resources.robots import described
from jointstiff.service.store.records import IdempotencyKey
from jointstiff.solver.errors import RequestError

_EXAMPLE: Final = {
    "kind": "exchange_columns",
    "observations": [],
    "joints": ["joint_2", "joint_3"],
    "joint_map": [],
    "offset": [],
    "target": None,
    "correction": [],
    "unit": None,
}

Part = TypeVar("Part", bound=Message)

router = APIRouter(prefix="/v1/runs", tags=["runs"], route_class=BodyRoute)


@router.post(
    "/{run_id}/apply",
    dependencies=[OPERATOR],
    status_code=201,
    response_model=Run,
    responses=LOCATION | accepted(Run) | problems(400, 404, 409, 413, 415, 422, 429, 507),
)
async def apply_action(
    parts: PartsOf,
    run_id: JobId,
    body: Annotated[Action, shown({"two columns": _EXAMPLE})],
    work: Work,
    followers: FollowersOf,
    asked_by: AskedBy,
    query: Wait,
) -> Response:
    """Apply an action of a run's assessment, and identify: the new run is a `variant_of` this one.

    Readings or a robot that the action changes are stored beside the old ones, under names that say so. The
    same action of the same run gives the same run.
    """
    jobs = parts.jobs[Run.kind]

    def create() -> RunRequest:
        return _variant(parts, cast("Run", jobs.current(run_id)), body)

    request = await run_sync(create, limiter=work)
    record = await run_sync(jobs.create, request, _key(request), asked_by, limiter=work)
    return await answer(jobs, record, query.wait, followers)


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
        robot_id = parts.robots.create(after.robot, _key(after.robot)).id
    if after.robot is not before.robot or after.measurement_set is not before.measurement_set:
        document = MeasurementSetRequest(**dict(after.measurement_set), robot_id=robot_id)
        set_id = parts.sets.create(document, _key(document)).id
    return request.model_copy(update={**dict(after.run), "measurement_set_id": set_id})


def _named(kind: type[Part], source: Message) -> Part:
    """Return the part of a message that has the fields of another."""
    return kind(**{name: getattr(source, name) for name in kind.model_fields})


def _key(document: Message) -> IdempotencyKey:
    """Return a key by which the same content is stored once."""
    digest = hashlib.sha256(document.model_dump_json().encode()).hexdigest()
    return IdempotencyKey(f"applied {digest}", digest)
