"""What commands start and follow."""

import json
import os
import signal
import socket
import subprocess
import sys
from functools import partial

import httpx2
import pytest
from support.processes import LONGEST_SECONDS
from support.shared_data import shared
from support.terminal import terminal

from jointstiff.service.cli.measure import _parse_force

run = partial(terminal, width=160)


@pytest.fixture
def campaign(tmp_path):
    path = tmp_path / "campaign.json"
    assert run("simulate", path, "--load", "dead_weight", "--seed", 2).exit_code == 0
    return path


def test_negative_stiffness_is_shown_as_what_it_is(tmp_path):
    document = shared("fanuc_r2000ic/campaign")
    del document["robot"]["joint_map"]
    path = tmp_path / "fanuc.json"
    path.write_text(json.dumps(document))
    assert "-1.86" in run("identify", path, "--no-positive").stdout
    constrained = run("identify", path).stdout
    assert "rigid" in constrained
    assert "cannot distinguish the joint from a rigid" in constrained


def test_one_number_is_a_weight_that_pulls_down():
    assert _parse_force("200") == _parse_force("-200") == _parse_force("0,0,-200") == (0.0, 0.0, -200.0)


def test_serve_on_a_port_in_use(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        shown = run("serve", "--port", port, "--database", f"sqlite:///{tmp_path / 'x.db'}")
    assert shown.exit_code == 2
    assert f"cannot listen on 127.0.0.1:{port}" in shown.stderr


def test_post_follows_a_long_run(campaign, service):
    document = json.loads(campaign.read_text())
    document["run"] = {"resampling": {"size": 10, "repetitions": 100_000}}
    campaign.write_text(json.dumps(document))
    shown = run("post", campaign, "--server", service.url)
    assert shown.exit_code == 0, shown.stderr
    addresses = [line for line in shown.stdout.splitlines() if line.startswith(service.url)]
    assert [httpx2.get(each).status_code for each in addresses] == [200, 200, 200]
    assert "Joint stiffness" in shown.stdout
    assert "100000 fits" in shown.stdout


@pytest.mark.process
def test_the_database_is_one_file_after_the_service_ends(tmp_path):
    path = tmp_path / "x.db"
    process = subprocess.Popen(
        [sys.executable, "-m", "jointstiff", "serve", "--port", "0", "--database", f"sqlite:///{path}"],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    assert str(path) in process.stdout.readline() + process.stdout.readline()
    process.terminate()
    assert process.wait(timeout=LONGEST_SECONDS) in {0, -signal.SIGTERM}
    process.stdout.close()
    assert [found.name for found in tmp_path.iterdir()] == ["x.db"]
