"""Encoder readings and the catalogue of nominal arms."""

import httpx2
import numpy as np
import pytest
from reference.published_arms import ARMS, UR_ORIGINS, ur_flange_at
from support.readings import with_encoders

from jointstiff.schemas.robot import CatalogueModel, GeometryModel, RobotDocument
from jointstiff.service.conversion.catalogue import catalogue, find_arm, nominal_robot
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.conversion.robots import to_postures
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.campaign import equilibrium
from jointstiff.simulator.document import experiment_of
from jointstiff.solver.errors import RobotError

ARM = default_arm()


def campaign(**options):
    return with_encoders(ARM, simulate_campaign(ARM, load="pull", seed=3, **options), noise=5e-6)


@pytest.fixture(scope="module")
def robot_id(service):
    body = campaign(configurations=1)["robot"]
    return httpx2.post(f"{service.url}/v1/robots", json=body, timeout=60.0).json()["id"]


def test_over_the_api(client, robot_id):
    body = campaign()["measurement_set"] | {"robot_id": robot_id}
    stored = client.post("/v1/measurement-sets", json=body).json()
    assert stored["warnings"] == []
    assert stored["noise"]["encoder_sigma"] == 5e-6
    again = client.get(f"/v1/measurement-sets/{stored['id']}").json()
    for sent, kept in zip(body["observations"], again["observations"], strict=True):
        assert kept["encoder_readings"] == sent["encoder_readings"]
    result = client.post("/v1/runs", json={"measurement_set_id": stored["id"]}).json()["result"]
    assert len(result["encoder_residuals"]) == 19 * 6
    experiment = experiment_of(campaign())
    exact = equilibrium(ARM, experiment.joints, *experiment.wrenches)
    for residual in result["encoder_residuals"]:
        i, j = int(residual["observation"][1:]) - 1, int(residual["joint"][-1]) - 1
        assert residual["predicted"] == pytest.approx(exact[i, j], abs=2e-5)
        assert residual["residual"] == pytest.approx(residual["deflection"] - residual["predicted"])
        assert abs(residual["residual"]) < 5 * np.sqrt(2) * 5e-6
    assert result["goodness"]["degrees_of_freedom"] == pytest.approx(19 * (9 + 6) - 6)


def test_encoders_make_uncertainties_smaller(client, robot_id):
    uncertainties = []
    for document in (campaign(), simulate_campaign(ARM, load="pull", seed=3)):
        body = document["measurement_set"] | {"robot_id": robot_id}
        set_id = client.post("/v1/measurement-sets", json=body).json()["id"]
        result = client.post("/v1/runs", json={"measurement_set_id": set_id}).json()["result"]
        readings, *_ = result["budget"]["components"]  # the load point's stays
        uncertainties.append(readings["contributions"])
    assert (np.array(uncertainties[0]) < 0.7 * np.array(uncertainties[1])).all()


def test_every_arm_is_compared():
    assert {arm.name for arm in catalogue().arms} == {*ARMS, *UR_ORIGINS}
    assert len({arm.name for arm in catalogue().arms}) == len(catalogue().arms)


@pytest.mark.parametrize("name", [*ARMS, *UR_ORIGINS])
def test_the_flange_is_where_the_published_joints_put_it(name):
    controller = np.random.default_rng(1).uniform(-3, 3, (20, 6))
    controller[0] = 0.0
    robot = prepare_robot(nominal_robot(find_arm(name, "name"))).robot
    postures = to_postures(robot, controller.tolist())
    for angles, posture in zip(controller, postures, strict=True):
        published = ARMS[name].flange_at(angles) if name in ARMS else ur_flange_at(name, angles)
        np.testing.assert_allclose(posture.flange_origin, published[0], atol=1e-9)
        np.testing.assert_allclose(np.transpose(posture.flange_axes), published[1], atol=1e-9)


@pytest.mark.parametrize("name", ["KUKA KR 210 R2700 extra", "FANUC M-20iA"])
def test_a_document_may_name_an_arm_of_the_catalogue(name):
    arm = next(arm for arm in catalogue().arms if arm.name == name or arm.name.startswith(name[:5]))
    named = RobotDocument(name="cell", model=CatalogueModel(format="catalogue", arm=arm.name))
    prepared, written = prepare_robot(named), prepare_robot(nominal_robot(arm))
    assert prepared.content_hash == written.content_hash
    assert prepared.document.model == arm.model


def test_a_document_of_a_file_cannot_name_an_arm_or_a_geometry_that_is_not_there():
    for model, where in (
        (CatalogueModel(format="catalogue", arm="no such arm"), "model.arm"),
        (GeometryModel(format="geometry", geometry_id="g"), "model.geometry_id"),
    ):
        with pytest.raises(RobotError) as refused:
            prepare_robot(RobotDocument(name="cell", model=model))
        assert refused.value.where == where
        assert refused.value.remedy


def test_a_campaign_and_a_drawing_may_name_an_arm_of_the_catalogue(client):
    arm = find_arm("KUKA KR 210 R2700 extra", "arm")
    named = {"name": "cell", "model": {"format": "catalogue", "arm": arm.name}}
    drawn = client.post("/v1/kinematics", json={"robot": named}).json()
    written = {"name": "cell", "model": arm.model.model_dump(mode="json")}
    if arm.joint_map is not None:
        written["joint_map"] = arm.joint_map.model_dump(mode="json")
    assert drawn == client.post("/v1/kinematics", json={"robot": written}).json()
    campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    answer = client.post("/v1/campaigns", json={**campaign, "robot": named})
    assert answer.status_code == 201, answer.text
    run = answer.json()
    measured = client.get(f"/v1/measurement-sets/{run['request']['measurement_set_id']}").json()
    assert client.get(f"/v1/robots/{measured['robot_id']}").json()["nominal_arm"] == arm.name
