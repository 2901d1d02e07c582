"""Trends: what campaigns share, and which joint changed."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from scipy import stats
from support.in_process import Client

import jointstiff as js
from jointstiff.schemas.robot import MAX_MARKS
from jointstiff.schemas.run import JointResult
from jointstiff.service.library.results import RobotTrend
from jointstiff.service.runs.trend import (
    Campaign,
    ReadRun,
    _find_fewest_degrees_of_freedom,
    compare_campaigns,
)
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import MeasurementSetEntry
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.document import robot_document
from jointstiff.solver.comparison.campaigns import SharedErrors

START = datetime(2026, 1, 1, tzinfo=UTC)


def budget(contributions, freedom):
    """Budget of joint_1 by source, the first of these degrees of freedom; and one that is not included."""
    combined = float(np.linalg.norm([*contributions.values()]))
    freedoms = [freedom, *[None] * (len(contributions) - 1), 2]
    return {
        "joints": ["joint_1"],
        "components": [
            {
                "source": source,
                "evaluation": "B",
                "included": source != "left out",
                "degrees_of_freedom": freedoms[place],
                "contributions": [size],
                "correlation": [[1.0]],
            }
            for place, (source, size) in enumerate((contributions | {"left out": combined}).items())
        ],
        "standard_uncertainty": [combined],
        "correlation": [[1.0]],
        "probability": 0.95,
        "coverage_factor": 2.0,
        "expanded_uncertainty": [2.0 * combined],
        "expanded_with_model_error": [2.0 * combined],
        "missing": [],
    }


def campaigns(count, source="force_scale", freedom=None):
    """Campaigns whose uncertainty of 3 % is 2.9 % that of one source; all name one instrument."""
    values = 1e-6 * (1.0 + 0.005 * np.random.default_rng(4).standard_normal(count))
    for number, c in enumerate(values):
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
        )
        result = {
            "joints": [joint],
            "assessment": {"verdict": "use", "reasons": []},
            "links": None,
            "budget": budget({"readings": 0.0, source: 0.029 * c}, freedom and freedom[number]),
        }
        run = ReadRun.model_validate({"request": {"measurement_set_id": "s"}, "result": result})
        at = START + timedelta(days=number)
        entry = MeasurementSetEntry(
            str(number), "r", "c", "motor", 9, 0, at, "", measured_at=at, instrument="tracker 7"
        )
        yield Campaign(str(number), at, run, entry)


@pytest.mark.parametrize(
    ("freedom", "fewer"), [((12, 30), 12), ((30, 12), 12), ((None, 7), 7), (None, np.inf)]
)
def test_a_change_is_judged_with_the_fewer_degrees_of_freedom(freedom, fewer):
    (joint,) = compare_campaigns(["joint_1"], list(campaigns(2, freedom=freedom)))["joints"]
    first, last = (one.joints["joint_1"].compliance for one in campaigns(2))
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
        (one,) = campaigns(1)
        found = _find_fewest_degrees_of_freedom(replace(one, run=ReadRun.model_validate(parts)))
        assert found == (run.result.goodness.degrees_of_freedom if noise is None else np.inf)


@pytest.fixture
def client():
    with Store.open("sqlite://") as store:
        yield Client(store)


def robot_of(client):
    return client.request("POST", "/v1/robots", json=robot_document(default_arm())).json()["id"]


def identify(client, set_id, **options):
    run = client.request("POST", "/v1/runs", json={"measurement_set_id": set_id} | options).json()
    assert run["state"] == "succeeded", run
    return run["id"]


def measure(client, robot, month, softness=1.0, serial_number="W-1", sign=1.0, **fields):
    """A measurement set of the arm, joint_3 softer by a factor, forces stated with a sign; its id."""
    arm = default_arm()
    worn = replace(arm, stiffnesses=arm.stiffnesses * np.array([1.0, 1.0, softness, 1.0, 1.0, 1.0]))
    readings = simulate_campaign(worn, load="pull", configurations=16, seed=month)["measurement_set"]
    for observation in readings["observations"]:
        observation["force"] = [sign * part for part in observation["force"]]
    stated = {"measured_at": f"2026-{month:02d}-10T08:00:00Z", "serial_number": serial_number}
    document = readings | stated | {"robot_id": robot} | fields
    return client.request("POST", "/v1/measurement-sets", json=document).json()["id"]


def trend(client, robot, **query):
    return client.get(f"/v1/robots/{robot}/trend", params=query).json()


def changed_in(trend):
    return [joint["name"] for joint in trend["joints"] if joint["changed"]]


def row_of(client, robot):
    """The robot's last campaign, as listed and as the robot itself says it."""
    (listed,) = client.get("/v1/robots").json()["items"]
    assert client.get(f"/v1/robots/{robot}").json()["last_campaign"] == listed["last_campaign"]
    return listed["last_campaign"]


