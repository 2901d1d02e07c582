"""What a kind of job is: its messages, its records, its work. `service.jobs.life` leads jobs to their end."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Protocol, Self, TypeVar

from pydantic import BaseModel

from jointstiff.schemas.job import JobState, Progress, Provenance
from jointstiff.service.jobs.work import Work
from jointstiff.service.resources import MeasurementSets, PreparedSet
from jointstiff.service.store import JobRecord, NotFoundError
from jointstiff.solver.errors import RequestError

__all__ = ["Job", "Kind", "Message", "Opening", "Request", "prepared_for"]


class Job(Protocol):
    """The message of a job of any kind. It never changes once it ended."""

    @property
    def id(self) -> str:
        """Of the resource."""

    @property
    def state(self) -> JobState:
        """Where it stands."""

    @property
    def progress(self) -> Progress | None:
        """How far it came; None if it is carried out at once."""

    @property
    def request(self) -> Any:  # noqa: ANN401 - each kind has its own
        """What is asked for."""

    @property
    def provenance(self) -> Provenance:
        """What it takes to repeat it."""

    @classmethod
    def model_validate(cls, obj: dict[str, object]) -> Self:
        """The message of these fields."""

    @classmethod
    def model_validate_json(cls, json_data: str) -> Self:
        """The message that a document holds."""

    def model_copy(self, *, update: dict[str, Any]) -> Self:
        """The same with changes."""

    def model_dump_json(self, *, include: set[str] | None = None) -> str:
        """As it is stored and answered, or some of its fields."""


Request = TypeVar("Request", bound=BaseModel)
Message = TypeVar("Message", bound=Job)


@dataclass(frozen=True)
class Opening:
    """What a job of any kind begins with."""

    id: str
    progress: Progress | None
    provenance: Provenance


class Kind(ABC, Generic[Request, Message, JobRecord]):
    """One kind of job.

    Attributes:
        name: by which an engine knows it; never changes.
        unit: of its progress.
        activity: what it is doing while it makes progress.
        message: what is answered of it.
        record: what the store keeps of it.
    """

    name: ClassVar[str]
    unit: ClassVar[str]
    activity: ClassVar[str]
    message: type[Message]
    record: type[JobRecord]

    @abstractmethod
    def work(self, request: Request) -> Work[Any]:
        """What a request takes.

        Raises:
            RequestError: what is asked for does not exist, or cannot be done.
        """

    def queued(self, opening: Opening, request: Request) -> Message:
        """A new job."""
        return self.message.model_validate(
            {
                "id": opening.id,
                "state": "queued",
                "progress": opening.progress,
                "request": request,
                "result": None,
                "error": None,
                "provenance": opening.provenance,
                **self.details(request),
            }
        )

    def details(self, request: Request) -> dict[str, object]:  # noqa: ARG002 - most kinds have none
        """What the message of this kind says besides."""
        return {}

    @abstractmethod
    def row(self, job: Message, robot_id: str) -> JobRecord:
        """A job as the store keeps it."""

    def read(self, document: str) -> Message:
        """A stored job."""
        return self.message.model_validate_json(document)


def prepared_for(sets: MeasurementSets, set_id: str) -> PreparedSet:
    """The measurement set that a request names.

    Raises:
        RequestError: there is none.
    """
    try:
        return sets.prepared(set_id)
    except NotFoundError as error:
        raise RequestError(error.reason, remedy=error.remedy, where="measurement_set_id") from error
