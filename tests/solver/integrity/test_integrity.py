"""Clean sets are left in peace, by exact springs; what is said of mistakes stands in recorded answers."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import first_target, only_deflections, prepare

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.campaign import TARGETS, experiment_of, linear_deflections
from jointstiff.simulator.imperfections import with_link_errors
from jointstiff.solver.integrity import inspect_measurements
from jointstiff.solver.integrity.values import View, inspect_loads
from jointstiff.solver.mechanics.postures import Postures

ROBOT, CAMPAIGN = prepare(simulate_campaign(default_arm(), load="pull", configurations=15, seed=5))


def look(measurements=CAMPAIGN, **changed):
    """Return the findings of a set with these arrays."""
    return inspect_measurements(ROBOT, replace(measurements, **changed), degrees=False)


@pytest.mark.parametrize("load", ["pull", "dead_weight"])
@pytest.mark.parametrize("seed", range(20))
def test_clean_sets_raise_no_finding(load, seed):
    robot, measurements = prepare(simulate_campaign(default_arm(), load=load, seed=seed))
    assert inspect_measurements(robot, measurements, degrees=False) == []


@pytest.mark.parametrize(
    ("row", "repeated", "told"),
    [
        (9, False, "target_moved c10"),
        (2, False, "target_moved c03"),
        (2, True, "targets_not_rigid c01"),
        (1, False, "targets_not_rigid c01"),
        (14, False, "targets_not_rigid c15"),
    ],
)
def test_a_target_that_sits_elsewhere_from_a_row_on_needs_two_postures_on_each_side(row, repeated, told):
    """A posture that is measured again is one; of one posture on a side, that posture is named instead."""
    measurements = CAMPAIGN
    if repeated:
        order = np.r_[0, 0, 2 : len(measurements)]
        shift = 1e-6 * np.arange(len(order))[:, None, None]  # no copies of each other
        measurements = replace(measurements[order], position=measurements.position[order] + shift)
    at = Postures(ROBOT, ROBOT.joint_map.model_angles(measurements.joints))
    position = measurements.position.copy()
    position[row:, 2] += at.flange_rotation[row:] @ [3e-4, -6e-4, 5e-4]
    findings = [f"{each.code} {each.observation}" for each in look(measurements, position=position)]
    assert [each for each in findings if each.startswith("target")][:1] == [told]


def test_exact_readings_raise_no_finding():
    """Rounding is neither drift nor outlier, of springs in exact balance or of the linear model."""
    arm = default_arm()
    document = simulate_campaign(arm, load="pull", configurations=15, sigma=0.0, seed=5)
    _, exact = prepare(document)
    assert look(exact) == []
    plan = experiment_of(document)
    linear = linear_deflections(arm, plan.joints, *plan.wrenches, np.array(list(TARGETS.values())))
    assert look(exact, deflection=linear) == []
    assert look(only_deflections(replace(exact, deflection=linear))) == []


@pytest.mark.parametrize("load", ["pull", "dead_weight"])
@pytest.mark.parametrize("seed", range(10))
def test_a_robot_that_is_not_its_model_raises_no_finding(load, seed):
    """Links wrong by 0.3 mm and axes by 0.02°, as real robots are."""
    arm = default_arm()
    real = with_link_errors(arm, length=3e-4, angle=np.radians(0.02), seed=seed)
    document = simulate_campaign(real, load=load, configurations=10 + 3 * seed, seed=seed)
    _, measurements = prepare(document)
    assert look(measurements) == []
    assert look(only_deflections(measurements)) == []
    assert look(measurements, sigma=None) == []


@pytest.mark.parametrize("largest", [5e-5, 2e-3])  # largest deflection [m]
def test_noise_is_a_cause_of_unexplained_deflections_only_if_a_tracker_has_as_much(largest):
    """20 µm of noise hide small deflections; deflections of other rows are unexplained, too."""
    small = largest < 1e-3
    deflection = CAMPAIGN.deflection * largest / np.abs(CAMPAIGN.deflection).max()
    if not small:
        deflection = np.random.default_rng(3).permutation(deflection)
    noise = np.random.default_rng(1).normal(0.0, 28e-6, deflection.shape)
    findings = look(only_deflections(CAMPAIGN), deflection=deflection + noise, sigma=None)
    remedies = [each.remedy for each in findings if each.code == "deflections_unexplained"]
    assert ["in a coordinate does the same: if so, load the arm more" in each for each in remedies] == [small]


@pytest.mark.parametrize("largest", [8e-5, 1.2e-4, 2e-4])  # largest deflection [m]
def test_noise_turns_no_deflection_against_its_force(largest):
    """Of deflections as small as the noise, some point against the force by chance."""
    one = first_target(CAMPAIGN)
    deflection = one.deflection * largest / np.abs(one.deflection).max()
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(0.0, 28e-6, deflection.shape)
        findings = look(one, deflection=deflection + noise, sigma=None)
        assert "deflection_against_force" not in {each.code for each in findings}


def test_repetitions_tell_sigma():
    """Ten postures, each measured four times with noise of its own: 90·3 degrees of freedom."""
    exact = prepare(simulate_campaign(default_arm(), load="pull", configurations=10, sigma=0.0, seed=5))[1]
    rows = np.repeat(np.arange(10), 4)
    unloaded, change = 3e-5 * np.random.default_rng(3).standard_normal((2, 40, 3, 3))
    repeated = replace(
        exact[rows],
        position=exact.position[rows] + unloaded,
        deflection=exact.deflection[rows] + change - unloaded,
        sigma=3e-5,
    )
    deflections, positions = found = look(repeated)
    assert {each.code for each in found} == {"repeated_readings"}
    assert (deflections.weight, positions.weight) == ("use", "use")
    for finding in (deflections, positions):
        assert 28.0 < float(re.search(r"(\S+) µm", finding.message)[1]) < 32.0
    found = look(repeated, sigma=1e-5)
    assert next(f for f in found if f.code == "repeated_readings").weight == "use_with_care"


def test_a_reading_without_load_that_several_loads_share_is_no_repetition():
    """The copies differ by rounding of arithmetic only; a second reading of a posture still counts."""
    exact = prepare(simulate_campaign(default_arm(), load="pull", configurations=10, sigma=2e-5, seed=5))[1]
    rows = np.repeat(np.arange(10), 3)
    factor = np.tile([1.0, 2.0, 3.0], 10)
    rounding = 1e-16 * np.random.default_rng(3).standard_normal((30, 3, 3))
    shared = replace(
        exact[rows],
        position=exact.position[rows] + rounding,
        deflection=factor[:, None, None] * exact.deflection[rows],
        force=factor[:, None] * exact.force[rows],
    )
    assert [each.message for each in look(shared) if each.code == "repeated_readings"] == []
    moved = shared.position.copy()
    moved[1] += 3e-5
    (found,) = (each for each in look(replace(shared, position=moved)) if each.code == "repeated_readings")
    assert found.message.startswith("in 1 repeated postures")


def test_copies_are_named_unless_chance_makes_few_numbers_equal():
    """Readings of several targets agree in no two postures; a reading of three numbers may."""
    order = np.where(np.arange(15) == 9, 4, np.arange(15))
    for measurements, count in ((CAMPAIGN, 1), (first_target(only_deflections(CAMPAIGN)), 0)):
        copy = replace(measurements[order], joints=measurements.joints)
        found = [each.message for each in look(copy) if each.code == "duplicated_observation"]
        assert [words.startswith("the readings of this observation equal") for words in found] == [
            True
        ] * count


def test_moments_of_one_axis_are_loads():
    force, moment = CAMPAIGN.force.copy(), CAMPAIGN.moment.copy()
    force[3:5], moment[3, 0] = 0.0, 50.0
    assert [
        each.observation for each in inspect_loads(View(ROBOT, replace(CAMPAIGN, force=force, moment=moment)))
    ] == ["c05"]
