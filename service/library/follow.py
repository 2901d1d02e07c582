"""Progress and cancelling of work: what a caller asks for, or a bar where someone looks."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Final, Self

from jointstiff.schemas.job import Progress

OnProgress = Callable[[Progress], object]
Cancel = Callable[[], object]
SHOWN_AFTER: Final = 2.0
"""Work of less time shows no bar [s]."""


class Follow:
    """Follow a job to its end: by the functions of the caller, or by a bar where someone looks."""

    def __init__(self, on_progress: OnProgress | None = None, cancel: Cancel | None = None) -> None:
        """Follow by these; without `on_progress` by a bar, where someone looks and the work takes long."""
        self._on_progress, self._cancel = on_progress, cancel
        self._began, self._bar, self._task = time.monotonic(), None, None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    _bar: Any
    _task: Any

    @property
    def cancelled(self) -> bool:
        """Return whether the caller wants no more."""
        return self._cancel is not None and bool(self._cancel())

    def __call__(self, progress: Progress) -> None:
        """Tell how far the work is."""
        if self._on_progress is not None:
            self._on_progress(progress)
        elif _is_watched() and time.monotonic() - self._began > SHOWN_AFTER:
            self._show(progress)

    def _show(self, progress: Progress) -> None:
        if self._bar is None:
            from jointstiff.service.tables.terminal import new_bar

            self._bar = new_bar()
            self._task = self._bar.add_task(progress.activity, total=progress.total)
            self._bar.start()
        self._bar.update(
            self._task, description=progress.activity, total=progress.total, completed=progress.done
        )


def _is_watched() -> bool:
    """Return whether a person sees the standard error: in a terminal, or in a notebook."""
    return sys.stderr.isatty() or "ipykernel" in sys.modules
