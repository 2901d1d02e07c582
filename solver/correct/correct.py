"""Correction of arrays: poses of a tool in; corrected poses and joints, bands and a status of each row out.

Programs, posts and tables are clients: they read numbers, call `correct` or its two halves `find_joints` and
`correct_cases`, and write numbers. No row ends the correction of the others: a row without numbers has a
status that says why.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from functools import cached_property, partial
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.correct.blend import Blend, blend_loads, find_joint_limits
from jointstiff.solver.correct.feed import find_feed_frames
from jointstiff.solver.correct.frames import FrameGaps, FramesError, invert_poses, propose_frames
from jointstiff.solver.errors import CasesError, RequestError
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.inverse import InverseKinematics, Unreached, follow_poses
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.forward import (
    Compensation,
    CorrectionLimits,
    ForwardModel,
    compensate_poses,
)
from jointstiff.solver.predict.models import JointModel, ModelError

ROWS_AT_ONCE: Final = 4_000
"""Rows that are corrected at a time."""
LIMIT_TOLERANCE: Final = 1e-4
"""Angle by which a joint's limit may be exceeded [rad]."""
_MOST_CONTRADICTORY: Final = 0.5
"""Fraction of rows whose pose and joints contradict each other, above which tool, base or units are wrong."""
_LARGEST_REFINEMENT: Final = 2e-2
"""Angle between stated joints and those of their pose above which the postures differ [rad]."""
_CERTAIN_REFINEMENT: Final = 1e-3
"""Angle up to which a stated posture and the posture of its pose are the same [rad]."""
_HELD: Final = 1e-6
"""Difference of a prismatic joint between rows that is rounding [m]."""
_SAME_POSTURE: Final = 1e-6
"""Difference of joints that were found in two ways, which is rounding [rad]."""
_CLOSE: Final = 0.2
"""Difference between two postures of a pose below which the path may change from one to the other [rad]."""
_CLOSE_STEPS: Final = 4.0
"""The same in steps between neighbouring rows."""
_CHECKED_AT_ONCE: Final = 64
"""Doubtful steps of a path that are followed at a time."""


class RowStatus(IntEnum):
    """Status of a row. Rows up to `UNCERTAIN` have poses and joints; the others have none."""

    CORRECTED = 0
    NO_LOAD = 1  # the pose as sent: nothing deflects
    CAPPED = 2  # corrected up to the limits of a correction
    UNCERTAIN = 3  # the pose as sent: the deflection is less than its uncertainty
    BEYOND_LIMITS = 4  # the posture, or the corrected posture, is outside of the joints' limits
    NOT_REACHED = 5  # the robot does not reach the pose, or the corrected pose
    AMBIGUOUS = 6  # the pose does not determine the posture
    CONTRADICTORY = 7  # pose and joints of the row contradict each other
    UNSEEN_JOINT = 8  # the load twists a joint that the readings do not determine
    OVERLOADED = 9  # the load is too great for the model
    NO_DIRECTION = 10  # the load follows a feed, and the tool does not move across its axis


_STATUS_OF_UNREACHED: Final[Mapping[Unreached, RowStatus]] = MappingProxyType(
    {
        Unreached.NO: RowStatus.CORRECTED,
        Unreached.OUT_OF_REACH: RowStatus.NOT_REACHED,
        Unreached.OUT_OF_LIMITS: RowStatus.BEYOND_LIMITS,
        Unreached.NOT_AS_STATED: RowStatus.NOT_REACHED,
        Unreached.AMBIGUOUS: RowStatus.AMBIGUOUS,
        Unreached.NOT_FOLLOWED: RowStatus.AMBIGUOUS,
    }
)


