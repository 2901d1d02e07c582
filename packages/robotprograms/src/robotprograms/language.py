"""Words of the intermediate language, and the normal form of a statement that the readers translate.

The normal form has no comments, one blank between words and none elsewhere, and NUL in place of each number:
statements that differ in their numbers only have the same normal form, which is translated once.
Possessive quantifiers follow characters only: Python before 3.11.5 keeps the match of a failed group.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import nan
from typing import Any, Final, NamedTuple, TypeAlias

from robotprograms.arrays import FloatArray
from robotprograms.errors import WRITE_NUMBERS, capitalise, decode_text, quote_text
from robotprograms.notation import Notation
from robotprograms.program import Literal, Motion, Source

_FRACTION: Final = r"(?:\.\d{0,20}+)?"
# Its first character comes before all else, so that the search passes over what begins no number.
NUMBER: Final = (
    r"[+\-.\d](?<!\w[+\-.\d])(?:"
    rf"(?<=\d)\d{{0,14}}+{_FRACTION}|(?<=[+-])(?:\d{{1,15}}+{_FRACTION}|\.\d{{1,20}}+)|(?<=\.)\d{{1,20}}+"
    r")(?:[eE][+-]?+\d{1,3}+)?"
)
A_NUMBER: Final = "\0"
"""Sign that takes the place of each number in the normal form of a statement."""
ANY_LABEL: Final = "\0"
"""Name of the label of a jump whose label is computed: no label has this name, so that each may be meant."""


class NumberedName(NamedTuple):
    """Name of a variable with a number in it, such as `P[3]`."""

    template: str  # with `%s` in place of the number
    ordinal: int  # index of the number among those of the statement


Name: TypeAlias = str | NumberedName
"""Name of a variable."""


class Copy(NamedTuple):
    """Value that is a copy of another variable's value."""

    name: Name  # name of the other variable
    # whether the other variable only has the name of a third variable, whose value is then copied: `P[1].UF`
    # of FANUC has the name `UF 3`, and the copy is the frame UF 3
    indirect: bool = False


class Element(NamedTuple):
    """Copy of an element of a table, whose number is the value of a variable."""

    table: str  # template with `%s` for the number
    number: str  # name of the variable


class Named(NamedTuple):
    """Value that is known by its name only."""

    name: Name


class Stated(NamedTuple):
    """Frame that never changes, calculated of numbers: it is known by the place of its statement."""

    name: str  # beginning of its name; the line follows
    notation: Notation
    expressions: tuple[str, ...]  # of its numbers, with NUL in place of each number
    ordinals: tuple[int, ...]  # of the numbers in these expressions


class Unknown(NamedTuple):
    """Value that is not known, for a reason."""

    reason: str
    remedy: str


class Product(NamedTuple):
    """Product of frames; each frame is given in the coordinates of the frame before it."""

    names: tuple[str, ...]  # names of the frames


Value: TypeAlias = Literal | Copy | Element | Named | Stated | Unknown


class Assign(NamedTuple):
    """Assignment of a value to a name."""

    name: Name
    value: Value
    # `variable` or `constant` if the name has the value before the program runs; else empty
    declares: str = ""
    shared: bool = False  # whether other programs certainly know the name
    private: bool = False  # whether certainly no other program knows the name


class Local(NamedTuple):
    """Declaration of names that belong to the routine only: elsewhere, these names mean other variables."""

    names: frozenset[str]


MODE: Final = "\0mode"
"""Name of a variable for all in a controller that may move targets, such as offsets or force control.

Its value is unknown behind a statement that may change it, and then no target is certain. What another
statement can end has a name of its own, which begins with this one: `begin_lasting`, `end_lasting`."""


ALL_TARGETS: Final = frozenset({MODE})
"""Names without whose values no target is certain."""


FEED: Final = "$VEL.CP"
"""Name of the active feed of the tool's centre [m/s], where the language has one; no target depends on it."""


class MakeUnknown(NamedTuple):
    """Statement that gives unknown values to names; without names, to all that other routines may change."""

    names: frozenset[Name]
    reason: str
    remedy: str
    anytime: bool = False  # whether the values may change at any time, also before this statement


class Note(NamedTuple):
    """Statement about which the user reads a remark."""

    text: str


class Call(NamedTuple):
    """Call of a routine."""

    name: Name
    passed: frozenset[str] = frozenset()  # names that the routine gets as arguments
    # whether a routine of the program may run at any time, or more than once
    anytime: bool = False
    # name of the event to which the routine is attached; an unknown routine then counts as called here
    event: Name = ""
    # whether the call changes nothing, unless the program itself defines a routine with this name
    harmless: bool = False
    # whether an unknown routine may also leave something that lasts (`MODE`)
    may_last: bool = False
    behind_next: bool = False  # whether the routine runs only behind a move that is the next statement
    # whether a function of another file is assumed to change no tool that it gets as an argument
    reads_frames: bool = False
    # with this text begin the names of the program's routines that may be meant; None if the name is fixed
    prefix: str | None = None


class Use(NamedTuple):
    """Use of the numbers of variables for something else than the target of a move."""

    names: frozenset[Name]
    # name that gets what is calculated of the numbers, or routine that gets them: the use is what becomes of
    # that name; `RESULT` for what the routine returns; empty if the use is not known
    into: Name = ""


_EVENT_OF_LOOP: Final = "\0loop"
"""Name of the event that the condition of a loop is computed again."""
RESULT: Final = "\0result"
"""Name of the value that a routine returns."""
CONDITION: Final = "\0condition"
"""Name of all conditions: what decides about branches, loops and waiting."""


class Offset(NamedTuple):
    """Assignment of a pose at an offset from a target: moves to it shift with the target's correction."""

    name: Name
    target: Name


