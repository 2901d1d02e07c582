"""Rehearsals of stored runs and plans: the file `rehearsal.json` of these jobs."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import Any, Final

from jointstiff.schemas.measurement import Frame, MeasurementSetDocument
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.plan import Plan, PlanRequest, PlanResult
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import Campaign, Run, RunRequest, RunResult
from jointstiff.service.conversion.prepared import PreparedRobot, prepare_robot
from jointstiff.service.conversion.units import LENGTH
from jointstiff.service.jobs import Parts
from jointstiff.service.kinds.plan.kind import make_campaign_to_fill_in
from jointstiff.service.kinds.run.work import prepare_identification
from jointstiff.service.live.rehearsal import (
    add_planned_readings,
    describe_verdict,
    fill_missing_readings,
    make_joints_table,
    refuse_long_identification,
    rehearse_campaign,
)
from jointstiff.service.resources.stored import robot_from_record
from jointstiff.service.tables.stiffness import StiffnessUnit
from jointstiff.solver.errors import JointstiffError, RequestError

MOST_OBSERVATIONS: Final = 2_000
"""Greatest number of postures that are rehearsed within a request."""
MOST_READINGS: Final = 20_000
"""Greatest number of postures times targets: 20,000 take some 3 s of a processor, twice if a plan goes on."""


def write_rehearsal(parts: Parts, job: Run | Plan, seed: int, unit: StiffnessUnit) -> str:
    """Rehearse the campaign of a run or a plan; return the rehearsal as JSON text, with a table and lines.

    A plan that goes on from a measurement set is rehearsed together with the postures of the set.

    Args:
        parts: robots and measurement sets of the store.
        job: run or plan with a result.
        seed: random seed of the noise and of plausible stiffnesses.
        unit: unit of the stiffnesses in the table.

    Raises:
        NotFoundError: robot or set have been deleted.
        RequestError: the campaign has no loads or too many postures, or models of elastic links are compared.
        JointstiffError: the simulated readings cannot be identified.
    """
    if isinstance(job, Run):
        campaign, robot = _read_campaign(parts, job.request.measurement_set_id, dict(job.request))
        measured = job.result
    else:
        assert job.result is not None  # noqa: S101 - for mypy: the caller has checked the result
        campaign, robot, measured = _read_plan(parts, job, job.result)
    _refuse_large_campaign(campaign)
    rehearsal = rehearse_campaign(campaign, robot, measured, seed=seed, quick_only=True)
    document = {
        "lines": [*describe_verdict(rehearsal), *rehearsal.remarks],
        "tables": [make_joints_table(rehearsal, unit).shown()],
        "rehearsal": rehearsal.model_dump(mode="json"),
    }
    return json.dumps(document, ensure_ascii=False, allow_nan=False)


def _read_campaign(parts: Parts, set_id: str, options: dict[str, Any]) -> tuple[Campaign, PreparedRobot]:
    """Return a stored set with its robot as a campaign, whose frame is stated in numbers, and the robot.

    `options` may have further fields than options of a run.
    """
    stored = parts.sets.document(set_id)
    robot = _read_robot(parts, stored.robot_id)
    fields = {name: getattr(stored, name) for name in MeasurementSetDocument.model_fields}
    if stored.frame is not None and stored.resolved_frame is not None:
        length = LENGTH[stored.units.length]
        x, y, z = stored.resolved_frame.translation
        fields["frame"] = Frame(
            rotation=stored.resolved_frame.rotation,
            translation=(x / length, y / length, z / length),
            forces=stored.frame.forces,
        )
    run = RunOptions(**{name: options[name] for name in RunOptions.model_fields if name in options})
    measurement_set = MeasurementSetDocument(**fields)
    return Campaign(robot=robot.document, measurement_set=measurement_set, run=run), robot


def _read_robot(parts: Parts, robot_id: str) -> PreparedRobot:
    """Return a stored robot, ready for computation."""
    stored = robot_from_record(parts.store.robots.get(robot_id))
    return prepare_robot(
        RobotDocument(**{name: getattr(stored, name) for name in RobotDocument.model_fields})
    )


def _read_plan(
    parts: Parts, plan: Plan, result: PlanResult
) -> tuple[Campaign, PreparedRobot, RunResult | None]:
    """Return the campaign of a plan, its robot, and the result of the readings so far; None without them."""
    request: PlanRequest = plan.request
    if request.measurement_set_id is None:
        robot = _read_robot(parts, request.robot_id or "")
        document = make_campaign_to_fill_in(robot.document, plan)
        document["measurement_set"] |= {"flange_targets": result.targets}
        return Campaign.model_validate(fill_missing_readings(document)[0]), robot, None
    options: dict[str, Any] = {"causes": request.causes, "leave_out": request.leave_out}
    campaign, robot = _read_campaign(parts, request.measurement_set_id, options)
    going_on = add_planned_readings(campaign, result, robot.robot)
    _refuse_large_campaign(going_on)  # before the readings so far are identified
    work, measured = None, None
    # readings that determine no stiffness: plausible ones are planted
    with suppress(JointstiffError):
        identify = RunRequest(**options, measurement_set_id=request.measurement_set_id)
        work = prepare_identification(parts, identify)
    if work is not None:
        refuse_long_identification(work)
        with suppress(JointstiffError):
            measured = work.conclude([])
    return going_on, robot, measured


def _refuse_large_campaign(campaign: Campaign) -> None:
    """Refuse a campaign whose rehearsal would occupy a processor for more than some 10 s.

    Raises:
        RequestError: the campaign has too many postures or readings.
    """
    observations = campaign.measurement_set.observations
    readings = sum(len(observation.readings) for observation in observations)
    reason = None
    if len(observations) > MOST_OBSERVATIONS:
        reason = f"a campaign of more than {MOST_OBSERVATIONS:,} postures"
    elif readings > MOST_READINGS:
        reason = f"a campaign of more than {MOST_READINGS:,} postures × targets"
    if reason is not None:
        raise RequestError(
            f"{reason} is not rehearsed by the service",
            remedy="rehearse the campaign with `jointstiff rehearse`",
        )
