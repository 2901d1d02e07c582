"""The verb of corrections: arrays, a table of poses or a robot program in, the same corrected out."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, TypedDict, Unpack

from jointstiff.schemas.correction import CorrectionOptions, are_programs
from jointstiff.service.kinds.correction.kind import CORRECTION
from jointstiff.service.kinds.verb import (
    Backend,
    JobMonitor,
    Request,
    carry_out_verb,
    describe_verb,
    merge_options,
)
from jointstiff.service.problems import naming_missing_file

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.correction import Cut, ProcessLoad, ProgramFrame
    from jointstiff.schemas.deflection import LinkMass
    from jointstiff.service.conversion.units import AnyUnits
    from jointstiff.service.kinds.verb import Cancel, File, Matrix, OnProgress, Vector


class CorrectFields(TypedDict, total=False):
    """Options of `correct`."""

    tool: Vector | Matrix | None
    base: Vector | Matrix | None
    force: Vector | None
    forces: Vector | Matrix | None
    segments: Sequence[ProcessLoad | Mapping[str, Any]]
    loads: File | None
    cut: Cut | Mapping[str, Any] | None
    axes: Literal["robot", "base", "tool", "feed"]
    spindle: Vector | None
    feed: float | None
    start: Vector | None
    load_point: Vector | None
    tools: Sequence[ProgramFrame | Mapping[str, Any]]
    bases: Sequence[ProgramFrame | Mapping[str, Any]]
    world: Vector | None
    flange: Vector | None
    tool_x: Vector | None
    units: AnyUnits
    accuracy_option: Literal["off", "same_as_measured", "compensates_load"] | None
    max_displacement: float | None
    max_rotation: float | None
    ramp_length: float
    leave_alone: Sequence[str]
    trust_routines: bool
    leave_others: bool
    external_axes: Literal["carry_nothing"] | None
    format: Literal["csv", "krl", "fanuc", "rapid", "ur"] | None
    mark: bool
    absolute: bool
    masses: Sequence[LinkMass | Mapping[str, Any]]
    confidence: float
    accept_verdict: Literal["do_not_use"] | None


def correct(
    backend: Backend,
    source: Any,  # noqa: ANN401 - a run, a campaign, or a robot
    poses: Any,  # noqa: ANN401 - an array, a file, or the files of a program
    /,
    joints: Matrix | None = None,
    *,
    options: CorrectionOptions | None = None,
    on_progress: OnProgress | None = None,
    cancel: Cancel | None = None,
    executor: Executor | None = None,
    **fields: Unpack[CorrectFields],
) -> Any:  # noqa: ANN401 - a `Correction`, or a `CorrectionJob` of a program
    """Correct poses of a tool, so that the loaded tool is where each of them says.

    Args:
        source: run that `identify` returned, or a campaign, which is identified first; or, for poses, an arm
            that was not measured: a robot document, or the name of an arm of the catalogue.
        poses: poses of the tool in the base: an array (N, 4, 4), an array (N, 6) of X, Y, Z and rotation
            vector, or a CSV or Parquet file with units in its headers. Or a robot program: its file, or a
            list of its files, such as a .src with its .dat, and the table of `loads`.
        joints: (N, n) controller's joints of the poses, if they are known: a wrong tool, base, world or unit
            is then refused, and frames that fit are proposed.
        fields: fields of `CorrectionOptions`; for poses, `tool` and `base` also as (4, 4), and `forces` (3,),
            (N, 3) or rows (K, 4) of path length and force.

    Raises:
        TypeError: `options` and `units` are both given, or arguments of poses with a program.
    """
    monitor = JobMonitor(on_progress, cancel, executor)
    stated = dict[str, Any](fields)
    files = list_program_files(poses, stated.get("format") or (None if options is None else options.format))
    if files:
        if joints is not None or "forces" in stated:
            raise TypeError("`joints` and `forces` are for poses: omit them for a program")

        def make_request(backend: Backend) -> Request:
            """Return the run and the files, with the options."""
            request: dict[str, Any] = {"run_id": backend.prepare_run(source, executor)}
            contents, named_options = _read_files(files, stated)
            return Request(request | merge_options(CorrectionOptions, options, named_options), contents)

        return carry_out_verb(backend, CORRECTION, monitor, make_request)
    if options is not None:
        if "units" in stated:
            raise TypeError("`options` already state units: omit `units`")
        stated = options.model_dump(exclude_unset=True) | stated
    with monitor:
        return backend.start_call(monitor).correct_poses(source, poses, joints, stated, monitor)


def list_program_files(poses: Any, format_: str | None) -> list[Path]:  # noqa: ANN401 - as of `correct`
    """Return the paths of the files of a program; none for an array, or for a file of poses."""
    files = poses if isinstance(poses, list | tuple) else [poses]
    if not files or not all(isinstance(file, str | PathLike) for file in files):
        return []
    paths = list(map(Path, files))
    is_program = len(paths) > 1 or are_programs([path.name for path in paths], format_)
    return paths if is_program else []


@naming_missing_file()
def _read_files(paths: Sequence[Path], fields: Mapping[str, Any]) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Read the files of a program and its table of loads; return contents by name, and fields of a request.

    `loads` may be the path of the table, or only the name of a table that is one of `paths`.

    Raises:
        OSError: a file cannot be read.
    """
    options, read = dict(fields), list(paths)
    table = options.get("loads")
    if table is not None and Path(table).is_file():
        options["loads"] = Path(table).name
        read.append(Path(table))
    return {path.name: path.read_bytes() for path in read}, options


_OUTCOME: Final = """
Returns:
    Corrected rows. Their arrays are in SI units (m, rad, rad/s), whatever the units of the call; `to_frame`
    and `save` write the units of the call in headers. Of a program, the job with its result in SI units:
    `save` writes the corrected files.

Raises:
    CampaignError: source, poses or options cannot be used, or the correction was cancelled. A single row
        never raises an error: see `status`.
    RefusedError: the service refuses the request.
    OSError: a file cannot be read.
"""
describe_verb(correct, CORRECTION, _OUTCOME)
