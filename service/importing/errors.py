"""The one error of importing: a file that was not understood, and what to do about it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple

from jointstiff.schemas.imports import MAX_FAULTS

_MAX_SHOWN = 60


def quote(text: str) -> str:
    """Return text of a file in quotation marks, escaped and cut to 60 characters, for a message."""
    return repr(text if len(text) <= _MAX_SHOWN else text[:_MAX_SHOWN] + "…")


def show_object(values: Mapping[str, str]) -> str:
    """Return an option's value with words of a file as JSON, for a remedy."""
    return json.dumps(values, ensure_ascii=False)


class Place(NamedTuple):
    """Place in the files of an import: file, line and column, as far as they are known."""

    file: str | None = None  # name of the file, as it was sent; None for all files together
    line: int | None = None  # line of a text file or row of a sheet, from 1
    column: int | None = None  # column of the table, from 1

    def __str__(self) -> str:
        parts = [] if self.file is None else [quote(self.file)]
        parts += [f"line {self.line}"] if self.line is not None else []
        parts += [f"column {self.column}"] if self.column is not None else []
        return ", ".join(parts)


NOWHERE = Place()


class ImportFileError(Exception):
    """Error that a file cannot be understood, or can be understood in more than one way."""

    def __init__(
        self, place: Place, reason: str, remedy: str, option: str | None = None, words: tuple[str, ...] = ()
    ) -> None:
        super().__init__(reason, remedy)
        self.place = place  # place of the fault; `NOWHERE` if it has no single place
        self.reason = reason  # what is wrong, in a sentence
        self.remedy = remedy  # what to do
        self.option = option  # import option that would settle the question; None if no option does
        self.words = words  # words of the files that the option has to explain
        self.is_of_document = False  # whether the file as a whole is a document, and no table

    def __str__(self) -> str:
        place = str(self.place)
        return f"{place + ': ' if place else ''}{self.reason}; {self.remedy}"

    def mark_document(self) -> ImportFileError:
        """State that the file as a whole is a document, and no table; return this error."""
        self.is_of_document = True
        return self

    def add_place(self, place: Place) -> ImportFileError:
        """Set the place of this error if it has none; return this error."""
        self.place = place if self.place == NOWHERE else self.place
        return self


class Faults:
    """The faults of all files, collected so that one answer has all of them."""

    def __init__(self, most: int = MAX_FAULTS) -> None:
        self.found: list[ImportFileError] = []  # in the order in which they were found
        self.most = most  # largest number of faults that are kept

    @property
    def full(self) -> bool:
        """Return whether the largest number of faults is kept, so that the search for faults can end."""
        return len(self.found) >= self.most

    def add(self, fault: ImportFileError) -> None:
        """Keep a fault, unless its place and reason are known or the largest number of faults is kept."""
        known = any((kept.place, kept.reason) == (fault.place, fault.reason) for kept in self.found)
        if not self.full and not known:
            self.found.append(fault)

    def report(
        self, place: Place, reason: str, remedy: str, option: str | None = None, words: tuple[str, ...] = ()
    ) -> None:
        """Build a fault from its parts, and keep it."""
        self.add(ImportFileError(place, reason, remedy, option, words))

    @contextmanager
    def collect(self, place: Place = NOWHERE) -> Iterator[None]:
        """Catch and keep an `ImportFileError` of the block; an error without a place gets `place`."""
        try:
            yield
        except ImportFileError as fault:
            self.add(fault.add_place(place))
