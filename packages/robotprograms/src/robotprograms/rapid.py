"""Programs of ABB (RAPID, .mod and .sys), translated."""

from __future__ import annotations

import re
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np

from robotprograms import language as ir
from robotprograms.arrays import IndexArray
from robotprograms.columns import IN_MODULE
from robotprograms.errors import capitalise
from robotprograms.language import UNKNOWN_STATEMENT, Line, Misread, Op, split_outside_brackets
from robotprograms.notation import Notation, Orientation
from robotprograms.program import Literal, Motion, Source
from robotprograms.statements import Statements

POSE: Final = Notation(Orientation.QUATERNION, angle=1, length_decimals=4, angle_decimals=8)
JOINTS: Final = Notation(Orientation.JOINTS, length_decimals=5)
_AXES: Final = Notation(Orientation.NONE)  # of external axes alone, which are no target
_MOTIONS: Final = {"L": Motion.LINEAR, "J": Motion.JOINT, "C": Motion.CIRCULAR}
# Facts. Source: ABB, Technical reference manual, RAPID instructions, functions and data types (3HAC050917).
_ARGUMENTS_AFTER_TOOL: Final = {"DO": 2, "AO": 2, "GO": 2, "SYNC": 1}
"""Count of the arguments behind the tool, for MoveLDO, MoveJSync and the like."""
# Optional arguments of moves that do not move the target, as \Corr and \Track would
_OPTIONS: Final = re.compile(r"CONC|ID|V|T|Z|INPOS|WOBJ|TLOAD|NOEOFFS|T\d|D?VALUE")
# Instructions that set configuration, speed, waiting, signals, messages, clocks, interrupts and units: no
# target, no frame and no variable of the program changes by them
_HARMLESS: Final = (
    r"CONF[LJ]|ACCSET|SINGAREA|CIRPATHMODE|PATHRESOL|GRIPLOAD|MOTIONSUP|(?:DE)?ACTUNIT|MECHUNITLOAD|WAITSYNCTASK"
    # Moves name their tool and work object, whatever is active for jogging.
    r"|SETSYSDATA"
    # Moves of several robots at once have the targets, tools and work objects that they name.
    r"|SYNCMOVE(?:ON|OFF|UNDO|SUSPEND|RESUME)"
    r"|WAIT(?:TIME|[DGA][IO]|UNTIL|ROB)|SET(?:[DGA]O)?|RESET|(?:PULSE|INVERT)DO|TP(?:WRITE|ERASE)|ERR(?:WRITE|LOG)"
    r"|WRITE(?:(?:ANY|STR)?BIN|BLOCK|CFGDATA|RAWBYTES|VAR(?:ARR)?)?|OPEN|CLOSE|REWIND|TPREAD(?:FK|D?NUM)"
    r"|SOCKET(?:ACCEPT|BIND|CLOSE|CONNECT|CREATE|LISTEN|(?:RECEIVE|SEND)(?:FROM|TO)?)"
    r"|UI(?:MSG(?:BOX|WRITE(?:ABORT)?)|SHOW)|CLK(?:START|STOP|RESET)|STOP|EXIT|BREAK|I(?:SLEEP|WATCH|DISABLE|ENABLE|DELETE|SIGNALD[IO])|TRIGG(?:IO|EQUIP|INT)"
    # Corrections of paths act on moves with \Corr only; FCCalib measures the tool's weight.
    # Supervision and conditions of force control, and settings of EGM, act once their control is active.
    r"|FC(?:SUPV|COND)\w+|EGM(?:GETID|(?:SETUP|STREAM)\w+)"
    r"|FCCALIB|DROPWOBJ|CORR(?:CON|DISCON|CLEAR|WRITE)|(?:START|STOP)MOVE|(?:STORE|RESTO|CLEAR)PATH"
)
# Instructions that give values to their arguments
_CHANGES_ARGUMENTS: Final = re.compile(
    r"INCR|DECR|ADD|CLEAR|[MS]TOOL\w+CALIB|\w*LOADID\w*|GETDATAVAL|RMQ(?:GET|READ)\w+|READ\w*BIN|(?:READ|UNPACK)RAWBYTES"
)
# Moves of a process, and instructions that shift targets and frames: neither can be corrected
_PROCESS_MOVE: Final = re.compile(
    r"(?:ARCMOVE|SPOTM?|PAINT|DISP|CAP|NUT|GLUE)(?P<letter>[LCJ])|ARC(?P<first>[LC])(?:(?:START|END)\d?+)?|TRIGGLIOS"
)
# Optional arguments of such moves that do not move the target, as \Track would
_PROCESS_OPTIONS: Final = re.compile(
    rf"{_OPTIONS.pattern}|ON|OFF|G\d|WEAVE|SEAMNAME|TIME|TRIGGDATA\d|(?:OPEN|CLOSE|WAIT|IN|OUT)\w*"
)
# The robot's searches, which write their second argument, and those of SmarTac, which write the first one
# ABB, application manual Arc: the speed of a weld is that of the welddata, in a unit that the controller's
# configuration chooses; ArcLStart, and \On, move to the weld at the speed of the move. Continuous application
# platform: the speed is that of the capdata.
_HAS_PROCESS_SPEED: Final = re.compile(r"ARC[LC](?:END\d?+)?|CAP[LCJ]")
_SEARCH: Final = re.compile(r"SEARCH(?:[LCJ]|EXTJ|(?P<smart>_(?:[123]D|GROOVE|PART)))")
_SHIFT: Final = re.compile(r"PDISP|EOFFS|SOFT|CSS|CORR|WAITWOBJ|IND")
_END_OF_LASTING: Final = {
    "PDISPOFF": "PDISP", "EOFFSOFF": "EOFFS", "SOFTDEACT": "SOFT", "FCDEACT": "FC", "FCPRESSEND": "FC",
    "EGMRESET": "EGM", "CSSDEACTMOVEJ": "CSS", "CSSDEACTMOVEL": "CSS",
}  # fmt: skip
"""Kinds of what lasts, by the instructions that end it."""
# Force control, and guidance from outside
_LASTING: Final = re.compile(r"(FC|EGM)\w+")
_FORCE_MOVE: Final = re.compile(r"FCPRESS\w*")
_WRITES_DATA: Final = re.compile(r"SET(?:ALL)?DATAVAL")
_RESERVED: Final = (
    r"(?:END)?(?:MODULE|PROC|FUNC|TRAP|RECORD)|LOCAL|TASK|CONST|PERS|VAR|IF|THEN|ELSE|ELSEIF|ENDIF|FOR|FROM|TO"
    r"|STEP|DO|ENDFOR|WHILE|ENDWHILE|TEST|CASE|DEFAULT|GOTO|ERROR|UNDO|BACKWARD|CONNECT|WITH|RETURN|RAISE|RETRY"
    r"|TRYNEXT|EXIT|ENDTEST|MOVE(?:[LJC](?:DO|AO|GO|SYNC)?|ABSJ|EXTJ)|TRIGG[LJC]"
)
# Functions that return a value and change nothing
_FUNCTIONS: Final = (
    r"(?:ABS|A?COS|A?SIN|A?TAN2?|POW|SQRT|ROUND|TRUNC)(?:DNUM)?|EXP|MAX|MIN|DIM|PRESENT|TYPE|ARGNAME|VALIDIO|TESTDI"
    r"|[DGA](?:IN|OUT)PUT|CLKREAD|(?:D?NUM|VAL|BYTE)TOSTR|(?:NUMTOD|DNUMTO)NUM|DECTOHEX|HEXTODEC|STRTOBYTE"
    r"|STR(?:LEN|PART|FIND|MATCH|MEMB|MAP|ORDER)|BIT(?:AND|CHECK|LSH|NEG|OR|RSH|XOR)|C(?:ROBT|JOINTT|POS|TOOL|WOBJ|DATE|TIME)"
    r"|CALC(?:ROBT|JOINTT)|OFFS|RELTOOL|OROBT|MIRPOS|POSE(?:MULT|INV|VECT)|DEF(?:D|ACC)?FRAME|(?:ORIENT|EULER)ZYX|NORIENT"
    r"|DISTANCE|VECTMAGN|DOTPROD|CROSSPROD|MAX(?:ROB|EXTLINEAR|EXTREORIENT)SPEED|IS(?:PERS|VAR|FILE|STOPSTATEEVENT)"
    r"|OPMODE|RUNMODE|EXECHANDLER|EXECLEVEL|GET(?:TIME|SYSINFO|MOTORTORQUE|TASKNAME)|IOUNITSTATE|TASKRUN(?:MEC|ROB)|ROBNAME"
    r"|READ(?:STR|NUM)|UI(?:ALPHA|D?NUM)ENTRY|UIMESSAGEBOX|UILISTVIEW"
)
_REMEDY: Final = (
    "write the target as [[x, y, z], [q1 ... q4], [cf1 ... cfx], [external axes]] in numbers, or "
    "declare such a target"
)
_FRAME_REMEDY: Final = "declare the frame in numbers"
_WORD: Final = r"[^\W\d]\w*+"
_ZONE: Final = r"FINE|Z\d{1,3}+"  # names of the controller's zones
_N3, _N4, _N6 = (rf"\[\0(?:,\0){{{n - 1}}}\]" for n in (3, 4, 6))
_POSE_PATTERN: Final = rf"\[{_N3},{_N4}\]"
_LITERALS: Final = {
    "ROBTARGET": re.compile(rf"\[{_N3},{_N4},({_N4}|{_WORD}),(?:{_N6}|(?P<axes>{_WORD}))\]"),
    "JOINTTARGET": re.compile(rf"\[{_N6},(?:{_N6}|(?P<axes>{_WORD}))\]"),
    "EXTJOINT": re.compile(_N6),
    "WOBJDATA": re.compile(rf'\[FALSE,TRUE,"[^"]*",{_POSE_PATTERN},{_POSE_PATTERN}\]'),
    "TOOLDATA": re.compile(rf"\[TRUE,{_POSE_PATTERN},(.*)\]"),
    "SPEEDDATA": re.compile(_N4),
}
_NUMBERS: Final = Notation(Orientation.NONE)  # of a speed, whose first number is that of the tool's centre
_SPEED: Final = re.compile(r"V(\d{1,5})")
"""Name of the controller's data of a speed [mm/s]."""
_PERCENTAGE: Final = f"{ir.FEED} percentage"
_GREATEST: Final = f"{ir.FEED} greatest"
"""Names of what VelSet sets for all moves: a percentage of the speed, and the greatest speed [mm/s]."""
_OWN_SPEED: Final = re.compile(r"\\(?P<option>[VT]):=(?P<number>\0(?=[,\\]))?")
"""Speed or time of a move in place of its data of a speed."""
_FRAMES_OF: Final = {"WOBJDATA": (".UFRAME", ".OFRAME"), "TOOLDATA": (".TFRAME",)}
"""Frames of work objects and tools; the second frame of a work object is given in the first."""