@dataclass(frozen=True, eq=False)
class Waypoints:
    """N poses of a tool, in order along a path, with the frames to which they refer."""

    poses: FloatArray  #: (N, 4, 4) poses of the tool in the base [m]
    tool: FloatArray  #: (4, 4) tool in the flange frame [m]
    base: FloatArray  #: (4, 4) base in R0 [m]
    #: (N, n) controller's joints of the poses [rad or m]; None if they follow from the path
    joints: FloatArray | None = None
    start: FloatArray | None = None  #: (n,) controller's joints near the first pose; None if unknown

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def flange_poses(self) -> FloatArray:
        """(N, 4, 4) poses of the flange in R0 [m]."""
        return np.asarray(self.base @ self.poses @ invert_poses(self.tool))

    @property
    def lengths(self) -> FloatArray:
        """(N,) lengths of the path up to each pose [m]."""
        steps = np.linalg.norm(np.diff(self.poses[:, :3, 3], axis=0), axis=1)
        return np.append(0.0, np.cumsum(steps))

    def find_axes(self, axes: Literal["robot", "base", "tool", "feed"]) -> FloatArray:
        """Return the axes (N, 3, 3) along which loads are stated: columns along the axes of R0.

        With `feed`, the axes are feed, normal and tool axis; the first two are NaN where the tool does not
        move across its axis.
        """
        count, tool_in_robot = len(self), self.base[:3, :3] @ self.poses[:, :3, :3]
        if axes == "robot":
            return np.broadcast_to(np.eye(3), (count, 3, 3))
        if axes == "base":
            return np.broadcast_to(self.base[:3, :3], (count, 3, 3))
        if axes == "tool":
            return np.asarray(tool_in_robot)
        centres = self.poses[:, :3, 3] @ self.base[:3, :3].T + self.base[:3, 3]
        is_continuous = np.ones(count, dtype=np.bool_)
        is_continuous[:1] = False
        return find_feed_frames(centres, tool_in_robot[:, :, 2], is_continuous)


@dataclass(frozen=True, eq=False)
class CorrectedRows:
    """Postures and corrections of N poses; arrays are NaN in rows that have no such numbers."""

    wanted: FloatArray  #: (N, n) controller's joints of the poses as sent [rad or m]
    status: IndexArray  #: (N,) values of `RowStatus`; `CORRECTED` also where only the posture is found
    poses: FloatArray  #: (N, 4, 4) corrected poses of the tool in the base [m]
    joints: FloatArray  #: (N, n) corrected controller's joints [rad or m]
    deflection: FloatArray  #: (N, 3) deflection of the tool without a correction, axes of the base [m]
    #: (N,) half-width of the interval of the deflection's length, from the readings [m]; NaN if unknown
    readings: FloatArray
    with_model_error: FloatArray  #: (N,) the same with the model error [m]; NaN without a bound
    residual: FloatArray  #: (N,) predicted distance of the loaded tool from its pose [m]
    #: (N,) load or leverage relative to the campaign's: above 1.01 the prediction extrapolates
    extrapolation: FloatArray
    #: (N,) greatest speed of a revolute joint from the row before, at the feed [rad/s]; NaN without a feed
    joint_speed: FloatArray
    #: (N,) length of the path over which the correction follows the load [m]; NaN where it follows at once
    blend_length: FloatArray

    @classmethod
    def from_postures(cls, wanted: FloatArray, status: IndexArray) -> CorrectedRows:
        """Return rows with postures (N, n) and statuses (N,), and without corrections."""
        shapes = {"poses": (4, 4), "joints": wanted.shape[1:], "deflection": (3,)}
        names = [each.name for each in fields(cls)[2:]]
        numbers = {name: np.full((len(wanted), *shapes.get(name, ())), np.nan) for name in names}
        return cls(wanted, status, **numbers)

    @classmethod
    def concatenate(cls, blocks: Sequence[CorrectedRows]) -> CorrectedRows:
        """Return the rows of at least one block, in order."""
        names = [each.name for each in fields(cls)]
        return cls(**{name: np.concatenate([getattr(block, name) for block in blocks]) for name in names})

    def select(self, block: slice) -> CorrectedRows:
        """Return copies of some rows."""
        return CorrectedRows(**{name: values[block].copy() for name, values in vars(self).items()})

    def __len__(self) -> int:
        return len(self.status)

    @property
    def has_numbers(self) -> BoolArray:
        """(N,) mask of the rows with a pose and joints."""
        return np.asarray(self.status <= RowStatus.UNCERTAIN)

    def insert(self, rows: IndexArray, done: CaseCorrections, quantile: float) -> None:
        """Insert corrections of some rows; `quantile` is the half-width in standard uncertainties."""
        half_width = quantile * done.uncertainty
        radius = np.where(np.isfinite(done.model_error), done.model_error, np.nan)
        self.status[rows] = done.status
        self.joints[rows] = done.commanded
        self.deflection[rows] = done.uncorrected[:, :3]
        self.readings[rows] = half_width
        self.with_model_error[rows] = np.where(np.isnan(radius), np.nan, np.fmax(half_width, radius))
        self.residual[rows] = np.linalg.norm(done.residual[:, :3], axis=1)
        self.extrapolation[rows] = done.extrapolation

    def clear_rows_without_numbers(self) -> None:
        """Replace the corrections of rows whose status has no numbers with NaN."""
        has_no_numbers = ~self.has_numbers
        for each in fields(self)[2:]:
            getattr(self, each.name)[has_no_numbers] = np.nan


