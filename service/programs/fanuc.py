"""Programs of FANUC (.LS, ASCII of TP), translated: /MN and /POS."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from jointstiff.service.programs.errors import shown
from jointstiff.service.programs.interpreter import Dialect, Machine
from jointstiff.service.programs.language import (
    Assign,
    Call,
    Copy,
    Flow,
    Havoc,
    Lexicon,
    Line,
    Misread,
    Move,
    Name,
    Named,
    Op,
    complete,
    unknown,
)
from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import Literal, Motion, Source
from jointstiff.solver.arrays import IndexArray

POSE: Final = Notation(Orientation.FIXED_XYZ, length_decimals=3, angle_decimals=3)
JOINTS: Final = Notation(Orientation.JOINTS, length_decimals=3, angle_decimals=3)
_MOTIONS: Final = {
    "J": Motion.JOINT, "L": Motion.LINEAR, "C": Motion.CIRCULAR, "A": Motion.CIRCULAR, "S": Motion.SPLINE
}  # fmt: skip
_FIELDS: Final = (
    (POSE, ("X", "Y", "Z", "W", "P", "R"), "mm mm mm deg deg deg"),
    (JOINTS, ("J1", "J2", "J3", "J4", "J5", "J6"), "deg deg deg deg deg deg"),
)
# Facts. Source: FANUC R-30iB, operator's manual (basic operation) B-83284EN, chapter 4; alarm codes
# B-83284EN-1. A position states its UF and UT; if others are active, the controller stops (INTP-252, 253). F
# takes the active one. Registers, signals, timers, messages, speeds, collision detection: no position and no
# frame changes by them.
_QUIET: Final = re.compile(
    r"(?:R|SR|F|DO|RO|GO|AO|WO|M|TIMER|PR|PL|AR|VR|RSR|JOINT_MAX_SPEED)\[([^\]]*(?:\][^\]=]*)*?)\](?:\.\w+)?=(.+)"
    r"|(?:WAIT|OVERRIDE=|LINEAR_MAX_SPEED=) ?(.+?)(?:\(sec\)| ?%)?"
    r"|(?:PAUSE|ABORT|END|MESSAGE|REMARK|TC_ONLINE|STOP_TRACKING|COL DETECT (?:ON|OFF)|-+)"
    r"|(?:PAYLOAD|UALM|DIAG_REC|SPOT|Arc (?:Start|End))\[(.*)\]|COL GUARD ADJUST ?(.+)"
)
# Behind a target, what leaves it where it is: termination, acceleration, configuration, spots and signals
_TAIL: Final = re.compile(
    r"(?:\0|R\[[^\[\]]*\])?(?: ?(?:%|(?:mm|cm|inch|deg)/(?:sec|min)|sec|msec|max_speed|WELD_SPEED))?"
    r"(?: ?(?:FINE|Wjnt|PTH|BREAK|MROT|(?:CNT|CR|CD|ACC|AP_LD|RT_LD)(?:\d++| ?\0)|(?:CNT|ACC) ?R\[[^\[\]]*\]"
    r"|EV ?\0%"
    r"|(?:SPOT|Arc (?:Start|End)) ?\[[^\[\]]*\]"
    r"|(?:TB|TA|DB) ?\0 ?(?:sec|mm)?,(?:CALL ?\w++(?:\([^()]*\))?|(?:DO|RO|GO|AO)\[[^\[\]]*\]=\w++)))*"
)
# Behind it, what moves this target only: an increment, an offset, coordinated motion, a remote tool
_OFFSETS: Final = (
    r"(?:INC|RTCP|COORD(?:\[[^\[\]]*\])?|(?:Tool_)?Offset(?:,PR\[[^\[\]]*\])?|VOFFSET,VR\[[^\[\]]*\])"
)
_OFFSET: Final = re.compile(rf"(?:^| ){_OFFSETS}(?: |$)")
_ALL_OFFSETS: Final = re.compile(rf" ?{_OFFSETS}(?: {_OFFSETS})*")
_LEXICON: Final = Lexicon(
    comment=r":[^:\[\]\r\n]*+(?=\])|(?<=MESSAGE)\[[^\[\]\r\n]*+\]",  # what stands behind a number in brackets
    text=r"'[^'\r\n]*+'",
    word=r"[$]?[^\W\d]\w*+",
    folded=False,
    operators="AND|OR|NOT|DIV|MOD",
    reserved="JMP|CALL|RUN|LBL|IF|THEN|ELSE|ENDIF|FOR|TO|DOWNTO|ENDFOR|SELECT|INC|OFFSET|Offset|Skip|SKIP|VOFFSET|TOOL_OFFSET"
    r"|P(?=\[)",
    functions="WAIT|ABS|SQRT|SIN|COS|TAN|LN|EXP|ROUND|TRUNC|ATAN2|ASIN|ACOS|MOD",
)
_REMEDY: Final = (
    "write positions in numbers, in /POS: no PR[], no P[R[]]; choose frames by numbers, on lines of their own"
)
_AGAIN: Final = "record the position again"
_STANDS: Final = 2e-3
"""Difference of another group [mm, °] that is rounding."""
_MOTION: Final = re.compile(r"(?<![\w$.\[])[JLCAS] PR?\[")
_MOVE: Final = re.compile(r"([JLCAS]) P\[\0\] ?(P\[\0\] ?)?(.*)")
_ACTION: Final = r"(JMP LBL ?\[.*\]|CALL .+|(?:DO|RO|GO|AO|R|F|WO)\[[^=]*\]=.+)"
_STATEMENTS: Final = tuple(
    (kind, re.compile(pattern))
    for kind, pattern in (
        ("frame", r"(UFRAME_NUM|UTOOL_NUM)=(\0)|\$(MNUFRAMENUM|MNUTOOLNUM)\[\0\]=(\0)"),
        ("if", r"IF ?(.+?) ?THEN"),
        ("loop", r"FOR R\[(\0)\]=(.+?)(?: TO| DOWNTO) ?(.+)"),
        ("turn", "ELSE"),
        ("close", "ENDIF|ENDFOR"),
        ("label", r"LBL ?\[(\0)\]"),
        ("jump", r"JMP LBL ?\[(.*)\]"),
        ("waits", r"WAIT ?(.+?) ?TIMEOUT,LBL ?\[(.*)\]"),
        ("leads", rf"(?:IF ?(.+?)|SELECT ?(.+?)|=(.+?)|ELSE),{_ACTION}"),
        ("call", r"(?:CALL|RUN|MONITOR) (\w++)(?:\((.*)\))?"),
    )
)


def _translate(line: Line) -> list[tuple[int, Op]]:
    """Return what a line of /MN does, behind its number and colon."""
    text = re.sub(r" ?;?:", " ", line.text).strip(" ;")
    line = Line(text, line.ordinals, line.places, line.breaks)
    try:
        return complete(line, _MOTION, [(0, op) for op in (_ops(line, text) if text else ())], _REMEDY)
    except Misread as fault:
        return unknown(line, _MOTION, fault, _REMEDY)


def _ops(line: Line, text: str) -> list[Op]:
    if match := _MOVE.fullmatch(text):
        if bool(match[2]) != (match[1] == "C"):
            raise Misread(
                "an arc has two positions, another move has one; its second one is on the next line"
            )
        return _move(line, match[1], 1 + bool(match[2]), match[3])
    for kind, pattern in _STATEMENTS:
        if match := pattern.fullmatch(text):
            return _statement(line, kind, match)
    if match := _QUIET.fullmatch(text):
        return [op for each in match.groups() if each for op in _value(each)]
    frame = re.search(r"UFRAME|UTOOL", text)
    if re.match(r"P\[\0(?:,\0)?\]=", text):
        return [
            Havoc(
                frozenset({("P[%s]", line.ordinals[0])}),
                "the position changes while the program runs",
                _REMEDY,
            )
        ]
    if (place := re.search(r"(?<!\w)P\[", text)) and "=" in text[place.end() :]:
        return [Call("P[...]", attached=True)]
    raise Misread(
        "a frame is computed, or chosen in a branch"
        if frame
        else "the statement is unknown: it may move the robot; no position of /POS is a target of it"
    )


def _value(text: str) -> list[Op]:
    """Return what a value uses: `PULSE,0.2sec`, `ON` and `(…)` are values, too."""
    pulse = re.fullmatch(r"PULSE,\0 ?(?:sec)?", text)
    return [] if pulse else _LEXICON.expression(text.replace("!", ""))


def _statement(line: Line, kind: str, match: re.Match[str]) -> list[Op]:
    if kind == "frame":
        name = "UFRAME_NUM" if "UFRAME" in match[0] else "UTOOL_NUM"
        number = line.ordinal(match.start(2) if match[2] else match.start(4))
        return [Assign(name, Named(("UF %s" if name == "UFRAME_NUM" else "UT %s", number)))]
    if kind == "call":
        return [*_LEXICON.expression(match[2] or "", empty=True), Call(match[1])]
    if kind == "label":
        return [Flow(kind, ("%s", line.ordinal(match.start(1))))]
    if kind in {"jump", "waits"}:
        label = match[match.re.groups]
        start = match.start(match.re.groups)
        place: Name = ("%s", line.ordinal(start)) if label == "\0" else "\0"
        found = [] if kind == "jump" else _LEXICON.expression(match[1])
        return [*found, *([] if label == "\0" else _LEXICON.expression(label)), Flow("jump", place)]
    if kind == "leads":
        conditions = [
            op for each in match.groups()[:3] if each for op in _LEXICON.expression(each.replace("=", "+", 1))
        ]
        start, action = match.start(4), match[4]
        inner = Line(action, line.ordinals[line.text.count("\0", 0, start) :], (), ())
        ops = _ops(inner, action)
        skips = Flow("if"), Flow("close")
        return [*conditions, skips[0], *ops, skips[1]]
    given = [each for k, each in enumerate(match.groups()) if each and not (kind == "loop" and not k)]
    found = [op for each in given for op in _LEXICON.expression(each)]
    return [*found, Flow(kind)]


def _move(line: Line, letter: str, count: int, tail: str) -> list[Op]:
    """Return a move to one position, or through one to another."""
    ordinals = line.ordinals[:count]
    offset = _OFFSET.search(tail)
    shifts = tail[offset.start() :].rstrip() if offset else ""
    if not _TAIL.fullmatch(tail.removesuffix(shifts).rstrip()) or (
        shifts and not _ALL_OFFSETS.fullmatch(shifts)
    ):
        raise Misread(
            "the text after the target moves it, or is unknown; its position in /POS is not all that counts"
        )
    called: list[Op] = [Call(name, attached=True) for name in re.findall(r",CALL ?(\w++)", tail)]
    reason = f"{offset[0].strip()} moves the target" if offset else ""
    names = tuple(("P[%s]", ordinal) for ordinal in ordinals)
    bases = tuple(Copy(("P[%s].UF", ordinal), through=True) for ordinal in ordinals)
    tools = tuple(Copy(("P[%s].UT", ordinal), through=True) for ordinal in ordinals)
    return [
        *called,
        Move(
            _MOTIONS[letter],
            names,
            bases,
            tools,
            agree=("UFRAME_NUM", "UTOOL_NUM"),
            reason=reason,
            remedy=_REMEDY,
        ),
    ]


# /POS

_GROUP: Final = re.compile(r"GP(\d):")
_FIELD: Final = re.compile(
    r"(\w++)[:=](?:(\0)(?: (mm|deg))?|'([^']*+)'|(F|\*++)(?:mm|deg)?),? ?(?!\w*[*\0])", re.IGNORECASE
)
_CONFIG: Final = re.compile(r"[^,]*+,\0,\0,\0")


class _Group(NamedTuple):
    """Fields of a group of a position."""

    numbers: dict[str, tuple[int, str]]  # ordinals and units
    texts: dict[str, str]
    words: tuple[tuple[str, int], ...]  # turn numbers of the configuration
    end: int


def _position(line: Line) -> Iterator[tuple[int, Op]]:
    """Yield what P[n]{ GP1: UF : …, UT : …, CONFIG : '…', X = … mm, … }; declares."""
    number = line.ordinals[0]
    name = "P[%s]", number
    try:
        own, others = _groups(line)
        yield 0, Assign(name, _whole(own, others), "variable")
        for kind, active in (("UF", "UFRAME_NUM"), ("UT", "UTOOL_NUM")):
            frame = active if own.texts.get(kind) == "F" else (f"{kind} %s", own.numbers[kind][0])
            yield 0, Assign((f"P[%s].{kind}", number), Named(frame), "constant")
    except Misread as fault:
        yield 0, Havoc(frozenset({name}), fault.reason, fault.remedy)


def _groups(line: Line) -> tuple[_Group, tuple[int, ...]]:
    """Return the arm's group of a position, and the numbers of the others."""
    place, others, own = line.text.index("{") + 1, tuple[int, ...](), None
    while place < len(line.text) - 2:
        head = _GROUP.match(line.text, place)
        group = _group(line, head.end() if head else place)
        place = group.end
        if head and head[1] != "1":
            others += tuple(i for field, (i, _) in group.numbers.items() if field not in {"UF", "UT"})
        elif own is not None:
            raise Misread("a position has two groups GP1", _AGAIN)
        else:
            own = group
    if own is None:
        raise Misread("the position has no group GP1", "only the arm of group 1 is supported")
    return own, others


