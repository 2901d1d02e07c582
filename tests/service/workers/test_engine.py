"""DBOS as the workers use it, on both databases: what it claims, repeats, gives up and refuses."""

import base64
import pickle
import sqlite3
import threading
from contextlib import closing, contextmanager

import psycopg
import pytest
import sqlalchemy as sa
from support.jobs import run_request, runs_of, stored_set
from support.processes import until

from jointstiff.service.jobs import Part
from jointstiff.service.kinds.run.work import RunWork
from jointstiff.service.store.store import Store
from jointstiff.service.store.waiting import name_queue_schema
from jointstiff.service.workers import engine as module
from jointstiff.service.workers.engine import ATTEMPTS, Engine, Queue
from jointstiff.service.workers.worker import Recovery, carry_out


@pytest.fixture
def store(database_url):
    with Store.open(database_url) as opened:
        yield opened


@pytest.fixture
def queue(store, database_url):
    with closing(Queue(store, database_url)) as opened:
        yield opened


@pytest.fixture
def working(store, database_url):
    """Call it for an engine that carries out parts as it is told, while a block lasts."""

    @contextmanager
    def start(carry_out_part, executor="alive"):
        with closing(Engine(store, database_url, executor, carry_out_part)) as engine:
            yield engine

    return start


def enqueued(store, queue, *job_ids):
    with store.transaction() as connection:
        for job_id in job_ids:
            queue.enqueue(connection, job_id)


def changed(store, sql, **values):
    """Carry out a statement, in which tables of the queue need no schema."""
    schema = store.schema()
    with store.transaction() as connection:
        if schema is not None:
            connection.exec_driver_sql(f"SET LOCAL search_path TO {name_queue_schema(schema)}, {schema}")
        connection.execute(sa.text(sql), values)


def rows(queue):
    return {each.workflow_id: (each.status, each.recovery_attempts) for each in queue._list_rows()}


def test_a_connection_that_a_thread_gives_back_after_the_end_is_closed(store, database_url):
    """DBOS is not waited for: its threads may be in the middle of a query."""
    queue = Queue(store, database_url)
    late = queue._engine.connect()
    held = late.connection.driver_connection
    queue.close()
    late.close()
    with pytest.raises((sqlite3.ProgrammingError, psycopg.OperationalError), match="closed"):
        held.execute("SELECT 1")


def test_a_run_is_carried_out_and_ends_with_the_numbers_of_one_process(store, queue, working, monkeypatch):
    monkeypatch.setattr(RunWork, "steps", lambda _work: [(i, i + 20) for i in range(0, 300, 20)])
    runs = runs_of(store, queue.enqueue)
    run = runs.create(run_request(stored_set(store)), None)
    engines = []
    with working(lambda part: carry_out(store, lambda _: runs, part, engines[0])) as engine:
        engines.append(engine)
        until(lambda: runs.current(run.id).state == "succeeded")
        until(lambda: engine.claimed_parts() == {})
        engine.remove_ended_parts(store.find_unfinished_jobs)
        assert rows(engine) == {}
    at_once = runs_of(store).create(run_request(run.measurement_set_id), None)
    assert runs.current(run.id).result == runs_of(store).current(at_once.id).result


def test_a_part_of_a_dead_worker_begins_again_and_the_sixth_time_it_is_given_up(store, queue, working):
    """DBOS counts the starts, and Recovery ends the job."""
    enqueued(store, queue, "poison", "other")
    changed(
        store,
        "UPDATE workflow_status SET status = 'PENDING', executor_id = 'dead', recovery_attempts = :n "
        "WHERE workflow_uuid = 'poison-000000-0'",
        n=ATTEMPTS - 1,
    )
    begun = []
    with working(begun.append) as engine:
        engine.recover([])
        until(lambda: Part("other", 0, 0) in begun)
        assert engine.claimed_parts()["poison-000000-0"] == "dead"
        engine.recover(["dead", "nobody"])
        until(lambda: rows(engine)["poison-000000-0"] == ("SUCCESS", ATTEMPTS))
        assert begun.count(Part("poison", 0, 0)) == 1
        changed(
            store,
            "UPDATE workflow_status SET status = 'PENDING', executor_id = 'dead' "
            "WHERE workflow_uuid = 'poison-000000-0'",
        )
        engine.recover(["dead"])
        until(lambda: engine.find_given_up_jobs() == {"poison": True})
        assert begun.count(Part("poison", 0, 0)) == 1
        assert engine.find_unknown_jobs(["poison", "other", "third"]) == {"third"}


