"""The text of programs: read by `robotprograms` and marked as corrected, with errors of the request."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from datetime import date
from typing import Final

import robotprograms
from jointstiff.service.problems import FilesError
from robotprograms import ExternalAxes, Fault, Program, ProgramError, ReadMove

MARK: Final = "Jointstiff run "
"""Beginning of the mark: a comment that keeps a corrected program from being corrected again."""


class FaultsError(FilesError):
    """Error that a program is not understood or cannot be corrected; the whole program is then refused.

    Attributes:
        faults: the first faults.
        count: number of all faults.
        left_moves: moves that cannot be corrected.
    """

    def __init__(
        self, faults: Sequence[Fault], count: int | None = None, left: Sequence[ReadMove] = ()
    ) -> None:
        """Build the error of a request with the faults that the readers of programs found.

        Its text lists the faults in lines, as that of a `ProgramError` does; its fields have the first fault.

        Args:
            faults: faults of the program, each with place, reason and remedy.
            count: count of all faults, if only the first ones are given.
            left: moves that are not corrected.
        """
        cause = ProgramError(faults, count, left)
        self.faults, self.count, self.left_moves = cause.faults, cause.count, cause.left_moves
        self._text = str(cause)
        first = faults[0]
        more = f", and {self.count - 1} more" if self.count > 1 else ""
        items = [(fault.place, fault.reason, fault.remedy) for fault in self.faults]
        super().__init__(
            f"{first.place}: {first.reason}{more}", remedy=first.remedy, where=first.place, items=items
        )

    def __str__(self) -> str:
        return self._text


@contextmanager
def as_request_errors() -> Iterator[None]:
    """Raise errors of the readers as a `FaultsError`, which refuses the request."""
    try:
        yield
    except ProgramError as error:
        raise FaultsError(error.faults, error.count, error.left_moves) from error


def read_program(
    files: Sequence[tuple[str, bytes]],
    name: str | None = None,
    leave_alone: Collection[str] = (),
    *,
    leave_others: bool = False,
    external_axes: ExternalAxes = ExternalAxes.MAY_CARRY,
    trust_routines: bool = False,
) -> Program:
    """Read a program that was not corrected yet, as `robotprograms.read_program` does.

    Raises:
        FaultsError: the program is not understood or was corrected already; or a move is not certain,
            and `leave_others` is false.
    """
    _refuse_marked(files)
    with as_request_errors():
        return robotprograms.read_program(
            files,
            name,
            leave_alone,
            leave_others=leave_others,
            external_axes=external_axes,
            trust_routines=trust_routines,
        )


def list_moves(
    files: Sequence[tuple[str, bytes]],
    name: str | None,
    leave_alone: Collection[str],
    external_axes: str | None,
    *,
    trust_routines: bool,
) -> list[ReadMove]:
    """Return all moves of a program in order of lines, with target, base, tool and whether each is corrected.

    `external_axes` is the option of the request; None means that the axes may carry arm or part.

    Raises:
        FaultsError: the program is not understood, or was corrected already.
    """
    _refuse_marked(files)
    axes = ExternalAxes.MAY_CARRY if external_axes is None else ExternalAxes(external_axes)
    with as_request_errors():
        return robotprograms.list_moves(files, name, leave_alone, axes, trust_routines=trust_routines)


def _refuse_marked(files: Sequence[tuple[str, bytes]]) -> None:
    """Refuse a program with the mark of a correction: it must not be corrected a second time.

    Raises:
        FaultsError: a file has the mark.
    """
    for name, content in files:
        offset = content.find(MARK.encode())
        has_mark = offset >= 0
        if not has_mark:
            continue
        line = robotprograms.Source.from_bytes(name, content).find_line(offset)
        reason = (
            "the program states that it was corrected already; a second correction would be added to "
            "the first"
        )
        remedy = "send the original program; if the statement is wrong, remove this line"
        raise FaultsError([Fault(name, line, reason, remedy)])


def insert_mark(
    kind: str, content: bytes, run_id: str, verdict: str, day: date, moves: int = 0, left: int = 0
) -> bytes:
    """Insert a comment into a corrected program that marks the program as corrected; return the new bytes.

    Args:
        kind: name of the format.
        content: bytes of the corrected program.
        run_id: id of the run whose model was used.
        verdict: verdict on the corrected program.
        day: date of the correction.
        moves: number of moves of the program, which the mark states if some are left.
        left: number of moves that are left.
    """
    words = [f"corrected {day.isoformat()}", f"verdict: {verdict.replace('_', ' ')}"]
    if kind == "fanuc":  # each remark has 32 characters at most: short words, several remarks
        remarks = [f"{MARK}{run_id[:8]}", *words]
        if left:
            remarks += [f"{moves - left} of {moves} corrected", f"{left} moves left"]
    else:
        if left:
            words.append(f"{moves - left} of {moves} moves corrected, {left} left")
        remarks = [f"{MARK}{run_id} {', '.join(words)}"]
    return robotprograms.insert_comment(kind, content, remarks)
