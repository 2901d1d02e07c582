"""Statements of a program: their operations, the names that they declare, and the uses of names."""

from __future__ import annotations

from array import array
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, NamedTuple, NoReturn, TypeAlias

import numpy as np

from robotprograms import language as ir
from robotprograms.arrays import IndexArray
from robotprograms.columns import Columns, get_array_name, get_structure_name
from robotprograms.contents import Contents
from robotprograms.declarations import Changes, Content, Declarations, State, Uses
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


class _Statement(NamedTuple):
    """A statement after its translation."""

    ops: Operations
    source: int  # index of the file
    line: int  # first line
    first: int  # index of its first number among those of the file
    declares: str = ""  # kind of the declarations, in a file of data; else empty

    @property
    def acts_behind_next_move(self) -> bool:
        """True if the statement calls a routine that runs only behind the move that follows."""
        return any(isinstance(op, ir.Call) and op.behind_next for _, op in self.ops)

    @property
    def single_move(self) -> ir.Move | None:
        """The move of the statement, if it does nothing else; None otherwise."""
        effects = self.effects
        only_effect = effects[0] if len(effects) == 1 else None
        return only_effect if isinstance(only_effect, ir.Move) else None

    @property
    def effects(self) -> list[Op]:
        """Operations that can change later moves: all but uses of numbers, and changes of the feed."""
        return [op for _, op in self.ops if not (isinstance(op, ir.Use) or ir.sets_feed_only(op))]

    @property
    def can_repeat(self) -> bool:
        """True if the move of the next statement, with the same text, differs in numbers only."""
        move = self.single_move
        if move is None or self.declares:
            return False
        return len(self.ops) == 1 or move.differs_only_in_target


class _StatementText(NamedTuple):
    """Text of a statement, before its translation."""

    masked_text: str  # with `ir.A_NUMBER` in place of each number
    line: int  # first line
    first: int  # index of its first number among those of the file


@dataclass(slots=True)
class _Pending:
    """Statements of a file that matter for the next statement: a move to repeat, and statements held back."""

    # operations of the last statement, if it is a move that a statement of the same text can repeat
    repeatable: Operations | None = None
    held: list[_Statement] = field(default_factory=list)  # statements that act behind the next move

    def is_repeated_by(self, ops: Operations) -> bool:
        """Return whether these operations are the last move once more; statements of one text share them."""
        return ops is self.repeatable and not self.held


class Repetition(NamedTuple):
    """Statement that differs from a statement before it in its numbers only."""

    line: int  # line of the statement
    first: int  # index of its first number among those of the file


_LEFT: Final = ir.Note("")
"""In place of a move of a further file, which is not corrected."""


def _leave_moves(op: Op) -> list[Op]:
    """Return what takes the place of an operation in a further file, whose moves are not corrected.

    Only moves and notes are replaced. A move becomes the mark `_LEFT`, which is counted, and a use of its
    named targets, whose numbers have to stay.
    """
    if isinstance(op, ir.MoveToStored | ir.Note):
        return []
    if not isinstance(op, ir.Move):
        return [op]
    targets = (*op.targets, *op.offset_from)
    names = frozenset(target for target in targets if not isinstance(target, Literal))
    return [ir.Use(names), _LEFT] if names else [_LEFT]


