"""Robots: URDFs, kinematics by others' code, and inverse kinematics."""

import math
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference.kinematics import flange_by_pinocchio, flange_by_textbook, product_of_exponentials
from scipy.spatial.transform import Rotation, Slerp
from support.calibrated_arms import ARMS, arm
from support.examples import examples
from support.hostile_urdfs import BRANCHED, HOSTILE
from support.slides import arm_on_rail
from support.springs import robot_of

from jointstiff.schemas.robot import DhRow
from jointstiff.solver.errors import RobotError
from jointstiff.solver.mechanics.chain import ChainJoint, KinematicChain, chain_dh_rows
from jointstiff.solver.mechanics.inverse import (
    InverseKinematics,
    Unreached,
    _interpolate_poses,
    choose_postures,
)
from jointstiff.solver.mechanics.postures import Postures, flange_poses, skew
from jointstiff.solver.mechanics.robot import JointMap, Robot, fix_prismatic_joints
from jointstiff.solver.mechanics.urdf import read_urdf, write_urdf

Z = np.array([0.0, 0.0, 1.0])
ANGLES = st.floats(-10.0, 10.0)


def joint(name, child, **changes):
    fields = {"kind": "revolute", "rotation": np.eye(3), "translation": np.zeros(3), "axis": Z}
    return ChainJoint(name=name, child=child, **(fields | {"limits": (-1.0, 1.0)} | changes))


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
        limits = st.none() | st.tuples(st.floats(-9.0, -0.001), st.floats(0.0, 9.0))
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


def test_the_cross_product_of_a_vector_is_a_matrix():
    a, b = np.random.default_rng(0).standard_normal((2, 5, 3))
    np.testing.assert_allclose((skew(a) @ b[..., None])[..., 0], np.cross(a, b), rtol=1e-15)


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
    robot = Robot(chain.model())
    angles = np.where(robot.prismatic, 0.1, 1.0) * rng.uniform(-7.0, 7.0, (count, robot.n))
    found = Postures(robot, angles)
    rotation, origin = found.joint_frames
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
    robot = Robot(chain_dh_rows(rows, convention, "any").model())
    q = np.random.default_rng(seed).uniform(-4.0, 4.0, len(rows))

    expected = flange_by_textbook(rows, convention, q)

    np.testing.assert_allclose(flange_poses(robot, q[None])[0], expected, atol=1e-13)


@pytest.mark.parametrize(
    ("base", "flange"), [("base_link", "flange"), ("l1", "flange"), ("base_link", "camera")]
)
def test_kinematics_are_those_of_the_original_document(base, flange):
    chain = read_urdf(BRANCHED, base, flange)
    q = np.random.default_rng(3).uniform(-3.0, 3.0, (20, len(chain.moving)))
    for angles, pose in zip(q, flange_poses(Robot(chain.model()), q), strict=True):
        named = dict(zip(chain.joint_names, angles, strict=True))
        np.testing.assert_allclose(pose, flange_by_pinocchio(BRANCHED, named, base, flange), atol=1e-14)


def read_or_refuse(text, base="base_link", flange="flange"):
    """Anything but a robot with kinematics or a RobotError fails the test."""
    try:
        robot = Robot(read_urdf(text, base, flange).model())
    except RobotError as error:
        str(error).encode("utf-8")
    else:
        at = Postures(robot, np.zeros((1, robot.n)))
        assert np.isfinite(at.jacobian).all()


@examples(300)
@given(st.text(), st.text(max_size=5), st.text(max_size=5))
def test_any_text(text, base, flange):
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
def test_other_values_in_a_sound_document(changes):
    text = BRANCHED
    for (start, end), value in sorted(dict(changes).items(), reverse=True):
        text = text[:start] + value + text[end:]
    read_or_refuse(text)


TAGS = re.findall(r"<[^<>]+>", BRANCHED)


@examples(300)
@given(st.data())
def test_a_sound_document_cut_and_pasted(data):
    start = data.draw(st.integers(0, len(BRANCHED)))
    end = data.draw(st.integers(start, min(len(BRANCHED), start + 200)))
    paste = data.draw(st.one_of(st.sampled_from(TAGS), st.text(max_size=10), st.just("")))
    read_or_refuse(BRANCHED[:start] + paste + BRANCHED[end:])


