"""Calls: which routines of a program a call may start, and what calls of unknown routines may do."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection
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
    """Count of the steps of an interpretation."""

    def __init__(self, refuse: Callable[[None, str, str], NoReturn]) -> None:
        self._steps, self._refuse = 0, refuse

    def count(self, names: int) -> None:
        """Count steps of the interpretation; refuse a program that takes too many."""
        self._steps += names
        if self._steps > _MAX_WORK:
            self._refuse(None, "the program has too many branches and names", "split the program")


class Calls:
    """Calls of a program."""

    def __init__(
        self, flow: ControlFlow, changes: Changes, work: Work, allowed: Collection[str], *, trusted: bool
    ) -> None:
        """Prepare to follow calls.

        Args:
            flow: control flow with the routines of the program.
            changes: names that each routine may change; they may be collected later.
            work: count of steps.
            allowed: routines that, as the user states, neither move the robot nor change frames.
            trusted: whether the user states this for all routines of other files.
        """
        self._flow, self._changes, self._work, self._trusts_routines = flow, changes, work, trusted
        allowed_names = set[str]()  # in capitals; letters beyond ASCII may be written in either encoding
        for name in allowed:
            for encoding in ("latin-1", "utf-8"):
                allowed_names.add(capitalise(decode_text(name.encode(encoding, "replace"))))
        self._allowed = frozenset(allowed_names)
        self.unknown_routines: dict[str, None] = {}  # routines of other files that are not allowed
        self.first_unknown = At()  # first place at which one of them is called
        self.attached: dict[str, list[str]] = defaultdict(list)  # routines of each event, by its name
        self.attached_routines: set[str] = set()  # routines of the program that are attached to an event

    def explain_unknown(self, place: Place, op: ir.Call) -> Cause | None:
        """Return the cause why values are unknown after a call; None if the called routine is allowed.

        The name of an event means all routines that are attached to the event.
        """
        name = place.qualify(op.name)
        unknown = list[str]()  # routines that are neither of the program nor allowed
        for routine in self.attached.get(name, [name]):
            plain_name, _, _ = routine.partition(IN_MODULE)
            if routine not in self._flow.begins and capitalise(plain_name) not in self._allowed:
                unknown.append(plain_name)
        is_trusted = op.harmless or self._trusts_routines
        if is_trusted or not unknown:
            return None
        self.unknown_routines |= dict.fromkeys(unknown)
        if not self.first_unknown.line or place.at < self.first_unknown:
            self.first_unknown = place.at
        quoted = quote_text(unknown[0])
        reason = f"{quoted} is unknown: it may move the robot or change its frames"
        remedy = (
            f"if {quoted} does neither, state `trust_routines`, or name the routine in `leave_alone`: "
            f"[{quoted}]"
        )
        return place.make_cause(reason, remedy)

    def list_called(self, op: ir.Call) -> list[str]:
        """Return the routines of this program that a call may start directly, not at an event."""
        return [] if op.anytime else self.list_meant(op)

    def list_meant(self, op: ir.Call) -> list[str]:
        """Return the routines of this program whose name a call may mean."""
        if op.name in self._flow.begins:
            return [str(op.name)]
        if op.prefix is None:
            return []
        self._work.count(len(self._flow.begins))
        return [each for each in self._flow.begins if each.startswith(op.prefix)]

    def find_unknown_in_attached(self, place: Place, op: ir.Call) -> Cause | None:
        """Return the cause why values are unknown after routines of the program are attached to an event.

        The operation attaches a routine, or its name is that of an event that is switched on.
        """
        name = place.qualify(op.name)
        attached_here = [name] if op.event else []
        for routine in self.attached.get(name, attached_here):
            cause = self._changes.of_routine[routine].get(UNKNOWN)
            if cause and routine in self.attached_routines:
                return cause
        return None