def _translate_routine(line: Line) -> list[Op]:
    """Return the operations that begin a routine and declare its parameters."""
    return ir.begin_routine(
        line["name"], re.findall(rf"({_WORD})(?=,|\||$|\{{)", line["parameters"]), _REMEDY
    )


def _translate_test(line: Line) -> list[Op]:
    """Return the operations of TEST up to its first CASE, DEFAULT or ENDTEST."""
    subject = ir.pass_uses(line.read_expression(line["subject"]), ir.CONDITION)
    cases = ir.mark_anytime(line.read_expression(line["first"])) if line["first"] else []
    first_case = ir.pass_uses(cases, ir.CONDITION)
    # CASE and DEFAULT end with a colon, ENDTEST does not.
    kind = "close" if line.text[-1] != ":" else "branch" if line["first"] else "default"
    return [*subject, ir.Flow("if"), *first_case, ir.Flow(kind)]


_END_OF_OPERAND: Final = re.compile(
    r"(?:(?<=[\0\w\"]) |(?<=[)\]}\"]) ?)(?<!\bAND )(?<!\bOR )(?<!\bXOR )(?<!\bNOT )(?<!\bDIV )(?<!\bMOD )"
    r"(?!(?:AND|OR|XOR|NOT|DIV|MOD)\b)(?=[^\W\d])"
)
"""Place between an operand and a word that is no operator: there, the condition of a compact IF ends."""


