"""Width by executors: the same bits in each process, many campaigns, progress, cancelling and failures."""

import json
import os
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial

import pytest
from support.claims import Claims
from support.jobs import set_of

import jointstiff as js
from jointstiff.schemas.run import RunRequest
from jointstiff.service.jobs import Parts
from jointstiff.service.kinds import width
from jointstiff.service.kinds.correction.text import FaultsError
from jointstiff.service.kinds.run.work import RunWork
from jointstiff.service.kinds.width import CancelledWorkError, map_in_order
from jointstiff.service.library.client import Client
from jointstiff.service.problems import ExecutorError, FilesError
from jointstiff.service.process import ONE_THREAD
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import SolverError
from robotprograms import Fault, ProgramError

DOCUMENT = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
RESAMPLED = {"resampling": {"size": 8, "repetitions": 60_000, "seed": 4}}
ELASTIC = {"elasticity": "joints_and_links", "cross_validation": {"folds": 3, "draws": 1}}
AREA = {"area": [[1400, -200, 600], [1800, 200, 600]], "place": (0, 0, 250), "force": (0, 300, -500)}


@pytest.fixture(scope="module")
def pool() -> Iterator[Executor]:
    """An executor of this process; calls and answers are pickled as for another one."""
    with ThreadPoolExecutor(2) as executor:
        yield executor


# ---- the same bits

PROGRAM = """
import contextlib, json, multiprocessing, sys
from concurrent.futures import ProcessPoolExecutor

import jointstiff as js


def results(document, options, executor):
    return [js.identify(document, **each, executor=executor).result.model_dump_json() for each in options]


if __name__ == "__main__":
    document, options, name = json.loads(sys.argv[1])
    with contextlib.ExitStack() as stack:
        executor = None
        if name == "pool":
            spawn = multiprocessing.get_context("spawn")
            executor = stack.enter_context(ProcessPoolExecutor(2, mp_context=spawn))
        elif name == "dask":
            from distributed import Client, LocalCluster

            two = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
            client = stack.enter_context(Client(stack.enter_context(LocalCluster(**two))))
            executor = stack.enter_context(client.get_executor())
        print(json.dumps(results(document, options, executor)))
"""


@pytest.fixture(scope="module")
def by_workers(tmp_path_factory):
    """Results of runs whose parts workers of a service carried out: this process has one BLAS thread."""
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
    results = []
    database = f"sqlite:///{tmp_path_factory.mktemp('store')}/store.db"
    with Store.open(database) as store:
        claims = Claims(store, database)
        runs = Parts(store, claims.enqueue).jobs["run"]
        set_id = set_of(Parts(store), DOCUMENT)
        for options in (ELASTIC, RESAMPLED):
            run = runs.create(RunRequest(measurement_set_id=set_id, **options), None)
            claims.work_all(lambda _: runs)
            results.append(runs.current(run.id).result.model_dump_json())
    return results


