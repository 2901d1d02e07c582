# ruff: noqa: E501  # one case a line
"""Compensated programs: their points, what is certain, patterns of moves, and other solvers' answers."""

import math
import re
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.examples import examples
from support.programs import FORCE, compensated, exact_run, loaded_poses, path, request, tool_poses, work_of
from support.random_programs import LANGUAGES, runs
from support.written_programs import rewritten

from jointstiff import schemas, service, solver
from jointstiff.service.kinds.program_work import ProgramWork, packed, unpacked
from jointstiff.service.kinds.work import pack, unpack
from jointstiff.service.problems import FilesError
from jointstiff.service.programs import fanuc, krl, rapid, ur
from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.programs.formats import explained, read_program
from jointstiff.service.programs.notation import Numerals
from jointstiff.service.security import admission
from jointstiff.simulator.programs import PROGRAM_FILES, program_text

KINDS = list(PROGRAM_FILES)
FULL = 13
"""Digits behind a millimetre's point, with which rounding is no matter."""


def commanded_poses(kind, result):
    """Poses of the tool that the corrected file states, and the posture before rounding."""
    file = result.files[0]
    program = read_program([(file.name, unpacked(file))])
    (notation,) = program.targets.notations
    return notation.poses(program.targets.values[:, : 3 + notation.count])


def inverse(poses, near):
    """Angles that bring the tool to poses, by Newton's method on the simulator's kinematics."""
    q = near.copy()
    for _ in range(6):
        here = tool_poses(q)
        step = twist(here, poses)
        columns = [twist(here, tool_poses(q + 1e-6 * unit)) / 1e-6 for unit in np.eye(6)]
        q = q + np.linalg.solve(np.stack(columns, axis=2), step[..., None])[..., 0]
    return q


def twist(from_, to):
    turn = to[:, :3, :3] @ from_[:, :3, :3].transpose(0, 2, 1)
    skew = 0.5 * np.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], 1
    )
    return np.concatenate([to[:, :3, 3] - from_[:, :3, 3], skew], axis=1)


@pytest.mark.parametrize("kind", ["krl", "fanuc", "rapid", "ur", "csv"])
def test_the_loaded_tool_is_where_the_program_says(kind):
    joints = path(25)
    goal = tool_poses(joints)
    result = compensated(kind, program_text(kind, goal, FULL))
    reached = loaded_poses(inverse(commanded_poses(kind, result), joints))
    assert np.linalg.norm(reached[:, :3, 3] - goal[:, :3, 3], axis=1).max() < 1e-9
    np.testing.assert_allclose(reached, goal, atol=1e-9)
    assert result.residual.greatest < 1e-9
    assert result.corrected == 25
    mirror = 2.0 * goal[:, :3, 3] - loaded_poses(joints)[:, :3, 3]
    assert np.linalg.norm(mirror - commanded_poses(kind, result)[:, :3, 3], axis=1).max() > 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_the_certificate_knows_the_rounding(kind):
    joints = path(25)
    result = compensated(kind, program_text(kind, tool_poses(joints), 3))
    exact = np.linalg.norm(loaded_poses(joints)[:, :3, 3] - tool_poses(joints)[:, :3, 3], axis=1)
    assert result.deflection.greatest == pytest.approx(exact.max(), rel=1e-4)
    assert 0.0 < result.rounding.greatest <= result.residual.greatest < 3e-6


@pytest.mark.parametrize("kind", KINDS)
def test_no_force_gives_identical_bytes(kind):
    text = program_text(kind, tool_poses(path(20)), 4)
    result = compensated(kind, text, load={"force": (0.0, 0.0, 0.0)})
    assert unpacked(result.files[0]) == text.encode()
    assert result.corrected == 0


def test_joint_targets_are_commanded_exactly():
    joints = path(10)
    rows = ["j1 [rad],j2 [rad],j3 [rad],j4 [rad],j5 [rad],j6 [rad]"]
    rows += [",".join(f"{v:.15f}" for v in row) for row in joints]
    result = compensated("csv", "\n".join(rows) + "\n", bases=[], start=None)
    program = read_program([("path.csv", unpacked(result.files[0]))])
    commanded = program.targets.values[:, :6]
    np.testing.assert_allclose(loaded_poses(commanded), tool_poses(joints), atol=1e-9)


