"""Programs of FANUC (.LS, ASCII of TP): the instructions that are understood, and the /POS section."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np

from jointstiff.service.programs.errors import shown
from jointstiff.service.programs.forms import Forms
from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import FrameName, Literal, Motion
from jointstiff.service.programs.reader import Place, Reader, Script, Statement, words
from jointstiff.service.programs.scanner import Cursor, Lexicon, Misread

POSE: Final = Notation(Orientation.FIXED_XYZ, length_decimals=3, angle_decimals=3)
JOINTS: Final = Notation(Orientation.JOINTS, length_decimals=3, angle_decimals=3)
_MOTIONS: Final = {
    "J": Motion.JOINT,
    "L": Motion.LINEAR,
    "C": Motion.CIRCULAR,
    "A": Motion.CIRCULAR,
    "S": Motion.SPLINE,
}
_FIELDS: Final = (
    (POSE, ("X", "Y", "Z", "W", "P", "R"), "mm mm mm deg deg deg"),
    (JOINTS, ("J1", "J2", "J3", "J4", "J5", "J6"), "deg deg deg deg deg deg"),
)
_SPEEDS: Final = words("% mm cm inch deg sec msec max_speed WELD_SPEED")
_LEXICON: Final = Lexicon(
    comment=r":[^:\[\]\r\n]*+(?=\])|(?<=MESSAGE)\[[^\[\]\r\n]*+\]",  # what stands behind a number in brackets
    signs="<>|<=|>=",
    text=r"'[^'\r\n]*+'",
    word=r"[$]?[^\W\d]\w*+",
    folded=False,
    operators=words(". = <> < > <= >= AND OR NOT DIV MOD"),
    prefixes=words("+ - NOT !"),
    functions=words("WAIT ABS SQRT SIN COS TAN LN EXP ROUND TRUNC ATAN2 ASIN ACOS MOD"),
    reserved=words(
        """
        JMP CALL RUN LBL IF THEN ELSE ENDIF FOR TO DOWNTO ENDFOR SELECT INC OFFSET Offset Skip SKIP VOFFSET
        TOOL_OFFSET
        """
    ),
)
_REMEDY: Final = (
    "write positions in numbers, in /POS: no PR[], no P[R[]]; choose frames by numbers, on lines of their own"
)
_AGAIN: Final = "record the position again"
_STANDS: Final = 2e-3
"""Difference of another group [mm, °] that is rounding."""


@dataclass
class _Program(Script):
    """The state of a program while it is read."""

    frames: dict[tuple[str, str], FrameName] = field(default_factory=dict)  # frames by UF or UT, and number
    current: dict[str, str] = field(default_factory=dict)  # active UFRAME_NUM and UTOOL_NUM
    arc: tuple[Place, int] | None = None  # an arc whose end is still to come, and the number of its via point
    others: list[float] | None = None  # where the other groups stand
    recorded: set[str] = field(default_factory=set)  # names of positions, also of refused ones

    def position(self, place: Place, number: int, literal: Literal, others: tuple[int, ...]) -> None:
        """Take a position of /POS."""
        name, values = f"P[{place.value(number):g}]", [place.value(i) for i in others]
        before = self.others = values if self.others is None else self.others
        stand = len(values) == len(before) and all(
            abs(a - b) <= _STANDS for a, b in zip(values, before, strict=True)
        )
        if name in self.recorded or not stand:
            fault = "comes twice" if stand else "moves another group"
            self.refuse(place, f"{name} {fault}", "leave GP2 ... unchanged, and give each position once")
        else:
            self.given[name] = place, literal
        self.recorded.add(name)

    def chosen(self, place: Place, which: str, *ordinals: int) -> None:
        """Take the active frame."""
        which = {"$MNUFRAMENUM": "UFRAME_NUM", "$MNUTOOLNUM": "UTOOL_NUM"}.get(which, which)
        number = f"{place.value(ordinals[-1]):g}"
        if self.current.get(which) != number and self.settable(place, which):
            self.current[which] = number

    def move(self, place: Place, letter: str, points: Sequence[int]) -> None:
        """Take a move to one position, or through one to another."""
        self.closed()
        if letter == "C" and len(points) == 1:
            self.arc = place, points[0]
        else:
            self._moved(place, letter, [(place, point) for point in points])

    def end_of_arc(self, place: Place, point: int) -> None:
        """Take the second position of an arc, which has a line of its own."""
        via, self.arc = self.arc, None
        if via is None:
            self.refuse(place, "a position has no motion command", "write J, L, C, A or S before it")
        else:
            self._moved(via[0], "C", [via, (place, point)])

    def closed(self) -> None:
        """Refuse an arc that has no end."""
        if self.arc is not None:
            self.refuse(self.arc[0], "the arc has no end point", "give its second position on the next line")
            self.arc = None

    def frame(self, kind: str, number: str) -> FrameName:
        """Return a frame; 0 is the robot's own: its base, or its flange."""
        pose = np.eye(4) if number == "0" else None
        return self.frames.setdefault((kind, number), FrameName(f"{kind} {number}", pose))

    def _moved(self, place: Place, letter: str, points: Sequence[tuple[Place, int]]) -> None:
        names, frames = [], []
        for where, ordinal in points:
            name = f"P[{where.value(ordinal):g}]"
            known = self.given.get(name)
            if known is None:
                if name not in self.recorded:  # else refused already
                    self.refuse(where, f"the target {shown(name)} is not in /POS")
                return
            at, literal = known
            used = [literal.texts.get(kind) or f"{at.value(literal.fields[kind]):g}" for kind in ("UF", "UT")]
            for which, number in zip(("UFRAME_NUM", "UTOOL_NUM"), used, strict=True):
                if number.isdigit() and self.current.get(which, number) != number:
                    reason = f"{name} is recorded with another {which} than the active one"
                    self.refuse(where, reason, "activate the frame that it is recorded with")
            frames.append((self.frame("UF", used[0]), self.frame("UT", used[1])))
            names.append(name)
        self.targeted(place, _MOTIONS[letter], names, frames)


