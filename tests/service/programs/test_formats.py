# ruff: noqa: E501
"""Programs: what is understood, what is refused by line, and what post-processors of CAD systems write."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.examples import examples, is_full
from support.written_programs import moves_of, rewritten, targets_of

from jointstiff.service.kinds.program_path import StatedConfigurations
from jointstiff.service.problems import problem_of
from jointstiff.service.programs import columns
from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.programs.formats import FORMATS, MARK, read_program
from jointstiff.service.programs.program import Motion

PROGRAMS = {
    "krl": (["cell.src", "cell.dat"], ["SPINDLE_ON"]),
    "fanuc": (["CELL.LS"], ["SPINDLE_OFF"]),
    "rapid": (["cell.mod"], []),
    "ur": (["cell.script"], []),
    "csv": (["cell.csv"], []),
}


def files_of(kind):
    return [(name, (Path(__file__).parent / "samples" / name).read_bytes()) for name in PROGRAMS[kind][0]]


def read(kind):
    return read_program(files_of(kind), leave_alone=PROGRAMS[kind][1])


def configuration(program, target):
    """What a target says of the arm's configuration, as it is written."""
    text = program.sources[target.source].text
    return [(name, text[start:end]) for name, start, end in target.words]


def refusal(name, content, **options):
    with pytest.raises(ProgramError) as caught:
        read_program([(name, content.encode("latin-1"))], **options)
    return caught.value


def left_of(name, text, **options):
    try:
        return read_program([(name, text.encode("latin-1"))], leave_others=True, **options).left
    except ProgramError as none_is_certain:
        return none_is_certain.left


def test_every_format_has_a_sample():
    assert set(PROGRAMS) == set(FORMATS)


@pytest.mark.parametrize("kind", PROGRAMS)
def test_identity_gives_identical_bytes(kind):
    program = read(kind)
    files = rewritten(program, np.arange(len(program.targets)), program.targets.values[:, :7])[0]
    assert dict(zip([s.name for s in program.sources], files, strict=True)) == dict(files_of(kind))


@pytest.mark.parametrize("kind", PROGRAMS)
def test_nothing_but_numbers_of_targets_changes(kind):
    program = read(kind)
    step = 0.125 * (np.arange(7) < 3)  # a quaternion has to stay a unit one
    moved = program.targets.values[:, :7] + step
    files, values = rewritten(program, np.arange(len(moved)), moved)
    again = read_program(
        list(zip([s.name for s in program.sources], files, strict=True)), leave_alone=PROGRAMS[kind][1]
    )
    np.testing.assert_array_equal(again.targets.values[:, :7], values)
    for i, new in enumerate(targets_of(again)):
        np.testing.assert_allclose(new.values, moved[i, : len(new.values)], rtol=0, atol=1e-9)
    for source, other in zip(program.sources, again.sources, strict=True):
        assert without_numbers(program, source) == without_numbers(again, other)


def without_numbers(program, source):
    index = program.sources.index(source)
    spans = sorted(
        span
        for target in targets_of(program)
        if target.source == index
        for span in zip(target.spans[::2], target.spans[1::2], strict=True)
    )
    text = source.text
    for start, end in reversed(spans):
        text = text[:start] + text[end:]
    return text


def test_krl_targets_frames_and_places_that_the_controller_keeps():
    program = read("krl")
    assert [(m.line, m.motion) for m in moves_of(program)] == [
        (27, Motion.JOINT),
        (28, Motion.LINEAR),
        (29, Motion.LINEAR),
        (31, Motion.CIRCULAR),
        (37, Motion.LINEAR),
        (40, Motion.SPLINE),
    ]
    declared = targets_of(program)[moves_of(program)[4].targets[0]]
    assert (declared.name, configuration(program, declared)) == ("XP7", [("S", "2"), ("T", "35")])
    assert program.sources[declared.source].name == "cell.dat"
    assert (declared.base.name, declared.tool.name) == ("BASE_DATA[2]", "TOOL_DATA[3]")
    np.testing.assert_allclose(targets_of(program)[1].tool.pose[:3, 3], [0, 0, 0.2155])
    assert [remark.line for remark in program.left_alone] == [20, 30, 46]


