# ruff: noqa: ARG005, C901, E501, S311  # one form a line, one controller a function
"""Random robot programs, and what a controller does that runs them: code of its own, line by line.

Each line is one statement of a small part of its language. Whatever the program does not say (conditions, what
unknown routines change, when interrupts come) is drawn.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random
from typing import Any

STEPS = 400
"""Most statements of a run."""
NUMBER = r"-?\d+(?:\.\d+)?"


@dataclass
class Cell:
    """What a controller holds while a program runs."""

    draw: Random
    points: dict[str, Any] = field(default_factory=dict)  # first coordinates of points and frames, by name
    active: dict[str, Any] = field(default_factory=dict)  # active frames: a first coordinate, or a name
    seen: list[tuple[int, tuple[Any, ...], Any, Any]] = field(default_factory=list)
    steps: int = 0
    beside: str = ""  # routine that may run at any time
    own: list[dict[str, Any]] = field(default_factory=list)  # names of the routines that run, innermost last

    def value(self, name: str) -> Any:
        """What a name has: of the routine, or of all; the name where it has nothing."""
        return self.own[-1].get(name, self.points.get(name, name))

    def give(self, name: str, value: Any) -> None:
        """Let a name have something."""
        (self.own[-1] if name in self.own[-1] else self.points)[name] = value

    def junk(self) -> float:
        """A coordinate that stands nowhere in a program."""
        return -self.draw.randint(10_000, 99_999)


class Stopped(Exception):  # noqa: N818
    """The controller stops the program."""


@dataclass(frozen=True)
class Language:
    """Generator and controller of a language."""

    name: str  # name of the file
    make: Callable[[Random], str]
    begins: re.Pattern[str]  # a routine, with its name
    ends: re.Pattern[str]
    act: Callable[[Cell, int, str, Callable[[str], None]], None]  # one plain statement
    opens: re.Pattern[str]  # a branch, or a loop that may be passed over
    repeats: re.Pattern[str]  # which of them are loops
    once: re.Pattern[str]  # loops that are carried out once at least
    turns: re.Pattern[str]
    closes: re.Pattern[str]
    leaves: re.Pattern[str]
    label: re.Pattern[str]
    jump: re.Pattern[str]
    returns: re.Pattern[str]
    start: Callable[[Cell, str], None]  # what holds before the program runs for the first time
    again: Callable[[Cell], None]  # what holds before it runs again


def runs(
    language: Language, text: str, seed: int, times: int = 2
) -> list[tuple[int, tuple[Any, ...], Any, Any]]:
    """Lines, targets, bases and tools of the moves of a program that runs some times."""
    cell, lines = Cell(Random(seed)), text.split("\n")
    language.start(cell, text)
    routines, outside = divided(language, lines)
    for _ in range(times):
        language.again(cell)
        cell.steps = 0
        try:
            main = "" if outside else next(iter(routines))
            carried_out(language, cell, routines | {"": outside}, main)
        except Stopped:
            pass
    return cell.seen


def divided(language, lines):
    routines, outside, here = {}, [], None
    for number, line in enumerate(lines, 1):
        plain = line.strip()
        if match := language.begins.fullmatch(plain):
            here = routines.setdefault(match[1], [])
        elif here is not None and language.ends.fullmatch(plain) and depth_of(language, here) == 0:
            here = None
        elif plain:
            (outside if here is None else here).append((number, plain))
    if language.name == "a.LS":
        texts = [text for _, text in outside]
        return routines, outside[texts.index("/MN") + 1 : texts.index("/POS")]
    return routines, outside if language.name == "a.script" else []


def depth_of(language, lines):
    return sum(bool(language.opens.fullmatch(t)) - bool(language.closes.fullmatch(t)) for _, t in lines)


def carried_out(language: Language, cell: Cell, routines: dict[str, Any], name: str, depth: int = 0) -> None:
    cell.own.append({})
    try:
        routine(language, cell, routines, name, depth)
    finally:
        cell.own.pop()


def routine(language: Language, cell: Cell, routines: dict[str, Any], name: str, depth: int) -> None:
    if depth > 6:
        raise Stopped
    lines, place = routines[name], 0

    def call(other: str) -> None:
        if other in routines:
            carried_out(language, cell, routines, other, depth + 1)
        else:
            raise KeyError(other)

    while place < len(lines):
        number, text = lines[place]
        cell.steps += 1
        if cell.steps > STEPS:
            raise Stopped
        if cell.beside and depth < 5 and cell.draw.random() < 0.15:
            carried_out(language, cell, routines, cell.beside, 5)
        if language.opens.fullmatch(text):
            if not language.once.fullmatch(text) and cell.draw.random() < 0.5:
                place = beside(language, lines, place, turn=not language.repeats.fullmatch(text))
        elif language.turns.fullmatch(text):  # behind a branch that was taken
            place = beside(language, lines, place, turn=False)
        elif language.closes.fullmatch(text):
            begin = opening(language, lines, place)
            if language.repeats.fullmatch(lines[begin][1]) and cell.draw.random() < 0.6:
                place = begin
        elif language.leaves.fullmatch(text):
            begin = place
            while begin >= 0 and not (
                encloses(language, lines, begin, place) and language.repeats.fullmatch(lines[begin][1])
            ):
                begin -= 1
            place = beside(language, lines, begin, turn=False) if begin >= 0 else place
        elif match := language.jump.fullmatch(text):
            if not match.groupdict().get("maybe") or cell.draw.random() < 0.5:
                place = next(
                    k
                    for k, (_, each) in enumerate(lines)
                    if (m := language.label.fullmatch(each)) and m[1] == match["to"]
                )
        elif language.returns.fullmatch(text):
            return
        elif not language.label.fullmatch(text):
            language.act(cell, number, text, call)
        place += 1


def encloses(language, lines, begin, place):
    if not language.opens.fullmatch(lines[begin][1]):
        return False
    return beside(language, lines, begin, turn=False) > place


def beside(language, lines, place, *, turn):
    """The end of what begins or turns here, or its next turn."""
    depth = 0
    for k in range(place + 1, len(lines)):
        text = lines[k][1]
        if depth == 0 and (language.closes.fullmatch(text) or (turn and language.turns.fullmatch(text))):
            return k
        depth += bool(language.opens.fullmatch(text)) - bool(language.closes.fullmatch(text))
    raise AssertionError(lines)


def opening(language, lines, place):
    return max(
        k
        for k in range(place)
        if language.opens.fullmatch(lines[k][1]) and beside(language, lines, k, turn=False) == place
    )


# generation: blocks of statements, nested


def block(draw, statements, nests, depth=0):
    lines = []
    for _ in range(draw.randint(1, 5)):
        if depth < 3 and draw.random() < 0.25:
            before, between, after = draw.choice(nests)
            lines += [before, *block(draw, statements, nests, depth + 1)]
            if between and draw.random() < 0.6:
                lines += [between, *block(draw, statements, nests, depth + 1)]
            lines.append(after)
        else:
            lines.append(draw.choice(statements)(draw))
    return lines


def x_of(draw):
    return f"{draw.randint(1, 999)}.5"


# KRL


def krl_pose(draw):
    return f"{{X {x_of(draw)},Y 2,Z 3,A 0,B 0,C 0}}"


KRL_STATEMENTS = [
    *[lambda d: f"LIN {krl_pose(d)}"] * 4,
    *[lambda d: f"LIN P{d.randint(1, 4)}"] * 3,
    lambda d: f"CIRC P{d.randint(1, 4)},{krl_pose(d)}",
    lambda d: f"P{d.randint(1, 6)}={krl_pose(d)}",
    lambda d: f"P{d.randint(3, 6)}.X={x_of(d)}",
    lambda d: f"P{d.randint(3, 6)}=P{d.randint(1, 4)}",
    lambda d: f"P{d.randint(3, 4)}={{X P{d.randint(1, 2)}.X,Y 2,Z 3,A 0,B 0,C 0}}",
    *[lambda d: f"$BASE=BASE_DATA[{d.randint(0, 3)}]"] * 3,
    *[lambda d: f"$TOOL=TOOL_DATA[{d.randint(0, 3)}]"] * 3,
    lambda d: f"$BASE={krl_pose(d)}",
    lambda d: "$BASE=$NULLFRAME",
    lambda d: f"$BASE=P{d.randint(1, 6)}",
    lambda d: f"$BASE.X={x_of(d)}",
    lambda d: f"BASE_DATA[{d.randint(2, 3)}]={krl_pose(d)}",
    lambda d: f"BASE_DATA[3].X={x_of(d)}",
    lambda d: f"FDAT_ACT={{TOOL_NO {d.randint(0, 3)},BASE_NO {d.randint(0, 3)}}}",
    lambda d: "BAS(#FRAMES)",
    lambda d: "BAS(#CP_PARAMS,0.1)",
    lambda d: "BAS(#INITMOV,0)",
    lambda d: f"BAS(#BASE,{d.randint(0, 3)})",
    *[lambda d: d.choice(["b()", "c()"])] * 2,
    lambda d: d.choice(
        ["other()", "n=other()", f"other(P{d.randint(1, 4)})", "n=1+SIN(2)", "$VEL.CP=0.5", "n=n+1"]
    ),
    lambda d: d.choice(["RETURN", "GOTO L1", "n=2", "n=3", "$OUT[1]=TRUE", "INTERRUPT ON 5"]),
]
KRL_NESTS = [
    ("IF x THEN", "ELSE", "ENDIF"),
    ("WHILE x", "", "ENDWHILE"),
    ("REPEAT", "", "UNTIL x"),
    ("FOR i=1 TO 3", "", "ENDFOR"),
    ("SWITCH x\nCASE 1", "CASE 2", "ENDSWITCH"),
]


def krl_make(draw):
    interrupt = ["INTERRUPT DECL 5 WHEN $IN[1] DO c()"] * (draw.random() < 0.2)
    text = []
    for name in "abc":
        first = (
            [*interrupt, "$TOOL=TOOL_DATA[1]", "$BASE=BASE_DATA[1]"]
            if name == "a" and draw.random() < 0.8
            else interrupt * (name == "a")
        )
        points = [f"P{i}={krl_pose(draw)}" for i in (1, 2, 3, 4) if name == "a" and draw.random() < 0.7]
        own = [f"DECL E6POS P{draw.randint(1, 6)}"] * (draw.random() < 0.3)
        body = [*own, *first, *points, *block(draw, KRL_STATEMENTS, KRL_NESTS)]
        body = [line for line in body if interrupt or line != "INTERRUPT ON 5"]
        body.insert(draw.randint(0, len(body)) if not any("\n" in line for line in body) else 0, "L1:")
        text += [f"DEF {name}()", *body, "END"]
    return "\n".join(text)


def krl_act(cell, number, text, call):
    points, active = cell.points, cell.active

    def value(ref):
        if match := re.match(rf"\{{X (?:({NUMBER})|(\w+)\.X)", ref):
            return float(match[1]) if match[1] else value(match[2])
        return 0.0 if ref in {"$NULLFRAME", "BASE_DATA[0]", "TOOL_DATA[0]"} else cell.value(ref)

    if match := re.fullmatch(r"DECL E6POS (P\d)", text):
        cell.own[-1][match[1]] = ("unset", match[1])
    elif text.startswith(("LIN ", "CIRC ")):
        targets = re.findall(r"\{[^}]*\}|P\d", text.partition(" ")[2])
        cell.seen.append((number, tuple(value(each) for each in targets), active["BASE"], active["TOOL"]))
    elif match := re.fullmatch(r"\$(BASE|TOOL)=(.*)", text):
        active[match[1]] = value(match[2])
    elif match := re.fullmatch(rf"\$BASE\.X=({NUMBER})", text):
        active["BASE"] = ("changed", match[1], active["BASE"])
    elif match := re.fullmatch(r"FDAT_ACT=\{TOOL_NO (\d),BASE_NO (\d)\}", text):
        points["FDAT"] = match[1], match[2]
    elif re.fullmatch(r"BAS\(#(?:FRAMES|CP_PARAMS,0.1)\)", text):
        tool, base = points.get("FDAT", ("?", "?"))
        active["TOOL"], active["BASE"] = value(f"TOOL_DATA[{tool}]"), value(f"BASE_DATA[{base}]")
    elif text == "BAS(#INITMOV,0)":
        active["TOOL"], active["BASE"] = value("TOOL_DATA[1]"), 0.0
    elif match := re.fullmatch(r"BAS\(#BASE,(\d)\)", text):
        active["BASE"] = value(f"BASE_DATA[{match[1]}]")
    elif match := re.fullmatch(r"(P\d|BASE_DATA\[\d\])=(.*)", text):
        cell.give(match[1], value(match[2]))
    elif match := re.fullmatch(rf"(P\d|BASE_DATA\[\d\])\.X=({NUMBER})", text):
        cell.give(match[1], float(match[2]))
    elif "other(" in text:
        active.update(BASE=cell.junk(), TOOL=cell.junk())
        points.update(dict.fromkeys([each for each in points if not each.startswith("P")], cell.junk()))
        points["FDAT"] = "?", "?"
        points |= {f"BASE_DATA[{i}]": cell.junk() for i in (1, 2, 3)} | {
            f"TOOL_DATA[{i}]": cell.junk() for i in (1, 2, 3)
        }
        if match := re.search(r"P\d", text):
            cell.give(match[0], cell.junk())
    elif match := re.fullmatch(r"([bc])\(\)", text):
        call(match[1])
    elif text == "INTERRUPT ON 5":
        cell.beside = "c"
    elif not re.match(r"n=|\$VEL|\$OUT|CASE|INTERRUPT DECL", text):
        raise AssertionError(text)


def krl_again(cell):
    """Frames that are known by name are those that people state, when the program begins."""
    for name in [each for each, x in cell.points.items() if "_DATA" in each and x < 0]:
        del cell.points[name]
    cell.active.update(BASE="active $BASE", TOOL="active $TOOL")
    cell.beside = ""


NEVER = re.compile(r"(?!)")
KRL = Language(
    "a.src", krl_make, re.compile(r"DEF (\w)\(\)"), re.compile("END"), krl_act,
    opens=re.compile(r"IF .*|WHILE .*|REPEAT|FOR .*|SWITCH .*"), repeats=re.compile("WHILE .*|REPEAT|FOR .*"),
    once=re.compile("REPEAT"), turns=re.compile("ELSE|CASE 2"), closes=re.compile("ENDIF|ENDWHILE|UNTIL x|ENDFOR|ENDSWITCH"),
    leaves=re.compile("EXIT"), label=re.compile("(L1):"), jump=re.compile("GOTO (?P<to>L1)"), returns=re.compile("RETURN"),
    start=lambda _, __: None, again=krl_again,
)  # fmt: skip


# RAPID

FREE = "[9E9,9E9,9E9,9E9,9E9,9E9]"


def rapid_point(draw):
    return f"[[{x_of(draw)},2,3],[1,0,0,0],[0,0,0,0],{FREE}]"


def rapid_tool(draw):
    return f"[TRUE,[[{x_of(draw)},0,9],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]]"


def rapid_frame(draw):
    return f'[FALSE,TRUE,"",[[{x_of(draw)},0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]]'


def rapid_ends(draw):
    return f"v1,z1,t{draw.randint(1, 3)}" + draw.choice(["", "\\WObj:=w1", "\\WObj:=w2", "\\WObj:=wx"])


RAPID_STATEMENTS = [
    *[lambda d: f"MoveL {rapid_point(d)},{rapid_ends(d)};"] * 4,
    *[lambda d: f"MoveL p{d.randint(1, 4)},{rapid_ends(d)};"] * 5,
    lambda d: f"MoveC p{d.randint(1, 4)},{rapid_point(d)},{rapid_ends(d)};",
    lambda d: f"p{d.randint(3, 4)}:={rapid_point(d)};",
    lambda d: f"p4.trans.x:={x_of(d)};",
    lambda d: f"p4:=p{d.randint(1, 3)};",
    lambda d: f"t{d.randint(2, 3)}:={rapid_tool(d)};",
    lambda d: f"w2:={rapid_frame(d)};",
    lambda d: (
        f"w2.uframe.trans.x:={x_of(d)};"
        if d.random() < 0.3
        else f"w{d.randint(1, 2)}.uframe:=[[{x_of(d)},0,0],[1,0,0,0]];"
    ),
    lambda d: f"t{d.randint(1, 2)}.tframe:=[[{x_of(d)},0,9],[1,0,0,0]];",
    *[lambda d: d.choice(["b;", "c;"])] * 2,
    lambda d: d.choice(["ext;", "ext p3;", "n:=ext(2);", "SetDO do1,1;", "WaitTime 1;", "n:=n+1;"]),
    lambda d: d.choice(["RETURN;", "GOTO l1;", "n:=2;", 'TPWrite "MoveL";']),
]
RAPID_NESTS = [
    ("IF n=1 THEN", "ELSE", "ENDIF"),
    ("WHILE n<3 DO", "", "ENDWHILE"),
    ("FOR i FROM 1 TO 3 DO", "", "ENDFOR"),
]


def rapid_make(draw):
    head = [f"{draw.choice(['CONST', 'PERS'])} robtarget p{i}:={rapid_point(draw)};" for i in (1, 2)]
    head += [f"PERS robtarget p{i}:={rapid_point(draw)};" for i in (3, 4)]
    head += [f"PERS tooldata t{i}:={rapid_tool(draw)};" for i in (1, 2)] + [
        f"{draw.choice(['LOCAL PERS', 'PERS'])} wobjdata w{i}:={rapid_frame(draw)};" for i in (1, 2)
    ]
    if draw.random() < 0.2:
        head.append("TRAP b2\nc;\nENDTRAP")
    text = ["MODULE M", *head, "VAR num n:=0;"]
    for name in "abc":
        body = block(draw, RAPID_STATEMENTS, RAPID_NESTS)
        own = [f"VAR robtarget p{draw.randint(1, 4)}:={rapid_point(draw)};"] * (draw.random() < 0.3)
        text += [f"PROC {name}()", *own, "l1:", *body, "ENDPROC"]
    return "\n".join([*text, "ENDMODULE"])


def rapid_act(cell, number, text, call):
    points, text = cell.points, text.rstrip(";")

    def value(ref):
        if ref.startswith("["):
            return float(re.search(rf"\[\[({NUMBER})", ref)[1])
        return cell.value(ref)

    if match := re.fullmatch(r"VAR robtarget (p\d):=(.*)", text):
        cell.own[-1][match[1]] = value(match[2])
    elif match := re.fullmatch(r"Move[LC] (.*),v1,z1,(\w+)(?:\\WObj:=(\w+))?", text):
        targets = re.findall(r"\[\[.*?\]\]?,\[1,0,0,0\],\[0,0,0,0\],\[.*?\]\]|p\d", match[1])
        cell.seen.append(
            (number, tuple(map(value, targets)), value(match[3]) if match[3] else 0.0, value(match[2]))
        )
    elif match := re.fullmatch(r"([ptw]\d):=(.*)", text):
        cell.give(match[1], value(match[2]))
    elif match := re.fullmatch(rf"([pw]\d)\.(?:uframe\.)?trans\.x:=({NUMBER})", text):
        cell.give(match[1], float(match[2]))
    elif match := re.fullmatch(r"([wt]\d)\.[ut]frame:=(.*)", text):
        cell.give(match[1], value(match[2]))
    elif "ext" in text:
        if text == "ext p3":
            cell.give("p3", cell.junk())
        points.update(
            {name: cell.junk() for name in [*points, "t3", "wx"] if name not in cell.active["constants"]}
        )
    elif text in {"b", "c"}:
        call(text)
    elif not re.match(r"n:=|SetDO|WaitTime|TPWrite", text):
        raise AssertionError(text)


def rapid_start(cell, text):
    found = re.findall(
        rf'(CONST|LOCAL PERS|PERS) \w+ (\w+):=\[(?:TRUE,|FALSE,TRUE,"",)?\[\[?({NUMBER})', text
    )
    cell.points.update({name: float(x) for _, name, x in found})
    cell.active["constants"] = {name for kind, name, _ in found if kind != "PERS"}


def rapid_again(cell):
    for name in ("t3", "wx"):
        cell.points.pop(name, None)


RAPID = Language(
    "a.mod", rapid_make, re.compile(r"PROC (\w)\(\)"), re.compile("ENDPROC"), rapid_act,
    opens=re.compile("IF .*|WHILE .*|FOR .*"), repeats=re.compile("WHILE .*|FOR .*"), once=NEVER,
    turns=re.compile("ELSE"), closes=re.compile("ENDIF|ENDWHILE|ENDFOR"), leaves=NEVER, label=re.compile("(l1):"),
    jump=re.compile("GOTO (?P<to>l1);"), returns=re.compile("RETURN;"), start=rapid_start, again=rapid_again,
)  # fmt: skip


# FANUC


FANUC_STATEMENTS = [
    *[lambda d: f"{d.choice('LJ')} P[{d.randint(1, 6)}] 50mm/sec FINE"] * 6,
    lambda d: f"C P[{d.randint(1, 6)}]    \n    :  P[{d.randint(1, 6)}] 50mm/sec CNT100",
    *[lambda d: f"  UFRAME_NUM={d.randint(1, 2)}"] * 2,
    *[lambda d: f"  UTOOL_NUM={d.randint(1, 2)}"] * 2,
    lambda d: f"  P[{d.randint(5, 6)}]=PR[1]",
    lambda d: f"  P[{d.randint(5, 6)},1]=R[1]",
    lambda d: d.choice(
        [
            "  CALL X",
            "  R[1]=R[1]+1",
            "  DO[1]=ON",
            "  WAIT .50(sec)",
            "  UFRAME_NUM=R[1]",
            "  IF R[1]=1,CALL X",
        ]
    ),
    lambda d: d.choice(["  JMP LBL[1]", "  IF R[1]=1,JMP LBL[1]", "  !L P[1] 5mm/sec FINE"]),
    lambda d: f"L P[{d.randint(1, 6)}] 50mm/sec FINE\n    :  INC",
]
FANUC_NESTS = [("  IF (R[1]=1) THEN", "  ELSE", "  ENDIF"), ("  FOR R[1]=1 TO 3", "", "  ENDFOR")]


def fanuc_make(draw):
    body = (
        ["  UFRAME_NUM=1", "  UTOOL_NUM=1"] * (draw.random() < 0.7)
        + ["  LBL[1]"]
        + block(draw, FANUC_STATEMENTS, FANUC_NESTS)
    )
    numbered = [f"{i + 1:4d}:{line} ;" for i, line in enumerate(body)]
    places = [
        f"P[{i}]{{\n   GP1:\n\tUF : {draw.choice('1112F')}, UT : {draw.choice('1112F')},\tCONFIG : 'N U T, 0, 0, 0',\n\tX = {x_of(draw)} mm,\tY = 2.0 mm,"
        "\tZ = 3.0 mm,\n\tW = 0.0 deg,\tP = 0.0 deg,\tR = 0.0 deg\n};"
        for i in range(1, 7)
    ]
    return "\n".join(["/PROG A", "/ATTR", "/MN", *numbered, "/POS", *places, "/END", ""])


def fanuc_act(cell, number, text, _call):
    text = re.sub(r"^ *\d*: *", "", text).rstrip(" ;")
    active, points = cell.active, cell.points
    if match := re.fullmatch(r"[LJ] P\[(\d)\] 50mm/sec FINE", text):
        fanuc_move(cell, number, [match[1]])
    elif match := re.fullmatch(r"(?:C )?P\[(\d)\].*", text) if text.startswith("C ") else None:
        active["via"] = number, match[1]
    elif (match := re.fullmatch(r"P\[(\d)\] 50mm/sec CNT100", text)) and active.get("via"):
        line, via = active.pop("via")
        fanuc_move(cell, line, [via, match[1]])
    elif text == "INC":
        cell.seen[-1:] = (
            []
            if not cell.seen
            else [(cell.seen[-1][0], ("increment", *cell.seen[-1][1]), *cell.seen[-1][2:])]
        )
    elif match := re.fullmatch(r"(UFRAME|UTOOL)_NUM=(\d)", text):
        active[match[1]] = f"{'UF' if match[1] == 'UFRAME' else 'UT'} {match[2]}"
    elif match := re.fullmatch(r"P\[(\d)(?:,1)?\]=.*", text):
        points[match[1]] = cell.junk()
    elif text == "CALL X" or text == "IF R[1]=1,CALL X":
        if text == "CALL X" or cell.draw.random() < 0.5:
            active["changed"] = cell.junk()
    elif text == "UFRAME_NUM=R[1]":
        active["UFRAME"] = f"UF {cell.draw.randint(1, 3)}"
    elif not re.match(r"R\[|DO\[|WAIT|!", text):
        raise AssertionError(text)


def fanuc_move(cell, number, names):
    for name in names:
        for kind, which in (("UF", "UFRAME"), ("UT", "UTOOL")):
            stated = cell.points[kind + name]
            if stated not in {f"{kind} F", cell.active[which]} and not cell.active[which].startswith(
                "active"
            ):
                raise Stopped  # INTP-252, INTP-253
    frames = []
    for kind, which in (("UF", "UFRAME"), ("UT", "UTOOL")):
        stated = [
            cell.active[which] if (own := cell.points[kind + name]) == f"{kind} F" else own for name in names
        ]
        frames.append((*stated, cell.active.get("changed")))
    cell.seen.append((number, tuple(cell.points[name] for name in names), *frames))


def fanuc_start(cell, text):
    for name, uf, ut, x in re.findall(
        rf"P\[(\d)\]\{{\s+GP1:\s+UF : (\w), UT : (\w),.*?X = ({NUMBER})", text, re.DOTALL
    ):
        cell.points |= {name: float(x), "UF" + name: f"UF {uf}", "UT" + name: f"UT {ut}"}


def fanuc_again(cell):
    cell.active.clear()
    cell.active.update(UFRAME="active UFRAME_NUM", UTOOL="active UTOOL_NUM")


HEAD = r" *\d*: *"
FANUC = Language(
    "a.LS", fanuc_make, NEVER, NEVER, fanuc_act,
    opens=re.compile(HEAD + r"(?:IF \(.*\) THEN|FOR .*) ;"), repeats=re.compile(HEAD + "FOR .*"), once=NEVER,
    turns=re.compile(HEAD + "ELSE ;"), closes=re.compile(HEAD + "(?:ENDIF|ENDFOR) ;"), leaves=NEVER,
    label=re.compile(HEAD + r"LBL\[(1)\] ;"), jump=re.compile(HEAD + r"(?P<maybe>IF .*,)?JMP LBL\[(?P<to>1)\] ;"),
    returns=re.compile("/POS"), start=fanuc_start, again=fanuc_again,
)  # fmt: skip


# URScript


def ur_pose(draw):
    return f"p[{draw.randint(1, 999) / 1000},0.2,0.3,0,0,0]"


UR_STATEMENTS = [
    *[lambda d: f"movel({ur_pose(d)}, a=1, v=0.1)"] * 4,
    *[lambda d: f"movel(p{d.randint(1, 4)}, a=1)"] * 4,
    *[lambda d: f"movel(pose_trans(r{d.randint(1, 2)}, {ur_pose(d)}), a=1)"] * 2,
    lambda d: f"movej(get_inverse_kin(p{d.randint(1, 4)}), a=1)",
    lambda d: f"movec({ur_pose(d)}, p{d.randint(1, 4)}, a=1)",
    *[lambda d: f"set_tcp({ur_pose(d)})"] * 2,
    lambda d: f"global p{d.randint(3, 4)} = {ur_pose(d)}",
    lambda d: f"global r{d.randint(1, 2)} = {ur_pose(d)}",
    lambda d: f"p4[0] = {x_of(d)}",
    lambda d: f"p{d.randint(3, 4)} = p{d.randint(1, 2)}",
    *[lambda d: d.choice(["b()", "c()"])] * 2,
    lambda d: d.choice(
        [
            "ext()",
            "n = ext(2)",
            "set_digital_out(0, True)",
            "sleep(0.5)",
            "n = n + 1",
            'popup("x", blocking=True)',
        ]
    ),
    lambda d: d.choice(["return n", "n = 2", 'textmsg("movel(p1)")', "run t()"]),
]
UR_NESTS = [("if x:", "else:", "end"), ("while x:", "", "end")]


def ur_make(draw):
    text = []
    for name in "bc":
        text += [f"def {name}():", *block(draw, UR_STATEMENTS, UR_NESTS), "end"]
    text += ["thread t():", *block(draw, UR_STATEMENTS, UR_NESTS), "end"] * (draw.random() < 0.15)
    has_thread = "thread t():" in text
    points = [f"global p{i} = {ur_pose(draw)}" for i in (1, 2, 3, 4) if draw.random() < 0.8]
    points += [f"global r{i} = {ur_pose(draw)}" for i in (1, 2) if draw.random() < 0.8]
    text = [
        "def a():",
        *points,
        *[f"set_tcp({ur_pose(draw)})"] * (draw.random() < 0.7),
        *block(draw, UR_STATEMENTS, UR_NESTS),
        "end",
        *text,
    ]
    return "\n".join([line if has_thread or line != "run t()" else "n = 7" for line in text] + ["a()"])


def ur_act(cell, number, text, call):
    points, active = cell.points, cell.active

    def value(ref):
        if ref.startswith("p["):
            return float(re.match(rf"p\[({NUMBER})", ref)[1])
        return points.get(ref, ("none", ref))

    if text.startswith("move"):
        inner = re.fullmatch(r"\w+\((.*?)(?:, a=1.*)?\)", text)[1]
        frame = 0.0
        if match := re.fullmatch(r"pose_trans\((\w+), (.*)\)", inner):
            frame, inner = value(match[1]), match[2]
        inner = re.sub(r"get_inverse_kin\((.*)\)", r"\1", inner)
        targets = re.findall(r"p\[[^\]]*\]|p\d", inner)
        cell.seen.append((number, tuple(map(value, targets)), frame, active["TCP"]))
    elif match := re.fullmatch(r"set_tcp\((.*)\)", text):
        active["TCP"] = value(match[1])
    elif match := re.fullmatch(r"(?:global )?([pr]\d) = (.*)", text):
        points[match[1]] = value(match[2])
    elif match := re.fullmatch(rf"p4\[0\] = ({NUMBER})", text):
        points["p4"] = float(match[1])
    elif "ext(" in text:
        active["TCP"] = cell.junk()
        points.update({name: cell.junk() for name in points})
    elif match := re.fullmatch(r"([abc])\(\)", text):
        call(match[1])
    elif text == "run t()":
        cell.beside = "t"
    elif not re.match(r"n = |set_digital|sleep|popup|textmsg", text):
        raise AssertionError(text)


def ur_again(cell):
    cell.active["TCP"], cell.beside = "active TCP", ""


UR = Language(
    "a.script", ur_make, re.compile(r"(?:def|thread) (\w)\(\):"), re.compile("end"), ur_act,
    opens=re.compile("if .*|while .*"), repeats=re.compile("while .*"), once=NEVER, turns=re.compile("else:"),
    closes=re.compile("end"), leaves=NEVER, label=NEVER, jump=NEVER, returns=re.compile("return n"),
    start=lambda _, __: None, again=ur_again,
)  # fmt: skip
LANGUAGES = {"krl": KRL, "rapid": RAPID, "fanuc": FANUC, "ur": UR}