# /MN


def _parse(c: Cursor) -> Iterator[Statement]:
    """Parse a line of /MN behind its number and colon, or a position of /POS."""
    if c.at("P") and c.text.endswith("};"):
        yield _position(c)
        return
    c.accept(";")
    if c.ended:
        return
    yield _instruction(c)
    c.accept(";")
    c.finish()


def _instruction(c: Cursor) -> Statement:
    if c.at("P"):  # the end of an arc
        return Statement(act=partial(_Program.end_of_arc, point=_point(c)), calls=_tail(c))
    if c.at(*_MOTIONS) and c.peek(1).text in {"P", "PR"}:
        letter = c.word()
        points = [_point(c)]
        if letter == "C" and c.at("P", "PR"):
            points.append(_point(c))
        act = partial(_Program.move, letter=letter, points=tuple(points))
        return Statement(act=act, calls=_tail(c))
    return _FORMS.take(c)


def _point(c: Cursor) -> int:
    """Take P[n]."""
    if numbers := c.taken("P[n]"):
        return numbers[0]
    raise c.misread("the target is not a position of /POS", _REMEDY)


_SPEED: Final = Forms("plain R [ e* ]", whole=False)
_TAIL: Final = Forms(
    """
    plain  FINE|Wjnt|PTH|BREAK|MROT
    plain  CNT|CR|CD|ACC|AP_LD|RT_LD n
    plain  CNT|ACC R [ e ]
    plain  EV n %
    plain  SPOT [ e* ]
    plain  Arc Start|End [ e* ]
    plain  TB|TA|DB n ?sec ?mm , CALL c
    plain  TB|TA|DB n ?sec ?mm , DO|RO|GO|AO [ e ] = e
    """,
    whole=False,
)
"""What may stand behind a target: it leaves the target where it is."""


def _tail(c: Cursor) -> frozenset[str]:
    """Take speed, termination and options of a move; return the routines that it calls."""
    calls: frozenset[str] = frozenset()
    if c.at("R"):
        calls = _SPEED.take(c).calls
    elif c.peek().kind == "number":
        c.take()
    if c.accept(*_SPEEDS) and c.accept("/"):
        c.expect("sec", "min")
    while not c.ended and not c.at(";"):
        if re.fullmatch(r"(?:CNT|CR|CD|ACC|AP_LD|RT_LD)\d++", c.peek().text):
            c.take()
        elif c.peek().text in _TAIL:
            calls |= _TAIL.take(c).calls
        else:
            raise c.misread("the text after the target moves it, or is unknown", _REMEDY)
    return calls


