"""Sound documents are understood as Pinocchio understands them; others are refused, with where and why."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference.kinematics import flange_by_pinocchio
from support.examples import examples
from support.hostile_urdfs import HOSTILE
from support.urdf_documents import BRANCHED

from jointstiff.solver.errors import RobotError
from jointstiff.solver.mechanics.configuration import Configurations, flange_poses
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.urdf import quoted, read_urdf, write_urdf


def test_branched_robot():
    chain = read_urdf(BRANCHED, "base_link", "flange")

    assert chain.name == "branched"
    assert [joint.name for joint in chain.joints] == ["j1", "j2", "spacer", "j3", "flange"]
    assert chain.joint_names == ("j1", "j2", "j3")
    assert [joint.limits for joint in chain.moving] == [(-3.1, 2.9), None, (0.0, 1.5)]
    np.testing.assert_array_equal(chain.moving[2].axis, [1.0, 0.0, 0.0])  # URDF's default
    np.testing.assert_array_equal(chain.joints[2].translation, [0.1, 0.2, -0.3])
    assert "passwd" not in write_urdf(chain)


@pytest.mark.parametrize(
    ("base", "flange"), [("base_link", "flange"), ("l1", "flange"), ("base_link", "camera")]
)
def test_kinematics_are_those_of_the_original_document(base, flange):
    chain = read_urdf(BRANCHED, base, flange)
    q = np.random.default_rng(3).uniform(-3.0, 3.0, (20, len(chain.moving)))
    for angles, pose in zip(q, flange_poses(Robot(chain), q), strict=True):
        named = dict(zip(chain.joint_names, angles, strict=True))
        np.testing.assert_allclose(pose, flange_by_pinocchio(BRANCHED, named, base, flange), atol=1e-14)


def read_or_refuse(text, base="base_link", flange="flange"):
    """Anything but a robot with kinematics or a RobotError fails the test."""
    try:
        robot = Robot(read_urdf(text, base, flange))
    except RobotError as error:
        str(error).encode("utf-8")
    else:
        at = Configurations(robot, np.zeros((1, robot.n)))
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
    assert (quoted("ab", 2), quoted("é\n", 1)) == ("'ab'", "'\\xe9'…")


@pytest.mark.parametrize(
    ("base", "flange", "where", "reason"),
    [
        ("x", "flange", "base", "no link 'x'"),
        ("base_link", "flansch", "flange", "no link 'flansch'"),
        ("base_link", "", "flange", "no link ''"),
        ("\ud800", "flange", "base", r"no link '\ud800'"),
        ("x" * 10_000, "flange", "base", "no link"),
        ("j1", "flange", "base", "no link 'j1'"),
        ("flange", "flange", "flange", "same link"),
        ("flange", "base_link", "flange", "not below the base"),
        ("l1", "tag", "joint", "planar"),
        ("camera", "flange", "flange", "not below the base"),
        ("world", "flange", "joint", "a floating joint"),
        ("flange", "finger_b", "joint", "a mimic joint"),
        ("l2", "camera", "chain", "fixed-only chain"),
    ],
)
def test_base_and_flange(base, flange, where, reason):
    with pytest.raises(RobotError) as refusal:
        read_urdf(BRANCHED, base, flange)
    assert refusal.value.where.startswith(where)
    assert reason in refusal.value.reason
    assert len(str(refusal.value).encode("utf-8")) < 1_000


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
