"""Rows of today's tables, made from the lines of an archive: raised to today's shape, and validated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Annotated, Any, Final

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, TypeAdapter
from pydantic_core import to_json

from jointstiff.schemas import live
from jointstiff.schemas.fields import Identifier, Message, Name
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.measurement import ResolvedFrame, SetMetadata, StoredMeasurementSet
from jointstiff.schemas.robot import MAX_MARKS, Mark, StoredRobot
from jointstiff.service.archive.arrays import pack_arrays
from jointstiff.service.conversion.readings import ReadingArrays
from jointstiff.service.history.raising import raise_document
from jointstiff.service.history.steps import NEWEST
from jointstiff.service.jobs import make_record
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.kinds.retired import RETIRED
from jointstiff.service.live.campaign import Entry
from jointstiff.service.store.tables import (
    AccessKey,
    AuditEntry,
    LiveEntry,
    MeasurementSetRecord,
    OpenSetRecord,
    RobotRecord,
)

_KINDS: Final = MappingProxyType({kind.name: kind for kind in (*KINDS, *RETIRED)})
_ENTRY: Final[TypeAdapter[Any]] = TypeAdapter(Entry)
_FINDINGS: Final = TypeAdapter(list[Finding])
_METADATA: Final = frozenset(SetMetadata.model_fields)


class _Line(BaseModel):
    """A line of an archive; columns of other layouts are ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    schema_version: int = Field(alias="schema", ge=1, le=NEWEST)


class _DocumentLine(_Line):
    """A line of a table with documents."""

    id: Identifier
    created_at: AwareDatetime
    deleted_at: AwareDatetime | None = None
    document: dict[str, Any]


class _RobotLine(_DocumentLine):
    name: Name
    content_hash: str
    marks: Annotated[list[Mark], Field(max_length=MAX_MARKS)] | None = None
    reference_set_ids: Annotated[list[Identifier], Field(max_length=MAX_MARKS)] | None = None


class _SetLine(_DocumentLine):
    name: Name
    robot_id: Identifier
    content_hash: str
    arrays: dict[str, Any]


class _OpenSetLine(_DocumentLine):
    name: Name
    robot_id: Identifier
    resolved: dict[str, Any] | None = None
    warnings: list[Any] = Field(default_factory=list)


class _JobLine(_DocumentLine):
    kind: str
    robot_id: Identifier | None = None


class _LiveEntryLine(_Line):
    set_id: Identifier
    change: str
    label: str
    noted_at: AwareDatetime
    key_name: str | None = None
    document: dict[str, Any]


class _KeyLine(_Line):
    id: Identifier
    name: Name
    role: str = Field(pattern="^(viewer|operator|admin)$")
    key_hash: str | None = None
    created_at: AwareDatetime
    expires_at: AwareDatetime | None = None
    revoked_at: AwareDatetime | None = None
    last_used_at: AwareDatetime | None = None


class _IdempotencyLine(_Line):
    resource: str
    key_hash: str
    body_hash: str
    resource_id: str
    created_at: AwareDatetime


class _AuditLine(_Line):
    at: AwareDatetime
    key_id: str | None = None
    key_name: str | None = None
    address: str
    method: str
    operation: str | None = None
    path: str
    status: int


@dataclass(frozen=True)
class Built:
    """A row of a table of today, without the copies of names."""

    values: dict[str, Any]  # column → value
    dropped: tuple[str, ...] = ()  # fields of the document that have no place in today's shape


@dataclass(frozen=True)
class _Checked:
    """The document of a line, raised to today's shape and validated."""

    message: Any  # of the class of the document
    text: str  # JSON
    dropped: tuple[str, ...]


def _check_document(
    kind: str, message: type[Message], line: _DocumentLine, exclude: frozenset[str] = frozenset()
) -> _Checked:
    """Raise and validate the document of a line.

    Args:
        kind: kind of the document.
        message: class of the document.
        line: the line.
        exclude: fields that are not stored in the document.

    Raises:
        ValueError: the document cannot be used.
    """
    if line.document.get("id", line.id) != line.id:
        raise ValueError("its document has another id")
    raised = raise_document(kind, line.document, line.schema_version)
    text = to_json(raised.document)
    validated = message.model_validate_json(text)
    if line.schema_version < NEWEST:
        text = validated.model_dump_json(exclude=set(exclude)).encode()
    return _Checked(validated, text.decode(), raised.dropped)