def test_a_part_that_was_handed_over_begins_with_no_death(store, queue, working):
    enqueued(store, queue, "a")
    changed(store, "UPDATE workflow_status SET status = 'PENDING', executor_id = 'x', recovery_attempts = 5")
    queue.put_back(["a-000000-0"])
    begun = []
    with working(begun.append) as engine:
        until(lambda: rows(engine)["a-000000-0"] == ("SUCCESS", 1))
    assert begun == [Part("a", 0, 0)]


def test_a_zombie_that_ends_late_changes_nothing(store, queue, working):
    """It was silent, its part was claimed by another one, and then it goes on."""
    enqueued(store, queue, "a")
    begun, go_on = threading.Event(), threading.Event()

    def carry_out_part(_part):
        begun.set()
        assert go_on.wait(90)

    with working(carry_out_part) as engine:
        assert begun.wait(90)
        changed(
            store, "UPDATE workflow_status SET owner_xid = 'of another', executor_id = 'other'"
        )  # as after its recovery
        go_on.set()
        until(lambda: engine.seconds_of_running_parts() == {})
        enqueued(store, queue, "b")
        until(lambda: rows(engine).get("b-000000-0", ("", 0))[0] == "SUCCESS")
        assert engine.claimed_parts() == {"a-000000-0": "other"}


def test_a_worker_knows_what_it_carries_out_and_how_far_it_computes(store, queue, working):
    enqueued(store, queue, "a")
    computes, go_on = threading.Event(), threading.Event()

    def carry_out_part(_part):
        while not computes.is_set():
            pass
        go_on.wait(90)

    with working(carry_out_part) as engine:
        until(lambda: engine.seconds_of_running_parts().keys() == {"a-000000-0"})
        early = engine.seconds_of_running_parts()["a-000000-0"]
        until(lambda: engine.seconds_of_running_parts()["a-000000-0"] > early + 0.2)
        computes.set()
        used = engine.seconds_of_running_parts()["a-000000-0"]
        assert not go_on.wait(0.5)
        assert engine.seconds_of_running_parts()["a-000000-0"] < used + 0.1, "it waits, and computes nothing"
        assert engine.claimed_parts() == {"a-000000-0": "alive"}
        recovery = Recovery(store, lambda _: None, engine, "alive")
        recovery.check_and_recover()
        recovery.check_and_recover()
        assert engine.claimed_parts() == {"a-000000-0": "alive"}, "it is not idle"
        go_on.set()
        until(lambda: engine.seconds_of_running_parts() == {})


class Away(Queue):
    """A queue whose database does not answer."""

    def _list_rows(self, *_, **__):
        raise sa.exc.OperationalError("SELECT", {}, Exception("the server closed the connection"))


def test_a_database_that_does_not_answer_fails_no_job_that_asks_whether_others_wait(store, database_url):
    with closing(Away(store, database_url)) as away:
        assert away.others_wait("a"), "the part leaves its other steps, and loses nothing"


def test_a_part_that_is_offered_again_is_begun_again(store, queue, working):
    enqueued(store, queue, "a")
    begun = []

    def carry_out_part(part):
        begun.append(part)
        if len(begun) < 3:
            queue.offer_again([part], 0.5)

    with working(carry_out_part) as engine:
        until(lambda: len(begun) == 3)
        assert set(begun) == {Part("a", 0, 0)}
        assert engine.find_given_up_jobs() == {}


