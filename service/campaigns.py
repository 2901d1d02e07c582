"""Campaign files: one document with robot, readings and request, identified without a server."""

from __future__ import annotations

from codecs import BOM_UTF8
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Final, get_args

from schemas.campaign import Campaign
from schemas.measurement_set import MeasurementSetRequest
from schemas.problem import Problem
from schemas.run import Method, Run, RunOptions, RunRequest, Weighting
from service.api.bodies import MAX_SET_BYTES
from service.api.parts import Parts
from service.parsing import MalformedError, parse
from service.problems import http_problem, invalid_request, problem_of
from service.store import Store
from service.terminal import ComparisonRow
from solver.exceptions import InputError, RequestError

__all__ = ["METHODS", "PAPER_WEIGHTING", "CampaignError", "compare", "identify", "read_campaign"]

METHODS: Final[tuple[Method, ...]] = get_args(Method)

PAPER_WEIGHTING: Final[Mapping[Method, Weighting]] = MappingProxyType(
    {
        "complete_pose": "characteristic_length",
        "partial_pose": "covariance",
        "decoupled_partial_pose": "covariance",
    }
)
"""As in the paper. Weighted by covariance the complete pose would equal the partial pose (METHOD.md §3)."""


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
    with path.open("rb") as file:  # which may be a pipe, of no size
        content = file.read(MAX_SET_BYTES + 1)
    if len(content) > MAX_SET_BYTES:
        limit = f"{MAX_SET_BYTES // 1024**2} MiB"
        raise CampaignError(http_problem(413, f"the file exceeds {limit}", "split it into several"))
    try:
        return parse(Campaign, content.removeprefix(BOM_UTF8))
    except MalformedError as error:
        raise CampaignError(invalid_request(error.faults)) from None


def identify(campaign: Campaign, options: RunOptions, tell: Callable[[int], object] | None = None) -> Run:
    """Carry out one run.

    Args:
        campaign: robot and readings.
        options: how to identify.
        tell: told how many draws are done, if the run resamples.

    Raises:
        CampaignError: the robot, the readings or the request cannot be used.
    """
    with _running(campaign, tell) as run:
        return run(options)


def compare(campaign: Campaign) -> list[ComparisonRow]:
    """Carry out the paper's three methods, unconstrained and constrained.

    Raises:
        CampaignError: the robot or the readings cannot be used.
    """
    rows = []
    with _running(campaign) as run:
        for method, positive in product(METHODS, (False, True)):
            options = RunOptions(method=method, weighting=PAPER_WEIGHTING[method], positive=positive)
            try:
                outcome: Run | Problem = run(options)
            except CampaignError as error:
                outcome = error.problem
            rows.append(ComparisonRow(method, positive, outcome))
    return rows


@contextmanager
def _running(
    campaign: Campaign, tell: Callable[[int], object] | None = None
) -> Iterator[Callable[[RunOptions], Run]]:
    """The same path as over HTTP, on a store in memory."""
    with Store.open("sqlite://") as store:
        parts = Parts.of(store, tell=tell)
        with _as_campaign_error("robot"):
            robot = parts.robots.create(campaign.robot, None)
        document = campaign.measurement_set
        with _as_campaign_error("measurement_set"):
            fields = {name: getattr(document, name) for name in type(document).model_fields}
            request = MeasurementSetRequest.model_construct(robot_id=robot.id, **fields)
            stored = parts.sets.create(request, None)

        def run(options: RunOptions) -> Run:
            request = RunRequest(measurement_set_id=stored.id, **options.model_dump())
            with _as_campaign_error("run"):
                record = parts.runs.create(request, None)
            return Run.model_validate_json(record.document)

        yield run


@contextmanager
def _as_campaign_error(section: str) -> Iterator[None]:
    try:
        yield
    except (InputError, RequestError) as error:
        problem = problem_of(error)
        where = f"{section}.{problem.where}" if problem.where else section
        raise CampaignError(problem.model_copy(update={"where": where})) from error
