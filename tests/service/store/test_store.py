"""The store's contract on both databases: resources, jobs and their parts, sessions, links and journals."""

import dataclasses
import itertools
import secrets
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any, TypeVar

import pytest
import sqlalchemy as sa
from support.claims import Claims
from support.jobs import RESOURCES, RUN, TIME, job_record, keeper, run_request, runs_of, stored_set

from jointstiff.service.jobs import Part
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.kinds.run.work import RunWork
from jointstiff.service.problems import (
    CursorError,
    IdempotencyConflictError,
    NotFoundError,
    StoreError,
)
from jointstiff.service.store import access as access_module
from jointstiff.service.store import database
from jointstiff.service.store.store import SESSION_IDLE, SESSION_LONGEST, Store
from jointstiff.service.store.tables import (
    AuditEntry,
    IdempotencyKey,
    MeasurementSetRecord,
    RobotRecord,
    SessionRecord,
    job_steps,
)
from jointstiff.service.workers.worker import Recovery

T = TypeVar("T")

HOSTILE = {
    "nul": "a\x00b",
    "surrogate": "a\ud800b",
    "megabyte": "é" * 500_000,
    "emoji": "🤖",
    "quotes": "'; DROP TABLE robots; --\"%_\\",
    "empty": "",
    "unit separator": "\x1f",
}


@pytest.fixture
def store(database_url: str) -> Iterator[Store]:
    with Store.open(database_url) as opened:
        yield opened


@pytest.fixture
def claims(store: Store, database_url: str) -> Iterator[Claims]:
    with closing(Claims(store, database_url)) as queue:
        yield queue


@pytest.fixture
def runs(store: Store, claims: Claims) -> Any:
    return runs_of(store, claims.enqueue)


def robot(identifier: str = "r1", **changes: Any) -> RobotRecord:
    record = RobotRecord(identifier, "KR 240 cell 3", TIME, "0" * 64, '{"Gelenk": "β₁ 🤖"}')
    return dataclasses.replace(record, **changes)


def measurement_set(identifier: str = "s1", **changes: Any) -> MeasurementSetRecord:
    record = MeasurementSetRecord(
        identifier, "r1", "dead weight", "motor", 19, 0, TIME, "1" * 64, "{}", bytes(range(256)) * 9
    )
    return dataclasses.replace(record, **changes)


def together(count: int, work: Callable[[int], T]) -> list[T]:
    """What `work` returns in as many threads, all released at the same moment."""
    barrier = threading.Barrier(count)

    def start(number: int) -> T:
        barrier.wait(30)
        return work(number)

    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(start, range(count)))


class TestRecords:
    def test_times_without_zone_are_a_mistake(self, store: Store) -> None:
        with pytest.raises(Exception, match="time zone"):
            store.robots.add(robot(created_at=TIME.replace(tzinfo=None)))
        assert store.robots.page(limit=1).records == ()

    @pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE.keys())
    def test_missing_parents(self, store: Store, text: str) -> None:
        key = IdempotencyKey("k", "b")
        with pytest.raises(NotFoundError) as caught:
            store.sets.add(measurement_set(robot_id=text), key)
        assert (caught.value.kind, caught.value.id) == (store.robots.resource, text)
        store.robots.add(robot())
        with pytest.raises(NotFoundError) as caught:
            store.jobs(RUN).add(job_record(measurement_set_id=text))
        assert caught.value.kind == store.sets.resource
        assert store.sets.page(limit=9).records == ()
        assert store.jobs(RUN).page(limit=9).records == ()
        assert store.sets.find(key) is None, "half of it is stored"

    def test_an_id_is_taken_once(self, store: Store) -> None:
        store.robots.add(robot())
        with pytest.raises(StoreError, match="r1 already"):
            store.robots.add(robot(name="another"))
        assert store.robots.get("r1") == robot()

    def test_ids_that_nothing_has(self, store: Store, subtests: pytest.Subtests) -> None:
        kept = [store.robots, store.sets, *map(store.jobs, RESOURCES.values())]
        for (name, text), collection in itertools.product(HOSTILE.items(), kept):
            with subtests.test(name, kind=collection.resource.name):
                with pytest.raises(NotFoundError) as caught:
                    collection.get(text)
                assert (caught.value.kind, caught.value.id) == (collection.resource, text)
                assert caught.value.remedy
                assert len(caught.value.reason.encode()) < 600