def find_joints(inverse: InverseKinematics, robot: Robot, waypoints: Waypoints) -> CorrectedRows:
    """Find the posture of each pose: near the stated joints, or on the branch of the posture before.

    Raises:
        FramesError: most poses contradict their joints, so that a frame or a unit is wrong.
        RequestError: a prismatic joint moves.
    """
    if waypoints.joints is None:
        return _follow_path(inverse, waypoints)
    return _refine_stated_joints(inverse, robot, waypoints, waypoints.joints)


def _follow_path(inverse: InverseKinematics, waypoints: Waypoints) -> CorrectedRows:
    """Find postures along the path. Behind a pose whose posture is not certain, no posture is."""
    poses = waypoints.flange_poses
    followed = follow_poses(inverse, poses, waypoints.start)
    status_of_code = np.array([_STATUS_OF_UNREACHED[each] for each in Unreached], dtype=np.intp)
    status, joints = status_of_code[followed.unreached], followed.joints.copy()
    is_close = followed.apart < np.minimum(_CLOSE, _CLOSE_STEPS * _find_longest_steps(joints))
    ambiguous = np.flatnonzero((status == RowStatus.AMBIGUOUS) | is_close)
    lost = int(ambiguous[0]) if len(ambiguous) else len(poses)
    doubtful = np.flatnonzero(followed.doubtful[:lost])
    for begin in range(0, len(doubtful), _CHECKED_AT_ONCE):
        rows = doubtful[begin : begin + _CHECKED_AT_ONCE]
        is_sure = _follow_lines(inverse, poses, joints, rows, waypoints.start)
        if not is_sure.all():
            lost = int(rows[np.argmin(is_sure)])
            break
    is_reached = status[lost:] != RowStatus.NOT_REACHED
    status[lost:][is_reached] = RowStatus.AMBIGUOUS
    joints[status != RowStatus.CORRECTED] = np.nan
    return CorrectedRows.from_postures(joints, status)


def _find_longest_steps(joints: FloatArray) -> FloatArray:
    """Return the longest step of a joint (N,) between each row, the row before and the row behind [rad or m].

    Steps from and to rows of NaN count as zero.
    """
    steps = np.nan_to_num(np.abs(np.diff(joints, axis=0)).max(axis=1))
    return np.asarray(np.maximum(np.append(0.0, steps), np.append(steps, 0.0)))


