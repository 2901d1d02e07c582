"""Programs of KUKA (KRL): .src with .dat and $config.dat, translated."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from jointstiff.service.programs import language as ir
from jointstiff.service.programs.interpreter import Machine
from jointstiff.service.programs.language import Line, Misread, Op, parts
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
    "INITMOV": (ir.Assign("$BASE", ir.Copy("BASE_DATA[0]")), ir.Assign("$TOOL", ir.Copy("TOOL_DATA[1]"))),
    # BAS: FRAMES, PTP_PARAMS and CP_PARAMS make the frames of FDAT_ACT the active ones
    **dict.fromkeys(
        ("FRAMES", "PTP_PARAMS", "CP_PARAMS"),
        (
            ir.Assign("$BASE", ir.Copy("FDAT_ACT.BASE", through=True)),
            ir.Assign("$TOOL", ir.Copy("FDAT_ACT.TOOL", through=True)),
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
_RESERVED: Final = (
    r"S?(?:PTP|LIN|CIRC|SPL)(?:_REL)?|ASYPTP|ASYCONT|DEF|DEFFCT|DEFDAT|END\w*|IF|THEN|ELSE|FOR|TO|STEP|WHILE"
    r"|LOOP|REPEAT|UNTIL|SWITCH|CASE|DEFAULT|GOTO|WAIT|HALT|EXIT|RETURN|CONTINUE|TRIGGER|INTERRUPT|(?:PTP_)?SPLINE"
    r"|DECL|GLOBAL|SIGNAL|EXT|BRAKE|RESUME|WITH|DO|ANOUT|ANIN|BAS|C_(?:PTP|DIS|VEL|ORI|SPL)|\$BASE|\$TOOL"
)
_REMEDY: Final = (
    "write all of X, Y, Z, A, B, C (or A1 ... A6) as numbers, and send the .dat that declares them"
)
_FRAME_REMEDY: Final = "give the whole frame in numbers, or as BASE_DATA[i] or TOOL_DATA[i]"
_NAME: Final = r"\$?[^\W\d]\w*+"
_TARGET: Final = rf"\{{[^{{}}]*+\}}|{_NAME}"
_BLEND: Final = r"((?: ?C_(?:PTP|DIS|VEL|ORI|SPL))*)"
_NOT_WHOLE: Final = (
    "the target is not a whole pose or set of angles in numbers, or the text after it is unknown"
)


def _computed_move(line: Line, target: str, reason: str) -> list[Op]:
    """Return a move to what is not given by numbers: it is left, and what it computes with is used."""
    uses = line.expression(_SEPARATED.sub(",", target))
    return [*uses, ir.Move(Motion.LINEAR, (), reason=reason, remedy=_REMEDY)]


def _computed(line: Line, match: re.Match[str]) -> list[Op]:
    return _computed_move(line, match[2], "a relative move" if match[1] else _NOT_WHOLE)


def _routine(_line: Line, match: re.Match[str]) -> list[Op]:
    names = frozenset(re.findall(rf"({_NAME})(?::\w+)?", match[2] or ""))
    own: list[Op] = [ir.Local(names), ir.Havoc(names, "a parameter of the routine", _REMEDY)] if names else []
    return [ir.Flow("routine", match[1], shared=match[0].startswith("GLOBAL")), *own]


def _loop(line: Line, match: re.Match[str]) -> list[Op]:
    if match[1]:
        return [*ir.attached(line.expression(match[1])), ir.Flow("loop")]
    bounds = [op for each in re.split(" ?TO | ?STEP ", match[3]) for op in line.expression(each)]
    return [*bounds, ir.Flow("loop"), ir.Havoc(frozenset({match[2]}), f"{match[2]} counts a loop", _REMEDY)]


def _called(line: Line, match: re.Match[str]) -> list[Op]:
    if re.fullmatch(_RESERVED, match[1]):
        raise Misread(f"{match[1]} is not a routine")
    return line.expression(match[0])


def _interrupt(line: Line, match: re.Match[str]) -> list[Op]:
    handler = [] if match[2] == "IR_STOPM" else [ir.Call(match[2], attached=True)]  # BAS: IR_STOPM waits
    uses = ir.attached([*line.expression(match[1]), *line.expression(match[3], empty=True)])
    name = "INTERRUPT %s", line.ordinal(match[0].index("\0"))
    return [ir.Assign(name, ir.Named(name)), *handler, *uses]


def _trigger(line: Line, match: re.Match[str]) -> list[Op]:
    condition = match[1].replace(" DELAY=", "+DELAY=").replace("DISTANCE=", "").replace("PATH=", "")
    found = line.expression(condition.replace("DELAY=", ""))
    for each in filter(None, (match[2], match[3], match[5], match[6])):
        found += ir.attached(line.expression(each.replace("=", "+", 1), empty=True))
    return [*found, *([ir.Call(match[4], attached=True)] if match[4] else [])]


def _interruptible(line: Line, match: re.Match[str]) -> list[Op]:
    return [ir.Call(("INTERRUPT %s", line.ordinal(match.start(1))), attached=True)]


def _later(_line: Line, match: re.Match[str]) -> list[Op]:
    """Take an action that is not understood: it may be carried out at any time."""
    return [ir.Call(match[0].replace("\0", "n"), attached=True)]


def _bas(line: Line, match: re.Match[str]) -> list[Op]:
    which, argument = match[1], match[2]
    found = [] if argument is None else line.expression(argument)
    if which in {"TOOL", "BASE"} and argument == "\0":
        return [ir.Assign(f"${which}", ir.Copy((f"{which}_DATA[%s]", line.ordinal(match.start(2)))))]
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


def _given(line: Line, name: ir.Name, start: int, end: int) -> list[Op]:
    """Return what a name gets by numbers or names: a pose, or the frames of FDAT; else nothing."""
    text = line.text[start:end]
    literal = _literal(line, start, end)
    if literal is not None and literal.notation is not None:
        return [ir.Assign(name, literal)]
    if literal is not None and {"TOOL_NO", "BASE_NO"} <= literal.fields.keys() and isinstance(name, str):
        if literal.texts.get("IPO_FRAME", "#BASE") != "#BASE":  # KSS: #TCP is a tool that stands in the cell
            return []
        return [
            ir.Assign(f"{name}.{which}", ir.Named((f"{which}_DATA[%s]", literal.fields[f"{which}_NO"])))
            for which in ("BASE", "TOOL")
        ]
    if name == "FDAT_ACT" and re.fullmatch(_NAME, text):
        return [ir.Assign(f"{name}.{which}", ir.Copy(f"{text}.{which}")) for which in ("BASE", "TOOL")]
    return []


def _declared(line: Line, match: re.Match[str]) -> list[Op]:
    ops: list[Op] = []
    shared = re.search(r"\bGLOBAL\b", line.text[: match.start(1)]) is not None
    for start, end in parts(line.text, match.start(1)):
        name, equals, value = line.text[start:end].partition("=")
        name, bracket, index = name.partition("[")
        if not re.fullmatch(_NAME, name) or re.fullmatch(_RESERVED, name):
            raise Misread("the declaration is unknown")
        ops += [ir.Local(frozenset({name}))]
        ops += line.expression(f"[{index}") if bracket and index != "]" else []
        if equals:
            given = [] if bracket else _given(line, name, end - len(value), end)
            ops += [op._replace(shared=shared) for op in given if isinstance(op, ir.Assign)] or _set(
                line, name, value
            )
    return ops


def _set(line: Line, name: ir.Name, value: str, frames: tuple[ir.Name, ...] = ()) -> list[Op]:
    """Return that a name gets what is not known."""
    shown = name if isinstance(name, str) else name[0] % "i"
    found = line.expression(_SEPARATED.sub(",", value) if value.startswith("{") else value)
    remedy = _FRAME_REMEDY if frames or "_DATA" in shown else _REMEDY
    return [
        *found,
        ir.Havoc(
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
    uses = line.expression(inner, empty=True) if "[" in index else []
    if name.startswith("$"):
        return [*uses, *(op for op in _set(line, name, value) if not isinstance(op, ir.Havoc))]
    return [*uses, *(([] if index else _given(line, name, *match.span(3))) or _set(line, name, value))]


def _frame(line: Line, match: re.Match[str]) -> list[Op]:
    """Take an assignment to the active frames, to those that wait, or to the data of one."""
    name, index, value = match[1], match[2], match[3]
    target: ir.Name = name
    if name.endswith("_DATA"):
        if not index.startswith("[\0]"):
            raise Misread(f"{name} of a computed number", _FRAME_REMEDY)
        target, index = (f"{name}[%s]", line.ordinal(match.start(2) + 1)), index.removeprefix("[\0]")
    elif not index and re.fullmatch(rf"{re.escape(name[1:])}_DATA\[\0\]", value):
        return [ir.Assign(name, ir.Copy((f"{name[1:]}_DATA[%s]", line.ordinal(match.end(3) - 2))))]
    elif not index and name != "FDAT_ACT" and re.fullmatch(_NAME, value):
        return [ir.Use(frozenset({value})), ir.Assign(name, ir.Copy(value))]
    given = [] if index else _given(line, target, *match.span(3))
    waiting = ("FDAT_ACT.BASE", "FDAT_ACT.TOOL") if name == "FDAT_ACT" else ()
    return given if len(given) == 1 + bool(waiting) else _set(line, target, value, waiting)


def _move(line: Line, match: re.Match[str]) -> list[Op]:
    motion = _MOTIONS[match[1]]
    spans = [match.span(k) for k in (2, 3) if match[k]]
    names = [line.text[slice(*span)] for span in spans]
    found, own = _settings(line, match[5] or "")
    if len(spans) != 1 + (motion is Motion.CIRCULAR):
        raise Misread(
            "the target is not given by numbers: an arc has two, other moves one, and nothing follows them"
        )
    if any(map(_KEPT.fullmatch, names)):
        if len(names) > 1:
            raise Misread("an arc through a position stored in the controller")
        return [*found, ir.Keep(names[0])]
    targets: list[Literal | ir.Name] = []
    for name, span in zip(names, spans, strict=True):
        literal = _literal(line, *span) if name.startswith("{") else None
        if name.startswith("{") and (literal is None or literal.notation is None):
            return [*found, *_computed_move(line, ",".join(names), _NOT_WHOLE)]
        if re.fullmatch(_RESERVED, name):
            raise Misread("the target is not given by numbers")
        targets.append(name if literal is None else literal)
    frames: tuple[ir.Value, ir.Value] = ir.Copy("$BASE"), ir.Copy("$TOOL")
    if own:
        frames = ir.Copy(f"{own}.BASE", through=True), ir.Copy(f"{own}.TOOL", through=True)
    plain = all(isinstance(each, Literal) for each in targets)
    count = len(targets)
    move = ir.Move(motion, tuple(targets), frames[:1] * count, frames[1:] * count, repeats=plain)
    return [*found, move]


def _settings(line: Line, text: str) -> tuple[list[Op], str]:
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
        elif mode := re.fullmatch(rf"\$IPO_MODE=SIPO_MODE\(({_NAME})\.\w+\)", text[start:end]):
            frames[name] = mode[1]
        elif not name.startswith("$") or _MOVING.match(text[start:end]):
            raise Misread("the settings of the move are unknown", "set them before it")
        else:
            found += [op for op in _set(line, name, value) if not isinstance(op, ir.Havoc)]
    if ir.calls(found) or (
        frames and (not {"$BASE", "$TOOL"} <= frames.keys() or len(set(frames.values())) > 1)
    ):
        raise Misread("the settings of the move call a routine, or set one frame only", "set them before it")
    return found, frames.get("$TOOL", "")


def _spline(line: Line, match: re.Match[str]) -> list[Op]:
    """Take the beginning of a block of splines; the frames of a block are not known in it."""
    found, own = _settings(line, match[2] or "")
    reason, remedy = "the block of splines has frames of its own", "set $BASE and $TOOL before the block"
    return [*found, *([ir.Havoc(frozenset({"$BASE", "$TOOL"}), reason, remedy)] if own else [])]


LANGUAGE: Final = ir.Language(
    comment=r";[^\r\n]*+|(?<![^\r\n])&[^\r\n]*+",
    text=r"\"[^\"\r\n]*+\"|#\w++|'[HD][0-9A-F]++'",
    word=r"\$?[^\W\d]\w*+",
    number=rf"{ir.NUMBER}|'B[01]{{1,16}}+'",
    operators="AND|OR|EXOR|NOT|B_AND|B_OR|B_EXOR|B_NOT",
    reserved=_RESERVED,
    # KSS: arithmetic, strings, the state of variables, pulses, and what inline forms set speeds by
    functions=r"ABS|SQRT|SIN|COS|TAN|ACOS|ATAN2|ROUND|TRUNC|INV_POS|VARSTATE|GET_SYSTEM_DATA|PULSE"
    r"|STR(?:ADD|CLEAR|COMP|COPY|DECLLEN|FIND|LEN|TOINT|TOREAL)|S(?:VEL|ACC)_(?:JOINT|CP)|SAPO(?:_PTP)?|SORI_TYP"
    r"|S(?:GEAR_)?JERK|SLOAD|SIPO_MODE|SCIRC_TYPE|USE_CM_PRO_VALUES",
    motion=r"\b(?:S?(?:PTP|LIN|CIRC|SPL)(?:_REL)?)(?!\w)",
    remedy=_REMEDY,
    active={"$BASE": "active $BASE", "$TOOL": "active $TOOL"},
    constants={name: np.eye(4) for name in ("$NULLFRAME", "BASE_DATA[0]", "TOOL_DATA[0]")},
    is_frame=lambda name: name.startswith(("BASE_DATA[", "TOOL_DATA[")),
    rules=(
        (rf"S?(PTP|LIN|CIRC|SPL)(?: |(?=\{{))({_TARGET})(?:,({_TARGET}))?{_BLEND}(?: ?WITH (.*))?", _move),
        (rf"(?:GLOBAL )?DEF(?:FCT {_NAME}(?:\[\])?)? ({_NAME})(?:\((.*)\))?(?: ?PUBLIC)?", _routine),
        (
            r"DEFDAT \w+(?: PUBLIC)?|ENDDAT|HALT|CONTINUE|ENDSPLINE.*|INTERRUPT (?:ON|OFF)|INTERRUPT OFF \0",
            "",
        ),
        (r"(?:EXT(?:FCT)?P?|ENUM|STRUC|IMPORT|(?:DECL )?(?:GLOBAL )?SIGNAL) [\w ,()\[\]:$.\0\"#]*", ""),
        (r"END|ENDFCT", "end"),
        (r"IF ?(.*?) ?THEN|SWITCH ?(.+)", "if"),
        (r"ELSE|CASE ?(.+)", "turn"),
        (r"DEFAULT", "default"),
        (r"ENDIF|ENDSWITCH|ENDFOR|ENDWHILE|ENDLOOP|UNTIL ?(.+)", "close"),
        (rf"WHILE ?(.+)|FOR ({_NAME})=(.+)", _loop),
        (r"LOOP|REPEAT", "repeat"),
        (r"EXIT", "leave"),
        (rf"GOTO ({_NAME})", lambda _, match: [ir.Flow("jump", match[1])]),
        (rf"({_NAME}):", lambda _, match: [ir.Flow("label", match[1])]),
        (r"RETURN ?(.*)", "return"),
        (r"WAIT (?:SEC|FOR) ?(.+)|ANOUT (?:ON|OFF) ?(.+)|(PULSE\(.*\))", ""),
        (rf"(?:GLOBAL )?INTERRUPT DECL \0 WHEN (.+?) ?DO ({_NAME})\((.*)\)", _interrupt),
        (r"INTERRUPT ON (\0)", _interruptible),
        (
            rf"TRIGGER WHEN (.+?) ?DO (?:\$OUT(\[.*)|PULSE(\(.*\))|({_NAME})(\(.*\))(?: ?PRIO=(.+))?)",
            _trigger,
        ),
        (r"(?:GLOBAL )?(?:INTERRUPT DECL|TRIGGER) .*", _later),
        (r"BAS\(#(\w+)(?:,(.+))?\)", _bas),
        (rf"(?:PTP_)?SPLINE{_BLEND}(?: ?WITH (.*))?{_BLEND}", _spline),
        (
            rf"(?:(?:DECL |GLOBAL |CONST )+{_NAME}|(?:GLOBAL )?(?:INT|REAL|BOOL|CHAR|FRAME"
            rf"|(?:E6)?(?:POS|AXIS)|[FPL]DAT|LOAD)) ({_NAME}.*)",
            _declared,
        ),
        (rf"({_NAME})\((.*)\)", _called),
        (rf"({_NAME})((?:\[[^\]=]*+\]|\.\w++)*)=(?!=)(.*)", _assigned),
        (rf"S?(?:PTP|LIN|CIRC|SPL)(_REL)?(?: |(?=\{{))(.+?){_BLEND}", _computed),
    ),
)


def read_krl(machine: Machine, sources: tuple[Source, ...]) -> None:
    """Read a .src, and the .dat files beside it."""
    main = re.search(
        rf"(?im)^[ \t]*+(?:GLOBAL[ \t]++)?DEF(?:FCT[ \t]++\w++)?[ \t]++({_NAME})", sources[0].text
    )
    for index, source in enumerate(sources):
        is_config = source.name.lower().endswith("config.dat")
        head = rf"(?im)^[ \t]*+DEFDAT[ \t]++({_NAME})([ \t]++PUBLIC\b)?"
        data = re.search(head, source.text) if index else None
        if main and data and not is_config and data[1].upper() != main[1].upper():
            reason, remedy = f"it declares data of {data[1]}, not of {main[1]}", "send the .dat of the .src"
            machine.refuse(source.line(data.start()), reason, remedy, index)
        declares = source.name.lower().endswith(".dat") and len(sources) > 1
        # no other program changes a .dat that is not public
        kind = "shared" if is_config else "variable" if data and data[2] else "constant"
        machine.add(index, source.starts, source.ends, declares=kind if declares else "")