class TestPages:
    def test_filter_values_that_nothing_has(self, store: Store, subtests: pytest.Subtests) -> None:
        store.robots.add(robot())
        for name, text in HOSTILE.items():
            with subtests.test(name):
                page = store.robots.page(limit=5, filters={"name": text})
                assert (page.records, page.next) == ((), None)

    def test_cursors_that_no_page_gave(self, store: Store, subtests: pytest.Subtests) -> None:
        numbers = ["0", "-1", "+1", " 1", "1_0", "1e3", "١", "²", str(2**63), "9" * 5000]
        for cursor in [*HOSTILE.values(), *numbers]:
            with subtests.test(ascii(cursor[:9])):
                with pytest.raises(CursorError) as caught:
                    store.robots.page(limit=5, cursor=cursor)
                assert len(caught.value.reason.encode()) < 600

    def test_mistakes_of_ours(self, store: Store) -> None:
        mistakes: list[tuple[int, dict[str, str]]] = [(0, {}), (-1, {}), (5, {"document": "{}"})]
        for limit, filters in mistakes:
            with pytest.raises(ValueError, match=f"cannot list {limit} robots"):
                store.robots.page(limit=limit, filters=filters)

    def test_jobs_of_other_kinds_are_neither_listed_nor_found(self, store: Store) -> None:
        store.robots.add(robot())
        store.sets.add(measurement_set())
        for name, resource in RESOURCES.items():
            store.jobs(resource).add(job_record(resource, f"of {name}"))
        for name, resource in RESOURCES.items():
            (entry,) = store.jobs(resource).page(limit=9, filters={"robot_id": "r1"}).records
            assert (entry.id, entry.kind) == (f"of {name}", name)
            for other in RESOURCES.values():
                if other is not resource:
                    with pytest.raises(NotFoundError):
                        store.jobs(other).get(entry.id)
                    assert store.jobs(other).status(entry.id) is None


class TestIdempotency:
    KEY = IdempotencyKey("a key", "hash of a body")
    OTHER_BODY = dataclasses.replace(KEY, body_hash="hash of another body")

    def test_a_failed_post_leaves_the_key_free(self, store: Store) -> None:
        with pytest.raises(NotFoundError):
            store.sets.add(measurement_set(), self.KEY)
        store.robots.add(robot())
        assert store.sets.add(measurement_set(), self.OTHER_BODY) == measurement_set()

    def test_simultaneous_posts_make_one_resource(self, store: Store) -> None:
        for attempt in range(5):
            key = IdempotencyKey(f"key {attempt}", "b")

            def post(number: int, attempt: int = attempt, key: IdempotencyKey = key) -> RobotRecord:
                return store.robots.add(robot(f"r{attempt}_{number}"), key)

            answers = together(12, post)
            assert all(answer == answers[0] for answer in answers)
            found = store.robots.page(limit=50).records
            assert (found[0].id, len(found)) == (answers[0].id, attempt + 1)

    def test_simultaneous_posts_of_different_bodies(self, store: Store) -> None:
        def post(number: int) -> RobotRecord | None:
            key = IdempotencyKey("a key", f"body {number}")
            try:
                return store.robots.add(robot(f"r{number}"), key)
            except IdempotencyConflictError:
                return None

        answers = together(8, post)
        assert sum(answer is not None for answer in answers) == 1


def test_many_threads_write_and_read(store: Store) -> None:
    store.robots.add(robot())

    def work(number: int) -> None:
        for index in range(10):
            record = measurement_set(f"s{number}_{index}")
            keeper(store, record).add(record)
            assert store.sets.get(record.id) == record
            store.sets.page(limit=5, filters={"robot_id": "r1"})

    together(20, work)
    assert len(store.sets.page(limit=1000).records) == 200


NOW = datetime(2026, 11, 20, 12, tzinfo=UTC)
MOMENT = timedelta(seconds=1)
SESSION = SessionRecord("a" * 64, "0123456789", NOW, NOW)
ENTRY = AuditEntry(NOW, "0123456789", "tablet", "192.0.2.1", "POST", "createRun", "/v1/runs", 201)


