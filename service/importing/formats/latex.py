"""Tables of LaTeX, environments such as `tabular`, with the texts around them.

Commands for fonts are left out, `{,}` is a comma, and `multicolumn` makes a merged cell. Any other command
stays in the text of its cell, which is then no number.

The reader goes through the text once, without recursion. pylatexenc (2.11) needs quadratic time for blanks,
and a recursion for each brace.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final
from unicodedata import normalize

from jointstiff.service.importing.errors import ImportFileError, Place
from jointstiff.service.importing.formats.documents import Cell, Document, Table
from jointstiff.service.importing.grid import LEAST_NUMBERS, Grid, count_numbers
from jointstiff.service.importing.texts.encoding import decode

_MARKS: Final = tuple("\\%{}&$~^_\n")
_ARGUMENTS_OF_TABLES: Final[Mapping[str, int]] = MappingProxyType(
    {"tabular": 1, "tabular*": 2, "tabularx": 2, "tabulary": 2, "longtable": 1, "tblr": 1, "longtblr": 1}
)
"""Environment of a table → arguments before the first cell."""
_FLOATS: Final = frozenset(("table", "table*", "sidewaystable", "threeparttable"))
"""Environments around a table, with its caption."""
_TOKEN: Final = re.compile(
    r"%[^\n]*\n?[ \t]*|\\(?:[A-Za-z]+\*?[ \t]*|.|\Z)|[{}&$~^_\n]|[^\\%{}&$~^_\n]+", re.DOTALL
)
"""A comment, a command, a sign with a meaning, or a text."""
_NAME: Final = re.compile(r"[ \t]*\{([A-Za-z]+\*?)\}")
_OPTION: Final = re.compile(r"\s*\[[^\[\]{}\n]{0,200}\]")
_PARENTHESES: Final = re.compile(r"\s*\([^(){}\n]{0,20}\)")
_BRACE: Final = re.compile(r"\\.|[{}]", re.DOTALL)
_BEFORE_BRACE: Final = re.compile(r"\s*(?=\{)|\*")
_DASHES: Final = re.compile(r"-{2,3}")
_WORD_IN_BRACES: Final = re.compile(r"\{[^{}]{2}")

_ARGUMENTS_WITHOUT_TEXT: Final[Mapping[str, int]] = MappingProxyType(
    {
        **dict.fromkeys(("hline", "toprule", "midrule", "bottomrule", "addlinespace"), 0),
        **dict.fromkeys(("cline", "cmidrule", "label", "ref", "cite", "footnote", "tnote", "noalign"), 1),
        **dict.fromkeys(("rowcolor", "cellcolor", "color", "textcolor", "hspace", "vspace", "rotatebox"), 1),
        **dict.fromkeys(("phantom", "hphantom", "vphantom", "sout", "st", "cancel"), 1),
        "multirow": 2,
        "specialrule": 3,
    }
)
"""Command → its first arguments, which are no text, or a text that is not printed or struck out."""
_STYLES: Final = frozenset(
    (
     "textbf", "textit", "textrm", "textsf", "texttt", "textsc", "textup", "textnormal", "textmd", "emph",
     "text", "mbox", "underline", "num", "bf", "it", "rm", "sf", "tt", "mathbf", "mathrm", "mathit",
     "mathsf", "mathtt", "bm", "boldsymbol", "ensuremath", "bfseries", "itshape", "ttfamily", "sffamily",
     "upshape", "centering", "raggedright", "raggedleft", "footnotesize", "small", "tiny", "scriptsize",
     "normalsize", "large", "Large", "left", "right", "displaystyle", "hfill", "noindent", "makecell",
     "shortstack", "thead", "SI", "qty", "si", "unit", "ang", "caption", "section", "subsection", "title",
     "paragraph"
    )
)  # fmt: skip
"""Commands that choose a font or a place, or whose argument is a text."""
_ENDS_OF_REPEATED_ROWS: Final = ("endfirsthead", "endhead", "endfoot", "endlastfoot")
"""Commands behind rows of a `longtable` that are its first head, or are printed on each page."""
_QUANTITIES: Final = frozenset(("SI", "qty"))
"""Commands with a number and its unit."""
_SIGNS: Final[Mapping[str, str]] = MappingProxyType(
    {
        **{sign: sign for sign in "%&_#${}"},
        **dict.fromkeys((",", ";", ":", " ", "\n", "\t", "\\", "quad", "qquad", "newline"), " "),
        **dict.fromkeys(("!", "-", "/", "", "(", ")", "@"), ""),
        **dict.fromkeys(("circ", "degree", "textdegree"), "°"),
        **dict.fromkeys(("mu", "micro", "textmu"), "µ"),
        **{"textminus": "-", "pm": "±", "cdot": "·", "times": "×", "ss": "ß", "o": "ø", "O": "Ø", "l": "ł"},
        **{"L": "Ł", "ae": "æ", "AE": "Æ", "oe": "œ", "OE": "Œ", "aa": "å", "AA": "Å", "i": "i", "j": "j"},
        **{"newton": "N", "kilogram": "kg", "gram": "g", "metre": "m", "meter": "m", "radian": "rad"},
        **{"milli": "m", "kilo": "k", "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "Delta": "Δ"},
        **{"theta": "θ", "phi": "φ", "varphi": "φ"},
    }
)
"""Command → its sign."""
_ACCENTS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "`": "\u0300", "'": "\u0301", "^": "\u0302", "~": "\u0303", "=": "\u0304", "u": "\u0306",
        ".": "\u0307", '"': "\u0308", "r": "\u030a", "H": "\u030b", "v": "\u030c", "c": "\u0327",
        "k": "\u0328",
    }
)  # fmt: skip
"""Command → accent of the next letter."""


def read_latex(file: str, content: bytes, stated: str | None) -> list[Grid]:
    """Return the tables of a text in LaTeX as grids; none without a row of numbers.

    Args:
        file: name of the file, for messages.
        content: bytes of the file.
        stated: names of tables, which are their captions, with semicolons between; None for all.

    Raises:
        ImportFileError: the text is damaged or beyond a limit, or has no table of a name.
    """
    text, encoding = decode(file, content)
    reader = _LatexReader(file, text.replace("\r\n", "\n").replace("\r", "\n"))
    reader.read()
    return reader.document.build_grids(encoding, stated)


class _LatexReader:
    """Reader of a text in LaTeX, from its first to its last token."""

    def __init__(self, file: str, text: str, *, is_caption: bool = False) -> None:
        self.document = Document(file, text, _MARKS)
        self._text, self._position, self._line = text, 0, 1
        self._pieces = list[str]()  # plain text of the open cell, or of the line outside tables
        self._first_line = 0  # line of the first text of the open row or line; 0 before one
        self._accent = ""  # of the next letter
        self._is_mathematics = False  # whether the text is between signs of dollar, where `--` is no dash
        self._is_unit_next = False  # whether the next argument is the unit of a number
        self._table: Table | None = None  # the open table
        self._depth = 0  # open braces in the table
        self._inner_count = 0  # tables that are open within the open cell
        self._cells = list[Cell]()  # of the open row
        self._column_count = 1  # of the open cell
        self._head_start: int | None = None  # row behind the first head of a `longtable`
        self._caption = ""  # of the next table
        self._float_start = 0  # tables before the float that is open
        self._actions: dict[str, Callable[[], None]] = {"begin": self._begin, "end": self._end}
        if not is_caption:  # else captions within captions would be read again and again
            self._actions["caption"] = self._read_caption
        self._actions_in_row: Mapping[str, Callable[[], None]] = {
            **dict.fromkeys(("\\", "tabularnewline", "cr"), self._end_row),
            "multicolumn": self._merge_columns,
        }

    def read(self) -> None:
        """Read all tables and texts.

        Raises:
            ImportFileError: a table or an argument is cut off, or a limit is exceeded.
        """
        while self._position < len(self._text):
            token = self._read_token()
            if token.startswith("%"):
                comment = token[: len(token.rstrip())]
                self.document.add_remark(self._line - token.count("\n"), comment.lstrip("% "))
            elif token.startswith("\\"):
                name = token[1:]
                self._read_command(name.rstrip(" \t") if len(name) > 1 else name)
            else:
                self._read_sign(token)
        if self._table is not None:
            raise self._build_error("the table has no end")
        self._end_remark()

    def _read_token(self) -> str:
        """Return the next token, and count its lines."""
        found = _TOKEN.match(self._text, self._position)
        token = found[0] if found else self._text[self._position]
        self._advance(self._position + len(token))
        return token

    def _advance(self, position: int) -> None:
        """Go on to a position, and count the lines up to it."""
        self._line += self._text.count("\n", self._position, position)
        self._position = position

    def _build_error(self, reason: str) -> ImportFileError:
        """Return the error that the table cannot be read at the current line."""
        place = Place(self.document.file, self._line)
        return ImportFileError(place, reason, "complete the table, or export it as CSV")

    # ---- texts and signs

    def _add_text(self, text: str) -> None:
        """Add a plain text to the open cell or line; the pending accent is that of its first letter."""
        if not self._first_line and text.strip():
            self._first_line = self._line
        if self._accent and text:
            text = normalize("NFC", text[0] + self._accent) + text[1:]
            self._accent = ""
        self._pieces.append(text)

    def _read_sign(self, sign: str) -> None:
        """Read a sign with a meaning, or a text."""
        if sign in ("{", "}"):
            self._read_brace(sign)
        elif sign == "&" and self._is_in_row():
            self._end_cell()
        elif sign == "\n" and self._table is None:
            self._end_remark()
        elif sign == "&" and self._table is not None and not self._inner_count:
            raise self._build_error("a cell ends within braces")
        elif sign in ("&", "\n", "~"):
            self._pieces.append(" ")
        elif sign == "_":
            self._add_index()
        elif sign == "$":
            self._is_mathematics = not self._is_mathematics
        else:
            self._add_text(sign if self._is_mathematics else _DASHES.sub("–", sign))

    def _read_brace(self, brace: str) -> None:
        """Read a brace, which prints nothing."""
        self._depth += 1 if brace == "{" else -1
        if self._table is not None and self._depth < 0:
            raise self._build_error("a brace has no beginning")
        if brace == "}" and self._is_unit_next:
            self._pieces.append(" ")
            self._is_unit_next = False
        self._accent = self._accent if brace == "{" else ""

    def _add_index(self) -> None:
        """Add what is between a letter and its index: nothing in `q_1`, a blank in `x_{loaded}`."""
        last = self._pieces[-1][-1:] if self._pieces and self._is_mathematics else ""
        is_word = _WORD_IN_BRACES.match(self._text, self._position) is not None
        of_letter = " " if is_word else ""
        self._add_text(of_letter if last.isalpha() else "_")

    def _pop_text(self) -> str:
        """Return the plain text of the open cell or line, and begin another."""
        text = "".join(self._pieces).replace("^°", "°")
        self._pieces.clear()
        self._accent, self._is_mathematics = "", False
        return text

    def _end_remark(self) -> None:
        """End a line outside tables."""
        self.document.add_remark(self._first_line, self._pop_text())
        self._first_line = 0

    # ---- commands

    def _read_command(self, name: str) -> None:
        """Read a command behind its name, with the arguments that are no text."""
        action = self._actions.get(name)
        if action is None and self._is_in_row():
            action = self._actions_in_row.get(name)
        if action is not None:
            action()
        elif name in _ENDS_OF_REPEATED_ROWS and self._table is not None:
            self._end_repeated_rows(self._table, name)
        else:
            self._write_command(name)

    def _write_command(self, name: str) -> None:
        """Add what a command prints, or the command itself if that is not known."""
        if name in _ACCENTS and self._is_letter_next():
            self._accent = _ACCENTS[name]
        elif name in _ARGUMENTS_WITHOUT_TEXT:
            self._skip_arguments(_ARGUMENTS_WITHOUT_TEXT[name])
        elif name in _SIGNS:
            self._add_text(_SIGNS[name])
        elif name in _STYLES:
            self._skip_pattern(_OPTION)
            self._is_unit_next = name in _QUANTITIES
        else:
            self._add_text(f"\\{name} ")

    def _is_letter_next(self) -> bool:
        """Return whether a letter may be next, in braces or as a command."""
        following = self._text[self._position : self._position + 1]
        return following.isalpha() or following in ("{", "\\")

    def _skip_pattern(self, pattern: re.Pattern[str]) -> None:
        """Skip what a pattern finds at the current position."""
        if found := pattern.match(self._text, self._position):
            self._advance(found.end())

    def _skip_arguments(self, count: int) -> None:
        """Skip options and a number of arguments in braces."""
        self._skip_pattern(_OPTION)
        self._skip_pattern(_PARENTHESES)
        for _ in range(count):
            self._read_argument()
            self._skip_pattern(_OPTION)

    def _read_argument(self) -> str:
        """Return an argument in braces without these; empty without one.

        Raises:
            ImportFileError: the argument has no end.
        """
        self._skip_pattern(_BEFORE_BRACE)
        start, depth = self._position, 0
        if not self._text.startswith("{", start):
            return ""
        for found in _BRACE.finditer(self._text, start):
            depth += {"{": 1, "}": -1}.get(found[0], 0)
            if depth == 0:
                self._advance(found.end())
                return self._text[start + 1 : found.start()]
        raise self._build_error("an argument in braces has no end")

    # ---- tables

    def _is_in_row(self) -> bool:
        """Return whether a cell or a row may end here: outside of braces, and of a table in the cell."""
        return self._table is not None and self._depth == self._inner_count == 0

    def _begin(self) -> None:
        """Read the beginning of an environment; a table within a cell is a cell of several lines."""
        found = _NAME.match(self._text, self._position)
        name = found[1] if found else ""
        self._skip_arguments(1 + _ARGUMENTS_OF_TABLES.get(name, 0))
        if name in _FLOATS:
            self._float_start = len(self.document.tables)
            self._caption = ""
        if name not in _ARGUMENTS_OF_TABLES:
            return
        if self._table is not None:
            self._inner_count += 1
            return
        self._end_remark()
        self._table = Table(self._caption)
        self._caption = ""
        self._depth, self._head_start = 0, None
        self.document.tables.append(self._table)

    def _end(self) -> None:
        """Read the end of an environment."""
        name = self._read_argument()
        if name not in _ARGUMENTS_OF_TABLES or self._table is None:
            return
        if self._inner_count:
            self._inner_count -= 1
            return
        if self._depth:
            raise self._build_error("a brace has no end")
        self._end_row()
        self._table = None

    def _end_cell(self) -> None:
        """End the open cell."""
        self._cells.append(Cell(self._pop_text(), self._column_count))
        self._column_count = 1

    def _end_row(self) -> None:
        """End the open row."""
        self._end_cell()
        if self._table is not None:
            self.document.add_row(self._table, self._first_line, self._cells)
        self._cells, self._first_line = [], 0
        self._skip_pattern(_OPTION)

    def _merge_columns(self) -> None:
        """Read how many columns the open cell covers; its text is next."""
        count = self._read_argument().strip()
        if not re.fullmatch(r"[1-9][0-9]{0,3}", count):
            raise self._build_error("a merged cell does not state how many columns it covers")
        self._column_count = int(count)
        self._read_argument()

    def _end_repeated_rows(self, table: Table, name: str) -> None:
        """Leave out the rows of a `longtable` that are printed again on each page, but for the first head."""
        is_first_head = self._head_start is None and name in _ENDS_OF_REPEATED_ROWS[:2]
        if not is_first_head:
            repeated = table.rows[self._head_start or 0 :]
            if any(count_numbers(row) >= LEAST_NUMBERS for row in repeated):
                raise self._build_error("a head or foot that is printed on each page has numbers")
            del table.rows[self._head_start or 0 :]
        self._head_start = len(table.rows)

    def _read_caption(self) -> None:
        """Read the caption of the open table, of the last one in the float, or else of the next one."""
        self._skip_pattern(_OPTION)
        line = self._line
        argument = _LatexReader(self.document.file, self._read_argument(), is_caption=True)
        argument.read()
        caption = " ".join(remark.text for remark in argument.document.remarks)
        self.document.add_remark(line, caption)
        in_float = self.document.tables[self._float_start :]
        if self._table is not None:
            self._table.title = caption
        elif in_float and not in_float[-1].title:
            in_float[-1].title = caption
        else:
            self._caption = caption
