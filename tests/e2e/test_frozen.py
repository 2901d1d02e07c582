"""Workers that are stopped, hang or die over the same step, and namesakes: real processes, real databases."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import httpx2
import pytest
from support.api import CANCEL, job_at, stored_set
from support.processes import LONGEST_SECONDS, free_port, ready, serving, until, working

from jointstiff.simulator import default_arm, simulate_campaign

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="states of processes are read in /proc"),
]

OPEN = {"queued", "running"}
_HOOK = """
import os, pathlib, signal, sys, threading, time

mark = pathlib.Path({mark!r})

def is_first():
    try:
        mark.touch(exist_ok=False)
    except FileExistsError:
        return False
    mark.write_text(str(os.getpid()))
    return True

if {word!r} in sys.orig_argv:
    from jointstiff.service.kinds.run.work import RunWork
    import sqlalchemy as sa
    from jointstiff.service.store.jobs import Steps
    from jointstiff.service.store.tables import jobs
    store_result, compute = Steps.store_result, RunWork.compute
"""
STOPPED_INSIDE_A_TRANSACTION = """
    def stop_inside(steps, job_id, span, result):
        if is_first():
            lock = sa.update(jobs).where(jobs.c.id == job_id).values(name=jobs.c.name)
            with steps._database.writing() as connection:
                connection.execute(lock)
                os.kill(os.getpid(), signal.SIGSTOP)
                for _ in range(100):  # this thread may go on for a moment: it is stopped inside any of these
                    connection.execute(lock)
        return store_result(steps, job_id, span, result)
    Steps.store_result = stop_inside
"""
HANGS = """
    def hang(work, span):
        if is_first():
            threading.Event().wait()
        return compute(work, span)
    RunWork.compute = hang
"""
DIES = """
    def die(work, span):
        os.kill(os.getpid(), signal.SIGKILL)
    RunWork.compute = die
"""


@pytest.fixture
def hooked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str], Path]:
    """Call it to let processes with a word in their command run some code; it returns the first's file."""

    def hook(word: str, code: str) -> Path:
        mark = tmp_path / "mark"
        (tmp_path / "sitecustomize.py").write_text(_HOOK.format(mark=str(mark), word=word) + code)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        return mark

    return hook


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'jointstiff.db'}"
    return request.getfixturevalue("new_postgresql_database")()


def post_run(client: httpx2.Client, repetitions: int = 40_000) -> str:
    """Post a run of ten steps, two or three seconds; return its address."""
    campaign = simulate_campaign(default_arm(), load="pull", configurations=400, seed=1)
    body: dict[str, Any] = {"measurement_set_id": stored_set(client, campaign)["id"]}
    body["resampling"] = {"size": 100, "repetitions": repetitions, "seed": 5}
    return client.post("/v1/runs?wait=0", json=body).raise_for_status().headers["location"]


def ended(client: httpx2.Client, address: str, seconds: float = 150) -> dict[str, Any]:
    """Return a run once it has ended. It must not be without progress for longer than a time.

    That a worker is gone is known after 30 s and a look. How fast the other one is then is up to the machine.
    """
    furthest, deadline = -1, 0.0
    while True:
        run: dict[str, Any] = client.get(address).json()
        if run["state"] not in OPEN:
            return run
        done = (run["progress"] or {"done": 0})["done"]
        if done > furthest:
            furthest, deadline = done, time.monotonic() + seconds
        assert time.monotonic() < deadline, f"{done} done, and no progress within {seconds:.0f} s"
        time.sleep(0.1)


def client_of(url: str) -> httpx2.Client:
    return httpx2.Client(base_url=url, timeout=60.0)


def state_of(pid: int) -> str:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]


def stopped(mark: Path) -> int:
    """Wait until the process of the mark is stopped; return its id."""
    until(lambda: mark.exists() and mark.read_text() != "" and state_of(int(mark.read_text())) == "T")
    return int(mark.read_text())


@contextmanager
def stopped_until_the_end(mark: Path) -> Iterator[int]:
    """The process of the mark, once it is stopped; at the end it goes on, as it would not end else."""
    pid = stopped(mark)
    try:
        yield pid
    finally:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