@pytest.mark.process
@pytest.mark.parametrize("executor", ["none", "pool", "dask"])
def test_each_way_of_computing_has_the_bits_of_a_worker(executor, by_workers, tmp_path):
    """The user's program has as many threads of linear algebra as there are processors, and two at least."""
    if executor == "dask":
        pytest.importorskip("distributed", reason="Dask is not installed: pip install 'jointstiff[cluster]'")
    (tmp_path / "program.py").write_text(PROGRAM)
    threads = dict.fromkeys((name for name in ONE_THREAD if name.endswith("THREADS")), "2")
    done = subprocess.run(
        [sys.executable, "program.py", json.dumps([DOCUMENT, [ELASTIC, RESAMPLED], executor])],
        cwd=tmp_path,
        env=os.environ | threads,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == by_workers


# ---- verbs


def test_steps_by_an_executor_have_the_numbers_and_the_progress_of_steps_here(pool, monkeypatch):
    monkeypatch.setattr("jointstiff.service.kinds.map.work.POSES_A_STEP", 10)
    run = js.identify(DOCUMENT)
    maps = {"grid": (4, 4, 2), **AREA}
    told = {None: [], pool: []}
    found = [js.map(run, **maps, executor=each, on_progress=told[each].append).result for each in told]
    assert found[0].model_dump_json() == found[1].model_dump_json()
    assert told[None] == told[pool]
    assert len(told[pool]) == 4


def test_every_verb_takes_an_executor(pool):
    assert js.identify(DOCUMENT, **ELASTIC, executor=pool).result.links is not None
    assert js.compare(DOCUMENT, executor=pool, resampling=RESAMPLED["resampling"]).state == "succeeded"
    assert js.plan(DOCUMENT, readings=2, executor=pool).state == "succeeded"


def test_a_failing_step_is_the_failed_run_that_it_is_here(pool, monkeypatch):
    def fail(_work, _span):
        raise SolverError("no optimum")

    monkeypatch.setattr(RunWork, "compute", fail)
    errors = [js.identify(DOCUMENT, **RESAMPLED, executor=each).error for each in (None, pool)]
    assert errors[0] == errors[1]
    assert "no optimum" in errors[0].detail


def test_work_by_an_executor_is_cancelled_between_its_steps(pool):
    told = []
    run = js.identify(DOCUMENT, **RESAMPLED, executor=pool, on_progress=told.append, cancel=lambda: told)
    assert run.state == "cancelled"
    assert told


def test_a_service_refuses_an_executor(pool):
    with Client("http://127.0.0.1:9") as client:
        for verb in (client.identify, client.map, client.plan, client.compare):
            with pytest.raises(TypeError, match="own workers"):
                verb(DOCUMENT, executor=pool)
        with pytest.raises(TypeError, match="own workers"):
            client.correct(DOCUMENT, "pocket.src", executor=pool)


def test_one_campaign_in_place_of_several_is_refused():
    """Each letter of a file's name became a failed run."""
    for one in ("campaign.json", DOCUMENT, js.identify(DOCUMENT)):
        with pytest.raises(TypeError, match="give a list"):
            js.identify_many(one)


def test_what_is_no_campaign_is_a_failed_run_among_others(pool):
    runs = list(js.identify_many([DOCUMENT, None, DOCUMENT], executor=pool, elasticity="joints"))
    assert [run.state for run in runs] == ["succeeded", "failed", "succeeded"]
    assert runs[1].error.detail.startswith("a NoneType cannot be read as a campaign")


# ---- an executor's calls


class Held(Executor):
    """An executor that begins nothing before it is told to."""

    def __init__(self):
        self.calls = []

    def submit(self, function, /, *arguments):
        future = Future()
        self.calls.append((future, partial(function, *arguments)))
        return future

    def begin(self):
        for future, call in self.calls:
            if future.set_running_or_notify_cancel():
                future.set_result(call())
        self.calls.clear()


def test_only_so_many_calls_are_in_flight_and_the_rest_is_not_read(monkeypatch):
    monkeypatch.setattr(width, "IN_FLIGHT", 3)
    monkeypatch.setattr(width, "MOST_WAITING", 5)
    read, held, in_flight = [], Held(), []

    def begin():
        in_flight.append(len(held.calls))
        if len(held.calls) == 3 or len(read) == 10:
            held.begin()

    found = []
    for each in map_in_order(held, abs, (read.append(i) or -i for i in range(10)), begin):
        found.append(each)
        assert len(read) <= len(found) + 4
    assert found == list(range(10))
    assert max(in_flight) == 3


def test_an_answer_that_is_due_comes_before_further_arguments():
    """Files on a network disk are read one by one: the first run waited for 256 of them."""
    read, first = [], threading.Event()

    def arguments():
        for i in range(100):
            if i:
                assert first.wait(20)
                time.sleep(0.02)
            read.append(i)
            yield i

    def answered(number):
        first.set()
        return number

    with ThreadPoolExecutor(1) as one:
        answers = map_in_order(one, answered, arguments(), lambda: False)
        assert next(answers) == 0
        assert len(read) < 20
        answers.close()


def test_a_call_that_takes_long_holds_up_no_other(monkeypatch):
    """Behind a campaign of 15 s a process did nothing after 256 of 0.02 s."""
    monkeypatch.setattr(width, "IN_FLIGHT", 2)
    others = threading.Semaphore(0)

    def identified(number):
        if number:
            others.release()
            return number
        return all(others.acquire(timeout=20) for _ in range(50))

    with ThreadPoolExecutor(2) as two:
        assert list(map_in_order(two, identified, range(51), lambda: False)) == [True, *range(1, 51)]


def test_calls_that_have_not_begun_are_cancelled_with_the_work():
    held = Held()
    with pytest.raises(CancelledWorkError):
        next(map_in_order(held, abs, range(5), lambda: len(held.calls) == 5))
    assert [future.cancelled() for future, _ in held.calls] == [True] * 5


def test_work_is_cancelled_although_all_answers_are_there():
    held, found = Held(), []

    def enough():
        held.begin()
        return found

    results = map_in_order(held, abs, range(5), enough)
    found.append(next(results))
    with pytest.raises(CancelledWorkError):
        next(results)


def test_calls_that_have_not_begun_are_cancelled_when_the_iteration_is_left():
    held = Held()

    def begin_the_first():
        if len(held.calls) == 5:
            later, held.calls = held.calls[1:], held.calls[:1]
            held.begin()
            held.calls = later

    results = map_in_order(held, abs, range(5), begin_the_first)
    assert next(results) == 0
    results.close()
    assert [future.cancelled() for future, _ in held.calls] == [True] * 4


class Broken(Executor):
    """An executor whose processes are gone."""

    def submit(self, *_):
        raise RuntimeError("no process is left")


def test_an_executor_that_fails_is_no_failed_run():
    with pytest.raises(ExecutorError, match="RuntimeError: no process is left"):
        js.identify(DOCUMENT, **RESAMPLED, executor=Broken())
    with pytest.raises(ExecutorError):
        list(js.identify_many([DOCUMENT], executor=Broken()))


def test_an_error_survives_the_way_from_another_process():
    fault = Fault("cell.src", 3, "the move is unknown", "rewrite it")
    files = FilesError("two faults", remedy="mend them", items=[("a", "b", "c")])
    for error in (ProgramError([fault]), FaultsError([fault]), files):
        same = pickle.loads(pickle.dumps(error))
        assert (type(same), vars(same), str(same)) == (type(error), vars(error), str(error))


# ---- many campaigns


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory):
    """A document, a file, a campaign, and three that cannot be used."""
    folder = tmp_path_factory.mktemp("campaigns")
    (folder / "good.json").write_text(json.dumps(DOCUMENT))
    (folder / "bad.json").write_text('{"robot": 5}')
    return [
        DOCUMENT,
        folder / "good.json",
        js.Campaign.read(folder / "good.json"),
        {"robot": DOCUMENT["robot"]},
        folder / "bad.json",
        str(folder / "none.json"),
        js.identify(DOCUMENT, positive=False),
    ]


