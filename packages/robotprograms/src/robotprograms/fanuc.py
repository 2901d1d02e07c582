"""Programs of FANUC (.LS, ASCII of TP), with programs that they call, translated: /MN and /POS."""

from __future__ import annotations

import re
from array import array
from collections.abc import Collection, Iterator, Mapping
from itertools import islice
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from robotprograms import language as ir
from robotprograms.arrays import IndexArray
from robotprograms.errors import quote_text
from robotprograms.language import Line, Misread, Op
from robotprograms.notation import Notation, Orientation, iterate_integers
from robotprograms.program import Literal, Motion, Source
from robotprograms.statements import Statements

POSE: Final = Notation(Orientation.FIXED_XYZ, length_decimals=3, angle_decimals=3)
JOINTS: Final = Notation(Orientation.JOINTS, length_decimals=3, angle_decimals=3)
_NUMBER: Final = Notation(Orientation.NONE)
_MOTIONS: Final = {
    "J": Motion.JOINT, "L": Motion.LINEAR, "C": Motion.CIRCULAR, "A": Motion.CIRCULAR, "S": Motion.SPLINE
}  # fmt: skip
_FIELDS: Final = (
    (POSE, ("X", "Y", "Z", "W", "P", "R"), "mm mm mm deg deg deg"),
    (JOINTS, ("J1", "J2", "J3", "J4", "J5", "J6"), "deg deg deg deg deg deg"),
)
# Facts. Source: FANUC R-30iB, operator's manual (basic operation) B-83284EN, chapter 4; alarm codes
# B-83284EN-1. A position states its UF and UT; if others are active, the controller stops (INTP-252, 253). F
# takes the active one. Registers, signals, timers, messages, speeds, collision detection: no position and no
# frame changes by them.
_BRACKETS: Final = r"\[(?:[^\[\]]|\[[^\[\]]*\])*\]"
_REGISTER: Final = rf"A?R{_BRACKETS}"
# Instructions that switch a process on or off, also behind a target
_PROCESS: Final = r"(?:SPOT|PRESS_MOTN|TIPDRESS|SS|SE|LS|LE|(?:Arc|Weld) (?:Start|End)(?: E\d)?)"
_HARMLESS: Final = (
    r"(?:R|SR|F|[DRGAWUS][IO]|M|TIMER|PR|PL|AR|VR|RSR|JOINT_MAX_SPEED)\[([^\]]*(?:\][^\]=]*)*?)\](?:\.\w+)?=(?P<value>.+)"
    r"|(?:WAIT|OVERRIDE=|LINEAR_MAX_SPEED=|\$(?:WAITTMOUT|RMT_MASTER|SVPRG_ENB|UALRM_SEV\[\0\])="
    r"|\$[\w$.\[\]\0]*(?:OVERRIDE|SPEED|TIMER_VAL)=) ?(.+?)"
    r"(?:\(sec\)| ?sec| ?%|(?<=ON)[+-]|(?<=OFF)[+-])?"
    r"|(?:PAUSE|ABORT|MESSAGE|REMARK|STOP_TRACKING|COL DETECT (?:ON|OFF)|-+|(?:UN)?LOCK PREG)"
    r"|TC_ONLINE(?: (?:EN|DIS)ABLE| ?(\(.+\)))?|CLEAR_RESUME_PROG|RETURN_PATH_DSBL"
    r"|(?:PAYLOAD|UALM|DIAG_REC)\[(.*)\]|COL GUARD ADJUST(?: ?(.+))?"
    r"|U(?:FRAME|TOOL)_NUM\[GP[2-9](?:,GP[2-9])*\]=(.+)"  # frames of other groups
    rf"|{_PROCESS}(?:{_BRACKETS})?|LASER (?:ON|OFF)(?:{_BRACKETS})?"
    # A weave swings about the path. Conditions act on moves that say Skip or Offset, which are left.
    rf"|Weave (?!Track)[\w\0 ]+(?:{_BRACKETS})?|(?:SKIP|(?:TOOL_|V)?OFFSET) CONDITION .+|MONITOR END \w+"
    r"|VISION (?:RUN_FIND|GET_(?:NFOUND|PASSFAIL|READING)|SET_REFERENCE|OVERRIDE|CAMERA_CALIB) "
    r"(?:(?!JMP|CALL).)*"
    # A search moves to contact by moves that say Search, which are left; a pattern of a pallet is a register.
    r"|Search (?:Start|End).*|PALLETIZING-\w+|(?:GUN|BACKUP)=(?:ON|OFF|OPEN|CLOSE)"
)
# Instructions of words alone that displace targets, or soften the arm, until others end them
_LASTING_WORDS: Final = (
    r"(?i:[JLCAS]|P|PR|TOUCH|TRACK|MP|RPM|SEARCH|SOFTFLOAT|FOLLOW|DEF\w*|LINE|(?:TOOL_|V)?OFFSET"
    r"|UFRAME|UTOOL|INDEPENDENT|SIMULTANEOUS|FORCE|CALIB|GROUP|IF|FOR|SELECT|JMP|LBL|RUN|CALL|WAIT|END\w*)\b"
)
# Words in names of macros that work a hand or a process
_OF_HAND: Final = re.compile(
    r"(?i)(?<![a-z])(?:open|close|relax|hand|grip|gripper|greifer|pinza|clamp|vac|vacuum|suction|ventosa|magnet"
    r"|valve|gun|spindle|laser|dispense|glue)(?![a-z])"
)
_MAY_LAST: Final = re.compile(
    r"(?i)track|offs|sens|soft|float|forc|frame|tool|line|shift|path|touch|search|follow|loop|seam|comp|adj"
    r"|cal|corr|tcp|guid|group|coord|conv|enc|job|base|vr|mirror|index|pos"
)
# Instructions that displace targets, or soften the arm, until their own end
_KINDS: Final = r"(?P<kind>Track|Touch Offset|MP OFFSET|SOFTFLOAT)"
# Text behind a target that does not move the target: termination, acceleration, configuration, spots, signals
_TAIL: Final = re.compile(
    rf"(?:\0|{_REGISTER})?"
    r"(?: ?(?:%|(?:mm|cm|inch|deg)/(?:se[ck]|min)|se[ck]|msec|max_speed|WELD_SPEED))?"
    r"(?: ?(?:FINE|Wjnt|PTH|BREAK|MROT|(?:CNT|CR|CD|ACC|AP_LD|RT_LD|PSPD)(?:\d++| ?\0)"
    rf"|(?:CNT|ACC|AP_LD|RT_LD|PSPD) ?{_REGISTER}|CNT\(\0\)"
    r"|EV(?:\d++| ?\0)%"
    rf"|{_PROCESS} ?{_BRACKETS}|SE(?!\w)"
    rf"|(?:TB|TA|DB|TIME (?:BEFORE|AFTER)|ZEIT (?:VOR|NACH)) ?(?:\0|{_REGISTER}) ?(?:se[ck]|mm)?,? ?"
    r"(?:P-SPS|CALL ?\w++(?:\([^()]*\))?"
    rf"|(?:DO|RO|GO|AO|R|F){_BRACKETS}="
    rf"(?:PULSE,\0 ?sec|{_REGISTER}|\w++|\0|\((?:(?!\bP\[)[\w\0\[\]!+*/<>= -])*\)))))*"
)
# Text behind a target that ends the move before it, and the label where the program continues otherwise
_SKIP: Final = re.compile(r" ?Skip,LBL ?\[(?P<label>[^\[\]]*)\](?:,PR\[[^\[\]]*\]=\w+)?")
# Text behind a target that moves this target: an increment, an offset, coordinated motion, a remote tool, a
# search
_OFFSETS: Final = (
    r"(?:INC|RTCP|Search ?\[[^\[\]]*\]|COORD(?:\[[^\[\]]*\])?|(?:Tool_)?Offset(?:,PR\[[^\[\]]*\])?"
    r"|VOFFSET,VR\[[^\[\]]*\])"
)
_OFFSET: Final = re.compile(rf"(?:^| ){_OFFSETS}(?= |$)")
_REMEDY: Final = (
    "write the numbers of positions in /POS, without PR[] and P[R[]]; choose frames by number, in a "
    "line without a condition"
)
_UNKNOWN_TAIL: Final = (
    "the text after the target is unknown or moves the target, so the position in /POS alone is not the "
    "target"
)
# In such a text: jumps, assignments and what lasts, which act behind the move
_FEED: Final = re.compile(r"\0 ?(?P<unit>mm/se[ck]|cm/min|inch/min)")
_FEED_UNITS: Final = {"cm/min": 10.0 / 60.0, "inch/min": 25.4 / 60.0}
"""Units of a feed other than mm/s [mm/s]."""
_MAY_ACT: Final = re.compile(r"=|LBL|JMP|CALL(?! ?\w)|(?i:track|touch|soft|follow|force)")
# Arguments of programs and macros are values, never positions.
_ARGUMENTS: Final = r"(?:\((?:(?!\bP\[)[^()]|\([^()]*\))*\))?"
_CHOICE: Final = (
    r"(?:\$MN(?=\w+NUM\[))?U(?P<which>FRAME|TOOL)"
    r"(?:_NUM(?:\[(?=(?:GP\d,)*?GP1\b)GP\d(?:,GP\d)*\])?|NUM\[\0\])"
)
_RECORD_AGAIN: Final = "record the position again"
# Actions after a condition: jumps, calls, and what changes neither positions nor frames
_LOGIC: Final = (
    r"(?P<action>JMP LBL ?\[.*\]|CALL .+|(?:[DRGAW]O|S?R|F|PR|TIMER|UALM)\[.+|OVERRIDE=.+|WAIT .+"
    r"|PAUSE|ABORT|END|MESSAGE)"
)


