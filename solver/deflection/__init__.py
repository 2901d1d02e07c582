"""Deflection and Cartesian compliance by an identified model, with intervals."""

from __future__ import annotations

from jointstiff.solver.deflection.cartesian import CartesianCompliance
from jointstiff.solver.deflection.compensation import (
    Compensation,
    CorrectionLimits,
    compensate,
    ramp_shares,
    residuals,
)
from jointstiff.solver.deflection.elastic import ElasticPredictor, folds_left_out
from jointstiff.solver.deflection.forward import ElasticForward, ForwardModel, JointForward
from jointstiff.solver.deflection.joint_model import JointModel
from jointstiff.solver.deflection.length_uncertainty import length_uncertainties
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.deflection.loaded import LoadedPosture
from jointstiff.solver.deflection.map_task import MapTask, ToolFan, tool_rotations
from jointstiff.solver.deflection.maps import STATUSES, DeflectionMap, PlaceStatus, map_places, map_postures
from jointstiff.solver.deflection.model_error import ModelError, ModelErrorBound, leave_postures_out
from jointstiff.solver.deflection.own_weight import OwnWeight
from jointstiff.solver.deflection.paths import PathNodes, ToolAnglePath, best_constant_angle, best_path
from jointstiff.solver.deflection.prediction import Deflection, predict_deflections

__all__ = [
    "STATUSES",
    "CartesianCompliance",
    "Compensation",
    "CorrectionLimits",
    "Deflection",
    "DeflectionMap",
    "ElasticForward",
    "ElasticPredictor",
    "ForwardModel",
    "JointForward",
    "JointModel",
    "LoadCases",
    "LoadedPosture",
    "MapTask",
    "ModelError",
    "ModelErrorBound",
    "OwnWeight",
    "PathNodes",
    "PlaceStatus",
    "ToolAnglePath",
    "ToolFan",
    "best_constant_angle",
    "best_path",
    "compensate",
    "folds_left_out",
    "leave_postures_out",
    "length_uncertainties",
    "map_places",
    "map_postures",
    "predict_deflections",
    "ramp_shares",
    "residuals",
    "tool_rotations",
]
