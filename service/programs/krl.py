"""Programs of KUKA (KRL): .src with .dat and $config.dat; the statements that are understood."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import numpy as np

from jointstiff.service.programs.errors import shown
from jointstiff.service.programs.forms import Forms
from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import FrameName, Literal, Motion
from jointstiff.service.programs.reader import (
    Place,
    Reader,
    Script,
    Statement,
    pose_of,
    used_in,
    words,
)
from jointstiff.service.programs.scanner import NUMBER, Cursor, Lexicon, Misread, Used

POSE: Final = Notation(Orientation.EULER_ZYX)
JOINTS: Final = Notation(Orientation.JOINTS)
_MOVES: Final = {
    "PTP": (Motion.JOINT, 1),
    "SPTP": (Motion.JOINT, 1),
    "LIN": (Motion.LINEAR, 1),
    "SLIN": (Motion.LINEAR, 1),
    "SPL": (Motion.SPLINE, 1),
    "CIRC": (Motion.CIRCULAR, 2),
    "SCIRC": (Motion.CIRCULAR, 2),
}
_BLENDS: Final = ("C_PTP", "C_DIS", "C_VEL", "C_ORI", "C_SPL")
_HOME: Final = words("$AXIS_ACT $POS_ACT $H_POS HOME XHOME XHOME1 XHOME2 XHOME3 XHOME4 XHOME5")
"""Places that a controller keeps: nothing of a move there stands in the program."""
_FIELDS: Final = ((POSE, ("X", "Y", "Z", "A", "B", "C")), (JOINTS, ("A1", "A2", "A3", "A4", "A5", "A6")))
_TYPES: Final = words("INT REAL BOOL CHAR POS E6POS FRAME AXIS E6AXIS FDAT PDAT LDAT LOAD SIGNAL")
_SETTINGS: Final = words(
    """
    $VEL $ACC $APO $VEL_AXIS $ACC_AXIS $ORI_TYPE $CIRC_TYPE $ADVANCE $OUT $OUT_C $ANOUT $FLAG $CYCFLAG
    $TIMER $TIMER_STOP $BWDSTART $H_POS $OV_PRO $LOAD $JERK $GEAR_JERK $VEL_EXTAX $ACC_EXTAX $RED_VEL
    $APO_DIS_PTP $CIRC_MODE $SPL_ORI_JOINT_AUTO
    """
)
"""The controller's variables of speed, blending and signals."""
_FUNCTIONS: Final = words(
    """
    ABS SQRT SIN COS TAN ACOS ATAN2 INV_POS SVEL_JOINT SVEL_CP SACC_JOINT SACC_CP SAPO SAPO_PTP SORI_TYP
    SJERK SGEAR_JERK SLOAD SIPO_MODE SCIRC_TYP STOOL STOOL2 SBASE STRCLEAR STRADD STRCOPY STRCOMP STRFIND
    STRLEN STRDECLLEN STRTOINT STRTOREAL STRTOBOOL VARSTATE GET_SYSTEM_DATA ROUND TRUNC PULSE
    """
)
"""Routines of the controller that move nothing."""
_LEXICON: Final = Lexicon(
    comment=r";[^\r\n]*+|(?<![^\r\n])&[^\r\n]*+",
    signs="==|<>|<=|>=",
    text=r"\"[^\"\r\n]*+\"|#\w++|'[HD][0-9A-F]++'",
    word=r"\$?[^\W\d]\w*+",
    number=rf"{NUMBER}|'B[01]{{1,16}}+'",
    operators=words(". : == <> < > <= >= AND OR EXOR B_AND B_OR B_EXOR NOT B_NOT"),
    prefixes=words("+ - NOT B_NOT"),
    functions=_FUNCTIONS,
    reserved=words(
        """
        PTP SPTP LIN SLIN SPL CIRC SCIRC PTP_REL LIN_REL CIRC_REL SPTP_REL SLIN_REL SPL_REL SCIRC_REL ASYPTP
        ASYCONT DEF DEFFCT DEFDAT END ENDFCT ENDDAT IF THEN ELSE ENDIF FOR TO STEP ENDFOR WHILE ENDWHILE
        LOOP ENDLOOP REPEAT UNTIL SWITCH CASE DEFAULT ENDSWITCH GOTO WAIT HALT EXIT RETURN CONTINUE TRIGGER
        INTERRUPT SPLINE ENDSPLINE PTP_SPLINE TIME_BLOCK CONST_VEL DECL GLOBAL SIGNAL EXT EXTFCT BRAKE
        RESUME WITH DO ANOUT ANIN BAS C_PTP C_DIS C_VEL C_ORI C_SPL $BASE $TOOL
        """
    ),
)
_REMEDY: Final = (
    "write all of X, Y, Z, A, B, C (or A1 ... A6) as numbers, and send the .dat that declares them"
)
_FRAME_REMEDY: Final = "give the whole frame in numbers, or as BASE_DATA[i] or TOOL_DATA[i]"


