"""A program whose targets are corrected, so that the loaded tool is where each of them says."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, StrictBool, model_validator

from jointstiff.schemas.deflection import PredictionOptions
from jointstiff.schemas.fields import (
    Dimensionless,
    Identifier,
    Interval,
    Message,
    Metres,
    Name,
    Point,
    Quantity,
    Radians,
    Terminal,
    Vector3,
    make_fault,
    parse_force,
    parse_frame,
    parse_numbers,
)
from jointstiff.schemas.finding import AcceptingOptions
from jointstiff.schemas.job import FromRun, Job
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.robot import MAX_JOINTS

MAX_FILES = 13
"""Greatest number of posted files: of a program, and a table of its loads."""
MAX_FRAMES = 64
MAX_SEGMENTS = 1_000
MAX_LINE = 10_000_000
MAX_WORST = 20

ProgramFormat = Literal["csv", "krl", "fanuc", "rapid", "ur"]
LeftAlone = Literal["no_load", "uncertain", "not_used"]

_FrameNumbers = Annotated[
    list[Quantity],
    Field(
        min_length=6,
        max_length=7,
        description="Numbers as in the program: KUKA X, Y, Z, A, B, C, FANUC X, Y, Z, W, P, R: mm and °; "
        "ABB X, Y, Z in mm, q1 ... q4; UR x, y, z, rx, ry, rz: m and rad; CSV as its columns or KUKA.",
    ),
]
_Line = Annotated[int, Field(strict=True, ge=1, le=MAX_LINE)]


class ProgramFrame(Message):
    """A frame that the program names without its numbers."""

    name: Name | None = Field(
        default=None,
        description="Name in the program, such as `BASE_DATA[2]`, `UT 3` or `tMill`; default: all frames "
        "without numbers.",
    )
    values: _FrameNumbers


class ProcessLoad(Message):
    """A load of the process on the robot."""

    force: Vector3 = Field(description="Force on the tool, in units.force, along the axes of `axes`.")
    moment: Vector3 = Field(
        default=(0.0, 0.0, 0.0), description="Moment on the tool about the load point, in units.moment."
    )
    first_line: _Line | None = Field(
        default=None,
        description="First line of the moves under this load, from 1; default: first line of the program.",
    )
    last_line: _Line | None = Field(
        default=None,
        description="Last line of the moves under this load; default: last line of the program.",
    )

    @model_validator(mode="after")
    def _require_ordered_lines(self) -> ProcessLoad:
        first, last = self.first_line, self.last_line
        if first is not None and last is not None and last < first:
            raise make_fault("last_line", "`last_line` must not come before `first_line`")
        return self


CutMaterial = Literal[
    "steel", "alloy_steel", "stainless_steel", "cast_iron", "aluminium", "titanium", "nickel"
]


class Cut(Message):
    """A milling cut; its mean force follows from Kienzle's specific cutting force, in SI units."""

    material: CutMaterial | None = Field(
        default=None, description="Material, for `pressure` and `exponent`; or state both."
    )
    pressure: Annotated[
        Annotated[Quantity, Field(gt=0.0)] | None, Field(json_schema_extra={"unit": "Pa"})
    ] = Field(
        default=None, description="Specific cutting force k_c1.1: force per area for a chip 1 mm thick."
    )
    exponent: Dimensionless[Annotated[Quantity, Field(ge=0.0, lt=1.0)] | None] = Field(
        default=None, description="Exponent m_c of the chip's thickness."
    )
    diameter: Metres[Annotated[Quantity, Field(gt=0.0)]] = Field(description="Diameter of the tool.")
    teeth: Annotated[int, Field(strict=True, ge=1, le=1_000)] = Field(description="Number of teeth.")
    speed: Annotated[Quantity, Field(gt=0.0, json_schema_extra={"unit": "1/s"})] = Field(
        description="Speed of the spindle, which turns to the right."
    )
    feed: Annotated[Quantity, Field(gt=0.0, json_schema_extra={"unit": "m/s"})] = Field(
        description="Speed of the tool along its path."
    )
    depth: Metres[Annotated[Quantity, Field(gt=0.0)]] = Field(
        description="Depth of the cut along the spindle."
    )
    width: Metres[Annotated[Quantity, Field(gt=0.0)]] = Field(
        description="Width of the cut across the feed, at most the diameter."
    )
    direction: Literal["climb", "conventional"] = Field(
        default="climb", description="`climb`: the workpiece is on the right of the feed."
    )
    radial: Dimensionless[Annotated[Quantity, Field(ge=0.0)]] = Field(
        default=0.35, description="Radial force relative to the cutting force."
    )
    axial: Dimensionless[Quantity] = Field(
        default=0.0, description="Force from tip to spindle relative to the cutting force."
    )
    first_line: _Line | None = Field(
        default=None, description="First line of the cut; default: first line of the program."
    )
    last_line: _Line | None = Field(
        default=None, description="Last line of the cut; default: last line of the program."
    )

    @model_validator(mode="after")
    def _require_material(self) -> Cut:
        stated = (self.pressure is not None) + (self.exponent is not None)
        if stated != (0 if self.material is not None else 2):
            raise ValueError("state either `material`, or both `pressure` and `exponent`")
        first, last = self.first_line, self.last_line
        if first is not None and last is not None and last < first:
            raise make_fault("last_line", "`last_line` must not come before `first_line`")
        return self


