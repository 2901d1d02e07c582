"""The child process that vets URDFs: it answers, it is limited, and it may die in any way it likes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from jointstiff.service.resources import sandbox, sandbox_child
from jointstiff.service.resources.sandbox import MAX_ANSWER_BYTES, MAX_CHILDREN, vet_urdf
from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot import read_urdf
from jointstiff.solver.robot.xml_guard import MAX_BYTES

ROOT = Path(__file__).parents[3]


def serial(count: int) -> str:
    links = "".join(f'<link name="l{i}"><visual/></link>' for i in range(count + 1))
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/>'
        '<origin xyz="0.1 0 0.3" rpy="0.3 1.2 -0.4"/><axis xyz="0 0 1"/><limit lower="-1" upper="1"/>'
        "</joint>"
        for i in range(1, count + 1)
    )
    return f'<robot name="serial">{links}{joints}</robot>'


def python(code: str) -> list[str]:
    """Return the command of a child that runs this code instead."""
    return [sys.executable, "-P", "-c", code]


def test_a_sound_document() -> None:
    chain = vet_urdf(serial(6), "l0", "l6")

    direct = read_urdf(serial(6), "l0", "l6")
    assert chain.joint_names == direct.joint_names == ("j1", "j2", "j3", "j4", "j5", "j6")
    for ours, theirs in zip(chain.joints, direct.joints, strict=True):
        np.testing.assert_allclose(ours.rotation, theirs.rotation, atol=1e-15)
        np.testing.assert_array_equal(ours.translation, theirs.translation)
        assert ours.limits == theirs.limits


def test_from_any_working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit(7)")  # must not be found
    (tmp_path / "solver").mkdir()
    monkeypatch.chdir(tmp_path)
    assert vet_urdf(serial(1), "l0", "l1").joint_names == ("j1",)


@pytest.mark.parametrize(
    ("text", "flange", "where", "reason"),
    [
        (serial(1_000), "l1000", "chain", "1000 moving joints"),
        ('<!DOCTYPE r [<!ENTITY a "aaaa">]><robot name="&a;"/>', "l1", "line 1", "DTD"),
        (serial(2), "l9", "flange", "no link 'l9'"),
        ("\ud800", "l1", "line 1", "surrogate"),
        ("<" + " " * MAX_BYTES, "l1", "document", "bytes"),
        ("", "l1", "line 1", "no element"),
        (serial(1), "\ud800", "flange", "no link"),
        (serial(1).replace("j1", "universe"), "l1", "chain", "universe"),  # refused by Robot
    ],
)
def test_refusals_come_through(text: str, flange: str, where: str, reason: str) -> None:
    with pytest.raises(RobotError) as refusal:
        vet_urdf(text, "l0", flange)
    assert refusal.value.where == where
    assert reason in refusal.value.reason
    assert refusal.value.remedy


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "too much time or memory"),
        ("import os; os.abort()", "crashed (signal 6)"),
        ("raise SystemExit(3)", "exit status 3"),
        ("raise MemoryError", "exit status 1"),
        ("pass", "no answer that makes sense"),
        ("print('hello')", "no answer that makes sense"),
        ("print('{}')", "no answer that makes sense"),
        ("print('[' * 100_000)", "no answer that makes sense"),
        ("print('9' * 10_000)", "no answer that makes sense"),
        ("print('{\"urdf\": 1}')", "no answer that makes sense"),
        ('print(\'{"error": {"reason": "x"}}\')', "no answer that makes sense"),
        ("import sys; sys.stdout.buffer.write(b'\\xff\\xfe')", "no answer that makes sense"),
        ('print(\'{"urdf": "<robot/>"}\')', "name is missing"),
        (f"print('x' * {2 * MAX_ANSWER_BYTES})", "bytes of output"),
        ("while True: print('x' * 1000)", "bytes of output"),
    ],
)
def test_a_child_that_fails(code: str, reason: str) -> None:
    with pytest.raises(RobotError) as refusal:
        vet_urdf(serial(1), "l0", "l1", command=python(code))
    assert reason in refusal.value.reason
    assert len(str(refusal.value)) < 500


@pytest.mark.parametrize(
    "code",
    [
        "import time; time.sleep(60)",
        "import os, time; os.close(1); os.close(2); time.sleep(60)",
        "import os, time; os.fork(); time.sleep(60)",
        "while True: pass",
    ],
)
def test_a_child_that_hangs(code: str) -> None:
    before = time.monotonic()
    with pytest.raises(RobotError, match=r"stopped after 0\.5 s"):
        vet_urdf(serial(1), "l0", "l1", command=python(code), wall_seconds=0.5)
    assert time.monotonic() - before < 10.0


def test_long_messages_of_the_child_are_cut() -> None:
    error = {"where": None, "reason": "r" * 5_000, "remedy": "m" * 5_000}
    with pytest.raises(RobotError) as refusal:
        vet_urdf("", "a", "b", command=python(f"print({json.dumps({'error': error})!r})"))
    assert len(str(refusal.value)) < 2_100


def test_a_child_that_cannot_be_started_is_not_the_documents_fault() -> None:
    with pytest.raises(FileNotFoundError):
        vet_urdf(serial(1), "l0", "l1", command=["/nonexistent/python"])


def test_children_see_nothing_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JOINTSTIFF_DATABASE", "postgresql://user:secret@host/db")
    report = (
        "import json, os; print(json.dumps({'error': {'where': os.getcwd(), "
        "'reason': ' '.join(sorted(os.environ)), 'remedy': ''}}))"
    )
    with pytest.raises(RobotError) as refusal:
        vet_urdf("", "a", "b", command=python(report))
    allowed = {"LANG", "LC_CTYPE", "LD_LIBRARY_PATH", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"}
    assert set(refusal.value.reason.split()) <= allowed | {"PYTHONPATH"}
    assert refusal.value.where == "/"


def test_no_more_children_than_allowed_at_a_time(tmp_path: Path) -> None:
    code = f"""
