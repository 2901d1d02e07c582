"""Robots, sets and runs that a request names with ids: an interface, and an implementation in memory.

`Resources` implements the interface for a store.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol
from uuid import uuid4

from jointstiff.schemas.job import Job
from jointstiff.schemas.measurement import MeasurementSetDocument
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.prepared import (
    PreparedRobot,
    PreparedSet,
    leave_out_observations,
    prepare_set,
)
from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.robot import KnownRobot, Robot


@dataclass(frozen=True, eq=False)
class MeasuredRun:
    """A run, and the measurement set from which it was identified."""

    run: Run
    prepared: PreparedSet  # the set with all its observations, also with those that the run left out


@dataclass(frozen=True)
class NamedSet:
    """Id and names of a measurement set and its robot, without readings."""

    id: str
    name: str
    robot_id: str
    robot_name: str
    content: str  # hash that changes with the content of the robot or of the set


class Inputs(Protocol):
    """Source of robots, sets and runs. The argument `where` is the field of the request that holds the id."""

    def robot(self, robot_id: str, where: str) -> tuple[Robot, str]:
        """Return (robot, hash of its content); `where` is the field of the request with the id, for errors.

        Raises:
            RequestError: no robot has this id.
        """
        ...

    def list_confusable_robots(self) -> Iterator[KnownRobot]:
        """Yield robots that may have been measured by mistake: stored robots, then arms of the catalogue."""
        ...

    def measured(self, set_id: str, where: str, leave_out: Sequence[str] = ()) -> PreparedSet:
        """Return a measurement set without the observations whose labels are in `leave_out`.

        `where` is the field of the request that has the set's id, for errors.

        Raises:
            RequestError: no set has this id, the set has no such observation, or no observation remains.
        """
        ...

    def named_sets(self, set_ids: Sequence[str], where: str) -> list[NamedSet]:
        """Return ids and names of measurement sets, also of deleted sets, in the order of `set_ids`.

        Args:
            set_ids: ids of the sets.
            where: field of the request that holds the ids.

        Raises:
            RequestError: no set has one of the ids.
        """
        ...

    def job_summaries(self, message: type[Job], robot_id: str) -> Iterable[Mapping[str, Any]]:
        """Return the summaries of a robot's newest jobs of a kind; `message` is the class of the jobs."""
        ...

    def run(self, run_id: str, where: str) -> MeasuredRun:
        """Return a run with its measurement set; `where` is the field of the request with the id, for errors.

        Raises:
            RequestError: no run has this id.
        """
        ...


class InMemoryInputs:
    """Robots, sets and runs in memory. Each of them gets an id, for use in requests, when it is added."""

    def __init__(self) -> None:
        """Begin without inputs."""
        self._robots: dict[str, PreparedRobot] = {}
        # id → (document of the set, its robot, the set prepared for computation)
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
        _, _, prepared = self._sets[set_id]
        self._runs[run.id] = MeasuredRun(run, prepared)
        return run.id

    def has_run(self, run_id: str) -> bool:
        """Return whether a run was added."""
        return run_id in self._runs

    def robot(self, robot_id: str, where: str) -> tuple[Robot, str]:
        """Return (robot, hash of its content)."""
        if robot_id not in self._robots:
            raise _make_unknown_id_error("robot", robot_id, where)
        return self._robots[robot_id].robot, self._robots[robot_id].content_hash

    def list_confusable_robots(self) -> Iterator[KnownRobot]:
        """Yield the arms of the catalogue: robots in memory belong to the request."""
        return catalogue_robots()

    def measured(self, set_id: str, where: str, leave_out: Sequence[str] = ()) -> PreparedSet:
        """Return a measurement set without the observations whose labels are in `leave_out`."""
        if set_id not in self._sets:
            raise _make_unknown_id_error("measurement set", set_id, where)
        document, robot, prepared = self._sets[set_id]
        if not leave_out:
            return prepared
        shorter_set = document.model_copy(
            update={"observations": leave_out_observations(document.observations, leave_out)}
        )
        shorter = prepare_set(shorter_set, robot, prepared.robot_id, catalogue_robots())
        return shorter.number_as_in(document.observations)

    def named_sets(self, set_ids: Sequence[str], where: str) -> list[NamedSet]:
        """Return ids and names of measurement sets in memory.

        `where` is the field of the request that has the ids, for errors.
        """
        named_sets = []
        for index, set_id in enumerate(set_ids):
            content = self.measured(set_id, f"{where}[{index}]").content
            document, robot, prepared = self._sets[set_id]
            named_sets.append(
                NamedSet(set_id, document.name, prepared.robot_id, robot.document.name, content)
            )
        return named_sets

    def job_summaries(self, *_: object) -> tuple[dict[str, Any], ...]:
        """Return an empty tuple: without a store there are no earlier jobs of a robot."""
        return ()

    def run(self, run_id: str, where: str) -> MeasuredRun:
        """Return a run with its measurement set."""
        if run_id not in self._runs:
            raise _make_unknown_id_error("run", run_id, where)
        return self._runs[run_id]


def _make_unknown_id_error(kind: str, identifier: str, where: str) -> RequestError:
    """Return the error for an id that the file does not contain.

    `kind` is "robot", "measurement set" or "run"; `where` is the field of the request with the id.
    """
    return RequestError(
        f"the file contains no {kind} with the id '{identifier}'",
        where=where,
        remedy=f"give the {kind} itself: a file cannot refer to stored resources",
    )
