"""Statements of a program: their operations, the names that they declare, and the uses of names."""

from __future__ import annotations

from array import array
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple, NoReturn, TypeAlias

import numpy as np

from robotprograms import language as ir
from robotprograms.arrays import IndexArray
from robotprograms.columns import Columns, get_array_name, get_structure_name
from robotprograms.contents import Contents
from robotprograms.declarations import Changes, Declarations, Uses
from robotprograms.errors import Fault, ProgramError
from robotprograms.language import Language, Misread, Op
from robotprograms.notation import Numerals, iterate_integers
from robotprograms.places import Place, Scope
from robotprograms.program import Literal, Source

_MAX_TRANSLATIONS: Final = 10_000
"""Largest number of cached translations; statements that differ only in their numbers share one."""
_MAX_STATEMENT: Final = 16_384
"""Largest number of characters of a statement."""
Operations: TypeAlias = "list[tuple[int, Op]]"
"""Operations of a statement, each with its number of lines below the first line."""
Held: TypeAlias = "tuple[Operations, int, int]"
"""Operations of a statement that acts behind the next move, its line, and the index of its first number."""


class Repetition(NamedTuple):
    """Statement that differs from a statement before it in its numbers only."""

    line: int  # line of the statement
    first: int  # index of its first number among those of the file


_LEFT: Final = ir.Note("")
"""In place of a move of a further file, which is not corrected."""


def _leave_moves(op: Op) -> list[Op]:
    """Return what stays of an operation of a further file, whose moves are not corrected.

    A move becomes a mark that it is left, and a use of its targets, whose numbers have to stay.
    """
    if isinstance(op, ir.MoveToStored | ir.Note):
        return []
    if not isinstance(op, ir.Move):
        return [op]
    targets = (*op.targets, *op.offset_from)
    names = frozenset(target for target in targets if not isinstance(target, Literal))
    return [ir.Use(names), _LEFT] if names else [_LEFT]


