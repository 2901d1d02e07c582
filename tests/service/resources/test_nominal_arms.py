"""The catalogue of nominal arms: against published joint origins, the makers' reaches and real data."""

import numpy as np
import pytest
from reference.published_arms import ARMS, UR_ORIGINS, ur_flange_at

from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.conversion.robots import to_kinematics
from jointstiff.service.resources.catalogue import catalogue, find_arm, nominal_robot
from jointstiff.solver.errors import RequestError


def robot_of(name):
    return prepare_robot(nominal_robot(find_arm(name, "name"))).robot


def postures(robot, controller):
    return to_kinematics(robot, controller.tolist()).postures


def test_every_arm_is_compared():
    assert {arm.name for arm in catalogue().arms} == {*ARMS, *UR_ORIGINS}
    assert len({arm.name for arm in catalogue().arms}) == len(catalogue().arms)


@pytest.mark.parametrize("name", [*ARMS, *UR_ORIGINS])
def test_the_flange_is_where_the_published_joints_put_it(name):
    controller = np.random.default_rng(1).uniform(-3, 3, (20, 6))
    controller[0] = 0.0
    for angles, posture in zip(controller, postures(robot_of(name), controller), strict=True):
        published = ARMS[name].flange_at(angles) if name in ARMS else ur_flange_at(name, angles)
        np.testing.assert_allclose(posture.flange_origin, published[0], atol=1e-9)
        np.testing.assert_allclose(np.transpose(posture.flange_axes), published[1], atol=1e-9)


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("IRB", "several arms"),
        ("", "no arm"),
        ("/", "no arm"),
        ("KUKA KR 6 R700", "similar names: KUKA KR 6 R900 sixx"),
        ("💥", "no arm"),
    ],
)
def test_an_unclear_name_is_refused(typed, said):
    with pytest.raises(RequestError, match=said) as caught:
        find_arm(typed, "model.arm")
    assert caught.value.where == "model.arm"
