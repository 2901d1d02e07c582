"""A target at the hook that was read without load is the load point; a stated point is tested by it."""

import copy

import numpy as np
import pytest
from support.campaigns import ARM
from support.documents import changed
from support.refusals import refused

import jointstiff as js
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.prepared import prepare_robot, prepare_set
from jointstiff.service.runs.mending import apply_action_to_campaign
from jointstiff.simulator import simulate_campaign
from jointstiff.solver.mechanics.postures import Postures

SET = "measurement_set"
REMEDY = "read target 'hook' on the hook once without load (`unloaded`), in any observation"


@pytest.fixture(scope="module")
def stated():
    """Pulls in 14 postures, with the load point as stated coordinates."""
    return simulate_campaign(ARM, load="pull", configurations=14, seed=5)


def place_in_base(document, point, joints):
    """Return where the robot's model has a place of the flange, in R0 [m]."""
    robot = prepare_robot(Campaign.model_validate(document).robot).robot
    postures = Postures(robot, robot.joint_map.model_angles(np.array([joints])))
    return postures.to_base(np.reshape(point, (1, 1, 3)))[0, 0]


def shot(document, rows, errors=(0.0, 0.0, 0.0), *, alone=False):
    """Return a campaign whose hook was read in some observations; `alone`: in one without a load."""
    document = copy.deepcopy(document)
    measured = document[SET]
    point = np.array(measured["load_point"])
    for row, error in zip(rows, np.broadcast_to(errors, (len(rows), 3)), strict=True):
        observation = measured["observations"][row]
        position = place_in_base(document, point + error, observation["joints"])
        reading = {"target": "hook", "unloaded": position.tolist()}
        if alone:
            unloaded = [{k: each[k] for k in ("target", "unloaded")} for each in observation["readings"]]
            added = {"label": "shot", "force": [0, 0, 0], "readings": [*unloaded, reading]}
            measured["observations"].insert(0, observation | added)
        else:
            observation["readings"].append(reading)
    measured["load_point_target"] = "hook"
    return document


def without_point(document):
    return changed(document, (f"{SET}.load_point", None))


def measurements(document):
    campaign = Campaign.model_validate(document)
    return prepare_set(campaign.measurement_set, prepare_robot(campaign.robot), "robot").measurements


@pytest.mark.parametrize("alone", [False, True])
def test_one_reading_of_the_hook_is_the_load_point_and_no_target(stated, alone):
    as_stated, as_read = (
        measurements(each) for each in (stated, without_point(shot(stated, [3], alone=alone)))
    )
    assert as_read.load_point == pytest.approx(as_stated.load_point, abs=1e-4)
    assert as_read.targets == as_stated.targets
    assert as_read.labels == as_stated.labels
    assert as_read.common_uncertainty.load_point == 1e-3
    assert "load_point" not in as_read.common_uncertainty.assumed


def test_a_run_with_the_reading_of_the_hook_is_used_as_one_with_a_trackers_point(stated):
    by_tracker = changed(stated, (f"{SET}.noise.grounds", {"load_point": "tracker"}))
    first, second = (js.identify(each).result for each in (by_tracker, without_point(shot(stated, [0]))))
    assert second.assessment.verdict == first.assessment.verdict
    pairs = zip(first.joints, second.joints, strict=True)
    assert all(one.compliance == pytest.approx(other.compliance, rel=5e-3) for one, other in pairs)


def test_the_hook_is_placed_by_the_targets_of_its_posture_and_not_by_kinematics_alone(stated):
    """In the posture of the shot the robot stands 2 mm and 2 mrad off its model, with all its targets."""
    document = shot(stated, [3])
    turn = np.array([[1.0, -2e-3, 0.0], [2e-3, 1.0, 0.0], [0.0, 0.0, 1.0]])
    for reading in document[SET]["observations"][3]["readings"]:
        for state in {"unloaded", "loaded"} & reading.keys():
            reading[state] = (turn @ reading[state] + [2e-3, 0.0, 1e-3]).tolist()
    found = measurements(without_point(document)).load_point[0]
    assert np.linalg.norm(found - stated[SET]["load_point"]) < 5e-4


def test_a_stated_load_point_that_the_reading_confirms_raises_no_reason(stated):
    document = changed(shot(stated, [3], [4e-4, 0.0, 0.0]), (f"{SET}.noise.load_point", 1e-3))
    assert "load_point_refuted" not in {each.code for each in js.identify(document).result.assessment.reasons}


def test_a_stated_load_point_that_the_reading_refutes_is_not_used_and_the_action_keeps_the_reading(stated):
    document = changed(shot(stated, [3], [0.0, 12e-3, 0.0]), (f"{SET}.noise.load_point", 1e-3))
    assessment = js.identify(document).result.assessment
    (reason,) = [each for each in assessment.reasons if each.code == "load_point_refuted"]
    assert (assessment.verdict, reason.weight) == ("do_not_use", "do_not_use")
    x, y, z = (1e3 * value for value in stated[SET]["load_point"])
    assert f"({x:.1f}, {y:.1f}, {z:.1f}) mm is 12 mm away from ({x:.1f}, {y + 12:.1f}," in reason.message
    assert "their uncertainties allow 7.83 mm" in reason.message
    mended = apply_action_to_campaign(Campaign.model_validate(document), reason.action)
    assert mended.measurement_set.load_point is None
    codes = {each.code for each in js.identify(mended).result.assessment.reasons}
    assert "load_point_refuted" not in codes