def test_a_session_ends_idle_and_for_good(store):
    store.sessions.begin(SESSION)
    assert store.sessions.find(SESSION.token_hash, NOW + SESSION_IDLE - MOMENT) == SESSION
    assert store.sessions.find(SESSION.token_hash, NOW + SESSION_IDLE) is None
    at = NOW
    while at < NOW + SESSION_LONGEST:
        assert store.sessions.find(SESSION.token_hash, at) is not None
        store.sessions.mark_used(SESSION.token_hash, at)
        at += SESSION_IDLE / 2
    assert store.sessions.find(SESSION.token_hash, NOW + SESSION_LONGEST) is None


def test_a_session_ends_when_it_is_ended(store):
    store.sessions.begin(SESSION)
    store.sessions.end(SESSION.token_hash)
    store.sessions.end(SESSION.token_hash)
    assert store.sessions.find(SESSION.token_hash, NOW) is None


def test_sessions_of_a_key_are_bounded_and_the_ended_are_removed(store, monkeypatch):
    monkeypatch.setattr(access_module, "MOST_SESSIONS", 3)
    other = replace(SESSION, token_hash="b" * 64, key_id="other")
    store.sessions.begin(other)
    times = [NOW + number * MOMENT for number in range(5)]
    for number, at in enumerate(times):
        store.sessions.begin(replace(SESSION, token_hash=str(number), created_at=at, used_at=at))
    assert [bool(store.sessions.find(str(number), times[-1])) for number in range(5)] == [False] * 2 + [
        True
    ] * 3
    assert store.sessions.find(other.token_hash, NOW) == other


def test_a_link_begins_one_session_within_its_time(store):
    ends = NOW + timedelta(minutes=10)
    store.sessions.offer("a", "key", NOW, ends)
    store.sessions.offer("b", "key", NOW, ends)
    assert store.sessions.redeem("a", ends - MOMENT) == "key"
    assert store.sessions.redeem("a", NOW) is None
    assert store.sessions.redeem("b", ends) is None
    assert store.sessions.redeem("nobody's", NOW) is None


def test_of_many_who_use_a_link_one_gets_the_key(store):
    store.sessions.offer("a", "key", NOW, NOW + MOMENT)
    with ThreadPoolExecutor(8) as pool:
        got = list(pool.map(lambda _: store.sessions.redeem("a", NOW), range(8)))
    assert sorted(got, key=str) == [None] * 7 + ["key"]


def test_the_audit_is_listed_newest_first(store):
    for number in range(5):
        store.audit.add(replace(ENTRY, status=200 + number, key_id=None if number % 2 else ENTRY.key_id))
    first = store.audit.page(3)
    assert [entry.status for entry in first.records] == [204, 203, 202]
    rest = store.audit.page(3, first.next)
    assert [entry.status for entry in rest.records] == [201, 200]
    assert rest.next is None
    mine = store.audit.page(9, key_id=ENTRY.key_id).records
    assert [entry.status for entry in mine] == [204, 202, 200]
    assert mine[0] == replace(ENTRY, status=204)
    with pytest.raises(CursorError):
        store.audit.page(3, "x")


def test_a_change_of_nothing_opens_no_writing_transaction(store, monkeypatch):
    store.robots.add(robot())
    opened, writing = [], database.Database.writing

    def count(self):
        opened.append(1)
        return writing(self)

    monkeypatch.setattr(database.Database, "writing", count)
    named = store.robots.get("r1").name
    assert store.robots.change("r1", lambda _: {}).name == named
    assert store.robots.change("r1", lambda record: {"name": record.name}).name == named
    assert not opened
    assert store.robots.change("r1", lambda _: {"name": "another"}).name == "another"
    assert opened


def test_no_method_changes_or_removes_an_entry(store):
    assert {name for name in dir(store.audit) if not name.startswith("_")} == {"add", "find", "page"}


def test_a_size_is_asked_again_after_a_second(monkeypatch):
    """Also where the clock begins."""
    now = [0.0]
    monkeypatch.setattr(database, "time", SimpleNamespace(monotonic=lambda: now[0]))
    with Store.open("sqlite://") as store:
        empty = store.quota.used()
        store.robots.add(robot(document=secrets.token_hex(100_000)))  # not to be compressed
        now[0] = 0.99
        assert store.quota.used() == empty > 0
        now[0] = 1.0
        assert store.quota.used() > empty + 90_000


