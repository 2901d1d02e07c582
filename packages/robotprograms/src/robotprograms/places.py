"""Places of statements in a program, and the full names of variables there."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from sys import intern
from typing import Final

from robotprograms.arrays import FloatArray
from robotprograms.columns import OF_ROUTINE, Cause, get_array_name, get_structure_name
from robotprograms.errors import WRITE_NUMBERS
from robotprograms.language import Name
from robotprograms.program import At

OTHER_FILES: Final = "others"
"""Owner of names that mean one variable in all files but the first."""


@dataclass(frozen=True, slots=True)
class Scope:
    """Routine, the names of its local variables, and the owners of names that mean data of single files."""

    routine: str
    names: set[str] = field(default_factory=set)
    owners: Mapping[str, str] = field(default_factory=dict)

    def qualify(self, name: str) -> str:
        """Return a name, with its routine appended if it is a local variable, or with its owner."""
        variable = get_array_name(get_structure_name(name))
        owner = self.routine if variable in self.names else self.owners.get(variable, "")
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

    def make_cause(self, reason: str, remedy: str = WRITE_NUMBERS) -> Cause:
        """Return a cause at this place; in `reason`, numbers replace the ordinals (NUL, ordinal, NUL)."""
        reason_with_numbers = re.sub(
            "\0(\\d+)\0", lambda match: f"{self.values[self.first + int(match[1])]:g}", reason
        )
        return Cause(self.line, reason_with_numbers, remedy, self.source)

    def qualify(self, name: Name) -> str:
        """Return the full name of a variable.

        A number is inserted in a name that is a template, or NUL if the number is not whole. The name of the
        routine is appended to the name of a local variable.
        """
        if isinstance(name, str):
            return self.scope.qualify(name)
        value = float(self.values[self.first + name[1]])
        template, _ = name
        name_with_number = self.scope.qualify(template % (f"{value:g}" if value.is_integer() else "\0"))
        # One copy of each name; names of fields are used once or twice, and are not stored.
        return name_with_number if "." in template else intern(name_with_number)


def find_place(cause: Cause) -> At:
    """Return the place of a cause."""
    return At(cause.line, cause.source)
