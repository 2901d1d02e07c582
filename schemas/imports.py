"""An import of files: what is asked for, and what was understood of it. Nothing is stored."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from jointstiff.schemas.fields import Message, Name, Vector3
from jointstiff.schemas.importing import ImportOptions, ImportPreview
from jointstiff.schemas.measurement import MAX_TARGETS, MeasurementSetDocument, Noise


class ImportRequest(ImportOptions):
    """How the files are written, and what no file tells of a measurement set."""

    name: Name | None = Field(default=None, description="Of the set; that of the first file if absent.")
    encoders: Literal["motor", "secondary"] | None = Field(
        default=None, description="Which encoders close the position loop; never guessed."
    )
    noise: Noise | None = Field(default=None, description="Of the readings, as in a measurement set.")
    flange_targets: Annotated[dict[Name, Vector3], Field(max_length=MAX_TARGETS)] = Field(
        default_factory=dict,
        description="Targets in the flange frame, in the files' unit of length; needed for deflections.",
    )
    load_point: Vector3 | None = Field(
        default=None,
        description="Where the force acts, flange frame, in the files' unit of length, if no column says it.",
    )


class ImportAnswer(Message):
    """What was understood, and the measurement set that it makes."""

    preview: ImportPreview
    missing: list[str] = Field(
        description="What a measurement set needs beyond files and options, in words; empty if nothing."
    )
    measurement_set: MeasurementSetDocument | None = Field(
        description="With `robot_id` added it can be posted as it is; null while something is missing."
    )