_LED: Final = "\n".join(  # what a condition leads to
    f"{effect} {head} {action}"
    for head in ("IF e ,", "SELECT R [ e ] = e ,", "= e ,", "ELSE ,")
    for effect, action in (
        ("jump", "JMP LBL [ e* ]"),
        ("plain", "CALL c"),
        ("plain", "DO|RO|GO|AO|R|F|WO [ e ] = e"),
        ("plain", "DO|RO [ e ] = PULSE , n ?sec"),
    )
)
_FORMS: Final = Forms(
    """
    plain  R|SR|F|DO|RO|GO|AO|WO|M|TIMER|PR|PL|AR|VR [ e* ] = e
    plain  PR [ e* ] . w = e
    plain  DO|RO [ e ] = PULSE , n ?sec
    plain  WAIT n ( sec )
    plain  WAIT R [ e ] ( sec )
    plain  WAIT e
    jump   WAIT e TIMEOUT , LBL [ e* ]
    open   IF e THEN
    plain  ELSE
    close  ENDIF|ENDFOR
    open   FOR R [ e ] = e TO|DOWNTO e
    jump   LBL [ e* ]
    jump   JMP LBL [ e* ]
    plain  CALL|RUN|MONITOR c
    plain  OVERRIDE = e ?%
    plain  LINEAR_MAX_SPEED = e
    plain  JOINT_MAX_SPEED [ e ] = e
    plain  PAUSE|ABORT|END|MESSAGE|REMARK|TC_ONLINE|STOP_TRACKING
    plain  PAYLOAD|UALM|DIAG_REC|SPOT [ e* ]
    plain  RSR [ e ] = e
    plain  Arc Start|End [ e* ]
    plain  COL DETECT ON|OFF
    plain  COL GUARD ADJUST e
    frame  UFRAME_NUM|UTOOL_NUM = n
    frame  $MNUFRAMENUM|$MNUTOOLNUM [ n ] = n
    """
    + _LED,
    frame=_Program.chosen,
)


# /POS

_GROUP: Final = re.compile(r"GP\d")


def _position(c: Cursor) -> Statement:
    """Take P[n]{ GP1: UF : …, UT : …, CONFIG : '…', X = … mm, … };."""
    number, literal, others = _point(c), None, tuple[int, ...]()
    c.expect("{")
    while not c.at("}"):
        group = "GP1"
        if _GROUP.fullmatch(c.peek().text):
            group = c.take().text
            c.accept(":")
        fields = _group(c, own=group == "GP1")
        if group != "GP1":
            others += tuple(fields.fields.values())
        elif literal is None:
            literal = fields
        else:
            raise Misread("a position has two groups GP1", _AGAIN)
    c.expect("}")
    c.expect(";")
    c.finish()
    if literal is None:
        raise Misread("the position has no group GP1", "only the arm of group 1 is supported")
    return Statement(act=partial(_Program.position, number=number, literal=literal, others=others))


def _group(c: Cursor, *, own: bool) -> Literal:
    """Take the numbers of a group, and its frames and configuration."""
    numbers: dict[str, int] = {}
    texts: dict[str, str] = {}
    units: dict[str, str] = {}
    words: tuple[tuple[str, int], ...] = ()
    while not c.at("}") and not _GROUP.fullmatch(c.peek().text):
        name = c.name()
        c.expect(":", "=")
        if name in numbers or name in texts:
            raise Misread(f"{name} occurs twice in a position", _AGAIN)
        if name == "CONFIG":
            texts[name], words = _configuration(c)
        elif c.peek().kind == "number":
            numbers[name] = c.number()
            units[name] = _unit(c)
        elif name in {"UF", "UT"} and c.at("F"):
            texts[name] = c.take().text
        else:
            texts[name] = c.expect("*").text
            while c.accept("*"):
                pass
            _unit(c)
        c.accept(",")
    if own:
        return _whole(numbers, texts, units, words)
    return Literal(None, fields={name: i for name, i in numbers.items() if name not in {"UF", "UT"}})


def _whole(
    numbers: dict[str, int], texts: dict[str, str], units: dict[str, str], said: tuple[tuple[str, int], ...]
) -> Literal:
    """Return a position of the arm."""
    if any(text == "*" and not name.startswith("E") for name, text in texts.items()):
        raise Misread("the position was not recorded (***)", "record it, or delete it and its moves")
    if not numbers.keys() | texts.keys() >= {"UF", "UT"}:
        raise Misread("the position has no UF and UT", _AGAIN)
    for notation, names, needed in _FIELDS:
        if all(name in numbers for name in names):
            if [units[name] for name in names] != needed.split():
                raise Misread("the position is not in mm and deg", "write it with the controller set to mm")
            external = tuple(i for name, i in sorted(numbers.items()) if re.fullmatch(r"E\d", name))
            place, letters = tuple(numbers[name] for name in names), "".join(texts.get("CONFIG", "").split())
            return Literal(notation, place, external, said, letters, numbers, texts)
    raise Misread("the position is neither X, Y, Z, W, P, R nor J1 ... J6", _AGAIN)


