"""The data type of a robot's kinematics: what it refuses, and that its URDF says the same."""

from __future__ import annotations

import math
import re

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.urdf_documents import changed

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.chain import (
    MAX_CHAIN_JOINTS,
    MAX_MOVING_JOINTS,
    MAX_NAME_LENGTH,
    UNLIMITED_ANGLE,
    ChainJoint,
    KinematicChain,
)
from jointstiff.solver.robot.urdf import read_urdf, write_urdf

Z = np.array([0.0, 0.0, 1.0])
ANGLES = st.floats(-10.0, 10.0)


def joint(name: str, child: str, **changes: object) -> ChainJoint:
    fields = {
        "kind": "revolute",
        "rotation": np.eye(3),
        "translation": np.zeros(3),
        "axis": Z,
        "limits": (-1.0, 1.0),
    }
    return ChainJoint(name=name, child=child, **(fields | changes))


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
        (lambda: KinematicChain("r", "base", "base", ()), "no joint"),
        (lambda: chain_of(3, "fixed"), "fixed-only chain"),
        (lambda: chain_of(33), "33 moving joints"),
        (lambda: chain_of(65, "fixed"), "fixed-only chain"),
        (
            lambda: KinematicChain("r", "b", "l", (*fixed_joints(64), joint("j", "l"))),
            "65 joints",
        ),
        (
            lambda: KinematicChain("r", "b", "m", (joint("a", "l"), joint("a", "m"))),
            "2 joints are named 'a'",
        ),
        (lambda: KinematicChain("r", "b", "b", (joint("a", "b"),)), "2 links are named 'b'"),
        (lambda: KinematicChain("r", "b", "x", (joint("a", "l"),)), "not the flange 'x'"),
        (lambda: KinematicChain("", "b", "l", (joint("a", "l"),)), "missing or empty"),
        (lambda: KinematicChain("r", "", "l", (joint("a", "l"),)), "missing or empty"),
        (lambda: joint("", "l"), "missing or empty"),
        (lambda: joint("a", ""), "missing or empty"),
        (lambda: joint("a" * (MAX_NAME_LENGTH + 1), "l"), "201 characters"),
        (lambda: joint("a\x00b", "l"), "invisible"),
        (lambda: joint("a\u202eb", "l"), "invisible"),
        (lambda: joint("a\ud800", "l"), "invisible"),
        (lambda: joint(" a", "l"), "spaces"),
        (lambda: joint("a", "l", axis=2.0 * Z), "not a unit vector"),
        (lambda: joint("a", "l", axis=np.zeros(3)), "not a unit vector"),
        (lambda: joint("a", "l", rotation=2.0 * np.eye(3)), "not a rotation"),
        (lambda: joint("a", "l", rotation=-np.eye(3)), "not a rotation"),
        (lambda: joint("a", "l", translation=np.array([0.0, np.nan, 0.0])), "finite"),
        (lambda: joint("a", "l", translation=np.zeros(2)), "shape"),
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
    # The elementary rotations, in the order that URDF states.
    def about(axis: int, angle: float) -> np.ndarray:
        unit = np.eye(3)[axis]
        return (
            np.eye(3)
            + math.sin(angle) * pin.skew(unit)
            + (1 - math.cos(angle)) * (np.outer(unit, unit) - np.eye(3))
        )

    document = changed('rpy="0 0 0"', f'rpy="{roll:.17f} {pitch:.17f} {yaw:.17f}"')
    rotation = read_urdf(document, "a", "b").joints[0].rotation

    np.testing.assert_allclose(rotation, about(2, yaw) @ about(1, pitch) @ about(0, roll), atol=1e-14)


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
