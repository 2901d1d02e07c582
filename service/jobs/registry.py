"""The application's parts, composed once, for the service, its workers and the command line alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from jointstiff.schemas.comparison import Comparison, ComparisonRequest
from jointstiff.schemas.geometry import Geometry, GeometryRequest
from jointstiff.schemas.job import Progress
from jointstiff.schemas.pair import Pair, PairRequest
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service.jobs.comparisons import ComparisonKind
from jointstiff.service.jobs.geometries import GeometryKind
from jointstiff.service.jobs.life import Announce, AnyJobs, Jobs
from jointstiff.service.jobs.pairs import PairKind
from jointstiff.service.jobs.runs import RunKind
from jointstiff.service.resources import MeasurementSets, Robots
from jointstiff.service.store import ComparisonRecord, GeometryRecord, PairRecord, RunRecord, Store

__all__ = ["Comparisons", "Geometries", "Pairs", "Parts", "Runs"]

Runs = Jobs[RunRequest, Run, RunRecord]
Comparisons = Jobs[ComparisonRequest, Comparison, ComparisonRecord]
Pairs = Jobs[PairRequest, Pair, PairRecord]
Geometries = Jobs[GeometryRequest, Geometry, GeometryRecord]


@dataclass(frozen=True)
class Parts:
    """The application's parts."""

    store: Store
    robots: Robots
    sets: MeasurementSets
    runs: Runs
    comparisons: Comparisons
    pairs: Pairs
    geometries: Geometries

    @classmethod
    def of(
        cls,
        store: Store,
        announce: Announce | None = None,
        tell: Callable[[Progress], object] | None = None,
    ) -> Parts:
        """Compose the parts on a store; for the others see `Jobs`."""
        robots = Robots(store)
        sets = MeasurementSets(store, robots)
        return cls(
            store=store,
            robots=robots,
            sets=sets,
            runs=Jobs(RunKind(sets), store, announce, tell),
            comparisons=Jobs(ComparisonKind(sets), store, announce, tell),
            pairs=Jobs(PairKind(store, sets), store, announce, tell),
            geometries=Jobs(GeometryKind(robots), store, announce, tell),
        )

    @property
    def jobs(self) -> Mapping[str, AnyJobs]:
        """All jobs, by the name of their kind."""
        return {jobs.kind.name: jobs for jobs in (self.runs, self.comparisons, self.pairs, self.geometries)}
