# ruff: noqa: E501  # one construct a line
"""What is not understood does not act: constructs in each language, and every motion word accounted for."""

import random
import re
from collections import Counter
from itertools import product

import pytest
from support.examples import is_full

from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.programs.formats import read_program

POINT = "{X 1,Y 2,Z 3,A 0,B 0,C 0}"
FREE = "[9E9,9E9,9E9,9E9,9E9,9E9]"
ROB = f"[[1,2,3],[1,0,0,0],[0,0,0,0],{FREE}]"
P = "p[0.1,0.2,0.3,0,0,0]"
Q = "[0.1,0.2,0.3,0.4,0.5,0.6]"
TOOL = "[TRUE,[[0,0,9],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]]"


def krl(*lines):
    head = ["DEF a()", "$TOOL=TOOL_DATA[1]", "$BASE=BASE_DATA[1]", f"P1={POINT}"]
    return "a.src", "\n".join([*head, f"LIN {POINT}", *lines, f"LIN {POINT}", "LIN P1", "END"])


def rapid(*lines, head="", more=""):
    first = [
        "MODULE M",
        f"CONST robtarget p10:={ROB};",
        f"PERS robtarget p20:={ROB};",
        f"PERS tooldata t1:={TOOL};",
    ]
    body = [*first, head, "VAR num n:=1;", "PROC main()", f"MoveL {ROB},v1,z1,t1;", *lines]
    return "a.mod", "\n".join(
        [*body, "MoveL p20,v1,z1,t1;", "MoveL p10,v1,z1,t1;", "ENDPROC", more, "ENDMODULE"]
    )


def ls(*lines, positions="", groups=""):
    position = (
        "P[{}]{{\n   GP1:\n\tUF : 1, UT : 1,\tCONFIG : 'N U T, 0, 0, 0',\n\tX = 1.0 mm,\tY = 2.0 mm,\tZ = "
        "3.0 mm,\n"
        "\tW = 0.0 deg,\tP = 0.0 deg,\tR = 0.0 deg\n}};"
    )
    body = ["UFRAME_NUM=1", "UTOOL_NUM=1", "L P[1] 50mm/sec FINE", *lines, "L P[2] 50mm/sec CNT100"]
    numbered = [
        f"{i + 1:4d}:{'' if line[:2] in {'L ', 'J ', 'C '} else '  '}{line} ;" for i, line in enumerate(body)
    ]
    places = [position.format(i) for i in (1, 2, 3)]
    return "a.LS", "\n".join(["/PROG A", "/ATTR", "/MN", *numbered, "/POS", *places, positions, "/END", ""])


def ur(*lines, more=""):
    head = ["def a():", f"  p1 = {P}", f"  set_tcp({P})", f"  movel({P}, a=1, v=0.1)"]
    return "a.script", "\n".join([*head, *("  " + line for line in lines), "  movel(p1, a=1)", "end", more])


PLAIN = [krl(), rapid(), ls(), ur()]