class Feed(NamedTuple):
    """Speed of the tool's centre along a line or an arc, as a move states it."""

    value: Literal | Copy  # the number, or a name that holds it
    unit: float = 1.0  # speed of the number 1 [mm/s]
    # speed of the controller's data of that name [mm/s], unless the program has its own
    otherwise: float = nan
    time: int | None = None  # ordinal of the time of the move: unless it is zero, the speed does not count
    # names of the percentage of all feeds and of the greatest feed [mm/s] that a statement may set, for all
    # moves behind it; empty if the language has no such statement
    percentage: str = ""
    greatest: str = ""


class Move(NamedTuple):
    """Move to one target, or through one target to another; a move with a reason is not corrected."""

    motion: Motion
    targets: tuple[Literal | Name, ...]
    bases: tuple[Value | Product, ...] = ()
    tools: tuple[Value | Product, ...] = ()
    # variables of the active base and tool, which must have the frames with which the target is recorded
    matched_frames: tuple[str, ...] = ()
    reason: str = ""
    remedy: str = ""
    # names of targets near which a move that is not corrected ends: corrections of them shift this move, too
    offset_from: tuple[Name, ...] = ()
    # move that takes the place of this one if `offset_from` of that move is a target of any move
    near_target: Move | None = None
    feed: Feed | None = None  # None if the move states none, or is a move of the joints

    @property
    def differs_only_in_target(self) -> bool:
        """True if moves with the same text apart from numbers differ only in the numbers of one target.

        `LIN {X 1,...}` and `LIN {X 2,...}` do: base and tool, which are the active ones, are the same. A base
        in numbers, or one that each position states for itself (`matched_frames`), may differ.
        """
        has_one_target_in_numbers = len(self.targets) == 1 and isinstance(self.targets[0], Literal)
        has_base_in_numbers = any(isinstance(base, Literal) for base in self.bases)
        may_differ_in_frames = bool(self.matched_frames) or has_base_in_numbers
        is_corrected = not self.reason
        return has_one_target_in_numbers and is_corrected and not may_differ_in_frames


class MoveToStored(NamedTuple):
    """Move to a position that is stored in the controller, not in the program."""

    name: str


class Flow(NamedTuple):
    """Beginning or end of a branch, loop, jump or routine.

    Blocks begin with `if`, `switch` (all its branches are further ones), `loop`, `repeat` (a loop that runs
    at least once) or `forever` (a loop that only `leave`, a jump or a return ends), and end with `close`;
    further branches begin with `branch` or `default`. `leave` leaves a loop, `again` begins its next round.
    Routines begin with `routine`, with `handler` if they may run at any time, or with `undo` if nothing goes
    on behind them then, and end with `end`.
    `close_or_end` ends a block or a routine. The other kinds are `label`, `jump`, `return`, `stop`, which
    ends the whole program, and `resume`, which also ends the interrupted routines.
    """

    kind: str
    name: Name = ""
    shared: bool = False  # whether other programs may call a routine, with frames of their own
    # ordinals of first value, last value and step between which a `loop` counts; empty if one is no number
    bounds: tuple[int, ...] = ()

    def settle_bounds(self, numbers: FloatArray) -> Flow:
        """Return this loop with the kind `repeat` if its bounds show that it runs at least once.

        `FOR i FROM 1 TO 5` does, and `FOR i FROM 5 TO 1 STEP -1`; `FOR i FROM 5 TO 1` does not. Any other
        `Flow`, and a loop with bounds that are not numbers, is returned as it is.

        Args:
            numbers: (n,) numbers of the statement, to which the ordinals in `bounds` belong.
        """
        if not self.bounds:
            return self
        first, last, *stated_step = numbers[list(self.bounds)].tolist()
        step = stated_step[0] if stated_step else 1.0
        runs_up = step > 0 and first <= last
        runs_down = step < 0 and first >= last
        return self._replace(kind="repeat") if runs_up or runs_down else self


ROUTINES: Final = frozenset({"routine", "handler", "undo"})
LOOPS: Final = frozenset({"loop", "repeat", "forever"})
BLOCKS: Final = LOOPS | {"if", "switch"}
JUMPS: Final = frozenset({"leave", "again", "jump", "return", "resume", "stop"})
"""Kinds of `Flow` behind which the program does not continue on the next line."""


Op: TypeAlias = Assign | Local | MakeUnknown | Note | Call | Use | Offset | Move | MoveToStored | Flow


UNKNOWN_STATEMENT: Final = "the statement is unknown: it may move the robot, targets or frames"


class Misread(Exception):  # noqa: N818  # a statement that is not understood is no failure of the program
    """Error that a statement is not understood."""

    def __init__(self, reason: str, remedy: str = "") -> None:
        super().__init__(reason)
        self.reason, self.remedy = reason, remedy


