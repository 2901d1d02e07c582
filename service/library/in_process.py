"""Work in this process, without a server: the functions of `import jointstiff`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import Progress
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run.options import RunOptions
from jointstiff.service.inputs.files import FromFile
from jointstiff.service.kinds.kind import AnyJob, Kind
from jointstiff.service.kinds.rooms import ROOMS, kind_of
from jointstiff.service.kinds.run import RUN
from jointstiff.service.library import campaigns
from jointstiff.service.library.errors import CampaignError
from jointstiff.service.library.results import TabledRun
from jointstiff.service.problems.table import http_problem

if TYPE_CHECKING:
    from jointstiff.schemas.comparison import Comparison, ComparisonOptions
    from jointstiff.schemas.deflection import DeflectionResult
    from jointstiff.schemas.geometry.message import Geometry, GeometryRequest
    from jointstiff.schemas.imports import ImportAnswer
    from jointstiff.schemas.map import Map, MapOptions
    from jointstiff.schemas.pair import Pair, PairOptions
    from jointstiff.schemas.plan import Plan, PlanOptions
    from jointstiff.schemas.program import Program, ProgramOptions

AnyCampaign = Campaign | Mapping[str, Any] | str | PathLike[str]
"""A campaign, its document, or the name of its file."""
OnProgress = Callable[[Progress], object]


def identify(
    campaign: AnyCampaign,
    /,
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
    run = do(RUN, read, options=options or read.run, on_progress=on_progress, **fields)
    return TabledRun.of(run, read)


def compare(
    campaign: AnyCampaign,
    /,
    options: ComparisonOptions | None = None,
    *,
    on_progress: OnProgress | None = None,
    **fields: Any,  # noqa: ANN401 - fields of ComparisonOptions
) -> Comparison:
    """Compare the methods on a campaign, unconstrained and constrained; arguments as of `identify`."""
    from jointstiff.schemas.comparison import ComparisonOptions
    from jointstiff.service.kinds.comparison import COMPARISON

    read = campaign_of(campaign)
    chosen = options or ComparisonOptions(confidence=read.run.confidence)
    return do(COMPARISON, read, options=chosen, on_progress=on_progress, **fields)


def pair(
    first: AnyCampaign,
    second: AnyCampaign,
    /,
    options: PairOptions | Mapping[str, Any] | None = None,
    **fields: Any,  # noqa: ANN401 - fields of PairOptions
) -> Pair:
    """Compare two campaigns: encoders of motors and secondary ones, before and after, units A and B.

    Args:
        first: campaign such as with the motors' encoders in the loop, or before.
        second: campaign such as with secondary encoders in the loop, or after.
        options: how to identify both, or the fields of `RunOptions` for it; those of the run in the first
            campaign if None.
        fields: fields of `PairOptions` that replace these options.

    Raises:
        CampaignError: a robot, readings or the options cannot be used.
    """
    from jointstiff.schemas.pair import PairOptions
    from jointstiff.service.kinds.pair import PAIR

    if isinstance(options, Mapping):
        options = campaigns.parse_document({"options": dict(options)}, PairOptions)
    one = campaign_of(first)
    return do(PAIR, one, campaign_of(second), options=options or PairOptions(options=one.run), **fields)


def geometry(
    request: GeometryRequest | Mapping[str, Any] | str | PathLike[str],
    /,
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
    from jointstiff.service.kinds.geometry import GEOMETRY
    from jointstiff.service.library.plans import read_robot

    changes = dict(fields)
    if robot is not None:
        nominal = read_robot(robot) if isinstance(robot, str) else robot
        changes |= {"robot": nominal.model_dump(mode="json"), "robot_id": None}
    return do(GEOMETRY, request, **changes)


def import_files(*files: str | PathLike[str], **options: Any) -> ImportAnswer:  # noqa: ANN401 - of ImportRequest
    """Understand files of readings, as `jointstiff import` does.

    Args:
        files: tables and lists of points, text or Excel.
        options: fields of `ImportRequest`, such as `columns={"A1": "J1 [deg]"}`.

    Returns:
        The preview, and the measurement set, or the unloaded poses, that the files make.

    Raises:
        CampaignError: a file or an option was not understood.
    """
    from jointstiff.schemas.imports import ImportRequest
    from jointstiff.service.importing.reading import SourceFile
    from jointstiff.service.problems.errors import FilesError
    from jointstiff.service.problems.table import problem_of
    from jointstiff.service.resources import imports

    request = campaigns.parse_document(options, ImportRequest)
    sources = [SourceFile(Path(file).name, Path(file).read_bytes()) for file in files]
    try:
        return imports.import_files(sources, request)
    except FilesError as error:
        raise CampaignError(problem_of(error)) from error


def plan(
    source: AnyCampaign | RobotDocument,
    /,
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
    from jointstiff.service.kinds.plan import PLAN

    return do(PLAN, source, options=options, **fields)


def predict(
    run: TabledRun | AnyCampaign,
    postures: str | PathLike[str],
    /,
    **options: Any,  # noqa: ANN401 - fields of DeflectionOptions
) -> DeflectionResult:
    """Predict deflections and compliance in given postures, under given loads.

    Args:
        run: that `identify` returned, or a campaign, which is identified now.
        postures: CSV file of postures and loads, with units in the headers.
        options: fields of `DeflectionOptions`, in SI units or in its `units`, such as
            `load_point=(0, 0, 120), units={"length": "mm"}`.

    Raises:
        CampaignError: run or table cannot be used.
    """
    identified = _identified(run)
    table = Path(postures).read_text(encoding="utf-8-sig", errors="replace")
    return campaigns.predict(identified.campaign, table, identified, **options)


def map(  # noqa: A001 - the kind's name
    run: TabledRun | AnyCampaign,
    /,
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
    from jointstiff.service.kinds.map import MAP

    return do(MAP, run, options=options, on_progress=on_progress, **fields)


def compensate(
    run: TabledRun | AnyCampaign,
    /,
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
    from jointstiff.service.kinds.program import PROGRAM

    if "force" in fields:
        fields["load"] = {"force": fields.pop("force")}
    if options is None:
        fields = {"units": {"length": "m", "angle": "deg", "force": "N"}} | fields
    table = fields.get("loads")
    if table is not None and Path(table).is_file():
        fields["loads"], files = Path(table).name, (*files, table)
    return do(PROGRAM, run, *files, options=options, on_progress=on_progress, **fields)


def do(
    kind: Kind[AnyJob, Any, Any],
    /,
    *sources: Any,  # noqa: ANN401 - one for each of the kind's, two for a pair, the rest for files
    options: Message | None = None,
    on_progress: OnProgress | None = None,
    **fields: Any,  # noqa: ANN401 - fields of the kind's options
) -> AnyJob:
    """Carry out a job of any kind.

    Args:
        kind: its kind.
        sources: what its request is made of, in the order of `kind.sources`.
        options: options of the request.
        on_progress: called with the progress of a job that takes steps.
        fields: options that replace these.

    Raises:
        CampaignError: a source or the options cannot be used.
    """
    inputs, waiting = FromFile(), list(sources)
    request: dict[str, Any] = {}
    for source in kind.sources:
        request |= _TAKE[source](inputs, waiting)
    chosen = {} if options is None else options.model_dump(mode="json", exclude_unset=True)
    if "leave_out" not in kind.request.model_fields:
        request.pop("leave_out", None)
    message = campaigns.parse_document({**request, **chosen, **fields}, kind.request)
    section = "" if "readings" in kind.sources or "files" in kind.sources else None
    return campaigns.carried_out(kind, inputs, message, on_progress, section)


def function_of(command: str) -> Callable[..., Any]:
    """Return the function of a kind of work by its verb, of this module or made of the declaration."""
    function: Callable[..., Any] | None = globals().get(command)
    if function is not None:
        return function
    name = next(name for name, room in ROOMS.items() if room.command == command)
    return partial(do, kind_of(name))


def _take_set(inputs: FromFile, waiting: list[Any]) -> dict[str, Any]:
    return _set_of(inputs, waiting.pop(0))


def _set_of(inputs: FromFile, source: AnyCampaign, file: str = "") -> dict[str, Any]:
    """Return the set of a campaign and what its run leaves out."""
    campaign = campaign_of(source)
    set_id = campaigns.add_campaign(inputs, campaign, file)
    return {"measurement_set_id": set_id, "leave_out": campaign.run.leave_out}


def _take_run(inputs: FromFile, waiting: list[Any]) -> dict[str, Any]:
    identified = _identified(waiting.pop(0))
    return {"run_id": campaigns.add_model(inputs, identified.campaign, identified)}


def _take_pair(inputs: FromFile, waiting: list[Any]) -> dict[str, Any]:
    return {name: _set_of(inputs, waiting.pop(0), f"{name}.") for name in ("first", "second")}


def _take_robot_or_set(inputs: FromFile, waiting: list[Any]) -> dict[str, Any]:
    from jointstiff.service.conversion.prepared import prepare_robot
    from jointstiff.service.library.plans import read_planned

    source = waiting.pop(0)
    read = read_planned(source) if isinstance(source, str) else source
    if not isinstance(read, RobotDocument):
        return _take_set(inputs, [read])
    with campaigns.as_campaign_error("robot"):
        return {"robot_id": inputs.add_robot(prepare_robot(read))}


def _take_readings(_inputs: FromFile, waiting: list[Any]) -> dict[str, Any]:
    source = waiting.pop(0)
    if isinstance(source, str | PathLike):
        return campaigns.read_object(Path(source))
    return source.model_dump(mode="json", exclude_unset=True) if isinstance(source, Message) else dict(source)


def _take_files(_inputs: FromFile, waiting: list[Any]) -> dict[str, Any]:
    from jointstiff.service.kinds.program import PROGRAM
    from jointstiff.service.kinds.program.work import packed

    contents = {Path(path).name: Path(path).read_bytes() for path in waiting}
    if sum(len(content) for content in contents.values()) > PROGRAM.max_bytes:
        raise CampaignError(http_problem(413, "the files exceed 16 MiB", "split the program"))
    files = [packed(name, content) for name, content in contents.items()]
    return {"files": [file.model_dump(mode="json") for file in files]}


_TAKE: Final[Mapping[str, Callable[[FromFile, list[Any]], dict[str, Any]]]] = {
    "measurement_set": _take_set,
    "run": _take_run,
    "pair": _take_pair,
    "robot_or_set": _take_robot_or_set,
    "readings": _take_readings,
    "files": _take_files,
}
"""Fields of a request by what they are made of."""


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
    identified = run if isinstance(run, TabledRun) else identify(run)
    if identified.error is not None:
        raise CampaignError(identified.error)
    return identified