KRL = [
    # D.1, H.2
    f"LIN {POINT} LIN {POINT}",
    f"IF $IN[1] THEN LIN {POINT}",
    f"ELSE LIN {POINT}",
    f"CASE 1 LIN {POINT}",
    f"LOOP LIN {POINT}",
    "N=f()",
    "N=1+f(2)",
    "f()",
    "f(P1)",
    "P1.X=5",
    "P1=P2",
    f"P1={POINT}",
    "P1.Z=P1.Z+1",
    "P1[1]=2",
    # moves to what is no number
    *(f"{word} P9" for word in ("LIN", "PTP", "SLIN", "SPTP", "SPL")),
    *(f"{word} P1:{POINT}" for word in ("LIN", "PTP", "SLIN")),
    *(f"{word}_REL {{X 1}}" for word in ("LIN", "PTP", "CIRC", "SLIN", "SPTP", "SCIRC", "SPL")),
    f"CIRC {POINT}",
    f"CIRC {POINT},P9",
    f"CIRC {POINT},{POINT},CA 90",
    f"CIRC {POINT},{POINT},{POINT}",
    "LIN {X 1}",
    "LIN {Z 1,C 2}",
    "PTP {A1 5}",
    f"LIN {POINT[:-1]},Q 5}} x",
    f"LIN {POINT} C_FOO",
    f"LIN {POINT} 5",
    f"LIN {POINT},{POINT}",
    f"LIN INV_POS({POINT})",
    "LIN P1:P1",
    "LIN P1[2]",
    "LIN P1.X",
    "LIN $POS_INT",
    "PTP f(1)",
    "PTP $POS_FOR",
    f"ASYPTP {POINT}",
    "ASYPTP {E1 5}",
    "ASYCONT",
    # frames and tools
    "$BASE.X=5",
    "$TOOL.Z=5",
    "$BASE=f()",
    f"$BASE=BASE_DATA[1]:{POINT}",
    "$BASE=BASE_DATA[i]",
    "$TOOL=TOOL_DATA[n]",
    f"$BASE={POINT}:{POINT}",
    "$BASE={X 1}",
    "BASE_DATA[i]={X 1,Y 2,Z 3,A 0,B 0,C 0}",
    "BASE_DATA[1]={X 1,Y 2,Z 3,A 0,B 0,C 0}",
    "BASE_DATA[1].X=5",
    "TOOL_DATA[1].Z=5",
    "TOOL_DATA[1]=TOOL_DATA[2]",
    "$ACT_BASE=2",
    "$ACT_TOOL=2",
    "$IPO_MODE=#TCP",
    "$IPO_MODE=x",
    "$ROBROOT={X 1,Y 0,Z 0,A 0,B 0,C 0}",
    "$WORLD={X 1,Y 0,Z 0,A 0,B 0,C 0}",
    "$NULLFRAME={X 1,Y 0,Z 0,A 0,B 0,C 0}",
    "$ERSYSROOT={X 1,Y 0,Z 0,A 0,B 0,C 0}",
    "$POS_ACT={X 1,Y 0,Z 0,A 0,B 0,C 0}",
    "$SOFTN_END[1]=5",
    "$SEN_PREA[1]=5",
    "$TECH[1].MODE=#CYCLE",
    "$ASYNC_AXIS=1",
    "$EXT_AXIS=1",
    "FDAT_ACT={TOOL_NO 2,BASE_NO i}\nBAS(#FRAMES)",
    "FDAT_ACT.BASE_NO=2\nBAS(#FRAMES)",
    "FDAT_ACT={TOOL_NO 1,BASE_NO 1,IPO_FRAME #TCP}\nBAS(#FRAMES)",
    f"FDAT_ACT=FP9\nBAS(#FRAMES)\nLIN {POINT}",
    "BAS(#PTP_PARAMS,100)",
    "FDAT_ACT={TOOL_NO 1,BASE_NO 2}\nIF x THEN\nBAS(#CP_PARAMS,1)\nENDIF",
    "IF x THEN\nFDAT_ACT={TOOL_NO 1,BASE_NO 2}\nENDIF\nBAS(#FRAMES)",
    "LOOP\nBAS(#FRAMES)\nFDAT_ACT={TOOL_NO 1,BASE_NO 2}\nENDLOOP",
    f"BAS(#TOOL,5)\nTOOL_DATA[5]={POINT}\nLIN {POINT}",
    f"BAS(#TOOL,5)\nLOOP\nTOOL_DATA[5]={POINT}\nLIN {POINT}\nENDLOOP",
    "BAS(#TOOL,n)",
    "BAS(#BASE,n)",
    "BAS(#EX_BASE,2)",
    "BAS(#FRAMES)",
    "BAS(n,2)",
    f"SLIN {POINT} WITH $TOOL = STOOL2(FP9), $BASE = SBASE(FP9.BASE_NO)",
    f"SLIN {POINT} WITH $BASE = {POINT}",
    f"SLIN {POINT} WITH $TOOL = f(1)",
    f"SLIN {POINT} WITH $VEL = f(1)",
    f"SPLINE WITH $BASE = {POINT}",
    # routines and what is carried out beside the program
    "INTERRUPT DECL 5 WHEN $IN[1] DO f()",
    "TRIGGER WHEN DISTANCE=0 DELAY=0 DO f()",
    "TRIGGER WHEN DISTANCE=0 DELAY=0 DO P1.X=5",
    "TRIGGER WHEN PATH=5 DELAY=0 DO LIN P1",
    "BRAKE",
    "BRAKE F",
    "RESUME",
    "CWRITE($CMD,a,b)",
    "TOUCHSENSE(1)",
    "ARC_ON(1)",
    "$CMD=1",
    "RUN f",
    "WAIT 5",
    "WAIT FOR f()",
    "IF f() THEN\nENDIF",
    "WHILE f()\nENDWHILE",
    "REPEAT\nUNTIL f()",
    "FOR i=1 TO f()\nENDFOR",
    "SWITCH f()\nENDSWITCH",
    "RETURN f()",
    "FOR P1=1 TO 3\nENDFOR",
    "GOTO L LIN P1",
    "L: LIN P1",
    "HALT LIN P1",
    "EXIT f()",
    "x=1 y=2",
    "x 5",
    "@",
    "x=",
    "=5",
    'x="',
    "x=(1",
    "x=1)",
    "DECL INT i=f()",
    "THIS IS NO STATEMENT",
    "PULSE $OUT[1]",
    "ANIN ON x=1*$ANIN[1]+0",
    *("\n".join([begin, "$BASE=BASE_DATA[2]", end])
      for begin, end in (("LOOP\nIF x THEN\nEXIT\nENDIF", "ENDLOOP"), ("WHILE x", "ENDWHILE"), ("IF x THEN", "ENDIF"),
                         ("FOR i=1 TO 2", "ENDFOR"), ("SWITCH x\nCASE 1", "ENDSWITCH"), ("GOTO L", "L:"))),
    # another session's review
    *(f"{begin}\nP9={POINT}\n{end}\nLIN P9"
      for begin, end in (("IF x THEN", "ENDIF"), ("SWITCH x\nCASE 1", "ENDSWITCH"), ("GOTO L", "L:"))),
    f"IF x THEN\nP9={POINT}\nELSE\nLIN P9\nENDIF",
    f"SWITCH x\nCASE 1\nP9={POINT}\nCASE 2\nLIN P9\nENDSWITCH",
    "INTERRUPT ON 7",
    "INTERRUPT DECL 3 WHEN $IN[2]==FALSE DO $TOOL=TOOL_DATA[2]",
    "TRIGGER WHEN DISTANCE=1 DELAY=-20 DO $BASE=BASE_DATA[2]",
    "WHILE $IN[1]\n$BASE=BASE_DATA[2]\nLIN P1\n$BASE=BASE_DATA[1]\nENDWHILE",
    "SPLINE\nSLIN_REL {Z 5}\nENDSPLINE",
    "PTP_SPLINE WITH $TOOL=TOOL_DATA[2]\nSPTP P1\nENDSPLINE",
    "IF LINMOVE(P1) THEN\nENDIF",
    "N=1+(2*CORRECT(P1))",
    "$VEL.CP=SPEED(P1)",
    "FOR i=1 TO 3\nBASE_DATA[1].Z=i*10\nENDFOR",
    "IF x THEN GOTO M ENDIF",
    f"REPEAT\nP1={POINT}\nUNTIL TRUE",
    "$OUT[1]=MOVE(P1)",
    *("\n".join([begin, "$TOOL=TOOL_DATA[2]", end])
      for begin, end in (("IF x THEN", "ENDIF"), ("GOTO L", "L:"))),
]  # fmt: skip

