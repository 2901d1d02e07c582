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
    """Options of a process: those of a compensated program, and permitted turns and places."""

    turn: Annotated[
        Literal["free", "keep"] | tuple[Quantity, Quantity],
        Terminal("--turn", "free|keep|LEAST,GREATEST[deg]", parse_turn, unit="deg"),
    ] = Field(
        default="free",
        description="Turn of the tool about the spindle: `free`, `keep` (as programmed), or least and "
        "greatest turn from the program's, in units.angle.",
    )
    turns: Annotated[int, Field(strict=True, ge=1, le=MAX_TURNS)] = Field(
        default=72, description="Number of turns that are tried in a full turn."
    )
    feed: Annotated[
        Annotated[Quantity, Field(gt=0.0)] | None, Terminal("--feed", "SPEED[mm/s]", parse_feed, unit="m")
    ] = Field(
        default=None,
        description="Feed of the cut, in units.length per s; default: that of the table of loads, of the "
        "program, or of the cut. Moves that a program states faster carry no force.",
    )
    rate: Annotated[Quantity, Field(gt=0.0, le=1_000.0, json_schema_extra={"unit": "deg/mm"})] = Field(
        default=1.0,
        description="Greatest turn of the tool along the path; without a feed no joint moves faster, either. "
        "0.3 keeps nine tenths of the gain.",
    )
    branches: Literal["keep", "free"] = Field(
        default="keep",
        description="Branch of the inverse kinematics: the program's, or `free`: a program is written only "
        "if it can state the branches; else see turns.csv.",
    )
    clearance: Annotated[Quantity, Field(ge=0.0)] = Field(
        default=0.04,
        description="Least allowed singular value of the flange's Jacobian, in m, rad.",
    )
    objective: Literal["rms", "greatest"] = Field(
        default="rms",
        description="Deflection along the path that is minimised: root mean square, or greatest.",
    )
    place: Annotated[Box | None, Terminal("--place", "X,Y,Z,X,Y,Z[mm]", parse_box, unit="m")] = Field(
        default=None,
        description="Box in which the path's centre (the middle of its bounding box) may be, in "
        "units.length; default: the workpiece stays.",
    )
    grid: Annotated[tuple[_Count, _Count, _Count], Terminal("--grid", "N,N,N", parse_counts)] = Field(
        default=(4, 4, 3), description="Number of positions along x, y and z in the box."
    )
    place_turns: Annotated[int, Field(strict=True, ge=1, le=MAX_TURNS)] = Field(
        default=8, description="Number of turns of the workpiece about z, evenly over a full turn."
    )
    correct: StrictBool = Field(
        default=True, description="True: also compensate the remaining deflection, as `compensate` does."
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

    run_id: Identifier | None = Field(default=None, description="Id of the run whose model is used.")
    robot_id: Identifier | None = Field(
        default=None,
        description="Robot that was not measured, instead of `run_id`: its stiffness is assumed within a "
        "factor of two.",
    )
    files: Annotated[list[ProgramFile], Field(max_length=MAX_FILES)] = Field(
        default_factory=list,
        description="Program or table of poses, and the table of loads; post as the form's `files`.",
    )

    _one_source: Any = require_exactly_one("run_id", "robot_id")

    @property
    def name(self) -> str | None:
        """Name of the first file, for listings."""
        return next((file.name for file in self.files), None)


class DeflectionBand(Message):
    """A deflection along a path, or a difference of two deflections, with its intervals."""

    value: Metres[float]
    readings: Metres[Interval | None] = Field(
        description="Interval from the errors of readings and forces; null if unknown."
    )
    with_model_error: Metres[Interval | None] = Field(
        description="Interval that includes the model error; null if unknown."
    )


class ProcessPlace(Message):
    """A possible place of the workpiece."""

    centre: Metres[Point] = Field(description="Centre of the path in R0.")
    shift: Metres[Point] = Field(description="Displacement of the centre from its present place.")
    turn: Radians[float] = Field(description="Turn of the workpiece about z through its centre.")
    deflection: DeflectionBand
    behind_best: DeflectionBand | None = Field(
        description="Deflection minus that of the best place; null for the best place."
    )
    is_worse: StrictBool = Field(description="True if the interval of the difference excludes zero.")


class ProcessResult(ProgramResult):
    """Deflection before, after turning and after correction."""

    objective: Literal["rms", "greatest"]
    gain: Literal["less", "no_order", "no_gain"] = Field(
        description="Comparison of chosen path and program. `less`: the interval of the difference with "
        "model error excludes zero; else `no_order`. `no_gain`: no turn changes the deflection."
    )
    before: DeflectionBand | None = Field(
        description="Deflection along the path as sent; null if the robot does not follow the path there."
    )
    turned: DeflectionBand = Field(description="Deflection with the chosen turns and place.")
    remaining: DeflectionBand = Field(description="Deflection that remains after the correction.")
    difference: DeflectionBand | None = Field(description="`turned` minus `before`.")
    fixed_turns: Radians[list[float]] = Field(
        description="Constant turns that were tried along the whole path."
    )
    fixed_deflections: Metres[list[float | None]] = Field(
        description="Deflection with each constant turn, at the knots; null if limits exclude the turn."
    )
    feed: Annotated[float | None, Field(json_schema_extra={"unit": "m/s"})] = Field(
        default=None, description="Greatest feed under load; null if unknown: speeds are those at 0.05 m/s."
    )
    needed_speeds: Annotated[list[float], Field(json_schema_extra={"unit": "rad/s"})] = Field(
        default_factory=list, description="Greatest speed that each joint needs along the lines."
    )
    speed_shares: Dimensionless[list[float | None]] = Field(
        default_factory=list,
        description="Greatest part of each joint's speed by the maker; null if that is unknown.",
    )
    sent_speed_shares: Dimensionless[list[float | None]] = Field(
        default_factory=list, description="`speed_shares` of the program as sent; empty if unknown."
    )
    places: Annotated[list[ProcessPlace], Field(max_length=MAX_BEST_PLACES)] = Field(
        description="Best places of the workpiece, best first."
    )
    places_tried: int = Field(description="Number of places that were tried.")
    places_reached: int = Field(description="Number of places from which the robot follows the path.")
    flat_low: Metres[Point | None] = Field(
        description="Least coordinates of places within 5 % of the best, of all tried places."
    )
    flat_high: Metres[Point | None] = Field(
        description="Greatest coordinates of the places within 5 % of the best, if any."
    )
    flat_places: int = Field(description="Number of places within 5 % of the best.")
    frames: list[ProgramFrame] = Field(
        description="Base frames to set in the controller for the best place, in the program's notation. A "
        "base with numbers in the program stays, and its targets move."
    )
    choice: ProgramFile = Field(
        description="Tables of turns and places; null in answers: get `turns.csv` and `places.csv`."
    )


class Process(Job):
    """A stored process. Once finished, it never changes."""

    collection: ClassVar[str] = "processes"

    kind: Literal["process"] = "process"
    request: ProcessRequest
    result: ProcessResult | None = Field(description="Present if the job succeeded.")

    @property
    def outputs(self) -> list[str]:
        """SHA-256 of each corrected file, for listings; none if nothing was corrected."""
        files = self.result.files if self.result is not None and self.result.corrected else []
        return [file.sha256 for file in files if file.sha256]