def _follow_lines(
    inverse: InverseKinematics,
    poses: FloatArray,
    joints: FloatArray,
    rows: IndexArray,
    start: FloatArray | None,
) -> BoolArray:
    """Return whether the straight line from the posture before leads to the posture of each row.

    Args:
        inverse: kinematics of the robot.
        poses: (N, 4, 4) poses of the flange in R0 [m].
        joints: (N, n) controller's joints of the path; NaN without a posture.
        rows: (k,) rows to check.
        start: (n,) controller's joints near the first pose.
    """
    known = np.flatnonzero(np.isfinite(joints[:, 0]))
    place = np.searchsorted(known, rows) - 1  # of the last posture before each row
    before = joints[known[place]]
    if start is not None:
        before[place < 0] = start
    joint_map = inverse.arm.joint_map
    starts = joint_map.model_angles(inverse.select_arm_joints(before))
    found, is_certain = inverse.follow_branches(poses[rows], starts)
    chosen = joint_map.model_angles(inverse.select_arm_joints(joints[rows]))
    return np.asarray(is_certain & (np.abs(found - chosen).max(axis=1) <= _SAME_POSTURE))


def _refine_stated_joints(
    inverse: InverseKinematics, robot: Robot, waypoints: Waypoints, joints: FloatArray
) -> CorrectedRows:
    """Find the postures of the poses near their stated joints, and compare both.

    Raises:
        FramesError: most poses contradict their joints.
        RequestError: a prismatic joint moves.
    """
    _refuse_moving_axes(robot, joints)
    poses, arm = waypoints.flange_poses, inverse.arm
    controller_joints = inverse.select_arm_joints(joints)
    stated, found = np.empty(controller_joints.shape), np.empty(controller_joints.shape)
    reached = np.empty(len(stated), dtype=np.bool_)
    distance, angle = np.empty(len(stated)), np.empty(len(stated))
    for begin in range(0, len(stated), ROWS_AT_ONCE):
        block = slice(begin, begin + ROWS_AT_ONCE)
        stated[block] = arm.joint_map.model_angles(controller_joints[block])
        postures = Postures(arm, stated[block])
        gaps = FrameGaps.measure(poses[block], postures)
        distance[block], angle[block] = gaps.distance, gaps.angle
        found[block], reached[block] = inverse.refine_from(poses[block], postures)
    gaps = FrameGaps(distance, angle)
    agree = gaps.agree
    if (~agree).mean() > _MOST_CONTRADICTORY:
        proposal = propose_frames(robot, waypoints.poses, joints, waypoints.tool, waypoints.base)
        raise FramesError(gaps, proposal)
    status = np.full(len(stated), RowStatus.CORRECTED, dtype=np.intp)
    change = np.abs(found - stated).max(axis=1)
    lower, upper = arm.limits.T
    is_beyond = np.maximum(lower - found, found - upper).max(axis=1) > LIMIT_TOLERANCE
    status[is_beyond] = RowStatus.BEYOND_LIMITS
    doubtful = np.flatnonzero(agree & (change > _CERTAIN_REFINEMENT))
    is_lost = ~inverse.is_same_branch(found[doubtful], stated[doubtful])
    status[doubtful[is_lost]] = RowStatus.AMBIGUOUS
    status[~reached | (change > _LARGEST_REFINEMENT)] = RowStatus.AMBIGUOUS
    status[~agree] = RowStatus.CONTRADICTORY
    refined = inverse.insert_held_joints(arm.joint_map.controller_angles(found))
    refined = np.where((status == RowStatus.CORRECTED)[:, None], refined, np.nan)
    return CorrectedRows.from_postures(refined, status)


def _refuse_moving_axes(robot: Robot, joints: FloatArray) -> None:
    """Refuse rows between which a prismatic joint moves: corrections hold such joints in place.

    Raises:
        RequestError: a prismatic joint has different positions.
    """
    spread = np.ptp(joints[:, robot.prismatic], axis=0)
    if (spread > _HELD).any():
        name = np.array(robot.joint_names)[robot.prismatic][int(np.argmax(spread))]
        raise RequestError(
            f"the linear axis {name} moves between the rows by {float(spread.max()):.4g} m",
            where="joints",
            remedy="correct the rows of each position of the axis on their own",
        )


