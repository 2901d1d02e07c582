"""A fleet: the campaigns of many robots, each identified by itself in one job."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator

from jointstiff.schemas.fields import Identifier, Message, Name, Stiffness
from jointstiff.schemas.finding import Problem, Verdict
from jointstiff.schemas.job import Job
from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.options import RunOptions

MAX_SETS = 10_000
"""Maximum number of measurement sets of a fleet."""

FleetOutcome = Literal["use", "use_with_care", "do_not_use", "failed"]


class FleetOptions(Message):
    """Options of a fleet."""

    name: Name | None = None
    run: RunOptions = Field(default_factory=RunOptions, description="Options of all runs.")


class FleetRequest(FleetOptions):
    """Request of a fleet."""

    measurement_set_ids: Annotated[list[Identifier], Field(min_length=1, max_length=MAX_SETS)] | None = Field(
        default=None,
        description="Measurement sets to identify. Null or absent: the last measured set with loads of "
        "each robot. The job states the ids of the chosen sets.",
    )

    @field_validator("measurement_set_ids", mode="after")
    @classmethod
    def _refuse_repeated_sets(cls, set_ids: list[str] | None) -> list[str] | None:
        if set_ids is not None and len(set(set_ids)) < len(set_ids):
            raise ValueError("must not contain duplicates")
        return set_ids


class FleetRow(Message):
    """Result of one set; a set that could not be identified has an `error` instead of numbers."""

    measurement_set_id: Identifier
    measurement_set_name: Name
    robot_id: Identifier
    robot_name: Name
    verdict: Verdict | None
    joint_kinds: dict[Name, JointKind] = Field(
        description="Kinds of the joints from base to flange; empty if all joints are revolute."
    )
    stiffness: Stiffness[dict[Name, float | None]] = Field(
        description="Stiffness of each joint, with the fields that a run has."
    )
    stiffness_interval: Stiffness[dict[Name, tuple[float, float | None] | None]]
    error: Problem | None

    @property
    def outcome(self) -> FleetOutcome:
        """Verdict on the set, or `failed` if the set was not identified."""
        return self.verdict or "failed"


class FleetResult(Message):
    """Result of a fleet."""

    counts: dict[FleetOutcome, int] = Field(
        description="Number of sets with each verdict, and number of sets that failed."
    )
    rows: list[FleetRow] = Field(description="Row of each set, in the order of the request.")


class Fleet(Job):
    """A stored fleet."""

    collection: ClassVar[str] = "fleets"

    kind: Literal["fleet"] = "fleet"
    request: FleetRequest
    result: FleetResult | None = Field(description="Present if the job succeeded.")

    @property
    def failed_parts(self) -> int:
        """Number of parts of the job that have failed; each part is one measurement set."""
        return 0 if self.result is None else self.result.counts["failed"]
