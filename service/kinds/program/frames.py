"""Frames of a program: tools in the model's flange frame, bases in R0; and poses of targets in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas.program import ProgramFrame, ProgramOptions
from jointstiff.service.programs.errors import shown
from jointstiff.service.programs.formats import frame_notation
from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import BLOCK, NUMBERS, FrameName, Program
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import RequestError

_LEAST_SINE: Final = 1e-3
"""Sine of the angle between tool and x axis under which they count as parallel."""


@dataclass(frozen=True, eq=False)
class ProgramFrames:
    """Frames of each target of a program."""

    tool: FloatArray  # (t, 4, 4) in the model's flange frame [m]
    base: FloatArray  # (t, 4, 4) in R0 [m]
    # (3,) direction that the tools' x axes follow, in the base; None if it is not stated
    x_axis: FloatArray | None

    @classmethod
    def of(cls, program: Program, options: ProgramOptions) -> ProgramFrames:
        """Find the numbers of all frames.

        Raises:
            RequestError: a frame has none, has them twice, is not in the program, or is no frame.
        """
        notation = frame_notation(program)
        world = _stated(notation, options.world, "world")
        flange = _stated(notation, options.flange, "flange")
        tools = _Given(notation, options.tools, "tools")
        bases = _Given(notation, options.bases, "bases")
        targets = program.targets
        tool = _placed(flange, tools, targets.frames, targets.tool)
        unused = targets.by_joints & (options.axes != "base")
        base = _placed(world, bases, targets.frames, np.where(unused, -1, targets.base))
        for given in (tools, bases):
            given.refuse_unused()
        x_axis = None if options.tool_x is None else np.array(options.tool_x)
        return cls(tool, base, x_axis)

    def flange_poses(
        self, program: Program, indices: IndexArray, values: FloatArray | None = None
    ) -> FloatArray:
        """Return poses (m, 4, 4) of the flange in R0 [m]; NaN for joint targets.

        Args:
            program: the program.
            indices: m of its targets.
            values: (m, 7) their numbers; those of the program if None.

        Raises:
            RequestError: a target states no orientation about the tool's axis, and the request does not.
        """
        wanted = np.empty((len(indices), 4, 4))
        for start in range(0, len(indices), BLOCK):
            block = slice(start, start + BLOCK)
            own, poses = indices[block], np.full_like(wanted[block], np.nan)
            stated = program.targets.values[own] if values is None else values[block]
            for notation, rows in program.targets.by_notation(own):
                numbers = stated[rows, : 3 + notation.count]
                if notation.has_pose:
                    poses[rows] = notation.poses(numbers)
                elif not notation.is_joints:
                    poses[rows] = self._about_axis(notation, numbers)
            wanted[block] = self.base[own] @ poses @ _inverse(self.tool[own])
        return wanted

    def places(self, program: Program, indices: IndexArray) -> FloatArray:
        """Return where targets are (m, 3), in R0 [m]; numbers without meaning for joint targets."""
        length = np.array([each.length for each in program.targets.notations])
        place = length[program.targets.notation[indices], None] * program.targets.values[indices, :3]
        base = self.base[indices]
        return np.asarray((base[:, :3, :3] @ place[..., None])[..., 0] + base[:, :3, 3])

    def numbers(self, program: Program, indices: IndexArray, flange: FloatArray) -> FloatArray:
        """Return the program's numbers (m, 7) of poses (m, 4, 4) of the flange in R0 [m]; NaN behind them."""
        poses = _inverse(self.base[indices]) @ flange @ self.tool[indices]
        numbers = np.full((len(indices), NUMBERS), np.nan)
        for notation, rows in program.targets.by_notation(indices):
            near = program.targets.values[indices[rows], : 3 + notation.count]
            if notation.is_joints:
                continue
            if notation.has_pose:
                new = notation.values(poses[rows], near)
            else:
                new = near.copy()
                new[:, :3] = poses[rows, :3, 3] / notation.length
                size = np.linalg.norm(near[:, 3:], axis=1, keepdims=True)
                new[:, 3:] = -size * poses[rows, :3, 2][:, : notation.count]
            numbers[rows, : new.shape[1]] = new
        return numbers

    def _about_axis(self, notation: Notation, numbers: FloatArray) -> FloatArray:
        """Return poses whose z axis points from spindle to tip, and whose x axis is nearest to `x_axis`."""
        if self.x_axis is None:
            raise RequestError(
                "the program gives the tool's axis, but no angle about it",
                where="tool_x",
                remedy="give `tool_x`, the direction of the tool's x axis in the base",
            )
        axis = np.tile([0.0, 0.0, 1.0], (len(numbers), 1))
        if notation.orientation is Orientation.TOOL_AXIS:
            axis = numbers[:, 3:]
        z = -axis / np.linalg.norm(axis, axis=1, keepdims=True)
        x = self.x_axis - (z @ self.x_axis)[:, None] * z
        size = np.linalg.norm(x, axis=1, keepdims=True)
        if not (size > _LEAST_SINE * np.linalg.norm(self.x_axis)).all():
            raise RequestError(
                "`tool_x` is parallel to the tool's axis", where="tool_x", remedy="give another direction"
            )
        x = x / size
        poses = np.tile(np.eye(4), (len(numbers), 1, 1))
        poses[:, :3, 0], poses[:, :3, 1], poses[:, :3, 2] = x, np.cross(z, x), z
        poses[:, :3, 3] = numbers[:, :3] * notation.length
        return poses


