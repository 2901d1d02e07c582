"""Client of the service, for notebooks and the command line."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Callable, Iterator, Mapping
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar, Unpack, cast
from urllib.parse import quote
from uuid import uuid4

import httpx2

from jointstiff.schemas.fields import Message, Page, content_key
from jointstiff.schemas.finding import Problem
from jointstiff.schemas.job import Job, JobSummary
from jointstiff.schemas.live import MeasurementSet
from jointstiff.schemas.measurement import MeasurementSetDocument, MeasurementSetSummary
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.robot import Robot, RobotDocument, RobotSummary
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service.kinds.kind import AnyJob, File, Kind
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.kinds.rooms import import_kind
from jointstiff.service.kinds.verb import Cancel, JobMonitor, OnProgress, import_verb, merge_options
from jointstiff.service.library import results
from jointstiff.service.library.answers import foreign_answer_error, parse_problem, parse_resource
from jointstiff.service.library.campaigns import Campaign, extract_run_options
from jointstiff.service.library.cases import AnyPostures, make_load_cases
from jointstiff.service.library.results import Prediction, RobotTrend, TabledRun, make_presented_class
from jointstiff.service.library.robots import read_joint_kinds
from jointstiff.service.library.verbs import Verbs
from jointstiff.service.problems import (
    AwayError,
    CampaignError,
    RefusedError,
    as_campaign_error,
    http_problem,
)
from jointstiff.service.resources.documents import (
    AnyCampaign,
    parse_document,
    read_campaign,
    to_json_text,
)
from jointstiff.service.tables.table import Sheet
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from jointstiff.schemas.comparison import Comparison
    from jointstiff.schemas.correction import CorrectionJob
    from jointstiff.schemas.deflection import Map
    from jointstiff.schemas.geometry import Geometry
    from jointstiff.schemas.joints import JointKind
    from jointstiff.schemas.plan import Plan
    from jointstiff.service.kinds.run.verb import IdentifyFields
    from jointstiff.service.library.campaigns import Numbers
    from jointstiff.service.library.cases import PredictFields
    from jointstiff.service.library.correction import Correction, CorrectionCall
    from jointstiff.service.library.measure import LiveMeasurement
    from jointstiff.service.library.reading import ImportedReadings
    from jointstiff.solver.mechanics.robot import Robot as RobotModel

PATIENCE_SECONDS: Final = 60.0
"""Time for which requests are repeated while a service that answered before does not answer [s]."""
_FIRST_PAUSE: Final = 0.2
_LONGEST_PAUSE: Final = 2.0
_POLL_SECONDS: Final = 0.2
_NOT_FOUND: Final = 404
_WAIT_QUERY: Final = MappingProxyType({"wait": "1"})

Document = Message | Mapping[str, Any]
Resource = TypeVar("Resource", bound=Message)
Summary = TypeVar("Summary", bound=Message)
Value = TypeVar("Value")


def to_json_object(document: Document) -> dict[str, Any]:
    """Return a document as a dictionary for JSON; of a message only the fields that were set."""
    if isinstance(document, Message):
        return document.model_dump(mode="json", exclude_unset=True)
    return dict(document)


class Client(Verbs):
    """Client of a service, with the resources of each kind, such as `client.runs.get(id)`.

    Its methods for work are those of `import jointstiff`, such as `client.identify("campaign.json")`. In
    place of a campaign they also accept a run or a robot of the service.

    If a service answered before and does not answer now, the service is probably restarting: requests are
    repeated until it answers. Each post carries a key that makes the post safe to repeat. Every method raises
    `RefusedError` if the service refuses or does not answer. As a context manager, the client closes its
    connections.
    """

    # The constructor sets these collections, one for each kind of work; the annotations are for editors.
    runs: Jobs[TabledRun]
    comparisons: Jobs[Comparison]
    geometries: Jobs[Geometry]
    plans: Jobs[Plan]
    maps: Jobs[Map]
    corrections: Jobs[CorrectionJob]

    def __init__(
        self,
        url: str,
        key: str | None = None,
        *,
        warn: Callable[[str], object] | None = None,
        transport: httpx2.BaseTransport | None = None,
        patience: float = PATIENCE_SECONDS,
    ) -> None:
        """Make a client.

        Args:
            url: address of the service, such as http://127.0.0.1:8000.
            key: key that the service, or a proxy in front of it, demands; default: the environment variable
                JOINTSTIFF_KEY, if it is set.
            warn: function called with a message when the service does not answer and requests are repeated.
            transport: carries the requests in place of the network.
            patience: seconds for which requests are repeated while a service that answered before does not.

        Raises:
            RefusedError: the address or the key is not valid.
        """
        if re.search(r"/v\d+/?$", url):
            remedy = "write the address without the version, such as http://127.0.0.1:8000"
            raise RefusedError(
                http_problem(422, f"'{url}' is an address of the API, not of a service", remedy)
            )
        if not url.startswith(("http://", "https://")):
            remedy = "write the address with http:// before it, such as http://127.0.0.1:8000"
            raise RefusedError(http_problem(422, f"'{url}' is not the address of a service", remedy))
        key = (os.environ.get("JOINTSTIFF_KEY", "") if key is None else key).strip()
        if not (key.isascii() and key.isprintable()):  # HTTP's own complaint would show the key
            raise RefusedError(
                http_problem(
                    401,
                    "the key contains characters that are not allowed in a key",
                    "copy the whole key again",
                )
            )
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        try:
            self._http = httpx2.Client(base_url=url, headers=headers, timeout=60.0, transport=transport)
        except httpx2.InvalidURL as error:
            raise RefusedError(_no_answer_problem(url, error)) from error
        self._warn, self._patience = warn, patience
        self._answered = False
        self.robots = Collection(self, "robots", Robot, RobotSummary)
        self.measurement_sets = Collection(self, "measurement-sets", MeasurementSet, MeasurementSetSummary)
        for kind in KINDS:
            setattr(self, kind.collection, Jobs(self, kind))

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def ping(self) -> None:
        """Check that the service answers; later requests are then repeated while there is no answer."""
        self.send("GET", "/health")

    def predict(
        self,
        run: Any,  # noqa: ANN401 - a run, or a campaign
        postures: AnyPostures,
        /,
        forces: Numbers | None = None,
        **options: Unpack[PredictFields],
    ) -> Prediction:
        """Predict deflections with the model of a run or a campaign; arguments as of `jointstiff.predict`."""
        run_id = self.prepare_run(run)
        joints = {name: joint.kind for name, joint in self.runs.get(run_id).joints.items()}
        with as_campaign_error("prediction"):
            request = to_json_object(make_load_cases(postures, joints, forces, options)) | {"run_id": run_id}
        return parse_resource(self.send("POST", "/v1/deflections", None, request), Prediction)

    def correct_poses(
        self,
        source: Any,  # noqa: ANN401 - a run, a campaign, or a robot
        poses: Any,  # noqa: ANN401 - an array, or a file
        joints: Any,  # noqa: ANN401 - an array
        stated: Mapping[str, Any],
        monitor: JobMonitor,
    ) -> Correction:
        """Correct poses in the service; options by name as of `correct`. Over 5,000 poses are a job.

        Raises:
            RefusedError: the service refuses the request, or does not answer.
            CampaignError: an argument cannot be used, or the caller has cancelled the correction.
        """
        from jointstiff.schemas.correction import MAX_ROWS, CorrectionResult
        from jointstiff.service.library.correction import prepare_call
        from jointstiff.service.library.robots import prepare_once
        from jointstiff.service.resources.documents import read_plan_source

        described = source if isinstance(source, RobotDocument) else read_plan_source(source)
        if isinstance(described, RobotDocument):
            document: RobotDocument = described
            request: dict[str, Any] = {"robot_id": self.prepare_robot(described)}
        else:
            run = self.runs.get(self.prepare_run(described))
            document, request = run.campaign.robot, {"run_id": run.id}
        with as_campaign_error("robot"):
            robot = prepare_once(document).robot
        call = prepare_call(robot, poses, joints, stated)
        request |= to_json_object(call.options)
        if len(call) > MAX_ROWS:
            job = self.corrections.create(request, files={"poses.csv": call.make_file(robot)})
            return self._read_correction(call, robot, self.corrections.wait(job, monitor))
        request["columns"] = {name: column.tolist() for name, column in call.columns.items()}
        answer = self.send("POST", "/v1/corrections", None, request)
        return call.read_answer(robot, parse_resource(answer, CorrectionResult))

    def _read_correction(self, call: CorrectionCall, robot: RobotModel, job: CorrectionJob) -> Correction:
        """Return the arrays of an ended job.

        Raises:
            RefusedError: the job has failed.
            CampaignError: the job was cancelled.
        """
        from jointstiff.schemas.correction import CorrectionResult
        from jointstiff.service.library.correction import CANCELLED, name_columns

        if job.error is not None:
            raise RefusedError(job.error)
        if job.result is None:
            raise CampaignError(CANCELLED)
        rows = self.sheet(job, import_kind(job.kind).files[0])
        counts = job.result.model_dump(exclude={"columns", "table"})
        return call.read_answer(robot, CorrectionResult(**counts, columns=name_columns(rows)))

    def read(self, *files: Any, **stated: Any) -> ImportedReadings:  # noqa: ANN401 - as of jointstiff.read
        """Read tables of readings in this process; arguments and result as of `jointstiff.read`."""
        from jointstiff.service.library.reading import read

        return read(*files, **stated)

    def measure(
        self,
        robot: Any,  # noqa: ANN401 - as of jointstiff.measure
        /,
        goal: Any,  # noqa: ANN401 - as of jointstiff.measure
        source: Any = None,  # noqa: ANN401 - as of jointstiff.measure
        **options: Any,  # noqa: ANN401 - of jointstiff.measure
    ) -> LiveMeasurement:
        """Begin a live measurement that this service stores; arguments as of `jointstiff.measure`."""
        from jointstiff.service.library.measure import measure

        return measure(robot, goal, source, client=self, **options)

    def identify(
        self,
        campaign: AnyCampaign | Run,
        /,
        options: RunOptions | None = None,
        *,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        executor: Executor | None = None,
        **fields: Unpack[IdentifyFields],
    ) -> TabledRun:
        """Post a campaign; return its run when the run has ended; arguments as of `jointstiff.identify`.

        Raises:
            TypeError: an executor is given: the service has its own workers.
        """
        if isinstance(campaign, Run):
            # The service has the readings of a stored run: only the options are posted.
            identify_again: Callable[..., TabledRun] = import_verb("run")
            return identify_again(
                self, campaign, options, on_progress=on_progress, cancel=cancel, executor=executor, **fields
            )
        with JobMonitor(on_progress, cancel, executor) as monitor:
            self.start_call(monitor)  # refuses an executor
            document = read_campaign(campaign)
            run_options = to_json_object(document.run if options is None else options)
            run_options = {
                "leave_out": document.run.leave_out,
                **run_options,
                **merge_options(RunOptions, None, fields),
            }
            return self.runs.wait(self.post(to_json_object(document) | {"run": run_options}), monitor)

    def trend(self, robot: Robot | RobotSummary | str, **filters: str | bool) -> RobotTrend:
        """Return the trend of a stored robot's joints over its campaigns.

        Args:
            robot: stored robot, its summary, or its id.
            filters: filters of the API, such as `serial_number`; default: the values of the latest campaign.
                `same_load=True` if the load of all campaigns hung at the same point of the flange,
                `same_cell=True` if the same cell or weights gave the forces.
        """
        identifier = robot if isinstance(robot, str) else robot.id
        answer = self.send("GET", f"/v1/robots/{quote(identifier, safe='')}/trend", filters)
        return parse_resource(answer, RobotTrend)

    def post(self, campaign: AnyCampaign, *, once: bool = False) -> TabledRun:
        """Post a campaign; return its run after at most one second, finished or not.

        Robot and readings whose content is stored already are not stored again.

        Args:
            campaign: a file, a document that was read from JSON, or a `Campaign`.
            once: true to return the run of an earlier post of the same campaign instead of a new run.
        """
        document = to_json_object(campaign if isinstance(campaign, Mapping) else read_campaign(campaign))
        # Sorted keys: the same content gives the same text, and so the same idempotency key.
        text = json.dumps(json.loads(to_json_text(document)), sort_keys=True)
        key = content_key(text) if once else None
        return self.runs.parse_answer(self.send("POST", "/v1/campaigns", _WAIT_QUERY, text, key))

    @property
    def unpickler(self) -> Callable[[str], Any]:
        """Function that makes a job from the text to which it was pickled."""
        from jointstiff.service.library.here import restore_job_text

        return restore_job_text

    def start_call(self, monitor: JobMonitor) -> Client:
        """Check the monitor of a call that does work, such as `identify`; return this client.

        Raises:
            TypeError: an executor is given: the service has its own workers.
        """
        if monitor.executor is not None:
            raise TypeError(
                "a service computes with its own workers: give `executor` to the functions of `jointstiff`, "
                "or start more workers with `jointstiff worker`"
            )
        return self

    def prepare_set(self, source: Any, place: str = "") -> tuple[str, RunOptions | None]:  # noqa: ANN401, ARG002
        """Return (id of the measurement set, options of the run) of a run or a campaign.

        Args:
            source: run of this service, or a campaign, which is posted first unless it was posted before.
            place: not used: the service names places in its errors.
        """
        source = self._replace_foreign_run(source)
        if isinstance(source, Run):
            return source.request.measurement_set_id, extract_run_options(source)
        campaign = read_campaign(source)
        return self.post(campaign, once=True).request.measurement_set_id, campaign.run

    def prepare_run(self, source: Any, executor: Executor | None = None) -> str:  # noqa: ANN401, ARG002
        """Return the id of a run in the service; a campaign is posted and identified first.

        `source` is a run or a campaign; `executor` is ignored, because the service has its own workers.
        """
        source = self._replace_foreign_run(source)
        run: Run = source if isinstance(source, Run) else self.identify(source)
        return run.id

    def _replace_foreign_run(self, source: Any) -> Any:  # noqa: ANN401 - a run, or a campaign
        """Return the campaign of a run that another service, process or file has; return any other `source`.

        The campaign gets the options of the run.
        """
        if isinstance(source, str | PathLike):
            from jointstiff.service.library.here import use_saved

            source = use_saved(source)
        if not isinstance(source, TabledRun) or source.was_done_by(self):
            return source
        return source.campaign.model_copy(update={"run": extract_run_options(source)})

    def find_run_for_tables(self, _job: Job) -> None:
        """Return None, as no run is needed: `read_contents` gets the tables from the service."""

    def read_contents(self, job: Job) -> tuple[Mapping[str, Sheet], Mapping[str, bytes]]:
        """Return (tables, corrected files), each by name, that the answers of the service leave out."""
        kind = import_kind(job.kind)
        if job.result is None or not any(file.suffix == "json" for file in kind.files):
            return {}, {}
        tables = {file.name: self.sheet(job, file) for file in kind.files if file.suffix == "csv"}
        files = self.corrections.files(cast("Any", job)) if job.kind == "correction" else {}
        return tables, files

    def read_campaign(self, job: Run | Plan) -> Campaign | None:
        """Return the campaign of a run, or the campaign that a plan continues.

        Robot and readings come from the service; the options are those of the run. The result is None if a
        plan begins a campaign, or if the campaign that a plan continues was deleted.

        Raises:
            RefusedError: the service refuses, does not answer, or has deleted the campaign of a run.
        """
        if job.request.measurement_set_id is None:
            return None
        try:
            stored = self.measurement_sets.get(job.request.measurement_set_id)
        except RefusedError as refused:
            if isinstance(job, Run) or refused.problem.status != _NOT_FOUND:
                raise
            return None
        robot = self.robots.get(stored.robot_id)
        # The service's messages have more fields, such as an id, than the documents of a campaign file.
        stored_and_document = ((robot, RobotDocument), (stored, MeasurementSetDocument))
        robot_fields, set_fields = (
            {name: getattr(each, name) for name in document.model_fields if name in each.model_fields_set}
            for each, document in stored_and_document
        )
        options = extract_run_options(job) if isinstance(job, Run) else RunOptions()
        return Campaign.model_validate({"robot": robot_fields, "measurement_set": set_fields, "run": options})

    def run(
        self,
        request: RunRequest,
        monitor: JobMonitor,
        dispensable: bool,
    ) -> Run | None:
        """Post a request of a run unless it was posted before; return the run when it has ended.

        Args:
            request: request of the run.
            monitor: object that receives progress, and can cancel.
            dispensable: whether the caller can continue without this run: if the readings do not support its
                method, None is returned then.
        """
        text = request.model_dump_json()
        try:
            return self.runs.wait(self.runs.create(text, key=content_key(text)), monitor)
        except RefusedError as refused:
            if dispensable and refused.problem.type.endswith(":unsupported-method"):
                return None
            raise

    def prepare_robot(self, robot: RobotDocument | Mapping[str, Any]) -> str:
        """Return the id of a robot in the service; post the robot if the service has not stored it."""
        if isinstance(robot, Robot):
            return robot.id
        text = parse_document(to_json_object(robot), RobotDocument).model_dump_json()
        return self.robots.create(text, key=content_key(text)).id

    def joint_kinds(self, source: Any) -> Mapping[str, JointKind]:  # noqa: ANN401 - a robot, or a source
        """Return the kinds of the joints by name, in order, of a robot or of a prepared source."""
        source = self._replace_foreign_run(source)
        if isinstance(source, Run):
            source = self.read_campaign(source)
        return read_joint_kinds(source if isinstance(source, RobotDocument) else read_campaign(source).robot)

    def carry_out_request(
        self,
        kind: Kind[AnyJob, Any],
        request: dict[str, Any],
        files: Mapping[str, bytes],
        monitor: JobMonitor,
    ) -> AnyJob:
        """Post a request of a kind of work; return the job when it has ended.

        Args:
            kind: kind of the work.
            request: fields of the request.
            files: contents of the files of the request, by name.
            monitor: object that receives progress, and can cancel.
        """
        jobs: Jobs[AnyJob] = getattr(self, kind.collection)
        return jobs.wait(jobs.create(request, files=files), monitor)

    def sheet(self, job: Job, file: File) -> Sheet:
        """Return a table of a job, given by the file to which the table is written.

        The numbers are downloaded if the job does not contain them.
        """
        kind = import_kind(job.kind)
        # Only kinds with large tables have JSON files with all numbers, which the job does not contain.
        json_files = [column for column in kind.files if column.suffix == "json"]
        files_of_table = [column for column in json_files if Path(column.name).stem == Path(file.name).stem]
        json_file = next(iter([*files_of_table, *json_files]), None)
        if json_file is None:
            from jointstiff.service.reports.job import build_job_sheet

            return build_job_sheet(file, job, lambda: cast("Any", None))
        columns = json.loads(self.file(job, json_file.name))["columns"]
        headers = [
            f"{column['name']} [{column['unit']}]" if column["unit"] else column["name"] for column in columns
        ]
        sheet = dict(zip(headers, [column["values"] for column in columns], strict=True))
        text_columns = frozenset(
            name for name, values in sheet.items() if any(isinstance(value, str) for value in values)
        )
        return Sheet(sheet, text_columns)

    def file(
        self, job: Job, name: str, query: Mapping[str, str] | None = None, laboratory: Path | None = None
    ) -> bytes:
        """Download a file of a job, such as `model.mjcf`, `report.pdf` or `map.npz`; return its content.

        `query` has the query parameters of the API, such as `accept_verdict`.

        Raises:
            RequestError: `laboratory` is given, but a service uses the file of its own laboratory.
        """
        if laboratory is not None:
            remedy = (
                "omit `laboratory`; `jointstiff serve --laboratory FILE` gives the service its laboratory"
            )
            raise RequestError(
                "a service writes reports only for its own laboratory", where="laboratory", remedy=remedy
            )
        address = f"/v1/jobs/{quote(job.id, safe='')}/files/{quote(name, safe='')}"
        content: bytes = self.send("GET", address, query).content
        return content

    def apply(self, run: TabledRun, action: str, payload: float | None = None) -> TabledRun:
        """Apply an action that the run's assessment recommends; return the new run when it has ended."""
        from jointstiff.service.runs.mending import find_advised_action

        with as_campaign_error(""):
            recommended = find_advised_action(cast("Any", run.result).assessment, action, payload)
        address = f"/v1/runs/{quote(run.id, safe='')}/apply"
        return self.runs.wait(self.runs.parse_answer(self.send("POST", address, _WAIT_QUERY, recommended)))

    def send(
        self,
        verb: str,
        path: str,
        query: Mapping[str, str | bool] | None = None,
        document: Document | str | None = None,
        key: str | None = None,
        files: Mapping[str, bytes] | None = None,
    ) -> httpx2.Response:
        """Send a request and return the answer; repeat the request while the service does not answer.

        A document, or its JSON text, is sent with the idempotency key, by default a random one. With files,
        the document is sent as the field `options` of a form. A request is repeated only if the service has
        answered before.

        Raises:
            RefusedError: the service refuses, never answered, or did not answer for `patience` seconds.
        """
        request: dict[str, Any] = {"params": query}
        if document is not None:
            content = document if isinstance(document, str) else to_json_text(to_json_object(document))
            request["headers"] = {"Idempotency-Key": key or uuid4().hex}
            if files:
                request |= {
                    "files": [("files", file) for file in files.items()],
                    "data": {"options": content},
                }
            else:
                request["headers"]["Content-Type"] = "application/json"
                request["content"] = content
        end, pause = time.monotonic() + self._patience, _FIRST_PAUSE
        while True:
            try:
                return self._send_once(verb, path, request)
            except AwayError as error:
                if not self._answered or time.monotonic() + pause >= end:
                    raise
                if pause == _FIRST_PAUSE and self._warn is not None:
                    self._warn(f"{error.problem.detail}; trying again for {self._patience:.0f} s")
            time.sleep(pause)
            pause = min(2.0 * pause, _LONGEST_PAUSE)

    def _send_once(self, verb: str, path: str, request: dict[str, Any]) -> httpx2.Response:
        """Send a request once; return the answer. `request` has arguments of `httpx2.Client.request`.

        Raises:
            AwayError: the service does not answer, or answers that it is not available (503).
            RefusedError: the service refuses, or the answer cannot be decoded.
        """
        try:
            response = self._http.request(verb, path, **request)
        except httpx2.DecodingError as error:
            raise foreign_answer_error("the answer cannot be decoded") from error
        except httpx2.InvalidURL as error:
            raise RefusedError(_no_answer_problem(self._http.base_url, error)) from error
        except httpx2.TransportError as error:
            raise AwayError(_no_answer_problem(self._http.base_url, error)) from error
        self._answered = True
        if not response.is_success:
            is_away = response.status_code == httpx2.codes.SERVICE_UNAVAILABLE
            raise (AwayError if is_away else RefusedError)(parse_problem(response))
        return response


