"""A service that is sent hostile programs answers others meanwhile, and ends when it is told to."""

from __future__ import annotations

import json
import signal
import threading
import time
from contextlib import suppress

import httpx2
import pytest
from support.processes import Service
from support.programs import options, path, tool_poses

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.programs import program_text

pytestmark = pytest.mark.process


@pytest.fixture
def service(tmp_path):
    running = Service(f"sqlite:///{tmp_path / 'jointstiff.db'}")
    try:
        yield running
    finally:
        running.stop()


def run_of(client):
    campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    robot = client.post("/v1/robots", json=campaign["robot"]).json()["id"]
    readings = campaign["measurement_set"] | {"robot_id": robot}
    measured = client.post("/v1/measurement-sets", json=readings).json()["id"]
    return client.post("/v1/runs", json={"measurement_set_id": measured}).json()["id"]


def post(client, run, text, **query):
    return client.post(
        "/v1/programs",
        files=[("files", ("path.src", text.encode()))],
        data={"options": json.dumps(options("krl") | {"run_id": run})},
        params=query,
    )


def test_sigterm_ends_a_service_that_reads_a_hostile_program(service):
    with httpx2.Client(base_url=service.url, timeout=100.0) as client:
        run = run_of(client)
        assert post(client, run, program_text("krl", tool_poses(path(3)))).status_code == 201
        hostile = "\n".join(f"x{i}=({'(' * 40}{i}{')' * 40})" for i in range(140_000))  # no two of a shape

        def send():
            with suppress(httpx2.HTTPError):
                post(client, run, hostile)

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


def test_the_service_waits_for_the_workers_of_a_long_program(service):
    with httpx2.Client(base_url=service.url, timeout=100.0) as client:
        run = run_of(client)
        text = program_text("krl", tool_poses(path(10_050)))
        assert post(client, run, text, wait=0).status_code == 202
        answer = post(client, run, text, wait=60)
        assert (answer.status_code, answer.json()["state"]) == (201, "succeeded")