def _unit(c: Cursor) -> str:
    """Take the unit behind a number, if there is one."""
    stands = c.peek().kind == "word" and c.peek(1).text not in {"=", ":"}
    return c.take().text.lower() if stands else ""


_CONFIG: Final = re.compile(
    r"'([^',]*+),\s*+([+-]?\d{1,9})\s*+,\s*+([+-]?\d{1,9})\s*+,\s*+([+-]?\d{1,9})\s*+'"
)


def _configuration(c: Cursor) -> tuple[str, tuple[tuple[str, int], ...]]:
    """Take CONFIG: its letters, and the turn numbers of axes 1, 4 and 6."""
    token = c.take()
    if token.kind != "text":
        raise Misread("the configuration is not known", _AGAIN)
    match = _CONFIG.fullmatch(token.text)
    if not match:
        return token.text.strip("'").partition(",")[0], ()
    begins = {each.start(): i for i, each in enumerate(_LEXICON.numbers.finditer(c.text))}
    turns = [begins.get(token.start + match.start(k), -1) for k in (2, 3, 4)]
    return match[1], tuple(zip(("turn1", "turn4", "turn6"), turns, strict=True)) if min(turns) >= 0 else ()


_ORDER: Final = ("PROG", "ATTR", "APPL", "MN", "POS", "END")
_SECTION: Final = re.compile(r"/(PROG|ATTR|APPL|MN|POS|END)\b.*+")
_LINE: Final = re.compile(r"\s*+(\d*+)\s*+:")
_POSITION: Final = re.compile(r"(P.*?\};)|\S[^P]*+", re.DOTALL)
_ARC: Final = re.compile(r"\s*+P\s*+\[")


def read_fanuc(reader: Reader) -> None:
    """Read a .LS file."""
    source, sections, here = reader.sources[0], dict[str, int](), ""
    instructions: list[tuple[int, int]] = []
    for line, (start, end) in enumerate(zip(source.starts.tolist(), source.ends.tolist(), strict=True), 1):
        text = source.text[start:end].rstrip("\r\n")
        if match := _SECTION.match(text):
            if match[1] in sections or _ORDER.index(match[1]) < max(map(_ORDER.index, sections), default=0):
                reader.refuse(line, f"a second or misplaced /{match[1]}", "send one program")
                return
            here, sections[match[1]] = match[1], start + len(text)
        elif here == "MN" and text.strip():
            instructions += _instructions(reader, line, start, text)
        elif here == "END" and text.strip():
            reader.refuse(line, "there is text after /END", "send one program")
    if "MN" not in sections or "POS" not in sections:
        remedy = "write the program as ASCII (.LS), not as binary (.TP)"
        reader.refuse(None, "the file has no /MN and /POS", remedy)
        return
    end = sections["END"] - len("/END") if "END" in sections else len(source.text)
    program = _Program(reader, _LEXICON, _parse, _REMEDY, ordered=False)
    for parts in (_positions(reader, sections["POS"], end), instructions):
        program.add(0, *np.array(parts, dtype=np.intp).reshape(-1, 2).T)
    program.run()
    program.closed()


def _instructions(reader: Reader, line: int, start: int, text: str) -> list[tuple[int, int]]:
    """Return first and last + 1 character of the instruction of a line of /MN; none for a remark."""
    head = _LINE.match(text)
    body = head.end() if head else 0
    if head or _ARC.match(text):
        remark = text[body:].lstrip().startswith(("!", "//", "--"))
        return [] if remark else [(start + body, start + len(text))]
    remedy = "write the program in the controller's form"
    reader.refuse(line, f"the line {shown(text)} has no number and colon", remedy)
    return []


def _positions(reader: Reader, place: int, end: int) -> list[tuple[int, int]]:
    """Return first and last + 1 character of the positions of /POS."""
    source, spans = reader.sources[0], list[tuple[int, int]]()
    for match in _POSITION.finditer(source.text, place, end):
        if match[1] is None:
            reason = f"{shown(match[0])} between positions is unknown or has no end"
            reader.refuse(source.line(match.start()), reason, _AGAIN)
            break
        spans.append(match.span())
    return spans
