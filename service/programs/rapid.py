"""Programs of ABB (RAPID, .mod): the statements that are understood."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import numpy as np

from jointstiff.service.programs.errors import shown
from jointstiff.service.programs.forms import Forms, instruction_arguments
from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import FrameName, Literal, Motion
from jointstiff.service.programs.reader import Place, Reader, Script, Statement, pose_of, used_in, words
from jointstiff.service.programs.scanner import Cursor, Lexicon, Misread, Used

POSE: Final = Notation(Orientation.QUATERNION, angle=1, length_decimals=4, angle_decimals=8)
JOINTS: Final = Notation(Orientation.JOINTS, length_decimals=5)
_KINDS: Final = {"L": (Motion.LINEAR, 1), "J": (Motion.JOINT, 1), "C": (Motion.CIRCULAR, 2)}
_BEHIND: Final = {"": 0, "DO": 2, "AO": 2, "GO": 2, "SYNC": 1}
_MOVES: Final = {
    "MOVEABSJ": (_KINDS["J"], 0),
    **{
        f"MOVE{letter}{what}": (kind, more)
        for letter, kind in _KINDS.items()
        for what, more in _BEHIND.items()
    },
    **{f"TRIGG{letter}": (kind, 0) for letter, kind in _KINDS.items()},
}
"""Motion and count of targets, and of arguments behind the tool."""
_OPTIONS: Final = words("CONC ID V T Z INPOS WOBJ TLOAD NOEOFFS T2 T3 T4 T5 T6 T7 T8")
"""Optional arguments of moves that leave the target where it is."""
_FRAMES: Final = ("TOOLDATA", "WOBJDATA")
_TARGETS: Final = ("ROBTARGET", "JOINTTARGET")
_CHANGING: Final = words("INCR DECR ADD CLEAR")
"""Instructions that change their first argument."""
_FUNCTIONS: Final = words(
    """
    ABS ACOS ASIN ATAN ATAN2 COS SIN TAN EXP POW SQRT ROUND TRUNC DIM PRESENT TESTDI DINPUT DOUTPUT GINPUT
    AINPUT AOUTPUT GOUTPUT CLKREAD NUMTOSTR VALTOSTR BYTETOSTR STRLEN STRPART CROBT CJOINTT CPOS CTOOL CWOBJ
    CDATE CTIME OPMODE RUNMODE OFFS RELTOOL POSEMULT POSEINV POSEVECT ORIENTZYX EULERZYX DISTANCE
    MAXROBSPEED ISPERS ISVAR
    """
)
_LEXICON: Final = Lexicon(
    comment=r"![^\r\n]*+|(?<![^\r\n])%%%\s*+(?:(?:VERSION|LANGUAGE)\s*+:\s*+\w++\s*+)*%%%",
    signs=":=|<>|<=|>=",
    operators=words(". = <> < > <= >= AND OR XOR NOT DIV MOD"),
    prefixes=words("+ - NOT"),
    functions=_FUNCTIONS,
    reserved=words(
        """
        MODULE ENDMODULE PROC ENDPROC FUNC ENDFUNC TRAP ENDTRAP RECORD ENDRECORD LOCAL TASK CONST PERS VAR
        IF THEN ELSE ELSEIF ENDIF FOR FROM TO STEP DO ENDFOR WHILE ENDWHILE TEST CASE DEFAULT ENDTEST GOTO
        ERROR UNDO BACKWARD CONNECT WITH RETURN RAISE RETRY TRYNEXT EXIT MOVEEXTJ
        """
    )
    | frozenset(_MOVES),
)
_REMEDY: Final = (
    "write [[x, y, z], [q1 ... q4], [cf1, cf4, cf6, cfx], [external axes]] in numbers, or declare it so"
)
_FRAME_REMEDY: Final = "declare the frame in numbers"
_REFUSED: Final = (
    (re.compile(r"(?:ARC|SPOT|PAINT|DISP|CAP|NUT|GLUE)(?:[LCJ]|[LC]\w++)$"), "is a move of a process",
     "write it as MoveL, MoveJ or MoveC"),
    (re.compile(r"PDISP|EOFFS|SOFT|SEARCH|CORR|CAP|FC|WAITWOBJ|DROPWOBJ|IND|STEPBWD|MOVE|TRIGG"),
     "moves targets or frames while the program runs", "write targets in numbers"),
)  # fmt: skip


@dataclass
class _Module(Script):
    """The state of a module while it is read."""

    # tools and work objects in numbers
    frames: dict[str, FrameName] = field(
        default_factory=lambda: {name.upper(): FrameName(name, np.eye(4)) for name in ("tool0", "wobj0")}
    )
    computed: set[str] = field(default_factory=set)  # tools and work objects whose numbers are not known
    used: set[str] = field(default_factory=set)  # tools and work objects of moves, as they were declared

    def frame(self, place: Place, written: str, pose: Literal | None) -> None:
        """Declare a tool or a work object."""
        name, pose_numbers = written.upper(), pose_of(place, pose)
        if pose_numbers is None or name in self.frames:
            self.frames.pop(name, None)
            self.computed.add(name)
        else:
            self.frames[name] = FrameName(written, pose_numbers)

    def set(self, place: Place, name: str, pose: Literal | None) -> None:
        """Assign a variable: a tool or a work object takes other numbers from here on."""
        if name not in self.frames:
            return
        numbers = pose_of(place, pose)
        if numbers is None or name in self.used:  # a move before would have another frame in the next cycle
            self.altered(place, (name,))
        elif self.settable(place, shown(name)):
            known = self.frames[name].name.partition(" ")[0]
            self.frames[name] = FrameName(f"{known} of line {place.line}", numbers)

    def altered(self, place: Place, names: Iterable[str]) -> None:
        """Refuse that a part of a tool or a work object changes, or may as a routine is given it."""
        for name in names:
            if name in self.frames or name in self.computed:
                self.refuse(place, f"{shown(name)} changes while the program runs", _FRAME_REMEDY)

    def move(
        self,
        place: Place,
        motion: Motion,
        targets: Sequence[Literal | str],
        names: Sequence[str],
        process: str,
    ) -> None:
        """Take a move with the names of its work object and its tool."""
        for name in map(str.upper, names):
            known = self.frames.get(name)
            changes = name in self.changed and known is None
            if changes or name in self.parameters or name in self.computed:
                reason = f"{shown(name)} is not a fixed frame in numbers, or changes while the program runs"
                self.refuse(place, reason, _FRAME_REMEDY)
                return
            if known is not None and " of line " not in known.name:
                self.used.add(name)
        if process and process not in self.routines:
            self.reader.call(place.line, process)
        base, tool = (self.frames.get(name.upper(), FrameName(name)) for name in names)
        self.targeted(place, motion, targets, [(base, tool)] * len(targets))


def _parse(c: Cursor) -> Iterator[Statement]:
    """Parse headers, and the statement behind them."""
    while not c.ended:
        if c.accept(";"):
            continue
        c.begin = c.peek().start
        lines = c.text.count("\n", 0, c.begin) or c.text.count("\r", 0, c.begin)
        for statement in _statement(c):
            yield replace(statement, line=lines) if lines else statement


def _statement(c: Cursor) -> Iterable[Statement]:
    local = c.accept("LOCAL", "TASK")
    name = c.word()
    if name in {"CONST", "PERS", "VAR"}:
        return _ended(c, _declared(c))
    if name in {"PROC", "FUNC", "TRAP"}:
        return _routine(c, name)
    if name == "RECORD":
        return _record(c)
    if name in _HEADERS:
        return (_header(c, name),)
    if local:
        raise Misread("the declaration is unknown", _REMEDY)
    if name in _MOVES:
        return _ended(c, _move(c, name))
    if c.accept(":"):
        return (Statement(jumps=True),)
    return _ended(c, _instruction(c, name))


def _ended(c: Cursor, statement: Statement) -> Iterable[Statement]:
    """Require the semicolon behind a statement."""
    if not c.accept(";"):
        raise c.misread("this text is unknown, or a semicolon is missing before it", _REMEDY)
    return (statement,)


# headers


def _routine(c: Cursor, kind: str) -> Iterable[Statement]:
    name, parameters = c.name(), set()
    if kind == "FUNC":
        name = c.name()
    if c.accept("("):
        while not c.accept(")"):
            if c.peek().kind == "word":
                parameters.add(c.take().text)
            elif not c.accept(",", "\\", "|", "{", "}", "*"):
                raise c.misread()
    return (Statement(defines=name, changes=frozenset(parameters)),)


_HEADERS: Final = Forms(
    r"""
    plain     MODULE w ( e* )
    plain     MODULE w
    plain     ENDMODULE|ELSE
    plain     DEFAULT :
    plain     CASE e* :
    open      IF e THEN
    plain     ELSEIF e THEN
    open      WHILE e DO
    open      TEST e CASE e* :
    open      TEST e DEFAULT :
    open      FOR v FROM e TO e DO
    open      FOR v FROM e TO e STEP e DO
    open      ERROR ( e* )
    open      ERROR|UNDO|BACKWARD
    close     ENDIF|ENDFOR|ENDWHILE|ENDTEST
    closeall  ENDPROC|ENDFUNC|ENDTRAP
    """,
    whole=False,
)
_FORMS: Final = Forms(
    """
    jump   GOTO w
    plain  CONNECT w WITH c
    plain  CONFL|CONFJ|ACCSET|VELSET|SINGAREA|CIRPATHMODE|PATHRESOL|GRIPLOAD|MOTIONSUP a
    plain  WAITTIME|WAITDI|WAITDO|WAITUNTIL|WAITROB|WAITGI|WAITAI a
    plain  SETDO|SETAO|SETGO|SET|RESET|PULSEDO|INVERTDO|TPWRITE|TPERASE|ERRWRITE|ERRLOG a
    plain  CLKSTART|CLKSTOP|CLKRESET|STOP|EXIT|BREAK|RETURN|RAISE|RETRY|TRYNEXT a
    plain  ISLEEP|IWATCH|IDISABLE|IENABLE|IDELETE|ISIGNALDI|ISIGNALDO a
    plain  TRIGGIO|TRIGGEQUIP|TRIGGINT|ACTUNIT|DEACTUNIT a
    """
)


def _header(c: Cursor, name: str) -> Statement:
    """Take the head of a part; behind IF, nothing but THEN."""
    c.attempt(c.place - 1)
    try:
        return _HEADERS.take(c)
    except Misread as fault:
        if name != "IF":
            raise
        reason = "an unknown condition, or a move, a call or an assignment after IF"
        raise Misread(reason, "write IF ... THEN ... ENDIF", fault.offset) from None


def _record(c: Cursor) -> Iterable[Statement]:
    c.name()
    while not c.accept("ENDRECORD"):
        c.name()
        c.name()
        c.expect(";")
    return ()


# values


def _target(c: Cursor) -> Literal | None:
    """Take a robtarget or a jointtarget in numbers; None, and nothing taken, if there is none."""
    if numbers := c.taken("[[n,n,n],[n,n,n,n],[n,n,n,n],[n,n,n,n,n,n]]"):
        stated = tuple(zip(("cf1", "cf4", "cf6", "cfx"), numbers[7:], strict=False))
        return Literal(POSE, numbers[:7], numbers[11:], stated)
    numbers = c.taken("[[n,n,n,n,n,n],[n,n,n,n,n,n]]")
    return None if numbers is None else Literal(JOINTS, numbers[:6], numbers[6:])


def _frame(c: Cursor) -> Literal | None:
    """Take a tool or a work object in numbers; None, and nothing taken, if there is none that is fixed."""
    begin = c.place
    if numbers := c.taken("[FALSE,TRUE,t,[[n,n,n],[n,n,n,n]],[[n,n,n],[n,n,n,n]]]"):
        return Literal(POSE, numbers)
    if numbers := c.taken("[TRUE,[[n,n,n],[n,n,n,n]],"):
        with suppress(Misread):
            c.expression("]", used=(used := Used()))  # the tool's load
            c.expect("]")
            if not used.calls:
                return Literal(POSE, numbers)
    c.attempt(begin)
    return None


def _declared(c: Cursor) -> Statement:
    kind, written, used = c.name(), c.written(c.peek()), Used()
    name = c.name()
    array = _indices(c, used)
    literal: Literal | None = None
    if c.accept(":="):
        if not array:
            literal = _frame(c) if kind in _FRAMES else _target(c) if kind in _TARGETS else None
        if literal is None:
            c.expression(";", used=used)
    if kind in _FRAMES:
        return used_in(used, act=partial(_Module.frame, written=written, pose=literal))
    if literal is not None:
        return Statement(gives=(name, literal))
    return used_in(used, name)


def _indices(c: Cursor, used: Used) -> bool:
    """Take `{2,3}` behind a name; return whether it stands there."""
    begins = c.accept("{")
    if begins:
        c.listed("}", used)
    return begins is not None


# instructions


def _instruction(c: Cursor, name: str) -> Statement:
    if c.at(":=", ".", "{"):
        return _assigned(c, name)
    if name in _FORMS:
        c.attempt(c.place - 1)
        return _FORMS.take(c)
    for pattern, reason, remedy in _REFUSED:
        if pattern.match(name):
            raise Misread(reason, remedy)
    begin, used, given = c.place, Used(), {c.peek().text}
    instruction_arguments(c, used)
    if name not in _CHANGING:
        used.calls.add(name)
        given = {c.peek(i).text for i in range(begin - c.place, 0) if c.peek(i).kind == "word"}
    return used_in(used, *given, act=partial(_Module.altered, names=sorted(used.passed | given)))


def _assigned(c: Cursor, name: str) -> Statement:
    """Take an assignment; one to a whole tool or work object may be understood."""
    used, whole = Used(), c.at(":=")
    while not c.accept(":="):
        if not _indices(c, used):
            c.expect(".")
            c.name()
    literal = _frame(c) if whole else None
    if literal is None:
        c.expression(";", used=used)
    act = partial(_Module.set, name=name, pose=literal) if whole else partial(_Module.altered, names=(name,))
    return used_in(used, name, act=act)


def _move(c: Cursor, name: str) -> Statement:
    (motion, count), behind = _MOVES[name]
    options: dict[str, str] = {}
    _options(c, options)
    c.accept(",")
    targets: list[Literal | str] = []
    for _ in range(count):
        literal = _target(c)
        if literal is None and (c.peek().kind != "word" or c.peek(1).text not in {",", "\\"}):
            raise c.misread("the target is not given by numbers", _REMEDY)
        targets.append(c.name() if literal is None else literal)
        _options(c, options)
        if not c.accept(","):
            raise c.misread("the text after the target is unknown", _REMEDY)
    rest, used = [], Used()  # speed, zone and tool; signal and value
    for i in range(3 + name.startswith("TRIGG") + behind):
        if i and not c.accept(","):
            raise c.misread(
                "the move names no speed, zone and tool", "write them, and \\WObj:= if there is a work object"
            )
        rest.append(c.peek())
        c.expression(",", "\\", ";", used=used)
        _options(c, options)
    if c.at(",") and c.peek(1).text == "\\":
        c.take()
        _options(c, options)
    tool = rest[2 + name.startswith("TRIGG")]
    if tool.kind != "word" or used.calls:
        raise Misread(
            "the move names no tool, or computes something", "write speed, zone and tool by their names"
        )
    process = rest[-1].text.strip('"').upper() if name.endswith("SYNC") else ""
    act = partial(
        _Module.move,
        motion=motion,
        targets=tuple(targets),
        names=(options.get("WOBJ", "wobj0"), c.written(tool)),
        process=process,
    )
    return Statement(act=act, repeats=not process and all(isinstance(each, Literal) for each in targets))


def _options(c: Cursor, options: dict[str, str]) -> None:
    """Take optional arguments of a move."""
    while c.accept("\\"):
        name, used = c.name(), Used()
        if name not in _OPTIONS or name in options:
            raise Misread(f"the argument \\{name} moves the target, or is not known", "omit it")
        options[name] = ""
        if c.accept(":="):
            options[name] = c.written(c.peek()) if c.peek(1).text in {",", "\\", ";"} else ""
            c.expression(",", "\\", ";", used=used)
        if used.calls or (name == "WOBJ" and not options[name]):
            raise Misread(f"the argument \\{name} is computed", _FRAME_REMEDY)


_ENDS: Final = re.compile(r"\"[^\"\r\n]*+\"|![^\r\n]*+|(;)")
"""The end of a statement, and texts and comments, in which a semicolon is none."""


def read_rapid(reader: Reader) -> None:
    """Read a module."""
    module = _Module(reader, _LEXICON, _parse, _REMEDY, ordered=False)
    text, place = reader.sources[0].text, 0
    starts, ends = [], []
    for end in (*(match.end() for match in _ENDS.finditer(text) if match[1]), len(text)):
        start = end - len(text[place:end].lstrip())
        if start < end:
            starts.append(start)
            ends.append(end)
        place = end
    module.add(0, np.array(starts, dtype=np.intp), np.array(ends, dtype=np.intp))
    module.run()
