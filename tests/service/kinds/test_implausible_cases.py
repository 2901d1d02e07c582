"""Load cases in another unit, and postures that the robot cannot take, are reasons in a prediction."""

import numpy as np
import pytest

import jointstiff as js
from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.service.runs.verdicts import find_beyond_limits, find_far_points


def test_a_posture_beyond_the_limits_is_a_reason_that_names_joint_and_posture():
    robot = next(each.robot for each in catalogue_robots() if np.isfinite(each.robot.limits).all())
    middle = np.clip(robot.limits, -np.pi, np.pi).mean(axis=1)
    turned = middle.copy()
    turned[2] = robot.limits[2, 1] + 0.1
    within, beyond = (robot.joint_map.controller_angles(each[None]) for each in (middle, turned))
    (reason,) = find_beyond_limits(robot, np.concatenate([within, beyond]), ["a", "b"])
    assert (reason.code, reason.weight) == ("joint_outside_limits", "use_with_care")
    assert f"such as {robot.joint_names[2]} in posture b" in reason.message
    assert find_beyond_limits(robot, within, ["a"]) == []


@pytest.mark.parametrize("distance", [2e-4, 1.9e-3, 4.0])
def test_a_point_in_another_unit_is_a_reason(distance):
    assert [each.code for each in find_far_points([[0.0, 0.0, distance]])] == ["point_implausible"]


@pytest.mark.parametrize("distance", [0.0, 2e-3, 0.2])
def test_a_point_at_the_flange_or_on_a_tool_is_no_reason(distance):
    assert find_far_points([[0.0, 0.0, distance], None]) == []


def test_readings_with_exchanged_axes_are_refused_by_their_shape():
    readings = np.zeros((14, 3, 2))  # the last axis has to be x, y and z
    with pytest.raises(js.CampaignError, match=r"`unloaded` has the shape \(14, 3, 2\)"):
        js.Campaign.from_arrays(
            "KUKA KR 210 R2700 extra",
            np.zeros((14, 6)),
            unloaded=readings,
            loaded=readings,
            forces=np.ones((14, 3)),
            load_point=[0, 0, 100],
        )