class Collection(Generic[Resource, Summary]):
    """Resources of one kind in a service."""

    def __init__(self, client: Client, name: str, kind: type[Resource], summary: type[Summary]) -> None:
        """Begin with a client, the name of the collection in addresses, and the messages of its answers."""
        self._client, self._path, self._kind, self._summary = client, f"/v1/{name}", kind, summary
        self._listed = self._path

    def create(
        self, document: Document | str, *, key: str | None = None, files: Mapping[str, bytes] | None = None
    ) -> Resource:
        """Post a document; return the resource that the service created.

        Args:
            document: document in the form that the API accepts, or its JSON text.
            key: idempotency key; None for a random key.
            files: contents of files by name, for kinds of work that have files.
        """
        return self.parse_answer(self._client.send("POST", self._path, None, document, key, files))

    def get(self, identifier: str) -> Resource:
        """Return the resource with an id."""
        return self.parse_answer(self._client.send("GET", self._address(identifier)))

    def list(self, **filters: str) -> Iterator[Summary]:
        """Yield summaries of the resources, newest first; `filters` are query parameters of the API."""
        query: dict[str, str] | None = filters
        while query is not None:
            answer = self._client.send("GET", self._listed, query)
            page = parse_resource(answer, Page[self._summary])  # type: ignore[name-defined]
            yield from page.items
            query = None if page.next is None else filters | {"cursor": page.next}

    def change(self, identifier: str, changes: Document) -> None:
        """Change the name or the metadata of a robot or a measurement set."""
        self._client.send("PATCH", self._address(identifier), None, changes)

    def delete(self, identifier: str) -> None:
        """Delete a resource, which can be restored for 30 days."""
        self._client.send("PATCH", self._address(identifier), None, {"deleted": True})

    def restore(self, identifier: str) -> None:
        """Restore a deleted resource."""
        self._client.send("PATCH", self._address(identifier), None, {"deleted": False})

    def _address(self, identifier: str) -> str:
        """Return the path of the API for the resource with an id."""
        return f"{self._listed}/{quote(identifier, safe='')}"

    def parse_answer(self, answer: httpx2.Response) -> Resource:
        """Return the resource that an answer of the service contains."""
        return parse_resource(answer, self._kind)