def test_fanuc_targets_have_their_frames_and_configuration():
    program = read("fanuc")
    assert moves_of(program)[-1].motion is Motion.CIRCULAR
    assert len(moves_of(program)[-1].targets) == 2
    assert {(t.base.name, t.tool.name) for t in targets_of(program)} == {("UF 2", "UT 3")}
    target = targets_of(program)[1]
    assert target.letters == "NUT"
    assert configuration(program, target) == [("turn1", "0"), ("turn4", "0"), ("turn6", "0")]


def test_fanuc_columns_stay_where_they_are():
    program = read("fanuc")
    values = program.targets.values[[1], :7] + [-9000.1, 0.1, 0, 0, 0, 0, 0]
    lines = rewritten(program, [1], values)[0][0].decode().splitlines()
    assert lines[32] == "\tX = -7385.358  mm,\tY =   -12.400  mm,\tZ =   507.201  mm,"


def test_rapid_frames_are_composed():
    program = read("rapid")
    target = targets_of(program)[moves_of(program)[1].targets[0]]
    np.testing.assert_allclose(target.base.pose[:3, 3], [1.2, -0.3, 0.8])
    np.testing.assert_allclose(target.tool.pose[:3, 3], [0, 0, 0.2155])
    assert [value for _, value in configuration(program, target)] == ["0", "-1", "0", "1"]
    assert moves_of(program)[-1].targets == moves_of(program)[1].targets  # used twice, corrected once


def test_one_point_under_two_bases_is_refused():
    point = "XP1={X 1,Y 2,Z 3,A 0,B 0,C 0}"
    text = f"DEF a()\n{point}\n$BASE=BASE_DATA[1]\nLIN XP1\n$BASE=BASE_DATA[2]\nLIN XP1\nEND"
    assert [fault.line for fault in refusal("a.src", text).faults] == [6]
    assert [left.line for left in left_of("a.src", text)] == [4, 6]


number = st.floats(-3000, 3000).map(lambda x: round(x, 3))
text_between = st.text(st.characters(codec="latin-1", exclude_characters="\n\r\0"), max_size=40).filter(
    lambda text: MARK not in text  # Hypothesis takes constants of the modules, too
)
pose = st.tuples(number, number, number, *[st.floats(-180, 180).map(lambda x: round(x, 3))] * 3)


def krl(p):
    return "LIN {{X {:.3f},Y {:.3f},Z {:.3f},A {:.3f},B {:.3f},C {:.3f}}} C_DIS".format(*p)


def ur(p):
    values = [*(x / 1000 for x in p[:3]), *np.radians(p[3:])]
    return "movel(p[{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f}], a=1, v=0.1)".format(*values)


@examples(300)
@given(st.lists(st.tuples(pose, text_between), min_size=1, max_size=8), st.sampled_from(["\n", "\r\n"]))
@pytest.mark.parametrize(("name", "line", "comment"), [("a.src", krl, ";"), ("a.script", ur, "#")])
def test_any_bytes_in_comments_survive(name, line, comment, targets, end):
    text = end.join(part for p, note in targets for part in (line(p), comment + note)) + end
    program = read_program([(name, text.encode("latin-1"))])
    assert len(program.targets) == len(targets)
    values, every = program.targets.values[:, :7], np.arange(len(targets))
    assert rewritten(program, every, values)[0][0] == text.encode("latin-1")
    moved = values + (np.arange(7) < 3)
    assert rewritten(program, every, moved)[0][0].count(comment.encode()) == text.encode("latin-1").count(
        comment.encode()
    )


