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

    limit: Annotated[int, Field(ge=1, le=MAX_PAGE)] = Field(default=50, description="Resources on a page.")
    cursor: Annotated[str, Field(max_length=64)] | None = Field(
        default=None, description="`next` of the page before; none for the newest."
    )

    def filters(self) -> dict[str, str]:
        """The filters that were given."""
        chosen = self.model_dump(exclude_none=True, exclude={"limit", "cursor"})
        return {name: str(value) for name, value in chosen.items()}


class WaitQuery(Message):
    """How long the answer to a post may take."""

    wait: Annotated[float, Field(ge=0, le=MAX_WAIT_SECONDS)] = Field(
        default=5, description="Seconds to wait for the end if it takes long."
    )


class RobotQuery(PageQuery):
    """Which robots."""

    name: ExactName | None = Field(default=None, description="Only those of exactly this name.")


class SetQuery(PageQuery):
    """Which measurement sets."""

    robot_id: Reference | None = Field(default=None, description="Only those of this robot.")
    name: ExactName | None = Field(default=None, description="Only those of exactly this name.")
    encoders: Literal["motor", "secondary"] | None = Field(default=None, description="Only with these.")


class RunQuery(PageQuery):
    """Which runs."""

    measurement_set_id: Reference | None = Field(default=None, description="Only those of this set.")
    robot_id: Reference | None = Field(default=None, description="Only those of this robot.")
    method: Method | None = Field(default=None, description="Only those by this method.")
    weighting: Weighting | None = Field(default=None, description="Only those with these weights.")
    elasticity: Elasticity | None = Field(default=None, description="Only those in which this bends.")
    state: JobState | None = Field(default=None, description="Only those in this state.")


class ComparisonQuery(PageQuery):
    """Which comparisons."""

    measurement_set_id: Reference | None = Field(default=None, description="Only those of this set.")
    robot_id: Reference | None = Field(default=None, description="Only those of this robot.")
    state: JobState | None = Field(default=None, description="Only those in this state.")


class PairQuery(PageQuery):
    """Which pairs."""

    first_set_id: Reference | None = Field(default=None, description="Only those with this first set.")
    second_set_id: Reference | None = Field(default=None, description="Only those with this second set.")
    robot_id: Reference | None = Field(default=None, description="Only those of this robot.")
    state: JobState | None = Field(default=None, description="Only those in this state.")


class GeometryQuery(PageQuery):
    """Which geometries."""

    name: ExactName | None = Field(default=None, description="Only those of exactly this name.")
    robot_id: Reference | None = Field(default=None, description="Only those with this nominal model.")
    state: JobState | None = Field(default=None, description="Only those in this state.")
