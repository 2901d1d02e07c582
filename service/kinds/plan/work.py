"""A plan: from a robot or a campaign to readings worth taking, at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.plan import OwnWeight, PlanRequest, PlanResult
from jointstiff.service.conversion.assessments import to_assessment
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.conversion.readings import hash_of
from jointstiff.service.inputs import Inputs
from jointstiff.service.kinds.acceptance import refuse_unaccepted
from jointstiff.service.kinds.plan.design import named_targets, to_design_request, to_plan_result
from jointstiff.service.kinds.run.settings import identified, to_settings
from jointstiff.service.kinds.run.weight import identified_by_weight
from jointstiff.service.kinds.work import QuickWork
from jointstiff.solver.design.plan import plan_campaign
from jointstiff.solver.evidence.causes import screen_estimate
from jointstiff.solver.evidence.prediction import predict
from jointstiff.solver.robot.model import Robot

_LARGEST_RELATIVE: Final = 0.5
"""Relative uncertainty of a compliance above which it is no nominal value."""
_TOO_LITTLE: Final = frozenset({"no_joint_identified", "no_residual_freedom", "few_postures"})
"""Reasons that are no mistakes in the readings: more of them are the remedy."""
_LINKS: Final = frozenset({"deflection_unexplained"})
"""Reasons that bending links explain, which the plan takes for a nuisance."""


@dataclass(frozen=True, eq=False)
class Planned:
    """Hold the robot, the loads and the campaign of a plan."""

    robot: Robot  # the robot
    robot_id: str  # id of the stored robot
    content: str  # hash of robot, and of the readings so far
    prepared: PreparedSet | None = None  # the campaign to go on with; None to begin one


def work(inputs: Inputs, request: PlanRequest) -> QuickWork:
    """Return the work of a plan.

    Raises:
        RequestError: there is no such robot or set.
    """
    if request.measurement_set_id is None:
        robot, content = inputs.robot(str(request.robot_id), "robot_id")
        planned = Planned(robot, str(request.robot_id), content)
    else:
        prepared = inputs.measured(request.measurement_set_id, "measurement_set_id")
        if request.load is None and not prepared.measurements.force.any():
            request = request.model_copy(update={"load": OwnWeight(kind="own_weight")})
        prepared = prepared if isinstance(request.load, OwnWeight) else prepared.with_loads()
        planned = Planned(prepared.robot, prepared.robot_id, prepared.content, prepared)
    options = request.model_dump_json(exclude={"robot_id", "measurement_set_id"})
    return QuickWork(
        result=partial(_plan, planned, request),
        input_hash=hash_of(planned.content, options),
        robot_id=planned.robot_id,
    )


def _plan(planned: Planned, request: PlanRequest) -> PlanResult:
    """Return the plan.

    Raises:
        RequestError: something of the robot or the campaign is missing, the campaign so far is not to be
            used, or no such plan exists.
    """
    robot, prepared = planned.robot, planned.prepared
    nominal, sigma, unexplained, assessment = np.full(robot.n, np.nan), None, None, None
    if prepared is not None and isinstance(request.load, OwnWeight):
        result = identified_by_weight(prepared, RunOptions(), request.load)
        sigma, assessment = result.sigma, result.assessment
        nominal = np.array([joint.compliance or np.nan for joint in result.joints])
        refuse_unaccepted(
            assessment,
            request.accept_verdict,
            "the campaign so far",
            "measurement_set_id",
            passed_over=_TOO_LITTLE,
        )
    elif prepared is not None:
        settings, estimate = identified(prepared, to_settings(RunOptions(), robot))
        sigma = estimate.sigma
        for j, joint in enumerate(estimate.joints):  # the compliances that the readings so far determine
            u = joint.standard_uncertainty
            if joint.compliance and u is not None and u < _LARGEST_RELATIVE * joint.compliance:
                nominal[j] = joint.compliance
        prediction = predict(
            robot,
            prepared.measurements,
            estimate.compliance,
            complementary_stiffness=settings.complementary_stiffness,
        )
        screening = screen_estimate(robot, prepared.measurements, estimate)
        judgement = prepared.assess(settings, estimate, prediction, screening)
        assessment = to_assessment(judgement, estimate.joints)
        refuse_unaccepted(
            assessment,
            request.accept_verdict,
            "the campaign so far",
            "measurement_set_id",
            passed_over=_TOO_LITTLE | _LINKS if screening.links_speak else _TOO_LITTLE,
        )
        unexplained = None if prediction.compensation is None else 1.0 - prediction.compensation
    so_far = None if prepared is None else prepared.measurements
    if so_far is not None and so_far.unloaded_only is not None:
        so_far = replace(so_far, present=so_far.present | so_far.unloaded_only)
    asked = to_design_request(
        request, robot, nominal=nominal, sigma=sigma, unexplained=unexplained, so_far=so_far
    )
    names, _ = named_targets(request, robot, so_far)
    return to_plan_result(asked, plan_campaign(robot, asked), robot, names, assessment)
