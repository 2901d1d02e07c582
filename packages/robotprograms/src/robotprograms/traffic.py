"""Reads and writes: the operations of a program that look up each name, or give it a new content."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Set
from dataclasses import replace
from itertools import chain

from robotprograms import language as ir
from robotprograms.calls import Calls
from robotprograms.control_flow import ControlFlow
from robotprograms.declarations import UNKNOWN, get_base, list_read_names
from robotprograms.effects import Effects
from robotprograms.language import Op, Value
from robotprograms.liveness import Liveness, Traffic, find_liveness
from robotprograms.places import Place
from robotprograms.statements import Statements


def _list_contained_names(place: Place, op: Op) -> list[str]:
    """Return the full names that an operation gives to a variable, or to a move, as the content itself.

    After `$BASE=BASE_DATA[i]`, for example, the content of `$BASE` is the name of an element of `BASE_DATA`.
    """
    names = list[str]()
    for value in _list_values(op):
        if isinstance(value, ir.Named):
            names.append(place.qualify(value.name))
        elif isinstance(value, ir.Element):
            names.append(value.table)
    return names


def _list_values(op: Op) -> tuple[Value | ir.Product, ...]:
    """Return the value that an assignment gives, or the bases and tools of a move; () for others."""
    if isinstance(op, ir.Assign):
        return (op.value,)
    if not isinstance(op, ir.Move):
        return ()
    # A move to an offset from a target is replaced by `near_target`, which has frames of its own.
    near = op.near_target or op
    return (*op.bases, *op.tools, *near.bases, *near.tools)


class TrafficFinder:
    """Finder of the operations that read and write names."""

    def __init__(self, statements: Statements, calls: Calls, effects: Effects) -> None:
        """Prepare to look at a program, all of whose changes are known."""
        self._statements, self._ops, self._places = statements, statements.ops, statements.places
        self._changes, self._calls, self._effects = statements.changes, calls, effects

    def find_liveness(self, bodies: Mapping[str, list[int]], flow: ControlFlow) -> Liveness:
        """Find where nothing reads the content of a variable any more, so that states can leave it out.

        Args:
            bodies: indices of the operations of each routine.
            flow: control flow of the program.
        """
        always_live = self._list_always_live()
        writes = self._find_writes(bodies)
        followed = {name: indices for name, indices in writes.items() if get_base(name) not in always_live}
        if not followed:  # most programs declare their points, and assign nothing to them
            return Liveness()
        return find_liveness(self._find_traffic(bodies, followed), flow)

    def _find_traffic(self, bodies: Mapping[str, list[int]], writes: Mapping[str, set[int]]) -> Traffic:
        """Find the operations that read, write and call what matters for some names.

        Args:
            bodies: indices of the operations of each routine.
            writes: by these names, the operations that give each one a new content.
        """
        reads = self._find_reads(bodies, writes.keys())
        reading_operations = set(chain(*reads.values()))
        reading_moves = {i for i in reading_operations if isinstance(self._ops[i], ir.Move)}
        changed = self._changes.of_routine
        return Traffic(
            bodies={name: self._leave_out_moves(body, reading_moves) for name, body in bodies.items()},
            moves=reading_moves,
            reads=reads,
            writes=writes,
            calls=self._find_calls(bodies),
            changed=changed,
            forgetting={routine for routine, names in changed.items() if UNKNOWN in names},
        )

    def _find_reads(self, bodies: Mapping[str, list[int]], names: Set[str]) -> dict[str, set[int]]:
        """Return the operations that read each of some names, by their indices."""
        reads: dict[str, set[int]] = defaultdict(set)
        for i in chain(*bodies.values()):
            for name in self._list_read_names(i) & names:
                reads[name].add(i)
        return reads

    def _leave_out_moves(self, body: list[int], reading_moves: set[int]) -> list[int]:
        """Return the operations of a routine, by their indices, without moves that read no variable."""
        kept = []
        for i in body:
            is_move = isinstance(self._ops[i], ir.Move | ir.MoveToStored)
            if i in reading_moves or not is_move:
                kept.append(i)
        return kept

    def _find_writes(self, bodies: Mapping[str, list[int]]) -> dict[str, set[int]]:
        """Return the operations that give each name a new content, by their indices.

        `bodies` are the indices of each routine's operations.
        """
        writes: dict[str, set[int]] = defaultdict(set)
        for i in chain(*bodies.values()):
            for name in self._effects.list_written(i):
                writes[name].add(i)
        return writes

    def _find_calls(self, bodies: Mapping[str, list[int]]) -> dict[int, list[str]]:
        """Return the routines of the program that each call may start, by the index of the call.

        `bodies` are the indices of each routine's operations. Calls of other routines only are left out.
        """
        calls: dict[int, list[str]] = {}
        for i in chain(*bodies.values()):
            op = self._ops[i]
            called = self._calls.list_called(op) if isinstance(op, ir.Call) else []
            if called:
                calls[i] = called
        return calls

    def _list_read_names(self, i: int) -> set[str]:
        """Return the full names of the variables whose contents operation i reads.

        Statements that differ only in their numbers share one operation. They read other elements of an array
        where the index is such a number, as in `P[1]` and `P[2]`.
        """
        place = self._places[i]
        names = list_read_names(self._ops[i])
        full_names = set(map(place.qualify, names))
        names_with_number = [name for name in names if isinstance(name, ir.NumberedName)]
        if names_with_number:
            for repetition in self._statements.list_repetitions(i):
                place_of_repetition = replace(place, first=repetition.first)
                full_names.update(map(place_of_repetition.qualify, names_with_number))
        return full_names

    def _list_always_live(self) -> set[str]:
        """Return the variables that count as read everywhere, without the routines they belong to.

        They are found through the contents of other variables, so that no operation names them: a name that
        is assigned may be looked up wherever the variable is read that gets it.
        """
        names = self._statements.list_indirectly_read_names()
        for place, op in zip(self._places, self._ops, strict=True):
            names.update(_list_contained_names(place, op))
        return set(map(get_base, names))
