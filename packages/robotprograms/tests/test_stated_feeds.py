"""Feeds of moves: what the program states on every path of execution [mm/s]."""

import numpy as np
import pytest

from robotprograms import read_program

POSE = "{X 1809.6,Y 139.9,Z 1577,A -168.3,B 42.4,C -162.9}"
NONE = np.nan


def feeds(name, text, **stated):
    return read_program([(name, text.encode())], **stated).moves.feed


def krl(*lines, **stated):
    text = "\n".join(["DEF p()", "$BASE=$NULLFRAME", "$TOOL=$NULLFRAME", *lines, "END\n"])
    return feeds("p.src", text.replace("POSE", POSE), **stated)


KRL = {
    "assigned": (["$VEL.CP=0.2", "LIN POSE", "$VEL.CP = 0.02 ; m/s", "LIN POSE"], [200, 20]),
    "not assigned": (["LIN POSE"], [NONE]),
    "by BAS": (["BAS(#VEL_CP,0.2)", "LIN POSE"], [200]),
    "of an inline form": (["FDAT_ACT={TOOL_NO 1,BASE_NO 2}", "BAS(#CP_PARAMS,2)", "LIN POSE"], [2000]),
    "default of the controller": (["$VEL.CP=0.2", "BAS(#INITMOV,0)", "LIN POSE"], [NONE]),
    "in a structure": (["$VEL={CP 0.05,ORI1 200.0}", "LIN POSE"], [50]),
    "in a comment": (["$VEL.CP=0.2", ";$VEL.CP=0.1", "LIN POSE"], [200]),
    "of a variable": (["DECL REAL v", "v=0.3", "$VEL.CP=v", "LIN POSE"], [300]),
    "computed": (["$VEL.CP=0.2", "$VEL.CP=0.1*$OV_PRO", "LIN POSE"], [NONE]),
    "for a move alone": (["$VEL.CP=0.2", "SLIN POSE WITH $VEL.CP=0.1", "LIN POSE"], [100, 200]),
    "for a move, as a structure": (["SLIN POSE WITH $VEL={CP 0.1}"], [100]),
    "for a move, of an inline form": (["SLIN POSE WITH $VEL=SVEL_CP(0.5, , LCPDAT1)"], [500]),
    "of a block of splines": (
        ["$VEL.CP=0.2", "SPLINE WITH $VEL.CP=0.1", "SPL POSE", "ENDSPLINE", "LIN POSE"],
        [100, 200],
    ),
    "of a block without a feed": (["$VEL.CP=0.2", "SPLINE", "SPL POSE", "ENDSPLINE", "LIN POSE"], [200, 200]),
    "moves of the joints": (["$VEL.CP=0.2", "PTP POSE", "LIN POSE"], [NONE, 200]),
    "in a branch": (["$VEL.CP=0.2", "IF $IN[1] THEN", "$VEL.CP=0.1", "ENDIF", "LIN POSE"], [NONE]),
    "in a loop": (["$VEL.CP=0.2", "LOOP", "LIN POSE", "$VEL.CP=0.1", "LIN POSE", "ENDLOOP"], [NONE, 100]),
    "a structure by its name": (["$VEL.CP=0.2", "$VEL=DEF_VEL", "LIN POSE"], [NONE]),
    "an element by its name": (["$VEL.CP=0.2", "$VEL=SPEEDS[2]", "LIN POSE"], [NONE]),
    "another field": (["$VEL.CP=0.2", "$VEL.ORI1=100.0", "LIN POSE"], [200]),
    "a structure by its name, by a routine": (
        ["$VEL.CP=0.2", "fast()", "LIN POSE", "END", "DEF fast()", "$VEL=DEF_VEL"], [NONE],
    ),
    "for a move, by its name": (["$VEL.CP=0.2", "SLIN POSE WITH $VEL=DEF_VEL", "LIN POSE"], [NONE, 200]),
    "for a move, twice": (["SLIN POSE WITH $VEL=DEF_VEL, $VEL.CP=0.1"], [100]),
    "of a block, by its name": (
        ["$VEL.CP=0.2", "SPLINE WITH $VEL=LVEL", "SPL POSE", "ENDSPLINE", "LIN POSE"], [NONE, 200],
    ),
    "read from outside": (["$VEL.CP=0.2", "r=EKI_GETREAL(\"C\",\"V\",$VEL.CP)", "LIN POSE"], [NONE]),
    "zero": (["$VEL.CP=0", "LIN POSE"], [NONE]),
}  # fmt: skip


