"""The guard refuses hostile documents, and says where and why."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.hostile_urdfs import HOSTILE
from support.urdf_documents import BRANCHED

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.urdf import read_urdf


@pytest.mark.parametrize(("text", "where", "reason"), HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_documents(text: str, where: str, reason: str) -> None:
    with pytest.raises(RobotError) as refusal:
        read_urdf(text, "a", "b")
    error = refusal.value
    assert error.where == where
    assert reason in error.reason
    assert error.remedy
    assert len(str(error).encode("utf-8")) < 1_000


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
        ("flange", "finger_a", "joint", "a prismatic joint"),
        ("l2", "camera", "chain", "fixed-only chain"),
    ],
)
def test_base_and_flange(base: str, flange: str, where: str, reason: str) -> None:
    with pytest.raises(RobotError) as refusal:
        read_urdf(BRANCHED, base, flange)
    assert refusal.value.where.startswith(where)
    assert reason in refusal.value.reason
    assert len(str(refusal.value).encode("utf-8")) < 1_000


READ_ALL = """
from pathlib import Path
from support.hostile_urdfs import HOSTILE, LARGE
from jointstiff.solver.errors import RobotError

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
def test_hostile_documents_are_refused_in_bounded_memory_and_time() -> None:
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
