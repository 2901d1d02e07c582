"""Trends: what campaigns share, and which joint changed."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from scipy import stats
from support.in_process import Client

import jointstiff as js
from jointstiff.schemas.run import JointResult
from jointstiff.service.kinds.trend import Campaign, ReadRun, _degrees_of_freedom, trend_of
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import MeasurementSetEntry
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.document import robot_document


def uncertainty_among(measured):
    (joint,) = trend_of(["joint_1"], measured)["joints"]
    return joint.change.standard_uncertainty


def uncertainty_of(instruments, **source):
    return uncertainty_among(list(campaigns(instruments, **source)))


START = datetime(2026, 1, 1, tzinfo=UTC)


def campaigns(instruments, source="force_scale", freedom=None):
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
        if freedom is not None:
            components = [
                {"included": True, "degrees_of_freedom": freedom[number]},
                {"included": True, "degrees_of_freedom": None},
                {"included": False, "degrees_of_freedom": 2},
            ]
            result["budget"] = {"components": components}
        run = ReadRun.model_validate({"request": {"measurement_set_id": "s"}, "result": result})
        at = START + timedelta(days=number)
        entry = MeasurementSetEntry(
            str(number), "r", "c", "motor", 9, 0, at, "", measured_at=at, instrument=instrument
        )
        yield Campaign(str(number), at, run, entry)


@pytest.mark.parametrize(
    ("freedom", "fewer"), [((12, 30), 12), ((30, 12), 12), ((None, 7), 7), (None, np.inf)]
)
def test_a_change_is_judged_with_the_fewer_degrees_of_freedom(freedom, fewer):
    (joint,) = trend_of(["joint_1"], list(campaigns([None, None], freedom=freedom)))["joints"]
    first, last = (one.joints["joint_1"].compliance for one in campaigns([None, None]))
    ratio = abs(np.log(first / last)) / (0.03 * np.sqrt(2.0))
    assert joint.p_value == pytest.approx(2.0 * stats.t.sf(ratio, fewer))


def test_a_run_states_the_degrees_of_freedom_that_a_trend_reads():
    """Without a stated sigma those of the residuals; else none."""
    document = simulate_campaign(default_arm(), configurations=12, load="pull")
    stated = document["measurement_set"].pop("noise")
    for noise in (None, stated):
        measured = document["measurement_set"] | ({} if noise is None else {"noise": noise})
        run = js.identify(document | {"measurement_set": measured})
        parts = {"request": run.request.model_dump(mode="json"), "result": run.result.model_dump(mode="json")}
        (one,) = campaigns(["cell 7"])
        found = _degrees_of_freedom(replace(one, run=ReadRun.model_validate(parts)))
        assert found == (run.result.goodness.degrees_of_freedom if noise is None else np.inf)


def test_a_joint_that_softens_is_said_to_have_changed_and_the_others_are_not():
    """By 15 %, of readings that know each joint to 1 %: in the trend, and in the robot's row."""
    arm = default_arm()
    with Store.open("sqlite://") as store:
        client = Client(store)
        robot = client.request("POST", "/v1/robots", json=robot_document(arm)).json()["id"]
        assert client.get(f"/v1/robots/{robot}").json()["last_campaign"] is None
        for month, softness in enumerate([1.0, 1.0, 0.85], start=1):
            worn = replace(arm, stiffnesses=arm.stiffnesses * np.array([1.0, 1.0, softness, 1.0, 1.0, 1.0]))
            readings = simulate_campaign(worn, load="pull", configurations=16, seed=month)["measurement_set"]
            stated = {
                "robot_id": robot,
                "measured_at": f"2026-{month:02d}-10T08:00:00Z",
                "serial_number": "W-1",
            }
            made = client.request("POST", "/v1/measurement-sets", json=readings | stated).json()["id"]
            run = client.request("POST", "/v1/runs", json={"measurement_set_id": made}).json()["id"]
        trend = client.get(f"/v1/robots/{robot}/trend").json()
        listed = client.get("/v1/robots").json()["items"][0]["last_campaign"]
    assert [joint["name"] for joint in trend["joints"] if joint["changed"]] == ["joint_3"]
    change = trend["joints"][2]["change"]
    assert abs(change["relative"] + 0.15) < 3.0 * change["standard_uncertainty"] < 0.12
    assert [len(joint["points"]) for joint in trend["joints"]] == [3] * 6
    assert (listed["run_id"], listed["serial_number"], listed["verdict"]) == (run, "W-1", "use")
    assert listed["changed"] == [{"joint": "joint_3", "change": change}]


def test_one_campaign_is_compared_with_nothing():
    trend = trend_of(["joint_1"], list(campaigns(["cell 7"])))
    assert trend["joints"][0].change is None
    assert not trend["joints"][0].changed
    assert "nothing to compare" in trend["note"]


@pytest.mark.parametrize("source", ["load_point", "force_scale"])
def test_what_is_assumed_is_that_of_one_hook_and_one_load_cell(source):
    """Nothing was stated, so no campaign says that it is another than in the others."""
    assumed = uncertainty_of(["cell 7"] * 4 + ["cell 8"], source=f"assumed_{source}")
    assert assumed == pytest.approx(uncertainty_of(["cell 7"] * 5))
    *others, last = campaigns(["cell 7"] * 5, source=f"assumed_{source}")
    *_, stated = campaigns(["cell 7"] * 4 + ["cell 8"], source=source)
    assert last.joints["joint_1"].compliance == stated.joints["joint_1"].compliance
    assert uncertainty_among([*others, stated]) > 2.0 * assumed  # it has one of its own