def _translate_frame_choice(line: Line) -> list[Op]:
    """Translate `UFRAME_NUM=3`, which makes the base `UF 3` the active one, or `UTOOL_NUM=1`.

    The groups of the line are `which` (FRAME or TOOL) and the `number`.
    """
    which = line["which"]
    letters = "UF" if which == "FRAME" else "UT"
    frame = line.fill_name(f"{letters} %s", "number")  # such as `UF 3`
    return [ir.Assign(f"U{which}_NUM", ir.Named(frame))]


def _translate_jump(line: Line) -> list[Op]:
    """Translate `JMP LBL[3]`, or `WAIT DI[1]=ON TIMEOUT,LBL[3]`, which jumps only if it waited too long.

    The groups of the line are the `label`, here 3 (a number, or an expression such as R[1]), and `wait`: the
    word WAIT, or empty.
    """
    label = line.part("label")
    uses = [] if label.is_number else label.read_expression()
    jump = _jump_to(label)
    if line["wait"]:
        return [*uses, *ir.make_skippable([jump])]
    return [*uses, jump]


def _jump_to(label: Line) -> ir.Flow:
    """Return the jump to the label whose number a text states; if the number is computed, to any label."""
    return ir.Flow("jump", label.fill_name("%s") if label.is_number else ir.ANY_LABEL)


def _translate_conditional_action(line: Line) -> list[Op]:
    """Translate an action behind a condition, such as `IF R[1]=2,JMP LBL[3]`, which may be skipped.

    The groups of the line are the `action`, here `JMP LBL[3]`, and `which`: the `R[1]=2` of
    `SELECT R[1]=2,JMP LBL[3]`, or empty. The condition of IF was read before, as it is an expression.
    """
    condition = list[Op]()
    if line["which"]:
        # `R[1]=2` is not an expression because of its `=`; only the names in it matter: R[1]+2 has the same.
        condition = line.read_expression(line["which"].replace("=", "+", 1))
    action = line.language.apply_rules(line.part("action"))
    return [*condition, *ir.make_skippable(action)]


def _translate_harmless_instruction(line: Line) -> list[Op]:
    """Translate an instruction that moves nothing, such as `R[1]=R[2]+1` or `DO[3]=PULSE,0.2sec`.

    The instruction becomes a use of each variable in its value (the line's group `value`), here R[2]. The
    words `PULSE,0.2sec` are no expression, and read no variable.

    Raises:
        Misread: the line also chooses a frame by UFRAME or UTOOL, after the value.
    """
    also_sets_frame = re.search(r"(?<=.)U(?:FRAME|TOOL)\w*(?:\[[^\[\]]*\])?=", line.text) is not None
    if also_sets_frame:
        return _refuse_computed_frame(line)
    value = line["value"].replace("!", "")  # `!` is NOT
    is_pulse = re.fullmatch(r"PULSE,\0 ?(?:sec)?", value) is not None  # NUL is in place of each number
    if not value or is_pulse:
        return []
    return line.read_expression(value)


def _translate_position_change(line: Line) -> list[Op]:
    """Translate an assignment to a position, such as `P[3]=PR[1]`, whose numbers become unknown.

    The group `place` of the line is the 3. It is empty in `P[R[1]]=PR[1]`, which may change any position.
    """
    array_of_positions = "P"  # the one name of all positions
    name: ir.Name = line.fill_name("P[%s]", "place") if line["place"] else array_of_positions
    return [ir.MakeUnknown(frozenset({name}), "the position changes while the program runs", _REMEDY)]


