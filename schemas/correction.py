"""Correction of poses, in tables or in robot programs, so that the loaded tool is where each of them says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import PurePath
from typing import Annotated, Any, ClassVar, Final, Literal

from pydantic import FailFast, Field, StrictBool, model_validator

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
    parse_frame,
    parse_numbers,
    parse_numbers_in_newtons,
    require_exactly_one,
)
from jointstiff.schemas.finding import AcceptingOptions
from jointstiff.schemas.job import FromRun, Job
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.robot import MAX_JOINTS

MAX_ROWS = 5_000
"""Greatest number of rows that a service corrects at once; more rows are a job."""
MAX_TABLE_ROWS = 100_000
"""Greatest number of rows of a job."""
_MOST_SENT_ROWS = 2**20
"""Numbers of two bytes in a body of 2 MiB: the answer says what to do with any larger number of rows."""
MAX_COLUMNS = 64
MAX_FILES = 13
"""Greatest number of posted files: of a program, and a table of its loads."""
MAX_FRAMES = 64
MAX_SEGMENTS = 1_000
MAX_LINE = 10_000_000
MAX_WORST = 20
_TABLE_ENDINGS: Final = frozenset(("", ".csv", ".parquet", ".tsv", ".txt", ".xls", ".xlsx"))
"""Endings of files that are tables of poses, unless `format` is stated; other files are robot programs."""

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
ProgramFormat = Literal["csv", "krl", "fanuc", "rapid", "ur"]
LeftAlone = Literal["no_load", "uncertain", "not_used"]

_Frame = Annotated[list[Quantity], Field(min_length=6, max_length=6)]
_FrameNumbers = Annotated[
    list[Quantity],
    Field(
        min_length=6,
        max_length=7,
        description="Numbers of the frame as in the program. KUKA: X, Y, Z, A, B, C; FANUC: X, Y, Z, W, "
        "P, R (mm and °). ABB: X, Y, Z in mm, q1 ... q4. UR: x, y, z, rx, ry, rz (m and "
        "rad). CSV: as its columns or KUKA.",
    ),
]
_Line = Annotated[int, Field(strict=True, ge=1, le=MAX_LINE)]


class ProgramFrame(Message):
    """Numbers of a frame that the program only names."""

    name: Name | None = Field(
        default=None,
        description="Name of the frame in the program, such as `BASE_DATA[2]`, `UT 3` or `tMill`; default: "
        "all frames without numbers.",
    )
    values: _FrameNumbers


class ProcessLoad(Message):
    """A load of the process on the robot."""

    force: Vector3 = Field(
        description="Force on the tool, in units.force, along the axes that `axes` states."
    )
    moment: Vector3 = Field(
        default=(0.0, 0.0, 0.0),
        description="Moment on the tool about the load point, in units.moment, along the same axes as "
        "the force.",
    )
    first_line: _Line | None = Field(
        default=None,
        description="First line of the moves under this load, counted from 1; default: the first line of "
        "the program.",
    )
    last_line: _Line | None = Field(
        default=None,
        description="Last line of the moves under this load; default: the last line of the program.",
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
    """A milling cut, whose mean force follows from Kienzle's specific cutting force.

    Numbers are in SI units.
    """

    material: CutMaterial | None = Field(
        default=None,
        description="Material of the workpiece, which gives `pressure` and `exponent`; omit if "
        "`pressure` and `exponent` are stated.",
    )
    pressure: Annotated[
        Annotated[Quantity, Field(gt=0.0)] | None, Field(json_schema_extra={"unit": "Pa"})
    ] = Field(
        default=None,
        description="Specific cutting force k_c1.1, for a chip that is 1 mm thick.",
    )
    exponent: Dimensionless[Annotated[Quantity, Field(ge=0.0, lt=1.0)] | None] = Field(
        default=None,
        description="Exponent m_c by which the specific cutting force falls with the chip's thickness.",
    )
    diameter: Metres[Annotated[Quantity, Field(gt=0.0)]] = Field(description="Diameter of the tool.")
    teeth: Annotated[int, Field(strict=True, ge=1, le=1_000)] = Field(description="Number of teeth.")
    speed: Annotated[Quantity, Field(gt=0.0, json_schema_extra={"unit": "1/s"})] = Field(
        description="Speed of the spindle, which turns clockwise."
    )
    feed: Annotated[Quantity, Field(gt=0.0, json_schema_extra={"unit": "m/s"})] = Field(
        description="Speed of the tool along its path."
    )
    depth: Metres[Annotated[Quantity, Field(gt=0.0)]] = Field(
        description="Depth of the cut along the spindle."
    )
    width: Metres[Annotated[Quantity, Field(gt=0.0)]] = Field(
        description="Width of the cut across the feed, at most the diameter of the tool."
    )
    direction: Literal["climb", "conventional"] = Field(
        default="climb",
        description="Direction of the cut; `climb`: the workpiece is on the right of the feed.",
    )
    radial: Dimensionless[Annotated[Quantity, Field(ge=0.0)]] = Field(
        default=0.35, description="Radial force divided by the cutting force."
    )
    axial: Dimensionless[Quantity] = Field(
        default=0.0, description="Axial force from tip to spindle, divided by the cutting force."
    )
    first_line: _Line | None = Field(
        default=None, description="First line of the cut; default: the first line of the program."
    )
    last_line: _Line | None = Field(
        default=None, description="Last line of the cut; default: the last line of the program."
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


class _PoseOptions(AcceptingOptions, PredictionOptions):
    """Options of corrected poses, in a table or in a program."""

    units: Units = Field(
        description="Units of the numbers in the request, also of the columns of the answer; a program has "
        "units of its own."
    )
    accuracy_option: Literal["off", "same_as_measured", "compensates_load"] | None = Field(
        default=None,
        description="Accuracy option of the controller. `off`: switched off. `same_as_measured`: "
        "switched on, as in the campaign. `compensates_load`: refused, because the load "
        "would be compensated twice. Required for a program; default for poses: `off`.",
    )
    tool: Annotated[_Frame | None, Terminal("", "X,Y,Z,RX,RY,RZ[mm,deg]", parse_numbers, unit="mm,deg")] = (
        Field(
            default=None,
            description="Frame of the tool in the flange frame, as position and rotation vector; default: "
            "the flange frame.",
        )
    )
    base: Annotated[_Frame | None, Terminal("", "X,Y,Z,RX,RY,RZ[mm,deg]", parse_numbers, unit="mm,deg")] = (
        Field(
            default=None,
            description="Frame of the poses in the base frame R0, as position and rotation vector; "
            "default: R0.",
        )
    )
    force: Annotated[Vector3 | None, Terminal("", "X,Y,Z[N]", parse_numbers_in_newtons, unit="N")] = Field(
        default=None,
        description="Force on the tool in every row or move, in units.force; omit this field if the columns "
        "`fx`, `fy`, `fz` state forces.",
    )
    axes: Literal["robot", "base", "tool", "feed"] = Field(
        default="robot",
        description="Axes along which forces are stated: the robot's base frame R0, the base of the poses, "
        "the tool, or the path. The axes of `feed` are feed, normal (to the right, seen from the spindle) "
        "and spindle.",
    )
    load_point: Annotated[Vector3 | None, Terminal("", "X,Y,Z[mm]", parse_numbers, unit="mm")] = Field(
        default=None,
        description="Point where the force acts, in the flange frame, in units.length; default: the centre "
        "of the tool.",
    )
    feed: Annotated[
        Annotated[Quantity, Field(gt=0.0)] | None, Terminal("", "NUMBER[mm/s]", float, unit="mm")
    ] = Field(
        default=None,
        description="Speed of the tool in units.length per s; used for `joint_speed` and for corners of "
        "the path.",
    )
    start: Annotated[
        Annotated[list[Quantity], Field(max_length=MAX_JOINTS)] | None,
        Terminal("", "NUMBERS[deg]", parse_numbers, unit="deg"),
    ] = Field(
        default=None,
        description="Joint positions near the first pose, as the controller shows them, in units.angle or "
        "units.length. Needed if no columns state the joints, if a program does not state the "
        "configuration, and for prismatic joints, which keep these positions.",
    )
    max_displacement: Annotated[
        Annotated[Quantity, Field(gt=0.0)] | None, Terminal("", "NUMBER[mm]", float, unit="mm")
    ] = Field(
        default=None, description="Greatest displacement of a correction, in units.length; default: 5 mm."
    )
    max_rotation: Annotated[
        Annotated[Quantity, Field(gt=0.0)] | None, Terminal("", "NUMBER[deg]", float, unit="deg")
    ] = Field(
        default=None, description="Greatest rotation of a correction, in units.angle; default: 10 mrad."
    )


class _ProgramOptions(Message):
    """Options of robot programs, which tables of poses do not have."""

    segments: Annotated[list[ProcessLoad], Field(max_length=MAX_SEGMENTS)] = Field(
        default_factory=list,
        description="Loads of ranges of lines, instead of `force`; other moves have no load.",
    )
    loads: Name | None = Field(
        default=None,
        description="Name of the sent file of loads, instead of `force`. The CSV file has a column "
        "`point` (as in rows.csv), `label` (of the target) or `length [mm]` (along lines "
        "and arcs, interpolated). Further columns are `Fx [N]`, `Fy [N]`, `Fz [N]`, if "
        "needed `Mx [N.m]` ... Other points have no load.",
    )
    cut: Annotated[Cut | None, Terminal(hidden=True)] = Field(
        default=None,
        description="Milling cut from which the force is computed, instead of `force`; its numbers are in SI "
        "units.",
    )
    spindle: Annotated[Vector3 | None, Terminal("", "X,Y,Z", parse_numbers)] = Field(
        default=None,
        description="Direction from spindle to tip, in the flange frame; default: the z axis of the tool.",
    )
    tools: Annotated[
        list[ProgramFrame],
        Field(max_length=MAX_FRAMES),
        Terminal("", "[NAME=]NUMBERS", parse_frame, "list"),
    ] = Field(
        default_factory=list, description="Tool frames that the program names without stating their numbers."
    )
    bases: Annotated[
        list[ProgramFrame],
        Field(max_length=MAX_FRAMES),
        Terminal("", "[NAME=]NUMBERS", parse_frame, "list"),
    ] = Field(
        default_factory=list,
        description="Base frames that the program names without stating their numbers, in the controller's "
        "world frame.",
    )
    world: _FrameNumbers | None = Field(
        default=None,
        description="World frame of the controller in the robot's base frame R0, if the frames differ.",
    )
    flange: _FrameNumbers | None = Field(
        default=None,
        description="Flange frame of the controller in the flange frame of the model, if the frames differ.",
    )
    tool_x: Vector3 | None = Field(
        default=None,
        description="Direction of the tool's x axis in the base frame, for programs that do not state "
        "the full rotation of the tool.",
    )
    ramp_length: Annotated[Quantity, Field(ge=0.0), Terminal("", "NUMBER[mm]", float, unit="mm")] = Field(
        default=0.0,
        description="Length of path over which corrections grow at the start of a load and fade at the "
        "end, in units.length.",
    )
    leave_alone: Annotated[list[Name], Field(max_length=1_000)] = Field(
        default_factory=list,
        description="Routines in other files that neither move the robot nor change its frames.",
    )
    trust_routines: StrictBool = Field(
        default=False,
        description="True if no unknown routine moves the robot or changes frames or points. Arguments "
        "passed by reference are an exception.",
    )
    leave_others: StrictBool = Field(
        default=False,
        description="True to leave moves with an uncertain target, base or tool uncorrected; false to "
        "refuse a program with such moves.",
    )
    external_axes: Literal["carry_nothing"] | None = Field(
        default=None,
        description="Statement about external axes. `carry_nothing`: they carry neither the arm nor the "
        "workpiece. If absent, moves with an external axis away from zero are not corrected.",
    )
    format: ProgramFormat | None = Field(
        default=None,
        description="Format of the program; default: detected by the name of the file. A CSV file is a table "
        "of poses unless `format` is `csv`.",
    )
    mark: StrictBool = Field(
        default=True,
        description="True to write run, verdict and date as a comment (always written for the verdict "
        "do_not_use). A program with such a comment is not corrected again.",
    )


class CorrectionOptions(_ProgramOptions, _PoseOptions):
    """Options of corrected poses."""

    @model_validator(mode="after")
    def _require_one_load(self) -> CorrectionOptions:
        """Refuse more than one statement of the load."""
        loads = {"force": self.force, "segments": self.segments, "loads": self.loads, "cut": self.cut}
        stated = [field for field, load in loads.items() if load]
        if len(stated) > 1:
            first, second, *_ = stated
            raise make_fault(second, f"the load is stated by `{first}`, too; omit one of both")
        if self.absolute and self.ramp_length:
            reason = "omit `ramp_length`: `absolute` corrects the whole path, without a ramp"
            raise make_fault("ramp_length", reason)
        return self

    def list_foreign_fields(self, *, is_program: bool) -> Iterator[str]:
        """Yield the stated fields that do not concern a program or, if `is_program` is false, a table."""
        foreign = _OF_TABLES if is_program else _ProgramOptions.model_fields.keys()
        for name in foreign:
            if getattr(self, name) != type(self).model_fields[name].get_default(call_default_factory=True):
                yield name


_OF_TABLES: Final = ("tool", "base", "feed")
"""Options that only tables of poses have: programs state them, or `tools` and `bases` do."""


def are_programs(names: Iterable[str], format_: str | None) -> bool:
    """Return whether files are those of a robot program, by their names and the stated format."""
    return format_ is not None or any(PurePath(name.lower()).suffix not in _TABLE_ENDINGS for name in names)


class ProgramFile(Message):
    """A file that was sent or created."""

    name: Name
    bytes: int = Field(description="Size of the file.", json_schema_extra={"unit": "byte"})
    content: str | None = Field(
        default=None, description="Content of the file; null in answers: get the file instead."
    )
    sha256: str | None = Field(default=None, description="SHA-256 of the file, hexadecimal.")


_Column = Annotated[list[Quantity], Field(min_length=1, max_length=_MOST_SENT_ROWS), FailFast()]


class CorrectionRequest(CorrectionOptions):
    """Request to correct poses, which are sent as columns, as a table or as a program."""

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
    files: Annotated[list[ProgramFile], Field(max_length=MAX_FILES)] = Field(
        default_factory=list,
        description="Table of poses, in place of `columns`; or files of a program: first the file to "
        "correct, then other files, then the table of loads. Post the files as the form's `files`.",
    )

    _one_source = require_exactly_one("run_id", "robot_id")

    @property
    def name(self) -> str | None:
        """Name of the first file, for listings."""
        return next((file.name for file in self.files), None)

    @property
    def is_program(self) -> bool:
        """True if the files are those of a robot program."""
        return are_programs((file.name for file in self.files), self.format)


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
    name: str = Field(description="Name of the programmed target; may be empty.")
    line: int = Field(description="Line with the target's numbers.")
    place: Metres[Point] = Field(
        description="Programmed position of the centre of the tool, in the robot's base frame R0."
    )
    deflection: Metres[float] = Field(
        description="Distance by which the load would move the tool if the program were not corrected."
    )
    deflection_rotation: Radians[float]
    correction: Metres[float] = Field(
        description="Distance from the programmed position to the corrected (commanded) position."
    )
    correction_rotation: Radians[float]
    standard_uncertainty: Metres[float | None] = Field(
        description="Standard uncertainty of `deflection`; null if unknown."
    )
    interval: Metres[Interval | None] = Field(
        description="Interval of `deflection` that includes the errors of the readings."
    )
    interval_with_model_error: Metres[Interval | None] = Field(
        default=None,
        description="Interval of `deflection` that includes the model error; null without a bound of the "
        "model error.",
    )
    residual: Metres[float] = Field(
        description="Predicted distance between the loaded tool and the programmed target."
    )
    residual_rotation: Radians[float]
    residual_interval: Metres[Interval | None] = Field(
        default=None,
        description="Interval of the remaining distance.",
    )
    residual_interval_with_model_error: Metres[Interval | None] = Field(
        default=None,
        description="Interval of the predicted distance with the model error.",
    )
    rounding: Metres[float] = Field(
        description="Part of `residual` that the rounding of numbers in the program causes."
    )
    share: Dimensionless[float] = Field(
        description="Fraction of the full correction that is applied to the point."
    )
    capped: StrictBool = Field(description="True if the limits reduce the correction.")


class CorrectedProgram(Message):
    """Counts, spreads, the worst points, and the files of a corrected program."""

    format: ProgramFormat
    points: int = Field(description="Number of programmed targets.")
    moves: int = Field(description="Number of moves in the program.")
    moves_left: int = Field(
        default=0,
        description="Number of moves that are left uncorrected because they are uncertain.",
    )
    corrected: int = Field(description="Number of corrected targets.")
    capped: int = Field(description="Number of programmed targets whose correction is reduced by the limits.")
    left_alone: dict[LeftAlone, int] = Field(
        description="Number of programmed targets without a correction, for each reason."
    )
    deflection: Metres[Spread | None] = Field(
        description="Distance between the loaded tool and the programmed target without a correction; "
        "null if no point is loaded."
    )
    correction: Metres[Spread | None] = Field(
        description="Distance by which the correction moves programmed targets."
    )
    residual: Metres[Spread | None] = Field(
        description="Distance between the loaded tool and the programmed target with the corrected program."
    )
    deflection_ends: Metres[SpreadEnds | None] = Field(
        default=None, description="Least and greatest ends of the intervals of `deflection`."
    )
    residual_ends: Metres[SpreadEnds | None] = Field(
        default=None, description="Least and greatest ends of the intervals of `residual`."
    )
    with_model_error: StrictBool = Field(
        default=False,
        description="True if the intervals include the model error.",
    )
    rounding: Metres[Spread | None] = Field(
        description="Part of `residual` that the rounding of numbers in the program causes."
    )
    worst: Annotated[list[ProgramPoint], Field(max_length=MAX_WORST)] = Field(
        description="Points with the greatest deflections before the correction; the greatest is first."
    )
    files: list[ProgramFile] = Field(
        description="Corrected files; the content is null in answers, because the file `program` contains it."
    )


class CorrectionResult(FromRun):
    """Corrected rows, or a corrected program."""

    confidence: Dimensionless[float]
    counts: dict[CorrectionStatus, int] = Field(
        default_factory=dict, description="Number of rows by status; empty for a program."
    )
    first: dict[CorrectionStatus, int] = Field(
        default_factory=dict,
        description="Number of the first row with each status, from 1; empty for a program.",
    )
    remarks: list[str] = Field(description="Remarks on the prediction, and on what was not changed.")
    columns: dict[str, list[Any]] = Field(
        default_factory=dict,
        description="Columns of the answer; empty in a job. Corrected pose and joints are null unless "
        "`status` is `corrected`, `no_load`, `capped` or `uncertain`. `dx`, `dy` and `dz` "
        "are the deflection without a correction, along the axes of the base. `readings` and "
        "`model_error` are half-widths of intervals of the deflection's length. Further "
        "columns are `residual` and `joint_speed`.",
    )
    table: ProgramFile | None = Field(
        default=None, description="Rows of a job, as the file `rows.csv` has them; of a program, its points."
    )
    program: CorrectedProgram | None = Field(
        default=None, description="Corrected moves of a program; null for a table."
    )


class CorrectionJob(Job):
    """A stored correction of a table of poses, or of a program."""

    collection: ClassVar[str] = "corrections"

    kind: Literal["correction"] = "correction"
    request: CorrectionRequest
    result: CorrectionResult | None = Field(description="Present if the job succeeded.")

    @property
    def outputs(self) -> list[str]:
        """SHA-256 of each corrected file of a program, for listings; none if nothing was corrected."""
        program = None if self.result is None else self.result.program
        files = program.files if program is not None and program.corrected else []
        return [file.sha256 for file in files if file.sha256]
