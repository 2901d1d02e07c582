"""Inputs from a store."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from jointstiff.schemas.job import Job
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.inputs.inputs import MeasuredRun
from jointstiff.service.problems.errors import NotFoundError, Resource
from jointstiff.service.resources.composition import Resources
from jointstiff.service.resources.stored_jobs import stored_job
from jointstiff.solver.errors import RequestError
from jointstiff.solver.robot.model import Robot


class Stored:
    """Inputs from a store."""

    def __init__(self, resources: Resources) -> None:
        """Fetch from the resources of a store."""
        self._resources = resources

    def robot(self, robot_id: str, where: str) -> tuple[Robot, str]:
        """Return a stored robot, and the hash of its content."""
        with _named_by(where):
            return self._resources.robots.load(robot_id)

    def measured(self, set_id: str, where: str, leave_out: Sequence[str] = ()) -> PreparedSet:
        """Return a stored measurement set without the observations of some labels."""
        with _named_by(where):
            return self._resources.sets.prepared(set_id, leave_out)

    def listed(self, message: type[Job], robot_id: str) -> Iterator[Mapping[str, Any]]:
        """Yield the summaries of the newest jobs of a kind and a robot, 1,000 at most."""
        jobs, cursor = self._resources.store.jobs(Resource(message.kind, message.collection)), None
        for _ in range(10):
            page = jobs.page(limit=100, cursor=cursor, filters={"robot_id": robot_id})
            yield from (record.summary for record in page.records)
            if (cursor := page.next) is None:
                return

    def run(self, run_id: str, where: str) -> MeasuredRun:
        """Return a stored run with its measurement set."""
        with _named_by(where):
            run = stored_job(self._resources.store, Run, run_id)
            return MeasuredRun(run, self._resources.sets.prepared(run.request.measurement_set_id))


@contextmanager
def _named_by(field: str) -> Iterator[None]:
    """Refuse a request whose field names what is not there."""
    try:
        yield
    except NotFoundError as error:
        raise RequestError(error.reason, remedy=error.remedy, where=field) from error
