# ruff: noqa: E501
"""Programs that other software writes: tools, frames, configurations of the arm and their words."""

import time
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.examples import examples
from support.programs import FORCE, START, compensated, request, tool_poses, work_of
from support.written_programs import moves_of, targets_of

from jointstiff.service.kinds.program_path import _WORDS, ProgramFrames, StatedConfigurations
from jointstiff.service.kinds.program_work import unpacked
from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.programs.formats import explained, read_program
from jointstiff.simulator.programs import program_text

FREE = "[9E9,9E9,9E9,9E9,9E9,9E9]"
POSE = f"[[10,20,30],[0.5,0.5,0.5,0.5],[0,0,-2,0],{FREE}]"


def read(name, text, *more):
    return read_program([(name, text.encode("latin-1")), *((n, t.encode("latin-1")) for n, t in more)])


def frames(program):
    """Base and tool of each move's last target."""
    return [
        (target.base.name, target.tool.name)
        for target in (targets_of(program)[move.targets[-1]] for move in moves_of(program))
    ]


def refusal(name, text):
    with pytest.raises(ProgramError) as caught:
        read(name, text)
    return caught.value.faults[0]


P = "{X 1,Y 2,Z 3,A 0,B 0,C 0}"


@pytest.mark.parametrize(("lines", "base", "tool"), [
    ("$TOOL=TOOL_DATA[3]\n$BASE=BASE_DATA[3]\nBAS(#INITMOV,0)", "BASE_DATA[0]", "TOOL_DATA[1]"),
    ("BAS(#INITMOV,0)\nBAS(#BASE,2)", "BASE_DATA[2]", "TOOL_DATA[1]"),
    ("$TOOL=TOOL_DATA[3]\n$BASE=BASE_DATA[3]\nFDAT_ACT={TOOL_NO 1,BASE_NO 2}", "BASE_DATA[3]", "TOOL_DATA[3]"),
    ("FDAT_ACT={TOOL_NO 1,BASE_NO 2}\nBAS(#FRAMES)", "BASE_DATA[2]", "TOOL_DATA[1]"),
    ("FDAT_ACT={TOOL_NO 1,BASE_NO 2}\nBAS (#FRAMES,0)", "BASE_DATA[2]", "TOOL_DATA[1]"),
    ("FDAT_ACT={TOOL_NO 1,BASE_NO 2}\nBAS(#INITMOV,0)\nBAS(#CP_PARAMS,0.1)", "BASE_DATA[2]", "TOOL_DATA[1]"),
    ("FDAT_ACT={TOOL_NO 1,BASE_NO 2}\nBAS(#VEL_CP,1)\nBAS(#INITMOV,0)", "BASE_DATA[0]", "TOOL_DATA[1]"),
    ("FDAT_ACT={TOOL_NO 1,BASE_NO 2}\nBAS(#PTP_PARAMS,100)\n$BASE=BASE_DATA[5]", "BASE_DATA[5]", "TOOL_DATA[1]"),
    # newer inline forms change none
    *((f"$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\n{line}", "BASE_DATA[1]", "TOOL_DATA[1]") for line in (
        "$COLLMON_TOL_PRO[1]=USE_CM_PRO_VALUES(0)", "$LOOP_CONT=TRUE", '$LOOP_MSG[]="x"', "$VEL_AXIS[1]=SVEL_JOINT(100.0)",
        "FDAT_ACT={TOOL_NO 1,BASE_NO 1}\nBAS(#FRAMES)", "ANOUT ON x=1*$ANIN[1]+0")),
])  # fmt: skip
def test_krl_frames_change_where_bas_sets_them(lines, base, tool):
    program = read("a.src", f"DEF a()\n{lines}\nLIN {P}\nEND")
    assert frames(program) == [(base, tool)]


