"""A small kind of work, which tests add to the others: how many readings a measurement set has."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Final, Literal

from pydantic import Field

from jointstiff.schemas.fields import Identifier, Message
from jointstiff.schemas.job import Job
from jointstiff.service.kinds.kind import File, Kind
from jointstiff.service.tables.report import Report, View
from jointstiff.service.tables.table import Column, Sheet, Table

if TYPE_CHECKING:
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs


class SmallOptions(Message):
    """Options of a count."""

    least: int = Field(default=0, description="Least number of targets of an observation that counts.")


class SmallRequest(SmallOptions):
    """A count as it is posted."""

    measurement_set_id: Identifier


class SmallResult(Message):
    """A count."""

    observations: int
    readings: int


class Small(Job):
    """A stored count."""

    collection: ClassVar[str] = "smalls"

    kind: Literal["small"] = "small"
    request: SmallRequest
    result: SmallResult | None = Field(description="Present if the count succeeded.")


def _prepare_work(inputs: Inputs, request: SmallRequest) -> Work:
    """Return the work of a count."""
    from jointstiff.service.conversion.readings import hash_texts
    from jointstiff.service.kinds.work import QuickWork

    prepared = inputs.measured(request.measurement_set_id, "measurement_set_id")
    counts = prepared.measurements.present.sum(axis=1).tolist()
    kept = [count for count in counts if count >= request.least]
    return QuickWork(
        result=lambda: SmallResult(observations=len(kept), readings=sum(kept)),
        input_hash=hash_texts(prepared.content, str(request.least)),
        robot_id=prepared.robot_id,
    )


def _make_report(_job: Small, result: SmallResult, _view: View) -> Report:
    """Return the counts."""
    columns = [Column("observations", [result.observations]), Column("readings", [result.readings])]
    return Report([Table(columns, title="Readings of the set")])


def counts_sheet(job: Small) -> Sheet:
    """Return the counts."""
    return Sheet.from_rows([] if job.result is None else [job.result.model_dump()])


SMALL: Final = Kind[Small, SmallRequest](
    message=Small,
    request=SmallRequest,
    options=SmallOptions,
    prepare_work=_prepare_work,
    make_report=_make_report,
    sources=("measurement_set",),
    title="Count of readings",
    description="Count the readings of a measurement set.",
    examples={"all": {"measurement_set_id": "ID_OF_A_STORED_SET"}},
    files=(
        File(name="counts.csv", description="the counts as a table", sheet=counts_sheet, made_of="result"),
    ),
)