def _is_known_tail(tail: str) -> bool:
    """Return whether the text behind a target is known, such as `100mm/sec FINE` or `50% CNT10`.

    An offset, such as `Offset,PR[1]`, is known, too, although it moves the target: callers look for offsets
    on their own.
    """
    tail_without_offset = _OFFSET.sub("", tail).strip()
    return _TAIL.fullmatch(tail_without_offset) is not None


class _PositionsOfMove(NamedTuple):
    """Positions of a move such as `C P[1] P[2] 100mm/sec FINE`, and the text behind them."""

    # where the numbers n of its positions P[n] are, as indices among the numbers of the statement
    ordinals: tuple[int, ...]
    # text behind the first position, without Skip and the second position: `100mm/sec FINE`
    text_behind: Line


def _translate_move(line: Line) -> list[Op]:
    """Translate a move such as `L P[1] 100mm/sec FINE`, or an arc `C P[1] P[2] ...` through P[1] to P[2].

    The groups of the line are its `letter` (L, C), the `second` position, and the `tail` behind them. The
    move is not corrected if the tail moves the target, as `Offset,PR[1]` does, or may end the move.

    Raises:
        Misread: the number of positions is wrong, or the text behind them may be a further statement.
    """
    positions = _read_positions(line)
    skip = _SKIP.search(line["tail"])
    reason = _explain_tail(line, positions.text_behind, may_be_skipped=skip is not None)
    move = _make_move(_MOTIONS[line["letter"]], positions, reason)
    ops = [*_list_calls_near_target(positions.text_behind), move]
    if skip is None:
        return ops
    # `Skip,LBL[5]`: the program continues at the label if the condition of Skip is not met.
    label = line.part("tail").cut(*skip.span("label"))
    return [*ops, *ir.make_skippable([_jump_to(label)])]


def _make_move(motion: Motion, positions: _PositionsOfMove, reason: str) -> ir.Move:
    """Return a move to positions, such as `C P[1] P[2] 100mm/sec FINE`; with a reason, it is not corrected.

    The numbers of a position are given in a base and a tool of its own, whatever is active. The controller
    stops if others are active: so the move is certain only if the names in UFRAME_NUM and UTOOL_NUM are
    those of the position (`matched_frames`). The text behind the positions gives the feed, `100mm/sec`.
    """
    targets, bases, tools = list[ir.Name](), list[ir.Value](), list[ir.Value]()
    for ordinal in positions.ordinals:
        targets.append(ir.NumberedName("P[%s]", ordinal))
        bases.append(_copy_frame_of_position("P[%s].UF", ordinal))
        tools.append(_copy_frame_of_position("P[%s].UT", ordinal))
    return ir.Move(
        motion,
        tuple(targets),
        tuple(bases),
        tuple(tools),
        matched_frames=("UFRAME_NUM", "UTOOL_NUM"),
        reason=reason,
        remedy=_REMEDY,
        feed=_read_feed(positions.text_behind),
    )


def _copy_frame_of_position(template: str, ordinal: int) -> ir.Copy:
    """Return the base or tool of a position P[n], as a copy of the frame that the position names.

    The variable `P[1].UF` has no numbers, but the name of a frame, such as `UF 3`: the copy is `indirect`,
    which means that it is the frame UF 3.

    Args:
        template: `P[%s].UF` for the base, `P[%s].UT` for the tool.
        ordinal: index of the number n among those of the statement.
    """
    return ir.Copy(ir.NumberedName(template, ordinal), indirect=True)


def _list_calls_near_target(tail: Line) -> list[Op]:
    """Return the calls of programs near the target of a move, as in `TB .10sec,CALL GRIP` behind it."""
    names = re.findall(r"\bCALL ?(\w++)", tail.text.upper())
    return [ir.Call(name, anytime=True, event=name) for name in names]


def _explain_tail(line: Line, tail: Line, *, may_be_skipped: bool) -> str:
    """Return why a move is not corrected, from the text behind its positions; empty if it can be.

    A tail such as `100mm/sec FINE` is known. `Offset,PR[1]` is known to move the target.

    Raises:
        Misread: the text is unknown, and may be a further statement.
    """
    if not _is_known_tail(tail.text):
        tail_without_indices = re.sub(r"\[[^\[\]]*\]", "", tail.text)
        may_be_further_statement = _MAY_ACT.search(tail_without_indices) is not None
        if may_be_further_statement:
            raise Misread(_UNKNOWN_TAIL)
        return f"{line.quote()}: {_UNKNOWN_TAIL}"
    if offset := _OFFSET.search(tail.text):
        return f"{tail.cut(*offset.span()).quote()} moves the target"
    return "Skip may end the move before its target" if may_be_skipped else ""


def _read_positions(line: Line) -> _PositionsOfMove:
    """Read the numbers n of the positions P[n] of a move, and the text behind them.

    An arc has a second position, on the next line, as in `C P[1]` and `P[2] 100mm/sec FINE`. An offset of the
    first position may come before it, as in `C P[1] Offset,PR[1] P[2] 100mm/sec FINE`.

    Raises:
        Misread: an arc has one position, or another move has two.
    """
    first, second, tail = line.ordinals[0], line.part("second"), line.part("tail")
    is_arc = line["letter"] == "C"
    if is_arc and not second.text:
        second, tail = _cut_out_second_position(tail)
    has_second = second.text != ""
    if has_second != is_arc:
        need = "an arc needs two positions, the second one on the next line"
        raise Misread(f"{need}; any other move needs one position")
    return _PositionsOfMove((first, *second.ordinals), _remove_skips(tail))


def _cut_out_second_position(tail: Line) -> tuple[Line, Line]:
    """Cut the position P[2] out of the text `Offset,PR[1] P[2] 100mm/sec FINE`.

    Returns:
        The position, which is empty if there is none behind an offset; the text without it.
    """
    found = re.search(rf"{_OFFSETS} ?(?P<position>P\[\0\])", tail.text)
    if found is None:
        return tail.cut(0, 0), tail
    begin, end = found.span("position")
    return tail.cut(begin, end), tail.substitute(begin, end, " ")


def _remove_skips(tail: Line) -> Line:
    """Return the text behind the positions of a move without `Skip,LBL[5]`."""
    for skip in reversed([*_SKIP.finditer(tail.text)]):  # the last one first: places before it stay the same
        tail = tail.substitute(*skip.span(), "")
    return tail


