"""Trends: exact springs of which one softens, alarms and baselines over HTTP; what campaigns share."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from support.api import RESTORE, job_at, post

from jointstiff.schemas.job import Requester
from jointstiff.schemas.run import JointResult
from jointstiff.schemas.trend import AcknowledgementRequest, BaselineRequest, TrendSelection
from jointstiff.service.kinds.trend import Campaign, ReadRun, Trends, acknowledgements_of, note_of
from jointstiff.service.kinds.trend import trend_of as charts_of
from jointstiff.service.store.tables import MeasurementSetEntry
from jointstiff.simulator import default_arm, simulate_campaign

DAYS = [f"2026-{month:02d}-10T08:00:00Z" for month in range(1, 9)]
SOFT = 3
"""Campaign with which joint 3 has lost a tenth of its stiffness."""


def campaign_of(seed, *, soft=False):
    arm = default_arm()
    stiffnesses = arm.stiffnesses.copy()
    if soft:
        stiffnesses[2] *= 0.9
    return simulate_campaign(replace(arm, stiffnesses=stiffnesses), load="pull", configurations=10, seed=seed)


def measured(local, robot, seed, *, soft=False, options=None, **metadata):
    """Post a set and its run; return the run."""
    document = campaign_of(seed, soft=soft)["measurement_set"]
    posted = post(local, "/v1/measurement-sets", document | {"robot_id": robot} | metadata)
    return post(local, "/v1/runs", {"measurement_set_id": posted["id"]} | (options or {}))


@pytest.fixture(scope="module")
def robot(local):
    return post(local, "/v1/robots", campaign_of(0)["robot"] | {"name": "worn"})["id"]


@pytest.fixture(scope="module")
def runs(local, robot):
    """Five campaigns of one arm, posted in another order than measured; joint 3 softens."""
    found = {}
    for index in (1, 0, 2, 4, 3):
        found[index] = measured(
            local,
            robot,
            index + 1,
            soft=index >= SOFT,
            measured_at=DAYS[index],
            serial_number="A",
            name=f"campaign {index}",
        )
    return [found[index] for index in range(5)]


def trend_of(local, robot, **query):
    answer = local.get(f"/v1/robots/{robot}/trend", params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()


def joint(trend, name="joint_3"):
    return next(one for one in trend["joints"] if one["name"] == name)


def alarms_of(local, robot):
    """Return the alarms of a robot as the robot itself and the listing say them."""
    alone = local.get(f"/v1/robots/{robot}").json()["alarms"]
    (listed,) = [one for one in local.get("/v1/robots").json()["items"] if one["id"] == robot]
    assert listed["alarms"] == alone
    return alone


def test_an_alarm_follows_what_its_trend_is_made_of(local, robot, runs):
    """Nothing of it is stored: it goes and comes with a run, a set, the serial number."""
    (alarm,) = alarms_of(local, robot)
    last = [job_at(run) for run in runs[SOFT:]]
    for path in last:
        assert local.request("DELETE", path).status_code == 204
    assert alarms_of(local, robot) == []
    for path in last:
        local.request("PATCH", path, json=RESTORE)
    assert alarms_of(local, robot) == [alarm]
    sets = [f"/v1/measurement-sets/{run['request']['measurement_set_id']}" for run in runs[SOFT:]]
    for change, back in (
        ({"serial_number": "B"}, {"serial_number": "A"}),
        ({"archived": True}, {"archived": False}),
    ):
        for path in sets:
            local.request("PATCH", path, json=change)
        assert alarms_of(local, robot) == []
        for path in sets:
            local.request("PATCH", path, json=back)
        assert alarms_of(local, robot) == [alarm]


def test_below_three_campaigns_there_is_only_the_pair(local):
    robot = post(local, "/v1/robots", campaign_of(0)["robot"] | {"name": "young"})["id"]
    measured(local, robot, 1)
    measured(local, robot, 2, soft=True)
    trend = trend_of(local, robot)
    assert "no chart, only a test" in trend["note"]
    assert {one["time_source"] for one in trend["campaigns"]} == {"created_at"}
    found = joint(trend)
    assert found["charts"] == []
    assert found["pair"]["p_value"] < 1e-3
    assert found["pair"]["change"]["relative"] == pytest.approx(-0.1, abs=0.05)
    assert joint(trend, "joint_2")["pair"]["p_value"] > 1e-3


def test_a_new_baseline_begins_new_charts(local):
    robot = post(local, "/v1/robots", campaign_of(0)["robot"] | {"name": "repaired"})["id"]
    runs = [
        measured(local, robot, 40 + index, soft=index >= SOFT, measured_at=DAYS[index]) for index in range(7)
    ]
    assert joint(trend_of(local, robot))["state"] == "alarm"
    address = f"/v1/robots/{robot}/trend"
    body = {"run_id": runs[SOFT]["id"], "reason": "gearbox of joint 3 replaced"}
    made = post(local, address, body)
    assert made["campaigns"] == 3
    trend = trend_of(local, robot)
    assert [one["reason"] for one in trend["baselines"]] == [None, "gearbox of joint 3 replaced"]
    assert [one["baseline"] for one in trend["campaigns"]] == [0] * 3 + [1] * 4
    found = joint(trend)
    assert found["state"] == "in_control"
    assert found["alarms"] == []
    first, second = found["charts"]
    assert second["stiffness"] / first["stiffness"] == pytest.approx(0.9, abs=0.03)
    assert post(local, address, body | {"run_id": "none"}, status=422)["where"] == "run_id"
    assert post(local, address, body | {"campaigns": 2}, status=422)["where"] == "campaigns"


def test_who_noted_what_stays_with_it(local, memory, robot, runs):
    by = Requester(key_id="0123456789", key_name="tablet hall 3")
    trends = Trends(memory)
    request = AcknowledgementRequest(run_id=runs[SOFT]["id"], joint="joint_3", note="seen again")
    trends.acknowledge(robot, request, by)
    trends.add_baseline(robot, BaselineRequest(run_id=runs[-1]["id"], reason="repaired"), by)
    trend = trend_of(local, robot, serial_number="A", encoders="motor")
    assert trend["baselines"][-1]["set_by"] == by.model_dump()
    (alarm,) = joint(trend)["alarms"]
    assert alarm["acknowledgement"]["acknowledged_by"] == by.model_dump()
    assert alarm["acknowledgement"]["note"] == "seen again"
    assert alarm["until"] is None


def test_the_fleet_reads_a_robot_once_for_all_its_serial_numbers(local, memory, monkeypatch):
    robot = post(local, "/v1/robots", campaign_of(0)["robot"] | {"name": "many arms"})["id"]
    for seed, number in enumerate("CDE", start=70):
        measured(local, robot, seed, serial_number=number)
    reads, page = [], memory.sets.page
    monkeypatch.setattr(memory.sets, "page", lambda **asked: reads.append(asked["filters"]) or page(**asked))
    rows = [row for row in local.get("/v1/fleet").json()["items"] if row["robot_id"] == robot]
    assert sorted((row["serial_number"], row["campaigns"]) for row in rows) == [("C", 1), ("D", 1), ("E", 1)]
    assert reads.count({"robot_id": robot}) == 2  # those that are archived, too


def limit_among(measured):
    (joint,) = charts_of(["joint_1"], measured)["joints"]
    return np.log(joint.points[-1].upper_limit / joint.charts[0].stiffness)


def limit_of(instruments, **source):
    return limit_among(list(campaigns(instruments, **source)))


START = datetime(2026, 1, 1, tzinfo=UTC)
SELECTION = TrendSelection(
    serial_number="A",
    method="partial_pose",
    weighting="covariance",
    positive=True,
    encoders="motor",
    complementary_stiffness="neglected",
)


def campaigns(instruments, source="force_scale"):
    """Campaigns whose uncertainty of 3 % is 2.9 % that of one source."""
    values = 1e-6 * (1.0 + 0.005 * np.random.default_rng(4).standard_normal(len(instruments)))
    for number, (c, instrument) in enumerate(zip(values, instruments, strict=True)):
        joint = JointResult(
            name="joint_1",
            status="identified",
            verdict="use",
            reason=None,
            compliance=c,
            standard_uncertainty=0.03 * c,
            compliance_interval=(0.94 * c, 1.06 * c),
            stiffness=1.0 / c,
            stiffness_interval=(0.94 / c, 1.06 / c),
            budget={"readings": 0.0, source: 0.029 * c},
        )
        result = {"joints": [joint], "assessment": {"verdict": "use", "reasons": []}, "links": None}
        run = ReadRun.model_validate({"request": {"measurement_set_id": "s"}, "result": result})
        at = START + timedelta(days=number)
        entry = MeasurementSetEntry(
            str(number), "r", "c", "motor", 9, 0, at, "", measured_at=at, instrument=instrument
        )
        yield Campaign(str(number), at, run, entry)


def test_an_acknowledgement_is_of_one_methods_trend():
    document = {
        "measurement_set_id": "s",
        "joint": "joint_1",
        "note": "seen",
        "selection": SELECTION.model_dump(),
    }
    notes = [note_of("r", "acknowledgement", document, None, START)]
    assert json.loads(notes[0].document) == document
    assert acknowledgements_of(notes, SELECTION)["s", "joint_1"].note == "seen"
    for change in ({"method": "complete_pose"}, {"positive": False}, {"encoders": "secondary"}):
        assert acknowledgements_of(notes, SELECTION.model_copy(update=change)) == {}


def test_an_assumed_load_point_is_that_of_one_hook():
    """Nothing was stated, so no campaign says that it is elsewhere than in the others."""
    assumed = limit_of(["cell 7"] * 4 + ["cell 8"], source="assumed_load_point")
    assert assumed == pytest.approx(limit_of(["cell 7"] * 5))
    *others, last = campaigns(["cell 7"] * 5, source="assumed_load_point")
    *_, stated = campaigns(["cell 7"] * 5, source="load_point")
    assert last.joints["joint_1"].compliance == stated.joints["joint_1"].compliance
    assert limit_among([*others, stated]) > 2.0 * assumed  # it has a hook of its own
