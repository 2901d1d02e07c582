"""Exports read back: numbers by the readers of each format, statics by MuJoCo."""

import csv
import io
import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import openpyxl
import pytest
from support.everything import LINKS
from support.slides import arm_on_rail

import jointstiff
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.reports.exports import FORMATS, ExportedModel, export_model
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.postures import Postures

ARM = default_arm()
HOSTILE = '=HYPERLINK("http://x")--><!ENTITY & "\'<b>'


def model_of(document):
    campaign = Campaign.model_validate_json(json.dumps(document))
    run = jointstiff.identify(campaign, campaign.run)
    return ExportedModel.from_run(run, prepare_robot(campaign.robot).robot, campaign.robot.name)


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(ARM, load="pull", configurations=12, seed=1)


@pytest.fixture(scope="module")
def pulled(document):
    return model_of(document)


@pytest.fixture(scope="module")
def weighed():
    """Joint 1 is not observable under a dead weight; the name of the robot means harm."""
    campaign = simulate_campaign(ARM, load="dead_weight", configurations=12, seed=2)
    return model_of(campaign | {"robot": campaign["robot"] | {"name": HOSTILE}})


def parsed(content):
    return ElementTree.fromstring(content)  # noqa: S314 - our own


@pytest.fixture(scope="module")
def bending():
    document = elastic_campaign(beam_arm(ARM), configurations=12, seed=5)
    return model_of(document | {"run": LINKS})


def test_a_table_with_links_names_effective_own_and_alone(bending):
    rows = list(csv.DictReader(io.StringIO(export_model(bending, "csv").decode())))
    result = bending.result
    for row, joint, alone in zip(rows, result.joints, result.alone.joints, strict=True):
        assert float(row["effective compliance [rad/(N.m)]"]) == joint.compliance
        assert float(row["own compliance [rad/(N.m)]"]) == joint.own_compliance
        assert float(row["stiffness alone [N.m/rad]"]) == alone.stiffness
        assert "stiffness [N.m/rad]" not in row


def test_springs_without_links_are_the_fit_by_joints_alone_with_both_scores(bending):
    content = export_model(bending, "mjcf").decode()
    gains = [float(each.get("kp")) for each in parsed(content).iter("position")]
    assert gains == [joint.stiffness for joint in bending.result.alone.joints]
    scores = {each.model: f"{100 * each.compensation:.1f} %" for each in bending.result.choice.models}
    assert f"explains {scores['joints']} of" in content
    assert f"the model with links {scores['diagonal_links']}." in content


def test_an_older_run_with_links_gives_no_springs(bending):
    older = replace(bending, result=bending.result.model_copy(update={"alone": None}))
    with pytest.raises(RequestError, match="no fit by joints alone"):
        export_model(older, "mjcf")
    assert "own compliance" in export_model(older, "csv").decode()


def numbers_of(model):
    return {joint.name: joint for joint in model.result.joints}


@pytest.mark.parametrize(("joint", "degrees"), [(None, 0.0), (2, 90.0)])
def test_angles_that_the_controller_shows_otherwise_are_said(document, joint, degrees):
    offset = [float(np.radians(degrees)) if j == joint else 0.0 for j in range(6)]
    stated = document["robot"] | {"joint_map": {"matrix": np.eye(6).tolist(), "offset": offset}}
    robot = prepare_robot(Campaign.model_validate(document | {"robot": stated}).robot).robot
    run = jointstiff.identify(document)
    text = export_model(ExportedModel(run, run.result, robot, "arm"), "mjcf").decode()
    assert ("The controller shows other angles" in text) == (joint is not None)


def cells_of(name, content):
    if name == "csv":
        return list(csv.reader(io.StringIO(content.decode())))
    sheet = openpyxl.load_workbook(io.BytesIO(content))["joints"]
    return [list(row) for row in sheet.iter_rows(values_only=True)]


@pytest.mark.parametrize("name", ["csv", "xlsx"])
def test_tables_have_the_very_numbers_with_units(pulled, name):
    head, *rows = cells_of(name, export_model(pulled, name))
    columns = [dict(zip(head, row, strict=True)) for row in rows]
    for joint, row in zip(pulled.result.joints, columns, strict=True):
        assert row["joint"] == joint.name
        found = [
            float(row[header])
            for header in (
                "stiffness [N.m/rad]",
                "stiffness low [N.m/rad]",
                "stiffness high [N.m/rad]",
                "compliance standard uncertainty [rad/(N.m)]",
            )
        ]
        expected = [joint.stiffness, *joint.stiffness_interval, joint.standard_uncertainty]
        assert found == (expected if name == "csv" else pytest.approx(expected, rel=1e-15))  # of 16 digits
    texts = {"joint", "status", "verdict", "reason", "run", "input SHA-256", "overall verdict"}
    assert {row["overall verdict"] for row in columns} == {pulled.result.assessment.verdict}
    assert all("[" in header for header in head if header not in texts)


