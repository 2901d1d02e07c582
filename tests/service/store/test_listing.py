"""Lists by the database: searched, sorted, counted, of rows alone, by the same plans on each file."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest
import sqlalchemy as sa
from support.jobs import RUN, TIME, job_record

from jointstiff.service.problems import CursorError
from jointstiff.service.store import listing
from jointstiff.service.store.jobs import JOB
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import MeasurementSetRecord, RobotRecord, robots

TREND = '{"result":{"joints":[],"assessment":{"verdict":"use","reasons":[]}}}'


@pytest.fixture
def store(database_url: str) -> Iterator[Store]:
    with Store.open(database_url) as opened:
        yield opened


def add_robot(store, identifier, name):
    return store.robots.add(RobotRecord(identifier, name, TIME, "0" * 64, "{}"))


def add_set(store, identifier, name, robot_id="r1", **metadata):
    record = MeasurementSetRecord(
        identifier, robot_id, name, "motor", 19, 0, TIME, "1" * 64, "{}", b"", **metadata
    )
    return store.sets.add(record)


def add_run(store, identifier, set_id="s1", robot_id="r1", **values):
    changes = {"measurement_set_id": set_id, "robot_id": robot_id} | values
    return store.jobs(RUN).add(job_record(RUN, identifier, **changes))


def ids(page):
    return [record.id for record in page.records]


def found(records, q, **options):
    return ids(records.page(limit=50, q=q, **options))


def all_pages(records, **options):
    page = records.page(limit=2, **options)
    listed = ids(page)
    while page.next is not None:
        page = records.page(limit=2, cursor=page.next, **options)
        listed += ids(page)
    return listed


def test_sets_and_runs_are_found_by_operator_and_instrument(store):
    add_robot(store, "r1", "arm")
    add_set(store, "s1", "first", operator="M. Keller", instrument="Leica AT960")
    add_set(store, "s2", "second", operator="N. Nguyen")
    add_run(store, "j1")
    runs = store.jobs(RUN)
    assert found(store.sets, "keller at960") == found(store.sets, "first leica") == ["s1"]
    assert found(runs, "KELLER") == ["j1"]
    store.sets.change("s1", lambda _: {"operator": "O. Okafor"})
    assert (found(store.sets, "keller"), found(runs, "keller")) == ([], [])
    assert (found(store.sets, "okafor leica"), found(runs, "okafor leica")) == (["s1"], ["j1"])


def test_names_of_any_length_and_script_fit_into_the_index_of_searches(store):
    """The index of PostgreSQL takes 2704 bytes: the last names are searched by what has room."""
    name = "\N{ROBOT FACE}" * 200  # 4 bytes each
    add_robot(store, "r1", name)
    add_set(store, "s1", name, serial_number=name, operator=name, instrument=name)
    add_run(store, "j1", name=name)
    assert found(store.jobs(RUN), name[:150]) == ["j1"]
    assert found(store.sets, name[:150]) == ["s1"]


@pytest.mark.parametrize("sort", ["created_at", "name"])
def test_pages_in_any_order_have_each_record_once(store, sort):
    """Names that are equal are in the order in which they came."""
    for number, name in enumerate(["b", "A", "a", "ä", "b", "B", "Z"]):
        add_robot(store, f"r{number}", name)
    order = {"created_at": "0123456", "name": "1204563"}[sort]
    assert all_pages(store.robots, sort=sort) == [f"r{number}" for number in order]
    assert all_pages(store.robots, sort=f"-{sort}") == [f"r{number}" for number in reversed(order)]


def test_a_page_by_name_goes_on_after_a_record_that_was_deleted(store):
    for number in range(4):
        add_robot(store, f"r{number}", f"name {number}")
    first = store.robots.page(limit=2, sort="name")
    store.robots.delete("r1")
    assert ids(store.robots.page(limit=2, sort="name", cursor=first.next)) == ["r2", "r3"]
    with store._database.writing() as connection:
        connection.execute(sa.delete(robots).where(robots.c.id == "r1"))
    with pytest.raises(CursorError):
        store.robots.page(limit=2, sort="name", cursor=first.next)


def test_a_search_finds_parts_of_any_name_that_a_row_shows(store):
    add_robot(store, "r1", "KR 240 Straße 3")
    add_robot(store, "r2", "R-2000iC")
    add_set(store, "s1", "March, 100% load", serial_number="W-4711")
    add_set(store, "s2", "April_a", robot_id="r2")
    add_run(store, "u1")
    add_run(store, "u2", "s2", "r2", name="my April")
    runs = store.jobs(RUN)
    for q, hits in {
        "kr 240": ["u1"],
        "240 KR": ["u1"],
        "STRASSE": ["u1"],
        "w-47": ["u1"],
        "100%": ["u1"],
        "%": ["u1"],
        "april_": ["u2"],
        "my": ["u2"],
        "r": ["u2", "u1"],
        "kr april": [],
        "'; --": [],
        "a\x00": [],
        "\ud800": [],
        "": ["u2", "u1"],
    }.items():
        assert found(runs, q) == hits, q
    assert found(store.sets, "kr") == ["s1"]
    assert found(store.robots, "2000") == ["r2"]
    assert found(runs, "r", filters={"robot_id": "r1"}) == ["u1"]
    assert found(runs, "r", sort="name") == ["u1", "u2"], "a run without a name has that of its set"


def test_a_search_goes_through_what_a_robot_and_its_set_are_called_now(store):
    """And a list shows it."""
    add_robot(store, "r1", "old cell")
    add_set(store, "s1", "old day", serial_number="W-1")
    add_run(store, "u1")
    store.robots.change("r1", lambda _: {"name": "new cell"})
    store.sets.change("s1", lambda _: {"name": "new day", "serial_number": "W-2"})
    (entry,) = store.jobs(RUN).page(limit=9).records
    shown = (entry.robot_name, entry.measurement_set_name, entry.serial_number)
    assert shown == ("new cell", "new day", "W-2")
    for q, hits in {"old": [], "w-1": [], "new cell": ["u1"], "new day": ["u1"], "w-2": ["u1"]}.items():
        assert found(store.jobs(RUN), q) == hits, q
    assert found(store.sets, "new cell new day w-2") == ["s1"]


def test_names_that_change_while_runs_come_are_those_of_all_rows(store):
    """And nobody waits for another who waits for him."""
    add_robot(store, "r1", "robot")
    add_set(store, "s1", "set")

    def work(number: int) -> None:
        for step in range(5):
            if number == 0:
                store.robots.change("r1", lambda _, step=step: {"name": f"robot {step}"})
            elif number == 1:
                store.sets.change("s1", lambda _, step=step: {"name": f"set {step}"})
            else:
                add_run(store, f"u{number}_{step}", trend=TREND)
                store.jobs(RUN).delete(f"u{number}_{step}")
                store.jobs(RUN).restore(f"u{number}_{step}")

    with ThreadPoolExecutor(6) as pool:
        for each in [pool.submit(work, number) for number in range(6)]:
            each.result()
    entries = store.jobs(RUN).page(limit=99).records
    assert {(entry.robot_name, entry.measurement_set_name) for entry in entries} == {("robot 4", "set 4")}
    assert len(found(store.jobs(RUN), "robot 4 set 4")) == len(entries) == 20


def test_the_first_page_counts_what_all_pages_have(store):
    add_robot(store, "r1", "robot")
    add_set(store, "s1", "set")
    for number in range(7):
        add_run(store, f"u{number}", verdict="use" if number < 5 else "do_not_use")
    store.jobs(RUN).delete("u0")
    runs = store.jobs(RUN)
    first = runs.page(limit=2, counted=True)
    assert first.total == 6
    assert runs.page(limit=2, counted=True, cursor=first.next).total is None
    assert runs.page(limit=2).total is None, "to count costs time"
    assert runs.page(limit=2, counted=True, filters={"verdict": "use"}, q="set").total == 4
    assert runs.page(limit=50, counted=True, q="nothing").total == 0
    assert runs.page(limit=2, counted=True, deleted=True).total == 1


@pytest.mark.parametrize("sort", ["created_at", "-name"])
@pytest.mark.parametrize("q", [None, "set"])
def test_records_are_counted_to_a_number_and_one_more(store, monkeypatch, sort, q):
    monkeypatch.setattr(listing, "MOST_COUNTED", 4)
    add_robot(store, "r1", "arm")
    for number in range(7):
        add_set(store, f"s{number}", f"set {number}")
        counted = store.sets.page(limit=2, counted=True, sort=sort, q=q)
        assert counted.total == min(number + 1, 5)
        assert len(counted.records) == min(number + 1, 2)


def test_a_robot_shows_its_last_campaign_until_runs_or_sets_change(store):
    add_robot(store, "r1", "robot")
    add_set(store, "s1", "set")

    def entry():
        (listed,) = store.robots.page(limit=9).records
        return listed

    assert (entry().is_current, entry().campaign) == (True, None)
    add_run(store, "failed")
    assert entry().is_current, "a run without numbers changes nothing"
    changes = [
        lambda: add_run(store, "u1", trend=TREND),
        lambda: store.jobs(RUN).delete("u1"),
        lambda: store.jobs(RUN).restore("u1"),
        lambda: store.sets.change("s1", lambda _: {"serial_number": "W-2"}),
    ]
    for number, change in enumerate(changes):
        change()
        assert not entry().is_current, number
        assert [due.id for due in store.robots.list_outdated(9)] == ["r1"]
        before = entry()
        store.robots.store_last_campaign(before, {"number": number})
        assert (entry().is_current, entry().campaign) == (True, {"number": number})
        assert store.robots.list_outdated(9) == []
    add_run(store, "u2", trend=TREND)
    slow = entry()
    add_run(store, "u3", trend=TREND)
    store.robots.store_last_campaign(slow, {"of": "u2"})
    assert not entry().is_current, "another run came after it was derived"
    store.robots.store_last_campaign(entry(), {"of": "u3"})
    store.robots.store_last_campaign(slow, {"of": "u2"})
    assert (entry().is_current, entry().campaign) == (True, {"of": "u3"}), "one that is late changes nothing"


@contextmanager
def statements(store) -> Iterator[list[tuple[str, object]]]:
    """Note the statements on a store, with their parameters."""
    noted: list[tuple[str, object]] = []

    def note(_connection, _cursor, statement, parameters, *_rest):
        noted.append((statement, parameters))

    with store._database.reading() as connection:
        engine = connection.engine
    sa.event.listen(engine, "before_cursor_execute", note)
    try:
        yield noted
    finally:
        sa.event.remove(engine, "before_cursor_execute", note)


def list_everything(store):
    runs = store.jobs(RUN)
    for sort in ("-created_at", "name"):
        for filters in ({}, {"robot_id": "r1"}, {"state": "succeeded", "verdict": "use"}):
            for records in (runs, store.jobs(JOB)):
                records.page(limit=2, counted=True, sort=sort, q="e", filters=filters)
                records.page(limit=2, counted=True, sort=sort, filters=filters)
        store.robots.page(limit=2, counted=True, sort=sort, q="e")
        store.sets.page(limit=2, counted=True, sort=sort, q="e")


def test_a_list_reads_no_documents(store):
    with statements(store) as noted:
        list_everything(store)
    assert len(noted) > 15
    assert [statement for statement, _ in noted if "document" in statement or "arrays" in statement] == []


def test_robots_and_their_last_campaigns_are_one_query(store):
    for number in range(5):
        add_robot(store, f"r{number}", "robot")
        add_set(store, f"s{number}", "set", f"r{number}")
        add_run(store, f"u{number}", f"s{number}", f"r{number}", trend=TREND)
    with statements(store) as noted:
        assert len(store.robots.page(limit=9).records) == 5
    assert len(noted) == 1


def plans(path: Path) -> list[str]:
    """How SQLite finds what lists show, in a new file."""
    with Store.open(f"sqlite:///{path}") as store:
        add_robot(store, "r1", "robot")
        add_set(store, "s1", "set")
        for number in range(5):  # more than a page, so that the others are counted
            add_run(store, f"u{number}", verdict="use")
        with statements(store) as noted:
            list_everything(store)
            store.runs_with_numbers("r1", 9)
            store.sets_of_robot("r1")
            store.robots.list_outdated(9)
        with store._database.reading() as connection:
            return [
                "\n".join(
                    row[3]
                    for row in connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {statement}", parameters)
                )
                for statement, parameters in noted
            ]


def test_all_new_files_have_the_same_plans_and_each_is_by_an_index(tmp_path):
    first, *others = [plans(tmp_path / f"{number}.db") for number in range(8)]
    assert all(other == first for other in others)
    for plan in first:
        if "PRIMARY KEY" in plan and "SUBQUERY" not in plan:
            continue  # rows of a search, whose numbers the statement before has found
        assert "INDEX" in plan
        found_by = plan.partition("SUBQUERY")[2] or plan
        if "robot_id" not in found_by and "due" not in found_by:
            assert "COVERING INDEX" in found_by, plan
