"""Texts of files, whose bytes are in UTF-8, UTF-16, or an encoding of one language."""

from __future__ import annotations

import codecs
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final
from unicodedata import east_asian_width

from jointstiff.service.importing.errors import ImportFileError, Place
from jointstiff.service.importing.grammar import WORDS_OF_ENCODINGS
from jointstiff.service.importing.texts.markdown import write_tables_plainly

_LATIN1: Final = "latin-1"
_WINDOWS: Final = "cp1252"
"""Latin-1 with typographic signs, such as `’` and `–`, in place of control characters."""
_NAMES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "cp932": "Shift-JIS (Japanese)",
        "euc_jp": "EUC-JP (Japanese)",
        "gb18030": "GBK (Chinese)",
        "big5": "Big5 (Chinese)",
        "cp949": "EUC-KR (Korean)",
        "cp1250": "Windows-1250 (Central European)",
        "cp1251": "Windows-1251 (Cyrillic)",
        "koi8_r": "KOI8-R (Cyrillic)",
        "cp1254": "Windows-1254 (Turkish)",
        _WINDOWS: "Windows-1252 (Western European)",
        _LATIN1: "Latin-1 (Western European)",
    }
)
"""Encoding that was assumed → its name for people."""
_BYTE_ORDERS: Final = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_UTF8_SEQUENCE: Final = re.compile(
    rb"[\xc2-\xdf][\x80-\xbf]|[\xe0-\xef][\x80-\xbf]{2}|[\xf0-\xf4][\x80-\xbf]{3}"
)
_ASCII: Final = bytes(range(128))
_CONTROL: Final = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ufeff\ufffe\uffff]")
_STATED: Final = re.compile(
    rb"<(?:meta|\?xml)\s[^<>]{0,300}?(?:charset|encoding)\s*=\s*[\"']?([\w.:-]{2,40})", re.IGNORECASE
)
"""Encoding that a web page states, such as `<meta charset="big5">`."""
_FIRST_BYTES_OF_PAGE: Final = 4096
"""Bytes of a web page among which its encoding is stated."""
_ENCODING_OF_LABEL: Final[Mapping[str, str]] = MappingProxyType(
    {
        **dict.fromkeys(("shift_jis", "shift-jis", "sjis", "x-sjis", "windows-31j"), "cp932"),
        **dict.fromkeys(("gb2312", "gbk", "gb18030", "x-gbk"), "gb18030"),
        **dict.fromkeys(("big5", "big5-hkscs", "x-x-big5"), "big5"),
        **dict.fromkeys(("euc-kr", "ks_c_5601-1987", "windows-949"), "cp949"),
        **dict.fromkeys(("iso-8859-1", "latin1", "us-ascii", "windows-1252"), "cp1252"),
        **{"euc-jp": "euc_jp", "koi8-r": "koi8_r", "iso-8859-2": "iso8859-2", "iso-8859-15": "iso8859-15"},
        **{f"windows-{page}": f"cp{page}" for page in (1250, 1251, 1253, 1254, 1255, 1256, 1257)},
    }
)
"""Name of an encoding on web pages → its codec."""
_FIRST_BYTES: Final = 65_536
"""Bytes of a file that show its encoding."""


def decode(file: str, content: bytes) -> tuple[str, str]:
    """Return the text of a file, and the name of its encoding; tables of Markdown have tabs between cells.

    A byte order mark decides for UTF-8 or UTF-16. Without a mark, a zero among the first bytes means UTF-16,
    and valid UTF-8 is read as UTF-8. Of other encodings the one is used that a web page states, or in which
    most words of headers are known, else Latin-1 or Windows-1252, unless most bytes beyond ASCII are letters
    in UTF-8: then the file is damaged UTF-8. The end of a printed page is a blank.

    Raises:
        ImportFileError: the text is damaged, contains control characters, or has a row of a table of Markdown
            with too few cells.
    """
    remedy = "save the file as text in UTF-8"
    mark, encoding = next((entry for entry in _BYTE_ORDERS if content.startswith(entry[0])), (b"", ""))
    encoding = encoding or _find_utf16(content)
    try:
        text = content[len(mark) :].decode(encoding or "utf-8")
    except UnicodeDecodeError as error:
        other = "" if encoding else _find_stated(content) or _find_encoding(content)
        if encoding or (not other and _is_mostly_utf8(content)):
            line = None if encoding else 1 + content.count(b"\n", 0, error.start)
            reason = (
                f"the text is damaged: its other bytes are {(encoding or 'utf-8').upper()}, but byte "
                f"{error.start + 1} is not valid in this encoding"
            )
            raise ImportFileError(Place(file, line), reason, remedy) from None
        encoding = other or _find_western(content)
        text = content.decode(encoding)
    text = text.replace("\f", " ")  # the end of a printed page
    if control := _CONTROL.search(text):
        reason = f"the file contains the control character {control.group()!a}, so it is not plain text"
        raise ImportFileError(Place(file, 1 + text.count("\n", 0, control.start())), reason, remedy)
    return write_tables_plainly(file, text), encoding or "utf-8"


