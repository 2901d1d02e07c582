"""The verb of processes."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, Unpack

from jointstiff.schemas.measurement import Units
from jointstiff.schemas.process import ProcessOptions
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.kinds.process.kind import PROCESS
from jointstiff.service.kinds.program.verb import CompensateFields, gather_files
from jointstiff.service.kinds.verb import (
    Backend,
    JobMonitor,
    Request,
    carry_out_verb,
    describe_verb,
    merge_options,
)
from jointstiff.service.problems import CampaignError, as_campaign_error, http_problem
from jointstiff.service.resources.documents import read_plan_source

if TYPE_CHECKING:
    from collections.abc import Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.process import Process
    from jointstiff.service.kinds.verb import Cancel, File, Matrix, OnProgress, Source, Vector
    from jointstiff.solver.arrays import FloatArray


class ProcessFields(CompensateFields, total=False):
    """Options of `process`: those of `compensate`, and what may be chosen."""

    turn: Literal["free", "keep"] | Vector
    turns: int
    branches: Literal["keep", "free"]
    feed: float | None
    rate: float
    clearance: float
    objective: Literal["rms", "greatest"]
    place: Matrix | None
    grid: Sequence[int]
    place_turns: int
    correct: bool
    force_uncertainty: float | None


def process(
    backend: Backend,
    source: Source | RobotDocument,
    /,
    *path: File | Matrix,
    forces: Vector | Matrix | Mapping[str, Any] | File | None = None,
    options: ProcessOptions | None = None,
    on_progress: OnProgress | None = None,
    cancel: Cancel | None = None,
    executor: Executor | None = None,
    **fields: Unpack[ProcessFields],
) -> Process:
    """Turn the tool and place the workpiece for the least deflection along a path.

    Args:
        source: what `identify` returned, or a campaign, which is identified now; or an arm that was not
            measured: a robot document, or the name of an arm of the catalogue.
        path: the program, a .src with its .dat, or a CSV table of poses; or an array of poses of the tool
            in R0, in the units of the call: (N, 4, 4), or (N, 6) with X, Y, Z and rotation vector. The tool
            is the flange unless `tools` states another.
        forces: one force (3,); forces (N, 3) of the points of an array; a table (K, 4) of lengths along the
            path and forces, interpolated at the points; a milling cut (fields of `Cut`); or the CSV file of
            a load for each point or length. Forces are along `axes`.
        fields: fields of `ProcessOptions`, and `force`, short for `load`.

    Raises:
        CampaignError: there are several arrays of poses, or an array of forces has another shape.
    """
    from jointstiff.service.conversion.arguments import complete_units

    def make_request(backend: Backend) -> Request:
        """Return the arm and the path, with forces and options."""
        named_options = dict[str, Any](fields)
        request = _prepare_arm(backend, source, executor)
        if options is None:
            request["accuracy_option"] = "off"
        stated_units = named_options.get("units", None if options is None else options.units)
        with as_campaign_error(""):
            units = complete_units(stated_units)
        contents = dict[str, bytes]()
        arrays = [each for each in path if not isinstance(each, str | PathLike)]
        if arrays:
            contents[_PATH] = _pack_path(arrays, units)
            request |= _DEFAULTS
        if forces is not None:
            stated = _state_forces(forces, units)
            named_options |= stated.options
            contents |= stated.contents
        files = [Path(each) for each in path if isinstance(each, str | PathLike)]
        files_sent, named_options = gather_files(files, named_options)
        request |= merge_options(ProcessOptions, options, named_options)
        return Request(request, contents | files_sent)

    return carry_out_verb(backend, PROCESS, JobMonitor(on_progress, cancel, executor), make_request)


def _prepare_arm(
    backend: Backend, source: Source | RobotDocument, executor: Executor | None
) -> dict[str, Any]:
    """Return the field of a request that names the arm: the id of a run or, of an unmeasured arm, of a robot.

    A run is used as it is, and a campaign is identified; a robot, or the name of an arm, has no run.
    """
    described = source if isinstance(source, RobotDocument) else read_plan_source(source)
    if isinstance(described, RobotDocument):
        return {"robot_id": backend.prepare_robot(described)}
    return {"run_id": backend.prepare_run(described, executor)}


_PATH: Final = "path.npz"
"""Name of an array of poses among the files of a request."""
_FORCES: Final = "forces.npz"
"""Name of an array of forces."""
_FRAME: Final = [{"values": [0.0] * 6}]
_DEFAULTS: Final = {"tools": _FRAME, "bases": _FRAME, "branches": "free", "format": "csv"}
"""Options of an array of poses, unless others are stated: the tool is the flange, the base is R0."""


def _pack_path(arrays: list[Any], units: Mapping[str, str]) -> bytes:
    """Pack an array of poses as numbers, with their units.

    Raises:
        CampaignError: there are several arrays, the array has another shape, or a matrix is no pose.
    """
    from jointstiff.service.runs.correction.columns import make_sheet
    from jointstiff.service.runs.correction.poses import name_poses
    from jointstiff.service.tables.packed import pack_sheet

    if len(arrays) > 1:
        raise CampaignError(
            http_problem(
                422,
                f"the path is {len(arrays)} arrays, but must be one array of poses, (N, 4, 4) or (N, 6)",
                "join parts of a path by `numpy.concatenate`; give an array of forces as `forces=`",
            )
        )
    stated_units = Units.model_validate(units)
    with as_campaign_error(""):
        columns = name_poses(arrays[0], "path", stated_units)
    return pack_sheet(make_sheet(columns, stated_units, []))


class _StatedForces(NamedTuple):
    """Forces along a path, as a request states them."""

    options: dict[str, Any]  # fields of `ProcessOptions`
    contents: Mapping[str, bytes] = MappingProxyType({})  # contents of files by name


def _state_forces(forces: Any, units: Mapping[str, str]) -> _StatedForces:  # noqa: ANN401 - arrays, files
    """Return the options that state forces; an array with a force for each point is packed as a file.

    Raises:
        CampaignError: the forces are no numbers, or an array of forces has another shape.
    """
    from jointstiff.service.conversion.arrays import read_numbers

    if isinstance(forces, str | PathLike):
        return _StatedForces({"loads": forces})
    if isinstance(forces, Mapping) or hasattr(forces, "model_dump"):
        return _StatedForces({"cut": forces})
    with as_campaign_error(""):
        array = read_numbers(forces, "forces", "give an array, or lists of equal lengths, of numbers")
    if array.shape == (3,):
        return _StatedForces({"force": array.tolist()})
    if array.ndim == 2 and array.shape[1] in {3, 4}:
        return _StatedForces({"loads": _FORCES}, {_FORCES: _pack_forces(array, units)})
    problem = http_problem(
        422,
        f"`forces` has shape {array.shape}",
        "give one force (3,), a force for each point (N, 3), or rows of path length and force (K, 4)",
    )
    raise CampaignError(problem.model_copy(update={"where": "forces"}))


def _pack_forces(array: FloatArray, units: Mapping[str, str]) -> bytes:
    """Pack forces with their units: (N, 3) of points, which get numbers from 1; or (K, 4) behind lengths."""
    import numpy as np

    from jointstiff.service.tables.packed import pack_sheet
    from jointstiff.service.tables.table import Sheet

    first = f"length [{units['length']}]"
    if array.shape[1] == 3:
        first = "point"
        array = np.column_stack([np.arange(1, len(array) + 1), array])
    headers = [first, *(f"F{axis} [{units['force']}]" for axis in "xyz")]
    return pack_sheet(Sheet(dict(zip(headers, array.T, strict=True))))


describe_verb(process, PROCESS)
