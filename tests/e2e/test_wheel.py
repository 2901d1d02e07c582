"""The wheel in an empty environment: one package, beside others' that have our folders' names."""

from __future__ import annotations

import os
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NEIGHBOURS = ("service", "solver", "schemas")
"""Packages on PyPI that are not ours."""

CAMPAIGN = (
    f"NEIGHBOURS = {NEIGHBOURS}"
    + """
import json, re, subprocess, sys
from importlib.util import find_spec
import jointstiff
from jointstiff.simulator import default_arm, simulate_campaign

theirs = [find_spec(name).submodule_search_locations or find_spec(name).origin for name in NEIGHBOURS]
assert not any("jointstiff" in str(place) for place in theirs), theirs
command = [sys.executable, "-m", "jointstiff", "serve", "--port", "0", "--database", "sqlite:///wheel.db"]
with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
    try:
        address = re.search(r"http://\\S+:\\d+", process.stdout.readline())[0]
        with jointstiff.Client(address) as client:
            run = client.identify(simulate_campaign(default_arm()))
    finally:
        process.terminate()
print(json.dumps([run.state, len(run.result.joints)]))
"""
)


pytestmark = pytest.mark.process


def uv() -> str:
    found = shutil.which("uv", path=os.pathsep.join([os.environ["PATH"], str(ROOT / ".tools" / "bin")]))
    return found or pytest.skip("uv is not there; scripts/setup fetches it")


def run(*command: str, **options) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=240, **options)
    assert done.returncode == 0, done.stderr[-2000:]
    return done


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    run(uv(), "build", "--quiet", "--wheel", "--out-dir", str(folder), str(ROOT))
    (built,) = folder.glob("*.whl")
    return built


def test_the_wheel_holds_one_package(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    tops = {name.split("/")[0] for name in names if ".dist-info/" not in name}
    assert tops == {"jointstiff"}
    assert {"jointstiff/__init__.py", "jointstiff/service/static/index.html"} <= set(names)


def test_a_campaign_over_http_beside_packages_of_our_folders_names(wheel, tmp_path):
    python = tmp_path / "environment" / "bin" / "python"
    run(uv(), "venv", "--quiet", str(python.parents[1]))
    install = (uv(), "pip", "install", "--quiet", "--python", str(python))
    run(*install, "--requirement", str(ROOT / "requirements.lock"))
    run(*install, "--no-deps", str(wheel), *NEIGHBOURS)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = run(str(python), "-c", CAMPAIGN, cwd=tmp_path, env=environment)
    assert done.stdout.splitlines()[-1] == '["succeeded", 6]'