class Statements:
    """Statements of a program in the intermediate language, which the reader of its language adds."""

    def __init__(
        self, sources: tuple[Source, ...], language: Language, numerals: list[Numerals], columns: Columns
    ) -> None:
        """Begin without statements.

        Args:
            sources: files of the program.
            language: language of the program.
            numerals: numbers of each file.
            columns: targets and moves, which get remarks about statements.
        """
        self.sources, self.language, self.numerals, self.columns = sources, language, numerals, columns
        self.ops: list[Op] = []
        self.places: list[Place] = []  # place of each operation
        # for each move, line and first number of each following move that differs in its numbers only
        self.repeats: dict[int, array[int]] = defaultdict(partial(array, "q"))
        self.declarations, self.uses, self.changes = Declarations(), Uses(), Changes()
        self.contents = Contents(language, numerals, self.declarations, self.changes)
        # owners of names that do not mean data of the first file, by the index of each further file
        self.owners: dict[int, dict[str, str]] = {}
        self.shared_names: frozenset[str] = frozenset()  # names of data that files declare for all programs
        # routines of other files that, as their declaration states, get all of their arguments by value
        self.by_value: frozenset[str] = frozenset()
        self.left_in_file: Counter[int] = Counter()  # moves of each further file, by its index
        self._scopes = [Scope("")]  # scopes of the routines and blocks whose end was not reached yet
        self._last_scope = Scope("")  # scope of the routine or block that ended last

    def list_repetitions(self, move: int) -> Iterator[Repetition]:
        """Yield the statements that share the move with this index, because only their numbers differ."""
        numbers = self.repeats.get(move, array("q"))
        for line, first in zip(numbers[::2], numbers[1::2], strict=True):
            yield Repetition(line, first)

    def restore_spelling(self, place: Place, name: str) -> str:
        """Return a name in the spelling of the program near a place."""
        return self.columns.restore_spelling(name, place.source, place.line)

    def refuse(self, line: int | None, reason: str, remedy: str, source: int = 0) -> NoReturn:
        """Refuse the whole program.

        Raises:
            ProgramError: always, with this fault.
        """
        raise ProgramError([Fault(self.sources[source].name, line, reason, remedy)])

    def add_statements(
        self,
        source: int,
        starts: IndexArray,
        ends: IndexArray,
        *,
        declares: str = "",
        translate: Callable[[str], list[tuple[int, Op]]] | None = None,
    ) -> None:
        """Translate statements of a file, and add their operations to the program.

        Args:
            source: index of the file.
            starts: (k,) first character of each statement.
            ends: (k,) last character + 1 of each statement.
            declares: kind of the declarations in a file of data, which hold from the beginning; else "".
            translate: function that translates the text of a statement, with NUL in place of each number;
                None takes the function of the language.

        Raises:
            ProgramError: a statement is too long, or not understood at all.
        """
        self._scopes = [Scope("", owners=self.owners.get(source, {}))]
        translate = translate or self.language.translate
        lines = np.searchsorted(self.sources[source].starts, starts, side="right")
        masked_texts, first = self.numerals[source].masked_texts(starts, ends)
        if (long := np.flatnonzero(ends - starts > _MAX_STATEMENT)).size:
            reason = f"a statement has more than {_MAX_STATEMENT} characters"
            self.refuse(int(lines[long[0]]), reason, "split the statement", source)
        translations: dict[str, Operations] = {}
        # operations of the last statement, if a repetition of this statement can differ in numbers only
        repeatable: Operations | None = None
        held: list[Held] = []  # statements that act behind the next move
        for masked, line, number in zip(
            masked_texts, iterate_integers(lines), iterate_integers(first), strict=True
        ):
            ops = translations.get(masked)
            if ops is None:
                ops = self._translate(translate, masked, line, source)
                if source and not declares:
                    ops = [(offset, each) for offset, op in ops for each in _leave_moves(op)]
                if len(translations) < _MAX_TRANSLATIONS:
                    translations[masked] = ops
            is_repetition = ops is repeatable and not held
            if is_repetition:  # long programs are mostly such moves: they share one operation
                line_offset, _ = ops[-1]
                self.repeats[len(self.ops) - 1].extend((line + line_offset, number))
                continue
            acts_later = any(isinstance(op, ir.Call) and op.behind_next for _, op in ops)
            if acts_later and not declares:
                held.append((ops, line, number))
                continue
            repeatable = self._add_with_held(ops, source, line, number, declares, held)
        self._add_held(held, source)

    def _add_with_held(
        self, ops: Operations, source: int, line: int, number: int, declares: str, held: list[Held]
    ) -> Operations | None:
        """Add a statement, with the statements in `held`, which act behind the next move.

        The held statements are added behind a move, or before any other statement that has an effect.

        Args:
            ops: operations of the statement, each with its number of lines below the first line.
            source: index of the file.
            line: first line of the statement.
            number: index of the statement's first number.
            declares: kind of the declarations in a file of data; else "".
            held: statements that act behind the next move; the list is emptied where they are added.

        Returns:
            The operations, if a repetition of the statement can differ in numbers only.
        """
        effects = [op for _, op in ops if not (isinstance(op, ir.Use) or ir.sets_feed_only(op))]
        move = effects[0] if len(effects) == 1 else None
        if not isinstance(move, ir.Move):
            if effects:
                self._add_held(held, source)
            self._add_operations(ops, source, line, number, declares)
            return None
        self._add_operations(ops, source, line, number, declares)
        if held:
            self._add_held(held, source)
            return None
        can_repeat = len(ops) == 1 or move.differs_only_in_target
        return ops if can_repeat and not declares else None

    def _translate(
        self, translate: Callable[[str], Operations], masked: str, line: int, source: int
    ) -> Operations:
        """Translate a statement.

        Raises:
            ProgramError: the statement is not understood at all.
        """
        try:
            return translate(masked)
        except Misread as fault:
            self.refuse(line, fault.reason, fault.remedy, source)

    def _add_held(self, held: list[Held], source: int) -> None:
        """Add the operations of statements that act behind the next move, and empty their list."""
        for ops, line, number in held:
            self._add_operations(ops, source, line, number, "")
        held.clear()

    def _add_operations(
        self, ops: Iterable[tuple[int, Op]], source: int, line: int, number: int, declares: str
    ) -> None:
        """Add the operations of one statement to the program, or its declarations to the initial values.

        Args:
            ops: operations, each with its number of lines below the first line.
            source: index of the file.
            line: first line of the statement.
            number: index of the statement's first number.
            declares: kind of the declarations in a file of data; else "".
        """
        for line_offset, op in ops:
            if isinstance(op, ir.Flow):
                self._enter_scope(op, self.owners.get(source, {}))
            scope = self._scopes[-1]
            place = Place(source, line + line_offset, number, self.numerals[source].values, scope)
            if op is _LEFT:
                self.left_in_file[source] += 1
            elif isinstance(op, ir.Use | ir.Note | ir.Offset | ir.Local):
                self._add_statement_about_names(place, op)
            elif isinstance(op, ir.Assign) and (declares or op.declares):
                self._declare(place, op, op.declares or declares)
            elif not declares:
                self.places.append(place)
                self.ops.append(op)

    def _add_statement_about_names(self, place: Place, op: ir.Use | ir.Note | ir.Offset | ir.Local) -> None:
        """Note uses of names, a remark, a pose at an offset from a target, or local names."""
        if isinstance(op, ir.Use):
            self._note_use(place, op)
        elif isinstance(op, ir.Note):
            self.columns.add_remark(place.at, place.make_cause(op.text).reason)
        elif isinstance(op, ir.Offset):
            self.uses.offsets.append((place, op))
        elif place.scope.routine:
            place.scope.names.update(op.names)
        else:
            self.declarations.names.update(op.names)

    def _note_use(self, place: Place, op: ir.Use) -> None:
        """Note that the numbers of names are used, or that another name gets what is calculated of them."""
        result = place.scope.routine if op.into == ir.RESULT else place.qualify(op.into)
        uses = self.uses.origins[result] if result else self.uses.used
        for name in op.names:
            uses[place.qualify(name)] = place.at

    def forget_anytime(self, names: frozenset[str], reason: str, remedy: str) -> None:
        """Make the values of names unknown anywhere in the program, for a reason."""
        if names and self.places:
            self.places.append(replace(self.places[-1], scope=Scope("")))
            self.ops.append(ir.MakeUnknown(names, reason, remedy, anytime=True))

    def _enter_scope(self, op: ir.Flow, owners: Mapping[str, str]) -> None:
        """Enter the scope of a routine or block where it begins, and leave the scope where it ends.

        `owners` are the owners of names in the file.
        """
        if op.kind in ir.ROUTINES and op.name:
            self._scopes.append(Scope(str(op.name), owners=owners))
        elif op.kind in ir.ROUTINES:  # a handler without a name shares the scope of its routine
            self._scopes.append(self._last_scope)
        elif op.kind in ir.BLOCKS:
            self._scopes.append(self._scopes[-1])
        elif op.kind in {"close", "end", "close_or_end"} and len(self._scopes) > 1:
            self._last_scope = self._scopes.pop()

    def _declare(self, place: Place, op: ir.Assign, kind: str) -> None:
        """Note the initial content of a declared name, and whether other programs may change this content."""
        name = place.qualify(op.name)
        is_shared = op.shared or kind == "shared" or get_array_name(name) in self.shared_names
        declarations, is_own = self.declarations, self.language.is_own(name)
        if is_shared:
            declarations.shared.add(name)
        if kind == "shared":
            declarations.stored.add(name)
        if op.private and not is_own:
            declarations.private.add(get_structure_name(name))
        content = self.contents.evaluate(place, name, op.value, {})
        structure, _, ending = name.partition(".")
        if ending and is_own:
            declarations.add_field(structure, (ending, content))
            return
        if op.declares == "constant":
            declarations.fixed.add(name)
        if declarations.initial.setdefault(name, content) != content:
            declarations.initial[name] = place.make_cause(f"{name} is declared twice")
        if kind == "constant" and not is_own:
            declarations.constants.add(name)
