"""Plans of weight steps: what they promise, the table to fill in, and what is refused."""

import csv
import io

import numpy as np
import pytest
from support.weight_steps import (
    ARM_LOAD,
    ARM_NOISE,
    COBOT_NOISE,
    JOINTS,
    MASS_UNCERTAINTY,
    PLACE,
    PLACE_UNCERTAINTY,
    PLANS,
    build_arm,
    plan,
    read,
    simulate,
)

import jointstiff as js
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.problems import CampaignError
from jointstiff.simulator.document import robot_document
from jointstiff.simulator.weight_step import SteppedArm
from jointstiff.solver.errors import RequestError
from jointstiff.solver.gearboxes.outcome import identify_gearboxes

STEP = {
    "mass": ARM_LOAD,
    "mass_uncertainty": MASS_UNCERTAINTY * ARM_LOAD,
    "point_uncertainty": PLACE_UNCERTAINTY,
}
SMALL = {"load_point": PLACE.tolist(), "candidates": 100, "readings": 6, "units": "m, rad, N, N.m"}
ROBOT = RobotDocument.model_validate(robot_document(build_arm(is_cobot=False)))


@pytest.fixture(scope="module")
def small():
    return js.plan(ROBOT, weight_step=STEP, joints=["joint_2", "joint_3"], **SMALL)


def test_planned_torques_vary_almost_as_much_as_torques_can():
    """The variance of a torque is greatest if half of the postures are at either end of its range.

    Errors of the load would make the plan prefer postures that tell them from compliances.
    """
    arm = SteppedArm(build_arm(is_cobot=False), ARM_LOAD, PLACE, np.zeros(6))
    anywhere = np.random.default_rng(0).uniform(*np.array(arm.arm.limits).T, (2000, 6))
    range_ = np.ptp(arm.torques(anywhere, loaded=True), axis=0)
    exact = {"mass": ARM_LOAD, "mass_uncertainty": 0.0, "point_uncertainty": 0.0}
    options = SMALL | {"candidates": 1000, "readings": 12}
    planned = js.plan(ROBOT, weight_step=exact, joints=["joint_2", "joint_3"], **options).result
    chosen = np.array([each.joints for each in planned.readings])
    spread = arm.torques(chosen, loaded=True).std(axis=0)
    for joint in JOINTS:
        assert spread[joint] > 0.8 * 0.5 * range_[joint]


@pytest.mark.parametrize("is_cobot", [False, True])
def test_a_plan_promises_the_half_widths_that_its_step_has(is_cobot):
    noise = COBOT_NOISE if is_cobot else ARM_NOISE
    promised = [1.96 * joint.relative for joint in plan(0, is_cobot=is_cobot, noise=noise).joints]
    widths = []
    for seed in range(0, 60, PLANS):  # steps of the same plan
        step = read(simulate(seed, is_cobot=is_cobot).document)
        widths.append([each.half_width for each in identify_gearboxes(step).gearboxes])
    np.testing.assert_allclose(np.median(widths, axis=0), promised, rtol=0.2)


def test_a_filled_in_table_is_read(tmp_path, small):
    """Angles of a step without noise give the stiffnesses of its springs."""
    sheet = csv.DictReader(io.StringIO(small.table("csv").decode()))
    arm = build_arm(is_cobot=False)
    stepped = SteppedArm(arm, ARM_LOAD, PLACE, np.zeros(6))
    rows = list(sheet)
    assert len(rows) == 2 * 6 * 2 * 2
    for row in rows:
        motor = np.radians([[float(row[f"J{j + 1} [deg]"]) for j in range(6)]])
        link = stepped.link_angles(motor, loaded=row["state"] == "loaded")
        joint = arm.joint_names.index(row["joint"])
        row["motor [deg]"] = np.degrees(motor[0, joint])
        row["link [deg]"] = np.degrees(link[0, joint])
    path = tmp_path / "step.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    found = js.gearbox(path, robot=ROBOT, load={"mass": ARM_LOAD, "point": (1e3 * PLACE).tolist()}).result
    for joint, gearbox in zip(JOINTS, found.gearboxes, strict=True):
        assert gearbox.stiffness == pytest.approx(arm.stiffnesses[joint], rel=2e-3)


def test_the_report_names_both_sides_of_approach(small):
    assert "+ and -" in small.summary()
    assert not any(each.held_out for each in small.result.readings)


