"""Control flow of a program: where it may go on, beside what stands next in its text.

Ways that are never taken do no harm, missing ones would: a branch may be passed over, a jump not taken.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import Final

from jointstiff.service.programs.language import Flow, Misread, Op

_MAX_DEPTH: Final = 100
"""Branches, loops and routines within one another."""


class Stray(Misread):
    """Raise where a branch, a loop, a routine or a jump has no other end; `place` is the index of one end."""

    def __init__(self, place: int, reason: str, remedy: str) -> None:
        super().__init__(reason, remedy)
        self.place = place


@dataclass(slots=True)
class _Nest:
    """A branch, a loop or a routine that is open."""

    kind: str
    begin: int
    turns: list[int] = field(default_factory=list)  # where its other branches begin
    leaves: list[int] = field(default_factory=list)  # where it is left, or begun anew
    whole: bool = False  # whether one of its branches is always taken


class Ways:
    """Places where a program may go on, by the indices of what is done."""

    def __init__(self, ops: list[Op], names: list[str]) -> None:
        """Find both ends of all branches, loops, routines and jumps.

        Args:
            ops: what is done, in the order of the text; ends of routines that are missing are added.
            names: names of its `Flow`s, by the index; else empty.

        Raises:
            Stray: something begins or ends without the other.
        """
        self.leads: defaultdict[int, list[int]] = defaultdict(list)  # where each leads, but to the next
        self.begins: dict[str, int] = {}  # where routines begin
        self.ends: dict[int, str] = {}  # routines by their ends
        self.routine: list[str] = []  # routine of each
        self.aside: set[str] = set()  # routines that may run at any time
        self.shared: set[str] = set()  # those that other programs may call
        self._names, self._nests, self._open = names, list[_Nest](), [""]
        self._labels: dict[str, dict[str, int]] = defaultdict(dict)  # by their routines
        self._jumps: list[int] = []
        for i, op in enumerate(ops):
            if isinstance(op, Flow):
                self._take(i, op)
            self.routine.append(self.ends.get(i, self._open[-1]))
        while self._nests:
            if self._nests[-1].kind != "routine":
                raise Stray(self._nests[-1].begin, "a branch or a loop has no end", "write its end")
            ops.append(Flow("end"))
            self._end(len(ops) - 1, "end")
            self.routine.append(self.ends[len(ops) - 1])
        self.bodies: defaultdict[str, list[int]] = defaultdict(list)  # what routines do
        for i, name in enumerate(self.routine):
            self.bodies[name].append(i)
        self._jump(names)
        if any(not names[self.begins[handler]] for handler in self.aside):
            self._fail()

    def _jump(self, names: list[str]) -> None:
        """Let jumps lead to their labels; one that is computed leads to all labels of its routine."""
        for i in self._jumps:
            labels = self._labels[self.routine[i]]
            places = [labels[names[i]]] if names[i] in labels else [*labels.values()]
            if not places:
                raise Stray(i, "a jump to a label that is nowhere", "write the label")
            self.leads[i] += places

    def _fail(self) -> None:
        """Let an error leave each routine anywhere: a handler of its caller may go on behind the call."""
        for end, name in self.ends.items():
            for i in self.bodies[name][:-1]:
                self.leads[i].append(end)

    def _take(self, i: int, op: Flow) -> None:
        if op.kind in {"routine", "aside", "if", "loop", "repeat"}:
            if len(self._nests) >= _MAX_DEPTH:
                reason = f"more than {_MAX_DEPTH} branches and loops within one another"
                raise Stray(i, reason, "write routines of their own")
            self._nests.append(
                _Nest(op.kind, i) if op.kind in {"if", "loop", "repeat"} else self._begin(i, op)
            )
        elif op.kind == "label":
            self._labels[self._open[-1]][self._names[i]] = i
        elif op.kind == "jump":
            self._jumps.append(i)
        elif op.kind in {"leave", "return"}:
            kinds = {"routine"} if op.kind == "return" else {"loop", "repeat", "routine"}
            for nest in [each for each in self._nests if each.kind in kinds][-1:]:
                nest.leaves.append(i)
        else:
            self._end(i, op.kind)

    def _begin(self, i: int, op: Flow) -> _Nest:
        name = self._names[i] or f"handler {i}"
        if name in self.begins:
            raise Stray(i, "a routine is defined twice", "send one program")
        self.begins[name] = i
        self.aside |= {name} if op.kind == "aside" else set()
        self.shared |= {name} if op.shared else set()
        self._open.append(name)
        return _Nest("routine", i)

    def _end(self, i: int, kind: str) -> None:
        """End a branch, a loop or a routine, or begin another branch."""
        nest = self._nests[-1] if self._nests else None
        if nest is None or (kind != "any" and (kind == "end") != (nest.kind == "routine")):
            raise Stray(i, "here ends what does not begin", "write both ends of branches, loops and routines")
        if kind in {"turn", "default"}:
            nest.turns.append(i)
            nest.whole |= kind == "default"
            return
        self._nests.pop()
        if nest.kind == "routine":
            self.ends[i] = self._open.pop()
        for place in (*nest.turns, *nest.leaves):
            self.leads[place].append(i)
        self.leads[nest.begin] += nest.turns
        if nest.kind in {"if", "loop"} and not nest.whole:
            self.leads[nest.begin].append(i)
        if nest.kind in {"loop", "repeat"}:
            for place in (i, *nest.leaves):
                self.leads[place].append(nest.begin)
