"""Long runs through real processes on real databases: carried out by workers, cancelled, killed and resumed.

Whatever happens on the way, a run has the numbers of the same run carried out at once in one process.
"""

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import httpx2
import psycopg
import pytest
from sqlalchemy import func, select
from support.api import CANCEL, job_at, stored_set
from support.processes import LONGEST_SECONDS, free_port, ready, serving, until, workers_of, working

import jointstiff
from jointstiff.schemas.run import Campaign
from jointstiff.service.store.database import Database
from jointstiff.service.store.tables import job_steps, jobs
from jointstiff.simulator import default_arm, simulate_campaign

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="processes are looked up in /proc"),
]

OPEN = {"queued", "running"}
RESAMPLING = {"size": 100, "repetitions": 40_000, "seed": 5}
"""Of the campaign below ten steps, two or three seconds."""
LONGEST = RESAMPLING | {"repetitions": 100_000}


@pytest.fixture(scope="module")
def campaign() -> dict[str, Any]:
    return simulate_campaign(default_arm(), load="pull", configurations=400, seed=1)


@pytest.fixture(scope="module")
def undisturbed(campaign: dict[str, Any]) -> dict[str, Any]:
    """The numbers of the run, carried out here without workers."""
    document = Campaign.model_validate_json(json.dumps(campaign | {"run": {"resampling": RESAMPLING}}))
    run = jointstiff.identify(document, document.run)
    assert run.state == "succeeded"
    return numbers(json.loads(run.model_dump_json()))


