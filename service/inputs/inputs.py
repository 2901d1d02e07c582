"""Inputs that a request names by id. They are fetched here, and never computed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from jointstiff.schemas.job import Job
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.solver.robot.model import Robot


@dataclass(frozen=True, eq=False)
class MeasuredRun:
    """A run, and the measurement set that it identified."""

    run: Run
    prepared: PreparedSet  # all observations of the set, those that the run left out included


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

    def listed(self, message: type[Job], robot_id: str) -> Iterable[Mapping[str, Any]]:
        """Return the summaries of the newest jobs of a kind and a robot."""
        ...

    def run(self, run_id: str, where: str) -> MeasuredRun:
        """Return a run with its measurement set.

        Raises:
            RequestError: there is none.
        """
        ...
