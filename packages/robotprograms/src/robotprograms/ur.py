"""Programs of Universal Robots (URScript), translated."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from robotprograms import language as ir
from robotprograms.language import Line, Misread, Op, split_outside_brackets
from robotprograms.notation import Notation, Orientation
from robotprograms.program import Literal, Motion, Source
from robotprograms.statements import Statements

POSE: Final = Notation(Orientation.ROTATION_VECTOR, length=1, angle=1, length_decimals=7, angle_decimals=7)
JOINTS: Final = Notation(Orientation.JOINTS, length=1, angle=1, length_decimals=7, angle_decimals=7)
JOINTS_IN_DEGREES: Final = Notation(Orientation.JOINTS, length=1)
POSE_IN_DEGREES: Final = Notation(Orientation.ROTATION_VECTOR, length=1, length_decimals=7)
_NUMBER: Final = Notation(Orientation.NONE)
_ROBOT_BASE: Final = ir.Copy("robot base")
_ACTIVE: Final = "active TCP"
"""The controller's tool, by a name that no variable of a program can have."""
_MOTIONS: Final = {
    "movej": Motion.JOINT, "movel": Motion.LINEAR, "movep": Motion.LINEAR, "movec": Motion.CIRCULAR
}  # fmt: skip
_ARGUMENTS: Final = {
    "movej": ("a", "v", "t", "r"), "movel": ("a", "v", "t", "r"), "movep": ("a", "v", "r"),
    "movec": ("a", "v", "r", "mode"),
}  # fmt: skip
"""Arguments of moves behind their targets, in order."""
_M_PER_S: Final = 1e3
"""Unit of a speed [mm/s]."""
# Facts. Source: Universal Robots, The URScript programming language 5.11.
# Routines that move the robot to a place that no target in numbers gives.
_MOVES_WITHOUT_TARGET: Final = re.compile(
    r"(?:servo|speed)[jlc]|\w*(?:force|freedrive|teach)_mode|tool_contact|optimove[jl]|\w*(?:conveyor(?!_tick)|path_offset)\w*"
    r"|screw_driving|move_until_contact|position_deviation_warning|reset_revolution_counter|set_pos"
)
# Those of them that last, and so move what later moves reach, until another one ends them
_LASTING: Final = re.compile(r"(?!servo|speed|tool_contact|optimove|move_until_contact).*")
_KINDS: Final = re.compile(r"force_mode|freedrive|teach|path_offset|conveyor|screw_driving")
"""Kinds of what lasts, in the name of the routine that begins it and of the one that ends it."""
_END_OF_LASTING: Final = re.compile(
    r"end_(?:force|freedrive|teach)_mode|path_offset_disable|stop_conveyor_tracking|end_screw_driving"
)
# Routines that tell a value, wait, show a text, or set payload, signals, registers and connections.
_HARMLESS: Final = (
    r"sleep|sync|textmsg|popup|halt|stop[jl]|zero_ftsensor|(?:enter|exit)_critical|random|force|is_(?:steady|within_safety_limits)"
    r"|set_(?:target_)?payload\w*|set_gravity|[sg]et_flag|set_watchdog|set_input_actions_to_default|set_baselight_mode"
    r"|set_safety_mode_transition_hardness|set_tool_(?:voltage|communication|output_mode)|set_dual_pin\w*"
    r"|[sg]et_\w*(?:digital|analog|euromap|runstate)_?\w*"
    r"|get_(?:inverse_kin|forward_kin|tcp_offset|tcp_force|tool_current|joint_t\w+|controller_temp|steptime"
    r"|freedrive_status|(?:actual|target)_(?:tcp|joint|payload|waypoint)\w*|conveyor_tick_count)"
    r"|set_conveyor_tick_count|encoder_\w+|(?:read|write)_(?:in|out)put_\w+|(?:read|write)_port_\w+|(?:modbus|socket|rtde)_\w+|rpc_factory"
    r"|pose_\w+|tool_pose|point_dist|interpolate_pose|rpy2rotvec|rotvec2rpy|wrench_trans|to_(?:str|num)|str_\w+|norm|normalize|length"
    r"|floor|ceil|sqrt|pow|log|a?(?:sin|cos|tan)|atan2|d2r|r2d|abs|\w*binary_list\w*|make_list|time|struct|size|inv|transpose|get_list_length"
    r"|ft_rtde_input_enable|enable_external_ft_sensor"
)
_RESERVED: Final = (
    r"def|sec|thread|end|if|elif|else|while|for|switch|case|default|return|break|continue|pass|global|local|kill"
    r"|join|set_tcp|move[jlpc]"
)
_REMEDY: Final = (
    "write p[x, y, z, rx, ry, rz] or [q1 ... q6] in numbers, or use a variable that is assigned such numbers "
    "exactly once"
)
_WORD: Final = r"[^\W\d]\w*+"
_COUNT: Final = 6  # numbers of a pose
_SIX: Final = r"\[\0(?:,\0){5}\]"
_OFFSET: Final = re.compile(
    rf"pose_(?:trans|add)\((?P<target>{_WORD}),(?P<offset>[^()]++(?:\([^()]*+\)[^()]*+)*)\)"
)
"""A pose at an offset from a target."""
_DEGREES: Final = r"d2r\(\0\)(?:,d2r\(\0\))"
_LITERALS: Final = (
    (POSE, re.compile(rf"p{_SIX}")),
    (JOINTS, re.compile(_SIX)),
    (JOINTS_IN_DEGREES, re.compile(rf"\[{_DEGREES}{{5}}\]")),
    (POSE_IN_DEGREES, re.compile(rf"p\[\0,\0,\0,{_DEGREES}{{2}}\]")),
)