def changed_of(row):
    return [(one["joint"], one["serial_number"]) for one in row["changed"]]


def test_a_joint_that_softens_is_said_to_have_changed_and_the_others_are_not(client):
    """By 15 %, of readings that know each joint to 1 %: in the trend, and in the robot's row."""
    robot = robot_of(client)
    assert row_of(client, robot) is None
    for month, softness in enumerate([1.0, 1.0, 0.85], start=1):
        run = identify(client, measure(client, robot, month, softness))
    found, row = trend(client, robot), row_of(client, robot)
    assert changed_in(found) == ["joint_3"]
    change = found["joints"][2]["change"]
    assert abs(change["value"] + 0.15) < 3.0 * change["standard_uncertainty"] < 0.12
    assert [len(joint["points"]) for joint in found["joints"]] == [3] * 6
    assert (row["run_id"], row["serial_number"], row["verdict"]) == (run, "W-1", "use")
    assert row["changed"] == [{"joint": "joint_3", "serial_number": "W-1", "change": change}]


@pytest.mark.parametrize("options", [{"positive": False}, {"method": "complete_pose"}])
@pytest.mark.parametrize("explored", ["set of the change", "set of its own"])
def test_a_run_with_other_options_hides_no_change(client, options, explored):
    """Neither in the robot's row nor in its trend: one run of one set has nothing to be compared with."""
    robot = robot_of(client)
    for month, softness in enumerate([1.0, 0.8], start=1):
        worn = measure(client, robot, month, softness)
        identify(client, worn)
    change = trend(client, robot)["joints"][2]["change"]
    last = identify(
        client, worn if explored == "set of the change" else measure(client, robot, 3, 0.8), **options
    )
    row = row_of(client, robot)
    assert row["run_id"] == last
    assert row["changed"] == [{"joint": "joint_3", "serial_number": "W-1", "change": change}]
    assert changed_in(trend(client, robot)) == ["joint_3"]


def test_a_change_that_only_runs_with_other_options_show_is_in_the_row(client):
    """Campaigns after the first ones have another method; the trend of most campaigns ends before them."""
    robot = robot_of(client)
    for month in (1, 2, 3):
        identify(client, measure(client, robot, month))
    for month, softness in [(4, 1.0), (5, 0.8)]:
        identify(client, measure(client, robot, month, softness), method="complete_pose")
    assert changed_in(trend(client, robot)) == []
    assert changed_in(trend(client, robot, method="complete_pose")) == ["joint_3"]
    assert changed_of(row_of(client, robot)) == [("joint_3", "W-1")]


def test_the_last_campaign_is_that_of_the_newest_run_whatever_its_verdict(client):
    """Runs that are not to be used enter no trend; the robot was measured all the same."""
    robot = robot_of(client)
    wrong = identify(client, measure(client, robot, 1, sign=-1.0))
    row = row_of(client, robot)
    assert (row["run_id"], row["verdict"], row["changed"]) == (wrong, "do_not_use", [])
    assert row["at"] == "2026-01-10T08:00:00Z"
    for month, softness in enumerate([1.0, 0.8], start=2):
        identify(client, measure(client, robot, month, softness))
    wrong = identify(client, measure(client, robot, 4, sign=-1.0))
    row = row_of(client, robot)
    assert (row["run_id"], row["verdict"]) == (wrong, "do_not_use")
    assert changed_of(row) == [("joint_3", "W-1")]


def test_changes_of_each_serial_number_are_in_the_row(client):
    """The arm that was measured last is another than the one that is worn."""
    robot = robot_of(client)
    for month, softness in enumerate([1.0, 0.8], start=1):
        identify(client, measure(client, robot, month, softness, serial_number="A"))
    last = identify(client, measure(client, robot, 3, serial_number="B"))
    assert changed_in(trend(client, robot)) == []
    assert changed_in(trend(client, robot, serial_number="A")) == ["joint_3"]
    row = row_of(client, robot)
    assert (row["run_id"], row["serial_number"]) == (last, "B")
    assert changed_of(row) == [("joint_3", "A")]


def test_one_campaign_is_compared_with_nothing():
    trend = compare_campaigns(["joint_1"], list(campaigns(1)))
    assert trend["joints"][0].change is None
    assert not trend["joints"][0].changed
    assert "only one campaign: a second one is needed" in trend["note"]


