"""Programs of KUKA (KRL): .src with .dat, $config.dat and files of its routines, translated."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from robotprograms import language as ir
from robotprograms.arrays import BoolArray
from robotprograms.columns import IN_MODULE, OF_ROUTINE
from robotprograms.errors import capitalise
from robotprograms.language import UNKNOWN_STATEMENT, Line, Misread, Op
from robotprograms.notation import Notation, Orientation
from robotprograms.places import OTHER_FILES
from robotprograms.program import Literal, Motion, Source
from robotprograms.statements import Statements

POSE: Final = Notation(Orientation.EULER_ZYX)
JOINTS: Final = Notation(Orientation.JOINTS)
_NUMBER: Final = Notation(Orientation.NONE)
_POSES: Final = ((POSE, ("X", "Y", "Z", "A", "B", "C")), (JOINTS, ("A1", "A2", "A3", "A4", "A5", "A6")))
_MOTIONS: Final = {"PTP": Motion.JOINT, "LIN": Motion.LINEAR, "CIRC": Motion.CIRCULAR, "SPL": Motion.SPLINE}
_IPO: Final = f"{ir.MODE} IPO"
"""Name of the controller's interpolation mode, which lasts: with #TCP the arm carries the part."""
_ARM_CARRIES_TOOL: Final = ir.Named("")
"""Value of the interpolation mode #BASE, with which nothing is special."""
_FIXED_TOOL: Final = "the tool is fixed in the cell, and the arm carries the part (#TCP)"
# Facts. Sources: KUKA System Software 8.x, programming instructions for system integrators (KSS); the
# controller's bas.src (BAS).
_BAS: Final[dict[str, tuple[Op, ...]]] = {
    # BAS: INITMOV sets the null base, tool 1, and the controller's default of the feed
    "INITMOV": (
        ir.Assign("$BASE", ir.Copy("BASE_DATA[0]")),
        ir.Assign("$TOOL", ir.Copy("TOOL_DATA[1]")),
        ir.Assign(ir.FEED, ir.Unknown("the feed is the controller's default", "set $VEL.CP")),
    ),
    # BAS: FRAMES, PTP_PARAMS and CP_PARAMS make frames and interpolation mode of FDAT_ACT the active ones
    **dict.fromkeys(
        ("FRAMES", "PTP_PARAMS", "CP_PARAMS"),
        (
            ir.Assign("$BASE", ir.Copy("FDAT_ACT.BASE", indirect=True)),
            ir.Assign("$TOOL", ir.Copy("FDAT_ACT.TOOL", indirect=True)),
            ir.Assign(_IPO, ir.Copy("FDAT_ACT.IPO")),
        ),
    ),
    # BAS: these set speeds and accelerations only
    **dict.fromkeys(("ACC_CP", "ACC_PTP", "VEL_CP", "VEL_PTP", "PTP_DAT", "CP_DAT"), ()),
}
# KSS: system variables, apart from $BASE and $TOOL, on which the meaning of a target depends
_MAY_MOVE_TARGETS: Final = re.compile(
    r"\$(?!BASE\b|TOOL\b|IPO_MODE=#BASE|H_POS|IN_POS|(?:VEL|ACC|RED|JERK|APO)[._])\w*(?:BASE|TOOL|ROOT|WORLD|FRAME|POS|IPO|TECH|SEN|SOFT|ASY|EXT?_?AX|EX_|CORR|CMD)"
)
# KSS: with these, the orientation of the tool is not the stated one
_TURNS_TOOL: Final = frozenset({"$ORI_TYPE", "$PAL_MODE"})
# KSS: positions that the controller stores, for all of its programs
_STORED_POSITION: Final = re.compile(r"\$AXIS_ACT|\$POS_ACT|\$H_POS|X?HOME\d?")
_RESERVED: Final = (
    r"S?(?:PTP|LIN|CIRC|SPL)(?:_REL)?|ASYPTP|ASYCONT|DEF|DEFFCT|DEFDAT|END(?:IF|FOR|WHILE|LOOP|SWITCH|FCT|DAT|SPLINE)?|IF|THEN|ELSE|FOR|TO|STEP|WHILE"
    r"|LOOP|REPEAT|UNTIL|SWITCH|CASE|DEFAULT|GOTO|WAIT|HALT|EXIT|RETURN|CONTINUE|TRIGGER|INTERRUPT|(?:PTP_)?SPLINE"
    r"|DECL|GLOBAL|SIGNAL|EXT|BRAKE|RESUME|WITH|DO|ANOUT|ANIN|BAS|C_(?:PTP|DIS|VEL|ORI|SPL)|\$BASE|\$TOOL"
)
_REMEDY: Final = "write X, Y, Z, A, B, C (or A1 ... A6) in numbers, and send the .dat that declares them"
_FRAME_REMEDY: Final = "give the whole frame in numbers, or as BASE_DATA[i] or TOOL_DATA[i]"
_NAME: Final = r"\$?[^\W\d]\w*+"
_NOT_WHOLE: Final = (
    "the target is neither a whole pose nor all joint angles in numbers, or the text after it is unknown"
)
# These words must not be the end of a name, such as MYWITH or XC_DIS.
_WITH: Final = re.compile(r" ?(?<![\w$])WITH ")
_BLEND: Final = re.compile(r" ?(?<![\w$])C_(?:PTP|DIS|VEL|ORI|SPL)")
_LONGEST_BLEND: Final = len(" C_PTP")
_FIELD: Final = re.compile(r"(?P<name>\w+)(?:\[\])? ?(?P<value>\0|TRUE|FALSE|\"[^\"]*\"|#\w+|'\w+')")
_DECLARED_NAME: Final = re.compile(rf"(?P<name>{_NAME})(?:\[(?P<index>.*?)\])?(?:=(?P<value>.+))?")
_SEPARATED: Final = re.compile(r" (?=[\0\w\"#'$])|(?<=\w):|(?<=\])(?=[\0\w\"#'$ ])|(?<=\[)(?=\])")
_OWN_FRAME: Final = re.compile(
    rf"\$(?P<role>BASE|TOOL|IPO_MODE)=(?:(?:STOOL2?|SBASE|SIPO_MODE)\((?P<data>{_NAME})(?:\.\w+)?\)"
    rf"|(?P<table>(?:BASE|TOOL)_DATA)\[\0\]|(?P<name>{_NAME}))"
)
"""A frame of a single move, by the name of its data, in the controller's table, or by its own name."""
# Each part ends at the first word that may end it: any other division would take the square of the time.
_TRIGGER: Final = (
    r"TRIGGER WHEN (?:DISTANCE|PATH)=((?:(?! ?\b(?:ONSTART|DELAY=)).)+)(?: ?ONSTART)? ?\bDELAY="
    r"((?:(?! ?\bDO ).)+) ?\bDO "
)
_AXES_OF_STEP: Final = r" ?#(?:TOOL|BASE)$"
"""Axes along which the step of a relative move is given, at the end of the move."""
_FIELD_OF_FRAMES: Final = re.compile(r"\.(?:(BASE|TOOL)_NO=\0|IPO_FRAME=(?P<mode>#(?:BASE|TCP)))")
_ELEMENT: Final = re.compile(r"(?P<array>[^\W\d]\w*+)\[\0\]")
"""An element of an array whose index is a number, such as `A[3]`."""
_NEAR: Final = re.compile(r"(?P<target>[^\W\d]\w*+):(?P<offset>[^:,]++|\{[^{}]*\})")
"""A place at an offset from a target, by the geometric operator."""
_TABLE: Final = re.compile(r"(?P<role>BASE|TOOL)_DATA\[(?P<index>[^\W\d]\w*+)\]")
_OTHER_TABLE: Final = {"$BASE": "TOOL_DATA", "$TOOL": "BASE_DATA"}
"""The controller's table of frames from which the active base or tool is not set."""
_SET_BEFORE_MOVE: Final = "set $TOOL and $BASE before the move"


