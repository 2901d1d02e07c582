"""Names whose contents nothing reads any more: states leave them out, so that time grows with the lines.

A name is live at an operation if a path leads from there to an operation that reads the name, and no other
operation on this path gives the name a new content. Each name is followed backwards from where it is read.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Set
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from robotprograms.control_flow import ControlFlow

MAX_STEPS: Final = 1_000_000
"""Largest number of steps that follow names backwards; names beyond stay in all states."""

Names = defaultdict[int, set[str]]
"""Names by the index of an operation."""


@dataclass(frozen=True)
class Traffic:
    """Operations of a program that read or write contents, as relations."""

    bodies: Mapping[str, list[int]]  # operations of each routine, and moves that read names
    moves: Set[int]  # these moves: they change no state
    reads: Mapping[str, set[int]]  # operations that read each name
    writes: Mapping[str, set[int]]  # operations that give each name a new content
    calls: Mapping[int, list[str]]  # routines that each operation calls
    changed: Mapping[str, Collection[str]]  # names that each routine may change, also by its calls
    forgetting: Collection[str]  # routines behind which any name may be unknown


@dataclass(frozen=True)
class Liveness:
    """Names that states leave out, and names that return from routines."""

    followed: set[str] = field(default_factory=set)  # names that were followed; all other names are live
    dead: Names = field(default_factory=lambda: defaultdict(set))  # names that die on the way to an operation
    at_begin: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))  # live names by routine
    at_exit: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))  # live names by routine
    returned: Names = field(default_factory=lambda: defaultdict(set))  # live names that a call changes


class _Graph:
    """Edges between operations, in both directions."""

    def __init__(self, traffic: Traffic, flow: ControlFlow) -> None:
        """Build the graph of a program whose nodes are operations, by their indices."""
        self.after: defaultdict[int, list[int]] = defaultdict(list)  # operations that may follow
        self.before: defaultdict[int, list[int]] = defaultdict(list)  # operations that may come before
        self._moves = traffic.moves
        # routine by the index of its last operation, and the other way round
        self.last = {body[-1]: routine for routine, body in traffic.bodies.items() if body}
        self.end_of = {routine: index for index, routine in self.last.items()}
        self.begins = {flow.begins[routine]: routine for routine in traffic.bodies if routine in flow.begins}
        self.callers: defaultdict[str, list[int]] = defaultdict(list)  # operations that call each routine
        for index, routines in traffic.calls.items():
            for routine in routines:
                self.callers[routine].append(index)
        for body in traffic.bodies.values():
            for index, following in pairwise(body):
                self._add_edge(index, following)
        for index, others in flow.successors.items():
            for other in others:
                self._add_edge(index, other)

    def skip_moves(self, index: int) -> int:
        """Return the first operation from an index on that is not a move; the last move of a routine."""
        while index in self._moves and self.after[index]:
            index = self.after[index][0]
        return index

    def _add_edge(self, index: int, other: int) -> None:
        """Add an edge from an operation to another one."""
        self.after[index].append(other)
        self.before[other].append(index)


class _Name:
    """One name that is followed backwards."""

    def __init__(self, name: str, traffic: Traffic, graph: _Graph) -> None:
        """Prepare to follow a name backwards from the operations that read it.

        A name is live at an operation if its content there may be read later.
        """
        self.name, self._traffic, self._graph = name, traffic, graph
        self.at: set[int] = set()  # operations before which the name is live
        self.behind: set[int] = set()  # operations behind which the name is live
        self.exits: set[str] = set()  # routines at whose end the name is live
        self._writes = traffic.writes.get(name, set())
        self._to_visit = [*traffic.reads.get(name, ())]

    def follow(self) -> None:
        """Find all operations before and behind which the name is live."""
        while self._to_visit:
            index = self._to_visit.pop()
            if index in self.at:
                continue
            self.at.add(index)
            for other in self._graph.before[index]:
                self._pass_behind(other)
            if index in self._graph.begins:  # the callers' states come in
                self._to_visit += self._graph.callers[self._graph.begins[index]]

    def _end(self, routine: str) -> None:
        """Let the name be live at the end of a routine."""
        if routine not in self.exits:
            self.exits.add(routine)
            if routine in self._graph.end_of:
                self._pass_behind(self._graph.end_of[routine])

    def _pass_behind(self, index: int) -> None:
        """Let the name be live behind an operation, and before it unless it gives a new content."""
        if index in self.behind:
            return
        self.behind.add(index)
        for routine in self._traffic.calls.get(index, ()):
            if routine in self._traffic.forgetting or self.name in self._traffic.changed[routine]:
                self._end(routine)
        if index not in self._writes:
            self._to_visit.append(index)

    def note(self, liveness: Liveness) -> None:
        """Note where the name dies, and where it enters and leaves routines."""
        liveness.followed.add(self.name)
        read_by_moves = self._traffic.reads.get(self.name, set()) & self._traffic.moves
        for index in self.behind | self._writes | read_by_moves:
            for other in self._graph.after[index]:
                if other not in self.at:
                    liveness.dead[self._graph.skip_moves(other)].add(self.name)
            if index in self._traffic.calls and index in self.behind:
                liveness.returned[index].add(self.name)
        for index in self.at & self._graph.begins.keys():
            liveness.at_begin[self._graph.begins[index]].add(self.name)
        for routine in self.exits:
            liveness.at_exit[routine].add(self.name)


def find_liveness(traffic: Traffic, flow: ControlFlow) -> Liveness:
    """Find the operations behind which nothing reads a name any more, for names that get new contents.

    Each name is followed backwards from where it is read, until there are too many steps.
    """
    graph, liveness = _Graph(traffic, flow), Liveness()
    steps = 0
    for written_name in traffic.writes:
        name = _Name(written_name, traffic, graph)
        name.follow()
        steps += len(name.at) + len(name.behind)
        if steps > MAX_STEPS:
            break
        name.note(liveness)
    return liveness
