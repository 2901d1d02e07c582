"""The kinds of jobs, declared once; and the application's parts, composed on a store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from jointstiff.schemas.comparison import Comparison, ComparisonRequest, ComparisonSummary
from jointstiff.schemas.geometry.message import Geometry, GeometryRequest, GeometrySummary
from jointstiff.schemas.map import Map, MapRequest, MapSummary
from jointstiff.schemas.pair import Pair, PairRequest, PairSummary
from jointstiff.schemas.plan import Plan, PlanRequest, PlanSummary
from jointstiff.schemas.program import Program, ProgramRequest, ProgramSummary
from jointstiff.schemas.query import (
    ComparisonQuery,
    GeometryQuery,
    MapQuery,
    PairQuery,
    PlanQuery,
    ProgramQuery,
    RunQuery,
)
from jointstiff.schemas.run.run import Run, RunRequest, RunSummary
from jointstiff.service.jobs import works
from jointstiff.service.jobs.kinds import AnyKind, Quick, Stepped
from jointstiff.service.jobs.life import Enqueue, Jobs
from jointstiff.service.kinds.program.work import without_contents
from jointstiff.service.kinds.trend.trends import Trends
from jointstiff.service.resources.composition import Resources
from jointstiff.service.resources.measurement_sets import MeasurementSets
from jointstiff.service.resources.robots import Robots
from jointstiff.service.store.store import Store

_OPTIONS_BYTES: Final = 64 * 1024
_READINGS_BYTES: Final = 4 * 1024 * 1024
_PROGRAM_BYTES: Final = 16 * 1024 * 1024

KINDS: Final[tuple[AnyKind, ...]] = (
    Stepped(
        message=Run,
        request=RunRequest,
        summary=RunSummary,
        query=RunQuery,
        work=works.run,
        max_bytes=_OPTIONS_BYTES,
        description="""Identify the joint stiffnesses, and store the result with its provenance.

Answers 201 with the finished run, or, if it resamples and takes longer than `wait` seconds, 202 with the
run as it is and its address. A method that the readings cannot support is refused, and nothing is stored.
Any other failure is a stored run in state `failed` that says why.""",
    ),
    Stepped(
        message=Comparison,
        request=ComparisonRequest,
        summary=ComparisonSummary,
        query=ComparisonQuery,
        work=works.comparison,
        max_bytes=_OPTIONS_BYTES,
        description="""Identify by several methods, unconstrained and constrained, side by side.

Answers 201 with the finished comparison, or, if it resamples and takes longer than `wait` seconds, 202
with the comparison as it is and its address. A method that the readings cannot support is an entry with
its `error`; the others have their numbers.""",
    ),
    Quick(
        message=Pair,
        request=PairRequest,
        summary=PairSummary,
        query=PairQuery,
        work=works.pair,
        max_bytes=_OPTIONS_BYTES,
        description="""Compare two sides: motor and secondary encoders, before and after, or units A and B.

For each joint: the ratio of its stiffnesses with Fieller's interval, and whether it has changed. For each
observation, and overall: the share of the deflection that the second side avoids, measured where both
sides have the observation, and predicted. With `ordered`, also both sides in one problem in which no
joint is softer on the second.""",
    ),
    Quick(
        message=Geometry,
        request=GeometryRequest,
        summary=GeometrySummary,
        query=GeometryQuery,
        work=works.geometry,
        max_bytes=_READINGS_BYTES,
        description="""Identify a robot's geometry from sweeps of single joints, or from unloaded poses.

Axes, base frame, wrist centre and targets have uncertainties; links are listed with their nominal values,
and the identified model is a robot document that can be posted as `"model": {"format": "geometry", …}`.
Suspicious readings (a bumped tracker, a short arc, a joint map that does not fit, …) are reported as findings
with their figures; readings that do not determine the geometry are refused.""",
    ),
    Quick(
        message=Plan,
        request=PlanRequest,
        summary=PlanSummary,
        query=PlanQuery,
        work=works.plan,
        max_bytes=_READINGS_BYTES,
        description="""Plan which postures and loads to measure, to begin a campaign or to go on with one.

The list comes with a certificate: the least share of the best list's information that it has, proved by a
sweep over all candidates. It says how sure each joint will be, what random and one-at-a-time plans would
give, and how many readings were struck out for which reason. What cannot be planned is refused, saying
what to change, and nothing is stored.""",
    ),
    Stepped(
        message=Map,
        request=MapRequest,
        summary=MapSummary,
        query=MapQuery,
        work=works.map_places,
        max_bytes=_OPTIONS_BYTES,
        description="""Map a work area: how far the tool bends at each place, by the model of a run.

Each place takes the stiffest posture, or the nearest to a given one, of all branches of the inverse
kinematics and all orientations of the tool within the joints' limits; its deflection is the exact balance
of springs and load, with both intervals. The answer is a summary; `map.csv` and `map.npz` have all places.
201 with the finished map, or 202 if it takes longer than `wait` seconds.""",
    ),
    Stepped(
        message=Program,
        request=ProgramRequest,
        summary=ProgramSummary,
        query=ProgramQuery,
        work=works.program,
        max_bytes=_PROGRAM_BYTES,
        is_form=True,
        answered=without_contents,
        description="""Correct the targets of a robot program, so that the loaded tool is where they say.

Send the program as fields `files` of a form (a .src with its .dat, if it has one), and the run, tool,
base, loads and the state of
the controller's accuracy option as JSON in a field `options`. Only numbers change: the corrected files
are at /program, every
point with its deflection, correction, interval and predicted residual at /points.csv. A program that is
not understood
as a whole is refused by line, and nothing is stored. Programs of more than 10,000 targets are jobs with
progress.""",
    ),
)
"""All kinds of jobs: routes, listings, the index, deletion, addresses and tests iterate over them."""


@dataclass(frozen=True, eq=False)
class Parts:
    """The application's parts."""

    store: Store  # the store
    robots: Robots  # its robots
    sets: MeasurementSets  # its measurement sets
    jobs: Mapping[str, Jobs]  # its jobs, by the name of their kind
    trends: Trends  # of its robots

    @classmethod
    def of(cls, store: Store, enqueue: Enqueue | None = None) -> Parts:
        """Compose the parts on a store; without `enqueue` every job is carried out at once."""
        resources = Resources.of(store)
        jobs = {kind.name: Jobs(kind, resources, enqueue) for kind in KINDS}
        return cls(store, resources.robots, resources.sets, jobs, Trends(store))
