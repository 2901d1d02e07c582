"""Queries of the listings: page and filters; a misspelt filter is refused, not ignored."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from jointstiff.schemas.fields import MAX_NAME_LENGTH, Message
from jointstiff.schemas.job import JobState
from jointstiff.schemas.run import Elasticity, Method, Weighting

MAX_PAGE = 100
MAX_WAIT_SECONDS = 60

ExactName = Annotated[str, Field(max_length=MAX_NAME_LENGTH)]
Reference = Annotated[str, Field(max_length=64)]


class PageQuery(Message):
    """Which page of a listing."""

    limit: Annotated[int, Field(ge=1, le=MAX_PAGE)] = Field(
        default=50, description="Maximum number of resources per page."
    )
    cursor: Annotated[str, Field(max_length=64)] | None = Field(
        default=None, description="`next` of the previous page; omit it for the first page."
    )

    def filters(self) -> dict[str, str]:
        """The filters that were given."""
        chosen = self.model_dump(exclude_none=True, exclude={"limit", "cursor", "deleted"})
        return {name: str(value) for name, value in chosen.items()}


class DeletableQuery(PageQuery):
    """Which resources of a kind that can be deleted."""

    deleted: bool = Field(
        default=False, description="Only deleted ones, which can be restored, instead of the others."
    )


class JobQuery(DeletableQuery):
    """Which jobs of a kind."""

    state: JobState | None = Field(default=None, description="Filter by state.")


class WaitQuery(Message):
    """Waiting time of a post."""

    wait: Annotated[float, Field(ge=0, le=MAX_WAIT_SECONDS)] = Field(
        default=5, description="Time to wait for a long job to finish, in seconds."
    )


class RobotQuery(DeletableQuery):
    """Which robots."""

    name: ExactName | None = Field(default=None, description="Filter by name (exact).")


class SetQuery(DeletableQuery):
    """Which measurement sets."""

    robot_id: Reference | None = Field(default=None, description="Filter by robot.")
    name: ExactName | None = Field(default=None, description="Filter by name (exact).")
    encoders: Literal["motor", "secondary"] | None = Field(default=None, description="Only with these.")


class RunQuery(JobQuery):
    """Which runs."""

    measurement_set_id: Reference | None = Field(default=None, description="Filter by measurement set.")
    robot_id: Reference | None = Field(default=None, description="Filter by robot.")
    method: Method | None = Field(default=None, description="Filter by method.")
    weighting: Weighting | None = Field(default=None, description="Filter by weighting.")
    elasticity: Elasticity | None = Field(default=None, description="Filter by elasticity.")


class ComparisonQuery(JobQuery):
    """Which comparisons."""

    measurement_set_id: Reference | None = Field(default=None, description="Filter by measurement set.")
    robot_id: Reference | None = Field(default=None, description="Filter by robot.")


class PairQuery(JobQuery):
    """Which pairs."""

    first_set_id: Reference | None = Field(default=None, description="Filter by the first measurement set.")
    second_set_id: Reference | None = Field(default=None, description="Filter by the second measurement set.")
    robot_id: Reference | None = Field(default=None, description="Filter by robot.")


class GeometryQuery(JobQuery):
    """Which geometries."""

    name: ExactName | None = Field(default=None, description="Filter by name (exact).")
    robot_id: Reference | None = Field(default=None, description="Filter by the robot of the nominal model.")


class MapQuery(JobQuery):
    """Which maps."""

    robot_id: Reference | None = Field(default=None, description="Filter by robot.")
    name: ExactName | None = Field(default=None, description="Filter by name (exact).")


class ProgramQuery(JobQuery):
    """Which compensated programs."""

    robot_id: Reference | None = Field(default=None, description="Filter by robot.")


class PlanQuery(JobQuery):
    """Which plans."""

    robot_id: Reference | None = Field(default=None, description="Filter by robot.")
    measurement_set_id: Reference | None = Field(default=None, description="Filter by measurement set.")