def test_a_load_point_that_is_known_by_hand_is_not_refuted_by_12_mm(stated):
    document = shot(stated, [3], [0.0, 12e-3, 0.0])
    assert "load_point_refuted" not in {each.code for each in js.identify(document).result.assessment.reasons}


def test_a_set_whose_hook_was_not_read_is_refused(stated):
    document = changed(without_point(stated), (f"{SET}.load_point_target", "hook"))
    said = refused(measurements, document)
    reason = "no observation has a reading of target 'hook', so the load point is unknown"
    assert said.startswith(f"load_point_target | {reason} | {REMEDY}")


def test_a_hook_that_was_read_only_under_load_is_refused(stated):
    document = changed(without_point(stated), (f"{SET}.load_point_target", "hook"))
    reading = {"target": "hook", "deflection": [0.0, 0.0, -1e-3]}
    document[SET]["observations"][2]["readings"].append(reading)
    said = refused(measurements, document)
    assert said.startswith("load_point_target | target 'hook' was read only as a deflection")
    assert REMEDY in said


def test_readings_of_the_hook_that_disagree_are_refused_with_their_distance(stated):
    errors = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 8e-3]]
    document = without_point(shot(stated, [1, 4, 7], errors))
    said = refused(measurements, document)
    assert said.startswith("observations[7].readings | ")
    assert "the 3 readings of target 'hook' show different load points" in said
    assert "mm from the load point by another observation (3 mm is plausible)" in said


def test_different_load_points_of_observations_contradict_one_reading(stated):
    document = shot(stated, [1])
    document[SET]["observations"][5]["load_point"] = [0.0, 0.0, 0.3]
    said = refused(measurements, document)
    assert said.startswith("load_point_target | the observations state different load points")


def test_two_readings_of_the_hook_that_differ_are_as_uncertain_as_half_their_distance(stated):
    """Two readings 2.6 mm apart; 5.8 mm apart they are refused, although each is 2.9 mm from their mean."""
    near = without_point(shot(stated, [1, 4], [[0.0, 0.0, 1.3e-3], [0.0, 0.0, -1.3e-3]]))
    assert measurements(near).hook.uncertainty == pytest.approx(1.3e-3, rel=0.1)
    far = without_point(shot(stated, [1, 4], [[0.0, 0.0, 2.9e-3], [0.0, 0.0, -2.9e-3]]))
    assert "the 2 readings of target 'hook' show different load points" in refused(measurements, far)


def test_a_wrong_target_beside_the_hook_is_refused_as_the_load_point_rests_on_it(stated):
    document = without_point(shot(stated, [3], alone=True))
    document[SET]["observations"][0]["readings"][0]["unloaded"][0] += 0.1
    said = refused(measurements, document)
    assert said.startswith(
        "observations[0].readings | observation 'shot' reads target 'hook' on the hook, but "
    )
    assert "(3 mm is plausible), so the load point is wrong | correct or omit the wrong reading" in said


def test_a_shot_with_all_targets_moved_alike_is_refused(stated):
    """As with the joint angles of another posture, or the only target of a posture that was read wrong."""
    document = without_point(shot(stated, [3], alone=True))
    for reading in document[SET]["observations"][0]["readings"]:
        reading["unloaded"][0] += 0.1
    assert "100 mm from its place on the flange" in refused(measurements, document)


def test_a_hook_without_another_target_in_its_posture_is_known_as_a_drawing_knows_it(stated):
    """Nothing corrects the kinematics there, which are wrong by up to millimetres."""
    document = without_point(shot(stated, [3], alone=True))
    shot_alone = document[SET]["observations"][0]
    shot_alone["readings"] = [each for each in shot_alone["readings"] if each["target"] == "hook"]
    assert measurements(document).hook.uncertainty == 3e-3


def test_a_set_without_another_target_than_the_hook_is_refused(stated):
    document = without_point(copy.deepcopy(stated))
    for observation in document[SET]["observations"]:
        del observation["readings"][1:]
    document[SET]["load_point_target"] = document[SET]["observations"][0]["readings"][0]["target"]
    reason = "gives only the load point, but no other target has a reading"
    assert reason in refused(measurements, document)


def test_a_fault_behind_the_shot_is_named_in_the_observation_that_was_posted(stated):
    """The shot is the first observation, and no observation of the measurements."""
    document = without_point(shot(stated, [3], alone=True))
    document[SET]["observations"][6]["readings"][1] = {"target": "PX", "deflection": [0.0, 0.0, 1e-3]}
    assert refused(measurements, document).startswith("observations[6].")


def test_encoders_read_under_load_stay_where_only_the_hook_was_read_as_a_target(stated):
    document = without_point(shot(stated, [3], alone=True))
    document[SET]["noise"]["encoder_sigma"] = 1e-6
    encoders = [{"joint": "joint_2", "unloaded": 0.0, "loaded": 1e-4}]
    for observation in document[SET]["observations"]:
        observation["encoder_readings"] = encoders
    alone = document[SET]["observations"][0]
    alone["force"] = document[SET]["observations"][1]["force"]
    alone["readings"] = [each for each in alone["readings"] if each["target"] == "hook"]
    assert measurements(document).encoders.present.any(axis=1).sum() == 15
