"""The work of a job, cut into steps that an engine can share out and keep."""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Generic, TypeVar

from pydantic import BaseModel

__all__ = ["Part", "Span", "Work"]

Span = tuple[int, int]
"""First unit of a job's work, and one past the last."""

Part = TypeVar("Part")
"""What a step computes."""


class Work(ABC, Generic[Part]):
    """The work of a job: a line of units, cut into steps whose results can be kept.

    Work that takes no steps is quick: all of it is done by `conclude`.

    Attributes:
        robot_id: of the robot that the job is about.
        content: hash of the data that go into it.
        unit: of its progress; that of its kind if None.
        activity: what it is doing while it makes progress; that of its kind if None.
    """

    robot_id: str
    content: str
    unit: str | None = None
    activity: str | None = None

    @abstractmethod
    def steps(self) -> Sequence[Span]:
        """All units in order, cut into steps of a fraction of a second; the same whoever asks."""

    @abstractmethod
    def compute(self, span: Span) -> Part:
        """Carry out a step; the same numbers whoever does."""

    @abstractmethod
    def encode(self, part: Part) -> str:
        """As text that an engine can keep."""

    @abstractmethod
    def decode(self, text: str) -> Part:
        """What `encode` wrote."""

    @abstractmethod
    def conclude(self, parts: Sequence[Part]) -> BaseModel:
        """The result, from those of all steps in order.

        Raises:
            JointstiffError: there is none, and why.
        """

    def input_hash(self, request: BaseModel) -> str:
        """SHA-256 of data and request; equal inputs have equal hashes in any store."""
        options = request.model_dump_json(exclude={"measurement_set_id"})
        return hashlib.sha256(f"{self.content} {options}".encode()).hexdigest()
