"""Places of statements in a program, and the full names of variables there."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from sys import intern
from typing import Final

from robotprograms.arrays import FloatArray
from robotprograms.columns import OF_ROUTINE, Cause, get_variable
from robotprograms.errors import WRITE_NUMBERS
from robotprograms.language import Name
from robotprograms.program import At

OTHER_FILES: Final = "others"
"""Owner of names that mean one variable in all files but the first."""
_FRACTION: Final = "\0"
"""Text in place of an index that is not a whole number: no variable of a program has it in its name."""
_NUMBER_IN_REASON: Final = re.compile("\0(?P<ordinal>\\d+)\0")
"""Stand-in for a number in the text of a reason: the index of the number among those of its statement."""


def has_whole_index(name: str) -> bool:
    """Return whether the index in the full name of a variable, such as `P[3]`, is a whole number.

    `Place.qualify` marks an index that is a fraction. A name without an index has no such mark.
    """
    return _FRACTION not in name


@dataclass(frozen=True, slots=True)
class Scope:
    """Routine, the names of its local variables, and the owners of names that mean data of single files."""

    routine: str
    names: set[str] = field(default_factory=set)
    owners: Mapping[str, str] = field(default_factory=dict)

    def qualify(self, name: str) -> str:
        """Return the full name of a variable, which other routines and files do not use for another one.

        The full name of a local variable ends with its routine, as in `P[1] of routine main`; the full name
        of a variable of another file ends with the owner of its data. Any other name is full already.
        """
        variable = get_variable(name)  # `P` of `P[1].X`
        is_local = variable in self.names
        owner = self.routine if is_local else self.owners.get(variable, "")
        return f"{name}{OF_ROUTINE}{owner}" if owner else name


@dataclass(frozen=True, slots=True)
class Place:
    """Place of a statement, and the numbers of its file."""

    source: int  # index of the file
    line: int  # line of the statement, from 1
    first: int  # index of the statement's first number among those of the file
    values: FloatArray  # all numbers of the file
    scope: Scope

    @property
    def at(self) -> At:
        """Line of the statement in its file."""
        return At(self.line, self.source)

    def read_number(self, ordinal: int) -> float:
        """Return a number of the statement; `ordinal` is its index among the numbers of the statement."""
        return float(self.values[self.first + ordinal])

    def make_cause(self, reason: str, remedy: str = WRITE_NUMBERS) -> Cause:
        """Return the cause at this place why something is not known or not corrected.

        The reason may have stand-ins for numbers of the statement (see `_NUMBER_IN_REASON`), because
        statements that differ only in their numbers share one reason. Here the numbers replace them.
        """

        def write_number(stand_in: re.Match[str]) -> str:
            return f"{self.read_number(int(stand_in['ordinal'])):g}"

        reason_with_numbers = _NUMBER_IN_REASON.sub(write_number, reason)
        return Cause(self.line, reason_with_numbers, remedy, self.source)

    def qualify(self, name: Name) -> str:
        """Return the full name of a variable: that of its routine is appended to a local variable.

        For an element of an array, such as `P[3]`, `name` has a template `P[%s]`, and says which number of
        the statement is the index. `has_whole_index` tells whether the index is a whole number.
        """
        if isinstance(name, str):
            return self.scope.qualify(name)
        number = self.read_number(name.ordinal)
        index = f"{number:g}" if number.is_integer() else _FRACTION
        full_name = self.scope.qualify(name.template % index)
        # One copy of each name saves memory; names of fields are used once or twice, and are not stored.
        is_field = "." in name.template
        return full_name if is_field else intern(full_name)


def find_place(cause: Cause) -> At:
    """Return the place of a cause."""
    return At(cause.line, cause.source)
