"""Examples of bodies and of answers, which the description of the API shows."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Any, Final

EXAMPLES: Final[dict[str, dict[str, Any]]] = json.loads(
    files("jointstiff.service.api").joinpath("examples.json").read_text(encoding="utf-8")
)
"""Example bodies by resource, and then by the name of the example."""

ANSWERS: Final[Mapping[str, Any]] = EXAMPLES.pop("answers")
"""Example answers by operation id, for operations that users meet first; lists of a run are shortened."""

_ROBOT: Final = EXAMPLES["robots"]["modified DH"]
_SET: Final = {
    name: value for name, value in EXAMPLES["measurement_sets"]["positions"].items() if name != "robot_id"
}
EXAMPLES["campaigns"] = {
    "positions": {"robot": _ROBOT, "measurement_set": _SET, "run": {"method": "partial_pose"}}
}
