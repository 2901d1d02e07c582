"""Programs of ABB (RAPID, .mod and .sys), translated."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from functools import partial
from itertools import islice, pairwise, zip_longest
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
_LASTING: Final = re.compile(r"(?P<kind>FC|EGM)\w+")
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
    "ROBTARGET": re.compile(rf"\[{_N3},{_N4},(?P<configuration>{_N4}|{_WORD}),(?:{_N6}|(?P<axes>{_WORD}))\]"),
    "JOINTTARGET": re.compile(rf"\[{_N6},(?:{_N6}|(?P<axes>{_WORD}))\]"),
    "EXTJOINT": re.compile(_N6),
    "WOBJDATA": re.compile(rf'\[FALSE,TRUE,"[^"]*",{_POSE_PATTERN},{_POSE_PATTERN}\]'),
    "TOOLDATA": re.compile(rf"\[TRUE,{_POSE_PATTERN},(?P<load>.*)\]"),
    "SPEEDDATA": re.compile(_N4),
}
_NUMBERS_OF_POSE: Final = 7
"""Three of the position and four of the quaternion."""
_NUMBERS_OF_JOINTS: Final = 6
_CONFIGURATION: Final = ("cf1", "cf4", "cf6", "cfx")
"""Names of the numbers that state the arm's configuration."""
_NUMBERS: Final = Notation(Orientation.NONE)  # of a speed, whose first number is that of the tool's centre
_SPEED: Final = re.compile(r"V(?P<speed>\d{1,5})")
"""Name of the controller's data of a speed [mm/s]."""
_PERCENTAGE: Final = f"{ir.FEED} percentage"
_GREATEST: Final = f"{ir.FEED} greatest"
"""Names of what VelSet sets for all moves: a percentage of the speed, and the greatest speed [mm/s]."""
_OWN_SPEED: Final = re.compile(r"\\(?P<option>[VT]):=(?P<number>\0(?=[,\\]))?")
"""Speed or time of a move in place of its data of a speed."""
_FRAMES_OF: Final = {"WOBJDATA": (".UFRAME", ".OFRAME"), "TOOLDATA": (".TFRAME",)}
"""Frames of work objects and tools; the second frame of a work object is given in the first."""


def _translate_routine(line: Line) -> list[Op]:
    r"""Translate the first line of a routine, such as `PROC weld(robtarget p1,\num n)`.

    It begins the routine, and declares its parameters p1 and n, whose values are unknown. The groups of the
    line are `name` and `parameters`.
    """
    # A parameter ends before a comma, the sign `|`, the brackets of an array, or the end.
    parameters = re.findall(rf"({_WORD})(?=,|\||$|\{{)", line["parameters"])
    return ir.begin_routine(line["name"], parameters, _REMEDY)


def _translate_test(line: Line) -> list[Op]:
    """Translate TEST, the switch statement of RAPID, up to its first branch.

    The groups of the line are `subject` and `first`, the values of the first CASE. There are three forms:

    * `TEST n CASE 1,m:` begins the first branch; m may be computed more than once, as in a loop;
    * `TEST n DEFAULT:` begins the only branch;
    * `TEST n ENDTEST` has no branch, and ends here.
    """
    ops = [*ir.pass_uses(line.read_expression(line["subject"]), ir.CONDITION), ir.Flow("if")]
    has_branch = line.text.endswith(":")
    if not has_branch:
        return [*ops, ir.Flow("close")]
    is_default = not line["first"]
    if is_default:
        return [*ops, ir.Flow("default")]
    values_of_case = ir.mark_anytime(line.read_expression(line["first"]))
    return [*ops, *ir.pass_uses(values_of_case, ir.CONDITION), ir.Flow("branch")]


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
    rest = line.part("rest")
    gap = _END_OF_OPERAND.search(rest.text)  # between the condition and the statement
    # An IF within an IF is not read, because such statements would nest without end.
    if gap is None or rest.text.startswith("IF", gap.end()):
        raise Misread(UNKNOWN_STATEMENT)
    condition = rest.cut(0, gap.start()).read_expression()
    statement = rest.cut(gap.end())
    branch = ir.make_skippable(line.language.apply_rules(statement))
    return [*ir.pass_uses(condition, ir.CONDITION), *branch]


def _translate_instruction(line: Line) -> list[Op]:
    r"""Translate an instruction that is no plain move, such as `Reset do1;`, `ArcL p1,...;` or `grip 5;`.

    It is one of the controller, or the call of a routine. The groups of the line are its `name` and its
    `arguments`. Before its own operations come the uses of the names in its arguments.
    """
    name, uses = line["name"], _read_arguments(line)
    names = _find_names(uses)
    if _CHANGES_ARGUMENTS.fullmatch(name):  # Incr n
        return [*uses, ir.MakeUnknown(names, f"{name} changes the value while the program runs", _REMEDY)]
    if re.fullmatch(_HARMLESS, name):  # WaitTime 2
        return _translate_harmless_instruction(line, uses)
    if moves := _translate_special_move(line, uses):  # ArcL p1,v100,...
        return moves
    if lasting := _translate_lasting(name, names):  # PDispOn p1,tool1
        return [*uses, *lasting]
    return [*ir.pass_uses(uses, name), *_call_routine(line, name, names)]


def _translate_harmless_instruction(line: Line, uses: list[Op]) -> list[Op]:
    r"""Translate an instruction that changes neither target, frame nor variable, such as `WaitTime 2;`.

    * `SingArea \Wrist;` gives a remark, because the tool may turn;
    * `WaitUntil n>2;` uses n for a condition, because n decides how the program goes on;
    * `TPWrite text1;` does not use text1 in a way that matters, because it is shown only.

    A routine of the program with the same name, such as `PROC WaitTime`, takes the place of the instruction.

    Args:
        line: the instruction, with the groups `name` and `arguments`.
        uses: uses of names in its arguments.
    """
    name = line["name"]
    if name == "SINGAREA" and "WRIST" in line["arguments"]:
        note = "SingArea \\Wrist: near singularities the tool turns away from its stated orientation"
        return [*uses, ir.Note(note)]
    own_routine = ir.call_if_defined(name, _find_names(uses))
    if name == "WAITUNTIL":
        return [*ir.pass_uses(uses, ir.CONDITION), own_routine]
    return [*ir.omit_uses(uses), own_routine]


