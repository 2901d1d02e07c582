"""Campaign files: one document with robot, readings and request, identified without a server."""

from __future__ import annotations

import json
from codecs import BOM_UTF8
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, TypeVar
from uuid import uuid4

from pydantic import BaseModel

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.comparison import Comparison, ComparisonOptions, ComparisonRequest
from jointstiff.schemas.fields import Message
from jointstiff.schemas.geometry import Geometry, GeometryRequest
from jointstiff.schemas.job import Job, Progress
from jointstiff.schemas.pair import Pair, PairOptions, PairRequest, PairSide
from jointstiff.schemas.problem import Problem
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import Run, RunOptions, RunRequest
from jointstiff.service.computation import (
    ComparisonWork,
    PreparedRobot,
    PreparedSet,
    Side,
    Work,
    as_request_errors,
    carry_out,
    geometry_work,
    new_job,
    pair_work,
    prepare_robot,
    prepare_set,
    run_work,
)
from jointstiff.service.conversion import MAX_SET_BYTES, NOT_JSON, MalformedError, parse
from jointstiff.service.problems import http_problem, invalid_request, problem_of
from jointstiff.solver.errors import InputError, JointstiffError, RequestError

Document = TypeVar("Document", bound=BaseModel)
AnyJob = TypeVar("AnyJob", bound=Job)
OnProgress = Callable[[Progress], object]


class CampaignError(Exception):
    """A campaign that cannot be identified; carries the problem as the API would answer it."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.detail)
        self.problem = problem


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
        raise CampaignError(http_problem(413, f"the file exceeds {limit}", "split it into several"))
    return _parsed(message, content.removeprefix(BOM_UTF8), section)


def parse_document(document: Mapping[str, Any], message: type[Document]) -> Document:
    """Validate a document that was read already.

    Raises:
        CampaignError: it is not such a document, or holds what is no JSON.
    """
    try:
        return _parsed(message, json.dumps(document).encode(), None)
    except (TypeError, ValueError) as error:
        remedy = "give texts, numbers, lists and dictionaries; turn arrays into lists"
        raise CampaignError(http_problem(422, f"the document is no JSON: {error}", remedy)) from None


def _parsed(message: type[Document], content: bytes, section: str | None) -> Document:
    try:
        return parse(message, content, section)
    except MalformedError as error:
        raise CampaignError(_other_file(message, error) or invalid_request(error.faults)) from None


def _other_file(message: type[BaseModel], error: MalformedError) -> Problem | None:
    """Return what the file is instead, if it is of a kind that we know; None if it is not."""
    if error.keys is NOT_JSON:
        remedy = "mend it there; tables and point lists become a campaign by `jointstiff import FILE`"
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
    prepared = _prepared(campaign)
    request = RunRequest(measurement_set_id=uuid4().hex, **options.model_dump())
    return _carried_out(Run, request, lambda: run_work(prepared, request), on_progress)


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
    prepared = _prepared(campaign)
    request = ComparisonRequest(measurement_set_id=uuid4().hex, **options.model_dump())
    return _carried_out(Comparison, request, lambda: ComparisonWork(prepared, request), on_progress)


def pair(first: Campaign, second: Campaign, options: PairOptions) -> Pair:
    """Compare two campaigns.

    Args:
        first: such as with the motors' encoders in the loop, or before.
        second: such as with secondary encoders in the loop, or after.
        options: how to identify both; their own runs are not asked.

    Raises:
        CampaignError: a robot, readings or the request cannot be used.
    """
    how = options.options_of_sides
    one, other = (
        Side(name, uuid4().hex, _prepared(campaign, f"{name}."), how)
        for name, campaign in (("first", first), ("second", second))
    )
    request = PairRequest(
        first=PairSide(measurement_set_id=one.set_id),
        second=PairSide(measurement_set_id=other.set_id),
        **dict(options),
    )
    return _carried_out(Pair, request, lambda: pair_work(one, other, request))


def find_geometry(request: GeometryRequest) -> Geometry:
    """Find a robot's geometry.

    Args:
        request: the readings, with the nominal model if it is known.

    Raises:
        CampaignError: the robot, the readings or the request cannot be used.
    """
    try:
        if request.robot_id is not None:
            raise RequestError(
                f"there is no robot '{request.robot_id}' in a file",
                remedy="give the robot itself, as `robot` or by --robot",
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


def _carried_out(
    message: type[AnyJob], request: Message, work: Callable[[], Work], on_progress: OnProgress | None = None
) -> AnyJob:
    with _as_campaign_error(message.kind):
        made = work()
        return carry_out(new_job(message, request, made), made, on_progress)


def _prepared(campaign: Campaign, file: str = "") -> PreparedSet:
    """Return robot and readings ready for computation.

    Args:
        campaign: robot and readings.
        file: which one of two, for messages.

    Raises:
        CampaignError: robot or readings cannot be used.
    """
    with _as_campaign_error(f"{file}robot"):
        robot = _robot(campaign.robot.model_dump_json())
    with _as_campaign_error(f"{file}measurement_set"):
        return prepare_set(campaign.measurement_set, robot, uuid4().hex)


@lru_cache(maxsize=4)
def _robot(document: str) -> PreparedRobot:
    """Prepare a robot, once for the campaigns on it."""
    return prepare_robot(RobotDocument.model_validate_json(document))


@contextmanager
def _as_campaign_error(section: str) -> Iterator[None]:
    try:
        yield
    except (InputError, RequestError) as error:
        problem = problem_of(error)
        where = f"{section}.{problem.where}" if problem.where else section
        raise CampaignError(problem.model_copy(update={"where": where})) from error
