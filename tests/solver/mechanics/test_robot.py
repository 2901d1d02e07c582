"""Kinematic chains, both DH conventions, Pinocchio's model, URDF and the joint map."""

from __future__ import annotations

import math
import re

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference.kinematics import flange_by_textbook, product_of_exponentials
from support.examples import examples

from jointstiff.schemas.robot import DhRow
from jointstiff.solver.errors import RobotError
from jointstiff.solver.mechanics.configuration import Configurations, flange_poses, joint_frames, skew
from jointstiff.solver.mechanics.robot import (
    MAX_NAME_LENGTH,
    UNLIMITED,
    ChainJoint,
    JointMap,
    KinematicChain,
    Robot,
    dh_chain,
)
from jointstiff.solver.mechanics.urdf import read_urdf, write_urdf

Z = np.array([0.0, 0.0, 1.0])
ANGLES = st.floats(-10.0, 10.0)


def joint(name, child, **changes):
    fields = {"kind": "revolute", "rotation": np.eye(3), "translation": np.zeros(3), "axis": Z}
    return ChainJoint(name=name, child=child, **(fields | {"limits": (-1.0, 1.0)} | changes))


def turned(name, child, **changes):
    """A joint that stands askew, without limits."""
    fields = {"rotation": pin.rpy.rpyToMatrix(0.1, -0.2, 0.3), "translation": np.array([0.1, 0.2, 0.3])}
    return joint(name, child, **(fields | {"axis": np.array([0.6, 0.0, 0.8]), "limits": None} | changes))


def chain_of(count, kind="revolute"):
    joints = tuple(joint(f"j{i}", f"l{i}", kind=kind) for i in range(1, count + 1))
    return KinematicChain("robot", "base", f"l{count}", joints)


def fixed_joints(count):
    return [joint(f"f{i}", f"m{i}", kind="fixed") for i in range(count)]


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
        (lambda: Robot(chain_of(3), JointMap.identity(2)), "^joint_map.matrix"),
        (lambda: JointMap.identity(33), "at most 32"),
    ],
)
def test_refusals(make, reason):
    with pytest.raises(RobotError, match=reason) as refusal:
        make()
    assert refusal.value.remedy
    assert refusal.value.where
    str(refusal.value).encode("utf-8")


@examples(300)
@given(
    ANGLES,
    st.one_of(ANGLES, st.sampled_from([0.5, -0.5]).map(lambda half: half * math.pi)),
    ANGLES,
    st.sampled_from([0.0, 1e-16, 1e-12, 1e-9, 1e-8, 1e-5]),
)
def test_roll_pitch_yaw_are_exact_even_at_the_pole(roll, pitch, yaw, off):
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
def chains(draw):
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


@examples(300)
@given(chains())
def test_urdf_reads_back_the_same(chain):
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


def test_a_joint_without_limits_is_written_as_revolute():
    chain = KinematicChain("r", "b", "l", (joint("a", "l", limits=None),))
    assert 'type="revolute"' in write_urdf(chain)
    assert f'lower="{-UNLIMITED!r}" upper="{UNLIMITED!r}"' in write_urdf(chain)


def test_the_cross_product_of_a_vector_is_a_matrix():
    a, b = np.random.default_rng(0).standard_normal((2, 5, 3))
    np.testing.assert_allclose((skew(a) @ b[..., None])[..., 0], np.cross(a, b), rtol=1e-15)


def test_model_follows_the_chain():
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

    assert robot.joint_names == ("zeta", "alpha")  # in the order of the chain, not of the alphabet
    assert robot.n == 2
    assert robot.chain is chain
    one = pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.2, 0.3), np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(robot.flange_placement.homogeneous, (one * one).homogeneous, atol=1e-15)
    np.testing.assert_array_equal(robot.limits, [[-1.0, 2.0], [-np.inf, np.inf]])


