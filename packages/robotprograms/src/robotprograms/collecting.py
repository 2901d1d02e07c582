"""Changes anywhere in a program: which statements and routines may change which names."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection

from robotprograms import language as ir
from robotprograms.columns import Cause, get_variable
from robotprograms.declarations import UNKNOWN, State, list_read_names
from robotprograms.effects import FollowedProgram
from robotprograms.errors import quote_text
from robotprograms.language import Name
from robotprograms.places import Place
from robotprograms.program import At


class ChangeCollector:
    """Collects which statements and routines change which names, before states are followed."""

    def __init__(self, program: FollowedProgram) -> None:
        """Prepare to collect the changes of a program.

        The `changes` of its statements are filled, and routines of events are added to its calls.
        """
        self._statements = statements = program.statements
        self._ops, self._places = statements.ops, statements.places
        self._language, self._contents = statements.language, statements.contents
        self._declarations, self._uses = statements.declarations, statements.uses
        self._changes, self._faults = statements.changes, program.faults
        self._flow, self._calls, self._effects = program.flow, program.calls, program.effects
        self._tool_names: set[str] = set()  # names of the tools of moves
        # indices of operations that change only names which nothing reads, such as counters
        self.unread: set[int] = set()
        self.callers: dict[str, set[str]] = defaultdict(set)  # callers of each routine

    def collect(self) -> None:
        """Collect, for each name, the statements anywhere in the program that may change its content.

        The order of the steps matters. Routines are attached to events first, because the call of an event
        then means these routines. Calls come behind all other statements, because a call changes a variable
        that it passes on only if a statement of the called routine does so.
        """
        for place, op in zip(self._places, self._ops, strict=True):
            if isinstance(op, ir.Assign):
                self._collect_assignment(place, op)
            elif isinstance(op, ir.Call) and op.event:
                self._attach_to_event(place, op)
        for place, op in zip(self._places, self._ops, strict=True):
            if isinstance(op, ir.MakeUnknown):
                self._collect_unknown_values(place, op)
        self._collect_calls()
        self._summarise_routines()
        self._collect_anytime_routines()
        self._find_new_meanings()
        self._note_names_of_several_routines()

    def _attach_to_event(self, place: Place, op: ir.Call) -> None:
        """Note an event of the program, and the routine that the call attaches to it.

        A routine that is known to be harmless is left out.
        """
        routines_of_event = self._calls.attached[place.qualify(op.event)]  # added if the event is new
        if not op.harmless:
            routines_of_event.append(place.qualify(op.name))

    def _collect_assignment(self, place: Place, op: ir.Assign) -> None:
        """Note that a name gets a content at a statement."""
        name = place.qualify(op.name)
        cause = place.make_cause(f"the name gets numbers on line {place.line}")
        self._changes.of_name[name].append(cause)
        switches_mode = name.startswith(ir.MODE)  # force control and the like
        if switches_mode:
            self._changes.lasting[name] = None
        if op.name == "pi":
            self._changes.routines_of_pi.add(place.scope.routine)

    def _collect_calls(self) -> None:
        """Note what all calls may change."""
        calls = list[tuple[Place, ir.Call]]()
        for place, op in zip(self._places, self._ops, strict=True):
            if isinstance(op, ir.Call):
                changes_nothing = op.harmless and op.name not in self._flow.begins
                if not changes_nothing:
                    calls.append((place, op))
            elif isinstance(op, ir.Move):
                self._tool_names.update(self._list_multiplied_tools(place, op))
        passed = {place.qualify(name) for place, call in calls for name in call.passed}
        changed_elements = [name for name in self._changes.of_name if "[" in name]
        self._changes.arrays.update(map(get_variable, changed_elements))
        for place, call in calls:
            self._collect_call(place, call, passed)

    @staticmethod
    def _list_multiplied_tools(place: Place, op: ir.Move) -> set[str]:
        """Return the full names of the frames whose product is the tool of a move."""
        names = set[str]()
        for tool in op.tools:
            if isinstance(tool, ir.Product):
                names.update(map(place.qualify, tool.names))
        return names

    def _collect_anytime_routines(self) -> None:
        """Let each name change at any time that is changed by a routine which may run at any time.

        Such a routine handles errors or interrupts, or is called by a timer. Two of its changes do not count:

        1. It ends a mode, such as force control: that spoils no move. Such a change is a cause without a
           reason.
        2. It calls an unknown routine, and is attached to an event: the call counts as one at the statement
           that attaches the routine, because it cannot run before.
        """
        for routine in sorted(self._flow.anytime_routines):
            is_attached = routine in self._calls.attached_routines
            for name, cause in self._changes.of_routine[routine].items():
                only_ends_what_lasts = not cause.reason
                counts_at_attachment = is_attached and name == UNKNOWN
                if not (only_ends_what_lasts or counts_at_attachment):
                    self._changes.anytime[name] = cause

    def _find_new_meanings(self) -> None:
        """Let no move be certain if the program gives constants of the controller a new meaning.

        In URScript, `d2r` and `pose_trans` are functions on which the reading of poses relies. A routine, a
        variable or an assignment with such a name gives it a new meaning.
        """
        own_names = {*self._flow.begins, *self._declarations.names}
        for place in self._places:
            own_names |= place.scope.names
        for op in self._ops:
            if isinstance(op, ir.Assign):
                own_names.add(str(op.name))
                continue
            is_unknown_assignment = isinstance(op, ir.MakeUnknown) and len(op.names) == 1
            if is_unknown_assignment:
                own_names.update(map(str, _list_changed_names(op)))
        for name in sorted(self._language.fixed_words & own_names):
            reason = f"the program gives {quote_text(name)} a meaning of its own"
            self._changes.anytime[ir.MODE] = Cause(0, reason, "choose another name")

    def _note_names_of_several_routines(self) -> None:
        """Let names be unknown that several routines assign to, if each of them may have its own variable.

        In languages such as URScript, a name is then a variable of the routine unless it is global, which
        cannot be seen for sure.
        """
        if not self._language.scopes_by_routine:
            return
        for name, routines in self._find_changing_routines().items():
            is_of_controller = name in self._language.active or name.startswith(ir.MODE)
            if len(routines) > 1 and not is_of_controller:
                reason = f"{name} gets values in several routines, and each routine may have its own variable"
                line = self._changes.of_name[name][0].line
                self._changes.anytime[name] = Cause(line, reason, "use a name for each variable")

    def _find_changing_routines(self) -> dict[str, set[str]]:
        """Return the routines with a statement that changes a name, by the full names."""
        routines_of_name = defaultdict[str, set[str]](set)
        for place, op, routine in zip(self._places, self._ops, self._flow.routine_of, strict=False):
            for name in _list_changed_names(op):
                routines_of_name[place.qualify(name)].add(routine)
        return routines_of_name

    def _collect_unknown_values(self, place: Place, op: ir.MakeUnknown) -> None:
        """Note why values become unknown at a statement, for each name that the statement changes.

        Args:
            place: place of the statement.
            op: names that get unknown values (none for all that other routines may change), and the reason.
        """
        cause = place.make_cause(op.reason, op.remedy)
        self._changes.causes.append(cause)
        names = [name for name in map(place.qualify, op.names) if name not in self._declarations.fixed]
        for name in names:
            self._changes.of_name[name].append(cause)
            switches_mode = name.startswith(ir.MODE)  # force control and the like
            if switches_mode:
                self._changes.lasting[name] = None
        if self._language.calls_by_name:  # names of a statement that is not understood may be called there
            self._flow.anytime_routines |= self._flow.begins.keys() & set(names)
        if op.anytime:
            self._make_unknown_anytime(names, cause)

    def _make_unknown_anytime(self, names: Collection[str], cause: Cause) -> None:
        """Note that a cause makes names unknown at any time, with their fields, such as `P.UF` for `P`.

        Without names, it makes all unknown that other routines may change.
        """
        changed = list[str]()
        for name in names:
            changed += self._contents.list_name_and_fields(name)
        self._changes.anytime |= dict.fromkeys(changed or [UNKNOWN], cause)

    def _collect_call(self, place: Place, op: ir.Call, passed: Collection[str]) -> None:
        """Note what a call may change: the arguments of the routine, and for an unknown routine all names.

        Args:
            place: place of the call.
            op: the call.
            passed: names that any call of the program passes as arguments.
        """
        own_routines = self._calls.list_meant(op)  # routines of the program that may be meant
        arguments = set(map(place.scope.qualify, op.passed))
        for routine in own_routines:
            for parameter in self._list_parameters(routine):
                # The value of a parameter comes from the arguments of the calls.
                self._uses.origins[parameter].update(dict.fromkeys(arguments, place.at))
        if self._may_change_arguments(op, own_routines, passed):
            self._forget_arguments(place, op, arguments - self._declarations.fixed, own_routines)
        if op.anytime:
            self._flow.anytime_routines.update(own_routines)
        self._note_called_routine(place, op)

    def _note_called_routine(self, place: Place, op: ir.Call) -> None:
        """Note what a call shows about the called routine.

        The routine may be one of the program, of another file, or all routines that are attached elsewhere to
        the event that the call names.
        """
        cause = self._calls.explain_unknown(place, op)
        is_of_program = op.name in self._flow.begins
        is_event = place.qualify(op.name) in self._calls.attached
        if is_of_program and op.event:
            self._calls.attached_routines.add(str(op.name))
        elif cause is not None and not is_of_program:
            self._note_unknown_routine(op, cause)
        elif not (is_of_program or is_event):
            self._remark_allowed_routine(place, op)

    def _note_unknown_routine(self, op: ir.Call, cause: Cause) -> None:
        """Note that a call may change any value, for a cause: the routine of another file is not allowed."""
        self._changes.causes.append(cause)
        runs_at_any_time = op.anytime and not op.event
        if runs_at_any_time:
            self._changes.anytime[UNKNOWN] = cause

    def _remark_allowed_routine(self, place: Place, op: ir.Call) -> None:
        """Add a remark that a routine of another file is called, which the user allows."""
        if isinstance(op.name, ir.NumberedName):
            name = place.qualify(op.name)  # with its number
        else:
            name = self._statements.restore_spelling(place, op.name)
        permission = "the request states that this routine neither moves the robot nor changes frames"
        self._statements.columns.add_remark(place.at, f"{name} is called; {permission}")

    def _may_change_arguments(self, op: ir.Call, own: list[str], passed: Collection[str]) -> bool:
        """Return whether a call may change the variables that it passes as arguments.

        In `grip(p1)`, the routine may write to p1. There are two cases:

        1. grip is of another file: it may if it gets references to variables, or is a function of the
           language that writes its last argument. A permission of the user speaks of the robot's motion only,
           and does not matter here.
        2. grip is of the program: it may if its statements change its parameters.

        Args:
            op: the call.
            own: routines of the program that may be meant.
            passed: names that any call of the program passes as arguments.
        """
        is_of_program = op.name in self._flow.begins
        writes_last_argument = re.fullmatch(self._language.writers, str(op.name)) is not None
        gets_references = not op.harmless and op.name not in self._statements.by_value
        if not is_of_program and (gets_references or writes_last_argument):
            return True
        return any(self._may_change_parameters(routine, passed) for routine in own)

    def _forget_arguments(self, place: Place, op: ir.Call, given: set[str], own: list[str]) -> None:
        """Note that a call may change its arguments, from then on at any time.

        Tools that a function of another file gets stay as they are, if such functions only read them.

        Args:
            place: place of the call.
            op: the call.
            given: full names that the routine gets as arguments.
            own: routines of the program that the call may mean.
        """
        reason = f"{quote_text(str(op.name))} gets this name as an argument, and may change its value"
        cause = place.make_cause(reason)
        if op.reads_frames and not own:
            given = given - self._assume_frames_stay(place, op, given)
        for name in given:
            self._changes.of_name[name].append(cause)
            for name_or_field in self._contents.list_name_and_fields(name):
                self._changes.anytime[name_or_field] = cause

    def _assume_frames_stay(self, place: Place, op: ir.Call, given: Collection[str]) -> set[str]:
        """Return the tools that a function of another file gets, and note that they are assumed to stay.

        `given` are the full names of the arguments of the call `op`.
        """
        tools = set[str]()
        for name in given:
            if self._tool_names.intersection(self._contents.list_name_and_fields(name)):
                tools.add(name)
        if tools:
            names = ", ".join(map(quote_text, sorted(tools)))
            text = f"it is assumed that the function {quote_text(str(op.name))} only uses {names}"
            self._statements.columns.add_remark(place.at, text)
        return tools

    def _may_change_parameters(self, routine: str, passed: Collection[str]) -> bool:
        """Return whether a routine of the program may change its parameters, or passes them to others.

        A call gives arguments by reference, so that such a change would be one of the caller's variables. A
        routine without parameters gets its arguments in an unknown way, and may change them.

        Where a routine begins, an operation makes each of its parameters unknown: so each has one change, and
        only further changes are those of its statements.

        Args:
            routine: name of the routine.
            passed: names that any call of the program passes as arguments.
        """
        parameters = self._list_parameters(routine)
        if not parameters:
            return True
        fields = {field for name in parameters for field in self._contents.list_name_and_fields(name)}
        count_of_changes = sum(len(self._changes.of_name.get(field, ())) for field in fields)
        # Where a routine begins, each of its parameters is made unknown: that is one change of each.
        is_changed = count_of_changes > len(parameters)
        is_passed_on = not parameters.isdisjoint(passed)
        is_changed_array = not parameters.isdisjoint(self._changes.arrays)
        return is_changed or is_passed_on or is_changed_array

    def _list_parameters(self, routine: str) -> set[str]:
        """Return the full names of the parameters of a routine of the program.

        Readers of languages add one operation behind the beginning of a routine with parameters: it makes the
        parameters unknown, with the reason `ir.IS_PARAMETER`. Its names are the parameters.
        """
        begin = self._flow.begins[routine]
        first_operation, place = self._ops[begin + 1], self._places[begin]
        if not isinstance(first_operation, ir.MakeUnknown) or first_operation.reason != ir.IS_PARAMETER:
            return set()
        return set(map(place.qualify, first_operation.names))

    def _find_unread_operations(self) -> None:
        """Note in `unread` the operations that change only names which no move, frame or copy reads.

        Such as `n=n+1`, if n only counts parts. The interpretation leaves these operations out: with them,
        its time grows with the square of the program's length.
        """
        read = self._list_read_variables()
        for i, (place, op) in enumerate(zip(self._places, self._ops, strict=True)):
            variables = {get_variable(place.qualify(name)) for name in _list_changed_names(op)}
            if variables and variables.isdisjoint(read):
                self.unread.add(i)

    def _list_read_variables(self) -> set[str]:
        """Return the variables, without fields and indices, whose contents are looked up in states.

        Operations read them, or they are found through the contents of other variables.
        """
        names = self._statements.list_indirectly_read_names()
        for place, op in zip(self._places, self._ops, strict=True):
            names.update(map(place.qualify, list_read_names(op)))
        return set(map(get_variable, names))

    def _summarise_routines(self) -> None:
        """Find the names that each routine may change, also through the routines that it calls."""
        self._find_unread_operations()
        for i, op in enumerate(self._ops):
            if i not in self.unread:
                self._summarise_operation(i, op)
        self._summarise_faults_and_attachments()
        self._pass_changes_to_callers()

    def _pass_changes_to_callers(self) -> None:
        """Add what each routine may change to the changes of its callers, until nothing is added any more."""
        changes_of_routine = self._changes.of_routine  # names with the cause of the change
        to_visit = [*changes_of_routine]  # routines whose callers may change more names than noted
        while to_visit:
            routine = to_visit.pop()
            for caller in self.callers.get(routine, ()):
                changes_of_caller = changes_of_routine[caller]
                count_before = len(changes_of_caller)
                for name, cause in changes_of_routine[routine].items():
                    changes_of_caller.setdefault(name, cause)
                if len(changes_of_caller) > count_before:
                    to_visit.append(caller)

    def _summarise_operation(self, i: int, op: ir.Op) -> None:
        """Note what operation i changes as changes of its routine, and the routines that it calls."""
        routine = self._flow.routine_of[i]
        called = self._calls.list_called(op) if isinstance(op, ir.Call) else []
        for called_routine in called:
            self.callers[called_routine].add(routine)
        is_call_of_own_routine = isinstance(op, ir.Call) and op.name in called
        if is_call_of_own_routine:  # its changes are those of the called routine, which are noted there
            return
        for name, entry in self._find_changed_entries(i).items():
            cause = entry.cause or self._explain_change(name, entry.place)
            self._changes.of_routine[routine][name] = cause

    def _find_changed_entries(self, i: int) -> State:
        """Return the names that operation i changes, with their new contents.

        The operation is applied to an empty state: the state then has the names that it changes.
        """
        changed: State = {}
        self._effects.apply(changed, i)
        return changed

    def _explain_change(self, name: str, at: At) -> Cause:
        """Return the cause that a name gets a known content while the program runs, by the statement at `at`.

        The cause has no reason if the statement ends what lasts, such as force control: that spoils no move.
        """
        ends_what_lasts = name in self._changes.lasting
        reason = "" if ends_what_lasts else f"{name} changes while the program runs"
        return Cause(at.line, reason, "give the value once, in numbers", at.source)

    def _summarise_faults_and_attachments(self) -> None:
        """Add to the changes of routines what faults, and routines attached to events, change.

        A fault, such as a missing end, makes all moves behind it uncertain: `ir.MODE` is changed. An attached
        routine that calls an unknown one makes all names unknown.
        """
        changes_of_routine, routine_of = self._changes.of_routine, self._flow.routine_of
        for i, fault in self._flow.uncertain.items():
            changes_of_routine[routine_of[i]].setdefault(ir.MODE, self._faults[fault])
        for i, (place, op) in enumerate(zip(self._places, self._ops, strict=True)):
            cause = self._calls.find_unknown_in_attached(place, op) if isinstance(op, ir.Call) else None
            if cause is not None:
                changes_of_routine[routine_of[i]].setdefault(UNKNOWN, cause)


def _list_changed_names(op: ir.Op) -> Collection[Name]:
    """Return the names that an operation assigns to or makes unknown, as the program writes them."""
    if isinstance(op, ir.Assign):
        return (op.name,)
    if isinstance(op, ir.MakeUnknown):
        return op.names
    return ()