MISSING = [
    f"MoveL p10,v1,z1,t1\nMoveL {ROB},v1,z1,t1;",
    "n:=1\nMoveL p10,v1,z1,t1;",
    "n:=n\nsub2;",
    "WaitTime 1\nMoveL p10,v1,z1,t1;",
]
RAPID = [
    *MISSING,
    # H.2
    *(f"{word} {what};" for word in ("Incr", "Decr", "Clear") for what in ("p20.trans.x", "t1.tframe.trans.z", "p10.trans.y")),
    *(f"Add {what},1;" for what in ("p20.trans.x", "p20.extax.eax_a", "t1.tload.mass", "p10.rot.q1")),
    *(f"{what};" for what in ("p20.trans.x:=5", "p20:=Offs(p10,1,2,3)", "p20:=p10", "p20.rot:=OrientZYX(1,2,3)", f"p20:={ROB}")),
    *(f"{what};" for what in ("t1.tframe.trans.z:=5", "t1:=t2", "t1.robhold:=FALSE", "t1.tframe:=[[0,0,1],[1,0,0,0]]", f"t1:={TOOL}")),
    '%"sub"%;',
    "%s%;",
    '%"sub"+n% p20;',
    "IF n=1 sub;",
    "IF n=1 MoveL p10,v1,z1,t1;",
    "IF n=1 p20.trans.x:=5;",
    "IF n=1 GOTO l;",
    "n:=f(1);",
    "n:=1+f(2)*3;",
    "n:=f(p20);",
    "sub;",
    "sub p20;",
    "sub p20,n;",
    "sub \\x:=p20;",
    "MoveLSync p10,v1,z1,t1,\"sub\";",
    # moves to what is no number
    *(f"{word} {target},v1,z1,t1;" for word, target in product(
        ("MoveL", "MoveJ"), ("Offs(p10,0,0,1)", "RelTool(p10,0,0,1)", "p99", "p10{2}", "CRobT()", "*", "f(p10)", "p10.trans"))),
    "MoveC p10,Offs(p10,1,1,1),v1,z1,t1;",
    "MoveC p10,v1,z1,t1;",
    "MoveAbsJ j9,v1,z1,t1;",
    "MoveExtJ j9,v1,z1;",
    "MoveL p10,v1,z1;",
    "MoveL p10,v1;",
    "MoveL p10;",
    "MoveL;",
    "MoveL p10,v1,z1,t1,t1;",
    "MoveL p10,v1,z1,t1\\Corr;",
    "MoveL p10,v1,z1,t1\\Foo;",
    "MoveL p10,v1,z1,t1\\WObj:=f(1);",
    "MoveL p10,v1,z1,f(1);",
    "MoveL p10,v1,z1,t1 x;",
    "MoveL \\Track,p10,v1,z1,t1;",
    *(f"{word} p10,v1,z1,t1;" for word in (
        "ArcL", "ArcC", "ArcLStart", "ArcLEnd", "SpotL", "SpotJ", "PaintL", "DispL", "CapL", "NutL", "GlueL", "SearchL",
        "FCPressL", "IndAMove", "SoftAct", "MoveX", "TriggFoo", "SMoveJ", "StepBwdPath", "CalibL", "LaserL")),
    *(f"{word};" for word in (
        "PDispOn p10,p20,t1", "PDispSet x", "PDispOff", "EOffsOn", "EOffsSet x", "EOffsOff", "SoftAct 1,2", "CorrCon c",
        "CorrWrite c,x", "WaitWObj w", "DropWObj w", "IndReset s,1", "FCAct 1", "WorldAccLim", "SyncMoveOn s,t",
        "SyncMoveOff s", "StartMove", "StopMove", "ClearPath", "StorePath", "RestoPath", "StartMoveRetry", "MToolTCPCalib a",
        "ConfFoo\\On", "UnLoad x", "Load \\Dynamic,x", "CallByVar s,1", "SetSysData t9", "TuneServo a,b,1", "SpeedRefresh 5",
        "SetAllDataVal x", "SetDataVal s,x", "ReadRawBytes", "LoadId x", "EGMRunPose a")),
    # layouts
    "IF n=1 THEN MoveL p99,v1,z1,t1; ENDIF",
    "FOR i FROM 1 TO 3 DO p20.trans.x:=1; ENDFOR",
    "FOR p20 FROM 1 TO 3 DO ENDFOR",
    "WHILE f() DO ENDWHILE",
    "IF f() THEN ENDIF",
    "TEST f() CASE 1: DEFAULT: ENDTEST",
    "TEST n CASE f(): ENDTEST",
    "FOR i FROM 1 TO f() DO ENDFOR",
    "RETURN f();",
    "CASE 1 MoveL p10,v1,z1,t1;",
    "l: sub;",
    "ERROR sub;",
    "@;",
    "n:=;",
    ":=5;",
    'n:=";',
    "n:=(1;",
    "n:=1 2 x;",
    "CONNECT i1 WITH;",
    "CONNECT i1 WITH Foo;",
    "VAR num m:=f();",
    "\n".join(["WHILE TRUE DO", f"t1:={TOOL};", "ENDWHILE"]),
    "\n".join(["l:", f"t1:={TOOL};", "GOTO l;"]),
]  # fmt: skip