def _translate_special_move(line: Line, uses: list[Op]) -> list[Op]:
    """Translate a move of a process, a search or a move under force control; empty for anything else.

    Examples are `ArcL p1,v100,...`, `SearchL di1,p1,...` and `FCPressL p1,...`. `uses` are the uses of names
    in the arguments.
    """
    name = line["name"]
    if process_move := _PROCESS_MOVE.fullmatch(name):
        letter = process_move["letter"] or process_move["first"] or "L"  # of a line, joints or an arc
        return _translate_process_move(line, letter, uses)
    if search := _SEARCH.fullmatch(name):
        index_of_result = 0 if search["smart"] else 1  # searches of SmarTac write their first argument
        return _translate_search(line, uses, index_of_result)
    if _FORCE_MOVE.fullmatch(name):
        return _translate_force_move(line, uses)
    return []


def _call_routine(line: Line, name: str, arguments: frozenset[str]) -> list[Op]:
    """Translate the call of a routine, such as `grip 5,p1;`, with the names in its arguments.

    There are two calls, because only the whole program shows which one is meant. The first call counts if the
    program has a routine of this name. The second counts if it has none: the unknown routine may then change
    its arguments, apart from the tool and the work object of a move. If it gets the target of a move in
    numbers, as in `MovveL [[600,0,500],...],v100,z10,tool1;`, it may be a misspelled move: no target behind
    it is certain.
    """
    frames = _find_frames_of_move(line)
    has_target_in_numbers = line["arguments"].lstrip().startswith("[[")
    own_routine = ir.call_if_defined(name, arguments)
    other_routine = ir.Call(name, arguments - frames, may_last=bool(frames) and has_target_in_numbers)
    return [own_routine, other_routine]


def _translate_speeds(line: Line) -> list[Op]:
    """Translate `VelSet 50,800;`: moves behind it have 50 % of their speeds, and at most 800 mm/s.

    Each of the two numbers is assigned to a name of its own, from which moves compute their feed. Instead of
    a number that is computed or missing, the name gets an unknown value.
    """
    uses = _read_arguments(line)
    ops = [*ir.omit_uses(uses), ir.call_if_defined("VELSET", _find_names(uses))]
    stated_values = line.part("arguments").split()[:2]
    for name, stated_value in zip_longest((_PERCENTAGE, _GREATEST), stated_values):
        value: ir.Value = ir.Unknown("VelSet is computed", _REMEDY)
        if stated_value is not None and stated_value.is_number:
            value = Literal(_NUMBERS, stated_value.ordinals)
        ops.append(ir.Assign(name, value))
    return ops


_ANY_OPTION: Final = re.compile(r"\w*")
_MOVE_NAME: Final = re.compile(r"(?!.*(?:CAL|MEAS|TCP|TOOL|WOBJ))\w*[LJC](?:START|END)?\d?+")


def _find_frames_of_move(line: Line) -> frozenset[str]:
    r"""Return tool and work object of an unknown instruction in the form of a move, which only uses them.

    `MyMoveL p1,v100,z10,tool1\WObj:=wobj1;` has the form of a move: its name ends as those of moves do, and
    its last arguments are a speed, a zone and the tool. For any other instruction, and if the work object is
    computed, the set is empty.
    """
    try:
        arguments = _split_arguments(line, _ANY_OPTION)
    except Misread:  # the work object is computed
        return frozenset()
    has_name_of_move = _MOVE_NAME.fullmatch(line["name"]) is not None
    if len(arguments.values) < 4 or not has_name_of_move:
        return frozenset()
    zone, tool = arguments.values[-2:]
    is_zone = re.fullmatch(_ZONE, zone.text) is not None
    return frozenset({tool.text, arguments.work_object}) if is_zone else frozenset()


def _read_arguments(line: Line) -> list[Op]:
    """Translate the arguments of an instruction into uses of names and calls of functions.

    Raises:
        Misread: the arguments are not expressions.
    """
    # Options such as \WObj:=frame become arguments of their own.
    arguments_and_options = re.sub(r"\\(\w+)(:=)?", r",\1,", line["arguments"])
    ops = list[Op]()
    for begin, end in split_outside_brackets(arguments_and_options):
        argument = arguments_and_options[begin:end].strip()
        if argument:
            ops += line.read_expression(argument)
    return ops


def _find_names(ops: list[Op]) -> frozenset[str]:
    """Return the names that operations of expressions use, apart from elements of arrays."""
    names = set[str]()
    for op in ops:
        if isinstance(op, ir.Use):
            names.update(name for name in op.names if isinstance(name, str))
    return frozenset(names)


class _RoutineName(NamedTuple):
    """Name of a routine that a text states, as in `%"sub"%` or `CallByVar "sub",n`."""

    name: str  # the name, or the expression that computes it
    prefix: str | None  # with what a computed name begins; None if the text is the whole name


def _translate_late_call(line: Line) -> list[Op]:
    """Translate a call of a routine whose name is a text, or is computed while the program runs.

    * `%"sub"%` calls the routine sub;
    * `%"sub"+name% p1` computes the name: any routine whose name begins with `sub` may be meant;
    * `CallByVar "sub",number` calls sub1, sub2 and so on: as if the name were computed as `"sub"+N`.

    The groups of the line are `routine`, between the signs %, and the `arguments` behind them, here p1; or
    else `variable`, here "sub", and `more`, here number.
    """
    text_of_name = line["routine"] or f"{line['variable']}+N"
    routine = _read_routine_name(text_of_name)
    ops = list[Op]()
    is_computed = routine.prefix is not None
    if is_computed:
        ops += line.read_expression(text_of_name)
    ops += _read_arguments(line)
    if line["more"]:
        ops += line.read_expression(line["more"])
    return [*ops, ir.Call(routine.name, _find_names(ops), prefix=routine.prefix)]


def _read_routine_name(text: str) -> _RoutineName:
    """Read the name of a routine from a text.

    * `"sub"` is the name sub, which is certain;
    * `"sub"+n` is a name that begins with `sub`;
    * `name+"1"` may be any name, because all begin with the empty prefix.
    """
    is_whole_name = re.fullmatch(rf'"{_WORD}"', text) is not None
    if is_whole_name:
        return _RoutineName(text.strip('"'), None)
    beginning = re.match(r'"(?P<letters>\w*)"', text)
    prefix = beginning["letters"] if beginning else ""
    return _RoutineName(text.replace(ir.A_NUMBER, "n"), prefix)


