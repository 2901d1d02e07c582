"""A map as work: blocks of places, each a step; and its table, made again from the request."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Final

from jointstiff.schemas.map import MapOptions, MapRequest, MapResult
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.readings import hash_of
from jointstiff.service.inputs import Inputs
from jointstiff.service.kinds.acceptance import accepted_run
from jointstiff.service.kinds.deflection.models import to_own_weight
from jointstiff.service.kinds.deflection.work import assessment_of, forward_model, remarks_of
from jointstiff.service.kinds.map.places import (
    to_map_result,
    to_map_task,
    to_places,
)
from jointstiff.service.kinds.work import Arrays, Span, Work
from jointstiff.solver.errors import RequestError, RobotError
from jointstiff.solver.predict.maps import DeflectionMap, map_places
from jointstiff.solver.robot.inverse import InverseKinematics
from jointstiff.solver.robot.model import Robot

POSES_A_STEP: Final = 10_000
"""Places times orientations of a quarter of a second."""
_ELASTIC: Final = 5
"""Postures in whose time and memory those with elastic links take one."""


class MapWork(Work):
    """The work of a map, its units the places; one that takes a single step is quick."""

    unit = "places"
    activity = "mapping"

    def __init__(self, robot: Robot, robot_id: str, run: Run, request: MapOptions) -> None:
        """Check what is asked for.

        Raises:
            RequestError: the run has no model that predicts, or the request does not fit the robot.
        """
        self.robot_id = robot_id
        self.robot, self._run, self.request = robot, run, request
        options = request.model_dump_json(exclude={"run_id", "name"})
        self.input_hash = hash_of(run.provenance.input_hash, options)
        self._model, self._error = forward_model(robot, run, to_own_weight(request, robot, run))
        self._task, self.places = to_map_task(request, robot), to_places(request)
        try:
            self._inverse = InverseKinematics(robot)
        except RobotError as error:
            raise RequestError(error.reason, where="run_id", remedy=error.remedy) from error

    def steps(self) -> tuple[Span, ...]:
        """Return the places in blocks; none where one block holds them all."""
        blocks = self._blocks()
        return blocks if len(blocks) > 1 else ()

    def compute(self, span: Span) -> Arrays:
        """Map some of the places.

        Raises:
            JointstiffError: a load finds no stable balance.
        """
        return vars(self._mapped(span))

    def _mapped(self, span: Span) -> DeflectionMap:
        places = self.places[slice(*span)]
        return map_places(self._model, self._error, self._task, self._inverse, places)

    def conclude(self, parts: Sequence[Arrays]) -> MapResult:
        """Return the summary.

        Raises:
            JointstiffError: as `compute` does.
        """
        table = DeflectionMap.joined([DeflectionMap(**part) for part in parts]) if parts else self.table
        error, run = self._error, self._run
        return to_map_result(
            self.request,
            self._task,
            self.places,
            table,
            model_error_postures=0 if error is None else error.postures,
            assessment=assessment_of(run),
            remarks=remarks_of(run, self._model, error, self.request.confidence),
        )

    @cached_property
    def table(self) -> DeflectionMap:
        """All places; the same numbers each time, as a run never changes."""
        return DeflectionMap.joined([self._mapped(span) for span in self._blocks()])

    def _blocks(self) -> tuple[Span, ...]:
        poses = POSES_A_STEP // _ELASTIC if self._model.first_order else POSES_A_STEP
        size = max(1, poses // len(self._task.rotation))
        return tuple(
            (start, min(start + size, len(self.places))) for start in range(0, len(self.places), size)
        )


def work(inputs: Inputs, request: MapRequest) -> MapWork:
    """Return the work of a map.

    Raises:
        RequestError: there is no such run, it has no model that predicts, or the request does not fit it.
    """
    run = accepted_run(inputs, request)
    return MapWork(run.prepared.robot, run.prepared.robot_id, run.run, request)
