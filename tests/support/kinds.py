"""A job of each kind, as it is posted."""

import json
from typing import Any

from support.programs import options, path, tool_poses

from jointstiff.service.kinds.geometry.kind import GEOMETRY
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.rooms import import_kind
from jointstiff.simulator.programs import program_text

MAP = {
    "area": [[1.4, -0.2, 0.6], [1.8, 0.2, 0.6]],
    "grid": [2, 2, 1],
    "place": [0.0, 0.0, 0.25],
    "force": [0.0, 300.0, -500.0],
}
PLAN = {"readings": 2, "criterion": "d", "load": {"kind": "any_direction", "force": 1500.0}}
TEXT = program_text("krl", tool_poses(path(3)), 4)
CHANGES: dict[str, dict[str, Any]] = {
    "run": {"positive": False},
    "comparison": {"confidence": 0.9},
    "geometry": {"fit": "one_by_one"},
    "plan": {"seed": 1},
    "map": {"turns": 3},
    "correction": {"confidence": 0.9},
}
"""For each kind a change of its request; of others the second of its examples."""


def change_of(kind: AnyKind, run: dict[str, Any], other: str = "") -> dict[str, Any]:
    """Return fields by which another job of a kind differs."""
    return CHANGES.get(kind.name) or _examples(kind, run, other)[1]


def _examples(kind: AnyKind, run: dict[str, Any], other: str) -> list[dict[str, Any]]:
    """Return the examples of a kind's requests, of a run and its measurement set."""
    ids = {
        "ID_OF_A_STORED_SET": run["request"]["measurement_set_id"],
        "ID_OF_A_RUN": run["id"],
        "ID_OF_ANOTHER": other,
    }
    text = json.dumps(list(kind.examples.values()))
    for placeholder, own in ids.items():
        text = text.replace(placeholder, own)
    examples: list[dict[str, Any]] = json.loads(text)
    return examples


def posted_job(
    client: Any, kind: str, run: dict[str, Any], other: str = "", /, headers: Any = None, **changes: Any
) -> Any:
    """Post a job that is made of a run or its measurement set; a comparison is with the run `other`."""
    of_set = {"measurement_set_id": run["request"]["measurement_set_id"]}
    if kind == "correction":
        stated = json.dumps(options("krl") | {"run_id": run["id"]} | changes)
        files = [("files", ("cell.src", TEXT.encode("latin-1")))]
        form = {"files": files, "data": {"options": stated}}
        return client.request("POST", "/v1/corrections", headers=headers, **form)
    known = {
        "run": ("runs", of_set),
        "comparison": ("comparisons", {"run_ids": [run["id"], other]}),
        "geometry": ("geometries", next(iter(GEOMETRY.examples.values()))),
        "plan": ("plans", PLAN | of_set),
        "map": ("maps", MAP | {"run_id": run["id"]}),
    }
    collection, body = known.get(kind) or (
        import_kind(kind).collection,
        _examples(import_kind(kind), run, other)[0],
    )
    return client.request("POST", f"/v1/{collection}", json=body | changes, headers=headers)
