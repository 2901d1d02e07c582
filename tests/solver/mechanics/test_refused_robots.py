"""Robots that are refused: chains, joints, tables and maps of joints, with place, reason and remedy."""

import math

import numpy as np
import pinocchio as pin
import pytest
from support.calibrated_arms import ARMS, chain_rows
from support.hostile_urdfs import BRANCHED

from jointstiff.schemas.robot import DhRow
from jointstiff.solver.errors import RobotError
from jointstiff.solver.mechanics.chain import ChainJoint, KinematicChain, dh_chain
from jointstiff.solver.mechanics.inverse import InverseKinematics, flange_poses
from jointstiff.solver.mechanics.robot import JointMap, Robot, standing_still
from jointstiff.solver.mechanics.urdf import quoted, read_urdf, write_urdf

UNIT = {"kind": "revolute", "rotation": np.eye(3), "translation": np.zeros(3), "axis": np.eye(3)[2]}


def joint(name, child, **changes):
    return ChainJoint(name=name, child=child, **(UNIT | {"limits": (-1.0, 1.0)} | changes))


def chain_of(count, kind="revolute"):
    joints = (joint(f"j{i}", f"l{i}", kind=kind) for i in range(1, count + 1))
    return KinematicChain("robot", "base", f"l{count}", tuple(joints))


def behind_fixed(count):
    """Return a moving joint behind so many fixed ones."""
    fixed = (joint(f"f{i}", f"m{i}", kind="fixed") for i in range(count))
    return KinematicChain("r", "b", "l", (*fixed, joint("j", "l")))


def refusal(make):
    with pytest.raises(RobotError) as caught:
        make()
    return caught.value.where, caught.value.reason, caught.value.remedy


CLOSER = "choose a base and a flange closer to each other"
BETWEEN = "choose a base and a flange with moving joints between them"


@pytest.mark.parametrize(
    ("make", "where", "reason", "remedy"),
    [
        (lambda: KinematicChain("r", "base", "base", ()), "chain",
         "a fixed-only chain: there is no moving joint between 'base' and 'base'", BETWEEN),
        (lambda: chain_of(3, "fixed"), "chain",
         "a fixed-only chain: there is no moving joint between 'base' and 'l3'", BETWEEN),
        (lambda: chain_of(33), "chain",
         "the chain from 'base' to 'l33' has 33 moving joints", f"use at most 32: {CLOSER}"),
        (lambda: behind_fixed(64), "chain",
         "the chain from 'b' to 'l' has 65 joints, fixed ones included", f"use at most 64: {CLOSER}"),
        (lambda: KinematicChain("r", "b", "m", (joint("a", "l"), joint("a", "m"))), "joint 'a'",
         "2 joints are named 'a'", "give each joint a unique name"),
        (lambda: KinematicChain("r", "b", "b", (joint("a", "b"),)), "link 'b'",
         "2 links are named 'b'", "give each link a unique name"),
        (lambda: KinematicChain("", "b", "l", (joint("a", "l"),)), "the robot",
         "the name is missing or empty", "give it a name"),
        (lambda: KinematicChain("r", "", "l", (joint("a", "l"),)), "the base link",
         "the name is missing or empty", "give it a name"),
        (lambda: joint("a", ""), "joint 'a' child", "the name is missing or empty", "give it a name"),
        (lambda: joint("", "l"), "a joint", "the name is missing or empty", "give it a name"),
        (lambda: joint("a" * 201, "l"), "a joint",
         f"the name has 201 characters; it begins '{'a' * 40}'", "use at most 200 characters"),
    ],
)  # fmt: skip
def test_a_chain_has_moving_joints_and_unique_names(make, where, reason, remedy):
    assert refusal(make) == (where, reason, remedy)


def test_chains_at_the_limits_are_taken():
    assert len(chain_of(32).joints) == 32
    assert len(behind_fixed(63).joints) == 64
    assert joint("a" * 200, "l").name == "a" * 200


