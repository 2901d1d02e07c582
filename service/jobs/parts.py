"""The application's parts, composed on a store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from jointstiff.service.jobs.life import Enqueue, Jobs
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.kinds.trend.trends import Trends
from jointstiff.service.resources.composition import Resources
from jointstiff.service.resources.measurement_sets import MeasurementSets
from jointstiff.service.resources.robots import Robots
from jointstiff.service.store.store import Store


@dataclass(frozen=True, eq=False)
class Parts:
    """The application's parts."""

    store: Store  # the store
    robots: Robots  # its robots
    sets: MeasurementSets  # its measurement sets
    jobs: Mapping[str, Jobs]  # its jobs, by the name of their kind
    trends: Trends  # trends of its robots

    @classmethod
    def of(cls, store: Store, enqueue: Enqueue | None = None) -> Parts:
        """Compose the parts on a store; without `enqueue` every job is carried out at once."""
        resources = Resources.of(store)
        jobs = {kind.name: Jobs(kind, resources, enqueue) for kind in KINDS}
        return cls(store, resources.robots, resources.sets, jobs, Trends(store))
