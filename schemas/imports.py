"""An import of files of readings: how they are written, what was understood of them. Nothing is stored."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StrictBool

from jointstiff.schemas.fields import Identifier, Message, Name, Quantity, Vector3
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.gearbox import StepReadings
from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.measurement import MAX_TARGETS, AngleUnit, LengthUnit, MeasurementSetDocument, Noise
from jointstiff.schemas.robot import Body

MAX_PREVIEW_ROWS = 5
MAX_HEADER_CELLS = 256
MAX_FAULTS = 20

Delimiter = Literal["comma", "semicolon", "tab", "whitespace"]
DecimalMark = Literal["point", "comma"]
State = Literal["unloaded", "loaded", "deflection", "unloaded_after"]
TableFormat = Literal["text", "xlsx", "mat", "npz", "hdf5", "parquet"]
MissingField = Literal[
    "joints",
    "force",
    "readings",
    "unloaded",
    "loaded",
    "flange_targets",
    "load_point",
    "encoders",
    "units.force",
    "accept_unusual",
]

HeaderCell = Annotated[str, Field(max_length=256)]
Template = Annotated[str, Field(min_length=1, max_length=100)]


class ImportUnits(Message):
    """Units of columns whose header has no unit."""

    length: Literal["m", "mm", "in"] | None = Field(
        default=None,
        description="Unit of positions and deflections. Positions in inches are converted to mm.",
    )
    angle: AngleUnit | None = Field(default=None, description="Unit of joint angles.")
    force: Literal["N", "daN", "kN", "kgf", "lbf"] | None = Field(
        default=None, description="Unit of forces. Forces in daN are converted to N."
    )
    moment: Literal["N.m", "N.mm", "kN.m", "kgf.m", "lbf.ft", "lbf.in"] | None = Field(
        default=None, description="Unit of moments; the unit of force times m if lengths are in m."
    )


class ImportOptions(Message):
    """Options for what the files do not state. Information in the files must agree."""

    units: ImportUnits | None = Field(
        default=None, description="Units of columns whose header states no unit; units are never guessed."
    )
    columns: Annotated[dict[HeaderCell, HeaderCell], Field(max_length=MAX_HEADER_CELLS)] = Field(
        default_factory=dict,
        description="Meanings of headers, such as `J1 [deg]`, `P10 loaded x` or `ignore`. A unit in the "
        "file must be the same.",
        examples=[{"Winkel A1": "J1 [deg]", "shift": "ignore"}],
    )
    layouts: Annotated[
        list[Annotated[list[HeaderCell], Field(max_length=MAX_HEADER_CELLS)]], Field(max_length=64)
    ] = Field(
        default_factory=list,
        description="Headers of the files that the template reads; a file with other headers is refused.",
    )
    delimiter: Delimiter | None = Field(
        default=None, description="Delimiter between cells; detected if absent."
    )
    decimal_mark: DecimalMark | None = Field(
        default=None,
        description="Decimal mark of text files; detected if absent. An ambiguous mark must be stated.",
    )
    header: Annotated[list[HeaderCell], Field(min_length=1, max_length=MAX_HEADER_CELLS)] | None = Field(
        default=None, description="Header for files without a known header: one text for each column."
    )
    ignore: Annotated[list[HeaderCell], Field(max_length=MAX_HEADER_CELLS)] = Field(
        default_factory=list,
        description="Headers of columns to ignore. Repeated blanks count as one, and * matches any text.",
    )
    sheet: str | None = Field(
        default=None,
        max_length=100,
        description="Names of the sheets of an Excel file or of the groups of an HDF5 file, separated by ;.",
    )
    point_name: Template | None = Field(
        default=None,
        description="Pattern of point names, made of `{label}`, `{target}`, `{state}` and `{any}`.",
        examples=["{label}_{target}_{state}"],
    )
    file_name: Template | None = Field(
        default=None,
        description="Pattern of file names without the extension, made of the same parts.",
        examples=["{target}_{state}"],
    )
    state_words: Annotated[dict[Name, State], Field(max_length=MAX_TARGETS)] = Field(
        default_factory=dict,
        description="Additional words for the states `unloaded` and `loaded` in names, headers and columns.",
    )
    state: State | None = Field(
        default=None,
        description="State (unloaded or loaded) of positions whose state no header, column or name shows.",
    )
    by_order: StrictBool = Field(
        default=False,
        description="True to number the rows of files without labels; the first row of each file is "
        "observation 1.",
    )
    allow_missing: StrictBool = Field(
        default=False,
        description="True to skip and list incomplete readings instead of refusing the file.",
    )
    load_point_target: Name | None = Field(
        default=None,
        description="Name of the target at the hook, whose reading without load gives the load point.",
    )
    mean_of_repeats: StrictBool = Field(
        default=False, description="True to use the mean of repeated readings of a point."
    )
    joint_tolerance: Annotated[Quantity, Field(gt=0.0)] = Field(
        default=0.01,
        description="Greatest allowed difference between the positions of a joint in different files, in "
        "deg or mm.",
    )


class ColumnMeaning(Message):
    """One column with the meaning of the column."""

    column: int = Field(description="Number of the column, from 1.")
    header: str = Field(description="Header as written in the file; empty if the column has no header.")
    meaning: str = Field(
        description="Meaning of the column, in the words that `columns` accepts; `unknown` if not "
        "understood.",
        examples=["P10 unloaded x", "joint 1", "ignored"],
    )
    unit: str | None = Field(
        description="Unit of the numbers in the column; null if the numbers have no unit."
    )
    guessed: StrictBool = Field(
        default=False,
        description="True if the meaning of the column is an assumption, which should be checked.",
    )


class FilePreview(Message):
    """One file as it was read."""

    file: str = Field(description="Name of the file, as sent.")
    format: TableFormat
    sheet: str | None = Field(default=None, description="Sheet of an Excel file, or group of an HDF5 file.")
    encoding: str | None = Field(default=None, description="Encoding of a text file.", examples=["utf-8"])
    delimiter: Delimiter | None = Field(default=None, description="Delimiter of a text file.")
    decimal_mark: DecimalMark | None = Field(default=None, description="Decimal mark of a text file.")
    columns: list[ColumnMeaning] = Field(default_factory=list, description="Columns from left to right.")
    row_count: int = Field(default=0, description="Number of data rows.")
    first_rows: list[list[str]] = Field(
        default_factory=list,
        description=f"First rows, at most {MAX_PREVIEW_ROWS}, as they are in the file.",
    )
    assumptions: list[str] = Field(default_factory=list, description="Assumptions made in reading the file.")
    header_lines: list[int] = Field(
        default_factory=list,
        description="Lines or rows of the file that form the header; empty without a header.",
    )
    first_lines: list[int] = Field(
        default_factory=list,
        description="Line or row number in the file for each row in `first_rows`.",
    )
    fault_rows: list[list[str]] = Field(
        default_factory=list,
        description="Rows with faults that are not among the first rows, as written in the file.",
    )
    fault_lines: list[int] = Field(
        default_factory=list,
        description="Line or row number in the file for each row in `fault_rows`.",
    )


class ImportFault(Message):
    """Something in the files that was not understood."""

    file: str | None = Field(description="Name of the file, as sent; null for all files together.")
    line: int | None = Field(description="Line of a text file or row of a sheet, from 1.")
    column: int | None = Field(description="Column of the table, from 1.")
    reason: str = Field(description="Description of the fault.")
    remedy: str = Field(description="Recommended correction.")
    option: str | None = Field(
        default=None, description="Option that corrects the fault.", examples=["units.length", "decimal_mark"]
    )
    words: list[str] = Field(
        default_factory=list,
        description="Words in the files that the option concerns.",
        examples=[["pre", "post"]],
    )


class ImportPreview(Message):
    """Preview of all files before storage; complete if nothing is unclear."""

    files: list[FilePreview] = Field(description="Files in the order in which they were sent.")
    observation_count: int = Field(default=0, description="Number of different labels of observations.")
    first_labels: list[str] = Field(
        default_factory=list, description=f"First labels, at most {MAX_PREVIEW_ROWS}."
    )
    joint_count: int | None = Field(
        default=None, description="Number of joint angles in each observation; null without joint angles."
    )
    joint_kinds: list[JointKind] = Field(
        default_factory=list,
        description="Kinds of the joints (revolute or prismatic), by the units of their columns.",
    )
    targets: list[str] = Field(
        default_factory=list, description="Names of the targets, in order of appearance."
    )
    states: list[State] = Field(default_factory=list, description="States that the files contain.")
    reading_count: int = Field(
        default=0, description="Number of complete readings over all targets and observations."
    )
    assumptions: list[str] = Field(
        default_factory=list, description="Assumptions made when the files were combined."
    )
    uncertainty: Literal["coordinate", "point"] | None = Field(
        default=None,
        description="Uncertainty that the files state.",
    )


class ImportRequest(ImportOptions):
    """Format of the files, and the parts of a measurement set that no file contains."""

    name: Name | None = Field(
        default=None, description="Name of the measurement set; default: the name of the first file."
    )
    encoders: Literal["motor", "secondary"] | None = Field(
        default=None,
        description="Encoders with which the controller closes the position loop: `motor` at the motors, "
        "`secondary` behind the gearboxes. Mandatory.",
    )
    noise: Noise | None = Field(
        default=None, description="Noise of the readings, with the fields of a measurement set."
    )
    flange_targets: Annotated[dict[Name, Vector3], Field(max_length=MAX_TARGETS)] = Field(
        default_factory=dict,
        description="Places of the targets in the flange frame, in the files' unit of length; needed for "
        "deflections.",
    )
    load_point: Vector3 | None = Field(
        default=None,
        description="Load point in the flange frame, in the files' unit of length.",
    )
    length_unit: LengthUnit | None = Field(
        default=None,
        description="Unit of `load_point`, `flange_targets` and lengths in `noise`; default: the files' "
        "unit of length.",
    )
    accept_unusual: StrictBool = Field(
        default=False,
        description="True to accept values over 100 standard deviations from their column's median, and "
        "load points over 5 m from the flange.",
    )
    force: Vector3 | None = Field(
        default=None,
        description="Force on the robot in every observation, along the axes of the base frame R0, in "
        "units.force.",
    )
    robot_id: Identifier | None = Field(
        default=None,
        description="Id of the measured robot; if given, the answer contains the findings of the "
        "integrity checks.",
    )
    accept_proposal: StrictBool = Field(
        default=False,
        description="True to read columns without known names in the way that `proposal` states.",
    )
    show_faults: StrictBool = Field(
        default=False,
        description="True to answer a file that is not understood with `faults` and the preview, instead of "
        "the status 422.",
    )


class ImportAnswer(ImportPreview):
    """Preview of the files, and the measurement set made from them."""

    faults: list[ImportFault] = Field(
        default_factory=list, description="First twenty faults; empty unless `show_faults` is set."
    )
    proposal: str | None = Field(
        default=None,
        description="Meaning of the columns that the robot's kinematics proposes, if their names are "
        "unknown.",
    )
    missing_fields: list[MissingField] = Field(
        default_factory=list,
        description="Description of each missing item by field, in the order of `missing`.",
    )
    findings: list[Finding] | None = Field(
        default=None,
        description="Findings of the integrity checks with the robot `robot_id`; null without `robot_id`.",
    )
    template: ImportRequest | None = Field(
        default=None,
        description="Template: options that read files with the same headers, and refuse other files; null "
        "if something is missing.",
    )
    missing: list[str] = Field(
        description="Missing fields of a measurement set; empty if the set is complete."
    )
    unusual: list[str] = Field(
        default_factory=list, description="Unusual values, which `accept_unusual` confirms."
    )
    bodies: list[Body] = Field(
        default_factory=list,
        description="Bodies of the robot with their masses, from a table of masses; empty without a table.",
    )
    geometry: GeometryRequest | None = Field(
        default=None,
        description="Poses without load to post to /v1/geometries with `robot_id`, from files with only "
        "joint angles and unloaded positions.",
    )
    weight_step: StepReadings | None = Field(
        default=None,
        description="Readings of two encoders per joint, to be posted to /v1/gearboxes with `robot_id` and "
        "`load`.",
    )
    leave_out: list[Name] = Field(
        description="Labels of the observations that a column `validation` holds out from the fit."
    )
    measurement_set: MeasurementSetDocument | None = Field(
        description="Measurement set, to be posted together with `robot_id`; null if something is missing."
    )
