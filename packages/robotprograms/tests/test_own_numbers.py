"""A move gets numbers of its own where the declaration of its target has to stay."""

import numpy as np
import pytest
from program_support.written_programs import rewritten, targets_of

from robotprograms.errors import ProgramError
from robotprograms.formats import list_moves, read_program

KRL = """DEF a()
$TOOL=TOOL_DATA[1]
$BASE=BASE_DATA[1]
LIN XP1 C_DIS ; XP1 above the part
$BASE=BASE_DATA[2]
lin xp1 WITH $VEL.CP=0.1
LIN XP2
END
"""
DAT = """DEFDAT a
DECL E6POS XP1={X 1.5,Y 2,Z 3,A 0,B 0,C 0,S 2,T 10,E1 0.0}
DECL E6POS XP2={X 4,Y 5,Z 6,A 0,B 0,C 0}
ENDDAT
"""
NUMBERS = "{X 1.5,Y 2,Z 3,A 0,B 0,C 0,S 2,T 10,E1 0.0}"
REASON = "target 'XP1' is used with another base or tool on line 4"


def read(text, *others, name="a.src"):
    return read_program([(name, text.encode()), *((other, part.encode()) for other, part in others)])


def moved(program, shift, rows=None):
    """The program's files with the first numbers of some targets changed."""
    rows = np.arange(len(program.targets)) if rows is None else np.array(rows, dtype=np.intp)
    values = np.full((len(rows), 7), np.nan)
    values[:, 0] = program.targets.values[rows, 0] + shift
    return [each.decode() for each in rewritten(program, rows, values)[0]]


def test_a_target_in_two_bases_gets_its_numbers_at_both_moves_and_its_declaration_stays():
    program = read(KRL, ("a.dat", DAT))
    first, second, third = targets_of(program)
    assert [(each.name, each.line, each.values[0], each.base.name) for each in (first, second, third)] == [
        ("XP1", 4, 1.5, "BASE_DATA[1]"),
        ("xp1", 6, 1.5, "BASE_DATA[2]"),
        ("XP2", 3, 4.0, "BASE_DATA[2]"),
    ]
    source, data = moved(program, 0.25)
    new = NUMBERS.replace("X 1.5", "X 1.7500")
    assert [line for line in source.split("\n") if "X 1" in line] == [
        f"LIN {new} C_DIS ; XP1 above the part",
        f"lin {new} WITH $VEL.CP=0.1",
    ]
    assert data == DAT.replace("X 4", "X 4.2500")


def test_a_name_comes_back_where_none_of_its_numbers_changes():
    program = read(KRL, ("a.dat", DAT))
    assert moved(program, 0.0, []) == [KRL, DAT]
    assert moved(program, 0.0) == [KRL, DAT]
    source, data = moved(program, 0.25, [1])
    assert data == DAT
    assert source == KRL.replace("lin xp1", f"lin {NUMBERS.replace('X 1.5', 'X 1.7500')}")
    source, _ = moved(program, 0.25, [0])
    assert source == KRL.replace("LIN XP1 C", f"LIN {NUMBERS.replace('X 1.5', 'X 1.7500')} C")


def test_a_remark_says_why_a_move_has_numbers_of_its_own():
    remarks = {each.line: each.text for each in read(KRL, ("a.dat", DAT)).left_alone}
    reason = "target 'XP1' is used with another base or tool on line"
    assert remarks[4] == f"where the move is corrected, numbers replace 'XP1': {reason} 6"
    assert remarks[6] == f"where the move is corrected, numbers replace 'xp1': {reason} 4"


def test_a_point_that_other_programs_may_set_is_left():
    config = DAT.replace("DEFDAT a", "DEFDAT $CONFIG PUBLIC").replace("XP2", "XP3")
    with pytest.raises(ProgramError) as refused:
        read(KRL.replace("LIN XP2\n", ""), ("$config.dat", config))
    assert {fault.reason for fault in refused.value.faults} == {
        "the target 'XP1' is not given by constant numbers: the declaration is shared with other programs"
    }


MODULE = """MODULE m
PERS robtarget p1:=[[500,0,500],
  [1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
PERS robtarget p2:=[[600,0,500],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
! the height belongs to another module
PROC main()
height:=p1.trans.z;
PDispOn p2,p2,tool0; PDispOff;
MoveC p1,
  p2,v5,z1,tool0;
MoveL p2,v5,z1,tool1;
ENDPROC
ENDMODULE
"""


def test_numbers_of_several_lines_are_written_on_the_line_of_the_move():
    program = read(MODULE, name="m.mod")
    assert {each.line for each in targets_of(program)} == {9, 11}
    (text,) = moved(program, 1.0)
    assert len(text.split("\n")) == len(MODULE.split("\n"))
    assert (
        "MoveC [[501.0000,0,500], [1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],\n  [[601.0000,0,500]"
        in text
    )
    assert text.count("PERS robtarget p1:=[[500,0,500],") == 1


