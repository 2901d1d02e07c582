"""Programs of Universal Robots (URScript), translated."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterable, Iterator
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
_CALL_WITH_TARGET: Final = re.compile(
    r"(?P<function>get_inverse_kin|pose_trans)\((?P<arguments>.*)\)", re.DOTALL
)
_DEGREES: Final = r"d2r\(\0\)(?:,d2r\(\0\))"
_LITERALS: Final = (
    (POSE, re.compile(rf"p{_SIX}")),
    (JOINTS, re.compile(_SIX)),
    (JOINTS_IN_DEGREES, re.compile(rf"\[{_DEGREES}{{5}}\]")),
    (POSE_IN_DEGREES, re.compile(rf"p\[\0,\0,\0,{_DEGREES}{{2}}\]")),
)


def _translate_routine(line: Line) -> list[Op]:
    """Translate the head of a function, `def f(a, b=c):`, or of a thread, which may run at any time.

    The parameters a and b have unknown values. The default value c is used, and may be computed at each call.
    """
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

    A function such as `servoj`, which moves the robot without a target, becomes a move that is not corrected.
    If its effect lasts, as that of `force_mode`, no later move is corrected, until another function, such as
    `end_force_mode`, ends the effect.
    """
    name, operations = line["name"], line.read_expression()
    if _END_OF_LASTING.fullmatch(name):
        return [*_replace_call(name, operations), ir.end_lasting(_find_kind(name))]
    if _MOVES_WITHOUT_TARGET.fullmatch(name):
        return _move_without_target(name, _replace_call(name, operations))
    return operations


def _replace_call(name: str, operations: list[Op]) -> list[Op]:
    """Replace the calls of a function of the controller, such as `servoj`, among some operations.

    The one call in their place counts only if the program itself has a routine servoj. It gets no arguments:
    no function of the controller sets the tool.
    """
    others = [op for op in operations if not _is_call_of(name, op)]
    return [ir.call_if_defined(name), *others]


def _move_without_target(name: str, operations: list[Op]) -> list[Op]:
    """Return the operations of a function that moves the robot without a target, such as `servoj`.

    `operations` are those of the expressions in the call, which come first.
    """
    reason, remedy = f"{name} moves the robot without a target", "use movej, movel, movep or movec"
    if not _LASTING.fullmatch(name):
        return ir.make_uncorrected_move(operations, reason, remedy)
    lasting = ir.begin_lasting(_find_kind(name), reason, remedy)
    return ir.make_uncorrected_move([*operations, lasting], reason, remedy)


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
    """Translate an assignment, with the groups `local`, `name`, `index` (may be empty) and `value`.

    * `p1 = p[0.1,0,0.5,0,0,0]` or `v = 0.25`: the name gets a target, or a number;
    * `p2 = pose_add(p1, d)`: its value is unknown, but a pose at an offset from a target is noted;
    * `a[1] = b`: the value of the whole name is unknown, because single elements are not followed.

    With the word `local` before it, the name means another variable than outside of the routine.
    """
    name, index, value = line["name"], line["index"], line.part("value")
    declaration: list[Op] = [ir.Local(frozenset({name}))] if line["local"] else []
    is_whole_name = not index  # not an element such as `a[1]` or a field
    literal = _read_numbers(value)
    if is_whole_name and literal is not None:
        return [*declaration, ir.Assign(name, literal)]
    if is_whole_name:
        uses = _translate_computed_value(line, name)
    else:
        uses = [*_read_indices(line, index), *_read_value(line, value.text)]
    unknown = ir.MakeUnknown(frozenset({name}), f"{name} gets a value that is not a number", _REMEDY)
    return [*declaration, *uses, unknown]


def _read_numbers(value: Line) -> Literal | None:
    """Return the single number, pose or joint angles that a text states; None for any other text."""
    if value.is_number:  # pi, or a speed
        return Literal(_NUMBER, value.ordinals)
    return _read_literal(value)


def _read_indices(line: Line, index: str) -> list[Op]:
    """Return the uses of variables in the indices of an element, such as i and j of `[i][j]`."""
    if "[" not in index:  # a field
        return []
    indices = index.strip("[]").replace("][", ",")
    return line.read_expression(indices)


