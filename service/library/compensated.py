"""Compensated programs as a client sees them: files in, files out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from jointstiff.schemas.job import Progress
from jointstiff.schemas.program import Program, ProgramSummary
from jointstiff.service.library.answers import resource_in
from jointstiff.service.library.collections import Document, Jobs

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
