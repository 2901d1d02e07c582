"""Files as their owners write them: the robot finds joints and positions, without an option."""

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js
from jointstiff.service.importing.grid import read_text
from jointstiff.service.importing.texts.joint_positions import read_joint_positions

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=4, configurations=12)
RADIANS, DEGREES = READINGS.joints, np.rad2deg(READINGS.joints)
METRES, MILLIMETRES = READINGS.position[:, 0], 1e3 * READINGS.position[:, 0]
NAMES = [
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
]


def write(rows, delimiter, header=""):
    lines = [delimiter.join(f"{value:.7f}" for value in row) for row in rows]
    return "\n".join([header, *lines] if header else lines) + "\n"


def side_by_side(*blocks):
    return np.column_stack([np.asarray(block, float) for block in blocks])


TIME = 100.0 + 0.002 * np.arange(len(RADIANS))
JOINTS, POINTS = write(DEGREES, " "), write(MILLIMETRES, " ")
JOINT_TARGETS = "".join(
    f"  CONST jointtarget p{i}:=[[{','.join(f'{v:.5f}' for v in row)}],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
    for i, row in enumerate(DEGREES)
)
AXES = "".join(
    f"DECL E6AXIS XP{i}={{{','.join(f'A{k + 1} {v:.5f}' for k, v in enumerate(row))},E1 0.0,E2 0.0}}\n"
    for i, row in enumerate(DEGREES)
)
TP_POSITIONS = "".join(
    f"P[{i + 1}]{{\n   GP1:\n\tUF : 0, UT : 1,\n"
    + ",\t".join(f"J{k + 1}= {v:.5f} deg" for k, v in enumerate(row))
    + "\n};\n"
    for i, row in enumerate(DEGREES)
)
FILES = {
    "two files without a header": {"j.txt": JOINTS, "p.txt": POINTS},
    "SpatialAnalyzer, points that are numbers": {
        "j.txt": JOINTS,
        "sa.txt": "// UNITS = mm\n"
        + "".join(
            f"Tracker T1_unloaded {i + 1} {x:.4f} {y:.4f} {z:.4f} 11/08/2022 16:{i:02d}:05\n"
            for i, (x, y, z) in enumerate(MILLIMETRES)
        ),
    },
    "RTDE": {
        "rtde.csv": write(
            side_by_side(TIME, RADIANS, MILLIMETRES),
            " ",
            "timestamp " + " ".join(f"actual_q_{k}" for k in range(6)) + " x y z",
        )
    },
    "rostopic": {
        "topic.csv": "%time,field.header.seq,"
        + ",".join(f"field.position{k}" for k in range(6))
        + "\n"
        + write(side_by_side(1e3 * TIME, np.arange(len(TIME)), RADIANS), ","),
        "p.txt": POINTS,
    },
    "PlotJuggler": {
        "pj.csv": write(
            side_by_side(TIME, RADIANS, METRES),
            ",",
            "__time," + ",".join(f"/joint_states/{name}/position" for name in NAMES) + ",/t/x,/t/y,/t/z",
        )
    },
    "joint names of ROS": {"r.csv": write(side_by_side(RADIANS, METRES), ",", ",".join([*NAMES, *"xyz"]))},
    "joint names of the panel": {
        "u.csv": write(
            side_by_side(DEGREES, MILLIMETRES), ",", "Base,Shoulder,Elbow,Wrist1,Wrist2,Wrist3,x,y,z"
        )
    },
    "RAPID": {"t.mod": f"MODULE T\n{JOINT_TARGETS}ENDMODULE\n", "p.txt": POINTS},
    "KRL": {"t.dat": f"DEFDAT T\n{AXES}ENDDAT\n", "p.txt": POINTS},
    "LS": {"t.ls": f"/PROG T\n/MN\n   1:J P[1] 10% FINE    ;\n/POS\n{TP_POSITIONS}/END\n", "p.txt": POINTS},
}


@pytest.mark.parametrize("form", FILES)
def test_joints_and_positions_are_proposed_without_an_option(form, tmp_path):
    for name, content in FILES[form].items():
        (tmp_path / name).write_text(content)
    proposal = js.read(*(tmp_path / name for name in FILES[form]), robot=ARM, encoders="motor")
    assert "as J1…J6" in str(proposal)
    assert "in 12 of 12 positions" in str(proposal)
    assert proposal.residual < 2.0


@pytest.mark.parametrize(
    "text",
    [
        JOINTS,
        "J1 [deg];J2 [deg]\n1;2\n3;4\n5;6\n",
        "PTP {X 1, Y 2, Z 3, A 4, B 5, C 6}\n" * 5,
        "CONST robtarget p:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n" * 5,
    ],
)
def test_a_text_without_joint_positions_of_a_program_is_read_as_it_is(text):
    assert read_joint_positions(text) == []


def test_positions_have_the_lines_of_the_program():
    lines = [each.line for each in read_joint_positions(f"MODULE T\n{JOINT_TARGETS}")]
    assert lines == list(range(2, 14))


def name_points(names, order, left_out=()):
    """Return a file of positions without and under load, in some order of the postures."""
    rows = [
        f"{names(i)};{state};" + ";".join(f"{v:.4f}" for v in MILLIMETRES[i] + [0.0, 0.0, sag])
        for state, sag in (("empty", 0.0), ("18kg", -0.7))
        for i in order
        if (i, state) not in left_out
    ]
    return "\n".join(["pos;state;x;y;z", *rows]) + "\n"


BACKWARDS = range(len(DEGREES))[::-1]
NAMED_PROGRAMS = {
    "RAPID": (f"MODULE T\n{JOINT_TARGETS}ENDMODULE\n", "t.mod", lambda i: f"p{i}"),
    "KRL": (f"DEFDAT T\n{AXES}ENDDAT\n", "t.dat", lambda i: f"XP{i}"),
    "LS": (f"/PROG T\n/POS\n{TP_POSITIONS}/END\n", "t.ls", lambda i: f"P[{i + 1}]"),
}


def read_program(tmp_path, form, points):
    program, name, _ = NAMED_PROGRAMS[form]
    (tmp_path / name).write_text(program)
    (tmp_path / "points.csv").write_text(points)
    return js.read(tmp_path / name, tmp_path / "points.csv", robot=ARM, encoders="motor")


@pytest.mark.parametrize("form", NAMED_PROGRAMS)
def test_positions_of_a_program_are_joined_by_their_names(form, tmp_path):
    names = NAMED_PROGRAMS[form][2]
    points = name_points(names, BACKWARDS, left_out={(3, "18kg")})
    proposal = read_program(tmp_path, form, points)
    assert "rows of the files joined by their names" in str(proposal)
    assert "in 23 of 23 positions" in str(proposal)


@pytest.mark.parametrize("form", NAMED_PROGRAMS)
def test_points_with_other_numbers_than_the_positions_of_a_program_go_by_their_order(form, tmp_path):
    proposal = read_program(tmp_path, form, name_points(lambda i: f"M{10 * i + 7}", range(len(DEGREES))))
    assert "joined by their names" not in str(proposal)
    assert "in 24 of 24 positions" in str(proposal)


def test_positions_of_a_program_with_one_name_twice_keep_their_order():
    twice = JOINT_TARGETS.replace("jointtarget p1:", "jointtarget p0:")
    grid = read_text("t.mod", twice.encode(), None)
    assert grid.rows[0].cells[0] == "J1 [deg]"
