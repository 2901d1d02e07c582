"""Programs of FANUC (.LS, ASCII of TP): J, L, C, A moves to P[i] of the /POS section."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from jointstiff.service.programs.errors import shown
from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import FrameName, Motion, Program, Source
from jointstiff.service.programs.reader import NUMBER, Reader

POSE: Final = Notation(Orientation.FIXED_XYZ, length_decimals=3, angle_decimals=3)
JOINTS: Final = Notation(Orientation.JOINTS, length_decimals=3, angle_decimals=3)
_MOTIONS: Final = {
    "J": Motion.JOINT,
    "L": Motion.LINEAR,
    "C": Motion.CIRCULAR,
    "A": Motion.CIRCULAR,
    "S": Motion.SPLINE,
}
_LINE: Final = re.compile(r"\s*+(\d*+)\s*+:(.*)")
_MOVE: Final = re.compile(r"([JLCAS])\s+(?=P\s*\[|PR\s*\[)")
_POINT: Final = re.compile(r"P\s*\[\s*(\d{1,5})\s*(?::\s*\"?[^\]\"]*\"?\s*)?\]")
_AFTER: Final = re.compile(
    r"\s*(?:[\d.]+|R\[\d+[^\]]*\]|\$\w+)?\s*(?:%|mm/sec|cm/min|inch/min|deg/sec|sec|msec|max_speed|WELD_SPEED)?\s*"
    r"(?:(?:FINE|CNT\s*(?:\d+|R\[\d+[^\]]*\])|CR\d+)\s*)?"
    r"(?:(?:ACC\s*(?:\d+|R\[\d+[^\]]*\])|Wjnt|RTCP|PTH|BREAK|MROT|AP_LD\d*|RT_LD\d*|EV\s*\d+%|"
    r"SPOT\[[^\]]*\]|Arc (?:Start|End)\[[^\]]*\])\s*)*"
    r"(?:(?:TB|TA|DB)\s+[\d.]+\s*(?:sec|mm)\s*,\s*(?:DO|RO|GO|AO|CALL)\b.*)?$"
)
_REFUSED: Final = re.compile(
    r"\b(?:INC|OFFSET|TOOL_OFFSET|VOFFSET|SKIP|TRACK|FORCE|TOUCH|COORD|PSPI|LOCK PREG|PR\s*\[)|"
    r"Offset|Tool_Offset|Skip|Weave",
    0,
)
_REGISTER: Final = re.compile(r"PR\s*\[[^\]]*\]\s*=")
"""A position register, which no move is taken to: those that use one are refused."""
_CHANGED: Final = re.compile(r"(?:P|UFRAME|UTOOL)\s*\[[^\]]*\]\s*=|P\s*\[\s*R\s*\[")
_FRAME: Final = re.compile(r"(UFRAME_NUM|UTOOL_NUM|\$MNUFRAMENUM\[1\]|\$MNUTOOLNUM\[1\])\s*=\s*(\S+)\s*$")
_SAME_FRAME: Final = {"$MNUFRAMENUM[1]": "UFRAME_NUM", "$MNUTOOLNUM[1]": "UTOOL_NUM"}
_STILL: Final = re.compile(
    r"!|//|--|R\[|SR\[|F\[|DO\[|DI\[|RO\[|RI\[|GO\[|GI\[|AO\[|AI\[|SO\[|UO\[|WO\[|M\[|WAIT\b|LBL\[|JMP\b|IF\b|ELSE|ENDIF|SELECT|FOR\b|ENDFOR|=|"
    r"PAUSE|ABORT|END\b|OVERRIDE|PAYLOAD|TIMER|MESSAGE|UALM|JOINT_MAX|LINEAR_MAX|RSR|MONITOR|RUN_?|"
    r"LANGUAGE|REMARK|COL DETECT|COL GUARD|"
    r"DIAG_REC|Arc |SPOT|STOP_TRACKING|\s*$"
)
_CALL: Final = re.compile(r"(?:^|\W)(?:CALL|RUN)\s+(\w+)")
_HEAD: Final = re.compile(r"P\s*\[\s*(\d{1,5})\s*(?::[^\]\n]{0,64})?\]\s*\{")
_GROUP: Final = re.compile(r"\bGP\s*(\d)\s*:?")
_TOKEN: Final = re.compile(
    rf"\b(X|Y|Z|W|P|R|[JE]\d)\s*=\s*({NUMBER}|\*+)\s*(mm|deg|inch|in|rad)?", re.IGNORECASE
)
_USES: Final = re.compile(r"UF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)")
_CONFIG: Final = re.compile(r"CONFIG\s*:\s*'([^'\n]*)'")
_OPENED: Final = re.compile(r"FOR\b|IF\s*\(?.*\bTHEN\b")
_CLOSED: Final = re.compile(r"ENDFOR|ENDIF")


@dataclass
class _Program:
    """The state of a program while it is read."""

    reader: Reader
    positions: dict[str, int] = field(default_factory=dict)
    frames: dict[str, tuple[str, str]] = field(default_factory=dict)
    current: dict[str, str] = field(default_factory=dict)
    circle: tuple[int, int] | None = None
    external: tuple[float, ...] | None = None
    groups: tuple[float, ...] | None = None
    seen: set[str] = field(default_factory=set)
    depth: int = 0

    # /POS

    def position(self, name: str, start: int, body: str) -> None:
        """Read one position, `P[n]{...}`; `body` begins at `start`."""
        line = self.reader.sources[0].line(start)
        self.seen.add(name)
        groups = list(_GROUP.finditer(body))
        own = [i for i, group in enumerate(groups) if group[1] == "1"]
        if groups and len(own) != 1:
            self.reader.refuse(line, f"{name} has no group GP1", "only the arm of group 1 is known")
            return
        if groups:
            ends = [group.start() for group in groups[1:]] + [len(body)]
            others = [body[g.start() : end] for g, end in zip(groups, ends, strict=True) if g[1] != "1"]
            self._other_groups(line, name, others)
            first, last = groups[own[0]].end(), ends[own[0]]
            start, body = start + first, body[first:last]
        uses = _USES.search(body)
        if not uses:
            self.reader.refuse(line, f"{name} has no UF and UT", "record the position again")
            return
        tokens = {m[1].upper(): (m, start + m.start(2), start + m.end(2)) for m in _TOKEN.finditer(body)}
        for fields, notation, units in (
            (("X", "Y", "Z", "W", "P", "R"), POSE, ("mm",) * 3 + ("deg",) * 3),
            (("J1", "J2", "J3", "J4", "J5", "J6"), JOINTS, ("deg",) * 6),
        ):
            if all(f in tokens for f in fields):
                self._add(name, line, notation, [tokens[f] for f in fields], units, uses)
                self._external(line, name, tokens)
                config = _CONFIG.search(body)
                self._branch(name, config[1] if config else "")
                return
        self.reader.refuse(
            line, f"{name} is neither X, Y, Z, W, P, R nor J1 ... J6", "record the position again"
        )

    def _other_groups(self, line: int, name: str, groups: list[str]) -> None:
        """Refuse a position at which another group, such as a positioner, stands elsewhere."""
        values = tuple(float(m[2]) for group in groups for m in _TOKEN.finditer(group) if "*" not in m[2])
        if self.groups is not None and values != self.groups:
            self.reader.refuse(
                line,
                f"another group moves to {name}",
                "only programs that keep GP2 ... where they are can be corrected",
            )
        self.groups = values if self.groups is None else self.groups

    def _add(
        self,
        name: str,
        line: int,
        notation: Notation,
        tokens: list[tuple[re.Match[str], int, int]],
        units: tuple[str, ...],
        uses: re.Match[str],
    ) -> None:
        if any(token[0][2].startswith("*") for token in tokens):
            self.reader.refuse(
                line, f"{name} was not recorded (***)", "record it, or delete it with the lines that use it"
            )
        elif tuple((token[0][3] or "").lower() for token in tokens) != units:
            self.reader.refuse(line, f"{name} is not in mm and deg", "write it with the controller set to mm")
        else:
            self.frames[name] = (uses[1], uses[2])
            self._pending = (line, notation, [token[1:] for token in tokens])

    def _external(self, line: int, name: str, tokens: dict[str, tuple[re.Match[str], int, int]]) -> None:
        values = tuple(
            float(tokens[k][0][2]) for k in sorted(tokens) if k.startswith("E") and "*" not in tokens[k][0][2]
        )
        if self.external is not None and values != self.external:
            self.reader.refuse(
                line,
                f"an external axis moves to {name}",
                "only programs that keep E1 ... where they are can be corrected",
            )
        self.external = values if self.external is None else self.external

    def _branch(self, name: str, branch: str) -> None:
        if name not in self.frames:
            return
        line, notation, spans = self._pending
        base, tool = self.frames[name]
        frames = (_frame("UF", base), _frame("UT", tool))
        index = self.reader.target(name, (0, line), notation, spans, frames, branch)
        if index is not None:
            self.positions[name] = index

    # /MN

    def instruction(self, line: int, body: str, *, goes_on: bool) -> None:
        """Read one line of /MN without its number."""
        if goes_on and self.circle is not None:
            self._through(line, body)
            return
        if self.circle is not None:
            self.reader.refuse(
                line, "the arc before has no end point", "give its second position on the next line"
            )
            self.circle = None
        self.depth += bool(_OPENED.match(body)) - bool(_CLOSED.match(body))
        if move := _MOVE.match(body):
            self._move(line, move[1], body[move.end() :])
        elif body.startswith(("!", "//", "--")) or _REGISTER.match(body):
            return
        elif frame := _FRAME.match(body):
            self._chosen(line, _SAME_FRAME.get(frame[1], frame[1]), frame[2])
        elif any(name in body for name in ("UFRAME_NUM", "UTOOL_NUM", *_SAME_FRAME)):
            self.reader.refuse(
                line, "a frame is chosen inside another instruction", "set it on a line of its own"
            )
        elif _CHANGED.match(body) or _REFUSED.search(body):
            self.reader.refuse(
                line,
                f"{shown(body)} moves positions or frames while the program runs",
                "write positions in numbers",
            )
        else:
            self._other(line, body)

    def _other(self, line: int, body: str) -> None:
        called = _CALL.findall(body)
        for name in called:
            self.reader.call(line, name)
        if not called and not _STILL.match(body):
            self.reader.refuse(line, f"the instruction {shown(body)} is not known", "leave it out")

    def _chosen(self, line: int, which: str, number: str) -> None:
        if self.depth or not number.isdigit():
            self.reader.refuse(
                line, f"{which} is computed, or changes in a loop or a branch", "set it once, by a number"
            )
        else:
            self.current[which] = number

    def _point(self, line: int, body: str) -> tuple[int, str] | None:
        point = _POINT.match(body)
        name = f"P[{point[1]}]" if point else ""
        if name in self.seen and name not in self.positions:  # refused already
            return None
        if not point or name not in self.positions:
            self.reader.refuse(
                line,
                f"the target {shown(name or body[:30])} is not in /POS",
                "write positions in numbers: no PR[] and no P[R[]]",
            )
            return None
        for which, used in zip(("UFRAME_NUM", "UTOOL_NUM"), self.frames[name], strict=True):
            if used.isdigit() and self.current.get(which, used) != used:
                self.reader.refuse(
                    line,
                    f"{name} is recorded with another {which} than is active",
                    "set the frame that it is recorded with",
                )
        return self.positions[name], body[point.end() :]

    def _move(self, line: int, letter: str, body: str) -> None:
        read = self._point(line, body)
        if read is None:
            return
        target, rest = read
        if letter == "C":
            self.circle = (line, target)
            if rest.strip() and _POINT.match(rest.strip()):
                self._through(line, rest.strip())
            elif not _AFTER.match(rest):
                self._rest(line, rest)
        elif self._rest(line, rest):
            self.reader.move(line, _MOTIONS[letter], (target,))

    def _through(self, line: int, body: str) -> None:
        read = self._point(line, body)
        via, self.circle = self.circle, None
        if read and via and self._rest(line, read[1]):
            self.reader.move(via[0], Motion.CIRCULAR, (via[1], read[0]))

    def _rest(self, line: int, rest: str) -> bool:
        if _REFUSED.search(rest):
            self.reader.refuse(
                line, f"{shown(rest)} moves the target while the program runs", "write positions in numbers"
            )
            return False
        if not _AFTER.match(rest):
            self.reader.refuse(line, f"what follows the target, {shown(rest)}, is not known", "leave it out")
            return False
        return True


def _frame(kind: str, number: str) -> FrameName:
    """Frame 0 is the robot's own: its base, or its flange."""
    return FrameName(f"{kind} {number}", np.eye(4) if number == "0" else None)