def test_loads_by_lines_and_by_points():
    text = program_text("krl", tool_poses(path(10)), 4)
    segments = [{"first_line": 9, "last_line": 12, "force": FORCE}]
    by_lines = compensated("krl", text, load=None, segments=segments)
    assert by_lines.left_alone == {"no_load": 6}
    assert by_lines.corrected == 4
    before, after = text.encode().split(b"\r\n"), unpacked(by_lines.files[0]).split(b"\r\n")
    assert [i + 1 for i in range(len(before)) if before[i] != after[i]] == [9, 10, 11, 12]
    table = "point,Fx [N],Fy [N],Fz [kN]\n" + "".join(f"{i},300,400,-1.4\n" for i in range(3, 7))
    by_points = compensated_with_table(text, table)
    assert unpacked(by_points.files[0]) == unpacked(by_lines.files[0])


def compensated_with_table(text, table):
    asked = request("krl", text)
    files = [*asked.files, packed("loads.csv", table.encode())]
    changed = asked.model_copy(update={"load": None, "loads": "loads.csv", "files": files})
    robot, run = exact_run()
    return ProgramWork(robot, "robot", run, changed).conclude(())


def test_the_frames_of_the_controller():
    """Base, world, tool and flange in other places give the same correction."""
    joints = path(5)
    goal = tool_poses(joints)
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.5, -0.2, 0.1]
    plain = compensated("krl", program_text("krl", goal, FULL))
    base = [500.0, -200.0, 100.0, 90.0, 0.0, 0.0]
    moved = program_text("krl", np.linalg.inv(turned) @ goal, FULL)
    for frames in ({"bases": [{"name": "base_data[1]", "values": base}]}, {"world": base}):
        result = compensated("krl", moved, **frames)
        np.testing.assert_allclose(
            turned @ commanded_poses("krl", result), commanded_poses("krl", plain), atol=1e-9
        )
    half = {"tools": [{"values": [0, 0, 115.5, 0, 0, 0]}], "flange": [10.0, -20.0, 100.0, 0, 0, 0]}
    other = compensated("krl", program_text("krl", goal, FULL), **half)
    np.testing.assert_allclose(commanded_poses("krl", other), commanded_poses("krl", plain), atol=1e-9)


def test_steps_give_the_same_program():
    text = program_text("krl", tool_poses(path(30)), 4)
    work = work_of("krl", text, limits={"ramp": 20.0})
    whole = work.conclude(())
    parts = [unpack(pack(work.compute(span))) for span in ((0, 7), (7, 9), (9, 30))]
    assert work.conclude(parts) == whole


def test_one_target_under_two_loads_is_refused():
    frames = "$TOOL=$NULLFRAME\n$BASE=$NULLFRAME"
    text = f"DEF a()\n{frames}\nXP1={{X 1803,Y 290,Z 1505,A 18,B 140,C 9}}\nLIN XP1\nLIN XP1\nEND"
    segments = [{"first_line": 5, "last_line": 5, "force": FORCE}]
    with pytest.raises(ProgramError, match="two loads"):
        compensated("krl", text, load=None, segments=segments, tools=[], bases=[])


@pytest.mark.parametrize("rest", ["\n" * 2_000, "," * 20_000])
def test_a_table_of_loads_has_no_more_lines_and_cells_than_points_need(rest):
    table = packed("loads.csv", f"point,Fx [N],Fy [N],Fz [N]\n1,0,0,9\n{rest}".encode())
    asked = request("krl", program_text("krl", tool_poses(path(2)), 4), load=None, loads="loads.csv")
    robot, run = exact_run()
    request_with_table = asked.model_copy(update={"files": [*asked.files, table]})
    with pytest.raises(FilesError, match="more lines or cells"):
        ProgramWork(robot, "robot", run, request_with_table)


@pytest.mark.parametrize("kind", KINDS)
def test_a_corrected_program_carries_its_mark_and_nothing_else_differs(kind):
    text = program_text(kind, tool_poses(path(5)), 4)
    plain = unpacked(compensated(kind, text).files[0])
    marked = unpacked(compensated(kind, text, mark=True).files[0])
    lines, more = plain.splitlines(keepends=True), marked.splitlines(keepends=True)
    added = [line for line in more if line not in lines]
    assert [line for line in more if line not in added] == lines
    assert b"Jointstiff run " in added[0]
    assert b"verdict: use" in b"".join(added)
    assert len(added) == (3 if kind == "fanuc" else 1)
    with pytest.raises(ProgramError, match="corrected already"):
        read_program([(PROGRAM_FILES[kind], marked)])
    still = compensated(kind, text, mark=True, load={"force": (0.0, 0.0, 0.0)})
    assert unpacked(still.files[0]) == text.encode()


def test_the_worst_points_are_those_that_bend_most_and_equal_remarks_are_one():
    text = program_text("krl", tool_poses(path(30)), 4).replace("END\r\n", "PTP HOME\r\nPTP HOME\r\nEND\r\n")
    result = compensated("krl", text)
    deflections = [point.deflection for point in result.worst]
    assert deflections == sorted(deflections, reverse=True)
    assert deflections[0] == result.deflection.greatest
    (home,) = [remark for remark in result.remarks if "HOME" in remark]
    assert home.startswith("lines 37, 38: ")


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