def _translate_routine(line: Line) -> list[Op]:
    """Translate the head of a function, `def f(a, b=1):`, or of a thread, which may run at any time."""
    uses = list[Op]()
    for default_value in re.findall(r"=([^,]+(?:\([^()]*\))?)", line["parameters"]):
        uses += line.read_expression(f"({default_value})")
    parameters = re.findall(rf"(?:^|,)({_WORD})", line["parameters"])
    is_thread = line["kind"] != "def"
    return [
        *ir.mark_anytime(uses),
        *ir.begin_routine(line["name"], parameters, _REMEDY, handler=is_thread),
    ]


def _translate_calculated_tool(line: Line) -> list[Op]:
    """Translate `set_tcp(p[...])` with a pose that is calculated of numbers and pi.

    Raises:
        Misread: the pose has not six numbers.
    """
    begin, end = line.span("pose")
    spans = split_outside_brackets(line.text[:end], begin)
    expressions = tuple(line.text[first:last] for first, last in spans)
    if len(expressions) != _COUNT:
        return _refuse_unknown_tool(line)
    tool = ir.Stated(_ACTIVE, POSE, expressions, line.ordinals_in(begin, end))
    return [ir.Assign(_ACTIVE, tool)]


def _refuse_unknown_tool(_line: Line) -> list[Op]:
    """Refuse `set_tcp` with an argument that is not a pose in numbers.

    Raises:
        Misread: always.
    """
    raise Misread("the tool is not given by numbers", "write set_tcp(p[x, y, z, rx, ry, rz])")


def _translate_call(line: Line) -> list[Op]:
    """Translate a call; that of a function of the controller which moves the robot is an uncorrected move."""
    name = line["name"]
    found = line.read_expression(line.text)
    # The program itself may define a routine with this name. No function of the controller sets the tool.
    own_routine = ir.Call(name, harmless=True)
    others = [op for op in found if not _is_call_of(name, op)]
    if _END_OF_LASTING.fullmatch(name):
        return [own_routine, *others, ir.end_lasting(_find_kind(name))]
    if not _MOVES_WITHOUT_TARGET.fullmatch(name):
        return found
    reason, remedy = f"{name} moves the robot without a target", "use movej, movel, movep or movec"
    ops: list[Op] = [own_routine, *others]
    if _LASTING.fullmatch(name):
        ops.append(ir.begin_lasting(_find_kind(name), reason, remedy))
    return ir.make_uncorrected_move(ops, reason, remedy)


def _find_kind(name: str) -> str:
    """Return the kind of what lasts behind a routine; the routine's own name if nothing ends it."""
    kind = _KINDS.search(name)
    return kind[0] if kind else name


