"""The verb of counts."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict, Unpack

from jointstiff.service.kinds.verb import Door, Follow, describe_fields, merge_options

from .kind import SMALL, Small, SmallOptions

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from jointstiff.service.kinds.verb import Cancel, OnProgress, Source


class CountFields(TypedDict, total=False):
    """Options of `count`."""

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
    with Follow(on_progress, cancel, executor) as follow:
        door = door.begun(follow)
        request = {"measurement_set_id": door.measured(campaign)[0]}
        return door.done(SMALL, request | merge_options(SmallOptions, options, fields), {}, follow)


describe_fields(count, SmallOptions)