class ProgramOptions(AcceptingOptions, PredictionOptions):
    """Options of a compensated program."""

    units: Units = Field(description="Units of the numbers in this request; the program has its own.")
    accuracy_option: Literal["off", "same_as_measured", "compensates_load"] = Field(
        description="Accuracy option of the controller: `off`; `same_as_measured`: on, as in the campaign; "
        "`compensates_load`: refused, because the load would be compensated twice."
    )
    load: Annotated[ProcessLoad | None, Terminal("--force", "X,Y,Z[N]", parse_force, unit="N")] = Field(
        default=None, description="Load of all moves, or of the moves in its lines; other moves have no load."
    )
    segments: Annotated[list[ProcessLoad], Field(max_length=MAX_SEGMENTS)] = Field(
        default_factory=list, description="Loads by lines, instead of `load`; other moves have no load."
    )
    loads: Name | None = Field(
        default=None,
        description="Name of the sent file of loads, instead of `load`: CSV with `point` (as in "
        "points.csv), `label` (of the target) or `length [mm]` (along lines and arcs, interpolated), `Fx "
        "[N]`, `Fy [N]`, `Fz [N]`, if needed `Mx [N.m]` ... Other points have no load.",
    )
    cut: Annotated[Cut | None, Terminal(hidden=True)] = Field(
        default=None,
        description="Milling cut from which the force is computed, instead of `load`; its values are in SI "
        "units.",
    )
    axes: Literal["robot", "tool", "base", "feed"] = Field(
        default="robot",
        description="Axes of forces: of R0, of the tool, of the program's base; or `feed`: feed, normal (to "
        "the right, seen from the spindle) and spindle.",
    )
    spindle: Annotated[Vector3 | None, Terminal("--spindle", "X,Y,Z", parse_numbers)] = Field(
        default=None,
        description="Direction from spindle to tip, flange frame; default: the tool's z axis.",
    )
    load_point: Annotated[Vector3 | None, Terminal(unit="m")] = Field(
        default=None,
        description="Point where the force acts, flange frame, in units.length; default: the tool's centre.",
    )
    tools: Annotated[
        list[ProgramFrame],
        Field(max_length=MAX_FRAMES),
        Terminal("--tool", "[NAME=]NUMBERS", parse_frame, "list"),
    ] = Field(default_factory=list, description="Tool frames that the program names without values.")
    bases: Annotated[
        list[ProgramFrame],
        Field(max_length=MAX_FRAMES),
        Terminal("--base", "[NAME=]NUMBERS", parse_frame, "list"),
    ] = Field(
        default_factory=list,
        description="Base frames in the controller's world that the program names without values.",
    )
    world: _FrameNumbers | None = Field(
        default=None, description="World frame of the controller in R0, if it differs from R0."
    )
    flange: _FrameNumbers | None = Field(
        default=None,
        description="Flange frame of the controller in the model's flange frame, if they differ.",
    )
    tool_x: Vector3 | None = Field(
        default=None,
        description="Direction of the tool's x axis in the base frame, for programs that state a position "
        "alone, or with the direction of the tool's z axis.",
    )
    start: Annotated[
        Annotated[list[Quantity], Field(max_length=MAX_JOINTS)] | None,
        Terminal("", "NUMBERS[deg]", parse_numbers, unit="deg"),
    ] = Field(
        default=None,
        description="Joints near the first cartesian target, as the controller shows them, in units.angle or "
        "units.length. Needed if the program does not state the configuration, or for prismatic "
        "joints, which stay there.",
    )
    max_displacement: Annotated[Annotated[Quantity, Field(gt=0.0)] | None, Terminal(unit="m")] = Field(
        default=None, description="Greatest displacement of a correction, in units.length; default: 5 mm."
    )
    max_rotation: Annotated[Annotated[Quantity, Field(gt=0.0)] | None, Terminal(unit="deg")] = Field(
        default=None, description="Greatest rotation of a correction, in units.angle; default: 10 mrad."
    )
    ramp_length: Annotated[Quantity, Field(ge=0.0), Terminal(unit="m")] = Field(
        default=0.0,
        description="Length of path over which corrections rise and fall with the load, in units.length.",
    )
    leave_alone: Annotated[list[Name], Field(max_length=1_000)] = Field(
        default_factory=list,
        description="Routines of other files that neither move the robot nor change its frames.",
    )
    trust_routines: StrictBool = Field(
        default=False,
        description="True: no unknown routine moves the robot, frames or points, except what it gets by "
        "reference.",
    )
    leave_others: StrictBool = Field(
        default=False,
        description="True: leave moves uncorrected whose target, base or tool is uncertain; false: refuse "
        "such a program.",
    )
    external_axes: Literal["carry_nothing"] | None = Field(
        default=None,
        description="`carry_nothing`: external axes carry neither arm nor part. If absent, moves with an "
        "external axis away from zero are not corrected.",
    )
    format: ProgramFormat | None = Field(
        default=None, description="Format of the program; default: by the file's name."
    )
    mark: StrictBool = Field(
        default=True,
        description="True: write run, verdict and date as a comment (always for the verdict do_not_use). A "
        "program with this comment is not corrected again.",
    )

    @model_validator(mode="after")
    def _require_one_load(self) -> ProgramOptions:
        """Refuse more than one statement of the load, and none unless `absolute` makes a load unnecessary."""
        loads = {"load": self.load, "segments": self.segments, "loads": self.loads, "cut": self.cut}
        stated = [field for field, load in loads.items() if load]
        if not stated and not self.absolute:
            reason = "state the load of the process: one of `load`, `segments`, `loads` and `cut`"
            raise make_fault("load", reason)
        if len(stated) > 1:
            first, second, *_ = stated
            raise make_fault(second, f"the load is stated by `{first}`, too; omit one of both")
        for index, segment in enumerate(self.segments):
            for line in ("first_line", "last_line"):
                if getattr(segment, line) is None:
                    reason = "each of `segments` needs `first_line` and `last_line`"
                    raise make_fault(("segments", index, line), reason)
        if self.absolute and self.ramp_length:
            reason = "omit `ramp_length`: `absolute` corrects the whole path, without a ramp"
            raise make_fault("ramp_length", reason)
        return self


