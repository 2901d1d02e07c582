"""Rehearsals: the readings of a campaign simulated with known stiffnesses, identified, and compared."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from jointstiff.schemas.plan import Plan, PlanResult
from jointstiff.schemas.rehearsal import RehearsalResult
from jointstiff.schemas.run import Campaign, RunResult
from jointstiff.service.kinds.plan.kind import make_campaign_to_fill_in
from jointstiff.service.library.here import Here, restore_job, use_saved
from jointstiff.service.library.results import Presented, TabledRun
from jointstiff.service.library.robots import prepare_once
from jointstiff.service.library.robots import robot as describe_robot
from jointstiff.service.live.rehearsal import (
    add_planned_readings,
    describe_verdict,
    fill_missing_readings,
    make_joints_table,
    rehearse_campaign,
)
from jointstiff.service.problems import CampaignError, as_campaign_error
from jointstiff.service.resources.documents import (
    parse_document,
    read_campaign,
    read_content,
    read_plan_source,
)
from jointstiff.service.tables.stiffness import DEFAULT_UNIT, UNITS
from jointstiff.service.tables.table import Chart, Line, Part, Sheet
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jointstiff.service.reports.plots import PlotStyle


class Rehearsal(Presented, RehearsalResult):
    """Stiffnesses that a campaign would find next to those that were planted; shown as a table."""

    _saved_kind: ClassVar[str] = "rehearsal"

    def _parts(self) -> Sequence[Part]:
        """Return the verdict on the campaign, the joints, and the remarks."""
        table = make_joints_table(self, UNITS[DEFAULT_UNIT])
        return [*map(Line, describe_verdict(self)), table, *map(Line, self.remarks)]

    def _sheets(self) -> Mapping[str, Callable[[], Sheet]]:
        """Return table name → function that makes the table; the only table has a row for each joint."""
        return {"joints": self._make_sheet}

    def _make_sheet(self) -> Sheet:
        """Return the table of the joints in SI units."""
        limits = [joint.interval or (None, None) for joint in self.joints]
        columns = {
            "joint": [joint.name for joint in self.joints],
            "planted [N.m/rad]": [joint.planted for joint in self.joints],
            "found [N.m/rad]": [joint.found for joint in self.joints],
            "low [N.m/rad]": [lower for lower, _ in limits],
            "high [N.m/rad]": [upper for _, upper in limits],
            "half-width [1]": [joint.half_width for joint in self.joints],
        }
        return Sheet.with_joint_kinds(
            Sheet(columns, frozenset({"joint"})), [joint.kind for joint in self.joints]
        )

    def _draw_figure(self, style: PlotStyle) -> Figure:
        """Draw planted and found stiffnesses with their intervals."""
        from jointstiff.service.reports.plots import draw_figure

        unit = UNITS[DEFAULT_UNIT]
        series: dict[str, list[float | None]] = {
            "planted": [joint.planted for joint in self.joints],
            "found": [joint.found for joint in self.joints],
        }
        intervals = {"found": [joint.interval for joint in self.joints]}
        names = [joint.name for joint in self.joints]
        title = "Planted and found stiffness"
        chart = Chart(title, names, series, unit.factor, unit.label, "joints", intervals, True, "stiffness")
        return draw_figure([chart], style=style)


def rehearse(
    source: Any,  # noqa: ANN401 - a campaign, a run or a plan
    /,
    *,
    robot: object = None,
    stiffness: Mapping[str, float] | None = None,
    seed: int = 1,
) -> Rehearsal:
    """Simulate the readings of a campaign with known stiffnesses, identify them, and compare.

    Robot, postures, loads, kinds of readings and noise are those of the campaign. A plan that continues a
    campaign is rehearsed together with the postures of this campaign. The deflections are the exact balance
    of springs and load. The known ("planted") stiffnesses are those of the run. Joints without a number, and
    campaigns that are not measured yet, get stiffnesses that are plausible for an arm of this size.

    Args:
        source: a campaign, a run, or a plan; as an object, a document, or the name of a file. In a campaign
            that is not measured yet, readings may be null.
        robot: robot of a plan, anything that `jointstiff.robot` accepts; or the campaign that a plan of a
            service's file continues, which the file does not have.
        stiffness: planted stiffnesses by joint name [N·m/rad; N/m of a prismatic joint].
        seed: random seed of the noise and of plausible stiffnesses.

    Returns:
        The joints with planted and found stiffness and the interval, with a verdict in words.

    Raises:
        CampaignError: the campaign cannot be used.
        RequestError: a plan has no robot, a joint has another name, or the load is the own weight.
    """
    source = _load_source(source)
    if isinstance(source, Plan):
        campaign, measured = _read_plan(source, robot)
    else:
        campaign, source = _read_source(source)
        measured = None
        if source and campaign.run.weight is None:
            run = source if isinstance(source, TabledRun) else Here().identify(campaign)
            with as_campaign_error(""):
                measured = run._require_result()
    with as_campaign_error("robot"):
        prepared = prepare_once(campaign.robot)
    with as_campaign_error(""):
        return Rehearsal(**dict(rehearse_campaign(campaign, prepared, measured, stiffness, seed)))


def _load_source(source: Any) -> Any:  # noqa: ANN401 - as of `rehearse`
    """Return a run, a plan or a document from a file; return any other source unchanged."""
    if not isinstance(source, str | PathLike) or not Path(source).is_file():
        return source
    document = json.loads(read_content(Path(source)))
    if isinstance(document, dict) and document.get("kind") == "plan":
        return restore_job(document)
    return document if isinstance(document, dict) and "measurement_set" in document else use_saved(source)


def _read_source(source: Any) -> tuple[Campaign, Any]:  # noqa: ANN401 - as of `rehearse`
    """Return the campaign of a source, and its run: a run, true if the campaign has readings, else false."""
    if isinstance(source, TabledRun):
        return source.campaign, source
    if not isinstance(source, Mapping):
        return read_campaign(source), True
    filled, is_measured = fill_missing_readings(source)
    return parse_document(filled, Campaign), is_measured


def _read_plan(plan: Plan, robot: Any) -> tuple[Campaign, RunResult | None]:  # noqa: ANN401 - as of `rehearse`
    """Return the campaign of a plan, and the result of the readings that the plan continues; None without.

    Raises:
        RequestError: the plan failed, or its robot or the campaign that it continues is not known.
    """
    if plan.result is None:
        raise RequestError("the plan has no result", where="plan", remedy="rehearse a plan that succeeded")
    if plan.request.measurement_set_id is None:
        return _begin_campaign(plan, plan.result, robot), None
    options = {"causes": plan.request.causes, "leave_out": plan.request.leave_out}
    continued = _find_continued_campaign(plan, robot)
    continued = continued.model_copy(update={"run": continued.run.model_copy(update=options)})
    measured = None
    # If the readings determine no stiffness, plausible stiffnesses are planted.
    with suppress(CampaignError):
        measured = Here().identify(continued).result
    with as_campaign_error("robot"):
        prepared = prepare_once(continued.robot)
    return add_planned_readings(continued, plan.result, prepared.robot), measured


def _begin_campaign(plan: Plan, result: PlanResult, robot: Any) -> Campaign:  # noqa: ANN401 - as of `rehearse`
    """Return the campaign of a plan that begins one, with its missing readings filled in.

    Raises:
        RequestError: the robot is not known.
    """
    if robot is None:
        raise RequestError("the plan has no robot", where="robot", remedy="give `robot`")
    document = make_campaign_to_fill_in(describe_robot(robot), plan)
    document["measurement_set"]["flange_targets"] = result.targets
    filled, _ = fill_missing_readings(document)
    return parse_document(filled, Campaign)


def _find_continued_campaign(plan: Plan, robot: Any) -> Campaign:  # noqa: ANN401 - as of `rehearse`
    """Return the campaign that a plan continues: the plan's own or, for a plan from a file, that of `robot`.

    Raises:
        RequestError: neither is known.
    """
    origin = getattr(plan, "_origin", None)
    own: Campaign | None = None if origin is None else origin.read_campaign(plan)
    if own is not None:
        return own
    stated = read_plan_source(robot)
    campaign = stated.campaign if isinstance(stated, TabledRun) else stated
    if not isinstance(campaign, Campaign):
        raise RequestError(
            "the plan does not contain the campaign that the plan continues",
            where="robot",
            remedy="give this campaign as `robot`",
        )
    return campaign