@pytest.mark.parametrize("case", KRL)
def test_krl(case):
    lines, expected = KRL[case]
    np.testing.assert_allclose(krl(*lines), expected)


def test_a_routine_of_another_file_may_change_the_active_feed():
    lines = ["$VEL.CP=0.2", "LIN POSE", "TOOL_ON()", "LIN POSE", "$VEL.CP=0.1", "LIN POSE"]
    np.testing.assert_allclose(krl(*lines, leave_alone=["TOOL_ON"]), [200, 200, 100])
    np.testing.assert_allclose(krl(*lines, leave_others=True), [200])


def test_a_routine_of_the_program_sets_the_feed_of_moves_behind_its_call():
    np.testing.assert_allclose(krl("slow()", "LIN POSE", "END", "DEF slow()", "$VEL.CP=0.01"), [10])


TARGET = "[[1500,0,900],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
RAPID = {
    "data of the controller": ("", f"MoveL {TARGET},v200,fine,tool0;", [200]),
    "without a number": ("", f"MoveL {TARGET},vmax,fine,tool0;", [NONE]),
    "constant": ("CONST speeddata vCut:=[30,500,5000,1000];", f"MoveL {TARGET},vCut,z1,tool0;", [30]),
    "own data of a controller's name": (
        "CONST speeddata v50:=[33,500,5000,1000];", f"MoveL {TARGET},v50,z1,tool0;", [33],
    ),
    "variable, which keeps its value until the next call": (
        "VAR speeddata vCut:=[30,500,5000,1000];",
        f"MoveL {TARGET},vCut,z1,tool0;vCut:=[40,500,5000,1000];MoveL {TARGET},vCut,z1,tool0;",
        [NONE, 40],
    ),
    "variable that changes": (
        "VAR speeddata vCut:=[30,500,5000,1000];", f"vCut.v_tcp:=reg1;MoveL {TARGET},vCut,z1,tool0;", [NONE],
    ),
    "in numbers": ("", f"MoveL {TARGET},[25,500,5000,1000],z1,tool0;", [25]),
    "argument V": ("", f"MoveL {TARGET},v200\\V:=12,z1,tool0;", [12]),
    "argument T": ("", f"MoveL {TARGET},v200\\T:=12,z1,tool0;", [NONE]),
    "moves of the joints": ("", f"MoveJ {TARGET},v200,z1,tool0;MoveL {TARGET},v100,z1,tool0;", [NONE, 100]),
    "arcs": ("", f"MoveC {TARGET},{TARGET},v100,z1,tool0;", [100]),
    "welds, whose speed is that of the welddata": (
        "",
        f"ArcLStart {TARGET},v15,seam1,weld1,z1,tool0;ArcL {TARGET},v15,seam1,weld1,z1,tool0;"
        f"ArcLEnd {TARGET},v15,seam1,weld1,z1,tool0;ArcL\\On,{TARGET},v15,seam1,weld1,z1,tool0;",
        [15, NONE, NONE, 15],
    ),
    "a way to a weld": ("", f"ArcMoveL {TARGET},v15,z1,tool0;", [15]),
    "a percentage of all speeds": (
        "", f"VelSet 50,800;MoveL {TARGET},v200,z1,tool0;MoveL {TARGET},v200\\V:=12,z1,tool0;", [100, 6],
    ),
    "a greatest speed": (
        "", f"VelSet 50, 80;MoveL {TARGET},v200,z1,tool0;MoveL {TARGET},vmax,z1,tool0;", [80, NONE],
    ),
    "a speed that is set again": (
        "",
        f"VelSet 100,5000;MoveL {TARGET},v200,z1,tool0;VelSet 10,5000;MoveL {TARGET},v200,z1,tool0;",
        [200, 20],
    ),
    "a percentage that is computed": ("", f"VelSet p,800;MoveL {TARGET},v200,z1,tool0;", [NONE]),
    "a greatest speed that is computed": (
        "", f"VelSet 50,MaxRobSpeed();MoveL {TARGET},v200,z1,tool0;", [NONE],
    ),
    "a percentage in a branch": ("", f"IF a THEN;VelSet 50,800;ENDIF;MoveL {TARGET},v200,z1,tool0;", [NONE]),
    # At the first pass the controller's default counts, later the setting of the pass before.
    "a percentage behind the move": ("", f"MoveL {TARGET},v200,z1,tool0;VelSet 50,800;", [NONE]),
    "a percentage by a routine": (
        "PROC slow()\nVelSet 50,800;\nENDPROC", f"slow;MoveL {TARGET},v200,z1,tool0;", [100],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", RAPID)
def test_rapid(case):
    declared, body, expected = RAPID[case]
    text = f"MODULE m\n{declared}\nPROC main()\n{body.replace(';', ';' + chr(10))}ENDPROC\nENDMODULE\n"
    np.testing.assert_allclose(feeds("p.mod", text), expected)


FANUC = {
    "L P[1] 50mm/sec FINE": 50,
    "L P[1] 300cm/min CNT50": 50,
    "L P[1] 60.0inch/min CNT50": 25.4,
    "L P[1] 50deg/sec FINE": NONE,
    "L P[1] 3sec FINE": NONE,
    "L P[1] R[3]mm/sec FINE": NONE,
    "J P[1] 50% FINE": NONE,
}


@pytest.mark.parametrize("move", FANUC)
def test_fanuc(move):
    text = (
        f"/PROG P\n/MN\n   1:{move}    ;\n/POS\nP[1]{{\n"
        "   GP1:\n\tUF : 0, UT : 1,\tCONFIG : 'N U T, 0, 0, 0',\n"
        "\tX =  1500.000  mm,\tY = 0.000  mm,\tZ = 900.000  mm,\n"
        "\tW =  180.000 deg,\tP = 0.000 deg,\tR = 0.000 deg\n};\n/END\n"
    )
    np.testing.assert_allclose(feeds("p.ls", text), [FANUC[move]])


UR = {
    "movel(p[0.5,0,0.4,0,3.1,0], a=1.2, v=0.05)": 50,
    "movel(p[0.5,0,0.4,0,3.1,0], 1.2, 0.05)": 50,
    "movel(p[0.5,0,0.4,0,3.1,0], 1.2, 0.05, 0, 0.01)": 50,
    "movel(p[0.5,0,0.4,0,3.1,0], 1.2, 0.05, 3, 0.01)": NONE,
    "movep(p[0.5,0,0.4,0,3.1,0], a=1.2, v=0.05, r=0.01)": 50,
    "movec(p[0.5,0,0.4,0,3.1,0], p[0.6,0,0.4,0,3.1,0], a=1.2, v=0.05)": 50,
    "movel(p[0.5,0,0.4,0,3.1,0])": NONE,
    "movel(p[0.5,0,0.4,0,3.1,0], a=1.2, v=slow)": 30,
    "movel(p[0.5,0,0.4,0,3.1,0], a=1.2, v=2*slow)": NONE,
    "movej([0.5,0,0.4,0,3.1,0], a=1.2, v=0.05)": NONE,
}


@pytest.mark.parametrize("move", UR)
def test_urscript(move):
    np.testing.assert_allclose(feeds("p.script", f"def p():\n  slow=0.03\n  {move}\nend\n"), [UR[move]])


def test_many_moves_of_one_form_have_their_own_feeds():
    lines = [f"  movel(p[0.5,0,{0.4 + 0.001 * i},0,3.1,0], a=1.2, v={0.01 * (i + 1):.2f})" for i in range(50)]
    text = "\n".join(["def p():", *lines, "end\n"])
    np.testing.assert_allclose(feeds("p.script", text), 10 * np.arange(1, 51))


def test_a_table_states_no_feed():
    assert np.isnan(feeds("p.csv", "x [mm],y [mm],z [mm]\n1,2,3\n4,5,6\n")).all()
