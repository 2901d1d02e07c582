# ruff: noqa: E501  # lines of programs, and words that users read
"""What is said of each move of a program, and in which words a program is refused."""

from pathlib import Path

import numpy as np
import pytest
from program_support.rotations import rotation_about
from program_support.written_programs import moves_of, rewritten, targets_of

from robotprograms.errors import ProgramError
from robotprograms.formats import list_moves, read_program

SAMPLES = Path(__file__).parent / "samples"
PLACE = "{X 1,Y 2,Z 3,A 0,B 0,C 0}"
ROB = "[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
OF_KRL = "write X, Y, Z, A, B, C (or A1 ... A6) in numbers, and send the .dat that declares them"
OF_FANUC = "write the numbers of positions in /POS, without PR[] and P[R[]]; choose frames by number, in a line without a condition"
OF_UR = "write p[x, y, z, rx, ry, rz] or [q1 ... q6] in numbers, or use a variable that is assigned such numbers exactly once"
OF_TABLES = (
    "name columns x, y, z and a, b, c (or w, p, r; qw ... qz; rx, ry, rz; i, j, k), or j1 ... j6, with "
    "units as in `x [mm]`"
)
ANEW = "write all of its numbers anew, or split the program"


def sample(*names):
    return [(name, (SAMPLES / name).read_bytes()) for name in names]


def read(name, text, **options):
    return read_program([(name, text.encode("latin-1"))], **options)


def krl(*lines):
    return "\n".join(["DEF a()", *lines, "END"])


def test_a_move_is_told_with_its_target_base_and_tool():
    found = list_moves(sample("cell.src", "cell.dat"), leave_alone=["SPINDLE_ON"])
    arm, base, tool = "-10.5, -92.25, 95.125, 1, 45.5, -12.75", "BASE_DATA[2]", "$Tool of line 24"
    stored = "a move to {}, a position stored in the controller"
    assert [tuple(each) for each in found] == [
        (20, "XHOME", "", "", stored.format("XHOME"), "", False),
        (27, arm, base, tool, "", "", True),
        (28, "1250.3, -120, 812, -90, 5.5, 178.25", base, tool, "", "", True),
        (29, "1250.3, -120, 811.5, -90, 5.5, 178.25", base, tool, "", "", True),
        (31, "1270, -120, 811.5, -90, 5.5, 178.25", base, tool, "", "", True),  # the end of the arc
        (37, "XP7", base, "TOOL_DATA[3]", "", "", True),
        (40, "1280, -120, 811.5, -90, 5.5, 178.25", base, "TOOL_DATA[3]", "", "", True),
        (46, "$AXIS_ACT", "", "", stored.format("$AXIS_ACT"), "", False),
    ]


def test_moves_behind_an_unknown_routine_are_told_with_the_reason_and_the_remedy():
    found = list_moves(sample("cell.src", "cell.dat"))
    assert [(each.line, each.corrected) for each in found] == [
        (20, False),
        (27, True),
        (28, True),
        (29, True),
        (31, False),
        (37, True),
        (40, True),
        (46, False),
    ]
    reason = "'SPINDLE_ON' is unknown: it may move the robot or change its frames"
    remedy = "if 'SPINDLE_ON' does neither, state `trust_routines`, or name the routine in `leave_alone`: ['SPINDLE_ON']"
    assert tuple(found[4][1:6]) == ("in numbers, in numbers", "", "", reason, remedy)


def test_frames_that_are_set_behind_an_unknown_routine_are_known_and_a_remark_says_what_is_assumed():
    program = read_program(sample("cell.src", "cell.dat"), leave_others=True)
    text = "it is assumed that these routines leave the stored frames and points of the program unchanged: 'SPINDLE_ON'"
    assert [(each.line, each.text) for each in program.left_alone if not each.target] == [(30, text)]


def test_one_statement_trusts_all_routines_of_other_files():
    found = list_moves(sample("cell.src", "cell.dat"), trust_routines=True)
    assert found == list_moves(sample("cell.src", "cell.dat"), leave_alone=["SPINDLE_ON"])


