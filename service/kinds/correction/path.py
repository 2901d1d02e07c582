"""The path of a robot program: frames, loads and arm configurations of its targets, and wanted postures."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np

from jointstiff.schemas.correction import CorrectionOptions, ProgramFrame
from jointstiff.service.conversion.robots import refuse_far_point
from jointstiff.service.conversion.units import LENGTH
from jointstiff.service.kinds.correction.loads import Loads, collect_loads
from jointstiff.service.kinds.correction.text import FaultsError
from jointstiff.service.kinds.work import as_request_errors
from jointstiff.service.runs.correction.answer import read_start
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.correct.feed import apply_feed_frames, find_feed_frames
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.inverse import (
    InverseKinematics,
    Unreached,
    choose_postures,
)
from jointstiff.solver.mechanics.postures import flange_poses
from jointstiff.solver.mechanics.robot import Robot
from robotprograms import (
    BLOCK,
    NUMBERS,
    Edit,
    Fault,
    FrameName,
    Notation,
    Orientation,
    Program,
    choose_frame_notation,
    quote_text,
)

SAME_FEED: Final = 1.01
"""Ratio to a stated feed up to which the feed of a program is the same."""
_FEED_UNIT: Final = 1e-3
"""Unit of the feeds of a program, mm/s, in m/s."""
_NO_FRAME: Final = -1
"""Index in place of that of a frame, for a target that needs none."""
_LEAST_SINE: Final = 1e-3
"""Sine of the angle between the tool's axis and `tool_x`, below which these count as parallel."""


@dataclass(frozen=True, eq=False)
class _Frames:
    """Poses of k different frames, and the index of each target's frame."""

    poses: FloatArray  # (k, 4, 4) [m]
    of_target: IndexArray  # (t,) row of `poses` for each target

    def select(self, targets: IndexArray) -> FloatArray:
        """Return the frames (m, 4, 4) [m] of m targets, given the indices of the targets."""
        return np.asarray(self.poses[self.of_target[targets]])

    def select_inverse(self, targets: IndexArray) -> FloatArray:
        """Return the inverses (m, 4, 4) [m] of the frames of m targets, given the indices of the targets.

        A pose has a rotation R (3, 3) and an origin p (3,). Its inverse has the rotation Rᵀ and the origin
        −Rᵀ p.
        """
        rotations, origins = self.poses[:, :3, :3], self.poses[:, :3, 3:]  # (k, 3, 3), (k, 3, 1)
        inverse_rotations = rotations.transpose(0, 2, 1)
        inverse_origins = -(inverse_rotations @ origins)[:, :, 0]
        inverses = np.tile(np.eye(4), (len(self.poses), 1, 1))
        inverses[:, :3, :3] = inverse_rotations
        inverses[:, :3, 3] = inverse_origins
        return np.asarray(inverses[self.of_target[targets]])