def _translate_computed_value(line: Line, name: str) -> list[Op]:
    """Translate the value of an assignment that is no number, such as `p2 = pose_add(p1, d)`.

    The pose p2 is at an offset from p1: this is noted, because a correction of p1 shifts moves to p2. In any
    other value, such as `x + 1`, the names are used.
    """
    expression = line["value"]
    offset = _OFFSET.fullmatch(expression)
    if offset is None:
        return _read_value(line, expression)
    return [ir.Offset(name, offset["target"]), *_read_value(line, offset["offset"])]


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
    arguments = line.part("arguments").split()
    try:
        targets = _read_targets(arguments, names_of_targets)
    except Misread as fault:
        uses = _read_value(line, line["arguments"])
        return ir.make_uncorrected_move(uses, fault.reason, _REMEDY, motion)
    if len(targets) < len(names_of_targets):
        raise Misread("a target is not given by numbers")
    settings = _name_settings(line["motion"], arguments[len(targets) :])
    uses = _list_uses(targets, settings)
    move = _make_move(motion, targets, _read_feed(settings))
    return [*uses, _provide_for_targets_as_bases(move)]


def _read_targets(arguments: list[Line], names: tuple[str, ...]) -> list[_Target]:
    """Read the targets of a move from its first arguments: one, or the two of an arc.

    The arguments behind the targets are settings such as `v=0.1`, and left out. If there are fewer arguments
    than targets, fewer targets are returned.

    Args:
        arguments: all arguments; one may have its name before it, as in `pose_to=p[...]`.
        names: pattern of the name of each target.

    Raises:
        Misread: a target is neither in numbers nor in a variable.
    """
    targets = list[_Target]()
    for argument, name in zip(arguments, names, strict=False):
        targets.append(_read_target(_remove_name(argument, name)))
    return targets


def _list_uses(targets: list[_Target], settings: list[_Setting]) -> list[Op]:
    """Return the uses of variables in the arguments of a move: its targets, and settings such as `v=speed`.

    Raises:
        Misread: the move calls a routine.
    """
    uses = list[Op]()
    for target in targets:
        uses += target.uses
    for setting in settings:
        uses += setting.value.read_expression()
    if ir.calls_routine(uses):
        raise Misread("the arguments of the move call a routine")
    return uses


def _make_move(motion: Motion, targets: list[_Target], feed: ir.Feed | None) -> ir.Move:
    """Return a move to targets with the active tool, each in the frame in which it is given."""
    points = tuple(target.point for target in targets)
    bases = tuple(target.base for target in targets)
    tools = (ir.Copy(_ACTIVE),) * len(targets)
    return ir.Move(motion, points, bases, tools, feed=feed)


