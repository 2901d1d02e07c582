"""Documents of saved results: their parts, and the messages that are read from them.

A document has the fields of the API's message, and after them what the message only names by an id: a run its
`campaign`, a plan the campaign that the plan `continues`, a map of this process the saved run (`made_from`)
by which its places are computed again, a map or correction of a service its `tables` and `files`.
"""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Any, Final, TypeVar

from pydantic import BeforeValidator, Field

from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import Job
from jointstiff.schemas.run import Campaign
from jointstiff.service.history.raising import raise_document
from jointstiff.service.history.steps import NEWEST
from jointstiff.service.kinds.rooms import import_kind
from jointstiff.service.resources.documents import parse_document
from jointstiff.service.tables.table import Sheet

AnyMessage = TypeVar("AnyMessage", bound=Message)
_VERSION: Final = "schema"
"""Field of a document: version of its documents; documents of earlier versions do not have the field."""
_CAMPAIGNS: Final = frozenset({"campaign", "continues"})
"""Parts of a saved job that are campaigns."""


def _decode(text: object) -> bytes:
    """Return the bytes of a text in base64; raise ValueError for another text."""
    return b64decode(str(text), validate=True)


_Content = Annotated[bytes, BeforeValidator(_decode)]


class _SavedTable(Message):
    """Table of a job of a service: values by header, and the headers of columns of text."""

    columns: dict[str, list[float | int | str | bool | None]]
    texts: list[str]


class SavedParts(Message):
    """Parts of a saved job that are not fields of its message."""

    campaign: Campaign | None = None
    continues: Campaign | None = None
    made_from: dict[str, Any] | None = None
    tables: dict[str, _SavedTable] = Field(default_factory=dict)
    files: dict[str, _Content] = Field(default_factory=dict)

    def make_sheets(self) -> dict[str, Sheet]:
        """Return the tables by name."""
        return {name: Sheet(part.columns, frozenset(part.texts)) for name, part in self.tables.items()}


@dataclass(frozen=True)
class SavedJob:
    """Job of a document, with the parts that its message only names."""

    job: Job
    parts: SavedParts


def with_version(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a document with the version of today's documents."""
    return {**fields, _VERSION: NEWEST}


def parse_message(document: Mapping[str, Any], message: type[AnyMessage]) -> AnyMessage:
    """Return the message of a document of a result that is no job.

    Raises:
        CampaignError: the document is no such result.
    """
    fields = dict(document)
    version = _take_version(fields)
    kind = str(fields.pop("kind"))
    return parse_document(_raise_part(kind, fields, version), message)


def parse_job(document: Mapping[str, Any]) -> SavedJob:
    """Return the job of a document, of a kind of work.

    Raises:
        CampaignError: the document is no such job.
    """
    fields = dict(document)
    version = _take_version(fields)
    kind = str(fields["kind"])
    fields = _raise_part(kind, fields, version)
    saved = {part: fields.pop(part) for part in SavedParts.model_fields if part in fields}
    for part in _CAMPAIGNS & saved.keys():
        saved[part] = _raise_part("campaign", saved[part], version)
    parts = parse_document(saved, SavedParts)
    if parts.campaign is not None and isinstance(fields.get("request"), dict):
        # The options are those of the campaign: there, options that nobody stated keep their defaults, which
        # other options may change.
        ids = {name: fields["request"].get(name) for name in ("measurement_set_id", "variant_of")}
        fields["request"] = ids | parts.campaign.run.model_dump(mode="json", exclude_unset=True)
    return SavedJob(parse_document(fields, import_kind(kind).message), parts)


def _take_version(fields: dict[str, Any]) -> int | None:
    """Remove the version from the fields of a document, and return it; None without a version."""
    version = fields.pop(_VERSION, None)
    return version if isinstance(version, int) else None


def _raise_part(kind: str, part: Any, version: int | None) -> Any:  # noqa: ANN401 - any JSON
    """Return a part of a document, raised to today's shape; unchanged if it cannot be raised."""
    if not isinstance(part, dict):
        return part
    with suppress(ValueError):  # the checks of today's shape name what is wrong
        return raise_document(kind, part, version).document
    return part


def describe_contents(tables: Mapping[str, Sheet], files: Mapping[str, bytes]) -> dict[str, Any]:
    """Return the fields of a document for tables and files that the message of a job leaves out."""
    described = {
        name: {
            "columns": {head: list(values) for head, values in sheet.columns.items()},
            "texts": sorted(sheet.texts),
        }
        for name, sheet in tables.items()
    }
    contents = {name: b64encode(content).decode() for name, content in files.items()}
    return {key: value for key, value in (("tables", described), ("files", contents)) if value}