def read_fanuc(sources: tuple[Source, ...], allowed: Collection[str]) -> Program:
    """Read a .LS file.

    Raises:
        ProgramError: part of it is not understood.
    """
    source = sources[0]
    reader = Reader("fanuc", sources, allowed)
    state = _Program(reader)
    section = {
        m[1]: m.end() for m in re.finditer(r"^/(PROG|ATTR|APPL|MN|POS|END)\b", source.text, re.MULTILINE)
    }
    if "MN" not in section or "POS" not in section:
        reader.refuse(
            None, "the file has no /MN and /POS", "write the program as ASCII (.LS), not as binary (.TP)"
        )
        return reader.program()
    last = section.get("END", len(source.text))
    _read_positions(state, section["POS"], last)
    first = source.line(section["MN"])
    end = source.line(section["POS"])
    for line, _, text in source.lines():
        if first < line < end and (match := _LINE.match(text)):
            state.instruction(line, match[2].strip().removesuffix(";").strip(), goes_on=not match[1])
        elif first < line < end and text.strip():
            reader.refuse(
                line,
                f"the line {shown(text)} has no number and colon",
                "write the program as the controller does",
            )
    return reader.program()


def _read_positions(state: _Program, start: int, end: int) -> None:
    text = state.reader.sources[0].text
    place = start
    while head := _HEAD.search(text, place, end):
        closing = text.find("};", head.end(), end)
        if closing < 0:
            state.reader.refuse(
                state.reader.sources[0].line(head.start()), f"P[{head[1]}] has no end", "close it with };"
            )
            return
        state.position(f"P[{head[1]}]", head.end(), text[head.end() : closing])
        place = closing
