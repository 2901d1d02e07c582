"""Programs of KUKA (KRL): .src with .dat, $config.dat and files of its routines, translated."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from robotprograms import language as ir
from robotprograms.arrays import BoolArray, IndexArray
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
_NUMBER_AS_INDEX: Final = f"[{ir.A_NUMBER}]"
"""The index of `A[3]` in the normal form of a statement, where NUL is in place of each number."""
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
_FIELD_OF_FRAMES: Final = re.compile(r"\.(?:(?P<role>BASE|TOOL)_NO=\0|IPO_FRAME=(?P<mode>#(?:BASE|TCP)))")
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
    """Return the feed (speed of the tool's centre) that a setting states; None if it sets something else.

    KRL writes the feed as `$VEL.CP=0.2`, in a structure `$VEL={CP 0.2,ORI1 200}`, or in an inline form
    `$VEL=SVEL_CP(0.2,...)`. A feed that is computed is an unknown value.
    """
    match = _OWN_FEED.fullmatch(setting.text)
    if match is None:
        return None
    if match["structure"]:  # {CP 0.2,ORI1 200}
        return _read_feed_in_structure(setting.cut(*match.span("structure")))
    if match["value"]:  # the 0.2 of $VEL.CP=0.2
        return _read_first_speed(setting.cut(*match.span("value")))
    if match["data"]:  # the 0.2,... of SVEL_CP(0.2,...), whose first argument is the feed
        return _read_first_speed(setting.cut(*match.span("data")))
    return _UNKNOWN_FEED


def _read_first_speed(values: Line) -> ir.Value:
    """Return the first one of some values, such as `0.2,100`, as a speed; unknown if it is computed."""
    first_value, *_ = values.split()
    return _read_speed(first_value) or _UNKNOWN_FEED


def _read_feed_in_structure(structure: Line) -> ir.Value:
    """Return the feed CP of a structure of speeds such as `{CP 0.2,ORI1 200}`; unknown if it has none."""
    ordinal = _read_structure(structure).get("CP")
    if isinstance(ordinal, int):
        return Literal(_NUMBER, (ordinal,))
    return _UNKNOWN_FEED


def _read_speed(part: Line) -> ir.Value | None:
    """Return the speed that a text states: a number or a name; None for any other text."""
    if part.is_number:
        return Literal(_NUMBER, part.ordinals)
    text = part.text.strip()
    is_name = re.fullmatch(_NAME, text) and text not in {"TRUE", "FALSE"}
    return ir.Copy(text) if is_name else None


def _read_value(line: Line, text: str) -> list[Op]:
    """Translate a value such as `A+F(B)` or `{X A,Y 2}` into uses of its names and calls of its routines.

    The active frame is an exception: `P1.X=$BASE.X` only reads $BASE, and is no use of it, so that $BASE gets
    another name here. In `P1=F($BASE)` the routine may change the frame: this is a use.

    Args:
        line: the statement.
        text: the value.
    """
    calls_routine = "(" in text
    if not calls_routine:
        text = re.sub(r"\$(?=(?:BASE|TOOL)\b)", "$ACTIVE_", text)
    is_structure = text.startswith("{")
    if is_structure:
        text = _SEPARATED.sub(",", text)  # `{X A,Y 2}` becomes a list of expressions, `{X,A,Y,2}`
    return line.read_expression(text)


def _read_structure(part: Line) -> dict[str, int | str]:
    """Parse a structure such as `{X 1,Y 2,S "on"}` into its fields by their names.

    Statements that differ in their numbers only are translated once. So the value of a field such as X is not
    the number itself, but its ordinal: its index among the numbers of the statement.

    Returns:
        Ordinal of the number of each field, or the text of a field that is no number. The dictionary is empty
        if the text is not a structure, if a field is computed, or if a field occurs twice.
    """
    structure = re.fullmatch(r"\{(?:\w+:)?(?P<fields>[^{}]*)\}", part.text)
    if structure is None:
        return {}
    value_of_field = dict[str, int | str]()
    for field in part.cut(*structure.span("fields")).split():
        match = _FIELD.fullmatch(field.text)  # name and value, such as `X 1`
        if match is None or match["name"] in value_of_field:
            return {}
        is_number = match["value"] == ir.A_NUMBER
        value_of_field[match["name"]] = field.ordinals[0] if is_number else match["value"]
    return value_of_field


def _find_target_in_fields(fields: dict[str, int | str]) -> Literal | None:
    """Return the target of a structure; None if it is neither a whole pose nor all joint angles.

    `{X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 35,E1 7}` is a whole pose, with status S and turn T of the arm, and the
    external axis E1. The target has ordinals in place of the numbers: those of pose or joint angles, those of
    E1 ... E6 (-1 where one is absent; none if all are), and those of S and T by their names.

    Args:
        fields: fields of the structure, as `_read_structure` returns them: ordinals of numbers, or texts.
    """
    ordinals = {name: value for name, value in fields.items() if isinstance(value, int)}
    external_axes = tuple(ordinals.get(f"E{i}", -1) for i in range(1, 7))
    is_any_axis_stated = max(external_axes) >= 0
    if not is_any_axis_stated:
        external_axes = ()
    status_and_turn = tuple((name, ordinals[name]) for name in ("S", "T") if name in ordinals)
    for notation, names in _POSES:
        if ordinals.keys() >= set(names):
            numbers = tuple(ordinals[name] for name in names)
            return Literal(notation, numbers, external_axes, status_and_turn)
    return None


def _copy_frames(target: str, source: str) -> list[Op]:
    """Translate `FDAT_ACT=FP1`: the frame data FDAT_ACT (`target`) get those of FP1 (`source`).

    Frame data have three fields, and each becomes a copy: base, tool and interpolation mode.
    """
    return [ir.Assign(f"{target}.{field}", ir.Copy(f"{source}.{field}")) for field in ("BASE", "TOOL", "IPO")]


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
    """Translate the assignment of a value to a name.

    * `N=5`: the name gets the number;
    * `P1={X 1,Y 2,...}`: it gets a whole pose, or all joint angles;
    * `FDAT_ACT={TOOL_NO 1,BASE_NO 2,...}` and `$BASE=MY_FRAME`: it gets frames;
    * `P1=P2`, `N=N+1` or `P1={X 1}`: it gets an unknown value, because such values are not followed.
    """
    if value.is_number:
        return [ir.Assign(name, Literal(_NUMBER, value.ordinals))]
    fields = _read_structure(value)
    if target := _find_target_in_fields(fields):
        return [ir.Assign(name, target)]
    frames = list[Op]()
    if isinstance(name, str):  # not an element of an array, which is no frame that is followed
        frames = _set_all_frame_data(name, fields) or _copy_active_frame(name, value)
    return frames or [*_read_value(value, value.text), _forget_name(name)]


def _copy_active_frame(name: str, value: Line) -> list[Op]:
    """Translate the assignment of a variable to the active frames: `$BASE=MY_FRAME`, or `FDAT_ACT=FP1`.

    FDAT_ACT has the active base and tool of an inline form. The list is empty for any other name or value.
    """
    is_variable = re.fullmatch(_NAME, value.text) is not None
    if name == "FDAT_ACT" and is_variable:
        return _copy_frames("FDAT_ACT", value.text)
    return _activate_frame(name, value) if name in {"$BASE", "$TOOL"} else []


def _set_all_frame_data(name: str, fields: dict[str, int | str]) -> list[Op]:
    """Translate `FDAT_ACT={TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE}`: the frame data of an inline form.

    The list is empty if the fields, as `_read_structure` returns them, are not numbers of both frames.
    """
    numbers_of_frames = dict[str, int]()  # ordinals
    for role in ("BASE", "TOOL"):
        number = fields.get(f"{role}_NO")
        if isinstance(number, int):
            numbers_of_frames[role] = number
    if len(numbers_of_frames) < 2:
        return []
    return _set_frame_data(name, numbers_of_frames, str(fields.get("IPO_FRAME", "#BASE")))


def _activate_frame(active: str, value: Line) -> list[Op]:
    """Translate the assignment of a frame to `$BASE` or `$TOOL`, which is the name `active`.

    * `$BASE=MY_FRAME`: a copy of the variable;
    * `$BASE=BASE_DATA[I]`: the element whose number is the value of I;
    * `$BASE=FRAMES[3]`: the element with this number, of the controller's table or of an array.

    The list is empty for any other value, also for an element of the table for the other one of the two:
    `$BASE=TOOL_DATA[3]`.
    """
    is_variable = re.fullmatch(_NAME, value.text) is not None
    if is_variable:
        return [ir.Use(frozenset({value.text})), ir.Assign(active, ir.Copy(value.text))]
    by_variable = _TABLE.fullmatch(value.text)
    if by_variable and f"${by_variable['role']}" == active:
        index = by_variable["index"]
        return [*value.read_expression(index), _copy_element(by_variable["role"], index)]
    by_number = _ELEMENT.fullmatch(value.text)
    if by_number and by_number["array"] != _OTHER_TABLE[active]:
        return _activate_element(active, by_number["array"], value)
    return []


def _activate_element(active: str, array: str, element: Line) -> list[Op]:
    """Translate `$BASE=FRAMES[3]`: element 3 of the array FRAMES becomes the frame `active`, here $BASE."""
    frame = element.fill_name(f"{array}[%s]")
    return [ir.Use(frozenset({array})), ir.Assign(active, ir.Copy(frame))]


def _copy_element(role: str, index: str) -> Op:
    """Return the assignment `$BASE=BASE_DATA[i]` with a variable i as `index`; `role` is BASE or TOOL."""
    return ir.Assign(f"${role}", ir.Element(f"{role}_DATA[%s]", index))


def _forget_name(name: ir.Name) -> Op:
    """Return the operation that makes the value of a name unknown, with the reason and a remedy.

    The message writes an element of an array as `A[i]`. The remedy for a frame is another one than for a
    target.
    """
    text = name if isinstance(name, str) else name.template % "i"
    is_frame = text in {"$BASE", "$TOOL", "FDAT_ACT"} or "_DATA" in text
    remedy = _FRAME_REMEDY if is_frame else _REMEDY
    reason = f"{text} changes while the program runs: it is computed, or set in part"
    return ir.MakeUnknown(frozenset({name}), reason, remedy)


def _translate_declaration(line: Line) -> list[Op]:
    """Translate a declaration such as `DECL POS P1={X 1,...},P2,A[3]` (the line's group `names`: from P1 on).

    Raises:
        Misread: the declaration is not understood.
    """
    ops = list[Op]()
    for part in line.part("names").split():
        ops += _declare_variable(line, part)
    return ops


def _declare_variable(declaration: Line, part: Line) -> list[Op]:
    """Translate the part of a declaration that declares one variable, such as `P1={X 1,...}` or `A[3]`.

    The name becomes a local variable of its routine. It also gets its value, if there is one; a value of a
    single element, as in `A[1]=5`, makes the value of the whole array unknown.

    Raises:
        Misread: the part is not understood.
    """
    declared = _DECLARED_NAME.fullmatch(part.text)  # name, index in brackets and value behind `=`
    if declared is None or re.fullmatch(_RESERVED, declared["name"]):
        raise Misread("the declaration is unknown")
    name, index = declared["name"], declared["index"] or ""
    ops: list[Op] = [ir.Local(frozenset({name})), *declaration.read_expression(index)]
    value = part.cut(*declared.span("value"))
    if not value.text:
        return ops
    is_element = declared["index"] is not None
    if is_element:
        return [*ops, *_read_value(declaration, value.text), _forget_name(name)]
    return [*ops, *_declare_value(declaration, name, value)]


def _declare_value(declaration: Line, name: str, value: Line) -> list[Op]:
    """Translate the value that a declaration gives to a name, as in `DECL GLOBAL CONST INT N=3`.

    A number of a variable in a .dat is unknown when the program runs: another program may have set it since.
    Only a CONST keeps its number. Poses and frames are taken as they are declared. Other programs know the
    names of a GLOBAL declaration, too: they are shared.
    """
    words_before_names = declaration.text.removesuffix(declaration["names"])
    is_shared = re.search(r"\bGLOBAL\b", words_before_names) is not None
    is_constant = re.search(r"\bCONST\b", words_before_names) is not None
    if value.is_number and is_constant:
        number = Literal(_NUMBER, value.ordinals)
        return [ir.Assign(name, number, declares="constant", shared=is_shared)]
    if value.is_number:
        return [_forget_name(name)]
    ops = list[Op]()
    for op in _translate_value(name, value):
        ops.append(op._replace(shared=is_shared) if isinstance(op, ir.Assign) else op)
    return ops


def _set_field_of_frames(line: Line) -> list[Op]:
    """Translate an assignment to one field of frame data, or to the controller's interpolation mode.

    * `$IPO_MODE=#BASE`: nothing is special; `$IPO_MODE=#TCP`: frames are unknown, because the tool is fixed.
    * `FDAT_ACT.BASE_NO=1`: the base of FDAT_ACT is BASE_DATA[1].
    * `FDAT_ACT.IPO_FRAME=#TCP`: as above, for frame data.

    The list is empty if the line assigns to something else.
    """
    if line.text == "$IPO_MODE=#BASE":
        return [ir.Assign(_IPO, _ARM_CARRIES_TOOL)]
    if line.text == "$IPO_MODE=#TCP":
        return [ir.Assign(_IPO, ir.Unknown(_FIXED_TOOL, "omit the statement"))]
    field = _FIELD_OF_FRAMES.fullmatch(f"{line['index']}={line['value']}")  # such as `.BASE_NO=1`
    if field is None:
        return []
    ordinals = dict[str, int]()
    if field["role"]:
        ordinals[field["role"]] = line.part("value").ordinals[0]
    return _set_frame_data(line["name"], ordinals, field["mode"] or "")


def _translate_assignment(line: Line) -> list[Op]:
    """Translate an assignment `A[3].X=1`, with the groups `name` (A), `index` ([3].X) and `value` (1).

    The index is empty if the whole variable is set. The cases, in this order:

    * `A[3].X=1`: one element of an array of the program;
    * `FDAT_ACT.BASE_NO=1`: frame data, or the interpolation mode;
    * `$ACT_BASE=1`: the number of the active frame, behind which the frame is unknown;
    * all else: a variable or a field, or one of the controller's variables that move no targets.

    Raises:
        Misread: a system variable that may move targets is set, or the index of a frame is computed.
    """
    name, index = line["name"], line["index"]
    _refuse_computed_index_of_frame(name, index)
    is_element_of_own_array = index.startswith(_NUMBER_AS_INDEX) and not name.startswith("$")
    if is_element_of_own_array:
        element = line.fill_name(f"{name}[%s]", "index")
        field_of_element = index.removeprefix(_NUMBER_AS_INDEX)
        return _assign(line, element, field_of_element)
    if frame_data := _set_field_of_frames(line):
        return frame_data
    if name in {"$ACT_BASE", "$ACT_TOOL"} and not index:
        return _choose_number_of_active_frame(line)
    if _MAY_MOVE_TARGETS.match(line.text):
        raise Misread(f"the controller's variable {name} may move targets", "omit the statement")
    return _assign(line, name, index)


def _refuse_computed_index_of_frame(name: str, index: str) -> None:
    """Refuse an assignment to `BASE_DATA[i]`: an element of the controller's tables whose index is no number.

    Raises:
        Misread: the name and the index are those of such an element.
    """
    if name in {"BASE_DATA", "TOOL_DATA"} and not index.startswith(_NUMBER_AS_INDEX):
        raise Misread(f"the index of {name} is computed", _FRAME_REMEDY)


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
    """Translate the assignment of the line's value to a variable, an element of an array or a field.

    * `$VEL.CP=0.2`, of the controller: only the feed matters, because no target depends on the others here;
    * `P1.X=5`: the whole variable P1 is unknown, because single fields are not followed;
    * `P1={X 1,...}` or `A[3]={X 1,...}`: the target gets the value.

    Args:
        line: the assignment.
        target: the variable, or the element such as `A[3]`.
        index: text behind it, such as `.X` or `[i].X`; empty if the whole target is set.
    """
    name = line["name"]
    uses = [*_read_indices(line, index), *_note_turned_tool(line)]
    is_system_variable = name.startswith("$") and name not in {"$BASE", "$TOOL"}
    if is_system_variable:
        return [*uses, *_read_value(line, line["value"]), *_set_active_feed(line)]
    if index:
        return [*uses, *_read_value(line, line["value"]), _forget_name(target)]
    return [*uses, *_translate_value(target, line.part("value"))]


def _note_turned_tool(line: Line) -> list[Op]:
    """Return the remark on an assignment such as `$ORI_TYPE=#CONSTANT`, which turns the tool; else nothing.

    With the values FALSE and #VAR, the tool has the orientations that the program states.
    """
    if line["name"] not in _TURNS_TOOL or line["value"] in {"FALSE", "#VAR"}:
        return []
    effect = "after this line the arm does not reach the orientations that the program states"
    return [ir.Note(f"{line.quote()}: {effect}")]


def _set_active_feed(line: Line) -> list[Op]:
    """Return the assignment of the active feed by a line such as `$VEL.CP=0.2`; nothing for another variable.

    Of the controller's variables that are no frames, only the feed matters: no target depends on the others.
    """
    feed = _read_feed(line) if line["name"] == "$VEL" else None
    return [ir.Assign(ir.FEED, feed)] if feed else []


def _read_indices(line: Line, index: str) -> list[Op]:
    """Return the uses of variables in the indices of an element, such as I and J of `[I][J].X`.

    The indices are read as one expression `I,J+X`, as only the names in it matter. Without brackets, as in
    `.X`, there are no indices.
    """
    if "[" not in index:
        return []
    indices = index.strip("[]").replace("][", ",").replace("].", "+")
    return line.read_expression(indices)


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
    """Settings that a move has for itself, behind its targets: `WITH $VEL.CP=0.2, $BASE=FRAME1`."""

    uses: list[Op]  # uses of the names in the settings
    frames: dict[str, ir.Copy]  # frames that are set for this move only, by the keys BASE and TOOL
    feed: ir.Value | None  # feed that is set for this move only; None if there is none

    @property
    def base(self) -> ir.Copy:
        """Base of the move: that of its settings, or the active one."""
        return self.frames.get("BASE", ir.Copy("$BASE"))

    @property
    def tool(self) -> ir.Copy:
        """Tool of the move: that of its settings, or the active one."""
        return self.frames.get("TOOL", ir.Copy("$TOOL"))

    @property
    def feed_of_move(self) -> ir.Feed | None:
        """Feed of the move: that of its settings, or the active one; None if it is computed."""
        value = self.feed or ir.Copy(ir.FEED)
        return ir.Feed(value, _M_PER_S) if isinstance(value, Literal | ir.Copy) else None


class _Targets(NamedTuple):
    """Targets that the text of a move states, such as `P1,P2` or `{X 1,...}`."""

    known: tuple[Literal | ir.Name, ...]  # those that are variables, or whole poses in numbers
    are_all_known: bool  # whether each target of the text is one of these
    uses: list[Op]  # uses of other names

    def are_complete(self, motion: Motion) -> bool:
        """Return whether all targets of a move are known: two of an arc, one of any other motion."""
        count = 2 if motion is Motion.CIRCULAR else 1
        return self.are_all_known and len(self.known) == count


def _translate_move(line: Line) -> list[Op]:
    """Translate a move such as `LIN P1 WITH $VEL.CP=0.2 C_DIS` or `CIRC P1,P2,CA 180`.

    The groups of the line are `motion` (LIN), `relative` (_REL, as in `LIN_REL {X 10}`) and `rest`. A move
    that is relative, or whose target is not a whole pose, is translated into a move that is not corrected.

    Raises:
        Misread: there is no target, or the settings of the move are unknown.
    """
    motion = _MOTIONS[line["motion"]]
    target_text, setting_text = _split_at_with(_read_rest(line))
    if not target_text.text:
        raise Misread(_NOT_WHOLE)
    settings = _read_settings(setting_text)
    if _STORED_POSITION.fullmatch(target_text.text):
        return [*settings.uses, ir.MoveToStored(target_text.text)]
    targets = _read_targets(target_text)
    uses = [*settings.uses, *targets.uses]
    reason = _explain_uncorrected(line, targets)
    if reason:
        return [*uses, *_translate_uncorrected_move(motion, target_text, settings, reason)]
    return [*uses, _make_move(motion, targets.known, settings)]


def _explain_uncorrected(line: Line, targets: _Targets) -> str:
    """Return why a move to these targets is not corrected; empty if it is.

    The groups of the line are `motion` and `relative`: it is not corrected as in `LIN_REL {X 10}` (a step),
    or in `LIN {X 10}` (a part of a pose).
    """
    if line["relative"]:
        return "the target is relative to the position before the move"
    return "" if targets.are_complete(_MOTIONS[line["motion"]]) else _NOT_WHOLE


def _read_rest(line: Line) -> Line:
    """Return the text behind the motion of a move; of a relative move, without the axes of its step.

    For `LIN_REL {X 10} #TOOL` it is `{X 10}`. The groups of the line are `relative` and `rest`.
    """
    rest = line.part("rest")
    return rest.cut(0, len(_strip_axes_of_step(rest.text))) if line["relative"] else rest


def _make_move(motion: Motion, targets: tuple[Literal | ir.Name, ...], settings: _Settings) -> ir.Move:
    """Return a move to targets, which all have the same base and the same tool."""
    count = len(targets)
    bases, tools = (settings.base,) * count, (settings.tool,) * count
    return ir.Move(motion, targets, bases, tools, feed=settings.feed_of_move)


def _strip_axes_of_step(text: str) -> str:
    """Return the text of a relative move without the axes of its step: `{X 10}` for `{X 10} #TOOL`."""
    return re.sub(r" ?#(?:TOOL|BASE)$", "", text)


def _read_targets(targets_of_move: Line) -> _Targets:
    """Read the targets of a move, such as the `P1,{X 1,...},CA 180` of a CIRC: two targets and an angle.

    Raises:
        Misread: one of two targets is stored in the controller.
    """
    targets: list[Literal | ir.Name | None] = []
    uses = list[Op]()
    for part in targets_of_move.split():
        is_angle_of_arc = len(targets) == 2 and part.text.startswith("CA ")
        if is_angle_of_arc:
            uses += _read_angle_of_arc(part)
        elif _STORED_POSITION.fullmatch(part.text):
            raise Misread("the arc goes through a position stored in the controller")
        else:
            targets.append(_read_target(part))
    known = tuple(target for target in targets if target is not None)
    return _Targets(known, len(known) == len(targets), uses)


def _read_angle_of_arc(part: Line) -> list[Op]:
    """Translate the angle `CA 180` of an arc into the uses of its expression, and a remark."""
    uses = part.read_expression(part.text.removeprefix("CA "))
    return [*uses, ir.Note("the arc ends at its angle CA, not at the second of its targets")]


def _translate_uncorrected_move(motion: Motion, target: Line, settings: _Settings, reason: str) -> list[Op]:
    """Translate a move whose numbers are not corrected, because its target is relative or not whole.

    Args:
        motion: kind of the motion.
        target: target of the move, or its step.
        settings: settings of the move.
        reason: why the move is not corrected, unless its target is at an offset from another one, such as
            `P1:{X 10}`.
    """
    target_or_step = _strip_axes_of_step(target.text)
    near = _NEAR.fullmatch(target_or_step)  # another target, and the offset from it
    structure = near["offset"] if near else target_or_step  # such as `{X 10,Y 5}`
    list_of_expressions = _SEPARATED.sub(",", structure)
    uses = target.read_expression(list_of_expressions)
    if near and not re.fullmatch(_RESERVED, near["target"]):
        return [*uses, _make_move_near_target(motion, near["target"], settings)]
    return ir.make_uncorrected_move(uses, reason, _REMEDY)


def _make_move_near_target(motion: Motion, name: str, settings: _Settings) -> ir.Move:
    """Return the move to a place such as `P1:{X 10}`, 10 mm from the target P1, which is not corrected.

    A correction of P1 shifts the move, too: so the move names P1 in `offset_from`, and in its reason.
    """
    return ir.Move(
        motion,
        targets=(),
        bases=(settings.base,),
        tools=(settings.tool,),
        reason=f"the target is at an offset from {name}",
        remedy=_REMEDY,
        offset_from=(name,),
    )


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


def _read_settings(text: Line) -> _Settings:
    """Translate the settings of a move, such as `$VEL.CP=0.2,$BASE=FRAME1` behind the word WITH.

    A move without the word has an empty text, and no settings.

    Raises:
        Misread: a setting is unknown, calls a routine, or takes only one of base and tool from frame data.
    """
    if not text.text:
        return _Settings([], {}, None)
    uses, own_frames = list[Op](), list[_OwnFrame]()
    feed = None  # the last one counts: a number may follow a structure
    for setting in text.split():
        feed = _read_feed(setting) or feed
        own_frame = _read_own_frame(setting)
        if own_frame is None:
            uses += _translate_other_setting(setting)
        else:
            own_frames.append(own_frame)
            uses += own_frame.uses
    _refuse_unusual_settings(own_frames, uses)
    return _Settings(uses, {own.role: own.frame for own in own_frames}, feed)


def _refuse_unusual_settings(own_frames: list[_OwnFrame], uses: list[Op]) -> None:
    """Refuse settings of a move that call a routine, or take only one of base and tool from frame data.

    Args:
        own_frames: frames that the settings make active for the move.
        uses: uses of names in the settings.

    Raises:
        Misread: the settings are such ones.
    """
    if _takes_part_of_frame_data(own_frames) or ir.calls_routine(uses):
        reason = "the settings after WITH call a routine, or set only one of tool and base"
        raise Misread(reason, _SET_BEFORE_MOVE)


def _translate_other_setting(setting: Line) -> list[Op]:
    """Translate a setting of a move that sets no frame, such as `$APO.CDIS=5`, into uses of names.

    Raises:
        Misread: the setting may move the target, or sets a frame in a form that is not understood.
    """
    if not _is_harmless_setting(setting.text):
        reason = "a setting after WITH is unknown, or sets a frame for this move only"
        raise Misread(reason, _SET_BEFORE_MOVE)
    _, _, value = setting.text.partition("=")
    return _read_value(setting, value)


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
    """Return whether settings take only the base or only the tool from frame data, or each from other ones.

    `$BASE=SBASE(FP1),$TOOL=STOOL2(FP1)` take both from FP1: the answer is no. It is yes for
    `$BASE=SBASE(FP1)` alone, and no where no frame data occur.
    """
    data_of_role = {own.role: own.data for own in own_frames if own.data}
    if not data_of_role:
        return False
    has_base_and_tool = data_of_role.keys() >= {"BASE", "TOOL"}
    are_all_the_same = len(set(data_of_role.values())) == 1
    return not (has_base_and_tool and are_all_the_same)


def _is_harmless_setting(setting: str) -> bool:
    """Return whether a setting `$NAME=value` of a single move moves no target and sets no frame."""
    sets_frame = setting.startswith(("$BASE", "$TOOL"))
    return setting.startswith("$") and not sets_frame and not _MAY_MOVE_TARGETS.match(setting)


def _translate_spline(line: Line) -> list[Op]:
    """Translate the beginning of a block of splines, `SPLINE WITH $VEL.CP=0.2`, which may have its own feed.

    The end of the block makes the feed before the block active again: a variable keeps it. Base and tool
    become unknown if the block sets them.

    Raises:
        Misread: the statement has a target, or unknown settings.
    """
    targets, setting_text = _split_at_with(line.part("rest"))
    if targets.text:
        raise Misread(UNKNOWN_STATEMENT)
    settings = _read_settings(setting_text)
    ops = [*settings.uses, ir.Assign(_FEED_OF_BLOCK, ir.Copy(ir.FEED))]
    if settings.feed:
        ops.append(ir.Assign(ir.FEED, settings.feed))
    if settings.frames:
        ops.append(_forget_active_frames("the block of splines has frames of its own"))
    return ops


def _forget_active_frames(reason: str) -> Op:
    """Return the operation behind which base and tool are unknown, for a reason, until a line sets them."""
    remedy = "set $BASE and $TOOL before the block"
    return ir.MakeUnknown(frozenset({"$BASE", "$TOOL"}), reason, remedy)


def _translate_sensor(line: Line) -> list[Op]:
    """Translate a function of KUKA RSI, by which a sensor begins or ends to guide the arm.

    The groups of `RET=RSI_ON(#RELATIVE)` are `name` (RET, the variable that gets the result; it may be
    missing), `function` (RSI_ON), `action` (ON) and `arguments`. There are three actions:

    * ON: the sensor moves all targets from here on;
    * OFF: it no longer does;
    * MOVECORR: the sensor alone moves the arm, until the function ends: a move that is not corrected.
    """
    ops = line.read_expression(line["arguments"]) if line["arguments"] else []
    variable_of_result = line["name"]
    if variable_of_result:
        ops.append(_forget_name(variable_of_result))
    ops.append(ir.call_if_defined(line["function"], _find_names(ops)))
    reason, remedy = "a sensor moves the targets (RSI)", "omit the statement"
    if line["action"] == "OFF":
        return [*ops, ir.end_lasting("RSI")]
    if line["action"] == "MOVECORR":
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
    """Translate the declaration of an interrupt or a trigger, whose routine may run at any time.

    In `INTERRUPT DECL 3 WHEN $IN[1] DO STOPIT()`, the groups of the line are `number` (3), `when` ($IN[1])
    and `action` (STOPIT()). A `TRIGGER WHEN DISTANCE=0 DELAY=20 DO GRIP() PRIO=-1` has no number and no
    `when`.
    """
    # The priority is an expression as well: `GRIP() PRIO=-1` is read as `GRIP()+-1`.
    action = re.sub(r" ?\bPRIO=", "+", line["action"])
    uses_and_calls = [*line.read_expression(line["when"]), *line.read_expression(action)]
    is_trigger = line.text.startswith("TRIGGER")
    ops = list[Op]()
    for op in ir.mark_anytime(uses_and_calls, _name_event(line)):
        ops.append(_complete_call(op, is_trigger=is_trigger) if isinstance(op, ir.Call) else op)
    return ops


def _name_event(line: Line) -> ir.Name:
    """Return the name of the event of an interrupt, `INTERRUPT 3`, or of a trigger, `TRIGGER`.

    Another statement, `INTERRUPT ON 3`, switches the interrupt on by this name. It is empty for an interrupt
    whose number is computed.
    """
    if line["number"]:
        return line.fill_name("INTERRUPT %s", "number")
    return "TRIGGER" if line.text.startswith("TRIGGER") else ""


def _complete_call(call: ir.Call, *, is_trigger: bool) -> ir.Call:
    """Return the call of an interrupt or a trigger with what the controller's manuals state of it.

    BAS: the routine IR_STOPM only stops the robot, and is harmless. KSS: a trigger acts on the path of the
    move behind it, which is planned before, with its frames.
    """
    only_stops_robot = call.name == "IR_STOPM"
    return call._replace(harmless=call.harmless or only_stops_robot, behind_next=is_trigger)


def _translate_unknown_attachment(line: Line) -> list[Op]:
    """Translate an interrupt or a trigger that is not understood, such as `INTERRUPT DECL 3 ... DO F(,)`.

    Each name before a bracket, here F, may be a routine that runs at any time from here on. The text of the
    whole statement counts as one more routine, which no program has: an unknown routine, which may run, too.
    """
    unknown_routine = line.text.replace(ir.A_NUMBER, "n")
    called_names = re.findall(rf"(?<![\w$])({_NAME})\(", line.text)
    return [ir.Call(name, anytime=True) for name in (unknown_routine, *called_names)]


def _translate_triggered_assignment(line: Line) -> list[Op]:
    """Translate a trigger that assigns a value, such as `TRIGGER WHEN DISTANCE=0 DELAY=20 DO $OUT[1]=TRUE`.

    The group `action` of the line is the assignment `$OUT[1]=TRUE`. It is made when the arm comes to a place
    of its path. So the value of the name changes at any time, and is unknown everywhere, also before the
    line. KSS: what is triggered is an assignment, a pulse of an output, or a call of a routine.
    """
    assignment = line.part("action")
    name, _, _ = assignment.text.partition("=")
    reason = f"{name} changes at a trigger"
    changes, others = list[Op](), list[Op]()
    for op in line.language.apply_rules(assignment):
        if isinstance(op, ir.Assign):
            changes.append(ir.MakeUnknown(frozenset({op.name}), reason, _REMEDY, anytime=True))
        elif isinstance(op, ir.MakeUnknown):  # the value is computed, and already unknown
            others.append(op._replace(anytime=True))
        else:
            others.append(op)
    return [*changes, *others]


def _translate_bas(line: Line) -> list[Op]:
    """Translate a call such as `BAS(#TOOL,1)` of KUKA's routine BAS, which sets frames, speeds and the like.

    The groups of the line are `function`, here TOOL, and `argument`, here 1, which may be empty:

    * TOOL and BASE with an argument make a frame of the controller's table the active one;
    * the functions in `_BAS`, such as INITMOV, have the same effect with any argument;
    * of these, VEL_CP and CP_PARAMS also set the feed, to their argument.

    Raises:
        Misread: the function is unknown, or is TOOL or BASE without an argument.
    """
    function, argument = line["function"], line.part("argument")
    if function in {"TOOL", "BASE"} and argument.text:
        return _translate_frame_of_bas(function, argument)
    if function not in _BAS:  # also TOOL and BASE without an argument
        raise Misread(f"BAS(#{function}) is unknown, or its argument is not a number")
    ops = [*argument.read_expression(), *_BAS[function]]
    if function in {"VEL_CP", "CP_PARAMS"}:  # BAS: both set $VEL.CP
        ops.append(ir.Assign(ir.FEED, _read_speed(argument) or _UNKNOWN_FEED))
    return ops


def _translate_frame_of_bas(role: str, index: Line) -> list[Op]:
    """Translate `BAS(#TOOL,1)`, which does the same as `$TOOL=TOOL_DATA[1]`.

    There are three kinds of the index, here 1:

    * a number: the active tool becomes a copy of TOOL_DATA[1];
    * a variable, as in `BAS(#TOOL,I)`: it becomes a copy of the element whose number is the value of I;
    * an expression, as in `BAS(#TOOL,I+1)`: it becomes unknown, because expressions are not calculated.

    Args:
        role: TOOL or BASE.
        index: text of the index.
    """
    active = f"${role}"
    if index.is_number:
        element = index.fill_name(f"{role}_DATA[%s]")
        return [ir.Assign(active, ir.Copy(element))]
    uses_of_index = index.read_expression()
    is_variable = re.fullmatch(r"[^\W\d]\w*+", index.text) is not None
    if is_variable:
        return [*uses_of_index, _copy_element(role, index.text)]
    return [*uses_of_index, _forget_name(active)]


def _translate_reading(line: Line) -> list[Op]:
    """Translate a function that reads values from outside, such as `STATE=EKI_GETREAL("name","x",VALUE)`.

    The groups of the line are `status` (STATE, which may be missing), `function` and `arguments`. All
    variables in the arguments, here VALUE, and STATE have unknown values behind the line. A routine of the
    program with the name of the function takes its place.
    """
    uses = [op for op in line.read_expression(line["arguments"]) if isinstance(op, ir.Use)]
    arguments = _find_names([*uses])
    no_variable = "_"  # keeps the names from being empty, which would mean all names
    changed = arguments | {line["status"] or no_variable}
    own_routine = ir.call_if_defined(line["function"], arguments)
    reason = "the value is read from outside while the program runs"
    return [own_routine, ir.MakeUnknown(changed, reason, _REMEDY)]


def _find_names(ops: list[Op]) -> frozenset[str]:
    """Return the names that operations of expressions use, apart from elements of arrays."""
    names = set[str]()
    for op in ops:
        if isinstance(op, ir.Use):
            names.update(name for name in op.names if isinstance(name, str))
    return frozenset(names)


def _translate_kinematics(line: Line) -> list[Op]:
    """Translate `A=INVERSE(P,START,STATUS)` or FORWARD, which calculate joint angles or a pose.

    The result (group `name`, here A) and the status get unknown values; the result is calculated of the other
    arguments. Source: KSS, INVERSE and FORWARD: they read the active base and tool, and change neither.
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
    """Yield the names that a file of data (.dat) declares without the word GLOBAL.

    These are P1 of `POS P1={X 1}`, but none of lines such as `DEFDAT PART` and `EXT GRIP()`, which declare no
    data.
    """
    for line in _LINE_END.split(capitalise(text)):
        may_declare_private_name = _NO_DATA.match(line) is None
        if may_declare_private_name:
            yield from _list_declared(line)


def _list_declared(line: str) -> Iterator[str]:
    """Yield the variables that a line of a .dat declares or sets: P1 and P2 of `POS P1={X 1},P2`.

    The line `P1.X=5` sets a field of P1, and gives P1, too.
    """
    plain = _remove_braces(_NO_NAME.sub("", line))  # without texts, comments, indices and structures
    for part in plain.split(","):
        before_value, _, _ = part.partition("=")
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
        _note_owners_of_names(statements, sources)
        new_names = _rename_local_routines(sources)
    for index in range(len(sources)):
        _add_file(statements, sources, index, new_names.get(index, {}))
    _forget_imported_names(statements, sources)


def _add_file(
    statements: Statements, sources: tuple[Source, ...], index: int, new_names: dict[str, str]
) -> None:
    """Add the statements of one file: a program (.src), or data (.dat) such as `DECL GLOBAL POS P1={...}`.

    Args:
        statements: statements of all files, to which those of this file are added.
        sources: all files.
        index: index of the file.
        new_names: new names of routines that the file calls, by their names.

    Raises:
        ProgramError: the file is a .dat that belongs to another program.
    """
    source = sources[index]
    first_line = _DATA.search(source.text) if index else None  # `DEFDAT PART` of a .dat
    kind = _choose_kind_of_declarations(source, first_line)
    starts, ends = source.starts, source.ends
    if first_line and _is_of_another_program(statements, sources, index, first_line):
        is_global = _find_global_lines(source)
        _add_own_data_of_program(statements, index, starts[~is_global], ends[~is_global], kind)
        starts, ends = starts[is_global], ends[is_global]
    is_data = source.name.lower().endswith(".dat") and len(sources) > 1
    translate = partial(_translate_renamed, renamed=new_names) if new_names else None
    statements.add_statements(index, starts, ends, declares=kind if is_data else "", translate=translate)


def _add_own_data_of_program(
    statements: Statements, index: int, starts: IndexArray, ends: IndexArray, kind: str
) -> None:
    """Add the lines of a .dat without the word GLOBAL, which only the program that they belong to knows.

    The program is another one than the first file. The lines matter only if its .src was sent: they are then
    data of its own, apart from those of the first file.

    Args:
        statements: statements of all files.
        index: index of the .dat among the files.
        starts: (k,) first character of each line.
        ends: (k,) last character + 1 of each line.
        kind: which programs may change the data, as `_choose_kind_of_declarations` returns it.
    """
    is_program_sent = bool(statements.owners.get(index))
    if is_program_sent:
        statements.add_statements(index, starts, ends, declares=kind)


def _choose_kind_of_declarations(source: Source, first_line: re.Match[str] | None) -> str:
    """Return which programs may change the data that a .dat declares, as a word for its declarations.

    * `shared`: $config.dat; all programs know its data, and may change them;
    * `variable`: `DEFDAT PART PUBLIC`; other programs may import the data, and change them;
    * `constant`: any other file; only its own program knows the data, so that they begin with their values.

    Args:
        source: the file.
        first_line: match of its line DEFDAT; None if it has none.
    """
    if _is_config(source):
        return "shared"
    is_public = first_line is not None and first_line["public"] is not None
    return "variable" if is_public else "constant"


def _is_config(source: Source) -> bool:
    """Return whether a file is $config.dat, which has the data of all programs."""
    return source.name.lower().endswith("config.dat")


def _find_global_lines(source: Source) -> BoolArray:
    """Return a mask of the lines of a file (n,) that declare names as GLOBAL."""
    spans = zip(source.starts.tolist(), source.ends.tolist(), strict=True)
    return np.array([_GLOBAL.match(source.text, *span) is not None for span in spans], dtype=np.bool_)


def _is_of_another_program(
    statements: Statements, sources: tuple[Source, ...], index: int, first_line: re.Match[str]
) -> bool:
    """Return whether a .dat belongs to another program than the first file, by its first line `DEFDAT PART`.

    * False: the first file is the program PART, or has no name; or the .dat is $config.dat, whose data belong
      to all programs.
    * True: the first file is another program, and PART was sent as well, or its data are PUBLIC.
    * An error: the first file is another program, and nothing known reads the data of PART.

    Args:
        statements: statements of all files, which raise the error.
        sources: all files.
        index: index of the .dat among them.
        first_line: match of the line.

    Raises:
        ProgramError: the data belong to a program that is not sent, and are not PUBLIC.
    """
    main, *others = map(capitalise, _list_programs(sources) or [""])
    owner = first_line["program"]
    is_of_all_or_unknown = _is_config(sources[index]) or not main
    if is_of_all_or_unknown or capitalise(owner) == main:
        return False
    is_known_here = first_line["public"] is not None or capitalise(owner) in others
    if not is_known_here:
        reason = f"the file declares data of {owner}, not of {_list_programs(sources)[0]}"
        remedy = "send the .dat file of this .src file"
        statements.refuse(sources[index].find_line(first_line.start()), reason, remedy, index)
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
    """Make the values of names unknown that a program imports from another one, which may change them.

    `IMPORT POS OWN IS /R1/OTHER..P1` gives the name OWN to the variable P1 of the program OTHER: OWN and P1
    have unknown values at any time. The imports of the first file are left out: no file gives a value to
    the names that they make, so that these are unknown in any case.
    """
    imported = _list_imported_names(sources[1:])
    full_names = imported | _add_owners(imported, statements.owners)
    reason = "a program imports the name of another one, and may change it"
    statements.forget_anytime(frozenset(full_names), reason, _REMEDY)


def _list_imported_names(sources: tuple[Source, ...]) -> set[str]:
    """Return the names in the imports of some files: OWN and P1 of `IMPORT POS OWN IS /R1/OTHER..P1`."""
    imported = set[str]()
    for source in sources:
        for own_name, foreign_name in _IMPORT.findall(source.text):
            imported |= {capitalise(own_name), capitalise(foreign_name)}
    return imported


def _add_owners(names: set[str], owners: dict[int, dict[str, str]]) -> set[str]:
    """Return the full names that names may have in further files: the name and each owner of any data.

    Args:
        names: names such as P1.
        owners: `statements.owners`: by the index of a file, the owner of each name that means other data in
            this file, such as `file1` by P1.
    """
    all_owners = set[str]()
    for owner_of_name in owners.values():
        all_owners.update(owner_of_name.values())
    full_names = set[str]()
    for owner in all_owners:
        full_names |= {f"{name}{OF_ROUTINE}{owner}" for name in names}
    return full_names


def _find_routines_by_value(sources: tuple[Source, ...]) -> frozenset[str]:
    """Return the routines that get copies of their arguments, and so cannot change them.

    All declarations of such a routine by EXT or EXTFCT, such as `EXT GRIP(INT:IN,POS:IN)`, state `:IN` for
    each parameter.
    """
    by_value, by_reference = set[str](), set[str]()
    for source in sources:
        for name, parameters in _DECLARED.findall(source.text):
            are_copies = all(_BY_VALUE.fullmatch(parameter) for parameter in parameters.split(","))
            routines = by_value if are_copies else by_reference
            routines.add(capitalise(name))
    return frozenset(by_value - by_reference)


class _RoutinesOfFile(NamedTuple):
    """Names in capitals of the routines that a .src defines by DEF or DEFFCT."""

    every: set[str]
    visible: set[str]  # those that other files know, too: the first one, and those with the word GLOBAL
    local: set[str]  # those that only the file itself knows


def _list_routines(source: Source) -> _RoutinesOfFile:
    """List the routines that a .src defines, as by `DEF PART()` and `GLOBAL DEF GRIP()`."""
    every, visible, local = set[str](), set[str](), set[str]()
    for number, (word_global, written_name) in enumerate(_ROUTINES.findall(source.text)):
        name = capitalise(written_name)
        is_first = number == 0
        every.add(name)
        if is_first or word_global:
            visible.add(name)
        else:
            local.add(name)
    return _RoutinesOfFile(every, visible, local)


def _rename_local_routines(sources: tuple[Source, ...]) -> dict[int, dict[str, str]]:
    """Return new names for routines, so that routines of several files with the same name are kept apart.

    KSS: other files know the first routine of a file, and those that are GLOBAL; all others are local. If
    part.src and other.src both have a local routine GRIP, then GRIP gets a new name in one of them.

    Returns:
        By the index of each file, the new names of routines by their names in this file.
    """
    routines_of_file = _list_routines_of_programs(sources)
    new_names = dict[int, dict[str, str]]()
    for index, routines in routines_of_file.items():
        # A call of a routine that is local to other files means no routine that was sent.
        elsewhere = _find_routines_local_elsewhere(index, routines_of_file)
        new_names[index] = {name: f"{name}{IN_MODULE}99" for name in elsewhere}
        is_first_file = index == 0  # its routines keep their names, as messages show them
        if not is_first_file:
            new_names[index] |= {name: f"{name}{IN_MODULE}{index}" for name in routines.local}
    return new_names


def _list_routines_of_programs(sources: tuple[Source, ...]) -> dict[int, _RoutinesOfFile]:
    """List the routines of each file that is a program (.src), not data (.dat), by the index of the file."""
    routines_of_file = dict[int, _RoutinesOfFile]()
    for index, source in enumerate(sources):
        is_program = _DATA.search(source.text) is None
        if is_program:
            routines_of_file[index] = _list_routines(source)
    return routines_of_file


def _find_routines_local_elsewhere(index: int, routines_of_file: dict[int, _RoutinesOfFile]) -> set[str]:
    """Return the names of routines that only other files than the one with this index know.

    If other.src has a local routine GRIP, then a call of GRIP in part.src cannot mean it: GRIP is such a
    name, unless part.src has a GRIP of its own, or a file has one that all files know.
    """
    local, visible = set[str](), set[str]()
    for other, routines in routines_of_file.items():
        visible |= routines.visible
        if other != index:
            local |= routines.local
    return local - visible - routines_of_file[index].every


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
    """Names that the .dat files of some programs declare; programs and names are in capitals."""

    files: dict[str, list[int]]  # by the name of the program, the indices of its .dat files
    private: dict[str, set[str]]  # by the name of the program, names that only this program knows
    shared: set[str]  # names that all programs know


def _note_owners_of_names(statements: Statements, sources: tuple[Source, ...]) -> None:
    """Note which names mean other data in a further file than in the first one.

    KSS: the program of part.src knows all names that part.dat declares, and of another .dat those with the
    word GLOBAL; the data of $config.dat are known to all programs. So a point P1 of part.dat and a P1 of
    other.dat are two points. `statements.owners` keeps them apart: it has, for each further file, the names
    that mean other data there, each with an owner. The owner is a text that is added to the name.
    """
    data = _collect_data(sources)
    statements.shared_names = frozenset(data.shared)
    # A name that is private to the first program means something else in each further program.
    private_of_main = data.private.get(_find_program(sources[0]), set())
    for index, source in enumerate(sources[1:], 1):
        program = _find_program(source)
        is_data = _DATA.search(source.text) is not None
        if not program or is_data:
            continue
        owner_of_private = dict.fromkeys(data.private.get(program, ()), f"file{index}")
        statements.owners[index] = dict.fromkeys(private_of_main, OTHER_FILES) | owner_of_private
        if owner_of_private:
            statements.owners.update(dict.fromkeys(data.files[program], owner_of_private))


def _find_program(source: Source) -> str:
    """Return the name in capitals of the program that a .src defines, as by `DEF PART()`; empty if none."""
    definition = _DEFINED.search(source.text)
    return capitalise(definition[1]) if definition else ""


def _collect_data(sources: tuple[Source, ...]) -> _DataOfPrograms:
    """Collect the names that the .dat files among some files declare, by the programs that they belong to.

    The first line of a .dat, `DEFDAT PART`, names its program.
    """
    data = _DataOfPrograms(files=defaultdict(list), private={}, shared=set())
    for index, source in enumerate(sources):
        first_line = _DATA.search(source.text)
        if first_line is None:
            continue
        program = capitalise(first_line["program"])
        data.files[program].append(index)
        global_names = set(_find_shared_names(source.text))
        data.shared.update(global_names)
        if not _is_config(source):
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
