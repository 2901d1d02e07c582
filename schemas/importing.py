"""Files of readings: how the caller says they are written, and what was understood of them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from jointstiff.schemas.fields import Message, Name
from jointstiff.schemas.measurement import MAX_TARGETS, AngleUnit

MAX_PREVIEW_ROWS = 5
MAX_HEADER_CELLS = 256
MAX_FAULTS = 20

Delimiter = Literal["comma", "semicolon", "tab", "whitespace"]
DecimalMark = Literal["point", "comma"]
State = Literal["unloaded", "loaded", "deflection"]
TableFormat = Literal["text", "xlsx"]
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
    """Units of columns whose header has none, if known."""

    length: Literal["m", "mm", "in"] | None = Field(
        default=None, description="Unit of positions and deflections. Inches are converted to mm."
    )
    angle: AngleUnit | None = Field(default=None, description="Unit of joint angles.")
    force: Literal["N", "kN", "kgf"] | None = Field(default=None, description="Unit of forces.")
    moment: Literal["N.m", "N.mm", "kN.m", "kgf.m"] | None = Field(
        default=None, description="Unit of moments; force times m if lengths are in m."
    )


class ImportOptions(Message):
    """Options for information that is not in the files. Information in the files must agree with them."""

    units: ImportUnits | None = Field(
        default=None, description="Units of columns whose header has none; they are never guessed."
    )
    columns: Annotated[dict[HeaderCell, HeaderCell], Field(max_length=MAX_HEADER_CELLS)] = Field(
        default_factory=dict,
        description="Meanings of headers: each header as in the preview, and its meaning, such as `J1 "
        "[deg]`, `P10 loaded x` or `ignore`. A unit in the file must agree.",
        examples=[{"Winkel A1": "J1 [deg]", "shift": "ignore"}],
    )
    layouts: Annotated[
        list[Annotated[list[HeaderCell], Field(max_length=MAX_HEADER_CELLS)]], Field(max_length=64)
    ] = Field(
        default_factory=list,
        description="Headers of the files of a template, one list per kind of file. If given, a file with "
        "other headers is refused, and the error names the differences.",
    )
    delimiter: Delimiter | None = Field(
        default=None, description="Delimiter between cells; detected if absent."
    )
    decimal_mark: DecimalMark | None = Field(
        default=None, description="Decimal mark of text files; detected if absent and unambiguous."
    )
    header: Annotated[list[HeaderCell], Field(min_length=1, max_length=MAX_HEADER_CELLS)] | None = Field(
        default=None, description="Header for files that have none, one text per column."
    )
    ignore: Annotated[list[HeaderCell], Field(max_length=MAX_HEADER_CELLS)] = Field(
        default_factory=list, description="Headers of columns to ignore; blanks are collapsed."
    )
    sheet: str | None = Field(default=None, max_length=100, description="Sheet of an Excel file.")
    point_name: Template | None = Field(
        default=None,
        description="Template of point names, of `{label}`, `{target}`, `{state}` and `{any}`.",
        examples=["{label}_{target}_{state}"],
    )
    file_name: Template | None = Field(
        default=None,
        description="Template of file names, without the extension.",
        examples=["{target}_{state}"],
    )
    state_words: Annotated[dict[Name, State], Field(max_length=MAX_TARGETS)] = Field(
        default_factory=dict, description="Additional words for the states, in names, headers and columns."
    )
    by_order: bool = Field(
        default=False,
        description="Match rows of files without names by their order: the first row is the first "
        "observation. All files must have as many rows.",
    )
    allow_missing: bool = Field(
        default=False,
        description="Skip incomplete readings, and list them, instead of refusing the file.",
    )


class ColumnMeaning(Message):
    """One column and its meaning."""

    column: int = Field(description="Number of the column, from 1.")
    header: str = Field(description="Header as it is in the file; empty without a header.")
    meaning: str = Field(
        description="Meaning, in words that `columns` accepts; `unknown` if it was not understood.",
        examples=["P10 unloaded x", "joint 1", "ignored"],
    )
    unit: str | None = Field(description="Unit of the numbers; null if there are none.")
    guessed: bool = Field(
        default=False,
        description="True if the meaning was assumed (from two rows, a comment, a unit without brackets, or "
        "without a header): check it.",
    )


class FilePreview(Message):
    """One file as it was read."""

    file: str = Field(description="Name of the file, as sent.")
    format: TableFormat
    sheet: str | None = Field(description="Sheet of an Excel file.")
    encoding: str | None = Field(description="Encoding and decimal mark of a text file.", examples=["utf-8"])
    delimiter: Delimiter | None = Field(description="Delimiter of a text file.")
    decimal_mark: DecimalMark | None = Field(description="Encoding and decimal mark of a text file.")
    columns: list[ColumnMeaning] = Field(description="Columns from left to right.")
    row_count: int = Field(description="Number of data rows.")
    first_rows: list[list[str]] = Field(
        description=f"First rows, at most {MAX_PREVIEW_ROWS}, as they are in the file."
    )
    assumptions: list[str] = Field(description="Assumptions made in reading the file.")
    header_lines: list[int] = Field(
        default_factory=list, description="Lines or rows of the file that make the header; empty without one."
    )
    first_lines: list[int] = Field(
        default_factory=list, description="Line or row of the file of each of `first_rows`."
    )


class ImportFault(Message):
    """Something in the files that was not understood."""

    file: str | None = Field(description="Name of the file, as sent; null for all files together.")
    line: int | None = Field(description="Line of a text file or row of a sheet, from 1.")
    column: int | None = Field(description="Column of the table, from 1.")
    reason: str = Field(description="Description of the fault.")
    remedy: str = Field(description="Recommended correction.")
    option: str | None = Field(
        default=None, description="Option that corrects it.", examples=["units.length", "decimal_mark"]
    )
    words: list[str] = Field(
        default_factory=list,
        description="Words in the files that the option concerns, such as two that may be states.",
        examples=[["pre", "post"]],
    )


class ImportPreview(Message):
    """Preview of all files together, before anything is stored."""

    files: list[FilePreview] = Field(description="Files in the order in which they were sent.")
    observation_count: int = Field(description="Number of different labels.")
    first_labels: list[str] = Field(description=f"First labels, at most {MAX_PREVIEW_ROWS}.")
    joint_count: int | None = Field(
        description="Number of joint angles per observation; null if there are none."
    )
    targets: list[str] = Field(description="Names of the targets, in order of appearance.")
    states: list[State] = Field(description="States that were read.")
    reading_count: int = Field(description="Number of complete readings, of all targets and observations.")
    assumptions: list[str] = Field(description="Assumptions made in combining the files.")
    uncertainty: Literal["coordinate", "point"] | None = Field(
        default=None,
        description="Uncertainty that the files state: U(95) of each coordinate or of each point.",
    )
