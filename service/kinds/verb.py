"""Common code of the verbs, such as `identify`, and `Backend`, the interface of process and service.

The verb of each kind of work is a function whose first argument is a backend: `Here` (this process) or
`Client` (a service). Both have the function as a method.
"""

from __future__ import annotations

import inspect
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from importlib import import_module
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Protocol, Self

from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import Progress
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service import kinds
from jointstiff.service.kinds.kind import AnyJob, AnyKind, Kind
from jointstiff.service.kinds.rooms import ROOMS
from jointstiff.service.kinds.width import refuse_no_executor
from jointstiff.service.problems import as_campaign_error
from jointstiff.service.resources.documents import read_object, read_robot

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from jointstiff.schemas.joints import JointKind
    from jointstiff.schemas.robot import RobotDocument
    from jointstiff.schemas.run import Campaign
    from jointstiff.service.conversion.arguments import JointKinds

    File = str | PathLike[str]
    Source = File | Mapping[str, Any] | Campaign | Run  # a campaign, or a run of one
    Vector = Sequence[float] | npt.NDArray[Any]
    Matrix = Sequence[Sequence[float]] | npt.NDArray[Any]

OnProgress = Callable[[Progress], object]
Cancel = Callable[[], object]
_SHOWN_UNITS: Final = {"m": "mm", "rad": "deg"}
"""Default units of arguments whose messages are in SI units."""
SHOWN_AFTER: Final = 2.0
"""Duration of a job after which a progress bar is shown [s]."""


class JobMonitor:
    """Progress display and cancellation of one job, by functions of the caller or by a progress bar."""

    _bar: Any  # progress bar; None before it is shown
    _task: Any  # line of the job in the progress bar

    def __init__(
        self,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        executor: Executor | None = None,
    ) -> None:
        """Store the caller's functions; the job begins now.

        Args:
            on_progress: called with the progress; None for a progress bar in a terminal or notebook.
            cancel: called between steps; a true answer cancels the job.
            executor: carries out the steps of the job; None to carry them out in this process.

        Raises:
            TypeError: `executor` is no executor.
        """
        refuse_no_executor(executor)
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

    @property
    def cancelled(self) -> bool:
        """True if the caller's function `cancel` says that the job is to be cancelled."""
        return self._cancel is not None and bool(self._cancel())

    def __call__(self, progress: Progress) -> None:
        """Call the caller's function with the progress or, if the job takes long, show a progress bar."""
        if self._on_progress is not None:
            self._on_progress(progress)
        elif time.monotonic() - self._began > SHOWN_AFTER and (
            sys.stderr.isatty() or "ipykernel" in sys.modules  # a terminal or a notebook
        ):
            self._show_bar(progress)

    def _show_bar(self, progress: Progress) -> None:
        """Update the progress bar; the first call creates the bar."""
        if self._bar is None:
            from jointstiff.service.tables.terminal import new_bar

            self._bar = new_bar()
            self._task = self._bar.add_task(progress.activity, total=progress.total)
            self._bar.start()
        self._bar.update(
            self._task, description=progress.activity, total=progress.total, completed=progress.done
        )


class Backend(Protocol):
    """Interface of `Here` (this process) and `Client` (a service), which store inputs and compute results."""

    def start_call(self, monitor: JobMonitor) -> Backend:
        """Return a backend for one call of a verb, which has no inputs yet.

        Raises:
            TypeError: `monitor` has an executor, but the backend has workers of its own.
        """

    def prepare_set(self, source: Source, place: str = "") -> tuple[str, RunOptions | None]:
        """Prepare a campaign; return the id of its measurement set, and its options for a run.

        The options are None if they are not known. `place`, such as "first.", is put before the place that
        an error names.
        """

    def prepare_run(self, source: Source, executor: Executor | None = None) -> str:
        """Prepare a run, and return its id; if `source` is a campaign, identify the campaign first."""

    def prepare_robot(self, robot: RobotDocument) -> str:
        """Prepare a robot, and return its id."""

    def joint_kinds(self, source: Source | RobotDocument) -> Mapping[str, JointKind]:
        """Return the kinds of the joints by name, in order, of a robot or of a prepared source."""

    def run(self, request: RunRequest, monitor: JobMonitor, dispensable: bool) -> Run | None:
        """Identify a measurement set, and return its run.

        `dispensable` is true if the caller can continue without this run: if the readings do not support
        its method, a failed run or None is returned instead of an error.
        """

    def carry_out_request(
        self,
        kind: Kind[AnyJob, Any],
        request: dict[str, Any],
        files: Mapping[str, bytes],
        monitor: JobMonitor,
    ) -> AnyJob:
        """Carry out a request of a kind, and return the ended job.

        `files` has the contents of files by name, if jobs of this kind need files.
        """

    def correct_poses(
        self,
        source: Any,  # noqa: ANN401 - a run, a campaign, or a robot
        poses: Any,  # noqa: ANN401 - an array, or a file
        joints: Any,  # noqa: ANN401 - an array
        stated: Mapping[str, Any],
        monitor: JobMonitor,
    ) -> Any:  # noqa: ANN401 - a `Correction`
        """Correct poses; return arrays. `stated` has the options of `correct` by name."""