@pytest.mark.parametrize("source", ["force_scale", "assumed_force_scale", "load_point", "assumed_load_point"])
def test_each_campaign_has_errors_of_its_own_unless_they_are_said_to_be_the_same(source):
    """By arithmetic: u(c)/c is 3 %, of which 2.9 % is one source; the set's instrument says nothing of it."""
    (joint,) = compare_campaigns(["joint_1"], list(campaigns(5, source=source)))["joints"]
    relative = joint.change.standard_uncertainty / (1.0 + joint.change.value)
    assert relative == pytest.approx(0.03 * np.sqrt(2.0))


@pytest.mark.parametrize("source", ["force_scale", "assumed_force_scale"])
def test_the_scale_of_one_cell_cancels(source):
    """By arithmetic: u(c)/c is 3 %, of which 2.9 % is the scale, stated or assumed."""
    measured = list(campaigns(5, source=source))
    (joint,) = compare_campaigns(["joint_1"], measured, shared=SharedErrors(cell=True))["joints"]
    relative = joint.change.standard_uncertainty / (1.0 + joint.change.value)
    assert relative == pytest.approx(np.sqrt(2.0 * (0.03**2 - 0.029**2)))


def shown_trend(measured):
    fields = compare_campaigns(["joint_1"], measured)
    return RobotTrend(robot_id="r", selection=None, serial_numbers=[], left_out=[], **fields)


def vague(campaign):
    """The campaign with a joint that is too uncertain to be compared."""
    (joint,) = campaign.run.result.joints
    wide = joint.model_copy(update={"standard_uncertainty": 0.5 * joint.compliance})
    result = campaign.run.result.model_copy(update={"joints": [wide]})
    return replace(campaign, run=campaign.run.model_copy(update={"result": result}))


def test_a_trend_of_many_campaigns_shows_some_and_those_that_it_compares():
    """The test is that of all; the first and latest compared campaign of each joint are among those shown."""
    measured = list(campaigns(500))
    measured[0], measured[-1] = vague(measured[0]), vague(measured[-1])
    whole, some = (compare_campaigns(["joint_1"], measured, most=most) for most in (500, 20))
    assert (len(whole["campaigns"]), len(some["campaigns"])) == (500, 22)
    assert some["campaign_count"] == 500
    assert {each.assessment for each in some["campaigns"]} == {None}
    assert some["joints"][0].change == whole["joints"][0].change
    places = [whole["campaigns"].index(each) for each in some["campaigns"]]
    assert places[:2] == [0, 1]
    assert places[-2:] == [498, 499]
    assert max(np.diff(places)) < 30
    assert [whole["joints"][0].points[place] for place in places] == some["joints"][0].points


def sharing(campaign, responses):
    """The campaign whose run states changes of joint_1 by the load point, relative to its compliance."""
    budget = campaign.run.result.budget
    c = campaign.joints["joint_1"].compliance
    stated = [tuple(size * c for size in responses)]
    components = [
        part.model_copy(update={"responses": stated} if part.source == "load_point" else {})
        for part in budget.components
    ]
    result = campaign.run.result.model_copy(
        update={"budget": budget.model_copy(update={"components": components})}
    )
    return replace(campaign, run=campaign.run.model_copy(update={"result": result}))


def test_of_one_load_point_only_the_difference_of_its_effects_counts():
    """By arithmetic: u(c)/c is 3 %, of which 2.9 % is the load point, in two directions."""
    first, last = campaigns(2, source="load_point")
    first, last = sharing(first, (0.029, 0.0, 0.0)), sharing(last, (0.02, 0.021, 0.0))
    (joint,) = compare_campaigns(["joint_1"], [first, last], shared=SharedErrors(load=True))["joints"]
    expected = np.sqrt(2 * (0.03**2 - 0.029**2) + 0.009**2 + 0.021**2)
    assert joint.change.standard_uncertainty / (1 + joint.change.value) == pytest.approx(expected)


def test_a_run_that_states_no_effect_of_its_load_point_keeps_its_own_error_and_is_named():
    measured = list(campaigns(2, source="load_point"))
    trend = compare_campaigns(["joint_1"], measured, shared=SharedErrors(load=True))
    assert trend["joints"] == compare_campaigns(["joint_1"], measured)["joints"]
    assert trend["note"].startswith(
        "the runs of 'c', 'c' do not state how an error of the load point changes"
    )


def read_uncertainties(client, path, **query):
    """Return the standard uncertainty of the change of each joint in a trend."""
    joints = client.get(path, params=query).json()["joints"]
    return np.array([joint["change"]["standard_uncertainty"] for joint in joints])


