"""Programs of ABB (RAPID, .mod and .sys), translated."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from typing import Final, NamedTuple

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
    """Translate the head of a routine, which begins the routine and declares its parameters."""
    # A parameter ends before a comma, the sign `|`, the brackets of an array, or the end.
    parameters = re.findall(rf"({_WORD})(?=,|\||$|\{{)", line["parameters"])
    return ir.begin_routine(line["name"], parameters, _REMEDY)


def _translate_test(line: Line) -> list[Op]:
    """Translate TEST (the switch statement of RAPID) up to its first CASE, DEFAULT or ENDTEST."""
    subject = ir.pass_uses(line.read_expression(line["subject"]), ir.CONDITION)
    first_case = list[Op]()
    if line["first"]:
        values = ir.mark_anytime(line.read_expression(line["first"]))
        first_case = ir.pass_uses(values, ir.CONDITION)
    if not line.text.endswith(":"):  # ENDTEST
        kind = "close"
    elif line["first"]:  # CASE
        kind = "branch"
    else:
        kind = "default"
    return [*subject, ir.Flow("if"), *first_case, ir.Flow(kind)]


_END_OF_OPERAND: Final = re.compile(
    r"(?:(?<=[\0\w\"]) |(?<=[)\]}\"]) ?)(?<!\bAND )(?<!\bOR )(?<!\bXOR )(?<!\bNOT )(?<!\bDIV )(?<!\bMOD )"
    r"(?!(?:AND|OR|XOR|NOT|DIV|MOD)\b)(?=[^\W\d])"
)
"""Place between an operand and a word that is no operator: there, the condition of a compact IF ends."""


def _translate_compact_if(line: Line) -> list[Op]:
    """Translate an IF without THEN, such as `IF flag MoveL p1,v100,fine,tool1`.

    Source: ABB's manual, *Compact IF*: the statement behind the condition is the branch.

    Raises:
        Misread: there is no condition, or no statement behind the condition.
    """
    begin, _ = line.span("rest")
    end = _END_OF_OPERAND.search(line.text, begin)
    # An IF within an IF is not read, because such statements would nest without end.
    if end is None or line.text.startswith("IF", end.end()):
        raise Misread(UNKNOWN_STATEMENT)
    condition = line.read_expression(line.text[begin : end.start()])
    branch = Line(line.language, line.text[end.end() :], line.ordinals_in(end.end(), len(line.text)))
    return [
        *ir.pass_uses(condition, ir.CONDITION),
        ir.Flow("if"),
        *line.language.apply_rules(branch),
        ir.Flow("close"),
    ]


def _translate_instruction(line: Line) -> list[Op]:
    """Translate an instruction of the controller, or the call of a routine."""
    name = line["name"]
    found = _read_arguments(line)
    names = _find_names(found)
    if _CHANGES_ARGUMENTS.fullmatch(name):
        return [*found, ir.MakeUnknown(names, f"{name} changes the value while the program runs", _REMEDY)]
    if name == "SINGAREA" and "WRIST" in line["arguments"]:
        note = "SingArea \\Wrist: near singularities the tool turns away from its stated orientation"
        return [*found, ir.Note(note)]
    if re.fullmatch(_HARMLESS, name):
        uses = ir.pass_uses(found, ir.CONDITION) if name == "WAITUNTIL" else ir.omit_uses(found)
        return [*uses, ir.Call(name, names, harmless=True)]
    if process_move := _PROCESS_MOVE.fullmatch(name):
        letter = process_move["letter"] or process_move["first"] or "L"
        return _translate_process_move(line, letter, found)
    if search := _SEARCH.fullmatch(name):
        index_of_result = 0 if search["smart"] else 1
        return _translate_search(line, found, index_of_result)
    if _FORCE_MOVE.fullmatch(name):
        return _translate_force_move(line, found)
    if lasting := _translate_lasting(name, names):
        return [*found, *lasting]
    # If a routine of the program has the name, the program states what the routine changes. A routine that
    # the program does not define may change its arguments, apart from tool and work object.
    own_routine = ir.Call(name, names, harmless=True)
    other_routine = ir.Call(name, names - _find_frames_of_move(line))
    return [*ir.pass_uses(found, name), own_routine, other_routine]


def _translate_speeds(line: Line) -> list[Op]:
    """Translate VelSet, which sets a percentage of the speeds and the greatest speed of moves behind it."""
    found = _read_arguments(line)
    ops = [*ir.omit_uses(found), ir.Call("VELSET", _find_names(found), harmless=True)]
    spans = list(split_outside_brackets(line.text, line.span("arguments")[0]))
    for index, name in enumerate((_PERCENTAGE, _GREATEST)):
        value: ir.Value = ir.Unknown("VelSet is computed", _REMEDY)
        if index < len(spans):
            start, end = spans[index]
            is_number = line.text[start:end].strip() == "\0"
            if is_number:
                value = Literal(_NUMBERS, line.ordinals_in(start, end))
        ops.append(ir.Assign(name, value))
    return ops


_MOVE_NAME: Final = re.compile(r"(?!.*(?:CAL|MEAS|TCP|TOOL|WOBJ))\w*[LJC](?:START|END)?\d?+")


def _find_frames_of_move(line: Line) -> frozenset[str]:
    """Return tool and work object of an unknown instruction in the form of a move, which only uses them.

    The instruction has the form of a move if its name ends as those of moves do, and its last arguments are
    a speed, a zone and the tool. For any other instruction the set is empty.
    """
    any_option = re.compile(r"\w*")
    try:
        spans, work_object, _ = _split_arguments(line, line.span("arguments")[0], any_option)
    except Misread:  # the work object is computed
        return frozenset()
    arguments = [line.text[begin:end] for begin, end in spans]
    if len(arguments) < 4 or not _MOVE_NAME.fullmatch(line["name"]):
        return frozenset()
    zone, tool = arguments[-2:]
    return frozenset({tool, work_object}) if re.fullmatch(_ZONE, zone) else frozenset()


def _read_arguments(line: Line) -> list[Op]:
    """Translate the arguments of an instruction into uses of names and calls of functions.

    Raises:
        Misread: the arguments are not expressions.
    """
    # Options such as \WObj:=frame become arguments of their own.
    text = re.sub(r"\\(\w+)(:=)?", r",\1,", line["arguments"])
    found = list[Op]()
    for begin, end in split_outside_brackets(text):
        argument = text[begin:end].strip()
        if argument:
            found += line.read_expression(argument)
    return found


def _find_names(found: list[Op]) -> frozenset[str]:
    """Return the names that operations of expressions use, apart from elements of arrays."""
    names = set[str]()
    for op in found:
        if isinstance(op, ir.Use):
            names.update(name for name in op.names if isinstance(name, str))
    return frozenset(names)


def _translate_late_call(line: Line) -> list[Op]:
    """Translate a call of a routine whose name is computed: `%"sub"+name%` or `CallByVar "sub",number`."""
    routine = line["routine"] or f"{line['variable']}+N"  # CallByVar "sub",n calls sub1, sub2 and so on
    name, prefix = _read_routine(routine)
    is_computed = prefix is not None
    found = line.read_expression(routine) if is_computed else []
    found = [*found, *_read_arguments(line)]
    if line["more"]:
        found += line.read_expression(line["more"])
    return [*found, ir.Call(name, _find_names(found), prefix=prefix)]


def _read_routine(text: str) -> tuple[str, str | None]:
    """Return the name of a routine that is called by a text, and with what the name begins if it is computed.

    For `"sub"` the result is `sub` and None; for the computed `"sub"+n` it is the expression and `sub`.
    """
    if re.fullmatch(rf'"{_WORD}"', text):
        return text.strip('"'), None
    beginning = re.match(r'"(\w*)"', text)
    prefix = beginning[1] if beginning else ""
    return text.replace("\0", "n"), prefix


def _translate_process_move(line: Line, letter: str, found: list[Op]) -> list[Op]:
    """Translate a move of a process such as welding, whose last argument is the tool.

    The move is not corrected if it has an option that may move the target, such as the one of tracking.

    Args:
        line: the move.
        letter: kind of the motion: L, J or C.
        found: operations of the arguments.
    """
    name = line["name"]
    remedy = "write the move as MoveL, MoveJ or MoveC"
    try:
        spans, work_object, _ = _split_arguments(line, line.span("arguments")[0], _PROCESS_OPTIONS)
    except Misread as fault:
        return _leave_instruction(line, found, f"{name}: {fault.reason}", remedy)
    arguments = [line.text[begin:end] for begin, end in spans]
    count = 2 if letter == "C" else 1  # count of the targets
    targets = _read_targets(line, spans[:count])
    # Behind the targets come at least speed, data of the process or zone, and the tool.
    is_complete = len(arguments) >= count + 3 and re.fullmatch(_WORD, arguments[-1]) is not None
    if not is_complete or len(targets) < count:
        reason = f"{name}: target or tool is not given by numbers"
        return _leave_instruction(line, found, reason, remedy)
    uses = [op for argument in arguments[count:] for op in line.read_expression(argument)]
    if ir.calls_routine(found):
        return ir.make_uncorrected_move(found, f"{name}: an argument of the move is computed", remedy)
    base = _multiply_frames(work_object, "WOBJDATA")
    tool = _multiply_frames(arguments[-1], "TOOLDATA")
    # With the option \On, the move approaches the begin of the process at its own speed.
    is_approach = re.search(r"\\ON\b", line["arguments"]) is not None
    has_process_speed = _HAS_PROCESS_SPEED.fullmatch(name) and not is_approach
    feed = None if has_process_speed else _read_feed(line, *spans[count])
    move = ir.Move(_MOTIONS[letter], targets, (base,) * count, (tool,) * count, feed=feed)
    return [*uses, move]


def _read_targets(line: Line, spans: list[tuple[int, int]]) -> tuple[Literal | ir.Name, ...]:
    """Return the targets in the text at these spans, names or numbers; other forms are left out."""
    targets: list[Literal | ir.Name] = []
    for begin, end in spans:
        argument = line.text[begin:end]
        is_name = re.fullmatch(_WORD, argument) is not None
        target = argument if is_name else _read_target(line, begin, end)
        if target is not None:
            targets.append(target)
    return tuple(targets)


def _translate_search(line: Line, found: list[Op], index: int) -> list[Op]:
    """Translate a search, which moves until a signal comes and writes the place to one of its arguments.

    Args:
        line: the instruction.
        found: operations of its arguments.
        index: index of the argument that gets the place, counted without options.
    """
    reason, remedy = f"{line['name']} moves until a signal comes", "omit the statement"
    arguments = [part for part in line["arguments"].split(",") if not part.lstrip().startswith("\\")]
    result = re.match(_WORD, arguments[index].strip()) if index < len(arguments) else None
    changed_names = frozenset({result[0]}) if result else _find_names(found)
    return [ir.MakeUnknown(changed_names, reason, remedy), *_leave_instruction(line, found, reason, remedy)]


def _translate_force_move(line: Line, found: list[Op]) -> list[Op]:
    """Translate a move under force control (FCPress...), which FCPressEnd ends.

    `found` are the operations of its arguments.
    """
    reason, remedy = f"{line['name']} may move targets or frames", "omit the statement"
    ends_control = line["name"] == "FCPRESSEND"
    change = ir.end_lasting("FC") if ends_control else ir.begin_lasting("FC", reason, remedy)
    return [*_leave_instruction(line, found, reason, remedy), change]


def _leave_instruction(line: Line, found: list[Op], reason: str, remedy: str) -> list[Op]:
    """Translate an instruction that moves the robot and is not corrected; its last argument is the tool.

    `found` are the operations of its arguments.
    """
    any_option = re.compile(r"\w*")
    try:
        spans, work_object, uses = _split_arguments(line, line.span("arguments")[0], any_option)
    except Misread:  # the work object is computed
        return ir.make_uncorrected_move(found, reason, remedy)
    arguments = [line.text[begin:end] for begin, end in spans] or [""]
    *others, tool = arguments
    return [*uses, *_leave_move(line, others, tool, work_object, (reason, remedy))]


_OFFSET: Final = re.compile(rf"(?:OFFS|RELTOOL)\(({_WORD}),(.+)\)")


def _leave_move(
    line: Line,
    arguments: list[str],
    tool: str,
    work_object: str,
    words: tuple[str, str],
    motion: Motion = Motion.LINEAR,
) -> list[Op]:
    """Translate a move that is not corrected; `words` are reason and remedy.

    The move ends at the points that its arguments name, or at offsets from them such as `Offs(p1,0,0,50)`:
    corrections of these points shift the move.
    """
    reason, remedy = words
    points = set[str]()
    texts = list[str]()  # expressions of the arguments, apart from the points
    for argument in arguments:
        if offset := _OFFSET.fullmatch(argument):
            point, numbers = offset[1], offset[2]
            points.add(point)
            texts.append(numbers)
        elif re.fullmatch(_WORD, argument):
            points.add(argument)
        else:
            texts.append(argument)
    uses = list[Op]()
    for text in (*texts, tool):
        if text and text not in points:
            uses += line.read_expression(text)
    if not re.fullmatch(_WORD, tool):
        return ir.make_uncorrected_move([*uses, ir.Use(frozenset(points))], reason, remedy, motion)
    base_frame, tool_frame = _multiply_frames(work_object, "WOBJDATA"), _multiply_frames(tool, "TOOLDATA")
    move = ir.Move(motion, (), (base_frame,), (tool_frame,), reason=reason, remedy=remedy)
    return [*uses, move._replace(offset_from=tuple(sorted(points)))]


def _translate_lasting(name: str, names: frozenset[str]) -> list[Op]:
    """Translate an instruction that begins or ends something that lasts, such as force control or an offset.

    `names` are the names in its arguments. The list is empty for any other instruction.
    """
    remedy = "omit the statement"
    if name in _END_OF_LASTING:
        return [ir.end_lasting(_END_OF_LASTING[name])]
    may_move = f"{name} may move targets or frames"
    if _WRITES_DATA.fullmatch(name):
        return [
            ir.MakeUnknown(names, may_move, remedy),
            ir.MakeUnknown(frozenset({ir.MODE}), may_move, remedy),
        ]
    if control := _LASTING.fullmatch(name):
        return [ir.begin_lasting(control[1], may_move, remedy)]
    shift = _SHIFT.match(name)
    if shift is None:
        return []
    moves = f"{name} moves targets or frames"
    if shift[0] == "WAITWOBJ":  # a conveyor moves this work object, and no other one
        return [ir.MakeUnknown(names, moves, remedy, anytime=True)]
    return [ir.begin_lasting(shift[0], moves, remedy)]


def _read_target(line: Line, start: int, end: int) -> Literal | None:
    """Return the robtarget or jointtarget between two indices of the text; None if neither is there.

    The numbers of a robtarget are position (3), quaternion (4), configuration (4) and axes (6); those
    of a jointtarget angles (6) and external axes (6). A variable may hold configuration or external axes.
    """
    ordinals = line.ordinals_in(start, end)
    if robtarget := _LITERALS["ROBTARGET"].fullmatch(line.text, start, end):
        has_configuration = robtarget[1].startswith("[")
        begin_of_axes = 11 if has_configuration else 7
        configuration = tuple(zip(("cf1", "cf4", "cf6", "cfx"), ordinals[7:begin_of_axes], strict=False))
        axes_name = robtarget["axes"] or ""
        return Literal(POSE, ordinals[:7], ordinals[begin_of_axes:], configuration, axes_name=axes_name)
    if jointtarget := _LITERALS["JOINTTARGET"].fullmatch(line.text, start, end):
        return Literal(JOINTS, ordinals[:6], ordinals[6:], axes_name=jointtarget["axes"] or "")
    return None


def _assign_data(line: Line, name: str, start: int, end: int, *kinds: str) -> list[ir.Assign]:
    """Translate the assignment of numbers between two indices of the text to data of one of these kinds.

    `kinds` are types of RAPID, such as ROBTARGET and TOOLDATA. A target and a tool give one assignment; a
    work object gives two, one for each of its frames. The list is empty if the text is not data in numbers.
    """
    ordinals = line.ordinals_in(start, end)
    target = _read_target(line, start, end)
    # A variable with external axes may change, or mean another one, before the target is used.
    is_fixed = target is not None and not target.axes_name
    if target is not None and is_fixed and {"ROBTARGET", "JOINTTARGET"} & set(kinds):
        return [ir.Assign(name, target)]
    if "EXTJOINT" in kinds and _LITERALS["EXTJOINT"].fullmatch(line.text, start, end):
        return [ir.Assign(name, Literal(_AXES, ordinals))]
    if "SPEEDDATA" in kinds and _LITERALS["SPEEDDATA"].fullmatch(line.text, start, end):
        return [ir.Assign(name, Literal(_NUMBERS, ordinals[:1]))]
    if "WOBJDATA" in kinds and _LITERALS["WOBJDATA"].fullmatch(line.text, start, end):
        return _assign_frames(name, "WOBJDATA", ordinals)
    tool = _LITERALS["TOOLDATA"].fullmatch(line.text, start, end) if "TOOLDATA" in kinds else None
    if tool and not ir.calls_routine(line.read_expression(tool[1])):  # group 1 is the load of the tool
        return _assign_frames(name, "TOOLDATA", ordinals)
    return []


def _assign_frames(name: str, kind: str, ordinals: tuple[int, ...]) -> list[ir.Assign]:
    """Return the assignments to the frames of a work object or a tool, which have seven numbers each."""
    assignments = list[ir.Assign]()
    for index, frame in enumerate(_FRAMES_OF[kind]):
        pose = ordinals[7 * index : 7 * (index + 1)]
        assignments.append(ir.Assign(name + frame, Literal(POSE, pose)))
    return assignments


def _multiply_frames(name: str, kind: str) -> ir.Product:
    """Return the product of the frames of data `name`; `kind` is WOBJDATA (work object) or TOOLDATA."""
    return ir.Product(tuple(f"{name}{frame}" for frame in _FRAMES_OF[kind]))


def _translate_declaration(line: Line) -> list[Op]:
    """Translate a declaration `CONST robtarget p1:=[...]`: the name gets numbers or an unknown value."""
    name, value, is_array = line["name"], line["value"], bool(line["array"])
    ops: list[Op] = [ir.Local(frozenset({name})), *line.read_expression(line["array"])]
    assignments = []
    if value and not is_array:
        assignments = _assign_data(line, name, *line.span("value"), line["type"])
    if assignments:
        declares = "constant" if line["kind"] == "CONST" else "variable"
        is_private = line["scope"] == "LOCAL"
        return [*ops, *(each._replace(declares=declares, private=is_private) for each in assignments)]
    ops += ir.pass_uses(line.read_expression(value), name)
    kind = "frame" if "DATA" in line["type"] else "target"
    reason = f"{name} is not a fixed {kind} in numbers, or changes while the program runs"
    return [*ops, ir.MakeUnknown(frozenset({name}), reason, _FRAME_REMEDY)]


def _translate_assignment(line: Line) -> list[Op]:
    """Translate an assignment, which gives numbers or an unknown value to a name or to one of its parts."""
    name, part, value = line["name"], line["part"], line["value"]
    is_frame = part in {".UFRAME", ".OFRAME", ".TFRAME"}
    if not part and (assignments := _assign_data(line, name, *line.span("value"), *_LITERALS)):
        return [*assignments]
    if is_frame and re.fullmatch(_POSE_PATTERN, value):
        return [ir.Assign(name + part, Literal(POSE, line.ordinals_in(*line.span("value"))))]
    # The index of an array, `{i,j}`, is an expression as well.
    index = part.replace("{", ",[").replace("}", "]").lstrip(",") if "{" in part else ""
    uses = [*line.read_expression(index), *line.read_expression(value)]
    reason = f"{name} changes while the program runs"
    return [*ir.pass_uses(uses, name), ir.MakeUnknown(frozenset({name}), reason, _FRAME_REMEDY)]


def _translate_move(line: Line) -> list[Op]:
    """Translate a move; it is not corrected without target in numbers or with other options.

    Raises:
        Misread: its arguments are not expressions.
    """
    calls = list[Op]()
    if line["process"] == "SYNC":  # the last argument is the name of a routine that is called at the target
        last_argument = line["arguments"].rsplit(",", 1)[-1].strip()
        name, prefix = _read_routine(last_argument)
        calls.append(ir.Call(name, anytime=True, event="\0target", prefix=prefix))
    try:
        return [*calls, *_translate_plain_move(line)]
    except Misread as fault:
        if not fault.remedy:  # the text is no move at all
            raise
        uncorrected = _leave_instruction(line, _read_arguments(line), fault.reason, fault.remedy)
        return [*calls, *uncorrected]


def _translate_plain_move(line: Line) -> list[Op]:
    r"""Translate a move whose arguments are complete, such as `MoveC p1,p2,v100,z10,tool1\WObj:=wobj1`.

    Raises:
        Misread: arguments are missing, unknown or computed.
    """
    letter = line["letter"] or line["trigger"] or "J"  # MoveAbsJ has no letter of its own
    motion = _MOTIONS[letter]
    count = 2 if letter == "C" else 1  # count of the targets
    # Behind the targets come speed, perhaps a trigger, zone and tool.
    tool_index = count + (3 if line["trigger"] else 2)
    count_after_tool = _ARGUMENTS_AFTER_TOOL.get(line["process"], 0)
    if "\\VALUE:=" in line.text:  # this option takes the place of the second argument
        count_after_tool -= 1
    spans, work_object, found = _split_arguments(line, line.span("arguments")[0])
    arguments = [line.text[begin:end] for begin, end in spans]
    is_complete = len(arguments) == tool_index + 1 + count_after_tool
    if not is_complete or not re.fullmatch(_WORD, arguments[tool_index]):
        reason = "the target is not given by numbers, or the move names no speed, zone and tool"
        remedy = "write speed, zone and tool by their names, and \\WObj:= if there is a work object"
        raise Misread(reason, remedy)
    targets = _read_targets(line, spans[:count])
    tool_name = arguments[tool_index]
    if len(targets) < count:
        words = "the target is not given by numbers", _REMEDY
        return [*found, *_leave_move(line, arguments[:count], tool_name, work_object, words, motion)]
    for argument in arguments[count:]:
        found += line.read_expression(argument)
    if ir.calls_routine(found):
        raise Misread("an argument of the move is computed", "write speed, zone and tool by their names")
    base, tool = _multiply_frames(work_object, "WOBJDATA"), _multiply_frames(tool_name, "TOOLDATA")
    feed = _read_feed(line, *spans[count])
    return [*found, ir.Move(motion, targets, (base,) * count, (tool,) * count, feed=feed)]


def _read_feed(line: Line, start: int, end: int) -> ir.Feed | None:
    """Return the feed of a move; None if it is computed.

    The speed of the move (speeddata) is the text between two indices. VelSet limits the feeds of all moves.
    """
    feed = _read_own_feed(line, start, end)
    if feed is None:
        return None
    return feed._replace(percentage=_PERCENTAGE, greatest=_GREATEST)


def _read_own_feed(line: Line, start: int, end: int) -> ir.Feed | None:
    r"""Return the feed of a move, without what VelSet sets for all moves; None if the feed is computed.

    The speed of the move (speeddata) is the text between two indices: numbers, or a name such as `v100`. The
    option `\V` takes its place, and so does `\T`, the time of the move, which gives no feed.
    """
    option = _OWN_SPEED.search(line.text, line.span("arguments")[0])
    if option is not None:
        is_speed = option["option"] == "V" and option["number"]
        numbers = line.ordinals_in(*option.span("number")) if is_speed else ()
        return ir.Feed(Literal(_NUMBERS, numbers)) if numbers else None
    speed = line.text[start:end]
    if _LITERALS["SPEEDDATA"].fullmatch(speed):
        speed_of_tool = line.ordinals_in(start, end)[:1]
        return ir.Feed(Literal(_NUMBERS, speed_of_tool))
    if not re.fullmatch(_WORD, speed):
        return None
    of_controller = _SPEED.fullmatch(speed)  # v100 is 100 mm/s, unless the program declares the name
    return ir.Feed(ir.Copy(speed), otherwise=float(of_controller[1]) if of_controller else np.nan)


def _split_arguments(
    line: Line, start: int, known_options: re.Pattern[str] = _OPTIONS
) -> tuple[list[tuple[int, int]], str, list[Op]]:
    r"""Split the arguments of a move such as `p1,v100\T:=3,z10,tool1\WObj:=wobj1`.

    Args:
        line: the move.
        start: index of its first argument.
        known_options: pattern of the names of options that do not move the target.

    Returns:
        First and last + 1 character of each argument; name of the work object; operations of the options.

    Raises:
        Misread: an option may move the target, or the work object is computed.
    """
    text, work_object = line.text, "WOBJ0"
    spans, found = list[tuple[int, int]](), list[Op]()
    for number, (first, last) in enumerate(split_outside_brackets(text, start)):
        (begin, end), *options = split_outside_brackets(text[:last], first, "\\")
        is_blank = not text[begin:end].strip()
        # A part that has only options is not an argument; nor is an empty text before the first comma.
        is_no_argument = is_blank and (number == 0 or bool(options))
        if not is_no_argument:
            begin += text[begin : begin + 1] == " "
            spans.append((begin, end))
        for option_begin, option_end in options:
            name, _, value = text[option_begin:option_end].partition(":=")
            if not known_options.fullmatch(name):
                reason = f"the argument \\{name} moves the target, or is not known"
                raise Misread(reason, "omit the statement")
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
    modules = [module for index, source in enumerate(sources) for module in _split_modules(index, source)]
    for module, renamed in zip(modules, _rename_local_names(modules), strict=True):
        translate = partial(_translate_renamed, renamed=renamed) if renamed else None
        statements.add_statements(module.source, module.starts, module.ends, translate=translate)
    routines = [routine for module in modules for routine in re.findall(_ROUTINE, module.text)]
    ambiguous = [routine for routine in routines if _PROCESS_MOVE.fullmatch(routine)]
    if ambiguous:
        name = min(ambiguous)
        reason = f"the program has its own routine {name}, but a move of a process has the same name"
        statements.forget_anytime(frozenset({ir.MODE}), reason, "give the routine another name")


class _Module(NamedTuple):
    """A module of a file: its text in capitals, and its statements."""

    source: int  # index of the file
    text: str
    starts: IndexArray  # (n,) first character of each statement in the file
    ends: IndexArray  # (n,) last character + 1 of each statement


def _split_modules(index: int, source: Source) -> Iterator[_Module]:
    """Yield the modules of a file, which has the given index among the files."""
    starts, ends, heads = _find_statements(source.text)
    # Text before the second head belongs to the first module.
    for begin, end in pairwise((0, *heads[1:], len(source.text))):
        first, last = np.searchsorted(starts, (begin, end)).tolist()
        yield _Module(index, capitalise(source.text[begin:end]), starts[first:last], ends[first:last])


def _rename_local_names(modules: list[_Module]) -> list[dict[str, str]]:
    """Return for each module new names of those that mean something else elsewhere.

    A name that is LOCAL in one module means something else in the others. The first module keeps its names,
    so that messages have them.
    """
    if len(modules) < 2:
        return [{} for _ in modules]
    local = [set(re.findall(_LOCAL, _TEXT_OR_COMMENT.sub(" ", module.text))) for module in modules]
    words = [set(re.findall(_WORD, module.text)) for module in modules]
    modules_with = Counter(word for words_of_module in words for word in words_of_module)
    renamed: list[dict[str, str]] = [{}]
    for k in range(1, len(modules)):
        new_names = {name: f"{name}{IN_MODULE}0" for name in local[0] & words[k]}
        for name in local[k]:
            is_elsewhere = modules_with[name] > 1
            if is_elsewhere:
                new_names[name] = f"{name}{IN_MODULE}{k}"
        renamed.append(new_names)
    return renamed


_ROUTINE: Final = rf"\bPROC\s++({_WORD})"
_LOCAL: Final = rf"\bLOCAL\s++(?:PROC|TRAP|(?:FUNC|CONST|PERS|VAR)\s++\w++)\s++({_WORD})"
_TEXT_OR_COMMENT: Final = re.compile(r'"[^"\r\n]*+"|![^\r\n]*+')
_TEXT_OR_NAME: Final = re.compile(rf'"({_WORD})"|"[^"\r\n]*+"|(?<![\w.\\])({_WORD})')


def _translate_renamed(masked: str, renamed: dict[str, str]) -> list[tuple[int, Op]]:
    """Translate a statement after names got new names that are unique among the modules.

    Routines that are called by texts, such as `%"sub"%`, are renamed, too. `masked` is the statement with NUL
    in place of each number. Each operation is given with its number of lines below the first line.
    """

    def rename(match: re.Match[str]) -> str:
        name = match[1] or match[2]  # name in quotations, or name
        if not name:  # another text
            return match[0]
        return match[0].replace(name, renamed.get(capitalise(name), name))

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
