"""An import of files: what is asked for, and what was understood of it. Nothing is stored."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from jointstiff.schemas.fields import Message, Name, Vector3
from jointstiff.schemas.importing import ImportOptions, ImportPreview
from jointstiff.schemas.measurement import MAX_TARGETS, MeasurementSetDocument, Noise


class ImportRequest(ImportOptions):
    """Format of the files, and the parts of a measurement set that no file contains."""

    name: Name | None = Field(
        default=None, description="Name of the measurement set; default: that of the first file."
    )
    encoders: Literal["motor", "secondary"] | None = Field(
        default=None, description="Encoders that close the position loop; never guessed."
    )
    noise: Noise | None = Field(default=None, description="Noise of the readings, as in a measurement set.")
    flange_targets: Annotated[dict[Name, Vector3], Field(max_length=MAX_TARGETS)] = Field(
        default_factory=dict,
        description="Targets in the flange frame, in the files' unit of length; needed for deflections.",
    )
    load_point: Vector3 | None = Field(
        default=None,
        description="Load point in the flange frame, in the files' unit of length, unless a column has it.",
    )


class ImportAnswer(Message):
    """Preview of the files, and the measurement set made from them."""

    preview: ImportPreview
    missing: list[str] = Field(description="Missing items of a measurement set; empty if complete.")
    measurement_set: MeasurementSetDocument | None = Field(
        description="Measurement set, ready to be posted with `robot_id` added; null if something is missing."
    )
