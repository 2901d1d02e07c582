"""Verbs of Python, such as `identify`: what they share, and the door by which they get their work done.

The verb of each kind of work is a function whose first argument is a door: `Here` (this process) or `Client`
(a service). Both have the function as a method.
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
"""Time after which a bar of progress is shown [s]."""


class Follow:
    """Progress and cancellation of a job: functions of the caller, or a bar in a terminal or notebook."""

    def __init__(
        self,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        executor: Executor | None = None,
    ) -> None:
        """Keep the caller's functions, and the time as the beginning of the job.

        Args:
            on_progress: called with the progress; None for a bar in a terminal or notebook.
            cancel: called between steps; a true answer cancels the job.
            executor: carries out the steps of work; None to carry them out in this process.
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
        """Return whether the caller wants the job to be cancelled."""
        return self._cancel is not None and bool(self._cancel())

    def __call__(self, progress: Progress) -> None:
        """Pass the progress on to the caller's function, or show it as a bar if the work takes long."""
        if self._on_progress is not None:
            self._on_progress(progress)
        elif time.monotonic() - self._began > SHOWN_AFTER and (
            sys.stderr.isatty() or "ipykernel" in sys.modules  # a terminal or a notebook
        ):
            self._show_bar(progress)

    def _show_bar(self, progress: Progress) -> None:
        """Draw the progress in the bar, which is made at the first call."""
        if self._bar is None:
            from jointstiff.service.tables.terminal import new_bar

            self._bar = new_bar()
            self._task = self._bar.add_task(progress.activity, total=progress.total)
            self._bar.start()
        self._bar.update(
            self._task, description=progress.activity, total=progress.total, completed=progress.done
        )


class Door(Protocol):
    """Interface of `Here` (this process) and `Client` (a service), which prepare inputs and do the work."""

    def begun(self, follow: Follow) -> Door:
        """Return the door by which one call of a verb is carried out; no inputs are prepared in it yet.

        Raises:
            TypeError: an executor is given to a door that has workers of its own.
        """

    def measured(self, source: Source, _place: str = "") -> tuple[str, RunOptions | None]:
        """Prepare a campaign; return the id of its measurement set, and its run's options (None if unknown).

        `_place` comes before the place that an error names, such as "first.".
        """

    def identified(self, source: Source, executor: Executor | None = None) -> str:
        """Prepare a run, and return its id; a campaign is identified now."""

    def described(self, robot: RobotDocument) -> str:
        """Prepare a robot, and return its id."""

    def run(self, request: RunRequest, follow: Follow, dispensable: bool) -> Run | None:
        """Identify a measurement set, and return its run.

        A dispensable run whose method the readings do not support is returned as failed, or is None.
        """

    def done(
        self,
        kind: Kind[AnyJob, Any],
        request: dict[str, Any],
        files: Mapping[str, bytes],
        follow: Follow,
    ) -> AnyJob:
        """Carry out a request, with files by name if the kind takes files; return the ended job."""


def merge_options(
    message: type[Message], options: Message | None, fields: Mapping[str, Any]
) -> dict[str, Any]:
    """Merge the options of a verb and its keyword arguments; return them as the fields of a request.

    Units and a goal that are given in words, such as "mm, deg, N", become fields of their messages.

    Args:
        message: type of the options.
        options: of the verb; None for the defaults.
        fields: keyword arguments, which replace options of the same name.

    Raises:
        TypeError: the options are not of this type.
        CampaignError: the words of units or goal are not understood.
    """
    if not isinstance(options, message | None):
        raise TypeError(f"options must be a {message.__name__}, not a {type(options).__name__}")
    given = {} if options is None else options.model_dump(mode="json", exclude_unset=True)
    given |= fields
    if isinstance(given.get("units"), str):
        from jointstiff.service.conversion.arrays import parse_units

        given["units"] = parse_units(given["units"])
    if isinstance(given.get("goal"), str):
        from jointstiff.service.conversion.units import parse_goal_text

        with as_campaign_error(""):
            given["goal"] = parse_goal_text(given["goal"])
    return given


def describe_fields(verb: Callable[..., object], options: type[Message]) -> None:
    """Append a section `Keyword Args`, with the descriptions of all options, to the docstring of a verb."""
    lines = []
    for name, field in options.model_fields.items():
        extra = field.json_schema_extra
        unit = f" [{extra['unit']}]" if isinstance(extra, dict) and extra.get("unit") else ""
        lines.append(f"    {name}: {' '.join((field.description or '').split())}{unit}")
    verb.__doc__ = "\n".join([inspect.cleandoc(verb.__doc__ or ""), "\nKeyword Args:", *lines])


def verb_of(kind: str) -> Callable[..., Any]:
    """Import and return the verb of a kind, a function whose first argument is a door."""
    verb: Callable[..., Any] = getattr(import_module(f"{kinds.__name__}.{kind}.verb"), ROOMS[kind].command)
    return verb
