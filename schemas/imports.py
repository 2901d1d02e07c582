"""An import of files: what is asked for, and what was understood of it. Nothing is stored."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from jointstiff.schemas.fields import Identifier, Message, Name, Vector3
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.geometry import MAX_GEOMETRY_READINGS, GeometryNoise, GeometryUnits, TrackedPosition
from jointstiff.schemas.importing import ImportFault, ImportOptions, ImportPreview, MissingField
from jointstiff.schemas.measurement import MAX_TARGETS, LengthUnit, MeasurementSetDocument, Noise


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
    length_unit: LengthUnit | None = Field(
        default=None,
        description="Unit of `load_point`, `flange_targets` and the lengths in `noise`; the files' unit of "
        "length if absent.",
    )
    accept_unusual: bool = Field(
        default=False,
        description="Confirmation of values that are 100 times their column's spread from its median, and "
        "of a load point more than 5 m from the flange; required for such values.",
    )
    force: Vector3 | None = Field(
        default=None,
        description="Force on the robot in every observation, axes of R0, in units.force, unless columns "
        "have it.",
    )
    robot_id: Identifier | None = Field(
        default=None, description="Id of the measured robot; with it the answer has the integrity findings."
    )
    show_faults: bool = Field(
        default=False,
        description="True to answer 200 with `faults` and the preview, instead of 422, if a file is not "
        "understood.",
    )


class ImportTemplate(ImportRequest):
    """Options of an import that succeeded, to be sent with other files of the same form."""


class UnloadedPoses(Message):
    """Unloaded poses to calibrate a nominal model: a request of a geometry, to which the robot is added."""

    name: Name
    units: GeometryUnits
    noise: GeometryNoise | None = Field(
        default=None,
        description="Noise of the readings: as stated, else the root mean square of that in the files.",
    )
    poses: Annotated[list[TrackedPosition], Field(min_length=1, max_length=MAX_GEOMETRY_READINGS)]


class ImportAnswer(Message):
    """Preview of the files, and the measurement set made from them."""

    preview: ImportPreview
    faults: list[ImportFault] = Field(
        default_factory=list, description="First twenty faults; empty unless `show_faults` is set."
    )
    missing_fields: list[MissingField] = Field(
        default_factory=list, description="Missing items by field, in the order of `missing`."
    )
    findings: list[Finding] | None = Field(
        default=None,
        description="Integrity findings of the measurement set with the robot `robot_id`; null without it.",
    )
    template: ImportTemplate | None = Field(
        default=None,
        description="Options by which files of the same form are read again, and others are refused; null if "
        "something is missing.",
    )
    missing: list[str] = Field(description="Missing items of a measurement set; empty if complete.")
    poses: UnloadedPoses | None = Field(
        default=None,
        description="Unloaded poses, ready to be posted to /v1/geometries with `robot_id` added, if the "
        "files have joint angles and unloaded positions only.",
    )
    leave_out: list[Name] = Field(
        description="Labels of the observations that a column `validation` holds out from the fit, for the "
        "run of this set."
    )
    measurement_set: MeasurementSetDocument | None = Field(
        description="Measurement set, ready to be posted with `robot_id` added; null if something is missing."
    )