FANUC = [
    # D.2, H.2
    "L P[3] 50mm/sec FINE RTCP",
    "L P[3] 50mm/sec CNT100 RTCP ACC80",
    "C P[3]",
    # targets
    *(f"{letter} {target} 50mm/sec FINE" for letter, target in product(
        "LJ", ("PR[1]", "P[R[1]]", "P[9]", "PR[R[2]]", "P[AR[1]]", "PR[GP1:1]"))),
    *(f"L P[3] 50mm/sec FINE {option}" for option in (
        "INC", "Offset", "Offset,PR[1]", "OFFSET,PR[1]", "Tool_Offset,PR[1]", "Skip,LBL[1]", "Skip,LBL[1],PR[1]=LPOS",
        "Weave Sine[1]", "TRACK TAST[1]", "COORD", "COORD[1]", "PSPI", "VOFFSET,VR[1]", "Touch", "Search[X]", "FIND",
        "Quick Stop", "ACC", "FOO", "L P[2] 5mm/sec FINE", "RT_LD", "CALL X", "TB .1sec,CALL X", "TA .1sec,CALL X(1)",
        "DB 10mm,CALL X", "DB 10mm,P[1]=P[2]", "DB 10mm,UFRAME_NUM=2", "TB .1sec,PR[1]=LPOS,X", "MINACC", "CTV 5", "EXT")),
    "L P[3] x",
    "L P[3] 50mm/hour FINE",
    "L P[3],P[2] 50mm/sec FINE",
    "P[3] 50mm/sec FINE",
    "W P[3] 50mm/sec FINE",
    "L",
    # positions and frames
    *(f"{what}={value}" for what, value in product(("P[1]", "P[1,3]", "P[R[1]]"), ("PR[1]", "LPOS", "P[2]", "P[2]+PR[1]", "5"))),
    *(f"{what}={value}" for what, value in product(("UFRAME[1]", "UTOOL[1]"), ("PR[1]", "LPOS"))),
    *(f"{what}={value}" for what, value in product(("UFRAME_NUM", "UTOOL_NUM"), ("R[1]", "GI[1]", "(2)", "1+1", "AR[1]", "2,3"))),
    "UFRAME_NUM=2",
    "UTOOL_NUM=2",
    "UFRAME_NUM[GP1]=2",
    "$MNUFRAME[1,1]=PR[1]",
    "$MNUFRAMENUM[1]=R[1]",
    "$GROUP[1].$UFRAME=PR[1]",
    "$SHELL_CFG.$JOB_BASE=1",
    "$MCR_GRP[1].$PRGOVERRIDE=5",
    "IF (DI[1]),UFRAME_NUM=(2)",
    "IF DI[1]=ON,UTOOL_NUM=2",
    "IF R[1]=1,P[1]=P[2]",
    "IF R[1]=1,CALL X",
    "IF R[1]=1,L P[3] 50mm/sec FINE",
    "SELECT R[1]=1,CALL X",
    "ELSE,CALL X",
    "IF f(1)=1,JMP LBL[1]",
    # other instructions
    *("CALL X", "CALL X(1,2)", "RUN X", "CALL SR[1]", "MONITOR X", "OFFSET CONDITION PR[1]", "OFFSET CONDITION PR[1],UFRAME[2]",
      "TOOL_OFFSET CONDITION PR[1]", "SKIP CONDITION DI[1]=ON", "VOFFSET CONDITION VR[1]", "LOCK PREG", "UNLOCK PREG",
      "FORCE CTRL[1]", "TOUCH", "TRACK", "DEFENC 1", "SETTRIG LNSCH[1]", "LINE[1]", "STOP TRACKING", "TRACK DPM[1]",
      "VISION RUN_FIND 'X'", "VISION GET_OFFSET 'X' VR[1]", "CALIBRATE", "PLI", "SOFTFLOAT[1]", "SOFTFLOAT END", "FOLLOW UP",
      "Search Start[1] PR[1]", "Search End", "Touch Offset PR[1]", "Weave Sine[1]", "Weave End", "GET_HOME", "Independent GP",
      "Simultaneous GP", "PAYLOAD", "RESUME_PROG[1]=X", "ERROR_PROG=X", "RETURN_PATH_DSBL", "MAINT_PROG[1]=X", "ROBOT READY",
      "MIRROR PR[1]", "TORQ_LIMIT 50.0%", "ISTABLE", "UNKNOWN", "@", "R[1]=", "R[1]=1 2 R[3]", "R[1", "=5", "R[1]=(1"),
    "\n:  P[3] 50mm/sec FINE",
    *(f"{begin} ;\n  90:  UFRAME_NUM=2 ;\n  91:  {end}" for begin, end in (
        ("FOR R[1]=1 TO 3", "ENDFOR"), ("IF (R[1]=1) THEN", "ENDIF"), ("LBL[1]", "JMP LBL[1]"), ("JMP LBL[1]", "LBL[1]"))),
]  # fmt: skip

