"""Campaign files: one document with robot, readings and request, identified without a server."""

from __future__ import annotations

import json
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from pydantic import BaseModel, ConfigDict

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.job import Job, Progress
from jointstiff.schemas.problem import Problem
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run.run import Run, RunRequest
from jointstiff.service.conversion.parsing import MAX_SET_BYTES, NOT_JSON, MalformedError, parse
from jointstiff.service.conversion.prepared import PreparedRobot, prepare_robot
from jointstiff.service.importing.file_types import file_type
from jointstiff.service.inputs.files import FromFile
from jointstiff.service.inputs.inputs import Inputs
from jointstiff.service.kinds.kind import AnyRequest, Kind
from jointstiff.service.kinds.run import RUN
from jointstiff.service.kinds.work import carry_out, new_job
from jointstiff.service.library.errors import CampaignError
from jointstiff.service.library.results import shown, with_inputs
from jointstiff.service.problems.table import http_problem, invalid_request, problem_of
from jointstiff.solver.errors import JointstiffError, RequestError

if TYPE_CHECKING:
    from jointstiff.schemas.deflection import DeflectionResult

Document = TypeVar("Document", bound=BaseModel)
AnyJob = TypeVar("AnyJob", bound=Job)
OnProgress = Callable[[Progress], object]


def read_campaign(path: Path) -> Campaign:
    """Read a campaign file.

    Raises:
        CampaignError: the file is too large, or not such a document.
    """
    return read_document(path, Campaign)


def read_document(path: Path, message: type[Document], section: str | None = None) -> Document:
    """Read a file of JSON.

    Args:
        path: of the file.
        message: what it should have.
        section: of a larger document, which may be given in its place.

    Raises:
        CampaignError: the file is too large, or not such a document.
    """
    with path.open("rb") as file:  # which may be a pipe, of no size
        content = file.read(MAX_SET_BYTES + 1)
    if len(content) > MAX_SET_BYTES:
        raise too_large()
    return parse_content(message, content.removeprefix(BOM_UTF8), section)


def read_object(path: Path) -> dict[str, Any]:
    """Read a file with a JSON object; what it should hold is checked later.

    Raises:
        CampaignError: the file is too large, or no JSON object.
    """
    return read_document(path, AnyObject).model_dump(mode="json")


class AnyObject(BaseModel):
    """Any JSON object."""

    model_config = ConfigDict(extra="allow")


def parse_document(document: Mapping[str, Any], message: type[Document]) -> Document:
    """Validate a document that was read already.

    Raises:
        CampaignError: it is not such a document, or holds what is no JSON.
    """
    try:
        return parse_content(message, json.dumps(document).encode())
    except (TypeError, ValueError) as error:
        remedy = "use only strings, numbers, lists and dictionaries; convert arrays to lists"
        raise CampaignError(
            http_problem(422, f"the document cannot be written as JSON: {error}", remedy)
        ) from None


def parse_content(message: type[Document], content: bytes, section: str | None = None) -> Document:
    """Validate the content of a file of JSON.

    Raises:
        CampaignError: it is not such a document.
    """
    try:
        return parse(message, content, section)
    except MalformedError as error:
        raise CampaignError(
            _binary(content, error) or _other_file(message, error) or invalid_request(error.faults)
        ) from None


def _binary(content: bytes, error: MalformedError) -> Problem | None:
    """Return what a file that is no JSON is instead; None if its first bytes do not show it."""
    if error.keys is not NOT_JSON:
        return None
    utf16 = content.startswith((BOM_UTF16_LE, BOM_UTF16_BE))
    kind = "a text in UTF-16" if utf16 else file_type(content)
    remedy = "save it as UTF-8" if utf16 else "to read tables and point lists use `jointstiff import FILE`"
    return None if kind is None else http_problem(422, f"the file is {kind}, not a JSON document", remedy)


def _other_file(message: type[BaseModel], error: MalformedError) -> Problem | None:
    """Return what the file is instead, if it is of a kind that we know; None if it is not."""
    if error.keys is NOT_JSON:
        remedy = "correct the JSON there; to read tables and point lists use `jointstiff import FILE`"
        return http_problem(422, str(error.faults[0]["msg"]), remedy)
    for others, what, remedy in _KINDS:
        if others <= error.keys and not others <= set(message.model_fields):
            return http_problem(422, f"the file is {what}", remedy)
    return None


