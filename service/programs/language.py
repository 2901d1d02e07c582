"""Words of the intermediate language, and the normal form of a statement that the readers translate.

The normal form has no comments, one blank between words and none elsewhere, and NUL in place of each number:
it is the same for all statements of one shape, so that a shape is translated once, in linear time.
Possessive are repeated characters only, no groups: Python before 3.11.5 keeps what a failed group had taken.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, NamedTuple, TypeAlias

from jointstiff.service.programs.errors import CONSTANT, shown
from jointstiff.service.programs.program import Literal, Motion
from jointstiff.solver.arrays import FloatArray

_FRACTION: Final = r"(?:\.\d{0,20}+)?"
# Its first character stands before all else, so that the search passes over what begins no number.
NUMBER: Final = (
    r"[+\-.\d](?<!\w[+\-.\d])(?:"
    rf"(?<=\d)\d{{0,14}}+{_FRACTION}|(?<=[+-])(?:\d{{1,15}}+{_FRACTION}|\.\d{{1,20}}+)|(?<=\.)\d{{1,20}}+"
    r")(?:[eE][+-]?+\d{1,3}+)?"
)
Name: TypeAlias = str | tuple[str, int]
"""Name of a variable; one with a number in it as a template with `%s`, and the ordinal of the number."""


class Copy(NamedTuple):
    """Value that another variable has; `through` it, where that holds a name."""

    name: Name
    through: bool = False


class Named(NamedTuple):
    """Value known by its name only."""

    name: Name


class Product(NamedTuple):
    """Frames by their names, each in the one before."""

    names: tuple[str, ...]


Value: TypeAlias = Literal | Copy | Named


class Assign(NamedTuple):
    """A name gets a value."""

    name: Name
    value: Value
    declares: str = ""  # `variable` or `constant`, where the name has it before the program runs
    shared: bool = False  # whether other programs know the name
    own: bool = False  # whether no other program knows it


class Local(NamedTuple):
    """Names belong to the routine that they are declared in: elsewhere they are others."""

    names: frozenset[str]


class Havoc(NamedTuple):
    """Names get values that are not known; all of them, and the active frames, where none is given."""

    names: frozenset[Name]
    reason: str
    remedy: str


class Call(NamedTuple):
    """A routine is called, or attached to an event: then it may run at any time."""

    name: Name
    passed: frozenset[str] = frozenset()
    attached: bool = False
    quiet: bool = False  # whether it changes nothing, if it is the controller's own and not of the program


class Use(NamedTuple):
    """Names whose numbers are used otherwise than as the target of a move."""

    names: frozenset[str]


class Move(NamedTuple):
    """A move to targets; it is left where a reason is given."""

    motion: Motion
    targets: tuple[Literal | Name, ...]
    bases: tuple[Value | Product, ...] = ()
    tools: tuple[Value | Product, ...] = ()
    agree: tuple[str, ...] = ()  # names that hold base and tool, too, where the program sets them
    reason: str = ""
    remedy: str = ""
    repeats: bool = False  # whether each such statement is a move to numbers of its own


class Keep(NamedTuple):
    """A move to a place that the controller keeps: nothing of it stands in the program."""

    name: str


class Flow(NamedTuple):
    """A branch, loop, jump or routine begins or ends.

    The kinds are `if`, `loop` and `repeat` (carried out once at least), `turn`, `default`, `close`, `leave`,
    `label`, `jump`, `return`, `routine`, `aside` (may run at any time), `end`, `any` of `close` and `end`.
    """

    kind: str
    name: Name = ""
    shared: bool = False  # whether other programs may call a routine, with frames of their own


Op: TypeAlias = Assign | Local | Havoc | Call | Use | Move | Keep | Flow


class Misread(Exception):  # noqa: N818  # it is no failure of ours
    """Raise where a statement is not understood."""

    def __init__(self, reason: str, remedy: str = "") -> None:
        super().__init__(reason)
        self.reason, self.remedy = reason, remedy


def words(text: str) -> frozenset[str]:
    """Return the words of a text."""
    return frozenset(text.split())


@dataclass(frozen=True, slots=True)
class Line:
    """A statement in normal form."""

    language: Language
    text: str
    ordinals: tuple[int, ...]  # places of its numbers among those of the statement as it is written
    places: tuple[int, ...]  # first character of each token
    breaks: tuple[int, ...]  # ends of lines before each token

    def ordinal(self, place: int) -> int:
        """Return the ordinal of the number at a place of the text."""
        return self.ordinals[self.text.count("\0", 0, place)]

    def numbers(self, start: int, end: int) -> tuple[int, ...]:
        """Return the ordinals of the numbers in a part of the text."""
        first = self.text.count("\0", 0, start)
        return self.ordinals[first : first + self.text.count("\0", start, end)]

    def expression(self, text: str, *, empty: bool = False) -> list[Op]:
        """Return what an expression of the line uses and calls."""
        return self.language.expression(text, empty=empty)

    def below(self, place: int) -> int:
        """Return how many lines a place is below the begin of the statement."""
        return self.breaks[bisect_right(self.places, place) - 1] if self.places else 0


Rule: TypeAlias = "str | Callable[[Line, re.Match[str]], list[Op]]"
"""What a statement does: a function of its line; or a kind of `Flow` behind the expressions of its groups."""


@dataclass(frozen=True)
class Language:
    """Tokens of a language, its statements by their forms, and facts of its controller."""

    comment: str  # pattern of a comment
    rules: tuple[tuple[str, Rule], ...] = ()  # forms of statements in normal form
    motion: str = r"(?!)"  # pattern of the words of moves
    remedy: str = CONSTANT  # what to do where a target is not understood
    text: str = r'"[^"\r\n]*+"'  # pattern of texts and of constants that are no number
    word: str = r"[^\W\d]\w*+"
    number: str = NUMBER
    blank: str = ""  # pattern of what ends a line that is continued, as a blank does
    folded: bool = True  # whether capitals and small letters are the same: the normal form has capitals
    operators: str = ""  # pattern of words between or before operands
    reserved: str = ""  # pattern of words that begin statements: none of them is a variable
    functions: str = ""  # pattern of the controller's functions, which tell a value and change nothing
    active: Mapping[str, str] = field(default_factory=dict)  # frames that are active, and their names
    constants: Mapping[str, FloatArray] = field(default_factory=dict)  # frames that no program changes
    is_frame: Callable[[str], bool] = lambda _: False  # names of frames that have numbers elsewhere
    callers: bool = False  # whether other programs may call each of the routines

    @cached_property
    def numbers(self) -> re.Pattern[str]:
        """All numbers, also of comments and texts."""
        return re.compile(self.number)

    @cached_property
    def _token(self) -> re.Pattern[str]:
        return re.compile(
            rf"(?P<blank>\s++)|(?P<comment>{self.comment}|\xef\xbb\xbf)|(?P<text>{self.text})|(?P<word>\0|{self.word})|(?P<sign>.)",
            re.DOTALL,
        )

    @cached_property
    def _rules(self) -> tuple[tuple[re.Pattern[str], Rule], ...]:
        return tuple((re.compile(pattern), rule) for pattern, rule in self.rules)

    @cached_property
    def _motion(self) -> re.Pattern[str]:
        return re.compile(self.motion)

    @cached_property
    def _words(self) -> tuple[re.Pattern[str], ...]:
        flags = re.IGNORECASE if self.folded else 0
        return (
            re.compile(rf" ?(?<![\w$.])(?:{self.operators})\b ?", flags),
            re.compile(rf"(?<![\w$.])(?:{self.reserved})(?![\w$])", flags),
            re.compile(self.functions, flags),
        )

    def line(self, shape: str) -> Line:
        """Return the normal form of a statement without its numbers."""
        pieces, places, breaks, ordinals = list[str](), list[int](), list[int](), list[int]()
        number, length, behind, line = 0, 0, False, 0
        for match in self._token.finditer(shape):
            kind, piece = match.lastgroup, match[0].upper() if self.folded else match[0]
            if kind in {"text", "word"}:
                if piece == "\0":
                    ordinals.append(number)
                elif kind == "text":
                    piece, number = piece.replace("\0", "0"), number + piece.count("\0")
                if behind:
                    pieces.append(" ")
                    length += 1
            if kind in {"blank", "comment"}:
                number += piece.count("\0")
                line += piece.count("\n") or piece.count("\r")
                continue
            number += piece == "\0"
            behind = kind != "sign"
            places.append(length)
            breaks.append(line)
            pieces.append(piece)
            length += len(piece)
        text = "".join(pieces)
        text = re.sub(self.blank, " ", text).strip() if self.blank else text
        return Line(self, text, tuple(ordinals), tuple(places), tuple(breaks))

    def translate(self, line: Line) -> list[tuple[int, Op]]:
        """Return what a statement does, and how many lines below its begin.

        Raises:
            Misread: it is no text of people.
        """
        if _is_deep(line.text):
            reason = f"more than {_MAX_DEPTH} braces within one another"
            raise Misread(reason, "declare inner structures on their own")
        try:
            ops = self.rule(line) if line.text else []
        except Misread as fault:
            return self._unknown(line, fault)
        moves = sum(isinstance(op, Move | Keep) for op in ops)
        if len(self._motion.findall(_QUOTED.sub("", line.text))) > moves:
            return self._unknown(line, Misread("a move stands where none is expected"))
        return [(line.below(0), op) for op in ops]

    def rule(self, line: Line) -> list[Op]:
        """Return what a statement does by the rules.

        Raises:
            Misread: there is no rule for it, or not for all of it.
        """
        for pattern, rule in self._rules:
            if match := pattern.fullmatch(line.text):
                if not isinstance(rule, str):
                    return rule(line, match)
                found = [op for each in match.groups() if each for op in self.expression(each)]
                return [
                    *(attached(found) if rule in {"turn", "loop"} else found),
                    *([Flow(rule)] if rule else []),
                ]
        raise Misread("the statement is unknown: it may move the robot, targets or frames")

    def _unknown(self, line: Line, fault: Misread) -> list[tuple[int, Op]]:
        """Return what a statement may do that is not understood: all, and each word of a motion is a move."""
        ordinals, text = iter(line.ordinals), line.text
        quoted = re.sub("@#@", lambda _: f"\0{next(ordinals)}\0", shown(text.replace("\0", "@#@")))
        reason, remedy = f"{quoted}: {fault.reason}", fault.remedy or self.remedy
        hidden = _QUOTED.sub(lambda match: "_" * len(match[0]), text)
        left = Move(Motion.LINEAR, (), reason=reason, remedy=remedy)
        return [
            (line.below(0), Havoc(frozenset(), reason, remedy)),
            (line.below(0), Havoc(frozenset([*_NAME.findall(hidden), "_"]), reason, remedy)),
            *((line.below(match.start()), left) for match in self._motion.finditer(hidden)),
        ]

    def expression(self, text: str, *, empty: bool = False) -> list[Op]:
        """Return what an expression uses and calls; operands and operators alternate: nothing hides in it.

        Raises:
            Misread: it is none.
        """
        operators, reserved, functions = self._words
        plain = operators.sub("+", _QUOTED.sub('""', text))
        fault = reserved.search(plain) or _FAULT.search(plain)
        if fault or not (plain or empty) or not _balanced(plain):
            raise Misread("this text is unknown, or not complete")
        names = frozenset(name.upper() if self.folded else name for name in _NAME.findall(plain))
        ops: list[Op] = [Use(names)] if names else []
        for name in dict.fromkeys(match[1] for match in _CALLED.finditer(plain)):
            quiet = functions.fullmatch(name) is not None
            called = name.upper() if self.folded else name
            call = Call(called, frozenset() if quiet else names - {called}, quiet=quiet)
            whole = plain.startswith(f"{name}(") and plain.count("(") == 1
            # It may be passed over, and of several ones any may be the first.
            ops += [call] if quiet or whole else [Flow("if"), call, Flow("close")]
        return ops


def calls(ops: list[Op]) -> bool:
    """Return whether something else than the controller's own functions is called."""
    return any(isinstance(op, Call) and not op.quiet for op in ops)