@dataclass(frozen=True, eq=False)
class ProgramFrames:
    """Tool frame and base frame of each target of a program."""

    tool: _Frames  # in the model's flange frame
    base: _Frames  # in R0
    # (3,) direction in the base, to which the tools' x axes are turned as close as possible; None if the
    # request has none
    x_axis: FloatArray | None

    @classmethod
    def from_program(cls, program: Program, options: CorrectionOptions) -> ProgramFrames:
        """Find the poses of all tool and base frames that a program uses, in the program or in the options.

        Bases are relative to `world` of the options, tools to `flange`: both are the identity if the options
        do not state them.

        Raises:
            RequestError: a frame has no numbers, has two sets of numbers, or is not in the program; or its
                numbers do not form a pose.
        """
        notation, targets = choose_frame_notation(program), program.targets
        world = _read_stated_pose(notation, options.world, "world")
        flange = _read_stated_pose(notation, options.flange, "flange")
        stated_tools = _StatedFrames.read(notation, options.tools, "tools")
        tools = _find_target_frames(flange, stated_tools, targets.frames, targets.tool)
        stated_bases = _StatedFrames.read(notation, options.bases, "bases")
        bases = _find_target_frames(world, stated_bases, targets.frames, _find_needed_bases(program, options))
        tool_x = None if options.tool_x is None else np.array(options.tool_x)
        return cls(tools, bases, tool_x)

    def flange_poses(
        self, program: Program, indices: IndexArray, values: FloatArray | None = None
    ) -> FloatArray:
        """Return poses (m, 4, 4) of the flange in R0 [m] for m targets; NaN for targets in joint angles.

        The pose is base in R0, times tool in base (the numbers of the target), times flange in tool.

        Args:
            program: the program.
            indices: (m,) indices of targets.
            values: (m, 7) numbers of the targets, as the program writes them; None for the program's own.

        Raises:
            RequestError: neither the targets nor the request have an angle about the tool's axis.
        """
        flange_in_r0 = np.empty((len(indices), 4, 4))
        for start in range(0, len(indices), BLOCK):
            block = slice(start, start + BLOCK)
            targets = indices[block]
            written = program.targets.values[targets] if values is None else values[block]
            tool_in_base = self._find_tool_poses(program, targets, written)
            base_in_r0, flange_in_tool = self.base.select(targets), self.tool.select_inverse(targets)
            flange_in_r0[block] = base_in_r0 @ tool_in_base @ flange_in_tool
        return flange_in_r0

    def _find_tool_poses(self, program: Program, targets: IndexArray, written: FloatArray) -> FloatArray:
        """Return the poses (m, 4, 4) [m], tool in base, that targets state; NaN for joint angles.

        Args:
            program: the program, which has a notation, the meaning of the numbers, for each target.
            targets: (m,) indices of the targets.
            written: (m, 7) numbers of the targets, as the program writes them.

        Raises:
            RequestError: neither the targets nor the request have an angle about the tool's axis.
        """
        tool_in_base = np.full((len(targets), 4, 4), np.nan)
        for notation, rows in program.targets.group_by_notation(targets):
            position_and_orientation = written[rows, : 3 + notation.count]
            if notation.has_pose:
                tool_in_base[rows] = notation.to_poses(position_and_orientation)
            elif not notation.is_joints:  # a position, and perhaps the direction of the tool's axis
                tool_in_base[rows] = self._poses_from_axis(notation, position_and_orientation)
        return tool_in_base

    def find_flange_poses(
        self, program: Program, indices: IndexArray, robot: Robot, joints: FloatArray
    ) -> FloatArray:
        """Return poses (m, 4, 4) of the flange in R0 [m] for m targets, those in joint angles included.

        Args:
            program: the program, whose numbers are the poses, without the rounding of a posture.
            indices: (m,) indices of targets.
            robot: n joints.
            joints: (m, n) postures, as the controller shows them [rad or m]; only those of targets in joint
                angles are used.
        """
        poses = self.flange_poses(program, indices)
        is_joint_target = program.targets.given_as_joints[indices]
        if is_joint_target.any():
            angles = robot.joint_map.model_angles(joints[is_joint_target])
            poses[is_joint_target] = flange_poses(robot, angles)
        return poses

    def positions(self, program: Program, indices: IndexArray) -> FloatArray:
        """Return positions (m, 3) in R0 [m] of m targets, by index; rows of joint targets are meaningless."""
        targets = program.targets
        length_units = np.array([notation.length for notation in targets.notations])  # [m]
        unit_of_target = length_units[targets.notation[indices]]
        in_base = unit_of_target[:, None] * targets.values[indices, :3]
        base_in_r0 = self.base.select(indices)
        rotations, origins = base_in_r0[:, :3, :3], base_in_r0[:, :3, 3]
        return _rotate(rotations, in_base) + origins

    def convert_poses_to_numbers(
        self, program: Program, indices: IndexArray, flange: FloatArray
    ) -> FloatArray:
        """Convert poses of the flange to the numbers by which the program writes its targets.

        The targets of a program may be written in different ways: as a pose (position, and angles or a
        quaternion), as a position with or without the direction of the tool's axis, or as joint angles.
        Angles that differ by 360° mean the same pose: the numbers nearest to the program's numbers are
        returned.

        Args:
            program: the program.
            indices: (m,) indices of the targets.
            flange: (m, 4, 4) poses of the flange in R0 [m].

        Returns:
            (m, 7) numbers; NaN behind the last number of a target, and in all columns of one in joint angles,
            which no pose determines.
        """
        tool_in_base = self.base.select_inverse(indices) @ flange @ self.tool.select(indices)
        numbers = np.full((len(indices), NUMBERS), np.nan)
        for notation, rows in program.targets.group_by_notation(indices):
            count = 0 if notation.is_joints else 3 + notation.count  # of position and orientation
            programmed = program.targets.values[indices[rows], :count]
            if notation.has_pose:
                numbers[rows, :count] = notation.from_poses(tool_in_base[rows], programmed)
            elif not notation.is_joints:
                numbers[rows, :count] = _convert_poses_to_axis(notation, tool_in_base[rows], programmed)
        return numbers

    def _poses_from_axis(self, notation: Notation, numbers: FloatArray) -> FloatArray:
        """Return poses (m, 4, 4) [m], tool in base, of targets without an angle about the tool's axis.

        The z axis of a pose points from spindle to tip. Its x axis is the direction `x_axis` of the request,
        turned until it is perpendicular to z; its y axis is z × x.

        Args:
            notation: meaning of the numbers: a position, and perhaps the direction of the tool's axis.
            numbers: (m, 3 or 6) numbers of the targets. Without a direction, the tool points down.

        Raises:
            RequestError: `x_axis` is missing, or parallel to a tool axis.
        """
        if self.x_axis is None:
            raise RequestError(
                "the program gives the direction of the tool's axis, but no angle of the tool about this "
                "axis",
                where="tool_x",
                remedy="give `tool_x`, the direction of the tool's x axis in the base",
            )
        z_axis = _find_spindle_to_tip(notation, numbers)
        x_axis = _find_perpendicular(self.x_axis, z_axis)
        poses = np.tile(np.eye(4), (len(numbers), 1, 1))
        poses[:, :3, 0] = x_axis
        poses[:, :3, 1] = np.cross(z_axis, x_axis)
        poses[:, :3, 2] = z_axis
        poses[:, :3, 3] = numbers[:, :3] * notation.length
        return poses


def _find_spindle_to_tip(notation: Notation, numbers: FloatArray) -> FloatArray:
    """Return unit vectors (m, 3) along the tool's axis at m targets, from spindle to tip.

    Args:
        notation: meaning of the numbers.
        numbers: (m, 3 or 6) position, and perhaps the direction from tip to spindle. Without a direction,
            the tool points down.
    """
    tip_to_spindle = np.tile([0.0, 0.0, 1.0], (len(numbers), 1))
    if notation.orientation is Orientation.TOOL_AXIS:
        tip_to_spindle = numbers[:, 3:]
    return np.asarray(-tip_to_spindle / np.linalg.norm(tip_to_spindle, axis=1, keepdims=True))


def _find_perpendicular(direction: FloatArray, z_axis: FloatArray) -> FloatArray:
    """Return the unit vectors (m, 3) perpendicular to m axes that are nearest to a direction (3,).

    For a unit axis z and a direction d, the vector is d − (d · z) z, divided by its length.

    Args:
        direction: (3,) option `tool_x` of the request.
        z_axis: (m, 3) unit vectors of the tools' axes.

    Raises:
        RequestError: the direction is parallel to an axis.
    """
    part_along_z = (z_axis @ direction)[:, None] * z_axis
    part_across_z = direction - part_along_z
    length = np.linalg.norm(part_across_z, axis=1, keepdims=True)
    is_parallel = ~(length > _LEAST_SINE * np.linalg.norm(direction))
    if is_parallel.any():
        raise RequestError(
            "`tool_x` is parallel to the tool's axis", where="tool_x", remedy="give another direction"
        )
    return np.asarray(part_across_z / length)


