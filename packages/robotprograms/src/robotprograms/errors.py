"""The error of reading programs: faults with line, reason and remedy."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

MAX_FAULTS = 20
"""Most faults that one error lists."""
WRITE_NUMBERS = "write the numbers of the value, or omit the value"
"""Remedy for a value that is not given by constant numbers."""
_MAX_QUOTED = 60


# Bytes that are no letters in Latin-1 are parts of letters in UTF-8: in names, letters without a case.
_FIRST_LETTER: Final = 0x4E00
"""Code of the letter for byte 0; the letter for a byte follows at the distance of its value."""
_LETTERS: Final = {
    byte: chr(_FIRST_LETTER + byte) for byte in (*range(0x80, 0xC0), 0xD7, 0xF7) if not chr(byte).isspace()
}
_BYTES: Final = {_FIRST_LETTER + byte: chr(byte) for byte in (*_LETTERS, 0x85, 0xA0)}
_SECOND_OF_SMALL_IN_UTF8: Final = re.compile("(?<=\xc3)[\u4ea0-\u4ebe]")
"""Letter for the second byte, A0 to BE, of a small letter in UTF-8, such as ü (C3 BC)."""


_BLANKS: Final = re.compile("(?<=[\xc3-\xdf])[\x85\xa0]")  # blanks of Latin-1 that end letters in UTF-8
_CASE_DISTANCE: Final = 0x20
"""Code of a small letter less that of its capital, in ASCII and Latin-1."""
_CAPITAL_OF_SMALL: Final = {
    code: code - _CASE_DISTANCE
    for code in (*range(ord("a"), ord("z") + 1), *range(0xE0, 0xFF))
    if code != 0xF7  # the sign ÷
}
"""Code of the capital, by the code of a small letter of ASCII or Latin-1: 0xDC (Ü) by 0xFC (ü)."""


def decode_text(content: bytes) -> str:
    """Return the text of a program, with one character for each byte, in whatever encoding the bytes are.

    Controllers write Latin-1 or UTF-8, and no file says which one. So a letter in UTF-8, such as ü (the bytes
    C3 BC), becomes two characters here. A name with such a letter is still one word, because bytes that are
    no letters in Latin-1 become letters, too; and each character has the index of its byte in the file.
    """
    text = content.decode("latin-1")
    if text.isascii():
        return text
    with_letters = text.translate(_LETTERS)  # BC, which is the sign ¼ in Latin-1, becomes a letter
    # Alone, the bytes 85 and A0 are blanks in Latin-1, and stay blanks. Behind a byte from C3 to DF they
    # are a part of a letter in UTF-8, such as à (C3 A0), and become letters.
    return _BLANKS.sub(lambda blank: chr(_FIRST_LETTER + ord(blank[0])), with_letters)


def encode_text(text: str) -> bytes:
    """Return the bytes of a text of a program, from which `decode_text` made the text."""
    return show_text(text).encode("latin-1")


def show_text(text: str) -> str:
    """Return a text of a program with its bytes as characters of Latin-1, for a message or a file.

    `decode_text` gives some bytes other characters, so that they count as letters: here they get their own.
    """
    return text if text.isascii() else text.translate(_BYTES)


def capitalise(text: str) -> str:
    """Return a text of a program in capitals, whether its letters are in Latin-1 or in UTF-8.

    The text has one character for each byte (`decode_text`). So there are two ways to write ü:

    * in Latin-1, as the byte FC: the character becomes DC, which is Ü;
    * in UTF-8, as the bytes C3 BC: the second character becomes that of 9C, because C3 9C is Ü.

    In both, the code of the capital is 0x20 less than that of the small letter.
    """
    if text.isascii():
        return text.upper()
    latin1_in_capitals = text.translate(_CAPITAL_OF_SMALL)
    return _SECOND_OF_SMALL_IN_UTF8.sub(
        lambda second_byte: chr(ord(second_byte[0]) - _CASE_DISTANCE), latin1_in_capitals
    )


def quote_text(text: str) -> str:
    """Return text of a program in quotation marks, escaped and cut to 60 characters, for a message."""
    text = show_text(text.strip())
    return ascii(text if len(text) <= _MAX_QUOTED else text[:_MAX_QUOTED] + "...")


@dataclass(frozen=True, slots=True)
class Fault:
    """Text of a program that was not understood."""

    file: str  # name of the file
    line: int | None  # line of the file, from 1; None for the whole file
    reason: str  # what is wrong, in a sentence
    remedy: str  # what to do

    @property
    def place(self) -> str:
        """Name of the file and line, in words."""
        return quote_text(self.file) if self.line is None else f"{quote_text(self.file)}, line {self.line}"

    def __str__(self) -> str:
        return f"{self.place}: {self.reason}; {self.remedy}"


class ReadMove(NamedTuple):
    """A move as it was understood."""

    line: int  # line of the move, from 1
    target: str  # names of its targets, or their numbers
    base: str  # name of the base; empty if it is not known
    tool: str  # name of the tool; empty if it is not known
    reason: str = ""  # why the move cannot be corrected; empty if it can be corrected
    remedy: str = ""  # what to do so that the move can be corrected
    corrected: bool = False  # whether the move can be corrected


class ProgramError(Exception):
    """Error that a program is not understood or cannot be corrected; the whole program is then refused.

    Attributes:
        faults: the first faults, at most MAX_FAULTS.
        count: number of all faults.
        left_moves: moves that cannot be corrected.
    """

    def __init__(
        self, faults: Sequence[Fault], count: int | None = None, left: Sequence[ReadMove] = ()
    ) -> None:
        """Build the error of a program.

        Args:
            faults: faults of the program; the first `MAX_FAULTS` are kept.
            count: count of all faults, if only the first ones are given.
            left: moves that cannot be corrected.
        """
        super().__init__(faults, count, left)
        self.left_moves = tuple(left)
        self.faults = tuple(faults[:MAX_FAULTS])
        self.count = len(faults) if count is None else count

    def __str__(self) -> str:
        unlisted = self.count - len(self.faults)
        lines = list(map(str, self.faults))
        if unlisted:
            lines.append(f"... and {unlisted} more")
        return "\n".join(lines)
