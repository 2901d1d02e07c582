"""Kinematic geometry of a robot from circle-point sweeps or poses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointstiff.solver.doors import names_of

if TYPE_CHECKING:
    from jointstiff.solver.geometry.finding import GeometryFinding
    from jointstiff.solver.geometry.frames import (
        BaseDrift,
        CentreEstimate,
        RigidTransform,
        WristCentre,
    )
    from jointstiff.solver.geometry.identification import identify_from_poses, identify_from_sweeps
    from jointstiff.solver.geometry.identified_geometry import BaseTargets, Conventions, IdentifiedGeometry
    from jointstiff.solver.geometry.model import CalibratedAxes, DhTable, Poses
    from jointstiff.solver.geometry.sweeps import (
        Axis,
        AxisFit,
        IdentifiedAxes,
        Sweep,
        SweepSet,
    )
else:
    __getattr__ = names_of(
        __name__,
        finding="GeometryFinding",
        frames="BaseDrift CentreEstimate RigidTransform WristCentre",
        model="CalibratedAxes DhTable Poses",
        identification="identify_from_poses identify_from_sweeps",
        identified_geometry="BaseTargets Conventions IdentifiedGeometry",
        sweeps="Axis AxisFit IdentifiedAxes Sweep SweepSet",
    )

__all__ = [
    "Axis",
    "AxisFit",
    "BaseDrift",
    "BaseTargets",
    "CalibratedAxes",
    "CentreEstimate",
    "Conventions",
    "DhTable",
    "GeometryFinding",
    "IdentifiedAxes",
    "IdentifiedGeometry",
    "Poses",
    "RigidTransform",
    "Sweep",
    "SweepSet",
    "WristCentre",
    "identify_from_poses",
    "identify_from_sweeps",
]