@pytest.mark.parametrize("name", ["a\x00b", "a\u202eb", "a\ud800", " a"])
def test_a_name_can_be_printed(name):
    assert refusal(lambda: joint(name, "l")) == (
        "a joint",
        f"the name {name!r} has invisible characters, or spaces at an end",
        "use printable characters and no space at either end",
    )


@pytest.mark.parametrize(
    "changes",
    [
        {"axis": np.array([0.0, 0.0, 2.0])}, {"axis": np.zeros(3)}, {"rotation": 2.0 * np.eye(3)},
        {"rotation": -np.eye(3)}, {"translation": np.array([0.0, np.nan, 0.0])},
    ],
)  # fmt: skip
def test_a_joint_has_a_rotation_a_finite_translation_and_a_unit_axis(changes):
    assert refusal(lambda: joint("a", "l", **changes)) == (
        "joint 'a'",
        "the joint's frame is not a rotation, a finite translation and a unit axis",
        "give an orthonormal matrix with determinant 1, and normalise the axis",
    )


@pytest.mark.parametrize(
    ("limits", "shown"),
    [((1.0, -1.0), "1 and -1"), ((-math.inf, 1.0), "-inf and 1"), ((2e6, 3e6), "2e+06 and 3e+06")],
)
def test_limits_leave_a_range(limits, shown):
    assert refusal(lambda: joint("a", "l", limits=limits)) == (
        "joint 'a' limits",
        f"the joint limits {shown} rad leave no range",
        "give a finite lower limit that does not exceed the upper one, or no limits",
    )


SQUARE = "give a square matrix"
SIZE = "give an n × n matrix and n offsets; n is the number of moving joints, at most 32"
WITHIN = "give numbers within ±1000"
SINGULAR = "the matrix is singular: different controller angles give the same model angles"
INVERTIBLE = "give an invertible matrix"


@pytest.mark.parametrize(
    ("rows", "offset", "where", "reason", "remedy"),
    [
        ([[1.0, 0.0]], [0.0, 0.0], "matrix", "the matrix has 1 rows of 2 numbers", SQUARE),
        ([[1.0, 0.0], [0.0]], [0.0, 0.0], "matrix", "the matrix has 2 rows of 1 or 2 numbers", SQUARE),
        ([], [], "matrix", "the matrix has 0 rows of no numbers", SQUARE),
        ([[]], [], "matrix", "the matrix has 1 rows of 0 numbers", SQUARE),
        (np.eye(2), [0.0], "matrix", "the matrix has shape (2, 2), the offset 1 numbers", SIZE),
        (np.eye(33), [0.0] * 33, "matrix", "the matrix has shape (33, 33), the offset 33 numbers", SIZE),
        (np.diag([1, np.nan]), [0, 0], "matrix", "a number is not finite, or too large", WITHIN),
        (np.diag([1, 1e300]), [0, 0], "matrix", "a number is not finite, or too large", WITHIN),
        (np.diag([1, 1001]), [0, 0], "matrix", "a number is not finite, or too large", WITHIN),
        ([[1.0]], [math.inf], "offset", "a number is not finite, or too large", WITHIN),
        ([[1.0, 2.0], [2.0, 4.0]], [0.0, 0.0], "matrix", SINGULAR, INVERTIBLE),
        (np.diag([1, 1e-9]), [0, 0], "matrix", SINGULAR, INVERTIBLE),
        ([[1e-200]], [0.0], "matrix", SINGULAR, INVERTIBLE),
        ([[0.0]], [0.0], "matrix", SINGULAR, INVERTIBLE),
    ],
)  # fmt: skip
def test_a_joint_map_is_square_finite_and_invertible(rows, offset, where, reason, remedy):
    rows = [[float(each) for each in row] for row in rows]
    assert refusal(lambda: JointMap.from_rows(rows, offset)) == (f"joint_map.{where}", reason, remedy)


def test_a_map_and_an_inverse_fit_the_robot():
    assert refusal(lambda: Robot(chain_of(3).model(), JointMap.identity(2))) == (
        "joint_map.matrix",
        "the joint map has 2 joints, but the robot has 3",
        "give a 3 × 3 matrix and 3 offsets",
    )
    five = Robot(dh_chain(chain_rows(ARMS["ur5"][1][:5]), "standard", "five").model())
    assert refusal(lambda: InverseKinematics(five)) == (
        "robot", "the robot has 5 joints", "inverse kinematics needs an arm with six revolute joints"
    )  # fmt: skip