@dataclass
class _Program(Script):
    """The state of a program while it is read."""

    base: FrameName = field(default_factory=lambda: FrameName("active $BASE"))
    tool: FrameName = field(default_factory=lambda: FrameName("active $TOOL"))
    frames: dict[str, tuple[Place, Literal]] = field(default_factory=dict)  # BASE_DATA[i], TOOL_DATA[i]
    used: set[str] = field(default_factory=set)  # names of frames that were active
    interrupts: set[float] = field(default_factory=set)  # numbers of those that are declared
    # declaration, which is not sent, of the active base or tool: no matter until a move needs it
    unknown: dict[str, str] = field(default_factory=dict)

    def move(self, place: Place, motion: Motion, targets: Sequence[Literal | str], own: str) -> None:
        """Take a move; `own` declares frames of its own."""
        home = [
            name
            for name in targets
            if isinstance(name, str)
            and name in _HOME
            and (name not in self.given or _is_config(self.reader, self.given[name][0].source))
        ]
        if home and len(targets) > 1:
            self.reader.refuse(place.line, "an arc through a place that the controller keeps", _REMEDY)
        elif home:
            self.moved = True
            self.reader.leave(place.line, f"a move to {home[0]}, which the controller keeps")
        else:
            held = self.base, self.tool, dict(self.unknown)
            if own:
                self.declared(place, own, move=True)
            if self.unknown:
                reason = f"the frames {shown(next(iter(self.unknown.values())))} are not in the program"
                self.reader.refuse(place.line, reason, "send the .dat, and $config.dat, with the .src")
            else:
                stated = [self.given.get(name) if isinstance(name, str) else None for name in targets]
                if any(each and _is_config(self.reader, each[0].source) for each in stated):
                    reason = "the target stands in $config.dat, which other programs use"
                    self.reader.refuse(place.line, reason, "declare it in the program's own .dat")
                else:
                    self.targeted(place, motion, targets, [(self.base, self.tool)] * len(targets))
            self.base, self.tool, self.unknown = held

    def chosen(self, place: Place, which: str, name: str, *, move: bool = False) -> None:
        """Take $BASE or $TOOL by a name that has numbers."""
        if name in self.changed:
            self.reader.refuse(
                place.line, f"{name} changes while the program runs", "give it once, in numbers", place.source
            )
            return
        known = self.frames.get(name)
        pose = pose_of(*known) if known else None
        if name in {"$NULLFRAME", "BASE_DATA[0]", "TOOL_DATA[0]"}:
            pose = np.eye(4)
        self._set(place, which, FrameName(name, pose), move=move)

    def _set(self, place: Place, which: str, frame: FrameName, *, move: bool = False) -> None:
        """Make a frame the active one, if it is not; for one move only, it may be any."""
        active = self.tool if which == "TOOL" else self.base
        self.used.add(frame.name)
        same = which not in self.unknown and active.same(frame)
        if not move and not same and not self.settable(place, f"${which}"):
            return
        self.unknown.pop(which, None)
        if which == "TOOL":
            self.tool = frame
        else:
            self.base = frame

    def stated(self, place: Place, which: str, literal: Literal) -> None:
        """Take $BASE or $TOOL in numbers."""
        pose = pose_of(place, literal)
        if pose is None:
            self.reader.refuse(place.line, f"${which} is computed", _FRAME_REMEDY, place.source)
        else:
            self._set(place, which, FrameName(f"${which} of line {place.line}", pose))

    def interrupted(self, place: Place, ordinal: int, *, declares: bool) -> None:
        """Take the declaration of an interrupt, or its number where it is switched on."""
        number = place.value(ordinal)
        if declares:
            self.interrupts.add(number)
        elif number not in self.interrupts:
            reason = (
                f"interrupt {number:g} is declared elsewhere, and may move the robot or change its frames"
            )
            self.reader.refuse(place.line, reason, "declare it in the program")

    def numbered(self, place: Place, which: str, ordinal: int) -> None:
        """Take $BASE or $TOOL by the number of its data."""
        number = place.value(ordinal)
        if number.is_integer():
            self.chosen(place, which, f"{which}_DATA[{int(number)}]")
        else:
            self.reader.refuse(place.line, "the number of a frame is no whole number", _FRAME_REMEDY)

    def declared(self, place: Place, name: str, *, move: bool = False) -> None:
        """Take tool and base of an inline form, by the name of their declaration."""
        known = self.constant(name, place)
        if known is None:
            if move or self.settable(place, "FDAT_ACT"):
                self.unknown = {"TOOL": name, "BASE": name}
        else:
            self.inline(place, *known, move=move)

    def inline(self, place: Place, where: Place, literal: Literal, *, move: bool = False) -> None:
        """Take tool and base of an inline form: `FDAT_ACT={TOOL_NO 1,BASE_NO 2}`."""
        numbers = [
            where.value(literal.fields[name]) for name in ("TOOL_NO", "BASE_NO") if name in literal.fields
        ]
        fault = ""
        if len(numbers) < 2 or not all(number.is_integer() for number in numbers):  # nor is infinity
            fault = "the number of a frame is no whole number"
        elif literal.texts.get("IPO_FRAME", "#BASE").upper() != "#BASE":
            fault = "the tool is fixed in the cell (IPO_FRAME)"
        if fault:
            self.reader.refuse(
                place.line, fault, "only tools on the flange, by TOOL_NO and BASE_NO, are known"
            )
        else:
            self.chosen(place, "TOOL", f"TOOL_DATA[{int(numbers[0])}]", move=move)
            self.chosen(place, "BASE", f"BASE_DATA[{int(numbers[1])}]", move=move)

    def data(self, place: Place, which: str, ordinal: int, literal: Literal | None) -> None:
        """Take BASE_DATA[i] or TOOL_DATA[i]."""
        name = f"{which}[{place.value(ordinal):g}]"
        if name in self.used:
            reason = f"{name} changes while the program runs"
            self.reader.refuse(place.line, reason, _FRAME_REMEDY, place.source)
        elif literal is None or literal.notation is not POSE or self.depth or self.jumped or self.routine > 1:
            self.changed.add(name)
        else:
            self.frames[name] = place, literal


