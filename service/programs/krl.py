"""Programs of KUKA (KRL), .src with its .dat: moves to literals or to declared points."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.service.programs.errors import shown
from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import FrameName, Motion, Program, Source
from jointstiff.service.programs.reader import (
    NO_TARGET,
    NUMBER,
    NUMBER_PATTERN,
    Reader,
    without_comment,
    words,
)
from jointstiff.solver.arrays import FloatArray

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
_HOME: Final = frozenset(
    {"$AXIS_ACT", "$POS_ACT", "$H_POS", "HOME", "XHOME"} | {f"XHOME{i}" for i in range(1, 6)}
)
"""Places that a controller keeps: nothing of a move there stands in the program."""
_FIELD: Final = re.compile(
    rf"\s*(\$?[A-Z]\w*)\s*(?:\[\])?\s+({NUMBER}|'B[01]+'|\"[^\"]*\"|#\w+|TRUE|FALSE)\s*(?:,|$)", re.I
)
_AGGREGATE: Final = re.compile(r"\{\s*(?:(E6POS|POS|FRAME|E6AXIS|AXIS)\s*:)?([^{}:]*)\}", re.IGNORECASE)
_N: Final = rf"\s+({NUMBER})\s*"
_PLAIN: Final = re.compile(
    rf"(LIN|PTP|SLIN|SPTP|SPL)\s*\{{\s*X{_N},\s*Y{_N},\s*Z{_N},\s*A{_N},\s*B{_N},\s*C{_N}"
    rf"(,\s*S\s+(\d+)\s*,\s*T\s+(\d+)\s*)?(?:,\s*E[1-6]\s+0{{1,9}}(?:\.0{{0,9}})?\s*){{0,6}}\}}\s*(?:C_DIS|C_PTP|C_VEL|C_ORI|C_SPL)?\s*$",
    re.IGNORECASE,
)
"""A move of the usual form: to a literal pose, its external axes at zero."""
_STANDING: Final = (0.0,) * 6
_NAME: Final = re.compile(r"\$?[A-Z]\w*", re.IGNORECASE)
_MOVE: Final = re.compile(rf"({'|'.join(sorted(_MOVES, key=len, reverse=True))})\s*(?=[\s{{])", re.IGNORECASE)
_RELATIVE: Final = re.compile(r"\w+_REL\b", re.IGNORECASE)
_AFTER: Final = re.compile(
    r"\s*(?:(?:C_PTP|C_DIS|C_VEL|C_ORI|C_SPL)\s*)*(?:,\s*CA\s[^:{}]*)?(?:WITH\b.*)?$", re.IGNORECASE
)
_ASSIGNED: Final = re.compile(
    r"(?:(?:GLOBAL|DECL|CONST|EXT|SIGNAL)\s+)*(?:(E6POS|POS|FRAME|E6AXIS|AXIS|FDAT|[A-Z]\w*)\s+)?(\$?[A-Z]\w*(?:\[[\s\w,+-]*\])?(?:\.\w+)*)\s*=(?!=)\s*(.*)$",
    re.IGNORECASE,
)
_WITH: Final = re.compile(r"\bWITH\b", re.IGNORECASE)
_OWN_FRAME: Final = re.compile(r"\$(?:TOOL|BASE|IPO_MODE)\b", re.IGNORECASE)
_INLINE_TOOL: Final = re.compile(r"\$TOOL\s*=\s*STOOL2?\s*\(\s*(\w+)(?:\.TOOL_NO)?\s*\)", re.IGNORECASE)
_INLINE_BASE: Final = re.compile(r"\$BASE\s*=\s*SBASE\s*\(\s*(\w+)\.BASE_NO\s*\)", re.IGNORECASE)
_FRAMES_CALL: Final = re.compile(r"BAS\s*\(\s*#(TOOL|BASE)\s*,\s*(\d+)\s*\)", re.IGNORECASE)
_STILL: Final = re.compile(
    r"(?:DEF|DEFFCT|DEFDAT|END|ENDDAT|ENDFCT|DECL|INT|REAL|BOOL|CHAR|SIGNAL|EXT|EXTFCT|GLOBAL|IF|ELSE|ENDIF|FOR|ENDFOR|WHILE|ENDWHILE|LOOP|"
    r"ENDLOOP|REPEAT|UNTIL|SWITCH|CASE|DEFAULT|ENDSWITCH|GOTO|WAIT|HALT|EXIT|RETURN|CONTINUE|TRIGGER|INTERRUPT|PULSE|ANOUT|"
    r"BAS|SPLINE|ENDSPLINE|TIME_BLOCK|CONST_VEL|USE|IMPORT|STRUC|ENUM|&\w+|GLOBAL)\b|&|\w+\s*:$",
    re.IGNORECASE,
)
_CALLED: Final = re.compile(r"(?<![#\w$.\[])([A-Z]\w*)\s*\(", re.IGNORECASE)
_DEF: Final = re.compile(r"(?:GLOBAL\s+)?DEF(?:FCT)?\b", re.IGNORECASE)
_DECLARES: Final = re.compile(r"(?:DEF|DEFFCT|DEFDAT|EXT|EXTFCT|DECL|GLOBAL)\b", re.IGNORECASE)
_COMPUTED_FRAME: Final = re.compile(r"(?:BASE|TOOL)_DATA\[(?!\d+\])")
_OPENED: Final = re.compile(r"(?:IF|FOR|WHILE|LOOP|REPEAT|SWITCH)\b", re.IGNORECASE)
_CLOSED: Final = re.compile(r"(?:ENDIF|ENDFOR|ENDWHILE|ENDLOOP|UNTIL|ENDSWITCH)\b", re.IGNORECASE)
_WORDS: Final = words(
    "BAS AND OR NOT EXOR B_AND B_OR PULSE IF WHILE UNTIL SWITCH FOR DEF RETURN IR_STOPM"
) | frozenset(_MOVES)
_NUMERIC: Final = re.compile(r"[XYZABC]|[AE][1-6]|(?:TOOL|BASE)_NO")
"""Fields that are numbers, wherever they stand."""
_POSE_FIELDS: Final = ("X", "Y", "Z", "A", "B", "C")
_JOINT_FIELDS: Final = ("A1", "A2", "A3", "A4", "A5", "A6")
_REMEDY: Final = "write all of X, Y, Z, A, B, C (or A1 ... A6) as numbers"


@dataclass(frozen=True)
class _Aggregate:
    """A literal {...}: where each number of it stands, by field; `branch` of its S and T."""

    source: int
    line: int
    spans: Mapping[str, tuple[int, int]]
    values: Mapping[str, str]

    @cached_property
    def fields(self) -> tuple[str, ...] | None:
        """Fields of a pose or of joints, whichever are all there."""
        for fields in (_POSE_FIELDS, _JOINT_FIELDS):
            if all(f in self.spans for f in fields):
                return fields
        return None

    @property
    def branch(self) -> str:
        """Status and turn, as written: `S 2, T 35`."""
        return ", ".join(f"{name} {self.values[name]}" for name in ("S", "T") if name in self.values)

    @property
    def external(self) -> tuple[float, ...]:
        """Angles or places of the external axes E1 ... E6 (0 where they are not written)."""
        return tuple(float(self.values.get(f"E{i}", "0")) for i in range(1, 7))


@dataclass
class _Program:
    """The state of a program while it is read."""

    reader: Reader
    points: dict[str, _Aggregate] = field(default_factory=dict)
    changed: set[str] = field(default_factory=set)
    base: FrameName = field(default_factory=lambda: FrameName("active $BASE"))
    tool: FrameName = field(default_factory=lambda: FrameName("active $TOOL"))
    frames: dict[str, _Aggregate] = field(default_factory=dict)
    routines: frozenset[str] = frozenset()
    external: tuple[float, ...] | None = None
    depth: int = 0
    routine: int = 0
    moved: bool = False

    def statement(self, source: int, line: int, start: int, text: str) -> None:
        """Read one line without its comment."""
        body = text.strip()
        offset = start + len(text) - len(text.lstrip())
        if not body:
            return
        if (plain := _PLAIN.match(body)) and self.external in {None, _STANDING}:
            self._plain(line, plain, offset)
            return
        self.depth += bool(_OPENED.match(body)) - bool(_CLOSED.match(body))
        self.routine += bool(_DEF.match(body))
        if move := _MOVE.match(body):
            self._move(line, move[1].upper(), body[move.end() :], offset + move.end())
        elif _has_own_frame(body):
            self.reader.refuse(
                line, "a block of moves has frames of its own", "set $TOOL and $BASE before it", source
            )
        elif _RELATIVE.match(body):
            self.reader.refuse(line, "a relative move", NO_TARGET, source)
        elif chosen := _FRAMES_CALL.match(body):
            self._choose(line, chosen[1].upper(), f"{chosen[1].upper()}_DATA[{chosen[2]}]")
        elif assigned := _ASSIGNED.match(body):
            self._assigned(source, line, assigned, offset)
        else:
            self._other(source, line, body)

    def _plain(self, line: int, plain: re.Match[str], offset: int) -> None:
        """Take a move of the usual form."""
        self.external, self.moved = _STANDING, True
        spans = [(offset + start, offset + end) for start, end in plain.regs[2:8]]
        branch = f"S {plain[9]}, T {plain[10]}" if plain[8] else ""
        target = self.reader.target("", (0, line), POSE, spans, (self.base, self.tool), branch, line)
        self.reader.move(line, _MOVES[plain[1].upper()][0], [target])

    def _other(self, source: int, line: int, body: str) -> None:
        known = _STILL.match(body) is not None
        called = {name.upper() for name in _CALLED.findall(re.sub(r'"[^"]*"', '""', body))}
        unknown = called - _WORDS - self.routines if not _DECLARES.match(body) else set()
        for name in sorted(unknown):
            self.reader.call(line, name)
        self.moved |= bool(called & self.routines) and not _DEF.match(body)
        if not known and not called:
            self.reader.refuse(line, f"the statement {shown(body)} is not known", NO_TARGET, source)

    # frames

    def _choose(self, line: int, which: str, name: str) -> None:
        if not self._settable(line, which):
            return
        if name.upper() in self.changed:
            self.reader.refuse(line, f"{name} changes while the program runs", "give it once, in numbers")
            return
        pose = None
        if name.upper() in {"$NULLFRAME", "BASE_DATA[0]", "TOOL_DATA[0]"}:
            pose = np.eye(4)
        elif name.upper() in self.frames:
            pose = self._pose(self.frames[name.upper()])
        frame = FrameName(name.upper(), pose)
        if which == "TOOL":
            self.tool = frame
        else:
            self.base = frame

    def _settable(self, line: int, which: str) -> bool:
        """Refuse a frame that depends on the way the program takes: in a branch, or with several routines."""
        several = len(self.routines) > 1 and (self.routine > 1 or self.moved)
        if self.depth or several:
            self.reader.refuse(
                line,
                f"${which} changes in a branch, a loop or another routine",
                "set it once, in the first routine, before its moves and calls",
            )
        return not (self.depth or several)

    def _pose(self, literal: _Aggregate) -> FloatArray:
        return POSE.pose([float(literal.values[f]) for f in _POSE_FIELDS])

    # what is assigned

    def _assigned(self, source: int, line: int, assigned: re.Match[str], offset: int) -> None:
        name, value = re.sub(r"\s", "", assigned[2]).upper(), assigned[3].strip()
        literal = self._aggregate(source, line, assigned[3], offset + assigned.start(3))
        if name in {"$BASE", "$TOOL"}:
            self._frame(source, line, name[1:], literal, value)
        elif _COMPUTED_FRAME.match(name):
            self.reader.refuse(line, f"{name} is computed", "write the number of the frame", source)
        elif name == "FDAT_ACT":
            self._inline_form(line, literal, value)
        elif name.startswith(("$BASE.", "$TOOL.", "$ACT_BASE", "$ACT_TOOL")):
            self.reader.refuse(line, f"{name} is set by itself", "give the whole frame in numbers", source)
        elif name == "$IPO_MODE" and value.upper() != "#BASE":
            self.reader.refuse(
                line,
                "the tool is fixed in the cell ($IPO_MODE)",
                "only tools on the flange are known",
                source,
            )
        elif literal and (literal.fields or "TOOL_NO" in literal.values):
            self._point(name, literal)
        else:
            self.changed.add(name.partition(".")[0].partition("[")[0] if "." in name else name)
            self._other(source, line, f"DECL {value}")

    def _point(self, name: str, literal: _Aggregate) -> None:
        if name.startswith(("BASE_DATA[", "TOOL_DATA[")):
            if literal.fields is _POSE_FIELDS:
                self.frames[name] = literal
            else:
                self.changed.add(name)
        elif name in self.points:
            self.changed.add(name)
        else:
            self.points[name] = literal

    def _frame(self, source: int, line: int, which: str, literal: _Aggregate | None, value: str) -> None:
        if literal and literal.fields is _POSE_FIELDS:
            self.frames[f"${which} of line {line}"] = literal
            name = f"${which} of line {line}"
            frame = FrameName(name, self._pose(literal))
            if not self._settable(line, which):
                return
            if which == "TOOL":
                self.tool = frame
            else:
                self.base = frame
        elif re.fullmatch(r"\$NULLFRAME|\w+(?:\[\s*\d+\s*\])?", value, re.IGNORECASE):
            self._choose(line, which, re.sub(r"\s", "", value))
        else:
            self.reader.refuse(
                line,
                f"${which} is computed",
                "give it in numbers, or as BASE_DATA[i] or TOOL_DATA[i]",
                source,
            )

    def _inline_form(self, line: int, literal: _Aggregate | None, value: str) -> bool:
        """Take tool and base of an inline form: `FDAT_ACT={TOOL_NO 1,BASE_NO 2}` or a declared one."""
        found = literal or self.points.get(value.upper())
        if found is None or not {"TOOL_NO", "BASE_NO"} <= set(found.values):
            self.reader.refuse(
                line, f"the frames {shown(value)} are not in the program", "send the .dat with the .src"
            )
            return False
        if found.values.get("IPO_FRAME", "#BASE").upper() != "#BASE":
            self.reader.refuse(
                line, "the tool is fixed in the cell (IPO_FRAME)", "only tools on the flange are known"
            )
            return False
        tool, base = (float(found.values[name]) for name in ("TOOL_NO", "BASE_NO"))
        if not (tool.is_integer() and base.is_integer()):  # nor is infinity
            self.reader.refuse(line, "the number of a frame is no whole number", "give TOOL_NO and BASE_NO")
            return False
        self._choose(line, "TOOL", f"TOOL_DATA[{int(tool)}]")
        self._choose(line, "BASE", f"BASE_DATA[{int(base)}]")
        return True

    # targets

    def _aggregate(self, source: int, line: int, text: str, offset: int) -> _Aggregate | None:
        match = _AGGREGATE.match(text)
        if not match or not _AFTER.match(text[match.end() :]):
            return None
        return self._fields(source, line, match, offset)

    def _fields(self, source: int, line: int, match: re.Match[str], offset: int) -> _Aggregate | None:
        spans, values, place = {}, {}, 0
        inner = match[2].rstrip()
        while place < len(inner):
            part = _FIELD.match(inner, place)
            if not part or part[1].upper() in values:
                return None
            name, place = part[1].upper(), part.end()
            if _NUMERIC.fullmatch(name) and not NUMBER_PATTERN.fullmatch(part[2]):
                return None
            values[name] = part[2]
            spans[name] = (offset + match.start(2) + part.start(2), offset + match.start(2) + part.end(2))
        return _Aggregate(source, line, spans, values)

    def _move(self, line: int, name: str, text: str, offset: int) -> None:
        held = self.base, self.tool
        if not _has_own_frame(text) or self._own_frames(line, text):
            self._moved(line, name, text, offset)
        self.base, self.tool = held

    def _own_frames(self, line: int, text: str) -> bool:
        """Take the frames of a spline's inline form: `WITH $TOOL = STOOL2(FP1), $BASE = SBASE(...)`."""
        tool, base = _INLINE_TOOL.search(text), _INLINE_BASE.search(text)
        if not tool or not base or tool[1].upper() != base[1].upper():
            self.reader.refuse(line, "the move has a frame of its own", "set $TOOL and $BASE before the move")
            return False
        key = _NAME.match(text.lstrip())
        if key and key[0].upper() in _HOME and key[0].upper() not in self.points:
            return True
        return self._inline_form(line, None, tool[1])

    def _moved(self, line: int, name: str, text: str, offset: int) -> None:
        motion, count = _MOVES[name]
        targets: list[int | None] = []
        for i in range(count):
            stripped = text.lstrip()
            offset += len(text) - len(stripped)
            read = self._target(line, stripped, offset)
            if read is None:
                return
            target, end = read
            targets.append(target)
            text, offset = stripped[end:], offset + end
            if i + 1 < count:
                comma = re.match(r"\s*,", text)
                if not comma:
                    self.reader.refuse(line, f"{name} has one target and takes two", _REMEDY)
                    return
                text, offset = text[comma.end() :], offset + comma.end()
        if not _AFTER.match(text):
            self.reader.refuse(line, f"what follows the target, {shown(text)}, is not known", _REMEDY)
        elif -1 not in targets:
            self.moved = True
            self.reader.move(line, motion, targets)
        elif len(targets) > 1:
            self.reader.refuse(line, "an arc through a place that the controller keeps", _REMEDY)

    def _target(self, line: int, text: str, offset: int) -> tuple[int | None, int] | None:
        """Read a target at the begin of the text; -1 for a place that the controller keeps."""
        if match := _AGGREGATE.match(text):
            literal = self._fields(0, line, match, offset)
            return (self._add(line, "", literal), match.end()) if self._steady(line, literal) else None
        name = _NAME.match(text)
        key = name[0].upper() if name else ""
        if key in _HOME and key not in self.points:
            self.reader.leave(line, f"a move to {key}, which the controller keeps")
            return -1, len(key)
        if not name or key not in self.points or key in self.changed:
            what = shown(name[0]) if name else "what stands here"
            self.reader.refuse(
                line,
                f"the target {what} is not given by numbers",
                "send the .dat that declares it; " + _REMEDY,
            )
            return None
        literal = self.points[key]
        return (self._add(line, key, literal), name.end()) if self._steady(line, literal) else None

    def _steady(self, line: int, literal: _Aggregate | None) -> bool:
        """Refuse a target that moves an external axis."""
        if literal is None:
            return True
        if self.external is not None and literal.external != self.external:
            self.reader.refuse(
                line,
                "an external axis moves",
                "only programs that keep E1 ... E6 where they are can be corrected",
            )
            return False
        self.external = literal.external
        return True

    def _add(self, line: int, name: str, literal: _Aggregate | None) -> int | None:
        if literal is None or literal.fields is None:
            self.reader.refuse(
                line, "the target is not a whole pose or a whole set of angles in numbers", _REMEDY
            )
            return None
        notation = POSE if literal.fields is _POSE_FIELDS else JOINTS
        spans = [literal.spans[f] for f in literal.fields]
        place = (literal.source, literal.line)
        frames = (self.base, self.tool)
        return self.reader.target(name, place, notation, spans, frames, literal.branch, line)