def _group(line: Line, place: int) -> _Group:
    numbers: dict[str, tuple[int, str]] = {}
    texts: dict[str, str] = {}
    words: tuple[tuple[str, int], ...] = ()
    while field := _FIELD.match(line.text, place):
        if field[1] in numbers or field[1] in texts:
            raise Misread(f"{field[1]} occurs twice in a position", _AGAIN)
        if field[2]:
            numbers[field[1]] = line.ordinal(field.start(2)), (field[3] or "").lower()
        else:
            texts[field[1]] = field[5] if field[4] is None else field[4]
        if field[4] and _CONFIG.fullmatch(field[4]):
            first = line.text.count("\0", 0, field.start(4))
            words = tuple(zip(("turn1", "turn4", "turn6"), line.ordinals[first : first + 3], strict=True))
        place = field.end()
    if not numbers and not texts:
        raise Misread("a field of the position is unknown", _AGAIN)
    return _Group(numbers, texts, words, place)


def _whole(group: _Group, others: tuple[int, ...]) -> Literal:
    """Return a position of the arm; where other groups stand is beside its external axes."""
    numbers, texts = group.numbers, group.texts
    if any(text.startswith("*") and not field.startswith("E") for field, text in texts.items()):
        raise Misread("the position was not recorded (***)", "record it, or delete it and its moves")
    if not all(kind in numbers or texts.get(kind) == "F" for kind in ("UF", "UT")):
        raise Misread("the position has no UF and UT", _AGAIN)
    for notation, names, units in _FIELDS:
        if all(name in numbers for name in names):
            if [numbers[name][1] for name in names] != units.split():
                raise Misread("the position is not in mm and deg", "write it with the controller set to mm")
            external = tuple(i for name, (i, _) in sorted(numbers.items()) if re.fullmatch(r"E\d", name))
            letters = "".join(texts.get("CONFIG", "").partition(",")[0].split())
            return Literal(
                notation, tuple(numbers[name][0] for name in names), external + others, group.words, letters
            )
    raise Misread("the position is neither X, Y, Z, W, P, R nor J1 ... J6", _AGAIN)


