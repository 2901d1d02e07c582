"""Work in this process: inputs are prepared from files and messages, and jobs are computed at once."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, Unpack, cast

from jointstiff.schemas import run as messages
from jointstiff.schemas.job import Job
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.plan import Plan
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service.kinds.kind import AnyJob, AnyKind, File, Kind
from jointstiff.service.kinds.rooms import import_kind
from jointstiff.service.kinds.verb import JobMonitor
from jointstiff.service.kinds.work import carry_out, make_failed_job, new_job
from jointstiff.service.library import results
from jointstiff.service.library.campaigns import add_campaign, extract_run_options
from jointstiff.service.library.cases import AnyPostures, make_load_cases
from jointstiff.service.library.restoring import parse_job
from jointstiff.service.library.results import Prediction, TabledRun, make_presented_class
from jointstiff.service.library.robots import prepare_once, read_joint_kinds
from jointstiff.service.library.verbs import Verbs
from jointstiff.service.problems import CampaignError, as_campaign_error
from jointstiff.service.process import one_thread
from jointstiff.service.reports.job import build_job_sheet
from jointstiff.service.resources.documents import (
    AnyCampaign,
    parse_document,
    read_campaign,
)
from jointstiff.service.resources.inputs import InMemoryInputs
from jointstiff.service.tables.files import write_sheet
from jointstiff.service.tables.table import Sheet
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from jointstiff.schemas.joints import JointKind
    from jointstiff.service.library.campaigns import Numbers
    from jointstiff.service.library.cases import PredictFields
    from jointstiff.service.library.correction import Correction
    from jointstiff.service.reports.exports import ExportedModel


class Here(Verbs):
    """Work in this process: prepares inputs from files and messages, and computes jobs at once."""

    def __init__(self, campaign: messages.Campaign | None = None) -> None:
        """Begin without prepared inputs; `campaign` is that of a run from a file, else None."""
        self.inputs, self.campaign = InMemoryInputs(), campaign
        self.source: TabledRun | None = None  # run with whose model this object has worked
        self.tables: Mapping[str, Sheet] = {}  # of a service's job that was read from a file, by name
        self.files: Mapping[str, bytes] = {}  # corrected files of such a program, by name

    @property
    def unpickler(self) -> Callable[[str], Any]:
        """Function that makes a job from the text to which it was pickled."""
        return restore_job_text

    def start_call(self, monitor: JobMonitor) -> Here:  # noqa: ARG002 - any executor can be used
        """Return a new object for one call, so that its inputs are freed with the result of the call."""
        return Here()

    def prepare_set(self, source: Any, place: str = "") -> tuple[str, RunOptions]:  # noqa: ANN401 - campaign or run
        """Prepare a campaign, or the campaign of a run; return the id of its set, and the options of the run.

        `place` is put before the places in errors, such as `campaigns[3].`.

        Raises:
            CampaignError: robot or readings cannot be used.
        """
        source = use_saved(source)
        if isinstance(source, TabledRun):
            return self.prepare_set(source.campaign)[0], extract_run_options(source)
        self.campaign = campaign = read_campaign(source)
        return add_campaign(self.inputs, campaign, place), campaign.run

    def prepare_run(self, source: Any, executor: Executor | None = None) -> str:  # noqa: ANN401 - run or campaign
        """Prepare a run as an input of further work; return its id. A campaign is identified first.

        Raises:
            CampaignError: the run has failed, or was not made from its campaign by this version.
        """
        source = use_saved(source)
        run: TabledRun = source if isinstance(source, TabledRun) else self.identify(source, executor=executor)
        if run.error is not None:
            raise CampaignError(run.error)
        set_id, _ = self.prepare_set(run.campaign)
        with as_campaign_error("prediction"):
            labels = {each.label for each in run.campaign.measurement_set.observations}
            left_out = run.request.leave_out
            prepared = self.inputs.measured(set_id, "run_id", left_out) if set(left_out) < labels else None
            # A campaign file may have changed since the run: equal hashes show that the run was made from
            # this robot and these readings. A left-out label that the campaign lacks also shows a change.
            if prepared is None or run.provenance.input_hash != prepared.run_hash(run.request):
                raise RequestError(
                    f"the run '{run.id}' was made from another robot or from other readings",
                    where="run_id",
                    remedy="give a run that this version made from this campaign; or omit the run: the "
                    "campaign is then identified now",
                )
        self.source = run
        return self.inputs.add_run(run, set_id)

    def run(self, request: RunRequest, monitor: JobMonitor, dispensable: bool) -> Run:
        """Identify a prepared measurement set; return the run.

        `dispensable` is true if the caller can continue without this run: if the readings do not support its
        method, a failed run is returned.

        Raises:
            CampaignError: the request cannot be used, or the readings do not support an indispensable run.
        """
        try:
            run: Run = self.carry_out_request(
                import_kind("run"), request.model_dump(mode="json"), {}, monitor
            )
        except CampaignError as refused:
            if not dispensable or not refused.problem.type.endswith(":unsupported-method"):
                raise
            run = make_failed_job(Run, request, refused.problem)
        self.inputs.add_run(run, request.measurement_set_id)
        return run

    @one_thread()
    def prepare_robot(self, robot: RobotDocument) -> str:
        """Prepare a robot as an input of further work; return its id."""
        with as_campaign_error("robot"):
            return self.inputs.add_robot(prepare_once(robot))

    @one_thread()
    def joint_kinds(self, source: Any) -> Mapping[str, JointKind]:  # noqa: ANN401 - a robot, or a source
        """Return the kinds of the joints by name, in order, of a robot or of a prepared source."""
        document = source if isinstance(source, RobotDocument) else cast("Any", self.campaign).robot
        with as_campaign_error("robot"):
            return read_joint_kinds(document)

    @one_thread()
    def carry_out_request(
        self,
        kind: Kind[AnyJob, Any],
        request: dict[str, Any],
        files: Mapping[str, bytes],
        monitor: JobMonitor,
    ) -> AnyJob:
        """Carry out a request of a kind of work; return the job with its result.

        `files` has the contents of files by name; only programs have files.

        Raises:
            CampaignError: the request cannot be used.
        """
        if kind.is_form:
            from jointstiff.service.kinds.correction.files import compress_file

            stored = [compress_file(name, content).model_dump(mode="json") for name, content in files.items()]
            request = request | {"files": stored}
        message = parse_document(request, kind.request)
        # The places in errors begin with the name of the kind, unless they are places in a user's own file.
        with as_campaign_error("" if {"readings", "files"} & set(kind.sources) else kind.name):
            work = kind.prepare_work(self.inputs, message)
            queued = new_job(make_presented_class(kind), message, work)
            job: AnyJob = carry_out(queued, work, monitor, lambda: monitor.cancelled, monitor.executor)
        return results.attach_origin(job, self)

    @one_thread()
    def file(
        self, job: Job, name: str, query: Mapping[str, str] | None = None, laboratory: Path | None = None
    ) -> bytes:
        """Return the content of a file of a job, such as `report.pdf`, as a service would.

        `query` has query parameters of the API, such as `accept_verdict`; `laboratory` is the TOML file of
        the laboratory that issues the report.

        Raises:
            CampaignError: the file cannot be made, or the verdict on the run is `do_not_use`.
        """
        kind, suffix = import_kind(job.kind), name.rpartition(".")[2]
        if name.startswith("report."):
            return self._report(kind, job, suffix, laboratory)
        if name.startswith("model."):
            from jointstiff.service.reports.exports import export_model

            with as_campaign_error("export"):
                return export_model(
                    _make_exported_model(job), cast("Any", suffix), (query or {}).get("accept_verdict")
                )
        if name == "program":
            from jointstiff.service.kinds.correction.files import decompress_file

            file_name = (query or {}).get("file")
            if self.files:
                return self.files[file_name or next(iter(self.files))]
            written = cast("Any", job.result).program.files
            return next(decompress_file(each) for each in written if each.name == file_name)
        file = next(file for file in kind.files if file.name == name)
        return write_sheet(self.sheet(job, file), suffix)

    @one_thread()
    def sheet(self, job: Job, file: File) -> Sheet:
        """Return the table of a file of a job; compute it again if the result does not contain it."""
        kind = import_kind(job.kind)
        if self.tables:
            return next(
                sheet
                for name, sheet in self.tables.items()
                if name.startswith(f"{PurePath(file.name).stem}.")
            )
        if file.made_of == "work" and self.source is not None and not self.inputs.has_run(self.source.id):
            self.prepare_run(self.source)  # of a result that was read from a file
        return build_job_sheet(file, job, lambda: kind.prepare_work(self.inputs, job.request))

    def find_run_for_tables(self, job: Job) -> TabledRun | None:
        """Return the run that is needed to compute a job's tables; None if the result contains its tables."""
        # A file made of "work" is not stored: its table is computed from the run.
        needed = any(file.made_of == "work" for file in import_kind(job.kind).files)
        return self.source if needed else None

    def read_contents(self, _job: Job) -> tuple[Mapping[str, Sheet], Mapping[str, bytes]]:
        """Return tables and files of a service's job that was read from a file; empty for other jobs."""
        return self.tables, self.files

    def read_campaign(self, _job: Run | Plan) -> messages.Campaign | None:
        """Return the campaign of the run or plan that this object made; None if no campaign was prepared."""
        return self.campaign

    @one_thread()
    def predict(
        self,
        run: Any,  # noqa: ANN401 - a run, or a campaign
        postures: AnyPostures,
        /,
        forces: Numbers | None = None,
        **options: Unpack[PredictFields],
    ) -> Prediction:
        """Predict deflections from the model of a run or a campaign; arguments as of `jointstiff.predict`."""
        from jointstiff.service.runs.deflection import predict_by_run

        measured_run = self.inputs.run(self.prepare_run(run), "run_id")
        with as_campaign_error("prediction"):
            robot = measured_run.prepared.robot
            kinds = dict(zip(robot.joint_names, robot.joint_kinds, strict=True))
            request = make_load_cases(postures, kinds, forces, options)
            return Prediction.model_validate(dict(predict_by_run(robot, measured_run.run, request)))

    @one_thread()
    def correct_poses(
        self,
        source: Any,  # noqa: ANN401 - a run, a campaign, or a robot
        poses: Any,  # noqa: ANN401 - an array, or a file
        joints: Any,  # noqa: ANN401 - an array
        stated: Mapping[str, Any],
        monitor: JobMonitor,
    ) -> Correction:
        """Correct poses by the model of a run, or by the prior of a robot; `stated` has the options."""
        from jointstiff.service.library.correction import correct_here
        from jointstiff.service.resources.documents import read_plan_source

        described = source if isinstance(source, RobotDocument) else read_plan_source(source)
        if isinstance(described, RobotDocument):
            with as_campaign_error("robot"):
                robot = prepare_once(described).robot
            return correct_here(robot, poses, joints, stated, monitor)
        measured_run = self.inputs.run(self.prepare_run(described), "run_id")
        return correct_here(measured_run.prepared.robot, poses, joints, stated, monitor, measured_run.run)

    def _report(self, kind: AnyKind, job: Job, suffix: str, laboratory: Path | None) -> bytes:
        """Return the report of a job as PDF or HTML."""
        from jointstiff.service.reports.job import build_job_report
        from jointstiff.service.reports.laboratory import LaboratorySettings, read_laboratory
        from jointstiff.service.reports.rendering import render_html, render_pdf
        from jointstiff.service.reports.run import RunSubject, build_run_report

        settings = LaboratorySettings() if laboratory is None else read_laboratory(laboratory)
        if isinstance(job, TabledRun):
            subject = RunSubject(_make_exported_model(job), job.campaign.measurement_set, settings)
            document = build_run_report(subject)
        else:
            document = build_job_report(kind, job, job.model_dump_json(), settings)
        with as_campaign_error("report"):
            return render_pdf(document) if suffix == "pdf" else render_html(document)

    @one_thread()
    def apply(self, run: TabledRun, action: str, payload: float | None = None) -> TabledRun:
        """Apply an action that the run's assessment recommends; return the run of the changed campaign.

        Raises:
            CampaignError: the assessment does not recommend the action, or the action cannot be applied to
                this campaign.
        """
        from jointstiff.service.runs.mending import apply_action_to_campaign, find_advised_action

        campaign: messages.Campaign = run.campaign.model_copy(update={"run": extract_run_options(run)})
        with as_campaign_error(""):
            recommended = find_advised_action(cast("Any", run.result).assessment, action, payload)
            campaign = apply_action_to_campaign(campaign, recommended)
        return self.identify(campaign)