@pytest.mark.parametrize("wide", [False, True], ids=["here", "executor"])
def test_many_campaigns_are_runs_in_their_order(campaigns, wide, pool):
    told = []
    found = js.identify_many(iter(campaigns), executor=pool if wide else None, on_progress=told.append)
    runs = list(found)
    assert [run.state for run in runs] == ["succeeded"] * 3 + ["failed"] * 3 + ["succeeded"]
    assert [each.done for each in told] == [1, 2, 3, 4, 5, 6, 7]
    alone = js.identify(DOCUMENT).result.model_dump_json()
    assert {run.result.model_dump_json() for run in runs[:3]} == {alone}
    assert runs[6].request.positive is False
    places = [run.error.where for run in runs[3:6]]
    assert places[0].startswith("campaigns[3].")
    assert places[1].startswith(f"{campaigns[4]}: ")
    assert places[2] == campaigns[5]
    assert runs[1].campaign.robot.name == DOCUMENT["robot"]["name"]
    assert js.predict(runs[1], [[0.1] * 6], [0.0, 0.0, -500.0], at=(0, 0, 100)).cases


def test_options_are_those_of_every_run(pool):
    runs = list(
        js.identify_many([DOCUMENT] * 2, js.RunOptions(confidence=0.9), positive=False, executor=pool)
    )
    assert [(run.request.positive, run.request.confidence) for run in runs] == [(False, 0.9)] * 2
    with pytest.raises(TypeError, match="no option 'positiv'"):
        js.identify_many([DOCUMENT], positiv=True)


def test_a_campaign_that_is_refused_is_a_failed_run():
    (run,) = js.identify_many([DOCUMENT], resampling={"size": 500})
    assert run.state == "failed"
    assert run.error.where == "campaigns[0].run.resampling.size"


@pytest.mark.parametrize("wide", [False, True], ids=["here", "executor"])
def test_many_campaigns_end_where_they_are_cancelled(wide, pool):
    told = []
    runs = js.identify_many(
        [DOCUMENT] * 400, executor=pool if wide else None, on_progress=told.append, cancel=lambda: told
    )
    assert len(list(runs)) <= 3
