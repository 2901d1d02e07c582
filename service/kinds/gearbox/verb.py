"""The verb of gearboxes."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, cast

from jointstiff.schemas.fields import Message
from jointstiff.schemas.gearbox import GearboxRequest
from jointstiff.service.kinds.gearbox.kind import GEARBOX
from jointstiff.service.kinds.verb import Backend, JobMonitor, describe_fields, merge_options
from jointstiff.service.resources.documents import read_object, read_robot

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.gearbox import Gearbox, GearboxUnits, HungLoad, StepPosture
    from jointstiff.schemas.robot import RobotDocument
    from jointstiff.service.conversion.arguments import AnyUnits
    from jointstiff.service.kinds.verb import Cancel, File, OnProgress
    from jointstiff.service.library.results import PresentedJob

    class TabledGearbox(PresentedJob, Gearbox):
        """Gearboxes, with their tables, plots and files."""


class GearboxFields(TypedDict, total=False):
    """Options of `gearbox`."""

    name: str
    units: AnyUnits | GearboxUnits
    robot_id: str | None
    robot: File | RobotDocument | Mapping[str, Any]
    load: HungLoad | Mapping[str, Any]
    gravity: Sequence[float]
    encoder_sigma: float | None
    observations: Sequence[StepPosture | Mapping[str, Any]]


def gearbox(
    backend: Backend,
    readings: File | Mapping[str, Any] | Message | None = None,
    /,
    options: GearboxRequest | None = None,
    *,
    on_progress: OnProgress | None = None,
    cancel: Cancel | None = None,
    executor: Executor | None = None,
    **fields: Unpack[GearboxFields],
) -> TabledGearbox:
    """Identify the stiffness of gearboxes from two encoders, read without and with a load.

    Args:
        backend: `Here` or a `Client`, which has this function as a method and does the work.
        readings: a file, a document, or the message of the request.
        options: a `GearboxRequest`; keyword arguments replace options of the same name.
        on_progress: called with the progress of a job that takes steps; default: a bar in a terminal or a
            notebook, if it takes more than 2 s.
        cancel: called between steps, such as `threading.Event().is_set`; if true, the job ends as
            `cancelled`.
        executor: carries out the steps, such as a `concurrent.futures.ProcessPoolExecutor()` or a Dask
            client's `get_executor()`; all numbers are the same to the last bit. A `Client` refuses an
            executor.
        fields: fields of `GearboxRequest`.

    Returns:
        The Gearbox, with its result in SI units. If the computation fails, its state is `failed`.

    Raises:
        CampaignError: a source or an option cannot be used; the error's `problem` has reason and remedy.
        RefusedError: the service refuses the request.
        OSError: a file cannot be read.
    """
    with JobMonitor(on_progress, cancel, executor) as monitor:
        backend, named_options = backend.start_call(monitor), dict[str, Any](fields)
        if isinstance(readings, str | PathLike):
            request = read_object(Path(readings))
        else:
            request = {} if readings is None else dict(readings)
        robot = named_options.get("robot")
        robot = read_robot(robot) if isinstance(robot, str) else robot
        if isinstance(robot, Message):  # a robot replaces the id of a stored robot in the request
            named_options |= {"robot": robot.model_dump(mode="json"), "robot_id": None}
        if options is None and "units" in request:  # the readings state the units of all numbers
            named_options.setdefault("units", request["units"])
        request |= merge_options(GearboxRequest, options, named_options)
        return cast("TabledGearbox", backend.carry_out_request(GEARBOX, request, {}, monitor))


describe_fields(gearbox, GearboxRequest)