@dataclass(frozen=True)
class Request:
    """Request of a kind of work, made of the arguments of its verb."""

    fields: dict[str, Any]
    files: Mapping[str, bytes] = field(default_factory=dict)  # contents of files by name


def carry_out_verb(
    backend: Backend,
    kind: Kind[AnyJob, Any],
    monitor: JobMonitor,
    make_request: Callable[[Backend], Request],
) -> AnyJob:
    """Make the request of a verb, carry it out, and return the ended job.

    Args:
        backend: first argument of the verb.
        kind: kind of work of the verb.
        monitor: progress and cancellation of this call.
        make_request: returns the request; called with the backend of this call.

    Raises:
        CampaignError: a source or an option cannot be used.
        RefusedError: the service refuses the request.
        OSError: a file cannot be read.
    """
    with monitor:
        backend_of_call = backend.start_call(monitor)
        request = make_request(backend_of_call)
        return backend_of_call.carry_out_request(kind, request.fields, request.files, monitor)


def merge_readings(
    message: type[Message],
    readings: str | PathLike[str] | Mapping[str, Any] | Message | None,
    options: Message | None,
    fields: Mapping[str, Any],
) -> dict[str, Any]:
    """Merge readings that are the request itself with options; return the fields of the request by name.

    Args:
        message: type of the request.
        readings: a file, a document, or the message of the request.
        options: options that the caller passed; None for the defaults.
        fields: keyword arguments, which replace options of the same name.

    Raises:
        CampaignError: the file or an option cannot be used.
        OSError: the file cannot be read.
    """
    if isinstance(readings, str | PathLike):
        request = read_object(Path(readings))
    else:
        request = {} if readings is None else dict(readings)
    named = dict(fields)
    robot = named.get("robot")
    robot = read_robot(robot) if isinstance(robot, str) else robot
    if isinstance(robot, Message):  # a robot replaces the id of a stored robot in the request
        named |= {"robot": robot.model_dump(mode="json"), "robot_id": None}
    if options is None and "units" in request:  # the readings state the units of all numbers
        named.setdefault("units", request["units"])
    return request | merge_options(message, options, named)


def merge_options(
    message: type[Message],
    options: Message | None,
    fields: Mapping[str, Any],
    joint_kinds: JointKinds | None = None,
) -> dict[str, Any]:
    """Merge the options and the keyword arguments of a verb; return the fields of a request by name.

    Keyword arguments are in the units of the argument `units`, by default mm, deg, N and N·m; options are in
    the units of their message. A goal as text, such as "15 %", is replaced by a message.

    Args:
        message: type of the options.
        options: options that the caller passed; None for the defaults.
        fields: keyword arguments, which replace options of the same name.
        joint_kinds: returns the kinds of the joints, for options with positions of joints.

    Raises:
        TypeError: the options state other units than `units`.
        CampaignError: the text of units or goal is not understood.
    """
    merged = {} if options is None else options.model_dump(mode="json", exclude_unset=True)
    if "units" in message.model_fields or any(not isinstance(each, str | bool) for each in fields.values()):
        merged = _merge_numbers(message, merged, fields, joint_kinds)
    else:  # without numbers, so that a `Client` imports no numerics
        merged |= {name: value for name, value in fields.items() if name != "units"}
    if isinstance(merged.get("goal"), str | int | float):
        from jointstiff.service.conversion.units import parse_goal_text

        with as_campaign_error(""):
            merged["goal"] = parse_goal_text(str(merged["goal"]))
    return merged