@pytest.mark.parametrize(("left", "before"), [(19.0, []), (2.0, ["PRAGMA busy_timeout=2000"])])
def test_who_has_waited_waits_for_the_file_as_long_as_is_left(left, before):
    """Of twenty seconds; who gets the connection next has them all."""
    said = []
    connection = SimpleNamespace(
        get_execution_options=lambda: {"busy_seconds": left}, exec_driver_sql=said.append
    )
    database._begin_immediate(connection)
    after = ["PRAGMA busy_timeout=20000"] * len(before)
    assert said == [*before, "BEGIN IMMEDIATE", *after]


@pytest.fixture
def three_parts(monkeypatch):
    """Let runs have three parts of a step of 100 draws each."""
    spans = [(0, 100), (100, 200), (200, 300)]
    monkeypatch.setattr("jointstiff.service.jobs.STEPS_OF_A_PART", 1)
    monkeypatch.setattr(RunWork, "steps", lambda _work: spans)


def results_left(store):
    return store._database.rows(sa.select(sa.func.count()).select_from(job_steps))[0][0]


@pytest.mark.parametrize("fails", [True, False])
def test_a_job_and_its_part_are_stored_together_or_not_at_all(store, claims, fails):
    """Else a job that was answered 202 would have nobody to end it, or workers a part of no job."""

    def enqueue(connection, job_id):
        claims.enqueue(connection, job_id)
        if fails:
            raise KeyError("odd")

    runs = runs_of(store, enqueue)
    stored = stored_set(store)
    try:
        job_id = runs.create(run_request(stored), None).id
    except KeyError:
        assert store.open_jobs([kind.name for kind in KINDS]) == {}
        assert claims.waiting() == []
    else:
        assert store.open_jobs([kind.name for kind in KINDS]) == {job_id: "run"}
        assert claims.waiting() == [f"{job_id}-000000-0"]


def test_a_part_is_left_once_however_often(runs, store, claims):
    run = runs.create(run_request(stored_set(store)), None)
    for _ in range(2):
        claims.add_following_parts(run.id, [Part(run.id, 1, 0), Part(run.id, 2, 0)])
    assert len(claims.waiting()) == 3


class KilledError(BaseException):
    """The worker is no more."""


def work_until_killed(store, claims, runs, commits):
    """Carry out parts until the worker dies at a commit, which is lost; return whether it did."""
    left = [commits]

    def count(_connection):
        left[0] -= 1
        if left[0] == 0:
            raise KilledError

    with commits_counted(store._database, count):
        try:
            claims.work_all(lambda _: runs, "dead")
        except KilledError:
            return True
    return False


@contextmanager
def commits_counted(database, count):
    """Call a function at each commit, and before each statement that is a transaction by itself."""

    def count_write(connection, _cursor, statement, *_):
        is_alone = connection.connection.driver_connection.autocommit
        if is_alone and statement.startswith(("INSERT", "UPDATE", "DELETE", "WITH")):
            count(connection)

    watched = [(database._writer, "commit", count)]
    if database.dialect == "postgresql":
        watched.append((database._reader, "before_cursor_execute", count_write))
    for each in watched:
        sa.event.listen(*each)
    try:
        yield
    finally:
        for each in watched:
            sa.event.remove(*each)


@pytest.mark.usefixtures("three_parts")
def test_a_worker_that_dies_before_any_of_its_commits_loses_nothing(store, claims, runs):
    """Whatever it was about to write: what another one goes on with are the same numbers."""
    stored = stored_set(store)
    expected = runs_of(store).current(runs_of(store).create(run_request(stored), None).id).result
    deaths = 0
    while True:
        run = runs.create(run_request(stored), None)
        is_dead = work_until_killed(store, claims, runs, deaths + 1)
        assert runs.current(run.id).progress.done in {0, 100, 200, 300}
        Recovery(store, lambda _: runs, claims, "alive").check_and_recover()
        claims.work_all(lambda _: runs, "alive")
        ended = runs.current(run.id)
        assert (ended.state, ended.progress.done, ended.result) == ("succeeded", 300, expected), deaths
        assert results_left(store) == 0
        if not is_dead:
            break
        deaths += 1
    assert deaths == 14, "five of the first part, three of the second, five of the last, one without a part"