def _rotate(rotations: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return m vectors (m, 3), each multiplied by its rotation matrix of `rotations` (m, 3, 3)."""
    return np.asarray((rotations @ vectors[:, :, None])[:, :, 0])


def _convert_poses_to_axis(notation: Notation, poses: FloatArray, programmed: FloatArray) -> FloatArray:
    """Convert poses of the tool to a position, and a direction of the tool's axis if the notation has one.

    Args:
        notation: meaning of the numbers.
        poses: (m, 4, 4) tool in base [m].
        programmed: (m, 3 or 6) numbers of the program: position, and direction from tip to spindle. The new
            direction has the length of the programmed one.

    Returns:
        (m, 3 or 6) numbers of the poses.
    """
    numbers = programmed.copy()
    numbers[:, :3] = poses[:, :3, 3] / notation.length
    axis_length = np.linalg.norm(programmed[:, 3:], axis=1, keepdims=True)
    spindle_to_tip = poses[:, :3, 2]
    numbers[:, 3:] = -axis_length * spindle_to_tip[:, : notation.count]
    return numbers


def _find_needed_bases(program: Program, options: CorrectionOptions) -> IndexArray:
    """Return the index (t,) of each target's base in the frames of a program; `_NO_FRAME` if it needs none.

    A target in joint angles does not need its base, unless loads are stated along the axes of the base: its
    base may then have no numbers.
    """
    targets = program.targets
    if options.axes == "base":
        return targets.base
    return np.where(targets.given_as_joints, _NO_FRAME, targets.base)


def _find_target_frames(
    reference: FloatArray, stated: _StatedFrames, frames: Sequence[FrameName], frame_of_target: IndexArray
) -> _Frames:
    """Return the tool or base frames of all targets, with numbers of the program or of the request.

    A program may name a frame, such as BASE_DATA[1], whose numbers only the controller has. The request then
    has to state these numbers, and only these.

    Args:
        reference: (4, 4) pose [m] to which the frames are relative: world in R0, or the controller's flange.
        stated: frames with numbers in the request.
        frames: frames that the program names.
        frame_of_target: (t,) index of each target's frame in `frames`; `_NO_FRAME` for `reference` itself.

    Raises:
        RequestError: a frame has no numbers, has two sets of numbers, or is not in the program.
    """
    # One pose more than frames: `reference` is the last one, where the index `_NO_FRAME` (−1) finds it.
    poses = np.tile(reference, (len(frames) + 1, 1, 1))
    used = np.unique(frame_of_target[frame_of_target != _NO_FRAME]).tolist()
    for index in used:
        poses[index] = reference @ stated.find_pose(frames[index])
    stated.refuse_unused([frames[index] for index in used])
    return _Frames(poses, frame_of_target)


@dataclass(frozen=True, eq=False)
class _StatedFrames:
    """Tool or base frames with numbers in the request, for frames of a program without numbers."""

    field: str  # field of the request, `tools` or `bases`, for errors
    names: Sequence[str | None]  # name of each frame; None for a frame that suits any name
    # (4, 4) [m] pose of each frame by its name in capitals, because most controllers ignore case
    poses: Mapping[str | None, FloatArray]

    @classmethod
    def read(cls, notation: Notation, frames: Sequence[ProgramFrame], field: str) -> _StatedFrames:
        """Read the frames of a field of the request; `notation` is the meaning of their numbers.

        Raises:
            RequestError: two frames have the same name or none, or numbers do not form a pose.
        """
        poses: dict[str | None, FloatArray] = {}
        for i, frame in enumerate(frames):
            name = _fold_name(frame.name)
            if name in poses:
                raise RequestError(
                    "two frames have the same name, or two frames have no name",
                    where=f"{field}[{i}].name",
                    remedy="give each frame only once",
                )
            poses[name] = _read_stated_pose(notation, frame.values, f"{field}[{i}].values")
        return cls(field, [frame.name for frame in frames], poses)

    def find_pose(self, frame: FrameName) -> FloatArray:
        """Return the pose (4, 4) [m] of a frame of the program: by the program, or else by the request.

        Raises:
            RequestError: neither of them has its numbers, or both of them.
        """
        if frame.pose is None:
            return self.poses[self._find_name(frame)]
        self._refuse_second_numbers(frame)
        return frame.pose

    def _find_name(self, frame: FrameName) -> str | None:
        """Return the name in `poses` under which the request states the numbers of a frame of the program.

        A pose with the name of the frame comes first. A pose without a name, which is None, suits any frame.

        Raises:
            RequestError: the request has no pose for the frame.
        """
        name = _fold_name(frame.name)
        if name in self.poses:
            return name
        if None in self.poses:
            return None
        raise RequestError(
            f"the program uses the frame {quote_text(frame.name)}, but does not define its numbers",
            where=self.field,
            remedy=f"give the name {frame.name!r} and the numbers in `{self.field}`",
        )

    def _refuse_second_numbers(self, frame: FrameName) -> None:
        """Refuse a request that states the numbers of a frame which the program itself defines.

        Raises:
            RequestError: the request has a frame of this name; the error has its index.
        """
        for i, name in enumerate(self.names):
            if _fold_name(name) == _fold_name(frame.name):
                reason = f"the program itself defines the numbers of the frame {quote_text(frame.name)}"
                raise RequestError(reason, where=f"{self.field}[{i}].name", remedy="omit this frame")

    def refuse_unused(self, used: Sequence[FrameName]) -> None:
        """Refuse a frame of the request that the program does not use, because its name may be misspelt.

        `used` are the frames that the program uses.

        Raises:
            RequestError: there is such a frame.
        """
        used_names = {self._find_name(frame) for frame in used if frame.pose is None}
        for i, name in enumerate(self.names):
            if _fold_name(name) in used_names:
                continue
            if name is None:
                reason = "a frame without name is not used, because every frame of the program has numbers"
            else:
                reason = f"the program does not use the frame {quote_text(name)}"
            remedy = "omit this frame, or correct its name"
            raise RequestError(reason, where=f"{self.field}[{i}].name", remedy=remedy)


def _fold_name(name: str | None) -> str | None:
    """Return the name of a frame in capitals, because most controllers ignore case."""
    return None if name is None else name.upper()


def _read_stated_pose(notation: Notation, values: Sequence[float] | None, field: str) -> FloatArray:
    """Return the pose (4, 4) [m] of a frame from its numbers in the request; the identity without numbers.

    Args:
        notation: how the program writes the numbers of frames.
        values: position, then orientation, in the program's units; None for no numbers.
        field: field of the request, for errors.

    Raises:
        RequestError: the numbers do not form a pose.
    """
    if values is None:
        return np.eye(4)
    count = 3 + notation.count  # of the numbers of a position and an orientation
    if len(values) != count or not notation.is_valid_orientation(np.array(values)):
        raise RequestError(
            f"a frame needs {count} numbers that form a pose",
            where=field,
            remedy=f"give the position, then {notation.orientation.value}, in the program's units",
        )
    return notation.to_pose(values)


_NEAR: Final = 1e-4
"""Distance of an angle from the limit of its range [rad] that rounded numbers in the program can cause."""
_ROUNDING: Final = 1e-8
"""Distance of an angle beyond the limit of its range [rad] that is a rounding error of the computation."""
_MOST: Final = 1e9
"""Magnitude beyond which a number cannot be a configuration word."""


@dataclass(frozen=True, slots=True)
class _Word:
    """Statement of a configuration's number, such as KUKA's S or ABB's cf1, about one joint of the arm.

    The number allows the joint a range of angles. A number with sign bits states the ranges of several
    joints, and has a word for each of them.
    """

    joint: int  # index of the joint
    kind: Literal["sign", "quadrant", "turn"]  # the number has sign bits, or counts quarter or whole turns
    bit: int | None = None  # bit of the number that is 1 for angles below zero; None for the whole number

    def ranges(self, numbers: FloatArray) -> FloatArray:
        """Return the least and greatest joint angle (m, 2) [rad] that numbers of a configuration allow.

        `numbers` (m,) are those that m targets state for this word of the configuration: bits of signs,
        quadrants, or full turns. Any angle is allowed where the number is NaN.
        """
        if self.bit is not None:  # the bit is set if the angle is negative
            is_negative = np.nan_to_num(numbers).astype(np.int64) >> self.bit & 1
            least = np.where(is_negative, -np.inf, 0.0)
            greatest = np.where(is_negative, 0.0, np.inf)
        elif self.kind == "quadrant":  # quadrant 0 is from 0° to 90°
            least = np.pi / 2 * numbers
            greatest = np.pi / 2 * (numbers + 1)
        else:  # turn 0 is from −180° to 180°
            least = 2 * np.pi * numbers - np.pi
            greatest = 2 * np.pi * numbers + np.pi
        is_unknown = np.isnan(numbers)
        least[is_unknown], greatest[is_unknown] = -np.inf, np.inf
        return np.stack([least, greatest], axis=1)

    def find_wrong_numbers(self, numbers: FloatArray, before: FloatArray, after: FloatArray) -> BoolArray:
        """Return a mask (m,) of the numbers that agree with the angle before a correction, but not after it.

        The number 0 of a quadrant, from 0° to 90°, is wrong if a correction turns the joint from 89.9° to
        90.1°. Angles just beyond the range agree: by the rounding of numbers before a correction, by that of
        the computation after it.

        Args:
            numbers: (m,) numbers that m targets state for this word of the configuration; NaN without one.
            before: (m,) angles of the joint before the correction [rad].
            after: (m,) angles of the joint after the correction [rad].
        """
        least, greatest = self.ranges(numbers).T
        agreed_before = (least - _NEAR <= before) & (before <= greatest + _NEAR)
        disagrees_after = (after < least - _ROUNDING) | (after > greatest + _ROUNDING)
        return np.asarray(agreed_before & disagrees_after & np.isfinite(numbers))

    def update_number(self, number: int, angle: float) -> int:
        """Return the number of the configuration that allows an angle [rad].

        The number is a quadrant (0 from 0° to 90°), a turn (0 from −180° to 180°), or has a bit that is 1 for
        an angle below zero. In the last case, bits of `number` for other joints are kept.
        """
        if self.bit is not None:
            mask = 1 << self.bit
            return number | mask if angle < 0.0 else number & ~mask
        if self.kind == "quadrant":
            return int(np.floor(2 * angle / np.pi))
        return int(np.ceil(angle / (2 * np.pi) - 0.5))


class _StatedWord(NamedTuple):
    """A word of the configuration, and some targets that state it."""

    word: _Word
    column: int  # column of the word's number among the numbers of a target
    positions: IndexArray  # (k,) positions of the targets in the list of indices that was given


class _NumberPlace(NamedTuple):
    """A number of a target."""

    target: int  # index of the target
    column: int  # column of the number among the numbers of a target


# KUKA's S and T, FANUC's turns, and ABB's cf1, cf4, cf6 and cfx, by the names that the notations use.
# Bit 2 of KUKA's S is 1 where A5 is below zero (reversed beyond half a turn, which no wrist reaches).
_WORDS: Final = {
    "T": tuple(_Word(joint, "sign", joint) for joint in range(6)),
    "S": (_Word(4, "sign", 2),),
    "cfx": (_Word(4, "sign", 0),),
    **{f"cf{joint + 1}": (_Word(joint, "quadrant"),) for joint in (0, 3, 5)},
    **{f"turn{joint + 1}": (_Word(joint, "turn"),) for joint in (0, 3, 5)},
}
_BINARY_NUMBER: Final = re.compile(r"(?P<beginning>'.\s*)(?P<digits>.*)'", re.DOTALL)
"""Number in binary digits, as KUKA writes it: 'B010' or 'B 010'."""
_FREE_RAPID: Final = re.compile(r"\bConfJ\s*+\\\s*+Off\b", re.IGNORECASE)


class StatedConfigurations:
    """The arm configurations that the targets of a program state, as ranges of joint angles."""

    def __init__(self, program: Program) -> None:
        r"""Find whether joint moves of a program end in the configuration that their targets state.

        They do, except in a program of ABB with `ConfJ \Off`.
        """
        self._program = program
        is_free = any(_FREE_RAPID.search(source.text) for source in program.sources)
        self.binds_joint_moves = not (program.format == "rapid" and is_free)

    def ranges(self, indices: Sequence[int] | IndexArray) -> FloatArray:
        """Return the least and greatest angle (m, 6, 2) [rad] of each joint that configurations allow.

        Angles are the controller's; limits are ∓inf for a joint without stated configuration.

        Args:
            indices: m indices of targets. Each configuration has words, such as the sign or the turn of one
                joint; where a joint has several words, their ranges intersect.
        """
        targets = np.asarray(indices, dtype=np.intp)
        least, greatest = np.full((len(targets), 6), -np.inf), np.full((len(targets), 6), np.inf)
        for word, column, positions in self._iterate_words(targets):
            numbers = self._word_numbers(targets[positions], column)
            least_of_word, greatest_of_word = word.ranges(numbers).T
            cells = (positions, word.joint)
            least[cells] = np.maximum(least[cells], least_of_word)
            greatest[cells] = np.minimum(greatest[cells], greatest_of_word)
        return np.stack([least, greatest], axis=2)

    def list_word_edits(
        self, indices: IndexArray, programmed: FloatArray, corrected: FloatArray
    ) -> list[tuple[int, Edit]]:
        """Return (target index, edit) for each configuration number that a correction makes wrong.

        The number cf1 of ABB, for example, states the quarter turn in which joint 1 is: 0 from 0° to 90°. If
        a correction turns joint 1 from 89.9° to 90.1°, its cf1 has to become 1. A number is changed if it
        agreed with the joint's angle before the correction, but does not after.

        Args:
            indices: (m,) indices of targets.
            programmed: (m, 6) controller's angles before the correction [rad].
            corrected: (m, 6) controller's angles after the correction [rad].
        """
        new_numbers: dict[_NumberPlace, int] = {}
        for word, column, positions in self._iterate_words(indices):
            targets = indices[positions]
            numbers = self._word_numbers(targets, column)
            before, after = programmed[positions, word.joint], corrected[positions, word.joint]
            is_wrong = word.find_wrong_numbers(numbers, before, after)
            for k in np.flatnonzero(is_wrong).tolist():
                place = _NumberPlace(int(targets[k]), column)
                # A number with sign bits has several joints: earlier changes of other bits are kept.
                number = new_numbers.get(place, int(numbers[k]))
                new_numbers[place] = word.update_number(number, float(after[k]))
        return [(place.target, self._edit_number(place, number)) for place, number in new_numbers.items()]

    def _edit_number(self, place: _NumberPlace, number: int) -> Edit:
        """Return the edit (start, end, text) of the source for a new number of the configuration.

        A number in binary digits, such as KUKA's 'B010', keeps its form.

        Args:
            place: target and column of the number.
            number: new number.
        """
        targets = self._program.targets
        start, end = targets.spans[place.target, place.column].tolist()
        text = self._program.sources[targets.source[place.target]].text[start:end]
        binary = _BINARY_NUMBER.fullmatch(text)
        if binary is None:
            return start, end, str(number)
        digits = f"{number:b}".zfill(len(binary["digits"]))
        return start, end, f"{binary['beginning']}{digits}'"

    def _iterate_words(self, indices: IndexArray) -> Iterator[_StatedWord]:
        """Yield each word of the configurations that some targets state, with the targets that have it.

        KUKA's `{X 1,...,S 2,T 10}` has two numbers, S and T. S states the sign of joint 5, and so has one
        word; T has six words, the sign of each joint.

        Args:
            indices: (m,) indices of targets.
        """
        targets = self._program.targets
        # Targets with the same names of configuration numbers are handled together.
        names_of_literal = [tuple(name for name, _ in literal.words) for literal in targets.literals]
        groups = list(dict.fromkeys(names_of_literal))
        group_of_literal = np.array([groups.index(names) for names in names_of_literal], np.intp)
        group_of_target = group_of_literal[targets.literal[indices]]
        for group, names in enumerate(groups):
            positions = np.flatnonzero(group_of_target == group)
            for column, name in enumerate(names, start=NUMBERS):
                for word in _WORDS[name]:
                    yield _StatedWord(word, column, positions)

    def _word_numbers(self, indices: IndexArray, column: int) -> FloatArray:
        """Return the configuration numbers (m,) in a column of the numbers of m targets, given by index.

        A number that cannot be one of the configuration, because it is a fraction or too great, is NaN.
        """
        numbers = self._program.targets.values[indices, column]
        is_whole = numbers == np.round(numbers)
        is_in_range = np.abs(numbers) < _MOST
        return np.where(is_whole & is_in_range, numbers, np.nan)


_EQUAL_POSTURES: Final = 1e-6
"""Greatest difference of joint angles with which two postures count as equal [rad]."""
_REASONS: Final = {
    Unreached.OUT_OF_REACH: (
        "the robot does not reach this target",
        "check tool, base, `world` and `flange`",
    ),
    Unreached.OUT_OF_LIMITS: (
        "the posture at this target is outside of the joints' limits",
        "check tool, base, `start`, and the limits of the robot's model",
    ),
    Unreached.NOT_AS_STATED: (
        "no posture within the joints' limits has the arm configuration that the program states",
        "check tool and base, and that the joint map gives the controller's angles",
    ),
    Unreached.NOT_FOLLOWED: (
        "the arm is so near a singularity that the configuration of the arm is ambiguous",
        "move the part away from the singularity, or write the target as joint angles",
    ),
    Unreached.AMBIGUOUS: (
        "the program does not state the arm's configuration at this target",
        "give `start`: the controller's angles near this target",
    ),
}


@dataclass(frozen=True, eq=False)
class ProgramPath:
    """Path of a program: the m targets that moves visit, in order of their first visits."""

    program: Program  # program that was read
    frames: ProgramFrames  # tool and base frames of the targets
    stated: StatedConfigurations  # arm configurations that the targets state
    targets: IndexArray  # (m,) indices of the program's targets
    cases: LoadCases  # wanted postures and their loads; `place` is the tool's centre point

    def make_fault(self, point: int, reason: str, remedy: str) -> Fault:
        """Return a fault at a point of the path, given by index, to be raised in a `FaultsError`."""
        return _make_fault(self.program, int(self.targets[point]), reason, remedy)


@dataclass(frozen=True, eq=False)
class Visits:
    """All v visits of targets by moves, in the order of the program, and the loads of the visits.

    A visit is the arrival of a move at a target. Several moves may visit one target. If the moves visit the
    targets 7, 3, 7 and 5, then `targets` are 7, 3, 7, 5; `order` is 7, 3, 5, each target once; `number` is
    0, 1, 0, 2, the place of each visit's target in `order`; and `first` is 0, 1, 3.
    """

    targets: IndexArray  # (v,) index of the target at each visit
    order: IndexArray  # (m,) indices of the visited targets, each once, in order of their first visits
    number: IndexArray  # (v,) index in `order` of each visit's target
    first: IndexArray  # (m,) index of the first visit of each target in `order`
    continuous: BoolArray  # (v,) mask of visits that are reached from the visit before along a line or an arc
    middles: BoolArray  # (v,) mask of visits between start and end of an arc
    loads: Loads  # loads of the visits
    # (k,) indices in `order` of the targets under load; all of them if the robot's own weight is a load, too
    loaded: IndexArray

    @classmethod
    def collect(
        cls,
        program: Program,
        options: CorrectionOptions,
        table: bytes | None,
        measure_lengths: Callable[[], FloatArray],
    ) -> Visits:
        """Collect the visits of a program's targets, with loads from the options or from a CSV table.

        Args:
            program: the program.
            options: options with frames and loads.
            table: content of the table of loads; None if the loads are in the options.
            measure_lengths: function that returns the lengths of the path, as `measure_lengths` does.

        Raises:
            RequestError: no move is under load, or a load does not fit the program.
            FaultsError: the program has no move, or a target has two loads.
        """
        _refuse_program_without_moves(program)
        points = _number_points(program.moves.visits)
        loads = _collect_loads_of_points(program, options, table, points, measure_lengths)
        _refuse_program_without_load(loads, options)
        _refuse_second_loads(program, points, loads)
        is_loaded_point = loads.of_visit[points.first_visits] > 0
        return cls(
            targets=program.moves.visits,
            order=points.targets,
            number=points.of_visit,
            first=points.first_visits,
            continuous=_find_continuous_visits(program),
            middles=program.moves.is_middle_of_arc,
            loads=loads,
            loaded=np.flatnonzero(is_loaded_point | options.absolute),
        )


class _Points(NamedTuple):
    """The m points of a path: the visited targets, each once, numbered in order of their first visits."""

    targets: IndexArray  # (m,) index of each point's target
    first_visits: IndexArray  # (m,) index of the first visit of each point
    of_visit: IndexArray  # (v,) number from 0 of the point at each visit


def _number_points(visits: IndexArray) -> _Points:
    """Number the targets that moves visit, in order of their first visits.

    Visits of the targets 7, 3, 7 and 5 give the points 0, 1, 0 and 2.

    Args:
        visits: (v,) index of the target at each visit.
    """
    targets, first_visits, place_of_visit = np.unique(visits, return_index=True, return_inverse=True)
    # `targets` are in order of their indices: renumber them in order of their first visits.
    order = np.argsort(first_visits)
    number_of_place = np.empty_like(order)
    number_of_place[order] = np.arange(len(order))
    return _Points(targets[order], first_visits[order], number_of_place[place_of_visit])


def _collect_loads_of_points(
    program: Program,
    options: CorrectionOptions,
    table: bytes | None,
    points: _Points,
    measure_lengths: Callable[[], FloatArray],
) -> Loads:
    """Return the load at each visit of a target, from a table of loads or from the options.

    Args:
        program: the program.
        options: options with loads.
        table: content of the table of loads, which may name points; None if the loads are in the options.
        points: visited targets.
        measure_lengths: function that returns the lengths of the path, as `measure_lengths` does.

    Raises:
        RequestError: a load does not fit the program.
    """
    names = [program.targets.names[i] for i in points.targets.tolist()] if table is not None else ()
    line_of_visit = program.moves.line[program.moves.move_of_visit]
    number_of_visit = points.of_visit + 1  # users count points from 1
    return collect_loads(
        options, table, line_of_visit, number_of_visit, names, measure_lengths, program.common_names
    )


def _find_continuous_visits(program: Program) -> BoolArray:
    """Return a mask (v,) of the visits that are reached from the visit before along a line or an arc."""
    is_continuous = ~program.moves.is_visit_of_joint_move
    is_continuous[0] = False  # no visit is before the first one
    return is_continuous


def _refuse_program_without_moves(program: Program) -> None:
    """Refuse a program that visits no target.

    Raises:
        FaultsError: the program has no move.
    """
    if len(program.moves.visits) == 0:
        file = program.sources[0].name
        raise FaultsError([Fault(file, None, "the program has no move", "send a program with moves")])


def _refuse_second_loads(program: Program, points: _Points, loads: Loads) -> None:
    """Refuse targets that moves visit under different loads: one correction cannot suit both.

    Raises:
        FaultsError: the load at a visit differs from that at the first visit of the target.
    """
    load_of_point = loads.of_visit[points.first_visits]
    has_other_load = loads.of_visit != load_of_point[points.of_visit]
    reason = "moves visit this target under two different loads"
    remedy = "use a separate target for each load"
    _refuse_targets(program, program.moves.visits[has_other_load], reason, remedy)


def _refuse_program_without_load(loads: Loads, options: CorrectionOptions) -> None:
    """Refuse a program without a load at any move; with `absolute`, the arm's own weight is a load.

    Raises:
        RequestError: no load is stated, or no move is under load.
    """
    if loads.of_visit.any() or options.absolute:
        return
    if not (options.force or options.segments or options.loads or options.cut):
        raise RequestError(
            "the load is missing",
            where="force",
            remedy="state the load of the process: one of `force`, `segments`, `loads` and `cut`",
        )
    raise RequestError(
        "no move is under load",
        where="segments" if options.force is None else "force",
        remedy="give loads for lines that contain moves, or for points that moves visit",
    )


def measure_lengths(
    program: Program, options: CorrectionOptions, robot: Robot, inverse: InverseKinematics
) -> FloatArray:
    """Return the length (v,) of lines and arcs up to each visit of a target [m]; joint moves add nothing.

    An arc has the length of the chords between its targets.

    Args:
        program: the program.
        options: options with the numbers of frames that the program does not give.
        robot: robot whose forward kinematics give the tool's centre at targets in joint angles.
        inverse: kinematics that know the arm's joints and the positions of all other joints of the robot.

    Raises:
        RequestError: a frame of the program has no numbers.
    """
    frames = ProgramFrames.from_program(program, options)
    visits = program.moves.visits
    tool_centres = frames.positions(program, visits)  # in R0; meaningless for targets in joint angles
    is_joint_target = program.targets.given_as_joints[visits]
    if is_joint_target.any():
        all_joints = inverse.insert_held_joints(_read_arm_angles(program, visits[is_joint_target]))
        flange_in_r0 = flange_poses(robot, robot.joint_map.model_angles(all_joints))
        tool_in_r0 = flange_in_r0 @ frames.tool.select(visits[is_joint_target])
        tool_centres[is_joint_target] = tool_in_r0[:, :3, 3]
    steps = np.linalg.norm(np.diff(tool_centres, axis=0), axis=1)
    steps[program.moves.is_visit_of_joint_move[1:]] = 0.0
    return np.append(0.0, np.cumsum(steps))


def _read_arm_angles(program: Program, targets: IndexArray) -> FloatArray:
    """Return the first six numbers of targets, by index, as joint angles (m, 6) of the controller [rad]."""
    angle_unit = program.targets.angle_unit[targets, None]
    return np.asarray(program.targets.values[targets, :6] * angle_unit)


def find_path(
    program: Program, options: CorrectionOptions, robot: Robot, inverse: InverseKinematics, visits: Visits
) -> ProgramPath:
    """Find the programmed posture and the load of each visited target, and return the path.

    Raises:
        RequestError: a field of the request is missing, or does not fit the program.
        FaultsError: the robot does not reach targets, or their arm configurations are ambiguous.
    """
    frames = ProgramFrames.from_program(program, options)
    configurations = StatedConfigurations(program)
    joints = find_wanted_postures(program, options, frames, configurations, robot, inverse, visits.targets)
    _refuse_different_postures(program, visits, joints)
    with as_request_errors("program"):
        # The feed follows the visits, so the poses of all visits are needed.
        poses = frames.find_flange_poses(program, visits.targets, robot, joints)
        axes = find_load_axes(options, frames, visits, poses)
        force, moment = turn_loads_to_base(options, axes, visits.loads.at_visits(visits.first))
        load_point, place = find_load_points(options, frames, visits.order)
        cases = LoadCases(joints[visits.first], force, moment, load_point, place)
    return ProgramPath(program, frames, configurations, visits.order, cases)


def _refuse_different_postures(program: Program, visits: Visits, joints: FloatArray) -> None:
    """Refuse targets that moves reach in different postures; angles that differ by whole turns are the same.

    Args:
        program: the program.
        visits: visits of the targets.
        joints: (v, n) posture at each visit [rad or m].

    Raises:
        FaultsError: the posture at a visit differs from that at the first visit of the target.
    """
    turn = 2 * np.pi
    postures_of_first_visit = joints[visits.first][visits.number]
    difference = joints - postures_of_first_visit
    whole_turns = turn * np.round(difference / turn)
    greatest_difference = np.abs(difference - whole_turns).max(axis=1)
    is_different = greatest_difference > _EQUAL_POSTURES
    reason = "moves reach this target in two different configurations of the arm"
    remedy = "use a separate target for each configuration"
    _refuse_targets(program, visits.targets[is_different], reason, remedy)


def _refuse_targets(program: Program, targets: IndexArray, reason: str, remedy: str) -> None:
    """Raise a `FaultsError` with a fault for each target, given by index; do nothing without targets."""
    if len(targets):
        raise FaultsError([_make_fault(program, int(i), reason, remedy) for i in np.unique(targets)])


def _make_fault(program: Program, target: int, reason: str, remedy: str) -> Fault:
    """Return a fault at a target, with its file, line and name; `target` is the index of the target."""
    targets = program.targets
    file = program.sources[targets.source[target]].name
    line = int(targets.line[target])
    name = targets.names[target]
    named_reason = f"{quote_text(name)}: {reason}" if name else reason
    return Fault(file, line, named_reason, remedy)


def find_wanted_postures(
    program: Program,
    options: CorrectionOptions,
    frames: ProgramFrames,
    configurations: StatedConfigurations,
    robot: Robot,
    inverse: InverseKinematics,
    visits: IndexArray,
    start: FloatArray | None = None,
) -> FloatArray:
    """Return the programmed posture (v, n) at each visit of a target, as the controller shows it [rad or m].

    A target in joint angles states its posture. A pose can be reached in several postures: the stated
    configuration of the arm decides, or else the posture before.

    Args:
        program: program with the targets.
        options: options of the request.
        frames: tool and base frames of the targets.
        configurations: configurations of the arm that the program states.
        robot: n joints.
        inverse: kinematics of the robot.
        visits: (v,) index of the target at each visit.
        start: (n,) posture near the first target; None takes that of the options.

    Raises:
        FaultsError: a target is not reached, or its arm configuration is ambiguous.
    """
    is_joint_target = program.targets.given_as_joints[visits]
    _refuse_changed_configuration_letters(program, visits, is_joint_target)
    arm_angles = _read_arm_angles(program, visits)
    programmed_joints = np.where(is_joint_target[:, None], arm_angles, np.nan)
    poses = frames.flange_poses(program, visits)
    ranges = configurations.ranges(visits)
    takes_stated = _find_visits_in_stated_configuration(program, configurations, ranges)
    if start is None:
        start = read_start(robot, options)
    with as_request_errors("robot"):
        joints, unreached = choose_postures(inverse, poses, programmed_joints, ranges, takes_stated, start)
    _refuse_unreached_targets(program, visits, unreached)
    return joints


def _find_visits_in_stated_configuration(
    program: Program, configurations: StatedConfigurations, ranges: FloatArray
) -> BoolArray:
    """Return a mask (v,) of the visits at which the arm changes to the configuration that the target states.

    A linear move keeps the arm's configuration; a joint move takes the configuration that is stated.

    Args:
        program: the program, with v visits of targets.
        configurations: configurations of the arm that the program states.
        ranges: (v, 6, 2) least and greatest angle [rad] of each joint by the stated configuration; infinite
            without one.
    """
    states_configuration = np.isfinite(ranges).any(axis=(1, 2))
    is_joint_move = program.moves.is_visit_of_joint_move
    return is_joint_move & states_configuration & configurations.binds_joint_moves


def _refuse_unreached_targets(program: Program, visits: IndexArray, unreached: IndexArray) -> None:
    """Refuse a program with targets for which no posture was found.

    Args:
        program: the program.
        visits: (v,) index of the target at each visit.
        unreached: (v,) why no posture was found, as a value of `Unreached`; 0 where one was found.

    Raises:
        FaultsError: it has a fault for each visit of such a target.
    """
    faults = []
    for row in np.flatnonzero(unreached):
        reason, remedy = _REASONS[Unreached(unreached[row])]
        faults.append(_make_fault(program, int(visits[row]), reason, remedy))
    if faults:
        raise FaultsError(faults)


def _refuse_changed_configuration_letters(
    program: Program, visits: IndexArray, is_joint_target: BoolArray
) -> None:
    """Refuse a change of FANUC's configuration letters (N/F, U/D, T/B) between two pose targets.

    The letters do not determine joint angles, so that the posture after the change is unknown unless a
    target in joint angles lies between the two targets.

    Args:
        program: the program.
        visits: (v,) index of the target at each visit.
        is_joint_target: mask (v,) of the visits of targets in joint angles.

    Raises:
        FaultsError: the letters change at targets.
    """
    letters_of_literal = [literal.letters for literal in program.targets.literals]
    if not any(letters_of_literal):
        return
    letters = [letters_of_literal[i] for i in program.targets.literal[visits].tolist()]
    changed = _find_changed_letters(letters, is_joint_target.tolist())
    remedy = "insert a move to joint angles before this target, or split the program before this target"
    reason = "the arm changes its configuration (N/F, U/D, T/B)"
    _refuse_targets(program, visits[changed], reason, remedy)


def _find_changed_letters(letters: Sequence[str], is_joint_target: Sequence[bool]) -> list[int]:
    """Return the visits, by index, at which the letters of the configuration differ from those before.

    The letters NUT, none, NUT, FUT give the visit 3. A target in joint angles between NUT and FUT determines
    the posture itself, so that the letters before it do not count.

    Args:
        letters: letters of the target at each visit, such as `NUT`; empty without any.
        is_joint_target: whether the target at each visit is in joint angles.
    """
    changed = []
    last_letters = ""  # of the last pose target with letters since the last joint target
    for visit, (letters_here, is_joints) in enumerate(zip(letters, is_joint_target, strict=True)):
        if is_joints:
            last_letters = ""
            continue
        is_changed = letters_here and last_letters and letters_here != last_letters
        if is_changed:
            changed.append(visit)
        last_letters = letters_here or last_letters
    return changed


def find_load_points(
    options: CorrectionOptions, frames: ProgramFrames, targets: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """Return load points (m, 3) and tool centres (m, 3) of m targets in the flange frame [m].

    `targets` are indices; without a load point in the options, the load acts at the tool centre.
    """
    tool_poses = frames.tool.select(targets)
    tool_centres = tool_poses[:, :3, 3].copy()
    if options.load_point is None:
        return tool_centres.copy(), tool_centres
    length_unit = LENGTH[options.units.length]
    refuse_far_point(options.load_point, "load_point", length=length_unit)
    load_point = length_unit * np.array(options.load_point)
    return np.tile(load_point, (len(targets), 1)), tool_centres


def find_spindles(options: CorrectionOptions, frames: ProgramFrames, targets: IndexArray) -> FloatArray:
    """Return unit vectors (m, 3) from spindle to tip of m targets, given by index, flange frame.

    Raises:
        RequestError: `spindle` is the zero vector.
    """
    if options.spindle is None:
        return frames.tool.select(targets)[:, :3, 2].copy()
    axis = np.array(options.spindle)
    length = float(np.linalg.norm(axis))
    if length == 0.0:
        raise RequestError(
            "the spindle axis is the zero vector", where="spindle", remedy="give a vector that is not zero"
        )
    return np.tile(axis / length, (len(targets), 1))


def find_load_axes(
    options: CorrectionOptions, frames: ProgramFrames, visits: Visits, poses: FloatArray
) -> FloatArray:
    """Return the axes along which the options state the loads at m targets: columns (m, 3, 3), axes of R0.

    `axes` of the options chooses them: the axes of R0 ("robot"), of each target's base or tool, or feed,
    normal and spindle axis. Feed and normal are NaN where the tool does not move across its axis, as in
    drilling. A target that is visited several times has the axes of its first visit.

    Args:
        options: options with the axes of the loads.
        frames: tool and base frames of the program.
        visits: visits of the targets. For visits of the targets 7, 3, 7, the targets `order` are 7 and 3, and
            their `first` visits are 0 and 1.
        poses: (v, 4, 4) poses of the flange in R0 [m] at all visits.

    Raises:
        RequestError: `spindle` is the zero vector.
    """
    if is_along_feed(options):
        return _find_axes_along_feed(options, frames, visits, poses)
    targets = visits.order
    if options.axes == "robot":
        return np.tile(np.eye(3), (len(targets), 1, 1))
    if options.axes == "base":
        return frames.base.select(targets)[:, :3, :3]
    flange_in_r0 = poses[visits.first][:, :3, :3]
    tool_in_flange = frames.tool.select(targets)[:, :3, :3]
    return np.asarray(flange_in_r0 @ tool_in_flange)


def _find_axes_along_feed(
    options: CorrectionOptions, frames: ProgramFrames, visits: Visits, poses: FloatArray
) -> FloatArray:
    """Return feed, normal and spindle axis at m targets as columns (m, 3, 3), axes of R0.

    The feed is the direction in which the tool's centre moves through all visits. The arguments are those of
    `find_load_axes`.

    Raises:
        RequestError: `spindle` is the zero vector.
    """
    rotations, origins = poses[:, :3, :3], poses[:, :3, 3]  # of the flange in R0
    centre_in_flange = frames.tool.select(visits.targets)[:, :3, 3]
    centre_in_r0 = _rotate(rotations, centre_in_flange) + origins
    spindle_in_flange = find_spindles(options, frames, visits.targets)
    spindle_in_r0 = _rotate(rotations, spindle_in_flange)
    feed_frames = find_feed_frames(centre_in_r0, spindle_in_r0, visits.continuous, visits.middles)
    return feed_frames[visits.first]


def is_along_feed(options: CorrectionOptions) -> bool:
    """Return whether loads are stated along feed, normal and spindle axis: those of a cut always are."""
    return options.cut is not None or options.axes == "feed"


def turn_loads_to_base(
    options: CorrectionOptions, axes: FloatArray, loads: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return forces (m, 3) [N] and moments (m, 3) [N·m] of m targets along the axes of R0.

    A vector with the components l along the axes A (columns, in R0) is A l in R0.

    Args:
        options: options with the loads.
        axes: (m, 3, 3) axes of the loads, as `find_load_axes` returns them.
        loads: (m, 6) force [N] and moment [N·m] along these axes.

    Raises:
        RequestError: a load needs a direction of feed where the tool does not move across its axis.
    """
    forces, moments = loads[:, :3], loads[:, 3:]
    if is_along_feed(options):
        field = "force" if options.cut is None else "cut"
        return apply_feed_frames(axes, forces, field), apply_feed_frames(axes, moments, field)
    multiply = "tij,tj->ti"  # t: target, i: axis of R0, j: axis of the load
    return np.einsum(multiply, axes, forces), np.einsum(multiply, axes, moments)


def read_feeds(program: Program) -> FloatArray:
    """Return the feed (v,) that the program states for each visit of a target [m/s]; NaN if none."""
    return np.asarray(_FEED_UNIT * program.moves.feed[program.moves.move_of_visit])


def find_feeds(
    program: Program, options: CorrectionOptions, visits: Visits, wanted: float | None = None
) -> FloatArray:
    """Return the feed (v,) with which the tool comes to each visit of a target [m/s]; NaN if unknown.

    For each visit, the first of these feeds counts that is stated:

    1. That of the table of loads.
    2. The wanted feed, if the request has one, unless the program states a faster one, which then counts.
    3. That of the program.
    4. That of the cut.

    A joint move has no feed.

    Args:
        program: the program.
        options: options, which may have a cut with its feed.
        visits: visits of the targets, with the feeds of the table of loads.
        wanted: feed that the request states for all moves [m/s]; None without.
    """
    feed_of_program = read_feeds(program)
    feed = feed_of_program
    if wanted is not None:
        is_faster = feed_of_program > SAME_FEED * wanted
        feed = np.where(is_faster, feed_of_program, wanted)
    elif options.cut is not None:
        feed = np.where(np.isnan(feed_of_program), options.cut.feed, feed_of_program)
    feed_of_table = visits.loads.feed_at_visits()
    if feed_of_table is not None:
        feed = np.where(np.isnan(feed_of_table), feed, feed_of_table)
    return np.where(program.moves.is_visit_of_joint_move, np.nan, feed)
