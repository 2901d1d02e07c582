"""Campaign files: one document with robot, readings and request, identified without a server."""

from __future__ import annotations

import json
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar
from uuid import uuid4

from pydantic import BaseModel

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.comparison import Comparison, ComparisonOptions, ComparisonRequest
from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import Job, Progress
from jointstiff.schemas.problem import Problem
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run.options import RunOptions
from jointstiff.schemas.run.run import Run, RunRequest
from jointstiff.service.conversion.parsing import MAX_SET_BYTES, NOT_JSON, MalformedError, parse
from jointstiff.service.conversion.prepared import PreparedRobot, PreparedSet, prepare_robot, prepare_set
from jointstiff.service.importing.file_types import file_type
from jointstiff.service.kinds.execution import carry_out, new_job
from jointstiff.service.kinds.run.work import run_work
from jointstiff.service.kinds.work import Work
from jointstiff.service.library.errors import CampaignError
from jointstiff.service.problems.table import http_problem, invalid_request, problem_of
from jointstiff.solver.errors import InputError, JointstiffError, RequestError

if TYPE_CHECKING:
    from jointstiff.schemas.deflection import DeflectionResult
    from jointstiff.schemas.geometry.message import Geometry, GeometryRequest
    from jointstiff.schemas.pair import Pair, PairOptions

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
        limit = f"{MAX_SET_BYTES // 1024**2} MiB"
        raise CampaignError(http_problem(413, f"the file exceeds {limit}", "split it into several sets"))
    return parse_content(message, content.removeprefix(BOM_UTF8), section)


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


def identify(campaign: Campaign, options: RunOptions, on_progress: OnProgress | None = None) -> Run:
    """Carry out one run.

    Args:
        campaign: robot and readings.
        options: how to identify.
        on_progress: called with the progress of a run that takes steps.

    Raises:
        CampaignError: the robot, the readings or the request cannot be used.
    """
    prepared = prepared_campaign(campaign)
    request = RunRequest(measurement_set_id=uuid4().hex, **options.model_dump())
    return carried_out(Run, request, lambda: run_work(prepared, request), on_progress)


def predict(campaign: Campaign, table: str, run: Run | None = None, **options: object) -> DeflectionResult:
    """Predict deflections by the model of a campaign.

    Args:
        campaign: robot and readings.
        table: CSV of postures and loads, with units in the headers.
        run: of that campaign; identified now, as the campaign says, if None.
        options: fields of `DeflectionOptions`, in SI units.

    Raises:
        CampaignError: robot, readings, run or table cannot be used.
    """
    from jointstiff.service.kinds.deflection.tables import read_load_cases
    from jointstiff.service.kinds.deflection.work import predict_by_run

    run = model_run(campaign, run)
    with as_campaign_error("robot"):
        robot = _robot(campaign.robot.model_dump_json()).robot
    with as_campaign_error("prediction"):
        cases = read_load_cases(table, robot.joint_names, **options)
        return predict_by_run(robot, run, cases)


def model_run(campaign: Campaign, run: Run | None) -> Run:
    """Return the run of a campaign that predicts: the one given, or identified now, as the campaign says.

    Raises:
        CampaignError: robot or readings cannot be used, the run has failed, or is of another campaign.
    """
    if run is None:
        run = identify(campaign, campaign.run)
        if run.error is not None:
            raise CampaignError(run.error)
        return run
    with as_campaign_error("prediction"):
        _refuse_other_run(campaign, run)
    return run


def _refuse_other_run(campaign: Campaign, run: Run) -> None:
    """Refuse a run whose robot and readings are not those of the campaign.

    Raises:
        CampaignError: robot or readings cannot be used.
        RequestError: the run is of others.
    """
    from jointstiff.service.kinds.run.work import run_hash

    measured = campaign.measurement_set
    kept = [each for each in measured.observations if each.label not in run.request.leave_out]
    used = campaign.model_copy(update={"measurement_set": measured.model_copy(update={"observations": kept})})
    if not kept or run_hash(prepared_campaign(used), run.request) != run.provenance.input_hash:
        raise RequestError(
            f"the run '{run.id}' is of another robot or of other readings",
            where="run_id",
            remedy="give a run of this campaign, made by this version, or none to identify it now",
        )