def row(**changes):
    return DhRow.model_construct(**({"a": 0.1, "alpha": 0.0, "d": 0.2, "theta": 0.0} | changes))


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize(
    ("rows", "where", "reason"),
    [
        ([row(), row(a=math.nan)], "[1].a", "nan m is not a finite number within ±100 m"),
        ([row(a=101.0)], "[0].a", "101 m is not a finite number within ±100 m"),
        ([row(d=-math.inf)], "[0].d", "-inf m is not a finite number within ±100 m"),
        ([row(alpha=1001.0)], "[0].alpha", "1001 rad is not a finite number within ±6.28319 rad"),
        ([row(theta=-90_000.0)], "[0].theta", "-90000 rad is not a finite number within ±6.28319 rad"),
        ([row(lower=math.nan)], "[0].lower", "nan rad is not a finite number within ±1000 rad"),
        ([row(upper=1e300)], "[0].upper", "1e+300 rad is not a finite number within ±1000 rad"),
    ],
)
def test_a_row_of_a_table_has_lengths_in_metres_and_angles_in_radians(convention, rows, where, reason):
    assert refusal(lambda: dh_chain(rows, convention, "any")) == (
        f"model.rows{where}", reason, "check the number; lengths are in m, angles in rad, not in degrees"
    )  # fmt: skip


@pytest.mark.parametrize("count", [0, 33])
def test_a_table_has_1_to_32_rows(count):
    said = "model.rows", f"{count} rows", "give 1 to 32 rows, one per joint"
    assert refusal(lambda: dh_chain([row()] * count, "standard", "any")) == said


LINKS = "use one of the links 'world', 'base_link', 'l1', 'l2', 'l3', 'l4', 'flange', 'finger_a' and 3 more"
ONLY = "only revolute, continuous, prismatic and fixed joints are supported there: "
FIX = f"{ONLY}fix it at its position, or choose another base or flange"
BELOW = "choose a base on the way from the root to the flange"


@pytest.mark.parametrize(
    ("base", "flange", "said"),
    [
        ("x", "flange", ("base", "there is no link 'x' for the base frame", LINKS)),
        ("j1", "flange", ("base", "there is no link 'j1' for the base frame", LINKS)),
        ("\ud800", "flange", ("base", "there is no link '\\ud800' for the base frame", LINKS)),
        ("x" * 10_000, "flange", ("base", f"there is no link '{'x' * 60}' for the base frame", LINKS)),
        ("base_link", "flansch", ("flange", "there is no link 'flansch' for the flange frame", LINKS)),
        ("base_link", "", ("flange", "there is no link '' for the flange frame", LINKS)),
        ("flange", "flange", ("flange", "base and flange are the same link, 'flange'",
                              "choose a flange with moving joints between the base and it")),
        ("flange", "base_link", ("flange", "the flange 'base_link' is not below the base 'flange'", BELOW)),
        ("camera", "flange", ("flange", "the flange 'flange' is not below the base 'camera'", BELOW)),
        ("l1", "tag", ("joint 'tag'", "there is a planar joint between base and flange", FIX)),
        ("world", "flange",
         ("joint 'world_joint'", "there is a floating joint between base and flange", FIX)),
        ("flange", "finger_b", ("joint 'grip_b' <mimic>", "there is a mimic joint between base and flange",
                                "remove <mimic>, and describe the coupling in `joint_map`")),
        ("l2", "camera", ("chain", "a fixed-only chain: there is no moving joint between 'l2' and 'camera'",
                          BETWEEN)),
    ],
)  # fmt: skip
def test_base_and_flange_are_links_with_a_chain_between_them(base, flange, said):
    assert refusal(lambda: read_urdf(BRANCHED, base, flange)) == said


