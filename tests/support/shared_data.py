"""Published and recorded data beside the checkout, which not every machine has."""

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest

SHARED = Path(__file__).parents[3] / "shared" / "data"
MISSING = "the shared data are not beside this checkout (../shared/data)"


@lru_cache
def _text(name: str) -> str:
    return (SHARED / f"{name}.json").read_text()


def shared(name: str) -> dict[str, Any]:
    """Return a shared document by name; skip the test where the shared data are absent.

    The simulated arm is of the 240 kg class; its documents are older than the field.
    """
    if not SHARED.is_dir():
        pytest.skip(MISSING)
    document: dict[str, Any] = json.loads(_text(name))
    if name.startswith("simulated/") and "robot" in document:
        document["robot"].setdefault("payload", 240.0)
    return document