DIGITS = "0123456789"


def run(text, place, signs, most=math.inf):
    """Return the end of a run of signs."""
    end = place
    while end < len(text) and text[end] in signs and end - place < most:
        end += 1
    return end


def scan(text, *rules):
    """Return first and last + 1 character of all that a rule finds, from the left, the first rule first."""
    place, spans = 0, []
    while place < len(text):
        end = next((end for rule in rules if (end := rule(text, place))), 0)
        if end:
            spans.append((place, end))
        place = end or place + 1
    return spans


def number(text, place):
    """A sign, digits, a fraction, an exponent; no letter before it, and at least one digit."""
    if text[place] not in "+-." + DIGITS or (place and (text[place - 1].isalnum() or text[place - 1] == "_")):
        return 0
    begin = place + (text[place] in "+-")
    end = run(text, begin, DIGITS, 15)
    point = end < len(text) and text[end] == "."
    if end > begin:
        end = run(text, end + 1, DIGITS, 20) if point else end
    elif not point or (end := run(text, begin + 1, DIGITS, 20)) == begin + 1:
        return 0
    if end < len(text) and text[end] in "eE":
        sign = run(text, end + 1, "+-", 1)
        exponent = run(text, sign, DIGITS, 3)
        end = exponent if exponent > sign else end
    return end


def binary(text, place):
    """KUKA's 'B010'."""
    end = run(text, place + 2, "01", 16)
    return end + 1 if text.startswith("'B", place) and end > place + 2 and text.startswith("'", end) else 0


def line_end(text, place):
    return next((end for end in range(place, len(text)) if text[end] in "\r\n"), len(text))


def remark(text, place):
    return line_end(text, place) if text[place] == "!" else 0


def header(text, place):
    """`%%% VERSION:1 LANGUAGE:ENGLISH %%%` at the begin of a line."""
    if not text.startswith("%%%", place) or (place and text[place - 1] not in "\r\n"):
        return 0
    rest = text[place + 3 :].lstrip()
    while rest.startswith(("VERSION", "LANGUAGE")):
        rest = rest.removeprefix("VERSION") if rest[0] == "V" else rest.removeprefix("LANGUAGE")
        word = rest.lstrip().removeprefix(":").lstrip()
        if not rest.lstrip().startswith(":") or not word or not (word[0].isalnum() or word[0] == "_"):
            return 0
        rest = word[
            next((i for i, sign in enumerate(word) if not (sign.isalnum() or sign == "_")), len(word)) :
        ]
        rest = rest.lstrip()
    return len(text) - len(rest) + 3 if rest.startswith("%%%") else 0


def quoted(text, place):
    end = text.find('"', place + 1)
    return end + 1 if text[place] == '"' and 0 < end < line_end(text, place) else 0


def semicolon(text, place):
    return place + 1 if text[place] == ";" else 0


def position(text, place):
    """A position of /POS, up to the first `};`."""
    end = text.find("};", place + 1)
    return end + 2 if text[place] == "P" and end > 0 else 0


def other(text, place):
    end = text.find("P", place + 1)
    return 0 if text[place].isspace() else end if end > 0 else len(text)


def json_string(text, place):
    """A string of JSON, whether it ends or not, and the colon behind it."""
    if text[place] != '"':
        return 0
    place += 1
    while place < len(text) and text[place] != '"':
        if text[place] == "\\" and place + 1 == len(text):
            return place
        place += 1 + (text[place] == "\\")
    if place == len(text):
        return place
    end = run(text, place + 1, " \t\n\r\f\v")
    return end + text.startswith(":", end)


def texts(*parts):
    return st.lists(st.sampled_from(parts), max_size=14).map("".join)


@pytest.mark.parametrize(
    ("lexicon", "rules"),
    [(krl.LANGUAGE, (number, binary)), *((each.LANGUAGE, (number,)) for each in (rapid, fanuc, ur))],
    ids=["krl", "rapid", "fanuc", "ur"],
)
@examples(1000)
@given(text=texts(*"0179.+-eE' B_a\n", "7E", "1e5", "+E+", "'B01'", "1" * 14, "²", ".5", "e1234"))
def test_numbers(lexicon, rules, text):
    spans = [match.span() for match in lexicon.numbers.finditer(text)]
    assert spans == scan(text, *rules)
    numerals = Numerals.of(text, lexicon.number)
    assert [*zip(numerals.starts.tolist(), numerals.ends.tolist(), strict=True)] == spans
    plain = (text[start:end] for start, end in spans)
    assert numerals.values.tolist() == [int(t[2:-1], 2) if t[0] == "'" else float(t) for t in plain]