def random_chain(rng, count):
    joints = []
    for i in range(count):
        rotation, axis = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3)
        joints.append(
            joint(
                f"j{i}",
                f"l{i}",
                kind=("revolute", "fixed", "revolute", "prismatic")[i % 4],
                rotation=rotation * np.linalg.det(rotation),
                translation=rng.uniform(-0.3, 0.3, 3),
                axis=axis / np.linalg.norm(axis),
            )
        )
    return KinematicChain("arm", "base", f"l{count - 1}", tuple(joints))


@pytest.mark.parametrize(("joints", "count"), [*((n, 20) for n in range(1, 9)), (8, 1030)])
def test_kinematics_are_a_product_of_exponentials(joints, count):
    """1030 postures take more than a block."""
    rng = np.random.default_rng([joints, count])
    chain = random_chain(rng, joints)
    robot = Robot(chain)
    angles = np.where(robot.prismatic, 0.1, 1.0) * rng.uniform(-7.0, 7.0, (count, robot.n))
    found, (rotation, origin) = Configurations(robot, angles), joint_frames(robot, angles)
    for i, q in [*enumerate(angles)][-20:]:
        pose, frames, jacobian = product_of_exponentials(chain, q)
        for ours, exact in (
            (found.jacobian[i], jacobian),
            (found.flange_rotation[i], pose[:3, :3]),
            (found.flange_translation[i], pose[:3, 3]),
            (rotation[i], frames[:, :3, :3]),
            (origin[i], frames[:, :3, 3]),
        ):
            np.testing.assert_allclose(ours, exact.astype(float), rtol=0.0, atol=2e-15)


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
def test_joint_maps_that_are_refused(matrix, offset, where, reason):
    with pytest.raises(RobotError, match=reason) as refusal:
        JointMap.from_rows(matrix, offset)
    assert refusal.value.where == where


LENGTHS = st.floats(-2.0, 2.0)
TURNS = st.floats(-6.0, 6.0) | st.sampled_from([-1.0, -0.5, 0.0, 0.5, 1.0]).map(lambda half: half * math.pi)
KINDS = st.sampled_from(["revolute", "revolute", "prismatic"])
ROWS = st.lists(
    st.builds(DhRow, a=LENGTHS, alpha=TURNS, d=LENGTHS, theta=TURNS, kind=KINDS), min_size=1, max_size=8
)


@pytest.mark.parametrize("convention", ["standard", "modified"])
@examples(300)
@given(rows=ROWS, seed=st.integers(0, 2**32 - 1))
def test_flange_is_the_last_frame_of_the_table(convention, rows, seed):
    robot = Robot(dh_chain(rows, convention, "any"))
    q = np.random.default_rng(seed).uniform(-4.0, 4.0, len(rows))

    expected = flange_by_textbook(rows, convention, q)

    np.testing.assert_allclose(flange_poses(robot, q[None])[0], expected, atol=1e-13)


def row(**changes):
    """A row that may hold numbers that no message would."""
    return DhRow.model_construct(**({"a": 0.1, "alpha": 0.0, "d": 0.2, "theta": 0.0} | changes))


@pytest.mark.parametrize(
    ("rows", "where"),
    [
        ([], "model.rows"),
        ([row()] * 33, "model.rows"),
        ([row(), row(a=math.nan)], "model.rows[1].a"),
        ([row(a=101.0)], "model.rows[0].a"),
        ([row(d=-math.inf)], "model.rows[0].d"),
        ([row(alpha=1001.0)], "model.rows[0].alpha"),
        ([row(theta=-90_000.0)], "model.rows[0].theta"),
        ([row(lower=math.nan)], "model.rows[0].lower"),
        ([row(upper=1e300)], "model.rows[0].upper"),
        ([row(lower=1.0, upper=-1.0)], "joint 'joint_1' limits"),
    ],
)
@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_refusals_name_the_place(rows, where, convention):
    with pytest.raises(RobotError) as refusal:
        dh_chain(rows, convention, "any")
    assert refusal.value.where == where
