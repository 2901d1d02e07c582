"""Metadata, names and archived: changed beside the readings, listed and filtered by, on both databases."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

import pytest

from jointstiff import identify
from jointstiff.schemas.run import Campaign
from jointstiff.service.problems.errors import NotFoundError
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import MeasurementSetRecord, RobotRecord
from jointstiff.simulator import default_arm, simulate_campaign

TIME = datetime(2026, 11, 20, 12, tzinfo=UTC)
NOTED = {
    "measured_at": "2026-11-20T14:30:00+01:00",
    "operator": "M. Keller",
    "instrument": "Leica AT960, 750123",
    "serial_number": "F-211034",
    "item_condition": "as found",
    "conditions": "21 °C, warmed up for 30 min",
    "notes": "before the gearbox of axis 2\nwas replaced",
}
KEPT = NOTED | {"measured_at": "2026-11-20T13:30:00Z"}


@pytest.fixture(scope="module")
def campaign():
    return simulate_campaign(default_arm(), load="pull", configurations=7, seed=1)


@pytest.fixture
def robot(local, campaign):
    return post(local, "/v1/robots", campaign["robot"])


def post(local, path, body):
    answer = local.request("POST", path, json=body)
    assert answer.status_code == 201, answer.text
    return answer.json()


def stored(local, campaign, robot, **noted):
    return post(
        local, "/v1/measurement-sets", campaign["measurement_set"] | {"robot_id": robot["id"]} | noted
    )


def changed(local, path, **change):
    answer = local.request("PATCH", path, json=change)
    assert answer.status_code == 200, answer.text
    return answer.json()


def listed(local, path, **query):
    return [item["id"] for item in local.get(path, params=query).json()["items"]]


def metadata(document):
    return {name: document[name] for name in NOTED}


def test_metadata_come_with_the_readings_and_change_beside_them(local, campaign, robot):
    posted = stored(local, campaign, robot, **NOTED)
    path = f"/v1/measurement-sets/{posted['id']}"
    assert metadata(posted) == KEPT
    before = local.get(path).json()
    run = post(local, "/v1/runs", {"measurement_set_id": posted["id"]})
    answer = changed(local, path, operator="B. Roux", notes=None)
    assert metadata(answer) == KEPT | {"operator": "B. Roux", "notes": None}
    after = local.get(path).json()
    assert metadata(after) == metadata(answer)
    assert {n: v for n, v in before.items() if n not in NOTED} == {
        n: v for n, v in after.items() if n not in NOTED
    }
    again = post(local, "/v1/runs", {"measurement_set_id": posted["id"]})
    assert again["provenance"]["input_hash"] == run["provenance"]["input_hash"]


def test_sets_of_the_same_readings_are_two_of_one_hash(local, campaign, robot):
    one, two = stored(local, campaign, robot, operator="A"), stored(local, campaign, robot, operator="B")
    assert one["id"] != two["id"]
    assert one["content_hash"] == two["content_hash"]
    found = listed(local, "/v1/measurement-sets", content_hash=one["content_hash"], robot_id=robot["id"])
    assert found == [two["id"], one["id"]]


def test_names_change_and_what_was_computed_stays(local, campaign, robot):
    posted = stored(local, campaign, robot)
    for path in (f"/v1/robots/{robot['id']}", f"/v1/measurement-sets/{posted['id']}"):
        before = local.get(path).json()
        assert changed(local, path, name="cell 4")["name"] == "cell 4"
        assert changed(local, path, name=None)["name"] == "cell 4"
        assert local.get(path).json() == before | {"name": "cell 4"}
        assert before["id"] in listed(local, path.rpartition("/")[0], name="cell 4")
    post(local, "/v1/runs", {"measurement_set_id": posted["id"]})


def test_archived_ones_leave_the_lists_and_nothing_else(local, campaign, robot):
    posted = stored(local, campaign, robot)
    run = post(local, "/v1/runs", {"measurement_set_id": posted["id"]})
    for path in (f"/v1/robots/{robot['id']}", f"/v1/measurement-sets/{posted['id']}"):
        collection, _, identifier = path.rpartition("/")
        assert not local.get(path).json()["archived"]
        assert changed(local, path, archived=True)["archived"]
        assert identifier not in listed(local, collection, limit=100)
        assert listed(local, collection, archived="true") == [identifier]
        assert local.get(path).json()["archived"]
    assert run["id"] in listed(local, "/v1/runs")
    post(local, "/v1/runs", {"measurement_set_id": posted["id"]})
    for path in (f"/v1/robots/{robot['id']}", f"/v1/measurement-sets/{posted['id']}"):
        changed(local, path, archived=False)
        assert path.rpartition("/")[2] in listed(local, path.rpartition("/")[0], limit=100)


def test_filters(local, campaign, robot):
    first = stored(local, campaign, robot, **NOTED)["id"]
    other = {"measured_at": "2026-11-21T08:00:00Z", "operator": "B. Roux", "serial_number": "F-2"}
    second = stored(local, campaign, robot, **other)["id"]
    third = stored(local, campaign, robot)["id"]

    def found(**query):
        return listed(local, "/v1/measurement-sets", robot_id=robot["id"], **query)

    assert found() == [third, second, first]
    for name in ("operator", "instrument", "serial_number"):
        assert found(**{name: NOTED[name]}) == [first]
    assert found(serial_number="none of these") == []
    assert found(measured_from="2026-11-20T13:30:00Z") == [second, first]
    assert found(measured_from="2026-11-20T13:30:00.000001Z") == [second]
    assert found(measured_to="2026-11-21T09:00:00+01:00") == [first]
    assert found(measured_from="2026-11-20T00:00:00Z", measured_to="2026-11-20T13:30:00Z") == []
    twins = listed(local, "/v1/robots", content_hash=robot["content_hash"])
    assert robot["id"] in twins
    assert len(twins) > 1
    assert listed(local, "/v1/robots", content_hash="0" * 64) == []


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"measured_at": "2026-11-20T14:30:00"}, "timezone"),
        ({"measured_at": "2026-11-20"}, "timezone"),
        ({"measured_at": 1_795_000_000}, "date and a time with its zone"),
        ({"measured_at": "1795000000"}, "date and a time with its zone"),
        ({"measured_at": 1.795e9}, "date and a time with its zone"),
        ({"measured_at": "0001-01-01T00:00:00+14:00"}, "between 1980 and 2200"),
        ({"measured_at": "9999-12-31T23:59:59-14:00"}, "between 1980 and 2200"),
        ({"operator": ""}, "at least 1"),
        ({"operator": "a\u0000b"}, "printable"),
        ({"serial_number": " F"}, "blanks"),
        ({"instrument": "x" * 201}, "at most 200"),
        ({"conditions": "two\nlines"}, "printable"),
        ({"notes": "a\u0000b"}, "printable"),
        ({"notes": "x" * 2001}, "at most 2000"),
        ({"serial": "F"}, "unknown field"),
        ({"content_hash": "0"}, "unknown field"),
        ({"archived": "perhaps"}, "true or false"),
    ],
)
def test_what_cannot_be_metadata_is_refused(local, campaign, robot, change, reason):
    answer = local.request("PATCH", "/v1/measurement-sets/none", json=change)
    assert answer.status_code == 422
    assert reason in answer.text
    assert next(iter(change)) in answer.json()["where"]


@pytest.mark.parametrize("query", [{"measured_from": "yesterday"}, {"archived": "perhaps"}, {"serial": "F"}])
def test_a_filter_that_cannot_be_is_refused(local, query):
    assert local.get("/v1/measurement-sets", params=query).status_code == 422


def test_a_span_that_ends_before_it_begins_is_refused(local):
    span = {"measured_from": "2026-11-21T00:00:00Z", "measured_to": "2026-11-20T00:00:00Z"}
    answer = local.get("/v1/measurement-sets", params=span)
    assert answer.status_code == 422
    assert "after" in answer.text


def test_what_is_not_there_cannot_change(local):
    for path in ("/v1/robots/none", "/v1/measurement-sets/none"):
        assert local.request("PATCH", path, json={"name": "n"}).status_code == 404
        assert local.request("PATCH", path, json={}).status_code == 404


@pytest.fixture
def database(database_url):
    """A database with a robot and a set without metadata."""
    with Store.open(database_url) as store:
        store.robots.add(RobotRecord("r1", "robot", TIME, "h", "{}"))
        store.sets.add(MeasurementSetRecord("s1", "r1", "set", "motor", 1, 0, TIME, "h", "{}", b"\x00"))
        yield store


def test_what_has_no_metadata_takes_it(database):
    before = database.sets.get("s1")
    assert before == MeasurementSetRecord("s1", "r1", "set", "motor", 1, 0, TIME, "h", "{}", b"\x00")
    local = datetime(2026, 11, 20, 14, 30, tzinfo=timezone(timedelta(hours=1)))
    after = database.sets.change("s1", {"measured_at": local, "notes": "µ", "archived": True})
    assert (after.measured_at, after.measured_at.utcoffset()) == (local, timedelta(0))
    assert (after.notes, after.archived, after.arrays) == ("µ", True, b"\x00")
    assert database.sets.page(limit=5).records == ()
    (entry,) = database.sets.page(limit=5, archived=True).records
    assert entry.measured_at == local
    for end, found in ((local, 0), (local + timedelta(microseconds=1), 1)):
        page = database.sets.page(limit=5, archived=True, spans={"measured_at": (local, end)})
        assert len(page.records) == found
    database.sets.delete("s1", TIME)
    assert [entry.id for entry in database.sets.page(limit=5, deleted=True).records] == ["s1"]
    with pytest.raises(NotFoundError):
        database.sets.change("\x00", {"notes": "n"})
    with pytest.raises(NotFoundError):
        database.sets.change("s1", {"notes": "n"})


def test_a_campaign_file_carries_them_and_gives_the_same_run(campaign):
    noted = campaign | {"measurement_set": campaign["measurement_set"] | NOTED}
    plain, with_notes = (identify(Campaign.model_validate(document)) for document in (campaign, noted))
    assert with_notes.provenance.input_hash == plain.provenance.input_hash
    assert with_notes.result.joints == plain.result.joints
