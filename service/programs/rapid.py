"""Programs of ABB (RAPID, .mod), translated."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from jointstiff.service.programs.interpreter import Dialect, Machine
from jointstiff.service.programs.language import (
    Assign,
    Call,
    Copy,
    Flow,
    Havoc,
    Lexicon,
    Line,
    Local,
    Misread,
    Move,
    Name,
    Op,
    Part,
    Use,
    attached,
    calls,
    complete,
    parts,
    unknown,
)
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
_LEXICON: Final = Lexicon(
    comment=r"![^\r\n]*+|(?<![^\r\n])%%%\s*+(?:(?:VERSION|LANGUAGE)\s*+:\s*+[\w\0]++\s*+)*%%%",
    text=r'"[^"\r\n]*+"(?:"[^"\r\n]*+")*',
    operators="AND|OR|XOR|NOT|DIV|MOD",
    reserved=r"(?:END)?(?:MODULE|PROC|FUNC|TRAP|RECORD)|LOCAL|TASK|CONST|PERS|VAR|IF|THEN|ELSE|ELSEIF|ENDIF|FOR|FROM|TO"
    r"|STEP|DO|ENDFOR|WHILE|ENDWHILE|TEST|CASE|DEFAULT|ENDTEST|GOTO|ERROR|UNDO|BACKWARD|CONNECT|WITH|RETURN|RAISE|RETRY"
    r"|TRYNEXT|EXIT|Move\w*|Trigg[LJC]",
    # functions that tell a value
    functions=r"ABS|A?(?:COS|SIN)|A?TAN2?|EXP|POW|SQRT|ROUND|TRUNC|DIM|PRESENT|TESTDI|[DGA](?:IN|OUT)PUT|CLKREAD"
    r"|(?:NUM|VAL|BYTE)TOSTR|STR(?:LEN|PART)|C(?:ROBT|JOINTT|POS|TOOL|WOBJ|DATE|TIME)|OPMODE|RUNMODE|OFFS|RELTOOL"
    r"|POSE(?:MULT|INV|VECT)|(?:ORIENT|EULER)ZYX|DISTANCE|MAXROBSPEED|IS(?:PERS|VAR)",
)
_REMEDY: Final = (
    "write [[x, y, z], [q1 ... q4], [cf1, cf4, cf6, cfx], [external axes]] in numbers, or declare it so"
)
_FRAME_REMEDY: Final = "declare the frame in numbers"
_REFUSED: Final = (
    (re.compile(r"(?:ARC|SPOT|PAINT|DISP|CAP|NUT|GLUE)(?:[LCJ]|[LC]\w++)$"), "a move of a process"),
    (re.compile(r"PDISP|EOFFS|SOFT|SEARCH|CORR|CAP|FC|WAITWOBJ|DROPWOBJ|IND|STEPBWD|MOVE|TRIGG"),
     "it moves targets or frames while the program runs"),
)  # fmt: skip
_WORD: Final = r"[^\W\d]\w*+"
_N3, _N4, _N6 = (rf"\[\0(?:,\0){{{n - 1}}}\]" for n in (3, 4, 6))
_POSES: Final = rf"\[{_N3},{_N4}\]"
_LITERALS: Final = (
    ("robtarget", re.compile(rf"\[{_N3},{_N4},{_N4},{_N6}\]")),
    ("jointtarget", re.compile(rf"\[{_N6},{_N6}\]")),
    ("wobjdata", re.compile(rf'\[FALSE,TRUE,"[^"]*",{_POSES},{_POSES}\]', re.IGNORECASE)),
    ("tooldata", re.compile(rf"\[TRUE,{_POSES},.*\]", re.IGNORECASE)),
)
_MOVE: Final = re.compile(
    r"(?:Move(?:Abs(J)|([LJC])(DO|AO|GO|Sync)?)|Trigg([LJC]))(?=[\\ \[,])(.*)", re.IGNORECASE
)
_MOTION: Final = re.compile(
    r"\b(?:Move(?:[LJC](?:DO|AO|GO|Sync)?|AbsJ|ExtJ)|Trigg[LJC])(?!\w)", re.IGNORECASE
)
_HEADERS: Final = tuple(
    (kind, re.compile(pattern, re.IGNORECASE))
    for kind, pattern in (
        ("none", rf"MODULE {_WORD}(?:\([^()]*\))?|ENDMODULE"),
        ("none", r"(?:LOCAL )?RECORD (?:[^\W\d]\w*+ [^\W\d]\w*+;)*ENDRECORD"),
        ("routine", rf"(?:LOCAL )?(?:PROC|FUNC {_WORD}) ({_WORD})\(([^()]*)\)"),
        ("aside", rf"(?:LOCAL )?TRAP ({_WORD})"),
        ("end", r"ENDPROC|ENDFUNC|ENDTRAP"),
        ("handler", r"(?:ERROR|UNDO|BACKWARD)(?![\w:=])(?:\([^()]*\))?"),
        ("if", r"IF ?((?:(?!THEN\b|;).)*?) ?THEN\b"),
        ("turn", r"ELSEIF ?((?:(?!THEN\b|;).)*?) ?THEN\b|ELSE\b|CASE ?([^:;]*):"),
        ("default", r"DEFAULT ?:"),
        ("test", r"TEST ?((?:(?!\bCASE\b|\bDEFAULT\b|;).)+?) ?(?=CASE\b|DEFAULT\b|ENDTEST\b)"),
        ("for", rf"FOR ({_WORD}) FROM ?((?:(?!\bDO\b|;).)+?) ?DO\b"),
        ("loop", r"WHILE ?((?:(?!\bDO\b|;).)+?) ?DO\b"),
        ("close", r"(?:ENDIF|ENDFOR|ENDWHILE|ENDTEST)\b"),
        ("label", rf"({_WORD}):(?!=)"),
    )
)


def _translate(line: Line) -> list[tuple[int, Op]]:
    return complete(line, _MOTION, list(_statements(line)), _REMEDY)


def _statements(line: Line) -> Iterator[tuple[int, Op]]:
    """Yield what headers, and the instruction behind them, do."""
    place, text = 0, line.text
    while place < len(text):
        if text[place] in " ;":
            place += 1
            continue
        below = line.below(place)
        try:
            header = next(
                ((kind, match) for kind, pattern in _HEADERS if (match := pattern.match(text, place))), None
            )
            if header is None:
                yield from ((below, op) for op in _instruction(line, place))
                return
            place = header[1].end()
            for op in _header(*header):
                yield below, op
        except Misread as fault:
            yield from unknown(line, _MOTION, fault, _REMEDY, place)
            return


def _header(kind: str, match: re.Match[str]) -> list[Op]:
    if kind == "handler":
        return [Flow("end"), Flow("aside")]
    if kind in {"none", "end", "default", "close"}:
        return [] if kind == "none" else [Flow(kind)]
    if kind == "label":
        return [Flow(kind, match[1].upper())]
    if kind in {"routine", "aside"}:
        names = (
            frozenset(re.findall(rf"({_WORD})(?=,|\||$|\{{)", match[2] or ""))
            if kind == "routine"
            else frozenset()
        )
        own = frozenset(name.upper() for name in names)
        return [
            Flow(kind, match[1].upper()),
            Local(own),
            *([Havoc(own, "a parameter of the routine", _REMEDY)] if own else []),
        ]
    if kind == "for":
        bounds = [
            op for each in re.split(" ?TO | ?STEP ", match[2], flags=re.I) for op in _LEXICON.expression(each)
        ]
        name = match[1].upper()
        return [*bounds, Flow("loop"), Havoc(frozenset({name}), f"{name} counts a loop", _REMEDY)]
    given = [op for each in match.groups() if each for op in _LEXICON.expression(each)]
    if kind == "turn":
        return [Flow(kind), *attached(given)]
    return [*(attached(given) if kind == "loop" else given), Flow("if" if kind == "test" else kind)]


def _instruction(line: Line, place: int) -> list[Op]:
    if not line.text.endswith(";"):
        raise Misread("this text is unknown, or a semicolon is missing before it")
    text = line.text[:-1]
    for pattern, rule in _RULES:
        if match := pattern.fullmatch(text, place):
            return rule(line, match)
    return _other(re.compile(rf"({_WORD}) ?(.*)").fullmatch(text, place))


def _other(match: re.Match[str] | None) -> list[Op]:
    """Take an instruction of the controller, or a call."""
    if match is None or re.match(_LEXICON.reserved + r"\b", match[1], re.IGNORECASE):
        if match and match[1].upper() == "IF":
            raise Misread("a move, a call or an assignment after IF", "write IF ... THEN ... ENDIF")
        raise Misread("the statement is unknown: it may move the robot, targets or frames")
    name = match[1].upper()
    quiet = re.fullmatch(_QUIET, name) is not None
    refused = next((reason for pattern, reason in _REFUSED if not quiet and pattern.match(name)), "")
    if refused:
        move = [Move(Motion.LINEAR, (), reason=refused, remedy="write it as MoveL, MoveJ or MoveC")]
        return [
            Havoc(frozenset(), f"{match[1]}: {refused}", "omit it"),
            *(move if "process" in refused else []),
        ]
    arguments = re.sub(r",{2,}", ",", re.sub(r"\\(\w+)(:=)?", r",\1,", match[2])).strip(",")
    found = _LEXICON.expression(arguments, empty=True)
    names = frozenset(each for op in found if isinstance(op, Use) for each in op.names)
    if name in {"INCR", "DECR", "ADD", "CLEAR"}:  # they change their first argument
        return [*found, Havoc(names, f"{match[1]} changes it while the program runs", _REMEDY)]
    return [*found, Call(name, frozenset() if quiet else names, quiet=quiet)]


def _literal(line: Line, start: int, end: int, *kinds: str) -> Literal | None:
    """Return a value in numbers; None if it is none of these kinds."""
    text = line.text[start:end]
    for kind, pattern in _LITERALS:
        if kind not in kinds or not pattern.fullmatch(text):
            continue
        first, count = line.text.count("\0", 0, start), text.count("\0")
        numbers = line.ordinals[first : first + count]
        if kind == "robtarget":
            words = tuple(zip(("cf1", "cf4", "cf6", "cfx"), numbers[7:], strict=False))
            return Literal(POSE, numbers[:7], numbers[11:], words)
        if kind == "jointtarget":
            return Literal(JOINTS, numbers[:6], numbers[6:])
        if kind == "tooldata":
            rest = text.split("]],", 1)[1]
            if calls(_LEXICON.expression(f"[{rest}")):
                return None
        return Literal(POSE, numbers[: 7 if kind == "tooldata" else 14])
    return None


def _declared(line: Line, match: re.Match[str]) -> list[Op]:
    kind, constant = match[3].lower(), match[2].upper() == "CONST"
    start, end = match.span(4)
    name, equals, value = line.text[start:end].partition(":=")
    name, array, size = name.partition("{")
    if not re.fullmatch(_WORD, name) or re.fullmatch(_LEXICON.reserved, name, re.I):
        raise Misread("the declaration is unknown")
    sizes: list[Op] = [Local(frozenset({name.upper()}))]
    sizes += _LEXICON.expression(f"{{{size}") if array else []
    literal = _literal(line, end - len(value), end, kind) if equals and not array else None
    if literal is not None:
        declares = "constant" if constant else "variable"
        return [*sizes, Assign(name.upper(), literal, declares, own=(match[1] or "").upper() == "LOCAL")]
    found = _LEXICON.expression(value) if equals else []
    what = "frame" if "data" in kind else "target"
    shown = f"{name} is not a fixed {what} in numbers, or changes while the program runs"
    return [*sizes, *found, Havoc(frozenset({name.upper()}), shown, _FRAME_REMEDY)]


def _assigned(line: Line, match: re.Match[str]) -> list[Op]:
    name, parts_of, value = match[1], match[2], match[3]
    start, end = match.span(3)
    if re.fullmatch(_LEXICON.reserved, name, re.I):
        raise Misread("the statement is unknown")
    literal = (
        None if parts_of else _literal(line, start, end, "wobjdata", "tooldata", "robtarget", "jointtarget")
    )
    if literal is not None:
        return [Assign(name.upper(), literal)]
    slot = {".UFRAME": 0, ".OFRAME": 7, ".TFRAME": 0}.get(parts_of.upper())
    if slot is not None and re.fullmatch(_POSES, value):
        first = line.text.count("\0", 0, start)
        return [Assign(name.upper(), Part(Literal(POSE, line.ordinals[first : first + 7]), slot))]
    uses = (
        _LEXICON.expression(parts_of.replace("{", ",[").replace("}", "]").lstrip(","), empty=True)
        if "{" in parts_of
        else []
    )
    reason = f"{name} changes while the program runs"
    return [*uses, *_LEXICON.expression(value), Havoc(frozenset({name.upper()}), reason, _FRAME_REMEDY)]


def _move(line: Line, match: re.Match[str]) -> list[Op]:
    letter = (match[1] or match[2] or match[4]).upper()
    count, behind = 1 + (letter == "C"), _BEHIND.get((match[3] or "").upper(), 0)
    last = count + 2 + bool(match[4])  # place of the tool
    spans, frame, found = _arguments(line.text[: match.end(5)], match.start(5))
    given = [line.text[slice(*each)] for each in spans]
    if len(given) != last + 1 + behind or not re.fullmatch(_WORD, given[last]):
        reason = "the target is not given by numbers, or the move names no speed, zone and tool"
        raise Misread(
            reason, "write speed, zone and tool by their names, and \\WObj:= if there is a work object"
        )
    targets: list[Literal | Name] = []
    for span, each in zip(spans[:count], given, strict=False):
        literal = _literal(line, *span, "robtarget", "jointtarget")
        if literal is None and not re.fullmatch(_WORD, each):
            uses = [op for computed in given[:count] for op in _LEXICON.expression(computed)]
            left = Move(_MOTIONS[letter], (), reason="the target is not given by numbers", remedy=_REMEDY)
            return [*found, *uses, left]
        targets.append(each.upper() if literal is None else literal)
    found += [op for each in given[count:last] + given[last + 1 :] for op in _LEXICON.expression(each)]
    if calls(found):
        raise Misread("the move computes something", "write speed, zone and tool by their names")
    process = [Call(given[-1].strip('"').upper(), attached=True)] if behind == 1 else []
    frames = (Copy(frame.upper()),) * count, (Copy(given[last].upper()),) * count
    plain = all(isinstance(each, Literal) for each in targets) and not process
    return [*found, *process, Move(_MOTIONS[letter], tuple(targets), *frames, repeats=plain)]


def _arguments(text: str, start: int) -> tuple[list[tuple[int, int]], str, list[Op]]:
    """Return where the arguments of a move stand, its work object, and what its options use."""
    frame, found, spans = "WOBJ0", list[Op](), list[tuple[int, int]]()
    for i, (first, last) in enumerate(parts(text, start)):
        own, *options = parts(text[:last], first, "\\")
        if text[slice(*own)].strip() or (i and not options):
            spans.append((own[0] + (text[own[0] : own[0] + 1] == " "), own[1]))
        for option in options:
            name, _, value = text[slice(*option)].partition(":=")
            if not _OPTIONS.fullmatch(name.upper()):
                raise Misread(f"the argument \\{name} moves the target, or is not known", "omit it")
            found += _LEXICON.expression(value, empty=True)
            if name.upper() == "WOBJ":
                if not re.fullmatch(_WORD, value):
                    raise Misread("the argument \\WObj is computed", _FRAME_REMEDY)
                frame = value
    return spans, frame, found


_RULES: Final[tuple[tuple[re.Pattern[str], Callable[[Line, re.Match[str]], list[Op]]], ...]] = (
    (_MOVE, _move),
    (re.compile(rf"(?:(LOCAL|TASK) )?(CONST|PERS|VAR) ({_WORD}) (.*)", re.IGNORECASE), _declared),
    (re.compile(rf"({_WORD})((?:\{{[^{{}}:]*\}}|\.\w+)*):=(.*)"), _assigned),
    (
        re.compile(r"(?:RETURN|RAISE|RETRY|TRYNEXT|EXIT)(?:\b ?(.+))?", re.IGNORECASE),
        lambda _, match: [*_LEXICON.expression(match[1] or "", empty=True), Flow("return")],
    ),
    (re.compile(rf"GOTO ({_WORD})", re.IGNORECASE), lambda _, match: [Flow("jump", match[1].upper())]),
    (
        re.compile(rf"CONNECT {_WORD} WITH ({_WORD})", re.IGNORECASE),
        lambda _, match: [Call(match[1].upper(), attached=True)],
    ),
)
DIALECT: Final = Dialect(
    _LEXICON,
    _translate,
    constants={"WOBJ0": np.eye(4), "TOOL0": np.eye(4)},
    is_frame=lambda _: True,
    callers=True,
    remedy=_REMEDY,
)
_ENDS: Final = re.compile(r"\"[^\"\r\n]*+\"|![^\r\n]*+|(;)")
"""The end of a statement, and texts and comments, in which a semicolon is none."""
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