@pytest.mark.parametrize(("kind", "sequence"), [("krl", "ZYX"), ("fanuc", "xyz")])
@pytest.mark.parametrize("middle", [0.0, 37.0, 90.0, -90.0, 89.9999])
def test_angles_are_rewritten_near_what_was_written(kind, sequence, middle):
    """A small rotation of a target changes its angles little, away from the lock, and is exact everywhere."""
    notation = next(n for n in read(kind).targets.notations if n.has_pose)
    near = np.array([[100.0, 0, 0, 175.0, middle, -178.0]])
    poses = notation.poses(near)
    np.testing.assert_allclose(
        poses[0, :3, :3], Rotation.from_euler(sequence, near[0, 3:], degrees=True).as_matrix(), atol=1e-15
    )
    poses[0, :3, :3] = Rotation.from_rotvec([1e-4, -2e-4, 5e-5]).as_matrix() @ poses[0, :3, :3]
    new = notation.values(poses, near)
    np.testing.assert_allclose(notation.poses(new), poses, atol=1e-8)
    if abs(middle) < 80:
        assert np.abs(new - near)[:, 3:].max() < 0.1


@pytest.mark.parametrize(
    ("kind", "angles"), [("krl", [[20.0, 90, -70], [20, -90, -70]]), ("ur", [[3.0, 4, 0], [-8, 1, 2]])]
)
def test_the_lock_and_full_turns_keep_the_angles_of_an_unchanged_target(kind, angles):
    notation = next(n for n in read(kind).targets.notations if n.has_pose)
    near = np.pad(angles, ((0, 0), (3, 0)))
    np.testing.assert_allclose(notation.values(notation.poses(near), near), near, atol=1e-6)


POINT = "P1={X 1,Y 2,Z 3,A 0,B 0,C 0}"
LITERAL = "[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"


FREE_FRAMES = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]"
LIN = "LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}"


@pytest.mark.parametrize(("name", "content", "line"), [
    # what the program changes is no target
    ("a.src", f"DEF a()\n{POINT}\nLOOP\nLIN P1\nP1.X = 10\nENDLOOP\nEND", 4),
    ("a.src", f"DEF a()\n{POINT}\nLIN P1\nP1={{X 9,Y 2,Z 3,A 0,B 0,C 0}}\nEND", 3),
    ("a.src", f"DEF a()\n{POINT}\nLIN P1\nmove(P1)\nEND\nDEF move(p:OUT)\nEND", 3),
    ("a.script", "p1 = p[1,2,3,0,0,0]\ndef f(p1):\n  movel(p1)\nend\n", 3),
    ("a.mod", f"MODULE a\nCONST robtarget p1:={LITERAL};\nPROC f(robtarget p1)\nMoveL p1,v10,fine,tool0;\nENDPROC\nENDMODULE", 4),
    # frames depend on the way that the program takes
    ("a.src", f"DEF a()\n{FREE_FRAMES}\nIF x THEN\ns()\nENDIF\n{LIN}\nEND\nDEF s()\n$BASE=BASE_DATA[2]\nEND", 10),
    ("a.src", f"DEF a()\n{FREE_FRAMES}\nLOOP\n{LIN}\ns()\nENDLOOP\nEND\nDEF s()\n$BASE=BASE_DATA[2]\nEND", 10),
    ("a.src", f"DEF a()\n{FREE_FRAMES}\ns()\n$BASE=BASE_DATA[2]\ns()\nEND\nDEF s()\n{LIN}\nEND", 5),
    ("a.src", f"DEF a()\n{LIN}\nEND\nDEF s()\n{LIN}\nEND", 5),
    ("a.script", "def a():\n  movel(p[1,2,3,0,0,0])\nend\ndef b():\n  movel(p[1,2,3,0,0,0])\nend\n", 5),
    # the number of a frame is whole
    *(("a.src", f"DEF a()\nFDAT_ACT={{TOOL_NO {number},BASE_NO 1}}\nBAS(#FRAMES)\n{LIN}\nEND", 2) for number in ("1e400", "1.5")),
])  # fmt: skip
def test_targets_and_frames_that_are_not_certain_are_refused_by_line(name, content, line):
    assert refusal(name, content).faults[0].line == line