def _is_config(reader: Reader, source: int) -> bool:
    return reader.sources[source].name.lower().endswith("config.dat")


def _statement(c: Cursor) -> Statement:
    """Parse a line."""
    is_global = c.accept("GLOBAL") is not None
    name = c.word()
    if name in _MOVES:
        return _move(c, name)
    if name in _RULES:
        return _RULES[name](c, name)
    if name in _FORMS and c.peek(1).text not in {"#TOOL", "#BASE"}:
        c.attempt(c.place - 1)
        return _FORMS.take(c)
    if name.endswith("_REL"):
        raise Misread("a relative move")
    if c.at(":") and c.peek(1).kind == "end":
        c.take()
        return Statement(jumps=True)
    if c.at("("):
        return _active(c) if name == "BAS" else _call(c, name)
    if (name in _TYPES or is_global) and c.peek().kind == "word":
        return _declared(c)
    return _assigned(c, name)


def _call(c: Cursor, name: str) -> Statement:
    used = Used()
    c.arguments(used)
    c.finish()
    if name in _LEXICON.reserved:
        raise Misread(f"{name} is no routine")
    calls = used.calls if name in _FUNCTIONS else used.calls | {name}
    return Statement(calls=frozenset(calls), changes=frozenset(used.passed))


# values


def _aggregate(c: Cursor) -> Literal | None:
    """Take `{...}`; None if it holds what is no number."""
    c.expect("{")
    if c.peek().kind == "word" and c.peek(1).text == ":":
        c.take()
        c.take()
    numbers: dict[str, int] = {}
    texts: dict[str, str] = {}
    plain = True
    while not c.at("}"):
        name = c.name()
        if c.accept("["):
            if not c.at("]"):
                c.number()
            c.expect("]")
        plain &= name not in numbers and name not in texts
        if c.peek().kind == "number":
            numbers[name] = c.number()
        else:
            plain &= _field(c, name, texts)
        if not c.accept(","):
            break
    c.expect("}")
    return _literal(numbers, texts) if plain else None