def _read_feed(tail: Line) -> ir.Feed | None:
    """Return the feed of a move, such as `100mm/sec`, with which the text behind its positions begins.

    The feed is None if it has another unit or is computed.
    """
    begin = len(tail.text) - len(tail.text.lstrip())
    feed = _FEED.match(tail.text, begin)
    if feed is None:
        return None
    number = tail.cut(*feed.span())
    return ir.Feed(Literal(_NUMBER, number.ordinals), _FEED_UNITS.get(feed["unit"], 1.0))


def _translate_copy_to_register(line: Line) -> list[Op]:
    """Translate `PR[1]=P[3]`, by which a register gets the numbers of a position: a use of P[3].

    The use matters because a correction of P[3] would change the register, too. The group `place` is the 3.
    """
    return [ir.Use(frozenset({line.fill_name("P[%s]", "place")}))]


def _translate_pallet_move(line: Line) -> list[Op]:
    """Translate a move to a place of a pallet, which is not corrected.

    Raises:
        Misread: the text after the place calls a routine.
    """
    if re.search(r"LBL|JMP|CALL", line["tail"]):
        raise Misread(_UNKNOWN_TAIL)
    return ir.make_uncorrected_move([], "the target is a place of a pallet, not a position in /POS", _REMEDY)


def _translate_lasting(line: Line) -> list[Op]:
    """Translate an instruction that displaces targets until its end: `Track[1]`, until `Track End`.

    The group `kind` of the line is what displaces them: here Track.
    """
    return [ir.begin_lasting(line["kind"], f"{line.quote()} moves targets", "omit the statement")]


def _translate_call(line: Line) -> list[Op]:
    """Translate the call of a program: `CALL GRIP`, `RUN GRIP`, `MONITOR GRIP` or `CALL SR[1]`.

    Manual: CALL waits for the end of the called program; RUN and MONITOR do not, so that the program may run
    at any time from here on. The string register SR[1] has the name of a program: any one may be meant.
    """
    name = line["name"].replace(ir.A_NUMBER, "n").upper()
    is_in_register = name.startswith("SR[")
    prefix = "" if is_in_register else None  # all names begin with ""; None: the name itself is meant
    if line["verb"] == "CALL":
        return [ir.Call(name, prefix=prefix)]
    return [ir.Call(name, anytime=True, event=name, prefix=prefix)]


def _translate_event(line: Line) -> list[Op]:
    """Translate `ERROR_PROG=GRIP`: the program GRIP runs at any time, when an alarm occurs.

    RESUME_PROG and MAINT_PROG have programs for other events.
    """
    name = line["name"].upper()
    return [ir.Call(name, anytime=True, event=name)]


def _translate_macro(line: Line) -> list[Op]:
    """Translate an instruction that may be the call of a macro, such as `Open hand 1` or `Glue on(2)`.

    A macro is a program of the controller, and its name may have several words and a number. There are two
    calls: the first counts if a program with this name was sent, the second if none was. Then three cases:

    * `Open hand 1`, of a hand, or `Glue on(2)`, with arguments: a macro, which changes no targets;
    * `Shift on(2)`: a macro, too, but its name has a word of what moves targets, and may begin that;
    * `Grind on`: perhaps an instruction of the controller, which may move targets until another ends it.
    """
    name = line["name"].replace(ir.A_NUMBER, "n")
    has_arguments = line.text.endswith(")")
    is_macro = has_arguments or _OF_HAND.search(name) is not None
    has_word_of_what_lasts = _MAY_LAST.search(name) is not None
    program_of_this_name = ir.call_if_defined(name.upper())  # names have no case
    return [program_of_this_name, ir.Call(name, may_last=not is_macro or has_word_of_what_lasts)]


def _translate_register_move(line: Line) -> list[Op]:
    """Translate a move that is not corrected: to a register `PR[1]`, or to a computed position `P[R[1]]`.

    A register is no position in /POS. The computed one is any position in /POS: a remark says that the move
    shifts with the correction of that position.

    Raises:
        Misread: the text after the target is unknown, or calls a routine.
    """
    if not _is_known_tail(line["tail"]) or "CALL" in line["tail"]:
        raise Misread("the target is not a position in /POS, and the text after it is unknown")
    statement = line.quote()
    reason = f"{statement}: the target is not a position in /POS"
    move = ir.make_uncorrected_move([], reason, _REMEDY)
    is_to_computed_position = re.match(r"\w P\[", line.text) is not None
    if is_to_computed_position:
        text = f"{statement}: the move may go to any position in /POS, and then shifts with its correction"
        return [ir.Note(text), *move]
    return move


def _translate_assignment(line: Line) -> list[Op]:
    """Translate an assignment to an unknown name, such as `WELD_MODE=R[1]`: a remark, and uses of its value.

    The assumption, which the remark states, is that only what has this name changes, and so no target.

    Raises:
        Misread: the name has a word of what may move targets, as `TOOL_SHIFT` has, or the value is not
            understood.
    """
    if _MAY_LAST.search(line["name"]):
        raise Misread(ir.UNKNOWN_STATEMENT)
    note = ir.Note(f"{line.quote()} is unknown; it is assumed to change only what it names")
    return [*_translate_harmless_instruction(line), note]


def _translate_frame_change(line: Line) -> list[Op]:
    """Translate a statement that changes the numbers of a frame of the controller.

    `UFRAME[1]=PR[2]` changes the base `UF 1`, `UTOOL[2]=PR[3]` the tool `UT 2`; `UFRAME[R[1]]=PR[2]` may
    change any frame, so that no target is certain. The frame is unknown also before this statement, because
    the next run begins with the changed frame.
    """
    reason = f"{line.quote()}: the frame changes while the program runs"
    remedy = "set the frames before the program starts, because all of its moves depend on them"
    numbered = re.match(r"(?P<kind>UF|UT)(?:RAME|OOL)\[\0\]=", line.text)
    if numbered is None:
        return [ir.MakeUnknown(ir.ALL_TARGETS, reason, remedy, anytime=True)]
    frame = line.fill_name(f"{numbered['kind']} %s")
    return [ir.MakeUnknown(frozenset({frame}), reason, remedy, anytime=True)]


def _translate_computed_choice(line: Line) -> list[Op]:
    """Return the operation of a statement that activates a frame or a tool whose number is computed."""
    reason = f"{line.quote()}: a frame is computed, or chosen in a branch"
    active: ir.Name = f"U{line['which']}_NUM"
    return [ir.MakeUnknown(frozenset({active}), reason, _REMEDY)]


def _refuse_computed_frame(_line: Line) -> list[Op]:
    """Raise the error that a statement with a frame is not understood.

    Raises:
        Misread: always.
    """
    raise Misread("a frame is computed, or chosen in a branch")


# /POS