def test_a_trend_of_one_load_point_is_narrower_and_refuses_sets_of_other_points(client):
    robot = robot_of(client)
    for month in (1, 2):
        identify(client, measure(client, robot, month))
    path = f"/v1/robots/{robot}/trend"
    assert (read_uncertainties(client, path, same_load=True) < 1.001 * read_uncertainties(client, path)).all()
    assert (read_uncertainties(client, path, same_load=True) / read_uncertainties(client, path)).min() < 0.97
    identify(client, measure(client, robot, 3, load_point=[0.0, 0.0, 0.15]))
    refused = client.get(path, params={"same_load": True})
    assert refused.status_code == 422
    assert "state load points" in refused.json()["detail"]


def test_a_trend_of_one_cell_is_narrower_and_refuses_sets_of_other_uncertainties(client):
    robot = robot_of(client)
    for month in (1, 2):
        identify(client, measure(client, robot, month))
    path = f"/v1/robots/{robot}/trend"
    assert (read_uncertainties(client, path, same_cell=True) < read_uncertainties(client, path)).all()
    assert (read_uncertainties(client, path, same_cell=True) / read_uncertainties(client, path)).min() < 0.9
    stated = {"sigma": 2e-5, "force": {"scale": 0.002}}
    identify(client, measure(client, robot, 3, noise=stated))
    refused = client.get(path, params={"same_cell": True})
    assert refused.status_code == 422
    assert "for the scale of the force" in refused.json()["detail"]


def test_a_trend_names_the_campaigns_that_it_compares_if_others_are_later():
    measured = list(campaigns(4))
    assert "compared" not in shown_trend(measured).summary() + str(shown_trend(measured))
    shown = str(shown_trend([*measured[:3], vague(measured[3])]))
    assert "joint_1: compared from 'c' (2026-01-01) to 'c' (2026-01-03)" in " ".join(shown.split())


def test_campaigns_of_one_day_are_labelled_by_their_times():
    at = [START, START + timedelta(hours=1), START + timedelta(hours=1)]
    measured = [
        replace(one, measured=replace(one.measured, measured_at=time))
        for one, time in zip(campaigns(3), at, strict=True)
    ]
    assert shown_trend(measured[:2])._campaign_dates() == ["2026-01-01 00:00", "2026-01-01 01:00"]
    assert shown_trend(measured)._campaign_dates()[2] == "2026-01-01 01:00 (3)"


def arms_of(client):
    (listed,) = client.get("/v1/robots").json()["items"]
    return listed["arms"]


def test_each_arm_has_its_date_and_the_joints_that_its_trends_test(client):
    """An arm that was measured once has no tested joint: its joints are not unchanged."""
    robot = robot_of(client)
    for month, softness in enumerate([1.0, 0.8], start=1):
        identify(client, measure(client, robot, month, softness, serial_number="A"))
    identify(client, measure(client, robot, 3, serial_number="B"))
    worn, fresh = arms_of(client)
    assert (worn["serial_number"], worn["at"]) == ("A", "2026-02-10T08:00:00Z")
    assert worn["tested"] == [f"joint_{number}" for number in range(1, 7)]
    assert worn["rank"] > 1e6, "a softer joint"
    assert (fresh["serial_number"], fresh["at"]) == ("B", "2026-03-10T08:00:00Z")
    assert (fresh["tested"], fresh["rank"]) == ([], 0.0)
    assert client.get(f"/v1/robots/{robot}").json()["arms"] == [worn, fresh]


def test_robots_are_listed_worst_first_over_all_pages(client):
    """A robot that was never measured comes last."""
    never, same, worn, stiffer = (robot_of(client) for _ in range(4))
    for robot, last in [(same, 1.0), (worn, 0.8), (stiffer, 1.25)]:
        for month, softness in enumerate([1.0, last], start=1):
            identify(client, measure(client, robot, month, softness))
    assert client.get("/v1/robots").status_code == 200, "the summaries are made"
    found, cursor = [], {}
    for _ in range(4):
        page = client.get("/v1/robots", params={"sort": "worst", "limit": 1} | cursor).json()
        found += [item["id"] for item in page["items"]]
        cursor = {"cursor": page["next"]}
    assert page["next"] is None
    assert found == [worn, stiffer, same, never]


def change_robot(client, robot, **changes):
    return client.request("PATCH", f"/v1/robots/{robot}", json=changes)


