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
_NULL: Final = words("$NULLFRAME BASE_DATA[0] TOOL_DATA[0]")
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
_MAX_DEPTH: Final = 16
"""Braces within one another; a controller's own structures have three."""
_REMEDY: Final = (
    "write all of X, Y, Z, A, B, C (or A1 ... A6) as numbers, and send the .dat that declares them"
)
_FRAME_REMEDY: Final = "give the whole frame in numbers, or as BASE_DATA[i] or TOOL_DATA[i]"


@dataclass
class _Program(Script):
    """The state of a program while it is read."""

    # active tool and base; the name of a declaration, which is not sent, is no matter until a move needs it
    active: dict[str, FrameName | str] = field(
        default_factory=lambda: {which: FrameName(f"active ${which}") for which in ("TOOL", "BASE")}
    )
    # FDAT_ACT: numbers of a tool and a base, or the name of a declaration, which BAS makes the active ones
    waiting: tuple[int, int] | str | None = None
    frames: dict[str, tuple[Place, Literal]] = field(default_factory=dict)  # BASE_DATA[i], TOOL_DATA[i]
    used: set[str] = field(default_factory=set)  # names of frames that moves have
    taken: set[str] = field(default_factory=set)  # names of frames that became active with their numbers
    interrupts: set[float] = field(default_factory=set)  # numbers of those that are declared

    def move(self, place: Place, motion: Motion, targets: Sequence[Literal | str], own: str) -> None:
        """Take a move; `own` declares frames of its own."""
        names = {name: self.given.get(name) for name in targets if isinstance(name, str)}
        shared = {name for name, given in names.items() if given and self.is_config(given[0].source)}
        home = [name for name, given in names.items() if name in _HOME and (given is None or name in shared)]
        if home and len(targets) > 1:
            self.refuse(place, "an arc through a position stored in the controller")
        elif home:
            self.moved = True
            self.reader.leave(place.line, f"a move to {home[0]}, a position stored in the controller")
        else:
            held = dict(self.active)
            if own:
                self.take(place, self.declared(place, own), move=True)
            tool, base = self.active.values()
            if isinstance(tool, str) or isinstance(base, str):
                missing = tool if isinstance(tool, str) else base
                reason = f"the frames {shown(str(missing))} are not in the program"
                self.refuse(place, reason, "send the .dat, and $config.dat, with the .src")
            elif late := [each.name for each in (tool, base) if self.is_other_now(each)]:
                reason = f"{late[0]} gets its numbers where it is active already, or they are no frame"
                self.refuse(
                    place, reason, "give whole frames in numbers before $TOOL, $BASE or BAS takes them"
                )
            elif shared:
                reason = "the target is declared in $config.dat, which other programs use"
                self.refuse(place, reason, "declare it in the program's own .dat")
            else:
                self.used |= {tool.name, base.name}
                self.targeted(place, motion, targets, [(base, tool)] * len(targets))
            self.active = held

    def is_other_now(self, frame: FrameName) -> bool:
        """Return whether the data of a frame's name are others than when the frame became active."""
        return frame.pose is None and (frame.name in self.frames or frame.name in self.changed)

    def is_config(self, source: int) -> bool:
        """Return whether a file holds what all programs of a controller use."""
        return self.reader.sources[source].name.lower().endswith("config.dat")

    def choose(self, place: Place, which: str, frame: FrameName, *, move: bool = False) -> None:
        """Make a frame the active one, if it is not; for one move only, it may be any."""
        active = self.active[which]
        same = isinstance(active, FrameName) and active.same(frame)
        if frame.pose is not None:
            self.taken.add(frame.name)
        if move or same or self.settable(place, f"${which}"):
            self.active[which] = frame

    def stated(self, place: Place, which: str, literal: Literal) -> None:
        """Take $BASE, $TOOL or FDAT_ACT in numbers."""
        if which == "FDAT_ACT":
            self.wait(place, self.inline(place, place, literal))
        elif (pose := pose_of(place, literal)) is None:
            self.refuse(place, f"${which} is computed", _FRAME_REMEDY)
        else:
            self.choose(place, which, FrameName(f"${which} of line {place.line}", pose))

    def variable(self, place: Place, which: str, name: str) -> None:
        """Take $BASE, $TOOL or FDAT_ACT by the name of a variable."""
        if which == "FDAT_ACT":
            self.wait(place, self.declared(place, name))
            return
        if (known := self.constant(name, place)) and name not in _NULL:
            self.frames[name] = known
        self.named(place, which, name)

    def numbered(self, place: Place, which: str, ordinal: int) -> None:
        """Take $BASE or $TOOL by the number of its data."""
        number = place.value(ordinal)
        if number.is_integer():  # infinity is none
            self.named(place, which.lstrip("#"), f"{which.lstrip('#')}_DATA[{int(number)}]")
        else:
            self.refuse(place, "the number of a frame is not a whole number", _FRAME_REMEDY)

    def named(self, place: Place, which: str, name: str, *, move: bool = False) -> None:
        """Take $BASE or $TOOL by a name that has numbers."""
        if name in self.changed:
            self.refuse(place, f"{name} changes while the program runs", "give it once, in numbers")
            return
        known = self.frames.get(name)
        pose = np.eye(4) if name in _NULL else pose_of(*known) if known else None
        self.choose(place, which, FrameName(name, pose), move=move)

    def declared(self, place: Place, name: str) -> tuple[int, int] | str | None:
        """Return the numbers of the tool and the base of a declaration; its name if it is not sent."""
        known = self.constant(name, place)
        return name if known is None else self.inline(place, *known)

    def inline(self, place: Place, where: Place, literal: Literal) -> tuple[int, int] | None:
        """Return the numbers of the tool and the base of `{TOOL_NO 1,BASE_NO 2}`; refuse others."""
        given = [literal.fields[name] for name in ("TOOL_NO", "BASE_NO") if name in literal.fields]
        numbers = [where.value(ordinal) for ordinal in given]
        fixed = literal.texts.get("IPO_FRAME", "#BASE").upper() != "#BASE"
        if fixed or len(numbers) < 2 or not all(map(float.is_integer, numbers)):
            reason = "TOOL_NO or BASE_NO is not a whole number, or the tool is fixed in the cell (IPO_FRAME)"
            self.refuse(place, reason, "only tools on the flange, by TOOL_NO and BASE_NO, are supported")
            return None
        return int(numbers[0]), int(numbers[1])

    def wait(self, place: Place, frames: tuple[int, int] | str | None) -> None:
        """Keep what FDAT_ACT gets: BAS makes it active."""
        if frames is not None and (frames == self.waiting or self.settable(place, "FDAT_ACT")):
            self.waiting = frames

    def apply(self, place: Place, *_: object) -> None:
        """Make the frames of FDAT_ACT active, as BAS does at #FRAMES, #PTP_PARAMS and #CP_PARAMS."""
        if self.waiting is None:
            reason = "BAS makes the frames of FDAT_ACT active, which the program has not given in numbers"
            self.refuse(place, reason, "write FDAT_ACT={TOOL_NO 1,BASE_NO 1} before it")
        else:
            self.take(place, self.waiting)

    def take(self, place: Place, frames: tuple[int, int] | str | None, *, move: bool = False) -> None:
        """Make a tool and a base active; for one move only, they may be any."""
        if isinstance(frames, str):
            if move or self.settable(place, "FDAT_ACT"):
                self.active = {"TOOL": frames, "BASE": frames}
        elif frames is not None:
            for which, number in zip(("TOOL", "BASE"), frames, strict=True):
                self.named(place, which, f"{which}_DATA[{number}]", move=move)

    def begin(self, place: Place) -> None:
        """Make tool 1 and base 0 active, as BAS does at #INITMOV."""
        self.take(place, (1, 0))

    def data(self, place: Place, which: str, ordinal: int, literal: Literal | None) -> None:
        """Take BASE_DATA[i] or TOOL_DATA[i]."""
        name = f"{which}[{place.value(ordinal):g}]"
        whole = literal is not None and literal.notation is POSE
        once = whole and not (self.depth or self.jumped or self.routine > 1)
        # A loop, a branch or another routine may come back to where the frame became active.
        if name in self.used or (name in self.taken and not once):
            self.refuse(place, f"{name} changes while the program runs", _FRAME_REMEDY)
        elif literal is None or not once:
            self.changed.add(name)
        else:
            self.frames[name] = place, literal

    def interrupt(self, place: Place, ordinal: int) -> None:
        """Take the declaration of an interrupt."""
        self.interrupts.add(place.value(ordinal))

    def interruptible(self, place: Place, ordinal: int) -> None:
        """Switch an interrupt on, which has to be declared."""
        number = place.value(ordinal)
        if number not in self.interrupts:
            reason = f"interrupt {number:g} is declared elsewhere: it may move the robot or change its frames"
            self.refuse(place, reason, "declare it in the program")