def _is_call_of(name: str, op: Op) -> bool:
    """Return whether an operation calls a routine."""
    return isinstance(op, ir.Call) and op.name == name


def _read_literal(line: Line, start: int, end: int) -> Literal | None:
    """Return the pose `p[...]` or joint angles `[...]` between two indices; None if neither is there."""
    for notation, pattern in _LITERALS:
        if pattern.fullmatch(line.text, start, end):
            return Literal(notation, line.ordinals_in(start, end))
    return None


def _read_value(line: Line, text: str) -> list[Op]:
    """Return the operations of an expression; the `p` of poses such as `p[x, ...]` is not a name."""
    return line.read_expression(re.sub(r"\bp(?=\[)", "", text))


def _translate_assignment(line: Line) -> list[Op]:
    """Translate an assignment: a name gets a target in numbers, one number or an unknown value."""
    name, index, value = line["name"], line["index"], line["value"]
    declaration: list[Op] = [ir.Local(frozenset({name}))] if line["local"] else []
    if not index:
        literal = _read_literal(line, *line.span("value"))
        if value == ir.A_NUMBER:  # pi, or a speed
            literal = Literal(_NUMBER, line.ordinals_in(*line.span("value")))
        if literal is not None:
            return [*declaration, ir.Assign(name, literal)]
    ops = declaration
    if "[" in index:
        ops = [*ops, *line.read_expression(index.strip("[]").replace("][", ","))]
    offset = _OFFSET.fullmatch(value) if not index else None  # such as pose_add(target, offset)
    if offset:
        ops = [*ops, ir.Offset(name, offset["target"])]
        value = offset["offset"]
    unknown = ir.MakeUnknown(frozenset({name}), f"{name} gets a value that is not a number", _REMEDY)
    return [*ops, *_read_value(line, value), unknown]


def _translate_move(line: Line) -> list[Op]:
    """Translate a move, such as `movel(p[...], a=1.2, v=0.1)`; without known target it is not corrected.

    Raises:
        Misread: a target is missing, or the move calls a routine.
    """
    motion = _MOTIONS[line["motion"]]
    # Names of the arguments with the targets, which a call may state or omit
    target_names = ("pose_via", "pose_to") if motion is Motion.CIRCULAR else ("pose|q",)
    begin, end = line.span("arguments")
    spans = list(split_outside_brackets(line.text[:end], begin))
    found: list[Op] = []
    targets: list[Literal | ir.Name] = []
    bases: list[ir.Value] = []
    for name, (start, stop) in zip(target_names, spans, strict=False):
        prefix = re.compile(f"(?:{name})=").match(line.text, start, stop)
        try:
            target, base = _read_target(line, prefix.end() if prefix else start, stop, found)
        except Misread as fault:
            uses = _read_value(line, line["arguments"])
            return ir.make_uncorrected_move(uses, fault.reason, _REMEDY, motion)
        targets.append(target)
        bases.append(base)
    if len(targets) < len(target_names):
        raise Misread("a target is not given by numbers")
    arguments = _find_arguments(line, spans[len(target_names) :])
    for _, (start, stop) in arguments:
        found += line.read_expression(line.text[start:stop])
    if ir.calls_routine(found):
        raise Misread("the arguments of the move call a routine")
    feed = _read_feed(line, dict(arguments))
    tools = (ir.Copy(_ACTIVE),) * len(targets)
    move = ir.Move(motion, tuple(targets), tuple(bases), tools, feed=feed)
    near_targets = _find_named_bases(bases)
    if near_targets:  # a base that is a target itself: the move goes near this target, and shifts with it
        reason = "the target is at an offset from another one"
        near = ir.Move(
            motion, (), (_ROBOT_BASE,), tools[:1], reason=reason, remedy=_REMEDY, offset_from=near_targets
        )
        move = move._replace(near_target=near)
    return [*found, move]


