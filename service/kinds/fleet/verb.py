"""The verb of fleets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from jointstiff.schemas.fleet import FleetOptions
from jointstiff.service.kinds.fleet.kind import FLEET
from jointstiff.service.kinds.verb import Backend, JobMonitor, describe_fields, merge_options

if TYPE_CHECKING:
    from collections.abc import Mapping
    from concurrent.futures import Executor

    from jointstiff.schemas.fleet import Fleet
    from jointstiff.schemas.options import RunOptions
    from jointstiff.service.conversion.arguments import AnyUnits
    from jointstiff.service.kinds.verb import Cancel, OnProgress, Source


class FleetFields(TypedDict, total=False):
    """Options of `fleet`."""

    units: AnyUnits
    name: str | None
    run: RunOptions | Mapping[str, Any]


def fleet(
    backend: Backend,
    *campaigns: Source,
    options: FleetOptions | None = None,
    on_progress: OnProgress | None = None,
    cancel: Cancel | None = None,
    executor: Executor | None = None,
    **fields: Unpack[FleetFields],
) -> Fleet:
    """Identify the campaigns of many robots in one job.

    Args:
        backend: `Here` or a `Client`, which has this function as a method and does the work.
        campaigns: campaigns or runs, which are identified with the options of `run`; a `Client` takes the
            last campaign of each stored robot if none are given.
        options: a `FleetOptions`; keyword arguments replace options of the same name.
        on_progress: called with the progress of a job that takes steps; default: a bar in a terminal or a
            notebook, if it takes more than 2 s.
        cancel: called between steps, such as `threading.Event().is_set`; if true, the job ends as
            `cancelled`.
        executor: carries out the steps, such as a `concurrent.futures.ProcessPoolExecutor()` or a Dask
            client's `get_executor()`; all numbers are the same to the last bit. A `Client` refuses an
            executor.
        fields: fields of `FleetOptions`.

    Returns:
        The Fleet, with its result in SI units. If the computation fails, its state is `failed`.

    Raises:
        CampaignError: a source or an option cannot be used; the error's `problem` has reason and remedy.
        RefusedError: the service refuses the request.
        OSError: a file cannot be read.
    """
    with JobMonitor(on_progress, cancel, executor) as monitor:
        backend = backend.start_call(monitor)
        sets = [backend.prepare_set(source, f"campaigns[{i}].")[0] for i, source in enumerate(campaigns)]
        request = {"measurement_set_ids": sets} if sets else {}
        return backend.carry_out_request(
            FLEET, request | merge_options(FleetOptions, options, fields), {}, monitor
        )


describe_fields(fleet, FleetOptions)
