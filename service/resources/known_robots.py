"""Arms of the catalogue, which may have been measured by mistake in place of the robot of a campaign."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import cache

from jointstiff.service.conversion.catalogue import catalogue, nominal_robot
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.solver.mechanics.robot import KnownRobot


def catalogue_robots(excluded: Collection[str] = ()) -> Iterator[KnownRobot]:
    """Yield the arms of the catalogue, except arms whose content hash is in `excluded`."""
    yield from (arm for content_hash, arm in build_nominal_robots() if content_hash not in excluded)


@cache
def build_nominal_robots() -> tuple[tuple[str, KnownRobot], ...]:
    """Return (content hash, robot) for all arms of the catalogue; cached, as building them takes time."""
    prepared = [(arm.name, prepare_robot(nominal_robot(arm))) for arm in catalogue().arms]
    return tuple((each.content_hash, KnownRobot(name, each.robot)) for name, each in prepared)
