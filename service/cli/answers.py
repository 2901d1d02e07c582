"""Error output of commands: the reason, the remedy, and exit status 2; and files that they write."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from jointstiff.schemas.problem import Problem


def refusal_of(error: Exception) -> typer.Exit | None:
    """Show an error that says how to mend it; to be raised. None for another error."""
    if isinstance(error, OSError) and error.filename is not None:
        return failed(f"cannot open {error.filename}: {error.strerror}", "choose another path")
    if not type(error).__module__.startswith("jointstiff."):
        return None
    from jointstiff.service.library.errors import ProblemError
    from jointstiff.service.problems.errors import ServiceError

    if isinstance(error, ProblemError):
        return refused(error.problem)
    return failed(error.reason, error.remedy) if isinstance(error, ServiceError) else None


def refused(problem: Problem) -> typer.Exit:
    """Show a problem as the API would answer it; to be raised."""
    from jointstiff.service.tables.terminal import console, problem_text

    console(stderr=True).print(problem_text(problem))
    return typer.Exit(2)


def failed(reason: str, remedy: str) -> typer.Exit:
    """Show what is in the way outside of the request; to be raised."""
    from jointstiff.service.tables.terminal import console

    console(stderr=True).print(f"{reason}\n  remedy: {remedy}", style="red", markup=False, soft_wrap=True)
    return typer.Exit(2)


def warn(message: str) -> None:
    """Show what the user should know while it goes on."""
    from jointstiff.service.tables.terminal import console

    console(stderr=True).print(message, style="yellow", markup=False, soft_wrap=True)


def refuse_existing(path: Path, *, overwrite: bool) -> None:
    """Refuse to replace a file unasked.

    Raises:
        typer.Exit: it is there.
    """
    if path.exists() and not overwrite:
        raise failed(f"{path} exists", "choose another name, or --overwrite")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file.

    Raises:
        typer.Exit: it cannot be written.
    """
    try:
        path.write_bytes(content)
    except OSError as error:
        raise failed(f"cannot write {path}: {error.strerror}", "choose another path") from error


def write_text(path: Path, text: str) -> None:
    """Write a file of lines.

    Raises:
        typer.Exit: it cannot be written.
    """
    write_bytes(path, f"{text}\n".encode())