_FIELD: Final = re.compile(
    r"GP(?P<group>\d):|(?P<name>\w++)[:=](?:\0(?: (?P<unit>mm|deg))?|'(?P<text>[^']*+)'"
    r"|(?P<word>F|\*++)(?:mm|deg)?)"
    r",? ?(?!\w*[*\0])",
    re.IGNORECASE,
)
_ARM: Final = "1"
"""Number of the arm's group of axes."""
_CONFIG: Final = re.compile(r"[^,]*+,\0,\0,\0")


class _Field(NamedTuple):
    """Value of a field of a position, such as `X = 100.0 mm` or `CONFIG : 'N U T, 0, 0, 0'`."""

    ordinals: tuple[int, ...] = ()  # of its numbers
    text: str = ""  # its unit, or its text


_Fields: TypeAlias = dict[str, _Field]
"""Fields of a group of axes, by their names."""


def _declare_position(line: Line) -> list[Op]:
    """Translate the declaration of a position into assignments of its numbers, its base and its tool.

    Such a declaration is `P[n]{ GP1: UF : 1, UT : 2, CONFIG : 'N U T, 0, 0, 0', X = 100.0 mm, ... };`. A
    position that is not understood gets unknown numbers.
    """
    name = line.fill_name("P[%s]")
    try:
        groups = _split_groups(line)
        target = _read_arm_position(groups)
    except Misread as fault:
        return [ir.MakeUnknown(frozenset({name}), fault.reason, fault.remedy)]
    base = _name_frame("UF", groups.of_arm["UF"], "UFRAME_NUM")
    tool = _name_frame("UT", groups.of_arm["UT"], "UTOOL_NUM")
    return [
        ir.Assign(name, target, "variable"),
        ir.Assign(line.fill_name("P[%s].UF"), base, "constant"),
        ir.Assign(line.fill_name("P[%s].UT"), tool, "constant"),
    ]


def _name_frame(kind: str, field: _Field, active: str) -> ir.Named:
    """Return the frame that a field of a position names: `UF 1` for `UF : 1`, the active one for `UF : F`.

    Args:
        kind: UF (base) or UT (tool).
        field: the field, with the number of the frame or the letter F.
        active: name of the active frame of this kind.
    """
    if field.ordinals:
        return ir.Named(ir.NumberedName(f"{kind} %s", field.ordinals[0]))
    return ir.Named(active)


class _Groups(NamedTuple):
    """A position, divided by the groups of axes that the controller moves: the arm, positioners and so on."""

    of_arm: _Fields  # fields of the arm's group, which is group 1
    # ordinals of the numbers of all other groups, apart from those of their frames
    ordinals_of_others: tuple[int, ...]


def _split_groups(line: Line) -> _Groups:
    """Split a position `P[n]{ GP1: UF : 1, ..., X = 100.0 mm, ... GP2: J1 = 0.0 deg };` into its fields.

    Raises:
        Misread: a field is unknown or occurs twice.
    """
    fields_of_group = dict[str, _Fields]()
    group = _ARM
    ordinals = iter(line.ordinals[1:])  # without that of n
    for match in _match_fields(line.text):
        name, begins_group = match["name"], match["group"] is not None
        group = match["group"] or group
        fields = fields_of_group.setdefault(group, {})
        if name in fields or (begins_group and fields):
            raise Misread("a field or a group occurs twice in a position", _RECORD_AGAIN)
        if name:
            fields[name] = _make_field(match, ordinals)
    return _Groups(fields_of_group.get(_ARM, {}), _list_ordinals_of_others(fields_of_group))


def _match_fields(position: str) -> Iterator[re.Match[str]]:
    """Yield the parts of a position between its braces: each is a field such as `UF:1`, or a head `GP1:`.

    A head has the number `group`, a field has a `name`.

    Raises:
        Misread: a part is neither a field nor a head.
    """
    place, end = position.index("{") + 1, len(position) - len("};")
    while place < end:
        match = _FIELD.match(position, place)
        if match is None:
            raise Misread("a field of the position is unknown", _RECORD_AGAIN)
        yield match
        place = match.end()


def _make_field(match: re.Match[str], ordinals: Iterator[int]) -> _Field:
    """Return a field of a position: its numbers, and a text that depends on its form.

    The text of `X=100.0 mm` is `mm`, that of `CONFIG:'N U T,0,0,0'` is `N U T,0,0,0`, and that of `UF:F` is
    `F`; `UF:1` has none.

    Args:
        match: match of `_FIELD`.
        ordinals: yields the indices of the numbers that have not been read: as many as the field has are
            read here.
    """
    text = (match["unit"] or "").lower() or match["text"] or match["word"] or ""
    count_of_numbers = match[0].count(ir.A_NUMBER)
    ordinals_of_field = tuple(islice(ordinals, count_of_numbers))
    return _Field(ordinals_of_field, text)


def _list_ordinals_of_others(fields_of_group: Mapping[str, _Fields]) -> tuple[int, ...]:
    """Return the ordinals of the numbers in all groups but the arm's, apart from those of their frames."""
    ordinals = list[int]()
    for group, fields in fields_of_group.items():
        for name, field in fields.items():
            if group != _ARM and name not in {"UF", "UT"}:
                ordinals += field.ordinals
    return tuple(ordinals)


def _read_arm_position(groups: _Groups) -> Literal:
    """Return the target of the arm that a position states: X, Y, Z, W, P, R or joint angles J1 ... J6.

    Raises:
        Misread: the position was not recorded, is incomplete, or is not in mm and degrees.
    """
    fields = groups.of_arm
    _refuse_incomplete_position(fields)
    coordinates = _read_coordinates(fields)
    configuration = fields.get("CONFIG", _Field())
    return Literal(
        coordinates.notation,
        coordinates.ordinals,
        external=_list_external_axes(groups),
        words=_read_turns(configuration),
        letters=_read_letters(configuration),
    )


class _Coordinates(NamedTuple):
    """Coordinates of the arm that a position states."""

    notation: Notation  # POSE, or JOINTS for joint angles
    ordinals: tuple[int, ...]  # of the six numbers


def _read_coordinates(fields: _Fields) -> _Coordinates:
    """Read the coordinates of the arm from its fields, such as `X = 100.0 mm` and `W = 180.0 deg`.

    Raises:
        Misread: the fields are neither X, Y, Z, W, P, R nor J1 ... J6, or not in mm and degrees.
    """
    for notation, names, units in _FIELDS:
        stated = [fields.get(name, _Field()) for name in names]
        is_complete = all(field.ordinals for field in stated)
        if not is_complete:
            continue
        if [field.text for field in stated] != units.split():
            remedy = "write the program with the controller set to mm"
            raise Misread("the position is not in mm and deg", remedy)
        return _Coordinates(notation, tuple(field.ordinals[0] for field in stated))
    raise Misread("the position is neither X, Y, Z, W, P, R nor J1 ... J6", _RECORD_AGAIN)


