"""Requests: from what is asked for to the settings of the numerical core."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from jointstiff.schemas.options import RunOptions
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.solver.convex.problem import Bounds, Order
from jointstiff.solver.errors import RequestError, SolverError
from jointstiff.solver.estimate import identify
from jointstiff.solver.evidence.estimate import Estimate
from jointstiff.solver.fitting.robust import DEFAULT_THRESHOLD
from jointstiff.solver.fitting.settings import Prior, Settings
from jointstiff.solver.robot.model import Robot


def to_settings(options: RunOptions, robot: Robot) -> Settings:
    """Return how to identify, statements on stiffnesses turned into statements on compliances.

    Raises:
        RequestError: something about a joint that the robot does not have, or an order of the joints that
            contradicts itself or the bounds.
    """
    pairs = (pair for chain in options.stiffness_order for pair in pairwise(chain))
    order = tuple(
        dict.fromkeys(
            (
                joint_index(robot, first, f"stiffness_order.{first}"),
                joint_index(robot, second, f"stiffness_order.{second}"),
            )
            for first, second in pairs
        )
    )
    # With links the loss belongs to the elastic model.
    huber = options.loss == "huber" and options.elasticity in {"joints", "automatic"}
    settings = Settings(
        method=options.method,
        weighting=options.weighting,
        characteristic_length=options.characteristic_length,
        bounds=_bounds(options, robot, order),
        confidence=options.confidence,
        order=order,
        prior=_prior(options, robot),
        loss="huber" if huber else "squared",
        huber_threshold=options.huber_threshold or DEFAULT_THRESHOLD,
        complementary_stiffness=options.complementary_stiffness == "included",
    )
    _ = settings.constraints  # refuses contradictions before any work is done
    return settings


def identified(prepared: PreparedSet, settings: Settings) -> tuple[Settings, Estimate]:
    """Identify, and neglect K_c where the load has no balance with joints as soft as the readings say.

    Readings in a wrong unit do that; the verdict on them says so, and that K_c is neglected.

    Returns:
        The settings that were used, and the estimate.

    Raises:
        JointstiffError: as `jointstiff.solver.estimate.identify`.
    """
    robot, measurements = prepared.robot, prepared.measurements
    try:
        return settings, identify(robot, measurements, settings)
    except SolverError as error:
        if error.where != "complementary_stiffness":
            raise
        neglected = replace(settings, complementary_stiffness=False)
        estimate = identify(robot, measurements, neglected)
        if estimate.complementary_stiffness is None:
            raise
        size = replace(estimate.complementary_stiffness, obstacle=error.reason)
        return neglected, replace(estimate, complementary_stiffness=size)


def _bounds(options: RunOptions, robot: Robot, order: Order) -> Bounds:
    """Return the bounds; joints with a bound, and those in an order, are positive in any case."""
    bounds = Bounds.positive(robot.n) if options.positive else Bounds.unconstrained(robot.n)
    lower, upper = bounds.lower.copy(), bounds.upper.copy()
    for pair in order:
        lower[list(pair)] = 0.0
    for name, (least, greatest) in options.stiffness_bounds.items():
        j = joint_index(robot, name, f"stiffness_bounds.{name}")
        lower[j] = 0.0 if greatest is None else 1.0 / greatest
        upper[j] = np.inf if least is None else 1.0 / least
    return Bounds(lower, upper)


def _prior(options: RunOptions, robot: Robot) -> Prior | None:
    """Return the prior in compliance, to first order: c₀ = 1/k₀ and s₀ = u(k₀)/k₀²."""
    if not options.priors:
        return None
    mean, uncertainty = np.full(robot.n, np.nan), np.full(robot.n, np.inf)
    for name, known in options.priors.items():
        j = joint_index(robot, name, f"priors.{name}")
        mean[j] = 1.0 / known.stiffness
        uncertainty[j] = known.standard_uncertainty / known.stiffness**2
    return Prior(mean, uncertainty)


def joint_index(robot: Robot, name: str, where: str) -> int:
    """Return the place of a joint that a field of the request names.

    Raises:
        RequestError: the robot has no such joint.
    """
    if name not in robot.joint_names:
        raise RequestError(
            f"the robot has no joint '{name}'",
            where=where,
            remedy=f"use one of {', '.join(robot.joint_names)}",
        )
    return robot.joint_names.index(name)
