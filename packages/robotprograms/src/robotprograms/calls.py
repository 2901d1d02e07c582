"""Calls: which routines of a program a call may start, and what calls of unknown routines may do."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection
from itertools import chain
from typing import Final, NoReturn

from robotprograms import language as ir
from robotprograms.columns import IN_MODULE, Cause
from robotprograms.control_flow import ControlFlow
from robotprograms.declarations import UNKNOWN, Changes
from robotprograms.errors import capitalise, decode_text, quote_text
from robotprograms.places import Place
from robotprograms.program import At

_MAX_WORK: Final = 10_000_000
"""Largest number of steps, and of names in states that are joined; programs of people need far fewer."""


class Work:
    """Count of the steps by which a program is followed, which refuses a program that needs too many.

    A step is one operation through which the contents of all variables are passed, or one variable that is
    compared where two paths meet. Programs may come from strangers: without an end of the steps, one with
    many branches would be followed for hours.
    """

    def __init__(self, refuse: Callable[[None, str, str], NoReturn]) -> None:
        """Begin without steps; `count` refuses the program once they are more than `_MAX_WORK`.

        Args:
            refuse: function that raises the error of a refused program. Its arguments are the line (None for
                the whole program), the reason and a remedy.
        """
        self._steps, self._refuse = 0, refuse

    def count(self, steps: int) -> None:
        """Add steps by which the program is followed; refuse a program that needs more than `_MAX_WORK`.

        Raises:
            ProgramError: the program needs too many steps.
        """
        self._steps += steps
        if self._steps > _MAX_WORK:
            self._refuse(None, "the program has too many branches and names", "split the program")


class Calls:
    """Calls of a program."""

    def __init__(
        self, flow: ControlFlow, changes: Changes, work: Work, allowed: Collection[str], *, trusted: bool
    ) -> None:
        """Prepare to find out what the calls of a program may start, and what an unknown routine may do.

        Args:
            flow: control flow with the routines of the program.
            changes: names of variables that each routine may change; they may be collected later.
            work: count of the steps by which the program is followed, which ends if they are too many.
            allowed: routines that, as the user states, neither move the robot nor change frames.
            trusted: whether the user states this for all routines of other files.
        """
        self._flow, self._changes, self._work, self._trusts_routines = flow, changes, work, trusted
        self._allowed = frozenset(chain.from_iterable(map(_list_spellings, allowed)))  # in capitals
        self.unknown_routines: dict[str, None] = {}  # routines of other files that are not allowed
        self.first_unknown = At()  # first place at which one of them is called
        self.attached: dict[str, list[str]] = defaultdict(list)  # routines of each event, by its name
        self.attached_routines: set[str] = set()  # routines of the program that are attached to an event

    def explain_unknown(self, place: Place, op: ir.Call) -> Cause | None:
        """Return the cause why values are unknown after a call of a routine that no file defines.

        The routine is noted in `unknown_routines`. Return None if the user trusts routines of other files or
        allows this one, or if the call is known to be harmless. The call of an event means all routines that
        are attached to the event.
        """
        is_trusted = op.harmless or self._trusts_routines
        unknown = [] if is_trusted else self._list_unknown(place.qualify(op.name))
        if not unknown:
            return None
        self._note_unknown(unknown, place.at)
        quoted = quote_text(unknown[0])
        reason = f"{quoted} is unknown: it may move the robot or change its frames"
        remedy = (
            f"if {quoted} does neither, state `trust_routines`, or name the routine in `leave_alone`: "
            f"[{quoted}]"
        )
        return place.make_cause(reason, remedy)

    def _note_unknown(self, routines: list[str], at: At) -> None:
        """Note that unknown routines are called at a place; the first place in the text is kept."""
        self.unknown_routines |= dict.fromkeys(routines)
        is_first_call = not self.first_unknown.line or at < self.first_unknown
        if is_first_call:
            self.first_unknown = at

    def _list_unknown(self, name: str) -> list[str]:
        """Return the routines that neither the program defines nor the user allows.

        `name` is the full name of a routine, or of an event, which means all routines attached to the event.
        """
        unknown = list[str]()
        for routine in self.attached.get(name, [name]):
            plain_name, _, _ = routine.partition(IN_MODULE)
            is_allowed = capitalise(plain_name) in self._allowed
            if routine not in self._flow.begins and not is_allowed:
                unknown.append(plain_name)
        return unknown

    def list_called(self, op: ir.Call) -> list[str]:
        """Return the routines of this program that run where the call is, not later at an event."""
        return [] if op.anytime else self.list_meant(op)

    def list_meant(self, op: ir.Call) -> list[str]:
        """Return the routines of this program that a call may mean.

        The name of a call may be computed while the program runs, as in `CallByVar "sub",n;`. Then only its
        beginning `sub` is known, and all routines whose names begin so are returned.
        """
        if op.name in self._flow.begins:
            return [str(op.name)]
        is_computed = op.prefix is not None
        if not is_computed:
            return []
        self._work.count(len(self._flow.begins))
        return [routine for routine in self._flow.begins if routine.startswith(str(op.prefix))]

    def find_unknown_in_attached(self, place: Place, op: ir.Call) -> Cause | None:
        """Return the cause why values are unknown once routines of the program are attached to an event.

        `CONNECT stop WITH brake;` attaches the routine brake to the event stop: brake may run at any time,
        and call an unknown routine. The operation attaches one routine, or it switches on an event, to which
        routines were attached before. Return None if none of these routines calls an unknown one.
        """
        name = place.qualify(op.name)
        attached_here = [name] if op.event else []
        for routine in self.attached.get(name, attached_here):
            cause = self._changes.of_routine[routine].get(UNKNOWN)
            if cause and routine in self.attached_routines:
                return cause
        return None


def _list_spellings(routine: str) -> list[str]:
    """Return the name of a routine in capitals, as a file in Latin-1 and a file in UTF-8 write the name.

    The names differ if they have letters beyond ASCII.
    """
    encoded = [routine.encode(encoding, "replace") for encoding in ("latin-1", "utf-8")]
    return [capitalise(decode_text(content)) for content in encoded]