def _list_external_axes(groups: _Groups) -> tuple[int, ...]:
    """Return the ordinals of the external axes of a position: E1, E2 and so on, and all other groups."""
    ordinals = list[int]()
    for name in sorted(groups.of_arm):
        if re.fullmatch(r"E\d", name):
            ordinals += groups.of_arm[name].ordinals
    return (*ordinals, *groups.ordinals_of_others)


def _refuse_incomplete_position(fields: _Fields) -> None:
    """Refuse the fields of the arm's group if they state no position, or neither base nor tool.

    Raises:
        Misread: the position was not recorded, or has no UF or UT.
    """
    for name, field in fields.items():
        is_external_axis = name.startswith("E")
        if field.text.startswith("*") and not is_external_axis:
            remedy = "record the position, or delete the position and its moves"
            raise Misread("the position was not recorded (***)", remedy)
    for kind in ("UF", "UT"):
        frame = fields.get(kind, _Field())
        is_stated = bool(frame.ordinals) or frame.text == "F"  # F is the active frame
        if not is_stated:
            raise Misread("the position has no group GP1 with UF and UT", _RECORD_AGAIN)


def _read_turns(configuration: _Field) -> tuple[tuple[str, int], ...]:
    """Return the turns of joints 1, 4 and 6 that a configuration `N U T, 0, 0, 0` states.

    Each turn is given by its name and the ordinal of its number: `turn1`, `turn4` and `turn6`. There are none
    in a configuration of another form.
    """
    if not _CONFIG.fullmatch(configuration.text):
        return ()
    turn1, turn4, turn6, *_ = configuration.ordinals
    return ("turn1", turn1), ("turn4", turn4), ("turn6", turn6)


def _read_letters(configuration: _Field) -> str:
    """Return the letters of a configuration: `NUT` for `N U T, 0, 0, 0`."""
    letters, _, _ = configuration.text.partition(",")
    return "".join(letters.split())


_POSITION_LANGUAGE: Final = ir.Language(
    comment=r":[^:\[\]\r\n]*+(?=\])",
    text=r"(?!)",
    ignores_case=False,
    rules=((r"(?s)[\s\S]*", _declare_position),),
)
_SECTION_ORDER: Final = ("PROG", "ATTR", "APPL", "MN", "POS", "END")
_SECTION: Final = re.compile(r"/(?P<name>PROG|ATTR|APPL|MN|POS|END)\b.*+")
_LINE: Final = re.compile(r"\s*+(?P<number>\d*+)\s*+:")
_FOLLOWS_CONVEYOR: Final = re.compile(r"LINE_TRACK_SCHEDULE_NUMBER\s*+:\s*+0*+[1-9]")
_POSITION: Final = re.compile(r"(?P<position>P.*?\};)|\S[^P]*+", re.DOTALL)
_BEGIN_OF_POSITION: Final = re.compile(r"P\s*+\[[^\]{}]*+\]\s*+\{")
"""The text `P[1:"home"]{`, without which the text up to the next `};` is no position."""
_SECOND_POSITION: Final = re.compile(r"\s*+P\s*+\[")


def read_fanuc(statements: Statements, sources: tuple[Source, ...]) -> None:
    """Add the statements of a .LS file, and of the programs that it calls, whose moves are not corrected.

    Raises:
        ProgramError: a section is missing or misplaced, or a line is not in the controller's form.
    """
    # Each program has positions P[n] of its own: in a further file, `P` means those of this file.
    statements.owners = {index: {"P": f"file{index}"} for index in range(1, len(sources))}
    for index, source in enumerate(sources):
        if index == 0:
            _add_main_program(statements, source)
        else:
            _add_called_program(statements, index, source)


def _add_main_program(statements: Statements, source: Source) -> None:
    """Add the positions in /POS and the instructions in /MN of the program whose moves are corrected.

    Raises:
        ProgramError: a section is missing or misplaced, or a line is not in the controller's form.
    """
    sections = _find_sections(statements, 0, source)
    starts, ends = _find_positions(statements, source, sections).to_arrays()
    statements.add_statements(0, starts, ends, translate=_POSITION_LANGUAGE.translate)
    starts, ends = sections.instructions.to_arrays()
    statements.add_statements(0, starts, ends)
    if _FOLLOWS_CONVEYOR.search(source.text, 0, sections.end_of_head):
        reason = "the program follows a conveyor: its targets move with the conveyor's frame"
        statements.forget_anytime(ir.ALL_TARGETS, reason, "set LINE_TRACK_SCHEDULE_NUMBER to 0")


def _add_called_program(statements: Statements, index: int, source: Source) -> None:
    """Add the instructions of a program that is called, which is the file with this index.

    The head of a program states which groups of axes it moves: with `DEFAULT_GROUP = *,1,*,*,*;` a positioner
    (group 2), not the arm (group 1). Then `UFRAME_NUM=2` in it may choose a frame of the positioner, and what
    is active for the arm is unknown: such a program is translated by `_translate_other_groups`.

    Raises:
        ProgramError: a section is missing or misplaced.
    """
    sections = _find_sections(statements, index, source)
    does_not_move_arm = _OTHER_GROUPS.search(source.text, 0, sections.end_of_head) is not None
    translate = _translate_other_groups if does_not_move_arm else None  # None: as all other programs
    starts, ends = sections.instructions.to_arrays()
    statements.add_statements(index, starts, ends, translate=translate)


_OTHER_GROUPS: Final = re.compile(r"(?m)^DEFAULT_GROUP\s*+=\s*+\*")
"""Head of a program whose group of axes is not the arm's."""


def _translate_other_groups(masked: str) -> list[tuple[int, Op]]:
    """Translate an instruction of a program that moves other axes than the arm's, such as a positioner.

    Behind a choice of a frame, such as `UFRAME_NUM=2`, the arm's active frame is unknown. All other
    instructions are translated as those of any program.

    Args:
        masked: the instruction with NUL in place of each number.

    Returns:
        Operations, each with its number of lines below the first line of the instruction.
    """
    ops = list[tuple[int, Op]]()
    for line_offset, op in LANGUAGE.translate(masked):
        ops.append((line_offset, _forget_chosen_frame(op)))
    return ops


