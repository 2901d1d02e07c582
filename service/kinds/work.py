"""The work of a job: done at once, or cut into steps that an engine can share out and keep."""

from __future__ import annotations

import base64
import io
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from jointstiff.schemas.fields import Message

Span = tuple[int, int]
"""First unit of a job's work, and one past the last."""

Part = TypeVar("Part")
"""What a step computes."""


@dataclass(frozen=True, eq=False)
class QuickWork:
    """Work that is done at once."""

    # return the result; raises a RequestError for a request that is refused rather than stored, another
    # JointstiffError for one that fails
    compute: Callable[[], Message]
    input_hash: str  # SHA-256 of data and request; equal inputs have equal hashes in any store
    robot_id: str | None  # id of the stored robot; None if it is not stored
    # fields of the job's message beyond those of every job
    details: Mapping[str, object] = field(default_factory=dict)


class SteppedWork(ABC, Generic[Part]):
    """Work as a line of units, cut into steps whose results can be kept; without steps it is quick."""

    input_hash: str  # SHA-256 of data and request; equal inputs have equal hashes in any store
    robot_id: str  # id of the stored robot
    unit = "resamples"  # unit of its progress
    activity = "resampling"  # name of what makes progress

    @abstractmethod
    def steps(self) -> Sequence[Span]:
        """Return all units in order, cut into steps of a fraction of a second; the same for every caller."""

    @abstractmethod
    def compute(self, span: Span) -> Part:
        """Carry out a step; its numbers do not depend on the worker.

        Raises:
            JointstiffError: the job fails.
        """

    @abstractmethod
    def encode(self, part: Part) -> str:
        """Return the result of a step as text that an engine can keep."""

    @abstractmethod
    def decode(self, text: str) -> Part:
        """Return the result of a step that `encode` wrote."""

    @abstractmethod
    def conclude(self, parts: Sequence[Part]) -> Message:
        """Return the result of the job, from those of all steps in order.

        Raises:
            JointstiffError: there is none, and why.
        """


Work: TypeAlias = QuickWork | SteppedWork[Any]


def pack(arrays: Mapping[str, npt.NDArray[Any]]) -> str:
    """Return arrays as text."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)  # random digits: zlib costs more than it saves
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def unpack(text: str) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays that `pack` wrote."""
    with np.load(io.BytesIO(base64.b64decode(text)), allow_pickle=False) as archive:
        return dict(archive)