def test_krl_tool_1_of_initmov_may_get_its_numbers_before_it_is_used():
    program = read("a.src", f"DEF a()\nBAS(#INITMOV,0)\nTOOL_DATA[1]={P}\n$TOOL=TOOL_DATA[1]\nLIN {P}\nEND")
    assert program.targets.frames[1].pose[:3, 3].tolist() == [0.001, 0.002, 0.003]


@pytest.mark.parametrize(
    "loop",
    [
        "LOOP\n$BASE=BASE_DATA[1]\nBASE_DATA[1]={X 100,Y 2,Z 3,A 0,B 0,C 0}\nLIN {P}\nENDLOOP",
        "LOOP\n$BASE=BASE_DATA[1]\nBASE_DATA[1].X=100\nLIN {P}\nENDLOOP",
        "FOR I=1 TO 3\nBAS(#BASE,1)\nBASE_DATA[1]={X 100,Y 2,Z 3,A 0,B 0,C 0}\nLIN {P}\nENDFOR",
        "LOOP\nBAS(#FRAMES)\nBASE_DATA[1]={X 100,Y 2,Z 3,A 0,B 0,C 0}\nLIN {P}\nENDLOOP",
    ],
)
def test_krl_frames_that_change_in_a_loop_are_refused(loop):
    """The controller has other numbers from the second pass on."""
    data = f"BASE_DATA[1]={P}\nTOOL_DATA[1]={P}\nFDAT_ACT={{TOOL_NO 1,BASE_NO 1}}"
    head = f"{data}\nBAS(#FRAMES)\n$BASE=BASE_DATA[1]"
    fault = refusal("a.src", f"DEF a()\nINT I\n{head}\n{loop.replace('{P}', P)}\nEND")
    assert "while the program runs" in fault.reason


@pytest.mark.parametrize("line", ["LIN {}", "P1={}", "DECL FDAT F={}", "FDAT_ACT={}", "TOOL_DATA[1]={}"])
def test_krl_braces_within_one_another_are_refused_by_line(line):
    fault = refusal("a.src", f"DEF a()\nLIN {P}\n{line.format('{A ' * 500 + '1' + '}' * 500)}\nEND")
    assert (fault.line, fault.remedy) == (3, "declare inner structures on their own")
    assert "more than 16 braces within one another" in fault.reason


def test_krl_trigger_of_a_routine_has_a_priority():
    lines = "$TOOL=TOOL_DATA[3]\n$BASE=BASE_DATA[2]\nTRIGGER WHEN DISTANCE=0 DELAY=0 DO lamp() PRIO=-1"
    program = read("a.src", f"DEF a()\n{lines}\nLIN {P}\nEND\nDEF lamp()\n$OUT[3]=TRUE\nEND\n")
    assert frames(program) == [("BASE_DATA[2]", "TOOL_DATA[3]")]


def test_krl_status_of_recorded_points():
    """As controllers record them, bit 2 of S goes with the sign of A5 in T: S 6, T 19 and S 2, T 35."""
    for point, below in (("S 6,T 19", True), ("S 2,T 35", False), ("S 22,T 50", True)):
        text = f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nPTP {{X 1,Y 2,Z 3,A 0,B 0,C 0,{point}}}\nEND"
        low, high = StatedConfigurations(read("a.src", text)).ranges([0])[0, 4]
        assert (low, high) == ((-np.inf, 0.0) if below else (0.0, np.inf))


def fanuc(moves, groups="", turn=0.0):
    positions = "".join(
        f"P[{i}]{{\n   GP1:\n\tUF : 0, UT : 0,\t\tCONFIG : 'N U T, 0, 0, 0',\n\tX =\t{1600 + i}.081761\tmm,"
        f"\tY =\t-315.778136\tmm,\tZ =\t423.048370\tmm,\n\tW =\t180.000000\tdeg,\tP =\t-.384\tdeg,\tR ="
        f"\t0.000000\tdeg\n{groups.format(turn=6.378 + i * turn)}}};\n"
        for i in (1, 2)
    )
    return f"/PROG  CALIB\n/ATTR\nLOCAL_REGISTERS\t= 0,0,0;\n/MN\n{moves}/POS\n{positions}/END\n"


