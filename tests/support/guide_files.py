"""Files that the commands of the guides read, and the commands themselves, as they stand in the Markdown."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.document import robot_document

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
UNITS = {"length": "mm", "angle": "deg", "force": "N", "moment": "N.mm"}
_FENCE = re.compile(r"^```(sh|python)[ \t]*\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)


def blocks_of(guide: str) -> list[tuple[str, str]]:
    """Return language and text of the blocks of a guide that a reader may run."""
    return _FENCE.findall((ROOT / guide).read_text(encoding="utf-8"))


def write_files(folder: Path) -> None:
    """Write what a reader has before the first command: tables, points, campaigns, sweeps, robots."""
    motor = _campaign("motor", seed=3)
    (folder / "examples").symlink_to(EXAMPLES)
    for name in ("postures.csv", "readings.csv", "sweeps.json", "pocket.src"):
        shutil.copy(EXAMPLES / name, folder / name)
    shutil.copy(EXAMPLES / "readings.csv", folder / "day1.csv")
    (folder / "joints.csv").write_text(_joints(motor))
    (folder / "points.txt").write_text(_points(motor))
    (folder / "robot.urdf").write_text(motor["robot"]["model"]["urdf"])
    documents = {
        "motor": motor,
        "secondary": _campaign("secondary", seed=4),
        "robot": motor["robot"],
        "nominal": robot_document(default_arm()),
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


def _joints(campaign: dict[str, Any]) -> str:
    """Return a row for each observation: angles and forces."""
    header = ["label", *(f"J{i} [deg]" for i in range(1, 7)), *(f"F{axis} [N]" for axis in "xyz")]
    rows = [
        [one["label"], *map(repr, [*one["joints"], *one["force"]])]
        for one in campaign["measurement_set"]["observations"]
    ]
    return "".join(";".join(row) + "\n" for row in [header, *rows])


def _points(campaign: dict[str, Any]) -> str:
    return "".join(
        ";".join([f"{one['label']}_{reading['target']}_{state}", *map(repr, reading[state])]) + "\n"
        for one in campaign["measurement_set"]["observations"]
        for reading in one["readings"]
        for state in ("unloaded", "loaded")
    )
