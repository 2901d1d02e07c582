"""Campaign files: one document with robot, readings and request, identified without a server."""

from __future__ import annotations

from codecs import BOM_UTF8
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, TypeVar

from pydantic import BaseModel

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.comparison import Comparison, ComparisonOptions, ComparisonRequest
from jointstiff.schemas.job import Progress
from jointstiff.schemas.measurement import MeasurementSetRequest
from jointstiff.schemas.pair import Pair, PairOptions, PairRequest, PairSide
from jointstiff.schemas.problem import Problem
from jointstiff.schemas.run import Run, RunOptions, RunRequest
from jointstiff.service.api import MAX_SET_BYTES
from jointstiff.service.conversion import NOT_JSON, MalformedError, parse
from jointstiff.service.jobs import Parts
from jointstiff.service.problems import http_problem, invalid_request, problem_of
from jointstiff.service.store import Store
from jointstiff.solver.errors import InputError, RequestError

__all__ = ["CampaignError", "compare", "identify", "pair", "read_campaign", "read_document"]

Document = TypeVar("Document", bound=BaseModel)


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
    try:
        return parse(message, content.removeprefix(BOM_UTF8), section)
    except MalformedError as error:
        raise CampaignError(_other_file(message, error) or invalid_request(error.faults)) from None


def _other_file(message: type[BaseModel], error: MalformedError) -> Problem | None:
    """What the file is instead, if it is of a kind that we know; None if it is not."""
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


def identify(
    campaign: Campaign, options: RunOptions, tell: Callable[[Progress], object] | None = None
) -> Run:
    """Carry out one run.

    Args:
        campaign: robot and readings.
        options: how to identify.
        tell: told of the progress, if the run resamples.

    Raises:
        CampaignError: the robot, the readings or the request cannot be used.
    """
    with _stored(campaign, tell) as (parts, set_id):
        request = RunRequest(measurement_set_id=set_id, **options.model_dump())
        with _as_campaign_error("run"):
            record = parts.runs.create(request, None)
        return parts.runs.current(record.id)


def compare(
    campaign: Campaign, options: ComparisonOptions, tell: Callable[[Progress], object] | None = None
) -> Comparison:
    """Carry out one comparison.

    Args:
        campaign: robot and readings; its run is not asked.
        options: what to compare.
        tell: told of the progress, if the comparison resamples.

    Raises:
        CampaignError: the robot, the readings or the request cannot be used.
    """
    with _stored(campaign, tell) as (parts, set_id):
        request = ComparisonRequest(measurement_set_id=set_id, **options.model_dump())
        with _as_campaign_error("comparison"):
            record = parts.comparisons.create(request, None)
        return parts.comparisons.current(record.id)


def pair(first: Campaign, second: Campaign, options: PairOptions) -> Pair:
    """Compare two campaigns.

    Args:
        first: such as with the motors' encoders in the loop, or before.
        second: such as with secondary encoders in the loop, or after.
        options: how to identify both; their own runs are not asked.

    Raises:
        CampaignError: a robot, readings or the request cannot be used.
    """
    with Store.open("sqlite://") as store:
        parts = Parts.of(store)
        sides = [
            PairSide(measurement_set_id=_stored_set(parts, campaign, f"{name}."))
            for name, campaign in (("first", first), ("second", second))
        ]
        request = PairRequest(first=sides[0], second=sides[1], **dict(options))
        with _as_campaign_error("pair"):
            record = parts.pairs.create(request, None)
        return parts.pairs.current(record.id)


@contextmanager
def _stored(campaign: Campaign, tell: Callable[[Progress], object] | None) -> Iterator[tuple[Parts, str]]:
    """The same path as over HTTP, on a store in memory: its parts, and the id of the measurement set."""
    with Store.open("sqlite://") as store:
        parts = Parts.of(store, tell=tell)
        yield parts, _stored_set(parts, campaign)


def _stored_set(parts: Parts, campaign: Campaign, file: str = "") -> str:
    """Store robot and readings; the id of the measurement set. `file` says which one, if there are two."""
    with _as_campaign_error(f"{file}robot"):
        robot = parts.robots.create(campaign.robot, None)
    document = campaign.measurement_set
    with _as_campaign_error(f"{file}measurement_set"):
        fields = {name: getattr(document, name) for name in type(document).model_fields}
        request = MeasurementSetRequest.model_construct(robot_id=robot.id, **fields)
        return parts.sets.create(request, None).id


@contextmanager
def _as_campaign_error(section: str) -> Iterator[None]:
    try:
        yield
    except (InputError, RequestError) as error:
        problem = problem_of(error)
        where = f"{section}.{problem.where}" if problem.where else section
        raise CampaignError(problem.model_copy(update={"where": where})) from error
