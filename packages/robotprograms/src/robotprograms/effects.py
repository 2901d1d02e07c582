"""Effects of operations on states."""

from __future__ import annotations

from robotprograms import language as ir
from robotprograms.calls import Calls
from robotprograms.columns import Cause
from robotprograms.control_flow import ControlFlow
from robotprograms.declarations import UNKNOWN, State
from robotprograms.places import Place, find_place
from robotprograms.statements import Statements


class Effects:
    """Effects of the operations of a program."""

    def __init__(self, statements: Statements, flow: ControlFlow, calls: Calls) -> None:
        """Prepare to apply operations of a program with its control flow and calls."""
        self._ops, self._places, self._flow, self._calls = statements.ops, statements.places, flow, calls
        self._contents, self._changes = statements.contents, statements.changes
        self._declarations = statements.declarations

    def list_written(self, i: int) -> set[str]:
        """Return the full names to which operation i gives a new content, fields of positions included."""
        op, place = self._ops[i], self._places[i]
        if isinstance(op, ir.Assign):
            return {place.qualify(op.name)}
        written = set[str]()
        if isinstance(op, ir.MakeUnknown):
            for name in set(map(place.qualify, op.names)) - self._declarations.fixed:
                written.update(self._contents.list_name_and_fields(name))
        return written

    def apply(self, state: State, i: int) -> None:
        """Apply operation i to a state, the contents of all variables; the state is changed in place.

        Contents change by an assignment, by a statement after which values are unknown, and by the call of an
        unknown routine.
        """
        op, place = self._ops[i], self._places[i]
        if isinstance(op, ir.Assign):
            name = place.qualify(op.name)
            content = self._contents.evaluate(place, name, op.value, state)
            # Of what lasts, only a cause against moves counts, not the name of what has none.
            is_over = name in self._changes.lasting and not isinstance(content, Cause)
            state[name] = ("" if is_over else content, place.at)
        elif isinstance(op, ir.MakeUnknown):
            self._make_unknown(state, op, place)
        elif isinstance(op, ir.Call) and (op.event or not op.anytime):
            self._call(state, op, place)

    def _call(self, state: State, op: ir.Call, place: Place) -> None:
        """Make unknown in a state (contents of all names) what the call of an unknown routine may change."""
        unknown = None  # the cause why values are unknown behind the call
        if op.name not in self._flow.begins:
            unknown = self._calls.explain_unknown(place, op)
        if unknown is None:
            unknown = self._calls.find_unknown_in_attached(place, op)
        if unknown is None:
            return
        self._forget_names(state, unknown)
        if op.may_last:
            state[ir.MODE] = (unknown, find_place(unknown))

    def _make_unknown(self, state: State, op: ir.MakeUnknown, place: Place) -> None:
        """Make the values of names unknown in a state; without names, all that other routines may change."""
        cause = place.make_cause(op.reason, op.remedy)
        if not op.names:
            self._forget_names(state, cause)
        changed_names = set(map(place.qualify, op.names)) - self._declarations.fixed
        for name in changed_names:
            for name_or_field in self._contents.list_name_and_fields(name):
                state[name_or_field] = (cause, place.at)

    def _forget_names(self, state: State, cause: Cause) -> None:
        """Remove names that an unknown routine may change from a state; set `UNKNOWN` to the cause."""
        forgotten = [name for name in state if not self._contents.keeps(name)]
        for name in forgotten:
            del state[name]
        state[UNKNOWN] = (cause, find_place(cause))
