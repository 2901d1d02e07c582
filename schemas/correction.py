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

    units: Units = Field(description="Units of the numbers, also of the answer's columns.")
    accuracy_option: Literal["off", "same_as_measured", "compensates_load"] = Field(
        default="off", description="Accuracy option of the controller, as of a compensated program."
    )
    tool: Annotated[_Frame | None, Terminal("--tool", "X,Y,Z,RX,RY,RZ[mm,deg]", parse_numbers)] = Field(
        default=None,
        description="Tool in the flange frame: X, Y, Z, rotation vector; default: the flange.",
    )
    base: Annotated[_Frame | None, Terminal("--base", "X,Y,Z,RX,RY,RZ[mm,deg]", parse_numbers)] = Field(
        default=None, description="Base of the poses in R0: X, Y, Z, rotation vector; default: R0."
    )
    force: Annotated[Vector3 | None, Terminal("--force", "X,Y,Z[N]", parse_numbers)] = Field(
        default=None, description="Force on the tool in all rows; or give columns `fx`, `fy`, `fz`."
    )
    axes: Literal["robot", "base", "tool", "feed"] = Field(
        default="robot",
        description="Axes of forces: of R0, of the base, of the tool; or feed, normal and the tool's z axis.",
    )
    load_point: Annotated[Vector3 | None, Terminal("--load-point", "X,Y,Z[mm]", parse_numbers)] = Field(
        default=None, description="Point where the force acts, flange frame; default: the tool's centre."
    )
    feed: Annotated[Annotated[Quantity, Field(gt=0.0)] | None, Terminal("--feed", "NUMBER[mm/s]", float)] = (
        Field(
            default=None,
            description="Speed of the tool, in units.length per s: for `joint_speed` and corners.",
        )
    )
    start: Annotated[
        Annotated[list[Quantity], Field(max_length=MAX_JOINTS)] | None,
        Terminal("--start", "NUMBERS[deg]", parse_numbers),
    ] = Field(
        default=None,
        description="Controller's joints near the first pose; needed without columns of joints.",
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


class _CorrectionSource(CorrectionOptions):
    """Options with the source of the stiffness."""

    run_id: Identifier | None = Field(default=None, description="Id of the run whose model is used.")
    robot_id: Identifier | None = Field(
        default=None, description="Id of a robot without a run: its stiffness is a prior."
    )

    _one_source = require_exactly_one("run_id", "robot_id")


class CorrectionRequest(_CorrectionSource):
    """A request of corrected poses."""

    columns: Annotated[dict[Name, _Column], Field(min_length=6, max_length=MAX_COLUMNS)] = Field(
        description="Columns of equal length: `x`, `y`, `z` of the tool in the base; "
        "`rx`, `ry`, `rz` (rotation vector), `a`, `b`, `c` (about z, y', x'') or `q1` ... `q4`; if known the "
        "controller's joints `j1` ...; `fx` ... `mz`. Over 5,000 rows are a job."
    )


class CorrectionTableRequest(_CorrectionSource):
    """A request of a corrected table, as its job stores it."""

    files: Annotated[list[ProgramFile], Field(max_length=1)] = Field(
        default_factory=list, description="The table. Post it as the form's `files`."
    )

    @property
    def name(self) -> str | None:
        """Name of the table, for listings."""
        return next((file.name for file in self.files), None)


class CorrectionCounts(FromRun):
    """Rows by status, and what is to be known about them."""

    confidence: Dimensionless[float]
    counts: dict[CorrectionStatus, int] = Field(description="Number of rows by status.")
    first: dict[CorrectionStatus, int] = Field(description="First row of each status, from 1.")
    remarks: list[str]


class CorrectionResult(CorrectionCounts):
    """Corrected rows."""

    columns: dict[str, list[Any]] = Field(
        description="`status` of each row; corrected pose and joints as sent (null unless `corrected`, "
        "`no_load`, `capped` or `uncertain`); `dx`, `dy`, `dz`: deflection without a correction, axes of the "
        "base, `readings` and `model_error`: half-widths of its length's interval; `residual`; `joint_speed`."
    )


class CorrectionTableResult(CorrectionCounts):
    """Counts of a corrected table; its files `rows.csv`, `rows.json` and `rows.parquet` have the rows."""

    table: ProgramFile = Field(description="All rows; null in answers.")


class CorrectionJob(Job):
    """A stored correction of a table of poses. It never changes."""

    collection: ClassVar[str] = "corrections"

    kind: Literal["correction"] = "correction"
    request: CorrectionTableRequest
    result: CorrectionTableResult | None = Field(description="Present if the job succeeded.")
