# ruff: noqa: E501  # one program a line
"""Names that are not what they seem: a move is corrected only where its numbers and frames are certain."""

import pytest

from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.programs.formats import explained, read_program

P = "{X 1,Y 2,Z 3,A 0,B 0,C 0}"
FRAMES = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]"
FREE = "[9E9,9E9,9E9,9E9,9E9,9E9]"
ROB = f"[[1,2,3],[1,0,0,0],[0,0,0,0],{FREE}]"
TOOL = "PERS tooldata t1:=[TRUE,[[0,0,9],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];"
WOBJ = '[FALSE,TRUE,"",[[5,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]]'


def corrected(name, text, *more):
    """Lines of the moves that are corrected, and of those that are left."""
    rows = explained([(name, text.encode("latin-1")), *((n, t.encode("latin-1")) for n, t in more)])
    return [row.line for row in rows if row.corrected], [row.line for row in rows if not row.corrected]


def dat(lines, head="DEFDAT a"):
    return "a.dat", f"{head}\n{lines}\nENDDAT"


KRL = [
    # a name of one routine is another one elsewhere
    (f"DEF a()\nDECL E6POS P1\n{FRAMES}\nP1={P}\nLIN P1\nb()\nEND\nDEF b()\nLIN P1\nEND", [], [6], [10]),
    (f"DEF a()\n{FRAMES}\nLIN P1\nb()\nEND\nDEF b()\nDECL E6POS P1\nP1=Q1\nLIN P1\nEND", [dat(f"DECL E6POS P1={P}")], [4], [10]),
    (f"DEF a()\nDECL FRAME F\nF={P}\n{FRAMES}\n$BASE=F\nLIN {P}\nb()\nEND\nDEF b()\n$BASE=F\nLIN {P}\nEND", [], [7], [12]),
    (f"DEF a()\n{FRAMES}\nLIN P1\nb(P2)\nEND\nDEF b(P1:IN)\nLIN P1\nEND", [dat(f"DECL E6POS P1={P}\nDECL E6POS P2={P}")], [4], [8]),
    (f"DEF a()\nDECL E6POS P1\n{FRAMES}\nP1={P}\nother()\n{FRAMES}\nLIN P1\nEND", [], [], [9]),
    # routines and targets that others use
    (f"DEF a()\n{FRAMES}\nb()\nLIN {P}\nEND\nGLOBAL DEF b()\nLIN {P}\nEND", [], [5], [8]),
    (f"DEF a()\n{FRAMES}\nLIN P1\nEND", [dat(f"DECL GLOBAL E6POS P1={P}", "DEFDAT a PUBLIC")], [], [4]),
    # functions in an expression: which of them is carried out, and in which order, is not certain
    *((f"DEF a()\n{FRAMES}\nX={what}\nLIN {P}\nEND\nDEFFCT INT f()\n$BASE=BASE_DATA[2]\nRETURN 1\nENDFCT\nDEFFCT INT g()\n$BASE=BASE_DATA[3]\nRETURN 1\nENDFCT", [], *lines)
      for what, lines in (("f()+g()", ([], [5])), ("Y AND f()", ([], [5])), ("f()", ([5], [])))),
    # what an interrupt does may happen at any time
    *((f"DEF a()\n{FRAMES}\nINTERRUPT DECL 4 WHEN $IN[1] DO b()\nP1={P}\nINTERRUPT ON 4\nLIN P1\nLIN {P}\nEND\nDEF b()\n{what}\nEND", [], *lines)
      for what, lines in (("P1.X=9", ([8], [7])), ("$BASE=BASE_DATA[2]", ([], [7, 8])), ("X=1", ([7, 8], [])))),
    (f"DEF a()\n{FRAMES}\nTRIGGER WHEN DISTANCE=1 DELAY=20 DO $BASE=BASE_DATA[2]\nLIN {P}\n$BASE=BASE_DATA[1]\nLIN {P}\nEND", [], [], [5, 7]),
    (f"DEF a()\n{FRAMES}\nSLIN {P} WITH $IPO_MODE=#TCP\nLIN {P}\nEND", [], [], [4, 5]),
    # blocks of splines with frames of their own
    (f"DEF a()\n{FRAMES}\nSPLINE WITH $BASE=SBASE(FP1.BASE_NO),$TOOL=STOOL2(FP1)\nSPL P1\nENDSPLINE\nEND",
     [dat(f"DECL E6POS P1={P}\nDECL FDAT FP1={{TOOL_NO 3,BASE_NO 4,IPO_FRAME #BASE}}")], [], [5]),
    (f"DEF a()\n{FRAMES}\nSTRANGE()\nLIN {P}\nEND", [], [], [5]),
    # data of a tool and a base that change in part, or are given to a routine
    *((f"DEF a()\n{FRAMES}\n{what}\nFDAT_ACT=FP1\nBAS(#FRAMES)\nLIN {P}\nEND\nDEF b(F:OUT)\nF.TOOL_NO=2\nEND",
       [dat("DECL FDAT FP1={TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE}")], *lines)
      for what, lines in (("FP1.TOOL_NO=2", ([], [7])), ("b(FP1)", ([], [7])), ("b(FP2)", ([7], [])))),
]  # fmt: skip


