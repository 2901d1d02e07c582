"""Pinocchio's model of a chain, and the joint map."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.chain import ChainJoint, KinematicChain
from jointstiff.solver.robot.configuration import Configurations, joint_frames
from jointstiff.solver.robot.dh import DhRow, dh_chain
from jointstiff.solver.robot.model import JointMap, Robot


def joint(name: str, child: str, **changes: object) -> ChainJoint:
    fields = {
        "kind": "revolute",
        "rotation": pin.rpy.rpyToMatrix(0.1, -0.2, 0.3),
        "translation": np.array([0.1, 0.2, 0.3]),
        "axis": np.array([0.6, 0.0, 0.8]),
        "limits": None,
    }
    return ChainJoint(name=name, child=child, **(fields | changes))


def test_model_follows_the_chain() -> None:
    chain = KinematicChain(
        "arm",
        "base",
        "flange",
        (
            joint("mount", "pedestal", kind="fixed"),
            joint("zeta", "l1", limits=(-1.0, 2.0)),
            joint("spacer", "l2", kind="fixed"),
            joint("alpha", "l3"),
            joint("plate", "l4", kind="fixed"),
            joint("adapter", "flange", kind="fixed"),
        ),
    )
    robot = Robot(chain)

    assert robot.n == robot.model.nq == robot.model.nv == 2
    assert robot.joint_names == ("zeta", "alpha")  # in the order of the chain, not of the alphabet
    assert robot.n == 2
    assert robot.chain is chain
    one = pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.2, 0.3), np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(robot.flange_placement.homogeneous, (one * one).homogeneous, atol=1e-15)
    np.testing.assert_allclose(
        robot.model.jointPlacements[1].homogeneous, (one * one).homogeneous, atol=1e-15
    )
    np.testing.assert_array_equal(robot.limits, [[-1.0, 2.0], [-np.inf, np.inf]])


def test_flange_joint_is_the_last_even_without_a_fixed_joint_behind_it() -> None:
    robot = Robot(KinematicChain("arm", "b", "f", (joint("a", "l"), joint("c", "f"))))
    assert robot.n == 2
    np.testing.assert_array_equal(robot.flange_placement.homogeneous, np.eye(4))


def test_a_one_sided_limit() -> None:
    robot = Robot(dh_chain([DhRow(0.0, 0.0, 1.0, 0.0, lower=-2.0)], "standard", "arm"))
    np.testing.assert_array_equal(robot.limits, [[-2.0, np.inf]])


@pytest.mark.parametrize(
    ("joint_name", "flange"),
    [("same", "same"), ("a & <b> \"c\" 'd'", "x  y"), ("Gelenk é 軸 😀", "µ"), ("root_joint", "universe")],
)
def test_names_that_could_be_misunderstood(joint_name: str, flange: str) -> None:
    robot = Robot(KinematicChain("<&>", "b", flange, (joint(joint_name, flange),)))
    assert tuple(robot.model.names)[1:] == (joint_name,)
    assert robot.n == 1


def test_pinocchios_own_name_is_refused() -> None:
    with pytest.raises(RobotError, match="reserved") as refusal:
        joint("universe", "f")
    assert refusal.value.where == "joint 'universe'"
    assert joint("universe", "f", kind="fixed").name == "universe"


def product_of_exponentials(chain: KinematicChain, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the flange's pose (4, 4) and the spatial Jacobian (6, n), in extended precision."""
    angles, pose, columns = iter(q.astype(np.longdouble)), np.eye(4, dtype=np.longdouble), []
    for each in chain.joints:
        step = np.eye(4, dtype=np.longdouble)
        step[:3, :3], step[:3, 3] = each.rotation, each.translation
        pose = pose @ step
        if not each.is_moving:
            continue
        axis = pose[:3, :3] @ each.axis
        columns.append(np.concatenate([np.cross(pose[:3, 3], axis), axis]))
        angle, (x, y, z) = next(angles), each.axis.astype(np.longdouble)
        K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn = np.eye(4, dtype=np.longdouble)
        turn[:3, :3] += np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
        pose = pose @ turn
    return pose, np.stack(columns, axis=1)


def random_chain(rng: np.random.Generator, count: int) -> KinematicChain:
    joints = []
    for i in range(count):
        rotation, axis = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3)
        joints.append(
            joint(
                f"j{i}",
                f"l{i}",
                kind="fixed" if i % 4 == 1 else "revolute",
                rotation=rotation * np.linalg.det(rotation),
                translation=rng.uniform(-0.3, 0.3, 3),
                axis=axis / np.linalg.norm(axis),
            )
        )
    return KinematicChain("arm", "base", f"l{count - 1}", tuple(joints))


