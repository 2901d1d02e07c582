"""A corrected program: the files with other numbers, and the certificate of what was written."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.service.kinds.program.path import ProgramPath
from jointstiff.service.kinds.program.points import Corrections, WrittenPoints
from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.programs.notation import Orientation
from jointstiff.service.programs.program import Program
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
    values = path.frames.numbers(program, targets.tolist(), flange)
    words = []
    for row, point, index in zip(rows.tolist(), points.tolist(), targets.tolist(), strict=True):
        target = program.targets[index]
        if target.notation.orientation is Orientation.JOINTS:
            values[index] = (found.commanded[row] / target.notation.angle).tolist()
        else:
            edits = path.stated.edits(index, path.cases.joints[point], found.commanded[row])
            words += [(index, edit) for edit in edits]
    return program.rewritten(values, aligned=program.format == "fanuc", words=words)


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
    old, new = path.program.targets, written.targets
    return WrittenPoints(
        path=path,
        corrections=found,
        residual=residual,
        rounding=np.asarray(np.linalg.norm(residual[:, :3] - found.residual[:, :3], axis=1)),
        changed=np.array([old[i].values != new[i].values for i in targets.tolist()], dtype=np.bool_),
        place=goal.to_base(path.cases.place[:, None])[:, 0],
        quantile=quantile,
    )


def _commanded(
    path: ProgramPath, written: Program, found: Corrections, inverse: InverseKinematics
) -> FloatArray:
    """Return the controller's angles (k, 6) [rad] to which what was written leads."""
    joint_map = inverse.robot.joint_map
    targets = path.targets[found.points]
    poses = path.frames.flange_poses(written, targets.tolist())
    cartesian = np.isfinite(poses[:, 0, 0])
    commanded = np.empty_like(found.commanded)
    for row in np.flatnonzero(~cartesian):
        target = written.targets[targets[row]]
        commanded[row] = np.array(target.values) * target.notation.angle
    near = joint_map.model_angles(found.commanded[cartesian])
    angles, reached = inverse.polished(poses[cartesian], near)
    commanded[cartesian] = joint_map.controller_angles(angles)
    lost = np.flatnonzero(cartesian)[~reached]
    if len(lost):
        reason, remedy = "the corrected target is not reached", "move the part away from the singularity"
        raise ProgramError([path.fault(int(found.points[row]), reason, remedy) for row in lost])
    return commanded
