"""Imperfections of a real arm: links of other lengths, links that bend, a tilted plate.

Each function takes something nominal and gives what is really there, wrong by a stated size in a random
direction. Units are SI (m, rad, N·m).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from jointstiff.simulator.arm import FloatArray, SpringArm

__all__ = ["angles_with_elastic_links", "misplaced", "with_elastic_links", "with_link_errors"]

LINK_STREAM, PLATE_STREAM = range(30, 32)


def with_link_errors(arm: SpringArm, *, length: float, angle: float, seed: int) -> SpringArm:
    """The arm with every link's vector wrong by `length` and every axis tilted by `angle`.

    The error of a link moves all that follows it. Each error has its stated size exactly, and a
    direction of its own, a tilt one across the axis.

    Args:
        arm: The nominal arm, n joints.
        length: Of the error of each vector from one axis point to the next, and to the flange [m].
        angle: Between each axis and its nominal direction [rad].
        seed: Of the directions.
    """
    n = len(arm.stiffnesses)
    generator = np.random.default_rng([seed, LINK_STREAM])
    moved = np.cumsum(length * _directions(generator, n + 1), axis=0)
    across = np.cross(arm.axis_directions, _directions(generator, n))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return replace(
        arm,
        axis_points=arm.axis_points + moved[:n],
        axis_directions=np.cos(angle) * arm.axis_directions + np.sin(angle) * across,
        flange_translation=arm.flange_translation + moved[n],
    )


def with_elastic_links(arm: SpringArm, transverse: ArrayLike) -> SpringArm:
    """The arm with links and bearings that bend: two more springs at each joint, across its axis.

    The springs are joints of their own that nobody drives, so that the balance stays exact. Joints
    3j, 3j + 1 and 3j + 2 are joint j and its two springs.

    Args:
        arm: The arm with rigid links, n joints.
        transverse: Stiffness of both springs at each joint [N·m/rad], (n,); infinite for a rigid link.

    Returns:
        An arm of 3n joints; `angles_with_elastic_links` gives its angles.
    """
    axes = arm.axis_directions
    first = np.array([np.cross(a, np.eye(3)[np.argmin(np.abs(a))]) for a in axes])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    stiffness = np.broadcast_to(np.asarray(transverse, dtype=float), arm.stiffnesses.shape)
    small = np.broadcast_to([-0.1, 0.1], arm.limits.shape)
    return SpringArm(
        axis_points=np.repeat(arm.axis_points, 3, axis=0),
        axis_directions=_interleaved(axes, first, np.cross(axes, first)),
        flange_rotation=arm.flange_rotation,
        flange_translation=arm.flange_translation,
        stiffnesses=_interleaved(arm.stiffnesses, stiffness, stiffness),
        limits=_interleaved(arm.limits, small, small),
    )


def angles_with_elastic_links(joints: ArrayLike) -> FloatArray:
    """Angles of an arm with elastic links, (..., 3n), from those of its n joints [rad]."""
    angles = np.asarray(joints, dtype=float)
    still = np.zeros_like(angles)
    return np.stack([angles, still, still], axis=-1).reshape(*angles.shape[:-1], -1)


def misplaced(points: ArrayLike, *, length: float, angle: float, seed: int) -> FloatArray:
    """Points on a plate that sits on the flange other than it was told: where they really are.

    The plate is turned by `angle` about a random axis through the flange's origin, then moved by
    `length` in a random direction.

    Args:
        points: Nominal points in the flange frame [m], (..., 3).
        length: How far it is moved [m].
        angle: How far it is turned [rad].
        seed: Of the directions.
    """
    axis, shift = _directions(np.random.default_rng([seed, PLATE_STREAM]), 2)
    nominal = np.asarray(points, dtype=float)
    along = (nominal @ axis)[..., None] * axis
    turned = along + np.cos(angle) * (nominal - along) + np.sin(angle) * np.cross(axis, nominal)
    return np.asarray(turned + length * shift, dtype=np.float64)


def _directions(generator: np.random.Generator, count: int) -> FloatArray:
    """Directions drawn evenly from the sphere, (count, 3)."""
    draws = generator.standard_normal((count, 3))
    directions: FloatArray = draws / np.linalg.norm(draws, axis=1, keepdims=True)
    return directions


def _interleaved(*arrays: FloatArray) -> FloatArray:
    """Arrays (n, ...) as one (3n, ...): first of each, second of each, ..."""
    return np.stack(arrays, axis=1).reshape(-1, *arrays[0].shape[1:])
