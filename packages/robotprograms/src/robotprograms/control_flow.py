"""Control flow of programs in the intermediate language: branches, loops, routines and jumps."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import chain
from typing import Final, NamedTuple

from robotprograms import language as ir
from robotprograms.language import Misread, Op

_MAX_DEPTH: Final = 100
"""Largest depth of branches, loops and routines within one another."""


class UnmatchedEnd(Misread):
    """Error that a branch, loop, routine or jump lacks an end; `place` is the index of the existing end."""

    def __init__(self, place: int, reason: str, remedy: str) -> None:
        super().__init__(reason, remedy)
        self.place = place


@dataclass(slots=True)
class _OpenBlock:
    """Branch, loop or routine whose end was not reached yet."""

    kind: str
    begin: int  # index of the operation that begins the block
    other_branches: list[int] = field(default_factory=list)  # indices at which further branches begin
    exits: list[int] = field(default_factory=list)  # indices of jumps to the end of the block
    repetitions: list[int] = field(default_factory=list)  # indices of jumps to its next round
    has_default: bool = False  # whether the block has a default branch, so that one branch is always taken


class FlowFault(NamedTuple):
    """Fault of an operation that does not fit, such as an end without a beginning."""

    reason: str
    remedy: str


@dataclass(slots=True)
class ControlFlow:
    """Control flow of a program: the operations that may follow each operation, besides the next one.

    Operations are given by their indices. In the lines `IF a THEN` (0), `PTP P1` (1), `ELSE` (2), `PTP P2`
    (3) and `ENDIF` (4), the `successors` are 0 → 2, behind which the text of ELSE begins, and 2 → 4, as the
    text before ELSE ends there.

    A successor that is never reached does no harm, but a missing successor would: any branch may be skipped.
    Behind a beginning without an end, and in a routine with an end that has no beginning, no move is
    certain.
    """

    # successors of each operation besides the next one
    successors: defaultdict[int, list[int]] = field(default_factory=lambda: defaultdict(list))
    begins: dict[str, int] = field(default_factory=dict)  # beginning of each routine
    ends: dict[int, str] = field(default_factory=dict)  # routine that ends at each operation
    routine_of: list[str] = field(default_factory=list)  # routine of each operation
    # operations of each routine
    bodies: defaultdict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    anytime_routines: set[str] = field(default_factory=set)  # routines that may run at any time
    shared_routines: set[str] = field(default_factory=set)  # routines that other programs may call
    endless: set[int] = field(default_factory=set)  # ends of loops that only a jump leaves
    faults: dict[int, FlowFault] = field(default_factory=dict)  # operations that do not fit, and why
    # fault that makes moves uncertain, by the operation where this begins
    uncertain: dict[int, int] = field(default_factory=dict)
    faulty_routines: dict[str, int] = field(default_factory=dict)  # fault of each routine that has one


def find_control_flow(ops: list[Op], names: list[str]) -> ControlFlow:
    """Find beginning and end of all branches, loops and routines, and the labels of all jumps.

    Args:
        ops: operations in the order of the text; missing ends are appended to them.
        names: name of each operation that is a `Flow`; empty for other operations.

    Raises:
        UnmatchedEnd: branches, loops or routines are nested too deep.
    """
    return _FlowFinder(ops, names).find()


class _FlowFinder:
    """Finder of the control flow of a program: the operations are added one after the other."""

    def __init__(self, ops: list[Op], names: list[str]) -> None:
        """Begin without a control flow.

        Args:
            ops: operations in the order of the text; missing ends are appended to them.
            names: name of each operation that is a `Flow`; empty for other operations.
        """
        self._flow = ControlFlow()
        self._ops, self._last = ops, len(ops) - 1  # operations of the text, and the index of the last one
        self._names = names
        self._open_blocks: list[_OpenBlock] = []  # blocks whose end was not reached yet
        self._open_routines = [""]  # routines whose end was not reached yet; "" for text outside of routines
        # indices of labels, by routine and name: a name may occur twice
        self._labels: dict[str, dict[str, list[int]]] = defaultdict(lambda: defaultdict(list))
        self._jumps: list[int] = []  # indices of jumps

    def find(self) -> ControlFlow:
        """Return the control flow of all operations.

        Raises:
            UnmatchedEnd: branches, loops or routines are nested too deep.
        """
        for i, op in enumerate(self._ops):
            if isinstance(op, ir.Flow):
                self._add_operation(i, op)
            self._note_routine(i)
        self._append_missing_ends()
        self._link_jumps()
        self._distrust_faulty_routines()
        if self._can_continue_after_error():
            self._add_error_exits()
        return self._flow

    def _note_routine(self, i: int) -> None:
        """Note the routine of operation i: the one that ends there, or the innermost one that is open."""
        routine = self._flow.ends.get(i, self._open_routines[-1])
        self._flow.routine_of.append(routine)
        self._flow.bodies[routine].append(i)

    def _distrust_faulty_routines(self) -> None:
        """Note that no move of a routine with a fault is certain."""
        for routine, fault in self._flow.faulty_routines.items():
            if routine in self._flow.begins:
                self._flow.uncertain[self._flow.begins[routine]] = fault

    def _can_continue_after_error(self) -> bool:
        """Return whether an error or an interrupt may end a routine at any of its operations.

        This may happen in a program with a handler that has no name, which handles errors, and in a program
        with a `resume`, which ends the routines that a handler interrupted.
        """
        for routine in self._flow.anytime_routines:
            begin = self._flow.begins[routine]
            op = self._ops[begin]
            is_handler = isinstance(op, ir.Flow) and op.kind == "handler"
            has_name = bool(self._names[begin])
            if is_handler and not has_name:
                return True
        return any(isinstance(op, ir.Flow) and op.kind == "resume" for op in self._ops)

    def _append_missing_ends(self) -> None:
        """Append the ends of routines and blocks that are open at the end of the text, which may be cut."""
        while self._open_blocks:
            block = self._open_blocks[-1]
            is_routine = block.kind == "routine"
            if not is_routine:
                self._note_missing_end(block)
                self._distrust_labels(self._open_routines[-1], block.begin)
            kind = "end" if is_routine else "close"
            self._ops.append(ir.Flow(kind))
            end = len(self._ops) - 1
            self._end_block(end, kind)
            self._note_routine(end)

    def _distrust_labels(self, routine: str, fault: int) -> None:
        """Note that no move behind any label of a routine is certain.

        The text ends before the end of a block: what was cut off may have had a jump to any of the labels.

        Args:
            routine: name of the routine.
            fault: index of the operation whose end is missing.
        """
        places_by_name = self._labels[routine]
        for label in chain(*places_by_name.values()):
            self._flow.uncertain.setdefault(label, fault)

    def _link_jumps(self) -> None:
        """Let the program continue at its label behind each jump.

        A jump whose label is computed while the program runs, and a jump to a name that is no label of its
        routine, may lead to each label of the routine. A jump in a routine without labels is a fault.
        """
        for jump in self._jumps:
            routine, name = self._flow.routine_of[jump], self._names[jump]
            places_by_name = self._labels[routine]
            places = places_by_name.get(name)
            if places is None:
                places = list(chain(*places_by_name.values()))
            if not places:
                self._note_fault(jump, routine, "the label of a jump does not exist", "write the label")
            self._flow.successors[jump] += places

    def _add_error_exits(self) -> None:
        """Let the program continue at the end of a routine behind each of the routine's operations.

        An error or an interrupt may occur anywhere; the caller may then continue behind the call.
        """
        for end, routine in self._flow.ends.items():
            *operations_before_end, _ = self._flow.bodies[routine]
            for index in operations_before_end:
                self._flow.successors[index].append(end)

    def _add_operation(self, i: int, op: ir.Flow) -> None:
        """Add operation `op`, which has index i, to the control flow.

        `op.kind` says what it does: begin a block (a branch or a loop), a routine or a further branch, end
        one of them, jump, or mark the label of a jump.

        Raises:
            UnmatchedEnd: the operation is nested too deep.
        """
        if op.kind in ir.ROUTINES | ir.BLOCKS:
            self._begin_block(i, op)
        elif op.kind == "label":
            self._labels[self._open_routines[-1]][self._names[i]].append(i)
        elif op.kind == "jump":
            self._jumps.append(i)
        elif op.kind == "stop":  # nothing follows a stop
            return
        elif op.kind in ir.JUMPS:
            self._leave_block(i, op.kind)
        else:
            self._end_block(i, op.kind)

    def _begin_block(self, i: int, op: ir.Flow) -> None:
        """Begin a branch, a loop or a routine at index i; its end is looked for from there on.

        Raises:
            UnmatchedEnd: it is nested too deep.
        """
        if len(self._open_blocks) >= _MAX_DEPTH:
            reason = f"branches and loops are nested more than {_MAX_DEPTH} deep"
            raise UnmatchedEnd(i, reason, "move inner branches and loops to routines of their own")
        if op.kind in ir.ROUTINES:
            self._begin_routine(i, op)
            self._open_blocks.append(_OpenBlock("routine", i))
        else:
            self._open_blocks.append(_OpenBlock(op.kind, i))

    def _leave_block(self, i: int, kind: str) -> None:
        """Note that the operation with index i leaves the innermost loop or routine, or begins a round.

        There are three cases:

        1. `again`, as of CONTINUE, begins the next round of the innermost loop.
        2. `leave`, as of EXIT or BREAK, leaves the innermost loop.
        3. Any other kind, such as that of RETURN, leaves the routine, as do the first two outside of loops.
        """
        concerns_loop = kind in {"leave", "again"}
        kinds_of_block = ir.LOOPS | {"routine"} if concerns_loop else {"routine"}
        for block in reversed(self._open_blocks):
            if block.kind not in kinds_of_block:
                continue
            begins_next_round = kind == "again" and block.kind != "routine"
            if begins_next_round:
                block.repetitions.append(i)
            else:
                block.exits.append(i)
            return

    def _begin_routine(self, i: int, op: ir.Flow) -> None:
        """Note that a routine begins at index i.

        A handler without a name gets one. A second routine of the same name gets another name, and no move of
        the two routines is certain.
        """
        name = self._names[i] or f"handler {i}"
        if name in self._flow.begins:
            reason, remedy = "a routine is defined twice", "define each routine once; send one program"
            self._note_fault(i, name, reason, remedy)
            name = f"{name} again {i}"
            self._flow.faulty_routines[name] = i
        self._flow.begins[name] = i
        if op.kind != "routine":  # a handler
            self._flow.anytime_routines.add(name)
        if op.shared:
            self._flow.shared_routines.add(name)
        self._open_routines.append(name)

    def _end_block(self, i: int, kind: str) -> None:
        """End a branch, a loop or a routine at index i, or begin another branch there.

        The end of a routine ends its branches and loops, too, whose own ends are missing. An end that does
        not fit to a beginning ends nothing: it is a fault.
        """
        ends_routine = kind == "end"
        is_in_routine = any(block.kind == "routine" for block in self._open_blocks)
        if ends_routine and is_in_routine:
            while self._open_blocks[-1].kind != "routine":
                self._note_missing_end(self._open_blocks[-1])
                self._end_block(i, "close")
        innermost = self._open_blocks[-1] if self._open_blocks else None
        is_innermost_routine = innermost is not None and innermost.kind == "routine"
        fits_to_any = kind == "close_or_end"
        if innermost is not None and (fits_to_any or ends_routine == is_innermost_routine):
            self._end_open_block(i, kind, innermost)
        else:
            self._note_missing_begin(i, kind)

    def _note_missing_begin(self, i: int, kind: str) -> None:
        """Note that the end with index i has no beginning, so that no move of the routine is certain.

        There is an exception: the last statement of a text in which no routine begins may be the end of a
        routine whose first line is missing. Its moves are certain unless something changes behind the first
        move: the missing line may also have begun a loop.
        """
        reason = "this line ends a branch, a loop or a routine that does not begin before it"
        remedy = "write both ends of branches, loops and routines"
        may_end_routine = kind == "close_or_end"
        is_only_first_line_missing = may_end_routine and not self._flow.begins and i == self._last
        if is_only_first_line_missing and not self._has_changes_behind_first_move(i):
            self._flow.faults[i] = FlowFault(reason, remedy)
            return
        self._note_fault(i, self._open_routines[-1], reason, remedy)
        if may_end_routine:  # an end before it may have ended a routine too early
            for routine in self._flow.begins:
                self._flow.faulty_routines.setdefault(routine, i)

    def _has_changes_behind_first_move(self, end: int) -> bool:
        """Return whether an operation between the first move and the index `end` may change a value.

        Assignments, statements with unknown values, and calls that are not known to be harmless may do so.
        """
        first_move = next((k for k, op in enumerate(self._ops) if isinstance(op, ir.Move)), 0)
        for op in self._ops[first_move:end]:
            if isinstance(op, ir.Assign | ir.MakeUnknown):
                return True
            if isinstance(op, ir.Call) and not op.harmless:
                return True
        return False

    def _end_open_block(self, i: int, kind: str, block: _OpenBlock) -> None:
        """End the innermost block, a branch, loop or routine, at index i, or begin its next branch there.

        `ELSE` is of the kind `default`, `ELSEIF` of the kind `branch`: the block stays open behind both.
        Behind any other kind, the block is closed, and its successors are noted.

        Args:
            i: index of the operation.
            kind: kind of the operation.
            block: the innermost block.
        """
        begins_next_branch = kind in {"branch", "default"}
        if begins_next_branch:
            block.other_branches.append(i)
            block.has_default |= kind == "default"
            return
        self._open_blocks.pop()
        if block.kind == "routine":
            self._flow.ends[i] = self._open_routines.pop()
        self._link_branches(i, block)
        if block.kind in ir.LOOPS:
            self._link_rounds(i, block)

    def _link_branches(self, end: int, block: _OpenBlock) -> None:
        """Add to `successors` how the program continues at the branches and at the end of a block.

        In `IF a … ELSE … ENDIF`, the line of IF may be followed by the text behind ELSE, and the line before
        ELSE by that behind ENDIF. Jumps out of the block continue at its end, too.

        Args:
            end: index of the block's end.
            block: branch, loop or routine.
        """
        successors = self._flow.successors
        # The text of a branch ends where the next one begins: from there, the program continues at the end.
        ends_of_branches = block.other_branches
        for index in (*ends_of_branches, *block.exits):
            successors[index].append(end)
        successors[block.begin] += block.other_branches
        may_be_skipped = block.kind in {"if", "switch", "loop"} and not block.has_default
        if may_be_skipped:
            successors[block.begin].append(end)

    def _link_rounds(self, end: int, loop: _OpenBlock) -> None:
        """Let each round of a loop continue with the next one, from the loop's end and from jumps to it.

        In `REPEAT … UNTIL a`, the condition is at the end: a jump to the next round goes there, where the
        loop may also be left. A loop of the kind `forever` has no condition: only a jump leaves it.

        Args:
            end: index of the loop's last operation.
            loop: the loop; `loop.repetitions` are the indices of jumps to the next round.
        """
        for index in (end, *loop.repetitions):
            self._flow.successors[index].append(loop.begin)
        has_condition_at_end = loop.kind == "repeat"
        if has_condition_at_end:  # so that a jump to the next round may also leave the loop
            for index in loop.repetitions:
                self._flow.successors[index].append(end)
        if loop.kind == "forever":
            self._flow.endless.add(end)

    def _note_fault(self, i: int, routine: str, reason: str, remedy: str) -> None:
        """Note that operation i does not fit, so that no move of the routine is certain."""
        self._flow.faults.setdefault(i, FlowFault(reason, remedy))
        self._flow.faulty_routines.setdefault(routine, i)

    def _note_missing_end(self, block: _OpenBlock) -> None:
        """Note that a branch or a loop has no end, so that no move behind its beginning is certain."""
        fault = FlowFault("a branch or a loop has no end", "write its end")
        self._flow.faults.setdefault(block.begin, fault)
        self._flow.uncertain.setdefault(block.begin, block.begin)