_FEED_OF_BLOCK: Final = f"{ir.FEED} before the block"
"""Name of the feed that is active again behind a block of splines."""
_M_PER_S: Final = 1e3
"""Unit of `$VEL.CP` [mm/s]."""
_OWN_FEED: Final = re.compile(
    r"\$VEL(?:\.CP=(?P<value>.+)|=(?:(?P<structure>\{.*\})|SVEL_CP\((?P<data>.*)\)|.+))"
)
"""An assignment, or a setting of a single move, that sets the feed: also as a structure by its name."""
_UNKNOWN_FEED: Final = ir.Unknown("the feed is computed, or not stated", "write $VEL.CP in numbers")


def _read_feed(setting: Line) -> ir.Value | None:
    """Return the feed that a setting such as `$VEL.CP=0.2` states; None if the setting states no feed.

    A feed that is computed is an unknown value.
    """
    match = _OWN_FEED.fullmatch(setting.text)
    if match is None:
        return None
    if match["structure"]:  # $VEL={CP 0.2,ORI1 200}
        ordinal = _read_structure(setting.cut(*match.span("structure"))).get("CP")
        return Literal(_NUMBER, (ordinal,)) if isinstance(ordinal, int) else _UNKNOWN_FEED
    if match["value"]:  # $VEL.CP=0.2
        values = setting.cut(*match.span("value"))
    elif match["data"]:  # $VEL=SVEL_CP(0.2,...), whose first argument is the feed
        values = setting.cut(*match.span("data"))
    else:
        return _UNKNOWN_FEED
    feed, *_ = values.split()
    return _read_speed(feed) or _UNKNOWN_FEED


def _read_speed(part: Line) -> ir.Value | None:
    """Return the speed that a text states: a number or a name; None for any other text."""
    if part.is_number:
        return Literal(_NUMBER, part.ordinals)
    text = part.text.strip()
    is_name = re.fullmatch(_NAME, text) and text not in {"TRUE", "FALSE"}
    return ir.Copy(text) if is_name else None


def _read_value(line: Line, text: str) -> list[Op]:
    """Translate a value, which may be an expression or a structure `{X 1,Y 2}`, into uses of names."""
    is_structure = text.startswith("{")
    calls_routine = "(" in text
    if not calls_routine:
        # Who reads the active frame does not use the name: it gets another name here. A routine that gets the
        # frame may change it, and so uses the name.
        text = re.sub(r"\$(?=(?:BASE|TOOL)\b)", "$ACTIVE_", text)
    if is_structure:
        text = _SEPARATED.sub(",", text)  # names and values of the fields become a list of expressions
    return line.read_expression(text)


def _read_structure(part: Line) -> dict[str, int | str]:
    """Parse a structure such as `{X 1,Y 2,S "on"}`.

    Returns:
        For the name of each field the ordinal of its number, which is the index among the numbers of the
        statement; or the field's text if it is no number. Empty if a field is computed or occurs twice, or
        if the text is not a structure.
    """
    structure = re.fullmatch(r"\{(?:\w+:)?(?P<fields>[^{}]*)\}", part.text)
    if structure is None:
        return {}
    value_of_field = dict[str, int | str]()
    for field in part.cut(*structure.span("fields")).split():
        match = _FIELD.fullmatch(field.text)
        if match is None or match["name"] in value_of_field:
            return {}
        is_number = match["value"] == ir.A_NUMBER
        value_of_field[match["name"]] = field.ordinals[0] if is_number else match["value"]
    return value_of_field


def _find_target_in_fields(fields: dict[str, int | str]) -> Literal | None:
    """Return the target of a structure; None if it is neither a whole pose nor all joint angles.

    `fields` are those of `_read_structure`: ordinals of numbers, or texts. The target has the ordinals of its
    pose or joint angles, of its external axes E1 ... E6 (-1 where one is absent), and of status and turn.
    """
    ordinals = {name: value for name, value in fields.items() if isinstance(value, int)}
    external_axes = tuple(ordinals.get(f"E{i}", -1) for i in range(1, 7))
    if max(external_axes) < 0:  # none is stated
        external_axes = ()
    status_and_turn = tuple((name, ordinals[name]) for name in ("S", "T") if name in ordinals)
    for notation, names in _POSES:
        if ordinals.keys() >= set(names):
            numbers = tuple(ordinals[name] for name in names)
            return Literal(notation, numbers, external_axes, status_and_turn)
    return None


def _copy_frames(target: str, source: str) -> list[Op]:
    """Return the operations that copy frame data, with their interpolation mode, to those of `target`."""
    return [ir.Assign(f"{target}.{role}", ir.Copy(f"{source}.{role}")) for role in ("BASE", "TOOL", "IPO")]


def _set_frame_data(name: ir.Name, ordinals: dict[str, int], mode: str) -> list[Op]:
    """Translate an assignment to fields of frame data, such as `FDAT_ACT.BASE_NO=1`.

    Frame data have a base, a tool and an interpolation mode. KSS: with the mode #TCP the tool is fixed in the
    cell, and the arm carries the part; then all of them are unknown.

    Args:
        name: name of the frame data.
        ordinals: by the keys BASE and TOOL, the number of the frame that is set, as an index among the
            numbers of the statement.
        mode: interpolation mode, `#BASE` or `#TCP`; empty if the statement does not set the mode.
    """
    is_tool_fixed = mode not in {"", "#BASE"}
    if is_tool_fixed:
        unknown = ir.Unknown(_FIXED_TOOL, _FRAME_REMEDY)
        return [ir.Assign(f"{name}.{field}", unknown) for field in ("BASE", "TOOL", "IPO")]
    ops: list[Op] = []
    for role, ordinal in ordinals.items():
        frame_in_table = ir.NumberedName(f"{role}_DATA[%s]", ordinal)
        ops.append(ir.Assign(f"{name}.{role}", ir.Named(frame_in_table)))
    if mode:
        ops.append(ir.Assign(f"{name}.IPO", _ARM_CARRIES_TOOL))
    return ops


def _translate_value(name: ir.Name, value: Line) -> list[Op]:
    """Translate an assignment to a name, which gets numbers, another name's value or an unknown value."""
    fields = _read_structure(value)
    if pose := _find_target_in_fields(fields):
        return [ir.Assign(name, pose)]
    # Frame data such as FDAT_ACT={TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE}
    numbers_of_frames = dict[str, int]()
    for role in ("BASE", "TOOL"):
        number = fields.get(f"{role}_NO")
        if isinstance(number, int):
            numbers_of_frames[role] = number
    if isinstance(name, str) and len(numbers_of_frames) == 2:
        return _set_frame_data(name, numbers_of_frames, str(fields.get("IPO_FRAME", "#BASE")))
    is_name = re.fullmatch(_NAME, value.text) is not None
    if name == "FDAT_ACT" and is_name:
        return _copy_frames("FDAT_ACT", value.text)
    if value.is_number:
        return [ir.Assign(name, Literal(_NUMBER, value.ordinals))]
    if name in {"$BASE", "$TOOL"} and (ops := _activate_frame(str(name), value)):
        return ops
    return [*_read_value(value, value.text), _forget_name(name)]


