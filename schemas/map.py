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
        description="Number of places along x, y and z, including the faces of the box; a single one is in "
        "the middle."
    )
    place: Metres[Vector3] = Field(
        description="Tool position in the flange frame; this point is brought to each place."
    )
    load_point: Metres[Vector3 | None] = Field(
        default=None, description="Point where the force acts, flange frame; default: the tool's position."
    )
    tool_axis: Dimensionless[Vector3] = Field(
        default=(0.0, 0.0, 1.0), description="Axis of the tool, in the flange frame."
    )
    directions: Dimensionless[Annotated[list[Vector3], Field(min_length=1, max_length=64)]] = Field(
        default=[(0.0, 0.0, -1.0)], description="Directions in which the tool's axis may point, axes of R0."
    )
    turns: Annotated[int, Field(strict=True, ge=1, le=360)] = Field(
        default=1,
        description="Number of angles about the tool's axis, evenly over a full turn. At the first one the "
        "flange's x axis, seen along the tool, points along x of R0 (along y if the tool points along x).",
    )
    force: Newtons[Vector3] = Field(description="Force of the process on the robot.")
    moment: Torque[Vector3 | None] = Field(
        default=None, description="Moment of the process on the robot, about the load point."
    )
    axes: Literal["base", "flange"] = Field(
        default="base", description="Frame in which force, moment and `direction` are given."
    )
    direction: Dimensionless[Vector3 | None] = Field(
        default=None,
        description="Direction along and across which compliance is computed; default: that of the force.",
    )
    limits: Radians[dict[Name, tuple[Quantity, Quantity]]] = Field(
        default_factory=dict,
        description="Additional joint limits, as controller angles, by joint name.",
    )
    near: Radians[Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)] | None] = Field(
        default=None,
        description="Controller angles: the posture nearest to them is used at each place, of all branches "
        "and orientations; default: the stiffest posture.",
    )
    confidence: Dimensionless[Annotated[float, Field(strict=True, ge=0.5, le=0.9999)]] = Field(
        default=0.95, description="Confidence level of the intervals."
    )


class MapRequest(MapOptions):
    """A map as it is posted."""

    run_id: Identifier = Field(description="Id of the run whose model is used.")


class MapCounts(Message):
    """Number of places by status."""

    reached: int = Field(description="Number of places with values.")
    out_of_reach: int = Field(description="Number of places that no posture reaches in any orientation.")
    joint_limits: int = Field(description="Number of places with every posture beyond the joint limits.")
    unseen_joint: int = Field(
        description="Number of places where the load twists a joint that the readings do not determine."
    )
    overloaded: int = Field(
        description="Number of places where the load reduces a joint's stiffness by half, or turns it by a "
        "quarter radian."
    )
    not_followed: int = Field(
        default=0,
        description="Number of places too near a singularity to follow the branch of `near`.",
    )


class MapPlace(Message):
    """One place."""

    position: Metres[Point] = Field(description="Position in R0.")
    joints: Radians[list[float]] = Field(
        description="Joint angles without the load, as the controller shows them."
    )
    tool_direction: Dimensionless[Point] = Field(description="Direction in which the tool's axis points.")
    displacement: Metres[Point] = Field(description="Displacement, loaded minus unloaded, axes of R0.")
    deflection: Metres[float] = Field(description="Length of the displacement.")
    readings_only: Metres[tuple[float, float] | None] = Field(
        description="Interval of that length from the readings alone; null if the uncertainty is unknown."
    )
    with_model_error: Metres[tuple[float, float] | None] = Field(
        description="Interval that includes the model error; null without a bound."
    )
    compliance_along: TranslationalCompliance[float | None] = Field(
        description="Compliance along the direction; null if a joint that the readings do not determine "
        "contributes."
    )
    compliance_across: TranslationalCompliance[float | None] = Field(
        description="Greatest compliance across the direction; null if a joint that the readings do not "
        "determine contributes."
    )
    extrapolation: Dimensionless[float | None] = Field(
        description="Load, or uncertainty per load, relative to the campaign's greatest: above 1 it is "
        "extrapolated. Null without a bound."
    )


class MapQuantile(Message):
    """A quantile of the deflection over the places reached."""

    share: Dimensionless[float]
    deflection: Metres[float]


class MapResult(FromRun):
    """A summary; the places themselves are downloaded as CSV or npz."""

    places: int
    counts: MapCounts
    quantiles: list[MapQuantile] = Field(description="Quantiles; empty if no place is reached.")
    worst: MapPlace | None = Field(
        description="Place with the largest deflection; null if no place is reached."
    )
    stiffest: MapPlace | None = Field(
        description="Place with the smallest deflection; null if no place is reached."
    )
    extrapolated: int = Field(
        description="Number of reached places whose load or posture is beyond the campaign's."
    )
    model_error_postures: int = Field(
        description="Number of postures that the bound of the model error is based on."
    )
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
    result: MapResult | None = Field(description="Result; present if the job has succeeded.")
