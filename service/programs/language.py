"""Words of the intermediate language, and the normal form of a statement that the readers translate.

The normal form has no comments, one blank between words and none elsewhere, and NUL in place of each number:
statements that differ in their numbers only have the same normal form, which is translated once.
Possessive quantifiers follow characters only: Python before 3.11.5 keeps the match of a failed group.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import accumulate
from typing import Any, Final, NamedTuple, TypeAlias

from jointstiff.service.programs.errors import CONSTANT, quote_text
from jointstiff.service.programs.notation import Notation
from jointstiff.service.programs.program import Literal, Motion, Source
from jointstiff.solver.arrays import FloatArray

_FRACTION: Final = r"(?:\.\d{0,20}+)?"
# Its first character comes before all else, so that the search passes over what begins no number.
NUMBER: Final = (
    r"[+\-.\d](?<!\w[+\-.\d])(?:"
    rf"(?<=\d)\d{{0,14}}+{_FRACTION}|(?<=[+-])(?:\d{{1,15}}+{_FRACTION}|\.\d{{1,20}}+)|(?<=\.)\d{{1,20}}+"
    r")(?:[eE][+-]?+\d{1,3}+)?"
)
Name: TypeAlias = str | tuple[str, int]
"""Name of a variable; one with a number in it as a template with `%s`, and the ordinal of the number."""


class Copy(NamedTuple):
    """Value of another variable; with `through`, of the variable whose name that other variable holds."""

    name: Name
    through: bool = False


class Named(NamedTuple):
    """Value that is known by its name only."""

    name: Name


class Product(NamedTuple):
    """Product of frames, by their names; each frame is given in the coordinates of the frame before it."""

    names: tuple[str, ...]


Value: TypeAlias = Literal | Copy | Named


class Assign(NamedTuple):
    """Assignment of a value to a name."""

    name: Name
    value: Value
    declares: str = (
        ""  # `variable` or `constant` if the name has the value before the program runs; else empty
    )
    shared: bool = False  # whether other programs know the name
    own: bool = False  # whether no other program knows the name


class Local(NamedTuple):
    """Declaration of names that belong to the routine only: elsewhere, these names mean other variables."""

    names: frozenset[str]


class MakeUnknown(NamedTuple):
    """Statement that gives unknown values to names; without names, to all names and the active frames."""

    names: frozenset[Name]
    reason: str
    remedy: str
    anytime: bool = False  # whether the names are unknown before this statement, too, by an earlier run


class Call(NamedTuple):
    """Call of a routine; a routine that is attached to an event may run at any time."""

    name: Name
    passed: frozenset[str] = frozenset()  # names that the routine gets as arguments
    attached: bool = False
    quiet: bool = (
        False  # whether the call changes nothing, unless the program defines a routine with this name
    )


class Use(NamedTuple):
    """Use of the numbers of names for something else than the target of a move."""

    names: frozenset[str]


class Move(NamedTuple):
    """Move to targets; a move with a reason is not corrected."""

    motion: Motion
    targets: tuple[Literal | Name, ...]
    bases: tuple[Value | Product, ...] = ()
    tools: tuple[Value | Product, ...] = ()
    agree: tuple[str, ...] = ()  # names of the active base and tool, which have to be those of the target
    reason: str = ""
    remedy: str = ""

    @property
    def differs_only_in_target(self) -> bool:
        """Return whether moves with this masked text can differ only in the numbers of one target."""
        own = isinstance(self.targets[0], Literal) if len(self.targets) == 1 else False
        return own and not (
            self.agree or self.reason or any(isinstance(base, Literal) for base in self.bases)
        )


class MoveToStored(NamedTuple):
    """Move to a position that is stored in the controller, not in the program."""

    name: str


class Flow(NamedTuple):
    """Beginning or end of a branch, loop, jump or routine.

    The kinds are `if`, `loop` and `repeat` (carried out once at least), `turn`, `default`, `close`, `leave`,
    `label`, `jump`, `return`, `routine`, `aside` (may run at any time), `end`, `any` of `close` and `end`.
    """

    kind: str
    name: Name = ""
    shared: bool = False  # whether other programs may call a routine, with frames of their own


Op: TypeAlias = Assign | Local | MakeUnknown | Call | Use | Move | MoveToStored | Flow


UNKNOWN_STATEMENT: Final = "the statement is unknown: it may move the robot, targets or frames"


class Misread(Exception):  # noqa: N818  # a statement that is not understood is no failure of the program
    """Error that a statement is not understood."""

    def __init__(self, reason: str, remedy: str = "") -> None:
        super().__init__(reason)
        self.reason, self.remedy = reason, remedy


@dataclass(frozen=True, slots=True)
class Line:
    """Statement in normal form, and its match with the pattern of a rule."""

    language: Language
    text: str  # normal form, with NUL in place of each number
    ordinals: tuple[int, ...]  # index of each number among those of the statement as it is written
    below: int = 0  # line breaks before the statement
    match: re.Match[str] | None = None

    def __getitem__(self, group: str) -> str:
        """Return the part of the statement that matched a named group; empty if the group did not match."""
        return (self.match and self.match.groupdict().get(group)) or ""

    def span(self, group: str) -> tuple[int, int]:
        """Return the indices, first and last + 1 character, of the part that matched a named group."""
        return self.match.span(group) if self.match else (0, 0)

    def ordinals_in(self, *span: int) -> tuple[int, ...]:
        """Return the ordinals of the numbers between two indices of characters, `span`, of the text."""
        starts = _number_starts(self.text)
        return self.ordinals[slice(*(bisect_left(starts, end) for end in span))]

    def first_ordinal(self, group: str) -> int:
        """Return the ordinal of the first number in the part that matched a named group."""
        return self.ordinals_in(*self.span(group))[0]

    def read_expression(self, text: str) -> list[Op]:
        """Return the operations of an expression: names that it uses, and routines that it calls."""
        return self.language.read_expression(text)


@lru_cache(maxsize=4)
def _number_starts(text: str) -> tuple[int, ...]:
    """Return the places of the numbers in a text; cached, because each part of a line needs them."""
    return tuple(place for place, sign in enumerate(text) if sign == "\0")


Rule: TypeAlias = "str | Callable[[Line], list[Op]]"
"""Effect of a statement apart from its expressions: the kind of a `Flow`, or a function of the `Line` that
returns the operations."""


@dataclass(frozen=True)
class Language:
    """Tokens of a language, its statements by their forms, and facts of its controller."""

    comment: str  # pattern of a comment
    # forms of statements in normal form: groups with names are for the rule, others are expressions;
    # `@{name}` is a word of that name that is not reserved, `#{name}` a number
    rules: tuple[tuple[str, Rule], ...] = ()
    motion: str = r"(?!)"  # pattern of the words of moves
    remedy: str = CONSTANT  # what to do where a target is not understood
    text: str = r'"[^"\r\n]*+"'  # pattern of texts and of constants that are no number
    word: str = r"[^\W\d]\w*+"
    number: str = NUMBER
    blank: str = ""  # pattern of text that counts as a blank, such as the end of a line that is continued
    folded: bool = True  # whether capitals and small letters are the same: the normal form has capitals
    operators: str = ""  # pattern of words between or before operands
    reserved: str = r"(?!)"  # pattern of words that begin statements: none of them is a variable
    functions: str = ""  # pattern of the controller's functions, which return a value and change nothing
    active: Mapping[str, str] = field(
        default_factory=dict
    )  # names of the active frames' variables, and of the frames in messages
    constants: Mapping[str, FloatArray] = field(default_factory=dict)  # frames that no program changes
    is_frame: Callable[[str], bool] = lambda _: (
        False
    )  # tells whether a name is that of a frame with numbers outside the program
    parts: tuple[
        str, ...
    ] = ()  # endings such as `.BASE`, with which a name becomes the name of one of its fields
    callers: bool = False  # whether other programs may call each of the routines
    suffixes: str = ""  # suffixes of the names of its files, separated by blanks
    pose: Notation | None = None  # notation in which users write frames; None for the notation of the program
    remark: str = "#"  # begin of a remark
    head: str = (
        ""  # pattern of the beginning of the line after which the mark is inserted; empty for the first line
    )
    read: Callable[[Any, tuple[Source, ...]], None] | None = (
        None  # function that adds the files to a machine; None if each line is a statement
    )

    @cached_property
    def numbers(self) -> re.Pattern[str]:
        """Pattern of numbers, also of those in comments and texts."""
        return re.compile(self.number)

    @cached_property
    def _token(self) -> re.Pattern[str]:
        """Pattern of one token: a blank, a comment, a text, a word or a sign."""
        return re.compile(
            rf"(?P<blank>\s++)|(?P<comment>{self.comment}|\xef\xbb\xbf)|(?P<text>{self.text})"
            rf"|(?P<word>\0|{self.word})|(?P<sign>.)",
            re.DOTALL,
        )

    @cached_property
    def _rules(self) -> tuple[tuple[re.Pattern[str], Rule], ...]:
        """Compiled patterns of the rules, with `@{name}` and `#{name}` replaced by groups."""
        words = {"@": rf"(?!(?:{self.reserved})(?![\w$])){self.word}", "#": r"\0"}
        return tuple(
            (re.compile(_PART.sub(lambda match: f"(?P<{match[2]}>{words[match[1]]})", pattern)), rule)
            for pattern, rule in self.rules
        )

    @cached_property
    def _motion(self) -> re.Pattern[str]:
        """Pattern of the words of moves."""
        return re.compile(self.motion, re.IGNORECASE if self.folded else 0)

    @cached_property
    def _words(self) -> tuple[re.Pattern[str], ...]:
        """Patterns of operators, of reserved words, and of the controller's functions."""
        flags = re.IGNORECASE if self.folded else 0
        return (
            re.compile(rf" ?(?<![\w$.])(?:{self.operators})\b ?", flags),
            re.compile(rf"(?<![\w$.])(?:{self.reserved})(?![\w$])", flags),
            re.compile(self.functions, flags),
        )

    def normalise(self, masked: str) -> Line:
        """Return the normal form of a statement; `masked` is its text with NUL in place of each number."""
        pieces, ordinals, number, behind, below = list[str](), list[int](), 0, False, 0
        for match in self._token.finditer(masked):
            kind, piece = match.lastgroup, match[0]
            count = piece.count("\0")
            if kind in {"blank", "comment"}:
                below += 0 if pieces else piece.count("\n") or piece.count("\r")
            else:
                if piece == "\0":
                    ordinals.append(number)
                pieces += [" "] if behind and kind != "sign" else []
                pieces.append(piece.replace("\0", "0") if kind == "text" else piece)
                behind = kind != "sign"
            number += count
        text = "".join(pieces)
        text = text.upper() if self.folded else text
        text = re.sub(self.blank, " ", text).strip() if self.blank else text
        return Line(self, text, tuple(ordinals), below)

    def translate(self, masked: str) -> list[tuple[int, Op]]:
        """Return the operations of a statement, each with its number of lines below the first line.

        `masked` is the statement with NUL in place of each number. A statement that is not understood may do
        anything.

        Raises:
            Misread: braces are nested too deep.
        """
        line = self.normalise(masked)
        if max(accumulate((sign == "{") - (sign == "}") for sign in line.text), default=0) > _MAX_DEPTH:
            reason = f"braces are nested more than {_MAX_DEPTH} deep"
            raise Misread(reason, "declare inner structures on their own")
        try:
            ops = self.apply_rules(line) if line.text else []
        except Misread as fault:
            return self._unknown(masked, line, fault)
        moves = sum(isinstance(op, Move | MoveToStored) for op in ops)
        if len(self._motion.findall(_QUOTED.sub("", line.text))) > moves:
            return self._unknown(masked, line, Misread("a move is in a place where no move is expected"))
        return [(line.below, op) for op in ops]

    def apply_rules(self, line: Line) -> list[Op]:
        """Return the operations of a statement, from the first rule that fits the whole statement.

        Raises:
            Misread: no rule fits the statement, or a part of it is not understood.
        """
        for pattern, rule in self._rules:
            if match := pattern.fullmatch(line.text):
                named = set(pattern.groupindex.values())
                given = [each for k, each in enumerate(match.groups(), 1) if each and k not in named]
                found = [op for each in given for op in self.read_expression(each)]
                if not isinstance(rule, str):
                    return [*found, *rule(replace(line, match=match))]
                line = replace(line, match=match)
                name = ("%s", line.first_ordinal("name")) if line["name"] == "\0" else line["name"]
                found = mark_attached(found) if rule in {"turn", "loop"} else found
                return [*found, *([Flow(rule, name)] if rule else [])]
        raise Misread(UNKNOWN_STATEMENT)

    def _unknown(self, masked: str, line: Line, fault: Misread) -> list[tuple[int, Op]]:
        """Return the operations of a statement that is not understood, and may therefore change all names.

        Each word of a motion in the statement becomes a move that is not corrected.
        """
        reason = f"{quote_statement(line.text, line.ordinals)}: {fault.reason}"
        remedy, names = fault.remedy or self.remedy, _NAME.findall(_QUOTED.sub("_", line.text))
        ops: list[tuple[int, Op]] = [
            (line.below, MakeUnknown(frozenset(), reason, remedy)),
            (line.below, MakeUnknown(frozenset([*names, "_"]), reason, remedy)),
        ]
        shown_only, below, place = {"comment", "text"}, 0, 0
        hidden = self._token.sub(
            lambda match: _SIGN.sub(" ", match[0]) if match.lastgroup in shown_only else match[0], masked
        )
        for match in self._motion.finditer(hidden):
            below += len(_LINE_END.findall(hidden, place, match.start()))
            place = match.start()
            ops.append((below, Move(Motion.LINEAR, (), reason=reason, remedy=remedy)))
        return ops

    def read_expression(self, text: str) -> list[Op]:
        """Return the operations of an expression: names that it uses, and routines that it calls.

        Operands and operators have to alternate, so that no unknown statement passes for an expression.

        Raises:
            Misread: the text is not an expression.
        """
        operators, reserved, functions = self._words
        plain = operators.sub("+", _QUOTED.sub('""', text))
        if reserved.search(plain) or _FAULT.search(plain) or not _balanced(plain):
            raise Misread("this text is not understood, or is not complete")
        names = frozenset(_NAME.findall(plain))
        ops: list[Op] = [Use(names)] if names else []
        for name in dict.fromkeys(match[1] for match in _CALLED.finditer(plain)):
            quiet = functions.fullmatch(name) is not None
            call = Call(name, frozenset() if quiet else names - {name}, quiet=quiet)
            whole = plain.startswith(f"{name}(") and plain.count("(") == 1
            # A call in a larger expression may be skipped, and several calls may run in any order.
            ops += [call] if quiet or whole else [Flow("if"), call, Flow("close")]
        return ops


