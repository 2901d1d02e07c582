"""Arms of one model have the dimensions of one model, in whatever frames and zeros they are described."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.calibrated_arms import ARMS, arm
from support.campaigns import prepare

from jointstiff.service.conversion.catalogue import catalogue, nominal_robot
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.imperfections import with_link_errors
from jointstiff.solver.comparison.shapes import list_other_dimensions, measure_arm
from jointstiff.solver.mechanics.chain import chain_dh_rows
from jointstiff.solver.mechanics.robot import Robot

ARM = default_arm()
TURN = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()


def robot_of(spring_arm) -> Robot:
    return prepare(simulate_campaign(spring_arm, configurations=1))[0]


def moved(spring_arm):
    """The arm on a pedestal, turned, in another R0."""
    return replace(
        spring_arm,
        axis_points=spring_arm.axis_points @ TURN.T + [0.4, -2.0, 0.7],
        axis_directions=spring_arm.axis_directions @ TURN.T,
        flange_rotation=TURN @ spring_arm.flange_rotation,
        flange_translation=TURN @ spring_arm.flange_translation + [0.4, -2.0, 0.7],
    )


SAME_MODEL = {
    "other base": moved(ARM),
    "other signs": replace(ARM, axis_directions=-ARM.axis_directions),
    "other tool": replace(ARM, flange_translation=ARM.flange_translation + np.array([0.3, 0.1, -0.2])),
    "calibrated": with_link_errors(ARM, length=2e-3, angle=np.radians(0.1), seed=4),
}


@pytest.mark.parametrize("other", SAME_MODEL.values(), ids=SAME_MODEL)
def test_descriptions_of_one_model_have_no_other_dimension(other):
    assert list_other_dimensions(robot_of(ARM), robot_of(other)) == []


@pytest.mark.parametrize("name", ARMS)
def test_a_calibrated_arm_is_of_the_model_of_its_maker(name):
    assert list_other_dimensions(arm(name), arm(name, crookedness=1e-3)) == []


def test_zero_positions_are_no_dimension():
    def with_zeros(offset: float) -> Robot:
        rows = [row.model_copy(update={"theta": row.theta + offset}) for row in rows_of_model]
        return Robot(chain_dh_rows(rows, "modified", "arm").model())

    described = next(each for each in catalogue().arms if each.model.convention == "modified")
    rows_of_model = described.model.rows
    assert list_other_dimensions(with_zeros(0.0), with_zeros(0.7)) == []


def test_the_dimensions_are_those_of_the_table_of_the_maker():
    sizes = {each.name: each.size for each in measure_arm(arm("r2000ic"))}
    assert sizes["distance of the axes of joint_1 and joint_2"] == pytest.approx(0.312)
    assert sizes["distance of the axes of joint_2 and joint_3"] == pytest.approx(1.075)
    assert sizes["distance of the axes of joint_3 and joint_4"] == pytest.approx(0.225)
    assert sizes["length along the axis of joint_4"] == pytest.approx(1.28)
    assert sizes["angle of the axes of joint_3 and joint_4"] == pytest.approx(np.pi / 2)


def test_the_dimension_that_differs_most_is_first():
    longer = replace(ARM, axis_points=ARM.axis_points + np.outer([0, 0, 0, 0, 1, 1], [0.2, 0.0, 0.0]))
    wider = replace(longer, axis_points=longer.axis_points + np.outer([0, 1, 1, 1, 1, 1], [0.05, 0.0, 0.0]))
    first, second = list_other_dimensions(robot_of(ARM), robot_of(wider))
    assert first.name == "length along the axis of joint_4"
    assert (first.first, first.second) == pytest.approx((1.31, 1.51))
    assert second.name == "distance of the axes of joint_1 and joint_2"
    assert second.second - second.first == pytest.approx(0.05)


def test_axes_that_are_parallel_in_one_arm_only_differ_in_their_angle():
    directions = ARM.axis_directions.copy()
    directions[2] = Rotation.from_rotvec([0.0, 0.0, np.radians(30)]).apply(directions[2])
    found = list_other_dimensions(robot_of(ARM), robot_of(replace(ARM, axis_directions=directions)))
    assert "angle of the axes of joint_2 and joint_3" in [each.name for each in found]


def test_arms_of_the_catalogue_differ_unless_they_share_their_dimensions():
    robots = {each.name: prepare_robot(nominal_robot(each)).robot for each in catalogue().arms}
    alike = [
        {one, other}
        for one, first in robots.items()
        for other, second in robots.items()
        if one < other
        and first.joint_kinds == second.joint_kinds
        and not list_other_dimensions(first, second)
    ]
    assert alike == [{"FANUC R-2000iC/165F", "FANUC R-2000iC/210F"}]  # one data sheet has both


def test_a_slide_has_a_direction_but_no_place():
    axis = {"theta": 0.0, "alpha": np.pi / 2}
    rows = [{"a": 0.0, "d": 0.0, "kind": "prismatic"}, {"a": 0.4, "d": 0.1}, {"a": 0.3, "d": 0.0}]
    described = catalogue().arms[0].model.rows[0]

    def railed(offset: float) -> Robot:
        first = {**rows[0], "a": offset}
        messages = [described.model_validate({**axis, **row}) for row in (first, *rows[1:])]
        return Robot(chain_dh_rows(messages, "standard", "railed").model())

    assert list_other_dimensions(railed(0.0), railed(0.5)) == []
