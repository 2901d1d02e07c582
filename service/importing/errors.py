"""The one error of importing: a file that was not understood, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from jointstiff.schemas.imports import MAX_FAULTS

_MAX_SHOWN = 60


def shown(text: str) -> str:
    """Text from outside, quoted, escaped and short enough for a message."""
    return repr(text if len(text) <= _MAX_SHOWN else text[:_MAX_SHOWN] + "…")


class Place(NamedTuple):
    """Somewhere in the files."""

    file: str | None = None  # name of the file, as it was sent; None for all files together
    line: int | None = None  # line of a text file or row of a sheet, from 1
    column: int | None = None  # column of the table, from 1

    def __str__(self) -> str:
        parts = [] if self.file is None else [shown(self.file)]
        parts += [f"line {self.line}"] if self.line is not None else []
        parts += [f"column {self.column}"] if self.column is not None else []
        return ", ".join(parts)


NOWHERE = Place()


class ImportFileError(Exception):
    """A file that cannot be understood, or only in more than one way."""

    def __init__(
        self, place: Place, reason: str, remedy: str, option: str | None = None, words: tuple[str, ...] = ()
    ) -> None:
        super().__init__(reason, remedy)
        self.place = place  # where, as far as it is one place
        self.reason = reason  # what is wrong, in a sentence
        self.remedy = remedy  # how to mend it
        self.option = option  # that settles it, if one does
        self.words = words  # of the files that the option is about

    def __str__(self) -> str:
        place = str(self.place)
        return f"{place + ': ' if place else ''}{self.reason}; {self.remedy}"

    def at(self, place: Place) -> ImportFileError:
        """Give it a place, if it has none, and return it."""
        self.place = place if self.place == NOWHERE else self.place
        return self


class Faults:
    """The faults of all files, collected so that one answer has all of them."""

    def __init__(self, most: int = MAX_FAULTS) -> None:
        self.found: list[ImportFileError] = []  # in their order
        self.most = most  # how many are kept

    @property
    def full(self) -> bool:
        """Return whether no more are kept: to look for more is in vain."""
        return len(self.found) >= self.most

    def add(self, fault: ImportFileError) -> None:
        """Keep a fault once, if there are not as many as are shown."""
        known = any((one.place, one.reason) == (fault.place, fault.reason) for one in self.found)
        if not self.full and not known:
            self.found.append(fault)

    def report(
        self, place: Place, reason: str, remedy: str, option: str | None = None, words: tuple[str, ...] = ()
    ) -> None:
        """Keep the fault that these words describe."""
        self.add(ImportFileError(place, reason, remedy, option, words))

    @contextmanager
    def collected(self, place: Place = NOWHERE) -> Iterator[None]:
        """Keep the fault that ends the block; it is at this place if it has none."""
        try:
            yield
        except ImportFileError as fault:
            self.add(fault.at(place))
