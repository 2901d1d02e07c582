"""The verbs of `import jointstiff` and `Client`, made of the kinds of work; progress and cancelling."""

from __future__ import annotations

import inspect
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Protocol, Self, TypeVar

from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import Job, Progress
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import CampaignRun, Run
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.rooms import ROOMS
from jointstiff.service.library.files import (
    as_campaign_error,
    parse_document,
    read_object,
    read_planned,
    read_robot,
)
from jointstiff.service.library.results import Door

OnProgress = Callable[[Progress], object]
Cancel = Callable[[], object]
SHOWN_AFTER: Final = 2.0
"""Work of less time shows no bar [s]."""


class Follow:
    """Follow a job to its end: by the functions of the caller, or by a bar where someone looks."""

    def __init__(
        self,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        executor: Executor | None = None,
    ) -> None:
        """Follow by these; without `on_progress` by a bar, where someone looks and the work takes long.

        Args:
            on_progress: called with the progress.
            cancel: asked whether the caller wants no more.
            executor: carries out the steps of work in this process; None if they are carried out here.
        """
        self._on_progress, self._cancel, self.executor = on_progress, cancel, executor
        self._began, self._bar, self._task = time.monotonic(), None, None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    _bar: Any
    _task: Any

    @property
    def cancelled(self) -> bool:
        """Return whether the caller wants no more."""
        return self._cancel is not None and bool(self._cancel())

    def __call__(self, progress: Progress) -> None:
        """Tell how far the work is."""
        if self._on_progress is not None:
            self._on_progress(progress)
        elif time.monotonic() - self._began > SHOWN_AFTER and (
            sys.stderr.isatty() or "ipykernel" in sys.modules  # a person sees it
        ):
            self._show(progress)

    def _show(self, progress: Progress) -> None:
        if self._bar is None:
            from jointstiff.service.tables.terminal import new_bar

            self._bar = new_bar()
            self._task = self._bar.add_task(progress.activity, total=progress.total)
            self._bar.start()
        self._bar.update(
            self._task, description=progress.activity, total=progress.total, completed=progress.done
        )


AJob = TypeVar("AJob", bound=Job, covariant=True)


class Verb(Protocol[AJob]):
    """A kind of work as a function; its docstring, made of the kind's messages, says what it takes."""

    def __call__(
        self,
        *sources: Any,  # noqa: ANN401 - campaigns, runs, files: see the docstring of each
        options: Message | None = None,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        executor: Executor | None = None,
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
        executor: Executor | None = None,
        **fields: Any,  # noqa: ANN401 - of the options
    ) -> Job:
        waiting = list(sources)
        if options is None and waiting and isinstance(waiting[-1], kind.options):
            options = waiting.pop()
        fields = _in_words(fields)
        with Follow(on_progress, cancel, executor) as follow:
            call = _Call(kind, door(), waiting, options, fields, follow)
            if call.door.has_workers:
                refuse_executor(executor)
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


def refuse_executor(executor: Executor | None) -> None:
    """Refuse an executor where a service computes.

    Raises:
        TypeError: there is one.
    """
    if executor is not None:
        raise TypeError(
            "a service computes by its own workers: give `executor` to the verbs of `import jointstiff`, or "
            "start more workers with `jointstiff worker`"
        )


def _in_words(fields: dict[str, Any]) -> dict[str, Any]:
    """Return options whose units and goal are messages, where they were words."""
    if isinstance(fields.get("units"), str):
        from jointstiff.service.conversion.arrays import units_of

        fields = fields | {"units": units_of(fields["units"])}
    if isinstance(fields.get("goal"), str):
        from jointstiff.service.live.declaration import goal_of

        with as_campaign_error(""):
            fields = fields | {"goal": goal_of(fields["goal"])}
    return fields


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
        "executor",
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
        "executor": "carries out the steps, such as a `concurrent.futures.ProcessPoolExecutor()` or a Dask "
        "client's `get_executor()`; the numbers have the same bits. Refused by a `Client`.",
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
    "sets": {
        "*campaigns": "campaigns or runs, which are identified with the options of `run`; of a service, none "
        "for the last one of each stored robot."
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
    from jointstiff.service.kinds.comparison.work import ComparedSet, comparison_of

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


def _take_many(call: _Call) -> dict[str, Any]:
    given = [call.door.measured(source, f"campaigns[{i}].")[0] for i, source in enumerate(call.waiting)]
    call.waiting.clear()
    return {"measurement_set_ids": given} if given else {}


def _take_robot_or_campaign(call: _Call) -> dict[str, Any]:
    source = call.waiting[0]
    call.waiting[0] = source = read_planned(source)
    if isinstance(source, RobotDocument):
        return {"robot_id": call.door.described(call.waiting.pop(0))}
    set_id, run = call.door.measured(call.waiting.pop(0))
    own = {} if run is None else run.model_dump(mode="json", include={"causes", "leave_out"})
    return {"measurement_set_id": set_id, **{name: stated for name, stated in own.items() if stated}}


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
    "run": lambda call: {"run_id": call.door.identified(call.waiting.pop(0), call.follow.executor)},
    "campaigns": _take_campaigns,
    "sets": _take_many,
    "robot_or_set": _take_robot_or_campaign,
    "readings": _take_readings,
    "files": _take_files,
}
"""Fields of a request, by what it is made of."""


def options_of(run: Run) -> CampaignRun:
    """Return the options of a run as a campaign file has them."""
    options = run.request.model_dump(exclude={"measurement_set_id", "variant_of"}, exclude_unset=True)
    return CampaignRun.model_validate(options)