@dataclass(frozen=True, slots=True)
class Line:
    """Statement in normal form, or a part of one, with the numbers in it.

    The text has NUL in place of each number. A number is known by its ordinal: its index among all numbers of
    the statement as it is written.
    """

    language: Language
    text: str  # normal form, with NUL in place of each number
    ordinals: tuple[int, ...]  # of the numbers in the text
    line_offset: int = 0  # count of line breaks in the text before the statement
    match: re.Match[str] | None = None  # with the pattern of a rule; None before a rule is applied

    def __getitem__(self, group: str) -> str:
        """Return the text that matched a named group of the rule.

        It is empty if the group did not match, if the rule has no such group, or before a rule is applied.
        """
        if self.match is None:
            return ""
        return self.match.groupdict().get(group) or ""

    def part(self, group: str) -> Line:
        """Return the part that matched a named group of the rule; empty if the group did not match."""
        begin, end = self.match.span(group) if self.match else (0, 0)
        return self.cut(begin, end)

    def cut(self, begin: int, end: int | None = None) -> Line:
        """Return the part between two indices of the text, with the ordinals of the numbers in this part.

        With NUL written as #, the part of `X #,Y #` with the ordinals (4, 5) from index 4 on is `Y #`, with
        the ordinal 5.
        """
        end = len(self.text) if end is None else end
        numbers_before = self.text.count(A_NUMBER, 0, begin)
        count = self.text.count(A_NUMBER, begin, end)
        ordinals = self.ordinals[numbers_before : numbers_before + count]
        return Line(self.language, self.text[begin:end], ordinals)

    def substitute(self, begin: int, end: int, text: str) -> Line:
        """Return the line with a text, which has no numbers, in place of the part between two indices."""
        before, behind = self.cut(0, begin), self.cut(end)
        return Line(self.language, before.text + text + behind.text, before.ordinals + behind.ordinals)

    def split(self, separator: str = ",") -> list[Line]:
        """Return the parts between separators that are neither in brackets nor in quotations."""
        return [self.cut(begin, end) for begin, end in split_outside_brackets(self.text, separator)]

    @property
    def is_number(self) -> bool:
        """True if the text is a single number."""
        return self.text.strip() == A_NUMBER

    def fill_name(self, template: str, group: str = "") -> NumberedName:
        """Return the name for a template, with the first number in a named group, or else in the line.

        In `LIN P[3]`, the template `P[%s]` gives the name P[3]. It has the ordinal of the 3, not the 3,
        because statements that differ in their numbers only share the name.
        """
        part = self.part(group) if group else self
        return NumberedName(template, part.ordinals[0])

    def read_expression(self, text: str | None = None) -> list[Op]:
        """Return the operations of an expression: one for all names read, one for each routine call.

        The expression is the whole line if no text is given.

        Raises:
            Misread: the text is not an expression.
        """
        return self.language.read_expression(self.text if text is None else text)

    def quote(self) -> str:
        """Return the text in quotation marks for a message; the interpreter inserts its numbers."""
        return quote_statement(self.text, self.ordinals)


Rule: TypeAlias = "str | Callable[[Line], list[Op]]"
"""Effect of a statement apart from its expressions: the kind of a `Flow`, or a function of the `Line` that
returns the operations."""


class _Words(NamedTuple):
    """Patterns of words of a language that are no variables."""

    operators: re.Pattern[str]  # words between operands, such as AND
    reserved: re.Pattern[str]  # words that begin statements
    functions: re.Pattern[str]  # the controller's functions, which return a value and change nothing


