"""Jobs as the store keeps them."""

from __future__ import annotations

from typing import Any, Final

from jointstiff.schemas.assessment import ResultSummary
from jointstiff.schemas.job import Job, Result
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.store.records import JobRecord

_COLUMNS: Final = (
    "measurement_set_id",
    "first_set_id",
    "second_set_id",
    "name",
    "method",
    "weighting",
    "elasticity",
    "verdict",
)
"""Columns of the store that have the values of the summary's fields."""


def record_of(kind: AnyKind, job: Job, robot_id: str | None) -> JobRecord:
    """Return a job as the store keeps it."""
    summary = summary_of(kind, job, robot_id)
    return JobRecord(
        id=job.id,
        kind=kind.name,
        state=job.state,
        created_at=job.provenance.created_at,
        summary=summary,
        robot_id=robot_id,
        document=job.model_dump_json(),
        **{name: summary.get(name) for name in _COLUMNS},
    )


def summary_of(kind: AnyKind, job: Job, robot_id: str | None) -> dict[str, Any]:
    """Return a job as it is listed, as JSON."""
    result = job.result.summary if isinstance(job.result, Result) else ResultSummary()
    sources = (job, job.request, job.provenance, result)
    fields = {
        name: next(getattr(source, name) for source in sources if hasattr(source, name))
        for name in kind.summary.model_fields
        if name != "robot_id"
    }
    listed = kind.summary.model_validate({"robot_id": robot_id, **fields})
    summary: dict[str, Any] = listed.model_dump(mode="json")
    return summary
