"""Contents of names: what an assignment gives, and what a name contains in a state."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from robotprograms import language as ir
from robotprograms.arrays import FloatArray
from robotprograms.columns import (
    OF_ROUTINE,
    Cause,
    WrittenNumbers,
    get_array_name,
    get_structure_name,
    split_full_name,
)
from robotprograms.declarations import (
    NOT_SET,
    UNKNOWN,
    UNREACHED,
    Changes,
    Content,
    Declarations,
    Entry,
    State,
)
from robotprograms.errors import quote_text
from robotprograms.language import Language, Value
from robotprograms.notation import Numerals, calculate
from robotprograms.places import OTHER_FILES, Place, has_whole_index
from robotprograms.program import FrameName, Literal


class Contents:
    """Contents of the variables of a program.

    A content is numbers in the text of the program, the name of another value, or the cause why the content
    is unknown.
    """

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
        """Judge anew which names unknown routines may change, because all changes are known only now."""
        self._protected.clear()

    def is_protected(self, name: str) -> bool:
        """Return whether unknown routines leave the content of a name; each name is judged once."""
        if name not in self._protected:
            self._protected[name] = self._judge_protection(name)
        return self._protected[name]

    def _judge_protection(self, name: str) -> bool:
        """Return whether the content of a name is safe from changes by unknown routines.

        An unknown routine is one of a file that was not sent. The first case that fits a name counts:

        1. Constants and local variables are safe: no other file can write them.
        2. Names that only this program knows are safe if no statement of it writes them: an unknown routine
           can change them only by calling a routine of the program that does.
        3. Names that other files reach in this language, such as the active frame `$BASE`, are not safe.
        4. Stored frames of the controller, such as `BASE_DATA[2]`, and data that several programs share are
           safe if no file of the program writes them.
        5. All other names are safe.
        """
        language = self._language
        if self._is_out_of_reach(name):
            return True
        is_written = bool(self._changes.find(name))
        is_of_program = language.is_own(name) or get_structure_name(name) in self._declarations.private
        if is_of_program:
            return not is_written
        if language.is_reached is None or language.is_reached(name):
            return False
        is_stored = language.is_frame(name) or name in self._declarations.shared
        return not (is_stored and is_written)

    def _is_out_of_reach(self, name: str) -> bool:
        """Return whether no routine of another file can change a name, whatever the program does.

        So it is for constants, local variables of a routine, fields of a position of the program, such as
        `P[1].UF`, and what this module itself keeps in states.
        """
        is_constant = name in self._declarations.constants
        is_own_entry = name == UNREACHED or name in self._changes.lasting
        is_of_routine = split_full_name(name).owner not in {"", OTHER_FILES}
        is_field_of_position = self._language.is_own(name) and "." in name
        return is_constant or is_own_entry or is_of_routine or is_field_of_position

    def evaluate(self, place: Place, name: str, value: Value, state: State) -> Content:
        """Return the content that a variable gets if a statement assigns a value to it.

        Args:
            place: place of the statement.
            name: full name of the variable; empty for a value that no variable gets.
            value: right side of the assignment.
            state: content of each variable before the statement.
        """
        match value:
            case Literal():
                return WrittenNumbers(name, place.source, place.line, place.first, value)
            case ir.Unknown(reason=reason, remedy=remedy):
                return place.make_cause(reason, remedy)
            case ir.Stated():
                return self._evaluate_stated(place, value, state)
            case ir.Element():
                return self._evaluate_element(place, value, state)
            case _:
                return self._evaluate_name(place, value, state)

    def _evaluate_name(self, place: Place, value: ir.Copy | ir.Named, state: State) -> Content:
        """Return the content of another variable that is copied, or the name of a value that has only a name.

        Return the cause if the name has an index that is not a whole number, such as `BASE_DATA[1.5]`.
        """
        name = place.qualify(value.name)
        if not has_whole_index(name):
            return place.make_cause("the number of a frame is not a whole number")
        if isinstance(value, ir.Copy):
            return self._follow_copy(value, name, state)
        return name

    def _evaluate_stated(self, place: Place, value: ir.Stated, state: State) -> Content:
        """Calculate a frame whose numbers are expressions of numbers and pi; return a name for the frame.

        The pose goes to `named` under this name, unless an expression has no value. Return the cause if the
        program gives the name `pi` another meaning that is not certain.

        Args:
            place: place of the statement.
            value: expressions of the frame's numbers, with a sign in place of each written number.
            state: content of each variable before the statement.
        """
        pi = self._find_pi(place, state)
        if isinstance(pi, Cause):
            return pi
        calculated = _calculate_numbers(place, value, pi)
        name = f"{value.name} of line {place.line}"
        if len(calculated) == len(value.expressions):
            self.named[name] = FrameName(name, value.notation.to_pose(calculated))
        return name

    def _find_pi(self, place: Place, state: State) -> str | Cause:
        """Return what `pi` means in an expression: `pi` itself, or a number that the program gives it.

        Return the cause if the program may change that number.
        """
        pi = place.qualify("pi")
        is_assigned = bool(self._changes.of_name.get(pi))
        other_routines = self._changes.routines_of_pi - {place.scope.routine}
        if is_assigned and other_routines:  # there, the name may mean another variable
            return place.make_cause("the program gives 'pi' in another routine")
        is_local = pi != "pi"
        is_own_variable = is_assigned or is_local or pi in self._declarations.initial
        if not is_own_variable:
            return "pi"
        content = self.look_up(state, pi).content
        if not isinstance(content, WrittenNumbers):
            return place.make_cause("the program changes 'pi' while it runs")
        return repr(self.read_number(content))

    def read_number(self, content: WrittenNumbers) -> float:
        """Return the first of the numbers of a content."""
        return float(self.read_numbers(content)[0])

    def read_numbers(self, content: WrittenNumbers) -> FloatArray:
        """Return the numbers (n,) of a content, from its file."""
        return content.read(self._numerals)

    def _follow_copy(self, copy: ir.Copy, name: str, state: State) -> Content:
        """Return the content of a variable that is copied.

        Behind `$BASE=b`, `$BASE` has the content of b. An indirect copy goes one step further: if b contains
        the name `BASE_DATA[2]`, it gives the content of `BASE_DATA[2]`.

        Args:
            copy: the copy, which says whether it is indirect.
            name: full name of the variable that is copied.
            state: content of each variable before the copy.
        """
        content = self.look_up(state, name).content
        if not copy.indirect:
            return content
        if isinstance(content, str):  # the name of the second variable
            content = self.look_up(state, content).content
        # The second variable may contain the name of a frame whose numbers are stored and may have changed.
        if isinstance(content, str) and self._language.is_frame(content):
            content = self.look_up(state, content).content
        return content

    def look_up(self, state: State, name: str) -> Entry:
        """Return the content of a name in a state, and where the statement is that set this content.

        The first of these contents counts: that of a constant; one that the name may get at any time; that
        of the state; the cause why a call may have changed all names; the content before the program runs.
        """
        if name == UNKNOWN:  # without an unknown call, there is no cause
            return state.get(name, NOT_SET)
        if name in self._changes.lasting:
            return self._look_up_lasting(state, name)
        fixed_content = self._find_fixed_content(name)
        if fixed_content is not None:
            return Entry.from_content(fixed_content)
        is_protected = self.is_protected(name)
        cause = self._find_change_at_any_time(name, is_protected=is_protected)
        if cause is None and name in state:
            return state[name]
        if cause is None and not is_protected:
            cause = state.get(UNKNOWN, NOT_SET).cause
        content = cause or self._find_initial_content(name)
        if isinstance(content, Cause) and self._language.is_frame(name):
            content = content._replace(shows=name)
        return Entry.from_content(content)

    def _look_up_lasting(self, state: State, name: str) -> Entry:
        """Return the content of a name of what may last, such as force control: a cause while it is on.

        Nothing lasts that may move targets, unless a statement says so.
        """
        cause = self._changes.anytime.get(name)
        if cause is not None:
            return Entry.from_content(cause)
        return state.get(name, NOT_SET)

    def _find_change_at_any_time(self, name: str, *, is_protected: bool) -> Cause | None:
        """Return why a name may get another content at any time, for example by an interrupt; else None.

        `is_protected` says whether routines of other files leave the name as it is.
        """
        cause = self._changes.anytime.get(name)
        if cause is None and not is_protected:
            cause = self._changes.anytime.get(UNKNOWN)
        return cause

    def _evaluate_element(self, place: Place, value: ir.Element, state: State) -> Content:
        """Return the content of an element of a table whose number is the value of a variable.

        For `BASE_DATA[n]`, if n certainly contains 3, this is the content of `BASE_DATA[3]`. Return the cause
        why the element is unknown if n is not certain, or no whole number.

        Args:
            place: place of the statement.
            value: name of the table with `%s` for the number, as `BASE_DATA[%s]`; name of the variable.
            state: content of each variable before the statement.
        """
        number = self._find_certain_number(place, value.number, state)
        if isinstance(number, Cause):
            return number
        if not number.is_integer():
            return place.make_cause("the number of a frame is not a whole number")
        element = value.table % f"{number:g}"
        return self.look_up(state, element).content

    def _find_certain_number(self, place: Place, variable: str, state: State) -> float | Cause:
        """Return the number that a variable contains, or the cause why the number is not certain.

        Only a variable of the routine, or a constant, is certain: other programs may set any other variable.
        """
        name = place.qualify(variable)
        content = self.look_up(state, name).content
        if isinstance(content, Cause) and content.line:
            return content
        is_of_routine = bool(split_full_name(name).owner)
        is_certain = is_of_routine or name in self._declarations.fixed
        if is_certain and isinstance(content, WrittenNumbers) and len(content.literal.numbers) == 1:
            return self.read_number(content)
        return place.make_cause(f"the number {quote_text(variable)} of a frame is not certain")

    def _find_fixed_content(self, name: str) -> Content | None:
        """Return the content that a name has in all states, or None if its content depends on the state.

        1. A constant of the controller, such as the frame `$NULLFRAME`, has its own name as its content.
        2. An element such as `P[2]` of an array P that some statement changes has its content before the
           program runs, or the cause that P changes: which element the statement changes is not known.
        3. The content of any other name depends on the state: None.
        """
        is_constant = get_structure_name(name) in self._language.constants
        if is_constant:
            return name
        array = get_array_name(name)
        is_element = array != name
        if is_element and array in self._changes.of_name:
            return self._find_initial_content(name)
        return None

    def _find_initial_content(self, name: str) -> Content:
        """Return the content of a name when the program begins; the first one of these counts.

        1. What a declaration gives, unless a statement changes the name: the program may run a second time.
        2. The frame that is active before the first line, for a name such as `$BASE`.
        3. The cause that a statement changes the name.
        4. The name itself, for a frame that is stored in the controller, such as `BASE_DATA[2]`.
        5. The cause that the numbers are not given.
        """
        changes = self._changes.find(name)
        declared = None if changes else self._find_declared_content(name)
        if declared is not None:
            return declared
        active_frame = self._language.active.get(name)
        if active_frame is not None:
            return active_frame
        if changes:
            reason = f"{name} changes while the program runs"
            return changes[0]._replace(reason=reason, remedy="give the value once, in numbers")
        if self._language.is_frame(name):
            return name
        return Cause(0, f"{quote_text(name)} is not given by constant numbers", self._language.undeclared)

    def _find_declared_content(self, name: str) -> Content | None:
        """Return the content that a declaration gives to a name, or to a field of a position; else None."""
        declarations = self._declarations
        if name in declarations.initial:
            return declarations.initial[name]
        structure, _, ending = name.partition(".")  # `P[1]` and `UF` of `P[1].UF`
        fields = declarations.fields.get(structure, ())
        contents = [content for ending_of_field, content in fields if ending_of_field == ending]
        if len(contents) > 1:
            return Cause(0, f"{name} is declared twice")
        return contents[0] if contents else None

    def list_name_and_fields(self, name: str) -> list[str]:
        """Return a name, and the names of all fields that a structure may have: `P`, `P.UF`, `P.UT`.

        The owner of a full name stays at the end: `P of routine main`, `P.UF of routine main`.
        """
        structure, separator, owner = name.partition(OF_ROUTINE)
        fields = [f"{structure}{ending}{separator}{owner}" for ending in self._language.field_endings]
        return [name, *fields]

    def have_equal_frames(self, name: str, first: Content, second: Content) -> bool:
        """Return whether two contents are the same numbers, though written at different places of the text.

        Numbers are compared for the active base and tool only; for any other name, the result is False.
        """
        is_active_frame = name in self._language.active
        if not is_active_frame:
            return False
        if not (isinstance(first, WrittenNumbers) and isinstance(second, WrittenNumbers)):
            return False
        if first.literal.notation != second.literal.notation:
            return False
        return bool(np.array_equal(first.read(self._numerals), second.read(self._numerals)))


def _calculate_numbers(place: Place, value: ir.Stated, pi: str) -> list[float]:
    """Return the values of expressions such as `pi/2`; one that cannot be calculated is left out.

    In `p[0.1,0,0,pi/2,0,0]`, the expression `pi/2` is kept as `pi/` and a sign, because statements that
    differ only in their numbers share one operation. Here the numbers replace the signs, in their order.

    Args:
        place: place of the statement, which has the numbers of the expressions.
        value: expressions with a sign in place of each number.
        pi: text in place of `pi`.
    """
    written_numbers = (repr(place.read_number(ordinal)) for ordinal in value.ordinals)
    calculated = list[float]()
    for expression in value.expressions:
        with_numbers = re.sub(ir.A_NUMBER, lambda _: next(written_numbers), expression)
        number = calculate(re.sub(r"\bpi\b", pi, with_numbers))
        if number is not None:
            calculated.append(number)
    return calculated