def _translate_compact_if(line: Line) -> list[Op]:
    """Return the operations of an IF without THEN, whose one statement may be skipped.

    Source: ABB's manual, *Compact IF*: the statement behind the condition is the branch.

    Raises:
        Misread: there is no condition, or no statement behind the condition.
    """
    begin = line.span("rest")[0]
    end = _END_OF_OPERAND.search(line.text, begin)
    if end is None or line.text.startswith("IF", end.end()):  # no IF within an IF: it would nest without end
        raise Misread(UNKNOWN_STATEMENT)
    statement = Line(line.language, line.text[end.end() :], line.ordinals_in(end.end(), len(line.text)))
    condition = line.read_expression(line.text[begin : end.start()])
    decides = ir.pass_uses(condition, ir.CONDITION)
    return [*decides, ir.Flow("if"), *line.language.apply_rules(statement), ir.Flow("close")]


def _translate_instruction(line: Line) -> list[Op]:
    """Return the operations of an instruction of the controller, or of the call of a routine."""
    name = line["name"]
    found = _read_arguments(line)
    names = _find_names(found)
    if _CHANGES_ARGUMENTS.fullmatch(name):
        return [*found, ir.MakeUnknown(names, f"{name} changes the value while the program runs", _REMEDY)]
    if name == "SINGAREA" and "WRIST" in line["arguments"]:
        note = ir.Note("SingArea \\Wrist: near singularities the tool turns away from its stated orientation")
        return [*found, note]
    if re.fullmatch(_HARMLESS, name):
        uses = ir.pass_uses(found, ir.CONDITION) if name == "WAITUNTIL" else ir.omit_uses(found)
        return [*uses, ir.Call(name, names, harmless=True)]
    if match := _PROCESS_MOVE.fullmatch(name):
        return _translate_process_move(line, match["letter"] or match["first"] or "L", found)
    if match := _SEARCH.fullmatch(name):
        return _translate_search(line, found, 1 - bool(match["smart"]))
    if _FORCE_MOVE.fullmatch(name):
        return _translate_force_move(line, found)
    if lasting := _translate_lasting(name, names):
        return [*found, *lasting]
    # If a routine of the program has the name, the program states what the routine changes.
    own = ir.Call(name, names, harmless=True)
    return [*ir.pass_uses(found, name), own, ir.Call(name, names - _find_frames_of_move(line))]


def _translate_speeds(line: Line) -> list[Op]:
    """Return the operations by which VelSet changes the speeds of all moves behind it."""
    found = _read_arguments(line)
    ops = [*ir.omit_uses(found), ir.Call("VELSET", _find_names(found), harmless=True)]
    spans = list(split_outside_brackets(line.text, line.span("arguments")[0]))
    for i, name in enumerate((_PERCENTAGE, _GREATEST)):
        start, end = spans[i] if i < len(spans) else (0, 0)
        is_number = line.text[start:end].strip() == "\0"
        number = Literal(_NUMBERS, line.ordinals_in(start, end))
        ops.append(ir.Assign(name, number if is_number else ir.Unknown("VelSet is computed", _REMEDY)))
    return ops


_MOVE_NAME: Final = re.compile(r"(?!.*(?:CAL|MEAS|TCP|TOOL|WOBJ))\w*[LJC](?:START|END)?\d?+")


def _find_frames_of_move(line: Line) -> frozenset[str]:
    """Return tool and work object of an instruction in the form of a move, which only uses them.

    Its name ends as those of moves do; a speed, a zone and the tool are its last arguments.
    """
    try:
        spans, work_object, _ = _split_arguments(line, line.span("arguments")[0], re.compile(r"\w*"))
    except Misread:  # the work object is computed
        return frozenset()
    arguments = [line.text[slice(*each)] for each in spans]
    if len(arguments) < 4 or not (_MOVE_NAME.fullmatch(line["name"]) and re.fullmatch(_ZONE, arguments[-2])):
        return frozenset()
    return frozenset({arguments[-1], work_object})


def _read_arguments(line: Line) -> list[Op]:
    """Return the operations of the arguments of an instruction.

    Raises:
        Misread: the arguments are not expressions.
    """
    # Options such as \WObj:=frame become arguments of their own.
    text = re.sub(r"\\(\w+)(:=)?", r",\1,", line["arguments"])
    arguments = (text[begin:end] for begin, end in split_outside_brackets(text))
    return [op for each in arguments if each.strip() for op in line.read_expression(each.strip())]