def quote_statement(text: str, ordinals: Iterable[int]) -> str:
    """Return a statement in quotation marks for a reason, with NUL, ordinal, NUL in place of each number."""
    numbers = iter(ordinals)
    return re.sub("@#@", lambda _: f"\0{next(numbers)}\0", quote_text(text.replace("\0", "@#@")))


def calls_routine(ops: list[Op]) -> bool:
    """Return whether operations call a routine that is not a function of the controller."""
    return any(isinstance(op, Call) and not op.quiet for op in ops)


def mark_attached(ops: list[Op]) -> list[Op]:
    """Return the operations with each call marked as one that may run at any time, or more than once."""
    return [op._replace(attached=True) if isinstance(op, Call) else op for op in ops]


def leave_move(found: list[Op], reason: str, remedy: str, motion: Motion = Motion.LINEAR) -> list[Op]:
    """Return the operations of a move that is not corrected, for a reason.

    `found` are operations of the expressions in the move, which come first.
    """
    return [*found, Move(motion, (), reason=reason, remedy=remedy)]


def begin_counted_loop(name: str, remedy: str) -> list[Op]:
    """Return the operations of the beginning of a loop that counts with a variable."""
    return [Flow("loop"), MakeUnknown(frozenset({name}), f"{name} counts a loop", remedy)]


