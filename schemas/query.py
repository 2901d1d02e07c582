"""Queries of the listings: page and filters; a misspelt filter is refused, not ignored."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from jointstiff.schemas.fields import MAX_NAME_LENGTH, Message, Moment
from jointstiff.schemas.finding import AcceptingOptions, Verdict
from jointstiff.schemas.job import JobState
from jointstiff.schemas.options import Elasticity, Method, Weighting

MAX_PAGE = 100
MAX_WAIT_SECONDS = 60

ExactName = Annotated[str, Field(max_length=MAX_NAME_LENGTH)]
Reference = Annotated[str, Field(max_length=64)]


class PageQuery(Message):
    """Page of a listing."""

    limit: Annotated[int, Field(ge=1, le=MAX_PAGE)] = Field(
        default=50, description="Maximum number of resources per page."
    )
    cursor: Annotated[str, Field(max_length=64)] | None = Field(
        default=None,
        description="Cursor of the page, from `next` of the previous page; omit for the first page.",
    )


class ListQuery(PageQuery):
    """Search, order and filters of resources that can be deleted."""

    q: ExactName | None = Field(
        default=None,
        description="Text to find in the name of a resource, robot or set, or in a set's serial number, "
        "operator or instrument. Case is ignored.",
    )
    sort: Literal["created_at", "-created_at", "name", "-name"] = Field(
        default="-created_at",
        description="Order by time or by name. A leading `-` means descending order, with the newest "
        "first. Runs are ordered by the names of their sets.",
    )
    deleted: bool = Field(
        default=False,
        description="True to list only deleted resources; false to list only resources that are not deleted.",
    )

    def listing_arguments(self) -> dict[str, Any]:
        """Return the arguments for the method `page` of a collection, which lists the resources.

        They are page, order, search, and `filters`: field → value that the field must have.
        """
        stated = self.model_dump(exclude_none=True)
        common = {name: stated.pop(name) for name in ListQuery.model_fields if name in stated}
        filters = {name: str(value) for name, value in stated.items()}  # fields of the subclass
        return common | {"filters": filters, "counted": True}


class JobQuery(ListQuery):
    """Filters of jobs."""

    kind: Reference | None = Field(default=None, description="Filter by kind.")
    state: JobState | None = Field(default=None, description="Filter by state.")
    verdict: Verdict | None = Field(default=None, description="Filter by verdict.")
    robot_id: Reference | None = Field(default=None, description="Filter by robot.")
    measurement_set_id: Reference | None = Field(
        default=None,
        description="Filter by the id of a measurement set. Comparisons are filtered by the first set.",
    )
    second_set_id: Reference | None = Field(
        default=None,
        description="Id of the measurement set of the second side by which to filter comparisons.",
    )
    name: ExactName | None = Field(default=None, description="Filter by name (exact).")
    method: Method | None = Field(default=None, description="Filter runs by method.")
    weighting: Weighting | None = Field(default=None, description="Filter runs by weighting.")
    elasticity: Elasticity | None = Field(
        default=None, description="Filter of runs by the parts that bend in their model."
    )


class WaitQuery(Message):
    """Time to wait for a posted job."""

    wait: Annotated[float, Field(ge=0, le=MAX_WAIT_SECONDS)] = Field(
        default=5, description="Time for which the request waits for a long job to finish, in seconds."
    )


class FileQuery(AcceptingOptions):
    """Options of the files of jobs; a file uses only the options that concern it."""

    unit: Literal["MNm/rad", "Nm/arcmin"] = Field(
        default="MNm/rad", description="Unit of stiffness in `tables.json`."
    )
    details: bool = Field(default=True, description="False to include only the main tables in `tables.json`.")
    file: Annotated[str, Field(max_length=MAX_NAME_LENGTH)] | None = Field(
        default=None, description="Name of a file of a corrected `program`; default: the first file."
    )


class RobotQuery(ListQuery):
    """Filters of robots."""

    sort: Literal["created_at", "-created_at", "name", "-name", "worst"] = Field(  # type: ignore[assignment]
        default="-created_at",
        description="Order by time, by name (`-` means descending), or by the change of the joints' "
        "stiffness, with the worst first.",
    )
    name: ExactName | None = Field(default=None, description="Filter by name (exact).")
    content_hash: Reference | None = Field(default=None, description="Filter by `content_hash`.")


class OpenSetQuery(ListQuery):
    """Filters of sets that are measured live."""

    robot_id: Reference | None = Field(default=None, description="Filter by robot.")

    @classmethod
    def from_set_query(cls, query: SetQuery) -> OpenSetQuery:
        """Return a query of live campaigns with those filters of `query` that live campaigns have, too."""
        return cls(**{name: getattr(query, name) for name in cls.model_fields})


class SetQuery(OpenSetQuery):
    """Filters of measurement sets."""

    open: bool = Field(
        default=False,
        description="True to list only sets that are still measured. `robot_id` is then the only other "
        "filter.",
    )
    name: ExactName | None = Field(default=None, description="Filter by name (exact).")
    encoders: Literal["motor", "secondary"] | None = Field(default=None, description="Filter by encoders.")
    serial_number: ExactName | None = Field(
        default=None, description="Filter by the serial number of the robot."
    )
    operator: ExactName | None = Field(default=None, description="Filter by operator (exact).")
    instrument: ExactName | None = Field(default=None, description="Filter by instrument (exact).")
    content_hash: Reference | None = Field(default=None, description="Filter by `content_hash`.")
    measured_from: Moment | None = Field(
        default=None,
        description="Filter by time of measurement, from the stated time on; state a time zone.",
    )
    measured_to: Moment | None = Field(
        default=None,
        description="Filter by time of measurement, before the stated time; state a time zone.",
    )

    @model_validator(mode="after")
    def _require_ordered_times(self) -> SetQuery:
        first, last = self.measured_from, self.measured_to
        if first is not None and last is not None and last <= first:
            raise ValueError("`measured_to` must be after `measured_from`")
        return self

    def listing_arguments(self) -> dict[str, Any]:
        """Return the arguments for the method `page` of a collection, with `spans`.

        Spans are field → (first time, end), where the end itself does not belong to the span.
        """
        arguments = super().listing_arguments()
        for name in ("measured_from", "measured_to"):
            arguments["filters"].pop(name, None)
        spans = {"measured_at": (self.measured_from, self.measured_to)}
        has_span = self.measured_from is not None or self.measured_to is not None
        return arguments | {"spans": spans if has_span else {}}
