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
    """What the files do not say themselves. Whatever they do say must agree with it."""

    units: Units | None = Field(
        default=None, description="Units of columns whose header names none; they are never guessed."
    )
    delimiter: Delimiter | None = Field(default=None, description="Between cells; found out if absent.")
    decimal_mark: DecimalMark | None = Field(
        default=None, description="Decimal mark of text files; found out if absent and the file decides it."
    )
    header: Annotated[list[HeaderCell], Field(min_length=1, max_length=MAX_HEADER_CELLS)] | None = Field(
        default=None, description="The header of files that have none, one text a column."
    )
    ignore: Annotated[list[HeaderCell], Field(max_length=MAX_HEADER_CELLS)] = Field(
        default_factory=list, description="Headers of columns to leave out, as they stand in the file."
    )
    sheet: str | None = Field(default=None, max_length=100, description="Sheet of an Excel file.")
    point_name: Template | None = Field(
        default=None,
        description="How names of points are made up, of `{label}`, `{target}`, `{state}` and `{any}`.",
        examples=["{label}_{target}_{state}"],
    )
    file_name: Template | None = Field(
        default=None,
        description="The same for names of files, without what follows the last full stop.",
        examples=["{target}_{state}"],
    )
    state_words: Annotated[dict[Name, State], Field(max_length=MAX_TARGETS)] = Field(
        default_factory=dict, description="Further words for the states, in names, headers and columns."
    )
    allow_missing: bool = Field(
        default=False,
        description="Leave out readings that are not complete, and say so, instead of refusing the file.",
    )


class ColumnMeaning(Message):
    """One column and what it was taken for."""

    column: int = Field(description="Counted from 1.")
    header: str = Field(description="As it stands in the file; empty if there is no header.")
    meaning: str = Field(description="In words.", examples=["P10 unloaded x", "joint 1", "ignored"])
    unit: str | None = Field(description="Unit of its numbers; null where there are none.")


class FilePreview(Message):
    """One file and how it was read."""

    file: str = Field(description="Its name, as it was sent.")
    format: TableFormat
    sheet: str | None = Field(description="Sheet of an Excel file.")
    encoding: str | None = Field(description="Of a text file.", examples=["utf-8"])
    delimiter: Delimiter | None = Field(description="Between the cells of a text file.")
    decimal_mark: DecimalMark | None = Field(description="Of a text file.")
    columns: list[ColumnMeaning] = Field(description="From left to right.")
    row_count: int = Field(description="Rows of data.")
    first_rows: list[list[str]] = Field(description=f"At most {MAX_PREVIEW_ROWS}, as they stand in the file.")
    assumptions: list[str] = Field(description="All that was assumed in reading it, in words.")


class ImportPreview(Message):
    """What was understood of all files together, before anything is stored."""

    files: list[FilePreview] = Field(description="In the order in which they were sent.")
    observation_count: int = Field(description="Different labels.")
    first_labels: list[str] = Field(description=f"At most {MAX_PREVIEW_ROWS} labels.")
    joint_count: int | None = Field(description="Joint angles of an observation; null if there are none.")
    targets: list[str] = Field(description="Names of the targets, in order of appearance.")
    states: list[State] = Field(description="Which states were read.")
    reading_count: int = Field(description="Complete readings, of all targets and observations.")
    assumptions: list[str] = Field(description="All that was assumed in putting them together, in words.")
    missing: list[str] = Field(description="What else a measurement set needs, in words; empty if nothing.")
