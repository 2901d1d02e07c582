"""Contents of names: what an assignment gives, and what a name contains in a state."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from robotprograms import language as ir
from robotprograms.arrays import FloatArray
from robotprograms.columns import OF_ROUTINE, Cause, WrittenNumbers, get_array_name, get_structure_name
from robotprograms.declarations import NEVER, UNKNOWN, Changes, Content, Declarations, State
from robotprograms.errors import quote_text
from robotprograms.language import Language, Value
from robotprograms.notation import Numerals, calculate
from robotprograms.places import OTHER_FILES, Place, find_place
from robotprograms.program import At, FrameName, Literal


class Contents:
    """Contents of the names of a program."""

    def __init__(
        self, language: Language, numerals: Sequence[Numerals], declarations: Declarations, changes: Changes
    ) -> None:
        """Prepare to look up the contents of names: numbers, or the cause why the numbers are unknown.

        Args:
            language: language of the program.
            numerals: numbers of each file.
            declarations: contents before the program runs.
            changes: statements that may change contents; they may be collected later.
        """
        self._language, self._numerals = language, numerals
        self._declarations, self._changes = declarations, changes
        self.named: dict[str, FrameName] = {}  # frames that are known by name
        self._protected: dict[str, bool] = {}  # whether unknown routines leave the content of a name

    def forget_judgements(self) -> None:
        """Judge names anew, because all changes are known now."""
        self._protected.clear()

    def keeps(self, name: str) -> bool:
        """Return whether unknown routines leave the content of a name; each name is judged once."""
        if name not in self._protected:
            self._protected[name] = self._is_protected(name)
        return self._protected[name]

    def _is_protected(self, name: str) -> bool:
        """Return whether the content of a name is safe from changes by unknown routines.

        Routines of other files change names of their own, and the active frames. A table of the controller,
        or data that other programs share, are safe if no file of the program writes them.
        """
        _, is_owned, owner = name.partition(OF_ROUTINE)
        if name in self._declarations.constants or name in self._changes.lasting or name == NEVER:
            return True
        if is_owned and owner != OTHER_FILES:
            return True
        if self._language.is_own(name) and "." in name:  # frames that a position states
            return True
        if self._language.is_own(name) or get_structure_name(name) in self._declarations.private:
            return not self._changes.find(name)
        is_reached = self._language.is_reached
        if is_reached is None or is_reached(name):
            return False
        is_table = self._language.is_frame(name) or name in self._declarations.shared
        return not (is_table and self._changes.find(name))

    def evaluate(self, place: Place, name: str, value: Value, state: State) -> Content:
        """Return the content that an assignment of `value`, at a place and in a state, gives to a name."""
        if isinstance(value, Literal):
            return WrittenNumbers(name, place.source, place.line, place.first, value)
        if isinstance(value, ir.Unknown):
            return place.make_cause(value.reason, value.remedy)
        if isinstance(value, ir.Stated):
            return self._evaluate_stated(place, value, state)
        if isinstance(value, ir.Element):
            return self._evaluate_element(place, value, state)
        content: Content = place.qualify(value.name)
        if "\0" in content:
            return place.make_cause("the number of a frame is not a whole number")
        return self._follow_copy(value, content, state) if isinstance(value, ir.Copy) else content

    def _evaluate_stated(self, place: Place, value: ir.Stated, state: State) -> Content:
        """Return the name of a frame that is calculated of numbers and pi; note its pose, if it has one.

        A program may give pi itself: then its number in the state, the contents of all names, counts.
        """
        numbers = (repr(float(place.values[place.first + ordinal])) for ordinal in value.ordinals)
        expressions = [re.sub("\0", lambda _: next(numbers), text) for text in value.expressions]
        pi = place.qualify("pi")
        is_assigned = bool(self._changes.of_name.get(pi))
        other_routines = self._changes.routines_of_pi - {place.scope.routine}
        if is_assigned and other_routines:  # there, the name may mean another variable
            return place.make_cause("the program gives 'pi' in another routine")
        is_local = pi != "pi"
        if is_assigned or is_local or pi in self._declarations.initial:
            content, _ = self.look_up(state, pi)
            if not isinstance(content, WrittenNumbers):
                return place.make_cause("the program changes 'pi' while it runs")
            number = repr(self.read_number(content))
            expressions = [re.sub(r"\bpi\b", number, text) for text in expressions]
        name = f"{value.name} of line {place.line}"
        values = [calculate(text) for text in expressions]
        known_values = [number for number in values if number is not None]
        if len(known_values) == len(values):
            self.named[name] = FrameName(name, value.notation.to_pose(known_values))
        return name

    def read_number(self, content: WrittenNumbers) -> float:
        """Return the first of the numbers of a content."""
        return float(self.read_numbers(content)[0])

    def read_numbers(self, content: WrittenNumbers) -> FloatArray:
        """Return the numbers (n,) of a content, from its file."""
        numbers_of_file = self._numerals[content.source].values
        return np.asarray(numbers_of_file[content.first + np.array(content.literal.numbers)])

    def _follow_copy(self, value: ir.Copy, content: Content, state: State) -> Content:
        """Return the content of a copied name in a state, the contents of all names.

        `content` is the name. If the copy is indirect, that name only has a further name, whose content is
        returned.
        """
        for _ in range(2 if value.indirect else 1):
            if isinstance(content, str):
                content, _at = self.look_up(state, content)
        # The number that is active may be that of a frame whose numbers change.
        if value.indirect and isinstance(content, str) and self._language.is_frame(content):
            content, _at = self.look_up(state, content)
        return content

    def look_up(self, state: State, name: str) -> tuple[Content, At]:
        """Return the content of a name in a state, and where the statement is that set this content."""
        if name == UNKNOWN:  # without an unknown call, there is no cause
            return state.get(name, ("", At()))
        if name in self._changes.lasting:  # nothing lasts that may move targets, unless a statement says so
            lasting = self._changes.anytime.get(name)
            return (lasting, find_place(lasting)) if lasting else state.get(name, ("", At()))
        fixed = self._find_fixed_content(name)
        if fixed is not None:
            return fixed, find_place(fixed) if isinstance(fixed, Cause) else At()
        protected = self.keeps(name)
        # A change that may happen at any time comes first, then the state, then the value before the program.
        content: Content | None = self._changes.anytime.get(name)
        if content is None and not protected:
            content = self._changes.anytime.get(UNKNOWN)
        if content is None and name in state:
            return state[name]
        if content is None and UNKNOWN in state and not protected:
            content = state[UNKNOWN][0]
        content = content or self._initial_value(name)
        if isinstance(content, Cause) and self._language.is_frame(name):
            content = content._replace(shows=name)
        return content, find_place(content) if isinstance(content, Cause) else At()

    def _evaluate_element(self, place: Place, value: ir.Element, state: State) -> Content:
        """Return the content of an element of a table, whose number is the value of a variable in a state.

        Only a variable of the routine, or a constant, is certain: other programs may set any other one.
        """
        variable = place.qualify(value.number)
        content, _ = self.look_up(state, variable)
        if isinstance(content, Cause) and content.line:
            return content
        is_of_routine = OF_ROUTINE in variable
        is_certain = is_of_routine or variable in self._declarations.fixed
        is_number = isinstance(content, WrittenNumbers) and len(content.literal.numbers) == 1
        if not (is_certain and is_number and isinstance(content, WrittenNumbers)):
            return place.make_cause(f"the number {quote_text(value.number)} of a frame is not certain")
        number = self.read_number(content)
        if not number.is_integer():
            return place.make_cause("the number of a frame is not a whole number")
        element = value.table % f"{number:g}"
        content_of_element, _ = self.look_up(state, element)
        return content_of_element

    def _find_fixed_content(self, name: str) -> Content | None:
        """Return the content that a name has in all states: of a constant, or of an element; else None.

        Where a statement changes an array, whichever element that is, no element is known.
        """
        is_constant = get_structure_name(name) in self._language.constants
        if is_constant:
            return name
        array = get_array_name(name)
        is_element = array != name
        if is_element and array in self._changes.of_name:
            return self._initial_value(name)
        return None

    def _initial_value(self, name: str) -> Content:
        """Return the content of a name when the program begins: data have the values in their file.

        If a statement changes the name, the content is unknown: the program may run a second time.
        """
        changes = self._changes.find(name)
        active_frame = self._language.active.get(name)
        if not changes:
            if name in self._declarations.initial:
                return self._declarations.initial[name]
            structure, _, ending = name.partition(".")
            fields = self._declarations.fields.get(structure, ())
            contents = [content for ending_of_field, content in fields if ending_of_field == ending]
            if len(contents) == 1:
                return contents[0]
            if contents:
                return Cause(0, f"{name} is declared twice")
        if active_frame is not None:
            return active_frame
        if changes:
            reason = f"{name} changes while the program runs"
            return changes[0]._replace(reason=reason, remedy="give the value once, in numbers")
        if self._language.is_frame(name):
            return name
        return Cause(0, f"{quote_text(name)} is not given by constant numbers", self._language.undeclared)

    def list_name_and_fields(self, name: str) -> list[str]:
        """Return a name, and the names of all fields that a structure may have: `P`, `P.UF`, `P.UT`."""
        structure, separator, routine = name.partition(OF_ROUTINE)
        fields = [f"{structure}{ending}{separator}{routine}" for ending in self._language.field_endings]
        return [name, *fields]

    def have_equal_frames(self, name: str, first: Content, second: Content) -> bool:
        """Return whether two contents of an active frame are equal numbers, written at different places."""
        if name not in self._language.active:
            return False
        if not (isinstance(first, WrittenNumbers) and isinstance(second, WrittenNumbers)):
            return False
        if first.literal.notation != second.literal.notation:
            return False
        return bool(np.array_equal(self.read_numbers(first), self.read_numbers(second)))