def _merge_numbers(
    message: type[Message],
    merged: dict[str, Any],
    fields: Mapping[str, Any],
    joint_kinds: JointKinds | None,
) -> dict[str, Any]:
    """Return fields of a request with keyword arguments, converted to the units of the request.

    Raises:
        TypeError: the fields of the request state other units than the argument `units`.
        CampaignError: the units are not understood.
    """
    from jointstiff.service.conversion.arguments import convert_to_si
    from jointstiff.service.conversion.units import complete_units

    stated = {name: value for name, value in fields.items() if name != "units"}
    with as_campaign_error(""):
        units = complete_units(fields.get("units", merged.get("units")))
        if "units" in merged and complete_units(merged["units"]) != units:
            raise TypeError("`options` already state units: omit `units`")
        merged = merged | convert_to_si(message, stated, units, joint_kinds)
    if "units" in message.model_fields:
        known: Any = message.model_fields["units"].annotation  # readings of geometry have no unit of force
        merged["units"] = {name: unit for name, unit in units.items() if name in known.model_fields}
    return merged


_ARGUMENTS: Final = """\
    options: a `{options}`; keyword arguments replace options of the same name.
    on_progress: called with the progress of a job that takes steps; default: a bar in a terminal or a
        notebook, if it takes more than 2 s.
    cancel: called between steps, such as `threading.Event().is_set`; if true, the job ends as
        `cancelled`.
    executor: carries out the steps, such as a `concurrent.futures.ProcessPoolExecutor()` or a Dask
        client's `get_executor()`; all numbers are the same to the last bit. A `Client` refuses an
        executor.
"""
"""Description of the arguments that all verbs have."""
_OUTCOME: Final = """
Returns:
    The {job}, with its result in SI units. If the computation fails, its state is `failed`.

Raises:
    CampaignError: a source or an option cannot be used; the error's `problem` has reason and remedy.
    RefusedError: the service refuses the request.
    OSError: a file cannot be read.
"""
"""Description of the result and the errors of all verbs."""


def describe_verb(verb: Callable[..., object], kind: AnyKind, outcome: str = _OUTCOME) -> None:
    """Complete the docstring of a verb: arguments that all verbs have, result, errors, and all options.

    The verb describes its own arguments and errors. `fields`, the options, is described unless the verb does.
    """
    names = {"options": kind.options.__name__, "job": kind.message.__name__}
    own, _, own_errors = inspect.cleandoc(verb.__doc__ or "").partition("\n\nRaises:\n")
    summary, _, own_arguments = own.partition("\n\nArgs:\n")
    arguments = "    backend: `Here` or a `Client`, which has this function as a method and does the work.\n"
    stated, _, stated_fields = own_arguments.partition("    fields: ")
    arguments += f"{stated.rstrip()}\n" if stated else ""
    arguments += _ARGUMENTS.format(**names)
    described_fields = stated_fields or f"fields of `{kind.options.__name__}`."
    arguments += f"    fields: {described_fields}\n"
    ending = outcome.format(**names) + own_errors
    lines = [f"{summary}\n\nArgs:\n{arguments}{ending.rstrip()}", "\nKeyword Args:"]
    verb.__doc__ = "\n".join([*lines, *_describe_options(kind.options)])


def _describe_options(options: type[Message]) -> Iterator[str]:
    """Yield a line for each option of a verb: name, description and unit."""
    yield (
        "    units: Units of the numbers of this call, such as 'm, rad, kN, kN.m'; default: mm, deg, N, N.m. "
        "Masses are in kg, and quantities that combine units in SI units. Numbers of messages, such as "
        f"`{options.__name__}`, are in the units of the message."
    )
    for name, field_info in options.model_fields.items():
        if name == "units":
            continue
        schema = field_info.json_schema_extra
        si_unit = schema.get("unit") if isinstance(schema, dict) else None
        unit = f" [{_SHOWN_UNITS.get(str(si_unit), si_unit)}]" if si_unit else ""
        yield f"    {name}: {' '.join((field_info.description or '').split())}{unit}"


def import_verb(kind: str) -> Callable[..., Any]:
    """Import and return the verb of a kind, a function whose first argument is a backend."""
    verb: Callable[..., Any] = getattr(import_module(f"{kinds.__name__}.{kind}.verb"), ROOMS[kind].command)
    return verb