def test_the_chain_of_a_branched_document_is_read_in_order():
    chain = read_urdf(BRANCHED, "base_link", "flange")
    assert (chain.name, chain.joint_names) == ("branched", ("j1", "j2", "j3"))
    assert [(each.name, each.child, each.kind, each.limits) for each in chain.joints] == [
        ("j1", "l1", "revolute", (-3.1, 2.9)),
        ("j2", "l2", "revolute", None),
        ("spacer", "l3", "fixed", None),
        ("j3", "l4", "revolute", (0.0, 1.5)),
        ("flange", "flange", "fixed", None),
    ]
    second = chain.joints[1]
    assert second.translation == pytest.approx([0.3, -0.1, 0.7])
    assert second.axis == pytest.approx(np.array([1.0, -2.0, 3.0]) / np.sqrt(14.0))
    assert second.rotation[0] == pytest.approx([-0.894312, 0.228451, -0.38473], abs=1e-6)
    assert second.rotation[2] == pytest.approx([-0.389418, -0.820856, 0.41779], abs=1e-6)
    assert "passwd" not in write_urdf(chain)


def test_a_chain_is_written_with_limits_that_no_joint_reaches():
    lines = write_urdf(KinematicChain("r", "b", "l", (joint("a", "l", limits=None),))).splitlines()
    assert lines[:6] == [
        '<robot name="r">', '  <link name="b" />', '  <link name="l" />',
        '  <joint name="a" type="revolute">', '    <parent link="b" />', '    <child link="l" />',
    ]  # fmt: skip
    assert lines[7:9] == [
        '    <axis xyz="0.0 0.0 1.0" />',
        '    <limit lower="-1000000.0" upper="1000000.0" effort="0" velocity="0" />',
    ]


def test_a_quoted_text_is_short_and_can_be_printed():
    assert quoted("ab", 2) == "'ab'"
    assert quoted("é\n", 1) == "'\\xe9'…"


PLACED = {"rotation": pin.rpy.rpyToMatrix(0.1, -0.2, 0.3), "translation": np.array([0.1, 0.2, 0.3])}


def askew(name, child, **changes):
    return joint(name, child, **({**PLACED, "axis": np.array([0.6, 0.0, 0.8]), "limits": None} | changes))


def test_joints_keep_their_order_and_fixed_ones_move_the_flange():
    chain = KinematicChain("arm", "base", "flange", (
        askew("mount", "pedestal", kind="fixed"), askew("zeta", "l1", limits=(-1.0, 2.0)),
        askew("spacer", "l2", kind="fixed"), askew("alpha", "l3"),
        askew("plate", "l4", kind="fixed"), askew("adapter", "flange", kind="fixed"),
    ))  # fmt: skip
    robot = Robot(chain.model())
    one = pin.SE3(PLACED["rotation"], PLACED["translation"])
    assert (robot.joint_names, robot.n) == (("zeta", "alpha"), 2)
    assert robot.limits.tolist() == [[-1.0, 2.0], [-np.inf, np.inf]]
    np.testing.assert_allclose(
        robot.flange_placement.homogeneous, (one * one).homogeneous, rtol=0, atol=1e-15
    )


def test_an_arm_whose_linear_axes_stand_still_is_the_same_arm():
    slide = {"kind": "prismatic", "limits": (-1.0, 1.0)}
    joints = askew("a", "l1"), askew("b", "l2", **slide), askew("c", "l3"), askew("d", "l4", **slide)
    matrix = np.array([[1, 0, 0, 0], [0, 2, 0, 0], [0.5, 0, -1, 0], [0, 0, 0, 1.0]])
    joint_map = JointMap.from_rows(matrix.tolist(), [0.1, 0.2, 0.3, 0.4])
    robot = Robot(KinematicChain("arm", "base", "l4", joints).model(), joint_map)
    q = np.array([[0.3, 0.1, -0.5, 0.2], [-0.7, 0.1, 0.4, 0.2]])
    still = standing_still(robot, q[0])
    assert still.joint_names == ("a", "c")
    found = flange_poses(still, still.joint_map.model_angles(q[:, [0, 2]]))
    np.testing.assert_allclose(found, flange_poses(robot, joint_map.model_angles(q)), rtol=0, atol=1e-14)
