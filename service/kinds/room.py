"""The name of a kind of work in the command line and in `import jointstiff`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, order=True)
class Room:
    """Entry of a kind of work in lists of commands; the package of each kind declares a `ROOM`."""

    place: int  # rank in lists of commands, routes and documentation; lower is earlier
    command: str  # verb, such as `identify`
    summary: str  # one line for the list of commands
