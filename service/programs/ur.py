"""Programs of Universal Robots (URScript), translated."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from jointstiff.service.programs.interpreter import Dialect, Machine
from jointstiff.service.programs.language import (
    Assign,
    Copy,
    Flow,
    Havoc,
    Lexicon,
    Line,
    Local,
    Misread,
    Move,
    Name,
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

POSE: Final = Notation(Orientation.ROTATION_VECTOR, length=1, angle=1, length_decimals=7, angle_decimals=7)
JOINTS: Final = Notation(Orientation.JOINTS, length=1, angle=1, length_decimals=7, angle_decimals=7)
_MOTIONS: Final = {
    "movej": Motion.JOINT, "movel": Motion.LINEAR, "movep": Motion.LINEAR, "movec": Motion.CIRCULAR
}  # fmt: skip
# Facts. Source: Universal Robots, The URScript programming language 5.11.
# Routines that move the robot where no target in numbers says.
_MOVING: Final = re.compile(
    r"(?:servo|speed)[jlc]|\w*(?:force|freedrive|teach)_mode|tool_contact|optimove[jl]|\w*(?:conveyor|path_offset)\w*"
    r"|screw_driving|move_until_contact|position_deviation_warning|reset_revolution_counter|set_pos"
)
# Routines that tell a value, wait, show a text, or set payload, signals, registers and connections.
_QUIET: Final = (
    r"sleep|sync|textmsg|popup|halt|stop[jl]|zero_ftsensor|(?:enter|exit)_critical|random|force|is_(?:steady|within_safety_limits)"
    r"|set_(?:target_)?payload\w*|set_gravity|[sg]et_flag|set_watchdog|set_input_actions_to_default|set_baselight_mode"
    r"|set_safety_mode_transition_hardness|set_tool_(?:voltage|communication)"
    r"|[sg]et_\w*(?:digital|analog|euromap|runstate)_?\w*"
    r"|get_(?:inverse_kin|forward_kin|tcp_offset|tcp_force|tool_current|joint_t\w+|controller_temp|steptime"
    r"|freedrive_status|(?:actual|target)_(?:tcp|joint|payload|waypoint)\w*|conveyor_tick_count)"
    r"|(?:read|write)_(?:in|out)put_\w+|(?:read|write)_port_\w+|(?:modbus|socket|rtde)_\w+|rpc_factory"
    r"|pose_\w+|point_dist|interpolate_pose|rpy2rotvec|rotvec2rpy|wrench_trans|to_(?:str|num)|str_\w+|norm|normalize|length"
    r"|floor|ceil|sqrt|pow|log|a?(?:sin|cos|tan)|atan2|d2r|r2d|abs|\w*binary_list\w*|make_list"
)
_LEXICON: Final = Lexicon(
    comment=r"#[^\r\n]*+",
    folded=False,
    operators="and|or|xor|not|run",
    reserved=r"def|sec|thread|end|if|elif|else|while|for|switch|case|default|return|break|continue|pass|global|local|kill"
    r"|join|set_tcp|move[jlpc]",
    functions=_QUIET,
)
_REMEDY: Final = (
    "write p[x, y, z, rx, ry, rz] or [q1, ..., q6] in numbers, or a variable that is given such numbers once"
)
_MOTION: Final = re.compile(r"\bmove[jlpc]\b")
_WORD: Final = r"[^\W\d]\w*+"
_SIX: Final = r"\[\0(?:,\0){5}\]"
_LITERALS: Final = ((POSE, re.compile(rf"p{_SIX}")), (JOINTS, re.compile(_SIX)))
_STATEMENTS: Final = tuple(
    (kind, re.compile(pattern))
    for kind, pattern in (
        ("routine", rf"(?:def|sec|thread) ({_WORD})\((.*)\):"),
        ("any", "end"),
        ("if", "(?:if|switch) ?(.+):"),
        ("loop", "while ?(.+):"),
        ("turn", "(?:elif|case) ?(.+):|else:?"),
        ("default", "default:"),
        ("leave", "break|continue"),
        ("none", rf"pass|halt|(?:kill|join) {_WORD}"),
        ("return", "return ?(.*)"),
        ("tool", rf"set_tcp\((?:pose=)?(p{_SIX})(?:,.*)?\)"),
        ("move", r"(move[jlpc])\((.*)\)"),
        ("call", rf"({_WORD})\(.*\)"),
        ("assigned", rf"(?:(?:global|(local)) )?({_WORD})((?:\[[^\[\]]*\]|\.\w+)*)=(?!=)(.*)"),
    )
)


def _translate(line: Line) -> list[tuple[int, Op]]:
    """Return what a line does."""
    # PolyScope numbers its nodes: $ 3 "Waypoint_1"
    text = "" if re.fullmatch(r'\$ ?\0(?: ?"[^"]*")*', line.text) else line.text
    try:
        return complete(line, _MOTION, [(0, op) for op in (_ops(line) if text else ())], _REMEDY)
    except Misread as fault:
        return unknown(line, _MOTION, fault, _REMEDY)


def _ops(line: Line) -> list[Op]:
    for kind, pattern in _STATEMENTS:
        if match := pattern.fullmatch(line.text):
            return _statement(line, kind, match)
    word = re.match(_WORD, line.text)
    tool = "the tool is not given by numbers" if word and word[0] == "set_tcp" else ""
    raise Misread(
        tool or "the statement is unknown: it may move the robot, its targets or its tool",
        "write set_tcp(p[x, y, z, rx, ry, rz])" if tool else "",
    )


def _statement(line: Line, kind: str, match: re.Match[str]) -> list[Op]:
    if kind in _RULES:
        return _RULES[kind](line, match)
    given = [op for each in match.groups() if each for op in _LEXICON.expression(each)]
    if kind in {"none", "turn"}:
        return [] if kind == "none" else [Flow(kind), *attached(given)]
    return [*(attached(given) if kind == "loop" else given), Flow(kind)]


def _routine(_line: Line, match: re.Match[str]) -> list[Op]:
    names = frozenset(re.findall(rf"(?:^|,)({_WORD})", match[2]))
    own: list[Op] = [Local(names), Havoc(names, "a parameter of the routine", _REMEDY)] if names else []
    defaults = re.findall(r"=([^,]+(?:\([^()]*\))?)", match[2])
    given = [op for each in defaults for op in _LEXICON.expression(each)]
    return [*attached(given), Flow("routine" if match[0].startswith("def") else "aside", match[1]), *own]


def _called(_line: Line, match: re.Match[str]) -> list[Op]:
    name = match[1]
    if re.fullmatch(_LEXICON.reserved, name):
        raise Misread("the statement is unknown")
    reason, remedy = f"{name} moves the robot without a target", "use movej, movel, movep or movec"
    left = [Move(Motion.LINEAR, (), reason=reason, remedy=remedy)] if _MOVING.fullmatch(name) else []
    return [*_LEXICON.expression(match[0]), *left]


def _literal(line: Line, start: int, end: int) -> Literal | None:
    """Return p[...] or [...] in numbers; None if there is none."""
    for notation, pattern in _LITERALS:
        if pattern.fullmatch(line.text, start, end):
            first = line.text.count("\0", 0, start)
            return Literal(notation, line.ordinals[first : first + 6])
    return None


def _assigned(line: Line, match: re.Match[str]) -> list[Op]:
    name, index, value = match[2], match[3], match[4]
    if re.fullmatch(_LEXICON.reserved, name):
        raise Misread("the statement is unknown")
    own: list[Op] = [Local(frozenset({name}))] if match[1] else []
    literal = None if index else _literal(line, *match.span(4))
    if literal is not None:
        return [*own, Assign(name, literal)]
    found = _LEXICON.expression(index.strip("[]").replace("][", ","), empty=True) if "[" in index else []
    value = re.sub(r"\bp(?=\[)", "", value)
    return [
        *own,
        *found,
        *_LEXICON.expression(value),
        Havoc(frozenset({name}), f"{name} gets what is no number", _REMEDY),
    ]


def _move(line: Line, match: re.Match[str]) -> list[Op]:
    motion = _MOTIONS[match[1]]
    count = 1 + (motion is Motion.CIRCULAR)
    text = line.text[: match.end(2)]
    spans = list(parts(text, match.start(2)))
    found: list[Op] = []
    targets: list[Literal | Name] = []
    bases: list[Value] = []
    slots = ("pose_via", "pose_to") if count > 1 else ("pose|q",)
    for slot, (start, end) in zip(slots, spans, strict=False):
        named = re.compile(f"(?:{slot})=").match(text, start, end)
        try:
            target, base = _target(line, named.end() if named else start, end, found)
        except Misread as fault:
            uses = _LEXICON.expression(re.sub(r"\bp(?=\[)", "", match[2]))
            return [*uses, Move(motion, (), reason=fault.reason, remedy=_REMEDY)]
        targets.append(target)
        bases.append(base)
    if len(targets) < count:
        raise Misread("a target is not given by numbers")
    for start, end in spans[count:]:
        found += _LEXICON.expression(re.sub("^(?:a|v|t|r|mode)=", "", text[start:end]))
    if calls(found):
        raise Misread("the move calls a routine")
    plain = all(isinstance(each, Literal) for each in targets) and not any(
        isinstance(each, Literal) for each in bases
    )
    return [*found, Move(motion, tuple(targets), tuple(bases), (Copy("TCP"),) * count, repeats=plain)]


def _target(line: Line, start: int, end: int, found: list[Op]) -> tuple[Literal | Name, Value]:
    """Return a literal or a variable, and the frame that it is in; it may stand in get_inverse_kin."""
    text = line.text[start:end]
    head = re.match(r"(get_inverse_kin|pose_trans)\(", text)
    if head and text.endswith(")"):
        first, *more = list(parts(line.text[: end - 1], start + head.end()))
        if head[1] == "get_inverse_kin":
            if len(more) > 3 or "tcp=" in text:
                raise Misread("get_inverse_kin has a tool of its own")
            for each in more:  # angles near the answer, and tolerances
                found += _LEXICON.expression(line.text[slice(*each)].removeprefix("qnear="))
            return _target(line, *first, found)
        if len(more) == 1 and "(" not in text[head.end() :]:
            base, _ = _target(line, *first, found)
            target, _ = _target(line, *more[0], found)
            if isinstance(base, str):
                found.append(Use(frozenset({base})))
            return target, base if isinstance(base, Literal) else Copy(base)
    literal = _literal(line, start, end)
    if literal is None and not re.fullmatch(_WORD, text):
        raise Misread("a target is not given by numbers")
    return text if literal is None else literal, Copy("robot base")


_RULES: Final[Mapping[str, Callable[[Line, re.Match[str]], list[Op]]]] = {
    "move": _move,
    "assigned": _assigned,
    "routine": _routine,
    "call": _called,
    "tool": lambda line, _: [Assign("TCP", Literal(POSE, line.ordinals[:6]))],
}
DIALECT: Final = Dialect(
    _LEXICON,
    _translate,
    active={"TCP": "active TCP"},
    constants={"robot base": np.eye(4)},
    remedy=_REMEDY,
)


def read_ur(machine: Machine, sources: tuple[Source, ...]) -> None:
    """Read a script."""
    machine.add(0, sources[0].starts, sources[0].ends)