FANUC_MOVES = """   1:  UTOOL_NUM=0 ;
   2:  UFRAME_NUM=0 ;
\t3:\t;
\t4:J P[1] 100% FINE \t;
   5:L P[2] 50.5mm/sec CNT100    ;
"""
GROUP = "   GP2:\n\tUF : 0, UT : 0,\t\n\tJ1=     {turn} deg\n"


def test_fanuc_with_tabs_and_a_second_group_that_stands_still():
    assert len(read("a.LS", fanuc(FANUC_MOVES)).moves) == 2
    program = read("a.LS", fanuc(FANUC_MOVES, GROUP))
    assert len(program.moves) == 2
    assert targets_of(program)[1].values == (1602.081761, -315.778136, 423.04837, 180.0, -0.384, 0.0)


def explained_fanuc(*body):
    """Line, target, base, tool, and whether it is corrected, of each move."""
    head, _, rest = fanuc([]).partition("/MN\n")
    text = "\n".join([head + "/MN", *body, rest[rest.index("/POS") :]])
    return [(*each[:4], each.corrected) for each in explained([("a.LS", text.encode())])]


@pytest.mark.parametrize(
    ("between", "is_certain"),
    [
        (["      1:  IF (DO[3]=ON),R[2]=5 ;", "      2:  DO[3]=OFF ;", "       ------ ;"], True),
        (["   2:  CALL OTHER ;"], False),  # other frames may be active then
    ],
    ids=["logic within a motion", "a call"],
)
def test_fanuc_positions_belong_to_their_program_and_frames(between, is_certain):
    found = explained_fanuc(
        "   1:J P[1] 10% CNT0 TB .00sec,P-SPS ;", *between, "   2:L P[2] 100mm/sec FINE ;"
    )
    assert [each[1:] for each in found] == [
        ("P[1]", "UF 0", "UT 0", True),
        ("P[2]", "UF 0", "UT 0", is_certain),
    ]


FRAME_CHANGES = (
    "UFRAME[1]=PR[1]",
    "UTOOL[R[1]]=LPOS",
    "$MNUFRAME[1,1]=PR[1]",
    "$GROUP[1].$UFRAME=PR[1]",
    "IF R[1]=1,UFRAME[1]=PR[2]",
    "IF P[1,1]=5,RUN X",
    "FOO P[R[1]]=LPOS",
)


@pytest.mark.parametrize(
    ("lines", "corrected"),
    [
        # moves to registers leave the others, unless they call
        (["   1:J PR[3:REST] 100% FINE ;", "   2:L P[1] 100mm/sec FINE ;"], [False, True]),
        (["   1:L P[R[2]] 50mm/sec CNT10 Offset,PR[1] ;", "   2:L P[1] 100mm/sec FINE ;"], [False, True]),
        (["   1:J PR[3] 100% FINE DB 10mm,CALL X ;", "   2:L P[1] 100mm/sec FINE ;"], [False, False]),
        # a position of a computed number changes
        (["   1:L P[1] 100mm/sec FINE ;", "   2:  P[R[1]]=LPOS ;"], [False]),
        # frames that change are others when the program runs again
        *(
            (
                ["   1:L P[1] 100mm/sec FINE ;", f"   2:  {change} ;", "   3:L P[2] 100mm/sec FINE ;"],
                [False] * 2,
            )
            for change in FRAME_CHANGES
        ),
        # lines of other writers have no number and an end
        (
            [":R[1]=5;", "1: L P[1] 240cm/min CNT100 ;", ": DO[3]=ON;", "2: L P[2] WELD_SPEED CNT100 PTH ;"],
            [True] * 2,
        ),
    ],
)
def test_fanuc_moves_that_are_corrected(lines, corrected):
    assert [each[4] for each in explained_fanuc(*lines)] == corrected


