"""The verbs of `import jointstiff` and `Client`, made of the kinds of work; and work in this process."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeVar, Unpack, cast

from jointstiff.schemas import run as messages
from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import Job
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import CampaignRun, Run, RunRequest
from jointstiff.service.conversion.arrays import units_of
from jointstiff.service.conversion.prepared import PreparedRobot, prepare_robot
from jointstiff.service.kinds.kind import AnyJob, AnyKind, File, Kind
from jointstiff.service.kinds.rooms import ROOMS, kind_of
from jointstiff.service.kinds.work import QuickWork, carry_out, new_job
from jointstiff.service.library import results
from jointstiff.service.library.cases import AnyPostures, load_cases
from jointstiff.service.library.errors import CampaignError
from jointstiff.service.library.files import (
    AnyCampaign,
    as_campaign_error,
    campaign_of,
    parse_document,
    read_document,
    read_object,
    read_planned,
    read_robot,
)
from jointstiff.service.library.follow import Cancel, Follow, OnProgress
from jointstiff.service.library.results import Door, Prediction, TabledRun, shown
from jointstiff.service.problems.table import http_problem, problem_of
from jointstiff.service.reports.job import job_sheet
from jointstiff.service.resources.inputs import FromFile
from jointstiff.service.tables.files import written
from jointstiff.service.tables.table import Sheet
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    from jointstiff.schemas.imports import ImportAnswer
    from jointstiff.service.library.campaigns import Numbers
    from jointstiff.service.library.typed import ImportFields, PredictFields
    from jointstiff.service.reports.exports import ExportedModel

AJob = TypeVar("AJob", bound=Job, covariant=True)


class Verb(Protocol[AJob]):
    """A kind of work as a function; its docstring, made of the kind's messages, says what it takes."""

    def __call__(
        self,
        *sources: Any,  # noqa: ANN401 - campaigns, runs, files: see the docstring of each
        options: Message | None = None,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        **fields: Any,  # noqa: ANN401 - fields of the options
    ) -> AJob:
        """Do the work; return the job once it has ended."""


@dataclass
class _Call:
    """Arguments of a verb while its request is made of them."""

    kind: AnyKind
    door: Door
    waiting: list[Any]  # sources that are not taken yet
    options: Message | None
    fields: dict[str, Any]
    follow: Follow


def verb_of(kind: AnyKind, door: Callable[[], Door]) -> Verb[Any]:
    """Return the function of a kind of work.

    Args:
        kind: its declaration.
        door: returns where the work is done, for each work.
    """

    def verb(
        *sources: Any,  # noqa: ANN401 - of the kind
        options: Message | None = None,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        **fields: Any,  # noqa: ANN401 - of the options
    ) -> Job:
        waiting = list(sources)
        if options is None and waiting and isinstance(waiting[-1], kind.options):
            options = waiting.pop()
        fields = _in_words(fields)
        with Follow(on_progress, cancel) as follow:
            call = _Call(kind, door(), waiting, options, fields, follow)
            parts: dict[str, Any] = {}
            for source in kind.sources:
                parts |= _TAKE[source](call)
            if waiting:
                raise TypeError(f"{verb.__name__}() takes {len(sources) - len(waiting)} sources")
            files = parts.pop("files", {})
            if "readings" not in kind.sources:
                parts = {name: value for name, value in parts.items() if name in kind.request.model_fields}
            if call.options is not None:
                parts |= call.options.model_dump(mode="json", exclude_unset=True)
            job: Job = call.door.done(kind, parts | fields, files, follow)
        return job

    verb.__name__ = verb.__qualname__ = ROOMS[kind.name].command
    verb.__doc__ = _explained(kind)
    verb.__signature__ = _signature(kind)  # type: ignore[attr-defined]
    return verb


def _in_words(fields: dict[str, Any]) -> dict[str, Any]:
    """Return options whose units and goal are messages, where they were words."""
    if isinstance(fields.get("units"), str):
        fields = fields | {"units": units_of(fields["units"])}
    if isinstance(fields.get("goal"), str):
        from jointstiff.service.live.declaration import goal_of

        with as_campaign_error(""):
            fields = fields | {"goal": goal_of(fields["goal"])}
    return fields


@cache
def function_of(command: str) -> Verb[Any]:
    """Return a verb in this process, such as `identify`."""
    name = next(name for name, room in ROOMS.items() if room.command == command)
    return verb_of(kind_of(name), Here)