def _build_robot(values: Mapping[str, Any]) -> Built:
    """Return the row of a robot."""
    line = _RobotLine.model_validate(values)
    checked = _check_document("robot", StoredRobot, line, frozenset({"last_campaign"}))
    record = RobotRecord(
        id=line.id,
        name=line.name,
        created_at=line.created_at,
        content_hash=line.content_hash,
        summary=checked.message.model_dump(mode="json", include={"joints", "nominal_arm"}),
        document=checked.text,
        **line.model_dump(mode="json", include={"marks", "reference_set_ids"}),
    )
    return Built(asdict(record) | {"deleted_at": line.deleted_at}, checked.dropped)


def _build_set(values: Mapping[str, Any]) -> Built:
    """Return the row of a measurement set."""
    line = _SetLine.model_validate(values)
    metadata = SetMetadata.model_validate({name: values[name] for name in _METADATA & values.keys()})
    checked = _check_document("measurement_set", StoredMeasurementSet, line, _METADATA)
    arrays = pack_arrays(line.arrays)
    record = MeasurementSetRecord(
        id=line.id,
        robot_id=line.robot_id,
        name=line.name,
        encoders=checked.message.encoders,
        observation_count=len(ReadingArrays.unpack(arrays).labels),
        warning_count=len(checked.message.warnings),
        created_at=line.created_at,
        content_hash=line.content_hash,
        document=checked.text,
        arrays=arrays,
        **{name: getattr(metadata, name) for name in _METADATA},
    )
    return Built(asdict(record) | {"deleted_at": line.deleted_at}, checked.dropped)


def _build_open_set(values: Mapping[str, Any]) -> Built:
    """Return the row of the declaration of a live campaign."""
    line = _OpenSetLine.model_validate(values)
    checked = _check_document("open_set", live.MeasurementSetPost, line)
    resolved = None
    if line.resolved is not None:
        resolved = ResolvedFrame.model_validate(line.resolved).model_dump_json()
    findings = raise_document("findings", {"warnings": line.warnings}, line.schema_version)
    warnings = _FINDINGS.validate_json(to_json(findings.document["warnings"]))
    record = OpenSetRecord(
        id=line.id,
        robot_id=line.robot_id,
        name=line.name,
        created_at=line.created_at,
        document=checked.text,
        resolved=resolved,
        warnings=_FINDINGS.dump_json(warnings).decode(),
    )
    return Built(asdict(record) | {"deleted_at": line.deleted_at}, checked.dropped + findings.dropped)


def _build_live_entry(values: Mapping[str, Any]) -> Built:
    """Return the row of an entry of a live campaign."""
    line = _LiveEntryLine.model_validate(values)
    raised = raise_document("live_entry", line.document, line.schema_version)
    entry = _ENTRY.validate_json(to_json(raised.document))
    record = LiveEntry(
        set_id=line.set_id,
        change=line.change,
        label=line.label,
        noted_at=line.noted_at,
        key_name=line.key_name,
        document=_ENTRY.dump_json(entry).decode(),
    )
    return Built(asdict(record), raised.dropped)


def _build_job(values: Mapping[str, Any]) -> Built:
    """Return the row of a job, with the columns that are derived from its document."""
    line = _JobLine.model_validate(values)
    if line.kind not in _KINDS:
        raise ValueError(f"this version has no kind of work '{line.kind}'")
    kind = _KINDS[line.kind]
    checked = _check_document(line.kind, kind.message, line)
    row = asdict(make_record(kind, checked.message, line.robot_id))
    return Built(row | {"document": checked.text, "deleted_at": line.deleted_at}, checked.dropped)


def _build_key(values: Mapping[str, Any]) -> Built | None:
    """Return the row of an access key; None for a key without its hash, which could open nothing."""
    line = _KeyLine.model_validate(values)
    if line.key_hash is None:
        return None
    fields = line.model_dump(exclude={"schema_version"})
    return Built(asdict(AccessKey(**fields)))


def _build_idempotency_key(values: Mapping[str, Any]) -> Built:
    """Return the row of an idempotency key."""
    return Built(_IdempotencyLine.model_validate(values).model_dump(exclude={"schema_version"}))


def _build_audit_entry(values: Mapping[str, Any]) -> Built:
    """Return the row of an entry of the audit."""
    line = _AuditLine.model_validate(values)
    return Built(asdict(AuditEntry(**line.model_dump(exclude={"schema_version"}))))


BUILDERS: Final[Mapping[str, Callable[[Mapping[str, Any]], Built | None]]] = MappingProxyType(
    {
        "robots": _build_robot,
        "measurement_sets": _build_set,
        "open_sets": _build_open_set,
        "live_entries": _build_live_entry,
        "jobs": _build_job,
        "access_keys": _build_key,
        "idempotency_keys": _build_idempotency_key,
        "audit": _build_audit_entry,
    }
)
"""Table → function that makes a row of a line, or None for a line that is not meant to be restored.

It raises ValueError for a line that cannot be used.
"""
