"""Campaigns with secondary encoders, by exact springs, and those read by dial gauges."""

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


def triads(count: int, seed: int = 0) -> np.ndarray:
    """Three directions at right angles for each observation, (N, 3, 3) row by row."""
    random = np.random.default_rng(seed)
    return np.array([np.linalg.qr(random.standard_normal((3, 3)))[0] for _ in range(count)])


def by_gauges(document: dict[str, Any], directions: np.ndarray, rotation: np.ndarray | None = None) -> Any:
    """Read each deflection along directions (N, k, 3) in R0, each by a gauge of its own.

    With rotations (N, 3, 3) of the flange, the directions are stated in its frame.
    """
    measured = document["measurement_set"]
    observations = []
    for i, observation in enumerate(measured["observations"]):
        readings = []
        for reading in observation["readings"]:
            for k, direction in enumerate(directions[i]):
                unit = direction / np.linalg.norm(direction)
                stated = direction if rotation is None else direction @ rotation[i]
                name = "direction" if rotation is None else "flange_direction"
                noise = {"sigma": reading["sigma"]} if "sigma" in reading else {}
                readings.append(
                    {
                        "target": f"{reading['target']} {k}",
                        "displacement": float(unit @ np.array(reading["deflection"])),
                        name: stated.tolist(),
                    }
                    | noise
                )
        observations.append(observation | {"readings": readings})
    count = directions.shape[1]
    places = {f"{n} {k}": p for n, p in measured["flange_targets"].items() for k in range(count)}
    return document | {"measurement_set": measured | {"observations": observations, "flange_targets": places}}
