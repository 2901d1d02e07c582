"""Propagation of states along the control flow, until no state changes any more.

A state has the content of each name on every path to an operation: numbers in the text, a name, or the cause
why the content is unknown. Where paths meet, contents that differ are unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Set
from typing import Final, NamedTuple, TypeAlias

from robotprograms import language as ir
from robotprograms.columns import Cause
from robotprograms.declarations import NOT_SET, UNKNOWN, UNREACHED, Changes, Content, Entry, State
from robotprograms.effects import FollowedProgram
from robotprograms.errors import quote_text
from robotprograms.language import Op
from robotprograms.liveness import Liveness
from robotprograms.program import At

_MAX_CALLS: Final = 200
"""Largest depth of calls that are followed in one pass; deeper calls are followed in the next pass."""
Record: TypeAlias = Callable[["ir.Move | ir.MoveToStored", int, "State | None"], None]
"""Function that records a move, by its index, in a state; None for a move that no path reaches."""


def _explain_change(name: str, at: At) -> Cause:
    """Return the cause why the content of a name is unknown: paths with different contents meet.

    `at` is the place of the statement on one of the paths that set the content.
    """
    subject = "a value that an unknown routine may change" if name == UNKNOWN else name
    reason = f"{subject} changes while the program runs, in a branch, a loop or a call"
    return Cause(at.line, reason, "set the value once, before branches, loops and calls", at.source)


class _PassedState(NamedTuple):
    """State behind an operation of a routine that is passed through."""

    state: State | None  # content of each variable; None if no path leads there
    is_shared: bool  # whether the state is stored elsewhere, too: it is then copied before a change


class Propagation:
    """States of a program."""

    def __init__(self, program: FollowedProgram, liveness: Liveness, record: Record) -> None:
        """Prepare to propagate states through a program, all of whose changes are known.

        Args:
            program: the program.
            liveness: names that states leave out.
            record: function that records a move.
        """
        self._ops, self._language = program.statements.ops, program.statements.language
        self._contents, self._changes = program.statements.contents, program.statements.changes
        self._flow, self._calls, self._effects = program.flow, program.calls, program.effects
        self._faults, self._work = program.faults, program.work
        self._liveness, self._record = liveness, record
        self._incoming: dict[int, State] = {}  # joined states of all jumps to an operation
        self.exits: dict[str, State | None] = {}  # state at the end of each routine
        # indices of each routine's operations other than moves
        self._state_operations: dict[str, list[int]] = {}
        self._entered_routines: list[str] = []  # routines that are being passed through
        self._state_changed = True  # whether a state has changed in this pass
        self._always_returned = _list_always_returned(self._changes, liveness)

    def run(self, bodies: Mapping[str, list[int]], callers: Mapping[str, Set[str]]) -> None:
        """Pass states through routines until none changes, and then once more to record the moves.

        A state has the content of each variable on all paths to an operation.

        Args:
            bodies: indices of the operations of each routine.
            callers: routines that call each routine.
        """
        self._enter_routines(callers)
        for routine, body in bodies.items():
            kept = [i for i in body if not isinstance(self._ops[i], ir.Move | ir.MoveToStored)]
            self._state_operations[routine] = kept
        order = list(bodies)
        while self._state_changed:
            self._state_changed = False
            for routine in order:
                self._propagate_through(routine, self._state_operations[routine])
            order.reverse()  # callers first carries states into routines, callees first carries them back
        self._find_what_outlasts_routines()
        for routine, body in bodies.items():
            self._propagate_through(routine, body)

    def _enter_routines(self, callers: Mapping[str, Set[str]]) -> None:
        """Set the states in which routines begin that something else than the program may start.

        The main routine, and each routine that the controller can start, begins with what the program
        declares. A routine that no routine calls, or that other programs may call, begins with unknown
        values.

        `callers` are the routines that call each routine.
        """
        self._contents.forget_judgements()  # from here on, all changes are known
        main = next((name for name in self._flow.begins if name not in self._flow.anytime_routines), "")
        # The program does not show when statements outside of its routines run: they may run at any time.
        if main and (self._language.callable_from_outside or main not in callers):
            self._changes.anytime.update(self._changes.of_routine[""])
        for routine, begin in self._flow.begins.items():
            is_called = bool(callers.get(routine, set()) - {routine})
            state = self._find_entry_state(routine, is_main=routine == main, is_called=is_called)
            if state is not None:
                self._incoming[begin] = state

    def _find_entry_state(self, routine: str, *, is_main: bool, is_called: bool) -> State | None:
        """Return the state in which a routine begins if it may be started otherwise than by the program.

        There are three cases:

        1. The main routine, which the user starts, and in some languages any routine: a state without
           entries, as nothing has run before it.
        2. Only other routines of the program call it: None, as the states of the calls are joined later.
        3. Another program may call it, or must, as no routine of this one does: all names are unknown,
           because that program may have changed them.

        Args:
            routine: name of the routine.
            is_main: whether the program begins with this routine, unless others call it.
            is_called: whether another routine of the program calls it.
        """
        if self._language.callable_from_outside or (is_main and not is_called):
            return {}
        may_other_programs_call = routine in self._flow.anytime_routines | self._flow.shared_routines
        if is_called and not may_other_programs_call:
            return None
        reason = f"another program may call {quote_text(routine)} while other frames are active"
        cause = Cause(0, reason, "set the frames in the routine, before its moves")
        return {UNKNOWN: Entry(cause, At())}

    def _propagate_through(self, routine: str, indices: Iterable[int]) -> None:
        """Pass states through operations of a routine once, and record their moves.

        A state has the content of each variable, as it is on all paths to an operation; it is None where no
        path leads to the operation. The state at the end of the routine is stored in `exits`.

        Args:
            routine: name of the routine; empty for statements outside of routines.
            indices: indices of the routine's operations, in their order.
        """
        passed = _PassedState(self._make_first_state(routine), is_shared=False)
        self._entered_routines.append(routine)
        for i in indices:
            op = self._ops[i]
            if isinstance(op, ir.Move | ir.MoveToStored):
                self._record(op, i, passed.state)
                continue
            self._work.count(1)
            passed = self._forget_unread(i, passed)
            if isinstance(op, ir.Flow):
                passed = _PassedState(self._pass_to_successors(op, i, passed.state), is_shared=True)
            elif passed.state is not None:
                passed = self._operate(op, i, passed.state, shared=passed.is_shared)
        self._entered_routines.pop()
        self._store_exit(routine, passed.state)

    def _make_first_state(self, routine: str) -> State | None:
        """Return the state before the first line of a routine; it has no content of a variable.

        Where a routine begins, the states of its callers are joined into this state. Statements outside of
        routines, whose name is empty, have no such beginning: a fault in them concerns all of them.
        """
        is_outside = not routine
        if is_outside and routine in self._flow.faulty_routines:
            return self._add_fault(self._flow.faulty_routines[routine], {})
        return {}

    def _forget_unread(self, i: int, passed: _PassedState) -> _PassedState:
        """Return a passed state without the variables that nothing reads from operation i on.

        If variables are left out, the state is a new object, which is stored nowhere else, so that it may be
        changed in place: `is_shared` becomes false.
        """
        if passed.state is None:
            return passed
        kept = self._leave_out_unread(i, passed.state)
        return _PassedState(kept, is_shared=passed.is_shared and kept is passed.state)

    def _leave_out_unread(self, i: int, state: State) -> State:
        """Return a state without the variables that nothing reads from operation i on.

        A state with fewer variables is joined and compared faster. The same object is returned if it has none
        of them.
        """
        unread_names = self._liveness.dead.get(i)
        return _leave_out(unread_names, state) if unread_names else state

    def _store_exit(self, routine: str, state: State | None) -> None:
        """Store the state at the end of a routine, with which its callers go on; note whether it is new."""
        if state is not None:
            state = self._keep_read_names(self._liveness.at_exit.get(routine, set()), state)
        self._state_changed |= self.exits.get(routine) != state
        self.exits[routine] = state

    def _keep_read_names(self, read_names: Collection[str], state: State) -> State:
        """Return a state without the variables that nothing reads any more, which makes states small.

        Only of the names in `liveness.followed` it is known where they are read: those of them that are not
        in `read_names` are left out. All other names may be read anywhere, and stay.
        """
        followed = self._liveness.followed
        unread = [name for name in state if name in followed and name not in read_names]
        return _leave_out(unread, state)

    def _operate(self, op: Op, i: int, state: State, *, shared: bool) -> _PassedState:
        """Return the state behind operation i.

        The state behind a call is None if the end of the called routines was not reached yet.

        Args:
            op: the operation; it neither moves the robot nor begins, ends or leaves a block.
            i: its index.
            state: content of each variable before the operation.
            shared: whether `state` is stored elsewhere.
        """
        called = self._calls.list_called(op) if isinstance(op, ir.Call) else []
        if isinstance(op, ir.Call) and called:
            after = _PassedState(self._follow_calls(op, i, called, state), is_shared=True)
        else:
            after = _PassedState(self._apply(i, state, shared=shared), is_shared=False)
        successors = self._flow.successors.get(i, ())  # an error or interrupt may end the routine here
        for successor in successors:
            self._join_into(successor, after.state)
        return after._replace(is_shared=after.is_shared or bool(successors))

    def _apply(self, i: int, state: State, *, shared: bool) -> State:
        """Return the state behind operation i, which is no call of a routine of the program.

        A state that is stored elsewhere, as `shared` says, is copied before the change; any other state is
        changed in place.
        """
        if shared:
            self._work.count(len(state))
            state = dict(state)
        self._effects.apply(state, i)
        return state

    def _pass_to_successors(self, op: ir.Flow, i: int, state: State | None) -> State | None:
        """Pass a state on to all operations to which a branch, loop or jump may lead.

        At the line `IF a THEN`, the state is passed to the line behind ELSE or ENDIF, and it is also the
        state of the next line.

        Args:
            op: beginning or end of a branch, loop or routine, or a jump.
            i: its index.
            state: state before it; None if no path leads there.

        Returns:
            The state before the next operation of the text; None if no path leads there.
        """
        fault = self._flow.uncertain.get(i)
        state = self._add_fault(fault, state)
        leaving = state
        if op.kind in ir.LOOPS:  # a round that ends with a jump to the next one may have been the last
            leaving = self._join_states(self._incoming.get(i), state)
        for successor in self._flow.successors.get(i, ()):
            self._join_into(successor, leaving)
        going_on = self._find_state_that_goes_on(op, i, state)
        joined = self._join_states(self._incoming.get(i), going_on)
        return self._add_fault(fault, joined)

    def _find_state_that_goes_on(self, op: ir.Flow, i: int, state: State | None) -> State | None:
        """Return the part of the state before operation i that goes on to the next line of the text.

        1. Behind `ELSE`, which only a jump from IF reaches, and where no path leads to operation i: None.
        2. Behind `GOTO`, `RETURN` and a loop without end: the state, marked as one that no path reaches. Any
           other state takes its place where both meet.
        3. Behind any other operation: the state itself.

        Args:
            op: beginning or end of a branch, loop or routine, or a jump.
            i: its index.
            state: content of each variable before it; None if no path leads there.
        """
        is_reached_by_jumps_alone = op.kind in ir.ROUTINES | {"switch", "branch", "default"}
        if state is None or is_reached_by_jumps_alone:
            return None
        never_goes_on = op.kind in ir.JUMPS or i in self._flow.endless
        return {**state, UNREACHED: NOT_SET} if never_goes_on else state

    def _add_fault(self, fault: int | None, state: State | None) -> State | None:
        """Return a state in which no move is certain, because of a fault such as an ENDIF without IF.

        Behind such a line it is not known what the controller runs. So the controller's variable `ir.MODE`,
        on whose value all moves depend, gets an unknown value in the state, with the fault as the cause. The
        state itself is returned if there is no fault, if no path leads here, or if the value is unknown
        already.

        Args:
            fault: index of the operation that does not fit; None if there is none.
            state: content of each variable; None if no path leads here.
        """
        if fault is None or state is None or self._makes_moves_uncertain(state):
            return state
        return {**state, ir.MODE: Entry.from_content(self._faults[fault])}

    def _makes_moves_uncertain(self, state: State) -> bool:
        """Return whether no move is certain in a state: `ir.MODE` has a cause in place of a known content."""
        return self._contents.look_up(state, ir.MODE).cause is not None

    def _follow_calls(self, op: ir.Call, i: int, routines: list[str], state: State) -> State | None:
        """Return the state behind a call: what the states behind all routines that it may mean agree in.

        `GRIP()` means one routine. `CallByVar "sub",n;` computes the name: it means each routine whose name
        begins with `sub`, and perhaps one of another file. The state is None if the end of no called routine
        was reached yet, as in a routine that calls itself: a later pass reaches it.

        Args:
            op: the call.
            i: its index.
            routines: routines of the program that the call may mean.
            state: content of each variable before the call.
        """
        is_computed = op.prefix is not None
        behind_call: State | None = None
        for routine in routines:
            if is_computed:
                self._work.count(len(state))  # for the variables that are joined below
            self._enter_called(routine, state)
            behind_routine = self._find_state_behind_call(routine, i, state)
            behind_call = self._join_states(behind_call, behind_routine)
        may_mean_other_file = op.name not in routines
        if may_mean_other_file:
            behind_unknown = dict(state)
            self._effects.apply(behind_unknown, i)
            behind_call = self._join_states(behind_unknown, behind_call)
        return behind_call

    def _find_state_behind_call(self, routine: str, i: int, state: State) -> State | None:
        """Return the state behind the call of a routine; None if its end was not reached yet.

        Args:
            routine: name of the called routine.
            i: index of the call.
            state: content of each variable before the call.
        """
        at_exit = self.exits.get(routine)
        return None if at_exit is None else self._return_from(routine, i, state, at_exit)

    def _enter_called(self, routine: str, state: State) -> None:
        """Join the state at a call into the one with which the routine begins; if it is new, pass it through.

        A routine that calls itself, and calls within too many others, are passed through later, in their
        turn.
        """
        entering = self._keep_read_names(self._liveness.at_begin.get(routine, set()), state)
        brings_new_contents = self._join_into(self._flow.begins[routine], entering)
        is_entered_already = routine in self._entered_routines
        can_enter = not is_entered_already and len(self._entered_routines) < _MAX_CALLS
        if brings_new_contents and can_enter:
            self._propagate_through(routine, self._state_operations[routine])

    def _return_from(self, routine: str, i: int, state: State, at_exit: State) -> State:
        """Return the state behind the call of a routine: the caller's, with what the routine may change.

        A state has the content of each variable. Behind `GRIP()`, a base that GRIP never sets is that before
        the call; a tool that GRIP sets is that at the end of GRIP. If GRIP calls an unknown routine, all
        contents are those at the end of GRIP.

        Args:
            routine: the called routine.
            i: index of the call.
            state: state before the call.
            at_exit: state at the end of the routine.
        """
        names = self._list_changed_by_call(routine, i)
        self._work.count(len(names))
        may_change_all = UNKNOWN in self._changes.of_routine[routine]
        if may_change_all:
            after = dict(at_exit)
        else:
            after = dict(state)
            for name in names:
                after[name] = self._contents.look_up(at_exit, name)
        is_never_reached = UNREACHED in state or UNREACHED in at_exit
        if is_never_reached:
            after[UNREACHED] = NOT_SET
        return after

    def _list_changed_by_call(self, routine: str, i: int) -> list[str]:
        """Return the names that a called routine may change, and that something behind the call may read.

        Args:
            routine: the called routine.
            i: index of the call.
        """
        changed = self._changes.of_routine[routine]
        read_behind_call = [name for name in self._liveness.returned.get(i, ()) if name in changed]
        return [*self._always_returned.get(routine, ()), *read_behind_call]

    def _join_into(self, i: int, state: State | None) -> bool:
        """Join a state into the one in which jumps reach operation i; return whether the joined state is new.

        A state has the content of each variable. Contents that nothing reads from there on are left out.
        """
        known = self._incoming.get(i)
        if state is not None:
            state = self._leave_out_unread(i, state)
        joined = self._join_states(known, state)
        if joined is None or joined is known:
            return False
        self._incoming[i] = joined
        self._state_changed = True
        return True

    def _join_states(self, first: State | None, second: State | None) -> State | None:
        """Return the state, the contents of all variables, behind a place where two paths meet.

        If both branches of an IF set `$TOOL=TOOL_DATA[1]`, the tool is known behind ENDIF. If they set
        different tools, a cause why the tool is unknown takes its place. None is the state of a place that no
        path reaches. If nothing changes, the object `first` is returned.
        """
        if first is None:
            return second
        if second is None or first == second:
            return first
        is_first_unreached, is_second_unreached = UNREACHED in first, UNREACHED in second
        if is_first_unreached != is_second_unreached:  # one of the paths ends with a jump to elsewhere
            return second if is_first_unreached else first
        joined = dict(first)
        self._work.count(len(second) + len(first))
        for name in {**first, **second}:
            is_same_entry = name in first and name in second and first[name] == second[name]
            if not is_same_entry:
                self._join_contents(name, first, second, joined)
        return first if joined == first else joined

    def _join_contents(self, name: str, first: State, second: State, joined: State) -> None:
        """Store in the joined state of two paths that a content is unknown, if it differs on the paths.

        1. Both have the same content, or it is unknown on the first path: `joined`, a copy of the state
           `first`, stays as it is.
        2. It is unknown on the second path only: the cause of this path is stored.
        3. The contents differ, as `$TOOL` after different assignments behind IF and ELSE: the cause that the
           name changes is stored.
        """
        on_first = self._contents.look_up(first, name)
        on_second = self._contents.look_up(second, name)
        is_unknown_on_first = on_first.cause is not None
        if is_unknown_on_first or self._are_equal(name, on_first.content, on_second.content):
            return
        at = max(on_first.place, on_second.place)
        cause = on_second.cause or _explain_change(name, at)
        joined[name] = Entry(cause, at)

    def _are_equal(self, name: str, first: Content, second: Content) -> bool:
        """Return whether two contents of a name are the same, or the same numbers of an active frame."""
        return first == second or self._contents.have_equal_frames(name, first, second)

    def _find_what_outlasts_routines(self) -> None:
        """Let each mode, such as force control, be on at any time if it is on where a routine ends.

        In a language in which other programs call the routines (`callable_from_outside`), the next routine
        may be called while the mode is on. In other languages, the calls themselves show this.
        """
        if not self._language.callable_from_outside:
            return
        # The first name is of what no statement ends: it is on from its beginning anyway.
        _, *names_with_end = self._changes.lasting
        for name in names_with_end:
            for state_at_exit in self.exits.values():
                if state_at_exit is None:
                    continue
                cause = state_at_exit.get(name, NOT_SET).cause
                if cause is not None:
                    self._changes.anytime[name] = cause


def _leave_out(names: Collection[str], state: State) -> State:
    """Return a state without some names; the same object if the state has none of them."""
    left_out = state.keys() & names
    if not left_out:
        return state
    return {name: entry for name, entry in state.items() if name not in left_out}


def _list_always_returned(changes: Changes, liveness: Liveness) -> dict[str, list[str]]:
    """Return the names that each routine may change, without those whose readers are known.

    Behind a call of the routine, their contents are those at the end of the routine. Of all other names, the
    readers are known: `liveness.returned` tells whether one of them is reached behind the call.
    """
    always_returned = dict[str, list[str]]()
    for routine, changed in changes.of_routine.items():
        always_returned[routine] = [name for name in changed if name not in liveness.followed]
    return always_returned
