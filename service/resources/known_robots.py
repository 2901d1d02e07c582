"""Robots that may have been measured in place of the chosen one: stored robots, and arms of the catalogue."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import cache

from jointstiff.service.conversion.catalogue import catalogue, nominal_robot
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.solver.integrity.other_robots import KnownRobot


def catalogue_robots(excluded: Collection[str] = ()) -> Iterator[KnownRobot]:
    """Yield the arms of the catalogue, except arms whose content hash is in `excluded`."""
    yield from (known for content, known in nominal_robots() if content not in excluded)


@cache
def nominal_robots() -> tuple[tuple[str, KnownRobot], ...]:
    """Return (content hash, arm) for all arms of the catalogue; cached, as building the arms takes time."""
    prepared = [(arm.name, prepare_robot(nominal_robot(arm))) for arm in catalogue().arms]
    return tuple((each.content_hash, KnownRobot(name, each.robot)) for name, each in prepared)
