"""The path of a program: which postures its targets want, under which loads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas.program import ProgramOptions
from jointstiff.service.conversion.robots import refuse_far_point, refuse_other_angles
from jointstiff.service.conversion.units import ANGLE, LENGTH
from jointstiff.service.kinds.program.frames import ProgramFrames
from jointstiff.service.kinds.program.loads import Loads, loads_of
from jointstiff.service.kinds.work import as_request_errors
from jointstiff.service.programs.configuration import StatedConfigurations
from jointstiff.service.programs.errors import Fault, ProgramError, shown
from jointstiff.service.programs.program import Program
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.predict.forward import LoadCases
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.inverse import InverseKinematics, Unreached, choose_postures
from jointstiff.solver.robot.model import Robot

_SAME: Final = 1e-6
"""Difference of two postures [rad] that is rounding."""
_REASONS: Final = {
    Unreached.OUT_OF_REACH: ("the robot does not reach it", "check tool, base, `world` and `flange`"),
    Unreached.OUT_OF_LIMITS: (
        "its posture is outside of the joints' limits",
        "check tool, base, `start`, and the limits of the robot's model",
    ),
    Unreached.NOT_AS_STATED: (
        "no posture within the limits has the stated configuration",
        "check tool and base, and that the joint map gives the controller's angles",
    ),
    Unreached.NOT_FOLLOWED: (
        "the arm is so near a singularity that the configuration of the arm is ambiguous",
        "move the part away from the singularity, or write the target as joint angles",
    ),
    Unreached.AMBIGUOUS: (
        "the arm's configuration is not stated here",
        "give `start`: the controller's angles near this target",
    ),
}


@dataclass(frozen=True, eq=False)
class ProgramPath:
    """The m targets that moves use, in the order of the path."""

    program: Program  # the program
    frames: ProgramFrames  # frames of its targets
    stated: StatedConfigurations  # what it says of the arm's configuration
    targets: IndexArray  # (m,) indices of the program's targets
    cases: LoadCases  # the wanted, loaded postures; the place is the tool's centre
    loaded: BoolArray  # (m,) whether a load acts there; everywhere if own weight counts

    def fault(self, point: int, reason: str, remedy: str) -> Fault:
        """Return a fault at a point of the path."""
        return _fault(self.program, int(self.targets[point]), reason, remedy)


@dataclass(frozen=True, eq=False)
class Visits:
    """The v targets of all moves, one after the other, and their loads."""

    targets: IndexArray  # (v,) indices of the program's targets
    order: IndexArray  # (m,) targets that are visited, in the order of their first visits
    number: IndexArray  # (v,) place of each visit's target among them
    first: IndexArray  # (m,) first visit of each of them
    loads: Loads  # loads of the visits

    @classmethod
    def of(cls, program: Program, options: ProgramOptions, table: bytes | None) -> Visits:
        """Collect the visits of a program.

        Raises:
            RequestError: no move is under load, or a load does not fit the program.
            ProgramError: there is no move, or a target has two loads.
        """
        visits = program.moves.visits
        if not len(visits):
            fault = Fault(
                program.sources[0].name, None, "the program has no move", "send a program with moves"
            )
            raise ProgramError([fault])
        order, number = _in_order(visits)
        loads = loads_of(options, table, program.moves.line[program.moves.of_visit], number + 1)
        first = _first(number, len(order))
        if not (loads.of_visit.any() or options.absolute):
            raise RequestError(
                "no move is under load",
                where="segments",
                remedy="give lines or points of moves for the loads",
            )
        _refuse_two_loads(program, visits, number, loads.of_visit, loads.of_visit[first])
        return cls(visits, order, number, first, loads)


def program_path(
    program: Program, options: ProgramOptions, robot: Robot, inverse: InverseKinematics, visits: Visits
) -> ProgramPath:
    """Return the path of a program.

    Raises:
        RequestError: something is not stated, or does not fit the program.
        ProgramError: targets are not reached, or their configurations are not known.
    """
    frames, stated = ProgramFrames.of(program, options), StatedConfigurations(program)
    joints = _postures(program, options, frames, stated, robot, inverse, visits.targets)
    _refuse_two_postures(program, visits.targets, joints, joints[visits.first][visits.number])
    load = visits.loads.of_visit[visits.first]
    with as_request_errors("program"):
        wanted = joints[visits.first]
        cases = _cases(options, frames, robot, visits.order, wanted, visits.loads.values[load])
    return ProgramPath(program, frames, stated, visits.order, cases, (load > 0) | options.absolute)


def _in_order(visits: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Return the targets (m,) in the order of their first visits, and each visit's place among them."""
    unique, first, place = np.unique(visits, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return unique[order], rank[place]


def _first(number: IndexArray, count: int) -> IndexArray:
    first = np.zeros(count, dtype=np.intp)
    first[number[::-1]] = np.arange(len(number))[::-1]
    return first


def _refuse_two_loads(
    program: Program, visits: IndexArray, number: IndexArray, load: IndexArray, load_of_target: IndexArray
) -> None:
    reason = "a target is used under two loads"
    _refuse(program, visits[load != load_of_target[number]], reason, "use a separate target for each load")


def _refuse_two_postures(
    program: Program, visits: IndexArray, joints: FloatArray, joints_of_target: FloatArray
) -> None:
    apart = joints - joints_of_target
    apart = np.abs(apart - 2 * np.pi * np.round(apart / (2 * np.pi))).max(axis=1)
    reason = "a target is reached in two configurations of the arm"
    _refuse(program, visits[apart > _SAME], reason, "use a separate target for each configuration")


def _refuse(program: Program, targets: IndexArray, reason: str, remedy: str) -> None:
    if len(targets):
        raise ProgramError([_fault(program, int(i), reason, remedy) for i in np.unique(targets)])


def _fault(program: Program, target: int, reason: str, remedy: str) -> Fault:
    targets = program.targets
    name = f"{shown(targets.names[target])}: " if targets.names[target] else ""
    return Fault(
        program.sources[targets.source[target]].name, int(targets.line[target]), name + reason, remedy
    )


def _postures(
    program: Program,
    options: ProgramOptions,
    frames: ProgramFrames,
    stated: StatedConfigurations,
    robot: Robot,
    inverse: InverseKinematics,
    visits: IndexArray,
) -> FloatArray:
    """Return the wanted posture (v, 6) of each visit: controller's angles [rad]."""
    targets, unit = program.targets, program.targets.angle_unit[visits, None]
    by_joints = targets.by_joints[visits]
    given = np.where(by_joints[:, None], targets.values[visits, :6] * unit, np.nan)
    _refuse_new_letters(program, visits, by_joints)
    poses = frames.flange_poses(program, visits)
    ranges = stated.ranges(visits)
    says = np.isfinite(ranges).any(axis=(1, 2))
    with as_request_errors("robot"):
        joints, unreached = choose_postures(
            inverse,
            poses,
            given,
            ranges,
            program.moves.by_joint & says & stated.decides,
            _start(options, robot),
        )
    faults = [
        _fault(program, int(visits[row]), *_REASONS[Unreached(unreached[row])])
        for row in np.flatnonzero(unreached)
    ]
    if faults:
        raise ProgramError(faults)
    return joints


def _start(options: ProgramOptions, robot: Robot) -> FloatArray | None:
    if options.start is None:
        return None
    refuse_other_angles(robot, options.start, "start")
    return ANGLE[options.units.angle] * np.array(options.start)


def _refuse_new_letters(program: Program, visits: IndexArray, by_joints: BoolArray) -> None:
    """Refuse a change of FANUC's N/F, U/D, T/B without a joint target between: no angles tell them."""
    literals, before, changed = program.targets.literals, "", []
    of_visit = program.targets.literal[visits].tolist() if any(each.letters for each in literals) else ()
    for target, literal, joints in zip(visits.tolist(), of_visit, by_joints.tolist(), strict=False):
        letters = "" if joints else literals[literal].letters
        if before and letters and letters != before:
            changed.append(target)
        before = "" if joints else letters or before
    remedy = "insert a move to joint angles before it, or split the program there"
    reason = "the arm changes its configuration (N/F, U/D, T/B)"
    _refuse(program, np.array(changed, dtype=np.intp), reason, remedy)


def _cases(
    options: ProgramOptions,
    frames: ProgramFrames,
    robot: Robot,
    targets: IndexArray,
    joints: FloatArray,
    loads: FloatArray,
) -> LoadCases:
    tool = frames.tool[targets]
    place = tool[:, :3, 3].copy()
    point = place
    if options.load_point is not None:
        length = LENGTH[options.units.length]
        refuse_far_point(options.load_point, "load_point", length=length)
        point = np.tile(length * np.array(options.load_point), (len(targets), 1))
    force, moment = loads[:, :3].copy(), loads[:, 3:].copy()
    if options.axes != "robot":
        if options.axes == "base":
            axes = frames.base[targets, :3, :3]
        else:
            flange = Configurations(robot, robot.joint_map.model_angles(joints)).flange_rotation
            axes = flange @ tool[:, :3, :3]
        force, moment = np.einsum("bij,bj->bi", axes, force), np.einsum("bij,bj->bi", axes, moment)
    return LoadCases(joints.copy(), force, moment, point.copy(), place)