def test_fanuc_second_group_that_moves_is_refused():
    fault = refusal("a.LS", fanuc(FANUC_MOVES, GROUP, turn=1.0))
    assert "group" in fault.reason
    assert fault.line == 20


def rapid(body, head=""):
    return f"MODULE M\n{head}\nPROC main()\n{body}\nENDPROC\nENDMODULE\n"


TOOL = "PERS tooldata t1:=[TRUE,[[0,0,100],[1,0,0,0]],[2,[0,0,15],[1,0,0,0],0,0,0.005]];"


def test_rapid_tool_set_in_numbers_before_the_moves():
    body = f"t1 := [TRUE,[[0,0,200],[1,0,0,0]],[2,[0,0,15],[1,0,0,0],0,0,0.005]];\nMoveL {POSE},v100,z1,t1;"
    program = read("a.mod", rapid(body, TOOL))
    assert targets_of(program)[0].tool.pose[2, 3] == 0.2


@pytest.mark.parametrize(
    ("body", "line", "words"),
    [
        (f"IF d=1 MoveL {POSE},v100,z1,t1;", 4, "after IF"),
        (f"IF d=1 THEN\nt1 := [TRUE,[[0,0,9],[1,0,0,0]],[2,[0,0,1],[1,0,0,0],0,0,0]];\nENDIF\nMoveL {POSE},v1,z1,t1;", 5, "changes"),
        (f"MoveL {POSE},v1,z1,t1;\nt1.tframe := [[0,0,9],[1,0,0,0]];", 5, "changes"),
        (f"t1.tframe.trans := [0,0,9];\nMoveL {POSE},v1,z1,t1;", 4, "changes"),
        (f"t2 := t1;\nMoveL {POSE},v1,z1,t2;", 4, "changes"),
    ],
)  # fmt: skip
def test_rapid_frames_and_moves_in_branches_are_refused(body, line, words):
    fault = refusal("a.mod", rapid(body, TOOL))
    assert fault.line == line
    assert words in fault.reason


@pytest.mark.parametrize("handler", ["ERROR\n  TRYNEXT;\n", ""])
def test_rapid_errors_leave_a_called_routine_anywhere(handler):
    """The wait may fail: its caller then goes on behind the call with the frame that was set first."""
    text = (
        'MODULE m\nLOCAL PERS wobjdata w1:=[FALSE,TRUE,"",[[5,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n'
        "LOCAL PERS tooldata t1:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
        "PROC a()\n  b;\n  MoveL [[100,0,0],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v1,z1,t1\\WObj:=w1;\n"
        f"{handler}ENDPROC\nPROC b()\n  w1.uframe:=[[100,0,0],[1,0,0,0]];\n  WaitDI di1,1\\MaxTime:=2;\n"
        "  w1.uframe:=[[9,0,0],[1,0,0,0]];\nENDPROC\nENDMODULE\n"
    )
    if handler:
        with pytest.raises(ProgramError, match="changes while the program runs"):
            read("a.mod", text)
    else:
        assert frames(read("a.mod", text)) == [("w1", "t1")]


def test_rapid_arguments_behind_the_tool_and_units():
    last = f"MoveL {POSE}\\ID:=1,[20,500,5000,1000],z1,t1 \\WObj:=wobj0;"
    body = f"ActUnit STN1;\nMoveLDO {POSE},v100,z1,t1,do1,1;\n{last}"
    assert frames(read("a.mod", rapid(body, TOOL))) == [("wobj0", "t1")] * 2


