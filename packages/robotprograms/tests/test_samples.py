# ruff: noqa: E501  # lines of programs, and words that users read
"""Samples of each language: moves, targets, frames, configurations, what stays, and columns of corrected ones."""

from pathlib import Path

import numpy as np
import pytest
from program_support.written_programs import moves_of, rewritten, targets_of

from robotprograms.formats import read_program

SAMPLES = Path(__file__).parent / "samples"
FILES = {
    "krl": ["cell.src", "cell.dat"],
    "fanuc": ["CELL.LS"],
    "rapid": ["cell.mod"],
    "ur": ["cell.script"],
    "csv": ["cell.csv"],
}
SPINDLES = ["SPINDLE_ON", "SPINDLE_OFF"]


def files_of(kind):
    return [(name, (SAMPLES / name).read_bytes()) for name in FILES[kind]]


def read(kind):
    return read_program(files_of(kind), leave_alone=SPINDLES)


def moves_with_targets(program):
    """Motion and line of each move, and of each of its targets the name, its line and its numbers."""
    targets = targets_of(program)
    return [
        (move.motion.value, move.line, each.name, each.line, *each.values)
        for move in moves_of(program)
        for each in (targets[index] for index in move.targets)
    ]


MOVES = {
    "krl": [
        ("joint", 27, "", 27, -10.5, -92.25, 95.125, 1, 45.5, -12.75),
        ("linear", 28, "", 28, 1250.3, -120, 812, -90, 5.5, 178.25),
        ("linear", 29, "", 29, 1250.3, -120.0001, 811.5, -90, 5.5, 178.25),
        ("circular", 31, "", 31, 1260, -110, 811.5, -90, 5.5, 178.25),
        ("circular", 31, "", 31, 1270, -120, 811.5, -90, 5.5, 178.25),
        ("linear", 37, "XP7", 8, 1275.5, -119.25, 811.5, -90, 5.5, 178.25),
        ("spline", 40, "", 40, 1280, -120, 811.5, -90, 5.5, 178.25),
    ],
    "fanuc": [
        ("joint", 14, "P[1]", 24, 0, -20, 10.5, 0, -80, 0),
        ("linear", 15, "P[2]", 30, 1614.742, -12.5, 507.201, -179.999, 0.25, 99.99),
        ("linear", 17, "P[3]", 36, 1614.742, -12.5, 499.999, -179.999, 0.25, 99.99),
        ("circular", 18, "P[4]", 42, 1624.742, 0, 499.999, -179.999, 0.25, 99.99),
        ("circular", 18, "P[5]", 48, 1634.742, -12.5, 499.999, -179.999, 0.25, 99.99),
    ],
    "rapid": [
        ("joint", 17, "JHOME", 11, 0, -10, 20.5, 0, 30, 0),
        ("joint", 18, "P10", 8, 10, 20.5, -3.25, 1e-8, 0.707107, 0.707107, 0),
        ("linear", 19, "P20", 9, 11.123456, 20.5, -3.25, 0, 0.707107, 0.707107, 0),
        ("linear", 20, "", 20, 12.5, 20.5, -3.25, 0, 0.707107, 0.707107, 0),
        ("circular", 21, "", 21, 13.5, 21.5, -3.25, 0, 0.707107, 0.707107, 0),
        ("circular", 21, "", 21, 14.5, 20.5, -3.25, 0, 0.707107, 0.707107, 0),
        ("linear", 30, "P10", 8, 10, 20.5, -3.25, 1e-8, 0.707107, 0.707107, 0),
    ],
    "ur": [
        ("joint", 10, "home", 6, 0, -1.5708, 1.5708, -1.5708, -1.5708, 0),
        ("joint", 11, "Waypoint_1_p", 8, 0.4031, -0.25, 0.3, 2.2214, -2.2214, 0),
        ("linear", 12, "", 12, 0.4031, -0.25, 0.29, 2.2214, -2.2214, 0),
        ("linear", 13, "", 13, 0.05, 0.003, 0.19, 2.2214, -2.2214, 0),
        ("circular", 14, "", 14, 0.41, -0.24, 0.29, 2.2214, -2.2214, 0),
        ("circular", 14, "", 14, 0.42, -0.25, 0.29, 2.2214, -2.2214, 0),
    ],
    "csv": [
        ("linear", 2, "", 2, 1200.5, -300, 800.25, 0, 5.5, 180),
        ("linear", 3, "", 3, 1201.5, -300, 800.25, 0, 5.5, 180),
    ],
}


