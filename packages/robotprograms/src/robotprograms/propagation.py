"""Propagation of states along the control flow, until no state changes any more.

A state has the content of each name on every path to an operation: numbers in the text, a name, or the cause
why the content is unknown. Where paths meet, contents that differ are unknown.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping, Set
from typing import Final, TypeAlias

from robotprograms import language as ir
from robotprograms.calls import Calls, Work
from robotprograms.columns import Cause
from robotprograms.control_flow import ControlFlow
from robotprograms.declarations import NEVER, UNKNOWN, State
from robotprograms.effects import Effects
from robotprograms.errors import quote_text
from robotprograms.language import Op
from robotprograms.liveness import Liveness
from robotprograms.places import find_place
from robotprograms.program import At
from robotprograms.statements import Statements

_MAX_CALLS: Final = 200
"""Largest depth of calls that are followed in one pass; deeper calls are followed in the next pass."""
Record: TypeAlias = Callable[["ir.Move | ir.MoveToStored", int, "State | None"], None]
"""Function that records a move, by its index, in a state; None for a move that no path reaches."""


def _explain_change(name: str, at: At) -> Cause:
    """Return the cause why a name is unknown whose contents differ where paths meet."""
    subject = "a value that an unknown routine may change" if name == UNKNOWN else name
    reason = f"{subject} changes while the program runs, in a branch, a loop or a call"
    return Cause(at.line, reason, "set the value once, before branches, loops and calls", at.source)


class Propagation:
    """States of a program."""

    def __init__(
        self,
        statements: Statements,
        flow: ControlFlow,
        calls: Calls,
        effects: Effects,
        faults: Mapping[int, Cause],
        work: Work,
        liveness: Liveness,
        record: Record,
    ) -> None:
        """Prepare to propagate states.

        Args:
            statements: statements of the program, with all changes.
            flow: control flow of the program.
            calls: calls of the program.
            effects: effects of the operations.
            faults: causes by the indices of operations that do not fit.
            work: count of steps.
            liveness: names that states leave out.
            record: function that records a move.
        """
        self._ops, self._language, self._contents = statements.ops, statements.language, statements.contents
        self._changes, self._flow, self._calls, self._effects = statements.changes, flow, calls, effects
        self._faults, self._work, self._liveness, self._record = faults, work, liveness, record
        self._incoming: dict[int, State] = {}  # joined states of all jumps to an operation
        self.exits: dict[str, State | None] = {}  # state at the end of each routine
        # indices of each routine's operations other than moves
        self._state_operations: dict[str, list[int]] = {}
        self._entered_routines: list[str] = []  # routines that are being passed through
        self._state_changed = True  # whether a state has changed in this pass
        # names that each routine may change and that are always live
        self._always_returned: dict[str, list[str]] = defaultdict(list)
        for routine, changed in self._changes.of_routine.items():
            live = [name for name in changed if name not in liveness.followed]
            self._always_returned[routine] = live

    def run(self, bodies: Mapping[str, list[int]], callers: Mapping[str, Set[str]]) -> None:
        """Pass states through routines until none changes, and then once more to record the moves.

        Args:
            bodies: operations of each routine.
            callers: callers of each routine.
        """
        self._enter_routines(callers)
        for name, body in bodies.items():
            kept = [i for i in body if not isinstance(self._ops[i], ir.Move | ir.MoveToStored)]
            self._state_operations[name] = kept
        order = list(bodies)
        while self._state_changed:
            self._state_changed = False
            for name in order:
                self._propagate_through(name, self._state_operations[name])
            order.reverse()  # callers first carries states into routines, callees first carries them back
        self._find_what_outlasts_routines()
        for name, body in bodies.items():
            self._propagate_through(name, body)

    def _enter_routines(self, callers: Mapping[str, Set[str]]) -> None:
        """Set the states in which the main routine, and routines that other programs may call, begin.

        `callers` are the names of the routines that call each routine.
        """
        self._contents.forget_judgements()  # from here on, all changes are known
        main = next((name for name in self._flow.begins if name not in self._flow.anytime_routines), "")
        # The program does not show when statements outside of its routines run: they may run at any time.
        if main and (self._language.callable_from_outside or main not in callers):
            self._changes.anytime.update(self._changes.of_routine[""])
        for name, begin in self._flow.begins.items():
            calls_itself_at_most = callers.get(name, set()) <= {name}
            is_entry = name == main and calls_itself_at_most
            may_be_called = name in self._flow.anytime_routines | self._flow.shared_routines
            if self._language.callable_from_outside or is_entry:
                self._incoming[begin] = {}
            elif calls_itself_at_most or may_be_called:
                reason = f"another program may call {quote_text(name)} while other frames are active"
                cause = Cause(0, reason, "set the frames in the routine, before its moves")
                self._incoming[begin] = {UNKNOWN: (cause, At())}

    def _propagate_through(self, routine: str, indices: Iterable[int]) -> None:
        """Propagate states through the operations `indices` of a routine once; record their moves.

        A state has the content of each variable, as it is on all paths to an operation; it is None where no
        path leads to the operation.
        """
        state: State | None = {}
        if not routine and routine in self._flow.faulty_routines:
            state = self._add_fault(self._flow.faulty_routines[routine], state)
        is_shared = False  # whether the state is stored elsewhere, so that it must be copied before a change
        self._entered_routines.append(routine)
        for i in indices:
            op = self._ops[i]
            if isinstance(op, ir.Move | ir.MoveToStored):
                self._record(op, i, state)
                continue
            self._work.count(1)
            unread_names = self._liveness.dead.get(i)  # nothing reads them from here on
            if state is not None and unread_names:
                left = self._leave_out(unread_names, state)
                is_shared = is_shared and left is state
                state = left
            if isinstance(op, ir.Flow):
                state = self._pass_to_successors(op, i, state)
                is_shared = True
            elif state is not None:
                state, is_shared = self._operate(op, i, state, shared=is_shared)
        self._entered_routines.pop()
        if state is not None:
            state = self._keep_live(self._liveness.at_exit.get(routine, set()), state)
        self._state_changed |= self.exits.get(routine) != state
        self.exits[routine] = state

    def _keep_live(self, live: Collection[str], state: State) -> State:
        """Return a state without names that nothing reads, where these names are live."""
        followed = self._liveness.followed
        return self._leave_out([name for name in state if name in followed and name not in live], state)

    def _leave_out(self, names: Collection[str], state: State) -> State:
        """Return a state without names that nothing reads; the same object if the state has none of them."""
        gone = state.keys() & names
        if not gone:
            return state
        return {name: each for name, each in state.items() if name not in gone}

    def _operate(self, op: Op, i: int, state: State, *, shared: bool) -> tuple[State | None, bool]:
        """Return the state behind operation i, which is no `Flow`, and whether the state is stored elsewhere.

        `shared` tells whether the state before the operation is.
        """
        after: State | None = state
        if isinstance(op, ir.Call) and (called := self._calls.list_called(op)):
            after, shared = self._follow_calls(op, i, called, state), True
        else:
            if shared:
                self._work.count(len(state))
                after = state = dict(state)
            self._effects.apply(state, i)
            shared = False
        for place in self._flow.successors.get(i, ()):  # an error or interrupt may end the routine here
            self._join_into(place, after)
            shared = True
        return after, shared

    def _pass_to_successors(self, op: ir.Flow, i: int, state: State | None) -> State | None:
        """Join a state into the successors of operation i; return the state after the operation."""
        fault = self._flow.uncertain.get(i)
        state = self._add_fault(fault, state)
        # A round that ends with a jump to the next one may have been the last.
        leaving = self._join_states(self._incoming.get(i), state) if op.kind in ir.LOOPS else state
        for place in self._flow.successors.get(i, ()):
            self._join_into(place, leaving)
        # What follows these operations is reached by jumps alone.
        if op.kind in ir.ROUTINES | {"switch", "branch", "default"}:
            state = None
        elif state is not None and (op.kind in ir.JUMPS or i in self._flow.endless):
            state = {**state, NEVER: ("", At())}
        return self._add_fault(fault, self._join_states(self._incoming.get(i), state))

    def _add_fault(self, fault: int | None, state: State | None) -> State | None:
        """Return a state in which no move is certain because of a fault of the program.

        Without a fault, or if no move is certain already, the state itself is returned. `fault` is the index
        of an operation that does not fit, such as an end without a beginning.
        """
        if fault is None or state is None:
            return state
        content, _ = self._contents.look_up(state, ir.MODE)
        is_uncertain_already = isinstance(content, Cause)
        if is_uncertain_already:
            return state
        cause = self._faults[fault]
        return {**state, ir.MODE: (cause, find_place(cause))}

    def _follow_calls(self, op: ir.Call, i: int, routines: list[str], state: State) -> State | None:
        """Return the state after operation i, which calls one of these routines of the program.

        The state is None if the end of the called routines was not reached yet.
        """
        end: State | None = None
        for routine in routines:
            self._work.count(len(state) if op.prefix is not None else 0)
            entering = self._keep_live(self._liveness.at_begin.get(routine, set()), state)
            is_new = self._join_into(self._flow.begins[routine], entering)
            if is_new and routine not in self._entered_routines and len(self._entered_routines) < _MAX_CALLS:
                self._propagate_through(routine, self._state_operations[routine])
            returned = self.exits.get(routine)
            if returned is not None:
                returned = self._return_from(routine, i, state, returned)
            end = self._join_states(end, returned)
        if op.name in routines:
            return end
        other = dict(state)  # a routine of another file, too, may have the name that is computed
        self._effects.apply(other, i)
        return self._join_states(other, end)

    def _return_from(self, routine: str, i: int, state: State, returned: State) -> State:
        """Return the state behind operation i, which calls a routine.

        A state has the content of each variable.

        Args:
            routine: the called routine.
            i: index of the call.
            state: state before the call.
            returned: state at the end of the routine.
        """
        changed = self._changes.of_routine[routine]
        read_behind_call = [name for name in self._liveness.returned.get(i, ()) if name in changed]
        names = [*self._always_returned[routine], *read_behind_call]
        self._work.count(len(names))
        may_change_all = UNKNOWN in changed
        if may_change_all:
            after = dict(returned)
        else:
            after = dict(state)
            for name in names:
                after[name] = self._contents.look_up(returned, name)
        if NEVER in state or NEVER in returned:
            after[NEVER] = ("", At())
        return after

    def _join_into(self, place: int, state: State | None) -> bool:
        """Join a state into the state at operation `place`; return whether the latter changed."""
        known = self._incoming.get(place)
        if state is not None and (dead := self._liveness.dead.get(place)):
            state = self._leave_out(dead, state)
        joined = self._join_states(known, state)
        if joined is None or joined is known:
            return False
        self._incoming[place] = joined
        self._state_changed = True
        return True

    def _join_states(self, first: State | None, second: State | None) -> State | None:
        """Return the state, the contents of all variables, behind a place where two paths meet.

        Equal contents are kept; a cause why the content is unknown replaces contents that differ. None is the
        state of a place that no path reaches. If nothing changes, the object `first` is returned.
        """
        if first is None:
            return second
        if second is None or first == second:
            return first
        is_first_never, is_second_never = NEVER in first, NEVER in second  # behind a jump
        if is_first_never != is_second_never:
            return second if is_first_never else first
        joined = dict(first)
        self._work.count(len(second) + len(first))
        for name in {**first, **second}:
            if name in first and name in second and first[name] == second[name]:
                continue
            first_content, first_place = self._contents.look_up(first, name)
            second_content, second_place = self._contents.look_up(second, name)
            are_equal = first_content == second_content or self._contents.have_equal_frames(
                name, first_content, second_content
            )
            if are_equal or isinstance(first_content, Cause):
                continue
            at = max(first_place, second_place)
            cause = second_content if isinstance(second_content, Cause) else _explain_change(name, at)
            joined[name] = (cause, at)
        return first if joined == first else joined

    def _find_what_outlasts_routines(self) -> None:
        """Let force control and the like, if it is on where a routine ends, be on at any time.

        The next routine may then be called from outside of the program.
        """
        if not self._language.callable_from_outside:
            return
        _, *names_with_end = self._changes.lasting  # the first one is of what no statement ends
        for name in names_with_end:
            for state in self.exits.values():
                content, _ = (state or {}).get(name, ("", At()))
                if isinstance(content, Cause):
                    self._changes.anytime[name] = content
