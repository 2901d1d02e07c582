"""Robots that are refused: chains, joints, tables and maps of joints, with place, reason and remedy."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from support.hostile_urdfs import BRANCHED

from jointstiff.schemas.robot import DhRow
from jointstiff.solver.errors import RobotError
from jointstiff.solver.mechanics.chain import ChainJoint, KinematicChain, chain_dh_rows
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import flange_poses
from jointstiff.solver.mechanics.robot import JointMap, Robot, fix_prismatic_joints
from jointstiff.solver.mechanics.urdf import quote, read_urdf, write_urdf

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


def table(*rows, convention="standard"):
    """Return the chain of rows, each stated by what is unusual in it."""
    usual = {"a": 0.1, "alpha": 0.0, "d": 0.2, "theta": 0.0}
    return chain_dh_rows([DhRow.model_construct(**(usual | row)) for row in rows], convention, "any")


def branched(base, flange):
    return read_urdf(BRANCHED, base, flange)


def refusals():
    """Yield each statement of the data file, and what is said of it."""
    text = Path(__file__).with_name("refused_robots.txt").read_text(encoding="utf-8")
    lines = text.partition("\n\n")[2].splitlines()
    return list(zip(lines[::2], map(str.strip, lines[1::2]), strict=True))


@pytest.mark.parametrize(("statement", "said"), refusals())
def test_a_robot_is_refused_with_place_reason_and_remedy(statement, said):
    with pytest.raises(RobotError) as caught:
        eval(statement)  # noqa: S307 - our own file
    error = caught.value
    line = f"{error.where}: {error.reason}; {error.remedy}"
    assert line == said or (said.endswith("…") and line.startswith(said[:-1]))


def test_chains_at_the_limits_are_taken():
    assert len(chain_of(32).joints) == 32
    assert len(behind_fixed(63).joints) == 64
    assert joint("a" * 200, "l").name == "a" * 200


def test_the_chain_of_a_branched_document_is_read_in_order():
    chain = branched("base_link", "flange")
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


def test_inverse_kinematics_need_six_revolute_joints():
    with pytest.raises(RobotError) as caught:
        InverseKinematics(Robot(table(*[{}] * 5).model()))
    assert str(caught.value) == (
        "robot: the robot has 5 joints; inverse kinematics needs an arm with six revolute joints"
    )


def test_rows_of_either_convention_are_checked():
    with pytest.raises(RobotError, match="101 m is not a finite number within ±100 m"):
        table({"a": 101.0}, convention="modified")


def test_a_quoted_text_is_short_and_can_be_printed():
    assert quote("ab", 2) == "'ab'"
    assert quote("é\n", 1) == "'\\xe9'…"


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
    still = fix_prismatic_joints(robot, q[0])
    assert still.joint_names == ("a", "c")
    found = flange_poses(still, still.joint_map.model_angles(q[:, [0, 2]]))
    np.testing.assert_allclose(found, flange_poses(robot, joint_map.model_angles(q)), rtol=0, atol=1e-14)
