"""Correction of poses: columns of poses, joints and forces in; the same columns corrected, with a status."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import FailFast, Field

from jointstiff.schemas.deflection import PredictionOptions
from jointstiff.schemas.fields import (
    Dimensionless,
    Identifier,
    Name,
    Quantity,
    Terminal,
    Vector3,
    parse_numbers,
    parse_numbers_in_newtons,
    require_exactly_one,
)
from jointstiff.schemas.finding import AcceptingOptions
from jointstiff.schemas.job import FromRun, Job
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.program import ProgramFile
from jointstiff.schemas.robot import MAX_JOINTS

MAX_ROWS = 5_000
"""Greatest number of rows that a service corrects at once; more rows are a job."""
MAX_TABLE_ROWS = 100_000
"""Greatest number of rows of a job."""
_MOST_SENT_ROWS = 2**20
"""Numbers of two bytes in a body of 2 MiB: the answer says what to do with any larger number of rows."""
MAX_COLUMNS = 64

CorrectionStatus = Literal[
    "corrected",
    "no_load",
    "capped",
    "uncertain",
    "beyond_limits",
    "not_reached",
    "ambiguous",
    "contradictory",
    "unseen_joint",
    "overloaded",
    "no_direction",
]
_Frame = Annotated[list[Quantity], Field(min_length=6, max_length=6)]


class CorrectionOptions(AcceptingOptions, PredictionOptions):
    """Options of corrected poses."""

    units: Units = Field(
        description="Units of the numbers in the request, also of the columns of the answer."
    )
    accuracy_option: Literal["off", "same_as_measured", "compensates_load"] = Field(
        default="off",
        description="Accuracy option of the controller, with the values that a compensated program has.",
    )
    tool: Annotated[_Frame | None, Terminal("--tool", "X,Y,Z,RX,RY,RZ[mm,deg]", parse_numbers)] = Field(
        default=None,
        description="Frame of the tool in the flange frame, as position and rotation vector; default: "
        "the flange frame.",
    )
    base: Annotated[_Frame | None, Terminal("--base", "X,Y,Z,RX,RY,RZ[mm,deg]", parse_numbers)] = Field(
        default=None,
        description="Frame of the poses in the base frame R0, as position and rotation vector; default: R0.",
    )
    force: Annotated[Vector3 | None, Terminal("--force", "X,Y,Z[N]", parse_numbers_in_newtons)] = Field(
        default=None,
        description="Force on the tool in every row; omit this field if the columns `fx`, `fy`, `fz` "
        "state forces.",
    )
    axes: Literal["robot", "base", "tool", "feed"] = Field(
        default="robot",
        description="Axes along which forces are stated: the robot's base, the poses' base, the tool, or "
        "the path (feed, normal and z axis of the tool).",
    )
    load_point: Annotated[Vector3 | None, Terminal("--load-point", "X,Y,Z[mm]", parse_numbers)] = Field(
        default=None,
        description="Point where the force acts, in the flange frame; default: the centre of the tool.",
    )
    feed: Annotated[Annotated[Quantity, Field(gt=0.0)] | None, Terminal("--feed", "NUMBER[mm/s]", float)] = (
        Field(
            default=None,
            description="Speed of the tool in units.length per s; used for `joint_speed` and for corners of "
            "the path.",
        )
    )
    start: Annotated[
        Annotated[list[Quantity], Field(max_length=MAX_JOINTS)] | None,
        Terminal("--start", "NUMBERS[deg]", parse_numbers),
    ] = Field(
        default=None,
        description="Joint positions near the first pose, as the controller shows them; needed if no "
        "columns state the joints.",
    )
    max_displacement: Annotated[
        Annotated[Quantity, Field(gt=0.0)] | None, Terminal("--max-displacement", "NUMBER[mm]", float)
    ] = Field(
        default=None, description="Greatest displacement of a correction, in units.length; default: 5 mm."
    )
    max_rotation: Annotated[
        Annotated[Quantity, Field(gt=0.0)] | None, Terminal("--max-rotation", "NUMBER[deg]", float)
    ] = Field(
        default=None, description="Greatest rotation of a correction, in units.angle; default: 10 mrad."
    )


_Column = Annotated[list[Quantity], Field(min_length=1, max_length=_MOST_SENT_ROWS), FailFast()]


class CorrectionRequest(CorrectionOptions):
    """Request to correct poses, which are sent as columns or as a file."""

    run_id: Identifier | None = Field(
        default=None, description="Id of the run whose identified model is used."
    )
    robot_id: Identifier | None = Field(
        default=None,
        description="Id of a robot without measurements, whose stiffness is assumed from a prior.",
    )
    columns: Annotated[dict[Name, _Column], Field(max_length=MAX_COLUMNS)] = Field(
        default_factory=dict,
        description="Columns of equal length. Position of the tool in the base: `x`, `y`, `z`. Rotation: "
        "`rx`, `ry`, `rz` (rotation vector), `a`, `b`, `c` (about z, y', x'') or `q1` ... "
        "`q4`. Optional columns: joints `j1` ... and loads `fx` ... `mz`.",
    )
    files: Annotated[list[ProgramFile], Field(max_length=1)] = Field(
        default_factory=list,
        description="Table of poses, in place of `columns`. Post the table as the form's `files`.",
    )

    _one_source = require_exactly_one("run_id", "robot_id")

    @property
    def name(self) -> str | None:
        """Name of the table, for listings."""
        return next((file.name for file in self.files), None)


class CorrectionResult(FromRun):
    """Corrected rows."""

    confidence: Dimensionless[float]
    counts: dict[CorrectionStatus, int] = Field(description="Number of rows by status.")
    first: dict[CorrectionStatus, int] = Field(
        description="Number of the first row with each status, from 1."
    )
    remarks: list[str]
    columns: dict[str, list[Any]] = Field(
        default_factory=dict,
        description="Columns of the answer; empty in a job. Corrected pose and joints are null unless "
        "`status` is `corrected`, `no_load`, `capped` or `uncertain`. `dx`, `dy` and `dz` "
        "are the deflection without a correction, along the axes of the base. `readings` and "
        "`model_error` are half-widths of intervals of the deflection's length. Further "
        "columns are `residual` and `joint_speed`.",
    )
    table: ProgramFile | None = Field(default=None, description="Rows of a job.")


class CorrectionJob(Job):
    """A stored correction of a table of poses."""

    collection: ClassVar[str] = "corrections"

    kind: Literal["correction"] = "correction"
    request: CorrectionRequest
    result: CorrectionResult | None = Field(description="Present if the job succeeded.")
