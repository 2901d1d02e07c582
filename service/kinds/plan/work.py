"""The work of a plan: from the request to arrays in SI units, and back to messages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas import plan as plans
from jointstiff.schemas.finding import Assessment, Finding
from jointstiff.schemas.measurement import LEAST_DIRECTION
from jointstiff.schemas.options import OwnWeight, RunOptions
from jointstiff.schemas.plan import DecisionGoal, PlanResult
from jointstiff.service.conversion.gearbox import ASSUMED_MASS, find_joint
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.conversion.readings import hash_texts
from jointstiff.service.conversion.robots import (
    joint_kinds_by_name,
    refuse_far_point,
    refuse_wrong_joint_count,
)
from jointstiff.service.conversion.units import KGF, to_instrument
from jointstiff.service.kinds.work import QuickWork
from jointstiff.service.resources.inputs import Inputs
from jointstiff.service.runs.verdicts import (
    assess_with_run,
    make_reason,
    refuse_implausible_stiffness,
    refuse_unaccepted,
)
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.design.candidates import Equipment, Loads, PlanRequest
from jointstiff.solver.design.plan import CampaignPlan, plan_campaign
from jointstiff.solver.errors import RequestError
from jointstiff.solver.evidence.fitted_causes import fit_causes
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.evidence.refuted import list_refuted
from jointstiff.solver.fit.estimate import JointCompliance, predict
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.weight_rows import Burden, make_planned_rows_function
from jointstiff.solver.gearboxes.outcome import report_overload
from jointstiff.solver.gearboxes.planned import LEAST_POSTURES, PlannedStepRows, find_widening
from jointstiff.solver.gearboxes.step import Load
from jointstiff.solver.mechanics.block import targets_in_flange
from jointstiff.solver.mechanics.measurements import NO_SCATTER, Measurements, Scatter
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.messages import build_messages
from jointstiff.solver.outcome.result import build_assessment_message
from jointstiff.solver.outcome.rules import assess
from jointstiff.solver.own_weight.run import identify_by_weight

_LARGEST_RELATIVE_UNCERTAINTY: Final = 0.5
"""Relative uncertainty of a compliance above which the compliance is not used as a nominal value."""
_TOO_FEW_READINGS: Final = frozenset({"no_joint_identified", "no_residual_freedom", "few_postures"})
"""Reasons for the verdict "do not use" that disappear with more readings; a plan is allowed despite them."""
_ELASTIC_LINKS: Final = frozenset({"deflection_unexplained"})
"""Reasons that elastic links explain: a plan allows for elastic links, so these reasons do not prevent it."""


@dataclass(frozen=True, eq=False)
class PlanInput:
    """Robot of a plan, and the campaign that the plan continues, if any."""

    robot: Robot  # robot that is measured
    robot_id: str  # id of the stored robot
    content: str  # hash of the robot and of the readings so far
    prepared: PreparedSet | None = None  # campaign to continue; None to begin a campaign


def prepare_plan(inputs: Inputs, request: plans.PlanRequest) -> QuickWork:
    """Fetch the robot or the campaign of a request, and return the work that computes the plan.

    Raises:
        RequestError: the robot or the set does not exist, or the options need a campaign but the request
            has none.
    """
    _refuse_contradicting_options(request)
    if request.measurement_set_id is None:
        robot, content = inputs.robot(str(request.robot_id), "robot_id")
        plan_input = PlanInput(robot, str(request.robot_id), content)
    else:
        prepared = inputs.measured(request.measurement_set_id, "measurement_set_id", request.leave_out)
        request = _complete_load(request, prepared)
        if not isinstance(request.load, OwnWeight):
            prepared = _fit_requested_causes(prepared, request)
        plan_input = PlanInput(prepared.robot, prepared.robot_id, prepared.content, prepared)
    options = request.model_dump_json(exclude={"robot_id", "measurement_set_id"})
    return QuickWork(
        result=partial(_compute_plan, plan_input, request),
        input_hash=hash_texts(plan_input.content, options),
        robot_id=plan_input.robot_id,
    )


def _complete_load(request: plans.PlanRequest, prepared: PreparedSet) -> plans.PlanRequest:
    """Return the request with the load that the campaign so far shows, if the request states none.

    A campaign without forces has only one load: the robot's own weight.
    """
    if request.load is None and not prepared.measurements.force.any():
        return request.model_copy(update={"load": OwnWeight()})
    return request


def _refuse_contradicting_options(request: plans.PlanRequest) -> None:
    """Refuse options about readings of a campaign without a campaign, and options of another kind of plan.

    Raises:
        RequestError: names the options.
    """
    if request.weight_step is not None:
        _refuse_unsupported_weight_step(request)
    if request.causes and (request.measurement_set_id is None or isinstance(request.load, OwnWeight)):
        raise RequestError(
            "`causes` can be fitted only to a campaign under loads, but this plan continues no such campaign",
            where="causes",
            remedy="omit `causes`, or continue a campaign that was measured under loads",
        )
    if request.measurement_set_id is None and request.leave_out:
        raise RequestError(
            "a plan that begins a campaign has no observations to leave out",
            where="leave_out",
            remedy="omit `leave_out`, or continue a measured campaign",
        )


def _fit_requested_causes(prepared: PreparedSet, request: plans.PlanRequest) -> PreparedSet:
    """Return a campaign with the effects of the request's causes, such as a turn of the tracker, taken out.

    Readings that the checks of the campaign refuted are not used for this fit.
    """
    causes = [cause.name_and_first_label for cause in request.causes]
    measurements = prepared.measurements.require_loads()
    refuted = list_refuted(measurements, prepared.warnings)
    corrected = fit_causes(Rows(prepared.robot, measurements), causes, refuted)
    return replace(prepared, measurements=corrected)


@dataclass(frozen=True, eq=False)
class CampaignSoFar:
    """Results of the campaign that a plan continues; NaN and None where they are unknown."""

    nominal: FloatArray  # (n,) compliances [rad/(N·m)] that the campaign determines
    readings: Measurements | None = None  # readings of the campaign
    sigma: float | None = None  # standard uncertainty of a coordinate of a reading [m]
    unexplained: float | None = None  # share of the mean deflection that elastic joints do not explain
    assessment: Assessment | None = None  # verdict on the campaign

    @classmethod
    def without_readings(cls, joint_count: int, sigma: float | None = None) -> CampaignSoFar:
        """Return what is known before the first reading: nothing, or the sigma of the instrument [m]."""
        return cls(np.full(joint_count, np.nan), sigma=sigma)

    def with_unloaded_positions(self) -> CampaignSoFar:
        """Return the campaign in which positions without another load than own weight are readings, too."""
        readings = self.readings
        if readings is None or readings.unloaded_only is None:
            return self
        return replace(self, readings=replace(readings, present=readings.present | readings.unloaded_only))


def _evaluate_campaign(plan_input: PlanInput, request: plans.PlanRequest) -> CampaignSoFar:
    """Identify the campaign that a plan continues; without a campaign, nothing is known.

    Raises:
        RequestError: the verdict on the campaign is "do not use".
    """
    prepared = plan_input.prepared
    if prepared is None:
        return CampaignSoFar.without_readings(plan_input.robot.n)
    if isinstance(request.load, OwnWeight):
        return _evaluate_campaign_by_weight(plan_input.robot, prepared, request, request.load)
    return _evaluate_campaign_by_loads(plan_input.robot, prepared, request)


def _evaluate_campaign_by_weight(
    robot: Robot, prepared: PreparedSet, request: plans.PlanRequest, weight: OwnWeight
) -> CampaignSoFar:
    """Identify a campaign whose load is the robot's own weight.

    Raises:
        RequestError: the verdict on the campaign is "do not use".
    """
    result = identify_by_weight(robot, prepared.measurements, RunOptions(weight=weight), prepared.warnings)
    _refuse_unaccepted_campaign(result.assessment, request, _TOO_FEW_READINGS)
    return CampaignSoFar(
        nominal=np.array([joint.compliance or np.nan for joint in result.joints]),
        readings=prepared.measurements,
        sigma=result.sigma,
        assessment=result.assessment,
    )


def _evaluate_campaign_by_loads(
    robot: Robot, prepared: PreparedSet, request: plans.PlanRequest
) -> CampaignSoFar:
    """Identify a campaign under loads by elastic joints alone.

    Raises:
        RequestError: the verdict on the campaign is "do not use".
    """
    settings = Settings.from_options(RunOptions(), robot)
    joints = JointsAlone(Rows(robot, prepared.measurements), settings, prepared.warnings)
    estimate, screening = joints.estimate, joints.screening
    rows = joints.rows.at(estimate.balanced)
    prediction = predict(rows, estimate.compliance, statements=estimate.statements)
    assessment = build_assessment_message(assess(joints, estimate, prediction, screening), estimate.joints)
    # More readings are what the plan is for, so too few readings are no reason against it.
    ignored_codes = _TOO_FEW_READINGS
    if screening.links_need_validation:
        ignored_codes |= _ELASTIC_LINKS
    _refuse_unaccepted_campaign(assessment, request, ignored_codes)
    compensation = prediction.compensation
    return CampaignSoFar(
        nominal=np.array([_find_certain_compliance(joint) for joint in estimate.joints]),
        readings=joints.measurements,
        sigma=estimate.sigma,
        unexplained=None if compensation is None else 1.0 - compensation,
        assessment=assessment,
    )


def _find_certain_compliance(joint: JointCompliance) -> float:
    """Return the compliance of a joint [rad/(N·m)], or NaN if its uncertainty is great or unknown.

    A very uncertain compliance may be wrong by any factor, so a plan must not rely on it.
    """
    if not joint.compliance or joint.standard_uncertainty is None:
        return np.nan
    is_certain = joint.standard_uncertainty < _LARGEST_RELATIVE_UNCERTAINTY * joint.compliance
    return joint.compliance if is_certain else np.nan


def _refuse_unaccepted_campaign(
    assessment: Assessment, request: plans.PlanRequest, ignored_codes: frozenset[str]
) -> None:
    """Refuse a campaign with the verdict "do not use", unless the request accepts the verdict.

    Reasons whose codes are in `ignored_codes` do not count.

    Raises:
        RequestError: the campaign is refused.
    """
    refuse_unaccepted(
        assessment,
        request.accept_verdict,
        "the campaign so far",
        "measurement_set_id",
        ignored_codes=ignored_codes,
    )


def _compute_plan(plan_input: PlanInput, request: plans.PlanRequest) -> PlanResult:
    """Identify the campaign so far, if the plan continues one, then plan readings, and return the plan.

    Raises:
        RequestError: the robot or the campaign lacks data that the plan needs, the verdict on the campaign so
            far is "do not use", or no plan satisfies the request.
    """
    robot = plan_input.robot
    if request.weight_step is not None:
        step_request = to_step_design_request(request, robot, request.weight_step)
        overload = report_overload(request.weight_step.mass, robot, "weight_step.mass")
        return _state_plan(robot, step_request, (), None, list(overload))
    so_far = _evaluate_campaign(plan_input, request).with_unloaded_positions()
    _refuse_goal_of_live_campaign(request)
    design_request = to_design_request(request, robot, so_far)
    targets = choose_targets(request, robot, so_far.readings)
    return _state_plan(robot, design_request, targets.names, so_far.assessment)


def _refuse_goal_of_live_campaign(request: plans.PlanRequest) -> None:
    """Refuse a goal that only a live campaign can pursue, because it depends on the readings to come.

    Raises:
        RequestError: the goal is a decision, or about another force than the load of the plan.
    """
    if isinstance(request.goal, DecisionGoal) or getattr(request.goal, "force", None) is not None:
        raise RequestError(
            "the goal of a plan can be neither a decision nor the deflection under a force that differs "
            "from the load of the plan",
            where="goal",
            remedy="give a goal for the uncertainty of the joints, or of the deflection under the plan's "
            "load; or use this goal in a live campaign",
        )


def _state_plan(
    robot: Robot,
    request: PlanRequest,
    targets: Sequence[str],
    so_far: Assessment | None,
    reasons_of_load: Sequence[Finding] = (),
) -> PlanResult:
    """Plan readings, and return the message of the plan with its verdict.

    Args:
        robot: n joints.
        request: the solver's request.
        targets: names of the targets.
        so_far: verdict on the campaign so far; None if the plan begins one.
        reasons_of_load: why the load of the plan is doubtful.

    Raises:
        RequestError: no plan satisfies the request.
    """
    plan_result = to_plan_result(request, plan_campaign(robot, request), robot, targets, so_far)
    if request.step_rows is not None:  # a weight cannot twist a vertical axis, whatever is planned
        reasons = _list_uncertain_joints(plan_result, _MORE_TWIST)
    else:
        reasons = _list_reasons(plan_result)
    plan_assessment = assess_with_run("plan", [*reasons_of_load, *reasons], so_far)
    return plan_result.model_copy(update={"assessment": plan_assessment})


def _list_reasons(result: PlanResult) -> list[Finding]:
    """Return the reasons to use a plan with care: joints that no load twists or that stay uncertain."""
    reasons = []
    if result.left_out:
        message = f"no load of this plan twists {', '.join(result.left_out)}"
        remedy = (
            "choose loads that twist these joints, such as forces in any direction, or name the joints you "
            "need in `joints`"
        )
        reasons.append(make_reason("joint_left_out", "use_with_care", message, remedy))
    return [*reasons, *_list_uncertain_joints(result, _MORE_DEFLECTION)]


def _list_uncertain_joints(result: PlanResult, remedy: str) -> list[Finding]:
    """Return the reason to use a plan with care that joints stay uncertain, if there are such joints."""
    uncertain = [each.name for each in result.joints if (each.relative or 0.0) > _UNCERTAIN]
    if not uncertain:
        return []
    names = ", ".join(uncertain)
    message = f"after this plan {names} would still be uncertain by over {100 * _UNCERTAIN:.0f} %"
    return [make_reason("joint_stays_uncertain", "use_with_care", message, remedy)]


_MORE_DEFLECTION: Final = "plan more readings, a larger load, or targets farther from the flange"
_MORE_TWIST: Final = (
    "plan more readings or a larger mass, or hang the load farther from the axes of these joints"
)
"""What makes joints less uncertain that targets, or that two encoders read."""
_UNCERTAIN: Final = 0.5
"""Greatest standard uncertainty, relative to the compliance, with which a plan determines a joint."""


_LACK_OF_FIT: Final = 0.1
"""Share of the mean deflection unexplained by elastic joints, above which a plan allows for elastic links."""
_LINK_SHARE: Final = 0.3
"""Deflection by links relative to deflection by joints, if no campaign determines this ratio."""
_SIGMA: Final = 2e-5
"""Standard deviation of a laser tracker's readings [m], if none is stated."""


