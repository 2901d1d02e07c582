"""Collections of resources as a client sees them: create, get, list, delete; and wait for jobs."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Final, Generic, TypeVar, cast
from urllib.parse import quote

import httpx2

from jointstiff.schemas.fields import Message, Page
from jointstiff.schemas.finding import Action
from jointstiff.schemas.job import Progress
from jointstiff.schemas.program import Program, ProgramSummary
from jointstiff.schemas.run.run import RunSummary
from jointstiff.service.kinds.kind import AnyJob, AnySummary, Kind
from jointstiff.service.kinds.run import RUN
from jointstiff.service.library.answers import resource_in
from jointstiff.service.library.errors import AwayError, RefusedError
from jointstiff.service.library.results import TabledRun, shown

_LOOK_SECONDS: Final = 0.2
_GONE: Final = frozenset({404, 410})

Document = Message | Mapping[str, Any]
Resource = TypeVar("Resource", bound=Message)
Summary = TypeVar("Summary", bound=Message)
Send = Callable[..., httpx2.Response]


def plain(document: Document) -> dict[str, Any]:
    """Return a document as JSON objects, with the fields that were set."""
    if isinstance(document, Message):
        return document.model_dump(mode="json", exclude_unset=True)
    return dict(document)


class Collection(Generic[Resource, Summary]):
    """Resources of one kind."""

    _posted_with: ClassVar[Mapping[str, str] | None] = None

    def __init__(self, send: Send, name: str, kind: type[Resource], summary: type[Summary]) -> None:
        self._send, self._path, self._kind, self._summary = send, f"/v1/{name}", kind, summary

    def create(self, document: Document, *, key: str | None = None) -> Resource:
        """Post a document; return the resource that it became."""
        answer = self._send("POST", self._path, self._posted_with, document, key=key)
        return self._in(answer)

    def once(self, document: Document) -> Resource:
        """Post a document unless it was posted before and is still there: its content is the key."""
        content = json.dumps(plain(document), sort_keys=True)
        posted, mark = json.loads(content), content
        while True:
            resource: Any = self.create(posted, key=hashlib.sha256(mark.encode()).hexdigest())
            if self._is_there(resource.id):
                return cast("Resource", resource)
            mark += resource.id  # the key belongs to the deleted one for ever

    def _is_there(self, identifier: str) -> bool:
        """Return whether a resource was not deleted; HEAD does not say why it is refused, so GET does."""
        try:
            self._send("HEAD", self._address(identifier))
        except AwayError:
            raise
        except RefusedError:
            try:
                self._send("GET", self._address(identifier))
            except RefusedError as refused:
                if refused.problem.status not in _GONE:
                    raise
                return False
        return True

    def get(self, identifier: str) -> Resource:
        """Return a resource."""
        return self._in(self._send("GET", self._address(identifier)))

    def _in(self, answer: httpx2.Response) -> Resource:
        return resource_in(answer, self._kind)

    def list(self, **filters: str) -> Iterator[Summary]:
        """Yield summaries of the resources, newest first; filters are those of the API."""
        query: dict[str, str] | None = filters
        while query is not None:
            page = resource_in(self._send("GET", self._path, query), Page[self._summary])  # type: ignore[name-defined]
            yield from page.items
            query = None if page.next is None else filters | {"cursor": page.next}

    def change(self, identifier: str, changes: Document) -> None:
        """Change what may change of a robot or a measurement set: its name, metadata, archive."""
        self._send("PATCH", self._address(identifier), None, changes)

    def delete(self, identifier: str) -> None:
        """Delete a resource."""
        self._send("DELETE", self._address(identifier))

    def _address(self, identifier: str) -> str:
        return f"{self._path}/{quote(identifier, safe='')}"


class Jobs(Collection[AnyJob, AnySummary]):
    """Jobs of one kind: resources that may take long; `create` returns after a second at most."""

    _posted_with = MappingProxyType({"wait": "1"})

    def __init__(self, send: Send, kind: Kind[AnyJob, Any, AnySummary]) -> None:
        super().__init__(send, kind.collection, shown(kind), kind.summary)

    def done(self, document: Document, on_progress: Callable[[Progress], object] | None = None) -> AnyJob:
        """Post a request, and return the job once it has ended."""
        return self.wait(self.create(document), on_progress)

    def wait(self, job: AnyJob, on_progress: Callable[[Progress], object] | None = None) -> AnyJob:
        """Wait for the end of a job; return it as it is then."""
        while job.state in {"queued", "running"}:
            if on_progress is not None and job.progress is not None:
                on_progress(job.progress)
            time.sleep(_LOOK_SECONDS)
            job = self.get(job.id)
        return job


class Runs(Jobs[TabledRun, RunSummary]):
    """Runs: what they `apply`, `export` and `report` goes over the service."""

    def __init__(self, send: Send) -> None:
        super().__init__(send, cast("Kind[TabledRun, Any, RunSummary]", RUN))

    def apply(self, run: TabledRun, action: Action) -> TabledRun:
        """Post an action of the assessment of a run; return the run of what it changes once it has ended."""
        address = f"{self._address(run.id)}/apply"
        return self.wait(self._in(self._send("POST", address, self._posted_with, action)))

    def file(self, run: TabledRun, name: str, query: Mapping[str, str]) -> bytes:
        """Return a file of a run, such as `model.urdf` or `report.pdf`."""
        content: bytes = self._send("GET", f"{self._address(run.id)}/{name}", query).content
        return content

    def _in(self, answer: httpx2.Response) -> TabledRun:
        return super()._in(answer).over(self)


Files = Iterable[str | Path] | Mapping[str, bytes]
"""Paths of files, or contents by name."""


class Programs(Jobs[Program, ProgramSummary]):
    """Compensated programs."""

    def create(self, document: Document, *, key: str | None = None, files: Files = ()) -> Program:
        """Post a program with its options; return it after a second at most.

        Args:
            document: options with `run_id`, as `POST /v1/programs` takes them.
            key: idempotency key; one of its own if absent.
            files: the program, with its .dat if it has one, and the table of loads.
        """
        contents = _contents(files)
        answer = self._send("POST", self._path, self._posted_with, document, key=key, files=contents)
        return resource_in(answer, Program)

    def compensate(
        self, files: Files, options: Document, on_progress: Callable[[Progress], object] | None = None
    ) -> Program:
        """Post a program, and return it once it is corrected; `files` has what it became.

        Args:
            files: the program, with its .dat if it has one, and the table of loads.
            options: with `run_id`, as `POST /v1/programs` takes them.
            on_progress: called with the progress of a long program.
        """
        return self.wait(self.create(options, files=files), on_progress)

    def files(self, program: Program) -> dict[str, bytes]:
        """Return the corrected files by name."""
        address = f"{self._address(program.id)}/program"
        names = [] if program.result is None else [file.name for file in program.result.files]
        return {name: self._send("GET", address, {"file": name}).content for name in names}

    def points(self, program: Program) -> str:
        """Return all points as CSV."""
        text: str = self._send("GET", f"{self._address(program.id)}/points.csv").text
        return text


def _contents(files: Files) -> dict[str, bytes]:
    if isinstance(files, Mapping):
        return dict(files)
    return {Path(path).name: Path(path).read_bytes() for path in files}