SCRIPT = """def a():
  set_tcp(p[0,0,0.1,0,0,0])
  p1 = p[0.5,0,0.5,0,3.1,0]
  movel(p1, a=1)
  p1 = p[0.6,0,0.5,0,3.1,0]
  movel(p1, a=1)
  movel(p[0.5,0.1,0.5,0,3.1,0], a=1)
  textmsg("p1") movel(p1) # p1
end
"""


def test_a_variable_with_several_values_is_known_at_each_of_its_moves():
    program = read(SCRIPT.replace('textmsg("p1") ', ""), name="a.script")
    assert [each.values[0] for each in targets_of(program)] == [0.5, 0.6, 0.5, 0.6]
    (text,) = moved(program, 0.001)
    assert "movel(p[0.5010000,0,0.5,0,3.1,0], a=1)\n  p1 = p[0.6,0,0.5,0,3.1,0]" in text


def test_a_move_that_names_its_target_twice_is_left_with_the_reason():
    text = KRL.replace("LIN XP1 C_DIS", "CIRC XP1,XP1")
    rows = list_moves([("a.src", text.encode()), ("a.dat", DAT.encode())])
    assert [(each.line, each.reason) for each in rows] == [(4, REASON), (6, ""), (7, "")]


def test_a_comment_within_the_numbers_leaves_them_where_they_are():
    text = MODULE.replace("[[500,0,500],\n", "[[500,0,500], ! above\n")
    rows = {each.line: each.corrected for each in list_moves([("m.mod", text.encode())])}
    assert rows == {9: False, 11: True}


def test_numbers_that_would_exceed_the_limit_of_a_program_are_not_copied(monkeypatch):
    monkeypatch.setattr("robotprograms.formats.MAX_PROGRAM_BYTES", len(KRL) + len(DAT) + 60)
    rows = list_moves([("a.src", KRL.encode()), ("a.dat", DAT.encode())])
    assert [(each.line, each.reason) for each in rows] == [(4, REASON), (6, REASON), (7, "")]


def test_a_name_in_letters_of_any_country_gives_way_and_comes_back():
    text = SCRIPT.replace("p1", "pñ").replace('textmsg("pñ") ', "")
    program = read(text, name="a.script")
    assert moved(program, 0.0) == [text]
    (new,) = moved(program, 0.001)
    assert new.count("movel(p[0.6010000,0,0.5,0,3.1,0]") == 2


@pytest.mark.parametrize("code", ["utf-8", "latin-1"])
@pytest.mark.parametrize(("small", "large"), [("å", "Å"), ("à", "À"), ("ñ", "Ñ")])
def test_capitals_and_small_letters_of_any_country_are_the_same_in_a_name(small, large, code):
    text = MODULE.replace("p1", f"p{small}").replace("height:=", f"p{large}.trans.x:=5; x:=")
    files = [("m.mod", text.encode(code))]
    assert [each.corrected for each in list_moves(files)] == [False, True]
    used = MODULE.replace("p1", f"p{small}").replace(f"MoveC p{small}", f"MoveC p{large}")
    program = read_program([("m.mod", used.encode(code))])
    assert sorted(program.targets.names) == sorted([f"p{large}".encode(code).decode("latin-1"), "p2", "p2"])
    values = program.targets.values[:, :7] + np.eye(7)[0]
    written = rewritten(program, np.arange(3), values)[0][0].decode(code)
    assert "MoveC [[501.0000,0,500]" in written
    assert f"PERS robtarget p{small}:=[[500,0,500]," in written


@pytest.mark.parametrize(("name", "most"), [("MAX_TARGETS", 3), ("MAX_REMARKS", 1)])
def test_a_program_whose_own_numbers_exceed_a_limit_is_read_without_them(monkeypatch, name, most):
    monkeypatch.setattr(f"robotprograms.columns.{name}", most)
    rows = list_moves([("a.src", KRL.encode()), ("a.dat", DAT.encode())])
    assert [(each.line, each.corrected) for each in rows] == [(4, False), (6, False), (7, True)]


def test_a_line_that_would_become_too_long_for_the_controller_keeps_the_name():
    long = KRL.replace("$VEL.CP=0.1", f"$VEL.CP=0.1{', $VEL.CP=0.1' * 35}")
    rows = list_moves([("a.src", long.encode()), ("a.dat", DAT.encode())])
    assert [(each.line, each.reason) for each in rows] == [(4, ""), (6, REASON), (7, "")]


def test_points_of_one_declared_target_have_its_name_in_common():
    program = read(KRL, ("a.dat", DAT))
    assert program.common_names == {"XP1"}
    assert read(KRL.replace("$BASE=BASE_DATA[2]\n", ""), ("a.dat", DAT)).common_names == frozenset()
