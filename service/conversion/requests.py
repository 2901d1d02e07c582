"""Requests: from what is asked for to the settings of the numerical core."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from jointstiff.schemas.run import RunOptions
from jointstiff.solver.convex import Bounds, Order
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fitting import DEFAULT_THRESHOLD, Prior
from jointstiff.solver.identification import Settings
from jointstiff.solver.robot import Robot

__all__ = ["to_settings"]


def to_settings(options: RunOptions, robot: Robot) -> Settings:
    """How to identify, with what is said of stiffnesses turned into what it says of compliances.

    Raises:
        RequestError: something about a joint that the robot does not have, or an order of the joints that
            contradicts itself or the bounds.
    """
    order = _order(options, robot)
    settings = Settings(
        method=options.method,
        weighting=options.weighting,
        characteristic_length=options.characteristic_length,
        bounds=_bounds(options, robot, order),
        confidence=options.confidence,
        order=order,
        prior=_prior(options, robot),
        loss=options.loss,
        huber_threshold=options.huber_threshold or DEFAULT_THRESHOLD,
        complementary_stiffness=options.complementary_stiffness == "included",
    )
    _ = settings.constraints  # refuses contradictions before any work is done
    return settings


def _bounds(options: RunOptions, robot: Robot, order: Order) -> Bounds:
    """Joints with a bound, and those in an order, are positive in any case."""
    bounds = Bounds.positive(robot.n) if options.positive else Bounds.unconstrained(robot.n)
    lower, upper = bounds.lower.copy(), bounds.upper.copy()
    for pair in order:
        lower[list(pair)] = 0.0
    for name, (least, greatest) in options.stiffness_bounds.items():
        j = _joint(robot, name, "stiffness_bounds")
        lower[j] = 0.0 if greatest is None else 1.0 / greatest
        upper[j] = np.inf if least is None else 1.0 / least
    return Bounds(lower, upper)


def _order(options: RunOptions, robot: Robot) -> Order:
    """Pairs of neighbours in the chains: the first is at least as stiff, its compliance at most as large."""
    chains = [[_joint(robot, name, "stiffness_order") for name in chain] for chain in options.stiffness_order]
    return tuple(dict.fromkeys(pair for chain in chains for pair in pairwise(chain)))


def _prior(options: RunOptions, robot: Robot) -> Prior | None:
    """In compliance, to first order: c₀ = 1/k₀ and s₀ = u(k₀)/k₀²."""
    if not options.priors:
        return None
    mean, uncertainty = np.full(robot.n, np.nan), np.full(robot.n, np.inf)
    for name, known in options.priors.items():
        j = _joint(robot, name, "priors")
        mean[j] = 1.0 / known.stiffness
        uncertainty[j] = known.standard_uncertainty / known.stiffness**2
    return Prior(mean, uncertainty)


def _joint(robot: Robot, name: str, field: str) -> int:
    if name not in robot.joint_names:
        raise RequestError(
            f"the robot has no joint '{name}'",
            where=f"{field}.{name}",
            remedy=f"use one of {', '.join(robot.joint_names)}",
        )
    return robot.joint_names.index(name)
