"""The verb of counts."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict, Unpack

from jointstiff.service.kinds.verb import Door, JobMonitor, describe_fields, merge_options

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
    door: Door,
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
        door = door.begun(monitor)
        request = {"measurement_set_id": door.measured(campaign)[0]}
        return door.done(SMALL, request | merge_options(SmallOptions, options, fields), {}, monitor)


describe_fields(count, SmallOptions)
