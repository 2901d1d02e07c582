"""Control flow of programs in the intermediate language: branches, loops, routines and jumps."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import chain
from typing import Final

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


class ControlFlow:
    """Control flow of a program: the operations that may follow each operation, besides the next one.

    A successor that is never reached does no harm, but a missing successor would: any branch may be skipped.
    Behind a beginning without an end, and in a routine with an end that has no beginning, no move is certain.
    """

    def __init__(self, ops: list[Op], names: list[str]) -> None:
        """Find beginning and end of all branches, loops and routines, and the labels of all jumps.

        Args:
            ops: operations in the order of the text; missing ends are appended to them.
            names: name of each operation that is a `Flow`; empty for other operations.

        Raises:
            UnmatchedEnd: branches, loops or routines are nested too deep.
        """
        self.faults: dict[int, tuple[str, str]] = {}  # reason and remedy of each operation that does not fit
        # index of the fault that makes moves uncertain, by the index of the operation where this begins
        self.uncertain: dict[int, int] = {}
        self.faulty_routines: dict[str, int] = {}  # index of the fault of each routine that has one
        self.successors: defaultdict[int, list[int]] = defaultdict(list)  # successors besides the next one
        self.begins: dict[str, int] = {}  # index of the beginning of each routine
        self.ends: dict[int, str] = {}  # routine that ends at each index
        self.routine_of: list[str] = []  # routine of each operation
        self.bodies: defaultdict[str, list[int]] = defaultdict(list)  # indices of each routine's operations
        self.anytime_routines: set[str] = set()  # routines that may run at any time
        self.shared_routines: set[str] = set()  # routines that other programs may call
        self.endless: set[int] = set()  # indices of the ends of loops that only a jump leaves
        self._names = names
        self._open_blocks: list[_OpenBlock] = []  # blocks whose end was not reached yet
        self._open_routines = [""]  # routines whose end was not reached yet; "" for text outside of routines
        # indices of labels, by routine and name: a name may occur twice
        self._labels: dict[str, dict[str, list[int]]] = defaultdict(lambda: defaultdict(list))
        self._jumps: list[int] = []  # indices of jumps
        self._ops, self._last = ops, len(ops) - 1  # operations of the text, and the index of the last one
        for i, op in enumerate(ops):
            if isinstance(op, ir.Flow):
                self._add_operation(i, op)
            self.routine_of.append(self.ends.get(i, self._open_routines[-1]))
        self._append_missing_ends()
        for i, name in enumerate(self.routine_of):
            self.bodies[name].append(i)
        self._link_jumps()
        for routine, fault in self.faulty_routines.items():
            if routine in self.begins:
                self.uncertain[self.begins[routine]] = fault
        if self._can_continue_after_error():
            self._add_error_exits()

    def _can_continue_after_error(self) -> bool:
        """Return whether an error or an interrupt may end a routine at any of its operations.

        This may happen in a program with a handler that has no name, which handles errors, and in a program
        with a `resume`, which ends the routines that a handler interrupted.
        """
        for routine in self.anytime_routines:
            begin = self.begins[routine]
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
            self.routine_of.append(self.ends.get(end, self._open_routines[-1]))

    def _distrust_labels(self, routine: str, fault: int) -> None:
        """Note that no move behind any label of a routine is certain: text that was cut off may jump there.

        `fault` is the index of the operation whose end is missing.
        """
        places_by_name = self._labels[routine]
        for label in chain(*places_by_name.values()):
            self.uncertain.setdefault(label, fault)

    def _link_jumps(self) -> None:
        """Let the program continue at its label behind each jump.

        A jump whose label is computed while the program runs, and a jump to a name that is no label of its
        routine, may lead to each label of the routine. A jump in a routine without labels is a fault.
        """
        for jump in self._jumps:
            routine, name = self.routine_of[jump], self._names[jump]
            places_by_name = self._labels[routine]
            places = places_by_name.get(name)
            if places is None:
                places = list(chain(*places_by_name.values()))
            if not places:
                self._note_fault(jump, routine, "the label of a jump does not exist", "write the label")
            self.successors[jump] += places

    def _add_error_exits(self) -> None:
        """Let the program continue at the end of a routine behind each of the routine's operations.

        An error or an interrupt may occur anywhere; the caller may then continue behind the call.
        """
        for end, routine in self.ends.items():
            *operations_before_end, _ = self.bodies[routine]
            for index in operations_before_end:
                self.successors[index].append(end)

    def _add_operation(self, i: int, op: ir.Flow) -> None:
        """Add operation `op`, which has index i, to the control flow.

        `op.kind` says what it does: begin a block (a branch or a loop), a routine or a further branch, end
        one of them, jump, or mark the label of a jump.

        Raises:
            UnmatchedEnd: the operation is nested too deep.
        """
        begins_block = op.kind in ir.ROUTINES | ir.BLOCKS
        if begins_block and len(self._open_blocks) >= _MAX_DEPTH:
            reason = f"branches and loops are nested more than {_MAX_DEPTH} deep"
            raise UnmatchedEnd(i, reason, "move inner branches and loops to routines of their own")
        if op.kind in ir.BLOCKS:
            self._open_blocks.append(_OpenBlock(op.kind, i))
        elif op.kind in ir.ROUTINES:
            self._open_blocks.append(self._begin_routine(i, op))
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

    def _leave_block(self, i: int, kind: str) -> None:
        """Note that the operation with index i leaves the innermost loop or routine, or begins a round.

        `leave` and `again` concern the innermost loop. Without a loop around them, the operation leaves the
        routine, and so do all other kinds, such as a return.
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

    def _begin_routine(self, i: int, op: ir.Flow) -> _OpenBlock:
        """Note that a routine begins at index i, and return it as a block whose end is not reached yet.

        A handler without a name gets one. A second routine of the same name gets another name, and no move of
        the two routines is certain.
        """
        name = self._names[i] or f"handler {i}"
        if name in self.begins:
            reason, remedy = "a routine is defined twice", "define each routine once; send one program"
            self._note_fault(i, name, reason, remedy)
            name = f"{name} again {i}"
            self.faulty_routines[name] = i
        self.begins[name] = i
        if op.kind != "routine":  # a handler
            self.anytime_routines.add(name)
        if op.shared:
            self.shared_routines.add(name)
        self._open_routines.append(name)
        return _OpenBlock("routine", i)

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
        is_only_first_line_missing = may_end_routine and not self.begins and i == self._last
        if is_only_first_line_missing and not self._has_changes_behind_first_move(i):
            self.faults[i] = (reason, remedy)
            return
        self._note_fault(i, self._open_routines[-1], reason, remedy)
        if may_end_routine:  # an end before it may have ended a routine too early
            for routine in self.begins:
                self.faulty_routines.setdefault(routine, i)

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

        Add to `successors` where the program may continue: behind the beginning of the block at each branch
        or, if the block may be skipped, at its end; behind each branch, and behind jumps out of it, at its
        end.
        """
        begins_next_branch = kind in {"branch", "default"}
        if begins_next_branch:
            block.other_branches.append(i)
            block.has_default |= kind == "default"
            return
        self._open_blocks.pop()
        if block.kind == "routine":
            self.ends[i] = self._open_routines.pop()
        # The text of a branch ends where the next one begins: from there, the program continues at the end.
        ends_of_branches = block.other_branches
        for index in (*ends_of_branches, *block.exits):
            self.successors[index].append(i)
        self.successors[block.begin] += block.other_branches
        may_be_skipped = block.kind in {"if", "switch", "loop"} and not block.has_default
        if may_be_skipped:
            self.successors[block.begin].append(i)
        if block.kind in ir.LOOPS:
            self._link_rounds(i, block)

    def _link_rounds(self, end: int, loop: _OpenBlock) -> None:
        """Let each round of a loop continue with the next one, from the loop's end and from jumps to it.

        Args:
            end: index of the loop's last operation.
            loop: the loop; `loop.repetitions` are the indices of jumps to the next round.
        """
        for index in (end, *loop.repetitions):
            self.successors[index].append(loop.begin)
        has_condition_at_end = loop.kind == "repeat"
        if has_condition_at_end:  # so that a jump to the next round may also leave the loop
            for index in loop.repetitions:
                self.successors[index].append(end)
        if loop.kind == "forever":
            self.endless.add(end)

    def _note_fault(self, i: int, routine: str, reason: str, remedy: str) -> None:
        """Note that operation i does not fit, so that no move of the routine is certain."""
        self.faults.setdefault(i, (reason, remedy))
        self.faulty_routines.setdefault(routine, i)

    def _note_missing_end(self, block: _OpenBlock) -> None:
        """Note that a branch or a loop has no end, so that no move behind its beginning is certain."""
        self.faults.setdefault(block.begin, ("a branch or a loop has no end", "write its end"))
        self.uncertain.setdefault(block.begin, block.begin)