def _activate_frame(active: str, value: Line) -> list[Op]:
    """Translate the assignment of a named frame, or of an element of an array, to `$BASE` or `$TOOL`.

    `active` is the name of the variable. The list is empty for any other value.
    """
    text = value.text
    if re.fullmatch(_NAME, text):  # $BASE=MY_FRAME
        return [ir.Use(frozenset({text})), ir.Assign(active, ir.Copy(text))]
    by_variable = _TABLE.fullmatch(text)  # $BASE=BASE_DATA[i]
    if by_variable and f"${by_variable['role']}" == active:
        index = by_variable["index"]
        return [*value.read_expression(index), _copy_element(by_variable["role"], index)]
    by_number = _ELEMENT.fullmatch(text)  # $BASE=FRAMES[3]
    if by_number and by_number["array"] != _OTHER_TABLE[active]:
        array = by_number["array"]
        frame = value.fill_name(f"{array}[%s]")
        return [ir.Use(frozenset({array})), ir.Assign(active, ir.Copy(frame))]
    return []


def _copy_element(role: str, index: str) -> Op:
    """Return the assignment `$BASE=BASE_DATA[i]` with a variable i as `index`; `role` is BASE or TOOL."""
    return ir.Assign(f"${role}", ir.Element(f"{role}_DATA[%s]", index))


def _forget_name(name: ir.Name) -> Op:
    """Return the operation that makes the value of a name unknown, with the reason and a remedy."""
    text = name if isinstance(name, str) else name.template % "i"  # an element of an array as `A[i]`
    is_frame = text in {"$BASE", "$TOOL", "FDAT_ACT"} or "_DATA" in text
    remedy = _FRAME_REMEDY if is_frame else _REMEDY
    reason = f"{text} changes while the program runs: it is computed, or set in part"
    return ir.MakeUnknown(frozenset({name}), reason, remedy)


def _translate_declaration(line: Line) -> list[Op]:
    """Translate a declaration of one or several names, with or without values: `DECL POS A={X 1,...},B`.

    Raises:
        Misread: the declaration is not understood.
    """
    ops: list[Op] = []
    for part in line.part("names").split():
        declared = _DECLARED_NAME.fullmatch(part.text)
        if declared is None or re.fullmatch(_RESERVED, declared["name"]):
            raise Misread("the declaration is unknown")
        name, index = declared["name"], declared["index"]
        ops += [ir.Local(frozenset({name})), *line.read_expression(index or "")]
        value = part.cut(*declared.span("value"))
        is_element = index is not None
        if value.text and is_element:
            ops += [*_read_value(line, value.text), _forget_name(name)]
        elif value.text:
            ops += _declare_value(line, name, value)
    return ops


def _declare_value(line: Line, name: str, value: Line) -> list[Op]:
    """Translate the value that a declaration, which is the line, gives to a name."""
    words_before_names = line.text.removesuffix(line["names"])
    is_shared = re.search(r"\bGLOBAL\b", words_before_names) is not None
    is_constant = re.search(r"\bCONST\b", words_before_names) is not None
    if value.is_number:
        if not is_constant:  # other programs may have set a variable of a .dat since then
            return [_forget_name(name)]
        number = Literal(_NUMBER, value.ordinals)
        return [ir.Assign(name, number, declares="constant", shared=is_shared)]
    ops = list[Op]()
    for op in _translate_value(name, value):
        ops.append(op._replace(shared=is_shared) if isinstance(op, ir.Assign) else op)
    return ops


def _set_field_of_frames(line: Line) -> list[Op]:
    """Translate an assignment to one field of frame data, or to the interpolation mode.

    The list is empty if the line assigns to something else.
    """
    if line.text == "$IPO_MODE=#BASE":
        return [ir.Assign(_IPO, _ARM_CARRIES_TOOL)]
    if line.text == "$IPO_MODE=#TCP":
        return [ir.Assign(_IPO, ir.Unknown(_FIXED_TOOL, "omit the statement"))]
    field = _FIELD_OF_FRAMES.fullmatch(f"{line['index']}={line['value']}")
    if field is None:
        return []
    role, mode = field[1], field["mode"] or ""
    numbers_of_frames = {role: line.part("value").ordinals[0]} if role else {}
    return _set_frame_data(line["name"], numbers_of_frames, mode)


def _translate_assignment(line: Line) -> list[Op]:
    """Translate an assignment; one that sets a single element or field makes the whole name unknown.

    Raises:
        Misread: a system variable that may move targets is set, or the index of a frame is computed.
    """
    name, index = line["name"], line["index"]
    is_index_a_number = index.startswith("[\0]")
    if name in {"BASE_DATA", "TOOL_DATA"} and not is_index_a_number:
        raise Misread(f"the index of {name} is computed", _FRAME_REMEDY)
    if is_index_a_number and not name.startswith("$"):
        element = line.fill_name(f"{name}[%s]", "index")
        return _assign(line, element, index.removeprefix("[\0]"))
    if field_of_frames := _set_field_of_frames(line):
        return field_of_frames
    if name in {"$ACT_BASE", "$ACT_TOOL"} and not index:
        return _choose_number_of_active_frame(line)
    if _MAY_MOVE_TARGETS.match(line.text):
        raise Misread(f"the controller's variable {name} may move targets", "omit the statement")
    return _assign(line, name, index)


def _choose_number_of_active_frame(line: Line) -> list[Op]:
    """Translate an assignment to `$ACT_BASE` or `$ACT_TOOL`, behind which the active frame is unknown.

    BAS copies these numbers of frames where it sets the active frames.
    """
    name = line["name"]
    active = name.replace("ACT_", "")
    reason = f"{line.quote()}: the controller's variable {name} may move targets"
    forget = ir.MakeUnknown(frozenset({active, name}), reason, "omit the statement")
    return [*_read_value(line, line["value"]), forget]


def _assign(line: Line, target: ir.Name, index: str) -> list[Op]:
    """Translate the assignment of the line's value to a name, or to one of its elements or fields.

    `index` is the text of the element or field, such as `[i].X`; it is empty for the whole name. An element
    or a field makes the value of the whole name unknown. System variables have no value that matters, apart
    from the active frames and the feed.
    """
    name, value = line["name"], line["value"]
    # The indices of elements are expressions; all of them are read as one expression.
    indices = index.strip("[]").replace("][", ",").replace("].", "+") if "[" in index else ""
    uses = line.read_expression(indices)
    if name in _TURNS_TOOL and value not in {"FALSE", "#VAR"}:
        effect = "after this line the arm does not reach the orientations that the program states"
        uses.append(ir.Note(f"{line.quote()}: {effect}"))
    is_system_variable = name.startswith("$") and name not in {"$BASE", "$TOOL"}
    if not (index or is_system_variable):
        return [*uses, *_translate_value(target, line.part("value"))]
    changes: list[Op] = [] if is_system_variable else [_forget_name(target)]
    if name == "$VEL" and (feed := _read_feed(line)):
        changes = [ir.Assign(ir.FEED, feed)]
    return [*uses, *_read_value(line, value), *changes]