def _add_stated_compliances(
    request: plans.PlanRequest, robot: Robot, nominal: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return nominal compliances (n,) and their prior uncertainties (n,) [rad/(N·m)].

    A stiffness that the request states takes the place of the compliance in `nominal`. The uncertainty is
    infinite where nothing is known before the plan.

    Raises:
        RequestError: a joint that the request names does not exist, or no joint has such a stiffness.
    """
    nominal = nominal.copy()
    for name, stiffness in request.stiffness.items():
        refuse_implausible_stiffness(robot, name, stiffness)
        nominal[robot.joint_index(name, f"stiffness.{name}")] = 1.0 / stiffness
    prior_uncertainty = np.full(robot.n, np.inf)
    for name, prior in request.priors.items():
        j = robot.joint_index(name, f"priors.{name}")
        # Uncertainty of the compliance c = 1/k: u(c) = u(k)/k².
        prior_uncertainty[j] = prior.standard_uncertainty / prior.stiffness**2
        nominal[j] = 1.0 / prior.stiffness
    return nominal, prior_uncertainty


def _refuse_unsupported_own_weight(
    request: plans.PlanRequest, robot: Robot, own_weight: OwnWeight, nominal: FloatArray
) -> None:
    """Refuse a plan for own weight that lacks data or has options that such a plan does not support.

    Raises:
        RequestError: names the data or the options.
    """
    if not (robot.bodies and np.isfinite(nominal).any()):
        raise RequestError(
            "a plan for own weight needs the masses of the robot and the stiffness of at least one joint",
            where="load",
            remedy="state `bodies` of the robot, and a guess of the joints' `stiffness`",
        )
    if own_weight.balancers or own_weight.estimate_gravity:
        raise RequestError(
            "a plan for own weight supports neither balancers nor an estimate of gravity",
            where="load",
            remedy="state `gravity` instead; for a robot with balancers, choose the postures by hand",
        )
    if request.work_area or request.tracker or request.directions:
        raise RequestError(
            "a plan for own weight supports neither a work area nor a tracker's station nor directions of "
            "gauges",
            where="load",
            remedy="omit `work_area`, `tracker` and `directions`; give the noise of the readings as `sigma`",
        )


_GRAVITY: Final = (0.0, 0.0, -KGF)
"""Acceleration of gravity in R0 in which a weight step is planned [m/s²]."""
_OF_TARGETS: Final = (
    "load",
    "measurement_set_id",
    "work_area",
    "targets",
    "directions",
    "tracker",
    "sigma",
    "repeatability",
    "elastic_links",
    "priors",
    "goal",
)
"""Fields that a plan of a weight step does not support: they concern targets, or a campaign so far."""
_OF_WORK_AREA: Final = ("work_area", "worst_place")
"""Criteria that need a work area."""


def _refuse_unsupported_weight_step(request: plans.PlanRequest) -> None:
    """Refuse a plan of a weight step with options that concern targets, or with too few postures.

    Raises:
        RequestError: names the options.
    """
    stated = [name for name in _OF_TARGETS if getattr(request, name)]
    if stated:
        names = ", ".join(f"`{name}`" for name in stated)
        raise RequestError(
            f"a weight step is read by encoders instead of targets, but the plan has {names}",
            where=stated[0],
            remedy=f"omit {names}, or omit `weight_step`",
        )
    if request.criterion in _OF_WORK_AREA:
        raise RequestError(
            f"the criterion `{request.criterion}` concerns deflections of the arm, but a weight step shows "
            "only the gearboxes",
            where="criterion",
            remedy="omit `criterion`, or give relative_a, d or e",
        )
    if request.readings < LEAST_POSTURES:
        raise RequestError(
            f"{request.readings} postures are too few to determine compliance, offset and noise of a gearbox",
            where="readings",
            remedy=f"request {LEAST_POSTURES} readings or more; 12 are good practice",
        )


def _list_step_joints(request: plans.PlanRequest, robot: Robot) -> list[int]:
    """Return the indices of the joints with two encoders: those of the request, or all that can have them.

    Raises:
        RequestError: a joint does not exist, slides, or is coupled with others; or no joint can be read.
    """
    if request.joints:
        return [find_joint(robot, name, "joints") for name in request.joints]
    joints = []
    for name in robot.joint_names:
        with suppress(RequestError):
            joints.append(find_joint(robot, name, "joints"))
    if not joints:
        raise RequestError(
            "the robot has no revolute joint that turns without another joint",
            where="robot_id",
            remedy="a weight step needs a joint that turns, and that the joint map does not couple",
        )
    return joints


def to_step_design_request(request: plans.PlanRequest, robot: Robot, step: plans.PlannedStep) -> PlanRequest:
    """Convert a posted request to the solver's request for a plan of a weight step.

    In a weight step, a mass is hung on the flange, and joints with two encoders show how far their gearboxes
    yield.

    Raises:
        RequestError: a joint that the request names does not exist or cannot be read.
    """
    nominal, prior_uncertainty = _add_stated_compliances(request, robot, np.full(robot.n, np.nan))
    joints = np.array(_list_step_joints(request, robot), dtype=np.intp)
    load = _read_step_load(request, step)
    return PlanRequest(
        equipment=_choose_step_equipment(request, robot, step, load),
        readings=request.readings,
        nominal=nominal,
        prior=prior_uncertainty,
        cell=request.surroundings,
        criterion=request.criterion or "relative_a",
        postures=_convert_candidate_postures(request, robot),
        candidates=request.candidates,
        joints=joints if request.joints else None,
        angle=request.distinct_angle,
        validation=0.0,
        step_rows=PlannedStepRows(robot, load, np.array(_GRAVITY), joints, np.nan_to_num(nominal)),
        seed=request.seed,
    )


def _read_step_load(request: plans.PlanRequest, step: plans.PlannedStep) -> Load:
    """Return the mass that is hung on the flange, with an assumed uncertainty if none is stated."""
    mass_uncertainty = step.mass_uncertainty
    if mass_uncertainty is None:
        mass_uncertainty = ASSUMED_MASS * step.mass
    return Load(
        mass=step.mass,
        mass_uncertainty=mass_uncertainty,
        point=_choose_load_point(request, None),
        point_uncertainty=step.point_uncertainty,
    )


def _choose_step_equipment(
    request: plans.PlanRequest, robot: Robot, step: plans.PlannedStep, load: Load
) -> Equipment:
    """Return the equipment of a weight step: a weight, no targets, and the noise of the encoders.

    The noise is widened by the factor by which Student's quantile, for so few readings, exceeds the normal
    one.
    """
    weight = step.mass * -_GRAVITY[2]  # [N]
    return Equipment(
        targets=np.empty((0, 3)),
        load_point=load.point,
        loads=Loads("dead_weight", weight, _convert_torque_limits(request, robot)),
        sigma=step.noise * find_widening(request.readings),
    )


def to_design_request(request: plans.PlanRequest, robot: Robot, so_far: CampaignSoFar) -> PlanRequest:
    """Convert a posted request to the solver's request for a plan, with arrays in SI units.

    Args:
        request: the request as it was posted.
        robot: n joints.
        so_far: results of the campaign that the plan continues.

    Raises:
        RequestError: a joint that the request names does not exist; load, targets or a stiffness are
            missing; or options contradict each other.
    """
    nominal, prior_uncertainty = _add_stated_compliances(request, robot, so_far.nominal)
    targets = choose_targets(request, robot, so_far.readings)
    own_weight_rows = None
    if isinstance(request.load, OwnWeight):
        own_weight_rows = _make_own_weight_rows(request, robot, request.load, targets.positions, nominal)
    area = request.work_area
    default_criterion: plans.PlanCriterion = "relative_a" if area is None else "work_area"
    links = _choose_links(request, so_far.unexplained)
    return PlanRequest(
        equipment=_choose_equipment(request, robot, targets.positions, so_far),
        readings=request.readings,
        nominal=nominal,
        prior=prior_uncertainty,
        cell=_order_reflector_directions(request.surroundings, targets.names),
        criterion=request.criterion or default_criterion,
        postures=_convert_candidate_postures(request, robot),
        candidates=request.candidates,
        joints=_find_requested_joints(request, robot),
        work_area=None if area is None else np.array(area),
        directions=_convert_gauge_directions(request),
        links=links.are_planned,
        link_share=links.share,
        angle=request.distinct_angle,
        validation=request.validation,
        so_far=so_far.readings,
        own_weight_rows=own_weight_rows,
        seed=request.seed,
        goal=None if isinstance(request.goal, DecisionGoal) else request.goal,
    )


def _make_own_weight_rows(
    request: plans.PlanRequest,
    robot: Robot,
    own_weight: OwnWeight,
    targets: FloatArray,
    nominal: FloatArray,
) -> Callable[[FloatArray], FloatArray]:
    """Return the function that computes what a reading under the robot's own weight determines.

    Args:
        request: the request as it was posted.
        robot: n joints.
        own_weight: load of the plan.
        targets: (T, 3) positions of the targets in the flange frame [m].
        nominal: (n,) compliances [rad/(N·m)]; NaN for an unknown compliance, which counts as rigid.

    Raises:
        RequestError: masses or stiffnesses are missing, or an option is not supported.
    """
    _refuse_unsupported_own_weight(request, robot, own_weight, nominal)
    burden = Burden(robot.bodies, gravity=np.array(own_weight.gravity))
    return make_planned_rows_function(
        robot, burden, targets, np.nan_to_num(nominal), free_base=not own_weight.rigid_base
    )


def _choose_equipment(
    request: plans.PlanRequest, robot: Robot, targets: FloatArray, so_far: CampaignSoFar
) -> Equipment:
    """Return what the plan reads with: targets (T, 3), loads, and the noise of an instrument.

    Args:
        request: the request as it was posted.
        robot: n joints.
        targets: (T, 3) positions of the targets in the flange frame [m].
        so_far: results of the campaign that the plan continues.

    Raises:
        RequestError: a load is missing, or options contradict each other.
    """
    planned_sigma = request.sigma or so_far.sigma or _SIGMA
    campaign_sigma = so_far.sigma or planned_sigma
    instrument = None if request.tracker is None else to_instrument(request.tracker, 1.0)
    scatter = _choose_scatter(request, so_far.readings, campaign_sigma / planned_sigma, planned_sigma)
    return Equipment(
        targets=targets,
        load_point=_choose_load_point(request, so_far.readings),
        loads=_choose_loads(request, robot, so_far.readings),
        sigma=planned_sigma,
        instrument=instrument,
        scatter=scatter,
    )


class _PlannedLinks(NamedTuple):
    """Elastic links that a plan allows for, and how much these links bend."""

    are_planned: bool
    share: float  # deflection by links relative to deflection by joints


def _choose_links(request: plans.PlanRequest, unexplained: float | None) -> _PlannedLinks:
    """Return whether the plan allows for elastic links: as requested, or else if joints alone do not fit.

    `unexplained` is the share of the campaign's mean deflection that elastic joints do not explain; None if
    it is unknown. Joints explain the share 1 − `unexplained`; links are assumed to cause the rest.
    """
    lack_of_fit = unexplained is not None and _LACK_OF_FIT < unexplained < 1.0
    are_planned = lack_of_fit if request.elastic_links is None else request.elastic_links
    if unexplained is None or not lack_of_fit:
        return _PlannedLinks(are_planned, _LINK_SHARE)
    return _PlannedLinks(are_planned, unexplained / (1.0 - unexplained))


def _find_requested_joints(request: plans.PlanRequest, robot: Robot) -> IndexArray | None:
    """Return the indices of the joints that the request names; None if it names no joints.

    Raises:
        RequestError: the robot has no joint of this name.
    """
    if not request.joints:
        return None
    indices = [robot.joint_index(name, "joints") for name in request.joints]
    return np.array(indices, dtype=np.intp)


def to_plan_result(
    request: PlanRequest,
    plan: CampaignPlan,
    robot: Robot,
    names: Sequence[str],
    assessment: Assessment | None,
) -> plans.PlanResult:
    """Convert the solver's plan to the message that is returned to the user.

    Args:
        request: the solver's request, from which the plan was made.
        plan: plan of the solver.
        robot: n joints.
        names: names of the targets.
        assessment: verdict on the campaign so far; None if the plan begins a campaign.
    """
    deflection, worst_deflection = plan.deflection or (None, None)
    considered = plan.pool.feasible + sum(plan.pool.struck_out.values())
    places = request.equipment.targets.tolist()
    return plans.PlanResult(
        efficiency=plan.efficiency,
        efficiencies=dict(plan.efficiencies),
        goal_share=plan.goal_share,
        assessment=assessment,
        joint_kinds=joint_kinds_by_name(robot),
        readings=_list_planned_readings(plan),
        targets=dict(zip(names, places, strict=True)),
        load_point=request.equipment.load_point,
        joints=_list_planned_joints(plan, robot),
        left_out=_list_joints_left_out(request, plan, robot),
        criterion=request.criterion,
        elastic_links=request.links,
        weights_gap=max(plan.weights_gap, 0.0),
        random_efficiency=plan.random_plans.efficiency,
        one_at_a_time_efficiency=plan.one_at_a_time.efficiency,
        deflection_uncertainty=deflection,
        worst_deflection_uncertainty=worst_deflection,
        considered=considered,
        feasible=plan.pool.feasible,
        struck_out=plan.pool.struck_out,
    )


def _list_planned_readings(plan: CampaignPlan) -> list[plans.PlannedReading]:
    """Return the readings to take, in order; labels such as p03 are of readings to fit.

    Labels such as v03 are of readings that are held out, to validate the model.
    """
    digits = len(str(len(plan.joints)))  # of the greatest number in a label
    labels = list[str]()
    for number, validates in enumerate(plan.validation, 1):
        letter = "v" if validates else "p"
        labels.append(f"{letter}{number:0{digits}d}")
    directions = [None] * len(plan.joints) if plan.along is None else plan.along
    return build_messages(
        plans.PlannedReading,
        label=labels,
        joints=plan.joints,
        force=plan.force,
        anchor=[None if anchor < 0 else anchor for anchor in plan.anchor.tolist()],
        direction=directions,
        held_out=plan.validation,
        block=plan.block + 1,
    )


def _list_planned_joints(plan: CampaignPlan, robot: Robot) -> list[plans.PlannedJoint]:
    """Return the uncertainty of each joint that the plan determines, and those of simpler plans."""
    parameters = plan.pool.parameters
    joint_indices = parameters.joints
    # Compliances to which the plan's uncertainties are relative
    compliance = parameters.nominal[joint_indices]
    # True if the compliance is known, false for a guess of its size
    is_known = parameters.known[joint_indices]
    return build_messages(
        plans.PlannedJoint,
        name=[robot.joint_names[j] for j in joint_indices],
        kind=[robot.joint_kinds[j] for j in joint_indices],
        standard_uncertainty=compliance * plan.uncertainty,
        relative=np.where(is_known, plan.uncertainty, np.nan),
        before=compliance * plan.uncertainty_before,
        random=compliance * plan.random_plans.uncertainty,
        one_at_a_time=compliance * plan.one_at_a_time.uncertainty,
    )


def _list_joints_left_out(request: PlanRequest, plan: CampaignPlan, robot: Robot) -> list[str]:
    """Return the names of the joints that the plan cannot determine; none if the request names the joints."""
    if request.joints is not None:
        return []
    planned_joints = set(plan.pool.parameters.joints.tolist())
    return [name for j, name in enumerate(robot.joint_names) if j not in planned_joints]


class PlannedTargets(NamedTuple):
    """Targets that the readings of a plan observe."""

    names: tuple[str, ...]
    positions: FloatArray  # (T, 3) in the flange frame [m]


def choose_targets(
    request: plans.PlanRequest, robot: Robot, campaign_readings: Measurements | None
) -> PlannedTargets:
    """Return the targets of the request or, if it has none, those of the campaign so far.

    Raises:
        RequestError: neither has targets, or the campaign was measured with gauges and the plan is not.
    """
    if request.targets:
        for name, place in request.targets.items():
            refuse_far_point(place, f"targets['{name}']")
        return PlannedTargets(tuple(request.targets), np.array(list(request.targets.values())))
    if campaign_readings is None:
        raise RequestError(
            "the positions of the targets are missing",
            where="targets",
            remedy="give `targets`: name and position of at least one target, in the flange frame",
        )
    targets = PlannedTargets(campaign_readings.targets, targets_in_flange(robot, campaign_readings))
    was_measured_with_gauges = campaign_readings.direction is not None
    if not was_measured_with_gauges:
        return targets
    _refuse_no_directions(request)
    return _merge_equal_positions(targets)


def _refuse_no_directions(request: plans.PlanRequest) -> None:
    """Refuse a plan without directions of gauges, because a gauge reads along one direction only.

    Raises:
        RequestError: the plan has no directions.
    """
    if not request.directions:
        raise RequestError(
            "the campaign was measured with gauges, but the plan has no directions along which gauges read",
            where="directions",
            remedy="give `directions` along which a gauge can read, or `targets` of a tracker",
        )


def _merge_equal_positions(targets: PlannedTargets) -> PlannedTargets:
    """Return the first target at each position, rounded to 1 µm.

    A campaign with gauges has one target for each direction of a gauge: three at a point read along x, y, z.
    """
    _, first_targets = np.unique(np.round(targets.positions, 6), axis=0, return_index=True)
    kept = np.sort(first_targets)
    return PlannedTargets(tuple(targets.names[t] for t in kept), targets.positions[kept])


def _choose_scatter(
    request: plans.PlanRequest, campaign_readings: Measurements | None, sigma_ratio: float, sigma: float
) -> Scatter:
    """Return the errors that all targets of a posture will share: as requested, else those of the campaign.

    Args:
        request: request that may state the repeatability of the joints.
        campaign_readings: readings of the campaign, whose shared errors are in units of their own sigma; None
            without a campaign.
        sigma_ratio: sigma of the campaign divided by that of the plan.
        sigma: standard uncertainty of a coordinate of a planned reading [m], the unit of the result.
    """
    campaign_scatter = NO_SCATTER if campaign_readings is None else campaign_readings.scatter
    joints = (
        sigma_ratio * campaign_scatter.joints
        if request.repeatability is None
        else request.repeatability / sigma
    )
    return Scatter(joints, sigma_ratio * campaign_scatter.station)


def _choose_load_point(request: plans.PlanRequest, campaign_readings: Measurements | None) -> FloatArray:
    """Return the load point (3,) in the flange frame [m], from the request or else from the campaign.

    The campaign's load point is that of its greatest force. Without a campaign, it is the flange's origin.
    """
    if request.load_point is not None:
        refuse_far_point(request.load_point, "load_point")
        return np.array(request.load_point)
    if campaign_readings is None:
        return np.zeros(3)
    point: FloatArray = campaign_readings.load_point[
        int(np.argmax(np.linalg.norm(campaign_readings.force, axis=1)))
    ]
    return point


def _choose_loads(request: plans.PlanRequest, robot: Robot, campaign_readings: Measurements | None) -> Loads:
    """Return the loads of the request or, if the request has none, loads like those of the campaign.

    Raises:
        RequestError: neither has a load.
    """
    limits = _convert_torque_limits(request, robot)
    match request.load:
        case OwnWeight():
            return Loads("dead_weight", 0.0, limits)
        case plans.Cable() as load:
            return Loads(load.kind, load.force, limits, np.array(load.anchors))
        case plans.DeadWeight() as load:
            return Loads(load.kind, load.newtons, limits)
        case plans.AnyDirection() as load:
            return Loads(load.kind, load.force, limits)
    if campaign_readings is None or not campaign_readings.force.any():
        raise RequestError(
            "the loads are missing",
            where="load",
            remedy="give `load`: its kind (dead_weight, any_direction or cable) and its force in N, or the "
            "mass of a dead_weight in kg",
        )
    return _repeat_loads(campaign_readings.force, limits)


def _repeat_loads(forces: FloatArray, limits: FloatArray) -> Loads:
    """Return loads like the forces (N, 3) of a campaign [N]; `limits` are those of the joints' torques [N·m].

    If all forces pull down, to at most about 2.6° from the vertical, the load is a dead weight, otherwise a
    force in any direction; its size is the greatest force of the campaign.
    """
    sizes = np.linalg.norm(forces, axis=1)
    pulls_down = forces[:, 2] < -0.999 * sizes
    return Loads("dead_weight" if pulls_down.all() else "any_direction", float(sizes.max()), limits)


def _convert_torque_limits(request: plans.PlanRequest, robot: Robot) -> FloatArray:
    """Return the greatest torque (n,) of the load about each joint [N·m]; infinite without a limit.

    Raises:
        RequestError: a joint that the request names does not exist.
    """
    limits = np.full(robot.n, np.inf)
    for name, limit in request.torque_limits.items():
        limits[robot.joint_index(name, f"torque_limits.{name}")] = limit
    return limits


def _convert_gauge_directions(request: plans.PlanRequest) -> FloatArray | None:
    """Return unit vectors (D, 3) along which gauges can read; None for a tracker, which reads x, y and z.

    Raises:
        RequestError: a direction is zero, or the plan has a tracker, too.
    """
    if not request.directions:
        return None
    vectors = np.array(request.directions)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if length.min() < LEAST_DIRECTION or request.tracker is not None:
        raise RequestError(
            "a direction of a gauge is the zero vector"
            if request.tracker is None
            else "the plan has a tracker and directions of gauges, but a tracker reads all three coordinates",
            where="directions",
            remedy="give directions that are not zero; for gauges, give `sigma` instead of `tracker`",
        )
    return np.asarray(vectors / length)


def _order_reflector_directions(
    surroundings: plans.Surroundings, names: tuple[str, ...]
) -> plans.Surroundings:
    """Return the surroundings with `facing`, the directions of the reflectors, in the order of the targets.

    Raises:
        RequestError: `facing` has not exactly one direction, other than zero, for each target.
    """
    if not surroundings.facing:
        return surroundings
    if set(surroundings.facing) != set(names) or not all(map(any, surroundings.facing.values())):
        raise RequestError(
            f"`facing` has directions for {', '.join(surroundings.facing)}, but the targets are "
            f"{', '.join(names)}",
            where="surroundings.facing",
            remedy="give a direction that is not zero for each target, or omit `facing`",
        )
    in_order = {name: surroundings.facing[name] for name in names}
    return surroundings.model_copy(update={"facing": in_order})


def _convert_candidate_postures(request: plans.PlanRequest, robot: Robot) -> FloatArray | None:
    """Return the postures (P, n) of the request from which the plan chooses; None without such postures."""
    if not request.postures:
        return None
    for i, posture in enumerate(request.postures):
        refuse_wrong_joint_count(robot, posture, f"postures[{i}]")
    return np.array(request.postures)
