"""A path of a process with the least deflection: turns about the spindle, and places of the workpiece."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, StrictBool, model_validator

from jointstiff.schemas.fields import (
    Dimensionless,
    Identifier,
    Interval,
    Message,
    Metres,
    Point,
    Quantity,
    Radians,
    Terminal,
    parse_box,
    require_exactly_one,
)
from jointstiff.schemas.job import Job
from jointstiff.schemas.plan import Box
from jointstiff.schemas.program import (
    MAX_FILES,
    ProgramFile,
    ProgramFrame,
    ProgramOptions,
    ProgramResult,
)

MAX_TURNS = 360
MAX_PROCESS_PLACES = 4_000
MAX_BEST_PLACES = 5

_Count = Annotated[int, Field(strict=True, ge=1, le=100)]


def parse_turn(text: str) -> str | list[float]:
    """Parse `free`, `keep` or a range `LEAST,GREATEST` in degrees; return its JSON."""
    if text in {"free", "keep"}:
        return text
    try:
        least, greatest = (float(number) for number in text.replace(",", " ").split())
    except ValueError:
        raise ValueError(f"'{text}' must be free, keep or a range in degrees, such as -30,30") from None
    return [least, greatest]


def parse_counts(text: str) -> list[int]:
    """Parse whole numbers that are separated by commas or blanks; return them."""
    try:
        return [int(number) for number in text.replace(",", " ").split()]
    except ValueError:
        raise ValueError(f"'{text}' must be whole numbers, such as 4,4,3") from None


def parse_feed(text: str) -> float:
    """Parse a feed in mm/s; return it in m/s."""
    try:
        return 1e-3 * float(text)
    except ValueError:
        raise ValueError(f"'{text}' must be a feed in mm/s, such as 50") from None


class ProcessOptions(ProgramOptions):
    """Options of a compensated program, with permitted rotations of the tool and places of the workpiece."""

    turn: Annotated[
        Literal["free", "keep"] | tuple[Quantity, Quantity],
        Terminal("--turn", "free|keep|LEAST,GREATEST[deg]", parse_turn, unit="deg"),
    ] = Field(
        default="free",
        description="Rotation of the tool about the spindle: `free`, `keep` (as programmed), or a range "
        "from the programmed rotation, in units.angle.",
    )
    turns: Annotated[int, Field(strict=True, ge=1, le=MAX_TURNS)] = Field(
        default=72, description="Number of rotations of the tool to try over 360°."
    )
    feed: Annotated[
        Annotated[Quantity, Field(gt=0.0)] | None, Terminal("--feed", "SPEED[mm/s]", parse_feed, unit="m")
    ] = Field(
        default=None,
        description="Feed of the cut, in units.length per s; default: the feed of the loads, the program "
        "or the cut. Moves with a faster programmed speed carry no force.",
    )
    rate: Annotated[Quantity, Field(gt=0.0, le=1_000.0, json_schema_extra={"unit": "deg/mm"})] = Field(
        default=1.0,
        description="Greatest rotation of the tool per length of path. Without a feed, the value also "
        "limits the joint speeds. With 0.3, the path keeps 90 % of the possible reduction of "
        "the deflection.",
    )
    branches: Literal["keep", "free"] = Field(
        default="keep",
        description="Branch of the inverse kinematics: the program's branch, or `free`. With `free`, a "
        "program that cannot state branches is not written; the file turns.csv then has the "
        "branches.",
    )
    clearance: Annotated[Quantity, Field(ge=0.0)] = Field(
        default=0.04,
        description="Least allowed singular value of the flange's Jacobian, in m and rad.",
    )
    objective: Literal["rms", "greatest"] = Field(
        default="rms",
        description="Quantity that is minimised: the root mean square or the greatest deflection along the "
        "path.",
    )
    place: Annotated[Box | None, Terminal("--place", "X,Y,Z,X,Y,Z[mm]", parse_box, unit="m")] = Field(
        default=None,
        description="Box for the centre of the path's bounding box, in units.length; default: the "
        "workpiece does not move.",
    )
    grid: Annotated[tuple[_Count, _Count, _Count], Terminal("--grid", "N,N,N", parse_counts)] = Field(
        default=(4, 4, 3), description="Number of positions along x, y and z that are tried in the box."
    )
    place_turns: Annotated[int, Field(strict=True, ge=1, le=MAX_TURNS)] = Field(
        default=8,
        description="Number of rotations of the workpiece about z that are tried, evenly over a full turn.",
    )
    correct: StrictBool = Field(
        default=True, description="True to also compensate the remaining deflection, as `compensate` does."
    )
    force_uncertainty: Dimensionless[Annotated[Quantity, Field(ge=0.0, le=1.0)] | None] = Field(
        default=None,
        description="Relative standard uncertainty of each component of the force; default: 0.25 for a "
        "`cut`, else 0.",
    )

    @model_validator(mode="after")
    def _limit_places(self) -> ProcessOptions:
        """Refuse a range or a box whose ends are exchanged, and too many places."""
        if isinstance(self.turn, tuple) and self.turn[0] > self.turn[1]:
            raise ValueError("`turn` needs the least turn first")
        if self.place is not None and any(a > b for a, b in zip(*self.place, strict=True)):
            raise ValueError("the first corner of `place` must have the least coordinates")
        count = self.grid[0] * self.grid[1] * self.grid[2] * self.place_turns
        if self.place is not None and count > MAX_PROCESS_PLACES:
            raise ValueError(
                f"`grid` and `place_turns` give {count} places of the workpiece, but at most "
                f"{MAX_PROCESS_PLACES} are possible"
            )
        return self


class ProcessRequest(ProcessOptions):
    """Request of a process: options and files."""

    run_id: Identifier | None = Field(
        default=None, description="Id of the run whose identified model is used."
    )
    robot_id: Identifier | None = Field(
        default=None,
        description="Id of a robot without measurements, instead of `run_id`. The stiffness is then "
        "assumed to be known within a factor of two.",
    )
    files: Annotated[list[ProgramFile], Field(max_length=MAX_FILES)] = Field(
        default_factory=list,
        description="Program or table of poses, with the table of loads; post the files as the form's "
        "`files`.",
    )

    _one_source: Any = require_exactly_one("run_id", "robot_id")

    @property
    def name(self) -> str | None:
        """Name of the first file, for listings."""
        return next((file.name for file in self.files), None)


class DeflectionBand(Message):
    """A deflection along a path, or a difference of two deflections, with intervals."""

    value: Metres[float]
    readings: Metres[Interval | None] = Field(
        description="Interval that includes the errors of the readings and of the forces; null if unknown."
    )
    with_model_error: Metres[Interval | None] = Field(
        description="Interval that also includes the model error; null if unknown."
    )


class ProcessPlace(Message):
    """A possible place of the workpiece."""

    centre: Metres[Point] = Field(description="Centre of the path in the robot's base frame R0.")
    shift: Metres[Point] = Field(description="Displacement of the centre of the path from the present place.")
    turn: Radians[float] = Field(
        description="Rotation of the workpiece about z through the centre of the path."
    )
    deflection: DeflectionBand
    behind_best: DeflectionBand | None = Field(
        description="Deflection at the place minus deflection at the best place; null for the best place."
    )
    is_worse: StrictBool = Field(description="True if the interval of the difference excludes zero.")


class ProcessResult(ProgramResult):
    """Deflection before, after turning and after correction."""

    objective: Literal["rms", "greatest"]
    gain: Literal["less", "no_order", "no_gain"] = Field(
        description="Comparison of the chosen path with the program. `less`: the interval of the "
        "difference, with model error, excludes zero. `no_order`: the interval contains "
        "zero. `no_gain`: no rotation of the tool changes the deflection."
    )
    before: DeflectionBand | None = Field(
        description="Deflection along the path as sent; null if the robot cannot follow the path as sent."
    )
    turned: DeflectionBand = Field(
        description="Deflection with the chosen rotations of the tool, at the chosen place of the workpiece."
    )
    remaining: DeflectionBand = Field(description="Deflection that remains after the compensation.")
    difference: DeflectionBand | None = Field(description="`turned` minus `before`.")
    fixed_turns: Radians[list[float]] = Field(
        description="Constant rotations of the tool that were tried along the whole path."
    )
    fixed_deflections: Metres[list[float | None]] = Field(
        description="Deflection with each constant rotation of the tool, at sampled points of the path; "
        "null if joint limits exclude the rotation."
    )
    feed: Annotated[float | None, Field(json_schema_extra={"unit": "m/s"})] = Field(
        default=None,
        description="Greatest feed under load; null if unknown. Joint speeds are then computed for 0.05 m/s.",
    )
    needed_speeds: Annotated[list[float], Field(json_schema_extra={"unit": "rad/s"})] = Field(
        default_factory=list, description="Greatest speed that the lines of the path demand of each joint."
    )
    speed_shares: Dimensionless[list[float | None]] = Field(
        default_factory=list,
        description="Greatest speed of each joint divided by the maker's limit; null if the limit is "
        "unknown.",
    )
    sent_speed_shares: Dimensionless[list[float | None]] = Field(
        default_factory=list,
        description="Values of `speed_shares` for the program as sent; empty if unknown.",
    )
    places: Annotated[list[ProcessPlace], Field(max_length=MAX_BEST_PLACES)] = Field(
        description="Best places of the workpiece; the very best is first."
    )
    places_tried: int = Field(description="Number of places of the workpiece that were tried.")
    places_reached: int = Field(
        description="Number of places of the workpiece at which the robot can follow the path."
    )
    flat_low: Metres[Point | None] = Field(
        description="Least coordinates of all tried places whose deflection is within 5 % of the best."
    )
    flat_high: Metres[Point | None] = Field(
        description="Greatest coordinates of all tried places whose deflection is within 5 % of the best; "
        "null if there are none."
    )
    flat_places: int = Field(description="Number of tried places whose deflection is within 5 % of the best.")
    frames: list[ProgramFrame] = Field(
        description="Base frames to set in the controller for the best place, in the notation of the "
        "program. If the program states a base by numbers, the base stays and the targets "
        "move."
    )
    choice: ProgramFile = Field(
        description="Tables of rotations and places; null in answers, because the files `turns.csv` and "
        "`places.csv` contain them."
    )


class Process(Job):
    """A stored process."""

    collection: ClassVar[str] = "processes"

    kind: Literal["process"] = "process"
    request: ProcessRequest
    result: ProcessResult | None = Field(description="Present if the job succeeded.")

    @property
    def outputs(self) -> list[str]:
        """SHA-256 of each corrected file, for listings; none if nothing was corrected."""
        files = self.result.files if self.result is not None and self.result.corrected else []
        return [file.sha256 for file in files if file.sha256]
