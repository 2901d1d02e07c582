"""Files of readings: how the caller says they are written, and what was understood of them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from jointstiff.schemas.fields import Message, Name
from jointstiff.schemas.measurement import MAX_TARGETS, Units

MAX_PREVIEW_ROWS = 5
MAX_HEADER_CELLS = 256

Delimiter = Literal["comma", "semicolon", "tab", "whitespace"]
DecimalMark = Literal["point", "comma"]
State = Literal["unloaded", "loaded", "deflection"]
TableFormat = Literal["text", "xlsx"]

HeaderCell = Annotated[str, Field(max_length=256)]
Template = Annotated[str, Field(min_length=1, max_length=100)]


class ImportOptions(Message):
    """Options for information that is not in the files. Information in the files must agree with them."""

    units: Units | None = Field(
        default=None, description="Units of columns whose header has none; they are never guessed."
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
        default_factory=list, description="Headers of columns to ignore, as they are in the file."
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
    allow_missing: bool = Field(
        default=False,
        description="Skip incomplete readings, and list them, instead of refusing the file.",
    )


class ColumnMeaning(Message):
    """One column and what it was taken for."""

    column: int = Field(description="Number of the column, from 1.")
    header: str = Field(description="Header as it is in the file; empty without a header.")
    meaning: str = Field(description="In words.", examples=["P10 unloaded x", "joint 1", "ignored"])
    unit: str | None = Field(description="Unit of the numbers; null if there are none.")


class FilePreview(Message):
    """One file and how it was read."""

    file: str = Field(description="Name of the file, as sent.")
    format: TableFormat
    sheet: str | None = Field(description="Sheet of an Excel file.")
    encoding: str | None = Field(description="Text file only.", examples=["utf-8"])
    delimiter: Delimiter | None = Field(description="Delimiter of a text file.")
    decimal_mark: DecimalMark | None = Field(description="Text file only.")
    columns: list[ColumnMeaning] = Field(description="Columns from left to right.")
    row_count: int = Field(description="Number of data rows.")
    first_rows: list[list[str]] = Field(
        description=f"First rows, at most {MAX_PREVIEW_ROWS}, as they are in the file."
    )
    assumptions: list[str] = Field(description="Assumptions made in reading the file.")


class ImportPreview(Message):
    """Preview of all files together, before anything is stored."""

    files: list[FilePreview] = Field(description="Files in the order in which they were sent.")
    observation_count: int = Field(description="Different labels.")
    first_labels: list[str] = Field(description=f"First labels, at most {MAX_PREVIEW_ROWS}.")
    joint_count: int | None = Field(
        description="Number of joint angles per observation; null if there are none."
    )
    targets: list[str] = Field(description="Names of the targets, in order of appearance.")
    states: list[State] = Field(description="States that were read.")
    reading_count: int = Field(description="Number of complete readings, of all targets and observations.")
    assumptions: list[str] = Field(description="Assumptions made in combining the files.")
    missing: list[str] = Field(description="Missing items of a measurement set; empty if complete.")