UR = [
    # D.1, H.2
    f"movel({P}) movel(p9)",
    f"movel({P}) x",
    f"movel({P}) + 1",
    f"movel({P}).x",
    f"while True:\n    set_tcp(p[0,0,1,0,0,0])\n    movel({P})\n  end",
    f"if x:\n    set_tcp(p[0,0,1,0,0,0])\n  end\n  movel({P})",
    # targets
    *(f"{word}({target}, a=1)" for word, target in product(("movej", "movel", "movep"), (
        "p9", "f(1)", f"pose_add(p1, {P})", f"pose_sub(p1, {P})", "pose_inv(p1)", "get_actual_tcp_pose()", "p[x,0,0,0,0,0]",
        "p[1,2,3]", "[d2r(1),0,0,0,0,0]", f"pose_trans(p9, {P})", f"pose_trans(f(1), {P})", "p1 + 1", "list[1]",
        "get_forward_kin()", f"interpolate_pose({P}, p1, 0.5)"))),
    f"movec({P}, p9)",
    f"movec({P})",
    "movel()",
    "movel",
    f"movel({P}",
    f"movel {P}",
    f"movel({P}, f(1))",
    f"movel({P}, v=f(1))",
    f"movel({P}, q=1)" + " movel(",
    f"x = movel({P})",
    f"foo(movel({P}))",
    f"if movel({P}):\n  end",
    f"return movel({P})",
    f"sleep(movel({P}))",
    "p1 = f(1)",
    "p1 = p2",
    "p1[2] = 5",
    f"p1 = {P}",
    "global p1 = pose_add(p1, p1)",
    "p1.x = 5",
    # tool
    *(f"set_tcp({what})" for what in ("x", "f(1)", "p[x,0,0,0,0,0]", "[0,0,1,0,0,0]", "pose_add(p1,p1)", "get_tcp_offset()", "")),
    f"foo(set_tcp({P}))",
    f"x = set_tcp({P})",
    # what moves by itself
    *(f"{word}({Q})" for word in (
        "servoj", "servoc", "servol", "speedj", "speedl", "force_mode", "freedrive_mode", "teach_mode", "tool_contact",
        "optimovej", "optimovel", "track_conveyor_linear", "track_conveyor_circular", "path_offset_enable",
        "path_offset_set", "screw_driving", "move_until_contact", "reset_revolution_counter", "set_pos")),
    # calls
    *(f"{word}(1)" for word in (
        "foo", "Movel", "MOVEL", "movel2", "rg_grip", "load_program", "run_program", "request_boolean", "rq_move", "socket",
        "conveyor_pulse_decode", "encoder_enable", "set_tool", "set_base", "set_frame", "exec", "eval")),
    *(f"x = {word}(1)" for word in ("foo", "rq_pos", "compute")),
    "x = 1 + foo(2)",
    "x = proxy.move(1)",
    "proxy.move(1)",
    "x = [foo(1), 2]",
    "if foo():\n  end",
    "while foo():\n  end",
    "return foo(1)",
    "textmsg(foo(1))",
    # layouts
    "x = 1 y",
    "x = y foo",
    "x = y movel(p1)",
    "if x: movel(p9)\n  end",
    "else movel(p1)",
    "if x movel(p1)",
    "x ==",
    "= 5",
    "@",
    'x = "',
    "x = (1",
    "x = 'a' movel(p1)",
    "x; movel(p1)",
    "goto 5",
    "import x",
    f"thread t():\n    movel({P})\n  end",
    f"thread t():\n    set_tcp({P})\n  end",
    "$ 3 movel(p1)",
    "def b(p1):\n    movel(p1)\n  end",
    "while True:\n    p1 = get_actual_tcp_pose()\n  end",
    "for i in x:\n  end",
    "global",
    "local movel(p1)",
    f"global movel({P})",
    "run foo()",
    "x = run foo()",
    "kill",
]  # fmt: skip
WOBJ = '[FALSE,TRUE,"",[[1,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]]'
UR += [
    f"if x:\n    p9 = {P}\n  end\n  movel(p9)",
    f"if x:\n    p9 = {P}\n  else:\n    movel(p9)\n  end",
    f"if x:\n    ref = {P}\n  end\n  movel(pose_trans(ref, {P}))",
    f"while True:\n    movel(p9)\n    p9 = {P}\n  end",
    "def b(x=foo(1)):\n    movel(p1)\n  end",
    "def b(x=movel(p9)):\n    movel(p1)\n  end",
    "sec b():\n    movel(p9)\n  end",
    "thread t():\n    while True:\n      p1[0] = 5\n    end\n  end\n  run t()",
    "switch x:\n    case 1:\n      set_tcp(p[0,0,1,0,0,0])\n  end",
    f"movec({P}, pose_trans(p9, {P}))",
    f"movej(get_inverse_kin({P}, foo()))",
    "x = y[foo(1)]",
    "p1[foo(1)] = 2",
    "x = struct(a=foo())",
    "sync() movel(p9)",
    f"set_tcp({P}) movel(p9)",
    "zero_ftsensor(), servoj(q)",
]
FANUC += [
    "L P[3] 50mm/sec FINE L P[1] 50mm/sec FINE",
    "L P[3] 50mm/sec FINE ; L P[9] 50mm/sec FINE",
    *(f"L P[3] 50mm/sec FINE\n    :  {option}" for option in ("INC", "Tool_Offset,PR[1]", "RTCP")),
    "J P[3] 50% FINE Ind.EV50%",
    "L P[3] 50mm/sec FINE LOGIC[1]",
    "C P[3] \n    :  PR[1] 50mm/sec FINE",
    "A PR[1] 50mm/sec FINE",
    "S P[R[2]] 50mm/sec FINE",
    "SELECT R[1]=1,UFRAME_NUM=2",
    "$UFRAME_NUM=2",
    "WAIT DI[1]=ON,CALL X",
    "PR[1]=P[3] ;\n  90:L PR[1] 50mm/sec FINE",
    "FOR R[1]=1 TO 3 ;\n  90:  PR[1,3]=R[1] ;\n  91:  L P[3] 50mm/sec FINE Offset,PR[1] ;\n  92:  ENDFOR",
]


