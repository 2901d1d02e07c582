"""Programs of Universal Robots (URScript): moves to literal poses p[...] and joints [...]."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import FrameName, Motion, Program, Source
from jointstiff.service.programs.reader import (
    NO_TARGET,
    NUMBER,
    NUMBER_PATTERN,
    Reader,
    without_comment,
    words,
)
from jointstiff.solver.arrays import FloatArray

POSE: Final = Notation(Orientation.ROTATION_VECTOR, length=1, angle=1, length_decimals=7, angle_decimals=7)
JOINTS: Final = Notation(Orientation.JOINTS, length=1, angle=1, length_decimals=7, angle_decimals=7)
_ROW: Final = rf"\[\s*{NUMBER}(?:\s*,\s*{NUMBER}){{5}}\s*\]"
_LITERAL: Final = re.compile(rf"(p?)({_ROW})\s*")
_NAME: Final = re.compile(r"[A-Za-z_]\w*")
_ASSIGNED: Final = re.compile(r"(?:(?:global|local)\s+)?([A-Za-z_]\w*)\s*=(?!=)\s*(.*)$")
_CALL: Final = re.compile(r"([A-Za-z_]\w*)\s*\((.*)$")
_CALLED: Final = re.compile(r"\b([A-Za-z_]\w*)\s*\(")
_BLOCK: Final = re.compile(
    r"(?:if|elif|else|while|for|switch|case|default|return|break|continue|end|halt|pass)\b"
)
_OPENED: Final = re.compile(r"(?:def|sec|thread|if|while|for|switch)\b")
_CLOSED: Final = re.compile(r"end\b")
_MOVES: Final = {
    "movej": (Motion.JOINT, 1),
    "movel": (Motion.LINEAR, 1),
    "movep": (Motion.LINEAR, 1),
    "movec": (Motion.CIRCULAR, 2),
}
_STILL: Final = words(
    """
    sleep sync textmsg popup halt set_payload set_payload_mass set_payload_cog set_target_payload
    set_gravity get_inverse_kin set_digital_out set_analog_out set_standard_digital_out
    set_standard_analog_out set_tool_digital_out set_tool_analog_out set_configurable_digital_out
    set_tool_voltage set_flag get_flag get_digital_in get_standard_digital_in get_analog_in
    get_configurable_digital_in get_tool_digital_in set_standard_analog_input_domain
    set_tool_communication set_analog_outputdomain set_input_actions_to_default set_runstate_outputs
    stopl stopj get_actual_tcp_pose get_actual_joint_positions get_target_tcp_pose to_str str_cat
    norm abs floor ceil sqrt sin cos tan asin acos atan d2r r2d write_output_boolean_register
    write_output_integer_register write_output_float_register read_input_boolean_register
    read_input_integer_register read_input_float_register enter_critical exit_critical
    modbus_set_output_signal modbus_set_output_register rpc_factory socket_open socket_close
    socket_send_string not and or if while elif return set_analog_inputrange
    set_tool_analog_input_domain set_tool_output_mode set_tool_digital_output_mode set_watchdog zero_ftsensor
    set_configurable_digital_input_action set_standard_digital_input_action
    set_tool_digital_input_action set_safety_mode_transition_hardness set_baselight_mode
    """
)
"""Routines that neither move the robot nor change its frames."""
_MOVING: Final = words(
    """
    servoj servoc servol speedj speedl force_mode freedrive_mode teach_mode tool_contact optimovej
    optimovel track_conveyor_linear track_conveyor_circular path_offset_enable path_offset_set
    path_offset_set_raw set_conveyor_tick_count screw_driving move_until_contact
    """
)
"""Routines that move it where no target in numbers says."""
_LABEL: Final = re.compile(r"\$\s*\d+\s+\"")


@dataclass(frozen=True)
class _Literal:
    """A pose p[...] or joints [...] in the text: notation, spans, line."""

    notation: Notation
    numbers: tuple[tuple[int, int], ...]
    line: int


@dataclass
class _Script:
    """The state of a script while it is read: frames and the variables that hold literals."""

    reader: Reader
    tool: FrameName
    literals: dict[str, _Literal]
    changed: set[str]
    routines: frozenset[str]
    frames: dict[str, _Literal] = field(default_factory=dict)
    poses: dict[int, FloatArray] = field(default_factory=dict)
    unsteady: set[str] = field(default_factory=set)
    depth: int = 0
    moved: bool = False

    def statement(self, line: int, start: int, text: str) -> None:
        """Read one line without its comment."""
        body = text.strip()
        offset = start + len(text) - len(text.lstrip())
        if not body or _LABEL.match(body):  # PolyScope numbers its nodes: $ 3 "Waypoint_1"
            return
        self.depth += bool(_OPENED.match(body)) - bool(_CLOSED.match(body))
        if body.startswith(("def ", "sec ", "thread ")):
            return
        if assigned := _ASSIGNED.match(body):
            self._assigned(line, assigned, offset)
            return
        if (called := _CALL.match(body)) and called[1] in _MOVES:
            self._move(line, called[1], called[2], offset + called.start(2))
        elif called and called[1] == "set_tcp":
            self._tool(line, called[2], offset + called.start(2))
        elif called or _BLOCK.match(body):
            self._calls(line, body)
        else:
            self.reader.refuse(line, "the statement is not known", NO_TARGET)

    def _calls(self, line: int, body: str) -> None:
        for name in _CALLED.findall(re.sub(r'"[^"]*"', '""', body)):
            if name in _MOVES or name == "set_tcp":
                self.reader.refuse(
                    line, f"{name} stands inside another statement", "give it a line of its own"
                )
            elif name in _MOVING and name.upper() not in self.reader.allowed:
                self.reader.refuse(
                    line, f"{name} moves the robot where no target says", "use movej, movel, movep or movec"
                )
            elif name not in _STILL and name not in self.routines:
                self.reader.call(line, name)

    def _assigned(self, line: int, assigned: re.Match[str], offset: int) -> None:
        name, value = assigned[1], assigned[2]
        literal = self._literal(line, value, offset + assigned.start(2))
        whole = literal is not None and literal[1].strip() == ""
        self.frames.pop(name, None)
        if literal and whole and literal[0].notation is POSE and name not in self.unsteady:
            self.frames[name] = literal[0]
        if literal and whole and name not in self.literals:
            self.literals[name] = literal[0]
            return
        self.changed.add(name)
        self._calls(line, value)

    def _literal(self, line: int, text: str, offset: int) -> tuple[_Literal, str] | None:
        """Read a literal at the begin of the text; return it and what follows."""
        match = _LITERAL.match(text)
        if not match:
            return None
        spans = tuple(
            (offset + m.start(), offset + m.end())
            for m in NUMBER_PATTERN.finditer(text, match.start(2), match.end(2))
        )
        return _Literal(POSE if match[1] else JOINTS, spans, line), text[match.end() :]

    def _tool(self, line: int, text: str, offset: int) -> None:
        literal = self._literal(line, text, offset)
        if self.depth > 1:
            self.reader.refuse(
                line, "the tool changes in a branch or a loop", "set it once, before the moves"
            )
            return
        if len(self.routines) > 1 and self.moved:
            self.reader.refuse(line, "the tool changes between routines", "set it once, before all moves")
            return
        if literal is None or literal[0].notation is not POSE:
            self.reader.refuse(
                line, "the tool is not given by numbers", "write set_tcp(p[x, y, z, rx, ry, rz])"
            )
            return
        self.tool = FrameName("set_tcp", self._pose(literal[0]))

    def _pose(self, literal: _Literal) -> FloatArray:
        text = self.reader.sources[0].text
        return POSE.pose([float(text[a:b]) for a, b in literal.numbers])

    def _move(self, line: int, name: str, text: str, offset: int) -> None:
        motion, count = _MOVES[name]
        self.moved = True
        targets = []
        for _ in range(count):
            read = self._target(line, text, offset)
            if read is None:
                self.reader.refuse(line, f"a target of {name} is not given by numbers", _REMEDY)
                return
            target, rest = read
            targets.append(target)
            following = rest.lstrip().removeprefix(",")
            offset += len(text) - len(following)
            text = following
        self.reader.move(line, motion, targets)

    def _target(self, line: int, text: str, offset: int) -> tuple[int | None, str] | None:
        """Read a target at the begin of the text: a literal, a variable, or either in a frame."""
        stripped = text.lstrip()
        offset += len(text) - len(stripped)
        for wrapper in ("get_inverse_kin", "pose_trans"):
            if inner := re.match(rf"{wrapper}\s*\(", stripped):
                return self._wrapped(wrapper, line, stripped[inner.end() :], offset + inner.end())
        return self._plain(line, stripped, offset, FrameName("robot base", np.eye(4)))

    def _wrapped(self, wrapper: str, line: int, text: str, offset: int) -> tuple[int | None, str] | None:
        base = FrameName("robot base", np.eye(4))
        if wrapper == "pose_trans":
            frame = _NAME.match(text)
            if not frame or frame[0] not in self.frames:
                return None
            literal = self.frames[frame[0]]
            place = literal.numbers[0][0]
            if place not in self.poses:
                self.poses[place] = self._pose(literal)
            base = FrameName(frame[0], self.poses[place])
            comma = re.match(r"\s*,\s*", text[frame.end() :])
            if not comma:
                return None
            skip = frame.end() + comma.end()
            text, offset = text[skip:], offset + skip
        read = self._plain(line, text, offset, base)
        if read is None:
            return None
        target, rest = read
        closing = re.match(rf"\s*(?:,\s*(?:qnear\s*=\s*)?(?:\w+|{_ROW}))?\s*\)", rest)
        return (target, rest[closing.end() :]) if closing else None

    def _plain(self, line: int, text: str, offset: int, base: FrameName) -> tuple[int | None, str] | None:
        literal = self._literal(line, text, offset)
        name = ""
        if literal is None:
            variable = _NAME.match(text)
            if not variable or variable[0] not in self.literals or variable[0] in self.changed:
                return None
            name = variable[0]
            literal = self.literals[name], text[variable.end() :]
        found, rest = literal
        if not re.match(r"\s*[,)]", rest):
            return None
        frames = (base, self.tool)
        return self.reader.target(name, (0, found.line), found.notation, found.numbers, frames), rest


_REMEDY: Final = (
    "write p[x, y, z, rx, ry, rz] or [q1, ..., q6] in numbers, or a variable that is given such numbers once"
)


def read_ur(sources: tuple[Source, ...], allowed: Collection[str]) -> Program:
    """Read a script.

    Raises:
        ProgramError: part of it is not understood.
    """
    reader = Reader("ur", sources, allowed)
    routines = frozenset(re.findall(r"^[ \t]*(?:def|sec|thread)[ \t]+(\w+)", sources[0].text, re.MULTILINE))
    names = re.findall(
        r"^[ \t]*(?:global[ \t]+|local[ \t]+)?(\w+)[ \t]*=(?!=)", sources[0].text, re.MULTILINE
    )
    repeated = {name for name, times in Counter(names).items() if times > 1}
    heads = re.findall(r"^[ \t]*def[ \t]+\w+[ \t]*\(([^)\n]*)\)", sources[0].text, re.MULTILINE)
    parameters = frozenset(name for head in heads for name in _NAME.findall(head))
    repeated |= parameters
    several = frozenset(repeated) if len(routines) > 1 else frozenset()
    unsteady = set(several | parameters | _in_branches(sources[0]) & repeated)
    script = _Script(reader, FrameName("active TCP"), {}, repeated, routines, unsteady=unsteady)
    for line, start, text in sources[0].lines():
        script.statement(line, start, without_comment(text, "#"))
    return reader.program()


def _in_branches(source: Source) -> frozenset[str]:
    """Return the variables that are assigned in a branch or a loop."""
    depth, found = 0, set()
    for _, _, text in source.lines():
        body = without_comment(text, "#").strip()
        depth += bool(_OPENED.match(body)) - bool(_CLOSED.match(body))
        if depth > 1 and (assigned := _ASSIGNED.match(body)):
            found.add(assigned[1])
    return frozenset(found)
