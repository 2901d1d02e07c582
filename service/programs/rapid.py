"""Programs of ABB (RAPID, .mod): Move instructions to literal or declared robtargets and jointtargets."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from jointstiff.service.programs.errors import shown
from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import FrameName, Motion, Program, Source
from jointstiff.service.programs.reader import NUMBER, NUMBER_PATTERN, Reader
from jointstiff.solver.arrays import FloatArray

POSE: Final = Notation(Orientation.QUATERNION, angle=1, length_decimals=4, angle_decimals=8)
JOINTS: Final = Notation(Orientation.JOINTS, length_decimals=5)
_N: Final = rf"\s*{NUMBER}\s*"


def _row(count: int) -> str:
    return rf"\s*\[{','.join([_N] * count)}\]\s*"


_ROBTARGET: Final = re.compile(rf"\[({_row(3)}),({_row(4)}),({_row(4)}),({_row(6)})\]")
_JOINTTARGET: Final = re.compile(rf"\[({_row(6)}),({_row(6)})\]")
_FRAME: Final = re.compile(rf"\[({_row(3)}),({_row(4)})\]")
_DECLARED: Final = re.compile(
    r"(?:LOCAL\s+|TASK\s+)*(CONST|PERS|VAR)\s+(robtarget|jointtarget|tooldata|wobjdata)\s+([A-Za-z]\w*)\s*(\{[^}]*\})?\s*(?::=\s*(.*))?$",
    re.IGNORECASE | re.DOTALL,
)
_MOVES: Final = {
    "MOVEL": (Motion.LINEAR, 1),
    "MOVEJ": (Motion.JOINT, 1),
    "MOVEC": (Motion.CIRCULAR, 2),
    "MOVEABSJ": (Motion.JOINT, 1),
    "MOVELDO": (Motion.LINEAR, 1),
    "MOVEJDO": (Motion.JOINT, 1),
    "MOVECDO": (Motion.CIRCULAR, 2),
    "MOVELSYNC": (Motion.LINEAR, 1),
    "MOVEJSYNC": (Motion.JOINT, 1),
    "MOVECSYNC": (Motion.CIRCULAR, 2),
    "TRIGGL": (Motion.LINEAR, 1),
    "TRIGGJ": (Motion.JOINT, 1),
    "TRIGGC": (Motion.CIRCULAR, 2),
}
_MOVE: Final = re.compile(
    rf"({'|'.join(sorted(_MOVES, key=len, reverse=True))})\b\s*(?:\\Conc\s*,)?\s*", re.IGNORECASE
)
_NAME: Final = re.compile(r"[A-Za-z]\w*")
_STILL: Final = re.compile(
    r"(?:MODULE|ENDMODULE|PROC|ENDPROC|FUNC|ENDFUNC|TRAP|ENDTRAP|LOCAL|TASK|CONST|PERS|VAR|RECORD|ENDRECORD|IF|ELSE|ELSEIF|ENDIF|FOR|ENDFOR|"
    r"WHILE|ENDWHILE|TEST|CASE|DEFAULT|ENDTEST|RETURN|EXIT|STOP|BREAK|GOTO|WAITTIME|WAITDI|WAITDO|WAITUNTIL|WAITROB|SETDO|SETAO|SETGO|SET|RESET|"
    r"PULSEDO|INVERTDO|TPWRITE|TPERASE|ACCSET|VELSET|CONFL|CONFJ|SINGAREA|CIRPATHMODE|PATHRESOL|GRIPLOAD|CLKSTART|CLKSTOP|CLKRESET|INCR|DECR|"
    r"ADD|CLEAR|MOTIONSUP|TRIGGIO|TRIGGEQUIP|ERROR|UNDO|RAISE|RETRY|TRYNEXT|VERSION|LANGUAGE|ISLEEP|IDISABLE|IENABLE|ACTUNIT|DEACTUNIT)\b|[%&]|\w+:$",
    re.IGNORECASE,
)
_REFUSED: Final = re.compile(
    r"(?:PDisp\w*|EOffs\w*|Soft\w*|Search\w|CorrCon|CorrWrite|Cap\w|FC\w+|WaitWObj|DropWObj|Indr?\w+|StepBwdPath|MoveExtJ)\b",
    re.IGNORECASE,
)
_PROCESS: Final = re.compile(r"(?:Arc|Spot|Paint|Disp|Cap|Nut|Glue)(?:[LCJ]|[LC]\w+)\b", re.IGNORECASE)
_COMPACT_IF: Final = re.compile(
    rf"(?:ELSE)?IF\b.*\b(?:{'|'.join(sorted(_MOVES, key=len, reverse=True))})\b\s|IF\b.*:=",
    re.IGNORECASE | re.DOTALL,
)
_OPENED: Final = re.compile(r"(?:IF\b.*\bTHEN|FOR\b|WHILE\b|TEST\b)", re.IGNORECASE | re.DOTALL)
_CLOSED: Final = re.compile(r"(?:ENDIF|ENDFOR|ENDWHILE|ENDTEST)\b", re.IGNORECASE)
_ASSIGNED: Final = re.compile(r"([A-Za-z]\w*)((?:\s*\{[^}]*\})?(?:\.\w+)*)\s*:=", re.DOTALL)
_CALL: Final = re.compile(r"([A-Za-z]\w*)\b")
_FAULTS: Final = (
    (_PROCESS, "is a move of a process", "write it as MoveL, MoveJ or MoveC"),
    (_REFUSED, "moves targets or frames while the program runs", "write targets in numbers"),
    (_COMPACT_IF, "has a move or an assignment behind IF", "write IF ... THEN ... ENDIF"),
)
_MOST_SETTINGS: Final = 5_000
"""Frames that one program sets; more are refused as frames that change."""
_JUMP: Final = re.compile(r"^[ \t]*GOTO\b", re.IGNORECASE | re.MULTILINE)
_NO_AXIS: Final = 8e9
_REMEDY: Final = (
    "write [[x, y, z], [q1 ... q4], [cf1, cf4, cf6, cfx], [external axes]] in numbers, or declare it so"
)


@dataclass(frozen=True)
class _Declared:
    """A robtarget or jointtarget that the module declares."""

    notation: Notation
    numbers: tuple[tuple[int, int], ...]
    line: int
    branch: str
    external: tuple[float, ...]


@dataclass
class _Module:
    """The state of a module while it is read."""

    reader: Reader
    targets: dict[str, _Declared] = field(default_factory=dict)
    changed: set[str] = field(default_factory=set)
    tools: dict[str, FrameName] = field(default_factory=lambda: {"TOOL0": FrameName("tool0", np.eye(4))})
    bases: dict[str, FrameName] = field(default_factory=lambda: {"WOBJ0": FrameName("wobj0", np.eye(4))})
    routines: frozenset[str] = frozenset()
    external: tuple[float, ...] | None = None
    depth: int = 0
    straight: bool = False
    settings: int = 0

    def line(self, offset: int) -> int:
        """Return the line of an offset."""
        return self.reader.sources[0].line(offset)

    # declarations

    def declare(self, start: int, text: str) -> None:
        """Read a declaration, or note what a statement assigns."""
        if assigned := _ASSIGNED.match(text):
            self.changed.add(assigned[1].upper())
        match = _DECLARED.match(text)
        if not match or match[5] is None:
            return
        kind, name, value = match[2].lower(), match[3].upper(), match[5]
        offset = start + match.start(5)
        if match[4]:
            return
        if kind == "tooldata":
            self._tool(offset, match[3], value)
        elif kind == "wobjdata":
            self._base(offset, match[3], value)
        elif name in self.targets:
            self.changed.add(name)
        elif (declared := self._literal(offset, value)) and declared[1] == len(value.rstrip()):
            self.targets[name] = declared[0]

    def _tool(self, offset: int, name: str, value: str) -> None:
        pose = self._tool_pose(value)
        if pose is not None and name.upper() not in self.tools:
            self.tools[name.upper()] = FrameName(name, pose)
        else:
            self.tools.pop(name.upper(), None)
            self.reader.leave(self.line(offset), f"{name} is no tool on the flange in numbers")

    def _tool_pose(self, value: str) -> FloatArray | None:
        """Return the pose of a tool on the flange; None for what is none in numbers."""
        frame = re.match(r"\[\s*TRUE\s*,\s*", value, re.IGNORECASE)
        pose = frame and _FRAME.match(value, frame.end())
        return self._pose(pose) if pose else None

    def _base(self, offset: int, name: str, value: str) -> None:
        pose = self._base_pose(value)
        if pose is not None and name.upper() not in self.bases:
            self.bases[name.upper()] = FrameName(name, pose)
        else:
            self.bases.pop(name.upper(), None)
            self.reader.leave(self.line(offset), f"{name} is no fixed work object in numbers")

    def _base_pose(self, value: str) -> FloatArray | None:
        """Return the pose of a fixed work object; None for what is none in numbers."""
        head = re.match(r"\[\s*FALSE\s*,\s*TRUE\s*,\s*\"[^\"]*\"\s*,\s*", value, re.IGNORECASE)
        user = head and _FRAME.match(value, head.end())
        comma = user and re.match(r"\s*,\s*", value[user.end() :])
        part = user and comma and _FRAME.match(value, user.end() + comma.end())
        outer, inner = (self._pose(each) if each else None for each in (user, part))
        return None if outer is None or inner is None else outer @ inner

    def _pose(self, match: re.Match[str]) -> FloatArray | None:
        numbers = [float(x) for group in (1, 2) for x in re.findall(NUMBER, match[group])]
        return POSE.pose(numbers) if POSE.states(numbers) else None

    def _literal(self, offset: int, text: str) -> tuple[_Declared, int] | None:
        """Read a robtarget or jointtarget at the begin of the text; return it and where it ends."""
        for pattern, notation, groups in ((_ROBTARGET, POSE, (1, 2)), (_JOINTTARGET, JOINTS, (1,))):
            if match := pattern.match(text):
                spans = tuple(
                    (offset + m.start(), offset + m.end())
                    for group in groups
                    for m in NUMBER_PATTERN.finditer(text, match.start(group), match.end(group))
                )
                branch = "".join(match[3].split()).strip("[]") if notation is POSE else ""
                axes = tuple(float(x) for x in re.findall(NUMBER, match[4 if notation is POSE else 2]))
                external = tuple(0.0 if x > _NO_AXIS else x for x in axes)
                return _Declared(notation, spans, self.line(offset), branch, external), match.end()
        return None

    # instructions

    def instruction(self, start: int, text: str) -> None:
        """Read a statement of a routine."""
        line = self.line(start)
        self.depth += bool(_OPENED.match(text)) - bool(_CLOSED.match(text))
        if move := _MOVE.match(text):
            self._move(line, move[1].upper(), text[move.end() :], start + move.end())
        elif fault := next((fault for pattern, *fault in _FAULTS if pattern.match(text)), None):
            self.reader.refuse(line, f"{shown(text)} {fault[0]}", fault[1])
        elif _ASSIGNED.match(text):
            name = text.partition(":=")[0].strip().upper()
            if not self._set_frame(line, name, text) and (
                name.partition(".")[0] in self.tools or name.partition(".")[0] in self.bases
            ):
                self.reader.refuse(
                    line, f"{shown(name)} changes while the program runs", "declare the frame in numbers"
                )
        elif not _STILL.match(text):
            called = _CALL.match(text)
            name = called[1] if called else text
            if name.upper() not in self.routines:
                self.reader.call(line, name)

    def _set_frame(self, line: int, name: str, text: str) -> bool:
        """Take a tool or work object that a program without branches and other routines sets in numbers."""
        if self.depth or not self.straight or not (name in self.tools or name in self.bases):
            return False
        value = text.partition(":=")[2].strip()
        known, read = (self.tools, self._tool_pose) if name in self.tools else (self.bases, self._base_pose)
        self.settings += 1
        pose = read(value) if self.settings <= _MOST_SETTINGS else None
        if pose is None:
            return False
        known[name] = FrameName(f"{known[name].name} of line {line}", pose)
        return True

    def _move(self, line: int, name: str, text: str, offset: int) -> None:
        motion, count = _MOVES[name]
        found = []
        for _ in range(count):
            read = self._target(line, text, offset)
            if read is None:
                return
            declared, label, end = read
            found.append((declared, label))
            comma = re.match(r"\s*(?:\\NoEOffs)?\s*(?:\\ID:=\w+)?\s*,\s*", text[end:], re.IGNORECASE)
            if not comma:
                self.reader.refuse(
                    line, f"what follows the target, {shown(text[end:])}, is not known", _REMEDY
                )
                return
            text, offset = text[end + comma.end() :], offset + end + comma.end()
        frames = self._frames(line, text, 2 if name.endswith(("DO", "SYNC")) else -1)
        if frames:
            self.reader.move(
                line, motion, [self._add(line, declared, label, frames) for declared, label in found]
            )

    def _target(self, line: int, text: str, offset: int) -> tuple[_Declared, str, int] | None:
        if read := self._literal(offset, text):
            return read[0], "", read[1]
        name = _NAME.match(text)
        key = name[0].upper() if name else ""
        follows = text[name.end() :].lstrip()[:1] if name else ""
        if not name or key not in self.targets or key in self.changed or follows not in {",", "\\"}:
            self.reader.refuse(
                line, f"the target {shown(text.partition(',')[0])} is not given by numbers", _REMEDY
            )
            return None
        return self.targets[key], name[0], name.end()

    def _frames(self, line: int, text: str, place: int) -> tuple[FrameName, FrameName] | None:
        """Return work object and tool, by the arguments behind the target; `place` is that of the tool."""
        work = re.search(r"\\\s*WObj\s*:=\s*(\w+)", text, re.IGNORECASE)
        arguments = [a.strip() for a in re.sub(r"\[[^\[\]]*\]", "", text).split(",")]
        tool = re.match(r"([A-Za-z]\w*)", arguments[place]) if len(arguments) >= 3 else None
        if not tool:
            self.reader.refuse(
                line, "the move names no tool", "write speed, zone and tool, with \\WObj:= where there is one"
            )
            return None
        base, used = work[1] if work else "wobj0", tool[1]
        for name, known in ((base, self.bases), (used, self.tools)):
            if name.upper() not in known and name.upper() in self.changed:
                self.reader.refuse(
                    line, f"{shown(name)} changes while the program runs", "declare the frame in numbers"
                )
                return None
        return (
            self.bases.get(base.upper(), FrameName(base)),
            self.tools.get(used.upper(), FrameName(used)),
        )

    def _add(
        self, line: int, declared: _Declared, name: str, frames: tuple[FrameName, FrameName]
    ) -> int | None:
        if self.external is not None and declared.external != self.external:
            self.reader.refuse(
                line,
                "an external axis moves",
                "only programs that keep the external axes where they are can be corrected",
            )
            return None
        self.external = declared.external
        return self.reader.target(
            name.upper(),
            (0, declared.line),
            declared.notation,
            declared.numbers,
            frames,
            declared.branch,
            line,
        )


def read_rapid(sources: tuple[Source, ...], allowed: Collection[str]) -> Program:
    """Read a module.

    Raises:
        ProgramError: part of it is not understood.
    """
    reader = Reader("rapid", sources, allowed)
    text = sources[0].text
    routines = frozenset(name.upper() for name in re.findall(r"\bPROC\s+(\w+)", text, re.IGNORECASE))
    straight = len(routines) <= 1 and not _JUMP.search(text)
    module = _Module(reader, routines=routines, straight=straight)
    for parameters in re.findall(r"\b(?:PROC|FUNC\s+\w+)\s+\w+\s*\(([^()]*)\)", text, re.IGNORECASE):
        module.changed |= {name.upper() for name in _NAME.findall(parameters)}
    statements = list(_statements(text))
    for start, statement in statements:
        module.declare(start, statement)
    for start, statement in statements:
        module.instruction(start, statement)
    return reader.program()


_PIECE: Final = re.compile(r'"[^"\n]*"|![^\n\r]*|;|\r\n|\n|\r')
_BLANKS: Final = re.compile(r"\s*")
_HEADER: Final = re.compile(
    r"\s*(?:%%%|%|VERSION|LANGUAGE|MODULE\b|ENDMODULE|(?:LOCAL\s+)?PROC\b|ENDPROC|ENDFUNC|ENDTRAP|ENDIF|ELSE\s*$|ENDFOR|ENDWHILE|ENDTEST|ERROR\s*$|UNDO\s*$|"
    r"DEFAULT\s*:|CASE\b.*:|IF\b.*\bTHEN\s*$|ELSEIF\b.*\bTHEN\s*$|FOR\b.*\bDO\s*$|WHILE\b.*\bDO\s*$|TEST\b|FUNC\b|TRAP\b|\w+:\s*$)",
    re.IGNORECASE,
)


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Yield statements with their offset; comments become blanks, so that offsets stay."""
    plain = _PIECE.sub(lambda m: " " * len(m[0]) if m[0].startswith("!") else m[0], text)
    start = 0
    for piece in _PIECE.finditer(plain):
        start = _BLANKS.match(plain, start).end()  # type: ignore[union-attr]  # it always matches
        if start >= piece.start() and not piece[0].startswith('"'):  # an empty line, or an empty statement
            start = max(start, piece.end())
            continue
        ends = piece[0] == ";"
        if not ends and (piece[0].startswith('"') or not _HEADER.match(plain, start, piece.start())):
            continue
        yield from _stripped(plain, start, piece.start())
        start = piece.end()
    yield from _stripped(plain, start, len(plain))


def _stripped(text: str, start: int, end: int) -> Iterator[tuple[int, str]]:
    body = text[start:end]
    if body.strip():
        yield start + len(body) - len(body.lstrip()), body.strip()
