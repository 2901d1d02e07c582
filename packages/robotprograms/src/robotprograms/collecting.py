"""Changes anywhere in a program: which statements and routines may change which names."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping

from robotprograms import language as ir
from robotprograms.calls import Calls
from robotprograms.columns import Cause
from robotprograms.control_flow import ControlFlow
from robotprograms.declarations import UNKNOWN, State, get_variable, list_read_names
from robotprograms.effects import Effects
from robotprograms.errors import quote_text
from robotprograms.language import Name
from robotprograms.places import Place
from robotprograms.statements import Statements


class ChangeCollector:
    """Collector of the changes of a program."""

    def __init__(
        self,
        statements: Statements,
        flow: ControlFlow,
        calls: Calls,
        effects: Effects,
        faults: Mapping[int, Cause],
    ) -> None:
        """Prepare to collect the changes of a program.

        Args:
            statements: statements of the program; its `changes` are filled.
            flow: control flow of the program.
            calls: calls of the program; routines of events are added.
            effects: effects of the operations.
            faults: causes by the indices of operations that do not fit.
        """
        self._statements, self._ops, self._places = statements, statements.ops, statements.places
        self._language, self._contents = statements.language, statements.contents
        self._declarations, self._uses = statements.declarations, statements.uses
        self._changes, self._flow, self._calls, self._effects = statements.changes, flow, calls, effects
        self._faults = faults
        self._tool_names: set[str] = set()  # names of the tools of moves
        # indices of operations that change only names which nothing reads, such as counters
        self.unread: set[int] = set()
        self.callers: dict[str, set[str]] = defaultdict(set)  # callers of each routine

    def collect(self) -> None:
        """Collect, for each name, the statements anywhere in the program that may change its content."""
        for place, op in zip(self._places, self._ops, strict=True):
            if isinstance(op, ir.Assign):
                self._collect_assignment(place, op)
            elif isinstance(op, ir.Call) and op.event:
                routines_of_event = self._calls.attached[place.qualify(op.event)]
                if not op.harmless:
                    routines_of_event.append(place.qualify(op.name))
        for place, op in zip(self._places, self._ops, strict=True):
            if isinstance(op, ir.MakeUnknown):
                self._collect_unknown_values(place, op)
        self._collect_calls()
        self._summarise_routines()
        self._collect_anytime_routines()
        self._find_new_meanings()
        self._note_names_of_several_routines()

    def _collect_assignment(self, place: Place, op: ir.Assign) -> None:
        """Note that a name gets a content at a statement."""
        name = place.qualify(op.name)
        cause = place.make_cause(f"the name gets numbers on line {place.line}")
        self._changes.of_name[name].append(cause)
        if name.startswith(ir.MODE):
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
                for tool in op.tools:
                    if isinstance(tool, ir.Product):
                        self._tool_names.update(map(place.qualify, tool.names))
        passed = {place.qualify(name) for place, call in calls for name in call.passed}
        changed_elements = [name for name in self._changes.of_name if "[" in name]
        self._changes.arrays.update(map(get_variable, changed_elements))
        for place, call in calls:
            self._collect_call(place, call, passed)

    def _collect_anytime_routines(self) -> None:
        """Let names change at any time that a routine changes which may run at any time."""
        for routine in sorted(self._flow.anytime_routines):
            is_attached = routine in self._calls.attached_routines
            for name, cause in self._changes.of_routine[routine].items():
                # An unknown routine that an attached one calls counts as called where this one is attached.
                is_noted_at_attachment = is_attached and name == UNKNOWN
                if cause.reason and not is_noted_at_attachment:
                    self._changes.anytime[name] = cause

    def _find_new_meanings(self) -> None:
        """Let no move be certain if the program gives constants of the controller a new meaning."""
        own_names = {*self._flow.begins, *self._declarations.names}
        for place in self._places:
            own_names |= place.scope.names
        for op in self._ops:
            if isinstance(op, ir.Assign):
                own_names.add(str(op.name))
            elif isinstance(op, ir.MakeUnknown) and len(op.names) == 1:  # of an assignment
                own_names.update(map(str, op.names))
        for name in sorted(self._language.fixed_words & own_names):
            reason = f"the program gives {quote_text(name)} a meaning of its own"
            self._changes.anytime[ir.MODE] = Cause(0, reason, "choose another name")

    def _note_names_of_several_routines(self) -> None:
        """Let names be unknown that several routines assign to, if each of them may have its own variable."""
        if not self._language.scopes_by_routine:
            return
        routines_of_name = defaultdict[str, set[str]](set)
        for place, op, routine in zip(self._places, self._ops, self._flow.routine_of, strict=False):
            changed_names: Iterable[Name] = ()
            if isinstance(op, ir.Assign):
                changed_names = [op.name]
            elif isinstance(op, ir.MakeUnknown):
                changed_names = op.names
            for name in changed_names:
                routines_of_name[place.qualify(name)].add(routine)
        for name, routines in routines_of_name.items():
            is_of_controller = name in self._language.active or name.startswith(ir.MODE)
            if len(routines) > 1 and not is_of_controller:
                reason = f"{name} gets values in several routines, and each routine may have its own variable"
                line = self._changes.of_name[name][0].line
                self._changes.anytime[name] = Cause(line, reason, "use a name for each variable")

    def _collect_unknown_values(self, place: Place, op: ir.MakeUnknown) -> None:
        """Note why values become unknown at a statement, for each name that the statement changes."""
        cause = place.make_cause(op.reason, op.remedy)
        self._changes.causes.append(cause)
        names = [name for name in map(place.qualify, op.names) if name not in self._declarations.fixed]
        for name in names:
            self._changes.of_name[name].append(cause)
            if name.startswith(ir.MODE):
                self._changes.lasting[name] = None
        if self._language.calls_by_name:  # names of a statement that is not understood may be called there
            self._flow.anytime_routines |= self._flow.begins.keys() & set(names)
        if op.anytime:
            fields = [field for name in names for field in self._contents.list_name_and_fields(name)]
            self._changes.anytime |= dict.fromkeys(fields or [UNKNOWN], cause)

    def _collect_call(self, place: Place, op: ir.Call, passed: Collection[str]) -> None:
        """Note what a call may change: the arguments of the routine, and for an unknown routine all names.

        `passed` are the names that any call of the program passes as arguments.
        """
        own_routines = self._calls.list_meant(op)  # routines of the program that may be meant
        arguments = set(map(place.scope.qualify, op.passed))
        for routine in own_routines:
            for parameter in self._list_parameters(routine):
                self._uses.origins[parameter].update(dict.fromkeys(arguments, place.at))
        if self._changes_arguments(op, own_routines, passed):
            self._forget_arguments(place, op, arguments - self._declarations.fixed, own_routines)
        if op.anytime:
            self._flow.anytime_routines.update(own_routines)
        self._note_called_routine(place, op)

    def _note_called_routine(self, place: Place, op: ir.Call) -> None:
        """Note an attached routine of the program, or what is not known or assumed of another routine."""
        unknown = self._calls.explain_unknown(place, op)  # why the routine is unknown, or None
        if op.name in self._flow.begins:
            if op.event:
                self._calls.attached_routines.add(str(op.name))
        elif unknown:
            self._changes.causes.append(unknown)
            if op.anytime and not op.event:
                self._changes.anytime[UNKNOWN] = unknown
        elif place.qualify(op.name) not in self._calls.attached:
            permission = "the request states that this routine neither moves the robot nor changes frames"
            if isinstance(op.name, ir.NumberedName):
                name = place.qualify(op.name)  # with its number
            else:
                name = self._statements.restore_spelling(place, op.name)
            self._statements.columns.add_remark(place.at, f"{name} is called; {permission}")

    def _changes_arguments(self, op: ir.Call, own: list[str], passed: Collection[str]) -> bool:
        """Return whether a call may change its arguments.

        No statement of the user about a routine covers data that the routine gets by reference.

        Args:
            op: the call.
            own: routines of the program that may be meant.
            passed: names that any call of the program passes as arguments.
        """
        is_own = op.name in self._flow.begins
        is_writer = re.fullmatch(self._language.writers, str(op.name)) is not None
        gets_references = not op.harmless and op.name not in self._statements.by_value
        if not is_own and (gets_references or is_writer):
            return True
        return any(self._changes_parameters(routine, passed) for routine in own)

    def _forget_arguments(self, place: Place, op: ir.Call, given: set[str], own: list[str]) -> None:
        """Note that a call may change its arguments at any time.

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

    def _changes_parameters(self, routine: str, passed: Collection[str]) -> bool:
        """Return whether a routine of the program may change its parameters, or passes them to others.

        `passed` are the names that any call of the program passes as arguments.
        """
        parameters = self._list_parameters(routine)
        if not parameters:
            return True  # arguments without parameters
        fields = {field for name in parameters for field in self._contents.list_name_and_fields(name)}
        count_of_changes = sum(len(self._changes.of_name.get(field, ())) for field in fields)
        # The beginning of the routine itself makes each parameter unknown, once.
        is_changed = count_of_changes > len(parameters)
        is_passed = not parameters.isdisjoint(passed)
        return is_changed or is_passed or not parameters.isdisjoint(self._changes.arrays)

    def _list_parameters(self, routine: str) -> set[str]:
        """Return the names of the parameters of a routine of the program."""
        begin = self._flow.begins[routine]
        op, place = self._ops[begin + 1], self._places[begin]
        if not isinstance(op, ir.MakeUnknown) or op.reason != ir.IS_PARAMETER:
            return set()
        return set(map(place.qualify, op.names))

    def _find_unread_operations(self) -> None:
        """Find the operations that change only names which no move, frame or copy reads.

        States leave these names out: with them, the time grows with the square of the program's length.
        """
        read = self._list_read_variables()
        for i, (place, op) in enumerate(zip(self._places, self._ops, strict=True)):
            changed: Iterable[Name] = ()
            if isinstance(op, ir.Assign):
                changed = (op.name,)
            elif isinstance(op, ir.MakeUnknown):
                changed = op.names
            variables = {get_variable(place.qualify(name)) for name in changed}
            if variables and variables.isdisjoint(read):
                self.unread.add(i)

    def _list_read_variables(self) -> set[str]:
        """Return the names, without fields and indices, whose contents are looked up in states."""
        active, declarations = self._language.active, self._declarations
        names = {*self._changes.lasting, *active, *active.values(), *declarations.list_contained_names()}
        for place, offset in self._uses.offsets:
            names |= {place.qualify(offset.name), place.qualify(offset.target)}
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
        of_routine = (
            self._changes.of_routine
        )  # by the name of the routine, names with the cause of the change
        to_visit = [*of_routine]  # routines whose callers may change more names than noted
        while to_visit:
            routine = to_visit.pop()
            for caller in self.callers.get(routine, ()):
                names_of_caller = of_routine[caller]
                count_before = len(names_of_caller)
                for name, cause in of_routine[routine].items():
                    names_of_caller.setdefault(name, cause)
                if len(names_of_caller) > count_before:
                    to_visit.append(caller)

    def _summarise_operation(self, i: int, op: ir.Op) -> None:
        """Note what operation i changes, and the routines that it calls."""
        routine = self._flow.routine_of[i]
        called = self._calls.list_called(op) if isinstance(op, ir.Call) else []
        for called_routine in called:
            self.callers[called_routine].add(routine)
        state: State = {}  # an operation on an empty state leaves the names that it changes
        calls_own_routine = isinstance(op, ir.Call) and op.name in called
        if not calls_own_routine:
            self._effects.apply(state, i)
        for name, (content, at) in state.items():
            if isinstance(content, Cause):
                self._changes.of_routine[routine][name] = content
            else:
                is_lasting = name in self._changes.lasting
                reason = "" if is_lasting else f"{name} changes while the program runs"
                cause = Cause(at.line, reason, "give the value once, in numbers", at.source)
                self._changes.of_routine[routine][name] = cause

    def _summarise_faults_and_attachments(self) -> None:
        """Add to the changes of routines what faults and routines that are attached to events change."""
        routine_of = self._flow.routine_of
        for i, fault in self._flow.uncertain.items():
            self._changes.of_routine[routine_of[i]].setdefault(ir.MODE, self._faults[fault])
        for i, (place, op) in enumerate(zip(self._places, self._ops, strict=True)):
            if isinstance(op, ir.Call) and (cause := self._calls.find_unknown_in_attached(place, op)):
                self._changes.of_routine[routine_of[i]].setdefault(UNKNOWN, cause)