def test_moves_of_the_other_languages_are_told_alike():
    fanuc = list_moves(sample("CELL.LS"))
    assert [each[:4] for each in fanuc] == [
        (line, f"P[{point}]", "UF 2", "UT 3") for line, point in ((14, 1), (15, 2), (17, 3), (18, 5))
    ]
    assert [each[:4] for each in list_moves(sample("cell.mod"))] == [
        (17, "JHOME", "wobj0", "tMill"),
        (18, "P10", "wPart", "tMill"),
        (19, "P20", "wPart", "tMill"),
        (20, "12.5, 20.5, -3.25, 0, 0.707107, 0.707107, 0", "wPart", "tMill"),
        (21, "14.5, 20.5, -3.25, 0, 0.707107, 0.707107, 0", "wPart", "tMill"),
        (30, "P10", "wPart", "tMill"),
    ]
    tcp = "active TCP of line 3"
    assert [each[:4] for each in list_moves(sample("cell.script"))] == [
        (10, "home", "robot base", tcp),
        (11, "Waypoint_1_p", "robot base", tcp),
        (12, "0.4031, -0.25, 0.29, 2.2214, -2.2214, 0", "robot base", tcp),
        (13, "0.05, 0.003, 0.19, 2.2214, -2.2214, 0", "part of line 7", tcp),
        (14, "0.42, -0.25, 0.29, 2.2214, -2.2214, 0", "robot base", tcp),
    ]
    assert [each[:4] for each in list_moves(sample("cell.csv"))] == [
        (2, "1200.5, -300, 800.25, 0, 5.5, 180", "part", "tool"),
        (3, "1201.5, -300, 800.25, 0, 5.5, 180", "part", "tool"),
    ]
    assert all(
        each.corrected
        for file in ("CELL.LS", "cell.mod", "cell.script", "cell.csv")
        for each in list_moves(sample(file))
    )