@dataclass(frozen=True)
class Language:
    """Tokens of a language, its statements by their forms, and facts of its controller."""

    comment: str  # pattern of a comment
    # forms of statements in normal form: groups with names are for the rule, others are expressions;
    # `@{name}` is a word of that name that is not reserved, `#{name}` a number
    rules: tuple[tuple[str, Rule], ...] = ()
    motion: str = r"(?!)"  # pattern of the words of moves
    remedy: str = WRITE_NUMBERS  # what to do where a target is not understood
    undeclared: str = WRITE_NUMBERS  # what to do where no file gives a value to a name
    text: str = r'"[^"\r\n]*+"'  # pattern of texts and of constants that are no number
    word: str = r"[^\W\d]\w*+"
    number: str = NUMBER
    blank: str = ""  # pattern of text that counts as a blank, such as the end of a line that is continued
    ignores_case: bool = True  # whether capitals and small letters are the same: the normal form has capitals
    operators: str = ""  # pattern of words between or before operands
    reserved: str = r"(?!)"  # pattern of words that begin statements: none of them is a variable
    functions: str = ""  # pattern of the controller's functions, which return a value and change nothing
    writers: str = r"(?!)"  # pattern of the controller's functions that write to the last of their arguments
    # pattern of names of functions of other files that are assumed to change no tool they get as an argument
    readers: str = r"(?!)"
    # whether a name means another variable in each routine that assigns to it, unless it is global
    scopes_by_routine: bool = False
    # names of the variables of the active frames, and the names of these frames in messages
    active: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, FloatArray] = field(default_factory=dict)  # frames that no program changes
    # function that tells whether a name is that of a frame whose numbers are stored outside of the program
    is_frame: Callable[[str], bool] = lambda _: False
    # function that tells whether routines of other files may change a name of the controller's active data;
    # None if they may change all names
    is_reached: Callable[[str], bool] | None = None
    # function that tells whether a name is of this program alone, so that no other program changes it
    is_own: Callable[[str], bool] = lambda _: False
    # pattern in statements that are not understood: such a statement may change what lasts (`MODE`)
    lasting: str = r"(?!)"
    # pattern in statements that are not understood: behind such a statement all values are unknown; any other
    # assignment changes only names that it states, and may call only routines that it states
    forgets: str = ""
    # whether a routine is called by its name alone, and a statement that is not understood may be several, on
    # lines whose ends are missing
    calls_by_name: bool = False
    # endings such as `.BASE`, with which the name of a structure becomes the name of one of its fields
    field_endings: tuple[str, ...] = ()
    callable_from_outside: bool = False  # whether other programs may call each of the routines
    positions: str = ""  # name of the array of the program's positions, if there is one
    # pattern of the text before the first number of a target in numbers; empty if no move can state numbers
    opening: str = ""
    end_of_statement: str = ""  # sign at the end of each statement; empty if statements end with their line
    fixed_words: frozenset[str] = frozenset()  # constants and functions that no program may redefine
    longest_line: int = 4096  # characters of a line that the controller reads
    suffixes: str = ""  # suffixes of the names of its files, separated by blanks
    pose: Notation | None = None  # notation in which users write frames; None for the notation of the program
    remark: str = "#"  # begin of a remark
    # pattern of the beginning of the line behind which the mark of a compensated program is inserted; empty
    # if the mark is inserted before the first line
    head: str = ""
    # function that adds the statements of the files; None if each line is a statement
    read: Callable[[Any, tuple[Source, ...]], None] | None = None

    @cached_property
    def numbers(self) -> re.Pattern[str]:
        """Pattern of numbers, also of those in comments and texts."""
        return re.compile(self.number)

    @cached_property
    def _token(self) -> re.Pattern[str]:
        """Pattern of one token: a blank, a comment, a text, a word or a sign."""
        return re.compile(
            rf"(?P<blank>\s++)|(?P<comment>{self.comment}|{_MARK})|(?P<text>{self.text})"
            rf"|(?P<word>\0|{self.word})|(?P<sign>.)",
            re.DOTALL,
        )

    @cached_property
    def _rules(self) -> tuple[tuple[re.Pattern[str], Rule], ...]:
        r"""Compiled patterns of the statements, each with the rule that translates such a statement.

        A pattern in `rules`, such as `GOTO @{name}`, has placeholders that become groups of a regular
        expression: `@{name}` matches a name, which must not be a word such as IF that begins statements;
        `#{number}` matches NUL, the sign of a number in the normal form.
        """
        variable = rf"(?!(?:{self.reserved})(?![\w$])){self.word}"
        pattern_of_sign = {"@": variable, "#": r"\0"}

        def make_group(placeholder: re.Match[str]) -> str:
            pattern = pattern_of_sign[placeholder["sign"]]
            return f"(?P<{placeholder['group']}>{pattern})"

        compiled = list[tuple[re.Pattern[str], Rule]]()
        for pattern, rule in self.rules:
            compiled.append((re.compile(_PLACEHOLDER.sub(make_group, pattern)), rule))
        return tuple(compiled)

    @cached_property
    def _motion(self) -> re.Pattern[str]:
        """Pattern of the words of moves."""
        return re.compile(self.motion, re.IGNORECASE if self.ignores_case else 0)

    @cached_property
    def _words(self) -> _Words:
        """Patterns of words that are no variables."""
        flags = re.IGNORECASE if self.ignores_case else 0
        return _Words(
            operators=re.compile(rf" ?(?<![\w$.])(?:{self.operators})\b ?", flags),
            reserved=re.compile(rf"(?<![\w$.])(?:{self.reserved})(?![\w$])", flags),
            functions=re.compile(self.functions, flags),
        )

    def normalise(self, masked: str) -> Line:
        """Return the normal form of a statement: without comments, and with single blanks between words only.

        With NUL written as #, `LIN  {X #, Y #}  ; to p#` becomes `LIN{X #,Y #}` with the numbers 0 and 1 of
        the statement. Numbers in comments and quotations count among those of the statement, but are no part
        of the normal form.

        Args:
            masked: text of the statement with NUL in place of each number.
        """
        form = _NormalForm()
        for token in self._token.finditer(masked):
            form.add(token.lastgroup, token[0])
        text = "".join(form.pieces)
        if self.ignores_case:
            text = capitalise(text)
        if self.blank:  # text that counts as a blank, such as the end of a line that is continued
            text = re.sub(self.blank, " ", text).strip()
        return Line(self, text, tuple(form.ordinals), form.line_offset)

    def blank_comments(self, text: str) -> str:
        """Return a text with blanks in place of comments and quotations; line breaks remain."""

        def blank(token: re.Match[str]) -> str:
            is_blanked = token.lastgroup in {"comment", "text"}
            return _NO_LINE_BREAK.sub(" ", token[0]) if is_blanked else token[0]

        return self._token.sub(blank, text)

    def translate(self, masked: str) -> list[tuple[int, Op]]:
        """Translate a statement into operations, each with its number of lines below the first line.

        After a statement that is not understood, the values that it may change are unknown.

        Args:
            masked: the statement with NUL in place of each number.

        Raises:
            Misread: braces are nested too deep.
        """
        line = self.normalise(masked)
        _refuse_deep_braces(line.text)
        if not line.text:  # a comment, or an empty line
            return []
        try:
            ops = self.apply_rules(line)
        except Misread as error:
            return self._translate_misread(masked, line, self._complete_fault(line, error))
        if self._overlooks_move(line, ops):
            fault = self._complete_fault(line, Misread("a move is in a place where no move is expected"))
            return self._translate_unknown(masked, line, fault)
        return [(line.line_offset, op) for op in ops]

    def _complete_fault(self, line: Line, fault: Misread) -> Misread:
        """Return a fault with the statement in its reason; if it has no remedy, with that of the language."""
        return Misread(f"{line.quote()}: {fault.reason}", fault.remedy or self.remedy)

    def _overlooks_move(self, line: Line, ops: list[Op]) -> bool:
        """Return whether a statement has more words of motions, such as LIN, than moves in its operations.

        Such a statement was not understood, although a rule fits: no move of the robot may be overlooked.
        """
        count_of_moves = sum(isinstance(op, Move | MoveToStored) for op in ops)
        words_of_motions = self._motion.findall(_QUOTED.sub("", line.text))
        return len(words_of_motions) > count_of_moves

    def _translate_misread(self, masked: str, line: Line, fault: Misread) -> list[tuple[int, Op]]:
        """Translate a statement that no rule understands: as statements on its lines, or as an unknown one.

        Args:
            masked: the statement with NUL in place of each number.
            line: its normal form.
            fault: why it is not understood, with the statement in its reason.
        """
        may_be_several = self.calls_by_name and len(masked.splitlines()) > 1
        ops = self._translate_lines(masked, fault) if may_be_several else []
        return ops or self._translate_unknown(masked, line, fault)

    def apply_rules(self, line: Line) -> list[Op]:
        """Translate a statement by the first rule whose pattern fits the whole statement.

        In the pattern `FOR @{name}=(?P<first>.+) TO (?P<last>.+)`, the groups have names, and the rule reads
        them. In `WHILE ?(.+)`, the group has no name: it is an expression, whose names are read here.

        Raises:
            Misread: no rule fits the statement, or a part of it is not understood.
        """
        for pattern, rule in self._rules:
            match = pattern.fullmatch(line.text)
            if match is None:
                continue
            uses = self._read_unnamed_groups(match)
            matched = replace(line, match=match)
            if isinstance(rule, str):  # the kind of a `Flow`
                return self._apply_flow_rule(matched, rule, uses)
            return [*uses, *rule(matched)]
        raise Misread(UNKNOWN_STATEMENT)

    def _read_unnamed_groups(self, match: re.Match[str]) -> list[Op]:
        """Return the operations of the expressions in a statement: the groups of its pattern without a name.

        Raises:
            Misread: a group is not an expression.
        """
        indices_of_named_groups = set(match.re.groupindex.values())
        uses = list[Op]()
        for index, text in enumerate(match.groups(), 1):
            if text and index not in indices_of_named_groups:
                uses += self.read_expression(text)
        return uses

    def _apply_flow_rule(self, line: Line, kind: str, uses: list[Op]) -> list[Op]:
        """Return the operations of a statement that begins or ends a branch, loop, jump or routine.

        The uses of its expressions come first. `RETURN a` uses a for the result, `WHILE a<5` for a condition.
        Functions in the condition of a loop run in each round; those of a further branch, such as ELSEIF, may
        not run at all. So their calls are marked.

        Args:
            line: the statement, such as `WHILE A<5` or `GOTO again`.
            kind: kind of the `Flow`, such as `loop` or `jump`; empty for a statement that only uses names.
            uses: operations of the expressions in the statement.
        """
        if kind == "loop":
            uses = mark_anytime(uses, _EVENT_OF_LOOP)
        elif kind == "branch":
            uses = mark_anytime(uses)
        purpose = RESULT if kind == "return" else CONDITION
        uses = pass_uses(uses, purpose)
        if not kind:
            return uses
        is_numbered_label = line["name"] == A_NUMBER  # as in `LBL[3]`: the name is the number itself
        name = line.fill_name("%s", "name") if is_numbered_label else line["name"]
        return [*uses, Flow(kind, name)]

    def _translate_lines(self, masked: str, fault: Misread) -> list[tuple[int, Op]]:
        """Translate a text that is not understood as one statement, as several statements on lines.

        In RAPID, `MoveL p1,v100,z10,tool1` without its semicolon and the line below it are one text. Moves in
        such a text are not corrected.

        Args:
            masked: the text with NUL in place of each number.
            fault: why the whole is not understood, for the moves in it.

        Returns:
            Operations, each with its number of lines below the first line; empty if one of the lines is no
            statement.
        """
        ops = list[tuple[int, Op]]()
        for line_offset, line in enumerate(self._normalise_lines(masked)):
            try:
                ops_of_line = self.apply_rules(line) if line.text else []
            except Misread:
                return []
            for op in ops_of_line:
                kept = _make_uncorrected(op, fault) if isinstance(op, Move) else op
                ops.append((line_offset, kept))
        return ops

    def _normalise_lines(self, masked: str) -> Iterator[Line]:
        """Yield the normal form of each line of a text, with numbers counted from the beginning of the text.

        Args:
            masked: the text with NUL in place of each number.
        """
        passed_numbers = 0  # count of the numbers in the lines before
        for text in masked.splitlines(keepends=True):
            line = self.normalise(text)
            yield replace(line, ordinals=tuple(passed_numbers + ordinal for ordinal in line.ordinals))
            passed_numbers += text.count(A_NUMBER)

    def _translate_unknown(self, masked: str, line: Line, fault: Misread) -> list[tuple[int, Op]]:
        """Translate a statement that is not understood, and may therefore change values.

        Each word of a motion in the statement becomes a move that is not corrected. Each operation has its
        number of lines below the first line of the statement's text.

        Args:
            masked: the statement with NUL in place of each number.
            line: its normal form.
            fault: why it is not understood, with the statement in its reason.
        """
        ops = list[tuple[int, Op]]()
        for op in self._forget_changed_values(line, fault):
            ops.append((line.line_offset, op))
        uncorrected_move = Move(Motion.LINEAR, (), reason=fault.reason, remedy=fault.remedy)
        for line_offset in self._find_lines_of_motions(masked):
            ops.append((line_offset, uncorrected_move))
        return ops

    def _forget_changed_values(self, line: Line, fault: Misread) -> list[Op]:
        """Return the operations for a statement that is not understood: what it may change is unknown.

        Patterns of the language, `forgets` and `lasting`, decide by the words in the statement:

        * the names in it are unknown in any case, because their values change while the program runs;
        * all values are unknown behind a word of `forgets`, such as BASE, or IF, whose branch is not known;
        * no target is certain behind a word of `lasting`, because offsets or force control may be active.

        Nor is a target certain behind a statement with a word, such as `HALLO`, that is neither a move, nor
        an assignment, nor the call of a routine: nothing in the statement says what it changes. Then come the
        calls of routines, and a remark on what is left. Where all values are unknown, both are omitted: they
        would add nothing. But RAPID, which calls by a name alone, has them always.
        """
        plain = _QUOTED.sub("_", line.text)
        calls = list(self._find_calls(plain))
        is_move = self._motion.search(plain) is not None
        is_assignment = _ASSIGNED.match(plain) is not None
        has_word = _NAME.search(_QUOTED.sub("", line.text)) is not None  # without one, it commands nothing
        is_unknown_command = has_word and not (is_move or is_assignment or calls_routine(calls))
        may_change_all = re.search(self.forgets, plain) is not None
        may_move_targets = is_unknown_command or re.search(self.lasting, line.text) is not None
        ops = list[Op]()
        if may_change_all:
            all_names = frozenset[Name]()  # without names, `MakeUnknown` makes all values unknown
            ops.append(MakeUnknown(all_names, fault.reason, fault.remedy))
        ops.append(self._forget_names_in(line, plain, fault))
        if may_move_targets:
            ops.append(make_targets_uncertain(fault.reason, fault.remedy))
        if may_change_all and not self.calls_by_name:
            return ops
        remark = [] if is_move or may_move_targets else [_note_assumption(fault)]
        return [*ops, *calls, *remark]

    def _forget_names_in(self, line: Line, plain: str, fault: Misread) -> MakeUnknown:
        """Return the operation that makes the values of the names in a statement unknown.

        `plain` is its normal form without quotations, and `fault` is why the statement is not understood.
        """
        no_variable = "_"  # keeps the names from being empty, which would mean all names
        names = frozenset([*self._find_changed_names(line, plain), no_variable])
        return MakeUnknown(names, fault.reason, fault.remedy)

    def _find_changed_names(self, line: Line, text: str) -> set[Name]:
        """Return the names that a statement may change; `text` is its normal form without quotations.

        Of the array of the program's positions, such as P of FANUC, only the elements that the statement has
        may change: P[3] for `P[3].X=R[1]`, or all of them, under the name P, for the computed `P[R[1]]`.
        """
        names: set[Name] = set(_NAME.findall(text))
        if not self.positions:
            return names
        names.discard(self.positions)
        for element in re.finditer(rf"(?<![\w$]){self.positions}\[(\0\])?", line.text):
            part = line.cut(*element.span())
            has_number = bool(part.ordinals)
            names.add(part.fill_name(f"{self.positions}[%s]") if has_number else self.positions)
        return names

    def _find_lines_of_motions(self, masked: str) -> Iterator[int]:
        """Yield for each word of a motion in a statement its number of lines below the first line.

        For a text of two lines, `x := 1` and `MoveL p1`, this is 1. Words in comments and quotations mean
        nothing.
        """
        plain = self.blank_comments(masked)
        line_offset, place = 0, 0
        for word in self._motion.finditer(plain):
            line_offset += len(_LINE_END.findall(plain, place, word.start()))
            place = word.start()
            yield line_offset

    def _find_calls(self, text: str) -> Iterator[Op]:
        """Yield the operations of the calls in a statement that is not understood, which is the text.

        A function of the controller, such as ABS, is harmless. Any other routine gets all other names of the
        statement, which it may change. It may be skipped; or it may run at any time, because the statement
        may attach it to an event, such as an interrupt.
        """
        names = frozenset(_NAME.findall(text))
        called_names = dict.fromkeys(called[1] for called in _CALLED.finditer(text))
        for name in called_names:
            is_move = self._motion.fullmatch(name) is not None
            is_harmless = self._words.functions.fullmatch(name) is not None
            if is_move:
                continue
            if is_harmless:
                call = Call(name, event=name, harmless=True)
            else:
                call = Call(name, names - {name}, anytime=True, event=name)
            yield from make_skippable([call])

    def read_expression(self, text: str) -> list[Op]:
        """Translate an expression: one operation for all names that it reads, one for each routine call.

        For `a+f(b)`, these are the use of a, f and b, and the call of f with a and b. Operands and operators
        have to alternate, so that no unknown statement passes for an expression.

        Raises:
            Misread: the text is not an expression.
        """
        words = self._words
        without_quotations = _QUOTED.sub('""', text)
        plain = words.operators.sub("+", without_quotations)  # a sign in place of words such as AND
        is_statement = words.reserved.search(plain) is not None  # it has a word such as GOTO
        if is_statement or _NO_EXPRESSION.search(plain) or not _is_balanced(plain):
            raise Misread("this text is not understood, or is not complete")
        names = frozenset(_NAME.findall(plain))
        ops: list[Op] = [Use(names)] if names else []
        called_names = dict.fromkeys(called[1] for called in _CALLED.finditer(plain))
        for name in called_names:
            ops += self._call_function(plain, name, names - {name})
        return ops

    def _call_function(self, expression: str, name: str, others: frozenset[str]) -> list[Op]:
        """Return the operations of the call of a function in an expression.

        * `f(a)` alone is one call. In `f(a)+g(b)`, each call may be skipped, as behind OR, and the order is
          not known.
        * A function of the controller that writes, such as `StrToVal("1",a)`, writes its last argument only.
          A routine of the program with this name may write others: a second call counts for it.

        Args:
            expression: the expression.
            name: name of the function.
            others: the other names in the expression, which the function may get as arguments.
        """
        ops = list[Op]()
        passed = others
        if re.fullmatch(self.writers, name):
            ops.append(call_if_defined(name, others))
            passed = others & frozenset(_NAME.findall(_find_last_argument(expression, name)))
        call = self._make_call(name, passed)
        is_whole_expression = expression.startswith(f"{name}(") and expression.count("(") == 1
        if call.harmless or is_whole_expression:
            return [*ops, call]
        return [*ops, *make_skippable([call])]

    def _make_call(self, name: str, passed: frozenset[str]) -> Call:
        """Return the call of a function, to which names are passed, with what is known of the function.

        The controller's own functions, such as ABS, are harmless. Functions of other files with names such as
        `ComparePoints` in RAPID are assumed to change no tool that they get.
        """
        is_harmless = self._words.functions.fullmatch(name) is not None
        reads_frames = re.fullmatch(self.readers, name) is not None
        return Call(name, passed, harmless=is_harmless, reads_frames=reads_frames)


