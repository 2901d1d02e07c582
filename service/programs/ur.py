"""Programs of Universal Robots (URScript): the statements that are understood."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np

from jointstiff.service.programs.forms import Forms
from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import FrameName, Literal, Motion
from jointstiff.service.programs.reader import Place, Reader, Script, Statement, pose_of, words
from jointstiff.service.programs.scanner import Cursor, Lexicon, Misread, Used

POSE: Final = Notation(Orientation.ROTATION_VECTOR, length=1, angle=1, length_decimals=7, angle_decimals=7)
JOINTS: Final = Notation(Orientation.JOINTS, length=1, angle=1, length_decimals=7, angle_decimals=7)
_MOVES: Final = {
    "movej": (Motion.JOINT, 1),
    "movel": (Motion.LINEAR, 1),
    "movep": (Motion.LINEAR, 1),
    "movec": (Motion.CIRCULAR, 2),
}
_ARGUMENTS: Final = words("a v t r mode")
_MOVING: Final = words(
    """
    servoj servoc servol speedj speedl force_mode freedrive_mode end_freedrive_mode teach_mode
    end_teach_mode tool_contact optimovej optimovel track_conveyor_linear track_conveyor_circular
    stop_conveyor_tracking path_offset_enable path_offset_set path_offset_set_raw path_offset_disable
    set_conveyor_tick_count screw_driving move_until_contact position_deviation_warning
    reset_revolution_counter set_pos
    """
)
"""Routines that move the robot where no target in numbers says."""
_STILL: Final = words(
    """
    sleep sync textmsg popup halt set_payload set_payload_mass set_payload_cog set_target_payload
    set_gravity set_digital_out set_analog_out set_standard_digital_out set_standard_analog_out
    set_tool_digital_out set_tool_analog_out set_configurable_digital_out set_tool_voltage set_flag get_flag
    set_standard_analog_input_domain set_tool_communication set_analog_outputdomain
    set_input_actions_to_default set_runstate_outputs set_runstate_standard_digital_output_to_value
    set_runstate_tool_digital_output_to_value stopl stopj write_output_boolean_register
    write_output_integer_register write_output_float_register enter_critical exit_critical
    modbus_set_output_signal modbus_set_output_register modbus_add_signal modbus_delete_signal
    modbus_set_runstate_dependent_choice socket_open socket_close socket_send_string socket_send_line
    socket_send_int socket_send_byte set_analog_inputrange set_tool_analog_input_domain set_tool_output_mode
    set_tool_digital_output_mode set_watchdog zero_ftsensor set_configurable_digital_input_action
    set_standard_digital_input_action set_tool_digital_input_action set_safety_mode_transition_hardness
    set_baselight_mode write_port_bit write_port_register rtde_set_watchdog
    """
)
"""Routines that neither move the robot nor change its frames."""
_FUNCTIONS: Final = _STILL | words(
    """
    get_inverse_kin get_forward_kin get_digital_in get_digital_out get_standard_digital_in
    get_standard_digital_out get_standard_analog_in get_standard_analog_out get_analog_in get_analog_out
    get_configurable_digital_in get_configurable_digital_out get_tool_digital_in get_tool_digital_out
    get_tool_analog_in get_tool_current get_actual_tcp_pose get_actual_joint_positions get_target_tcp_pose
    get_target_joint_positions get_actual_tcp_speed get_actual_joint_speeds get_target_joint_speeds
    get_target_tcp_speed get_tcp_force get_joint_torques get_joint_temp get_tcp_offset get_target_payload
    get_target_payload_cog get_controller_temp get_steptime get_target_waypoint get_conveyor_tick_count
    get_freedrive_status get_euromap_input get_euromap_output force is_steady is_within_safety_limits
    pose_trans pose_add pose_sub pose_inv pose_dist point_dist interpolate_pose rpy2rotvec rotvec2rpy
    wrench_trans to_str to_num str_cat str_at str_find str_len str_sub str_empty norm normalize length floor
    ceil sqrt pow log sin cos tan asin acos atan atan2 d2r r2d random abs binary_list_to_integer
    integer_to_binary_list read_output_boolean_register read_output_integer_register
    read_output_float_register read_input_boolean_register read_input_integer_register
    read_input_float_register read_port_bit read_port_register modbus_get_signal_status
    modbus_get_signal_error rpc_factory socket_get_var socket_read_ascii_float socket_read_string
    socket_read_line socket_read_binary_integer socket_read_byte_list make_list
    """
)
"""Routines that a value may be taken from."""
_LEXICON: Final = Lexicon(
    comment=r"#[^\r\n]*+",
    signs="==|!=|<=|>=",
    folded=False,
    operators=words(". == != < > <= >= % and or xor not"),
    prefixes=words("+ - not"),
    functions=_FUNCTIONS,
    reserved=words(
        """
        def sec thread end if elif else while for switch case default return break continue halt pass global
        local run kill join set_tcp
        """
    )
    | frozenset(_MOVES)
    | _MOVING,
)
_REMEDY: Final = (
    "write p[x, y, z, rx, ry, rz] or [q1, ..., q6] in numbers, or a variable that is given such numbers once"
)
_TOOL_REMEDY: Final = "write set_tcp(p[x, y, z, rx, ry, rz])"
_WORLD: Final = FrameName("robot base", np.eye(4))


@dataclass(frozen=True, slots=True)
class _Target:
    """A target of a move: numbers or the name of some, in a frame."""

    numbers: Literal | str
    frame: Literal | str = ""  # frame that pose_trans takes them in; empty for the robot's base


@dataclass
class _Script(Script):
    """The state of a script while it is read."""

    tool: FrameName = field(default_factory=lambda: FrameName("active TCP"))
    frames: dict[str, FrameName] = field(default_factory=dict)  # poses that variables have by now

    def frame(self, place: Place, frame: Literal | str) -> FrameName | None:
        """Return a frame of targets; None if it is not known."""
        if isinstance(frame, Literal):
            pose = pose_of(place, frame)
            return None if pose is None else FrameName(f"frame of line {place.line}", pose)
        return None if frame in self.left else self.frames.get(frame) if frame else _WORLD

    def assigned(self, place: Place, name: str, literal: Literal | None) -> None:
        """Take a pose that a variable gets: a frame, where the program's way does not decide of it."""
        pose = pose_of(place, literal)
        several = self.jumps or self.calls or len(self.routines) > 1
        steady = name not in self.changed or not (several or name in self.branched | self.parameters)
        if pose is None or not steady:
            self.frames.pop(name, None)
            self.lost.add(name)
        elif name not in self.lost:
            self.frames[name] = FrameName(name, pose)

    lost: set[str] = field(default_factory=set)  # variables that once had no pose in numbers

    def threaded(self, _: Place) -> None:
        """Begin a thread, which runs beside the program."""
        self.thread = self.depth + 1

    def ended(self, _: Place) -> None:
        """End a block."""
        self.thread = self.thread if self.depth >= self.thread else 0

    thread: int = 0  # depth of blocks in the thread that is open; 0 outside of threads

    def set_tool(self, place: Place, literal: Literal) -> None:
        """Take set_tcp."""
        pose = pose_of(place, literal)
        if pose is None:
            self.refuse(place, "the tool is not given by numbers", _TOOL_REMEDY)
            return
        tool = FrameName("set_tcp", pose)
        if self.thread:
            self.refuse(place, "a thread changes the tool", "set it in the program")
        elif self.tool.same(tool) or self.settable(place, "the tool"):
            self.tool = tool

    def move(self, place: Place, motion: Motion, targets: Sequence[_Target]) -> None:
        """Take a move."""
        if self.thread:
            self.refuse(
                place, "a thread moves the robot in parallel with the program", "move it in the program"
            )
            return
        bases = [self.frame(place, target.frame) for target in targets]
        frames = [(base, self.tool) for base in bases if base is not None]
        if len(frames) < len(targets):
            self.moved = True
            self.refuse(place, "the frame of a target is not given by constant numbers")
        else:
            self.targeted(place, motion, [target.numbers for target in targets], frames)