@pytest.mark.parametrize(("text", "where", "reason"), HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_documents(text, where, reason):
    with pytest.raises(RobotError) as refusal:
        read_urdf(text, "a", "b")
    error = refusal.value
    assert error.where == where
    assert reason in error.reason
    assert error.remedy
    assert len(str(error).encode("utf-8")) < 1_000


READ_ALL = """
from pathlib import Path
from support.hostile_urdfs import HOSTILE, LARGE
from jointstiff.solver.errors import RobotError
from jointstiff.solver.mechanics.urdf import read_urdf

for text in [*(text for text, *_ in HOSTILE.values()), *LARGE.values()]:
    try:
        read_urdf(text, "a", "b")
    except RobotError:
        continue
    raise SystemExit("accepted " + text[:100])
print(Path("/proc/self/status").read_text())
"""


@pytest.mark.process
@pytest.mark.skipif(sys.platform != "linux", reason="reads the peak of memory as Linux tells it")
def test_hostile_documents_are_refused_in_bounded_memory_and_time():
    run = subprocess.run(
        [sys.executable, "-c", READ_ALL],
        capture_output=True,
        text=True,
        timeout=120,  # all together: a hang, not a benchmark
        check=False,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
    )
    assert run.returncode == 0, run.stderr
    (peak,) = (line.split()[1] for line in run.stdout.splitlines() if line.startswith("VmHWM"))
    assert int(peak) < 512 * 1024  # kB


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("crookedness", [0.0, 1e-3])
def test_the_angles_come_back_among_the_branches(name, crookedness):
    robot = arm(name, crookedness)
    q = np.random.default_rng(1).uniform(-2.8, 2.8, (200, 6))
    poses = flange_poses(robot, q)
    inverse = InverseKinematics(robot)
    branches = inverse.solve(poses)[0]
    turned = np.abs((branches - q[:, None] + np.pi) % (2 * np.pi) - np.pi).max(axis=2)
    far = np.nan_to_num(turned, nan=np.inf).min(axis=1)
    assert np.count_nonzero(far < 1e-8) >= 196  # a few postures are at a singularity
    case, branch = np.nonzero(np.isfinite(branches[:, :, 0]))
    np.testing.assert_allclose(flange_poses(robot, branches[case, branch]), poses[case], atol=1e-9)


def chosen(robot, poses, start):
    free = np.tile([-np.inf, np.inf], (len(poses), 6, 1))
    given, tested = np.full((len(poses), 6), np.nan), np.zeros(len(poses), dtype=bool)
    return choose_postures(InverseKinematics(robot), poses, given, free, tested, start)


def off(angles, truth):
    """Greatest difference of an angle, full turns aside."""
    apart = angles - truth
    return np.abs(apart - 2 * np.pi * np.round(apart / (2 * np.pi))).max(axis=-1)


def paths(count, seed=7):
    draw = np.random.default_rng(seed)
    for _ in range(count):
        turn = draw.standard_normal(6)
        wave = np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, 40))[:, None]
        yield draw.uniform(-2.8, 2.8, 6) + np.radians(6.0) * wave * turn / np.abs(turn).max()


@pytest.mark.parametrize(("name", "count"), [("ur5", 40), ("r2000ic", 40), *(
    pytest.param(name, 600, marks=pytest.mark.slow) for name in ARMS)])  # fmt: skip
def test_paths_stay_on_their_branch_or_are_refused(name, count):
    robot, refused = arm(name, 1e-3), 0
    for q in paths(count):
        joints, unreached = chosen(robot, flange_poses(robot, q), robot.joint_map.controller_angles(q[:1])[0])
        if unreached.any():
            refused += 1
        else:
            assert off(robot.joint_map.model_angles(joints), q).max() < 1e-6
    assert refused < 0.2 * count


def test_a_halved_step_is_half_of_the_way_and_of_the_turn():
    """Beside an interpolation of SciPy's."""
    begin, end = flange_poses(arm("ur5"), np.random.default_rng(3).uniform(-1.0, 1.0, (2, 6)))
    share = np.array([0.0, 0.25, 0.5, 1.0])
    poses = _interpolate_poses(np.tile(begin, (4, 1, 1)), np.tile(end, (4, 1, 1)), share)
    turned = Slerp([0.0, 1.0], Rotation.from_matrix([begin[:3, :3], end[:3, :3]]))(share)
    np.testing.assert_allclose(poses[:, :3, :3], turned.as_matrix(), atol=1e-12)
    for k in range(3):
        np.testing.assert_allclose(
            poses[:, k, 3], np.interp(share, [0.0, 1.0], [begin[k, 3], end[k, 3]]), atol=1e-12
        )


def test_a_path_through_a_singularity_is_refused_where_it_is():
    robot = arm("r2000ic", 1e-3)
    q = np.tile([0.3, -0.2, 0.4, 0.2, 0.0, 0.5], (41, 1))
    q[:, 4] = np.linspace(-0.1, 0.1, 41)
    q[:, 3] += np.linspace(0.0, 0.05, 41)
    _, unreached = chosen(robot, flange_poses(robot, q), robot.joint_map.controller_angles(q[:1])[0])
    refused = np.flatnonzero(unreached == Unreached.NOT_FOLLOWED)
    assert len(refused)
    assert (np.abs(q[refused, 4]) < 0.06).all()


def test_a_rail_that_moves_with_one_rotary_axis_of_the_controller_cannot_stand_still():
    matrix = np.eye(7)
    matrix[0, 4] = 0.3
    robot = Robot(robot_of(arm_on_rail()).model, JointMap(matrix, np.zeros(7)))
    with pytest.raises(RobotError, match="cannot stand still"):
        fix_prismatic_joints(robot, np.zeros(7))
