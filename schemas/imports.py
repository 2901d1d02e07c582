"""An import of files of readings: the mapping of their columns, and what the robot says of the readings.

A mapping is the whole vocabulary of an import. The robot proposes a mapping from the numbers, a person edits
it, and the same document reads further files of the same form. Nothing is stored.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from pydantic import Field, StrictBool, model_validator

from jointstiff.schemas.fields import Identifier, Message, Name, Quantity, Vector3
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.gearbox import StepReadings
from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.schemas.measurement import MAX_TARGETS, MeasurementSetDocument, Noise, Rotation

MAX_COLUMNS = 256
MAX_WORDS = 1_000
SHOWN_ROWS = 4

RoleName = Literal[
    "label",
    "joints",
    "position",
    "displacement",
    "force",
    "moment",
    "load",
    "mass",
    "target",
    "state",
    "point",
    "axis",
    "value",
    "uncertainty",
    "ignore",
]
State = Literal["unloaded", "loaded", "unloaded_after"]
PointState = Literal["unloaded", "loaded", "unloaded_after", "ignore"]
RowOrder = Literal["rows", "in turn", "in blocks"]
ColumnUnit = Literal[
    "deg", "rad", "m", "mm", "cm", "in", "µm", "N", "daN", "kN", "kgf", "lbf", "kg", "N.m", "N.mm", "kN.m"
]
LENGTH_UNITS: Final[tuple[ColumnUnit, ...]] = ("mm", "m", "cm", "in", "µm")
FORCE_UNITS: Final[tuple[ColumnUnit, ...]] = ("N", "daN", "kN", "kgf", "lbf", "kg")
UNITS_OF_ROLE: Final[dict[RoleName, tuple[ColumnUnit, ...]]] = {
    "joints": ("deg", "rad", *LENGTH_UNITS),
    "position": LENGTH_UNITS,
    "displacement": LENGTH_UNITS,
    "value": LENGTH_UNITS,
    "uncertainty": LENGTH_UNITS,
    "force": FORCE_UNITS,
    "load": FORCE_UNITS,
    "mass": FORCE_UNITS,
    "moment": ("N.m", "N.mm", "kN.m"),
}
Cell = float | str | None
_Text = Annotated[str, Field(max_length=256)]


class RowPoint(Message):
    """Target and state of a row without names."""

    target: Name | None = Field(default=None, description="Name of the target; absent for the only target.")
    state: PointState | None = Field(default=None, description="State of the target; `ignore` skips the row.")


class Role(Message):
    """Meaning of some columns of a table."""

    columns: Annotated[str, Field(min_length=1, max_length=1_000)] = Field(
        description="Columns as in a spreadsheet: `A`, `B:G`, `G:B` from the last to the first, `B,D,F`; "
        "`A.1` is the first part of the words of `A`; `file`, `title` and `block` are the words around a "
        "table.",
        examples=["B:G"],
    )
    role: RoleName = Field(description="Meaning of the columns.")
    target: Name | None = Field(default=None, description="Target of positions or displacements.")
    state: State | None = Field(default=None, description="State of positions.")
    unit: ColumnUnit | None = Field(
        default=None,
        description="Unit of the numbers. Joints in several units have a role for each unit, from base to "
        "flange.",
    )
    axis: Literal["x", "y", "z"] | None = Field(
        default=None,
        description="Axis of R0 of a single column: of a displacement, as a dial gauge reads, or of a force.",
    )
    load: Annotated[Quantity, Field(gt=0.0)] | None = Field(
        default=None, description="Size of the load of loaded positions [N], if postures have several loads."
    )
    counting: _Text | None = Field(
        default=None,
        description="Way in which the controller counts the joints, if other than the robot's.",
        examples=["as the model counts"],
    )
    words: Annotated[dict[_Text, _Text], Field(max_length=MAX_WORDS)] = Field(
        default_factory=dict,
        description="Word of a cell → state, target, both, `ignore`, axis, or the size of a load.",
        examples=[{"ohne": "unloaded", "mit": "loaded"}],
    )

    @model_validator(mode="after")
    def _check_unit(self) -> Self:
        if self.unit is not None and self.unit not in UNITS_OF_ROLE.get(self.role, ()):
            raise ValueError(f"the role {self.role} cannot be in {self.unit}")
        return self


class TableMapping(Message):
    """Meaning of the columns and rows of a table, or of several tables of one form."""

    table: Annotated[list[_Text], Field(min_length=1, max_length=MAX_COLUMNS)] = Field(
        description="Names of the tables, which are put below each other; `*` matches any text.",
        examples=[["joints.csv"]],
    )
    roles: Annotated[list[Role], Field(max_length=MAX_COLUMNS)] = Field(
        description="Roles of columns. Columns without a role are not read."
    )
    order: RowOrder = Field(
        default="rows",
        description="Order of rows without names: one row a posture, all rows of a posture in turn, or a "
        "block of rows for each entry of `cycle`.",
    )
    cycle: Annotated[list[RowPoint], Field(max_length=64)] = Field(
        default_factory=list, description="Targets and states of the rows of a posture, in their order."
    )
    posture: Literal["label", "joints"] = Field(
        default="label", description="Rows or joints that tell postures apart in a table without labels."
    )
    split: Annotated[dict[_Text, _Text], Field(max_length=MAX_COLUMNS)] = Field(
        default_factory=dict,
        description="Column of words → marks at which its words split into `A.1`, `A.2` and so on.",
        examples=[{"A": "_"}],
    )
    fill_down: StrictBool = Field(default=False, description="True if empty cells have the cell above.")
    transpose: StrictBool = Field(default=False, description="True if columns are postures.")


class Placement(Message):
    """Frame of an instrument in R0."""

    rotation: Rotation = Field(description="Rotation matrix from the instrument's frame to R0, row by row.")
    origin: Vector3 = Field(description="Origin of the instrument's frame in R0 [mm].")


class Doubt(Message):
    """Something that numbers cannot say, and that a person has not confirmed yet."""

    about: Literal["states", "columns", "axes"]
    text: str = Field(description="The question.")


class Mapping(Message):
    """Meaning of the columns of files, and statements that the files lack."""

    encoding: Annotated[str, Field(max_length=40)] | None = Field(
        default=None, description="Encoding of texts that are not in UTF-8.", examples=["windows-1252"]
    )
    encoders: Literal["motor", "secondary"] | None = Field(
        default=None,
        description="Encoders with which the controller closes the position loop: `motor` at the motors, "
        "`secondary` behind the gearboxes.",
    )
    load_point: Vector3 | None = Field(default=None, description="Load point in the flange frame [mm].")
    load_point_target: Name | None = Field(
        default=None, description="Target at the hook, whose unloaded position is the load point."
    )
    force: Vector3 | None = Field(
        default=None,
        description="Force on the robot in R0 [N], if no column has it; with a role `load`, its direction.",
    )
    flange_targets: Annotated[dict[Name, Vector3], Field(max_length=MAX_TARGETS)] = Field(
        default_factory=dict, description="Places of targets in the flange frame [mm], for displacements."
    )
    noise: Noise | None = Field(
        default=None, description="Noise of the readings, as in a measurement set [mm, deg]."
    )
    frame: Placement | None = Field(
        default=None, description="Frame of the positions; null if positions are in R0."
    )
    tables: Annotated[list[TableMapping], Field(max_length=64)] = Field(
        default_factory=list, description="Meaning of each table; empty for a proposal of the robot."
    )
    doubts: Annotated[list[Doubt], Field(max_length=16)] = Field(
        default_factory=list, description="Questions that a person has not answered; empty once confirmed."
    )


class ImportRequest(Message):
    """Robot that was measured, and the mapping of the files."""

    name: Name | None = Field(
        default=None, description="Name of the measurement set; default: the name of the first file."
    )
    robot_id: Identifier | None = Field(
        default=None, description="Id of the measured robot, which proposes the mapping and checks it."
    )
    mapping: Mapping = Field(
        default=Mapping(),
        description="Mapping of the files. Without `tables` the robot proposes them, or documented headers "
        "state them.",
    )


class TableColumn(Message):
    """A column as it was read."""

    id: str = Field(description="Letter as in a spreadsheet, which roles name.")
    header: str = Field(description="Words above the column.")
    cells: list[Cell] = Field(description=f"First cells, at most {SHOWN_ROWS}.")
    role: str = Field(
        description="Role of the column in words, such as `T1 loaded [mm]`; empty without a role."
    )


class TableView(Message):
    """A table as it was read, with the role of each column."""

    name: str
    row_count: int = Field(description="Number of rows.")
    columns: list[TableColumn]


class ImportChoice(Message):
    """An answer to a question."""

    text: str = Field(description="The answer.")
    mapping: Mapping = Field(description="Mapping after this answer, to be sent again.")


class ImportQuestion(Message):
    """A question that only a person can answer."""

    text: str = Field(description="The question.")
    field: Literal["encoders", "load_point", "force", "flange_targets", "tables"] | None = Field(
        default=None, description="Field of the mapping that a person states; null if `choices` answer."
    )
    choices: list[ImportChoice] = Field(default_factory=list, description="Answers to choose from.")


class FarPosition(Message):
    """A position that is not where the robot carries its target."""

    posture: str
    target: str
    state: State | None
    distance: Quantity = Field(description="Distance from the place by the robot [mm].")


class ImportAnswer(Message):
    """Tables of files with the role of each column, the next question, and the measurement set."""

    tables: list[TableView] = Field(description="Tables of the files.")
    mapping: Mapping = Field(description="Mapping that the robot proposes, or that was applied.")
    sentence: str = Field(description="Sentence of the robot about the readings; empty without a robot.")
    questions: list[ImportQuestion] = Field(
        description="Questions, to be answered one at a time; empty if the readings are complete."
    )
    faults: list[str] = Field(description="Reasons why the readings cannot be right, with what to look at.")
    far: list[FarPosition] = Field(
        default_factory=list, description="Positions far from where the robot carries their targets."
    )
    findings: list[Finding] | None = Field(
        default=None, description="Findings of the integrity checks; null without a robot."
    )
    measurement_set: MeasurementSetDocument | None = Field(
        default=None,
        description="Measurement set, to be posted together with `robot_id`; with `faults`, do not use it.",
    )
    geometry: GeometryRequest | None = Field(
        default=None, description="Poses without load, to be posted to /v1/geometries with `robot_id`."
    )
    weight_step: StepReadings | None = Field(
        default=None,
        description="Readings of two encoders per joint, to be posted to /v1/gearboxes with `robot_id` and "
        "`load`.",
    )