def describe_encoding(encoding: str | None) -> list[str]:
    """Return the note that an encoding was assumed; none for UTF-8 and UTF-16, which bytes show."""
    name = _NAMES.get(encoding or "")
    return [] if name is None else [f"the file is not valid UTF-8, so it was read as {name}: check the names"]


def _find_utf16(content: bytes) -> str:
    """Return the encoding of two bytes for each letter that zeros among the first bytes show; else no name.

    The upper byte of a letter of ASCII is zero.
    """
    first = content[:_FIRST_BYTES]
    upper_first, upper_last = first[::2].count(0), first[1::2].count(0)
    is_utf16 = b"\0" in content[:4] or 4 * (upper_first + upper_last) > len(first)
    if not is_utf16:
        return ""
    return "utf-16-be" if upper_first > upper_last else "utf-16-le"


def _find_stated(content: bytes) -> str:
    """Return the encoding that a web page states, if its bytes are valid in the encoding; else no name."""
    found = _STATED.search(content[:_FIRST_BYTES_OF_PAGE])
    label = found[1].decode("ascii").casefold() if found else ""
    encoding = _ENCODING_OF_LABEL.get(label, "")
    return encoding if encoding and _can_be_decoded(content, encoding) else ""


def _find_encoding(content: bytes) -> str:
    """Return the encoding in which most words of headers are known; empty without words, or for equally many.

    One short word may be there by chance, and a word in ASCII is the same in all encodings: these show no
    encoding. No byte of a letter in these encodings is a line break.
    """
    first = content[:_FIRST_BYTES].rpartition(b"\n")[0] if len(content) > _FIRST_BYTES else content
    known = {name: _find_words(first, name, words) for name, words in WORDS_OF_ENCODINGS.items()}
    most = max(map(len, known.values()))
    found = [name for name, words in known.items() if len(words) == most]
    if len(found) > 1:
        return ""
    words = {word for word in known[found[0]] if not word.isascii()}
    is_clear = bool(words) and (most > 1 or any(map(_is_long, words)))
    return found[0] if is_clear and _can_be_decoded(content, found[0]) else ""


def _find_western(content: bytes) -> str:
    """Return Latin-1, or Windows-1252 for a text with its typographic signs."""
    has_signs = any(0x80 <= byte < 0xA0 for byte in content)
    return _WINDOWS if has_signs and _can_be_decoded(content, _WINDOWS) else _LATIN1


def _find_words(content: bytes, encoding: str, words: Sequence[str]) -> set[str]:
    """Return which of some words a text in an encoding has; none for a text that is not in it."""
    if not _can_be_decoded(content, encoding):
        return set()
    text = content.decode(encoding).casefold()
    return {word for word in words if word in text}


def _is_long(word: str) -> bool:
    """Return whether a word is hardly there by chance: it has four letters, or two of East Asia."""
    is_east_asian = all(east_asian_width(letter) in "WF" for letter in word)
    return len(word) >= (2 if is_east_asian else 4)


def _can_be_decoded(content: bytes, encoding: str) -> bool:
    """Return whether bytes are valid in an encoding."""
    try:
        content.decode(encoding)
    except UnicodeDecodeError:
        return False
    return True


def _is_mostly_utf8(content: bytes) -> bool:
    """Return whether most bytes beyond ASCII are those of letters in UTF-8."""
    valid_count = sum(map(len, _UTF8_SEQUENCE.findall(content)))
    return 2 * valid_count > len(content.translate(None, delete=_ASCII))
