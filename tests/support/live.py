"""Readings of a live campaign, by springs that share no code with the product."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jointstiff.simulator import LOAD_POINT, TARGETS, Experiment, SpringArm, simulate_positions


def positions(
    arm: SpringArm, joints: Sequence[float], force: Sequence[float], *, sigma: float, seed: int = 0
) -> dict[str, Any]:
    """Return places (T, 3) [m] of the targets in one posture, `unloaded` and `loaded` by a force [N]."""
    experiment = Experiment(
        joints=np.array([joints]),
        forces=np.array([force]),
        moments=np.zeros((1, 3)),
        load_points=np.array([LOAD_POINT]),
    )
    unloaded, loaded = simulate_positions(arm, experiment, TARGETS, sigma=sigma, seed=seed)
    return {"unloaded": unloaded[0], "loaded": loaded[0]}


def observation(arm: SpringArm, following: Mapping[str, Any], *, sigma: float, seed: int) -> dict[str, Any]:
    """Return the observation of a posture that is next."""
    places = positions(arm, following["joints"], following["force"], sigma=sigma, seed=seed)
    readings = [
        {"target": name} | {state: each[i].tolist() for state, each in places.items()}
        for i, name in enumerate(TARGETS)
    ]
    return {name: following[name] for name in ("label", "joints", "force")} | {"readings": readings}