def _signature(kind: AnyKind) -> inspect.Signature:
    """Return the signature that `help` and notebooks show: the sources, then all options by name."""
    names = [name for source in kind.sources for name in _SOURCES[source]]
    sources = [
        inspect.Parameter(name.strip("*"), inspect.Parameter.VAR_POSITIONAL)
        if name.startswith("*")
        else inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY)
        for name in names
    ]
    others = [
        "options",
        "on_progress",
        "cancel",
        *(name for name in kind.options.model_fields if name != "options"),
    ]
    keywords = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None) for name in others]
    return inspect.Signature([*sources, *keywords])


def _explained(kind: AnyKind) -> str:
    """Return the docstring of a verb, made of the kind's messages."""
    arguments = {
        **{name: text for source in kind.sources for name, text in _SOURCES[source].items()},
        "options": f"a `{kind.options.__name__}`; the options below replace its fields.",
        "on_progress": "called with the progress of a job that takes steps; default: a bar in a terminal or "
        "a notebook, if it takes more than 2 s.",
        "cancel": "asked between steps, such as `threading.Event().is_set`; if true, the job ends as "
        "`cancelled`.",
    }
    for name, field in kind.options.model_fields.items():
        extra = field.json_schema_extra
        unit = f" [{extra['unit']}]" if isinstance(extra, dict) and extra.get("unit") else ""
        arguments.setdefault(name, f"{' '.join((field.description or '').split())}{unit}")
    return "\n".join(
        [
            f"{ROOMS[kind.name].summary}\n\nArgs:",
            *(f"    {name}: {text}" for name, text in arguments.items()),
            f"\nReturns:\n    The {kind.message.__name__}, with its result in SI units. A failure of the "
            "computation is one in state `failed`.",
            "\nRaises:\n    CampaignError: a source or an option cannot be used; its `problem` says what, "
            "where and what to do.",
            "    RefusedError: the service refuses it.\n    OSError: a file cannot be read.",
        ]
    )


_SOURCES: Final[Mapping[str, Mapping[str, str]]] = {
    "measurement_set": {"campaign": "a file, a document that was read from JSON, a `Campaign`, or a run."},
    "run": {"run": "what `identify` returned, or a campaign, which is identified now."},
    "campaigns": {
        "first": "campaign or run; of two such as with the motors' encoders in the loop, or before a change.",
        "second": "campaign or run such as with secondary encoders in the loop, or after a change; if "
        "absent, the methods are compared on the first.",
    },
    "robot_or_set": {
        "source": "the campaign to go on with; or, to begin one, a robot: a document, the name of a file, or "
        "of an arm of the catalogue."
    },
    "readings": {"readings": "a file, a document, or the message of the request."},
    "files": {"*files": "the program, a .src with its .dat; and the table of loads, if `loads` names one."},
}
"""Arguments of a verb and their descriptions, by what its kind is made of."""


def _take_campaign(call: _Call) -> dict[str, Any]:
    set_id, run = call.door.measured(call.waiting.pop(0))
    if run is None:
        return {"measurement_set_id": set_id}
    own: dict[str, Any] = {}
    if call.options is None and issubclass(call.kind.request, CampaignRun):
        own = run.model_dump(mode="json", exclude_unset=True)
    elif call.options is None:
        own = {"confidence": run.confidence}
    return own | {"measurement_set_id": set_id, "leave_out": run.leave_out}


def _take_campaigns(call: _Call) -> dict[str, Any]:
    """Make the runs of one campaign or two, by each method and constraint, and compare them."""
    from jointstiff.schemas.comparison import CampaignComparison
    from jointstiff.service.kinds.comparing import ComparedSet, comparison_of

    stated = {} if call.options is None else call.options.model_dump(mode="json", exclude_unset=True)
    chosen = parse_document({**stated, **call.fields}, CampaignComparison)
    call.options = None
    call.fields.clear()
    given = call.waiting[:2]
    sets: list[ComparedSet] = []
    for source, place in zip(given, ("first.", "second."), strict=False):
        set_id, own = call.door.measured(source, place if len(given) > 1 else "")
        own = own or CampaignRun()
        shared = own if isinstance(source, Run) or not sets else sets[0].options
        sets.append(ComparedSet(set_id, own.leave_out, chosen.run or shared))
    del call.waiting[:2]
    request = comparison_of(
        sets, chosen, lambda asked, dispensable: call.door.run(asked, call.follow, dispensable)
    )
    parts: dict[str, Any] = request.model_dump(mode="json", exclude_unset=True)
    return parts