class _Obstacle(NamedTuple):
    """Reason why a move is not corrected, and what the user can do."""

    reason: str
    remedy: str


class _PartsOfMove(NamedTuple):
    r"""Parts of a move such as `MoveL p1,v100,z10,tool1\WObj:=wobj1`."""

    letter: str  # kind of the motion: L (line), J (joints) or C (arc)
    points: list[Line]  # arguments with the targets, here p1
    others: list[Line]  # arguments behind them, here v100, z10 and tool1
    tool: Line  # the one of them that is the tool
    work_object: str  # name of the work object
    uses: list[Op]  # uses of names in the values of options

    @property
    def speed(self) -> Line:
        """Argument with the speed, which is the first one behind the targets."""
        return self.others[0]

    @property
    def base_frame(self) -> ir.Product:
        """Base of all targets: the product of the frames of the work object."""
        return _multiply_frames(self.work_object, "WOBJDATA")

    @property
    def tool_frame(self) -> ir.Product:
        """Frame of the tool in the flange."""
        return _multiply_frames(self.tool.text, "TOOLDATA")


def _translate_process_move(line: Line, letter: str, uses: list[Op]) -> list[Op]:
    r"""Translate a move of a process, such as `ArcL p1,v100,seam1,weld1,z10,tool1\WObj:=wobj1;`.

    The move is not corrected if an option, such as the one of tracking, may move the target; or if target,
    tool or another argument is computed.

    Args:
        line: the move.
        letter: kind of the motion: L (line), J (joints) or C (arc).
        uses: uses of names in its arguments.
    """
    name, remedy = line["name"], "write the move as MoveL, MoveJ or MoveC"
    try:
        parts = _split_process_move(line, letter)
    except Misread as fault:
        obstacle = _Obstacle(f"{name}: {fault.reason}", remedy)
        return _translate_uncorrected_instruction(line, uses, obstacle)
    uses_behind_targets = _read_expressions(parts.others)
    if ir.calls_routine(uses):
        return ir.make_uncorrected_move(uses, f"{name}: an argument of the move is computed", remedy)
    feed = _read_feed_of_process(line, parts.speed)
    return [*uses_behind_targets, _make_move(parts, feed)]


def _split_process_move(line: Line, letter: str) -> _PartsOfMove:
    """Split a move of a process into its parts; the letter L, J or C is the kind of its motion.

    Raises:
        Misread: an option may move the target, or target, tool or work object is computed.
    """
    arguments = _split_arguments(line, _PROCESS_OPTIONS)
    count = _count_targets(letter)
    points, others = arguments.values[:count], arguments.values[count:]
    has_targets = len(_read_targets(points)) == count
    # Behind the targets come at least speed, data of the process or zone, and the tool.
    is_complete = has_targets and len(others) >= 3
    if not (is_complete and re.fullmatch(_WORD, others[-1].text)):
        raise Misread("target or tool is not given by numbers")
    return _PartsOfMove(letter, points, others, others[-1], arguments.work_object, arguments.uses)


def _count_targets(letter: str) -> int:
    """Return the count of the targets of a motion: two of an arc (C), one of a line (L) or joints (J)."""
    return 2 if letter == "C" else 1


def _read_feed_of_process(line: Line, speed: Line) -> ir.Feed | None:
    r"""Return the feed of a move of a process; None if data of the process state the speed.

    A weld has the speed of its welddata. Only with the option `\On` the move approaches the begin of the weld
    at the speed that is its argument.
    """
    is_approach = re.search(r"\\ON\b", line["arguments"]) is not None
    has_process_speed = _HAS_PROCESS_SPEED.fullmatch(line["name"]) is not None and not is_approach
    return None if has_process_speed else _read_feed(line, speed)


def _read_expressions(arguments: list[Line]) -> list[Op]:
    """Return the uses of names, and the calls of functions, in some arguments."""
    ops = list[Op]()
    for argument in arguments:
        ops += argument.read_expression()
    return ops


def _make_move(parts: _PartsOfMove, feed: ir.Feed | None) -> ir.Move:
    """Return a move to its targets, which all have the same work object and the same tool."""
    targets = _read_targets(parts.points)
    bases, tools = (parts.base_frame,) * len(targets), (parts.tool_frame,) * len(targets)
    return ir.Move(_MOTIONS[parts.letter], targets, bases, tools, feed=feed)


def _read_targets(arguments: list[Line]) -> tuple[Literal | ir.Name, ...]:
    """Return the targets that arguments state by names or in numbers; other arguments are left out."""
    targets: list[Literal | ir.Name] = []
    for argument in arguments:
        is_name = re.fullmatch(_WORD, argument.text) is not None
        target = argument.text if is_name else _read_target(argument)
        if target is not None:
            targets.append(target)
    return tuple(targets)


def _translate_search(line: Line, uses: list[Op], index_of_result: int) -> list[Op]:
    """Translate a search, which moves until a signal comes and writes the place to one of its arguments.

    `SearchL di1,p1,p2,v100,tool1;` moves towards p2, and writes to p1 where the signal di1 comes. So p1 is
    unknown behind it, and the move is not corrected. If the argument is no name, all names may be written.

    Args:
        line: the instruction.
        uses: uses of names in its arguments.
        index_of_result: index of the argument that gets the place, here 1, counted without options.
    """
    obstacle = _Obstacle(f"{line['name']} moves until a signal comes", "omit the statement")
    result = _find_result_of_search(line, index_of_result)
    changed_names = result or _find_names(uses)
    change = ir.MakeUnknown(changed_names, obstacle.reason, obstacle.remedy)
    return [change, *_translate_uncorrected_instruction(line, uses, obstacle)]


def _find_result_of_search(line: Line, index: int) -> frozenset[str]:
    r"""Return the name that a search writes: p1 of `SearchL \Stop,di1,p1,p2,v100,tool1;` for the index 1.

    Options such as `\Stop` do not count. The set is empty if there is no such argument, or it is no name.
    """
    parts = line["arguments"].split(",")
    arguments = [part.strip() for part in parts if not part.lstrip().startswith("\\")]
    if index >= len(arguments):
        return frozenset()
    name = re.match(_WORD, arguments[index])
    return frozenset({name[0]}) if name else frozenset()


