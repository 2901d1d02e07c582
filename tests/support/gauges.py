"""Campaigns read by dial gauges: a tracker's deflections, taken apart along directions."""

from typing import Any

import numpy as np


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