def _forget_chosen_frame(op: Op) -> Op:
    """Return an operation that makes the active frame unknown in place of one that chooses it.

    For the assignment of `UF 2` to UFRAME_NUM, this makes UFRAME_NUM unknown, because it is not certain that
    the frame is one of the arm. Any other operation is returned as it is.
    """
    if not isinstance(op, ir.Assign) or op.name not in LANGUAGE.active:
        return op
    reason = "a program for other groups of axes chooses a frame"
    return ir.MakeUnknown(frozenset({op.name}), reason, _REMEDY)


class _Spans:
    """Places of statements in a file, in its order."""

    def __init__(self) -> None:
        """Begin without statements."""
        self._borders = array("q")  # first and last + 1 character of each statement, one after the other

    def add(self, start: int, end: int) -> None:
        """Add a statement by its first and its last + 1 character."""
        self._borders.extend((start, end))

    def extend_last(self, end: int) -> None:
        """Let the last statement end with the character before the index `end`."""
        self._borders[-1] = end

    def read_last(self, text: str) -> str | None:
        """Return the last statement, which is a part of the text of the file; None if there is none."""
        return text[self._borders[-2] : self._borders[-1]] if self._borders else None

    def to_arrays(self) -> tuple[IndexArray, IndexArray]:
        """Return the first character (k,) and the last + 1 character (k,) of each statement."""
        starts, ends = np.asarray(memoryview(self._borders), dtype=np.intp).reshape(-1, 2).T
        return starts, ends


class _LineOfFile(NamedTuple):
    """Line of a file."""

    number: int  # 1 for the first line
    start: int  # index of its first character
    text: str  # without the end of the line

    @property
    def end(self) -> int:
        """Index behind its last character."""
        return self.start + len(self.text)


def _list_lines(source: Source) -> Iterator[_LineOfFile]:
    """Yield the lines of a file."""
    spans = zip(iterate_integers(source.starts), iterate_integers(source.ends), strict=True)
    for number, (start, end) in enumerate(spans, 1):
        yield _LineOfFile(number, start, source.text[start:end].rstrip("\r\n"))


class _Sections(NamedTuple):
    """Sections of a file, such as /MN."""

    heads: dict[str, int]  # index behind the head of each section, by its name
    # the lines of /MN, and the heads of /PROG and /POS, where the program begins and ends
    instructions: _Spans

    @property
    def end_of_head(self) -> int:
        """Index behind the head of /MN, before which the attributes of the program are."""
        return self.heads["MN"]


def _find_sections(statements: Statements, index: int, source: Source) -> _Sections:
    """Find the sections of a file, which begin with lines such as /PROG, /MN and /POS, and its instructions.

    The instructions are the lines of /MN, such as `   1:L P[1] 100mm/sec FINE    ;`. The lines /PROG and /POS
    count as instructions, too: they begin and end the program.

    Args:
        statements: statements of the program, which refuse a file with a mistake.
        index: index of the file.
        source: the file.

    Raises:
        ProgramError: a section is missing or misplaced, or there is text behind the last one.
    """
    heads, instructions = dict[str, int](), _Spans()
    section = ""  # the present one
    for line in _list_lines(source):
        if head := _SECTION.match(line.text):
            section = head["name"]
            _refuse_misplaced_section(statements, index, line.number, section, heads)
            heads[section] = line.end
            begins_or_ends_program = section in {"PROG", "POS"} and "PROG" in heads
            if begins_or_ends_program:
                instructions.add(line.start, line.end)
        elif section == "END":
            _refuse_text_behind_end(statements, index, line)
        elif section == "MN":
            _add_instruction(source, instructions, line)
    _check_sections(statements, index, heads)
    return _Sections(heads, instructions)


def _refuse_text_behind_end(statements: Statements, index: int, line: _LineOfFile) -> None:
    """Refuse a line behind /END in the file with this index, unless the line is blank.

    Raises:
        ProgramError: the line has a text.
    """
    if line.text.strip():
        remedy = "send each program as a file of its own"
        statements.refuse(line.number, "there is text after /END", remedy, index)


def _refuse_misplaced_section(
    statements: Statements, index: int, line: int, section: str, earlier: Collection[str]
) -> None:
    """Refuse a section such as /POS that occurs twice, or is before one that it has to follow.

    The order is /PROG, /ATTR, /APPL, /MN, /POS, /END; only /APPL may occur several times.

    Args:
        statements: statements of the program, which raise the error.
        index: index of the file.
        line: number of the section's line.
        section: name of the section.
        earlier: names of the sections before it.

    Raises:
        ProgramError: the section is such a one.
    """
    occurs_twice = section in earlier and section != "APPL"
    latest = max(map(_SECTION_ORDER.index, earlier), default=0)
    comes_too_late = _SECTION_ORDER.index(section) < latest
    if occurs_twice or comes_too_late:
        reason = f"the section /{section} occurs twice or in the wrong place"
        statements.refuse(line, reason, "send each program as a file of its own", index)


def _check_sections(statements: Statements, index: int, sections: Collection[str]) -> None:
    """Check that a file has all of its sections.

    Raises:
        ProgramError: a section is missing.
    """
    if not {"MN", "POS"} <= set(sections):
        remedy = "write the program as ASCII (.LS), not as binary (.TP)"
        statements.refuse(None, "the file lacks the section /MN or /POS", remedy, index)
    if "END" not in sections:
        reason = "the file lacks /END: its end may have been cut off"
        statements.refuse(None, reason, "send the whole program", index)


def _add_instruction(source: Source, instructions: _Spans, line: _LineOfFile) -> None:
    """Add a line of /MN, such as `  12:L P[1] 100mm/sec FINE ;`, to the instructions of a file.

    The instruction is the text behind the number and the colon. A line without a number, such as
    `    :  P[2] 100mm/sec FINE ;`, continues an instruction before it that has no semicolon at its end. A
    line in another form is an instruction of its own, which is not understood. Comments, blank lines, and
    lines `--` that end a block of logic are left out.
    """
    head = _LINE.match(line.text)  # the number of the line, which may be missing, and the colon
    begin_of_body = head.end() if head else 0
    has_form_of_controller = head is not None or _SECOND_POSITION.match(line.text) is not None
    is_comment = line.text[begin_of_body:].lstrip().startswith(("!", "//", "--"))
    is_left_out = line.text.lstrip().startswith("--") or (has_form_of_controller and is_comment)
    if is_left_out or not line.text.strip():
        return
    has_number = head is not None and head["number"] != ""
    is_instruction_of_its_own = has_number or not has_form_of_controller
    if is_instruction_of_its_own or _is_last_complete(source, instructions):
        instructions.add(line.start + begin_of_body, line.end)
    else:  # the line continues the last instruction
        instructions.extend_last(line.end)


