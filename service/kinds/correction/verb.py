"""The verb of corrections: arrays or a table of poses in, corrected arrays out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, Literal, TypedDict, Unpack

from jointstiff.schemas.correction import CorrectionOptions
from jointstiff.service.kinds.correction.kind import CORRECTION
from jointstiff.service.kinds.verb import Backend, JobMonitor, describe_verb

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.deflection import LinkMass
    from jointstiff.service.conversion.units import AnyUnits
    from jointstiff.service.kinds.verb import Cancel, Matrix, OnProgress, Vector


class CorrectFields(TypedDict, total=False):
    """Options of `correct`."""

    tool: Vector | Matrix | None
    base: Vector | Matrix | None
    force: Vector | None
    forces: Vector | Matrix | None
    axes: Literal["robot", "base", "tool", "feed"]
    feed: float | None
    start: Vector | None
    load_point: Vector | None
    units: AnyUnits
    accuracy_option: Literal["off", "same_as_measured", "compensates_load"]
    max_displacement: float | None
    max_rotation: float | None
    absolute: bool
    masses: Sequence[LinkMass | Mapping[str, Any]]
    confidence: float
    accept_verdict: Literal["do_not_use"] | None


def correct(
    backend: Backend,
    source: Any,  # noqa: ANN401 - a run, a campaign, or a robot
    poses: Any,  # noqa: ANN401 - an array, or a file
    /,
    joints: Matrix | None = None,
    *,
    options: CorrectionOptions | None = None,
    on_progress: OnProgress | None = None,
    cancel: Cancel | None = None,
    executor: Executor | None = None,
    **fields: Unpack[CorrectFields],
) -> Any:  # noqa: ANN401 - a `Correction`
    """Correct poses of a tool, so that the loaded tool is where each of them says.

    Args:
        source: run that `identify` returned, or a campaign, which is identified first; or an arm that was not
            measured: a robot document, or the name of an arm of the catalogue.
        poses: poses of the tool in the base: an array (N, 4, 4), an array (N, 6) of X, Y, Z and rotation
            vector, or a CSV or Parquet file with units in its headers.
        joints: (N, n) controller's joints of the poses, if they are known: a wrong tool, base, world or unit
            is then refused, and frames that fit are proposed.
        fields: fields of `CorrectionOptions`; `tool` and `base` also as (4, 4), and `forces` (3,), (N, 3) or
            rows (K, 4) of path length and force.

    Raises:
        TypeError: `options` and `units` are both given.
    """
    stated = dict[str, Any](fields)
    if options is not None:
        if "units" in stated:
            raise TypeError("`options` already state units: omit `units`")
        stated = options.model_dump(exclude_unset=True) | stated
    with JobMonitor(on_progress, cancel, executor) as monitor:
        return backend.start_call(monitor).correct_poses(source, poses, joints, stated, monitor)


_OUTCOME: Final = """
Returns:
    Corrected rows. Its arrays are in SI units (m, rad, rad/s), whatever the units of the call; `to_frame` and
    `save` write the units of the call in headers.

Raises:
    CampaignError: source, poses or options cannot be used, or the correction was cancelled. A single row
        never raises an error: see `status`.
    RefusedError: the service refuses the request.
    OSError: a file of poses cannot be read.
"""
describe_verb(correct, CORRECTION, _OUTCOME)