def _parse(c: Cursor) -> Iterator[Statement]:
    """Parse the statements of a line."""
    if c.accept("$"):  # PolyScope numbers its nodes: $ 3 "Waypoint_1"
        c.number()
        while c.peek().kind == "text":
            c.take()
        c.finish()
    while not c.ended:
        yield _statement(c)


def _statement(c: Cursor) -> Statement:
    if c.peek().text in _FORMS and not (c.at("halt") and c.peek(1).text == "("):
        return _FORMS.take(c)
    scope = c.accept("global", "local")
    name = c.name() if scope else c.word()
    if scope:
        return _assigned(c, name)
    if name in _RULES:
        return _RULES[name](c, name)
    if name in _MOVING:
        raise Misread(f"{name} moves the robot without a target", "use movej, movel, movep or movec")
    if not c.at("("):
        return _assigned(c, name)
    used = Used(set() if name in _STILL else {name})
    c.arguments(used)
    return Statement(calls=frozenset(used.calls))


def _routine(c: Cursor, kind: str) -> Statement:
    name, parameters, used = c.name(), set(), Used()
    c.expect("(")
    while not c.accept(")"):
        parameters.add(c.name())
        if c.accept("="):
            c.expression(",", ")", used=used)
        c.accept(",")
    c.expect(":")
    act, depth = (None, 0) if kind == "def" else (_Script.threaded, 1)
    return Statement(
        act, calls=frozenset(used.calls), changes=frozenset(parameters), defines=name, depth=depth
    )