def _field(c: Cursor, name: str, texts: dict[str, str]) -> bool:
    """Take a field that is no number; return whether its value stands in the text."""
    if c.at("{"):
        _aggregate(c)
        texts[name] = "{}"
    elif c.peek().kind == "text" or c.at("TRUE", "FALSE"):
        texts[name] = c.take().text
    else:
        used = Used()
        c.expression(",", "}", used=used)
        if used.calls:
            raise Misread("a call within { }")
        return False
    return True


def _literal(numbers: dict[str, int], texts: dict[str, str]) -> Literal:
    """Return what the fields of an aggregate are."""
    for notation, fields in _FIELDS:
        if all(field in numbers for field in fields):
            external = tuple(numbers.get(f"E{i}", -1) for i in range(1, 7))
            said = tuple((kind, numbers[kind]) for kind in ("S", "T") if kind in numbers)
            return Literal(
                notation,
                tuple(numbers[field] for field in fields),
                external if max(external) >= 0 else (),
                said,
                fields=numbers,
                texts=texts,
            )
    return Literal(None, fields=numbers, texts=texts)


def _value(c: Cursor, used: Used, *stops: str) -> Literal | None:
    """Take a value up to a stop or the end; return it if it is a literal of numbers."""
    begin = c.place
    if c.at("{"):
        literal = _aggregate(c)
        if c.ended or c.at(*stops):
            return literal
        c.attempt(begin)
    c.expression(*stops, used=used)
    return None


def _declared(c: Cursor) -> Statement:
    """Take what follows the type of a declaration."""
    name, used = c.name(), Used()
    changed: set[str] = set()
    gives: tuple[str, Literal] | None = None
    while True:
        array = c.accept("[") is not None
        while array and not c.accept("]"):
            if c.accept(",") is None:
                c.expression(",", "]", used=used)
        if c.accept("="):
            literal = _value(c, used, ",")
            if literal is None or array or gives is not None:
                changed.add(name)
            else:
                gives = name, literal
        if not c.accept(","):
            break
        name = c.name()
    c.finish()
    return Statement(gives=gives, calls=frozenset(used.calls), changes=frozenset(changed | used.passed))


def _assigned(c: Cursor, name: str) -> Statement:
    """Take what follows the first word of an assignment."""
    used = Used()
    index, whole = _index(c, used)
    if name in {"$BASE", "$TOOL"}:
        return _frame(c, name[1:], whole=whole and index is None)
    if name in {"FDAT_ACT", "$IPO_MODE"}:
        return _mode(c, name, whole=whole and index is None)
    if name.startswith("$") and name not in _SETTINGS:
        raise Misread(f"the controller's variable {name} is not known here", "leave it out")
    literal = _value(c, used)
    c.finish()
    if name in {"BASE_DATA", "TOOL_DATA"}:
        if index is None or index < 0:
            raise Misread(f"{name} of a computed number", _FRAME_REMEDY)
        given = literal if whole else None
        return used_in(used, act=partial(_Program.data, which=name, ordinal=index, literal=given))
    if literal is not None and whole and index is None and (literal.notation or "TOOL_NO" in literal.fields):
        return Statement(gives=(name, literal))
    return replace(used_in(used), changes=frozenset(used.passed | {name}))


def _index(c: Cursor, used: Used) -> tuple[int | None, bool]:
    """Take index, components and `=` of an assignment.

    Returns:
        Number in the brackets: None without brackets, -1 for others. Whether all of a variable is assigned.
    """
    index: int | None = None
    whole = True
    while not c.accept("="):
        if c.accept("["):
            index = -1
            if c.peek().kind == "number" and c.peek(1).text == "]" and whole:
                index = c.number()
            while not c.accept("]"):
                if not c.accept(","):
                    c.expression("]", ",", used=used)
        else:
            c.expect(".")
            c.name()
            whole = False
    return index, whole


