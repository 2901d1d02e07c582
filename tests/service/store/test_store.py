"""The store's contract, the same on both databases."""

from __future__ import annotations

import dataclasses
import itertools
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, timedelta, timezone
from typing import Any, TypeVar

import pytest
from support.records import RESOURCES, RUN, TIME, job_record, keeper

from jointstiff.service.problems.errors import (
    CursorError,
    IdempotencyConflictError,
    NotFoundError,
    StoreError,
)
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import (
    IdempotencyKey,
    JobEntry,
    JobRecord,
    MeasurementSetEntry,
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
    def test_come_back_as_they_went(self, store: Store) -> None:
        for record in (robot(), measurement_set(), run()):
            assert keeper(store, record).add(record) == record
            assert keeper(store, record).get(record.id) == record

    def test_survive_closing(self, database_url: str) -> None:
        with Store.open(database_url) as first:
            first.robots.add(robot())
        with Store.open(database_url) as second:
            assert second.robots.get("r1") == robot()

    @pytest.mark.parametrize("positive", [True, False])
    def test_booleans_stay_booleans(self, store: Store, positive: bool) -> None:
        store.robots.add(robot())
        store.sets.add(measurement_set())
        store.jobs(RUN).add(run(summary={"positive": positive}))
        assert store.jobs(RUN).get("u1").summary == {"positive": positive}
        assert store.jobs(RUN).page(limit=1).records[0].summary["positive"] is positive

    def test_times_come_back_in_utc(self, store: Store) -> None:
        east = TIME.astimezone(timezone(timedelta(hours=5, minutes=45)))
        store.robots.add(robot(created_at=east))
        found = store.robots.get("r1").created_at
        assert found == TIME
        assert found.tzinfo is UTC

    def test_times_without_zone_are_a_mistake(self, store: Store) -> None:
        with pytest.raises(Exception, match="time zone"):
            store.robots.add(robot(created_at=TIME.replace(tzinfo=None)))
        assert store.robots.page(limit=1).records == ()

    @pytest.mark.parametrize("arrays", [b"", b"\x00", b"PK\x03\x04\xff\xfe\x00'\"\\", b"\n" * 2**21])
    def test_blobs_are_exact(self, store: Store, arrays: bytes) -> None:
        store.robots.add(robot())
        store.sets.add(measurement_set(arrays=arrays))
        found = store.sets.get("s1").arrays
        assert type(found) is bytes
        assert found == arrays

    def test_documents_are_exact(self, store: Store) -> None:
        document = '{"a": "\\u0000", "b": "\r\n\t \u2028 é e\u0301 🤖", "c": 1.0e-300}'
        store.robots.add(robot(document=document))
        assert store.robots.get("r1").document == document

    def test_ids_that_nothing_has(self, store: Store, subtests: pytest.Subtests) -> None:
        kept = [store.robots, store.sets, *map(store.jobs, RESOURCES.values())]
        for (name, text), collection in itertools.product(HOSTILE.items(), kept):
            with subtests.test(name, kind=collection.resource.name):
                with pytest.raises(NotFoundError) as caught:
                    collection.get(text)
                assert (caught.value.kind, caught.value.id) == (collection.resource, text)
                assert caught.value.remedy
                assert len(caught.value.reason.encode()) < 600

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


class TestPages:
    def test_newest_first_and_undisturbed_by_what_comes(self, store: Store) -> None:
        for number in range(7):  # in the order of arrival, whatever the clock said
            store.robots.add(robot(f"r{number}", created_at=TIME - timedelta(days=number)))
        seen, cursor = [], None
        for page_number in range(10):
            page = store.robots.page(limit=3, cursor=cursor)
            seen += [record.id for record in page.records]
            store.robots.add(robot(f"new{page_number}"))
            if (cursor := page.next) is None:
                break
        assert seen == ["r6", "r5", "r4", "r3", "r2", "r1", "r0"]

    @pytest.mark.parametrize("limit", [3, 4, 1_000_000])
    def test_the_last_page_says_so(self, store: Store, limit: int) -> None:
        for number in range(3):
            store.robots.add(robot(f"r{number}"))
        page = store.robots.page(limit=limit)
        assert len(page.records) == 3
        assert page.next is None

    def test_entries_are_records_without_contents(self, store: Store) -> None:
        store.robots.add(robot())
        store.sets.add(measurement_set())
        store.jobs(RUN).add(run())
        for kind, record in ((MeasurementSetEntry, measurement_set()), (JobEntry, run())):
            (entry,) = keeper(store, record).page(limit=5).records
            assert type(entry) is kind
            names = [field.name for field in dataclasses.fields(kind)]
            assert not {"document", "arrays"} & set(names)
            assert all(getattr(entry, name) == getattr(record, name) for name in names)
        assert store.robots.page(limit=5).records == (robot(),)

    def test_filters(self, store: Store) -> None:
        for identifier in ("r1", "r2"):
            store.robots.add(robot(identifier, name=f"name of {identifier}"))
        store.sets.add(measurement_set())
        store.sets.add(measurement_set("s2", robot_id="r2", name="other", encoders="secondary"))
        store.jobs(RUN).add(run())
        columns = {"measurement_set_id": "s2", "robot_id": "r2", "state": "s"}
        columns |= {"method": "m", "weighting": "w", "elasticity": "e"}
        store.jobs(RUN).add(run("u2", **columns))
        for kind, second, values in (
            (store.robots, "r2", {"name": "name of r2"}),
            (store.sets, "s2", {"robot_id": "r2", "name": "other", "encoders": "secondary"}),
            (store.jobs(RUN), "u2", columns),
        ):
            for name, value in values.items():
                page = kind.page(limit=5, filters={name: value})
                assert [found.id for found in page.records] == [second]
                assert kind.page(limit=5, filters={name: value.upper() + "?"}).records == ()
            page = kind.page(limit=5, filters=values)
            assert [found.id for found in page.records] == [second]

    def test_filtered_pages_follow_each_other(self, store: Store) -> None:
        for number in range(10):
            store.robots.add(robot(f"r{number}", name="even" if number % 2 == 0 else "odd"))
        first = store.robots.page(limit=3, filters={"name": "even"})
        second = store.robots.page(limit=3, filters={"name": "even"}, cursor=first.next)
        ids = [[record.id for record in page.records] for page in (first, second)]
        assert ids == [["r8", "r6", "r4"], ["r2", "r0"]]

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

    def test_the_greatest_cursor_shows_everything(self, store: Store) -> None:
        store.robots.add(robot())
        assert store.robots.page(limit=5, cursor=str(2**63 - 1)).records == (robot(),)

    def test_mistakes_of_ours(self, store: Store) -> None:
        mistakes: list[tuple[int, dict[str, str]]] = [(0, {}), (-1, {}), (5, {"document": "{}"})]
        for limit, filters in mistakes:
            with pytest.raises(ValueError, match="no page"):
                store.robots.page(limit=limit, filters=filters)


class TestIdempotency:
    KEY = IdempotencyKey("a key", "hash of a body")
    OTHER_BODY = dataclasses.replace(KEY, body_hash="hash of another body")

    def test_the_second_post_returns_the_first_resource(self, store: Store) -> None:
        assert store.robots.find(self.KEY) is None
        first = store.robots.add(robot(), self.KEY)
        assert store.robots.find(self.KEY) == first
        assert store.robots.add(robot("r2", name="another"), self.KEY) == first
        assert store.robots.page(limit=5).records == (first,)

    def test_another_body_is_refused(self, store: Store) -> None:
        store.robots.add(robot(), self.KEY)
        for attempt in (
            lambda: store.robots.find(self.OTHER_BODY),
            lambda: store.robots.add(robot("r2"), self.OTHER_BODY),
        ):
            with pytest.raises(IdempotencyConflictError) as caught:
                attempt()
            assert (caught.value.kind, caught.value.key) == (store.robots.resource, "a key")
        assert store.robots.page(limit=5).records == (robot(),)

    def test_a_key_counts_for_its_kind_only(self, store: Store) -> None:
        for record in (robot("x"), measurement_set("x", robot_id="x")):
            keeper(store, record).add(record, self.KEY)
        store.jobs(RUN).add(run("x", measurement_set_id="x", robot_id="x"), self.OTHER_BODY)
        assert store.sets.find(self.KEY) == measurement_set("x", robot_id="x")

    def test_a_failed_post_leaves_the_key_free(self, store: Store) -> None:
        with pytest.raises(NotFoundError):
            store.sets.add(measurement_set(), self.KEY)
        store.robots.add(robot())
        assert store.sets.add(measurement_set(), self.OTHER_BODY) == measurement_set()

    @hostile
    def test_keys_may_be_any_text(self, store: Store, text: str) -> None:
        key = IdempotencyKey(text, "b")
        assert store.robots.find(key) is None
        store.robots.add(robot(), key)
        assert store.robots.add(robot("r2"), key) == robot()
        assert store.robots.find(IdempotencyKey(text + "!", "b")) is None
        with pytest.raises(IdempotencyConflictError) as caught:
            store.robots.find(IdempotencyKey(text, "c"))
        assert len(caught.value.reason.encode()) < 600

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
