"""The verb of gearboxes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from jointstiff.schemas.fields import Message
from jointstiff.schemas.gearbox import GearboxRequest
from jointstiff.service.kinds.gearbox.kind import GEARBOX
from jointstiff.service.kinds.verb import (
    Backend,
    JobMonitor,
    Request,
    carry_out_verb,
    describe_verb,
    merge_readings,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.gearbox import Gearbox, GearboxUnits, HungLoad, StepPosture
    from jointstiff.schemas.motion import Motion
    from jointstiff.schemas.robot import RobotDocument
    from jointstiff.service.conversion.arguments import AnyUnits
    from jointstiff.service.kinds.verb import Cancel, File, OnProgress


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
) -> Gearbox:
    """Identify the stiffness of gearboxes from two encoders: by a weight step, or by logs of a motion.

    Args:
        readings: a file, a document, or the message of the request.
    """

    def make_request(_: Backend) -> Request:
        """Return the readings with the options."""
        return Request(merge_readings(GearboxRequest, readings, options, fields))

    return carry_out_verb(backend, GEARBOX, JobMonitor(on_progress, cancel, executor), make_request)


describe_verb(gearbox, GEARBOX)