def _take_robot_or_campaign(call: _Call) -> dict[str, Any]:
    source = call.waiting[0]
    call.waiting[0] = source = read_planned(source)
    if isinstance(source, RobotDocument):
        return {"robot_id": call.door.described(call.waiting.pop(0))}
    set_id, run = call.door.measured(call.waiting.pop(0))
    causes = [] if run is None else [cause.model_dump(mode="json") for cause in run.causes]
    return {"measurement_set_id": set_id, **({"causes": causes} if causes else {})}


def _take_readings(call: _Call) -> dict[str, Any]:
    robot = call.fields.get("robot")
    robot = read_robot(robot) if isinstance(robot, str) else robot
    if isinstance(robot, Message):
        call.fields.update(robot=robot.model_dump(mode="json"), robot_id=None)
    source = call.waiting.pop(0) if call.waiting else {}
    return read_object(Path(source)) if isinstance(source, str | PathLike) else dict(source)


def _take_files(call: _Call) -> dict[str, Any]:
    if "force" in call.fields:
        call.fields["load"] = {"force": call.fields.pop("force")}
    table = call.fields.get("loads")
    if table is not None and Path(table).is_file():
        call.fields["loads"] = Path(table).name
        call.waiting.append(table)
    contents = {Path(path).name: Path(path).read_bytes() for path in call.waiting}
    call.waiting.clear()
    units = {"length": "m", "angle": "deg", "force": "N"}
    return {"files": contents, **({"units": units} if call.options is None else {})}


_TAKE: Final[Mapping[str, Callable[[_Call], dict[str, Any]]]] = {
    "measurement_set": _take_campaign,
    "run": lambda call: {"run_id": call.door.identified(call.waiting.pop(0))},
    "campaigns": _take_campaigns,
    "robot_or_set": _take_robot_or_campaign,
    "readings": _take_readings,
    "files": _take_files,
}
"""Fields of a request, by what it is made of."""