def _read_target(part: Line) -> Literal | ir.Name | None:
    """Return the target that a text states: a variable, an element of an array or numbers.

    The target is None for any other text.
    """
    is_variable = re.fullmatch(_NAME, part.text) and not re.fullmatch(_RESERVED, part.text)
    if is_variable:
        return part.text
    if element := _ELEMENT.fullmatch(part.text):
        return part.fill_name(f"{element['array']}[%s]")
    return _find_target_in_fields(_read_structure(part))


class _Settings(NamedTuple):
    """Settings of a move behind its targets, such as `WITH $VEL.CP=0.2, $BASE=FRAME1`."""

    uses: list[Op]  # operations of their values
    frames: dict[str, ir.Copy]  # frames that are set for this move only, by the keys BASE and TOOL
    feed: ir.Value | None  # feed that is set for this move only; None if there is none


def _translate_move(line: Line) -> list[Op]:
    """Translate a move; a move that is relative or has no complete target is not corrected.

    Raises:
        Misread: there is no target, or the settings of the move are unknown.
    """
    motion = _MOTIONS[line["motion"]]
    is_relative = bool(line["relative"])
    rest = line.part("rest")
    if is_relative:  # the axes of a step are behind all else
        rest = rest.cut(0, len(re.sub(_AXES_OF_STEP, "", rest.text)))
    target_text, setting_text = _split_at_with(rest)
    if not target_text.text:
        raise Misread(_NOT_WHOLE)
    settings = _read_settings(setting_text)
    if _STORED_POSITION.fullmatch(target_text.text):
        return [*settings.uses, ir.MoveToStored(target_text.text)]
    targets, uses_in_targets = _read_targets(target_text)
    uses = [*settings.uses, *uses_in_targets]
    base = settings.frames.get("BASE", ir.Copy("$BASE"))
    tool = settings.frames.get("TOOL", ir.Copy("$TOOL"))
    known_targets = tuple(target for target in targets if target is not None)
    count = 2 if motion is Motion.CIRCULAR else 1
    has_all_targets = len(known_targets) == len(targets) == count
    if is_relative:
        reason = "the target is relative to the position before the move"
        return [*uses, *_leave_move(motion, target_text, base, tool, reason)]
    if not has_all_targets:
        return [*uses, *_leave_move(motion, target_text, base, tool, _NOT_WHOLE)]
    value_of_feed = settings.feed or ir.Copy(ir.FEED)
    feed = None
    if isinstance(value_of_feed, Literal | ir.Copy):
        feed = ir.Feed(value_of_feed, _M_PER_S)
    return [*uses, ir.Move(motion, known_targets, (base,) * count, (tool,) * count, feed=feed)]


def _read_targets(targets_of_move: Line) -> tuple[list[Literal | ir.Name | None], list[Op]]:
    """Return the targets of a move, and the uses of other names there.

    A target is None if it is neither numbers nor a name.

    Raises:
        Misread: one of two targets is stored in the controller.
    """
    targets: list[Literal | ir.Name | None] = []
    uses = list[Op]()
    for part in targets_of_move.split():
        is_angle_of_arc = len(targets) == 2 and part.text.startswith("CA ")
        if is_angle_of_arc:
            note = ir.Note("the arc ends at its angle CA, not at the second of its targets")
            uses += [*part.read_expression(part.text.removeprefix("CA ")), note]
        elif _STORED_POSITION.fullmatch(part.text):
            raise Misread("the arc goes through a position stored in the controller")
        else:
            targets.append(_read_target(part))
    return targets, uses


def _leave_move(motion: Motion, target: Line, base: ir.Value, tool: ir.Value, reason: str) -> list[Op]:
    """Translate a move that is not corrected, because its target is relative or not whole.

    If the target is a place at an offset from another target, such as `P1:{X 10}`, the move shifts with the
    correction of that target; `reason` then gives way to one that names the other target.
    """
    target_or_step = re.sub(_AXES_OF_STEP, "", target.text)
    near = _NEAR.fullmatch(target_or_step)
    structure = near["offset"] if near else target_or_step  # such as `{X 10,Y 5}`
    list_of_expressions = _SEPARATED.sub(",", structure)
    uses = target.read_expression(list_of_expressions)
    if near is None or re.fullmatch(_RESERVED, near["target"]):
        return ir.make_uncorrected_move(uses, reason, _REMEDY)
    name = near["target"]
    move = ir.Move(
        motion,
        (),
        (base,),
        (tool,),
        reason=f"the target is at an offset from {name}",
        remedy=_REMEDY,
        offset_from=(name,),
    )
    return [*uses, move]


def _split_at_with(move: Line) -> tuple[Line, Line]:
    """Return the targets of a move, and its settings behind the word WITH, which are empty if it has none.

    Words of approximate positioning, such as C_DIS, are left out of both.
    """
    word_with = _WITH.search(move.text)
    if word_with is None:
        return _strip_blends(move), move.cut(0, 0)
    return _strip_blends(move.cut(0, word_with.start())), _strip_blends(move.cut(word_with.end()))


def _strip_blends(part: Line) -> Line:
    """Return a text without the words of approximate positioning, such as C_DIS, at its end."""
    end = len(part.text)
    while word := _BLEND.search(part.text, max(0, end - _LONGEST_BLEND), end):
        is_at_the_end = word.end() == end
        if not is_at_the_end:
            break
        end = word.start()
    return part.cut(0, end)


def _read_settings(settings: Line) -> _Settings:
    """Translate the settings of a move behind the word WITH; there are none if the text is empty.

    Raises:
        Misread: a setting is unknown, calls a routine, or takes only one of base and tool from frame data.
    """
    if not settings.text:
        return _Settings([], {}, None)
    uses = list[Op]()
    own_frames = list[_OwnFrame]()
    feed = None  # the last one counts: a number may follow a structure
    for setting in settings.split():
        feed = _read_feed(setting) or feed
        if own_frame := _read_own_frame(setting):
            own_frames.append(own_frame)
            uses += own_frame.uses
        elif _is_harmless_setting(setting.text):
            _, _, value = setting.text.partition("=")
            uses += _read_value(setting, value)
        else:
            reason = "a setting after WITH is unknown, or sets a frame for this move only"
            raise Misread(reason, _SET_BEFORE_MOVE)
    if _takes_part_of_frame_data(own_frames) or ir.calls_routine(uses):
        reason = "the settings after WITH call a routine, or set only one of tool and base"
        raise Misread(reason, _SET_BEFORE_MOVE)
    return _Settings(uses, {own.role: own.frame for own in own_frames}, feed)


class _OwnFrame(NamedTuple):
    """Frame that a setting makes active for a single move."""

    role: str  # BASE or TOOL; IPO_MODE for the interpolation mode, which frame data state as well
    frame: ir.Copy
    data: str = ""  # name of the frame data that state the frame; empty if there are none
    uses: tuple[ir.Use, ...] = ()  # uses of names


def _read_own_frame(setting: Line) -> _OwnFrame | None:
    """Return the frame that a setting such as `$BASE=FRAME1` makes active; None for any other setting."""
    match = _OWN_FRAME.fullmatch(setting.text)
    if match is None:
        return None
    role = match["role"]
    if data := match["data"]:  # $BASE=SBASE(FP1)
        return _OwnFrame(role, ir.Copy(f"{data}.{role}", indirect=True), data)
    if match["table"] == f"{role}_DATA":  # $BASE=BASE_DATA[1]
        return _OwnFrame(role, ir.Copy(setting.fill_name(f"{role}_DATA[%s]")))
    if match["name"] and role != "IPO_MODE":  # $BASE=MY_FRAME
        use = ir.Use(frozenset({match["name"]}))
        return _OwnFrame(role, ir.Copy(match["name"]), uses=(use,))
    return None