@pytest.fixture(scope="module", params=["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)])
def new_database(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[], str]:
    """Makes a fresh database and returns its URL."""
    if request.param == "sqlite":
        return lambda: f"sqlite:///{tmp_path_factory.mktemp('long') / 'jointstiff.db'}"
    return request.getfixturevalue("new_postgresql_database")


@pytest.fixture(scope="module")
def database(new_database: Callable[[], str]) -> str:
    return new_database()


@pytest.fixture(scope="module")
def client(database: str) -> Iterator[httpx2.Client]:
    """A client of a service whose two workers were started apart from it, all on a new database at once."""
    with ExitStack() as stack:
        workers = [stack.enter_context(working(database, name)) for name in ("here", "elsewhere")]
        service = stack.enter_context(serving(database, 0, free_port()))
        for process in (*workers, service):
            ready(process)
        yield stack.enter_context(connected(service))


@pytest.fixture(scope="module")
def set_id(client: httpx2.Client, campaign: dict[str, Any]) -> str:
    return stored_set(client, campaign)["id"]


def test_a_run_that_is_not_waited_for_is_accepted_and_ends_by_itself(
    client: httpx2.Client, set_id: str, undisturbed: dict[str, Any]
) -> None:
    answer = post_run(client, set_id, RESAMPLING)
    assert answer.status_code == 202
    accepted = answer.json()
    assert answer.headers["location"] == f"/v1/jobs/{accepted['id']}"
    assert accepted["state"] in OPEN
    assert accepted["result"] is None
    progress = accepted["progress"]
    assert (progress["total"], progress["unit"]) == (40_000, "resamples")

    told = list(followed(client, answer.headers["location"]))

    done = [data["progress"]["done"] for _, data in told]
    assert done == sorted(done)
    assert len(set(done)) > 2
    assert [name for name, _ in told] == ["progress"] * (len(told) - 1) + ["end"]
    assert told[-1][1]["state"] == "succeeded"
    assert done[-1] == 40_000
    assert numbers(client.get(answer.headers["location"]).json()) == undisturbed


def test_a_cancelled_run_stops_within_a_step_and_says_how_far_it_came(
    client: httpx2.Client, set_id: str, database: str
) -> None:
    address = post_run(client, set_id, LONGEST).headers["location"]
    until(lambda: client.get(address).json()["progress"]["done"] > 0)

    answer = client.patch(job_at(address), json=CANCEL)

    assert answer.status_code == 200
    cancelled = answer.json()
    assert (cancelled["state"], cancelled["result"], cancelled["error"]) == ("cancelled", None, None)
    assert 0 < cancelled["progress"]["done"] < 100_000
    assert cancelled["provenance"]["ended_at"] is not None
    time.sleep(1.0)
    assert steps_of(database, cancelled["id"]) == (1, 0), "its steps are gone, and none comes late"
    assert client.get(address).json() == cancelled
    assert client.patch(job_at(address), json=CANCEL).json() == cancelled
    assert [data["state"] for _, data in followed(client, address)] == ["cancelled"]


def test_a_run_survives_the_death_of_worker_and_service(
    new_database: Callable[[], str], campaign: dict[str, Any], undisturbed: dict[str, Any]
) -> None:
    database, port = new_database(), free_port()
    with ExitStack() as stack:
        service = ready(stack.enter_context(serving(database, 1, port)))
        client = stack.enter_context(connected(service))
        address = post_run(client, stored_set(client, campaign)["id"], RESAMPLING).headers["location"]
        before = further(client, address, 0)
        (worker,) = workers_of(database)
        os.kill(worker, signal.SIGKILL)
        further(client, address, before)
        assert workers_of(database) != [worker]
        service.kill()
        service.wait()
        until(lambda: not workers_of(database))

        service = ready(stack.enter_context(serving(database, 2, port)))
        until(lambda: client.get(address).json()["state"] not in OPEN)
        assert numbers(client.get(address).json()) == undisturbed
        assert len(client.get("/v1/jobs").json()["items"]) == 1
        assert client.get(address).json()["progress"]["done"] == 40_000
        assert steps_of(database, address.rpartition("/")[2]) == (1, 0)
        service.terminate()
        assert service.wait(LONGEST_SECONDS) == 0
        assert not workers_of(database)


def test_a_run_survives_statements_that_are_cancelled(
    new_postgresql_database: Callable[[], str], campaign: dict[str, Any], undisturbed: dict[str, Any]
) -> None:
    """As by a time limit of the server: such a fault is no result of a step."""
    database = new_postgresql_database()
    with (
        working(database, "worker") as worker,
        serving(database, 0, free_port()) as service,
        connected(ready(service)) as client,
        psycopg.connect(database, autocommit=True) as connection,
    ):
        ready(worker)
        address = post_run(client, stored_set(client, campaign)["id"], RESAMPLING).headers["location"]
        further(client, address, 0)
        connection.execute(
            "CREATE FUNCTION cancel() RETURNS trigger LANGUAGE plpgsql AS "
            "$$ BEGIN RAISE EXCEPTION 'cancelled' USING ERRCODE = 'query_canceled'; END $$"
        )
        table = "job_steps"
        connection.execute(
            f"CREATE TRIGGER cancel BEFORE INSERT ON {table} FOR EACH ROW EXECUTE FUNCTION cancel()"
        )
        time.sleep(2.0)
        connection.execute(f"DROP TRIGGER cancel ON {table}")
        assert client.get(address).json()["state"] == "running"
        until(lambda: client.get(address).json()["state"] not in OPEN)
        assert numbers(client.get(address).json()) == undisturbed


# Requests


def connected(service: subprocess.Popen[str]) -> httpx2.Client:
    return httpx2.Client(base_url=service.url, timeout=60.0)


def post_run(
    client: httpx2.Client, set_id: str, resampling: dict[str, int], *, wait: int = 0, **options: Any
) -> httpx2.Response:
    body = {"measurement_set_id": set_id, "resampling": resampling}
    return client.post("/v1/runs", params={"wait": wait}, json=body, **options)


def followed(client: httpx2.Client, address: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Names and data of a run's events until the stream ends."""
    with client.stream("GET", f"{job_at(address)}/events") as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        name = ""
        for line in answer.iter_lines():
            field, _, value = line.partition(": ")
            if field == "event":
                name = value
            elif field == "data":
                yield name, json.loads(value)


def further(client: httpx2.Client, address: str, done: int) -> int:
    """How many draws are done, as soon as it is more than that; the run must not have ended by then."""
    until(lambda: client.get(address).json()["progress"]["done"] > done)
    run = client.get(address).json()
    assert run["state"] == "running"
    return run["progress"]["done"]


def numbers(run: dict[str, Any]) -> dict[str, Any]:
    """A run without its ids and times."""
    provenance = {name: run["provenance"][name] for name in ("versions", "input_hash")}
    request = run["request"] | {"measurement_set_id": None}
    return {**run, "id": None, "request": request, "provenance": provenance}


def steps_of(database: str, run_id: str) -> tuple[int, int]:
    """How many rows a run has, and how many its steps."""
    runs = select(func.count()).where(jobs.c.id == run_id)
    steps = select(func.count()).where(job_steps.c.job_id == run_id)
    with closing(Database.open(database)) as opened, opened.reading() as connection:
        return connection.execute(runs).scalar_one(), connection.execute(steps).scalar_one()