def _statement(c: Cursor) -> Statement:
    """Parse a line."""
    is_global = c.accept("GLOBAL") is not None
    if c.peek().text in _FORMS:
        return _FORMS.take(c)
    name = c.word()
    if name in _MOVES:
        return _move(c, name)
    if name in _RULES:
        return _RULES[name](c, name)
    if name.endswith("_REL"):
        raise Misread("a relative move")
    if c.at(":") and c.peek(1).kind == "end":
        c.take()
        return Statement(jumps=True)
    if c.at("("):
        return _call(c, name)
    if (name in _TYPES or is_global) and c.peek().kind == "word":
        return _declared(c)
    return _assigned(c, name)


def _call(c: Cursor, name: str) -> Statement:
    used = Used(set() if name in _FUNCTIONS else {name})
    c.arguments(used)
    c.finish()
    if name in _LEXICON.reserved:
        raise Misread(f"{name} is not a routine")
    return used_in(used)


# values


def _aggregate(c: Cursor, depth: int = 1) -> Literal | None:
    """Take `{...}`, the `depth`-th of those that are open; None if it holds what is no number."""
    if depth > _MAX_DEPTH:
        raise c.misread(
            f"more than {_MAX_DEPTH} braces within one another", "declare inner structures on their own"
        )
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
            plain &= _field(c, name, texts, depth)
        if not c.accept(","):
            break
    c.expect("}")
    return _literal(numbers, texts) if plain else None