import json, os, pathlib, time
folder = pathlib.Path({str(tmp_path)!r})
mine = folder / str(os.getpid())
mine.touch()
time.sleep(0.2)
print(json.dumps({{"error": {{"where": None, "reason": str(len(list(folder.iterdir()))), "remedy": ""}}}}))
mine.unlink()
"""

    def count(_index: int) -> int:
        with pytest.raises(RobotError) as refusal:
            vet_urdf("", "a", "b", command=python(code))
        return int(refusal.value.reason)

    with ThreadPoolExecutor(3 * MAX_CHILDREN) as pool:
        assert max(pool.map(count, range(3 * MAX_CHILDREN))) <= MAX_CHILDREN


def limited(code: str) -> subprocess.CompletedProcess[str]:
    """Run code in a process that has limited itself as the child does."""
    apply = "from service.sandbox_child import apply_limits; apply_limits()\n"
    environment = sandbox._environment() | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(python(apply + code), capture_output=True, text=True, env=environment, check=False)


def test_limits_are_in_force() -> None:
    names = ["RLIMIT_CPU", "RLIMIT_AS", "RLIMIT_FSIZE", "RLIMIT_CORE", "RLIMIT_NOFILE", "RLIMIT_NPROC"]
    run = limited(
        "import resource, json\n"
        f"print(json.dumps([resource.getrlimit(getattr(resource, name)) for name in {names}]))"
    )
    wanted = [sandbox_child.CPU_SECONDS, sandbox_child.MEMORY_BYTES, 0, 0, sandbox_child.OPEN_FILES, 0]
    for (soft, hard), most in zip(json.loads(run.stdout), wanted, strict=True):
        assert soft == hard <= most


def test_memory_is_limited() -> None:
    assert "MemoryError" in limited(f"bytearray({sandbox_child.MEMORY_BYTES})").stderr


def test_nothing_can_be_written(tmp_path: Path) -> None:
    run = limited(f"import pathlib; pathlib.Path({str(tmp_path / 'x')!r}).write_text('x')")
    assert "File too large" in run.stderr
    assert (tmp_path / "x").stat().st_size == 0


def test_files_are_few() -> None:
    assert "Too many open files" in limited("x = [open('/dev/null') for _ in range(100)]").stderr


def test_no_process_can_be_started() -> None:
    as_nobody = "import os; os.geteuid() or os.setuid(65534)\n"  # the superuser may, all the same
    assert "BlockingIOError" in limited(as_nobody + "os.fork()").stderr


def test_numpy_and_pinocchio_come_after_the_limits() -> None:
    code = "import sys, service.sandbox_child; print(set(sys.modules) & {'numpy', 'pinocchio', 'pydantic'})"
    run = subprocess.run(
        python(code),
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    assert run.stdout == "set()\n"