def _translate_force_move(line: Line, uses: list[Op]) -> list[Op]:
    """Translate a move under force control (FCPress...), which FCPressEnd ends.

    `uses` are the uses of names in its arguments.
    """
    obstacle = _Obstacle(f"{line['name']} may move targets or frames", "omit the statement")
    move = _translate_uncorrected_instruction(line, uses, obstacle)
    if line["name"] == "FCPRESSEND":
        return [*move, ir.end_lasting("FC")]
    return [*move, ir.begin_lasting("FC", obstacle.reason, obstacle.remedy)]


def _translate_uncorrected_instruction(line: Line, uses: list[Op], obstacle: _Obstacle) -> list[Op]:
    r"""Translate an instruction such as `SearchL di1,p1,p2,v100,tool1\WObj:=wobj1;` that is not corrected.

    The instruction moves the robot to points that its arguments name: the correction of such a point shifts
    the move. If its work object is computed, all that is known of the move is what its arguments use.

    Args:
        line: the instruction; its last argument is the tool.
        uses: uses of all names in its arguments.
        obstacle: why the instruction is not corrected.
    """
    try:
        arguments = _split_arguments(line, _ANY_OPTION)
    except Misread:  # the work object is computed
        return ir.make_uncorrected_move(uses, obstacle.reason, obstacle.remedy)
    no_argument = line.cut(0, 0)
    *points_and_data, tool = arguments.values or [no_argument]
    parts = _PartsOfMove("L", points_and_data, [], tool, arguments.work_object, arguments.uses)
    return _translate_uncorrected_move(parts, obstacle)


_OFFSET: Final = re.compile(rf"(?:OFFS|RELTOOL)\((?P<point>{_WORD}),(?P<numbers>.+)\)")


def _translate_uncorrected_move(parts: _PartsOfMove, obstacle: _Obstacle) -> list[Op]:
    """Translate a move that is not corrected, such as `MoveL Offs(p1,0,0,50),v100,z10,tool1`.

    It ends at points that its arguments name, or at offsets from them, here from p1. Corrections of these
    points shift the move. If the tool is computed, the frames of the move are not known: then p1 counts as
    used, so that it is not corrected at all.
    """
    points, expressions = _split_points(parts.points)
    uses = [*parts.uses]
    for text in (*expressions, parts.tool.text):
        if text and text not in points:
            uses += parts.tool.read_expression(text)
    is_tool_a_name = re.fullmatch(_WORD, parts.tool.text) is not None
    if is_tool_a_name:
        return [*uses, _make_move_near_points(parts, points, obstacle)]
    motion = _MOTIONS[parts.letter]
    return ir.make_uncorrected_move([*uses, ir.Use(points)], obstacle.reason, obstacle.remedy, motion)


def _make_move_near_points(parts: _PartsOfMove, points: frozenset[str], obstacle: _Obstacle) -> ir.Move:
    """Return a move that is not corrected, and that corrections of some points, such as p1, shift."""
    return ir.Move(
        _MOTIONS[parts.letter],
        targets=(),
        bases=(parts.base_frame,),
        tools=(parts.tool_frame,),
        reason=obstacle.reason,
        remedy=obstacle.remedy,
        offset_from=tuple(sorted(points)),
    )


class _Points(NamedTuple):
    """Points and expressions that the arguments of a move state."""

    names: frozenset[str]  # points such as p1, also those in `Offs(p1,0,0,50)`
    expressions: list[str]  # texts of all else, such as the `0,0,50`


def _split_points(arguments: list[Line]) -> _Points:
    """Split the arguments of a move into points and expressions: p1 and `0,0,50` of `Offs(p1,0,0,50)`."""
    points, expressions = set[str](), list[str]()
    for argument in arguments:
        if offset := _OFFSET.fullmatch(argument.text):
            points.add(offset["point"])
            expressions.append(offset["numbers"])
        elif re.fullmatch(_WORD, argument.text):
            points.add(argument.text)
        else:
            expressions.append(argument.text)
    return _Points(frozenset(points), expressions)


def _translate_lasting(name: str, names: frozenset[str]) -> list[Op]:
    """Translate an instruction behind which the controller moves targets until another one ends this.

    `PDispOn p1,tool1;` shifts all targets until `PDispOff;`. Force control, guidance from outside (EGM) and
    moving work objects act in the same way. Behind them no target is certain.

    Args:
        name: name of the instruction, in capitals.
        names: names in its arguments.

    Returns:
        Operations of the instruction; empty if it does nothing of this kind.
    """
    may_move, remedy = f"{name} may move targets or frames", "omit the statement"
    if name in _END_OF_LASTING:  # PDispOff
        return [ir.end_lasting(_END_OF_LASTING[name])]
    if _WRITES_DATA.fullmatch(name):  # SetDataVal "p1",value: it may write any variable
        return [ir.MakeUnknown(names, may_move, remedy), ir.make_targets_uncertain(may_move, remedy)]
    if control := _LASTING.fullmatch(name):  # FCAct
        return [ir.begin_lasting(control["kind"], may_move, remedy)]
    if shift := _SHIFT.match(name):  # PDispOn; the match is the kind of the shift, PDISP
        return [_begin_shift(shift[0], names, f"{name} moves targets or frames", remedy)]
    return []


def _begin_shift(kind: str, names: frozenset[str], reason: str, remedy: str) -> Op:
    """Return the operation of an instruction that shifts targets, such as `PDispOn p1,tool1;`.

    `PDispOn` shifts all targets, until `PDispOff;` ends it. `WaitWObj wobj1;` waits for a part on a conveyor,
    which moves wobj1 from then on: only its frames are unknown, at any time.

    Args:
        kind: kind of the shift: PDISP, or WAITWOBJ for a conveyor.
        names: names in the arguments.
        reason: why moves behind the instruction are not corrected.
        remedy: what the user can do.
    """
    if kind == "WAITWOBJ":
        return ir.MakeUnknown(names, reason, remedy, anytime=True)
    return ir.begin_lasting(kind, reason, remedy)


def _read_target(part: Line) -> Literal | None:
    """Return the target that a text states in numbers, as indices of these numbers; None for another text.

    A robtarget `[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[eax_a,...]]` has a pose, the configuration of the
    arm and external axes; a jointtarget `[[j1,...,j6],[eax_a,...]]` has joint angles and external axes.
    """
    if robtarget := _LITERALS["ROBTARGET"].fullmatch(part.text):
        return _read_robtarget(part, robtarget["configuration"], robtarget["axes"] or "")
    if jointtarget := _LITERALS["JOINTTARGET"].fullmatch(part.text):
        numbers = iter(part.ordinals)
        angles = tuple(islice(numbers, _NUMBERS_OF_JOINTS))
        external_axes = tuple(numbers)
        return Literal(JOINTS, angles, external_axes, axes_name=jointtarget["axes"] or "")
    return None