def test_a_part_whose_rows_are_locked_is_offered_again_and_later_each_time(
    store, queue, working, monkeypatch
):
    monkeypatch.setattr(module, "FIRST_DELAY_SECONDS", 0.2)
    enqueued(store, queue, "a")
    begun = []

    def carry_out_part(part):
        begun.append(part)
        if len(begun) < 3:
            queue.hand_back(part)

    with working(carry_out_part) as engine:
        until(lambda: len(begun) == 3)
        assert [part.delays for part in begun] == [0, 1, 2]
        assert engine.find_given_up_jobs() == {}


def test_a_worker_that_stops_hands_over_what_it_carries_out_and_begins_nothing_more(store, queue, working):
    enqueued(store, queue, "a")
    begun, go_on = [], threading.Event()

    def carry_out_part(part):
        begun.append(part)
        go_on.wait(90)

    with working(carry_out_part) as engine:
        until(lambda: len(begun) == 1)
        engine.stop()
        assert rows(engine) == {"a-000000-0": ("ENQUEUED", 0)}
        enqueued(store, queue, "b")
        go_on.set()
        until(lambda: engine.seconds_of_running_parts() == {})
        until(lambda: engine.claimed_parts() != {})
        engine.stop()
        assert {status for status, _ in rows(engine).values()} == {"ENQUEUED"}
        assert begun == [Part("a", 0, 0)]


class Planted:
    """Writes a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def test_a_pickle_planted_in_the_queue_is_not_run_and_its_job_ends(store, queue, working, tmp_path):
    """Who can write the database runs no code in the workers."""
    runs = runs_of(store, queue.enqueue)
    run = runs.create(run_request(stored_set(store)), None)
    written = base64.b64encode(pickle.dumps(Planted(tmp_path / "ran"))).decode()
    changed(store, "UPDATE workflow_input SET inputs = :written", written=written)
    changed(store, "UPDATE workflow_status SET serialization = 'py_pickle'")
    with working(lambda _part: None) as engine:
        until(lambda: engine.find_given_up_jobs() == {run.id: False})
        Recovery(store, lambda _: runs, engine, "alive").check_and_recover()
    assert runs.current(run.id).state == "failed"
    assert "cannot be carried out" in runs.current(run.id).error.detail
    assert not (tmp_path / "ran").exists()


def test_parts_of_earlier_versions_move_to_the_schema_of_the_queue(new_postgresql_database, monkeypatch):
    """Those that wait and those that are claimed; the store's schema has the tables of the store alone."""
    url = new_postgresql_database()
    with Store.open(url) as store:
        tables = sa.text("SELECT table_name FROM information_schema.tables WHERE table_schema = 'public'")
        functions = sa.text("SELECT proname FROM pg_proc WHERE pronamespace = to_regnamespace('public')")
        own = set(store._database.rows(tables))
        with monkeypatch.context() as earlier:
            earlier.setattr(module, "name_queue_schema", lambda schema: schema)
            earlier.setattr(module, "move_tables", lambda *_: None)
            with closing(Queue(store, url)) as old:
                enqueued(store, old, "a", "b")
                changed(store, "UPDATE workflow_status SET status = 'PENDING' WHERE workflow_uuid LIKE 'b%'")
                before = rows(old)
        assert set(store._database.rows(tables)) > own
        for _ in range(2):  # the second one finds nothing to move
            with closing(Queue(store, url)) as queue:
                assert rows(queue) == before
                assert queue.find_unknown_jobs(["a", "b", "c"]) == {"c"}
                assert queue.claimed_parts().keys() == {"b-000000-0"}
        assert set(store._database.rows(tables)) == own
        assert not store._database.rows(functions)
