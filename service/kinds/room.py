"""A kind of work as the command line and `import jointstiff` name it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, order=True)
class Room:
    """Name of a kind for people; the package of each kind states its own, and is found by that."""

    place: int  # in lists: of commands, routes and documentation
    command: str  # verb, such as `identify`
    summary: str  # one line for the list of commands
