"""Interpreter of programs in the intermediate language, which propagates constants along the control flow.

A state holds the value of each name on every path to a statement: numbers in the text, a name, or the cause
why the value is unknown. Where paths meet, values that differ are unknown. The program is passed through
until no state changes any more.
"""

from __future__ import annotations

import re
from array import array
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial, reduce
from itertools import chain
from sys import intern
from typing import Final, NoReturn, TypeAlias

import numpy as np

from robotprograms import language as ir
from robotprograms.arrays import FloatArray, IndexArray
from robotprograms.columns import (
    IN_MODULE,
    MAX_VALUE,
    OF_ROUTINE,
    Cause,
    Columns,
    Frames,
    WrittenNumbers,
    get_array_name,
    get_structure_name,
    is_without_axes,
)
from robotprograms.control_flow import ControlFlow, UnmatchedEnd
from robotprograms.errors import (
    Fault,
    ProgramError,
    capitalise,
    decode_text,
    quote_text,
)
from robotprograms.language import Language, Misread, Name, Op, Value
from robotprograms.liveness import Liveness, Traffic, find_liveness
from robotprograms.notation import Numerals, Orientation, calculate, iterate_integers
from robotprograms.places import OTHER_FILES, Place, Scope, find_place
from robotprograms.program import At, FrameName, Literal, OwnNumbers, Source

_MAX_TRANSLATIONS: Final = 10_000
"""Largest number of cached translations; statements that differ only in their numbers share one."""
_MAX_STATEMENT: Final = 16_384
"""Largest number of characters of a statement."""
_MAX_WORK: Final = 10_000_000
"""Largest number of steps, and of names in states that are joined; programs of people need far fewer."""
_MAX_LISTED: Final = 10
"""Largest number of routines that a remark names."""
_MAX_CALLS: Final = 200
"""Largest depth of calls that are followed in one pass; deeper calls are followed in the next pass."""
UNKNOWN: Final = "\0everything"
"""Name in a state behind an unknown call: its value is the cause why values of other names are unknown."""

_NEVER: Final = "\0never"
"""Name in a state behind a jump, which no path reaches: any other state takes its place where both meet."""

Content: TypeAlias = WrittenNumbers | Cause | str
"""Content of a variable: numbers, the cause why the numbers are unknown, or the name of another value."""
Operations: TypeAlias = "list[tuple[int, Op]]"
"""Operations of a statement, each with its number of lines below the first line."""
Held: TypeAlias = "tuple[Operations, int, int]"
"""Operations of a statement that acts behind the next move, its line, and the index of its first number."""
State: TypeAlias = "dict[str, tuple[Content, At]]"
"""Content of each name, and where the statement is that set this content."""


_LEFT: Final = ir.Note("")
"""In place of a move of a further file, which is not corrected."""


def _get_variable(name: str) -> str:
    """Return the name of the variable that a name belongs to: `P` for `P[1].UF`."""
    return get_array_name(get_structure_name(name))


def _get_base(name: str) -> str:
    """Return the name of the variable that a name belongs to, without its routine."""
    return _get_variable(name).partition(OF_ROUTINE)[0]


def _list_names(value: Value | ir.Product | Name) -> list[Name]:
    """Return the names that are looked up for a value, or for a target that a move states."""
    match value:
        case ir.Product(names=names):
            return list(names)
        case ir.Element(table=table, number=number):
            return [table, number]
        case ir.Copy(name=name) | ir.Named(name=name):
            return [name]
        case ir.Stated():
            return ["pi"]
        case Literal(axes_name=axes_name):
            return [axes_name] if axes_name else []
        case ir.Unknown():
            return []
    return [value]


def _leave_moves(op: Op) -> list[Op]:
    """Return an operation of a further file: its moves are not corrected, so that their targets must stay."""
    if isinstance(op, ir.Move):
        names = frozenset(each for each in (*op.targets, *op.offset_from) if not isinstance(each, Literal))
        return [ir.Use(names), _LEFT] if names else [_LEFT]
    return [] if isinstance(op, ir.MoveToStored | ir.Note) else [op]