_FORMS: Final = Forms(
    """
    plain  break|continue|pass|halt
    plain  kill|join w
    turn   elif|case e :
    turn   else|default :
    open   if|while|switch e :
    """,
    whole=False,
)


def _literal(c: Cursor) -> Literal | None:
    """Take p[...] or [...] in numbers; None, and nothing taken, if there is none."""
    for notation, template in ((POSE, "p[n,n,n,n,n,n]"), (JOINTS, "[n,n,n,n,n,n]")):
        if numbers := c.taken(template):
            return Literal(notation, numbers)
    return None


def _assigned(c: Cursor, name: str) -> Statement:
    used, whole = Used(), True
    while not c.accept("="):
        whole = False
        if c.accept("["):
            c.expression("]", used=used)
            c.expect("]")
        else:
            c.expect(".")
            c.name()
    c.accept("run")  # starts a thread
    literal = _literal(c) if whole else None
    act = partial(_Script.assigned, name=name, literal=literal)
    if literal is not None:
        c.finish()
        return Statement(act=act, gives=(name, literal))
    c.expression(used=used)
    return Statement(act=act, calls=frozenset(used.calls), changes=frozenset({name}))


def _return(c: Cursor, _: str) -> Statement:
    used = Used()
    if not c.ended:
        c.expression(used=used)
    return Statement(calls=frozenset(used.calls))


def _set_tcp(c: Cursor, _: str) -> Statement:
    numbers = c.taken("(p[n,n,n,n,n,n])") or c.taken("(p[n,n,n,n,n,n],t)")
    if numbers is None:
        raise Misread("the tool is not given by numbers", _TOOL_REMEDY)
    return Statement(act=partial(_Script.set_tool, literal=Literal(POSE, numbers)))


def _move(c: Cursor, name: str) -> Statement:
    motion, count = _MOVES[name]
    targets, used = [], Used()
    c.expect("(")
    for i in range(count):
        if i:
            c.expect(",")
        targets.append(_target(c))
        if not c.at(",", ")"):
            raise c.misread("the text after the target is unknown", _REMEDY)
    while c.accept(","):
        if c.peek().text in _ARGUMENTS and c.peek(1).text == "=":
            c.take()
            c.take()
        c.expression(",", ")", used=used)
    c.expect(")")
    act = partial(_Script.move, motion=motion, targets=tuple(targets))
    own = all(isinstance(each.numbers, Literal) and isinstance(each.frame, str) for each in targets)
    return Statement(act=act, calls=frozenset(used.calls), repeats=own and not used.calls)


def _target(c: Cursor) -> _Target:
    """Take a literal or a variable, in a frame or through inverse kinematics."""
    kind = c.peek().text if c.peek(1).text == "(" else ""
    if kind not in {"", "get_inverse_kin", "pose_trans"}:
        raise Misread("a target is not given by numbers", _REMEDY)
    if not kind:
        return _Target(_numbers(c))
    c.take()
    c.take()
    if kind == "pose_trans":
        frame = _numbers(c)
        c.expect(",")
        target = _Target(_numbers(c), frame)
    else:
        target = _target(c) if c.peek().text == "pose_trans" else _Target(_numbers(c))
        if c.accept(","):  # angles near the answer
            if c.accept("qnear"):
                c.expect("=")
            _numbers(c)
    c.expect(")")
    return target


def _numbers(c: Cursor) -> Literal | str:
    """Take a literal, or the name of a variable."""
    literal = _literal(c)
    if literal is not None:
        return literal
    if c.peek().kind != "word" or c.peek().text in _LEXICON.reserved or c.peek(1).text not in {",", ")"}:
        raise c.misread("a target is not given by numbers", _REMEDY)
    return c.name()


_RULES: Final[Mapping[str, Callable[[Cursor, str], Statement]]] = {
    **dict.fromkeys(_MOVES, _move),
    **dict.fromkeys(("def", "sec", "thread"), _routine),
    "set_tcp": _set_tcp,
    "return": _return,
    "end": lambda _, __: Statement(act=_Script.ended, depth=-1),
}


def read_ur(reader: Reader) -> None:
    """Read a script."""
    script = _Script(reader, _LEXICON, _parse, _REMEDY)
    script.add(0, reader.sources[0].starts, reader.sources[0].ends)
    script.run()
