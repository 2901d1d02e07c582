"""Sound documents are understood as Pinocchio understands them; any other text is refused."""

from __future__ import annotations

import math
import re

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.examples import examples
from support.urdf_documents import BRANCHED, SMALL, changed, inertial, serial

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.inverse import flange_poses
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.robot.urdf import read_urdf, write_urdf


def flange_by_pinocchio(text: str, angles: dict[str, float], base: str, flange: str) -> np.ndarray:
    """Parse the original document, and ask for the flange in the base."""
    model = pin.buildModelFromXML(text)
    q = pin.neutral(model)
    for name, angle in angles.items():
        joint = model.joints[model.getJointId(name)]
        value = [angle] if joint.nq == 1 else [math.cos(angle), math.sin(angle)]
        q[joint.idx_q : joint.idx_q + joint.nq] = value
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    frame = [data.oMf[model.getFrameId(link, pin.FrameType.BODY)] for link in (base, flange)]
    return (frame[0].inverse() * frame[1]).homogeneous


def test_branched_robot() -> None:
    chain = read_urdf(BRANCHED, "base_link", "flange")

    assert chain.name == "branched"
    assert [joint.name for joint in chain.joints] == ["j1", "j2", "spacer", "j3", "flange"]
    assert chain.joint_names == ("j1", "j2", "j3")
    assert [joint.limits for joint in chain.revolute] == [(-3.1, 2.9), None, (0.0, 1.5)]
    np.testing.assert_array_equal(chain.revolute[2].axis, [1.0, 0.0, 0.0])  # URDF's default
    np.testing.assert_array_equal(chain.joints[2].translation, [0.1, 0.2, -0.3])
    assert "passwd" not in write_urdf(chain)


@pytest.mark.parametrize(
    ("base", "flange"), [("base_link", "flange"), ("l1", "flange"), ("base_link", "camera")]
)
def test_kinematics_are_those_of_the_original_document(base: str, flange: str) -> None:
    chain = read_urdf(BRANCHED, base, flange)
    q = np.random.default_rng(3).uniform(-3.0, 3.0, (20, len(chain.revolute)))
    for angles, pose in zip(q, flange_poses(Robot(chain), q), strict=True):
        named = dict(zip(chain.joint_names, angles, strict=True))
        np.testing.assert_allclose(pose, flange_by_pinocchio(BRANCHED, named, base, flange), atol=1e-14)


def test_the_small_robot_is_sound() -> None:
    assert read_urdf(SMALL, "a", "b").joint_names == ("j1",)
    assert read_urdf("\ufeff" + SMALL, "a", "b").joint_names == ("j1",)
    assert read_urdf(inertial(), "a", "b").joint_names == ("j1",)


@pytest.mark.parametrize(
    ("text", "limits"),
    [
        (changed('lower="-1" upper="1"', 'lower="-1e16" upper="1e16"'), None),
        (changed('lower="-1" ', ""), (0.0, 1.0)),
        (changed("revolute", "continuous"), None),
        (changed('lower="-1" upper="1"', 'lower="0" upper="0"'), (0.0, 0.0)),
    ],
)
def test_limits(text: str, limits: tuple[float, float] | None) -> None:
    assert read_urdf(text, "a", "b").joints[0].limits == limits


def test_axis_within_tolerance_is_normalised() -> None:
    chain = read_urdf(changed('axis xyz="0 0 1"', 'axis xyz="0.707 0 0.707"'), "a", "b")
    half = math.sqrt(0.5)
    np.testing.assert_allclose(chain.joints[0].axis, [half, 0.0, half], atol=1e-15)


@pytest.mark.parametrize(
    "text", [inertial("-1"), inertial("nan"), inertial(ixy="2"), inertial().replace("<inertia ", "<x ")]
)
def test_inertias_are_ignored(text: str) -> None:
    assert read_urdf(text, "a", "b").joint_names == ("j1",)


def test_largest_chain() -> None:
    assert Robot(read_urdf(serial(32), "a", "b")).n == 32


def test_a_document_of_a_thousand_joints_may_hold_a_short_chain() -> None:
    assert len(read_urdf(serial(1_000), "a", "l6").joints) == 6


def read_or_refuse(text: str, base: str = "base_link", flange: str = "flange") -> None:
    """Anything but a chain that Pinocchio takes or a RobotError fails the test."""
    try:
        robot = Robot(read_urdf(text, base, flange))
    except RobotError as error:
        str(error).encode("utf-8")
    else:
        assert robot.n == robot.model.nq


@given(st.text(), st.text(max_size=5), st.text(max_size=5))
def test_any_text(text: str, base: str, flange: str) -> None:
    read_or_refuse(text, base, flange)


VALUES = [match.span(1) for match in re.finditer(r'"([^"]*)"', BRANCHED)]
VALUE = (
    "|nan|inf|1e400|-0|0 0 0|1 0 0|1e-320 0 0|base_link|l1|l4|flange|j1|universe|&#0;|&#9;|&lt;|${x}|fixed"
    "|prismatic| "
)
NASTY = st.one_of(
    st.sampled_from(VALUE.split("|")),
    st.text(st.characters(exclude_characters='"<&'), max_size=8),
    st.floats().map(repr),
)


@examples(300)
@given(st.lists(st.tuples(st.sampled_from(VALUES), NASTY), min_size=1, max_size=3))
def test_other_values_in_a_sound_document(changes: list[tuple[tuple[int, int], str]]) -> None:
    text = BRANCHED
    for (start, end), value in sorted(dict(changes).items(), reverse=True):
        text = text[:start] + value + text[end:]
    read_or_refuse(text)


TAGS = re.findall(r"<[^<>]+>", BRANCHED)


@examples(300)
@given(st.data())
def test_a_sound_document_cut_and_pasted(data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(BRANCHED)))
    end = data.draw(st.integers(start, min(len(BRANCHED), start + 200)))
    paste = data.draw(st.one_of(st.sampled_from(TAGS), st.text(max_size=10), st.just("")))
    read_or_refuse(BRANCHED[:start] + paste + BRANCHED[end:])
