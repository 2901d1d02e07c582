"""Lists over HTTP: searched, sorted and counted; a wrong order is refused with those that work."""

import pytest
from support.in_process import Client
from support.jobs import runs_of, set_of

from jointstiff.schemas.run import RunRequest
from jointstiff.service.jobs import Parts
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign

LISTS = ["/v1/jobs", "/v1/robots", "/v1/measurement-sets", "/v1/measurement-sets?open=true"]


@pytest.fixture(scope="module")
def client():
    """A service with two campaigns and a run of each."""
    with Store.open("sqlite://") as store:
        for name in ("cell B7", "Cell a8"):
            document = simulate_campaign(default_arm(), load="pull", configurations=8, seed=1)
            document["robot"]["name"] = name
            document["measurement_set"] |= {"name": f"day of {name}", "serial_number": "W-1"}
            set_id = set_of(Parts(store), document)
            runs_of(store).create(RunRequest(measurement_set_id=set_id), None)
        yield Client(store)


def listed(client, path, **query):
    answer = client.get(path, params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()


@pytest.mark.parametrize("path", LISTS)
@pytest.mark.parametrize("sort", ["size", "NAME", "+name", "name,created_at", "", "document", "'"])
def test_a_wrong_order_is_refused_with_those_that_work(client, path, sort):
    answer = client.get(path, params={"sort": sort} | ({"open": True} if "open" in path else {}))
    assert answer.status_code == 422
    (error,) = answer.json()["errors"]
    assert error["where"] == "query.sort"
    for order in ("created_at", "-created_at", "name", "-name"):
        assert f"'{order}'" in error["reason"]


@pytest.mark.parametrize("path", LISTS)
def test_each_list_takes_a_search_an_order_and_says_its_total(client, path):
    query = {"open": True} if "open" in path else {}
    found = listed(client, path, q="a8 CELL", sort="-name", **query)
    assert found["total"] == len(found["items"]) == (0 if query else 1)
    assert listed(client, path, q="nobody's", **query) == {"items": [], "next": None, "total": 0}


def test_the_total_is_that_of_all_pages(client):
    first = listed(client, "/v1/jobs", limit=1, sort="name")
    assert (len(first["items"]), first["total"]) == (1, 2)
    last = listed(client, "/v1/jobs", limit=1, sort="name", cursor=first["next"])
    assert (len(last["items"]), last["next"], last["total"]) == (1, None, None)


def test_a_row_of_a_run_has_the_names_of_its_robot_and_set(client):
    rows = listed(client, "/v1/jobs", sort="name")["items"]
    names = [(row["robot_name"], row["measurement_set_name"], row["serial_number"]) for row in rows]
    assert names == [("Cell a8", "day of Cell a8", "W-1"), ("cell B7", "day of cell B7", "W-1")]


def test_an_empty_search_and_one_too_long(client):
    assert listed(client, "/v1/robots", q="")["total"] == 2
    assert client.get("/v1/robots", params={"q": "x" * 201}).status_code == 422