def _find_names(found: list[Op]) -> frozenset[str]:
    """Return the names that operations of expressions use."""
    used = (each for op in found if isinstance(op, ir.Use) for each in op.names)
    return frozenset(each for each in used if isinstance(each, str))


def _translate_late_call(line: Line) -> list[Op]:
    """Return the operations of a call of a routine whose name is computed while the program runs."""
    text = line["routine"] or f"{line['variable']}+N"  # CallByVar "sub",n calls sub1, sub2 and so on
    name, prefix = _read_routine(text)
    found = [*(line.read_expression(text) if prefix is not None else []), *_read_arguments(line)]
    found += line.read_expression(line["more"]) if line["more"] else []
    return [*found, ir.Call(name, _find_names(found), prefix=prefix)]


def _read_routine(text: str) -> tuple[str, str | None]:
    """Return the name of a routine in quotations; of a computed name the text, and its beginning if known."""
    if re.fullmatch(rf'"{_WORD}"', text):
        return text.strip('"'), None
    begin = re.match(r'"(\w*)"', text)
    return text.replace("\0", "n"), begin[1] if begin else ""


def _translate_process_move(line: Line, letter: str, found: list[Op]) -> list[Op]:
    """Return the operations of a move of a process such as welding, whose last argument is the tool.

    The move is not corrected if it has an option that may move the target, such as the one of tracking.
    `found` are the operations of its arguments.
    """
    name, count = line["name"], 1 + (letter == "C")
    remedy = "write the move as MoveL, MoveJ or MoveC"
    try:
        spans, work_object, _ = _split_arguments(line, line.span("arguments")[0], _PROCESS_OPTIONS)
    except Misread as fault:
        return _leave_instruction(line, found, f"{name}: {fault.reason}", remedy)
    arguments = [line.text[slice(*each)] for each in spans]
    targets = [
        each if re.fullmatch(_WORD, each) else _read_target(line, *span)
        for each, span in zip(arguments[:count], spans, strict=False)
    ]
    known = tuple(each for each in targets if each is not None)
    # behind the targets come at least speed, data of the process or zone, and the tool
    if len(arguments) < count + 3 or len(known) < count or not re.fullmatch(_WORD, arguments[-1]):
        reason = f"{name}: target or tool is not given by numbers"
        return _leave_instruction(line, found, reason, remedy)
    others = [op for each in arguments[count:] for op in line.read_expression(each)]
    if ir.calls_routine(found):
        return ir.make_uncorrected_move(found, f"{name}: an argument of the move is computed", remedy)
    base, tool = _multiply_frames(work_object, "WOBJDATA"), _multiply_frames(arguments[-1], "TOOLDATA")
    approaches = re.search(r"\\ON\b", line["arguments"]) is not None
    has_process_speed = _HAS_PROCESS_SPEED.fullmatch(name) and not approaches
    feed = None if has_process_speed else _read_feed(line, *spans[count])
    return [*others, ir.Move(_MOTIONS[letter], known, (base,) * count, (tool,) * count, feed=feed)]


def _translate_search(line: Line, found: list[Op], index: int) -> list[Op]:
    """Return the operations of a search, which gives the place of a signal to its argument at an index.

    `found` are the operations of its arguments.
    """
    reason, remedy = f"{line['name']} moves until a signal comes", "omit the statement"
    plain = [each for each in line["arguments"].split(",") if not each.lstrip().startswith("\\")]
    name = re.match(_WORD, plain[index].strip()) if len(plain) > index else None
    names = frozenset({name[0]}) if name else _find_names(found)
    return [ir.MakeUnknown(names, reason, remedy), *_leave_instruction(line, found, reason, remedy)]


def _translate_force_move(line: Line, found: list[Op]) -> list[Op]:
    """Return the operations of a move under force control, which the last of such moves ends."""
    reason = f"{line['name']} may move targets or frames"
    is_end = line["name"] == "FCPRESSEND"
    change = ir.end_lasting("FC") if is_end else ir.begin_lasting("FC", reason, "omit the statement")
    return [*_leave_instruction(line, found, reason, "omit the statement"), change]


def _leave_instruction(line: Line, found: list[Op], reason: str, remedy: str) -> list[Op]:
    """Return the operations of an instruction that moves and is not corrected; its last argument is the tool.

    `found` are the operations of its arguments.
    """
    try:
        spans, work_object, options = _split_arguments(line, line.span("arguments")[0], re.compile(r"\w*"))
    except Misread:  # the work object is computed
        return ir.make_uncorrected_move(found, reason, remedy)
    arguments = [line.text[slice(*each)] for each in spans] or [""]
    move = _leave_move(line, arguments[:-1], arguments[-1], work_object, (reason, remedy))
    return [*options, *move]


_OFFSET: Final = re.compile(rf"(?:OFFS|RELTOOL)\(({_WORD}),(.+)\)")