class Here:
    """This process: what requests are made of is prepared from files, and computed here and now."""

    def __init__(self, campaign: messages.Campaign | None = None) -> None:
        """Begin without inputs; with the campaign of a run that was identified before."""
        self.inputs, self.campaign = FromFile(), campaign

    def measured(self, source: Any, place: str = "") -> tuple[str, CampaignRun]:  # noqa: ANN401 - campaign or run
        """Prepare a campaign; return the id of its measurement set, and the options of its run.

        Raises:
            CampaignError: robot or readings cannot be used.
        """
        if isinstance(source, TabledRun):
            return self.measured(source.campaign)[0], options_of(source)
        self.campaign = campaign = campaign_of(source)
        with as_campaign_error(f"{place}robot"):
            robot = _prepared(campaign.robot.model_dump_json())
        with as_campaign_error(f"{place}measurement_set"):
            return self.inputs.add_set(campaign.measurement_set, robot), campaign.run

    def identified(self, source: Any) -> str:  # noqa: ANN401 - a run, or a campaign
        """Prepare a run, which is identified now from a campaign; return its id.

        Raises:
            CampaignError: it has failed, or is not of its campaign by this version.
        """
        from jointstiff.service.kinds.identification import run_hash

        run: TabledRun = source if isinstance(source, TabledRun) else function_of("identify")(source)
        if run.error is not None:
            raise CampaignError(run.error)
        set_id, _ = self.measured(run.campaign)
        with as_campaign_error("prediction"):
            labels = {each.label for each in run.campaign.measurement_set.observations}
            left_out = run.request.leave_out
            if not set(left_out) < labels or run.provenance.input_hash != run_hash(
                self.inputs.measured(set_id, "run_id", left_out), run.request
            ):
                raise RequestError(
                    f"the run '{run.id}' is of another robot or of other readings",
                    where="run_id",
                    remedy="give a run of this campaign by this version, or omit it to identify the campaign "
                    "now",
                )
        return self.inputs.add_run(run, set_id)

    def run(self, request: RunRequest, follow: Follow, dispensable: bool) -> Run:
        """Identify a measurement set that was prepared; what cannot support the method is a failed run.

        Raises:
            CampaignError: the request cannot be used, or the run is not dispensable.
        """
        try:
            run: Run = self.done(kind_of("run"), request.model_dump(mode="json"), {}, follow)
        except CampaignError as refused:
            if not dispensable or not refused.problem.type.endswith(":unsupported-method"):
                raise
            nothing = QuickWork(lambda: request, input_hash="", robot_id=None)
            failed = {"state": "failed", "error": refused.problem}
            run = new_job(Run, request, nothing).model_copy(update=failed)
        self.inputs.add_run(run, request.measurement_set_id)
        return run

    def described(self, robot: RobotDocument) -> str:
        """Prepare a robot; return its id."""
        with as_campaign_error("robot"):
            return self.inputs.add_robot(prepare_robot(robot))

    def done(
        self,
        kind: Kind[AnyJob, Any, Any],
        request: dict[str, Any],
        files: Mapping[str, bytes],
        follow: Follow,
    ) -> AnyJob:
        """Do the work of a request; return the job.

        Raises:
            CampaignError: the request cannot be used.
        """
        if kind.is_form:
            from jointstiff.service.kinds.program_work import packed

            if sum(map(len, files.values())) > kind.max_bytes:
                raise CampaignError(http_problem(413, "the files exceed 16 MiB", "split the program"))
            parts = [packed(name, content).model_dump(mode="json") for name, content in files.items()]
            request = request | {"files": parts}
        message = parse_document(request, kind.request)
        with as_campaign_error("" if {"readings", "files"} & set(kind.sources) else kind.name):
            work = kind.compute(self.inputs, message)
            new = new_job(shown(kind), message, work)
            job: AnyJob = carry_out(new, work, follow, lambda: follow.cancelled)
        return results.of(job, self)

    def file(
        self, job: Job, name: str, query: Mapping[str, str] | None = None, laboratory: Path | None = None
    ) -> bytes:
        """Return a file of a job, as a service would.

        Raises:
            CampaignError: the file cannot be made, or the run is not to be used.
        """
        kind, suffix = kind_of(job.kind), name.rpartition(".")[2]
        if name.startswith("report."):
            return self._report(kind, job, suffix, laboratory)
        if name.startswith("model."):
            from jointstiff.service.reports.exports import export_model

            with as_campaign_error("export"):
                return export_model(_exported(job), cast("Any", suffix), (query or {}).get("accept_verdict"))
        if name == "program":
            from jointstiff.service.kinds.program_work import unpacked

            wanted = (query or {}).get("file")
            return next(unpacked(each) for each in cast("Any", job.result).files if each.name == wanted)
        file = next(file for file in kind.files if file.name == name)
        return written(self.sheet(job, file), suffix)

    def sheet(self, job: Job, file: File) -> Sheet:
        """Return the table of a file of a job; one that the result does not hold is computed again."""
        kind = kind_of(job.kind)
        return job_sheet(file, job, lambda: kind.compute(self.inputs, job.request))

    def campaign_of(self, _run: Run) -> messages.Campaign | None:
        """Return the campaign that was prepared; None if there is none."""
        return self.campaign

    def predict(
        self,
        run: Any,  # noqa: ANN401 - a run, or a campaign
        postures: AnyPostures,
        /,
        forces: Numbers | None = None,
        **options: Unpack[PredictFields],
    ) -> Prediction:
        """Predict deflections by a run; arguments as of the function below."""
        from jointstiff.service.kinds.deflection import predict_by_run

        known = self.inputs.run(self.identified(run), "run_id")
        with as_campaign_error("prediction"):
            robot = known.prepared.robot
            kinds = dict(zip(robot.joint_names, robot.joint_kinds, strict=True))
            request = load_cases(postures, kinds, forces, options)
            return Prediction.model_validate(dict(predict_by_run(robot, known.run, request)))

    def _report(self, kind: AnyKind, job: Job, suffix: str, laboratory: Path | None) -> bytes:
        from jointstiff.service.reports.certificate import certificate
        from jointstiff.service.reports.document import draft
        from jointstiff.service.reports.job import job_document
        from jointstiff.service.reports.laboratory import LaboratorySettings, read_laboratory
        from jointstiff.service.reports.rendering import report_page, report_pdf
        from jointstiff.service.reports.run import RunSubject, run_document

        settings = LaboratorySettings() if laboratory is None else read_laboratory(laboratory)
        if isinstance(job, TabledRun):
            subject = RunSubject(_exported(job), job.campaign.measurement_set, settings)
            if suffix == "xml":
                with as_campaign_error("report"):
                    return certificate(subject, draft())
            document = run_document(subject, draft())
        elif suffix == "xml":
            raise ValueError(f"a {kind.name} has no certificate: runs have")
        else:
            document = job_document(kind, job, job.model_dump_json(), settings)
        with as_campaign_error("report"):
            return report_pdf(document) if suffix == "pdf" else report_page(document)

    def apply(self, run: TabledRun, action: str) -> TabledRun:
        """Apply an action that a reason of a run advises, and identify what it changes.

        Raises:
            CampaignError: no reason advises the action, or it cannot be applied to this campaign.
        """
        from jointstiff.service.kinds.mending import advised, mended

        campaign: messages.Campaign = run.campaign.model_copy(update={"run": options_of(run)})
        with as_campaign_error(""):
            campaign = mended(campaign, advised(cast("Any", run.result).assessment, action))
        return cast("TabledRun", function_of("identify")(campaign))


