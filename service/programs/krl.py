"""Programs of KUKA (KRL): .src with .dat and $config.dat, translated."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from jointstiff.service.programs.interpreter import Dialect, Machine
from jointstiff.service.programs.language import (
    NUMBER,
    Assign,
    Call,
    Copy,
    Flow,
    Havoc,
    Keep,
    Lexicon,
    Line,
    Local,
    Misread,
    Move,
    Name,
    Named,
    Op,
    Use,
    Value,
    attached,
    calls,
    complete,
    parts,
    unknown,
)
from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import Literal, Motion, Source

POSE: Final = Notation(Orientation.EULER_ZYX)
JOINTS: Final = Notation(Orientation.JOINTS)
_FIELDS: Final = ((POSE, ("X", "Y", "Z", "A", "B", "C")), (JOINTS, ("A1", "A2", "A3", "A4", "A5", "A6")))
_MOTIONS: Final = {"PTP": Motion.JOINT, "LIN": Motion.LINEAR, "CIRC": Motion.CIRCULAR, "SPL": Motion.SPLINE}
# Facts. Sources: KUKA System Software 8.x, programming instructions for system integrators (KSS); the
# controller's bas.src (BAS).
_BAS: Final[dict[str, tuple[Op, ...]]] = {
    # BAS: INITMOV sets the null base and tool 1
    "INITMOV": (Assign("$BASE", Copy("BASE_DATA[0]")), Assign("$TOOL", Copy("TOOL_DATA[1]"))),
    # BAS: FRAMES, PTP_PARAMS and CP_PARAMS make the frames of FDAT_ACT the active ones
    **dict.fromkeys(
        ("FRAMES", "PTP_PARAMS", "CP_PARAMS"),
        (
            Assign("$BASE", Copy("FDAT_ACT.BASE", through=True)),
            Assign("$TOOL", Copy("FDAT_ACT.TOOL", through=True)),
        ),
    ),
    # BAS: these set speeds and accelerations only
    **dict.fromkeys(("ACC_CP", "ACC_PTP", "VEL_CP", "VEL_PTP", "PTP_DAT", "CP_DAT"), ()),
}
# KSS, system variables: what the meaning of a target hangs on, beside $BASE and $TOOL
_MOVING: Final = re.compile(
    r"\$(?!BASE\b|TOOL\b|IPO_MODE=#BASE|H_POS|IN_POS)\w*(?:BASE|TOOL|ROOT|WORLD|FRAME|POS|IPO|TECH|SEN|SOFT|ASY|EXT?_?AX|EX_|CORR|CMD)"
)
# KSS: places that a controller keeps, for all of its programs
_KEPT: Final = re.compile(r"\$AXIS_ACT|\$POS_ACT|\$H_POS|X?HOME\d?")
_CONSTANTS: Final = {name: np.eye(4) for name in ("$NULLFRAME", "BASE_DATA[0]", "TOOL_DATA[0]")}
_LEXICON: Final = Lexicon(
    comment=r";[^\r\n]*+|(?<![^\r\n])&[^\r\n]*+",
    text=r"\"[^\"\r\n]*+\"|#\w++|'[HD][0-9A-F]++'",
    word=r"\$?[^\W\d]\w*+",
    number=rf"{NUMBER}|'B[01]{{1,16}}+'",
    operators="AND|OR|EXOR|NOT|B_AND|B_OR|B_EXOR|B_NOT",
    reserved=r"S?(?:PTP|LIN|CIRC|SPL)(?:_REL)?|ASYPTP|ASYCONT|DEF|DEFFCT|DEFDAT|END\w*|IF|THEN|ELSE|FOR|TO|STEP|WHILE"
    r"|LOOP|REPEAT|UNTIL|SWITCH|CASE|DEFAULT|GOTO|WAIT|HALT|EXIT|RETURN|CONTINUE|TRIGGER|INTERRUPT|(?:PTP_)?SPLINE"
    r"|DECL|GLOBAL|SIGNAL|EXT|BRAKE|RESUME|WITH|DO|ANOUT|ANIN|BAS|C_(?:PTP|DIS|VEL|ORI|SPL)|\$BASE|\$TOOL",
    # KSS: arithmetic, strings, the state of variables, pulses, and what inline forms set speeds by
    functions=r"ABS|SQRT|SIN|COS|TAN|ACOS|ATAN2|ROUND|TRUNC|INV_POS|VARSTATE|GET_SYSTEM_DATA|PULSE"
    r"|STR(?:ADD|CLEAR|COMP|COPY|DECLLEN|FIND|LEN|TOINT|TOREAL)|S(?:VEL|ACC)_(?:JOINT|CP)|SAPO(?:_PTP)?|SORI_TYP"
    r"|S(?:GEAR_)?JERK|SLOAD|SIPO_MODE|SCIRC_TYPE|USE_CM_PRO_VALUES",
)
_REMEDY: Final = (
    "write all of X, Y, Z, A, B, C (or A1 ... A6) as numbers, and send the .dat that declares them"
)
_FRAME_REMEDY: Final = "give the whole frame in numbers, or as BASE_DATA[i] or TOOL_DATA[i]"
_MAX_DEPTH: Final = 16
"""Braces within one another; a controller's own structures have three."""
_NAME: Final = r"\$?[^\W\d]\w*+"
_TARGET: Final = rf"\{{[^{{}}]*+\}}|{_NAME}"
_BLEND: Final = r"((?: ?C_(?:PTP|DIS|VEL|ORI|SPL))*)"
_MOVE: Final = re.compile(
    rf"S?(PTP|LIN|CIRC|SPL)(?: |(?=\{{))({_TARGET})(?:,({_TARGET}))?{_BLEND}(?: ?WITH (.*))?"
)
_STATEMENTS: Final = tuple(
    (kind, re.compile(pattern))
    for kind, pattern in (
        ("routine", rf"(?:GLOBAL )?DEF(?:FCT {_NAME}(?:\[\])?)? ({_NAME})(?:\((.*)\))?(?: ?PUBLIC)?"),
        (
            "none",
            r"DEFDAT \w+(?: PUBLIC)?|ENDDAT|HALT|CONTINUE|ENDSPLINE.*|INTERRUPT (?:ON|OFF)|INTERRUPT OFF \0",
        ),
        (
            "none",
            r"(?:EXT(?:FCT)?P?|ENUM|STRUC|IMPORT|(?:DECL )?(?:GLOBAL )?SIGNAL) [\w ,()\[\]:$.\0\"#]*",
        ),
        ("end", r"END|ENDFCT"),
        ("if", r"IF ?(.*?) ?THEN|SWITCH ?(.+)"),
        ("turn", r"ELSE|CASE ?(.+)"),
        ("default", r"DEFAULT"),
        ("close", r"ENDIF|ENDSWITCH|ENDFOR|ENDWHILE|ENDLOOP|UNTIL ?(.+)"),
        ("loop", rf"WHILE ?(.+)|FOR ({_NAME})=(.+)"),
        ("repeat", r"LOOP|REPEAT"),
        ("leave", r"EXIT"),
        ("jump", rf"GOTO ({_NAME})"),
        ("label", rf"({_NAME}):"),
        ("return", r"RETURN ?(.*)"),
        ("uses", r"WAIT (?:SEC|FOR) ?(.+)|ANOUT (?:ON|OFF) ?(.+)|(PULSE\(.*\))"),
        ("interrupt", rf"(?:GLOBAL )?INTERRUPT DECL \0 WHEN (.+?) DO ({_NAME})\((.*)\)"),
        ("interruptible", r"INTERRUPT ON (\0)"),
        (
            "trigger",
            rf"TRIGGER WHEN (.+?) DO (?:\$OUT(\[.*)|PULSE(\(.*\))|({_NAME})(\(.*\))(?: ?PRIO=(.+))?)",
        ),
        ("bas", r"BAS\(#(\w+)(?:,(.+))?\)"),
        ("spline", rf"(?:PTP_)?SPLINE{_BLEND}(?: ?WITH (.*))?{_BLEND}"),
        (
            "declared",
            rf"(?:(?:DECL |GLOBAL |CONST )+{_NAME}|(?:GLOBAL )?(?:INT|REAL|BOOL|CHAR|FRAME"
            rf"|(?:E6)?(?:POS|AXIS)|[FPL]DAT|LOAD)) ({_NAME}.*)",
        ),
        ("called", rf"({_NAME})\((.*)\)"),
        ("assigned", rf"({_NAME})((?:\[[^\]=]*+\]|\.\w++)*)=(?!=)(.*)"),
    )
)


