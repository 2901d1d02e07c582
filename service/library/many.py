"""Identification of many campaigns: each is prepared and identified by itself, here or by an executor."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sized
from concurrent.futures import Executor
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack, cast
from uuid import uuid4

from jointstiff.schemas.finding import Problem
from jointstiff.schemas.job import Progress
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Campaign, Run, RunRequest
from jointstiff.service.kinds.verb import Cancel, Follow, OnProgress
from jointstiff.service.kinds.width import CancelledWorkError, in_order
from jointstiff.service.library.campaigns import options_of
from jointstiff.service.library.here import Here, refused_run
from jointstiff.service.library.results import TabledRun
from jointstiff.service.problems import CampaignError, http_problem
from jointstiff.service.resources.documents import (
    AnyCampaign,
    campaign_of,
    document_content,
    parse_content,
    read_content,
)

if TYPE_CHECKING:
    from jointstiff.service.kinds.run.verb import IdentifyFields

_OPTIONS = frozenset(RunOptions.model_fields)


def identify_many(
    campaigns: Iterable[AnyCampaign | TabledRun],
    /,
    options: RunOptions | None = None,
    *,
    executor: Executor | None = None,
    on_progress: OnProgress | None = None,
    cancel: Cancel | None = None,
    **fields: Unpack[IdentifyFields],
) -> Iterator[TabledRun]:
    """Identify many campaigns, such as one of each robot of a plant.

    Args:
        campaigns: files, documents that were read from JSON, `Campaign` objects, or runs. An iterator is
            read as the work goes on: 256 campaigns beyond the runs so far, up to 1,024 behind a slow one.
        options: of every run; the options below replace its fields. Without them each campaign has its own.
        executor: identifies whole campaigns, such as a `concurrent.futures.ProcessPoolExecutor()` or a Dask
            client's `get_executor()`; the numbers have the same bits.
        on_progress: called with the number of identified campaigns; default: a bar in a terminal or a
            notebook, if it takes more than 2 s. The total of an iterator is what was read of it so far.
        cancel: called between campaigns, such as `threading.Event().is_set`; if true, the iteration ends.
        fields: options of every run, as of `jointstiff.identify`.

    Returns:
        The runs, in the order of the campaigns, as soon as they are there. A campaign that cannot be
        identified or used gives a run in state `failed`; the `error` of one that cannot be used begins with
        its place, such as `campaigns[3]`, or the name of its file.

    Raises:
        TypeError: there is no such option, or one campaign is given in place of several.
        ExecutorError: the executor failed.
    """
    if isinstance(campaigns, str | bytes | PathLike | Mapping | Campaign | TabledRun):
        raise TypeError("identify_many() takes several campaigns: give a list, or call identify()")
    if unknown := sorted(set(fields) - _OPTIONS):
        raise TypeError(
            f"identify_many() has no option '{unknown[0]}'; `help(jointstiff.identify)` lists them"
        )
    follow = partial(Follow, on_progress, cancel)
    return _runs(campaigns, _Shared(options, cast("dict[str, Any]", fields)), follow, executor)


@dataclass(frozen=True)
class _Shared:
    """Options of all runs."""

    options: RunOptions | None
    fields: dict[str, Any]


@dataclass(frozen=True)
class _Task:
    """A campaign as it goes to another process, which parses it: what it needs is in memory."""

    name: str  # of the campaign, for messages
    content: bytes | Campaign | Problem  # JSON, what was read from it, or why it cannot be read
    path: Path | None  # of its file, if there is one
    shared: _Shared


def _runs(
    campaigns: Iterable[AnyCampaign | TabledRun],
    shared: _Shared,
    followed: Callable[[], Follow],
    executor: Executor | None,
) -> Iterator[TabledRun]:
    sources: deque[Any] = deque()  # campaigns in flight, the first one first

    def tasks() -> Iterator[_Task]:
        for number, source in enumerate(campaigns):
            sources.append(source)
            yield _task(number, source, shared)

    with followed() as follow:
        runs = (
            _one_by_one(tasks(), follow)
            if executor is None
            else _by_executor(executor, tasks(), lambda: follow.cancelled)
        )
        with closing(runs), suppress(CancelledWorkError):
            for done, run in enumerate(runs, 1):
                run._origin = _Later(sources.popleft())
                total = len(campaigns) if isinstance(campaigns, Sized) else done + len(sources)
                follow(Progress(done=done, total=total, unit="campaigns", activity="identifying"))
                yield run


def _by_executor(
    executor: Executor, tasks: Iterable[_Task], cancelled: Callable[[], bool]
) -> Generator[TabledRun]:
    with closing(in_order(executor, _identify_as_json, tasks, cancelled)) as answers:
        yield from map(TabledRun.model_validate_json, answers)


def _one_by_one(tasks: Iterable[_Task], follow: Follow) -> Generator[TabledRun]:
    for task in tasks:
        if follow.cancelled:
            raise CancelledWorkError
        run = _identify_campaign(task, follow)
        if run.state == "cancelled":
            raise CancelledWorkError
        yield run


def _task(number: int, source: Any, shared: _Shared) -> _Task:  # noqa: ANN401 - a campaign or a run
    name, path = f"campaigns[{number}]", None
    content: bytes | Campaign | Problem
    try:
        if isinstance(source, TabledRun):
            content = source.campaign.model_copy(update={"run": options_of(source)})
        elif isinstance(source, Campaign):
            content = source
        elif isinstance(source, Mapping):
            content = document_content(source)
        else:
            path = Path(cast("str | PathLike[str]", source))
            name = str(path)
            content = read_content(path)
    except CampaignError as error:
        content = error.problem
    except TypeError:
        reason = f"a {type(source).__name__} is no campaign"
        content = http_problem(422, reason, "give a file, a document, a `Campaign` or a run")
    except OSError as error:
        reason = f"{path} cannot be read: {error.strerror}"
        content = http_problem(422, reason, "give the name of a file that can be read")
    return _Task(name, content, path, shared)


def _identify_campaign(task: _Task, follow: Follow | None = None) -> TabledRun:
    """Identify a campaign; one that cannot be used is a failed run, whose error names it."""
    shared = task.shared
    try:
        run: TabledRun = Here().identify(
            _campaign(task),
            options=shared.options,
            on_progress=_silently,  # one bar shows all campaigns
            cancel=None if follow is None else lambda: follow.cancelled,
            **shared.fields,
        )
    except CampaignError as error:
        request = RunRequest(measurement_set_id=uuid4().hex)
        run = refused_run(TabledRun, request, _problem_of_campaign(error.problem, task))
    run._origin = None  # it holds the prepared readings, which are not sent back
    return run


def _identify_as_json(task: _Task) -> str:
    """Identify a campaign; return the run as JSON, which is read in a quarter of the time of a pickle."""
    return _identify_campaign(task).model_dump_json()


def _campaign(task: _Task) -> Campaign:
    if isinstance(task.content, Problem):
        raise CampaignError(task.content)
    if isinstance(task.content, Campaign):
        return task.content
    return parse_content(task.content, Campaign, task.path)


def _silently(_: Progress) -> None:
    """Show nothing."""


def _problem_of_campaign(problem: Problem, task: _Task) -> Problem:
    """Return a problem whose place begins with the name of the campaign."""
    where = problem.where or ""
    if not where.startswith(task.name):
        where = f"{task.name}{': ' if task.path else '.'}{where}" if where else task.name
    return problem.model_copy(update={"where": where})


class _Later(Here):
    """This process, which reads the campaign of a run again once it is wanted."""

    def __init__(self, source: Any) -> None:  # noqa: ANN401 - a campaign or a run
        super().__init__()
        self._source = source

    def campaign_of(self, _run: Run) -> Campaign:
        """Return the campaign."""
        if self.campaign is None:
            again = self._source.campaign if isinstance(self._source, TabledRun) else self._source
            self.campaign = campaign_of(again)
        return self.campaign