POSTED_UR = """def Milling():
  global speed_ms    = 0.250
  global ref_frame = p[0,0,0,0,0,0]
  ref_frame = p[0.500000, 0.000000, 0.100000, 0.000000, 0.000000, 0.000000]
  set_tcp(p[0.000000, 0.000000, 0.200000, 0.000000, 0.000000, 0.000000])
  $ 1 "Robot Program"
  movej([-1.570796, -1.570796, 1.570796, -1.570796, -1.570796, 0.0],1.2,0.75,0,0)
  movel(pose_trans(ref_frame,p[0.1, 0.02, 0.05, 2.221441, 2.221441, 0.0]),1.2,speed_ms,0,0.001)
  ref_frame = p[0.7, 0, 0, 0, 0, 0]
  movel(pose_trans(ref_frame,p[1e-1, 0.02, 0.05, 2.221441, 2.221441, 0.0]),1.2,speed_ms,0,0.001)
  speed_ms    = 0.1
end

Milling()
"""


def test_ur_threads_may_run_without_a_name():
    body = "def a():\n set_tcp(p[0,0,0.1,0,0,0])\n thread t():\n  sync()\n end\n run t()\n movel(p[1,2,3,0,0,0])\nend\n"
    assert len(moves_of(read("a.script", body))) == 1
    moving = body.replace("sync()", "set_tcp(p[0,0,0.2,0,0,0])")
    assert refusal("a.script", moving).line == 4


def test_ur_frames_that_are_set_one_after_the_other():
    program = read("a.script", POSTED_UR)
    assert [targets_of(program)[move.targets[0]].base.pose[0, 3] for move in moves_of(program)] == [
        0.0,
        0.5,
        0.7,
    ]


def test_ur_variables_are_not_the_tool_of_the_controller_whatever_their_name():
    moved = "  set_tcp(p[0,0,0.1,0,0,0])\n  TCP=p[0,0,0.5,0,0,0]\n  movel(p[0.1,0.2,0.3,0,0,0])\n"
    program = read("a.script", f"def a():\n{moved}end\na()\n")
    assert [targets_of(program)[move.targets[0]].tool.pose[2, 3] for move in moves_of(program)] == [0.1]


def test_ur_frames_that_a_loop_sets_are_refused():
    """The frame of the first pass is another one than that of the passes behind it."""
    text = POSTED_UR.replace("  movel(pose_trans", "  while True:\n  movel(pose_trans", 1).replace(
        "end\n", "end\nend\n", 1
    )
    assert refusal("a.script", text).line == 10


@pytest.mark.parametrize("call", ["servoj([0,0,0,0,0,0], t=0.1)", "force_mode(p[0,0,0,0,0,0],[0,0,1,0,0,0])"])
def test_ur_moves_without_targets_are_refused_as_what_they_are(call):
    assert "without a target" in refusal("a.script", f"movel(p[1,2,3,0,0,0])\n{call}\n").reason


def test_tables_of_tool_axes_take_the_angle_about_the_axis_from_the_request():
    text = "x [mm],y [mm],z [mm],i,j,k\n10,20,30,0,0.6,0.8\n11,20,30,0,1.2,1.6\n"
    used = ProgramFrames.of(read("a.csv", text), request("csv", text, tool_x=[2.0, 0.0, 0.0]))
    poses = used.flange_poses(read("a.csv", text), np.arange(2)) @ used.tool.of(np.arange(2))
    np.testing.assert_allclose(poses[:, :3, 2], [[0, -0.6, -0.8]] * 2, atol=1e-12)
    np.testing.assert_allclose(poses[:, :3, 0], [[1, 0, 0]] * 2, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.src", "DEF a()\nExtruder_on(1)\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND", "EXTRUDER_ON"),
        ("a.src", "DEF a()\nBASE_DATA[i]={X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND", "computed"),
        ("a.mod", rapid(f"ArcL {POSE},v100,seam1,weld1,z1,t1;", TOOL), "process"),
    ],
)
def test_what_may_move_is_not_passed_over(name, text, words):
    assert words in refusal(name, text).reason


