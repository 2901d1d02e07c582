"""Examples for the OpenAPI description, small enough to read and complete enough to send."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Any, Final

from fastapi import Body
from fastapi.openapi.models import Example

EXAMPLES: Final[dict[str, dict[str, Any]]] = json.loads(
    files("jointstiff.service.api").joinpath("examples.json").read_text(encoding="utf-8")
)
"""Bodies by resource, and by what they are for."""

_ROBOT: Final = EXAMPLES["robots"]["modified DH"]
_SET: Final = {
    name: value for name, value in EXAMPLES["measurement_sets"]["positions"].items() if name != "robot_id"
}
EXAMPLES["campaigns"] = {
    "positions": {"robot": _ROBOT, "measurement_set": _SET, "run": {"method": "partial_pose"}}
}


def shown(examples: Mapping[str, Any]) -> Any:  # noqa: ANN401 - as FastAPI has it
    """Return the declaration of a JSON body with its examples."""
    return Body(openapi_examples={name: Example(value=value) for name, value in examples.items()})