def _leave_move(
    line: Line,
    arguments: list[str],
    tool: str,
    work_object: str,
    words: tuple[str, str],
    motion: Motion = Motion.LINEAR,
) -> list[Op]:
    """Return the operations of a move that is not corrected; `words` are reason and remedy.

    The move ends at the points that its arguments name, or at offsets from them: their corrections shift it.
    """
    offsets = [_OFFSET.fullmatch(each) for each in arguments]
    points = frozenset(
        offset[1] if offset else each
        for offset, each in zip(offsets, arguments, strict=True)
        if offset or re.fullmatch(_WORD, each)
    )
    texts = [offset[2] if offset else each for offset, each in zip(offsets, arguments, strict=True)]
    uses = [op for each in (*texts, tool) if each for op in line.read_expression(each) if each not in points]
    if not re.fullmatch(_WORD, tool):
        return ir.make_uncorrected_move([*uses, ir.Use(points)], *words, motion)
    frames = _multiply_frames(work_object, "WOBJDATA"), _multiply_frames(tool, "TOOLDATA")
    reason, remedy = words
    move = ir.Move(motion, (), frames[:1], frames[1:], reason=reason, remedy=remedy)
    return [*uses, move._replace(offset_from=tuple(sorted(points)))]


def _translate_lasting(name: str, names: frozenset[str]) -> list[Op]:
    """Return the operations of an instruction that begins or ends what lasts; [] for any other one."""
    if name in _END_OF_LASTING:
        return [ir.end_lasting(_END_OF_LASTING[name])]
    if _WRITES_DATA.fullmatch(name):
        return [ir.MakeUnknown(each, f"{name} may move targets or frames", "omit the statement")
                for each in (names, frozenset({ir.MODE}))]  # fmt: skip
    if match := _LASTING.fullmatch(name):
        return [ir.begin_lasting(match[1], f"{name} may move targets or frames", "omit the statement")]
    if match := _SHIFT.match(name):
        reason = f"{name} moves targets or frames"
        if match[0] == "WAITWOBJ":  # a conveyor moves this work object, and no other one
            return [ir.MakeUnknown(names, reason, "omit the statement", anytime=True)]
        return [ir.begin_lasting(match[0], reason, "omit the statement")]
    return []


def _read_target(line: Line, start: int, end: int) -> Literal | None:
    """Return the robtarget or jointtarget between two indices of the text; None if neither is there."""
    numbers = line.ordinals_in(start, end)
    if match := _LITERALS["ROBTARGET"].fullmatch(line.text, start, end):
        count = 11 if match[1][0] == "[" else 7  # a variable may hold the configuration
        words = tuple(zip(("cf1", "cf4", "cf6", "cfx"), numbers[7:count], strict=False))
        return Literal(POSE, numbers[:7], numbers[count:], words, axes_name=match["axes"] or "")
    if match := _LITERALS["JOINTTARGET"].fullmatch(line.text, start, end):
        return Literal(JOINTS, numbers[:6], numbers[6:], axes_name=match["axes"] or "")
    return None


def _assign_data(line: Line, name: str, start: int, end: int, *kinds: str) -> list[ir.Assign]:
    """Return the assignments of the numbers between two indices of the text to data of one of these kinds.

    A target and a tool give one assignment; a work object gives two, one for each of its frames. Return []
    if the text is not data in numbers.
    """
    target = _read_target(line, start, end)
    # A variable with external axes may change, or mean another one, before the target is used.
    if target is not None and not target.axes_name and {"ROBTARGET", "JOINTTARGET"} & set(kinds):
        return [ir.Assign(name, target)]
    if "EXTJOINT" in kinds and _LITERALS["EXTJOINT"].fullmatch(line.text, start, end):
        return [ir.Assign(name, Literal(_AXES, line.ordinals_in(start, end)))]
    if "SPEEDDATA" in kinds and _LITERALS["SPEEDDATA"].fullmatch(line.text, start, end):
        return [ir.Assign(name, Literal(_NUMBERS, line.ordinals_in(start, end)[:1]))]
    for kind, frames in _FRAMES_OF.items():
        match = _LITERALS[kind].fullmatch(line.text, start, end) if kind in kinds else None
        if match and not (match.re.groups and ir.calls_routine(line.read_expression(match[1]))):
            numbers = line.ordinals_in(start, end)
            return [
                ir.Assign(name + frame, Literal(POSE, numbers[7 * k : 7 * k + 7]))
                for k, frame in enumerate(frames)
            ]
    return []


def _multiply_frames(name: str, kind: str) -> ir.Product:
    """Return the product of the frames of data `name`; `kind` is WOBJDATA (work object) or TOOLDATA."""
    return ir.Product(tuple(f"{name}{frame}" for frame in _FRAMES_OF[kind]))


def _translate_declaration(line: Line) -> list[Op]:
    """Return the operations of a declaration, which gives numbers or an unknown value to a name."""
    name, value = line["name"], line["value"]
    found: list[Op] = [
        ir.Local(frozenset({name})),
        *line.read_expression(line["array"]),
    ]
    assigned = []
    if value and not line["array"]:
        assigned = _assign_data(line, name, *line.span("value"), line["type"])
    if assigned:
        declares = "constant" if line["kind"] == "CONST" else "variable"
        private = line["scope"] == "LOCAL"
        return [*found, *(each._replace(declares=declares, private=private) for each in assigned)]
    found += ir.pass_uses(line.read_expression(value), name)
    kind = "frame" if "DATA" in line["type"] else "target"
    reason = f"{name} is not a fixed {kind} in numbers, or changes while the program runs"
    return [*found, ir.MakeUnknown(frozenset({name}), reason, _FRAME_REMEDY)]


