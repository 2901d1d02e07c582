"""Programs of KUKA (KRL): .src with .dat, $config.dat and files of its routines, translated."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from typing import Final

import numpy as np

from robotprograms import language as ir
from robotprograms.columns import IN_MODULE, OF_ROUTINE
from robotprograms.errors import capitalise
from robotprograms.language import UNKNOWN_STATEMENT, Line, Misread, Op, split_outside_brackets
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
            ir.Assign("$BASE", ir.Copy("FDAT_ACT.BASE", through=True)),
            ir.Assign("$TOOL", ir.Copy("FDAT_ACT.TOOL", through=True)),
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
_FIELD: Final = re.compile(r"(\w+)(?:\[\])? ?(\0|TRUE|FALSE|\"[^\"]*\"|#\w+|'\w+')")
_SEPARATED: Final = re.compile(r" (?=[\0\w\"#'$])|(?<=\w):|(?<=\])(?=[\0\w\"#'$ ])|(?<=\[)(?=\])")
_OWN_FRAME: Final = re.compile(
    rf"\$(BASE|TOOL|IPO_MODE)=(?:(?:STOOL2?|SBASE|SIPO_MODE)\((?P<data>{_NAME})(?:\.\w+)?\)"
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
_SET_BEFORE_MOVE: Final = "set $TOOL and $BASE before the move"


_FEED_OF_BLOCK: Final = f"{ir.FEED} before the block"
"""Name of the feed that is active again behind a block of splines."""
_M_PER_S: Final = 1e3
"""Unit of `$VEL.CP` [mm/s]."""
_OWN_FEED: Final = re.compile(
    r"\$VEL(?:\.CP=(?P<value>.+)|=(?:(?P<struct>\{.*\})|SVEL_CP\((?P<data>.*)\)|.+))"
)
"""An assignment, or a setting of a single move, that sets the feed: also as a structure by its name."""


def _read_feed(line: Line, start: int, end: int) -> ir.Value | None:
    """Return the feed that a setting between two indices states; None if it sets no feed."""
    match = _OWN_FEED.fullmatch(line.text, start, end)
    if match is None:
        return None
    unknown = ir.Unknown("the feed is computed, or not stated", "write $VEL.CP in numbers")
    if match["struct"]:
        number = _read_struct(line, *match.span("struct")).get("CP")
        return Literal(_NUMBER, (number,)) if isinstance(number, int) else unknown
    if not (match["value"] or match["data"]):
        return unknown
    group = "value" if match["value"] else "data"
    begin, stop = next(iter(split_outside_brackets(line.text[: match.end(group)], match.start(group))))
    return _read_speed(line, begin, stop) or unknown


def _read_speed(line: Line, start: int, end: int) -> ir.Value | None:
    """Return the number or the name between two indices; None for any other value."""
    text = line.text[start:end].strip()
    if text == "\0":
        return Literal(_NUMBER, line.ordinals_in(start, end))
    return ir.Copy(text) if re.fullmatch(_NAME, text) and text not in {"TRUE", "FALSE"} else None


def _read_value(line: Line, text: str) -> list[Op]:
    """Return the operations of a value, which may be an expression or a structure `{...}`."""
    # The active frames are values, too; a routine may change the frames that it gets as arguments.
    if "(" not in text:
        text = re.sub(r"\$(?=(?:BASE|TOOL)\b)", "$ACTIVE_", text)
    return line.read_expression(_SEPARATED.sub(",", text) if text.startswith("{") else text)


def _read_struct(line: Line, start: int, end: int) -> dict[str, int | str]:
    """Return the fields of a structure `{...}` between two indices by name: ordinals of numbers, or texts.

    The ordinal of a number is its index among the numbers of the statement. The result is empty if a field is
    computed or occurs twice, or if the text is not a structure.
    """
    match = re.compile(r"\{(?:\w+:)?([^{}]*)\}").fullmatch(line.text, start, end)
    numbers, fields = iter(line.ordinals_in(start, end)), dict[str, int | str]()
    for first, last in split_outside_brackets(line.text[: match.end(1)], match.start(1)) if match else ():
        field = _FIELD.fullmatch(line.text, first, last)
        if field is None or field[1] in fields:
            return {}
        fields[field[1]] = next(numbers) if field[2] == "\0" else field[2]
    return fields


def _find_target_in_fields(fields: dict[str, int | str]) -> Literal | None:
    """Return the target that the fields state; None if they are neither a whole pose nor all joint angles."""
    # An integer is the ordinal of a number, a text is no number.
    numbers = {name: value for name, value in fields.items() if isinstance(value, int)}
    for notation, names in _POSES:
        if numbers.keys() >= set(names):
            external = tuple(numbers.get(f"E{i}", -1) for i in range(1, 7))
            status_and_turn = tuple((name, numbers[name]) for name in ("S", "T") if name in numbers)
            ordinals = tuple(numbers[name] for name in names)
            return Literal(notation, ordinals, external if max(external) >= 0 else (), status_and_turn)
    return None


def _copy_frames(target: str, source: str) -> list[Op]:
    """Return the operations that copy frame data, with their interpolation mode, to those of `target`."""
    return [ir.Assign(f"{target}.{role}", ir.Copy(f"{source}.{role}")) for role in ("BASE", "TOOL", "IPO")]


def _set_frame_data(name: ir.Name, numbers: dict[str, int], mode: str) -> list[Op]:
    """Return the operations that set fields of frame data: ordinals of BASE and TOOL, and `#BASE` or `#TCP`.

    KSS: with IPO_FRAME #TCP the tool is fixed in the cell, and the arm carries the part.
    """
    is_fixed, unknown = mode not in {"", "#BASE"}, ir.Unknown(_FIXED_TOOL, _FRAME_REMEDY)
    named = {role: ir.Named((f"{role}_DATA[%s]", number)) for role, number in numbers.items()}
    values: dict[str, ir.Value] = {"BASE": unknown, "TOOL": unknown} if is_fixed else {**named}
    frames: list[Op] = [ir.Assign(f"{name}.{role}", value) for role, value in values.items()]
    return [*frames, *([ir.Assign(f"{name}.IPO", unknown if is_fixed else ir.Named(""))] if mode else [])]


def _translate_value(line: Line, name: ir.Name, start: int, end: int) -> list[Op]:
    """Return the operations that assign the text between two indices to a name.

    The name gets numbers, the value of another name, or an unknown value.
    """
    text, fields = line.text[start:end], _read_struct(line, start, end)
    if pose := _find_target_in_fields(fields):
        return [ir.Assign(name, pose)]
    frames = {role: fields.get(f"{role}_NO") for role in ("BASE", "TOOL")}  # frame data, such as FDAT_ACT
    numbers = {role: number for role, number in frames.items() if isinstance(number, int)}
    if isinstance(name, str) and len(numbers) == len(frames):
        return _set_frame_data(name, numbers, str(fields.get("IPO_FRAME", "#BASE")))
    if name == "FDAT_ACT" and re.fullmatch(_NAME, text):
        return _copy_frames("FDAT_ACT", text)
    if name in {"$BASE", "$TOOL"} and re.fullmatch(_NAME, text):
        return [ir.Use(frozenset({text})), ir.Assign(name, ir.Copy(text))]
    if text == "\0":
        return [ir.Assign(name, Literal(_NUMBER, line.ordinals_in(start, end)))]
    if name in {"$BASE", "$TOOL"} and (match := _TABLE.fullmatch(text)) and match["role"] == str(name)[1:]:
        return [*line.read_expression(match["index"]), _copy_element(match["role"], match["index"])]
    element = _ELEMENT.fullmatch(text)
    if name in {"$BASE", "$TOOL"} and element and element["array"] != _OTHER_TABLE[str(name)]:
        copy = ir.Copy((text.replace("\0", "%s"), line.ordinals_in(start, end)[0]))
        return [ir.Use(frozenset({element["array"]})), ir.Assign(name, copy)]
    return [*_read_value(line, text), _forget_name(name)]


def _copy_element(role: str, index: str) -> Op:
    """Return the operation that makes a frame of the controller's table active, by a variable's value."""
    return ir.Assign(f"${role}", ir.Element(f"{role}_DATA[%s]", index))


def _forget_name(name: ir.Name) -> Op:
    """Return the operation by which the value of a name becomes unknown."""
    text = name if isinstance(name, str) else name[0] % "i"
    is_frame = text in {"$BASE", "$TOOL", "FDAT_ACT"} or "_DATA" in text
    reason = f"{text} changes while the program runs: it is computed, or set in part"
    return ir.MakeUnknown(frozenset({name}), reason, _FRAME_REMEDY if is_frame else _REMEDY)


def _translate_declaration(line: Line) -> list[Op]:
    """Return the operations of a declaration of one or several names, with or without values.

    Raises:
        Misread: the declaration is not understood.
    """
    ops: list[Op] = []
    shared = re.search(r"\bGLOBAL\b", line.text[: line.span("names")[0]]) is not None
    for start, end in split_outside_brackets(line.text, line.span("names")[0]):
        match = re.compile(rf"({_NAME})(?:\[(.*?)\])?(?:=(.+))?").fullmatch(line.text, start, end)
        if match is None or re.fullmatch(_RESERVED, match[1]):
            raise Misread("the declaration is unknown")
        name, index, value = match.groups()
        ops += [ir.Local(frozenset({name})), *line.read_expression(index or "")]
        if value and index is not None:  # one element of an array
            ops += [*_read_value(line, value), _forget_name(name)]
        elif value == "\0":  # other programs may have set a variable of a .dat since then
            literal = Literal(_NUMBER, line.ordinals_in(*match.span(3)))
            is_constant = re.search(r"\bCONST\b", line.text[: line.span("names")[0]]) is not None
            ops.append(
                ir.Assign(name, literal, declares="constant", shared=shared)
                if is_constant
                else _forget_name(name)
            )
        elif value:
            assigned = _translate_value(line, name, *match.span(3))
            ops += [op._replace(shared=shared) if isinstance(op, ir.Assign) else op for op in assigned]
    return ops


def _set_field_of_frames(line: Line) -> list[Op]:
    """Return the operations that set a single field of frame data, or the interpolation mode; else []."""
    if line.text in {"$IPO_MODE=#BASE", "$IPO_MODE=#TCP"}:
        is_fixed = line["value"] == "#TCP"
        return [ir.Assign(_IPO, ir.Unknown(_FIXED_TOOL, "omit the statement") if is_fixed else ir.Named(""))]
    match = _FIELD_OF_FRAMES.fullmatch(f"{line['index']}={line['value']}")
    if match is None:
        return []
    numbers = {match[1]: line.first_ordinal("value")} if match[1] else {}
    return _set_frame_data(line["name"], numbers, match["mode"] or "")


def _translate_assignment(line: Line) -> list[Op]:
    """Return the operations of an assignment; setting one element or field makes the whole name unknown.

    Raises:
        Misread: a system variable that may move targets is set, or the index of a frame is computed.
    """
    name, index = line["name"], line["index"]
    target: ir.Name = name
    if name in {"BASE_DATA", "TOOL_DATA"} and not index.startswith("[\0]"):
        raise Misread(f"the index of {name} is computed", _FRAME_REMEDY)
    if index.startswith("[\0]") and not name.startswith("$"):  # one element
        target, index = (f"{name}[%s]", line.first_ordinal("index")), index.removeprefix("[\0]")
    elif found := _set_field_of_frames(line):
        return found
    elif name in {"$ACT_BASE", "$ACT_TOOL"} and not index:  # BAS copies them where it sets frames
        active: ir.Name = name.replace("ACT_", "")
        statement = ir.quote_statement(line.text, line.ordinals)
        reason = f"{statement}: the controller's variable {name} may move targets"
        return [
            *_read_value(line, line["value"]),
            ir.MakeUnknown(frozenset({active, name}), reason, "omit the statement"),
        ]
    elif _MAY_MOVE_TARGETS.match(line.text):
        raise Misread(f"the controller's variable {name} may move targets", "omit the statement")
    return _assign(line, target, index)


def _assign(line: Line, target: ir.Name, index: str) -> list[Op]:
    """Return the operations that assign to a name, or to one of its elements or fields by an index."""
    name = line["name"]
    # The indices of elements are expressions; all of them are read as one expression.
    indices = index.strip("[]").replace("][", ",").replace("].", "+") if "[" in index else ""
    uses = line.read_expression(indices)
    is_system_variable = name.startswith("$") and name not in {"$BASE", "$TOOL"}
    if name in _TURNS_TOOL and line["value"] not in {"FALSE", "#VAR"}:
        statement = ir.quote_statement(line.text, line.ordinals)
        uses.append(
            ir.Note(
                f"{statement}: after this line the arm does not reach the orientations that the "
                "program states"
            )
        )
    if index or is_system_variable:
        changes: list[Op] = [] if is_system_variable else [_forget_name(target)]
        if name == "$VEL" and (feed := _read_feed(line, 0, len(line.text))):
            changes = [ir.Assign(ir.FEED, feed)]
        return [*uses, *_read_value(line, line["value"]), *changes]
    return [*uses, *_translate_value(line, target, *line.span("value"))]


def _read_target(line: Line, start: int, end: int) -> Literal | ir.Name | None:
    """Return the target between two indices: a variable, an element of an array, or numbers; else None."""
    text = line.text[start:end]
    if re.fullmatch(_NAME, text) and not re.fullmatch(_RESERVED, text):
        return text
    if _ELEMENT.fullmatch(text):
        return text.replace("\0", "%s"), line.ordinals_in(start, end)[0]
    return _find_target_in_fields(_read_struct(line, start, end))


def _translate_move(line: Line) -> list[Op]:
    """Return the operations of a move; a move that is relative or has no complete target is not corrected.

    Raises:
        Misread: there is no target, or the settings of the move are unknown.
    """
    motion, begin = _MOTIONS[line["motion"]], line.span("rest")[0]
    whole = re.sub(_AXES_OF_STEP, "", line.text) if line["relative"] else line.text
    end, settings = _find_end_of_targets(whole, begin)
    if end == begin:
        raise Misread(_NOT_WHOLE)
    found, own_frames = _read_settings(line, *settings)
    targets: list[Literal | ir.Name | None] = []
    for start, stop in split_outside_brackets(line.text[:end], begin):
        name = line.text[start:stop]
        if len(targets) == 2 and name.startswith("CA "):
            angle = line.read_expression(name.removeprefix("CA "))
            found += [*angle, ir.Note("the arc ends at its angle CA, not at the second of its targets")]
            continue
        if _STORED_POSITION.fullmatch(name):
            if name != line.text[begin:end]:  # one of the two targets of an arc
                raise Misread("the arc goes through a position stored in the controller")
            return [*found, ir.MoveToStored(name)]
        targets.append(_read_target(line, start, stop))
    known = tuple(each for each in targets if each is not None)
    base, tool = (own_frames.get(role, ir.Copy(f"${role}")) for role in ("BASE", "TOOL"))
    own_feed = _find_own_feed(line, *settings) or ir.Copy(ir.FEED)
    feed = ir.Feed(own_feed, _M_PER_S) if isinstance(own_feed, Literal | ir.Copy) else None
    if line["relative"] or len(known) < len(targets) or len(known) != 1 + (motion is Motion.CIRCULAR):
        reason = "the target is relative to the position before the move" if line["relative"] else _NOT_WHOLE
        step = re.sub(_AXES_OF_STEP, "", line.text[begin:end])
        near = _NEAR.fullmatch(step)
        found += line.read_expression(_SEPARATED.sub(",", near["offset"] if near else step))
        if near is None or re.fullmatch(_RESERVED, near["target"]):
            return ir.make_uncorrected_move(found, reason, _REMEDY)
        reason = f"the target is at an offset from {near['target']}"
        offset_from = (near["target"],)
        return [
            *found,
            ir.Move(motion, (), (base,), (tool,), reason=reason, remedy=_REMEDY, offset_from=offset_from),
        ]
    return [*found, ir.Move(motion, known, (base,) * len(known), (tool,) * len(known), feed=feed)]


def _find_own_feed(line: Line, begin: int, end: int) -> ir.Value | None:
    """Return the feed that the settings after WITH, between two indices, state; None if they state none.

    The last one counts: a number may follow a structure.
    """
    spans = split_outside_brackets(line.text[:end], begin) if begin < end else ()
    feeds = [_read_feed(line, *each) for each in spans]
    return next((each for each in reversed(feeds) if each is not None), None)


def _find_end_of_targets(text: str, begin: int) -> tuple[int, tuple[int, int]]:
    """Return the index where the targets of a move end, and the span of its settings after WITH.

    The targets begin at index `begin`. The span is empty if there are no settings.
    """
    match = _WITH.search(text, begin)
    if match is None:
        return _strip_blends(text, begin, len(text)), (len(text), len(text))
    settings = match.end(), _strip_blends(text, match.end(), len(text))
    return _strip_blends(text, begin, match.start()), settings


def _strip_blends(text: str, begin: int, end: int) -> int:
    """Return the end of the text after words of approximate positioning, such as C_DIS, are cut off."""
    while match := _BLEND.search(text, max(begin, end - _LONGEST_BLEND), end):
        if match.end() < end:
            break
        end = match.start()
    return end


def _read_settings(line: Line, begin: int, end: int) -> tuple[list[Op], dict[str, ir.Copy]]:
    """Return the operations of the settings after WITH, and the frames that are set for this move only.

    The settings are the text between two indices; the frames have the keys BASE and TOOL.

    Raises:
        Misread: a setting is unknown, calls a routine, or takes only one of base and tool from frame data.
    """
    found, frames, data = list[Op](), dict[str, ir.Copy](), dict[str, str]()
    for start, stop in split_outside_brackets(line.text[:end], begin) if begin < end else ():
        setting = line.text[start:stop]
        match = _OWN_FRAME.fullmatch(setting)
        role = match[1] if match else ""
        if match and match["data"]:
            data[role] = match["data"]
            frames[role] = ir.Copy(f"{match['data']}.{role}", through=True)
        elif match and match["table"] == f"{role}_DATA":
            frames[role] = ir.Copy((f"{role}_DATA[%s]", line.ordinals_in(start, stop)[0]))
        elif match and match["name"] and role != "IPO_MODE":
            found.append(ir.Use(frozenset({match["name"]})))
            frames[role] = ir.Copy(match["name"])
        elif (
            not setting.startswith("$")
            or _MAY_MOVE_TARGETS.match(setting)
            or setting.startswith(("$BASE", "$TOOL"))
        ):
            raise Misread(
                "a setting after WITH is unknown, or sets a frame for this move only", _SET_BEFORE_MOVE
            )
        else:
            found += _read_value(line, setting.partition("=")[2])
    has_both = data.keys() >= {"BASE", "TOOL"} and len(set(data.values())) == 1
    if ir.calls_routine(found) or (data and not has_both):
        raise Misread(
            "the settings after WITH call a routine, or set only one of tool and base", _SET_BEFORE_MOVE
        )
    return found, frames


def _translate_spline(line: Line) -> list[Op]:
    """Return the operations that begin a block of splines, whose feed may be its own.

    If the block sets its own frames, base and tool become unknown.

    Raises:
        Misread: the statement has a target, or unknown settings.
    """
    begin = line.span("rest")[0]
    end, settings = _find_end_of_targets(line.text, begin)
    if end > begin:
        raise Misread(UNKNOWN_STATEMENT)
    found, own_frames = _read_settings(line, *settings)
    found.append(ir.Assign(_FEED_OF_BLOCK, ir.Copy(ir.FEED)))
    own_feed = _find_own_feed(line, *settings)
    found += [ir.Assign(ir.FEED, own_feed)] if own_feed else []
    reason, remedy = "the block of splines has frames of its own", "set $BASE and $TOOL before the block"
    return [*found, *([ir.MakeUnknown(frozenset({"$BASE", "$TOOL"}), reason, remedy)] if own_frames else [])]


def _translate_sensor(line: Line) -> list[Op]:
    """Return the operations by which a sensor guides the arm, or ends to guide (KUKA RSI)."""
    found = line.read_expression(line["arguments"]) if line["arguments"] else []
    found += [_forget_name(line["name"])] if line["name"] else []
    found.append(ir.Call(line["function"], _find_names(found), harmless=True))  # of the program itself
    if line["action"] == "OFF":
        return [*found, ir.end_lasting("RSI")]
    reason, remedy = "a sensor moves the targets (RSI)", "omit the statement"
    if line["action"] == "MOVECORR":  # the motion is that of the sensor alone, and ends here
        return ir.make_uncorrected_move(found, reason, remedy)
    return [*found, ir.begin_lasting("RSI", reason, remedy)]


def _translate_search(line: Line) -> list[Op]:
    """Return the operations of a routine that corrects the moves behind it by a search (KUKA TouchSense)."""
    lasting = ir.begin_lasting("TS", "a touch search corrects the targets", "omit the statement")
    return [*line.read_expression(line.text), lasting]


def _translate_routine(line: Line) -> list[Op]:
    """Return the operations that begin a routine and declare its parameters."""
    names = re.findall(rf"({_NAME})(?::\w+)?", line["parameters"])
    return ir.begin_routine(line["name"], names, _REMEDY, shared=line.text.startswith("GLOBAL"))


def _translate_attachment(line: Line) -> list[Op]:
    """Return the operations of an interrupt or a trigger, whose routine may run at any time."""
    # A trigger has no number; the number of an interrupt gives a name by which it is switched on.
    # KSS: a trigger acts on the path of the move behind it, which is planned before, with its frames.
    # A variable in place of its number does not show where the interrupt is switched on.
    event: ir.Name = "TRIGGER" if line.text.startswith("TRIGGER") else ""
    if line["number"]:
        event = "INTERRUPT %s", line.first_ordinal("number")
    action = re.sub(r" ?\bPRIO=", "+", line["action"])
    found = ir.mark_anytime([*line.read_expression(line["when"]), *line.read_expression(action)], event)
    # BAS: IR_STOPM only stops the robot and waits.
    return [
        op._replace(harmless=op.harmless or op.name == "IR_STOPM", behind_next=event == "TRIGGER")
        if isinstance(op, ir.Call)
        else op
        for op in found
    ]


def _translate_unknown_attachment(line: Line) -> list[Op]:
    """Return the calls of an attachment that is not understood: its routines may run at any time."""
    names = [line.text.replace("\0", "n"), *re.findall(rf"(?<![\w$])({_NAME})\(", line.text)]
    return [ir.Call(name, anytime=True) for name in names]


def _translate_triggered_assignment(line: Line) -> list[Op]:
    """Return the operations of a trigger that assigns a value: the name may change at any time.

    KSS: what is triggered is an assignment, a pulse of an output, or a call of a routine.
    """
    start, end = line.span("action")
    action = Line(line.language, line["action"], line.ordinals_in(start, end))
    found = line.language.apply_rules(action)
    name = line["action"].partition("=")[0]
    changed: list[Op] = [
        ir.MakeUnknown(frozenset({op.name}), f"{name} changes at a trigger", _REMEDY, anytime=True)
        for op in found
        if isinstance(op, ir.Assign)
    ]
    return [
        *changed,
        *(op._replace(anytime=True) if isinstance(op, ir.MakeUnknown) else op for op in found
          if not isinstance(op, ir.Assign)),
    ]  # fmt: skip


def _translate_bas(line: Line) -> list[Op]:
    """Return the operations of a call of `BAS`, which sets frames, speeds and accelerations.

    Raises:
        Misread: the function is unknown, or its argument is not a number.
    """
    function, argument = line["function"], line["argument"]
    if function in {"TOOL", "BASE"} and argument == "\0":
        return [ir.Assign(f"${function}", ir.Copy((f"{function}_DATA[%s]", line.first_ordinal("argument"))))]
    if function in {"TOOL", "BASE"} and argument:
        is_variable = re.fullmatch(r"[^\W\d]\w*+", argument)
        change = _copy_element(function, argument) if is_variable else _forget_name(f"${function}")
        return [*line.read_expression(argument), change]
    if function not in _BAS:
        raise Misread(f"BAS(#{function}) is unknown, or its argument is not a number")
    changes = _BAS[function]
    if function in {"VEL_CP", "CP_PARAMS"}:  # BAS: both set $VEL.CP
        unknown = ir.Unknown("the feed is computed, or not stated", "write $VEL.CP in numbers")
        speed = _read_speed(line, *line.span("argument")) if argument else None
        changes = (*changes, ir.Assign(ir.FEED, speed or unknown))
    return [*line.read_expression(argument), *changes]


def _translate_reading(line: Line) -> list[Op]:
    """Return the operations of a function that reads values from outside into its arguments."""
    used = [op for op in line.read_expression(line["arguments"]) if isinstance(op, ir.Use)]
    names = frozenset(each for op in used for each in op.names) | {line["status"] or "_"}
    own = ir.Call(line["function"], _find_names(list(used)), harmless=True)  # of the program itself
    return [own, ir.MakeUnknown(names, "the value is read from outside while the program runs", _REMEDY)]


def _find_names(found: list[Op]) -> frozenset[str]:
    """Return the names that operations of expressions use."""
    used = (each for op in found if isinstance(op, ir.Use) for each in op.names)
    return frozenset(each for each in used if isinstance(each, str))


def _translate_kinematics(line: Line) -> list[Op]:
    """Return the operations of a calculation of joint angles or of a pose, whose last argument gets an error.

    Source: KSS, INVERSE and FORWARD: they read the active base and tool, and change neither.
    """
    found = ir.pass_uses(line.read_expression(line["arguments"]), line["name"])
    names = frozenset({line["name"], line["status"]})
    own = ir.Call(line["function"], _find_names(found) | names, harmless=True)  # of the program itself
    return [*found, own, ir.MakeUnknown(names, "the value is calculated while the program runs", _REMEDY)]


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
_DATA: Final = re.compile(rf"{_LINE}DEFDAT[ \t]++({_NAME})([ \t]++PUBLIC\b)?")
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
    """Yield the names that a .dat declares without GLOBAL."""
    for line in _LINE_END.split(capitalise(text)):
        if not _NO_DATA.match(line):
            yield from _list_declared(line)


def _list_declared(line: str) -> Iterator[str]:
    """Yield the names that a line declares, or of whose elements or fields it has one."""
    plain, count = _NO_NAME.sub("", line), 1
    while count:  # braces within one another, from the inside
        plain, count = _BRACES.subn("", plain)
    for part in plain.split(","):
        if match := re.search(rf"({_NAME})(?:\.\w++)*\s*+\Z", part.partition("=")[0]):
            yield match[1]


def _find_shared_names(text: str) -> Iterator[str]:
    """Yield the names that a .dat declares as GLOBAL."""
    for line in _LINE_END.split(capitalise(text)):
        if _GLOBAL.match(line):
            yield from _list_declared(line)


def read_krl(statements: Statements, sources: tuple[Source, ...]) -> None:
    """Add the statements of a .src and of the files sent with it: .dat, $config.dat, .src with routines.

    Raises:
        ProgramError: a .dat belongs to another program.
    """
    programs = [_DEFINED.search(each.text) for each in sources if not each.name.lower().endswith(".dat")]
    main, *others = [capitalise(match[1]) if match else "" for match in programs] or [""]
    statements.by_value = _find_routines_by_value(sources)
    renamed = dict[int, dict[str, str]]()
    if len(sources) > 1:
        _note_names(statements, sources)
        renamed = _rename_local_routines(sources)
    for index, source in enumerate(sources):
        is_config = source.name.lower().endswith("config.dat")
        data = _DATA.search(source.text) if index else None
        starts, ends = source.starts, source.ends
        declares = source.name.lower().endswith(".dat") and len(sources) > 1
        # Only a .dat that is public, and $config.dat, can be changed by other programs.
        kind = "shared" if is_config else "variable" if data and data[2] else "constant"
        if main and data and not is_config and capitalise(data[1]) != main:
            if not (data[2] or capitalise(data[1]) in others):
                reason, remedy = (
                    f"the file declares data of {data[1]}, not of {programs[0][1] if programs[0] else main}",
                    "send the .dat file of this .src file",
                )
                statements.refuse(source.find_line(data.start()), reason, remedy, index)
            # Of the data of another program, only those declared as GLOBAL are data of this one.
            spans = zip(starts.tolist(), ends.tolist(), strict=True)
            seen = np.array([bool(_GLOBAL.match(source.text, *each)) for each in spans], dtype=np.bool_)
            if statements.owners.get(index):
                statements.add_statements(index, starts[~seen], ends[~seen], declares=kind)
            starts, ends = starts[seen], ends[seen]
        translate = partial(_translate_renamed, renamed=renamed[index]) if renamed.get(index) else None
        statements.add_statements(index, starts, ends, declares=kind if declares else "", translate=translate)
    files = sources[1:]  # a program alone imports nothing that changes here
    imported = {capitalise(name) for each in files for pair in _IMPORT.findall(each.text) for name in pair}
    owners = {f"{OF_ROUTINE}{owner}" for each in statements.owners.values() for owner in each.values()}
    names = frozenset(f"{name}{owner}" for name in imported for owner in ("", *owners))
    statements.forget_anytime(names, "a program imports the name of another one, and may change it", _REMEDY)


def _find_routines_by_value(sources: tuple[Source, ...]) -> frozenset[str]:
    """Return the routines whose declarations by EXT or EXTFCT all state `:IN` for each parameter."""
    by_value, by_reference = set[str](), set[str]()
    for name, parameters in (found for source in sources for found in _DECLARED.findall(source.text)):
        are_copies = all(_BY_VALUE.fullmatch(each) for each in parameters.split(","))
        (by_value if are_copies else by_reference).add(capitalise(name))
    return frozenset(by_value - by_reference)


def _rename_local_routines(sources: tuple[Source, ...]) -> dict[int, dict[str, str]]:
    """Return new names of routines that are known in one file only, by the index of each file.

    KSS: other files know the first routine of a file, and those that are GLOBAL.
    """
    routines = {
        i: [(bool(word), capitalise(name)) for word, name in _ROUTINES.findall(each.text)]
        for i, each in enumerate(sources)
        if not _DATA.search(each.text)
    }
    visible = {
        name for found in routines.values() for k, (is_global, name) in enumerate(found) if is_global or not k
    }
    local = {i: {name for is_global, name in found[1:] if not is_global} for i, found in routines.items()}
    renamed = dict[int, dict[str, str]]()
    for i, own in local.items():
        known = visible | {name for _, name in routines[i]}
        others = set[str]().union(*(each for k, each in local.items() if k != i)) - known
        renamed[i] = {name: f"{name}{IN_MODULE}99" for name in others}
        renamed[i] |= {name: f"{name}{IN_MODULE}{i}" for name in own if i}
    return renamed


def _translate_renamed(masked: str, renamed: dict[str, str]) -> list[tuple[int, Op]]:
    """Return the operations of a statement in which routines of one file have other names."""

    def rename(match: re.Match[str]) -> str:
        return renamed.get(capitalise(match[0]), match[0])

    return LANGUAGE.translate(_CALLED.sub(rename, masked))


def _note_names(statements: Statements, sources: tuple[Source, ...]) -> None:
    """Note the names that all programs know, and the names of data that each further .src has of its own.

    KSS: a .src knows the data of the .dat of its name, and of others those that are GLOBAL; the line of an
    element does not repeat the word. All programs know the data of $config.dat. In a further .src, a name
    that is private in the .dat of the first one means something else, too.
    """
    data = {each.name: _DATA.search(each.text) for each in sources}
    shared = {each.name: set(_find_shared_names(each.text)) for each in sources if data[each.name]}
    private = {
        capitalise(match[1]): set(_find_private_names(each.text)) - shared[each.name]
        for each in sources
        if (match := data[each.name]) and not each.name.lower().endswith("config.dat")
    }
    statements.shared_names = frozenset().union(*shared.values())
    programs = [_DEFINED.search(each.text) for each in sources]
    of_main = private.get(capitalise(programs[0][1]), set()) if programs[0] else set()
    for index, source in enumerate(sources[1:], 1):
        if not data[source.name] and (match := programs[index]):
            name = capitalise(match[1])
            own = dict.fromkeys(private.get(name, ()), f"file{index}")
            statements.owners[index] = dict.fromkeys(of_main, OTHER_FILES) | own
            for k, each in enumerate(sources):
                if own and (found := data[each.name]) and capitalise(found[1]) == name:
                    statements.owners[k] = own


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
            lambda line: [ir.Call(("INTERRUPT %s", line.first_ordinal("number")))],
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
