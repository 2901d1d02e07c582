"""The scanner of all languages of programs: text to tokens with their spans, in linear time.

Each alternative of a pattern begins with other characters than the next, and none gives back what it took.
Possessive are repeated characters only, no groups: Python before 3.11.5 keeps what a failed group had taken.
What follows is told from the *shape* of a statement, its text without numbers: one shape is parsed once.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, NamedTuple

_FRACTION: Final = r"(?:\.\d{0,20}+)?"
# Its first character stands before all else, so that the search passes over what begins no number.
NUMBER: Final = (
    r"[+\-.\d](?<!\w[+\-.\d])(?:"
    rf"(?<=\d)\d{{0,14}}+{_FRACTION}|(?<=[+-])(?:\d{{1,15}}+{_FRACTION}|\.\d{{1,20}}+)|(?<=\.)\d{{1,20}}+"
    r")(?:[eE][+-]?+\d{1,3}+)?"
)
_SEPARATORS: Final = (",", "=", ":=", "\\", ":")
_ARITHMETIC: Final = ("+", "-", "*", "/")
_OPENING: Final = {"(": ")", "[": "]", "{": "}"}
_PARTS: Final = re.compile(r"\w+|\S")
_KINDS: Final = {"n": "number", "t": "text"}


class Misread(Exception):  # noqa: N818  # it is no failure of ours
    """Raise where a statement is not understood."""

    def __init__(self, reason: str, remedy: str = "", offset: int = 0, quoted: str = "") -> None:
        super().__init__(reason)
        self.reason, self.remedy, self.offset, self.quoted = reason, remedy, offset, quoted


class Token(NamedTuple):
    """A token of a statement."""

    kind: str  # `number`, `word`, `text` or `sign`; `end` behind the last one
    text: str  # words in capitals where the language does not tell them apart; empty for a number
    start: int  # first character, from the begin of the statement
    end: int  # last character + 1
    ordinal: int = -1  # place of a number among the numbers of the statement


@dataclass(frozen=True)
class Lexicon:
    """Tokens of a language, and what its expressions are made of."""

    comment: str  # pattern of a comment
    signs: str  # pattern of signs of several characters
    text: str = r'"[^"\r\n]*+"'  # pattern of texts and of constants that are no number
    word: str = r"[^\W\d]\w*+"  # pattern of a word
    number: str = NUMBER  # pattern of a number
    folded: bool = True  # whether capitals and small letters are the same
    operators: Collection[str] = ()  # between operands, beside + - * /
    prefixes: Collection[str] = ("+", "-")  # before operands
    # words that begin statements: none of them is a variable
    reserved: Collection[str] = ()
    functions: Collection[str] = ()  # routines of the controller that only tell a value

    @cached_property
    def numbers(self) -> re.Pattern[str]:
        """All numbers, also of comments and texts."""
        return re.compile(self.number)

    @cached_property
    def _pattern(self) -> re.Pattern[str]:
        return re.compile(
            rf"(?P<blank>\s++)|(?P<comment>{self.comment})|(?P<text>{self.text})|(?P<number>{self.number})"
            rf"|(?P<word>{self.word})|(?P<sign>(?:{self.signs})|.)",
            re.DOTALL,
        )

    def tokens(self, text: str) -> list[Token]:
        """Return the tokens of a statement."""
        ordinals = {match.start(): i for i, match in enumerate(self.numbers.finditer(text))}
        tokens = []
        for match in self._pattern.finditer(text):
            kind = str(match.lastgroup)
            if kind in {"blank", "comment"}:
                continue
            start, end = match.span()
            if kind == "number":
                tokens.append(Token(kind, "", start, end, ordinals[start]))
            else:
                word = match[0].upper() if self.folded and kind == "word" else match[0]
                tokens.append(Token(kind, word, start, end))
        return tokens


@dataclass
class Used:
    """Names that an expression uses."""

    calls: set[str] = field(default_factory=set)  # routines
    passed: set[str] = field(default_factory=set)  # names that routines are given, which may change them


class Cursor:
    """The tokens of a statement, taken one by one; whatever is not taken is not understood.

    A method that takes something raises a `Misread` where something else stands.
    """

    def __init__(self, lexicon: Lexicon, text: str) -> None:
        """Begin with the first token."""
        self.text, self.lexicon = text, lexicon
        self._tokens = lexicon.tokens(text)
        self._place = 0
        self.begin = self._tokens[0].start if self._tokens else 0  # of the statement that is being read
        self._end = Token("end", "", len(text), len(text))

    def peek(self, ahead: int = 0) -> Token:
        """Return a token that comes."""
        place = self._place + ahead
        return self._tokens[place] if place < len(self._tokens) else self._end

    def take(self) -> Token:
        """Take the next token."""
        token = self.peek()
        self._place += 1
        return token

    def at(self, *texts: str) -> bool:
        """Tell whether the next token is one of these signs or words."""
        token = self.peek()
        return token.text in texts and token.kind in {"sign", "word"}

    def accept(self, *texts: str) -> Token | None:
        """Take the next token if it is one of these signs or words."""
        return self.take() if self.at(*texts) else None

    def expect(self, *texts: str) -> Token:
        """Take one of these signs or words."""
        if not self.at(*texts):
            raise self.misread()
        return self.take()

    def word(self) -> str:
        """Take a word."""
        if self.peek().kind != "word":
            raise self.misread()
        return self.take().text

    def name(self) -> str:
        """Take a word that begins no statement."""
        if self.peek().text in self.lexicon.reserved:
            raise self.misread()
        return self.word()

    def number(self) -> int:
        """Take a number; return its place among the numbers of the statement."""
        if self.peek().kind != "number":
            raise self.misread()
        return self.take().ordinal

    def taken(self, template: str) -> tuple[int, ...] | None:
        """Take numbers `n`, texts `t`, words and signs as a template has them.

        Returns:
            Places of the numbers among those of the statement; None, and nothing taken, where others stand.
        """
        parts, places = _PARTS.findall(template), list[int]()
        for ahead, part in enumerate(parts):
            token = self.peek(ahead)
            if token.kind != _KINDS.get(part, token.kind) or (part not in _KINDS and token.text != part):
                return None
            places += [token.ordinal] if part == "n" else []
        self._place += len(parts)
        return tuple(places)

    def written(self, token: Token) -> str:
        """Return a token as it is written."""
        return self.text[token.start : token.end]

    def attempt(self, begin: int) -> None:
        """Go back to an earlier place."""
        self._place = begin

    @property
    def place(self) -> int:
        """Count of the tokens taken."""
        return self._place

    @property
    def ended(self) -> bool:
        """Return whether all tokens are taken."""
        return self._place >= len(self._tokens)

    def finish(self) -> None:
        """Require that all tokens are taken."""
        if not self.ended:
            raise self.misread()

    def misread(self, reason: str = "", remedy: str = "") -> Misread:
        """Return the fault of the next token: what stands there is not known."""
        token = self.peek()
        rest = self.text[token.start :]
        where = "this text is unknown" if rest.strip() else "the statement is not complete"
        return Misread(reason or where, remedy, min(token.start, max(len(self.text) - 1, 0)), rest)

    def expression(self, *stops: str, used: Used) -> None:
        """Take an expression up to one of these signs or words outside of its brackets, or to the end.

        Operands and operators alternate, so that no statement hides behind one; a word before a bracket is a
        call.
        """
        closing: list[tuple[str, bool]] = []  # brackets that are open, and whether they are of a call
        operand = False  # whether the token before ends an operand
        while not self.ended:
            sign = self.peek().text if self.peek().kind in {"sign", "word"} else ""
            if not closing and sign in stops:
                break
            if closing and sign == closing[-1][0]:
                closing.pop()
                operand = True
            elif sign in _OPENING:
                called = self._opened(operand, used)
                closing.append((_OPENING[sign], called or bool(closing and closing[-1][1])))
                operand = False
            elif sign in _SEPARATORS and closing:
                operand = False
            else:
                operand = self._part(sign, operand, closing[-1] if closing else ("", False), used)
            self._place += 1
        if closing or not operand:
            raise self.misread()

    def _opened(self, operand: bool, used: Used) -> bool:  # what came before
        """Note the call that a bracket opens; return whether it opens one."""
        before = self._tokens[self._place - 1] if self._place else self._end
        called = operand and self.at("(")
        if called and before.kind != "word":
            raise self.misread()
        if called and before.text not in self.lexicon.functions:
            used.calls.add(before.text)
        return called

    def _part(self, sign: str, operand: bool, bracket: tuple[str, bool], used: Used) -> bool:
        """Look at an operator or an operand; return whether it ends an operand."""
        token, lexicon = self.peek(), self.lexicon
        if sign in lexicon.prefixes and not operand:
            return False
        if operand and (sign in lexicon.operators or sign in _ARITHMETIC):
            return False
        named = token.kind == "word" and sign not in lexicon.reserved
        # A sign before a number belongs to it, so that an operand may stand before; in an aggregate, a name.
        if token.kind != "number" and (
            not (named or token.kind == "text") or (operand and bracket[0] != "}")
        ):
            raise self.misread()
        if bracket[1] and named:
            used.passed.add(sign)
        return True

    def listed(self, closing: str, used: Used) -> None:
        """Take expressions, commas between, and the sign behind them."""
        while not self.accept(closing):
            if not self.accept(","):
                self.expression(closing, ",", used=used)

    def arguments(self, used: Used) -> None:
        """Take the arguments of a call, in their brackets."""
        self.expect("(")
        while not self.accept(")"):
            if not self.at(",", ")"):
                first = self.place
                self.expression(",", ")", used=used)
                used.passed |= {t.text for t in self._tokens[first : self.place] if t.kind == "word"}
            if not self.at(")"):
                self.expect(",")