class ProgramFile(Message):
    """A file that was sent or created."""

    name: Name
    bytes: int = Field(description="Size of the file.", json_schema_extra={"unit": "byte"})
    content: str | None = Field(default=None, description="Content; null in answers: get the file.")
    sha256: str | None = Field(default=None, description="SHA-256 of the file, hexadecimal.")


class ProgramRequest(ProgramOptions):
    """Request of a compensated program: options and files."""

    run_id: Identifier = Field(description="Id of the run whose model is used.")
    files: Annotated[list[ProgramFile], Field(max_length=MAX_FILES)] = Field(
        default_factory=list,
        description="Files of the program, first the file to correct, then the table of loads. Post them "
        "as the form's `files`.",
    )

    @property
    def name(self) -> str | None:
        """Name of the first file, for listings."""
        return next((file.name for file in self.files), None)


class Spread(Message):
    """Median, 95 % quantile and maximum over the points under load."""

    median: float
    p95: float
    greatest: float


class SpreadEnds(Message):
    """Lower and upper ends."""

    low: Spread
    high: Spread


class ProgramPoint(Message):
    """One target under load."""

    number: int = Field(description="Number of the point along the path, from 1.")
    name: str = Field(description="Name of the target in the program; may be empty.")
    line: int = Field(description="Line with the target's numbers.")
    place: Metres[Point] = Field(description="Programmed position of the tool's centre, in R0.")
    deflection: Metres[float] = Field(
        description="Distance by which the load moves the tool without a correction."
    )
    deflection_rotation: Radians[float]
    correction: Metres[float] = Field(description="Distance from the programmed to the commanded position.")
    correction_rotation: Radians[float]
    standard_uncertainty: Metres[float | None] = Field(
        description="Standard uncertainty of `deflection`; null if unknown."
    )
    interval: Metres[Interval | None] = Field(
        description="Interval of the deflection from the errors of the readings."
    )
    interval_with_model_error: Metres[Interval | None] = Field(
        default=None,
        description="Interval of the deflection with model error; null without a bound.",
    )
    residual: Metres[float] = Field(description="Predicted distance of the loaded tool from its target.")
    residual_rotation: Radians[float]
    residual_interval: Metres[Interval | None] = Field(
        default=None,
        description="Interval of the remaining distance.",
    )
    residual_interval_with_model_error: Metres[Interval | None] = Field(
        default=None,
        description="The same with the model error.",
    )
    rounding: Metres[float] = Field(
        description="Part of `residual` due to the rounding of numbers in the program."
    )
    share: Dimensionless[float] = Field(description="Fraction of the full correction that is applied.")
    capped: StrictBool = Field(description="True if the limits reduce the correction.")