def cancelling(store, run_id, done):
    """Start to cancel a run, and wait a while for it, as it may have to wait for others."""
    thread = threading.Thread(target=lambda: (runs_of(store).cancel(run_id), done.set()))
    thread.start()
    thread.join(0.5)
    return thread


def test_a_run_cancelled_while_a_result_is_added_leaves_none(store, runs):
    """PostgreSQL would not see rows that another transaction adds meanwhile, and they would stay for ever."""
    run = runs.create(run_request(stored_set(store)), None)
    cancelled, threads = threading.Event(), []

    def cancel(_connection, _cursor, statement, *_rest):
        if statement.startswith("INSERT INTO job_steps"):
            threads.append(cancelling(store, run.id, cancelled))

    sa.event.listen(store._database._writer, "before_cursor_execute", cancel)
    store.steps.store_result(run.id, (0, 100), b"computed")
    threads[0].join(20)
    assert cancelled.is_set()
    assert runs.current(run.id).state == "cancelled"
    assert results_left(store) == 0


@pytest.mark.usefixtures("three_parts")
def test_a_run_ends_once_when_workers_end_its_last_parts_at_the_same_time(store, claims, runs, monkeypatch):
    run, gate, compute = (
        runs.create(run_request(stored_set(store)), None),
        threading.Barrier(2),
        RunWork.compute,
    )
    claims.work(lambda _: runs)

    def compute_together(work, span):
        gate.wait(20)
        return compute(work, span)

    monkeypatch.setattr(RunWork, "compute", compute_together)
    parts = [claims.claim(name) for name in "ab"]
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda part: runs.carry_out(part, claims), parts))
    assert (runs.current(run.id).state, runs.current(run.id).progress.done) == ("succeeded", 300)
    assert results_left(store) == 0


@pytest.mark.usefixtures("three_parts")
def test_four_workers_end_all_runs_once_while_some_are_cancelled(store, claims, runs):
    stored = stored_set(store)
    ids = [runs.create(run_request(stored), None).id for _ in range(8)]
    cancelled, ended, end = ids[::3], [], runs.records.end
    turns = threading.Lock()  # as DBOS locks the row that it claims

    def count_ends(job_id, *rest):
        if is_ended := end(job_id, *rest):
            ended.append(job_id)
        return is_ended

    def work(name):
        while any(map(runs.records.is_active, ids)):
            with turns:
                part = claims.claim(name)
            if part is not None:
                runs.carry_out(part, claims)

    runs.records.end = count_ends
    with ThreadPoolExecutor(5) as pool:
        working = pool.map(work, ["w1", "w2", "w3", "w4"])
        list(pool.map(runs.cancel, cancelled))
        list(working)
    assert sorted(ended) == sorted(ids)
    states = runs.records.statuses(ids)
    assert {states[job_id].state for job_id in ids if job_id not in cancelled} == {"succeeded"}
    assert {states[job_id].state for job_id in cancelled} <= {"cancelled", "succeeded"}
    assert results_left(store) == 0


def test_what_each_look_of_a_worker_reads_is_found_by_an_index(store):
    """The leading worker read all runs ever stored, every five seconds."""
    explain = "EXPLAIN QUERY PLAN " if store._database.dialect == "sqlite" else "EXPLAIN "
    plans = []

    def show(connection, _cursor, statement, parameters, *_rest):
        if "jobs" in statement and not statement.startswith("EXPLAIN"):
            plans.append(connection.exec_driver_sql(explain + statement, parameters).all())

    with store._database.reading() as connection:
        if store._database.dialect == "postgresql":
            connection.exec_driver_sql("SET enable_seqscan = off")  # of a table without rows
        engine = connection.engine
    sa.event.listen(engine, "before_cursor_execute", show)
    store.open_jobs([kind.name for kind in KINDS])
    store.find_unfinished_jobs(["a", "b"])
    assert len(plans) == 2
    for plan in plans:
        text = "\n".join(map(str, plan))
        assert "SCAN jobs" not in text, text
        assert "Index" in text or "USING INDEX" in text, text