def other_group(fields, frame=1, group="GP1"):
    return (
        f"P[4]{{\n   {group}:\n\tUF : {frame}, UT : 1,\tCONFIG : 'N U T, 0, 0, 0',\n\tX = 1.0 mm,\tY = 2.0 mm,\tZ = 3.0 mm,\n"
        f"\tW = 0.0 deg,\tP = 0.0 deg,\tR = 0.0 deg{fields}\n}};"
    )


WHOLE = [
    *((rapid(f"sub2 {given};", head=f"PERS wobjdata w1:={WOBJ};", more=f"PROC sub2({parameters})\n{body}\nENDPROC"), "rapid")
      for given, parameters, body in (
        ("t9", "PERS tooldata t1", "MoveL p10,v1,z1,t1;"),
        ("w9", "PERS wobjdata w1", "MoveL p10,v1,z1,t1\\WObj:=w1;"),
        ("t1", "INOUT tooldata t", "t.tframe.trans.z:=5;"),
        ("p20", "INOUT robtarget p", "p.trans.z:=5;"),
        ("p10", "robtarget p", "MoveL p,v1,z1,t1;"),
        ("n", "num x", f"t1:={TOOL};"))),
    *((rapid("CONNECT i1 WITH tr;", head="VAR intnum i1;", more=f"TRAP tr\n{body}\nENDTRAP"), "rapid")
      for body in (f"t1:={TOOL};", "p20.trans.z:=p20.trans.z+5;", "sub9;")),
    *((rapid(line), "rapid") for line in (
        "MoveL p10,v1,z1,t1\\WObj:=w{2};", "MoveL p10,v1,z1,tools{1};", "TriggC p10,p99,v1,g1,z1,t1;", "GripLoad f(1);",
        "SearchL\\Stop,di1,p10,p20,v1,t1;", "StoreTarget p20;", "WaitUntil moved(p20);", "MoveL p20\\ID:=f(2),v1,z1,t1;",
        "VAR tooldata t5:=[TRUE,[[0,0,1],[1,0,0,0]],f(1)];", "MoveJ\\Conc,*,v1,z1,t1;", "n:=CalcRobT([1,2,3],t1);")),
    *((ls("L P[4] 50mm/sec FINE", positions=other_group(*position)), "fanuc") for position in (
        ("\n   GP2:\n\tUF : 1, UT : 1,\n\tJ1= 5.000 deg",), ("", 2), ("", 1, "GP2"), (",\tE1 = 5.0 mm",))),
    *((ur("b()", more=f"def b():\n  {body}\nend"), "ur")
      for body in (f"global p1\n  p1 = {P}", "p1[2] = 5", "servoj(q)")),
    *((ur("thread t():\n    b()\n  end\n  run t()", more=f"def b():\n  {body}\nend"), "ur")
      for body in (f"p1 = {P}", "set_tcp(p[0,0,1,0,0,0])")),
    *((("a.src", f"DEF a()\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\nP1={POINT}\n{call}\nLIN P1\nEND\nDEF b()\n{body}\nEND"), "krl")
      for call, body in (
        ("b()", "P1.Z=5"),
        ("INTERRUPT DECL 5 WHEN $IN[1] DO b()\nINTERRUPT ON 5", "$BASE=BASE_DATA[2]"))),
    *((("a.csv", f"x [mm],y [mm],z [mm],a [deg],b [deg],c [deg],{more}\n1,2,3,0,0,0,{first}\n1,2,4,0,0,0,{second}\n"), "csv")
      for more, first, second in (
        ("tool", "1", "2"), ("base", "A", "B"), ("UF", "1", "2"), ("e1 [mm]", "1", "2"), ("x [mm]", "1", "2"),
        ("j1,j2,j3,j4,j5,j6", "1,2,3,4,5,6", "1,2,3,4,5,6"))),
]  # fmt: skip
HOSTILE = [
    *WHOLE,
    *((krl(line), "krl") for line in KRL),
    *((rapid(line), "rapid") for line in RAPID),
    *((ls(line), "fanuc") for line in FANUC),
    *((ur(line), "ur") for line in UR),
]


