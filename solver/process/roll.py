"""Roll of a program: the turn of the tool about the spindle from point to point, and where it jumps.

A program for a round tool often states any roll, such as one that a post-processor chose for each point. A
free turn need not follow it: the tool is carried along the path without a turn about the spindle (parallel
transport) wherever the program turns the tool faster than the limit of the rate.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.process.path import ProcessPath

_ROUNDING: Final = 1e-6
"""Roll that counts as zero [rad]."""
_OPPOSITE: Final = 1e-9
"""Square of the cosine's distance from −1, below which two axes are opposite."""


def find_rolls(path: ProcessPath) -> FloatArray:
    """Return the turns about the spindle (m,) on the lines to the m points of a path [rad].

    A turn is zero without a line. It is what is left of the rotation once the spindle axis is carried along
    by the least rotation.
    """
    rolls = np.zeros(len(path))
    if len(path) < 2:
        return rolls
    axes, rotation = path.axes, path.poses[:, :3, :3]
    before, here = axes[:-1], axes[1:]
    cosine = 1.0 + (before * here).sum(axis=1)
    normal = np.cross(before, here)
    # The least rotation from one unit vector a to another b has the quaternion (a × b, 1 + a · b).
    is_known = np.square(cosine) > _OPPOSITE
    quaternion = np.column_stack([normal, np.where(is_known, cosine, 1.0)])
    carried = Rotation.from_quat(quaternion).as_matrix() @ rotation[:-1]
    left = Rotation.from_matrix(rotation[1:] @ carried.transpose(0, 2, 1)).as_rotvec()
    same_tool = np.abs(np.diff(path.spindle, axis=0)).max(axis=1) < _ROUNDING
    known = is_known & same_tool & (path.steps[1:] > 0.0)
    rolls[1:] = np.where(known, (left * here).sum(axis=1), 0.0)
    return rolls


def steady_roll(path: ProcessPath, rate: float, first: IndexArray) -> FloatArray:
    """Return the turns (m,) from the programmed orientations by which the roll of a path has no jumps [rad].

    Lines on which the program turns the tool about the spindle by at most `rate` [rad/m] are followed. So are
    all lines between motions of the joints, if there is a point with given joints, or a point that is visited
    again and would get another orientation.

    Args:
        path: path of m points.
        rate: greatest turn about the spindle for a length [rad/m].
        first: (m,) index of the first point that is the same target, for each point.
    """
    rolls = find_rolls(path)
    jumps = np.abs(rolls) > rate * path.steps + _ROUNDING
    turn = np.zeros(len(path))
    if not jumps.any():
        return turn
    number = np.cumsum(~path.continuous)
    given = ~np.isnan(path.given[:, 0])
    removed = np.where(jumps & ~np.isin(number, number[given]), -rolls, 0.0)
    total = np.cumsum(removed)
    for part in path.stretches:
        turn[part] = total[part] - total[part.start]
    difference = turn - turn[first]
    if (np.abs(difference - 2.0 * np.pi * np.round(difference / (2.0 * np.pi))) > _ROUNDING).any():
        again = np.bincount(first, minlength=len(path))[first] > 1
        turn[np.isin(number, number[again])] = 0.0
    return turn


def wrap_turns(turn: FloatArray, roll: FloatArray, path: ProcessPath) -> FloatArray:
    """Return turns (m,) from the programmed orientations, less whole turns, close to zero [rad].

    Turns behind a jump of the programmed roll, or behind a motion of the joints, get one shift: between jumps
    the turn stays continuous, so that a tool that turns on and on is seen.

    Args:
        turn: (m,) turns from the programmed orientations; NaN where the posture was given.
        roll: (m,) turns of `steady_roll`, which jump where the programmed roll does.
        path: path of m points.
    """
    wrapped = turn.copy()
    begins = ~path.continuous | np.append(True, np.abs(np.diff(roll)) > _ROUNDING)
    ends = np.append(np.flatnonzero(begins)[1:], len(turn))
    for first, last in zip(np.flatnonzero(begins).tolist(), ends.tolist(), strict=True):
        known = turn[first:last][np.isfinite(turn[first:last])]
        if len(known):
            middle = 0.5 * (known.min() + known.max())
            wrapped[first:last] -= 2.0 * np.pi * np.round(middle / (2.0 * np.pi))
    return wrapped