NO_POSE = (
    "the target is neither a whole pose nor all joint angles in numbers, or the text after it is unknown"
)
AXIS = "an external axis or another group is away from zero, and may carry the arm or the part"
CARRY = "if the axis or group carries neither the arm nor the part, state `external_axes: carry_nothing`; otherwise keep the axis at zero"
LEFT = {
    "a pose without angles": ("a.src", krl("LIN {X 1,Y 2,Z 3}"), 2, NO_POSE, OF_KRL),
    "a variable in a pose": ("a.src", krl("LIN {X x1,Y 2,Z 3,A 0,B 0,C 0}"), 2, NO_POSE, OF_KRL),
    "a moved pose": ("a.src", krl(f"LIN {PLACE}:{{X 1}}"), 2, NO_POSE, OF_KRL),
    "NaN": ("a.src", krl("LIN {X 1,Y 2,Z NaN,A 0,B 0,C 0}"), 2, NO_POSE, OF_KRL),
    "3,000 digits": ("a.src", "LIN " + PLACE.replace("1", "1" * 3000), 1, NO_POSE, OF_KRL),
    "1e300": (
        "a.src",
        krl(f"LIN {PLACE.replace('3', '1e300')}"),
        2,
        "a number of a target is out of range, beyond 1e+06",
        ANEW,
    ),
    "an arc from where the arm is": (
        "a.src",
        krl(f"CIRC $POS_ACT,{PLACE}"),
        2,
        "'CIRC $POS_ACT,{X 1,Y 2,Z 3,A 0,B 0,C 0}': the arc goes through a position stored in the controller",
        OF_KRL,
    ),
    "a position register": (
        "a.LS",
        "/PROG A\n/MN\n   1:L PR[1] 10mm/sec FINE ;\n/POS\n/END\n",
        3,
        "'L PR[1]10 mm/sec FINE': the target is not a position in /POS",
        OF_FANUC,
    ),
    "a position that was not recorded": (
        "a.LS",
        "/PROG A\n/MN\n   1:L P[1] 10mm/sec FINE "
        ";\n/POS\nP[1]{\n GP1:\n UF : 0, UT : 1, X = ****** mm, Y = 2 mm, Z = 3 mm,\n W = 0 deg, P = 0 deg, R = 0 deg\n};\n/END\n",
        3,
        "the position was not recorded (***)",
        "record the position, or delete the position and its moves",
    ),
    "a call in angles": (
        "a.script",
        "def a():\n  x = [d2r(1),0,0,0,0,0]\n  movej(x)\nend",
        3,
        "the target 'x' is not given by constant numbers: x gets a value that is not a number",
        OF_UR,
    ),
    "a quaternion of length zero": (
        "a.mod",
        "MODULE a\nPROC main()\nMoveL "
        f"{ROB.replace('[1,0,0,0]', '[0,0,0,0]')},v10,fine,tool0;\nENDPROC\nENDMODULE",
        3,
        "a quaternion or an axis is not of unit length",
        ANEW,
    ),
    "a word in a table": (
        "a.csv",
        "x [mm],y [mm],z [mm]\n1,2,a\n",
        2,
        "'a' in column 3 is not a number",
        "write a number",
    ),
    "a comma in a cell": (
        "a.csv",
        'n,x [mm],y [mm],z [mm]\n"P1,5",1,2,3\n',
        2,
        "the row has 5 columns instead of 4",
        "give every row as many columns as the header",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", LEFT)
def test_a_move_whose_target_is_not_certain_is_left_with_line_reason_and_remedy(case):
    name, text, line, reason, remedy = LEFT[case]
    (move,) = list_moves([(name, text.encode())])
    assert (move.line, move.reason, move.remedy, move.corrected) == (line, reason, remedy, False)


def test_only_the_move_with_an_external_axis_away_from_zero_is_left():
    text = krl("LIN {X 1,Y 2,Z 3,A 0,B 0,C 0,E1 0}", "LIN {X 1,Y 2,Z 3,A 0,B 0,C 0,E1 5}")
    first, second = list_moves([("a.src", text.encode())])
    frames = ("active $BASE", "active $TOOL")
    assert first == (2, "1, 2, 3, 0, 0, 0", *frames, "", "", True)
    assert second == (3, "", *frames, AXIS, CARRY, False)


def test_a_position_of_fanuc_in_two_frames_is_left_at_both_of_its_moves_each_with_its_frame():
    text = (SAMPLES / "frame.LS").read_text().replace("UF : 1", "UF : F").replace("§", "")
    text = text.replace("…", "UFRAME_NUM=2").replace("L P[2]", "L P[1]")
    reason = "target 'P[1]' is used with another base or tool on line 6"
    remedy = "use a separate target for each base and tool: one correction cannot suit both"
    found = [
        (each.line, each.base, each.reason, each.remedy) for each in list_moves([("a.LS", text.encode())])
    ]
    assert found == [(6, "UF 1", reason, remedy), (8, "UF 2", reason, remedy)]


NOT_CNC = "programs in the formats CNC, APT and CLS cannot be read"
ITS_LANGUAGE = "write the program in the controller's own language, or as a table of targets (CSV)"
BRACES = "braces are nested more than 16 deep; declare inner structures on their own"
UNITS = "the columns of the targets have no units, different units, or units of another quantity"
REFUSED = {
    "G code": ("a.nc", "GOTO/1,2,3", f"'a.nc': {NOT_CNC}; {ITS_LANGUAGE}"),
    "APT": ("a.APT", "GOTO/1,2,3", f"'a.APT': {NOT_CNC}; {ITS_LANGUAGE}"),
    "CLS": ("a.cls", "GOTO/1,2,3", f"'a.cls': {NOT_CNC}; {ITS_LANGUAGE}"),
    "CNC": ("a.CNC", "GOTO/1,2,3", f"'a.CNC': {NOT_CNC}; {ITS_LANGUAGE}"),
    "an unknown name": (
        "a.txt",
        "x",
        "'a.txt': the file's name does not show the format; give `format`: one of csv, krl, fanuc, rapid, ur",
    ),
    "two bytes a character": (
        "a.src",
        "\0",
        "'a.src': the file is not text with one byte per character; save the file as plain text, not as "
        "UTF-16 or binary",
    ),
    "a long line": (
        "a.src",
        "x" * 4097,
        "'a.src', line 1: a line has more than 4096 characters; break the line into several lines",
    ),
    "nothing": (
        "a.src",
        "",
        "'a.src': the program has no target; send a program with moves to targets given by numbers",
    ),
    "many braces": ("a.src", "{" * 1000, f"'a.src', line 1: {BRACES}"),
    "a move of frames": (
        "a.mod",
        "MODULE a\nPROC main()\nPDispSet x;\nENDPROC\nENDMODULE",
        "'a.mod', line 3: PDispSet moves targets or frames; omit the statement",
    ),
    "a table of two columns": (
        "a.csv",
        "x,y\n1,2\n",
        f"'a.csv', line 1: the header 'x,y' does not name the coordinates of the targets; {OF_TABLES}",
    ),
    "a table without units": ("a.csv", "x,y,z\n1,2,3\n", f"'a.csv', line 1: {UNITS}; {OF_TABLES}"),
    "a table of degrees": (
        "a.csv",
        "x [deg],y [deg],z [deg]\n1,2,3\n",
        f"'a.csv', line 1: {UNITS}; {OF_TABLES}",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_understood_is_refused_with_place_reason_and_remedy(case):
    name, text, words = REFUSED[case]
    with pytest.raises(ProgramError) as refused:
        list_moves([(name, text.encode())])
    assert str(refused.value) == words


def test_a_line_of_4096_characters_is_read():
    line = f"LIN {PLACE} ;" + "x" * 4096
    assert len(read("a.src", line[:4096]).moves) == 1


@pytest.mark.parametrize(
    ("suffix", "most"), [("script", 1), ("csv", 1), ("LS", 12), ("src", 12), ("mod", 12)]
)
def test_more_files_than_a_program_of_a_language_has_are_refused(suffix, most):
    with pytest.raises(ProgramError) as refused:
        list_moves([(f"{i}.{suffix}", b"") for i in range(most + 1)])
    remedy = (
        "send one program: for KUKA a .src with its .dat and $config.dat, for ABB the modules of one task, "
        "for FANUC the .LS and those that it calls"
    )
    assert str(refused.value) == f"'{most}.{suffix}': more files were sent than one program has; {remedy}"


@pytest.mark.parametrize("statement", ["LIN {}", "P1={}", "DECL FDAT F={}", "FDAT_ACT={}", "TOOL_DATA[1]={}"])
def test_braces_within_one_another_are_refused_wherever_they_stand(statement):
    deep = statement.format("{A " * 500 + "1" + "}" * 500)
    with pytest.raises(ProgramError) as refused:
        read("a.src", krl(f"LIN {PLACE}", deep))
    assert str(refused.value) == f"'a.src', line 3: {BRACES}"


def test_sixteen_braces_are_read_and_seventeen_are_not():
    inner = "x={}"
    read("a.src", krl(f"LIN {PLACE}", inner.format("{A " * 16 + "1" + "}" * 16)), leave_others=True)
    with pytest.raises(ProgramError, match="braces are nested more than 16 deep"):
        read("a.src", krl(f"LIN {PLACE}", inner.format("{A " * 17 + "1" + "}" * 17)), leave_others=True)


QUOTED = [
    ("a.src", krl(f"LIN {PLACE}", "ASYCONT", f"LIN {PLACE}"), "'ASYCONT': the statement is unknown"),
    ("a.src", krl(f"LIN {PLACE}", "x=BASE y=2", f"LIN {PLACE}"), "'X=BASE Y=2': this text is not understood"),
    (
        "a.script",
        "movel(p[0.1,0.2,0.3,0,0,0])\nx = tcp y\nmovel(p[0.1,0.2,0.3,0,0,0])\n",
        "'x=tcp y': this text is not understood",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("name", "text", "words"), QUOTED)
def test_a_fault_quotes_the_statement_that_is_unknown(name, text, words):
    reasons = [fault.reason for fault in read(name, text, leave_others=True).faults]
    assert any(reason.startswith(words) for reason in reasons), reasons


def test_a_remark_quotes_a_statement_that_is_unknown_and_names_no_frame():
    program = read("a.src", krl(f"LIN {PLACE}", "x=1 y=2", f"LIN {PLACE}"))
    remarks = [remark.text for remark in program.left_alone]
    reason = "this text is not understood, or is not complete; it is assumed that the statement changes only the values that it names"
    assert remarks == [f"'X=1 Y=2': {reason}"]


def test_a_byte_order_mark_is_no_text_of_the_program():
    text = f"\xef\xbb\xbfMODULE M\nPROC main()\nMoveL {ROB},v1,z1,t1;\nENDPROC\nENDMODULE"
    program = read("a.mod", text)
    assert [(move.line, targets_of(program)[0].tool.name) for move in moves_of(program)] == [(3, "t1")]


def test_the_routine_of_a_move_with_a_call_may_be_confirmed():
    text = f'MODULE M\nPROC main()\nMoveLSync {ROB},v1,z1,tool0,"p1";\nENDPROC\nENDMODULE'
    program = read("a.mod", text, leave_alone=["p1"])
    assert len(program.moves) == 1
    (remark,) = program.left_alone
    permission = "the request states that this routine neither moves the robot nor changes frames"
    assert remark.text == f"p1 is called; {permission}"


def test_decimal_commas_of_a_table_are_read_and_written():
    table = "x [mm];y [mm];z [mm];qw;qx;qy;qz\n1803,25;-290,5;1505,4;1;0;0;0\n+1800;0,0;1505,4;1;0;0;0\n"
    program = read("a.csv", table)
    assert program.targets.values[:, :3].tolist() == [[1803.25, -290.5, 1505.4], [1800.0, 0.0, 1505.4]]
    moved = program.targets.values[:, :7] + [0.125, 0, 0, 0, 0, 0, 0]
    assert rewritten(program, np.arange(2), moved)[0][0].decode() == (
        "x [mm];y [mm];z [mm];qw;qx;qy;qz\n"
        "1803,375000;-290,5;1505,4;1;0;0;0\n"
        "+1800,125000;0,0;1505,4;1;0;0;0\n"
    )


def test_quaternions_keep_their_sign_where_one_of_their_numbers_is_zero():
    module = read_program(sample("cell.mod"))
    notation = next(each for each in module.targets.notations if each.has_pose)
    near = np.array([[1.0, 2, 3, 0, 0.707107, 0.707107, 0], [1, 2, 3, 0, -1, 0, 0]])
    poses = notation.to_poses(near)
    poses[:, :3, :3] = rotation_about([1e-3, -2e-3, 5e-4]) @ poses[:, :3, :3]
    np.testing.assert_allclose(
        notation.from_poses(poses, near),
        [[1, 2, 3, 0.000354, 0.70693, 0.707283, 0.001061], [1, 2, 3, 0.0005, -0.999999, -0.00025, -0.001]],
        atol=5e-7,
    )


@pytest.mark.parametrize("count", [24, 25, 60])
def test_a_table_of_many_external_axes_is_refused_with_its_reason(count):
    axes = "".join(f",e{i + 1} [mm]" for i in range(count))
    rows = "".join(f"{x},2,3{',1' * count}\n{x},2,4{',2' * count}\n" for x in (1, 2))
    with pytest.raises(ProgramError, match="external axis"):
        read_program([("a.csv", f"x [mm],y [mm],z [mm]{axes}\n{rows}".encode())])


def test_a_second_module_of_a_file_is_part_of_the_program():
    move = f"MoveL {ROB},v1,z1,t1;"
    module = "MODULE {0}\nPROC {0}()\n{1}\nENDPROC\nENDMODULE\n"
    found = list_moves([("a.mod", (module.format("a", move) + module.format("b", move)).encode())])
    assert [(each.line, each.corrected) for each in found] == [(3, True), (8, True)]


def frames_of(text):
    """Return the tools of a program with the heights of those that the program states [m]."""
    program = read_program([("a.mod", text.encode())], leave_others=True)
    return [
        (each.name, each.pose is not None and round(each.pose[2, 3], 9))
        for each in program.targets.frames[1:]
    ]


def test_data_that_are_local_in_one_of_two_modules_are_others_elsewhere():
    tool = "LOCAL PERS tooldata t1:=[TRUE,[[0,0,9],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
    move = f"MoveL {ROB},v1,z1,{{}};\n"
    first = f"MODULE a\n{tool}PROC a()\n{move.format('t1')}{move.format('tool0')}ENDPROC\nENDMODULE\n"
    second = f"MODULE b\nPROC b()\n{move.format('t1')}ENDPROC\nENDMODULE\n"
    assert frames_of(first + second) == [("t1", 0.009), ("tool0", 0.0), ("t1", False)]


def test_a_routine_that_is_local_in_one_of_two_modules_is_unknown_in_the_other():
    sets = "t1:=[TRUE,[[0,0,9],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
    text = f"MODULE a\nLOCAL PROC sub()\n{sets}ENDPROC\nPROC a()\nsub;\nMoveL {ROB},v1,z1,t1;\nENDPROC\nENDMODULE\n"
    text += f"MODULE b\nPROC b()\n{sets}sub;\nMoveL {ROB},v1,z1,t1;\nENDPROC\nENDMODULE\n"
    found = list_moves([("a.mod", text.encode())])
    assert [(each.line, each.corrected) for each in found] == [(7, True), (14, False)]
    assert "'SUB' is unknown" in found[1].reason
    allowed = list_moves([("a.mod", text.encode())], leave_alone=["sub"])
    assert [each.corrected for each in allowed] == [True, True]


def test_local_data_that_get_numbers_in_one_of_two_modules_are_others_elsewhere():
    tool = "[TRUE,[[0,0,9],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]]"
    move = f"MoveL {ROB},v1,z1,t1;\n"
    first = f"MODULE a\nLOCAL PERS tooldata t1:={tool};\nPROC a()\nt1:={tool};\nb;\nENDPROC\nENDMODULE\n"
    second = f"MODULE b\nPROC b()\n{move}ENDPROC\nENDMODULE\n"
    assert frames_of(first + second) == [("t1", False)]


STRAY = ("0}0 ", "0}0\n", "x y ", "%%% ", "x:= ", '"text" ', "} ", "7 ")


@pytest.mark.parametrize("stray", STRAY)
@pytest.mark.parametrize("place", ["first", "second"])
def test_the_head_of_a_module_behind_stray_text_costs_its_own_line(stray, place):
    tool = "LOCAL PERS tooldata t1:=[TRUE,[[0,0,{}],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
    body = f"PROC {{0}}()\nMoveL {ROB},v1,z1,t1;\nENDPROC\nENDMODULE\n"
    first = f"MODULE a\n{tool.format(9)}{body.format('a')}"
    second = f"MODULE b\n{tool.format(7)}{body.format('b')}"
    text = f"{stray}{first}{second}" if place == "first" else f"{first}{stray}{second}"
    program = read_program([("a.mod", text.encode())], leave_others=True)
    lines = [i for i, line in enumerate(text.splitlines(), 1) if line.startswith("MoveL")]
    assert [move.line for move in moves_of(program)] == lines
    assert [round(each.tool.pose[2, 3], 9) for each in targets_of(program)] == [0.009, 0.007]


@pytest.mark.parametrize(
    ("calls", "remark"),
    [
        (True, "1 move of 'b.src' is left as it is: to correct such moves, send that file as the first one"),
        (
            False,
            "1 move of 'b.src' is left as it is: 'b.src' and 'a.src' do not call each other; to correct such moves, send 'b.src' without 'a.src'",
        ),
    ],
)
def test_moves_of_a_further_file_are_left_and_a_program_of_its_own_is_named(calls, remark):
    frames = "$BASE={X 0,Y 0,Z 0,A 0,B 0,C 0}\n$TOOL={X 0,Y 0,Z 0,A 0,B 0,C 0}\n"
    first = f"DEF a()\n{frames}LIN {PLACE}\n{'b()' if calls else ''}\nEND"
    further = f"DEF b()\nLIN {PLACE}\nEND"
    program = read_program([("a.src", first.encode()), ("b.src", further.encode())])
    assert [each.text for each in program.left_alone if "b.src" in each.text] == [remark]