def _translate_assignment(line: Line) -> list[Op]:
    """Return the operations of an assignment, which gives numbers or an unknown value to a name."""
    name, part, value = line["name"], line["part"], line["value"]
    assigned = [] if part else _assign_data(line, name, *line.span("value"), *_LITERALS)
    if part in {".UFRAME", ".OFRAME", ".TFRAME"} and re.fullmatch(_POSE_PATTERN, value):
        assigned = [ir.Assign(name + part, Literal(POSE, line.ordinals_in(*line.span("value"))))]
    if assigned:
        return list(assigned)
    index = part.replace("{", ",[").replace("}", "]").lstrip(",") if "{" in part else ""
    uses = [*line.read_expression(index), *line.read_expression(value)]
    reason = f"{name} changes while the program runs"
    return [*ir.pass_uses(uses, name), ir.MakeUnknown(frozenset({name}), reason, _FRAME_REMEDY)]


def _translate_move(line: Line) -> list[Op]:
    """Return the operations of a move; it is not corrected without target in numbers or with other options.

    Raises:
        Misread: its arguments are not expressions.
    """
    called = list[Op]()
    if line["process"] == "SYNC":  # the last argument is the name of a routine that is called at the target
        name, prefix = _read_routine(line["arguments"].rsplit(",", 1)[-1].strip())
        called.append(ir.Call(name, anytime=True, event="\0target", prefix=prefix))
    try:
        return [*called, *_translate_plain_move(line)]
    except Misread as fault:
        if not fault.remedy:
            raise
        return [*called, *_leave_instruction(line, _read_arguments(line), fault.reason, fault.remedy)]


def _translate_plain_move(line: Line) -> list[Op]:
    """Return the operations of a move whose arguments are complete.

    Raises:
        Misread: arguments are missing, unknown or computed.
    """
    has_trigger = bool(line["trigger"])
    letter = line["letter"] or line["trigger"] or "J"
    count = 1 + (letter == "C")  # count of the targets
    tool_index = count + 2 + has_trigger  # the tool is behind targets, speed, trigger and zone
    after_tool = _ARGUMENTS_AFTER_TOOL.get(line["process"], 0) - ("\\VALUE:=" in line.text)
    spans, work_object, found = _split_arguments(line, line.span("arguments")[0])
    arguments = [line.text[slice(*each)] for each in spans]
    if len(arguments) != tool_index + 1 + after_tool or not re.fullmatch(_WORD, arguments[tool_index]):
        reason = "the target is not given by numbers, or the move names no speed, zone and tool"
        raise Misread(
            reason, "write speed, zone and tool by their names, and \\WObj:= if there is a work object"
        )
    targets = [
        each if re.fullmatch(_WORD, each) else _read_target(line, *span)
        for each, span in zip(arguments[:count], spans, strict=False)
    ]
    known = tuple(each for each in targets if each is not None)
    if len(known) < count:
        words = "the target is not given by numbers", _REMEDY
        left = _leave_move(
            line, arguments[:count], arguments[tool_index], work_object, words, _MOTIONS[letter]
        )
        return [*found, *left]
    found += [op for each in arguments[count:] for op in line.read_expression(each)]
    if ir.calls_routine(found):
        raise Misread("an argument of the move is computed", "write speed, zone and tool by their names")
    base, tool = (
        _multiply_frames(work_object, "WOBJDATA"),
        _multiply_frames(arguments[tool_index], "TOOLDATA"),
    )
    feed = _read_feed(line, *spans[count])
    return [*found, ir.Move(_MOTIONS[letter], known, (base,) * count, (tool,) * count, feed=feed)]


def _read_feed(line: Line, start: int, end: int) -> ir.Feed | None:
    """Return the feed of a move whose data of a speed are between two indices; None if it is computed."""
    feed = _read_own_feed(line, start, end)
    return feed and feed._replace(percentage=_PERCENTAGE, greatest=_GREATEST)


def _read_own_feed(line: Line, start: int, end: int) -> ir.Feed | None:
    """Return the feed of a move, without what VelSet sets for all moves; None if it is computed."""
    own = _OWN_SPEED.search(line.text, line.span("arguments")[0])
    if own is not None:  # a time in place of a speed gives no feed
        numbers = line.ordinals_in(*own.span("number")) if own["option"] == "V" and own["number"] else ()
        return ir.Feed(Literal(_NUMBERS, numbers)) if numbers else None
    text = line.text[start:end]
    if _LITERALS["SPEEDDATA"].fullmatch(text):
        return ir.Feed(Literal(_NUMBERS, line.ordinals_in(start, end)[:1]))
    if not re.fullmatch(_WORD, text):
        return None
    known = _SPEED.fullmatch(text)
    return ir.Feed(ir.Copy(text), otherwise=float(known[1]) if known else np.nan)


def _split_arguments(
    line: Line, start: int, known_options: re.Pattern[str] = _OPTIONS
) -> tuple[list[tuple[int, int]], str, list[Op]]:
    """Return the spans of a move's arguments, the name of its work object, and its options' operations.

    `known_options` is the pattern of options that do not move the target.

    Raises:
        Misread: an option may move the target, or the work object is computed.
    """
    text, work_object = line.text, "WOBJ0"
    found, spans = list[Op](), list[tuple[int, int]]()
    for i, (first, last) in enumerate(split_outside_brackets(text, start)):
        (begin, end), *options = split_outside_brackets(text[:last], first, "\\")
        # A part that has only options is not an argument; nor is an empty text before the first comma.
        if text[begin:end].strip() or (i and not options):
            spans.append((begin + (text[begin : begin + 1] == " "), end))
        for option in options:
            name, _, value = text[slice(*option)].partition(":=")
            if not known_options.fullmatch(name):
                raise Misread(
                    f"the argument \\{name} moves the target, or is not known", "omit the statement"
                )
            found += line.read_expression(value)
            if name == "WOBJ":
                if not re.fullmatch(_WORD, value):
                    raise Misread("the argument \\WObj is computed", _FRAME_REMEDY)
                work_object = value
    return spans, work_object, found


