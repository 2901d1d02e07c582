"""Names whose contents nothing reads any more: states leave them out, so that time grows with the lines.

A name is live at an operation if a path leads from there to an operation that reads the name, and no other
operation on this path gives the name a new content. Each name is followed backwards from where it is read.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Set
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
        self._moves = traffic.moves
        self.after: defaultdict[int, list[int]] = defaultdict(list)  # operations that may follow
        self.before: defaultdict[int, list[int]] = defaultdict(list)  # operations that may come before
        self.last_of_routine = {routine: body[-1] for routine, body in traffic.bodies.items() if body}
        begun_routines = [routine for routine in traffic.bodies if routine in flow.begins]
        self.routine_begun_at = {flow.begins[routine]: routine for routine in begun_routines}
        self.callers = _list_callers(traffic.calls)
        for body in traffic.bodies.values():
            self._add_edges(pairwise(body))
        for index, successors in flow.successors.items():
            self._add_edges((index, successor) for successor in successors)

    def _add_edges(self, edges: Iterable[tuple[int, int]]) -> None:
        """Add edges, each from an operation to another one."""
        for index, other in edges:
            self.after[index].append(other)
            self.before[other].append(index)

    def skip_moves(self, index: int) -> int:
        """Return the first operation from an index on that is no move; moves have no states of their own.

        If only moves follow up to the end of the routine, the last move is returned.
        """
        while index in self._moves and self.after[index]:
            index = self.after[index][0]
        return index


class _LiveRange:
    """Operations at which one name is live: its content there may be read later.

    In the lines `$BASE=b` (0), `n=1` (1) and `PTP P1` (2), the move reads `$BASE`: the name is live before 2
    and 1, and behind 0 and 1. It is not live before 0, which gives it a new content.
    """

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
        """Add to `liveness` where the name dies, and where it enters and leaves routines."""
        liveness.followed.add(self.name)
        for index in self._find_deaths():
            liveness.dead[index].add(self.name)
        for call in self.behind & self._traffic.calls.keys():
            liveness.returned[call].add(self.name)
        begun_at = self._graph.routine_begun_at
        for index in self.at & begun_at.keys():
            liveness.at_begin[begun_at[index]].add(self.name)
        for routine in self.exits:
            liveness.at_exit[routine].add(self.name)

    def _find_deaths(self) -> set[int]:
        """Return the operations on the way to which the name dies: states before them leave it out.

        The way leads from an operation behind which the name may have a content to one before which it is not
        live. For `$BASE=b` (0), `PTP P1` (1), `n=1` (2) and `HALT` (3), if nothing reads `$BASE` behind the
        move, this is 2. If the first operation on the way is a move, the operation behind it counts: moves
        have no states of their own.
        """
        read_by_moves = self._traffic.reads.get(self.name, set()) & self._traffic.moves
        may_have_content_behind = self.behind | self._writes | read_by_moves
        deaths = set[int]()
        for index in may_have_content_behind:
            for following in self._graph.after[index]:
                if following not in self.at:
                    deaths.add(self._graph.skip_moves(following))
        return deaths


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


def _list_callers(calls: Mapping[int, list[str]]) -> defaultdict[str, list[int]]:
    """Return the operations, by index, that call each routine; `calls` are the routines of each operation."""
    callers: defaultdict[str, list[int]] = defaultdict(list)
    for index, routines in calls.items():
        for routine in routines:
            callers[routine].append(index)
    return callers
