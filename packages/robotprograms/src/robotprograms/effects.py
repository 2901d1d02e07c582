"""Effects of operations on states."""

from __future__ import annotations

from typing import Final, NamedTuple

from robotprograms import language as ir
from robotprograms.calls import Calls, Work
from robotprograms.columns import Cause
from robotprograms.control_flow import ControlFlow
from robotprograms.declarations import UNKNOWN, Entry, State
from robotprograms.places import Place
from robotprograms.statements import Statements

_OFF: Final = ""
"""Content of a mode of the controller, such as force control, that is off: no cause against moves."""


class FollowedProgram(NamedTuple):
    """A program, and what is known of it before its execution is followed."""

    statements: Statements  # operations, declarations and uses of names
    flow: ControlFlow  # operations that may follow each operation
    faults: dict[int, Cause]  # why operations do not fit, by their indices
    calls: Calls  # routines that a call may start
    effects: Effects  # what an operation changes in the contents of variables
    work: Work  # count of the steps by which the program is followed


class Effects:
    """Effects of the operations of a program."""

    def __init__(self, statements: Statements, flow: ControlFlow, calls: Calls) -> None:
        """Prepare to apply operations of a program with its control flow and calls."""
        self._ops, self._places, self._flow, self._calls = statements.ops, statements.places, flow, calls
        self._contents, self._changes = statements.contents, statements.changes
        self._declarations = statements.declarations

    def list_written(self, i: int) -> set[str]:
        """Return the full names of the variables to which operation i gives a new content.

        Two kinds of operations do so. `ir.Assign` gives a known value to one name; the fields of a position
        are assigned one by one. `ir.MakeUnknown` is a statement whose values are not known: it makes
        variables unknown with all of their fields, unless the program declares them as constants.
        """
        op, place = self._ops[i], self._places[i]
        if isinstance(op, ir.Assign):
            return {place.qualify(op.name)}
        if isinstance(op, ir.MakeUnknown):
            return self._list_made_unknown(op, place)
        return set()

    def _list_made_unknown(self, op: ir.MakeUnknown, place: Place) -> set[str]:
        """Return the full names, fields included, of the variables that a statement makes unknown."""
        variables = set(map(place.qualify, op.names)) - self._declarations.fixed
        names = set[str]()
        for variable in variables:
            names.update(self._contents.list_name_and_fields(variable))
        return names

    def apply(self, state: State, i: int) -> None:
        """Apply operation i to a state, the contents of all variables; the state is changed in place.

        Contents change by an assignment, by a statement after which values are unknown, and by the call of an
        unknown routine. A routine that is called at any time later, as a timer does, changes nothing here.
        """
        op, place = self._ops[i], self._places[i]
        if isinstance(op, ir.Assign):
            self._assign(state, op, place)
        elif isinstance(op, ir.MakeUnknown):
            self._make_unknown(state, op, place)
        elif isinstance(op, ir.Call):
            runs_here = op.event or not op.anytime
            if runs_here:
                self._call_unknown_routines(state, op, place)

    def _assign(self, state: State, op: ir.Assign, place: Place) -> None:
        """Store the content of the variable to which a statement assigns a value in a state.

        Behind `$BASE=BASE_DATA[3]`, `$BASE` has the content of `BASE_DATA[3]`. The names in `lasting` are no
        variables but modes, such as force control, which statements switch on and off. While a mode is on,
        its content is the cause why moves are not certain; any other value switches it off.
        """
        name = place.qualify(op.name)
        content = self._contents.evaluate(place, name, op.value, state)
        is_mode = name in self._changes.lasting
        if is_mode and not isinstance(content, Cause):
            content = _OFF
        state[name] = Entry(content, place.at)

    def _call_unknown_routines(self, state: State, op: ir.Call, place: Place) -> None:
        """Forget what unknown routines may change that a call starts; without such routines, do nothing.

        A routine is unknown if no file of the program defines it, and the user does not allow it. Two calls
        may start one: `grip();` itself, and `CONNECT stop WITH brake;`, where the routine brake of the
        program, which then runs at any time, calls one.

        Args:
            state: content of each variable before the call; it is changed in place.
            op: the call.
            place: place of the call.
        """
        cause = self._explain_unknown(op, place)
        if cause is None:
            return
        self._forget_names(state, cause)
        if op.may_last:  # the routine may also have switched on a mode such as force control
            state[ir.MODE] = Entry.from_content(cause)

    def _explain_unknown(self, op: ir.Call, place: Place) -> Cause | None:
        """Return the cause that a call starts an unknown routine, itself or by an event; None if it does not.

        Args:
            op: the call.
            place: place of the call.
        """
        cause = None
        is_of_program = op.name in self._flow.begins
        if not is_of_program:
            cause = self._calls.explain_unknown(place, op)
        return cause or self._calls.find_unknown_in_attached(place, op)

    def _make_unknown(self, state: State, op: ir.MakeUnknown, place: Place) -> None:
        """Store why variables are unknown as their contents in a state, for a statement that is not followed.

        Such a statement has either names, which become unknown with all of their fields, or none: then
        everything becomes unknown that routines of other files may change.
        """
        cause = place.make_cause(op.reason, op.remedy)
        if not op.names:
            self._forget_names(state, cause)
        for name in self._list_made_unknown(op, place):
            state[name] = Entry(cause, place.at)

    def _forget_names(self, state: State, cause: Cause) -> None:
        """Remove the names that an unknown routine may change from a state, and store the cause there.

        A state with `$BASE` and the local variable `i` keeps only `i`, and gets the entry `UNKNOWN` with the
        cause. A later look-up of `$BASE` finds no entry of its own, and then returns this cause.
        """
        forgotten = [name for name in state if not self._contents.is_protected(name)]
        for name in forgotten:
            del state[name]
        state[UNKNOWN] = Entry.from_content(cause)