def _mode(c: Cursor, name: str, *, whole: bool) -> Statement:
    """Take the value of FDAT_ACT or $IPO_MODE."""
    if not whole:
        raise Misread(f"{name} is set in part", "send the .dat, with TOOL_NO and BASE_NO in numbers")
    if name == "$IPO_MODE":
        if c.take().text.upper() != "#BASE" or not c.ended:
            raise Misread("the tool is fixed in the cell ($IPO_MODE)", "only tools on the flange are known")
        return Statement()
    literal, declared = (_aggregate(c), "") if c.at("{") else (None, c.name())
    c.finish()
    if declared:
        return Statement(act=partial(_Program.declared, name=declared))
    if literal is None:
        raise Misread("FDAT_ACT is computed", "give TOOL_NO and BASE_NO in numbers")
    return Statement(act=lambda program, place: program.inline(place, place, literal))


def _frame(c: Cursor, which: str, *, whole: bool) -> Statement:
    """Take the value of $BASE or $TOOL."""
    computed = Misread(f"${which} is computed, or set in part", _FRAME_REMEDY)
    if not whole:
        raise computed
    if c.at("{"):
        literal = _aggregate(c)
        c.finish()
        if literal is None:
            raise computed
        return Statement(act=partial(_Program.stated, which=which, literal=literal))
    name = c.name()
    if name == f"{which}_DATA" and c.accept("["):
        ordinal = c.number()
        c.expect("]")
        c.finish()
        return Statement(act=partial(_Program.numbered, which=which, ordinal=ordinal))
    if not c.ended:
        raise computed
    return Statement(act=partial(_named, which=which, name=name))


def _active(c: Cursor) -> Statement:
    """Take the rest of `BAS(#TOOL, 3)`."""
    c.expect("(")
    which = c.take().text[1:]
    c.expect(",")
    ordinal = c.number()
    c.expect(")")
    c.finish()
    return Statement(act=partial(_Program.numbered, which=which, ordinal=ordinal))


def _named(program: _Program, place: Place, which: str, name: str) -> None:
    """Take $BASE or $TOOL by the name of a variable."""
    known = program.constant(name, place)
    if known is not None and name != "$NULLFRAME":
        program.frames[name] = known
    program.chosen(place, which, name)


# moves


def _move(c: Cursor, name: str) -> Statement:
    motion, count = _MOVES[name]
    targets: list[Literal | str] = []
    for i in range(count):
        if i:
            c.expect(",")
        literal = _aggregate(c) if c.at("{") else c.name()
        if literal is None or (isinstance(literal, Literal) and literal.notation is None):
            raise Misread("the target is not a whole pose or a whole set of angles in numbers", _REMEDY)
        targets.append(literal)
    while c.accept(*_BLENDS):
        pass
    own = _with(c, moves=True)
    while c.accept(*_BLENDS):
        pass
    if not c.ended:
        raise c.misread("what follows the target is not known", _REMEDY)
    act = partial(_Program.move, motion=motion, targets=tuple(targets), own=own)
    return Statement(act=act, repeats=not own and all(isinstance(each, Literal) for each in targets))


def _with(c: Cursor, *, moves: bool = False) -> str:
    """Take settings behind WITH; return the name of the frames' declaration, if there is one."""
    own: dict[str, str] = {}
    more = c.accept("WITH")
    while more:
        name, used = c.word(), Used()
        _index(c, used)
        if name in {"$TOOL", "$BASE"} and moves:
            own[name] = _declaration(c, name)
        elif name in _SETTINGS or (name == "$IPO_MODE" and c.at("SIPO_MODE")):
            _value(c, used, ",")
        else:
            reason = "a move or a block of moves has frames of its own"
            raise Misread(reason, "set $TOOL and $BASE before it")
        if used.calls:
            raise Misread("a call in the settings of a move")
        more = c.accept(",")
    if own and (len(own) < 2 or len(set(own.values())) > 1):
        raise Misread("the move has a frame of its own", "set $TOOL and $BASE before the move")
    return own.get("$TOOL", "")


def _declaration(c: Cursor, name: str) -> str:
    """Take `STOOL2(FP1)` or `SBASE(FP1.BASE_NO)`; return the name of the declaration."""
    c.expect(*(("STOOL", "STOOL2") if name == "$TOOL" else ("SBASE",)))
    c.expect("(")
    declaration = c.name()
    if c.accept("."):
        c.expect("BASE_NO", "TOOL_NO")
    c.expect(")")
    return declaration


# other statements