def _translate(line: Line) -> list[tuple[int, Op]]:
    """Return what a line does."""
    text = line.text.upper()
    depth = 0
    for sign in text if text.count("{") > _MAX_DEPTH else "":
        depth += (sign == "{") - (sign == "}")
        if depth > _MAX_DEPTH:
            remedy = "declare inner structures on their own"
            raise Misread(f"more than {_MAX_DEPTH} braces within one another", remedy)
    line = Line(text, line.ordinals, line.places, line.breaks)
    try:
        return complete(line, _MOTION, [(0, op) for op in (_ops(line) if text else ())], _REMEDY)
    except Misread as fault:
        return unknown(line, _MOTION, fault, _REMEDY)


_MOTION: Final = re.compile(r"\b(?:S?(?:PTP|LIN|CIRC|SPL)(?:_REL)?)(?!\w)")


def _ops(line: Line) -> list[Op]:
    text = line.text
    if match := _MOVE.fullmatch(text):
        return _move(line, match)
    for kind, pattern in _STATEMENTS:
        if match := pattern.fullmatch(text):
            return _statement(line, kind, match)
    if match := _COMPUTED.fullmatch(text):
        return _computed(match[2], "a relative move" if match[1] else _NOT_WHOLE)
    raise Misread("the statement is unknown: it may move the robot, targets or frames")