def begin_routine(
    name: str, own: Iterable[str], remedy: str, *, aside: bool = False, shared: bool = False
) -> list[Op]:
    """Return the operations of the beginning of a routine; its parameters `own` have unknown values.

    `aside` marks a routine that may run at any time, `shared` one that other programs may call.
    """
    names = frozenset(own)
    unknown: list[Op] = (
        [Local(names), MakeUnknown(names, "its value is a parameter of the routine", remedy)] if names else []
    )
    return [Flow("aside" if aside else "routine", name, shared=shared), *unknown]


# A sign before a number belongs to it, so that an operand may stand before it.
_FAULT: Final = re.compile(
    r"[\w\0\"'] [\w\"'$#]|[)\]}] ?[\w\"$#]|[^\w\0\s$#\"'.+\-*/<>=:,()\[\]{}\\!%?&|;]|[=*/.<>,+-]$"
)
_NAME: Final = re.compile(r"(?<![\w$.#'\"])\$?[^\W\d]\w*+")
_CALLED: Final = re.compile(r"(?<![\w$.])(\$?[^\W\d][\w.]*+) ?\(")
_PAIRS: Final = {")": "(", "]": "[", "}": "{"}


def _balanced(text: str) -> bool:
    """Return whether each bracket and each quotation of a text is closed."""
    opened: list[str] = []
    for sign in re.findall(r"[()\[\]{}\"]", _QUOTED.sub("", text)):
        if sign == '"':
            return False
        if sign in "([{":
            opened.append(sign)
        elif not opened or opened.pop() != _PAIRS[sign]:
            return False
    return not opened


_MAX_DEPTH: Final = 16
"""Largest depth of braces within one another; structures of controllers need a depth of three."""
_QUOTED: Final = re.compile(r'"[^"]*+"')
_PART: Final = re.compile(r"([@#])\{(\w+)\}")
_SIGN: Final = re.compile(r"[^\r\n]")
_LINE_END: Final = re.compile(r"\r\n?|\n")


def split_outside_brackets(text: str, begin: int = 0, sign: str = ",") -> Iterator[tuple[int, int]]:
    """Yield the span of each part of a text between commas, or between another sign.

    A span is the index of the first character, and of the last + 1. Signs in brackets or quotations do not
    count; the first part begins at index `begin`.
    """
    depth, first = 0, begin
    for match in re.finditer(rf'"[^"]*+"|[()\[\]{{}}]|{re.escape(sign)}', text[begin:]):
        if match[0] in "([{":
            depth += 1
        elif match[0] in ")]}":
            depth -= 1
        elif match[0] == sign and not depth:
            yield first, begin + match.start()
            first = begin + match.end()
    yield first, len(text)