def test_the_workbook_has_kinematics_and_provenance(pulled):
    book = openpyxl.load_workbook(io.BytesIO(export_model(pulled, "xlsx")))
    assert book.sheetnames[:3] == ["joints", "kinematics", "provenance"]
    shown = " ".join(str(cell) for row in book["provenance"].iter_rows(values_only=True) for cell in row)
    assert pulled.run.provenance.input_hash in shown
    head, first, *_ = book["kinematics"].iter_rows(values_only=True)
    assert dict(zip(head, first, strict=True))["z [m]"] == pulled.chain.joints[0].translation[2]


def test_springs_stand_where_there_is_a_number(pulled, weighed):
    for model in (pulled, weighed):
        known = {name: joint.stiffness for name, joint in numbers_of(model).items() if joint.stiffness}
        drives = parsed(export_model(model, "mjcf")).find("actuator")
        assert {each.get("joint"): float(each.get("kp")) for each in drives} == known


def test_no_number_is_invented_and_the_file_says_why(weighed):
    assert numbers_of(weighed)["joint_1"].stiffness is None
    for name in FORMATS:
        content = export_model(weighed, name)
        text = str(cells_of(name, content)) if name == "xlsx" else content.decode()
        assert "the load never twists this joint" in text, name
    held = parsed(export_model(weighed, "mjcf")).find("equality")
    assert [each.get("joint1") for each in held] == ["joint_1"]


@pytest.mark.parametrize(
    ("compliance", "said"),
    [(0.0, "cannot distinguish the joint from rigid"), (-1e-7, "the estimate is negative")],
)
def test_a_rigid_or_negative_joint_has_no_spring(pulled, compliance, said):
    stiffness = 1 / compliance if compliance else None
    joint = pulled.result.joints[0].model_copy(update={"compliance": compliance, "stiffness": stiffness})
    result = pulled.result.model_copy(update={"joints": [joint, *pulled.result.joints[1:]]})
    changed = ExportedModel(pulled.run, result, pulled.robot, "arm")
    text = export_model(changed, "mjcf").decode()
    assert said in text
    assert 'kp="-' not in text


def test_hostile_names_are_text(weighed):
    assert parsed(export_model(weighed, "mjcf")).get("model") == HOSTILE
    book = openpyxl.load_workbook(io.BytesIO(export_model(weighed, "xlsx")))
    assert not [c for sheet in book for row in sheet.iter_rows() for c in row if c.data_type == "f"]


def test_the_file_says_which_geometry_it_has(pulled):
    found = ExportedModel(pulled.run, pulled.result, pulled.robot, "arm", "g1")
    assert "as identified, geometry g1" in export_model(found, "mjcf").decode()
    assert "as in the robot's model, not identified" in export_model(pulled, "mjcf").decode()


def statics(mujoco, model, content, q, force):
    """MuJoCo's deflection of the flange under a force on its origin [m]: its forces in balance."""
    arm = mujoco.MjModel.from_xml_string(content.decode())
    data = mujoco.MjData(arm)
    body = arm.site(model.chain.flange).bodyid[0]
    data.qpos[:] = data.ctrl[:] = q
    mujoco.mj_forward(arm, data)
    start = data.site(model.chain.flange).xpos.copy()
    stiffness = np.array([joint.stiffness for joint in model.result.joints])
    for _ in range(50):
        data.qfrc_applied[:] = 0.0
        mujoco.mj_applyFT(
            arm, data, force, np.zeros(3), data.site(model.chain.flange).xpos, body, data.qfrc_applied
        )
        mujoco.mj_forward(arm, data)
        rest = data.qfrc_applied + data.qfrc_actuator
        data.qpos[:] += rest / stiffness
        if np.abs(rest).max() < 1e-9:
            break
    mujoco.mj_forward(arm, data)
    return data.site(model.chain.flange).xpos - start


@pytest.mark.process  # MuJoCo asks one for the version of its window library
@pytest.mark.parametrize("arm", [ARM, arm_on_rail()], ids=["six axes", "on a rail"])
def test_mujoco_bends_as_the_springs_do(arm, weighed):
    mujoco = pytest.importorskip("mujoco")
    held = mujoco.MjModel.from_xml_string(export_model(weighed, "mjcf").decode())
    assert (held.nu, held.neq) == (5, 1)
    pulled = model_of(simulate_campaign(arm, load="pull", configurations=24, seed=3))
    content = export_model(pulled, "mjcf")
    q = np.r_[[0.4] * len(arm.prismatic), np.radians([10.0, -20.0, 30.0, 5.0, 45.0, 0.0])]
    posture = Postures(pulled.robot, q[None])
    J = posture.jacobian_at(posture.flange_translation[:, None])[0, 0]
    C = np.diag([joint.compliance for joint in pulled.result.joints])
    differences = []
    for share in (0.1, 0.01):
        force = share * np.array([600.0, 800.0, -1118.0])
        linear = J @ C @ J.T @ force
        differences.append(
            np.linalg.norm(statics(mujoco, pulled, content, q, force) - linear) / np.linalg.norm(linear)
        )
    assert differences[0] < 1e-2
    assert differences[1] == pytest.approx(differences[0] / 10, rel=0.05)