@pytest.mark.parametrize(("content", "bases"), [
    (f"DEF a()\n{FREE_FRAMES}\n{LIN}\ns()\n{LIN}\nEND\nDEF s()\n$BASE=BASE_DATA[2]\nEND", [1, 2]),
    (f"DEF a()\ns()\n{FREE_FRAMES}\n{LIN}\nEND\nDEF s()\nEND", [1]),
    *((f"DEF a()\n{FREE_FRAMES}\n{begin}\n$BASE=BASE_DATA[2]\n{LIN}\n{end}\nEND", [2])
      for begin, end in (("LOOP", "ENDLOOP"), ("REPEAT", "UNTIL x"), ("L:", "GOTO L"), ("IF x THEN\nENDIF", ""))),
    (f"DEF a()\n{FREE_FRAMES}\nIF x THEN\n$BASE=BASE_DATA[2]\n{LIN}\n" f"$BASE=BASE_DATA[1]\nENDIF\n{LIN}\nEND", [2, 1]),
])  # fmt: skip
def test_frames_are_followed_over_calls_and_loops(content, bases):
    program = read_program([("a.src", content.encode())])
    targets = targets_of(program)
    assert [targets[move.targets[0]].base.name for move in moves_of(program)] == [
        f"BASE_DATA[{i}]" for i in bases
    ]