class Jobs(Collection[AnyJob, JobSummary]):
    """Jobs of one kind in a service, which also makes their reports, exports and changed runs."""

    def __init__(self, client: Client, kind: Kind[AnyJob, Any]) -> None:
        """Begin with a client and a kind of work."""
        super().__init__(client, kind.collection, make_presented_class(kind), JobSummary)
        self._listed = "/v1/jobs"  # the service lists jobs of all kinds together
        self._name = kind.name

    def create(
        self, document: Document | str, *, key: str | None = None, files: Mapping[str, bytes] | None = None
    ) -> AnyJob:
        """Post a request; return the job after one second at most; arguments as of `Collection.create`."""
        return self.parse_answer(self._client.send("POST", self._path, _WAIT_QUERY, document, key, files))

    def carry_out_request(
        self, document: Document, on_progress: OnProgress | None = None, cancel: Cancel | None = None
    ) -> AnyJob:
        """Post a request; return the job when it has ended."""
        with JobMonitor(on_progress, cancel) as monitor:
            return self.wait(self.create(document), monitor)

    def wait(self, job: AnyJob, follow: OnProgress | None = None) -> AnyJob:
        """Wait for the end of a job; return the ended job. Ctrl-C cancels the job.

        Args:
            job: job of the service.
            follow: function that is called with the progress of the job; a `JobMonitor` can also cancel the
                job.
        """
        try:
            while job.state in {"queued", "running"}:
                if follow is not None and job.progress is not None:
                    follow(job.progress)
                if isinstance(follow, JobMonitor) and follow.cancelled:
                    self.cancel(job.id)
                time.sleep(_POLL_SECONDS)
                job = self.get(job.id)
        except KeyboardInterrupt:
            self.cancel(job.id)
            raise
        return job

    def cancel(self, identifier: str) -> None:
        """Cancel a job; a job that has ended does not change."""
        self._client.send("PATCH", self._address(identifier), None, {"cancelled": True})

    def files(self, job: CorrectionJob) -> dict[str, bytes]:
        """Return the content of each corrected file of a program, by the name of the file."""
        program = None if job.result is None else job.result.program
        names = [] if program is None else [file.name for file in program.files]
        return {name: self._client.file(job, "program", {"file": name}) for name in names}

    def list(self, **filters: str) -> Iterator[JobSummary]:
        """Yield summaries of the jobs of this kind, newest first; `filters` are parameters of the API."""
        return super().list(**filters, kind=self._name)

    def parse_answer(self, answer: httpx2.Response) -> AnyJob:
        """Parse the job in an answer, and attach the client for its reports and exports.

        Raises:
            RefusedError: the answer has no job, or a job of another kind.
        """
        name = parse_resource(answer, _KindOfJob).kind
        if name != self._name:
            reason = f"the job is a {name}, not a {self._name}"
            raise RefusedError(
                http_problem(404, reason, f"get the job from the client's collection for the kind {name}")
            )
        return results.attach_origin(super().parse_answer(answer), self._client)


class _KindOfJob(Message, extra="ignore"):
    """Job of any kind; only the name of its kind is read."""

    kind: str


def _no_answer_problem(address: object, error: Exception) -> Problem:
    """Return the problem (status 503) for an address at which no service answers."""
    remedy = "start the service with `jointstiff serve`, or give the address of a running service"
    if "WRONG_VERSION_NUMBER" in str(error):
        remedy = "the service has no encryption of its own: write the address with http://, not https://"
    return http_problem(503, f"no answer from {address}: {error}", remedy)