def _takes_part_of_frame_data(own_frames: list[_OwnFrame]) -> bool:
    """Return whether only base or only tool is from frame data, or each is from other ones."""
    data_of_role = {own.role: own.data for own in own_frames if own.data}
    has_base_and_tool = data_of_role.keys() >= {"BASE", "TOOL"}
    are_all_the_same = len(set(data_of_role.values())) == 1
    return bool(data_of_role) and not (has_base_and_tool and are_all_the_same)


def _is_harmless_setting(setting: str) -> bool:
    """Return whether a setting `$NAME=value` of a single move moves no target and sets no frame."""
    sets_frame = setting.startswith(("$BASE", "$TOOL"))
    return setting.startswith("$") and not sets_frame and not _MAY_MOVE_TARGETS.match(setting)


def _translate_spline(line: Line) -> list[Op]:
    """Translate the beginning of a block of splines, which may have a feed and frames of its own.

    Base and tool become unknown if the block sets them.

    Raises:
        Misread: the statement has a target, or unknown settings.
    """
    targets, setting_text = _split_at_with(line.part("rest"))
    if targets.text:
        raise Misread(UNKNOWN_STATEMENT)
    settings = _read_settings(setting_text)
    # The end of the block makes the feed before the block active again.
    ops = [*settings.uses, ir.Assign(_FEED_OF_BLOCK, ir.Copy(ir.FEED))]
    if settings.feed:
        ops.append(ir.Assign(ir.FEED, settings.feed))
    if settings.frames:
        reason = "the block of splines has frames of its own"
        remedy = "set $BASE and $TOOL before the block"
        ops.append(ir.MakeUnknown(frozenset({"$BASE", "$TOOL"}), reason, remedy))
    return ops


def _translate_sensor(line: Line) -> list[Op]:
    """Translate a function of KUKA RSI, by which a sensor begins or ends to guide the arm."""
    ops = line.read_expression(line["arguments"]) if line["arguments"] else []
    variable_of_result = line["name"]
    if variable_of_result:
        ops.append(_forget_name(variable_of_result))
    ops.append(ir.call_if_defined(line["function"], _find_names(ops)))
    reason, remedy = "a sensor moves the targets (RSI)", "omit the statement"
    if line["action"] == "OFF":
        return [*ops, ir.end_lasting("RSI")]
    if line["action"] == "MOVECORR":  # the motion is that of the sensor alone, and ends here
        return ir.make_uncorrected_move(ops, reason, remedy)
    return [*ops, ir.begin_lasting("RSI", reason, remedy)]


def _translate_search(line: Line) -> list[Op]:
    """Translate a routine of KUKA TouchSense, which corrects the moves behind it by a search."""
    lasting = ir.begin_lasting("TS", "a touch search corrects the targets", "omit the statement")
    return [*line.read_expression(), lasting]


def _translate_routine(line: Line) -> list[Op]:
    """Return the operations that begin a routine and declare its parameters."""
    names = re.findall(rf"({_NAME})(?::\w+)?", line["parameters"])
    return ir.begin_routine(line["name"], names, _REMEDY, shared=line.text.startswith("GLOBAL"))


def _translate_attachment(line: Line) -> list[Op]:
    """Translate the declaration of an interrupt or a trigger, whose routine may run at any time."""
    is_trigger = line.text.startswith("TRIGGER")
    event: ir.Name = "TRIGGER" if is_trigger else ""
    if line["number"]:  # by this number, another statement switches the interrupt on
        event = line.fill_name("INTERRUPT %s", "number")
    action = re.sub(r" ?\bPRIO=", "+", line["action"])
    uses = [*line.read_expression(line["when"]), *line.read_expression(action)]
    ops = list[Op]()
    for op in ir.mark_anytime(uses, event):
        if isinstance(op, ir.Call):
            only_stops_the_robot = op.name == "IR_STOPM"  # BAS
            # KSS: a trigger acts on the path of the move behind it, which is planned before, with its frames.
            op = op._replace(harmless=op.harmless or only_stops_the_robot, behind_next=is_trigger)
        ops.append(op)
    return ops


def _translate_unknown_attachment(line: Line) -> list[Op]:
    """Return the calls of an attachment that is not understood: its routines may run at any time."""
    names = [line.text.replace(ir.A_NUMBER, "n"), *re.findall(rf"(?<![\w$])({_NAME})\(", line.text)]
    return [ir.Call(name, anytime=True) for name in names]


def _translate_triggered_assignment(line: Line) -> list[Op]:
    """Translate a trigger that assigns a value: the value of the name may change at any time.

    KSS: what is triggered is an assignment, a pulse of an output, or a call of a routine.
    """
    assignment = line.part("action")
    name, _, _ = assignment.text.partition("=")
    reason = f"{name} changes at a trigger"
    ops = line.language.apply_rules(assignment)
    assigned = [op for op in ops if isinstance(op, ir.Assign)]
    changes: list[Op] = [
        ir.MakeUnknown(frozenset({op.name}), reason, _REMEDY, anytime=True) for op in assigned
    ]
    for op in ops:
        if isinstance(op, ir.MakeUnknown):  # a value that is computed
            changes.append(op._replace(anytime=True))
        elif not isinstance(op, ir.Assign):
            changes.append(op)
    return changes


def _translate_bas(line: Line) -> list[Op]:
    """Translate a call of `BAS(#function,argument)`, which sets frames, speeds and accelerations.

    Raises:
        Misread: the function is unknown, or its argument is not a number.
    """
    function, argument = line["function"], line.part("argument")
    if function in {"TOOL", "BASE"} and argument.is_number:
        frame_in_table = argument.fill_name(f"{function}_DATA[%s]")
        return [ir.Assign(f"${function}", ir.Copy(frame_in_table))]
    if function in {"TOOL", "BASE"} and argument.text:
        is_variable = re.fullmatch(r"[^\W\d]\w*+", argument.text)
        change = _copy_element(function, argument.text) if is_variable else _forget_name(f"${function}")
        return [*argument.read_expression(), change]
    if function not in _BAS:
        raise Misread(f"BAS(#{function}) is unknown, or its argument is not a number")
    ops = [*argument.read_expression(), *_BAS[function]]
    if function in {"VEL_CP", "CP_PARAMS"}:  # BAS: both set $VEL.CP
        ops.append(ir.Assign(ir.FEED, _read_speed(argument) or _UNKNOWN_FEED))
    return ops


def _translate_reading(line: Line) -> list[Op]:
    """Translate a function that reads values from outside into its arguments, such as CREAD."""
    uses = [op for op in line.read_expression(line["arguments"]) if isinstance(op, ir.Use)]
    arguments = _find_names([*uses])
    variable_of_result = line["status"] or "_"
    own_routine = ir.call_if_defined(line["function"], arguments)
    reason = "the value is read from outside while the program runs"
    return [own_routine, ir.MakeUnknown(arguments | {variable_of_result}, reason, _REMEDY)]


def _find_names(ops: list[Op]) -> frozenset[str]:
    """Return the names that operations of expressions use, apart from elements of arrays."""
    names = set[str]()
    for op in ops:
        if isinstance(op, ir.Use):
            names.update(name for name in op.names if isinstance(name, str))
    return frozenset(names)


