"""An arm on a pedestal that yields: two more springs below joint 1, in exact balance with all others.

Units are SI (m, rad, N·m). The pedestal tilts about x and y of R0, through a foot on the axis of joint 1. Its
springs are two joints whose commanded angles are zero, so that whatever balances an arm balances it, too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from jointstiff.simulator.arm import FloatArray, SpringArm
from jointstiff.simulator.document import Document, measurement_set, robot_document
from jointstiff.simulator.equilibrium import deflections
from jointstiff.simulator.experiment import NOISE_STREAM, TARGETS, plan_experiment
from jointstiff.simulator.units import SI_UNITS

__all__ = ["SPRINGS", "on_pedestal", "pedestal_campaign", "standing"]

SPRINGS = 2


def on_pedestal(arm: SpringArm, stiffness: ArrayLike, *, foot: float = 0.0) -> SpringArm:
    """The arm with the pedestal's springs before its joints.

    Args:
        arm: The arm.
        stiffness: Of the pedestal about x and y [N·m/rad], one number or (2,); infinite for a rigid one.
        foot: Height in R0 of the axes about which it tilts [m].
    """
    return replace(
        arm,
        axis_points=np.vstack([np.tile([0.0, 0.0, foot], (SPRINGS, 1)), arm.axis_points]),
        axis_directions=np.vstack([np.eye(3)[:SPRINGS], arm.axis_directions]),
        stiffnesses=np.concatenate([np.broadcast_to(stiffness, SPRINGS), arm.stiffnesses]),
        limits=np.vstack([np.tile([-np.pi, np.pi], (SPRINGS, 1)), arm.limits]),
    )


def standing(q: FloatArray) -> FloatArray:
    """Angles (N, 2 + n) of an arm on a pedestal that stands straight, from those of the arm (N, n)."""
    return np.pad(q, ((0, 0), (SPRINGS, 0)))


def pedestal_campaign(
    arm: SpringArm,
    stiffness: ArrayLike,
    *,
    foot: float = 0.0,
    configurations: int = 30,
    force: float = 1500.0,
    sigma: float = 3e-5,
    seed: int = 0,
) -> Document:
    """A campaign of pulls in all directions, as `jointstiff.simulator.campaign.simulate_campaign` writes it.

    Args:
        arm: The arm.
        stiffness: Of the pedestal, as `on_pedestal` takes it.
        foot: Height of its axes [m].
        configurations: How many.
        force: Size of the force [N].
        sigma: Standard deviation of each coordinate of each position read [m].
        seed: Of configurations, directions and noise.
    """
    experiment = plan_experiment(arm, configurations=configurations, load="pull", force=force, seed=seed)
    points = np.array(list(TARGETS.values()), dtype=float)
    exact = deflections(
        on_pedestal(arm, stiffness, foot=foot), standing(experiment.joints), *experiment.wrenches, points
    )
    noise = sigma * np.random.default_rng([seed, NOISE_STREAM]).standard_normal((2, *exact[0].shape))
    document = measurement_set(
        experiment,
        TARGETS,
        exact[0] + noise[0],
        exact[1] + noise[1],
        name=f"on a pedestal, {configurations} configurations",
        units=SI_UNITS,
        encoders="motor",
        readings="positions",
        sigma=sigma or None,
    )
    return {"robot": robot_document(arm), "measurement_set": document, "run": {}}
