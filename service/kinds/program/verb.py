"""The verb of programs."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from jointstiff.schemas.program import ProgramOptions
from jointstiff.service.kinds.program.kind import PROGRAM
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

    from jointstiff.schemas.deflection import LinkMass
    from jointstiff.schemas.program import Cut, ProcessLoad, Program, ProgramFrame
    from jointstiff.service.conversion.units import AnyUnits
    from jointstiff.service.kinds.verb import Cancel, File, OnProgress, Source, Vector


class CompensateFields(TypedDict, total=False):
    """Options of `compensate`."""

    absolute: bool
    masses: Sequence[LinkMass | Mapping[str, Any]]
    confidence: float
    accept_verdict: Literal["do_not_use"] | None
    units: AnyUnits
    accuracy_option: Literal["off", "same_as_measured", "compensates_load"]
    load: ProcessLoad | Mapping[str, Any] | None
    segments: Sequence[ProcessLoad | Mapping[str, Any]]
    loads: File | None
    cut: Cut | Mapping[str, Any] | None
    axes: Literal["robot", "tool", "base", "feed"]
    spindle: Vector | None
    load_point: Vector | None
    tools: Sequence[ProgramFrame | Mapping[str, Any]]
    bases: Sequence[ProgramFrame | Mapping[str, Any]]
    world: Vector | None
    flange: Vector | None
    tool_x: Vector | None
    start: Vector | None
    max_displacement: float | None
    max_rotation: float | None
    ramp_length: float
    leave_alone: Sequence[str]
    trust_routines: bool
    leave_others: bool
    external_axes: Literal["carry_nothing"] | None
    format: Literal["csv", "krl", "fanuc", "rapid", "ur"] | None
    mark: bool
    force: Vector


def compensate(
    backend: Backend,
    run: Source,
    /,
    *files: File,
    options: ProgramOptions | None = None,
    on_progress: OnProgress | None = None,
    cancel: Cancel | None = None,
    executor: Executor | None = None,
    **fields: Unpack[CompensateFields],
) -> Program:
    """Compensate a program for the deflection under load.

    Args:
        run: what `identify` returned, or a campaign, which is identified now.
        files: the program, a .src with its .dat; and the table of loads, if `loads` names one.
        fields: fields of `ProgramOptions`, and `force`, short for `load`.
    """

    def make_request(backend: Backend) -> Request:
        """Return the run and the files, with the options."""
        request: dict[str, Any] = {"run_id": backend.prepare_run(run, executor)}
        contents, named_options = gather_files(list(map(_read_path, files)), fields)
        return Request(request | merge_options(ProgramOptions, options, named_options), contents)

    return carry_out_verb(backend, PROGRAM, JobMonitor(on_progress, cancel, executor), make_request)


def _read_path(file: File) -> Path:
    """Return an argument of `compensate` as a path.

    Raises:
        TypeError: the argument is no path.
    """
    if not isinstance(file, str | PathLike):
        raise TypeError(
            f"a program is a file, not a {type(file).__name__}: give the file's name, such as 'drill.src'"
        )
    return Path(file)


@naming_missing_file()
def gather_files(paths: Sequence[Path], fields: Mapping[str, Any]) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Read the files of a program and its table of loads; return contents by name, and fields of a request.

    `loads` may be the path of the table, or only the name of a table that is one of `paths`; `force` is short
    for `load`.

    Raises:
        OSError: a file cannot be read.
    """
    options, read = dict(fields), list(paths)
    if "force" in options:
        options["load"] = {"force": options.pop("force")}
    table = options.get("loads")
    if table is not None and Path(table).is_file():
        options["loads"] = Path(table).name
        read.append(Path(table))
    return {path.name: path.read_bytes() for path in read}, options


describe_verb(compensate, PROGRAM)
