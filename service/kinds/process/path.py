"""The path of a process, made from a program: poses that may turn about the spindle, and their loads."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jointstiff.schemas.process import ProcessRequest
from jointstiff.service.conversion.units import ANGLE
from jointstiff.service.kinds.program.path import (
    ProgramFrames,
    ProgramPath,
    StatedConfigurations,
    Visits,
    find_load_axes,
    find_load_points,
    find_path,
    find_spindles,
    turn_loads_to_base,
)
from jointstiff.service.kinds.program.text import FaultsError
from jointstiff.service.kinds.work import as_request_errors
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.process.pace import Pace
from jointstiff.solver.process.path import ProcessPath
from jointstiff.solver.process.turning import TurnTask
from robotprograms import Program

MAX_POINTS = 20_000
"""Greatest number of visited targets."""


@dataclass(frozen=True, eq=False)
class ProgramToTurn:
    """A program whose tool may turn about the spindle: v visits of m targets."""

    program: Program
    frames: ProgramFrames
    stated: StatedConfigurations
    visits: Visits
    path: ProcessPath  # one point for each visit
    # (m, 3, 3) axes of the loads at the targets as columns, axes of R0; they move with the workpiece
    load_axes: FloatArray
    programmed: ProgramPath | None  # path with the program's own postures; None if these are not known

    @classmethod
    def find(
        cls,
        program: Program,
        request: ProcessRequest,
        robot: Robot,
        inverse: InverseKinematics,
        visits: Visits,
    ) -> ProgramToTurn:
        """Find poses, loads and programmed postures of a program.

        Raises:
            RequestError: a field of the request is missing or does not fit the program, or the program states
                no orientation that could be turned.
            FaultsError: the robot does not reach targets, or their arm configurations are ambiguous.
        """
        if len(visits.targets) > MAX_POINTS:
            raise RequestError(
                f"the program has {len(visits.targets)} points, but at most {MAX_POINTS:,} are possible",
                where="files",
                remedy="split the program",
            )
        frames = ProgramFrames.from_program(program, request)
        _refuse_without_orientation(program, request, visits.targets)
        programmed = _find_programmed(program, request, robot, inverse, visits)
        path, axes = _make_path(program, request, robot, inverse, visits, frames)
        if programmed is not None and request.branches == "keep":
            path = replace(path, near=programmed.cases.joints[visits.number])
        return cls(program, frames, StatedConfigurations(program), visits, path, axes, programmed)

    @property
    def same(self) -> IndexArray:
        """(v,) index of the first visit of the same target, for each visit."""
        return self.visits.first[self.visits.number]

    def sum_weights(self) -> FloatArray:
        """Return the weights (m,) of the targets along the path: the sum of those of their visits."""
        count = len(self.visits.order)
        return np.asarray(np.bincount(self.visits.number, self.path.weights, count), dtype=np.float64)

    def move(self, shift: FloatArray, angle: float) -> ProgramToTurn:
        """Return the program of the workpiece in another place, with the base frames that move with it.

        A frame whose numbers the program has stays: its targets are written in the new place.

        Args:
            shift: (3,) displacement of the path's centre [m].
            angle: turn about the z axis of R0 through the centre [rad].
        """
        displacement = self.path.displacement(shift, angle)
        base = self.frames.base
        poses = np.where(self.moves_base[:, None, None], displacement @ base.poses, base.poses)
        frames = replace(self.frames, base=replace(base, poses=poses))
        axes = displacement[:3, :3] @ self.load_axes
        return replace(self, frames=frames, path=self.path.move(shift, angle), load_axes=axes)

    @property
    def moves_base(self) -> BoolArray:
        """(k + 1,) mask of the program's frames whose numbers are in the controller; False for R0."""
        return np.array([each.pose is None for each in self.program.targets.frames] + [False])

    def turned(self, joints: FloatArray) -> ProgramPath:
        """Return the program's path in chosen postures (v, n), controller's joints [rad or m]."""
        first, path = self.visits.first, self.path
        cases = LoadCases(
            joints[first].copy(),
            path.force[first].copy(),
            path.moment[first].copy(),
            path.load_point[first].copy(),
            path.place[first].copy(),
        )
        before = cases.joints if self.programmed is None else self.programmed.cases.joints
        return ProgramPath(self.program, self.frames, self.stated, self.visits.order, cases, before)