class _NormalForm:
    """Normal form of a statement while its tokens are added: words, signs, texts, blanks and comments."""

    def __init__(self) -> None:
        """Begin without tokens."""
        self.pieces: list[str] = []  # text of the normal form, with NUL in place of each number
        self.ordinals: list[int] = []  # of the numbers in it: indices among all numbers of the statement
        self.line_offset = 0  # count of the line breaks before the statement
        self._passed_numbers = 0  # count of the numbers in the tokens so far
        self._is_after_word = False  # whether the last piece is a word, a number or a text

    def add(self, kind: str | None, token: str) -> None:
        """Add a token of the statement to its normal form.

        Blanks and comments are left out. Their line breaks are counted before the first word, and their
        numbers are counted, because an ordinal counts all numbers of the statement as it is written.

        Args:
            kind: `word` (a number is one, too), `sign`, `text` (a quotation), `blank` or `comment`.
            token: text of the token.
        """
        if kind not in {"blank", "comment"}:
            self._add_piece(kind, token)
        elif not self.pieces:  # before the statement; CR and LF together are one line break
            self.line_offset += token.count("\n") or token.count("\r")
        self._passed_numbers += token.count(A_NUMBER)

    def _add_piece(self, kind: str | None, token: str) -> None:
        """Add a word, a number, a sign or a quotation.

        One blank goes between two words, as in `GOTO again`. In a quotation, such as `"part 3"`, the number
        is not one of the statement, and becomes 0: quotations that differ in numbers only are the same.
        """
        if token == A_NUMBER:
            self.ordinals.append(self._passed_numbers)
        is_word = kind != "sign"
        if self._is_after_word and is_word:
            self.pieces.append(" ")
        is_quotation = kind == "text"
        self.pieces.append(token.replace(A_NUMBER, "0") if is_quotation else token)
        self._is_after_word = is_word


