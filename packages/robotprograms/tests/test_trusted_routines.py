"""Trust in routines of other files never covers what the program hands to a routine by reference."""

import pytest

from robotprograms.errors import ProgramError
from robotprograms.formats import read_program

KRL = """DEF a()
DECL INT N
DECL E6POS P1
DECL FRAME F
EXT
P1={X 1,Y 2,Z 3,A 0,B 0,C 0}
F={X 0,Y 0,Z 9,A 0,B 0,C 0}
$TOOL=TOOL_DATA[1]
$BASE=BASE_DATA[1]
LIN {X 5,Y 2,Z 3,A 0,B 0,C 0}
CALL
BEHIND
END"""
RAPID = """MODULE m
PERS robtarget p1:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
PERS tooldata t1:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
PERS wobjdata w1:=[FALSE,TRUE,"",[[10,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
VAR bool ok;
VAR num n;
PROC main()
MoveL [[5,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v1,z1,tool0;
CALL;
BEHIND;
ENDPROC
ENDMODULE"""
URSCRIPT = """def a():
set_tcp(p[0,0,0.1,0,0,0])
p1=p[0.1,0.2,0.3,0,0,0]
t1=p[0,0,0.2,0,0,0]
movel(p[0.5,0.2,0.3,0,0,0])
CALL
BEHIND
end"""
FANUC = (
    """/PROG A
/ATTR
/MN
   1:  UFRAME_NUM=1 ;
   2:  UTOOL_NUM=1 ;
   3:L P[1] 9mm/sec FINE ;
   4:  CALL ;
   5:L P[2] 9mm/sec FINE ;
/POS
"""
    + "".join(
        f"""P[{i}]{{
   GP1:
    UF : 1, UT : 1, CONFIG : 'N U T, 0, 0, 0',
    X = {i}.000 mm, Y = 2.000 mm, Z = 3.000 mm,
    W = 0.000 deg, P = 0.000 deg, R = 0.000 deg
}};
"""
        for i in (1, 2)
    )
    + "/END\n"
)
OF_KRL = {
    "a point": ("SHIFT(P1)", "LIN P1"),
    "a point to an interrupt": ("INTERRUPT DECL 3 WHEN $IN[1] DO SHIFT(P1)\nINTERRUPT ON 3", "LIN P1"),
    "a point to a trigger": ("TRIGGER WHEN DISTANCE=0 DELAY=0 DO SHIFT(P1)", "LIN P1"),
    "a point to a function": ("N=SHIFT(P1)", "LIN P1"),
    "a point to a function in a condition": ("WAIT FOR SHIFT(P1)", "LIN P1"),
    "a point to a function in a branch": ("IF SHIFT(P1) THEN\nENDIF", "LIN P1"),
    "a number of a point": ("SHIFT(P1.X)", "LIN P1"),
    "a point among others": ("SHIFT(1,N,P1)", "LIN P1"),
    "a frame": ("SHIFT(F)", "$BASE=F\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}"),
    "the active base": ("SHIFT($BASE)", "LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}"),
    "the active tool": ("SHIFT($TOOL)", "LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}"),
    "a base of the table": ("SHIFT(BASE_DATA[1])", "$BASE=BASE_DATA[1]\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}"),
    "an element of an array": ("PS[1]={X 1,Y 2,Z 3,A 0,B 0,C 0}\nSHIFT(PS[1])", "LIN PS[1]"),
    "a whole array": ("PS[1]={X 1,Y 2,Z 3,A 0,B 0,C 0}\nSHIFT(PS[])", "LIN PS[1]"),
}
DECLARATIONS = {
    "without a declaration": "",
    "declared with OUT": "EXT SHIFT(E6POS:OUT)",
    "declared without a word": "EXT SHIFT(E6POS)",
    "declared with both": "EXT SHIFT(E6POS :IN,INT :OUT)",
    "a function declared with OUT": "EXTFCT BOOL SHIFT(E6POS:OUT)",
    "declared twice": "EXT SHIFT(E6POS:IN)\nEXT SHIFT(E6POS:OUT)",
}
OF_RAPID = {
    "a point": ("SearchPart p1", "MoveL p1,v1,z1,tool0"),
    "a point to a function": ("ok:=SearchPart(p1)", "MoveL p1,v1,z1,tool0"),
    "a point to a function in a condition": ("IF SearchPart(p1) n:=1", "MoveL p1,v1,z1,tool0"),
    "a point as an option": (r"SearchPart n\At:=p1", "MoveL p1,v1,z1,tool0"),
    "a number of a point": ("SearchPart p1.trans.z", "MoveL p1,v1,z1,tool0"),
    "a point in a branch": ("IF n=1 SearchPart p1", "MoveL p1,v1,z1,tool0"),
    "a point to a routine with a computed name": ('%"Search"+n% p1', "MoveL p1,v1,z1,tool0"),
    "a point to a routine by a variable": ('CallByVar "Search",n,p1', "MoveL p1,v1,z1,tool0"),
    "a point in the form of a move": ("LookL p1,v1,z1,tool0", "MoveL p1,v1,z1,tool0"),
    "a work object": (
        "FindPart w1",
        r"MoveL [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v1,z1,tool0\WObj:=w1",
    ),
    "a frame of a work object": (
        "FindPart w1.oframe",
        r"MoveL [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v1,z1,tool0\WObj:=w1",
    ),
    "a tool": ("ChangeTip t1", "MoveL [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v1,z1,t1"),
    "a tool to a function": (
        "ok:=ChangeTip(t1)",
        "MoveL [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v1,z1,t1",
    ),
}
OF_URSCRIPT = {
    "a point": ("shift(p1)", "movel(p1)"),
    "a point to a function": ("n=shift(p1)", "movel(p1)"),
    "a point to a function in a condition": ("if shift(p1):\nend", "movel(p1)"),
    "a point to a service": ("camera.find(p1)", "movel(p1)"),
    "a tool": ("shift(t1)", "set_tcp(t1)\nmovel(p[0.6,0.2,0.3,0,0,0])"),
}  # fmt: skip
OF_FANUC = {
    "a position": "CALL SHIFT(P[2])",
    "a position to a macro": "Find part(P[2])",
    "a position behind a condition": "IF R[1]=1,CALL SHIFT(P[2])",
}
CASES = [
    *(
        pytest.param("a.src", KRL.replace("EXT", ext), call, behind, id=f"KRL: {case}, {title}")
        for title, ext in DECLARATIONS.items()
        for case, (call, behind) in OF_KRL.items()
    ),
    *(pytest.param("a.mod", RAPID, *words, id=f"RAPID: {case}") for case, words in OF_RAPID.items()),
    *(
        pytest.param("a.script", URSCRIPT, *words, id=f"URScript: {case}")
        for case, words in OF_URSCRIPT.items()
    ),
    *(pytest.param("a.LS", FANUC, call, "", id=f"FANUC: {case}") for case, call in OF_FANUC.items()),
]
STATEMENTS = (
    {"trust_routines": True},
    {"leave_alone": ["SHIFT", "SearchPart", "LookL", "FindPart", "ChangeTip"]},
)