def test_loops_over_axes_and_registers_that_no_move_uses_are_left():
    loop = "FOR I=1 TO 6\n$VEL_AXIS[I]=50\n$ACC_AXIS[I]=50\nENDFOR\n"
    assert len(read("a.src", f"DEF a()\n{loop}LIN {{X 1,Y 2,Z 3,A 0,B 0,C 0}}\nEND").moves) == 1
    assert len(read("a.LS", fanuc(FANUC_MOVES + "   6:  PR[1,2]=R[3] ;\n")).moves) == 2
    module = rapid(f'MoveLSync {POSE},v100,z1,t1,"p1";', TOOL)
    assert "P1" in refusal("a.mod", module).reason
    program = read_program([("a.mod", module.encode())], leave_alone=["p1"])
    assert frames(program) == [("wobj0", "t1")]


def test_blanks_within_a_line_of_fanuc_take_no_time():
    """A pattern that gives blanks back took their cube: a minute for one line."""
    text = "/PROG A\n/MN\n" + "".join(f"   {i}:!x{' ' * 4000}x ;\n" for i in range(1, 20)) + "/POS\n/END\n"
    began = time.process_time()
    with suppress(ProgramError):
        read_program([("a.ls", text.encode())])
    assert time.process_time() - began < 1.0


@pytest.mark.parametrize(
    "line", ["------", "TC_ONLINE", "PAYLOAD[1]", "IF R[1]=1,JMP LBL[1] ;\n   7:  LBL[1]"]
)
def test_fanuc_instructions_that_change_no_position(line):
    assert len(read("a.LS", fanuc(f"{FANUC_MOVES}   6:  {line} ;\n   8:J P[1] 5% FINE ;\n")).moves) == 3


def test_fanuc_lines_without_a_number_continue_the_one_before():
    """An increment on a line of its own moves the target of the line before."""
    program = read_program(
        [("a.LS", fanuc(FANUC_MOVES.replace("CNT100    ;", "CNT100\n    :  INC ;")).encode())],
        leave_others=True,
    )
    assert [left.line for left in program.left] == [9]


@pytest.mark.parametrize("line", ['popup("x", "t", blocking=True)', "def helper():\nsleep(1)\nend"])
def test_ur_tool_and_named_arguments(line):
    pose = "p[0.1,0.2,0.3,0,0,0]"
    program = read("a.script", f"def a():\n{line}\nset_tcp({pose})\nmovel(pose={pose}, a=1, v=0.1)\nend")
    assert targets_of(program)[0].tool.pose[0, 3] == 0.1


def test_rapid_quotes_within_texts_and_the_mark_of_utf_8():
    body = f'TPWrite "a""; MoveL b";\nMoveL {POSE},v100,z1,t1;'
    assert len(read("a.mod", "\xef\xbb\xbf" + rapid(body, TOOL)).moves) == 1


@pytest.mark.parametrize("name", ["HOME", "XHOME", "$H_POS"])
def test_krl_places_of_the_cell_are_never_corrected(name):
    """Other programs use them, too, even where the program gives them numbers."""
    head = f"DEF a()\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\nHOME={P}\n"
    program = read("a.src", f"{head}PTP {name}\nLIN {P}\nEND")
    assert [target.line for target in targets_of(program)] == [6]
    assert [remark.line for remark in program.left_alone] == [5]


def test_a_point_that_is_used_otherwise_is_left():
    """Its numbers stand in a calculation, or in a move that is left: a correction would move that, too."""
    point, other = f"P1={P}", f"LIN {P}"
    for use in ("P2=P1", "$BASE=P1", "LIN P1:{X 1}", "x=P1.X+1", "f(P1)", "CIRC P1,P9", "P2={X P1.X,Y 2}"):
        text = f"DEF a()\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\n{point}\n{other}\nLIN P1\n{use}\nEND"
        program = read_program([("a.src", text.encode())], leave_others=True)
        assert [target.line for target in targets_of(program)] == [5], use


FRAMES = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]"


def postures(kind, text, **changes):
    """The chosen posture of each point of the path [°]."""
    return np.degrees(work_of(kind, text, **changes)._path.cases.joints)


