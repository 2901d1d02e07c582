"""The report of a run, from the run, its readings' metadata and the laboratory's settings."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Final

from jointstiff.schemas.measurement.measurement_set import MeasurementSetDocument
from jointstiff.schemas.measurement.metadata import SetMetadata
from jointstiff.schemas.report import Party
from jointstiff.service.exporting.model import ExportedModel
from jointstiff.service.exporting.tables import joints_csv
from jointstiff.service.reports import statements
from jointstiff.service.reports.document import Attachment, Document, Section, State
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.run_method import adjustment, method, traceability
from jointstiff.service.reports.run_results import assessment, results, uncertainty
from jointstiff.service.reports.wording import NOT_STATED, moment
from jointstiff.service.tables.requested import requested
from jointstiff.service.tables.table import text_table

MAX_ATTACHED_BYTES: Final = 2_500_000
"""JSON of a run that is attached whole; it takes a quarter of that in the PDF."""
_TITLE: Final = "Report on joint stiffness"
_BY_OBSERVATION: Final = ("residuals", "contributions", "encoder_residuals")


@dataclass(frozen=True, eq=False)
class RunSubject:
    """A run to report on."""

    model: ExportedModel  # the run with its robot
    readings: MeasurementSetDocument  # the measurement set; of its observations only the postures are drawn
    settings: LaboratorySettings  # of the laboratory

    def run_json(self) -> bytes:
        """Return the run as it is attached: a large one without what it says of each observation."""
        run = self.model.run
        whole = run.model_dump_json().encode()
        if len(whole) <= MAX_ATTACHED_BYTES or run.result is None:
            return whole
        less = run.result.model_copy(update={name: [] for name in _BY_OBSERVATION})
        return run.model_copy(update={"result": less}).model_dump_json().encode()

    def content_hash(self) -> str:
        """Return the SHA-256 of what a report states: run, names, metadata of the set, laboratory, logo.

        A run never changes, so its id and the hash of its input stand for it. What is not stated is left out:
        a later version with more fields finds the same hash.
        """
        run, laboratory, logo = self.model.run, self.settings.laboratory, self.settings.logo
        stated = [
            run.id,
            run.provenance.input_hash,
            self.model.name,
            self.readings.name,
            self.readings.model_dump(mode="json", include=set(SetMetadata.model_fields), exclude_none=True),
            None if laboratory is None else laboratory.model_dump(mode="json", exclude_defaults=True),
            None if logo is None else hashlib.sha256(logo.content).hexdigest(),
        ]
        return hashlib.sha256(json.dumps(stated, sort_keys=True).encode()).hexdigest()


def run_document(subject: RunSubject, state: State) -> Document:
    """Return the report of a run. The same run, metadata, settings and state give the same document."""
    run = subject.model.run
    return Document(
        title=_TITLE,
        number=f"{run.id}-{state.number}",
        state=state,
        letterhead=subject.settings.letterhead(),
        dated=state.issued_at or run.provenance.ended_at or run.provenance.created_at,
        sections=[
            _identification(subject, state),
            results(subject.model, subject.readings),
            uncertainty(subject.model),
            method(subject.model, subject.settings.laboratory),
            Section(statements.REQUESTED, facts=requested(run.request)),
            adjustment(subject.model),
            traceability(subject.readings, subject.settings.laboratory),
            assessment(subject.model.result),
            Section(statements.STATED, paragraphs=list(statements.STATEMENTS)),
            _origin(subject),
            Section(
                statements.ITEMS_HEADING,
                tables=[
                    text_table(
                        ["item", "asks for", "stands in"],
                        [list(item) for item in statements.ITEMS],
                        texts=[0, 1, 2],
                    )
                ],
            ),
        ],
        attachments=[
            Attachment(
                "run.json",
                "application/json",
                "The run; a large one without its residuals",
                subject.run_json(),
            ),
            Attachment("joints.csv", "text/csv", "The joints as a table", joints_csv(subject.model)),
        ],
    )


def _identification(subject: RunSubject, state: State) -> Section:
    readings, run, laboratory = subject.readings, subject.model.run, subject.settings.laboratory
    place = None
    if laboratory is not None:
        place = laboratory.place or ", ".join(laboratory.address)
    robot = subject.model.robot
    return Section(
        statements.IDENTIFICATION,
        facts=[
            ("Report", f"{run.id}-{state.number}"),
            ("State", f"{state.kind}: {state.line}"),
            ("Customer", _party(None if laboratory is None else laboratory.customer)),
            ("Location of the measurement", place or NOT_STATED),
            (
                "Item",
                f"Industrial robot {subject.model.name}, {robot.n} joints: {', '.join(robot.joint_names)}",
            ),
            ("Serial number", readings.serial_number or NOT_STATED),
            ("Condition of the item", readings.conditions or NOT_STATED),
            ("Date of receipt", NOT_STATED),
            ("Measured", moment(readings.measured_at)),
            ("Computed", moment(run.provenance.ended_at)),
            ("Date of issue", moment(state.issued_at) if state.issued_at else "not issued: draft"),
            ("Measurement set", readings.name),
            ("Operator", readings.operator or NOT_STATED),
            ("Authorised by", state.by or "nobody"),
            *([("Notes on the measurement", readings.notes)] if readings.notes else []),
        ],
    )


def _party(party: Party | None) -> str:
    if party is None:
        return NOT_STATED
    return ", ".join([party.name, *party.address, *([party.contact] if party.contact else [])])


def _origin(subject: RunSubject) -> Section:
    provenance = subject.model.run.provenance
    versions = ", ".join(f"{name} {version}" for name, version in sorted(provenance.versions.items()))
    geometry = subject.model.geometry_id
    return Section(
        statements.ORIGIN,
        facts=[
            ("Run", subject.model.run.id),
            ("SHA-256 of the input", provenance.input_hash),
            ("SHA-256 of what is stated", subject.content_hash()),
            ("Versions", versions),
            ("Geometry", "as described" if geometry is None else f"as identified, geometry {geometry}"),
            (
                "Attached",
                "run.json (the run; a large one without its residuals), joints.csv (the joints as a table)",
            ),
        ],
    )
