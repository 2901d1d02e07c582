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
    from jointstiff.solver.geometry.model import CalibratedAxes, DhTable, Poses
    from jointstiff.solver.geometry.survey import survey_poses, survey_sweeps
    from jointstiff.solver.geometry.surveyed import BaseTargets, Conventions, Survey
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
        survey="survey_poses survey_sweeps",
        surveyed="BaseTargets Conventions Survey",
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
    "Poses",
    "RigidTransform",
    "Survey",
    "Sweep",
    "SweepSet",
    "WristCentre",
    "survey_poses",
    "survey_sweeps",
]