def _routine(c: Cursor, kind: str) -> Statement:
    if kind == "DEFFCT":
        c.name()
        if c.accept("["):
            c.expect("]")
    name = c.name()
    parameters = set()
    if c.accept("("):
        while not c.accept(")"):
            parameters.add(c.name())
            if c.accept(":"):
                c.expect("IN", "OUT")
            if not c.at(")"):
                c.expect(",")
    c.accept("PUBLIC")
    c.finish()
    return Statement(defines="" if kind == "DEFDAT" else name, changes=frozenset(parameters))


def _header(c: Cursor, _: str) -> Statement:
    """Take the head of a declaration: names and types only."""
    while not c.ended:
        if c.peek().text in _MOVES or not (
            c.peek().kind in {"word", "text", "number"} or c.at(",", "(", ")", "[", "]", ":")
        ):
            raise c.misread()
        c.take()
    return Statement()


def _interrupt(c: Cursor, _: str) -> Statement:
    declares, number = c.at("DECL"), c.peek(1)
    c.attempt(c.place - 1)
    statement = _FORMS.take(c)
    if number.kind != "number" or c.text[: number.start].split()[-1].upper() == "OFF":
        return statement
    return replace(statement, act=partial(_Program.interrupted, ordinal=number.ordinal, declares=declares))


def _spline(c: Cursor, _: str) -> Statement:
    _with(c)
    while c.accept(*_BLENDS):
        pass
    _with(c)
    c.finish()
    return Statement()


def _type(c: Cursor, _: str) -> Statement:
    c.accept("GLOBAL")
    c.accept("CONST")
    if c.accept("SIGNAL"):
        return _header(c, "")
    c.name()
    return _declared(c)


_FORMS: Final = Forms(
    """
    plain  END|ENDFCT|ENDDAT|HALT|EXIT|CONTINUE
    turn   ELSE|DEFAULT
    plain  WAIT SEC e
    plain  WAIT FOR e
    plain  RETURN e
    plain  RETURN
    turn   CASE e*
    open   IF e THEN
    open   WHILE|SWITCH e
    open   LOOP|REPEAT
    open   FOR v = e TO e
    open   FOR v = e TO e STEP e
    close  ENDIF|ENDFOR|ENDWHILE|ENDLOOP|ENDSWITCH
    close  UNTIL e
    jump   GOTO w
    plain  INTERRUPT ON|OFF n
    plain  INTERRUPT ON|OFF
    plain  INTERRUPT DECL n WHEN e DO IR_STOPM ( )
    plain  INTERRUPT DECL n WHEN e DO c
    plain  TRIGGER WHEN DISTANCE|PATH = e DELAY = e DO $OUT [ e ] = e
    plain  TRIGGER WHEN DISTANCE|PATH = e DELAY = e DO PULSE ( e* )
    plain  TRIGGER WHEN DISTANCE|PATH = e DELAY = e DO c
    plain  TRIGGER WHEN DISTANCE|PATH = e DELAY = e DO c PRIO = e
    plain  BAS ( #INITMOV|#ACC_CP|#ACC_PTP|#VEL_CP|#VEL_PTP|#PTP_PARAMS|#CP_PARAMS , e )
    plain  BAS ( #PTP_DAT|#CP_DAT )
    plain  ANOUT ON e = e
    plain  ANOUT OFF e
    """
)
_RULES: Final[Mapping[str, Callable[[Cursor, str], Statement]]] = {
    **dict.fromkeys(("DEF", "DEFFCT", "DEFDAT"), _routine),
    **dict.fromkeys(("EXT", "EXTFCT", "EXTP", "EXTFCTP", "SIGNAL", "ENUM", "STRUC", "IMPORT"), _header),
    **dict.fromkeys(("SPLINE", "PTP_SPLINE", "ENDSPLINE"), _spline),
    **dict.fromkeys(("DECL", "CONST"), _type),
    "INTERRUPT": _interrupt,
}


def _parse(c: Cursor) -> Iterable[Statement]:
    return () if c.ended else (_statement(c),)


def read_krl(reader: Reader) -> None:
    """Read a .src, and the .dat files beside it."""
    program = _Program(reader, _LEXICON, _parse, _REMEDY)
    order = sorted(
        range(len(reader.sources)),
        key=lambda i: (not _is_config(reader, i), not reader.sources[i].name.lower().endswith(".dat")),
    )
    for index in order:  # what is declared comes first
        source = reader.sources[index]
        program.add(index, source.starts, source.ends)
    program.run()