@pytest.mark.parametrize(("text", "more", "done", "left"), KRL)
def test_krl(text, more, done, left):
    assert corrected("a.src", text, *more) == (done, left)


def test_krl_data_of_another_program_are_refused():
    with pytest.raises(ProgramError, match="declares data of b, not of a"):
        corrected(
            "a.src", f"DEF a()\n{FRAMES}\nLIN P1\nEND", ("b.dat", f"DEFDAT b\nDECL E6POS P1={P}\nENDDAT")
        )


RAPID = [
    (f"PROC a()\nVAR robtarget p1:={ROB};\nMoveL p1,v1,z1,t1;\nENDPROC\nPROC b()\nCONST robtarget p1:={ROB};\nMoveL p1,v1,z1,t1;\nENDPROC", [5, 9], []),
    (f"PROC a()\nVAR robtarget p1:={ROB};\nMoveL p1,v1,z1,t1;\np1:=CRobT();\nENDPROC\nPROC b()\nCONST robtarget p1:={ROB};\nMoveL p1,v1,z1,t1;\nENDPROC", [10], [5]),
    (f"PROC a()\nVAR robtarget p1:={ROB};\nMoveL p1,v1,z1,t1;\nERROR\np1.trans.x:=5;\nRETRY;\nENDPROC", [], [5]),
    (f"PROC a(robtarget p1)\nMoveL p1,v1,z1,t1;\nENDPROC\nPROC b()\nCONST robtarget p1:={ROB};\nMoveL p1,v1,z1,t1;\nENDPROC", [8], [4]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "done", "left"), RAPID)
def test_rapid(text, done, left):
    assert corrected("a.mod", f"MODULE M\n{TOOL}\n{text}\nENDMODULE") == (done, left)


def test_rapid_frames_of_one_routine_are_others_elsewhere():
    text = f"MODULE M\n{TOOL}\nPROC a()\nVAR wobjdata w1:={WOBJ};\nMoveL {ROB},v1,z1,t1\\WObj:=w1;\nENDPROC\nPROC b()\nMoveL {ROB},v1,z1,t1\\WObj:=w1;\nENDPROC\nENDMODULE"
    assert corrected("a.mod", text) == ([5, 8], [])
    bases = [row.base for row in explained([("a.mod", text.encode())])]
    assert bases == ["w1", "w1"]


def test_rapid_parts_of_frames_one_after_the_other():
    head = f"MODULE M\n{TOOL}\nLOCAL PERS wobjdata w1:={WOBJ};\nPROC a()\n"
    parts = [f"w1.oframe:=[[{x},0,0],[1,0,0,0]];\nMoveL {ROB},v1,z1,t1\\WObj:=w1;\n" for x in (10, 20)]
    program = read_program([("a.mod", (head + "".join(parts) + "ENDPROC\nENDMODULE").encode())])
    bases = [program.targets.frames[i].pose[0, 3] for i in program.targets.base.tolist()]
    assert bases == pytest.approx([0.015, 0.025])


