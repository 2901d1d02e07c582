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
        """Build the graph of a program whose nodes are operations, by their indices.

        An edge leads from an operation to one that may run next: in the order of a routine, or by a jump.
        """
        self.after: defaultdict[int, list[int]] = defaultdict(list)  # operations that may follow
        self.before: defaultdict[int, list[int]] = defaultdict(list)  # operations that may come before
        self._moves = traffic.moves
        self.last_of_routine = {routine: body[-1] for routine, body in traffic.bodies.items() if body}
        self.routine_begun_at = {
            flow.begins[routine]: routine for routine in traffic.bodies if routine in flow.begins
        }
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
        """Return the first operation from an index on that is no move; moves have no states of their own.

        If only moves follow up to the end of the routine, the last move is returned.
        """
        while index in self._moves and self.after[index]:
            index = self.after[index][0]
        return index

    def _add_edge(self, index: int, other: int) -> None:
        """Add an edge from an operation to another one."""
        self.after[index].append(other)
        self.before[other].append(index)


class _LiveRange:
    """Operations at which one name is live: its content there may be read later."""

    def __init__(self, name: str, traffic: Traffic, graph: _Graph) -> None:
        """Prepare to follow a name backwards from the operations that read it.

        Args:
            name: full name of a variable.
            traffic: operations that read and write each name.
            graph: operations that may run before and after each operation.
        """
        self.name, self._traffic, self._graph = name, traffic, graph
        self.at: set[int] = set()  # operations before which the name is live
        self.behind: set[int] = set()  # operations behind which the name is live
        self.exits: set[str] = set()  # routines at whose end the name is live
        self._writes = traffic.writes.get(name, set())
        self._to_visit = [*traffic.reads.get(name, ())]  # operations before which the name is live

    def follow(self) -> None:
        """Find all operations before and behind which the name is live."""
        while self._to_visit:
            index = self._to_visit.pop()
            if index in self.at:
                continue
            self.at.add(index)
            for previous in self._graph.before[index]:
                self._make_live_behind(previous)
            begun_routine = self._graph.routine_begun_at.get(index)
            if begun_routine is not None:  # the name comes in from the callers of the routine
                self._to_visit += self._graph.callers[begun_routine]

    def _make_live_behind(self, index: int) -> None:
        """Note that the name is live behind an operation, and before it unless it gives a new content.

        Behind a call, the content may come from the called routine: the name is then live at its end, too.
        """
        if index in self.behind:
            return
        self.behind.add(index)
        for routine in self._traffic.calls.get(index, ()):
            may_change_all = routine in self._traffic.forgetting
            if may_change_all or self.name in self._traffic.changed[routine]:
                self._make_live_at_end(routine)
        gives_new_content = index in self._writes
        if not gives_new_content:
            self._to_visit.append(index)

    def _make_live_at_end(self, routine: str) -> None:
        """Note that the name is live at the end of a routine, and so behind the routine's last operation."""
        if routine in self.exits:
            return
        self.exits.add(routine)
        if routine in self._graph.last_of_routine:
            self._make_live_behind(self._graph.last_of_routine[routine])

    def add_to(self, liveness: Liveness) -> None:
        """Add to `liveness` where the name dies, and where it enters and leaves routines.

        A name dies on the way from an operation behind which it may have a content to one before which it is
        not live.
        """
        graph, traffic = self._graph, self._traffic
        liveness.followed.add(self.name)
        read_by_moves = traffic.reads.get(self.name, set()) & traffic.moves
        for index in self.behind | self._writes | read_by_moves:
            for following in graph.after[index]:
                if following not in self.at:
                    liveness.dead[graph.skip_moves(following)].add(self.name)
            is_live_behind_call = index in traffic.calls and index in self.behind
            if is_live_behind_call:
                liveness.returned[index].add(self.name)
        for index in self.at & graph.routine_begun_at.keys():
            liveness.at_begin[graph.routine_begun_at[index]].add(self.name)
        for routine in self.exits:
            liveness.at_exit[routine].add(self.name)


def find_liveness(traffic: Traffic, flow: ControlFlow) -> Liveness:
    """Find the operations behind which nothing reads a name any more, for names that get new contents.

    Each name is followed backwards from where it is read. After `MAX_STEPS` steps, the remaining names are
    not followed: they count as read everywhere.
    """
    graph, liveness = _Graph(traffic, flow), Liveness()
    steps = 0
    for name in traffic.writes:
        live_range = _LiveRange(name, traffic, graph)
        live_range.follow()
        steps += len(live_range.at) + len(live_range.behind)
        if steps > MAX_STEPS:
            break
        live_range.add_to(liveness)
    return liveness