def krl_numbers(joints):
    (line,) = (
        each for each in program_text("krl", tool_poses(joints[None]), 5).split("\r\n") if "LIN" in each
    )
    return line.partition("{")[2].partition("}")[0]


def status_and_turn(joints):
    """S (bit 2 alone) and T by KUKA's manual: T has bit i where axis i + 1 is below zero."""
    return 4 * int(joints[4] < 0.0), sum(1 << i for i in range(6) if joints[i] < 0.0)


@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1), (1, -1, 1), (-1, -1, -1)])
def test_krl_status_and_turn_choose_the_posture(signs):
    joints = np.radians([20.0, -10.0, 15.0, 60.0, 40.0, 100.0]) * [
        signs[0],
        1,
        1,
        signs[1],
        signs[1],
        signs[2],
    ]
    s, t = status_and_turn(joints)
    for turn in (t, f"'B{t:06b}'"):
        text = f"DEF a()\n{FRAMES}\nPTP {{{krl_numbers(joints)},S {s},T {turn}}}\nEND"
        np.testing.assert_allclose(postures("krl", text, start=None)[0], np.degrees(joints), atol=1e-3)


def test_krl_turn_adds_full_turns():
    joints = np.radians([20.0, -10.0, 15.0, 60.0, 40.0, 100.0])
    for far in (0.0, 360.0):
        turned = joints - np.radians([0, 0, 0, 0, 0, far])
        s, t = status_and_turn(turned)
        text = f"DEF a()\n{FRAMES}\nPTP {{{krl_numbers(joints)},S {s},T {t}}}\nEND"
        np.testing.assert_allclose(postures("krl", text, start=None)[0], np.degrees(turned), atol=1e-3)


def test_krl_linear_moves_keep_the_configuration_whatever_they_state():
    joints = np.radians([20.0, -10.0, 15.0, 60.0, 40.0, 100.0])
    s, t = status_and_turn(joints)
    text = (
        f"DEF a()\n{FRAMES}\nPTP {{{krl_numbers(joints)},S {s},T {t}}}\n"
        f"LIN {{{krl_numbers(joints + 0.02)},S {4 - s},T {63 - t}}}\nEND"
    )
    found = postures("krl", text, start=None)
    np.testing.assert_allclose(found[1], np.degrees(joints + 0.02), atol=1e-3)


def test_what_no_posture_has_is_refused_by_line():
    s, t = status_and_turn(START)
    text = f"DEF a()\n{FRAMES}\nPTP {{{krl_numbers(START)},S {s},T {t ^ 2}}}\nEND"
    with pytest.raises(ProgramError, match="configuration") as caught:
        work_of("krl", text)._path  # noqa: B018
    assert caught.value.faults[0].line == 4


def test_krl_turn_is_rewritten_where_an_axis_crosses_zero():
    joints = np.radians([0.005, -10.0, 15.0, 60.0, 40.0, 100.0])
    s, t = status_and_turn(joints)
    text = f"DEF a()\n{FRAMES}\nPTP {{{krl_numbers(joints)},S {s},T {t}}}\nEND"
    crossing = []
    for sign in (1.0, -1.0):
        result = compensated("krl", text, start=None, load={"force": tuple(sign * np.array(FORCE))})
        crossing.append(f"T {t}}}" not in unpacked(result.files[0]).decode())
        assert f"T {t | 1 if crossing[-1] else t}}}" in unpacked(result.files[0]).decode()
    assert sorted(crossing) == [False, True]


def rapid_move(joints, confdata, move="MoveJ"):
    (line,) = (
        each for each in program_text("rapid", tool_poses(joints[None]), 5).split("\n") if "MoveL" in each
    )
    return line.replace("MoveL", move).replace("[0,0,0,0]", confdata).strip()


def module(*lines):
    return "\n".join(["MODULE a", "PROC main()", *lines, "ENDPROC", "ENDMODULE"])


