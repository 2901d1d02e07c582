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
from jointstiff.service.kinds.verb import Cancel, JobMonitor, OnProgress
from jointstiff.service.kinds.width import CancelledWorkError, map_in_order, refuse_no_executor
from jointstiff.service.kinds.work import make_failed_job
from jointstiff.service.library.campaigns import extract_run_options
from jointstiff.service.library.here import Here
from jointstiff.service.library.results import TabledRun
from jointstiff.service.problems import CampaignError, find_path_in_document, http_problem
from jointstiff.service.process import one_thread
from jointstiff.service.resources.documents import (
    AnyCampaign,
    encode_document,
    parse_content,
    parse_document,
    read_campaign,
    read_content,
)

if TYPE_CHECKING:
    from jointstiff.schemas.plan import Plan
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
    """Identify many campaigns, such as one for each robot of a plant.

    Args:
        campaigns: files, documents that were read from JSON, `Campaign` objects, or runs. An iterator is
            read at most 256 campaigns ahead of the run that was yielded last (1,024 if one slow run holds up
            the others).
        options: options of every run; `fields` replace single options. Default: the options of each campaign.
        executor: computes whole campaigns, such as a `concurrent.futures.ProcessPoolExecutor()` or a Dask
            client's `get_executor()`; the numbers do not depend on it.
        on_progress: called with the number of identified campaigns; default: a bar in a terminal or a
            notebook, if the work takes more than 2 s. For an iterator, the total is the number of campaigns
            read so far.
        cancel: called between campaigns, such as `threading.Event().is_set`; if true, the iteration ends.
        fields: options of every run, as of `jointstiff.identify`.

    Returns:
        Iterator over the runs, in the order of the campaigns, each as soon as it has ended. A campaign that
        is invalid, or whose fit fails, gives a run in state `failed`. If it is invalid, `where` of the run's
        `error` begins with the campaign's place, such as `campaigns[3]`, or the name of its file.

    Raises:
        TypeError: an option does not exist, `executor` is no executor, or one campaign is given in place of
            several.
        ExecutorError: the executor failed.
    """
    if isinstance(campaigns, str | bytes | PathLike | Mapping | Campaign | TabledRun):
        raise TypeError("identify_many() takes several campaigns: give a list, or call identify()")
    if unknown := sorted(set(fields) - _OPTIONS):
        raise TypeError(
            f"identify_many() has no option '{unknown[0]}'; `help(jointstiff.identify)` lists the options"
        )
    refuse_no_executor(executor)
    make_monitor = partial(JobMonitor, on_progress, cancel)
    shared = _SharedOptions(options, cast("dict[str, Any]", fields))
    return _identify_all(campaigns, shared, make_monitor, executor)


@dataclass(frozen=True)
class _SharedOptions:
    """Options that all runs share: `fields` replace single options of `options`."""

    options: RunOptions | None
    fields: dict[str, Any]


@dataclass(frozen=True)
class _Task:
    """Campaign to identify, in a form that can be sent to another process, which parses the content."""

    name: str  # name of the campaign in messages
    content: bytes | Campaign | Problem  # JSON text, or the campaign, or why the campaign cannot be read
    path: Path | None  # file of the campaign; None if it is not a file
    shared: _SharedOptions


def _identify_all(
    campaigns: Iterable[AnyCampaign | TabledRun],
    shared: _SharedOptions,
    make_monitor: Callable[[], JobMonitor],
    executor: Executor | None,
) -> Iterator[TabledRun]:
    """Yield the runs of campaigns in order; show the progress after each run.

    Campaigns are read as the work goes on; `sources` keeps campaigns that are read but not identified yet.
    """
    sources: deque[Any] = deque()  # campaigns that are being identified, in order

    def read_tasks() -> Iterator[_Task]:
        for number, source in enumerate(campaigns):
            sources.append(source)
            yield _make_task(number, source, shared)

    with make_monitor() as monitor:
        runs = (
            _identify_one_by_one(read_tasks(), monitor)
            if executor is None
            else _identify_by_executor(executor, read_tasks(), lambda: monitor.cancelled)
        )
        with closing(runs), suppress(CancelledWorkError):
            for count, run in enumerate(runs, 1):
                # A run from another process has no origin: the campaign is read again if it is needed.
                run._origin = _OriginThatReadsCampaignLater(sources.popleft())
                total = len(campaigns) if isinstance(campaigns, Sized) else count + len(sources)
                monitor(Progress(done=count, total=total, unit="campaigns", activity="identifying"))
                yield run


def _identify_by_executor(
    executor: Executor, tasks: Iterable[_Task], cancelled: Callable[[], bool]
) -> Generator[TabledRun]:
    """Yield the runs of tasks, computed by an executor, in the order of the tasks."""
    with closing(map_in_order(executor, _identify_as_json, tasks, cancelled)) as answers:
        yield from map(TabledRun.model_validate_json, answers)