def test_the_frame_of_each_construct_is_understood():
    for name, text in PLAIN:
        assert len(read_program([(name, text.encode())]).moves) >= 2


def is_refused_by_line(name, text):
    """Tell whether a program is refused, each fault with its line and a remedy."""
    try:
        read_program([(name, text.encode())])
    except ProgramError as error:
        return all(fault.line and fault.remedy for fault in error.faults)
    return False


@pytest.mark.parametrize(
    ("kind", "least"), [("krl", 101), ("rapid", 101), ("fanuc", 101), ("ur", 101), ("csv", 6)]
)
def test_constructs_that_may_act_are_refused_by_line(kind, least):
    programs = {program for program, each in HOSTILE if each == kind}
    assert len(programs) >= least
    assert [text for name, text in programs if not is_refused_by_line(name, text)] == []


LAYOUTS = [
    f"IF n=1 THEN MoveL {ROB},v1,z1,t1; ELSE MoveL {ROB},v1,z1,t1; ENDIF",
    f"IF n=1 THEN\nMoveL {ROB},v1,z1,t1;\nELSEIF n=2 THEN MoveL {ROB},v1,z1,t1;\nENDIF MoveL {ROB},v1,z1,t1;",
    f"FOR i FROM 1 TO 3 DO MoveL {ROB},v1,z1,t1; MoveL {ROB},v1,z1,t1; ENDFOR",
    f"FOR i\nFROM 1 TO 3\nSTEP 2 DO MoveL\n{ROB},\nv1,z1,t1\n; ENDFOR",
    f"TEST n\nCASE 1: MoveL {ROB},v1,z1,t1;\nCASE 2,3: MoveJ {ROB},v1,z1,t1;\nDEFAULT: MoveL {ROB},v1,z1,t1;\nENDTEST",
    f"WHILE n < 3 DO MoveL {ROB},v1,z1,t1; n := n + 1; ENDWHILE",
    f"l: MoveL {ROB},v1,z1,t1;",
    f"MoveL {ROB},v1,z1,t1;MoveL {ROB},v1,z1,t1; ! MoveL p9,v1,z1,t1;",
    f"MoveL {ROB},v1,z1,t1,\\WObj:=wobj0;",
    f"MoveL\\Conc, {ROB}\\ID:=5,v1\\V:=50,z1\\Inpos:=inpos50,t1\\WObj:=wobj0\\TLoad:=load0;",
    f"TriggL {ROB},v1,g1\\T2:=g2,z1,t1\\WObj:=wobj0;",
    f"MoveLDO {ROB},v1,z1,t1\\WObj:=wobj0,do1,1;",
    'TPWrite "MoveL; in a text ! no comment";',
    f"; MoveL {ROB},v1,z1,t1; ;",
]  # fmt: skip