def test_changes_are_counted_from_the_campaign_that_the_user_chose(client):
    """After a repair the joint is as it was: only the campaign before tells otherwise."""
    robot = robot_of(client)
    sets = [measure(client, robot, month, softness) for month, softness in [(1, 1.0), (2, 0.8), (3, 0.8)]]
    for each in sets:
        identify(client, each)
    assert changed_in(trend(client, robot)) == ["joint_3"]
    assert trend(client, robot)["reference_set_id"] is None
    changed = change_robot(client, robot, reference_set_ids=[sets[1]])
    assert changed.json()["reference_set_ids"] == [sets[1]]
    found = trend(client, robot)
    assert (changed_in(found), found["reference_set_id"]) == ([], sets[1])
    assert len(found["campaigns"]) == 3, "the campaigns before are shown"
    assert row_of(client, robot)["changed"] == []
    change_robot(client, robot, reference_set_ids=[sets[2]])
    alone = trend(client, robot)
    assert {joint["change"] for joint in alone["joints"]} == {None}
    assert "only one campaign" in alone["note"]
    assert arms_of(client)[0]["tested"] == []
    change_robot(client, robot, reference_set_ids=[])
    assert changed_in(trend(client, robot)) == ["joint_3"]


def test_a_reference_is_a_set_of_the_robot(client):
    robot, other = robot_of(client), robot_of(client)
    foreign = measure(client, other, 1)
    refused = change_robot(client, robot, reference_set_ids=[foreign])
    assert refused.status_code == 422
    assert f"the robot has no measurement set '{foreign}'" in refused.text
    assert client.get(f"/v1/robots/{robot}").json()["reference_set_ids"] == []


def test_marks_of_a_robot_are_kept_in_the_order_of_their_times(client):
    robot = robot_of(client)
    crash = {"at": "2026-03-01T10:00:00+01:00", "note": "crash into the press", "serial_number": "W-1"}
    repair = {"at": "2026-02-01T09:00:00Z", "note": "gearbox of joint 3"}
    change_robot(client, robot, add_mark=crash)
    stored = change_robot(client, robot, add_mark=repair).json()["marks"]
    assert stored == [
        repair | {"serial_number": None},
        crash | {"at": "2026-03-01T09:00:00Z"},
    ]
    assert change_robot(client, robot, name="arm 4").json()["marks"] == stored
    assert client.get(f"/v1/robots/{robot}").json()["marks"] == stored
    for at in (
        "2026-03-01",
        "1980-01-01T00:00:00+14:00",
        "2200-12-31T23:59:00-05:00",
        "0001-01-01T00:00:00+14:00",
    ):
        assert change_robot(client, robot, add_mark={"at": at, "note": "x"}).status_code == 422
    assert client.get("/v1/robots").status_code == 200
    assert change_robot(client, robot, remove_mark=crash).json()["marks"] == stored[:1]
    gone = change_robot(client, robot, remove_mark=crash)
    assert gone.status_code == 422
    assert "read the robot again" in gone.text


def test_marks_that_several_users_add_at_once_are_all_kept(client):
    robot = robot_of(client)
    marks = [{"at": f"2026-02-{day:02}T09:00:00Z", "note": f"check {day}"} for day in range(1, 17)]
    with ThreadPoolExecutor(4) as users:
        answers = list(users.map(lambda mark: change_robot(client, robot, add_mark=mark), marks))
    assert {answer.status_code for answer in answers} == {200}
    notes = [mark["note"] for mark in client.get(f"/v1/robots/{robot}").json()["marks"]]
    assert notes == [mark["note"] for mark in marks]


def test_a_robot_has_a_limited_number_of_marks(client):
    robot = robot_of(client)
    mark = {"at": "2026-02-01T09:00:00Z", "note": "check"}
    answers = [change_robot(client, robot, add_mark=mark).status_code for _ in range(MAX_MARKS + 1)]
    assert answers == [200] * MAX_MARKS + [422]


@pytest.mark.parametrize("freedom", [(6, 9), None])
def test_the_band_of_no_change_ends_where_a_change_is_reported(freedom):
    """A latest stiffness at an end of the band has the p-value of the level."""
    first, last = list(campaigns(2, freedom=freedom))
    trend = compare_campaigns(["joint_1"], [first, last])
    (joint,) = trend["joints"]
    low, high = joint.unchanged
    assert low * high == pytest.approx(1.0)
    ratio = first.joints["joint_1"].compliance / last.joints["joint_1"].compliance
    assert joint.changed == (not low < ratio < high)
    uncertainty = joint.change.standard_uncertainty / ratio
    deviation = np.log(high) / uncertainty
    beyond = stats.norm.sf(deviation) if freedom is None else stats.t.sf(deviation, 6)
    assert 2.0 * beyond == pytest.approx(trend["level"])
