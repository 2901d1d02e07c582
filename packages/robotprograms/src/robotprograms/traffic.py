"""Reads and writes: the operations of a program that look up each name, or give it a new content."""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from itertools import chain

from robotprograms import language as ir
from robotprograms.calls import Calls
from robotprograms.control_flow import ControlFlow
from robotprograms.declarations import UNKNOWN, get_base, list_read_names
from robotprograms.effects import Effects
from robotprograms.language import Op, Value
from robotprograms.liveness import Liveness, Traffic, find_liveness
from robotprograms.statements import Statements


def _list_values(op: Op) -> tuple[Value | ir.Product, ...]:
    """Return the value that an assignment gives, or the bases and tools of a move; () for others."""
    if isinstance(op, ir.Assign):
        return (op.value,)
    if not isinstance(op, ir.Move):
        return ()
    # The move that takes the place of this one if its target is at an offset from another target
    near = op.near_target or op
    return (*op.bases, *op.tools, *near.bases, *near.tools)


class TrafficFinder:
    """Finder of the operations that read and write names."""

    def __init__(self, statements: Statements, calls: Calls, effects: Effects) -> None:
        """Prepare to look at a program, all of whose changes are known."""
        self._statements, self._ops, self._places = statements, statements.ops, statements.places
        self._language, self._declarations = statements.language, statements.declarations
        self._uses, self._changes = statements.uses, statements.changes
        self._calls, self._effects = calls, effects

    def find_liveness(self, bodies: Mapping[str, list[int]], flow: ControlFlow) -> Liveness:
        """Return the names that states leave out, with the operations of each routine."""
        kept = self._list_always_live()
        writes = {name: at for name, at in self._find_writes(bodies).items() if get_base(name) not in kept}
        if not writes:  # most programs declare their points, and assign nothing to them
            return Liveness()
        reads: dict[str, set[int]] = defaultdict(set)
        for i in chain(*bodies.values()):
            for name in self._list_read_names(i) & writes.keys():
                reads[name].add(i)
        moves = {i for i in set(chain(*reads.values())) if isinstance(self._ops[i], ir.Move)}
        traffic = Traffic(
            bodies={name: self._leave_out_moves(body, moves) for name, body in bodies.items()},
            moves=moves,
            reads=reads,
            writes=writes,
            calls=self._find_calls(bodies),
            changed=self._changes.of_routine,
            forgetting={name for name, changed in self._changes.of_routine.items() if UNKNOWN in changed},
        )
        return find_liveness(traffic, flow)

    def _leave_out_moves(self, body: list[int], reading: set[int]) -> list[int]:
        """Return operations without moves, unless these read names."""
        return [i for i in body if i in reading or not isinstance(self._ops[i], ir.Move | ir.MoveToStored)]

    def _find_writes(self, bodies: Mapping[str, list[int]]) -> dict[str, set[int]]:
        """Return the operations that give each name a new content."""
        writes: dict[str, set[int]] = defaultdict(set)
        for i in chain(*bodies.values()):
            for name in self._effects.list_written(i):
                writes[name].add(i)
        return writes

    def _find_calls(self, bodies: Mapping[str, list[int]]) -> dict[int, list[str]]:
        """Return the routines of the program that each operation may call."""
        calls: dict[int, list[str]] = {}
        for i in chain(*bodies.values()):
            op = self._ops[i]
            if isinstance(op, ir.Call) and (called := self._calls.list_called(op)):
                calls[i] = called
        return calls

    def _list_read_names(self, i: int) -> set[str]:
        """Return the full names whose contents operation i looks up."""
        place = self._places[i]
        names = list_read_names(self._ops[i])
        found = set(map(place.qualify, names))
        numbered = [name for name in names if not isinstance(name, str)]
        if numbered:  # repetitions have other numbers in these names
            for number in self._statements.repeats.get(i, array("q"))[1::2]:
                found.update(map(replace(place, first=number).qualify, numbered))
        return found

    def _list_always_live(self) -> set[str]:
        """Return the variables whose names are looked up by what other names contain."""
        active = self._language.active
        names = {
            *self._changes.lasting,
            *active,
            *active.values(),
            *self._declarations.list_contained_names(),
        }
        for place, offset in self._uses.offsets:
            names |= {place.qualify(offset.name), place.qualify(offset.target)}
        for place, op in zip(self._places, self._ops, strict=True):
            for value in _list_values(op):
                if isinstance(value, ir.Named):
                    names.add(place.qualify(value.name))
                elif isinstance(value, ir.Element):
                    names.add(value.table)
        return set(map(get_base, names))
