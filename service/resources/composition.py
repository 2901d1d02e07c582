"""The resources of a store, composed."""

from __future__ import annotations

from dataclasses import dataclass

from jointstiff.service.resources.measurement_sets import MeasurementSets
from jointstiff.service.resources.robots import Robots
from jointstiff.service.store.store import Store


@dataclass(frozen=True, eq=False)
class Resources:
    """The resources of a store."""

    store: Store  # the store
    robots: Robots  # its robots
    sets: MeasurementSets  # its measurement sets

    @classmethod
    def of(cls, store: Store) -> Resources:
        """Compose the resources on a store."""
        robots = Robots(store)
        return cls(store, robots, MeasurementSets(store, robots))