class _Translator:
    """Translates statements, and keeps the translations: statements with the same text share one."""

    def __init__(self, translate: Callable[[str], Operations], *, leaves_moves: bool) -> None:
        """Begin without translations.

        Args:
            translate: function that translates the text of a statement.
            leaves_moves: whether moves are replaced by marks that they are left without a correction.
        """
        self._translate, self._leaves_moves = translate, leaves_moves
        self._translations: dict[str, Operations] = {}

    def translate(self, masked_text: str) -> Operations:
        """Return the operations of a statement, the same object for the same text.

        `masked_text` is the text of the statement with `ir.A_NUMBER` in place of each number.

        Raises:
            Misread: the statement is not understood at all.
        """
        ops = self._translations.get(masked_text)
        if ops is not None:
            return ops
        ops = self._translate(masked_text)
        if self._leaves_moves:
            ops = [(line_offset, each) for line_offset, op in ops for each in _leave_moves(op)]
        if len(self._translations) < _MAX_TRANSLATIONS:
            self._translations[masked_text] = ops
        return ops


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
        is_further_program = source > 0 and not declares
        translator = _Translator(translate or self.language.translate, leaves_moves=is_further_program)
        pending = _Pending()
        for text in self._cut_statements(source, starts, ends):
            ops = self._translate(translator, text, source)
            if pending.is_repeated_by(ops):  # long programs are mostly such moves: they share one operation
                self._add_repetition(text, ops)
            else:
                self._add_statement(_Statement(ops, source, text.line, text.first, declares), pending)
        self._add_held(pending.held)

    def _cut_statements(self, source: int, starts: IndexArray, ends: IndexArray) -> Iterator[_StatementText]:
        """Yield the statements of a file, given the first and the last + 1 character (k,) of each.

        `PTP {X 10,Y 20}` on line 4 has the masked text `PTP {X ?,Y ?}`, with the sign NUL in place of each
        number, shown as ? here: statements that differ in numbers only have the same masked text. Its numbers
        stand in a table of all numbers of the file; `first` is the index of the number 10 in this table.

        Raises:
            ProgramError: a statement is too long to be translated.
        """
        lines = np.searchsorted(self.sources[source].starts, starts, side="right")
        self._refuse_long_statements(source, lines, ends - starts)
        masked_texts, first_numbers = self.numerals[source].masked_texts(starts, ends)
        columns = masked_texts, iterate_integers(lines), iterate_integers(first_numbers)
        for masked_text, line, first in zip(*columns, strict=True):
            yield _StatementText(masked_text, line, first)

    def _translate(self, translator: _Translator, text: _StatementText, source: int) -> Operations:
        """Return the operations of a statement of a file.

        Raises:
            ProgramError: the statement is not understood at all.
        """
        try:
            return translator.translate(text.masked_text)
        except Misread as fault:
            self.refuse(text.line, fault.reason, fault.remedy, source)

    def _add_repetition(self, text: _StatementText, ops: Operations) -> None:
        """Note that the last move of the program is repeated by a statement with other numbers."""
        line_offset, _ = ops[-1]
        last_operation = len(self.ops) - 1
        self.repeats[last_operation].extend((text.line + line_offset, text.first))

    def _add_statement(self, statement: _Statement, pending: _Pending) -> None:
        """Add a statement to the program, or hold it until a move follows behind which it acts.

        Args:
            statement: the next statement of the file.
            pending: what the statements before it mean for it; here changed for the statement that follows.
        """
        if statement.acts_behind_next_move and not statement.declares:
            pending.held.append(statement)
            return
        has_held = bool(pending.held)
        self._add_with_held(statement, pending.held)
        can_repeat = statement.can_repeat and not has_held
        pending.repeatable = statement.ops if can_repeat else None

    def _refuse_long_statements(self, source: int, lines: IndexArray, lengths: IndexArray) -> None:
        """Refuse a file with a statement that is too long to be translated.

        Args:
            source: index of the file.
            lines: (k,) first line of each statement.
            lengths: (k,) count of the characters of each statement.

        Raises:
            ProgramError: a statement has more than `_MAX_STATEMENT` characters.
        """
        too_long = np.flatnonzero(lengths > _MAX_STATEMENT)
        if too_long.size:
            reason = f"a statement has more than {_MAX_STATEMENT} characters"
            self.refuse(int(lines[too_long[0]]), reason, "split the statement", source)

    def _add_with_held(self, statement: _Statement, held: list[_Statement]) -> None:
        """Add a statement, and the statements in `held`, which act behind the next move.

        The held statements are added behind a move, or before any other statement that has an effect; then
        `held` is empty. They stay there if the statement has no effect.
        """
        if statement.single_move is not None:
            self._add_operations(statement)
            self._add_held(held)
            return
        if statement.effects:
            self._add_held(held)
        self._add_operations(statement)

    def _add_held(self, held: list[_Statement]) -> None:
        """Add the statements that act behind the next move to the program, and empty their list."""
        for statement in held:
            self._add_operations(statement)
        held.clear()

    def _add_operations(self, statement: _Statement) -> None:
        """Add the operations of a statement to the program, or its declarations to the initial values."""
        source = statement.source
        for line_offset, op in statement.ops:
            if isinstance(op, ir.Flow):
                self._enter_scope(op, self.owners.get(source, {}))
            values = self.numerals[source].values
            place = Place(source, statement.line + line_offset, statement.first, values, self._scopes[-1])
            self._add_operation(place, op, statement.declares)

    def _add_operation(self, place: Place, op: Op, declares: str) -> None:
        """Add an operation at a place, or note what it declares or says about names.

        `declares` is the kind of the declarations in a file of data, which has no operations that run; empty
        for other files.
        """
        if op is _LEFT:
            self.left_in_file[place.source] += 1
        elif isinstance(op, ir.Use | ir.Note | ir.Offset | ir.Local):
            self._add_statement_about_names(place, op)
        elif isinstance(op, ir.Assign) and (declares or op.declares):
            self._declare(place, op, op.declares or declares)
        elif not declares:
            self.places.append(place)
            self.ops.append(op)

    def _add_statement_about_names(self, place: Place, op: ir.Use | ir.Note | ir.Offset | ir.Local) -> None:
        """Note what a statement says about names, without an operation that runs.

        The statement uses numbers of variables, deserves a remark, assigns a pose at an offset from a target,
        or declares local variables of its routine; outside of routines, these are data of the program.
        """
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
        """Note a use of the numbers of variables for something else than the target of a move.

        What is calculated of the numbers may go to another variable, `op.into`, or be the value that the
        routine returns, whose name is that of the routine. Otherwise it is not known what becomes of them.
        """
        is_returned = op.into == ir.RESULT
        result = place.scope.routine if is_returned else place.qualify(op.into)
        used_names = {place.qualify(name): place.at for name in op.names}
        if result:
            self.uses.origins[result].update(used_names)
        else:
            self.uses.used.update(used_names)

    def forget_anytime(self, names: frozenset[str], reason: str, remedy: str) -> None:
        """Make the values of names unknown anywhere in the program, for a reason.

        A statement that does so is added at the end of the program, outside of all routines.
        """
        if names and self.places:
            self.places.append(replace(self.places[-1], scope=Scope("")))
            self.ops.append(ir.MakeUnknown(names, reason, remedy, anytime=True))

    def _enter_scope(self, op: ir.Flow, owners: Mapping[str, str]) -> None:
        """Enter the scope of a routine or block where it begins, and leave the scope where it ends.

        A scope has the local variables of a routine; a block shares the scope around it, and a handler
        without a name that of the routine that ended last.

        Args:
            op: beginning or end of a routine or block; other operations of the control flow change nothing.
            owners: owners of names in the file, for names that mean data of a single file.
        """
        if op.kind in ir.ROUTINES and op.name:
            self._scopes.append(Scope(str(op.name), owners=owners))
        elif op.kind in ir.ROUTINES:
            self._scopes.append(self._last_scope)
        elif op.kind in ir.BLOCKS:
            self._scopes.append(self._scopes[-1])
        elif op.kind in {"close", "end", "close_or_end"} and len(self._scopes) > 1:
            self._last_scope = self._scopes.pop()

    def _declare(self, place: Place, op: ir.Assign, kind: str) -> None:
        """Note the initial content of a declared name, and whether other programs may change this content.

        Args:
            place: place of the declaration.
            op: assignment of the initial value.
            kind: `variable`, `constant`, or `shared` for data that the controller stores for all programs.
        """
        name = place.qualify(op.name)
        self._note_users(name, op, kind)
        state_before_program: State = {}
        content = self.contents.evaluate(place, name, op.value, state_before_program)
        structure, _, ending = name.partition(".")
        is_field_of_position = bool(ending) and self.language.is_own(name)
        if is_field_of_position:
            self.declarations.add_field(structure, (ending, content))
            return
        self._set_initial_content(place, name, content)
        if op.declares == "constant":
            self.declarations.fixed.add(name)
        if kind == "constant" and not self.language.is_own(name):
            self.declarations.constants.add(name)

    def _note_users(self, name: str, op: ir.Assign, kind: str) -> None:
        """Note which other programs may use a declared name.

        Args:
            name: full name of the variable.
            op: its declaration.
            kind: `variable`, `constant`, or `shared` for data that the controller stores for all programs.
        """
        is_stored = kind == "shared"
        if is_stored:
            self.declarations.stored.add(name)
        if op.shared or is_stored or get_array_name(name) in self.shared_names:
            self.declarations.shared.add(name)
        if op.private and not self.language.is_own(name):
            self.declarations.private.add(get_structure_name(name))

    def _set_initial_content(self, place: Place, name: str, content: Content) -> None:
        """Note the content of a name before the program runs: unknown if the name is declared otherwise, too.

        `place` is that of the declaration.
        """
        known_content = self.declarations.initial.setdefault(name, content)
        if known_content != content:
            self.declarations.initial[name] = place.make_cause(f"{name} is declared twice")

    def list_indirectly_read_names(self) -> set[str]:
        """Return the names whose contents are looked up although no operation reads them by name.

        These are the active frames, what lasts (force control and the like), all that declarations contain,
        and targets from which poses are at an offset.
        """
        active = self.language.active
        names = {*active, *active.values(), *self.changes.lasting}
        names |= self.declarations.list_contained_names()
        for place, offset in self.uses.offsets:
            names |= {place.qualify(offset.name), place.qualify(offset.target)}
        return names