SHARE = 1 if is_full() else 10
"""Part of a large file's size by day."""
BIG = 10 * 1024 * 1024 // SHARE
PLACE = "{X 1,Y 2,Z 3,A 0,B 0,C 0}"
HOSTILE = {
    "one letter": "A" * BIG,
    "braces": "{" * BIG,
    "line ends": "\n" * BIG,
    "all bytes": bytes(range(1, 256)).decode("latin-1") * (400 // SHARE),
    "deep folds": ";FOLD x\n" * (100_000 // SHARE),
    "deep braces": "LIN " + "{A " * 1000 + "\n",
    "deep loops": "LOOP\n" * (50_000 // SHARE) + f"LIN {PLACE}\n",
    "NaN": PLACE.replace("1", "NaN"),
    "huge number": "LIN " + PLACE.replace("1", "1e999"),
    "long number": "LIN " + PLACE.replace("1", "1" * 3000),
    "unclosed": f"LIN {PLACE[:-1]}\n" * (5000 // SHARE),
    "relative": "LIN_REL {X 1}\n" * (10_000 // SHARE),
    "variables": "LIN P1\n" * (10_000 // SHARE),
    "brackets": "[" * (BIG // 2),
    "quotes": '"' * 4000 + "\n" + "[1,2,'" * 600,
}


EVERYWHERE = ("all bytes", "brackets", "quotes", "relative")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        *(("a.src", content) for content in HOSTILE.values()),
        *((name, HOSTILE[each]) for name in ("a.LS", "a.mod", "a.script", "a.csv") for each in EVERYWHERE),
    ],
    ids=lambda text: text[:8].strip(),
)
def test_hostile_programs_are_refused_in_few_words(name, content):
    error = refusal(name, content)
    assert len(str(error).encode()) < 8000
    assert len(problem_of(error).model_dump_json().encode()) < 8000


@pytest.mark.timeout(30)
@pytest.mark.parametrize("name", ["a.src", "a.LS", "a.mod", "a.script", "a.csv"])
@pytest.mark.parametrize(
    ("piece", "count"), [("\n", 300_000), (" " * 4000 + "\n", 100), ("$\n", 50_000), ("PROC a(", 500)]
)
def test_large_files_of_nothing_are_refused_soon(name, piece, count):
    """Each of these took minutes once: a pattern that began anew on each line."""
    error = refusal(name, piece * (count // SHARE) + "\n")
    assert len(str(error)) < 8000


def test_many_routines_and_names_are_followed_soon():
    """Of 2,000 routines that call one another, that are called in turn, and of 2,000 branches over as many names."""
    count = 2000 // SHARE
    some = range(count)
    chain = (
        "r0()\nEND\n"
        + "".join(f"DEF r{i}()\n{LIN}\nr{i + 1}()\nEND\n" for i in some)
        + f"DEF r{count}()\nEND"
    )
    turns = "".join(f"r{i}()\n" for i in some) + "END\n" + "".join(f"DEF r{i}()\n{LIN}\nEND\n" for i in some)
    names = "".join(f"P{i}={PLACE}\nIF x THEN\nLIN P{i}\nENDIF\n" for i in some) + "END"
    for body in (chain, turns, names):
        program = read_program([("a.src", f"DEF a()\n{FREE_FRAMES}\n{body}".encode())])
        assert len(program.moves) == count


def test_a_turn_number_that_no_controller_writes_is_not_read():
    (_, content), *_ = files_of("fanuc")
    text = re.sub(r"(CONFIG : '[^,]*,)[^,]*", r"\1 " + "9" * 400, content.decode("latin-1"))
    program = read_program([("CELL.LS", text.encode("latin-1"))], leave_alone=["SPINDLE_OFF"])
    assert np.isinf(StatedConfigurations(program).ranges([0])).all()


@pytest.mark.parametrize(("most", "line"), [("MAX_VISITS", 5), ("MAX_REMARKS", 8)])
def test_a_small_file_cannot_ask_for_endless_work(monkeypatch, most, line):
    monkeypatch.setattr(columns, most, 2)
    text = f"DEF a()\n{POINT}\n" + 3 * "LIN P1\n" + 3 * "s()\n" + "END"
    assert refusal("a.src", text, leave_alone=["s"]).faults[0].line == line


COMMAS = "x [mm];y [mm];z [mm];qw;qx;qy;qz\n1803,25;-290,5;1505,4;1;0;0;0\n+1800;0,0;1505,4;1;0;0;0\n"


def test_decimal_commas_of_a_table_are_read_and_written():
    program = read_program([("a.csv", COMMAS.encode())])
    assert program.targets.values[:, :3].tolist() == [[1803.25, -290.5, 1505.4], [1800.0, 0.0, 1505.4]]
    values = program.targets.values[:, :7].copy()
    values[:, 0] += 0.125
    (text,), _ = rewritten(program, np.arange(2), values)
    assert text.decode().splitlines()[1:] == [
        "1803,375000;-290,5;1505,4;1;0;0;0",
        "+1800,125000;0,0;1505,4;1;0;0;0",
    ]


@pytest.mark.parametrize("row", ["1,803;2,904;1,505", "1.5;2,5;3,5"])
def test_commas_of_a_table_that_may_be_thousands_are_refused(row):
    assert "no number" in refusal("a.csv", f"x [mm];y [mm];z [mm]\n{row}\n").faults[0].reason


@pytest.mark.parametrize("name", ["a.nc", "a.APT", "a.cls"])
def test_other_languages_are_not_read(name):
    assert "are not read" in str(refusal(name, "GOTO/1,2,3"))


FREE = "[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]"
STEPS = range(50)


def krl_pose(i):
    return f"X {800 + i:.3f},Y {-20.5 * i:.3f},Z 450.000,A 0.000,B 90.000,C 0.000"


KRL_MOVES = "\n".join(
    f"CIRC {{{krl_pose(i)}}},{{{krl_pose(i + 0.5)}}} C_DIS" if i % 9 == 5 else f"LIN {{{krl_pose(i)}}} C_DIS"
    for i in STEPS
)
KRL_AXES = "PTP {AXIS: A1 0.00000,A2 -90.00000,A3 90.00000,A4 0.00000,A5 10.00000,A6 0.00000}"
KRL_FRAMES = f"$BASE = {{FRAME: {krl_pose(1)}}}\n$TOOL = {{FRAME: {krl_pose(2)}}}"
KRL_REST = """$VEL.CP = 0.10000
$ACC.CP = 3.00000
$VEL.ORI1 = 100.00000
$APO.CPTP = 1.000
$APO.CDIS = 1.000
$OUT[5]=TRUE
WAIT FOR ($IN[5]==TRUE)
START_TIMER:
$TIMER_STOP[1]=TRUE
$TIMER_FLAG[1]=FALSE
$TIMER[1]=1.000
$TIMER_STOP[1]=FALSE
WAIT FOR ($IN[5]==TRUE OR $TIMER_FLAG[1])
$TIMER_STOP[1]=TRUE
IF $TIMER_FLAG[1]== TRUE THEN
    HALT ; Timed out!
    GOTO START_TIMER
ENDIF
WAIT SEC 0.500
HALT
Wait for StrClear($LOOP_MSG[])
$LOOP_CONT = TRUE
$LOOP_MSG[] = "Drawing done"
"""
KRL_HEAD = """&ACCESS RVP
&REL 1
&COMMENT Generated
&PARAM TEMPLATE = C:\\KRC\\Roboter\\Template\\vorgabe
&PARAM EDITMASK = *
DEF Prog ( )
;FOLD INI
{ini}
;ENDFOLD (INI)
"""
KRL_START = """;FOLD STARTPOS
$BWDSTART = FALSE
PDAT_ACT = {VEL 15,ACC 100,APO_DIST 50}
BAS(#PTP_DAT)
FDAT_ACT = {TOOL_NO 0,BASE_NO 0,IPO_FRAME #BASE}
BAS (#FRAMES)
BAS (#VEL_PTP,50)
;ENDFOLD
;FOLD SET DEFAULT SPEED
$VEL.CP=0.2
BAS(#VEL_PTP,100)
BAS(#TOOL,0)
BAS(#BASE,0)
;ENDFOLD
$ADVANCE = 5
PTP $AXIS_ACT ; skip BCO quickly
"""
STOP = "GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )\nINTERRUPT ON 3\nBAS (#INITMOV,0 )"


def krl_program(ini, *parts):
    return "Prog.src", KRL_HEAD.format(ini=ini) + "\n".join([*parts, "END", ""])


INLINE = "\n".join(
    f""";FOLD LIN P{i} CONT Vel=0.100 m/s CPDAT{i} Tool[1] Base[2];%{{PE}}%R 5.5.0,%MKUKATPBASIS
$BWDSTART=FALSE
LDAT_ACT=LCPDAT{i}
FDAT_ACT=FP{i}
BAS(#CP_PARAMS,0.100)
LIN XP{i} C_DIS
;ENDFOLD
"""
    for i in STEPS
)
INLINE_DATA = "\n".join(
    f"""DECL E6POS XP{i}={{{krl_pose(i)},S 'B010',T 'B000010'}}
DECL FDAT FP{i}={{TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}}
DECL LDAT LCPDAT{i}={{VEL 0.100,ACC 100.000,APO_DIST 1.000,APO_FAC 50.0,ORI_TYP #VAR}}"""
    for i in STEPS
)
INLINE_START = """$BWDSTART=FALSE
PDAT_ACT=PDEFAULT
FDAT_ACT=FHOME
BAS(#PTP_PARAMS,20)
$H_POS=XHOME
PTP XHOME
"""
DATA = ("Prog.dat", f"&ACCESS RVP\n&REL 1\nDEFDAT  Prog\n\n{INLINE_DATA}\n\nENDDAT\n")


def rapid_pose(i):
    return f"[[{800 + i:.3f}, {-20.5 * i:.3f}, 450.000],[0.70710678, 0.00000000, 0.70710678, 0.00000000],[0,-1,0,0],{FREE}]"


def rapid(frames, ends, head, wait=""):
    moves = [
        f"        MoveC {rapid_pose(i)},{rapid_pose(i + 0.5)},rdkSpeed,z1,{ends};"
        if i % 9 == 5
        else f"        MoveL {rapid_pose(i)},rdkSpeed,z1,{ends};"
        for i in STEPS
    ]
    lines = [
        "%%%\n  VERSION:1\n  LANGUAGE:ENGLISH\n%%%\n\nMODULE MOD_Prog\n",
        head,
        "    VAR speeddata rdkSpeed := [250,500,5000,1000]; ! set default speed",
        "    PROC Prog()\n        ConfJ \\On;\n        ConfL \\Off;",
        *frames,
        "        rdkSpeed := [100.00,500,5000,1000];",
        f"        MoveAbsJ [[0.000000,3.9,-14.7,0.0,14.3,-0.0],{FREE}],rdkSpeed,z1,{ends};",
        *moves[:25],
        "        SetDO D_OUT_5, 1;\n        WaitDI D_IN_5, 1;\n        WaitDI D_IN_5, 1, \\MaxTime:=1.0;\n        WaitTime 0.500;\n        STOP;",
        '        TPWrite "Drawing done";',
        *moves[25:],
        "    ENDPROC\nENDMODULE",
    ]
    return "Prog.mod", "\n".join(lines)


RAPID_DATA = """    LOCAL PERS tooldata rdkTool := [TRUE,[[0,0,0],[1,0,0,0]],[2,[0,0,15],[1,0,0,0],0,0,0.005]];
    LOCAL PERS wobjdata rdkWObj := [FALSE, TRUE, "", [[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];"""
PARTS = [
    "        rdkWObj.uframe := [[807.767, -963.700, 41.479],[1.00000000, 0.00000000, 0.00000000, 0.00000000]];",
    "        rdkTool.tframe := [[62.500, -108.253, 100.000],[0.70710678, 0.00000000, 0.70710678, 0.00000000]];",
]
WHOLE = [
    '        rdkWObj := [FALSE, TRUE, "", [[807.767, -963.700, 41.479],[1, 0, 0, 0]],[[0,0,0],[1,0,0,0]]];',
    "        rdkTool := [TRUE,[[62.500, -108.253, 100.000],[0.70710678, 0, 0.70710678, 0]],[2,[0,0,15],[1,0,0,0],0,0,0.005]];",
]


def ur_pose(i):
    return f"p[{0.4 + i / 1000:.6f}, {-0.0205 * i:.6f}, 0.450000, 2.221441, 2.221441, 0.000000]"


UR_MOVES = "\n".join(
    f"  movec({ur_pose(i)},{ur_pose(i + 0.5)},accel_mss,speed_ms,blend_radius_m)"
    if i % 9 == 5
    else f"  movel({ur_pose(i)},accel_mss,speed_ms,0,blend_radius_m)"
    for i in STEPS
)
UR_DEFAULTS = """  # default parameters:
  global speed_ms    = 0.300
  global speed_rads  = 0.750
  global accel_mss   = 3.000
  global accel_radss = 1.200
  global blend_radius_m = 0.001"""
UR_HELPERS = """
  def SprayOn(value):
    # use the value as an output:
    DO_SPRAY = 5
    if value == 0:
      set_standard_digital_out(DO_SPRAY, False)
    else:
      set_standard_digital_out(DO_SPRAY, True)
    end
  end
  def Extruder(value):
    if value < 0:
      # stop extruder
    else:
      # start extruder
    end
  end
  def MoveAxis(value):
    if value <= 0:
      while (get_standard_digital_in(1) != False):
        sync()
      end
    end
  end
"""
UR_REST = """  # set_reference(p[0.807767, -0.963700, 0.041479, 0.000000, 0.000000, 0.000000])
  set_tcp(p[0.062500, -0.108253, 0.100000, -1.209200, 1.209200, 1.209200])
  speed_ms    = 0.100
  accel_mss   = 3.000
  blend_radius_m = 0.005
  movej([-0.806066, -0.118249, -0.358652, 1.245933, 0.865461, -5.280451],accel_radss,speed_rads,0,0)
  set_standard_digital_out(5, True)
  while (get_standard_digital_in(5) != True):
    sync()
  end
  sleep(0.500)
  popup("Drawing done","Message",False,False,blocking=True)"""


def ur_program(*parts, moves=UR_MOVES):
    return "Prog.script", "\n".join(
        ["def Prog():", UR_DEFAULTS, *parts, UR_REST, moves, "end", "", "Prog()", ""]
    )


def fanuc():
    lines = ["UFRAME_NUM=1", "UTOOL_NUM=2", "! set speed", "R[1]=100", "PAYLOAD[1]"]
    lines += [
        f"C P[{2 * i + 1}] \n    :  P[{2 * i + 2}] 100mm/sec CNT1"
        if i % 9 == 5
        else f"L P[{2 * i + 1}] 100mm/sec CNT1"
        for i in STEPS
    ]
    lines += [
        "DO[5]=ON",
        "WAIT DI[5]=ON",
        "WAIT   0.50(sec)",
        "MESSAGE[Drawing done]",
        "$WAITTMOUT=(100)",
        "WAIT DI[5]=ON TIMEOUT, LBL[1]",
        "LBL[1]",
    ]
    lines = [line for line in lines if not line.startswith("$")]
    positions = [
        f"P[{i}]{{\n   GP1:\n    UF : 1, UT : 2,   \tCONFIG : 'N U T, 0, 0, 0',\n\tX =  {800 + i:.3f}  mm,\tY = {-20 * i:.3f}  mm,\tZ =  450.000  mm,\n\tW = 0.000 deg,\tP = 90.000 deg,\tR = 0.000 deg\n}};"
        for i in range(1, 102)
    ]
    head = "/PROG  PROG\n/ATTR\nOWNER\t\t= MNEDITOR;\nDEFAULT_GROUP\t= 1,*,*,*,*;\n/MN\n"
    numbered = [
        f"{i:4d}:{'' if line[:2] in {'L ', 'C '} else '  '}{line} ;" for i, line in enumerate(lines, 1)
    ]
    return "PROG.LS", head + "\n".join([*numbered, "/POS", *positions, "/END", ""])


POSTS = {
    "KUKA KRC2": [krl_program(STOP, KRL_START, KRL_FRAMES, KRL_AXES, KRL_REST, KRL_MOVES)],
    "KUKA KRC4": [krl_program("BAS (#INITMOV,0 )", KRL_START, KRL_FRAMES, KRL_AXES, KRL_MOVES, KRL_REST)],
    "KUKA custom": [krl_program(STOP, "$ADVANCE=5", KRL_FRAMES, KRL_REST, KRL_AXES, KRL_MOVES, "PTP $AXIS_ACT")],
    "KUKA CamRob": [krl_program(STOP, "BAS(#TOOL,1)\nBAS(#BASE,2)\n$APO.CVEL=50", KRL_AXES, KRL_MOVES, KRL_REST)],
    "KUKA KRC2 with .dat": [krl_program(STOP, INLINE_START, INLINE, KRL_REST), DATA],
    "KUKA KRC4 with .dat": [krl_program("BAS (#INITMOV,0 )", INLINE, KRL_REST), DATA],
    "ABB IRC5": [rapid(PARTS, "rdkTool,\\WObj:=rdkWObj", RAPID_DATA)],
    "ABB simplified": [rapid(WHOLE, "rdkTool,\\WObj:=rdkWObj", RAPID_DATA)],
    "ABB S4C": [rapid([], "rdkTool\\WObj:=rdkWObj", RAPID_DATA)],
    "ABB custom": [rapid([], "tool_7\\WObj:=wobj_3", "")],
    "UR": [ur_program()],
    "UR with helpers": [ur_program(UR_HELPERS)],
    "UR movep": [ur_program(moves=UR_MOVES.replace("movel(", "movep(").replace("speed_ms,0,", "speed_ms,"))],
    "UR sub-program": [ur_program("  def Sub():\n    set_standard_digital_out(1, False)\n  end\n  Sub()")],
    "UR with a frame": [ur_program("  global ref_frame = p[0.5,0,0.1,0,0,0]", moves=UR_MOVES.replace("movel(p", "movel(pose_trans(ref_frame,p").replace("],accel_mss,speed_ms,0", "]),accel_mss,speed_ms,0"))],
    "UR joints": [ur_program(moves="\n".join(f"  movej([{i / 100},-1.57,1.57,0.1,0.2,0.3],accel_radss,speed_rads,0,blend_radius_m)" for i in STEPS))],
    "FANUC": [fanuc()],
}  # fmt: skip


@pytest.mark.parametrize("post", POSTS)
def test_posts_are_taken_whole(post):
    """All of the fifty moves are corrected; only moves to places of the controller are not."""
    program = read_program([(name, text.encode()) for name, text in POSTS[post]], leave_others=True)
    assert not [each for each in program.left if "XHOME" not in each.reason]
    assert len(program.moves) in {50, 51}


def test_parts_of_a_frame_are_numbers_beside_the_rest():
    program = read_program([(name, text.encode()) for name, text in POSTS["ABB IRC5"]])
    base, tool = program.targets.frames
    assert base.pose[:3, 3] == pytest.approx([0.807767, -0.9637, 0.041479])
    assert tool.pose[:3, 3] == pytest.approx([0.0625, -0.108253, 0.1])
    assert (base.name, tool.name) == ("rdkWObj", "rdkTool")
