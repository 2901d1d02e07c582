"""A unit of force that is confused shows where the payload is known: stiffness over payload times reach."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import estimate, prepare

from jointstiff.schemas.robot import DhRow
from jointstiff.service.conversion.catalogue import catalogue, nominal_robot
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.evidence.payload import FACTOR, MEASURED_ARMS, inspect_force_unit
from jointstiff.solver.fit.estimate import JointCompliance
from jointstiff.solver.mechanics.chain import chain_dh_rows
from jointstiff.solver.mechanics.postures import measure_reach
from jointstiff.solver.mechanics.robot import Robot

PAPER = (1e9, 3.2e6, 2.6e6, 0.42e6, 0.23e6, 0.089e6)
"""Table II of the paper: k2 to k6 [N·m/rad], by a dead weight that does not twist axis 1."""
R_2000IC = (861071.8805, 2743390.9984, 2069594.5785, 359217.0978, 444155.9142, 137986.3549)
"""Least squares on all 30 configurations of the real set [N·m/rad]."""
NEWTONS = {"N": 1.0, "kN": 1000.0, "kgf": 9.80665, "lbf": 0.45359237 * 9.80665}
TAPS = {
    ("N", "kgf"): ["N"],
    ("N", "lbf"): ["N"],
    ("kgf", "N"): ["kgf", "lbf"],
    ("lbf", "N"): ["lbf", "kgf"],
    ("kN", "N"): ["kN"],
    ("N", "kN"): ["N"],
}
"""By the unit of the numbers and the declared one: the units that are offered, the likeliest first."""


@pytest.fixture(scope="module")
def pulls():
    """Readings of the 240 kg class, whose wrist reaches 2.69 m."""
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    return prepare(document)


def joints_of(stiffness, unknown=()):
    return [
        JointCompliance(f"joint_{j + 1}", "revolute", "not_observable")
        if j in unknown
        else JointCompliance(f"joint_{j + 1}", "revolute", "identified", 1.0 / each)
        for j, each in enumerate(stiffness)
    ]


def inspected(pulls, stiffness, declared="N", unknown=(), robot=None):
    measurements = replace(pulls[1], force_unit=declared)
    return list(inspect_force_unit(robot or pulls[0], measurements, joints_of(stiffness, unknown)))


def units(findings):
    return [finding.action.unit for finding in findings]


def test_the_measured_arm_has_121_or_154_per_radian_by_its_variant():
    ratios = [np.prod(arm.ratios()) ** 0.2 for arm in MEASURED_ARMS]
    by_hand = [np.prod(R_2000IC[1:]) ** 0.2 / (payload * 9.80665 * 2.655) for payload in (165, 210)]
    np.testing.assert_allclose(ratios, by_hand, rtol=2e-3)
    assert [round(ratio) for ratio in ratios] == [154, 121]


def test_payload_and_reach_of_the_measured_arms_are_those_of_the_catalogue():
    arms = {arm.name: arm for arm in catalogue().arms}
    for measured in MEASURED_ARMS:
        arm = arms[measured.name]
        assert measured.payload == arm.payload
        assert any(source.startswith("payload: ") for source in arm.sources)
        assert measured.reach == arm.reach


def test_no_ratio_is_plausible_both_in_newtons_and_in_kgf():
    assert NEWTONS["kgf"] > FACTOR**2


@pytest.mark.parametrize("arm", [PAPER, R_2000IC])
def test_the_right_unit_is_accused_of_nothing(pulls, arm):
    for declared in ("N", "kN", "kgf", "lbf", "kg"):
        assert not inspected(pulls, arm, declared)


@pytest.mark.parametrize("arm", [PAPER, R_2000IC])
@pytest.mark.parametrize(("true", "declared"), TAPS)
def test_a_confused_unit_is_found_and_the_right_one_is_the_first_tap(pulls, arm, true, declared):
    findings = inspected(pulls, np.array(arm) * NEWTONS[declared] / NEWTONS[true], declared)
    offered = units(findings)
    assert offered == TAPS[true, declared][: len(offered)]
    assert {finding.code for finding in findings} == {"stiffness_against_payload"}
    assert {finding.weight for finding in findings} == {"use_with_care"}
    assert findings[0].remedy.endswith(
        f"if the numbers are right, use the result with care; if in {true}, set `units.force` to {true}"
    )


def test_a_hung_mass_in_kg_is_as_many_kgf(pulls):
    assert units(inspected(pulls, 9.80665 * np.array(PAPER), "kg")) == ["N"]


def test_the_finding_states_the_ratio_and_the_measured_arm(pulls):
    (finding,) = inspected(pulls, 9.80665 * np.array(PAPER), "kgf")
    assert finding.message == (
        "the geometric mean of the stiffnesses of joint_2 to joint_6, divided by payload · g · reach "
        "(240 kg, 2.69 m), is 914 rad⁻¹; the arm of our comparison has 154 (FANUC R-2000iC/165F) "
        "or 121 (FANUC R-2000iC/210F), and 45 to 410 rad⁻¹ is plausible; "
        "forces in N, not in kgf as declared, would give 93.2 rad⁻¹"
    )


def test_where_no_unit_helps_the_payload_is_to_be_checked(pulls):
    (finding,) = inspected(pulls, 30.0 * np.array(PAPER))
    assert finding.action is None
    assert "`payload`" in finding.remedy


@pytest.mark.parametrize("unknown", [(1, 2), (4, 5), (1, 5)])
def test_three_joints_are_enough_and_are_compared_with_the_same_joints(pulls, unknown):
    assert not inspected(pulls, PAPER, unknown=unknown)
    assert units(inspected(pulls, 9.80665 * np.array(PAPER), "kgf", unknown))[0] == "N"


def test_a_robot_without_a_payload_is_asked_for_it_and_told_which_one_suits_each_unit(pulls):
    (finding,) = inspected(pulls, PAPER, robot=pulls[0].with_payload(None))
    assert (finding.code, finding.weight) == ("payload_not_stated", "use")
    assert (finding.action.kind, finding.action.payload) == ("state_payload", None)
    # 93.2 rad⁻¹ of 240 kg, between a third and three times 136 rad⁻¹
    assert finding.message == (
        "the robot states no payload, so the unit of the forces (N) cannot be checked; the stiffnesses of "
        "joint_2 to joint_6 are plausible for a payload of 55 to 490 kg with forces in N, 540 to 4800 kg "
        "with forces in kgf, 240 to 2200 kg with forces in lbf"
    )


def test_nothing_is_compared_where_the_numbers_do_not_allow_it(pulls):
    wrong = 9.80665 * np.array(PAPER)
    assert inspected(pulls, wrong, "kgf")
    assert not inspected(pulls, wrong, "kgf", unknown=(1, 2, 3))
    row = {"a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0}
    rows = [DhRow(**row), DhRow(**row, kind="prismatic"), *[DhRow(**row)] * 4]
    sliding = Robot(chain_dh_rows(rows, "standard", "slides").model(), payload=240.0)
    assert not inspected(pulls, wrong, "kgf", robot=sliding)
    longer = Robot(chain_dh_rows([DhRow(**row)] * 7, "standard", "seven").model(), payload=240.0)
    assert not inspected(pulls, wrong, "kgf", robot=longer)


@pytest.mark.parametrize("seed", range(20))
def test_clean_campaigns_are_accused_of_nothing(seed):
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=seed)
    robot, measurements = prepare(document)
    assert not list(inspect_force_unit(robot, measurements, estimate(robot, measurements).joints))


@pytest.mark.parametrize("arm", catalogue().arms, ids=lambda arm: arm.name)
def test_the_reach_is_near_the_one_that_the_maker_states(arm):
    reach = measure_reach(prepare_robot(nominal_robot(arm)).robot)
    within = 0.003 if arm.reach_of == "wrist_centre" else 0.11
    assert reach == pytest.approx(arm.reach, rel=within)
