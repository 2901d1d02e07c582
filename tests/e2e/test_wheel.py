"""The wheel in an empty environment: one package, beside others' that have our folders' names."""

import os
import zipfile

import pytest
from support.wheel import ROOT, run, uv

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


def test_the_wheel_holds_one_package(built_wheel):
    with zipfile.ZipFile(built_wheel) as archive:
        names = archive.namelist()
    tops = {name.split("/")[0] for name in names if ".dist-info/" not in name}
    assert tops == {"jointstiff"}
    needed = {"jointstiff/__init__.py", "jointstiff/py.typed", "jointstiff/service/static/index.html"}
    assert needed <= set(names)


@pytest.mark.slow
def test_a_campaign_over_http_beside_packages_of_our_folders_names(built_wheel, tmp_path):
    python = tmp_path / "environment" / "bin" / "python"
    run(uv(), "venv", "--quiet", str(python.parents[1]))
    install = (uv(), "pip", "install", "--quiet", "--python", str(python))
    run(*install, "--requirement", str(ROOT / "requirements.lock"))
    run(*install, "--no-deps", str(built_wheel), *NEIGHBOURS)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = run(str(python), "-c", CAMPAIGN, cwd=tmp_path, env=environment)
    assert done.stdout.splitlines()[-1] == '["succeeded", 6]'
