"""Paths of a process for tests and benchmarks: a pocket, a blade and a trim."""

import numpy as np

from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.answers import compute_tool_rotations
from jointstiff.solver.process.path import ProcessPath, apply_feed_frames, find_feed_frames

FORCE = np.array([-150.0, -300.0, -120.0])
"""Along feed, normal and spindle axis [N]."""


def pocket(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A contour of rounded corners, spindle down: places [m] about the origin and spindle axes (m, 3)."""
    t = np.linspace(0.0, 2.0 * np.pi, count)
    squared = np.stack([np.cos(t), np.sin(t)], axis=1)
    squared /= (np.abs(squared) ** 4).sum(axis=1, keepdims=True) ** 0.25
    places = np.column_stack([0.15 * squared[:, 0], 0.1 * squared[:, 1], np.zeros(count)])
    return places, np.tile([0.0, 0.0, -1.0], (count, 1))


def blade(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A line over a twisted surface, spindle along its normal."""
    t = np.linspace(-1.0, 1.0, count)
    tilt = 0.35 * t
    places = np.column_stack([0.2 * t, 0.02 * np.sin(2.0 * t), 0.03 * np.cos(1.5 * t)])
    return places, -np.column_stack([0.3 * t * 0.15, np.sin(tilt), np.cos(tilt)]) / np.sqrt(
        1.0 + (0.045 * t[:, None]) ** 2
    )


def trim(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A straight edge of a panel and its corner, spindle tilted by 30°."""
    t = np.linspace(0.0, 1.0, count)
    places = np.column_stack(
        [0.3 * np.minimum(t, 0.7) - 0.1, 0.25 * np.maximum(t - 0.7, 0.0), np.zeros(count)]
    )
    return places, np.tile([0.0, -np.sin(np.pi / 6), -np.cos(np.pi / 6)], (count, 1))


def spiral(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Two and a half rounds of a radius of 50 to 150 mm, points as far apart as each other, spindle down."""
    u = np.linspace(0.0, 1.0, 20_001)
    angle, radius = 5.0 * np.pi * u, 0.05 + 0.1 * u
    fine = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), -0.01 * u])
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1)))
    wanted = np.linspace(0.0, lengths[-1], count)
    places = np.column_stack([np.interp(wanted, lengths, column) for column in fine.T])
    return places, np.tile([0.0, 0.0, -1.0], (count, 1))


SHAPES = {"pocket": pocket, "blade": blade, "trim": trim}


def spindle_at(angle: float) -> np.ndarray:
    """Spindle axis (3,) in the flange frame, at an angle [rad] from the axis of the last joint."""
    return np.array([np.sin(angle), 0.0, np.cos(angle)])


def process_path(
    shape: str,
    centre: np.ndarray,
    *,
    yaw: float = 0.0,
    count: int = 40,
    angle: float = np.pi / 4,
    offset: tuple[float, float, float] = (0.1, 0.0, 0.3),
    force: np.ndarray = FORCE,
    joints: int = 6,
) -> ProcessPath:
    """Return the path of a shape at a place, turned about z by `yaw`, under a force that follows the feed.

    Args:
        shape: one of `SHAPES`.
        centre: (3,) place of the shape's origin in R0 [m].
        yaw: turn of the shape about z [rad].
        count: number of points.
        angle: angle between spindle and last axis [rad].
        offset: centre of the tool in the flange frame [m].
        force: (3,) along feed, normal and spindle axis [N].
        joints: number of the arm's joints.
    """
    places, axes = SHAPES[shape](count)
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    c, s = np.cos(yaw), np.sin(yaw)
    about_z = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    places, axes = places @ about_z.T + centre, axes @ about_z.T
    spindle, tool = spindle_at(angle), np.array(offset)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = compute_tool_rotations(spindle, axes, 1)
    poses[:, :3, 3] = places - poses[:, :3, :3] @ tool
    continuous = np.arange(count) > 0
    frames = find_feed_frames(places, axes, continuous)
    forces = apply_feed_frames(frames, np.tile(force, (count, 1)), "axes")
    return ProcessPath(
        poses=poses,
        spindle=np.tile(spindle, (count, 1)),
        place=np.tile(tool, (count, 1)),
        load_point=np.tile(tool, (count, 1)),
        force=forces,
        moment=np.zeros((count, 3)),
        continuous=continuous,
        given=np.full((count, joints), np.nan),
    )


def reach_centre(robot: Robot, share: float = 0.6, height: float = 0.3, side: float = 0.0) -> np.ndarray:
    """Return a place (3,) in front of an arm [m], in shares of its reach."""
    from jointstiff.solver.mechanics.postures import measure_reach

    reach = measure_reach(robot)
    return np.array([share * reach, side * reach, height * reach])
