"""The verb of counts."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict, Unpack

from jointstiff.service.kinds.verb import Backend, JobMonitor, describe_fields, merge_options

from .kind import SMALL, Small, SmallOptions

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from jointstiff.service.conversion.arguments import AnyUnits
    from jointstiff.service.kinds.verb import Cancel, OnProgress, Source


class CountFields(TypedDict, total=False):
    """Options of `count`."""

    units: AnyUnits
    least: int


def count(
    backend: Backend,
    campaign: Source,
    /,
    options: SmallOptions | None = None,
    *,
    on_progress: OnProgress | None = None,
    cancel: Cancel | None = None,
    executor: Executor | None = None,
    **fields: Unpack[CountFields],
) -> Small:
    """Count the readings of a set."""
    with JobMonitor(on_progress, cancel, executor) as monitor:
        backend = backend.start_call(monitor)
        request = {"measurement_set_id": backend.prepare_set(campaign)[0]}
        return backend.carry_out_request(
            SMALL, request | merge_options(SmallOptions, options, fields), {}, monitor
        )


describe_fields(count, SmallOptions)
