"""Lines that are tolerated, or look like instructions of the controller, leave no move known wrongly."""

import pytest

from robotprograms.errors import ProgramError
from robotprograms.formats import read_program

KRL = {
    "CAST_FROM writes a frame": """DEF a()
        DECL FRAME F
        F={X 0,Y 0,Z 10,A 0,B 0,C 0}
        $TOOL=TOOL_DATA[1]
        CAST_FROM(buf[],off,"%r%r",F.X,F.Y)
        $BASE=F
        LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}
        END""",
    "CAST_FROM writes a base of the controller": """DEF a()
        $TOOL=TOOL_DATA[1]
        CAST_FROM(buf[],off,"%r%r",BASE_DATA[1].X,BASE_DATA[1].Y)
        $BASE=BASE_DATA[1]
        LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}
        END""",
    "CAST_FROM writes a parameter": """DEF a()
        DECL FRAME F
        F={X 0,Y 0,Z 10,A 0,B 0,C 0}
        $TOOL=TOOL_DATA[1]
        rd(F)
        $BASE=F
        LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}
        END
        DEF rd(G:OUT)
        DECL FRAME G
        CAST_FROM(buf[],off,"%r%r",G.X,G.Y)
        END""",
    "an interrupt with unknown words attaches a routine": """DEF a()
        $TOOL=TOOL_DATA[1]
        INTERRUPT WITH BRAKE DECL 3 WHEN $IN[1]==TRUE DO chg()
        $BASE=BASE_DATA[1]
        LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}
        LIN {X 2,Y 2,Z 3,A 0,B 0,C 0}
        END
        DEF chg()
        $BASE=BASE_DATA[2]
        END""",
    "a trigger with unknown words attaches a routine": """DEF a()
        $TOOL=TOOL_DATA[1]
        TRIGGER WHEN DISTANCE=0 DELAY=0 DO chg() PRIO=-1 ONSTART
        $BASE=BASE_DATA[1]
        LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}
        END
        DEF chg()
        $BASE=BASE_DATA[2]
        END""",
    "a function gets the active base": """DEF a()
        DECL INT x
        $TOOL=TOOL_DATA[1]
        $BASE=BASE_DATA[1]
        x=chg($BASE)
        LIN {X 2,Y 2,Z 3,A 0,B 0,C 0}
        END
        DEFFCT INT chg(G:OUT)
        DECL FRAME G
        G={X 0,Y 0,Z 10,A 0,B 0,C 0}
        RETURN(1)
        ENDFCT""",
}
URSCRIPT = {
    f"a damaged {name} may last": f"""def a():
        set_tcp(p[0,0,0.1,0,0,0])
        {name}(p[0,0,0,0,0,0]) 5
        movel(p[0.5,0,0.5,0,0,0],a=1,v=1)
        end"""
    for name in ("force_mode", "freedrive_mode", "path_offset_enable", "track_conveyor_linear")
}
MODULE = """MODULE m
    CONST robtarget p1:=[[500,0,500],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
    PERS tooldata t1:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
    PERS wobjdata w1:=[FALSE,TRUE,"",[[10,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
    PROC main()
    NAME p1,v100,z10,t1;
    ENDPROC
    PROC NAME(robtarget p,speeddata v,zonedata z,PERS tooldata t)
    MoveL p,v,z,t\\WObj:=w1;
    ENDPROC
    ENDMODULE"""
RAPID = {
    f"a routine of the program is called {name}": MODULE.replace("NAME", name)
    for name in ("SpotLoad", "GlueLine", "ArcLoadFixture", "GlueL", "ArcLStart", "SpotJ")
}
PROGRAMS = [
    pytest.param(f"a.{suffix}", text, id=title)
    for suffix, programs in (("src", KRL), ("script", URSCRIPT), ("mod", RAPID))
    for title, text in programs.items()
]


@pytest.mark.parametrize(("name", "text"), PROGRAMS)
def test_no_move_is_corrected_whose_frame_may_have_changed(name, text):
    with pytest.raises(ProgramError):  # a program without a move that can be corrected is refused
        read_program([(name, text.encode())], leave_others=True)


CALLS = [
    *('%"chg"+n%', "%s%", 'CallByVar "chg",n', "CallByVar s,n", "chg1"),
    *(f"MoveLSync p1,v5,z1,t1,{name}" for name in ('"chg1"', '"chg"+n', "s")),
]


@pytest.mark.parametrize("call", CALLS)
def test_trust_in_other_routines_is_none_in_those_of_the_program_with_a_computed_name(call):
    tool = "[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]]"
    text = MODULE.replace("NAME p1,v100,z10,t1;", f"t1:={tool};\n{call};\nMoveL p1,v5,z1,t1;")
    text = text.replace("NAME(", "chg1(").replace("MoveL p,v,z,t\\WObj:=w1;", "t1.tframe.trans.z:=n;")
    with pytest.raises(ProgramError):
        read_program([("m.mod", text.encode())], leave_others=True, trust_routines=True)


def test_the_function_of_the_controller_that_reads_a_point_is_not_trusted():
    text = MODULE.replace("NAME p1,v100,z10,t1;", "ok:=StrToVal(s,p1);\nMoveL p1,v5,z1,t1;")
    text = text.replace("CONST", "PERS")
    with pytest.raises(ProgramError):
        read_program([("m.mod", text.encode())], leave_others=True, trust_routines=True)


@pytest.mark.parametrize(
    "call", ['%"chg"+n% p1', "%s% p1", 'CallByVar "chg",n,p1', "chg1 p1", "IF n=1 chg1 p1"]
)
def test_a_point_that_a_routine_of_the_program_changes_is_unknown_whoever_is_trusted(call):
    text = MODULE.replace("NAME p1,v100,z10,t1;", f"{call};\nMoveL p1,v5,z1,t1;").replace("CONST", "PERS")
    text = text.replace("PROC NAME(robtarget p", "PROC chg1(INOUT robtarget p")
    text = text.replace("MoveL p,v,z,t\\WObj:=w1;", "p.trans.z:=n;")
    with pytest.raises(ProgramError):
        read_program([("m.mod", text.encode())], leave_others=True, trust_routines=True)


def test_twelve_modules_of_a_task_are_read_and_one_more_is_refused():
    head, _, _ = MODULE.partition("NAME")
    main = f"{head}MoveL p1,v5,z1,t1;\nENDPROC\nENDMODULE"
    modules = [("m.mod", main), *((f"m{i}.mod", f"MODULE m{i}\nENDMODULE") for i in range(1, 13))]
    sent = [(name, text.encode()) for name, text in modules]
    assert read_program(sent[:12], leave_others=True).moves.line.size > 0
    with pytest.raises(ProgramError, match="more files were sent"):
        read_program(sent, leave_others=True)
