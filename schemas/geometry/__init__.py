"""Messages about geometries."""

from __future__ import annotations

from jointstiff.schemas.geometry.message import (
    MAX_GEOMETRY_TARGETS,
    Geometry,
    GeometryRequest,
    GeometrySummary,
    TrackedPosition,
    TrackerSheet,
)
from jointstiff.schemas.geometry.result import (
    BaseFrameResult,
    Drift,
    GeometryResult,
    LinkComparison,
    PoseEvidence,
    SweepEvidence,
    WristResult,
)

__all__ = [
    "MAX_GEOMETRY_TARGETS",
    "BaseFrameResult",
    "Drift",
    "Geometry",
    "GeometryRequest",
    "GeometryResult",
    "GeometrySummary",
    "LinkComparison",
    "PoseEvidence",
    "SweepEvidence",
    "TrackedPosition",
    "TrackerSheet",
    "WristResult",
]