_COMPUTED: Final = re.compile(rf"S?(?:PTP|LIN|CIRC|SPL)(_REL)?(?: |(?=\{{))(.+?){_BLEND}")
_NOT_WHOLE: Final = (
    "the target is not a whole pose or set of angles in numbers, or the text after it is unknown"
)


def _computed(target: str, reason: str) -> list[Op]:
    """Return a move to what is not given by numbers: it is left, and what it computes with is used."""
    uses = _LEXICON.expression(_SEPARATED.sub(",", target))
    return [*uses, Move(Motion.LINEAR, (), reason=reason, remedy=_REMEDY)]


def _statement(line: Line, kind: str, match: re.Match[str]) -> list[Op]:
    if kind in _RULES:
        return _RULES[kind](line, match)
    found = [op for each in match.groups() if each for op in _LEXICON.expression(each)]
    if kind in {"none", "uses"}:
        return [] if kind == "none" else found
    if kind == "turn":
        return [Flow(kind), *attached(found)]
    return [*found, Flow(kind)]


def _routine(_line: Line, match: re.Match[str]) -> list[Op]:
    names = frozenset(re.findall(rf"({_NAME})(?::\w+)?", match[2] or ""))
    shared = match[0].startswith("GLOBAL")
    return [
        Flow("routine", match[1], shared),
        Local(names),
        *([Havoc(names, "a parameter of the routine", _REMEDY)] if names else []),
    ]


def _loop(_line: Line, match: re.Match[str]) -> list[Op]:
    if match[1]:
        return [*attached(_LEXICON.expression(match[1])), Flow("loop")]
    bounds = [op for each in re.split(" ?TO | ?STEP ", match[3]) for op in _LEXICON.expression(each)]
    return [*bounds, Flow("loop"), Havoc(frozenset({match[2]}), f"{match[2]} counts a loop", _REMEDY)]


def _called(_line: Line, match: re.Match[str]) -> list[Op]:
    if re.fullmatch(_LEXICON.reserved, match[1]):
        raise Misread(f"{match[1]} is not a routine")
    return _LEXICON.expression(match[0])


def _interrupt(line: Line, match: re.Match[str]) -> list[Op]:
    handler = [] if match[2] == "IR_STOPM" else [Call(match[2], attached=True)]  # BAS: IR_STOPM waits
    uses = attached([*_LEXICON.expression(match[1]), *_LEXICON.expression(match[3], empty=True)])
    name = "INTERRUPT %s", line.ordinal(match[0].index("\0"))
    return [Assign(name, Named(name)), *handler, *uses]


