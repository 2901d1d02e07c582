"""Kinds of jobs, quick and stepped: their messages, and the work that a request takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from jointstiff.schemas.assessment import ResultSummary
from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import Job, Result
from jointstiff.schemas.query import JobQuery
from jointstiff.service.kinds.work import QuickWork, SteppedWork
from jointstiff.service.problems.errors import Resource
from jointstiff.service.resources.composition import Resources
from jointstiff.service.store.records import JobRecord

AnyWork = TypeVar("AnyWork", QuickWork, SteppedWork[Any])

_COLUMNS = (
    "measurement_set_id",
    "first_set_id",
    "second_set_id",
    "name",
    "method",
    "weighting",
    "elasticity",
)
"""Columns of the store that have the values of the summary's fields."""


@dataclass(frozen=True)
class Kind(Generic[AnyWork]):
    """One kind of job. Use `Quick` or `Stepped`."""

    message: type[Job]  # a stored job, which has the names of the kind
    request: type[Message]  # a job as it is posted
    # a job in a listing: each field is one of the job, of its request, of its provenance, or of its
    # result's summary
    summary: type[Message]
    query: type[JobQuery]  # the page and the filters of a listing: each filter is a field of the summary
    # return the work that a request takes; raises a RequestError for what does not exist or cannot be done
    work: Callable[[Resources, Any], AnyWork]
    max_bytes: int  # size of a request
    description: str  # of the post, for the API's users
    is_form: bool = False  # whether it is posted as a form with files, at a route of its own
    answered: Callable[[str], str] = str  # return a stored document as it is answered

    @property
    def name(self) -> str:
        """Name of one, by which an engine knows it; never changes."""
        return self.message.kind

    @property
    def collection(self) -> str:
        """Name of all, in addresses."""
        return self.message.collection

    @property
    def resource(self) -> Resource:
        """Both names, for the store."""
        return Resource(self.name, self.collection)

    def record(self, job: Job, robot_id: str | None) -> JobRecord:
        """Return a job as the store keeps it."""
        summary = self.summarise(job, robot_id)
        return JobRecord(
            id=job.id,
            kind=self.name,
            state=job.state,
            created_at=job.provenance.created_at,
            summary=summary,
            robot_id=robot_id,
            document=job.model_dump_json(),
            **{name: summary.get(name) for name in _COLUMNS},
        )

    def summarise(self, job: Job, robot_id: str | None) -> dict[str, Any]:
        """Return a job as it is listed, as JSON."""
        result = job.result.summary if isinstance(job.result, Result) else ResultSummary()
        sources = (job, job.request, job.provenance, result)
        found = {
            name: next(getattr(source, name) for source in sources if hasattr(source, name))
            for name in self.summary.model_fields
            if name != "robot_id"
        }
        return self.summary.model_validate({"robot_id": robot_id, **found}).model_dump(mode="json")


class Quick(Kind[QuickWork]):
    """A kind whose jobs are carried out at once."""


class Stepped(Kind[SteppedWork[Any]]):
    """A kind whose jobs may take steps, which are left to workers."""


AnyKind = Quick | Stepped