def confdata(joints):
    """Quadrants of axes 1, 4 and 6, and cfx, whose least bit says that axis 5 is negative (ABB's manual)."""
    quadrants = np.floor(np.degrees(joints) / 90.0).astype(int)
    return f"[{quadrants[0]},{quadrants[3]},{quadrants[5]},{int(joints[4] < 0)}]"


@pytest.mark.parametrize("last", [100.0, -100.0, 200.0])
@pytest.mark.parametrize("flip", [1, -1])
def test_rapid_confdata_chooses_the_posture(last, flip):
    joints = np.radians([20.0, -10.0, 15.0, 60.0 * flip, 40.0 * flip, last])
    text = module(rapid_move(joints, confdata(joints)))
    np.testing.assert_allclose(
        postures("rapid", text, start=np.degrees(joints + 0.1).tolist())[0], np.degrees(joints), atol=1e-3
    )


def test_rapid_conf_j_off_takes_the_nearest():
    joints = np.radians([20.0, -10.0, 15.0, 60.0, 40.0, 100.0])
    angles = ",".join(map(str, np.degrees(joints)))
    first = f"MoveAbsJ [[{angles}],{FREE}],v50,fine,tMill;"
    stays = module("ConfJ\\Off;", first, rapid_move(joints, "[1,1,1,1]"))
    np.testing.assert_allclose(postures("rapid", stays)[1], np.degrees(joints), atol=1e-3)
    with pytest.raises(ProgramError, match="configuration"):
        postures("rapid", stays.replace("ConfJ\\Off;", ""))


def test_fanuc_letters_that_change_are_refused():
    text = program_text("fanuc", tool_poses(START + 0.01 * np.arange(3)[:, None]), 4)
    assert len(postures("fanuc", text)) == 3
    head, _, tail = text.rpartition("N U T")
    with pytest.raises(ProgramError, match="N/F") as caught:
        postures("fanuc", f"{head}F U T{tail}")
    assert len(caught.value.faults) == 1


def test_fanuc_turn_numbers_choose_full_turns():
    joints = START.copy()
    joints[5] += 2 * np.pi
    text = program_text("fanuc", tool_poses(joints[None]), 4).replace("0, 0, 0'", "0, 0, 1'")
    text = text.replace("1:L P[1] 50mm/sec CNT100", "1:J P[1] 50% FINE")
    found = postures("fanuc", text, start=np.degrees(START).tolist())[0]
    assert found[5] == pytest.approx(
        np.degrees(joints[5]) if np.degrees(joints[5]) < 350 else found[5], abs=1e-3
    )


def test_turns_follow_the_path():
    """Full turns add up along a path, as the controller's do."""
    angles = np.radians(np.linspace(-300.0, 300.0, 61))
    joints = np.tile(START, (61, 1))
    joints[:, 5] = angles
    text = program_text("krl", tool_poses(joints), 5)
    found = postures("krl", text, start=np.degrees(joints[0]).tolist())
    np.testing.assert_allclose(found, np.degrees(joints), atol=1e-3)


EVERY = [(name, word) for name, words in _WORDS.items() for word in words]


@pytest.mark.parametrize(("name", "word"), EVERY, ids=[f"{name}-{word.joint}" for name, word in EVERY])
@examples(200)
@given(angle=st.floats(-9.0, 9.0).filter(lambda angle: abs(angle) > 1e-6), before=st.integers(0, 63))
def test_what_is_written_holds_the_angle(name, word, angle, before):
    number = word.rewritten(before, angle)
    ((low, high),) = word.ranges(np.array([float(number)]))
    assert low - 1e-9 <= angle <= high + 1e-9
    width = {"sign": np.inf, "quadrant": np.pi / 2, "turn": 2 * np.pi}[word.kind]
    assert high - low == pytest.approx(width)
    if word.bit is not None:
        assert (number ^ before) & ~(1 << word.bit) == 0
    assert word.ranges(np.array([np.nan])).tolist() == [[-np.inf, np.inf]]