def _translate_kinematics(line: Line) -> list[Op]:
    """Translate INVERSE or FORWARD, which calculate joint angles or a pose and give a status.

    Source: KSS, INVERSE and FORWARD: they read the active base and tool, and change neither.
    """
    result, status = line["name"], line["status"]
    uses = ir.pass_uses(line.read_expression(line["arguments"]), result)
    changed = frozenset({result, status})
    own_routine = ir.call_if_defined(line["function"], _find_names(uses) | changed)
    reason = "the value is calculated while the program runs"
    return [*uses, own_routine, ir.MakeUnknown(changed, reason, _REMEDY)]


_LINE: Final = r"(?i)(?:\A|(?<=[\r\n]))[ \t]*+"
_ROUTINES: Final = re.compile(rf"{_LINE}(GLOBAL[ \t]++)?DEF(?:FCT[ \t]++\w++(?:\[\])?)?[ \t]++({_NAME})")
_CALLED: Final = re.compile(rf"(?<![\w$.])(?:{_NAME})(?=[ \t]*+\()")
_DEFINED: Final = re.compile(rf"{_LINE}(?:GLOBAL[ \t]++)?DEF(?:FCT[ \t]++\w++)?[ \t]++({_NAME})")
_DECLARED: Final = re.compile(
    rf"{_LINE}EXT(?:P|FCTP?[ \t]++\w++(?:\[\])?)?[ \t]++({_NAME})[ \t]*+\(([^()\r\n;]*+)\)"
)
"""Declaration of a routine of another file, with the types of its parameters."""
_BY_VALUE: Final = re.compile(r"(?i)[^:]+:[ \t]*+IN[ \t]*+")
"""Parameter that gets a copy. KSS: any other one gets a reference, through which the routine may write."""
_DATA: Final = re.compile(rf"{_LINE}DEFDAT[ \t]++(?P<program>{_NAME})(?P<public>[ \t]++PUBLIC\b)?")
_GLOBAL: Final = re.compile(r"(?i)[^;\r\n\"={]*\bGLOBAL\b")
_IMPORT: Final = re.compile(
    rf"{_LINE}(?:DECL[ \t]++)?IMPORT[ \t]++\w++[ \t]++(\$?\w++)(?:\[[^\]\r\n]*+\])?[ \t]++IS[ \t]++"
    r"[^;\r\n]*\.\.[ \t]*+(\$?\w++)"
)
_LINE_END: Final = re.compile(r"\r\n?|\n")
_BRACES: Final = re.compile(r"\{[^{}]*\}")
_NO_NAME: Final = re.compile(r"\"[^\"]*\"|;.*|\[[^\]]*\]")
"""Parts of a line that have no name which the line declares."""
_NO_DATA: Final = re.compile(
    r"(?i)\s*+(?:&|DEFDAT\b|EXT|(?:DECL[ \t]++)?(?:ENUM|STRUC|SIGNAL|IMPORT)\b)|[^;\r\n\"={]*\bGLOBAL\b"
)


def _find_private_names(text: str) -> Iterator[str]:
    """Yield the names that a file of data (.dat) declares without the word GLOBAL."""
    for line in _LINE_END.split(capitalise(text)):
        declares_no_private_name = _NO_DATA.match(line)
        if not declares_no_private_name:
            yield from _list_declared(line)


def _list_declared(line: str) -> Iterator[str]:
    """Yield the variables that a line of a .dat declares or sets, such as P1 and P2 of `POS P1={X 1},P2`."""
    plain = _remove_braces(_NO_NAME.sub("", line))  # without texts, comments, indices and structures
    for part in plain.split(","):
        before_value = part.partition("=")[0]
        if name := re.search(rf"({_NAME})(?:\.\w++)*\s*+\Z", before_value):
            yield name[1]


def _remove_braces(text: str) -> str:
    """Return a text without what is in braces; braces within one another are removed from the inside."""
    while _BRACES.search(text):
        text = _BRACES.sub("", text)
    return text


def _find_shared_names(text: str) -> Iterator[str]:
    """Yield the names that a file of data (.dat) declares with the word GLOBAL."""
    for line in _LINE_END.split(capitalise(text)):
        if _GLOBAL.match(line):
            yield from _list_declared(line)


def read_krl(statements: Statements, sources: tuple[Source, ...]) -> None:
    """Add the statements of a .src and of the files sent with it: .dat, $config.dat, .src with routines.

    Raises:
        ProgramError: a .dat belongs to another program.
    """
    statements.by_value = _find_routines_by_value(sources)
    new_names = dict[int, dict[str, str]]()  # by the index of the file, new names of routines by their names
    if len(sources) > 1:
        _note_names(statements, sources)
        new_names = _rename_local_routines(sources)
    for index in range(len(sources)):
        _add_file(statements, sources, index, new_names.get(index, {}))
    _forget_imported_names(statements, sources)


def _add_file(
    statements: Statements, sources: tuple[Source, ...], index: int, new_names: dict[str, str]
) -> None:
    """Add the statements of one file, in which routines get new names, by their names.

    Raises:
        ProgramError: the file is a .dat that belongs to another program.
    """
    source = sources[index]
    file_name = source.name.lower()
    is_data = file_name.endswith(".dat") and len(sources) > 1
    head = _DATA.search(source.text) if index else None  # DEFDAT name PUBLIC
    kind = _choose_kind_of_declarations(file_name, head)
    starts, ends = source.starts, source.ends
    is_config = file_name.endswith("config.dat")
    if head and not is_config and _is_of_another_program(statements, sources, index, head):
        # Of the data of another program, only those declared as GLOBAL are data of this one.
        is_global = _find_global_lines(source)
        is_owner_sent = bool(statements.owners.get(index))
        if is_owner_sent:
            statements.add_statements(index, starts[~is_global], ends[~is_global], declares=kind)
        starts, ends = starts[is_global], ends[is_global]
    translate = partial(_translate_renamed, renamed=new_names) if new_names else None
    statements.add_statements(index, starts, ends, declares=kind if is_data else "", translate=translate)


def _choose_kind_of_declarations(file_name: str, head: re.Match[str] | None) -> str:
    """Return the kind of the declarations in a file of data: which programs may change the data.

    It is `shared` for $config.dat, which all programs know; `variable` for a PUBLIC file; else `constant`.
    """
    if file_name.endswith("config.dat"):
        return "shared"
    is_public = head is not None and head["public"] is not None
    return "variable" if is_public else "constant"


def _find_global_lines(source: Source) -> BoolArray:
    """Return a mask of the lines of a file (n,) that declare names as GLOBAL."""
    spans = zip(source.starts.tolist(), source.ends.tolist(), strict=True)
    return np.array([_GLOBAL.match(source.text, *span) is not None for span in spans], dtype=np.bool_)


def _is_of_another_program(
    statements: Statements, sources: tuple[Source, ...], index: int, head: re.Match[str]
) -> bool:
    """Return whether a file of data, by its head DEFDAT, belongs to another program than the first one.

    Raises:
        ProgramError: the other program is not sent, and the data are not PUBLIC.
    """
    main, *others = _list_programs(sources) or [""]
    owner = head["program"]
    if not main or capitalise(owner) == capitalise(main):
        return False
    is_owner_sent = capitalise(owner) in map(capitalise, others)
    is_public = head["public"] is not None
    if not (is_public or is_owner_sent):
        reason = f"the file declares data of {owner}, not of {main}"
        remedy = "send the .dat file of this .src file"
        statements.refuse(sources[index].find_line(head.start()), reason, remedy, index)
    return True


