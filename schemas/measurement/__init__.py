"""Messages about measurement sets."""

from __future__ import annotations

from jointstiff.schemas.measurement.frame import Frame, ResolvedFrame
from jointstiff.schemas.measurement.measurement_set import (
    MAX_OBSERVATIONS,
    MAX_TARGETS,
    AngleUnit,
    EncoderReading,
    LengthUnit,
    MeasurementSet,
    MeasurementSetDocument,
    MeasurementSetHeader,
    MeasurementSetRequest,
    MeasurementSetSummary,
    Observation,
    QualityWarning,
    Reading,
    Units,
    WarningCode,
)
from jointstiff.schemas.measurement.metadata import Moment, Notes, SetChange, SetMetadata
from jointstiff.schemas.measurement.noise import (
    ForceUncertainty,
    Instrument,
    Matrix3,
    Noise,
    Sigma,
    Uncertainty,
)

__all__ = [
    "MAX_OBSERVATIONS",
    "MAX_TARGETS",
    "AngleUnit",
    "EncoderReading",
    "ForceUncertainty",
    "Frame",
    "Instrument",
    "LengthUnit",
    "Matrix3",
    "MeasurementSet",
    "MeasurementSetDocument",
    "MeasurementSetHeader",
    "MeasurementSetRequest",
    "MeasurementSetSummary",
    "Moment",
    "Noise",
    "Notes",
    "Observation",
    "QualityWarning",
    "Reading",
    "ResolvedFrame",
    "SetChange",
    "SetMetadata",
    "Sigma",
    "Uncertainty",
    "Units",
    "WarningCode",
]