def _read_robtarget(part: Line, configuration: str, axes_name: str) -> Literal:
    """Return the target of a robtarget, as indices of its numbers.

    `[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[eax_a,...]]` has seven numbers of the pose, four of the arm's
    configuration, and those of the external axes. A variable may take the place of the last two parts: it
    gives no numbers here.

    Args:
        part: the robtarget.
        configuration: text of its third part: four numbers in brackets, or the name of a variable.
        axes_name: name of the variable in place of its external axes; empty if these are numbers.
    """
    numbers = iter(part.ordinals)
    pose = tuple(islice(numbers, _NUMBERS_OF_POSE))
    words: tuple[tuple[str, int], ...] = ()
    if configuration.startswith("["):
        numbers_of_configuration = islice(numbers, len(_CONFIGURATION))
        words = tuple(zip(_CONFIGURATION, numbers_of_configuration, strict=True))
    external_axes = tuple(numbers)  # the rest
    return Literal(POSE, pose, external_axes, words, axes_name=axes_name)


def _assign_data(name: str, value: Line, kinds: Collection[str]) -> list[ir.Assign]:
    """Translate the assignment of data in numbers to a name, as in `p1 := [[0,0,0],[1,0,0,0],...];`.

    The name gets a target, external axes, a speed, or the frames of a tool or a work object: the text decides
    which one, among those that the name may be.

    Args:
        name: the name.
        value: the text behind `:=`.
        kinds: types that the name may have, such as ROBTARGET and TOOLDATA.

    Returns:
        Assignments: one for each frame of a work object, one for all else; empty if the text is no such data.
    """
    target = _read_fixed_target(value)
    may_be_target = "ROBTARGET" in kinds or "JOINTTARGET" in kinds
    if target is not None and may_be_target:
        return [ir.Assign(name, target)]
    match _find_type_of_data(value, kinds):
        case "EXTJOINT":
            return [ir.Assign(name, Literal(_AXES, value.ordinals))]
        case "SPEEDDATA":
            return [ir.Assign(name, _speed_of_tool(value))]
        case "WOBJDATA" | "TOOLDATA" as kind:
            return _assign_frames(name, kind, value.ordinals)
    return []


def _read_fixed_target(value: Line) -> Literal | None:
    """Return the target that a text states in numbers alone; None if the external axes are a variable.

    Such a variable may change, or mean another one, before the target is used.
    """
    target = _read_target(value)
    return target if target is not None and not target.axes_name else None


def _find_type_of_data(value: Line, kinds: Collection[str]) -> str:
    """Return the type of data that a text states in numbers, among the types `kinds`; empty if it is none.

    * EXTJOINT: external axes, `[0,0,0,0,0,0]`;
    * SPEEDDATA: a speed, `[100,500,5000,1000]`;
    * WOBJDATA: a work object, `[FALSE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]]`;
    * TOOLDATA: a tool, `[TRUE,[[0,0,100],[1,0,0,0]],load1]`, whose load may be an expression without calls.
    """
    for kind in ("EXTJOINT", "SPEEDDATA", "WOBJDATA"):
        if kind in kinds and _LITERALS[kind].fullmatch(value.text):
            return kind
    tool = _LITERALS["TOOLDATA"].fullmatch(value.text) if "TOOLDATA" in kinds else None
    if tool is None or ir.calls_routine(value.read_expression(tool["load"])):
        return ""
    return "TOOLDATA"


def _speed_of_tool(speed: Line) -> Literal:
    """Return the speed of the tool's centre, which is the first number of a speed (speeddata)."""
    return Literal(_NUMBERS, speed.ordinals[:1])


def _assign_frames(name: str, kind: str, ordinals: tuple[int, ...]) -> list[ir.Assign]:
    """Return the assignments of numbers to the frames of a work object or a tool.

    A work object wobj1 has two frames, wobj1.uframe and wobj1.oframe; a tool has one. The first seven numbers
    are those of the first frame, and so on.

    Args:
        name: name of the work object or tool.
        kind: WOBJDATA (work object) or TOOLDATA.
        ordinals: indices of its numbers among those of the statement.
    """
    assignments = list[ir.Assign]()
    numbers = iter(ordinals)
    for frame in _FRAMES_OF[kind]:
        pose = tuple(islice(numbers, _NUMBERS_OF_POSE))
        assignments.append(ir.Assign(name + frame, Literal(POSE, pose)))
    return assignments


def _multiply_frames(name: str, kind: str) -> ir.Product:
    """Return the product of the frames of data `name`; `kind` is WOBJDATA (work object) or TOOLDATA."""
    return ir.Product(tuple(f"{name}{frame}" for frame in _FRAMES_OF[kind]))


def _translate_declaration(line: Line) -> list[Op]:
    """Translate a declaration `CONST robtarget p1:=[...]`: the name gets numbers or an unknown value.

    The groups of the line are `scope` (LOCAL or TASK), `kind` (CONST), `type` (robtarget), `name` (p1),
    `array` (its size, such as {3}) and `value` behind `:=`.
    """
    name = line["name"]
    declaration: list[Op] = [ir.Local(frozenset({name})), *line.read_expression(line["array"])]
    if assignments := _declare_data(line):
        return [*declaration, *assignments]
    uses = ir.pass_uses(line.read_expression(line["value"]), name)
    kind = "frame" if "DATA" in line["type"] else "target"
    reason = f"{name} is not a fixed {kind} in numbers, or changes while the program runs"
    return [*declaration, *uses, ir.MakeUnknown(frozenset({name}), reason, _FRAME_REMEDY)]


def _declare_data(line: Line) -> list[ir.Assign]:
    """Return the assignments of the numbers in a declaration `CONST robtarget p1:=[...]` to its name.

    There are none if the declaration has no value, an array, or a value that is not in numbers. CONST data
    stay as they are; PERS and VAR data begin with these values. Other modules do not know LOCAL data.
    """
    is_array = line["array"] != ""
    if is_array or not line["value"]:
        return []
    declares = "constant" if line["kind"] == "CONST" else "variable"
    is_private = line["scope"] == "LOCAL"
    assignments = _assign_data(line["name"], line.part("value"), {line["type"]})
    return [each._replace(declares=declares, private=is_private) for each in assignments]