@pytest.mark.parametrize(
    ("pattern", "rules", "strategy"),
    [
        (re.compile(rapid.LANGUAGE.comment), (header, remark),
         texts("%%%", "\n", "% ", "VERSION", "LANGUAGE", ":", "1", "E_1", "!", "\r\n", "\n%%%\nVERSION:1")),
        (rapid._ENDS, (quoted, remark, semicolon), texts(*'";!\n\r a', '"a"', '";"', "!;", "x := 1;")),
        (fanuc._POSITION, (position, other), texts(*"P{}; \na", "};", "P[1]{", "GP1: }")),
        (admission._STRING, (json_string,), texts(*'"\\: a\n', '\\"', "\\\\", '"a":', '""', '" :')),
    ],
    ids=["rapid comments", "rapid statements", "fanuc positions", "json strings"],
)  # fmt: skip
def test_patterns(pattern, rules, strategy):
    @examples(1500)
    @given(strategy)
    def split_alike(text):
        spans = [
            match.span()
            for match in pattern.finditer(text.encode() if pattern is admission._STRING else text)
        ]
        assert spans == scan(text, *rules)

    split_alike()


def test_a_comment_with_a_revision_is_no_number():
    text = "DEF a()\n; revision 7E\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0} ; 7E+\nEND\n"
    assert read_program([("a.src", text.encode())]).targets.values[0, :6].tolist() == [1, 2, 3, 0, 0, 0]


def test_no_group_is_possessive():
    """But for one whose text is compared above: nothing in it fails behind its first character and a run."""
    possessive = re.compile(r"(?<!\\)\)(?:[?*+]|\{[\d,]+\})\+")
    found = [
        f"{path.relative_to(folder)}: {line.strip()}"
        for package in (schemas, solver, service)
        for folder in map(Path, package.__path__)
        for path in folder.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if possessive.search(line)
    ]
    assert [line.split(":")[0] for line in found] == ["security/admission.py"]


SHIFT = 4000.0
"""Correction of the first coordinate [mm]: no program of these has such a number."""


def compared(kind: str, seed: int) -> int:
    """Count the moves of a random program that are corrected; each of its runs has to agree."""
    language = LANGUAGES[kind]
    text = language.make(Random(seed))  # noqa: S311
    try:
        program = read_program([(language.name, text.encode())], leave_others=True)
    except ProgramError:
        return 0
    targets, moves = program.targets, program.moves
    values = targets.values[:, :7].copy()
    shift = SHIFT * 1e-3 if kind == "ur" else SHIFT
    values[:, 0] += shift
    again = rewritten(program, np.arange(len(targets)), values)[0][0].decode()
    begins = [0, *moves.ends.tolist()]
    corrected = {
        int(line): moves.visits[a:b].tolist()
        for line, a, b in zip(moves.line, begins, begins[1:], strict=False)
    }

    def frame(index):
        known = targets.frames[index]
        if known.pose is None:
            return known.name
        return round(float(known.pose[0, 3]) * (1 if kind == "ur" else 1e3), 6)

    for run in range(4):
        before, after = runs(language, text, 10 * seed + run), runs(language, again, 10 * seed + run)
        assert [each[0] for each in before] == [each[0] for each in after]
        for (line, old, base, tool), (_, new, *_) in zip(before, after, strict=True):
            if line not in corrected:
                assert old == new, f"line {line} is left, but moves elsewhere\n{text}"
                continue
            own = corrected[line]
            assert new == pytest.approx([x + shift for x in old]), (
                f"line {line} is corrected otherwise\n{text}"
            )
            assert old == pytest.approx(targets.values[own, 0].tolist()), (
                f"line {line} has another target\n{text}"
            )
            for stated, real in ((targets.base[own], base), (targets.tool[own], tool)):
                names = [frame(i) for i in stated.tolist()]
                real = [*real[:-1]] if isinstance(real, tuple) and real[-1] is None else [real] * len(own)
                assert names == pytest.approx(real) if isinstance(names[0], float) else names == real, (
                    f"line {line}: {names}, {real}\n{text}"
                )
    return len(corrected)


@pytest.mark.parametrize("kind", LANGUAGES)
def test_what_is_corrected_is_certain(kind):
    assert sum(compared(kind, seed) for seed in range(40)) > 10


@pytest.mark.slow
@pytest.mark.parametrize("kind", LANGUAGES)
def test_what_is_corrected_is_certain_in_ten_thousand(kind):
    assert sum(compared(kind, seed) for seed in range(40, 2_600)) > 500
