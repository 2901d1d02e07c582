"""Metadata, names and archived: changed beside the readings, listed and filtered by, on both databases."""

from __future__ import annotations

import pytest
from support.api import post

from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture(scope="module")
def campaign():
    return simulate_campaign(default_arm(), load="pull", configurations=7, seed=1)


@pytest.fixture
def robot(local, campaign):
    return post(local, "/v1/robots", campaign["robot"])


def changed(local, path, **change):
    answer = local.request("PATCH", path, json=change)
    assert answer.status_code == 200, answer.text
    return answer.json()


def listed(local, path, **query):
    return [item["id"] for item in local.get(path, params=query).json()["items"]]


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


def test_a_span_that_ends_before_it_begins_is_refused(local):
    span = {"measured_from": "2026-11-21T00:00:00Z", "measured_to": "2026-11-20T00:00:00Z"}
    answer = local.get("/v1/measurement-sets", params=span)
    assert answer.status_code == 422
    assert "after" in answer.text