def restore_job(document: Mapping[str, Any]) -> Any:  # noqa: ANN401 - a job of any kind
    """Return the job of a saved document; tables, plots and further work are made in this process.

    Raises:
        CampaignError: the document is no job.
    """
    saved = parse_job(document)
    parts = saved.parts
    here = Here(parts.campaign or parts.continues)
    if parts.made_from is not None and parts.made_from.get("kind") == Run.kind_name():
        here.source = restore_job(parts.made_from)
    here.tables, here.files = parts.make_sheets(), parts.files
    return results.attach_origin(saved.job, here)


def restore_job_text(text: str) -> Any:  # noqa: ANN401 - a job of any kind
    """Return a job from the text to which it was pickled."""
    return restore_job(json.loads(text))


def use_saved(source: Any) -> Any:  # noqa: ANN401 - a source of a verb
    """Return the run in a saved file; return any other source of a verb unchanged."""
    if not isinstance(source, str | PathLike) or not Path(source).is_file():
        return source
    try:
        document = json.loads(Path(source).read_bytes())
    except (ValueError, RecursionError):
        return source  # the verb names what is wrong
    is_run = isinstance(document, dict) and document.get("kind") == Run.kind_name() and "campaign" in document
    return restore_job(document) if is_run else source


def _make_exported_model(run: Job) -> ExportedModel:
    """Make the model of a run, with its robot, that reports and model files contain."""
    from jointstiff.service.reports.exports import ExportedModel

    here = Here()
    # Prepare the measurement set of the run, then read the run; errors name the field `run_id`.
    measured_run = here.inputs.run(here.prepare_run(run), "run_id")
    with as_campaign_error("run"):
        return ExportedModel.from_run(
            measured_run.run, measured_run.prepared.robot, cast("TabledRun", run).campaign.robot.name
        )


def attach_campaign(run: Run, campaign: messages.Campaign) -> TabledRun:
    """Return a run, read from a file of `identify --json`, with a reference to its campaign."""
    return cast("TabledRun", results.attach_origin(run, Here(campaign)))


def predict(
    run: TabledRun | AnyCampaign,
    postures: AnyPostures,
    /,
    forces: Numbers | None = None,
    **options: Unpack[PredictFields],
) -> Prediction:
    """Predict deflections and compliance in given postures, under given loads.

    Args:
        run: run that `identify` returned, or a campaign, which is identified first.
        postures: CSV file of postures and loads, with units in the headers; load cases as in the API; or an
            array (N, n) of joint values, as the controller shows them.
        forces: (N, 3), or (3,) for all postures, axes of R0; only with an array of postures.
        options: fields of `DeflectionOptions`; also `at`, the point in the flange frame where the force acts
            and whose deflection is predicted, and with arrays `moments` (N, 3) or (3,). All numbers of the
            call, load cases as well, are in mm, deg, N and N.m unless `units` states others, such as
            "m, rad, kN, kN.m".

    Raises:
        CampaignError: run, table or array cannot be used.
    """
    return Here().predict(run, postures, forces, **options)
