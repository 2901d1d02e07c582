"""Programs of ABB (RAPID, .mod), translated."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from jointstiff.service.programs import language as ir
from jointstiff.service.programs.interpreter import Machine
from jointstiff.service.programs.language import Line, Misread, Op, parts
from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import Literal, Motion, Source

POSE: Final = Notation(Orientation.QUATERNION, angle=1, length_decimals=4, angle_decimals=8)
JOINTS: Final = Notation(Orientation.JOINTS, length_decimals=5)
_MOTIONS: Final = {"L": Motion.LINEAR, "J": Motion.JOINT, "C": Motion.CIRCULAR}
# Facts. Source: ABB, Technical reference manual, RAPID instructions, functions and data types (3HAC050917).
_BEHIND: Final = {"DO": 2, "AO": 2, "GO": 2, "SYNC": 1}
"""Arguments behind the tool of MoveLDO and the like."""
# Optional arguments of moves by which the target stays where it is; \Corr and \Track move it
_OPTIONS: Final = re.compile(r"CONC|ID|V|T|Z|INPOS|WOBJ|TLOAD|NOEOFFS|T\d")
# Instructions that set configuration, speed, waiting, signals, messages, clocks, interrupts and units: no
# target, no frame and no variable of the program changes by them
_QUIET: Final = (
    r"CONF[LJ]|ACCSET|VELSET|SINGAREA|CIRPATHMODE|PATHRESOL|GRIPLOAD|MOTIONSUP|(?:DE)?ACTUNIT"
    r"|WAIT(?:TIME|[DGA][IO]|UNTIL|ROB)|SET(?:[DGA]O)?|RESET|(?:PULSE|INVERT)DO|TP(?:WRITE|ERASE)|ERR(?:WRITE|LOG)"
    r"|CLK(?:START|STOP|RESET)|STOP|EXIT|BREAK|I(?:SLEEP|WATCH|DISABLE|ENABLE|DELETE|SIGNALD[IO])|TRIGG(?:IO|EQUIP|INT)"
)
# Moves of a process, and instructions that shift targets and frames: said, as they are left in any case
_PROCESS: Final = re.compile(r"(?:ARC|SPOT|PAINT|DISP|CAP|NUT|GLUE)(?:[LCJ]|[LC]\w++)")
_SHIFTS: Final = re.compile(r"PDISP|EOFFS|SOFT|SEARCH|CORR|WAITWOBJ|DROPWOBJ|IND")
_RESERVED: Final = (
    r"(?:END)?(?:MODULE|PROC|FUNC|TRAP|RECORD)|LOCAL|TASK|CONST|PERS|VAR|IF|THEN|ELSE|ELSEIF|ENDIF|FOR|FROM|TO"
    r"|STEP|DO|ENDFOR|WHILE|ENDWHILE|TEST|CASE|DEFAULT|GOTO|ERROR|UNDO|BACKWARD|CONNECT|WITH|RETURN|RAISE|RETRY"
    r"|TRYNEXT|EXIT|ENDTEST|MOVE\w*|TRIGG[LJC]"
)
# Functions that tell a value
_FUNCTIONS: Final = (
    r"ABS|A?(?:COS|SIN)|A?TAN2?|EXP|POW|SQRT|ROUND|TRUNC|DIM|PRESENT|TESTDI|[DGA](?:IN|OUT)PUT|CLKREAD"
    r"|(?:NUM|VAL|BYTE)TOSTR|STR(?:LEN|PART)|C(?:ROBT|JOINTT|POS|TOOL|WOBJ|DATE|TIME)|OPMODE|RUNMODE|OFFS|RELTOOL"
    r"|POSE(?:MULT|INV|VECT)|(?:ORIENT|EULER)ZYX|DISTANCE|MAXROBSPEED|IS(?:PERS|VAR)"
)
_REMEDY: Final = (
    "write [[x, y, z], [q1 ... q4], [cf1, cf4, cf6, cfx], [external axes]] in numbers, or declare it so"
)
_FRAME_REMEDY: Final = "declare the frame in numbers"
_WORD: Final = r"[^\W\d]\w*+"
_N3, _N4, _N6 = (rf"\[\0(?:,\0){{{n - 1}}}\]" for n in (3, 4, 6))
_POSES: Final = rf"\[{_N3},{_N4}\]"
_LITERALS: Final = {
    "ROBTARGET": re.compile(rf"\[{_N3},{_N4},{_N4},{_N6}\]"),
    "JOINTTARGET": re.compile(rf"\[{_N6},{_N6}\]"),
    "WOBJDATA": re.compile(rf'\[FALSE,TRUE,"[^"]*",{_POSES},{_POSES}\]'),
    "TOOLDATA": re.compile(rf"\[TRUE,{_POSES},(.*)\]"),
}
_FRAMES_OF: Final = {"WOBJDATA": (".UFRAME", ".OFRAME"), "TOOLDATA": (".TFRAME",)}
"""Frames that data consist of: a work object has two, one in the other."""


def _routine(_line: Line, match: re.Match[str]) -> list[Op]:
    own = frozenset(re.findall(rf"({_WORD})(?=,|\||$|\{{)", match[2]))
    unknown = [ir.Havoc(own, "a parameter of the routine", _REMEDY)] if own else []
    return [ir.Flow("routine", match[1]), ir.Local(own), *unknown]


def _for(line: Line, match: re.Match[str]) -> list[Op]:
    bounds = [op for each in re.split(" ?TO | ?STEP ", match[2]) for op in line.expression(each)]
    return [*bounds, ir.Flow("loop"), ir.Havoc(frozenset({match[1]}), f"{match[1]} counts a loop", _REMEDY)]


def _test(line: Line, match: re.Match[str]) -> list[Op]:
    first = (
        ir.attached([op for each in match[2].split(",") for op in line.expression(each)]) if match[2] else []
    )
    behind = (
        [*first, ir.Flow("turn" if match[2] else "default")] if match[0][-1] == ":" else [ir.Flow("close")]
    )
    return [*line.expression(match[1]), ir.Flow("if"), *behind]


def _if(_line: Line, _match: re.Match[str]) -> list[Op]:
    raise Misread("a move, a call or an assignment after IF", "write IF ... THEN ... ENDIF")


def _other(line: Line, match: re.Match[str]) -> list[Op]:
    """Take an instruction of the controller, or a call."""
    name = match[1]
    if re.fullmatch(_RESERVED, name):
        raise Misread("the statement is unknown: it may move the robot, targets or frames")
    arguments = re.sub(r",{2,}", ",", re.sub(r"\\(\w+)(:=)?", r",\1,", match[2])).strip(",")
    found = line.expression(arguments, empty=True)
    names = frozenset(each for op in found if isinstance(op, ir.Use) for each in op.names)
    if name in {"INCR", "DECR", "ADD", "CLEAR"}:  # they change their first argument
        return [*found, ir.Havoc(names, f"{name} changes it while the program runs", _REMEDY)]
    quiet = re.fullmatch(_QUIET, name) is not None
    if not quiet and _PROCESS.fullmatch(name):
        reason, remedy = f"{name}: a move of a process", "write it as MoveL, MoveJ or MoveC"
        left = ir.Move(Motion.LINEAR, (), reason=reason, remedy=remedy)
        return [*found, ir.Havoc(frozenset(), reason, remedy), left]
    if not quiet and _SHIFTS.match(name):
        return [*found, ir.Havoc(frozenset(), f"{name}: it moves targets or frames", "omit it")]
    return [*found, ir.Call(name, frozenset() if quiet else names, quiet=quiet)]


def _target(line: Line, start: int, end: int) -> Literal | None:
    """Return a target in numbers; None if it is none."""
    numbers = line.numbers(start, end)
    if _LITERALS["ROBTARGET"].fullmatch(line.text, start, end):
        words = tuple(zip(("cf1", "cf4", "cf6", "cfx"), numbers[7:], strict=False))
        return Literal(POSE, numbers[:7], numbers[11:], words)
    if _LITERALS["JOINTTARGET"].fullmatch(line.text, start, end):
        return Literal(JOINTS, numbers[:6], numbers[6:])
    return None


def _given(line: Line, name: str, start: int, end: int, *kinds: str) -> list[ir.Assign]:
    """Return what data of these kinds get by numbers: a target, or one or two frames."""
    target = _target(line, start, end)
    if target is not None and {"ROBTARGET", "JOINTTARGET"} & set(kinds):
        return [ir.Assign(name, target)]
    for kind, frames in _FRAMES_OF.items():
        match = _LITERALS[kind].fullmatch(line.text, start, end) if kind in kinds else None
        if match and not (match.re.groups and ir.calls(line.expression(match[1]))):
            numbers = line.numbers(start, end)
            return [
                ir.Assign(name + frame, Literal(POSE, numbers[7 * k : 7 * k + 7]))
                for k, frame in enumerate(frames)
            ]
    return []


def _product(name: str, kind: str) -> ir.Product:
    return ir.Product(tuple(f"{name}{frame}" for frame in _FRAMES_OF[kind]))


def _declared(line: Line, match: re.Match[str]) -> list[Op]:
    end = match.end(4)
    name, equals, value = match[4].partition(":=")
    name, array, size = name.partition("{")
    if not re.fullmatch(_WORD, name) or re.fullmatch(_RESERVED, name):
        raise Misread("the declaration is unknown")
    found: list[Op] = [ir.Local(frozenset({name}))]
    found += line.expression(f"{{{size}") if array else []
    given = _given(line, name, end - len(value), end, match[3]) if equals and not array else []
    if given:
        declares, own = "constant" if match[2] == "CONST" else "variable", match[1] == "LOCAL"
        return [*found, *(each._replace(declares=declares, own=own) for each in given)]
    found += line.expression(value) if equals else []
    what = "frame" if "DATA" in match[3] else "target"
    shown = f"{name} is not a fixed {what} in numbers, or changes while the program runs"
    return [*found, ir.Havoc(frozenset({name}), shown, _FRAME_REMEDY)]


def _assigned(line: Line, match: re.Match[str]) -> list[Op]:
    name, part, value = match[1], match[2], match[3]
    if re.fullmatch(_RESERVED, name):
        raise Misread("the statement is unknown")
    given = [] if part else _given(line, name, *match.span(3), *_LITERALS)
    if part in {".UFRAME", ".OFRAME", ".TFRAME"} and re.fullmatch(_POSES, value):
        given = [ir.Assign(name + part, Literal(POSE, line.numbers(*match.span(3))))]
    if given:
        return list(given)
    index = part.replace("{", ",[").replace("}", "]").lstrip(",") if "{" in part else ""
    uses = [*line.expression(index, empty=True), *line.expression(value)]
    return [*uses, ir.Havoc(frozenset({name}), f"{name} changes while the program runs", _FRAME_REMEDY)]


def _move(line: Line, match: re.Match[str]) -> list[Op]:
    letter = match[1] or match[2] or match[4]
    count, behind = 1 + (letter == "C"), _BEHIND.get(match[3] or "", 0)
    last = count + 2 + bool(match[4])  # place of the tool
    spans, frame, found = _arguments(line, match.start(5))
    given = [line.text[slice(*each)] for each in spans]
    if len(given) != last + 1 + behind or not re.fullmatch(_WORD, given[last]):
        reason = "the target is not given by numbers, or the move names no speed, zone and tool"
        remedy = "write speed, zone and tool by their names, and \\WObj:= if there is a work object"
        raise Misread(reason, remedy)
    targets: list[Literal | ir.Name] = []
    for span, each in zip(spans[:count], given, strict=False):
        literal = _target(line, *span)
        if literal is None and not re.fullmatch(_WORD, each):
            uses = [op for computed in given[:count] for op in line.expression(computed)]
            reason = "the target is not given by numbers"
            return [*found, *uses, ir.Move(_MOTIONS[letter], (), reason=reason, remedy=_REMEDY)]
        targets.append(each if literal is None else literal)
    found += [op for each in given[count:last] + given[last + 1 :] for op in line.expression(each)]
    if ir.calls(found):
        raise Misread("the move computes something", "write speed, zone and tool by their names")
    process = [ir.Call(given[-1].strip('"'), attached=True)] if behind == 1 else []
    frames = (_product(frame, "WOBJDATA"),) * count, (_product(given[last], "TOOLDATA"),) * count
    plain = all(isinstance(each, Literal) for each in targets) and not process
    return [*found, *process, ir.Move(_MOTIONS[letter], tuple(targets), *frames, repeats=plain)]


def _arguments(line: Line, start: int) -> tuple[list[tuple[int, int]], str, list[Op]]:
    """Return where the arguments of a move stand, its work object, and what its options use."""
    text, frame, found, spans = line.text, "WOBJ0", list[Op](), list[tuple[int, int]]()
    for i, (first, last) in enumerate(parts(text, start)):
        own, *options = parts(text[:last], first, "\\")
        if text[slice(*own)].strip() or (i and not options):
            spans.append((own[0] + (text[own[0] : own[0] + 1] == " "), own[1]))
        for option in options:
            name, _, value = text[slice(*option)].partition(":=")
            if not _OPTIONS.fullmatch(name):
                raise Misread(f"the argument \\{name} moves the target, or is not known", "omit it")
            found += line.expression(value, empty=True)
            if name == "WOBJ":
                if not re.fullmatch(_WORD, value):
                    raise Misread("the argument \\WObj is computed", _FRAME_REMEDY)
                frame = value
    return spans, frame, found


def _return(line: Line, match: re.Match[str]) -> list[Op]:
    return [*line.expression(match[1] or "", empty=True), ir.Flow("return")]


LANGUAGE: Final = ir.Language(
    comment=r"![^\r\n]*+|(?<![^\r\n])%%%\s*+(?:(?:VERSION|LANGUAGE)\s*+:\s*+[\w\0]++\s*+)*%%%|;",
    text=r'"[^"\r\n]*+"(?:"[^"\r\n]*+")*',
    operators="AND|OR|XOR|NOT|DIV|MOD",
    reserved=_RESERVED,
    functions=_FUNCTIONS,
    motion=r"\b(?:MOVE(?:[LJC](?:DO|AO|GO|SYNC)?|ABSJ|EXTJ)|TRIGG[LJC])(?!\w)",
    remedy=_REMEDY,
    constants={"WOBJ0": np.eye(4), "TOOL0": np.eye(4)},
    is_frame=lambda _: True,
    callers=True,
    rules=(
        (r"(?:MOVE(?:ABS(J)|([LJC])(DO|AO|GO|SYNC)?)|TRIGG([LJC]))(?=[\\ \[,])(.*)", _move),
        (rf"MODULE {_WORD}(?:\([^()]*\))?|ENDMODULE|ENDRECORD", ""),
        (rf"(?:LOCAL )?RECORD {_WORD}(?: {_WORD} {_WORD})?", ""),
        (rf"(?:LOCAL )?(?:PROC|FUNC {_WORD}) ({_WORD})\(([^()]*)\)", _routine),
        (rf"(?:LOCAL )?TRAP ({_WORD})", lambda _, match: [ir.Flow("aside", match[1])]),
        (r"ENDPROC|ENDFUNC|ENDTRAP", "end"),
        (r"(?:ERROR|UNDO|BACKWARD)(?:\([^()]*\))?", lambda *_: [ir.Flow("end"), ir.Flow("aside")]),
        (r"IF ?(.*?) ?THEN", "if"),
        (r"ELSEIF ?(.*?) ?THEN|ELSE|CASE ?(.*):", "turn"),
        (r"DEFAULT ?:", "default"),
        (r"TEST ?((?:(?!\b(?:CASE|DEFAULT|ENDTEST)\b).)+?) ?(?:CASE ?([^:]*):|DEFAULT ?:|ENDTEST)", _test),
        (rf"FOR ({_WORD}) FROM ?(.+?) ?DO", _for),
        (r"WHILE ?(.+?) ?DO", "loop"),
        (r"ENDIF|ENDFOR|ENDWHILE|ENDTEST", "close"),
        (rf"({_WORD}):", lambda _, match: [ir.Flow("label", match[1])]),
        (rf"(?:(LOCAL|TASK) )?(CONST|PERS|VAR) ({_WORD}) (.*)", _declared),
        (rf"({_WORD})((?:\{{[^{{}}:]*\}}|\.\w+)*):=(.*)", _assigned),
        (r"(?:RETURN|RAISE|RETRY|TRYNEXT|EXIT)(?:\b ?(.+))?", _return),
        (rf"GOTO ({_WORD})", lambda _, match: [ir.Flow("jump", match[1])]),
        (rf"CONNECT {_WORD} WITH ({_WORD})", lambda _, match: [ir.Call(match[1], attached=True)]),
        (r"IF .*", _if),
        (rf"({_WORD}) ?(.*)", _other),
    ),
)
_ENDS: Final = re.compile(
    r"\"[^\"\r\n]*+\"|![^\r\n]*+|%%%[^%;!]*+%%%|(?i:(;|:(?!=)"
    r"|\b(?:THEN|DO|ELSE|END(?:IF|FOR|WHILE|TEST|PROC|FUNC|TRAP|MODULE|RECORD))\b"
    r"|(?<![\w\\.])(?:ERROR|UNDO|BACKWARD)\b(?!\s*+:?=)(?:\s*+\([^()]*\))?"
    r"|\b(?:PROC|FUNC\s++\w++)\s++\w++\s*+\([^()]*\)|\bTRAP\s++\w++|\bMODULE\s++\w++(?:\s*+\([^()]*\))?))"
)
"""The end of a statement, and texts and comments, in which there is none."""
_FRAMES: Final = re.compile(
    rf"\b(?:tooldata|wobjdata)\s++({_WORD})|,\s*+({_WORD})\s*+\\\s*+WObj\s*+:=\s*+({_WORD})|,\s*+({_WORD})\s*+[;\\]",
    re.IGNORECASE,
)


def read_rapid(machine: Machine, sources: tuple[Source, ...]) -> None:
    """Read a module."""
    text, place = sources[0].text, 0
    for again in list(re.finditer(r"(?im)^[ \t]*+MODULE\b", text))[1:]:
        machine.refuse(sources[0].line(again.start()), "a second module", "send one module")
    starts, ends = [], []
    for end in (*(match.end() for match in _ENDS.finditer(text) if match[1]), len(text)):
        start = end - len(text[place:end].lstrip())
        if start < end:
            starts.append(start)
            ends.append(end)
        place = end
    machine.written.update(WOBJ0="wobj0", TOOL0="tool0")
    for match in _FRAMES.finditer(text):
        for name in filter(None, match.groups()):
            machine.written.setdefault(name.upper(), name)
    machine.add(0, np.array(starts, dtype=np.intp), np.array(ends, dtype=np.intp))