def _find_arguments(line: Line, spans: list[tuple[int, int]]) -> list[tuple[str, tuple[int, int]]]:
    """Return name and place of the value of each argument behind the targets of a move.

    An argument has its name before it, as in `v=0.1`, or the name that belongs to its place.
    """
    arguments = list[tuple[str, tuple[int, int]]]()
    for (start, stop), name_of_place in zip(spans, _ARGUMENTS[line["motion"]], strict=False):
        stated_name = re.compile("(a|v|t|r|mode)=").match(line.text, start, stop)
        if stated_name:
            arguments.append((stated_name[1], (stated_name.end(), stop)))
        else:
            arguments.append((name_of_place, (start, stop)))
    return arguments


def _read_feed(line: Line, arguments: Mapping[str, tuple[int, int]]) -> ir.Feed | None:
    """Return the feed of a move; None if it states none in numbers or by a name.

    `arguments` are the places of the values of the arguments, by their names.
    URScript manual: a time `t` that is not zero counts in place of speed and acceleration.
    """
    if "v" not in arguments:
        return None
    ordinal_of_time = None
    if "t" in arguments:
        start, end = arguments["t"]
        if line.text[start:end] != ir.A_NUMBER:  # the time is not a number
            return None
        (ordinal_of_time,) = line.ordinals_in(start, end)
    start, end = arguments["v"]
    speed = line.text[start:end]
    if speed == ir.A_NUMBER:
        number = Literal(_NUMBER, line.ordinals_in(start, end))
        return ir.Feed(number, _M_PER_S, time=ordinal_of_time)
    is_name = re.fullmatch(_WORD, speed)
    return ir.Feed(ir.Copy(speed), _M_PER_S, time=ordinal_of_time) if is_name else None


def _find_named_bases(bases: Iterable[ir.Value]) -> tuple[ir.Name, ...]:
    """Return the names of bases that are variables."""
    return tuple(each.name for each in bases if isinstance(each, ir.Copy) and each != _ROBOT_BASE)


def _read_target(line: Line, start: int, end: int, found: list[Op]) -> tuple[Literal | ir.Name, ir.Value]:
    """Return a target, in numbers or as a variable, and the frame of the target.

    The target may be an argument of `get_inverse_kin` or `pose_trans`. Operations of the expressions in the
    target are appended to `found`.

    Raises:
        Misread: the target is not given by numbers or a variable.
    """
    text = line.text[start:end]
    call = re.match(r"(get_inverse_kin|pose_trans)\(", text)
    if call and text.endswith(")"):
        begin_of_arguments = start + call.end()
        first, *others = list(split_outside_brackets(line.text[: end - 1], begin_of_arguments))
        if call[1] == "get_inverse_kin":
            if len(others) > 3 or "tcp=" in text:  # the fifth argument is a tool
                raise Misread("the call of get_inverse_kin states a tool")
            for begin, stop in others:  # angles near the answer, and tolerances
                found += line.read_expression(line.text[begin:stop].removeprefix("qnear="))
            return _read_target(line, *first, found)
        has_inner_call = "(" in text[call.end() :]
        if len(others) == 1 and not has_inner_call:  # pose_trans(base, target in the base)
            base, _ = _read_target(line, *first, found)
            target, _ = _read_target(line, *others[0], found)
            return target, base if isinstance(base, Literal) else ir.Copy(base)
    literal = _read_literal(line, start, end)
    if literal is not None:
        return literal, _ROBOT_BASE
    if not re.fullmatch(_WORD, text):
        raise Misread("a target is not given by numbers")
    return text, _ROBOT_BASE


_BRACKET_OR_LINE_END: Final = re.compile(r"\"[^\"\r\n]*+\"|#[^\r\n]*+|([(\[{])|([)\]}])|(\r\n?+|\n)")
_BEGINS_STATEMENT: Final = re.compile(rf"[ \t]*+(?:{_RESERVED})(?!\w)")
_MAX_JOINED: Final = 8192
"""Largest number of characters of lines that an open bracket joins."""


