"""What the kinds make of a program that was read: configurations, axes of tools, own numbers, errors."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.programs import corrected, path, request, tool_poses

import robotprograms
from jointstiff.schemas.correction import MAX_FILES
from jointstiff.service.kinds.correction.files import decompress_file
from jointstiff.service.kinds.correction.loads import read_load_table
from jointstiff.service.kinds.correction.path import ProgramFrames, StatedConfigurations
from jointstiff.service.kinds.correction.text import FaultsError
from jointstiff.service.problems import FilesError, problem_from_error
from robotprograms import Fault, ProgramError, read_program

SAMPLES = Path(robotprograms.__file__).parents[2] / "tests" / "samples"


def read(name, text, **options):
    return read_program([(name, text.encode("latin-1"))], **options)


def krl(*lines):
    return "\n".join(["DEF a()", *lines, "END"])


@pytest.mark.parametrize(
    ("words", "negative"),
    [("S 6,T 19", (0, 1, 4)), ("S 2,T 35", (0, 1, 5)), ("S 22,T 50", (1, 4, 5))],
)
def test_kukas_turn_says_which_axes_are_below_zero(words, negative):
    """Recorded points of a controller; bit 2 of S goes with the sign of axis 5."""
    text = krl("$TOOL=$NULLFRAME", "$BASE=$NULLFRAME", f"PTP {{X 1,Y 2,Z 3,A 0,B 0,C 0,{words}}}")
    (ranges,) = StatedConfigurations(read("a.src", text)).ranges([0])
    assert ranges.tolist() == [[-np.inf, 0.0] if axis in negative else [0.0, np.inf] for axis in range(6)]


def test_turn_numbers_that_no_controller_writes_say_nothing():
    cell = (SAMPLES / "CELL.LS").read_text()
    cell = re.sub(r"(CONFIG : '[^,]*,)[^,]*", r"\1 " + "9" * 400, cell)
    program = read("CELL.LS", cell, leave_alone=["SPINDLE_OFF"])
    assert StatedConfigurations(program).ranges([0]).tolist() == [[[-np.inf, np.inf]] * 6]


def test_an_axis_of_a_tool_takes_the_angle_about_it_from_the_request():
    """The axis of any length is z; x is the stated direction, made perpendicular to it."""
    axes = read("a.csv", "x [mm],y [mm],z [mm],i,j,k\n10,20,30,0,0.6,0.8\n11,20,30,0,1.2,1.6\n")
    used = ProgramFrames.from_program(axes, request("csv", "", tool_x=[2.0, 0.0, 0.0]))
    every = np.arange(2)
    found = (used.flange_poses(axes, every) @ used.tool.select(every))[:, :3, :3]
    turned = [[1.0, 0.0, 0.0], [0.0, -0.8, -0.6], [0.0, 0.6, -0.8]]
    np.testing.assert_allclose(found, [turned, turned], atol=1e-12)


KRL = """DEF a()
$TOOL=TOOL_DATA[1]
$BASE=BASE_DATA[1]
LIN XP1 C_DIS
$BASE=BASE_DATA[2]
LIN XP1
END
"""


def test_the_loaded_tool_reaches_a_point_of_two_bases_in_both():
    """The bases are 30 mm apart along z: two corrections, and both are right."""
    pose = tool_poses(path(1))[0]
    angles = (float(each) for each in np.degrees(_zyx(pose[:3, :3])))
    numbers = "{{X {:.6f},Y {:.6f},Z {:.6f},A {:.8f},B {:.8f},C {:.8f}}}".format(
        *(1e3 * pose[:3, 3]), *angles
    )
    text = KRL.replace("$TOOL", f"XP1={numbers}\n$TOOL", 1)
    bases = [{"name": f"BASE_DATA[{i}]", "values": [0, 0, 30.0 * (i - 1), 0, 0, 0]} for i in (1, 2)]
    result = corrected("krl", text, "a.src", bases=bases)
    source = decompress_file(result.files[0]).decode()
    assert result.corrected == 2
    assert f"XP1={numbers}" in source
    first, second = (line for line in source.split("\n") if line.lower().startswith("lin {"))
    assert first.split("}")[0].upper() != second.split("}")[0].upper()
    assert result.residual.greatest < 1e-8


def test_a_label_of_loads_means_all_points_of_a_declared_target():
    table = b"label,Fx [N],Fy [N],Fz [N]\nxp1,10,0,0\nXP2,0,20,0\n"
    loads = read_load_table(table, np.array([1, 2, 3]), ["XP1", "xp1", "XP2"], np.zeros, {"XP1"})
    assert loads.values[loads.of_visit, :3].tolist() == [[10, 0, 0], [10, 0, 0], [0, 20, 0]]
    with pytest.raises(FilesError, match="label 'xp1' is not the name of one target"):
        read_load_table(table, np.array([1, 2, 3]), ["XP1", "xp1", "XP2"], np.zeros)


def _zyx(rotation):
    """Angles about Z, Y', X'' of a rotation (3, 3) [rad]."""
    b = np.arcsin(-rotation[2, 0])
    return np.arctan2(rotation[1, 0], rotation[0, 0]), b, np.arctan2(rotation[2, 1], rotation[2, 2])


def test_as_many_files_are_read_as_can_be_posted_with_a_table_of_loads():
    assert robotprograms.MAX_FILES + 1 == MAX_FILES


def test_an_error_of_the_readers_is_an_error_of_the_request_in_few_words():
    faults = [Fault("a.src", i, "a" * 3000, "b" * 3000) for i in range(1, 30)]
    error = FaultsError(faults)
    assert str(error) == str(ProgramError(faults))
    assert (error.where, error.count, len(error.faults)) == ("'a.src', line 1", 29, 20)
    assert len(problem_from_error(error).model_dump_json().encode()) < 8000


@pytest.mark.parametrize("orientation", ["QUATERNION", "ROTATION_VECTOR"])
def test_rotations_are_those_of_scipy(orientation):
    """Angles from nothing to half a turn, about any axis."""
    notation = robotprograms.Notation(robotprograms.Orientation[orientation], angle=1.0)
    draw = np.random.default_rng(7)
    vectors = draw.normal(size=(2000, 3)) * np.logspace(-12, 0, 2000)[:, None]
    vectors[-100:] *= np.pi / np.linalg.norm(vectors[-100:], axis=1, keepdims=True)
    rotations = Rotation.from_rotvec(vectors)
    numbers = vectors if orientation == "ROTATION_VECTOR" else rotations.as_quat(scalar_first=True)
    numbers = np.hstack([np.zeros((len(numbers), 3)), numbers])
    poses = notation.to_poses(numbers)
    np.testing.assert_allclose(poses[:, :3, :3], rotations.as_matrix(), rtol=0, atol=1e-15)
    np.testing.assert_allclose(notation.from_poses(poses, numbers), numbers, rtol=0, atol=1e-7)
    np.testing.assert_allclose(notation.to_poses(notation.from_poses(poses, numbers)), poses, atol=1e-14)