_ENDS: Final = re.compile(
    # its first characters come before all else, so that the search passes quickly over all others
    r"(?=[\"!%;:<BDEFMPTUbdefmptu])(?:"
    r"\"[^\"\r\n]*+\"|![^\r\n]*+|%%%[^%;!]*+%%%|(?i:(;|:(?!=)|<(?:SMT|DDN|TDN|RDL|EIT|CSE)>"
    r"|\b(?:THEN|DO|ELSE|END(?:IF|FOR|WHILE|TEST|PROC|FUNC|TRAP|MODULE|RECORD))\b"
    r"|(?<![\w\\.])(?:ERROR|UNDO|BACKWARD)\b(?!\s*+:?=)(?:\s*+\([^()]*\))?"
    r"|\b(?:PROC|FUNC\s++\w++)\s++\w++\s*+\([^()]*\)|\bTRAP\s++\w++"
    r"|(?P<head>\bMODULE\s++\w++(?:\s*+\([^()]*\))?))))"
)
"""End of a statement; texts and comments match without group 1, because no statement ends in them.

The head of a module is a statement of its own, also behind other text."""


def read_rapid(statements: Statements, sources: tuple[Source, ...]) -> None:
    """Add the statements of a module, and those of the other modules of its task.

    Further modules, in the same file or in further files, are parts of the same program; moves of further
    files are not corrected.
    """
    statements.columns.spelled.update(WOBJ0="wobj0", TOOL0="tool0")
    texts, parts = list[str](), list[tuple[int, IndexArray, IndexArray]]()
    for index, source in enumerate(sources):
        starts, ends, heads = _find_statements(source.text)
        for begin, end in pairwise((0, *heads[1:], len(source.text))):
            first, last = np.searchsorted(starts, (begin, end)).tolist()
            texts.append(capitalise(source.text[begin:end]))
            parts.append((index, starts[first:last], ends[first:last]))
    names = [set(re.findall(_LOCAL, _TEXT_OR_COMMENT.sub(" ", text))) for text in texts]
    words = [set(re.findall(_WORD, text)) if len(texts) > 1 else set[str]() for text in texts]
    for k, (index, starts, ends) in enumerate(parts):
        # The first module keeps its names, so that messages have them.
        elsewhere = set[str]().union(*words[:k], *words[k + 1 :]) if names[k] else set[str]()
        renamed = {name: f"{name}{IN_MODULE}0" for name in names[0] & words[k] if k}
        renamed |= {name: f"{name}{IN_MODULE}{k}" for name in names[k] & elsewhere if k}
        translate = partial(_translate_renamed, renamed=renamed) if renamed else None
        statements.add_statements(index, starts, ends, translate=translate)
    routines = {
        name for text in texts for name in re.findall(_ROUTINE, text) if _PROCESS_MOVE.fullmatch(name)
    }
    if routines:
        name = min(routines)
        reason = f"the program has its own routine {name}, but a move of a process has the same name"
        statements.forget_anytime(frozenset({ir.MODE}), reason, "give the routine another name")


_ROUTINE: Final = rf"\bPROC\s++({_WORD})"
_LOCAL: Final = rf"\bLOCAL\s++(?:PROC|TRAP|(?:FUNC|CONST|PERS|VAR)\s++\w++)\s++({_WORD})"
_TEXT_OR_COMMENT: Final = re.compile(r'"[^"\r\n]*+"|![^\r\n]*+')
_TEXT_OR_NAME: Final = re.compile(rf'"({_WORD})"|"[^"\r\n]*+"|(?<![\w.\\])({_WORD})')


def _translate_renamed(masked: str, renamed: dict[str, str]) -> list[tuple[int, Op]]:
    """Return the operations of a statement in which names of one module have other names.

    A name that is LOCAL in one module means something else in the others. Routines that are called by texts
    are renamed, too.
    """

    def rename(match: re.Match[str]) -> str:
        name = match[1] or match[2] or ""
        return match[0].replace(name, renamed.get(capitalise(name), name)) if name else match[0]

    return LANGUAGE.translate(_TEXT_OR_NAME.sub(rename, masked))


def _find_statements(text: str) -> tuple[IndexArray, IndexArray, list[int]]:
    """Return the first and the last + 1 character of each statement of a file, and where modules begin."""
    starts, ends, heads = list[int](), list[int](), list[int]()
    place = 0  # behind the last statement

    def end_statement(end: int) -> int:
        """Add the statement that ends before a character, unless it is blank; return the character."""
        start = end - len(text[place:end].lstrip())
        if start < end:
            starts.append(start)
            ends.append(end)
        return end

    for match in _ENDS.finditer(text):
        if match["head"]:
            heads.append(match.start())
            place = end_statement(match.start())
        if match[1]:
            place = end_statement(match.end())
    end_statement(len(text))
    return np.array(starts, dtype=np.intp), np.array(ends, dtype=np.intp), heads


