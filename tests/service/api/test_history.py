"""The history of two arms, a joint of each 10 % softer since a day: trends, and lists of sets and runs."""

import csv
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from support.api import job_at, post
from support.in_process import Client

from jointstiff.service.library.results import RobotTrend
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign

ARM = default_arm()
DAYS = [f"2021-{month:02d}-10T08:00:00Z" for month in range(1, 10)]


def measured(client, robot, number, seed, soft=1.0, **more):
    """Post a campaign with joint_3 softer by a factor, and identify it; return the run."""
    springs = replace(ARM, stiffnesses=ARM.stiffnesses * [1, 1, soft, 1, 1, 1])
    document = simulate_campaign(springs, load="pull", configurations=10, seed=seed)["measurement_set"]
    stated = {"serial_number": "A", "name": f"campaign {number}", "measured_at": DAYS[number]} | more
    made = post(client, "/v1/measurement-sets", document | {"robot_id": robot} | stated)
    return post(client, "/v1/runs", {"measurement_set_id": made["id"], "elasticity": "joints"})


def robot_of(client, name):
    document = simulate_campaign(ARM, configurations=2)["robot"] | {"name": name}
    return post(client, "/v1/robots", document)["id"]


@pytest.fixture(scope="module")
def client():
    with Store.open("sqlite://") as store:
        yield Client(store)


@pytest.fixture(scope="module")
def worn(client):
    """A robot of two campaigns, and its trend after the first."""
    robot = robot_of(client, "worn")
    measured(client, robot, 0, 1)
    before = client.get(f"/v1/robots/{robot}/trend").json()
    measured(client, robot, 1, 2, soft=0.9)
    return robot, before


@pytest.fixture(scope="module")
def long(client):
    """A robot of six campaigns of arm A, softer since the fourth, then one of arm B; the runs."""
    robot = robot_of(client, "long")
    runs = [
        measured(client, robot, i, i + 11, soft=0.9 if i > 2 else 1.0, instrument="T1" if i < 4 else "T2")
        for i in range(6)
    ]
    return robot, [*runs, measured(client, robot, 7, 31, serial_number="B")]


def trend(client, robot, **query):
    return client.get(f"/v1/robots/{robot}/trend", params=query).json()


def test_one_campaign_is_shown_and_compared_with_nothing(worn):
    _, before = worn
    assert before["note"] == "only one campaign: a second one is needed to compare"
    assert {(each["change"], each["p_value"], each["changed"]) for each in before["joints"]} == {
        (None, None, False)
    }
    (point,) = before["joints"][2]["points"]
    assert point["stiffness"] == pytest.approx(2.462e6, rel=1e-3)
    assert point["interval"] == pytest.approx([2.3875e6, 2.5414e6], rel=1e-3)
    (campaign,) = before["campaigns"]
    assert (campaign["name"], campaign["at"], campaign["time_source"]) == (
        "campaign 0",
        DAYS[0],
        "measured_at",
    )
    assert campaign["verdict"] == "use_with_care"
    assessment = campaign["assessment"]
    assert (assessment["verdict"], assessment["joints_identified"]) == ("use_with_care", 4)
    assert [(reason["code"], reason["where"]) for reason in assessment["reasons"]] == [
        ("joint_poorly_known", "joint_4"),
        ("joint_poorly_known", "joint_6"),
    ]
    assert assessment["notes"] == [
        "Forces up to 1500 N (153 kgf), deflections up to 5.14 mm. If N and kgf were confused, every "
        "stiffness would be wrong by a factor of 9.81, and no reading would show it.",
        "The load point is assumed to be known to ±10 mm. State how you know it: by tracker ±1 mm, from a "
        "drawing ±3 mm, by hand ±10 mm (`noise.grounds.load_point`; on the page: Advanced, How the load "
        "point is known).",
        "The forces are assumed to be known to ±1 %. Enter the uncertainty of the load cell or of the weight "
        "(`noise.force.scale`; on the page: Advanced, Scale of the force).",
        "Each posture was read only once without load, so a deflection that remains after unloading is not "
        "detected. Read each posture again after unloading (`unloaded_after`).",
    ]


