"""The verb of gearboxes."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, cast

from jointstiff.schemas.fields import Message
from jointstiff.schemas.gearbox import GearboxRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.kinds.gearbox.kind import GEARBOX
from jointstiff.service.kinds.verb import (
    Backend,
    JobMonitor,
    Request,
    carry_out_verb,
    describe_verb,
    merge_readings,
)
from jointstiff.service.problems import (
    CampaignError,
    FilesError,
    as_campaign_error,
    http_problem,
    naming_missing_file,
    problem_from_error,
)
from jointstiff.service.resources.documents import parse_document, read_robot

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.gearbox import Gearbox, GearboxUnits, HungLoad, StepPosture
    from jointstiff.schemas.motion import Motion
    from jointstiff.service.conversion.units import AnyUnits
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
        readings: a JSON file, a document, or the message of the request; or a table of a weight step (CSV,
            Excel, Parquet), whose `load` is an argument.
    """

    def make_request(_: Backend) -> Request:
        """Return the readings with the options."""
        is_table = isinstance(readings, str | PathLike) and Path(readings).suffix.lower() != ".json"
        stated: Any = readings
        if is_table:
            stated = _read_table(Path(cast("File", readings)), fields.get("robot"))
        return Request(merge_readings(GearboxRequest, stated, options, fields))

    return carry_out_verb(backend, GEARBOX, JobMonitor(on_progress, cancel, executor), make_request)


@naming_missing_file()
def _read_table(file: Path, robot: Any) -> dict[str, Any]:  # noqa: ANN401 - as of `gearbox`
    """Return the units and observations in a table of a weight step, as fields of a request.

    Joints may have numbers if `robot` is stated.

    Raises:
        CampaignError: the file is not understood, or is no weight step.
        OSError: the file cannot be read.
    """
    from jointstiff.service.conversion.prepared import prepare_robot
    from jointstiff.service.imports.formats import read_files, read_sources
    from jointstiff.service.imports.weight_step import is_weight_step, read_weight_step

    model = None
    if robot is not None:
        is_file = isinstance(robot, str | PathLike)
        document = read_robot(str(robot)) if is_file else parse_document(dict(robot), RobotDocument)
        with as_campaign_error("robot"):
            model = prepare_robot(document).robot
    try:
        table, *_ = read_files(read_sources([file]))
        if not is_weight_step(table):
            reason = f"'{file.name}' has no columns of motor and link angles"
            remedy = (
                "name columns `motor [deg]` and `link [deg]`; or use `jointstiff import` for other readings"
            )
            raise CampaignError(http_problem(422, reason, remedy))
        step = read_weight_step(table, () if model is None else model.joint_names)
    except FilesError as error:
        raise CampaignError(problem_from_error(error)) from error
    return step.model_dump(mode="json")


describe_verb(gearbox, GEARBOX)
