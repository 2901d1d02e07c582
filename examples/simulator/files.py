"""Example files for a reader without a clone: tables, points, campaigns, sweeps, robots, a program."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from jointstiff.simulator.arm import Encoders, default_arm
from jointstiff.simulator.campaign import simulate_campaign
from jointstiff.simulator.document import Document, robot_document

_FIXED = (
    "lab.toml",
    "pocket.src",
    "poses.csv",
    "postures.csv",
    "readings.csv",
    "sweeps.json",
    "weight_step.json",
)
_UNITS = {"length": "mm", "angle": "deg", "force": "N", "moment": "N.mm"}


def example_files() -> Iterator[tuple[str, str]]:
    """Yield name and text of each example file; all of one simulated arm."""
    for name in _FIXED:
        yield name, _fixed(name)
    yield "day1.csv", _fixed("readings.csv")
    motor = _campaign("motor", noise_seed=3)
    yield "joints.csv", _joints(motor)
    yield "points.txt", _points(motor)
    yield "robot.urdf", motor["robot"]["model"]["urdf"]
    documents = {
        "motor": motor,
        "secondary": _campaign("secondary", noise_seed=4),
        "robot": motor["robot"],
        "nominal": robot_document(default_arm()),
    }
    for name, document in documents.items():
        yield f"{name}.json", json.dumps(document, indent=1)


def _fixed(name: str) -> str:
    """Return a file that stands beside this module in a wheel, and one folder above in a clone."""
    here = Path(__file__).resolve().parent
    inside = here / "files" / name
    return (inside if inside.is_file() else here.parent / name).read_text(encoding="utf-8")


def _campaign(encoders: Encoders, noise_seed: int) -> Document:
    """Return a campaign; all share their postures and loads, so that they can be compared."""
    return simulate_campaign(
        default_arm(encoders),
        configurations=12,
        load="pull",
        encoders=encoders,
        seed=3,
        noise_seed=noise_seed,
        units=_UNITS,
        load_point=(0, 0, 0.12),
    )


def _joints(campaign: Document) -> str:
    """Return a row for each observation: angles and forces."""
    header = ["label", *(f"J{i} [deg]" for i in range(1, 7)), *(f"F{axis} [N]" for axis in "xyz")]
    rows = [
        [one["label"], *map(repr, [*one["joints"], *one["force"]])]
        for one in campaign["measurement_set"]["observations"]
    ]
    return "".join(";".join(row) + "\n" for row in [header, *rows])


def _points(campaign: Document) -> str:
    """Return a point for each target, observation and state, as tracker software writes them."""
    return "".join(
        ";".join([f"{one['label']}_{reading['target']}_{state}", *map(repr, reading[state])]) + "\n"
        for one in campaign["measurement_set"]["observations"]
        for reading in one["readings"]
        for state in ("unloaded", "loaded")
    )
