"""Base frame, wrist centre and rigid transforms."""

from __future__ import annotations

from jointstiff.solver.geometry.frames.axis_frame import (
    LEAST_SINE,
    chain_axes,
    common_feet,
    perpendicular_frame,
)
from jointstiff.solver.geometry.frames.base_drift import BaseDrift, find_drift
from jointstiff.solver.geometry.frames.base_frame import BaseConvention, BaseFrame, find_base_frame
from jointstiff.solver.geometry.frames.rigid_transform import RigidTransform
from jointstiff.solver.geometry.frames.wrist_axes import nearest_to_axes
from jointstiff.solver.geometry.frames.wrist_centre import CentreEstimate, WristCentre, find_wrist_centre

__all__ = [
    "LEAST_SINE",
    "BaseConvention",
    "BaseDrift",
    "BaseFrame",
    "CentreEstimate",
    "RigidTransform",
    "WristCentre",
    "chain_axes",
    "common_feet",
    "find_base_frame",
    "find_drift",
    "find_wrist_centre",
    "nearest_to_axes",
    "perpendicular_frame",
]