@pytest.mark.parametrize("kind", FILES)
def test_moves_have_their_targets_in_order(kind):
    found = moves_with_targets(read(kind))
    assert [each[:4] for each in found] == [each[:4] for each in MOVES[kind]]
    assert [each[4:] for each in found] == [pytest.approx(each[4:]) for each in MOVES[kind]]


FRAMES = {
    "krl": [("BASE_DATA[2]", None, "$Tool of line 24", [0, 0, 0.2155])] * 5
    + [("BASE_DATA[2]", None, "TOOL_DATA[3]", None)] * 2,
    "fanuc": [("UF 2", None, "UT 3", None)] * 5,
    "rapid": [("wobj0", [0, 0, 0], "tMill", [0, 0, 0.2155])]
    + [("wPart", [1.2, -0.3, 0.8], "tMill", [0, 0, 0.2155])] * 6,
    "ur": [("robot base", [0, 0, 0], "active TCP of line 3", [0, 0, 0.2155])] * 3
    + [("part of line 7", [0.4, -0.3, 0.1], "active TCP of line 3", [0, 0, 0.2155])]
    + [("robot base", [0, 0, 0], "active TCP of line 3", [0, 0, 0.2155])] * 2,
    "csv": [("part", None, "tool", None)] * 2,
}


@pytest.mark.parametrize("kind", FILES)
def test_each_target_has_the_frames_that_are_active_at_its_move(kind):
    """Those with numbers in the program have their place [m]; others are asked of the user by their name."""
    program = read(kind)
    targets, found = targets_of(program), []
    for each in (targets[index] for move in moves_of(program) for index in move.targets):
        places = [
            None if frame.pose is None else pytest.approx(frame.pose[:3, 3])
            for frame in (each.base, each.tool)
        ]
        found.append((each.base.name, places[0], each.tool.name, places[1]))
    assert found == FRAMES[kind]


CONFIGURATIONS = {
    "krl": {"XP7": ("", {"S": "2", "T": "35"})},
    "fanuc": {f"P[{n}]": ("NUT", {"turn1": "0", "turn4": "0", "turn6": "0"}) for n in (2, 3, 4, 5)},
    "rapid": {name: ("", {"cf1": "0", "cf4": "-1", "cf6": "0", "cfx": "1"}) for name in ("P10", "P20", "")},
    "ur": {},
    "csv": {},
}


@pytest.mark.parametrize("kind", FILES)
def test_a_target_has_the_words_of_its_configuration(kind):
    program, found = read(kind), {}
    for each in targets_of(program):
        text = program.sources[each.source].text
        words = {name: text[start:end] for name, start, end in each.words}
        if words or each.letters:
            found[each.name] = (each.letters, words)
    assert found == CONFIGURATIONS[kind]


def test_moves_to_places_of_the_controller_and_confirmed_calls_stay_as_they_are():
    assert [(each.line, each.text) for each in read("krl").left_alone] == [
        (20, "a move to XHOME, a position stored in the controller"),
        (
            30,
            "SPINDLE_ON is called; the request states that this routine neither moves the robot nor changes frames",
        ),
        (46, "a move to $AXIS_ACT, a position stored in the controller"),
    ]
    assert [(each.line, each.text) for each in read("fanuc").left_alone] == [
        (
            22,
            "SPINDLE_OFF is called; the request states that this routine neither moves the robot nor changes frames",
        )
    ]