def _refuse_deep_braces(text: str) -> None:
    """Refuse a statement with braces in braces in braces ..., such as `{{{{X 1}}}}`, which has a depth of 4.

    Raises:
        Misread: braces are nested too deep.
    """
    depth, greatest_depth = 0, 0
    for brace in re.findall(r"[{}]", text):
        depth += 1 if brace == "{" else -1
        greatest_depth = max(greatest_depth, depth)
    if greatest_depth > _MAX_DEPTH:
        reason = f"braces are nested more than {_MAX_DEPTH} deep"
        raise Misread(reason, "declare inner structures on their own")


def _note_assumption(fault: Misread) -> Note:
    """Return the remark on a statement that is not understood, and neither moves the robot nor targets."""
    assumption = "it is assumed that the statement changes only the values that it names"
    return Note(f"{fault.reason}; {assumption}")


def _make_uncorrected(move: Move, fault: Misread) -> Move:
    """Return a move like another one that is not corrected because of a fault.

    Its base and tool are those of the other move's first target. The targets that the other move names, such
    as p1, go to `offset_from`: the correction of p1 shifts this move, too. Targets in numbers are omitted,
    because their numbers stay.
    """
    named_targets = tuple(target for target in move.targets if not isinstance(target, Literal))
    return Move(
        move.motion,
        targets=(),
        bases=move.bases[:1],
        tools=move.tools[:1],
        reason=fault.reason,
        remedy=fault.remedy,
        offset_from=move.offset_from + named_targets,
    )