def read_urscript(statements: Statements, sources: tuple[Source, ...]) -> None:
    """Add the statements of a program: lines, which are joined while a bracket is open.

    Where a word begins a statement before the bracket is closed, or the text is too long, each line is a
    statement of its own: then only the line with the open bracket is not understood.
    """
    text = sources[0].text
    starts, ends = array("q"), array("q")
    lines = [0]  # first characters of the statement's lines
    depth = 0  # count of its open brackets

    def end_statement(end: int) -> None:
        """Add the statement that ends before a character; its lines one by one if a bracket is open."""
        if depth > 0:
            starts.extend(lines)
            ends.extend([*lines[1:], end])
        else:
            starts.append(lines[0])
            ends.append(end)

    for match in _BRACKET_OR_LINE_END.finditer(text):
        opening, closing, line_end = match[1], match[2], match[3]
        if opening:
            depth += 1
        elif closing:
            depth = max(depth - 1, 0)
        elif line_end:
            end = match.end()
            is_short = end - lines[0] <= _MAX_JOINED
            if depth > 0 and is_short and not _BEGINS_STATEMENT.match(text, end):
                lines.append(end)  # the statement goes on
                continue
            end_statement(end)
            lines, depth = [end], 0
    end_statement(len(text))
    statements.add_statements(
        0, np.asarray(memoryview(starts), dtype=np.intp), np.asarray(memoryview(ends), dtype=np.intp)
    )


LANGUAGE: Final = ir.Language(
    opening=r"(?<!\w)p?\s*\[\s*(?:d2r\s*\(\s*)?",
    fixed_words=frozenset({"d2r", "get_inverse_kin", "pose_trans"}),
    suffixes=".script .urscript",
    pose=POSE,
    read=read_urscript,
    comment=r"#[^\r\n]*+",
    ignores_case=False,
    operators="and|or|xor|not|run",
    reserved=_RESERVED,
    functions=_HARMLESS,
    motion=r"\bmove[jlpc]\b",
    remedy=_REMEDY,
    active={_ACTIVE: "active TCP"},
    is_reached=lambda name: name == _ACTIVE,
    # URScript manual, scoping rules: without `global`, a name is the routine's own unless a global one exists
    scopes_by_routine=True,
    lasting=_KINDS.pattern,
    # the tool, and words of branches, loops and routines
    forgets=r"(?i:tcp)|\b(?:def|sec|thread|end|if|elif|else|while|for|switch|case|default|return|break|run)\b",
    constants={"robot base": np.eye(4)},
    rules=(
        (r"\$ ?\0(?: ?\"[^\"]*\")*", ""),  # PolyScope numbers its nodes: $ 3 "Waypoint_1"
        (r"(?P<kind>def|sec|thread) @{name}\((?P<parameters>.*)\):", _translate_routine),
        (r"end", "close_or_end"),
        (r"if ?(.+):", "if"),
        (r"switch ?(.+):", "switch"),
        (r"while ?(?:True|\(True\)):", "forever"),
        (r"while ?(.+):", "loop"),
        (r"(?:elif|case) ?(.+):", "branch"),
        (r"else:?|default:", "default"),
        (r"break", "leave"),
        (r"continue", "again"),
        (rf"pass|(?:enter|exit)_critical|(?:kill|join) {_WORD}", ""),
        (r"return ?(.*)", "return"),
        (r"halt", "stop"),
        (
            rf"set_tcp\((?:pose=)?p{_SIX}(?:,.*)?\)",
            lambda line: [ir.Assign(_ACTIVE, Literal(POSE, line.ordinals[:6]))],
        ),
        (rf"(run {_WORD}\(.*\))", ""),
        (
            rf"set_tcp\((?:pose=)?(?P<frame>{_WORD})(?:,.*)?\)",
            lambda line: [ir.Use(frozenset({line["frame"]})), ir.Assign(_ACTIVE, ir.Copy(line["frame"]))],
        ),
        (
            r"set_tcp\((?:pose=)?p\[(?P<pose>(?:\0|pi|d2r|[(),*/+-])+)\](?:,.*)?\)",
            _translate_calculated_tool,
        ),
        (r"set_tcp\(.*", _refuse_unknown_tool),
        (r"(?P<motion>move[jlpc])\((?P<arguments>.*)\)", _translate_move),
        (r"@{name}\(.*\)", _translate_call),
        (
            r"(?:(?:global|(?P<local>local)) )?@{name}"
            r"(?P<index>(?:\[[^\[\]]*\]|\.\w++)*)=(?!=)(?P<value>.+)",
            _translate_assignment,
        ),
    ),
)