_POINTS: Final = Lexicon(comment=r":[^:\[\]\r\n]*+(?=\])", text=r"(?!)", word=r"[^\W\d]\w*+", folded=False)
DIALECT: Final = Dialect(
    _LEXICON,
    _translate,
    active={"UFRAME_NUM": "active UFRAME_NUM", "UTOOL_NUM": "active UTOOL_NUM"},
    constants={"UF 0": np.eye(4), "UT 0": np.eye(4)},  # the robot's own frames: its base and its flange
    is_frame=lambda name: name.startswith(("UF ", "UT ")),
    remedy=_REMEDY,
)
_ORDER: Final = ("PROG", "ATTR", "APPL", "MN", "POS", "END")
_SECTION: Final = re.compile(r"/(PROG|ATTR|APPL|MN|POS|END)\b.*+")
_LINE: Final = re.compile(r"\s*+(\d*+)\s*+:")
_POSITION: Final = re.compile(r"(P.*?\};)|\S[^P]*+", re.DOTALL)
_END: Final = re.compile(r"\s*+P\s*+\[")


def read_fanuc(machine: Machine, sources: tuple[Source, ...]) -> None:
    """Read a .LS file."""
    source, sections, here = sources[0], dict[str, int](), ""
    spans: list[tuple[int, int]] = []
    for line, (start, end) in enumerate(zip(source.starts.tolist(), source.ends.tolist(), strict=True), 1):
        text = source.text[start:end].rstrip("\r\n")
        if match := _SECTION.match(text):
            if match[1] in sections or _ORDER.index(match[1]) < max(map(_ORDER.index, sections), default=0):
                machine.refuse(line, f"a second or misplaced /{match[1]}", "send one program")
            here, sections[match[1]] = match[1], start + len(text)
        elif here == "END" and text.strip():
            machine.refuse(line, "there is text after /END", "send one program")
        elif here == "MN" and text.strip():
            _add_instruction(machine, spans, line, start, text)
    if not sections.keys() >= {"MN", "POS"}:
        remedy = "write the program as ASCII (.LS), not as binary (.TP)"
        machine.refuse(None, "the file has no /MN and /POS", remedy)
    end = sections["END"] - len("/END") if "END" in sections else len(source.text)
    positions = _positions(machine, source, sections["POS"], end)
    machine.add(0, *_columns(positions), lexicon=_POINTS, translate=_position)
    machine.add(0, *_columns(spans))


