"""The data type of a robot's kinematics, its URDF, Pinocchio's model of it, and the joint map."""

from __future__ import annotations

import math
import re

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.urdf_documents import changed

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.chain import (
    MAX_CHAIN_JOINTS,
    MAX_MOVING_JOINTS,
    MAX_NAME_LENGTH,
    UNLIMITED_ANGLE,
    ChainJoint,
    DhRow,
    KinematicChain,
    dh_chain,
)
from jointstiff.solver.robot.configuration import Configurations, joint_frames
from jointstiff.solver.robot.model import JointMap, Robot
from jointstiff.solver.robot.urdf import read_urdf, write_urdf

Z = np.array([0.0, 0.0, 1.0])
ANGLES = st.floats(-10.0, 10.0)


def joint(name: str, child: str, **changes: object) -> ChainJoint:
    fields = {"kind": "revolute", "rotation": np.eye(3), "translation": np.zeros(3), "axis": Z}
    return ChainJoint(name=name, child=child, **(fields | {"limits": (-1.0, 1.0)} | changes))


def turned(name: str, child: str, **changes: object) -> ChainJoint:
    """A joint that stands askew, without limits."""
    fields = {"rotation": pin.rpy.rpyToMatrix(0.1, -0.2, 0.3), "translation": np.array([0.1, 0.2, 0.3])}
    return joint(name, child, **(fields | {"axis": np.array([0.6, 0.0, 0.8]), "limits": None} | changes))


def chain_of(count: int, kind: str = "revolute") -> KinematicChain:
    joints = tuple(joint(f"j{i}", f"l{i}", kind=kind) for i in range(1, count + 1))
    return KinematicChain("robot", "base", f"l{count}", joints)


def fixed_joints(count: int) -> list[ChainJoint]:
    return [joint(f"f{i}", f"m{i}", kind="fixed") for i in range(count)]


def test_names_and_moving_joints() -> None:
    joints = (joint("a", "l1"), joint("b", "l2", kind="fixed"), joint("c", "l3"))
    chain = KinematicChain("robot", "base", "l3", joints)

    assert chain.joint_names == ("a", "c")
    assert chain.revolute == (joints[0], joints[2])
    assert [each.is_moving for each in chain.joints] == [True, False, True]


def test_arrays_are_copied_and_read_only() -> None:
    translation = np.array([1.0, 2.0, 3.0])
    made = joint("a", "b", translation=translation)
    translation[0] = 9.0

    assert made.translation[0] == 1.0
    for array in (made.translation, made.rotation, made.axis):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_the_largest_chains_are_accepted() -> None:
    assert len(chain_of(MAX_MOVING_JOINTS).revolute) == 32
    KinematicChain("robot", "base", "l", (*fixed_joints(MAX_CHAIN_JOINTS - 1), joint("j", "l")))


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: KinematicChain("r", "base", "base", ()), "fixed-only chain"),
        (lambda: chain_of(3, "fixed"), "fixed-only chain"),
        (lambda: chain_of(33), "33 moving joints"),
        (lambda: chain_of(65, "fixed"), "fixed-only chain"),
        (lambda: KinematicChain("r", "b", "l", (*fixed_joints(64), joint("j", "l"))), "65 joints"),
        (lambda: KinematicChain("r", "b", "m", (joint("a", "l"), joint("a", "m"))), "2 joints are named 'a'"),
        (lambda: KinematicChain("r", "b", "b", (joint("a", "b"),)), "2 links are named 'b'"),
        (lambda: KinematicChain("", "b", "l", (joint("a", "l"),)), "missing or empty"),
        (lambda: KinematicChain("r", "", "l", (joint("a", "l"),)), "missing or empty"),
        (lambda: joint("", "l"), "missing or empty"),
        (lambda: joint("a", ""), "missing or empty"),
        (lambda: joint("a" * (MAX_NAME_LENGTH + 1), "l"), "201 characters"),
        (lambda: joint("a\x00b", "l"), "invisible"),
        (lambda: joint("a\u202eb", "l"), "invisible"),
        (lambda: joint("a\ud800", "l"), "invisible"),
        (lambda: joint(" a", "l"), "spaces"),
        (lambda: joint("a", "l", axis=2.0 * Z), "a unit axis"),
        (lambda: joint("a", "l", axis=np.zeros(3)), "a unit axis"),
        (lambda: joint("a", "l", rotation=2.0 * np.eye(3)), "not a rotation"),
        (lambda: joint("a", "l", rotation=-np.eye(3)), "not a rotation"),
        (lambda: joint("a", "l", translation=np.array([0.0, np.nan, 0.0])), "finite"),
        (lambda: joint("a", "l", limits=(1.0, -1.0)), "no range"),
        (lambda: joint("a", "l", limits=(-math.inf, 1.0)), "no range"),
        (lambda: joint("a", "l", limits=(2e6, 3e6)), "no range"),
    ],
)
def test_refusals(make: object, reason: str) -> None:
    with pytest.raises(RobotError, match=reason) as refusal:
        make()
    assert refusal.value.remedy
    assert refusal.value.where
    str(refusal.value).encode("utf-8")