def _provide_for_targets_as_bases(move: ir.Move) -> ir.Move:
    """Return a move that is not corrected if one of its bases proves to be a target of another move.

    `movel(pose_trans(a, b))` goes to the target b in the frame a, or to a place near the target a: only the
    whole program shows whether a is a frame or a target. So the move keeps its second meaning in
    `near_target`: a move that is not corrected, and that a correction of the target a shifts.
    """
    variables = _find_named_bases(move.bases)
    if not variables:
        return move
    near_target = ir.Move(
        move.motion,
        targets=(),
        bases=(_ROBOT_BASE,),
        tools=move.tools[:1],
        reason="the target is at an offset from another one",
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


class _Setting(NamedTuple):
    """Argument behind the targets of a move, such as `v=0.1`."""

    name: str
    value: Line


def _name_settings(motion: str, arguments: list[Line]) -> list[_Setting]:
    """Return the arguments behind the targets of a move, each with its name: a, v, t, r or mode.

    In `movel(p1, 1.2, v=0.1)`, 1.2 has the first place, which is that of a, and 0.1 has its name before it.
    There may be fewer arguments than places; what is behind the last place is no setting, and left out.
    """
    settings = list[_Setting]()
    for argument, name_of_place in zip(arguments, _ARGUMENTS[motion], strict=False):
        stated_name = re.match("(a|v|t|r|mode)=", argument.text)
        name = stated_name[1] if stated_name else name_of_place
        settings.append(_Setting(name, _remove_name(argument, name)))
    return settings


def _read_feed(settings: list[_Setting]) -> ir.Feed | None:
    """Return the feed of a move from its settings, such as `v=0.1` (speed [m/s]) and `t=3` (time [s]).

    * `v=0.1` or `v=speed`: the number, or the variable with this name;
    * `v=0.1, t=3`: the feed keeps the time as well, because a time that is not zero counts in place of the
      speed (URScript manual);
    * None: there is no `v`, or one of the two is computed.
    """
    value_of_setting = dict(settings)
    speed, time = value_of_setting.get("v"), value_of_setting.get("t")
    if speed is None or (time is not None and not time.is_number):
        return None
    ordinal_of_time = time.ordinals[0] if time is not None else None
    if speed.is_number:
        return ir.Feed(Literal(_NUMBER, speed.ordinals), _M_PER_S, time=ordinal_of_time)
    is_name = re.fullmatch(_WORD, speed.text) is not None
    return ir.Feed(ir.Copy(speed.text), _M_PER_S, time=ordinal_of_time) if is_name else None


def _find_named_bases(bases: Iterable[ir.Value | ir.Product]) -> tuple[ir.Name, ...]:
    """Return the names of bases that are variables."""
    return tuple(each.name for each in bases if isinstance(each, ir.Copy) and each != _ROBOT_BASE)


def _read_target(argument: Line) -> _Target:
    """Read the target that an argument of a move states, in numbers or as a variable.

    The target may be an argument of `get_inverse_kin(p1)` or of `pose_trans(frame1, p1)`, here p1.

    Raises:
        Misread: the target is not given by numbers or a variable.
    """
    if call := _CALL_WITH_TARGET.fullmatch(argument.text):
        return _read_target_in_call(call["function"], argument.cut(*call.span("arguments")))
    literal = _read_literal(argument)
    if literal is not None:
        return _Target(literal, _ROBOT_BASE, [])
    if not re.fullmatch(_WORD, argument.text):
        raise Misread("a target is not given by numbers")
    return _Target(argument.text, _ROBOT_BASE, [])


def _read_target_in_call(function: str, arguments: Line) -> _Target:
    """Read the target in the arguments of the function `get_inverse_kin` or `pose_trans`.

    Raises:
        Misread: the target is not given by numbers or a variable.
    """
    values = arguments.split()
    if function == "get_inverse_kin":
        return _read_inverse_kinematics(values)
    has_inner_call = "(" in arguments.text
    if len(values) != 2 or has_inner_call:
        raise Misread("a target is not given by numbers")
    frame, point = values
    return _read_target_in_frame(frame, point)


def _read_target_in_frame(frame: Line, point: Line) -> _Target:
    """Read the target of `pose_trans(frame1, p1)`: the point p1, given in the coordinates of frame1.

    Raises:
        Misread: frame or point is not given by numbers or a variable.
    """
    outer, inner = _read_target(frame), _read_target(point)
    base = outer.point if isinstance(outer.point, Literal) else ir.Copy(outer.point)
    return _Target(inner.point, base, [*outer.uses, *inner.uses])


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


_BRACKET_OR_LINE_END: Final = re.compile(
    r"\"[^\"\r\n]*+\"|#[^\r\n]*+|(?P<opening>[(\[{])|(?P<closing>[)\]}])|(?P<line_end>\r\n?+|\n)"
)
"""A bracket or the end of a line; those in texts and comments match without a group."""
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


class _OpenStatement:
    """Statement of one or more lines, while its brackets are counted."""

    def __init__(self, start: int) -> None:
        """Begin a statement with the line whose first character has the index `start`."""
        self._line_starts = [start]
        self._depth = 0  # count of open brackets

    def count_bracket(self, *, opens: bool) -> None:
        """Count a bracket, which opens or closes; one that closes nothing does not count."""
        self._depth = self._depth + 1 if opens else max(self._depth - 1, 0)

    def continues(self, text: str, end: int) -> bool:
        """Return whether the line that begins at index `end` of the text continues the statement.

        It does if a bracket is open, unless the line begins a statement or the statement becomes too long.
        """
        is_short = end - self._line_starts[0] <= _MAX_JOINED
        return self._depth > 0 and is_short and not _BEGINS_STATEMENT.match(text, end)

    def add_line(self, start: int) -> None:
        """Add a line that continues the statement."""
        self._line_starts.append(start)

    def list_spans(self, end: int) -> list[tuple[int, int]]:
        """Return the first and the last + 1 character of the statement, which ends at index `end`.

        If a bracket is still open, each line has a span of its own: then only the line with the open bracket
        is not understood.
        """
        is_closed = self._depth == 0
        if is_closed:
            return [(self._line_starts[0], end)]
        return [*pairwise([*self._line_starts, end])]


def _group_lines(text: str) -> Iterator[list[tuple[int, int]]]:
    """Yield the spans of statements, each the first and the last + 1 character: one statement at a time.

    A statement is a line, or several lines within open brackets, such as `movej([0, 1, 2,` and `3, 4, 5])`.
    """
    statement = _OpenStatement(0)
    for match in _BRACKET_OR_LINE_END.finditer(text):
        if match["opening"] or match["closing"]:
            statement.count_bracket(opens=match["opening"] is not None)
        elif match["line_end"]:
            end = match.end()
            if statement.continues(text, end):
                statement.add_line(end)
            else:
                yield statement.list_spans(end)
                statement = _OpenStatement(end)
    yield statement.list_spans(len(text))


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
