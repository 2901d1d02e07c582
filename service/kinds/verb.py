"""Verbs of Python: what the function of a kind of work takes, and the door through which its work is done.

The `verb` of each kind is a plain function of a door; `Here` (this process) and `Client` (a service) have
the function as a method.
"""

from __future__ import annotations

import inspect
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from importlib import import_module
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Protocol, Self

from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import Progress
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service import kinds
from jointstiff.service.kinds.kind import AnyJob, Kind
from jointstiff.service.kinds.rooms import ROOMS
from jointstiff.service.problems import as_campaign_error

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike

    import numpy.typing as npt

    from jointstiff.schemas.robot import RobotDocument
    from jointstiff.schemas.run import Campaign

    File = str | PathLike[str]
    Source = File | Mapping[str, Any] | Campaign | Run  # a campaign, or a run of one
    Vector = Sequence[float] | npt.NDArray[Any]
    Matrix = Sequence[Sequence[float]] | npt.NDArray[Any]

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
            cancel: called; true if the caller wants no more.
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
        """Show how far the work is."""
        if self._on_progress is not None:
            self._on_progress(progress)
        elif time.monotonic() - self._began > SHOWN_AFTER and (
            sys.stderr.isatty() or "ipykernel" in sys.modules  # a person sees it
        ):
            self._show_bar(progress)

    def _show_bar(self, progress: Progress) -> None:
        if self._bar is None:
            from jointstiff.service.tables.terminal import new_bar

            self._bar = new_bar()
            self._task = self._bar.add_task(progress.activity, total=progress.total)
            self._bar.start()
        self._bar.update(
            self._task, description=progress.activity, total=progress.total, completed=progress.done
        )


class Door(Protocol):
    """This process or a service: it knows what requests are made of by ids, and does the work."""

    def begun(self, follow: Follow) -> Door:
        """Return the door for one verb, with nothing prepared yet.

        Raises:
            TypeError: there is an executor, and the door has workers of its own.
        """

    def measured(self, source: Source, _place: str = "") -> tuple[str, RunOptions | None]:
        """Return the id of a campaign's measurement set, and the options of its run if they are known."""

    def identified(self, source: Source, executor: Executor | None = None) -> str:
        """Return the id of a run, which is identified now from a campaign."""

    def described(self, robot: RobotDocument) -> str:
        """Return the id of a robot."""

    def run(self, request: RunRequest, follow: Follow, dispensable: bool) -> Run | None:
        """Identify a measurement set; a dispensable run may fail or be none if it is not supported."""

    def done(
        self,
        kind: Kind[AnyJob, Any],
        request: dict[str, Any],
        files: Mapping[str, bytes],
        follow: Follow,
    ) -> AnyJob:
        """Do the work of a request, and of files where it takes some; return the job once it has ended."""


def stated(message: type[Message], options: Message | None, fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a verb as the fields of a request; units and goals in words become messages.

    Args:
        message: that the options are.
        options: of the verb; None for those by default.
        fields: that replace options, by name.

    Raises:
        TypeError: the options are something else.
        CampaignError: words are no units, or no goal.
    """
    if not isinstance(options, message | None):
        raise TypeError(f"options must be a {message.__name__}, not a {type(options).__name__}")
    given = {} if options is None else options.model_dump(mode="json", exclude_unset=True)
    given |= fields
    if isinstance(given.get("units"), str):
        from jointstiff.service.conversion.arrays import units_of

        given["units"] = units_of(given["units"])
    if isinstance(given.get("goal"), str):
        from jointstiff.service.conversion.units import goal_of_text

        with as_campaign_error(""):
            given["goal"] = goal_of_text(given["goal"])
    return given


def describe_fields(verb: Callable[..., object], options: type[Message]) -> None:
    """Append the descriptions of all options to the docstring of a verb."""
    lines = []
    for name, field in options.model_fields.items():
        extra = field.json_schema_extra
        unit = f" [{extra['unit']}]" if isinstance(extra, dict) and extra.get("unit") else ""
        lines.append(f"    {name}: {' '.join((field.description or '').split())}{unit}")
    verb.__doc__ = "\n".join([inspect.cleandoc(verb.__doc__ or ""), "\nKeyword Args:", *lines])


def verb_of(kind: str) -> Callable[..., Any]:
    """Return the verb of a kind: a function of a door."""
    verb: Callable[..., Any] = getattr(import_module(f"{kinds.__name__}.{kind}.verb"), ROOMS[kind].command)
    return verb