def quote_statement(text: str, ordinals: Iterable[int]) -> str:
    """Return a statement in quotation marks for a message, with places for its numbers.

    Statements that differ in their numbers only share this text: the interpreter fills in the numbers. With
    NUL written as #, `X #,Y #` and the ordinals 0 and 1 give `'X #0#,Y #1#'`: each place is the ordinal of
    its number between two NULs. A statement that is cut, because it is long, has its first numbers only.
    """
    # `quote_text` would escape NUL: a mark takes its place until the statement is quoted.
    mark = "@#@"
    quoted = quote_text(text.replace(A_NUMBER, mark))
    places = (f"\0{ordinal}\0" for ordinal in ordinals)
    return re.sub(mark, lambda _: next(places, ""), quoted)


def calls_routine(ops: list[Op]) -> bool:
    """Return whether operations call a routine that is not a function of the controller."""
    return any(isinstance(op, Call) and not op.harmless for op in ops)


def call_if_defined(name: Name, passed: frozenset[str] = frozenset()) -> Call:
    """Return the call of a routine that counts only if the program itself defines a routine of this name.

    Such a routine takes the place of the controller's function or instruction with the same name, which
    changes nothing. `passed` are the names in its arguments.
    """
    return Call(name, passed, harmless=True)


def make_skippable(ops: Iterable[Op]) -> list[Op]:
    """Return the operations as a branch, which the program may run or skip, as between IF and ENDIF."""
    return [Flow("if"), *ops, Flow("close")]


def pass_uses(ops: list[Op], into: Name) -> list[Op]:
    """Return the operations with each use marked: what is calculated of the numbers goes into a name.

    In `a := p1.trans.x + 5;`, the use of p1 goes into a. It matters only if a is used itself.
    """
    return [op._replace(into=into) if isinstance(op, Use) else op for op in ops]


def omit_uses(ops: list[Op]) -> list[Op]:
    """Return the operations without uses: the expression is shown or sent, as in `TPWrite text1;`.

    Such a use does not matter for the program, so that the numbers may be corrected.
    """
    return [op for op in ops if not isinstance(op, Use)]


def mark_anytime(ops: list[Op], event: Name = "") -> list[Op]:
    """Return the operations with each call marked: its routine may run at any time, or more than once.

    The routine of an interrupt is such a one, and so is a function in the condition of a loop. With the name
    of an event, an unknown routine counts as called at the statement.
    """
    return [op._replace(anytime=True, event=event) if isinstance(op, Call) else op for op in ops]


def sets_feed_only(op: Op) -> bool:
    """Return whether an operation changes nothing but the active feed, on which no target depends.

    Such are the assignment of `$VEL.CP=0.2`, and a `MakeUnknown` of feeds alone. A `MakeUnknown` without
    names makes all values unknown, and so is none of them.
    """
    if isinstance(op, Assign):
        return str(op.name).startswith(FEED)
    if isinstance(op, MakeUnknown) and op.names:
        return all(str(name).startswith(FEED) for name in op.names)
    return False


def make_targets_uncertain(reason: str, remedy: str) -> MakeUnknown:
    """Return the operation behind which no target is certain: offsets or force control may be active."""
    return MakeUnknown(ALL_TARGETS, reason, remedy)


def begin_lasting(kind: str, reason: str, remedy: str) -> MakeUnknown:
    """Return the operation of a statement behind which the controller moves all targets, for a time.

    `PDispOn p1,tool1;` of RAPID shifts the targets of the moves behind it until `PDispOff;`. Such a shift
    counts as a variable of the controller with a name of its own. Its value is unknown from here on; while it
    is, no move is corrected. `end_lasting` makes it known.

    Args:
        kind: what moves the targets, such as PDISP (a shift) or FC (force control): each has its own end.
        reason: why moves behind the statement are not corrected.
        remedy: what the user can do.
    """
    variable = f"{MODE} {kind}"
    return MakeUnknown(frozenset({variable}), reason, remedy)


