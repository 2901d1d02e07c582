# ruff: noqa: E501  # one line of a program each
"""Programs of fifty targets in the forms of RoboDK's post-processors: moves, arcs, frames, signals, waits, a message."""

import pytest

from jointstiff.service.programs.formats import read_program

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


def krl(ini, *parts):
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


def ur(*parts, moves=UR_MOVES):
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
    "KUKA KRC2": [krl(STOP, KRL_START, KRL_FRAMES, KRL_AXES, KRL_REST, KRL_MOVES)],
    "KUKA KRC4": [krl("BAS (#INITMOV,0 )", KRL_START, KRL_FRAMES, KRL_AXES, KRL_MOVES, KRL_REST)],
    "KUKA custom": [krl(STOP, "$ADVANCE=5", KRL_FRAMES, KRL_REST, KRL_AXES, KRL_MOVES, "PTP $AXIS_ACT")],
    "KUKA CamRob": [krl(STOP, "BAS(#TOOL,1)\nBAS(#BASE,2)\n$APO.CVEL=50", KRL_AXES, KRL_MOVES, KRL_REST)],
    "KUKA KRC2 with .dat": [krl(STOP, INLINE_START, INLINE, KRL_REST), DATA],
    "KUKA KRC4 with .dat": [krl("BAS (#INITMOV,0 )", INLINE, KRL_REST), DATA],
    "ABB IRC5": [rapid(PARTS, "rdkTool,\\WObj:=rdkWObj", RAPID_DATA)],
    "ABB simplified": [rapid(WHOLE, "rdkTool,\\WObj:=rdkWObj", RAPID_DATA)],
    "ABB S4C": [rapid([], "rdkTool\\WObj:=rdkWObj", RAPID_DATA)],
    "ABB custom": [rapid([], "tool_7\\WObj:=wobj_3", "")],
    "UR": [ur()],
    "UR with helpers": [ur(UR_HELPERS)],
    "UR movep": [ur(moves=UR_MOVES.replace("movel(", "movep(").replace("speed_ms,0,", "speed_ms,"))],
    "UR sub-program": [ur("  def Sub():\n    set_standard_digital_out(1, False)\n  end\n  Sub()")],
    "UR with a frame": [ur("  global ref_frame = p[0.5,0,0.1,0,0,0]", moves=UR_MOVES.replace("movel(p", "movel(pose_trans(ref_frame,p").replace("],accel_mss,speed_ms,0", "]),accel_mss,speed_ms,0"))],
    "UR joints": [ur(moves="\n".join(f"  movej([{i / 100},-1.57,1.57,0.1,0.2,0.3],accel_radss,speed_rads,0,blend_radius_m)" for i in STEPS))],
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