def _field(c: Cursor, name: str, texts: dict[str, str], depth: int) -> bool:
    """Take a field that is no number; return whether its value stands in the text."""
    if c.at("{"):
        _aggregate(c, depth + 1)
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
            words = tuple((kind, numbers[kind]) for kind in ("S", "T") if kind in numbers)
            return Literal(
                notation,
                tuple(numbers[field] for field in fields),
                external if max(external) >= 0 else (),
                words,
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
        array = c.accept("[")
        if array:
            c.listed("]", used)
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
    return replace(used_in(used, *changed), gives=gives)


def _assigned(c: Cursor, name: str) -> Statement:
    """Take what follows the first word of an assignment."""
    used = Used()
    index, whole = _index(c, used)
    if name in {"$BASE", "$TOOL", "FDAT_ACT"}:
        return _frame(c, name, whole=whole and index is None)
    if name.startswith("$") and name not in _SETTINGS:
        raise Misread(f"the controller's variable {name} is not supported", "omit it")
    literal = _value(c, used)
    c.finish()
    if name in {"BASE_DATA", "TOOL_DATA"}:
        if index is None or index < 0:
            raise Misread(f"{name} of a computed number", _FRAME_REMEDY)
        given = literal if whole else None
        return used_in(used, act=partial(_Program.data, which=name, ordinal=index, literal=given))
    if literal is not None and whole and index is None and (literal.notation or "TOOL_NO" in literal.fields):
        return Statement(gives=(name, literal))
    return used_in(used, name)


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
            c.listed("]", used)
        else:
            c.expect(".")
            c.name()
            whole = False
    return index, whole


def _frame(c: Cursor, name: str, *, whole: bool) -> Statement:
    """Take the value of $BASE, $TOOL or FDAT_ACT."""
    which, act = name.removeprefix("$"), None
    if whole and c.at("{"):
        literal = _aggregate(c)
        act = None if literal is None else partial(_Program.stated, which=which, literal=literal)
    elif whole and (index := c.taken(f"{which}_DATA[n]")):
        act = partial(_Program.numbered, which=which, ordinal=index[0])
    elif whole:
        act = partial(_Program.variable, which=which, name=c.name())
    if act is None or not c.ended:
        raise Misread(f"{name} is computed, or set in part", _FRAME_REMEDY)
    return Statement(act=act)


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
        raise c.misread("the text after the target is unknown", _REMEDY)
    act = partial(_Program.move, motion=motion, targets=tuple(targets), own=own)
    return Statement(act=act, repeats=not own and all(isinstance(each, Literal) for each in targets))


def _with(c: Cursor, *, moves: bool = False) -> str:
    """Take settings behind WITH; return the name of the frames' declaration, if there is one."""
    frames: dict[str, str] = {}
    more = c.accept("WITH")
    while more:
        name, used = c.word(), Used()
        _index(c, used)
        if name in {"$TOOL", "$BASE"} and moves:
            frames[name] = _declaration(c, name)
        elif name in _SETTINGS or (name == "$IPO_MODE" and c.at("SIPO_MODE")):
            _value(c, used, ",")
        else:
            reason = "a move or a block of moves has separate frames"
            raise Misread(reason, "set $TOOL and $BASE before it")
        if used.calls:
            raise Misread("a call in the settings of a move")
        more = c.accept(",")
    if frames and (len(frames) < 2 or len(set(frames.values())) > 1):
        raise Misread("the move has a separate frame", "set $TOOL and $BASE before the move")
    return frames.get("$TOOL", "")


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
    on     INTERRUPT ON n
    plain  INTERRUPT OFF n
    plain  INTERRUPT ON|OFF
    decl   INTERRUPT DECL n WHEN e DO IR_STOPM ( )
    decl   INTERRUPT DECL n WHEN e DO c
    plain  TRIGGER WHEN DISTANCE|PATH = e DELAY = e DO $OUT [ e ] = e
    plain  TRIGGER WHEN DISTANCE|PATH = e DELAY = e DO PULSE ( e* )
    plain  TRIGGER WHEN DISTANCE|PATH = e DELAY = e DO c
    plain  TRIGGER WHEN DISTANCE|PATH = e DELAY = e DO c PRIO = e
    frame  BAS ( #TOOL|#BASE , n )
    begin  BAS ( #INITMOV , e )
    apply  BAS ( #FRAMES )
    apply  BAS ( #FRAMES|#PTP_PARAMS|#CP_PARAMS , e )
    plain  BAS ( #ACC_CP|#ACC_PTP|#VEL_CP|#VEL_PTP , e )
    plain  BAS ( #PTP_DAT|#CP_DAT )
    plain  ANOUT ON e = e
    plain  ANOUT OFF e
    plain  $IPO_MODE = #BASE
    """,
    on=_Program.interruptible,
    decl=_Program.interrupt,
    frame=_Program.numbered,
    begin=_Program.begin,
    apply=_Program.apply,
)
_RULES: Final[Mapping[str, Callable[[Cursor, str], Statement]]] = {
    **dict.fromkeys(("DEF", "DEFFCT", "DEFDAT"), _routine),
    **dict.fromkeys(("EXT", "EXTFCT", "EXTP", "EXTFCTP", "SIGNAL", "ENUM", "STRUC", "IMPORT"), _header),
    **dict.fromkeys(("SPLINE", "PTP_SPLINE", "ENDSPLINE"), _spline),
    **dict.fromkeys(("DECL", "CONST"), _type),
}


def _parse(c: Cursor) -> Iterable[Statement]:
    return () if c.ended else (_statement(c),)


def read_krl(reader: Reader) -> None:
    """Read a .src, and the .dat files beside it."""
    program = _Program(reader, _LEXICON, _parse, _REMEDY)
    names = [source.name.lower() for source in reader.sources]
    order = sorted(range(len(names)), key=lambda i: (not program.is_config(i), not names[i].endswith(".dat")))
    for index in order:  # what is declared comes first
        source = reader.sources[index]
        program.add(index, source.starts, source.ends)
    program.run()
