"""Campaign documents as users post them, and changes of their parts."""

import json
from typing import Any

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.own_weight import unloaded_campaign


def campaign(load: str = "pull", configurations: int = 12, seed: int = 1, **options: Any) -> dict[str, Any]:
    """Simulate a campaign on the arm of exact springs."""
    return simulate_campaign(default_arm(), load=load, configurations=configurations, seed=seed, **options)


def own_weight(configurations: int = 30, seed: int = 4, **options: Any) -> dict[str, Any]:
    """Simulate a campaign of readings without load."""
    return unloaded_campaign(default_arm(), configurations=configurations, seed=seed, **options)


def changed(document: Any, *changes: tuple[str, Any]) -> Any:
    """Return a document with other parts, by their paths (`observations.0.joints`); None takes one away."""
    document = json.loads(json.dumps(document))
    for path, value in changes:
        *way, last = [int(key) if key.isdigit() else key for key in path.split(".")]
        part = document
        for key in way:
            part = part[key]
        if value is None:
            part.pop(last, None)
        else:
            part[last] = value
    return document
