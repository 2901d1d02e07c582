"""Raising of documents, step by step, to the newest version."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Final

from jointstiff.service.history.paths import remove
from jointstiff.service.history.steps import JOBS, NEWEST, STEPS

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
    """
    if version is not None and version >= NEWEST:
        return Raised(document, ())
    raised, dropped = deepcopy(document), list[str]()
    for step in STEPS:
        if step.after <= (version or 0) or kind not in step.kinds:
            continue
        step.change(raised)
        dropped += [f"{kind}: {path}" for path in step.dropped if remove(raised, path)]
    if kind in JOBS and version is not None:
        _note_version(raised, version)
    return Raised(raised, tuple(dict.fromkeys(dropped)))


def recorded_version(versions: dict[str, str]) -> int | None:
    """Return the version of a job's document as the job was computed, of its versions; None if not stated."""
    stated = versions.get(_RECORDED, "")
    return int(stated) if stated.isdecimal() else None


def _note_version(job: dict[str, Any], version: int) -> None:
    """Write the version into a job that has ended, unless the job states it."""
    provenance = job.get("provenance")
    has_ended = isinstance(provenance, dict) and provenance.get("ended_at") is not None
    if has_ended and isinstance(versions := provenance.get("versions"), dict):
        versions.setdefault(_RECORDED, str(version))
