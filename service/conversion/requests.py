"""Requests: from what is asked for to the settings of the numerical core."""

from __future__ import annotations

import numpy as np

from schemas.run import RunOptions
from solver.exceptions import RequestError
from solver.identification import Settings
from solver.problem import Bounds
from solver.robot import Robot

__all__ = ["to_settings"]


def to_settings(options: RunOptions, robot: Robot) -> Settings:
    """How to identify, with stiffness bounds turned into bounds on the compliances.

    Raises:
        RequestError: a bound on a joint that the robot does not have.
    """
    n = robot.n
    bounds = Bounds.positive(n) if options.positive else Bounds.unconstrained(n)
    lower, upper = bounds.lower.copy(), bounds.upper.copy()
    for name, (least, greatest) in options.stiffness_bounds.items():
        if name not in robot.joint_names:
            raise RequestError(
                f"the robot has no joint '{name}'",
                where=f"stiffness_bounds.{name}",
                remedy=f"use one of {', '.join(robot.joint_names)}",
            )
        j = robot.joint_names.index(name)
        lower[j] = 0.0 if greatest is None else 1.0 / greatest
        upper[j] = np.inf if least is None else 1.0 / least
    return Settings(
        method=options.method,
        weighting=options.weighting,
        characteristic_length=options.characteristic_length,
        bounds=Bounds(lower, upper),
        confidence=options.confidence,
    )