_KINDS: Final = (
    (
        {"observations"},
        "a measurement set without a robot",
        'make a campaign of it: {"robot": …, "measurement_set": …}, or use `jointstiff import --robot`',
    ),
    ({"sweeps"}, "a set of sweeps", "use `jointstiff geometry FILE`"),
    ({"robot", "measurement_set"}, "a campaign", "use `jointstiff identify FILE`"),
)


def predict(campaign: Campaign, table: str, run: Run | None = None, **options: object) -> DeflectionResult:
    """Predict deflections by the model of a campaign.

    Args:
        campaign: robot and readings.
        table: CSV of postures and loads, with units in the headers.
        run: of that campaign; identified now, as the campaign says, if None.
        options: fields of `DeflectionOptions`, in SI units or in its `units`.

    Raises:
        CampaignError: robot, readings, run or table cannot be used.
    """
    from jointstiff.service.kinds.deflection.tables import read_load_cases
    from jointstiff.service.kinds.deflection.work import predict_by_run

    inputs = FromFile()
    run_id = inputs.run(add_model(inputs, campaign, run), "run_id")
    with as_campaign_error("prediction"):
        cases = read_load_cases(table, run_id.prepared.robot.joint_names, **options)
        return predict_by_run(run_id.prepared.robot, run_id.run, cases)


def carried_out(
    kind: Kind[AnyJob, AnyRequest, Any],
    inputs: Inputs,
    request: AnyRequest,
    on_progress: OnProgress | None = None,
    section: str | None = None,
) -> AnyJob:
    """Carry out a job.

    Args:
        kind: its kind.
        inputs: what the request names.
        request: what is asked for.
        on_progress: called with the progress of a job that takes steps.
        section: of the file that is named in messages; the kind's name if None.

    Raises:
        CampaignError: the request cannot be used.
    """
    with as_campaign_error(kind.name if section is None else section):
        work = kind.compute(inputs, request)
        job: AnyJob = carry_out(new_job(shown(kind), request, work), work, on_progress)
    with_inputs(job, inputs)
    return job


def add_campaign(inputs: FromFile, campaign: Campaign, file: str = "") -> str:
    """Add robot and readings of a campaign to the inputs; return the id of the measurement set.

    Raises:
        CampaignError: robot or readings cannot be used.
    """
    with as_campaign_error(f"{file}robot"):
        robot = _robot(campaign.robot.model_dump_json())
    with as_campaign_error(f"{file}measurement_set"):
        return inputs.add_set(campaign.measurement_set, robot)


def add_model(inputs: FromFile, campaign: Campaign, run: Run | None) -> str:
    """Add a campaign and the run of it that predicts to the inputs; return the id of the run.

    Args:
        inputs: to add to.
        campaign: robot and readings.
        run: of that campaign; identified now, as the campaign says, if None.

    Raises:
        CampaignError: robot or readings cannot be used, the run has failed, or is of another campaign.
    """
    from jointstiff.service.kinds.run.work import run_hash

    set_id = add_campaign(inputs, campaign)
    if run is None:
        request = RunRequest(measurement_set_id=set_id, **campaign.run.model_dump())
        run = carried_out(RUN, inputs, request)
        if run.error is not None:
            raise CampaignError(run.error)
        return inputs.add_run(run, set_id)
    with as_campaign_error("prediction"):
        labels = {each.label for each in campaign.measurement_set.observations}
        options = run.request
        if not set(options.leave_out) < labels or run.provenance.input_hash != run_hash(
            inputs.measured(set_id, "run_id", options.leave_out), options
        ):
            raise RequestError(
                f"the run '{run.id}' is of another robot or of other readings",
                where="run_id",
                remedy="give a run of this campaign by this version, or omit it to identify the campaign now",
            )
    return inputs.add_run(run, set_id)


@lru_cache(maxsize=4)
def _robot(document: str) -> PreparedRobot:
    """Prepare a robot, once for the campaigns on it."""
    return prepare_robot(RobotDocument.model_validate_json(document))


@contextmanager
def as_campaign_error(section: str) -> Iterator[None]:
    """Turn errors of the input into one that says in which section of the file."""
    try:
        yield
    except JointstiffError as error:
        problem = problem_of(error)
        where = ".".join(part for part in (section, problem.where) if part)
        raise CampaignError(problem.model_copy(update={"where": where or None})) from error


def too_large() -> CampaignError:
    """Return the refusal of a file that no set may be as large as."""
    limit = f"{MAX_SET_BYTES // 1024**2} MiB"
    return CampaignError(http_problem(413, f"the file exceeds {limit}", "split it into several sets"))