def options_of(run: Run) -> CampaignRun:
    """Return the options of a run as a campaign file has them."""
    options = run.request.model_dump(exclude={"measurement_set_id", "variant_of"}, exclude_unset=True)
    return CampaignRun.model_validate(options)


def _exported(run: Job) -> ExportedModel:
    from jointstiff.service.reports.exports import ExportedModel

    here = Here()
    known = here.inputs.run(here.identified(run), "run_id")
    with as_campaign_error("run"):
        return ExportedModel.of(known.run, known.prepared.robot, cast("TabledRun", run).campaign.robot.name)


@lru_cache(maxsize=4)
def _prepared(robot: str) -> PreparedRobot:
    """Prepare a robot, once for the campaigns on it."""
    return prepare_robot(RobotDocument.model_validate_json(robot))


def read_job(path: Path) -> Job | None:
    """Return the job with a result that a file holds, as `--json` prints it; None if it holds none."""
    from jointstiff.service.kinds.registry import KINDS

    for kind in KINDS:
        try:
            job: Job = read_document(path, kind.message)
        except CampaignError:
            continue
        if kind.reported and job.result is not None:
            return results.of(job, Here())
    return None


def run_of(run: Run, campaign: messages.Campaign) -> TabledRun:
    """Return a run that knows its campaign, such as one that `identify --json` printed."""
    return cast("TabledRun", results.of(run, Here(campaign)))


def predict(
    run: TabledRun | AnyCampaign,
    postures: AnyPostures,
    /,
    forces: Numbers | None = None,
    **options: Unpack[PredictFields],
) -> Prediction:
    """Predict deflections and compliance in given postures, under given loads.

    Args:
        run: what `identify` returned, or a campaign, which is identified now.
        postures: CSV file of postures and loads, with units in the headers; load cases as in the API; or an
            array (N, n) of postures, as the controller shows them.
        forces: (N, 3) or (3,), axes of R0, with an array of postures.
        options: fields of `DeflectionOptions`; also `at`, the point in the flange frame where the force acts
            and whose deflection is predicted, and beside arrays `moments` (N, 3) or (3,). Arrays and their
            points are in m, deg and N unless `units` says otherwise, such as "mm, deg, N"; of files and
            cases SI units are the default.

    Raises:
        CampaignError: run, table or array cannot be used.
    """
    return Here().predict(run, postures, forces, **options)


def import_files(
    *files: str | PathLike[str],
    robot: Any = None,  # noqa: ANN401 - as of a campaign
    **options: Unpack[ImportFields],
) -> ImportAnswer:
    """Understand files of readings, as `jointstiff import` does.

    Args:
        files: tables, lists of points, and a table of masses, text or Excel.
        robot: that was measured, as in a campaign, or its file: then the answer has the findings, and
            unloaded positions of a robot with masses make a set for its own weight.
        options: fields of `ImportRequest`, such as `columns={"A1": "J1 [deg]"}`.

    Returns:
        The preview, and the measurement set, or the unloaded poses, that the files make.

    Raises:
        CampaignError: a file or an option was not understood.
    """
    from jointstiff.schemas.imports import ImportRequest
    from jointstiff.service.importing.reading import SourceFile
    from jointstiff.service.problems.errors import FilesError
    from jointstiff.service.resources import imports

    request = parse_document(options, ImportRequest)
    sources = [SourceFile(Path(file).name, Path(file).read_bytes()) for file in files]
    measured = None
    if robot is not None:
        if isinstance(robot, str | PathLike):
            robot = read_robot(str(robot))
        elif not isinstance(robot, RobotDocument):
            robot = parse_document(robot, RobotDocument)
        with as_campaign_error("robot"):
            measured = prepare_robot(robot).robot
    try:
        return imports.import_files(sources, request, measured)
    except FilesError as error:
        raise CampaignError(problem_of(error)) from error
