"""Raising of documents, step by step, to the newest version."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Final

from jointstiff.service.history.paths import remove
from jointstiff.service.history.steps import JOBS, NEWEST, OLDEST, STEPS

_RECORDED: Final = "document"
"""Entry of the versions in a job's provenance: version of the document as the job was computed."""


@dataclass(frozen=True)
class Raised:
    """A document of the newest version."""

    document: dict[str, Any]
    dropped: tuple[str, ...]  # places of values that have no place in the newest version


def raise_document(kind: str, document: dict[str, Any], version: int | None) -> Raised:
    """Return a document of a version as a document of the newest version; the given one is not changed.

    Args:
        kind: `robot`, `measurement_set`, `campaign`, `open_set`, `live_entry`, `findings`, or a kind of work.
        document: the document.
        version: version of the document; None for a document that does not state it.

    Raises:
        ValueError: the document is none of its version.
    """
    if version is not None and version >= NEWEST:
        return Raised(document, ())
    try:
        raised = _take_steps(kind, deepcopy(document), version or 0)
    except (LookupError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"the document is no {kind} of version {version or OLDEST}") from error
    if kind in JOBS and version is not None:
        note_version(raised.document, version)
    return raised


def _take_steps(kind: str, document: dict[str, Any], version: int) -> Raised:
    """Change a document of a version, in place, by each later step of the history that concerns its kind.

    A step changes fields, and then removes values that have no place any more; their paths are returned.
    """
    dropped: list[str] = []
    for step in STEPS:
        is_newer = step.after > version
        if not is_newer or kind not in step.kinds:
            continue
        step.change(document)
        for path in step.dropped:
            was_there = remove(document, path)
            if was_there:
                dropped.append(f"{kind}: {path}")
    return Raised(document, tuple(dropped))


def note_version(job: dict[str, Any], version: int) -> None:
    """Write the version into a job that has ended, unless the job states it."""
    provenance = job.get("provenance")
    if not isinstance(provenance, dict) or provenance.get("ended_at") is None:
        return
    versions = provenance.get("versions")
    if isinstance(versions, dict):
        versions.setdefault(_RECORDED, str(version))
