"""The work that the request of each kind of job takes, with the resources that it names."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from jointstiff.schemas.comparison import ComparisonRequest
from jointstiff.schemas.geometry.message import GeometryRequest
from jointstiff.schemas.map import MapRequest
from jointstiff.schemas.pair import PairRequest
from jointstiff.schemas.plan import PlanRequest
from jointstiff.schemas.program import ProgramRequest
from jointstiff.schemas.run.options import RunOptions
from jointstiff.schemas.run.run import Run, RunRequest
from jointstiff.service.kinds.comparison.work import ComparisonWork
from jointstiff.service.kinds.geometry.work import as_request_errors, geometry_work
from jointstiff.service.kinds.map.work import MapWork
from jointstiff.service.kinds.pair.work import Side, pair_work
from jointstiff.service.kinds.plan.work import Planned, plan_work
from jointstiff.service.kinds.program.work import ProgramWork
from jointstiff.service.kinds.run.work import run_work
from jointstiff.service.kinds.work import QuickWork, SteppedWork
from jointstiff.service.problems.errors import NotFoundError
from jointstiff.service.resources.composition import Resources
from jointstiff.service.resources.stored_jobs import stored_job
from jointstiff.solver.errors import RequestError


def run(resources: Resources, request: RunRequest) -> SteppedWork[Any]:
    """Return the work of a run.

    Raises:
        RequestError: there is no such set, or the readings cannot support what is asked for.
    """
    with _named_by("measurement_set_id"):
        prepared = resources.sets.prepared(request.measurement_set_id, request.leave_out)
    return run_work(prepared, request)


def comparison(resources: Resources, request: ComparisonRequest) -> ComparisonWork:
    """Return the work of a comparison.

    Raises:
        RequestError: there is no such set, or draws that cannot be made.
    """
    with _named_by("measurement_set_id"):
        prepared = resources.sets.prepared(request.measurement_set_id)
    return ComparisonWork(prepared, request)


def pair(resources: Resources, request: PairRequest) -> QuickWork:
    """Return the work of a pair.

    Raises:
        RequestError: a set or a run is not there, the robots' joints differ, or the readings cannot support
            what is asked for.
    """
    return pair_work(_side(resources, "first", request), _side(resources, "second", request), request)


def geometry(resources: Resources, request: GeometryRequest) -> QuickWork:
    """Return the work of a geometry.

    Raises:
        RequestError: there is no such robot, it cannot be used, or the readings contradict themselves.
    """
    if request.robot is not None:
        with as_request_errors("robot"):
            return geometry_work(request, resources.robots.find(None, request.robot))
    if request.robot_id is None:
        return geometry_work(request, None)
    with _named_by("robot_id"):
        robot, content = resources.robots.load(request.robot_id)
    return geometry_work(request, robot, content)


def plan(resources: Resources, request: PlanRequest) -> QuickWork:
    """Return the work of a plan.

    Raises:
        RequestError: there is no such robot or set.
    """
    if request.measurement_set_id is None:
        with _named_by("robot_id"):
            robot, content = resources.robots.load(str(request.robot_id))
        return plan_work(Planned(robot, str(request.robot_id), content), request)
    with _named_by("measurement_set_id"):
        prepared = resources.sets.prepared(request.measurement_set_id)
    return plan_work(Planned(prepared.robot, prepared.robot_id, prepared.content, prepared), request)


def map_places(resources: Resources, request: MapRequest) -> MapWork:
    """Return the work of a map.

    Raises:
        RequestError: there is no such run, it has no model that predicts, or the request does not fit it.
    """
    with _named_by("run_id"):
        run = stored_job(resources.store, Run, request.run_id)
        prepared = resources.sets.prepared(run.request.measurement_set_id)
    return MapWork(prepared.robot, prepared.robot_id, run, request)


def program(resources: Resources, request: ProgramRequest) -> ProgramWork:
    """Return the work of a compensated program.

    Raises:
        RequestError: there is no such run, it has no model, or the program is not understood.
    """
    with _named_by("run_id"):
        found = stored_job(resources.store, Run, request.run_id)
        prepared = resources.sets.prepared(found.request.measurement_set_id)
    return ProgramWork(prepared.robot, prepared.robot_id, found, request)


def _side(resources: Resources, name: str, request: PairRequest) -> Side:
    side = request.first if name == "first" else request.second
    set_id, options = side.measurement_set_id, RunOptions.model_validate(request.options)
    leave_out: list[str] = []
    if side.run_id is not None:
        with _named_by(f"{name}.run_id"):
            asked = stored_job(resources.store, Run, side.run_id).request
        set_id, options, leave_out = asked.measurement_set_id, asked, asked.leave_out
    with _named_by(f"{name}.measurement_set_id"):
        prepared = resources.sets.prepared(str(set_id), leave_out)
    return Side(name, str(set_id), prepared, request.options_at(options))


@contextmanager
def _named_by(field: str) -> Iterator[None]:
    """Refuse a request whose field names what is not there."""
    try:
        yield
    except NotFoundError as error:
        raise RequestError(error.reason, remedy=error.remedy, where=field) from error