@pytest.mark.parametrize("body", LAYOUTS)
def test_rapid_in_any_legal_layout_is_read(body):
    name, text = rapid(body)
    moves = len(re.findall(r"\b(?:Move|Trigg)L", re.sub(r'![^\n]*|"[^"\n]*"', "", text)))
    moves += len(re.findall(r"\bMoveJ\b", text))
    assert len(read_program([(name, text.encode())]).moves) == moves


MOTIONS = {
    "krl": r"\b(?:S?PTP|S?LIN|S?CIRC|SPL)(?:_REL)?\b",
    "rapid": r"\b(?:Move(?:[LJC](?:DO|Sync)?|AbsJ|ExtJ)|Trigg[LJC])\b",
    "fanuc": r"(?m)(?:^[ \t]*\d*[ \t]*:[ \t]*|(?<=[ ;]))[JLCAS][ \t]+PR?\[",
    "ur": r"\b(?:movej|movel|movep|movec)\b",
}


def without_comments(kind, text):
    """The text with blanks in place of comments and texts, by patterns of their own."""
    hidden = {
        "krl": r'"[^"\n]*"|;[^\n]*',
        "rapid": r'"[^"\n]*"|![^\n]*',
        "fanuc": r"'[^'\n]*'|:[ \t]*(?:!|//|--)[^\n]*",
        "ur": r'"[^"\n]*"|#[^\n]*',
    }
    return re.sub(hidden[kind], lambda found: " " * len(found[0]), text)


def motion_lines(kind, text):
    """The line of each motion word outside of comments and texts."""
    plain = without_comments(kind, text)
    if kind == "fanuc":
        plain = plain.partition("/POS")[0]
    flags = re.IGNORECASE if kind in {"krl", "rapid"} else 0
    return [plain.count("\n", 0, found.start()) + 1 for found in re.finditer(MOTIONS[kind], plain, flags)]


FRAGMENTS = {
    "krl": [f"LIN {POINT}", "LIN P1", "PTP HOME", "IF x THEN", "ENDIF", "LOOP", ";", '"', "x=1", "C_DIS", "\n", "LIN_REL {X 1}"],
    "rapid": [f"MoveL {ROB},v1,z1,t1;", "MoveJ p20,v1,z1,t1;", "IF n=1 THEN", "ENDIF", "ELSE", ";", '"', "!", "\n", "CASE 1:"],
    "fanuc": ["L P[1] 50mm/sec FINE", "   9:J P[2] 5% FINE ;", "!", "'", "\n", ";", "C P[1]", ":", "  9:  CALL X ;", "RTCP"],
    "ur": [f"movel({P})", "movej(p1)", "if x:", "end", "#", '"', "\n", "movel(p9)", "x = 1", "set_tcp(p1)"],
}  # fmt: skip


def mutated(draw, kind, text):
    """A text with pieces taken out, put in, doubled or exchanged."""
    for _ in range(draw.randint(1, 4)):
        a, b = sorted(draw.randrange(len(text)) for _ in range(2))
        b = min(b, a + 80)
        piece = draw.choice([*FRAGMENTS[kind], text[a:b], "", " ", draw.choice("()[]{},;:=\\\"'#!")])
        text = draw.choice([text[:a] + piece + text[b:], text[:a] + piece + text[a:], text[:a] + text[b:]])
    return text


def motions_found(name, program):
    """Lines of the moves that are corrected, kept or left; the refusal, if the whole text is not understood."""
    try:
        read = read_program([(name, program.encode())], leave_others=True)
    except ProgramError as refused:
        return [left.line for left in refused.left], None if refused.left else refused.faults
    kept = [remark.line for remark in read.left_alone if "stored in the controller" in remark.text]
    return [*read.moves.line.tolist(), *kept, *(left.line for left in read.left)], ()


@pytest.mark.parametrize(("name", "text"), PLAIN)
def test_each_motion_word_is_read_or_refused(name, text):
    """Mutated programs in each of four languages: no motion word outside of comments and texts is passed over."""
    kind = {"a.src": "krl", "a.mod": "rapid", "a.LS": "fanuc", "a.script": "ur"}[name]
    draw, read, count = random.Random(27), 0, 2_500 if is_full() else 150  # noqa: S311
    for _ in range(count):
        program = mutated(draw, kind, text)
        lines, refusal = motions_found(name, program)
        if refusal:
            continue  # the text is not understood: nothing of it is taken
        read += refusal == ()
        missing = Counter(motion_lines(kind, program)) - Counter(lines)
        assert not missing, program
    assert read > count // 25  # or the mutations show nothing
