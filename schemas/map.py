"""A map: how far the tool bends at the places of a work area, by the model of a run. SI units throughout."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from jointstiff.schemas.assessment import AcceptingOptions, VerdictSummary
from jointstiff.schemas.deflection import SagOptions
from jointstiff.schemas.fields import (
    Dimensionless,
    Identifier,
    Message,
    Metres,
    Name,
    Newtons,
    Point,
    Quantity,
    Radians,
    Timestamp,
    Torque,
    TranslationalCompliance,
    Vector3,
)
from jointstiff.schemas.job import FromRun, Job, JobState
from jointstiff.schemas.plan import Box
from jointstiff.schemas.robot import MAX_JOINTS

MAX_ALONG_AXIS = 1_000
MAX_PLACES = 100_000
MAX_POSES = 200_000
"""Places times orientations of a map: each is an inverse kinematics of 10 µs, and downloads repeat them."""

_Count = Annotated[int, Field(strict=True, ge=1, le=MAX_ALONG_AXIS)]
Length = Metres[tuple[float, float]]


class MapOptions(AcceptingOptions, SagOptions):
    """A work area, a tool and a process."""

    name: Name | None = None
    area: Metres[Box]
    grid: tuple[_Count, _Count, _Count] = Field(
        description="Places along x, y and z, the faces of the box included; a single one is in the middle."
    )
    place: Metres[Vector3] = Field(
        description="Tool position in the flange frame; this point is brought to each place."
    )
    load_point: Metres[Vector3 | None] = Field(
        default=None, description="Point where the force acts, flange frame; the tool's position if absent."
    )
    tool_axis: Dimensionless[Vector3] = Field(
        default=(0.0, 0.0, 1.0), description="Axis of the tool, in the flange frame."
    )
    directions: Dimensionless[Annotated[list[Vector3], Field(min_length=1, max_length=64)]] = Field(
        default=[(0.0, 0.0, -1.0)], description="Directions in which the tool's axis may point, axes of R0."
    )
    turns: Annotated[int, Field(strict=True, ge=1, le=360)] = Field(
        default=1,
        description="Angles about the tool's axis, evenly over a full turn. At the first the flange's x "
        "axis, seen along the tool, points along x of R0 (y where x has no part across the tool).",
    )
    force: Newtons[Vector3] = Field(description="Force of the process on the robot.")
    moment: Torque[Vector3 | None] = Field(
        default=None, description="Moment of the process on the robot, about the load point."
    )
    axes: Literal["base", "flange"] = Field(
        default="base", description="Frame in which force, moment and `direction` are given."
    )
    direction: Dimensionless[Vector3 | None] = Field(
        default=None, description="Along and across which compliance is asked for; along the force if absent."
    )
    limits: Radians[dict[Name, tuple[Quantity, Quantity]]] = Field(
        default_factory=dict,
        description="Least and greatest angles of joints, as the controller shows them, beside the robot's.",
    )
    near: Radians[Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)] | None] = Field(
        default=None,
        description="Controller's angles: each place takes the posture nearest to them, of all branches and "
        "orientations; the stiffest under the process if absent.",
    )
    confidence: Dimensionless[Annotated[float, Field(strict=True, ge=0.5, le=0.9999)]] = Field(
        default=0.95, description="Level of the intervals."
    )


class MapRequest(MapOptions):
    """A map as it is posted."""

    run_id: Identifier = Field(description="The run whose model predicts.")


class MapCounts(Message):
    """Places by what became of them."""

    reached: int = Field(description="They have numbers.")
    out_of_reach: int = Field(description="No posture brings the tool there in any orientation.")
    joint_limits: int = Field(description="Every posture is beyond the joints' limits.")
    unseen_joint: int = Field(
        description="The load twists a joint of which the readings say nothing: no number holds."
    )
    overloaded: int = Field(
        description="The load takes half of a joint's stiffness away, or turns it by a quarter radian."
    )
    not_followed: int = Field(
        default=0,
        description="`near` is stated, and its branch cannot be followed there, so near is a singularity.",
    )


class MapPlace(Message):
    """One place."""

    position: Metres[Point] = Field(description="Position in R0.")
    joints: Radians[list[float]] = Field(
        description="Joint angles without the load, as the controller shows them."
    )
    tool_direction: Dimensionless[Point] = Field(description="Direction in which the tool's axis points.")
    displacement: Metres[Point] = Field(description="Loaded minus unloaded, axes of R0.")
    deflection: Metres[float] = Field(description="Length of the displacement.")
    readings_only: Metres[tuple[float, float] | None] = Field(
        description="Interval of that length from the readings alone; null where no uncertainty is known."
    )
    with_model_error: Metres[tuple[float, float] | None] = Field(
        description="Interval that includes the model error; null where there is no bound."
    )
    compliance_along: TranslationalCompliance[float | None] = Field(
        description="Along the direction; null where a joint that the readings say nothing of has a part."
    )
    compliance_across: TranslationalCompliance[float | None] = Field(
        description="The greatest across it; likewise."
    )
    extrapolation: Dimensionless[float | None] = Field(
        description="Load, or uncertainty per load, over the campaign's greatest: above 1 it extrapolates. "
        "Null without a bound."
    )


class MapQuantile(Message):
    """A quantile of the deflection over the places reached."""

    share: Dimensionless[float]
    deflection: Metres[float]


class MapResult(FromRun):
    """A summary; the places themselves are downloaded as CSV or npz."""

    places: int
    counts: MapCounts
    quantiles: list[MapQuantile] = Field(description="Empty where no place is reached.")
    worst: MapPlace | None = Field(
        description="Place where the tool bends most; null where no place is reached."
    )
    stiffest: MapPlace | None = Field(
        description="Place where the tool bends least; null where no place is reached."
    )
    extrapolated: int = Field(description="Places reached whose load or posture is beyond the campaign's.")
    model_error_postures: int = Field(description="Postures that the bound of the model error rests on.")
    remarks: list[str] = Field(description="Remarks that apply to all places.")


class MapSummary(VerdictSummary):
    """A map in a listing."""

    id: Identifier
    robot_id: Identifier
    run_id: Identifier
    name: Name | None
    state: JobState
    created_at: Timestamp


class Map(Job):
    """A stored map. Once finished, it never changes."""

    kind: ClassVar[str] = "map"
    collection: ClassVar[str] = "maps"

    request: MapRequest
    result: MapResult | None = Field(description="Present if the map was made.")