def test_a_trend_says_which_runs_it_compares(client, worn):
    found = trend(client, worn[0])
    assert found["selection"] == {
        "serial_number": "A",
        "method": "partial_pose",
        "weighting": "covariance",
        "positive": True,
        "encoders": "motor",
        "complementary_stiffness": "included",
    }
    assert (found["serial_numbers"], found["level"], found["left_out"], found["note"]) == (
        ["A"],
        0.05,
        [],
        None,
    )
    assert [each["name"] for each in found["campaigns"]] == ["campaign 0", "campaign 1"]


WORN = [
    (5.9034e-4, 0.0095228, 0.95055, False),
    (-0.015298, 0.010967, 0.16631, False),
    (-0.076282, 0.016268, 6.6249e-6, True),
]
LONG = [
    (0.012121, 0.011539, 0.29060, False),
    (0.0089780, 0.0098325, 0.35905, False),
    (-0.10245, 0.014862, 6.6940e-11, True),
]


@pytest.mark.parametrize(("name", "wanted"), [("worn", WORN), ("long", LONG)])
def test_a_change_of_a_tenth_is_found_with_its_uncertainty_and_chance(name, wanted, client, request):
    robot = request.getfixturevalue(name)[0]
    found = trend(client, robot, serial_number="A", encoders="motor", same_cell=True)
    for joint, (value, uncertainty, chance, changed) in zip(found["joints"], wanted, strict=False):
        assert joint["change"]["value"] == pytest.approx(value, rel=2e-3)
        assert joint["change"]["standard_uncertainty"] == pytest.approx(uncertainty, rel=2e-3)
        assert joint["p_value"] == pytest.approx(chance, rel=0.02)
        assert joint["changed"] == changed
    assert [joint["changed"] for joint in found["joints"][3:]] == [False] * 3


@pytest.mark.parametrize("name", ["worn", "long"])
def test_cells_that_are_not_said_to_be_the_same_have_assumed_scales_of_their_own(name, client, request):
    """By arithmetic: two scales, each known to 1 %, add their squares to that of one cell."""
    robot = request.getfixturevalue(name)[0]
    query = {"serial_number": "A", "encoders": "motor"}
    of_two_cells, of_one_cell = (
        trend(client, robot, **query | more)["joints"] for more in ({}, {"same_cell": True})
    )
    for own, same in zip(of_two_cells, of_one_cell, strict=True):
        assert own["change"]["value"] == pytest.approx(same["change"]["value"], rel=1e-9)
        ratio = 1.0 + same["change"]["value"]
        expected = np.hypot(same["change"]["standard_uncertainty"], ratio * 0.01 * np.sqrt(2.0))
        assert own["change"]["standard_uncertainty"] == pytest.approx(expected, rel=1e-3)
        assert own["p_value"] >= same["p_value"]


def test_a_robot_shows_its_last_campaign_and_the_changes_of_each_arm(client, worn, long):
    robot, runs = long
    rows = {each["id"]: each["last_campaign"] for each in client.get("/v1/robots").json()["items"]}
    row, other = rows[robot], rows[worn[0]]
    assert client.get(f"/v1/robots/{robot}").json()["last_campaign"] == row
    assert (row["run_id"], row["at"], row["serial_number"], row["verdict"]) == (
        runs[-1]["id"],
        DAYS[7],
        "B",
        "use_with_care",
    )
    ((change,), (less,)) = row["changed"], other["changed"]
    assert (change["joint"], change["serial_number"]) == (less["joint"], less["serial_number"])
    assert (change["joint"], change["serial_number"]) == ("joint_3", "A")
    assert change["change"]["value"] == pytest.approx(-0.10245, rel=2e-3)
    assert less["change"]["value"] == pytest.approx(-0.076282, rel=2e-3)
    assert (other["at"], other["serial_number"]) == (DAYS[1], "A")


