"""Moves whose external axes are away from zero: what such an axis carries is not in the program."""

import pytest

from robotprograms.errors import ProgramError
from robotprograms.formats import list_moves, read_program
from robotprograms.program import ExternalAxes

KRL = """DEF a()
$BASE={{X 0,Y 0,Z 0,A 0,B 0,C 0}}
$TOOL={{X 0,Y 0,Z 100,A 0,B 0,C 0}}
{moves}
END
"""
FANUC = """/PROG  A
/MN
   1:  UFRAME_NUM=1 ;
   2:  UTOOL_NUM=1 ;
   3:L P[1] 250mm/sec FINE    ;
/POS
P[1]{{
   GP1:
	UF : 1, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X = 1200.000  mm,	Y = 0.000  mm,	Z = 900.000  mm,
	W = 180.000 deg,	P = 0.000 deg,	R = 0.000 deg{more}
}};
/END
"""
RAPID = """MODULE A
CONST robtarget p1:=[[1200,0,900],[0,1,0,0],[0,0,0,0],[{axis},9E9,9E9,9E9,9E9,9E9]];
PERS tooldata t1:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
PROC main()
MoveL p1,v100,fine,t1;
ENDPROC
ENDMODULE
"""
POSE = "X 1200,Y 0,Z 900,A 0,B 180,C 0"
ANGLES = "A1 0,A2 -90,A3 90,A4 0,A5 30,A6 0"
IN_PLACE = "MoveL [[1200,0,900],[0,1,0,0],[0,0,0,0],[{axis},0,0,0,0,0]]"
TABLE = "x [mm];y [mm];z [mm];a [deg];b [deg];c [deg];e1 [mm]\n1200;0;900;0;180;0;{axis}\n"
PROGRAMS = {
    "krl pose": ("a.src", KRL.format(moves=f"LIN {{{POSE},E1 @}}")),
    "krl angles": ("a.src", KRL.format(moves=f"PTP {{{ANGLES},E2 @}}")),
    "krl named": ("a.src", KRL.format(moves=f"DECL E6POS XP\nXP={{{POSE},S 2,T 35,E1 @}}\nLIN XP")),
    "rapid": ("a.mod", RAPID.format(axis="@")),
    "rapid in place": ("a.mod", RAPID.format(axis="0").replace("MoveL p1", IN_PLACE.format(axis="@"))),
    "fanuc": ("a.ls", FANUC.format(more=",\n\tE1 = @ mm")),
    "fanuc group": ("a.ls", FANUC.format(more="\n   GP2:\n\tUF : 1, UT : 1,\n\tJ1 = @ deg")),
    "csv": ("a.csv", TABLE.format(axis="@")),
}


def read(name, text, **options):
    return read_program([(name, text.encode())], **options)


@pytest.mark.parametrize("form", PROGRAMS)
def test_a_move_with_an_external_axis_away_from_zero_is_left_with_its_line_and_the_reason(form):
    name, text = PROGRAMS[form]
    with pytest.raises(ProgramError) as refused:
        read(name, text.replace("@", "500.0"))
    (fault,) = refused.value.faults
    assert "away from zero" in fault.reason
    assert "external_axes: carry_nothing" in fault.remedy
    assert fault.line
    (move,) = list_moves([(name, text.replace("@", "500.0").encode())])
    assert not move.corrected


@pytest.mark.parametrize("form", PROGRAMS)
def test_the_remedy_works_as_it_is_written(form):
    name, text = PROGRAMS[form]
    assert len(read(name, text.replace("@", "500.0"), external_axes=ExternalAxes.CARRY_NOTHING).moves) == 1


@pytest.mark.parametrize("form", PROGRAMS)
def test_a_move_with_external_axes_at_zero_is_corrected(form):
    name, text = PROGRAMS[form]
    assert len(read(name, text.replace("@", "0.0")).moves) == 1


def test_an_axis_that_a_later_target_does_not_state_is_where_it_was():
    text = KRL.format(moves=f"LIN {{{POSE},E1 0}}\nLIN {{{POSE},E1 500}}\nLIN {{{POSE}}}")
    program = read("a.src", text, leave_others=True)
    assert len(program.moves) == 1
    assert [each.line for each in program.left_moves] == [5, 6]


def test_axes_that_move_and_carry_nothing_do_not_matter():
    text = KRL.format(moves=f"LIN {{{POSE},E1 0}}\nLIN {{{POSE},E1 500}}")
    assert len(read("a.src", text, external_axes=ExternalAxes.CARRY_NOTHING).moves) == 2


def test_linear_axes_of_the_robots_model_stand_still_where_they_are():
    text = KRL.format(moves=f"LIN {{{POSE},E1 500}}\nLIN {{{POSE},E1 500}}\nLIN {{{POSE},E1 501}}")
    program = read("a.src", text, external_axes=ExternalAxes.OF_ROBOT, leave_others=True)
    assert [each.line for each in program.left_moves] == [6]
