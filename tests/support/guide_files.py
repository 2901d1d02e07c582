"""Files that the commands of the guides read, and the commands themselves, as they stand in the Markdown."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.document import robot_document
from jointstiff.simulator.sweeps import SWEEPS, TrackedArm

ROOT = Path(__file__).parents[2]
POSTURES = """\
label,J1 [deg],J2 [deg],J3 [deg],J4 [deg],J5 [deg],J6 [deg],Fx [N],Fy [N],Fz [N]
drill,10,-20,30,0,45,0,0,0,-800
"""
UNITS = {"length": "mm", "angle": "deg", "force": "N", "moment": "N.mm"}
_FENCE = re.compile(r"^```(sh|python)[ \t]*\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)


def blocks_of(guide: str) -> list[tuple[str, str]]:
    """Return language and text of the blocks of a guide that a reader may run."""
    return _FENCE.findall((ROOT / guide).read_text(encoding="utf-8"))


def write_files(folder: Path) -> None:
    """Write what a reader has before the first command: tables, points, campaigns, sweeps, robots."""
    motor = _campaign("motor", seed=3)
    (folder / "joints.csv").write_text(_table(motor, points=False))
    (folder / "points.txt").write_text(_points(motor))
    for name in ("readings.csv", "day1.csv"):
        (folder / name).write_text(_table(motor, points=True))
    (folder / "postures.csv").write_text(POSTURES)
    (folder / "robot.urdf").write_text(motor["robot"]["model"]["urdf"])
    documents = {
        "motor": motor,
        "secondary": _campaign("secondary", seed=4),
        "robot": motor["robot"],
        "nominal": robot_document(default_arm()),
        "sweeps": _sweeps(),
    }
    for name, document in documents.items():
        (folder / f"{name}.json").write_text(json.dumps(document))


def _campaign(encoders: str, seed: int) -> dict[str, Any]:
    arm = default_arm(encoders)
    return simulate_campaign(
        arm,
        configurations=12,
        load="pull",
        encoders=encoders,
        seed=seed,
        units=UNITS,
        load_point=(0, 0, 0.12),
    )


def _table(campaign: dict[str, Any], *, points: bool) -> str:
    """Return a row for each observation: angles, forces and, if asked for, positions of the targets."""
    observations = campaign["measurement_set"]["observations"]
    places = [
        (index, reading["target"], state)
        for index, reading in enumerate(observations[0]["readings"])
        for state in ("unloaded", "loaded")
        if points
    ]
    header = ["label", *(f"J{i} [deg]" for i in range(1, 7)), *(f"F{axis} [N]" for axis in "xyz")]
    header += [f"{target} {state} {axis} [mm]" for _, target, state in places for axis in "xyz"]
    rows = [header]
    for one in observations:
        numbers = [*one["joints"], *one["force"]]
        numbers += [value for index, _, state in places for value in one["readings"][index][state]]
        rows.append([one["label"], *map(repr, numbers)])
    return "".join(";".join(row) + "\n" for row in rows)


def _points(campaign: dict[str, Any]) -> str:
    return "".join(
        ";".join([f"{one['label']}_{reading['target']}_{state}", *map(repr, reading[state])]) + "\n"
        for one in campaign["measurement_set"]["observations"]
        for reading in one["readings"]
        for state in ("unloaded", "loaded")
    )


def _sweeps() -> dict[str, Any]:
    cell, rng = TrackedArm(), np.random.default_rng(5)
    sweeps = []
    for joint, ends in enumerate(SWEEPS):
        angles = cell.sweep(joint, np.linspace(*ends, 10))
        points = cell.readings(angles) + rng.normal(0.0, 1.5e-5, (10, 3, 3))
        observations = [
            {"joints": q.tolist(), "targets": dict(zip(("P10", "P11", "P12"), p.tolist(), strict=True))}
            for q, p in zip(angles, points, strict=True)
        ]
        sweeps.append({"joint": f"joint_{joint + 1}", "observations": observations})
    units = {"length": "m", "angle": "rad"}
    return {"name": "cell 3", "units": units, "noise": {"sigma": 1.5e-5}, "sweeps": sweeps}