def compare(
    campaign: Campaign, options: ComparisonOptions, on_progress: OnProgress | None = None
) -> Comparison:
    """Carry out one comparison.

    Args:
        campaign: robot and readings; its run is not asked.
        options: what to compare.
        on_progress: called with the progress of a comparison that resamples.

    Raises:
        CampaignError: the robot, the readings or the request cannot be used.
    """
    from jointstiff.service.kinds.comparison.work import ComparisonWork

    prepared = prepared_campaign(campaign)
    request = ComparisonRequest(measurement_set_id=uuid4().hex, **options.model_dump())
    return carried_out(Comparison, request, lambda: ComparisonWork(prepared, request), on_progress)


def pair(first: Campaign, second: Campaign, options: PairOptions) -> Pair:
    """Compare two campaigns.

    Args:
        first: such as with the motors' encoders in the loop, or before.
        second: such as with secondary encoders in the loop, or after.
        options: how to identify both; their own runs are not asked.

    Raises:
        CampaignError: a robot, readings or the request cannot be used.
    """
    from jointstiff.schemas.pair import Pair, PairRequest, PairSide
    from jointstiff.service.kinds.pair.work import Side, pair_work

    how = options.options_of_sides
    one, other = (
        Side(name, uuid4().hex, prepared_campaign(campaign, f"{name}."), how)
        for name, campaign in (("first", first), ("second", second))
    )
    request = PairRequest(
        first=PairSide(measurement_set_id=one.set_id),
        second=PairSide(measurement_set_id=other.set_id),
        **dict(options),
    )
    return carried_out(Pair, request, lambda: pair_work(one, other, request))


def find_geometry(request: GeometryRequest) -> Geometry:
    """Find a robot's geometry.

    Args:
        request: the readings, with the nominal model if it is known.

    Raises:
        CampaignError: the robot, the readings or the request cannot be used.
    """
    from jointstiff.schemas.geometry.message import Geometry
    from jointstiff.service.kinds.geometry.work import as_request_errors, geometry_work

    try:
        if request.robot_id is not None:
            raise RequestError(
                f"the stored robot '{request.robot_id}' cannot be used from a file",
                remedy="give the robot document itself, as `robot` or with --robot",
                where="robot_id",
            )
        nominal = None
        if request.robot is not None:
            with as_request_errors("robot"):
                nominal = prepare_robot(request.robot).robot
        work = geometry_work(request, nominal)
        return carry_out(new_job(Geometry, request, work), work)
    except JointstiffError as error:
        raise CampaignError(problem_of(error)) from error


def carried_out(
    message: type[AnyJob], request: Message, work: Callable[[], Work], on_progress: OnProgress | None = None
) -> AnyJob:
    """Carry out a job.

    Raises:
        CampaignError: the request cannot be used.
    """
    with as_campaign_error(message.kind):
        made = work()
        return carry_out(new_job(message, request, made), made, on_progress)


def prepared_campaign(campaign: Campaign, file: str = "") -> PreparedSet:
    """Return robot and readings ready for computation.

    Args:
        campaign: robot and readings.
        file: which one of two, for messages.

    Raises:
        CampaignError: robot or readings cannot be used.
    """
    with as_campaign_error(f"{file}robot"):
        robot = _robot(campaign.robot.model_dump_json())
    with as_campaign_error(f"{file}measurement_set"):
        return prepare_set(campaign.measurement_set, robot, uuid4().hex)


@lru_cache(maxsize=4)
def _robot(document: str) -> PreparedRobot:
    """Prepare a robot, once for the campaigns on it."""
    return prepare_robot(RobotDocument.model_validate_json(document))


@contextmanager
def as_campaign_error(section: str) -> Iterator[None]:
    """Turn errors of the input into one that says in which section of the file."""
    try:
        yield
    except (InputError, RequestError) as error:
        problem = problem_of(error)
        where = f"{section}.{problem.where}" if problem.where else section
        raise CampaignError(problem.model_copy(update={"where": where})) from error