def end_lasting(kind: str) -> Assign:
    """Return the operation of a statement, such as `PDispOff;`, that ends what `begin_lasting` has begun.

    What moves the targets in another way, of another `kind`, goes on.
    """
    variable, nothing_is_active = f"{MODE} {kind}", Named("")
    return Assign(variable, nothing_is_active)


def make_uncorrected_move(
    expressions: list[Op], reason: str, remedy: str, motion: Motion = Motion.LINEAR
) -> list[Op]:
    """Return the operations of a move that is not corrected, for a reason.

    `expressions` are the operations of the expressions in the move, which come first.
    """
    return [*expressions, Move(motion, (), reason=reason, remedy=remedy)]


def begin_counted_loop(line: Line, remedy: str) -> list[Op]:
    """Translate the beginning of a loop, such as `FOR i FROM 1 TO 5 STEP 2`, whose variable counts.

    The groups of the line are the variable `name`, and the expressions `first`, `last` and `step`. If all of
    these are numbers, they show whether the loop runs at least once.
    """
    stated_bounds = [line.part(group) for group in ("first", "last", "step") if line[group]]
    uses = list[Op]()
    for bound in stated_bounds:
        uses += bound.read_expression()
    name = line["name"]
    counter = MakeUnknown(frozenset({name}), f"{name} counts a loop", remedy)
    if not all(bound.is_number for bound in stated_bounds):
        return [*uses, Flow("loop"), counter]
    numbers = tuple(bound.ordinals[0] for bound in stated_bounds)
    return [*uses, Flow("loop", bounds=numbers), counter]


IS_PARAMETER: Final = "the value is a parameter of the routine"
"""Reason why the value of a parameter is unknown."""


def begin_routine(
    name: str, parameters: Iterable[str], remedy: str, *, handler: bool = False, shared: bool = False
) -> list[Op]:
    """Translate the beginning of a routine, whose parameters are local names with unknown values.

    Args:
        name: name of the routine.
        parameters: names of its parameters.
        remedy: advice in messages on the parameters.
        handler: whether the routine may run at any time.
        shared: whether other programs may call the routine.
    """
    begin = Flow("handler" if handler else "routine", name, shared=shared)
    names = frozenset(parameters)
    if not names:
        return [begin]
    return [begin, Local(names), MakeUnknown(names, IS_PARAMETER, remedy)]


# What occurs in no expression. A sign before a number belongs to the number, so that a number may follow an
# operand without an operator.
_NO_EXPRESSION: Final = re.compile(
    r"[\w\0\"'] [\w\"'$#]|[)\]}] ?[\w\"$#]|[^\w\0\s$#\"'.+\-*/<>=:,()\[\]{}\\!%?&|;]|[=*/.<>,+-]$"
)
_NAME: Final = re.compile(r"(?<![\w$.#'\"])\$?[^\W\d]\w*+")
_ASSIGNED: Final = re.compile(r"(?:[\w$]++ )*[\w$]++(?:\.[\w$]++|\[[^\[\]=]*+\])*:?=(?!=)")
"""Pattern of the beginning of an assignment or a declaration with a value, such as `DECL INT n=`."""
_CALLED: Final = re.compile(r"(?<![\w$.])(\$?[^\W\d][\w.]*+) ?\(")
_OPENING_OF: Final = {")": "(", "]": "[", "}": "{"}


def _is_balanced(text: str) -> bool:
    """Return whether each bracket and each quotation of a text is closed: `f(a[1])`, but not `f(a[1)]`."""
    open_brackets: list[str] = []
    without_quotations = _QUOTED.sub("", text)
    if '"' in without_quotations:  # the begin of a quotation that is not closed
        return False
    for bracket in re.findall(r"[()\[\]{}]", without_quotations):
        if bracket in "([{":
            open_brackets.append(bracket)
        elif not open_brackets or open_brackets.pop() != _OPENING_OF[bracket]:
            return False
    return not open_brackets


def _find_last_argument(text: str, name: str) -> str:
    """Return the last argument of a function in an expression: `c` for `1+f(a,g(b),c)` and the name f.

    The whole expression is returned, which has more names, if the function is called more than once, or its
    brackets do not close.
    """
    if text.count(f"{name}(") != 1:
        return text
    _, _, behind = text.partition(f"{name}(")
    depth = 1  # count of open brackets
    for bracket in re.finditer(r"[()]", behind):
        depth += 1 if bracket[0] == "(" else -1
        if depth == 0:
            arguments = behind[: bracket.start()]
            begin, end = list(split_outside_brackets(arguments))[-1]
            return arguments[begin:end]
    return text


_MARK: Final = decode_text(b"\xef\xbb\xbf")  # of a file in UTF-8
_MAX_DEPTH: Final = 16
"""Largest depth of braces within one another; structures of controllers need a depth of three."""
_QUOTED: Final = re.compile(r'"[^"]*+"')
_PLACEHOLDER: Final = re.compile(r"(?P<sign>[@#])\{(?P<group>\w+)\}")
_NO_LINE_BREAK: Final = re.compile(r"[^\r\n]")
_LINE_END: Final = re.compile(r"\r\n?|\n")


def split_outside_brackets(text: str, separator: str = ",") -> Iterator[tuple[int, int]]:
    """Yield the span of each part of a text between separators that are not in brackets or quotations.

    A span is the index of the first character, and of the last + 1: `a,f(b,c)` has the spans (0, 1) and
    (2, 8).
    """
    depth = 0  # of brackets within one another
    begin = 0
    signs = rf'"[^"]*+"|[()\[\]{{}}]|{re.escape(separator)}'
    for sign in re.finditer(signs, text):
        if sign[0] in "([{":
            depth += 1
        elif sign[0] in ")]}":
            depth -= 1
        elif sign[0] == separator and depth == 0:
            yield begin, sign.start()
            begin = sign.end()
    yield begin, len(text)