@dataclass(frozen=True, eq=False)
class CaseCorrections(Compensation):
    """Corrections of m wanted postures under load. Rows whose status has no numbers are NaN."""

    #: (m,) bound of the predicted displacement's error, model error included [m]; inf or NaN where unknown
    model_error: FloatArray
    #: (m,) load or leverage relative to the campaign's: above 1.01 the prediction extrapolates; NaN if there
    #: is no model error
    extrapolation: FloatArray
    status: IndexArray  #: (m,) values of `RowStatus`


class CorrectedCases(NamedTuple):
    """Corrections of load cases, and the errors of the cases that could not be computed."""

    corrections: CaseCorrections
    #: row → reason why it could not be computed; the first error comes first
    faults: Mapping[int, CasesError]
    flange_poses: FloatArray  #: (m, 4, 4) unloaded flange by the commands in R0 [m]; NaN where a row failed


@dataclass(frozen=True, eq=False)
class CorrectionSettings:
    """Limits of a correction, and the confidence of its bands."""

    limits: CorrectionLimits = field(default_factory=CorrectionLimits)
    confidence: float = 0.95  #: level of the bound of the model error


def correct_cases(
    model: ForwardModel,
    error_of_model: ModelError | None,
    inverse: InverseKinematics,
    cases: LoadCases,
    settings: CorrectionSettings,
    ramp: FloatArray | None = None,
    commanded_cases: LoadCases | None = None,
) -> CorrectedCases:
    """Compute the commands that bring the loaded tool to its places; a row that fails gets a status.

    Args:
        model: model of the loaded robot.
        error_of_model: error of the model; None if it is unknown.
        inverse: inverse kinematics of the same robot; its prismatic joints stay in place.
        cases: m wanted postures with their loads.
        settings: limits and confidence.
        ramp: (m,) fraction of each correction to apply; None for full corrections.
        commanded_cases: the same cases with the loads that the commands correct, such as from `blend_loads`;
            None for the loads of `cases`.
    """
    ramp = np.ones(len(cases)) if ramp is None else ramp
    keep_fixed_joints = partial(inverse.reach_with_held_joints, model.robot)
    faults, rows = dict[int, CasesError](), np.arange(len(cases))
    own_cases, own_commanded = cases, commanded_cases  # of the rows
    done: Compensation | None = None
    poses = np.full((len(cases), 4, 4), np.nan)
    while done is None and len(rows):
        try:
            done, poses[rows] = compensate_poses(
                model, own_cases, settings.limits, ramp[rows], keep_fixed_joints, own_commanded
            )
        except CasesError as error:
            # The others are computed again without the rows that fail.
            failed = error.failed if error.failed.any() else np.ones(len(rows), dtype=np.bool_)
            faults |= dict.fromkeys(rows[failed].tolist(), error)
            rows = rows[~failed]
            if len(rows):
                own_cases = cases[rows]
                own_commanded = None if commanded_cases is None else commanded_cases[rows]
    columns = _place_rows(done, rows, len(cases), model.robot.n)
    radius, extrapolation = np.full(len(cases), np.nan), np.full(len(cases), np.nan)
    if error_of_model is not None and done is not None:
        bound = error_of_model.bound(own_cases, done.leverage, settings.confidence)
        radius[rows] = bound.radius
        extrapolation[rows] = np.maximum(bound.load_ratio, bound.leverage_ratio)
    status = _find_status(model, cases, columns)
    for row, fault in faults.items():
        status[row] = _STATUS_OF_CAUSE[fault.cause]
    corrections = CaseCorrections(**columns, model_error=radius, extrapolation=extrapolation, status=status)
    return CorrectedCases(corrections, faults, poses)


_STATUS_OF_CAUSE: Final = MappingProxyType(
    {
        "overloaded": RowStatus.OVERLOADED,
        "unseen_joint": RowStatus.UNSEEN_JOINT,
        "not_reached": RowStatus.NOT_REACHED,
    }
)