def _trigger(_line: Line, match: re.Match[str]) -> list[Op]:
    condition = match[1].replace(" DELAY=", "+DELAY=").replace("DISTANCE=", "").replace("PATH=", "")
    found = _LEXICON.expression(condition.replace("DELAY=", ""))
    for each in filter(None, (match[2], match[3], match[5], match[6])):
        found += attached(_LEXICON.expression(each.replace("=", "+", 1), empty=True))
    return [*found, *([Call(match[4], attached=True)] if match[4] else [])]


def _bas(line: Line, match: re.Match[str]) -> list[Op]:
    which, argument = match[1], match[2]
    found = [] if argument is None else _LEXICON.expression(argument)
    if which in {"TOOL", "BASE"} and argument == "\0":
        return [Assign(f"${which}", Copy((f"{which}_DATA[%s]", line.ordinal(match.start(2)))))]
    if which not in _BAS:
        raise Misread(f"BAS(#{which}) with what is no number, or is not known")
    return [*found, *_BAS[which]]


def _literal(line: Line, start: int, end: int) -> Literal | None:
    """Return the numbers of `{...}` at a place of the text; None if a field is computed."""
    text = line.text
    begin = start + 1 if text[start : start + 1] == "{" and text[end - 1 : end] == "}" else end
    if begin == end or "{" in text[begin:end]:
        return None
    if head := re.compile(r"\w+:").match(text, begin, end):
        begin = head.end()
    numbers: dict[str, int] = {}
    texts: dict[str, str] = {}
    for first, last in parts(text[: end - 1], begin):
        field = re.fullmatch(r"(\w+)(?:\[\0?\])? ?(\0|TRUE|FALSE|\"[^\"]*\"|#\w+|'\w+')", text[first:last])
        if field is None or field[1] in numbers or field[1] in texts:
            return None
        if field[2] == "\0":
            numbers[field[1]] = line.ordinal(last - 1)
        else:
            texts[field[1]] = field[2]
    for notation, fields in _FIELDS:
        if all(field in numbers for field in fields):
            external = tuple(numbers.get(f"E{i}", -1) for i in range(1, 7))
            said = tuple((kind, numbers[kind]) for kind in ("S", "T") if kind in numbers)
            places = tuple(numbers[field] for field in fields)
            return Literal(notation, places, external if max(external) >= 0 else (), said)
    return Literal(None, fields=numbers, texts=texts)


def _given(line: Line, name: Name, start: int, end: int) -> list[Op]:
    """Return what a name gets by numbers or names: a pose, or the frames of FDAT; else nothing."""
    text = line.text[start:end]
    literal = _literal(line, start, end)
    if literal is not None and literal.notation is not None:
        return [Assign(name, literal)]
    if literal is not None and {"TOOL_NO", "BASE_NO"} <= literal.fields.keys() and isinstance(name, str):
        if literal.texts.get("IPO_FRAME", "#BASE") != "#BASE":  # KSS: #TCP is a tool that stands in the cell
            return []
        return [
            Assign(f"{name}.{which}", Named((f"{which}_DATA[%s]", literal.fields[f"{which}_NO"])))
            for which in ("BASE", "TOOL")
        ]
    if name == "FDAT_ACT" and re.fullmatch(_NAME, text):
        return [Assign(f"{name}.{which}", Copy(f"{text}.{which}")) for which in ("BASE", "TOOL")]
    return []


def _declared(line: Line, match: re.Match[str]) -> list[Op]:
    ops: list[Op] = []
    shared = re.search(r"\bGLOBAL\b", line.text[: match.start(1)]) is not None
    for start, end in parts(line.text, match.start(1)):
        name, equals, value = line.text[start:end].partition("=")
        name, bracket, index = name.partition("[")
        if not re.fullmatch(_NAME, name) or re.fullmatch(_LEXICON.reserved, name):
            raise Misread("the declaration is unknown")
        ops += [Local(frozenset({name}))]
        ops += _LEXICON.expression(f"[{index}") if bracket and index != "]" else []
        if equals:
            given = [] if bracket else _given(line, name, end - len(value), end)
            ops += [op._replace(shared=shared) for op in given if isinstance(op, Assign)] or _set(name, value)
    return ops


