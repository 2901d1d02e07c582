"""The catalogue of nominal arms: against published joint origins, the makers' reaches and real data."""

import numpy as np
import pytest
from reference.published_arms import ARMS, UR_ORIGINS, ur_flange_at
from support.api import post

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


def test_over_the_api(local):
    listed = local.get("/v1/catalogue").json()
    arm = next(each for each in listed["arms"] if each["name"] == "FANUC M-20iD/25")
    assert arm["reach"] == pytest.approx(1.831)
    presets = {each["id"]: each for each in listed["joint_maps"]}
    assert presets[arm["joint_map_preset"]]["joint_map"] == arm["joint_map"]
    body = {"name": "cell 3", "model": {"format": "catalogue", "arm": "M-20iD"}}
    robot = post(local, "/v1/robots", body)
    assert robot["nominal_arm"] == "FANUC M-20iD/25"
    assert robot["model"] == arm["model"]
    assert robot["joint_map"] == arm["joint_map"]
    described = {"name": "cell 4", "model": arm["model"], "joint_map": arm["joint_map"]}
    same = local.request("POST", "/v1/robots", json=described).json()
    assert same["nominal_arm"] is None
    found = local.get("/v1/robots", params={"content_hash": robot["content_hash"]}).json()["items"]
    assert [(each["name"], each["nominal_arm"]) for each in found] == [
        ("cell 4", None),
        ("cell 3", "FANUC M-20iD/25"),
    ]
    own = {"matrix": np.eye(6).tolist(), "offset": [0.0] * 6}
    mapped = local.request("POST", "/v1/robots", json=body | {"joint_map": own}).json()
    assert mapped["joint_map"] == own
    refused = post(local, "/v1/robots", body | {"model": {"format": "catalogue", "arm": "X1"}}, 422)
    assert refused["where"] == "model.arm"