def test_kinematics_are_a_product_of_exponentials() -> None:
    rng = np.random.default_rng(11)
    for count in range(1, 9):
        chain = random_chain(rng, count)
        robot = Robot(chain)
        angles = rng.uniform(-3.0, 3.0, (20, robot.n))
        found = Configurations(robot, angles)
        for i, q in enumerate(angles):
            pose, jacobian = product_of_exponentials(chain, q)
            np.testing.assert_allclose(found.jacobian[i], jacobian, rtol=0.0, atol=2e-15)
            np.testing.assert_allclose(found.flange_rotation[i], pose[:3, :3], rtol=0.0, atol=2e-15)
            np.testing.assert_allclose(found.flange_translation[i], pose[:3, 3], rtol=0.0, atol=2e-15)


@pytest.mark.parametrize("count", [1, 19, 1030])  # the last takes more than a block
def test_kinematics_are_pinocchios(count: int) -> None:
    rng = np.random.default_rng(count)
    robot = Robot(random_chain(rng, 8))
    angles = rng.uniform(-7.0, 7.0, (count, robot.n))
    found, (rotation, origin) = Configurations(robot, angles), joint_frames(robot, angles)
    model, data = robot.model, robot.model.createData()
    jacobian = np.array([pin.computeJointJacobians(model, data, q) for q in angles])
    np.testing.assert_allclose(found.jacobian, jacobian, rtol=0.0, atol=1e-14)
    for i in (0, count - 1):
        pin.forwardKinematics(model, data, angles[i])
        flange = data.oMi[robot.n] * robot.flange_placement
        np.testing.assert_allclose(found.flange_rotation[i], flange.rotation, rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(found.flange_translation[i], flange.translation, rtol=0.0, atol=1e-14)
        for j in range(robot.n):
            np.testing.assert_allclose(rotation[i, j], data.oMi[j + 1].rotation, rtol=0.0, atol=1e-14)
            np.testing.assert_allclose(origin[i, j], data.oMi[j + 1].translation, rtol=0.0, atol=1e-14)


def test_joint_map_of_another_size_is_refused() -> None:
    chain = dh_chain([DhRow(0.1, 0.0, 0.0, 0.0)] * 3, "standard", "arm")
    with pytest.raises(RobotError) as refusal:
        Robot(chain, JointMap.identity(2))
    assert refusal.value.where == "joint_map.matrix"
    assert Robot(chain).joint_map.n == 3


def test_model_angles_of_coupled_axes() -> None:
    # FANUC: q3 = -(theta2 + theta3); the offset is added after the matrix.
    coupled = JointMap.from_rows([[1, 0, 0], [0, 1, 0], [0, -1, -1]], [0.0, 0.5, 0.0])
    angles = coupled.model_angles(np.array([[0.1, 0.2, 0.3], [1.0, 2.0, 3.0]]))
    np.testing.assert_allclose(angles, [[0.1, 0.7, -0.5], [1.0, 2.5, -5.0]], atol=1e-15)


def test_identity_leaves_angles_as_they_are() -> None:
    angles = np.random.default_rng(0).uniform(-3.0, 3.0, (5, 6))
    np.testing.assert_array_equal(JointMap.identity(6).model_angles(angles), angles)


def test_joint_map_is_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        JointMap.identity(2).matrix[0, 0] = 2.0


@pytest.mark.parametrize(
    ("matrix", "offset", "where", "reason"),
    [
        ([[1.0, 0.0]], [0.0, 0.0], "joint_map.matrix", "1 rows of 2"),
        ([[1.0, 0.0], [0.0]], [0.0, 0.0], "joint_map.matrix", "2 rows of 1 or 2"),
        ([], [], "joint_map.matrix", "0 rows"),
        ([[]], [], "joint_map.matrix", "rows of 0"),
        ([[1.0, 0.0], [0.0, 1.0]], [0.0], "joint_map.matrix", "offset 1"),
        ([[1.0, 0.0], [0.0, math.nan]], [0.0, 0.0], "joint_map.matrix", "not finite"),
        ([[1.0, 0.0], [0.0, 1e300]], [0.0, 0.0], "joint_map.matrix", "not finite"),
        ([[1.0]], [math.inf], "joint_map.offset", "not finite"),
        ([[1.0, 2.0], [2.0, 4.0]], [0.0, 0.0], "joint_map.matrix", "singular"),
        ([[1.0, 0.0], [0.0, 1e-9]], [0.0, 0.0], "joint_map.matrix", "singular"),
        ([[1e-200]], [0.0], "joint_map.matrix", "singular"),
        ([[0.0]], [0.0], "joint_map.matrix", "singular"),
    ],
)
def test_joint_maps_that_are_refused(
    matrix: list[list[float]], offset: list[float], where: str, reason: str
) -> None:
    with pytest.raises(RobotError, match=reason) as refusal:
        JointMap.from_rows(matrix, offset)
    assert refusal.value.where == where


def test_joint_map_of_too_many_joints_is_refused() -> None:
    with pytest.raises(RobotError, match="at most 32"):
        JointMap.identity(33)
