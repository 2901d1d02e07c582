"""The audit: who tried to change what, and with which outcome, for admins."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import asdict
from typing import Annotated, Any, Final

from fastapi import APIRouter, Query
from fastapi.responses import StreamingResponse

from jointstiff.schemas.access import AuditItem, AuditQuery
from jointstiff.schemas.fields import Page
from jointstiff.service.api.access import ADMIN, AccessRoute
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.store.store import Store
from jointstiff.service.tables.files import guarded

_PAGE: Final = 1_000
_TABLE: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The audit as CSV (RFC 4180).", "content": {"text/csv": {}}}
}

router = APIRouter(prefix="/v1/audit", tags=["access"], route_class=AccessRoute, dependencies=[ADMIN])


@router.get("", response_model=Page[AuditItem], responses=problems(422))
def list_audit(parts: PartsOf, query: Annotated[AuditQuery, Query()]) -> Page[AuditItem]:
    """List what was asked for by methods that change something, refused or not, newest first."""
    entries, cursor = parts.store.audit.page(query.limit, query.cursor, key_id=query.key_id)
    return Page(items=[AuditItem(**asdict(entry)) for entry in entries], next=cursor)


@router.get("/table.csv", response_class=StreamingResponse, responses=_TABLE | problems())
def get_audit_table(parts: PartsOf) -> StreamingResponse:
    """Get the whole audit as a table for spreadsheets, newest first, times in UTC."""
    return StreamingResponse(
        _table(parts.store),
        media_type="text/csv",
        headers={"Content-Disposition": 'attachment; filename="audit.csv"'},
    )


def _table(store: Store) -> Iterator[str]:
    yield _lines([list(AuditItem.model_fields)])
    cursor = None
    while True:
        entries, cursor = store.audit.page(_PAGE, cursor)
        yield _lines([guarded(value) for value in _cells(asdict(entry))] for entry in entries)
        if cursor is None:
            return


def _cells(entry: dict[str, Any]) -> list[str | float | None]:
    return [entry["at"].isoformat(), *list(entry.values())[1:]]


def _lines(rows: Any) -> str:  # noqa: ANN401
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    return text.getvalue()