def _place_rows(done: Compensation | None, rows: IndexArray, count: int, joints: int) -> dict[str, Any]:
    """Return the arrays of a compensation of some of m rows by name; NaN or False in the other rows."""
    if done is not None and len(rows) == count:
        return dict(vars(done))
    widths = {"commanded": (joints,), "correction": (6,), "residual": (6,), "uncorrected": (6,)}
    columns = dict[str, Any]()
    for each in fields(Compensation):
        shape = (count, *widths.get(each.name, ()))
        is_mask = each.name in {"uncertain", "capped"}
        columns[each.name] = np.zeros(shape, dtype=np.bool_) if is_mask else np.full(shape, np.nan)
        if done is not None:
            columns[each.name][rows] = getattr(done, each.name)
    return columns


def _find_status(model: ForwardModel, cases: LoadCases, columns: Mapping[str, Any]) -> IndexArray:
    """Return the status (m,) of rows that were computed, by the arrays of their compensation."""
    status = np.full(len(cases), RowStatus.CORRECTED, dtype=np.intp)
    if not has_weight(model):
        is_loaded = cases.force.any(axis=1) | cases.moment.any(axis=1)
        status[~is_loaded] = RowStatus.NO_LOAD
    status[columns["capped"]] = RowStatus.CAPPED
    status[columns["uncertain"]] = RowStatus.UNCERTAIN
    low, high = model.robot.limits.T
    angles = model.robot.joint_map.model_angles(columns["commanded"])
    is_beyond = ((angles < low - LIMIT_TOLERANCE) | (angles > high + LIMIT_TOLERANCE)).any(axis=1)
    status[is_beyond] = RowStatus.BEYOND_LIMITS
    return status


def has_weight(model: ForwardModel) -> bool:
    """Return whether deflections include the sag under own weight, so that each posture is under load."""
    return isinstance(model, JointModel) and model.weight is not None and model.weight.absolute