def _translate_assignment(line: Line) -> list[Op]:
    """Translate an assignment, with the groups `name`, `part` (behind the name; may be empty) and `value`.

    * `p1:=[[0,0,500],...];`: the name gets data in numbers, such as a target or a tool;
    * `tool1.tframe:=[[0,0,100],[1,0,0,0]];`: one frame of a tool or work object gets a pose in numbers;
    * `p1:=Offs(p2,0,0,50);`, `p1.trans.x:=5;` or `p{i}:=p2;`: the value of the whole name, p1 or p, is
      unknown from here on, because values that are computed, single fields and elements are not followed.
      What the value reads, here p2, goes into the name: it matters only if the name is used.
    """
    name, part, value = line["name"], line["part"], line.part("value")
    if not part and (assignments := _assign_data(name, value, _LITERALS)):
        return [*assignments]
    is_frame = part in {".UFRAME", ".OFRAME", ".TFRAME"}
    if is_frame and re.fullmatch(_POSE_PATTERN, value.text):
        return [ir.Assign(name + part, Literal(POSE, value.ordinals))]
    uses = [*_read_indices(line, part), *value.read_expression()]
    reason = f"{name} changes while the program runs"
    return [*ir.pass_uses(uses, name), ir.MakeUnknown(frozenset({name}), reason, _FRAME_REMEDY)]


def _read_indices(line: Line, part: str) -> list[Op]:
    """Return the uses of variables in the indices of a part, such as i and j of `{i,j}.trans`.

    The part is read as an expression `[i,j].trans`. Without braces, as in `.trans`, there are no indices.
    """
    has_indices = "{" in part
    indices = part.replace("{", ",[").replace("}", "]").lstrip(",") if has_indices else ""
    return line.read_expression(indices)


def _translate_move(line: Line) -> list[Op]:
    """Translate a move such as `MoveL p1,v100,z10,tool1`, or one with a process such as `MoveLDO`.

    * A complete move is corrected.
    * A move without a target in numbers, or with an option that may move the target, is not corrected.
    * A text whose arguments are no expressions is no move: it is not understood.

    `MoveLSync p1,v100,z10,tool1,"grip";` also calls its last argument, a routine, when it reaches the target.

    Raises:
        Misread: its arguments are not expressions.
    """
    calls = [_call_at_target(line)] if line["process"] == "SYNC" else []
    try:
        return [*calls, *_translate_plain_move(line)]
    except Misread as fault:
        # Faults of a move, such as a tool that is computed, have a remedy; those of expressions have none.
        are_arguments_understood = bool(fault.remedy)
        if not are_arguments_understood:
            raise
        obstacle = _Obstacle(fault.reason, fault.remedy)
    uncorrected = _translate_uncorrected_instruction(line, _read_arguments(line), obstacle)
    return [*calls, *uncorrected]


def _call_at_target(line: Line) -> Op:
    """Return the call of the routine that is the last argument of `MoveLSync p1,v100,z10,tool1,"grip";`."""
    last_argument = line["arguments"].rsplit(",", 1)[-1].strip()
    routine = _read_routine_name(last_argument)
    return ir.Call(routine.name, anytime=True, event="\0target", prefix=routine.prefix)


def _translate_plain_move(line: Line) -> list[Op]:
    r"""Translate a move whose arguments are complete, such as `MoveC p1,p2,v100,z10,tool1\WObj:=wobj1`.

    Raises:
        Misread: arguments are missing, unknown or computed.
    """
    parts = _split_move(line)
    targets = _read_targets(parts.points)
    if len(targets) < len(parts.points):
        return _translate_uncorrected_move(parts, _Obstacle("the target is not given by numbers", _REMEDY))
    uses = [*parts.uses, *_read_expressions(parts.others)]
    if ir.calls_routine(uses):
        raise Misread("an argument of the move is computed", "write speed, zone and tool by their names")
    return [*uses, _make_move(parts, _read_feed(line, parts.speed))]


def _split_move(line: Line) -> _PartsOfMove:
    """Split a move into its parts.

    The groups of the line are `letter` (C) or, for TriggL and the like, `trigger`; and `arguments`.

    Raises:
        Misread: arguments are missing or unknown, or tool or work object is computed.
    """
    letter = line["letter"] or line["trigger"] or "J"  # MoveAbsJ has no letter of its own
    count = _count_targets(letter)
    arguments = _split_arguments(line, _OPTIONS)
    tool = _find_tool_of_move(line, arguments, count)
    points, others = arguments.values[:count], arguments.values[count:]
    return _PartsOfMove(letter, points, others, tool, arguments.work_object, arguments.uses)


def _find_tool_of_move(line: Line, arguments: _Arguments, count_of_targets: int) -> Line:
    """Return the argument of a move that is its tool, by its place among the arguments.

    * `MoveL p1,v100,z10,tool1`: behind the targets, the speed and the zone;
    * `TriggL p1,v100,trigger1,z10,tool1`: behind a trigger, too;
    * `MoveLDO p1,v100,z10,tool1,do1,1`: further arguments follow, here two.

    Raises:
        Misread: arguments are missing, or the tool is computed.
    """
    has_trigger = line["trigger"] != ""
    place_of_tool = count_of_targets + (3 if has_trigger else 2)
    expected_count = place_of_tool + 1 + _count_arguments_after_tool(line)
    is_complete = len(arguments.values) == expected_count
    if is_complete and re.fullmatch(_WORD, arguments.values[place_of_tool].text):
        return arguments.values[place_of_tool]
    reason = "the target is not given by numbers, or the move names no speed, zone and tool"
    remedy = "write speed, zone and tool by their names, and \\WObj:= if there is a work object"
    raise Misread(reason, remedy)


def _count_arguments_after_tool(line: Line) -> int:
    """Return the count of arguments that the form of a move has behind the tool, such as two in MoveLDO."""
    count = _ARGUMENTS_AFTER_TOOL.get(line["process"], 0)
    has_value_as_option = "\\VALUE:=" in line.text  # it takes the place of the second argument
    return count - 1 if has_value_as_option else count