def corrected(name, text, **statement):
    """Return the lines of the moves that are corrected; [] if the reader leaves all moves."""
    try:
        program = read_program([(name, text.encode())], leave_others=True, **statement)
    except ProgramError as error:
        if not error.left_moves:
            raise
        return []
    return program.moves.line.tolist()


def last_move(text):
    """Return the line of the last move of a program."""
    words = ("LIN", "MoveL", "movel", "   5:L")
    return max(i for i, line in enumerate(text.splitlines(), 1) if line.startswith(words))


@pytest.mark.parametrize("statement", STATEMENTS, ids=["trust", "by name"])
@pytest.mark.parametrize(("name", "text", "call", "behind"), CASES)
def test_what_a_routine_gets_by_reference_is_left_whoever_is_trusted(name, text, call, behind, statement):
    written = text.replace("CALL", call).replace("BEHIND", behind)
    assert last_move(written) not in corrected(name, written, **statement)


@pytest.mark.parametrize(("name", "text", "call", "behind"), CASES)
def test_moves_that_the_routine_gets_nothing_of_stay_corrected(name, text, call, behind):
    """The same program with a call that has no arguments: trust covers all of its moves."""
    call = {"a.src": "SHIFT()", "a.mod": "SearchPart", "a.script": "shift()", "a.LS": "CALL SHIFT"}[name]
    if "PS[1]" in behind:
        call = f"PS[1]={{X 1,Y 2,Z 3,A 0,B 0,C 0}}\n{call}"
    written = text.replace("CALL", call).replace("BEHIND", behind)
    assert last_move(written) in corrected(name, written, trust_routines=True)


BY_VALUE = (
    "EXT SHIFT(E6POS:IN)",
    "ext shift ( E6POS :IN )",
    "EXTP SHIFT(E6POS:IN)",
    "EXTFCT BOOL SHIFT(E6POS :IN)",
    "EXTFCTP BOOL SHIFT(E6POS:IN)",
)


@pytest.mark.parametrize("declaration", BY_VALUE)
@pytest.mark.parametrize("call", ["SHIFT(P1)", "N=SHIFT(P1)"])
def test_trust_covers_what_a_routine_gets_by_value(declaration, call):
    written = KRL.replace("EXT", declaration).replace("CALL", call).replace("BEHIND", "LIN P1")
    assert last_move(written) in corrected("a.src", written, trust_routines=True)


def test_the_remark_on_a_trusted_interrupt_has_its_number():
    text = KRL.replace("CALL", "INTERRUPT ON 7").replace("BEHIND\n", "").replace("EXT\n", "")
    program = read_program([("a.src", text.encode())], trust_routines=True, leave_others=True)
    assert [remark.text.partition(";")[0] for remark in program.left_alone] == ["INTERRUPT 7 is called"]
