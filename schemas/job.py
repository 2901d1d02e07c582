"""The message of a job of any kind: its state, its progress, its provenance."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field, StrictBool

from jointstiff.schemas.fields import Identifier, Message, Name, Timestamp
from jointstiff.schemas.finding import Assessment, Problem, ResultSummary
from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.options import Elasticity, Method, Weighting

JobState = Literal["queued", "running", "succeeded", "failed", "cancelled"]


class Provenance(Message):
    """Versions and input needed to reproduce the numbers of a job."""

    versions: dict[str, str] = Field(description="Versions of this software and of its numerical libraries.")
    input_hash: str = Field(description="SHA-256 of robot, readings and request.")
    created_at: Timestamp
    started_at: Timestamp | None
    ended_at: Timestamp | None


class Progress(Message):
    """Progress of a job, in units of work."""

    done: int
    total: int
    unit: str = Field(description="Unit of `done` and `total`.", examples=["resamples"])
    activity: str = Field(description="Current step of the job.", examples=["resampling"])
    # Never stored: older programs would not read it.
    waits: str | None = Field(
        default=None,
        exclude_if=lambda waits: waits is None,
        description="Reason why the robot does not move.",
    )


class Result(Message):
    """Result with an assessment of the readings, or of the run that gave the model."""

    assessment: Assessment | None
    joint_kinds: dict[Name, JointKind] = Field(
        default_factory=dict,
        description="Kinds of the joints from base to flange; empty if all joints are revolute.",
    )

    @property
    def summary(self) -> ResultSummary:
        """Summary of the result for listings."""
        return ResultSummary(verdict=None if self.assessment is None else self.assessment.verdict)


class FromRun(Result):
    """Result that is made from a run."""

    assessment: Assessment = Field(description="Assessment of the result, with the reasons of its run.")


class Job(Message):
    """A request with its state, result and provenance. A job never changes after the end."""

    collection: ClassVar[str]  # name of all jobs of this kind, where they are posted

    id: Identifier
    kind: str
    state: JobState = Field(
        description="State of the job. Until the job ends, poll the job's address or follow the job's events."
    )
    progress: Progress | None = Field(default=None, description="Null if computed at once.")
    request: Message
    result: Message | None = Field(description="Present if the job succeeded.")
    error: Problem | None = Field(description="Present if the job failed.")
    provenance: Provenance
    key_id: str | None = Field(default=None, description="Id of the requester's key.")
    key_name: str | None = None

    @classmethod
    def kind_name(cls) -> str:
        """Return the kind of all jobs of this class."""
        return str(cls.model_fields["kind"].default)


class JobSummary(ResultSummary):
    """A job in a listing. Fields that the kind of job does not have are null or empty."""

    id: Identifier
    kind: str = Field(description="Kind of the job, such as `run`.", examples=["run"])
    state: JobState
    created_at: Timestamp
    name: Name | None = Field(
        default=None,
        description="Name of the job; for the correction of a program, the name of its first file.",
    )
    robot_id: Identifier | None = Field(
        default=None,
        description="Robot of the job; for a comparison, the robot of the first side; for a geometry, the "
        "nominal robot.",
    )
    measurement_set_id: Identifier | None = Field(
        default=None,
        description="Measurement set of a run or of a plan; for a comparison, the set of the first side.",
    )
    second_set_id: Identifier | None = Field(
        default=None, description="Measurement set of the second side of a comparison."
    )
    robot_name: Name | None = None
    measurement_set_name: Name | None = None
    serial_number: str | None = Field(
        default=None, description="Serial number of the robot, as stated in the measurement set."
    )
    run_id: Identifier | None = Field(
        default=None, description="Run whose identified model a map or a correction uses."
    )
    method: Method | None = None
    weighting: Weighting | None = None
    positive: StrictBool | None = Field(
        default=None, description="True if compliances were constrained to be zero or more."
    )
    elasticity: Elasticity | None = Field(
        default=None, description="Parts of the robot that bend in the model."
    )
    leave_out: list[Name] = Field(default_factory=list, description="Labels of omitted observations.")
    variant_of: Identifier | None = Field(
        default=None, description="Earlier run that this run tries to improve."
    )
    outputs: list[str] = Field(
        default_factory=list,
        description="SHA-256 of each corrected file of a program. A corrected file is refused as input, "
        "because a second correction would be wrong.",
    )


def _require_true(value: bool) -> bool:
    """Return True unchanged; refuse False."""
    if not value:
        raise ValueError("must be true, because a cancelled job does not go on: post the job again")
    return value


class JobChange(Message):
    """Changes of a job. Omitted fields remain unchanged."""

    cancelled: Annotated[StrictBool, AfterValidator(_require_true)] | None = Field(
        default=None, description="True to cancel the job; a job that has ended is not changed."
    )
    deleted: StrictBool | None = Field(
        default=None,
        description="True deletes the job; false restores a job that was deleted within the last 30 days.",
    )