class Machine:
    """Interpreter of a program in the intermediate language."""

    def __init__(
        self,
        kind: str,
        sources: tuple[Source, ...],
        language: Language,
        allowed: Collection[str] = (),
        *,
        trusts_routines: bool = False,
        own: Sequence[OwnNumbers] = (),
    ) -> None:
        """Prepare to interpret a program.

        Args:
            kind: name of the program's format.
            sources: files of the program.
            language: language of the format.
            allowed: routines that, as the user states, neither move the robot nor change frames.
            trusts_routines: whether the user states this for all routines of other files.
            own: own numbers of moves that take the place of names in the first file.
        """
        self.sources, self._language, self._trusts_routines = sources, language, trusts_routines
        self.unknown_routines: dict[str, None] = {}  # routines of other files that are not allowed
        self._needs_assumption = False  # whether moves are certain that come behind calls of them
        self._first_unknown = At()  # first place at which one of them is called
        self._attached_routines: set[str] = set()  # routines of the program that are attached to an event
        self._attached: dict[str, list[str]] = defaultdict(list)  # routines of each event, by its name
        spelled = (each.encode(code, "replace") for each in allowed for code in ("latin-1", "utf-8"))
        self._allowed = frozenset(capitalise(decode_text(each)) for each in spelled)
        self.numerals = [Numerals.from_text(source.text, language.number) for source in sources]
        self.columns = Columns(kind, sources, self.numerals, language, own)
        self._ops: list[Op] = []
        self._places: list[Place] = []  # place of each operation
        self._scopes = [Scope("")]  # scopes of the routines and blocks whose end was not reached yet
        self._last_scope = Scope("")  # scope of the routine or block that ended last
        # owners of names that do not mean data of the first file, by the index of each further file
        self.owners: dict[int, dict[str, str]] = {}
        self.shared_names: frozenset[str] = frozenset()  # names of data that files declare for all programs
        # routines of other files that, as their declaration states, get all of their arguments by value
        self.by_value: frozenset[str] = frozenset()
        self._initial: dict[str, Content] = {}  # values of names before the program runs
        # the same for frames that a position states: many positions share one tuple of endings and contents
        self._initial_fields: dict[str, tuple[tuple[str, Content], ...]] = {}
        self._left_in_file: Counter[int] = Counter()  # moves of each further file, by its index
        self._shared_fields: dict[tuple[tuple[str, Content], ...], tuple[tuple[str, Content], ...]] = {}
        self._changed_arrays: set[str] = set()  # arrays whose elements statements may change
        self._fixed: set[str] = set()  # names that the program declares as constants
        self._constants: set[str] = set()  # names that only the program itself may change
        self._shared: set[str] = set()  # names that other programs may use as well
        self._stored: set[str] = set()  # those of them that the controller stores for all programs
        self._noted: set[str] = set()  # shared names of targets about which a remark was made
        self._private: set[str] = set()  # names that no other program knows
        self._changes: dict[str, list[Cause]] = defaultdict(list)  # statements that may change each name
        self._offsets: list[tuple[Place, ir.Offset]] = []
        self._offsets_of: dict[str, set[str]] = defaultdict(set)  # targets by names of poses at offsets
        # names of targets near which moves with these frames go
        self._noted_offsets: dict[tuple[object, ...], set[str]] = defaultdict(set)
        self._targets: set[str] = set()  # names of the targets of moves
        self._tool_names: set[str] = set()  # names of the tools of moves
        self._used: dict[str, At] = {}  # place at which a name is used otherwise than as a target
        # names from which each name was calculated, with the places; names of data that the program declares
        self._origins: dict[str, dict[str, At]] = defaultdict(dict)
        self._declared: set[str] = set()
        # numbers that assignments give to names; None before they are needed
        self._assigned: dict[str, WrittenNumbers] | None = None
        # names from which the place of a left move was calculated, with the frames of the move
        self._noted_origins: set[tuple[str, tuple[object, ...]]] = set()
        self._causes: list[Cause] = []  # causes of all statements that are not understood
        # names of all that may last, the first one of what no statement ends
        self._lasting: dict[str, None] = {ir.MODE: None}
        self._anytime: dict[str, Cause] = {}  # names that routines change which may run at any time
        self._changed: dict[str, dict[str, Cause]] = defaultdict(dict)  # names that each routine may change
        # indices of operations that change only names which nothing reads, such as counters
        self._unread: set[int] = set()
        self._protected: dict[str, bool] = {}  # whether unknown routines leave a name, once all is read
        self._callers: dict[str, set[str]] = defaultdict(set)  # callers of each routine
        self._incoming: dict[int, State] = {}  # joined states of all jumps to an operation
        self._liveness = Liveness()
        # names that each routine may change and that are always live
        self._always_returned: dict[str, list[str]] = defaultdict(list)
        self._exits: dict[str, State | None] = {}  # state at the end of each routine
        # indices of each routine's operations other than moves
        self._state_operations: dict[str, list[int]] = {}
        self._entered_routines: list[str] = []  # routines that are being passed through
        self._state_changed = True  # whether a state has changed in this pass
        # for each move, line and first number of each following move that differs in its numbers only
        self._repeats: dict[int, array[int]] = defaultdict(partial(array, "q"))
        self._named: dict[str, FrameName] = {}  # frames that are known by name
        self._poses: dict[tuple[WrittenNumbers, ...], FloatArray | None] = {}  # products of frames in numbers
        self._faults: dict[int, Cause] = {}  # causes by the indices of operations that do not fit
        self._work = 0  # steps of the interpretation so far

    # reading

    def refuse(self, line: int | None, reason: str, remedy: str, source: int = 0) -> NoReturn:
        """Refuse the whole program.

        Raises:
            ProgramError: always, with this fault.
        """
        raise ProgramError([Fault(self.sources[source].name, line, reason, remedy)])

    def add_statements(
        self,
        source: int,
        starts: IndexArray,
        ends: IndexArray,
        *,
        declares: str = "",
        translate: Callable[[str], list[tuple[int, Op]]] | None = None,
    ) -> None:
        """Translate statements of a file, and add their operations to the program.

        Args:
            source: index of the file.
            starts: (k,) first character of each statement.
            ends: (k,) last character + 1 of each statement.
            declares: kind of the declarations in a file of data, which hold from the beginning; else "".
            translate: function that translates the text of a statement, with NUL in place of each number;
                None takes the function of the language.

        Raises:
            ProgramError: a statement is too long, or not understood at all.
        """
        self._scopes = [Scope("", owners=self.owners.get(source, {}))]
        translate = translate or self._language.translate
        lines = np.searchsorted(self.sources[source].starts, starts, side="right")
        masked_texts, first = self.numerals[source].masked_texts(starts, ends)
        if (long := np.flatnonzero(ends - starts > _MAX_STATEMENT)).size:
            reason = f"a statement has more than {_MAX_STATEMENT} characters"
            self.refuse(int(lines[long[0]]), reason, "split the statement", source)
        translations: dict[str, Operations] = {}
        # operations of the last statement, if a repetition of this statement can differ in numbers only
        repeatable: Operations | None = None
        held: list[Held] = []  # statements that act behind the next move
        for masked, line, number in zip(
            masked_texts, iterate_integers(lines), iterate_integers(first), strict=True
        ):
            ops = translations.get(masked)
            if ops is None:
                ops = self._translate(translate, masked, line, source)
                if source and not declares:
                    ops = [(offset, each) for offset, op in ops for each in _leave_moves(op)]
                if len(translations) < _MAX_TRANSLATIONS:
                    translations[masked] = ops
            if (
                ops is repeatable and not held
            ):  # long programs are mostly such moves: they share one operation
                line_offset, _ = ops[-1]
                self._repeats[len(self._ops) - 1].extend((line + line_offset, number))
                continue
            if not declares and any(isinstance(op, ir.Call) and op.behind_next for _, op in ops):
                held.append((ops, line, number))
                continue
            repeatable = self._add_with_held(ops, source, line, number, declares, held)
        self._add_held(held, source)

    def _add_with_held(
        self, ops: Operations, source: int, line: int, number: int, declares: str, held: list[Held]
    ) -> Operations | None:
        """Add a statement, with the statements that act behind the next move before or behind it.

        Returns:
            The operations, if a repetition of the statement can differ in numbers only.
        """
        effects = [op for _, op in ops if not isinstance(op, ir.Use)]
        is_move = len(effects) == 1 and isinstance(effects[0], ir.Move)
        if effects and not is_move:
            self._add_held(held, source)
        self._add_operations(ops, source, line, number, declares)
        if is_move and held:
            self._add_held(held, source)
        elif is_move and not declares and isinstance(effects[0], ir.Move):
            return ops if len(ops) == 1 or effects[0].differs_only_in_target else None
        return None

    def _translate(
        self, translate: Callable[[str], Operations], masked: str, line: int, source: int
    ) -> Operations:
        """Translate a statement.

        Raises:
            ProgramError: the statement is not understood at all.
        """
        try:
            return translate(masked)
        except Misread as fault:
            self.refuse(line, fault.reason, fault.remedy, source)

    def _add_held(self, held: list[Held], source: int) -> None:
        """Add the operations of statements that act behind the next move, and empty their list."""
        for ops, line, number in held:
            self._add_operations(ops, source, line, number, "")
        held.clear()

    def _add_operations(
        self, ops: Iterable[tuple[int, Op]], source: int, line: int, number: int, declares: str
    ) -> None:
        """Add the operations of one statement to the program, or its declarations to the initial values.

        Args:
            ops: operations, each with its number of lines below the first line.
            source: index of the file.
            line: first line of the statement.
            number: index of the statement's first number.
            declares: kind of the declarations in a file of data; else "".
        """
        for line_offset, op in ops:
            if isinstance(op, ir.Flow):
                self._enter_scope(op, self.owners.get(source, {}))
            scope = self._scopes[-1]
            place = Place(source, line + line_offset, number, self.numerals[source].values, scope)
            if op is _LEFT:
                self._left_in_file[source] += 1
            elif isinstance(op, ir.Use):
                into = scope.routine if op.into == ir.RESULT else place.qualify(op.into)
                noted = self._origins[into] if into else self._used
                noted.update((place.qualify(name), place.at) for name in op.names)
            elif isinstance(op, ir.Note | ir.Offset | ir.Local):
                self._add_statement_about_names(place, op)
            elif isinstance(op, ir.Assign) and (declares or op.declares):
                self._declare(place, op, op.declares or declares)
            elif not declares:
                self._places.append(place)
                self._ops.append(op)

    def _add_statement_about_names(self, place: Place, op: ir.Note | ir.Offset | ir.Local) -> None:
        """Note a remark, a pose at an offset from a target, or local names."""
        if isinstance(op, ir.Note):
            self.columns.add_remark(place.at, place.make_cause(op.text).reason)
        elif isinstance(op, ir.Offset):
            self._offsets.append((place, op))
        else:
            (place.scope.names if place.scope.routine else self._declared).update(op.names)

    def forget_anytime(self, names: frozenset[str], reason: str, remedy: str) -> None:
        """Make the values of names unknown anywhere in the program, for a reason."""
        if names and self._places:
            self._places.append(replace(self._places[-1], scope=Scope("")))
            self._ops.append(ir.MakeUnknown(names, reason, remedy, anytime=True))

    def _enter_scope(self, op: ir.Flow, owners: Mapping[str, str]) -> None:
        """Enter the scope of a routine or block where it begins, and leave the scope where it ends.

        `owners` are the owners of names in the file.
        """
        if op.kind in ir.ROUTINES:  # a handler without a name shares the scope of its routine
            self._scopes.append(Scope(str(op.name), owners=owners) if op.name else self._last_scope)
        elif op.kind in ir.BLOCKS:
            self._scopes.append(self._scopes[-1])
        elif op.kind in {"close", "end", "close_or_end"} and len(self._scopes) > 1:
            self._last_scope = self._scopes.pop()

    def _declare(self, place: Place, op: ir.Assign, kind: str) -> None:
        """Note the initial content of a declared name, and whether other programs may change this content."""
        name = place.qualify(op.name)
        is_shared = op.shared or kind == "shared" or get_array_name(name) in self.shared_names
        self._shared |= {name} if is_shared else set()
        self._stored |= {name} if kind == "shared" else set()
        if op.private and not self._language.is_own(name):
            self._private.add(get_structure_name(name))
        content = self._evaluate(place, name, op.value, {})
        structure, _, ending = name.partition(".")
        if ending and self._language.is_own(name):
            fields = self._initial_fields.get(structure, ())
            if all(known != (ending, content) for known in fields):
                fields = (*fields, (ending, content))
                # the name of the position itself is stored once
                self._initial_fields[intern(structure)] = self._shared_fields.setdefault(fields, fields)
            return
        self._fixed |= {name} if op.declares == "constant" else set()
        if self._initial.setdefault(name, content) != content:
            self._initial[name] = place.make_cause(f"{name} is declared twice")
        if kind == "constant" and not self._language.is_own(name):
            self._constants.add(name)

    # changes of names anywhere in the program

    def _collect_changes(self) -> None:
        """Collect, for each name, the statements anywhere in the program that may change its content."""
        for place, op in zip(self._places, self._ops, strict=True):
            if isinstance(op, ir.Assign):
                name = place.qualify(op.name)
                self._changes[name].append(place.make_cause(f"the name gets numbers on line {place.line}"))
                self._lasting |= {name: None} if name.startswith(ir.MODE) else {}
            elif isinstance(op, ir.Call) and op.event:
                attached = self._attached[place.qualify(op.event)]
                attached += [] if op.harmless else [place.qualify(op.name)]
        for place, op in zip(self._places, self._ops, strict=True):
            if isinstance(op, ir.MakeUnknown):
                self._collect_unknown_values(place, op)
        calls = [
            (place, op)
            for place, op in zip(self._places, self._ops, strict=True)
            if isinstance(op, ir.Call) and not (op.harmless and op.name not in self._flow.begins)
        ]
        passed = {place.qualify(name) for place, op in calls for name in op.passed}
        self._tool_names = {
            place.qualify(name)
            for place, op in zip(self._places, self._ops, strict=True)
            if isinstance(op, ir.Move)
            for frame in op.tools
            if isinstance(frame, ir.Product)
            for name in frame.names
        }
        self._changed_arrays = {
            get_array_name(get_structure_name(each)) for each in self._changes if "[" in each
        }
        for place, op in calls:
            self._collect_call(place, op, passed)
        self._summarise_routines()
        for name in sorted(self._flow.anytime_routines):
            # An unknown routine that an attached routine calls counts as called where this one is attached.
            is_attached = name in self._attached_routines
            changed = self._changed[name].items()
            self._anytime |= {
                each: cause
                for each, cause in changed
                if cause.reason and not (is_attached and each == UNKNOWN)
            }

    def _find_new_meanings(self) -> None:
        """Let no move be certain if the program gives constants of the controller a new meaning."""
        given = {*self._flow.begins, *self._declared}
        given |= {name for place in self._places for name in place.scope.names}
        for op in self._ops:
            if isinstance(op, ir.Assign):
                given.add(str(op.name))
            elif isinstance(op, ir.MakeUnknown) and len(op.names) == 1:  # of an assignment
                given |= {str(each) for each in op.names}
        for name in sorted(self._language.fixed_words & given):
            reason = f"the program gives {quote_text(name)} a meaning of its own"
            self._anytime[ir.MODE] = Cause(0, reason, "choose another name")

    def _note_names_of_several_routines(self) -> None:
        """Let names be unknown that several routines assign to, if each of them may have its own variable."""
        if not self._language.scopes_by_routine:
            return
        routines: dict[str, set[str]] = defaultdict(set)
        for i, (place, op) in enumerate(zip(self._places, self._ops, strict=True)):
            names = [op.name] if isinstance(op, ir.Assign) else []
            names += op.names if isinstance(op, ir.MakeUnknown) else []
            for name in map(place.qualify, names):
                routines[name].add(self._flow.routine_of[i])
        for name, own in routines.items():
            if len(own) > 1 and name not in self._language.active and not name.startswith(ir.MODE):
                reason = f"{name} gets values in several routines, and each routine may have its own variable"
                line = self._changes[name][0].line
                self._anytime[name] = Cause(line, reason, "use a name for each variable")

    def _collect_unknown_values(self, place: Place, op: ir.MakeUnknown) -> None:
        """Note why values become unknown at a statement, for each name that the statement changes."""
        cause = place.make_cause(op.reason, op.remedy)
        self._causes.append(cause)
        names = [name for name in map(place.qualify, op.names) if name not in self._fixed]
        self._lasting |= dict.fromkeys(name for name in names if name.startswith(ir.MODE))
        if self._language.calls_by_name:  # names of a statement that is not understood may be called there
            self._flow.anytime_routines |= self._flow.begins.keys() & set(names)
        if op.anytime:
            fields = [each for name in names for each in self._list_name_and_fields(name)]
            self._anytime |= dict.fromkeys(fields or [UNKNOWN], cause)
        for name in names:
            self._changes[name].append(cause)

    def _collect_call(self, place: Place, op: ir.Call, passed: Collection[str]) -> None:
        """Note what a call may change: the arguments of the routine, and for an unknown routine all names.

        `passed` are the names that any call of the program passes as arguments.
        """
        is_own, unknown = op.name in self._flow.begins, self._explain_unknown_call(place, op)
        own = self._list_meant(op)
        cause = place.make_cause(
            f"{quote_text(str(op.name))} gets this name as an argument, and may change its value"
        )
        is_writer = re.fullmatch(self._language.writers, str(op.name)) is not None
        # No statement of the user about a routine covers data that the routine gets by reference.
        gets_references = not op.harmless and op.name not in self.by_value
        changes = (gets_references or is_writer) and not is_own
        changes = changes or any(self._changes_parameters(each, passed) for each in own)
        for parameter in {parameter for each in own for parameter in self._list_parameters(each)}:
            self._origins[parameter].update((place.scope.qualify(name), place.at) for name in op.passed)
        given = {place.scope.qualify(name) for name in (op.passed if changes else ())} - self._fixed
        if op.reads_frames and not own:
            given -= self._assume_frames_stay(place, op, given)
        for name in given:
            self._changes[name].append(cause)
            self._anytime.update(dict.fromkeys(self._list_name_and_fields(name), cause))
        self._flow.anytime_routines |= set(own) if op.anytime else set()
        if is_own:
            self._attached_routines |= {str(op.name)} if op.event else set()
        elif unknown:
            self._causes.append(unknown)
            if op.anytime and not op.event:
                self._anytime[UNKNOWN] = unknown
        elif place.qualify(op.name) not in self._attached:
            permission = "the request states that this routine neither moves the robot nor changes frames"
            name = self._restore_spelling(place, str(op.name))
            self.columns.add_remark(place.at, f"{name} is called; {permission}")

    def _assume_frames_stay(self, place: Place, op: ir.Call, given: Collection[str]) -> set[str]:
        """Return the tools that a function of another file gets, and note that they are assumed to stay."""
        frames = {name for name in given if self._tool_names.intersection(self._list_name_and_fields(name))}
        if frames:
            names = ", ".join(map(quote_text, sorted(frames)))
            text = f"it is assumed that the function {quote_text(str(op.name))} only uses {names}"
            self.columns.add_remark(place.at, text)
        return frames

    def _changes_parameters(self, routine: str, passed: Collection[str]) -> bool:
        """Return whether a routine of the program may change its parameters, or passes them to others.

        `passed` are the names that any call of the program passes as arguments.
        """
        names = self._list_parameters(routine)
        if not names:
            return True  # arguments without parameters
        fields = {field for name in names for field in self._list_name_and_fields(name)}
        # the beginning of the routine itself makes each parameter unknown, once
        changes = sum(len(self._changes.get(each, ())) for each in fields) - len(names)
        return changes > 0 or not names.isdisjoint(passed) or not names.isdisjoint(self._changed_arrays)

    def _list_parameters(self, routine: str) -> set[str]:
        """Return the names of the parameters of a routine of the program."""
        begin = self._flow.begins[routine]
        op, place = self._ops[begin + 1], self._places[begin]
        is_known = isinstance(op, ir.MakeUnknown) and op.reason == ir.IS_PARAMETER
        return set(map(place.qualify, op.names)) if is_known and isinstance(op, ir.MakeUnknown) else set()

    def _explain_unknown_call(self, place: Place, op: ir.Call) -> Cause | None:
        """Return the cause why values are unknown after a call; None if the called routine is allowed.

        The name of an event means all routines that are attached to the event.
        """
        name = place.qualify(op.name)
        names = (each for each in self._attached.get(name, [name]) if each not in self._flow.begins)
        plain = (each.partition(IN_MODULE)[0] for each in names)
        unknown = [each for each in plain if capitalise(each) not in self._allowed]
        if op.harmless or self._trusts_routines or not unknown:
            return None
        self.unknown_routines |= dict.fromkeys(unknown)
        if not self._first_unknown.line or place.at < self._first_unknown:
            self._first_unknown = place.at
        quoted = quote_text(unknown[0])
        reason = f"{quoted} is unknown: it may move the robot or change its frames"
        remedy = (
            f"if {quoted} does neither, state `trust_routines`, or name the routine in `leave_alone`: "
            f"[{quoted}]"
        )
        return place.make_cause(reason, remedy)

    def _list_name_and_fields(self, name: str) -> list[str]:
        """Return a list of a name, and the names of all fields that a structure of this name may have."""
        structure, separator, routine = name.partition(OF_ROUTINE)
        endings = self._language.field_endings
        return [name, *(f"{structure}{ending}{separator}{routine}" for ending in endings)]

    def _list_called(self, op: ir.Call) -> list[str]:
        """Return the routines of this program that a call may start directly, not at an event."""
        return [] if op.anytime else self._list_meant(op)

    def _list_meant(self, op: ir.Call) -> list[str]:
        """Return the routines of this program whose name a call may mean."""
        if op.name in self._flow.begins:
            return [str(op.name)]
        if op.prefix is None:
            return []
        self._count_work(len(self._flow.begins))
        return [each for each in self._flow.begins if each.startswith(op.prefix)]

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
            variables = {_get_variable(place.qualify(name)) for name in changed}
            if variables and variables.isdisjoint(read):
                self._unread.add(i)

    def _list_read_variables(self) -> set[str]:
        """Return the names, without fields and indices, whose contents are looked up in states."""
        names = {*self._lasting, *self._language.active, *self._language.active.values()}
        declared = chain(self._initial.values(), (each for pairs in self._shared_fields for _, each in pairs))
        names |= {content for content in declared if isinstance(content, str)}
        for place, offset in self._offsets:
            names |= {place.qualify(offset.name), place.qualify(offset.target)}
        for place, op in zip(self._places, self._ops, strict=True):
            if isinstance(op, ir.Assign):
                names.update(map(place.qualify, _list_names(op.value)))
            elif isinstance(op, ir.Move):
                near = op.near_target or op
                read = (*op.matched_frames, *op.offset_from, *near.offset_from)
                values = (*op.targets, *op.bases, *op.tools, *near.bases, *near.tools)
                names.update(map(place.qualify, (*read, *chain(*map(_list_names, values)))))
        return set(map(_get_variable, names))

    def _summarise_routines(self) -> None:
        """Find the names that each routine may change, also through the routines that it calls."""
        callers = self._callers
        self._find_unread_operations()
        read = [(i, op) for i, op in enumerate(self._ops) if i not in self._unread]
        for i, op in read:
            routine = self._flow.routine_of[i]
            state: State = {}  # an operation on an empty state leaves the names that it changes
            called = self._list_called(op) if isinstance(op, ir.Call) else []
            for each in called:
                callers[each].add(routine)
            if not (called and isinstance(op, ir.Call) and op.name in called):
                self._update_state(state, i)
            for name, (content, at) in state.items():
                reason = f"{name} changes while the program runs" if name not in self._lasting else ""
                cause = Cause(at.line, reason, "give the value once, in numbers", at.source)
                self._changed[routine][name] = content if isinstance(content, Cause) else cause
        self._summarise_faults_and_attachments()
        to_visit = [*self._changed]  # routines whose callers may change more names than noted
        while to_visit:
            routine = to_visit.pop()
            for caller in callers.get(routine, ()):
                known = self._changed[caller]
                count = len(known)
                for name, cause in self._changed[routine].items():
                    known.setdefault(name, cause)
                if len(known) > count:
                    to_visit.append(caller)

    def _summarise_faults_and_attachments(self) -> None:
        """Add to the changes of routines what faults and routines that are attached to events change."""
        for i, fault in self._flow.uncertain.items():
            self._changed[self._flow.routine_of[i]].setdefault(ir.MODE, self._faults[fault])
        for i, op in enumerate(self._ops):
            if isinstance(op, ir.Call) and (cause := self._find_unknown_in_attached(self._places[i], op)):
                self._changed[self._flow.routine_of[i]].setdefault(UNKNOWN, cause)

    def _find_unknown_in_attached(self, place: Place, op: ir.Call) -> Cause | None:
        """Return the cause why values are unknown after routines of the program are attached to an event.

        The operation attaches a routine, or its name is that of an event that is switched on.
        """
        name = place.qualify(op.name)
        names = self._attached.get(name, [name] if op.event else [])
        causes = (self._changed[each].get(UNKNOWN) for each in names if each in self._attached_routines)
        return next(filter(None, causes), None)

    # propagation

    def _enter_routines(self) -> None:
        """Set the states in which the main routine, and routines that other programs may call, begin."""
        self._protected.clear()  # from here on, all changes are known
        main = next((name for name in self._flow.begins if name not in self._flow.anytime_routines), "")
        # The program does not show when statements outside of its routines run: they may run at any time.
        if main and (self._language.callable_from_outside or main not in self._callers):
            self._anytime.update(self._changed[""])
        for name, begin in self._flow.begins.items():
            is_called = not self._callers.get(name, set()) <= {name}  # by others: it may call itself
            if self._language.callable_from_outside or (name == main and not is_called):
                self._incoming[begin] = {}
            elif not is_called or name in self._flow.anytime_routines | self._flow.shared_routines:
                reason = f"another program may call {quote_text(name)} while other frames are active"
                cause = Cause(0, reason, "set the frames in the routine, before its moves")
                self._incoming[begin] = {UNKNOWN: (cause, At())}

    def _find_liveness(self, bodies: Mapping[str, list[int]]) -> None:
        """Find the names that states leave out, with the operations of each routine, moves included."""
        writes: dict[str, set[int]] = defaultdict(set)
        calls: dict[int, list[str]] = {}
        for i in chain(*self._state_operations.values()):
            op = self._ops[i]
            for name in self._list_written_names(i):
                writes[name].add(i)
            if isinstance(op, ir.Call) and (called := self._list_called(op)):
                calls[i] = called
        reads: dict[str, set[int]] = defaultdict(set)
        for i in chain(*bodies.values()):
            for name in self._list_read_names(i) & writes.keys():
                reads[name].add(i)
        reading = set(chain(*reads.values()))
        moves = {i for i in reading if isinstance(self._ops[i], ir.Move)}
        followed_bodies = {
            name: [i for i in body if i in moves or not isinstance(self._ops[i], ir.Move | ir.MoveToStored)]
            for name, body in bodies.items()
        }
        forgetting = {routine for routine, names in self._changed.items() if UNKNOWN in names}
        traffic = Traffic(followed_bodies, moves, reads, writes, calls, self._changed, forgetting)
        kept = self._list_always_live()
        followed = [name for name in writes if _get_base(name) not in kept]
        self._liveness = find_liveness(followed, traffic, self._flow)
        for routine, changed in self._changed.items():
            self._always_returned[routine] = [
                name for name in changed if name not in self._liveness.followed
            ]

    def _list_read_names(self, i: int) -> set[str]:
        """Return the full names whose contents operation i looks up."""
        op, place = self._ops[i], self._places[i]
        if isinstance(op, ir.Assign):
            return {place.qualify(name) for name in _list_names(op.value)}
        if not isinstance(op, ir.Move):
            return set()
        near = op.near_target or op
        values = (*op.targets, *op.bases, *op.tools, *near.bases, *near.tools)
        names = [*op.matched_frames, *op.offset_from, *near.offset_from, *chain(*map(_list_names, values))]
        found = set(map(place.qualify, names))
        numbered = [name for name in names if not isinstance(name, str)]
        if numbered:  # repetitions have other numbers in these names
            for number in self._repeats.get(i, array("q"))[1::2]:
                found.update(map(replace(place, first=number).qualify, numbered))
        return found

    def _list_written_names(self, i: int) -> set[str]:
        """Return the full names to which operation i gives a new content."""
        op, place = self._ops[i], self._places[i]
        if isinstance(op, ir.Assign):
            return {place.qualify(op.name)}
        if not isinstance(op, ir.MakeUnknown):
            return set()
        names = {*map(place.qualify, op.names)} - self._fixed
        return {each for name in names for each in self._list_name_and_fields(name)}

    def _list_always_live(self) -> set[str]:
        """Return the variables whose names are looked up by what other names contain."""
        names = {*self._lasting, *self._language.active, *self._language.active.values()}
        declared = chain(self._initial.values(), (each for pairs in self._shared_fields for _, each in pairs))
        names |= {content for content in declared if isinstance(content, str)}
        for place, offset in self._offsets:
            names |= {place.qualify(offset.name), place.qualify(offset.target)}
        for place, op in zip(self._places, self._ops, strict=True):
            values: tuple[object, ...] = (op.value,) if isinstance(op, ir.Assign) else ()
            if isinstance(op, ir.Move):
                near = op.near_target or op
                values = (*op.bases, *op.tools, *near.bases, *near.tools)
            names |= {place.qualify(each.name) for each in values if isinstance(each, ir.Named)}
            names |= {each.table for each in values if isinstance(each, ir.Element)}
        return set(map(_get_base, names))

    def _leave_out(self, names: Collection[str], state: State) -> State:
        """Return a state without names that nothing reads; the same object if the state has none of them."""
        gone = state.keys() & names
        return {name: each for name, each in state.items() if name not in gone} if gone else state

    def _propagate_through(self, routine: str, indices: Iterable[int]) -> None:
        """Propagate states through the operations `indices` of a routine once; record their moves.

        A state has the content of each variable, as it is on all paths to an operation.
        """
        state: State | None = {}  # None where no path leads to the operation
        if not routine and routine in self._flow.faulty_routines:
            state = self._add_fault(self._flow.faulty_routines[routine], state)
        shared = False  # whether the state is stored elsewhere, so that it must be copied before a change
        self._entered_routines.append(routine)
        for i in indices:
            op = self._ops[i]
            if isinstance(op, ir.Move | ir.MoveToStored):
                self._record_move(op, i, state)
                continue
            self._count_work(1)
            if state is not None and (dead := self._liveness.dead.get(i)):
                left = self._leave_out(dead, state)
                state, shared = left, shared and left is state
            if isinstance(op, ir.Flow):
                state, shared = self._pass_to_successors(op, i, state), True
            elif state is not None:
                state, shared = self._operate(op, i, state, shared=shared)
        self._entered_routines.pop()
        if state is not None:
            live = self._liveness.at_exit.get(routine, set())
            state = self._leave_out([each for each in state if self._is_dead(each, live)], state)
        self._state_changed |= self._exits.get(routine) != state
        self._exits[routine] = state

    def _is_dead(self, name: str, live: Collection[str]) -> bool:
        """Return whether nothing reads a name where these names are live."""
        return name in self._liveness.followed and name not in live

    def _operate(self, op: Op, i: int, state: State, *, shared: bool) -> tuple[State | None, bool]:
        """Return the state behind operation i, which is no `Flow`, and whether the state is stored elsewhere.

        `shared` tells whether the state before the operation is.
        """
        after: State | None = state
        if isinstance(op, ir.Call) and (called := self._list_called(op)):
            after, shared = self._follow_calls(op, i, called, state), True
        else:
            if shared:
                self._count_work(len(state))
                after = state = dict(state)
            self._update_state(state, i)
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
            state = {**state, _NEVER: ("", At())}
        return self._add_fault(fault, self._join_states(self._incoming.get(i), state))

    def _add_fault(self, fault: int | None, state: State | None) -> State | None:
        """Return a state in which no move is certain because of a fault, if there is one."""
        if fault is None or state is None or isinstance(self._look_up(state, ir.MODE)[0], Cause):
            return state
        return {**state, ir.MODE: (self._faults[fault], find_place(self._faults[fault]))}

    def _follow_calls(self, op: ir.Call, i: int, routines: list[str], state: State) -> State | None:
        """Return the state after operation i, which calls one of these routines of the program.

        The state is None if the end of the called routines was not reached yet.
        """
        end: State | None = None
        for routine in routines:
            self._count_work(len(state) if op.prefix is not None else 0)
            live = self._liveness.at_begin.get(routine, set())
            entering = self._leave_out([each for each in state if self._is_dead(each, live)], state)
            is_new = self._join_into(self._flow.begins[routine], entering)
            if is_new and routine not in self._entered_routines and len(self._entered_routines) < _MAX_CALLS:
                self._propagate_through(routine, self._state_operations[routine])
            returned, changed = self._exits.get(routine), self._changed[routine]
            if returned is not None:
                names = [*self._always_returned[routine]]
                names += [name for name in self._liveness.returned.get(i, ()) if name in changed]
                self._count_work(len(names))
                never = {_NEVER: ("", At())} if _NEVER in state or _NEVER in returned else {}
                if UNKNOWN not in changed:  # else the routine may change any name
                    returned = {**state, **{name: self._look_up(returned, name) for name in names}}
                returned = {**returned, **never}
            end = self._join_states(end, returned)
        if op.name in routines:
            return end
        other = dict(state)  # a routine of another file, too, may have the name that is computed
        self._update_state(other, i)
        return self._join_states(other, end)

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
        if first is None or second is None or first == second:
            return second if first is None else first
        if (_NEVER in first) != (_NEVER in second):
            return second if _NEVER in first else first
        joined = dict(first)
        self._count_work(len(second) + len(first))
        for name in {**first, **second}:
            if name in first and name in second and first[name] == second[name]:
                continue
            first_content, first_place = self._look_up(first, name)
            second_content, second_place = self._look_up(second, name)
            if first_content == second_content or self._have_equal_frames(
                name, first_content, second_content
            ):
                continue
            if not isinstance(first_content, Cause):
                subject = "a value that an unknown routine may change" if name == UNKNOWN else name
                reason = f"{subject} changes while the program runs, in a branch, a loop or a call"
                at, remedy = (
                    max(first_place, second_place),
                    "set the value once, before branches, loops and calls",
                )
                cause = Cause(at.line, reason, remedy, at.source)
                joined[name] = second_content if isinstance(second_content, Cause) else cause, at
        return first if joined == first else joined

    def _have_equal_frames(self, name: str, first: Content, second: Content) -> bool:
        """Return whether two contents of an active frame are equal numbers, written at different places."""
        if name not in self._language.active:
            return False
        if not (isinstance(first, WrittenNumbers) and isinstance(second, WrittenNumbers)):
            return False
        numbers = (
            self.numerals[each.source].values[each.first + np.array(each.literal.numbers)]
            for each in (first, second)
        )
        return first.literal.notation == second.literal.notation and bool(np.array_equal(*numbers))

    def _count_work(self, names: int) -> None:
        """Count steps of the interpretation; refuse a program that takes too many."""
        self._work += names
        if self._work > _MAX_WORK:
            self.refuse(None, "the program has too many branches and names", "split the program")

    def _update_state(self, state: State, i: int) -> None:
        """Apply operation i to a state, the contents of all variables; the state is changed in place.

        Contents change by an assignment, by a statement after which values are unknown, and by the call of an
        unknown routine.
        """
        op, place = self._ops[i], self._places[i]
        if isinstance(op, ir.Assign):
            name = place.qualify(op.name)
            content = self._evaluate(place, name, op.value, state)
            # Of what lasts, only a cause against moves counts, not the name of what has none.
            is_over = name in self._lasting and not isinstance(content, Cause)
            state[name] = "" if is_over else content, place.at
        elif isinstance(op, ir.MakeUnknown):
            self._make_unknown(state, op, place)
        elif isinstance(op, ir.Call) and (op.event or not op.anytime):
            is_own = op.name in self._flow.begins
            unknown = None if is_own else self._explain_unknown_call(place, op)
            if unknown := unknown or self._find_unknown_in_attached(place, op):
                self._forget_names(state, unknown)
                if op.may_last:
                    state[ir.MODE] = unknown, find_place(unknown)

    def _make_unknown(self, state: State, op: ir.MakeUnknown, place: Place) -> None:
        """Make the values of names unknown in a state; without names, all that other routines may change."""
        cause = place.make_cause(op.reason, op.remedy)
        if not op.names:
            self._forget_names(state, cause)
        for name in {*map(place.qualify, op.names)} - self._fixed:
            state.update(dict.fromkeys(self._list_name_and_fields(name), (cause, place.at)))

    def _forget_names(self, state: State, cause: Cause) -> None:
        """Remove names that an unknown routine may change from a state; set `UNKNOWN` to the cause."""
        for name in [name for name in state if not self._keeps_content(name)]:
            del state[name]
        state[UNKNOWN] = cause, find_place(cause)

    def _keeps_content(self, name: str) -> bool:
        """Return whether unknown routines leave the content of a name; each name is judged once."""
        if name not in self._protected:
            self._protected[name] = self._is_protected(name)
        return self._protected[name]

    def _is_protected(self, name: str) -> bool:
        """Return whether the content of a name is safe from changes by unknown routines.

        Routines of other files change names of their own, and the active frames. A table of the controller,
        or data that other programs share, are safe if no file of the program writes them.
        """
        _, is_owned, owner = name.partition(OF_ROUTINE)
        if name in self._constants or name in self._lasting or name == _NEVER:
            return True
        if is_owned and owner != OTHER_FILES:
            return True
        if self._language.is_own(name) and "." in name:  # frames that a position states
            return True
        if self._language.is_own(name) or get_structure_name(name) in self._private:
            return not self._find_changes(name)
        is_reached = self._language.is_reached
        if is_reached is None or is_reached(name):
            return False
        is_table = self._language.is_frame(name) or name in self._shared
        return not (is_table and self._find_changes(name))

    def _find_changes(self, name: str) -> list[Cause]:
        """Return the changes of a name; if there are none, those of its structure, else of its array."""
        names = name, get_structure_name(name), get_array_name(name)
        return next((changes for each in names if (changes := self._changes.get(each))), [])

    def _evaluate(self, place: Place, name: str, value: Value, state: State) -> Content:
        """Return the content that an assignment of `value`, at a place and in a state, gives to a name."""
        if isinstance(value, Literal):
            return WrittenNumbers(name, place.source, place.line, place.first, value)
        if isinstance(value, ir.Unknown):
            return place.make_cause(value.reason, value.remedy)
        if isinstance(value, ir.Stated):
            return self._evaluate_stated(place, value, state)
        if isinstance(value, ir.Element):
            return self._evaluate_element(place, value, state)
        content: Content = place.qualify(value.name)
        if "\0" in content:
            return place.make_cause("the number of a frame is not a whole number")
        return self._follow_copy(value, content, state) if isinstance(value, ir.Copy) else content

    def _evaluate_stated(self, place: Place, value: ir.Stated, state: State) -> Content:
        """Return the name of a frame that is calculated of numbers and pi; note its pose, if it has one.

        A program may give pi itself: then its number in a state counts.
        """
        numbers = (repr(float(place.values[place.first + ordinal])) for ordinal in value.ordinals)
        expressions = [re.sub("\0", lambda _: next(numbers), each) for each in value.expressions]
        own = place.qualify("pi")
        giving = (
            {
                each.scope.routine
                for each, op in zip(self._places, self._ops, strict=True)
                if isinstance(op, ir.Assign) and op.name == "pi"
            }
            if self._changes.get(own)
            else set()
        )
        if giving - {place.scope.routine}:  # elsewhere, the name may mean another variable
            return place.make_cause("the program gives 'pi' in another routine")
        if self._changes.get(own) or own in self._initial or own != "pi":
            pi, _ = self._look_up(state, own)
            if not isinstance(pi, WrittenNumbers):
                return place.make_cause("the program changes 'pi' while it runs")
            number = float(self.numerals[pi.source].values[pi.first + pi.literal.numbers[0]])
            expressions = [re.sub(r"\bpi\b", repr(number), each) for each in expressions]
        values = [calculate(each) for each in expressions]
        name = f"{value.name} of line {place.line}"
        if None not in values:
            self._named[name] = FrameName(name, value.notation.to_pose([each or 0.0 for each in values]))
        return name

    def _follow_copy(self, value: ir.Copy, content: Content, state: State) -> Content:
        """Return the content of a copied name in a state; with `through`, of the name that it holds."""
        for _ in range(2 if value.through else 1):
            if isinstance(content, str):
                content, _line = self._look_up(state, content)
        # The number that is active may be that of a frame whose numbers change.
        if value.through and isinstance(content, str) and self._language.is_frame(content):
            content, _line = self._look_up(state, content)
        return content

    def _look_up(self, state: State, name: str) -> tuple[Content, At]:
        """Return the content of a name in a state, and where the statement is that set this content."""
        if name == UNKNOWN:  # without an unknown call, there is no cause
            return state.get(name, ("", At()))
        if name in self._lasting:  # nothing lasts that may move targets, unless a statement says so
            lasting = self._anytime.get(name)
            return (lasting, find_place(lasting)) if lasting else state.get(name, ("", At()))
        fixed = self._find_fixed_content(name)
        if fixed is not None:
            return fixed, find_place(fixed) if isinstance(fixed, Cause) else At()
        protected = self._keeps_content(name)
        # A change that may happen at any time comes first, then the state, then the value before the program.
        content: Content | None = self._anytime.get(name)
        if content is None and not protected:
            content = self._anytime.get(UNKNOWN)
        if content is None and name in state:
            return state[name]
        if content is None and UNKNOWN in state and not protected:
            content = state[UNKNOWN][0]
        content = content or self._initial_value(name)
        if isinstance(content, Cause) and self._language.is_frame(name):
            content = content._replace(shows=name)
        return content, find_place(content) if isinstance(content, Cause) else At()

    def _evaluate_element(self, place: Place, value: ir.Element, state: State) -> Content:
        """Return the content of an element of a table, whose number is the value of a variable in a state.

        Only a variable of the routine, or a constant, is certain: other programs may set any other one.
        """
        index = place.qualify(value.number)
        number, _ = self._look_up(state, index)
        if isinstance(number, Cause) and number.line:
            return number
        is_certain = OF_ROUTINE in index or index in self._fixed
        if not (is_certain and isinstance(number, WrittenNumbers) and len(number.literal.numbers) == 1):
            return place.make_cause(f"the number {quote_text(value.number)} of a frame is not certain")
        written = float(self.numerals[number.source].values[number.first + number.literal.numbers[0]])
        if not written.is_integer():
            return place.make_cause("the number of a frame is not a whole number")
        return self._look_up(state, value.table % f"{written:g}")[0]

    def _find_fixed_content(self, name: str) -> Content | None:
        """Return the content that a name has in all states: of a constant, or of an element; else None.

        Where a statement changes an array, whichever element that is, no element is known.
        """
        if get_structure_name(name) in self._language.constants:
            return name
        array = get_array_name(name)
        return self._initial_value(name) if array != name and array in self._changes else None

    def _initial_value(self, name: str) -> Content:
        """Return the content of a name when the program begins: data have the values in their file."""
        changes = self._find_changes(name)
        if name in self._initial and not changes:
            return self._initial[name]
        structure, _, ending = name.partition(".")
        contents = [content for field, content in self._initial_fields.get(structure, ()) if field == ending]
        if len(contents) == 1 and not changes:
            return contents[0]
        if contents and not changes:
            return Cause(0, f"{name} is declared twice")
        if (active := self._language.active.get(name)) is not None:
            return active
        if changes:
            reason = f"{name} changes while the program runs"
            return changes[0]._replace(reason=reason, remedy="give the value once, in numbers")
        if self._language.is_frame(name):
            return name
        return Cause(0, f"{quote_text(name)} is not given by constant numbers", self._language.undeclared)

    # moves

    def interpret(self) -> tuple[Columns, dict[str, At], list[Cause]]:
        """Read and interpret the program.

        States are passed through the routines until none changes; a last pass adds the moves.

        Returns:
            Targets and moves as columns; for each name that is used otherwise than as a target, a line on
            which the name is used; causes why statements are not understood.

        Raises:
            ProgramError: the text is not understood.
        """
        if self._language.read:
            self._language.read(self, self.sources)
        else:
            self.add_statements(0, self.sources[0].starts, self.sources[0].ends)
        # All statements are translated: the texts without numbers take as much memory as the files.
        self.numerals[:] = [replace(each, masked_text="") for each in self.numerals]
        places = zip(self._places, self._ops, strict=True)
        self._ops = [
            op.settle_bounds(place.values[place.first :]) if isinstance(op, ir.Flow) else op
            for place, op in places
        ]
        names = [
            self._places[i].qualify(op.name) if isinstance(op, ir.Flow) else ""
            for i, op in enumerate(self._ops)
        ]
        try:
            self._flow = ControlFlow(self._ops, names)
        except UnmatchedEnd as fault:
            place = self._places[fault.place]
            self.refuse(place.line, fault.reason, fault.remedy, place.source)
        # Ends of routines that `ControlFlow` appended get the place of the last statement.
        self._places += self._places[-1:] * (len(self._ops) - len(self._places))
        self._faults = {
            i: self._places[i].make_cause(*words) for i, words in sorted(self._flow.faults.items())
        }
        for cause in self._faults.values():
            self._causes.append(cause)
            self.columns.add_remark(At(cause.line, cause.source), cause.reason)
        self._collect_changes()
        self._find_new_meanings()
        self._note_names_of_several_routines()
        self._collect_targets()
        self._enter_routines()
        bodies = {
            name: [i for i in body if i not in self._unread] for name, body in self._flow.bodies.items()
        }
        for name, body in bodies.items():
            self._state_operations[name] = [
                i for i in body if not isinstance(self._ops[i], ir.Move | ir.MoveToStored)
            ]
        self._find_liveness(bodies)
        order = list(bodies)
        while self._state_changed:
            self._state_changed = False
            for name in order:
                self._propagate_through(name, self._state_operations[name])
            order.reverse()  # callers first carries states into routines, callees first carries them back
        self._find_what_outlasts_routines()
        for name, body in bodies.items():
            self._propagate_through(name, body)
        self._trace_uses()
        self._remark_conditions()
        self._note_assumption()
        self._note_left_files()
        return self.columns, self._used, self._causes

    def _trace_uses(self) -> None:
        """Let what is calculated of numbers be used where the result is used.

        The use of a result is not known if its name is that of a routine of another file, or of data that the
        program does not declare.
        """
        to_visit = [
            name
            for name in self._origins.keys() - {ir.CONDITION}
            if name in self._used
            or not (name in self._declared or name in self._flow.begins or OF_ROUTINE in name)
        ]
        while to_visit:
            for name, at in self._origins.get(to_visit.pop(), {}).items():
                if name not in self._used:
                    self._used[name] = at
                    to_visit.append(name)

    def _remark_conditions(self) -> None:
        """Add a remark for each target that is corrected and whose numbers decide a condition."""
        places = dict(self._origins[ir.CONDITION])
        to_visit = [*places]
        while to_visit:
            name = to_visit.pop()
            origins = self._origins.get(name, {}).keys() | self._offsets_of.get(name, set())
            for origin in origins - places.keys():
                places[origin] = places[name]
                to_visit.append(origin)
        for name in sorted((places.keys() & self._targets) - self._used.keys()):
            target, _, _ = name.partition(OF_ROUTINE)
            text = f"numbers of the target {quote_text(target)} decide here, and the correction changes them"
            self.columns.add_remark(places[name], text)

    def _collect_targets(self) -> None:
        """Collect the names of the targets of moves, and of poses at offsets from them.

        Where such a pose is used otherwise than as a target, so are the numbers of the target behind it.
        """
        places = zip(self._places, self._ops, strict=True)
        moves = [(place, op) for place, op in places if isinstance(op, ir.Move)]
        for place, move in moves:
            self._targets.update(self._list_named_targets(place, move))
        for place, offset in self._offsets:
            self._offsets_of[place.qualify(offset.name)].add(place.qualify(offset.target))
        for place, move in moves:
            if self._is_near_target(place, move):  # the offset itself is part of a calculation
                self._used |= dict.fromkeys(self._list_named_targets(place, move), place.at)
        known = set[str]()
        for name in sorted(self._offsets_of.keys() & self._used.keys()):
            for target in self._trace_offsets([name], known):
                self._used.setdefault(target, self._used[name])

    @staticmethod
    def _list_named_targets(place: Place, op: ir.Move) -> list[str]:
        """Return the names of the targets of a move."""
        return [place.qualify(each) for each in op.targets if not isinstance(each, Literal)]

    def _is_near_target(self, place: Place, op: ir.Move) -> bool:
        """Return whether a move goes to an offset from a target, and not to numbers in a frame."""
        names = set(map(place.qualify, op.near_target.offset_from)) if op.near_target else set()
        return any(each in self._targets or each in self._offsets_of for each in names)

    def _list_offsets(self, place: Place, op: ir.Move, frames: list[Frames]) -> list[str]:
        """Return the names of targets near which a move goes; calculated ones once for the same frames."""
        own = [place.qualify(each) for each in op.offset_from]
        names = [*own, *self._list_named_targets(place, op)]
        if not self._offsets_of.keys().isdisjoint(names):
            key = tuple(
                each
                if isinstance(each, Cause)
                else (each.name, None if each.pose is None else each.pose.tobytes())
                for each in frames[0]
            )
            own += self._trace_offsets(names, self._noted_offsets[key])
        return own

    def _trace_offsets(self, names: Iterable[str], known: set[str]) -> list[str]:
        """Return the names of all targets from which poses with these names are at an offset.

        Names in `known` are left out, and those that are found are added to it: each is found once.
        """
        found, to_visit = list[str](), [*names]
        while to_visit:
            targets = self._offsets_of.get(to_visit.pop(), set()) - known
            known |= targets
            found += sorted(targets)
            to_visit += targets
        return found

    def _find_what_outlasts_routines(self) -> None:
        """Let what lasts when a routine ends last at any time: the next one may be called from outside."""
        ended = [*self._lasting][1:] if self._language.callable_from_outside else []
        for name in ended:
            ends = [state.get(name, ("", At()))[0] for state in self._exits.values() if state]
            self._anytime.update((name, cause) for cause in ends if isinstance(cause, Cause))

    def _note_assumption(self) -> None:
        """Add a remark on what routines of other files are assumed to leave, if moves behind them need it."""
        if self._needs_assumption:
            names = ", ".join(map(quote_text, [*self.unknown_routines][:_MAX_LISTED]))
            more = len(self.unknown_routines) - _MAX_LISTED
            others = f" and {more} more" if more > 0 else ""
            text = (
                "it is assumed that these routines leave the stored frames and points of the program "
                "unchanged:"
            )
            text = f"{text} {names}{others}"
            self.columns.add_remark(self._first_unknown, text)

    def _note_left_files(self) -> None:
        """Add a remark on the moves of each further file, which are not corrected."""
        for source, count in sorted(self._left_in_file.items()):
            file, moves = quote_text(self.sources[source].name), "1 move" if count == 1 else f"{count} moves"
            text = f"{moves} of {file} are left as they are: to correct them, send that file as the first one"
            self.columns.add_remark(At(1), text)

    def _record_move(self, op: ir.Move | ir.MoveToStored, i: int, state: State | None) -> None:
        """Add the moves of operation i to the columns, or the cause why they cannot be corrected."""
        place = self._places[i]
        if isinstance(op, ir.MoveToStored):
            text = f"a move to {op.name}, a position stored in the controller"
            self.columns.add_remark(place.at, text, op.name)
            return
        if state is None:
            state = {UNKNOWN: (Cause(0, "the program never reaches this line", "omit the move"), At())}
        if self._is_near_target(place, op) and op.near_target:
            op = op.near_target
        lines, numbers = np.asarray(self._repeats.get(i, ()), dtype=np.intp).reshape(-1, 2).T
        if len(lines) and op.differs_only_in_target:
            frames, cause = self._evaluate_frames(op, place, state)
            if cause is None:
                lines, numbers = np.append(place.line, lines), np.append(place.first, numbers)
                self.columns.add_moves(op, place.source, lines, numbers, frames[0])
                return
        self._add_move(op, place, state)
        for line, number in zip(iterate_integers(lines), iterate_integers(numbers), strict=True):
            self._add_move(op, replace(place, line=line, first=number), state)

    def _evaluate_frames(self, op: ir.Move, place: Place, state: State) -> tuple[list[Frames], Cause | None]:
        """Return base and tool of each target of a move, and the cause, if any, against its correction."""
        frames = [
            (self._evaluate_frame(place, base, state), self._evaluate_frame(place, tool, state))
            for base, tool in zip(op.bases, op.tools, strict=True)
        ]
        cause = self._find_obstacle(place, op, frames, state)
        is_behind_unknown = UNKNOWN in state or UNKNOWN in self._anytime
        self._needs_assumption |= cause is None and is_behind_unknown and bool(self.unknown_routines)
        return frames, cause

    def _add_move(self, op: ir.Move, place: Place, state: State) -> None:
        """Add one move to the columns, with its targets in a state, or with the cause against correction."""
        frames, cause = self._evaluate_frames(op, place, state)
        for name in self._list_offsets(place, op, frames):
            self._note_offset(place, name, frames[0], state)
        contents = [self._evaluate_target(place, each, state) for each in op.targets]
        cause = cause or next((each for each in contents if isinstance(each, Cause)), None)
        if cause is not None:
            for target in self._list_named_targets(place, op):
                if target in self._origins:
                    self._note_offset(place, target, frames[0], state)
                else:
                    self._used[target] = place.at
            cause = cause if cause.line else cause._replace(line=place.line, source=place.source)
        targets = [each for each in contents if isinstance(each, WrittenNumbers)]
        self.columns.add_move(op, place.line, targets, frames, cause)

    def _note_offset(self, place: Place, name: Name, frames: Frames, state: State) -> None:
        """Note that a move goes to an offset from a target, or to what was calculated of targets.

        If frames of the move differ from those of a target, the target is not corrected.
        """
        target = self._evaluate_target(place, name, state)
        if isinstance(target, WrittenNumbers):
            self.columns.add_offset(target, frames, place.line)
        key = tuple(
            each if isinstance(each, Cause) or each.pose is None else (each.name, each.pose.tobytes())
            for each in frames
        )
        to_visit = [place.qualify(name)]
        while to_visit:  # each origin once for the same frames: copies may be copied many times
            for origin in self._origins.get(to_visit.pop(), ()):
                if (origin, key) in self._noted_origins:
                    continue
                self._noted_origins.add((origin, key))
                to_visit.append(origin)
                point = self._find_point(origin)
                if isinstance(point, WrittenNumbers) and origin not in self._used:
                    self.columns.add_offset(point._replace(label=origin), frames, place.line)

    def _find_point(self, name: str) -> Content | None:
        """Return the numbers that a name has on any path, if there are some."""
        if name in self._initial and not self._changes.get(name):
            return self._initial[name]
        if self._assigned is None:
            self._assigned = {
                place.qualify(op.name): WrittenNumbers("", place.source, place.line, place.first, op.value)
                for place, op in zip(self._places, self._ops, strict=True)
                if isinstance(op, ir.Assign) and isinstance(op.value, Literal)
            }
        return self._assigned.get(name)

    def _find_obstacle(self, place: Place, op: ir.Move, frames: list[Frames], state: State) -> Cause | None:
        """Return the cause why a move cannot be corrected, apart from its targets; None without a cause."""
        if op.reason:
            return place.make_cause(op.reason, op.remedy)
        literals = (each for each in op.targets if isinstance(each, Literal))
        if cause := next(filter(None, (self._find_axes(place, each, state) for each in literals)), None):
            return cause
        lasting = (self._look_up(state, name)[0] for name in self._lasting)
        for each in (*lasting, *(each for pair in frames for each in pair)):
            if isinstance(each, Cause):
                return each
        for name, frame in zip(op.matched_frames, frames[0], strict=False):
            content, _ = self._look_up(state, name)
            if isinstance(content, Cause):
                continue  # the controller stops unless the frame of the target is active
            # The active frame must be unchanged since the program began, or be the frame of the target.
            is_initial = content == self._language.active[name]
            if not is_initial and not (isinstance(frame, FrameName) and content == frame.name):
                reason = f"the target is recorded with another {name} than the active one"
                return place.make_cause(reason, "activate the frame with which the target is recorded")
        return None

    def _evaluate_target(self, place: Place, target: Literal | Name, state: State) -> WrittenNumbers | Cause:
        """Return the numbers of a target in a state, or the cause why these numbers are unknown."""
        if isinstance(target, Literal):
            return WrittenNumbers("", place.source, place.line, place.first, target)
        name = place.qualify(target)
        content, _ = self._look_up(state, name)
        unknown = f"the target {quote_text(name)} is not given by constant numbers"
        if not isinstance(content, WrittenNumbers):
            reason = content.reason if isinstance(content, Cause) and content.line else ""
            changes = self._changes.get(name, [])
            if len(changes) + (name in self._initial) > 1:
                reason = changes[-1].reason
        elif content.literal.notation.orientation is Orientation.NONE:
            reason = "it is no pose"
        elif name in self._stored:  # other programs, or a computer, may set it at any time
            reason = "the declaration is shared with other programs"
        else:
            return self._settle_target(place, name, content._replace(label=name), unknown)
        return place.make_cause(f"{unknown}: {reason}" if reason else unknown, self._language.remedy)

    def _find_axes(self, place: Place, target: Literal, state: State) -> Cause | None:
        """Return the cause against a correction if a variable holds external axes that may carry the arm."""
        if not target.axes_name:
            return None
        content, _ = self._look_up(state, place.qualify(target.axes_name))
        if isinstance(content, WrittenNumbers):
            axes = self.numerals[content.source].values[content.first + np.array(content.literal.numbers)]
            if is_without_axes(axes):
                return None
        reason = (
            f"the external axes are in the variable {quote_text(target.axes_name)}, and may carry the arm"
        )
        return place.make_cause(reason, "write the numbers of the external axes at the target")

    def _settle_target(
        self, place: Place, name: str, numbers: WrittenNumbers, unknown: str
    ) -> WrittenNumbers:
        """Return the numbers of a target at a move; note why the numbers in its declaration have to stay."""
        changes = self._changes.get(name, [])
        if len(changes) + (name in self._initial) > 1:  # the target gets numbers more than once
            self._keep_numbers(place, numbers, f"{unknown}: {changes[-1].reason}")
        elif name in self._shared and name not in self._noted:
            self._noted.add(name)
            text = f"{quote_text(name)} is GLOBAL: its correction moves it for other programs, too"
            self.columns.add_remark(place.at, text)
        return numbers

    def _keep_numbers(self, place: Place, numbers: WrittenNumbers, reason: str) -> None:
        """Note why the numbers of a target have to stay in its declaration."""
        self.columns.keep_numbers(numbers, place.make_cause(reason, self._language.remedy), place.line)

    def _evaluate_frame(self, place: Place, value: Value | ir.Product, state: State) -> FrameName | Cause:
        """Return a frame in a state, multiplied if it is a product, or the cause why the frame is unknown."""
        values = [ir.Copy(name) for name in value.names] if isinstance(value, ir.Product) else [value]
        contents = [self._evaluate(place, "", each, state) for each in values]
        for each in contents:
            if isinstance(each, Cause):
                return each
        numbers = tuple(each for each in contents if isinstance(each, WrittenNumbers))
        if len(numbers) < len(contents):
            names = {get_structure_name(each) for each in contents if isinstance(each, str)}
            if numbers or len(names) > 1:
                reason = "the frame is only partly in numbers"
                return place.make_cause(reason, "give the whole frame in numbers")
            return self._find_named_frame(place, names.pop())
        if numbers not in self._poses:
            self._poses[numbers] = self._multiply_poses(numbers)
        first, pose = numbers[0], self._poses[numbers]
        label, _, routine = first.label.partition(OF_ROUTINE)
        if not (routine or self._language.is_frame(label)):
            label = f"{label or 'frame'} of line {first.line}"
        if pose is None:
            reason = f"{label} is not a whole frame in numbers"
            return Cause(first.line, reason, "give the whole frame in numbers", first.source)
        return FrameName(self._restore_spelling(place, label), pose)

    def _find_named_frame(self, place: Place, name: str) -> FrameName:
        """Return a frame that is known by name only, with a pose if no program can change the frame."""
        if name not in self._named:
            self._named[name] = FrameName(
                self._restore_spelling(place, name), self._language.constants.get(name)
            )
        return self._named[name]

    def _restore_spelling(self, place: Place, name: str) -> str:
        """Return a name in the spelling of the program near a place."""
        return self.columns.restore_spelling(name, place.source, place.line)

    def _multiply_poses(self, frames: Iterable[WrittenNumbers]) -> FloatArray | None:
        """Return the product (4, 4) [m] of poses in numbers; None if some numbers are not a pose."""
        poses = []
        for each in frames:
            notation = each.literal.notation
            values = self.numerals[each.source].values[each.first + np.array(each.literal.numbers)]
            if not notation.has_pose:
                return None
            if not (np.abs(values) <= MAX_VALUE).all() or not notation.is_valid_orientation(values):
                return None
            poses.append(notation.to_pose(values))
        return np.asarray(reduce(np.matmul, poses))
