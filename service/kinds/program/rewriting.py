"""A compensated program: the files with other numbers, and the certificate of what was written."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.service.kinds.program.path import ProgramPath
from jointstiff.service.kinds.program.points import Corrections, WrittenPoints
from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.programs.program import NUMBERS, Rewriting
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.predict.forward import ForwardModel, residuals
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.inverse import InverseKinematics, flange_poses
from jointstiff.solver.robot.model import Robot

_TOLERANCE: Final = 1e-4
"""Angle by which a joint's limit may be exceeded [rad]."""


def rewritten(
    path: ProgramPath, found: Corrections, model: ForwardModel, inverse: InverseKinematics, quantile: float
) -> tuple[list[bytes], WrittenPoints]:
    """Write the corrected numbers, and put what was written through the model of the loaded robot.

    Returns:
        The files, and the points with their certificate.

    Raises:
        ProgramError: a correction leads out of the joints' limits, or a corrected target is not reached.
    """
    robot, program, frames = model.robot, path.program, path.frames
    _refuse_out_of_limits(path, robot, found)
    targets, text = path.targets[found.points], Rewriting(program)
    residual, changed = np.empty((len(targets), 6)), np.zeros(len(targets), dtype=np.bool_)
    lost: list[int] = []
    for rows in text.blocks(targets):
        own, cases = targets[rows], path.cases[found.points[rows]]
        by_joints, unit = program.targets.by_joints[own], program.targets.angle_unit[own, None]
        under = Configurations(robot, robot.joint_map.model_angles(found.commanded[rows]))
        values = frames.numbers(program, own, under.flange_pose)
        values[by_joints, :6] = (found.commanded[rows] / unit)[by_joints]
        values[found.share[rows] == 0.0] = np.nan
        posed = np.flatnonzero(~by_joints & (found.share[rows] > 0.0))
        words = path.stated.edits(own[posed], cases.joints[posed], found.commanded[rows[posed]])
        numbers = text.replace(own, values, words)
        before = program.targets.values[own, :NUMBERS]
        changed[rows] = (np.isfinite(before) & (before != numbers)).any(axis=1)
        # What the text says now, beside what it said
        angles = robot.joint_map.model_angles(numbers[:, :6] * unit)
        posed = np.flatnonzero(~by_joints)
        poses, goal = (frames.flange_poses(program, own[posed], each[posed]) for each in (numbers, before))
        angles[posed], reached = inverse.polished_from(
            poses, under if len(posed) == len(own) else Configurations(robot, under.q[posed])
        )
        lost += found.points[rows[posed[~reached]]].tolist()
        wanted = robot.joint_map.model_angles(cases.joints)
        wanted_poses = np.empty((len(own), 4, 4))
        wanted_poses[posed], wanted_poses[by_joints] = goal, flange_poses(robot, wanted[by_joints])
        residual[rows] = residuals(model, cases, wanted_poses, angles, wanted + angles - under.q)
    if lost:
        reason, remedy = (
            "the robot does not reach the corrected target",
            "move the part away from the singularity",
        )
        raise ProgramError([path.fault(point, reason, remedy) for point in sorted(lost)])
    points = WrittenPoints(
        path=path,
        corrections=found,
        residual=residual,
        rounding=np.asarray(np.linalg.norm(residual[:, :3] - found.residual[:, :3], axis=1)),
        changed=changed,
        place=_places(path, robot),
        quantile=quantile,
    )
    return text.files(), points


def _places(path: ProgramPath, robot: Robot) -> FloatArray:
    """Return where the tool's centre is wanted (m, 3), in R0 [m]."""
    places = path.frames.places(path.program, path.targets)
    by_joints = np.flatnonzero(path.program.targets.by_joints[path.targets])
    if len(by_joints):
        goal = Configurations(robot, robot.joint_map.model_angles(path.cases.joints[by_joints]))
        places[by_joints] = goal.to_base(path.cases.place[by_joints, None])[:, 0]
    return places


def _refuse_out_of_limits(path: ProgramPath, robot: Robot, found: Corrections) -> None:
    low, high = robot.limits.T
    angles = robot.joint_map.model_angles(found.commanded)
    outside = ((angles < low - _TOLERANCE) | (angles > high + _TOLERANCE)).any(axis=1)
    reason = "the corrected target is outside of the joints' limits"
    remedy = "move the part, or omit its load"
    faults = [path.fault(int(found.points[row]), reason, remedy) for row in np.flatnonzero(outside)]
    if faults:
        raise ProgramError(faults)