CORRECTED = {
    "krl": """\
PTP {A1 -9010.60000,A2 -92.15000,A3 95.12600,A4 1.0,A5 45.5,A6 -12.75,E1 0,E2 0,E3 0,E4 0,E5 0,E6 0} C_PTP
LIN {X -7749.8000,Y -119.9000,Z 812.0010,A -90.0,B 5.5,C 178.25,E1 0,E2 0,E3 0,E4 0,E5 0,E6 0} C_DIS
LIN {X -7749.8000,Y -119.9001,Z +811.5010,A -90.000,B 5.500,C 178.250}
CIRC {X -7740.1000,Y -109.9000,Z 811.5010,A -90,B 5.5,C 178.25},{X -7730.1000,Y -119.9000,Z 811.5010,A -90,B 5.5,C 178.25} C_DIS
  SPL {X -7720.1000,Y -119.9000,Z 811.5010,A -90,B 5.5,C 178.25}
DECL E6POS XP7={X -7724.6000,Y -119.1500,Z 811.5010,A -90.0,B 5.5,C 178.25,S 2,T 35,E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}""",
    "fanuc": """\
	J1= -9000.100 deg,	J2=   -19.900 deg,	J3=    10.501 deg,
	X = -7385.358  mm,	Y =   -12.400  mm,	Z =   507.202  mm,
	X = -7385.358  mm,	Y =   -12.400  mm,	Z =   500.000  mm,
	X = -7375.358  mm,	Y =     0.100  mm,	Z =   500.000  mm,
	X = -7365.358  mm,	Y =   -12.400  mm,	Z =   500.000  mm,""",
    "rapid": """\
  CONST robtarget p10:=[[-8990.1000,20.6000,-3.2490],[0.00000001,0.707106781,0.707106781,0],[0,-1,0,1],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]]; ! first
  CONST robtarget p20:=[[-8988.976544,20.6000,-3.2490],
  LOCAL CONST jointtarget jHome:=[[-9000.10000,-9.90000,20.50100,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
    MoveL [[-8987.6000,20.6000,-3.2490],[0,0.707106781,0.707106781,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]],[20,500,5000,1000],z1,tMill\\WObj:=wPart;
    MoveC [[-8986.6000,21.6000,-3.2490],[0,0.707106781,0.707106781,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]],[[-8985.6000,20.6000,-3.2490],[0,0.707106781,0.707106781,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]],v20,z1,tMill\\WObj:=wPart;""",
    "ur": """\
  home = [-9000.1000000, -1.4708000, 1.5718000, -1.5708, -1.5708, 0.0]
  Waypoint_1_p=p[-8999.6969000, -0.1500000, 0.3010000, 2.2214, -2.2214, 0.0]
  movel(p[-8999.6969000, -0.1500000, 0.2910000, 2.2214, -2.2214, 0.0], a=1.2, v=speed_ms, r=0.001)
  movel(pose_trans(part, p[-9000.0500000, 0.1030000, 0.1910000, 2.2214, -2.2214, 0.0]), a=1.2, v=0.02)
  movec(p[-8999.6900000, -0.1400000, 0.2910000, 2.2214, -2.2214, 0.0], p[-8999.6800000, -0.1500000, 0.2910000, 2.2214, -2.2214, 0.0], a=1.2, v=0.02)""",
    "csv": """\
1;-7799.600000;-299.900000;800.251000;0;5.5;180;first
2;-7798.600000;-299.900000;800.251000;0;5.5;180;"second\"""",
}  # fmt: skip


@pytest.mark.parametrize("kind", FILES)
def test_corrected_numbers_keep_their_columns_signs_and_digits(kind):
    """Lines with other numbers, the first three moved by −9000.1, 0.1 and 0.001; all else is as it was."""
    files, program = files_of(kind), read(kind)
    values = program.targets.values[:, :7] + [-9000.1, 0.1, 1e-3, 0, 0, 0, 0]
    new = [
        line
        for (_, before), after in zip(
            files, rewritten(program, np.arange(len(values)), values)[0], strict=True
        )
        for line in after.decode("latin-1").splitlines()
        if line not in before.decode("latin-1").splitlines()
    ]
    assert new == CORRECTED[kind].splitlines()
