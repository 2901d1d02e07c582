"""Reports of other jobs, all by one template: what was asked for, and the tables that the terminal shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from jointstiff.schemas.job import Job
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.report import job_parts
from jointstiff.service.reports.document import Attachment, Document, Fact, Section, State, moment
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.run import (
    IDENTIFICATION,
    NOT_ISO_9283,
    ORIGIN,
    REQUESTED,
    RESULTS,
    STATED,
)
from jointstiff.service.tables.report import View, requested
from jointstiff.service.tables.table import Line, Table

_UNSIGNED: Final = State("unsigned", "For information: reports of this kind are not authorised.")


def job_document(
    kind: AnyKind, job: Job, document: str, settings: LaboratorySettings, about: Sequence[Fact] = ()
) -> Document:
    """Return the report of a job that has succeeded."""
    title, provenance = kind.title, job.provenance
    parts = job_parts(kind, job, View(details=True))
    notes = [line.strip() for part in parts if isinstance(part, Line) for line in part.text.splitlines()]
    versions = ", ".join(f"{name} {version}" for name, version in sorted(provenance.versions.items()))
    return Document(
        title=title,
        number=job.id,
        state=_UNSIGNED,
        letterhead=settings.letterhead(),
        dated=provenance.ended_at or provenance.created_at,
        sections=[
            Section(
                IDENTIFICATION,
                facts=[
                    ("Report", f"{title}, {job.id}"),
                    ("Computed", moment(provenance.ended_at)),
                    *about,
                ],
            ),
            Section(REQUESTED, facts=requested(job.request)),
            Section(
                RESULTS,
                tables=[part for part in parts if isinstance(part, Table)],
                notes=[note for note in notes if note],
            ),
            Section(STATED, paragraphs=[NOT_ISO_9283]),
            Section(
                ORIGIN,
                facts=[
                    ("SHA-256 of the input", provenance.input_hash),
                    ("Versions", versions),
                    ("Attached", f"{job.kind}.json, with all numbers"),
                ],
            ),
        ],
        attachments=[
            Attachment(
                f"{job.kind}.json", "application/json", "The job, with all its numbers", document.encode()
            )
        ],
        signs=False,
    )
