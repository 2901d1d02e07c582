"""The verb of maps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypedDict, Unpack

from jointstiff.schemas.deflection import MapOptions
from jointstiff.service.kinds.map.kind import MAP
from jointstiff.service.kinds.verb import (
    Backend,
    JobMonitor,
    Request,
    carry_out_verb,
    describe_verb,
    merge_options,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.deflection import Map
    from jointstiff.service.conversion.units import AnyUnits
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
        run: what `identify` returned, or a campaign, which is identified now.
    """

    def make_request(backend: Backend) -> Request:
        """Return the run to map, with the options."""
        request = {"run_id": backend.prepare_run(run, executor)}
        return Request(request | merge_options(MapOptions, options, fields, lambda: backend.joint_kinds(run)))

    return carry_out_verb(backend, MAP, JobMonitor(on_progress, cancel, executor), make_request)


describe_verb(map, MAP)
