"""Robots and measurement sets as stored resources."""

from __future__ import annotations

from dataclasses import dataclass

from jointstiff.service.problems import FilesError
from jointstiff.service.resources.imports import import_files
from jointstiff.service.resources.measurement_sets import MeasurementSets, assembled
from jointstiff.service.resources.robots import Robots
from jointstiff.service.resources.stored_jobs import stored_job
from jointstiff.service.store import Store

__all__ = [
    "FilesError",
    "MeasurementSets",
    "Resources",
    "Robots",
    "assembled",
    "import_files",
    "stored_job",
]


@dataclass(frozen=True, eq=False)
class Resources:
    """The resources of a store.

    Attributes:
        store: the store.
        robots: its robots.
        sets: its measurement sets.
    """

    store: Store
    robots: Robots
    sets: MeasurementSets

    @classmethod
    def of(cls, store: Store) -> Resources:
        """Compose the resources on a store."""
        robots = Robots(store)
        return cls(store, robots, MeasurementSets(store, robots))
