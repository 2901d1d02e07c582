"""The report of a run, from the run, its readings' metadata and the laboratory's settings."""

from __future__ import annotations

import hashlib
import json
from base64 import b64decode, b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from typing import Any, Final

from jointstiff.schemas.measurement.measurement_set import MeasurementSetDocument
from jointstiff.schemas.measurement.metadata import SetMetadata
from jointstiff.schemas.report import Laboratory, Party
from jointstiff.service.exporting.model import ExportedModel
from jointstiff.service.exporting.tables import joints_csv
from jointstiff.service.reports import statements
from jointstiff.service.reports.document import Attachment, Document, Section, State
from jointstiff.service.reports.laboratory import LaboratorySettings, Logo
from jointstiff.service.reports.run_method import adjustment, method, traceability
from jointstiff.service.reports.run_results import assessment, results, uncertainty
from jointstiff.service.reports.wording import NOT_STATED, moment
from jointstiff.service.tables.requested import requested
from jointstiff.service.tables.table import text_table

MAX_ATTACHED_BYTES: Final = 2_500_000
"""JSON of a run that is attached whole; it takes a quarter of that in the PDF."""
TITLE: Final = "Report on joint stiffness"
_BY_OBSERVATION: Final = ("residuals", "contributions", "encoder_residuals")


@dataclass(frozen=True, eq=False)
class RunSubject:
    """A run to report on."""

    model: ExportedModel  # the run with its robot
    readings: MeasurementSetDocument  # the measurement set; of its observations only the postures are drawn
    settings: LaboratorySettings  # settings of the laboratory
    received_on: date | None = None  # when the item was received
    alarms: Sequence[str] = ()  # alarms of the robot, that nobody has acknowledged

    def run_json(self) -> bytes:
        """Return the run as it is attached: a large one without what it says of each observation."""
        run = self.model.run
        whole = run.model_dump_json().encode()
        if len(whole) <= MAX_ATTACHED_BYTES or run.result is None:
            return whole
        less = run.result.model_copy(update={name: [] for name in _BY_OBSERVATION})
        return run.model_copy(update={"result": less}).model_dump_json().encode()

    def stated(self) -> dict[str, Any]:
        """Return what a report states beside the run, which never changes."""
        laboratory, logo = self.settings.laboratory, self.settings.logo
        fields = set(SetMetadata.model_fields)
        return {
            "run": [self.model.run.id, self.model.run.provenance.input_hash],
            "robot": self.model.name,
            "set": self.readings.name,
            "metadata": self.readings.model_dump(mode="json", include=fields, exclude_none=True),
            "laboratory": None
            if laboratory is None
            else laboratory.model_dump(mode="json", exclude_defaults=True),
            "logo": None if logo is None else [logo.kind, b64encode(logo.content).decode()],
            "received_on": None if self.received_on is None else self.received_on.isoformat(),
            "alarms": list(self.alarms),
        }

    def content_hash(self) -> str:
        """Return the SHA-256 of what a report states."""
        return hashlib.sha256(json.dumps(self.stated(), sort_keys=True).encode()).hexdigest()

    def as_stated(self, stated: Mapping[str, Any]) -> RunSubject:
        """Return the run as an authorised report stated it, whatever was changed since."""
        noted = SetMetadata.model_validate(stated["metadata"])
        changes = {name: getattr(noted, name) for name in SetMetadata.model_fields}
        laboratory, logo = stated["laboratory"], stated["logo"]
        received_on = stated["received_on"]
        return RunSubject(
            replace(self.model, name=stated["robot"]),
            self.readings.model_copy(update={**changes, "name": stated["set"]}),
            LaboratorySettings(
                None if laboratory is None else Laboratory.model_validate(laboratory),
                None if logo is None else Logo(b64decode(logo[1]), logo[0]),
            ),
            None if received_on is None else date.fromisoformat(received_on),
            stated["alarms"],
        )


def run_document(subject: RunSubject, state: State) -> Document:
    """Return the report of a run. The same run, metadata, settings and state give the same document."""
    run = subject.model.run
    return Document(
        title=TITLE,
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
            assessment(subject.model.result, subject.alarms),
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
            ("Condition of the item", readings.item_condition or NOT_STATED),
            (
                "Date of receipt",
                NOT_STATED if subject.received_on is None else subject.received_on.isoformat(),
            ),
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
