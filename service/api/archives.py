"""Archive and restore of the whole database, for the page: no part of the described API."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from typing import Annotated, Final, Protocol

from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, HTTPException, Query, Request
from fastapi.responses import StreamingResponse

from jointstiff.service.api.bodies import require_media_type
from jointstiff.service.problems import RoleError
from jointstiff.service.security.access import OPERATOR, AccessRoute, get_requester

ARCHIVE_TYPE: Final = "application/zip"
REPORTS_TYPE: Final = "application/x-ndjson"


class Archives(Protocol):
    """Archives of the database of a service."""

    def stream(self) -> Iterator[bytes]:
        """Yield an archive while it is written."""

    def restore(self, path: Path, *, dry_run: bool) -> Iterator[bytes]:
        """Yield reports about the restore of a file, in lines of JSON."""


async def _require_owner(request: Request) -> None:
    """Refuse a requester who may not copy or add records of any kind.

    A service with keys needs an admin key. Without keys, the service must answer only its own machine.

    Raises:
        RoleError: the requester is no administrator, or nobody can tell.
    """
    requester = get_requester(request)
    if not requester.is_open:
        requester.require_role("admin")
    elif request.app.state.access == "none":
        raise RoleError(
            "archives need an admin key, but this service leaves access control to a proxy",
            "use `jointstiff archive` and `jointstiff restore` where the service runs",
        )


def _get_archives(request: Request) -> Archives:
    """Return the archives of the application's database."""
    archives: Archives | None = request.app.state.archives
    if archives is None:
        raise HTTPException(404, "this service has no database to archive")
    return archives


InjectedArchives = Annotated[Archives, Depends(_get_archives)]

router = APIRouter(
    prefix="/v1",
    route_class=AccessRoute,
    include_in_schema=False,
    dependencies=[OPERATOR, Depends(_require_owner)],
)


@router.get("/archive")
def get_archive(archives: InjectedArchives) -> StreamingResponse:
    """Get all records but keys as an archive, which is streamed while it is written."""
    pieces = archives.stream()
    first = next(pieces)  # a database that cannot be archived is refused before the answer begins
    name = f"jointstiff-{datetime.now(UTC):%Y-%m-%d}.zip"
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return StreamingResponse(chain([first], pieces), media_type=ARCHIVE_TYPE, headers=headers)


@router.post("/restores")
async def restore_archive(
    request: Request, archives: InjectedArchives, *, dry_run: Annotated[bool, Query()] = False
) -> StreamingResponse:
    """Restore an archive; reports follow as lines of JSON while it is restored. A dry run changes nothing."""
    require_media_type(request, ARCHIVE_TYPE, "an archive")
    folder = Path(tempfile.mkdtemp(prefix="jointstiff-upload-"))  # only this user can read it
    try:
        path = folder / "archive.zip"
        with path.open("wb") as file:
            async for piece in request.stream():
                await run_sync(file.write, piece)
        reports = archives.restore(path, dry_run=dry_run)
        first = await run_sync(lambda: next(reports))
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return StreamingResponse(_iterate_then_remove(first, reports, folder), media_type=REPORTS_TYPE)


def _iterate_then_remove(first: bytes, reports: Iterator[bytes], folder: Path) -> Iterator[bytes]:
    """Yield reports, and remove the folder of the upload at the end."""
    try:
        yield first
        yield from reports
    finally:
        shutil.rmtree(folder, ignore_errors=True)