def _read_feed(line: Line, speed: Line) -> ir.Feed | None:
    """Return the feed of a move, whose speed (speeddata) is an argument; None if the feed is computed.

    `VelSet 50,800;` elsewhere in the program changes the feeds of all moves behind it. So the feed has the
    names under which the percentage and the greatest speed are found when the program is followed.
    """
    feed = _read_own_feed(line, speed)
    if feed is None:
        return None
    return feed._replace(percentage=_PERCENTAGE, greatest=_GREATEST)


def _read_own_feed(line: Line, speed: Line) -> ir.Feed | None:
    r"""Return the feed that a move itself states, as a number or a name; None if the feed is computed.

    The move `MoveL p1,v100,...` has the feed of the speed v100. In `MoveL p1,v100\V:=80,...` the number 80
    takes its place, and in `MoveL p1,v100\T:=3,...` the time of the move does, which gives no feed.

    Args:
        line: the move.
        speed: its argument with the speed (speeddata): a name, or numbers such as `[100,500,5000,1000]`.
    """
    arguments = line.part("arguments")
    option = _OWN_SPEED.search(arguments.text)
    if option is not None:
        is_speed_in_numbers = option["option"] == "V" and option["number"]
        if not is_speed_in_numbers:
            return None
        number = arguments.cut(*option.span("number"))
        return ir.Feed(Literal(_NUMBERS, number.ordinals))
    if _LITERALS["SPEEDDATA"].fullmatch(speed.text):
        return ir.Feed(_speed_of_tool(speed))
    is_name = re.fullmatch(_WORD, speed.text) is not None
    return _name_feed(speed.text) if is_name else None


def _name_feed(name: str) -> ir.Feed:
    """Return the feed with the name of a speed: v100 is 100 mm/s, unless the program declares the name."""
    of_controller = _SPEED.fullmatch(name)
    default = float(of_controller["speed"]) if of_controller else np.nan
    return ir.Feed(ir.Copy(name), otherwise=default)


class _Arguments(NamedTuple):
    """Arguments of a move."""

    values: list[Line]  # without their options
    work_object: str  # name of the work object
    uses: list[Op]  # uses of names in the values of options


def _split_arguments(line: Line, known_options: re.Pattern[str]) -> _Arguments:
    r"""Split the arguments of a move such as `p1,v100\T:=3,z10,tool1\WObj:=wobj1`.

    The values are p1, v100, z10 and tool1; the options are `\T:=3` and `\WObj:=wobj1`.

    Args:
        line: the move.
        known_options: names of options that do not move the target.

    Raises:
        Misread: an option may move the target, or the work object is computed.
    """
    values, options = _separate_options(line.part("arguments"))
    work_object = "WOBJ0"  # the controller's own one, if the move names none
    uses = list[Op]()
    for option in options:
        _refuse_option(option, known_options)
        uses += line.read_expression(option.value)
        work_object = _read_work_object(option) or work_object
    return _Arguments(values, work_object, uses)


def _separate_options(arguments: Line) -> tuple[list[Line], list[_Option]]:
    r"""Return the values p1 and v100 and the option `\T:=3` of the arguments `p1,v100\T:=3`.

    A part between commas that has only options, as in `\Conc,p1`, is no value. An empty part is one, so that
    the places of the others stay the same, apart from a first one: `MoveL ,p1` has one value.
    """
    values, options = list[Line](), list[_Option]()
    for index, part in enumerate(arguments.split()):
        value, *options_of_value = part.split("\\")
        options += map(_read_option, options_of_value)
        is_blank = not value.text.strip()
        has_only_options = is_blank and bool(options_of_value)
        is_before_first_comma = is_blank and index == 0
        if has_only_options or is_before_first_comma:
            continue
        values.append(value.cut(1) if value.text.startswith(" ") else value)
    return values, options


class _Option(NamedTuple):
    r"""Option behind an argument, such as `\WObj:=wobj1` or `\Conc`."""

    name: str
    value: str  # empty if the option has none


def _read_option(text: Line) -> _Option:
    """Return the option that a text behind a backslash states."""
    name, _, value = text.text.partition(":=")
    return _Option(name, value)


def _refuse_option(option: _Option, known_options: re.Pattern[str]) -> None:
    r"""Refuse an option of a move that may move the target, as `\Corr` and `\Track` do.

    Raises:
        Misread: the name of the option is none of the known ones.
    """
    if not known_options.fullmatch(option.name):
        reason = f"the argument \\{option.name} moves the target, or is not known"
        raise Misread(reason, "omit the statement")


def _read_work_object(option: _Option) -> str:
    r"""Return the name of the work object in the option `\WObj:=wobj1`; empty for any other option.

    Raises:
        Misread: the work object is computed.
    """
    if option.name != "WOBJ":
        return ""
    if not re.fullmatch(_WORD, option.value):
        raise Misread("the argument \\WObj is computed", _FRAME_REMEDY)
    return option.value


_ENDS: Final = re.compile(
    # its first characters come before all else, so that the search passes quickly over all others
    r"(?=[\"!%;:<BDEFMPTUbdefmptu])(?:"
    r"\"[^\"\r\n]*+\"|![^\r\n]*+|%%%[^%;!]*+%%%|(?i:(?P<end>;|:(?!=)|<(?:SMT|DDN|TDN|RDL|EIT|CSE)>"
    r"|\b(?:THEN|DO|ELSE|END(?:IF|FOR|WHILE|TEST|PROC|FUNC|TRAP|MODULE|RECORD))\b"
    r"|(?<![\w\\.])(?:ERROR|UNDO|BACKWARD)\b(?!\s*+:?=)(?:\s*+\([^()]*\))?"
    r"|\b(?:PROC|FUNC\s++\w++)\s++\w++\s*+\([^()]*\)|\bTRAP\s++\w++"
    r"|(?P<head>\bMODULE\s++\w++(?:\s*+\([^()]*\))?))))"
)
"""End of a statement; texts and comments match without the group `end`, because no statement ends in them.

The head of a module is a statement of its own, also behind other text."""


def read_rapid(statements: Statements, sources: tuple[Source, ...]) -> None:
    """Add the statements of a module, and those of the other modules of its task.

    Further modules, in the same file or in further files, are parts of the same program; moves of further
    files are not corrected.
    """
    statements.columns.spelled.update(WOBJ0="wobj0", TOOL0="tool0")  # as messages name them
    modules = [module for index, source in enumerate(sources) for module in _split_modules(index, source)]
    for module, new_names in zip(modules, _rename_local_names(modules), strict=True):
        translate = partial(_translate_renamed, renamed=new_names) if new_names else None
        statements.add_statements(module.source, module.starts, module.ends, translate=translate)
    _refuse_ambiguous_moves(statements, modules)


