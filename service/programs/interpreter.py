"""The one interpreter: constants propagated over the control flow of a program in the intermediate language.

A state holds what names have on every way to a statement: numbers in the text, a name, or why it is unknown.
Where ways meet, what differs is not known; loops and calls run to a fixed point.
"""

from __future__ import annotations

import re
from collections import defaultdict, deque
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from functools import reduce
from operator import itemgetter
from typing import Final, NoReturn, TypeAlias

import numpy as np

from jointstiff.service.programs import language as ir
from jointstiff.service.programs.columns import MAX_VALUE, OF, Cause, Columns, Frames, Given
from jointstiff.service.programs.errors import CONSTANT, Fault, ProgramError, shown
from jointstiff.service.programs.language import Language, Misread, Name, Op, Value
from jointstiff.service.programs.notation import Notation, Numerals
from jointstiff.service.programs.program import FrameName, Literal, Program, Source
from jointstiff.service.programs.ways import Block, Stray, Ways
from jointstiff.solver.arrays import FloatArray, IndexArray

_MAX_SHAPES: Final = 10_000
"""Shapes of statements that are remembered."""
_MAX_STATEMENT: Final = 16_384
_MAX_WORK: Final = 10_000_000
"""Names in states that are joined or copied: beyond it, a program is not one that people wrote."""
UNKNOWN: Final = "\0everything"
"""Name that has a cause behind an unknown call: nothing that it may have changed is known then."""


Held: TypeAlias = Given | Cause | str
"""What a name has; its own or another's name where only that is known."""
State: TypeAlias = dict[str, tuple[Held, int]]
"""What names have, and the line that gave it."""


@dataclass(frozen=True, slots=True)
class Scope:
    """A routine, and the names that belong to it."""

    routine: str
    names: set[str] = field(default_factory=set)

    def name(self, name: str) -> str:
        """Return a name as no other routine has it, if it belongs to this one."""
        return f"{name}{OF}{self.routine}" if name.partition(".")[0] in self.names else name


@dataclass(frozen=True, slots=True)
class Place:
    """Place of a statement, and the numbers of its file."""

    source: int
    line: int
    first: int
    values: FloatArray
    scope: Scope

    def cause(self, reason: str, remedy: str) -> Cause:
        """Return a cause here; the reason may quote numbers by their ordinals."""
        told = re.sub("\0(\\d+)\0", lambda match: f"{self.values[self.first + int(match[1])]:g}", reason)
        return Cause(self.line, told, remedy, self.source)

    def name(self, name: Name) -> str:
        """Return a name with its number."""
        if isinstance(name, str):
            return self.scope.name(name)
        value = float(self.values[self.first + name[1]])
        return name[0] % (f"{value:g}" if value.is_integer() else "\0")


_Block: TypeAlias = Block[State]
_Verdict: TypeAlias = tuple[int, int, ir.Move, list[Given], list[Frames], Cause | None]


