"""A corrected program: the files with other numbers, and the certificate of what was written."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.service.kinds.program.path import ProgramPath
from jointstiff.service.kinds.program.points import Corrections, WrittenPoints
from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.programs.program import NUMBERS, Program
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.deflection.compensation import residuals
from jointstiff.solver.deflection.forward import ForwardModel
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.inverse import InverseKinematics, flange_poses
from jointstiff.solver.robot.model import Robot

_TOLERANCE: Final = 1e-4
"""Angle by which a joint's limit may be exceeded [rad]."""


def rewritten(path: ProgramPath, robot: Robot, found: Corrections) -> Program:
    """Return the program with the corrected numbers, read from its text where they stand now.

    Raises:
        ProgramError: a correction leads out of the joints' limits.
    """
    _refuse_out_of_limits(path, robot, found)
    program = path.program
    rows = np.flatnonzero(found.share > 0.0)
    points = found.points[rows]
    targets = path.targets[points]
    flange = flange_poses(robot, robot.joint_map.model_angles(found.commanded[rows]))
    values = path.frames.numbers(program, targets, flange)
    by_joints = program.targets.by_joints[targets]
    unit = program.targets.angle_unit[targets[by_joints], None]
    values[by_joints, :6] = found.commanded[rows][by_joints] / unit
    posed = np.flatnonzero(~by_joints)
    words = path.stated.edits(targets[posed], path.cases.joints[points[posed]], found.commanded[rows[posed]])
    return program.rewritten(targets, values, aligned=program.format == "fanuc", words=words)


def _refuse_out_of_limits(path: ProgramPath, robot: Robot, found: Corrections) -> None:
    low, high = robot.limits.T
    angles = robot.joint_map.model_angles(found.commanded)
    outside = ((angles < low - _TOLERANCE) | (angles > high + _TOLERANCE)).any(axis=1)
    reason = "the corrected target is outside of the joints' limits"
    remedy = "move the part, or leave its load out"
    faults = [path.fault(int(found.points[row]), reason, remedy) for row in np.flatnonzero(outside)]
    if faults:
        raise ProgramError(faults)


def certified(
    path: ProgramPath,
    written: Program,
    found: Corrections,
    model: ForwardModel,
    inverse: InverseKinematics,
    quantile: float,
) -> WrittenPoints:
    """Put what was written through inverse kinematics and the model of the loaded robot.

    Raises:
        ProgramError: a corrected target is not reached.
    """
    robot = model.robot
    targets = path.targets[found.points]
    commanded = _commanded(path, written, found, inverse)
    residual = found.residual
    if len(found.points):
        residual = residuals(model, path.cases[found.points], commanded)
    goal = Configurations(robot, robot.joint_map.model_angles(path.cases.joints))
    old, new = (each.targets.values[targets, :NUMBERS] for each in (path.program, written))
    return WrittenPoints(
        path=path,
        corrections=found,
        residual=residual,
        rounding=np.asarray(np.linalg.norm(residual[:, :3] - found.residual[:, :3], axis=1)),
        changed=np.asarray((np.isfinite(old) & (old != new)).any(axis=1)),
        place=goal.to_base(path.cases.place[:, None])[:, 0],
        quantile=quantile,
    )


def _commanded(
    path: ProgramPath, written: Program, found: Corrections, inverse: InverseKinematics
) -> FloatArray:
    """Return the controller's angles (k, 6) [rad] to which what was written leads."""
    joint_map = inverse.robot.joint_map
    targets = path.targets[found.points]
    poses = path.frames.flange_poses(written, targets)
    cartesian = ~written.targets.by_joints[targets]
    commanded = written.targets.angles(targets)
    near = joint_map.model_angles(found.commanded[cartesian])
    angles, reached = inverse.polished(poses[cartesian], near)
    commanded[cartesian] = joint_map.controller_angles(angles)
    lost = np.flatnonzero(cartesian)[~reached]
    if len(lost):
        reason, remedy = "the corrected target is not reached", "move the part away from the singularity"
        raise ProgramError([path.fault(int(found.points[row]), reason, remedy) for row in lost])
    return commanded
