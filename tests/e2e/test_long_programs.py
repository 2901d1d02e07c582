"""Programs through a service and its workers: a long one in steps, a hostile one that holds up nobody."""

import json
import signal
import threading
import time
from contextlib import suppress

import httpx2
import numpy as np
import pytest
from support.api import posted
from support.processes import Service
from support.programs import options, path, tool_poses

from jointstiff.service.library.client import Client
from jointstiff.service.programs.formats import read_program
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.programs import program_text

pytestmark = pytest.mark.process

POINTS = 10_050
"""A few more than are corrected at once."""


def test_a_long_program_is_corrected_in_steps_by_workers(services):
    text = program_text("csv", tool_poses(path(POINTS)), 4).encode()
    seen = []
    with Client(services("sqlite").url) as client:
        campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
        run = client.identify(campaign)
        stored = client.measurement_sets.get(run.request.measurement_set_id)
        stated = options("csv") | {"run_id": run.id}
        found = client.programs.wait(client.programs.create(stated, files={"path.csv": text}), seen.append)
        assert found.state == "succeeded", found.error
        assert (found.progress.done, found.progress.total) == (POINTS, POINTS)
        assert found.result.corrected == POINTS
        assert all(step.unit == "points" for step in seen)
        (corrected,) = client.programs.files(found).values()
        program = read_program([("path.csv", corrected)])
        old = read_program([("path.csv", text)])
        moved = program.targets.values[:, :3] - old.targets.values[:, :3]
        assert 0.1 < np.linalg.norm(moved, axis=1).max() < 5.0  # mm
        assert client.file(found, "points.csv").count(b"\n") == POINTS + 1
        assert found.id in {listed.id for listed in client.programs.list(robot_id=stored.robot_id)}


@pytest.fixture
def service(tmp_path):
    running = Service(f"sqlite:///{tmp_path / 'jointstiff.db'}")
    try:
        yield running
    finally:
        running.stop()


def test_sigterm_ends_a_service_that_reads_a_hostile_program(service):
    with httpx2.Client(base_url=service.url, timeout=100.0) as client:
        run = posted(client, simulate_campaign(default_arm(), load="pull", configurations=12, seed=1))["id"]

        def post(text):
            return client.post(
                "/v1/programs",
                files=[("files", ("path.src", text.encode()))],
                data={"options": json.dumps(options("krl") | {"run_id": run})},
            )

        assert post(program_text("krl", tool_poses(path(3)))).status_code == 201
        hostile = "\n".join(f"x{i}=({'(' * 40}{i}{')' * 40})" for i in range(140_000))  # no two of a shape

        def send():
            with suppress(httpx2.HTTPError):
                post(hostile)

        sender = threading.Thread(target=send)
        sender.start()
        time.sleep(1.5)
        began = time.monotonic()
        with httpx2.Client(base_url=service.url, timeout=10.0) as other:
            assert other.get("/v1/runs").status_code == 200
        assert time.monotonic() - began < 10.0  # a deadline, not a figure
        service.process.send_signal(signal.SIGTERM)
        service.process.wait(timeout=20)
        sender.join(timeout=20)
        assert not sender.is_alive()
