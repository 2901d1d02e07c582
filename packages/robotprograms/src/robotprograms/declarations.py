"""Names that a program declares, uses and changes, and the states of its variables."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from sys import intern
from typing import Final, NamedTuple, TypeAlias

from robotprograms import language as ir
from robotprograms.columns import (
    Cause,
    WrittenNumbers,
    get_array_name,
    get_structure_name,
    get_variable,
    split_full_name,
)
from robotprograms.language import Name, Value
from robotprograms.places import Place, find_place
from robotprograms.program import At, Literal

UNKNOWN: Final = "\0everything"
"""Name in a state behind an unknown call: its value is the cause why values of other names are unknown."""
UNREACHED: Final = "\0never"
"""Name in a state behind a jump, which no path reaches: any other state takes its place where both meet."""

Content: TypeAlias = WrittenNumbers | Cause | str
"""Content of a variable: numbers, the cause why the numbers are unknown, or the name of another value."""


class Entry(NamedTuple):
    """Content of a variable at some point of the program."""

    content: Content
    place: At  # place of the statement that set the content; no place for a content that none set

    @classmethod
    def from_content(cls, content: Content) -> Entry:
        """Return the entry of a content whose place is known for a cause only: that of its statement."""
        place = find_place(content) if isinstance(content, Cause) else At()
        return cls(content, place)

    @property
    def cause(self) -> Cause | None:
        """Cause why the content is unknown; None if it is known."""
        return self.content if isinstance(self.content, Cause) else None


State: TypeAlias = dict[str, Entry]
"""Contents of all variables at some point of the program, by their full names."""
NOT_SET: Final = Entry("", At())
"""Entry of a state for a name that no statement has set."""
Fields: TypeAlias = tuple[tuple[str, Content], ...]
"""Endings of the names of a position's fields, each with its content."""


@dataclass(slots=True)
class Declarations:
    """Names that a program declares, and their contents before the program runs."""

    initial: dict[str, Content] = field(default_factory=dict)  # contents before the program runs
    # the same for frames that a position states, by the name of the position
    fields: dict[str, Fields] = field(default_factory=dict)
    shared_fields: dict[Fields, Fields] = field(default_factory=dict)  # one copy of equal fields
    names: set[str] = field(default_factory=set)  # data that belong to the program
    fixed: set[str] = field(default_factory=set)  # names that the program declares as constants
    constants: set[str] = field(default_factory=set)  # names that only the program itself may change
    shared: set[str] = field(default_factory=set)  # names that other programs may use as well
    stored: set[str] = field(default_factory=set)  # those of them that the controller stores for all programs
    private: set[str] = field(default_factory=set)  # names that no other program knows

    def add_field(self, structure: str, field: tuple[str, Content]) -> None:
        """Add a field to the declaration of a position, such as the frame `.UF` of the position `P[1]`.

        Args:
            structure: full name of the position.
            field: ending of the field's name, and content of the field. A field that is declared twice with
                different contents is added twice, so that a reader can see the contradiction.
        """
        known_fields = self.fields.get(structure, ())
        if field in known_fields:
            return
        fields = (*known_fields, field)
        # Many positions have the same fields: one copy of equal fields and of each name saves memory.
        self.fields[intern(structure)] = self.shared_fields.setdefault(fields, fields)

    def list_contained_names(self) -> set[str]:
        """Return the names of other values that are contents of variables before the program runs.

        A content that is text is such a name, for example that of the frame which a variable means.
        """
        contents = [*self.initial.values()]
        for fields in self.shared_fields:
            contents += [content for _, content in fields]
        return {content for content in contents if isinstance(content, str)}


@dataclass(slots=True)
class Uses:
    """Uses of names otherwise than as the target of a move.

    `Grind p1;` uses p1 in a way that is not known. `p2:=Offs(p1,0,0,50);` calculates p2 from p1: what that
    means for p1 depends on the uses of p2.
    """

    used: dict[str, At] = field(default_factory=dict)  # place at which a name is used
    # names from which each name was calculated, with the places
    origins: dict[str, dict[str, At]] = field(default_factory=lambda: defaultdict(dict))
    offsets: list[tuple[Place, ir.Offset]] = field(default_factory=list)  # poses at offsets from targets


@dataclass(slots=True)
class Changes:
    """Statements that may change contents, by names and routines."""

    of_name: dict[str, list[Cause]] = field(default_factory=lambda: defaultdict(list))
    # names that each routine may change, also through the routines that it calls
    of_routine: dict[str, dict[str, Cause]] = field(default_factory=lambda: defaultdict(dict))
    # names of all that may last, the first one of what no statement ends
    lasting: dict[str, None] = field(default_factory=lambda: {ir.MODE: None})
    anytime: dict[str, Cause] = field(default_factory=dict)  # names that may change at any time
    arrays: set[str] = field(default_factory=set)  # arrays whose elements statements may change
    routines_of_pi: set[str] = field(default_factory=set)  # routines that give `pi` a content
    causes: list[Cause] = field(default_factory=list)  # causes of all statements that are not understood

    def find(self, name: str) -> list[Cause]:
        """Return the changes that may concern a name, each as a cause with the line of its statement.

        A change of `P[1].UF` may be that of the name itself, of its structure `P[1]`, or of its array `P`:
        the first of these names that any statement changes counts.
        """
        for changed_name in (name, get_structure_name(name), get_array_name(name)):
            changes = self.of_name.get(changed_name)
            if changes:
                return changes
        return []


def get_base(name: str) -> str:
    """Return the name of the variable that a name belongs to, without its routine."""
    return split_full_name(get_variable(name)).variable


def list_names(value: Value | ir.Product | Name) -> list[Name]:
    """Return the names of the variables that have to be looked up to evaluate a value.

    `value` is the right side of an assignment, a frame of a move, or the name of a target. Only a value that
    is written in numbers, or is not known at all, needs no variable.
    """
    match value:
        case ir.Product(names=names):
            return list(names)
        case ir.Element(table=table, number=number):
            return [table, number]
        case ir.Copy(name=name) | ir.Named(name=name):
            return [name]
        case ir.Stated():  # its expressions may contain pi, which a program may define anew
            return ["pi"]
        case Literal(axes_name=axes_name):
            return [axes_name] if axes_name else []
        case ir.Unknown():
            return []
    return [value]  # the name of a target


def list_read_names(op: ir.Op) -> list[Name]:
    """Return the names of the variables whose contents an operation reads, as the program writes them.

    Only assignments and moves read contents: a move reads its targets, bases, tools and its feed.
    """
    if isinstance(op, ir.Assign):
        return list_names(op.value)
    if not isinstance(op, ir.Move):
        return []
    # A move to an offset from a target is replaced by `near_target`, which has frames of its own.
    near = op.near_target or op
    names = [*op.matched_frames, *op.offset_from, *near.offset_from]
    if op.feed is not None:
        names += list_names(op.feed.value)
        names += [name for name in (op.feed.percentage, op.feed.greatest) if name]
    for value in (*op.targets, *op.bases, *op.tools, *near.bases, *near.tools):
        names += list_names(value)
    return names