def _has_own_frame(text: str) -> bool:
    """Tell whether a move or a block sets frames behind WITH."""
    behind = _WITH.search(text) if "$" in text else None
    return behind is not None and _OWN_FRAME.search(text, behind.end()) is not None


def read_krl(sources: tuple[Source, ...], allowed: Collection[str]) -> Program:
    """Read a .src, and the .dat beside it if there is one.

    Raises:
        ProgramError: part of it is not understood.
    """
    ordered = tuple(sorted(sources, key=lambda s: s.name.lower().endswith(".dat")))
    reader = Reader("krl", ordered, allowed)
    routines = frozenset(
        name.upper()
        for source in ordered
        for name in re.findall(
            r"^[ \t]*(?:GLOBAL[ \t]+)?DEF(?:FCT[ \t]+\w+)?[ \t]+(\w+)",
            source.text,
            re.MULTILINE | re.IGNORECASE,
        )
    )
    state = _Program(reader, routines=routines, changed=_changed(ordered, routines))
    for index in range(len(ordered) - 1, -1, -1):  # what is declared comes first
        for line, start, text in ordered[index].lines():
            state.statement(index, line, start, without_comment(text, ";"))
    return reader.program()


def _changed(sources: tuple[Source, ...], routines: frozenset[str]) -> set[str]:
    """Return names that a program may change while it runs: by component, again, or as a parameter."""
    changed: set[str] = set()
    times: Counter[str] = Counter()
    for source in sources:
        for _, _, text in source.lines():
            body = without_comment(text, ";").strip()
            if assigned := _ASSIGNED.match(body):
                name = re.sub(r"\s", "", assigned[2]).upper()
                times[name] += 1
                if "." in name:
                    changed.add(name.partition(".")[0])
            elif {name.upper() for name in _CALLED.findall(body)} & routines or _DEF.match(body):
                changed |= {name.upper() for name in _NAME.findall(body.partition("(")[2])}
    return changed | {name for name, count in times.items() if count > 1}
