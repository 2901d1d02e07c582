"""Control flow of a program: what is done in blocks, and where the program may go on behind each of them.

Ways that are never taken do no harm, missing ones would: a branch may be passed over, a jump not taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Generic, NamedTuple, TypeVar

from jointstiff.service.programs import language as ir
from jointstiff.service.programs.language import Misread, Op

State = TypeVar("State")
_MAX_DEPTH: Final = 100
"""Branches and loops within one another."""


@dataclass(slots=True, eq=False)
class Block(Generic[State]):
    """Block of what is done one after the other, and where the program goes on."""

    routine: str
    ops: list[int] = field(default_factory=list)  # indices of what is done
    effects: list[int] = field(default_factory=list)  # those of them that change a state
    following: list[Block[State]] = field(default_factory=list)
    called: str = ""  # routine of the program that is called behind them
    state: State | None = None  # joined from all ways that lead here


class _Nest(NamedTuple):
    """A branch or a loop that is open."""

    kind: str
    head: Block[Any]
    behind: Block[Any]
    begin: int
    outer: int  # routines that are open around it
    whole: bool = False  # whether one of its branches is always taken


class Stray(Misread):
    """Raise where a branch, a loop, a routine or a jump has no other end; `place` is the index of one end."""

    def __init__(self, place: int, reason: str, remedy: str) -> None:
        super().__init__(reason, remedy)
        self.place = place


class Ways(Generic[State]):
    """Blocks of a program."""

    def __init__(self, ops: Sequence[Op], names: Sequence[str]) -> None:
        """Divide what is done.

        Args:
            ops: what is done, in the order of the text.
            names: names of its `Flow`s, by the index; else empty.

        Raises:
            Stray: something begins or ends without the other.
        """
        self.blocks: list[Block[State]] = []
        self.entry: dict[str, Block[State]] = {}
        self.exit: dict[str, Block[State]] = {}
        self.aside: set[str] = set()  # routines that may run at any time
        self.shared: set[str] = set()  # those that other programs may call
        self._names, self._nests, self._outer = names, list[_Nest](), list[Block[State]]()
        self._labels: dict[tuple[str, str], Block[State]] = {}
        self._jumps: list[tuple[int, Block[State]]] = []
        for i, op in enumerate(ops):
            if isinstance(op, ir.Flow) and op.kind in {"routine", "aside"}:
                self._routine(i, aside=op.kind == "aside")
                self.shared |= {self._name(i)} if op.shared else set()
        self._block = self._added(self.entry, "")
        self._added(self.exit, "")
        acts = {
            "routine": self._begin, "aside": self._begin,
            "if": self._open, "loop": self._open, "repeat": self._open,
            "label": self._label, "jump": self._jump, "return": self._leave, "leave": self._leave,
        }  # fmt: skip
        for i, op in enumerate(ops):
            if isinstance(op, ir.Flow):
                acts.get(op.kind, self._end)(i, op.kind)
            else:
                self._plain(i, op)
        if self._nests:
            raise Stray(self._nests[-1].begin, "a branch or a loop has no end", "write its end")
        for block in (self._block, *self._outer):
            block.following.append(self.exit[block.routine])
        self._connect()

    def _added(self, places: dict[str, Block[State]], name: str) -> Block[State]:
        places[name] = Block(name)
        self.blocks.append(places[name])
        return places[name]

    def _routine(self, i: int, *, aside: bool) -> None:
        name = self._name(i)
        if name in self.entry:
            raise Stray(i, "a routine is defined twice", "send one program")
        self._added(self.entry, name)
        self._added(self.exit, name)
        self.aside |= {name} if aside else set()

    def _name(self, i: int) -> str:
        return self._names[i] or f"handler {i}"

    def _after(self, block: Block[State]) -> Block[State]:
        new: Block[State] = Block(block.routine)
        self.blocks.append(new)
        block.following.append(new)
        return new

    def _plain(self, i: int, op: Op) -> None:
        if isinstance(op, ir.Call) and op.name in self.entry and not op.attached:
            self._block.called = str(op.name)
            self._block = self._after(self._block)
        elif not (isinstance(op, ir.Call) and op.quiet):
            self._block.ops.append(i)
            if not isinstance(op, ir.Move | ir.Keep):
                self._block.effects.append(i)

    def _begin(self, i: int, _kind: str) -> None:
        self._outer.append(self._block)
        self._block = self.entry[self._name(i)]

    def _open(self, i: int, kind: str) -> None:
        if len(self._nests) >= _MAX_DEPTH:
            reason = f"more than {_MAX_DEPTH} branches and loops within one another"
            raise Stray(i, reason, "write routines of their own")
        head, behind = self._after(self._block), Block[State](self._block.routine)
        self.blocks.append(behind)
        self._nests.append(_Nest(kind, head, behind, i, len(self._outer)))
        self._block = self._after(head)

    def _label(self, i: int, _kind: str) -> None:
        self._block = self._labels[self._block.routine, self._names[i]] = self._after(self._block)

    def _jump(self, i: int, _kind: str) -> None:
        self._jumps.append((i, self._block))
        self._block = self._after(self._block)

    def _leave(self, _i: int, kind: str) -> None:
        """Leave the innermost loop, or begin it anew; or leave the routine."""
        inner = [each for each in self._nests if each.kind != "if" and each.outer == len(self._outer)]
        ends = (
            [inner[-1].behind, inner[-1].head]
            if inner and kind == "leave"
            else [self.exit[self._block.routine]]
        )
        self._block.following += ends
        self._block = self._after(self._block)

    def _end(self, i: int, kind: str) -> None:
        """End a branch, a loop or a routine, or begin another branch."""
        nest = self._nests[-1] if self._nests and self._nests[-1].outer == len(self._outer) else None
        if nest is None and self._outer and kind in {"end", "any"}:
            self._block.following.append(self.exit[self._block.routine])
            self._block = self._outer.pop()
        elif nest is None or kind == "end":
            raise Stray(i, "here ends what does not begin", "write both ends of branches, loops and routines")
        elif kind in {"turn", "default"}:
            self._block.following.append(nest.behind)
            self._nests[-1] = nest._replace(whole=nest.whole or kind == "default")
            self._block = self._after(nest.head)
        else:
            self._block.following += [nest.behind, nest.head] if nest.kind != "if" else [nest.behind]
            if nest.kind != "repeat" and not nest.whole:
                nest.head.following.append(nest.behind)
            self._block = self._nests.pop().behind

    def _connect(self) -> None:
        """Lead jumps to their labels; one that is computed, to all of its routine."""
        anywhere: dict[str, Block[State]] = {}
        for (routine, _), label in self._labels.items():
            anywhere.setdefault(routine, Block(routine)).following.append(label)
        self.blocks += anywhere.values()
        for i, block in self._jumps:
            place = self._labels.get((block.routine, self._names[i]), anywhere.get(block.routine))
            if place is None:
                raise Stray(i, "a jump to a label that is nowhere", "write the label")
            block.following.append(place)
