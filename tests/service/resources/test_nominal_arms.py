"""The catalogue of nominal arms: against published joint origins, the makers' reaches and real data."""

from __future__ import annotations

import numpy as np
import pytest
from reference.published_arms import ARMS, UR_ORIGINS, ur_flange_at
from support.in_process import Client
from support.shared_data import shared

from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.conversion.robots import to_kinematics
from jointstiff.service.resources.catalogue import catalogue, find_arm, nominal_robot
from jointstiff.service.store.store import Store
from jointstiff.solver.errors import RequestError

REACH_TOLERANCE = 0.003
"""Of a reach that is stated in millimetres, or in metres to two decimals [m]."""


@pytest.fixture(scope="module")
def client():
    with Store.open("sqlite://") as store:
        yield Client(store)


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


@pytest.mark.parametrize("name", ARMS)
def test_the_farthest_point_is_the_reach_that_the_maker_states(name):
    arm, robot = find_arm(name, "name"), robot_of(name)
    assert arm.reach == pytest.approx(ARMS[name].reach / 1e3)
    lower = np.array([-np.pi if row.lower is None else row.lower for row in arm.model.rows])
    upper = np.array([np.pi if row.upper is None else row.upper for row in arm.model.rows])
    low, high, best = lower[1:3], upper[1:3], 0.0
    for _ in range(6):  # ever finer grids of the second and third model angle
        second, third = (np.linspace(a, b, 31) for a, b in zip(low, high, strict=True))
        model = np.zeros((31 * 31, 6))
        model[:, 1:3] = np.stack(np.meshgrid(second, third), axis=-1).reshape(-1, 2)
        controller = robot.joint_map.controller_angles(model)
        flange = arm.reach_of == "flange"
        points = np.array(
            [each.flange_origin if flange else each.joint_origins[4] for each in postures(robot, controller)]
        )
        distance = np.hypot(points[:, 0], points[:, 1])
        best = max(best, float(distance.max()))
        at, width = model[distance.argmax(), 1:3], (high - low) / 10
        low, high = np.maximum(low, at - width), np.minimum(high, at + width)
    assert best == pytest.approx(arm.reach, abs=REACH_TOLERANCE)


def test_limits_are_ordered_and_hold_the_controllers_own():
    for arm in catalogue().arms:
        for row in arm.model.rows:
            assert (row.lower is None) == (row.upper is None)
            assert row.lower is None or row.lower < row.upper
    yaskawa = find_arm("GP180", "name").model.rows[2]
    assert np.degrees([yaskawa.lower, yaskawa.upper]) == pytest.approx([-90, 86])  # U: -86° to 90°


def test_the_fanuc_of_the_shared_data_has_the_same_table_and_map():
    campaign = shared("fanuc_r2000ic/campaign")
    measured = prepare_robot(RobotDocument.model_validate(campaign["robot"])).robot
    nominal = robot_of("FANUC R-2000iC/165F")
    controller = np.random.default_rng(2).uniform(-1, 1, (5, 6))
    for one, other in zip(postures(measured, controller), postures(nominal, controller), strict=True):
        np.testing.assert_allclose(
            np.array(one.flange_origin) - [0, 0, 0.670], other.flange_origin, atol=1e-12
        )
        np.testing.assert_allclose(one.flange_axes[2], other.flange_axes[2], atol=1e-12)


@pytest.mark.parametrize(
    ("typed", "name"),
    [
        ("KUKA KR 210 R2700", "KUKA KR 210 R2700 extra"),
        ("r-2000ic/165f", "FANUC R-2000iC/165F"),
        ("irb120", "ABB IRB 120-3/0.6"),
        ("UR5E", "Universal Robots UR5e"),
        ("stäubli tx2-90", "Stäubli TX2-90"),
    ],
)
def test_part_of_a_name_is_enough(typed, name):
    assert find_arm(typed, "name").name == name


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


def test_over_the_api(client):
    listed = client.get("/v1/catalogue").json()
    arm = next(each for each in listed["arms"] if each["name"] == "FANUC M-20iD/25")
    assert arm["reach"] == pytest.approx(1.831)
    presets = {each["id"]: each for each in listed["joint_maps"]}
    assert presets[arm["joint_map_preset"]]["joint_map"] == arm["joint_map"]
    body = {"name": "cell 3", "model": {"format": "catalogue", "arm": "M-20iD"}}
    answer = client.request("POST", "/v1/robots", json=body)
    assert answer.status_code == 201, answer.text
    robot = answer.json()
    assert robot["nominal_arm"] == "FANUC M-20iD/25"
    assert robot["model"] == arm["model"]
    assert robot["joint_map"] == arm["joint_map"]
    described = {"name": "cell 4", "model": arm["model"], "joint_map": arm["joint_map"]}
    same = client.request("POST", "/v1/robots", json=described).json()
    assert same["nominal_arm"] is None
    found = client.get("/v1/robots", params={"content_hash": robot["content_hash"]}).json()["items"]
    assert [(each["name"], each["nominal_arm"]) for each in found] == [
        ("cell 4", None),
        ("cell 3", "FANUC M-20iD/25"),
    ]
    own = {"matrix": np.eye(6).tolist(), "offset": [0.0] * 6}
    mapped = client.request("POST", "/v1/robots", json=body | {"joint_map": own}).json()
    assert mapped["joint_map"] == own
    refused = client.request(
        "POST", "/v1/robots", json=body | {"model": {"format": "catalogue", "arm": "X1"}}
    )
    assert refused.status_code == 422
    assert refused.json()["where"] == "model.arm"
