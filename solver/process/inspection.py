"""Inspection of a motion along a path, at its points and on the lines between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import Postures, rotation_vectors
from jointstiff.solver.predict.forward import ForwardModel
from jointstiff.solver.process.candidates import find_sides
from jointstiff.solver.process.path import ProcessPath

_DISTANCE: Final = 0.002
"""Greatest distance of two places on a line at which the joints are computed [m]."""
_MOST_PARTS: Final = 64
"""Greatest number of parts of a line."""
_FOLLOWED: Final = 0.3
"""Difference of a joint [rad] from the straight line between two postures that is still the same motion."""
_SINGULAR: Final = 1e-9
"""Determinant of a Jacobian, in m and rad, below which the arm is singular."""
_RESTS: Final = 1e-4
"""Motion of a joint [rad] while the tool rests that is rounding."""


@dataclass(frozen=True, eq=False)
class Inspection:
    """Needs of a motion along a path of m points, on the line to each point."""

    motion: FloatArray  #: (m, n) greatest motion of each of the model's joints for a length [rad/m or m/m]
    added: FloatArray  #: (m, n) what the correction adds to it, unless it is blended [rad/m or m/m]
    turn: FloatArray  #: (m,) turn about the spindle for a length [rad/m]
    beyond: (
        BoolArray  #: (m,) mask: a joint is beyond its limits, the arm near a singularity, or a line is left
    )


@dataclass(frozen=True, eq=False)
class Inspector:
    """Inspector of motions along a path: the controller interpolates lines between the points.

    The controller leads the tool's centre along the line, and turns the tool about one axis. Arcs count as
    their chords.
    """

    model: ForwardModel
    inverse: InverseKinematics
    path: ProcessPath
    clearance: float  #: least singular value of the flange's Jacobian, in m and rad
    corrects: bool  #: whether the corrected postures have to keep the limits, too

    def inspect(self, angles: FloatArray, turn: FloatArray) -> Inspection:
        """Inspect a motion.

        Args:
            angles: (m, n) the model's joints at the points [rad or m].
            turn: (m,) turns about the spindle axis [rad].
        """
        path, arm = self.path, self.inverse.select_arm_joints(angles)
        side, is_clear = find_sides(self.inverse, Postures(self.model.robot, angles), self.clearance)
        free = np.isnan(path.given[:, 0])
        beyond = ~(self._are_within(angles) & is_clear)
        added = np.zeros_like(angles)
        if self.corrects:
            corrected = self._correct(angles)
            _, is_clear = find_sides(self.inverse, corrected, self.clearance)
            beyond |= ~(self._are_within(corrected.q) & is_clear)
            added = self._find_added(angles, corrected)
        beyond &= free
        rests = np.flatnonzero(path.continuous[1:] & (path.steps[1:] == 0.0)) + 1
        beyond[rests] |= np.abs(angles[rests] - angles[rests - 1]).max(axis=1, initial=0.0) > _RESTS
        motion = np.zeros((len(path), self.model.robot.n))
        turned = np.zeros(len(path))
        lines = np.flatnonzero(path.steps > 0.0)
        if len(lines):
            change = turn[lines] - turn[lines - 1]
            turned[lines] = (
                np.abs(change - 2.0 * np.pi * np.round(change / (2.0 * np.pi))) / path.steps[lines]
            )
            needed, is_left = self._follow(lines, arm)
            motion[np.ix_(lines, self.inverse.revolute)] = needed
            crossed = side[lines] != side[lines - 1]
            beyond[lines] |= (is_left | crossed) & free[lines] & free[lines - 1]
        return Inspection(motion, added, turned, beyond)

    def _are_within(self, angles: FloatArray) -> BoolArray:
        """Return a mask (m,) of points whose joints (m, n) keep their limits."""
        low, high = self.model.robot.limits.T
        return np.asarray(((angles >= low) & (angles <= high)).all(axis=1))

    def _correct(self, angles: FloatArray) -> Postures:
        """Return the m corrected postures, with which the tool under load is where angles (m, n) place it."""
        robot, path = self.model.robot, self.path
        cases = path.cases(np.arange(len(path)), robot.joint_map.controller_angles(angles))
        commanded = self.model.compute_commands(cases, Postures(robot, angles), np.ones(len(path)))
        return Postures(robot, commanded)

    def _find_added(self, angles: FloatArray, corrected: Postures) -> FloatArray:
        """Return what the correction adds to the mean motion (m, n) for a length of each line [rad/m or m/m].

        The controller leads the tool at the same feed along the corrected line, which is longer or shorter.
        """
        path = self.path
        centres = corrected.to_base(path.place[:, None])[:, 0]
        lengths = np.append(0.0, np.linalg.norm(np.diff(centres, axis=0), axis=1))
        lines = np.flatnonzero((path.steps > 0.0) & (lengths > 0.0))
        motion = np.abs(angles[lines] - angles[lines - 1]) / path.steps[lines, None]
        corrected_motion = np.abs(corrected.q[lines] - corrected.q[lines - 1]) / lengths[lines, None]
        added = np.zeros_like(angles)
        added[lines] = np.maximum(corrected_motion - motion, 0.0)
        return added

    @cached_property
    def _parts(self) -> IndexArray:
        """(m,) number of parts of the line to each point."""
        parts = np.ceil(self.path.steps / _DISTANCE - 1e-6).astype(np.intp)
        return np.clip(parts, 1, _MOST_PARTS)

    def _follow(self, lines: IndexArray, arm: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the motion (k, 6) that lines need [rad/m], and a mask (k,) of lines that are left.

        Args:
            lines: (k,) points to which the lines lead.
            arm: (m, 6) the model's joints of the arm at all points [rad].
        """
        path, robot = self.path, self.inverse.arm
        parts = self._parts[lines]
        owner = np.repeat(np.arange(len(lines)), parts - 1)
        first = np.cumsum(parts - 1) - (parts - 1)
        fraction = (np.arange(len(owner)) - first[owner] + 1) / parts[owner]
        last = lines[owner]
        guess = arm[last - 1] + fraction[:, None] * (arm[last] - arm[last - 1])
        is_left = np.zeros(len(lines), dtype=np.bool_)
        inner = guess
        if len(owner):
            poses = self._interpolate(lines, owner, fraction, arm)
            inner, reached = self.inverse.refine(poses, guess)
            low, high = robot.limits.T
            kept = reached & ((inner >= low) & (inner <= high)).all(axis=1)
            kept &= np.abs(inner - guess).max(axis=1) <= _FOLLOWED
            kept &= self.inverse.keep_clearance(inner, self.clearance)
            is_left[owner[~kept]] = True
        # All places along the lines in order: start, inner places and end of each line.
        ends = np.cumsum(parts + 1)
        starts = ends - (parts + 1)
        along = np.empty((int(ends[-1]), robot.n))
        along[starts], along[ends - 1] = arm[lines - 1], arm[lines]
        is_inner = np.ones(len(along), dtype=np.bool_)
        is_inner[starts] = is_inner[ends - 1] = False
        along[is_inner] = inner
        moved = np.abs(np.diff(along, axis=0))
        moved[ends[:-1] - 1] = 0.0  # from the end of a line to the start of the next
        greatest = np.maximum.reduceat(moved, starts) * (parts / path.steps[lines])[:, None]
        peaks = self._find_peaks(lines, owner, arm, inner)
        return np.maximum(greatest, peaks), is_left

    def _find_peaks(
        self, lines: IndexArray, owner: IndexArray, arm: FloatArray, inner: FloatArray
    ) -> FloatArray:
        """Return the greatest motion of the joints for a length (l, 6) [rad/m], at ends of lines and inside.

        Means between two places miss the peaks at the ends of lines. At a singularity, where the motion has
        no bound, a place counts as at rest: `keep_clearance` finds it.

        Args:
            lines: (l,) points to which the lines lead.
            owner: (k,) index of the line of each place inside.
            arm: (m, 6) the model's joints of the arm at all points [rad].
            inner: (k, 6) the same at the places inside.
        """
        path, robot = self.path, self.inverse.arm
        at = Postures(robot, np.concatenate([arm, inner]))
        place = np.concatenate([path.place, path.place[lines][owner]])
        centre = at.to_base(place[:, None])
        jacobian = at.pose_jacobian_at(centre)
        is_regular = np.abs(np.linalg.det(jacobian)) > _SINGULAR
        inverse = np.linalg.inv(np.where(is_regular[:, None, None], jacobian, np.eye(6)))
        inverse[~is_regular] = 0.0
        rotation = at.flange_rotation
        twist = np.concatenate(
            [
                centre[lines, 0] - centre[lines - 1, 0],
                rotation_vectors(rotation[lines], rotation[lines - 1]),
            ],
            axis=1,
        )
        twist /= path.steps[lines][:, None]
        ends = (np.abs(inverse[rows] @ twist[..., None])[..., 0] for rows in (lines - 1, lines))
        greatest: FloatArray = np.maximum(*ends)
        inside = np.abs(inverse[len(arm) :] @ twist[owner][..., None])[..., 0]
        np.maximum.at(greatest, owner, inside)
        return greatest

    def _interpolate(
        self, lines: IndexArray, owner: IndexArray, fraction: FloatArray, arm: FloatArray
    ) -> FloatArray:
        """Return the poses (k, 4, 4) of the flange at places on the lines, as the controller interpolates."""
        robot = self.inverse.arm
        before, here = (Postures(robot, arm[each]) for each in (lines - 1, lines))
        start = before.flange_rotation
        turn = rotation_vectors(here.flange_rotation, start)
        place = self.path.place[lines]
        centres = [each.to_base(place[:, None])[:, 0] for each in (before, here)]
        part = fraction[:, None]
        poses = np.tile(np.eye(4), (len(owner), 1, 1))
        rotation = Rotation.from_rotvec(part * turn[owner]).as_matrix() @ start[owner]
        centre = (1.0 - part) * centres[0][owner] + part * centres[1][owner]
        poses[:, :3, :3] = rotation
        poses[:, :3, 3] = centre - (rotation @ place[owner][..., None])[..., 0]
        return poses
