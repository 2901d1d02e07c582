"""Programs of Universal Robots (URScript), translated."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from robotprograms import language as ir
from robotprograms.language import Line, Misread, Op
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
_NUMBERS_OF_POSE: Final = 6
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
    pose = line.part("pose")
    expressions = tuple(each.text for each in pose.split())
    if len(expressions) != _NUMBERS_OF_POSE:
        return _refuse_unknown_tool(line)
    tool = ir.Stated(_ACTIVE, POSE, expressions, pose.ordinals)
    return [ir.Assign(_ACTIVE, tool)]


def _refuse_unknown_tool(_line: Line) -> list[Op]:
    """Refuse `set_tcp` with an argument that is not a pose in numbers.

    Raises:
        Misread: always.
    """
    raise Misread("the tool is not given by numbers", "write set_tcp(p[x, y, z, rx, ry, rz])")


def _translate_call(line: Line) -> list[Op]:
    """Translate a call of a routine, which may be a function of the controller.

    A function that moves the robot without a target becomes a move that is not corrected. If its effect
    lasts, as that of `force_mode`, no later move is corrected, until another function ends the effect.
    """
    name = line["name"]
    operations = line.read_expression()
    moves_robot = _MOVES_WITHOUT_TARGET.fullmatch(name) is not None
    ends_effect = _END_OF_LASTING.fullmatch(name) is not None
    if not (moves_robot or ends_effect):
        return operations
    ops: list[Op] = [ir.call_if_defined(name)]  # no function of the controller sets the tool
    ops += [op for op in operations if not _is_call_of(name, op)]
    if ends_effect:
        return [*ops, ir.end_lasting(_find_kind(name))]
    reason, remedy = f"{name} moves the robot without a target", "use movej, movel, movep or movec"
    if _LASTING.fullmatch(name):
        ops.append(ir.begin_lasting(_find_kind(name), reason, remedy))
    return ir.make_uncorrected_move(ops, reason, remedy)


def _find_kind(name: str) -> str:
    """Return the kind of a routine's lasting effect, such as `force_mode`; else the routine's name."""
    kind = _KINDS.search(name)
    return kind[0] if kind else name


def _is_call_of(name: str, op: Op) -> bool:
    """Return whether an operation calls a routine."""
    return isinstance(op, ir.Call) and op.name == name


def _read_literal(part: Line) -> Literal | None:
    """Return the pose `p[...]` or the joint angles `[...]` that a text states; None for any other text."""
    for notation, pattern in _LITERALS:
        if pattern.fullmatch(part.text):
            return Literal(notation, part.ordinals)
    return None


def _read_value(line: Line, text: str) -> list[Op]:
    """Return the operations of an expression; the `p` of poses such as `p[x, ...]` is not a name."""
    return line.read_expression(re.sub(r"\bp(?=\[)", "", text))


def _translate_assignment(line: Line) -> list[Op]:
    """Translate an assignment: a name gets a target in numbers, one number or an unknown value."""
    name, index, value = line["name"], line["index"], line.part("value")
    ops: list[Op] = [ir.Local(frozenset({name}))] if line["local"] else []
    is_whole_name = not index  # not an element such as `a[1]` or a field
    literal = _read_literal(value)
    if value.is_number:  # pi, or a speed
        literal = Literal(_NUMBER, value.ordinals)
    if is_whole_name and literal is not None:
        return [*ops, ir.Assign(name, literal)]
    if "[" in index:
        indices = index.strip("[]").replace("][", ",")
        ops += line.read_expression(indices)
    expression = value.text
    offset = _OFFSET.fullmatch(expression) if is_whole_name else None  # such as pose_add(target, offset)
    if offset:
        ops.append(ir.Offset(name, offset["target"]))
        expression = offset["offset"]
    unknown = ir.MakeUnknown(frozenset({name}), f"{name} gets a value that is not a number", _REMEDY)
    return [*ops, *_read_value(line, expression), unknown]


class _Target(NamedTuple):
    """Target of a move, as an argument states it."""

    point: Literal | ir.Name  # its numbers, or the variable that has them
    base: ir.Value  # frame in which the target is given
    uses: list[Op]  # operations of the other expressions in the argument


def _translate_move(line: Line) -> list[Op]:
    """Translate a move, such as `movel(p[...], a=1.2, v=0.1)`.

    The move is not corrected if a target is neither in numbers nor in a variable.

    Raises:
        Misread: a target is missing, or the move calls a routine.
    """
    motion = _MOTIONS[line["motion"]]
    names_of_targets = ("pose_via", "pose_to") if motion is Motion.CIRCULAR else ("pose|q",)
    count = len(names_of_targets)
    arguments = line.part("arguments").split()
    try:
        targets = [
            _read_target(_remove_name(argument, name))
            for argument, name in zip(arguments, names_of_targets, strict=False)
        ]
    except Misread as fault:
        uses = _read_value(line, line["arguments"])
        return ir.make_uncorrected_move(uses, fault.reason, _REMEDY, motion)
    if len(targets) < count:
        raise Misread("a target is not given by numbers")
    settings = _name_arguments(line["motion"], arguments[count:])
    uses = [op for target in targets for op in target.uses]
    for _, value in settings:
        uses += value.read_expression()
    if ir.calls_routine(uses):
        raise Misread("the arguments of the move call a routine")
    points = tuple(target.point for target in targets)
    bases = tuple(target.base for target in targets)
    tools = (ir.Copy(_ACTIVE),) * count
    move = ir.Move(motion, points, bases, tools, feed=_read_feed(dict(settings)))
    return [*uses, _provide_for_targets_as_bases(move)]


def _provide_for_targets_as_bases(move: ir.Move) -> ir.Move:
    """Return a move that is not corrected if one of its bases proves to be a target of another move.

    `pose_trans(a, b)` is the target b in the frame a, or a place near the target a: only the whole program
    shows whether a is a frame or a target. Near a target, the move shifts with the target's correction.
    """
    variables = _find_named_bases(move.bases)
    if not variables:
        return move
    reason = "the target is at an offset from another one"
    near_target = ir.Move(
        move.motion,
        (),
        (_ROBOT_BASE,),
        move.tools[:1],
        reason=reason,
        remedy=_REMEDY,
        offset_from=variables,
    )
    return move._replace(near_target=near_target)


def _remove_name(argument: Line, name: str) -> Line:
    """Return the value of an argument, which may be stated with its name, as in `v=0.1`.

    `name` is a pattern of the name.
    """
    prefix = re.match(f"(?:{name})=", argument.text)
    return argument.cut(prefix.end()) if prefix else argument


def _name_arguments(motion: str, arguments: list[Line]) -> list[tuple[str, Line]]:
    """Return name and value of each argument behind the targets of a move.

    An argument has its name before it, as in `v=0.1`, or the name that belongs to its place.
    """
    named = list[tuple[str, Line]]()
    for argument, name_of_place in zip(arguments, _ARGUMENTS[motion], strict=False):
        stated_name = re.match("(a|v|t|r|mode)=", argument.text)
        name = stated_name[1] if stated_name else name_of_place
        named.append((name, _remove_name(argument, name)))
    return named


def _read_feed(arguments: Mapping[str, Line]) -> ir.Feed | None:
    """Return the feed of a move; None if it states none in numbers or by a name.

    `arguments` are the values of the arguments, by their names: `v` is the speed [m/s], `t` the time of the
    move. URScript manual: a time that is not zero counts in place of the speed.
    """
    speed, time = arguments.get("v"), arguments.get("t")
    if speed is None:
        return None
    ordinal_of_time = None
    if time is not None:
        if not time.is_number:
            return None
        (ordinal_of_time,) = time.ordinals
    if speed.is_number:
        return ir.Feed(Literal(_NUMBER, speed.ordinals), _M_PER_S, time=ordinal_of_time)
    is_name = re.fullmatch(_WORD, speed.text) is not None
    return ir.Feed(ir.Copy(speed.text), _M_PER_S, time=ordinal_of_time) if is_name else None


def _find_named_bases(bases: Iterable[ir.Value | ir.Product]) -> tuple[ir.Name, ...]:
    """Return the names of bases that are variables."""
    return tuple(each.name for each in bases if isinstance(each, ir.Copy) and each != _ROBOT_BASE)


def _read_target(argument: Line) -> _Target:
    """Read the target that an argument of a move states, in numbers or as a variable.

    The target may be an argument of `get_inverse_kin` or `pose_trans`.

    Raises:
        Misread: the target is not given by numbers or a variable.
    """
    text = argument.text
    call = re.match(r"(?P<function>get_inverse_kin|pose_trans)\(", text)
    if call and text.endswith(")"):
        arguments = argument.cut(call.end(), len(text) - 1).split()
        if call["function"] == "get_inverse_kin":
            return _read_inverse_kinematics(arguments)
        has_inner_call = "(" in text[call.end() :]
        if len(arguments) == 2 and not has_inner_call:
            outer, inner = map(_read_target, arguments)
            base = outer.point if isinstance(outer.point, Literal) else ir.Copy(outer.point)
            return _Target(inner.point, base, [*outer.uses, *inner.uses])
    if (literal := _read_literal(argument)) is not None:
        return _Target(literal, _ROBOT_BASE, [])
    if not re.fullmatch(_WORD, text):
        raise Misread("a target is not given by numbers")
    return _Target(text, _ROBOT_BASE, [])


def _read_inverse_kinematics(arguments: list[Line]) -> _Target:
    """Read the target that is the first argument of `get_inverse_kin(pose, qnear, tolerances)`.

    Raises:
        Misread: the target is not given by numbers or a variable, or an argument is a tool.
    """
    pose, *others = arguments
    states_tool = len(others) > 3 or any("tcp=" in each.text for each in arguments)
    if states_tool:  # the tool is the fifth argument
        raise Misread("the call of get_inverse_kin states a tool")
    uses = list[Op]()
    for angles_or_tolerance in others:
        uses += angles_or_tolerance.read_expression(angles_or_tolerance.text.removeprefix("qnear="))
    target = _read_target(pose)
    return target._replace(uses=[*uses, *target.uses])


_BRACKET_OR_LINE_END: Final = re.compile(r"\"[^\"\r\n]*+\"|#[^\r\n]*+|([(\[{])|([)\]}])|(\r\n?+|\n)")
_BEGINS_STATEMENT: Final = re.compile(rf"[ \t]*+(?:{_RESERVED})(?!\w)")
_MAX_JOINED: Final = 8192
"""Largest number of characters of lines that an open bracket joins."""


def read_urscript(statements: Statements, sources: tuple[Source, ...]) -> None:
    """Add the statements of a program: lines, which are joined while a bracket is open."""
    starts, ends = array("q"), array("q")
    for lines in _group_lines(sources[0].text):
        starts.extend(start for start, _ in lines)
        ends.extend(end for _, end in lines)
    statements.add_statements(
        0, np.asarray(memoryview(starts), dtype=np.intp), np.asarray(memoryview(ends), dtype=np.intp)
    )


def _group_lines(text: str) -> Iterator[list[tuple[int, int]]]:
    """Yield the spans of statements, each the first and the last + 1 character: one statement at a time.

    A statement has one span, of a line or of several lines within open brackets. Where a word begins a
    statement before the bracket is closed, or the text is too long, each line has a span of its own: then
    only the line with the open bracket is not understood.
    """
    line_starts = [0]  # of the lines of the present statement
    depth = 0  # count of its open brackets
    for match in _BRACKET_OR_LINE_END.finditer(text):
        opening, closing, line_end = match[1], match[2], match[3]
        if opening:
            depth += 1
        elif closing:
            depth = max(depth - 1, 0)
        elif line_end:
            end = match.end()
            is_short = end - line_starts[0] <= _MAX_JOINED
            goes_on = depth > 0 and is_short and not _BEGINS_STATEMENT.match(text, end)
            if goes_on:
                line_starts.append(end)
            else:
                yield _find_spans(line_starts, end, is_closed=depth == 0)
                line_starts, depth = [end], 0
    yield _find_spans(line_starts, len(text), is_closed=depth == 0)


def _find_spans(line_starts: list[int], end: int, *, is_closed: bool) -> list[tuple[int, int]]:
    """Return the span of all lines of a statement; or of each of them if a bracket is not closed."""
    if is_closed:
        return [(line_starts[0], end)]
    return [*pairwise([*line_starts, end])]


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
            lambda line: [ir.Assign(_ACTIVE, Literal(POSE, line.ordinals[:_NUMBERS_OF_POSE]))],
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
