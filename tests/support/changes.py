"""Documents with one thing changed."""

import json
from typing import Any

WITHOUT = object()


def changed(document: Any, path: str, value: Any = WITHOUT) -> Any:
    """Return a document with another value at a path (`observations.0.joints`), or without what is there."""
    document = json.loads(json.dumps(document))
    *way, last = [int(key) if key.isdigit() else key for key in path.split(".")]
    part = document
    for key in way:
        part = part[key]
    if value is WITHOUT:
        del part[last]
    else:
        part[last] = value
    return document