def make_turn_task(request: ProcessRequest, pace: Pace) -> TurnTask:
    """Return the turns of the tool about its axis to choose from, and how the robot may move.

    `turn: "keep"` in a request → only the turn of the program, 0; `"free"` → a full turn in steps;
    (-30, 30) → turns in this range.

    Raises:
        RequestError: the range of turns is too large.
    """
    greatest = request.objective == "greatest"
    if request.turn == "keep":
        return TurnTask(np.zeros(1), request.clearance, pace, greatest, request.correct)
    if request.turn == "free":
        task = TurnTask.free(request.turns, request.clearance, pace, greatest=greatest)
    else:
        low, high = _read_range_of_turns(request.turn, ANGLE[request.units.angle])
        task = TurnTask.within(low, high, request.turns, request.clearance, pace, greatest=greatest)
    return replace(task, corrects=request.correct)


def _read_range_of_turns(stated: tuple[float, float], unit: float) -> tuple[float, float]:
    """Return the least and the greatest turn [rad]; `unit` is the unit of the stated turns [rad].

    Raises:
        RequestError: the range exceeds a full turn, or a turn is beyond a full turn.
    """
    low, high = unit * np.array(stated)
    full_turn = 2.0 * np.pi + 1e-9  # allows for rounding
    if high - low > full_turn or max(abs(low), abs(high)) > full_turn:
        raise RequestError(
            "the range of turns exceeds a full turn, or lies beyond one",
            where="turn",
            remedy="state turns within a full turn, in `units.angle`; or `free`",
        )
    return float(low), float(high)


def _refuse_without_orientation(program: Program, request: ProcessRequest, targets: IndexArray) -> None:
    """Refuse a program that states positions or tool axes only, unless its turn is kept.

    Raises:
        RequestError: a turn of the tool cannot be written into the program.
    """
    notations = program.targets.notations
    used = {int(i) for i in np.unique(program.targets.notation[targets])}
    missing = any(not notations[i].has_pose and not notations[i].is_joints for i in used)
    if missing and request.turn != "keep" and request.branches == "keep":
        raise RequestError(
            "the program states no angle about the tool's axis, so a turn of the tool cannot be written "
            "into the program",
            where="turn",
            remedy="send full poses; or `branches: free`, and take the joints from points.csv",
        )


def _find_programmed(
    program: Program, request: ProcessRequest, robot: Robot, inverse: InverseKinematics, visits: Visits
) -> ProgramPath | None:
    """Return the path with the program's own postures; None if they are not known and need not be.

    Raises:
        RequestError: a field of the request is missing, or does not fit the program.
        FaultsError: the robot does not reach targets, or their arm configurations are ambiguous.
    """
    try:
        return find_path(program, request, robot, inverse, visits)
    except FaultsError as error:
        if request.turn == "keep":
            raise
        if request.branches == "free":
            return None
        # An arm that need not take the program's branch can follow more programs.
        faults = [replace(each, remedy=f"{each.remedy}; or `branches: free`") for each in error.faults]
        raise FaultsError(faults, error.count, error.left_moves) from error


def _make_path(
    program: Program,
    request: ProcessRequest,
    robot: Robot,
    inverse: InverseKinematics,
    visits: Visits,
    frames: ProgramFrames,
) -> tuple[ProcessPath, FloatArray]:
    """Return the path of a process with a point for each visit of a target, and the axes of its loads.

    The axes (m, 3, 3) are those of `ProgramToTurn`.
    """
    given = _read_given_joints(program, robot, inverse, visits)
    poses = frames.find_flange_poses(program, visits.order, robot, given)
    loads = visits.loads.values[visits.loads.of_visit[visits.first]]
    target_of_visit = visits.number
    with as_request_errors("program"):
        axes = find_load_axes(request, frames, visits, poses[target_of_visit])
        force, moment = turn_loads_to_base(request, axes, loads)
        load_point, place = find_load_points(request, frames, visits.order)
        spindle = find_spindles(request, frames, visits.order)
    path = ProcessPath(
        poses=poses[target_of_visit],
        spindle=spindle[target_of_visit],
        place=place[target_of_visit],
        load_point=load_point[target_of_visit],
        force=force[target_of_visit],
        moment=moment[target_of_visit],
        continuous=visits.continuous,
        given=given[target_of_visit],
    )
    return path, np.nan_to_num(axes)


def _read_given_joints(
    program: Program, robot: Robot, inverse: InverseKinematics, visits: Visits
) -> FloatArray:
    """Return the joints (t, n) of targets that the program states as joints [rad or m]; NaN for poses."""
    targets, order = program.targets, visits.order
    is_joint_target = targets.given_as_joints[order]
    arm_angles = targets.values[order, :6] * targets.angle_unit[order, None]
    given = np.full((len(order), robot.n), np.nan)
    given[is_joint_target] = inverse.insert_held_joints(arm_angles[is_joint_target])
    return given