LANGUAGE: Final = ir.Language(
    opening=r"\[\s*\[\s*",
    end_of_statement=";",
    suffixes=".mod .prg .modx .sys .sysx",
    pose=POSE,
    remark="!",
    head=r"[ \t]*+(?i:MODULE\b)",
    read=read_rapid,
    comment=r"![^\r\n]*+|(?<![^\r\n])%%%\s*+(?:(?:VERSION|LANGUAGE)\s*+:\s*+[\w\0]++\s*+)*%%%|;",
    text=r'"[^"\r\n]*+"(?:"[^"\r\n]*+")*',
    operators="AND|OR|XOR|NOT|DIV|MOD",
    reserved=_RESERVED,
    functions=_FUNCTIONS,
    # A function compares or calculates; one that measures a frame or sets it is named after that.
    readers=r"(?!\w*(?:ADJ|CAL|CHANGE|CORR|DEF|FRAME|MEAS|MOD|SET|SHIFT|TCP|TEACH|TOOL|UPD|WOBJ)|STRTOVAL)\w+",
    writers="STRTOVAL|GETNEXTSYM",  # to the last of their arguments
    motion=r"\b(?:MOVE(?:[LJC](?:DO|AO|GO|SYNC)?|ABSJ|EXTJ)|TRIGG[LJC])(?!\w)",
    remedy=_REMEDY,
    constants={"WOBJ0": np.eye(4), "TOOL0": np.eye(4)},
    field_endings=tuple(ending for endings in _FRAMES_OF.values() for ending in endings),
    is_frame=lambda _: True,
    is_reached=lambda _: False,  # each move names its tool and its work object: there is no active frame
    # an assignment without its name, displacements, words of branches, loops and routines
    lasting=r"^(?![A-Z_]).*:=|\b(?:PDISP|EOFFS|SOFT|CSS|CORR|IND|FC|EGM|WAITWOBJ)|DATAVAL|\b(?:IF|THEN|ELSE\w*|FOR|WHILE|DO|TEST|CASE"
    r"|DEFAULT|GOTO|RETURN|RAISE|RETRY|TRYNEXT|EXIT|ERROR|UNDO|BACKWARD|PROC|FUNC|TRAP|RECORD|MODULE|END\w*)\b|:$",
    calls_by_name=True,
    callable_from_outside=True,
    rules=(
        (
            r"(?:MOVE(?:ABSJ|(?P<letter>[LJC])(?P<process>DO|AO|GO|SYNC)?)|TRIGG(?P<trigger>[LJC]))"
            r"(?=[\\ \[,])(?P<arguments>.*)",
            _translate_move,
        ),
        (
            r"MOVEEXTJ(?=[\\ \[,])(?P<arguments>.*)",
            lambda line: ir.make_uncorrected_move(
                _read_arguments(line), "MoveExtJ moves external axes only", "omit the statement"
            ),
        ),
        (
            rf"MODULE {_WORD}(?:\([^()]*\))?|ENDMODULE|ENDRECORD"
            rf"|(?:LOCAL )?RECORD {_WORD}(?: {_WORD} {_WORD})?",
            "",
        ),
        (r"<(?:SMT|DDN|TDN|RDL|EIT|CSE)>", ""),  # placeholders of the editor, which do nothing
        (rf"(?:LOCAL )?(?:PROC|FUNC {_WORD}) @{{name}}\((?P<parameters>[^()]*)\)", _translate_routine),
        (r"(?:LOCAL )?TRAP @{name}", "handler"),
        (r"ENDPROC|ENDFUNC|ENDTRAP", "end"),
        (r"ERROR(?:\([^()]*\))?", lambda _: [ir.Flow("end"), ir.Flow("handler")]),
        # Both run by hand: when somebody leaves the routine in its middle, or steps back.
        (r"UNDO|BACKWARD", lambda _: [ir.Flow("end"), ir.Flow("undo")]),
        (r"IF ?(.*?) ?THEN", "if"),
        (r"ELSEIF ?(.*?) ?THEN|CASE ?(.*):", "branch"),
        (r"ELSE|DEFAULT ?:", "default"),
        (
            r"TEST ?(?P<subject>(?:(?!\b(?:CASE|DEFAULT|ENDTEST)\b).)+?) ?"
            r"(?:CASE ?(?P<first>[^:]*):|DEFAULT ?:|ENDTEST)",
            _translate_test,
        ),
        (
            r"FOR @{name} FROM ?(?P<first>.+?) ?\bTO\b ?(?P<last>.+?)(?: ?\bSTEP\b ?(?P<step>.+))? ?\bDO",
            lambda line: ir.begin_counted_loop(line, _REMEDY),
        ),
        (r"WHILE ?(?:TRUE|\(TRUE\)) ?DO", "forever"),
        (r"WHILE ?(.+?) ?DO", "loop"),
        (r"ENDIF|ENDFOR|ENDWHILE|ENDTEST", "close"),
        (r"@{name}:", "label"),
        (
            r"(?:(?P<scope>LOCAL|TASK) )?(?P<kind>CONST|PERS|VAR) @{type} @{name}"
            r"(?P<array>\{[^=]*\})?(?::=(?P<value>.+))?",
            _translate_declaration,
        ),
        (r"@{name}(?P<part>(?:\{[^{}:]*\}|\.\w+)*):=(?P<value>.+)", _translate_assignment),
        (r"(?:RETURN|RAISE|RETRY|TRYNEXT|EXIT)(?:\b ?(.+))?", "return"),
        (r"EXITCYCLE", "resume"),  # what lasts goes on when the program begins again
        (r"GOTO @{name}", "jump"),
        (
            rf"CONNECT {_WORD} WITH @{{name}}",
            lambda line: [ir.Call(line["name"], anytime=True, event="\0trap")],
        ),
        (r"IF ?(?P<rest>.*)", _translate_compact_if),
        (
            r"%(?P<routine>[^%]+)%(?P<arguments>[^%]*)|CALLBYVAR (?P<variable>[^,]+),(?P<more>.+)",
            _translate_late_call,
        ),
        (r"VELSET (?P<arguments>.*)", _translate_speeds),
        (r"@{name} ?(?P<arguments>.*)", _translate_instruction),
    ),
)