def test_without_stated_joints_a_plan_has_those_that_the_weight_twists():
    result = js.plan(ROBOT, weight_step=STEP, **SMALL).result
    assert [joint.name for joint in result.joints] == ["joint_2", "joint_3", "joint_4", "joint_5"]
    assert result.left_out == ["joint_1", "joint_6"]
    assert result.assessment.verdict == "use"


@pytest.mark.parametrize(
    ("options", "where", "reason"),
    [
        ({"load": {"kind": "dead_weight", "force": 981.0}}, "load", "the plan has `load`"),
        ({"targets": {"A": [0.0, 0.0, 0.1]}}, "targets", "the plan has `targets`"),
        ({"goal": "2 %"}, "goal", "the plan has `goal`"),
        ({"readings": 3}, "readings", "3 postures are too few to determine"),
        ({"joints": ["joint_9"]}, "joints", "joint_9"),
        ({"criterion": "worst_place"}, "criterion", "give relative_a, d or e"),
        ({"joints": ["joint_1"]}, "joints", "the weight twists joint_1 in no candidate posture"),
        ({"joints": ["joint_6"], "load_point": [0, 0, 0.1]}, "joints", "the weight twists joint_6 in no"),
    ],
)
def test_what_a_step_cannot_have_is_refused(options, where, reason):
    with pytest.raises(CampaignError, match=reason) as refused:
        js.plan(ROBOT, **({"weight_step": STEP} | SMALL | options))
    assert where in str(refused.value)


@pytest.mark.parametrize(
    ("mistaken", "mended"),
    [
        ({"joints": ["joint_1", "joint_2"]}, {"joints": ["joint_2"]}),
        ({"joints": ["joint_6"], "load_point": [0.0, 0.0, 0.1]}, {"load_point": [0.1, 0.0, 0.1]}),
    ],
)
def test_a_joint_without_torque_is_refused_in_words_of_encoders_and_the_remedy_works(mistaken, mended):
    options = SMALL | {"weight_step": STEP} | mistaken
    with pytest.raises(CampaignError) as refused:
        js.plan(ROBOT, **options)
    assert "target" not in str(refused.value)
    assert "both encoders" in str(refused.value)
    planned = js.plan(ROBOT, **options | mended).result
    assert [joint.name for joint in planned.joints] == (options | mended)["joints"]


def test_a_weight_too_small_to_tell_is_said_in_words_of_encoders():
    options = SMALL | {"joints": ["joint_2"], "stiffness": {"joint_2": 3e6}}
    light, heavy = ({"mass": mass} for mass in (0.005, ARM_LOAD))
    reason = js.plan(ROBOT, weight_step=light, **options).result.assessment.reasons[0]
    assert reason.code == "joint_stays_uncertain"
    assert "target" not in reason.remedy
    assert "larger mass" in reason.remedy
    assert js.plan(ROBOT, weight_step=heavy, **options).result.assessment.verdict == "use"


def test_the_plan_of_a_step_is_no_campaign(small):
    with pytest.raises(RequestError, match="a weight step, which is read by two encoders instead of targets"):
        js.rehearse(small, robot=ROBOT)


def test_a_weight_in_newtons_is_a_load_of_many_payloads():
    robot = ROBOT.model_copy(update={"payload": 240.0})
    heavy = js.plan(robot, weight_step=STEP | {"mass": 981.0}, joints=["joint_2", "joint_3"], **SMALL)
    reason = heavy.result.assessment.reasons[0]
    assert (reason.weight, reason.where) == ("do_not_use", "weight_step.mass")
    assert reason.message == "the load has 981 kg, but the robot's payload is 240 kg"
    right = js.plan(robot, weight_step=STEP, joints=["joint_2", "joint_3"], **SMALL)
    assert "payload" not in str(right.result.assessment)


def test_stiffnesses_of_no_joint_are_refused_with_their_unit():
    stated = {"joint_2": 3.1, "joint_3": 2.5}
    with pytest.raises(CampaignError) as refused:
        js.plan(ROBOT, weight_step=STEP, joints=list(stated), stiffness=stated, **SMALL)
    assert "is 3.1 N·m/rad; 1000 N·m/rad to 1 · 10⁹ N·m/rad is plausible" in refused.value.problem.detail
    assert "in a table is 3.1e6" in refused.value.problem.remedy