def _columns(spans: list[tuple[int, int]]) -> tuple[IndexArray, IndexArray]:
    starts, ends = np.array(spans, dtype=np.intp).reshape(-1, 2).T
    return starts, ends


def _add_instruction(
    machine: Machine, spans: list[tuple[int, int]], line: int, start: int, text: str
) -> None:
    """Add a line of /MN to the instructions; one without a number continues the one before."""
    head = _LINE.match(text)
    if head is None and not _END.match(text):
        reason = f"the line {shown(text)} has no number and colon"
        machine.refuse(line, reason, "write the program in the controller's form")
    body = head.end() if head else 0
    if text[body:].lstrip().startswith(("!", "//", "--")):
        return
    if spans and not (head and head[1]):
        spans[-1] = spans[-1][0], start + len(text)
    else:
        spans.append((start + body, start + len(text)))


def _positions(machine: Machine, source: Source, place: int, end: int) -> list[tuple[int, int]]:
    """Return first and last + 1 character of the positions of /POS."""
    spans = []
    for match in _POSITION.finditer(source.text, place, end):
        if match[1] is None or not re.match(r"P\s*+\[[^\]{}]*+\]\s*+\{", match[1]):
            reason = f"{shown(match[0])} between positions is unknown or has no end"
            machine.refuse(source.line(match.start()), reason, _AGAIN)
        spans.append(match.span())
    return spans
