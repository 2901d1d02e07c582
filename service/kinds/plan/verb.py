"""The verb of plans."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from jointstiff.schemas.plan import PlanOptions
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.kinds.plan.kind import PLAN
from jointstiff.service.kinds.verb import (
    Backend,
    JobMonitor,
    Request,
    carry_out_verb,
    describe_verb,
    merge_options,
)
from jointstiff.service.problems import as_campaign_error
from jointstiff.service.resources.documents import read_plan_source

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.finding import NamedCause
    from jointstiff.schemas.measurement import Instrument
    from jointstiff.schemas.options import OwnWeight, StiffnessPrior
    from jointstiff.schemas.plan import (
        AnyDirection,
        Cable,
        DeadWeight,
        DecisionGoal,
        DeflectionGoal,
        JointsGoal,
        LoadPointGoal,
        Plan,
        PlannedStep,
        Surroundings,
    )
    from jointstiff.service.conversion.units import AnyUnits
    from jointstiff.service.kinds.verb import Cancel, Matrix, OnProgress, Source, Vector


class PlanFields(TypedDict, total=False):
    """Options of `plan`."""

    units: AnyUnits
    work_area: Matrix | None
    load: str | DeadWeight | Mapping[str, Any] | AnyDirection | Cable | OwnWeight | None
    targets: Mapping[str, Vector]
    directions: Matrix
    load_point: Vector | None
    sigma: float | None
    repeatability: float | None
    tracker: Instrument | Mapping[str, Any] | None
    torque_limits: Mapping[str, float]
    stiffness: Mapping[str, float]
    priors: Mapping[str, StiffnessPrior | Mapping[str, Any]]
    joints: Sequence[str]
    candidates: int
    postures: Matrix
    surroundings: Surroundings | Mapping[str, Any]
    distinct_angle: float
    elastic_links: bool | None
    seed: int
    accept_verdict: Literal["do_not_use"] | None
    readings: int
    goal: str | JointsGoal | Mapping[str, Any] | DeflectionGoal | DecisionGoal | LoadPointGoal | None
    weight_step: PlannedStep | Mapping[str, Any] | None
    criterion: Literal["relative_a", "work_area", "d", "e", "worst_place"] | None
    causes: Sequence[NamedCause | Mapping[str, Any]]
    leave_out: Sequence[str]
    validation: float


def plan(
    backend: Backend,
    source: Source | RobotDocument,
    /,
    options: PlanOptions | None = None,
    *,
    on_progress: OnProgress | None = None,
    cancel: Cancel | None = None,
    executor: Executor | None = None,
    **fields: Unpack[PlanFields],
) -> Plan:
    """Plan which postures and loads to measure.

    Args:
        source: the campaign to continue; or, to begin a campaign, a robot: a document, the name of a file, or
            the name of an arm of the catalogue.
    """

    def make_request(backend: Backend) -> Request:
        """Return the robot or the set to measure, with the options.

        Causes and left-out readings of the campaign's run apply, unless options replace them.
        """
        planned = read_plan_source(source)
        if isinstance(planned, RobotDocument):
            request: dict[str, Any] = {"robot_id": backend.prepare_robot(planned)}
        else:
            set_id, run_options = backend.prepare_set(planned)
            request = {"measurement_set_id": set_id}
            if run_options is not None:
                inherited = run_options.model_dump(mode="json", include={"causes", "leave_out"})
                request |= {name: value for name, value in inherited.items() if value}
        stated = dict[str, Any](fields)
        if isinstance(stated.get("load"), str):
            from jointstiff.service.conversion.units import parse_load_text

            with as_campaign_error(""):
                stated["load"] = parse_load_text(stated["load"])
        request |= merge_options(PlanOptions, options, stated, lambda: backend.joint_kinds(planned))
        return Request(request)

    return carry_out_verb(backend, PLAN, JobMonitor(on_progress, cancel, executor), make_request)


describe_verb(plan, PLAN)
