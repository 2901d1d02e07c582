"""One thread of linear algebra in processes that we start; what the package is built from is in the image."""

import json
import os
import re
import subprocess
import sys
import tomllib
from contextlib import ExitStack
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from jointstiff.service.problems import EXTRAS
from jointstiff.service.process import ONE_THREAD, one_thread

PROGRAM = """
import os, sys
import jointstiff.service.cli.entry as entry
assert "numpy" not in sys.modules, "it has read the environment already"
sys.argv = ["jointstiff", "--version"]
try:
    entry.main()
finally:
    import numpy as np
    np.linalg.solve(np.eye(500), np.ones(500))
    print(len(os.listdir("/proc/self/task")) if sys.platform == "linux" else 1)
"""


@pytest.mark.process
def test_the_command_computes_with_one_thread():
    environment = {name: value for name, value in os.environ.items() if name not in ONE_THREAD}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=False
    )
    assert done.stdout.splitlines()[-1] == "1", done.stdout + done.stderr


def blas_threads():
    return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}


def test_a_computation_has_one_thread_of_linear_algebra_and_gives_the_others_back():
    """Computations of several threads overlap; the last one gives the threads back."""
    with ExitStack() as first, ExitStack() as second, threadpool_limits(2, user_api="blas"):
        first.enter_context(one_thread())
        second.enter_context(one_thread())
        assert blas_threads() == {1}
        first.close()
        assert blas_threads() == {1}
        second.close()
        assert blas_threads() == {2}


ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
WHEEL = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
HOOK = WHEEL["hooks"]["custom"].get("path", "hatch_build.py")
NEEDED = [
    *(name.split("/")[0] for name in WHEEL["only-include"]),
    HOOK,
    "dashboard",
    PROJECT["project"]["readme"],
    *PROJECT["project"]["license-files"],
    "pyproject.toml",
    "requirements.lock",
    "requirements-docs.lock",
    "docs",
    "docker/README.md",
    "CHANGELOG.md",
    "docker/build.lock",
    *(f"packages/robotprograms/{name}" for name in ("pyproject.toml", "README.md", "LICENSE", "src")),
]


def test_the_image_awaits_a_key_and_the_proxy_insists_on_tls():
    """Whoever publishes the image's port on all addresses opens nothing."""
    docker = ROOT / "docker"
    (command,) = re.findall(r"^CMD (.*)$", (docker / "Dockerfile").read_text(encoding="utf-8"), re.MULTILINE)
    assert json.loads(command) == ["serve", "--host", "0.0.0.0", "--port", "8000", "--await-key"]  # noqa: S104
    assert "header Strict-Transport-Security max-age=" in (docker / "Caddyfile").read_text(encoding="utf-8")


@pytest.mark.parametrize("guide", ["docker/README.md", "docs/upgrade.md"])
def test_what_brings_data_back_is_no_part_of_what_saves_them(guide):
    """Who pastes a block to save replaces nothing; what uses the database is stopped first."""
    blocks = re.findall(r"```sh\n(.*?)```", (ROOT / guide).read_text(encoding="utf-8"), re.DOTALL)
    saving = [block for block in blocks if "pg_dump" in block or "backup" in block]
    back = [block for block in blocks if "pg_restore" in block or "/saved.db /data" in block]
    assert saving
    assert back
    assert not [block for block in saving if block in back]
    if guide.startswith("docker"):
        found = [re.sub(r"#.*", "", block).split("\n")[1] for block in back]
        assert all(" stop " in first for first in found), found
        assert all("-wal" in block for block in back if "saved.db" in block)


@pytest.mark.parametrize("name", NEEDED)
def test_what_the_wheel_is_built_from_reaches_the_image(name):
    lines = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert (ROOT / name).exists()
    assert f"!{name}" in lines


def test_each_library_of_an_extra_is_known_by_the_extra_that_a_message_names():
    """But python-multipart, which FastAPI imports."""
    stated = PROJECT["project"]["optional-dependencies"]
    required = {
        (re.match(r"[\w-]+", each)[0].replace("-", "_"), extra)
        for extra, requirements in stated.items()
        for each in requirements
    }
    others = {(name, "service") for name in ("h5py", "jointstiff", "python_multipart", "pyyaml")}
    brought = {(name, "service") for name in ("anyio", "starlette", "yaml")} | {("polars", "frames")}
    assert set(EXTRAS.items()) == required - others | brought
