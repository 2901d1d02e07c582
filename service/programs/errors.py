"""The one error of reading programs: what was not understood, each with its line and what to do."""

from __future__ import annotations

from dataclasses import dataclass

MAX_FAULTS = 20
"""Faults that one refusal lists."""
_MAX_SHOWN = 60


def shown(text: str) -> str:
    """Return text from outside, quoted, escaped and short enough for a message."""
    text = text.strip()
    return ascii(text if len(text) <= _MAX_SHOWN else text[:_MAX_SHOWN] + "...")


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that was not understood.

    Attributes:
        file: name of the file.
        line: line of the file, from 1; None for the whole file.
        reason: what is wrong, in a sentence.
        remedy: what to do.
    """

    file: str
    line: int | None
    reason: str
    remedy: str

    def __str__(self) -> str:
        place = shown(self.file) if self.line is None else f"{shown(self.file)}, line {self.line}"
        return f"{place}: {self.reason}; {self.remedy}"


class ProgramError(Exception):
    """Raise when a program is not understood as a whole; nothing of it is taken then.

    Attributes:
        faults: the first ones, at most MAX_FAULTS.
        count: how many there are.
    """

    def __init__(self, faults: tuple[Fault, ...], count: int) -> None:
        super().__init__(faults, count)
        self.faults = faults
        self.count = count

    def __str__(self) -> str:
        rest = self.count - len(self.faults)
        return "\n".join([*map(str, self.faults)] + ([f"... and {rest} more"] if rest else []))