def _list_programs(sources: tuple[Source, ...]) -> list[str]:
    """Return the name of the program in each .src, as it is written; empty for a file without DEF."""
    programs = list[str]()
    for source in sources:
        if not source.name.lower().endswith(".dat"):
            definition = _DEFINED.search(source.text)
            programs.append(definition[1] if definition else "")
    return programs


def _forget_imported_names(statements: Statements, sources: tuple[Source, ...]) -> None:
    """Make the values of names unknown that a program imports from another one, which may change them."""
    imported = set[str]()
    for source in sources[1:]:  # a program alone imports nothing that changes here
        for own_name, foreign_name in _IMPORT.findall(source.text):
            imported |= {capitalise(own_name), capitalise(foreign_name)}
    full_names = {*imported}
    for owner_of_name in statements.owners.values():
        for owner in owner_of_name.values():
            full_names |= {f"{name}{OF_ROUTINE}{owner}" for name in imported}
    reason = "a program imports the name of another one, and may change it"
    statements.forget_anytime(frozenset(full_names), reason, _REMEDY)


def _find_routines_by_value(sources: tuple[Source, ...]) -> frozenset[str]:
    """Return the routines that get copies of their arguments, and so cannot change them.

    All declarations of such a routine by EXT or EXTFCT state `:IN` for each parameter.
    """
    by_value, by_reference = set[str](), set[str]()
    for source in sources:
        for name, parameters in _DECLARED.findall(source.text):
            are_copies = all(_BY_VALUE.fullmatch(parameter) for parameter in parameters.split(","))
            routines = by_value if are_copies else by_reference
            routines.add(capitalise(name))
    return frozenset(by_value - by_reference)


def _rename_local_routines(sources: tuple[Source, ...]) -> dict[int, dict[str, str]]:
    """Return new names of routines that are known in one file only, by the index of each file.

    In another file the name of such a routine means something else, and gets a new name there.
    KSS: other files know the first routine of a file, and those that are GLOBAL.
    """
    defined = dict[int, set[str]]()  # routines that each file defines
    local = dict[int, set[str]]()  # those of them that other files do not know
    visible = set[str]()  # routines that all files know
    for index, source in enumerate(sources):
        if _DATA.search(source.text):
            continue
        found = [
            (capitalise(name), bool(word_global)) for word_global, name in _ROUTINES.findall(source.text)
        ]
        defined[index] = {name for name, _ in found}
        local[index] = {name for name, is_global in found[1:] if not is_global}
        visible |= {name for name, is_global in found if is_global}
        visible |= {name for name, _ in found[:1]}
    new_names = dict[int, dict[str, str]]()
    for index, own in local.items():
        elsewhere = set[str]()  # local to other files, and unknown in this one
        for other, names in local.items():
            if other != index:
                elsewhere |= names - visible - defined[index]
        new_names[index] = {name: f"{name}{IN_MODULE}99" for name in elsewhere}
        if index > 0:  # routines of the first file keep their names
            new_names[index] |= {name: f"{name}{IN_MODULE}{index}" for name in own}
    return new_names


def _translate_renamed(masked: str, renamed: dict[str, str]) -> list[tuple[int, Op]]:
    """Translate a statement after the routines that it calls got their new names.

    `masked` is the statement with NUL in place of each number. Each operation is given with its number of
    lines below the first line of the statement.
    """

    def rename(called: re.Match[str]) -> str:
        name = called[0]
        return renamed.get(capitalise(name), name)

    return LANGUAGE.translate(_CALLED.sub(rename, masked))


class _DataOfPrograms(NamedTuple):
    """Files of data (.dat), by the names of their programs in capitals."""

    files: dict[str, list[int]]  # indices of the files of data of each program
    private: dict[str, set[str]]  # names that only the program of the file knows
    shared: set[str]  # names that all programs know


def _note_names(statements: Statements, sources: tuple[Source, ...]) -> None:
    """Note the names that all programs know, and the names of data that each further .src has of its own.

    KSS: a .src knows the data of the .dat of its name, and of others those that are GLOBAL; the line of an
    element does not repeat the word. All programs know the data of $config.dat. In a further .src, a name
    that is private in the .dat of the first one means something else, too.
    """
    data = _collect_data(sources)
    statements.shared_names = frozenset(data.shared)
    main = _DEFINED.search(sources[0].text)
    private_of_main = data.private.get(capitalise(main[1]), set()) if main else set()
    for index, source in enumerate(sources[1:], 1):
        definition = _DEFINED.search(source.text)
        if definition is None or _DATA.search(source.text):
            continue
        program = capitalise(definition[1])
        owner_of_private = dict.fromkeys(data.private.get(program, ()), f"file{index}")
        statements.owners[index] = dict.fromkeys(private_of_main, OTHER_FILES) | owner_of_private
        if owner_of_private:
            for file_of_data in data.files[program]:
                statements.owners[file_of_data] = owner_of_private


def _collect_data(sources: tuple[Source, ...]) -> _DataOfPrograms:
    """Collect the names that the files of data among some files declare."""
    data = _DataOfPrograms(files=defaultdict(list), private={}, shared=set())
    for index, source in enumerate(sources):
        head = _DATA.search(source.text)
        if head is None:
            continue
        program = capitalise(head["program"])
        data.files[program].append(index)
        global_names = set(_find_shared_names(source.text))
        data.shared.update(global_names)
        is_config = source.name.lower().endswith("config.dat")
        if not is_config:
            data.private[program] = set(_find_private_names(source.text)) - global_names
    return data


