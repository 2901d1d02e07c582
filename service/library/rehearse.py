"""Rehearsals: the readings of a campaign simulated with known stiffnesses, identified, and compared."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jointstiff.schemas.plan import Plan
from jointstiff.schemas.rehearsal import RehearsalResult
from jointstiff.schemas.run import Campaign
from jointstiff.service.kinds.plan.kind import make_campaign_to_fill_in
from jointstiff.service.library.here import Here
from jointstiff.service.library.results import Presented, TabledRun
from jointstiff.service.library.robots import prepare_once
from jointstiff.service.library.robots import robot as describe_robot
from jointstiff.service.live.rehearsal import (
    describe_verdict,
    fill_missing_readings,
    make_joints_table,
    rehearse_campaign,
)
from jointstiff.service.problems import as_campaign_error
from jointstiff.service.resources.documents import parse_document, read_campaign, read_content
from jointstiff.service.tables.stiffness import DEFAULT_UNIT, UNITS
from jointstiff.service.tables.table import Chart, Line, Part, Sheet
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jointstiff.service.reports.plots import PlotStyle


class Rehearsal(Presented, RehearsalResult):
    """Stiffnesses that a campaign would find next to those that were planted; shown as a table."""

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

    Robot, postures, loads, kinds of readings and noise are those of the campaign. The deflections are the
    exact balance of springs and load. The known ("planted") stiffnesses are those of the run. Joints without
    a number, and campaigns that are not measured yet, get stiffnesses that are plausible for an arm of this
    size.

    Args:
        source: a campaign, a run, or a plan; as an object, a document, or the name of a file. In a campaign
            that is not measured yet, readings may be null.
        robot: robot of a plan; anything that `jointstiff.robot` accepts.
        stiffness: planted stiffnesses by joint name [N·m/rad; N/m of a prismatic joint].
        seed: random seed of the noise and of plausible stiffnesses.

    Returns:
        The joints with planted and found stiffness and the interval, with a verdict in words.

    Raises:
        CampaignError: the campaign cannot be used.
        RequestError: a plan has no robot, a joint has another name, or the load is the own weight.
    """
    campaign, source = _read_source(source, robot)
    with as_campaign_error("robot"):
        prepared = prepare_once(campaign.robot)
    run: TabledRun | None = None
    if source and campaign.run.weight is None:
        run = source if isinstance(source, TabledRun) else Here().identify(campaign)
    with as_campaign_error(""):
        measured = None if run is None else run._require_result()
        return Rehearsal(**dict(rehearse_campaign(campaign, prepared, measured, stiffness, seed)))


def _read_source(source: Any, robot: object) -> tuple[Campaign, Any]:  # noqa: ANN401 - as of `rehearse`
    """Return the campaign of a source, and its run: a run, true if the campaign has readings, else false."""
    from jointstiff.service.library.saved import load, use_saved

    if isinstance(source, str | PathLike) and Path(source).is_file():
        document = json.loads(read_content(Path(source)))
        if isinstance(document, dict) and document.get("kind") == "plan":
            source = load(source)
        elif isinstance(document, dict) and "measurement_set" in document:
            source = document
        else:
            source = use_saved(source)
    if isinstance(source, TabledRun):
        return source.campaign, source
    if isinstance(source, Plan):
        if robot is None:
            raise RequestError("the plan has no robot", where="robot", remedy="give the argument `robot`")
        source = make_campaign_to_fill_in(describe_robot(robot), source) | {"targets": source.result}
        targets = source.pop("targets").targets
        source["measurement_set"]["flange_targets"] = targets
    if not isinstance(source, Mapping):
        return read_campaign(source), True
    filled, is_measured = fill_missing_readings(source)
    return parse_document(filled, Campaign), is_measured
