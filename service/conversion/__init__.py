"""Translation between messages (schemas) and the numerical core (solver)."""

from jointstiff.service.conversion.csv_table import comparison_csv
from jointstiff.service.conversion.frames import in_base, stated_transform, to_resolved
from jointstiff.service.conversion.geometry import to_geometry_result
from jointstiff.service.conversion.links import (
    to_elastic_columns,
    to_links_result,
    to_plan,
    to_selection,
)
from jointstiff.service.conversion.measurements import to_measurements, to_warnings
from jointstiff.service.conversion.pairs import to_pair_result
from jointstiff.service.conversion.parsing import MAX_SET_BYTES, NOT_JSON, MalformedError, parse
from jointstiff.service.conversion.readings import ReadingArrays, content_hash
from jointstiff.service.conversion.requests import to_settings
from jointstiff.service.conversion.results import to_encoder_residuals, to_resampling_result, to_result
from jointstiff.service.conversion.robots import (
    build_robot,
    describe_joints,
    describe_wrist,
    dh_kinematics,
    to_kinematics,
)
from jointstiff.service.conversion.sweeps import (
    to_base_targets,
    to_conventions,
    to_poses,
    to_sweeps,
)
from jointstiff.service.conversion.units import LENGTH

__all__ = [
    "LENGTH",
    "MAX_SET_BYTES",
    "NOT_JSON",
    "MalformedError",
    "ReadingArrays",
    "build_robot",
    "comparison_csv",
    "content_hash",
    "describe_joints",
    "describe_wrist",
    "dh_kinematics",
    "in_base",
    "parse",
    "stated_transform",
    "to_base_targets",
    "to_conventions",
    "to_elastic_columns",
    "to_encoder_residuals",
    "to_geometry_result",
    "to_kinematics",
    "to_links_result",
    "to_measurements",
    "to_pair_result",
    "to_plan",
    "to_poses",
    "to_resampling_result",
    "to_resolved",
    "to_result",
    "to_selection",
    "to_settings",
    "to_sweeps",
    "to_warnings",
]
