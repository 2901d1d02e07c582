"""The one place that sees messages (schemas) and the numerical core (solver) at once."""

from service.conversion.encoders import to_encoder_residuals
from service.conversion.frames import in_base, stated_transform, to_resolved
from service.conversion.geometry import to_geometry_result
from service.conversion.kinematics import to_kinematics
from service.conversion.measurements import to_measurements, to_warnings
from service.conversion.pairs import to_pair_result
from service.conversion.readings import ReadingArrays, content_hash
from service.conversion.requests import to_settings
from service.conversion.results import to_resampling_result, to_result
from service.conversion.robots import build_robot, describe_joints, describe_wrist, dh_kinematics
from service.conversion.sweeps import (
    common_base_targets,
    to_base_targets,
    to_conventions,
    to_poses,
    to_sweeps,
)
from service.conversion.units import LENGTH

__all__ = [
    "LENGTH",
    "ReadingArrays",
    "build_robot",
    "common_base_targets",
    "content_hash",
    "describe_joints",
    "describe_wrist",
    "dh_kinematics",
    "in_base",
    "stated_transform",
    "to_base_targets",
    "to_conventions",
    "to_encoder_residuals",
    "to_geometry_result",
    "to_kinematics",
    "to_measurements",
    "to_pair_result",
    "to_poses",
    "to_resampling_result",
    "to_resolved",
    "to_result",
    "to_settings",
    "to_sweeps",
    "to_warnings",
]