def attached(ops: list[Op]) -> list[Op]:
    """Return what an expression does that may be carried out at any time, or more than once."""
    return [op._replace(attached=True) if isinstance(op, Call) else op for op in ops]


# A sign before a number belongs to it, so that an operand may stand before it.
_FAULT: Final = re.compile(
    r"[\w\0\"'] [\w\"'$#]|[)\]}] ?[\w\"$#]|[^\w\0\s$#\"'.+\-*/<>=:,()\[\]{}\\!%?&|;]|[=*/.<>,+-]$"
)
_NAME: Final = re.compile(r"(?<![\w$.#'\"])\$?[^\W\d]\w*+")
_CALLED: Final = re.compile(r"(?<![\w$.])(\$?[^\W\d][\w.]*+) ?\(")
_PAIRS: Final = {")": "(", "]": "[", "}": "{"}


def _balanced(text: str) -> bool:
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
"""Braces within one another; a controller's own structures have three."""


def _is_deep(text: str) -> bool:
    depth = 0
    for sign in text if text.count("{") > _MAX_DEPTH else "":
        depth += (sign == "{") - (sign == "}")
        if depth > _MAX_DEPTH:
            return True
    return False


_QUOTED: Final = re.compile(r'"[^"]*+"')


def parts(text: str, begin: int = 0, sign: str = ",") -> Iterator[tuple[int, int]]:
    """Yield first and last + 1 character of what stands between signs outside of brackets."""
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