@pytest.mark.parametrize("query", [{"serial_number": "nobody"}, {"method": "complete_pose"}])
def test_a_trend_of_no_run_names_each_set_and_why_it_is_left_out(query, client, long):
    found = trend(client, long[0], **query)
    assert (found["selection"], found["campaigns"], found["serial_numbers"]) == (None, [], ["A", "B"])
    assert found["note"] == "no campaign: identify measurement sets of this robot by the same method"
    assert [(each["name"], each["reason"]) for each in found["left_out"]] == [
        (f"campaign {number}", "no run of this set matches the query") for number in (7, 5, 4, 3, 2, 1, 0)
    ]
    assert all(joint["points"] == [] and not joint["changed"] for joint in found["joints"])


def test_what_has_no_time_of_its_measurement_has_that_of_its_post(client):
    robot = robot_of(client, "undated")
    measured(client, robot, 8, 51, serial_number="Z", measured_at=None)
    (campaign,) = trend(client, robot, serial_number="Z")["campaigns"]
    assert (campaign["name"], campaign["time_source"]) == ("campaign 8", "created_at")
    assert abs(datetime.now(UTC) - datetime.fromisoformat(campaign["at"])) < timedelta(minutes=5)


def test_a_trend_is_shown_as_a_table_a_picture_and_a_file(client, long, tmp_path):
    query = {"serial_number": "A", "encoders": "motor", "same_cell": True}
    shown = RobotTrend.model_validate(trend(client, long[0], **query))
    headline = "6 campaigns: 1 of 6 joints changed since the first"
    assert shown.summary().splitlines()[0] == headline
    assert repr(shown) == f"<RobotTrend: {headline}>"
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in str(shown).splitlines()]
    assert [row for row in rows if row] == [
        ["joint_1", "", "1.2 % (-1.0 … 3.5 %)", "0.29"],
        ["joint_2", "", "0.90 % (-1.03 … 2.82 %)", "0.36"],
        ["joint_3", "changed", "-10.2 % (-13.2 … -7.3 %)", "6.7 · 10⁻¹¹"],
        ["joint_4", "", "3 % (-19 … 25 %)", "0.78"],
        ["joint_5", "", "-2.2 % (-9.5 … 5.2 %)", "0.57"],
        ["joint_6", "", "-11 % (-35 … 13 %)", "0.4"],
    ]
    assert [len(axes.lines) for axes in shown.plot().axes] == [3] * 6
    shown.save(tmp_path / "trend.csv")
    head, *lines = csv.reader((tmp_path / "trend.csv").read_text(encoding="utf-8").splitlines())
    assert head == [
        "joint",
        "campaign",
        "at",
        "stiffness [N.m/rad]",
        "lower [N.m/rad]",
        "upper [N.m/rad]",
    ]
    assert [line[:2] for line in lines] == [
        [f"joint_{joint}", f"campaign {number}"] for joint in range(1, 7) for number in range(6)
    ]
    assert lines[15][2] == "2021-04-10T08:00:00+00:00"
    assert [float(each) for each in lines[14][3:]] == pytest.approx(
        [2.48794e6, 2.40572e6, 2.57598e6], rel=1e-3
    )
    assert [float(each) for each in lines[15][3:]] == pytest.approx(
        [2.25729e6, 2.19470e6, 2.32355e6], rel=1e-3
    )


@pytest.mark.parametrize(
    ("query", "numbers"),
    [
        ({"serial_number": "B"}, [7]),
        ({"instrument": "T2"}, [5, 4]),
        ({"measured_from": DAYS[4]}, [7, 5, 4]),
        ({"measured_to": DAYS[1]}, [0]),
        ({"measured_from": DAYS[1], "measured_to": DAYS[3]}, [2, 1]),
        ({"name": "campaign 2"}, [2]),
        ({"encoders": "secondary"}, []),
        ({"limit": 1}, [7]),
    ],
)
def test_sets_are_listed_by_what_they_state_the_newest_first(query, numbers, client, long):
    """From a time on, and before another."""
    found = client.get("/v1/measurement-sets", params=query | {"robot_id": long[0]}).json()["items"]
    assert [each["name"] for each in found] == [f"campaign {number}" for number in numbers]
    assert [each["measured_at"] for each in found] == [DAYS[number] for number in numbers]