def _refuse_ambiguous_moves(statements: Statements, modules: Iterable[_Module]) -> None:
    """Let no target be certain if a routine of the program has the name of a process move, such as ArcL."""
    routines = [routine for module in modules for routine in re.findall(_ROUTINE, module.text)]
    ambiguous = [routine for routine in routines if _PROCESS_MOVE.fullmatch(routine)]
    if ambiguous:
        name = min(ambiguous)
        reason = f"the program has its own routine {name}, but a move of a process has the same name"
        statements.forget_anytime(ir.ALL_TARGETS, reason, "give the routine another name")


class _Module(NamedTuple):
    """A module of a file: its text in capitals, and its statements."""

    source: int  # index of the file
    text: str
    starts: IndexArray  # (n,) first character of each statement in the file
    ends: IndexArray  # (n,) last character + 1 of each statement


def _split_modules(index: int, source: Source) -> Iterator[_Module]:
    """Yield the modules of a file, which has the given index among the files."""
    found = _find_statements(source.text)
    # Text before the second head belongs to the first module.
    borders = (0, *found.heads[1:], len(source.text))
    for begin, end in pairwise(borders):
        first, last = np.searchsorted(found.starts, (begin, end)).tolist()
        text = capitalise(source.text[begin:end])
        yield _Module(index, text, found.starts[first:last], found.ends[first:last])


class _NamesOfModule(NamedTuple):
    """Names in capitals that a module has."""

    local: set[str]  # those that it declares as LOCAL
    every: set[str]


def _list_names(module: _Module) -> _NamesOfModule:
    """List the names of a module."""
    text_without_comments = _TEXT_OR_COMMENT.sub(" ", module.text)
    return _NamesOfModule(
        local=set(re.findall(_LOCAL, text_without_comments)), every=set(re.findall(_WORD, module.text))
    )


def _rename_local_names(modules: list[_Module]) -> list[dict[str, str]]:
    """Return for each module new names of those that mean something else elsewhere, by their old names.

    `LOCAL CONST robtarget p1:=...` declares a point that only its own module knows: p1 means something else
    in all other modules. The first module keeps its names, so that messages have them. In another module,
    p1 gets a new name in two cases:

    * p1 is LOCAL in the first module: what this module names p1 is another thing;
    * p1 is LOCAL in this module, and a further module has the name, too.
    """
    if len(modules) < 2:
        return [{} for _ in modules]
    first, *others = map(_list_names, modules)
    count_of_modules = Counter([*first.every])  # by each name, in how many modules it occurs
    for names in others:
        count_of_modules.update(names.every)
    renamed: list[dict[str, str]] = [{}]
    for index, names in enumerate(others, 1):
        local_in_first = first.local & names.every
        local_here = {name for name in names.local if count_of_modules[name] > 1}
        new_names = {name: f"{name}{IN_MODULE}0" for name in local_in_first}
        new_names |= {name: f"{name}{IN_MODULE}{index}" for name in local_here}
        renamed.append(new_names)
    return renamed


_ROUTINE: Final = rf"\bPROC\s++({_WORD})"
_LOCAL: Final = rf"\bLOCAL\s++(?:PROC|TRAP|(?:FUNC|CONST|PERS|VAR)\s++\w++)\s++({_WORD})"
_TEXT_OR_COMMENT: Final = re.compile(r'"[^"\r\n]*+"|![^\r\n]*+')
_TEXT_OR_NAME: Final = re.compile(rf'"(?P<quoted_name>{_WORD})"|"[^"\r\n]*+"|(?<![\w.\\])(?P<name>{_WORD})')


def _translate_renamed(masked: str, renamed: dict[str, str]) -> list[tuple[int, Op]]:
    """Translate a statement of a module in which some names got new ones, so that modules are kept apart.

    Routines that are called by texts, such as `%"sub"%`, are renamed, too; other texts, such as those of
    `TPWrite "sub 1"`, stay.

    Args:
        masked: the statement with NUL in place of each number.
        renamed: new names, by the old ones in capitals.

    Returns:
        Operations, each with its number of lines below the first line of the statement.
    """

    def rename(match: re.Match[str]) -> str:
        name = match["quoted_name"] or match["name"]
        is_other_text = not name
        if is_other_text:
            return match[0]
        return match[0].replace(name, renamed.get(capitalise(name), name))

    return LANGUAGE.translate(_TEXT_OR_NAME.sub(rename, masked))


class _StatementsOfFile(NamedTuple):
    """Places of the statements and modules of a file."""

    starts: IndexArray  # (n,) first character of each statement
    ends: IndexArray  # (n,) last character + 1 of each statement
    heads: list[int]  # first character of the head of each module


def _find_statements(text: str) -> _StatementsOfFile:
    """Find the statements of a file, such as `MoveL p1,...;` and `IF a THEN`, and the heads of its modules.

    Blank statements are left out.
    """
    borders = _find_borders(text)
    starts, ends = list[int](), list[int]()
    for begin, end in pairwise(borders.of_statements):
        statement = text[begin:end].lstrip()
        if statement:
            starts.append(end - len(statement))
            ends.append(end)
    return _StatementsOfFile(
        np.array(starts, dtype=np.intp), np.array(ends, dtype=np.intp), borders.begins_of_modules
    )


class _Borders(NamedTuple):
    """Borders of the statements and modules of a file, as indices of characters."""

    of_statements: list[int]  # the begin of the file, the places between statements and the end
    begins_of_modules: list[int]  # first character of the head of each module


def _find_borders(text: str) -> _Borders:
    """Find where the statements and modules of a file begin and end.

    A statement ends at a semicolon, or behind a word such as THEN. The head of a module, `MODULE part`, ends
    the statement before it, and is one itself: it has a border on both sides.
    """
    borders = _Borders(of_statements=[0], begins_of_modules=[])
    for match in _ENDS.finditer(text):
        if match["head"]:
            borders.begins_of_modules.append(match.start())
            borders.of_statements.append(match.start())
        if match["end"]:  # also the head of a module
            borders.of_statements.append(match.end())
    borders.of_statements.append(len(text))
    return borders


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