@given(ANGLES, ANGLES, ANGLES)
def test_rotation_follows_the_urdf_convention(roll: float, pitch: float, yaw: float) -> None:
    document = changed('rpy="0 0 0"', f'rpy="{roll:.17f} {pitch:.17f} {yaw:.17f}"')
    rotation = read_urdf(document, "a", "b").joints[0].rotation
    # The elementary rotations, in the order that URDF states.
    expected = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
    np.testing.assert_allclose(rotation, expected, atol=1e-14)


@given(
    ANGLES,
    st.one_of(ANGLES, st.sampled_from([0.5, -0.5]).map(lambda half: half * math.pi)),
    ANGLES,
    st.sampled_from([0.0, 1e-16, 1e-12, 1e-9, 1e-8, 1e-5]),
)
def test_roll_pitch_yaw_are_exact_even_at_the_pole(roll: float, pitch: float, yaw: float, off: float) -> None:
    rotation = pin.rpy.rpyToMatrix(roll, pitch + off, yaw)
    chain = KinematicChain("r", "b", "l", (joint("a", "l", rotation=rotation),))
    again = read_urdf(write_urdf(chain), "b", "l").joints[0].rotation
    np.testing.assert_allclose(again, rotation, atol=2e-15)


NAMES = st.text(
    st.characters(exclude_categories=("C", "Z"), include_characters=" \"'<>&"), min_size=1, max_size=30
).filter(
    lambda name: name == name.strip() and name.isprintable() and not re.search(r"[$][({]", name)
)  # xacro
NUMBERS = st.floats(-100.0, 100.0)


@st.composite
def chains(draw: st.DrawFn) -> KinematicChain:
    names = draw(st.lists(NAMES, min_size=3, max_size=7, unique=True))
    joints = []
    for index, child in enumerate(names[1:]):
        angle = draw(ANGLES)
        limits = st.none() | st.tuples(st.floats(-9.0, 0.0), st.floats(0.0, 9.0))
        joints.append(
            joint(
                names[index],  # joints may be named as links are
                child,
                kind="revolute" if index == 0 else draw(st.sampled_from(["revolute", "fixed"])),
                rotation=pin.rpy.rpyToMatrix(*draw(st.tuples(ANGLES, ANGLES, ANGLES))),
                translation=np.array(draw(st.tuples(NUMBERS, NUMBERS, NUMBERS))),
                axis=np.array([math.cos(angle), 0.0, math.sin(angle)]),
                limits=draw(limits) if index else None,
            )
        )
    return KinematicChain(draw(NAMES), names[0], names[-1], tuple(joints))


@given(chains())
def test_urdf_reads_back_the_same(chain: KinematicChain) -> None:
    again = read_urdf(write_urdf(chain), chain.base, chain.flange)

    assert (again.name, again.base, again.flange) == (chain.name, chain.base, chain.flange)
    assert len(again.joints) == len(chain.joints)
    for ours, theirs in zip(chain.joints, again.joints, strict=True):
        assert (ours.name, ours.kind, ours.child) == (theirs.name, theirs.kind, theirs.child)
        np.testing.assert_array_equal(ours.translation, theirs.translation)
        np.testing.assert_allclose(ours.rotation, theirs.rotation, atol=2e-15)
        if ours.is_moving:
            assert ours.limits == theirs.limits
            np.testing.assert_allclose(ours.axis, theirs.axis, atol=1e-15)


def test_a_joint_without_limits_is_written_as_revolute() -> None:
    chain = KinematicChain("r", "b", "l", (joint("a", "l", limits=None),))
    assert 'type="revolute"' in write_urdf(chain)
    assert f'lower="{-UNLIMITED_ANGLE!r}" upper="{UNLIMITED_ANGLE!r}"' in write_urdf(chain)


def test_model_follows_the_chain() -> None:
    joints = (
        turned("mount", "pedestal", kind="fixed"),
        turned("zeta", "l1", limits=(-1.0, 2.0)),
        turned("spacer", "l2", kind="fixed"),
        turned("alpha", "l3"),
        turned("plate", "l4", kind="fixed"),
        turned("adapter", "flange", kind="fixed"),
    )
    chain = KinematicChain("arm", "base", "flange", joints)
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


def test_identity_leaves_angles_as_they_are_and_is_read_only() -> None:
    angles = np.random.default_rng(0).uniform(-3.0, 3.0, (5, 6))
    np.testing.assert_array_equal(JointMap.identity(6).model_angles(angles), angles)
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