@pytest.mark.parametrize(
    ("query", "numbers", "whole"),
    [
        ({}, [7, 5, 4, 3, 2, 1, 0], 7),
        ({"limit": 2}, [7, 5], 7),
        ({"method": "partial_pose", "limit": 1}, [7], 7),
        ({"method": "complete_pose"}, [], 0),
        ({"weighting": "uniform"}, [], 0),
        ({"elasticity": "joints"}, [7, 5, 4, 3, 2, 1, 0], 7),
        ({"elasticity": "automatic"}, [], 0),
        ({"verdict": "use", "limit": 1}, [5], 4),
        ({"verdict": "use_with_care"}, [7, 2, 1], 3),
        ({"verdict": "do_not_use"}, [], 0),
        ({"state": "failed"}, [], 0),
    ],
)
def test_runs_are_listed_by_their_options_and_verdicts(query, numbers, whole, client, long):
    found = client.get("/v1/jobs", params=query | {"kind": "run", "robot_id": long[0]}).json()
    assert [each["measurement_set_name"] for each in found["items"]] == [f"campaign {i}" for i in numbers]
    assert found["total"] == whole
    assert (found["next"] is None) == (len(numbers) == whole)


def test_a_row_of_a_run_has_its_verdict_and_how_well_it_explains(client, long):
    robot, runs = long
    row = client.get("/v1/jobs", params={"robot_id": robot, "limit": 1}).json()["items"][0]
    assert row.pop("compensation") == pytest.approx(0.98099, abs=1e-4)
    made = datetime.fromisoformat(row.pop("created_at"))
    assert abs(datetime.now(UTC) - made) < timedelta(minutes=5)
    assert row == {
        "verdict": "use_with_care",
        "joints_identified": 5,
        "joint_count": 6,
        "warning_count": 0,
        "id": runs[-1]["id"],
        "kind": "run",
        "state": "succeeded",
        "name": None,
        "robot_id": robot,
        "measurement_set_id": runs[-1]["request"]["measurement_set_id"],
        "second_set_id": None,
        "robot_name": "long",
        "measurement_set_name": "campaign 7",
        "serial_number": "B",
        "run_id": None,
        "method": "partial_pose",
        "weighting": "covariance",
        "positive": True,
        "elasticity": "joints",
        "leave_out": [],
        "variant_of": None,
        "outputs": [],
    }


def test_a_run_that_is_deleted_can_be_brought_back(client):
    robot = robot_of(client, "deleted")
    job = job_at(measured(client, robot, 0, 61))
    identifier = job.rpartition("/")[2]
    of_robot = {"robot_id": robot}
    assert client.request("PATCH", job, json={"cancelled": True}).json()["state"] == "succeeded"
    assert client.request("PATCH", job, json={"deleted": True}).status_code == 200
    gone = client.get(job)
    assert (gone.status_code, gone.json()["type"]) == (404, "urn:jointstiff:problem:deleted")
    assert gone.json()["detail"] == f"the job '{identifier}' was deleted"
    assert gone.json()["remedy"] == f'restore it with PATCH /v1/jobs/{identifier} {{"deleted": false}}'
    assert client.get("/v1/jobs", params=of_robot).json()["items"] == []
    (found,) = client.get("/v1/jobs", params=of_robot | {"deleted": "true"}).json()["items"]
    assert found["id"] == identifier
    assert client.request("PATCH", job, json={"deleted": False}).status_code == 200
    assert client.get(job).json()["state"] == "succeeded"
    told = client.get(f"{job}/events").text.split()
    assert told == ["event:", "end", "data:", f'{{"id":"{identifier}","state":"succeeded","progress":null}}']