class _Given:
    """Frames of one kind that the request gives, and which of them the program uses."""

    def __init__(self, notation: Notation, frames: Sequence[ProgramFrame], where: str) -> None:
        self._where = where
        self._poses: Mapping[str | None, FloatArray] = {
            _key(frame.name): _stated(notation, frame.values, f"{where}[{i}].values")
            for i, frame in enumerate(frames)
        }
        self._names = [frame.name for frame in frames]
        if len(self._poses) < len(frames):
            raise RequestError("a frame is given twice", where=where, remedy="give each frame once")
        self._used: set[str | None] = set()

    def pose(self, frame: FrameName) -> FloatArray:
        """Return the pose (4, 4) [m] of a frame."""
        key = _key(frame.name)
        if frame.pose is not None:
            if key in self._poses:
                raise RequestError(
                    f"the program already has the numbers of {shown(frame.name)}",
                    where=self._where,
                    remedy="omit this frame",
                )
            return frame.pose
        key = key if key in self._poses else None
        if key not in self._poses:
            raise RequestError(
                f"the program names {shown(frame.name)}, but has no numbers for it",
                where=self._where,
                remedy=f"give them: {{'name': {frame.name!r}, 'values': [...]}}",
            )
        self._used.add(key)
        return self._poses[key]

    def refuse_unused(self) -> None:
        """Refuse a frame that the program does not use: its name may be misspelt."""
        for name in self._names:
            if _key(name) not in self._used:
                what = (
                    "all frames of the program have numbers"
                    if name is None
                    else f"the program uses no {shown(name)}"
                )
                raise RequestError(what, where=self._where, remedy="omit this frame, or correct its name")


def _placed(outer: FloatArray, given: _Given, frames: Sequence[FrameName], chosen: IndexArray) -> FloatArray:
    """Return frames (t, 4, 4) in the outer one's by their places; the outer one itself for −1."""
    poses = np.tile(outer, (len(frames) + 1, 1, 1))
    for place in np.unique(chosen[chosen >= 0]).tolist():
        poses[place] = outer @ given.pose(frames[place])
    if len(chosen) and (chosen == chosen[0]).all():
        return np.broadcast_to(poses[chosen[0]], (len(chosen), 4, 4))
    return poses[chosen]


def _inverse(poses: FloatArray) -> FloatArray:
    """Return the inverse of rigid transforms (m, 4, 4)."""
    inverse = np.tile(np.eye(4), (len(poses), 1, 1))
    inverse[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
    inverse[:, :3, 3] = -(inverse[:, :3, :3] @ poses[:, :3, 3:])[..., 0]
    return inverse


def _key(name: str | None) -> str | None:
    return None if name is None else name.upper()


def _stated(notation: Notation, values: Sequence[float] | None, where: str) -> FloatArray:
    if values is None:
        return np.eye(4)
    if len(values) != 3 + notation.count or not notation.states(np.array(values)):
        raise RequestError(
            f"a frame has {3 + notation.count} numbers",
            where=where,
            remedy=f"give the position, then {notation.orientation.value}, in the program's units",
        )
    return notation.pose(values)
