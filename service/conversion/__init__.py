"""The one place that sees messages (schemas) and the numerical core (solver) at once."""

from service.conversion.encoders import to_encoder_residuals
from service.conversion.kinematics import to_kinematics
from service.conversion.measurements import to_measurements, to_warnings
from service.conversion.pairs import to_pair_result
from service.conversion.readings import ReadingArrays, content_hash
from service.conversion.requests import to_settings
from service.conversion.results import to_resampling_result, to_result
from service.conversion.robots import build_robot, describe_joints, describe_wrist, dh_kinematics

__all__ = [
    "ReadingArrays",
    "build_robot",
    "content_hash",
    "describe_joints",
    "describe_wrist",
    "dh_kinematics",
    "to_encoder_residuals",
    "to_kinematics",
    "to_measurements",
    "to_pair_result",
    "to_resampling_result",
    "to_result",
    "to_settings",
    "to_warnings",
]
