"""Services under load: two services on one PostgreSQL, a long program in steps, a hostile one."""

import json
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import pytest
from sqlalchemy import func, select
from support import in_process
from support.api import post, posted, stored_set
from support.processes import Service, free_port, ready, serving, until, working
from support.programs import options, path, tool_poses

from jointstiff.service.library.client import Client
from jointstiff.service.store.database import Database
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import job_steps, jobs
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.programs import program_text
from robotprograms.formats import read_program

pytestmark = pytest.mark.process

RUNS = 12
SEEDS = 3
DRAWS = 8_000
"""Of each run two steps, half a second."""


def request(set_id: str, number: int) -> dict[str, Any]:
    resampling = {"size": 100, "repetitions": DRAWS, "seed": number % SEEDS}
    return {"measurement_set_id": set_id, "resampling": resampling}


def on_sqlite(folder: Path, campaign: dict[str, Any]) -> list[Any]:
    """The results on SQLite, in one process without workers, by seed."""
    with Store.open(f"sqlite:///{folder / 'alone.db'}") as store:
        client = in_process.Client(store)
        set_id = stored_set(client, campaign)["id"]
        return [post(client, "/v1/runs", request(set_id, seed))["result"] for seed in range(SEEDS)]


def test_with_one_service_and_one_worker_killed_every_run_is_carried_out_once_with_the_same_bits(
    new_postgresql_database: Callable[[], str], tmp_path: Path
) -> None:
    database, campaign = new_postgresql_database(), simulate_campaign(default_arm(), configurations=200)
    with ExitStack() as stack:
        processes = [stack.enter_context(serving(database, 0, free_port())) for _ in range(2)]
        workers = [stack.enter_context(working(database, name)) for name in ("one", "two")]
        for process in (*processes, *workers):
            ready(process)
        services = [stack.enter_context(httpx2.Client(base_url=each.url, timeout=60)) for each in processes]
        left = services[0]
        set_id = stored_set(left, campaign)["id"]

        def posted(number: int, first: int) -> httpx2.Response:
            """Post to a service, and as a proxy does, to the next one if it is not there."""
            for service in services[first:] + services[:first]:
                try:
                    key = {"Idempotency-Key": f"run {number}"}
                    body = request(set_id, number)
                    return service.post("/v1/runs?wait=0", json=body, headers=key).raise_for_status()
                except httpx2.TransportError:
                    continue
            raise AssertionError("no service answers")

        def stored() -> list[dict[str, Any]]:
            return left.get("/v1/jobs", params={"limit": 100}).raise_for_status().json()["items"]

        with ThreadPoolExecutor(4) as pool:
            # Each run is posted to both services at once, by the same key.
            posts = [pool.submit(posted, number, first) for number in range(RUNS) for first in range(2)]
            until(lambda: len(stored()) > RUNS // 4)
            processes[1].kill()
            until(lambda: any(run["state"] == "running" for run in stored()))
            workers[0].kill()
            ids = [each.result().json()["id"] for each in posts]
        assert ids[::2] == ids[1::2]
        until(lambda: all(run["state"] not in {"queued", "running"} for run in stored()), seconds=150)

        assert {run["id"] for run in stored()} == set(ids)
        assert len(set(ids)) == RUNS
        expected = on_sqlite(tmp_path, campaign)
        for number, identifier in enumerate(ids[::2]):
            run = left.get(f"/v1/jobs/{identifier}").json()
            assert run["state"] == "succeeded", run["error"]
            assert run["result"] == expected[number % SEEDS]
            assert run["progress"]["done"] == DRAWS
            assert posted(number, 1).json()["id"] == identifier
    with closing(Database.open(database)) as opened, opened.reading() as connection:
        assert connection.execute(select(func.count()).select_from(job_steps)).scalar_one() == 0
        assert connection.execute(select(func.count()).select_from(jobs)).scalar_one() == RUNS


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
        found = client.corrections.wait(
            client.corrections.create(stated | {"format": "csv"}, files={"path.csv": text}), seen.append
        )
        assert found.state == "succeeded", found.error
        assert (found.progress.done, found.progress.total) == (POINTS, POINTS)
        assert found.result.program.corrected == POINTS
        assert all(step.unit == "points" for step in seen)
        (corrected,) = client.corrections.files(found).values()
        program = read_program([("path.csv", corrected)])
        old = read_program([("path.csv", text)])
        moved = program.targets.values[:, :3] - old.targets.values[:, :3]
        assert 0.1 < np.linalg.norm(moved, axis=1).max() < 5.0  # mm
        assert client.file(found, "rows.csv").count(b"\n") == POINTS + 1
        assert found.id in {listed.id for listed in client.corrections.list(robot_id=stored.robot_id)}


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
                "/v1/corrections",
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
            assert other.get("/v1/jobs").status_code == 200
        assert time.monotonic() - began < 10.0  # a deadline, not a figure
        service.process.send_signal(signal.SIGTERM)
        service.process.wait(timeout=20)
        sender.join(timeout=20)
        assert not sender.is_alive()
