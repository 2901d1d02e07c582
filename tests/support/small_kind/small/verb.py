"""The verb of counts."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict, Unpack

from jointstiff.service.kinds.verb import (
    Backend,
    JobMonitor,
    Request,
    carry_out_verb,
    describe_verb,
    merge_options,
)

from .kind import SMALL, Small, SmallOptions

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from jointstiff.service.conversion.units import AnyUnits
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

    def make_request(backend: Backend) -> Request:
        """Return the set to count, with the options."""
        request = {"measurement_set_id": backend.prepare_set(campaign)[0]}
        return Request(request | merge_options(SmallOptions, options, fields))

    return carry_out_verb(backend, SMALL, JobMonitor(on_progress, cancel, executor), make_request)


describe_verb(count, SMALL)