class ProgramResult(FromRun):
    """Counts, spreads and the worst points; the files have all points."""

    format: ProgramFormat
    points: int = Field(description="Number of targets of the program.")
    moves: int = Field(description="Number of moves of the program.")
    moves_left: int = Field(
        default=0,
        description="Number of uncertain moves, which are left uncorrected.",
    )
    corrected: int = Field(description="Number of corrected targets.")
    capped: int = Field(description="Number of targets whose correction is reduced by the limits.")
    left_alone: dict[LeftAlone, int] = Field(description="Number of targets without a correction, by reason.")
    deflection: Metres[Spread | None] = Field(
        description="Distance of the tool from its target without correction; null if no point is loaded."
    )
    correction: Metres[Spread | None] = Field(description="Displacement of targets by the correction.")
    residual: Metres[Spread | None] = Field(
        description="Distance of the tool from its target with the compensated program."
    )
    deflection_ends: Metres[SpreadEnds | None] = Field(
        default=None, description="Ends of the intervals of `deflection`."
    )
    residual_ends: Metres[SpreadEnds | None] = Field(
        default=None, description="Ends of the intervals of `residual`."
    )
    with_model_error: StrictBool = Field(
        default=False,
        description="True: the intervals include the model error.",
    )
    rounding: Metres[Spread | None] = Field(
        description="Part of `residual` due to the rounding of numbers in the program."
    )
    confidence: Dimensionless[float] = Field(description="Confidence of the intervals.")
    worst: Annotated[list[ProgramPoint], Field(max_length=MAX_WORST)] = Field(
        description="Points with the greatest deflections without a correction, greatest first."
    )
    remarks: list[str] = Field(description="Remarks on unchanged lines and on the prediction.")
    files: list[ProgramFile] = Field(description="Compensated program; null in answers: its file `program`.")
    table: ProgramFile = Field(description="All points; null in answers: its file `points.csv`.")


class Program(Job):
    """A stored compensated program. It never changes."""

    collection: ClassVar[str] = "programs"

    kind: Literal["program"] = "program"
    request: ProgramRequest
    result: ProgramResult | None = Field(description="Present if the job succeeded.")

    @property
    def outputs(self) -> list[str]:
        """SHA-256 of each corrected file, for listings; none if nothing was corrected."""
        files = self.result.files if self.result is not None and self.result.corrected else []
        return [file.sha256 for file in files if file.sha256]
