"""The identified kinematic model, as DH table and as chain."""

from __future__ import annotations

from jointstiff.solver.geometry.model.dh_identification import DhTable, dh_table
from jointstiff.solver.geometry.model.identified_model import (
    FlangeConvention,
    IdentifiedModel,
    LinkParameter,
    identify_model,
    link_findings,
    link_table,
)
from jointstiff.solver.geometry.model.kinematic_calibration import CalibratedAxes, calibrate
from jointstiff.solver.geometry.model.poses import Poses
from jointstiff.solver.geometry.model.sweep_bundle import refine_axes

__all__ = [
    "CalibratedAxes",
    "DhTable",
    "FlangeConvention",
    "IdentifiedModel",
    "LinkParameter",
    "Poses",
    "calibrate",
    "dh_table",
    "identify_model",
    "link_findings",
    "link_table",
    "refine_axes",
]
