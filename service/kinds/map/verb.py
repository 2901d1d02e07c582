"""The verb of maps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypedDict, Unpack

from jointstiff.schemas.deflection import MapOptions
from jointstiff.service.kinds.map.kind import MAP
from jointstiff.service.kinds.verb import Backend, JobMonitor, describe_fields, merge_options

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.deflection import Map
    from jointstiff.service.conversion.arguments import AnyUnits
    from jointstiff.service.kinds.verb import Cancel, Matrix, OnProgress, Source, Vector


class MapFields(TypedDict, total=False):
    """Options of `map`."""

    units: AnyUnits
    absolute: bool
    accept_verdict: Literal["do_not_use"] | None
    name: str | None
    area: Matrix
    grid: Sequence[int]
    place: Vector
    load_point: Vector | None
    tool_axis: Vector
    directions: Matrix
    turns: int
    force: Vector
    moment: Vector | None
    axes: Literal["base", "flange"]
    direction: Vector | None
    limits: Mapping[str, Vector]
    near: Vector | None
    confidence: float


def map(  # noqa: A001 - the name of the command
    backend: Backend,
    run: Source,
    /,
    options: MapOptions | None = None,
    *,
    on_progress: OnProgress | None = None,
    cancel: Cancel | None = None,
    executor: Executor | None = None,
    **fields: Unpack[MapFields],
) -> Map:
    """Map deflection and compliance over a work area.

    Args:
        backend: `Here` or a `Client`, which has this function as a method and does the work.
        run: what `identify` returned, or a campaign, which is identified now.
        options: a `MapOptions`; keyword arguments replace options of the same name.
        on_progress: called with the progress of a job that takes steps; default: a bar in a terminal or a
            notebook, if it takes more than 2 s.
        cancel: called between steps, such as `threading.Event().is_set`; if true, the job ends as
            `cancelled`.
        executor: carries out the steps, such as a `concurrent.futures.ProcessPoolExecutor()` or a Dask
            client's `get_executor()`; all numbers are the same to the last bit. A `Client` refuses an
            executor.
        fields: fields of `MapOptions`.

    Returns:
        The Map, with its result in SI units. If the computation fails, its state is `failed`.

    Raises:
        CampaignError: a source or an option cannot be used; the error's `problem` has reason and remedy.
        RefusedError: the service refuses the request.
        OSError: a file cannot be read.
    """
    with JobMonitor(on_progress, cancel, executor) as monitor:
        backend = backend.start_call(monitor)
        request = {"run_id": backend.prepare_run(run, executor)}
        request |= merge_options(MapOptions, options, fields, lambda: backend.joint_kinds(run))
        return backend.carry_out_request(MAP, request, {}, monitor)


describe_fields(map, MapOptions)
