"""Campaigns with secondary encoders for tests: their readings by exact springs, not by our model."""

from typing import Any

import numpy as np

from jointstiff.simulator.arm import SpringArm
from jointstiff.simulator.document import experiment_of
from jointstiff.simulator.equilibrium import equilibrium
from jointstiff.simulator.units import Scales


def with_encoders(
    arm: SpringArm,
    document: dict[str, Any],
    *,
    joints: tuple[int, ...] | None = None,
    sigma: float = 5e-6,
    noise: float = 0.0,
    seed: int = 0,
) -> dict[str, Any]:
    """The campaign with what the encoders behind the gearboxes read.

    Args:
        arm: the arm that was simulated; its joint angles are those of the model.
        document: its campaign.
        joints: whose encoders are read; all if None.
        sigma: that the set states [rad].
        noise: standard deviation of one reading [rad].
        seed: of the noise.
    """
    experiment = experiment_of(document)
    bent = equilibrium(arm, experiment.joints, *experiment.wrenches)
    draws = np.random.default_rng(seed).standard_normal((2, *bent.shape))
    unloaded, loaded = np.stack([experiment.joints, experiment.joints + bent]) + noise * draws
    measured = document["measurement_set"]
    angle = Scales.of(measured["units"]).angle
    chosen = range(len(arm.joint_names)) if joints is None else joints
    observations = [
        observation
        | {
            "encoder_readings": [
                {"joint": arm.joint_names[j], "unloaded": before[j] / angle, "loaded": after[j] / angle}
                for j in chosen
            ]
        }
        for observation, before, after in zip(measured["observations"], unloaded, loaded, strict=True)
    ]
    stated = {"noise": measured["noise"] | {"encoder_sigma": sigma / angle}} if "noise" in measured else {}
    return document | {"measurement_set": measured | stated | {"observations": observations}}