@dataclass(frozen=True, eq=False)
class FoundPath:
    """N poses of a tool with their postures and loads, whose rows are corrected block by block."""

    model: ForwardModel  #: model of the loaded robot
    error: ModelError | None  #: error of the model; None if it is unknown
    inverse: InverseKinematics  #: of the same robot; its prismatic joints stay in place
    waypoints: Waypoints
    loads: FloatArray  #: (N, 6) force [N] and moment [N·m] on the tool, axes of R0; NaN where it is not known
    settings: CorrectionSettings
    load_point: FloatArray  #: (3,) point where the force acts, flange frame [m]
    feed: float | None  #: speed of the tool along the path [m/s]; None if unknown
    rows: CorrectedRows  #: postures and statuses of all rows; corrections are NaN
    blend: Blend | None  #: loads that the rows with a posture correct; None for the loads themselves

    @classmethod
    def find(
        cls,
        model: ForwardModel,
        error: ModelError | None,
        inverse: InverseKinematics,
        waypoints: Waypoints,
        loads: FloatArray,
        settings: CorrectionSettings | None = None,
        *,
        load_point: FloatArray | None = None,
        feed: float | None = None,
    ) -> FoundPath:
        """Find the postures of N poses; arguments as of `correct`.

        Raises:
            FramesError: joints are stated, and most poses contradict their joints.
            RequestError: a prismatic joint moves.
        """
        rows = find_joints(inverse, model.robot, waypoints)
        has_load = np.isfinite(loads).all(axis=1)
        rows.status[(rows.status == RowStatus.CORRECTED) & ~has_load] = RowStatus.NO_DIRECTION
        point = waypoints.tool[:3, 3].copy() if load_point is None else load_point
        settings = CorrectionSettings() if settings is None else settings
        path = cls(model, error, inverse, waypoints, loads, settings, point, feed, rows, None)
        return replace(path, blend=path._blend_loads())

    @cached_property
    def found(self) -> IndexArray:
        """(k,) rows with a posture and a load."""
        return np.flatnonzero(self.rows.status == RowStatus.CORRECTED)

    @cached_property
    def _robot_in_base(self) -> FloatArray:
        """(4, 4) R0 in the base [m]."""
        return invert_poses(self.waypoints.base)

    def __len__(self) -> int:
        return len(self.rows)

    def correct(self, begin: int, end: int) -> CorrectedRows:
        """Correct the rows from `begin` up to `end`; the speeds of the joints are NaN until `join`."""
        starts = range(begin, end, ROWS_AT_ONCE)
        blocks = [self._correct_block(start, min(start + ROWS_AT_ONCE, end)) for start in starts]
        return CorrectedRows.concatenate(blocks)

    def _correct_block(self, begin: int, end: int) -> CorrectedRows:
        """Correct the rows from `begin` up to `end` together."""
        rows, waypoints = self.rows.select(slice(begin, end)), self.waypoints
        first, last = np.searchsorted(self.found, (begin, end)).tolist()
        at = self.found[first:last]
        if len(at):
            cases = self._select_cases(at)
            commanded = None if self.blend is None else self.blend.cases[first:last]
            done, _, flange = correct_cases(
                self.model, self.error, self.inverse, cases, self.settings, commanded_cases=commanded
            )
            quantile = self.model.quantile(self.settings.confidence)
            rows.insert(at - begin, done, quantile)
            rows.poses[at - begin] = self._robot_in_base @ flange @ waypoints.tool
        rows.deflection[:] = rows.deflection @ waypoints.base[:3, :3]
        unchanged = (rows.status == RowStatus.NO_LOAD) | (rows.status == RowStatus.UNCERTAIN)
        as_sent = rows.wanted if waypoints.joints is None else waypoints.joints[begin:end]
        rows.poses[unchanged], rows.joints[unchanged] = (
            waypoints.poses[begin:end][unchanged],
            as_sent[unchanged],
        )
        rows.clear_rows_without_numbers()
        return rows

    def join(self, blocks: Sequence[CorrectedRows]) -> CorrectedRows:
        """Join all corrected blocks in order, and measure the speeds of the joints."""
        rows = CorrectedRows.concatenate(blocks)
        rows.joint_speed[:] = _measure_joint_speeds(self.model.robot, self.waypoints, rows.joints, self.feed)
        return rows

    def _select_cases(self, at: IndexArray) -> LoadCases:
        """Return the load cases of some rows (k,)."""
        points = np.tile(self.load_point, (len(at), 1))
        places = np.tile(self.waypoints.tool[:3, 3], (len(at), 1))
        return LoadCases(self.rows.wanted[at], self.loads[at, :3], self.loads[at, 3:], points, places)

    def _blend_loads(self) -> Blend | None:
        """Return the loads with which corrections change slowly enough for the joints at the feed.

        None without a feed, and if corrections can follow the loads. The lengths of changes are noted in the
        rows.
        """
        found, robot = self.found, self.model.robot
        if self.feed is None or not len(found):
            return None
        limits = find_joint_limits(np.full(len(found), self.feed), robot.speeds)
        is_next = np.diff(found, prepend=-2) == 1
        blend = blend_loads(self.model, self._select_cases(found), is_next, limits)
        if blend is not None:
            self.rows.blend_length[found] = np.where(blend.lengths > 0.0, blend.lengths, np.nan)
        return blend


def correct(
    model: ForwardModel,
    error: ModelError | None,
    inverse: InverseKinematics,
    waypoints: Waypoints,
    loads: FloatArray,
    settings: CorrectionSettings | None = None,
    *,
    load_point: FloatArray | None = None,
    feed: float | None = None,
) -> CorrectedRows:
    """Correct N poses of a tool for the deflection under load.

    Args:
        model: model of the loaded robot.
        error: error of the model; None if it is unknown.
        inverse: inverse kinematics of the same robot; its prismatic joints stay in place.
        waypoints: N poses with their frames.
        loads: (N, 6) force [N] and moment [N·m] on the tool, axes of R0; NaN where it is not known.
        settings: limits and confidence.
        load_point: (3,) point where the force acts, flange frame [m]; None for the tool's centre.
        feed: speed of the tool along the path [m/s]; None if unknown.

    Raises:
        FramesError: joints are stated, and most poses contradict their joints.
        RequestError: a prismatic joint moves.
    """
    path = FoundPath.find(model, error, inverse, waypoints, loads, settings, load_point=load_point, feed=feed)
    return path.join([path.correct(0, len(path))])


