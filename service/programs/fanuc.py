"""Programs of FANUC (.LS, ASCII of TP), translated: /MN and /POS."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

import numpy as np

from jointstiff.service.programs import language as ir
from jointstiff.service.programs.errors import shown
from jointstiff.service.programs.interpreter import Machine
from jointstiff.service.programs.language import Line, Misread, Op
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
_QUIET: Final = (
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
_REMEDY: Final = (
    "write positions in numbers, in /POS: no PR[], no P[R[]]; choose frames by numbers, on lines of their own"
)
_AGAIN: Final = "record the position again"
_ACTION: Final = r"(JMP LBL ?\[.*\]|CALL .+|(?:DO|RO|GO|AO|R|F|WO)\[[^=]*\]=.+)"


def _frame(line: Line, match: re.Match[str]) -> list[Op]:
    kind = "UFRAME" if "UFRAME" in match[0] else "UTOOL"
    number = line.ordinal(match.start(1 if match[1] else 2))
    return [ir.Assign(f"{kind}_NUM", ir.Named(("UF %s" if kind == "UFRAME" else "UT %s", number)))]


def _call(line: Line, match: re.Match[str]) -> list[Op]:
    return [*line.expression(match[2] or "", empty=True), ir.Call(match[1])]


def _label(line: Line, match: re.Match[str]) -> list[Op]:
    return [ir.Flow("label", ("%s", line.ordinal(match.start(1))))]


def _jump(line: Line, match: re.Match[str]) -> list[Op]:
    """Return a jump, behind the condition of one that waits; the label may be computed."""
    group = match.re.groups
    found = line.expression(match[1]) if group > 1 else []
    if match[group] == "\0":
        return [*found, ir.Flow("jump", ("%s", line.ordinal(match.start(group))))]
    return [*found, *line.expression(match[group]), ir.Flow("jump", "\0")]


def _loop(line: Line, match: re.Match[str]) -> list[Op]:
    return [*line.expression(match[1]), *line.expression(match[2]), ir.Flow("loop")]


def _leads(line: Line, match: re.Match[str]) -> list[Op]:
    """Return an action that may be passed over."""
    given = [each.replace("=", "+", 1) for each in match.groups()[:3] if each]
    action = Line(line.language, match[4], line.ordinals[line.text.count("\0", 0, match.start(4)) :], (), ())
    found = [op for each in given for op in line.expression(each)]
    return [*found, ir.Flow("if"), *line.language.rule(action), ir.Flow("close")]


def _quiet(line: Line, match: re.Match[str]) -> list[Op]:
    """Return what an instruction uses: `PULSE,0.2sec`, `ON` and `(…)` are values, too."""
    given = [each for each in match.groups() if each and not re.fullmatch(r"PULSE,\0 ?(?:sec)?", each)]
    return [op for each in given for op in line.expression(each.replace("!", ""))]


def _changed(line: Line, _match: re.Match[str]) -> list[Op]:
    name = "P[%s]", line.ordinals[0]
    return [ir.Havoc(frozenset({name}), "the position changes while the program runs", _REMEDY)]


def _move(line: Line, match: re.Match[str]) -> list[Op]:
    """Return a move to one position, or through one to another."""
    letter, tail = match[1], match[3]
    if bool(match[2]) != (letter == "C"):
        reason = "an arc has two positions, another move has one; its second one is on the next line"
        raise Misread(reason)
    offset = _OFFSET.search(tail)
    shifts = tail[offset.start() :].rstrip() if offset else ""
    rest = tail.removesuffix(shifts).rstrip()
    if not _TAIL.fullmatch(rest) or (shifts and not _ALL_OFFSETS.fullmatch(shifts)):
        reason = (
            "the text after the target moves it, or is unknown; its position in /POS is not all that counts"
        )
        raise Misread(reason)
    ordinals = line.ordinals[: 1 + bool(match[2])]
    names = tuple(("P[%s]", ordinal) for ordinal in ordinals)
    bases, tools = (
        tuple(ir.Copy((f"P[%s].{kind}", ordinal), through=True) for ordinal in ordinals)
        for kind in ("UF", "UT")
    )
    reason = f"{offset[0].strip()} moves the target" if offset else ""
    move = ir.Move(
        _MOTIONS[letter], names, bases, tools, ("UFRAME_NUM", "UTOOL_NUM"), reason=reason, remedy=_REMEDY
    )
    return [*(ir.Call(name, attached=True) for name in re.findall(r",CALL ?(\w++)", tail)), move]


def _anywhere(_line: Line, _match: re.Match[str]) -> list[Op]:
    return [ir.Call("P[...]", attached=True)]


def _computed(_line: Line, _match: re.Match[str]) -> list[Op]:
    raise Misread("a frame is computed, or chosen in a branch")


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


def _position(line: Line, _match: re.Match[str]) -> list[Op]:
    """Return what P[n]{ GP1: UF : …, UT : …, CONFIG : '…', X = … mm, … }; declares."""
    number = line.ordinals[0]
    name = "P[%s]", number
    try:
        own, others = _groups(line)
        ops: list[Op] = [ir.Assign(name, _whole(own, others), "variable")]
        for kind, active in (("UF", "UFRAME_NUM"), ("UT", "UTOOL_NUM")):
            frame = active if own.texts.get(kind) == "F" else (f"{kind} %s", own.numbers[kind][0])
            ops.append(ir.Assign((f"P[%s].{kind}", number), ir.Named(frame), "constant"))
    except Misread as fault:
        return [ir.Havoc(frozenset({name}), fault.reason, fault.remedy)]
    return ops


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


_POINTS: Final = ir.Language(
    comment=r":[^:\[\]\r\n]*+(?=\])", text=r"(?!)", folded=False, rules=((r"(?s).*", _position),)
)
LANGUAGE: Final = ir.Language(
    # what stands behind a number in brackets
    comment=r":[^:\[\]\r\n]*+(?=\])|(?<=MESSAGE)\[[^\[\]\r\n]*+\]",
    blank=r" ?;?:|^[ ;]+|[ ;]+$",
    text=r"'[^'\r\n]*+'",
    word=r"[$]?[^\W\d]\w*+",
    folded=False,
    operators="AND|OR|NOT|DIV|MOD",
    reserved="JMP|CALL|RUN|LBL|IF|THEN|ELSE|ENDIF|FOR|TO|DOWNTO|ENDFOR|SELECT|INC|OFFSET|Offset|Skip|SKIP|VOFFSET|TOOL_OFFSET"
    r"|P(?=\[)",
    functions="WAIT|ABS|SQRT|SIN|COS|TAN|LN|EXP|ROUND|TRUNC|ATAN2|ASIN|ACOS|MOD",
    motion=r"(?<![\w$.\[])[JLCAS] PR?\[",
    remedy=_REMEDY,
    active={"UFRAME_NUM": "active UFRAME_NUM", "UTOOL_NUM": "active UTOOL_NUM"},
    constants={"UF 0": np.eye(4), "UT 0": np.eye(4)},  # the robot's own frames: its base and its flange
    is_frame=lambda name: name.startswith(("UF ", "UT ")),
    rules=(
        (r"([JLCAS]) P\[\0\] ?(P\[\0\] ?)?(.*)", _move),
        (r"(?:UFRAME_NUM|UTOOL_NUM)=(\0)|\$(?:MNUFRAMENUM|MNUTOOLNUM)\[\0\]=(\0)", _frame),
        (r"IF ?(.+?) ?THEN", "if"),
        (r"FOR R\[\0\]=(.+?)(?: TO| DOWNTO) ?(.+)", _loop),
        (r"ELSE", "turn"),
        (r"ENDIF|ENDFOR", "close"),
        (r"LBL ?\[(\0)\]", _label),
        (r"JMP LBL ?\[(.*)\]", _jump),
        (r"WAIT ?(.+?) ?TIMEOUT,LBL ?\[(.*)\]", _jump),
        (rf"(?:IF ?(.+?)|SELECT ?(.+?)|=(.+?)|ELSE),{_ACTION}", _leads),
        (r"(?:CALL|RUN|MONITOR) (\w++)(?:\((.*)\))?", _call),
        (_QUIET, _quiet),
        (r".*(?:UFRAME|UTOOL).*", _computed),
        (r"P\[\0(?:,\0)?\]=.*", _changed),
        (r"(?:(?!(?<!\w)P\[).)*P\[[^=]*=.*", _anywhere),
    ),
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
    machine.add(0, *_columns(positions), language=_POINTS)
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