def _identify_one_by_one(tasks: Iterable[_Task], monitor: JobMonitor) -> Generator[TabledRun]:
    """Yield the runs of tasks, computed in this process.

    Raises:
        CancelledWorkError: the user has cancelled the work.
    """
    for task in tasks:
        if monitor.cancelled:
            raise CancelledWorkError
        run = _identify_campaign(task, lambda: monitor.cancelled)
        if run.state == "cancelled":
            raise CancelledWorkError
        yield run


def _make_task(number: int, source: Any, shared: _SharedOptions) -> _Task:  # noqa: ANN401 - a campaign or a run
    """Return the task of a campaign; a campaign that cannot be read becomes a task with the problem."""
    name, path = f"campaigns[{number}]", None
    content: bytes | Campaign | Problem
    if isinstance(source, str | PathLike):
        path = Path(source)
        name = str(path)
    try:
        content = _read_content_of(source)
    except TypeError:
        reason = f"a {type(source).__name__} cannot be read as a campaign"
        content = http_problem(422, reason, "give a file, a document, a `Campaign` or a run")
    except OSError as error:
        reason = f"{path} cannot be read: {error.strerror}"
        content = http_problem(422, reason, "give the name of a file that can be read")
    except CampaignError as error:
        content = error.problem
    return _Task(name, content, path, shared)


def _read_content_of(source: Any) -> bytes | Campaign:  # noqa: ANN401 - a campaign or a run
    """Return a campaign, or the JSON of one: of a run, a `Campaign`, a document or a file.

    Raises:
        TypeError: the source is none of these.
        OSError: the file cannot be read.
        CampaignError: the file is too large.
    """
    if isinstance(source, TabledRun):
        return source.campaign.model_copy(update={"run": extract_run_options(source)})
    if isinstance(source, Campaign):
        return source
    if isinstance(source, Mapping):
        return encode_document(source)
    return read_content(Path(source))


def _identify_campaign(task: _Task, cancelled: Callable[[], bool] = lambda: False) -> TabledRun:
    """Identify a campaign; return its run, in state `failed` if the campaign cannot be used.

    The run has no origin, whose prepared readings would be costly to send back from another process.
    """
    from jointstiff.service.kinds.run.one_of_many import identify_one_of_many
    from jointstiff.service.kinds.run.verb import make_run_request

    here, shared = Here(), task.shared
    try:
        campaign = _read_campaign_of_task(task)
        fields = make_run_request(here, campaign, shared.options, shared.fields)
        request = parse_document(fields, RunRequest)
    except CampaignError as error:
        no_request = RunRequest(measurement_set_id=uuid4().hex)
        return make_failed_job(TabledRun, no_request, _name_campaign_in_problem(error.problem, task))
    with one_thread():
        return identify_one_of_many(
            here.inputs,
            request,
            TabledRun,
            cancelled=cancelled,
            name_place=lambda problem: _name_campaign_in_refusal(problem, task),
        )


def _identify_as_json(task: _Task) -> str:
    """Identify a campaign; return its run as JSON, which the caller reads four times as fast as a pickle."""
    return _identify_campaign(task).model_dump_json()


def _read_campaign_of_task(task: _Task) -> Campaign:
    """Return the campaign of a task, parsed if it is JSON.

    Raises:
        CampaignError: the campaign cannot be read.
    """
    if isinstance(task.content, Problem):
        raise CampaignError(task.content)
    if isinstance(task.content, Campaign):
        return task.content
    return parse_content(task.content, Campaign, task.path, section="campaign")


def _name_campaign_in_problem(problem: Problem, task: _Task) -> Problem:
    """Return a problem whose place `where` begins with the name of the task's campaign."""
    where = problem.where or ""
    if not where.startswith(task.name):
        where = f"{task.name}{': ' if task.path else '.'}{where}" if where else task.name
    return problem.model_copy(update={"where": where})


def _name_campaign_in_refusal(problem: Problem, task: _Task) -> Problem:
    """Return the problem of a refused run, whose place is in the task's campaign, not in a request."""
    path = find_path_in_document("run", problem.where)
    return _name_campaign_in_problem(problem.model_copy(update={"where": path}), task)


class _OriginThatReadsCampaignLater(Here):
    """Origin of a run that reads the run's campaign again from its source when it is needed."""

    def __init__(self, source: Any) -> None:  # noqa: ANN401 - a campaign or a run
        super().__init__()
        self._source = source

    def read_campaign(self, _job: Run | Plan) -> Campaign:
        """Return the campaign of the run, read from its source at the first call."""
        if self.campaign is None:
            source = self._source.campaign if isinstance(self._source, TabledRun) else self._source
            self.campaign = read_campaign(source)
        return self.campaign