def test_rapid_of_two_modules_is_refused():
    with pytest.raises(ProgramError, match="a second module"):
        corrected(
            "a.mod", f"MODULE M\nPROC a()\nMoveL {ROB},v1,z1,t1;\nENDPROC\nENDMODULE\nMODULE N\nENDMODULE"
        )


UR = [
    ("local p1 = p[1,0,0,0,0,0]\nmovel(p1)\nb()\nend\ndef b():\nmovel(p1)", [4], [8]),
    ("movec(pose_to=p[1,0,0,0,0,0], pose_via=p[2,0,0,0,0,0])\nmovel(p[1,0,0,0,0,0])", [4], [3]),
    ("movec(pose_via=p[1,0,0,0,0,0], pose_to=p[2,0,0,0,0,0], a=1)\nmovej(q=[1,2,3,4,5,6])", [3, 4], []),
    ("movej(get_inverse_kin(p[1,0,0,0,0,0], tcp=p[0,0,0,0,0,0]))\nmovel(p[1,0,0,0,0,0])", [4], [3]),
    ("movej(get_inverse_kin(p[1,0,0,0,0,0], [0,0,0,0,0,0], 0.1, 0.1, p[0,0,0,0,0,0]))\nmovel(p[1,0,0,0,0,0])", [4], [3]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "done", "left"), UR)
def test_ur(text, done, left):
    assert corrected("a.script", f"def a():\nset_tcp(pose=p[0,0,0.1,0,0,0])\n{text}\nend\na()") == (
        done,
        left,
    )


def test_every_move_is_explained():
    text = f"DEF a()\n{FRAMES}\nPTP HOME\nLIN {P}\nLIN_REL {{X 5}}\nother()\nLIN {P}\nEND"
    assert [row[:4] + row[6:] for row in explained([("a.src", text.encode())])] == [
        (4, "HOME", "", "", False),
        (5, "1, 2, 3, 0, 0, 0", "BASE_DATA[1]", "TOOL_DATA[1]", True),
        (6, "", "", "", False),
        (8, "in numbers", "", "", False),
    ]


MOVE = f"LIN {P}"
REPEATED = [
    ("a.src", f"DEF a()\n{MOVE}\n{FRAMES}\n{MOVE}\n{MOVE}\n{MOVE}\nother()\n{MOVE}\n{MOVE}\nEND", [2, 5, 6, 7], [9, 10]),
    ("a.src", f"DEF a()\n{FRAMES}\n{MOVE}\n\n; a remark\n{MOVE}\n{MOVE} C_DIS\nEND", [4, 7, 8], []),
    ("a.csv", "x [mm],y [mm],z [mm],tool,e1\n1,2,3,T1,5\n1,2,4,T1,5\n1,2,5,T2,5\n1,2,6,T1,6\n1,2,7,T1,5\n", [2, 3, 6], [4, 5]),
    ("a.csv", "x [mm],y [mm],z [mm]\n1,2,3\n1,2,4\n\n1,2,x\n# a remark\n1,2,5\n1,2,2e6\n", [2, 3, 7], [5, 8]),
    ("a.csv", f"x [mm],y [mm],z [mm],{','.join(f'e1 {i}!' for i in range(30))}\n1,2,3{',5' * 30}\n1,2,4{',5' * 29},6\n", [], [2, 3]),
]  # fmt: skip


@pytest.mark.parametrize(("name", "text", "done", "left"), REPEATED)
def test_moves_that_differ_in_numbers_only_are_judged_each_by_its_own(name, text, done, left):
    assert corrected(name, text) == (done, left)


def test_refusals_name_frames_as_the_program_writes_them():
    wobj = f"PERS wobjdata Table:={WOBJ};"
    move = f"MoveL {ROB},v1,z1,t1\\WObj:=Table;"
    body = f"IF n=1 THEN\nTable.uframe:=[[1,2,3],[1,0,0,0]];\nENDIF\n{move}"
    text = f"MODULE M\n{TOOL}\n{wobj}\nVAR num n;\nPROC main()\n{body}\nENDPROC\nENDMODULE"
    (row,) = explained([("a.mod", text.encode())])
    assert row.base == "Table"
    assert row.reason.startswith("Table changes while the program runs")
