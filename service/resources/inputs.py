"""Inputs that a request names by id: they are fetched, never computed; here from files.

`Resources` fetches them from a store.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol
from uuid import uuid4

from jointstiff.schemas.job import Job
from jointstiff.schemas.measurement import MeasurementSetDocument
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.prepared import PreparedRobot, PreparedSet, prepare_set, without
from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.robot import Robot


@dataclass(frozen=True, eq=False)
class MeasuredRun:
    """A run, and the measurement set that it identified."""

    run: Run
    prepared: PreparedSet  # all observations of the set, those that the run left out included


@dataclass(frozen=True)
class NamedSet:
    """A measurement set by its names, without its readings."""

    id: str
    name: str
    robot_id: str
    robot_name: str
    content: str  # hash of robot and readings


class Inputs(Protocol):
    """Source of inputs. Each method names the field of the request that holds the id, for messages."""

    def robot(self, robot_id: str, where: str) -> tuple[Robot, str]:
        """Return a robot, and the hash of its content.

        Raises:
            RequestError: there is none.
        """
        ...

    def measured(self, set_id: str, where: str, leave_out: Sequence[str] = ()) -> PreparedSet:
        """Return a measurement set without the observations of some labels.

        Raises:
            RequestError: there is none, it has no such observation, or none remains.
        """
        ...

    def named_sets(self, set_ids: Sequence[str] | None, where: str) -> list[NamedSet]:
        """Return measurement sets in the order of their ids, deleted or not.

        Args:
            set_ids: None for the set with loads of each robot that was measured last.
            where: the field of the request that holds the ids.

        Raises:
            RequestError: there is none of an id.
        """
        ...

    def listed(self, message: type[Job], robot_id: str) -> Iterable[Mapping[str, Any]]:
        """Return the summaries of the newest jobs of a kind and a robot."""
        ...

    def run(self, run_id: str, where: str) -> MeasuredRun:
        """Return a run with its measurement set.

        Raises:
            RequestError: there is none.
        """
        ...


class FromFile:
    """Inputs from documents. What is added gets an id, by which a request names it."""

    def __init__(self) -> None:
        """Begin without inputs."""
        self._robots: dict[str, PreparedRobot] = {}
        self._sets: dict[str, tuple[MeasurementSetDocument, PreparedRobot, PreparedSet]] = {}
        self._runs: dict[str, MeasuredRun] = {}

    def add_robot(self, robot: PreparedRobot) -> str:
        """Add a robot; return its id."""
        robot_id = uuid4().hex
        self._robots[robot_id] = robot
        return robot_id

    def add_set(self, document: MeasurementSetDocument, robot: PreparedRobot) -> str:
        """Add a measurement set of a robot; return its id.

        Raises:
            MeasurementError: the set cannot be used.
        """
        set_id = uuid4().hex
        prepared = prepare_set(document, robot, self.add_robot(robot), catalogue_robots())
        self._sets[set_id] = document, robot, prepared
        return set_id

    def add_run(self, run: Run, set_id: str) -> str:
        """Add a run of a measurement set that was added; return its id."""
        self._runs[run.id] = MeasuredRun(run, self._sets[set_id][2])
        return run.id

    def robot(self, robot_id: str, where: str) -> tuple[Robot, str]:
        """Return a robot, and the hash of its content."""
        if robot_id not in self._robots:
            raise _unknown("robot", robot_id, where)
        return self._robots[robot_id].robot, self._robots[robot_id].content_hash

    def measured(self, set_id: str, where: str, leave_out: Sequence[str] = ()) -> PreparedSet:
        """Return a measurement set without the observations of some labels."""
        if set_id not in self._sets:
            raise _unknown("measurement set", set_id, where)
        document, robot, prepared = self._sets[set_id]
        if not leave_out:
            return prepared
        kept = document.model_copy(update={"observations": without(document.observations, leave_out)})
        return prepare_set(kept, robot, prepared.robot_id, catalogue_robots())

    def named_sets(self, set_ids: Sequence[str] | None, where: str) -> list[NamedSet]:
        """Return measurement sets; without ids all of them, as each is of a robot of its own."""
        named = []
        for i, set_id in enumerate(self._sets if set_ids is None else set_ids):
            content = self.measured(set_id, f"{where}[{i}]").content
            document, robot, prepared = self._sets[set_id]
            named.append(NamedSet(set_id, document.name, prepared.robot_id, robot.document.name, content))
        return named

    def listed(self, *_: object) -> tuple[dict[str, Any], ...]:
        """Return no jobs: files hold none of a robot's past."""
        return ()

    def run(self, run_id: str, where: str) -> MeasuredRun:
        """Return a run with its measurement set."""
        if run_id not in self._runs:
            raise _unknown("run", run_id, where)
        return self._runs[run_id]


def _unknown(what: str, identifier: str, where: str) -> RequestError:
    return RequestError(
        f"the file holds no {what} '{identifier}'",
        where=where,
        remedy=f"give the {what} itself: a file cannot refer to stored resources",
    )