def test_the_part_of_a_worker_that_is_stopped_inside_a_transaction_goes_on_elsewhere(
    new_postgresql_database: Callable[[], str], hooked: Callable[[str, str], Path]
) -> None:
    """It has rows of PostgreSQL locked: the server ends its session. Meanwhile every request is answered."""
    database = new_postgresql_database()
    mark = hooked("stopping", STOPPED_INSIDE_A_TRANSACTION)
    with (
        serving(database, 0, free_port()) as service,
        working(database, "stopping") as first,
        client_of(ready(service).url) as client,
    ):
        ready(first)
        address = post_run(client)
        with stopped_until_the_end(mark):
            answer = client.patch(job_at(post_run(client)), json=CANCEL)  # another one
            assert answer.status_code == 200
            with working(database, "other") as second:
                ready(second)
                run = ended(client, address)
            assert (run["state"], run["progress"]["done"]) == ("succeeded", 40_000)
        time.sleep(2.0)  # for whatever the zombie does late
        assert client.get(address).json() == run


def test_requests_to_cancel_a_locked_job_are_answered_and_others_with_them(
    new_postgresql_database: Callable[[], str], hooked: Callable[[str, str], Path]
) -> None:
    """Nine of them filled the eight threads of the service."""
    database = new_postgresql_database() + "&options=-cidle_in_transaction_session_timeout%3D0"
    mark = hooked("stopping", STOPPED_INSIDE_A_TRANSACTION)
    with (
        serving(database, 0, free_port()) as service,
        working(database, "stopping") as worker,
        client_of(ready(service).url) as client,
    ):
        ready(worker)
        address = post_run(client)
        with stopped_until_the_end(mark), ThreadPoolExecutor(18) as pool:
            cancels = [pool.submit(client.patch, job_at(address), json=CANCEL) for _ in range(9)]
            looks = [pool.submit(client.get, address) for _ in range(9)]
            assert {each.result(LONGEST_SECONDS).status_code for each in looks} == {200}
            answers = [each.result(LONGEST_SECONDS) for each in cancels]
        assert {answer.status_code for answer in answers} == {503}
        assert {"retry-after" in answer.headers for answer in answers} == {True}


def test_a_worker_of_the_service_that_is_stopped_inside_a_transaction_is_replaced(
    database: str, hooked: Callable[[str, str], Path]
) -> None:
    """On SQLite it has the whole file locked: nobody could write."""
    mark = hooked("jointstiff.service.workers", STOPPED_INSIDE_A_TRANSACTION)
    with serving(database, 1, free_port()) as service, client_of(ready(service).url) as client:
        address = post_run(client)
        pid = stopped(mark)
        assert ended(client, address)["state"] == "succeeded"
        assert not Path(f"/proc/{pid}").exists()


def test_a_worker_whose_step_hangs_ends_and_the_step_goes_on_elsewhere(
    database: str, hooked: Callable[[str, str], Path]
) -> None:
    """Its other threads would show signs of life for ever."""
    mark = hooked("hanging", HANGS)
    with (
        serving(database, 0, free_port()) as service,
        working(database, "hanging") as first,
        client_of(ready(service).url) as client,
    ):
        ready(first)
        address = post_run(client)
        until(mark.exists)
        with working(database, "other") as second:
            ready(second)
            assert first.wait(LONGEST_SECONDS) == 70
            assert ended(client, address)["state"] == "succeeded"


def test_two_workers_of_one_name_are_two(database: str) -> None:
    """As on two machines of one host name. What one had begun when it was killed the other goes on with."""
    with (
        serving(database, 0, free_port()) as service,
        working(database, "same") as first,
        working(database, "same") as second,
        client_of(ready(service).url) as client,
    ):
        ready(first), ready(second)
        until(lambda: client.get("/health").json()["workers"] == 2)
        addresses = [post_run(client) for _ in range(3)]
        until(lambda: any(client.get(address).json()["progress"]["done"] for address in addresses))
        first.kill()
        for address in addresses:
            run = ended(client, address)
            assert (run["state"], run["progress"]["done"]) == ("succeeded", 40_000)


@pytest.mark.slow
def test_a_run_over_which_every_worker_dies_fails(database: str, hooked: Callable[[str, str], Path]) -> None:
    """Five deaths, with the supervisor's pauses between them; the service answers all the time."""
    hooked("jointstiff.service.workers", DIES)
    with serving(database, 1, free_port()) as service, client_of(ready(service).url) as client:
        address = post_run(client)
        run = ended(client, address, seconds=240)
        assert (run["state"], run["error"]["type"]) == ("failed", "urn:jointstiff:problem:worker-lost")
        assert "5 workers died over one step" in run["error"]["detail"]
