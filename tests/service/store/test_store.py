"""The store's contract, the same on both databases."""

from __future__ import annotations

import dataclasses
import itertools
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import pytest
from support.records import RESOURCES, RUN, TIME, job_record, keeper

from jointstiff.service.problems import (
    CursorError,
    IdempotencyConflictError,
    NotFoundError,
    StoreError,
)
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import (
    IdempotencyKey,
    JobRecord,
    MeasurementSetRecord,
    RobotRecord,
)

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
hostile = pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE.keys())


@pytest.fixture
def store(database_url: str) -> Iterator[Store]:
    with Store.open(database_url) as opened:
        yield opened


def robot(identifier: str = "r1", **changes: Any) -> RobotRecord:
    record = RobotRecord(identifier, "KR 240 cell 3", TIME, "0" * 64, '{"Gelenk": "β₁ 🤖"}')
    return dataclasses.replace(record, **changes)


def measurement_set(identifier: str = "s1", **changes: Any) -> MeasurementSetRecord:
    record = MeasurementSetRecord(
        identifier, "r1", "dead weight", "motor", 19, 0, TIME, "1" * 64, "{}", bytes(range(256)) * 9
    )
    return dataclasses.replace(record, **changes)


def run(identifier: str = "u1", **changes: Any) -> JobRecord:
    return job_record(RUN, identifier, **changes)


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

    @hostile
    def test_missing_parents(self, store: Store, text: str) -> None:
        key = IdempotencyKey("k", "b")
        with pytest.raises(NotFoundError) as caught:
            store.sets.add(measurement_set(robot_id=text), key)
        assert (caught.value.kind, caught.value.id) == (store.robots.resource, text)
        store.robots.add(robot())
        with pytest.raises(NotFoundError) as caught:
            store.jobs(RUN).add(run(measurement_set_id=text))
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
            with pytest.raises(ValueError, match="no page"):
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
            assert len(set(answers)) == 1
            found = store.robots.page(limit=50).records
            assert (found[0], len(found)) == (answers[0], attempt + 1)

    def test_simultaneous_posts_through_separate_stores(self, database_url: str) -> None:
        def post(number: int) -> RobotRecord:
            with Store.open(database_url) as store:
                return store.robots.add(robot(f"r{number}"), self.KEY)

        answers = together(6, post)
        assert len(set(answers)) == 1

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
