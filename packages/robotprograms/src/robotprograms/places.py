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
        """Return the full name of a variable, which other routines and files do not use for another one.

        The name of its routine is appended to a local variable, and that of its owner to a variable of
        another file.
        """
        variable = get_array_name(get_structure_name(name))  # `P` of `P[1].X`
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

    def make_cause(self, reason: str, remedy: str = WRITE_NUMBERS) -> Cause:
        """Return the cause at this place why something is not known or not corrected.

        In `reason`, a number of the statement is given as NUL, its ordinal, NUL: the number replaces it.
        """

        def show_number(ordinal: re.Match[str]) -> str:
            return f"{self.values[self.first + int(ordinal[1])]:g}"

        return Cause(self.line, re.sub("\0(\\d+)\0", show_number, reason), remedy, self.source)

    def qualify(self, name: Name) -> str:
        """Return the full name of a variable, with its routine appended if it is a local variable.

        A number is inserted in a name that is a template such as `P[%s]`, or NUL if the number is not whole.
        """
        if isinstance(name, str):
            return self.scope.qualify(name)
        number = float(self.values[self.first + name.ordinal])
        text = f"{number:g}" if number.is_integer() else "\0"
        full_name = self.scope.qualify(name.template % text)
        # One copy of each name; names of fields are used once or twice, and are not stored.
        is_field = "." in name.template
        return full_name if is_field else intern(full_name)


def find_place(cause: Cause) -> At:
    """Return the place of a cause."""
    return At(cause.line, cause.source)
