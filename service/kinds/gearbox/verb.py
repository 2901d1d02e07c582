"""The verb of gearboxes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypedDict, Unpack, cast

from jointstiff.schemas.fields import Message
from jointstiff.schemas.gearbox import GearboxRequest
from jointstiff.service.kinds.gearbox.kind import GEARBOX
from jointstiff.service.kinds.verb import Backend, JobMonitor, describe_fields, merge_readings

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.gearbox import Gearbox, GearboxUnits, HungLoad, StepPosture
    from jointstiff.schemas.motion import Motion
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
    load: HungLoad | Mapping[str, Any] | None
    gravity: Sequence[float]
    encoder_sigma: float | None
    observations: Sequence[StepPosture | Mapping[str, Any]]
    motion: Motion | Mapping[str, Any] | None


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
    """Identify the stiffness of gearboxes from two encoders: by a weight step, or by logs of a motion.

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
        backend = backend.start_call(monitor)
        request = merge_readings(GearboxRequest, readings, options, fields)
        return cast("TabledGearbox", backend.carry_out_request(GEARBOX, request, {}, monitor))


describe_fields(gearbox, GearboxRequest)