def _is_last_complete(source: Source, instructions: _Spans) -> bool:
    """Return whether the last instruction of a file ends with a semicolon, or there is none so far."""
    last_instruction = instructions.read_last(source.text)
    return last_instruction is None or last_instruction.rstrip().endswith(";")


def _find_positions(statements: Statements, source: Source, sections: _Sections) -> _Spans:
    """Find the positions in the section /POS, such as `P[1:"home"]{ GP1: ... };`.

    Raises:
        ProgramError: there is a text between positions, or a position has no end.
    """
    begin, end = sections.heads["POS"], sections.heads["END"] - len("/END")
    positions = _Spans()
    # The section is read as pieces: each is a text from a letter P to the next `};`, or another text.
    for piece in _POSITION.finditer(source.text, begin, end):
        position = piece["position"]  # None for another text
        if position is None or not _BEGIN_OF_POSITION.match(position):
            reason = f"{quote_text(piece[0])} between positions is unknown or has no end"
            statements.refuse(source.find_line(piece.start()), reason, _RECORD_AGAIN)
        positions.add(*piece.span())
    return positions


LANGUAGE: Final = ir.Language(
    suffixes=".ls",
    pose=POSE,
    remark="    :  !",
    head="/MN",
    read=read_fanuc,
    # comment behind a number in brackets, and the text of a message
    comment=r":[^\[\]\r\n]*+(?=\])|(?<=MESSAGE)\[[^\[\]\r\n]*+\]",
    blank=r" ?;?:|^[ ;]+|[ ;]+$",
    text=r"'[^'\r\n]*+'",
    word=r"[$]?[^\W\d]\w*+",
    ignores_case=False,
    operators="AND|OR|NOT|DIV|MOD|STRLEN|FINDSTR|SUBSTR",
    reserved="JMP|CALL|RUN|LBL|IF|THEN|ELSE|ENDIF|FOR|TO|DOWNTO|ENDFOR|SELECT|INC|OFFSET|Offset|Skip|SKIP|VOFFSET|TOOL_OFFSET"
    r"|P(?=\[)",
    functions="WAIT|ABS|SQRT|SIN|COS|TAN|LN|EXP|ROUND|TRUNC|ATAN2|ASIN|ACOS|MOD",
    motion=r"(?<![\w$.\[])[JLCAS]\s++PR?\s*+\[",
    remedy=_REMEDY,
    active={"UFRAME_NUM": "active UFRAME_NUM", "UTOOL_NUM": "active UTOOL_NUM"},
    constants={"UF 0": np.eye(4), "UT 0": np.eye(4)},  # the robot's own frames: its base and its flange
    field_endings=(".UF", ".UT"),
    is_frame=lambda name: name.startswith(("UF ", "UT ")),
    # Manual, chapter 4: other programs cannot change the positions of this program.
    is_own=lambda name: name.startswith("P["),
    positions="P",
    is_reached=lambda name: name in {"UFRAME_NUM", "UTOOL_NUM"},
    lasting="",  # offsets, tracking, soft float: what is not understood may last
    rules=(
        (r"/PROG (?P<name>\w++)(?: .*)?", lambda line: [ir.Flow("routine", line["name"].upper())]),
        (r"/PROG.*", lambda line: [ir.Flow("routine", line.text)]),
        (r"/POS.*", "end"),
        # Behind the end are positions that people use by hand: what follows may run, too.
        (r"END", lambda _: [ir.Flow("if"), ir.Flow("return"), ir.Flow("close")]),
        (r"(?P<letter>[JLCAS]) P\[\0\] ?(?P<second>P\[\0\] ?)?(?P<tail>.*)", _translate_move),
        (r"[JL] PAL_\w+\[\w+\] ?(?P<tail>.*)", _translate_pallet_move),
        (rf"{_KINDS} (?:End|END)", lambda line: [ir.end_lasting(line["kind"])]),
        (rf"{_KINDS}(?! ?(?:End|END)\b)[ \[].*", _translate_lasting),
        (r"P?R\[[^\]]*\]=P\[#{place}(?:,\0)?\]", _translate_copy_to_register),
        (r"[JLAS] (?:PR?\[[RA]+\[\0\]\]|PR\[(?:\0|GP\d)\]) ?(?P<tail>.*)", _translate_register_move),
        (rf"(?!\$MN){_CHOICE}=#{{number}}", _translate_frame_choice),
        # The number in $MNUFRAMENUM[n] is that of a group of axes, which may be another one than the arm.
        (rf"{_CHOICE}=[\0\w\[\]()+*/-]+", _translate_computed_choice),
        (r"IF ?(.+?) ?THEN", "if"),
        (r"FOR R\[\0\]=(.+?)(?: TO| DOWNTO) ?(.+)", "loop"),
        (r"ELSE", "default"),
        (r"ENDIF|ENDFOR", "close"),
        (r"LBL ?\[#{name}\]", "label"),
        (r"(?:(?P<wait>WAIT) ?(.+?),? ?TIMEOUT,|JMP )LBL ?\[(?P<label>.*)\]", _translate_jump),
        (
            r"VISION GET_\w+ [^\[\]]*(?:\[[^\[\]]*\][^\[\]]*?)*(?P<action>JMP LBL ?\[[^\[\]]*\])",
            _translate_conditional_action,
        ),
        (rf"(?:IF ?(.+?)|SELECT ?(?P<which>.+?)|=(.+?)|ELSE),{_LOGIC}", _translate_conditional_action),
        (rf"(?P<verb>CALL|RUN|MONITOR) (?P<name>\w++|SR\[\0\]){_ARGUMENTS}", _translate_call),
        (r"(?:ERROR|MAINT|RESUME)_PROG(?:\[.+\])?=(?P<name>\w++)", _translate_event),
        (_HARMLESS, _translate_harmless_instruction),
        (r"(?:.*\W)?\$?(?:MN)?(?:UFRAME|UTOOL)(?:\[.*\])?=.*", _translate_frame_change),
        (r".*(?:UFRAME|UTOOL).*", _refuse_computed_frame),
        (
            rf"(?!{_LASTING_WORDS})(?P<name>[A-Za-z]\w*(?:[ .]\w+)*(?: ?\0)?(?: ?\[[^\[\]]*\])?){_ARGUMENTS}",
            _translate_macro,
        ),
        (rf"(?P<name>(?!P\b)[A-Za-z]\w*)(?:{_BRACKETS})?=(?P<value>.+)", _translate_assignment),
        (r"P\[#{place}(?:,\0)?\]=.*|(?:(?!(?<!\w)P\[).)*(?<!\w)P\[[^=]*=.*", _translate_position_change),
    ),
)
