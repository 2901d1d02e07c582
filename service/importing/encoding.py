"""Bytes to text: the encodings that measuring computers write, told apart without guessing."""

from __future__ import annotations

import codecs
import re
from typing import Final

from jointstiff.service.importing.errors import ImportFileError, Place

_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_UTF8_SEQUENCE: Final = re.compile(
    rb"[\xc2-\xdf][\x80-\xbf]|[\xe0-\xef][\x80-\xbf]{2}|[\xf0-\xf4][\x80-\xbf]{3}"
)
_CONTROL: Final = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ufeff\ufffe\uffff]")
_REMEDY: Final = "save the file as text in UTF-8"


def decode(file: str, content: bytes) -> tuple[str, str]:
    """The text of a file, and its encoding.

    UTF-8 and UTF-16 by their byte order marks; without one UTF-16 if every other byte is zero, UTF-8 if it
    is valid; else Latin-1, unless part of it is UTF-8: then it is damaged.

    Raises:
        ImportFileError: not text in any of them.
    """
    text, encoding = _decoded(file, content)
    if control := _CONTROL.search(text):
        line = 1 + text.count("\n", 0, control.start())
        raise ImportFileError(
            Place(file, line),
            f"the file contains the control character {control.group()!a}, so it is not plain text",
            _REMEDY,
        )
    return text, encoding


def _decoded(file: str, content: bytes) -> tuple[str, str]:
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            return _strict(file, content[len(mark) :], encoding), encoding
    if b"\0" in content[:4]:
        encoding = "utf-16-be" if content[:1] == b"\0" else "utf-16-le"
        return _strict(file, content, encoding), encoding
    try:
        return content.decode("utf-8"), "utf-8"
    except UnicodeDecodeError as error:
        if _UTF8_SEQUENCE.search(content):
            line = 1 + content.count(b"\n", 0, error.start)
            raise ImportFileError(
                Place(file, line),
                f"the text is damaged: not UTF-8 from byte {error.start + 1} on, though most of it is",
                _REMEDY,
            ) from None
        return content.decode("latin-1"), "latin-1"


def _strict(file: str, content: bytes, encoding: str) -> str:
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        reason = f"not valid {encoding.upper()} from byte {error.start + 1} on, though it begins like it"
        raise ImportFileError(Place(file), reason, _REMEDY) from None