LANGUAGE: Final = ir.Language(
    opening=r"\{[^{}]*",
    longest_line=508,  # KSS
    suffixes=".src .dat",
    pose=POSE,
    remark=";",
    head=r"[ \t]*+(?i:(?:GLOBAL[ \t]++)?DEF(?:FCT)?\b)",
    read=read_krl,
    comment=r";[^\r\n]*+|(?<![^\r\n])&[^\r\n]*+",
    text=r"\"[^\"\r\n]*+\"|#\w++|'[HD][0-9A-F]++'",
    word=r"\$?[^\W\d]\w*+",
    number=rf"{ir.NUMBER}|'B ?[01]{{1,16}}+'",
    operators="AND|OR|EXOR|NOT|B_AND|B_OR|B_EXOR|B_NOT",
    reserved=_RESERVED,
    # KSS: arithmetic, strings, the state of variables, pulses, what inline forms set speeds and collision
    # detection by, messages, channels, the number of the program; Ethernet KRL: connections; ArcTech: the
    # arc; LaserTech: laser and gas
    functions=r"ABS|SQRT|SIN|COS|TAN|ACOS|ATAN2|ROUND|TRUNC|INV_POS|VARSTATE|GET_SYSTEM_DATA|PULSE"
    r"|STR(?:ADD|CLEAR|COMP|COPY|DECLLEN|FIND|LEN)|S(?:VEL|ACC)_(?:JOINT|CP)|SAPO(?:_PTP)?|SORI_TYP"
    r"|S(?:GEAR_)?JERK|SLOAD|SIPO_MODE|SCIRC_TYPE|USE_CM_PRO_VALUES|SET_CD_PARAMS|(?:SET|CLEAR|EXISTS)_KRL(?:MSG|DLG)"
    r"|MSG(?:NOTIFY|QUIT|STATE|LOG)|C(?:OPEN|CLOSE)|P00"
    r"|EKI_(?:INIT|OPEN|CLOSE|CLEAR(?:BUFFER)?|CHECK(?:BUFFER)?|LOCK|UNLOCK|SEND|SET(?:BOOL|INT|REAL|STRING|FRAME))|ARC(?:MAINNG|GET\w+)|LSR\w+|GASDELAY",
    motion=r"\b(?:S?(?:PTP|LIN|CIRC|SPL)(?:_REL)?)(?!\w)",
    remedy=_REMEDY,
    undeclared="send the .dat that declares the name, and $config.dat; or write the numbers",
    active={"$BASE": "active $BASE", "$TOOL": "active $TOOL", "FDAT_ACT.IPO": ""},
    constants={name: np.eye(4) for name in ("$NULLFRAME", "$WORLD", "BASE_DATA[0]", "TOOL_DATA[0]")},
    field_endings=(".BASE", ".TOOL", ".IPO", ".CP"),
    # data of inline forms that no file gives state no fixed tool
    is_frame=lambda name: name.startswith(("BASE_DATA[", "TOOL_DATA[")) or name.endswith(".IPO"),
    # KSS: frames, and the data of inline forms, are active for all programs
    is_reached=lambda name: name.startswith(("$", "FDAT_ACT")),
    lasting=rf"(?:^|\bDO ){_MAY_MOVE_TARGETS.pattern}[^=]*=(?!=)",
    # frames and their data, asynchronous axes, and words of branches, loops and routines
    forgets=r"BASE|TOOL|FRAME|FDAT|\bBAS\b|\bASY"
    r"|\b(?:IF|THEN|ELSE\w*|SWITCH|CASE|DEFAULT|FOR|WHILE|LOOP|REPEAT|UNTIL|GOTO|EXIT|RETURN|DEF\w*|END\w*)\b",
    rules=(
        (
            rf"(?:GLOBAL )?DEF(?:FCT {_NAME}(?:\[\])?)? @{{name}}(?:\((?P<parameters>.*)\))?(?: ?PUBLIC)?",
            _translate_routine,
        ),
        (
            r"DEFDAT \w+(?: PUBLIC)?|ENDDAT|HALT|CONTINUE|INTERRUPT (?:ON|OFF)"
            r"|INTERRUPT (?:OFF|DISABLE) \0"
            r"|TIME_BLOCK (?:START|(?:PART|END)=.+)|CONST_VEL (?:START|END).*",
            "",
        ),
        (r"ENDSPLINE.*", lambda _: [ir.Assign(ir.FEED, ir.Copy(_FEED_OF_BLOCK))]),
        # KSS: a stop on the path until a condition is met
        (r"STOP WHEN PATH=((?:(?! ?\b(?:ONSTART|IF)\b).)+)(?: ?ONSTART)? ?IF (.+)", ""),
        (r"(?:EXT(?:FCT)?P?|ENUM|STRUC|IMPORT|(?:DECL )?(?:GLOBAL )?SIGNAL) [\w ,()\[\]:$.\0\"#]*", ""),
        (r"END|ENDFCT", "end"),
        (r"IF ?(.*?) ?THEN", "if"),
        (r"SWITCH ?(.+)", "switch"),
        (r"CASE ?(.+)", "branch"),
        (r"ELSE|DEFAULT", "default"),
        (r"ENDIF|ENDSWITCH|ENDFOR|ENDWHILE|ENDLOOP|UNTIL ?(.+)", "close"),
        (r"WHILE ?(?:TRUE|\(TRUE\))", "forever"),
        (r"WHILE ?(.+)", "loop"),
        (
            r"FOR @{name}=(?P<first>.+?) ?\bTO (?P<last>.+?)(?: ?\bSTEP (?P<step>.+))?",
            lambda line: ir.begin_counted_loop(line, _REMEDY),
        ),
        (r"LOOP", "forever"),
        (r"REPEAT", "repeat"),
        (r"EXIT", "leave"),
        (r"GOTO @{name}", "jump"),
        (r"@{name}:", "label"),
        (r"RETURN ?(.*)", "return"),
        # KSS: an interrupt's routine brakes the motion; RESUME also ends the routines that it interrupted
        (r"BRAKE(?: F)?", ""),
        (r"RESUME", "resume"),
        (
            r"ANOUT ON ((?:(?! ?\b(?:DELAY|MINIMUM|MAXIMUM)=).)+)"
            r"(?: ?(?:DELAY|MINIMUM|MAXIMUM)=[+-]?\0){1,3}",
            "",
        ),
        (r"WAIT (?:SEC|FOR) ?(.+)|ANOUT (?:ON|OFF) ?(.+)|(PULSE\(.*\))", ""),
        (
            rf"(?:GLOBAL )?INTERRUPT DECL (?:#{{number}}|{_NAME}) WHEN (?P<when>.+?)"
            rf" ?DO (?P<action>{_NAME}\(.*\))",
            _translate_attachment,
        ),
        (
            r"INTERRUPT (?:ON|ENABLE) #{number}",
            lambda line: [ir.Call(line.fill_name("INTERRUPT %s", "number"))],
        ),
        (rf"{_TRIGGER}(?P<action>{_NAME}\(.*\)(?: ?PRIO=.+)?)", _translate_attachment),
        (rf"{_TRIGGER}(?P<action>{_NAME}(?:\[[^\]=]*+\]|\.\w++)*=(?!=).+)", _translate_triggered_assignment),
        (
            r"(?:GLOBAL )?(?:INTERRUPT DECL|TRIGGER) .*",
            _translate_unknown_attachment,
        ),
        (r"BAS\(#(?P<function>\w+)(?:,(?P<argument>.+))?\)", _translate_bas),
        (
            r"(?:@{name}=)?(?P<function>(?:RSI|ST)_(?P<action>ON|OFF|MOVECORR))\((?P<arguments>.*)\)",
            _translate_sensor,
        ),
        (r"(?:PTP_)?SPLINE(?P<rest>(?: .*)?)", _translate_spline),
        (
            rf"(?:(?:DECL |GLOBAL |CONST )+{_NAME}|(?:GLOBAL )?(?:INT|REAL|BOOL|CHAR|FRAME"
            rf"|(?:E6)?(?:POS|AXIS)|[FPL]DAT|LOAD)) (?P<names>{_NAME}.*)",
            _translate_declaration,
        ),
        (
            rf"(?:(?P<status>{_NAME})=)?(?P<function>EKI_GET(?:BOOL|INT|REAL|STRING|FRAME)(?:ARRAY)?|[CS]READ|KRL_(?:[FS]SCANF|FGETS|FREAD)|CAST_(?:TO|FROM)|STRTO(?:INT|REAL))\((?P<arguments>.*)\)",
            _translate_reading,
        ),
        (
            rf"(?P<name>{_NAME})=(?P<function>INVERSE|FORWARD)\((?P<arguments>[^()]*),(?P<status>{_NAME})\)",
            _translate_kinematics,
        ),
        (r"TS_\w*(?:CALC|CORR)\w*\(.*\)", _translate_search),
        (r"@{name}\(.*\)", lambda line: line.read_expression(line.text)),
        (rf"(?P<name>{_NAME})(?P<index>(?:\[[^\]=]*+\]|\.\w++)*)=(?!=)(?P<value>.+)", _translate_assignment),
        (
            r"S?(?P<motion>PTP|LIN|CIRC|SPL)(?P<relative>_REL)?(?: |(?=\{))(?P<rest>.+)",
            _translate_move,
        ),
    ),
)