class Machine:
    """A program in the intermediate language, and its interpretation."""

    def __init__(
        self, kind: str, sources: tuple[Source, ...], language: Language, allowed: Collection[str] = ()
    ) -> None:
        """Begin with nothing; the user says that no `allowed` routine moves the robot or changes frames."""
        self.sources, self._language = sources, language
        self._allowed = frozenset(each.upper() for each in allowed)
        self.numerals = [Numerals.of(source.text, language.number) for source in sources]
        self.columns = Columns(kind, sources, self.numerals)
        # source, line, first number and scope of each op
        self._places: list[tuple[int, int, int, Scope]] = []
        self._scopes, self._closed = [Scope("")], Scope("")
        self._ops: list[Op] = []
        self.initial: dict[str, Held] = {}  # what names have before the program runs
        self.steady: set[str] = set()  # those that no other program changes
        self._givers: dict[str, list[int]] = defaultdict(list)  # lines that give a name a value
        self._written: dict[str, set[int]] = defaultdict(set)  # which of their numbers
        self._changed: dict[str, Cause] = {}  # names that get what is not known
        self._used: dict[str, int] = {}  # names that are used otherwise than as targets, and a line
        self._causes: list[Cause] = []  # whatever is not understood
        self._anytime: dict[str, Cause] = {}  # what routines change that may run at any time
        self._callers: dict[str, list[_Block]] = defaultdict(list)
        self._changes: dict[str, dict[str, Cause]] = defaultdict(dict)  # what a routine may change
        self._poses: dict[tuple[int, int, int], FloatArray | None] = {}
        self._earlier: Cause | None = (
            None  # what may have changed the data of the controller in an earlier run
        )
        self._work = 0
        self._shared: set[str] = set()  # names that other programs use, too
        self._own: set[str] = set()  # names that no other program knows
        self.written: dict[str, str] = {}  # names of frames as the program writes them

    # reading

    def refuse(self, line: int | None, reason: str, remedy: str, source: int = 0) -> NoReturn:
        """Refuse the whole program, whose text is not understood."""
        raise ProgramError([Fault(self.sources[source].name, line, reason, remedy)])

    def add(
        self,
        source: int,
        starts: IndexArray,
        ends: IndexArray,
        *,
        declares: str = "",
        language: Language | None = None,
    ) -> None:
        """Translate parts of a file; what a file of declarations assigns, names have from the beginning."""
        self._scopes = [Scope("")]
        language = language or self._language
        numerals = self.numerals[source]
        lines = np.searchsorted(self.sources[source].starts, starts, side="right")
        shapes, first = numerals.shapes(starts, ends)
        if (long := np.flatnonzero(ends - starts > _MAX_STATEMENT)).size:
            reason = f"a statement of more than {_MAX_STATEMENT} characters"
            self.refuse(int(lines[long[0]]), reason, "split it", source)
        known: dict[str, list[tuple[int, Op]]] = {}
        for shape, line, number in zip(shapes, lines.tolist(), first.tolist(), strict=True):
            ops = known.get(shape)
            if ops is None:
                try:
                    ops = language.translate(language.line(shape))
                except Misread as fault:
                    self.refuse(line, fault.reason, fault.remedy, source)
                if len(known) < _MAX_SHAPES:
                    known[shape] = ops
            self._take(ops, source, line, number, declares)

    def _take(
        self, ops: Iterable[tuple[int, Op]], source: int, line: int, number: int, declares: str
    ) -> None:
        for below, op in ops:
            scope = self._scopes[-1]
            if isinstance(op, ir.Use):
                self._used.update((scope.name(name), line + below) for name in op.names)
            elif isinstance(op, ir.Local):
                scope.names.update(op.names if scope.routine else ())
            elif isinstance(op, ir.Assign) and (declares or op.declares):
                place = Place(source, line + below, number, self.numerals[source].values, scope)
                self._declare(place, op, op.declares or declares)
            elif not declares:
                self._enter(op)
                self._places.append((source, line + below, number, self._scopes[-1]))
                self._ops.append(op)

    def _enter(self, op: Op) -> None:
        """Enter the scope of a routine, or leave it."""
        if not isinstance(op, ir.Flow):
            return
        if op.kind in {"routine", "aside"}:  # a handler has no name: it knows those of its routine
            self._scopes.append(Scope(str(op.name)) if op.name else self._closed)
        elif op.kind in {"if", "loop", "repeat"}:
            self._scopes.append(self._scopes[-1])
        elif op.kind in {"close", "end", "any"} and len(self._scopes) > 1:
            self._closed = self._scopes.pop()

    def _declare(self, place: Place, op: ir.Assign, kind: str) -> None:
        name = place.name(op.name)
        self._shared |= {name} if op.shared or kind == "shared" else set()
        self._own |= {name} if op.own else set()
        held = self._value(place, name, op.value, {})
        if self.initial.setdefault(name, held) != held:
            self.initial[name] = Cause(place.line, f"{name} is declared twice", CONSTANT, place.source)
        if kind == "constant":
            self.steady.add(name)

    def _place(self, i: int) -> Place:
        source, line, first, scope = self._places[i]
        return Place(source, line, first, self.numerals[source].values, scope)

    # what holds for all of the program

    def _collect(self) -> None:
        places = ((self._place(i), op) for i, op in enumerate(self._ops) if isinstance(op, ir.Assign))
        declared = {place.name(op.name) for place, op in places if isinstance(op.value, ir.Named)}
        for i, op in enumerate(self._ops):
            if isinstance(op, ir.Assign):
                place = self._place(i)
                self._givers[place.name(op.name)].append(place.line)
                begin = op.value.begin if isinstance(op.value, ir.Part) else 0
                end = begin + 7 if isinstance(op.value, ir.Part) else 14
                self._written[place.name(op.name)].update(range(begin, end))
            elif isinstance(op, ir.Havoc):
                place = self._place(i)
                self._causes.append(place.cause(op.reason, op.remedy))
                self._earlier = self._earlier or (None if op.names else self._causes[-1])
                self._changed.update({place.name(name): self._causes[-1] for name in op.names})
            elif isinstance(op, ir.Call) and (not op.quiet or op.name in self._ways.entry):
                self._collect_call(i, op, declared)
        self._summarise()
        for name in self._ways.aside:
            self._anytime.update(self._changes[name])

    def _collect_call(self, i: int, op: ir.Call, declared: Collection[str]) -> None:
        source, line, _, scope = self._places[i]
        cause = Cause(line, f"{shown(str(op.name))} is given it, and may change it", CONSTANT, source)
        passed = list(map(scope.name, op.passed))
        self._changed.update(dict.fromkeys(passed, cause))
        self._anytime.update(dict.fromkeys(passed, cause))
        if op.name in self._ways.entry:
            self._ways.aside |= {str(op.name)} if op.attached else set()
        elif self._place(i).name(op.name) in declared:
            pass
        elif unknown := self._unknown(i, op.name):
            self._causes.append(unknown)
            self._earlier = self._earlier or unknown
            if op.attached:
                self._anytime[UNKNOWN] = unknown
        else:
            said = (
                f"{op.name} is called; the request states that it neither moves the robot nor changes frames"
            )
            self.columns.remark(line, said)

    def _unknown(self, i: int, called: Name) -> Cause | None:
        """Return why nothing is known behind a call of an unknown routine; None if vouched for."""
        source, line, *_ = self._places[i]
        name = self._place(i).name(called)
        if name.upper() in self._allowed:
            return None
        reason = f"{shown(name)} is unknown: it may move the robot or change its frames"
        remedy = f"if it does neither, name it in `leave_alone`: [{shown(name)}]"
        return Cause(line, reason, remedy, source)

    def _summarise(self) -> None:
        """Find what each routine, and those that it calls, may change."""
        calls: dict[str, set[str]] = defaultdict(set)
        for block in self._ways.blocks:
            if block.called:
                calls[block.called].add(block.routine)
            for i in block.effects:
                state: State = {}
                self._step(state, i)
                for name, (_, line) in state.items():
                    reason = f"{name} changes while the program runs"
                    cause = Cause(line, reason, "give it once, in numbers", self._places[i][0])
                    held = state[name][0]
                    self._changes[block.routine][name] = held if isinstance(held, Cause) else cause
        waiting = deque(self._changes)
        while waiting:
            routine = waiting.popleft()
            own = self._changes[routine]
            for caller in calls[routine]:
                if not own.keys() <= self._changes[caller].keys():
                    self._changes[caller] = own | self._changes[caller]
                    waiting.append(caller)

    # propagation

    def _run(self) -> None:
        """Propagate states over all ways, to a fixed point."""
        waiting = deque(self._entered())
        while waiting:
            block = waiting.popleft()
            self._toil(0)
            state: State | None = self._state_behind(block)
            if block.called and state is not None:
                self._lead(self._ways.entry[block.called], state, waiting)
                state = self._returned(block.called, state)
            for each in block.following if state is not None else ():
                self._lead(each, state or {}, waiting)
            if block is self._ways.exit[block.routine]:
                waiting.extend(each for each in self._callers[block.routine] if each.state is not None)

    def _entered(self) -> Iterator[_Block]:
        """Yield where the program, or a routine of it that others call, begins."""
        main = next((name for name in self._ways.entry if name and name not in self._ways.aside), "")
        if main and (self._language.callers or not self._callers[main]):
            self._anytime.update(self._changes[""])
        for name, entry in self._ways.entry.items():
            outside = self._language.callers or name in {"", main}
            if outside and (not self._callers[name] or self._language.callers):
                entry.state = {}
            elif not self._callers[name] or name in self._ways.aside | self._ways.shared:
                reason = f"{shown(name)} may be called from elsewhere, with the frames of its caller"
                entry.state = {
                    UNKNOWN: (Cause(0, reason, "set the frames in the routine, before its moves"), 0)
                }
            if entry.state is not None:
                yield entry

    def _returned(self, routine: str, state: State) -> State | None:
        """Return the state behind a call; None if no way leads back yet."""
        returned, changed = self._ways.exit[routine].state, self._changes[routine]
        if returned is None or UNKNOWN in changed:
            return returned
        return {**state, **{name: self._look(returned, name) for name in changed}}

    def _state_behind(self, block: _Block) -> State:
        state = block.state or {}
        if block.effects:
            self._toil(len(state))
            state = dict(state)
            for i in block.effects:
                self._step(state, i)
        return state

    def _lead(self, block: _Block, state: State, waiting: deque[_Block]) -> None:
        """Join a state into a block; look at it again if it changes."""
        known = block.state
        if known is None:
            block.state = state
        elif known is state:
            return
        else:
            joined = dict(known)
            self._toil(len(state) + len(known))
            for name in {**known, **state}:
                (one, line), (other, later) = self._look(known, name), self._look(state, name)
                if one != other and not isinstance(one, Cause) and not self._same(one, other):
                    line, reason = (
                        max(line, later),
                        f"{_shown(name)} changes while the program runs: by a branch, a loop or a call",
                    )
                    cause = (
                        other
                        if isinstance(other, Cause)
                        else Cause(line, reason, "set it once, before branches, loops and calls")
                    )
                    joined[name] = cause, line
            if joined == known:
                return
            block.state = joined
        waiting.append(block)

    def _same(self, one: Held, other: Held) -> bool:
        """Return whether numbers at two places of the text are one pose."""
        if not (isinstance(one, Given) and isinstance(other, Given)):
            return False
        poses = self._pose(one), self._pose(other)
        return all(pose is not None for pose in poses) and np.array_equal(*poses)  # type: ignore[arg-type]

    def _toil(self, names: int) -> None:
        self._work += names + 1
        if self._work > _MAX_WORK:
            self.refuse(None, "the program has too many branches and names", "split it")

    def _step(self, state: State, i: int) -> None:
        """Carry out an assignment, or what is not known."""
        op, place = self._ops[i], self._place(i)
        if isinstance(op, ir.Assign):
            name = place.name(op.name)
            state[name] = self._value(place, name, op.value, state), place.line
        elif isinstance(op, ir.Havoc):
            cause = place.cause(op.reason, op.remedy)
            if not op.names:
                self._forget(state, cause)
            for each in op.names:
                state[place.name(each)] = cause, place.line
        elif isinstance(op, ir.Call) and not op.attached and (unknown := self._unknown(i, op.name)):
            self._forget(state, unknown)

    def _forget(self, state: State, cause: Cause) -> None:
        kept = {name: held for name, held in state.items() if self._is_steady(name)}
        state.clear()
        state.update(kept)
        state[UNKNOWN] = cause, cause.line

    def _is_steady(self, name: str) -> bool:
        """Return whether no unknown routine changes what a name has."""
        own = name in self._own and name not in self._givers and name not in self._changed
        return own or name in self.steady or OF in name

    def _value(self, place: Place, name: str, value: Value, state: State) -> Held:
        if isinstance(value, Literal):
            label = name if self._language.is_frame(name) else f"{name} of line {place.line}"
            return Given(label, place.source, place.line, place.first, value)
        if isinstance(value, ir.Part):
            return self._joined(place, name, value, state)
        held: Held = place.name(value.name)
        if "\0" in held:
            return Cause(place.line, "the number of a frame is not a whole number", CONSTANT, place.source)
        for _ in range(isinstance(value, ir.Copy) + (isinstance(value, ir.Copy) and value.through)):
            if isinstance(held, str):
                held = self._look(state, held)[0]
        return held

    def _joined(self, place: Place, name: str, part: ir.Part, state: State) -> Held:
        """Return the numbers of a declaration with others in place of some; no other part may change."""
        held, old = self.initial.get(name), self._look(state, name)[0]
        rest = (set(range(14)) - set(range(part.begin, part.begin + 7))) & self._written[name]
        unknown = self._earlier is not None and name not in self._own
        if not isinstance(held, Given) or rest or name in self._changed or unknown:
            reason = f"{shown(name)} changes while the program runs"
            return old if isinstance(old, Cause) else Cause(place.line, reason, CONSTANT, place.source)
        numbers = [number + held.first - place.first for number in held.literal.numbers]
        numbers[part.begin : part.begin + 7] = part.literal.numbers
        return Given(
            name, place.source, place.line, place.first, Literal(held.literal.notation, tuple(numbers))
        )

    def _look(self, state: State, name: str) -> tuple[Held, int]:
        """Return what a name has in a state, and the line that gave it."""
        if name in self._language.constants:
            return name, 0
        steady = self._is_steady(name)
        held: Held | None = self._anytime.get(name) or (None if steady else self._anytime.get(UNKNOWN))
        if held is None and name in state:
            return state[name]
        if held is None and UNKNOWN in state and not steady:
            held = state[UNKNOWN][0]
        if isinstance(held, Cause):
            return (
                held._replace(shows=self.written.get(name, name)) if self._language.is_frame(name) else held
            ), held.line
        if name == UNKNOWN:
            return "", 0
        return self._at_first(name), 0

    def _at_first(self, name: str) -> Held:
        """Return what a name has when the program begins."""
        if (
            (held := self.initial.get(name)) is not None
            and name not in self._givers
            and name not in self._changed
        ):
            earlier = None if self._is_steady(name) else self._earlier
            return earlier or held
        if (active := self._language.active.get(name)) is not None:
            return active
        if name in self._givers or name in self._changed:
            line = self._givers[name][0] if name in self._givers else self._changed[name].line
            return Cause(line, f"{name} changes while the program runs", "give it once, in numbers")
        if self._language.is_frame(name):
            return name
        return Cause(0, f"{shown(name)} is not given by constant numbers")

    # judgement

    def program(self) -> Program:
        """Interpret the program; return what of it is certain, and what is left.

        Raises:
            ProgramError: the text is not understood, or nothing of it is certain.
        """
        try:
            kinds = enumerate(self._ops)
            names = [self._place(i).name(op.name) if isinstance(op, ir.Flow) else "" for i, op in kinds]
            self._ways = Ways[State](self._ops, names)
        except Stray as fault:
            source, line, *_ = self._places[fault.place]
            self.refuse(line, fault.reason, fault.remedy, source)
        for block in self._ways.blocks:
            if block.called:
                self._callers[block.called].append(block)
        self._collect()
        self._run()
        judged = sorted(
            (each for block in self._ways.blocks for each in self._verdicts(block)), key=itemgetter(0)
        )
        for i, _, op, *_, cause in judged:
            own = [] if cause is None else [each for each in op.targets if not isinstance(each, Literal)]
            self._used.update((self._place(i).name(name), self._places[i][1]) for name in own)
        for i, count, op, targets, frames, cause in judged:
            places = np.array([place[:3] for place in self._places[i : i + count]])
            self.columns.move(op, places[:, 1], places[:, 2], targets, frames, cause)
        return self.columns.program(self._used, self._causes)

    def _verdicts(self, block: _Block) -> Iterator[_Verdict]:
        """Yield index and count of the moves of a block, with what is known of them."""
        state, place = self._reached(block), 0
        while place < len(block.ops):
            begin, i = place, block.ops[place]
            op = self._ops[i]
            place += 1
            if isinstance(op, ir.Keep):
                text = f"a move to {op.name}, a position stored in the controller"
                self.columns.remark(self._places[i][1], text, op.name)
            elif not isinstance(op, ir.Move):
                self._step(state, i)
            else:
                while op.repeats and place < len(block.ops) and self._ops[block.ops[place]] is op:
                    if block.ops[place] != i + place - begin:
                        break
                    place += 1
                yield i, place - begin, op, *self._judged(op, i, state)

    def _reached(self, block: _Block) -> State:
        if block.state is None:
            reason = "no way that the program takes leads here"
            return {UNKNOWN: (Cause(0, reason, "omit the move"), 0)}
        return dict(block.state) if block.effects else block.state

    def _judged(self, op: ir.Move, i: int, state: State) -> tuple[list[Given], list[Frames], Cause | None]:
        """Return targets and frames of a move, and why it is left."""
        place = self._place(i)
        cause = place.cause(op.reason, op.remedy) if op.reason else None
        targets: list[Given] = []
        frames: list[Frames] = []
        held: Held
        for target, base, tool in zip(op.targets, op.bases, op.tools, strict=True):
            held = self._target(place, target, state)
            both = tuple(self._frame(place, each, state) for each in (base, tool))
            frames.append((both[0], both[1]))
            for each in (*both, held):
                cause = cause or (each if isinstance(each, Cause) else None)
            if isinstance(held, Given):
                targets.append(held)
        for name, frame in zip(op.agree, frames[0] if frames else (), strict=False):
            held = self._look(state, name)[0]
            if isinstance(held, Cause):
                cause = cause or held
            elif held != self._language.active[name] and not (
                isinstance(frame, FrameName) and held == frame.name
            ):
                reason = f"the target is recorded with another {name} than the active one"
                cause = cause or Cause(
                    place.line, reason, "activate the frame that it is recorded with", place.source
                )
        if cause is not None and not cause.line:
            cause = cause._replace(line=place.line, source=place.source)
        return targets, frames, cause

    def _target(self, place: Place, target: Literal | Name, state: State) -> Given | Cause:
        if isinstance(target, Literal):
            return Given("", place.source, place.line, place.first, target)
        name = place.name(target)
        held = self._look(state, name)[0]
        lines = self._givers.get(name, [])
        if name in self._changed or len(lines) + (name in self.initial) > 1:
            held = self._changed.get(name) or f"it gets numbers on line {lines[-1]}"
        reason = (
            held.reason
            if isinstance(held, Cause) and held.line
            else held
            if isinstance(held, str) and held != name
            else ""
        )
        if isinstance(held, Given) and name in self._shared:
            reason = "the target is declared where other programs use it, too"
            return Cause(place.line, reason, self._language.remedy, place.source)
        if isinstance(held, Given):
            return held._replace(label=name)
        reason = f": {reason}" if reason else ""
        return Cause(
            place.line,
            f"the target {shown(name)} is not given by constant numbers{reason}",
            self._language.remedy,
            place.source,
        )

    def _frame(self, place: Place, value: Value, state: State) -> FrameName | Cause:
        held = self._value(place, "", value, state)
        if isinstance(value, Literal) and isinstance(held, Given):
            held = held._replace(label=f"frame of line {place.line}")
        if isinstance(held, Cause):
            return held
        if isinstance(held, str):
            return FrameName(self.written.get(held, held), self._language.constants.get(held))
        pose = self._pose(held)
        if pose is None:
            return Cause(
                held.line,
                f"{held.label} is no whole frame in numbers",
                "give the whole frame in numbers",
                held.source,
            )
        label = held.label.partition(OF)[0]
        return FrameName(self.written.get(label, label), pose)

    def _pose(self, held: Given) -> FloatArray | None:
        """Return the pose (4, 4) [m] of numbers, the product of several; None if they are none."""
        notation = held.literal.notation
        if notation is None or not notation.has_pose:
            return None
        numbers = held.literal.numbers
        key = held.source, held.first + numbers[0], held.first + numbers[-1]
        if key not in self._poses:
            self._poses[key] = self._product(held, notation)
        return self._poses[key]

    def _product(self, held: Given, notation: Notation) -> FloatArray | None:
        places = held.first + np.array(held.literal.numbers, dtype=np.intp)
        values = self.numerals[held.source].values[places].reshape(-1, 3 + notation.count)
        if not (np.abs(values) <= MAX_VALUE).all() or not notation.states(values).all():
            return None
        return np.asarray(reduce(np.matmul, notation.poses(values)))


def _shown(name: str) -> str:
    return "whatever an unknown routine may change" if name == UNKNOWN else name
