"""Work in this process, without a server: the functions of `import jointstiff`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.comparison import Comparison, ComparisonOptions
from jointstiff.schemas.deflection import DeflectionResult
from jointstiff.schemas.fields import Message
from jointstiff.schemas.geometry.message import Geometry, GeometryRequest
from jointstiff.schemas.job import Progress
from jointstiff.schemas.map import Map, MapOptions
from jointstiff.schemas.pair import Pair, PairOptions
from jointstiff.schemas.plan import Plan, PlanOptions
from jointstiff.schemas.program import Program, ProgramOptions
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run.options import RunOptions
from jointstiff.service.inputs.files import FromFile
from jointstiff.service.kinds.comparison import COMPARISON
from jointstiff.service.kinds.geometry import GEOMETRY
from jointstiff.service.kinds.kind import AnyJob, Kind
from jointstiff.service.kinds.map import MAP
from jointstiff.service.kinds.pair import PAIR
from jointstiff.service.kinds.plan import PLAN
from jointstiff.service.kinds.run import RUN
from jointstiff.service.library import campaigns
from jointstiff.service.library.errors import CampaignError
from jointstiff.service.library.results import TabledRun

AnyCampaign = Campaign | Mapping[str, Any] | str | PathLike[str]
"""A campaign, its document, or the name of its file."""
OnProgress = Callable[[Progress], object]


def identify(
    campaign: AnyCampaign,
    options: RunOptions | None = None,
    *,
    on_progress: OnProgress | None = None,
    **fields: Any,  # noqa: ANN401 - fields of RunOptions
) -> TabledRun:
    """Identify the joint stiffnesses from a campaign.

    Args:
        campaign: a file, a document that was read from JSON, or a `Campaign`.
        options: how to identify; those of the campaign if None.
        on_progress: called with the progress of a run that takes steps.
        fields: fields of `RunOptions` that replace these options, such as `method="complete_pose"`.

    Returns:
        The run, with its result in SI units. A failure of the identification is a run in state `failed`.

    Raises:
        CampaignError: campaign or options cannot be used; its `problem` says what, where and what to do.
        OSError: the file cannot be read.
    """
    read = campaign_of(campaign)
    asked = _stated(options or read.run, fields, RunOptions)
    inputs = FromFile()
    run = _done(RUN, inputs, asked, on_progress, measurement_set_id=campaigns.add_campaign(inputs, read))
    return TabledRun.of(run, read)


def compare(
    campaign: AnyCampaign,
    options: ComparisonOptions | None = None,
    *,
    on_progress: OnProgress | None = None,
    **fields: Any,  # noqa: ANN401 - fields of ComparisonOptions
) -> Comparison:
    """Compare the methods on a campaign, unconstrained and constrained; arguments as of `identify`."""
    read, inputs = campaign_of(campaign), FromFile()
    asked = _stated(options or ComparisonOptions(confidence=read.run.confidence), fields, ComparisonOptions)
    set_id = campaigns.add_campaign(inputs, read)
    return _done(COMPARISON, inputs, asked, on_progress, measurement_set_id=set_id)


def pair(
    first: AnyCampaign,
    second: AnyCampaign,
    options: PairOptions | None = None,
    **fields: Any,  # noqa: ANN401 - fields of PairOptions
) -> Pair:
    """Compare two campaigns: encoders of motors and secondary ones, before and after, units A and B.

    Args:
        first: campaign such as with the motors' encoders in the loop, or before.
        second: campaign such as with secondary encoders in the loop, or after.
        options: how to identify both; those of the run in the first campaign if None.
        fields: fields of `PairOptions` that replace these options.

    Raises:
        CampaignError: a robot, readings or the options cannot be used.
    """
    one, other, inputs = campaign_of(first), campaign_of(second), FromFile()
    sides = {
        name: {"measurement_set_id": campaigns.add_campaign(inputs, read, f"{name}.")}
        for name, read in (("first", one), ("second", other))
    }
    asked = _stated(options or PairOptions(options=one.run), fields, PairOptions)
    return _done(PAIR, inputs, asked | sides)


def geometry(
    request: GeometryRequest | Mapping[str, Any] | str | PathLike[str],
    robot: RobotDocument | str | None = None,
    **fields: Any,  # noqa: ANN401 - fields of GeometryRequest
) -> Geometry:
    """Identify a robot's geometry from sweeps of single joints, or from unloaded poses.

    Args:
        request: the readings: a file, a document, or a `GeometryRequest`.
        robot: nominal robot: a document, the name of a file, or of an arm of the catalogue.
        fields: fields of `GeometryRequest` that replace the file's, such as `fit="one_by_one"`.

    Raises:
        CampaignError: the robot or the readings cannot be used.
    """
    from jointstiff.service.library.robots import read_robot

    changes = dict(fields)
    if robot is not None:
        changes["robot"] = (read_robot(robot) if isinstance(robot, str) else robot).model_dump(mode="json")
    if isinstance(request, str | PathLike):
        asked = campaigns.read_document(Path(request), GeometryRequest, changes=changes)
    else:
        stated = (
            request.model_dump(mode="json", exclude_unset=True) if isinstance(request, Message) else request
        )
        asked = campaigns.parse_document({**stated, **changes}, GeometryRequest)
    return campaigns.carried_out(GEOMETRY, FromFile(), asked, section="")


def plan(
    source: AnyCampaign | RobotDocument,
    options: PlanOptions | None = None,
    **fields: Any,  # noqa: ANN401 - fields of PlanOptions
) -> Plan:
    """Plan which postures and loads to measure.

    Args:
        source: the campaign to go on with; or, to begin one, a robot: a document, the name of a file, or of
            an arm of the catalogue.
        options: how to plan.
        fields: fields of `PlanOptions` that replace these options, such as `readings=6`.

    Raises:
        CampaignError: the robot, the readings or the options cannot be used.
    """
    from jointstiff.service.conversion.prepared import prepare_robot
    from jointstiff.service.library.plans import read_planned

    read = read_planned(source) if isinstance(source, str) else source
    if not isinstance(read, RobotDocument):
        read = campaign_of(read)
    inputs, asked = FromFile(), _stated(options, fields, PlanOptions)
    if isinstance(read, Campaign):
        return _done(PLAN, inputs, asked, measurement_set_id=campaigns.add_campaign(inputs, read))
    with campaigns.as_campaign_error("robot"):
        robot_id = inputs.add_robot(prepare_robot(read))
    return _done(PLAN, inputs, asked, robot_id=robot_id)


def predict(
    run: TabledRun | AnyCampaign,
    postures: str | PathLike[str],
    **options: Any,  # noqa: ANN401 - fields of DeflectionOptions
) -> DeflectionResult:
    """Predict deflections and compliance in given postures, under given loads.

    Args:
        run: that `identify` returned, or a campaign, which is identified now.
        postures: CSV file of postures and loads, with units in the headers.
        options: fields of `DeflectionOptions` in SI units, such as `load_point=(0.0, 0.0, 0.12)`.

    Raises:
        CampaignError: run or table cannot be used.
    """
    found = _identified(run)
    table = Path(postures).read_text(encoding="utf-8-sig", errors="replace")
    return campaigns.predict(found.campaign, table, found, **options)


def map(  # noqa: A001 - the kind's name
    run: TabledRun | AnyCampaign,
    options: MapOptions | None = None,
    *,
    on_progress: OnProgress | None = None,
    **fields: Any,  # noqa: ANN401 - fields of MapOptions
) -> Map:
    """Map a work area: how far the tool bends at each place.

    Args:
        run: that `identify` returned, or a campaign, which is identified now.
        options: work area, tool and process.
        on_progress: called with the progress of a map that takes steps.
        fields: fields of `MapOptions` in SI units that replace these options.

    Raises:
        CampaignError: run or options cannot be used.
    """
    found, inputs = _identified(run), FromFile()
    run_id = campaigns.add_model(inputs, found.campaign, found)
    return _done(MAP, inputs, _stated(options, fields, MapOptions), on_progress, run_id=run_id)


def compensate(
    run: TabledRun | AnyCampaign,
    *files: str | PathLike[str],
    options: ProgramOptions | None = None,
    on_progress: OnProgress | None = None,
    **fields: Any,  # noqa: ANN401 - fields of ProgramOptions
) -> Program:
    """Correct a robot program so that the loaded tool reaches the programmed points.

    Args:
        run: that `identify` returned, or a campaign, which is identified now.
        files: the program, a .src with its .dat; and the table of loads, if `loads` names one.
        options: frames, loads, limits.
        on_progress: called with the progress of a long program.
        fields: fields of `ProgramOptions` that replace these options, such as `force=(0, 0, -500)`, short for
            `load={"force": (0, 0, -500)}`.

    Raises:
        CampaignError: run, options or program cannot be used.
    """
    from jointstiff.service.library import programs

    found, changes = _identified(run), dict(fields)
    if "force" in changes:
        changes["load"] = {"force": changes.pop("force")}
    stated = {} if options is None else options.model_dump(mode="json", exclude_unset=True)
    asked = programs.stated_options(None, stated | changes)
    return programs.compensate(found.campaign, [Path(file) for file in files], asked, found, on_progress)


def campaign_of(campaign: AnyCampaign) -> Campaign:
    """Return a campaign from a file, or from a document that was read already.

    Raises:
        CampaignError: the file is too large, or the document is no campaign.
        OSError: the file cannot be read.
    """
    if isinstance(campaign, Campaign):
        return campaign
    if isinstance(campaign, Mapping):
        return campaigns.parse_document(dict(campaign), Campaign)
    return campaigns.read_campaign(Path(campaign))


def _identified(run: TabledRun | AnyCampaign) -> TabledRun:
    found = run if isinstance(run, TabledRun) else identify(run)
    if found.error is not None:
        raise CampaignError(found.error)
    return found


def _stated(options: Message | None, fields: Mapping[str, Any], message: type[Message]) -> dict[str, Any]:
    """Return options with some fields replaced, checked.

    Raises:
        CampaignError: they are no such options, or do not go together.
    """
    stated = {} if options is None else options.model_dump(mode="json", exclude_unset=True)
    return campaigns.parse_document({**stated, **fields}, message).model_dump(mode="json", exclude_unset=True)


def _done(
    kind: Kind[AnyJob, Any, Any],
    inputs: FromFile,
    options: Mapping[str, Any],
    on_progress: OnProgress | None = None,
    **identifiers: Any,  # noqa: ANN401 - ids of the inputs
) -> AnyJob:
    """Carry out a job."""
    request = campaigns.parse_document({**options, **identifiers}, kind.request)
    return campaigns.carried_out(kind, inputs, request, on_progress)
