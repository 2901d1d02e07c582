"""Geometries as jobs: from the readings of sweeps or poses to axes, frames and a robot. They are quick."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from pydantic import BaseModel

from jointstiff.schemas.geometry import Geometry, GeometryRequest, GeometryResult
from jointstiff.service.conversion import (
    to_base_targets,
    to_conventions,
    to_geometry_result,
    to_poses,
    to_sweeps,
)
from jointstiff.service.jobs.kinds import Kind
from jointstiff.service.jobs.work import Span, Work
from jointstiff.service.resources import Robots
from jointstiff.service.store import GeometryRecord, NotFoundError
from jointstiff.solver.errors import InputError, NotObservableError, RequestError
from jointstiff.solver.geometry import Poses, Survey, SweepSet, survey_poses, survey_sweeps
from jointstiff.solver.robot import Robot

__all__ = ["GeometryKind", "GeometryWork"]


class GeometryWork(Work[None]):
    """What a geometry takes: no steps, as it is quick."""

    def __init__(self, request: GeometryRequest, nominal: Robot | None, robot_hash: str) -> None:
        """Check the readings.

        Args:
            request: what was read, and how to identify.
            nominal: the robot as its maker describes it, if that is known.
            robot_hash: of a stored one.

        Raises:
            RequestError: the readings contradict themselves or the nominal model.
        """
        self.robot_id = request.robot_id or ""
        self.content = robot_hash
        self._request, self._nominal = request, nominal
        with _as_request_errors():
            self._readings = _readings(request, nominal)

    def steps(self) -> Sequence[Span]:
        """None."""
        return ()

    def compute(self, span: Span) -> None:
        """There are no steps to carry out."""
        raise ValueError(f"a geometry takes no steps, and {span} is one")

    def encode(self, part: None) -> str:
        """There is nothing to keep."""
        return str(part)

    def decode(self, text: str) -> None:
        """There is nothing that was kept."""

    def conclude(self, parts: Sequence[None]) -> GeometryResult:  # noqa: ARG002 - there are none
        """Identify.

        Raises:
            RequestError: the readings do not determine the robot.
        """
        request, readings = self._request, self._readings
        with _as_request_errors():
            survey = self._survey()
            return to_geometry_result(survey, request.name, readings.joint_map)

    def input_hash(self, request: BaseModel) -> str:
        """SHA-256 of the nominal model, the readings and what is asked for; names and ids do not count."""
        options = request.model_dump_json(exclude={"robot_id": True, "name": True, "robot": {"name"}})
        return hashlib.sha256(f"{self.content} {options}".encode()).hexdigest()

    def _survey(self) -> Survey:
        request, readings = self._request, self._readings
        nominal = self._nominal.chain if self._nominal is not None else None
        conventions = to_conventions(request, readings.targets)
        base_targets = to_base_targets(request, readings.sigma)
        if isinstance(readings, SweepSet):
            return survey_sweeps(
                readings,
                conventions,
                nominal=nominal,
                name=request.name,
                fit=request.fit,
                angles=request.angles,
                base_targets=base_targets,
            )
        if nominal is None:
            raise ValueError("poses calibrate a nominal model, and the request has none")
        return survey_poses(
            readings, conventions, nominal=nominal, name=request.name, base_targets=base_targets
        )


class GeometryKind(Kind[GeometryRequest, Geometry, GeometryRecord]):
    """What a geometry is."""

    name = "geometry"
    unit = "geometries"
    activity = "identifying"
    message = Geometry
    record = GeometryRecord

    def __init__(self, robots: Robots) -> None:
        self._robots = robots

    def work(self, request: GeometryRequest) -> GeometryWork:
        """What a request takes.

        Raises:
            RequestError: there is no such robot, it cannot be used, or the readings contradict themselves.
        """
        if request.robot is not None:
            with _as_request_errors("robot"):
                return GeometryWork(request, self._robots.find(None, request.robot), "")
        if request.robot_id is None:
            return GeometryWork(request, None, "")
        try:
            return GeometryWork(request, *self._robots.load(request.robot_id))
        except NotFoundError as error:
            raise RequestError(error.reason, remedy=error.remedy, where="robot_id") from error

    def details(self, request: GeometryRequest) -> dict[str, object]:
        """Its name."""
        return {"name": request.name}

    def row(self, job: Geometry, robot_id: str) -> GeometryRecord:
        """A geometry as the store keeps it."""
        return GeometryRecord(
            id=job.id,
            robot_id=robot_id or None,
            name=job.name,
            state=job.state,
            created_at=job.provenance.created_at,
            document=job.model_dump_json(),
        )


def _readings(request: GeometryRequest, nominal: Robot | None) -> SweepSet | Poses:
    if request.sweeps is None and nominal is not None:
        return to_poses(request, nominal)
    return to_sweeps(request, nominal)


@contextmanager
def _as_request_errors(section: str | None = None) -> Iterator[None]:
    """Readings that determine no robot are refused, not stored: nothing can be made of them."""
    try:
        yield
    except (InputError, NotObservableError) as error:
        where = ".".join(part for part in (section, error.where) if part)
        raise RequestError(error.reason, remedy=error.remedy, where=where or None) from error
