"""The verb of fleets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from jointstiff.schemas.fleet import FleetOptions
from jointstiff.service.kinds.fleet.kind import FLEET
from jointstiff.service.kinds.verb import (
    Backend,
    JobMonitor,
    Request,
    carry_out_verb,
    describe_verb,
    merge_options,
)

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
        campaigns: campaigns or runs, which are identified with the options of `run`; a `Client` takes the
            last campaign of each stored robot if none are given.
    """

    def make_request(backend: Backend) -> Request:
        """Return the sets to identify, with the options; without sets, the service identifies its robots."""
        sets = [backend.prepare_set(source, f"campaigns[{i}].")[0] for i, source in enumerate(campaigns)]
        request = {"measurement_set_ids": sets} if sets else {}
        return Request(request | merge_options(FleetOptions, options, fields))

    return carry_out_verb(backend, FLEET, JobMonitor(on_progress, cancel, executor), make_request)


describe_verb(fleet, FLEET)