def _set(name: Name, value: str, frames: tuple[Name, ...] = ()) -> list[Op]:
    """Return that a name gets what is not known."""
    shown = name if isinstance(name, str) else name[0] % "i"
    found = [] if value.startswith("{") else _LEXICON.expression(value)
    if value.startswith("{"):
        found = [op for op in _LEXICON.expression(_SEPARATED.sub(",", value)) if not isinstance(op, Use)]
    remedy = _FRAME_REMEDY if frames or "_DATA" in shown else _REMEDY
    return [
        *found,
        Havoc(
            frozenset(frames or {name}),
            f"{shown} changes while the program runs: it is computed, or set in part",
            remedy,
        ),
    ]


_SEPARATED: Final = re.compile(r" (?=[\0\w\"#'$])|(?<=\w):|(?<=\])(?=[\0\w\"#'$ ])|(?<=\[)(?=\])")


def _assigned(line: Line, match: re.Match[str]) -> list[Op]:
    name, index, value = match[1], match[2], match[3]
    if not value:
        raise Misread("the statement is not complete")
    if name in {"FDAT_ACT", "$BASE", "$TOOL", "BASE_DATA", "TOOL_DATA"}:
        return _frame(line, match)
    if _MOVING.match(match[0]):
        raise Misread(f"the controller's variable {name} may move targets", "omit it")
    inner = index.strip("[]").replace("][", ",").replace("].", "+")
    uses = _LEXICON.expression(inner, empty=True) if "[" in index else []
    if name.startswith("$"):
        return [*uses, *(op for op in _set(name, value) if not isinstance(op, Havoc))]
    return [*uses, *(([] if index else _given(line, name, *match.span(3))) or _set(name, value))]


def _frame(line: Line, match: re.Match[str]) -> list[Op]:
    """Take an assignment to the active frames, to those that wait, or to the data of one."""
    name, index, value = match[1], match[2], match[3]
    target: Name = name
    if name.endswith("_DATA"):
        if not index.startswith("[\0]"):
            raise Misread(f"{name} of a computed number", _FRAME_REMEDY)
        target, index = (f"{name}[%s]", line.ordinal(match.start(2) + 1)), index.removeprefix("[\0]")
    elif not index and re.fullmatch(rf"{re.escape(name[1:])}_DATA\[\0\]", value):
        return [Assign(name, Copy((f"{name[1:]}_DATA[%s]", line.ordinal(match.end(3) - 2))))]
    elif not index and name != "FDAT_ACT" and re.fullmatch(_NAME, value):
        return [Use(frozenset({value})), Assign(name, Copy(value))]
    given = [] if index else _given(line, target, *match.span(3))
    waiting = ("FDAT_ACT.BASE", "FDAT_ACT.TOOL") if name == "FDAT_ACT" else ()
    return given if len(given) == 1 + bool(waiting) else _set(target, value, waiting)


def _move(line: Line, match: re.Match[str]) -> list[Op]:
    motion = _MOTIONS[match[1]]
    spans = [match.span(k) for k in (2, 3) if match[k]]
    names = [line.text[slice(*span)] for span in spans]
    found, own = _settings(match[5] or "")
    if len(spans) != 1 + (motion is Motion.CIRCULAR):
        raise Misread(
            "the target is not given by numbers: an arc has two, other moves one, and nothing follows them"
        )
    if any(map(_KEPT.fullmatch, names)):
        if len(names) > 1:
            raise Misread("an arc through a position stored in the controller")
        return [*found, Keep(f"a move to {names[0]}, a position stored in the controller")]
    targets: list[Literal | Name] = []
    for name, span in zip(names, spans, strict=True):
        literal = _literal(line, *span) if name.startswith("{") else None
        if name.startswith("{") and (literal is None or literal.notation is None):
            return [*found, *_computed(",".join(names), _NOT_WHOLE)]
        if re.fullmatch(_LEXICON.reserved, name):
            raise Misread("the target is not given by numbers")
        targets.append(name if literal is None else literal)
    frames: tuple[Value, Value] = Copy("$BASE"), Copy("$TOOL")
    if own:
        frames = Copy(f"{own}.BASE", through=True), Copy(f"{own}.TOOL", through=True)
    plain = all(isinstance(each, Literal) for each in targets)
    count = len(targets)
    move = Move(motion, tuple(targets), frames[:1] * count, frames[1:] * count, repeats=plain)
    return [*found, move]


