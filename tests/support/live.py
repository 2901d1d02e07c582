"""Readings of a live campaign, by springs that share no code with the product."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from support.api import post

from jointstiff.simulator import (
    LOAD_POINT,
    TARGETS,
    Experiment,
    SpringArm,
    default_arm,
    robot_document,
    simulate_positions,
)


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


ARM, SIGMA = default_arm(), 2e-5
EXACT = {
    "sigma": SIGMA,
    "load_point": 1e-4,
    "grounds": {"load_point": "tracker"},
    "force": {"scale": 1e-3},
}  # next to exact
OPEN: dict[str, Any] = {
    "goal": {"kind": "joints", "relative": 0.15},
    "load": {"kind": "dead_weight", "mass": 150.0},
    "targets": {name: list(place) for name, place in TARGETS.items()},
}


def read(following: Mapping[str, Any], seed: int = 0, **changes: object) -> dict[str, Any]:
    """Return an observation of what is next, by springs that balance the load exactly, and noise."""
    number = int(following["label"].strip("m"))
    return observation(ARM, following, sigma=SIGMA, seed=1000 * seed + number) | changes


def described(robot: str, options: Mapping[str, Any], **more: object) -> dict[str, Any]:
    """Return an open set of a robot, as it is posted."""
    units = {"length": "m", "angle": "rad", "force": "N"}
    return {"robot_id": robot, "name": "live", "units": units, "encoders": "motor", "open": options} | more


def declared(client: Any, **changes: object) -> str:
    """Open a set of the arm; return its address."""
    robot = post(client, "/v1/robots", robot_document(ARM))["id"]
    body = described(robot, OPEN | changes, noise=EXACT, load_point=list(LOAD_POINT))
    return f"/v1/measurement-sets/{post(client, '/v1/measurement-sets', body)['id']}"


def measured(
    client: Any,
    address: str,
    readings: int,
    change: Callable[[dict[str, Any]], dict[str, Any]] = dict,
    seed: int = 0,
) -> Any:
    """Send some readings, each changed; return the state after them."""
    state = client.get(f"{address}/next").json()
    for _ in range(readings):
        if state["next"] is None:
            break
        state = post(client, f"{address}/observations", change(read(state["next"], seed)))
    return state


def exchanged(reading: dict[str, Any]) -> dict[str, Any]:
    """Exchange the names of the first two targets of a reading."""
    first, second, *others = reading["readings"]
    names = [one | {"target": other["target"]} for one, other in ((first, second), (second, first))]
    return reading | {"readings": [*names, *others]}