def _measure_joint_speeds(
    robot: Robot, waypoints: Waypoints, joints: FloatArray, feed: float | None
) -> FloatArray:
    """Return the greatest speed (N,) of a revolute joint from the row before, at a feed [rad/s].

    NaN for the first row, without a feed, and where the tool rests or a row has no numbers.
    """
    speed = np.full(len(joints), np.nan)
    if feed is None or robot.prismatic.all():
        return speed
    steps, turns = np.diff(waypoints.lengths), np.diff(joints[:, ~robot.prismatic], axis=0)
    moves = steps > 0.0
    speed[1:][moves] = feed * np.abs(turns[moves]).max(axis=1) / steps[moves]
    return speed


def turn_loads(axes: FloatArray, loads: FloatArray) -> FloatArray:
    """Return loads (N, 6) along the axes of R0, given along the columns of `axes` (N, 3, 3).

    NaN where a load needs a direction that its axes do not have.
    """
    parts = loads.reshape(-1, 2, 3)
    known = np.nan_to_num(axes)
    turned = np.einsum("bij,bkj->bki", known, parts)
    needs_feed = parts[:, :, :2].any(axis=(1, 2))
    turned[needs_feed & np.isnan(axes[:, 0, 0])] = np.nan
    return np.asarray(turned.reshape(-1, 6))


def place_forces(forces: FloatArray, lengths: FloatArray) -> FloatArray:
    """Return forces (N, 3) of N rows from one force (3,), a force a row, or rows (K, 4) of length and force.

    Forces at lengths are interpolated; before the first and behind the last length there is no force. Two
    rows of the same length are a step of the force.

    Args:
        forces: forces in one of the three shapes.
        lengths: (N,) length of the path up to each row, in the unit of the lengths of the forces.

    Raises:
        RequestError: the forces have another shape, or a length is less than the one before.
    """
    count = len(lengths)
    if forces.shape == (3,):
        return np.tile(forces, (count, 1))
    if forces.shape == (count, 3):
        return forces.copy()
    if forces.ndim == 2 and forces.shape[1] == 4 and len(forces):
        at = forces[:, 0]
        _refuse_falling_lengths(at)
        columns = [np.interp(lengths, at, column, left=0.0, right=0.0) for column in forces[:, 1:].T]
        return np.stack(columns, axis=1)
    raise RequestError(
        f"the forces have shape {forces.shape}",
        where="forces",
        remedy=f"give one force (3,), forces ({count}, 3) of the rows, or rows (K, 4) of length and force",
    )


def _refuse_falling_lengths(lengths: FloatArray) -> None:
    """Refuse lengths (K,) that are not in rising order: between them, no force could be interpolated.

    Raises:
        RequestError: names the first row whose length is less than the one before, or not finite.
    """
    is_known = np.isfinite(lengths)
    if not is_known.all():
        raise RequestError(
            f"the length in row {int(np.argmin(is_known)) + 1} of the forces is not a finite number",
            where="forces",
            remedy="give a length in each row",
        )
    falls = np.flatnonzero(np.diff(lengths) < 0.0)
    if len(falls):
        row = int(falls[0]) + 1
        raise RequestError(
            f"the length {lengths[row]:.6g} in row {row + 1} of the forces is less than the length "
            f"{lengths[row - 1]:.6g} in the row before",
            where="forces",
            remedy="sort the rows by their length along the path",
        )