def _settings(text: str) -> tuple[list[Op], str]:
    """Return what settings behind WITH use, and the name of the declaration of the move's own frames."""
    found: list[Op] = []
    frames: dict[str, str] = {}
    text = re.sub(rf"{_BLEND}$", "", text)
    for start, end in parts(text) if text else ():
        name, _, value = text[start:end].partition("=")
        if name in {"$BASE", "$TOOL"}:
            declared = re.fullmatch(rf"(?:STOOL2?|SBASE)\(({_NAME})(?:\.\w+)?\)", value)
            if declared is None:
                raise Misread("the move or the block has frames of its own", "set $TOOL and $BASE before it")
            frames[name] = declared[1]
        elif not name.startswith("$") or (_MOVING.match(name) and name != "$IPO_MODE"):
            raise Misread("the settings of the move are unknown", "set them before it")
        else:
            found += [op for op in _set(name, value) if not isinstance(op, Havoc)]
    if calls(found) or (frames and (len(frames) < 2 or len(set(frames.values())) > 1)):
        raise Misread("the settings of the move call a routine, or set one frame only", "set them before it")
    return found, frames.get("$TOOL", "")


def _spline(_line: Line, match: re.Match[str]) -> list[Op]:
    """Take the beginning of a block of splines; the frames of a block are not known in it."""
    found, own = _settings(match[2] or "")
    reason, remedy = "the block of splines has frames of its own", "set $BASE and $TOOL before the block"
    return [*found, *([Havoc(frozenset({"$BASE", "$TOOL"}), reason, remedy)] if own else [])]


_RULES: Final[Mapping[str, Callable[[Line, re.Match[str]], list[Op]]]] = {
    "routine": _routine,
    "label": lambda _, match: [Flow("label", match[1])],
    "jump": lambda _, match: [Flow("jump", match[1])],
    "loop": _loop,
    "bas": _bas,
    "declared": _declared,
    "assigned": _assigned,
    "called": _called,
    "spline": _spline,
    "interrupt": _interrupt,
    "interruptible": lambda line, match: [
        Call(("INTERRUPT %s", line.ordinal(match.start(1))), attached=True)
    ],
    "trigger": _trigger,
}
DIALECT: Final = Dialect(
    _LEXICON,
    _translate,
    active={"$BASE": "active $BASE", "$TOOL": "active $TOOL"},
    constants=_CONSTANTS,
    is_frame=lambda name: name.startswith(("BASE_DATA[", "TOOL_DATA[")),
    remedy=_REMEDY,
)


def read_krl(machine: Machine, sources: tuple[Source, ...]) -> None:
    """Read a .src, and the .dat files beside it."""
    main = re.search(
        rf"(?im)^[ \t]*+(?:GLOBAL[ \t]++)?DEF(?:FCT[ \t]++\w++)?[ \t]++({_NAME})", sources[0].text
    )
    for index, source in enumerate(sources):
        is_config = source.name.lower().endswith("config.dat")
        data = re.search(rf"(?im)^[ \t]*+DEFDAT[ \t]++({_NAME})", source.text)
        if index and main and data and not is_config and data[1].upper() != main[1].upper():
            reason, remedy = f"it declares data of {data[1]}, not of {main[1]}", "send the .dat of the .src"
            machine.refuse(source.line(data.start()), reason, remedy, index)
        declares = source.name.lower().endswith(".dat") and len(sources) > 1
        own = not re.search(
            r"(?im)^[ \t]*+DEFDAT[ \t]++\w++[ \t]++PUBLIC\b|config\.dat$", f"{source.text}\n{source.name}"
        )
        # no other program changes a .dat that is not public
        kind = "shared" if is_config else "constant" if own else "variable"
        machine.add(index, source.starts, source.ends, declares=kind if declares else "")
