"""Imperfections of a real arm: links and axes that are wrong by a stated size in a random direction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jointstiff.simulator.arm import FloatArray, SpringArm

__all__ = ["with_link_errors"]

LINK_STREAM = 30


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


def _directions(generator: np.random.Generator, count: int) -> FloatArray:
    """Directions drawn evenly from the sphere, (count, 3)."""
    draws = generator.standard_normal((count, 3))
    directions: FloatArray = draws / np.linalg.norm(draws, axis=1, keepdims=True)
    return directions
